"""The robots that are changed: small, of different shapes, with every element that URDF knows."""

from __future__ import annotations

import importlib.metadata
import math
import random
from functools import cache
from pathlib import Path

__all__ = ["base_robots"]

SHIPPED = (
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
    "asr_twodof_description/urdf/TwoDofs.urdf",
    "finger_edu_description/robots/finger_edu.urdf",
    "so_arm_description/urdf/so100.urdf",
    "z1_description/urdf/z1.urdf",
    "panda_description/urdf/panda.urdf",
)
GENERATED = 6


@cache
def base_robots() -> tuple[str, ...]:
    """Return the texts: generated arms first, then the project's own, then small shipped ones where installed."""
    project = Path(__file__).parents[2] / "src" / "precision_pin" / "robots" / "4dof.urdf"
    texts = [arm(shape) for shape in range(GENERATED)]
    texts += [full_arm(), gripper(), project.read_text(encoding="utf-8")]
    return (*texts, *(file.read_text(encoding="utf-8") for file in _shipped()))


def arm(shape: int) -> str:
    """Return a plain arm of 1 to 6 joints with random origins and axes; every third joint slides."""
    chance = random.Random(f"arm {shape}")
    parts = [_link("base", 3.0, chance)]
    for k in range(1, shape + 2):
        kind = ("revolute", "continuous", "prismatic")[(k + shape) % 3]
        parts.append(_joint(f"joint{k}", kind, "base" if k == 1 else f"link{k - 1}", f"link{k}", chance))
        parts.append(_link(f"link{k}", round(chance.uniform(0.2, 4), 3), chance))
    parts.append(_joint("flange", "fixed", f"link{shape + 1}", "tool", chance))
    parts.append('  <link name="tool"/>')
    return _robot(parts)


def full_arm() -> str:
    """Return an arm that holds every element and attribute that readers know."""
    chance = random.Random("full")
    looks = (
        '    <visual name="hull"><origin xyz="0 0 0.1" rpy="0 0 0"/><geometry><box size="0.1 0.1 0.2"/></geometry>'
        '<material name="grey"/></visual>\n'
        '    <visual><geometry><mesh filename="package://arm/meshes/a.stl" scale="0.001 0.001 0.001"/></geometry>'
        '<material name="own"><color rgba="0.1 0.2 0.3 1"/></material></visual>\n'
        '    <collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision>\n'
        '    <collision><geometry><sphere radius="0.05"/></geometry></collision>\n'
    )
    extra = (
        '    <dynamics damping="0.1" friction="0.2"/>\n'
        '    <safety_controller k_velocity="10" k_position="15" soft_lower_limit="-2" soft_upper_limit="2"/>\n'
        '    <calibration rising="0.1"/>\n'
    )
    parts = [
        '  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>',
        '  <material name="wood"><texture filename="wood.png"/></material>',
        _link("base", 3.0, chance, looks),
        _joint("turn", "revolute", "base", "post", chance, extra),
        _link("post", 2.0, chance, looks),
        _joint("lift", "prismatic", "post", "sled", chance),
        _link("sled", 1.0, chance),
        _joint("roll", "continuous", "sled", "hand", chance, '    <dynamics friction="0.2"/>\n'),
        _link("hand", 0.5, chance, looks),
        _joint("bolt", "fixed", "hand", "tool", chance),
        '  <link name="tool"/>',
        '  <gazebo reference="hand"><material>Gazebo/Grey</material></gazebo>',
        '  <transmission name="t1"><type>x</type><joint name="turn"/></transmission>',
    ]
    return _robot(parts)


def gripper() -> str:
    """Return an arm with two branches, fixed parts between, and fingers of which one mimics the other."""
    chance = random.Random("gripper")
    parts = [
        '  <link name="world"/>',
        _joint("mount", "fixed", "world", "base", chance),
        _link("base", 5.0, chance),
        _joint("a1", "revolute", "base", "upper", chance),
        _link("upper", 2.0, chance),
        _joint("camera_mount", "fixed", "upper", "camera", chance),
        _link("camera", 0.1, chance),
        _joint("a2", "continuous", "upper", "fore", chance),
        _link("fore", 1.5, chance),
        _joint("wrist", "fixed", "fore", "palm", chance),
        _link("palm", 0.6, chance),
        _joint("finger", "prismatic", "palm", "left", chance),
        _link("left", 0.05, chance),
        _joint("follower", "prismatic", "palm", "right", chance, '    <mimic joint="finger" multiplier="-1"/>\n'),
        _link("right", 0.05, chance),
        _joint("centre", "fixed", "palm", "tcp", chance),
        '  <link name="tcp"/>',
    ]
    return _robot(parts)


def _robot(parts: list[str]) -> str:
    return '<?xml version="1.0" encoding="UTF-8"?>\n<robot name="arm">\n' + "\n".join(parts) + "\n</robot>\n"


def _link(name: str, mass: float, chance: random.Random, looks: str = "") -> str:
    # a box of these edges: physical whatever they are
    x, y, z = (chance.uniform(0.05, 0.4) for _ in range(3))
    moments = (mass / 12 * (y * y + z * z), mass / 12 * (x * x + z * z), mass / 12 * (x * x + y * y))
    ixx, iyy, izz = (f"{moment:.9g}" for moment in moments)
    return (
        f'  <link name="{name}">\n{looks}    <inertial><origin xyz="{_three(chance, 0.2)}" rpy="{_three(chance, 2)}"/>'
        f'<mass value="{mass}"/><inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/></inertial>\n'
        "  </link>"
    )


def _joint(name: str, kind: str, parent: str, child: str, chance: random.Random, extra: str = "") -> str:
    x, y, z = (chance.gauss(0, 1) for _ in range(3))
    length = math.sqrt(x * x + y * y + z * z)
    axis = f'    <axis xyz="{x / length!r} {y / length!r} {z / length!r}"/>\n' if kind != "fixed" else ""
    limit = (
        '    <limit lower="-2" upper="2.5" effort="50" velocity="1.5"/>\n' if kind in ("revolute", "prismatic") else ""
    )
    return (
        f'  <joint name="{name}" type="{kind}">\n    <parent link="{parent}"/>\n    <child link="{child}"/>\n'
        f'    <origin xyz="{_three(chance, 0.5)}" rpy="{_three(chance, 3)}"/>\n{axis}{limit}{extra}  </joint>'
    )


def _three(chance: random.Random, most: float) -> str:
    return " ".join(f"{chance.uniform(-most, most):.6g}" for _ in range(3))


def _shipped() -> list[Path]:
    try:
        distribution = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        return []
    packages = [file for file in distribution.files or () if file.name == "package.xml"]
    folders = [Path(str(distribution.locate_file(file))).parent / "robots" for file in packages]
    return [folder / name for folder in folders for name in SHIPPED if (folder / name).is_file()]
