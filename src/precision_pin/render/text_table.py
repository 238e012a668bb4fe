"""Plain-text tables for a terminal."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import groupby, pairwise

from precision_pin.base.errors import visible

_is_whole: ContextVar[bool] = ContextVar("is_whole", default=False)


@contextmanager
def whole_tables(is_whole: bool) -> Iterator[None]:
    """Let tables have all their rows, as ``--all`` asks for."""
    token = _is_whole.set(is_whole)
    try:
        yield
    finally:
        _is_whole.reset(token)


def limited(most: int) -> int | None:
    """Return the maximum number of rows of a table; ``None`` for all within :func:`whole_tables`."""
    return None if _is_whole.get() else most


def remainder(count: int, what: str = "") -> list[str]:
    """Return a line about rows that a table omits; none if it has all."""
    return [f"and {count:,} more{f' {what}' if what else ''}: --all"] if count > 0 else []


def aligned(rows: list[list[str]], words: int = 2) -> list[str]:
    """Return rows of cells as lines, the first ``words`` columns left-aligned, their names shortened and escaped."""
    rows = [[visible(cell, 120) for cell in row] for row in rows]
    widths = [max(map(width, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        blanks = [" " * (columns - width(cell)) for cell, columns in zip(row, widths, strict=True)]
        filled = enumerate(zip(row, blanks, strict=True))
        cells = [cell + blank if k < words else blank + cell for k, (cell, blank) in filled]
        lines.append("  ".join(cells).rstrip())
    return lines


def width(text: str) -> int:
    """Return the terminal columns of a text; wide East Asian letters fill two, accents and inner vowels none."""
    return sum(map(_width, text))


def _width(character: str) -> int:
    if unicodedata.category(character) in ("Mn", "Me") or "\u1160" <= character <= "\u11ff":
        return 0  # set above, below or, of a Korean syllable, inside the letter before
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1


def folded(rows: list[str], columns: int) -> list[str]:
    """Return the lines of a table, fitted if possible into a number of terminal columns.

    Long names of the first column wrap; if that is not enough, the table is split into several below each other, each
    with the names. Lines that are not rows of the table stay unchanged. In rows, as from :func:`aligned`, two or more
    spaces separate columns.
    """
    if max(map(width, rows)) <= columns:
        return rows
    cells = [_cells(row) for row in rows]
    spans = _spans([line for row, line in zip(rows, cells, strict=True) if len(re.findall(r"\S {2,}\S", row)) > 1])
    if len(spans) < 3:
        return rows
    lines: list[str] = []
    for is_row, group in groupby(cells, lambda line: _keeps_columns(line, spans)):
        block = list(group)
        lines += (
            _fit([["".join(line[i:j]) for i, j in spans] for line in block], columns) if is_row else map("".join, block)
        )
    return lines


def _cells(line: str) -> list[str]:
    """Return the character in each terminal column; the second column of a wide letter is empty."""
    cells: list[str] = []
    for character in line:
        columns = _width(character)
        if columns == 0 and cells:
            cells[-1] += character
        else:
            cells += [character, *[""] * (columns - 1)]
    return cells


def _spans(rows: list[list[str]]) -> list[tuple[int, int]]:
    """Return begin and end of each column of rows: two or more spaces separate them in every row."""
    size = max(map(len, rows), default=0)
    filled = [any(k < len(row) and row[k] != " " for row in rows) for k in range(size)]
    filled[:1] = [True]  # an indent belongs to the names
    spans: list[tuple[int, int]] = []
    for k in range(size):
        if filled[k]:
            is_new = not spans or k - spans[-1][1] >= 2
            spans[-1:] = [*spans[-1:], (k, k + 1)] if is_new else [(spans[-1][0], k + 1)]
    return spans


def _keeps_columns(row: list[str], spans: list[tuple[int, int]]) -> bool:
    """Return whether a line is not empty and has spaces between the columns."""
    between = [k for (_, end), (start, _) in pairwise(spans) for k in range(end, start)]
    return len(row) <= spans[-1][1] and all(k >= len(row) or row[k] == " " for k in between)


def _fit(table: list[list[str]], columns: int) -> list[str]:
    """Return the rows of a table, cells padded to their column's width, as lines that fit."""
    sizes = [max(width(row[k]) for row in table) for k in range(len(table[0]))]
    other_width = sum(size + 2 for size in sizes[1:])
    parts = [_name_lines(row[0].rstrip(), columns - other_width) for row in table]
    names = max(width(line) for lines in parts for line in lines)
    # names are folded to no less than 24 columns, and to two lines
    if 24 <= columns - other_width >= names and max(map(len, parts)) <= 2:
        return [
            "  ".join([name + " " * (names - width(name)), *(row[1:] if k == 0 else [])]).rstrip()
            for row, lines in zip(table, parts, strict=True)
            for k, name in enumerate(lines)
        ]
    # columns without a heading, such as units, belong to the names
    named = next((k for k in range(1, len(sizes)) if table[0][k].strip()), 1)
    groups: list[list[int]] = []
    for k in range(named, len(sizes)):
        is_of_last = groups and table[0][k].strip() == "interval"
        groups[-1:] = [[*groups[-1], k]] if is_of_last else [*groups[-1:], [k]]
    blocks: list[list[int]] = [[]]
    taken = sum(size + 2 for size in sizes[:named])
    for group in groups:
        if blocks[-1] and taken + sum(sizes[j] + 2 for j in (*blocks[-1], *group)) - 2 > columns:
            blocks.append([])
        blocks[-1] += group
    lines: list[str] = []
    for block in blocks:
        indices = [*range(named), *block]
        lines += [""] * bool(lines)
        lines += ["  ".join(row[k] + " " * (sizes[k] - width(row[k])) for k in indices).rstrip() for row in table]
    return lines


def _name_lines(name: str, columns: int) -> list[str]:
    """Return a name wrapped to so many columns: before a bracket, a point or a word, or else at any mark."""
    lines: list[str] = []
    for marks in (r"[.\[\s]", r"[.\[\s_-]"):
        lines, line = [], ""
        for part in re.split(rf"(?<=[\w\])])(?={marks})", name):
            if line and width(line + part) > columns:
                lines.append(line.rstrip())
                line, part = "  ", part.lstrip()
            line += part
        lines.append(line)
        if max(map(width, lines)) <= columns:
            break
    return lines
