"""The law of one number, by its cumulative law and density; and the two in closed form: a normal number, and one part alone."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from scipy import optimize, special

from precision_pin.analyses.exact_law.quantile_bounds import quantile_bounds
from precision_pin.draws.laws.projection import Projection
from precision_pin.typing import Array

__all__ = ["FARTHEST", "ROUNDING", "NormalLaw", "NumberLaw", "SingleLaw"]


ROUNDING: Final = 1e-14
"""Bound of the rounding of a cumulative law in closed form."""

FARTHEST: Final = 9.0
"""Standard deviations beyond which a normal number is left out: probability 2.3e-19."""


class NumberLaw(ABC):
    """The law of one number.

    Attributes
    ----------
    mean
        Its mean.
    low, high
        What lies outside has a probability below the error.
    method
        How it is computed, in words.
    error
        Bound of the error of :meth:`cumulative`, rounding of x apart.
    """

    mean: float
    low: float
    high: float

    @property
    @abstractmethod
    def method(self) -> str:
        """The method of computation, in words."""

    @property
    @abstractmethod
    def error(self) -> float:
        """Bound of the error of :meth:`cumulative`."""

    @abstractmethod
    def cumulative(self, x: Array) -> Array:
        """Return P(number ≤ x), ``(N,)``."""

    @abstractmethod
    def density(self, x: Array) -> Array:
        """Return the density ``(N,)``, not-a-number where there is none."""

    @final
    def quantile(self, p: float) -> float:
        """Return the smallest value with at least this probability at or below it (0 < p < 1), by Brent's method."""

        def excess(x: float) -> float:
            return float(self.cumulative(np.array([x]))[0]) - p

        if excess(self.low) >= 0:
            return self.low
        if excess(self.high) <= 0:
            return self.high
        root: float = optimize.brentq(excess, self.low, self.high, xtol=1e-16 * (self.high - self.low), rtol=1e-15)
        return root

    @final
    def quantile_error(self, p: float) -> float:
        """Return the bound of :meth:`quantile`'s error."""
        return float(quantile_bounds(self, np.array([p]), np.array([self.quantile(p)]))[0])


@final
@dataclass(frozen=True)
class NormalLaw(NumberLaw):
    """A normal number."""

    mean: float
    std: float

    @property
    def low(self) -> float:  # type: ignore[override]
        """Nine standard deviations down."""
        return self.mean - FARTHEST * self.std

    @property
    def high(self) -> float:  # type: ignore[override]
        """Nine standard deviations up."""
        return self.mean + FARTHEST * self.std

    @property
    def method(self) -> str:
        """Closed form."""
        return "normal law"

    @property
    def error(self) -> float:
        """Rounding."""
        return ROUNDING

    def cumulative(self, x: Array) -> Array:
        """Return Φ((x - mean)/σ)."""
        value: Array = special.ndtr((x - self.mean) / self.std)
        return value

    def density(self, x: Array) -> Array:
        """Return φ((x - mean)/σ)/σ."""
        value: Array = np.exp(-(((x - self.mean) / self.std) ** 2) / 2) / (math.sqrt(2 * math.pi) * self.std)
        return value


@final
@dataclass(frozen=True, eq=False)
class SingleLaw(NumberLaw):
    """One part alone."""

    mean: float
    part: Projection

    @property
    def low(self) -> float:  # type: ignore[override]
        """The part's lower end."""
        return self.mean + self.part.ends[0]

    @property
    def high(self) -> float:  # type: ignore[override]
        """The part's upper end."""
        return self.mean + self.part.ends[1]

    @property
    def method(self) -> str:
        """Closed form."""
        return "closed form of one draw"

    @property
    def error(self) -> float:
        """Rounding."""
        return ROUNDING

    def cumulative(self, x: Array) -> Array:
        """Return the part's."""
        return self.part.cumulative(x - self.mean)

    def density(self, x: Array) -> Array:
        """Return the part's."""
        return self.part.density(x - self.mean)
