"""The arcsine law."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.draws import lazy_special
from precision_pin.draws.laws.bases import HalfWidthLaw
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.projection import SymmetricProjection, power_bound
from precision_pin.draws.laws.sheet_form import MEAN, SheetForm
from precision_pin.draws.laws.wording import about


@final
@dataclass(frozen=True)
class Arcsine(HalfWidthLaw):
    """Arcsine (U-shaped) on mean ± half_width: a sine wave at a random phase (JCGM 101:2008, 6.4.6)."""

    form: ClassVar = SheetForm(
        "arcsine", {"arcsine": "0.05 mm"}, "a sine wave of amplitude t at a random phase; σ = t/√2", (MEAN,)
    )

    @property
    def variance(self) -> float:
        """t²/2."""
        return self.half_width**2 / 2

    def sample(self, variates: Array) -> Array:
        """Return mean + t sin(π(u - 1/2))."""
        return self.mean + self.half_width * np.sin(np.pi * (variates - 0.5))

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        return f"arcsine (a sine wave at a random phase) within {about(self.half_width, self.mean, quantities[0])}"

    def kernel_row(self) -> KernelRow:
        """Return mean and half-width."""
        return KernelRow("arcsine", np.array([self.mean, self.half_width]))

    def projection(self, weights: Array) -> ArcsineProjection:
        """Return the projection on weights."""
        return ArcsineProjection(abs(float(weights[0])) * self.half_width)

    def _deviation_characteristic(self, frequency: Array) -> Array:
        value: Array = lazy_special.j0(frequency * self.half_width)
        return value


@final
@dataclass(frozen=True)
class ArcsineProjection(SymmetricProjection):
    """Projection of an arcsine law, or of a circle."""

    @property
    def breaks(self) -> tuple[float, ...]:
        return -math.pi / 2, math.pi / 2

    def cumulative(self, z: Array) -> Array:
        value: Array = 0.5 + np.arcsin(self.scale_to_reach(z)) / np.pi
        return value

    def density(self, z: Array) -> Array:
        inside = np.abs(z) < self.reach
        t = np.where(inside, z / self.reach, 0.0)
        value: Array = np.where(inside, 1 / (np.pi * self.reach * np.sqrt((1 - t) * (1 + t))), 0.0)
        return value

    def position(self, s: Array) -> Array:
        value: Array = self.reach * np.sin(s)
        return value

    def weight(self, s: Array) -> Array:
        return np.full_like(s, 1 / np.pi)

    def parameter(self, z: Array) -> Array:
        value: Array = np.arcsin(self.scale_to_reach(z))
        return value

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        value: NDArray[np.complex128] = lazy_special.j0(self.reach * frequency).astype(complex)
        return value

    def envelope(self, frequency: Array) -> Array:
        """min(1, √(2/(π r ω))), since √(πz/2) |J₀(z)| ≤ 1 (Watson, Bessel functions, 15.5)."""
        return power_bound(math.sqrt(2 / math.pi), 0.5, self.reach * frequency)
