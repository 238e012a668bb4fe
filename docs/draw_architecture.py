"""Draw the package's folders, the lowest first, as their imports have it: ``python docs/draw_architecture.py``.

A blue box is a folder, a grey one a file beside them. An arrow goes down to what is imported; arrows that
follow from others are left out.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Final

PACKAGE: Final = Path(__file__).parents[1] / "src" / "precision_pin"
PICTURE: Final = Path(__file__).parent / "images" / "architecture.svg"
APART: Final = ("__init__", "__main__")
"""What gives the package its names and its command: not part of the order."""

WIDTH, HEIGHT, GAP, RISE, MARGIN = 128, 36, 26, 64, 20


def home(path: Path) -> str:
    """Return the folder of a file, or the file itself where it lies beside them."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return parts[0]


def files() -> list[Path]:
    """Return the package's files."""
    return [path for path in sorted(PACKAGE.rglob("*.py")) if "robots" not in path.parts and home(path) not in APART]


def imports() -> dict[str, set[str]]:
    """Return what each folder imports of the others."""
    found: dict[str, set[str]] = {home(path): set() for path in files()}
    for path in files():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == "precision_pin":
                names = [node.module] if "." in node.module else [f"precision_pin.{alias.name}" for alias in node.names]
                found[home(path)] |= ({name.split(".")[1] for name in names} - {home(path)}) & found.keys()
    return found


def floors(graph: Mapping[str, set[str]]) -> dict[str, int]:
    """Return the floor of each folder: right below the lowest that imports it, the ground at 0."""
    above: dict[str, int] = {}

    def depth(name: str) -> int:
        if name not in above:
            above[name] = max((1 + depth(user) for user in graph if name in graph[user]), default=0)
        return above[name]

    lowest = max(depth(name) for name in sorted(graph))
    return {name: lowest - depth for name, depth in above.items()}


def below(graph: Mapping[str, set[str]], name: str) -> set[str]:
    """Return all that a folder imports, directly or through others."""
    return graph[name].union(*(below(graph, other) for other in graph[name]))


def direct(graph: Mapping[str, set[str]]) -> list[tuple[str, str]]:
    """Return the imports that do not follow from others."""
    return [
        (name, other)
        for name in sorted(graph)
        for other in sorted(graph[name])
        if not any(other in below(graph, between) for between in graph[name] - {other})
    ]


def picture() -> str:
    """Return the picture as SVG."""
    graph = imports()
    level = floors(graph)
    rows = [sorted(name for name in graph if level[name] == floor) for floor in range(max(level.values()) + 1)]
    across = max(len(row) for row in rows) * (WIDTH + GAP) - GAP
    down = (len(rows) - 1) * RISE + HEIGHT
    places = {
        name: (
            MARGIN + (across - len(row) * (WIDTH + GAP) + GAP) / 2 + column * (WIDTH + GAP),
            MARGIN + down - HEIGHT - floor * RISE,
        )
        for floor, row in enumerate(rows)
        for column, name in enumerate(row)
    }
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {across + 2 * MARGIN:g} {down + 2 * MARGIN:g}"'
        f' width="{across + 2 * MARGIN:g}" font-family="sans-serif" text-anchor="middle">',
        "<title>What imports what in precision_pin</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#5a6b7b"/></marker></defs>',
        '<rect width="100%" height="100%" fill="#fff"/>',
    ]
    for name, other in direct(graph):
        (x, y), (to_x, to_y) = places[name], places[other]
        start, end = (x + WIDTH / 2, y + HEIGHT), (to_x + WIDTH / 2, to_y - 1)
        # straight down past the floors between, then across in the last gap
        bend = (RISE - HEIGHT - 1) / 2
        knee = end[1] - 2 * bend
        lines.append(
            f'<path d="M{start[0]:g} {start[1]:g}V{knee:g}C{start[0]:g} {knee + bend:g} {end[0]:g} {end[1] - bend:g}'
            f' {end[0]:g} {end[1]:g}" fill="none" stroke="#5a6b7b" stroke-width="1.2" marker-end="url(#tip)"/>'
        )
    for name, (x, y) in places.items():
        is_folder = (PACKAGE / name).is_dir()
        lines += [
            f'<rect x="{x:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="5" fill="{"#dceaf7" if is_folder else "#f1f1ee"}"'
            ' stroke="#34495e"/>',
            f'<text x="{x + WIDTH / 2:g}" y="{y + 23:g}" font-size="14" fill="#15202b">{escape(name)}</text>',
        ]
    return "\n".join([*lines, "</svg>\n"])


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
