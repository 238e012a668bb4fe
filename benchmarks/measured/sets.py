"""Sets of data that others published, as they lie in a folder: what was read, by which arm, and what the publishers had."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

import precision_pin as pp
from benchmarks.measured.arms import arm, dh_urdf, drafts
from benchmarks.measured.declared import Column, Csv, Declaration, Dh, MissingSet, declaration
from precision_pin.base import units
from precision_pin.base.arrays import Array
from precision_pin.base.csv_columns import TableForm
from precision_pin.base.errors import InputError
from precision_pin.robot.configurations import approaches_along, joint_quantity
from precision_pin.robot.examples import shipped_sheets
from precision_pin.robot.ur_kinematics import MODELS

MOST: Final = 1000
"""Rows of a set that are fitted, and that are judged: of more, so many are chosen evenly, to take minutes and not hours."""
_SI: Final = {unit: quantity.units[unit] for quantity in (units.LENGTH, units.ANGLE) for unit in quantity.units}
_EMPTY: Final = ("", "nan", "na")
"""Cells without a reading, in lower case."""


@dataclass(frozen=True)
class Rows:
    """Joint values ``(n, P)``, rad or m, points read ``(T, P, 3)``, m, in the instrument's axes, and approaches ``(n, P)``."""

    q: Array
    points: Array
    approaches: NDArray[np.int8]

    @classmethod
    def together(cls, parts: Sequence[Rows]) -> Rows:
        """Return the rows of several parts, one after another."""
        return cls(
            np.concatenate([part.q for part in parts], axis=1),
            np.concatenate([part.points for part in parts], axis=1),
            np.concatenate([part.approaches for part in parts], axis=1),
        )

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

    @property
    def rows(self) -> Rows:
        """The readings to fit, then those set apart."""
        return self.fit if self.judged is None else Rows.together([self.fit, self.judged])


@dataclass(frozen=True)
class Factory:
    """A robot by the calibration of its factory: the file, its type, and the model of an arm as delivered."""

    path: Path
    kind: str
    forecast: pp.ErrorModel
    forecast_by: str


def columns(path: Path, wanted: Sequence[Column], form: Csv) -> Array:
    """Return columns of a CSV file by name or number, ``(len(wanted), P)``; NaN where there is no reading."""
    name = f"{path.parent.name}/{path.name}"
    table = TableForm(form.separator, form.decimal)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise MissingSet(f"{name} cannot be read ({error})") from None
    kept = [k for k, text in enumerate(lines) if text.strip() and not (form.comment and text.startswith(form.comment))]
    cells = [[cell.strip() for cell in row] for row in table.rows(lines[k] for k in kept)]
    heads = cells.pop(0) if form.header and cells else []
    numbers = [k + 1 for k in kept[len(kept) - len(cells) :]]
    if not cells:
        raise MissingSet(f"{name} has no rows")
    for column in wanted:
        count = heads.count(column) if isinstance(column, str) else int(column <= len(cells[0]))
        if count != 1:
            raise MissingSet(f"{name} has {count or 'no'} column{'s' * (count > 1)} {column}")
    index = [heads.index(column) if isinstance(column, str) else column - 1 for column in wanted]
    values = np.empty((len(wanted), len(cells)))
    for k, (row, line) in enumerate(zip(cells, numbers, strict=True)):
        if len(row) <= max(index):
            raise MissingSet(f"{name}, line {line}: {len(row)} cells, and column {max(index) + 1} is asked for")
        for j, i in enumerate(index):
            values[j, k] = table.number(row[i])
            if np.isnan(values[j, k]) and row[i].lower() not in _EMPTY:
                raise MissingSet(f"{name}, line {line}: {row[i]!r} is not a number{table.hint(row[i])}")
    return values


def files(folder: Path, patterns: Sequence[str]) -> Iterator[Path]:
    """Yield the files of a set in order."""
    for pattern in patterns:
        found = [folder / pattern] if (folder / pattern).is_file() else sorted(folder.glob(pattern))
        if not found:
            raise MissingSet(f"no {(folder / pattern).parent.name}/{Path(pattern).name}")
        yield from found


def rows(folder: Path, patterns: Sequence[str], declared: Declaration) -> tuple[Rows, float | None, list[str]]:
    """Return the readings of files, the mean size of the difference that they give, m, and what is remarkable in them."""
    joints, targets, parts, apart = declared.joints, declared.targets, [], []
    count, thetas = len(targets.columns), np.zeros(len(joints.columns))
    if declared.dh is not None:
        thetas = np.array([row[3] for row in declared.dh.table]) * _SI[declared.dh.units[1]]
    factors = np.array([_SI[unit] for unit in joints.unit]) * np.array(joints.sign or [1])
    offsets = np.array([_SI[unit] for unit in joints.unit]) * np.array(joints.offset or [0]) + thetas
    wanted = [*joints.columns, *(c for place in targets.columns + targets.difference for c in place)]
    for path in files(folder, patterns):
        values = columns(path, wanted, declared.csv)
        q = factors[:, None] * values[: len(joints.columns)] + offsets[:, None]
        places = values[len(joints.columns) :].reshape(-1, 3, values.shape[1]).mT
        read, difference = places[:count], places[count:]
        if difference.size:
            read = read + difference if targets.plus else read - difference
            apart.append(_SI[targets.unit] * np.linalg.norm(difference, axis=2).ravel())
        parts.append(Rows(q, _SI[targets.unit] * read, approaches_along(q)))
    whole = Rows.together(parts)
    notes, total = [], len(whole)
    # how each row was approached is known before rows are left out
    whole = whole[np.isfinite(whole.q).all(axis=0) & np.isfinite(whole.points).all(axis=(0, 2))]
    if not len(whole):
        raise MissingSet(f"{folder.name}: no row has all readings")
    if len(whole) < total:
        notes.append(f"{total - len(whole)} of {total} rows lack a reading")
    if len(whole) > MOST:
        notes.append(f"{MOST} of {len(whole)} rows, evenly chosen")
        whole = whole[np.linspace(0, len(whole) - 1, MOST).round().astype(int)]
    return whole, float(np.nanmean(np.concatenate(apart))) if apart else None, notes


def different(points: Array) -> tuple[list[int], list[str]]:
    """Return the targets of ``(T, P, 3)`` whose readings do not repeat another's, and what was found."""
    kept, notes = list(range(len(points))), []
    for k in range(1, len(points)):
        for j in [j for j in kept if j < k]:
            same = int((points[j] == points[k]).all(axis=1).sum())
            if same:
                kept = [other for other in kept if other != k and (same == len(points[k]) or other != j)]
                which = f"{k + 1} is" if same == len(points[k]) else f"{j + 1} and {k + 1} are"
                notes.append(
                    f"target {k + 1} repeats target {j + 1} in {same} of {len(points[k])} rows: {which} not used"
                )
    if not kept:
        raise MissingSet(*notes)
    return kept, notes


def read(name: str, folder: Path) -> MeasuredSet | None:
    """Return a set of a folder; ``None`` if the data of a known set are not there."""
    declared, home = declaration(name, folder)
    if not home.is_dir():
        return None
    sheet, forecast, by = arm(declared, home)
    check_joints(declared, forecast)
    fit, _, notes = rows(home, declared.fit, declared)
    judged, as_measured = None, None
    if declared.judge:
        judged, as_measured, more = rows(home, declared.judge, declared)
        notes += [f"to judge: {note}" for note in more]
    kept, repeated = different(fit.points)
    fit, judged = (part and Rows(part.q, part.points[kept], part.approaches) for part in (fit, judged))
    return MeasuredSet(
        *(declared.robot, declared.instrument.replace("{targets}", str(len(kept))), sheet, forecast, by, fit, judged),
        *(declared.guess, as_measured, declared.published),
        notes=tuple(filter(None, (declared.remark, *notes, *repeated))),
    )


def check_joints(declared: Declaration, model: pp.ErrorModel) -> None:
    """Refuse joint values of another number, order or unit than the arm's joints."""
    joints, columns = model.chain.joints, declared.joints.columns
    names = [joint.name for joint in joints]
    if len(columns) != len(names):
        raise MissingSet(f"joints.columns: {len(columns)} columns, and the arm has {len(names)}: {', '.join(names)}")
    if columns != names and set(columns) == set(names):
        raise MissingSet(f"joints.columns: the arm has the order {', '.join(names)}")
    for joint, unit in zip(joints, declared.joints.unit * (len(names) // len(declared.joints.unit)), strict=True):
        if unit not in (quantity := joint_quantity(joint)).units:
            raise MissingSet(
                f"joints.unit: {joint.name} is {joint.kind}, so its unit is an {quantity.name}, not {unit}"
            )


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
    steps = ((0, 90, d1), (a2, 0, 0), (a3, 0, 0), (0, 90, d4), (0, -90, d5), (0, 0, d6))
    dh = Dh(table=[(*step, 0) for step in steps], units=("m", "deg"))
    return drafts(dh_urdf(dh))[1], "init"
