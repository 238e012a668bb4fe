"""Law of a sum of independent parts, as a Fourier series.

The characteristic function of a sum is a product. On a support of length 2L, the density equals its Fourier series
(Poisson's summation; Abate and Whitt, Queueing Systems 10, 1992). With ω_k = kπ/L and φ about the middle c,

    f(c + y) = (1/2L) (1 + 2 Re Σ φ(ω_k) exp(-i ω_k y)),
    F(c + y) = (y + L)/2L + Re Σ (i/kπ) φ(ω_k) (exp(-i ω_k y) - (-1)^k).

For bounded parts the only error is the truncation of the series at K, at most (2/π) Σ_{k>K} |φ(ω_k)|/k, which is evaluated
with monotone bounds of |φ|. Unbounded parts add the probability beyond the chosen ends. A wide lognormal part has distant
ends and a |φ| that decreases slowly; its ends are moved inwards until the series is short enough, at the cost of a larger
error. Rounding is bounded as well: of the characteristic function, of the phases kπy, whose error grows with k as the
coefficients decrease, and of the sums.

A cumulative probability at x is the probability at a number within a few rounding units of x, because x - mean is rounded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.exact_law.number_law import FARTHEST, ROUNDING, NumberLaw
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array

UNIT: Final = 0.5**53
"""Relative rounding error of a double."""

MOST_TERMS: Final = 2**20
_AIMS: Final = (
    (1e-14, 2**15, FARTHEST),
    (1e-12, 2**18, 7.5),
    (1e-10, MOST_TERMS, 6.8),
    (1e-8, MOST_TERMS, 6.2),
    (3e-7, MOST_TERMS, 5.5),
)
"""Target of the truncation error, largest number of terms, and standard deviations at which unbounded parts end."""


@final
@dataclass(frozen=True, eq=False)
class SeriesLaw(NumberLaw):
    """Fourier series of a law on its support.

    Attributes
    ----------
    mean
        Mean of the number.
    middle, half_length
        Support: mean + middle ± half_length.
    coefficients
        φ(ω_k) about the middle, ``(K + 1,)``; the first is 1.
    truncation
        Bound of the truncation error of the cumulative law.
    density_truncation
        Bound of the truncation error of the density; infinite where unknown.
    beyond
        Probability beyond the support.
    rounding
        Bound of the rounding of the cumulative law.
    """

    mean: float
    middle: float
    half_length: float
    coefficients: NDArray[np.complex128]
    truncation: float
    density_truncation: float
    beyond: float = 0.0
    rounding: float = ROUNDING

    def __post_init__(self) -> None:
        fix_fields(self)

    @property
    def low(self) -> float:  # type: ignore[override]
        """Lower end of the support."""
        return self.mean + self.middle - self.half_length

    @property
    def high(self) -> float:  # type: ignore[override]
        """Upper end of the support."""
        return self.mean + self.middle + self.half_length

    @property
    def terms(self) -> int:
        """Number of terms, K."""
        return self.coefficients.size - 1

    @property
    def method(self) -> str:
        """Inversion of the characteristic function, with the number of terms."""
        return f"inversion of the characteristic function, {self.terms} terms"

    @property
    def error(self) -> float:
        """Truncation error, probability beyond the support, and rounding."""
        return self.truncation + self.beyond + self.rounding

    def cumulative(self, x: Array) -> Array:
        """Return P(number ≤ x), the series of F."""
        y = (x - self.mean - self.middle) / self.half_length
        inner = np.clip(y, -1.0, 1.0)
        value: Array = (inner + 1) / 2 + _sum(self._slopes, inner) - self._start
        return np.where(y <= -1, 0.0, np.where(y >= 1, 1.0, np.clip(value, 0.0, 1.0)))

    def density(self, x: Array) -> Array:
        """Return the density, the series of f."""
        y = (x - self.mean - self.middle) / self.half_length
        value = _sum(self._heights, np.clip(y, -1.0, 1.0)) / self.half_length
        return np.where(np.abs(y) < 1, np.maximum(value, 0.0), 0.0)

    @cached_property
    def _slopes(self) -> NDArray[np.complex128]:
        k = np.arange(1, self.terms + 1)
        return _arrange(np.concatenate([[0.0], 1j * self.coefficients[1:] / (np.pi * k)]))

    @cached_property
    def _heights(self) -> NDArray[np.complex128]:
        return _arrange(np.concatenate([[0.5], self.coefficients[1:]]))

    @cached_property
    def _start(self) -> float:
        return float(_sum(self._slopes, np.array([-1.0]))[0])


def _arrange(coefficients: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the coefficients as a table ``(columns, rows)``, k = columns · row + column, padded with zeros."""
    columns = _columns(coefficients.size)
    padded = np.zeros(-(-coefficients.size // columns) * columns, dtype=complex)
    padded[: coefficients.size] = coefficients
    return np.ascontiguousarray(padded.reshape(-1, columns).T)


def _columns(size: int) -> int:
    return 1 << max(0, math.ceil(math.log2(size) / 2))


def _sum(table: NDArray[np.complex128], y: Array) -> Array:
    """Return Re Σ c_k exp(-i k π y), with the powers of exp(-iπy) in two steps to save exponentials."""
    columns, rows = table.shape
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
    """Bounds of |φ|, and of the truncation error at K terms."""

    envelopes: Sequence[Callable[[Array], Array]]
    std: float
    half_length: float

    @cached_property
    def _octaves(self) -> Array:
        powers: Array = np.exp2(np.arange(160, dtype=float))
        return powers

    def bound(self, omega: Array) -> Array:
        """Return a bound of |φ|."""
        with np.errstate(under="ignore", over="ignore"):
            result = np.exp(-((self.std * omega) ** 2) / 2)
            for envelope in self.envelopes:
                result = result * envelope(omega)
        return result

    def truncations(self, terms: int) -> tuple[float, float]:
        """Return the bounds of the truncation errors of F and f, summed over octaves (2^j K, 2^(j+1) K]."""
        omega = terms * np.pi / self.half_length * self._octaves
        with np.errstate(under="ignore", over="ignore"):
            bound = self.bound(omega)
            densities = bound * self._octaves * terms / self.half_length
        return 2 / math.pi * math.log(2) * _sum_converging(bound), _sum_converging(densities)


def _sum_converging(terms: Array) -> float:
    """Return the sum, infinite where the last terms are not negligible."""
    total = float(terms.sum())
    return total * (1 + 1e-9) if terms[-1] <= 1e-15 * total or total < 1e-250 else math.inf


@final
@dataclass(frozen=True, eq=False)
class Summand:
    """Independent part of a sum, in the form that the series needs.

    Attributes
    ----------
    ends
        Function of a number of standard deviations that returns ends with at most the probability beyond that a normal law
        has there.
    is_bounded
        True if the probability beyond the ends is zero.
    envelope
        Function of ω ``(n,)`` that returns a monotone bound of |φ|.
    characteristic
        Function of ω ``(n,)`` that returns φ of the deviation from the mean.
    characteristic_error
        Bound of the error of φ, except the rounding of ω.
    """

    ends: Callable[[float], tuple[float, float]]
    is_bounded: bool
    envelope: Callable[[Array], Array]
    characteristic: Callable[[Array], NDArray[np.complex128]]
    characteristic_error: float = 1e-15

    def __post_init__(self) -> None:
        fix_fields(self)


def certified_series(mean: float, std: float, summands: Sequence[Summand], largest_error: float) -> SeriesLaw | float:
    """Return the series of a law with the terms that its certified error needs, otherwise the smallest error reached.

    Parameters
    ----------
    mean
        Mean of the number.
    std
        Standard deviation of its normal parts together.
    summands
        The other parts.
    largest_error
        Largest error for which the law is computed.
    """
    for aim, most, score in _AIMS:
        ends = [summand.ends(min(score, FARTHEST)) for summand in summands]
        low, high = (sum(end[side] for end in ends) + sign * score * std for side, sign in ((0, -1), (1, 1)))
        half_length = (high - low) / 2
        bounds = _Bounds([summand.envelope for summand in summands], std, half_length)
        terms = 64
        while bounds.truncations(terms)[0] > aim and terms < most:
            terms *= 2
        if bounds.truncations(terms)[0] <= aim:
            break
    truncation, density_truncation = bounds.truncations(terms)
    unbounded = sum(not summand.is_bounded for summand in summands) + (std > 0)
    beyond = float(2 * special.ndtr(-score)) * unbounded
    if truncation + beyond > largest_error:
        return truncation + beyond
    middle = (low + high) / 2
    omega = np.arange(terms + 1, dtype=float) * (np.pi / half_length)
    coefficients = np.exp(-((std * omega) ** 2) / 2 - 1j * omega * middle)
    for summand in summands:
        coefficients *= summand.characteristic(omega)
    rounding = _rounding(bounds.bound(omega[1:]), summands)
    return SeriesLaw(mean, middle, half_length, coefficients, truncation, density_truncation, beyond, rounding)


def _rounding(bounds: Array, summands: Sequence[Summand]) -> float:
    """Return the bound of the rounding of a cumulative law with these bounds of |φ(ω_k)|, k from 1 on.

    The relative error of a phase kπ is a few rounding units, which changes a term φ/kπ by as many units of φ. The
    characteristic functions of the parts add their own errors, and the sums one unit for each term of an inner row.
    """
    k = np.arange(1, bounds.size + 1)
    terms = float((bounds / (np.pi * k)).sum())
    phases = 4.0 * (2 + len(summands))
    functions = sum(summand.characteristic_error for summand in summands)
    sums = _columns(bounds.size + 1) + 16.0
    return (
        UNIT * (8 + 2 * sums * terms + phases * float(bounds.sum())) + functions * (1 + math.log(bounds.size)) / np.pi
    )
