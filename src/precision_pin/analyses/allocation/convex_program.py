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


def last_kept(is_kept: Callable[[Array], NDArray[np.bool_]]) -> tuple[float, float]:
    """Return the last kept fraction of a line from 0 (kept) to 1 (not kept), and the first that is not kept."""
    low, high = 0.0, 1.0
    while high - low > ROUNDING:
        fractions = np.linspace(low, high, _AT_ONCE)
        index = int(np.argmin(np.concatenate([[True], is_kept(fractions[1:-1]), [False]])))
        low, high = float(fractions[index - 1]), float(fractions[index])
    return low, high


@dataclass(frozen=True, eq=False)
class Limit(Fixed):
    """A limit at every pose.

    Attributes:
        kind: ``"quantile"``, ``"rms"`` or ``"worst_case"``.
        limit, probability: Largest value, m or rad; probability of a quantile.
        rows: Components of the error that the limited ones, along base or tool axes, are made of.
        mean, fixed: Limited components of the error at the means ``(r, P)``, and their covariance (worst case: largest deviation,
            ``(r, 1, P)``) that no tolerance changes, ``(r, r, P)``.
        parts: The same for each tolerance of 1 (SI), ``(n, r, r, P)`` (worst case ``(n, r, 1, P)``); then the
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
        is_convex = self.kind != "quantile" or (len(self.mean) == 1 and self.probability >= 0.5)
        # lowest probability from which no two covariances that keep the quantile were found with one between them
        # that does not
        return is_convex or self.probability >= 0.92

    @cached_property
    def _cache(self) -> dict[bytes, Array]:
        return {}

    def measure(self, t: Array) -> Array:
        """Return the limited value ``(m, places)`` for tolerances ``(n, m)``; places are poses, or rows times poses.

        The last result is cached: values and slopes are evaluated at the same tolerances.
        """
        key = t.tobytes()
        if key not in self._cache:
            self._cache.clear()
            self._cache[key] = read_only(self._measure(t))
        return self._cache[key]

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
        extended = np.vstack([t, np.ones((1, t.shape[1]))])
        return np.vstack([t**2, extended[self.pairs[:, 0]] * extended[self.pairs[:, 1]]])

    def _by_tolerance(self, by_product: Array, t: Array) -> Array:
        """Return derivatives with respect to ln t ``(n, places)`` from those with respect to squares and products."""
        parts = by_product * self._products(t[:, None])
        slopes = np.vstack([2 * parts[: len(t)], np.zeros((1, parts.shape[1]))])
        for side in range(2):
            np.add.at(slopes, self.pairs[:, side], parts[len(t) :])
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
        bound_prices: Saving per SI unit of a tolerance held by its bounds, ``(n,)``; negative at the lower bound.
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
        return np.stack([sum((cost.at(width) for cost in terms), np.zeros_like(width)) for terms, width in pairs])

    def slope_of(self, t: Array) -> Array:
        """Return the derivative of each cost with respect to its tolerance, ``(n, …)``."""
        pairs = zip(self.costs, t, strict=True)
        return np.stack([sum((cost.slope(width) for cost in terms), np.zeros_like(width)) for terms, width in pairs])

    def shares(self, t: Array) -> Array:
        """Return each measure over its limit, ``(m, all places)``, for tolerances ``(n, m)``."""
        return np.hstack([limit.measure(t) / limit.limit for limit in self.limits])

    def exceeded(self, t: Array) -> Array:
        """Return ln of each measure over its limit, ``(all places,)``: positive where a limit is exceeded."""
        return np.asarray(np.log(np.maximum(self.shares(t[:, None])[0], 1e-300)))

    @property
    def is_monotone(self) -> bool:
        """Whether every narrower tolerance makes every error smaller; correlated ones may cancel each other."""
        return not any(len(limit.pairs) for limit in self.limits)

    @cached_property
    def least(self) -> Array:
        """Tolerances that exceed the limits least: the narrowest, or those that minimise the largest measure."""
        if self.is_monotone or self.exceeded(self.low).max() <= 0 or (self.low == self.high).all():
            return self.low
        low, high = np.log(self.low), np.log(self.high)
        count = len(low)

        def slopes(x: Array) -> Array:
            falls = -np.hstack([limit.log_slopes(np.exp(x[:count])) for limit in self.limits]).T
            return np.column_stack([falls, np.ones(len(falls))])

        optimum: Any = optimize.minimize(
            lambda x: float(x[count]),
            np.append(low, self.exceeded(self.low).max()),
            jac=lambda _: np.append(np.zeros(count), 1.0),
            bounds=[*zip(low, high, strict=True), (None, None)],
            constraints={"type": "ineq", "fun": lambda x: x[count] - self.exceeded(np.exp(x[:count])), "jac": slopes},
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-12},
        )
        reached = np.exp(np.clip(optimum.x[:count], low, high))
        return min(self.low, reached, key=lambda t: float(self.exceeded(t).max()))

    def solve(self, guess: Array | None = None) -> Solution | None:
        """Return the cheapest tolerances, starting from ``near``, or ``None`` where even `least` exceeds a limit."""
        if self.exceeded(self.least).max() > ROUNDING:
            return None
        if (self.low == self.high).all():
            return self.priced(self.low)
        low, high = np.log(self.low), np.log(self.high)
        start = self._largest_within(np.log(self.least), high if guess is None else np.clip(np.log(guess), low, high))
        scale = float(np.abs(self.slope_of(np.exp(start)) * np.exp(start)).sum()) or 1.0
        optimum: Any = optimize.minimize(
            lambda x: float(self.cost_of(np.exp(x)).sum()) / scale,
            start,
            jac=lambda x: self.slope_of(np.exp(x)) * np.exp(x) / scale,
            bounds=list(zip(low, high, strict=True)),
            constraints={
                "type": "ineq",
                "fun": lambda x: -self.exceeded(np.exp(x)),
                "jac": lambda x: -np.hstack([limit.log_slopes(np.exp(x)) for limit in self.limits]).T,
            },
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-14},
        )
        # the lower bound, not the solver's flag, measures the quality; limits are kept to rounding only, so step back
        x = self._largest_within(np.log(self.least), np.clip(optimum.x, low, high))
        return self.priced(np.exp(x))

    def _largest_within(self, inner: Array, high: Array) -> Array:
        """Return the point closest to ``high`` on the line from ``kept`` that keeps all limits."""
        if self.exceeded(np.exp(high)).max() <= ROUNDING:
            return high
        fraction, _ = last_kept(
            lambda fractions: self.shares(np.exp(inner[:, None] + fractions * (high - inner)[:, None])).max(axis=1) <= 1
        )
        return inner + fraction * (high - inner)

    def priced(self, t: Array) -> Solution:
        """Return a solution with its multipliers, by non-negative least squares of the first-order conditions."""
        falls = -self.slope_of(t) * t
        slopes = [limit.log_slopes(t) for limit in self.limits]
        places = np.repeat(np.arange(len(self.limits)), [part.shape[1] for part in slopes])
        # relative distance from a limit below which it is active
        active = np.flatnonzero(self.exceeded(t) > -1e-5)
        multipliers = np.zeros(len(places))
        is_free = (t > self.low * (1 + 1e-7)) & (t < self.high * (1 - 1e-7))
        if len(active) and is_free.any():
            gradient = np.hstack(slopes)[:, active][is_free]
            # conditions weighted by the effect of each tolerance
            weights = 1 / np.maximum(falls[is_free], 1e-300)
            multipliers[active] = optimize.nnls(gradient * weights[:, None], falls[is_free] * weights)[0]
        total = tuple(float(multipliers[places == k].sum() / limit.limit) for k, limit in enumerate(self.limits))
        reduced = (falls - np.hstack(slopes) @ multipliers) / t
        convex = all(limit.has_bound for limit in self.limits)
        bound = self._lower_bound(t, slopes, multipliers, places) if convex else None
        return Solution(t, float(self.cost_of(t).sum()), bound, total, np.where(is_free, 0.0, reduced))

    def _lower_bound(self, t: Array, slopes: Sequence[Array], multipliers: Array, places: NDArray[np.intp]) -> float:
        """Return the minimum of the Lagrangian in t, with quantiles replaced by tangents in t² (t if correlated)."""
        square, line = np.zeros(len(self.low)), np.zeros(len(self.low))
        constant = 0.0
        for k, limit in enumerate(self.limits):
            weights = multipliers[places == k]
            if len(limit.pairs) or limit.kind == "quantile":
                # with correlated tolerances the measure is convex in t, not in t²
                sums, power = (line, 1) if len(limit.pairs) else (square, 2)
                shares = slopes[k] @ weights / power
                sums += shares / t**power
                constant += float(weights @ limit.excess(t) - shares.sum())
            elif limit.kind == "rms":
                weights = weights / (2 * limit.limit**2)
                fixed = (limit.mean**2).sum(axis=0) + np.einsum("iip->p", limit.fixed)
                square += np.einsum("niip,p->n", limit.parts, weights)
                constant += float(weights @ (fixed - limit.limit**2))
            else:
                weights = weights / limit.limit
                fixed = (np.abs(limit.mean) + limit.fixed[:, 0]).reshape(-1)
                line += limit.parts[:, :, 0].reshape(len(line), -1) @ weights
                constant += float(weights @ (fixed - limit.limit))
        low, high = self.low.copy(), self.high.copy()
        for _ in range(200):
            middle = np.sqrt(low * high)
            falls = self.slope_of(middle) + 2 * square * middle + line < 0
            low, high = np.where(falls, middle, low), np.where(falls, high, middle)
        minimiser = np.sqrt(low * high)
        return float((self.cost_of(minimiser) + square * minimiser**2 + line * minimiser).sum() + constant)


# fraction of the cost that may remain between the bounds
_GAP: Final = 1e-6
# relative distance from a limit below which its tangent is added
_ACTIVE: Final = 1e-4
# factor on tolerances that keep the limits, after which the line to them leaves the limits close by
_WIDENING: Final = 1.5
# maximum number of rounds of both bounds
_ROUNDS: Final = 1000


def solve(
    programme: Programme,
    choices: Sequence[Array | None],
    seconds: float,
    advance: Callable[[int], None],
    guess: Array | None = None,
) -> Solution | None:
    """Return the cheapest tolerances, or ``None`` where even the narrowest exceed a limit.

    ``choices`` are the available values of each variable, narrowest first, or ``None`` for any. With grades, after
    ``seconds`` the best so far is returned, with its lower bound, and ``advance`` is called with 0 after each round of
    both bounds; without any, the search starts from ``near``.
    """
    is_graded = np.array([grades is not None for grades in choices])
    if not is_graded.any():
        return programme.solve(guess)
    deadline = monotonic() + max(seconds, 0.0)

    def solved_at(t: Array) -> Solution | None:
        low, high = np.where(is_graded, t, programme.low), np.where(is_graded, t, programme.high)
        return replace(programme, low=low, high=high).solve()

    best = solved_at(programme.low)
    if best is None and (programme.is_monotone or programme.exceeded(programme.least).max() > ROUNDING):
        return None
    if best is not None and is_graded.all():
        best = solved_at(_widen_grades(programme, choices)) or best
    relaxed = _Relaxation(programme, choices, (0.0 if best is None else abs(best.cost)) or 1.0)
    relaxed.cut(programme.high)
    if best is not None:
        relaxed.cut(best.t * _WIDENING)
    bound, visited = -np.inf, set[bytes]()
    for k in range(_ROUNDS):
        remaining = deadline - monotonic()
        if remaining <= 0 and k:
            break
        # least time for the first lower bound, in seconds
        t, cost_bound = relaxed.solve(max(remaining, 0.5))
        gain, bound = cost_bound - bound, max(bound, cost_bound)
        if t is None or (best is not None and best.cost - bound <= _GAP * abs(best.cost)):
            break
        if t[is_graded].tobytes() in visited:
            # the remaining gap is then rounding of the linear programme
            if best is not None and gain <= _GAP / 10 * abs(best.cost):
                break
        elif (solution := solved_at(t)) is None:
            relaxed.exclude(t)
        else:
            visited.add(t[is_graded].tobytes())
            best = solution if best is None else min(best, solution, key=lambda c: c.cost)
            relaxed.touch(solution.t)
        relaxed.add_tangents(t)
        relaxed.cut(t)
        advance(0)
    if best is None:
        return None
    is_valid = np.isfinite(bound) and all(limit.has_bound for limit in programme.limits)
    return replace(best, lower_bound=min(bound, best.cost) if is_valid else None)


def _widen_grades(programme: Programme, choices: Sequence[Array | None]) -> Array:
    """Return grades that keep the limits, widened greedily from the narrowest by saving per consumed reserve."""
    places = np.zeros(len(choices), dtype=int)
    lists = [np.asarray(grades) for grades in choices]
    t = np.array([grades[0] for grades in lists])
    while True:
        steps = [k for k, grades in enumerate(lists) if places[k] + 1 < len(grades)]
        if not steps:
            return t
        trials = np.tile(t[:, None], len(steps))
        for column, k in enumerate(steps):
            trials[k, column] = lists[k][places[k] + 1]
        shares, shares_before = programme.shares(trials), programme.shares(t[:, None])
        saved = programme.cost_of(t[:, None]).sum() - programme.cost_of(trials).sum(axis=0)
        reserve_cost = np.maximum((shares**2 - shares_before**2).sum(axis=1), 1e-12)
        ratios = np.where(shares.max(axis=1) <= 1, saved / reserve_cost, -np.inf)
        best = int(ratios.argmax())
        if not np.isfinite(ratios[best]):
            return t
        t = trials[:, best]
        places[steps[best]] += 1


class _Relaxation:
    """Mixed-integer linear programme whose least cost is a lower bound; all numbers scaled to about 1."""

    def __init__(self, programme: Programme, choices: Sequence[Array | None], cost: float) -> None:
        self._programme = programme
        self._choices = [
            grades if grades is None or not programme.is_monotone else _worthwhile(programme, k, grades)
            for k, grades in enumerate(choices)
        ]
        counts = [3 if grades is None else len(grades) for grades in self._choices]
        stops = np.cumsum(counts)
        self._columns = [slice(stop - count, stop) for stop, count in zip(stops, counts, strict=True)]
        count, size = int(stops[-1]), len(choices)
        self._widest = programme.high
        self._scale = cost
        self._t, self._square = np.zeros((size, count)), np.zeros((size, count))
        self._cost, self._integral = np.zeros(count), np.zeros(count)
        self._lower, self._upper = np.zeros(count), np.ones(count)
        self._rows: list[Array] = []
        self._bounds: list[float] = []
        # limits that are no linear rows in t or t²
        self._nonlinear = [limit for limit in programme.limits if limit.kind == "quantile" or len(limit.pairs)]
        costs = programme.cost_of
        for k, (grades, columns) in enumerate(zip(self._choices, self._columns, strict=True)):
            if grades is None:
                start = columns.start
                self._t[k, start] = self._square[k, start + 1] = self._cost[start + 2] = 1.0
                narrowest = programme.low[k] / self._widest[k]
                ends_of_cost = [float(costs(widths)[k]) / self._scale for widths in (programme.high, programme.low)]
                self._lower[columns] = narrowest, narrowest**2, ends_of_cost[0]
                self._upper[columns] = 1.0, 1.0, ends_of_cost[1]
            else:
                bases = np.tile(programme.low[:, None], len(grades))
                bases[k] = grades
                self._t[k, columns] = grades / self._widest[k]
                self._square[k, columns] = (grades / self._widest[k]) ** 2
                self._cost[columns] = costs(bases)[k] / self._scale
                self._integral[columns] = 1.0
        for lim in programme.limits:
            if lim.kind == "rms" and not len(lim.pairs):
                base = (lim.mean**2).sum(axis=0) + np.einsum("iip->p", lim.fixed)
                for place, parts in enumerate(np.einsum("niip->pn", lim.parts)):
                    self._add((parts * self._widest**2 / lim.limit**2) @ self._square, 1 - base[place] / lim.limit**2)
            elif lim.kind == "worst_case":
                base = (np.abs(lim.mean) + lim.fixed[:, 0]).reshape(-1)
                for place, parts in enumerate(lim.parts[:, :, 0].reshape(size, -1).T):
                    self._add((parts * self._widest / lim.limit) @ self._t, 1 - base[place] / lim.limit)
        # initial tangents of each tolerance without grades
        for fraction in np.linspace(0, 1, 12):
            self.add_tangents(np.exp((1 - fraction) * np.log(programme.low) + fraction * np.log(programme.high)))

    def solve(self, seconds: float) -> tuple[Array | None, float]:
        """Return the tolerances of the least cost, if any were found in time, and a lower bound of it."""
        graded = [columns for grades, columns in zip(self._choices, self._columns, strict=True) if grades is not None]
        one_each = np.zeros((len(graded), len(self._cost)))
        for row, columns in zip(one_each, graded, strict=True):
            row[columns] = 1.0
        constraints = [optimize.LinearConstraint(one_each, 1.0, 1.0)]
        if self._rows:
            constraints.append(optimize.LinearConstraint(np.array(self._rows), -np.inf, np.array(self._bounds)))
        with without_solver_lines():
            optimum: Any = optimize.milp(
                self._cost,
                integrality=self._integral,
                bounds=optimize.Bounds(self._lower, self._upper),
                constraints=constraints,
                options={"time_limit": seconds, "mip_rel_gap": _GAP / 10},
            )
        bound = getattr(optimum, "mip_dual_bound", None)
        cost = -np.inf if bound is None or not np.isfinite(bound) else float(bound) * self._scale
        if optimum.x is None:
            return None, cost
        t = self._widest * np.sqrt(np.maximum(self._square @ optimum.x, 0.0))
        for k, (grades, columns) in enumerate(zip(self._choices, self._columns, strict=True)):
            if grades is not None:
                t[k] = grades[int(optimum.x[columns].argmax())]
        return np.clip(t, self._programme.low, self._programme.high), cost

    def exclude(self, t: Array) -> None:
        """Exclude ``t``: require a narrower grade somewhere if errors grow with every tolerance, else another one."""
        row = np.zeros(len(self._cost))
        for k, (grades, columns) in enumerate(zip(self._choices, self._columns, strict=True)):
            if grades is not None:
                is_wider = grades > t[k] * (1 + ROUNDING) if not self._programme.is_monotone else False
                row[columns] = np.where((grades < t[k] * (1 - ROUNDING)) | is_wider, -1.0, 0.0)
        self._add(row, -1.0)

    def add_tangents(self, t: Array) -> None:
        """Bound t² and the cost of tolerances without grades by tangents at ``t``."""
        costs = self._programme.cost_of(t) / self._scale
        slopes = self._programme.slope_of(t) * self._widest / self._scale
        for k, (grades, columns) in enumerate(zip(self._choices, self._columns, strict=True)):
            if grades is not None:
                continue
            width, square, cost = range(columns.start, columns.stop)
            at = t[k] / self._widest[k]
            for changes, bound in (
                ({width: 2 * at, square: -1.0}, at**2),
                ({width: slopes[k], cost: -1.0}, slopes[k] * at - costs[k]),
                ({square: slopes[k] / (2 * at), cost: -1.0}, slopes[k] * at / 2 - costs[k]),
            ):
                row = np.zeros(len(self._cost))
                row[list(changes)] = list(changes.values())
                self._rows.append(row)
                self._bounds.append(bound)

    def touch(self, t: Array) -> None:
        """Add all tangents at tolerances ``t``, including those of active quantiles."""
        self.add_tangents(t)
        for limit in self._nonlinear:
            excess, slopes = limit.excess(t), limit.log_slopes(t)
            for place in np.flatnonzero(excess > -_ACTIVE):
                self._add_slope(limit, slopes[:, place], t, -float(excess[place]))

    def cut(self, t: Array) -> None:
        """Add the tangents of the quantiles that ``t`` exceeds, each where the line to ``t`` in t² leaves the limit."""
        low = self._programme.least
        steps = t**2 - low**2

        def is_within_limit(single: Limit, shares: Array) -> NDArray[np.bool_]:
            return single.measure(np.sqrt((low**2)[:, None] + shares * steps[:, None]))[:, 0] <= single.limit

        for limit in self._nonlinear:
            for place in np.flatnonzero((limit.excess(t) > 0) & (limit.excess(low) <= 0)):
                single = limit.at_place(int(place))
                _, fraction = last_kept(partial(is_within_limit, single))
                between = np.sqrt(low**2 + fraction * steps)
                self._add_slope(limit, single.log_slopes(between)[:, 0], between, 0.0)

    def _add_slope(self, limit: Limit, slopes: Array, t: Array, reserve: float) -> None:
        """Add the tangent of ln of a measure in t² (t if correlated), by its slopes in ln t and reserve ``left``."""
        if len(limit.pairs):
            self._add((slopes / t * self._widest) @ self._t, float(slopes.sum()) + reserve)
        else:
            self._add((slopes / (2 * t**2) * self._widest**2) @ self._square, float(slopes.sum()) / 2 + reserve)

    def _add(self, row: Array, bound: float) -> None:
        size = float(np.abs(row).max(initial=0.0))
        if size > 0:
            self._rows.append(row / size)
            self._bounds.append(bound / size)


def _worthwhile(programme: Programme, k: int, grades: Array) -> Array:
    """Return the grades that are cheaper than every narrower one."""
    t = np.tile(programme.low[:, None], len(grades))
    t[k] = grades
    prices = programme.cost_of(t)[k]
    return np.asarray(grades[prices < np.minimum.accumulate(np.concatenate([[np.inf], prices[:-1]]))])


# beginning of a debug line that HiGHS 1.12 (SciPy 1.17) prints
_LINE: Final = b"HighsMipSolverData::transformNewIntegerFeasibleSolution"
# descriptor of standard output, which the solver writes to past Python
_STDOUT: Final = 1


@contextmanager
def without_solver_lines() -> Iterator[None]:
    """Buffer standard output during the block, and write it afterwards without the solver's line."""
    _flush()
    try:
        descriptor = os.dup(_STDOUT)
    except OSError:  # standard output is closed
        yield
        return
    with tempfile.TemporaryFile() as buffer:
        os.dup2(buffer.fileno(), _STDOUT)
        try:
            yield
        finally:
            _flush()
            os.dup2(descriptor, _STDOUT)
            os.close(descriptor)
            buffer.seek(0)
            output = b"".join(line for line in buffer if not line.startswith(_LINE))
            with suppress(OSError):
                os.write(_STDOUT, output)


def _flush() -> None:
    with suppress(OSError, ValueError, AttributeError):
        sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)


MOST_POINTS: Final = 1000
"""Maximum number of points of a front."""
# largest factor of the limits, and its inverse
_MAX_FACTOR: Final = 3.0
# factor by which the narrowest limits of the front exceed the smallest possible ones
_EDGE: Final = 1.001


@dataclass(frozen=True, eq=False)
class FrontPoint(Record):
    """Cheapest first-order tolerances ``(n,)``, SI, for limits times ``factor``; no late lower bound."""

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
    narrowest = float(programme.shares(programme.low[:, None]).max()) * _EDGE
    widest = float(programme.shares(programme.high[:, None]).max())
    start = max(narrowest, 1 / _MAX_FACTOR)
    deadline = monotonic() + seconds
    points, previous = [], None
    factors = np.geomspace(start, max(min(widest, _MAX_FACTOR), start * _EDGE), count)
    if factors[0] < 1 < factors[-1]:
        factors[1 + np.abs(np.log(factors[1:-1])).argmin() if count > 2 else 0] = 1.0
    for k, factor in enumerate(factors):
        limits = [replace(limit, limit=limit.limit * factor) for limit in programme.limits]
        budget = (deadline - monotonic()) / (count - k)
        solution = solve(replace(programme, limits=limits), choices, budget, advance, previous)
        advance(1)
        if solution is not None:
            previous = solution.t
            points.append(FrontPoint(float(factor), solution.cost, solution.lower_bound, solution.t[members]))
    return tuple(points)
