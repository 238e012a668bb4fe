"""Sobol indices of any function by the pick-freeze method, on replicated scrambled Sobol points.

First order: Azzini, Mara and Rosati, Environmental Modelling & Software 144 (2021) 105167, whose noise decreases with
the index itself. Total: Jansen, Computer Physics Communications 117 (1999). Both use two sets of points and their
mixtures, as in Saltelli et al., ibid. 181 (2010). For several outputs together, numerators and variances are added
first (Gamboa, Janon, Klein and Lagnoux, 2014). Intervals: the points are independent scrambles (Owen, 1995) of one net,
and the estimates are smooth functions of the replicates' means. An index is not given where the points do not resolve
its variance or numerator (:mod:`precision_pin.analyses.replicates`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.replicates import REPLICATES, Estimates, Marginals, half_widths, jackknife
from precision_pin.base.arrays import Array

_BITS: Final = 30


@final
@dataclass(frozen=True, eq=False)
class Indices:
    """Sobol indices of G groups of inputs and Q outputs.

    Attributes:
        first, total: ``(G, Q)`` first-order and total indices.
        first_sum: ``(Q,)`` sum of the first-order indices.
        variance: ``(Q,)`` variance; for several outputs together the sum of their variances.
        varies: ``(Q,)`` true if the output varies.
    """

    first: Estimates
    total: Estimates
    first_sum: Estimates
    variance: Estimates
    varies: NDArray[np.bool_]


def scrambled_points(dimension: int, seed: int, points: int, step: Callable[[], None] = lambda: None) -> Array:
    """Return `REPLICATES` independent scrambles of a Sobol net, concatenated.

    The result is ``(dimension, REPLICATES · points)`` inside (0, 1), midpoints of 2³⁰ cells; ``points`` is a power of
    two. ``step`` is called after each replicate.
    """
    # imported here, because it takes half a second and only this function needs it
    from scipy.stats import qmc

    made = []
    for k in range(REPLICATES):
        # seed is accepted by every scipy since 1.14; the newer keyword rng is not
        net = qmc.Sobol(dimension, scramble=True, bits=_BITS, seed=np.random.default_rng([seed, k]))
        made.append(net.random(points))
        step()
    result: Array = np.concatenate(made).T + 0.5**_BITS / 2
    return np.ascontiguousarray(result)


def sobol_indices(
    function: Callable[[Array], Array],
    points: Array,
    other_points: Array,
    groups: Sequence[Sequence[int] | NDArray[np.intp]],
    *,
    outputs: Array | None = None,
    smallest: float = 0.0,
    confidence: float = 0.95,
    breaks: Sequence[tuple[float, ...]] = (),
) -> Indices:
    """Return first-order and total Sobol indices of groups of inputs.

    With A and B two independent sets of points, A' the points A with the inputs of group g from B, and B' the points B
    with those of A: ``S_g V = E[(f(A') - f(A)) (f(B) - f(B'))]/2``, ``T_g V = E[(f(A') - f(A))² + (f(B') - f(B))²]/4``.

    Args:
        function: Function from uniform numbers ``(d, N)`` to values ``(q, N)``.
        points, other_points: A and B, ``(d, REPLICATES · n)``, halves of one set of :func:`scrambled_points`.
        groups: Rows of each group's inputs; groups must be independent of one another.
        outputs: ``(Q, q)`` zeros and ones that select the values of each output; by default each value is an output.
        smallest: Variance up to which the indices of an output are NaN.
        confidence: Confidence of each single interval.
        breaks: Uniform numbers at which the function has jumps or kinks, for each input.
    """
    at_a, at_b = _split(function(points)), _split(function(other_points))
    together = np.eye(at_a.shape[0]) if outputs is None else outputs
    middle = (at_a.mean(axis=(1, 2)) + at_b.mean(axis=(1, 2)))[:, None, None] / 2
    variances = together @ (((at_a - middle) ** 2 + (at_b - middle) ** 2).mean(axis=2) / 2)
    shape = (len(groups), together.shape[0], REPLICATES)
    firsts, totals = np.zeros(shape), np.zeros(shape)
    for k, rows in enumerate(groups):
        change = _split(function(_mix_points(points, other_points, rows))) - at_a
        change_back = at_b - _split(function(_mix_points(other_points, points, rows)))
        firsts[k] = together @ (change * change_back).mean(axis=2) / 2
        totals[k] = together @ (change**2 + change_back**2).mean(axis=2) / 4

    variance = jackknife(lambda used: variances[:, used].mean(axis=1), confidence)
    marginals = Marginals.of(len(points), at_a.shape[2], is_net=True, breaks=breaks)
    squares = together @ marginals.subtract_means(function(marginals.uniforms)) ** 2
    known = marginals.is_resolved(squares, variance.replicate_variance)
    member = np.zeros((len(groups), len(points)))
    for k, rows in enumerate(groups):
        member[k, np.asarray(rows)] = 1

    def share(numerators: Array, members: Array) -> Estimates:
        def statistic(used: NDArray[np.bool_]) -> Array:
            below = variances[:, used].mean(axis=1)
            below = np.where(below > smallest, below, np.nan)
            return numerators[..., used].mean(axis=-1) / below

        found = jackknife(statistic, confidence)
        return found.where(known & _are_ratios_resolved(marginals, squares / variance.value[:, None], found, members))

    with np.errstate(divide="ignore", invalid="ignore"):
        return Indices(
            first=share(firsts, member),
            total=share(totals, member),
            first_sum=share(firsts.sum(axis=0), member.sum(axis=0)),
            variance=variance.where(known),
            varies=variance.value > smallest,
        )


def _are_ratios_resolved(marginals: Marginals, shares: Array, found: Estimates, members: Array) -> NDArray[np.bool_]:
    """Return which indices ``found``, ``(…, Q)``, the points resolve.

    ``shares`` are the contributions of the nodes to the relative variance, ``(Q, M)``; ``members``, ``(…, d)``, is one
    for numbers that contribute to the numerator, otherwise zero.
    """
    values = found.value.reshape(-1, len(shares))
    seen = found.replicate_variance.reshape(values.shape)
    of_each = members.reshape(len(values), len(marginals.columns))
    resolved = [
        marginals.is_resolved(shares, variance, member[:, None] - value)
        for value, variance, member in zip(values, seen, of_each, strict=True)
    ]
    return np.array(resolved, dtype=bool).reshape(found.value.shape)


def _mix_points(points: Array, other_points: Array, rows: Sequence[int] | NDArray[np.intp]) -> Array:
    result = points.copy()
    result[np.asarray(rows)] = other_points[np.asarray(rows)]
    return result


def _split(values: Array) -> Array:
    return values.reshape(values.shape[0], REPLICATES, -1)


LARGEST_STEP: Final = 0.1
"""Largest allowed effect of a jump between neighbours on a quantile, relative to its half-width."""

JUMP: Final = 12.0
"""Ratio of a neighbour distance to the mean that counts as a jump; smooth laws exceed it six times in a million."""

_NEGLIGIBLE: Final = 1e-12
_NEAR: Final = 0.02


@final
@dataclass(frozen=True, eq=False)
class Quantiles:
    """Quantiles of several rows of samples.

    Attributes:
        value: ``(rows,)`` quantiles.
        pseudo: ``(REPLICATES, rows)`` pseudo-values of the jackknife.
        steps: ``(rows, m)`` effect of each step between neighbours on the quantile.
        jumps: ``(rows, m)`` true if the step is a jump.
    """

    value: Array
    pseudo: Array
    steps: Array
    jumps: NDArray[np.bool_]

    def __sub__(self, other: Quantiles) -> Quantiles:
        return Quantiles(
            self.value - other.value, self.pseudo - other.pseudo, self.steps - other.steps, self.jumps | other.jumps
        )

    def estimates(self, confidence: float, unseen: Array | float = 0.0) -> Estimates:
        """Return values with intervals, NaN at jumps and gaps."""
        half = half_widths(self.pseudo, confidence) + np.abs(self.pseudo.mean(axis=0) - self.value) + unseen
        rounding = 1e-14 * np.abs(self.steps).sum(axis=1)
        smooth = (np.abs(self.steps) * self.jumps).max(axis=1) <= LARGEST_STEP * half + rounding
        return Estimates(self.value, half, self.pseudo.var(axis=0, ddof=1)).where(smooth)


def quantiles(samples: Array, probability: float, confidence: float) -> Estimates:
    """Return a quantile of every row of ``(rows, REPLICATES · n)`` with its interval; NaN at jumps and gaps."""
    return found_quantiles(samples, probability).estimates(confidence)


def quantile_changes(
    samples: Array, before: Array | Quantiles, probability: float, confidence: float, unseen: Array | float = 0.0
) -> tuple[Estimates, Estimates]:
    """Return a quantile of every row, and its change from that of ``before`` with the same random numbers.

    ``samples`` are ``(rows, REPLICATES · n)``; ``before`` may also be computed quantiles. Intervals are widened by
    ``unseen``, ``(rows,)``, the possible change in regions without samples.
    """
    after = found_quantiles(samples, probability)
    change = after - (before if isinstance(before, Quantiles) else found_quantiles(before, probability))
    return after.estimates(confidence, unseen), change.estimates(confidence, unseen)


def found_quantiles(samples: Array, probability: float) -> Quantiles:
    """Return a quantile of every row with the data for its interval."""
    count = samples.shape[1]
    first, weights = _weights(count, probability)
    start, fewer = _weights(count - count // REPLICATES, probability)
    below = np.cumsum(weights)[:-1]
    pulls = np.minimum(below, 1 - below)
    rows = [_of_one(values, first, weights, start, fewer) for values in samples]
    near = np.array([row[2] for row in rows])
    distances = np.diff(near, axis=1)
    # the distances of neighbours of a smooth law are exponentially distributed, with the median ln 2 times the mean
    centre = distances[:, pulls > _NEAR]
    usual = np.median(centre, axis=1, keepdims=True) / math.log(2)
    return Quantiles(
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]).T,
        distances * pulls,
        distances > JUMP * usual,
    )


def _of_one(values: Array, first: int, weights: Array, start: int, fewer: Array) -> tuple[float, Array, Array]:
    """Return a quantile, its pseudo-values, and the order statistics that it averages."""
    each = values.size // REPLICATES
    order = np.argsort(values, kind="stable")
    near = values[order[first : first + weights.size]]
    whole = float(near @ weights)
    replicate = order // each
    # the quantile without one replicate needs the ranks from start on, all of them within this window
    ahead = np.bincount(replicate[:start], minlength=REPLICATES)
    window = slice(start, start + fewer.size + each)
    rising, of = values[order[window]], replicate[window]
    left_out = np.empty(REPLICATES)
    for k in range(REPLICATES):
        left_out[k] = rising[of != k][ahead[k] : ahead[k] + fewer.size] @ fewer
    return whole, whole + (REPLICATES - 1) * (whole - left_out), near


@lru_cache(maxsize=64)
def _weights(count: int, probability: float) -> tuple[int, Array]:
    """Return the rank, from 0, of the first order statistic with a relevant weight, and the weights from there on."""
    shape = (count + 1) * probability, (count + 1) * (1 - probability)
    weights = np.diff(special.betainc(*shape, np.linspace(0.0, 1.0, count + 1)))
    kept = np.flatnonzero(weights > _NEGLIGIBLE * weights.max())
    chosen: Array = weights[kept[0] : kept[-1] + 1]
    return int(kept[0]), chosen / chosen.sum()
