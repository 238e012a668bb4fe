"""Other forms of a robot: with exact right angles, with another root, and the canonical text for Pinocchio."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.robot.urdf.checks import find_exact_angle
from precision_pin.robot.urdf.grammar import PARTS
from precision_pin.robot.urdf.robot import Inertial, Joint, Limit, Link, Robot, Vector

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
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', f'<robot name="{_escape(robot.name)}">']
    lines += [_link(link) for link in robot.links]
    lines += [_joint(joint) for joint in robot.joints]
    return "\n".join([*lines, "</robot>", ""])


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


def snapped(robot: Robot) -> Robot:
    """Return the robot with rounded right angles of joint origins made exact, without ``W_ANGLE_ROUNDED``."""
    joints = []
    for joint in robot.joints:
        roll, pitch, yaw = (angle if (exact := find_exact_angle(angle)) is None else exact for angle in joint.rpy)
        joints.append(replace(joint, rpy=(roll, pitch, yaw)))
    findings = tuple(found for found in robot.findings if found.code != "W_ANGLE_ROUNDED")
    return replace(robot, joints=tuple(joints), findings=findings)


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
