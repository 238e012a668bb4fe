"""A second reading of URDF, independent of the package: ElementTree, scipy rotations, textbook mechanics.

Also writes the small URDFs of the tests, and turns them into chains.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import parse

GRAVITY = (0.0, 0.0, -9.81)


# --- writing ---


def link(name: str, mass: float = 0.0, com=(0.0, 0.0, 0.0)) -> str:
    """Return a link; its moments of inertia do not matter at rest."""
    if not mass:
        return f'<link name="{name}"/>'
    inertia = f'<inertia ixx="{mass!r}" iyy="{mass!r}" izz="{mass!r}" ixy="0" ixz="0" iyz="0"/>'
    return (
        f'<link name="{name}"><inertial><origin xyz="{_text(com)}"/><mass value="{mass!r}"/>{inertia}</inertial></link>'
    )


def joint(name, kind, parent, child, xyz=(0, 0, 0), rpy=(0, 0, 0), axis=(0, 0, 1), extra="") -> str:
    """Return a joint; ``extra`` takes a <mimic> or <limit> of its own."""
    if kind in ("revolute", "prismatic") and "<limit" not in extra:
        extra += '<limit lower="-7" upper="7" effort="100" velocity="1"/>'
    turns = "" if kind == "fixed" else f'<axis xyz="{_text(axis)}"/>'
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{_text(xyz)}" rpy="{_text(rpy)}"/>'
        f'<parent link="{parent}"/><child link="{child}"/>{turns}{extra}</joint>'
    )


def robot(*parts: str) -> str:
    return f'<robot name="arm">{"".join(parts)}</robot>'


def chain_of(text: str, **settings) -> Chain:
    return Chain.from_robot(parse(text.encode(), "arm.urdf"), **settings)


def limits(lower: float, upper: float) -> str:
    return f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'


def gantry() -> Chain:
    """Return a table that slides along x and y and lifts along z, with a turning tool: ± 1 m, ± 1 rad."""
    links = ("base", "bridge", "carriage", "ram", "tool")
    axes = (("x", (1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, 1)), ("c", (0, 0, 1)))
    joints = (
        joint(name, "revolute" if name == "c" else "prismatic", parent, child, axis=axis, extra=limits(-1, 1))
        for (name, axis), parent, child in zip(axes, links, links[1:], strict=False)
    )
    return chain_of(robot(*map(link, links), *joints))


def planar_arm(*, half: float = 0.5, shoulder: float = 7, elbow: tuple[float, float] = (-7, 7)) -> Chain:
    """Return two links of half a metre in a plane; the shoulder turns by ± so much, the elbow from one limit to the other."""
    return chain_of(
        robot(
            *map(link, ("base", "upper", "lower", "tool")),
            joint("shoulder", "revolute", "base", "upper", extra=limits(-shoulder, shoulder)),
            joint("elbow", "revolute", "upper", "lower", (half, 0, 0), extra=limits(*elbow)),
            joint("flange", "fixed", "lower", "tool", (half, 0, 0)),
        )
    )


def unit(vector) -> np.ndarray:
    return np.asarray(vector, dtype=float) / np.linalg.norm(vector)


def random_arm(seed: int, joints: int = 7, prismatic: tuple[int, ...] = (), reach: float = 0.5) -> str:
    """Return an arm with slanted axes, random origins, split links, a fixed branch and a locked finger.

    Links are ``base, link1 … linkN, tool``, joints ``joint1 … jointN``; link 2 is split by a fixed joint (``half2``),
    link 1 carries ``bracket``, the tool a ``finger`` on the joint ``finger_joint``.
    """
    generator = np.random.default_rng(seed)

    def origin():
        return generator.uniform(-reach, reach, 3), generator.uniform(-3, 3, 3)

    parts = [link("base", 3.0, (0.1, 0, 0.1))]
    parent = "base"
    for i in range(1, joints + 1):
        xyz, rpy = origin()
        kind = "prismatic" if i in prismatic else "continuous" if i % 3 == 0 else "revolute"
        parts += [
            joint(f"joint{i}", kind, parent, f"link{i}", xyz, rpy, unit(generator.normal(size=3))),
            link(f"link{i}", float(generator.uniform(0.5, 3)), generator.uniform(-0.2, 0.2, 3)),
        ]
        parent = f"link{i}"
        if i == 2:
            xyz, rpy = origin()
            parts += [joint("split2", "fixed", "link2", "half2", xyz, rpy), link("half2", 0.7, (0.03, -0.02, 0.1))]
            parent = "half2"
        if i == 1:
            xyz, rpy = origin()
            parts += [
                joint("bolt", "fixed", "link1", "bracket", xyz, rpy),
                link("bracket", 0.9, (0.1, 0.2, -0.1)),
            ]
    xyz, rpy = origin()
    parts += [joint("flange", "fixed", parent, "tool", xyz, rpy), link("tool", 0.4, (0.0, 0.05, 0.02))]
    xyz, rpy = origin()
    parts += [
        joint("finger_joint", "prismatic", "tool", "finger", xyz / 5, rpy, unit(generator.normal(size=3))),
        link("finger", 0.2, (0.01, 0.02, 0.03)),
    ]
    return robot(*parts)


def _text(numbers) -> str:
    return " ".join(repr(float(number)) for number in numbers)


# --- reading ---


def motion(axis, prismatic: bool, value: float) -> np.ndarray:
    """Return what a joint does at a value."""
    matrix = np.eye(4)
    if prismatic:
        matrix[:3, 3] = np.asarray(axis) * value
    else:
        matrix[:3, :3] = Rotation.from_rotvec(np.asarray(axis) * value).as_matrix()
    return matrix


def inserted(displacement) -> np.ndarray:
    """Return E = Trans(d)·Exp(δ)."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(displacement[3:]).as_matrix()
    matrix[:3, 3] = displacement[:3]
    return matrix


def pose_error(actual, nominal) -> np.ndarray:
    """Return d = p' - p and δ = Log(R' Rᵀ), base axes at the tip."""
    turn = Rotation.from_matrix(actual[:3, :3] @ nominal[:3, :3].T).as_rotvec()
    return np.concatenate([actual[:3, 3] - nominal[:3, 3], turn])


@dataclass(frozen=True)
class PlainJoint:
    name: str
    kind: str
    parent: str
    child: str
    origin: np.ndarray
    axis: np.ndarray


@dataclass(frozen=True)
class PlainRobot:
    joints: tuple[PlainJoint, ...]
    masses: Mapping[str, tuple[float, np.ndarray]]
    root: str

    @classmethod
    def parse(cls, text: str) -> PlainRobot:
        tree = ElementTree.fromstring(text)
        joints = tuple(_plain_joint(node) for node in tree.findall("joint"))
        masses = {}
        for node in tree.findall("link"):
            body = node.find("inertial")
            if body is not None:
                origin = body.find("origin")
                com = np.zeros(3) if origin is None else np.array(origin.get("xyz", "0 0 0").split(), dtype=float)
                masses[node.get("name")] = (float(body.find("mass").get("value")), com)
        children = {entry.child for entry in joints}
        (root,) = {node.get("name") for node in tree.findall("link")} - children
        return cls(joints, masses, root)

    def poses(self, q: Mapping[str, float], base: str | None = None, displaced=None) -> dict[str, np.ndarray]:
        """Return the pose of every link in ``base``.

        ``displaced`` maps a joint to E at its origin before it turns, or a link to E at its frame; E carries all beyond.
        """
        displaced = displaced or {}
        poses = {self.root: np.eye(4)}
        waiting = [self.root]
        while waiting:
            parent = waiting.pop()
            for entry in (entry for entry in self.joints if entry.parent == parent):
                pose = poses[parent] @ entry.origin @ displaced.get(("joint", entry.name), np.eye(4))
                if entry.kind != "fixed":
                    pose = pose @ motion(entry.axis, entry.kind == "prismatic", q.get(entry.name, 0.0))
                poses[entry.child] = pose @ displaced.get(("link", entry.child), np.eye(4))
                waiting.append(entry.child)
        back = np.linalg.inv(poses[base or self.root])
        return {name: back @ pose for name, pose in poses.items()}

    def centres(self, q, base=None) -> dict[str, tuple[float, np.ndarray]]:
        """Return mass and centre of mass of every link in ``base``."""
        poses = self.poses(q, base)
        return {
            name: (mass, poses[name][:3, :3] @ com + poses[name][:3, 3]) for name, (mass, com) in self.masses.items()
        }

    def potential(self, q, gravity=GRAVITY, base=None) -> float:
        return -sum(mass * float(np.dot(gravity, centre)) for mass, centre in self.centres(q, base).values())

    def load_torque(self, names, q, gravity=GRAVITY, base=None) -> np.ndarray:
        """Return -∂U/∂q, exact to rounding."""
        return np.array(
            [-derivative(self, name, lambda values: self.potential(values, gravity, base), q) for name in names]
        )

    def beyond(self, name: str, base: str | None = None) -> set[str]:
        """Return the links that a joint carries, seen from ``base``."""
        found = {base or self.root}
        while True:
            more = set()
            for entry in self.joints:
                ends = {entry.parent, entry.child}
                if entry.name != name and ends & found:
                    more |= ends - found
            if not more:
                return {self.root, *(entry.child for entry in self.joints)} - found
            found |= more


def derivative(reading: PlainRobot, name: str, function, q: Mapping[str, float]):
    """Return the derivative to a joint value, exact to rounding.

    A turn enters poses and centres as a + b cos q + c sin q, so the difference over ±π/2 is exact; a slide linearly.
    """
    (kind,) = (entry.kind for entry in reading.joints if entry.name == name)
    step = 0.5 if kind == "prismatic" else np.pi / 2
    ahead, behind = (function({**q, name: q.get(name, 0.0) + sign * step}) for sign in (1, -1))
    return (ahead - behind) / (1.0 if kind == "prismatic" else 2.0)


def geometric_jacobian(reading: PlainRobot, names, tip: str, q, base=None) -> np.ndarray:
    """Return the derivative of the tip's pose to joint values, base axes at the tip, ``(6, n)``."""
    rotation = reading.poses(q, base)[tip][:3, :3]
    columns = []
    for name in names:
        slope = derivative(reading, name, lambda values: reading.poses(values, base)[tip], q)
        spin = slope[:3, :3] @ rotation.T
        columns.append([*slope[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]])
    return np.array(columns).T


def _plain_joint(node) -> PlainJoint:
    origin = np.eye(4)
    placed = node.find("origin")
    if placed is not None:
        rpy = np.array(placed.get("rpy", "0 0 0").split(), dtype=float)
        origin[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        origin[:3, 3] = np.array(placed.get("xyz", "0 0 0").split(), dtype=float)
    axis = None if node.get("type") == "fixed" else node.find("axis")
    direction = np.array([1.0, 0, 0]) if axis is None else unit(np.array(axis.get("xyz").split(), dtype=float))
    return PlainJoint(
        node.get("name"),
        node.get("type"),
        node.find("parent").get("link"),
        node.find("child").get("link"),
        origin,
        direction,
    )
