"""Measured numbers in CSV files, with their units in the header.

    x [mm], rx [mrad]
    0.012, -0.3
    0.008, 0.1

The first row names the columns, each with its unit in brackets (none for a plain number). Commas separate the columns;
the decimal sign is a point. Blank lines and lines that begin with ``#`` are skipped.
"""

from __future__ import annotations

import csv
import math
import os
import re
import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, final

import numpy as np

from precision_pin.base import units
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnitError, UnknownNameError
from precision_pin.base.input_files import UnreadableFileError, read_text_file
from precision_pin.base.text_escape import shown
from precision_pin.base.units import Quantity

LARGEST_FILE: Final = 16 * 2**20

MOST_COLUMNS: Final = 1000
"""Columns of a file; a file with more has another form, such as all numbers in its first line."""

_HEADING: Final = re.compile(r"([^\[\]]+)(?:\[([^\[\]]*)\])?")
NUMBER: Final = re.compile(r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?", re.ASCII)
_NOT_PLAIN: Final = re.compile(r"[^0-9eE+\-., \t]")
_LONGEST: Final = 40


@final
@dataclass(frozen=True, eq=False)
class Measured:
    """Columns of a file.

    Attributes
    ----------
    file
        Name of the file, for messages.
    names
        Names of the columns.
    units
        Units of the columns, as written; empty for a plain number.
    rows
        The numbers as written in the file, not in SI, ``(R, C)``.
    texts
        Columns of text, by name.
    """

    file: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: Array
    texts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def unit(self, name: str) -> str:
        """Return a column's unit as written.

        Raises
        ------
        UnknownNameError
            There is no such column.
        """
        if name not in self.names:
            raise UnknownNameError(f"column in {self.file}", name, self.names)
        return self.units[self.names.index(name)]

    def column(self, name: str, *quantities: Quantity) -> tuple[float, ...]:
        """Return a column's numbers in SI.

        Raises
        ------
        InputError
            There is no such column, it has no unit or one of another quantity, or a number is too large.
        """
        unit = self.unit(name)
        wanted = " or ".join(quantity.name for quantity in quantities)
        if not unit and not any("" in quantity.units for quantity in quantities):
            si = quantities[0].si
            raise UnitError(
                f"{self.file}: the column {name!r} has no unit; write the unit of a {wanted} after its name: {name} [{si}]"
            )
        try:
            factor = units.parse(f"1 {unit}", *quantities)
        except UnitError:
            allowed = ", ".join(dict.fromkeys(unit for quantity in quantities for unit in quantity.units if unit))
            raise UnitError(
                f"{self.file}: {unit!r} of the column {name!r} is not a unit of {wanted}; allowed: {allowed}"
            ) from None
        position = self.names.index(name)
        with np.errstate(over="ignore"):
            values = self.rows[:, position] * factor
        if not (np.abs(values) <= units.LARGEST).all():
            raise InputError(f"{self.file}: the column {name!r} contains a number that is too large")
        return tuple(values.tolist())


def read(path: str | os.PathLike[str], texts: Collection[str] = ()) -> Measured:
    """Read a file.

    Parameters
    ----------
    path
        The file.
    texts
        Names of columns of text, where the file has them; all others hold numbers.

    Raises
    ------
    InputError
        The file does not exist, cannot be read or is larger than 16 MiB. Or, with the line: there is no header, a column
        has no name, two have one name, a row has another length, or a cell is no number.
    """
    file = os.fspath(path)
    lines = [(number, line) for number, line in enumerate(_text(file).splitlines(), start=1) if not _is_comment(line)]
    if len(lines) < 2:
        raise InputError(
            f"{file} contains no rows of numbers; it needs a header such as 'x [mm], y [mm]' and rows of numbers"
        )
    number, line = lines[0]
    where = f"{file}, line {number}"
    header = _header(_cells(line, where), where)
    wordy = [column for column, (name, _) in enumerate(header) if name in texts]
    rows = None if wordy else numbers([line for _, line in lines[1:]], len(header))
    words: list[list[str]] = []
    if rows is None:
        found = [_row(line, len(header), wordy, f"{file}, line {number}") for number, line in lines[1:]]
        rows, words = np.array([row for row, _ in found]), [cells for _, cells in found]
    plain = [entry for column, entry in enumerate(header) if column not in wordy]
    return Measured(
        file,
        tuple(name for name, _ in plain),
        tuple(unit for _, unit in plain),
        rows,
        {header[column][0]: tuple(cells[k] for cells in words) for k, column in enumerate(wordy)},
    )


def numbers(lines: Sequence[str], columns: int) -> Array | None:
    """Return lines of plain numbers separated by commas, read all at once, ``(R, C)``.

    None if any cell is something else: reading line by line then finds which.
    """
    if any(map(_NOT_PLAIN.search, lines)):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # raised for no lines, or blank ones only
            found = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    except (ValueError, UserWarning):
        return None
    return found if found.shape == (len(lines), columns) and np.isfinite(found).all() else None


def _cells(line: str, where: str) -> list[str]:
    if line.count('"') % 2:
        raise InputError(f"{where}: a quotation mark is not closed")
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        raise InputError(f"{where}: not a row of cells separated by commas: {error}") from None


def _row(line: str, columns: int, wordy: Sequence[int], where: str) -> tuple[list[float], list[str]]:
    """Return the numbers of a line, and its texts in the columns ``wordy``."""
    cells = _cells(line, where)
    if len(cells) != columns:
        raise InputError(f"{where}: {len(cells)} cells, but the header has {columns}")
    found = [_number(cell, where) for column, cell in enumerate(cells) if column not in wordy]
    return found, [cells[column] for column in wordy]


def _text(file: str) -> str:
    try:
        return read_text_file(file, LARGEST_FILE)
    except UnreadableFileError as error:
        raise InputError(f"{file} {error.reason}") from None


def _is_comment(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")


def _header(cells: list[str], where: str) -> list[tuple[str, str]]:
    if len(cells) > MOST_COLUMNS:
        raise InputError(f"{where}: {len(cells):,} columns, at most {MOST_COLUMNS:,} are allowed")
    header: dict[str, str] = {}
    for cell in cells:
        match = _HEADING.fullmatch(cell)
        name = "" if match is None else match[1].rstrip()
        if match is None or not name:
            hint = "; columns are separated by commas" if ";" in cell or "\t" in cell else ""
            raise InputError(f"{where}: {shown(cell, _LONGEST)} does not name a column such as 'x [mm]'{hint}")
        if name in header:
            raise InputError(f"{where}: two columns are named {shown(name, _LONGEST)}")
        header[name] = (match[2] or "").strip()
    if all(map(NUMBER.fullmatch, header)):
        raise InputError(f"{where}: the first row must name the columns and their units, such as 'x [mm], y [mm]'")
    return list(header.items())


def _number(cell: str, where: str) -> float:
    if NUMBER.fullmatch(cell) is None or not math.isfinite(float(cell)):
        raise InputError(f"{where}: {shown(cell, _LONGEST)} is not a number such as 0.012 or 1.2e-2")
    return float(cell)
