"""Distribution of one quantity, as far as the samples resolve it.

The mode is the peak of the histogram smoothed by a Gaussian. Smoothing shifts the peak of a skewed distribution by more
than its standard error, so the mode's interval is computed differently. Among all windows of one width, the window with
maximum probability contains the mode of every unimodal distribution. The interval is the union of all windows whose
count is not significantly below the largest (Bonferroni's correction for three comparisons), which contains the most
probable window with more than the stated confidence.

The mode is not resolved if the union is wider than 1.6 standard deviations (a flat distribution, or two equal peaks),
if it reaches the smallest or largest sample (a distribution without peak; a norm may have its mode at zero), or if
narrower windows find another mode (a spike).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from precision_pin.base.arguments import check_number, check_quantities, check_quantity, check_whole
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.statistics.intervals import (
    Moments,
    quantile_ranks,
    significant_digits,
    tolerance_ranks,
    upper_bound_rank,
)
from precision_pin.statistics.plan import si_quantity

NORM_LEVELS: Final = (0.5, 0.95, 0.99, 0.9973)
"""Probabilities of the quantiles reported of a norm; 0.9973 is the fraction within ±3σ of a normal distribution."""
COMPONENT_LEVELS: Final = (0.00135, 0.01, 0.05, 0.5, 0.95, 0.99, 0.9973)
"""Probabilities of the quantiles reported of a component: two-sided, as ±3σ and the upper levels of a norm."""

CONTENTS: Final = (0.95, 0.99, 0.9973)
"""Fractions of all robots for which tolerance bounds are reported: the upper levels of the quantiles."""

_FEWEST_FOR_MODE: Final = 100
"""Samples below which no mode is sought: with 200 samples of a normal distribution the interval is already too wide."""
_MOST_BARS: Final = 100
"""Bars of a drawn histogram, each still 4 pixels wide in a figure of 400."""

_STEPS_PER_BANDWIDTH = 16
"""Cells in a bandwidth: the parabola through three cells finds the peak within a small fraction of the bandwidth."""
_MOST_CELLS = 1 << 14
"""Cells of the smoothed histogram: limits the convolution to some ms if the bulk spans thousands of bandwidths."""
_REACH = 5.0
"""Half-width of the smoothing Gaussian, in bandwidths; its tails beyond hold 6e-7."""

_WINDOW: Final = 2.5
"""Width of the windows, in spreads times N^(-1/5): this power of N gives the shortest interval."""
_STEPS_PER_WINDOW: Final = 16
"""Positions of a window per width: the interval's ends are multiples of 1/16 of the width, small next to the width."""
_TESTS: Final = 3
"""Simultaneous comparisons: neighbouring windows that can be almost as full as the fullest if the mode is resolved."""
_WIDEST: Final = 1.6
"""Longest interval reported, in standard deviations; a uniform one is 3.5 wide, two equal peaks are at least 2 apart."""
_FINER: Final = (4, 16)
"""Factors by which the windows that detect spikes are narrower; narrower ones hold too few samples to differ."""


def resolved(
    quantile: Callable[[float], float | None],
    p: float | Sequence[float] | Array,
    quantity: str,
    samples: int,
    confidence: float,
) -> float | Array:
    """Return one quantile or several of a function that returns None where the samples do not resolve one; raise there."""
    values, levels = [], np.atleast_1d(np.asarray(p, dtype=object)).tolist()
    if not levels:
        raise InputError("no probability of a quantile is given")
    for level in levels:
        value = quantile(level)
        if value is None:
            # P(all samples lie on one side of the quantile) is to be at most half of what the interval may miss
            needed = math.ceil(math.log((1 - confidence) / 2) / math.log(max(level, 1 - level)))
            raise InputError(
                f"{samples:,} samples do not resolve the {100 * level:.10g} % quantile of {quantity} at {confidence:.0%} "
                f"confidence; it takes {needed:,}"
            )
        values.append(value)
    return values[0] if np.ndim(p) == 0 else np.array(values)


@dataclass(frozen=True, eq=False)
class Histogram(Record):
    """Histogram to draw: ``(k + 1,)`` ascending edges (m or rad) and ``(k,)`` densities (1/m or 1/rad)."""

    edges: Array
    density: Array


@dataclass(frozen=True, eq=False)
class Distribution(Record):
    """Sampled distribution of one quantity, m or rad.

    Built by `precision_pin.statistics.finish`. Numbers that the samples do not resolve are None.

    Attributes:
        quantity: Name of the quantity, such as ``position.norm``.
        std: Sample standard deviation, divisor N − 1; None for a single sample.
        min, max: Smallest and largest *sampled* value; not bounds.
        bin_lower, bin_upper: ``(k,)`` edges of the occupied bins of the sketch, clipped to `min` and `max`.
        bin_cumulative: ``(k,)`` samples up to and including each occupied bin.
        skewness: Skewness of the value and of its squared deviation from the mean, from the laws; NaN if unknown.
    """

    KEYS: ClassVar[Keys] = ("mean", "std", "min", "max", "mode", "*_entries")

    quantity: str
    samples: int
    confidence: float
    mean: float
    std: float | None
    min: float
    max: float
    bin_lower: Array = field(repr=False)
    bin_upper: Array = field(repr=False)
    bin_cumulative: NDArray[np.int64] = field(repr=False)
    skewness: tuple[float, float] = field(default=(math.nan, math.nan), repr=False)

    @property
    def is_norm(self) -> bool:
        """True for a norm, which is never negative."""
        return self.quantity.endswith(".norm")

    @property
    def levels(self) -> tuple[float, ...]:
        """Probabilities of the reported quantiles."""
        return NORM_LEVELS if self.is_norm else COMPONENT_LEVELS

    # quantiles ---------------------------------------------------------------------------------------

    @overload
    def quantile(self, p: float) -> float: ...
    @overload
    def quantile(self, p: Sequence[float] | Array) -> Array: ...
    def quantile(self, p: float | Sequence[float] | Array) -> float | Array:
        """Return the p-quantile as :meth:`resolved_quantile`, or those of several probabilities.

        Raises:
            InputError: A probability is not between 0 and 1, or the samples do not resolve its quantile.
        """
        return resolved(self.resolved_quantile, p, self.quantity, self.samples, self.confidence)

    def resolved_quantile(self, p: float) -> float | None:
        """Return the p-quantile; None if the samples do not resolve it (no interval exists).

        Interpolates linearly between order statistics at rank 1 + (N − 1) p (numpy's default), each placed in its bin
        of the sketch by its rank. The error against the quantile of the samples is at most one bin: 2⁻⁹ of the distance
        from the planned centre, or 2⁻¹² of the planned scale if larger (`Plan`). Raises InputError unless 0 < p < 1.
        """
        return None if quantile_ranks(self.samples, _level(p), self.confidence) is None else self._quantile(p)

    def quantile_interval(self, p: float) -> tuple[float, float] | None:
        """Return the distribution-free interval of the p-quantile, 0 < p < 1, out to bin edges; None if unresolved."""
        return self._between(quantile_ranks(self.samples, _level(p), self.confidence))

    def quantile_error(self, p: float) -> float | None:
        """Return the largest difference of `quantile` from the quantile of the samples; None if unresolved.

        This is the error of the sketch alone, without the sampling error. Raises InputError unless 0 < p < 1.
        """
        if self.resolved_quantile(p) is None:
            return None
        position = (self.samples - 1) * p
        below = min(math.floor(position), self.samples - 1)
        errors = []
        for rank in (below + 1, min(below + 2, self.samples)):
            value, (lower, upper) = self._order_statistic(rank), self._outward(rank)
            errors.append(max(value - lower, upper - value))
        return errors[0] + (position - below) * (errors[1] - errors[0])

    def quantile_upper_bound(self, p: float) -> float | None:
        """Return the one-sided upper bound of the p-quantile; None with fewer samples than Wilks' number.

        With p = 0.9973: "at this confidence, at least 99.73 % of all units stay below". Raises InputError unless 0 < p
        < 1.
        """
        rank = upper_bound_rank(self.samples, _level(p), self.confidence)
        return None if rank is None else self._outward(rank)[1]

    def tolerance_interval(self, content: float) -> tuple[float, float] | None:
        """Return the interval that holds this fraction (0 to 1) of all units with the stated confidence (Wilks)."""
        return self._between(tolerance_ranks(self.samples, _level(content), self.confidence))

    def tolerance_bounds(self, content: float) -> tuple[float, float] | None:
        """Return bounds between which this fraction of all units lies with the stated confidence (Wilks).

        For a norm these are zero and `quantile_upper_bound`, for a component the ends of `tolerance_interval`. Raises
        InputError unless 0 < content < 1.
        """
        if not self.is_norm:
            return self.tolerance_interval(content)
        upper = self.quantile_upper_bound(content)
        return None if upper is None else (0.0, upper)

    # probabilities -----------------------------------------------------------------------------------

    def cdf(self, value: float | str) -> float:
        """Return the fraction of samples at or below a value, interpolated inside its bin of the sketch."""
        return float(self.cumulative(np.array([check_quantity("value", value, si_quantity(self.quantity))]))[0])

    def cumulative(self, values: ArrayLike) -> Array:
        """Return `cdf` for an array of values."""
        points = check_quantities("values", values, si_quantity(self.quantity))
        # linear within every occupied bin, constant between bins
        edges = np.stack((self.bin_lower, self.bin_upper), axis=1).ravel()
        counts = np.stack((self._before, self.bin_cumulative), axis=1).ravel()
        inner = np.interp(points, edges, counts) / self.samples
        return np.where(points >= self.max, 1.0, np.where(points < self.min, 0.0, inner))

    def probability_inside(self, limit: float | str) -> float:
        """Return the fraction of samples with |value| ≤ limit, interpolated inside the bins."""
        limit = check_quantity("limit", limit, si_quantity(self.quantity))
        if limit < 0:
            return 0.0
        return self.cdf(limit) - (self.cdf(-limit) if self.min < -limit else 0.0)

    def histogram(self, bars: int | None = None) -> Histogram | None:
        """Return a histogram to draw, from `min` to `max`; None if all samples are equal.

        By default the bar width is 2·IQR·N^(−1/3) (Freedman and Diaconis, 1981), with at least 1 + log₂ N bars
        (Sturges, 1926) and at most 100.
        """
        span = self.max - self.min
        if span == 0:
            return None
        if bars is not None:
            check_whole("bars", bars, 1, 10**6)
        else:
            sturges_bars = 1 + math.ceil(math.log2(self.samples))
            width = 2 * (self._quantile(0.75) - self._quantile(0.25)) * self.samples ** (-1 / 3)
            freedman_bars = math.ceil(span / width) if width > span / _MOST_BARS else _MOST_BARS
            bars = min(max(sturges_bars, freedman_bars), _MOST_BARS)
        edges = np.linspace(self.min, self.max, bars + 1)
        shares = self.cumulative(edges)
        shares[0] = 0.0
        return Histogram(edges, np.diff(shares) / np.diff(edges))

    # moments and mode --------------------------------------------------------------------------------

    @property
    def mode(self) -> float | None:
        """Peak of the smoothed histogram; None if the samples do not resolve one, or are fewer than 100."""
        return None if self._peak is None else self._peak.value

    @property
    def mode_bandwidth(self) -> float | None:
        """Standard deviation of the Gaussian that smooths the histogram for the mode."""
        return None if self._peak is None else self._peak.bandwidth

    def mean_interval(self) -> tuple[float, float] | None:
        """Return Hall's interval of the mean; None below 30 samples or if the distribution is too skewed."""
        offsets = self.moments.mean_interval
        return None if offsets is None else (self.mean + offsets[0], self.mean + offsets[1])

    def variance_interval(self) -> tuple[float, float] | None:
        """Return the interval of the variance; None below 1,000 samples or if the tail is too heavy."""
        return self.moments.variance_interval

    def std_interval(self) -> tuple[float, float] | None:
        """Return the square roots of `variance_interval`; None if it is not resolved."""
        variances = self.variance_interval()
        if variances is None or self.std is None:
            return None
        return min(math.sqrt(variances[0]), self.std), max(math.sqrt(variances[1]), self.std)

    def mode_interval(self) -> tuple[float, float] | None:
        """Return an interval that contains the mode of every unimodal distribution; None if it is not resolved."""
        return None if self._peak is None else (self._peak.lower, self._peak.upper)

    # intervals and digits by name of the statistic ---------------------------------------------------

    def interval(self, statistic: str | float) -> tuple[float, float] | None:
        """Return the interval of a statistic of `half_width`, None if unresolved; raise UnknownNameError for others."""
        value, interval = self.value_and_interval(statistic)
        return None if value is None else interval

    def half_width(self, statistic: str | float) -> float | None:
        """Return the distance of a statistic from the farther endpoint of its interval; None if unresolved.

        Args:
            statistic: ``mean``, ``std``, ``mode``, ``min``, ``max`` (half-width 0: sampled values) or the probability
                of a quantile.

        Raises:
            UnknownNameError: There is no such statistic.
        """
        value, interval = self.value_and_interval(statistic)
        return None if value is None or interval is None else max(value - interval[0], interval[1] - value)

    def resolution(self, statistic: str | float) -> int | None:
        """Return the supported significant digits of a statistic of `half_width`, at most six; None if unresolved."""
        value, half_width = self.value_and_interval(statistic)[0], self.half_width(statistic)
        return None if value is None or half_width is None else significant_digits(value, half_width)

    @property
    def _entries(self) -> dict[str, Any]:
        by_level = {
            "quantiles": self.resolved_quantile,
            "quantile_interval": self.quantile_interval,
            "quantile_error": self.quantile_error,
        }
        return {
            **{key: {level: method(level) for level in self.levels} for key, method in by_level.items()},
            **{f"{name}_interval": self.interval(name) for name in ("mean", "std", "mode")},
            "tolerance_bounds": {content: self.tolerance_bounds(content) for content in CONTENTS},
        }

    def value_and_interval(self, statistic: str | float) -> tuple[float | None, tuple[float, float] | None]:
        """Return a statistic of `half_width`, None if unresolved, and its interval; raise UnknownNameError for others."""
        if not isinstance(statistic, str):
            return self.resolved_quantile(statistic), self.quantile_interval(statistic)
        if statistic in ("mean", "std", "mode"):
            return getattr(self, statistic), getattr(self, f"{statistic}_interval")()
        if statistic in ("min", "max"):
            value = getattr(self, statistic)
            return value, (value, value)
        raise UnknownNameError("statistic", statistic, ("mean", "std", "mode", "min", "max"))

    # private -----------------------------------------------------------------------------------------

    @cached_property
    def _before(self) -> NDArray[np.int64]:
        return np.concatenate((np.zeros(1, dtype=np.int64), self.bin_cumulative[:-1]))

    @cached_property
    def moments(self) -> Moments:
        """Mean and variance, for their intervals."""
        return Moments(
            deviations=(self.bin_lower + self.bin_upper) / 2 - self.mean,
            counts=self.bin_cumulative - self._before,
            variance=0.0 if self.std is None else self.std**2 * (self.samples - 1) / self.samples,
            samples=self.samples,
            confidence=self.confidence,
            skewness=self.skewness,
        )

    def _bin(self, rank: int) -> int:
        return int(np.searchsorted(self.bin_cumulative, rank, side="left"))

    def _order_statistic(self, rank: int) -> float:
        """Return the estimate of the rank-th smallest sample (from 1), interpolated inside its bin."""
        if rank == 1:
            return self.min
        if rank == self.samples:
            return self.max
        index = self._bin(rank)
        share = (rank - self._before[index] - 0.5) / (self.bin_cumulative[index] - self._before[index])
        return float(self.bin_lower[index] + share * (self.bin_upper[index] - self.bin_lower[index]))

    def _outward(self, rank: int) -> tuple[float, float]:
        """Return a lower and an upper bound of the rank-th smallest sample."""
        index = self._bin(rank)
        # value − centre was rounded before binning: widen by one unit in the last place on each side
        lower = float(np.nextafter(self.bin_lower[index], -np.inf))
        upper = float(np.nextafter(self.bin_upper[index], np.inf))
        return max(lower, self.min), min(upper, self.max)

    def _between(self, ranks: tuple[int, int] | None) -> tuple[float, float] | None:
        return None if ranks is None else (self._outward(ranks[0])[0], self._outward(ranks[1])[1])

    def _quantile(self, p: float) -> float:
        position = (self.samples - 1) * p
        below = min(math.floor(position), self.samples - 1)
        lower = self._order_statistic(below + 1)
        upper = self._order_statistic(min(below + 2, self.samples))
        return lower + (position - below) * (upper - lower)

    @cached_property
    def _peak(self) -> Peak | None:
        """The highest peak of the smoothed histogram; None if the samples do not resolve it."""
        # A norm's histogram is mirrored at zero first, so that no probability leaks across the boundary. The bandwidth
        # is h = 0.969·s·N^(−1/7), with s the smaller of std and IQR/1.349. This power of N is optimal for the location
        # of a peak: it balances bias h² against variance 1/(N h³). The factor is the normal reference (4/5)^(1/7) (Wand
        # and Jones, Kernel Smoothing, 1995).
        spread, samples = self.std, self.samples
        if spread is None or samples < _FEWEST_FOR_MODE:
            return None
        bulk = self._quantile(0.005), self._quantile(0.995)
        if spread == 0:
            return Peak(value=bulk[0], bandwidth=0.0, lower=bulk[0], upper=bulk[0])
        interquartile = self._quantile(0.75) - self._quantile(0.25)
        robust = min(spread, interquartile / 1.349) if interquartile > 0 else spread
        width = _WINDOW * robust * samples ** (-1 / 5)
        search_range = (max(bulk[0] - width, 0.0) if self.is_norm else bulk[0] - width, bulk[1] + width)
        interval = self._likeliest_interval(search_range, width)
        if interval is None or interval[1] - interval[0] > _WIDEST * spread:
            return None
        at_zero = self.is_norm and self.min < width
        if (interval[0] - self.min < width / 2 and not at_zero) or self.max - interval[1] < width / 2:
            return None
        for divisor in _FINER:
            spike = self._likeliest_interval(search_range, width / divisor)
            if spike is not None and (spike[0] > interval[1] or spike[1] < interval[0]):
                return None
        bandwidth = (4 / 5) ** (1 / 7) * robust * samples ** (-1 / 7)
        value = self._find_smoothed_peak(bulk, bandwidth)
        return Peak(value, bandwidth, min(interval[0], value), max(interval[1], value))

    def _likeliest_interval(self, search_range: tuple[float, float], width: float) -> tuple[float, float] | None:
        """Return the union of the windows that may be the most probable; None if there are too many windows."""
        step = width / _STEPS_PER_WINDOW
        cells = math.ceil((search_range[1] - search_range[0]) / step)
        if not _STEPS_PER_WINDOW < cells <= _MOST_CELLS:
            return None
        edges: Array = search_range[0] + step * np.arange(cells + 1, dtype=float)
        below = self.cumulative(edges) * self.samples
        window_counts = below[_STEPS_PER_WINDOW:] - below[:-_STEPS_PER_WINDOW]
        best = int(np.argmax(window_counts))
        starts = np.arange(window_counts.size)
        # samples in the overlap of two windows do not contribute to the difference of their counts
        begin, end = np.maximum(starts, best), np.minimum(starts, best) + _STEPS_PER_WINDOW
        overlap = np.where(end > begin, below[end] - below[np.minimum(begin, cells)], 0.0)
        critical = -float(ndtri((1 - self.confidence) / (2 * _TESTS)))
        separate_counts = np.maximum(window_counts[best] + window_counts - 2 * overlap, 0.0)
        candidates = np.flatnonzero(window_counts[best] - window_counts <= critical * np.sqrt(separate_counts))
        return float(edges[candidates[0]]), float(edges[candidates[-1] + _STEPS_PER_WINDOW])

    def _find_smoothed_peak(self, bulk: tuple[float, float], bandwidth: float) -> float:
        """Return the value at which the smoothed histogram is highest within the bulk."""
        lower, upper = bulk[0] - _REACH * bandwidth, bulk[1] + _REACH * bandwidth
        is_mirrored = self.is_norm and lower <= 0
        lower = 0.0 if is_mirrored else lower
        cells = min(math.ceil((upper - lower) / bandwidth * _STEPS_PER_BANDWIDTH), _MOST_CELLS)
        edges = np.linspace(lower, upper, cells + 1)
        step = (upper - lower) / cells
        shares = np.diff(self.cumulative(edges))
        if is_mirrored:
            shares = np.concatenate((shares[::-1], shares))

        half_width = max(1, math.ceil(_REACH * bandwidth / step))
        offsets = np.arange(-half_width, half_width + 1) * step
        kernel = np.exp(-0.5 * (offsets / bandwidth) ** 2) / (bandwidth * math.sqrt(2 * math.pi))
        density = np.convolve(shares, kernel, mode="full")[half_width : half_width + shares.size]
        middles: Array = (
            np.arange(shares.size, dtype=float) * step + (lower if not is_mirrored else lower - cells * step) + step / 2
        )
        within = (middles >= max(bulk[0] - step, 0.0 if is_mirrored else -math.inf)) & (middles <= bulk[1] + step)
        cell = int(np.flatnonzero(within)[np.argmax(density[within])])
        # the vertex of the parabola through the highest cell and its neighbours
        cell = min(max(cell, 1), density.size - 2)
        left, centre, right = density[cell - 1 : cell + 2]
        curvature = left - 2 * centre + right
        shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
        vertex = float(middles[cell] + shift * (middles[1] - middles[0]))
        return max(vertex, 0.0) if is_mirrored else vertex


def _level(p: float) -> float:
    return check_number("the probability of a quantile", p, "above 0 and below 1", lambda share: 0 < share < 1)


@dataclass(frozen=True)
class Peak:
    """Peak of a smoothed histogram, bandwidth of the smoothing, and interval of the mode."""

    value: float
    bandwidth: float
    lower: float
    upper: float
