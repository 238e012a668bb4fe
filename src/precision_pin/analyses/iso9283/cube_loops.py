"""The compiled loop of a cube's search: damped Gauss-Newton steps of an arm to points, one point after another.

In numpy the same steps spend nearly all time between its calls, since few points are sought at once. All compiled code of it is
in this file, as numba's cache asks for.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.jit import cached_entry, call, inline

ARRIVED: Final = 1e-6
"""What may be missing: m, and angles in units of length."""
_ITERATIONS: Final = 30
# rad, and m
_LONGEST_STEP: Final = 0.5
# share of the error that is left after some steps where they lead nowhere
_STALLED: Final = 0.9
_PATIENCE: Final = 6


def descend(
    arm: tuple[Array, Array, Array],
    limits: tuple[Array, Array],
    orientation: Array,
    scale: float,
    points: Array,
    begin: Array,
) -> Array:
    """Return joint values ``(n, P)`` after steps from some, NaN where they do not arrive.

    Args:
        arm: Constant poses ``(n + 1, 4, 4)``, axes ``(n, 3)`` and which joints slide.
        limits: Least and largest joint values.
        orientation: Of the tool in the base.
        scale: Length that counts as much as a radian; 0 where the tool may turn.
        points: Where the tool is to be, ``(3, P)``.
        begin: Joint values to start from, ``(n, P)``.
    """
    q, size = np.array(begin.T, order="C"), 6 if scale > 0 else 3
    found, n = np.full(q.shape, np.nan), q.shape[1]
    scratch = (
        np.zeros((n + 1, 3, 4)), np.zeros((n, 3)), np.zeros((size, n)), np.zeros((size, size + 1)), np.zeros(size), np.zeros(n)
    )  # fmt: skip
    call(_descend, (*arm, *limits, orientation, scale, np.ascontiguousarray(points.T), q, found, *scratch))
    return found.T


@cached_entry
def _descend(
    placements: Array, axes: Array, slides: Any, low: Array, high: Array, orientation: Array, scale: float,
    points: Array, q: Array, found: Array,
    frames: Array, turned: Array, slopes: Array, square: Array, error: Array, step: Array,
) -> None:  # fmt: skip
    n, m = len(axes), len(error)
    for point in range(len(points)):
        here, before = q[point], np.inf
        for iteration in range(_ITERATIONS):
            _go(placements, axes, slides, here, frames, turned)
            tip = frames[n]
            for i in range(3):
                error[i] = points[point, i] - tip[i, 3]
            if m == 6:
                _turn_left(orientation, tip, scale, error)
            size = 0.0
            for i in range(m):
                size += error[i] * error[i]
            size = np.sqrt(size)
            if size < ARRIVED:
                for k in range(n):
                    found[point, k] = here[k]
                break
            if iteration % _PATIENCE == _PATIENCE - 1:
                if size >= _STALLED * before:
                    break
                before = size
            for k in range(n):
                _slope_of(k, frames, turned, slides, tip, scale, slopes)
            _step(slopes, error, size, square, step)
            # a joint that a limit stops is left out: the others reach what it does not, if they can
            held = False
            for k in range(n):
                if (here[k] <= low[k] and step[k] < 0) or (here[k] >= high[k] and step[k] > 0):
                    held = True
                    for i in range(m):
                        slopes[i, k] = 0.0
            if held:
                _step(slopes, error, size, square, step)
            longest = 0.0
            for k in range(n):
                longest = max(longest, abs(step[k]))
            share = min(1.0, _LONGEST_STEP / max(longest, 1e-300))
            for k in range(n):
                here[k] = min(max(here[k] + share * step[k], low[k]), high[k])


@inline
def _go(placements: Array, axes: Array, slides: Any, q: Array, frames: Array, turned: Array) -> None:
    """Put each joint's frame after its motion, and the tip's, into frames ``(n + 1, 3, 4)``, axes in the base beside them."""
    for k in range(len(frames)):
        link, frame = placements[k], frames[k]
        for i in range(3):
            for j in range(4):
                if k == 0:
                    frame[i, j] = link[i, j]
                else:
                    last = frames[k - 1]
                    far = last[i, 3] if j == 3 else 0.0
                    frame[i, j] = last[i, 0] * link[0, j] + last[i, 1] * link[1, j] + last[i, 2] * link[2, j] + far
        if k == len(axes):
            return
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        for i in range(3):
            turned[k, i] = frame[i, 0] * x + frame[i, 1] * y + frame[i, 2] * z
        if slides[k]:
            for i in range(3):
                frame[i, 3] += q[k] * turned[k, i]
            continue
        # rows of the frame's axes about the joint's axis (Rodrigues): R (1 + s K + v K²)
        s, half = np.sin(q[k]), np.sin(q[k] / 2)
        v = 2 * half * half
        for i in range(3):
            a, b, c = frame[i, 0], frame[i, 1], frame[i, 2]
            ka, kb, kc = b * z - c * y, c * x - a * z, a * y - b * x
            frame[i, 0] = a + s * ka + v * (kb * z - kc * y)
            frame[i, 1] = b + s * kb + v * (kc * x - ka * z)
            frame[i, 2] = c + s * kc + v * (ka * y - kb * x)


@inline
def _slope_of(k: Any, frames: Array, turned: Array, slides: Any, tip: Array, scale: float, slopes: Array) -> None:
    """Put the derivative of the tool's place by a joint into its column."""
    x, y, z = turned[k, 0], turned[k, 1], turned[k, 2]
    if slides[k]:
        slopes[0, k], slopes[1, k], slopes[2, k] = x, y, z
        x = y = z = 0.0
    else:
        a, b, c = tip[0, 3] - frames[k, 0, 3], tip[1, 3] - frames[k, 1, 3], tip[2, 3] - frames[k, 2, 3]
        slopes[0, k], slopes[1, k], slopes[2, k] = y * c - z * b, z * a - x * c, x * b - y * a
    if len(slopes) == 6:
        slopes[3, k], slopes[4, k], slopes[5, k] = scale * x, scale * y, scale * z


@inline
def _turn_left(wanted: Array, tip: Array, scale: float, error: Array) -> None:
    """Put the rotation vector from the tip's attitude to the wanted one, base axes, times a length into the error's end."""
    r00 = wanted[0, 0] * tip[0, 0] + wanted[0, 1] * tip[0, 1] + wanted[0, 2] * tip[0, 2]
    r01 = wanted[0, 0] * tip[1, 0] + wanted[0, 1] * tip[1, 1] + wanted[0, 2] * tip[1, 2]
    r02 = wanted[0, 0] * tip[2, 0] + wanted[0, 1] * tip[2, 1] + wanted[0, 2] * tip[2, 2]
    r10 = wanted[1, 0] * tip[0, 0] + wanted[1, 1] * tip[0, 1] + wanted[1, 2] * tip[0, 2]
    r11 = wanted[1, 0] * tip[1, 0] + wanted[1, 1] * tip[1, 1] + wanted[1, 2] * tip[1, 2]
    r12 = wanted[1, 0] * tip[2, 0] + wanted[1, 1] * tip[2, 1] + wanted[1, 2] * tip[2, 2]
    r20 = wanted[2, 0] * tip[0, 0] + wanted[2, 1] * tip[0, 1] + wanted[2, 2] * tip[0, 2]
    r21 = wanted[2, 0] * tip[1, 0] + wanted[2, 1] * tip[1, 1] + wanted[2, 2] * tip[1, 2]
    r22 = wanted[2, 0] * tip[2, 0] + wanted[2, 1] * tip[2, 1] + wanted[2, 2] * tip[2, 2]
    # the unit quaternion by its largest part, as in se3.log_rotation
    trace = r00 + r11 + r22
    if trace >= r00 and trace >= r11 and trace >= r22:
        w, x, y, z = 1 + trace, r21 - r12, r02 - r20, r10 - r01
    elif r00 >= r11 and r00 >= r22:
        w, x, y, z = r21 - r12, 1 + 2 * r00 - trace, r01 + r10, r02 + r20
    elif r11 >= r22:
        w, x, y, z = r02 - r20, r01 + r10, 1 + 2 * r11 - trace, r12 + r21
    else:
        w, x, y, z = r10 - r01, r02 + r20, r12 + r21, 1 + 2 * r22 - trace
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    sine = np.sqrt(x * x + y * y + z * z)
    by = scale * (2 * np.arctan2(sine, w) / sine if sine > 0 else 0.0)
    error[3], error[4], error[5] = by * x, by * y, by * z


@inline
def _step(slopes: Array, error: Array, size: float, square: Array, step: Array) -> None:
    """Put Jᵀ (J Jᵀ + λ 1)⁻¹ e, damped by the square of the error (Sugihara 2011), into a step; by Cholesky's factor."""
    m, n = slopes.shape
    damping = 1e-2 * size * size + 1e-12
    for i in range(m):
        for j in range(i + 1):
            total = damping if i == j else 0.0
            for k in range(n):
                total += slopes[i, k] * slopes[j, k]
            for k in range(j):
                total -= square[i, k] * square[j, k]
            # rounding must not make a square negative
            square[i, j] = np.sqrt(max(total, 1e-18)) if i == j else total / square[j, j]
    # the last column: the weights
    for i in range(m):
        total = error[i]
        for k in range(i):
            total -= square[i, k] * square[k, m]
        square[i, m] = total / square[i, i]
    for back in range(m):
        i = m - 1 - back
        total = square[i, m]
        for k in range(i + 1, m):
            total -= square[k, i] * square[k, m]
        square[i, m] = total / square[i, i]
    for k in range(n):
        total = 0.0
        for i in range(m):
            total += slopes[i, k] * square[i, m]
        step[k] = total
