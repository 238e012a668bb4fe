"""The law of a number that does not vary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.draws.laws.bases import SymmetricLaw
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.law import take_number
from precision_pin.draws.laws.sheet_form import SheetForm, SheetReader
from precision_pin.draws.laws.wording import write_number


@final
@dataclass(frozen=True)
class Fixed(SymmetricLaw):
    """A number that does not vary; it is a parameter, so that derivatives with respect to it exist."""

    is_normal: ClassVar[bool] = True
    form: ClassVar = SheetForm(
        "fixed", {"fixed": "85 mm"}, "a number that does not vary, but has a name and a derivative"
    )
    mean: float

    def __post_init__(self) -> None:
        take_number(self, "mean", "the value of a fixed law")

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Fixed:
        """Return the law written in a sheet."""
        return cls(reader.number("fixed"))

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

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        return f"fixed at {write_number(self.mean, quantities[0])}"

    @property
    def streamed(self) -> range:
        """None."""
        return range(0)

    def kernel_row(self) -> KernelRow:
        """Return the value."""
        return KernelRow("fixed", np.array([self.mean]))

    def _deviation_characteristic(self, frequency: Array) -> Array:
        return np.ones_like(frequency)
