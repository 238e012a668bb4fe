"""The truncated normal law."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array
from precision_pin.base.units import Quantity
from precision_pin.draws import lazy_special
from precision_pin.draws.laws.bases import SymmetricLaw
from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.law import take_number, take_size
from precision_pin.draws.laws.projection import SymmetricProjection
from precision_pin.draws.laws.wording import mean_beside
from precision_pin.render.display_units import WrittenUnit

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
        allowed = f"finite and at least {SMALLEST_K} (below, the law is practically uniform)"
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

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        """Return the law in words."""
        (quantity,) = quantities
        unit = WrittenUnit.suiting(quantity, [self.std])
        cut = f"cut off at ±{unit(self.k * self.std)}{mean_beside(self.mean, quantity)}"
        return f"normal, standard deviation {unit(self.std)}, {cut}"

    def kernel_row(self) -> KernelRow:
        """Return mean, standard deviation, k, Φ(-k) and Φ(k) - Φ(-k)."""
        numbers = (self.mean, self.std, self.k, lazy_special.ndtr(-self.k), math.erf(self.k / math.sqrt(2)))
        return KernelRow("truncated", np.array(numbers))

    def projection(self, weights: Array) -> _Projection:
        """Return the projection on weights."""
        return _Projection(abs(float(weights[0])) * self.reach, self.k)

    def _deviation_characteristic(self, frequency: Array) -> Array:
        s, k = self.std * frequency, self.k
        faddeeva = lazy_special.wofz((1j * k - s) / math.sqrt(2))
        value: Array = np.exp(-(s**2) / 2) - (np.exp(-(k**2) / 2 - 1j * k * s) * faddeeva).real
        return value / math.erf(k / math.sqrt(2))


@final
@dataclass(frozen=True)
class _Projection(SymmetricProjection):
    k: float

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(np.linspace(-self.k, self.k, 1 + 2 * math.ceil(self.k / 1.5)).tolist())

    @property
    def kinks(self) -> tuple[float, ...]:
        return tuple((self.reach / self.k * np.array(self.breaks)).tolist())

    @property
    def _inner(self) -> float:
        return math.erf(self.k / math.sqrt(2))

    def cumulative(self, z: Array) -> Array:
        score = self.k * self.scale_to_reach(z)
        value: Array = (1 + lazy_special.erf(score / math.sqrt(2)) / self._inner) / 2
        return value

    def density(self, z: Array) -> Array:
        return self.limit_to_reach(z, self.weight(self.k * self.scale_to_reach(z)) * self.k / self.reach)

    def position(self, s: Array) -> Array:
        return self.reach / self.k * s

    def weight(self, s: Array) -> Array:
        value: Array = np.exp(-(s**2) / 2) / (math.sqrt(2 * math.pi) * self._inner)
        return value

    def parameter(self, z: Array) -> Array:
        return self.k * self.scale_to_reach(z)

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        law = TruncatedNormal(self.reach / self.k, 0.0, self.k)
        return law.characteristic(frequency[None])

    @property
    def characteristic_error(self) -> float:
        return 2e-15 / self._inner

    def envelope(self, frequency: Array) -> Array:
        """Return the bound of the normal law plus that of the removed tails, over P(|z| < k).

        The bound of the tails is the smaller of their probability and their total variation over ω, 4φ(k)/ω. For small k
        the total variation of the whole density over ω is the smaller bound.
        """
        omega = np.maximum(self.reach / self.k * frequency, 1e-300)
        height = math.exp(-(self.k**2) / 2) / math.sqrt(2 * math.pi)
        tails = np.minimum(2 * lazy_special.ndtr(-self.k), 4 * height / omega)
        cut = (np.exp(-(omega**2) / 2) + tails) / self._inner
        whole = 2 / (math.sqrt(2 * math.pi) * self._inner * omega)
        bound: Array = np.minimum(np.minimum(cut, whole), 1.0)
        return bound
