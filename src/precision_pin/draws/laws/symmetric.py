"""Laws of one number that are symmetric about their mean."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.draws import lazy_special
from precision_pin.draws.laws.law import FARTHEST_NORMAL, Array, Law, take_number, take_size
from precision_pin.inputs.arguments import check_number

__all__ = ["Arcsine", "Fixed", "Normal", "Triangular", "TruncatedNormal", "Uniform"]

_NOT_NEGATIVE: Final = "zero or more and finite"
SMALLEST_K: Final = 1e-3
"""Smallest k of a truncated normal law; its samples are exact to 1e-16/k of its half-width."""


class _ScalarLaw(Law):
    """Of one number: symmetric about its mean."""

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


@final
@dataclass(frozen=True)
class Fixed(_ScalarLaw):
    """A number that does not vary, kept as a parameter so that derivatives to it exist."""

    mean: float

    def __post_init__(self) -> None:
        take_number(self, "mean", "the value of a fixed law")

    @property
    def variance(self) -> float:
        """Zero."""
        return 0.0

    @property
    def reach(self) -> float:
        """Zero."""
        return 0.0

    def sample(self, variates: Array) -> Array:
        """Return the value throughout."""
        return np.full_like(variates, self.mean)

    def _deviation_characteristic(self, frequency: Array) -> Array:
        return np.ones_like(frequency)


@final
@dataclass(frozen=True)
class Uniform(_ScalarLaw):
    """Uniform on mean ± half_width."""

    half_width: float
    mean: float = 0.0

    def __post_init__(self) -> None:
        take_size(self, "half_width", "the half-width of a uniform law")
        take_number(self, "mean", "the mean of a uniform law")

    @property
    def variance(self) -> float:
        """t²/3."""
        return self.half_width**2 / 3

    @property
    def reach(self) -> float:
        """The half-width."""
        return self.half_width

    def sample(self, variates: Array) -> Array:
        """Return mean + t (2u - 1)."""
        return self.mean + self.half_width * (2 * variates - 1)

    def _deviation_characteristic(self, frequency: Array) -> Array:
        value: Array = np.sinc(frequency * self.half_width / np.pi)
        return value


@final
@dataclass(frozen=True)
class Triangular(_ScalarLaw):
    """Symmetric triangle on mean ± half_width."""

    half_width: float
    mean: float = 0.0

    def __post_init__(self) -> None:
        take_size(self, "half_width", "the half-width of a triangular law")
        take_number(self, "mean", "the mean of a triangular law")

    @property
    def variance(self) -> float:
        """t²/6."""
        return self.half_width**2 / 6

    @property
    def reach(self) -> float:
        """The half-width."""
        return self.half_width

    @property
    def breaks(self) -> tuple[float, ...]:
        """One half: the density bends there."""
        return (0.5,)

    def sample(self, variates: Array) -> Array:
        """Return the inverse of the cumulative law, from the nearer end."""
        tail = np.minimum(variates, 1 - variates)
        deviation: Array = np.copysign(1 - np.sqrt(2 * tail), variates - 0.5)
        return self.mean + self.half_width * deviation

    def _deviation_characteristic(self, frequency: Array) -> Array:
        value: Array = np.sinc(frequency * self.half_width / (2 * np.pi)) ** 2
        return value


@final
@dataclass(frozen=True)
class Normal(_ScalarLaw):
    """Normal of standard deviation ``std``."""

    variates: ClassVar[Literal["uniform", "normal"]] = "normal"
    std: float
    mean: float = 0.0

    def __post_init__(self) -> None:
        take_size(self, "std", "the standard deviation of a normal law")
        take_number(self, "mean", "the mean of a normal law")

    @classmethod
    def from_half_width(cls, half_width: float, mean: float = 0.0, *, k: float = 3.0) -> Normal:
        """Return the law whose half-width is k standard deviations."""
        half = check_number("the half-width of a normal law", half_width, _NOT_NEGATIVE, lambda value: value >= 0)
        return cls(half / check_number("k", k, "positive and finite", lambda value: value > 0), mean)

    @property
    def variance(self) -> float:
        """σ²."""
        return self.std**2

    @property
    def reach(self) -> float:
        """Infinite, unless σ is zero."""
        return math.inf if self.std else 0.0

    def interval(self, number: int) -> tuple[float, float]:
        """Return mean ± 8.6 σ."""
        del number
        return self.mean - FARTHEST_NORMAL * self.std, self.mean + FARTHEST_NORMAL * self.std

    def sample(self, variates: Array) -> Array:
        """Return mean + σ z."""
        return self.mean + self.std * variates

    def _deviation_characteristic(self, frequency: Array) -> Array:
        value: Array = np.exp(-((self.std * frequency) ** 2) / 2)
        return value


@final
@dataclass(frozen=True)
class TruncatedNormal(_ScalarLaw):
    """Normal of standard deviation ``std`` before truncation, cut off at mean ± k·std."""

    std: float
    mean: float = 0.0
    k: float = 3.0

    def __post_init__(self) -> None:
        take_size(self, "std", "the standard deviation of a truncated normal law")
        take_number(self, "mean", "the mean of a truncated normal law")
        allowed = f"finite and at least {SMALLEST_K} (cut off closer to its mean the law is uniform)"
        k = check_number("k of a truncated normal law", self.k, allowed, lambda value: value >= SMALLEST_K)
        object.__setattr__(self, "k", k)

    @property
    def variance(self) -> float:
        """σ² (1 - 2kφ(k) / (2Φ(k) - 1)), as the ratio of the chi-square laws of 3 and 1 at k² (no cancellation)."""
        square = self.k**2 / 2
        return self.std**2 * float(lazy_special.gammainc(1.5, square) / lazy_special.gammainc(0.5, square))

    @property
    def reach(self) -> float:
        """k·σ."""
        return self.k * self.std

    def sample(self, variates: Array) -> Array:
        """Return the inverse of the cumulative law, from the nearer end (so that it is symmetric)."""
        tail = np.minimum(variates, 1 - variates)
        cut = lazy_special.ndtr(-self.k)
        score = lazy_special.ndtri(cut + tail * math.erf(self.k / math.sqrt(2)))
        deviation: Array = np.copysign(np.minimum(-score, self.k), variates - 0.5)
        return self.mean + self.std * deviation

    def _deviation_characteristic(self, frequency: Array) -> Array:
        s, k = self.std * frequency, self.k
        faddeeva = lazy_special.wofz((1j * k - s) / math.sqrt(2))
        value: Array = np.exp(-(s**2) / 2) - (np.exp(-(k**2) / 2 - 1j * k * s) * faddeeva).real
        return value / math.erf(k / math.sqrt(2))


@final
@dataclass(frozen=True)
class Arcsine(_ScalarLaw):
    """Arcsine (U-shaped) on mean ± half_width: a sine wave met at a random moment (JCGM 101:2008, 6.4.6)."""

    half_width: float
    mean: float = 0.0

    def __post_init__(self) -> None:
        take_size(self, "half_width", "the half-width of an arcsine law")
        take_number(self, "mean", "the mean of an arcsine law")

    @property
    def variance(self) -> float:
        """t²/2."""
        return self.half_width**2 / 2

    @property
    def reach(self) -> float:
        """The half-width."""
        return self.half_width

    def sample(self, variates: Array) -> Array:
        """Return mean + t sin(π(u - 1/2))."""
        return self.mean + self.half_width * np.sin(np.pi * (variates - 0.5))

    def _deviation_characteristic(self, frequency: Array) -> Array:
        value: Array = lazy_special.j0(frequency * self.half_width)
        return value
