"""Mode of a law: peak of the histogram smoothed by a Gaussian, and an interval that contains the mode.

Smoothing shifts the peak of a skewed law by more than its standard error, so the interval is not derived from the
smoothed histogram. Of all windows of one width, the one with the most probability contains the mode of every unimodal
law, because the density falls on both sides of the mode. The interval is the union of all windows whose count is not
significantly smaller than the largest count (Bonferroni's correction for three simultaneous comparisons). It contains
the most probable window with more than the stated confidence. Nothing else is assumed about the law.

The mode is not resolved in three cases: the union is wider than 1.6 standard deviations (a flat law, or two equal
peaks); it reaches the smallest or largest sample (a law without peak; a norm with its mode at zero is allowed); or
narrower windows find the mode elsewhere (a spike).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from scipy.special import ndtri

from precision_pin.base.arrays import Array

_STEPS_PER_BANDWIDTH = 16
_MOST_CELLS = 1 << 14
_REACH = 5.0
"""Half-width of the smoothing Gaussian, in bandwidths."""

_WINDOW: Final = 2.5
"""Width of the windows, in spreads times N^(-1/5): this power of N gives the shortest interval."""
_STEPS_PER_WINDOW: Final = 16
_TESTS: Final = 3
"""Number of simultaneous comparisons: adjacent windows that can be nearly as full as the fullest one while the mode is
still resolved."""
_WIDEST: Final = 1.6
"""Longest interval reported, in standard deviations; a flat law is 3.5 of them wide, two equal peaks at least 2."""
_FINER: Final = (4, 16)
"""Factors by which the windows that search for spikes are narrower."""


@final
@dataclass(frozen=True)
class Peak:
    """Peak of a smoothed histogram, bandwidth of the smoothing, and interval of the mode."""

    value: float
    bandwidth: float
    lower: float
    upper: float


def smoothed_peak(
    *,
    cumulative: Callable[[Array], Array],
    samples: int,
    spread: float,
    quartiles: tuple[float, float],
    bulk: tuple[float, float],
    seen: tuple[float, float],
    confidence: float,
    reflect_at_zero: bool,
) -> Peak | None:
    """Return the highest peak of the smoothed histogram, or None where the samples do not resolve it.

    Parameters
    ----------
    cumulative
        Cumulative distribution of the samples.
    samples
        Number of samples.
    spread
        Standard deviation of the samples.
    quartiles, bulk, seen
        First and third quartile; the range in which the mode is searched; smallest and largest sample.
    confidence
        Confidence of the interval.
    reflect_at_zero
        True for a quantity that cannot be negative. The histogram is then mirrored at zero before it is
        smoothed, so that no probability leaks across the boundary.

    Notes
    -----
    The bandwidth is h = 0.969·s·N^(−1/7), with s the smaller of std and IQR/1.349. This power of N is the best one
    for the location of a peak: it balances bias h² against variance 1/(N h³). The factor is the normal reference
    (4/5)^(1/7) (Wand and Jones, Kernel Smoothing, 1995).
    """
    if spread == 0:
        return Peak(value=bulk[0], bandwidth=0.0, lower=bulk[0], upper=bulk[0])
    interquartile = quartiles[1] - quartiles[0]
    robust = min(spread, interquartile / 1.349) if interquartile > 0 else spread
    width = _WINDOW * robust * samples ** (-1 / 5)
    sought = (max(bulk[0] - width, 0.0) if reflect_at_zero else bulk[0] - width, bulk[1] + width)
    likely = _likeliest_interval(cumulative, sought, width, samples, confidence)
    if likely is None or likely[1] - likely[0] > _WIDEST * spread:
        return None
    at_zero = reflect_at_zero and seen[0] < width
    if (likely[0] - seen[0] < width / 2 and not at_zero) or seen[1] - likely[1] < width / 2:
        return None
    for finer in _FINER:
        spike = _likeliest_interval(cumulative, sought, width / finer, samples, confidence)
        if spike is not None and (spike[0] > likely[1] or spike[1] < likely[0]):
            return None
    bandwidth = (4 / 5) ** (1 / 7) * robust * samples ** (-1 / 7)
    value = _find_smoothed_peak(cumulative, bulk, bandwidth, reflect_at_zero=reflect_at_zero)
    return Peak(value, bandwidth, min(likely[0], value), max(likely[1], value))


def _likeliest_interval(
    cumulative: Callable[[Array], Array], sought: tuple[float, float], width: float, samples: int, confidence: float
) -> tuple[float, float] | None:
    """Return the union of the windows that may hold the most probability; None where there are too many windows."""
    step = width / _STEPS_PER_WINDOW
    cells = math.ceil((sought[1] - sought[0]) / step)
    if not _STEPS_PER_WINDOW < cells <= _MOST_CELLS:
        return None
    edges: Array = sought[0] + step * np.arange(cells + 1, dtype=float)
    below = cumulative(edges) * samples
    held = below[_STEPS_PER_WINDOW:] - below[:-_STEPS_PER_WINDOW]
    best = int(np.argmax(held))
    starts = np.arange(held.size)
    # samples in the overlap of two windows do not contribute to the difference of their counts
    shared_from, shared_to = np.maximum(starts, best), np.minimum(starts, best) + _STEPS_PER_WINDOW
    shared = np.where(shared_to > shared_from, below[shared_to] - below[np.minimum(shared_from, cells)], 0.0)
    critical = -float(ndtri((1 - confidence) / (2 * _TESTS)))
    apart = np.maximum(held[best] + held - 2 * shared, 0.0)
    alike = np.flatnonzero(held[best] - held <= critical * np.sqrt(apart))
    return float(edges[alike[0]]), float(edges[alike[-1] + _STEPS_PER_WINDOW])


def _find_smoothed_peak(
    cumulative: Callable[[Array], Array], bulk: tuple[float, float], bandwidth: float, *, reflect_at_zero: bool
) -> float:
    """Return the value at which the smoothed histogram is highest within the bulk."""
    lower = bulk[0] - _REACH * bandwidth
    upper = bulk[1] + _REACH * bandwidth
    mirrored = reflect_at_zero and lower <= 0
    if mirrored:
        lower = 0.0
    cells = min(math.ceil((upper - lower) / bandwidth * _STEPS_PER_BANDWIDTH), _MOST_CELLS)
    edges = np.linspace(lower, upper, cells + 1)
    step = (upper - lower) / cells
    shares = np.diff(cumulative(edges))
    if mirrored:
        shares = np.concatenate((shares[::-1], shares))

    reach = max(1, math.ceil(_REACH * bandwidth / step))
    offsets = np.arange(-reach, reach + 1) * step
    kernel = np.exp(-0.5 * (offsets / bandwidth) ** 2) / (bandwidth * math.sqrt(2 * math.pi))
    density = np.convolve(shares, kernel, mode="full")[reach : reach + shares.size]
    middles: Array = (
        np.arange(shares.size, dtype=float) * step + (lower if not mirrored else lower - cells * step) + step / 2
    )
    within = (middles >= max(bulk[0] - step, 0.0 if mirrored else -math.inf)) & (middles <= bulk[1] + step)
    top = int(np.flatnonzero(within)[np.argmax(density[within])])
    return _summit(middles, density, min(max(top, 1), density.size - 2), mirrored)


def _summit(middles: Array, density: Array, top: int, mirrored: bool) -> float:
    """Return the vertex of the parabola through the highest cell and its neighbours."""
    left, centre, right = density[top - 1 : top + 2]
    bend = left - 2 * centre + right
    shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
    summit = float(middles[top] + shift * (middles[1] - middles[0]))
    return max(summit, 0.0) if mirrored else summit
