"""The law of a figure over built robots and over tests, from one test of each of N robots."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, final

import numpy as np

from precision_pin.base.arguments import check_number
from precision_pin.base.array_checks import fix_fields, returns_read_only
from precision_pin.base.arrays import Array
from precision_pin.statistics import quantile_ranks

LEVELS: Final = (0.0027, 0.05, 0.5, 0.95, 0.9973)
"""Probabilities of the quantiles in the JSON."""


@final
@dataclass(frozen=True, eq=False)
class FigureLaw:
    """The law of a figure, m or rad, over built robots and tests.

    Attributes
    ----------
    values
        The figure of each robot (of each group of five for E), ``(N,)``.
    confidence
        Confidence of the intervals.
    """

    values: Array
    confidence: float

    def __post_init__(self) -> None:
        fix_fields(self)

    def __repr__(self) -> str:
        return f"<FigureLaw: mean {self.mean:.6g}, std {self.std:.6g}, N = {self.values.size}>"

    @property
    def mean(self) -> float:
        """Mean."""
        return float(self.values.mean())

    @property
    def std(self) -> float:
        """Standard deviation, divisor N - 1; NaN of one robot."""
        return float(self.values.std(ddof=1)) if self.values.size > 1 else math.nan

    def quantile(self, probability: float) -> float | None:
        """Return a quantile; ``None`` where the robots are too few for its interval.

        Raises
        ------
        InputError
            The probability is not between 0 and 1.
        """
        level = _check_probability(probability)
        if self.quantile_interval(level) is None:
            return None
        place = (self.values.size - 1) * level
        below = int(place)
        low, high = self.sorted[below], self.sorted[min(below + 1, self.values.size - 1)]
        return float(low + (place - below) * (high - low))

    def quantile_interval(self, probability: float) -> tuple[float, float] | None:
        """Return the distribution-free interval of a quantile; ``None`` where the robots are too few for one.

        Raises
        ------
        InputError
            The probability is not between 0 and 1.
        """
        ranks = quantile_ranks(self.values.size, _check_probability(probability), self.confidence)
        if ranks is None:
            return None
        return float(self.sorted[ranks[0] - 1]), float(self.sorted[ranks[1] - 1])

    @cached_property
    @returns_read_only
    def sorted(self) -> Array:
        """The values in rising order."""
        return np.sort(self.values)

    def to_dict(self) -> dict[str, Any]:
        """Return the law as in the JSON; null where the robots are too few."""
        intervals = {level: self.quantile_interval(level) for level in LEVELS}
        return {
            "mean": self.mean,
            "std": None if math.isnan(self.std) else self.std,
            "quantiles": {str(level): self.quantile(level) for level in LEVELS},
            "quantile_interval": {
                str(level): None if ends is None else list(ends) for level, ends in intervals.items()
            },
        }


def _check_probability(probability: float) -> float:
    return check_number("the probability of a quantile", probability, "above 0 and below 1", lambda p: 0 < p < 1)
