"""Numerical functions that several laws share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.draws import lazy_special

FARTHEST_NORMAL: Final = 8.6
"""Largest normal number that is drawn, in standard deviations: the smallest uniform number is 2⁻⁵³."""

LAST_UNIFORM: Final = 1 - 2.0**-53
"""Largest uniform number that is drawn; the smallest is the same distance from zero."""

Moments = tuple[float, float, float]
"""E ζ³, E ζ⁴ of standardised numbers and E ζ_k² ζ_l² of two of them."""

NORMAL_MOMENTS: Final[Moments] = (0.0, 3.0, 1.0)

_PANELS: Final = 36
"""Panels of the quadrature over normal scores, besides those that the breaks add."""

_CHUNK: Final = 2**20
"""Numbers that :func:`in_chunks` holds in memory at once."""


def in_chunks(
    function: Callable[[Array], NDArray[np.complex128]], frequency: Array, width: int
) -> NDArray[np.complex128]:
    """Return the values of a function ``(m, T) → (T,)`` at frequencies ``(m, …)``, computed in chunks to bound the memory.

    Parameters
    ----------
    function
        Takes the memory of about ``width`` numbers for each of its T columns.
    frequency
        ``(m, …)``.
    width
        Numbers in memory for each frequency.
    """
    flat = frequency.reshape(frequency.shape[0], -1)
    step = max(1, _CHUNK // max(width, 1))
    parts = [function(flat[:, first : first + step]) for first in range(0, flat.shape[1], step)]
    return np.concatenate([np.zeros(0, dtype=complex), *parts]).reshape(frequency.shape[1:])


def triangular_root(covariance: Array) -> Array:
    """Return the lower-triangular L with L Lᵀ the covariance; a dependent component gets a zero column."""
    root = np.zeros_like(covariance)
    for k in range(len(covariance)):
        pivot = covariance[k, k] - root[k, :k] @ root[k, :k]
        if pivot > 1e-14 * covariance[k, k]:
            root[k, k] = math.sqrt(pivot)
            root[k + 1 :, k] = (covariance[k + 1 :, k] - root[k + 1 :, :k] @ root[k, :k]) / root[k, k]
    return root


def moments_of(values: Array, weights: Array) -> Moments:
    """Return the moments of a number with weighted values; those of a normal number if it does not vary."""
    deviations = values - weights @ values
    variance = float(weights @ deviations**2)
    if variance <= 0:
        return NORMAL_MOMENTS
    third, fourth = (float(weights @ deviations**power) / variance ** (power / 2) for power in (3, 4))
    return third, fourth, 1.0


def moments_by_quadrature(at_scores: Callable[[Array], Array], breaks: Sequence[float]) -> Moments:
    """Return the moments of a number from its values at normal scores, by Gauss-Legendre panels.

    Parameters
    ----------
    at_scores
        The values ``(1, N)`` at scores ``(1, N)``.
    breaks
        Uniform numbers at which the values jump or bend; the panels are split there.
    """
    z, weights, _ = score_panels(breaks, 16)
    return moments_of(at_scores(z.reshape(1, -1))[0], weights.ravel())


def score_panels(breaks: Sequence[float], count: int) -> tuple[Array, Array, Array]:
    """Return normal scores ``(panels, count)``, their probabilities and the edges of the panels, which the breaks split."""
    bends = lazy_special.ndtri(np.array(breaks, dtype=float))
    bends = bends[np.abs(bends) < FARTHEST_NORMAL]
    edges = np.union1d(np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, _PANELS + 1), bends)
    half = np.diff(edges)[:, None] / 2
    nodes, shares = _rule(count)
    z = edges[:-1, None] + half * (nodes + 1)
    return z, half * shares * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), edges


@cache
def _rule(count: int) -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(count)


def cumulants_of(values: Array, weights: Array) -> Array:
    """Return the second, third, fourth and sixth cumulant ``(4, size)`` of values ``(N, size)`` with weights ``(N,)``."""
    # sums, not BLAS, whose bits may differ from process to process
    residuals = values - (weights[:, None] * values).sum(axis=0)
    m2, m3, m4, m6 = ((weights[:, None] * residuals**power).sum(axis=0) for power in (2, 3, 4, 6))
    return np.stack([m2, m3, m4 - 3 * m2**2, m6 - 15 * m4 * m2 - 10 * m3**2 + 30 * m2**3])
