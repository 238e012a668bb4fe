"""What the place of a target is read against: an anchor, a plane or sockets.

With the target at y, a *distance* is ``|y - a|`` from an anchor a; a *plane* reads the height ``n·(y - p)`` over a plane with a
point p and a unit normal n, zero at contact; a *socket* reads ``y - s`` from the place s of one of several sockets, zero where
the target is put into it. A place that is not known is estimated: a shift of a or s, and for a plane its offset along n and
two tilts α, β: ``n ∝ n₀ + α t₁ + β t₂`` with unit vectors t in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError

_AXES = ("x", "y", "z")


class Place(Protocol):
    """What a target's place is read against; ``own`` are the unknown numbers of the place, zeros where it is known."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers of the place, in m or without unit."""

    def read(self, point: Array, own: Array, near: Array) -> Array:
        """Return readings ``(m, N)`` of points ``(3, N)`` with ``own`` ``(k, N)``; ``near`` ``(3,)`` is the nominal point."""

    def slopes(self, point: Array, own: Array, near: Array) -> tuple[Array, Array]:
        """Return the derivatives by point ``(m, 3)`` and by own numbers ``(m, k)`` at one point ``(3,)``."""


@final
@dataclass(frozen=True)
class Anchor:
    """A fixed point that distances are measured from, ``(3,)``."""

    place: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Shift of the anchor."""
        return tuple(f"anchor.{axis}" for axis in _AXES)

    def read(self, point: Array, own: Array, near: Array) -> Array:
        """Return distances."""
        del near
        away = point - np.array(self.place)[:, None] - own
        distance: Array = np.sqrt((away**2).sum(axis=0))[None]
        return distance

    def slopes(self, point: Array, own: Array, near: Array) -> tuple[Array, Array]:
        """Return derivatives of a distance."""
        del near
        away = point - np.array(self.place) - own
        length = float(np.linalg.norm(away))
        if length == 0.0:
            raise InputError("the target is at the anchor, where the direction of a distance is not defined")
        direction = away[None] / length
        return direction, -direction


@final
@dataclass(frozen=True)
class Plane:
    """A plane that a target touches: a point on it and its unit normal, ``(3,)`` each."""

    place: tuple[float, ...]
    normal: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Offset along the normal, and two tilts."""
        return ("plane.offset", "plane.tilt1", "plane.tilt2")

    @property
    def axes(self) -> Array:
        """Normal and two directions in the plane, as columns, ``(3, 3)``."""
        normal = np.array(self.normal)
        first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        first /= np.linalg.norm(first)
        return np.array([normal, first, np.cross(normal, first)]).T

    def tilted(self, own: Array) -> tuple[Array, Array]:
        """Return point and unit normal ``(3,)`` of the plane with its own numbers ``(3,)``."""
        normal = self.axes @ np.array([1.0, own[1], own[2]])
        normal /= np.linalg.norm(normal)
        return np.array(self.place) + own[0] * normal, normal

    def read(self, point: Array, own: Array, near: Array) -> Array:
        """Return heights."""
        del near
        away = self.axes.T @ (point - np.array(self.place)[:, None])
        height = away[0] + own[1] * away[1] + own[2] * away[2]
        reading: Array = (height / np.sqrt(1 + own[1] ** 2 + own[2] ** 2) - own[0])[None]
        return reading

    def slopes(self, point: Array, own: Array, near: Array) -> tuple[Array, Array]:
        """Return derivatives of a height."""
        del near
        away = self.axes.T @ (point - np.array(self.place))
        length = np.sqrt(1 + own[1] ** 2 + own[2] ** 2)
        by_point = self.axes @ np.array([1.0, own[1], own[2]]) / length
        height = by_point @ (point - np.array(self.place))
        tilts = (away[1:] - own[1:] * height / length) / length
        return by_point[None], np.array([[-1.0, *tilts]])


@final
@dataclass(frozen=True)
class Sockets:
    """Sockets that the tip is put into, ``(3,)`` each; a pose belongs to the one nearest to its nominal target."""

    places: tuple[tuple[float, ...], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Shift of each socket."""
        return tuple(f"socket{k + 1}.{axis}" for k in range(len(self.places)) for axis in _AXES)

    def nearest(self, near: Array) -> int:
        """Return the socket of a pose whose nominal target is ``(3,)``."""
        return int(np.argmin(np.linalg.norm(np.array(self.places) - near, axis=1)))

    def read(self, point: Array, own: Array, near: Array) -> Array:
        """Return offsets from the socket."""
        k = self.nearest(near)
        offset: Array = point - np.array(self.places[k])[:, None] - own[3 * k : 3 * k + 3]
        return offset

    def slopes(self, point: Array, own: Array, near: Array) -> tuple[Array, Array]:
        """Return derivatives of an offset."""
        del point
        by_own = np.zeros((3, own.size))
        k = self.nearest(near)
        by_own[:, 3 * k : 3 * k + 3] = -np.eye(3)
        return np.eye(3), by_own
