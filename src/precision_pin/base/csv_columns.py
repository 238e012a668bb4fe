"""Measured numbers in CSV files, with their units in the header.

    x [mm], rx [mrad]
    0.012, -0.3
    0.008, 0.1

The first row names the columns, each with its unit in brackets (none for a plain number). Commas separate the columns,
or semicolons, tabs or blanks, beside which a decimal comma is read too. Blank lines and lines that begin with ``#`` are
skipped.
"""

from __future__ import annotations

import csv
import math
import os
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from precision_pin.base import units
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnitError, UnknownNameError, nearest, shown
from precision_pin.base.files import UnreadableFileError, read_text_file
from precision_pin.base.units import QUANTITIES, Quantity

if TYPE_CHECKING:
    from _csv import Reader as CsvReader

LARGEST_FILE: Final = 16 * 2**20
"""Bytes of a file: some 750,000 rows of two numbers, which take 1 s to read, or 10 s if a column holds text."""

MOST_COLUMNS: Final = 1000
"""A file with more columns has another form, such as all numbers in its first line."""

_COLUMN: Final = re.compile(r"([^\[\]]*)(?:\[([^\[\]]*)\])?")
NUMBER: Final = re.compile(r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?", re.ASCII)
_NOT_PLAIN: Final = re.compile(r"[^0-9eE+\-., \t]")
_BETWEEN: Final = re.compile(r"(?<![ \t])[ \t]++(?!\[)")
"""Blanks between columns, not those before a unit."""
_LONGEST: Final = 40
"""Characters of a cell that a message shows, next to the file's name and line."""
_HEAD: Final = 2**16
"""Characters among which the first two rows of a file are looked for."""
_EXAMPLE: Final = "x [mm], y [mm]"
IGNORE: Final = "ignore"
"""Name that drops a column in the `columns` option."""
Heading = tuple[str, str, str]
"""A cell of the first row as written, and the name and unit in it."""
TIMES: Final = {"t": "s", "time": "s", "timestamp": "s", "stamp": "s", "__time": "s", "%time": "ns"}
"""Names of columns of times, in lower case, and their units if none follows; ROS writes ``%time`` in ns."""


@dataclass(frozen=True)
class TableForm:
    """Separator of the columns, ``" "`` for any blanks, and decimal sign of a file."""

    separator: str = ","
    decimal: str = "."

    @classmethod
    def of(cls, header: str, row: str, has_commas: bool) -> TableForm:
        """Return the form of a file by its first two rows, and whether there are commas below the first.

        The separator is one that divides both rows into equally many cells.
        """
        heads = {mark: len(cls(mark).cells(header)) for mark in (";", ",", "\t", " ")}
        alike = [mark for mark, count in heads.items() if len(cls(mark).cells(row[:_HEAD])) == count > 1]
        separator = alike[0] if alike else max((",", ";", "\t"), key=header.count)
        return cls(separator, "," if separator != "," and has_commas else ".")

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line."""
        if line.count('"') % 2:
            raise InputError("a quotation mark is not closed")
        return [cell.strip() for cell in next(self.rows([line]), [])]

    def rows(self, lines: Iterable[str]) -> CsvReader:
        """Return a reader of the cells of lines."""
        is_blank = self.separator == " "
        between = (_BETWEEN.sub("\t", line.strip()) for line in lines) if is_blank else lines
        return csv.reader(between, delimiter="\t" if is_blank else self.separator)

    def plain(self, lines: Sequence[str]) -> Sequence[str]:
        """Return lines without quotation marks with commas between the cells, and decimal points."""
        if self.separator == ",":
            return lines
        # a point beside decimal commas is no number
        signs = {ord(","): ".", ord("."): "?"} if self.decimal == "," else {}
        if self.separator == " ":
            return [",".join(line.translate(signs).split()) for line in lines]
        signs[ord(self.separator)] = ","
        return [line.translate(signs) for line in lines]

    def number(self, cell: str) -> float:
        """Return the finite number in a cell; NaN if there is none."""
        plain = cell if self.decimal == "." else cell.replace(".", "?").replace(",", ".")
        # float() takes 1_000 and other digits than 0 to 9 as well
        value = float(plain) if NUMBER.fullmatch(plain) else math.nan
        return value if math.isfinite(value) else math.nan

    def hint(self, cell: str) -> str:
        """Return the end of a message about a cell that holds no number."""
        is_other = ("," in cell or self.decimal == ",") and NUMBER.fullmatch(cell.replace(",", "."))
        separated = "; with decimal commas, semicolons separate the columns"
        return "" if not is_other else separated if self.decimal == "." else "; other numbers have a decimal comma"


@dataclass(frozen=True)
class ColumnNames:
    """Names and units of columns whose header does not give them.

    Attributes:
        names: (Name, unit or "") by the column's name in the file; the name ``ignore`` drops the column.
        units: Units of the other columns without one, one unit a quantity.
        ignores_others: Whether columns that are neither named here nor known to the reader are dropped.
        cells: Texts that columns must have in every row; they are dropped.
        recorder: The recorder whose columns these are, in words.
    """

    names: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    units: tuple[str, ...] = ()
    ignores_others: bool = False
    cells: Mapping[str, str] = field(default_factory=dict)
    recorder: str = ""

    @classmethod
    def parse(cls, text: str) -> ColumnNames:
        """Parse ``x1=x [m], q1=joint1, t=ignore, *=[m rad], *=ignore``; raise an :class:`InputError` for anything else."""
        names: dict[str, tuple[str, str]] = {}
        units: tuple[str, ...] = ()
        for entry in filter(None, map(str.strip, text.split(","))):
            column, equals, what = (part.strip() for part in entry.partition("="))
            match = _COLUMN.fullmatch(what)
            if not (column and equals and match and what) or column in {*names} - {"*"}:
                raise InputError(
                    f"columns: {shown(entry, _LONGEST)} is not of the form 'COLUMN=NAME [UNIT]', 'COLUMN=[UNIT]', "
                    "'COLUMN=ignore', '*=[m rad]' or '*=ignore', each column once"
                )
            name, unit = (match[1] or "").strip(), (match[2] or "").strip()
            if column == "*" and what != IGNORE:
                units = tuple(unit.split())
                unknown = next((label for label in units if not any(label in each.units for each in QUANTITIES)), None)
                if unknown is not None:
                    raise UnitError(
                        f"columns: {shown(unknown, _LONGEST)} is not a unit; of lengths and angles: *=[m rad]"
                    )
            else:
                names[column] = (name or column, unit)
        return cls(names, units, names.pop("*", None) is not None)

    def of(self, header: Sequence[Heading], known: Callable[[str], object]) -> list[tuple[str, str]]:
        """Return the name and unit of each column of a header; ``known`` tells which other names the reader takes."""
        present = {name for heading in header for name in heading[:2]}
        for column in self.names:
            if column not in present:
                raise InputError(f"there is no column {column!r}; {nearest(column, present)}")
        columns = []
        for cell, name, unit in header:
            is_dropped = not cell or (self.ignores_others and not (known(name) or name in self.cells))
            new, given = self.names.get(cell) or self.names.get(name) or (IGNORE if is_dropped else name, "")
            columns.append((new, given or unit))
        return columns


def columns_for(file: str, text: str | None, files: Iterable[str | None], usual: Iterable[str] = ()) -> str:
    """Return the entries of a text for :meth:`ColumnNames.parse` that are for one of the files that share it.

    Left out are those of columns that only others of the ``files`` have. Without a text, the entries of ``usual`` texts
    for columns that the file has.
    """
    others = {name for path in files if path not in (None, file) for name in names_in(path)}
    if text is not None and not others:
        return text
    names = names_in(file)
    listed = dict.fromkeys(entry.strip() for value in (usual if text is None else [text]) for entry in value.split(","))
    named = [(entry, entry.partition("=")[0].strip()) for entry in listed]
    is_kept = names.__contains__ if text is None else lambda name: name in names or name not in others
    return ",".join(entry for entry, name in named if is_kept(name))


def names_in(file: str) -> set[str]:
    """Return the names of a file's columns, as written and without units; empty if it cannot be read."""
    header = list[str]()
    with suppress(OSError, InputError, csv.Error), open(file if os.path.isfile(file) else os.devnull, "rb") as stream:
        lines = [*filter(is_row, stream.read(_HEAD).decode("utf-8-sig", "replace").splitlines()), "", ""]
        header = TableForm.of(lines[0], lines[1], False).cells(lines[0])
    return {name for cell in header for name in split_heading(cell)[:2]}


@dataclass(frozen=True, eq=False)
class Measured:
    """Columns of a file.

    Attributes:
        units: Units of the columns, as written; empty for a plain number.
        rows: ``(R, C)`` numbers as written, not in SI.
        texts: Text columns by name; ignored ones by their name in the file.
        usual: Units of columns that have none, one of each quantity.
        lines: ``(R,)`` line of each row in the file.
        recorder: The recorder whose columns were recognised, in words.
    """

    file: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: Array
    texts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    usual: tuple[str, ...] = ()
    lines: tuple[int, ...] = ()
    recorder: str = ""

    def unit(self, name: str) -> str:
        """Return a column's unit as written."""
        if name not in self.names:
            raise UnknownNameError(f"column in {self.file}", name, self.names)
        return self.units[self.names.index(name)]

    def unit_of(self, name: str, *quantities: Quantity) -> str:
        """Return a column's unit, or else the usual one of these quantities; empty if there is neither."""
        allowed = {unit for quantity in quantities for unit in quantity.units}
        return self.unit(name) or next(filter(allowed.__contains__, self.usual), "")

    def column(self, name: str, *quantities: Quantity) -> tuple[float, ...]:
        """Return a column's numbers in SI; NaN for missing cells."""
        unit = self.unit_of(name, *quantities)
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
            message = f"{self.file}: {unit!r} of the column {name!r} is not a unit of {wanted}; allowed: {allowed}"
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
    columns: ColumnNames | Callable[[list[str], list[str]], ColumnNames] = ColumnNames(),
    known: Callable[[str], object] = lambda _: True,
    ignored: Collection[str] = (),
    may_miss: bool = False,
) -> Measured:
    """Read a file.

    Args:
        texts: Names of text columns, if the file has them; all others hold numbers.
        columns: Names and units where the header does not give them; may be a function of the cells of the first two rows.
        known: Tells which columns are kept if ``columns`` drops others.
        ignored: Names, in lower case, of columns to skip.
        may_miss: Whether a cell may be empty, nan or NA; it becomes NaN.
    """
    file = os.fspath(path)
    try:
        numbered = enumerate(read_text_file(file, LARGEST_FILE).splitlines(), start=1)
    except UnreadableFileError as error:
        raise InputError(f"{file} {error.reason}") from None
    lines = [(number, line) for number, line in numbered if is_row(line)]
    if len(lines) < 2:
        message = f"{file} contains no rows of numbers; it needs a header such as {_EXAMPLE!r} and rows of numbers"
        raise InputError(message)
    (number, line), below = lines[0], [line for _, line in lines[1:]]
    with _at(f"{file}, line {number}"):
        form = TableForm.of(line, below[0], any("," in line for line in below))
        cells = form.cells(line)
        named = columns if isinstance(columns, ColumnNames) else columns(cells, form.cells(below[0]))
        header = [
            (cell if is_ignored else name, unit, is_ignored or name in texts or name in named.cells)
            for cell, (name, unit) in zip(cells, named.of(read_header(cells), known), strict=True)
            for is_ignored in (name == IGNORE or name.casefold() in ignored,)
        ]
        names = [name for name, _, _ in header]
        if (twice := next((name for name in names if name and names.count(name) > 1), None)) is not None:
            raise InputError(f"two columns are named {shown(twice, _LONGEST)}")
    wordy = [column for column, (_, _, is_text) in enumerate(header) if is_text]
    rows = None if wordy else numbers(form.plain(below), len(header))
    words: list[list[str]] = []
    if rows is None:
        pairs = []
        for number, line in lines[1:]:
            with _at(f"{file}, line {number}"):
                pairs.append(_row(form, form.cells(line), header, named.cells, may_miss))
        rows, words = np.array([row for row, _ in pairs]), [texts for _, texts in pairs]
    plain = [entry for entry in header if not entry[2]]
    return Measured(
        file,
        tuple(name for name, _, _ in plain),
        tuple(unit for _, unit, _ in plain),
        rows,
        {names[column]: tuple(cells[k] for cells in words) for k, column in enumerate(wordy)},
        named.units,
        tuple(number for number, _ in lines[1:]),
        named.recorder,
    )


def numbers(lines: Sequence[str], columns: int) -> Array | None:
    """Return comma-separated lines of plain numbers, parsed at once, ``(R, C)``; None if any cell is something else."""
    if any(map(_NOT_PLAIN.search, lines)):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy warns about input without data
            values = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    except (ValueError, UserWarning):
        return None
    return values if values.shape == (len(lines), columns) and np.isfinite(values).all() else None


def is_row(line: str) -> bool:
    """Return whether a line is neither blank nor a comment."""
    return bool(start := line.lstrip()) and start[0] != "#"


@contextmanager
def _at(where: str) -> Iterator[None]:
    """Put the place in front of the message of an error."""
    try:
        yield
    except (InputError, csv.Error) as error:
        what = error.findings[0].message if isinstance(error, InputError) else f"not a row of cells: {error}"
        raise InputError(f"{where}: {what}") from None


def _row(
    form: TableForm, cells: list[str], header: Sequence[tuple[str, str, bool]], fixed: Mapping[str, str], may_miss: bool
) -> tuple[list[float], list[str]]:
    """Return the numbers of a row, and its texts."""
    if len(cells) != len(header):
        raise InputError(f"{len(cells)} cells, but the header has {len(header)}")
    values, words = [], []
    for cell, (name, _, is_text) in zip(cells, header, strict=True):
        if is_text:
            words.append(cell)
            if cell != (text := fixed.get(name, cell)):
                raise InputError(f"{name} is {shown(cell, _LONGEST)}, and in the first row {shown(text, _LONGEST)}")
            continue
        values.append(form.number(cell))
        if math.isnan(values[-1]) and not (may_miss and cell.casefold() in ("", "nan", "na", "n/a", "null")):
            raise InputError(f"{shown(cell, _LONGEST)} is not a number such as 0.012 or 1.2e-2{form.hint(cell)}")
    return values, words


def read_header(cells: Sequence[str], known: Collection[str] = (), example: str = _EXAMPLE) -> list[Heading]:
    """Return the headings in the first row; names that are ``known`` may end in brackets.

    Columns without a name, as the index of a data frame or one after a last separator, are dropped.
    """
    if len(cells) > MOST_COLUMNS:
        raise InputError(f"{len(cells):,} columns, at most {MOST_COLUMNS:,} are allowed")
    if 2 * sum(NUMBER.fullmatch(cell) is not None for cell in cells) > sum(map(bool, cells)):
        raise InputError(f"the first row must name the columns and their units, such as {example!r}")
    header = [split_heading(cell, known) for cell in cells]
    for cell, name, _ in header:
        if (cell and not name) or name.count("[") != name.count("]"):
            raise InputError(f"{shown(cell, _LONGEST)} does not name a column such as {example!r}")
    return header


def split_heading(cell: str, known: Collection[str] = ()) -> Heading:
    """Return a cell with the name and the unit in it."""
    before, bracket, within = cell.removesuffix("]").rpartition("[")
    if cell in known or not (cell.endswith("]") and bracket and "]" not in within):
        return cell, cell, ""
    return cell, before.rstrip(), within.strip()
