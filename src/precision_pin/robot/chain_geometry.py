"""The kinematics of a chain: its joints and rigid links, extracted from a URDF tree, and the places on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_name, check_numbers, check_text, check_whole
from precision_pin.base.array_checks import fix_fields, read_only, returns_read_only
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.places import (
    ORDER_END,
    ORDER_FRAME,
    ORDER_SEAT,
    LinkFrame,
    Place,
    link_frames,
    locked_values,
)
from precision_pin.robot.postures import alignment
from precision_pin.robot.urdf import Joint, Robot, rerooted

FARTHEST_TARGET: Final = 1000.0
"""Largest coordinate of a target in the tip's axes, m."""


@dataclass(frozen=True, eq=False)
class ChainGeometry:
    """The moving joints and rigid links between a base and a tip, without weights.

    Attributes
    ----------
    robot
        The mechanism, rooted at the base.
    base, tip
        Link names.
    joints
        The chain's n joints, base to tip.
    locked
        Value of every other joint that can move.
    placements
        ``(n+1, 4, 4)``: from joint i's frame after its motion (base for i = 0) to joint i+1's origin frame before it
        turns (the tip for i = n).
    link_frames
        Position of every URDF link on the chain.
    target
        The point that results are about, in the tip's axes, m, ``(3,)``; zero for the tip itself. It carries nothing.
    """

    robot: Robot
    base: str
    tip: str
    joints: tuple[Joint, ...]
    locked: Mapping[str, float]
    placements: Array
    link_frames: Mapping[str, LinkFrame]
    target: Array

    def __post_init__(self) -> None:
        fix_fields(self)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints, base to tip."""
        return tuple(joint.name for joint in self.joints)

    @property
    def tip_label(self) -> str:
        """Name of the tip, with the target where one is given."""
        if not self.target.any():
            return self.tip
        return f"{self.tip} + {' '.join(f'{value:.6g}' for value in self.target * 1e3)} mm"

    @cached_property
    @returns_read_only
    def target_placement(self) -> Array:
        """From the last joint's frame after its motion to the target, with the tip's axes, ``(4, 4)``."""
        placement: Array = self.placements[-1].copy()
        if self.target.any():
            # einsum, as the rounding of a matrix product depends on the machine
            placement[:3, 3] += np.einsum("ij,j->i", placement[:3, :3], self.target)
        return placement

    @cached_property
    @returns_read_only
    def axes(self) -> Array:
        """Unit axis of each joint in its own frame, ``(n, 3)``."""
        return np.array([joint.axis for joint in self.joints])

    @cached_property
    @returns_read_only
    def prismatic(self) -> NDArray[np.bool_]:
        """True for each prismatic joint, ``(n,)``."""
        return np.array([joint.kind == "prismatic" for joint in self.joints])

    @cached_property
    @returns_read_only
    def reversed_joints(self) -> NDArray[np.bool_]:
        """True for each joint that the chain passes against the file, because the base is beyond it, ``(n,)``."""
        return np.array([joint.reversed for joint in self.joints])

    @cached_property
    @returns_read_only
    def written_axes(self) -> Array:
        """Unit axis of each joint in its own frame as in the file, ``(n, 3)``; opposite to :attr:`axes` if reversed."""
        return np.array([joint.written_axis for joint in self.joints])

    def with_target(self, point: ArrayLike) -> Self:
        """Return the chain with another point that results are about, in the tip's axes, m; places and loads stay.

        Raises
        ------
        InputError
            Not three finite numbers, or farther than 1000 m from the tip.
        """
        target = check_numbers("the target", point, (3,), "three finite numbers, m in the tip's axes")
        if not np.abs(target).max() <= FARTHEST_TARGET:
            raise InputError(f"the target must lie within {FARTHEST_TARGET:,.0f} m of the tip along every axis")
        return replace(self, target=target)

    def runs_backwards(self, link: int) -> bool:
        """Return whether a chain link's far end is its end nearer the file's root, at its own joint in the file.

        Raises
        ------
        InputError
            As :meth:`end`.
        """
        if self._link(link) < len(self.joints):
            return bool(self.reversed_joints[link])
        return self.robot.path(self.base, self.tip)[-1].reversed

    def joint_index(self, name: str) -> int:
        """Return a joint's position, 0-based.

        Raises
        ------
        UnknownNameError
            The chain has no such joint.
        """
        return self.joint_names.index(check_name("joint on the chain", name, self.joint_names))

    def link_frame(self, name: str) -> LinkFrame:
        """Return the position of a URDF link on the chain.

        Raises
        ------
        UnknownNameError
            The robot has no such link.
        """
        return self.link_frames[check_name("link", name, self.link_frames)]

    def end(self, link: int) -> Place:
        """Return the place at a chain link's far end: joint i+1's origin frame before its motion, or the tip.

        Raises
        ------
        InputError
            There is no such link; 0 is the base, n the last of n joints' link.
        """
        return self._places[self._link(link)][0]

    def seat(self, link: int) -> Place:
        """Return the place of the next joint's seat, after the link's end and in the same frame.

        Raises
        ------
        InputError
            As :meth:`end`.
        """
        return self._places[self._link(link)][1]

    def frame_place(self, name: str) -> Place:
        """Return the place at a URDF link's frame on the path from base to tip; the tip's is the last link's end.

        Raises
        ------
        InputError
            The link is on a branch: moving it does not move the tip.
        """
        where = self.link_frame(name)
        if where.path_rank is None:
            raise InputError(
                f"{name!r} is not on the path from {self.base!r} to {self.tip!r}: moving it does not move the tip"
            )
        if name == self.tip:
            return self.end(where.link)
        return Place(where.link, (ORDER_FRAME, where.path_rank), f"frame {name}", where.frame)

    def axis_alignment(self, joint: int) -> Array:
        """Return the smallest rotation that brings a joint's z onto its axis in the file; for -z half a turn about x.

        Raises
        ------
        InputError
            There is no such joint; 0 is the first.
        """
        return self._written_alignments[self.joint_number(joint)]

    def joint_number(self, joint: int) -> int:
        """Return a joint's position, 0-based, after a check.

        Raises
        ------
        InputError
            There is no such joint.
        """
        return check_whole("the number of a joint on the chain", joint, 0, len(self.joints) - 1)

    def _link(self, link: int) -> int:
        return check_whole("the number of a link of the chain", link, 0, len(self.joints))

    @cached_property
    def _places(self) -> tuple[tuple[Place, Place], ...]:
        """End and seat of every chain link."""
        far = enumerate(zip((*self.joint_names, self.tip), self.placements, strict=True))
        return tuple(
            (
                Place(link, (ORDER_END, 0), f"end of link {link} ({name})", frame),
                Place(link, (ORDER_SEAT, 0), f"seat of link {link} ({name})", frame),
            )
            for link, (name, frame) in far
        )

    @cached_property
    def _written_alignments(self) -> tuple[Array, ...]:
        return tuple(read_only(alignment(axis)) for axis in self.written_axes)

    @cached_property
    def _alignments(self) -> tuple[Array, ...]:
        return tuple(alignment(axis) for axis in self.axes)


def cut_chain(robot: Robot, tip: str | None, base: str | None, locked: Mapping[str, float] | None) -> ChainGeometry:
    """Extract a chain from a robot; the arguments and errors are those of :meth:`precision_pin.Chain.from_urdf`."""
    if base is not None:
        robot.link(check_text("the name of the base link", base))
    if tip is None:
        if len(robot.leaves) != 1:
            raise InputError(
                f"{robot.file} has {len(robot.leaves)} leaves; name one as the tip: {', '.join(sorted(robot.leaves))} "
                "(--tip, or tip: in a sheet)"
            )
        tip = robot.leaves[0]
    robot.link(check_text("the name of the tip link", tip))
    rooted = rerooted(robot, base) if base is not None and base != robot.root else robot
    way = rooted.path(rooted.root, tip)
    joints = tuple(joint for joint in way if joint.kind != "fixed" and joint.name not in (locked or {}))
    if not joints:
        raise InputError(f"no joint moves between {rooted.root!r} and {tip!r}; choose another base or tip")
    for joint in joints:
        if joint.mimic is not None:
            raise InputError(f"the joint {joint.name!r} on the chain mimics {joint.mimic.joint!r}; lock it at a value")
    locked_at = locked_values(rooted, joints, locked or {})
    frames, placements = link_frames(rooted, tip, joints, locked_at)
    return ChainGeometry(rooted, rooted.root, tip, joints, locked_at, placements, frames, np.zeros(3))
