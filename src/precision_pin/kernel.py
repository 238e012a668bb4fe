"""The compiled sampler: errors of units by the million, and their statistics.

A pose's error model is laid out as arrays (`compile_table`); one compiled function, the same for every robot and
sheet, then draws, derives, displaces, composes and counts (:mod:`precision_pin.kernel_loops`). Results agree with
:meth:`precision_pin.model.PoseModel.exact` and ``linear`` on :meth:`precision_pin.space.Space.sample` to rounding.

Units come in *blocks* of `BLOCK`, part of the format: each block has sums of its own, which depend on the error model,
the seed and the block's number only. Added up in block order (`Blocks.added_to`) they give the same bits however the
blocks were spread over calls, threads or machines of one type, and the bits of
:func:`precision_pin.statistics.observe`.
"""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, final

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin import kernel_loops
from precision_pin.errors import InputError
from precision_pin.kernel_layout import CompiledTable, lay_out
from precision_pin.kernel_loops import ANGLE, ATOM, DRAW, EXACT, FORMULA, LINEAR, STRIDE, SUMS, Counting, Motions
from precision_pin.space import check_seed
from precision_pin.statistics import COLUMNS, Plan, State, start

if TYPE_CHECKING:
    from precision_pin.model import PoseModel

__all__ = [
    "BLOCK",
    "Blocks",
    "CompiledTable",
    "accumulate",
    "compile_table",
    "errors",
    "errors_at",
    "is_compiled",
    "observe_blocks",
    "sample",
    "warm_up",
]

Array = NDArray[np.float64]
Model = Literal["exact", "linear"]

BLOCK: Final = ATOM
"""Units in a block, 16,384."""

_MOST_BLOCKS_IN_A_CALL: Final = 2**32 // BLOCK - 1
_NOTHING: Final = np.zeros((0, 0))
_STAGES: Final = {"linear": LINEAR, "exact": EXACT}


def compile_table(pose_model: PoseModel) -> CompiledTable:
    """Lay the error model at a pose out for the compiled sampler; takes milliseconds, compiles nothing.

    Raises
    ------
    InputError
        The compiled sampler does not know a law.
    """
    return lay_out(pose_model.table, pose_model.space)


def sample(
    layout: CompiledTable, seed: int, first: int, count: int, *, pose: int = 0, visit: int = 0
) -> Array:
    """Return the components ``(d, count)`` of units ``first … first + count - 1``.

    As :meth:`precision_pin.space.Space.sample`, which gives the same bits where a law needs only ``+ - × ÷`` and the
    square root, and the same numbers within a few units in the last place elsewhere.

    Raises
    ------
    InputError
        A wrong seed, unit, pose or visit.
    """
    begin, length = _even_range(first, count)
    kept = np.empty((layout.space.size, length))
    _run(layout, DRAW, seed, begin, length, components=kept, pose=pose, visit=visit)
    return kept[:, first - begin : first - begin + count]


def errors(
    layout: CompiledTable,
    model: Model,
    seed: int,
    first: int,
    count: int,
    *,
    pose: int = 0,
    visit: int = 0,
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
        A wrong seed, unit, pose, visit or model; a formula that fails, or a target that turns by π or more, for one
        of the units.
    """
    begin, length = _even_range(first, count)
    kept = np.empty((6, length))
    # a unit that was not asked for, the one before, must not be the reason to refuse
    skip = first - begin
    try:
        _run(layout, _stage(model), seed, begin, length, errors=kept, pose=pose, visit=visit)
    except _SampleError as failure:
        if failure.sample >= skip:
            raise
    return kept[:, skip:]


def errors_at(layout: CompiledTable, model: Model, x: ArrayLike) -> Array:
    """Return the errors ``(6, N)``, as `errors`, for component values ``(d, N)``.

    Raises
    ------
    InputError
        x has another shape, a formula fails, or a target turns by π or more.
    """
    values = np.ascontiguousarray(x, dtype=float)
    if values.ndim != 2 or values.shape[0] != layout.space.size:
        raise InputError(f"x has shape {values.shape}, expected ({layout.space.size}, N): rows as in model.space")
    return values
