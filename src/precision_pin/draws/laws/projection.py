"""Projection of a draw on one direction, the random value ``z = w·(x - mean)``, and numerics shared by laws.

A projection has a cumulative distribution and density in closed form, a smooth parametrisation for integrals, and a
non-increasing bound of its characteristic function, which certifies the truncation error of an inversion.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array, Fixed
from precision_pin.draws import lazy_special


class Projection(ABC):
    """The value along one direction of a law, with zero mean (any mean for :class:`Lines`).

    Parametrised as z = position(s) with the probability weight(s) ds, s from the first to the last of ``breaks``; both
    functions are smooth between the breaks.
    """

    @property
    @abstractmethod
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest value."""

    @property
    @abstractmethod
    def breaks(self) -> tuple[float, ...]:
        """Ends and kinks of the parameter, in rising order."""

    @property
    def kinks(self) -> tuple[float, ...]:
        """Values between which the cumulative distribution is smooth with little change of slope."""
        return self.ends

    @abstractmethod
    def cumulative(self, z: Array) -> Array:
        """Return P(value ≤ z)."""

    @abstractmethod
    def density(self, z: Array) -> Array:
        """Return the density; NaN if there is none."""

    @abstractmethod
    def position(self, s: Array) -> Array:
        """Return the value at a parameter, a non-decreasing function."""

    @abstractmethod
    def weight(self, s: Array) -> Array:
        """Return the density of the parameter."""

    @abstractmethod
    def parameter(self, z: Array) -> Array:
        """Return the parameter of a value; beyond an end, the parameter of the end."""

    @abstractmethod
    def envelope(self, frequency: Array) -> Array:
        """Return a bound of |E exp(i ω z)| that does not increase with ω."""

    @abstractmethod
    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        """Return E exp(i ω z), computed from deviations, so that a mean far larger than the spread costs no digits."""

    @property
    def characteristic_error(self) -> float:
        """Bound of the error of :meth:`characteristic`, without the rounding of ω."""
        return 1e-15

    def within(self, score: float) -> tuple[float, float]:
        """Return bounds outside which the probability is at most that outside ± ``score`` of a standard normal law."""
        return self.ends

    @property
    def is_bounded(self) -> bool:
        """True if the probability beyond the ends is zero."""
        return True


@dataclass(frozen=True)
class SymmetricProjection(Projection):
    """A projection symmetric about zero, within ± its reach."""

    reach: float

    @property
    def ends(self) -> tuple[float, float]:
        """Minus and plus the reach."""
        return -self.reach, self.reach

    def scale_to_reach(self, z: Array) -> Array:
        """Return z over the reach, limited to ±1."""
        return np.clip(z / self.reach, -1.0, 1.0)

    def limit_to_reach(self, z: Array, density: Array) -> Array:
        """Return the density, zero beyond the reach."""
        return np.where(np.abs(z) < self.reach, density, 0.0)


@dataclass(frozen=True, eq=False)
class Lines(Fixed, Projection):
    """Uniform pieces and discrete values: projection of empirical and two-point laws and of rows of a table.

    Attributes:
        shares: Probability of each piece, ``(s,)``.
        begins, stops: Lower and upper end of each, ascending, ``(s,)``; equal for a discrete value.
    """

    shares: Array
    begins: Array
    stops: Array

    @classmethod
    def of(cls, shares: Array, begins: Array, stops: Array) -> Lines:
        """Return the pieces in ascending order."""
        low, high = np.minimum(begins, stops), np.maximum(begins, stops)
        order = np.lexsort((high, low))
        return cls(shares[order], low[order], high[order])

    @property
    def ends(self) -> tuple[float, float]:
        return float(self.begins[0]), float(self.stops[-1])

    @property
    def breaks(self) -> tuple[float, ...]:
        return (0.0, *np.cumsum(self.shares)[:-1].tolist(), 1.0)

    @property
    def kinks(self) -> tuple[float, ...]:
        return tuple(np.unique(np.concatenate([self.begins, self.stops])).tolist())

    def cumulative(self, z: Array) -> Array:
        ahead = z[..., None] - self.begins
        length = self.stops - self.begins
        passed = np.where(length > 0, np.clip(ahead / np.where(length > 0, length, 1.0), 0, 1), ahead >= 0)
        return passed @ self.shares

    def density(self, z: Array) -> Array:
        """Return the density; NaN if there is a discrete value."""
        if (self.begins == self.stops).any():
            return np.full_like(z, np.nan)
        inside = (z[..., None] >= self.begins) & (z[..., None] < self.stops)
        return inside @ (self.shares / (self.stops - self.begins))

    def position(self, s: Array) -> Array:
        firsts = np.array(self.breaks[:-1])
        k = np.clip(np.searchsorted(firsts, s, side="right") - 1, 0, firsts.size - 1)
        along = np.clip((s - firsts[k]) / self.shares[k], 0, 1)
        return self.begins[k] + along * (self.stops[k] - self.begins[k])

    def weight(self, s: Array) -> Array:
        return np.ones_like(s)

    def parameter(self, z: Array) -> Array:
        return self.cumulative(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        halves, middles = (self.stops - self.begins) / 2, (self.stops + self.begins) / 2

        def of(part: Array) -> NDArray[np.complex128]:
            waves = np.sinc(part.T * halves / np.pi) * np.exp(1j * part.T * middles)
            return waves @ self.shares

        return in_chunks(of, frequency[None], 4 * halves.size)

    @property
    def characteristic_error(self) -> float:
        """Bound of the error of the sum over all pieces."""
        return 1e-15 + 1.2e-16 * self.shares.size

    def envelope(self, frequency: Array) -> Array:
        """Σ share · min(1, 2/(length ω)): the bound of each piece, 1 for a discrete value."""
        lengths = (self.stops - self.begins) / 2
        bounds = np.array([power_bound(1.0, 1.0, length * frequency) for length in lengths])
        value: Array = np.tensordot(self.shares, bounds, axes=1)
        return np.minimum(value, 1.0)


def power_bound(factor: float, power: float, z: Array) -> Array:
    """Return min(1, factor z^-power)."""
    return np.minimum(1.0, factor * np.maximum(z, 1e-300 ** (1 / max(power, 1.0))) ** -power)


FARTHEST_NORMAL: Final = 8.6
"""Largest normal number drawn, in standard deviations, rounded up: Box-Muller of the smallest uniform number, 2⁻⁵³."""

LAST_UNIFORM: Final = 1 - 2.0**-53
"""Largest uniform number drawn; the smallest is as far from zero."""

Moments = tuple[float, float, float]
"""E ζ³, E ζ⁴ of standardised components and E ζ_k² ζ_l² of two of them."""

NORMAL_MOMENTS: Final[Moments] = (0.0, 3.0, 1.0)
"""Moments of independent standard normal components."""

_PANELS: Final = 36
"""Panels of the quadrature over normal scores, before splitting at the breaks: each is 0.48 standard deviations wide."""

_CHUNK: Final = 2**20
"""Numbers that :func:`in_chunks` holds in memory at once: 16 MiB of complex numbers."""


def in_chunks(
    function: Callable[[Array], NDArray[np.complex128]], frequency: Array, width: int
) -> NDArray[np.complex128]:
    """Return ``function``: ``(m, T) → (T,)`` at frequencies ``(m, …)``, in chunks, at ``width`` numbers a column."""
    flat = frequency.reshape(frequency.shape[0], -1)
    step = max(1, _CHUNK // max(width, 1))
    parts = [function(flat[:, first : first + step]) for first in range(0, flat.shape[1], step)]
    return np.concatenate([np.zeros(0, dtype=complex), *parts]).reshape(frequency.shape[1:])


def triangular_root(covariance: Array) -> Array:
    """Return the lower-triangular L with L Lᵀ the covariance; a dependent component gets a zero column."""
    root = np.zeros_like(covariance)
    for k in range(len(covariance)):
        pivot = covariance[k, k] - root[k, :k] @ root[k, :k]
        if pivot > 1e-14 * covariance[k, k]:
            root[k, k] = math.sqrt(pivot)
            root[k + 1 :, k] = (covariance[k + 1 :, k] - root[k + 1 :, :k] @ root[k, :k]) / root[k, k]
    return root


def moments_of(values: Array, weights: Array) -> Moments:
    """Return the moments of weighted values; normal moments if they do not vary."""
    deviations = values - weights @ values
    variance = float(weights @ deviations**2)
    if variance <= 0:
        return NORMAL_MOMENTS
    third, fourth = (float(weights @ deviations**power) / variance ** (power / 2) for power in (3, 4))
    return third, fourth, 1.0


def moments_by_quadrature(at_scores: Callable[[Array], Array], breaks: Sequence[float]) -> Moments:
    """Return the moments of a component from its values at normal scores, by Gauss-Legendre panels.

    ``at_scores`` maps scores ``(1, N)`` to values ``(1, N)``; panels are split at ``breaks``, the uniform numbers at
    which the values have jumps or kinks.
    """
    z, weights, _ = score_panels(breaks, 16)
    return moments_of(at_scores(z.reshape(1, -1))[0], weights.ravel())


def score_panels(breaks: Sequence[float], count: int) -> tuple[Array, Array, Array]:
    """Return normal scores ``(panels, count)``, their probabilities and the panels' edges, split at the breaks."""
    bends = lazy_special.ndtri(np.array(breaks, dtype=float))
    bends = bends[np.abs(bends) < FARTHEST_NORMAL]
    edges = np.union1d(np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, _PANELS + 1), bends)
    half = np.diff(edges)[:, None] / 2
    nodes, shares = np.polynomial.legendre.leggauss(count)
    z = edges[:-1, None] + half * (nodes + 1)
    return z, half * shares * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), edges


def cumulants_of(values: Array, weights: Array) -> Array:
    """Return the 2nd, 3rd, 4th and 6th cumulant ``(4, size)`` of values ``(N, size)`` with weights ``(N,)``."""
    # sums, not BLAS, whose bits vary between processes
    residuals = values - (weights[:, None] * values).sum(axis=0)
    m2, m3, m4, m6 = ((weights[:, None] * residuals**power).sum(axis=0) for power in (2, 3, 4, 6))
    return np.stack([m2, m3, m4 - 3 * m2**2, m6 - 15 * m4 * m2 - 10 * m3**2 + 30 * m2**3])
