"""The symmetric triangular law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from precision_pin.draws.laws.bases import SymmetricLaw
from precision_pin.draws.laws.law import Array, take_number, take_size

__all__ = ["Triangular"]


@final
@dataclass(frozen=True)
class Triangular(SymmetricLaw):
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
