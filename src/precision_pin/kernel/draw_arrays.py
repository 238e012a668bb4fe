"""Conversion of the draws of a space to the arrays that the compiled loops read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.laws import Law
from precision_pin.draws.laws.law import Branch, KernelRow
from precision_pin.draws.space import Space
from precision_pin.kernel.loops import STRIDE, Draws, Wanted

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
_SINGLE: Final[tuple[Branch, ...]] = ("disc", "circle")
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
    """Return True for a space with rare laws, whose loops are compiled on demand, otherwise None."""
    rows = (draw.law.kernel_row() for draw in space.draws)
    common = not space.correlations and all(row is not None and row.branch in COMMON for row in rows)
    return None if common else True


def convert_draws(space: Space, constants: Mapping[float, int]) -> Draws:
    """Return the arrays of a space's draws, with a row for each component, in order, and for each constant.

    Parameters
    ----------
    space
        The draws.
    constants
        Rows of constants, keyed by their values.
    """
    placed = list(zip((draw.law for draw in space.draws), space.slices, strict=True))
    streamed = [columns.start + k for law, columns in placed for k in law.streamed]
    by_branch: dict[Branch, dict[int, Array]] = {branch: {} for branch in get_args(Branch)}
    for law, columns in placed:
        row = _kernel_row(law)
        by_branch[row.branch][columns.start] = row.numbers
    from_normals = {k for law, rows in placed if law.variates == "normal" for k in range(rows.start, rows.stop)}
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
    """Return square matrices as one array, padded with zeros to the size of the largest."""
    largest = max(map(len, matrices), default=1)
    padded = np.zeros((len(matrices), largest, largest))
    for k, matrix in enumerate(matrices):
        padded[k, : len(matrix), : len(matrix)] = matrix
    return freeze(padded, *padded.shape)


def _stack_rows(parts: Sequence[Array], columns: int) -> tuple[Array, NDArray[np.uint64]]:
    """Return matrices stacked vertically, and the first row of each, followed by the total number of rows."""
    stacked = np.concatenate([np.zeros((0, columns)), *parts])
    return freeze(stacked, *stacked.shape), freeze_offsets(np.cumsum([0, *map(len, parts)]))


def intervals(space: Space) -> list[Interval]:
    """Return the bounds of each component, drawn with uniform numbers of 53 bits.

    Raises
    ------
    InputError
        The compiled sampler does not support a law.
    """
    found: list[Interval] = []
    for draw in space.draws:
        known = _kernel_row(draw.law).intervals
        found += known or [draw.law.interval(k) for k in range(draw.law.size)]
    return found
