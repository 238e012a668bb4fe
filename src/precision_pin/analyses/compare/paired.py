"""Differences between two samples of the same robots, with intervals."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc

from precision_pin.base.arrays import Array
from precision_pin.base.record import Record
from precision_pin.draws import lazy_special
from precision_pin.statistics import clopper_pearson, quantile_ranks
from precision_pin.statistics.intervals import Moments

_CELLS: Final = 48
"""Places, at most, where the first quantile may lie that are looked at."""


@final
@dataclass(frozen=True)
class Difference(Record):
    """A difference, the other minus the first.

    Attributes:
        value: In the unit of what is compared.
        interval: Its ends; ``None`` where the robots are too few.
    """

    value: float
    interval: tuple[float, float] | None

    @property
    def is_told(self) -> bool:
        """Whether the interval leaves zero out."""
        return self.interval is not None and not self.interval[0] <= 0 <= self.interval[1]


def mean_difference(first: Array, other: Array, confidence: float, skewness: float = math.nan) -> Difference:
    """Return the difference of the means of paired samples ``(N,)``, with Hall's interval of the mean of the differences.

    Args:
        first, other: The samples.
        confidence: Confidence of the interval.
        skewness: Skewness of the differences, derived from the laws; NaN where unknown. Where the samples are too few
            for it, or for that of the differences seen, there is no interval
            (:mod:`precision_pin.statistics.intervals`).
    """
    gap = other - first
    value = float(gap.mean())
    around = gap - value
    ones = np.ones(gap.size, dtype=np.int64)
    moments = Moments(around, ones, float((around**2).mean()), gap.size, confidence, (skewness, math.nan))
    ends = moments.mean_interval
    return Difference(value, None if ends is None else (value + ends[0], value + ends[1]))


def quantile_difference(first: Array, other: Array, probability: float, confidence: float) -> Difference:
    """Return the difference of a quantile of paired samples ``(N,)``, with an interval that assumes nothing of the laws.

    For q₁, q₂ the quantiles, q₁ lies between two order statistics with a fifth of the error allowed. Were b > q₂ and a = q₁,
    robots with the first at or above a and the other below b were at least as frequent as those the other way round, since
    P(x₂ < b) ≥ p ≥ P(x₁ < a). Counts of both that contradict this by the sign test (McNemar's, exact), with two fifths of the
    error, show q₂ ≥ b; likewise from above. The interval holds b - a for every a where q₁ may lie. It is as narrow as the
    robots are alike in both, and covers more often than stated. ``None`` where the robots are too few.
    """
    value = float(np.quantile(other, probability) - np.quantile(first, probability))
    error = 1 - confidence
    ranks = quantile_ranks(first.size, probability, 1 - 0.2 * error)
    if ranks is None:
        return Difference(value, None)
    ordered, order = np.sort(first), np.argsort(other, kind="stable")
    low, high = ranks[0] - 1, ranks[1] - 1
    cells = np.unique(ordered[np.unique(np.linspace(low, high, min(_CELLS, high - low + 1)).astype(int))]).tolist()
    pairs, part = _Pairs(first[order], other[order]), 0.4 * error
    near = pairs.between(cells[0], cells[-1], pairs.least(cells[0], part), pairs.most(cells[-1], part))
    ends = [(near.least(a, part), near.most(a, part)) for a in cells]
    # between two of these places of q₁ the lower end is at least that at the first, the upper one at most that at the second
    lower = min(below - a for (below, _), a in zip(ends, [*cells[1:], cells[-1]], strict=True))
    upper = max(above - a for (_, above), a in zip(ends, [cells[0], *cells[:-1]], strict=True))
    if not math.isfinite(lower) or not math.isfinite(upper):
        return Difference(value, None)
    return Difference(value, (min(float(lower), value), max(float(upper), value)))


@final
class _Pairs:
    """Pairs ``(N,)`` of a first and a second value, the second in rising order."""

    def __init__(self, first: Array, second: Array) -> None:
        self._first, self._second = first, second
        self._values = second.tolist()
        self._below, self._up_to = (np.searchsorted(second, second, side).tolist() for side in ("left", "right"))

    def between(self, low: float, high: float, lowest: float, highest: float) -> _Pairs:
        """Return the pairs that do not lie on one side of both ranges, where they are counted on neither side."""
        first, second = self._first, self._second
        kept = ~((first < low) & (second < lowest)) & ~((first > high) & (second > highest))
        return _Pairs(first[kept], second[kept])

    def least(self, a: float, error: float) -> float:
        """Return the largest second value that q₂ is shown not to be below if q₁ is a; -inf if none is."""
        less = [0, *np.cumsum(self._first < a).tolist()]

        def not_shown(rank: int) -> bool:
            below = self._below[rank]
            return not _contradicted(less[-1] - less[below], below - less[below], error)

        rank = bisect_left(range(len(self._values)), True, key=not_shown)
        return self._values[rank - 1] if rank else -math.inf

    def most(self, a: float, error: float) -> float:
        """Return the smallest second value that q₂ is shown not to be above if q₁ is a; inf if none is."""
        more, count = [0, *np.cumsum(self._first > a).tolist()], len(self._values)

        def shown(rank: int) -> bool:
            below = self._up_to[rank]
            return _contradicted(more[below], count - below - (more[-1] - more[below]), error)

        rank = bisect_left(range(count), True, key=shown)
        return self._values[rank] if rank < count else math.inf


def _contradicted(count: int, against: int, error: float) -> bool:
    """Return whether counts contradict that the second kind is at least as probable as the first, by the sign test."""
    return count > against and float(betainc(count, against + 1, 0.5)) <= error


def share_difference(first: NDArray[np.bool_], other: NDArray[np.bool_], confidence: float) -> Difference:
    """Return the difference of the shares of true values of paired samples ``(N,)``.

    The interval holds that of Bonett and Price (2012), Wald's of paired shares with a robot added to each kind of change,
    which is short where a few robots change sides one way, and that of Zou and Donner (2008), which joins the Clopper-Pearson
    intervals of both kinds and is short where many do.
    """
    gained, lost = int((other & ~first).sum()), int((first & ~other).sum())
    count = first.size
    up, down = (gained + 1) / (count + 2), (lost + 1) / (count + 2)
    half = float(lazy_special.ndtri(0.5 + confidence / 2)) * math.sqrt((up + down - (up - down) ** 2) / (count + 2))
    value = (gained - lost) / count
    (gained_low, gained_high), (lost_low, lost_high) = (
        (abs(changed / count - end) for end in clopper_pearson(changed, count, confidence))
        for changed in (gained, lost)
    )
    low = min(up - down - half, value - math.hypot(gained_low, lost_high))
    high = max(up - down + half, value + math.hypot(gained_high, lost_low))
    return Difference(value, (max(low, -1.0), min(high, 1.0)))
