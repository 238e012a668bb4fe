"""A number that does not vary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from precision_pin.draws.laws.bases import SymmetricLaw
from precision_pin.draws.laws.law import Array, take_number

__all__ = ["Fixed"]


@final
@dataclass(frozen=True)
class Fixed(SymmetricLaw):
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
