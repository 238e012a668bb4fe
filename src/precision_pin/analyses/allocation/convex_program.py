"""Cheapest tolerances under limits of the first-order model: solution, multipliers, lower bound of the cost.

In x = ln t every limit is the logarithm of a measure of the error, convex in x for the root mean square and the worst
case. In t these limits and the costs are convex. The Lagrangian is a sum over the tolerances, and its minimum at any
multipliers, found one tolerance at a time, is a lower bound of the cost. A quantile is replaced by its tangent in t²:
its bound holds where the variances that keep the quantile form a convex set.

A grade is a binary variable. In these, t and t² are linear, so that a worst case and a root mean square are linear
rows; a quantile is a row tangent to the set of variances that keep it, added where it is exceeded. A tolerance without
grades has t, t² and its cost as variables, bounded by tangents. The mixed-integer linear programme, solved by branch
and bound (HiGHS), gives a lower bound of the cost; with its grades fixed, the exact programme chooses the others and
gives an upper bound. Both are repeated with more tangents until they meet (Duran, Grossmann, Mathematical Programming
36, 307, 1986).
"""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from time import monotonic
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from precision_pin.analyses import first_order
from precision_pin.analyses.allocation.tolerances import Cost, Grades
from precision_pin.base.arrays import Array, Fixed, Record, read_only

ROUNDING: Final = 1e-9
"""Relative excess of a limit that counts as rounding."""
# points of a line evaluated together
_AT_ONCE: Final = 34


def last_kept(kept: Callable[[Array], NDArray[np.bool_]]) -> tuple[float, float]:
    """Return the last kept fraction of a line from 0 (kept) to 1 (not kept), and the first that is not kept."""
    least, most = 0.0, 1.0
    while most - least > ROUNDING:
        shares = np.linspace(least, most, _AT_ONCE)
        first = int(np.argmin(np.concatenate([[True], kept(shares[1:-1]), [False]])))
        least, most = float(shares[first - 1]), float(shares[first])
    return least, most


@dataclass(frozen=True, eq=False)
class Limit(Fixed):
    """A limit at every pose.

    Attributes:
        kind: ``"quantile"``, ``"rms"`` or ``"worst_case"``.
        limit, probability: Largest value, m or rad; probability of a quantile.
        rows: Limited components of the error.
        mean, fixed: Rows of the error at the means ``(r, P)``, and their covariance (worst case: largest deviation,
            ``(r, 1, P)``) that no tolerance changes, ``(r, r, P)``.
        parts: The same for each tolerance of 1 m or rad, ``(n, r, r, P)`` (worst case ``(n, r, 1, P)``); then the
            contributions of products of two tolerances.
        pairs: Numbers of these two, n for the part that no tolerance changes; ``(m, 2)``.
    """

    kind: str
    limit: float
    probability: float
    rows: tuple[int, ...]
    mean: Array
    fixed: Array
    parts: Array
    pairs: NDArray[np.intp] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.intp))

    @property
    def has_bound(self) -> bool:
        """Whether the variances that keep the limit form a convex set.

        Those of one component are below a bound; of the quantile of a norm they formed one in all trials, from 92 %.
        """
        is_convex = self.kind != "quantile" or (len(self.rows) == 1 and self.probability >= 0.5)
        # lowest probability from which no two covariances that keep the quantile were found with one between them
        # that does not
        return is_convex or self.probability >= 0.92

    @cached_property
    def _last(self) -> dict[bytes, Array]:
        return {}

    def measure(self, t: Array) -> Array:
        """Return the limited value ``(m, places)`` for tolerances ``(n, m)``; places are poses, or rows times poses.

        The last one is kept: values and slopes are asked for at the same tolerances in turn.
        """
        key = t.tobytes()
        if key not in self._last:
            self._last.clear()
            self._last[key] = read_only(self._measure(t))
        return self._last[key]

    def _measure(self, t: Array) -> Array:
        if self.kind == "worst_case":
            sums = np.abs(self.mean)[None] + self.fixed[:, 0] + np.einsum("nrp,nm->mrp", self.parts[:, :, 0], t)
            return np.asarray(sums.reshape(t.shape[1], -1))
        if self.kind == "rms":
            still = (self.mean**2).sum(axis=0) + np.einsum("iip->p", self.fixed)
            varying = np.einsum("niip,nm->mp", self.parts, self._products(t))
            return np.asarray(np.sqrt(np.maximum(still + varying, 0.0)))
        quantiles = first_order.norm_quantiles(*first_order.principal_axes(*self._vectors(t)), self.probability)
        return np.asarray(quantiles.reshape(t.shape[1], -1))

    def probabilities(self, t: Array) -> Array:
        """Return the probability that a normal error keeps the limit of a quantile, ``(P,)``."""
        axes = first_order.principal_axes(*self._vectors(t[:, None]))
        return first_order.norm_probabilities(*axes, np.full(axes[0].shape[1], self.limit))

    def excess(self, t: Array) -> Array:
        """Return ln of the measure over its limit, ``(places,)``."""
        return np.asarray(np.log(np.maximum(self.measure(t[:, None])[0], 1e-300) / self.limit))

    def at_place(self, pose: int) -> Limit:
        """Return the limit at one pose alone."""
        only = slice(pose, pose + 1)
        return replace(self, mean=self.mean[..., only], fixed=self.fixed[..., only], parts=self.parts[..., only])

    def log_slopes(self, t: Array) -> Array:
        """Return the derivatives of ln of the measure with respect to ln t, ``(n, places)``."""
        value = self.measure(t[:, None])[0]
        if self.kind == "worst_case":
            by_tolerance = (self.parts[:, :, 0] * t[:, None, None]).reshape(len(t), -1)
            return np.asarray(by_tolerance / np.maximum(value, 1e-300))
        if self.kind == "rms":
            by_product = np.einsum("niip->np", self.parts)
            return np.asarray(self._by_tolerance(by_product, t) / np.maximum(2 * value**2, 1e-300))
        mean, covariance = self._vectors(t[:, None])
        rows = len(self.mean)
        slopes = first_order.norm_quantile_slopes(mean, covariance, value)[:rows, :rows]
        by_product = np.einsum("nijp,ijp->np", self.parts, slopes)
        return np.asarray(self._by_tolerance(by_product, t) / np.maximum(value, 1e-300))

    def _products(self, t: Array) -> Array:
        """Return the squares of tolerances ``(n, m)``, then the products of pairs."""
        if not len(self.pairs):
            return t**2
        known = np.vstack([t, np.ones((1, t.shape[1]))])
        return np.vstack([t**2, known[self.pairs[:, 0]] * known[self.pairs[:, 1]]])

    def _by_tolerance(self, by_product: Array, t: Array) -> Array:
        """Return derivatives with respect to ln t ``(n, places)`` from those with respect to squares and products."""
        parts = by_product * self._products(t[:, None])
        slopes = np.vstack([2 * parts[: len(t)], np.zeros((1, parts.shape[1]))])
        for one in range(2):
            np.add.at(slopes, self.pairs[:, one], parts[len(t) :])
        return np.asarray(slopes[: len(t)])

    def _vectors(self, t: Array) -> tuple[Array, Array]:
        """Return mean and covariance, ``(3, m P)`` and ``(3, 3, m P)``, for tolerances ``(n, m)``; other rows are 0."""
        rows, poses = self.mean.shape
        several = t.shape[1]
        covariance = self.fixed[:, :, None] + np.einsum("nijp,nm->ijmp", self.parts, self._products(t))
        padded, mean = np.zeros((3, 3, several * poses)), np.zeros((3, several * poses))
        padded[:rows, :rows] = covariance.reshape(rows, rows, -1)
        mean[:rows] = np.tile(self.mean, several)
        return mean, padded


@dataclass(frozen=True, eq=False)
class Solution(Fixed):
    """Cheapest tolerances.

    Attributes:
        t: Tolerances ``(n,)``.
        cost: Sum of their costs.
        lower_bound: No tolerances that keep the limits cost less; for the quantile of a norm, if the variances that
            keep it form a convex set. ``None`` where these do not, below 92 %, or where it was not found in time.
        prices: Derivative of the least cost with respect to each limit, with its sign changed.
        bound_prices: Saving per m or rad of a tolerance held by its bounds, ``(n,)``; negative at the lower bound.
    """

    t: Array
    cost: float
    lower_bound: float | None
    prices: tuple[float, ...]
    bound_prices: Array


@dataclass(frozen=True, eq=False)
class Programme:
    """Minimise the sum of the costs within bounds ``low``, ``high`` and limits; each tolerance's ``costs`` add up."""

    costs: Sequence[Sequence[Cost | Grades]]
    low: Array
    high: Array
    limits: Sequence[Limit]

    def cost_of(self, t: Array) -> Array:
        """Return the cost of each tolerance, ``(n, …)``."""
        pairs = zip(self.costs, t, strict=True)
        return np.stack([sum((cost.at(one) for cost in own), np.zeros_like(one)) for own, one in pairs])

    def slope_of(self, t: Array) -> Array:
        """Return the derivative of each cost with respect to its tolerance, ``(n, …)``."""
        pairs = zip(self.costs, t, strict=True)
        return np.stack([sum((cost.slope(one) for cost in own), np.zeros_like(one)) for own, one in pairs])

    def shares(self, t: Array) -> Array:
        """Return each measure over its limit, ``(m, all places)``, for tolerances ``(n, m)``."""
        return np.hstack([one.measure(t) / one.limit for one in self.limits])

    def exceeded(self, t: Array) -> Array:
        """Return ln of each measure over its limit, ``(all places,)``: positive where a limit is exceeded."""
        return np.asarray(np.log(np.maximum(self.shares(t[:, None])[0], 1e-300)))

    @property
    def is_monotone(self) -> bool:
        """Whether every narrower tolerance makes every error smaller; correlated ones may cancel each other."""
        return not any(len(one.pairs) for one in self.limits)

    @cached_property
    def least(self) -> Array:
        """Tolerances that exceed the limits least: the narrowest, or those that minimise the largest measure."""
        if self.is_monotone or self.exceeded(self.low).max() <= 0 or (self.low == self.high).all():
            return self.low
        low, high = np.log(self.low), np.log(self.high)
        count = len(low)

        def slopes(x: Array) -> Array:
            falls = -np.hstack([one.log_slopes(np.exp(x[:count])) for one in self.limits]).T
            return np.column_stack([falls, np.ones(len(falls))])

        found: Any = optimize.minimize(
            lambda x: float(x[count]),
            np.append(low, self.exceeded(self.low).max()),
            jac=lambda _: np.append(np.zeros(count), 1.0),
            bounds=[*zip(low, high, strict=True), (None, None)],
            constraints={"type": "ineq", "fun": lambda x: x[count] - self.exceeded(np.exp(x[:count])), "jac": slopes},
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-12},
        )
        reached = np.exp(np.clip(found.x[:count], low, high))
        return min(self.low, reached, key=lambda t: float(self.exceeded(t).max()))

    def solve(self, near: Array | None = None) -> Solution | None:
        """Return the cheapest tolerances, starting from ``near``, or ``None`` where even `least` exceeds a limit."""
        if self.exceeded(self.least).max() > ROUNDING:
            return None
        if (self.low == self.high).all():
            return self.priced(self.low)
        low, high = np.log(self.low), np.log(self.high)
        start = self._largest_within(np.log(self.least), high if near is None else np.clip(np.log(near), low, high))
        scale = float(np.abs(self.slope_of(np.exp(start)) * np.exp(start)).sum()) or 1.0
        found: Any = optimize.minimize(
            lambda x: float(self.cost_of(np.exp(x)).sum()) / scale,
            start,
            jac=lambda x: self.slope_of(np.exp(x)) * np.exp(x) / scale,
            bounds=list(zip(low, high, strict=True)),
            constraints={
                "type": "ineq",
                "fun": lambda x: -self.exceeded(np.exp(x)),
                "jac": lambda x: -np.hstack([one.log_slopes(np.exp(x)) for one in self.limits]).T,
            },
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-14},
        )
        # the lower bound, not the solver's flag, measures the quality; limits are kept to rounding only, so step back
        x = self._largest_within(np.log(self.least), np.clip(found.x, low, high))
        return self.priced(np.exp(x))

    def _largest_within(self, kept: Array, high: Array) -> Array:
        """Return the point closest to ``high`` on the line from ``kept`` that keeps all limits."""
        if self.exceeded(np.exp(high)).max() <= ROUNDING:
            return high
        least, _ = last_kept(
            lambda shares: self.shares(np.exp(kept[:, None] + shares * (high - kept)[:, None])).max(axis=1) <= 1
        )
        return kept + least * (high - kept)

    def priced(self, t: Array) -> Solution:
        """Return a solution with its multipliers, by non-negative least squares of the first-order conditions."""
        falls = -self.slope_of(t) * t
        slopes = [one.log_slopes(t) for one in self.limits]
        places = np.repeat(np.arange(len(self.limits)), [one.shape[1] for one in slopes])
        # relative distance from a limit below which it is active
        active = np.flatnonzero(self.exceeded(t) > -1e-5)
        multipliers = np.zeros(len(places))
        free = (t > self.low * (1 + 1e-7)) & (t < self.high * (1 - 1e-7))
        if len(active) and free.any():
            gradient = np.hstack(slopes)[:, active][free]
            # conditions weighted by the effect of each tolerance
            weights = 1 / np.maximum(falls[free], 1e-300)
            multipliers[active] = optimize.nnls(gradient * weights[:, None], falls[free] * weights)[0]
        total = tuple(float(multipliers[places == k].sum() / one.limit) for k, one in enumerate(self.limits))
        rest = (falls - np.hstack(slopes) @ multipliers) / t
        convex = all(one.has_bound for one in self.limits)
        bound = self._lower_bound(t, slopes, multipliers, places) if convex else None
        return Solution(t, float(self.cost_of(t).sum()), bound, total, np.where(free, 0.0, rest))

    def _lower_bound(self, t: Array, slopes: Sequence[Array], multipliers: Array, places: NDArray[np.intp]) -> float:
        """Return the minimum of the Lagrangian in t, with quantiles replaced by tangents in t² (t if correlated)."""
        square, line = np.zeros(len(self.low)), np.zeros(len(self.low))
        constant = 0.0
        for k, one in enumerate(self.limits):
            own = multipliers[places == k]
            if len(one.pairs) or one.kind == "quantile":
                # with correlated tolerances the measure is convex in t, not in t²
                sums, power = (line, 1) if len(one.pairs) else (square, 2)
                half = slopes[k] @ own / power
                sums += half / t**power
                constant += float(own @ one.excess(t) - half.sum())
            elif one.kind == "rms":
                own = own / (2 * one.limit**2)
                still = (one.mean**2).sum(axis=0) + np.einsum("iip->p", one.fixed)
                square += np.einsum("niip,p->n", one.parts, own)
                constant += float(own @ (still - one.limit**2))
            else:
                own = own / one.limit
                still = (np.abs(one.mean) + one.fixed[:, 0]).reshape(-1)
                line += one.parts[:, :, 0].reshape(len(line), -1) @ own
                constant += float(own @ (still - one.limit))
        low, high = self.low.copy(), self.high.copy()
        for _ in range(200):
            middle = np.sqrt(low * high)
            falls = self.slope_of(middle) + 2 * square * middle + line < 0
            low, high = np.where(falls, middle, low), np.where(falls, high, middle)
        least = np.sqrt(low * high)
        return float((self.cost_of(least) + square * least**2 + line * least).sum() + constant)


# fraction of the cost that may remain between the bounds
_GAP: Final = 1e-6
# relative distance from a limit below which its tangent is added
_NEAR: Final = 1e-4
# factor on tolerances that keep the limits, after which the line to them leaves the limits close by
_BEYOND: Final = 1.5
_ROUNDS: Final = 1000


def solve(
    programme: Programme,
    choices: Sequence[Array | None],
    seconds: float,
    advance: Callable[[int], None],
    near: Array | None = None,
) -> Solution | None:
    """Return the cheapest tolerances, or ``None`` where even the narrowest exceed a limit.

    ``choices`` are the available values of each variable, narrowest first, or ``None`` for any. With grades, after
    ``seconds`` the best so far is returned, with its lower bound, and ``advance`` is called with 0 after each round of
    both bounds; without any, the search starts from ``near``.
    """
    fixed = np.array([one is not None for one in choices])
    if not fixed.any():
        return programme.solve(near)
    end = monotonic() + max(seconds, 0.0)

    def solved_at(t: Array) -> Solution | None:
        low, high = np.where(fixed, t, programme.low), np.where(fixed, t, programme.high)
        return replace(programme, low=low, high=high).solve()

    best = solved_at(programme.low)
    if best is None and (programme.is_monotone or programme.exceeded(programme.least).max() > ROUNDING):
        return None
    if best is not None and fixed.all():
        best = solved_at(_widened(programme, choices)) or best
    relaxed = _Relaxation(programme, choices, (0.0 if best is None else abs(best.cost)) or 1.0)
    relaxed.cut(programme.high)
    if best is not None:
        relaxed.cut(best.t * _BEYOND)
    bound, seen = -np.inf, set[bytes]()
    for k in range(_ROUNDS):
        left = end - monotonic()
        if left <= 0 and k:
            break
        # least time for the first lower bound, in seconds
        t, found = relaxed.solve(max(left, 0.5))
        gained, bound = found - bound, max(bound, found)
        if t is None or (best is not None and best.cost - bound <= _GAP * abs(best.cost)):
            break
        if t[fixed].tobytes() in seen:
            # the remaining gap is then rounding of the linear programme
            if best is not None and gained <= _GAP / 10 * abs(best.cost):
                break
        elif (solution := solved_at(t)) is None:
            relaxed.refuse(t)
        else:
            seen.add(t[fixed].tobytes())
            best = solution if best is None else min(best, solution, key=lambda one: one.cost)
            relaxed.touch(solution.t)
        relaxed.add_tangents(t)
        relaxed.cut(t)
        advance(0)
    if best is None:
        return None
    known = np.isfinite(bound) and all(one.has_bound for one in programme.limits)
    return replace(best, lower_bound=min(bound, best.cost) if known else None)


def _widened(programme: Programme, choices: Sequence[Array | None]) -> Array:
    """Return grades that keep the limits: from the narrowest, widening where most is saved for the reserve it costs."""
    places = np.zeros(len(choices), dtype=int)
    lists = [np.asarray(one) for one in choices]
    t = np.array([own[0] for own in lists])
    while True:
        steps = [k for k, own in enumerate(lists) if places[k] + 1 < len(own)]
        if not steps:
            return t
        tried = np.tile(t[:, None], len(steps))
        for column, k in enumerate(steps):
            tried[k, column] = lists[k][places[k] + 1]
        used, before = programme.shares(tried), programme.shares(t[:, None])
        saved = programme.cost_of(t[:, None]).sum() - programme.cost_of(tried).sum(axis=0)
        lost = np.maximum((used**2 - before**2).sum(axis=1), 1e-12)
        worth = np.where(used.max(axis=1) <= 1, saved / lost, -np.inf)
        chosen = int(worth.argmax())
        if not np.isfinite(worth[chosen]):
            return t
        t = tried[:, chosen]
        places[steps[chosen]] += 1


class _Relaxation:
    """Mixed-integer linear programme whose least cost is a lower bound; all numbers scaled to about 1."""

    def __init__(self, programme: Programme, choices: Sequence[Array | None], cost: float) -> None:
        self._programme = programme
        self._choices = [
            own if own is None or not programme.is_monotone else _worthwhile(programme, k, own)
            for k, own in enumerate(choices)
        ]
        counts = [3 if own is None else len(own) for own in self._choices]
        ends = np.cumsum(counts)
        self._columns = [slice(end - count, end) for end, count in zip(ends, counts, strict=True)]
        count, size = int(ends[-1]), len(choices)
        self._widest = programme.high
        self._scale = cost
        self._t, self._square = np.zeros((size, count)), np.zeros((size, count))
        self._cost, self._integral = np.zeros(count), np.zeros(count)
        self._lower, self._upper = np.zeros(count), np.ones(count)
        self._rows: list[Array] = []
        self._most: list[float] = []
        # limits that are no linear rows in t or t²
        self._curved = [one for one in programme.limits if one.kind == "quantile" or len(one.pairs)]
        costs = programme.cost_of
        for k, (own, columns) in enumerate(zip(self._choices, self._columns, strict=True)):
            if own is None:
                first = columns.start
                self._t[k, first] = self._square[k, first + 1] = self._cost[first + 2] = 1.0
                least = programme.low[k] / self._widest[k]
                ends_of_cost = [float(costs(end)[k]) / self._scale for end in (programme.high, programme.low)]
                self._lower[columns] = least, least**2, ends_of_cost[0]
                self._upper[columns] = 1.0, 1.0, ends_of_cost[1]
            else:
                grades = np.tile(programme.low[:, None], len(own))
                grades[k] = own
                self._t[k, columns] = own / self._widest[k]
                self._square[k, columns] = (own / self._widest[k]) ** 2
                self._cost[columns] = costs(grades)[k] / self._scale
                self._integral[columns] = 1.0
        for one in programme.limits:
            if one.kind == "rms" and not len(one.pairs):
                still = (one.mean**2).sum(axis=0) + np.einsum("iip->p", one.fixed)
                for place, parts in enumerate(np.einsum("niip->pn", one.parts)):
                    self._add((parts * self._widest**2 / one.limit**2) @ self._square, 1 - still[place] / one.limit**2)
            elif one.kind == "worst_case":
                still = (np.abs(one.mean) + one.fixed[:, 0]).reshape(-1)
                for place, parts in enumerate(one.parts[:, :, 0].reshape(size, -1).T):
                    self._add((parts * self._widest / one.limit) @ self._t, 1 - still[place] / one.limit)
        # initial tangents of each tolerance without grades
        for share in np.linspace(0, 1, 12):
            self.add_tangents(np.exp((1 - share) * np.log(programme.low) + share * np.log(programme.high)))

    def solve(self, seconds: float) -> tuple[Array | None, float]:
        """Return the tolerances of the least cost, if any were found in time, and a lower bound of it."""
        chosen = [columns for own, columns in zip(self._choices, self._columns, strict=True) if own is not None]
        one_each = np.zeros((len(chosen), len(self._cost)))
        for row, columns in zip(one_each, chosen, strict=True):
            row[columns] = 1.0
        constraints = [optimize.LinearConstraint(one_each, 1.0, 1.0)]
        if self._rows:
            constraints.append(optimize.LinearConstraint(np.array(self._rows), -np.inf, np.array(self._most)))
        with without_solver_lines():
            found: Any = optimize.milp(
                self._cost,
                integrality=self._integral,
                bounds=optimize.Bounds(self._lower, self._upper),
                constraints=constraints,
                options={"time_limit": seconds, "mip_rel_gap": _GAP / 10},
            )
        bound = getattr(found, "mip_dual_bound", None)
        cost = -np.inf if bound is None or not np.isfinite(bound) else float(bound) * self._scale
        if found.x is None:
            return None, cost
        t = self._widest * np.sqrt(np.maximum(self._square @ found.x, 0.0))
        for k, (own, columns) in enumerate(zip(self._choices, self._columns, strict=True)):
            if own is not None:
                t[k] = own[int(found.x[columns].argmax())]
        return np.clip(t, self._programme.low, self._programme.high), cost

    def refuse(self, t: Array) -> None:
        """Demand somewhere a narrower grade than that of ``t``, if errors grow with every tolerance; else another."""
        row = np.zeros(len(self._cost))
        for k, (own, columns) in enumerate(zip(self._choices, self._columns, strict=True)):
            if own is not None:
                beyond = own > t[k] * (1 + ROUNDING) if not self._programme.is_monotone else False
                row[columns] = np.where((own < t[k] * (1 - ROUNDING)) | beyond, -1.0, 0.0)
        self._add(row, -1.0)

    def add_tangents(self, t: Array) -> None:
        """Bound t² and the cost of tolerances without grades by tangents at ``t``."""
        costs = self._programme.cost_of(t) / self._scale
        slopes = self._programme.slope_of(t) * self._widest / self._scale
        for k, (own, columns) in enumerate(zip(self._choices, self._columns, strict=True)):
            if own is not None:
                continue
            width, square, cost = range(columns.start, columns.stop)
            at = t[k] / self._widest[k]
            for changes, most in (
                ({width: 2 * at, square: -1.0}, at**2),
                ({width: slopes[k], cost: -1.0}, slopes[k] * at - costs[k]),
                ({square: slopes[k] / (2 * at), cost: -1.0}, slopes[k] * at / 2 - costs[k]),
            ):
                row = np.zeros(len(self._cost))
                row[list(changes)] = list(changes.values())
                self._rows.append(row)
                self._most.append(most)

    def touch(self, t: Array) -> None:
        """Add all tangents at tolerances ``t``, including those of active quantiles."""
        self.add_tangents(t)
        for one in self._curved:
            excess, slopes = one.excess(t), one.log_slopes(t)
            for place in np.flatnonzero(excess > -_NEAR):
                self._add_slope(one, slopes[:, place], t, -float(excess[place]))

    def cut(self, t: Array) -> None:
        """Add the tangents of the quantiles that ``t`` exceeds, each where the line to ``t`` in t² leaves the limit."""
        low = self._programme.least
        steps = t**2 - low**2

        def kept(only: Limit, shares: Array) -> NDArray[np.bool_]:
            return only.measure(np.sqrt((low**2)[:, None] + shares * steps[:, None]))[:, 0] <= only.limit

        for one in self._curved:
            for place in np.flatnonzero((one.excess(t) > 0) & (one.excess(low) <= 0)):
                only = one.at_place(int(place))
                _, most = last_kept(partial(kept, only))
                between = np.sqrt(low**2 + most * steps)
                self._add_slope(one, only.log_slopes(between)[:, 0], between, 0.0)

    def _add_slope(self, one: Limit, slopes: Array, t: Array, left: float) -> None:
        """Add the tangent of ln of a measure in t² (t if correlated), by its slopes in ln t and reserve ``left``."""
        if len(one.pairs):
            self._add((slopes / t * self._widest) @ self._t, float(slopes.sum()) + left)
        else:
            self._add((slopes / (2 * t**2) * self._widest**2) @ self._square, float(slopes.sum()) / 2 + left)

    def _add(self, row: Array, most: float) -> None:
        size = float(np.abs(row).max(initial=0.0))
        if size > 0:
            self._rows.append(row / size)
            self._most.append(most / size)


def _worthwhile(programme: Programme, k: int, grades: Array) -> Array:
    """Return the grades that are cheaper than every narrower one."""
    t = np.tile(programme.low[:, None], len(grades))
    t[k] = grades
    prices = programme.cost_of(t)[k]
    return np.asarray(grades[prices < np.minimum.accumulate(np.concatenate([[np.inf], prices[:-1]]))])


# beginning of a debug line that HiGHS 1.12 (SciPy 1.17) prints
_LINE: Final = b"HighsMipSolverData::transformNewIntegerFeasibleSolution"
_STDOUT: Final = 1


@contextmanager
def without_solver_lines() -> Iterator[None]:
    """Buffer standard output during the block, and write it afterwards without the solver's line."""
    _flush()
    try:
        kept = os.dup(_STDOUT)
    except OSError:  # standard output is closed
        yield
        return
    with tempfile.TemporaryFile() as held:
        os.dup2(held.fileno(), _STDOUT)
        try:
            yield
        finally:
            _flush()
            os.dup2(kept, _STDOUT)
            os.close(kept)
            held.seek(0)
            others = b"".join(line for line in held if not line.startswith(_LINE))
            with suppress(OSError):
                os.write(_STDOUT, others)


def _flush() -> None:
    with suppress(OSError, ValueError, AttributeError):
        sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)


MOST_POINTS: Final = 1000
# largest factor of the limits, and its inverse
_REACH: Final = 3.0
_EDGE: Final = 1.001


@dataclass(frozen=True, eq=False)
class FrontPoint(Record):
    """Cheapest first-order tolerances ``(n,)``, m or rad, for limits times ``factor``; no late lower bound."""

    factor: float
    cost: float
    lower_bound: float | None
    tolerances: Array


def pareto_front(
    programme: Programme,
    choices: Sequence[Array | None],
    members: NDArray[np.intp],
    count: int,
    seconds: float,
    advance: Callable[[int], None],
) -> tuple[FrontPoint, ...]:
    """Return points from a third of the limits (or the narrowest possible) to threefold (or the least cost).

    Args:
        members: Number of the group of each tolerance.
        count: Number of points; their factors have equal ratios, but for the one closest to 1, which is 1.
        seconds: Time for all points together, where there are grades.
        advance: Called with 1 after each point.
    """
    least = float(programme.shares(programme.low[:, None]).max()) * _EDGE
    most = float(programme.shares(programme.high[:, None]).max())
    first = max(least, 1 / _REACH)
    end = monotonic() + seconds
    points, near = [], None
    factors = np.geomspace(first, max(min(most, _REACH), first * _EDGE), count)
    if factors[0] < 1 < factors[-1]:
        factors[1 + np.abs(np.log(factors[1:-1])).argmin() if count > 2 else 0] = 1.0
    for k, factor in enumerate(factors):
        limits = [replace(one, limit=one.limit * factor) for one in programme.limits]
        share = (end - monotonic()) / (count - k)
        found = solve(replace(programme, limits=limits), choices, share, advance, near)
        advance(1)
        if found is not None:
            near = found.t
            points.append(FrontPoint(float(factor), found.cost, found.lower_bound, found.t[members]))
    return tuple(points)
