"""What follows from the quantile function of a law of one number alone: moments, its projection, straight lines.

The normal scores from -8.6 to 8.6 are cut into panels, where the law jumps or bends and otherwise evenly. Of the density
in each panel a Legendre series in the value is kept, whose coefficients are integrals over the scores; no inversion is
needed. The wave exp(iωx) has a Legendre series with spherical Bessel functions as coefficients (Rayleigh), so that the
characteristic function costs the same at every frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Final, final

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.draws import lazy_special
from precision_pin.draws.laws.projection import FARTHEST_NORMAL, LAST_UNIFORM, Projection, score_panels

if TYPE_CHECKING:
    from precision_pin.draws.laws.law import Law

_NODES: Final = 24
"""Scores in each panel."""

_TERMS: Final = 20
"""Terms of the Legendre series in each panel."""

_SLOW: Final = 10.0
"""Phase across half a panel up to which the wave is summed over the scores, beyond by its Legendre series."""

_NARROW: Final = 1e-7
"""Width of a panel in standard deviations below which rounding leaves no series; its density is taken as constant."""

_LEVELS: Final = 100
_MARGIN: Final = 1.05
"""Levels at which a density is cut off for the bound of its characteristic function; margin for the spread in a cell."""

_LINE_ERROR: Final = 1e-7
"""Largest distance of the straight lines from the quantile function, in standard deviations."""

_MOST_LINES: Final = 2**17


@lru_cache(maxsize=256)
def mean_and_variance(law: Law) -> tuple[float, float]:
    """Return mean and variance of a law of one number, to 13 digits of the largest value: the rest is rounding."""
    z, weights, _ = score_panels(law.breaks, _NODES)
    values, shares = _values(law, z).ravel(), weights.ravel() / weights.sum()
    mean = float(shares @ values)
    digits = 12 - math.floor(math.log10(float(np.abs(values).max()) or 1.0))
    return round(mean, digits) + 0.0, float(f"{shares @ (values - mean) ** 2:.13g}")


def _values(law: Law, scores: Array) -> Array:
    """Return a law's values at normal scores; beyond the last uniform number, 1 - 2⁻⁵³, that number's value."""
    if law.variates == "uniform":
        scores = np.minimum(scores, lazy_special.ndtri(LAST_UNIFORM))
    value: Array = law.at_scores(scores.reshape(1, -1))[0].reshape(scores.shape)
    return value


@final
@dataclass(frozen=True, eq=False)
class Series:
    """Legendre series of the density of a law of one number, about its mean.

    Attributes
    ----------
    points, weights
        Values and their probabilities, ``(panels, nodes)``.
    low, high
        Ends of the panels, ``(panels,)``.
    moments
        E of the Legendre polynomials in each panel, ``(panels, terms)``; zero of all but the first in a narrow panel.
    cells
        Density in cells of rising values, ``(cells,)``, zero in gaps, infinite for values with a probability of their own.
    shares
        Probability of each cell, ``(cells,)``.
    """

    points: Array
    weights: Array
    low: Array
    high: Array
    moments: Array
    cells: Array
    shares: Array

    def __post_init__(self) -> None:
        fix_fields(self)

    @cached_property
    def half(self) -> Array:
        """Half the length of each panel."""
        return (self.high - self.low) / 2

    @cached_property
    def middle(self) -> Array:
        """Middle of each panel."""
        return (self.high + self.low) / 2

    @cached_property
    def coefficients(self) -> Array:
        """Of the density in each panel, over -1 to 1: ``(panels, terms)``."""
        value: Array = self.moments * (np.arange(_TERMS) + 0.5)
        return value

    @cached_property
    def integrals(self) -> Array:
        """Of the probability below a value in each panel: ``(panels, terms + 1)``."""
        value: Array = np.asarray(legendre.legint(self.coefficients, lbnd=-1, axis=1), dtype=float)
        value[:, 0] += np.cumsum(self.moments[:, 0]) - self.moments[:, 0]
        return value

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Levels of the density: probability above each, and variation of the density cut off there."""
        finite = self.cells[np.isfinite(self.cells) & (self.cells > 0)]
        levels = np.geomspace(np.median(finite) / 100, finite.max(), _LEVELS) if finite.size else np.zeros(0)
        inverse = np.divide(1.0, self.cells, out=np.zeros_like(self.cells), where=self.cells > 0)
        above = np.array([self.shares @ np.maximum(1 - level * inverse, 0) for level in levels])
        ended = np.concatenate([[0.0], self.cells, [0.0]])
        turns = np.array([np.abs(np.diff(np.minimum(ended, level))).sum() for level in levels])
        return above, turns * _MARGIN


@lru_cache(maxsize=64)
def series_of(law: Law) -> Series | None:
    """Return the series of a law of one number; None if its samples do not rise with their uniform numbers."""
    z, weights, edges = score_panels(law.breaks, _NODES)
    mean, scale = float(law.mean_vector[0]), math.sqrt(law.covariance[0, 0])
    # just inside the panels: at an edge the law may jump
    cuts = np.linspace(edges[:-1] + 1e-12, edges[1:] - 1e-12, _NODES + 1, axis=1)
    points, values = _values(law, z) - mean, _values(law, cuts) - mean
    # the farthest panels, too narrow to be resolved, hold less than rounding changes
    seen = (weights.sum(axis=1) > 1e-13) | (values[:, -1] - values[:, 0] > _NARROW * scale)
    points, weights, cuts, values = points[seen], weights[seen] / weights[seen].sum(), cuts[seen], values[seen]
    if (np.diff(points.ravel()) < -1e-9 * scale).any():
        return None
    gaps = values[1:, 0] - values[:-1, -1] > 1e-9 * scale
    values[:-1, -1] = np.where(gaps, values[:-1, -1], values[1:, 0])
    low, high = values[:, 0].copy(), values[:, -1].copy()
    half = (high - low) / 2
    wide = half > _NARROW * scale
    place = np.clip((points - (low + half)[:, None]) / np.where(wide, half, 1.0)[:, None], -1, 1)
    moments = np.einsum("pk,pkn->pn", weights, legendre.legvander(place, _TERMS - 1))
    moments[~wide, 1:] = 0.0
    shares = np.abs(np.diff(lazy_special.ndtr(-np.abs(cuts)), axis=1))
    shares = np.where((cuts[:, :-1] < 0) & (cuts[:, 1:] > 0), np.diff(lazy_special.ndtr(cuts), axis=1), shares)
    widths = np.diff(values, axis=1)
    cells = np.divide(shares, widths, out=np.full_like(widths, np.inf), where=widths > 0)
    ends = np.append(np.where(gaps, 0.0, cells[:-1, -1]), cells[-1, -1])
    cells, shares = np.column_stack([cells, ends]), np.column_stack([shares, np.zeros(len(shares))])
    return Series(points, weights, low, high, moments, cells.ravel(), shares.ravel())


@final
@dataclass(frozen=True, eq=False)
class DerivedProjection(Projection):
    """Projection of a law of one number by the series of its density."""

    law: Law
    size: float
    series: Series

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of the support; of a law without an end the farthest value that is drawn."""
        mean = float(self.law.mean_vector[0])
        low, high = self.law.interval(0)
        low, high = sorted((self.size * (low - mean), self.size * (high - mean)))
        return low, high

    @property
    def breaks(self) -> tuple[float, ...]:
        bends = np.sign(self.size) * lazy_special.ndtri(np.array(self.law.breaks, dtype=float))
        even = np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, 13)
        return tuple(np.union1d(even, bends[np.abs(bends) < FARTHEST_NORMAL]).tolist())

    @property
    def kinks(self) -> tuple[float, ...]:
        return tuple(self.position(np.array(self.breaks)).tolist())

    def _panels(self, z: Array) -> tuple[Array, NDArray[np.intp], Array]:
        """Return deviations, the panel of each and its place there, -1 to 1."""
        x = z / self.size
        k = np.clip(np.searchsorted(self.series.low, x, side="right") - 1, 0, None)
        half = self.series.half[k]
        single = np.where(x >= self.series.low[k], 1.0, -1.0)
        place = np.where(half > 0, (x - self.series.middle[k]) / np.where(half > 0, half, 1.0), single)
        return x, k, np.clip(place, -1, 1)

    def cumulative(self, z: Array) -> Array:
        _, k, place = self._panels(z)
        below = np.clip(legendre.legval(place, np.moveaxis(self.series.integrals[k], -1, 0), tensor=False), 0, 1)
        value: Array = np.asarray(below if self.size > 0 else 1 - below, dtype=float)
        return value

    def density(self, z: Array) -> Array:
        if self.series.moments[self.series.half == 0, 0].sum() > _NARROW:
            return np.full_like(z, np.nan)
        x, k, place = self._panels(z)
        value = legendre.legval(place, np.moveaxis(self.series.coefficients[k], -1, 0), tensor=False)
        inside = (x >= self.series.low[k]) & (x <= self.series.high[k])
        result: Array = np.where(inside, np.maximum(value, 0) / (self.series.half[k] * abs(self.size)), 0.0)
        return result

    def position(self, s: Array) -> Array:
        scores = np.sign(self.size) * s
        result: Array = self.size * (_values(self.law, scores) - self.law.mean_vector[0])
        return result

    def weight(self, s: Array) -> Array:
        value: Array = np.exp(-(s**2) / 2) / np.sqrt(2 * np.pi)
        return value

    def parameter(self, z: Array) -> Array:
        value: Array = np.clip(lazy_special.ndtri(self.cumulative(z)), -FARTHEST_NORMAL, FARTHEST_NORMAL)
        return value

    @property
    def is_bounded(self) -> bool:
        return bool(np.isfinite(self.law.support([1.0]) + self.law.support([-1.0])))

    def within(self, score: float) -> tuple[float, float]:
        low, high = self.position(np.array([-score, score]))
        return self.ends if self.is_bounded else (float(low), float(high))

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        omega = np.asarray(frequency, dtype=float).ravel() * self.size
        value = np.zeros(omega.size, dtype=complex)
        powers = (2 * np.arange(_TERMS) + 1) * 1j ** np.arange(_TERMS)
        narrow = (self.series.moments[:, 1:] == 0).all(axis=1)
        for panel, (half, middle) in enumerate(zip(self.series.half, self.series.middle, strict=True)):
            slow = np.flatnonzero((np.abs(omega) * half < _SLOW) | narrow[panel])
            step = max(1, 2**20 // _NODES)
            for some in (slow[first : first + step] for first in range(0, slow.size, step)):
                value[some] += (
                    np.exp(1j * np.outer(omega[some], self.series.points[panel])) @ self.series.weights[panel]
                )
            fast = np.setdiff1d(np.arange(omega.size), slow, assume_unique=True)
            z = omega[fast] * half
            before, bessel = np.cos(z) / z, np.sin(z) / z
            total = np.zeros(fast.size, dtype=complex)
            for n, factor in enumerate(powers * self.series.moments[panel]):
                total += factor * bessel
                before, bessel = bessel, (2 * n + 1) / z * bessel - before
            value[fast] += total * np.exp(1j * omega[fast] * middle)
        return value.reshape(np.shape(frequency))

    @property
    def characteristic_error(self) -> float:
        """Measured against closed forms, and the size of the last terms."""
        return 1e-12 + 5.0 * float(np.abs(self.series.moments[:, -2:]).sum())

    def envelope(self, frequency: Array) -> Array:
        """Return the least of the bounds P(density above c) + V_c/ω, with V_c the variation of the density cut off at c."""
        omega = abs(self.size) * np.asarray(frequency, dtype=float)
        bound = np.ones_like(omega)
        for above, turn in zip(*self.series.bounds, strict=True):
            bound = np.minimum(bound, above + turn / np.maximum(omega, 1e-200))
        return bound


@lru_cache(maxsize=64)
def straight_lines(law: Law) -> Array | None:
    """Return lines ``(k, 4)`` close to the quantile function of a law of uniform numbers: begin, value, slope, end value.

    None if the law's samples do not rise with their uniform numbers, or more than 131,072 lines would be needed.
    """
    scale = math.sqrt(law.covariance[0, 0])
    edges = np.union1d(np.linspace(0, 1, 257), np.array(law.breaks, dtype=float))
    while True:
        # just inside the ends: at an edge the law may jump; 0 and 1 are never drawn
        u = np.stack([np.nextafter(edges[:-1], 2), (edges[:-1] + edges[1:]) / 2, np.nextafter(edges[1:], -1)])
        begin, middle, end = law.sample(np.clip(u, 1 - LAST_UNIFORM, LAST_UNIFORM).reshape(1, -1))[0].reshape(u.shape)
        bent = np.abs(middle - (begin + end) / 2) > _LINE_ERROR * scale
        bent &= np.diff(edges) > 2.0**-48
        if not bent.any() or edges.size > _MOST_LINES:
            break
        edges = np.union1d(edges, u[1][bent])
    rising = np.diff(np.stack([begin, end], axis=1).ravel()) >= -1e-9 * scale
    if bent.any() or not rising.all():
        return None
    lines: Array = np.column_stack([edges[:-1], begin, (end - begin) / np.diff(edges), end])
    return lines
