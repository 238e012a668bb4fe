"""The normal law."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, final

import numpy as np

from precision_pin.draws.laws.bases import SymmetricLaw
from precision_pin.draws.laws.law import FARTHEST_NORMAL, Array, take_number, take_size
from precision_pin.inputs.arguments import check_number

__all__ = ["Normal"]

_NOT_NEGATIVE: Final = "zero or more and finite"


@final
@dataclass(frozen=True)
class Normal(SymmetricLaw):
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
