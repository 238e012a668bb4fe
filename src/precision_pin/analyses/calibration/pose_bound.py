"""A bound that no choice of poses can pass: the relaxed design, and branches of it.

With weights between 0 and 1 in place of 0 or 1 the loss is convex, so that its tangent at any weights bounds it from below over
all designs: the loss there plus the least that the slopes allow. Where the relaxed design counts parts of poses, the problem is
split: a candidate is measured or it is not. The least bound of all parts is the bound (Land and Doig 1960).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.calibration.pose_choice import Design
from precision_pin.base.arrays import Array
from precision_pin.base.interrupts import raise_if_interrupted

_STEPS: Final = 400
_GAP: Final = 2e-5
"""Gap of the relaxed problem, in units of the efficiency, at which it is solved."""
_WORK: Final = 24_000
"""Parts that are bounded, times candidates."""
_MOST: Final = 120
"""The most parts that are bounded."""
_ENOUGH: Final = 0.995
"""Efficiency at which no better bound is sought."""


@final
@dataclass(frozen=True, eq=False)
class Relaxed:
    """A relaxed problem, some of whose candidates are chosen or left out.

    Attributes
    ----------
    bound
        Loss that no choice within the limits falls below.
    weights
        The relaxed design, ``(P,)``.
    low, high
        Limits of the weights, ``(P,)``: 0 and 1, and equal where a candidate is settled.
    """

    bound: float
    weights: Array
    low: Array
    high: Array

    def rounded(self, count: int) -> NDArray[np.intp]:
        """Return the candidates with the largest weights, ``(count,)``."""
        return np.argsort(-self.weights, kind="stable")[:count]

    def __lt__(self, other: Relaxed) -> bool:
        return self.bound < other.bound


def relaxed(design: Design, count: int, weights: Array, low: Array, high: Array) -> Relaxed:
    """Return the solution of the relaxed problem within limits, from first weights ``(P,)``."""
    weights, best, step = _project(weights, count, low, high), -np.inf, 1.0
    loss, slopes = design.slopes(weights)
    for _ in range(_STEPS):
        best = max(best, loss + float(slopes @ (_least(slopes, count, low, high) - weights)))
        if design.efficiency(loss, best) > 1 - _GAP:
            break
        scale = step / max(float(np.abs(slopes).max()), 1e-300)
        for _ in range(40):
            moved = _project(weights - scale * slopes, count, low, high)
            change = moved - weights
            new_loss, new_slopes = design.slopes(moved)
            if new_loss <= loss + 1e-4 * float(slopes @ change):
                curvature = float((new_slopes - slopes) @ change)
                length = float(change @ change) / curvature if curvature > 0 else 2 * scale
                step = length * max(float(np.abs(new_slopes).max()), 1e-300)
                weights, loss, slopes = moved, new_loss, new_slopes
                break
            scale /= 4
        else:  # no descent but rounding
            break
    return Relaxed(best, weights, low, high)


def branches(design: Design, count: int, root: Relaxed, chosen: NDArray[np.intp]) -> tuple[float, NDArray[np.intp]]:
    """Return a bound that is at least as good as the root's, and a choice that is at least as good as that given.

    Parameters
    ----------
    design, count
        Candidates, and how many are chosen.
    root
        The relaxed problem with no candidate settled.
    chosen
        The best choice so far, ``(count,)``.
    """
    best, parts = design.exact_loss(chosen), [root]
    for _ in range(min(_MOST, _WORK // len(root.weights)) // 2):
        raise_if_interrupted()
        if design.efficiency(best, parts[0].bound) >= _ENOUGH:
            break
        part = heapq.heappop(parts)
        doubt = part.weights * (1 - part.weights) * (part.low < part.high)
        candidate = int(np.argmax(doubt))
        if not doubt[candidate] > 0:  # a choice already: nothing is below it
            heapq.heappush(parts, part)
            break
        for value in (0.0, 1.0):
            low, high = part.low.copy(), part.high.copy()
            low[candidate] = high[candidate] = value
            if not low.sum() <= count <= high.sum():
                continue
            found = relaxed(design, count, part.weights, low, high)
            # a part of a problem is bounded by the whole's bound as well
            heapq.heappush(parts, Relaxed(max(found.bound, part.bound), found.weights, low, high))
            tried = design.swap(found.rounded(count))
            loss = design.exact_loss(tried)
            if loss < best:
                chosen, best = tried, loss
    return parts[0].bound, chosen


def _least(slopes: Array, count: int, low: Array, high: Array) -> Array:
    """Return the weights within their limits, of sum ``count``, with the least sum of slopes."""
    order = np.argsort(slopes, kind="stable")
    room = (high - low)[order]
    result = low.copy()
    result[order] += np.clip(count - float(low.sum()) - (np.cumsum(room) - room), 0.0, room)
    return result


def _project(weights: Array, count: int, low: Array, high: Array) -> Array:
    """Return the closest weights within their limits whose sum is ``count``."""
    # the sum of clip(weights - shift, low, high) falls by straight pieces as the shift grows
    ends = np.concatenate([weights - high, weights - low])
    order = np.argsort(ends, kind="stable")
    ends = ends[order]
    slopes = np.cumsum(np.where(order < len(weights), -1.0, 1.0))
    sums = float(high.sum()) + np.concatenate([[0.0], np.cumsum(slopes[:-1] * np.diff(ends))])
    piece = int(np.clip(np.searchsorted(-sums, -count, side="right") - 1, 0, len(ends) - 1))
    shift = ends[piece] + (sums[piece] - count) / max(-slopes[piece], 1.0)
    result: Array = np.clip(weights - shift, low, high)
    return result
