"""The budgets of the pages as bars: the share of each draw in the variance of the position error, in closed form."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

from docs.drawings.canvas import Canvas
from docs.drawings.results import write_files

import precision_pin as pp

BUDGETS: Final = {
    "your-arm-budget.svg": ("your-arm.md", "mine.errors.yaml", "reach"),
    "case-budget.svg": ("case.md", "place.errors.yaml", "place"),
}
"""The page that holds the sheet, the sheet and the pose, by the name of the file."""

BARS: Final = 7
LEFT: Final = 24.0
LONGEST: Final = 440.0


def draw_all() -> dict[str, str]:
    """Return the drawings by the names of their files."""
    return {name: draw_budget(*of) for name, of in BUDGETS.items()}


def draw_budget(page: str, sheet: str, pose: str) -> str:
    """Return the largest shares of a budget as bars, and the sum of all others."""
    with tempfile.TemporaryDirectory() as folder:
        write_files(page, Path(folder))
        model = pp.ErrorModel.load(Path(folder) / sheet)
        found = pp.budget(model, pose, samples=1024).poses[0]
    shares = [(float(draw.share["position"]), draw.name) for draw in found.draws]
    shares.sort(key=lambda row: (-round(row[0], 4), row[1]))  # what is alike to the last digits, by name
    rest = sum(share for share, _ in shares[BARS:])
    rows = [*shares[:BARS], (rest, f"{len(shares) - BARS} others")]
    view = Canvas(f"Share of each draw in the variance of the position error, pose {pose}", 58 + 42 * len(rows))
    view.text(LEFT, 30, f"share of the variance of d, pose '{pose}'", "bold")
    for place, (share, name) in enumerate(rows):
        y = 60 + 42 * place
        look = "grey fill-grey" if place == BARS else "blue fill-blue"
        length = LONGEST * share / max(share for share, _ in rows)
        view.text(LEFT, y, name, "small")
        view.box(LEFT, y + 7, length, 12, look)
        view.text(LEFT + length + 8, y + 18, f"{100 * share:.1f} %", "small")
    return view.finish()
