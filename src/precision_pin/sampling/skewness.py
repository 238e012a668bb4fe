"""Skewness of the errors at a pose, to first order, from the laws of the draws.

Samples that hold none of a law's rare or far values cannot tell of them. The laws can: cumulants of independent numbers
add, each times a power of its slope. Correlated draws are taken for independent here, laws with tails no heavier than a
normal law's for normal ones: the result only says how far the intervals of moments are to be trusted.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from precision_pin.draws.laws import Law
from precision_pin.draws.space import Space
from precision_pin.statistics import COMPONENTS, NORMS
from precision_pin.typing import Array

__all__ = ["first_order_skewness"]


_NO_SLOPE = 1e-3
"""A component whose first-order spread is less than this share of its vector's is decided by higher orders."""
_NORMAL_SQUARE = math.sqrt(8)
"""Skewness of the square of a normal number."""


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
    skewed = [_cumulants(draw.law) for draw in space.draws]
    if all(cumulants is None for cumulants in skewed):
        # as of normal numbers
        found[:, 1] = _NORMAL_SQUARE
        found[list(COMPONENTS), 1] *= (slopes != 0).any(axis=1)
        return found
    known = [_normal_cumulants(draw.law) if own is None else own for draw, own in zip(space.draws, skewed, strict=True)]
    cumulants = np.concatenate([np.zeros((4, 0)), *known], axis=1)
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
def _cumulants(law: Law) -> Array | None:
    return law.cumulants()


def _normal_cumulants(law: Law) -> Array:
    normal = np.zeros((4, law.size))
    normal[0] = np.diagonal(law.covariance)
    return normal
