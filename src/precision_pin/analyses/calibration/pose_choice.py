"""Measures of a choice of poses, the exchange of poses, and a bound that no choice can pass.

With weights w_i of candidates, the information on z and nuisances is ``M(w) = diag(I, 0) + Σ w_i A_iᵀ A_i``, A_i the whitened
derivatives of candidate i. Two measures of a design:

- *D*: ``ln det S(w)``, S the Schur complement of the nuisances: the information on z with the nuisances free;
- *task*: ``tr(G S(w)⁻¹)``, G = Σ JᵀJ over the user's poses: the mean square position error that is left there.

Poses are exchanged while that improves the measure: first by adding the best candidate and leaving out the worst pose, or the
other way round (Mitchell 1974), which is quick; then by the best of all exchanges of one pose for another (Fedorov 1972).

The first measure is concave in w, the second convex. So with weights between 0 and 1 in place of 0 or 1 the tangent of the loss
at any weights bounds it from below over all designs: the loss there plus the least that the slopes allow. Where the relaxed
design counts parts of poses, the problem is split: a candidate is measured or it is not. The least bound of all parts is the
bound (Land and Doig 1960).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Final, final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from precision_pin.analyses.calibration.design import NEGLIGIBLE, covariance_with_prior, flat, project_out
from precision_pin.base.arrays import Array
from precision_pin.base.interrupts import raise_if_interrupted

_EXCHANGES: Final = 500
_RIDGE: Final = 1e-9
"""Information on nuisances that is added, as a share of that of all candidates, so that few poses are no singular case."""


@final
@dataclass(frozen=True, eq=False)
class Design:
    """Losses of designs, to be minimised: -ln det S, or tr(G S⁻¹).

    Attributes:
        rows: Derivatives of each candidate by z and by scaled nuisances, ``(P, m, r + k)``.
        prior: Information before any reading, ``(r + k,) * 2``.
        size, rank: r, and how many combinations of z all candidates together determine.
        goal: G, ``(r, r)``; None for the determinant.
    """

    rows: Array
    prior: Array
    size: int
    rank: int
    goal: Array | None

    @classmethod
    def of(cls, by_z: Array, by_nuisance: Array, goal: Array | None) -> Design:
        """Return the design of candidates; nuisances are scaled so that all candidates together give them unit information."""
        size, count = by_z.shape[2], by_nuisance.shape[2]
        scaled = by_nuisance
        if count:
            _, values, rows = np.linalg.svd(flat(by_nuisance), full_matrices=False)
            kept = values > 1e-9 * values[0]
            scaled = by_nuisance @ (rows[kept].T / values[kept])
        prior = np.diag(np.concatenate([np.ones(size), np.full(scaled.shape[2], _RIDGE)]))
        found = np.linalg.svd(project_out(flat(by_z), flat(by_nuisance))[0], compute_uv=False)
        rank = max(int((found > NEGLIGIBLE * found[0]).sum()), 1)
        return cls(np.concatenate([by_z, scaled], axis=2), prior, size, rank, goal)

    def information(self, chosen: NDArray[np.intp]) -> Array:
        """Return M of some candidates."""
        rows = flat(self.rows[chosen])
        result: Array = self.prior + rows.T @ rows
        return result

    def weighted(self, weights: Array) -> Array:
        """Return M of weights ``(P,)``."""
        rows = flat(self.rows)
        result: Array = self.prior + (rows * np.repeat(weights, self.rows.shape[1])[:, None]).T @ rows
        return result

    def loss(self, information: Array) -> float:
        """Return the loss of M."""
        if self.goal is None:
            nuisance = information[self.size :, self.size :]
            return float(np.linalg.slogdet(nuisance)[1] - np.linalg.slogdet(information)[1])
        inverse = np.linalg.inv(information)[: self.size, : self.size]
        return float(np.einsum("ij,ji->", self.goal, inverse))

    def exact_loss(self, chosen: NDArray[np.intp]) -> float:
        """Return the loss of some candidates without the information that is added on nuisances; never the smaller one."""
        by_z, by_nuisance = np.split(self.rows[chosen], [self.size], axis=2)
        covariance = covariance_with_prior(flat(by_z), flat(by_nuisance))
        if self.goal is None:
            return float(np.linalg.slogdet(covariance)[1])
        return float(np.einsum("ij,ji->", self.goal, covariance))

    def efficiency(self, loss: float, bound: float) -> float:
        """Return the efficiency of a loss, at least."""
        if self.goal is None:
            return float(np.exp(min(bound - loss, 0.0) / self.rank))
        return float(np.clip(bound / loss, 0.0, 1.0)) if loss > 0 else 1.0

    def slopes(self, weights: Array) -> tuple[float, Array]:
        """Return the loss of weights, and its derivatives ``(P,)``, all zero or less."""
        information = self.weighted(weights)
        inverse = np.linalg.inv(information)
        if self.goal is None:
            middle = inverse.copy()
            nuisance = information[self.size :, self.size :]
            middle[self.size :, self.size :] -= np.linalg.inv(nuisance)
        else:
            left = inverse[:, : self.size]
            middle = left @ self.goal @ left.T
        gains = np.einsum("pmi,ij,pmj->p", self.rows, middle, self.rows, optimize=True)
        return self.loss(information), -gains

    def swap(self, chosen: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return a choice that neither adding the best candidate, then leaving out the worst pose, improves, nor the reverse."""
        inside = np.zeros(len(self.rows), dtype=bool)
        inside[chosen] = True
        information = self.information(chosen)
        here = self.loss(information)
        for _ in range(_EXCHANGES):
            raise_if_interrupted()
            for first in (1.0, -1.0):
                moved, changed, there = inside.copy(), information, here
                for sign in (first, -first):
                    changes = self._changes_by_one(changed, sign)
                    changes[moved if sign > 0 else ~moved] = np.inf
                    best = int(np.argmin(changes))
                    moved[best] = sign > 0
                    changed = changed + sign * self.rows[best].T @ self.rows[best]
                    there += float(changes[best])
                if there < here - 1e-9 * max(1.0, abs(here)):
                    break
            else:
                break
            inside = moved
            # without the rounding of the sums
            information = self.information(np.flatnonzero(inside))
            here = self.loss(information)
        return np.flatnonzero(inside)

    def _changes_by_one(self, information: Array, sign: float) -> Array:
        """Return the change of loss where a candidate is added (1) or left out (-1), ``(P,)``; infinite where none is left."""
        inverse: Array = scipy.linalg.inv(information)
        eye = np.eye(self.rows.shape[1])
        through = self.rows @ inverse
        own = eye + sign * through @ self.rows.transpose(0, 2, 1)
        with np.errstate(divide="ignore"):
            if self.goal is not None:
                effect = through[:, :, : self.size] @ self.goal @ through[:, :, : self.size].transpose(0, 2, 1)
                trace: Array = -sign * np.einsum("pii->p", np.linalg.solve(own, effect))
                return trace
            change = -np.linalg.slogdet(own)[1]
            nuisance = self.rows[:, :, self.size :]
            if nuisance.shape[2]:
                kept: Array = scipy.linalg.inv(information[self.size :, self.size :])
                change += np.linalg.slogdet(eye + sign * nuisance @ kept @ nuisance.transpose(0, 2, 1))[1]
        return np.where(np.isfinite(change), change, np.inf)

    def exchange(self, chosen: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return a choice that no exchange of one pose for another improves."""
        chosen = self.swap(chosen)
        rest = np.setdiff1d(np.arange(len(self.rows)), chosen)
        for _ in range(_EXCHANGES):
            raise_if_interrupted()
            if not rest.size:
                break
            change = self._changes(chosen, rest)
            out, into = np.unravel_index(int(np.argmin(change)), change.shape)
            here = self.loss(self.information(chosen))
            chosen[out], rest[into] = rest[into], chosen[out]
            there = self.loss(self.information(chosen))
            if not there < here - 1e-12 * max(1.0, abs(here)):
                chosen[out], rest[into] = rest[into], chosen[out]
                break
        return chosen

    def _changes(self, chosen: NDArray[np.intp], rest: NDArray[np.intp]) -> Array:
        """Return the change of loss of every exchange, ``(count, P - count)``, by updates of low rank."""
        inverse: Array = scipy.linalg.inv(self.information(chosen))
        change = _log_changes(self.rows, inverse, chosen, rest)
        if self.goal is None:
            nuisance = self.rows[:, :, self.size :]
            if nuisance.shape[2]:
                own: Array = scipy.linalg.inv(self.information(chosen)[self.size :, self.size :])
                return _log_changes(nuisance, own, chosen, rest) - change
            return -change
        left = inverse[:, : self.size]
        return _trace_changes(self.rows, inverse, left @ self.goal @ left.T, chosen, rest)


def _pairs(rows: Array, middle: Array, chosen: NDArray[np.intp], rest: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Return ``A_i X A_iᵀ`` of chosen ones, of the rest, and ``A_i X A_jᵀ`` of all pairs ``(count, rest, m, m)``."""
    size = rows.shape[1]
    ours, others = rows[chosen], rows[rest]
    through = ours @ middle
    own = np.einsum("pmi,pni->pmn", through, ours)
    their = np.einsum("pmi,pni->pmn", others @ middle, others)
    cross = (flat(through) @ flat(others).T).reshape(len(ours), size, len(others), size).transpose(0, 2, 1, 3)
    return own, their, cross


def _log_changes(rows: Array, inverse: Array, chosen: NDArray[np.intp], rest: NDArray[np.intp]) -> Array:
    """Return the change of ln det M of every exchange: det(I - U) det(I + V + Cᵀ (I - U)⁻¹ C) with Schur complements."""
    own, their, cross = _pairs(rows, inverse, chosen, rest)
    eye = np.eye(rows.shape[1])
    left = eye - own
    inner = eye + their[None] + np.swapaxes(cross, 2, 3) @ np.linalg.solve(left[:, None], cross)
    result: Array = np.linalg.slogdet(left)[1][:, None] + np.linalg.slogdet(inner)[1]
    return result


def _trace_changes(
    rows: Array, inverse: Array, middle: Array, chosen: NDArray[np.intp], rest: NDArray[np.intp]
) -> Array:
    """Return the change of ``tr(G S⁻¹)`` of every exchange: ``-tr((D + W)⁻¹ F)`` with D = diag(-I, I)."""
    size = rows.shape[1]
    blocks = []
    for kernel in (inverse, middle):
        own, their, cross = _pairs(rows, kernel, chosen, rest)
        block = np.empty((len(chosen), len(rest), 2 * size, 2 * size))
        block[:, :, :size, :size] = own[:, None]
        block[:, :, size:, size:] = their[None]
        block[:, :, :size, size:] = cross
        block[:, :, size:, :size] = np.swapaxes(cross, 2, 3)
        blocks.append(block)
    weights, effect = blocks
    signs = np.diag(np.concatenate([-np.ones(size), np.ones(size)]))
    result: Array = -np.einsum("abii->ab", np.linalg.solve(weights + signs, effect))
    return result


_STEPS: Final = 400
_GAP: Final = 2e-5
"""Gap of the relaxed problem, in units of the efficiency, at which it is solved."""
_WORK: Final = 24_000
"""Parts that are bounded, times candidates."""
_MOST: Final = 120
"""The most parts that are bounded."""
_ENOUGH: Final = 0.995
"""Efficiency at which no better bound is sought."""


@final
@dataclass(frozen=True, eq=False)
class Relaxed:
    """A relaxed problem: a bound of its loss, weights ``(P,)``, and their limits, equal where a candidate is settled."""

    bound: float
    weights: Array
    low: Array
    high: Array

    def rounded(self, count: int) -> NDArray[np.intp]:
        """Return the candidates with the largest weights, ``(count,)``."""
        return np.argsort(-self.weights, kind="stable")[:count]

    def __lt__(self, other: Relaxed) -> bool:
        return self.bound < other.bound


def relaxed(design: Design, count: int, weights: Array, low: Array, high: Array) -> Relaxed:
    """Return the solution of the relaxed problem within limits, from first weights ``(P,)``."""
    weights, best, step = _project(weights, count, low, high), -np.inf, 1.0
    loss, slopes = design.slopes(weights)
    for _ in range(_STEPS):
        best = max(best, loss + float(slopes @ (_least(slopes, count, low, high) - weights)))
        if design.efficiency(loss, best) > 1 - _GAP:
            break
        scale = step / max(float(np.abs(slopes).max()), 1e-300)
        for _ in range(40):
            moved = _project(weights - scale * slopes, count, low, high)
            change = moved - weights
            new_loss, new_slopes = design.slopes(moved)
            if new_loss <= loss + 1e-4 * float(slopes @ change):
                curvature = float((new_slopes - slopes) @ change)
                length = float(change @ change) / curvature if curvature > 0 else 2 * scale
                step = length * max(float(np.abs(new_slopes).max()), 1e-300)
                weights, loss, slopes = moved, new_loss, new_slopes
                break
            scale /= 4
        else:  # no descent but rounding
            break
    return Relaxed(best, weights, low, high)


def branches(design: Design, count: int, root: Relaxed, chosen: NDArray[np.intp]) -> tuple[float, NDArray[np.intp]]:
    """Return a bound at least as good as the root's, of no candidate settled, and a choice at least as good as that given."""
    best, parts = design.exact_loss(chosen), [root]
    for _ in range(min(_MOST, _WORK // len(root.weights)) // 2):
        raise_if_interrupted()
        if design.efficiency(best, parts[0].bound) >= _ENOUGH:
            break
        part = heapq.heappop(parts)
        doubt = part.weights * (1 - part.weights) * (part.low < part.high)
        candidate = int(np.argmax(doubt))
        if not doubt[candidate] > 0:  # a choice already: nothing is below it
            heapq.heappush(parts, part)
            break
        for value in (0.0, 1.0):
            low, high = part.low.copy(), part.high.copy()
            low[candidate] = high[candidate] = value
            if not low.sum() <= count <= high.sum():
                continue
            found = relaxed(design, count, part.weights, low, high)
            # a part of a problem is bounded by the whole's bound as well
            heapq.heappush(parts, Relaxed(max(found.bound, part.bound), found.weights, low, high))
            tried = design.swap(found.rounded(count))
            loss = design.exact_loss(tried)
            if loss < best:
                chosen, best = tried, loss
    return parts[0].bound, chosen


def _least(slopes: Array, count: int, low: Array, high: Array) -> Array:
    """Return the weights within their limits, of sum ``count``, with the least sum of slopes."""
    order = np.argsort(slopes, kind="stable")
    room = (high - low)[order]
    result = low.copy()
    result[order] += np.clip(count - float(low.sum()) - (np.cumsum(room) - room), 0.0, room)
    return result


def _project(weights: Array, count: int, low: Array, high: Array) -> Array:
    """Return the closest weights within their limits whose sum is ``count``."""
    # the sum of clip(weights - shift, low, high) falls by straight pieces as the shift grows
    ends = np.concatenate([weights - high, weights - low])
    order = np.argsort(ends, kind="stable")
    ends = ends[order]
    slopes = np.cumsum(np.where(order < len(weights), -1.0, 1.0))
    sums = float(high.sum()) + np.concatenate([[0.0], np.cumsum(slopes[:-1] * np.diff(ends))])
    piece = int(np.clip(np.searchsorted(-sums, -count, side="right") - 1, 0, len(ends) - 1))
    shift = ends[piece] + (sums[piece] - count) / max(-slopes[piece], 1.0)
    result: Array = np.clip(weights - shift, low, high)
    return result
