"""Turning a term table into the arrays that the compiled loops read."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.kernel_draws import (
    Interval,
    drawn,
    frozen,
    frozen_offsets,
    intervals,
    lay_out_draws,
    offset,
    offsets,
)
from precision_pin.kernel_loops import SCRATCH, Draws, Formulas, Motions, Superposition
from precision_pin.parameters import Operator
from precision_pin.space import Space, occasion

if TYPE_CHECKING:
    from precision_pin.table import TermTable

__all__ = ["CompiledTable", "lay_out"]

Array = NDArray[np.float64]

NARROW: Final = 0.25 * (1 - 1e-9)
"""Angles up to this (rad) are served by the short series."""

_NEGLIGIBLE: Final = 2.0**-58
_LARGEST_POWER: Final = 8


@final
@dataclass(frozen=True, eq=False)
class CompiledTable:
    """An error model at one pose as arrays: nothing about it is compiled anew, whatever the robot.

    Attributes
    ----------
    space
        Its draws.
    targets
        K, how many targets displace the chain.
    rows
        Rows of a workspace.
    draws, formulas, superposition, motions
        What the compiled loops read, see :mod:`precision_pin.kernel_loops`.
    lowest, highest
        ``(d,)`` what a component drawn by Box-Muller or by inverse stays between.
    largest_angle
        Bound on the sum of all targets' turns over all samples, rad; infinite where none is known.
    """

    space: Space
    targets: int
    rows: int
    draws: Draws
    formulas: Formulas
    superposition: Superposition
    motions: Motions
    lowest: Array
    highest: Array
    largest_angle: float

    def words(self, pose: int, visit: int) -> NDArray[np.uint64]:
        """Return the last counter word of every stream drawn, in the order of ``draws.streams``."""
        return np.array(
            [
                occasion(draw.scope, pose, visit)
                for draw, columns in zip(self.space.draws, self.space.slices, strict=True)
                for _ in drawn(draw.law, columns)
            ],
            dtype=np.uint64,
        )


def lay_out(table: TermTable, space: Space) -> CompiledTable:
    """Return the arrays of a term table.

    Raises
    ------
    InputError
        The compiled sampler does not know a law.
    """
    rows = _Rows(space)
    formulas, program_rows = _lay_out_formulas(table, rows)
    products = _Products(rows, program_rows)
    columns = [products.row(factors[factors >= 0]) for factors in table.factors]
    superposition = _lay_out_superposition(table, columns)
    motions, largest_angle = _lay_out_motions(table, columns, rows)
    return CompiledTable(
        space=space,
        targets=len(table.targets),
        rows=SCRATCH + len(rows.intervals),
        draws=lay_out_draws(space, rows.constants),
        formulas=products.appended_to(formulas),
        superposition=superposition,
        motions=motions,
        lowest=frozen([low for low, _ in rows.intervals[: space.size]]),
        highest=frozen([high for _, high in rows.intervals[: space.size]]),
        largest_angle=largest_angle,
    )


@final
class _Rows:
    """Rows handed out one after another, each with an interval its numbers stay in; components come first."""

    def __init__(self, space: Space) -> None:
        self.intervals = intervals(space)
        self.constants: dict[float, int] = {}

    def add(self, interval: Interval) -> int:
        self.intervals.append(interval)
        return len(self.intervals) - 1

    def constant(self, value: float) -> int:
        if value not in self.constants:
            self.constants[value] = self.add((value, value))
        return self.constants[value]


# derived parameters and products -------------------------------------------------------------------------------------


def _lay_out_formulas(table: TermTable, rows: _Rows) -> tuple[list[tuple[int, int, int, int]], list[int]]:
    """Return the operations ``(operator, left, right, result)`` and the row of each parameter."""
    program = table.program
    register = [*range(program.components), *(rows.constant(value) for value in program.constants)]
    steps: list[tuple[int, int, int, int]] = []

    def apply(operator: Operator, left: int, right: int) -> int:
        result = rows.add(_applied(operator, rows.intervals[left], rows.intervals[right]))
        steps.append((int(operator), left, right, result))
        return result

    for operator, left, right in program.operations:
        a, b = register[left], register[right]
        low, high = rows.intervals[b]
        if operator is Operator.POWER and low == high and low in range(1, _LARGEST_POWER + 1):
            # a small whole power is a few products, and a product costs a hundredth of a power
            result = a
            for _ in range(int(low) - 1):
                result = apply(Operator.MULTIPLY, result, a)
            register.append(result)
        else:
            register.append(apply(operator, a, b))
    return steps, [register[output] for output in program.outputs]


@final
class _Products:
    """The distinct products of parameters, a row for each."""

    def __init__(self, rows: _Rows, parameters: Sequence[int]) -> None:
        self._rows = rows
        self._parameters = parameters
        self._known: dict[tuple[int, ...], int] = {}
        self._factors: list[tuple[int, int]] = []
        self._results: list[int] = []

    def row(self, factors: NDArray[np.intp]) -> int:
        """Return the row that holds the product of parameters; of none, a row of ones."""
        if not factors.size:
            return self._rows.constant(1.0)
        return self._row(tuple(sorted(self._parameters[factor] for factor in factors)))

    def _row(self, key: tuple[int, ...]) -> int:
        if len(key) == 1:
            return key[0]
        if key not in self._known:
            left, right = self._row(key[:-1]), key[-1]
            intervals = self._rows.intervals
            self._known[key] = self._rows.add(_applied(Operator.MULTIPLY, intervals[left], intervals[right]))
            self._factors.append((left, right))
            self._results.append(self._known[key])
        return self._known[key]

    def appended_to(self, steps: Sequence[tuple[int, int, int, int]]) -> Formulas:
        """Return the operations and, after them, the products."""
        operators = np.array([step[0] for step in steps], dtype=np.int64)
        operators.flags.writeable = False
        return Formulas(
            operators=operators,
            left=offsets([step[1] for step in steps]),
            right=offsets([step[2] for step in steps]),
            results=offsets([step[3] for step in steps]),
            product_factors=frozen_offsets(
                np.array([(offset(a), offset(b)) for a, b in self._factors], dtype=np.uint64).reshape(-1, 2)
            ),
            products=offsets(self._results),
        )


def _applied(operator: Operator, a: Interval, b: Interval) -> Interval:
    """Return an interval that holds the operation's results; all numbers where nothing better is known."""
    everything = (-math.inf, math.inf)
    match operator:
        case Operator.ADD:
            ends = [a[0] + b[0], a[1] + b[1]]
        case Operator.SUBTRACT:
            ends = [a[0] - b[1], a[1] - b[0]]
        case Operator.MULTIPLY:
            ends = [x * y for x in a for y in b]
        case Operator.DIVIDE:
            if b[0] <= 0 <= b[1]:
                return everything
            ends = [x / y for x in a for y in b]
        case Operator.POWER:
            if a[0] <= 0 or math.inf in a:
                return everything
            try:
                ends = [x**y for x in a for y in b]
            except OverflowError:
                return everything
        case Operator.SQRT:
            ends = [math.sqrt(max(x, 0.0)) for x in a]
        case Operator.SIN | Operator.COS:
            return (-1.0, 1.0)
    if any(map(math.isnan, ends)):
        return everything
    # outwards by more than the rounding of either end and of the samples' own operation
    low, high = min(ends), max(ends)
    return low - 1e-14 * abs(low), high + 1e-14 * abs(high)


# displacements -------------------------------------------------------------------------------------------------------


def _entries(vectors: Mapping[int, Array]) -> tuple[list[int], list[Array]]:
    """Return rows and coefficients ``(3,)`` of a sum, filled up to what the loops take at a time."""
    kept = [(row, vector) for row, vector in vectors.items() if vector.any()]
    rows, coefficients = [row for row, _ in kept], [vector for _, vector in kept]
    while len(rows) % 4 not in (0, 3):
        rows.append(rows[0])
        coefficients.append(np.zeros(3))
    return rows, coefficients


def _without_dust(vector: Array) -> Array:
    """Return a vector without components that are rounding errors of its direction."""
    return np.where(np.abs(vector) > _NEGLIGIBLE * np.abs(vector).max(), vector, 0.0)


def _summed(columns: Iterable[tuple[int, Array]]) -> dict[int, Array]:
    """Return the twist ``(6,)`` that goes with each row."""
    moved: dict[int, Array] = {}
    for column, twist in columns:
        moved[column] = moved.get(column, np.zeros(6)) + twist
    return moved


def _lay_out_superposition(table: TermTable, columns: Sequence[int]) -> Superposition:
    moved = _summed(
        (column, table.sensitivities[target] @ twist)
        for target, twist, column in zip(table.target, table.twists, columns, strict=True)
    )
    shift_rows, shifts = _entries({column: _without_dust(vector[:3]) for column, vector in moved.items()})
    turn_rows, turns = _entries({column: _without_dust(vector[3:]) for column, vector in moved.items()})
    return Superposition(offsets(shift_rows), frozen(shifts, -1, 3), offsets(turn_rows), frozen(turns, -1, 3))


def _lay_out_motions(table: TermTable, columns: Sequence[int], rows: _Rows) -> tuple[Motions, float]:
    """Return the targets tip first, and the bound on the sum of their turns."""
    count = len(table.targets)
    shifts: list[tuple[list[int], list[Array]]] = []
    turns: list[tuple[list[int], list[Array]]] = []
    arms = np.zeros((count, 3))
    wide = np.zeros(count + 1, dtype=np.int64)
    total = 0.0
    for place, k in enumerate(reversed(range(count))):
        rotation = table.frames[k, :3, :3]
        arms[place] = table.pose[:3, 3] - table.frames[k, :3, 3]
        moved = _summed(
            (column, twist)
            for target, twist, column in zip(table.target, table.twists, columns, strict=True)
            if target == k
        )
        turning = {column: _without_dust(rotation @ twist[3:]) for column, twist in moved.items()}
        shifts.append(_entries({column: _without_dust(rotation @ twist[:3]) for column, twist in moved.items()}))
        turns.append(_entries({column: turn / 2 for column, turn in turning.items()}))
        reach = np.zeros(3)
        for column, turn in turning.items():
            furthest = max(map(abs, rows.intervals[column]))
            reach += np.abs(turn) * furthest if turn.any() else 0.0
        angle = float(np.linalg.norm(np.nan_to_num(reach, nan=math.inf)))
        wide[place] = angle > NARROW
        total += angle
    wide[count] = total > NARROW
    arms.flags.writeable = wide.flags.writeable = False
    return Motions(*_stacked(shifts), *_stacked(turns), arms, wide), total


def _stacked(sums: Sequence[tuple[list[int], list[Array]]]) -> tuple[NDArray[np.uint64], NDArray[np.uint64], Array]:
    """Return where the entries of each sum start, all row offsets and all coefficients ``(entries, 3)``."""
    starts = np.cumsum([0, *(len(rows) for rows, _ in sums)])
    rows = [row for rows, _ in sums for row in rows]
    return frozen_offsets(starts), offsets(rows), frozen([vector for _, vectors in sums for vector in vectors], -1, 3)
