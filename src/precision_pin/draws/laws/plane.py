"""Laws of two numbers with circular symmetry: a point in a disc and on a circle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, cast, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.draws import lazy_special
from precision_pin.draws.laws.law import Branch, KernelRow, Law, SheetForm, cumulative, write_number
from precision_pin.draws.laws.projection import Moments, SymmetricProjection, power_bound
from precision_pin.draws.laws.symmetric import ArcsineProjection, SineProjection
from precision_pin.draws.philox import direction

LARGEST_SCALED_BESSEL: Final = 0.82504
"""Upper bound of √z |J₁(z)| for z > 0, reached at z = 2.166."""


@dataclass(frozen=True)
class PlaneLaw(Law):
    """A law of two numbers with circular symmetry about the origin; its key in a sheet holds the radius.

    Attributes:
        along: Its projection on any direction, given the radius.
        divisor: Square of the radius over the variance on either axis.
    """

    size: ClassVar = 2
    components: ClassVar = (".x", ".y")
    along: ClassVar[type[SymmetricProjection]]
    divisor: ClassVar[float]
    words: ClassVar[str]
    radius: float

    @property
    def mean_vector(self) -> Array:
        return np.zeros(2)

    @property
    def covariance(self) -> Array:
        return np.eye(2) * self.radius**2 / self.divisor

    def support(self, direction: ArrayLike) -> float:
        return self.radius * math.hypot(*np.asarray(direction, dtype=float))

    def ellipsoid(self, k: float) -> Array:
        """Return the ellipsoid of the disc, for every k."""
        return self.radius * np.eye(2)

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        return f"a point uniform {self.words} of radius {write_number(self.radius, quantities[0])}"

    def kernel_row(self) -> KernelRow:
        return KernelRow(cast("Branch", self.form.key), np.array([self.radius]))

    def projection(self, weights: Array) -> SymmetricProjection:
        return self.along(self.radius * math.hypot(*weights))

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return that of the projection at |t|."""
        return self.along(self.radius).characteristic(np.hypot(*np.asarray(frequency, dtype=float)))


@final
@dataclass(frozen=True)
class _DiscProjection(SineProjection):
    def cumulative(self, z: Array) -> Array:
        t = self.scale_to_reach(z)
        return 0.5 + (t * np.sqrt((1 - t) * (1 + t)) + np.arcsin(t)) / np.pi

    def density(self, z: Array) -> Array:
        t = self.scale_to_reach(z)
        return 2 / (np.pi * self.reach) * np.sqrt((1 - t) * (1 + t))

    def weight(self, s: Array) -> Array:
        return 2 / np.pi * np.cos(s) ** 2

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        t = self.reach * frequency
        safe = np.where(t != 0, t, 1.0)
        return np.where(t != 0, 2 * lazy_special.j1(safe) / safe, 1.0).astype(complex)

    def envelope(self, frequency: Array) -> Array:
        """min(1, c (r ω)^-3/2), from 2 J₁(z)/z and the largest √z |J₁(z)|."""
        return power_bound(2 * LARGEST_SCALED_BESSEL, 1.5, self.reach * frequency)


@final
@dataclass(frozen=True)
class Disc(PlaneLaw):
    """A point uniform over the area of a disc about the origin."""

    form: ClassVar = SheetForm(
        "disc", {"disc": "0.1 mm"}, "two numbers `.x`, `.y`: a point uniform over the area of a disc of radius t"
    )
    along: ClassVar = _DiscProjection
    divisor: ClassVar = 4
    words: ClassVar = "over a disc"

    def sample(self, variates: Array) -> Array:
        """Return r √u₀ at the angle 2π u₁."""
        return self.radius * np.sqrt(variates[0]) * direction(variates[1])

    def from_normals(self, normals: Array) -> Array:
        """Return r √(1 - exp(-|z|²/2)) in the direction of z: polar coordinates would jump at one angle."""
        length = np.hypot(*normals)
        unit = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
        return self.radius * np.sqrt(-np.expm1(-(length**2) / 2)) * unit

    def standardised_moments(self) -> Moments:
        """Return the moments: variance r²/4, E x⁴ = r⁴/8, E x² y² = r⁴/24."""
        return 0.0, 2.0, 2 / 3

    def tolerance(self, quantities: Sequence[Quantity | None]) -> str:
        known = [quantity for quantity in quantities if quantity is not None and quantity.si]
        return f"radius {write_number(self.radius, known[0])}" if known else ""


@final
@dataclass(frozen=True)
class Circle(PlaneLaw):
    """A point uniform on a circle about the origin."""

    form: ClassVar = SheetForm(
        "circle", {"circle": "0.1 mm"}, "two numbers `.x`, `.y`: a point uniform on a circle of radius t"
    )
    along: ClassVar = ArcsineProjection
    divisor: ClassVar = 2
    words: ClassVar = "on a circle"
    streamed: ClassVar = range(1, 2)
    """The second variate, which gives the angle."""

    def sample(self, variates: Array) -> Array:
        """Return the point at the angle 2π u₁; u₀ is unused, so that a circle in place of a disc keeps its angles."""
        return self.radius * direction(variates[1])

    def from_normals(self, normals: Array) -> Array:
        """Return the point at the angle 4π Φ(z₁), so that |z₁| below 0.7 covers every angle."""
        turn = 4 * np.pi * cumulative(normals[1])
        return self.radius * np.array([np.cos(turn), np.sin(turn)])

    def standardised_moments(self) -> Moments:
        """Return the moments: variance r²/2, E x⁴ = 3 r⁴/8, E x² y² = r⁴/8."""
        return 0.0, 1.5, 0.5
