"""A chain at many configurations at once: poses, Jacobians, load torques and link wrenches by compiled loops.

They give the results of :class:`precision_pin.robot.chain.Posture`, in about 0.1 µs each, without Pinocchio. Axes and
signs are the same; configurations are the last dimension. A damaged or unusable numba cache only costs time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import se3
from precision_pin.base.arguments import check_memory
from precision_pin.base.arrays import Array, read_only, returns_read_only


def alignment(axis: Array) -> Array:
    """Return the smallest rotation that brings z onto a unit axis ``(3,)``; for -z half a turn about x."""
    normal = np.cross((0.0, 0.0, 1.0), axis)
    sine = float(np.linalg.norm(normal))
    if sine < 1e-15:
        return np.diag([1.0, 1.0, 1.0]) if axis[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return se3.exp_rotation(normal / sine * np.arctan2(sine, axis[2]))


class ChainConstants(NamedTuple):
    """Constants of a chain: unit axes in each joint's frame, ``(n, 3)``, and arguments of `posture_loops.run`."""

    axes: Array
    slides: NDArray[np.bool_]
    slanted: NDArray[np.bool_]
    aligned: Array
    turns: Array
    arms: Array
    masses: Array
    moments: Array
    gravity: Array


@dataclass(frozen=True, eq=False)
class Postures:
    """A chain at P configurations, undisplaced; made by :meth:`precision_pin.robot.chain.Chain.at_many`.

    Results are computed on first use: Jacobians, torques and wrenches together, poses together. Column k of each is, to
    rounding, that of :class:`precision_pin.robot.chain.Posture` at ``q[:, k]``.

    Attributes:
        q: Joint values in chain order, rad and m, ``(n, P)``.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> postures = chain.at_many(np.zeros((4, 100)))
        >>> print(postures.pose.shape)
        (4, 4, 100)
    """

    q: Array
    _constants: ChainConstants = field(repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "q", read_only(self.q))

    def __len__(self) -> int:
        return int(self.q.shape[1])

    @property
    def pose(self) -> Array:
        """Tip in the base, ``(4, 4, P)``."""
        return self._poses[-1]

    @property
    def joint_poses(self) -> Array:
        """Each joint's frame after its motion, in the base, ``(n, 4, 4, P)``."""
        return self._poses[:-1]

    @cached_property
    @returns_read_only
    def joint_axes(self) -> Array:
        """Unit axis of every joint in base axes, ``(n, 3, P)``."""
        return np.einsum("nijp,nj->nip", self.joint_poses[:, :3, :3], self._constants.axes)

    @property
    def joint_jacobian(self) -> Array:
        """Derivative of the tip's pose by the joint values, base axes at the tip, position first, ``(6, n, P)``."""
        return self._rates[0]

    @property
    def load_torque(self) -> Array:
        """Torque (N·m) or force (N) of the weight of robot and chain payload on the joints, ``(n, P)``."""
        return self._rates[1]

    @property
    def link_wrench(self) -> Array:
        """Force and moment of everything beyond it on each chain link's far end, ``(n + 1, 6, P)``.

        At and in the axes of the link's end, the next joint's origin frame before its motion; zero for the last link.
        """
        return self._rates[2]

    @cached_property
    @returns_read_only
    def _poses(self) -> Array:
        check_memory(128.0 * (len(self.q) + 1) * len(self), f"computing poses at {len(self):,} configurations", _FEWER)
        result = np.empty((len(self.q) + 1, 4, 4, len(self)))
        self._run(result, *[np.zeros(0)] * 3)
        return result

    @cached_property
    @returns_read_only
    def _rates(self) -> tuple[Array, Array, Array]:
        joints, count = self.q.shape
        task = f"computing Jacobians and wrenches at {count:,} configurations"
        check_memory(8.0 * (13 * joints + 6) * count, task, _FEWER)
        # one block of memory: a large block is faster to allocate than several
        rows = np.empty((6 * joints + joints + 6 * (joints + 1), count))
        jacobian, torque, wrench = np.split(rows, [6 * joints, 7 * joints])
        self._run(np.zeros(0), jacobian, torque, wrench)
        return jacobian.reshape(6, joints, count), torque, wrench.reshape(joints + 1, 6, count)

    def _run(self, poses: Array, jacobian: Array, torque: Array, wrench: Array) -> None:
        # imported late: numba takes half a second, which one posture does not need
        from precision_pin.base.jit import call
        from precision_pin.robot import posture_loops

        _, slides, *constants = self._constants
        # angles of many turns are reduced to one
        is_far = ~slides[:, None] & (np.abs(self.q) > posture_loops.FARTHEST_TURN)
        reduced = np.where(is_far, np.arctan2(np.sin(self.q), np.cos(self.q)), self.q) if is_far.any() else self.q
        q = np.require(reduced, np.float64, ["C", "W"])
        results = (result.reshape(-1) for result in (poses, jacobian, torque, wrench))
        call(posture_loops.run, (*posture_loops.allocate_scratch(len(q)), q, slides, *constants, *results))


_FEWER: Final = "give fewer at a time"
