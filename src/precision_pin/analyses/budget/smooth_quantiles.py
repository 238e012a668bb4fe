"""Quantiles of replicated samples, and their changes with common random numbers.

A quantile is computed as a weighted mean of the order statistics around it (Harrell and Davis, Biometrika 69, 1982). Unlike
a single order statistic it changes smoothly with every sample, so that the jackknife over replicates gives its error. It
also gives the error of the difference of two quantiles with common random numbers, in which most of the error of either
cancels. The bias estimated by the jackknife widens the interval. At a jump or a gap of the law within the averaged samples
the jackknife fails, because too few samples are affected: where a single wide step between neighbours moves the mean by
more than a tenth of the interval, no result is given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.replicates import REPLICATES, Estimates, half_widths
from precision_pin.base.arrays import Array

LARGEST_STEP: Final = 0.1
"""Largest allowed effect of a jump between neighbours on a quantile, as a share of its half-width."""

JUMP: Final = 12.0
"""Ratio of a distance between neighbours to the mean distance above which it counts as a jump; smooth laws exceed it six
times in a million."""

_NEGLIGIBLE: Final = 1e-12
_NEAR: Final = 0.02


@final
@dataclass(frozen=True, eq=False)
class Quantiles:
    """Quantiles of several rows of samples.

    Attributes
    ----------
    value
        ``(rows,)`` quantiles.
    pseudo
        ``(REPLICATES, rows)`` pseudo-values of the jackknife.
    steps
        ``(rows, m)`` effect of each step between neighbours on the quantile.
    jumps
        ``(rows, m)`` true if the step is a jump.
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
    """Return a quantile of every row, and its difference from that of ``before`` with the same random numbers.

    Parameters
    ----------
    samples, before
        ``(rows, REPLICATES · n)`` samples; the quantiles of the latter may be given instead, if already computed.
    probability
        Probability of the quantile.
    confidence
        Confidence of the intervals.
    unseen
        ``(rows,)`` possible change in regions without samples, by which the intervals are widened.
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
