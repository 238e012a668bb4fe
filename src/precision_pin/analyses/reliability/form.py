"""FORM: search for the most likely failures from many starting points; and the space in which it searches.

In standard normal numbers u, the point of the failure surface nearest to the origin is the most likely failure. Its
distance β is the reliability index, Φ(-β) is the probability beyond the tangent plane at this point, and the squared
components of the unit vector towards it are each number's importance (Hasofer and Lind 1974; Rackwitz and Fiessler
1978).

Transformation of laws to normal numbers, and strata of the rare values of laws with jumps.

A law that jumps with a small probability (one of two values, a row of a table, an outlier among measured samples) can
hide a failure: no slope leads to it, and few samples reach it. Its rare values therefore become strata with known
probabilities, and the failures are searched within each: P = Σ p_s P(failure | s).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.base.arrays import Array, Fixed
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Law
from precision_pin.draws.space import Space

Margin = Callable[[Array], Array]
"""Margin to failure ``(N,)`` as a function of standard normal numbers ``(d, N)``; negative at failures."""

# step of central differences in standard normal numbers
_STEP: Final = 1e-4
# maximum number of steps of a search
_MOST_STEPS: Final = 40
# step lengths tried in a line search, relative to the full step
_LENGTHS: Final = np.array([4.0, 2.0, 1.0, 0.5, 0.25, 2.0**-3, 2.0**-4, 2.0**-6, 2.0**-8, 2.0**-11])

# margin, relative to its scale, at which a search stops; ten times this for its last step
_TOLERANCE: Final = 1e-7
# least distance of distinct design points, relative to their distance from the origin if it is above 1
_APART: Final = 2e-2
# margins evaluated together, which limits memory
_AT_ONCE: Final = 16_384

# radius of a bulge and its shift of the surface, as ratios to the point's distance (Der Kiureghian and Dakessian,
# 1998)
_BULGE_RADIUS: Final = 1.1
_BULGE_LIFT: Final = 0.75

# maximum number of rounds of bulges around the points found
_MOST_ROUNDS: Final = 8

# random starts, and most of the given ones, of each such round
_BULGE_STARTS: Final = 8


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
    projected = search.project_starts(np.array(starts, dtype=float).reshape(-1, size).T)
    end_points, is_good = search.run(projected, _MOST_STEPS)
    distinct = _add_distinct([], end_points[:, is_good])
    start_count = len(starts)
    if at_origin > 0:
        sides = 2 * np.random.Generator(np.random.Philox(1)).standard_normal((size, _BULGE_STARTS))
        for _ in range(_MOST_ROUNDS):
            # largest number of points; with more, the surface curves around the origin and every point of
            # it is a design point
            if not distinct or len(distinct) > 12:
                break
            bulge_starts = search.project_starts(np.concatenate([sides, projected[:, :_BULGE_STARTS]], axis=1))
            bulged = _Search(_with_bulges(search, np.array(distinct).T), jumps, search.scale)
            bulge_ends, has_end = bulged.run(bulge_starts, _MOST_STEPS)
            start_count += bulge_starts.shape[1]
            end_points, is_good = search.run(bulge_ends[:, has_end], _MOST_STEPS)
            extended = _add_distinct(distinct, end_points[:, is_good])
            if len(extended) == len(distinct):
                break
            distinct = extended
    points = []
    for u in sorted(distinct, key=lambda u: float(np.linalg.norm(u))):
        distance = float(np.linalg.norm(u))
        towards = u / max(distance, 1e-300)
        if distance < 1e-9:
            slope = search.with_gradients(u[:, None])[1][:, 0]
            towards = slope / max(float(np.linalg.norm(slope)), 1e-300)
        points.append(DesignPoint(u, math.copysign(distance, at_origin), towards**2))
    return Form(tuple(points), start_count)


def towards_surface(margin: Margin, samples: Array, jumps: Sequence[Jump], steps: int) -> Array:
    """Return points ``(d, M)`` of the failure surface, at most one for each sample ``(d, N)``, on the same side.

    A few steps of the search remove the irrelevant directions; the point is then found along the ray from the origin.
    """
    size = samples.shape[0]
    if not samples.size:
        return samples
    at_origin = float(margin(np.zeros((size, 1)))[0])
    search = _Search(margin, jumps, abs(at_origin) or 1.0)
    end_points, _ = search.run(search.project_starts(samples), steps)
    factors = np.linspace(0.5, 1.5, 21)
    rays = (end_points[:, :, None] * factors).reshape(size, -1)
    values = search.values(rays).reshape(end_points.shape[1], factors.size)
    crossing = (values[:, :-1] >= 0) & (values[:, 1:] < 0)
    is_crossed = crossing.any(axis=1)
    k = crossing.argmax(axis=1)[is_crossed]
    before, after = values[is_crossed, k], values[is_crossed, k + 1]
    factor = factors[k] + (factors[1] - factors[0]) * before / (before - after)
    points: Array = end_points[:, is_crossed] * factor
    return points[:, np.linalg.norm(points, axis=0) <= FARTHEST]


def _add_distinct(earlier: list[Array], points: Array) -> list[Array]:
    result = list(earlier)
    for u in points.T[np.argsort(np.linalg.norm(points, axis=0), kind="stable")]:
        distance = _APART * max(1.0, float(np.linalg.norm(u)))
        if all(float(np.linalg.norm(u - point)) > distance for point in result):
            result.append(u)
    return result


def _with_bulges(search: _Search, points: Array) -> Margin:
    """Return the margin, increased about points ``(d, P)`` so that the surface is farther out there."""
    _, slopes = search.with_gradients(points)
    distances = np.maximum(np.linalg.norm(points, axis=0), 1e-3)
    radii = (_BULGE_RADIUS * distances) ** 2
    height = _BULGE_LIFT * distances * np.linalg.norm(slopes, axis=0) / (1 - (_BULGE_LIFT / _BULGE_RADIUS) ** 2) ** 2

    def margin(u: Array) -> Array:
        squares = (u**2).sum(axis=0)[:, None] - 2 * u.T @ points + (points**2).sum(axis=0)
        return search.margin(u) + np.maximum(1 - squares / radii, 0.0) ** 2 @ height

    return margin


@dataclass(frozen=True, eq=False)
class _Search:
    """Simultaneous searches; margins are judged relative to ``scale``."""

    margin: Margin
    jumps: Sequence[Jump]
    scale: float

    def project_starts(self, starts: Array) -> Array:
        """Return the starts, with numbers with jumps moved to the point of their piece closest to the origin."""
        projected = starts.copy()
        for jump in self.jumps:
            projected[jump.row] = jump.nearest(jump.pieces(starts))
        return projected

    def values(self, u: Array) -> Array:
        parts = [self.margin(u[:, start : start + _AT_ONCE]) for start in range(0, u.shape[1], _AT_ONCE)]
        return np.concatenate([np.zeros(0), *parts])

    def with_gradients(self, u: Array) -> tuple[Array, Array]:
        """Return margins ``(S,)`` and their central differences ``(d, S)``, zero for numbers with jumps."""
        size, count = u.shape
        rows = np.array(sorted(set(range(size)) - {jump.row for jump in self.jumps}), dtype=int)
        steps = np.zeros((rows.size, size))
        steps[np.arange(rows.size), rows] = _STEP
        points = np.concatenate([u[None], u[None] + steps[:, :, None], u[None] - steps[:, :, None]])
        values = self.values(np.moveaxis(points, 0, 1).reshape(size, -1)).reshape(-1, count)
        gradients = np.zeros((size, count))
        gradients[rows] = (values[1 : rows.size + 1] - values[rows.size + 1 :]) / (2 * _STEP)
        return values[0], gradients

    def run(self, starts: Array, max_steps: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return the end points ``(d, S)``, and which searches converged on the surface within 8.2."""
        u = starts.copy()
        is_good = np.zeros(u.shape[1], dtype=bool)
        steps_beyond = np.zeros(u.shape[1], dtype=int)
        active = np.arange(u.shape[1])
        jump_rows = [jump.row for jump in self.jumps]
        for _ in range(max_steps):
            if not active.size:
                break
            points = u[:, active]
            value, gradient = self.with_gradients(points)
            square = (gradient**2).sum(axis=0)
            is_flat = square <= (1e-12 * self.scale) ** 2
            factor = ((gradient * points).sum(axis=0) - value) / np.where(is_flat, 1.0, square)
            aim = factor * gradient
            aim[jump_rows] = points[jump_rows]
            length = np.linalg.norm(aim, axis=0)
            is_far = length > FARTHEST
            aim[:, is_far] *= FARTHEST / length[is_far]
            steps_beyond[active] = np.where(is_far, steps_beyond[active] + 1, 0)
            direction = aim - points
            step = np.linalg.norm(direction, axis=0)
            is_good[active] = ~is_flat & ~is_far & (np.abs(value) <= 1e-6 * self.scale)
            # looser than the criterion for stopping
            is_good[active] &= step <= 3e-4 * np.maximum(1.0, length)
            is_settled = ~is_far & (np.abs(value) <= _TOLERANCE * self.scale) & (step <= _TOLERANCE * 10)
            # searches that stay beyond the farthest distance stop
            is_active = ~is_flat & ~is_settled & (steps_beyond[active] <= 12)
            active, points, value, gradient, direction = (
                active[is_active], points[:, is_active], value[is_active], gradient[:, is_active], direction[:, is_active],
            )  # fmt: skip
            improved, has_moved = self._line_search(points, value, gradient, direction)
            u[:, active[has_moved]] = improved[:, has_moved]
            active = active[has_moved]
        return u, is_good

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
        trials = np.concatenate([straight, bent], axis=2)
        values = np.concatenate([ahead, self.values(bent.reshape(size, -1)).reshape(ahead.shape)], axis=1)
        merits = (trials**2).sum(axis=0) / 2 + penalty[:, None] * np.abs(values)
        # required fraction of the decrease that the slope of the merit predicts (Armijo)
        required = merit[:, None] + 0.1 * np.tile(_LENGTHS, 2) * np.minimum(slope, 0.0)[:, None]
        is_lower = (merits <= required) & (merits < merit[:, None])
        choice = np.where(is_lower, merits, np.inf).argmin(axis=1)
        return trials[:, np.arange(count), choice], is_lower.any(axis=1)


FARTHEST: Final = 8.2
"""Largest distance of the search in standard normal numbers: a probability of 1e-16."""

OFTEN: Final = 0.1
"""Probability above which a value never forms a stratum."""

RARE: Final = 1e-2
"""This probability for too many combinations of values, or for tables without isolated values."""

NEGLIGIBLE: Final = 1e-9
"""Smallest upper end for a stratum without an estimate, even if levels down to 1e-12 had no failure."""

LEAST: Final = 1e-16
"""Probability of the rarest combination evaluated: a normal number beyond the farthest distance."""

# largest skewness of a symmetric law; distance of values that lie apart, as a fraction of the range of all
_SKEWED: Final = 0.1
_GAP: Final = 0.2


# fraction of a law's range whose change at a jump, or within half a normal score, may hide a failure
_STEEP_SHARE: Final = 0.1


@dataclass(frozen=True, eq=False)
class Jump(Fixed):
    """Normal number (``row``) whose value jumps at all inner ``edges``, ``(k + 1,)`` values of Φ(u) from 0 to 1."""

    row: int
    edges: Array

    def pieces(self, normals: Array) -> NDArray[np.intp]:
        """Return the number of the piece between two edges, ``(N,)``, for each sample ``(d, N)``."""
        piece = np.searchsorted(self.edges, special.ndtr(normals[self.row]), side="right") - 1
        return np.clip(piece, 0, self.edges.size - 2)

    def scores(self, pieces: NDArray[np.intp], shares: Array) -> Array:
        """Return the normal numbers at a relative position (0 to 1) within the pieces."""
        low, high = self.edges[pieces], self.edges[pieces + 1]
        return np.clip(special.ndtri(low + (high - low) * shares), -FARTHEST, FARTHEST)

    def nearest(self, pieces: NDArray[np.intp]) -> Array:
        """Return the smallest normal number, by absolute value, within each piece."""
        low, high = self.edges[pieces], self.edges[pieces + 1]
        uniform = np.clip(0.5, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        return np.clip(special.ndtri(uniform), -FARTHEST, FARTHEST)


@dataclass(frozen=True, eq=False)
class Stratum(Fixed):
    """Stratum: some draws restricted to some of their values, in one or several combinations.

    Attributes:
        cuts: For each restricted draw, groups of intervals ``(k, 2)`` of its uniform number, the usual one first.
        combinations: Combinations of the stratum: one group of each such draw.
        shares: ``(combinations,)`` fractions of the stratum.
    """

    space: Space
    probability: float = 1.0
    cuts: Mapping[str, tuple[Array, ...]] = field(default_factory=dict)
    combinations: tuple[tuple[int, ...], ...] = ((),)
    shares: Array = field(default_factory=lambda: np.ones(1))

    @property
    def rare(self) -> tuple[str, ...]:
        """Draws with a rare value in any of the combinations."""
        return tuple(name for k, name in enumerate(self.cuts) if any(key[k] for key in self.combinations))

    def rare_at(self, normals: Array) -> tuple[str, ...]:
        """Return the draws with a rare value at a point ``(d,)``."""
        index, _ = self._select_combinations(normals[:, None])
        return tuple(name for name, group in zip(self.cuts, self.combinations[index[0]], strict=True) if group)

    def values(self, normals: Array) -> Array:
        """Return component values ``(d, N)`` for standard normal numbers ``(d, N)``; see :func:`from_normals`."""
        u = np.clip(np.asarray(normals, dtype=float), -FARTHEST, FARTHEST)
        x: Array = np.empty_like(u)
        scores = u.copy()
        uniforms = self._uniforms(u)
        for name, rows, root in self._mixing:
            if name in uniforms:
                scores[rows[0]] = np.clip(special.ndtri(uniforms[name]), -FARTHEST, FARTHEST)
            scores[rows] = np.clip(root @ scores[rows], -FARTHEST, FARTHEST)
        for draw, columns in zip(self.space.draws, self.space.slices, strict=True):
            if draw.name in uniforms:
                x[columns] = draw.law.sample(np.tile(uniforms[draw.name], (draw.law.size, 1)))
            else:
                x[columns] = draw.law.from_normals(scores[columns])
        return x

    @cached_property
    def jumps(self) -> tuple[Jump, ...]:
        """Normal numbers with jumps within the stratum."""
        jumps = []
        correlated = {name for correlation in self.space.correlations for name in correlation.names}
        for draw, columns in zip(self.space.draws, self.space.slices, strict=True):
            cells = _cells(draw.law)
            if cells is None or draw.name in correlated:
                continue  # correlated draws change the others continuously
            if draw.name == self._selector and len(self.combinations) > 1:
                edges = np.concatenate([[0.0], np.cumsum(self.shares)])
            else:
                groups = {key[list(self.cuts).index(draw.name)] for key in self.combinations if draw.name in self.cuts}
                if len(groups) > 1:
                    continue
                parts = self.cuts[draw.name][groups.pop()] if groups else _pieces(draw.law, cells)
                edges = np.concatenate([[0.0], np.cumsum(parts[:, 1] - parts[:, 0])])
            if edges.size > 2:
                jumps.append(Jump(columns.start, edges / edges[-1]))
        return tuple(jumps)

    @cached_property
    def is_symmetric(self) -> bool:
        """True if no number jumps within the stratum and all laws are symmetric."""
        moments = [draw.law.standardised_moments() for draw in self.space.draws if draw.name not in self.cuts]
        return not self.jumps and all(m and abs(m[0]) <= _SKEWED for m in moments)

    @cached_property
    def certain(self) -> bool:
        """True if only the combination varies within the stratum."""
        return all(
            (draw.name in self.cuts and all(len(cut) == 1 for cut in self.cuts[draw.name]) and _is_discrete(draw.law))
            or not draw.law.covariance.any()
            for draw in self.space.draws
        )

    @property
    def middles(self) -> Array:
        """Normal numbers ``(d, combinations)`` in the middle of each combination."""
        normals = np.zeros((self.space.size, len(self.combinations)))
        if self._selector:
            normals[self._rows[self._selector].start] = special.ndtri(np.cumsum(self.shares) - self.shares / 2)
        return normals

    @property
    def _selector(self) -> str:
        """Draw whose number selects the combination, and then a value within its group."""
        return next(iter(self.cuts), "")

    def _select_combinations(self, u: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the combination of each sample, and the relative position of its uniform number within it."""
        if len(self.combinations) == 1:
            at = special.ndtr(u[self._rows[self._selector].start]) if self.cuts else np.zeros(u.shape[1])
            return np.zeros(u.shape[1], dtype=np.intp), at
        bounds = np.cumsum(self.shares)
        at = special.ndtr(u[self._rows[self._selector].start]) * bounds[-1]
        index = np.minimum(np.searchsorted(bounds, at, side="right"), bounds.size - 1)
        return index, np.clip((at - (bounds - self.shares)[index]) / self.shares[index], 0.0, 1.0)

    def _uniforms(self, u: Array) -> dict[str, Array]:
        index, selector_position = self._select_combinations(u)
        uniforms = {}
        for k, (name, cuts) in enumerate(self.cuts.items()):
            position = selector_position if name == self._selector else special.ndtr(u[self._rows[name].start])
            groups = np.array([key[k] for key in self.combinations])
            if all(len(cut) == 1 for cut in cuts):
                low, high = np.concatenate(cuts)[groups[index]].T
                uniforms[name] = np.minimum(low + position * (high - low), np.nextafter(high, 0))
                continue
            present = np.unique(groups)
            if present.size == 1:
                uniforms[name] = _within(cuts[present[0]], position)
                continue
            uniforms[name] = np.empty(u.shape[1])
            for group in present:
                is_here = groups[index] == group
                uniforms[name][is_here] = _within(cuts[group], position[is_here])
        return uniforms

    @cached_property
    def _rows(self) -> dict[str, slice]:
        return {draw.name: rows for draw, rows in zip(self.space.draws, self.space.slices, strict=True)}

    @cached_property
    def _mixing(self) -> tuple[tuple[str, list[int], Array], ...]:
        """First name, rows and triangular root of each correlation, with restricted or else jumping draws first."""
        mixing = []
        laws = {draw.name: draw.law for draw in self.space.draws}
        for correlation in self.space.correlations:
            order = sorted(
                range(len(correlation.names)),
                key=lambda k: (correlation.names[k] not in self.cuts, _cells(laws[correlation.names[k]]) is None),
            )
            matrix = np.array(correlation.matrix)[np.ix_(order, order)]
            rows = [self.space.index[correlation.names[k]] for k in order]
            mixing.append((correlation.names[order[0]], rows, np.linalg.cholesky(matrix)))
        return tuple(mixing)


@dataclass(frozen=True, eq=False)
class Strata:
    """Mutually exclusive strata, and the probability outside all of them."""

    parts: tuple[Stratum, ...]
    remainder: float = 0.0


def from_normals(space: Space, normals: Array) -> Array:
    """Return component values ``(d, N)``, distributed by their laws, for standard normal numbers ``(d, N)``.

    A number is F⁻¹(Φ(u)), for correlated draws after mixing. The point of a disc lies in the direction of its two
    numbers at r √(1 - exp(-|u|²/2)), because polar coordinates would be discontinuous at one angle. The angle of a
    circle is 4πΦ(u₁), so that every angle is reached within 0.7 of the middle; so is that of a
    sphere about z, beside its height r (2Φ(u₂) - 1). Numbers beyond ±8.2 are clipped.
    """
    return Stratum(space).values(normals)


def stratified(space: Space, margin: Callable[[Array], Array], sides: Callable[[Array], Array] | None = None) -> Strata:
    """Return the strata of a space for a limit state ``margin``, ``(N,)`` for component values ``(d, N)``.

    For a law of at most eight cells (values, or lines between quantiles), every cell with a probability below 0.1 is a
    group of its own. For other laws, such as large tables, the cells are sorted by ascending margin; those up to a
    cumulative probability of 0.01 form one group for each power of ten. So do cells with a probability below 0.1 that
    lie apart to one of the ``sides``. The remaining cells are the usual group. Strata are combinations of groups: first
    the usual groups of all draws, then combinations of similar probability together, at most 256 in a stratum and 32
    strata. If these leave out more than 1e-9, only cells below 0.01 become groups.
    """
    correlated = {name for correlation in space.correlations for name in correlation.names}
    for limit in (OFTEN, RARE):
        groups: dict[str, list[Array]] = {}
        for draw, columns in zip(space.draws, space.slices, strict=True):
            cells = _cells(draw.law)
            if cells is not None and len(cells) > 1 and _has_jump(draw.law):
                bound = RARE if draw.name in correlated else limit
                draw_groups = _groups(space, draw, columns, cells, margin, sides or margin, bound)
                if len(draw_groups) > 1:
                    groups[draw.name] = draw_groups
        strata = _combine(space, groups, correlated)
        if strata.remainder <= NEGLIGIBLE:
            break
    return strata


def _combine(space: Space, groups: dict[str, list[Array]], correlated: set[str]) -> Strata:
    remainder = 0.0
    for correlation in space.correlations:
        names = [name for name in correlation.names if name in groups]
        rare = {name: sum(map(_length, groups[name][1:])) for name in names}
        # of correlated draws only one is restricted; for the rare values of the others only the probability is known
        for name in sorted(names, key=rare.__getitem__, reverse=True)[1:]:
            remainder += rare[name]
            del groups[name]
    if not groups:
        return Strata((Stratum(space),), remainder)
    # the combination is selected by draws without correlation
    cuts = {name: tuple(groups[name]) for name in sorted(groups, key=lambda name: name in correlated)}
    combinations: list[tuple[float, tuple[int, ...]]] = [(1.0, ())]
    for draw_cuts in cuts.values():
        wider = [(p * _length(cut), (*key, k)) for p, key in combinations for k, cut in enumerate(draw_cuts)]
        combinations = sorted((entry for entry in wider if entry[0] > LEAST), key=lambda entry: -entry[0])[:4096]
    parts = []
    for group in _decades(combinations)[:32]:
        probabilities = np.array([p for p, _ in group])
        total = float(probabilities.sum())
        parts.append(Stratum(space, total, cuts, tuple(key for _, key in group), probabilities / total))
    if sum(len(part.combinations) for part in parts) < math.prod(map(len, cuts.values())):
        remainder += max(0.0, 1 - math.fsum(part.probability for part in parts))
    return Strata(tuple(parts), min(remainder, 1.0))


def _decades(combinations: Sequence[tuple[float, tuple[int, ...]]]) -> list[list[tuple[float, tuple[int, ...]]]]:
    """Return the combinations, most probable first, grouped by the power of ten of their probability."""
    groups: list[list[tuple[float, tuple[int, ...]]]] = []
    for entry in combinations:
        if groups and len(groups[-1]) < 256 and groups[-1][0][0] < 10 * entry[0] and any(groups[-1][0][1]):
            groups[-1].append(entry)
        else:
            groups.append([entry])
    return groups


def _within(cut: Array, uniforms: Array) -> Array:
    lengths = cut[:, 1] - cut[:, 0]
    bounds = np.cumsum(lengths)
    at = uniforms * bounds[-1]
    cells = np.minimum(np.searchsorted(bounds, at, side="right"), len(cut) - 1)
    return np.minimum(cut[cells, 0] + (at - (bounds - lengths)[cells]), np.nextafter(cut[cells, 1], 0))


def _is_discrete(law: Law) -> bool:
    return law.cell_edges is not None and law.lines is None


def _length(cut: Array) -> float:
    return float((cut[:, 1] - cut[:, 0]).sum())


def _cells(law: Law) -> Array | None:
    """Return the intervals ``(k, 2)`` of the uniform number on which a law is constant or linear; else None."""
    edges = law.cell_edges
    if edges is None:
        return None
    cells = np.column_stack([edges[:-1], edges[1:]])
    return cells[cells[:, 1] > cells[:, 0]]


def _pieces(law: Law, cells: Array) -> Array:
    """Return the cells, merged where the law is continuous from one to the next."""
    return cells if law.lines is None else _merge(cells, law.lines)


def _merge(cells: Array, lines: Array) -> Array:
    is_start = np.concatenate([[True], (lines[1:, 1] != lines[:-1, 3]) | (cells[1:, 0] != cells[:-1, 1])])
    is_end = np.append(is_start[1:], True)
    return np.column_stack([cells[is_start, 0], cells[is_end, 1]])


def _has_jump(law: Law) -> bool:
    """Return whether a law has a jump or a steep rise, a tenth of its range within half a normal score."""
    if law.lines is None:
        return True
    begin, value, _, last = law.lines.T
    low, high = value[0], last[-1]
    scores = special.ndtri(np.append(begin, 1.0))
    steep = np.abs(last - value) > _STEEP_SHARE * (high - low)
    torn = np.abs(value[1:] - last[:-1]) > _STEEP_SHARE * (high - low)
    return bool((steep & (np.diff(scores) < 0.5)).any() or torn.any())


def _groups(
    space: Space,
    draw: Draw,
    columns: slice,
    cells: Array,
    margin: Callable[[Array], Array],
    sides: Callable[[Array], Array],
    limit: float,
) -> list[Array]:
    """Return the usual cells of a draw, then groups of rare ones; each as intervals ``(k, 2)``."""
    shares = cells[:, 1] - cells[:, 0]
    if shares.min() >= limit:
        return [cells]
    severity, matters = _severity(space, draw, columns, cells, margin)
    if not matters:
        return [cells]
    if len(cells) <= 8:
        labels = np.where(shares < limit, np.arange(1, len(cells) + 1), 0)
        if not (labels == 0).any():
            return [cells]
    else:
        order = np.argsort(severity, kind="stable")
        reached = np.empty(len(cells))
        reached[order] = np.cumsum(shares[order])
        decade = np.minimum(np.floor(np.log10(np.maximum(reached, 1e-16)) + 1e-9), math.log10(RARE) - 1)
        labels = np.where(reached < RARE, -decade, 0).astype(int)
        for across in _severities(space, draw, columns, cells, sides, 1)[0] if limit > RARE else ():
            order = np.argsort(across, kind="stable")
            is_gap = (np.diff(across[order]) > _GAP * np.ptp(across)) & (np.cumsum(shares[order])[:-1] < limit)
            groups = np.append(np.cumsum(is_gap[::-1])[::-1], 0) + (labels.max() + 1)
            isolated = order[(groups > groups[-1]) & (labels[order] == 0)]
            labels[isolated] = groups[np.argsort(order)][isolated]
    result = []
    # the usual cells have the label 0
    for label in (0, *sorted(set(labels[labels != 0].tolist()))):
        is_in_group = labels == label
        result.append(_arrange_cells(draw.law, cells[is_in_group], severity[is_in_group], is_in_group))
    return result


def _severity(
    space: Space, draw: Draw, columns: slice, cells: Array, margin: Callable[[Array], Array]
) -> tuple[Array, bool]:
    """Return the least margin in each cell over several values of the others, and whether it depends on the cell."""
    minima, maxima = _severities(space, draw, columns, cells, margin, 8)
    span = maxima.max(axis=1) - minima.min(axis=1)
    matters = bool((span > 1e-12 * (1 + np.abs(minima).max(axis=1))).any())
    return minima.min(axis=0), matters


def _severities(
    space: Space, draw: Draw, columns: slice, cells: Array, margin: Callable[[Array], Array], most_probes: int
) -> tuple[Array, Array]:
    """Return the least and the largest margin in each cell, ``(values of the others or sides, cells)``."""
    # just inside both ends, and the middle
    positions = np.array([1e-9, 0.5, 1 - 1e-9]) if draw.law.lines is not None else np.array([0.5])
    # fewer values of the others for a law of many cells
    count = max(1, min(most_probes, 100_000 // (positions.size * len(cells))))
    probes = np.random.Generator(np.random.Philox(0)).standard_normal((space.size, count))
    probes[:, 0] = 0.0
    values = from_normals(space, probes)
    parts = []
    step = max(1, 16_384 // (count * positions.size))
    for start in range(0, len(cells), step):
        part = cells[start : start + step]
        uniforms = (part[:, :1] + (part[:, 1:] - part[:, :1]) * positions).ravel()
        x = np.repeat(values, uniforms.size, axis=1)
        x[columns] = draw.law.sample(np.tile(uniforms, (draw.law.size, count)))
        parts.append(margin(x).reshape(-1, len(part), positions.size))
    margins = np.concatenate(parts, axis=1)
    return margins.min(axis=2), margins.max(axis=2)


def _arrange_cells(law: Law, cells: Array, severity: Array, is_in_group: NDArray[np.bool_]) -> Array:
    """Return the chosen cells: values sorted by their margin, lines between quantiles merged where adjacent."""
    if law.lines is None:
        return cells[np.argsort(severity, kind="stable")]
    return _merge(cells, law.lines[is_in_group])
