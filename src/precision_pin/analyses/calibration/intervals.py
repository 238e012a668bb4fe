"""Interval of a number after a calibration: its own law in the sheet, weighed by what the readings say of it.

With v₀ and v the number's variance before and after, and x̂ its estimate where no law has bounds, the readings say of it what one
reading ``y ± s`` of the number itself would: 1/s² = 1/v - 1/v₀ and y/s² = x̂/v - μ/v₀ (all other numbers taken as normal).
The interval is that of the law times ``exp(-(x - y)²/2s²)``. A number of which little is learned keeps the interval of its law,
which a normal one would miss: ± 1.96 standard deviations of a uniform law lie beyond its ends.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import special

from precision_pin.draws.laws import Law
from precision_pin.draws.laws.projection import Projection

_NOTHING: Final = 1e-9
"""Share of a variance below which nothing is learned."""
_REACH: Final = 9.0
"""Deviations s beyond which the readings leave nothing of the law."""
_WITHIN: Final = 6.0
"""Score of a normal law beyond which the ends of a law are neglected: a probability of 2e-9."""
_CELLS: Final = 1000


def interval_after(
    law: Law, number: int, estimate: float, std: float, variance_left: float, probability: float
) -> tuple[float, float]:
    """Return the interval with the probability outside split evenly over both sides.

    Parameters
    ----------
    law, number
        The law before the calibration, and which of its numbers (0-based).
    estimate
        Of the number where no law has bounds, SI.
    std
        Standard deviation before the calibration, SI, above zero.
    variance_left
        Share of the variance that is left, above 0 and up to 1.
    probability
        Of the interval, between 0 and 1.
    """
    mean = float(law.mean_vector[number])
    projection = law.projection(np.eye(law.size)[number])
    if projection is None:
        # normal numbers stay normal
        return normal_interval(estimate, std * float(np.sqrt(variance_left)), probability)
    precision = 1 / variance_left - 1
    if precision < _NOTHING:
        low, high = _quantiles(projection, 0.0, np.inf, probability)
    else:
        reading = (estimate - mean) / variance_left / precision
        low, high = _quantiles(projection, reading, std / np.sqrt(precision), probability)
    return mean + low, mean + high


def normal_interval(mean: float, std: float, probability: float) -> tuple[float, float]:
    """Return the interval of a normal number about its mean."""
    reach = float(special.ndtri((1 + probability) / 2)) * std
    return mean - reach, mean + reach


def _quantiles(projection: Projection, reading: float, std: float, probability: float) -> tuple[float, float]:
    """Return both ends of the interval of a law of zero mean times ``exp(-(x - reading)²/2 std²)``."""
    ends = projection.within(_WITHIN)
    for low, high in ((reading - _REACH * std, reading + _REACH * std), ends):
        edges = np.linspace(max(ends[0], low), min(ends[1], high), _CELLS + 1)
        below = projection.cumulative(edges)
        if edges[0] == ends[0]:
            below[0] = 0.0
        share = np.diff(below)
        # nothing: the readings are beyond an end of the law, or between its single values
        if edges[0] < edges[-1] and (share > 0).any():
            break
    exponent = -0.5 * (((edges[1:] + edges[:-1]) / 2 - reading) / std) ** 2
    share *= np.exp(np.minimum(exponent - exponent[share > 0].max(), 0.0))
    within = np.concatenate([[0.0], np.cumsum(share)])
    sides = (1 - probability) / 2
    first, last = np.interp([sides, 1 - sides], within / within[-1], edges)
    return float(first), float(last)
