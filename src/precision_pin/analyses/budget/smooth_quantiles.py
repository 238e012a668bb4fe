"""Quantiles of replicated samples, and how much they change when the same random numbers are used otherwise.

A quantile is taken as a weighted mean of the order statistics around it (Harrell and Davis, Biometrika 69, 1982): unlike a
single one it moves smoothly with every sample, so that the jackknife over replicates gives its error, and that of the
difference of two quantiles found with the same random numbers, in which most of the error of either drops out. The bias
that the jackknife finds widens the interval. A jump or a gap of the law within the samples averaged is met by too few of them
for that: where a single wide step between neighbours moves the mean by more than a tenth of the interval, nothing is given.
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
from precision_pin.typing import Array

__all__ = ["Quantiles", "found_quantiles", "quantile_changes", "quantiles"]


LARGEST_STEP: Final = 0.1
"""A jump between neighbours may move a quantile by this share of half its interval."""

JUMP: Final = 12.0
"""Distances of neighbours above this many usual ones are jumps: of smooth laws, six in a million."""

_NEGLIGIBLE: Final = 1e-12
_NEAR: Final = 0.02


@final
@dataclass(frozen=True, eq=False)
class Quantiles:
    """Quantiles of rows.

    Attributes
    ----------
    value
        ``(rows,)``.
    pseudo
        The jackknife's pseudo-values, ``(REPLICATES, rows)``.
    steps
        By how much each step between neighbours moves them, ``(rows, m)``.
    jumps
        Whether it is a jump, ``(rows, m)``.
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
        """Return values with intervals, not-a-number at jumps and gaps."""
        half = half_widths(self.pseudo, confidence) + np.abs(self.pseudo.mean(axis=0) - self.value) + unseen
        rounding = 1e-14 * np.abs(self.steps).sum(axis=1)
        smooth = (np.abs(self.steps) * self.jumps).max(axis=1) <= LARGEST_STEP * half + rounding
        return Estimates(self.value, half, self.pseudo.var(axis=0, ddof=1)).where(smooth)


def quantiles(samples: Array, probability: float, confidence: float) -> Estimates:
    """Return a quantile of every row of ``(rows, REPLICATES · n)`` with its interval; not-a-number at jumps and gaps."""
    return found_quantiles(samples, probability).estimates(confidence)


def quantile_changes(
    samples: Array, before: Array | Quantiles, probability: float, confidence: float, unseen: Array | float = 0.0
) -> tuple[Estimates, Estimates]:
    """Return a quantile of every row, and how much it is above that of ``before``, which has the same random numbers.

    Parameters
    ----------
    samples, before
        ``(rows, REPLICATES · n)``; what is known of the latter already may be given in its place.
    probability
        Which quantile.
    confidence
        Of the intervals.
    unseen
        What may change where no sample lies, ``(rows,)``; the intervals are wider by as much.
    """
    after = found_quantiles(samples, probability)
    change = after - (before if isinstance(before, Quantiles) else found_quantiles(before, probability))
    return after.estimates(confidence, unseen), change.estimates(confidence, unseen)


def found_quantiles(samples: Array, probability: float) -> Quantiles:
    """Return a quantile of every row with what its interval follows from."""
    count = samples.shape[1]
    first, weights = _weights(count, probability)
    start, fewer = _weights(count - count // REPLICATES, probability)
    below = np.cumsum(weights)[:-1]
    pulls = np.minimum(below, 1 - below)
    rows = [_of_one(values, first, weights, start, fewer) for values in samples]
    near = np.array([row[2] for row in rows])
    distances = np.diff(near, axis=1)
    # of neighbours in a smooth law the distance is exponential; its median is ln 2 of its mean
    centre = distances[:, pulls > _NEAR]
    usual = np.median(centre, axis=1, keepdims=True) / math.log(2)
    return Quantiles(
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]).T,
        distances * pulls,
        distances > JUMP * usual,
    )


def _of_one(values: Array, first: int, weights: Array, start: int, fewer: Array) -> tuple[float, Array, Array]:
    """Return a quantile, its pseudo-values, and the order statistics that it is a mean of."""
    each = values.size // REPLICATES
    order = np.argsort(values, kind="stable")
    near = values[order[first : first + weights.size]]
    whole = float(near @ weights)
    replicate = order // each
    # of the samples without one replicate, those of the ranks from start on: no more than this is looked at
    ahead = np.bincount(replicate[:start], minlength=REPLICATES)
    window = slice(start, start + fewer.size + each)
    rising, of = values[order[window]], replicate[window]
    left_out = np.empty(REPLICATES)
    for k in range(REPLICATES):
        left_out[k] = rising[of != k][ahead[k] : ahead[k] + fewer.size] @ fewer
    return whole, whole + (REPLICATES - 1) * (whole - left_out), near


@lru_cache(maxsize=64)
def _weights(count: int, probability: float) -> tuple[int, Array]:
    """Return the rank, 0-based, of the first order statistic that matters, and the weights from it on."""
    shape = (count + 1) * probability, (count + 1) * (1 - probability)
    weights = np.diff(special.betainc(*shape, np.linspace(0.0, 1.0, count + 1)))
    kept = np.flatnonzero(weights > _NEGLIGIBLE * weights.max())
    chosen: Array = weights[kept[0] : kept[-1] + 1]
    return int(kept[0]), chosen / chosen.sum()
