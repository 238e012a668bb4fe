"""Conversion of a term table to the arrays that the compiled loops read."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce
from itertools import groupby, pairwise
from typing import Any, Final, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw, Scope, occasion
from precision_pin.draws.expressions import Operator, Program
from precision_pin.draws.laws import Disc, Law
from precision_pin.draws.laws.law import Branch, KernelRow
from precision_pin.draws.space import Space
from precision_pin.kernel.loops import (
    FINE,
    NARROW,
    STRIDE,
    WIDE,
    Datum,
    Draws,
    Formulas,
    Motions,
    Superposition,
    Wanted,
)
from precision_pin.terms.table import TermTable

COMMON: Final[frozenset[Branch]] = frozenset(("fixed", "uniform", "triangular", "normal", "truncated"))
"""Laws whose loops are always compiled; the loops of the other laws and of correlation are compiled on demand."""

_COLUMNS: Final[Mapping[Branch, int]] = {
    "uniform": 2,
    "triangular": 2,
    "truncated": 5,
    "lognormal": 3,
    "arcsine": 2,
    "two_point": 3,
}
"""Number of parameters that the loop of each law reads."""
_SINGLE: Final[tuple[Branch, ...]] = ("disc", "circle", "sphere")
"""Laws with a single parameter."""
_OWN: Final[tuple[Branch, ...]] = ("joint", "empirical", "table")
"""Laws with a table of parameters."""

BESIDE: Final[Mapping[str, tuple[str, ...]]] = {
    **{f"{branch}_rows": (branch,) for branch in (*_COLUMNS, *_SINGLE)},
    "fixed_rows": ("fixed_values",),
    "stream_rows": ("streams",),
    "normal_rows": ("normal",),
    "cumulated_rows": (),
    "scaled_rows": ("scaled",),
    "joint_rows": ("joint_roots", "joint_sizes"),
    "empirical_rows": (),
    "table_rows": ("table_shapes",),
}
"""Fields of :class:`precision_pin.kernel.loops.Draws` with row offsets, and the fields with one entry for each row."""

Interval = tuple[float, float]


def offset(row: int) -> int:
    """Return the offset of a row in the workspace."""
    return row * STRIDE


def offsets(rows: Sequence[int]) -> NDArray[np.uint64]:
    """Return the offsets of rows as a read-only array."""
    return freeze_offsets([offset(row) for row in rows])


def freeze_offsets(values: ArrayLike) -> NDArray[np.uint64]:
    """Return whole numbers as a read-only array: to numba a writeable array is another type."""
    array = np.ascontiguousarray(values, dtype=np.uint64)
    array.flags.writeable = False
    return array


def freeze(values: ArrayLike, *shape: int) -> Array:
    """Return numbers as a read-only array, flat or with a given shape."""
    array = np.array(values, dtype=float).reshape(shape or -1)
    array.flags.writeable = False
    return array


def rare_laws(space: Space) -> Wanted:
    """Return True for a space with rare laws, whose loops are compiled on demand, else None."""
    rows = (draw.law.kernel_row() for draw in space.draws)
    common = not space.correlations and all(row is not None and row.branch in COMMON for row in rows)
    return None if common else True


def convert_draws(space: Space, constants: Mapping[float, int]) -> Draws:
    """Return the arrays of a space's draws, with a row for each component, in order, and for each constant."""
    law_columns = list(zip((draw.law for draw in space.draws), space.slices, strict=True))
    streamed = [columns.start + k for law, columns in law_columns for k in law.streamed]
    by_branch: dict[Branch, dict[int, Array]] = {branch: {} for branch in get_args(Branch)}
    for law, columns in law_columns:
        row = _kernel_row(law)
        by_branch[row.branch][columns.start] = row.numbers
    from_normals = {k for law, rows in law_columns if law.variates == "normal" for k in range(rows.start, rows.stop)}
    groups = [[space.index[correlation.names[k]] for k in correlation.order] for correlation in space.correlations]
    mixed = {component for group in groups for component in group}
    fixed = {row: float(value[0]) for row, value in by_branch["fixed"].items()}
    fixed |= {row: value for value, row in constants.items()}
    normal = by_branch["normal"]
    # Python floats: an overflow of the square gives infinity without a warning, and the errors are then rejected
    plain = {row: numbers.tolist() for row, numbers in normal.items() if row not in mixed}
    normals = {row: (mean, -2 * std * std) for row, (mean, std) in plain.items()}
    normals |= dict.fromkeys(sorted((from_normals - normal.keys()) | mixed), (0.0, -2.0))
    scaled = {row: numbers for row, numbers in normal.items() if row in mixed}
    roots, sizes = _stack_roots(list(by_branch["joint"].values()))
    lines, line_starts = _stack_rows(list(by_branch["empirical"].values()), 4)
    tables = list(by_branch["table"].values())
    numbers, number_starts = _stack_rows([table.reshape(-1, 1) for table in tables], 1)
    shapes = [(table.shape[1], len(table), start) for table, start in zip(tables, number_starts[:-1], strict=True)]
    alike: dict[str, Any] = {
        f"{branch}_rows": offsets(list(by_branch[branch])) for branch in (*_COLUMNS, *_SINGLE, *_OWN)
    }
    alike |= {branch: freeze(list(by_branch[branch].values()), -1, count) for branch, count in _COLUMNS.items()}
    alike |= {branch: freeze(list(by_branch[branch].values())) for branch in _SINGLE}
    return Draws(
        **alike,
        fixed_rows=offsets(list(fixed)),
        fixed_values=freeze(list(fixed.values())),
        stream_rows=offsets(streamed),
        streams=freeze_offsets([space.streams[component] for component in streamed]),
        normal_rows=offsets(list(normals)),
        normal=freeze(list(normals.values()), -1, 2),
        group_starts=freeze_offsets(np.cumsum([0, *map(len, groups)])),
        group_rows=offsets([component for group in groups for component in group]),
        group_roots=_pad([correlation.root for correlation in space.correlations]),
        cumulated_rows=offsets(sorted(mixed - from_normals)),
        scaled_rows=offsets(list(scaled)),
        scaled=freeze(list(scaled.values()), -1, 2),
        joint_roots=roots,
        joint_sizes=sizes,
        empirical_starts=line_starts,
        empirical=lines,
        table_shapes=freeze_offsets(np.array(shapes, dtype=np.uint64).reshape(-1, 3)),
        table=freeze(numbers),
    )


def _kernel_row(law: Law) -> KernelRow:
    row = law.kernel_row()
    if row is None:
        raise InputError(f"the compiled sampler does not support the law {type(law).__name__}")
    return row


def _stack_roots(tables: Sequence[Array]) -> tuple[Array, NDArray[np.uint64]]:
    largest = max((table.shape[1] for table in tables), default=1)
    roots = np.zeros((len(tables), largest + 3, largest))
    for root, table in zip(roots, tables, strict=True):
        size = table.shape[1]
        root[size + 1, :size], root[size + 2, :size] = -np.inf, np.inf
        root[: len(table), :size] = table
    return freeze(roots, *roots.shape), freeze_offsets([table.shape[1] for table in tables])


def _pad(matrices: Sequence[Array]) -> Array:
    largest = max(map(len, matrices), default=1)
    padded = np.zeros((len(matrices), largest, largest))
    for k, matrix in enumerate(matrices):
        padded[k, : len(matrix), : len(matrix)] = matrix
    return freeze(padded, *padded.shape)


def _stack_rows(parts: Sequence[Array], columns: int) -> tuple[Array, NDArray[np.uint64]]:
    """Return matrices stacked vertically, and the first row of each, then the total number of rows."""
    stacked = np.concatenate([np.zeros((0, columns)), *parts])
    return freeze(stacked, *stacked.shape), freeze_offsets(np.cumsum([0, *map(len, parts)]))


def intervals(space: Space) -> list[Interval]:
    """Return the bounds of each component, drawn with uniform numbers of 53 bits."""
    result: list[Interval] = []
    for draw in space.draws:
        kernel_intervals = _kernel_row(draw.law).intervals
        result += kernel_intervals or [draw.law.interval(k) for k in range(draw.law.size)]
    return result


Column = tuple[int, ...]
"""One row, or two rows to multiply."""

# slightly below the range of the series, to allow for rounding of the bounds that are compared
_FINE_UP_TO: Final = 0.01 * (1 - 1e-9)
_NARROW_UP_TO: Final = 0.25 * (1 - 1e-9)
"""Largest angles (rad) for the shortest and the short series."""

_NEGLIGIBLE: Final = 2.0**-58  # components below this share of a vector's largest one are rounding
_LARGEST_POWER: Final = 8  # whole exponents up to this one are evaluated by multiplications


@dataclass(frozen=True, eq=False)
class SamplerArrays:
    """Error model at one pose as arrays, which the same compiled loops read for every robot.

    Attributes:
        targets: Number of targets that displace the chain, K.
        rows: Rows of a workspace.
        draws, formulas, superposition, motions, datum: Arrays for the compiled loops, see
            :mod:`precision_pin.kernel.loops`.
        lowest, highest: ``(d,)`` bounds of each component, drawn by Box-Muller or by the inverse distribution function.
        largest_angle: Bound on the sum of all targets' rotation angles, for all samples, rad; infinite if unknown.
    """

    space: Space
    targets: int
    rows: int
    draws: Draws
    formulas: Formulas
    superposition: Superposition
    motions: Motions
    datum: Datum | None
    lowest: Array
    highest: Array
    largest_angle: float

    @cached_property
    def scopes(self) -> tuple[Scope, ...]:
        """Scope of each stream of ``draws``."""
        return tuple(draw.scope for draw in self.space.draws for _ in draw.law.streamed)

    @cached_property
    def rare(self) -> Wanted:
        """True if the space has rare laws, whose loops are compiled on demand, else None."""
        return rare_laws(self.space)

    def words(self, pose: int, visit: int) -> NDArray[np.uint64]:
        """Return the last counter word of every stream, in the order of ``draws.streams``."""
        occasions = {scope: occasion(scope, pose, visit) for scope in dict.fromkeys(self.scopes)}
        return np.array([occasions[scope] for scope in self.scopes], dtype=np.uint64)


class ModelAtPose(Protocol):
    """What the kernel needs of an error model at a pose: its terms and draws."""

    @property
    def table(self) -> TermTable:
        """Its terms."""

    @property
    def space(self) -> Space:
        """The draws."""

    @property
    def datum(self) -> AddedErrors | None:
        """Errors that are added."""


class AddedErrors(Protocol):
    """Errors that are added to that of a pose: ``Σ gain × error of a visit + noise × components``."""

    @property
    def visits(self) -> Sequence[ModelAtPose]:
        """Models of the errors."""

    @property
    def gains(self) -> Array:
        """``(V, 6, 6)``."""

    @property
    def noise(self) -> Array:
        """``(6, d)``."""


@dataclass(frozen=True, eq=False)
class _Added:
    """Added errors."""

    visits: Sequence[ModelAtPose]
    gains: Array
    noise: Array


@dataclass(frozen=True, eq=False)
class _Terms:
    """Terms, optionally with added errors."""

    table: TermTable
    space: Space
    datum: _Added | None = None


def empty_table(rare: Wanted = None, datum: Wanted = None) -> SamplerArrays:
    """Return the arrays of a model without errors, optionally with a rare law or with a datum."""
    table = TermTable(
        pose=np.eye(4),
        targets=(),
        frames=np.zeros((0, 4, 4)),
        program=Program(0, (), (), ()),
        target=np.zeros(0, dtype=np.intp),
        twists=np.zeros((0, 6)),
        factors=np.zeros((0, 3), dtype=np.intp),
    )
    at = _Terms(table, Space((Draw("disc", Disc(1.0)),) if rare else ()))
    if datum:
        at = replace(at, datum=_Added([at], np.zeros((1, 6, 6)), np.zeros((6, at.space.size))))
    return convert_models([at])[0]


def convert_models(models: Sequence[ModelAtPose]) -> list[SamplerArrays]:
    """Return the arrays of one error model at poses; their bits do not depend on the other poses."""
    # consecutive tables with the same targets, program and factors, such as one model at several poses, share draws and
    # formulas
    arrays: list[SamplerArrays] = []
    for _, alike in groupby(models, key=lambda at: (id(at.table.program), id(at.table.target), id(at.table.factors))):
        arrays += _convert_alike(list(alike))
    return arrays


def _convert_alike(models: Sequence[ModelAtPose]) -> list[SamplerArrays]:
    tables, space = [at.table for at in models], models[0].space
    rows = _RowAllocator(space)
    products = _Products(rows)
    columns = products.columns(tables[0])
    parts = [at.datum for at in models if at.datum is not None]
    visits = [(visit.table, products.columns(visit.table)) for visit in parts[0].visits] if parts else []
    converted = _convert_displacements(tables, columns, rows.intervals, _superposed(parts, visits))
    datums = _convert_datums(parts, visits, rows) if parts else [None] * len(models)
    draws, formulas = convert_draws(space, rows.constants), products.formulas()
    lowest = freeze([low for low, _ in rows.intervals[: space.size]])
    highest = freeze([high for _, high in rows.intervals[: space.size]])
    return [
        SamplerArrays(
            space=space,
            targets=len(tables[0].targets),
            rows=len(rows.intervals),
            draws=draws,
            formulas=formulas,
            superposition=superposition,
            motions=motions,
            datum=datum,
            lowest=lowest,
            highest=highest,
            largest_angle=angle,
        )
        for (superposition, motions, angle), datum in zip(converted, datums, strict=True)
    ]


class _RowAllocator:
    """Allocator of consecutive rows, components first, each with an interval that contains its values."""

    def __init__(self, space: Space) -> None:
        # row k is component k: the loops rely on this where they store components
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


class _Products:
    """Formulas, and distinct products of parameters that are factors of further products, with a row for each."""

    def __init__(self, rows: _RowAllocator) -> None:
        self._rows = rows
        self._steps: dict[tuple[int, int, int], int] = {}
        self._known: dict[tuple[int, ...], int] = {}
        self._factors: list[tuple[int, int]] = []
        self._results: list[int] = []

    def columns(self, table: TermTable) -> list[Column]:
        """Return for each term one or two rows whose product is that of its parameters; a row of ones for none."""
        parameters = self._parameters(table.program)
        # sorted, so that a product has one row for any order of its factors in the sheet
        keys = [tuple(sorted(parameters[factor] for factor in factors if factor >= 0)) for factors in table.factors]
        return [self._column(key) for key in keys]

    def _parameters(self, program: Program) -> list[int]:
        """Return the row of each parameter of a program."""
        register = [*range(program.components), *(self._rows.constant(value) for value in program.constants)]
        for operator, left, right in program.operations:
            a, b = register[left], register[right]
            low, high = self._rows.intervals[b]
            if operator is Operator.POWER and low == high and low in range(1, _LARGEST_POWER + 1):
                # a product costs a hundredth of a general power
                result = a
                for _ in range(int(low) - 1):
                    result = self._apply(Operator.MULTIPLY, result, a)
                register.append(result)
            else:
                register.append(self._apply(operator, a, b))
        return [register[output] for output in program.outputs]

    def _apply(self, operator: Operator, left: int, right: int) -> int:
        step = int(operator), left, right
        if step not in self._steps:
            intervals = self._rows.intervals
            self._steps[step] = self._rows.add(_result_interval(operator, intervals[left], intervals[right]))
        return self._steps[step]

    def _column(self, key: tuple[int, ...]) -> Column:
        if not key:
            return (self._rows.constant(1.0),)
        return key if len(key) == 1 else (self._row(key[:-1]), key[-1])

    def _row(self, key: tuple[int, ...]) -> int:
        if len(key) == 1:
            return key[0]
        if key not in self._known:
            left, right = self._row(key[:-1]), key[-1]
            intervals = self._rows.intervals
            self._known[key] = self._rows.add(_product_interval(intervals[left], intervals[right]))
            self._factors.append((left, right))
            self._results.append(self._known[key])
        return self._known[key]

    def formulas(self) -> Formulas:
        """Return the operations and, after them, the products."""
        operators = np.array([operator for operator, _, _ in self._steps], dtype=np.int64)
        operators.flags.writeable = False
        return Formulas(
            operators=operators,
            left=offsets([left for _, left, _ in self._steps]),
            right=offsets([right for _, _, right in self._steps]),
            results=offsets(list(self._steps.values())),
            product_factors=freeze_offsets(
                np.array([(offset(a), offset(b)) for a, b in self._factors], dtype=np.uint64).reshape(-1, 2)
            ),
            products=offsets(self._results),
        )


def _result_interval(operator: Operator, a: Interval, b: Interval) -> Interval:
    """Return an interval that contains the results of an operation; the real line if unknown."""
    real_line = (-math.inf, math.inf)
    match operator:
        case Operator.ADD:
            values = [a[0] + b[0], a[1] + b[1]]
        case Operator.SUBTRACT:
            values = [a[0] - b[1], a[1] - b[0]]
        case Operator.MULTIPLY:
            values = [x * y for x in a for y in b]
        case Operator.DIVIDE:
            if b[0] <= 0 <= b[1]:
                return real_line
            values = [x / y for x in a for y in b]
        case Operator.POWER:
            if a[0] <= 0 or math.inf in a:
                return real_line
            try:
                values = [x**y for x in a for y in b]
            except OverflowError:
                return real_line
        case Operator.SQRT:
            values = [math.sqrt(max(x, 0.0)) for x in a]
        case Operator.SIN | Operator.COS | Operator.SIGN:
            return (-1.0, 1.0)
    if any(map(math.isnan, values)):
        return real_line
    # widened by more than the rounding of the ends and of the same operation on the samples
    low, high = min(values), max(values)
    return low - 1e-14 * abs(low), high + 1e-14 * abs(high)


def _product_interval(a: Interval, b: Interval) -> Interval:
    return _result_interval(Operator.MULTIPLY, a, b)


# displacements -------------------------------------------------------------------------------------------------------


_Superposed = tuple[list[Column], Array]
"""Columns, and what a unit of each adds to the error at every pose, to first order, ``(P, columns, 6)``."""


def _superposed(parts: Sequence[AddedErrors], visits: Sequence[tuple[TermTable, list[Column]]]) -> _Superposed:
    """Return what datums add to the error of the linear model at poses."""
    noise = np.stack([part.noise.T for part in parts]) if parts else np.zeros((0, 0, 6))
    components = np.flatnonzero(noise.any(axis=(0, 2))).tolist()
    columns: list[Column] = [(component,) for component in components]
    vectors = [noise[:, components]]
    for number, (table, own) in enumerate(visits):
        displacement = _Displacements.of([table])
        twists = np.concatenate([displacement.carried, displacement.turned], axis=2)
        gains = np.stack([part.gains[number] for part in parts])
        vectors.append((gains[:, None] * twists[:, :, None]).sum(axis=-1))
        columns += own
    return columns, np.concatenate(vectors, axis=1)


def _convert_datums(
    parts: Sequence[AddedErrors], visits: Sequence[tuple[TermTable, list[Column]]], rows: _RowAllocator
) -> list[Datum]:
    """Return the datum at each pose."""
    tables, columns = tuple(table for table, _ in visits), tuple(tuple(entries) for _, entries in visits)
    motions = _convert_visits(tables, columns, tuple(rows.intervals))
    results = [rows.add((-math.inf, math.inf)) for _ in range(6 * len(visits))]
    noise = np.stack([part.noise.T for part in parts])
    gains = np.stack([part.gains for part in parts]).swapaxes(2, 3).reshape(len(parts), -1, 6)
    gains = np.concatenate([gains, noise], axis=1)
    kept = np.flatnonzero(gains.any(axis=(0, 2)))
    all_rows = np.array([*results, *range(noise.shape[1])])[kept]
    row_offsets, result_offsets = offsets(all_rows.tolist()), offsets(results).reshape(-1, 6)
    return [Datum(motions, result_offsets, row_offsets, freeze(own, 1, -1, 6)) for own in gains[:, kept]]


@lru_cache(maxsize=4)
def _convert_visits(
    tables: tuple[TermTable, ...], columns: tuple[tuple[Column, ...], ...], intervals: tuple[Interval, ...]
) -> Motions:
    """Return the motions of visits, which are the same for all poses of a model."""
    nothing: _Superposed = [], np.zeros((1, 0, 6))
    pairs = zip(tables, columns, strict=True)
    return join_motions([_convert_displacements([table], [*own], intervals, nothing)[0][1] for table, own in pairs])


def join_motions(parts: Sequence[Motions]) -> Motions:
    """Return the motions of several poses, concatenated, as for :func:`precision_pin.kernel.loops.run_poses`."""
    targets = max((len(part.arms) for part in parts), default=0)

    def starts(name: str, rows: str) -> NDArray[np.uint64]:
        before = np.cumsum([0, *(getattr(part, rows).size for part in parts[:-1])]).astype(np.uint64)
        # poses with fewer targets get targets without entries, which displace nothing
        own = [np.pad(getattr(part, name), (0, 2 * (targets - len(part.arms))), mode="edge") for part in parts]
        return freeze_offsets(np.array(own, dtype=np.uint64).reshape(len(parts), -1) + before[:, None])

    arms = [np.pad(part.arms, ((0, targets - len(part.arms)), (0, 0))) for part in parts]
    series = [np.insert(part.series, len(part.arms), [FINE] * (targets - len(part.arms))) for part in parts]
    all_series = np.array(series, dtype=np.int64).reshape(len(parts), -1)
    all_series.flags.writeable = False
    return Motions(
        **join_entries(parts),
        shift_starts=starts("shift_starts", "shift_rows"),
        turn_starts=starts("turn_starts", "turn_rows"),
        arms=freeze(arms, len(parts), targets, 3),
        series=all_series,
    )


def join_entries(parts: Sequence[Superposition] | Sequence[Motions]) -> dict[str, NDArray[Any]]:
    """Return the entries of several poses, concatenated."""
    shifts, turns = (
        np.concatenate([np.zeros((0, 3)), *(getattr(part, n) for part in parts)]) for n in ("shifts", "turns")
    )
    return {
        "shift_rows": freeze_offsets([row for part in parts for row in part.shift_rows.tolist()]),
        "shifts": freeze(shifts, *shifts.shape),
        "turn_rows": freeze_offsets([row for part in parts for row in part.turn_rows.tolist()]),
        "turns": freeze(turns, *turns.shape),
    }


@dataclass(frozen=True, eq=False)
class _Displacements:
    """Terms of tables in base axes.

    Attributes:
        arms: From each pivot to the tip, ``(P, K, 3)``.
        shifted, turned: Shift and rotation at the target, per unit of each term's product, ``(P, T, 3)``.
        carried: Shift of the tip, for the undisplaced chain.
    """

    arms: Array
    shifted: Array
    turned: Array
    carried: Array

    @classmethod
    def of(cls, tables: Sequence[TermTable]) -> _Displacements:
        """Return the terms of tables with the same targets."""
        # sums and products are elementwise, because the bits of a matrix product depend on its size
        parts = ("pose", "frames", "twists")
        poses, frames, twists = (np.stack([getattr(table, part) for table in tables]) for part in parts)
        target = tables[0].target
        turned = _rotate(frames[:, target, :3, :3], twists[:, :, 3:])
        shifted = _rotate(frames[:, target, :3, :3], twists[:, :, :3])
        arms = poses[:, None, :3, 3] - frames[:, :, :3, 3]
        lever = -arms[:, target]
        carried = shifted + np.stack(
            [
                lever[..., (k + 1) % 3] * turned[..., (k + 2) % 3] - lever[..., (k + 2) % 3] * turned[..., (k + 1) % 3]
                for k in range(3)
            ],
            axis=-1,
        )
        return cls(arms, shifted, turned, carried)


def _convert_displacements(
    tables: Sequence[TermTable], columns: list[Column], intervals: Sequence[Interval], added: _Superposed
) -> list[tuple[Superposition, Motions, float]]:
    """Return, for each table, the arrays of both models and the bound on the sum of the targets' rotation angles."""
    count, target = len(tables[0].targets), tables[0].target
    terms_in_base = _Displacements.of(tables)
    arms, shifted, rotated = terms_in_base.arms, terms_in_base.shifted, terms_in_base.turned
    all_columns, all_carried, all_turned = columns, terms_in_base.carried, rotated
    if added[0]:
        all_columns = columns + added[0]
        all_carried = np.concatenate([all_carried, added[1][..., :3]], axis=1)
        all_turned = np.concatenate([rotated, added[1][..., 3:]], axis=1)
    sums = [_Sum.of(all_columns, vectors, range(len(all_columns))) for vectors in (all_carried, all_turned)]
    angles = np.zeros((len(tables), count))
    # from tip to base, the order in which the loops compose them
    for place, k in enumerate(reversed(range(count))):
        terms = np.flatnonzero(target == k).tolist()
        shift, turn = _Sum.of(columns, shifted, terms), _Sum.of(columns, rotated, terms)
        angles[:, place] = _largest_turns(turn, intervals)
        # the loops use half the rotation vector; halving is exact
        sums += [shift, _Sum(turn.columns, turn.vectors / 2)]
    # target by target: the order in which np.sum adds depends on the number of terms
    total = np.zeros(len(tables))
    for column in angles.T:
        total = total + column
    angle_bounds = np.concatenate([angles, total[:, None]], axis=1)
    series = np.where(angle_bounds <= _FINE_UP_TO, FINE, np.where(angle_bounds <= _NARROW_UP_TO, NARROW, WIDE))
    # only nonzero entries are stored; they are nearly always the same at all poses
    is_used = np.concatenate([part.vectors.any(axis=-1) for part in sums], axis=1)
    patterns, numbers = np.unique(is_used, axis=0, return_inverse=True)
    entries: dict[int, tuple[Superposition, Motions, float]] = {}
    for number, pattern in enumerate(patterns):
        alike = np.flatnonzero(numbers.reshape(-1) == number)
        motion_pairs = _assemble(sums, pattern, alike, arms[alike][:, ::-1], series[alike])
        entries |= {pose: (*pair, float(total[pose])) for pose, pair in zip(alike.tolist(), motion_pairs, strict=True)}
    return [entries[pose] for pose in range(len(tables))]


@dataclass(frozen=True, eq=False)
class _Sum:
    """Sum of ``vector × column``: the columns, and their vectors at every pose, ``(P, columns, 3)``."""

    columns: list[Column]
    vectors: Array

    @classmethod
    def of(cls, columns: Sequence[Column], vectors: Array, terms: Iterable[int]) -> _Sum:
        """Return the sum of terms with vectors ``(P, T, 3)``; vectors of the same column are added."""
        sums: dict[Column, Array] = {}
        for term in terms:
            column = columns[term]
            sums[column] = sums[column] + vectors[:, term] if column in sums else vectors[:, term]
        stacked = np.stack([_drop_rounding(vector) for vector in sums.values()], axis=1) if sums else vectors[:, :0]
        return cls(list(sums), stacked)

    def entries(self, mask: NDArray[np.bool_], poses: NDArray[np.intp], *, minimum: int = 0, pad: int = 0) -> _Entries:
        """Return the entries at some poses, with at least `minimum` entries of single rows."""
        indices = np.flatnonzero(mask).tolist()
        single = [k for k in indices if len(self.columns[k]) == 1]
        double = [k for k in indices if len(self.columns[k]) == 2]
        rows = [self.columns[k][0] for k in single]
        remaining = max(len(rows) - minimum, 0)
        # the loops process six, five, four or three entries at once, never one or two
        size = minimum + remaining + {1: 2, 2: 1}.get(remaining % 6, 0)
        # padding entries have a zero vector; their row only needs finite values
        rows += ([self.columns[k][0] for k in indices[:1]] or [pad]) * (size - len(rows))
        # three products in one pass; padding products have a zero vector as well
        sets = -(-len(double) // 3)
        factors = [row for k in double for row in self.columns[k]]
        factors += factors[:1] * (6 * sets - len(factors))
        pose_vectors, vectors = self.vectors[poses], np.zeros((len(poses), size + 6 * sets, 3))
        vectors[:, : len(single)] = pose_vectors[:, single]
        vectors[:, [size + 6 * (k // 3) + k % 3 for k in range(len(double))]] = pose_vectors[:, double]
        return _Entries(rows + factors, vectors, (size, len(factors)))


@dataclass(frozen=True, eq=False)
class _Entries:
    """Entries of a sum in the format of `precision_pin.kernel.loops.Motions`: rows, vectors, counts of single and double rows."""

    rows: list[int]
    vectors: Array
    sizes: tuple[int, int]


def _rotate(rotation: Array, vector: Array) -> Array:
    parts = rotation * vector[..., None, :]
    return parts[..., 0] + parts[..., 1] + parts[..., 2]


def _drop_rounding(vector: Array) -> Array:
    """Return vectors ``(P, 3)`` with components that are rounding errors set to zero."""
    return np.where(np.abs(vector) > _NEGLIGIBLE * np.abs(vector).max(axis=-1, keepdims=True), vector, 0.0)


def _largest_turns(turn: _Sum, intervals: Sequence[Interval]) -> Array:
    """Return the bound on a target's rotation angle at each pose, ``(P,)``, rad; infinite if unknown."""
    bounds_ = np.zeros((len(turn.vectors), 3))
    with np.errstate(invalid="ignore", over="ignore"):
        for k, column in enumerate(turn.columns):
            vector = np.abs(turn.vectors[:, k])
            # zero vectors are skipped, because zero times an infinite end is NaN
            interval: Interval = reduce(_product_interval, (intervals[row] for row in column))
            furthest = max(map(abs, interval))
            bounds_ = bounds_ + np.where(vector.any(axis=-1, keepdims=True), vector * furthest, 0.0)
        bound = np.sqrt(bounds_[:, 0] * bounds_[:, 0] + bounds_[:, 1] * bounds_[:, 1] + bounds_[:, 2] * bounds_[:, 2])
    return np.nan_to_num(bound, nan=math.inf, posinf=math.inf)


def _assemble(
    sums: Sequence[_Sum], mask: NDArray[np.bool_], poses: NDArray[np.intp], arms: Array, series: NDArray[np.int64]
) -> Iterable[tuple[Superposition, Motions]]:
    """Yield the arrays of both models at the poses with the same nonzero entries."""
    ends = np.cumsum([0, *(len(part.columns) for part in sums)]).tolist()
    of_part = [mask[begin:end] for begin, end in pairwise(ends)]
    entry_list = [part.entries(part_mask, poses) for part, part_mask in zip(sums[:2], of_part[:2], strict=True)]
    for shift, turn, shift_mask, turn_mask in zip(sums[2::2], sums[3::2], of_part[2::2], of_part[3::2], strict=True):
        # one loop of the sampler processes three entries of a shift together with the target's turn
        minimum = 3 if turn_mask.any() else 0
        turns = turn.entries(turn_mask, poses, minimum=minimum)
        entry_list += [shift.entries(shift_mask, poses, minimum=minimum, pad=turns.rows[0] if minimum else 0), turns]
    # the superposition's shifts and turns, then those of the targets, from tip to base
    parts = [entry_list[0:1], entry_list[1:2], entry_list[2::2], entry_list[3::2]]
    row_offsets = [offsets([row for entries in part for row in entries.rows]) for part in parts]
    vectors = [
        freeze(stacked, *stacked.shape)
        for part in parts
        for stacked in [np.concatenate([np.zeros((len(poses), 0, 3)), *(entries.vectors for entries in part)], axis=1)]
    ]
    starts = [np.cumsum([0, *(size for entries in part for size in entries.sizes)]) for part in parts]
    superposed, shift_starts, turn_starts = map(freeze_offsets, (np.stack(starts[:2], axis=1), *starts[2:]))
    all_arms, all_series = freeze(arms, *arms.shape), np.array(series, dtype=np.int64)
    all_series.flags.writeable = False
    for k in range(len(poses)):
        # views of the arrays of all poses, read-only like them
        yield (
            Superposition(row_offsets[0], vectors[0][k], row_offsets[1], vectors[1][k], superposed),
            Motions(
                shift_starts,
                row_offsets[2],
                vectors[2][k],
                turn_starts,
                row_offsets[3],
                vectors[3][k],
                all_arms[k],
                all_series[k],
            ),
        )
