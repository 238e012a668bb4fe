"""Intervals: distribution-free for probabilities and quantiles, by Hall's transformation for mean and variance."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Decimal
from functools import cached_property, lru_cache
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtr, betainc, betaincinv, stdtrit

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array, Fixed


def check_confidence(confidence: float) -> None:
    """Raise InputError unless a confidence lies above 0 and below 1."""
    check_number("confidence", confidence, "above 0 and below 1", lambda share: 0 < share < 1)


@lru_cache(maxsize=1024)
def quantile_ranks(samples: int, p: float, confidence: float) -> tuple[int, int] | None:
    """Return the ranks (from 1) whose order statistics enclose the p-quantile, or None.

    For B binomial (samples, p), the lower rank is the largest l with P(B < l) ≤ (1 − confidence)/2, the upper rank the
    smallest u with P(B ≥ u) ≤ (1 − confidence)/2. None if l would be 0 or u would exceed the number of samples (David
    and Nagaraja, Order Statistics, section 7.1).
    """
    tail = (1 - confidence) / 2
    lower = bisect_left(range(samples + 1), True, key=lambda k: float(bdtr(k, samples, p)) > tail)
    upper = _smallest_rank_above(samples, p, tail)
    return (lower, upper) if lower >= 1 and upper <= samples else None


@lru_cache(maxsize=1024)
def upper_bound_rank(samples: int, p: float, confidence: float) -> int | None:
    """Return the rank whose order statistic bounds the p-quantile from above with this confidence.

    It is the smallest u with P(B ≥ u) ≤ 1 − confidence; None if even the largest sample is no such bound (Wilks 1941:
    95 % of the distribution with 95 % confidence needs 59 samples).
    """
    rank = _smallest_rank_above(samples, p, 1 - confidence)
    return rank if rank <= samples else None


@lru_cache(maxsize=1024)
def tolerance_ranks(samples: int, content: float, confidence: float) -> tuple[int, int] | None:
    """Return the symmetric ranks r and N + 1 − r between which this content of the distribution lies.

    The probability between X₍r₎ and X₍N+1−r₎ is Beta(N + 1 − 2r, 2r); r is the largest rank for which it exceeds the
    content with this confidence. None if r would be 0 (Wilks 1941: 93 samples for 95/95).
    """
    largest = samples // 2
    rank = bisect_left(
        range(1, largest + 1), True, key=lambda r: float(betainc(2 * r, samples + 1 - 2 * r, 1 - content)) < confidence
    )
    return (rank, samples + 1 - rank) if rank >= 1 else None


def clopper_pearson(inside: float, samples: float, confidence: float) -> tuple[float, float]:
    """Return the Clopper-Pearson interval of a probability, from the (effective) numbers of samples inside and in total.

    It covers every probability with at least the confidence (Clopper and Pearson, Biometrika 26, 1934). The lower
    endpoint is 0 if no sample is inside, the upper endpoint 1 if all are.
    """
    tail = (1 - confidence) / 2
    lower = float(betaincinv(inside, samples - inside + 1, tail)) if inside > 0 else 0.0
    return lower, float(upper_ends(np.array(inside), samples, tail))


def share_to_show(required: float, samples: int, confidence: float, chance: float) -> float | None:
    """Return the minimum probability that ``samples`` demonstrate, with this chance, to be at least ``required``.

    It is demonstrated if its Clopper-Pearson interval starts at ``required`` or above; None if it never can.
    """
    rank = _smallest_rank_above(samples, required, (1 - confidence) / 2)
    return float(betaincinv(rank, samples - rank + 1, chance)) if rank <= samples else None


def upper_ends(inside: ArrayLike, samples: float, tail: float) -> Array:
    """Return one-sided Clopper-Pearson upper endpoints of probabilities, exceeded with probability ``tail``.

    ``inside`` are the numbers of samples inside, any shape, out of ``samples``.
    """
    counts = np.asarray(inside)
    outside = np.where(counts >= samples, 1, samples - counts)
    return np.where(counts >= samples, 1.0, betaincinv(counts + 1, outside, 1 - tail))


def _smallest_rank_above(samples: int, p: float, tail: float) -> int:
    """Return the smallest u with P(B ≥ u) ≤ tail; samples + 1 if there is none."""
    return 1 + bisect_left(range(1, samples + 1), True, key=lambda u: float(betainc(u, samples - u + 1, p)) <= tail)


_NONE: Final = 1e-9
"""Skewness below which the transformation is the identity, as its formula divides by the skewness."""


def studentised(normal: ArrayLike, skewness: ArrayLike) -> NDArray[np.float64]:
    """Return the studentised mean t that corresponds to a normal value z, for a mean of skewness a = γ/√N.

    Solves ``z = t + a t²/3 + a² t³/27 + a/6`` (Hall, Journal of the Royal Statistical Society B 54, 1992, 221) by ``(1
    + a t/3)³ = 1 + a (z - a/6)``.
    """
    a = np.asarray(skewness, dtype=float)
    shifted = np.asarray(normal, dtype=float) - a / 6
    skewed = np.abs(a) > _NONE
    return np.where(skewed, 3 * (np.cbrt(1 + a * shifted) - 1) / np.where(skewed, a, 1.0), shifted)


Interval = tuple[float, float]

# chosen such that the intervals of benchmarks/coverage.py, of heavy-tailed distributions too, cover at least 92 %
_FEWEST_FOR_MEAN: Final = 30
_FEWEST_FOR_VARIANCE: Final = 1000
"""Samples below which the skewness, and the tail index of the √N outermost samples, are too uncertain for an interval."""
_MOST_SKEWED: Final = 0.4
"""Largest skewness of a mean, γ/√N, for which an interval is given."""
_SKEWED_AWAY: Final = 0.5
"""Skewness of a mean at which the widened interval would be infinite."""
_LEAST_INDEX: Final = 3.5
"""Smallest tail index for which an interval of the variance is given; below 4 the fourth moment is infinite."""
_INDEX: Final = 4.2
"""Tail index at which the variance's interval is doubled in length."""
_SKETCH_ERROR: Final = 0.05
"""Largest relative difference of the variances from bins and from sums; beyond it the bins are too coarse."""


@dataclass(frozen=True, eq=False)
class Moments(Fixed):
    """Mean and variance of a set of samples with their intervals.

    Attributes:
        deviations, counts: ``(k,)`` bin centres minus the mean, and the samples in each bin.
        variance: Mean square deviation of the samples themselves, divisor N.
        skewness: Skewness of the values and of their squared deviations, from the laws; NaN if unknown.
    """

    deviations: Array
    counts: NDArray[np.int64]
    variance: float
    samples: int
    confidence: float
    skewness: tuple[float, float]

    @property
    def mean_interval(self) -> Interval | None:
        """Interval of the true mean relative to the sample mean, ``(below, above)``; None if unresolved."""
        if self.samples < _FEWEST_FOR_MEAN or not self._usable:
            return None
        if self.variance == 0:
            return (0.0, 0.0) if self.skewness[0] == 0 else None
        return _hall(self._mean_of_values, self.skewness[0], 1.0, self._quantile, self.samples)

    @cached_property
    def variance_interval(self) -> Interval | None:
        """Interval of the variance; None if unresolved."""
        if self.samples < _FEWEST_FOR_VARIANCE or not self._usable:
            return None
        if self.variance == 0:
            return (0.0, 0.0) if self.skewness[1] == 0 else None
        index = self._tail_index
        if index < _LEAST_INDEX:
            return None
        widening = 1 + (_INDEX / index) ** 4
        offsets = _hall(self._mean_of_squares, self.skewness[1], widening, self._quantile, self.samples)
        if offsets is None:
            return None
        return max(self.variance + offsets[0], 0.0), self.variance + offsets[1] + self.mean_half_width**2

    @property
    def mean_half_width(self) -> float:
        """Half-width of Student's interval of the mean, ignoring skewness."""
        return self._quantile * self._mean_of_values.error

    @property
    def standard_errors(self) -> float:
        """Larger half-width of the variance's interval, in standard errors; at least Student's quantile."""
        interval, error = self.variance_interval, self._mean_of_squares.error
        if interval is None or error == 0:
            return self._quantile
        above = interval[1] - self.mean_half_width**2 - self.variance
        return max((self.variance - interval[0]) / error, above / error, self._quantile)

    @property
    def fourth_moment(self) -> float:
        """Mean fourth power of the deviations."""
        return self._mean_of_squares.error**2 * self.samples + self.variance**2

    @cached_property
    def _usable(self) -> bool:
        """True if the bins reproduce the variance."""
        binned = _dot(self.counts, self.deviations**2) / self.samples
        return abs(binned - self.variance) <= _SKETCH_ERROR * self.variance

    @cached_property
    def _quantile(self) -> float:
        return float(stdtrit(self.samples - 1, (1 + self.confidence) / 2))

    @cached_property
    def _mean_of_values(self) -> _Mean:
        return _Mean.of(self.deviations, self.counts, self.samples)

    @cached_property
    def _mean_of_squares(self) -> _Mean:
        return _Mean.of(self.deviations**2, self.counts, self.samples)

    @property
    def _tail_index(self) -> float:
        """Hill's index of the √N samples farthest from the mean, minus its standard error."""
        outermost = math.ceil(math.sqrt(self.samples))
        order = np.argsort(-np.abs(self.deviations), kind="stable")
        distances, counts = np.abs(self.deviations)[order], self.counts[order]
        last = int(np.searchsorted(np.cumsum(counts), outermost))
        threshold = distances[last]
        if threshold == 0:
            return 0.0
        logarithms = _dot(counts[:last], np.log(distances[:last] / threshold)) / (outermost - 1)
        return (1 - 1 / math.sqrt(outermost)) / max(logarithms, 1e-9)


@dataclass(frozen=True)
class _Mean:
    """Standard error of a mean, and its skewness γ/√N."""

    error: float
    skewness: float

    @classmethod
    def of(cls, values: Array, counts: NDArray[np.int64], samples: int) -> _Mean:
        residuals = values - _dot(counts, values) / samples
        # scaled, so that no power of a tiny or huge number underflows or overflows
        largest = float(np.abs(residuals).max())
        if largest == 0:
            return cls(0.0, 0.0)
        scaled = residuals / largest
        square = _dot(counts, scaled**2) / samples
        third = _dot(counts, scaled**3) / samples
        return cls(largest * math.sqrt(square / samples), third / square**1.5 / math.sqrt(samples))


def _dot(counts: NDArray[np.int64], values: Array) -> float:
    """Return the sum of the values weighted by their counts, without BLAS, whose bits vary between processes."""
    return float((counts * values).sum())


def _hall(mean: _Mean, law_skewness: float, widening: float, quantile: float, samples: int) -> Interval | None:
    """Return Hall's interval relative to a mean, ``(below, above)``; None if the mean is too skewed."""
    skewness = mean.skewness
    # fmax ignores NaN, an unknown skewness
    largest_skewness = float(np.fmax(abs(skewness), abs(law_skewness) / math.sqrt(samples)))
    if largest_skewness > _MOST_SKEWED:
        return None
    half_width = quantile * widening / (1 - (largest_skewness / _SKEWED_AWAY) ** 2)
    below, above = (-mean.error * float(studentised(end, skewness)) for end in (half_width, -half_width))
    return min(below, 0.0), max(above, 0.0)


MOST_DIGITS = 6
"""Digits printed of an exactly known number, such as the largest sample; an error is rarely known to more."""

_ROUNDING: Final = 1e-9
"""Ratio of interval to number below which the number counts as exact."""
_EXACT_DIGITS: Final = 5
"""Place of the last digit of an interval without width, counted from the leading digit."""
_FINEST: Final = 17
"""Significant digits of a double."""


def significant_digits(value: float, half_width: float, *, most: int = MOST_DIGITS) -> int:
    """Return the number of significant digits, up to `most`, supported by the interval's half-width (0 if exact)."""
    if value == 0:
        return most if half_width == 0 else 0
    return max(0, _leading_place(value) - _last_place(value, half_width, most) + 1)


def format_supported(value: float | None, half_width: float | None, *, most: int = MOST_DIGITS) -> str:
    """Return the value with the digits that its interval supports; ``not resolved`` if either is None."""
    if value is None or half_width is None:
        return "not resolved"
    if value == 0 and half_width == 0:
        return "0"
    return _format_to_place(value, _last_place(value, half_width, most))


def format_inside(value: float | None, interval: tuple[float, float] | None, *, most: int = MOST_DIGITS) -> str:
    """Return the value with the supported digits, rounded to inside the interval; ``not resolved`` without one."""
    if value is None or interval is None:
        return "not resolved"
    half_width = max(value - interval[0], interval[1] - value)
    if half_width <= _ROUNDING * abs(value):
        return format_supported(value, 0.0, most=most)
    place = _last_place(value, half_width, _FINEST)
    finest = _leading_place(value) - _FINEST + 1 if value else place
    while place > finest and not interval[0] <= float(_format_to_place(value, place)) <= interval[1]:
        place -= 1
    return _format_to_place(value, place)


def round_end(end: float, digits: int, *, up: bool) -> float:
    """Return a finite bound rounded up or down to significant digits."""
    # its shortest decimal is rounded, so that 0.3, slightly less in binary, stays 0.3
    exact = Decimal(repr(float(end)))
    place = Decimal(1).scaleb(exact.adjusted() - digits + 1)
    return float(exact.quantize(place, ROUND_CEILING if up else ROUND_FLOOR))


def format_interval(low: float, high: float, per_si: float = 1.0) -> tuple[str, str]:
    """Return the endpoints of an interval with two digits of its width, rounded outwards."""
    # the factor `per_si` is applied in decimals, so that no endpoint moves inwards
    ends = [Decimal(end) * Decimal(per_si) for end in (low, high)]
    width = ends[1] - ends[0]
    place = Decimal(1).scaleb(width.adjusted() - 1 if width else ends[1].adjusted() - _EXACT_DIGITS)
    below, above = (end.quantize(place, mode) for end, mode in zip(ends, (ROUND_FLOOR, ROUND_CEILING), strict=True))
    return f"{below + 0:f}", f"{above + 0:f}"


def format_share(share: float, interval: tuple[float, float], required: float) -> tuple[str, str, str]:
    """Return a fraction and the endpoints of its interval in per cent, the endpoints rounded outwards."""
    # the decimals are those of the required fraction, and show at least two digits of the interval's width, so that the
    # texts agree with the verdict
    low, high = (Decimal(end) * 100 for end in interval)
    demand = Decimal(f"{100 * required:.10g}").normalize()
    decimals = max(1 - (high - low).adjusted(), -int(demand.as_tuple().exponent), 0)
    place = Decimal(1).scaleb(-decimals)
    inside = (Decimal(share) * 100).quantize(place, ROUND_HALF_EVEN)
    return f"{inside:f}", f"{low.quantize(place, ROUND_FLOOR):f}", f"{high.quantize(place, ROUND_CEILING):f}"


def _format_to_place(value: float, place: int) -> str:
    return f"{round(value, -place) + 0.0:.{max(0, -place)}f}"


def _leading_place(value: float) -> int:
    return math.floor(math.log10(abs(value)))


def _last_place(value: float, half_width: float, most: int) -> int:
    supported = math.ceil(math.log10(half_width / 5)) if half_width > 0 else -math.inf
    finest = _leading_place(value) - most + 1 if value != 0 else -math.inf
    return int(max(supported, finest))


@final
@dataclass(frozen=True)
class Estimate:
    """Sampled number with its interval."""

    value: float
    interval: tuple[float, float]

    @property
    def half_width(self) -> float:
        """Half the width of the interval."""
        return (self.interval[1] - self.interval[0]) / 2


def bound_text(bound: float) -> str:
    """Return a bound with one digit, rounded up."""
    return "0" if bound <= 0 else f"{round_end(bound, 1, up=True):.0e}"
