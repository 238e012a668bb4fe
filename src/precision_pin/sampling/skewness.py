"""How skewed the errors at a pose are, as the laws of the draws tell to first order.

Samples that hold none of a law's rare or far values cannot tell of them. The laws can: cumulants of independent numbers
add, each times a power of its slope. Correlated draws are taken for independent here, laws with tails no heavier than a
normal law's for normal ones: the result only says how far the intervals of moments are to be trusted.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from precision_pin.draws.laws import Empirical, Law, Lognormal, Rows, TwoPoint
from precision_pin.draws.space import Space
from precision_pin.statistics import COMPONENTS, NORMS

__all__ = ["first_order_skewness"]

Array = NDArray[np.float64]

_NO_SLOPE = 1e-3
"""A component whose first-order spread is less than this share of its vector's is decided by higher orders."""
_NORMAL_SQUARE = math.sqrt(8)
"""Skewness of the square of a normal number."""
_SKEWED = (Empirical, Lognormal, Rows, TwoPoint)
"""Laws that are not taken for normal ones."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def first_order_skewness(space: Space, slopes: Array) -> Array:
    """Return the skewness of the eight quantities and of their squared deviations, ``(8, 2)``.

    Parameters
    ----------
    space
        The draws.
    slopes
        ``(6, d)`` of the components of the error.

    Notes
    -----
    A norm, and a component that the draws do not move to first order, is taken to be as skewed as the squares of the
    components of its vector, as far as those are more skewed than of a normal law.
    """
    found = np.zeros((8, 2))
    if not any(isinstance(draw.law, _SKEWED) for draw in space.draws):
        # as of normal numbers
        found[:, 1] = _NORMAL_SQUARE
        found[list(COMPONENTS), 1] *= (slopes != 0).any(axis=1)
        return found
    cumulants = np.concatenate([np.zeros((4, 0)), *(_cumulants(draw.law) for draw in space.draws)], axis=1)
    second, third, fourth, sixth = (
        (slopes**power * cumulant).sum(axis=1) for power, cumulant in zip((2, 3, 4, 6), cumulants, strict=True)
    )
    moves = second > 0
    variance = np.where(moves, second, 1.0)
    skewness = np.where(moves, third / variance**1.5, 0.0)
    k4, k6 = np.where(moves, fourth / variance**2, 0.0), np.where(moves, sixth / variance**3, 0.0)
    # central moments of a standardised number from its cumulants, and of its square from those
    m4, m6 = k4 + 3, k6 + 15 * k4 + 10 * skewness**2 + 15
    square = (m6 - 3 * m4 + 2) / np.maximum(m4 - 1, 1e-9) ** 1.5
    found[list(COMPONENTS), 0], found[list(COMPONENTS), 1] = np.abs(skewness), np.where(moves, np.abs(square), 0.0)
    for norm, part in zip(NORMS, (slice(0, 3), slice(3, 6)), strict=True):
        rows = slice(norm + 1, norm + 4)
        spread = np.sqrt(second[part])
        heaviest = float(found[rows, 1].max())
        beyond = max(heaviest - _NORMAL_SQUARE, 0.0)
        found[norm] = beyond, heaviest
        bent = spread <= _NO_SLOPE * spread.max()
        found[rows] = np.where(bent[:, None], (beyond, heaviest if beyond else 0.0), found[rows])
    return found


@lru_cache(maxsize=4096)
def _cumulants(law: Law) -> Array:
    """Return the second, third, fourth and sixth cumulant of each number of a law, ``(4, size)``."""
    match law:
        case TwoPoint(half_width=half, probability=p):
            values, weights = np.array([[-half], [half]]), np.array([1 - p, p])
        case Lognormal():
            return _lognormal_cumulants(law)
        case Empirical():
            begin, value, _, end = law.segments.T
            middles = (1 + _NODES[:, None]) / 2
            values = (value + middles * (end - value)).reshape(-1, 1)
            weights = (_WEIGHTS[:, None] / 2 * np.diff(np.append(begin, 1.0))).ravel()
        case Rows():
            values, weights = law.array, np.full(len(law.array), 1 / len(law.array))
        case _:
            normal = np.zeros((4, law.size))
            normal[0] = np.diagonal(law.covariance)
            return normal
    # sums, not BLAS, whose bits may differ from process to process
    residuals = values - (weights[:, None] * values).sum(axis=0)
    m2, m3, m4, m6 = ((weights[:, None] * residuals**power).sum(axis=0) for power in (2, 3, 4, 6))
    return np.stack([m2, m3, m4 - 3 * m2**2, m6 - 15 * m4 * m2 - 10 * m3**2 + 30 * m2**3])


def _lognormal_cumulants(law: Lognormal) -> Array:
    """Return the cumulants of a lognormal number from its moments, by the recursion over powers of exp(σ²)."""
    w = math.exp(law.log_std**2)
    # in units of mean; with w - 1 = v the terms of high order in v are those of a heavy tail (Johnson and Kotz, ch. 14)
    raw = [w ** (r * (r - 1) / 2) for r in range(7)]
    central = [sum(math.comb(r, k) * (-1) ** (r - k) * raw[k] for k in range(r + 1)) for r in range(7)]
    m2, m3, m4, m6 = (central[r] * law.mean**r for r in (2, 3, 4, 6))
    if law.log_std < 0.05:
        # the differences of the moments are rounding here, and the law is all but normal
        return np.array([[law.std**2], [0.0], [0.0], [0.0]])
    return np.array([[m2], [m3], [m4 - 3 * m2**2], [m6 - 15 * m4 * m2 - 10 * m3**2 + 30 * m2**3]])
