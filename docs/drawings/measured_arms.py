"""The forecast for a UR5 beside nine UR5s that were measured: the first picture of the site."""

from __future__ import annotations

from math import sqrt
from typing import Final

import numpy as np
from docs.drawings.canvas import Canvas

import precision_pin as pp
from precision_pin.robot.examples import shipped_sheets

MEASURED: Final = {
    "ready": (0.6, 0.8, 1.2, 1.5, 1.5, 1.8, 2.7, 3.3, 3.4),
    "stretched": (1.7, 2.0, 2.4, 2.4, 3.1, 3.2, 3.8, 4.6, 6.9),
    "folded": (0.4, 0.4, 0.6, 0.7, 0.8, 0.9, 1.6, 2.2, 2.5),
}
"""|d| of nine UR5s in mm, by pose: the tip by each arm's factory calibration less the tip by the nominal parameters.

The nine calibrations are those that ``src/precision_pin/robots/ur5.errors.yaml`` lists.
"""

SAMPLES: Final = 20_000
LEFT: Final = 112.0
PER_MM: Final = 52.0
BIN: Final = 0.2


def draw_all() -> dict[str, str]:
    """Return the drawing by the name of its file."""
    return {"ur5-measured.svg": measured_arms()}


def measured_arms() -> str:
    """Return the drawing: by pose, how the sampled robots are spread, and the nine arms as dots below."""
    model = pp.ErrorModel.load(shipped_sheets()["ur5"])
    height = 104 + 110 * len(MEASURED)
    view = Canvas("Position error of UR5s at three poses: forecast, and nine arms as they were measured", height)
    view.box(20, 16, 26, 14, "blue fill-blue soft")
    view.text(54, 29, f"forecast, {SAMPLES:,} robots")
    view.dot(268, 23, "fill-red", 5)
    view.text(280, 29, "nine measured arms")
    view.line(456, 14, 456, 32, "blue thick")
    view.text(466, 29, "median")
    bottom = height - 46.0
    for mark in range(9):
        x = LEFT + PER_MM * mark
        view.line(x, 44, x, bottom, "grey thin dotted")
        view.text(x, bottom + 18, str(mark), "small grey", "middle")
    view.text(LEFT + 4 * PER_MM, bottom + 38, "position error |d|, mm", "grey", "middle")
    for place, (pose, arms) in enumerate(MEASURED.items()):
        y = 118.0 + 110 * place
        norms = 1e3 * np.linalg.norm(
            model.at(pose).exact(model.space.sample(seed=0, first=0, count=SAMPLES))[:3], axis=0
        )
        shares = np.histogram(norms, np.arange(0.0, 8.0 + BIN, BIN))[0] / SAMPLES
        curve = [(LEFT, y)]
        for k, share in enumerate(shares):
            up = y - 560 * float(share)
            curve += [(LEFT + PER_MM * BIN * k, up), (LEFT + PER_MM * BIN * (k + 1), up)]
        view.path([*curve, (curve[-1][0], y)], "blue fill-blue soft", closed=True)
        median = LEFT + PER_MM * float(np.median(norms))
        view.line(median, y - 62, median, y, "blue thick")
        view.text(LEFT - 12, y - 8, pose, "bold", "end")
        for x, down in _piled([LEFT + PER_MM * arm for arm in arms]):
            view.dot(x, y + 14 + down, "fill-red", 5)
        middle = LEFT + PER_MM * sorted(arms)[len(arms) // 2]
        view.line(middle, y + 3, middle, y + 34, "red thick")
    return view.finish()


def _piled(places: list[float]) -> list[tuple[float, float]]:
    """Return dots side by side, one below the other where they would touch."""
    shown: list[tuple[float, float]] = []
    for x in places:
        down = 0.0
        while any(sqrt((x - other) ** 2 + (down - below) ** 2) < 10.5 for other, below in shown):
            down += 10.5
        shown.append((x, down))
    return shown
