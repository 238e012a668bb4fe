"""What a chain is made of: places, where the URDF's links stand on it, and its weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from precision_pin.errors import InputError, UnknownNameError
from precision_pin.parameters import Expression
from precision_pin.urdf import Joint, Robot

__all__ = ["Factors", "LinkFrame", "Load", "Place", "link_frames", "locked_values", "own_loads"]

Array = NDArray[np.float64]
Factors = tuple[Expression, ...]
"""Parameters whose product multiplies a number; none for a constant."""

ORDER_FRAME, ORDER_CUSTOM, ORDER_END, ORDER_SEAT = range(4)
"""Order of the kinds of places on one chain link."""


@final
@dataclass(frozen=True)
class Place:
    """A point of the chain where a small rigid displacement ``E = Trans(d)·Exp(δ)`` is inserted.

    Two places are the same if link, order and name are; contributions to one place add, places multiply in the
    order of ``(link, order)``.

    Attributes
    ----------
    link
        Chain link that carries it.
    order
        Position among the link's places: frames along the link, then custom ones, the end, the seat.
    name
        For people.
    frame
        Its pose in the chain link's axes, ``(4, 4)``.
    """

    link: int
    order: tuple[int, int]
    name: str
    frame: Array = field(compare=False, repr=False)

    @property
    def is_seat(self) -> bool:
        """Whether it is where the next joint sits, after the link's end."""
        return self.order[0] == ORDER_SEAT

    def is_same(self, other: object) -> bool:
        """Return whether another place at this point of the chain is this one, frame included."""
        return isinstance(other, Place) and self == other and np.array_equal(self.frame, other.frame)

    @classmethod
    def custom(cls, link: int, rank: int, name: str, frame: Array) -> Place:
        """Return a place of a source's own, before the link's end; ``rank`` orders those of one source."""
        return cls(link, (ORDER_CUSTOM, rank), name, frame)


@final
@dataclass(frozen=True, eq=False)
class LinkFrame:
    """Where a URDF link stands on the chain.

    Attributes
    ----------
    link
        Chain link it belongs to; branches and locked joints included.
    frame
        Its pose in the chain link's axes, ``(4, 4)``.
    path_rank
        Its position among the URDF links on the way from base to tip within the chain link; ``None`` for a branch.
    attachment
        Where its weight enters the way, in the chain link's axes, ``(3,)``.
    """

    link: int
    frame: Array
    path_rank: int | None
    attachment: Array


@final
@dataclass(frozen=True, eq=False)
class Load:
    """A weight on the chain.

    Attributes
    ----------
    link
        Chain link that carries it.
    frame
        The frame its moments are given in, in the chain link's axes, ``(4, 4)``.
    attachment
        Where it enters the chain link, in the chain link's axes, ``(3,)``.
    along
        Whether it is the link's own weight, taken as spread evenly along the link.
    moments
        Mass (kg) and first moment (kg·m) ``(4,)`` with the parameters that multiply them; these add.
    """

    link: int
    frame: Array
    attachment: Array
    along: bool
    moments: tuple[tuple[Array, Factors], ...]


def locked_values(robot: Robot, joints: Sequence[Joint], locked: Mapping[str, float]) -> dict[str, float]:
    """Return the value of every joint that moves but is not on the chain."""
    on_chain = {joint.name for joint in joints}
    still = {joint.name: joint for joint in robot.joints if joint.kind != "fixed" and joint.name not in on_chain}
    for name, value in locked.items():
        if name not in still:
            raise UnknownNameError("joint to lock", name, still)
        if not np.isfinite(value):
            raise InputError(f"the joint {name!r} is locked at {value}, which is not finite")
    values: dict[str, float] = {}

    def value_of(name: str) -> float:
        if name in on_chain:
            return 0.0
        if name not in values:
            joint = still[name]
            if name in locked:
                values[name] = float(locked[name])
            elif joint.mimic is not None:
                values[name] = joint.mimic.multiplier * value_of(joint.mimic.joint) + joint.mimic.offset
            elif joint.limit is not None and joint.kind != "continuous":
                values[name] = float(np.clip(0.0, joint.limit.lower, joint.limit.upper))
            else:
                values[name] = 0.0
        return values[name]

    return {name: value_of(name) for name in still}


def link_frames(
    robot: Robot, tip: str, joints: Sequence[Joint], locked: Mapping[str, float]
) -> tuple[dict[str, LinkFrame], Array]:
    """Return where every link stands, and the placements between the chain's joints."""
    moving = {joint.name: k + 1 for k, joint in enumerate(joints)}
    way = robot.path(robot.root, tip)
    on_way = {robot.root, *(joint.child for joint in way)}
    frames = {robot.root: LinkFrame(0, np.eye(4), 0, np.zeros(3))}
    placements = np.tile(np.eye(4), (len(joints) + 1, 1, 1))
    waiting = list(robot.child_joints(robot.root))
    while waiting:
        joint = waiting.pop()
        parent = frames[joint.parent]
        origin = parent.frame @ joint.origin
        on_path = joint.child in on_way
        if joint.name in moving:
            placements[moving[joint.name] - 1] = origin
            frames[joint.child] = LinkFrame(moving[joint.name], np.eye(4), 0, np.zeros(3))
        else:
            frame = origin @ joint.motion(locked[joint.name]) if joint.moves else origin
            rank = parent.path_rank + 1 if on_path and parent.path_rank is not None else None
            leaves_way = parent.path_rank is not None and rank is None
            attachment = origin[:3, 3] if leaves_way else frame[:3, 3] if on_path else parent.attachment
            frames[joint.child] = LinkFrame(parent.link, frame, rank, attachment)
        waiting.extend(robot.child_joints(joint.child))
    placements[-1] = frames[tip].frame
    return frames, placements


def own_loads(robot: Robot, frames: Mapping[str, LinkFrame]) -> tuple[Load, ...]:
    """Return the weights of the URDF's links."""
    loads = []
    for link in robot.links:
        if link.inertial is None or link.inertial.mass == 0:
            continue
        where = frames[link.name]
        moments = link.inertial.mass * np.array([1.0, *link.inertial.com])
        loads.append(Load(where.link, where.frame, where.attachment, where.path_rank is not None, ((moments, ()),)))
    return tuple(loads)
