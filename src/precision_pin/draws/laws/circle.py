"""The law of a point on a circle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.draws import lazy_special
from precision_pin.draws.laws.arcsine import ArcsineProjection
from precision_pin.draws.laws.bases import PlaneLaw
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.law import cumulative
from precision_pin.draws.laws.numerics import Moments
from precision_pin.draws.laws.sheet_form import SheetForm
from precision_pin.draws.laws.wording import write_number
from precision_pin.draws.philox import direction


@final
@dataclass(frozen=True)
class Circle(PlaneLaw):
    """A point uniform on a circle about the origin."""

    form: ClassVar = SheetForm(
        "circle", {"circle": "0.1 mm"}, "two numbers `.x`, `.y`: a point uniform on a circle of radius t"
    )
    radius: float

    @property
    def covariance(self) -> Array:
        """r²/2 on either axis."""
        return np.eye(2) * self.radius**2 / 2

    def sample(self, variates: Array) -> Array:
        """Return the point at the angle 2π u₁; u₀ is not used, so that a circle in place of a disc keeps its angles."""
        return self.radius * direction(variates[1])

    def from_normals(self, normals: Array) -> Array:
        """Return the point at the angle 4π Φ(z₁), so that |z₁| below 0.7 covers every angle."""
        turn = 4 * np.pi * cumulative(normals[1])
        return self.radius * np.array([np.cos(turn), np.sin(turn)])

    def ellipsoid(self, k: float) -> Array:
        """Return the ellipsoid of the disc, for every k."""
        del k
        return self.radius * np.eye(2)

    def standardised_moments(self) -> Moments:
        """Return the moments: variance r²/2, E x⁴ = 3 r⁴/8, E x² y² = r⁴/8."""
        return 0.0, 1.5, 0.5

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        return f"a point uniform on a circle of radius {write_number(self.radius, quantities[0])}"

    @property
    def streamed(self) -> range:
        """The second variate, which gives the angle."""
        return range(1, 2)

    def kernel_row(self) -> KernelRow:
        """Return the radius."""
        return KernelRow("circle", np.array([self.radius]))

    def projection(self, weights: Array) -> ArcsineProjection:
        """Return the projection on weights."""
        return ArcsineProjection(self.radius * math.hypot(*weights))

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return J₀(r|t|)."""
        t = self.radius * np.hypot(*np.asarray(frequency, dtype=float))
        value: NDArray[np.complex128] = lazy_special.j0(t).astype(complex)
        return value
