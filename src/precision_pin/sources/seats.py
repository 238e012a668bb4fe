"""Geometry and statics at a joint's seat, where its bearings are.

Everything is in the *seat's axes*: the joint's frame before it moves, as seen from the base, turned so that z is its axis
in the file. Where the base lies beyond the joint, that frame is the one of its child link in the file; z and heights on
the axis are the same in space wherever the base is.
"""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np

from precision_pin.errors import InputError
from precision_pin.robot.chain import Chain, Factors, Posture
from precision_pin.typing import Array

__all__ = ["PadsOn", "height_above_seat", "seat_axes", "seat_wrench", "shift_of_point", "travels", "wrench_at"]


PadsOn = Literal["child", "parent"]
"""The link that a sliding joint's pads are fixed to."""

_APART: Final = 1e-12
"""Heights that differ by less, relatively, are known to too few digits."""


def seat_axes(chain: Chain, joint: int) -> Array:
    """Return ``(6, 6)``: ``[d; δ]`` in the seat's axes (z on the axis of the 0-based joint) to those of its place."""
    return _both(chain.axis_alignment(joint))


def seat_wrench(posture: Posture, joint: int) -> dict[Factors, Array]:
    """Return the wrench ``[F; M]`` (N, N·m) that everything beyond a 0-based joint puts on it.

    In the seat's axes and about its origin, on the arm as loads see it, by the parameters that multiply it.
    """
    beyond = [load for load in posture.loads if load.link > joint]
    seat = posture.loaded_ends[joint]
    to_seat = _both((seat[:3, :3] @ posture.chain.axis_alignment(joint)).T)
    return {factors: to_seat @ wrench for factors, wrench in posture.wrench_on(beyond, seat[:3, 3]).items()}


def height_above_seat(posture: Posture, joint: int, height: float, pads_on: PadsOn) -> float:
    """Return the height (m) above the seat's origin of what sits at ``height`` on the axis of a 0-based joint.

    It travels where the joint slides and the pads are not on the link that carries the seat: forth with the child, and
    back with the parent where the base lies beyond the joint. Child and parent are those of the file.
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

    The axis stays where it is at the ``other`` height: one of the two points of eqs 18 and 19. By virtual work the
    transpose makes the radial force on a bearing there, of two, out of a wrench on the seat.

    Raises
    ------
    InputError
        The heights are one and the same, to rounding.
    """
    if math.isclose(height, other, rel_tol=_APART, abs_tol=0.0):
        raise InputError(f"the span is too small: at {height:g} m along the axis both bearings are at one place")
    share, slope = other / (other - height), 1 / (height - other)
    return np.array([[share, 0], [0, share], [0, 0], [0, -slope], [slope, 0], [0, 0]])


def wrench_at(height: float) -> Array:
    """Return ``(6, 6)``: a wrench about the seat's origin to the same about the point of the axis at a height.

    By virtual work the transpose makes the seat's displacement out of that of a body clamped to it at that point.
    """
    shifted = np.eye(6)
    shifted[3, 1], shifted[4, 0] = height, -height
    return shifted


def _both(turn: Array) -> Array:
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = turn
    return result
