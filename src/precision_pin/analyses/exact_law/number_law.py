"""Law of one number by cumulative law and density, with the two closed forms: a normal number and a single part."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from scipy import optimize, special

from precision_pin.analyses.exact_law.quantile_bounds import quantile_bounds
from precision_pin.base.arrays import Array
from precision_pin.draws.laws.projection import Projection

ROUNDING: Final = 1e-14
"""Bound of the rounding error of a cumulative law in closed form."""

FARTHEST: Final = 9.0
"""Number of standard deviations beyond which a normal law is neglected: probability 2.3e-19."""


class NumberLaw(ABC):
    """Law of one number.

    Attributes
    ----------
    mean
        Mean of the number.
    low, high
        Ends of the law; the probability outside is below the error.
    method
        Method of computation, as text.
    error
        Bound of the error of :meth:`cumulative`, except the rounding of x.
    """

    mean: float
    low: float
    high: float

    @property
    @abstractmethod
    def method(self) -> str:
        """Method of computation, as text."""

    @property
    @abstractmethod
    def error(self) -> float:
        """Bound of the error of :meth:`cumulative`."""

    @abstractmethod
    def cumulative(self, x: Array) -> Array:
        """Return P(number ≤ x), ``(N,)``."""

    @abstractmethod
    def density(self, x: Array) -> Array:
        """Return the density ``(N,)``, NaN where there is none."""

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
        """Return the error bound of :meth:`quantile`."""
        return float(quantile_bounds(self, np.array([p]), np.array([self.quantile(p)]))[0])


@final
@dataclass(frozen=True)
class NormalLaw(NumberLaw):
    """Law of a normal number."""

    mean: float
    std: float

    @property
    def low(self) -> float:  # type: ignore[override]
        """Nine standard deviations below the mean."""
        return self.mean - FARTHEST * self.std

    @property
    def high(self) -> float:  # type: ignore[override]
        """Nine standard deviations above the mean."""
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
    """Law of a single part."""

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
        """Return the cumulative law of the part."""
        return self.part.cumulative(x - self.mean)

    def density(self, x: Array) -> Array:
        """Return the density of the part."""
        return self.part.density(x - self.mean)
