"""A small SVG canvas: lines, arrows, dimensions and labels, in colours that follow the reader's light or dark scheme.

A drawing carries its own background, so that it can be read on any page. Coordinates are pixels, y down; numbers are
written with one decimal, so that the same drawing has the same bytes everywhere.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from math import atan2, cos, degrees, hypot, sin
from pathlib import Path
from typing import Final

IMAGES: Final = Path(__file__).parents[1] / "images"

WIDTH: Final = 560
"""Of every drawing: on a narrow phone its letters are still some ten pixels high."""

SUBSCRIPT: Final = re.compile(r"(?<=[A-Z])_(\w)([^_]?)")

_STYLE: Final = (
    "text{font:16px sans-serif;fill:var(--ink)}.small{font-size:14px}.bold{font-weight:bold}"
    ".paper{fill:var(--paper);stroke:none}"
    ".ink{stroke:var(--ink)}.grey{stroke:var(--grey)}.blue{stroke:var(--blue)}.red{stroke:var(--red)}"
    ".green{stroke:var(--green)}.amber{stroke:var(--amber)}"
    "path,line,ellipse,rect{fill:none;stroke-width:1.6}.thick{stroke-width:3}.thin{stroke-width:1}"
    ".dashed{stroke-dasharray:9 4 2 4}.dotted{stroke-dasharray:4 4}"
    ".fill-ink{fill:var(--ink)}.fill-grey{fill:var(--pale)}.fill-blue{fill:var(--blue)}.fill-red{fill:var(--red)}"
    ".fill-green{fill:var(--green)}.fill-amber{fill:var(--amber)}.fill-paper{fill:var(--paper)}"
    ".soft{fill-opacity:.18}"
    "text.blue{fill:var(--blue);stroke:none}text.red{fill:var(--red);stroke:none}text.grey{fill:var(--grey);stroke:none}"
    "text.green{fill:var(--green);stroke:none}text.amber{fill:var(--amber);stroke:none}"
)
_LIGHT: Final = (
    "--ink:#15202b;--paper:#ffffff;--grey:#5f6b76;--pale:#d9dee3;--blue:#0065a3;"
    "--red:#c04a00;--green:#00704f;--amber:#9a6700"
)
_DARK: Final = (
    "--ink:#e6e9ec;--paper:#1b2026;--grey:#a3adb7;--pale:#3c454e;--blue:#6cb8f0;"
    "--red:#ff9a57;--green:#4fcfa3;--amber:#e3b341"
)


class Canvas:
    """A drawing in the making.

    Args:
        title: What the drawing shows, for those who do not see it.
        height: In pixels; the width is always the same.
    """

    def __init__(self, title: str, height: int) -> None:
        self._lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}"'
            ' role="img">',
            f"<title>{escape(title)}</title>",
            f"<style>svg{{{_LIGHT}}}@media(prefers-color-scheme:dark){{svg{{{_DARK}}}}}{_STYLE}</style>",
            f'<rect class="paper" width="{WIDTH}" height="{height}" rx="8"/>',
        ]

    def text(self, x: float, y: float, words: str, look: str = "", anchor: str = "start") -> None:
        """Write words; after capitals, an underscore makes the next letter a subscript."""
        shown = SUBSCRIPT.sub(r'<tspan font-size="12" dy="4">\1</tspan><tspan dy="-4">\2</tspan>', escape(words))
        self._lines.append(f'<text x="{x:.1f}" y="{y:.1f}" class="{look}" text-anchor="{anchor}">{shown}</text>')

    def line(self, x1: float, y1: float, x2: float, y2: float, look: str = "ink") -> None:
        """Draw a straight line."""
        self._lines.append(f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" class="{look}"/>')

    def path(self, points: Sequence[tuple[float, float]], look: str = "ink", *, closed: bool = False) -> None:
        """Draw a line through points."""
        steps = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        self._lines.append(f'<path d="M{steps}{"z" if closed else ""}" class="{look}"/>')

    def ellipse(self, x: float, y: float, rx: float, ry: float, look: str = "ink") -> None:
        """Draw an ellipse."""
        self._lines.append(f'<ellipse cx="{x:.1f}" cy="{y:.1f}" rx="{rx:.1f}" ry="{ry:.1f}" class="{look}"/>')

    def dot(self, x: float, y: float, look: str = "fill-ink", radius: float = 4) -> None:
        """Draw a dot."""
        self.ellipse(x, y, radius, radius, look)

    def box(self, x: float, y: float, width: float, height: float, look: str = "ink fill-grey") -> None:
        """Draw a rectangle."""
        self._lines.append(f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" class="{look}"/>')

    def tip(self, x: float, y: float, towards: float, colour: str) -> None:
        """Draw the tip of an arrow that points in a direction (rad, clockwise from x)."""
        back = [(x - 11 * cos(towards + side), y - 11 * sin(towards + side)) for side in (0.35, -0.35)]
        self.path([(x, y), *back], f"{colour} fill-{colour}", closed=True)

    def arrow(self, x1: float, y1: float, x2: float, y2: float, colour: str = "ink", look: str = "") -> None:
        """Draw an arrow."""
        way, towards = hypot(x2 - x1, y2 - y1), atan2(y2 - y1, x2 - x1)
        self.line(x1, y1, x2 - 8 * (x2 - x1) / way, y2 - 8 * (y2 - y1) / way, f"{colour} {look}".strip())
        self.tip(x2, y2, towards, colour)

    def arc(self, x: float, y: float, radius: float, start: float, end: float, colour: str = "ink") -> None:
        """Draw an arc about a point from one angle to another (rad, clockwise from x), an arrow at its end."""
        count = max(2, round(abs(degrees(end - start)) / 4))
        angles = [start + (end - start) * k / count for k in range(count + 1)]
        self.path([(x + radius * cos(angle), y + radius * sin(angle)) for angle in angles], colour)
        self.tip(x + radius * cos(end), y + radius * sin(end), end + (1.4 if end > start else -1.4), colour)

    def dimension(self, x1: float, y1: float, x2: float, y2: float, words: str, at: tuple[float, float]) -> None:
        """Draw a dimension line with a tip at both ends, and its words left-aligned at a point."""
        towards = atan2(y2 - y1, x2 - x1)
        self.line(x1, y1, x2, y2, "grey thin")
        self.tip(x2, y2, towards, "grey")
        self.tip(x1, y1, towards + 3.14159265, "grey")
        self.text(*at, words, "grey")

    def finish(self) -> str:
        """Return the SVG."""
        return "\n".join([*self._lines, "</svg>\n"])
