"""Shapes as triangles, and triangles as an image: parallel projection, hidden surfaces by depth, flat shading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.render.scene import Colour

_OVERSAMPLING: Final = 2
_BATCH: Final = 2_000_000
_FLATTEST: Final = 1e-6
# direction of the light in the camera's axes: right, up, towards the viewer
_LIGHT: Final = np.array([-0.45, 0.65, 0.62])
_AMBIENT: Final = 0.42
# colours are kept away from black and white, so that the arm stands out on dark and light backgrounds
_DARKEST: Final = 0.16
_LIGHTEST: Final = 0.88
_EDGE: Final = 0.55
_STEP: Final = 0.02
_SIDES: Final = 20
_RINGS: Final = 10
# corners and triangles of a box with edges 1
_CORNERS: Final = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_FACES: Final = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7],
     [1, 7, 3]]
)  # fmt: skip


@final
class Triangles:
    """Collects the triangles of all shapes in the root's axes, as :class:`precision_pin.render.scene.Scene` does."""

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
        """Place a node at a pose ``(4, 4)`` relative to its parent."""
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
    """Return corners and triangles of a profile ``(R, 2)`` of radius and height, revolved about z."""
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


@final
@dataclass(frozen=True)
class Camera:
    """Viewing direction (azimuth and elevation, rad) of a parallel projection with the base's z axis up."""

    azimuth: float
    elevation: float

    @property
    def axes(self) -> Array:
        """Right, up and towards the viewer in base axes, ``(3, 3)`` by rows."""
        (ca, sa), (ce, se) = ((np.cos(angle), np.sin(angle)) for angle in (self.azimuth, self.elevation))
        towards = np.array([ce * ca, ce * sa, se])
        right = np.array([-sa, ca, 0.0])
        return np.stack([right, np.cross(towards, right), towards])

    def project(self, points: Array) -> Array:
        """Return points ``(…, 3)`` in the camera's axes."""
        return points @ self.axes.T


def draw_triangles(
    corners: Array, colours: Array, low: Array, size: float, shape: tuple[int, int]
) -> NDArray[np.uint8]:
    """Return an image with transparent background, ``(rows, columns, 4)``; the same bytes for the same triangles.

    Args:
        corners: Triangles in the camera's axes, ``(F, 3, 3)``, m.
        colours: Red, green, blue from 0 to 1, ``(F, 3)``.
        low: Lower left corner of the image, ``(2,)``, m.
        size: Size of a pixel, m.
        shape: Rows and columns.
    """
    rows, columns = (_OVERSAMPLING * count for count in shape)
    step = size / _OVERSAMPLING
    points = corners.copy()
    points[:, :, :2] = (corners[:, :, :2] - low) / step
    which, depth = _nearest(points, rows, columns)
    shaded = np.vstack([_shade(corners, colours), np.zeros(3)])[which]
    extent = float(np.ptp(corners[:, :, :2], axis=(0, 1)).max()) if len(corners) else 1.0
    edges = _edges(which, depth, _STEP * extent)
    shaded[edges] *= _EDGE
    seen = (which >= 0).astype(float)
    whole = np.dstack([shaded * seen[:, :, None], seen])
    mean = whole.reshape(shape[0], _OVERSAMPLING, shape[1], _OVERSAMPLING, 4).mean(axis=(1, 3))
    mean[:, :, :3] /= np.maximum(mean[:, :, 3:], 1e-9)
    # rows from the top
    return np.rint(255 * mean[::-1]).astype(np.uint8)


def _shade(corners: Array, colours: Array) -> Array:
    """Return the colours of the triangles under one light, for either orientation of their corners."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    normals *= np.where(normals[:, 2:] < 0, -1.0, 1.0)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    bright = _AMBIENT + (1 - _AMBIENT) * np.maximum(normals @ light, 0.0)
    # in coarse steps, which are invisible and keep the file small
    return np.clip(np.rint(64 * (_DARKEST + (_LIGHTEST - _DARKEST) * colours * bright[:, None])) / 64, 0, 1)


def _nearest(points: Array, rows: int, columns: int) -> tuple[NDArray[np.int64], Array]:
    """Return the triangle closest to the viewer at each pixel (-1: none), and its depth; rows from below."""
    which = np.full(rows * columns, -1, dtype=np.int64)
    depth = np.full(rows * columns, -np.inf)
    edges = points[:, 1:] - points[:, :1]
    area = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 1, 0] * edges[:, 0, 1]
    first, count = _centres(points[:, :, 1].min(axis=1), points[:, :, 1].max(axis=1), rows)
    chosen = np.flatnonzero((count > 0) & (np.abs(area) > _FLATTEST))
    boxes = count[chosen] * (np.ptp(points[chosen, :, 0], axis=1) + 1)
    # limited by memory
    for batch in np.split(chosen, np.flatnonzero(np.diff(np.cumsum(boxes) // _BATCH)) + 1):
        _draw_batch(points, area, batch, first[batch], count[batch], (rows, columns), which, depth)
    return which.reshape(rows, columns), depth.reshape(rows, columns)


def _centres(low: Array, high: Array, most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first pixel whose centre lies between two coordinates, and the number of such pixels."""
    first = np.clip(np.ceil(low - 0.5), 0, most).astype(np.int64)
    last = np.clip(np.floor(high - 0.5), -1, most - 1).astype(np.int64)
    return first, np.maximum(last - first + 1, 0)


def _spread(first: NDArray[np.int64], count: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the range and the number of every number in the ranges that begin at ``first``."""
    of = np.repeat(np.arange(len(count)), count)
    starts = np.cumsum(count) - count
    return of, first[of] + np.arange(len(of)) - starts[of]


def _draw_batch(
    points: Array,
    area: Array,
    batch: NDArray[np.int64],
    first: NDArray[np.int64],
    count: NDArray[np.int64],
    shape: tuple[int, int],
    which: NDArray[np.int64],
    depth: Array,
) -> None:
    """Draw some triangles row by row, and record where they are closest so far."""
    columns = shape[1]
    of, row = _spread(first, count)
    triangle = batch[of]
    corner, y = points[triangle], row + 0.5
    ends = []
    for start, end in ((0, 1), (1, 2), (2, 0)):
        (ax, ay), (bx, by) = corner[:, start, :2].T, corner[:, end, :2].T
        crosses = (ay <= y) != (by <= y)
        share = np.divide(y - ay, by - ay, out=np.zeros_like(y), where=crosses)
        ends.append(np.where(crosses, ax + share * (bx - ax), np.nan))
    low, high = np.fmin.reduce(ends), np.fmax.reduce(ends)
    column, width = _centres(np.nan_to_num(low, nan=1.0), np.nan_to_num(high, nan=0.0), columns)
    line, x = _spread(column, width)
    triangle = triangle[line]
    # the triangle's plane
    origin = points[triangle, 0]
    (ux, uy, uz), (vx, vy, vz) = (points[triangle, k].T - origin.T for k in (1, 2))
    dx, dy = x + 0.5 - origin[:, 0], y[line] - origin[:, 1]
    z = origin[:, 2] + ((dx * vy - dy * vx) * uz + (dy * ux - dx * uy) * vz) / area[triangle]
    at = row[line] * columns + x
    nearer = z > depth[at]
    at, z, triangle = at[nearer], z[nearer], triangle[nearer]
    # the last one written at a pixel remains: the closest
    order = np.argsort(z, kind="stable")
    depth[at[order]] = z[order]
    which[at[order]] = triangle[order]


def _edges(which: NDArray[np.int64], depth: Array, step: float) -> NDArray[np.bool_]:
    """Return where a surface ends before another one farther behind, or before nothing."""
    found = np.zeros(which.shape, dtype=bool)
    with np.errstate(invalid="ignore"):  # nothing less nothing
        for axis in (0, 1):
            for way in (1, -1):
                behind = depth - np.roll(depth, way, axis=axis)
                found |= (which >= 0) & (behind > step)
    return found
