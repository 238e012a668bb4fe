"""Laws of several numbers drawn together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from precision_pin.errors import InputError
from precision_pin.laws.law import Array, Law, check_finite, check_size

__all__ = ["Circle", "Disc", "JointNormal", "Rows"]


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
        check_size("the radius of a disc law", self.radius)

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
        check_size("the radius of a circle law", self.radius)

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
