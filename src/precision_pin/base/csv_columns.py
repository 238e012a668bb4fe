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
from typing import Final

import numpy as np

from precision_pin.base import units
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnitError, UnknownNameError, nearest, shown
from precision_pin.base.files import UnreadableFileError, read_text_file
from precision_pin.base.units import QUANTITIES, Quantity

LARGEST_FILE: Final = 16 * 2**20
"""Bytes of a file: some 750,000 rows of two numbers, which take 1 s to read, or 10 s if a column holds text."""

MOST_COLUMNS: Final = 1000
"""A file with more columns has another form, such as all numbers in its first line."""

# a name with an optional unit in brackets; the name is needed in a header, and may be missing in the `columns` option
_HEADING: Final = re.compile(r"([^\[\]]+)(?:\[([^\[\]]*)\])?")
_COLUMN: Final = re.compile(r"([^\[\]]*)(?:\[([^\[\]]*)\])?")
NUMBER: Final = re.compile(r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?", re.ASCII)
"""Decimal number; stricter than ``float``, which also accepts ``1_000``, ``nan`` and digits of other scripts."""
# any other character goes to the slow reader, whose messages name the cell: numpy, too, accepts what `NUMBER` does not
_NOT_PLAIN: Final = re.compile(r"[^0-9eE+\-., \t]")
_LONGEST: Final = 40
"""Characters of a cell that a message shows, next to the file's name and line."""
IGNORE: Final = "ignore"
"""Name that drops a column in the `columns` option."""


@dataclass(frozen=True)
class ColumnNames:
    """Names and units of columns without them in the header.

    Attributes:
        names: (Name, unit or "") by the column's name in the file; the name ``ignore`` drops the column.
        units: Units of the other columns without one, one unit a quantity.
    """

    names: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    units: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> ColumnNames:
        """Parse ``x1=x [m], q1=joint1, t=ignore, *=[m rad]``; raise an :class:`InputError` for anything else."""
        names: dict[str, tuple[str, str]] = {}
        units: tuple[str, ...] = ()
        for entry in filter(None, map(str.strip, text.split(","))):
            column, equals, what = (part.strip() for part in entry.partition("="))
            match = _COLUMN.fullmatch(what)
            if not (column and equals and match and what) or column in names:
                raise InputError(
                    f"columns: {shown(entry, _LONGEST)} is not of the form 'COLUMN=NAME [UNIT]', 'COLUMN=[UNIT]', "
                    "'COLUMN=ignore' or '*=[m rad]', each column once"
                )
            name, unit = (match[1] or "").strip(), (match[2] or "").strip()
            if column == "*":
                units = tuple(unit.split())
                unknown = next((u for u in units if not any(u in q.units for q in QUANTITIES)), None)
                if unknown is not None:
                    raise UnitError(
                        f"columns: {shown(unknown, _LONGEST)} is not a unit; of lengths and angles: *=[m rad]"
                    )
            else:
                names[column] = (name or column, unit)
        return cls(names, units)

    def of(self, header: Mapping[str, str], where: str) -> list[tuple[str, str]]:
        """Return the name and unit of each column of a header."""
        for column in self.names:
            if column not in header:
                raise InputError(f"{where}: there is no column {column!r}; {nearest(column, header)}")
        renamed = [(*self.names.get(column, (column, "")), header_unit) for column, header_unit in header.items()]
        columns = [(name, unit or header_unit) for name, unit, header_unit in renamed]
        names = [name for name, _ in columns if name != IGNORE]
        duplicate = next((name for name in names if names.count(name) > 1), None)
        if duplicate is not None:
            raise InputError(f"{where}: two columns are named {shown(duplicate, _LONGEST)}")
        return columns


@dataclass(frozen=True, eq=False)
class Measured:
    """Columns of a file.

    Attributes:
        units: Units of the columns, as written; empty for a plain number.
        rows: ``(R, C)`` numbers as written, not in SI.
        texts: Text columns by name; ignored ones by their name in the file.
        usual: Default units of columns without a unit, one of each quantity.
        lines: ``(R,)`` line of each row in the file.
    """

    file: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: Array
    texts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    usual: tuple[str, ...] = ()
    lines: tuple[int, ...] = ()

    def unit(self, name: str) -> str:
        """Return a column's unit as written."""
        if name not in self.names:
            raise UnknownNameError(f"column in {self.file}", name, self.names)
        return self.units[self.names.index(name)]

    def unit_of(self, name: str, *quantities: Quantity) -> str:
        """Return a column's unit, or else the default unit of these quantities; empty if there is neither."""
        allowed = {unit for quantity in quantities for unit in quantity.units}
        return self.unit(name) or next(filter(allowed.__contains__, self.usual), "")

    def column(self, name: str, *quantities: Quantity) -> tuple[float, ...]:
        """Return a column's numbers in SI; NaN for missing cells."""
        unit = self.unit_of(name, *quantities)
        kinds = " or ".join(quantity.name for quantity in quantities)
        if not unit and not any("" in quantity.units for quantity in quantities):
            si = quantities[0].si
            raise UnitError(
                f"{self.file}: the column {name!r} has no unit; write the unit of a {kinds} after its name: {name} [{si}]"
            )
        try:
            factor = units.parse(f"1 {unit}", *quantities)
        except UnitError:
            allowed = ", ".join(dict.fromkeys(unit for quantity in quantities for unit in quantity.units if unit))
            message = f"{self.file}: {unit!r} of the column {name!r} is not a unit of {kinds}; allowed: {allowed}"
            raise UnitError(message) from None
        with np.errstate(over="ignore"):
            values = self.rows[:, self.names.index(name)] * factor
        if (np.abs(values) > units.LARGEST).any():
            raise InputError(f"{self.file}: the column {name!r} contains a number that is too large")
        return tuple(values.tolist())


def read(
    path: str | os.PathLike[str],
    texts: Collection[str] = (),
    *,
    columns: ColumnNames | None = None,
    ignored: Collection[str] = (),
    may_miss: bool = False,
) -> Measured:
    """Read a file.

    Args:
        texts: Names of text columns, if the file has them; all others hold numbers.
        columns: Names and units that the header lacks.
        ignored: Names, in lower case, of columns to skip.
        may_miss: Whether a cell may be empty, nan or NA; it becomes NaN.
    """
    file = os.fspath(path)
    try:
        numbered = enumerate(read_text_file(file, LARGEST_FILE).splitlines(), start=1)
    except UnreadableFileError as error:
        raise InputError(f"{file} {error.reason}") from None
    lines = [(n, line) for n, line in numbered if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) < 2:
        message = f"{file} contains no rows of numbers; it needs a header such as 'x [mm], y [mm]' and rows of numbers"
        raise InputError(message)
    n, line = lines[0]
    where = f"{file}, line {n}"
    column_names = columns or ColumnNames()
    header_units = _header(_cells(line, where), where)
    header = [
        (column if is_ignored else name, unit, is_ignored or name in texts)
        for column, (name, unit) in zip(header_units, column_names.of(header_units, where), strict=True)
        for is_ignored in (name == IGNORE or name.casefold() in ignored,)
    ]
    text_columns = [column for column, (_, _, is_text) in enumerate(header) if is_text]
    rows = None if text_columns else numbers([line for _, line in lines[1:]], len(header))
    text_rows: list[list[str]] = []
    if rows is None:
        parsed = [_row(line, len(header), text_columns, f"{file}, line {n}", may_miss) for n, line in lines[1:]]
        rows, text_rows = np.array([row for row, _ in parsed]), [cells for _, cells in parsed]
    number_columns = [entry for entry in header if not entry[2]]
    return Measured(
        file,
        tuple(name for name, _, _ in number_columns),
        tuple(unit for _, unit, _ in number_columns),
        rows,
        {header[column][0]: tuple(cells[k] for cells in text_rows) for k, column in enumerate(text_columns)},
        column_names.units,
        tuple(n for n, _ in lines[1:]),
    )


def numbers(lines: Sequence[str], columns: int) -> Array | None:
    """Return comma-separated lines of plain numbers, parsed together, ``(R, C)``; None if any cell is not a number."""
    if any(map(_NOT_PLAIN.search, lines)):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy warns about input without data
            rows = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    except (ValueError, UserWarning):
        return None
    return rows if rows.shape == (len(lines), columns) and np.isfinite(rows).all() else None


def _cells(line: str, where: str) -> list[str]:
    if line.count('"') % 2:
        raise InputError(f"{where}: a quotation mark is not closed")
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        raise InputError(f"{where}: not a row of cells separated by commas: {error}") from None


def _row(
    line: str, columns: int, text_columns: Sequence[int], where: str, may_miss: bool
) -> tuple[list[float], list[str]]:
    """Return the numbers of a line, and the texts of its ``text_columns``."""
    cells = _cells(line, where)
    if len(cells) != columns:
        raise InputError(f"{where}: {len(cells)} cells, but the header has {columns}")
    row_numbers = [
        math.nan if may_miss and cell.casefold() in ("", "nan", "na", "n/a", "null") else _number(cell, where)
        for column, cell in enumerate(cells)
        if column not in text_columns
    ]
    return row_numbers, [cells[column] for column in text_columns]


def _header(cells: list[str], where: str) -> dict[str, str]:
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
    return header


def _number(cell: str, where: str) -> float:
    if NUMBER.fullmatch(cell) is None or not math.isfinite(float(cell)):
        raise InputError(f"{where}: {shown(cell, _LONGEST)} is not a number such as 0.012 or 1.2e-2")
    return float(cell)
