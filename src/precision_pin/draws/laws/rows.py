"""The rows of a table, each alike likely."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.draws.laws.law import Array, Law, in_chunks, take_rows
from precision_pin.errors import InputError
from precision_pin.inputs.arguments import check_items, shown
from precision_pin.inputs.arrays import returns_read_only

__all__ = ["Rows"]


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
