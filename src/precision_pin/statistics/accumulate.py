"""Accumulators of the sampled errors and their histograms, filled block by block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InternalError
from precision_pin.statistics.limits import are_inside
from precision_pin.statistics.plan import COMPONENTS, NORMS, QUANTITIES, Plan

Counts = NDArray[np.int64]

MANTISSA_BITS: Final = 9
LOWEST_EXPONENT: Final = -12
HIGHEST_EXPONENT: Final = 8
"""Bins are 2⁻⁹ of their value wide, from 2⁻¹² to 2⁸ scales: a quantile is read to three digits, from 1.3 MB of counts.

A further bit or twice the octaves would double the counts, and the time to merge them.
"""
SHIFT: Final = 52 - MANTISSA_BITS
"""Right shift of a double's bits that leaves the exponent and the top nine bits of the mantissa."""
OFFSET: Final = (1023 + LOWEST_EXPONENT) << MANTISSA_BITS
"""The shifted bits of 2⁻¹²."""
BINS: Final = 1 + ((HIGHEST_EXPONENT - LOWEST_EXPONENT) << MANTISSA_BITS)
"""Bins on each side of the centre: 10,241."""
COLUMNS: Final = 2 * BINS
"""Columns of a quantity's row of counts, both sides together."""


def sketch_columns(scaled: Array) -> Counts:
    """Return the column of each finite ``v = (value − centre) / scale``, in an array of the same shape."""
    shifted = np.abs(scaled).view(np.int64) >> SHIFT
    magnitude_bin = np.minimum(np.maximum(shifted - (OFFSET - 1), 0), BINS - 1)
    return np.where(scaled < 0, BINS - 1 - magnitude_bin, BINS + magnitude_bin)


def sketch_edges() -> Array:
    """Return the ``COLUMNS + 1`` ascending edges of the columns in v; the outermost are infinite."""
    inner = (np.arange(BINS - 1, dtype=np.int64) + OFFSET) << SHIFT
    magnitude = np.concatenate(([0.0], inner.view(np.float64), [np.inf]))
    return np.concatenate((-magnitude[::-1], magnitude[1:]))


LARGEST: Final = 10
"""Number of largest errors kept: the list of a report; more cost time in every block."""

_LANES: Final = 16
_SPAN: Final = 128
"""Lanes and span of the compiled sampler's sums, so that both add in the same order."""
_ROUNDING: Final = 1e-9
"""Fraction of centre and scale by which the edges of bins may be off: rounding (1e-16) of some 10⁶ sums, with a margin."""
_TILE: Final = 1 << 14
"""Samples processed at a time: their arrays (eight rows, 1 MB) fit the processor's cache."""


@dataclass(frozen=True, eq=False)
class State:
    """Accumulated statistics of the samples observed so far.

    Attributes:
        lowest, highest: ``(8,)`` smallest and largest value (+∞ and −∞ before the first sample).
        sums: ``(8,)`` sums of value − centre.
        products: ``(6, 6)`` sums of products of two components' (value − centre), symmetric.
        norm_squares: ``(2,)`` sums of (norm − centre)², position and attitude.
        sketch: ``(8, COLUMNS)`` counts, see :func:`sketch_columns`.
        inside: ``(S,)`` samples inside each specification of the plan.
        largest, largest_units: ``(2, LARGEST)`` largest |d| and |δ|, descending, and their sample indices, from 0. Ties
            go to the earlier sample. Unused entries are −∞ and −1.
    """

    count: int
    lowest: Array
    highest: Array
    sums: Array
    products: Array
    norm_squares: Array
    sketch: Counts
    inside: Counts
    largest: Array
    largest_units: Counts


def start(plan: Plan) -> State:
    """Return the state before any sample."""
    return State(
        count=0,
        lowest=np.full(8, np.inf),
        highest=np.full(8, -np.inf),
        sums=np.zeros(8),
        products=np.zeros((6, 6)),
        norm_squares=np.zeros(2),
        sketch=np.zeros((8, COLUMNS), dtype=np.int64),
        inside=np.zeros(len(plan.specifications), dtype=np.int64),
        largest=np.full((2, LARGEST), -np.inf),
        largest_units=np.full((2, LARGEST), -1),
    )


def observe(plan: Plan, state: State, errors: ArrayLike) -> State:
    """Return the state after a further block of errors.

    Args:
        state: The state so far; it is not changed.
        errors: ``(6, N)`` errors [d; δ], m and rad, base axes; N may be 0.

    Raises:
        InternalError: The block has another shape, or holds a value that is not finite.
    """
    block = np.asarray(errors, dtype=float)
    if block.ndim != 2 or block.shape[0] != 6:
        raise InternalError(f"a block of errors has shape (6, N), not {block.shape}")
    for begin in range(0, block.shape[1], _TILE):
        state = merge(state, _tally(plan, quantity_values(block[:, begin : begin + _TILE]), state.count))
    return state


def merge(first: State, second: State) -> State:
    """Return the state of both sets of samples.

    Sums depend on order and grouping, by rounding: merge in block order if identical bits matter. Raises InternalError
    if the states have different numbers of specifications.
    """
    if first.inside.shape != second.inside.shape:
        raise InternalError(f"states of {first.inside.size} and {second.inside.size} specifications")
    largest, units = largest_of(first.largest, first.largest_units, second.largest, second.largest_units)
    summed = ("count", "sums", "products", "norm_squares", "sketch", "inside")
    sums: dict[str, Any] = {name: getattr(first, name) + getattr(second, name) for name in summed}
    lowest, highest = np.minimum(first.lowest, second.lowest), np.maximum(first.highest, second.highest)
    return State(lowest=lowest, highest=highest, largest=largest, largest_units=units, **sums)


def is_consistent(plan: Plan, state: State) -> bool:
    """Return whether the histograms of a state are compatible with its other statistics, to rounding."""
    if not state.count:
        return True
    edges = plan.scale[:, None] * sketch_edges()
    slack = _ROUNDING * (np.abs(plan.centre) + plan.scale)
    low, high = edges[:, :-1] - slack[:, None], edges[:, 1:] + slack[:, None]
    outermost = [(counts > 0).argmax(axis=1) for counts in (state.sketch, state.sketch[:, ::-1])]
    rows = np.arange(8)
    for value, column in ((state.lowest, outermost[0]), (state.highest, COLUMNS - 1 - outermost[1])):
        if not ((low[rows, column] <= value - plan.centre) & (value - plan.centre <= high[rows, column])).all():
            return False
    for spec, inside in zip(plan.specifications, state.inside.tolist(), strict=True):
        if spec.row is None:
            continue
        counts, centre, limit = state.sketch[spec.row], plan.centre[spec.row], spec.limit
        certain = counts[(low[spec.row] >= -limit - centre) & (high[spec.row] <= limit - centre)].sum()
        possible = counts[(high[spec.row] >= -limit - centre) & (low[spec.row] <= limit - centre)].sum()
        if not certain <= inside <= possible:
            return False
    lowest, highest = ((np.where(state.sketch > 0, edge, 0.0) * state.sketch).sum(axis=1) for edge in (low, high))
    return bool(((lowest <= state.sums) & (state.sums <= highest)).all())


def largest_of(values: Array, units: Counts, more_values: Array, more_units: Counts) -> tuple[Array, Counts]:
    """Return the `LARGEST` largest of two sets of values ``(2, m)`` and their sample indices, as in `State`."""
    all_values, all_units = np.hstack([values, more_values]), np.hstack([units, more_units])
    order = np.lexsort((all_units, -all_values), axis=1)[:, :LARGEST]
    return np.take_along_axis(all_values, order, axis=1), np.take_along_axis(all_units, order, axis=1)


def quantity_values(errors: Array) -> Array:
    """Return the eight quantities of a block: ``(6, N)`` → ``(8, N)``, m and rad.

    Raises InternalError if a quantity is not finite; the message names the first and its sample within the block.
    """
    values = np.empty((8, errors.shape[1]))
    values[1:4] = errors[:3]
    values[5:8] = errors[3:]
    with np.errstate(over="ignore", invalid="ignore"):
        values[0] = np.sqrt((errors[:3] * errors[:3]).sum(axis=0))
        values[4] = np.sqrt((errors[3:] * errors[3:]).sum(axis=0))
    if not np.isfinite(values).all():
        row, sample = np.argwhere(~np.isfinite(values[list(COMPONENTS + NORMS)]))[0]
        quantity = (COMPONENTS + NORMS)[row]
        raise InternalError(f"sample {sample} of the block has {QUANTITIES[quantity]} = {values[quantity, sample]}")
    return values


def lane_sums(rows: Array) -> Array:
    """Sum each row in sixteen fixed lanes: ``(k, N)`` → ``(k,)``."""
    # The order is that of the compiled sampler, and the same for every vector width of the processor. Within every 128
    # samples the even ones come first, then the odd ones. In this order lane l adds samples l, l + 16, …; the lanes are
    # then folded in halves.
    count, length = rows.shape
    padded = np.zeros((count, -(-length // _SPAN) * _SPAN))
    padded[:, :length] = rows
    evens_first = padded.reshape(count, -1, _SPAN // 2, 2).swapaxes(2, 3)
    lanes = evens_first.reshape(count, -1, _LANES).sum(axis=1)
    while lanes.shape[1] > 1:
        half = lanes.shape[1] // 2
        lanes = lanes[:, :half] + lanes[:, half:]
    return lanes[:, 0]


def _tally(plan: Plan, values: Array, first: int) -> State:
    """Return the state of one tile of values ``(8, n)``, n ≥ 1, of samples ``first … first + n - 1``."""
    residuals = values - plan.centre[:, None]
    components = residuals[list(COMPONENTS)]
    norms = residuals[list(NORMS)]
    products = np.empty((6, 6))
    for row in range(6):
        products[row, row:] = lane_sums(components[row] * components[row:])
        products[row:, row] = products[row, row:]
    columns = sketch_columns(residuals / plan.scale[:, None])
    columns += COLUMNS * np.arange(8)[:, None]
    empty = start(plan)
    errors = values[list(COMPONENTS)]
    inside = [
        np.abs(values[spec.row]) <= spec.limit
        if spec.row is not None
        else are_inside(spec.conditions(plan.tool_axes), errors)
        for spec in plan.specifications
    ]
    units = np.tile(np.arange(first, first + values.shape[1]), (2, 1))
    largest, largest_units = largest_of(empty.largest, empty.largest_units, values[list(NORMS)], units)
    return State(
        count=values.shape[1],
        lowest=values.min(axis=1),
        highest=values.max(axis=1),
        sums=lane_sums(residuals),
        products=products,
        norm_squares=lane_sums(norms * norms),
        sketch=np.bincount(columns.ravel(), minlength=8 * COLUMNS).reshape(8, COLUMNS),
        inside=np.array([np.count_nonzero(kept) for kept in inside], dtype=np.int64),
        largest=largest,
        largest_units=largest_units,
    )
