"""The arm of a set: sheet of its calibration and model as delivered, by a URDF, an example or Denavit and Hartenberg."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

import precision_pin as pp
from benchmarks.measured.declared import Declaration, Dh, MissingSet
from precision_pin.robot.examples import ELSEWHERE, PREFIX, shipped_sheets
from precision_pin.robot.urdf.reader import mended

URDF: Final = "\n# URDF\n"
"""Line of a sheet's text after which its URDF stands."""


def arm(declared: Declaration, folder: Path) -> tuple[str, pp.ErrorModel, str]:
    """Return the text of the calibration sheet, the model of an arm as delivered, and where that is from."""
    ends = {"tip": declared.tip, "base": declared.base}
    if declared.dh is not None:
        return *drafts(dh_urdf(declared.dh), **ends), "init"
    if not declared.arm[0].startswith(ELSEWHERE):
        return *drafts(described([folder / name for name in declared.arm]), **ends), "init"
    sheet = pp.init(declared.arm[0], calibration=True, **ends)
    if shipped := shipped_sheets().get(declared.arm[0].removeprefix(PREFIX)):
        forecast = pp.ErrorModel.load(shipped)
        if (forecast.chain.tip, forecast.chain.base) == (load(sheet).chain.tip, load(sheet).chain.base):
            return sheet, forecast, "shipped"
    return sheet, load(pp.init(declared.arm[0], **ends)), "init"


def described(paths: Sequence[Path]) -> str:
    """Return the text of the first URDF that is there, with inertias that a body can have."""
    for path in paths:
        if path.is_file():
            return mended(path)[0].decode("utf-8")
    raise MissingSet(f"no {paths[0].parent.name}/{paths[0].name}")


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


def dh_urdf(dh: Dh) -> str:
    """Return the URDF of a table of Denavit and Hartenberg; its thetas are added to joint values, not written here."""
    length, angle = 1e-3 if dh.units[0] == "mm" else 1.0, np.pi / 180 if dh.units[1] == "deg" else 1.0
    lines, origin = ['<robot name="arm">', '<link name="base"/>'], ""
    for k, (a, alpha, d, _) in enumerate(dh.table):
        c, s = np.cos(angle * alpha), np.sin(angle * alpha)
        # from the frame before the joint to that behind it: a, alpha and d as a fixed frame
        shift = np.array([a, -s * d, c * d] if dh.modified else [a, 0, d])
        place = f'<origin xyz="{_text(length * shift)}" rpy="{_text(angle * np.array([alpha, 0, 0]))}"/>'
        body = ""
        if dh.masses:
            mass, *centre = dh.masses[k]
            # a link's frame turns with its joint: the table's own, or the one before a, alpha and d
            turn = np.eye(3) if dh.modified else np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
            at = length * (turn @ centre + (0 if dh.modified else shift))
            body = (
                f'<inertial><origin xyz="{_text(at)}"/><mass value="{mass}"/>'
                '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
            )
        lines += [
            f'<link name="link{k + 1}">{body}</link>',
            f'<joint name="joint{k + 1}" type="revolute"><parent link="{f"link{k}" if k else "base"}"/>'
            f'<child link="link{k + 1}"/>{place if dh.modified else origin}<axis xyz="0 0 1"/>'
            '<limit lower="-6.3" upper="6.3" effort="1" velocity="1"/></joint>',
        ]
        origin = "" if dh.modified else place
    return "\n".join(
        [
            *lines,
            '<link name="tool0"/>',
            f'<joint name="flange" type="fixed"><parent link="link{len(dh.table)}"/><child link="tool0"/>{origin}</joint>',
            "</robot>",
        ]
    )


def _text(numbers: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in numbers)
