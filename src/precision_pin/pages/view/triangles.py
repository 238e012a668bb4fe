"""Shapes as triangles in one frame, the input of a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arrays import Array

Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, from 0 to 1."""

_SIDES: Final = 20
_RINGS: Final = 10
# corners and triangles of a box with edges 1
_CORNERS: Final = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_FACES: Final = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7],
     [1, 7, 3]]
)  # fmt: skip


class ShapeSink(Protocol):
    """Takes the shapes of an arm; a path is a tuple of names, a shape's pose is relative to the path above it."""

    def place(self, path: Sequence[str], pose: ArrayLike) -> None:
        """Put a node at a pose ``(4, 4)`` relative to the one above it."""

    def box(self, path: Sequence[str], size: Sequence[float], colour: Colour, pose: ArrayLike) -> None:
        """Add a box with edges ``size`` (m)."""

    def cylinder(self, path: Sequence[str], radius: float, length: float, colour: Colour, pose: ArrayLike) -> None:
        """Add a cylinder along z (m)."""

    def rod(self, path: Sequence[str], start: ArrayLike, end: ArrayLike, radius: float, colour: Colour) -> None:
        """Add a cylinder between two points ``(3,)``."""

    def sphere(self, path: Sequence[str], radius: float, colour: Colour, pose: ArrayLike) -> None:
        """Add a sphere (m)."""

    def surface(
        self, path: Sequence[str], vertices: ArrayLike, faces: ArrayLike, colour: Colour, pose: ArrayLike
    ) -> None:
        """Add triangles: corners ``(V, 3)`` in m and their indices ``(F, 3)``."""


@final
class Triangles:
    """Collects the triangles of all shapes in the axes of the root."""

    def __init__(self) -> None:
        self._poses: dict[tuple[str, ...], Array] = {}
        self._corners: list[Array] = []
        self._colours: list[Array] = []

    @property
    def corners(self) -> Array:
        """Corners of the triangles, ``(F, 3, 3)``: triangle, corner, coordinate (m)."""
        return np.concatenate([np.zeros((0, 3, 3)), *self._corners])

    @property
    def colours(self) -> Array:
        """Red, green, blue of each triangle, ``(F, 3)``."""
        return np.concatenate([np.zeros((0, 3)), *self._colours])

    def place(self, path: Sequence[str], pose: ArrayLike) -> None:
        """Put a node at a pose ``(4, 4)`` relative to the one above it."""
        self._poses[tuple(path)] = np.asarray(pose, dtype=float)

    def box(self, path: Sequence[str], size: Sequence[float], colour: Colour, pose: ArrayLike) -> None:
        """Add a box with edges ``size`` (m), centred at ``pose``."""
        self._add(path, _CORNERS * np.asarray(size, dtype=float), _FACES, colour, pose)

    def cylinder(self, path: Sequence[str], radius: float, length: float, colour: Colour, pose: ArrayLike) -> None:
        """Add a cylinder along z (m), centred at ``pose``."""
        profile = np.array([[0.0, -0.5], [1.0, -0.5], [1.0, 0.5], [0.0, 0.5]]) * (radius, length)
        self._add(path, *_turned(profile), colour, pose)

    def rod(self, path: Sequence[str], start: ArrayLike, end: ArrayLike, radius: float, colour: Colour) -> None:
        """Add a cylinder between two points ``(3,)`` that do not coincide."""
        first, last = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        length = float(np.linalg.norm(last - first))
        axis = (last - first) / length
        across = np.eye(3)[int(np.argmin(np.abs(axis)))]
        across = across - axis * float(axis @ across)
        across /= np.linalg.norm(across)
        rotation = np.stack([across, np.cross(axis, across), axis], axis=1)
        self.cylinder(path, radius, length, colour, se3.pose(rotation, (first + last) / 2))

    def sphere(self, path: Sequence[str], radius: float, colour: Colour, pose: ArrayLike) -> None:
        """Add a sphere (m) centred at ``pose``."""
        angles = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 1)
        self._add(path, *_turned(radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)), colour, pose)

    def surface(
        self, path: Sequence[str], vertices: ArrayLike, faces: ArrayLike, colour: Colour, pose: ArrayLike
    ) -> None:
        """Add triangles: corners ``(V, 3)`` in m and their indices ``(F, 3)``."""
        self._add(path, np.asarray(vertices, dtype=float), np.asarray(faces), colour, pose)

    def _add(self, path: Sequence[str], vertices: Array, faces: ArrayLike, colour: Colour, pose: ArrayLike) -> None:
        whole = np.asarray(pose, dtype=float)
        for end in range(len(path) - 1, 0, -1):
            whole = self._poses.get(tuple(path[:end]), np.eye(4)) @ whole
        moved = vertices @ whole[:3, :3].T + whole[:3, 3]
        corners = moved[np.asarray(faces, dtype=np.int64)]
        self._corners.append(corners)
        self._colours.append(np.broadcast_to(np.asarray(colour[:3], dtype=float), (len(corners), 3)))


def _turned(profile: Array) -> tuple[Array, Array]:
    """Return corners and triangles of a profile ``(R, 2)`` of radius and height, turned about z."""
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    rings = [np.stack([r * np.cos(angles), r * np.sin(angles), np.full(_SIDES, z)], axis=1) for r, z in profile]
    here = np.arange(_SIDES)
    after = (here + 1) % _SIDES
    faces = []
    for ring in range(len(profile) - 1):
        low, high = ring * _SIDES, (ring + 1) * _SIDES
        faces += [np.stack([low + here, low + after, high + after], axis=1)]
        faces += [np.stack([low + here, high + after, high + here], axis=1)]
    return np.concatenate(rings), np.concatenate(faces)
