"""Columns of the tables of results, declared once for terminal, notebook, report and data frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any, Final

from precision_pin.render import html
from precision_pin.render.tables import interval_columns, quantity_label, shown, symbol, unit
from precision_pin.render.text_table import aligned


@dataclass(frozen=True)
class Column:
    """A column of a table, whose rows are objects of one class.

    Attributes:
        value: Function of a row, or the name of its attribute, such as ``seen.max``; ``None`` where there is no value.
        cell: Function of a value: its text.
        text, notebook, report: Heading in the terminal, the notebook and the report; ``None`` if it does not stand there.
        frame: Name in data frames; empty if it does not stand there.
        is_words: Whether it is aligned left, as the first column always is.
        has_interval: Whether data frames have the ends too; the value is then ``(value, interval)``.
    """

    value: Callable[[Any], Any] | str
    cell: Callable[[Any], Any] = str
    text: str | None = None
    notebook: str | None = None
    report: str | None = None
    frame: str = ""
    is_words: bool = False
    has_interval: bool = False

    def of(self, row: Any) -> Any:
        """Return the value of a row."""
        if callable(self.value):
            return self.value(row)
        for name in self.value.split("."):
            row = None if row is None else getattr(row, name)
        return row


QUANTITY: Final = (
    Column("quantity", symbol, text="", notebook=""),
    Column("quantity", unit, text="", notebook="unit", is_words=True),
    Column("quantity", quantity_label, report=""),
)
"""First columns of a table whose rows have a ``quantity``."""


def cells(columns: Iterable[Column], output: str, rows: Iterable[Any]) -> list[list[Any]]:
    """Return the headings of an output (``text``, ``notebook``, ``report``), then the cells of each row; ``-`` for None."""
    selected = [column for column in columns if getattr(column, output) is not None]
    values = ([(column, column.of(row)) for column in selected] for row in rows)
    body = [["-" if value is None else column.cell(value) for column, value in row] for row in values]
    return [[getattr(column, output) for column in selected], *body]


def text_lines(columns: Iterable[Column], rows: Iterable[Any]) -> list[str]:
    """Return a table of the terminal as lines."""
    return aligned(cells(columns, "text", rows))


def notebook_table(columns: Iterable[Column], rows: Iterable[Any], heading: str = "") -> html.Table:
    """Return a table of the notebook view."""
    later = [column for column in columns if column.notebook is not None][1:]
    head, *body = cells(columns, "notebook", rows)
    return html.Table(head, body, heading, 1 + len(list(takewhile(lambda column: column.is_words, later))))


def report_table(caption: str, columns: Sequence[Column], rows: Iterable[Any]) -> html.Html:
    """Return a table of the report."""
    selected = [column for column in columns if column.report is not None]
    words = [k for k, column in enumerate(selected) if column.is_words]
    head, *body = cells(columns, "report", rows)
    return html.table(caption, head, [[shown(cell) for cell in row] for row in body], words=words)


def frame_row(columns: Iterable[Column], row: Any) -> dict[str, Any]:
    """Return a row of a data frame, NaN for None."""
    values: dict[str, Any] = {}
    for column in (column for column in columns if column.frame):
        value = column.of(row)
        if column.has_interval:
            values |= interval_columns(column.frame, *(value or (None, None)))
        else:
            values[column.frame] = math.nan if value is None else value
    return values
