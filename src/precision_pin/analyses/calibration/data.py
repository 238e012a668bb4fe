"""Measured poses of one robot: joint values and readings, from arrays or CSV files.

    joint1 [deg], joint2 [deg], x [mm], y [mm], z [mm], std [mm], group
    10, -35, 812.31, 143.02, 455.80, 0.02, 1

There is a column for each joint and each number of a reading, with its unit in brackets: ``x y z`` of a position; also
``rx ry rz`` of a pose, the rotation vector of the measured attitude; ``distance`` of a distance. ``std`` is the
standard deviation of the row's lengths, or ``sx sy sz`` that of each, in the axes of the readings; ``group`` a whole
number for rows that are left out together; ``joint1_read`` … what encoders read where ``joint1`` … are commanded;
``joint1_speed`` … how fast joints still moved; ``temperature`` that of the row, of which only differences count. At
contact no reading is needed: ``height`` over a plane, and ``x y z`` from the socket, default to zero. ``x1 y1 z1 x2 …``
are several targets on the tool. A cell that is empty, nan or NA is a missing reading. Times are ignored, but where the
instrument may drift: then a row with a name in the column ``fixed`` is of a target that stands still, whatever the joints
are, and so is each row of a file without joints, with that column.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.calibration.drift import NO_FIXED_READINGS, FixedReadings, Session
from precision_pin.analyses.readings import COLUMNS, joint_cells
from precision_pin.base import csv_columns, units
from precision_pin.base.arguments import check_numbers, check_path
from precision_pin.base.arrays import Array, Record
from precision_pin.base.errors import Finding, InputError, nearest, some
from precision_pin.base.files import csv_text
from precision_pin.base.se3 import log_rotation, nearest_rotation
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain, pose_findings
from precision_pin.robot.configurations import ApproachedPose, joint_quantity
from precision_pin.robot.joint_columns import recorded
from precision_pin.sheet.drift import Drift
from precision_pin.sheet.measurement import Measurement

CONTACT: Final = ("plane", "socket")
"""Kinds whose readings default to zero."""
_FEW: Final = 8
"""Rows from which distances between targets are checked."""
READ: Final = "_read"
"""End of the name of a column with a joint's value as read, beside the commanded one."""
SPEED: Final = "_speed"
"""End of the name of a column with a joint's speed when the row was read."""
_RIGID: Final = 0.01
"""Standard deviation of the distance between targets, in std of the instrument, below which they are not independent."""


@dataclass(frozen=True, eq=False)
class CalibrationData(Record):
    """P readings.

    Attributes:
        q: Joint values in chain order, rad and m, ``(n, P)``.
        readings: ``(P, m)``, m and rad: a position, a position and rotation vector, a distance, a height or an offset
            from a socket; NaN beyond the numbers of a shorter reading.
        std, group: Standard deviation of each reading's lengths, m, and its group number, ``(P,)``; empty for the
            instrument's, and for none. A NaN stands for that of an instrument with a line of sight.
        axis_ratios: Standard deviations of the three lengths of each reading over ``std``, root mean square 1, in the
            axes of the readings, ``(P, 3)``; empty for ones.
        file, lines: Source of the data, and the rows of the file or arrays, from 1, ``(P,)``.
        measurements, files: The measurements, one for each target in each file, and the file of each.
        part, visit: Number of each reading's measurement, ``(P,)``, and of its visit: readings of one were taken
            together.
        findings: What was left out.
        sessions: Readings of one instrument after another that may have drifted; ``readings`` are less what is known of it.
        q_read, temperature: Joint values as read where ``q`` are commanded, ``(n, P)``, and temperatures, K up to a
            constant, ``(P,)``; empty if none are given.
        speed: Joint speeds when the row was read, rad/s and m/s, ``(n, P)``; empty if none are given.
        approaches: Direction in which each joint moved last, ``(n, P)``; empty if it is not known.
    """

    q: Array
    readings: Array
    std: Array
    group: Array
    file: str
    lines: tuple[int, ...]
    measurements: tuple[Measurement, ...] = ()
    files: tuple[str, ...] = ()
    part: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    visit: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    findings: tuple[Finding, ...] = ()
    axis_ratios: Array = field(default_factory=lambda: np.zeros((0, 3)))
    sessions: tuple[Session, ...] = ()
    q_read: Array = field(default_factory=lambda: np.zeros((0, 0)))
    temperature: Array = field(default_factory=lambda: np.zeros(0))
    speed: Array = field(default_factory=lambda: np.zeros((0, 0)))
    approaches: NDArray[np.int8] = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int8))

    def __post_init__(self) -> None:
        if not self.part.size:
            object.__setattr__(self, "part", np.zeros(len(self), dtype=np.intp))
            object.__setattr__(self, "visit", np.arange(len(self)))
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.readings)

    def label(self, reading: int) -> str:
        """Return the label of a reading: its row, and its target and file if there are several."""
        part = int(self.part[reading])
        names = {measurement.target_name for measurement in self.measurements}
        target = f", target {self.measurements[part].target_name}" if len(names) > 1 else ""
        return f"row {self.lines[reading]}{target}{f' of {self.files[part]}' if len(set(self.files)) > 1 else ''}"


def read_data(model: ErrorModel, data: object, measurements: tuple[Measurement, ...]) -> CalibrationData:
    """Return data given as such, or as CSV paths or pairs of poses and readings: one a measurement, or one file."""
    if isinstance(data, CalibrationData):
        return data if data.measurements else replace(data, measurements=measurements, files=(data.file,))
    sources: list[Any] = [data]
    if isinstance(data, tuple | list):
        is_listed = len(measurements) > 1 or all(isinstance(entry, str | os.PathLike) for entry in data)
        sources = list(data) if is_listed else sources
    sources, fixed_files = _without_fixed(model, sources)
    if len(sources) not in (1, len(measurements)):
        raise InputError(
            f"{len(sources)} files or arrays of data and {len(measurements)} measurement{'s' * (len(measurements) > 1)}: list "
            "one for each (in the sheet, measurement: [{...}, ...]); several robots need --population"
        )
    measurement_groups = [measurements] if len(sources) == 1 else [(measurement,) for measurement in measurements]
    parts = []
    for k, (source, source_measurements) in enumerate(zip(sources, measurement_groups, strict=True)):
        if isinstance(source, tuple | list) and len(source) == 2 and len(source_measurements) == 1:
            parts.append(_read_arrays(model, source[0], source[1], source_measurements[0]))
        else:
            parts.append(_read_file(model, check_path("the data", source), source_measurements, fixed_files.get(k)))
    return parts[0] if len(parts) == 1 else _concatenate(parts)


def approached(model: ErrorModel, data: CalibrationData, approach: object) -> CalibrationData:
    """Return data whose poses have an approach, ``"previous"``: the way from row to row, in their order."""
    _, first, visit = np.unique(data.visit, return_index=True, return_inverse=True)
    q = np.ascontiguousarray(data.q[:, first])
    signs = model.approaches_of(ApproachedPose(q, approach), q)
    return data if signs is None else replace(data, approaches=np.ascontiguousarray(signs[:, visit]))


def _concatenate(parts: Sequence[CalibrationData]) -> CalibrationData:
    width = max(part.readings.shape[1] for part in parts)
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    part_offsets = np.cumsum([0, *(len(part.measurements) for part in parts)])
    visit_offsets = np.cumsum([0, *(int(part.visit.max(initial=-1)) + 1 for part in parts)])
    # one number says less than the line of sight
    stds = [np.array([np.nan if m.sight else m.std for m in part.measurements])[part.part] for part in parts]
    # a reading without a group forms a group of one
    free_group = 1 + max((part.group.max() for part in parts if part.group.size), default=0)
    groups = [free_group + part.visit + k for part, k in zip(parts, starts, strict=False)]
    return CalibrationData(
        np.ascontiguousarray(np.hstack([part.q for part in parts])),
        np.concatenate([_padded(part.readings, width) for part in parts]),
        _joined([part.std for part in parts], stds),
        _joined([part.group for part in parts], groups),
        parts[0].file,
        tuple(line for part in parts for line in part.lines),
        tuple(measurement for part in parts for measurement in part.measurements),
        tuple(file for part in parts for file in part.files),
        np.concatenate([part.part + k for part, k in zip(parts, part_offsets, strict=False)]),
        np.concatenate([part.visit + k for part, k in zip(parts, visit_offsets, strict=False)]),
        tuple(finding for part in parts for finding in part.findings),
        np.ascontiguousarray(
            _joined([part.axis_ratios.T for part in parts], [np.ones((3, len(part))) for part in parts]).T
        ),
        tuple(session.moved(k) for part, k in zip(parts, starts, strict=False) for session in part.sessions),
        _joined([part.q_read for part in parts]),
        _joined([part.temperature for part in parts]),
        _joined([part.speed for part in parts]),
        _joined([part.approaches for part in parts], [np.zeros(part.q.shape, np.int8) for part in parts]),
    )


def _joined(arrays: Sequence[NDArray[Any]], usual: Sequence[NDArray[Any]] | None = None) -> NDArray[Any]:
    """Return arrays ``(…, P)`` of the parts side by side, the usual one for a part without; empty if none has any.

    Without usual ones it is empty unless every part has one.
    """
    if usual is not None and any(array.size for array in arrays):
        arrays = [array if array.size else other for array, other in zip(arrays, usual, strict=True)]
    is_whole = all(array.size for array in arrays)
    return np.hstack(arrays) if is_whole else np.zeros((0,) * arrays[0].ndim, arrays[0].dtype)


def _without_fixed(model: ErrorModel, sources: list[Any]) -> tuple[list[Any], dict[int, str]]:
    """Return the sources of the arm's readings, and the file of fixed targets of each, which follows it."""
    others, fixed = list[Any](), dict[int, str]()
    for source in sources:
        names = csv_columns.names_in(os.fspath(source)) if isinstance(source, str | os.PathLike) else set()
        if _FIXED not in names or names & set(model.chain.joint_names):
            others.append(source)
        elif not others or len(others) - 1 in fixed:
            raise _error(os.fspath(source), "a file of fixed targets follows that of the arm's readings")
        else:
            fixed[len(others) - 1] = os.fspath(source)
    return others, fixed


def _padded(readings: Array, width: int) -> Array:
    return np.hstack([readings, np.full((len(readings), width - readings.shape[1]), np.nan)])


def _read_arrays(model: ErrorModel, poses: Any, readings: Any, measurement: Measurement) -> CalibrationData:
    q, _ = model.configurations(poses)
    count = q.shape[1]
    is_contact = readings is None and measurement.kind in CONTACT
    raw = np.zeros((count, measurement.size)) if is_contact else np.asarray(readings)
    is_read = np.ones(count, dtype=bool)
    if raw.dtype.kind == "f" and len(raw) == count:
        is_read = np.asarray(~np.isnan(raw.reshape(count, -1)).any(axis=1))
        raw = raw[is_read]
    findings = _missing_findings("the reading", ~is_read, range(1, count + 1), "")
    selected = np.flatnonzero(is_read)
    rows = len(selected)
    if measurement.kind == "pose" and raw.ndim == 3 and raw.shape[1:] == (4, 4):
        matrices = check_numbers("the readings", raw, (rows, 4, 4))
        rotations = log_rotation(np.moveaxis(matrices[:, :3, :3], 0, -1)).T
        values = np.concatenate([matrices[:, :3, 3], rotations], axis=1)
    else:
        if raw.ndim == 1 and measurement.size == 1:
            raw = raw[:, None]
        needs = f"a row of {measurement.size} numbers for each of {count} poses, m and rad"
        values = check_numbers("the readings", raw, (rows, measurement.size), needs)
    if not is_contact:
        contents = [row.tobytes() for row in np.hstack([q[:, selected].T, values])]
        originals, repeats = _drop_copies(contents, (selected + 1).tolist(), "")
        findings += repeats
        selected, values = selected[originals], values[originals]
    if not len(selected):
        raise _error("", "no valid readings; check units and missing cells")
    lines, empty = tuple((selected + 1).tolist()), np.zeros(0)
    sessions = tuple[Session, ...]()
    if measurement.drift is not None:
        if not measurement.drift.is_counted:
            raise _error("", "arrays have no times; give a file with a column of them, or drift: {every: 100 readings}")
        is_free, times = measurement.base == "free", selected.astype(float)
        sessions = (Session.of(times, NO_FIXED_READINGS, measurement.drift, is_free=is_free),)
    signs, given = model.approaches_of(poses, q), (np.ascontiguousarray(q[:, selected]), values, empty, empty)
    data = CalibrationData(*given, "", lines, (measurement,), ("",), findings=tuple(findings), sessions=sessions)
    return data if signs is None else replace(data, approaches=np.ascontiguousarray(signs[:, selected]))


def _missing_findings(quantity: str, is_missing: NDArray[np.bool_], lines: Sequence[int], path: str) -> list[Finding]:
    where = np.flatnonzero(is_missing)
    if not where.size:
        return []
    message = f"{quantity} is missing in {where.size:,} of {len(lines):,} rows, which are left out"
    return [Finding("warning", "W_MISSING_READING", message, path or None, lines[int(where[0])] if path else None)]


def _drop_copies(rows: Sequence[object], lines: Sequence[int], path: str) -> tuple[list[int], list[Finding]]:
    first_rows: dict[object, int] = {}
    copies = [(k, first_rows[row]) for k, row in enumerate(rows) if first_rows.setdefault(row, k) != k]
    if not copies:
        return list(range(len(rows))), []
    copy, original = copies[0]
    message = (
        f"{len(copies):,} of {len(rows):,} rows repeat another to the last digit and are left out, the first of them row "
        f"{lines[copy]}, which is row {lines[original]} again; a column such as t distinguishes repeated readings"
    )
    warning = Finding("warning", "W_REPEATED_READING", message, path or None, lines[copy] if path else None)
    return list(first_rows.values()), [warning]


def _read_file(
    model: ErrorModel, path: str, measurements: tuple[Measurement, ...], fixed_path: str | None = None
) -> CalibrationData:
    chain, drift = model.chain, measurements[0].drift
    if any(measurement.drift != drift for measurement in measurements):
        raise _error(path, "several measurements read the file with different drift")
    names = csv_columns.ColumnNames.parse(", ".join(dict.fromkeys(m.columns for m in measurements if m.columns)))
    clock = _Clock.of(path, names, chain.joint_names, drift, fixed_path)
    table = _table(path, chain, measurements, names, clock)
    targets = [target for m in measurements for target in _targets(table, chain.joint_names, m, len(measurements) == 1)]
    _check_columns(chain, table, targets, clock.name)
    if len({measurement.coupled for measurement in measurements}) > 1:
        raise _error(path, "several measurements read the file with different coupled joints")
    mixing = measurements[0].mixing(chain)
    q, q_read, speed = (_joint_columns(table, chain, mixing, end) for end in ("", READ, SPEED))
    temperature = _column(table, "temperature", units.TEMPERATURE_DIFFERENCE)
    temperature = temperature if np.isfinite(temperature).any() else np.zeros(0)
    std, target_stds = _stds(table, targets)
    group = table.rows[:, table.names.index("group")] if "group" in table.names else np.zeros(0)
    if (group % 1 > 0).any():
        raise _error(path, "group must be a whole number", table.lines[int(np.flatnonzero(group % 1 > 0)[0])])
    _check_joint_values(chain, q, table)
    q, q_read = (chain.configurations.taken(values) if values.size else values for values in (q, q_read))
    is_fixed = np.array(table.texts.get(_FIXED, ("",) * len(table.rows))) != ""
    extras = [values for values in (std, group, temperature) if values.size]
    has_pose = np.isfinite(np.vstack([q, q_read, speed, *extras])).all(axis=0)
    missing = "a joint value or speed, temperature, std or group"
    findings = [*_notes(table, clock), *_missing_findings(missing, ~has_pose & ~is_fixed, table.lines, path)]
    target_readings = [_values(table, columns, target) for target, columns in targets]
    usable, doubts = _usable(table, targets, target_readings, target_stds, has_pose & ~is_fixed)
    present = [k for k in range(len(targets)) if usable[k].any()]
    if not present:
        why = "every row is of a fixed target" if is_fixed.all() else "check units and missing cells"
        raise _error(path, f"no valid readings; {why}")
    # row by row, so that the targets of a row follow each other
    reading_rows, part = np.nonzero(np.array([usable[k] for k in present]).T)
    width = max(target.size for target, _ in targets)
    readings = np.array([_padded(target_readings[k], width) for k in present])[part, reading_rows]
    row_std, ratios = std[reading_rows] if std.size else std, np.zeros((0, 3))
    if target_stds[0].size:
        axis_stds = np.array([target_stds[k] for k in present])[part, reading_rows]
        row_std = np.sqrt((axis_stds**2).mean(axis=1))
        ratios = axis_stds / row_std[:, None]
    sessions = tuple[Session, ...]()
    if clock.is_needed:
        other = table if fixed_path is None else csv_columns.read(fixed_path, (_FIXED,), columns=names, may_miss=True)
        first = present[0]
        origin = _instrument(model, targets[first][0], q[:, usable[first]], target_readings[first][usable[first], :3])
        times, fixed = clock.times(table), _fixed_readings(other, clock, targets[first], origin)
        session = Session.of(times[reading_rows], fixed, drift, is_free=measurements[0].base == "free")
        readings[:, :3] -= session.left.mean
        sessions = (session,)
    return CalibrationData(
        np.ascontiguousarray(q[:, reading_rows]),
        readings,
        row_std,
        group[reading_rows] if group.size else group,
        path,
        tuple(table.lines[row] for row in reading_rows),
        tuple(targets[k][0] for k in present),
        (path,) * len(present),
        part,
        reading_rows,
        (*findings, *doubts),
        ratios,
        sessions,
        np.ascontiguousarray(q_read[:, reading_rows]),
        temperature[reading_rows] if temperature.size else temperature,
        np.ascontiguousarray(speed[:, reading_rows]),
    )


def _table(
    path: str, chain: Chain, measurements: Sequence[Measurement], names: csv_columns.ColumnNames, clock: _Clock
) -> csv_columns.Measured:
    """Return the columns of a file, renamed and known by recorder, times that nobody needs left out."""
    si = {joint.name: joint_quantity(joint).si for joint in chain.joints}
    read_names = "|".join({name for measurement in measurements for name in COLUMNS[measurement.kind]})
    is_reading = re.compile(rf"(?:{read_names}|s[xyz])_?[0-9A-Za-z]*|std|group|temperature").fullmatch
    return csv_columns.read(
        path,
        clock.texts,
        columns=lambda cells, row: recorded(cells, row, si, names),
        known=lambda name: (
            name.removesuffix(READ).removesuffix(SPEED) in si or is_reading(name) or name in (*clock.texts, clock.name)
        ),
        ignored=[name for name in csv_columns.TIMES if name not in (*si, clock.name.casefold())],
        may_miss=True,
    )


def _notes(table: csv_columns.Measured, clock: _Clock) -> Iterator[Finding]:
    """Yield notes about columns that are not read, and about whose columns they are."""
    unread = [name for name in table.texts if name not in ("", *clock.texts)]
    are = "s {} are" if len(unread) > 1 else " {} is"
    notes = [f"the column{are.format(some(unread, 6))} not read"] * bool(unread)
    notes += [f"read as columns of {table.recorder}"] * bool(table.recorder)
    return (Finding("note", "N_COLUMN", note, table.file, 1) for note in notes)


def _column(table: csv_columns.Measured, name: str, quantity: units.Quantity) -> Array:
    """Return a column in SI, ``(R,)``; empty if the file has none."""
    return np.array(table.column(name, quantity) if name in table.names else ())


def _joint_columns(table: csv_columns.Measured, chain: Chain, mixing: Array, end: str) -> Array:
    """Return the values of joints in the columns whose names end so, ``(n, R)``; ``(0, R)`` if the file has none."""
    names = {f"{joint.name}{end}": joint_quantity(joint) for joint in chain.joints}
    if not set(names) <= set(table.names):
        return np.zeros((0, len(table.rows)))
    rate = units.per_second if end == SPEED else lambda quantity: quantity
    return np.asarray(mixing @ np.array([table.column(name, rate(quantity)) for name, quantity in names.items()]))


def _stds(table: csv_columns.Measured, targets: Sequence[_Target]) -> tuple[Array, list[Array]]:
    """Return the standard deviation of each row, and of each target's lengths ``(R, 3)``; empty if the file has none."""
    std, target_stds = _column(table, "std", units.LENGTH), [_axis_stds(table, columns) for _, columns in targets]
    for values in (std[:, None], *target_stds):
        if (values <= 0).any():
            line = table.lines[int(np.flatnonzero((values <= 0).any(axis=1))[0])]
            raise _error(table.file, "std must be above zero, and so must sx, sy and sz", line)
    sizes = [values.size for values in target_stds]
    if any(sizes) and (std.size or not all(sizes)):
        raise _error(table.file, "give std, or sx, sy and sz of every target", 1)
    return std, target_stds


def _usable(
    table: csv_columns.Measured,
    targets: Sequence[_Target],
    readings: Sequence[Array],
    stds: Sequence[Array],
    is_whole: NDArray[np.bool_],
) -> tuple[list[NDArray[np.bool_]], list[Finding]]:
    """Return the rows in which each target's reading is used, of those that are whole ``(R,)``, and why others are not."""
    unique, repeats = list(range(len(table.rows))), list[Finding]()
    if any(columns for _, columns in targets):
        contents = [(row.tobytes(), *(cells[k] for cells in table.texts.values())) for k, row in enumerate(table.rows)]
        unique, repeats = _drop_copies(contents, table.lines, table.file)
    is_new = np.isin(np.arange(len(table.rows)), unique) & is_whole
    usable, findings = list[NDArray[np.bool_]](), list[Finding]()
    for (_, columns), *values in zip(targets, readings, stds, strict=True):
        is_there = np.isfinite(np.hstack(values)).all(axis=1)
        cells = (*columns, *(_std_columns(columns) if values[1].size else ()))
        findings += _missing_findings(" or ".join(cells), ~is_there & is_new, table.lines, table.file)
        usable.append(is_there & is_new)
    return usable, [*findings, *repeats, *_dependence_findings(targets, readings, usable, table.file)]


_FIXED: Final = "fixed"
"""Column with the names of targets that stand still."""
_MOST_MOVED: Final = 10e-3
"""Distance, m, from its first reading beyond which a fixed target is another one, and not drift."""


class _Clock(NamedTuple):
    """When the rows of a file were read: its column of times, empty where rows are counted, and its columns of text."""

    name: str
    texts: tuple[str, ...]
    is_needed: bool

    @classmethod
    def of(
        cls,
        path: str,
        columns: csv_columns.ColumnNames,
        joints: Sequence[str],
        drift: Drift | None,
        fixed_path: str | None,
    ) -> _Clock:
        """Return the clock of a file; raise if it has none and needs one."""
        in_file = csv_columns.names_in(path)  # empty if it cannot be read, which is said where it is
        names = [*in_file, *(name for name, _ in columns.names.values())]
        texts = (_FIXED,) if _FIXED in names and _FIXED not in joints else ()
        is_needed = drift is not None or bool(texts) or fixed_path is not None
        if drift is not None and drift.is_counted and fixed_path is not None:
            raise _error(fixed_path, "fixed targets in a file of their own need drift: {every: 1 h}, a time")
        if not is_needed or (drift is not None and drift.is_counted):
            return cls("", texts, is_needed)
        times = sorted(name for name in names if _is_time(name) and name not in joints)
        if not times and in_file:
            needs = "drift" if drift is not None else "a fixed target"
            hint = "" if fixed_path else ", or rows that are counted, drift: {every: 100 readings}"
            raise _error(path, f"{needs} needs the time of each reading, a column such as time [s]{hint}", 1)
        return cls(times[0] if times else "", texts, True)

    def times(self, table: csv_columns.Measured) -> Array:
        """Return the time of each row, s or a number of rows; raise for one that is missing or negative."""
        if not self.name:
            return np.arange(len(table.rows), dtype=float)
        name = next((name for name in (self.name, *table.names) if name in table.names and _is_time(name)), None)
        if name is None:
            raise _error(table.file, "fixed targets need the time of each reading, a column such as time [s]", 1)
        unit = table.unit_of(name, units.TIME) or csv_columns.TIMES[name.casefold()]
        if unit not in units.TIME.units:
            allowed = ", ".join(units.TIME.units)
            raise _error(table.file, f"{unit!r} of the column {name!r} is not a unit of time; allowed: {allowed}", 1)
        times: Array = table.rows[:, table.names.index(name)] * units.TIME.units[unit]
        if (wrong := np.flatnonzero(~(times >= 0))).size:
            row = int(wrong[0])
            what = "missing" if np.isnan(times[row]) else f"negative: {times[row]:.6g} s"
            raise _error(table.file, f"the time is {what}", table.lines[row])
        return times


def _is_time(name: str) -> bool:
    return name.casefold() in csv_columns.TIMES


_POINTS: Final = ("position", "pose")
"""Kinds of readings of a point."""


def _instrument(model: ErrorModel, measurement: Measurement, q: Array, points: Array) -> Array | None:
    """Return where the instrument stands in the axes of the points ``(N, 3)`` that it reads, m; ``None`` where none need know.

    Its place in a free base is brought there by the nominal arm at joint values ``(n, N)``: for a distance that is enough.
    """
    is_known = measurement.base == "known" or measurement.kind not in _POINTS or not len(points)
    if measurement.sight is None or measurement.station is None or is_known:
        return None
    poses = model.chain.with_target(measurement.target).at_columns(np.ascontiguousarray(q)).pose
    centre, nominal = points.mean(axis=0), poses[:3, 3].mean(axis=1)
    rotation = nearest_rotation((points - centre).T @ (poses[:3, 3].T - nominal))
    return np.asarray(centre + rotation @ (np.array(measurement.station) - nominal))


def _fixed_readings(table: csv_columns.Measured, clock: _Clock, target: _Target, origin: Array | None) -> FixedReadings:
    """Return the readings of fixed targets, in the columns of a target; raise for one that is read once.

    ``origin`` is that of :func:`_instrument`.
    """
    measurement, columns = target
    labels = np.array(table.texts.get(_FIXED, ("",) * len(table.rows)))
    rows = np.flatnonzero(labels != "")
    if rows.size and measurement.kind not in _POINTS:
        raise _error(table.file, f"fixed targets are read as positions or poses, not as a {measurement.kind}", 1)
    if rows.size and not measurement.std_known:
        raise _error(table.file, "fixed targets need the std of the instrument, not std: estimate", 1)
    points = _values(table, columns[:3], measurement)
    rows = rows[np.isfinite(points[rows]).all(axis=1)]
    names, numbers, counts = np.unique(labels[rows], return_inverse=True, return_counts=True)
    if (counts == 1).any():
        name = names[counts == 1][0]
        line = table.lines[int(rows[labels[rows] == name][0])]
        raise _error(table.file, f"the fixed target {name} is read once; read it again later, or leave it out", line)
    first = rows[np.unique(numbers, return_index=True)[1]][numbers]
    moved = np.linalg.norm(points[rows] - points[first], axis=1)
    if (moved > _MOST_MOVED).any():
        k = int(np.argmax(moved > _MOST_MOVED))
        message = (
            f"the fixed target {names[numbers[k]]} is {1e3 * moved[k]:.4g} mm from where line {table.lines[first[k]]} has it; "
            "another target, or one that was moved, needs another name"
        )
        raise _error(table.file, message, table.lines[rows[k]])
    std, stds = _column(table, "std", units.LENGTH), _axis_stds(table, columns[:3])
    stds = np.repeat(std[:, None], 3, axis=1) if std.size else stds
    covariances = measurement.point_covariances(points[rows], origin)
    if stds.size:
        covariances = np.where(np.isnan(stds), measurement.std, stds)[rows, :, None] ** 2 * np.eye(3)
    return FixedReadings(clock.times(table)[rows], numbers, points[rows], covariances, tuple(names.tolist()))


_Target = tuple[Measurement, tuple[str, ...]]
"""A measurement of one target, and its columns, if any."""


def _std_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the standard deviations of a point's columns: ``sx1`` of ``x1``."""
    return tuple(f"s{name}" for name in columns if name[0] in "xyz")


def _axis_stds(table: csv_columns.Measured, columns: Sequence[str]) -> Array:
    """Return the standard deviations of a target's lengths, ``(rows, 3)``, m; ``(rows, 0)`` if the file has none."""
    names = [name for name in _std_columns(columns) if name in table.names]
    return np.array([table.column(name, units.LENGTH) for name in names]).reshape(len(names), len(table.rows)).T


def _targets(
    table: csv_columns.Measured, joints: Sequence[str], measurement: Measurement, is_alone: bool
) -> list[_Target]:
    components, target_name = COLUMNS[measurement.kind], measurement.target_name
    free_columns = set(table.names) - set(joints)

    def columns(name: str) -> tuple[str, ...]:
        return tuple(f"{component}{name}" for component in components)

    if target_name or free_columns & set(components):
        name = next((name for name in (target_name, f"_{target_name}") if free_columns & set(columns(name))), "")
        return [(measurement, columns(name))]
    numbered = (re.fullmatch(rf"(?:{'|'.join(components)})(\d+)", name) for name in table.names if name in free_columns)
    numbers = dict.fromkeys(match[1] for match in numbered if match)
    if measurement.kind in CONTACT and not numbers:
        if is_alone:
            return [(measurement, ())]
        message = (
            f"no column for {', '.join(components)}, so that nothing says which rows are of the {measurement.kind}; give a file "
            "for each measurement that the sheet lists, in its order, or --kind KIND for one of them"
        )
        raise _error(table.file, message, 1)
    if len(numbers) > 1 and measurement.target_known:
        message = (
            f"the file has the targets {', '.join(numbers)} and one known target is given; estimate the targets "
            "(--point-free, target_known: false), or list a measurement with target and target_name for each"
        )
        raise _error(table.file, message, 1)
    if len(numbers) > 1:
        return [(replace(measurement, target_name=number), columns(number)) for number in numbers]
    return [(measurement, columns(*numbers) if numbers else components)]


def _check_columns(chain: Chain, table: csv_columns.Measured, targets: Sequence[_Target], time: str) -> None:
    """Raise for columns that are missing, unknown, or without a unit."""
    read_names = tuple(dict.fromkeys(name for _, columns in targets for name in columns))
    std_names = _std_columns(read_names)
    joints_read, speeds = (tuple(f"{name}{end}" for name in chain.joint_names) for end in (READ, SPEED))
    known_names = (*chain.joint_names, *joints_read, *speeds, *read_names, *std_names, "std", "group", "temperature")
    known_names += (time,) if time else ()
    for name in table.names:
        if name not in known_names:
            hint = f"or ignore it: --columns '{name}=ignore' (readings of {targets[0][0].kind})"
            raise _error(table.file, f"the column {name!r} is not expected; {nearest(name, known_names)}; {hint}", 1)
    missing_names = [name for name in (*chain.joint_names, *read_names) if name not in table.names]
    if missing_names:
        kind, expected_names = targets[0][0].kind, targets[0][1]
        message = (
            f"no column for {', '.join(missing_names)}; a {kind} needs {', '.join(expected_names)}; where the file calls it "
            f"otherwise: --columns 'NAME={missing_names[0]}'"
        )
        raise _error(table.file, message, 1)
    for names in (joints_read, speeds, *(_std_columns(columns) for _, columns in targets)):
        absent = [name for name in names if name not in table.names]
        if absent and len(absent) < len(names):
            raise _error(table.file, f"no column for {', '.join(absent)}; {', '.join(names)} belong together", 1)
    kinds = {name: units.ANGLE if name.startswith("r") else units.LENGTH for name in (*read_names, *std_names, "std")}
    kinds |= {f"{joint.name}{end}": joint_quantity(joint) for end in ("", READ) for joint in chain.joints}
    bare = [name for name in kinds if name in table.names and not table.unit_of(name, kinds[name])]
    if bare:
        q = np.array([table.rows[:, table.names.index(name)] for name in chain.joint_names])
        is_far = (chain.configurations.far(q) & ~chain.prismatic[:, None]).any()
        si_units = [("m", "lengths", units.LENGTH), ("deg" if is_far else "rad", "angles", units.ANGLE)]
        si_units = [entry for entry in si_units if any(kinds[name] == entry[2] for name in bare)]
        example = " ".join(si for si, _, _ in si_units)
        assumption = " and ".join(f"{plural} are in {si}" for si, plural, _ in si_units)
        bare_text = f"column {bare[0]!r} has" if len(bare) == 1 else f"columns {', '.join(bare)} have"
        message = (
            f"the {bare_text} no unit; if {assumption} add --columns '*=[{example}]' (in a sheet and in Python the setting "
            "columns), else with the units that they have"
        )
        raise _error(table.file, message, 1)


def _values(table: csv_columns.Measured, columns: Sequence[str], measurement: Measurement) -> Array:
    if not columns:
        return np.zeros((len(table.rows), measurement.size))
    return np.array([table.column(name, units.ANGLE if name.startswith("r") else units.LENGTH) for name in columns]).T


def _dependence_findings(
    targets: Sequence[_Target], values: Sequence[Array], usable: list[NDArray[np.bool_]], path: str
) -> Iterator[Finding]:
    """Yield warnings about targets that are copies of each other, which are omitted, or that keep their distances."""
    pairs = [
        (i, j) for i, j in combinations(range(len(targets)), 2) if targets[i][0].kind == targets[j][0].kind in _POINTS
    ]
    for i, j in pairs:
        shared = usable[i] & usable[j]
        alike = shared & (values[i] == values[j]).all(axis=1)
        if alike.any():
            is_copy = bool((alike == shared).all()) and not (targets[i][0].target_known or targets[j][0].target_known)
            usable[j] &= ~alike
            if not is_copy:
                usable[i] &= ~alike
            loss = "both are omitted there, since either may be the copy"
            message = (
                f"{', '.join(targets[j][1])} repeat {', '.join(targets[i][1])} to the last digit in {int(alike.sum()):,} of "
                f"{int(shared.sum()):,} rows; {'the copy is left out' if is_copy else loss}"
            )
            yield Finding("warning", "W_NOT_INDEPENDENT", message, path)
    rigid, largest = set[int](), 0.0
    for i, j in pairs:
        shared = usable[i] & usable[j]
        spread = np.linalg.norm((values[i] - values[j])[shared, :3], axis=1).std() if shared.sum() >= _FEW else np.inf
        if spread < _RIGID * min(targets[i][0].std, targets[j][0].std):
            rigid |= {i, j}
            largest = max(largest, float(spread))
    if rigid:
        labels = " and ".join(", ".join(targets[k][1]) for k in sorted(rigid))
        message = (
            f"{labels} keep their distances to {1e6 * largest:.2g} µm, far better than std: the instrument computed them from "
            "one pose, so that their errors are common and all intervals are too narrow"
        )
        yield Finding("warning", "W_NOT_INDEPENDENT", message, path)


def _check_joint_values(chain: Chain, q: Array, table: csv_columns.Measured) -> None:
    for joint, is_far in zip(chain.joints, chain.configurations.far(q), strict=True):
        if is_far.any():
            unit, row = table.unit_of(joint.name, joint_quantity(joint)), int(np.argmax(is_far))
            value = table.rows[row, table.names.index(joint.name)]
            note = "; are these degrees?" if unit == "rad" and joint.kind != "prismatic" else ""
            raise _error(
                table.file, f"{joint.name} = {value:g} {unit} is far outside its limits{note}", table.lines[row]
            )


def _error(path: str, message: str, line: int | None = None) -> InputError:
    return InputError.of("E_DATA", message, path, line)


def poses_csv(chain: Chain, q: Array) -> str:
    """Return joint values ``(n, P)`` as ``--trajectory`` reads them, in degrees and mm."""
    headings, columns = joint_cells(chain, q)
    return csv_text(headings, zip(*columns, strict=True))


def check_data(model: ErrorModel, data: CalibrationData) -> Iterator[Finding]:
    """Yield warnings about omitted readings and poses outside joint limits."""
    yield from data.findings
    _, first = np.unique(data.visit, return_index=True)
    yield from pose_findings(model.chain, data.q[:, first], [f"row {data.lines[k]}" for k in first])
