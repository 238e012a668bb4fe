"""The arms of the journeys: how a user gets each one, and where Pinocchio says its tip is."""

from __future__ import annotations

import csv
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from precision_pin.robot.examples import PAPER_SHEET, example_urdfs

_LINK = """<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>
  <axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="100" velocity="1"/></joint>"""


def _urdf(name: str, joints: list[tuple[str, str, str, str, float, float]], tool: str) -> str:
    """Return a robot of joints (name, kind, place, axis, limits) with a link of 3 kg behind each, and a tool."""
    parts, parent = ['<link name="base"/>'], "base"
    for joint, kind, xyz, axis, low, high in joints:
        link = f"{joint}_link"
        parts.append(_LINK.format(name=link, com="0.1 0 0", mass=3))
        parts.append(
            _JOINT.format(name=joint, kind=kind, parent=parent, child=link, xyz=xyz, axis=axis, low=low, high=high)
        )
        parent = link
    parts.append(
        f'<link name="tool"/><joint name="flange" type="fixed"><parent link="{parent}"/><child link="tool"/>'
        f'<origin xyz="{tool}"/></joint>'
    )
    return f'<robot name="{name}">\n' + "\n".join(parts) + "\n</robot>\n"


GANTRY = _urdf(
    "gantry",
    [
        ("x_axis", "prismatic", "0 0 1", "1 0 0", -0.8, 0.8),
        ("y_axis", "prismatic", "0.1 0 0.1", "0 1 0", -0.5, 0.5),
        ("z_axis", "prismatic", "0.15 0 0", "0 0 1", -0.4, 0.0),
        ("wrist", "revolute", "0.1 0 -0.2", "0 0 1", -3.0, 3.0),
    ],
    "0.12 0 -0.1",
)
SCARA = _urdf(
    "scara",
    [
        ("shoulder", "revolute", "0 0 0.3", "0 0 1", -2.4, 2.4),
        ("elbow", "revolute", "0.35 0 0.05", "0 0 1", -2.4, 2.4),
        ("quill", "prismatic", "0.3 0 0", "0 0 1", -0.2, 0.0),
        ("wrist", "revolute", "0 0 -0.1", "0 0 1", -3.1, 3.1),
    ],
    "0.05 0 -0.05",
)


@dataclass(frozen=True)
class Arm:
    """An arm, and what its user types to begin."""

    name: str
    given: str
    tip: str

    @property
    def sheet(self) -> str:
        """Name of the sheet that ``init`` writes."""
        return f"{self.name}.errors.yaml"

    def bring(self, folder: Path) -> bool:
        """Put the robot's file into the folder; False where the robot is not installed."""
        if self.given.startswith("example:"):
            return self.name in example_urdfs()
        if self.name == "4dof":
            shutil.copy(PAPER_SHEET.with_name("4dof.urdf"), folder)
        else:
            (folder / self.given).write_text({"gantry": GANTRY, "scara": SCARA}[self.name])
        return True

    def urdf(self, folder: Path) -> Path:
        """Return the robot's file."""
        return Path(example_urdfs()[self.name]) if self.given.startswith("example:") else folder / self.given


ARMS = {
    arm.name: arm
    for arm in (
        Arm("4dof", "4dof.urdf", "tool"),
        Arm("ur5", "example:ur5", "tool0"),
        Arm("panda", "example:panda", "panda_hand_tcp"),
        Arm("gantry", "gantry.urdf", "tool"),
        Arm("scara", "scara.urdf", "tool"),
    )
}


SLIDES = {"x_axis", "y_axis", "z_axis", "quill"}
"""Joints whose values are in m."""


def text_of(q: dict[str, float]) -> str:
    """Return joint values for ``--q``."""
    return ", ".join(f"{name}: {value!r} {'m' if name in SLIDES else 'rad'}" for name, value in q.items())


class Pinocchio:
    """A URDF as Pinocchio reads it, by itself."""

    def __init__(self, file: Path, tip: str) -> None:
        self.model = pin.buildModelFromUrdf(str(file))
        self.data = self.model.createData()
        self.frame = self.model.getFrameId(tip)

    def pose(self, q: dict[str, float]) -> pin.SE3:
        """Return the tip at joint values, rad and m; other joints at their neutral ones."""
        values = pin.neutral(self.model)
        for name, value in q.items():
            joint = self.model.joints[self.model.getJointId(name)]
            # a joint without limits is the cosine and sine of its angle
            values[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        pin.framesForwardKinematics(self.model, self.data, values)
        return self.data.oMf[self.frame]

    def points(self, poses: list[dict[str, float]], target: np.ndarray | None = None) -> np.ndarray:
        """Return the place of a point in tool axes, the tip if left out, at each pose, m, ``(P, 3)``."""
        return np.array([self.pose(q).act(np.zeros(3) if target is None else target) for q in poses])


SI = {"deg": np.pi / 180, "rad": 1.0, "mm": 1e-3, "m": 1.0, "mrad": 1e-3}


def _plain(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def rows_of(file: Path) -> list[dict[str, float | str]]:
    """Return the rows of a CSV file by the names of its columns, SI (without a unit as they are); comments are left out."""
    lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    heads, *rows = csv.reader(lines)
    found = []
    for row in rows:
        one: dict[str, float | str] = {}
        for head, cell in zip(heads, row, strict=True):
            name, _, unit = head.partition(" [")
            one[name] = float(cell) * SI[unit.rstrip("]")] if unit else _plain(cell)
        found.append(one)
    return found
