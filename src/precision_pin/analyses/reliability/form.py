"""FORM: search for the most likely failures from many starting points.

In standard normal numbers u, the point of the failure surface nearest to the origin is the most likely failure. Its
distance β is the reliability index, Φ(-β) is the probability beyond the tangent plane at this point, and the squared
components of the unit vector towards it are each number's importance (Hasofer and Lind 1974; Rackwitz and Fiessler
1978).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.reliability.strata import FARTHEST, Jump
from precision_pin.base.arrays import Array, Fixed

Margin = Callable[[Array], Array]
"""Margin to failure ``(N,)`` as a function of standard normal numbers ``(d, N)``; negative at failures."""

_STEP: Final = 1e-4
_MOST_STEPS: Final = 40
_MOST_BEYOND: Final = 12
_LENGTHS: Final = np.array([4.0, 2.0, 1.0, 0.5, 0.25, 2.0**-3, 2.0**-4, 2.0**-6, 2.0**-8, 2.0**-11])
# required fraction of the decrease that the slope of the merit predicts (Armijo)
_SUFFICIENT: Final = 0.1

_TOLERANCE: Final = 1e-7
_LOOSE: Final = 3e-4
_APART: Final = 2e-2
_AT_ONCE: Final = 16_384

# radius of a bulge and its shift of the surface, as ratios to the point's distance (Der Kiureghian and Dakessian,
# 1998)
_BULGE_RADIUS: Final = 1.1
_BULGE_LIFT: Final = 0.75

_MOST_ROUNDS: Final = 8
# largest number of points; with more, the surface curves around the origin and every point of it is a design point
_MOST_BULGES: Final = 12

_BULGE_STARTS: Final = 8


@final
@dataclass(frozen=True, eq=False)
class DesignPoint(Fixed):
    """Point of the failure surface closest to the origin among its neighbours.

    Attributes:
        u: ``(d,)`` standard normal numbers.
        beta: Distance from the origin, negative if the origin itself fails.
        importance: ``(d,)`` squared components of the unit vector towards the point; their sum is 1.
        stratum: Number of the stratum of the normal numbers.
    """

    u: Array
    beta: float
    importance: Array
    stratum: int = 0

    @property
    def probability(self) -> float:
        """Φ(-β)."""
        return float(special.ndtr(-self.beta))


@final
@dataclass(frozen=True, eq=False)
class Form:
    """Result of the search.

    Attributes:
        points: Distinct design points, nearest first; empty if the searches found none within 8.2.
        starts: Number of starting points.
        bounds: Range of the probability for several strata together; otherwise it follows from the points.
    """

    points: tuple[DesignPoint, ...]
    starts: int
    bounds: tuple[float, float] | None = None

    @property
    def probability(self) -> float | None:
        """Φ(-β) of the nearest point."""
        return self.points[0].probability if self.points else None

    @property
    def range(self) -> tuple[float, float] | None:
        """Bounds of a union of half spaces: the largest single probability, and the sum of all."""
        if self.bounds is not None or not self.points:
            return self.bounds
        if self.points[0].beta < 0:
            return self.points[0].probability, self.points[0].probability
        return self.points[0].probability, min(1.0, sum(point.probability for point in self.points))


def form(margin: Margin, size: int, starts: Sequence[Array], jumps: Sequence[Jump] = ()) -> Form:
    """Return the distinct design points found by searches from ``starts``, each ``(d,)``.

    Each step is that of Hasofer, Lind, Rackwitz and Fiessler. Its length minimises the merit |u|²/2 + c |g| among those
    that lower it sufficiently (Zhang and Der Kiureghian, 1995). Gradients are central differences. Points found are
    then hidden by bulges of the surface, and the search is repeated until it finds no new point.
    """
    if not size:
        return Form((), len(starts))
    at_origin = float(margin(np.zeros((size, 1)))[0])
    search = _Search(margin, jumps, abs(at_origin) or 1.0)
    begin = search.project_starts(np.array(starts, dtype=float).reshape(-1, size).T)
    ends, good = search.run(begin, _MOST_STEPS)
    distinct = _distinct([], ends[:, good])
    tried = len(starts)
    if at_origin > 0:
        sides = 2 * np.random.Generator(np.random.Philox(1)).standard_normal((size, _BULGE_STARTS))
        for _ in range(_MOST_ROUNDS):
            if not distinct or len(distinct) > _MOST_BULGES:
                break
            first = search.project_starts(np.concatenate([sides, begin[:, :_BULGE_STARTS]], axis=1))
            bulged = _Search(_with_bulges(search, np.array(distinct).T), jumps, search.scale)
            met, well = bulged.run(first, _MOST_STEPS)
            tried += first.shape[1]
            ends, good = search.run(met[:, well], _MOST_STEPS)
            more = _distinct(distinct, ends[:, good])
            if len(more) == len(distinct):
                break
            distinct = more
    points = []
    for u in sorted(distinct, key=lambda u: float(np.linalg.norm(u))):
        distance = float(np.linalg.norm(u))
        towards = u / max(distance, 1e-300)
        if distance < 1e-9:
            slope = search.with_gradients(u[:, None])[1][:, 0]
            towards = slope / max(float(np.linalg.norm(slope)), 1e-300)
        points.append(DesignPoint(u, math.copysign(distance, at_origin), towards**2))
    return Form(tuple(points), tried)


def towards_surface(margin: Margin, samples: Array, jumps: Sequence[Jump], steps: int) -> Array:
    """Return points ``(d, M)`` of the failure surface, at most one for each sample ``(d, N)``, on the same side.

    A few steps of the search remove the irrelevant directions; the point is then found along the ray from the origin.
    """
    size = samples.shape[0]
    if not samples.size:
        return samples
    at_origin = float(margin(np.zeros((size, 1)))[0])
    search = _Search(margin, jumps, abs(at_origin) or 1.0)
    ends, _ = search.run(search.project_starts(samples), steps)
    factors = np.linspace(0.5, 1.5, 21)
    rays = (ends[:, :, None] * factors).reshape(size, -1)
    values = search.values(rays).reshape(ends.shape[1], factors.size)
    crossing = (values[:, :-1] >= 0) & (values[:, 1:] < 0)
    met = crossing.any(axis=1)
    k = crossing.argmax(axis=1)[met]
    before, after = values[met, k], values[met, k + 1]
    factor = factors[k] + (factors[1] - factors[0]) * before / (before - after)
    points: Array = ends[:, met] * factor
    return points[:, np.linalg.norm(points, axis=0) <= FARTHEST]


def _distinct(known: list[Array], points: Array) -> list[Array]:
    out = list(known)
    for u in points.T[np.argsort(np.linalg.norm(points, axis=0), kind="stable")]:
        apart = _APART * max(1.0, float(np.linalg.norm(u)))
        if all(float(np.linalg.norm(u - other)) > apart for other in out):
            out.append(u)
    return out


def _with_bulges(search: _Search, points: Array) -> Margin:
    """Return the margin, increased about points ``(d, P)`` so that the surface is farther out there."""
    _, slopes = search.with_gradients(points)
    distances = np.maximum(np.linalg.norm(points, axis=0), 1e-3)
    reach = (_BULGE_RADIUS * distances) ** 2
    height = _BULGE_LIFT * distances * np.linalg.norm(slopes, axis=0) / (1 - (_BULGE_LIFT / _BULGE_RADIUS) ** 2) ** 2

    def margin(u: Array) -> Array:
        squares = (u**2).sum(axis=0)[:, None] - 2 * u.T @ points + (points**2).sum(axis=0)
        return search.margin(u) + np.maximum(1 - squares / reach, 0.0) ** 2 @ height

    return margin


@dataclass(frozen=True, eq=False)
class _Search:
    """Simultaneous searches; margins are judged relative to ``scale``."""

    margin: Margin
    jumps: Sequence[Jump]
    scale: float

    def project_starts(self, starts: Array) -> Array:
        """Return the starts, with numbers with jumps moved to the point of their piece closest to the origin."""
        out = starts.copy()
        for jump in self.jumps:
            out[jump.row] = jump.nearest(jump.pieces(starts))
        return out

    def values(self, u: Array) -> Array:
        parts = [self.margin(u[:, first : first + _AT_ONCE]) for first in range(0, u.shape[1], _AT_ONCE)]
        return np.concatenate([np.zeros(0), *parts])

    def with_gradients(self, u: Array) -> tuple[Array, Array]:
        """Return margins ``(S,)`` and their central differences ``(d, S)``, zero for numbers with jumps."""
        size, count = u.shape
        rows = np.array(sorted(set(range(size)) - {jump.row for jump in self.jumps}), dtype=int)
        steps = np.zeros((rows.size, size))
        steps[np.arange(rows.size), rows] = _STEP
        moved = np.concatenate([u[None], u[None] + steps[:, :, None], u[None] - steps[:, :, None]])
        values = self.values(np.moveaxis(moved, 0, 1).reshape(size, -1)).reshape(-1, count)
        gradients = np.zeros((size, count))
        gradients[rows] = (values[1 : rows.size + 1] - values[rows.size + 1 :]) / (2 * _STEP)
        return values[0], gradients

    def run(self, starts: Array, most: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return the end points ``(d, S)``, and which searches converged on the surface within 8.2."""
        u = starts.copy()
        good = np.zeros(u.shape[1], dtype=bool)
        beyond = np.zeros(u.shape[1], dtype=int)
        active = np.arange(u.shape[1])
        held = [jump.row for jump in self.jumps]
        for _ in range(most):
            if not active.size:
                break
            here = u[:, active]
            value, gradient = self.with_gradients(here)
            square = (gradient**2).sum(axis=0)
            flat = square <= (1e-12 * self.scale) ** 2
            factor = ((gradient * here).sum(axis=0) - value) / np.where(flat, 1.0, square)
            aim = factor * gradient
            aim[held] = here[held]
            length = np.linalg.norm(aim, axis=0)
            far = length > FARTHEST
            aim[:, far] *= FARTHEST / length[far]
            beyond[active] = np.where(far, beyond[active] + 1, 0)
            direction = aim - here
            step = np.linalg.norm(direction, axis=0)
            good[active] = ~flat & ~far & (np.abs(value) <= 1e-6 * self.scale)
            good[active] &= step <= _LOOSE * np.maximum(1.0, length)
            settled = ~far & (np.abs(value) <= _TOLERANCE * self.scale) & (step <= _TOLERANCE * 10)
            go = ~flat & ~settled & (beyond[active] <= _MOST_BEYOND)
            active, here, value, gradient, direction = (
                active[go], here[:, go], value[go], gradient[:, go], direction[:, go],
            )  # fmt: skip
            better, moved = self._line_search(here, value, gradient, direction)
            u[:, active[moved]] = better[:, moved]
            active = active[moved]
        return u, good

    def _line_search(
        self, u: Array, value: Array, gradient: Array, direction: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the points of least merit among those with a sufficient decrease, and where there is one."""
        size, count = u.shape
        norms = np.maximum(np.linalg.norm(u, axis=0), np.linalg.norm(u + direction, axis=0))
        square = (gradient**2).sum(axis=0)
        penalty = 2 * np.maximum(norms, 1.0) / np.sqrt(square)
        merit = (u**2).sum(axis=0) / 2 + penalty * np.abs(value)
        slope = (u * direction).sum(axis=0) + penalty * np.sign(value) * (gradient * direction).sum(axis=0)
        straight = u[:, :, None] + direction[:, :, None] * _LENGTHS
        ahead = self.values(straight.reshape(size, -1)).reshape(count, _LENGTHS.size)
        # the surface is curved: the part of the change that the slope does not predict is corrected along the gradient
        unforeseen = ahead - value[:, None] - _LENGTHS * (gradient * direction).sum(axis=0)[:, None]
        bent = straight - (unforeseen / square[:, None]) * gradient[:, :, None]
        bent *= np.minimum(1.0, FARTHEST / np.maximum(np.linalg.norm(bent, axis=0), 1e-300))
        tried = np.concatenate([straight, bent], axis=2)
        values = np.concatenate([ahead, self.values(bent.reshape(size, -1)).reshape(ahead.shape)], axis=1)
        merits = (tried**2).sum(axis=0) / 2 + penalty[:, None] * np.abs(values)
        wanted = merit[:, None] + _SUFFICIENT * np.tile(_LENGTHS, 2) * np.minimum(slope, 0.0)[:, None]
        enough = (merits <= wanted) & (merits < merit[:, None])
        best = np.where(enough, merits, np.inf).argmin(axis=1)
        return tried[:, np.arange(count), best], enough.any(axis=1)
