"""The sheet of a calibrated arm, and the frame in which an instrument with a free base read it: a best-fit datum.

With readings of equal deviations the error seen in the instrument's axes is, to first order, the error against the best
fit of the tip at all of them: what is left of the arm and of the instrument's noise in the fit are independent.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from precision_pin.analyses.calibration.calibrate import CalibrationResult
from precision_pin.analyses.calibration.instrument import fitted_covariance, length_stds
from precision_pin.base.errors import InputError, SheetError
from precision_pin.base.files import UnreadableFileError, read_text_file
from precision_pin.robot.datums import Datum
from precision_pin.robot.examples import ELSEWHERE
from precision_pin.robot.joint_columns import sheet_values
from precision_pin.sheet.text import read_text

FRAME: Final = "measured"
"""Name of the datum in the sheet."""
MOST_POSES: Final = 100
"""Largest number of its poses: 100,000 robots take 2 s longer. The best fit of fewer is another frame: of 30 of 40 readings
of a UR5 that is 1.5 mm off it was 0.15 mm from that of all."""


def measured_frame(result: CalibrationResult) -> dict[str, Any] | None:
    """Return the entry of the datum in a sheet; None if the base was known or the readings do not determine a frame.

    Of more than :data:`MOST_POSES` poses some are taken, evenly over the readings. The standard deviation is such that
    they weigh as much as all readings: the instrument's times the root of the number of poses per reading. The point is
    the target, of several their mean: a robot's errors of attitude displace it otherwise than the tip.
    """
    data, chain = result.data, result.original.chain
    bases = [part.base_name if part.displaces_base else None for part in data.measurements]
    free = [base for base in bases if base is not None]
    if not free:
        return None
    has_weight = ~np.isin(np.arange(len(data)), [error.reading for error in result.gross_errors])
    rows = np.flatnonzero(np.isin(data.part, [k for k, base in enumerate(bases) if base == free[0]]) & has_weight)
    _, first = np.unique(data.q[:, rows], axis=1, return_index=True)
    poses = rows[np.sort(first)]
    chosen = poses[np.unique(np.linspace(0, len(poses) - 1, MOST_POSES).round().astype(int))]
    stds = length_stds(fitted_covariance(data, [set_up.base for set_up in result.set_ups]))
    std = float(np.sqrt(len(chosen) / (1 / np.square(stds[rows])).sum()))
    joint_values = list(data.q[:, chosen].T)
    target = np.mean([result.set_ups[part].target for part in data.part[rows]], axis=0)
    try:
        Datum.best_fit(joint_values, std).maps(np.array([chain.with_target(target).at(q).pose for q in joint_values]))
    except InputError:
        return None
    texts = [sheet_values(chain.joint_names, chain.prismatic, q.tolist()) for q in joint_values]
    point = " ".join(f"{1e3 * value:.6g}" for value in target)
    return {"best_fit": {"std": f"{1e3 * std:.6g} mm", "point": f"{point} mm", "poses": texts}}


_MAX_SHEET_BYTES: Final = 4 * 2**20
"""Largest sheet that is read, bytes."""
_ROBOT: Final = re.compile(r"^robot[ \t]*:.*\n?", re.MULTILINE)
_FRAME: Final = re.compile(rf"^[ \t]+# readings: .*\n[ \t]+{FRAME}: \{{best_fit: [^}}]*\}}\}}\n", re.MULTILINE)
_DATUMS: Final = re.compile(r"^datums[ \t]*:[ \t]*(?:#.*)?\n(?=([ \t]+)\S)", re.MULTILINE)
_KEY: Final = re.compile(r"^calibrated[ \t]*:.*\n?", re.MULTILINE)


def result_name(sheet: str) -> str:
    """Return the file name of the result next to a sheet: ``arm.calibration.json`` for ``arm.errors.yaml``."""
    return Path(sheet).name.removesuffix(".yaml").removesuffix(".yml").removesuffix(".errors") + ".calibration.json"


def calibrated_sheet(original: str, new: str, frame: Mapping[str, Any] | None = None) -> str:
    """Return the text of the sheet ``original`` with the key ``calibrated``, to be written at ``new``.

    ``frame`` is an entry of :func:`measured_frame`: the datum of the sheet, unless it has one of its own.

    In another folder the robot gets its full path. Sheets there that name tables, and keys that share lines, are rejected.
    """
    folder = Path(original).resolve().parent
    try:
        text = read_text_file(original, _MAX_SHEET_BYTES)
        data = dict(read_text(text, original).data)
        if folder != Path(new).resolve().parent:
            if _names_tables(data):
                raise InputError(
                    f"the calibrated sheet must be in the folder of {original}, which names tables next to it"
                )
            if not data["robot"].startswith(ELSEWHERE):
                data["robot"] = str(folder / data["robot"])
                text = _ROBOT.sub(lambda _: f"robot: {json.dumps(data['robot'])}\n", text)
        data["calibrated"] = result_name(new)
        text = _KEY.sub("", text).rstrip("\n") + f"\ncalibrated: {json.dumps(data['calibrated'])}\n"
        if frame is not None:
            data["datums"] = {**data.get("datums", {}), FRAME: frame}
            text = _with_frame(text, frame)
            if "datum" not in data:
                data["datum"] = FRAME
                text += f"datum: {FRAME}\n"
        is_same = read_text(text, new).data == data
    except UnreadableFileError as error:
        raise InputError(f"{original} {error.reason}") from None
    except SheetError:
        is_same = False
    if not is_same:
        raise InputError(f"the result cannot be added to {original}; write each of its keys on its own line")
    return text


def _with_frame(text: str, frame: Mapping[str, Any]) -> str:
    """Return the text of a sheet with the frame among its datums, in the place of that of a calibration before."""
    std, point, poses = frame["best_fit"].values()
    listed = ",\n".join(f"      {json.dumps(pose)}" for pose in poses)
    entry = f"{FRAME}: {{best_fit: {{std: {std}, point: {point}, poses: [\n{listed}]}}}}\n"
    comment = f"# readings: {len(poses)} of their poses, with the weight of all\n"
    if not _DATUMS.search(text := _FRAME.sub("", text)):
        text = re.sub(r"^datums[ \t]*:[ \t]*\n", "", text, flags=re.MULTILINE)
        return f"{text}datums:\n  {comment}  {entry}"
    return _DATUMS.sub(lambda match: f"{match[0]}{match[1]}{comment}{match[1]}{entry}", text)


def _names_tables(data: object) -> bool:
    if isinstance(data, dict):
        return "file" in data or any(map(_names_tables, data.values()))
    return isinstance(data, list) and any(map(_names_tables, data))
