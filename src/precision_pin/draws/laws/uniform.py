"""The uniform law."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.draws.laws.bases import HalfWidthLaw
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.law import Law
from precision_pin.draws.laws.projection import SymmetricProjection, power_bound
from precision_pin.draws.laws.sheet_form import MEAN, SheetForm
from precision_pin.draws.laws.wording import about


@final
@dataclass(frozen=True)
class Uniform(HalfWidthLaw):
    """Uniform on mean ± half_width."""

    form: ClassVar = SheetForm(
        "uniform", {"uniform": "0.05 mm"}, "equally likely anywhere within mean ± t; σ = t/√3", (MEAN,)
    )

    @property
    def variance(self) -> float:
        """t²/3."""
        return self.half_width**2 / 3

    def sample(self, variates: Array) -> Array:
        """Return mean + t (2u - 1)."""
        return self.mean + self.half_width * (2 * variates - 1)

    def covariance_with(self, other: Law, correlation: float) -> float | None:
        """Return t₁ t₂ 2/π asin(ρ/2) of two uniform numbers (Pearson 1907)."""
        if not isinstance(other, Uniform):
            return None
        return self.half_width * other.half_width * 2 / math.pi * math.asin(correlation / 2)

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        return f"uniform within {about(self.half_width, self.mean, quantities[0])}"

    def kernel_row(self) -> KernelRow:
        """Return mean and half-width."""
        return KernelRow("uniform", np.array([self.mean, self.half_width]))

    def projection(self, weights: Array) -> _Projection:
        """Return the projection on weights."""
        return _Projection(abs(float(weights[0])) * self.half_width)

    def _deviation_characteristic(self, frequency: Array) -> Array:
        value: Array = np.sinc(frequency * self.half_width / np.pi)
        return value


@final
@dataclass(frozen=True)
class _Projection(SymmetricProjection):
    @property
    def breaks(self) -> tuple[float, ...]:
        return -1.0, 1.0

    def cumulative(self, z: Array) -> Array:
        value: Array = (1 + self.scale_to_reach(z)) / 2
        return value

    def density(self, z: Array) -> Array:
        return self.limit_to_reach(z, np.full_like(z, 0.5 / self.reach))

    def position(self, s: Array) -> Array:
        return self.reach * s

    def weight(self, s: Array) -> Array:
        return np.full_like(s, 0.5)

    def parameter(self, z: Array) -> Array:
        return self.scale_to_reach(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return np.sinc(self.reach * frequency / np.pi).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, 1/(a ω)), from sin(a ω)/(a ω)."""
        return power_bound(1.0, 1.0, self.reach * frequency)
