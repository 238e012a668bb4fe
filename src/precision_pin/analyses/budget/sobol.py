"""Sobol indices of any function by the pick-freeze method, on replicated scrambled Sobol points.

First order: Azzini, Mara and Rosati, Environmental Modelling & Software 144 (2021) 105167, whose noise decreases with the
index itself. Total: Jansen, Computer Physics Communications 117 (1999). Both use two sets of points and their mixtures, as
in Saltelli et al., ibid. 181 (2010). For several outputs together, numerators and variances are added first (Gamboa,
Janon, Klein and Lagnoux, 2014). Intervals: the points are independent scrambles (Owen, 1995) of one net, and the estimates
are smooth functions of the replicates' means, see :mod:`precision_pin.analyses.replicates`. An index is not given where
the points do not resolve its variance or numerator (:mod:`precision_pin.analyses.replicates`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.replicates import REPLICATES, Estimates, Marginals, jackknife
from precision_pin.base.arrays import Array

_BITS: Final = 30


@final
@dataclass(frozen=True, eq=False)
class Indices:
    """Sobol indices of G groups of inputs and Q outputs.

    Attributes
    ----------
    first, total
        ``(G, Q)`` first-order and total indices.
    first_sum
        ``(Q,)`` sum of the first-order indices.
    variance
        ``(Q,)`` variance; for several outputs together the sum of their variances.
    varies
        ``(Q,)`` true if the output varies.
    """

    first: Estimates
    total: Estimates
    first_sum: Estimates
    variance: Estimates
    varies: NDArray[np.bool_]


def scrambled_points(dimension: int, seed: int, points: int, step: Callable[[], None] = lambda: None) -> Array:
    """Return `REPLICATES` independent scrambles of a Sobol net, concatenated.

    Parameters
    ----------
    dimension
        Number of coordinates of a point.
    seed
        64-bit seed.
    points
        Points in each replicate, a power of two.
    step
        Function called after each replicate.

    Returns
    -------
    NDArray
        ``(dimension, REPLICATES · points)`` inside (0, 1): midpoints of 2³⁰ cells.
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

    Parameters
    ----------
    function
        Function from uniform numbers ``(d, N)`` to values ``(q, N)``.
    points, other_points
        A and B, ``(d, REPLICATES · n)``, halves of one set of :func:`scrambled_points`.
    groups
        Rows of each group's inputs; groups must be independent of one another.
    outputs
        ``(Q, q)`` zeros and ones that select the function's values of each output; by default each value is an output.
    smallest
        Variance up to which the indices of an output are NaN.
    confidence
        Confidence of each interval by itself.
    breaks
        Uniform numbers at which the function has jumps or kinks, for each input.
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
            result: Array = numerators[..., used].mean(axis=-1) / below
            return result

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
    """Return which indices the points resolve, given the contributions of a number to numerator and denominator.

    Parameters
    ----------
    marginals, shares
        Nodes, and their contributions to the variance divided by the variance, ``(Q, M)``.
    found
        The indices, ``(…, Q)``.
    members
        ``(…, d)`` one if the number contributes to the numerator, otherwise zero.
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
    """Return the points with some of their inputs replaced by those of other points."""
    result = points.copy()
    result[np.asarray(rows)] = other_points[np.asarray(rows)]
    return result


def _split(values: Array) -> Array:
    """Return ``(q, N)`` as ``(q, REPLICATES, n)``."""
    return values.reshape(values.shape[0], REPLICATES, -1)
