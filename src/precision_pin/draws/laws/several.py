"""Laws of several numbers drawn together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.draws import lazy_special
from precision_pin.draws.laws.law import FARTHEST_NORMAL, Array, Law, in_chunks, take_rows, take_size
from precision_pin.draws.philox import direction
from precision_pin.errors import InputError
from precision_pin.inputs.arguments import check_items, check_numbers, shown
from precision_pin.inputs.arrays import returns_read_only

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
        take_size(self, "radius", "the radius of a disc law")

    @property
    def covariance(self) -> Array:
        """r²/4 on either axis."""
        return np.eye(2) * self.radius**2 / 4

    def sample(self, variates: Array) -> Array:
        """Return r √u₀ at the angle 2π u₁."""
        value: Array = self.radius * np.sqrt(variates[0]) * direction(variates[1])
        return value

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return 2 J₁(r|t|) / (r|t|)."""
        t = self.radius * np.hypot(*np.asarray(frequency, dtype=float))
        safe = np.where(t > 0, t, 1.0)
        value: NDArray[np.complex128] = np.where(t > 0, 2 * lazy_special.j1(safe) / safe, 1.0).astype(complex)
        return value


@final
@dataclass(frozen=True)
class Circle(_PlaneLaw):
    """A point uniform on a circle about the origin."""

    radius: float

    def __post_init__(self) -> None:
        take_size(self, "radius", "the radius of a circle law")

    @property
    def covariance(self) -> Array:
        """r²/2 on either axis."""
        return np.eye(2) * self.radius**2 / 2

    def sample(self, variates: Array) -> Array:
        """Return the point at the angle 2π u₁; u₀ is not used, so that a disc turns into a circle in place."""
        return self.radius * direction(variates[1])

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return J₀(r|t|)."""
        t = self.radius * np.hypot(*np.asarray(frequency, dtype=float))
        value: NDArray[np.complex128] = lazy_special.j0(t).astype(complex)
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
        covariance = take_rows(self, "matrix", "the (square) covariance of a joint normal law")
        size = len(self.matrix)
        if covariance.shape != (size, size):
            raise InputError("the covariance of a joint normal law must be square")
        centre = check_numbers("the mean of a joint normal law", self.centre, (None,), f"{size} finite numbers")
        if centre.size not in (0, size):
            raise InputError(f"the mean of a joint normal law has {centre.size} numbers, expected {size}")
        object.__setattr__(self, "centre", tuple(centre.tolist()))
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

    def interval(self, number: int) -> tuple[float, float]:
        """Return the number's mean ± 8.6 σ."""
        mean, reach = float(self.mean_vector[number]), FARTHEST_NORMAL * math.sqrt(self.matrix[number][number])
        return mean - reach, mean + reach

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return exp(i t·mean - tᵀΣt/2)."""
        t = np.asarray(frequency, dtype=float)
        quadratic = np.einsum("i...,ij,j...->...", t, self.covariance, t)
        value: NDArray[np.complex128] = np.exp(1j * np.einsum("i,i...->...", self.mean_vector, t) - quadratic / 2)
        return value


@final
@dataclass(frozen=True)
class Rows(Law):
    """Several numbers that were measured together: the rows of a table, each as likely as any other.

    Parameters
    ----------
    table
        The rows, each of as many numbers.
    names
        Of the columns; numbered from 0 if left out.

    Raises
    ------
    InputError
        No rows, rows of different lengths, a number that is not finite, or names that do not fit.
    """

    table: tuple[tuple[float, ...], ...]
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        take_rows(self, "table", "a law of rows")
        names = check_items("the names of a law of rows", self.names, str)
        if names and (len(names) != self.size or len(set(names)) != self.size or not all(names)):
            raise InputError(f"a law of rows of {self.size} numbers needs as many different names, got {shown(names)}")
        object.__setattr__(self, "names", names)

    @cached_property
    @returns_read_only
    def array(self) -> Array:
        """The rows, ``(rows, size)``."""
        return np.array(self.table, dtype=float)

    @property
    def size(self) -> int:
        """How many columns."""
        return len(self.table[0])

    @property
    def components(self) -> tuple[str, ...]:
        """The names, or numbers from 0."""
        return tuple(f".{name}" for name in self.names or range(self.size))

    @property
    def mean_vector(self) -> Array:
        """Mean of the rows, ``(size,)``."""
        mean: Array = self.array.mean(axis=0)
        return mean

    @property
    def covariance(self) -> Array:
        """Covariance ``(size, size)`` of the rows as all there is: divided by their number, not by one less."""
        centred = self.array - self.mean_vector
        value: Array = centred.T @ centred / len(self.table)
        return value

    def sample(self, variates: Array) -> Array:
        """Return row ⌊u₀ n⌋ of n; the other uniform numbers are not used."""
        chosen = np.floor(variates[0] * len(self.table)).astype(np.intp)
        value: Array = self.array[chosen].T
        return value

    def support(self, direction: ArrayLike) -> float:
        """Return the largest w·x of the rows."""
        return float((self.array @ np.asarray(direction, dtype=float)).max())

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the mean of exp(i t·x) over the rows."""
        t = np.asarray(frequency, dtype=float)
        return in_chunks(lambda part: np.exp(1j * (self.array @ part)).mean(axis=0), t, len(self.table))
