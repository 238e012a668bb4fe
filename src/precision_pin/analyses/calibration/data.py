"""Measured poses of one robot: joint values and readings, from arrays or a CSV file, and the first guess of the set-up.

    joint1 [deg], joint2 [deg], x [mm], y [mm], z [mm], std [mm], group
    10, -35, 812.31, 143.02, 455.80, 0.02, 1

A column for each joint and each number of a reading, with its unit in brackets: ``x y z`` of a position; ``rx ry rz`` too of
a pose, the rotation vector of the measured attitude; ``distance`` of a distance. ``std`` is the standard deviation of the
row's lengths, ``group`` a whole number for rows that are left out together. At contact nothing need be read: ``height`` over a
plane, and ``x y z`` from the socket, are zero if left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from precision_pin.analyses.calibration.design import Station
from precision_pin.base import csv_columns, se3, units
from precision_pin.base.arguments import check_numbers, check_path
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError, nearest
from precision_pin.base.files import csv_text
from precision_pin.base.record import Record
from precision_pin.base.se3 import log_rotation
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain, pose_findings
from precision_pin.robot.trajectory import joint_columns
from precision_pin.sheet.measurement import Anchor, Measurement, Plane, Sockets

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
class CalibrationData(Record):
    """Readings at P poses.

    Attributes
    ----------
    q
        Joint values in chain order, rad and m, ``(n, P)``.
    readings
        ``(P, m)``, m and rad: a position, a position and rotation vector, a distance, a height or an offset from a socket.
    std, group
        Standard deviation of each reading's lengths, m, and number of its group, ``(P,)``; empty for the instrument's, for none.
    file, lines
        Where the data were read, and the rows of the file or of the arrays, from 1, ``(P,)``.
    """

    q: Array
    readings: Array
    std: Array
    group: Array
    file: str
    lines: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.readings)


def read_data(model: ErrorModel, data: object, measurement: Measurement) -> CalibrationData:
    """Return data given as the path of a CSV file, as :class:`CalibrationData`, or as a pair of poses and readings."""
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


def poses_csv(chain: Chain, q: Array) -> str:
    """Return joint values ``(n, P)`` as ``--trajectory`` reads them, in degrees and mm."""
    headings, columns = _joints(chain, q)
    return csv_text(headings, zip(*columns, strict=True))


def readings_csv(chain: Chain, q: Array, kind: str, readings: Array, std: float, comments: Sequence[str]) -> str:
    """Return readings ``(P, m)`` (m, rad; ``std`` in m) of one robot as ``calibrate`` reads them, below lines of comment."""
    headings, columns = _joints(chain, q)
    more, values = _readings(COLUMNS[kind], readings)
    stds = [_short(1e3 * std)] * len(readings)
    return csv_text([*headings, *more, "std [mm]"], zip(*columns, *values, stds, strict=True), comments)


def cycles_csv(names: Sequence[str], cycles: int, kind: str, readings: Array, comments: Sequence[str]) -> str:
    """Return measured cycles as ``iso9283 --measured`` reads them.

    The readings ``(P·n, m)``, m and rad, of kind ``"position"`` or ``"pose"``, are those of all cycles at one pose after another.
    """
    more, values = _readings(COLUMNS[kind], readings)
    visits = [(name, str(cycle)) for name in names for cycle in range(1, cycles + 1)]
    rows = zip(visits, *values, strict=True)
    return csv_text(["pose", "cycle", *more], ((*visit, *cells) for visit, *cells in rows), comments)


def _joints(chain: Chain, q: Array) -> tuple[list[str], list[list[str]]]:
    """Return headings with units, and the columns of the joints in full."""
    columns = joint_columns(chain.joint_names, chain.prismatic)
    # 1e-12 degrees: what is left of a conversion from degrees and back
    values = [(row / one.factor).tolist() for one, row in zip(columns, q, strict=True)]
    return [one.heading for one in columns], [[repr(round(value, 12)) for value in row] for row in values]


def _readings(names: Sequence[str], readings: Array) -> tuple[list[str], list[list[str]]]:
    """Return headings with units, and the columns of the readings, to 1 nm and 1 nrad."""
    headings = [f"{name} [{'mrad' if name.startswith('r') else 'mm'}]" for name in names]
    return headings, [[_short(value) for value in column] for column in (1e3 * readings.T).tolist()]


def _short(value: float) -> str:
    return f"{value:.6f}"


@final
@dataclass(frozen=True, eq=False)
class SetUp(Record):
    """Set-up of the instrument as estimated; what does not belong to the readings is ``None``.

    Attributes
    ----------
    base
        The robot's base in the instrument's axes, ``(4, 4)``; ``None`` where it is known.
    target, anchor, plane, sockets
        In tool axes, ``(3,)``; in base axes ``(3,)``, point and unit normal ``(2, 3)``, and ``(S, 3)``; m.
    std
        Standard deviation of each unknown number, m and rad.
    """

    base: Array | None
    target: Array
    anchor: Array | None
    plane: Array | None
    sockets: Array | None
    std: dict[str, float]

    @classmethod
    def of(cls, measurement: Measurement, base: Array, nuisances: Array, covariance: Array) -> SetUp:
        """Return the set-up of estimated nuisances ``(k,)`` beside a first guess of the base."""
        value = dict(zip(measurement.nuisances, nuisances.tolist(), strict=True))
        axes = ("x", "y", "z")
        target = np.array(measurement.target) + [value.get(f"target.{axis}", 0.0) for axis in axes]
        anchor, placed, plane, sockets = None, None, None, None
        place = measurement.place
        own = np.zeros(0) if place is None else np.array([value.get(name, 0.0) for name in place.names])
        if isinstance(place, Anchor):
            anchor = np.array(place.place) + own
        elif isinstance(place, Plane):
            plane = np.array(place.tilted(own))
        elif isinstance(place, Sockets):
            sockets = np.array(place.places) + own.reshape(-1, 3)
        elif measurement.base == "free":
            placed = base @ se3.displacement(nuisances[:6])
        deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
        return cls(placed, target, anchor, plane, sockets, dict(zip(measurement.nuisances, deviations, strict=True)))


def first_guess(data: CalibrationData, stations: Sequence[Station], measurement: Measurement) -> tuple[Array, Array]:
    """Return the base in the instrument's axes, ``(4, 4)``, that fits the nominal arm best, and the nuisances beside it."""
    nuisances = np.zeros(len(measurement.nuisances))
    if measurement.base == "known" or measurement.kind in ("plane", "socket"):
        return np.eye(4), nuisances
    nominal, turns = np.zeros((len(data), 3)), np.zeros((3, 3))
    plain = Measurement("pose", target=measurement.target)
    for station in stations:
        pose = station.at.posture.pose
        predicted = plain.predict(pose, station.at.error_at_means[:, None], np.zeros((0, 1)))[:, 0]
        nominal[list(station.rows)] = predicted[:3]
        for row in station.rows if measurement.kind == "pose" else ():
            expected = se3.exp_rotation(predicted[3:]) @ pose[:3, :3]
            turns += se3.exp_rotation(data.readings[row, 3:]) @ expected.T
    if measurement.kind == "distance":
        nuisances[:3] = _anchor(nominal, data.readings[:, 0]) - measurement.anchor
        return np.eye(4), nuisances
    measured = data.readings[:, :3]
    centre, other = nominal.mean(axis=0), measured.mean(axis=0)
    if measurement.kind == "position":
        turns = (measured - other).T @ (nominal - centre)
        values = np.linalg.svd(turns, compute_uv=False)
        if len(nominal) < 3 or values[1] < 1e-6 * values[0]:
            raise InputError("a free base needs at least three positions that do not lie on one line")
    left, _, right = np.linalg.svd(turns)
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return se3.pose(rotation, other - rotation @ centre), nuisances


def _anchor(points: Array, distances: Array) -> Array:
    """Return the anchor ``(3,)`` from which points ``(P, 3)`` have these distances best: ``|p|² - d² = 2 p·a - |a|²``."""
    centre = points.mean(axis=0)
    near = points - centre
    rows = np.hstack([2 * near, -np.ones((len(near), 1))])
    if len(near) < 4 or np.linalg.svd(near, compute_uv=False)[2] < 1e-6 * np.abs(near).max():
        raise InputError("a free anchor needs distances of at least four points that do not lie in one plane")
    found = np.linalg.lstsq(rows, (near**2).sum(axis=1) - distances**2, rcond=None)[0]
    anchor: Array = centre + found[:3]
    return anchor


def readings_in_base(
    data: CalibrationData, stations: Sequence[Station], base: Array, measurement: Measurement
) -> Array:
    """Return readings ``(P, m)`` as :meth:`Measurement.predict` returns them: in base axes, turns from the nominal attitude."""
    if measurement.place is not None:
        return data.readings
    rotation = base[:3, :3]
    result = data.readings.copy()
    result[:, :3] = (data.readings[:, :3] - base[:3, 3]) @ rotation
    if measurement.kind == "pose":
        for station in stations:
            nominal = station.at.posture.pose[:3, :3]
            for row in station.rows:
                attitude = rotation.T @ se3.exp_rotation(data.readings[row, 3:])
                result[row, 3:] = se3.log_rotation(attitude @ nominal.T)
    return result


def check_data(model: ErrorModel, data: CalibrationData) -> Iterator[Finding]:
    """Yield warnings about data: poses outside limits, and rows that are given twice."""
    yield from pose_findings(model.chain, data.q)
    rows = np.hstack([data.q.T, data.readings])
    _, first, counts = np.unique(rows, axis=0, return_index=True, return_counts=True)
    twice = np.sort(first[counts > 1])
    if twice.size:
        row = int(twice[0])
        again = int(np.flatnonzero((rows == rows[row]).all(axis=1))[1])
        message = (
            f"the rows {data.lines[row]} and {data.lines[again]} are the same to the last digit, and so are "
            f"{int(counts.sum() - len(counts))} in all; a reading copied is no second reading, leave it out"
        )
        yield Finding(
            "warning", "W_REPEATED_READING", message, data.file or None, data.lines[again] if data.file else None
        )
