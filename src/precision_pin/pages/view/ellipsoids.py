"""Ellipsoids that hold a share of a normal law with the samples' mean and covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arrays import Array

SHARES: Final = (0.95, 0.9973)
"""Which shares are drawn, the inner one first."""

FEWEST: Final = 4
"""Fewest samples for an ellipsoid: three only span a plane."""

# directions in which the samples spread by less than this share of the widest are rounding
_FLAT: Final = 1e-9
# half an axis that has no spread, as a share of the longest, so that the ellipsoid can still be drawn
_THINNEST: Final = 1e-4


@final
@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An ellipsoid of position errors.

    Attributes:
        share: What it holds of a normal law with the samples' mean and covariance.
        matrix: Takes the unit ball to it, ``(4, 4)``, m, base axes, from the nominal tip.
        inside: Share of the samples that lie in it.
    """

    share: float
    matrix: Array
    inside: float


def ellipsoids(positions: ArrayLike) -> tuple[Ellipsoid, ...]:
    """Return an ellipsoid for each of `SHARES`; none for fewer than four samples, or samples without spread.

    The squared distance ``(d - mean)ᵀ C⁻¹ (d - mean)`` of a normal law with covariance C in three directions is
    chi-square with 3 degrees of freedom; the ellipsoid ends at its quantile. Where the samples spread in two directions
    or one only, there are so many degrees of freedom, and the ellipsoid is flat.

    Args:
        positions: Position errors ``(3, N)``, m.
    """
    values = np.asarray(positions, dtype=float)
    count = values.shape[1]
    mean = values.mean(axis=1)
    if count < FEWEST:
        return ()
    centred = values - mean[:, None]
    directions, singular, _ = np.linalg.svd(centred, full_matrices=False)
    deviations = singular / math.sqrt(count - 1)
    if deviations[0] <= _FLAT * np.abs(values).max():
        return ()
    spread = deviations > _FLAT * deviations[0]
    scaled = (directions.T @ centred)[spread] / deviations[spread, None]
    squares = (scaled * scaled).sum(axis=0)
    result = []
    for share in SHARES:
        reach = ellipsoid_reach(share, int(spread.sum()))
        matrix = np.eye(4)
        matrix[:3, :3] = directions * (reach * np.maximum(deviations, _THINNEST * deviations[0]))
        matrix[:3, 3] = mean
        result.append(Ellipsoid(share, matrix, float((squares <= reach**2).mean())))
    return tuple(result)


def ellipsoid_reach(share: float, freedom: int) -> float:
    """Return half an axis in standard deviations: the root of the quantile of the chi-square law, 1 to 3 degrees."""
    # imported late, it costs 0.1 s; a chi-square variable is twice a gamma variable of half its degrees of freedom
    from scipy.special import gammaincinv

    return math.sqrt(2 * float(gammaincinv(freedom / 2, share)))
