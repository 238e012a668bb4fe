"""Tables of plain text for a terminal."""

from __future__ import annotations

import unicodedata

from precision_pin.visible import visible

__all__ = ["aligned", "width"]


def aligned(rows: list[list[str]]) -> list[str]:
    """Return rows of cells as lines, the first two columns to the left; names in them are shortened and escaped."""
    rows = [[visible(cell, 120) for cell in row] for row in rows]
    widths = [max(map(width, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        blanks = [" " * (columns - width(cell)) for cell, columns in zip(row, widths, strict=True)]
        cells = [
            cell + blank if k < 2 else blank + cell for k, (cell, blank) in enumerate(zip(row, blanks, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


def width(text: str) -> int:
    """Return how many columns of a terminal a text fills; letters of East Asia fill two, accents and inner vowels none."""
    return sum(map(_width, text))


def _width(character: str) -> int:
    if unicodedata.category(character) in ("Mn", "Me") or "\u1160" <= character <= "\u11ff":
        return 0  # set above, below or, of a Korean syllable, inside the letter before
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1
