"""The compiled loops over poses: joint frames, the tip's Jacobian, and the loads of gravity on joints and links.

All compiled code for postures is in this file, because numba does not notice that a cached function is stale when a
function it calls changes in another file. It works on arrays, which :mod:`precision_pin.robot.postures` makes from a
chain.

Poses are computed in *tiles* of `TILE`. One *row* of a workspace holds one number for each pose of a tile. LLVM
computes several poses at once if it can tell that the rows of a loop do not overlap. So distances of rows are constants
of the code, and data that changes along the chain has its own workspace, addressed by one offset. Offsets are unsigned:
signed ones make numba test for negative indices, which prevents this too. Every joint's frame is rotated beforehand so
that its z is the joint's axis; a joint then mixes two columns only.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.jit import cached_entry, fma

Scalar = Any
"""A number inside compiled code: an offset (np.uint64), an index or a double."""

TILE: Final = 128
"""Poses computed together."""
FARTHEST_TURN: Final = 1e6
"""Largest joint angle (rad) with sine and cosine right to rounding here."""

_U = np.uint64
_TILE = _U(TILE)

_R = tuple(_U(row * TILE) for row in range(17))
"""Offsets of rows."""
# workspace f of the current joint: its frame (rotation by rows, position), then these
_SINE, _COSINE, _BEYOND = _R[12], _R[13], _R[14]
_F_SIZE: Final = 17 * TILE
# workspace w of the links' ends: for each, its rotation and position, then the first moment of the link after it
_END_SIZE: Final = 15 * TILE
_END = _U(_END_SIZE)

# π/2 in two parts, the first of 33 bits: its product with a number of quarter turns below 2²⁰ is exact
_QUARTERS_PER_RADIAN = 6.36619772367581382433e-01
_QUARTER_HIGH = 1.57079632673412561417e00
_QUARTER_LOW = 6.07710050650619224932e-11
# fdlibm's k_sin.c and k_cos.c, for angles up to π/4, highest power first
_S = (
    1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06,
    -1.98412698298579493134e-04, 8.33333333332248946124e-03, -1.66666666666666324348e-01,
)  # fmt: skip
_C = (
    -1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07,
    2.48015872894767294178e-05, -1.38888888888741095749e-03, 4.16666666666666019037e-02,
)  # fmt: skip


@fma
def _sines(f: Array) -> None:
    """Replace the angles in the cosines' row by their sines and cosines."""
    for i in range(_TILE):
        angle = f[_COSINE + i]
        quarters = np.floor(angle * _QUARTERS_PER_RADIAN + 0.5)
        x = (angle - quarters * _QUARTER_HIGH) - quarters * _QUARTER_LOW
        z = x * x
        sine = x + x * z * (((((_S[0] * z + _S[1]) * z + _S[2]) * z + _S[3]) * z + _S[4]) * z + _S[5])
        cosine = 1.0 - (0.5 * z - z * z * (((((_C[0] * z + _C[1]) * z + _C[2]) * z + _C[3]) * z + _C[4]) * z + _C[5]))
        # which quarter turn, 0 to 3
        turn = quarters - 4.0 * np.floor(quarters * 0.25)
        odd = (turn == 1.0) | (turn == 3.0)
        s = cosine if odd else sine
        c = sine if odd else cosine
        f[_SINE + i] = -s if turn >= 2.0 else s
        f[_COSINE + i] = -c if (turn == 1.0) | (turn == 2.0) else c


@fma
def _go_to_end(f: Array, w: Array, end: Scalar, turns: Array, arms: Array, link: Scalar) -> None:
    """Multiply the frame by a link's placement: the frame of the link's far end."""
    t00, t01, t02 = turns[link, 0, 0], turns[link, 0, 1], turns[link, 0, 2]
    t10, t11, t12 = turns[link, 1, 0], turns[link, 1, 1], turns[link, 1, 2]
    t20, t21, t22 = turns[link, 2, 0], turns[link, 2, 1], turns[link, 2, 2]
    a0, a1, a2 = arms[link, 0], arms[link, 1], arms[link, 2]
    for i in range(_TILE):
        e = end + i
        for row in (0, 1, 2):  # unrolled by LLVM
            x, y, z = f[_R[3 * row] + i], f[_R[3 * row + 1] + i], f[_R[3 * row + 2] + i]
            w[e + _R[3 * row]] = x * t00 + y * t10 + z * t20
            w[e + _R[3 * row + 1]] = x * t01 + y * t11 + z * t21
            w[e + _R[3 * row + 2]] = x * t02 + y * t12 + z * t22
            w[e + _R[9 + row]] = f[_R[9 + row] + i] + (x * a0 + y * a1 + z * a2)


@fma
def _turn(f: Array, w: Array, end: Scalar) -> None:
    for i in range(_TILE):
        s, c = f[_SINE + i], f[_COSINE + i]
        e = end + i
        for row in (0, 1, 2):
            x, y = w[e + _R[3 * row]], w[e + _R[3 * row + 1]]
            f[_R[3 * row] + i] = x * c + y * s
            f[_R[3 * row + 1] + i] = y * c - x * s
            f[_R[3 * row + 2] + i] = w[e + _R[3 * row + 2]]
            f[_R[9 + row] + i] = w[e + _R[9 + row]]


@fma
def _slide(f: Array, w: Array, end: Scalar) -> None:
    """Slide the joint at an end by the values in the cosines' row: the frame beyond it."""
    for i in range(_TILE):
        value = f[_COSINE + i]
        e = end + i
        for row in (0, 1, 2):
            z = w[e + _R[3 * row + 2]]
            f[_R[3 * row] + i] = w[e + _R[3 * row]]
            f[_R[3 * row + 1] + i] = w[e + _R[3 * row + 1]]
            f[_R[3 * row + 2] + i] = z
            f[_R[9 + row] + i] = w[e + _R[9 + row]] + z * value


@fma
def _weigh(f: Array, w: Array, end: Scalar, mass: Scalar, moments: Array, joint: Scalar) -> None:
    """Store the first moment of the link after a joint, about the base."""
    m0, m1, m2 = moments[joint, 0], moments[joint, 1], moments[joint, 2]
    for i in range(_TILE):
        for row in (0, 1, 2):
            x, y, z = f[_R[3 * row] + i], f[_R[3 * row + 1] + i], f[_R[3 * row + 2] + i]
            w[end + i + _R[12 + row]] = f[_R[9 + row] + i] * mass + (x * m0 + y * m1 + z * m2)


@fma
def _copy_row(rows: Array, row: Scalar, out: Array, at: Scalar, size: Scalar) -> None:
    for i in range(size):
        out[at + i] = rows[row + i]


@fma
def _fill_zeros(out: Array, at: Scalar, size: Scalar) -> None:
    for i in range(size):
        out[at + i] = 0.0


@fma
def _write_frame(f: Array, aligned: Array, joint: Scalar, out: Array, at: Scalar, count: Scalar, size: Scalar) -> None:
    """Write the frame, rotated back from the joint's axis to the axes of the URDF, as a pose: rows of ``(4, 4)``."""
    for row in range(_U(3)):
        x, p = _U(3) * row * _TILE, (_U(9) + row) * _TILE
        for column in range(_U(3)):
            a0, a1, a2 = aligned[joint, column, 0], aligned[joint, column, 1], aligned[joint, column, 2]
            for i in range(_TILE):
                f[_SINE + i] = f[x + i] * a0 + f[x + _R[1] + i] * a1 + f[x + _R[2] + i] * a2
            _copy_row(f, _SINE, out, at, size)
            at += count
        _copy_row(f, p, out, at, size)
        at += count
    for _ in range(3):
        _fill_zeros(out, at, size)
        at += count
    for i in range(size):
        out[at + i] = 1.0


@fma
def _column(f: Array, w: Array, end: Scalar, tip: Scalar) -> None:
    """Write the velocity of the tip for a revolute joint into the frame's first three rows."""
    for i in range(_TILE):
        e, t = end + i, tip + i
        z0, z1, z2 = w[e + _R[2]], w[e + _R[5]], w[e + _R[8]]
        a0, a1, a2 = w[t + _R[9]] - w[e + _R[9]], w[t + _R[10]] - w[e + _R[10]], w[t + _R[11]] - w[e + _R[11]]
        f[i] = z1 * a2 - z2 * a1
        f[_R[1] + i] = z2 * a0 - z0 * a2
        f[_R[2] + i] = z0 * a1 - z1 * a0


@fma
def _gather(f: Array, w: Array, end: Scalar, mass: Scalar, gravity: Array) -> None:
    """Add the link after an end to the first moment; write the wrench at the end into the frame's first six rows."""
    g0, g1, g2 = gravity[0], gravity[1], gravity[2]
    for i in range(_TILE):
        e = end + i
        s0 = f[_BEYOND + i] + w[e + _R[12]]
        s1 = f[_BEYOND + _R[1] + i] + w[e + _R[13]]
        s2 = f[_BEYOND + _R[2] + i] + w[e + _R[14]]
        f[_BEYOND + i] = s0
        f[_BEYOND + _R[1] + i] = s1
        f[_BEYOND + _R[2] + i] = s2
        h0, h1, h2 = s0 - mass * w[e + _R[9]], s1 - mass * w[e + _R[10]], s2 - mass * w[e + _R[11]]
        m0, m1, m2 = h1 * g2 - h2 * g1, h2 * g0 - h0 * g2, h0 * g1 - h1 * g0
        for column in (0, 1, 2):
            x, y, z = w[e + _R[column]], w[e + _R[3 + column]], w[e + _R[6 + column]]
            f[_R[column] + i] = mass * (x * g0 + y * g1 + z * g2)
            f[_R[3 + column] + i] = x * m0 + y * m1 + z * m2


@fma
def _straighten(f: Array, aligned: Array, joint: Scalar) -> None:
    """Rotate the wrench in the frame's rows from the joint's axis to the axes of the URDF."""
    a00, a01, a02 = aligned[joint, 0, 0], aligned[joint, 0, 1], aligned[joint, 0, 2]
    a10, a11, a12 = aligned[joint, 1, 0], aligned[joint, 1, 1], aligned[joint, 1, 2]
    a20, a21, a22 = aligned[joint, 2, 0], aligned[joint, 2, 1], aligned[joint, 2, 2]
    for i in range(_TILE):
        for part in (0, 3):
            x, y, z = f[_R[part] + i], f[_R[part + 1] + i], f[_R[part + 2] + i]
            f[_R[part] + i] = a00 * x + a01 * y + a02 * z
            f[_R[part + 1] + i] = a10 * x + a11 * y + a12 * z
            f[_R[part + 2] + i] = a20 * x + a21 * y + a22 * z


def allocate_scratch(joints: int) -> tuple[Array, Array]:
    """Return the scratch arrays of `run` for a chain with this number of joints."""
    return np.empty(_F_SIZE), np.empty((joints + 1) * _END_SIZE)


@cached_entry
def run(
    f: Array,
    w: Array,
    q: Array,
    slides: NDArray[np.bool_],
    slanted: NDArray[np.bool_],
    aligned: Array,
    turns: Array,
    arms: Array,
    masses: Array,
    moments: Array,
    gravity: Array,
    poses: Array,
    jacobians: Array,
    torques: Array,
    wrenches: Array,
) -> None:
    """Compute all poses, tile by tile. Results are flat: rows of P numbers, one for each pose.

    Args:
        q: ``(n, P)`` joint values; angles not above `FARTHEST_TURN`.
        slides, slanted: ``(n,)`` masks of the prismatic joints, and of those with another axis than z.
        aligned: ``(n + 1, 3, 3)`` from axes whose z is the joint's to those of the URDF; the identity for the tip.
        turns, arms: ``(n + 1, 3, 3)`` and ``(n + 1, 3)``: the links' placements between these aligned frames.
        masses, moments: ``(n,)`` and ``(n, 3)``: mass and first moment of the link after each joint, in its aligned
            frame.
        gravity: ``(3,)``, base axes.
        poses: ``(n + 1, 4, 4, P)`` to fill with the joints' frames and the tip; empty if not wanted.
        jacobians, torques, wrenches: ``(6, n, P)``, ``(n, P)`` and ``(n + 1, 6, P)`` to fill; empty if not wanted.
    """
    joints, poses_given = q.shape
    n, count = _U(joints), _U(poses_given)
    tip = n * _END
    for tile in range((count + _TILE - _U(1)) // _TILE):
        begin = tile * _TILE
        size = _TILE if count - begin > _TILE else count - begin
        for i in range(_U(_F_SIZE)):
            f[i] = 0.0
        for row in (0, 4, 8):
            for i in range(_TILE):
                f[_R[row] + i] = 1.0
        for joint in range(n):
            end = joint * _END
            _go_to_end(f, w, end, turns, arms, joint)
            for i in range(size):
                f[_COSINE + i] = q[joint, begin + i]
            for i in range(size, _TILE):
                f[_COSINE + i] = 0.0
            if slides[joint]:
                _slide(f, w, end)
            else:
                _sines(f)
                _turn(f, w, end)
            _weigh(f, w, end, masses[joint], moments, joint)
            if poses.size:
                _write_frame(f, aligned, joint, poses, joint * _U(16) * count + begin, count, size)
        _go_to_end(f, w, tip, turns, arms, n)
        if poses.size:
            for i in range(_U(12) * _TILE):
                f[i] = w[tip + i]
            _write_frame(f, aligned, n, poses, n * _U(16) * count + begin, count, size)
        if not torques.size:
            continue
        beyond = 0.0
        for before in range(n):
            last = n - _U(1) - before
            end = last * _END
            at = last * count + begin
            if not slides[last]:
                _column(f, w, end, tip)
            for row in range(_U(3)):
                along = end + (_U(3) * row + _U(2)) * _TILE
                if slides[last]:
                    _copy_row(w, along, jacobians, at + row * n * count, size)
                    _fill_zeros(jacobians, at + (row + _U(3)) * n * count, size)
                else:
                    _copy_row(f, row * _TILE, jacobians, at + row * n * count, size)
                    _copy_row(w, along, jacobians, at + (row + _U(3)) * n * count, size)
            beyond += masses[last]
            _gather(f, w, end, beyond, gravity)
            _copy_row(f, _R[2] if slides[last] else _R[5], torques, at, size)
            if slanted[last]:
                _straighten(f, aligned, last)
            for row in range(_U(6)):
                _copy_row(f, row * _TILE, wrenches, (last * _U(6) + row) * count + begin, size)
        for row in range(_U(6)):
            _fill_zeros(wrenches, (n * _U(6) + row) * count + begin, size)
