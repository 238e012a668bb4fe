"""The symmetric triangular law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.draws.laws.bases import HalfWidthLaw
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.projection import SymmetricProjection, power_bound
from precision_pin.draws.laws.sheet_form import MEAN, SheetForm
from precision_pin.draws.laws.wording import about


@final
@dataclass(frozen=True)
class Triangular(HalfWidthLaw):
    """Symmetric triangle on mean ± half_width."""

    form: ClassVar = SheetForm(
        "triangular", {"triangular": "0.05 mm"}, "a symmetric triangle on mean ± t; σ = t/√6", (MEAN,)
    )

    @property
    def variance(self) -> float:
        """t²/6."""
        return self.half_width**2 / 6

    @property
    def breaks(self) -> tuple[float, ...]:
        """One half, where the density has a kink."""
        return (0.5,)

    def sample(self, variates: Array) -> Array:
        """Return the inverse of the cumulative law, from the nearer end."""
        tail = np.minimum(variates, 1 - variates)
        deviation: Array = np.copysign(1 - np.sqrt(2 * tail), variates - 0.5)
        return self.mean + self.half_width * deviation

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        return f"triangular within {about(self.half_width, self.mean, quantities[0])}"

    def kernel_row(self) -> KernelRow:
        """Return mean and half-width."""
        return KernelRow("triangular", np.array([self.mean, self.half_width]))

    def projection(self, weights: Array) -> _Projection:
        """Return the projection on weights."""
        return _Projection(abs(float(weights[0])) * self.half_width)

    def _deviation_characteristic(self, frequency: Array) -> Array:
        value: Array = np.sinc(frequency * self.half_width / (2 * np.pi)) ** 2
        return value


@final
@dataclass(frozen=True)
class _Projection(SymmetricProjection):
    @property
    def breaks(self) -> tuple[float, ...]:
        return -1.0, 0.0, 1.0

    @property
    def kinks(self) -> tuple[float, ...]:
        return -self.reach, 0.0, self.reach

    def cumulative(self, z: Array) -> Array:
        t = self.scale_to_reach(z)
        tail = (1 - np.abs(t)) ** 2 / 2
        value: Array = np.where(t > 0, 1 - tail, tail)
        return value

    def density(self, z: Array) -> Array:
        return (1 - np.abs(self.scale_to_reach(z))) / self.reach

    def position(self, s: Array) -> Array:
        return self.reach * s

    def weight(self, s: Array) -> Array:
        return 1 - np.abs(s)

    def parameter(self, z: Array) -> Array:
        return self.scale_to_reach(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return (np.sinc(self.reach * frequency / (2 * np.pi)) ** 2).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, 4/(a ω)²), the square of a uniform law's of half the reach."""
        return power_bound(4.0, 2.0, self.reach * frequency)
