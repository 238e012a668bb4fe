"""Warnings about what a sheet says that is allowed but seldom meant."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from precision_pin import special
from precision_pin.laws import Empirical, Law, Rows

__all__ = ["FEW", "few_samples"]

FEW: Final = 30
"""Below so many measured samples the spread of what is drawn from them is warned of."""
_CONFIDENCE: Final = 0.95


def few_samples(law: Law) -> str | None:
    """Return what to say of a law made of few measured samples; None for any other.

    Drawing from n samples has the variance with the divisor n, or less with straight lines between them: on average less
    than the true one. How far the true one may lie above theirs is its upper confidence limit for normal numbers,
    ``s √((n - 1)/χ²)`` with the lower quantile of χ² of n - 1 degrees of freedom.
    """
    match law:
        case Empirical(sample_count=int(count)):
            samples = np.array([law.quantiles[1:-1]], dtype=float)[:, :, 1].T
        case Rows():
            count, samples = len(law.table), law.array
        case _:
            return None
    if count >= FEW:
        return None
    if count == 1:
        return "one measured sample has no spread; give a law with a tolerance about it"
    spread, drawn = samples.std(axis=0, ddof=1), np.sqrt(np.diag(law.covariance))
    varies = spread > 0
    if not varies.any():
        return f"{count} measured samples that are all the same have no spread; give a law with a tolerance about them"
    factor = float((drawn[varies] / spread[varies]).min())
    most = math.sqrt((count - 1) / (2 * float(special.gammaincinv((count - 1) / 2, 1 - _CONFIDENCE))))
    return (
        f"{count} measured samples: the standard deviation of what is drawn from them is {factor:.2f} of theirs (divisor "
        f"n - 1), and the true one may be up to {most:.1f} times theirs ({_CONFIDENCE:.0%} confidence, for normal numbers); "
        f"give a law with its spread, or {FEW} samples"
    )
