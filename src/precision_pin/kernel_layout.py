"""Turning a term table into the arrays that the compiled loops read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from precision_pin.errors import InputError
from precision_pin.kernel_loops import SCRATCH, STRIDE, Draws, Formulas, Motions, Superposition
from precision_pin.laws import (
    FARTHEST_NORMAL,
    Arcsine,
    Circle,
    Disc,
    Empirical,
    Fixed,
    JointNormal,
    Law,
    Lognormal,
    Normal,
    Rows,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.parameters import Operator
from precision_pin.space import Space, occasion

if TYPE_CHECKING:
    from precision_pin.table import TermTable

__all__ = ["FURTHEST_NORMAL", "CompiledTable", "lay_out"]

Array = NDArray[np.float64]
Interval = tuple[float, float]

FURTHEST_NORMAL: Final = math.sqrt(-2 * math.log(2.0**-53)) * (1 + 1e-12)
"""No normal number drawn is further from zero: Box-Muller of the smallest uniform number, 8.57."""

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
                for _ in _drawn(draw.law, columns)
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
        draws=_lay_out_draws(space, rows),
        formulas=products.appended_to(formulas),
        superposition=superposition,
        motions=motions,
        lowest=_frozen([low for low, _ in rows.intervals[: space.size]]),
        highest=_frozen([high for _, high in rows.intervals[: space.size]]),
        largest_angle=largest_angle,
    )


@final
class _Rows:
    """Rows handed out one after another, each with an interval its numbers stay in; components come first."""

    def __init__(self, space: Space) -> None:
        mixed = {name for correlation in space.correlations for name in correlation.names}
        self.intervals: list[Interval] = [
            bound
            for draw in space.draws
            for bound in _law_intervals(draw.law, FARTHEST_NORMAL if draw.name in mixed else FURTHEST_NORMAL)
        ]
        self.constants: dict[float, int] = {}

    def add(self, interval: Interval) -> int:
        self.intervals.append(interval)
        return len(self.intervals) - 1

    def constant(self, value: float) -> int:
        if value not in self.constants:
            self.constants[value] = self.add((value, value))
        return self.constants[value]


def _offset(row: int) -> int:
    return (SCRATCH + row) * STRIDE


def _offsets(rows: Sequence[int]) -> NDArray[np.uint64]:
    return _frozen_offsets([_offset(row) for row in rows])


def _frozen_offsets(values: ArrayLike) -> NDArray[np.uint64]:
    array = np.ascontiguousarray(values, dtype=np.uint64)
    array.flags.writeable = False
    return array


def _frozen(values: ArrayLike, *shape: int) -> Array:
    array = np.array(values, dtype=float).reshape(shape or -1)
    array.flags.writeable = False
    return array


# draws ---------------------------------------------------------------------------------------------------------------


def _drawn(law: Law, columns: slice) -> range:
    """Return the components of a law for which random numbers are made."""
    match law:
        case Fixed():
            return range(0)
        case Circle():
            return range(columns.start + 1, columns.stop)
        case Rows():
            return range(columns.start, columns.start + 1)
        case _:
            return range(columns.start, columns.stop)


def _lay_out_draws(space: Space, rows: _Rows) -> Draws:
    placed = list(zip((draw.law for draw in space.draws), space.slices, strict=True))
    drawn = [component for law, columns in placed for component in _drawn(law, columns)]

    def of(kind: type[Law]) -> NDArray[np.uint64]:
        return _offsets([columns.start for law, columns in placed if isinstance(law, kind)])

    fixed = {columns.start: law.mean for law, columns in placed if isinstance(law, Fixed)}
    fixed |= {row: value for value, row in rows.constants.items()}
    roots, sizes = _lay_out_joint([law for law, _ in placed if isinstance(law, JointNormal)])
    groups = [[space.index[correlation.names[k]] for k in correlation.order] for correlation in space.correlations]
    mixed = {component for group in groups for component in group}
    fed = {columns.start for law, columns in placed if isinstance(law, Normal | Lognormal)}
    lines, line_starts = _stacked([law.segments for law, _ in placed if isinstance(law, Empirical)], 4)
    tables = [law for law, _ in placed if isinstance(law, Rows)]
    numbers, number_starts = _stacked([law.array.reshape(-1, 1) for law in tables], 1)
    shapes = [(law.size, len(law.table), start) for law, start in zip(tables, number_starts[:-1], strict=True)]
    return Draws(
        fixed_rows=_offsets(list(fixed)),
        fixed_values=_frozen(list(fixed.values())),
        stream_rows=_offsets(drawn),
        streams=_frozen_offsets([space.streams[component] for component in drawn]),
        score_rows=_offsets(sorted(fed | mixed)),
        group_starts=_frozen_offsets(np.cumsum([0, *map(len, groups)])),
        group_rows=_offsets([component for group in groups for component in group]),
        group_roots=_padded([correlation.root for correlation in space.correlations]),
        cumulated_rows=_offsets(sorted(mixed - fed)),
        uniform_rows=of(Uniform),
        uniform=_frozen([(law.mean, law.half_width) for law, _ in placed if isinstance(law, Uniform)], -1, 2),
        triangular_rows=of(Triangular),
        triangular=_frozen([(law.mean, law.half_width) for law, _ in placed if isinstance(law, Triangular)], -1, 2),
        normal_rows=of(Normal),
        normal=_frozen([(law.mean, law.std) for law, _ in placed if isinstance(law, Normal)], -1, 2),
        truncated_rows=of(TruncatedNormal),
        truncated=_frozen(
            [
                (law.mean, law.std, law.k, special.ndtr(-law.k), math.erf(law.k / math.sqrt(2)))
                for law, _ in placed
                if isinstance(law, TruncatedNormal)
            ],
            -1,
            5,
        ),
        disc_rows=of(Disc),
        disc=_frozen([law.radius for law, _ in placed if isinstance(law, Disc)]),
        circle_rows=of(Circle),
        circle=_frozen([law.radius for law, _ in placed if isinstance(law, Circle)]),
        joint_rows=of(JointNormal),
        joint_roots=roots,
        joint_sizes=sizes,
        lognormal_rows=of(Lognormal),
        lognormal=_frozen(
            [(law.mean, law.log_std, law.log_std**2 / 2) for law, _ in placed if isinstance(law, Lognormal)], -1, 3
        ),
        arcsine_rows=of(Arcsine),
        arcsine=_frozen([(law.mean, law.half_width) for law, _ in placed if isinstance(law, Arcsine)], -1, 2),
        two_point_rows=of(TwoPoint),
        two_point=_frozen(
            [(law.centre, law.half_width, law.threshold) for law, _ in placed if isinstance(law, TwoPoint)], -1, 3
        ),
        empirical_rows=of(Empirical),
        empirical_starts=line_starts,
        empirical=lines,
        table_rows=of(Rows),
        table_shapes=_frozen_offsets(np.array(shapes, dtype=np.uint64).reshape(-1, 3)),
        table=_frozen(numbers),
    )


def _lay_out_joint(laws: Sequence[JointNormal]) -> tuple[Array, NDArray[np.uint64]]:
    largest = max((law.size for law in laws), default=1)
    roots = np.zeros((len(laws), largest + 1, largest))
    for k, law in enumerate(laws):
        roots[k, 0, : law.size] = law.mean_vector
        roots[k, 1 : law.size + 1, : law.size] = law.root
    return _frozen(roots, *roots.shape), _frozen_offsets([law.size for law in laws])


def _padded(matrices: Sequence[Array]) -> Array:
    """Return square matrices as one array, padded to the largest by zeros."""
    largest = max(map(len, matrices), default=1)
    padded = np.zeros((len(matrices), largest, largest))
    for k, matrix in enumerate(matrices):
        padded[k, : len(matrix), : len(matrix)] = matrix
    return _frozen(padded, *padded.shape)


def _stacked(parts: Sequence[Array], columns: int) -> tuple[Array, NDArray[np.uint64]]:
    """Return matrices on top of one another, and at which row each begins, with the end of the last."""
    stacked = np.concatenate([np.zeros((0, columns)), *parts])
    return _frozen(stacked, *stacked.shape), _frozen_offsets(np.cumsum([0, *map(len, parts)]))


def _law_intervals(law: Law, farthest: float) -> list[Interval]:
    """Return what each number of a law stays between, drawn with normal numbers up to ``farthest``.

    Raises
    ------
    InputError
        The compiled sampler does not know the law.
    """
    match law:
        case JointNormal():
            reaches = np.abs(law.root).sum(axis=1) * FURTHEST_NORMAL
            return [(m - r, m + r) for m, r in zip(law.mean_vector.tolist(), reaches.tolist(), strict=True)]
        case (
            Fixed()
            | Uniform()
            | Triangular()
            | Normal()
            | TruncatedNormal()
            | Disc()
            | Circle()
            | Lognormal()
            | Arcsine()
            | TwoPoint()
            | Empirical()
            | Rows()
        ):
            return [law.interval(k, farthest) for k in range(law.size)]
        case _:
            raise InputError(f"the compiled sampler does not know the law {type(law).__name__}")


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
            left=_offsets([step[1] for step in steps]),
            right=_offsets([step[2] for step in steps]),
            results=_offsets([step[3] for step in steps]),
            product_factors=_frozen_offsets(
                np.array([(_offset(a), _offset(b)) for a, b in self._factors], dtype=np.uint64).reshape(-1, 2)
            ),
            products=_offsets(self._results),
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


def _entries(sums: Sequence[dict[int, float]]) -> tuple[NDArray[np.uint64], NDArray[np.uint64], Array]:
    """Return starts, row offsets and coefficients of sums of ``coefficient × row``."""
    kept = [[(row, value) for row, value in entries.items() if value != 0.0] for entries in sums]
    starts = np.cumsum([0, *map(len, kept)])
    flat = [entry for entries in kept for entry in entries]
    return _frozen_offsets(starts), _offsets([row for row, _ in flat]), _frozen([value for _, value in flat])


def _without_dust(vector: Array) -> Array:
    """Return a vector without components that are rounding errors of its direction."""
    return np.where(np.abs(vector) > _NEGLIGIBLE * np.abs(vector).max(), vector, 0.0)


def _lay_out_superposition(table: TermTable, columns: Sequence[int]) -> Superposition:
    moved: dict[int, Array] = {}
    for target, twist, column in zip(table.target, table.twists, columns, strict=True):
        moved[column] = moved.get(column, np.zeros(6)) + table.sensitivities[target] @ twist
    sums: list[dict[int, float]] = [{} for _ in range(6)]
    for column, vector in moved.items():
        for c, value in enumerate(np.concatenate([_without_dust(vector[:3]), _without_dust(vector[3:])])):
            sums[c][column] = float(value)
    return Superposition(*_entries(sums))


def _lay_out_motions(table: TermTable, columns: Sequence[int], rows: _Rows) -> tuple[Motions, float]:
    """Return the targets tip first, and the bound on the sum of their turns."""
    count = len(table.targets)
    moved: list[dict[int, Array]] = [{} for _ in range(count)]
    for target, twist, column in zip(table.target, table.twists, columns, strict=True):
        moved[target][column] = moved[target].get(column, np.zeros(6)) + twist
    sums: list[dict[int, float]] = []
    arms = np.zeros((count, 3))
    wide = np.zeros(count + 1, dtype=np.int64)
    total = 0.0
    for place, k in enumerate(reversed(range(count))):
        rotation = table.frames[k, :3, :3]
        arms[place] = table.pose[:3, 3] - table.frames[k, :3, 3]
        own: list[dict[int, float]] = [{} for _ in range(6)]
        reach = np.zeros(3)
        for column, twist in moved[k].items():
            shift, turn = _without_dust(rotation @ twist[:3]), _without_dust(rotation @ twist[3:])
            furthest = max(map(abs, rows.intervals[column]))
            reach += np.abs(turn) * furthest if turn.any() else 0.0
            for c in range(3):
                own[c][column] = float(shift[c])
                own[3 + c][column] = float(turn[c] / 2)
        sums.extend(own)
        angle = float(np.linalg.norm(np.nan_to_num(reach, nan=math.inf)))
        wide[place] = angle > NARROW
        total += angle
    wide[count] = total > NARROW
    arms.flags.writeable = wide.flags.writeable = False
    return Motions(*_entries(sums), arms, wide), total
