"""HTML of pages and notebooks as values: text is always escaped, so no name of a URDF or sheet acts as markup."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from precision_pin.base.errors import shortened

MOST_ROWS: Final = 20
"""Largest number of rows of a notebook table; a line below counts the others."""

_MOST_UNBROKEN: Final = 14
"""Largest number of rows of a table that is printed on one page: moving it leaves less than half a page empty."""

_COLUMNS: Final = 100
"""Width at which preformatted sentences wrap."""


def escaped(text: str) -> str:
    """Return text escaped for HTML elements and quoted attributes; unprintable characters are replaced."""
    visible = (
        letter if letter.isprintable() else " " if letter.isspace() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )
    return html.escape("".join(visible), quote=True)


def preformatted(text: str) -> str:
    """Return text as HTML that keeps its lines; long sentences wrap, rows of tables do not."""
    lines = (
        part
        for line in text.splitlines()
        for part in ([line] if len(line) <= _COLUMNS or "  " in line.strip() else textwrap.wrap(line, _COLUMNS))
    )
    return "<pre>{}</pre>".format("\n".join(map(escaped, lines)))


@dataclass(frozen=True)
class Table:
    """A table of plain text, rendered by :func:`rendered`.

    Attributes:
        words: Number of left-aligned text columns from the left; numbers after them align right.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    heading: str = ""
    words: int = 1


def rendered(title: str, tables: Sequence[Table], notes: Sequence[str] = ()) -> str:
    """Return HTML for a notebook: a title, tables cut after 20 rows, a line for each note.

    Takes plain text and escapes it. Has no scripts and no colours, so that it suits light and dark pages.
    """
    parts = [f"<p><strong>{escaped(title)}</strong></p>"]
    for table in tables:
        parts += [f"<p>{escaped(table.heading)}</p>"] if table.heading else []
        head = _row(table.columns, table.words, "th")
        parts += ['<div style="overflow-x: auto"><table>', f"<thead>{head}</thead>", "<tbody>"]
        parts += [_row([shortened(cell) for cell in row], table.words, "td") for row in table.rows[:MOST_ROWS]]
        parts.append("</tbody></table></div>")
        if len(table.rows) > MOST_ROWS:
            parts.append(f"<p>… and {len(table.rows) - MOST_ROWS:,} more</p>")
    parts += [f"<p><small>{escaped(note)}</small></p>" for note in notes]
    return "<div>\n" + "\n".join(parts) + "\n</div>"


def _row(cells: Sequence[str], words: int, tag: str) -> str:
    left, right = "text-align: left", "text-align: right; white-space: nowrap"
    inside = (f'<{tag} style="{left if k < words else right}">{escaped(cell)}</{tag}>' for k, cell in enumerate(cells))
    return f"<tr>{''.join(inside)}</tr>"


@dataclass(frozen=True)
class Html:
    """Markup. Make it with :func:`element` from plain text; whoever makes one directly vouches for its text."""

    text: str


Child = Html | str
"""Contents of an element: markup, or text to escape."""


def element(name: str, *children: Child, **attributes: str) -> Html:
    """Return an element, text and attributes escaped; ``class_`` is ``class``, left out if empty."""
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escaped(value)}"'
        for key, value in attributes.items()
        if value or key != "class_"
    )
    end = "" if name == "meta" else f"{joined(children).text}</{name}>"
    return Html(f"<{name}{written}>{end}")


def joined(children: Iterable[Child]) -> Html:
    """Return the concatenation of children."""
    return Html("".join(child.text if isinstance(child, Html) else escaped(child) for child in children))


def paragraph(*children: Child, class_: str = "") -> Html:
    """Return a paragraph."""
    return element("p", *children, class_=class_)


def items(entries: Iterable[Child], class_: str = "") -> Html:
    """Return a bulleted list."""
    return element("ul", *(element("li", entry) for entry in entries), class_=class_)


def definitions(entries: Iterable[tuple[str, Child]]) -> Html:
    """Return a list of terms with their definitions."""
    return element("dl", *(element("div", element("dt", term), element("dd", text)) for term, text in entries))


def section(name: str, heading: str, *children: Child, folded: bool = True) -> Html:
    """Return a section of the page with the anchor ``#name``, folded until it is opened."""
    # the section is inside its fold, because browsers open the folds around a link's target
    title = element("h2", heading, id=f"{name}-heading")
    inside = children if folded else (title, *children)
    body = element("section", *inside, id=name, aria_labelledby=f"{name}-heading")
    return element("details", element("summary", title), body, class_="fold") if folded else body


def beside(*tables: Html) -> Html:
    """Return narrow tables side by side, as many as fit."""
    return element("div", *tables, class_="beside")


def table(
    caption: str,
    header: Sequence[str],
    rows: Iterable[Sequence[Child]],
    *,
    words: Iterable[int] = (),
    last: bool = False,
) -> Html:
    """Return a table that scrolls sideways if too wide; on a phone, each row is a list with the column names.

    Args:
        rows: The first cell of each is its heading.
        words: Text columns besides the first, aligned left.
        last: Whether the last row is a sum.
    """
    left, lines = {0, *words}, list(rows)
    head = [element("th", name, scope="col", class_="" if k in left else "n") for k, name in enumerate(header)]
    body = []
    for row in lines:
        # of headings only very long ones may break anywhere; sentences need some width
        is_long = isinstance(row[0], str) and len(row[0]) > 44
        cells = [element("th", element("span", row[0], class_="long") if is_long else row[0], scope="row")]
        for k, cell in enumerate(row[1:], start=1):
            kind = "sentence" if isinstance(cell, str) and len(cell) > 28 else ""
            cells.append(element("td", cell, class_=kind if k in left else "n", data_label=header[k]))
        body.append(element("tr", *cells, class_="sum" if last and row is lines[-1] else ""))
    whole = element(
        "table", element("caption", caption), element("thead", element("tr", *head)), element("tbody", *body)
    )
    size = "wide short" if len(lines) <= _MOST_UNBROKEN else "wide"
    size += " few" if len(header) <= 3 else ""
    return element("div", whole, class_=size, role="region", tabindex="0", aria_label=caption)
