"""Sobol indices of any function by pick-freeze, on scrambled Sobol points with replicates for intervals.

First order: Azzini, Mara and Rosati, Environmental Modelling & Software 144 (2021) 105167, whose noise shrinks with the
index itself; total: Jansen, Computer Physics Communications 117 (1999). Both from two sets of points and their mixtures
as in Saltelli et al., ibid. 181 (2010). Of several outputs together: numerators and variances added up first (Gamboa,
Janon, Klein and Lagnoux, 2014). Intervals: the points are independent scrambles (Owen, 1995) of one net; the estimates
are smooth functions of the replicates' means, and their jackknife over the replicates gives a standard error with
Student's law.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

__all__ = [
    "REPLICATES",
    "Estimates",
    "Indices",
    "jackknife",
    "quantile_changes",
    "quantiles",
    "scrambled_points",
    "sobol_indices",
]

Array = NDArray[np.float64]

REPLICATES: Final = 16
"""Independent scrambles."""

_BITS: Final = 30


@final
@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimates of one shape with half the width of their intervals.

    Attributes
    ----------
    value, half_width
        Arrays of one shape; not-a-number where nothing can be told.
    """

    value: Array
    half_width: Array


@final
@dataclass(frozen=True, eq=False)
class Indices:
    """Sobol indices of G groups of inputs and Q outputs.

    Attributes
    ----------
    first, total
        ``(G, Q)``.
    first_sum
        ``(Q,)`` sum of the first-order indices.
    variance
        ``(Q,)``; of several outputs together: the sum of theirs.
    """

    first: Estimates
    total: Estimates
    first_sum: Estimates
    variance: Estimates


def scrambled_points(dimension: int, seed: int, points: int) -> Array:
    """Return `REPLICATES` independent scrambles of a Sobol net, one after the other.

    Parameters
    ----------
    dimension
        How many numbers a point has.
    seed
        64-bit seed.
    points
        Of each replicate; a power of two.

    Returns
    -------
    NDArray
        ``(dimension, REPLICATES · points)``, inside (0, 1): midpoints of 2³⁰ cells.
    """
    # half a second to import, for this function only
    from scipy.stats import qmc

    made = [
        # the keyword of every scipy since 1.14; the newer one, rng, is not known to all of them
        qmc.Sobol(dimension, scramble=True, bits=_BITS, seed=np.random.default_rng([seed, k])).random(points)
        for k in range(REPLICATES)
    ]
    result: Array = np.concatenate(made).T + 0.5**_BITS / 2
    return np.ascontiguousarray(result)


def jackknife(statistic: Callable[[NDArray[np.bool_]], Array], confidence: float) -> Estimates:
    """Return a smooth statistic with its interval from leaving out one replicate after another.

    Parameters
    ----------
    statistic
        Takes which replicates to use, ``(REPLICATES,)``.
    confidence
        Of the interval.
    """
    everything = np.ones(REPLICATES, dtype=bool)
    left_out = np.array([statistic(everything & (np.arange(REPLICATES) != k)) for k in range(REPLICATES)])
    error = np.sqrt((REPLICATES - 1) * left_out.var(axis=0))
    return Estimates(statistic(everything), _student(confidence) * error)


def quantiles(samples: Array, probability: float, confidence: float) -> Estimates:
    """Return a quantile of every row of ``(rows, REPLICATES · n)`` with its interval (Woodruff, 1952).

    The share of each replicate below the pooled quantile gives an interval of the share, and the pooled quantiles at its
    ends the width of the quantile's. The jackknife is no help here: it moves a quantile by a few samples only.
    """
    value, pull = _quantile(samples, probability, confidence)
    return Estimates(value, _half_width(pull, confidence))


def quantile_changes(
    samples: Array, before: Array, probability: float, confidence: float
) -> tuple[Estimates, Estimates]:
    """Return a quantile of every row, and how much it is above that of ``before``, which has the same random numbers.

    Parameters
    ----------
    samples, before
        ``(rows, REPLICATES · n)``.
    probability
        Which quantile.
    confidence
        Of the intervals.
    """
    value, pull = _quantile(samples, probability, confidence)
    value_before, pull_before = _quantile(before, probability, confidence)
    return (
        Estimates(value, _half_width(pull, confidence)),
        Estimates(value - value_before, _half_width(pull - pull_before, confidence)),
    )


def _quantile(samples: Array, probability: float, confidence: float) -> tuple[Array, Array]:
    """Return a quantile of every row, and what each replicate by itself would move it by, ``(rows, REPLICATES)``."""
    value: Array = np.quantile(samples, probability, axis=1, method="hazen")
    below = (_split(samples) <= value[:, None, None]).mean(axis=2)
    reach = _half_width(below, confidence)
    slopes = np.zeros(len(value))
    for row in np.flatnonzero(reach > 0):
        ends = np.clip([probability - reach[row], probability + reach[row]], 0, 1)
        slopes[row] = np.diff(np.quantile(samples[row], ends, method="hazen"))[0] / (ends[1] - ends[0])
    return value, (below.mean(axis=1, keepdims=True) - below) * slopes[:, None]


def _half_width(replicates: Array, confidence: float) -> Array:
    """Return half of the interval of the mean of replicates, ``(…, REPLICATES)``."""
    result: Array = _student(confidence) * replicates.std(axis=-1, ddof=1) / np.sqrt(REPLICATES)
    return result


def _student(confidence: float) -> float:
    return float(special.stdtrit(REPLICATES - 1, (1 + confidence) / 2))


def sobol_indices(
    function: Callable[[Array], Array],
    points: Array,
    other_points: Array,
    groups: Sequence[Sequence[int] | NDArray[np.intp]],
    *,
    outputs: Array | None = None,
    smallest: float = 0.0,
    confidence: float = 0.95,
) -> Indices:
    """Return first-order and total Sobol indices of groups of inputs.

    With A and B two independent sets of points, A' the points A with the inputs of group g from B, and B' the points B
    with those of A: ``S_g V = E[(f(A') - f(A)) (f(B) - f(B'))]/2``, ``T_g V = E[(f(A') - f(A))² + (f(B') - f(B))²]/4``.

    Parameters
    ----------
    function
        Takes uniform numbers ``(d, N)``, gives ``(q, N)``.
    points, other_points
        A and B, ``(d, REPLICATES · n)``, halves of one set of :func:`scrambled_points`.
    groups
        Rows of each group's inputs; groups must be independent of one another.
    outputs
        ``(Q, q)`` zeros and ones: which of the function's numbers belong to one output; each by itself if left out.
    smallest
        An output whose variance is not larger than this has no indices (not-a-number).
    confidence
        Of every interval, each by itself.
    """
    at_a, at_b = _split(function(points)), _split(function(other_points))
    together = np.eye(at_a.shape[0]) if outputs is None else outputs
    middle = (at_a.mean(axis=(1, 2)) + at_b.mean(axis=(1, 2)))[:, None, None] / 2
    variances = together @ (((at_a - middle) ** 2 + (at_b - middle) ** 2).mean(axis=2) / 2)
    shape = (len(groups), together.shape[0], REPLICATES)
    firsts, totals = np.zeros(shape), np.zeros(shape)
    for k, rows in enumerate(groups):
        change = _split(function(_mixed(points, other_points, rows))) - at_a
        change_back = at_b - _split(function(_mixed(other_points, points, rows)))
        firsts[k] = together @ (change * change_back).mean(axis=2) / 2
        totals[k] = together @ (change**2 + change_back**2).mean(axis=2) / 4

    def share(numerators: Array) -> Estimates:
        def statistic(used: NDArray[np.bool_]) -> Array:
            below = variances[:, used].mean(axis=1)
            below = np.where(below > smallest, below, np.nan)
            result: Array = numerators[..., used].mean(axis=-1) / below
            return result

        return jackknife(statistic, confidence)

    return Indices(
        first=share(firsts),
        total=share(totals),
        first_sum=share(firsts.sum(axis=0)),
        variance=jackknife(lambda used: variances[:, used].mean(axis=1), confidence),
    )


def _mixed(points: Array, other_points: Array, rows: Sequence[int] | NDArray[np.intp]) -> Array:
    """Return points with some of their inputs from other points."""
    result = points.copy()
    result[np.asarray(rows)] = other_points[np.asarray(rows)]
    return result


def _split(values: Array) -> Array:
    """Return ``(q, N)`` as ``(q, REPLICATES, n)``."""
    return values.reshape(values.shape[0], REPLICATES, -1)
