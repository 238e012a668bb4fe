"""Means of skewed values: Hall's transformation, which removes the skewness of Student's ratio."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

_NONE: Final = 1e-9
"""Skewness below which the transformation is the identity; its formula divides by the skewness."""


def studentised(normal: ArrayLike, skewness: ArrayLike) -> NDArray[np.float64]:
    """Return the studentised mean t that corresponds to a normal value z, for a mean of skewness a = γ/√N.

    Solves ``z = t + a t²/3 + a² t³/27 + a/6`` (Hall, Journal of the Royal Statistical Society B 54, 1992, 221) by
    ``(1 + a t/3)³ = 1 + a (z - a/6)``. Both arrays have the same shape.
    """
    a = np.asarray(skewness, dtype=float)
    shifted = np.asarray(normal, dtype=float) - a / 6
    skewed = np.abs(a) > _NONE
    result: NDArray[np.float64] = np.where(
        skewed, 3 * (np.cbrt(1 + a * shifted) - 1) / np.where(skewed, a, 1.0), shifted
    )
    return result
