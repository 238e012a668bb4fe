"""Tables of results, for the terminal and for the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

__all__ = ["Part", "Ratio", "Table", "figure", "times"]


@final
@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        title: What it shows.
        columns: The heads; the first column holds names, the others figures.
        rows: The cells.
        notes: Sentences below it.
        on_page: Whether it stands on the page, or is printed only.
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    notes: tuple[str, ...] = ()
    on_page: bool = True

    def as_text(self) -> str:
        """Return the table with aligned columns."""
        lines = [self.columns, *self.rows]
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.columns))]
        text = [
            "  ".join(
                cell.rjust(width) if k else cell.ljust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in lines
        ]
        text.insert(1, "  ".join("-" * width for width in widths))
        return "\n".join([self.title, "", *text, *(f"  {note}" for note in self.notes)])

    def as_markdown(self) -> str:
        """Return the table as Markdown, below a heading."""
        rule = ["---", *["---:"] * (len(self.columns) - 1)]
        lines = [f"| {' | '.join(cells)} |" for cells in (self.columns, rule, *self.rows)]
        return "\n".join([f"### {self.title}", "", *lines, *(f"\n{note}" for note in self.notes)])


@final
@dataclass(frozen=True)
class Ratio:
    """A figure that holds on any machine, near enough, and what it should be.

    Attributes:
        name: What is divided by what.
        value: The quotient; None: this machine cannot tell.
        aim: At least this, or with ``at_most`` at most; None: nothing is aimed at.
    """

    name: str
    value: float | None
    aim: float | None = None
    at_most: bool = False

    def as_row(self) -> tuple[str, str, str]:
        """Return the name, the value and the aim."""
        value = "not measured" if self.value is None else figure(self.value)
        bound = "" if self.aim is None else f"{'at most' if self.at_most else 'at least'} {self.aim:g}"
        return self.name, value, bound


@final
@dataclass(frozen=True)
class Part:
    """What a part of the run found."""

    tables: tuple[Table, ...]
    ratios: tuple[Ratio, ...] = ()


def times(value: float) -> str:
    """Return a ratio in words."""
    return f"{figure(value)} ×"


def figure(value: float) -> str:
    """Return a number with three digits, no exponent and commas: 4,690, 46.9, 0.0469."""
    if value == 0:
        return "0"
    rounded = float(f"{value:.3g}")
    whole = len(str(int(abs(rounded)))) if abs(rounded) >= 1 else 0
    return f"{rounded:,.{max(3 - whole, 0)}f}" if whole else f"{value:#.3g}"
