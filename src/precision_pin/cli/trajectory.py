"""A trajectory out of a CSV file: joint values, one pose a row."""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, final

import numpy as np

from precision_pin.errors import Finding, InputError, nearest
from precision_pin.inputs.csv_columns import LARGEST_FILE, NUMBER
from precision_pin.inputs.files import UnreadableFileError, read_text_file
from precision_pin.typing import Array

if TYPE_CHECKING:
    from precision_pin.robot.chain import Chain
from precision_pin.visible import shown

__all__ = ["Trajectory", "read_trajectory"]


_TIME: Final = "t"
_LONGEST: Final = 40


@final
@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses in order.

    Attributes
    ----------
    values
        Joint values in chain order, ``(P, n)``, rad or m.
    times
        ``(P,)`` s; ``None`` where the file has none.
    columns
        Names of the columns, as in the file.
    """

    values: Array
    times: Array | None
    columns: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each pose: its time, or its number from 1."""
        if self.times is None:
            return tuple(f"row {number}" for number in range(1, len(self.values) + 1))
        return tuple(f"t = {time:g} s" for time in self.times)


def read_trajectory(path: str | os.PathLike[str], chain: Chain, most: int) -> Trajectory:
    """Read a trajectory: a row of joint names in any order, then a row of values (rad or m) for each pose.

    A first column named ``t`` holds times in s, which do not decrease, unless a joint of the chain has that name.

    Parameters
    ----------
    path
        The file, UTF-8, with commas.
    chain
        Whose joints the columns are.
    most
        The most poses there may be.

    Raises
    ------
    InputError
        The file cannot be read, names other joints, or holds a value that is not a finite number; one line that says where.
    """
    file = os.fspath(path)

    def wrong(message: str, line: int | None = None) -> InputError:
        return InputError([Finding("error", "E_TRAJECTORY", message, file, line)])

    try:
        reader = csv.reader(io.StringIO(read_text_file(file, LARGEST_FILE)))
        # the line a row ends on, which is its only one unless it holds line breaks in quotes
        filled = ((reader.line_num, [cell.strip() for cell in row]) for row in reader if any(map(str.strip, row)))
        rows = list(itertools.islice(filled, most + 2))
    except UnreadableFileError as problem:
        raise wrong(f"the file {problem.reason}") from None
    except (csv.Error, ValueError) as problem:
        raise wrong(f"no CSV: {problem}") from None
    if not rows:
        raise wrong("the file is empty; it begins with a row of joint names")
    line, header = rows[0]
    timed = header[0] == _TIME and _TIME not in chain.joint_names
    columns = header[1:] if timed else header
    for name in columns:
        if name not in chain.joint_names:
            what = f"the column {name!r} is no joint of the chain; {nearest(name, chain.joint_names)}"
            raise wrong(what + (f"; times come first, as {_TIME!r}" if name == _TIME else ""), line)
        if columns.count(name) > 1:
            raise wrong(f"the joint {name!r} has two columns", line)
    missing = [name for name in chain.joint_names if name not in columns]
    if missing:
        raise wrong(f"no column for the joints {', '.join(missing)}", line)
    if len(rows) < 2:
        raise wrong("no poses: no row follows the joint names", line)
    if len(rows) - 1 > most:
        raise wrong(f"more than {most} poses; leave rows out", rows[most + 1][0])
    numbers = np.empty((len(rows) - 1, len(header)))
    for row, (line, cells) in enumerate(rows[1:]):
        if len(cells) != len(header):
            raise wrong(f"{len(cells)} values for {len(header)} columns", line)
        for column, cell in enumerate(cells):
            numbers[row, column] = _number(cell)
            if not math.isfinite(numbers[row, column]):
                raise wrong(f"{header[column]}: {shown(cell, _LONGEST)} is not a finite number", line)
        if timed and row and numbers[row, 0] < numbers[row - 1, 0]:
            raise wrong(f"the time goes back from {numbers[row - 1, 0]:g} s to {numbers[row, 0]:g} s", line)
    order = [header.index(name) for name in chain.joint_names]
    return Trajectory(numbers[:, order], numbers[:, 0] if timed else None, tuple(header))


def _number(cell: str) -> float:
    # float() takes 1_000 and other digits than 0 to 9 as well
    return float(cell) if NUMBER.fullmatch(cell) else math.nan
