"""A trajectory in a CSV file: joint values, one pose a row, perhaps with times."""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import units
from precision_pin.base.arguments import check_callable, check_instance, check_number, check_path, check_whole
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.csv_columns import NUMBER, numbers
from precision_pin.base.errors import InputError, UnitError, nearest, shown
from precision_pin.base.files import UnreadableFileError, decode, read_regular_file
from precision_pin.robot.chain import Chain
from precision_pin.robot.pose_grids import MOST_POSES
from precision_pin.robot.pose_set import PoseSet

_TIMES: Final = ("t", "time")
_LONGEST: Final = 40
_LARGEST_FILE: Final = 256 * 2**20
_AT_ONCE: Final = 2**13
"""Lines read together."""
_Wrong = Callable[[str, int], InputError]
"""Makes the error for a line."""
_ROUNDING: Final = 1e-9
"""Fraction of a step by which an interval may exceed a whole number of steps, for rounding."""


@dataclass(frozen=True)
class Column:
    """A column of a trajectory file: its heading, its joint (empty for times), and its unit in s, rad or m."""

    heading: str
    joint: str
    factor: float = 1.0


def joint_columns(names: Iterable[str], slides: Iterable[bool]) -> list[Column]:
    """Return the columns for writing joint values: degrees, or mm for sliding joints."""
    return [
        Column(f"{name} [mm]", name, 1e-3) if is_slide else Column(f"{name} [deg]", name, math.pi / 180)
        for name, is_slide in zip(names, slides, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class Trajectory(Fixed):
    """Poses in order: joint values in chain order ``(P, n)``, rad or m, and times ``(P,)``, s, if the file has them.

    ``rows`` are the file's rows, from 1, ``(P,)``, fractions between two rows. ``columns`` are in the file's order.
    """

    chain: Chain
    values: Array
    times: Array | None
    rows: Array
    columns: tuple[Column, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each pose: its time, or else its row."""
        if self.times is None:
            return tuple(f"row {row:.10g}" for row in self.rows.tolist())
        return tuple(f"t = {time:g} s" for time in self.times.tolist())

    @property
    def poses(self) -> PoseSet:
        """The poses with the status of each."""
        return self.pose_set()

    def pose_set(self, step: Callable[[int], object] = lambda _: None) -> PoseSet:
        """Return the poses with their statuses; ``step`` takes the number of poses done since its last call."""
        return PoseSet.at(self.chain, np.ascontiguousarray(self.values.T), self.names, self.times, step)

    def refined(
        self,
        *,
        time_step: float | None = None,
        angle_step: float | None = None,
        length_step: float | None = None,
        most: int = MOST_POSES,
    ) -> Trajectory:
        """Return the trajectory with poses between its rows, by linear interpolation of joint values and times.

        Each interval between rows is divided into the fewest equal parts that keep all given steps; the rows stay.

        Args:
            time_step: Largest time between two poses, s.
            angle_step: Largest turn of a joint between two poses, rad.
            length_step: Largest travel of a prismatic joint between two poses, m.
            most: Most poses allowed.

        Raises:
            InputError: A step that is not positive; a time step without times, or a step of joints that the chain
                lacks; more poses than allowed.
        """
        check_whole("the most poses", most, 1, MOST_POSES)
        if time_step is angle_step is length_step is None:
            return self
        slides = self.chain.prismatic
        moved = np.abs(np.diff(self.values, axis=0))
        parts = np.ones(len(moved))
        for name, step, distances, missing in (
            ("time_step", time_step, None if self.times is None else np.diff(self.times)[:, None], "no times"),
            ("angle_step", angle_step, moved[:, ~slides], "no joint that turns"),
            ("length_step", length_step, moved[:, slides], "no joint that slides"),
        ):
            if step is None:
                continue
            checked = check_number(name, step, "positive and finite", lambda value: value > 0)
            if distances is None or not distances.shape[1]:
                raise InputError(f"{name}: the trajectory has {missing}")
            with np.errstate(over="ignore"):
                parts = np.maximum(parts, np.ceil((distances / checked).max(axis=1) - _ROUNDING))
        if not 1 + parts.sum() <= most:
            raise InputError(f"the steps make {1 + parts.sum():,.0f} poses; at most {most:,} are allowed")
        counts = parts.astype(np.intp)
        firsts = np.repeat(np.arange(len(moved)), counts)
        shares = (np.arange(len(firsts)) - np.repeat(np.cumsum(counts) - counts, counts)) / np.repeat(parts, counts)
        return replace(
            self,
            values=_between(self.values, firsts, shares[:, None]),
            times=None if self.times is None else _between(self.times, firsts, shares),
            rows=_between(self.rows, firsts, shares),
        )


def read_trajectory(
    path: str | os.PathLike[str],
    chain: Chain,
    most: int = MOST_POSES,
    progress: Callable[[int], object] = lambda _: None,
) -> Trajectory:
    """Read a trajectory: a row of joint names in any order, then a row of values for each pose.

    A unit may follow a name, as in ``joint1 [deg]``; without one values are in rad or m. A first column named ``t`` or
    ``time`` holds increasing times, by default in s, unless a joint of the chain has that name.

    Args:
        path: The file, UTF-8, with commas.
        chain: Whose joints the columns are.
        most: Most poses allowed.
        progress: Function called with the number of characters read since its last call.

    Raises:
        InputError: The file cannot be read, is larger than 256 MiB, names other joints, has a wrong unit, or holds a
            value that is not finite; one line that says where.

    Examples:
        >>> header = "t,joint1 [deg],joint2,joint3,joint4"
        >>> np.savetxt("swing.csv", [[0, 0, 0, 0, 0], [1, 90, 0, 0, 0]], delimiter=",", header=header, comments="")
        >>> swing = pp.read_trajectory("swing.csv", pp.Chain.from_urdf("4dof.urdf", tip="tool"))
        >>> print(swing.times, swing.poses.q[0].round(3))
        [0. 1.] [0.    1.571]
    """
    check_callable("progress", progress)
    check_instance("chain", chain, Chain, "as Chain.from_urdf returns it")
    check_whole("the most poses", most, 1, MOST_POSES)
    file = os.fspath(check_path("the path of the trajectory", path))

    def wrong(message: str, line: int | None = None) -> InputError:
        return InputError.of("E_TRAJECTORY", message, file, line)

    try:
        data = read_regular_file(file, _LARGEST_FILE)
        if not data.isascii():
            decode(data)  # raises if not UTF-8
        # a line at a time: decoding and splitting a large file at once would stall the progress bar
        lines = io.TextIOWrapper(io.BytesIO(data), "utf-8-sig")
        line, header = next(_rows(lines, 0), (0, []))
        if not line:
            raise wrong("the file is empty; it begins with a row of joint names")
        try:
            columns = _columns(header, chain)
        except InputError as error:
            raise wrong(error.findings[0].message, line) from None
        # quoted text may span several lines
        together = None if b'"' in data else _AT_ONCE
        parts: list[Array] = []
        count, before, first = 0, -math.inf, line
        while some := list(itertools.islice(lines, together)):
            part = _plain([plain for one in some if (plain := one.strip())], columns, before)
            if part is None or len(part) > most - count:
                part = _row_by_row(_rows(some, first), columns, before, count, most, wrong)
            parts.append(part)
            count, before = count + len(part), part[-1, 0] if len(part) else before
            first += len(some)
            progress(sum(map(len, some)))
    except UnreadableFileError as problem:
        raise wrong(f"the file {problem.reason}") from None
    except csv.Error as problem:
        raise wrong(f"no CSV: {problem}") from None
    if not count:
        raise wrong("no poses: no row follows the joint names", line)
    values = np.concatenate(parts)
    joints = [column.joint for column in columns]
    order = [joints.index(name) for name in chain.joint_names]
    times = None if columns[0].joint else values[:, 0]
    return Trajectory(chain, values[:, order], times, np.arange(1.0, count + 1), tuple(columns))


def _rows(lines: Iterable[str], first: int) -> Iterator[tuple[int, list[str]]]:
    """Yield the non-blank rows, each with the line on which it ends; the lines follow the line ``first``."""
    reader = csv.reader(lines)
    for row in reader:
        cells = [cell.strip() for cell in row]
        if any(cells):
            yield first + reader.line_num, cells


def _plain(lines: Sequence[str], columns: Sequence[Column], before: float) -> Array | None:
    """Return the values of lines of plain numbers at once; ``None`` if anything is wrong, to be found row by row."""
    part = numbers(lines, len(columns))
    if part is None:
        return None
    values: Array = part * [column.factor for column in columns]
    increasing = columns[0].joint or (np.diff(values[:, 0], prepend=before) > 0).all()
    return values if increasing and np.isfinite(values).all() else None


def _row_by_row(
    rows: Iterable[tuple[int, list[str]]], columns: Sequence[Column], before: float, count: int, most: int, wrong: _Wrong
) -> Array:  # fmt: skip
    """Return the values of rows after ``count`` others ending at the time ``before``; raise at a wrong one."""
    found: list[list[float]] = []
    for line, cells in rows:
        if count + len(found) == most:
            raise wrong(f"more than {most} poses; leave rows out", line)
        if len(cells) != len(columns):
            raise wrong(f"{len(cells)} values for {len(columns)} columns", line)
        values = []
        for cell, column in zip(cells, columns, strict=True):
            # float() takes 1_000 and other digits than 0 to 9 as well
            values.append(float(cell) * column.factor if NUMBER.fullmatch(cell) else math.nan)
            if not math.isfinite(values[-1]):
                raise wrong(f"{column.heading}: {shown(cell, _LONGEST)} is not a finite number", line)
        if not columns[0].joint and not values[0] > before:
            still, back = f"stands still at {before:.10g} s", f"goes back from {before:g} s to {values[0]:g} s"
            raise wrong(f"the time {still if values[0] == before else back}; it must increase from row to row", line)
        found.append(values)
        before = values[0]
    return np.array(found).reshape(-1, len(columns))


def _columns(header: Sequence[str], chain: Chain) -> list[Column]:
    columns = [_column(heading, chain, is_first=not rank) for rank, heading in enumerate(header)]
    joints = [column.joint for column in columns]
    for name in joints:
        if joints.count(name) > 1:
            raise InputError(f"the joint {name!r} has two columns")
    if missing := [name for name in chain.joint_names if name not in joints]:
        raise InputError(f"no column for the joints {', '.join(missing)}")
    return columns


def _column(heading: str, chain: Chain, *, is_first: bool) -> Column:
    """Return a column by its heading: a joint's name, or times, and a unit in brackets."""
    name, unit = heading, None
    before, bracket, within = heading.removesuffix("]").rpartition("[")
    # a joint's own name may end in brackets
    if heading.endswith("]") and "]" not in within and bracket and before and heading not in chain.joint_names:
        name, unit = before.rstrip(), within.strip()
    if name in chain.joint_names:
        slides = chain.prismatic[chain.joint_index(name)]
        return Column(heading, name, _factor(heading, unit, units.LENGTH if slides else units.ANGLE))
    if is_first and name in _TIMES:
        return Column(heading, "", _factor(heading, unit, units.TIME))
    what = f"the column {name!r} is no joint of the chain; {nearest(name, chain.joint_names)}"
    raise InputError(what + (f"; times come first, as {name!r}" if name in _TIMES else ""))


def _factor(heading: str, unit: str | None, quantity: units.Quantity) -> float:
    if unit is None:
        return 1.0
    try:
        return units.parse(f"1 {unit}", quantity)
    except UnitError:
        allowed = ", ".join(quantity.units)
        raise InputError(f"{heading}: {unit!r} is not a unit of {quantity.name}; allowed: {allowed}") from None


def _between(values: Array, firsts: NDArray[np.intp], shares: Array) -> Array:
    """Return the rows at some fractions of the way from a row to the next, and the last row."""
    left, right = values[firsts], values[np.minimum(firsts + 1, len(values) - 1)]
    # a row itself stays as it is, bit by bit
    return np.concatenate([np.where(shares > 0, left + shares * (right - left), left), values[-1:]])
