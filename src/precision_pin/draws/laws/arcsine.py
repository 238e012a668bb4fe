"""The arcsine law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from precision_pin.draws import lazy_special
from precision_pin.draws.laws.bases import SymmetricLaw
from precision_pin.draws.laws.law import Array, take_number, take_size
from precision_pin.draws.laws.sheet_form import MEAN, SheetForm, SheetReader

__all__ = ["Arcsine"]


@final
@dataclass(frozen=True)
class Arcsine(SymmetricLaw):
    """Arcsine (U-shaped) on mean ± half_width: a sine wave met at a random moment (JCGM 101:2008, 6.4.6)."""

    form: ClassVar = SheetForm(
        "arcsine", {"arcsine": "0.05 mm"}, "a sine wave of amplitude t met at a random moment; σ = t/√2", (MEAN,)
    )
    half_width: float
    mean: float = 0.0

    def __post_init__(self) -> None:
        take_size(self, "half_width", "the half-width of an arcsine law")
        take_number(self, "mean", "the mean of an arcsine law")

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Arcsine:
        """Return the law that a sheet has."""
        return cls(reader.half_width("arcsine"), reader.mean())

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
