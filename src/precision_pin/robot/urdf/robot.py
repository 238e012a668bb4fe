"""A robot as defined by its URDF: a tree of links and joints; its likely tip; its text for Pinocchio; another root."""

from __future__ import annotations

import hashlib
import math
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, InternalError, UnknownNameError

Vector = tuple[float, float, float]
PARTS: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]
_WORDS: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+")
_TIPS: Final = tuple(
    re.compile(rf"(?:^|_)(?:{words})$")
    for words in (
        "tcp(?:_link|_frame)?",
        "tool(?:_0|_frame|_link)?",
        "(?:gripper|grasp|grasping)_(?:frame|center|centre)(?:_link)?",
        "(?:ee|eef|end_effector)(?:_link|_frame)?",
        "flange(?:_link|_frame)?",
        "(?:gripper|hand|palm)(?:_link|_base_link)?",
    )
)
"""Endings of tip names, in words joined by _, the likeliest first."""
_FINGERS: Final = "finger|thumb|jaw|knuckle|claw"
_TURNS: Final = "(?:^|_)(?:roll|pitch|yaw|wrist)(?:_|$)"


@dataclass(frozen=True)
class Limits:
    """Size limits of a URDF.

    ``text_length`` is that of an attribute or name, ``elements`` counts XML elements and attributes, ``links_in_depth``
    links on the longest path from root to tip, both included.
    """

    file_bytes: int = 16 * 1024 * 1024
    text_length: int = 64 * 1024
    xml_depth: int = 64
    elements: int = 250_000
    moving_joints: int = 128
    links_in_depth: int = 200


@dataclass(frozen=True)
class Inertial:
    """Mass properties of a link.

    Mass in kg; centre of mass in the link's axes, m; roll, pitch, yaw of the inertia's axes in the link's axes, rad;
    ``(ixx, ixy, ixz, iyy, iyz, izz)`` about the centre of mass in the axes given by ``rpy``, kg·m².
    """

    mass: float
    com: Vector
    rpy: Vector
    inertia: tuple[float, float, float, float, float, float]

    @property
    def tensor(self) -> Array:
        """Inertia about the centre of mass in the *link's* axes, ``(3, 3)``, kg·m²."""
        ixx, ixy, ixz, iyy, iyz, izz = self.inertia
        turn = se3.rpy_rotation(self.rpy)
        return turn @ np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]) @ turn.T


@dataclass(frozen=True)
class Box:
    """A box centred in its origin; edge lengths ``size`` in m."""

    size: Vector


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, centred in its origin; m."""

    radius: float
    length: float


@dataclass(frozen=True)
class Sphere:
    """A sphere centred in its origin; m."""

    radius: float


@dataclass(frozen=True)
class Mesh:
    """A mesh: the file name as written (``package://``, relative, …) and the scale of its axes."""

    filename: str
    scale: Vector = (1.0, 1.0, 1.0)


Geometry = Box | Cylinder | Sphere | Mesh


@dataclass(frozen=True)
class Shape:
    """One ``<visual>`` or ``<collision>`` of a link: geometry placed at ``xyz``, ``rpy`` in the link's axes.

    ``colour`` is red, green, blue, opacity from 0 to 1, if the file gives one.
    """

    geometry: Geometry
    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)
    colour: tuple[float, float, float, float] | None = None
    line: int | None = None

    @property
    def origin(self) -> Array:
        """Pose of the shape in the link's axes, ``(4, 4)``."""
        return se3.pose(se3.rpy_rotation(self.rpy), self.xyz)


@dataclass(frozen=True)
class Link:
    """A rigid body; ``inertial`` is None if the file gives no mass."""

    name: str
    inertial: Inertial | None = None
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()
    line: int | None = None

    @property
    def mass(self) -> float:
        """Mass in kg, zero if the file gives none."""
        return 0.0 if self.inertial is None else self.inertial.mass


@dataclass(frozen=True)
class Limit:
    """Joint limits: position in rad or m, effort in N·m or N, velocity in rad/s or m/s.

    Infinite if open in the file; ``lower`` and ``upper`` of a continuous joint always are.
    """

    lower: float
    upper: float
    effort: float
    velocity: float


@dataclass(frozen=True)
class Mimic:
    """A joint value that follows another: ``multiplier`` × value of ``joint`` + ``offset``."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Joint:
    """A joint: the child's frame is ``origin`` (``xyz`` m, ``rpy`` rad, in the parent's frame), then the motion.

    The axis is a unit vector in the joint's frame, ``(1, 0, 0)`` for a fixed joint. ``reversed`` joints are passed
    against the file, from the file's child to its parent: see `rerooted`.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (1.0, 0.0, 0.0)
    limit: Limit | None = None
    mimic: Mimic | None = None
    line: int | None = None
    reversed: bool = False

    @property
    def moves(self) -> bool:
        """True if the joint has a value."""
        return self.kind != "fixed"

    @property
    def written_axis(self) -> Array:
        """Unit vector of its axis as in the file, in the joint's frame, ``(3,)``."""
        axis = np.array(self.axis)
        return -axis if self.reversed else axis

    @cached_property
    def origin(self) -> Array:
        """Pose of the joint's frame in the parent's at joint value zero, ``(4, 4)``, read-only."""
        result = se3.pose(se3.rpy_rotation(self.rpy), self.xyz)
        result.setflags(write=False)
        return result

    def motion(self, value: float) -> Array:
        """Return the pose of the child's frame in the joint's frame, ``(4, 4)``, at a value in rad or m."""
        if self.kind == "fixed":
            return np.eye(4)
        if self.kind == "prismatic":
            return se3.translation(value * np.array(self.axis))
        return se3.pose(se3.rotation_about(self.axis, value), (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Robot:
    """A tree of links and joints, in file order; the root is no joint's child. Findings are warnings."""

    name: str
    file: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    findings: tuple[Finding, ...] = ()

    @cached_property
    def root(self) -> str:
        """Name of the link that is no joint's child."""
        roots = [link.name for link in self.links if link.name not in self._parents]
        if len(roots) != 1:
            raise InternalError(f"robot {self.name!r} has {len(roots)} root links; it was not read by `read`")
        return roots[0]

    @cached_property
    def leaves(self) -> tuple[str, ...]:
        """Names of the links that are no joint's parent, in file order."""
        return tuple(link.name for link in self.links if link.name not in self._children)

    @cached_property
    def joints_from_root(self) -> tuple[Joint, ...]:
        """All joints, each after those above it."""
        ordered = list(self.child_joints(self.root))
        for joint in ordered:  # grows level by level
            ordered += self.child_joints(joint.child)
        return tuple(ordered)

    def link(self, name: str) -> Link:
        """Return a link by name, or raise `UnknownNameError` with the nearest names."""
        if name not in self._links:
            raise UnknownNameError("link", name, self._links)
        return self._links[name]

    def joint(self, name: str) -> Joint:
        """Return a joint by name, or raise `UnknownNameError` with the nearest names."""
        if name not in self._joints:
            raise UnknownNameError("joint", name, self._joints)
        return self._joints[name]

    def child_joints(self, link: str) -> tuple[Joint, ...]:
        """Return the joints whose parent is this link, in file order."""
        self.link(link)
        return self._children.get(link, ())

    def parent_joint(self, link: str) -> Joint | None:
        """Return the joint whose child is this link, None for the root."""
        self.link(link)
        return self._parents.get(link)

    def path(self, base: str, tip: str) -> tuple[Joint, ...]:
        """Return the joints from ``base`` down to ``tip``, fixed ones included.

        Raises `InputError` if ``base`` is not between the root and ``tip``; `rerooted` returns a robot in which it is.
        """
        self.link(base)
        joints: list[Joint] = []
        at = tip
        while at != base:
            joint = self.parent_joint(at)
            if joint is None:
                above = ", ".join([self.root, *(joint.child for joint in reversed(joints))])
                raise InputError(f"link {base!r} is not above {tip!r}; those from the root down are: {above}")
            joints.append(joint)
            at = joint.parent
        return tuple(reversed(joints))

    def kinematics(self, base: str, tip: str) -> str:
        """Return a hash of the joints between two links: kinds, axes, and places at zero to 1 µm and 1 µrad."""
        numbers, frame = [], np.eye(4)
        for joint in rerooted(self, base).path(base, tip):
            frame = frame @ joint.origin
            if joint.moves:
                numbers += [joint.kind == "prismatic", *joint.axis, *frame.ravel()]
                frame = np.eye(4)
        # shifted, so that no number that a file may have is at the edge of rounding
        rounded = np.rint(1e6 * np.array([*numbers, *frame.ravel()]) + 0.3137).astype("<i8")
        return hashlib.blake2b(rounded.tobytes(), digest_size=16).hexdigest()

    def link_poses(self, values: Mapping[str, float] | None = None) -> dict[str, Array]:
        """Return every link's pose ``(4, 4)`` in the root link's frame (forward kinematics).

        Values by joint, rad or m, by default zero. Mimic joints are ordinary joints here: their coupling is not
        applied.
        """
        given = values or {}
        for name in given:
            self.joint(name)
        poses: dict[str, Array] = {self.root: np.eye(4)}
        for joint in self.joints_from_root:
            poses[joint.child] = poses[joint.parent] @ joint.origin @ joint.motion(given.get(joint.name, 0.0))
        return poses

    @property
    def moving_joints(self) -> tuple[Joint, ...]:
        """The joints that are not fixed, in file order."""
        return tuple(joint for joint in self.joints if joint.moves)

    @cached_property
    def _links(self) -> dict[str, Link]:
        return {link.name: link for link in self.links}

    @cached_property
    def _joints(self) -> dict[str, Joint]:
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def _parents(self) -> dict[str, Joint]:
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def _children(self) -> dict[str, tuple[Joint, ...]]:
        children: dict[str, list[Joint]] = {}
        for joint in self.joints:
            children.setdefault(joint.parent, []).append(joint)
        return {name: tuple(joints) for name, joints in children.items()}


def likeliest_tip(robot: Robot) -> str:
    """Return the link that is likely the tip: by its name (``tool0``, ``hand_tcp``, …), else the farthest leaf.

    Ties go to the most moving joints before it. For leaves beyond a gripper's joints the link before them is taken;
    links that follow a mimic joint or no joint at all come last.
    """
    ways = {link.name: robot.path(robot.root, link.name) for link in robot.links}

    def merit(name: str) -> tuple[bool, int, float]:
        way = ways[name]
        is_arm = any(joint.moves for joint in way) and not any(joint.mimic is not None for joint in way)
        return is_arm, sum(joint.moves for joint in way), sum(sum(x * x for x in joint.xyz) ** 0.5 for joint in way)

    def rank(name: str) -> int:
        words = _words(name)
        return next((k for k, pattern in enumerate(_TIPS) if pattern.search(words)), len(_TIPS))

    named = [name for name in ways if rank(name) < len(_TIPS) and merit(name)[0] and gripper_joint(robot, name) is None]
    if named:
        return max(named, key=lambda name: (-rank(name), merit(name)))
    ends = [name if (joint := gripper_joint(robot, name)) is None else joint.parent for name in robot.leaves]
    return max(ends, key=lambda name: (merit(name)[0], merit(name)[2]))


def gripper_joint(robot: Robot, tip: str) -> Joint | None:
    """Return the first of the gripper joints that end the path to a tip, None if an arm joint ends it."""
    moving = [joint for joint in robot.path(robot.root, tip) if joint.moves]
    first = None
    while len(moving) > 1 and _grips(moving[-1]):
        first = moving.pop()
    return None if moving and _grips(moving[-1]) else first


def ask_for_tip(robot: Robot) -> str:
    """Return the message that asks which of several leaves is the tip, with a proposal."""
    return (
        f"{robot.file} has {len(robot.leaves)} leaves; name one as the tip: {', '.join(sorted(robot.leaves))} "
        f"(--tip, or tip: in a sheet); likely --tip {shlex.quote(likeliest_tip(robot))}"
    )


def draft_command(robot: str, tip: str) -> str:
    """Return the command that drafts a sheet for a robot, as named on the command line, and a tip."""
    return shlex.join(["precision-pin", "init", robot, "--tip", tip])


def _grips(joint: Joint) -> bool:
    """Return whether a moving joint opens a gripper, by its name or its child link's."""
    name = _words(joint.name)
    is_finger = re.search(f"{_FINGERS}|grip", name) or re.search(_FINGERS, _words(joint.child))
    return is_finger is not None and not re.search(_TURNS, name)


def _words(name: str) -> str:
    return "_".join(_WORDS.findall(name)).lower()


# written for "no limit": finite, because Pinocchio samples and clamps between limits
UNLIMITED = 1e9
NO_MASS = Inertial(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
# newlines and tabs as character references: a parser would turn them into blanks
ESCAPES = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)


def canonical(robot: Robot) -> str:
    """Return the robot as a complete URDF text, with numbers that read back bit for bit.

    Every link has a full inertial (zeros if massless), every moving joint a unit axis and finite limits (`UNLIMITED` if
    there are none); ``continuous`` becomes ``revolute``, so every joint has one value. All else is left out.
    """
    head = ['<?xml version="1.0" encoding="UTF-8"?>', f'<robot name="{_escape(robot.name)}">']
    return "\n".join([*head, *map(_link, robot.links), *map(_joint, robot.joints), "</robot>", ""])


def _link(link: Link) -> str:
    inertial = link.inertial or NO_MASS
    inertia = " ".join(f'{part}="{_number(value)}"' for part, value in zip(PARTS, inertial.inertia, strict=True))
    return (
        f'  <link name="{_escape(link.name)}"><inertial>{_origin(inertial.com, inertial.rpy)}'
        f'<mass value="{_number(inertial.mass)}"/><inertia {inertia}/></inertial></link>'
    )


def _joint(joint: Joint) -> str:
    kind = "revolute" if joint.kind == "continuous" else joint.kind
    return (
        f'  <joint name="{_escape(joint.name)}" type="{kind}"><parent link="{_escape(joint.parent)}"/>'
        f'<child link="{_escape(joint.child)}"/>{_origin(joint.xyz, joint.rpy)}'
        + (f'<axis xyz="{_numbers(joint.axis)}"/>{_limit(joint)}</joint>' if joint.moves else "</joint>")
    )


def _limit(joint: Joint) -> str:
    limit = joint.limit or Limit(-UNLIMITED, UNLIMITED, UNLIMITED, UNLIMITED)
    values = (limit.lower, limit.upper, limit.effort, limit.velocity)
    lower, upper, effort, velocity = (_number(min(max(value, -UNLIMITED), UNLIMITED)) for value in values)
    return f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="{velocity}"/>'


def _origin(xyz: Iterable[float], rpy: Iterable[float]) -> str:
    return f'<origin xyz="{_numbers(xyz)}" rpy="{_numbers(rpy)}"/>'


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(_number, values))


def _number(value: float) -> str:
    # float() first: a NumPy scalar's repr is not a number
    return repr(float(value))


def _escape(text: str) -> str:
    return text.translate(ESCAPES)


def rerooted(robot: Robot, base: str) -> Robot:
    """Return the same mechanism with the link ``base`` as the root.

    Names, link frames, the meaning of joint values and so all relative poses stay. A moving joint between the old root
    and ``base`` is reversed: it is at its old child's frame and moves an added massless link about the negated axis; a
    fixed joint with the inverse of the old origin carries the old parent. Fixed joints are simply inverted. All are
    marked as reversed; a joint reversed twice is not.
    """
    reversed_joints = {joint.name for joint in robot.path(robot.root, base)}
    taken = {link.name for link in robot.links} | {joint.name for joint in robot.joints}
    links = list(robot.links)
    joints: list[Joint] = []
    for joint in robot.joints:
        if joint.name not in reversed_joints:
            joints.append(joint)
            continue
        back = se3.inverse(joint.origin)
        xyz, rpy, turned = to_vector(back[:3, 3]), rpy_of(back[:3, :3]), not joint.reversed
        if not joint.moves:
            joints.append(replace(joint, parent=joint.child, child=joint.parent, xyz=xyz, rpy=rpy, reversed=turned))
            continue
        seat = _free_name(f"{joint.name}_reversed", taken)
        carrier = _free_name(f"{joint.name}_origin", taken)
        (x, y, z), zero = joint.axis, (0.0, 0.0, 0.0)
        axis = (-x, -y, -z)
        moving = replace(joint, parent=joint.child, child=seat, xyz=zero, rpy=zero, axis=axis, reversed=turned)
        links.append(Link(seat, line=joint.line))
        joints += [moving, Joint(carrier, "fixed", seat, joint.parent, xyz, rpy, line=joint.line, reversed=turned)]
    return replace(robot, links=tuple(links), joints=tuple(joints))


def rpy_of(rotation: ArrayLike) -> Vector:
    """Return roll, pitch, yaw (rad) of a rotation ``(3, 3)``, pitch in [-π/2, π/2].

    Accurate to rounding also at pitch ±π/2, where yaw alone is arbitrary: yaw is found first and removed, so that roll
    always compensates for it.
    """
    r = np.asarray(rotation, dtype=float)
    pitch = math.atan2(-r[2, 0], math.hypot(r[0, 0], r[1, 0]))
    yaw = math.atan2(r[1, 0], r[0, 0])
    sine, cosine = math.sin(yaw), math.cos(yaw)
    roll = math.atan2(sine * r[0, 2] - cosine * r[1, 2], cosine * r[1, 1] - sine * r[0, 1])
    return (roll, pitch, yaw)


def to_vector(values: ArrayLike) -> Vector:
    """Return three numbers as a vector of Python floats."""
    x, y, z = (float(value) for value in np.asarray(values))
    return (x, y, z)


def _free_name(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    taken.add(name)
    return name
