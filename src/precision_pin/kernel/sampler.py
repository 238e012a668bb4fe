"""Compiled sampler: errors of millions of units, and their statistics.

The error model at a pose is converted to arrays (`to_arrays`). One compiled function, the same for every robot and
sheet, draws the components, evaluates derived parameters, displaces the chain and accumulates the statistics
(:mod:`precision_pin.kernel.loops`). Results agree to rounding with
:meth:`precision_pin.model.pose_model.PoseModel.exact` and ``linear`` on :meth:`precision_pin.draws.space.Space.sample`.

Units are sampled in *blocks* of `BLOCK`, whose sums depend on the error model, the seed and the block's number only.
Added in block order (`Blocks.add_to`) they give the same bits for any distribution of the blocks over calls, threads or
machines of one type, and those of :func:`precision_pin.statistics.observe`. The size of a block must therefore not
change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_choice, check_memory
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.jit import call, is_kept
from precision_pin.draws.draw import Scope, occasion
from precision_pin.draws.space import Space, check_seed
from precision_pin.kernel import loops
from precision_pin.kernel.arrays import (
    BESIDE,
    ModelAtPose,
    SamplerArrays,
    convert_models,
    empty_table,
    freeze,
    join_entries,
    join_motions,
    rare_laws,
)
from precision_pin.kernel.parts import compile_parts
from precision_pin.statistics import NORMS, Plan, Specification, State
from precision_pin.statistics.accumulate import COLUMNS, LARGEST, largest_of

BLOCK: Final = loops.ATOM
"""Units in a block, 16,384."""

MOST_UNITS: Final = 2**63
"""Number of units that signed integers of 64 bits can index."""

# the sketch counts with 32 bits: with more samples in a call a bin could overflow
_MOST_BLOCKS_IN_A_CALL: Final = 2**32 // BLOCK - 1
_UPPER: Final = np.triu_indices(6)


@dataclass(frozen=True, eq=False)
class Blocks:
    """Sums, extremes, bins and counts of consecutive blocks.

    Attributes:
        lowest, highest: ``(8,)`` smallest and largest value of each quantity.
        sums: ``(blocks, 31)`` sums of each block: of (value - centre) of the eight quantities, of the products of two
            components' (value - centre) (upper triangle of 6 × 6, by rows), and of the squared (value - centre) of the
            norms.
        sketch: ``(8, COLUMNS)`` counts, see :mod:`precision_pin.statistics.accumulate`.
        inside: ``(S,)`` samples inside each specification.
        largest, largest_units: ``(2, LARGEST)`` largest |d| and |δ|, and their units, see
            :class:`precision_pin.statistics.State`.
        errors: ``(6, count)`` the errors themselves, or None if they are not kept.
    """

    count: int
    lowest: Array
    highest: Array
    sums: Array
    sketch: NDArray[np.uint32]
    inside: NDArray[np.int64]
    largest: Array
    largest_units: NDArray[np.int64]
    errors: Array | None

    def add_to(self, state: State) -> State:
        """Return the state with these blocks added; in block order, the bits do not depend on the grouping."""
        previous = np.concatenate([state.sums, state.products[_UPPER], state.norm_squares])
        # one block after another: np.sum would add pairwise
        sums = np.add.accumulate(np.vstack([previous, self.sums]), axis=0)[-1]
        products = np.empty((6, 6))
        products[_UPPER] = products.T[_UPPER] = sums[8:29]
        largest, units = largest_of(state.largest, state.largest_units, self.largest, self.largest_units)
        return State(
            count=state.count + self.count,
            lowest=np.minimum(state.lowest, self.lowest),
            highest=np.maximum(state.highest, self.highest),
            sums=sums[:8],
            products=products,
            norm_squares=sums[29:],
            sketch=state.sketch + self.sketch,
            inside=state.inside + self.inside,
            largest=largest,
            largest_units=units,
        )


def check_blocks(first_block: int, blocks: int, samples: int | None) -> tuple[int, int]:
    """Return the first unit and the number of units of some blocks, in a run of ``samples``."""
    first = int(first_block) * BLOCK
    end = min(first + int(blocks) * BLOCK, MOST_UNITS)
    count = (end if samples is None else min(end, int(samples))) - first
    if first_block < 0 or not 0 < blocks <= _MOST_BLOCKS_IN_A_CALL or count <= 0:
        raise InputError(
            f"blocks {first_block} to {first_block + blocks - 1} of {samples} samples: from block 0, "
            f"1 to {_MOST_BLOCKS_IN_A_CALL} blocks in a call, none beyond the last sample"
        )
    return first, count


Model = Literal["exact", "linear"]

_NOTHING: Final = np.zeros((0, 0))
_STAGES: Final = {"linear": loops.LINEAR, "exact": loops.EXACT}
"""Stage of the loops for each model."""

REASONS: Final = {
    loops.FORMULA: "a parameter's formula fails; a divisor that may reach zero needs a law that keeps away from it",
    loops.ANGLE: "an error rotates a frame by 180° or more; the tolerances or loads are far too large",
    loops.NOT_FINITE: "the error is not a finite number; the tolerances or loads are far too large",
}
"""Messages for the reasons why the loops stop."""


def to_arrays(pose_model: ModelAtPose) -> SamplerArrays:
    """Convert the error model at a pose to arrays for the compiled sampler, in milliseconds and without compiling.

    Raises InputError if the compiled sampler does not support a law.
    """
    return convert_models([pose_model])[0]


def to_arrays_at_poses(pose_models: Sequence[ModelAtPose]) -> list[SamplerArrays]:
    """Convert one model at several poses to arrays, faster than by `to_arrays` for each."""
    return convert_models(pose_models)


def sample(layout: SamplerArrays, seed: int, first: int, count: int, *, pose: int = 0, visit: int = 0) -> Array:
    """Return the components ``(d, count)`` of units ``first … first + count - 1``.

    :meth:`precision_pin.draws.space.Space.sample` gives the same bits for laws that use only ``+ - × ÷`` and the square
    root, and the same numbers within a few units in the last place for all others. Raises InputError for a wrong seed,
    unit, pose or visit.
    """
    return _evaluate(layout, loops.DRAW, "components", layout.space.size, _Units(seed, first, 0, count, pose, visit))


def errors(
    layout: SamplerArrays, model: Model, seed: int, first: int, count: int, *, pose: int = 0, visit: int = 0
) -> Array:
    """Return the errors ``(6, count)``, ``[d; δ]`` in m and rad, base axes, of units ``first … first + count - 1``.

    The bits do not depend on the range and are those that `observe_blocks` uses.

    Args:
        model: ``"exact"`` evaluates the displaced chain, ``"linear"`` superposes first-order errors (eqs 12-17).
        pose, visit: Numbers of pose and visit for the draws of these scopes, from 0.

    Raises:
        InputError: A wrong seed, unit, pose, visit or model; or, for one of the units, a formula that fails, a target
            that turns by π or more, an error that is not finite.
    """
    return _evaluate(layout, stage_of(model), "errors", 6, _Units(seed, first, 0, count, pose, visit))


def errors_at(layout: SamplerArrays, model: Model, x: ArrayLike) -> Array:
    """Return the errors ``(6, N)``, as `errors`, for component values ``(d, N)``.

    Raises InputError if x has another shape; or as in `errors`.
    """
    values = np.array(x, dtype=float, order="C")  # a copy: to numba a read-only array is another type
    if not np.isfinite(values).all():
        raise InputError("x holds a value that is not a finite number")
    if values.ndim != 2 or values.shape[0] != layout.space.size:
        raise InputError(f"x has shape {values.shape}, expected ({layout.space.size}, N): rows as in model.space")
    output = np.empty((6, values.shape[1]))
    motions = layout.motions
    is_inside = (values >= layout.lowest[:, None]) & (values <= layout.highest[:, None])
    if not is_inside.all():
        # the short series are valid within the bounds of the laws only
        series = np.full_like(motions.series, loops.WIDE)
        series.flags.writeable = False
        motions = motions._replace(series=series)
        if layout.datum is not None:
            wide = np.full_like(layout.datum.motions.series, loops.WIDE)
            wide.flags.writeable = False
            datum = layout.datum._replace(motions=layout.datum.motions._replace(series=wide))
            layout = replace(layout, datum=datum)
    _run(layout, stage_of(model), _Units(count=values.shape[1]), given=values, errors=output, motions=motions)
    return output


def observe_blocks(
    layout: SamplerArrays,
    plan: Plan,
    model: Model,
    seed: int,
    first_block: int,
    blocks: int,
    *,
    samples: int | None = None,
    keep_errors: bool = False,
    pose: int = 0,
    visit: int = 0,
) -> Blocks:
    """Return the statistics of blocks ``first_block … first_block + blocks - 1``; release Python's global lock."""
    first, count = check_blocks(first_block, blocks, samples)
    result = Blocks(
        count=count,
        lowest=np.full(8, np.inf),
        highest=np.full(8, -np.inf),
        sums=np.zeros((-(-count // BLOCK), loops.SUMS)),
        sketch=np.zeros((8, COLUMNS), dtype=np.uint32),
        inside=np.zeros(len(plan.specifications), dtype=np.int64),
        largest=np.full((2, LARGEST), -np.inf),
        largest_units=np.full((2, LARGEST), -1),
        errors=np.empty((6, count)) if keep_errors else None,
    )
    _run(
        layout,
        stage_of(model),
        _Units(seed, first, 0, count, pose, visit),
        # an array without columns: the errors are not kept
        errors=_NOTHING if result.errors is None else result.errors,
        plan=plan,
        into=result,
    )
    return result


def is_compiled(rare: loops.Wanted = None, linear: loops.Wanted = None, datum: loops.Wanted = None) -> bool:
    """Return whether a variant of the loops is compiled, in this process or presumably in the cache."""
    layout, stage = empty_table(rare, datum), loops.LINEAR if linear else loops.EXACT
    return is_kept(loops.run, _arguments(layout, stage, _ONE_UNIT))


def stage_of(model: Model) -> int:
    """Return the stage of the compiled loops for a model."""
    check_choice("model", model, ("exact", "linear"))
    return _STAGES[model]


def variant_of(space: Space, model: Model) -> tuple[loops.Wanted, loops.Wanted]:
    """Return the variant of the loops for a model of a space: rare laws or not, linear or not."""
    return rare_laws(space), True if stage_of(model) == loops.LINEAR else None


def warm_up(rare: loops.Wanted = None, linear: loops.Wanted = None, datum: loops.Wanted = None) -> None:
    """Compile a variant of the loops, or load it from the cache; the first sampling does so by itself."""
    # one unit of a model without errors, which has the array types of every model
    _run(empty_table(rare, datum), loops.LINEAR if linear else loops.EXACT, _ONE_UNIT)


# private -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Units:
    """Range of ``count`` units from ``first`` on; the first ``skip``, not requested, complete a tile."""

    seed: int = 0
    first: int = 0
    skip: int = 0
    count: int = 1
    pose: int = 0
    visit: int = 0


_ONE_UNIT: Final = _Units()


def _evaluate(layout: SamplerArrays, stage: int, name: str, rows: int, units: _Units) -> Array:
    """Return the components or errors ``(rows, count)`` of some units."""
    first, count = units.first, units.count
    is_integer = isinstance(first, int | np.integer) and isinstance(count, int | np.integer)
    if not is_integer or first < 0 or count < 0 or first + count > MOST_UNITS:
        raise InputError(
            f"{count!r} units from {first!r} on: both must be whole numbers, and units are numbered from 0 to 2^63 - 1"
        )
    check_memory(8.0 * rows * count, f"keeping {rows} numbers for each of {count:,} robots", "request fewer at a time")
    # always whole tiles, so that a unit's numbers do not depend on the first unit of the call
    skip = int(first) % loops.TILE
    output = np.empty((rows, skip + count))
    _run(layout, stage, replace(units, first=first - skip, skip=skip, count=skip + count), **{name: output})
    return output[:, skip:]


def allocate_scratch() -> tuple[Array, NDArray[np.uint32], NDArray[np.uint64]]:
    """Return the scratch arrays of the loops, the same for every model: values, bins, products."""
    return (
        allocate_rows(loops.SCRATCH),
        np.empty(8 * (loops.HELD + 1) * loops.TILE, dtype=np.uint32),
        allocate_rows(2).view(np.uint64),
    )


def allocate_rows(rows: int) -> Array:
    """Return an array for rows, aligned to 64 bytes: a vector load across two cache lines costs twice as much."""
    buffer = np.zeros(rows * loops.STRIDE + 8)
    begin = -buffer.ctypes.data // 8 % 8
    return buffer[begin : begin + rows * loops.STRIDE]


def _run(layout: SamplerArrays, stage: int, units: _Units, **arrays: Any) -> None:
    """Run the compiled loops with the arguments of `_arguments`; raise an error if they stop."""
    check_seed(units.seed)
    # before the return for an empty range, so that wrong poses and visits are rejected in any case
    arguments = _arguments(layout, stage, units, **arrays)
    if not units.count:
        return
    # None, not False: the code of the other model is then not compiled
    linear: loops.Wanted = True if stage == loops.LINEAR else None
    datum: loops.Wanted = True if linear is None and layout.datum is not None else None
    variant = (layout.rare, linear, datum)
    reason, unit = map(int, call(loops.run, arguments, variant, partial(compile_parts, *variant, "warm_up")))
    if reason:
        raise InputError(f"sample {units.first + unit}: {REASONS[reason]}")


def _arguments(
    layout: SamplerArrays,
    stage: int,
    units: _Units,
    *,
    given: Array | None = None,
    components: Array = _NOTHING,
    errors: Array = _NOTHING,
    motions: loops.Motions | None = None,
    plan: Plan | None = None,
    into: Blocks | None = None,
) -> tuple[Any, ...]:
    centre, scale = (np.zeros(8), np.ones(8)) if plan is None else (plan.centre, plan.scale)
    specifications = () if plan is None else plan.specifications
    counting = loops.Counting(
        centre=np.array(centre),
        # inverted once, so that the loops multiply instead of dividing
        inverse_scale=1 / scale,
        **_limits(specifications),
        conditions=_conditions(specifications, [np.eye(3) if plan is None else plan.tool_axes])[0],
    )
    # by position, in the order of `loops.run`; unused arguments are empty arrays: None is another type to numba
    # and would need another compilation
    return (
        # allocated at each call, so that threads share no scratch
        *allocate_scratch(),
        allocate_rows(layout.rows),
        layout.draws,
        layout.formulas,
        layout.superposition,
        layout.motions if motions is None else motions,
        # the superposition holds it
        None if stage == loops.LINEAR else layout.datum,
        stage,
        layout.rare,
        True if stage == loops.LINEAR else None,
        np.uint64(units.seed),
        layout.words(units.pose, units.visit),
        np.uint64(units.first),
        int(units.skip),
        int(units.count),
        np.zeros((layout.space.size, 0)) if given is None else given,
        components,
        errors,
        counting,
        np.zeros((0, loops.SUMS)) if into is None else into.sums,
        np.zeros(8) if into is None else into.lowest,
        np.zeros(8) if into is None else into.highest,
        np.zeros(0, dtype=np.uint32) if into is None else into.sketch.reshape(-1),
        np.zeros(0, dtype=np.int64) if into is None else into.inside,
        np.zeros((2, LARGEST)) if into is None else into.largest,
        np.zeros((2, LARGEST), dtype=np.int64) if into is None else into.largest_units,
    )


def _limits(specifications: Sequence[Specification]) -> dict[str, Any]:
    """Return rows and limits of those of the eight quantities; others count by conditions."""
    rows = [specification.row or 0 for specification in specifications]
    limits = [specification.limit for specification in specifications]
    return {"limit_rows": np.array(rows, dtype=np.uint64), "limits": np.array(limits, dtype=float)}


def _conditions(
    specifications: Sequence[Specification], tool_axes: Sequence[Array]
) -> tuple[loops.Conditions, loops.Conditions]:
    """Return the conditions of other quantities than the eight at the first of P poses, and at all poses."""
    counted = [spec for spec in specifications if spec.row is None]
    at_poses = [[of for spec in counted for of in spec.conditions(axes)] for axes in tool_axes]
    sizes = [0 if spec.row is not None else len(spec.parts) for spec in specifications]
    matrices = np.array([[of.matrix for of in conditions] for conditions in at_poses]).reshape(len(at_poses), -1, 3, 6)
    everywhere = loops.Conditions(
        np.cumsum([0, *sizes]).astype(np.uint64),
        matrices,
        np.array([of.limit for of in at_poses[0]], dtype=float),
        np.array([of.is_tilt for of in at_poses[0]], dtype=np.uint64),
    )
    return everywhere._replace(matrices=np.array(matrices[0])), everywhere


@dataclass(frozen=True, eq=False)
class JoinedTables:
    """Arrays of one error model at P poses, with the common draws and formulas separated.

    Attributes:
        unit_draws, unit_formulas: Draws and formulas evaluated once for all poses.
        draws, formulas: Draws and formulas evaluated at each pose.
        scopes: Scope of each stream of ``draws``.
        superposition, motions, datum: Concatenated arrays of all poses, as for
            :func:`precision_pin.kernel.loops.run_poses`.
    """

    layouts: tuple[SamplerArrays, ...]
    unit_draws: loops.Draws
    unit_formulas: loops.Formulas
    draws: loops.Draws
    formulas: loops.Formulas
    scopes: tuple[Scope, ...]
    superposition: loops.Superposition
    motions: loops.Motions
    datum: loops.Datum | None

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
        draw_rows = [getattr(first.draws, name) for name in first.draws._fields if name.endswith("_rows")]
        return cls(
            layouts=tuple(layouts),
            unit_draws=_select_draws(first.draws, np.setdiff1d(np.concatenate(draw_rows), varying)),
            unit_formulas=unit_formulas,
            draws=_select_draws(first.draws, varying),
            formulas=formulas,
            scopes=tuple(scope for scope in first.scopes if scope is not Scope.UNIT),
            superposition=_join_superpositions(layouts),
            motions=join_motions([layout.motions for layout in layouts]),
            datum=_join_datums([layout.datum for layout in layouts if layout.datum is not None]),
        )

    def words(self, first_pose: int, visit: int) -> loops.Offsets:
        """Return the last counter word of every stream of ``draws`` at every pose, ``(P, streams)``."""
        poses = range(first_pose, first_pose + len(self.layouts))
        occasions = {scope: [occasion(scope, pose, visit) for pose in poses] for scope in dict.fromkeys(self.scopes)}
        columns = [np.zeros((len(poses), 0))] + [np.array(occasions[scope])[:, None] for scope in self.scopes]
        return np.concatenate(columns, axis=1).astype(np.uint64)


def is_alike(first: SamplerArrays, second: SamplerArrays) -> bool:
    """Return whether the arrays of two poses have the same draws and formulas in the same rows."""
    if first.draws is second.draws and first.formulas is second.formulas:
        return True
    pairs = [*zip(first.draws, second.draws, strict=True), *zip(first.formulas, second.formulas, strict=True)]
    return (
        first.rows == second.rows
        and first.targets == second.targets
        and first.space.draws == second.space.draws
        and (first.datum is None) == (second.datum is None)
        and all(np.array_equal(a, b) for a, b in pairs)
    )


# draws and formulas by scope -----------------------------------------------------------------------------------------


def _find_varying(layout: SamplerArrays) -> loops.Offsets:
    """Return the rows that differ between poses: draws of pose and visit scope, and results computed from them."""
    space = layout.space
    rows = {
        component * loops.STRIDE
        for draw, columns in zip(space.draws, space.slices, strict=True)
        if draw.scope is not Scope.UNIT
        for component in range(columns.start, columns.stop)
    } - set(layout.draws.fixed_rows.tolist())
    formulas = layout.formulas
    steps = np.vstack(
        [
            np.column_stack([formulas.left, formulas.right, formulas.results]),
            np.column_stack([formulas.product_factors, formulas.products]),
        ]
    )
    for left, right, result in steps.tolist():
        if left in rows or right in rows:
            rows.add(result)
    return np.array(sorted(rows), dtype=np.uint64)


def _select_draws(draws: loops.Draws, rows: loops.Offsets) -> loops.Draws:
    is_selected = {name: np.isin(getattr(draws, name), rows) for name in BESIDE}
    fields = {field: getattr(draws, field)[is_selected[name]] for name in BESIDE for field in (name, *BESIDE[name])}
    groups = [
        k for k, (begin, _) in enumerate(pairwise(draws.group_starts.tolist())) if draws.group_rows[begin] in rows
    ]
    laws = [k for k, row in enumerate(draws.empirical_rows) if row in rows]
    group_starts, group_rows = _select_runs(draws.group_starts, draws.group_rows, groups)
    line_starts, lines = _select_runs(draws.empirical_starts, draws.empirical, laws)
    parts = {
        **draws._asdict(),
        **fields,
        "group_starts": group_starts,
        "group_rows": group_rows,
        "group_roots": draws.group_roots[groups],
        "empirical_starts": line_starts,
        "empirical": lines,
    }
    return loops.Draws(**{name: _freeze_copy(part) for name, part in parts.items()})


def _select_runs(
    starts: loops.Offsets, values: NDArray[Any], indices: Sequence[int]
) -> tuple[loops.Offsets, NDArray[Any]]:
    """Return starts and values of the chosen runs ``values[starts[k] … starts[k + 1]]``."""
    runs = [values[int(starts[k]) : int(starts[k + 1])] for k in indices]
    return np.cumsum([0, *map(len, runs)]).astype(np.uint64), np.concatenate([values[:0], *runs])


def _split_formulas(formulas: loops.Formulas, varying: loops.Offsets) -> tuple[loops.Formulas, loops.Formulas]:
    """Return the formulas with the same results at every pose, and the others."""
    steps, products = np.isin(formulas.results, varying), np.isin(formulas.products, varying)

    def part(of_steps: NDArray[np.bool_], of_products: NDArray[np.bool_]) -> loops.Formulas:
        fields = formulas._asdict().items()
        selected_values = (values[of_products if name.startswith("product") else of_steps] for name, values in fields)
        return loops.Formulas(*map(_freeze_copy, selected_values))

    return part(~steps, ~products), part(steps, products)


def _freeze_copy(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy of an array: to numba a writeable array is another type."""
    copy = np.array(array, order="C")
    copy.flags.writeable = False
    return copy


# concatenation of poses ----------------------------------------------------------------------------------------------


def _join_superpositions(layouts: Sequence[SamplerArrays]) -> loops.Superposition:
    parts = [layout.superposition for layout in layouts]
    before = np.cumsum([(0, 0), *(part.starts[-1] for part in parts)], axis=0).astype(np.uint64)
    starts = [part.starts[:-1] + begin for part, begin in zip(parts, before[:-1], strict=True)]
    return loops.Superposition(**join_entries(parts), starts=_freeze_copy(np.concatenate([*starts, before[-1:]])))


def _join_datums(datums: Sequence[loops.Datum]) -> loops.Datum | None:
    """Return one datum at several poses."""
    if not datums:
        return None
    # poses of one conversion share everything but the gains; others have rows of their own where gains are zero
    rows = np.unique(np.concatenate([datum.rows for datum in datums]))
    gains = np.zeros((len(datums), rows.size, 6))
    for gain, datum in zip(gains, datums, strict=True):
        gain[np.searchsorted(rows, datum.rows)] = datum.gains[0]
    return datums[0]._replace(rows=_freeze_copy(rows), gains=freeze(gains, *gains.shape))


MOST_TOGETHER: Final = 64
"""Poses processed together at best: drawing then costs next to nothing, and the sums stay in the cache."""


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
    """Return the 515 ascending edges of the small sketch, in units of the planned spread from the planned mean.

    That is the sketch of :mod:`precision_pin.statistics.accumulate` with 32 bins per octave, from 1/16 to 16. With v the
    distance from the mean in spreads, the bin of v is at most ``max(1/16, |v|/32)`` wide up to 16. The outermost bins
    end at the smallest and largest value.
    """
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
    counts = np.zeros((poses, len(specifications)), dtype=np.int64)
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
        None if linear else joined.datum,
        *variant,
        np.uint64(seed),
        np.zeros(joined.unit_draws.streams.size, dtype=np.uint64),
        joined.words(first_pose, visit),
        np.uint64(first),
        int(count),
        np.array([plan.centre for plan in plans]),
        np.array([1 / plan.scale for plan in plans]),
        *_limits(specifications).values(),
        _conditions(specifications, [plan.tool_axes for plan in plans])[1],
        sums,
        lowest,
        highest,
        sketch,
        counts,
    )
    datum: loops.Wanted = True if linear is None and joined.datum is not None else None
    compile_ahead = partial(compile_parts, *variant, datum, "warm_up_poses")
    reason, pose, unit = map(int, call(loops.run_poses, arguments, (*variant, datum), compile_ahead))
    if reason:
        raise InputError(f"pose {first_pose + pose}, sample {first + unit}: {REASONS[reason]}")
    return NormBlocks(
        count, lowest[:, NORMS], highest[:, NORMS], sums, sketch.reshape(-1, 2, loops.NORM_COLUMNS), counts
    )


def warm_up_poses(rare: loops.Wanted = None, linear: loops.Wanted = None, datum: loops.Wanted = None) -> None:
    """Compile a variant of the loops over poses, or load it from the cache; the first sampling does so by itself."""
    plan = Plan(np.zeros(8), np.ones(8), ())
    observe_norms([empty_table(rare, datum)], [plan], "linear" if linear else "exact", 0, 0, 1, samples=1)
