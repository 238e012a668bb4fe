"""Cheapest tolerances under limits of the first-order model: solution, multipliers, lower bound of the cost.

In x = ln t every limit is the logarithm of a measure of the error, convex in x for the root mean square and the worst
case. In t these limits and the costs are convex. The Lagrangian is a sum over the tolerances, and its minimum at any
multipliers, found one tolerance at a time, is a lower bound of the cost. A quantile is replaced by its tangent in t²:
its bound holds where the variances that keep the quantile form a convex set.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from precision_pin.analyses.allocation.costs import Cost, Grades
from precision_pin.analyses.map.normal_norms import (
    norm_probabilities,
    norm_quantile_slopes,
    norm_quantiles,
    principal_axes,
)
from precision_pin.base.arrays import Array, Fixed

ROUNDING: Final = 1e-9
"""Relative excess of a limit that counts as rounding."""
# points of a line evaluated together
_AT_ONCE: Final = 34
_HALF: Final = 0.5
# lowest probability from which no two covariances that keep the quantile were found with one between them that does not
_CONVEX: Final = 0.92
# relative distance from a limit below which it is active
_ACTIVE: Final = 1e-5


def last_kept(kept: Callable[[Array], NDArray[np.bool_]]) -> tuple[float, float]:
    """Return the last kept fraction of a line from 0 (kept) to 1 (not kept), and the first that is not kept."""
    least, most = 0.0, 1.0
    while most - least > ROUNDING:
        shares = np.linspace(least, most, _AT_ONCE)
        first = int(np.argmin(np.concatenate([[True], kept(shares[1:-1]), [False]])))
        least, most = float(shares[first - 1]), float(shares[first])
    return least, most


@final
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
    def is_convex(self) -> bool:
        """Whether the variances that keep the limit form a convex set; those of one component are below a bound."""
        return self.kind != "quantile" or (len(self.rows) == 1 and self.probability >= _HALF)

    @property
    def has_bound(self) -> bool:
        """Whether it is convex, or was in all trials: the quantile of a norm from 92 %."""
        return self.is_convex or self.probability >= _CONVEX

    def measure(self, t: Array) -> Array:
        """Return the limited value ``(m, places)`` for tolerances ``(n, m)``; places are poses, or rows times poses."""
        if self.kind == "worst_case":
            sums = np.abs(self.mean)[None] + self.fixed[:, 0] + np.einsum("nrp,nm->mrp", self.parts[:, :, 0], t)
            return np.asarray(sums.reshape(t.shape[1], -1))
        if self.kind == "rms":
            still = (self.mean**2).sum(axis=0) + np.einsum("iip->p", self.fixed)
            varying = np.einsum("niip,nm->mp", self.parts, self._products(t))
            return np.asarray(np.sqrt(np.maximum(still + varying, 0.0)))
        quantiles = norm_quantiles(*principal_axes(*self._vectors(t)), self.probability)
        return np.asarray(quantiles.reshape(t.shape[1], -1))

    def probabilities(self, t: Array) -> Array:
        """Return the probability that a normal error keeps the limit of a quantile, ``(P,)``."""
        axes = principal_axes(*self._vectors(t[:, None]))
        return norm_probabilities(*axes, np.full(axes[0].shape[1], self.limit))

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
        slopes = norm_quantile_slopes(mean, covariance, value)[:rows, :rows]
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


@final
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


@final
@dataclass(frozen=True, eq=False)
class Programme:
    """Minimise the sum of the costs within bounds ``low``, ``high`` and limits; each tolerance's ``costs`` add up."""

    costs: Sequence[Sequence[Cost | Grades]]
    low: Array
    high: Array
    limits: Sequence[Limit]

    def cost_of(self, t: Array) -> Array:
        """Return the cost of each tolerance, ``(n, …)``."""
        return np.stack(
            [sum((c.at(one) for c in own), np.zeros_like(one)) for own, one in zip(self.costs, t, strict=True)]
        )

    def slope_of(self, t: Array) -> Array:
        """Return the derivative of each cost with respect to its tolerance, ``(n, …)``."""
        return np.stack(
            [sum((c.slope(one) for c in own), np.zeros_like(one)) for own, one in zip(self.costs, t, strict=True)]
        )

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
        active = np.flatnonzero(self.exceeded(t) > -_ACTIVE)
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
            if len(one.pairs):
                # a tangent in t: with correlated tolerances the measure is convex in t, not in t²
                half = slopes[k] @ own
                line += half / t
                constant += float(own @ one.excess(t) - half.sum())
            elif one.kind == "rms":
                own = own / (2 * one.limit**2)
                still = (one.mean**2).sum(axis=0) + np.einsum("iip->p", one.fixed)
                square += np.einsum("niip,p->n", one.parts, own)
                constant += float(own @ (still - one.limit**2))
            elif one.kind == "quantile":
                half = slopes[k] @ own / 2
                square += half / t**2
                constant += float(own @ one.excess(t) - half.sum())
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
