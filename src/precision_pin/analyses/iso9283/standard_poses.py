"""The five poses of ISO 9283 in the largest cube within reach, and paths of approach along the base axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from precision_pin.analyses.iso9283.cube_search import largest_cube
from precision_pin.analyses.iso9283.reach import ToolPoses
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain
from precision_pin.robot.pose_set import PoseSet

PLANES: Final = ("y, rising with x", "y, falling with x", "x, rising with y", "x, falling with y")
"""The four diagonal planes of a cube with horizontal edges: the base axis of these, and how the plane slopes."""
_SHARE: Final = 0.4
"""Distance of P2 to P5 from the centre along each axis, by the edge: the standard's 10 % within the cube's corners."""
_STILL: Final = 1e-6
"""Velocity of a joint, by that of the fastest, below which it does not move on the last piece of a path."""


@final
@dataclass(frozen=True, eq=False)
class Cube:
    """The cube that a test is made in.

    Attributes
    ----------
    side
        Length of its edges, m.
    centre
        Base axes, m, ``(3,)``.
    plane
        Number in `PLANES` of the diagonal plane in which P2 to P5 lie.
    """

    side: float
    centre: Array
    plane: int = 0

    def __post_init__(self) -> None:
        fix_fields(self)

    def points(self) -> Array:
        """Return P1 to P5, ``(3, 5)``: the centre, two points up and two down, P2 opposite P4."""
        along, across = ((1, 0), (1, 0), (0, 1), (0, 1))[self.plane]
        slope = 1 if self.plane % 2 == 0 else -1
        offsets = np.zeros((3, 5))
        offsets[along] = [0, -1, 1, 1, -1]
        offsets[across] = slope * np.array([0, 1, 1, -1, -1])
        offsets[2] = [0, 1, 1, -1, -1]
        points: Array = self.centre[:, None] + _SHARE * self.side * offsets
        return points

    def to_dict(self) -> dict[str, Any]:
        """Return the entry ``cube`` of the JSON."""
        return {"side": self.side, "centre": self.centre.tolist(), "axes": "base", "plane": PLANES[self.plane]}


def standard_poses(chain: Chain, reference: Array, target: Array) -> tuple[PoseSet, Cube]:
    """Return P1 to P5 in the largest cube with edges along the base axes that the target reaches.

    The tool keeps the orientation that it has at the reference; an arm of fewer than six joints turns it as it must.

    Parameters
    ----------
    chain
        The arm.
    reference
        Joint values of the pose that has the orientation, ``(n,)``.
    target
        The measured point in tool axes, m.

    Raises
    ------
    InputError
        No cube is within reach.
    """
    tool = ToolPoses(chain, chain.at(reference).pose[:3, :3], target)
    centre, radius = tool.ball
    side, middle = largest_cube(tool.solve, centre - radius, centre + radius)
    turned = "with the tool turned as at the first pose" if tool.keeps_orientation else "with the tool turned as it may"
    if not side > 0:
        raise InputError(
            f"no cube is within reach {turned}; name the five poses of the test, P1 to P5, with --pose or --q"
        )
    cube = Cube(side, middle)
    points = cube.points()
    first = tool.solve(points[:, :1])
    q = tool.solve(points, np.repeat(first, 5, axis=1))
    missed = np.isnan(q[0])
    if missed.any():  # not within Newton's reach from P1
        q[:, missed] = tool.solve(points[:, missed])
    if np.isnan(q).any():
        raise InputError(f"not all five poses in the cube are within reach {turned}; name them with --pose or --q")
    return PoseSet.at(chain, q, tuple(f"P{k}" for k in range(1, 6))), cube


def paths_of_approach(jacobian: Array) -> list[tuple[int, ...]]:
    """Return the directions in which the joints move on straight paths along the three base axes, the tool not turning.

    Parameters
    ----------
    jacobian
        Velocity of the target and of the tool's angles by those of the joints, base axes, ``(6, n)``.
    """
    moved = np.linalg.pinv(jacobian if jacobian.shape[1] >= 6 else jacobian[:3])[:, :3]
    size = np.abs(moved).max(axis=0, initial=1e-300)
    signs = np.where(np.abs(moved) > _STILL * size, np.sign(moved), 0.0)
    return [tuple(int(sign) for sign in column) for column in signs.T]
