"""Supports of draws: bounded convex bodies about their means, and their support functions.

The support function of a body K is h(w) = max w·x over x in K. The maximiser x, the support point, is the gradient of h
(Rockafellar, Convex Analysis, 1970, corollary 23.5.3). Unbounded laws are cut at k standard deviations.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError
from precision_pin.draws.laws import Law
from precision_pin.draws.laws.projection import triangular_root
from precision_pin.draws.space import Space

# step of the central differences for the support point of a law given only by its support function
_STEP: Final = 1e-7


class Body(ABC):
    """Bounded set of deviations of m numbers from their means, given by the support function of its convex hull."""

    @abstractmethod
    def heights(self, directions: Array) -> Array:
        """Return the support function h(w), ``(N,)``, for w ``(N, m)``."""

    @abstractmethod
    def points(self, directions: Array) -> Array:
        """Return the support points, ``(N, m)``, for w ``(N, m)``; any point of the set where w is zero."""

    @property
    def form(self) -> tuple[Array, tuple[Array, ...]] | None:
        """Centre ``(m,)`` and roots ``(m, p)`` with h(w) = w·centre + Σ |rootᵀ w|; None if there is no such form."""
        return None


@dataclass(frozen=True, eq=False)
class _Box(Body):
    """Box between the corners ``low`` and ``high``, ``(m,)``."""

    low: Array
    high: Array
    middle: Array
    """Value of numbers without influence: the median, which every law can take."""

    def heights(self, directions: Array) -> Array:
        return np.maximum(directions * self.low, directions * self.high).sum(axis=1)

    def points(self, directions: Array) -> Array:
        return np.where(directions > 0, self.high, np.where(directions < 0, self.low, self.middle))

    @property
    def form(self) -> tuple[Array, tuple[Array, ...]]:
        half = (self.high - self.low) / 2
        return (self.low + self.high) / 2, tuple(column[:, None] for column in np.diag(half))


@dataclass(frozen=True, eq=False)
class _Ellipsoid(Body):
    """Ellipsoid root·v with |v| ≤ 1, ``root`` ``(m, m)``: a disc, its rim, or a joint normal law that is cut."""

    root: Array

    def heights(self, directions: Array) -> Array:
        return np.linalg.norm(directions @ self.root, axis=1)

    def points(self, directions: Array) -> Array:
        seen = directions @ self.root
        # scaled first, because a subnormal length has too few digits to divide by
        largest = np.abs(seen).max(axis=1, keepdims=True)
        seen = np.divide(seen, largest, out=np.zeros_like(seen), where=largest > 0)
        seen[largest[:, 0] == 0, 0] = 1.0
        return (seen / np.linalg.norm(seen, axis=1, keepdims=True)) @ self.root.T

    @property
    def form(self) -> tuple[Array, tuple[Array, ...]]:
        return np.zeros(len(self.root)), (self.root,)


@dataclass(frozen=True, eq=False)
class _Points(Body):
    """Finite set of points, ``(n, m)``."""

    places: Array

    def heights(self, directions: Array) -> Array:
        return (directions @ self.places.T).max(axis=1)

    def points(self, directions: Array) -> Array:
        return self.places[(directions @ self.places.T).argmax(axis=1)]


@dataclass(frozen=True, eq=False)
class _Described(Body):
    """Support of a law of several numbers, given only by its support function."""

    law: Law

    def heights(self, directions: Array) -> Array:
        mean = self.law.mean_vector
        return np.array([self.law.support(direction) - direction @ mean for direction in directions])

    def points(self, directions: Array) -> Array:
        result = np.empty_like(directions)
        for k, direction in enumerate(directions):
            step = _STEP * (np.linalg.norm(direction) or 1.0)
            ends = direction + step * np.concatenate([np.eye(direction.size), -np.eye(direction.size)])
            upper, lower = np.split(self.heights(ends), 2)
            result[k] = (upper - lower) / (2 * step)
        return result


@final
@dataclass(frozen=True, eq=False)
class Supports(Fixed):
    """Supports of all draws as deviations from the means; correlated normal draws form one body."""

    space: Space
    names: tuple[str, ...]
    columns: tuple[NDArray[np.intp], ...]
    bodies: tuple[Body, ...]
    cut: tuple[str, ...]

    @classmethod
    def of(cls, space: Space, k: float) -> Supports:
        """Return the supports, with unbounded laws cut at k standard deviations.

        A normal law is cut at mean ± kσ, a joint normal law at the ellipsoid (x - mean)ᵀ Σ⁻¹ (x - mean) = k². Any other
        law of one number is cut at the quantiles with the probabilities of a normal law at ± kσ. Correlated normal laws
        are treated as one joint normal law. Other correlated draws keep their own supports: a copula with correlations
        between -1 and 1 excludes no combination.

        Raises:
            InputError: k is not positive and finite, or a law of several numbers is unbounded and of unknown form.
        """
        k = check_number("k, where unbounded laws are cut,", k, "positive and finite", lambda value: value > 0)
        cut = tuple(draw.name for draw in space.draws if not _is_bounded(draw.law))
        groups = _normal_groups(space)
        grouped = {name for group in groups for name in group}
        names, columns, bodies = [], [], []
        for draw, rows in zip(space.draws, space.slices, strict=True):
            if draw.name not in grouped:
                names.append(draw.name)
                columns.append(np.arange(rows.start, rows.stop))
                bodies.append(_body(draw.name, draw.law, float(k)))
        for group in groups:
            chosen = np.array([space.index[name] for name in group])
            matrix = space.block_covariance.within(chosen)
            names.append(", ".join(group))
            columns.append(chosen)
            bodies.append(_Ellipsoid(k * triangular_root(matrix)))
        return cls(space, tuple(names), tuple(columns), tuple(bodies), cut)

    def heights(self, weights: Array) -> Array:
        """Return the support function of every body, ``(bodies, N)``, for weights ``(N, d)`` of the components."""
        parts = [body.heights(weights[:, rows]) for body, rows in zip(self.bodies, self.columns, strict=True)]
        return np.array(parts).reshape(-1, len(weights))

    def points(self, weights: Array) -> Array:
        """Return the support points, deviations ``(N, d)``, for weights ``(N, d)``."""
        result = np.empty(weights.shape)
        for body, rows in zip(self.bodies, self.columns, strict=True):
            result[:, rows] = body.points(weights[:, rows])
        return result

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """Lowest and highest deviation of every component, ``(d,)`` each."""
        low, high = np.empty(self.space.size), np.empty(self.space.size)
        for body, rows in zip(self.bodies, self.columns, strict=True):
            axes = np.eye(rows.size)
            low[rows], high[rows] = -body.heights(-axes), body.heights(axes)
        return low, high


def _normal_groups(space: Space) -> list[tuple[str, ...]]:
    laws = {draw.name: draw.law for draw in space.draws}
    return [
        correlation.names
        for correlation in space.correlations
        if all(laws[name].is_normal for name in correlation.names)
    ]


def _ends(law: Law, number: int) -> tuple[float, float]:
    direction = np.zeros(law.size)
    direction[number] = 1.0
    return -law.support(-direction), law.support(direction)


def _is_bounded(law: Law) -> bool:
    return all(math.isfinite(end) for number in range(law.size) for end in _ends(law, number))


def _body(name: str, law: Law, k: float) -> Body:
    ellipsoid, points = law.ellipsoid(k), law.extreme_points
    if ellipsoid is not None:
        return _Ellipsoid(ellipsoid)
    if points is not None:
        return _Points(points - law.mean_vector)
    bounded = _is_bounded(law)
    if law.size > 1:
        if not bounded:
            raise InputError(f"the law of {name} is unbounded and has no rule for cutting it; truncate the law")
        return _Described(law)
    ends = np.array(_ends(law, 0)) if bounded else law.at_scores(np.array([[-k, k]]))[0]
    middle = law.inverse(np.full((1, 1), 0.5))[0]
    mean = law.mean_vector
    return _Box(ends[:1] - mean, ends[1:] - mean, middle - mean)


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
        lower, upper: Distance |z| of that point, and upper bound of all distances.
        cells: Number of spherical triangles evaluated; 0 where a bound in closed form was sufficient.
    """

    direction: Array
    lower: float
    upper: float
    cells: int

    @property
    def certified(self) -> bool:
        """Whether the bounds agree to a relative difference of 1e-9."""
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
        touch: Returns points of the body ``(N, 3)``, each the farthest along a direction; for the local ascent only.
        bound: Returns an upper bound of the largest |z|, given the direction of the best point found; infinite where
            unknown. The search is skipped if this bound is tight.
        most_cells: Number of triangles at which the search ends, with the largest bound of the remaining ones.
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

    Each norm is at most |rootᵀ u|²/(2t) + t/2, with equality for the norm t; here t is the norm in ``direction``,
    ``(3,)``. The bound is then the maximum of a quadratic function on the sphere. Its dual, min over λ of λ + ¼ cᵀ(λ -
    Q)⁻¹c, bounds this maximum tightly (Sorensen, SIAM Journal on Numerical Analysis 19, 1982). Roots are ``(3, p)``.
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

    |z| never decreases, because the farthest point along z/|z| is at least as far as z.
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
    """Return spherical triangles that cover the sphere, ``(320, 3, 3)``: an icosahedron's, each in sixteen parts."""
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
    """Return the distance from the origin of planes through three points of the unit sphere, by triangle sides."""
    sides = corners - np.roll(corners, -1, axis=1)
    squares = (sides**2).sum(axis=2)
    area = (np.cross(sides[:, 0], sides[:, 1]) ** 2).sum(axis=1)
    return np.sqrt(1 - squares.prod(axis=1) / (4 * area))
