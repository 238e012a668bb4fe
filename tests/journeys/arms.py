"""The arms of the journeys and where Pinocchio says their tips are, tolerances of a sheet as a user finds them, every command."""

import csv
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.cli.program import list_commands
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import read as read_sheet
from support.plain_robot import joint, link, robot


def _urdf(joints: list[tuple[str, str, tuple[float, ...], tuple[int, ...], tuple[float, float]]], tool) -> str:
    """Return a robot of joints (name, kind, place, axis, limits) with a link of 3 kg behind each, and a tool."""
    parts, parent = [link("base")], "base"
    for name, kind, xyz, axis, (low, high) in joints:
        child, limits = f"{name}_link", f'<limit lower="{low}" upper="{high}" effort="100" velocity="1"/>'
        parts += [link(child, 3.0, (0.1, 0, 0)), joint(name, kind, parent, child, xyz, axis=axis, extra=limits)]
        parent = child
    return robot(*parts, link("tool"), joint("flange", "fixed", parent, "tool", tool))


X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
GANTRY = _urdf(
    [
        ("x_axis", "prismatic", (0, 0, 1), X, (-0.8, 0.8)),
        ("y_axis", "prismatic", (0.1, 0, 0.1), Y, (-0.5, 0.5)),
        ("z_axis", "prismatic", (0.15, 0, 0), Z, (-0.4, 0.0)),
        ("wrist", "revolute", (0.1, 0, -0.2), Z, (-3.0, 3.0)),
    ],
    (0.12, 0, -0.1),
)
SCARA = _urdf(
    [
        ("shoulder", "revolute", (0, 0, 0.3), Z, (-2.4, 2.4)),
        ("elbow", "revolute", (0.35, 0, 0.05), Z, (-2.4, 2.4)),
        ("quill", "prismatic", (0.3, 0, 0), Z, (-0.2, 0.0)),
        ("wrist", "revolute", (0, 0, -0.1), Z, (-3.1, 3.1)),
    ],
    (0.05, 0, -0.05),
)
ARMS = {"4dof": PAPER_SHEET.with_name("4dof.urdf").read_text(), "gantry": GANTRY, "scara": SCARA}
"""URDFs, each of which a journey or test_pairs takes; all of them end in ``tool``."""
SLIDES = {"x_axis", "y_axis", "z_axis", "quill"}
"""Joints whose values are in m."""


def text_of(q: dict[str, float]) -> str:
    """Return joint values for ``--q``."""
    return ", ".join(f"{name}: {value!r} {'m' if name in SLIDES else 'rad'}" for name, value in q.items())


class Pinocchio:
    """A URDF as Pinocchio reads it, by itself."""

    def __init__(self, file: Path, tip: str = "tool") -> None:
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


def rows_of(file: Path) -> list[dict[str, float]]:
    """Return the rows of a CSV file by the names of those columns that have units, SI; comments are left out."""
    lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    return [
        {name[:-1]: float(cell) * SI[unit] for name, _, unit, cell in cells(row) if unit}
        for row in csv.DictReader(lines)
    ]


def cells(row: dict[str, str]) -> list[tuple[str, str, str, str]]:
    return [(*head.rstrip("]").partition("["), cell) for head, cell in row.items()]


_KINDS = ("frame", "length", "joint_offset", "axis_install", "mounting")
"""Sources whose tolerances are lengths or angles."""


class Tolerance:
    """A tolerance that a budget names, with the share of the position's variance that comes from it."""

    def __init__(self, path: str, value: Any) -> None:
        self.path, self.value, self.share = path, value, 0.0
        # the width itself, within its law
        self.number_path, width = path, value
        while isinstance(width, dict):
            key = next(key for key in ("uniform", "normal", "std") if key in width)
            self.number_path, width = f"{self.number_path}.{key}", width[key]
        self.text = str(width)
        self.quantity = "mm" if self.text.split()[-1] in ("mm", "um", "m") else "mrad"

    def times(self, factor: float) -> str:
        """Return the value with another width, for ``--set``."""
        number, unit = self.text.split()
        new = f"{float(number) * factor:.9g} {unit}"
        return f"{self.path}=" + json.dumps(self.value, default=str).replace(self.text, new)


def ranked(sheet: Path, budget: Any) -> list[Tolerance]:
    """Return the tolerances that can be changed, that with the largest share in the first pose of a budget first."""
    found: dict[str, Tolerance] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionPinWarning)
        read = read_sheet(sheet)
    for line in budget["poses"][0]["draws"]:
        kind, _, rest = line["name"].partition("[")
        label, _, setting = line["name"].rpartition("]")
        if kind not in _KINDS or "#" in rest or line["share"]["position"] is None:
            continue
        setting = "radius" if kind == "axis_install" else setting.lstrip(".")
        path = f"{label}].{setting}"
        if path not in found:
            values = list(read.contents.values_at(read, path).values())
            if len(values) != 1:
                continue
            found[path] = Tolerance(path, values[0])
        found[path].share += line["share"]["position"]
    return sorted(found.values(), key=lambda one: -one.share)


READERS: dict[str, tuple[str, ...]] = {
    "analyze": ("--samples", "200"),
    "budget": ("--samples", "1024"),
    "worst-case": ("--samples", "200"),
    "exact-law": ("--samples", "2000"),
    "reliability": ("--spec", "5 mm @ 90 %", "--samples", "2000"),
    "moments": ("--samples", "4096"),
    "iso9283": ("--robots", "20", "--cycles", "2"),
    "check": (),
    "mcpc": (),
    "view": ("--samples", "20", "--out", "view.html"),
    "report": ("--samples", "200", "--out", "report.html"),
    "export": ("--out", "built"),
    "calibrate": ("--forecast", "--random", "5"),
    "simulate": ("--out", "simulated.csv"),
    "map": ("--all-poses", "--verify", "0"),
    "path": ("--all-poses", "--samples", "100"),
    "compare": ("--samples", "200", "--set", "statics=equilibrium"),
    "compensate": ("--all-poses",),
    "stiffness": ("--robots", "50"),
    "allocate": (),
}
"""Arguments beside the sheet; ``allocate`` needs its key in the sheet."""
WITHOUT_SHEET = {"init", "explain", "schema", "doctor"}
ANSWERS = {"reliability", "compensate", "allocate"}
"""Commands whose exit code 1 is an answer: a limit missed, a pose without a correction."""


assert set(list_commands()) == set(READERS) | WITHOUT_SHEET


def codes(command: str) -> tuple[int, ...]:
    """Return the exit codes of a command that has read its files."""
    return (0, 1) if command in ANSWERS else (0,)
