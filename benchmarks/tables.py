"""Tables of results, for the terminal and for the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

__all__ = ["Table", "figure"]


@final
@dataclass(frozen=True)
class Table:
    """A table.

    Attributes
    ----------
    title
        What it shows.
    columns
        The heads; the first column holds names, the others figures.
    rows
        The cells.
    notes
        Sentences below it.
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    notes: tuple[str, ...] = ()

    def as_text(self) -> str:
        """Return the table with aligned columns."""
        lines = [self.columns, *self.rows]
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.columns))]
        text = [
            "  ".join(cell.rjust(width) if k else cell.ljust(width) for k, (cell, width) in enumerate(zip(line, widths, strict=True))).rstrip()
            for line in lines
        ]
        text.insert(1, "  ".join("-" * width for width in widths))
        return "\n".join([self.title, "", *text, *(f"  {note}" for note in self.notes)])

    def as_markdown(self) -> str:
        """Return the table as Markdown, below a heading."""
        rule = ["---", *["---:"] * (len(self.columns) - 1)]
        lines = [f"| {' | '.join(cells)} |" for cells in (self.columns, rule, *self.rows)]
        return "\n".join([f"### {self.title}", "", *lines, *(f"\n{note}" for note in self.notes)])


def figure(value: float) -> str:
    """Return a number with three digits, no exponent and commas: 4,690, 46.9, 0.0469."""
    if value == 0:
        return "0"
    digits = 3
    whole = len(str(int(abs(value)))) if abs(value) >= 1 else 0
    if whole >= digits:
        return f"{round(value, digits - whole):,.0f}"
    rounded = f"{value:.{digits}g}"
    return f"{float(rounded):.{digits - whole}f}" if whole else rounded
