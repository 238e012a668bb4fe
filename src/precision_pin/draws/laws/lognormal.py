"""The lognormal law.

Sums with other components need its characteristic function, and a bound of it, at very many frequencies. With x = exp(σz
- σ²/2) of mean 1 and z normal, E exp(i t (x - 1)) is an integral over z (:meth:`Lognormal.characteristic`). It is smooth
in ln t, hence interpolated octave by octave at Chebyshev points, so that a million frequencies take little more than a
thousand integrals.

Bound: on the line at height η the integrand is at most exp((η² - z²)/2 - t exp(-σ²/2) sin(ση) exp(σz)), so that |E
exp(i t x)| ≤ exp(η²/2) L(t sin ση) with L the Laplace transform of x, for every η from 0 to π/σ. Each of these bounds
decreases with t, and so does their minimum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import Quantity
from precision_pin.draws import lazy_special
from precision_pin.draws.laws.law import (
    DEVIATIONS,
    KernelRow,
    Law,
    LawOption,
    SheetForm,
    SheetReader,
    take_size,
    write_number,
)
from precision_pin.draws.laws.projection import FARTHEST_NORMAL, Projection, power_bound

WIDEST_LOGNORMAL: Final = 1e3
"""Largest standard deviation of a lognormal law, in means; the median is then 1/1000 of the mean."""

_STEP: Final = 1 / 40
"""Step of the trapezoidal rule, in standard deviations."""

_NODES: Final = _STEP * np.arange(-360, 361)
"""Nodes for the characteristic function, in standard deviations from the saddle point."""

LOGNORMAL_ERROR: Final = 3e-14
"""Bound of the error of :func:`lognormal_characteristic`."""

_BATCH: Final = 1000
"""Frequencies integrated at once, which bounds the memory."""

_MOST_INTEGRALS: Final = 2000
"""Most frequencies that each get their own integral; more are interpolated."""

_DEGREES: Final = (24, 48, 96)
"""Degrees of the Chebyshev series, tried in turn."""

_SERIES_TOLERANCE: Final = 2e-14
"""Sum of the last four coefficients at which a series has converged."""

_SMALL_SIGMA: Final = 0.3
"""Up to this σ the phase varies least relative to the mean, above it relative to zero."""

_PER_OCTAVE: Final = 4
_OCTAVES: Final = (-30, 170)
"""Table of bounds: its entries per octave, and the exponents of 2 of its end frequencies.

Two per octave give up to 1.6 times the bound of four at σ = 0.5, sixteen 0.4 to 0.9 times, for several times the work.
"""

_HEIGHTS: Final = np.linspace(0.1, 9.0, 60)
_SCORES: Final = np.arange(-38.0, 9.01, 0.2)
_MARGIN: Final = 1.0 + 1e-6
"""Lines η tried for the bound; nodes of the Laplace transform, and a factor that covers its quadrature error.

exp(-z²/2) is below 1e-308 beyond -38, and below rounding beyond 9; lines above 9 multiply by more than 1e17.
"""


@dataclass(frozen=True)
class Lognormal(Law):
    """The exponential of a normal number, for positive values that vary by a factor, such as a stiffness.

    For mean m and standard deviation s, the logarithm has the variance σ² = ln(1 + s²/m²) and the mean ln m - σ²/2
    (JCGM 101:2008, table 1, and C.3 of Johnson, Kotz and Balakrishnan, chapter 14).

    Attributes:
        std: Standard deviation of the number itself.
        mean: Its mean, above zero.

    Examples:
        >>> law = pp.Lognormal(std=2.0, mean=10.0)
        >>> print(law.mean_vector, law.covariance)
        [10.] [[4.]]
    """

    variates: ClassVar[Literal["uniform", "normal"]] = "normal"
    form: ClassVar = SheetForm(
        "lognormal",
        {"lognormal": {"std": "0.1 mm"}, "mean": "1 mm"},
        "never negative; `std` and `mean` are those of the number itself, not of its logarithm; `mean` is needed",
        (LawOption("mean", "lognormal: needed", "1 mm"),),
        DEVIATIONS,
    )
    std: float
    mean: float

    def __post_init__(self) -> None:
        take_size(self, "std", "the standard deviation of a lognormal law")
        take_size(self, "mean", "the mean of a lognormal law", zero=False)
        if not self.std <= WIDEST_LOGNORMAL * self.mean:
            raise InputError(
                f"the standard deviation of a lognormal law is at most {WIDEST_LOGNORMAL:g} times its mean, "
                f"got {self.std!r} and {self.mean!r}"
            )

    @classmethod
    def from_sheet(cls, reader: SheetReader) -> Lognormal:
        value = reader.settings["lognormal"]
        if not isinstance(value, Mapping) or set(value) != {"std"}:
            raise reader.error(
                ("lognormal",),
                "lognormal takes the standard deviation of the number itself: lognormal: {std: 0.1 mm}, mean: 1 mm",
            )
        if "mean" not in reader.settings:
            raise reader.error(("lognormal",), "lognormal needs a mean: of the number itself, above zero")
        std, mean = reader.half_width("lognormal", "std"), reader.mean()
        if not mean > 0:
            raise reader.error(
                ("mean",), f"the mean of a lognormal law must be above zero, got {reader.settings['mean']}"
            )
        return cls(std, mean)

    @property
    def log_std(self) -> float:
        """σ, the standard deviation of the logarithm."""
        return math.sqrt(math.log1p((self.std / self.mean) ** 2))

    @property
    def mean_vector(self) -> Array:
        return np.array([self.mean])

    @property
    def covariance(self) -> Array:
        return np.array([[self.std**2]])

    def sample(self, variates: Array) -> Array:
        """Return m exp(σ z - σ²/2)."""
        return self.mean * np.exp(self.log_std * variates - self.log_std**2 / 2)

    def support(self, direction: ArrayLike) -> float:
        """Return infinity for w above zero, 0 below; w·m if the component does not vary."""
        w = float(np.asarray(direction, dtype=float)[0])
        return (math.inf if w > 0 else 0.0) if self.std else w * self.mean

    def cumulants(self) -> Array:
        """Return the cumulants from the moments, by the recursion over powers of exp(σ²)."""
        if self.log_std < 0.05:
            # differences of the moments are rounding error here, and the law is almost normal
            return np.array([[self.std**2], [0.0], [0.0], [0.0]])
        w = math.exp(self.log_std**2)
        # in units of the mean; terms of high order in w - 1 are those of a heavy tail (Johnson and Kotz, ch. 14)
        raw = [w ** (r * (r - 1) / 2) for r in range(7)]
        central = [sum(math.comb(r, k) * (-1) ** (r - k) * raw[k] for k in range(r + 1)) for r in range(7)]
        m2, m3, m4, m6 = (central[r] * self.mean**r for r in (2, 3, 4, 6))
        return np.array([[m2], [m3], [m4 - 3 * m2**2], [m6 - 15 * m4 * m2 - 10 * m3**2 + 30 * m2**3]])

    def covariance_with(self, other: Law, correlation: float) -> float | None:
        """Return m₁ m₂ (exp(ρ σ₁ σ₂) - 1) of two lognormal numbers."""
        if not isinstance(other, Lognormal):
            return None
        return self.mean * other.mean * math.expm1(correlation * self.log_std * other.log_std)

    def covariance_by_scores(self, correlation: float, nodes: Callable[[float], tuple[Array, Array]]) -> float:
        """Return the integral of its mean at a score z of the other component, m exp(τz - τ²/2) with τ = ρσ."""
        # the factor exp(τz - τ²/2) shifts the density of z by τ
        shift = correlation * self.log_std
        z, weighted = nodes(abs(shift))
        return self.mean * float((weighted * np.expm1(shift * z - shift**2 / 2)).sum())

    def describe(self, quantities: Sequence[Quantity | None]) -> str:
        (quantity,) = quantities
        return f"lognormal, mean {write_number(self.mean, quantity)}, standard deviation {write_number(self.std, quantity)}"

    def kernel_row(self) -> KernelRow:
        return KernelRow("lognormal", np.array([self.mean, self.log_std, self.log_std**2 / 2]))

    def projection(self, weights: Array) -> _Projection:
        return _Projection(float(weights[0]), self.mean, self.log_std)

    def characteristic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(i t x), t ``(1, …)``, within 1e-12.

        The integral over the normal number z runs along a line parallel to the real axis: at the height of the
        integrand's saddle point, -W(-i t m σ² exp(-σ²/2))/σ with Lambert's W, or higher, so that the integrand neither
        cancels nor oscillates where it is large. On this line the trapezoidal rule converges faster than any power of
        its step (Trefethen and Weideman, SIAM Review 56, 2014).
        """
        t = np.asarray(frequency, dtype=float)[0] * self.mean
        if not self.log_std:
            return np.exp(1j * t)
        value = _integrate(np.abs(t).ravel(), self.log_std).reshape(t.shape)
        return np.exp(1j * t) * np.where(t < 0, value.conj(), value)


@dataclass(frozen=True)
class _Projection(Projection):
    """Projection of a lognormal number, the weight times (x - mean)."""

    weight_of_number: float
    mean: float
    log_std: float

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest and largest value that can be drawn."""
        return self.within(FARTHEST_NORMAL)

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, 13).tolist())

    @property
    def kinks(self) -> tuple[float, ...]:
        return tuple(self.position(np.array(self.breaks)).tolist())

    def _score(self, z: Array) -> Array:
        number = np.maximum((z / self.weight_of_number + self.mean) / self.mean, 1e-300)
        return (np.log(number) + self.log_std**2 / 2) / self.log_std

    def cumulative(self, z: Array) -> Array:
        return lazy_special.ndtr(math.copysign(1.0, self.weight_of_number) * self._score(z))

    def density(self, z: Array) -> Array:
        number = z / self.weight_of_number + self.mean
        slope = self.log_std * np.maximum(number, 1e-300) * abs(self.weight_of_number)
        return np.where(number > 0, _normal_density(self._score(z)) / slope, 0.0)

    def position(self, s: Array) -> Array:
        signed = math.copysign(1.0, self.weight_of_number) * s
        return self.weight_of_number * self.mean * np.expm1(self.log_std * signed - self.log_std**2 / 2)

    def weight(self, s: Array) -> Array:
        return _normal_density(s)

    def parameter(self, z: Array) -> Array:
        signed = math.copysign(1.0, self.weight_of_number) * self._score(z)
        return np.clip(signed, -FARTHEST_NORMAL, FARTHEST_NORMAL)

    @property
    def is_bounded(self) -> bool:
        return False

    def within(self, score: float) -> tuple[float, float]:
        low, high = self.position(np.array([-score, score])).tolist()
        return low, high

    def characteristic(self, frequency: Array) -> NDArray[np.complex128]:
        return lognormal_characteristic(self.weight_of_number * self.mean * frequency, self.log_std)

    @property
    def characteristic_error(self) -> float:
        return LOGNORMAL_ERROR

    def envelope(self, frequency: Array) -> Array:
        """Return the minimum of 1, V/ω and a table; V is the total variation of the density, twice its maximum."""
        scale = abs(self.weight_of_number) * self.mean
        height = scale * math.exp(-(self.log_std**2)) * self.log_std
        return np.minimum(
            power_bound(2 / math.sqrt(2 * math.pi), 1.0, height * frequency),
            lognormal_envelope(scale * frequency, self.log_std),
        )


def lognormal_characteristic(frequency: Array, log_std: float) -> NDArray[np.complex128]:
    """Return E exp(i t (x - 1)) for x lognormal with mean 1, t ``(N,)``; ``log_std`` is σ of ln x."""
    t = np.abs(frequency)
    value = _integrate(t, log_std) if t.size <= _MOST_INTEGRALS else _interpolate(t, log_std)
    return np.where(frequency < 0, value.conj(), value)


def _integrate(t: Array, sigma: float) -> NDArray[np.complex128]:
    result = np.zeros(t.size, dtype=complex)
    for first in range(0, t.size, _BATCH):
        batch = t[first : first + _BATCH]
        # nodes (N, 721) on a line through or above the saddle point at each frequency
        scaled = batch * math.exp(-(sigma**2) / 2)
        saddle = -lazy_special.lambertw(-1j * scaled * sigma**2) / sigma
        height = np.maximum(saddle.imag, min(1.0, math.pi / (2 * sigma)))
        centre = -lazy_special.lambertw(scaled * sigma**2 * np.sin(sigma * height)).real / sigma
        z = (centre + 1j * height)[:, None] + _NODES
        integrand = np.exp(1j * batch[:, None] * np.expm1(sigma * z - sigma**2 / 2) - z**2 / 2)
        result[first : first + _BATCH] = integrand.sum(axis=1) * (_STEP / math.sqrt(2 * math.pi))
    return result


def _interpolate(t: Array, sigma: float) -> NDArray[np.complex128]:
    phase_rate = 0.0 if sigma <= _SMALL_SIGMA else 1.0
    result = np.ones(t.size, dtype=complex)
    exponents = np.frexp(t)[1]
    for exponent in np.unique(exponents[t > 0]):
        in_octave = (exponents == exponent) & (t > 0)
        batch = t[in_octave]
        high = 2.0 ** int(exponent)
        values = _octave(batch, high, sigma, phase_rate)
        result[in_octave] = _integrate(batch, sigma) if values is None else values * np.exp(-1j * phase_rate * batch)
    return result


def _octave(t: Array, high: float, sigma: float, phase_rate: float) -> NDArray[np.complex128] | None:
    """Return the function times exp(i phase_rate t), interpolated from high/2 to high; None if integrals are fewer."""
    for degree in _DEGREES:
        if t.size <= degree + 1:
            return None
        nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        frequencies = high * (3 + nodes) / 4
        values = _integrate(frequencies, sigma) * np.exp(1j * phase_rate * frequencies)
        cosines = np.cos(np.pi * np.outer(np.arange(degree + 1), np.arange(degree + 1) + 0.5) / (degree + 1))
        coefficients = cosines @ values * (2 / (degree + 1))
        coefficients[0] /= 2
        if np.abs(coefficients[-4:]).sum() <= _SERIES_TOLERANCE:
            return np.polynomial.chebyshev.chebval(4 * t / high - 3, coefficients)
    return None


def lognormal_envelope(frequency: Array, log_std: float) -> Array:
    """Return a non-increasing bound of |E exp(i t x)| for x lognormal with mean 1, t ``(N,)`` not negative."""
    table = _table(log_std)
    # the value at the nearest lower frequency of the table, an upper bound since it falls
    octaves = np.log2(np.maximum(frequency, 2.0 ** _OCTAVES[0]))
    index = np.floor((octaves - _OCTAVES[0]) * _PER_OCTAVE - 1e-9).astype(int)
    bound: Array = table[np.clip(index, 0, table.size - 1)]
    return np.where(index < 0, 1.0, bound)


@lru_cache(maxsize=64)
def _table(sigma: float) -> Array:
    exponents = np.arange(_OCTAVES[0] * _PER_OCTAVE, _OCTAVES[1] * _PER_OCTAVE + 1) / _PER_OCTAVE
    t = np.exp2(exponents)
    heights = _HEIGHTS[sigma * _HEIGHTS < math.pi]
    sines = np.sin(sigma * heights)
    # the Laplace transform at the nearest lower s of its table, an upper bound since it falls
    low = (_OCTAVES[0] - 20) * _PER_OCTAVE
    laplace_exponents = np.arange(low, exponents[-1] * _PER_OCTAVE + 1) / _PER_OCTAVE
    exponent = -np.exp2(laplace_exponents)[:, None] * np.exp(sigma * _SCORES - sigma**2 / 2) - _SCORES**2 / 2
    with np.errstate(under="ignore"):
        laplace = np.exp(exponent).sum(axis=1) * (0.2 / math.sqrt(2 * math.pi)) * _MARGIN
        rows = np.floor(np.log2(np.outer(t, sines)) * _PER_OCTAVE).astype(int) - low
        bounds = np.exp(heights**2 / 2) * laplace[np.maximum(rows, 0)]
    table: Array = np.minimum(bounds.min(axis=1, initial=1.0), 1.0)
    return np.minimum.accumulate(table)


def _normal_density(score: Array) -> Array:
    return np.exp(-(score**2) / 2) / math.sqrt(2 * math.pi)
