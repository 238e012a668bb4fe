"""A trajectory in a CSV file: joint values, one pose a row, perhaps with times."""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import units
from precision_pin.base.arguments import check_callable, check_instance, check_number, check_path, check_whole
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.csv_columns import (
    IGNORE,
    TIMES,
    ColumnNames,
    TableForm,
    is_row,
    numbers,
    read_header,
    split_heading,
)
from precision_pin.base.errors import InputError, nearest, shown
from precision_pin.base.files import UnreadableFileError, decode, read_regular_file
from precision_pin.robot.chain import Chain, HasChain, chain_of
from precision_pin.robot.configurations import joint_quantity
from precision_pin.robot.joint_columns import Column, recorded
from precision_pin.robot.pose_grids import MOST_POSES
from precision_pin.robot.pose_set import PoseSet

_LONGEST: Final = 40  # letters of a cell in a message
_LARGEST_FILE: Final = 256 * 2**20  # bytes
_AT_ONCE: Final = 2**13
"""Lines read together."""
_Wrong = Callable[[str, int | None], InputError]
"""Makes the error for a line."""
_LATEST: Final = 1e11
"""Time in s, in the year 5138, above which its unit counts as wrong."""
_ROUNDING: Final = 1e-9
"""Fraction of a step by which an interval may exceed a whole number of steps, for rounding."""


@dataclass(frozen=True, eq=False)
class Trajectory(Fixed):
    """Poses in order: joint values in chain order ``(P, n)``, rad or m, and times ``(P,)``, s, if the file has them.

    ``rows`` are the file's rows, from 1, ``(P,)``, fractions between two rows. ``columns`` are in the file's order, times
    first; ``recorder`` is the recorder in words whose columns were recognised.
    """

    chain: Chain
    values: Array
    times: Array | None
    rows: Array
    columns: tuple[Column, ...]
    recorder: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each pose: its time, or else its row."""
        if self.times is None:
            return tuple(f"row {row:.10g}" for row in self.rows.tolist())
        # as many digits as tell neighbours apart: clocks may count from 1970
        ratio = np.abs(self.times).max() / np.diff(self.times).min(initial=math.inf)
        digits = min(max(6, 1 + math.ceil(math.log10(max(ratio, 1.0)))), 17)
        return tuple(f"t = {time:.{digits}g} s" for time in self.times.tolist())

    @property
    def poses(self) -> PoseSet:
        """The poses with the status of each."""
        return self.pose_set()

    def pose_set(self, step: Callable[[int], object] = lambda _: None) -> PoseSet:
        """Return the poses with their statuses; ``step`` takes the number of poses done since its last call."""
        poses = PoseSet.at(self.chain, np.ascontiguousarray(self.values.T), self.names, self.times, step)
        return replace(poses, columns=self.columns)

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
        motions = np.abs(np.diff(self.values, axis=0))
        parts = np.ones(len(motions))
        for name, step, distances, missing in (
            ("time_step", time_step, None if self.times is None else np.diff(self.times)[:, None], "no times"),
            ("angle_step", angle_step, motions[:, ~slides], "no joint that turns"),
            ("length_step", length_step, motions[:, slides], "no joint that slides"),
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
        firsts = np.repeat(np.arange(len(motions)), counts)
        shares = (np.arange(len(firsts)) - np.repeat(np.cumsum(counts) - counts, counts)) / np.repeat(parts, counts)
        return replace(
            self,
            values=_interpolate(self.values, firsts, shares[:, None]),
            times=None if self.times is None else _interpolate(self.times, firsts, shares),
            rows=_interpolate(self.rows, firsts, shares),
        )


def read_trajectory(
    path: str | os.PathLike[str],
    chain: Chain | HasChain,
    most: int = MOST_POSES,
    progress: Callable[[int], object] = lambda _: None,
    columns: str = "",
) -> Trajectory:
    """Read a trajectory: a row of joint names in any order, then a row of values for each pose.

    A unit may follow a name, as in ``joint1 [deg]``; without one values are in rad or m. A column named ``t``, ``time``,
    ``timestamp``, ``stamp``, ``__time`` (s) or ``%time`` (ns) holds increasing times, unless a joint has that name.
    Commas, semicolons, tabs or spaces separate the columns; with the last three there may be decimal commas. Files of
    UR's RTDE recorder, of ``rostopic echo -p`` and of PlotJuggler are read as they are.

    Args:
        path: The file, UTF-8.
        chain: The chain, or a model that has one, whose joints the columns are.
        most: Most poses allowed.
        progress: Function called with the number of characters read since its last call.
        columns: Names and units of columns that the first row does not give: ``"q1=joint1 [deg], stamp=t [ns],
            note=ignore"``; ``"*=[deg]"`` is the unit of all angles without one, ``"*=ignore"`` drops all other columns.

    Raises:
        InputError: The file cannot be read, is larger than 256 MiB, names other joints, has a wrong unit, or holds a
            value that is not finite, or without a unit far outside the limits; the error gives the line.

    Examples:
        >>> header = "t,joint1 [deg],joint2,joint3,joint4"
        >>> np.savetxt("swing.csv", [[0, 0, 0, 0, 0], [1, 90, 0, 0, 0]], delimiter=",", header=header, comments="")
        >>> swing = pp.read_trajectory("swing.csv", pp.Chain.from_urdf("4dof.urdf", tip="tool"))
        >>> print(swing.times, swing.poses.q[0].round(3))
        [0. 1.] [0.    1.571]
    """
    check_callable("progress", progress)
    chain = chain_of(chain)
    check_whole("the most poses", most, 1, MOST_POSES)
    column_names = ColumnNames.parse(check_instance("columns", columns, str, "such as 'q1=joint1 [deg], n=ignore'"))
    file = os.fspath(check_path("the path of the trajectory", path))

    def wrong(message: str, line: int | None = None) -> InputError:
        return InputError.of("E_TRAJECTORY", message, file, line)

    try:
        data = read_regular_file(file, _LARGEST_FILE)
        if not data.isascii():
            decode(data)  # raises if not UTF-8
        # a line at a time: decoding and splitting a large file at once would stall the progress bar
        lines = io.TextIOWrapper(io.BytesIO(data), "utf-8-sig")
        line, header = next(((number, text) for number, text in enumerate(lines, 1) if is_row(text)), (0, ""))
        if not line:
            raise wrong("the file is empty; it begins with a row of joint names")
        head_lines: list[str] = []
        while (not head_lines or not is_row(head_lines[-1])) and (text := next(lines, "")):
            head_lines.append(text)
        row = head_lines[-1] if head_lines else ""
        has_commas = data.find(b",", data.find(row.strip().encode())) >= 0
        table = _call_at(line, wrong, _Table, header, row, has_commas, chain, column_names)
        # quoted text may span several lines
        batch_size = None if b'"' in data else _AT_ONCE
        parts: list[Array] = []
        count, last_time, first = 0, -math.inf, line
        all_lines = itertools.chain(head_lines, lines)
        while batch := list(itertools.islice(all_lines, batch_size)):
            part = table.plain([plain for raw in batch if (plain := raw.strip()) and plain[0] != "#"], last_time)
            if part is None or len(part) > most - count:
                part = table.row_by_row(batch, first, last_time, count, most, wrong)
            parts.append(part)
            count, last_time = count + len(part), part[-1, 0] if len(part) else last_time
            first += len(batch)
            progress(sum(map(len, batch)))
    except UnreadableFileError as problem:
        raise wrong(f"the file {problem.reason}") from None
    except csv.Error as problem:
        raise wrong(f"no CSV: {problem}") from None
    if not count:
        raise wrong("no poses: no row follows the joint names", line)
    return _call_at(None, wrong, table.trajectory, np.concatenate(parts))


def _call_at(line: int | None, wrong: _Wrong, make: Callable[..., Any], *arguments: Any) -> Any:
    """Return the result of a function; its error gets the file and the line."""
    try:
        return make(*arguments)
    except InputError as error:
        raise wrong(error.findings[0].message, line) from None


class _Table:
    """Columns of a file by its first two rows, and how its lines are read: times first, then the joints of ``columns``."""

    def __init__(self, header: str, row: str, has_commas: bool, chain: Chain, column_names: ColumnNames) -> None:
        self.form, self.chain = TableForm.of(header, row, has_commas), chain
        self.quantities = {joint.name: joint_quantity(joint) for joint in chain.joints}
        cells, si = self.form.cells(header), {name: quantity.si for name, quantity in self.quantities.items()}
        self.named = recorded(cells, self.form.cells(row), si, column_names)
        headings = read_header(cells, si, " [".join(next(iter(si.items()))) + "]")
        columns = {
            k: self._column(cells[k], name, unit)
            for k, (name, unit) in enumerate(
                self.named.of(headings, lambda name: name in si or name.casefold() in TIMES)
            )
            if name != IGNORE and name not in self.named.cells
        }
        self.count, self.texts = len(cells), [(cells.index(cell), text) for cell, text in self.named.cells.items()]
        self.used = sorted(columns, key=lambda k: bool(columns[k].joint))
        self.columns = [columns[k] for k in self.used]
        joints = [column.joint for column in self.columns]
        for name in joints:
            if joints.count(name) > 1:
                raise InputError(
                    f"{f'the joint {name!r}' if name else 'the time'} has two columns; --columns drops one"
                )
        if missing := [name for name in si if name not in joints]:
            raise InputError(f"no column for the joints {', '.join(missing)}")

    def _column(self, cell: str, name: str, unit: str) -> Column:
        is_time = name not in self.quantities
        if is_time and name.casefold() not in TIMES:
            message = f"the column {name!r} is no joint of the chain; {nearest(name, self.quantities)}"
            raise InputError(f"{message}; --columns '{name}=JOINT [rad]' names its joint, '{name}=ignore' drops it")
        quantity = units.TIME if is_time else self.quantities[name]
        explicit_unit = unit or next(filter(quantity.units.__contains__, self.named.units), "")
        unit = explicit_unit or (TIMES[name.casefold()] if is_time else quantity.si)
        if unit not in quantity.units:
            raise InputError(f"{cell}: {unit!r} is not a unit of {quantity.name}; allowed: {', '.join(quantity.units)}")
        heading = cell if split_heading(cell, self.quantities)[1:] == (name, explicit_unit) else f"{name} [{unit}]"
        return Column(heading, "" if is_time else name, units.parse(f"1 {unit}", quantity), bool(explicit_unit))

    def plain(self, lines: Sequence[str], last_time: float) -> Array | None:
        """Return the values of lines of plain numbers at once; ``None`` if anything is wrong, to be found row by row."""
        lines = self.form.plain(lines)
        part = None if self.texts else numbers(lines, self.count)
        if part is not None:
            part = part[:, self.used]
        elif len(self.used) < self.count:
            rows = [line.split(",") for line in lines]
            if all(len(row) == self.count and all(row[k] == text for k, text in self.texts) for row in rows):
                part = numbers([",".join([row[k] for k in self.used]) for row in rows], len(self.used))
        if part is None:
            return None
        values: Array = part * [column.factor for column in self.columns]
        increasing = self.columns[0].joint or (np.diff(values[:, 0], prepend=last_time) > 0).all()
        return values if increasing and np.isfinite(values).all() else None

    def row_by_row(
        self, lines: Iterable[str], first: int, last_time: float, count: int, most: int, wrong: _Wrong
    ) -> Array:  # fmt: skip
        """Return the values of rows after ``count`` others ending at the time ``before``; raise at an invalid row."""
        rows: list[list[float]] = []
        reader = self.form.rows(lines)
        for row in reader:
            line, cells = first + reader.line_num, [cell.strip() for cell in row]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if count + len(rows) == most:
                raise wrong(f"more than {most} poses; leave rows out", line)
            if len(cells) != self.count:
                raise wrong(f"{len(cells)} values for {self.count} columns", line)
            if mismatches := [(cells[k], text) for k, text in self.texts if cells[k] != text]:
                raise wrong(f"{', and in the first row '.join(shown(cell, _LONGEST) for cell in mismatches[0])}", line)
            values = []
            for k, column in zip(self.used, self.columns, strict=True):
                values.append(self.form.number(cells[k]) * column.factor)
                if not math.isfinite(values[-1]):
                    hint = self.form.hint(cells[k])
                    raise wrong(f"{column.heading}: {shown(cells[k], _LONGEST)} is not a finite number{hint}", line)
            if not self.columns[0].joint and not values[0] > last_time:
                stop, back = f"stands still at {last_time:.10g} s", f"goes back from {last_time:g} s to {values[0]:g} s"
                raise wrong(
                    f"the time {stop if values[0] == last_time else back}; it must increase from row to row", line
                )
            rows.append(values)
            last_time = values[0]
        return np.array(rows).reshape(-1, len(self.columns))

    def trajectory(self, values: Array) -> Trajectory:
        """Return the trajectory of all values; raise if those of a column without a unit are far outside."""
        joints = [column.joint for column in self.columns]
        order = [joints.index(name) for name in self.chain.joint_names]
        q, times, reader = values[:, order].T, None if joints[0] else values[:, 0], self.chain.configurations
        if times is not None and not self.columns[0].has_unit and times[-1] > _LATEST:
            message = f"{self.columns[0].heading} = {times[-1]:g} s is beyond all clocks; give its unit"
            raise InputError(f"{message}: --columns '{self.columns[0].heading}=[ns]'")
        has_unit = np.array([self.columns[k].has_unit for k in order]) | np.isinf(reader.limits[1] - reader.limits[0])
        if (is_far := ~has_unit[:, None] & reader.far(q)).any():
            joint, row = np.argwhere(is_far)[0]
            unit, other = ("rad", "deg") if reader.turning[joint] else ("m", "mm")
            message = f"row {row + 1}: {reader.names[joint]} = {q[joint, row]:g} {unit} is far outside its limits"
            raise InputError(f"{message}; if the file is in {other} add --columns '*=[{other}]'")
        rows = np.arange(1.0, len(values) + 1)
        return Trajectory(self.chain, reader.taken(q).T, times, rows, tuple(self.columns), self.named.recorder)


def _interpolate(values: Array, firsts: NDArray[np.intp], shares: Array) -> Array:
    """Return the rows at some fractions of the way from a row to the next, and the last row."""
    left, right = values[firsts], values[np.minimum(firsts + 1, len(values) - 1)]
    # a row itself stays as it is, bit by bit
    return np.concatenate([np.where(shares > 0, left + shares * (right - left), left), values[-1:]])
