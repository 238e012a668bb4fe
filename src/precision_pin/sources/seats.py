"""Geometry and statics at a joint's seat, where its bearings are.

All vectors are in the *seat's axes*: the joint's frame before its motion, seen from the base, turned so that z is the
joint's axis in the file. If the base is beyond the joint, that frame is the one of its child link in the file. z and the
heights on the axis do not depend on the choice of the base.
"""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain, Posture
from precision_pin.robot.loads import Factors

PadsOn = Literal["child", "parent"]
"""The link that the pads of a prismatic joint are fixed to."""

_APART: Final = 1e-12
"""Relative difference of two heights below which they count as equal."""


def seat_axes(chain: Chain, joint: int) -> Array:
    """Return the matrix ``(6, 6)`` from ``[d; δ]`` in the seat's axes (z on the axis of the 0-based joint) to its place's."""
    return _block_diagonal(chain.axis_alignment(joint))


def seat_wrench(posture: Posture, joint: int) -> dict[Factors, Array]:
    """Return the wrench ``[F; M]`` (N, N·m) of all loads beyond a 0-based joint on it.

    In the seat's axes and about its origin, on the arm on which the loads act, by the parameters that multiply it.
    """
    beyond = [load for load in posture.loads if load.link > joint]
    seat = posture.loaded_ends[joint]
    wrenches = posture.wrench_on(beyond, seat[:3, 3])
    aligned = posture.chain.axis_alignment(joint)
    return {factors: in_axes(seat[:3, :3], aligned, wrench) for factors, wrench in wrenches.items()}


def in_axes(rotation: Array, axes: Array, wrench: Array) -> Array:
    """Return a wrench ``(6[, P])``, base axes, in axes ``(3, 3)`` of a frame turned by ``(3, 3[, P])``."""
    if rotation.ndim == 2:
        turned: Array = _block_diagonal((rotation @ axes).T) @ wrench
        return turned
    back = np.einsum("ijp,jk->kip", rotation, axes)
    return np.concatenate([se3.turn(back, wrench[:3]), se3.turn(back, wrench[3:])])


def height_above_seat(posture: Posture, joint: int, height: float, pads_on: PadsOn) -> float:
    """Return the height (m) above the seat's origin of a bearing at ``height`` on the axis of a 0-based joint.

    The bearing travels if the joint is prismatic and the pads are not on the link that carries the seat: forward with the
    child link, or back with the parent link if the base is beyond the joint. Child and parent are those of the file.
    """
    chain = posture.chain
    if not travels(chain, joint, pads_on):
        return height
    return height + (-1.0 if chain.reversed_joints[joint] else 1.0) * float(posture.q[joint])


def travels(chain: Chain, joint: int, pads_on: PadsOn) -> bool:
    """Return whether the pads of a 0-based joint travel along the axis as it slides; see :func:`height_above_seat`."""
    return bool(chain.prismatic[joint]) and (pads_on == "parent") is bool(chain.reversed_joints[joint])


def shift_of_point(height: float, other: float) -> Array:
    """Return the seat's displacement ``[d; δ]`` per shift ``(x, y)`` of the axis at a height, ``(6, 2)``.

    The axis does not move at the ``other`` height: one of the two points of eqs 18 and 19. By virtual work the transpose
    gives the radial force on a bearing there, one of two, from a wrench on the seat.

    Raises
    ------
    InputError
        The heights are equal to rounding.
    """
    if math.isclose(height, other, rel_tol=_APART, abs_tol=0.0):
        raise InputError(f"the span is too small: both bearings are at {height:g} m along the axis")
    share, slope = other / (other - height), 1 / (height - other)
    return np.array([[share, 0], [0, share], [0, 0], [0, -slope], [slope, 0], [0, 0]])


def wrench_at(height: float) -> Array:
    """Return the matrix ``(6, 6)`` from a wrench about the seat's origin to one about the point of the axis at a height.

    By virtual work the transpose gives the seat's displacement from that of a body clamped to it at that point.
    """
    shifted = np.eye(6)
    shifted[3, 1], shifted[4, 0] = height, -height
    return shifted


def _block_diagonal(turn: Array) -> Array:
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = turn
    return result
