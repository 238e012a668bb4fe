"""The law of one number that is a sum of independent parts: in closed form, by convolution, or as a Fourier series.

Of many parts the characteristic function is a product. On a support of length 2L, the density is its own Fourier series
(Poisson's summation; Abate and Whitt, Queueing Systems 10, 1992): with ω_k = kπ/L and φ about the middle c,

    f(c + y) = (1/2L) (1 + 2 Re Σ φ(ω_k) exp(-i ω_k y)),
    F(c + y) = (y + L)/2L + Re Σ (i/kπ) φ(ω_k) (exp(-i ω_k y) - (-1)^k).

Bounded parts leave no other error than cutting the series at K, at most (2/π) Σ_{k>K} |φ(ω_k)|/k, which bounds of |φ|
that never rise turn into a number. Unbounded parts add what lies beyond the ends chosen, below 1e-17 each.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from precision_pin.analyses.parts import Lines, Part

__all__ = ["ConvolvedLaw", "NormalLaw", "NumberLaw", "SeriesLaw", "SingleLaw", "certified_series"]

Array = NDArray[np.float64]

ROUNDING: Final = 1e-14
"""Bound of the rounding of a cumulative law, in every method."""

FARTHEST: Final = 9.0
"""Standard deviations beyond which a normal number is left out: probability 2.3e-19."""

MOST_TERMS: Final = 2**21
MOST_PIECES: Final = 2000
_AIMS: Final = ((1e-14, 2**15), (1e-12, 2**18), (1e-10, MOST_TERMS))
"""Error to reach, and terms that it may take; the last is taken at any error."""


class NumberLaw(ABC):
    """The law of one number.

    Attributes
    ----------
    mean
        Its mean.
    low, high
        What lies outside has a probability below 1e-16.
    method
        How it is computed, in words.
    error
        Bound of the error of :meth:`cumulative`.
    """

    mean: float
    low: float
    high: float

    @property
    @abstractmethod
    def method(self) -> str:
        """How it is computed, in words."""

    @property
    @abstractmethod
    def error(self) -> float:
        """Bound of the error of :meth:`cumulative`."""

    @abstractmethod
    def cumulative(self, x: Array) -> Array:
        """Return P(number ≤ x), ``(N,)``."""

    @abstractmethod
    def density(self, x: Array) -> Array:
        """Return the density ``(N,)``, not-a-number where there is none."""

    @final
    def quantile(self, p: float) -> float:
        """Return the smallest value with at least this probability at or below it (0 < p < 1), by Brent's method."""

        def excess(x: float) -> float:
            return float(self.cumulative(np.array([x]))[0]) - p

        if excess(self.low) >= 0:
            return self.low
        if excess(self.high) <= 0:
            return self.high
        root: float = optimize.brentq(excess, self.low, self.high, xtol=1e-16 * (self.high - self.low), rtol=1e-15)
        return root

    @final
    def quantile_error(self, p: float) -> float:
        """Return the bound of :meth:`quantile`'s error to first order: that of the cumulative law over the density."""
        density = float(self.density(np.array([self.quantile(p)]))[0])
        return self.error / density if density > 0 else math.inf


@final
@dataclass(frozen=True)
class NormalLaw(NumberLaw):
    """A normal number."""

    mean: float
    std: float

    @property
    def low(self) -> float:  # type: ignore[override]
        """Nine standard deviations down."""
        return self.mean - FARTHEST * self.std

    @property
    def high(self) -> float:  # type: ignore[override]
        """Nine standard deviations up."""
        return self.mean + FARTHEST * self.std

    @property
    def method(self) -> str:
        """Closed form."""
        return "normal law"

    @property
    def error(self) -> float:
        """Rounding."""
        return ROUNDING

    def cumulative(self, x: Array) -> Array:
        """Return Φ((x - mean)/σ)."""
        value: Array = special.ndtr((x - self.mean) / self.std)
        return value

    def density(self, x: Array) -> Array:
        """Return φ((x - mean)/σ)/σ."""
        value: Array = np.exp(-(((x - self.mean) / self.std) ** 2) / 2) / (math.sqrt(2 * math.pi) * self.std)
        return value


@final
@dataclass(frozen=True, eq=False)
class SingleLaw(NumberLaw):
    """One part alone."""

    mean: float
    part: Part

    @property
    def low(self) -> float:  # type: ignore[override]
        """The part's lower end."""
        return self.mean + self.part.ends[0]

    @property
    def high(self) -> float:  # type: ignore[override]
        """The part's upper end."""
        return self.mean + self.part.ends[1]

    @property
    def method(self) -> str:
        """Closed form."""
        return "closed form of one draw"

    @property
    def error(self) -> float:
        """Rounding."""
        return ROUNDING

    def cumulative(self, x: Array) -> Array:
        """Return the part's."""
        return self.part.cumulative(x - self.mean)

    def density(self, x: Array) -> Array:
        """Return the part's."""
        return self.part.density(x - self.mean)


@final
@dataclass(frozen=True, eq=False)
class ConvolvedLaw(NumberLaw):
    """Two parts: ``F(x) = ∫ F₁(x - z(s)) w(s) ds`` along the second's parameter.

    The integral is cut at every kink of either, and each piece taken by the double exponential rule (Takahasi and Mori,
    1974), which minds no singularity at an end.
    """

    mean: float
    kept: Part
    integrated: Part

    @classmethod
    def of(cls, mean: float, one: Part, other: Part) -> ConvolvedLaw:
        """Return the law; the part whose density is the rougher is integrated along."""
        kept, integrated = (one, other) if _roughness(one) <= _roughness(other) else (other, one)
        return cls(mean, kept, integrated)

    @property
    def pieces(self) -> int:
        """Into how many the integral is cut."""
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
        """Of the double exponential rule, found on sums with a closed form."""
        return 1e-11

    def cumulative(self, x: Array) -> Array:
        """Return the integral of F₁."""
        value = self._integral(self.kept.cumulative, x)
        inside = (x >= self.low) & (x < self.high)
        return np.where(inside, np.clip(value, 0, 1), np.where(x >= self.high, 1.0, 0.0))

    def density(self, x: Array) -> Array:
        """Return the integral of f₁."""
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


def _roughness(part: Part) -> int:
    """Return 2 for lines, 1 for a density without bound (|φ| falls slower than 1/ω), 0 otherwise."""
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


@final
@dataclass(frozen=True, eq=False)
class SeriesLaw(NumberLaw):
    """A Fourier series on the support.

    Attributes
    ----------
    mean
        The number's mean.
    middle, half_length
        The support: mean + middle ± half_length.
    coefficients
        φ(ω_k) about the middle, ``(K + 1,)``; the first is 1.
    truncation
        Bound of what the cut changes in the cumulative law.
    density_truncation
        As much of the density; infinite where the bounds do not tell.
    """

    mean: float
    middle: float
    half_length: float
    coefficients: NDArray[np.complex128]
    truncation: float
    density_truncation: float

    @property
    def low(self) -> float:  # type: ignore[override]
        """The support's lower end."""
        return self.mean + self.middle - self.half_length

    @property
    def high(self) -> float:  # type: ignore[override]
        """The support's upper end."""
        return self.mean + self.middle + self.half_length

    @property
    def terms(self) -> int:
        """K."""
        return self.coefficients.size - 1

    @property
    def method(self) -> str:
        """Inversion, with the number of terms."""
        return f"inversion of the characteristic function, {self.terms} terms"

    @property
    def error(self) -> float:
        """Truncation and rounding."""
        return self.truncation + ROUNDING

    def cumulative(self, x: Array) -> Array:
        """Return the series of F."""
        k = np.arange(1, self.terms + 1)
        slopes = np.concatenate([[0.0], 1j * self.coefficients[1:] / (np.pi * k)])
        y = (x - self.mean - self.middle) / self.half_length
        inner = np.clip(y, -1.0, 1.0)
        value: Array = (inner + 1) / 2 + self._sum(slopes, inner) - self._sum(slopes, np.array([-1.0]))
        return np.where(y <= -1, 0.0, np.where(y >= 1, 1.0, np.clip(value, 0.0, 1.0)))

    def density(self, x: Array) -> Array:
        """Return the series of f."""
        y = (x - self.mean - self.middle) / self.half_length
        coefficients = np.concatenate([[0.5], self.coefficients[1:]])
        value = self._sum(coefficients, np.clip(y, -1.0, 1.0)) / self.half_length
        return np.where(np.abs(y) < 1, np.maximum(value, 0.0), 0.0)

    def _sum(self, coefficients: NDArray[np.complex128], y: Array) -> Array:
        """Return Re Σ c_k exp(-i k π y): powers of exp(-iπy) in two steps, so that few exponentials are needed."""
        columns = 1 << max(0, math.ceil(math.log2(coefficients.size) / 2))
        rows = -(-coefficients.size // columns)
        padded = np.zeros(rows * columns, dtype=complex)
        padded[: coefficients.size] = coefficients
        table = padded.reshape(rows, columns).T
        step = max(1, 2_000_000 // (rows + columns))
        parts = [np.zeros(0)]
        for first in range(0, y.size, step):
            turn = -1j * np.pi * y[first : first + step, None]
            fine = np.exp(turn * np.arange(columns))
            coarse = np.exp(turn * (columns * np.arange(rows)))
            parts.append(((fine @ table) * coarse).sum(axis=1).real)
        return np.concatenate(parts)


@final
@dataclass(frozen=True, eq=False)
class _Bounds:
    """Bounds of |φ|, and what they say about a cut at K."""

    envelopes: Sequence[Callable[[Array], Array]]
    std: float
    half_length: float

    @cached_property
    def _octaves(self) -> Array:
        powers: Array = np.exp2(np.arange(160, dtype=float))
        return powers

    def truncations(self, terms: int) -> tuple[float, float]:
        """Return the bounds of the errors of F and f; the sums over octaves (2^j K, 2^(j+1) K]."""
        omega = terms * np.pi / self.half_length * self._octaves
        with np.errstate(under="ignore", over="ignore"):
            bound = np.exp(-((self.std * omega) ** 2) / 2)
            for envelope in self.envelopes:
                bound = bound * envelope(omega)
            densities = bound * self._octaves * terms / self.half_length
        return 2 / math.pi * math.log(2) * _converged(bound), _converged(densities)


def _converged(terms: Array) -> float:
    """Return the sum, infinite where the terms have not died out: it would grow with more of them."""
    total = float(terms.sum())
    return total * (1 + 1e-9) if terms[-1] <= 1e-15 * total or total < 1e-250 else math.inf


def certified_series(
    mean: float,
    ends: tuple[float, float],
    std: float,
    envelopes: Sequence[Callable[[Array], Array]],
    characteristic: Callable[[Array], NDArray[np.complex128]],
) -> SeriesLaw:
    """Return the series of a law with as many terms as its certified error needs.

    Parameters
    ----------
    mean
        Of the number.
    ends
        Between which its deviation from the mean lies, normal parts left out.
    std
        Of its normal parts together.
    envelopes
        Bounds of |φ| of its other parts, for ω ``(n,)``.
    characteristic
        φ of the deviation from the mean, normal parts included, for ω ``(n,)``.
    """
    low, high = ends[0] - FARTHEST * std, ends[1] + FARTHEST * std
    middle, half_length = (low + high) / 2, (high - low) / 2
    bounds = _Bounds(envelopes, std, half_length)
    for aim, most in _AIMS:
        terms = 64
        while bounds.truncations(terms)[0] > aim and terms < most:
            terms *= 2
        if bounds.truncations(terms)[0] <= aim:
            break
    omega = np.arange(terms + 1, dtype=float) * (np.pi / half_length)
    coefficients = characteristic(omega) * np.exp(-1j * omega * middle)
    truncation, density_truncation = bounds.truncations(terms)
    return SeriesLaw(mean, middle, half_length, coefficients, truncation, density_truncation)
