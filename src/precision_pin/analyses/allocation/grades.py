"""Cheapest tolerances where some have grades: outer approximation with branch and bound.

A grade is a binary variable. In these, t and t² are linear, so that a worst case and a root mean square are linear
rows; a quantile is a row tangent to the set of variances that keep it, added where it is exceeded. A tolerance without
grades has t, t² and its cost as variables, bounded by tangents. The mixed-integer linear programme, solved by branch
and bound (HiGHS), gives a lower bound of the cost; with its grades fixed, the exact programme chooses the others and
gives an upper bound. Both are repeated with more tangents until they meet (Duran, Grossmann, Mathematical Programming
36, 307, 1986).

Pareto front: the least cost against limits that are all scaled by one factor.
"""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from time import monotonic
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from precision_pin.analyses.allocation.convex_program import ROUNDING, Limit, Programme, Solution, last_kept
from precision_pin.base.arrays import Array
from precision_pin.base.record import Record

# fraction of the cost that may remain between the bounds
_GAP: Final = 1e-6
# relative distance from a limit below which its tangent is added
_NEAR: Final = 1e-4
# factor on tolerances that keep the limits, after which the line to them leaves the limits close by
_BEYOND: Final = 1.5
# initial tangents of each tolerance without grades
_TANGENTS: Final = 12
_ROUNDS: Final = 1000
# least time for the first lower bound, in seconds
_LEAST_TIME: Final = 0.5


def solve_with_grades(
    programme: Programme, choices: Sequence[Array | None], seconds: float, advance: Callable[[int], None]
) -> Solution | None:
    """Return the cheapest tolerances, or ``None`` where even the narrowest exceed a limit.

    ``choices`` are the available values of each variable, narrowest first, or ``None`` for any. After ``seconds`` the
    best so far is returned, with its lower bound. ``advance`` is called after each round of both bounds.
    """
    end = monotonic() + seconds
    fixed = np.array([one is not None for one in choices])
    best = _with_grades(programme, fixed, programme.low)
    if best is None and (programme.is_monotone or programme.exceeded(programme.least).max() > ROUNDING):
        return None
    if best is not None and fixed.all():
        best = _with_grades(programme, fixed, _widened(programme, choices)) or best
    relaxed = _Relaxation(programme, choices, (0.0 if best is None else abs(best.cost)) or 1.0)
    relaxed.cut(programme.high)
    if best is not None:
        relaxed.cut(best.t * _BEYOND)
    bound, seen = -np.inf, set[bytes]()
    for k in range(_ROUNDS):
        left = end - monotonic()
        if left <= 0 and k:
            break
        t, found = relaxed.solve(max(left, _LEAST_TIME))
        gained, bound = found - bound, max(bound, found)
        if t is None or (best is not None and best.cost - bound <= _GAP * abs(best.cost)):
            break
        if t[fixed].tobytes() in seen:
            # the remaining gap is then rounding of the linear programme
            if best is not None and gained <= _GAP / 10 * abs(best.cost):
                break
        elif (solution := _with_grades(programme, fixed, t)) is None:
            relaxed.refuse(t)
        else:
            seen.add(t[fixed].tobytes())
            best = solution if best is None else min(best, solution, key=lambda one: one.cost)
            relaxed.touch(solution.t)
        relaxed.add_tangents(t)
        relaxed.cut(t)
        advance(1)
    if best is None:
        return None
    known = np.isfinite(bound) and all(one.has_bound for one in programme.limits)
    return replace(best, lower_bound=min(bound, best.cost) if known else None)


def _with_grades(programme: Programme, fixed: NDArray[np.bool_], t: Array) -> Solution | None:
    low, high = np.where(fixed, t, programme.low), np.where(fixed, t, programme.high)
    return replace(programme, low=low, high=high).solve()


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
            self._add_limit(one)
        for share in np.linspace(0, 1, _TANGENTS):
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
        costs, slopes = (
            self._programme.cost_of(t) / self._scale,
            self._programme.slope_of(t) * self._widest / self._scale,
        )
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
        for one in self._programme.limits:
            if one.kind != "quantile" and not len(one.pairs):
                continue
            excess = one.excess(t)
            slopes = one.log_slopes(t)
            for place in np.flatnonzero(excess > -_NEAR):
                self._add_slope(one, slopes[:, place], t, -float(excess[place]))

    def cut(self, t: Array) -> None:
        """Add the tangents of the quantiles that ``t`` exceeds, each where the line to ``t`` in t² leaves the limit."""
        low = self._programme.least
        for one in self._programme.limits:
            if one.kind != "quantile" and not len(one.pairs):
                continue
            exceeded = np.flatnonzero((one.excess(t) > 0) & (one.excess(low) <= 0))
            for place in exceeded:
                only = one.at_place(int(place))
                steps = (t**2 - low**2)[:, None]
                _, most = last_kept(
                    lambda shares, only=only, steps=steps: (  # type: ignore[misc]
                        only.measure(np.sqrt((low**2)[:, None] + shares * steps))[:, 0] <= only.limit
                    )
                )
                between = np.sqrt(low**2 + most * (t**2 - low**2))
                self._add_slope(one, only.log_slopes(between)[:, 0], between, 0.0)

    def _add_slope(self, one: Limit, slopes: Array, t: Array, left: float) -> None:
        """Add the tangent of ln of a measure in t² (t if correlated), by its slopes in ln t and reserve ``left``."""
        if len(one.pairs):
            self._add((slopes / t * self._widest) @ self._t, float(slopes.sum()) + left)
        else:
            self._add((slopes / (2 * t**2) * self._widest**2) @ self._square, float(slopes.sum()) / 2 + left)

    def _add_limit(self, one: Limit) -> None:
        if len(one.pairs):
            return
        if one.kind == "rms":
            still = (one.mean**2).sum(axis=0) + np.einsum("iip->p", one.fixed)
            for place, parts in enumerate(np.einsum("niip->pn", one.parts)):
                self._add((parts * self._widest**2 / one.limit**2) @ self._square, 1 - still[place] / one.limit**2)
        elif one.kind == "worst_case":
            still = (np.abs(one.mean) + one.fixed[:, 0]).reshape(-1)
            for place, parts in enumerate(one.parts[:, :, 0].reshape(len(self._widest), -1).T):
                self._add((parts * self._widest / one.limit) @ self._t, 1 - still[place] / one.limit)

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


@final
@dataclass(frozen=True, eq=False)
class FrontPoint(Record):
    """Cheapest first-order tolerances ``(n,)``, m or rad, for limits times ``factor``; no late lower bound."""

    factor: float
    cost: float
    lower_bound: float | None
    tolerances: Array


def solve(
    programme: Programme,
    choices: Sequence[Array | None],
    seconds: float,
    advance: Callable[[int], None],
    near: Array | None = None,
) -> Solution | None:
    """Return the cheapest tolerances, with or without grades, as :func:`solve_with_grades`, starting from ``near``."""
    if all(one is None for one in choices):
        return programme.solve(near)
    return solve_with_grades(programme, choices, max(seconds, 0.0), lambda _: advance(0))


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
