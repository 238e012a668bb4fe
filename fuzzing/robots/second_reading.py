"""A second reading of URDF that shares nothing with the package: a document tree, and matrices written out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.dom import expatbuilder
from xml.dom.minidom import Element

import numpy as np
from numpy.typing import NDArray

__all__ = ["PlainBody", "PlainJoint", "PlainReading"]

Array = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class PlainBody:
    """Mass (kg), centre (m) and the six moments (kg·m²) as written, with the inertial's roll, pitch, yaw."""

    mass: float
    centre: tuple[float, ...]
    rpy: tuple[float, ...]
    moments: tuple[float, ...]


@dataclass(frozen=True)
class PlainJoint:
    """A joint: type, ends, origin ``(4, 4)`` and unit axis."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array


@dataclass(frozen=True)
class PlainReading:
    """Links with their bodies (None where there is no inertial) and joints."""

    links: Mapping[str, PlainBody | None]
    joints: Mapping[str, PlainJoint]

    @classmethod
    def of(cls, data: bytes) -> PlainReading:
        """Return the reading of a file; anything odd raises whatever Python raises."""
        root = expatbuilder.parseString(data, namespaces=False).documentElement
        links = {_text(link, "name"): _body(_first(link, "inertial")) for link in _children(root, "link")}
        joints = {_text(joint, "name"): _joint(joint) for joint in _children(root, "joint")}
        return cls(links, joints)

    @property
    def root(self) -> str:
        """The link that is no joint's child."""
        (root,) = set(self.links) - {joint.child for joint in self.joints.values()}
        return root

    def poses(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Return every link's pose in the root, ``(4, 4)``."""
        below: dict[str, list[PlainJoint]] = {}
        for joint in self.joints.values():
            below.setdefault(joint.parent, []).append(joint)
        poses = {self.root: np.eye(4)}
        waiting = [self.root]
        while waiting:
            parent = waiting.pop()
            for joint in below.get(parent, ()):
                poses[joint.child] = poses[parent] @ joint.origin @ _motion(joint, values.get(joint.name, 0.0))
                waiting.append(joint.child)
        return poses

    def torques(self, names: Sequence[str], base: str, values: Mapping[str, float]) -> Array:
        """Return what the weight of the links puts on joints, ``(n,)``, gravity down the z axis of ``base``."""
        poses = self.poses(values)
        down = poses[base][:3, :3] @ GRAVITY
        neighbours: dict[str, list[PlainJoint]] = {}
        for joint in self.joints.values():
            neighbours.setdefault(joint.parent, []).append(joint)
            neighbours.setdefault(joint.child, []).append(joint)
        result = []
        for name in names:
            moving = self.joints[name]
            beyond = self._beyond(moving, base, neighbours)
            frame = poses[moving.child]
            axis = frame[:3, :3] @ moving.axis
            sign = 1.0 if moving.child in beyond else -1.0
            total = 0.0
            for link in beyond:
                body = self.links[link]
                if body is None:
                    continue
                centre = poses[link][:3, :3] @ np.array(body.centre) + poses[link][:3, 3]
                pull = body.mass * down
                turn = axis @ pull if moving.kind == "prismatic" else axis @ np.cross(centre - frame[:3, 3], pull)
                total += float(turn)
            result.append(sign * total)
        return np.array(result)

    def _beyond(self, moving: PlainJoint, base: str, neighbours: Mapping[str, list[PlainJoint]]) -> set[str]:
        """Return the links on the far side of a joint, seen from ``base``."""
        near, waiting = {base}, [base]
        while waiting:
            link = waiting.pop()
            for joint in neighbours.get(link, ()):
                other = joint.child if joint.parent == link else joint.parent
                if joint is not moving and other not in near:
                    near.add(other)
                    waiting.append(other)
        return set(self.links) - near

    def lumped(self) -> dict[str, Array]:
        """Return mass and first moment ``(4,)`` of every rigid body, by its topmost link and in that link's axes."""
        top = {self.root: (self.root, np.eye(4))}
        result = {self.root: np.zeros(4)}
        poses = self.poses({})
        for link in poses:  # parents come before children
            joint = next((joint for joint in self.joints.values() if joint.child == link), None)
            if joint is not None and joint.kind == "fixed":
                head, pose = top[joint.parent]
                top[link] = (head, pose @ joint.origin)
            elif joint is not None:
                top[link] = (link, np.eye(4))
                result[link] = np.zeros(4)
            body = self.links[link]
            if body is not None:
                head, pose = top[link]
                centre = pose[:3, :3] @ np.array(body.centre) + pose[:3, 3]
                result[head] += body.mass * np.array([1.0, *centre])
        return result


def _children(element: Element, tag: str) -> list[Element]:
    return [child for child in element.childNodes if isinstance(child, Element) and child.tagName == tag]


def _first(element: Element, tag: str) -> Element | None:
    return next(iter(_children(element, tag)), None)


def _text(element: Element | None, name: str) -> str:
    if element is None or not element.hasAttribute(name):
        raise ValueError(f"no {name}")
    return str(element.getAttribute(name))


def _floats(element: Element | None, name: str, default: str) -> tuple[float, ...]:
    given = element is not None and element.hasAttribute(name)
    return tuple(float(word) for word in (_text(element, name) if given else default).split())


def _placement(element: Element | None) -> Array:
    roll, pitch, yaw = _floats(element, "rpy", "0 0 0")
    (sr, sp, sy), (cr, cp, cy) = map(math.sin, (roll, pitch, yaw)), map(math.cos, (roll, pitch, yaw))
    x, y, z = _floats(element, "xyz", "0 0 0")
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, x],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, y],
            [-sp, cp * sr, cp * cr, z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _motion(joint: PlainJoint, value: float) -> Array:
    result = np.eye(4)
    if joint.kind == "prismatic":
        result[:3, 3] = value * joint.axis
    elif joint.kind != "fixed":
        x, y, z = joint.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        result[:3, :3] += math.sin(value) * cross + (1 - math.cos(value)) * cross @ cross
    return result


def _joint(element: Element) -> PlainJoint:
    kind = _text(element, "type")
    axis = np.eye(3)[0] if kind == "fixed" else np.array(_floats(_first(element, "axis"), "xyz", "1 0 0"))
    return PlainJoint(
        _text(element, "name"),
        kind,
        _text(_first(element, "parent"), "link"),
        _text(_first(element, "child"), "link"),
        _placement(_first(element, "origin")),
        axis / math.hypot(*axis),
    )


def _body(element: Element | None) -> PlainBody | None:
    if element is None:
        return None
    origin, inertia = _first(element, "origin"), _first(element, "inertia")
    moments = tuple(float(_text(inertia, name)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    mass = float(_text(_first(element, "mass"), "value"))
    return PlainBody(mass, _floats(origin, "xyz", "0 0 0"), _floats(origin, "rpy", "0 0 0"), moments)
