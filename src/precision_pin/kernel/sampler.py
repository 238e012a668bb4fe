"""The compiled sampler: errors of units by the million, and their statistics.

A pose's error model is laid out as arrays (`to_arrays`); one compiled function, the same for every robot and
sheet, then draws, derives, displaces, composes and counts (:mod:`precision_pin.kernel.loops`). Results agree with
:meth:`precision_pin.model.pose_model.PoseModel.exact` and ``linear`` on :meth:`precision_pin.draws.space.Space.sample`
to rounding.

Units come in blocks (:mod:`precision_pin.kernel.blocks`), whose sums do not depend on how they are spread over calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.draws.space import Space, check_seed
from precision_pin.errors import InputError
from precision_pin.inputs.arguments import check_choice
from precision_pin.inputs.memory import check_memory
from precision_pin.jit import call, is_kept
from precision_pin.kernel import loops
from precision_pin.kernel.arrays import SamplerArrays, convert_table, convert_tables
from precision_pin.kernel.blocks import BLOCK, MOST_UNITS, Blocks, check_blocks
from precision_pin.kernel.draw_arrays import rare_laws
from precision_pin.kernel.loops import (
    ANGLE,
    DRAW,
    EXACT,
    FORMULA,
    HELD,
    LINEAR,
    NOT_FINITE,
    SCRATCH,
    STRIDE,
    SUMS,
    TILE,
    WIDE,
    Counting,
    Motions,
    Wanted,
)
from precision_pin.kernel.parts import compile_parts, empty_table
from precision_pin.statistics import COLUMNS, LARGEST, Plan, State, start
from precision_pin.typing import Array

if TYPE_CHECKING:
    from precision_pin.model.pose_model import PoseModel

__all__ = [
    "BLOCK",
    "REASONS",
    "Blocks",
    "SamplerArrays",
    "accumulate",
    "allocate_rows",
    "allocate_scratch",
    "check_blocks",
    "errors",
    "errors_at",
    "is_compiled",
    "observe_blocks",
    "sample",
    "stage_of",
    "to_arrays",
    "to_arrays_at_poses",
    "variant_of",
    "warm_up",
]

Model = Literal["exact", "linear"]

_NOTHING: Final = np.zeros((0, 0))
_STAGES: Final = {"linear": LINEAR, "exact": EXACT}
"""Models as the compiled loops number them."""

REASONS: Final = {
    FORMULA: "a parameter's formula fails; a divisor that may reach zero needs a law that keeps away from it",
    ANGLE: "an error turns a place by half a turn or more; the tolerances or loads are far too large",
    NOT_FINITE: "the error is not a finite number; the tolerances or loads are far too large",
}
"""Why the compiled loops stopped, in words."""


def to_arrays(pose_model: PoseModel) -> SamplerArrays:
    """Lay the error model at a pose out for the compiled sampler; takes milliseconds, compiles nothing.

    Raises
    ------
    InputError
        The compiled sampler does not know a law.
    """
    return convert_table(pose_model.table, pose_model.space)


def to_arrays_at_poses(pose_models: Sequence[PoseModel]) -> list[SamplerArrays]:
    """Lay one model out at several poses, as `to_arrays` does each, in less time.

    Raises
    ------
    InputError
        The compiled sampler does not know a law.
    """
    return convert_tables([at.table for at in pose_models], pose_models[0].space) if pose_models else []


# the names of before: `to_arrays` compiles nothing
CompiledTable = SamplerArrays
compile_table = to_arrays
compile_tables = to_arrays_at_poses


def sample(layout: SamplerArrays, seed: int, first: int, count: int, *, pose: int = 0, visit: int = 0) -> Array:
    """Return the components ``(d, count)`` of units ``first … first + count - 1``.

    As :meth:`precision_pin.draws.space.Space.sample`, which gives the same bits where a law needs only ``+ - × ÷`` and the
    square root, and the same numbers within a few units in the last place elsewhere.

    Raises
    ------
    InputError
        A wrong seed, unit, pose or visit.
    """
    # a tile is drawn whole, so that a unit's numbers do not depend on where a call begins
    skip = _check_units(first, count)
    _check_kept(layout.space.size, count)
    kept = np.empty((layout.space.size, skip + count))
    _run(layout, DRAW, _Units(seed, first - skip, skip, skip + count, pose, visit), components=kept)
    return kept[:, skip:]


def errors(
    layout: SamplerArrays, model: Model, seed: int, first: int, count: int, *, pose: int = 0, visit: int = 0
) -> Array:
    """Return the errors ``(6, count)``, ``[d; δ]`` in m and rad, base axes, of units ``first … first + count - 1``.

    The same bits as `accumulate` sees, whatever the range asked for.

    Parameters
    ----------
    layout
        The error model at a pose.
    model
        ``"exact"``: the displaced chain multiplied out; ``"linear"``: superposition (eqs 12-17).
    seed
        64-bit seed.
    first, count
        Which units.
    pose, visit
        Which pose and visit the draws of those scopes are for, 0-based.

    Raises
    ------
    InputError
        A wrong seed, unit, pose, visit or model; or, for one of the units, a formula that fails, a target that turns
        by π or more, an error that is not finite.
    """
    skip = _check_units(first, count)
    _check_kept(6, count)
    kept = np.empty((6, skip + count))
    _run(layout, stage_of(model), _Units(seed, first - skip, skip, skip + count, pose, visit), errors=kept)
    return kept[:, skip:]


def errors_at(layout: SamplerArrays, model: Model, x: ArrayLike) -> Array:
    """Return the errors ``(6, N)``, as `errors`, for component values ``(d, N)``.

    Raises
    ------
    InputError
        x has another shape; or as in `errors`.
    """
    values = np.array(x, dtype=float, order="C")  # a copy: a read-only array would be another type to numba
    if not np.isfinite(values).all():
        raise InputError("x holds a value that is not a finite number")
    if values.ndim != 2 or values.shape[0] != layout.space.size:
        raise InputError(f"x has shape {values.shape}, expected ({layout.space.size}, N): rows as in model.space")
    kept = np.empty((6, values.shape[1]))
    motions = layout.motions
    inside = (values >= layout.lowest[:, None]) & (values <= layout.highest[:, None])
    if not inside.all():
        # the short series were chosen for what the laws can give
        series = np.full_like(motions.series, WIDE)
        series.flags.writeable = False
        motions = motions._replace(series=series)
    units = _Units(0, 0, 0, values.shape[1], 0, 0)
    _run(layout, stage_of(model), units, given=values, errors=kept, motions=motions)
    return kept


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
    """Return what blocks ``first_block … first_block + blocks - 1`` give; other threads run meanwhile.

    Parameters
    ----------
    layout, model, seed, pose, visit
        As in `errors`.
    plan
        What is subtracted, binned and counted.
    first_block, blocks
        Which blocks of `BLOCK` units.
    samples
        The number of units of the whole run, at which its last block ends.
    keep_errors
        Return the errors as well.

    Raises
    ------
    InputError
        As `errors`.
    """
    first, count = check_blocks(first_block, blocks, samples)
    result = Blocks(
        count=count,
        lowest=np.full(8, np.inf),
        highest=np.full(8, -np.inf),
        sums=np.zeros((-(-count // BLOCK), SUMS)),
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
        # no columns: the errors are not kept
        errors=_NOTHING if result.errors is None else result.errors,
        plan=plan,
        into=result,
    )
    return result


def accumulate(
    layout: SamplerArrays,
    plan: Plan,
    model: Model,
    seed: int,
    first_block: int,
    blocks: int,
    *,
    samples: int | None = None,
    state: State | None = None,
    pose: int = 0,
    visit: int = 0,
) -> State:
    """Return the statistics after blocks ``first_block … first_block + blocks - 1``, added to ``state``.

    Parameters and errors as in `observe_blocks`, which threads use; then ``accumulate`` is `Blocks.add_to` of each
    in turn. Going on from the state of the blocks before gives the same bits as one call for all.
    """
    found = observe_blocks(layout, plan, model, seed, first_block, blocks, samples=samples, pose=pose, visit=visit)
    return found.add_to(start(plan) if state is None else state)


def is_compiled(rare: Wanted = None, linear: Wanted = None) -> bool:
    """Return whether a variant of the loops is compiled, in this process or in numba's cache, as far as can be known."""
    layout, stage = empty_table(rare), LINEAR if linear else EXACT
    return is_kept(loops.run, _arguments(layout, stage, _ONE_UNIT))


def stage_of(model: Model) -> int:
    """Return what a model is to the compiled loops.

    Raises
    ------
    InputError
        It is neither ``"exact"`` nor ``"linear"``.
    """
    check_choice("model", model, ("exact", "linear"))
    return _STAGES[model]


def variant_of(space: Space, model: Model) -> tuple[Wanted, Wanted]:
    """Return which variant of the loops samples a model of a space: with rare laws, of the linear model.

    Raises
    ------
    InputError
        There is no such model.
    """
    return rare_laws(space), True if stage_of(model) == LINEAR else None


def warm_up(rare: Wanted = None, linear: Wanted = None) -> None:
    """Compile a variant of the loops, or load it from numba's cache; whatever samples first does so by itself."""
    # a unit of a robot that stays where it is: the types are those of any model
    _run(empty_table(rare), LINEAR if linear else EXACT, _ONE_UNIT)


# inside --------------------------------------------------------------------------------------------------------------


@final
@dataclass(frozen=True)
class _Units:
    """Which units: the first, how many nobody asked for, how many with them; for which pose and visit."""

    seed: int
    first: int
    skip: int
    count: int
    pose: int
    visit: int


_ONE_UNIT: Final = _Units(0, 0, 0, 1, 0, 0)


def _check_units(first: int, count: int) -> int:
    """Return how many units to begin earlier, so as to begin with a tile."""
    whole = isinstance(first, int | np.integer) and isinstance(count, int | np.integer)
    if not whole or first < 0 or count < 0 or first + count > MOST_UNITS:
        raise InputError(
            f"{count!r} units from {first!r} on: both whole numbers, units are numbered from 0 to 2^63 - 1"
        )
    return int(first) % TILE


def _check_kept(rows: int, count: int) -> None:
    check_memory(8.0 * rows * count, f"keeping {rows} numbers of each of {count:,} robots", "ask for fewer at a time")


def allocate_scratch() -> tuple[Array, NDArray[np.uint32], NDArray[np.uint64]]:
    """Return scratch arrays of the compiled loops, whatever the model: values, bins, products."""
    return allocate_rows(SCRATCH), np.empty(8 * (HELD + 1) * TILE, dtype=np.uint32), allocate_rows(2).view(np.uint64)


def allocate_rows(rows: int) -> Array:
    """Return an array for rows, on a 64-byte boundary: a vector load across two cache lines costs twice."""
    longer = np.zeros(rows * STRIDE + 8)
    begin = -longer.ctypes.data // 8 % 8
    return longer[begin : begin + rows * STRIDE]


def _run(layout: SamplerArrays, stage: int, units: _Units, **given: Any) -> None:
    """Run the compiled loops over samples, with what `_arguments` takes, and raise what stopped them."""
    check_seed(units.seed)
    # made before the question whether there is anything to do: wrong poses and visits are refused all the same
    arguments = _arguments(layout, stage, units, **given)
    if not units.count:
        return
    # not False: None leaves the other model out of what is compiled
    linear: Wanted = True if stage == LINEAR else None
    ahead = partial(compile_parts, layout.rare, linear, __name__)
    reason, where = map(int, call(loops.run, arguments, (layout.rare, linear), ahead))
    if reason:
        raise InputError(f"sample {units.first + where}: {REASONS[reason]}")


def _arguments(
    layout: SamplerArrays,
    stage: int,
    units: _Units,
    *,
    given: Array | None = None,
    components: Array = _NOTHING,
    errors: Array = _NOTHING,
    motions: Motions | None = None,
    plan: Plan | None = None,
    into: Blocks | None = None,
) -> tuple[Any, ...]:
    """Return what the compiled loops are called with."""
    centre, scale = (np.zeros(8), np.ones(8)) if plan is None else (plan.centre, plan.scale)
    specifications = () if plan is None else plan.specifications
    counting = Counting(
        centre=np.array(centre),
        # divided here, multiplied in the loops
        inverse_scale=1 / scale,
        limit_rows=np.array([specification.row for specification in specifications], dtype=np.uint64),
        limits=np.array([specification.limit for specification in specifications], dtype=float),
    )
    # by position, in the order of `loops.run`; what is not wanted is an array without entries: None would be another type
    # to numba, and another compilation
    return (
        # new ones at each call, so that threads share nothing
        *allocate_scratch(),
        allocate_rows(layout.rows),
        layout.draws,
        layout.formulas,
        layout.superposition,
        layout.motions if motions is None else motions,
        stage,
        layout.rare,
        True if stage == LINEAR else None,
        np.uint64(units.seed),
        layout.words(units.pose, units.visit),
        np.uint64(units.first),
        int(units.skip),
        int(units.count),
        np.zeros((layout.space.size, 0)) if given is None else given,
        components,
        errors,
        counting,
        np.zeros((0, SUMS)) if into is None else into.sums,
        np.zeros(8) if into is None else into.lowest,
        np.zeros(8) if into is None else into.highest,
        np.zeros(0, dtype=np.uint32) if into is None else into.sketch.reshape(-1),
        np.zeros(0, dtype=np.int64) if into is None else into.inside,
        np.zeros((2, LARGEST)) if into is None else into.largest,
        np.zeros((2, LARGEST), dtype=np.int64) if into is None else into.largest_units,
    )
