"""Base classes of similar laws."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arrays import Array
from precision_pin.draws.laws.law import Law


class BoundedLaw(Law):
    """A law of one number between two ends."""

    @property
    @abstractmethod
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest value."""

    def support(self, direction: ArrayLike) -> float:
        """Return h(w) = w·highest for w above zero, w·lowest below."""
        w = float(np.asarray(direction, dtype=float)[0])
        return max(w * end for end in self.ends)


class PlaneLaw(Law):
    """A law of two numbers with circular symmetry about the origin."""

    radius: float

    @property
    def size(self) -> int:
        """Two."""
        return 2

    @property
    def components(self) -> tuple[str, ...]:
        """``.x`` and ``.y``."""
        return (".x", ".y")

    @property
    def mean_vector(self) -> Array:
        """The origin, ``(2,)``."""
        return np.zeros(2)

    def support(self, direction: ArrayLike) -> float:
        """Return radius·|w|."""
        return self.radius * math.hypot(*np.asarray(direction, dtype=float))


class SymmetricLaw(Law):
    """A law of one number that is symmetric about its mean."""

    mean: float

    @property
    @abstractmethod
    def variance(self) -> float:
        """Variance."""

    @property
    @abstractmethod
    def reach(self) -> float:
        """Largest deviation from the mean, infinite if unbounded."""

    @abstractmethod
    def _deviation_characteristic(self, frequency: Array) -> Array:
        """Return E exp(i t (x - mean)), which is real by symmetry."""

    @property
    def mean_vector(self) -> Array:
        """Mean, ``(1,)``."""
        return np.array([self.mean])

    @property
    def covariance(self) -> Array:
        """Variance as ``(1, 1)``."""
        return np.array([[self.variance]])

    def support(self, direction: ArrayLike) -> float:
        """Return h(w) = w·mean + |w|·reach."""
        w = float(np.asarray(direction, dtype=float)[0])
        return w * self.mean + (abs(w) * self.reach if w else 0.0)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(i t x), t ``(1, …)``."""
        t = np.asarray(frequency, dtype=float)[0]
        value: NDArray[np.complex128] = np.exp(1j * t * self.mean) * self._deviation_characteristic(t)
        return value


@dataclass(frozen=True)
class HalfWidthLaw(SymmetricLaw):
    """A symmetric law on mean ± half_width; in a sheet the half-width is the value under the law's key."""

    half_width: float
    mean: float = 0.0

    @property
    def reach(self) -> float:
        """The half-width."""
        return self.half_width
