"""Compiled sampler for many poses of one arm, with the draws of unit scope shared by all poses.

A unit's draws of unit scope are made once, at a cost that does not grow with the number of poses; those of pose and
visit scope at each pose. `observe_norms` keeps only the statistics for a map, in 4 kB per pose instead of 656: the
moments of all six components, counts inside specifications, and a small sketch of |d| and |δ|.

The small sketch is that of :mod:`precision_pin.statistics.accumulate` with 32 bins per octave, from 1/16 to 16 of the
planned spread on each side of the planned mean (`norm_edges`). With v the distance from the mean in spreads, the bin of
v is at most ``max(1/16, |v|/32)`` wide up to 16. The outermost bins end at the smallest and largest value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.jit import call
from precision_pin.draws.draw import Scope, occasion
from precision_pin.draws.space import check_seed
from precision_pin.kernel import loops
from precision_pin.kernel.arrays import BESIDE, SamplerArrays, empty_table
from precision_pin.kernel.parts import compile_parts
from precision_pin.kernel.sampler import BLOCK, REASONS, Model, allocate_rows, allocate_scratch, check_blocks, stage_of
from precision_pin.statistics import NORMS, Plan


@final
@dataclass(frozen=True, eq=False)
class JoinedTables:
    """Arrays of one error model at P poses, with the common draws and formulas separated.

    Attributes:
        unit_draws, unit_formulas: Draws and formulas evaluated once for all poses.
        draws, formulas: Draws and formulas evaluated at each pose.
        scopes: Scope of each stream of ``draws``.
        superposition, motions: Concatenated arrays of all poses, as for :func:`precision_pin.kernel.loops.run_poses`.
    """

    layouts: tuple[SamplerArrays, ...]
    unit_draws: loops.Draws
    unit_formulas: loops.Formulas
    draws: loops.Draws
    formulas: loops.Formulas
    scopes: tuple[Scope, ...]
    superposition: loops.Superposition
    motions: loops.Motions

    @classmethod
    def of(cls, layouts: Sequence[SamplerArrays]) -> JoinedTables:
        """Join the arrays of one model at several poses; fastest if one call of ``to_arrays_at_poses`` made them."""
        if not layouts:
            raise InputError("no poses to sample; give at least one")
        first = layouts[0]
        if not all(is_alike(first, other) for other in layouts[1:]):
            raise InputError(
                "poses that are sampled together must be of one model, with the same draws, targets and formulas"
            )
        varying = _find_varying(first)
        unit_formulas, formulas = _split_formulas(first.formulas, varying)
        return cls(
            layouts=tuple(layouts),
            unit_draws=_select_draws(first.draws, np.setdiff1d(_all_rows(first.draws), varying)),
            unit_formulas=unit_formulas,
            draws=_select_draws(first.draws, varying),
            formulas=formulas,
            scopes=tuple(scope for scope in first.scopes if scope is not Scope.UNIT),
            superposition=_join_superpositions(layouts),
            motions=_join_motions(layouts),
        )

    def words(self, first_pose: int, visit: int) -> loops.Offsets:
        """Return the last counter word of every stream of ``draws`` at every pose, ``(P, streams)``."""
        poses = range(first_pose, first_pose + len(self.layouts))
        occasions = {scope: [occasion(scope, pose, visit) for pose in poses] for scope in dict.fromkeys(self.scopes)}
        columns = [np.zeros((len(poses), 0))] + [np.array(occasions[scope])[:, None] for scope in self.scopes]
        return np.concatenate(columns, axis=1).astype(np.uint64)


def is_alike(one: SamplerArrays, other: SamplerArrays) -> bool:
    """Return whether the arrays of two poses have the same draws and formulas in the same rows."""
    if one.draws is other.draws and one.formulas is other.formulas:
        return True
    pairs = [*zip(one.draws, other.draws, strict=True), *zip(one.formulas, other.formulas, strict=True)]
    return (
        one.rows == other.rows
        and one.targets == other.targets
        and one.space.draws == other.space.draws
        and all(np.array_equal(a, b) for a, b in pairs)
    )


# draws and formulas by scope -----------------------------------------------------------------------------------------


def _find_varying(layout: SamplerArrays) -> loops.Offsets:
    """Return the rows that differ between poses: draws of pose and visit scope, and results computed from them."""
    space = layout.space
    found = {
        component * loops.STRIDE
        for draw, columns in zip(space.draws, space.slices, strict=True)
        if draw.scope is not Scope.UNIT
        for component in range(columns.start, columns.stop)
    } - set(layout.draws.fixed_rows.tolist())
    formulas = layout.formulas
    steps = [
        *zip(formulas.left.tolist(), formulas.right.tolist(), formulas.results.tolist(), strict=True),
        *(
            (*factors, result)
            for factors, result in zip(formulas.product_factors.tolist(), formulas.products.tolist(), strict=True)
        ),
    ]
    for left, right, result in steps:
        if left in found or right in found:
            found.add(result)
    return np.array(sorted(found), dtype=np.uint64)


def _all_rows(draws: loops.Draws) -> loops.Offsets:
    rows = [getattr(draws, name) for name in draws._fields if name.endswith("_rows")]
    return np.unique(np.concatenate(rows))


def _select_draws(draws: loops.Draws, rows: loops.Offsets) -> loops.Draws:
    kept = {name: np.isin(getattr(draws, name), rows) for name in BESIDE}
    chosen = {field: getattr(draws, field)[kept[name]] for name in BESIDE for field in (name, *BESIDE[name])}
    groups = [
        k for k, (begin, _) in enumerate(pairwise(draws.group_starts.tolist())) if draws.group_rows[begin] in rows
    ]
    laws = [k for k, row in enumerate(draws.empirical_rows) if row in rows]
    group_starts, group_rows = _select_runs(draws.group_starts, draws.group_rows, groups)
    line_starts, lines = _select_runs(draws.empirical_starts, draws.empirical, laws)
    parts = {
        **draws._asdict(),
        **chosen,
        "group_starts": group_starts,
        "group_rows": group_rows,
        "group_roots": draws.group_roots[groups],
        "empirical_starts": line_starts,
        "empirical": lines,
    }
    return loops.Draws(**{name: _freeze_copy(part) for name, part in parts.items()})


def _select_runs(
    starts: loops.Offsets, values: NDArray[Any], chosen: Sequence[int]
) -> tuple[loops.Offsets, NDArray[Any]]:
    """Return starts and values of the chosen runs ``values[starts[k] … starts[k + 1]]``."""
    runs = [values[int(starts[k]) : int(starts[k + 1])] for k in chosen]
    return np.cumsum([0, *map(len, runs)]).astype(np.uint64), np.concatenate([values[:0], *runs])


def _split_formulas(formulas: loops.Formulas, varying: loops.Offsets) -> tuple[loops.Formulas, loops.Formulas]:
    """Return the formulas with the same results at every pose, and the others."""
    steps, products = np.isin(formulas.results, varying), np.isin(formulas.products, varying)

    def part(of_steps: NDArray[np.bool_], of_products: NDArray[np.bool_]) -> loops.Formulas:
        fields = formulas._asdict().items()
        chosen = (values[of_products if name.startswith("product") else of_steps] for name, values in fields)
        return loops.Formulas(*map(_freeze_copy, chosen))

    return part(~steps, ~products), part(steps, products)


def _freeze_copy(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy of an array: to numba a writeable array is another type."""
    own = np.array(array, order="C")
    own.flags.writeable = False
    return own


# concatenation of poses ----------------------------------------------------------------------------------------------


def _join_entries(parts: Sequence[loops.Superposition | loops.Motions]) -> dict[str, NDArray[Any]]:
    return {
        name: _freeze_copy(np.concatenate([getattr(part, name) for part in parts]))
        for name in ("shift_rows", "shifts", "turn_rows", "turns")
    }


def _join_superpositions(layouts: Sequence[SamplerArrays]) -> loops.Superposition:
    parts = [layout.superposition for layout in layouts]
    before = np.cumsum([(0, 0), *(part.starts[-1] for part in parts)], axis=0).astype(np.uint64)
    starts = [part.starts[:-1] + begin for part, begin in zip(parts, before[:-1], strict=True)]
    return loops.Superposition(**_join_entries(parts), starts=_freeze_copy(np.concatenate([*starts, before[-1:]])))


def _join_motions(layouts: Sequence[SamplerArrays]) -> loops.Motions:
    parts = [layout.motions for layout in layouts]

    def starts(name: str, rows: str) -> loops.Offsets:
        before = np.cumsum([0, *(getattr(part, rows).size for part in parts[:-1])]).astype(np.uint64)
        return np.stack([getattr(part, name) for part in parts]) + before[:, None]

    return loops.Motions(
        **_join_entries(parts),
        shift_starts=_freeze_copy(starts("shift_starts", "shift_rows")),
        turn_starts=_freeze_copy(starts("turn_starts", "turn_rows")),
        arms=_freeze_copy(np.stack([part.arms for part in parts])),
        series=_freeze_copy(np.stack([part.series for part in parts])),
    )


MOST_TOGETHER: Final = 64
"""Poses processed together at best: drawing then costs next to nothing, and the sums stay in the cache."""


@final
@dataclass(frozen=True, eq=False)
class NormBlocks:
    """Sums and small sketches of consecutive blocks at P poses, for a map.

    Attributes:
        lowest, highest: ``(P, 2)`` smallest and largest |d| and |δ|.
        sums: ``(P, blocks, 31)`` with the same bits as in :class:`precision_pin.kernel.sampler.Blocks`.
        sketch: ``(P, 2, 514)`` counts of |d| and |δ| between `norm_edges`.
        inside: ``(P, S)`` samples inside each specification.
    """

    count: int
    lowest: Array
    highest: Array
    sums: Array
    sketch: NDArray[np.uint32]
    inside: NDArray[np.int64]


def norm_edges() -> Array:
    """Return the 515 ascending edges of the small sketch, in units of the planned spread from the planned mean."""
    first, last = ((1023 + exponent) << loops.NORM_MANTISSA for exponent in loops.NORM_EXPONENTS)
    magnitude = (np.arange(first, last + 1, dtype=np.int64) << (52 - loops.NORM_MANTISSA)).view(np.float64)
    edges = np.concatenate(([0.0], magnitude[:-1], [np.inf]))
    return np.concatenate((-edges[::-1], edges[1:]))


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

    Sums and counts have the bits of :func:`precision_pin.kernel.sampler.observe_blocks` at each pose. Only the scales
    of the norms are used.
    """
    first, count = check_blocks(first_block, blocks, samples)
    check_seed(seed)
    linear: loops.Wanted = True if stage_of(model) == loops.LINEAR else None
    joined = tables if isinstance(tables, JoinedTables) else JoinedTables.of(tables)
    poses = len(joined.layouts)
    if len(plans) != poses:
        raise InputError(f"{poses} poses and {len(plans)} plans; give one plan for each pose")
    specifications = plans[0].specifications
    if any(plan.specifications != specifications for plan in plans):
        raise InputError("the plans of poses that are sampled together have different specifications")
    sums = np.zeros((poses, -(-count // BLOCK), loops.SUMS))
    lowest, highest = np.full((poses, 8), np.inf), np.full((poses, 8), -np.inf)
    sketch = np.zeros((poses, 2 * loops.NORM_COLUMNS), dtype=np.uint32)
    inside = np.zeros((poses, len(specifications)), dtype=np.int64)
    variant = (joined.layouts[0].rare, linear)
    arguments = (
        *allocate_scratch(),
        allocate_rows(joined.layouts[0].rows),
        np.empty((poses, loops.LANE_DOUBLES)),
        joined.unit_draws,
        joined.draws,
        joined.unit_formulas,
        joined.formulas,
        joined.superposition,
        joined.motions,
        *variant,
        np.uint64(seed),
        np.zeros(joined.unit_draws.streams.size, dtype=np.uint64),
        joined.words(first_pose, visit),
        np.uint64(first),
        int(count),
        np.array([plan.centre for plan in plans]),
        np.array([1 / plan.scale for plan in plans]),
        np.array([specification.row for specification in specifications], dtype=np.uint64),
        np.array([specification.limit for specification in specifications], dtype=float),
        sums,
        lowest,
        highest,
        sketch,
        inside,
    )
    ahead = partial(compile_parts, *variant, __name__)
    reason, pose, where = map(int, call(loops.run_poses, arguments, variant, ahead))
    if reason:
        raise InputError(f"pose {first_pose + pose}, sample {first + where}: {REASONS[reason]}")
    return NormBlocks(
        count, lowest[:, NORMS], highest[:, NORMS], sums, sketch.reshape(-1, 2, loops.NORM_COLUMNS), inside
    )


def warm_up(rare: loops.Wanted = None, linear: loops.Wanted = None) -> None:
    """Compile a variant of the loops over poses, or load it from the cache; the first sampling does so by itself."""
    plan = Plan(np.zeros(8), np.ones(8), ())
    observe_norms([empty_table(rare)], [plan], "linear" if linear else "exact", 0, 0, 1, samples=1)
