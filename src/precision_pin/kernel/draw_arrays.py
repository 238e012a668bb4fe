"""Turning the draws of a space into the arrays that the compiled loops read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.draws import lazy_special
from precision_pin.draws.laws import (
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
from precision_pin.draws.space import Space
from precision_pin.errors import InputError
from precision_pin.kernel.loops import STRIDE, Draws, Wanted

__all__ = [
    "COMMON_LAWS",
    "Interval",
    "drawn",
    "frozen",
    "frozen_offsets",
    "intervals",
    "lay_out_draws",
    "offset",
    "offsets",
    "rare_laws",
]

COMMON_LAWS: Final = (Fixed, Uniform, Triangular, Normal, TruncatedNormal)
"""Laws whose loops are always compiled; those of others, and of correlation, where they are wanted."""

Array = NDArray[np.float64]
Interval = tuple[float, float]


def offset(row: int) -> int:
    """Return the offset of a workspace's row."""
    return row * STRIDE


def offsets(rows: Sequence[int]) -> NDArray[np.uint64]:
    """Return the offsets of rows, frozen."""
    return frozen_offsets([offset(row) for row in rows])


def frozen_offsets(values: ArrayLike) -> NDArray[np.uint64]:
    """Return whole numbers as an array that cannot be written: numba takes others for another type."""
    array = np.ascontiguousarray(values, dtype=np.uint64)
    array.flags.writeable = False
    return array


def frozen(values: ArrayLike, *shape: int) -> Array:
    """Return numbers, flat or of a shape, as an array that cannot be written."""
    array = np.array(values, dtype=float).reshape(shape or -1)
    array.flags.writeable = False
    return array


def rare_laws(space: Space) -> Wanted:
    """Return whether a space needs loops that are compiled where they are wanted only."""
    common = all(isinstance(draw.law, COMMON_LAWS) for draw in space.draws) and not space.correlations
    return None if common else True


def drawn(law: Law, columns: slice) -> range:
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


def lay_out_draws(space: Space, constants: Mapping[float, int]) -> Draws:
    """Return the arrays of a space's draws; a row for each component, in order, and those of constants.

    Parameters
    ----------
    space
        The draws.
    constants
        Rows that hold one number throughout, by the number.
    """
    placed = list(zip((draw.law for draw in space.draws), space.slices, strict=True))
    streamed = [component for law, columns in placed for component in drawn(law, columns)]

    def of(kind: type[Law]) -> NDArray[np.uint64]:
        return offsets([columns.start for law, columns in placed if isinstance(law, kind)])

    fixed = {columns.start: law.mean for law, columns in placed if isinstance(law, Fixed)}
    fixed |= {row: value for value, row in constants.items()}
    roots, sizes = _lay_out_joint([law for law, _ in placed if isinstance(law, JointNormal)])
    groups = [[space.index[correlation.names[k]] for k in correlation.order] for correlation in space.correlations]
    mixed = {component for group in groups for component in group}
    logarithms = {columns.start for law, columns in placed if isinstance(law, Lognormal)}
    normal = {columns.start: law for law, columns in placed if isinstance(law, Normal)}
    jointly = {
        row for law, columns in placed if isinstance(law, JointNormal) for row in range(columns.start, columns.stop)
    }
    normals = {row: (law.mean, -2 * law.std * law.std) for row, law in normal.items() if row not in mixed}
    normals |= dict.fromkeys(sorted(logarithms | mixed | jointly), (0.0, -2.0))
    scaled = {row: law for row, law in normal.items() if row in mixed}
    lines, line_starts = _stacked([law.segments for law, _ in placed if isinstance(law, Empirical)], 4)
    tables = [law for law, _ in placed if isinstance(law, Rows)]
    numbers, number_starts = _stacked([law.array.reshape(-1, 1) for law in tables], 1)
    shapes = [(law.size, len(law.table), start) for law, start in zip(tables, number_starts[:-1], strict=True)]
    return Draws(
        fixed_rows=offsets(list(fixed)),
        fixed_values=frozen(list(fixed.values())),
        stream_rows=offsets(streamed),
        streams=frozen_offsets([space.streams[component] for component in streamed]),
        normal_rows=offsets(list(normals)),
        normal=frozen(list(normals.values()), -1, 2),
        group_starts=frozen_offsets(np.cumsum([0, *map(len, groups)])),
        group_rows=offsets([component for group in groups for component in group]),
        group_roots=_padded([correlation.root for correlation in space.correlations]),
        cumulated_rows=offsets(sorted(mixed - logarithms - normal.keys())),
        uniform_rows=of(Uniform),
        uniform=frozen([(law.mean, law.half_width) for law, _ in placed if isinstance(law, Uniform)], -1, 2),
        triangular_rows=of(Triangular),
        triangular=frozen([(law.mean, law.half_width) for law, _ in placed if isinstance(law, Triangular)], -1, 2),
        scaled_rows=offsets(list(scaled)),
        scaled=frozen([(law.mean, law.std) for law in scaled.values()], -1, 2),
        truncated_rows=of(TruncatedNormal),
        truncated=frozen(
            [
                (law.mean, law.std, law.k, lazy_special.ndtr(-law.k), math.erf(law.k / math.sqrt(2)))
                for law, _ in placed
                if isinstance(law, TruncatedNormal)
            ],
            -1,
            5,
        ),
        disc_rows=of(Disc),
        disc=frozen([law.radius for law, _ in placed if isinstance(law, Disc)]),
        circle_rows=of(Circle),
        circle=frozen([law.radius for law, _ in placed if isinstance(law, Circle)]),
        joint_rows=of(JointNormal),
        joint_roots=roots,
        joint_sizes=sizes,
        lognormal_rows=of(Lognormal),
        lognormal=frozen(
            [(law.mean, law.log_std, law.log_std**2 / 2) for law, _ in placed if isinstance(law, Lognormal)], -1, 3
        ),
        arcsine_rows=of(Arcsine),
        arcsine=frozen([(law.mean, law.half_width) for law, _ in placed if isinstance(law, Arcsine)], -1, 2),
        two_point_rows=of(TwoPoint),
        two_point=frozen(
            [(law.centre, law.half_width, law.threshold) for law, _ in placed if isinstance(law, TwoPoint)], -1, 3
        ),
        empirical_rows=of(Empirical),
        empirical_starts=line_starts,
        empirical=lines,
        table_rows=of(Rows),
        table_shapes=frozen_offsets(np.array(shapes, dtype=np.uint64).reshape(-1, 3)),
        table=frozen(numbers),
    )


def _lay_out_joint(laws: Sequence[JointNormal]) -> tuple[Array, NDArray[np.uint64]]:
    largest = max((law.size for law in laws), default=1)
    roots = np.zeros((len(laws), largest + 1, largest))
    for k, law in enumerate(laws):
        roots[k, 0, : law.size] = law.mean_vector
        roots[k, 1 : law.size + 1, : law.size] = law.root
    return frozen(roots, *roots.shape), frozen_offsets([law.size for law in laws])


def _padded(matrices: Sequence[Array]) -> Array:
    """Return square matrices as one array, padded to the largest by zeros."""
    largest = max(map(len, matrices), default=1)
    padded = np.zeros((len(matrices), largest, largest))
    for k, matrix in enumerate(matrices):
        padded[k, : len(matrix), : len(matrix)] = matrix
    return frozen(padded, *padded.shape)


def _stacked(parts: Sequence[Array], columns: int) -> tuple[Array, NDArray[np.uint64]]:
    """Return matrices on top of one another, and at which row each begins, with the end of the last."""
    stacked = np.concatenate([np.zeros((0, columns)), *parts])
    return frozen(stacked, *stacked.shape), frozen_offsets(np.cumsum([0, *map(len, parts)]))


def intervals(space: Space) -> list[Interval]:
    """Return what each component stays between, drawn with uniform numbers of 53 bits.

    Raises
    ------
    InputError
        The compiled sampler does not know a law.
    """
    return [interval for draw in space.draws for interval in _law_intervals(draw.law)]


def _law_intervals(law: Law) -> list[Interval]:
    match law:
        case JointNormal():
            reaches = np.abs(law.root).sum(axis=1) * FARTHEST_NORMAL
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
            return [law.interval(k) for k in range(law.size)]
        case _:
            raise InputError(f"the compiled sampler does not know the law {type(law).__name__}")
