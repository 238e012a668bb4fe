"""Scales of the drawing: the arm's size, the exaggeration, and the viewing direction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array
from precision_pin.robot.chain import Posture
from precision_pin.statistics.summary import NO_SPREAD

DEFAULT_POINTS: Final = 20_000
"""Default number of samples in the cloud."""

MOST_POINTS: Final = 100_000
"""Largest number of samples of all poses of a page: larger pages open slowly."""

MOST_POSES: Final = 200
"""Largest number of poses of one page."""

FAR: Final = 3.0
"""Ratio of mean error to spread above which the mean is far from zero error."""


def arm_length(posture: Posture) -> float:
    """Return the length (m) of the line from base over all joints to the tip; 1 m for an arm without length."""
    points = joint_points(posture)
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return length if length > 1e-9 else 1.0


def view_direction(posture: Posture, positions: ArrayLike | None = None) -> Array:
    """Return the viewing direction across the arm's plane, turned to a wide side of the errors ``(3, N)`` if given."""
    points = joint_points(posture)
    spread = points[:, :2] - points[0, :2]
    farthest = spread[np.argmax(np.linalg.norm(spread, axis=1))]
    size = float(np.linalg.norm(farthest))
    front = farthest / size if size > 1e-6 * arm_length(posture) else np.array([1.0, 0.0])
    side = np.array([front[1], -front[0]])
    # from the side of the arm toward its front, the usual one first, all from somewhat above
    azimuths = [np.deg2rad(angle) for angle in (20, 35, 50, 130, 145, 160)]
    directions = [np.array([*(np.cos(azimuth) * side + np.sin(azimuth) * front), 0.42]) for azimuth in azimuths]
    if positions is None:
        return directions[0]
    errors = np.asarray(positions, dtype=float)
    covariance = np.atleast_2d(np.cov(errors)) if errors.shape[1] > 1 else np.zeros((3, 3))

    def seen_width(direction: Array) -> float:
        right = picture_axes(direction)[0]
        return math.sqrt(max(float(right @ covariance @ right), 0.0))

    widths = [seen_width(direction) for direction in directions]
    # the usual direction, unless another shows clearly more
    return directions[0 if widths[0] >= 0.8 * max(widths) else int(np.argmax(widths))]


def middle_of(positions: ArrayLike) -> Array:
    """Return the position error ``(3,)`` drawn at the tip: zero, or the mean of errors far from zero.

    Errors ``(3, N)``, m, are far from zero if the mean exceeds `FAR` times their spread, the root mean square about it:
    a factor that shows the spread would draw them beside the arm.
    """
    errors = np.asarray(positions, dtype=float)
    mean: Array = errors.mean(axis=1)
    spread = math.sqrt(float(errors.var(axis=1).sum()))
    # if nothing varies, the line to the mean must be visible
    is_far = spread > NO_SPREAD and float(np.linalg.norm(mean)) > FAR * spread
    return mean if is_far else np.zeros(3)


def picture_axes(direction: ArrayLike) -> Array:
    """Return the directions right and up in a picture seen from a direction that is not vertical, ``(2, 3)``."""
    toward = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    right = np.cross((0.0, 0.0, 1.0), toward)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(toward, right)])


def check_factor(factor: object) -> None:
    """Check an exaggeration factor."""
    allowed = "a positive number from 1e-9 to 1e12"
    check_number("the exaggeration factor", factor, allowed, lambda value: 1e-9 <= value <= 1e12)


def default_factor(
    positions: ArrayLike, posture: Posture, others: Sequence[Posture] = (), direction: ArrayLike | None = None
) -> float:
    """Return a round exaggeration (1, 1.5, 2, 3, 5 or 7 times a power of ten, at least 1) for errors ``(3, N)``, m.

    With it, five standard deviations of the cloud along its widest direction in the picture span about 27 % of the
    picture's width, in which the whole arm (also in its ``others``, further postures) and the cloud are visible. It is
    less if the mean error would otherwise be so far from the nominal tip that the arm took less than 45 % of the
    picture. ``direction`` defaults to :func:`view_direction`.
    """
    errors = np.asarray(positions, dtype=float)
    axes = picture_axes(view_direction(posture, errors) if direction is None else direction)
    arm = axes @ np.vstack([joint_points(each) for each in (posture, *others)]).T
    tip, mean = axes @ posture.pose[:3, 3], axes @ errors.mean(axis=1)
    seen = axes @ errors - mean[:, None]
    span = 5.0 * float(np.linalg.svd(seen, compute_uv=False)[0]) / math.sqrt(errors.shape[1])
    negligible = 1e-15 * arm_length(posture)
    # if all samples coincide, the line to them must be visible
    span = span if span > negligible else float(np.linalg.norm(mean))
    if span <= negligible:
        return 1.0
    arm_width = max(_picture_width(arm), 1e-9)

    def misses(factor: float) -> float:
        centre = tip + factor * mean
        half = factor * span / 2
        width = _picture_width(np.column_stack([arm, centre - half, centre + half]))
        if arm_width < 0.45 * width:
            return math.inf
        return abs(math.log(factor * span / width / 0.27))

    return min(
        (digit * float(f"1e{power}") for power in range(9) for digit in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)), key=misses
    )


def joint_points(posture: Posture) -> Array:
    """Return the points of the line from base over all joints to the tip, ``(n + 2, 3)``, m."""
    return np.vstack([posture.link_poses[:, :3, 3], posture.pose[:3, 3]])


def _picture_width(points: Array) -> float:
    """Return the width of a picture that shows points ``(2, N)``, m."""
    width, height = np.ptp(points, axis=1)
    return max(float(width), 1.2 * float(height)) / 0.9
