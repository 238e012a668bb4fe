"""The mode: peak of the histogram smoothed by a Gaussian."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

__all__ = ["Peak", "smoothed_peak"]

Array = NDArray[np.float64]

_STEPS_PER_BANDWIDTH = 16
_MOST_CELLS = 1 << 14
_REACH = 5.0


@final
@dataclass(frozen=True)
class Peak:
    """The peak of a smoothed histogram: its value, the smoothing's bandwidth, its half-width."""

    value: float
    bandwidth: float
    half_width: float


def smoothed_peak(
    *,
    cumulative: Callable[[Array], Array],
    samples: int,
    spread: float,
    quartiles: tuple[float, float],
    bulk: tuple[float, float],
    normal_factor: float,
    reflect_at_zero: bool,
) -> Peak | None:
    """Return the highest peak of the smoothed histogram, or None where the samples do not resolve it.

    Parameters
    ----------
    cumulative
        The samples' cumulative distribution.
    samples
        How many.
    spread
        Their standard deviation.
    quartiles, bulk
        First and third quartile; the range in which the mode is sought.
    normal_factor
        Standard errors in half an interval.
    reflect_at_zero
        Whether the quantity cannot be negative; the histogram is then mirrored at zero before it is
        smoothed, so that nothing leaks across the boundary.

    Notes
    -----
    Bandwidth: h = 0.969·s·N^(−1/7), s the smaller of std and IQR/1.349; of all powers of N this one is best for
    the place of a peak (it balances bias h² against variance 1/(N h³); the factor is the normal reference
    (4/5)^(1/7), Wand and Jones, Kernel Smoothing, 1995). The standard error of the peak is
    sqrt(f·R / (N h³)) / |f″| with R = ∫K′² = 1/(4√π) (Parzen, Ann. Math. Stat. 33, 1962). The peak is not
    resolved where its half-width, or the distance to a place whose density is not significantly lower (as
    in a uniform law), exceeds the standard deviation.
    """
    if spread == 0:
        return Peak(value=bulk[0], bandwidth=0.0, half_width=0.0)
    interquartile = quartiles[1] - quartiles[0]
    robust = min(spread, interquartile / 1.349) if interquartile > 0 else spread
    bandwidth = (4 / 5) ** (1 / 7) * robust * samples ** (-1 / 7)

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
    middles = np.arange(shares.size) * step + (lower if not mirrored else lower - cells * step) + step / 2

    sought = (middles >= max(bulk[0], 0.0 if mirrored else -math.inf)) & (middles <= bulk[1])
    if not sought.any():
        return None
    top = int(np.flatnonzero(sought)[np.argmax(density[sought])])
    aside = max(1, round(bandwidth / step))
    if not aside <= top < density.size - aside:
        return None
    curvature = (density[top - aside] - 2 * density[top] + density[top + aside]) / (aside * step) ** 2
    if curvature >= 0:
        return None
    error = math.sqrt(density[top] / (samples * bandwidth**3 * 4 * math.sqrt(math.pi))) / -curvature
    rivals = np.flatnonzero(sought & ~_clearly_below(density, top, middles, bandwidth, samples, normal_factor))
    if np.abs(middles[rivals] - middles[top]).max() > spread:
        return None
    half_width = float(normal_factor * error + bandwidth**2 / (2 * spread))
    if half_width > spread:
        return None
    return Peak(value=_summit(middles, density, top, mirrored), bandwidth=bandwidth, half_width=half_width)


def _clearly_below(
    density: Array, top: int, middles: Array, bandwidth: float, samples: int, normal_factor: float
) -> NDArray[np.bool_]:
    """Return where the density is lower than at the top by more than the noise of their difference.

    Two places of a density smoothed by a Gaussian have variances f/(2√π N h) and the correlation
    exp(−Δ²/4h²), Δ being their distance.
    """
    correlation = np.exp(-(((middles - middles[top]) / (2 * bandwidth)) ** 2))
    variance = density + density[top] - 2 * correlation * np.sqrt(density * density[top])
    noise = np.sqrt(np.maximum(variance, 0.0) / (2 * math.sqrt(math.pi) * samples * bandwidth))
    below: NDArray[np.bool_] = density[top] - density > normal_factor * noise
    return below


def _summit(middles: Array, density: Array, top: int, mirrored: bool) -> float:
    """Return the summit of the parabola through the highest cell and its neighbours."""
    left, centre, right = density[top - 1 : top + 2]
    bend = left - 2 * centre + right
    shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
    summit = float(middles[top] + shift * (middles[1] - middles[0]))
    return max(summit, 0.0) if mirrored else summit
