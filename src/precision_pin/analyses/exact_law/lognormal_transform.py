"""The characteristic function of a lognormal number less its mean, at very many frequencies, and a bound of it.

With x = exp(σz - σ²/2) of mean 1 and z normal, E exp(i t (x - 1)) is an integral over z. Along a line parallel to the real
axis it neither cancels nor oscillates where it counts, and the trapezoidal rule converges faster than any power of its step
(see :class:`precision_pin.draws.laws.Lognormal`). As a function of ln t it is smooth: one octave after another it is interpolated
at Chebyshev points, so that a million frequencies take little more than a thousand integrals.

Bound: on the line at height η the integrand is no larger than exp((η² - z²)/2 - t exp(-σ²/2) sin(ση) exp(σz)), so that
|E exp(i t x)| ≤ exp(η²/2) L(t sin ση) with L the Laplace transform of x, for every η from 0 to π/σ. Each of these falls with
t, and so does the least of them.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

__all__ = ["LOGNORMAL_ERROR", "lognormal_characteristic", "lognormal_envelope"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LOGNORMAL_ERROR: Final = 3e-14
"""Bound of the error of :func:`lognormal_characteristic`."""

_STEP: Final = 1 / 40
_NODES: Final = _STEP * np.arange(-360, 361)
_AT_ONCE: Final = 1000
_FEW: Final = 2000
_DEGREES: Final = (24, 48, 96)
_SETTLED: Final = 2e-14
_SMALL: Final = 0.3
"""Up to this σ the function turns least about the mean, above it about zero."""

_PER_OCTAVE: Final = 4
_OCTAVES: Final = (-30, 170)
_HEIGHTS: Final = np.linspace(0.1, 9.0, 60)
_SCORES: Final = np.arange(-38.0, 9.01, 0.2)
_MARGIN: Final = 1.0 + 1e-6


def lognormal_characteristic(frequency: Array, log_std: float) -> ComplexArray:
    """Return E exp(i t (x - 1)) of x lognormal with mean 1, t ``(N,)``.

    Parameters
    ----------
    frequency
        t.
    log_std
        σ, the standard deviation of ln x.
    """
    t = np.abs(frequency)
    value = _integrated(t, log_std) if t.size <= _FEW else _interpolated(t, log_std)
    result: ComplexArray = np.where(frequency < 0, value.conj(), value)
    return result


def _integrated(t: Array, sigma: float) -> ComplexArray:
    parts = [np.zeros(0, dtype=complex)]
    for first in range(0, t.size, _AT_ONCE):
        some = t[first : first + _AT_ONCE]
        scaled = some * math.exp(-(sigma**2) / 2)
        saddle = -special.lambertw(-1j * scaled * sigma**2) / sigma
        height = np.maximum(saddle.imag, min(1.0, math.pi / (2 * sigma)))
        centre = -special.lambertw(scaled * sigma**2 * np.sin(sigma * height)).real / sigma
        z = (centre + 1j * height)[:, None] + _NODES
        integrand = np.exp(1j * some[:, None] * np.expm1(sigma * z - sigma**2 / 2) - z**2 / 2)
        parts.append(integrand.sum(axis=1) * (_STEP / math.sqrt(2 * math.pi)))
    return np.concatenate(parts)


def _interpolated(t: Array, sigma: float) -> ComplexArray:
    turn = 0.0 if sigma <= _SMALL else 1.0
    result = np.ones(t.size, dtype=complex)
    exponents = np.frexp(t)[1]
    for exponent in np.unique(exponents[t > 0]):
        chosen = (exponents == exponent) & (t > 0)
        some = t[chosen]
        high = 2.0 ** int(exponent)
        values = _octave(some, high, sigma, turn)
        result[chosen] = _integrated(some, sigma) if values is None else values * np.exp(-1j * turn * some)
    return result


def _octave(t: Array, high: float, sigma: float, turn: float) -> ComplexArray | None:
    """Return the function times exp(i turn t), interpolated between high/2 and high; ``None`` where integrals are fewer."""
    for degree in _DEGREES:
        if t.size <= degree + 1:
            return None
        nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        places = high * (3 + nodes) / 4
        values = _integrated(places, sigma) * np.exp(1j * turn * places)
        cosines = np.cos(np.pi * np.outer(np.arange(degree + 1), np.arange(degree + 1) + 0.5) / (degree + 1))
        coefficients = cosines @ values * (2 / (degree + 1))
        coefficients[0] /= 2
        if np.abs(coefficients[-4:]).sum() <= _SETTLED:
            found: ComplexArray = np.polynomial.chebyshev.chebval(4 * t / high - 3, coefficients)
            return found
    return None


def lognormal_envelope(frequency: Array, log_std: float) -> Array:
    """Return a bound of |E exp(i t x)| of x lognormal with mean 1 that never rises, t ``(N,)`` not negative."""
    table = _table(log_std)
    # the table's value at the nearest frequency below
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
    # the Laplace transform at s, from a table of its own: at the nearest s below, as it falls
    low = (_OCTAVES[0] - 20) * _PER_OCTAVE
    places = np.arange(low, exponents[-1] * _PER_OCTAVE + 1) / _PER_OCTAVE
    exponent = -np.exp2(places)[:, None] * np.exp(sigma * _SCORES - sigma**2 / 2) - _SCORES**2 / 2
    with np.errstate(under="ignore"):
        laplace = np.exp(exponent).sum(axis=1) * (0.2 / math.sqrt(2 * math.pi)) * _MARGIN
        at = np.floor(np.log2(np.outer(t, sines)) * _PER_OCTAVE).astype(int) - low
        bounds = np.exp(heights**2 / 2) * laplace[np.maximum(at, 0)]
    table: Array = np.minimum(bounds.min(axis=1, initial=1.0), 1.0)
    return np.minimum.accumulate(table)
