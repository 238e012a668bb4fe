"""A point uniform on a sphere: a direction of which none is preferred."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.draws.laws.law import SheetForm, cumulative
from precision_pin.draws.laws.projection import Moments
from precision_pin.draws.laws.symmetric import Circle, RoundLaw, UniformProjection
from precision_pin.draws.philox import direction


@dataclass(frozen=True)
class Sphere(RoundLaw):
    """A point uniform on a sphere about the origin: along any direction uniform on ± the radius (Archimedes).

    Examples:
        >>> print(pp.Sphere(radius=3.0).covariance)
        [[3. 0. 0.]
         [0. 3. 0.]
         [0. 0. 3.]]
    """

    form: ClassVar = SheetForm(
        "sphere", {"sphere": "0.1 mm"}, "three numbers `.x`, `.y`, `.z`: a point uniform on a sphere of radius t"
    )
    size: ClassVar = 3
    components: ClassVar = (".x", ".y", ".z")
    along: ClassVar = UniformProjection
    divisor: ClassVar = 3
    words: ClassVar = "on a sphere"
    streamed: ClassVar = range(1, 3)
    """The second variate, which gives the angle about z as that of a circle, and the third, which gives the height."""

    def sample(self, variates: Array) -> Array:
        """Return the point at the angle 2π u₁ about z and the height r (2u₂ - 1)."""
        return self._at(direction(variates[1]), variates[2])

    def from_normals(self, normals: Array) -> Array:
        """Return the point at the angle 4π Φ(z₁) about z, as of a circle, and the height r (2Φ(z₂) - 1)."""
        # three normal numbers over their length are regular at the poles too, but reach every direction at any distance
        # from the origin, so that no design point would be nearest
        return self._at(Circle(1.0).from_normals(normals[:2]), cumulative(normals[2]))

    def facing(self, slopes: Array) -> Sphere:
        """Return the law with the height along the direction of the greatest length: a cap about it is a half-space."""
        return _Facing(self.radius, tuple(np.linalg.svd(slopes)[2][0].tolist()))

    def standardised_moments(self) -> Moments:
        """Return the moments: variance r²/3, E x⁴ = r⁴/5, E x² y² = r⁴/15."""
        return 0.0, 1.8, 0.6

    def _at(self, turn: Array, share: Array) -> Array:
        """Return the points ``(3, N)`` below which lies a share of the sphere, at unit vectors ``(2, N)`` about z."""
        across = 2 * self.radius * np.sqrt(share * (1 - share))
        return np.array([*(across * turn), self.radius * (2 * share - 1)])


@dataclass(frozen=True)
class _Facing(Sphere):
    """A sphere with the same numbers, but with its normals about another axis than z, a unit vector."""

    axis: tuple[float, ...]

    def from_normals(self, normals: Array) -> Array:
        """Return the points of the sphere mirrored so that z lies along the axis, or against it."""
        points = super().from_normals(normals)
        mirror = np.array(self.axis)
        mirror[2] += math.copysign(1.0, mirror[2])
        return points - np.outer(2 / (mirror @ mirror) * mirror, mirror @ points)
