"""The figures of ISO 9283:1998 as formulas over arrays of cycles.

The first axis of every array is the cycle; further axes, such as the robot, are kept. Sums are taken from the first cycle, so
that cycles that are all the same scatter by exactly zero.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from precision_pin.base import se3
from precision_pin.base.arrays import Array


class PoseFigures(NamedTuple):
    """Accuracy and repeatability at a pose, m and rad; the axes after those of a vector are those of the cycles' arrays.

    Attributes
    ----------
    AP
        Distance of the barycentre from the commanded position, AP_p.
    AP_xyz
        Barycentre minus commanded position, ``(3, …)``.
    AP_abc
        Mean angles about the base axes x, y, z, of the turn from the commanded to the attained orientation, ``(3, …)``.
    RP
        l̄ + 3 S_l, with l the distances from the barycentre.
    RP_abc
        Three standard deviations of these angles, ``(3, …)``.
    """

    AP: Array
    AP_xyz: Array
    AP_abc: Array
    RP: Array
    RP_abc: Array


class DistanceFigures(NamedTuple):
    """Accuracy and repeatability of the distance between two poses, m.

    Attributes
    ----------
    AD, RD
        Mean distance minus commanded distance, and three standard deviations of the distance.
    AD_xyz, RD_xyz
        The same for the distances along x, y and z, ``(3, …)``.
    """

    AD: Array
    RD: Array
    AD_xyz: Array
    RD_xyz: Array


def barycentre(values: Array) -> Array:
    """Return the mean over the cycles; exact where all are the same."""
    result: Array = values[0] + (values - values[0]).mean(axis=0)
    return result


def scatter(values: Array) -> Array:
    """Return three standard deviations over the cycles, divisor n - 1."""
    shifted = values - values[0]
    deviations = shifted - shifted.mean(axis=0)
    result: Array = 3 * np.sqrt((deviations * deviations).sum(axis=0) / (len(values) - 1))
    return result


def repeatability(positions: Array) -> Array:
    """Return RP = l̄ + 3 S_l of positions ``(n, 3, …)``."""
    shifted = positions - positions[0]
    distances = _norm(shifted - shifted.mean(axis=0), axis=1)
    result: Array = distances.mean(axis=0) + scatter(distances)
    return result


def pose_figures(deviations: Array, angles: Array) -> PoseFigures:
    """Return the figures of attained minus commanded positions ``(n, 3, …)`` and of angles ``(n, 3, …)``."""
    accuracy = barycentre(deviations)
    return PoseFigures(_norm(accuracy), accuracy, barycentre(angles), repeatability(deviations), scatter(angles))


def distance_figures(commanded: Array, first: Array, second: Array) -> DistanceFigures:
    """Return the figures of the distance between two attained positions ``(n, 3, …)``.

    Parameters
    ----------
    commanded
        First minus second commanded position, ``(3,)``.
    first, second
        Attained positions.
    """
    apart = first - second
    along = np.abs(apart)
    wanted = np.abs(commanded).reshape((3,) + (1,) * (along.ndim - 2))
    distances = _norm(apart, axis=1)
    return DistanceFigures(
        barycentre(distances) - np.sqrt((commanded * commanded).sum()),
        scatter(distances),
        barycentre(along) - wanted,
        scatter(along),
    )


def angles_of(rotation: Array) -> Array:
    """Return a, b, c ``(3, …)`` of rotations ``(3, 3, …)`` = Rot(z, c) Rot(y, b) Rot(x, a), b from -π/2 to π/2."""
    return np.array(
        [
            np.arctan2(rotation[2, 1], rotation[2, 2]),
            np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0])),
            np.arctan2(rotation[1, 0], rotation[0, 0]),
        ]
    )


def turn_angles(vectors: Array) -> Array:
    """Return a, b, c of rotation vectors, ``(3, N)`` both."""
    return angles_of(se3.exp_rotation(vectors))


def _norm(vectors: Array, axis: int = 0) -> Array:
    result: Array = np.sqrt((vectors * vectors).sum(axis=axis))
    return result
