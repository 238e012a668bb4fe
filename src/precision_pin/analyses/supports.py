"""Supports of the draws, cut where unbounded: what bounds the numbers of one robot."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError
from precision_pin.draws.laws import Law
from precision_pin.draws.laws.projection import triangular_root
from precision_pin.draws.space import Space


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
        projections = directions @ self.root
        # scaled first, because a subnormal length has too few digits to divide by
        largest = np.abs(projections).max(axis=1, keepdims=True)
        projections = np.divide(projections, largest, out=np.zeros_like(projections), where=largest > 0)
        projections[largest[:, 0] == 0, 0] = 1.0
        return (projections / np.linalg.norm(projections, axis=1, keepdims=True)) @ self.root.T

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
            # step of the central differences for the support point of a law given only by its support function
            step = 1e-7 * (np.linalg.norm(direction) or 1.0)
            neighbours = direction + step * np.concatenate([np.eye(direction.size), -np.eye(direction.size)])
            upper, lower = np.split(self.heights(neighbours), 2)
            result[k] = (upper - lower) / (2 * step)
        return result


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
        cut_names = tuple(draw.name for draw in space.draws if not _is_bounded(draw.law))
        groups = _normal_groups(space)
        grouped = {name for group in groups for name in group}
        names, columns, bodies = [], [], []
        for draw, rows in zip(space.draws, space.slices, strict=True):
            if draw.name not in grouped:
                names.append(draw.name)
                columns.append(np.arange(rows.start, rows.stop))
                bodies.append(_body(draw.name, draw.law, float(k)))
        for group in groups:
            columns_of_group = np.array([space.index[name] for name in group])
            matrix = space.block_covariance.within(columns_of_group)
            names.append(", ".join(group))
            columns.append(columns_of_group)
            bodies.append(_Ellipsoid(k * triangular_root(matrix)))
        return cls(space, tuple(names), tuple(columns), tuple(bodies), cut_names)

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
    interval = np.array(_ends(law, 0)) if bounded else law.at_scores(np.array([[-k, k]]))[0]
    middle = law.inverse(np.full((1, 1), 0.5))[0]
    mean = law.mean_vector
    return _Box(interval[:1] - mean, interval[1:] - mean, middle - mean)
