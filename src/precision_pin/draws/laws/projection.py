"""The projection of a draw on one direction: the random number ``z = w·(x - mean)``.

Each projection has its cumulative law and density in closed form, a smooth parametrisation to integrate along, and a
non-increasing bound of its characteristic function. This bound certifies the truncation error of an inversion.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.draws.laws.numerics import in_chunks


class Projection(ABC):
    """The number along one direction of a law, of zero mean (of any mean for :class:`Lines`).

    The parametrisation: z = position(s) with the probability weight(s) ds, s from the first to the last of ``breaks``,
    both functions smooth between the breaks.
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
        """Values between which the cumulative law is smooth and its slope varies little."""
        return self.ends

    @abstractmethod
    def cumulative(self, z: Array) -> Array:
        """Return P(number ≤ z)."""

    @abstractmethod
    def density(self, z: Array) -> Array:
        """Return the density; not-a-number where it has none."""

    @abstractmethod
    def position(self, s: Array) -> Array:
        """Return the value at a parameter, a non-decreasing function."""

    @abstractmethod
    def weight(self, s: Array) -> Array:
        """Return the density of the parameter."""

    @abstractmethod
    def parameter(self, z: Array) -> Array:
        """Return the parameter of a value; a value beyond an end has the parameter of that end."""

    @abstractmethod
    def envelope(self, frequency: Array) -> Array:
        """Return a bound of |E exp(i ω z)| that does not increase with ω."""

    @abstractmethod
    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        """Return E exp(i ω z), from deviations alone, so that a mean far larger than the spread costs no digits."""

    @property
    def characteristic_error(self) -> float:
        """Bound of the error of :meth:`characteristic`, without that of rounding ω."""
        return 1e-15

    def within(self, score: float) -> tuple[float, float]:
        """Return limits outside which lies no more probability than outside ± ``score`` of a standard normal law."""
        del score
        return self.ends

    @property
    def is_bounded(self) -> bool:
        """True if nothing lies beyond the ends."""
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
        scaled: Array = np.clip(z / self.reach, -1.0, 1.0)
        return scaled

    def limit_to_reach(self, z: Array, density: Array) -> Array:
        """Return the density, zero beyond the reach."""
        value: Array = np.where(np.abs(z) < self.reach, density, 0.0)
        return value


@final
@dataclass(frozen=True, eq=False)
class Lines(Projection):
    """A projection of uniform pieces and single values: of empirical and two-point laws and of rows of a table.

    Attributes
    ----------
    shares
        Probability of each piece, ``(s,)``.
    begins, stops
        Lower and upper end of each, rising, ``(s,)``; equal for a single value.
    """

    shares: Array
    begins: Array
    stops: Array

    def __post_init__(self) -> None:
        fix_fields(self)

    @classmethod
    def of(cls, shares: Array, begins: Array, stops: Array) -> Lines:
        """Return the pieces in rising order."""
        low, high = np.minimum(begins, stops), np.maximum(begins, stops)
        order = np.lexsort((high, low))
        return cls(shares[order], low[order], high[order])

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest value."""
        return float(self.begins[0]), float(self.stops[-1])

    @property
    def breaks(self) -> tuple[float, ...]:
        """0, 1 and the probabilities at which pieces meet."""
        return (0.0, *np.cumsum(self.shares)[:-1].tolist(), 1.0)

    @property
    def kinks(self) -> tuple[float, ...]:
        """The ends of the pieces."""
        return tuple(np.unique(np.concatenate([self.begins, self.stops])).tolist())

    @property
    def has_jumps(self) -> bool:
        """True if some value has a probability of its own."""
        return bool((self.begins == self.stops).any())

    def cumulative(self, z: Array) -> Array:
        """Return P(number ≤ z)."""
        ahead = z[..., None] - self.begins
        length = self.stops - self.begins
        passed = np.where(length > 0, np.clip(ahead / np.where(length > 0, length, 1.0), 0, 1), ahead >= 0)
        value: Array = passed @ self.shares
        return value

    def density(self, z: Array) -> Array:
        """Return the density; not-a-number where any value has a probability of its own."""
        if self.has_jumps:
            return np.full_like(z, np.nan)
        inside = (z[..., None] >= self.begins) & (z[..., None] < self.stops)
        value: Array = inside @ (self.shares / (self.stops - self.begins))
        return value

    def position(self, s: Array) -> Array:
        """Return the quantile at s."""
        firsts = np.array(self.breaks[:-1])
        k = np.clip(np.searchsorted(firsts, s, side="right") - 1, 0, firsts.size - 1)
        along = np.clip((s - firsts[k]) / self.shares[k], 0, 1)
        value: Array = self.begins[k] + along * (self.stops[k] - self.begins[k])
        return value

    def weight(self, s: Array) -> Array:
        """Return 1."""
        return np.ones_like(s)

    def parameter(self, z: Array) -> Array:
        """Return the cumulative probability."""
        return self.cumulative(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        """Return the sum over the pieces."""
        halves, middles = (self.stops - self.begins) / 2, (self.stops + self.begins) / 2

        def of(part: Array) -> NDArray[np.complex128]:
            turned = np.sinc(part.T * halves / np.pi) * np.exp(1j * part.T * middles)
            value: NDArray[np.complex128] = turned @ self.shares
            return value

        return in_chunks(of, frequency[None], 4 * halves.size)

    @property
    def characteristic_error(self) -> float:
        """Bound of the error of the sum over all pieces."""
        return 1e-15 + 1.2e-16 * self.shares.size

    def envelope(self, frequency: Array) -> Array:
        """Σ share · min(1, 2/(length ω)): the bound of each piece, 1 for a single value."""
        lengths = (self.stops - self.begins) / 2
        bounds = np.array([power_bound(1.0, 1.0, length * frequency) for length in lengths])
        value: Array = np.tensordot(self.shares, bounds, axes=1)
        return np.minimum(value, 1.0)


def power_bound(factor: float, power: float, z: Array) -> Array:
    """Return min(1, factor z^-power)."""
    value: Array = np.minimum(1.0, factor * np.maximum(z, 1e-300 ** (1 / max(power, 1.0))) ** -power)
    return value
