"""Differences between two samples of the same robots, with intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.draws import lazy_special
from precision_pin.typing import Array

__all__ = ["Difference", "mean_difference", "quantile_difference", "share_difference"]

_SECTIONS: Final = 20
"""Parts of a sample from which the scatter of a quantile's difference is taken."""
_LEAST_BEYOND: Final = 5
"""Robots beyond the quantile that each part needs."""


@final
@dataclass(frozen=True)
class Difference:
    """A difference, the other minus the first.

    Attributes
    ----------
    value
        In the unit of what is compared.
    interval
        Its ends; ``None`` where the robots are too few.
    """

    value: float
    interval: tuple[float, float] | None

    @property
    def is_told(self) -> bool:
        """Whether the interval leaves zero out."""
        return self.interval is not None and not self.interval[0] <= 0 <= self.interval[1]

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of the JSON."""
        return {"value": self.value, "interval": None if self.interval is None else list(self.interval)}


def mean_difference(first: Array, other: Array, confidence: float) -> Difference:
    """Return the difference of the means of paired samples ``(N,)``, with the normal interval of a paired mean."""
    gap = other - first
    value = float(gap.mean())
    if gap.size < 2:
        return Difference(value, None)
    half = float(lazy_special.ndtri(0.5 + confidence / 2)) * float(gap.std(ddof=1)) / math.sqrt(gap.size)
    return Difference(value, (value - half, value + half))


def quantile_difference(first: Array, other: Array, probability: float, confidence: float) -> Difference:
    """Return the difference of a quantile of paired samples ``(N,)``.

    The interval is by sectioning: 20 consecutive parts of the sample each give a difference, whose mean square distance from
    that of the whole sample gives the scatter (Asmussen and Glynn, Stochastic Simulation, 2007, III.5). ``None`` where a part
    has fewer than five robots beyond the quantile.
    """
    value = float(np.quantile(other, probability) - np.quantile(first, probability))
    size = first.size // _SECTIONS
    if size * min(probability, 1 - probability) < _LEAST_BEYOND:
        return Difference(value, None)
    parts = [one[: size * _SECTIONS].reshape(_SECTIONS, size) for one in (first, other)]
    gaps = np.quantile(parts[1], probability, axis=1) - np.quantile(parts[0], probability, axis=1)
    scatter = math.sqrt(float(((gaps - value) ** 2).sum()) / (_SECTIONS - 1) / _SECTIONS)
    half = _student(confidence) * scatter
    return Difference(value, (value - half, value + half))


def share_difference(first: NDArray[np.bool_], other: NDArray[np.bool_], confidence: float) -> Difference:
    """Return the difference of the shares of true values of paired samples ``(N,)``.

    The interval is that of Bonett and Price (2012): Wald's of paired shares with a robot added to each kind that changes sides.
    """
    gained, lost = int((other & ~first).sum()), int((first & ~other).sum())
    count = first.size
    up, down = (gained + 1) / (count + 2), (lost + 1) / (count + 2)
    half = float(lazy_special.ndtri(0.5 + confidence / 2)) * math.sqrt((up + down - (up - down) ** 2) / (count + 2))
    return Difference((gained - lost) / count, (max(up - down - half, -1.0), min(up - down + half, 1.0)))


def _student(confidence: float) -> float:
    from scipy import stats

    return float(stats.t.ppf(0.5 + confidence / 2, _SECTIONS - 1))
