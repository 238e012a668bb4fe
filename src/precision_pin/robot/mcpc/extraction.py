"""Extraction of MCPC parameters from a chain's joint placements, and the way back."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import se3
from precision_pin.base.arguments import check_instance, shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.mcpc.parameters import Z_AXIS, Mcpc, axial_motion, half_open, tilt, tilt_angles

PARALLEL = 1e-9
"""Axes closer than this (rad) count as parallel when a joint offset is chosen."""
COINCIDENT = 1e-9
"""Parallel axes closer than this (m) count as coincident when a joint offset is chosen."""
NEARLY_SINGULAR = 0.1
"""Smallest |cos β_0| at which the base frame is not turned."""
TIE = 1e-12
"""Offsets this close (rad) to -π/2 become +π/2, so that rounding does not change their sign."""
SAME_CHAIN = 1e-9
"""Largest difference (m, rad) between a chain's placements and those of its MCPC parameters."""


class JointChain(Protocol):
    """The part of a chain's interface that the adapter uses.

    ``placements[i]`` goes from joint i's frame after it turned (the base link for i = 0) to joint i+1's frame
    before it turns (the tip for i = n); ``axes[i]`` is a unit vector in its joint's own frame. The tip's pose
    is ``placements[0]·Q(axes[0], q_0)·placements[1]⋯placements[n]``.
    """

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The n joints from base to tip."""

    @property
    def placements(self) -> Array:
        """``(n+1, 4, 4)`` constant poses."""

    @property
    def axes(self) -> Array:
        """``(n, 3)`` unit axes."""

    @property
    def prismatic(self) -> NDArray[np.bool_]:
        """``(n,)`` True for each prismatic joint."""


def from_chain(chain: JointChain) -> Mcpc:
    """Return the MCPC parameters of a chain; forward kinematics agrees with the chain's to rounding.

    Frame i+1 has its z axis along axis i+1 and its origin where that axis meets the plane through the origin
    of frame i normal to it. Each joint, prismatic ones too, gets a constant turn θ_off about z that puts the
    next axis (for the last joint: the tip's z) into the local y-z plane; then β_i = 0 for i ≥ 1 and the
    parametrisation's singularity cos β = 0 does not occur. Where the next axis is parallel within 1e-9 rad
    the turn makes y_i = 0; where it coincides, and for a parallel tip, it is 0. Link 0 has no joint
    before it: if |cos β_0| < 0.1 the base frame is first turned by 90° about z (``base_turn``).

    Sign choices: α in (-π, π], offset in (-π/2, π/2]; hence x_i may be negative.

    Parameters
    ----------
    chain
        Any chain of revolute and prismatic joints.
    """
    for name in ("joint_names", "placements", "axes", "prismatic"):
        if not hasattr(chain, name):
            raise InputError(
                f"chain must have joint_names, placements, axes and prismatic, as a Chain has, got {shown(chain)}"
            )
    joints = len(chain.joint_names)
    placements = np.asarray(chain.placements, dtype=float)
    axes = np.vstack([np.asarray(chain.axes, dtype=float).reshape(joints, 3), Z_AXIS])
    alpha, beta, x, y, offset = (np.zeros(joints + 1) for _ in range(5))
    frames = []

    before_turn = np.eye(4)
    for i in range(joints + 1):
        point, direction = _next_axis(before_turn, placements[i], axes[i])
        offset[i] = _offset(point, direction, last=i == joints) if i else _base_turn(direction)
        frame = before_turn @ axial_motion(offset[i], 0.0)
        frames.append(frame)

        point, direction = _next_axis(frame, placements[i], axes[i])
        alpha[i], beta[i] = tilt_angles(direction)
        if i < joints:
            rotation = tilt(alpha[i], beta[i])
            x[i], y[i], _ = rotation.T @ point
            next_frame = se3.pose(rotation, rotation @ (x[i], y[i], 0.0))
            before_turn = se3.inverse(placements[i]) @ frame @ next_frame

    tip = se3.inverse(frames[-1]) @ placements[-1]
    untilted = tilt(alpha[-1], beta[-1]).T @ tip[:3, :3]
    gamma = half_open(math.atan2(untilted[1, 0], untilted[0, 0]))
    rotation = tilt(alpha[-1], beta[-1]) @ se3.rotation_about(Z_AXIS, gamma)
    x[-1], y[-1], z = rotation.T @ tip[:3, 3]
    return Mcpc(
        joint_names=tuple(chain.joint_names),
        prismatic=np.asarray(chain.prismatic, dtype=bool),
        alpha=alpha,
        beta=beta,
        x=x + 0.0,
        y=y + 0.0,
        gamma=gamma,
        z=float(z) + 0.0,
        joint_offset=offset[1:],
        joint_shift=np.zeros(joints),
        base_turn=float(offset[0]),
        frame_in_link=np.array(frames),
    )


def joint_placements(mcpc: Mcpc) -> tuple[Array, Array]:
    """Return placements ``(n+1, 4, 4)`` and axes ``(n, 3)`` of an equivalent chain, all axes z.

    Its joint frames are the MCPC frames (after their constant turn); its forward kinematics is
    ``mcpc.forward_kinematics``. To keep a robot's own joint frames use `to_placements`.
    """
    n = check_instance("mcpc", mcpc, Mcpc, "as mcpc.from_chain returns it").joint_count
    placements = np.array([mcpc.link_pose(i) @ (mcpc.joint_pose(i + 1) if i < n else np.eye(4)) for i in range(n + 1)])
    placements[0] = axial_motion(mcpc.base_turn, 0.0) @ placements[0]
    return placements, np.tile(Z_AXIS, (n, 1))


def to_placements(nominal: Mcpc, perturbed: Mcpc, chain: JointChain) -> Array:
    """Return the joint placements ``(n+1, 4, 4)`` of the as-built robot.

    With the chain's own axes they reproduce ``perturbed.forward_kinematics(q)`` at every q. Each link keeps
    its axes relative to the MCPC frame at its joint; an error Δθ or Δd of a joint goes into the
    placement of that joint, so that the link beyond it moves too. A placement whose parameters did not
    change is the chain's own, bit for bit.

    Parameters
    ----------
    nominal
        ``from_chain(chain)``.
    perturbed
        ``nominal.perturbed(…)``.
    chain
        The nominal chain.

    Raises
    ------
    InputError
        The chain is not the one that ``nominal`` was extracted from, or ``perturbed`` was not made from it.
    """
    same = (
        nominal.joint_names == perturbed.joint_names == tuple(chain.joint_names)
        and nominal.prismatic.tolist() == perturbed.prismatic.tolist() == list(chain.prismatic)
        and nominal.base_turn == perturbed.base_turn
    )
    if not same:
        raise InputError("mcpc to_placements: the two parameter sets and the chain do not have the same joints")
    original = np.asarray(chain.placements, dtype=float)
    result = original.copy()
    for i in range(nominal.joint_count + 1):
        expected = _placement(nominal, nominal, i)
        if not np.allclose(expected, original[i], rtol=0.0, atol=SAME_CHAIN):
            raise InputError(f"mcpc to_placements: placement {i} of the chain is not that of the nominal parameters")
        built = _placement(nominal, perturbed, i)
        if not np.array_equal(built, expected):
            result[i] = built
    return result


def _placement(nominal: Mcpc, actual: Mcpc, link: int) -> Array:
    """Return ``F_i V_i S_{i+1} F_{i+1}⁻¹``; F nominal, V and S (the constant part of Q) actual."""
    end: Array = nominal.frame_in_link[link] @ actual.link_pose(link)
    if link == nominal.joint_count:
        return end
    return se3.compose(end, actual.joint_pose(link + 1), se3.inverse(nominal.frame_in_link[link + 1]))


def _next_axis(frame: Array, placement: Array, axis: Array) -> tuple[Array, Array]:
    """Return the next axis in an MCPC frame: the foot of the perpendicular from the origin, and the direction."""
    next_joint = se3.inverse(frame) @ placement
    direction = next_joint[:3, :3] @ axis
    direction = direction / np.linalg.norm(direction)
    origin = next_joint[:3, 3]
    return origin - direction * (direction @ origin), direction


def _offset(point: Array, direction: Array, *, last: bool) -> float:
    """Return the joint's constant turn in (-π/2, π/2]."""
    if math.hypot(direction[0], direction[1]) > PARALLEL:
        return _reduce_to_half_turn(math.atan2(-direction[0], direction[1]))
    if last or math.hypot(point[0], point[1]) <= COINCIDENT:
        return 0.0
    return _reduce_to_half_turn(math.atan2(point[1], point[0]))


def _base_turn(direction: Array) -> float:
    cos_beta = math.hypot(direction[1], direction[2])
    return math.pi / 2 if cos_beta < NEARLY_SINGULAR else 0.0


def _reduce_to_half_turn(angle: float) -> float:
    """Return the angle modulo π, in (-π/2, π/2].

    The signs of α, x and y absorb the half turn; β absorbs the rest of a tie.
    """
    folded = math.remainder(angle, math.pi)
    return math.pi / 2 if folded < -math.pi / 2 + TIE else folded + 0.0
