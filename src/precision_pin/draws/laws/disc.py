"""A point of a disc."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.draws import lazy_special
from precision_pin.draws.laws.bases import PlaneLaw
from precision_pin.draws.laws.law import Array, take_size
from precision_pin.draws.laws.sheet_form import SheetForm, SheetReader
from precision_pin.draws.philox import direction

__all__ = ["Disc"]


@final
@dataclass(frozen=True)
class Disc(PlaneLaw):
    """A point uniform over the area of a disc about the origin."""

    form: ClassVar = SheetForm(
        "disc", {"disc": "0.1 mm"}, "two numbers `.x`, `.y`: a point uniform over the area of a disc of radius t"
    )
    radius: float

    def __post_init__(self) -> None:
        take_size(self, "radius", "the radius of a disc law")

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Disc:
        """Return the law that a sheet has."""
        return cls(reader.half_width("disc"))

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
