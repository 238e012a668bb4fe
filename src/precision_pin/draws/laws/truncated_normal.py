"""The normal law, cut off."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from precision_pin.draws import lazy_special
from precision_pin.draws.laws.bases import SymmetricLaw
from precision_pin.draws.laws.law import Array, take_number, take_size
from precision_pin.inputs.arguments import check_number

__all__ = ["TruncatedNormal"]

SMALLEST_K: Final = 1e-3
"""Smallest k of a truncated normal law; its samples are exact to 1e-16/k of its half-width."""


@final
@dataclass(frozen=True)
class TruncatedNormal(SymmetricLaw):
    """Normal of standard deviation ``std`` before truncation, cut off at mean ± k·std."""

    std: float
    mean: float = 0.0
    k: float = 3.0

    def __post_init__(self) -> None:
        take_size(self, "std", "the standard deviation of a truncated normal law")
        take_number(self, "mean", "the mean of a truncated normal law")
        allowed = f"finite and at least {SMALLEST_K} (cut off closer to its mean the law is uniform)"
        k = check_number("k of a truncated normal law", self.k, allowed, lambda value: value >= SMALLEST_K)
        object.__setattr__(self, "k", k)

    @property
    def variance(self) -> float:
        """σ² (1 - 2kφ(k) / (2Φ(k) - 1)), as the ratio of the chi-square laws of 3 and 1 at k² (no cancellation)."""
        square = self.k**2 / 2
        return self.std**2 * float(lazy_special.gammainc(1.5, square) / lazy_special.gammainc(0.5, square))

    @property
    def reach(self) -> float:
        """k·σ."""
        return self.k * self.std

    def sample(self, variates: Array) -> Array:
        """Return the inverse of the cumulative law, from the nearer end (so that it is symmetric)."""
        tail = np.minimum(variates, 1 - variates)
        cut = lazy_special.ndtr(-self.k)
        score = lazy_special.ndtri(cut + tail * math.erf(self.k / math.sqrt(2)))
        deviation: Array = np.copysign(np.minimum(-score, self.k), variates - 0.5)
        return self.mean + self.std * deviation

    def _deviation_characteristic(self, frequency: Array) -> Array:
        s, k = self.std * frequency, self.k
        faddeeva = lazy_special.wofz((1j * k - s) / math.sqrt(2))
        value: Array = np.exp(-(s**2) / 2) - (np.exp(-(k**2) / 2 - 1j * k * s) * faddeeva).real
        return value / math.erf(k / math.sqrt(2))
