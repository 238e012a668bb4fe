"""Measured poses of one robot: joint values and readings, from arrays or CSV files.

    joint1 [deg], joint2 [deg], x [mm], y [mm], z [mm], std [mm], group
    10, -35, 812.31, 143.02, 455.80, 0.02, 1

There is a column for each joint and each number of a reading, with its unit in brackets: ``x y z`` of a position; also
``rx ry rz`` of a pose, the rotation vector of the measured attitude; ``distance`` of a distance. ``std`` is the
standard deviation of the row's lengths, ``group`` a whole number for rows that are left out together. At contact no
reading is needed: ``height`` over a plane, and ``x y z`` from the socket, default to zero. ``x1 y1 z1 x2 …`` are
several targets on the tool. Times are ignored; a cell that is empty, nan or NA is a missing reading.

A quick fit of the nominal arm finds joint zeros and directions that no tolerance can explain.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, compress, islice, permutations
from typing import Any, Final, NamedTuple

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from precision_pin.analyses.readings import COLUMNS, joint_cells
from precision_pin.base import csv_columns, se3, units
from precision_pin.base.arguments import check_numbers, check_path
from precision_pin.base.arrays import Array, Record
from precision_pin.base.errors import Finding, InputError, nearest, some
from precision_pin.base.files import csv_text
from precision_pin.base.se3 import log_rotation
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain, pose_findings
from precision_pin.robot.configurations import joint_quantity
from precision_pin.robot.joint_columns import recorded
from precision_pin.sheet.measurement import Measurement, written_sums

_CONTACT: Final = ("plane", "socket")
"""Kinds whose readings default to zero."""
_FEW: Final = 8
"""Rows from which distances between targets are checked."""
_RIGID: Final = 0.01
"""Spread of the distance between targets, in deviations of the instrument, that its own errors would exceed."""


@dataclass(frozen=True, eq=False)
class CalibrationData(Record):
    """P readings.

    Attributes:
        q: Joint values in chain order, rad and m, ``(n, P)``.
        readings: ``(P, m)``, m and rad: a position, a position and rotation vector, a distance, a height or an offset
            from a socket; NaN beyond the numbers of a shorter reading.
        std, group: Standard deviation of each reading's lengths, m, and its group number, ``(P,)``; empty for the
            instrument's, and for none.
        file, lines: Source of the data, and the rows of the file or arrays, from 1, ``(P,)``.
        measurements, files: The measurements, one for each target in each file, and the file of each.
        part, visit: Number of each reading's measurement, ``(P,)``, and of its visit: readings of one were taken
            together.
        findings: What was left out.
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

    def __post_init__(self) -> None:
        if not self.part.size:
            object.__setattr__(self, "part", np.zeros(len(self), dtype=np.intp))
            object.__setattr__(self, "visit", np.arange(len(self)))
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.readings)

    def label(self, reading: int) -> str:
        """Return a reading in words: its row, and its target and file if there are several."""
        part = int(self.part[reading])
        names = {one.target_name for one in self.measurements}
        target = f", target {self.measurements[part].target_name}" if len(names) > 1 else ""
        return f"row {self.lines[reading]}{target}{f' of {self.files[part]}' if len(set(self.files)) > 1 else ''}"


def read_data(model: ErrorModel, data: object, measurements: tuple[Measurement, ...]) -> CalibrationData:
    """Return data given as such, or as CSV paths or pairs of poses and readings: one a measurement, or one file."""
    if isinstance(data, CalibrationData):
        return data if data.measurements else replace(data, measurements=measurements, files=(data.file,))
    given: list[Any] = [data]
    if isinstance(data, tuple | list):
        is_listed = len(measurements) > 1 or all(isinstance(one, str | os.PathLike) for one in data)
        given = list(data) if is_listed else given
    if len(given) not in (1, len(measurements)):
        raise InputError(
            f"{len(given)} files or arrays of data and {len(measurements)} measurement{'s' * (len(measurements) > 1)}: list one "
            "for each (in the sheet, measurement: [{...}, ...]); several robots need --population"
        )
    wanted = [measurements] if len(given) == 1 else [(one,) for one in measurements]
    parts = []
    for one, own in zip(given, wanted, strict=True):
        if isinstance(one, tuple | list) and len(one) == 2 and len(own) == 1:
            parts.append(_of_arrays(model, one[0], one[1], own[0]))
        else:
            parts.append(_of_file(model, check_path("the data", one), own))
    return parts[0] if len(parts) == 1 else _together(parts)


def _together(parts: Sequence[CalibrationData]) -> CalibrationData:
    width = max(part.readings.shape[1] for part in parts)
    std, group = np.zeros(0), np.zeros(0)
    if any(part.std.size for part in parts):
        usual = (np.array([one.std for one in part.measurements])[part.part] for part in parts)
        std = np.concatenate([part.std if part.std.size else own for part, own in zip(parts, usual, strict=True)])
    if any(part.group.size for part in parts):
        # a reading without a group forms its own
        free = 1 + max(part.group.max() for part in parts if part.group.size)
        starts = zip(parts, np.cumsum([0, *map(len, parts)]), strict=False)
        group = np.concatenate([part.group if part.group.size else free + part.visit + k for part, k in starts])
    first = np.cumsum([0, *(len(part.measurements) for part in parts)])
    visits = np.cumsum([0, *(int(part.visit.max(initial=-1)) + 1 for part in parts)])
    return CalibrationData(
        np.ascontiguousarray(np.hstack([part.q for part in parts])),
        np.concatenate([_padded(part.readings, width) for part in parts]),
        std,
        group,
        parts[0].file,
        tuple(line for part in parts for line in part.lines),
        tuple(one for part in parts for one in part.measurements),
        tuple(file for part in parts for file in part.files),
        np.concatenate([part.part + k for part, k in zip(parts, first, strict=False)]),
        np.concatenate([part.visit + k for part, k in zip(parts, visits, strict=False)]),
        tuple(finding for part in parts for finding in part.findings),
    )


def _padded(readings: Array, width: int) -> Array:
    return np.hstack([readings, np.full((len(readings), width - readings.shape[1]), np.nan)])


def _of_arrays(model: ErrorModel, poses: Any, readings: Any, measurement: Measurement) -> CalibrationData:
    q, _ = model.configurations(poses)
    count = q.shape[1]
    is_contact = readings is None and measurement.kind in _CONTACT
    given = np.zeros((count, measurement.size)) if is_contact else np.asarray(readings)
    is_read = np.ones(count, dtype=bool)
    if given.dtype.kind == "f" and len(given) == count:
        is_read = np.asarray(~np.isnan(given.reshape(count, -1)).any(axis=1))
        given = given[is_read]
    findings = _missing("the reading", ~is_read, range(1, count + 1), "")
    kept = np.flatnonzero(is_read)
    rows = len(kept)
    if measurement.kind == "pose" and given.ndim == 3 and given.shape[1:] == (4, 4):
        matrices = check_numbers("the readings", given, (rows, 4, 4))
        turns = log_rotation(np.moveaxis(matrices[:, :3, :3], 0, -1)).T
        values = np.concatenate([matrices[:, :3, 3], turns], axis=1)
    else:
        if given.ndim == 1 and measurement.size == 1:
            given = given[:, None]
        needs = f"a row of {measurement.size} numbers for each of {count} poses, m and rad"
        values = check_numbers("the readings", given, (rows, measurement.size), needs)
    if not is_contact:
        own = [row.tobytes() for row in np.hstack([q[:, kept].T, values])]
        first, again = _without_copies(own, (kept + 1).tolist(), "")
        findings += again
        kept, values = kept[first], values[first]
    if not len(kept):
        raise _wrong("", "no reading is left")
    columns, lines, none = np.ascontiguousarray(q[:, kept]), tuple((kept + 1).tolist()), np.zeros(0)
    return CalibrationData(columns, values, none, none, "", lines, (measurement,), ("",), findings=tuple(findings))


def _missing(what: str, is_missing: NDArray[np.bool_], lines: Sequence[int], path: str) -> list[Finding]:
    where = np.flatnonzero(is_missing)
    if not where.size:
        return []
    message = f"{what} is missing in {where.size:,} of {len(lines):,} rows, which are left out"
    return [Finding("warning", "W_MISSING_READING", message, path or None, lines[int(where[0])] if path else None)]


def _without_copies(rows: Sequence[object], lines: Sequence[int], path: str) -> tuple[list[int], list[Finding]]:
    first: dict[object, int] = {}
    copies = [(k, first[row]) for k, row in enumerate(rows) if first.setdefault(row, k) != k]
    if not copies:
        return list(range(len(rows))), []
    copy, original = copies[0]
    message = (
        f"{len(copies):,} of {len(rows):,} rows repeat another to the last digit and are left out, the first of them row "
        f"{lines[copy]}, which is row {lines[original]} again; a column such as t tells apart what was read twice"
    )
    found = Finding("warning", "W_REPEATED_READING", message, path or None, lines[copy] if path else None)
    return list(first.values()), [found]


def _of_file(model: ErrorModel, path: str, measurements: tuple[Measurement, ...]) -> CalibrationData:
    joints = model.chain.joint_names
    si = {joint.name: joint_quantity(joint).si for joint in model.chain.joints}
    given = csv_columns.ColumnNames.parse(", ".join(dict.fromkeys(one.columns for one in measurements if one.columns)))
    read_names = "|".join({name for one in measurements for name in COLUMNS[one.kind]})
    is_reading = re.compile(rf"(?:{read_names})_?[0-9A-Za-z]*|std|group").fullmatch
    table = csv_columns.read(
        path,
        columns=lambda cells, row: recorded(cells, row, si, given),
        known=lambda name: name in joints or is_reading(name),
        ignored=[name for name in csv_columns.TIMES if name not in joints],
        may_miss=True,
    )
    targets = [target for one in measurements for target in _targets(table, joints, one, path, len(measurements) == 1)]
    _check_columns(model.chain, table, targets, path)
    if len({one.coupled for one in measurements}) > 1:
        raise _wrong(path, "several measurements read the file, and do not agree in what is coupled")
    q = np.array([table.column(joint.name, joint_quantity(joint)) for joint in model.chain.joints])
    q = measurements[0].mixing(model.chain) @ q
    std = np.array(table.column("std", units.LENGTH)) if "std" in table.names else np.zeros(0)
    if (std <= 0).any():
        raise _wrong(path, "std must be above zero", table.lines[int(np.nanargmin(std))])
    group = table.rows[:, table.names.index("group")] if "group" in table.names else np.zeros(0)
    if (group % 1 > 0).any():
        raise _wrong(path, "group must be a whole number", table.lines[int(np.flatnonzero(group % 1 > 0)[0])])
    _check_joint_values(model.chain, q, path, table)
    q = model.chain.configurations.taken(q)
    others = [values for values in (std, group) if values.size]
    has_pose = np.isfinite(np.vstack([q, *others])).all(axis=0)
    unread = [*filter(None, table.texts)]
    are = "s {} are" if len(unread) > 1 else " {} is"
    notes = [f"the column{are.format(some(unread, 6))} not read"] * bool(unread)
    notes += [f"read as columns of {table.recorder}"] * bool(table.recorder)
    findings = [Finding("note", "N_COLUMN", note, path, 1) for note in notes]
    findings += _missing("a joint value, std or group", ~has_pose, table.lines, path)
    kept, again = list(range(q.shape[1])), list[Finding]()
    if any(columns for _, columns in targets):
        texts = list(zip(*table.texts.values(), strict=True)) if table.texts else [()] * q.shape[1]
        whole = [(row.tobytes(), text) for row, text in zip(table.rows, texts, strict=True)]
        kept, again = _without_copies(whole, table.lines, path)
    is_new = np.isin(np.arange(q.shape[1]), kept) & has_pose
    read = [_values(table, columns, one) for one, columns in targets]
    there = [np.asarray(np.isfinite(values).all(axis=1)) for values in read]
    for (_, columns), is_there in zip(targets, there, strict=True):
        findings += _missing(" or ".join(columns), ~is_there & is_new, table.lines, path)
    usable = [is_there & is_new for is_there in there]
    findings += [*again, *_dependent(targets, read, usable, path)]
    width = max(one.size for one, _ in targets)
    present = [k for k in range(len(targets)) if usable[k].any()]
    if not present:
        raise _wrong(path, "no reading is left")
    # row by row, so that the targets of a row follow each other
    chosen, part = np.nonzero(np.array([usable[k] for k in present]).T)
    readings = np.array([_padded(read[k], width) for k in present])[part, chosen]
    return CalibrationData(
        np.ascontiguousarray(q[:, chosen]),
        readings,
        std[chosen] if std.size else std,
        group[chosen] if group.size else group,
        path,
        tuple(table.lines[row] for row in chosen),
        tuple(targets[k][0] for k in present),
        (path,) * len(present),
        part,
        chosen,
        tuple(findings),
    )


_Target = tuple[Measurement, tuple[str, ...]]
"""A measurement of one target, and its columns, if any."""


def _targets(
    table: csv_columns.Measured, joints: Sequence[str], measurement: Measurement, path: str, is_alone: bool
) -> list[_Target]:
    wanted, own = COLUMNS[measurement.kind], measurement.target_name
    free = set(table.names) - set(joints)

    def columns(name: str) -> tuple[str, ...]:
        return tuple(f"{one}{name}" for one in wanted)

    if own or free & set(wanted):
        name = next((name for name in (own, f"_{own}") if free & set(columns(name))), "")
        return [(measurement, columns(name))]
    numbered = (re.fullmatch(rf"(?:{'|'.join(wanted)})(\d+)", name) for name in table.names if name in free)
    numbers = dict.fromkeys(one[1] for one in numbered if one)
    if measurement.kind in _CONTACT and not numbers:
        if is_alone:
            return [(measurement, ())]
        message = (
            f"no column for {', '.join(wanted)}, so that nothing says which rows are of the {measurement.kind}; give a file "
            "for each measurement that the sheet lists, in its order, or --kind KIND for one of them"
        )
        raise _wrong(path, message, 1)
    if len(numbers) > 1 and measurement.target_known:
        message = (
            f"the file has the targets {', '.join(numbers)} and one known target is given; let them be estimated "
            "(--point-free, target_known: false), or list a measurement with target and target_name for each"
        )
        raise _wrong(path, message, 1)
    if len(numbers) > 1:
        return [(replace(measurement, target_name=number), columns(number)) for number in numbers]
    return [(measurement, columns(*numbers) if numbers else wanted)]


def _check_columns(chain: Chain, table: csv_columns.Measured, targets: Sequence[_Target], path: str) -> None:
    """Raise for columns that are missing, unknown, or without a unit."""
    read = tuple(dict.fromkeys(name for _, columns in targets for name in columns))
    known = (*chain.joint_names, *read, "std", "group")
    for name in table.names:
        if name not in known:
            hint = f"or it is to be ignored: --columns '{name}=ignore' (readings of {targets[0][0].kind})"
            raise _wrong(path, f"the column {name!r} is not expected; {nearest(name, known)}; {hint}", 1)
    missing = [name for name in (*chain.joint_names, *read) if name not in table.names]
    if missing:
        kind, wanted = targets[0][0].kind, targets[0][1]
        message = (
            f"no column for {', '.join(missing)}; a {kind} needs {', '.join(wanted)}; where the file calls it otherwise: "
            f"--columns 'NAME={missing[0]}'"
        )
        raise _wrong(path, message, 1)
    quantities = {name: units.LENGTH for name in (*read, "std") if name in table.names and not name.startswith("r")}
    quantities |= {name: units.ANGLE for name in read if name.startswith("r")}
    quantities |= {joint.name: joint_quantity(joint) for joint in chain.joints}
    bare = [name for name, quantity in quantities.items() if not table.unit_of(name, quantity)]
    if bare:
        q = np.array([table.rows[:, table.names.index(name)] for name in chain.joint_names])
        is_far = (chain.configurations.far(q) & ~chain.prismatic[:, None]).any()
        needed = [("m", "lengths", units.LENGTH), ("deg" if is_far else "rad", "angles", units.ANGLE)]
        needed = [one for one in needed if any(quantities[name] == one[2] for name in bare)]
        example = " ".join(si for si, _, _ in needed)
        words = " and ".join(f"{what} are in {si}" for si, what, _ in needed)
        listed = f"column {bare[0]!r} has" if len(bare) == 1 else f"columns {', '.join(bare)} have"
        message = (
            f"the {listed} no unit; if {words} add --columns '*=[{example}]' (in a sheet and in Python the setting columns), "
            "else with the units that they have"
        )
        raise _wrong(path, message, 1)


def _values(table: csv_columns.Measured, columns: Sequence[str], measurement: Measurement) -> Array:
    if not columns:
        return np.zeros((len(table.rows), measurement.size))
    return np.array([table.column(name, units.ANGLE if name.startswith("r") else units.LENGTH) for name in columns]).T


def _dependent(
    targets: Sequence[_Target], read: Sequence[Array], usable: list[NDArray[np.bool_]], path: str
) -> Iterator[Finding]:
    """Yield warnings about targets that repeat each other, whose copies are left out, or that keep their distances."""
    pairs = [
        (i, j)
        for i, j in combinations(range(len(targets)), 2)
        if targets[i][0].kind == targets[j][0].kind in ("position", "pose")
    ]
    for i, j in pairs:
        both = usable[i] & usable[j]
        alike = both & (read[i] == read[j]).all(axis=1)
        if alike.any():
            is_copy = bool((alike == both).all()) and not (targets[i][0].target_known or targets[j][0].target_known)
            usable[j] &= ~alike
            if not is_copy:
                usable[i] &= ~alike
            which = "which of the two was read is not known, both are left out there"
            message = (
                f"{', '.join(targets[j][1])} repeat {', '.join(targets[i][1])} to the last digit in {int(alike.sum()):,} of "
                f"{int(both.sum()):,} rows; {'the copy is left out' if is_copy else which}"
            )
            yield Finding("warning", "W_NOT_INDEPENDENT", message, path)
    rigid, largest = set[int](), 0.0
    for i, j in pairs:
        both = usable[i] & usable[j]
        spread = np.linalg.norm((read[i] - read[j])[both, :3], axis=1).std() if both.sum() >= _FEW else np.inf
        if spread < _RIGID * min(targets[i][0].std, targets[j][0].std):
            rigid |= {i, j}
            largest = max(largest, float(spread))
    if rigid:
        listed = " and ".join(", ".join(targets[k][1]) for k in sorted(rigid))
        message = (
            f"{listed} keep their distances to {1e6 * largest:.2g} µm, far better than std: the instrument computed them from "
            "one pose, so that their errors are common and all intervals too narrow"
        )
        yield Finding("warning", "W_NOT_INDEPENDENT", message, path)


def _check_joint_values(chain: Chain, q: Array, path: str, table: csv_columns.Measured) -> None:
    for joint, beyond in zip(chain.joints, chain.configurations.far(q), strict=True):
        if beyond.any():
            unit, row = table.unit_of(joint.name, joint_quantity(joint)), int(np.argmax(beyond))
            value = table.rows[row, table.names.index(joint.name)]
            hint = "; are these degrees?" if unit == "rad" and joint.kind != "prismatic" else ""
            raise _wrong(path, f"{joint.name} = {value:g} {unit} is far outside its limits{hint}", table.lines[row])


def _wrong(path: str, message: str, line: int | None = None) -> InputError:
    return InputError.of("E_DATA", message, path, line)


def poses_csv(chain: Chain, q: Array) -> str:
    """Return joint values ``(n, P)`` as ``--trajectory`` reads them, in degrees and mm."""
    headings, columns = joint_cells(chain, q)
    return csv_text(headings, zip(*columns, strict=True))


def check_data(model: ErrorModel, data: CalibrationData) -> Iterator[Finding]:
    """Yield warnings about data: what was left out, and poses outside limits."""
    yield from data.findings
    _, first = np.unique(data.visit, return_index=True)
    yield from pose_findings(model.chain, data.q[:, first], [f"row {data.lines[k]}" for k in first])


_BAD: Final = 0.01
"""Residual, as a fraction of the arm's length, above which a joint direction may be wrong after fitting zeros."""
_DEVIATIONS: Final = 10.0
"""Least such residual, in standard deviations of the instrument."""
_BETTER: Final = 3.0
"""Factor by which a reversed direction must reduce the residual."""
_CLEARLY: Final = 1.5
"""The same for joints whose direction hardly shows, once that of the others is found."""
_MOST_TRIED: Final = 64
"""Combinations of reversed joints to try."""
_EVALUATIONS: Final = 15
"""Evaluations of a fit of zeros: the right one needs fewer."""
_HOLD: Final = 1e-4
"""Weight of a zero, m/rad, that holds one that no reading sees."""
_ALIGNED: Final = 4
"""Alignments of points with readings, in each of which those far off weigh less."""
_OUTSIDE: Final = 5.0
"""Residual, in medians of all, of a reading that does not count."""


class Zeros(NamedTuple):
    """Offsets of the joint zeros from nominal ``(n,)``, rad or m, and the root mean square (m) of the residual."""

    values: Array
    rms: float

    def describe(self, chain: Chain) -> str:
        """Return the zeros in words, the largest first."""
        order = np.argsort(-np.abs(self.values), kind="stable")[:3]
        scales = [(1e3, " mm") if slides else (180 / np.pi, "°") for slides in chain.prismatic]
        return ", ".join(f"{chain.joint_names[k]} {scales[k][0] * self.values[k]:+.3g}{scales[k][1]}" for k in order)


def fit_zeros(chain: Chain, q: Array, readings: Array, measurement: Measurement, most: int = 40) -> Zeros:
    """Return the best zeros, fitted with unknown base, target or anchor to readings ``(P, 3)`` or ``(P, 1)``.

    Readings that are far off hardly pull. ``most`` is the number of evaluations.
    """
    count = len(chain.joints)
    is_free, is_distance = measurement.base == "free", measurement.kind == "distance"
    is_estimated = [True] * count + [not measurement.target_known] * 3 + [True] * (3 if is_distance and is_free else 0)

    def residuals(y: Array) -> Array:
        x = np.zeros(len(is_estimated))
        x[is_estimated] = y
        pose = chain.at_columns(q + x[:count, None]).pose
        target = np.array(measurement.target) + x[count : count + 3]
        points = (pose[:3, 3] + np.einsum("ijp,j->ip", pose[:3, :3], target)).T
        if is_distance:
            anchor = np.array(measurement.anchor) + (x[count + 3 :] if is_free else 0.0)
            away = np.linalg.norm(points - anchor, axis=1) - readings[:, 0]
        else:
            away = (_aligned(points, readings) if is_free else points) - readings
        return np.concatenate([away.ravel(), _HOLD * y[: count + (0 if measurement.target_known else 3)]])

    found = scipy.optimize.least_squares(
        residuals, np.zeros(sum(is_estimated)), max_nfev=most, loss="soft_l1", f_scale=_BAD * _length(chain)
    )
    sizes = np.linalg.norm(found.fun[: readings.size].reshape(readings.shape), axis=1)
    return Zeros(found.x[:count], float(np.sqrt((sizes[sizes <= _OUTSIDE * np.median(sizes)] ** 2).mean())))


def _length(chain: Chain) -> float:
    return float(np.linalg.norm(chain.placements[:, :3, 3], axis=1).sum())


def _aligned(points: Array, readings: Array) -> Array:
    weights = np.ones(len(points))
    for _ in range(_ALIGNED):
        centre, other = (np.average(each, axis=0, weights=weights) for each in (points, readings))
        rotation = se3.nearest_rotation((weights[:, None] * (readings - other)).T @ (points - centre))
        moved = (points - centre) @ rotation.T + other
        sizes = np.linalg.norm(moved - readings, axis=1)
        weights = 1 / (sizes + np.median(sizes) + 1e-12)
    return np.asarray(moved)


def refuse_reversed(chain: Chain, data: CalibrationData, measurement: Measurement) -> Zeros | None:
    """Raise if readings fit far better with joints reversed, or with one shown with another; return the zeros that fit best."""
    # none for contact, whose readings depend on where the arm is believed to be
    if measurement.kind in _CONTACT:
        return None
    rows = np.flatnonzero(data.part == data.measurements.index(measurement))
    q, readings = data.q[:, rows], data.readings[rows, : min(measurement.size, 3)]
    plain = fit_zeros(chain, q, readings, measurement)
    bad = max(_DEVIATIONS * measurement.std, _BAD * _length(chain))
    if not bad < plain.rms < _length(chain):  # farther than that, it is not the joint values
        return plain

    def rms_of(mixing: Array) -> float:
        return fit_zeros(chain, mixing @ q, readings, measurement, _EVALUATIONS).rms

    for alternatives in _mixings(chain):
        sizes = [rms_of(mixing) for mixing in alternatives]
        mixing, rms = alternatives[int(np.argmin(sizes))], min(sizes)
        if rms < min(plain.rms / _BETTER, bad):
            mixing, rms = _refined(rms_of, mixing, rms)
            residuals = f"(residuals {1e3 * rms:.3g} mm rms instead of {1e3 * plain.rms:.3g} mm, all zeros free)"
            if sums := written_sums(mixing, chain.joint_names):
                message = (
                    f"readings fit far better where one joint is shown with another {residuals}; if the control does so, "
                    f"write measurement: {{coupled: {{{sums}}}}} in the sheet"
                )
                raise InputError.of("E_COUPLED", message, data.file or None)
            names = " and ".join(compress(chain.joint_names, np.diag(mixing) < 0))
            message = (
                f"{names}: readings fit far better with the direction reversed {residuals}; change the sign of the column, or "
                "turn the axis and its limits around in the URDF; or two columns of places are swapped"
            )
            raise InputError.of("E_REVERSED", message, data.file or None)
    return plain


def _refined(rms_of: Callable[[Array], float], mixing: Array, rms: float) -> tuple[Array, float]:
    """Return a mixing after reversing in turn less important joints that still fit clearly better."""
    while True:
        others = [np.where(np.arange(len(mixing)) == k, -1.0, 1.0)[:, None] * mixing for k in range(len(mixing))]
        sizes = [rms_of(other) for other in others]
        best = int(np.argmin(sizes))
        if sizes[best] > rms / _CLEARLY:
            return mixing, rms
        mixing, rms = others[best], sizes[best]


def _mixings(chain: Chain) -> Iterator[list[Array]]:
    """Yield mixings ``(n, n)`` of joint values to choose from: one joint reversed, or with another; then more reversed."""
    slides, unit = chain.prismatic, np.eye(count := len(chain.joints))
    chosen = (one for number in range(1, count + 1) for one in combinations(range(count), number))
    reversals = [np.diag(np.where(np.isin(np.arange(count), one), -1.0, 1.0)) for one in islice(chosen, _MOST_TRIED)]
    pairs = [pair for pair in permutations(range(count), 2) if slides[pair[0]] == slides[pair[1]]]
    coupled = [(one, unit + sign * np.outer(unit[one], unit[other])) for one, other in pairs for sign in (1.0, -1.0)]
    yield [*reversals[:count], *(mixing for _, mixing in coupled)]
    yield from ([mixing] for mixing in reversals[count:])
    if coupled:
        yield [reversals[one] @ mixing for one, mixing in coupled]
