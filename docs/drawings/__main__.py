"""Write every drawing."""

from __future__ import annotations

from docs.drawings import budgets, datums, measured_arms, sources
from docs.drawings.canvas import IMAGES

if __name__ == "__main__":
    for name, text in (sources.draw_all() | measured_arms.draw_all() | budgets.draw_all() | datums.draw_all()).items():
        (IMAGES / name).write_text(text, encoding="utf-8")
