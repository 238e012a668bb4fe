"""Compiled sampler for many poses of one arm, with the draws of unit scope shared by all poses.

A unit's draws of unit scope are the same at every pose; those of pose and visit scope are drawn at each pose. The cost of
the shared draws does not grow with the number of poses.

`observe_poses` returns the statistics of :func:`precision_pin.kernel.sampler.observe_blocks` at each pose, with the same
bits. `observe_norms` keeps only the statistics for a map, in 4 kB per pose instead of 656: the moments of all six
components, counts inside specifications, and a small sketch of |d| and |δ|.

The small sketch is that of :mod:`precision_pin.statistics.sketch` with 32 bins per octave, from 1/16 to 16 of the planned
spread on each side of the planned mean (`norm_edges`). With v the distance from the mean in units of the spread, the bin
that contains v is at most ``max(1/16, |v|/32)`` wide up to 16. The outermost bins are open and end at the smallest and
largest value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.jit import call
from precision_pin.draws.space import check_seed
from precision_pin.kernel import loops
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.kernel.blocks import BLOCK, Blocks, check_blocks
from precision_pin.kernel.loops import (
    HELD,
    LANE_DOUBLES,
    LINEAR,
    NORM_COLUMNS,
    NORM_EXPONENTS,
    NORM_MANTISSA,
    SUMS,
    Wanted,
)
from precision_pin.kernel.part_list import compile_parts
from precision_pin.kernel.parts import empty_table
from precision_pin.kernel.pose_arrays import JoinedTables
from precision_pin.kernel.sampler import REASONS, Model, allocate_rows, allocate_scratch, stage_of
from precision_pin.statistics import COLUMNS, LARGEST, NORMS, Plan

MOST_TOGETHER: Final = 64
"""Best number of poses to process together: the cost of drawing is then negligible, and the sums stay in the cache."""


@final
@dataclass(frozen=True, eq=False)
class NormBlocks:
    """Sums and small sketches of consecutive blocks at P poses, for a map.

    Attributes
    ----------
    count
        Number of samples at each pose.
    lowest, highest
        ``(P, 2)`` smallest and largest |d| and |δ|.
    sums
        ``(P, blocks, 31)`` with the same bits as in :class:`precision_pin.kernel.Blocks`.
    sketch
        ``(P, 2, 514)`` counts of |d| and |δ| between `norm_edges`.
    inside
        ``(P, S)`` samples inside each specification.
    """

    count: int
    lowest: Array
    highest: Array
    sums: Array
    sketch: NDArray[np.uint32]
    inside: NDArray[np.int64]


def norm_edges() -> Array:
    """Return the 515 ascending edges of the small sketch, in units of the planned spread from the planned mean."""
    first, last = ((1023 + exponent) << NORM_MANTISSA for exponent in NORM_EXPONENTS)
    magnitude = (np.arange(first, last + 1, dtype=np.int64) << (52 - NORM_MANTISSA)).view(np.float64)
    edges = np.concatenate(([0.0], magnitude[:-1], [np.inf]))
    result: Array = np.concatenate((-edges[::-1], edges[1:]))
    return result


def observe_poses(
    tables: Sequence[SamplerArrays] | JoinedTables,
    plans: Sequence[Plan],
    model: Model,
    seed: int,
    first_block: int,
    blocks: int,
    *,
    samples: int | None = None,
    first_pose: int = 0,
    visit: int = 0,
) -> list[Blocks]:
    """Return the statistics of blocks at P poses, as :func:`precision_pin.kernel.sampler.observe_blocks` at each.

    Parameters
    ----------
    tables
        Arrays of one model at the poses.
    plans
        A plan for each pose, all with the same specifications.
    model, seed, first_block, blocks, samples, visit
        As in :func:`precision_pin.kernel.sampler.observe_blocks`.
    first_pose
        Number of the first pose, for draws of pose and visit scope; the others follow.

    Raises
    ------
    InputError
        There are no poses, or a different number of plans; the poses are of different models; the plans have different
        specifications; or as in :func:`precision_pin.kernel.sampler.observe_blocks`, with the number of the pose.
    """
    units = _Units(seed, *check_blocks(first_block, blocks, samples), first_pose, visit)
    counts = _run(tables, plans, model, units, 8 * COLUMNS, LARGEST, tiles=HELD)
    return [
        Blocks(
            count=units.count,
            lowest=counts.lowest[pose],
            highest=counts.highest[pose],
            sums=counts.sums[pose],
            sketch=counts.sketch[pose].reshape(8, COLUMNS),
            inside=counts.inside[pose],
            largest=counts.largest[pose],
            largest_units=counts.largest_units[pose],
            errors=None,
        )
        for pose in range(len(plans))
    ]


def observe_norms(
    tables: Sequence[SamplerArrays] | JoinedTables,
    plans: Sequence[Plan],
    model: Model,
    seed: int,
    first_block: int,
    blocks: int,
    *,
    samples: int | None = None,
    first_pose: int = 0,
    visit: int = 0,
) -> NormBlocks:
    """Return the sums and small sketches of blocks at P poses; release Python's global lock.

    Parameters and errors as in `observe_poses`. Only the scales of the norms are used.
    """
    units = _Units(seed, *check_blocks(first_block, blocks, samples), first_pose, visit)
    counts = _run(tables, plans, model, units, 2 * NORM_COLUMNS, 0, tiles=1)
    return NormBlocks(
        count=units.count,
        lowest=counts.lowest[:, NORMS],
        highest=counts.highest[:, NORMS],
        sums=counts.sums,
        sketch=counts.sketch.reshape(-1, 2, NORM_COLUMNS),
        inside=counts.inside,
    )


def warm_up(rare: Wanted = None, linear: Wanted = None) -> None:
    """Compile a variant of the loops over poses, or load it from numba's cache; the first sampling does so by itself."""
    plan = Plan(np.zeros(8), np.ones(8), ())
    observe_norms([empty_table(rare)], [plan], "linear" if linear else "exact", 0, 0, 1, samples=1)


# private -------------------------------------------------------------------------------------------------------------


@final
@dataclass(frozen=True)
class _Units:
    """Range of units, with the first pose and the visit."""

    seed: int
    first: int
    count: int
    first_pose: int
    visit: int


@final
@dataclass(frozen=True, eq=False)
class _Counts:
    """Arrays that the loops fill; the first axis of each is the pose."""

    sums: Array
    lowest: Array
    highest: Array
    sketch: NDArray[np.uint32]
    inside: NDArray[np.int64]
    largest: Array
    largest_units: NDArray[np.int64]


def _run(
    tables: Sequence[SamplerArrays] | JoinedTables,
    plans: Sequence[Plan],
    model: Model,
    units: _Units,
    columns: int,
    largest: int,
    *,
    tiles: int,
) -> _Counts:
    """Run the compiled loops over the poses; raise an error where they stop.

    With `largest` 0 the small sketches of the norms are filled, and no largest errors are kept.
    """
    check_seed(units.seed)
    linear: Wanted = True if stage_of(model) == LINEAR else None
    joined = tables if isinstance(tables, JoinedTables) else JoinedTables.of(tables)
    poses = len(joined.layouts)
    if len(plans) != poses:
        raise InputError(f"{poses} poses and {len(plans)} plans; give one plan for each pose")
    specifications = plans[0].specifications
    if any(plan.specifications != specifications for plan in plans):
        raise InputError("the plans of poses that are sampled together have different specifications")
    counts = _Counts(
        sums=np.zeros((poses, -(-units.count // BLOCK), SUMS)),
        lowest=np.full((poses, 8), np.inf),
        highest=np.full((poses, 8), -np.inf),
        sketch=np.zeros((poses, columns), dtype=np.uint32),
        inside=np.zeros((poses, len(specifications)), dtype=np.int64),
        largest=np.full((poses, 2, largest), -np.inf),
        largest_units=np.full((poses, 2, largest), -1),
    )
    rows, variant = joined.layouts[0].rows, (joined.layouts[0].rare, linear)
    arguments = (
        *allocate_scratch(),
        allocate_rows(rows * tiles).reshape(tiles, -1),
        np.empty((poses, LANE_DOUBLES)),
        joined.unit_draws,
        joined.draws,
        joined.unit_formulas,
        joined.formulas,
        joined.superposition,
        joined.motions,
        *variant,
        np.uint64(units.seed),
        np.zeros(joined.unit_draws.streams.size, dtype=np.uint64),
        joined.words(units.first_pose, units.visit),
        np.uint64(units.first),
        int(units.count),
        np.array([plan.centre for plan in plans]),
        np.array([1 / plan.scale for plan in plans]),
        np.array([specification.row for specification in specifications], dtype=np.uint64),
        np.array([specification.limit for specification in specifications], dtype=float),
        largest == 0,
        counts.sums,
        counts.lowest,
        counts.highest,
        counts.sketch,
        counts.inside,
        counts.largest,
        counts.largest_units,
    )
    ahead = partial(compile_parts, *variant, __name__)
    reason, pose, where = map(int, call(loops.run_poses, arguments, variant, ahead))
    if reason:
        raise InputError(f"pose {units.first_pose + pose}, sample {units.first + where}: {REASONS[reason]}")
    return counts
