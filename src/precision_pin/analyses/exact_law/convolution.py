"""Law of a sum of two independent parts: their convolution, by quadrature."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from scipy import special

from precision_pin.analyses.exact_law.number_law import NumberLaw
from precision_pin.base.arrays import Array
from precision_pin.draws.laws.projection import Lines, Projection

MOST_PIECES: Final = 2000
"""Largest number of pieces of the integral; a sum with more pieces is computed as a series."""


@final
@dataclass(frozen=True, eq=False)
class ConvolvedLaw(NumberLaw):
    """Law of two parts, ``F(x) = ∫ F₁(x - z(s)) w(s) ds`` along the parameter of the second.

    The integral is split at every kink of either part. Each piece is computed by the double exponential rule (Takahasi and
    Mori, 1974), which converges in spite of singularities at the ends.
    """

    mean: float
    kept: Projection
    integrated: Projection

    @classmethod
    def of(cls, mean: float, one: Projection, other: Projection) -> ConvolvedLaw:
        """Return the law of two parts; the integral runs along the part with the rougher density."""
        kept, integrated = (one, other) if _roughness(one) <= _roughness(other) else (other, one)
        return cls(mean, kept, integrated)

    @property
    def pieces(self) -> int:
        """Number of pieces of the integral."""
        return len(self.kept.kinks) + len(self.integrated.breaks) - 1

    @property
    def low(self) -> float:  # type: ignore[override]
        """Sum of the lower ends."""
        return self.mean + self.kept.ends[0] + self.integrated.ends[0]

    @property
    def high(self) -> float:  # type: ignore[override]
        """Sum of the upper ends."""
        return self.mean + self.kept.ends[1] + self.integrated.ends[1]

    @property
    def method(self) -> str:
        """Convolution."""
        return "convolution of two draws"

    @property
    def error(self) -> float:
        """Error of the double exponential rule, measured on sums with a closed form."""
        return 1e-11

    def cumulative(self, x: Array) -> Array:
        """Return P(number ≤ x), the integral of F₁."""
        value = self._integral(self.kept.cumulative, x)
        inside = (x >= self.low) & (x < self.high)
        return np.where(inside, np.clip(value, 0, 1), np.where(x >= self.high, 1.0, 0.0))

    def density(self, x: Array) -> Array:
        """Return the density, the integral of f₁."""
        return self._integral(self.kept.density, x)

    def _integral(self, function: Callable[[Array], Array], x: Array) -> Array:
        shares, weights = _double_exponential()
        step = max(1, 2_000_000 // (self.pieces * shares.size))
        parts = [np.zeros(0)]
        for first in range(0, x.size, step):
            z = x[first : first + step] - self.mean
            breaks = np.array(self.integrated.breaks)
            cuts = self.integrated.parameter(z[:, None] - np.array(self.kept.kinks))
            edges = np.sort(np.concatenate([cuts, np.broadcast_to(breaks, (z.size, breaks.size))], axis=1), axis=1)
            lengths = np.diff(edges, axis=1)[:, :, None]
            s = edges[:, :-1, None] + lengths * shares
            values = function(z[:, None, None] - self.integrated.position(s)) * self.integrated.weight(s)
            parts.append((values * (lengths * weights)).sum(axis=(1, 2)))
        return np.concatenate(parts)


def _roughness(part: Projection) -> int:
    """Return 2 for lines, 1 for an unbounded density (|φ| decreases slower than 1/ω), 0 otherwise."""
    if isinstance(part, Lines):
        return 2
    far = np.array([2.0**60, 2.0**62]) / max(abs(end) for end in part.ends)
    first, second = part.envelope(far)
    return int(second > 0.3 * first)


def _double_exponential() -> tuple[Array, Array]:
    """Return nodes in (0, 1) and weights of the double exponential rule."""
    t = np.arange(-52, 53) / 16
    inner = math.pi / 2 * np.sinh(t)
    shares = special.expit(2 * inner)
    weights = math.pi / 2 * np.cosh(t) / (2 * np.cosh(inner) ** 2) / 16
    return shares, weights / weights.sum()
