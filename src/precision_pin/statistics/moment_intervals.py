"""Intervals of mean and variance for laws that are not normal.

The variance is a mean as well, that of the squared deviations. The interval of a mean is Hall's (Journal of the Royal
Statistical Society B 54, 1992, 221-228): the central limit theorem with the skewness removed by a transformation, and
Student's quantile. The transformation leaves an error of the order of γ²/N. The quantile is therefore widened as γ/√N
grows, and no interval is given where γ/√N approaches 1/2, the skewness of a value decided by one sample in four.

A sample of a heavy-tailed law may contain none of the large values and then looks harmless. Two measures guard against
that: the skewness derived from the laws (`Plan.skewness`), and Hill's index of the tail (Annals of Statistics 3, 1975,
1163-1174). The index is estimated from the √N outermost samples and hardly varies from seed to seed. For a tail index of
4 or less the sample variance has no central limit theorem, and slightly above 4 it converges slowly. The interval is
widened as the index falls, and not given below 3.5. With fewer than a thousand samples the index is too uncertain.

The squared deviations are taken from the sample mean, which lies nearer to the samples than the true mean. Where the
squares hardly vary (two equally likely values) this difference dominates. The upper end is therefore raised by the
square of the mean's half-width.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.statistics.hall_transform import studentised

Interval = tuple[float, float]

_FEWEST_FOR_MEAN: Final = 30
_FEWEST_FOR_VARIANCE: Final = 1000
_MOST_SKEWED: Final = 0.4
"""Largest skewness of a mean, γ/√N, for which an interval is given."""
_SKEWED_AWAY: Final = 0.5
"""Skewness of a mean at which the widened interval would be infinite."""
_LEAST_INDEX: Final = 3.5
"""Smallest tail index for which an interval of the variance is given."""
_INDEX: Final = 4.2
"""Tail index at which the interval of the variance is doubled in length."""
_SKETCH_ERROR: Final = 0.05
"""Largest relative difference between the variance from the bins and from the sums; above it the bins are too coarse."""


@final
@dataclass(frozen=True, eq=False)
class Moments:
    """Mean and variance of a set of samples with their intervals.

    Attributes
    ----------
    deviations, counts
        ``(k,)`` bin centres minus the mean, and the number of samples in each bin.
    variance
        Mean square deviation of the samples themselves, divisor N.
    samples, confidence
        Number of samples; confidence of the intervals.
    skewness
        Skewness of the values and of their squared deviations, derived from the laws; NaN where unknown.
    """

    deviations: Array
    counts: NDArray[np.int64]
    variance: float
    samples: int
    confidence: float
    skewness: tuple[float, float]

    def __post_init__(self) -> None:
        fix_fields(self)

    @property
    def mean_interval(self) -> Interval | None:
        """Interval of the true mean relative to the sample mean, ``(below, above)``; None where not resolved."""
        if self.samples < _FEWEST_FOR_MEAN or not self._usable:
            return None
        if self.variance == 0:
            return (0.0, 0.0) if self.skewness[0] == 0 else None
        return _hall(self._mean_of_values, self.skewness[0], 1.0, self._quantile, self.samples)

    @cached_property
    def variance_interval(self) -> Interval | None:
        """Interval of the variance; None where not resolved."""
        if self.samples < _FEWEST_FOR_VARIANCE or not self._usable:
            return None
        if self.variance == 0:
            return (0.0, 0.0) if self.skewness[1] == 0 else None
        index = self._tail_index
        if index < _LEAST_INDEX:
            return None
        widening = 1 + (_INDEX / index) ** 4
        ends = _hall(self._mean_of_squares, self.skewness[1], widening, self._quantile, self.samples)
        if ends is None:
            return None
        return max(self.variance + ends[0], 0.0), self.variance + ends[1] + self.mean_half_width**2

    @property
    def mean_half_width(self) -> float:
        """Half-width of Student's interval of the mean, without regard to skewness."""
        return self._quantile * self._mean_of_values.error

    @property
    def standard_errors(self) -> float:
        """Half-width of the variance's interval on its farther side, in standard errors; at least Student's quantile."""
        ends, error = self.variance_interval, self._mean_of_squares.error
        if ends is None or error == 0:
            return self._quantile
        above = ends[1] - self.mean_half_width**2 - self.variance
        return max((self.variance - ends[0]) / error, above / error, self._quantile)

    @property
    def fourth_moment(self) -> float:
        """Mean fourth power of the deviations."""
        return self._mean_of_squares.error**2 * self.samples + self.variance**2

    @cached_property
    def _usable(self) -> bool:
        """True if the bins reproduce the variance of the sums."""
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
        nearest = distances[last]
        if nearest == 0:
            return 0.0
        logarithms = _dot(counts[:last], np.log(distances[:last] / nearest)) / (outermost - 1)
        return (1 - 1 / math.sqrt(outermost)) / max(logarithms, 1e-9)


@final
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
    """Return the sum of the values weighted by their counts; BLAS may give different bits in another process."""
    return float((counts * values).sum())


def _hall(mean: _Mean, known: float, widening: float, quantile: float, samples: int) -> Interval | None:
    """Return Hall's interval relative to a mean, ``(below, above)``; None where the mean is too skewed."""
    skewness = mean.skewness
    # fmax ignores NaN, an unknown skewness
    most = float(np.fmax(abs(skewness), abs(known) / math.sqrt(samples)))
    if most > _MOST_SKEWED:
        return None
    reach = quantile * widening / (1 - (most / _SKEWED_AWAY) ** 2)
    below, above = (-mean.error * float(studentised(end, skewness)) for end in (reach, -reach))
    return min(below, 0.0), max(above, 0.0)
