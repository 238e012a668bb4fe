"""Places on a chain, and the positions of the URDF's links on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arguments import check_numbers
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import UnknownNameError
from precision_pin.robot.urdf import Joint, Robot

ORDER_START, ORDER_FRAME, ORDER_CUSTOM, ORDER_END, ORDER_SEAT = range(-1, 4)
"""Order of the kinds of places on one chain link."""

_SAME_POINT: Final = 1e-9
"""Distance (m) up to which two frames count as being at one point."""


@final
@dataclass(frozen=True)
class Place:
    """A point of the chain where a small rigid displacement ``E = Trans(d)·Exp(δ)`` is inserted.

    Places are the same if link, order and name are. Contributions to one place add; displacements of different places
    multiply in the order of ``(link, order)``: a link's start, frames along it, custom places, its end, the seat.
    ``frame`` is its pose in the chain link's axes, ``(4, 4)``.
    """

    link: int
    order: tuple[int, int]
    name: str
    frame: Array = field(compare=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.frame, np.ndarray) or self.frame.shape != (4, 4) or self.frame.flags.writeable:
            frame = check_numbers(f"the frame of the place {self.name!r}", self.frame, (4, 4))
            object.__setattr__(self, "frame", frame)

    @property
    def is_seat(self) -> bool:
        """True for the seat of the next joint, after the link's end."""
        return self.order[0] == ORDER_SEAT

    @property
    def is_start(self) -> bool:
        """True for the start of a link, directly after the joint before it."""
        return self.order[0] == ORDER_START

    @property
    def joint(self) -> int | None:
        """The joint (0-based) whose mounting it displaces: after a seat, or before a link's start."""
        if self.is_seat:
            return self.link
        return self.link - 1 if self.is_start else None

    def is_same(self, other: object) -> bool:
        """Return whether another place is the same, including the frame."""
        return isinstance(other, Place) and self == other and np.array_equal(self.frame, other.frame)

    @classmethod
    def start(cls, link: int, name: str) -> Place:
        """Return the place at a link's start, directly after the joint before it."""
        return cls(link, (ORDER_START, 0), name, np.eye(4))

    @classmethod
    def along(cls, link: int, rank: int, name: str, frame: Array) -> Place:
        """Return the place at a URDF link's frame on the path, by its rank within the chain link."""
        return cls(link, (ORDER_FRAME, rank), f"frame {name}", frame)

    @classmethod
    def far_end(cls, link: int, name: str, frame: Array) -> tuple[Place, Place]:
        """Return the end of a link, which leads to the joint or tip ``name``, and the seat after it."""
        return (
            cls(link, (ORDER_END, 0), f"end of link {link} ({name})", frame),
            cls(link, (ORDER_SEAT, 0), f"seat of link {link} ({name})", frame),
        )

    @classmethod
    def custom(cls, link: int, rank: int, name: str, frame: Array) -> Place:
        """Return a source's own place, before the link's end; ``rank`` orders those of one source."""
        return cls(link, (ORDER_CUSTOM, rank), name, frame)


@final
@dataclass(frozen=True, eq=False)
class LinkFrame(Fixed):
    """Position of a URDF link on the chain; branches and locked joints belong to the chain link that carries them.

    ``frame`` ``(4, 4)``, ``attachment`` ``(3,)`` and ``stretch`` ``(2, 3)`` are in the chain link's axes. ``path_rank``
    is its position among the URDF links on the path within the chain link; ``None`` for a branch. ``attachment``: for a
    branch the position on the path of the joint that holds it (its frame in the file, whatever the base is), else its
    own origin. ``stretch``: the ends of its part of the path, from joint to joint, extended over massless links that it
    carries. ``is_own`` marks the chain link's own body: of the links on the path, the one nearest to the file's root,
    the child of the joint that moves it; if that is massless, the next one with mass whose frame is at the same point.
    """

    link: int
    frame: Array
    path_rank: int | None
    attachment: Array
    stretch: Array | None = None
    is_own: bool = False

    def entry(self, centre: ArrayLike) -> Array:
        """Return where on the chain link, in its axes, a weight acts whose centre is in the URDF link's axes.

        The centre itself for a link on the path; for a branch the point where it leaves the path.
        """
        if self.path_rank is None:
            return self.attachment
        return self.frame[:3, :3] @ np.asarray(centre, dtype=float) + self.frame[:3, 3]


def locked_values(robot: Robot, joints: Sequence[Joint], locked: Mapping[str, float]) -> dict[str, float]:
    """Return the value of every moving joint that is not on the chain."""
    on_chain = {joint.name for joint in joints}
    still = {joint.name: joint for joint in robot.joints if joint.kind != "fixed" and joint.name not in on_chain}
    for name in locked:
        if name not in still:
            raise UnknownNameError("joint to lock", name, still)
    values: dict[str, float] = {}

    def value_of(name: str) -> float:
        if name in on_chain:
            return 0.0
        if name not in values:
            joint = still[name]
            if name in locked:
                values[name] = locked[name]
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
    """Return the position of every link, and the placements between the chain's joints."""
    moving = {joint.name: k + 1 for k, joint in enumerate(joints)}
    way = robot.path(robot.root, tip)
    path_links = {robot.root, *(joint.child for joint in way)}
    frames = {robot.root: LinkFrame(0, np.eye(4), 0, np.zeros(3))}
    placements = np.tile(np.eye(4), (len(joints) + 1, 1, 1))
    waiting = list(robot.child_joints(robot.root))
    while waiting:
        joint = waiting.pop()
        parent = frames[joint.parent]
        origin = parent.frame @ joint.origin
        on_path = joint.child in path_links
        if joint.name in moving:
            placements[moving[joint.name] - 1] = origin
            frames[joint.child] = LinkFrame(moving[joint.name], np.eye(4), 0, np.zeros(3))
        else:
            frame = origin @ joint.motion(locked[joint.name]) if joint.moves else origin
            rank = parent.path_rank + 1 if on_path and parent.path_rank is not None else None
            if rank is not None:
                attachment = frame[:3, 3]
            elif parent.path_rank is not None:
                attachment = parent.frame[:3, 3] if joint.reversed else origin[:3, 3]
            else:
                attachment = parent.attachment
            frames[joint.child] = LinkFrame(parent.link, frame, rank, attachment)
        waiting.extend(robot.child_joints(joint.child))
    placements[-1] = frames[tip].frame
    for row in _rows(robot.root, way, moving):
        ends = row.ends(frames, placements)
        own = row.own(robot, frames)
        for k, name in enumerate(row.names):
            frames[name] = replace(frames[name], stretch=ends[row.weight_ends(robot, k)], is_own=k == own)
    return frames, placements


@dataclass(frozen=True)
class _Row:
    """The URDF links on the path within one chain link, base to tip, and the joints between them."""

    names: list[str]
    joints: list[Joint]

    def ends(self, frames: Mapping[str, LinkFrame], placements: Array) -> Array:
        """Return start of the first link, the joints' positions and end of the last link, ``(len(names) + 1, 3)``."""
        # in the file, the joint that holds a link is at the frame of this link
        holds = [self.names[k] if joint.reversed else self.names[k + 1] for k, joint in enumerate(self.joints)]
        points = [np.zeros(3), *(frames[name].frame[:3, 3] for name in holds)]
        return np.array([*points, placements[frames[self.names[0]].link][:3, 3]])

    def own(self, robot: Robot, frames: Mapping[str, LinkFrame]) -> int:
        """Return the number of the chain link's own body."""
        first = max((k + 1 for k, joint in enumerate(self.joints) if joint.reversed), default=0)
        origins = [frames[name].frame[:3, 3] for name in self.names]
        here = [k for k, origin in enumerate(origins) if np.abs(origin - origins[first]).max() <= _SAME_POINT]
        with_mass = [k for k in here if robot.link(self.names[k]).mass]
        return min(with_mass, key=lambda k: abs(k - first), default=first)

    def weight_ends(self, robot: Robot, number: int) -> list[int]:
        """Return the ends of a link's weight, extended over massless links that it carries in the file."""

        def weightless(k: int) -> bool:
            return not robot.link(self.names[k]).mass

        start, stop = number, number + 1
        while start > 0 and self.joints[start - 1].reversed and weightless(start - 1):
            start -= 1
        while stop < len(self.names) and not self.joints[stop - 1].reversed and weightless(stop):
            stop += 1
        return [start, stop]


def _rows(root: str, way: Sequence[Joint], moving: Mapping[str, int]) -> list[_Row]:
    rows = [_Row([root], [])]
    for joint in way:
        if joint.name in moving:
            rows.append(_Row([joint.child], []))
        else:
            rows[-1].names.append(joint.child)
            rows[-1].joints.append(joint)
    return rows
