"""Text and tables for HTML; names from a URDF or a sheet never become markup."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

from precision_pin.base.text_escape import shortened

MOST_ROWS: Final = 20
"""Rows shown of a table; a line below says how many more there are."""

_COLUMNS: Final = 100
"""Of a sentence in text whose lines are kept."""
_LEFT: Final = ' style="text-align: left"'
_RIGHT: Final = ' style="text-align: right; white-space: nowrap"'


def escaped(text: str) -> str:
    """Return text escaped for HTML elements and quoted attributes; characters that cannot be shown or encoded are replaced."""
    visible = (one if one.isprintable() else " " if one.isspace() else "\N{REPLACEMENT CHARACTER}" for one in text)
    return html.escape("".join(visible), quote=True)


def preformatted(text: str) -> str:
    """Return lines of text as HTML that keeps them; long sentences go on below, rows of tables do not."""
    lines = (
        part
        for line in text.splitlines()
        for part in ([line] if len(line) <= _COLUMNS or "  " in line.strip() else textwrap.wrap(line, _COLUMNS))
    )
    return "<pre>{}</pre>".format("\n".join(map(escaped, lines)))


@final
@dataclass(frozen=True)
class Table:
    """A table of plain text, which becomes HTML in :func:`rendered` only.

    Attributes:
        columns: Column headings.
        rows: One text for each column.
        heading: A line above the table, none if empty.
        words: How many columns, from the left, hold words; they are aligned left, the numbers after them right.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    heading: str = ""
    words: int = 1


def rendered(title: str, tables: Sequence[Table], notes: Sequence[str] = ()) -> str:
    """Return HTML for a notebook: a title, tables cut after 20 rows, and a line for each note.

    There are no colours in it, so that it is read on light and dark pages alike, and no script.

    Args:
        title, tables, notes: Plain text; every name in them is escaped here.
    """
    parts = [f"<p><strong>{escaped(title)}</strong></p>"]
    for table in tables:
        parts += [f"<p>{escaped(table.heading)}</p>"] if table.heading else []
        parts.append('<div style="overflow-x: auto"><table>')
        parts.append(f"<thead>{_row(table.columns, table.words, 'th')}</thead>")
        parts.append("<tbody>")
        parts += [_row([shortened(cell) for cell in row], table.words, "td") for row in table.rows[:MOST_ROWS]]
        parts.append("</tbody></table></div>")
        if len(table.rows) > MOST_ROWS:
            parts.append(f"<p>… and {len(table.rows) - MOST_ROWS:,} more</p>")
    parts += [f"<p><small>{escaped(note)}</small></p>" for note in notes]
    return "<div>\n" + "\n".join(parts) + "\n</div>"


def _row(cells: Sequence[str], words: int, tag: str) -> str:
    styles = (_LEFT if column < words else _RIGHT for column in range(len(cells)))
    inside = (f"<{tag}{style}>{escaped(cell)}</{tag}>" for style, cell in zip(styles, cells, strict=True))
    return f"<tr>{''.join(inside)}</tr>"
