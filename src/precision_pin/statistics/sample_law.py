"""Law of a number from its samples: quantiles from order statistics, with distribution-free intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, final, overload

import numpy as np

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array, Keys, Record, returns_read_only
from precision_pin.statistics.distribution import resolved
from precision_pin.statistics.intervals import quantile_ranks


def quantile_of(
    values: Array, probability: float, confidence: float, *, is_sorted: bool = False
) -> tuple[Array, Array]:
    """Return a quantile of each row of ``(k, N)`` and its distribution-free interval, ``(k,)`` and ``(2, k)``.

    The order statistics at rank 1 + (N - 1) p are interpolated linearly, as in
    :class:`precision_pin.statistics.Distribution`. The interval is NaN where the samples are too few for one.
    """
    count = values.shape[1]
    position = (count - 1) * probability
    below = min(math.floor(position), count - 1)
    above = min(below + 1, count - 1)
    ranks = quantile_ranks(count, probability, confidence)
    ends = () if ranks is None else (ranks[0] - 1, ranks[1] - 1)
    ordered = values if is_sorted else np.partition(values, sorted({below, above, *ends}), axis=1)
    quantile: Array = ordered[:, below] + (position - below) * (ordered[:, above] - ordered[:, below])
    interval = np.full((2, len(values)), np.nan) if ranks is None else np.stack([ordered[:, rank] for rank in ends])
    return quantile, interval


@final
@dataclass(frozen=True, eq=False)
class SampleLaw(Record):
    """Law of a number, SI, from its samples ``values`` ``(N,)``; the JSON has the quantiles of the probabilities ``levels``."""

    KEYS: ClassVar[Keys] = ("mean", "std", "quantiles", "quantile_interval=intervals")

    values: Array
    confidence: float
    levels: tuple[float, ...]

    def __repr__(self) -> str:
        return f"<SampleLaw: mean {self.mean:.6g}, std {self.std:.6g}, N = {self.values.size}>"

    @property
    def mean(self) -> float:
        """Mean."""
        return float(self.values.mean())

    @property
    def std(self) -> float:
        """Standard deviation, divisor N - 1; NaN for one sample."""
        return float(self.values.std(ddof=1)) if self.values.size > 1 else math.nan

    @overload
    def quantile(self, probability: float) -> float: ...
    @overload
    def quantile(self, probability: Sequence[float] | Array) -> Array: ...
    def quantile(self, probability: float | Sequence[float] | Array) -> float | Array:
        """Return a quantile, or several; raises InputError also where the samples are too few for its interval."""
        return resolved(self.resolved_quantile, probability, "the law", self.values.size, self.confidence)

    def resolved_quantile(self, probability: float) -> float | None:
        """Return a quantile; ``None`` where the samples are too few for its interval.

        Raises:
            InputError: The probability is not between 0 and 1.
        """
        return self._quantile(probability)[0]

    def quantile_interval(self, probability: float) -> tuple[float, float] | None:
        """Return the distribution-free interval of a quantile, as :meth:`quantile`."""
        return self._quantile(probability)[1]

    def _quantile(self, probability: float) -> tuple[float, tuple[float, float]] | tuple[None, None]:
        subject, allowed = "the probability of a quantile", "above 0 and below 1"
        level = check_number(subject, probability, allowed, lambda p: 0 < p < 1)
        value, interval = quantile_of(self.sorted[None], level, self.confidence, is_sorted=True)
        low, high = interval[:, 0].tolist()
        return (None, None) if math.isnan(low) else (float(value[0]), (low, high))

    @cached_property
    @returns_read_only
    def sorted(self) -> Array:
        """The values in ascending order."""
        return np.sort(self.values)

    @property
    def quantiles(self) -> dict[float, float | None]:
        """Quantiles of the JSON."""
        return {level: self.resolved_quantile(level) for level in self.levels}

    @property
    def intervals(self) -> dict[float, tuple[float, float] | None]:
        """Intervals of these quantiles."""
        return {level: self.quantile_interval(level) for level in self.levels}
