"""The laws that random numbers follow.

A law is a distribution of ``size`` numbers together. Each gives: a sample from as many independent variates, mean,
covariance, the support function h(w) = max over its support of w·x (infinite if unbounded) and the characteristic
function E exp(i t·x). Numbers are SI.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from precision_pin.errors import InputError

__all__ = [
    "Circle",
    "Disc",
    "Fixed",
    "JointNormal",
    "Law",
    "Normal",
    "Triangular",
    "TruncatedNormal",
    "Uniform",
]

Array = NDArray[np.float64]

SMALLEST_K: Final = 1e-3
"""Smallest k of a truncated normal law; its samples are exact to 1e-16/k of its half-width."""


class Law(ABC):
    """A distribution of one or several numbers.

    Attributes
    ----------
    variates
        What :meth:`sample` is fed: ``"uniform"`` on (0, 1) or standard ``"normal"`` numbers.
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "uniform"

    @property
    def size(self) -> int:
        """How many numbers the law draws together."""
        return 1

    @property
    def components(self) -> tuple[str, ...]:
        """Suffix of each component's name, empty for a single number."""
        return ("",)

    @abstractmethod
    def sample(self, variates: Array) -> Array:
        """Return samples ``(size, N)`` from as many independent variates ``(size, N)``."""

    @property
    @abstractmethod
    def mean_vector(self) -> Array:
        """Mean, ``(size,)``."""

    @property
    @abstractmethod
    def covariance(self) -> Array:
        """Covariance, ``(size, size)``."""

    @abstractmethod
    def support(self, direction: ArrayLike) -> float:
        """Return h(w), the largest w·x over the support, for w ``(size,)``; infinite if unbounded."""

    @abstractmethod
    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(i t·x) for t ``(size, …)``."""

    @final
    def inverse(self, uniforms: Array) -> Array:
        """Return samples from uniform numbers only (quasi-random points), whatever :attr:`variates` is."""
        return self.sample(uniforms if self.variates == "uniform" else special.ndtri(uniforms))


def _check_size(what: str, value: float, *, zero: bool = True) -> None:
    if not math.isfinite(value) or value < 0 or (value == 0 and not zero):
        raise InputError(f"{what} must be {'zero or more' if zero else 'positive'} and finite, got {value!r}")


def _check_finite(what: str, value: float) -> None:
    if not math.isfinite(value):
        raise InputError(f"{what} must be finite, got {value!r}")


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
        _check_finite("the value of a fixed law", self.mean)

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
        _check_size("the half-width of a uniform law", self.half_width)
        _check_finite("the mean of a uniform law", self.mean)

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
        _check_size("the half-width of a triangular law", self.half_width)
        _check_finite("the mean of a triangular law", self.mean)

    @property
    def variance(self) -> float:
        """t²/6."""
        return self.half_width**2 / 6

    @property
    def reach(self) -> float:
        """The half-width."""
        return self.half_width

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
        _check_size("the standard deviation of a normal law", self.std)
        _check_finite("the mean of a normal law", self.mean)

    @classmethod
    def from_half_width(cls, half_width: float, mean: float = 0.0, *, k: float = 3.0) -> Normal:
        """Return the law whose half-width is k standard deviations."""
        _check_size("k", k, zero=False)
        return cls(half_width / k, mean)

    @property
    def variance(self) -> float:
        """σ²."""
        return self.std**2

    @property
    def reach(self) -> float:
        """Infinite, unless σ is zero."""
        return math.inf if self.std else 0.0

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
        _check_size("the standard deviation of a truncated normal law", self.std)
        _check_finite("the mean of a truncated normal law", self.mean)
        if not SMALLEST_K <= self.k < math.inf:
            raise InputError(
                f"k of a truncated normal law must be finite and at least {SMALLEST_K}, got {self.k!r}; "
                "cut off closer to its mean the law is uniform"
            )

    @property
    def variance(self) -> float:
        """σ² (1 - 2kφ(k) / (2Φ(k) - 1)), as the ratio of the chi-square laws of 3 and 1 at k² (no cancellation)."""
        square = self.k**2 / 2
        return self.std**2 * float(special.gammainc(1.5, square) / special.gammainc(0.5, square))

    @property
    def reach(self) -> float:
        """k·σ."""
        return self.k * self.std

    def sample(self, variates: Array) -> Array:
        """Return the inverse of the cumulative law, from the nearer end (so that it is symmetric)."""
        tail = np.minimum(variates, 1 - variates)
        cut = special.ndtr(-self.k)
        score = special.ndtri(cut + tail * math.erf(self.k / math.sqrt(2)))
        deviation: Array = np.copysign(np.minimum(-score, self.k), variates - 0.5)
        return self.mean + self.std * deviation

    def _deviation_characteristic(self, frequency: Array) -> Array:
        s, k = self.std * frequency, self.k
        faddeeva = special.wofz((1j * k - s) / math.sqrt(2))
        value: Array = np.exp(-(s**2) / 2) - (np.exp(-(k**2) / 2 - 1j * k * s) * faddeeva).real
        return value / math.erf(k / math.sqrt(2))


class _PlaneLaw(Law):
    """Of two numbers, symmetric about the origin in every direction."""

    radius: float

    @property
    def size(self) -> int:
        """Two."""
        return 2

    @property
    def components(self) -> tuple[str, ...]:
        """X and y."""
        return (".x", ".y")

    @property
    def mean_vector(self) -> Array:
        """The origin, ``(2,)``."""
        return np.zeros(2)

    def support(self, direction: ArrayLike) -> float:
        """Return radius·|w|."""
        return self.radius * math.hypot(*np.asarray(direction, dtype=float))


@final
@dataclass(frozen=True)
class Disc(_PlaneLaw):
    """A point uniform over the area of a disc about the origin."""

    radius: float

    def __post_init__(self) -> None:
        _check_size("the radius of a disc law", self.radius)

    @property
    def covariance(self) -> Array:
        """r²/4 on either axis."""
        return np.eye(2) * self.radius**2 / 4

    def sample(self, variates: Array) -> Array:
        """Return r √u₀ at the angle 2π u₁."""
        reach, turn = self.radius * np.sqrt(variates[0]), 2 * np.pi * variates[1]
        return np.array([reach * np.cos(turn), reach * np.sin(turn)])

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return 2 J₁(r|t|) / (r|t|)."""
        t = self.radius * np.hypot(*np.asarray(frequency, dtype=float))
        safe = np.where(t > 0, t, 1.0)
        value: NDArray[np.complex128] = np.where(t > 0, 2 * special.j1(safe) / safe, 1.0).astype(complex)
        return value


@final
@dataclass(frozen=True)
class Circle(_PlaneLaw):
    """A point uniform on a circle about the origin."""

    radius: float

    def __post_init__(self) -> None:
        _check_size("the radius of a circle law", self.radius)

    @property
    def covariance(self) -> Array:
        """r²/2 on either axis."""
        return np.eye(2) * self.radius**2 / 2

    def sample(self, variates: Array) -> Array:
        """Return the point at the angle 2π u₁; u₀ is not used, so that a disc turns into a circle in place."""
        turn = 2 * np.pi * variates[1]
        return self.radius * np.array([np.cos(turn), np.sin(turn)])

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return J₀(r|t|)."""
        t = self.radius * np.hypot(*np.asarray(frequency, dtype=float))
        value: NDArray[np.complex128] = special.j0(t).astype(complex)
        return value


@final
@dataclass(frozen=True)
class JointNormal(Law):
    """Several numbers jointly normal.

    Parameters
    ----------
    matrix
        Covariance, row by row; symmetric and positive semi-definite.
    centre
        Mean, zero if left out.

    Raises
    ------
    InputError
        The matrix is not square, not symmetric or not positive semi-definite.
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "normal"
    matrix: tuple[tuple[float, ...], ...]
    centre: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        size = len(self.matrix)
        if not size or any(len(row) != size for row in self.matrix):
            raise InputError("the covariance of a joint normal law must be square")
        if self.centre and len(self.centre) != size:
            raise InputError(f"the mean of a joint normal law has {len(self.centre)} numbers, expected {size}")
        covariance = self.covariance
        if not np.isfinite(covariance).all() or not np.isfinite(self.mean_vector).all():
            raise InputError("the covariance and mean of a joint normal law must be finite")
        scale = np.sqrt(np.maximum(np.diag(covariance), 0))
        slack = 1e-9 * np.outer(scale, scale)
        if (np.abs(covariance - covariance.T) > slack).any():
            raise InputError("the covariance of a joint normal law must be symmetric")
        if (np.abs(covariance) > (1 + 1e-9) * np.outer(scale, scale)).any():
            raise InputError("the covariance of a joint normal law holds a negative variance or a correlation above 1")
        unit = np.where(scale > 0, scale, 1.0)
        lowest = np.linalg.eigvalsh(covariance / np.outer(unit, unit)).min()
        if lowest < -1e-9:
            raise InputError(f"the covariance of a joint normal law has a negative eigenvalue ({lowest:.3g} scaled)")

    @property
    def size(self) -> int:
        """How many numbers."""
        return len(self.matrix)

    @property
    def components(self) -> tuple[str, ...]:
        """Numbered from 0."""
        return tuple(f".{k}" for k in range(self.size))

    @property
    def mean_vector(self) -> Array:
        """Mean, ``(size,)``."""
        return np.array(self.centre, dtype=float) if self.centre else np.zeros(self.size)

    @property
    def covariance(self) -> Array:
        """Covariance, ``(size, size)``."""
        return np.array(self.matrix, dtype=float)

    @property
    def root(self) -> Array:
        """Lower-triangular L with L Lᵀ the covariance; a dependent component gets a zero column."""
        covariance = self.covariance
        root = np.zeros_like(covariance)
        for k in range(self.size):
            pivot = covariance[k, k] - root[k, :k] @ root[k, :k]
            if pivot > 1e-14 * covariance[k, k]:
                root[k, k] = math.sqrt(pivot)
                root[k + 1 :, k] = (covariance[k + 1 :, k] - root[k + 1 :, :k] @ root[k, :k]) / root[k, k]
        return root

    def sample(self, variates: Array) -> Array:
        """Return mean + L z."""
        value: Array = self.mean_vector[:, None] + self.root @ variates
        return value

    def support(self, direction: ArrayLike) -> float:
        """Return infinity, or w·mean where the law does not vary along w."""
        w = np.asarray(direction, dtype=float)
        rounding = 1e-12 * float(np.abs(w) @ np.sqrt(np.diag(self.covariance)))
        return math.inf if np.abs(self.root.T @ w).max() > rounding else float(w @ self.mean_vector)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return exp(i t·mean - tᵀΣt/2)."""
        t = np.asarray(frequency, dtype=float)
        quadratic = np.einsum("i...,ij,j...->...", t, self.covariance, t)
        value: NDArray[np.complex128] = np.exp(1j * np.einsum("i,i...->...", self.mean_vector, t) - quadratic / 2)
        return value
