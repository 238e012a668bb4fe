"""Measured poses of one robot: joint values and readings, from arrays or a CSV file.

    joint1 [deg], joint2 [deg], x [mm], y [mm], z [mm], std [mm], group
    10, -35, 812.31, 143.02, 455.80, 0.02, 1

A column for each joint and each number of a reading, with its unit in brackets: ``x y z`` of a position; ``rx ry rz`` too of
a pose, the rotation vector of the measured attitude; ``distance`` of a distance. ``std`` is the standard deviation of the
row's lengths, ``group`` a whole number for rows that are left out together. At contact nothing need be read: ``height`` over a
plane, and ``x y z`` from the socket, are zero if left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from precision_pin.base import csv_columns, units
from precision_pin.base.arguments import check_numbers, check_path
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, nearest
from precision_pin.base.se3 import log_rotation
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.sheet.measurement import Measurement

COLUMNS: Final = {
    "position": ("x", "y", "z"),
    "pose": ("x", "y", "z", "rx", "ry", "rz"),
    "distance": ("distance",),
    "plane": ("height",),
    "socket": ("x", "y", "z"),
}
"""Names of the numbers of a reading, by kind: lengths, those with an r angles."""
_CONTACT: Final = ("plane", "socket")
"""Kinds whose readings are zero if left out."""
_LARGEST_TURN: Final = 4 * np.pi
_FAR: Final = 10.0
"""Joint values this many times beyond their limits, in units of the range, are taken for a wrong unit."""


@final
@dataclass(frozen=True, eq=False)
class CalibrationData:
    """Readings at P poses.

    Attributes
    ----------
    q
        Joint values in chain order, rad and m, ``(n, P)``.
    readings
        ``(P, m)``, m and rad: a position, a position and rotation vector, a distance, a height or an offset from a socket.
    std
        Standard deviation of each reading's lengths, m, ``(P,)``; empty for the instrument's.
    group
        Number of the group of each reading, ``(P,)``; empty for none.
    file
        Where the data were read.
    lines
        Rows of the file or of the arrays, from 1, ``(P,)``.
    """

    q: Array
    readings: Array
    std: Array
    group: Array
    file: str
    lines: tuple[int, ...]

    def __post_init__(self) -> None:
        fix_fields(self)

    def __len__(self) -> int:
        return len(self.readings)


def read_data(model: ErrorModel, data: object, measurement: Measurement) -> CalibrationData:
    """Return data given as the path of a CSV file, as :class:`CalibrationData`, or as a pair of poses and readings.

    Raises
    ------
    InputError
        A column is missing or has the wrong unit, a pose is impossible, or the readings have the wrong shape.
    """
    if isinstance(data, CalibrationData):
        return data
    if isinstance(data, tuple | list) and len(data) == 2:
        return _of_arrays(model, data[0], data[1], measurement)
    return _of_file(model, check_path("the data", data), measurement)


def _of_arrays(model: ErrorModel, poses: Any, readings: Any, measurement: Measurement) -> CalibrationData:
    q, _ = model.configurations(poses)
    count = q.shape[1]
    is_contact = readings is None and measurement.kind in _CONTACT
    given = np.zeros((count, measurement.size)) if is_contact else np.asarray(readings)
    if measurement.kind == "pose" and given.ndim == 3 and given.shape[1:] == (4, 4):
        matrices = check_numbers("the readings", readings, (count, 4, 4))
        turns = log_rotation(np.moveaxis(matrices[:, :3, :3], 0, -1)).T
        values = np.concatenate([matrices[:, :3, 3], turns], axis=1)
    else:
        if given.ndim == 1 and measurement.size == 1:
            given = given[:, None]
        needs = f"a row of {measurement.size} numbers for each of {count} poses, m and rad"
        values = check_numbers("the readings", given, (count, measurement.size), needs)
    return CalibrationData(q, values, np.zeros(0), np.zeros(0), "", tuple(range(1, count + 1)))


def _of_file(model: ErrorModel, path: str, measurement: Measurement) -> CalibrationData:
    table = csv_columns.read(path)
    chain, wanted = model.chain, COLUMNS[measurement.kind]
    known = (*chain.joint_names, *wanted, "std", "group")
    for name in table.names:
        if name not in known:
            raise _wrong(path, f"the column {name!r} is not expected; {nearest(name, known)}", 1)
    if measurement.kind in _CONTACT and not set(wanted) & set(table.names):
        wanted = ()
    missing = [name for name in (*chain.joint_names, *wanted) if name not in table.names]
    if missing:
        raise _wrong(path, f"no column for {', '.join(missing)}; a {measurement.kind} needs {', '.join(wanted)}", 1)
    joints = [
        table.column(joint.name, units.LENGTH if joint.kind == "prismatic" else units.ANGLE) for joint in chain.joints
    ]
    q = np.array(joints)
    lengths = [name for name in wanted if not name.startswith("r")]
    columns = [table.column(name, units.LENGTH if name in lengths else units.ANGLE) for name in wanted]
    readings = np.array(columns).T if wanted else np.zeros((q.shape[1], measurement.size))
    std = np.array(table.column("std", units.LENGTH)) if "std" in table.names else np.zeros(0)
    if std.size and not (std > 0).all():
        raise _wrong(path, "std must be above zero", int(np.argmin(std)) + 2)
    group = table.rows[:, table.names.index("group")] if "group" in table.names else np.zeros(0)
    _check_joint_values(chain, q, path, table)
    lines = tuple(range(2, q.shape[1] + 2))
    return CalibrationData(q, readings, std, group, path, lines)


def _check_joint_values(chain: Chain, q: Array, path: str, table: csv_columns.Measured) -> None:
    low, high = chain.configurations.limits
    for k, joint in enumerate(chain.joints):
        unit = table.unit(joint.name)
        span = high[k] - low[k] if np.isfinite(high[k] - low[k]) else 2 * np.pi
        middle = (high[k] + low[k]) / 2 if np.isfinite(high[k] - low[k]) else 0.0
        beyond = np.abs(q[k] - middle) > (0.5 + _FAR) * span
        if joint.kind != "prismatic":
            beyond |= np.abs(q[k]) > _LARGEST_TURN
        if beyond.any():
            row = int(np.argmax(beyond))
            value = table.rows[row, table.names.index(joint.name)]
            hint = "; are these degrees?" if unit == "rad" and joint.kind != "prismatic" else ""
            raise _wrong(path, f"{joint.name} = {value:g} {unit} is far outside its limits{hint}", row + 2)


def _wrong(path: str, message: str, line: int | None = None) -> InputError:
    return InputError([Finding("error", "E_DATA", message, path, line)])
