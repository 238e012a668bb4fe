"""Rigid motions as plain arrays, with the sample axis last.

A pose is ``(4, 4[, N])``, a rotation ``(3, 3[, N])``; a displacement ``E = Trans(d)·Exp(δ)`` is six numbers ``[d; δ]``
(m, rad).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arrays import Array


def skew(vector: ArrayLike) -> Array:
    """Return the cross-product matrix ``[v]×``: ``(3[, N])`` → ``(3, 3[, N])``."""
    v = np.asarray(vector, dtype=float)
    zero = np.zeros_like(v[0])
    return np.array([[zero, -v[2], v[1]], [v[2], zero, -v[0]], [-v[1], v[0], zero]])


def _trigonometric_series(angle: Array) -> tuple[Array, Array, Array]:
    """Return sin φ/φ, (1-cos φ)/φ² and (φ - sin φ)/φ³, smooth through φ = 0."""
    square = angle * angle
    small = angle < 0.05
    safe = np.where(small, 1.0, angle)
    half = np.sin(safe / 2) / (safe / 2)
    sinc = np.where(
        small, 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72))), np.sin(safe) / safe
    )
    versine = np.where(
        small, 0.5 - square / 24 * (1 - square / 30 * (1 - square / 56 * (1 - square / 90))), half * half / 2
    )
    cubic = np.where(
        small,
        (1 - square / 20 * (1 - square / 42 * (1 - square / 72 * (1 - square / 110)))) / 6,
        (safe - np.sin(safe)) / safe**3,
    )
    return sinc, versine, cubic


def _series_of_one(angle: float) -> tuple[float, float, float]:
    """Return the numbers of :func:`_trigonometric_series` to the same bit for one angle, in a tenth of the time."""
    if angle < 0.05:
        square = angle * angle
        return (
            1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72))),
            0.5 - square / 24 * (1 - square / 30 * (1 - square / 56 * (1 - square / 90))),
            (1 - square / 20 * (1 - square / 42 * (1 - square / 72 * (1 - square / 110)))) / 6,
        )
    sine = float(np.sin(angle))
    half = float(np.sin(angle / 2)) / (angle / 2)
    return sine / angle, half * half / 2, (angle - sine) / float(np.power(angle, 3.0))


def _of_one(v: Array, is_jacobian: bool) -> Array:
    """Return ``Exp(δ)`` or J_l(δ) of one vector, ``(3,)`` or ``(3, 1)``: calibrations need millions."""
    x, y, z = v.ravel().tolist()
    xx, yy, zz = x * x, y * y, z * z
    series = _series_of_one(math.sqrt(xx + yy + zz))
    a, b = series[1:] if is_jacobian else series[:2]
    rows = (
        (1 - b * (zz + yy), b * (x * y) - a * z, a * y + b * (x * z)),
        (a * z + b * (x * y), 1 - b * (zz + xx), b * (y * z) - a * x),
        (b * (x * z) - a * y, a * x + b * (y * z), 1 - b * (yy + xx)),
    )
    return np.array(rows).reshape(3, 3, *v.shape[1:])


def _rotation_or_jacobian(vector: ArrayLike, *, is_jacobian: bool) -> Array:
    v = np.asarray(vector, dtype=float)
    if v.size == 3:
        return _of_one(v, is_jacobian)
    series = _trigonometric_series(np.sqrt((v * v).sum(axis=0)))
    first, second = series[1:] if is_jacobian else series[:2]
    cross = skew(v)
    return np.eye(3)[:, :, None] + first * cross + second * np.einsum("ij...,jk...->ik...", cross, cross)


def exp_rotation(vector: ArrayLike) -> Array:
    """Return ``Exp(δ)`` (Rodrigues): rotation vector ``(3[, N])`` in rad → ``(3, 3[, N])``."""
    return _rotation_or_jacobian(vector, is_jacobian=False)


def log_rotation(rotation: ArrayLike) -> Array:
    """Return the rotation vector of a rotation, angle in [0, π]: ``(3, 3[, N])`` → ``(3[, N])``."""
    # uses the unit quaternion (largest component first), accurate to rounding near zero and near π alike
    r = np.asarray(rotation, dtype=float)
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    # four times the outer product of the quaternion (w, x, y, z) with itself
    outer = np.array(
        [
            [1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], 1 + 2 * r[0, 0] - trace, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 + 2 * r[1, 1] - trace, r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 + 2 * r[2, 2] - trace],
        ]
    )
    largest = np.argmax(np.array([outer[k, k] for k in range(4)]), axis=0)
    column = np.take_along_axis(
        outer, np.expand_dims(largest, (0, 1)) if r.ndim == 3 else largest.reshape(1, 1), axis=0
    )[0]
    column = column.reshape((4, *r.shape[2:]))
    quaternion = column / np.sqrt((column * column).sum(axis=0))
    quaternion = np.where(quaternion[0] < 0, -quaternion, quaternion)
    sine = np.sqrt((quaternion[1:] ** 2).sum(axis=0))
    safe = np.where(sine > 0, sine, 1.0)
    scale = np.where(sine > 0, 2 * np.arctan2(sine, quaternion[0]) / safe, 2.0)
    return scale * quaternion[1:]


def left_jacobian(vector: ArrayLike) -> Array:
    """Return J_l(δ), with d/dt Exp(δ) = [J_l(δ) δ̇]× Exp(δ): ``(3[, N])`` → ``(3, 3[, N])``."""
    return _rotation_or_jacobian(vector, is_jacobian=True)


def left_jacobian_inverse(vector: ArrayLike) -> Array:
    """Return J_l(δ)⁻¹ for one rotation vector ``(3,)`` of angle below 2π."""
    return np.asarray(np.linalg.inv(left_jacobian(vector)), dtype=float)


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Return the rotation by ``angle`` (rad, scalar or ``(N,)``) about a unit ``axis`` ``(3,)``."""
    a = np.asarray(axis, dtype=float)
    radians = np.asarray(angle, dtype=float)
    cross = skew(a)
    expand = (...,) + (None,) * radians.ndim
    return np.eye(3)[expand] + np.sin(radians) * cross[expand] + 2 * np.sin(radians / 2) ** 2 * (cross @ cross)[expand]


def rpy_rotation(rpy: ArrayLike) -> Array:
    """Return the URDF rotation Rz(yaw)·Ry(pitch)·Rx(roll) of ``(3,)`` angles in rad."""
    roll, pitch, yaw = np.asarray(rpy, dtype=float)
    return rotation_about((0, 0, 1), yaw) @ rotation_about((0, 1, 0), pitch) @ rotation_about((1, 0, 0), roll)


def pose(rotation: ArrayLike, position: ArrayLike) -> Array:
    """Return the pose with the given rotation ``(3, 3[, N])`` and position ``(3[, N])``."""
    r = np.asarray(rotation, dtype=float)
    p = np.asarray(position, dtype=float)
    samples = r.shape[2:]
    if samples != p.shape[1:]:
        samples = np.broadcast_shapes(samples, p.shape[1:])
    result = np.zeros((4, 4, *samples))
    result[:3, :3] = r if r.ndim > 2 or not samples else r[:, :, None]
    result[:3, 3] = p if p.ndim > 1 or not samples else p[:, None]
    result[3, 3] = 1
    return result


def translation(position: ArrayLike) -> Array:
    """Return the pose Trans(p), p ``(3[, N])`` in m."""
    return pose(np.eye(3), position)


def displacement(values: ArrayLike) -> Array:
    """Return ``E = Trans(d)·Exp(δ)`` for ``[d; δ]``: ``(6[, N])`` → ``(4, 4[, N])``."""
    v = np.asarray(values, dtype=float)
    return pose(exp_rotation(v[3:]), v[:3])


def displaced(transform: Array, error: Array) -> Array:
    """Return a pose ``(4, 4)`` moved by an error ``[d; δ]`` ``(6,)``, both in the axes of the same frame."""
    return pose(exp_rotation(error[3:]) @ transform[:3, :3], transform[:3, 3] + error[:3])


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotation R ``(3, 3)`` that maximises tr(RᵀM), the best fit of points to points (Kabsch)."""
    left, _, right = np.linalg.svd(matrix)
    return left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right


def inverse(transform: ArrayLike) -> Array:
    """Return the inverse of a pose ``(4, 4[, N])``."""
    t = np.asarray(transform, dtype=float)
    r = t[:3, :3].swapaxes(0, 1)
    return pose(r, -np.einsum("ij...,j...->i...", r, t[:3, 3]))


def compose(*transforms: ArrayLike) -> Array:
    """Return the product of poses ``(4, 4[, N])``, left to right."""
    result = np.array(transforms[0], dtype=float)  # a copy, so that the product of one pose is not a view of it
    for transform in transforms[1:]:
        right = np.asarray(transform, dtype=float)
        if result.ndim == right.ndim == 2:
            result = result @ right
        elif result.ndim == right.ndim:
            result = np.einsum("ijn,jkn->ikn", result, right)
        elif result.ndim == 2:
            result = np.einsum("ij,jkn->ikn", result, right)
        else:
            result = np.einsum("ijn,jk->ikn", result, right)
    return result


def turn(rotation: ArrayLike, vector: ArrayLike) -> Array:
    """Return a rotated vector: ``(3, 3[, N])`` times ``(3[, N])`` → ``(3[, N])``."""
    r, v = np.asarray(rotation, dtype=float), np.asarray(vector, dtype=float)
    if v.ndim == 1:
        rotated: Array = r @ v if r.ndim == 2 else np.einsum("ijn,j->in", r, v)
    else:
        rotated = np.einsum("ij...,j...->i...", r, v)
    return rotated


def adjoint(transform: ArrayLike) -> Array:
    """Return Ad(T) acting on ``[d; δ]``: ``[[R, [p]×R], [0, R]]``, ``(4, 4)`` → ``(6, 6)``."""
    t = np.asarray(transform, dtype=float)
    rotation = t[:3, :3]
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = rotation
    result[:3, 3:] = skew(t[:3, 3]) @ rotation
    return result
