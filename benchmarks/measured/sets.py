"""Sets of data that others published, as they lie in a folder: what was read, by which arm, and what the publishers had."""

from __future__ import annotations

import csv
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

import precision_pin as pp
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.configurations import approaches_along
from precision_pin.robot.examples import shipped_sheets
from precision_pin.robot.ur_kinematics import MODELS
from precision_pin.robot.urdf.reader import mended

URDF: Final = "\n# URDF\n"
"""Line of a sheet's text after which its URDF stands."""

FOLDS: Final = 5
"""Groups left out one after another where the publishers set no poses apart: row i belongs to group i mod 5."""


@dataclass(frozen=True)
class Rows:
    """Joint values ``(n, P)``, rad or m, points read ``(T, P, 3)``, m, in the instrument's axes, and approaches ``(n, P)``."""

    q: Array
    points: Array
    approaches: NDArray[np.int8]

    @classmethod
    def in_order(cls, q: Array, points: Array) -> Rows:
        """Return rows whose joints came from the row before."""
        return cls(q, points, approaches_along(q))

    def __len__(self) -> int:
        return self.q.shape[1]

    def __getitem__(self, rows: object) -> Rows:
        return Rows(self.q[:, rows], self.points[:, rows], self.approaches[:, rows])  # type: ignore[index]


@dataclass(frozen=True)
class MeasuredSet:
    """A robot and its readings.

    Attributes:
        robot, instrument: In words.
        sheet: Text of the sheet of ``init --calibration``.
        forecast, forecast_by: Model of an arm as delivered, and where it is from.
        fit, judged: Readings to fit and readings set apart; ``None``: groups of the first are left out.
        guess: Where the first target is about, in tool axes, m.
        as_measured: Mean distance from the publishers' own targets at the poses set apart, m; ``None`` without.
        published: What the publishers had at these poses, m; ``None`` if nothing is known.
        notes: What is remarkable in the data.
    """

    robot: str
    instrument: str
    sheet: str
    forecast: pp.ErrorModel
    forecast_by: str
    fit: Rows
    judged: Rows | None = None
    guess: tuple[float, float, float] = (0.0, 0.0, 0.0)
    as_measured: float | None = None
    published: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Factory:
    """A robot by the calibration of its factory: the file, its type, and the model of an arm as delivered."""

    path: Path
    kind: str
    forecast: pp.ErrorModel
    forecast_by: str


class MissingSet(Exception):
    """What a set lacks, to be said to the user."""


def columns(path: Path, names: Sequence[str]) -> Array:
    """Return columns of a CSV file by name, ``(len(names), P)``."""
    if not path.is_file():
        raise MissingSet(f"no {path.parent.name}/{path.name}")
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    if not rows or (missing := [name for name in names if name not in rows[0]]):
        raise MissingSet(f"{path.parent.name}/{path.name} has no {f'column {missing[0]}' if rows else 'rows'}")
    try:
        return np.array([[float(row[name]) for row in rows] for name in names])
    except (TypeError, ValueError):
        raise MissingSet(f"{path.parent.name}/{path.name}: a cell of {', '.join(names)} is not a number") from None


def tracker(folder: Path, joints: int) -> tuple[Rows, Rows, float]:
    """Return grid, random poses and the mean distance of the latter from their targets, m, as the tracker's sets have them.

    A difference is what was read less its target: with this sign the arms sag under their weight, with the other they rise.
    """
    names = [f"{axis}_{kind}" for kind in ("t", "dif") for axis in "xyz"] + [f"joint_{k + 1}" for k in range(joints)]
    rows, distance = [], 0.0
    for name in ("grid.csv", "random.csv"):
        values = columns(folder / name, names)
        measured = 1e-3 * (values[:3] + values[3:6]).T
        rows.append(Rows.in_order(np.radians(values[6:]), measured[None]))
        distance = 1e-3 * float(np.linalg.norm(values[3:6], axis=0).mean())
    return rows[0], rows[1], distance


def ur5_tracker(folder: Path) -> MeasuredSet:
    """Return the UR5 of a thesis: 1,000 poses to fit, 20 to judge."""
    fit, judged, distance = tracker(folder, 6)
    try:
        sheet = pp.init("example:ur5", tip="tool0", calibration=True)
    except InputError as error:
        raise MissingSet(f"example:ur5 cannot be read ({error.findings[0].message})") from None
    forecast = pp.ErrorModel.load(shipped_sheets()["ur5"])
    return MeasuredSet(
        *("UR5", "laser tracker", sheet, forecast, "shipped", fit, judged, (0.0, 0.0, 0.031), distance, 0.155e-3),
    )


# a, alpha, d of each joint, m and rad; mass and centre of mass in the frame behind it, kg and m, as Barrett publishes them
WAM: Final = (
    (0, -np.pi / 2, 0, 10.76768767, (-0.00443422, 0.12189039, -0.00066489)),
    (0, np.pi / 2, 0, 3.87493756, (-0.00236983, 0.03105614, 0.01542114)),
    (0.045, -np.pi / 2, 0.55, 1.80228141, (-0.03825858, 0.20750770, 0.00003309)),
    (-0.045, np.pi / 2, 0, 2.40016804, (0.00498512, -0.00022942, 0.13271662)),
    (0, -np.pi / 2, 0.3, 0.12376019, (0.00008921, 0.00511217, 0.00435824)),
    (0, np.pi / 2, 0, 0.41797364, (-0.00012262, -0.01703194, 0.02468336)),
    (0, 0, 0.06, 0.06864753, (-0.00007974, 0.00016313, -0.00323552)),
)


def wam_tracker(folder: Path) -> MeasuredSet:
    """Return the WAM of the same thesis: 216 poses to fit, 20 to judge."""
    fit, judged, distance = tracker(folder, 7)
    urdf = dh_urdf("wam", [row[:3] for row in WAM], [row[3:] for row in WAM])
    sheet, forecast = drafts(urdf)
    guess = (0.0, 0.0, 0.044)
    return MeasuredSet("WAM", "laser tracker", sheet, forecast, "init", fit, judged, guess, distance, 2.92e-3)


def talos(folder: Path) -> MeasuredSet:
    """Return the left arm of a TALOS: 61 contacts."""
    joints = ["torso_1_joint", "torso_2_joint", *(f"arm_left_{k}_joint" for k in range(1, 8))]
    values = columns(folder / "left-arm-contact.csv", ["x1", "y1", "z1", *joints])
    sheet, forecast = drafts(described(folder / "talos.urdf"), "arm_left_7_link", "base_link")
    rows = Rows.in_order(values[3:], values[None, :3].mT)
    return MeasuredSet("TALOS, left arm", "contact", sheet, forecast, "init", rows)


def tiago(folder: Path) -> MeasuredSet:
    """Return the arm and torso of a TIAGo: four markers, of which some columns may repeat others."""
    joints = ["torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8))]
    names = [f"{axis}{k}" for k in range(1, 5) for axis in "xyz"]
    values = columns(folder / "mocap-four-markers.csv", [*names, *joints])
    points = values[:12].reshape(4, 3, -1).mT
    kept, notes = [0, 1, 2, 3], []
    for k in range(1, 4):
        for j in [j for j in kept if j < k]:
            same = int((points[j] == points[k]).all(axis=1).sum())
            if same:
                kept = [other for other in kept if other != k and (same == len(points[k]) or other != j)]
                which = f"{k + 1} is" if same == len(points[k]) else f"{j + 1} and {k + 1} are"
                notes.append(
                    f"marker {k + 1} repeats marker {j + 1} in {same} of {len(points[k])} rows: {which} not used"
                )
    sheet, forecast = drafts(described(folder / "tiago.urdf"), "arm_7_link", "base_link")
    rows = Rows.in_order(values[12:], points[kept])
    return MeasuredSet(
        "TIAGo", f"motion capture, {len(kept)} markers", sheet, forecast, "init", rows, notes=tuple(notes)
    )


SETS: Final[dict[str, Callable[[Path], MeasuredSet]]] = {
    "ur5-tracker": ur5_tracker,
    "wam-tracker": wam_tracker,
    "talos": talos,
    "tiago": tiago,
}


def factories(folder: Path) -> Iterator[Factory]:
    """Yield the robots of a folder of factory calibrations, ``TYPE-ANYTHING.yaml``."""
    known = {kind.lower().replace(" ", ""): kind for kind in MODELS}
    models: dict[str, tuple[pp.ErrorModel, str]] = {}
    paths = sorted(folder.glob("*.yaml")) if folder.is_dir() else []
    if not paths:
        raise MissingSet(f"no {folder.name}/TYPE-*.yaml")
    for path in paths:
        kind = path.name.partition("-")[0]
        if kind not in known:
            raise MissingSet(f"{folder.name}/{path.name} does not begin with a type such as ur5e-")
        if kind not in models:
            models[kind] = ur_model(known[kind])
        yield Factory(path, known[kind], *models[kind])


def ur_model(kind: str) -> tuple[pp.ErrorModel, str]:
    """Return the model of a UR as delivered, by the shipped sheet or by that of ``init``, and which."""
    if sheet := shipped_sheets().get(kind.lower()):
        try:
            return pp.ErrorModel.load(sheet), "shipped"
        except InputError:  # its URDF is not installed
            pass
    d1, a2, a3, d4, d5, d6 = MODELS[kind]
    steps = ((0, 1, d1), (a2, 0, 0), (a3, 0, 0), (0, 1, d4), (0, -1, d5), (0, 0, d6))
    urdf = dh_urdf(kind.lower(), [(a, turn * np.pi / 2, d) for a, turn, d in steps])
    return drafts(urdf)[1], "init"


def described(path: Path) -> str:
    """Return the text of a URDF, with inertias that a body can have."""
    if not path.is_file():
        raise MissingSet(f"no {path.parent.name}/{path.name}")
    return mended(path)[0].decode("utf-8")


def drafts(urdf: str, tip: str | None = None, base: str | None = None) -> tuple[str, pp.ErrorModel]:
    """Return the calibration sheet and the model of the drafted sheet of a URDF's text."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(urdf, encoding="utf-8")
        sheet, draft = (
            re.sub("^robot: .*$", "robot: arm.urdf", text, count=1, flags=re.MULTILINE) + URDF + urdf
            for text in (pp.init(path, tip=tip, base=base, calibration=calibration) for calibration in (True, False))
        )
    return sheet, load(draft)


def load(sheet: str) -> pp.ErrorModel:
    """Return the model of a sheet's text; a URDF that follows it is written beside it."""
    text, _, urdf = sheet.partition(URDF)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.errors.yaml"
        path.write_text(text, encoding="utf-8")
        path.with_name("arm.urdf").write_text(urdf, encoding="utf-8")
        return pp.ErrorModel.load(path)


def dh_urdf(name: str, steps: Sequence[Sequence[float]], masses: Sequence[Sequence[object]] = ()) -> str:
    """Return the URDF of an arm by Denavit and Hartenberg: a, alpha, d of each joint, m and rad; masses, centres behind it."""
    lines, origin = [f'<robot name="{name}">', '<link name="base"/>'], ""
    for k, (a, alpha, d) in enumerate(steps):
        body = ""
        if masses:
            mass, centre = masses[k]
            # the link's frame turns with the joint, before a, alpha and d
            x, y, z = centre  # type: ignore[misc]
            place = np.array([a, 0, d]) + np.array(
                [x, np.cos(alpha) * y - np.sin(alpha) * z, np.sin(alpha) * y + np.cos(alpha) * z]
            )
            body = (
                f'<inertial><origin xyz="{" ".join(map(repr, place.tolist()))}"/><mass value="{mass}"/>'
                '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
            )
        lines += [
            f'<link name="link{k + 1}">{body}</link>',
            f'<joint name="joint{k + 1}" type="revolute"><parent link="{f"link{k}" if k else "base"}"/>'
            f'<child link="link{k + 1}"/>{origin}<axis xyz="0 0 1"/>'
            '<limit lower="-6.3" upper="6.3" effort="1" velocity="1"/></joint>',
        ]
        origin = f'<origin xyz="{float(a)!r} 0 {float(d)!r}" rpy="{float(alpha)!r} 0 0"/>'
    return "\n".join(
        [
            *lines,
            '<link name="tool0"/>',
            f'<joint name="flange" type="fixed"><parent link="link{len(steps)}"/><child link="tool0"/>{origin}</joint>',
            "</robot>",
        ]
    )
