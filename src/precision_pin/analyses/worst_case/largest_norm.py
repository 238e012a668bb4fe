"""Farthest point of a three-dimensional convex body from the origin: global search to a stated accuracy.

With the support function h(u) = max u·z over the body, the largest |z| is the largest h over the unit sphere. h has many
local maxima (a zonotope has one at nearly every corner), so that a local ascent proves nothing.

Branch and bound: h is convex and positively homogeneous, so on the plane triangle with corners a, b, c on the sphere it
is at most max(h(a), h(b), h(c)), and on the spherical triangle above it at most that over the distance ρ of the plane
from the origin, ρ² = 1 - R² with R the radius of the circle through the corners. Triangles whose bound does not exceed the
best value found are discarded; the others are divided into four. The relative difference of bound and value is R²/2, so
that an accuracy of 1e-9 needs triangles of a size of 1e-4, but only near the maximum.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from scipy.spatial import ConvexHull

from precision_pin.base.array_checks import Fixed
from precision_pin.base.arrays import Array

TOLERANCE: Final = 1e-9
"""Largest relative difference between lower and upper bound of the result."""

MOST_CELLS: Final = 400_000
"""Largest number of triangles; the search then ends with the bounds reached."""

_ROUNDING: Final = 1e-12
_ASCENTS: Final = 500
_CHUNK: Final = 2**15


@final
@dataclass(frozen=True, eq=False)
class Farthest(Fixed):
    """Bounds of the largest |z| over a body.

    Attributes:
        direction: ``(3,)`` unit vector u to the farthest point found.
        lower: Distance |z| of that point.
        upper: Upper bound of all distances.
        cells: Number of spherical triangles evaluated; 0 where a bound in closed form was sufficient.
    """

    direction: Array
    lower: float
    upper: float
    cells: int

    @property
    def certified(self) -> bool:
        """True if the two bounds agree to a relative difference of 1e-9."""
        return self.upper <= self.lower * (1 + TOLERANCE)


def farthest(
    heights: Callable[[Array], Array],
    touch: Callable[[Array], Array],
    bound: Callable[[Array], float] = lambda direction: math.inf,
    *,
    most_cells: int = MOST_CELLS,
) -> Farthest:
    """Return the largest distance of a convex body from the origin.

    Args:
        heights: Support function: h(u) ``(N,)`` for directions u ``(N, 3)``.
        touch: Function that returns points of the body ``(N, 3)``, each the farthest along one of the directions. It is
            used for the local ascent only.
        bound: Function that returns an upper bound of the largest |z|, given the direction of the best point found;
            infinite where unknown. It is evaluated before the search, which is skipped if this bound is tight.
        most_cells: Number of triangles at which the search ends; the upper bound is then the largest bound of the
            remaining ones.
    """

    def search(directions: Array) -> Array:
        parts = [directions[k : k + _CHUNK] for k in range(0, len(directions), _CHUNK)]
        return np.concatenate([heights(part) for part in parts])

    def ascend(directions: Array) -> tuple[float, Array]:
        place = _ascend(touch, directions)
        return float(heights(place[None])[0]), place

    corners = _sphere()
    best, direction = ascend(corners[:, 0])
    if best <= 0:
        return Farthest(direction, 0.0, 0.0, 0)
    goal = best * (1 + TOLERANCE - 2 * _ROUNDING)
    ceiling = bound(direction)
    if ceiling <= goal:
        return Farthest(direction, best, max(best, ceiling) * (1 + _ROUNDING), 0)
    values = search(corners.reshape(-1, 3)).reshape(-1, 3)
    dropped, cells = best, 0
    while True:
        cells += len(corners)
        bounds = values.max(axis=1) / _plane_distance(corners)
        still = bounds > best * (1 + TOLERANCE - 2 * _ROUNDING)
        dropped = max(dropped, float(bounds[~still].max(initial=0.0)))
        if not still.any() or cells + 4 * still.sum() > most_cells:
            upper = max(dropped, float(bounds[still].max(initial=0.0)))
            return Farthest(direction, best, min(upper, ceiling) * (1 + _ROUNDING), cells)
        corners, values = _quarter(corners[still], values[still], search)
        if values.max() > best:
            found, place = ascend(corners.reshape(-1, 3)[values.argmax()][None])
            if found > best:
                best, direction = found, place


def quadratic_bound(centre: Array, roots: list[Array], direction: Array) -> float:
    """Return an upper bound of max over |u| = 1 of u·centre + Σ |rootᵀ u|, tight for some bodies of high symmetry.

    Each norm is at most |rootᵀ u|²/(2t) + t/2, with equality for the norm t; here t is the norm in ``direction``. The bound
    is then the maximum of a quadratic function on the sphere. Its dual, min over λ of λ + ¼ cᵀ(λ - Q)⁻¹c, bounds this maximum
    tightly (Sorensen, SIAM Journal on Numerical Analysis 19, 1982).

    Args:
        centre, roots: Centre ``(3,)`` and roots ``(3, p)`` of the body.
        direction: Unit vector, ``(3,)``.
    """
    quadratic, constant = np.zeros((3, 3)), 0.0
    scale = max((float(np.abs(root).max(initial=0.0)) for root in roots), default=0.0)
    for root in roots:
        if not np.abs(root).max(initial=0.0) > 1e-15 * scale:
            constant += math.sqrt(float((root**2).sum()))
            continue
        t = float(np.linalg.norm(root.T @ direction))
        if t <= 1e-9 * scale:
            return math.inf
        quadratic += root @ root.T / (2 * t)
        constant += t / 2
    eigenvalues, vectors = np.linalg.eigh(quadratic)
    squares = (vectors.T @ centre) ** 2
    low = float((eigenvalues + np.sqrt(squares) / 2).max())
    high = float(eigenvalues.max() + math.sqrt(squares.sum()) / 2)
    for _ in range(200):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        if (squares / (middle - eigenvalues) ** 2).sum() > 4:
            low = middle
        else:
            high = middle
    gaps = high - eigenvalues
    terms = np.divide(squares, gaps, out=np.zeros(3), where=gaps > 0)
    return float(constant + high + terms.sum() / 4) if (squares[gaps <= 0] == 0).all() else math.inf


def _ascend(touch: Callable[[Array], Array], directions: Array) -> Array:
    """Return the direction ``(3,)`` of the largest |z| reached by repeated steps to the farthest point along z/|z|.

    |z| never decreases, because the farthest point along z/|z| is no nearer than z.
    """
    best = 0.0
    place: Array = directions[0]
    for _ in range(_ASCENTS):
        points = touch(directions)
        sizes = np.linalg.norm(points, axis=1)
        largest = int(sizes.argmax())
        if sizes[largest] <= best * (1 + 1e-15):
            break
        best, place = float(sizes[largest]), points[largest] / sizes[largest]
        moving = sizes > 0
        directions = points[moving] / sizes[moving, None]
    return place


def _sphere() -> Array:
    """Return spherical triangles that cover the sphere, ``(320, 3, 3)``: those of an icosahedron, each in sixteen parts."""
    golden = (1 + math.sqrt(5)) / 2
    corners = np.array([[0, a, b * golden] for a in (-1, 1) for b in (-1, 1)])
    corners = np.concatenate([np.roll(corners, k, axis=1) for k in range(3)]) / math.hypot(1, golden)
    triangles: Array = corners[ConvexHull(corners).simplices]
    for _ in range(2):
        triangles, _ = _quarter(triangles, np.zeros(triangles.shape[:2]), lambda places: np.zeros(len(places)))
    return triangles


def _quarter(corners: Array, values: Array, heights: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return the triangles divided into four at the midpoints of their sides, and the values at the corners."""
    middles = corners + np.roll(corners, -1, axis=1)
    middles /= np.linalg.norm(middles, axis=2, keepdims=True)
    between = heights(middles.reshape(-1, 3)).reshape(-1, 3)
    (a, b, c), (ab, bc, ca) = np.moveaxis(corners, 1, 0), np.moveaxis(middles, 1, 0)
    (ha, hb, hc), (hab, hbc, hca) = values.T, between.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    heights_of = [(ha, hab, hca), (hab, hb, hbc), (hca, hbc, hc), (hab, hbc, hca)]
    return (
        np.concatenate([np.stack(quarter, axis=1) for quarter in quarters]),
        np.concatenate([np.stack(value, axis=1) for value in heights_of]),
    )


def _plane_distance(corners: Array) -> Array:
    """Return the distance from the origin of planes through three points of the unit sphere, from the triangles' sides."""
    sides = corners - np.roll(corners, -1, axis=1)
    squares = (sides**2).sum(axis=2)
    area = (np.cross(sides[:, 0], sides[:, 1]) ** 2).sum(axis=1)
    return np.sqrt(1 - squares.prod(axis=1) / (4 * area))
