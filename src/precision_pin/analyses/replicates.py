"""Estimates from independent replicates, with intervals that mind skewness.

A statistic of all replicates gets its standard error from leaving out one replicate after another (jackknife). The means
of few heavy-tailed numbers are skewed, and Student's symmetric interval then misses on one side: the pseudo-values of the
jackknife also give their skewness, and with it Hall's transformation of Student's ratio (Journal of the Royal Statistical
Society B 54, 1992, 221) gives an interval with ends of different distance. What is reported is the farther end, on both
sides, never less than Student's, and a tenth wider: of ratios and of nets, whose scrambles are not quite the independent normal
numbers that both suppose, it held the truth in 92 to 94 of 100 runs without.

No replicate shows a tail that none has met. That takes what is known of the laws, see
:mod:`precision_pin.analyses.marginals`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.statistics.skewed_means import studentised
from precision_pin.typing import Array

__all__ = ["REPLICATES", "Estimates", "estimated", "half_widths", "jackknife", "pseudo_values"]


REPLICATES: Final = 32
"""Independent runs, or scrambles of a net."""

_WIDENING: Final = 1.1
_ROUNDING: Final = 1e-14
"""Skewness of replicates that differ by less than this share of themselves is that of rounding."""


@final
@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimates of one shape with half the width of their intervals.

    Attributes
    ----------
    value, half_width
        Arrays of one shape; not-a-number where nothing can be told.
    replicate_variance
        Variance of what one replicate by itself would give, about.
    """

    value: Array
    half_width: Array
    replicate_variance: Array

    @property
    def standard_error(self) -> Array:
        """Of the values."""
        result: Array = np.sqrt(self.replicate_variance / REPLICATES)
        return result

    def where(self, resolved: Array | NDArray[np.bool_]) -> Estimates:
        """Return the estimates, not-a-number where they are not resolved."""
        keep = np.asarray(resolved, dtype=bool)
        return Estimates(
            np.where(keep, self.value, np.nan),
            np.where(keep, self.half_width, np.nan),
            np.where(keep, self.replicate_variance, np.nan),
        )


def pseudo_values(statistic: Callable[[NDArray[np.bool_]], Array]) -> tuple[Array, Array]:
    """Return a statistic of all replicates, and the jackknife's pseudo-values ``(REPLICATES, …)``.

    Parameters
    ----------
    statistic
        Takes which replicates to use, ``(REPLICATES,)``.
    """
    everything = np.ones(REPLICATES, dtype=bool)
    whole = np.asarray(statistic(everything), dtype=float)
    left_out = np.array([statistic(everything & (np.arange(REPLICATES) != k)) for k in range(REPLICATES)])
    return whole, whole + (REPLICATES - 1) * (whole - left_out)


def jackknife(statistic: Callable[[NDArray[np.bool_]], Array], confidence: float) -> Estimates:
    """Return a smooth statistic with its interval.

    Parameters
    ----------
    statistic
        Takes which replicates to use, ``(REPLICATES,)``.
    confidence
        Of the interval.
    """
    return estimated(*pseudo_values(statistic), confidence)


def estimated(value: Array, pseudo: Array, confidence: float) -> Estimates:
    """Return estimates from their pseudo-values ``(REPLICATES, …)``."""
    return Estimates(value, half_widths(pseudo, confidence), pseudo.var(axis=0, ddof=1))


def half_widths(pseudo: Array, confidence: float) -> Array:
    """Return half the width of intervals of the means of ``(REPLICATES, …)``, for skewed ones to the farther side."""
    middle, spread = pseudo.mean(axis=0), pseudo.std(axis=0)
    varies = spread > _ROUNDING * np.abs(middle)
    cubes = ((pseudo - middle) ** 3).mean(axis=0)
    skewness = np.divide(cubes, spread**3, out=np.zeros_like(middle), where=varies & (spread > 0))
    student = float(special.stdtrit(REPLICATES - 1, (1 + confidence) / 2))
    small = np.abs(skewness) / math.sqrt(REPLICATES)
    ends = [studentised(side * student, small) for side in (-1, 1)]
    reach = np.maximum(np.maximum(np.abs(ends[0]), np.abs(ends[1])), student)
    result: Array = _WIDENING * reach * spread * math.sqrt(1 / (REPLICATES - 1))
    return result
