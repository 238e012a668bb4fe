"""Distribution-free intervals: ranks of order statistics and the Clopper-Pearson interval.

Of N independent samples of a continuous law, the number below its p-quantile is binomial (N, p). All intervals
follow from this and assume nothing else about the law; for a law with jumps the confidence is only higher.
The binomial tails are computed with the regularised incomplete beta function.
"""

from __future__ import annotations

from bisect import bisect_left
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtr, betainc, betaincinv

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array


def check_confidence(confidence: float) -> None:
    """Check that a confidence lies above 0 and below 1.

    Raises
    ------
    InputError
        The confidence lies outside.
    """
    check_number("confidence", confidence, "above 0 and below 1", lambda share: 0 < share < 1)


@lru_cache(maxsize=1024)
def quantile_ranks(samples: int, p: float, confidence: float) -> tuple[int, int] | None:
    """Return the ranks whose order statistics enclose the p-quantile, or None.

    For B binomial (samples, p), the lower rank is the largest l with P(B < l) ≤ (1 − confidence)/2, the upper
    rank the smallest u with P(B ≥ u) ≤ (1 − confidence)/2. Ranks count from 1. The result is None where l would
    be 0 or u would exceed the number of samples: no sample lies far enough out (David and Nagaraja, Order
    Statistics, section 7.1).
    """
    tail = (1 - confidence) / 2
    lower = bisect_left(range(samples + 1), True, key=lambda k: _at_most(k, samples, p) > tail)
    upper = _smallest_rank_above(samples, p, tail)
    return (lower, upper) if lower >= 1 and upper <= samples else None


def quantile_coverage(samples: int, p: float, ranks: tuple[int, int]) -> float:
    """Return P(X₍l₎ ≤ p-quantile < X₍u₎) = P(l ≤ B ≤ u − 1), exact for every continuous law."""
    lower, upper = ranks
    return _at_most(upper - 1, samples, p) - _at_most(lower - 1, samples, p)


@lru_cache(maxsize=1024)
def upper_bound_rank(samples: int, p: float, confidence: float) -> int | None:
    """Return the rank whose order statistic bounds the p-quantile from above with this confidence.

    This is the smallest u with P(B ≥ u) ≤ 1 − confidence; None where even the largest sample is no such bound
    (Wilks 1941: 95 % of the law with 95 % confidence needs 59 samples).
    """
    rank = _smallest_rank_above(samples, p, 1 - confidence)
    return rank if rank <= samples else None


@lru_cache(maxsize=1024)
def tolerance_ranks(samples: int, content: float, confidence: float) -> tuple[int, int] | None:
    """Return the symmetric ranks r and N + 1 − r between which this content of the law lies.

    The probability between X₍r₎ and X₍N+1−r₎ is distributed as Beta(N + 1 − 2r, 2r); r is the largest rank for
    which it exceeds the content with this confidence. None where r would be 0 (Wilks 1941: 93 samples for 95/95).
    """
    largest = samples // 2
    rank = bisect_left(
        range(1, largest + 1),
        True,
        key=lambda r: float(betainc(2 * r, samples + 1 - 2 * r, 1 - content)) < confidence,
    )
    return (rank, samples + 1 - rank) if rank >= 1 else None


def clopper_pearson(inside: int, samples: int, confidence: float) -> tuple[float, float]:
    """Return the Clopper-Pearson interval of a probability, given the number of samples inside.

    Its coverage is at least the confidence for every probability (Clopper and Pearson, Biometrika 26,
    1934). The lower end is 0 if no sample is inside, the upper end 1 if all are.
    """
    tail = (1 - confidence) / 2
    lower = float(betaincinv(inside, samples - inside + 1, tail)) if inside > 0 else 0.0
    return lower, float(upper_ends(np.array(inside), samples, tail))


def share_to_show(required: float, samples: int, confidence: float, chance: float) -> float | None:
    """Return the least probability of which so many samples show, with this chance, that it is at least ``required``.

    It is shown where the lower end of its Clopper-Pearson interval reaches ``required``; None where that of no number of
    samples inside does.
    """
    least = _smallest_rank_above(samples, required, (1 - confidence) / 2)
    return float(betaincinv(least, samples - least + 1, chance)) if least <= samples else None


def upper_ends(inside: ArrayLike, samples: int, tail: float) -> Array:
    """Return one-sided upper ends (Clopper-Pearson) of probabilities, which are missed with the probability ``tail``.

    Parameters
    ----------
    inside
        Numbers of samples inside, of any shape.
    samples
        Of how many.
    tail
        Probability of a value beyond the end.
    """
    few = np.asarray(inside)
    return np.where(few >= samples, 1.0, betaincinv(few + 1, np.maximum(samples - few, 1), 1 - tail))


def _at_most(k: int, samples: int, p: float) -> float:
    """Return P(B ≤ k)."""
    return float(bdtr(k, samples, p)) if k >= 0 else 0.0


def _smallest_rank_above(samples: int, p: float, tail: float) -> int:
    """Return the smallest u with P(B ≥ u) ≤ tail; samples + 1 where there is none."""
    return 1 + bisect_left(range(1, samples + 1), True, key=lambda u: float(betainc(u, samples - u + 1, p)) <= tail)
