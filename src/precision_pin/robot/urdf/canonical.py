"""The canonical form of URDF, the only one that Pinocchio reads."""

from __future__ import annotations

from collections.abc import Iterable

from precision_pin.robot.urdf.data import Inertial, Joint, Link
from precision_pin.robot.urdf.robot import Robot

# written for "no limit": finite, because Pinocchio samples and clamps between limits
UNLIMITED = 1e9
NO_MASS = Inertial(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
PARTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
# newlines and tabs must be character references: a parser turns them into blanks otherwise
ESCAPES = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)


def canonical(robot: Robot) -> str:
    """Return the robot as a complete URDF text.

    Every link has a full inertial (zeros if it has no mass), every moving joint a unit axis and finite
    limits (`UNLIMITED` if there are none); ``continuous`` becomes ``revolute`` so that every joint has
    one value. Visuals, collisions, dynamics, mimics and everything else are left out. Numbers are written
    so that they are read back bit for bit.
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
    text = (
        f'  <joint name="{_escape(joint.name)}" type="{kind}"><parent link="{_escape(joint.parent)}"/>'
        f'<child link="{_escape(joint.child)}"/>{_origin(joint.xyz, joint.rpy)}'
    )
    if joint.moves:
        text += f'<axis xyz="{_numbers(joint.axis)}"/>{_limit(joint)}'
    return text + "</joint>"


def _limit(joint: Joint) -> str:
    limit = joint.limit
    values = (
        (-UNLIMITED, UNLIMITED, UNLIMITED, UNLIMITED)
        if limit is None
        else (limit.lower, limit.upper, limit.effort, limit.velocity)
    )
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
