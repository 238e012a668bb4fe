"""The drawings of ``datums.md``: what the robot does to find a datum, and its errors in base axes and against the datum."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Final

import numpy as np
from docs.drawings.canvas import Canvas
from docs.drawings.results import write_files

import precision_pin as pp

POSE: Final = "work"
DOTS: Final = 90
PER_MM: Final = 27.0
WITHIN_95: Final = 2.4477
"""Half-axes of the ellipse that holds 95 % of a normal law in a plane, in standard deviations."""
HEIGHT: Final = 230
ROBOTS: Final = 4000


def draw_all() -> dict[str, str]:
    """Return the drawings by the names of their files."""
    with tempfile.TemporaryDirectory() as folder:
        write_files("datums.md", Path(folder))
        return {name: _draw(kind, Path(folder) / f"{kind}.errors.yaml") for name, kind in PICTURES.items()}


def _draw(kind: str, sheet: Path) -> str:
    """Return the drawing of a procedure, with both clouds of the same robots as the page's sheet gives them."""
    title, sketch = PROCEDURES[kind]
    view = Canvas(f"{title}; position errors of the same robots in base axes and against the datum", HEIGHT)
    sketch(view)
    base = pp.ErrorModel.load(sheet).against()
    found = base.against(*base.sheet.datums)
    x = found.space.sample(seed=0, first=0, count=ROBOTS)
    errors = [base.at(POSE).exact(x[: base.space.size]), found.at(POSE).exact(x)]
    for (name, colour, middle), error in zip(
        (("in base axes", "red", 318), ("against it", "blue", 478)), errors, strict=True
    ):
        _cloud(view, middle, colour, 1e3 * error[:2])
        length = 1e3 * np.quantile(np.linalg.norm(error[:3], axis=0), 0.95)
        view.text(middle, 26, name, f"{colour} bold", "middle")
        view.text(middle, 222, f"95 % within {length:.1f} mm", "small", "middle")
    view.line(246, 192, 246 + PER_MM, 192, "ink thick")
    view.text(246 + PER_MM / 2, 185, "1 mm", "small", "middle")
    return view.finish()


def _cloud(view: Canvas, middle: float, colour: str, d: np.ndarray) -> None:
    """Draw errors d_x, d_y ``(2, N)``, mm, about a cross, and the ellipse of 95 % of them."""
    y = 122.0
    view.line(middle - 74, y, middle + 74, y, "grey thin dotted")
    view.line(middle, y - 84, middle, y + 84, "grey thin dotted")
    for dx, dy in d[:, :DOTS].T:
        view.dot(middle + PER_MM * dx, y - PER_MM * dy, f"{colour} fill-{colour} soft", 2)
    values, axes = np.linalg.eigh(np.cov(d))
    turns = np.linspace(0, 2 * pi, 41)
    ring = WITHIN_95 * axes @ (np.sqrt(values)[:, None] * np.array([np.cos(turns), np.sin(turns)]))
    view.path([(middle + PER_MM * a, y - PER_MM * b) for a, b in ring.T], colour, closed=True)


def _arm(view: Canvas, tip: tuple[float, float], attitude: float = 90.0, tool: float = 26.0, look: str = "ink") -> None:
    """Draw an arm from its base to a tip, whose tool points in a direction (degrees, clockwise from x)."""
    base, reach = (34.0, 186.0), (94.0, 90.0)
    angle = radians(attitude)
    wrist = (tip[0] - tool * cos(angle), tip[1] - tool * sin(angle))
    dx, dy = wrist[0] - base[0], wrist[1] - (base[1] - 26)
    far = min((dx * dx + dy * dy) ** 0.5, sum(reach) - 1)
    towards = np.arctan2(dy, dx) - np.arccos((far**2 + reach[0] ** 2 - reach[1] ** 2) / (2 * far * reach[0]))
    elbow = (base[0] + reach[0] * np.cos(towards), base[1] - 26 + reach[0] * np.sin(towards))
    view.box(base[0] - 16, base[1], 32, 12)
    view.path([base, (base[0], base[1] - 26), elbow, wrist], f"{look} thick")
    view.line(*wrist, *tip, f"{look}")
    for x, y in ((base[0], base[1] - 26), elbow, wrist):
        view.dot(x, y, f"{look} fill-paper", 5)


def _board(view: Canvas, x: float, y: float, words: str) -> None:
    """Draw a calibration board on edge, its middle at a point."""
    view.box(x - 26, y, 52, 7, "ink fill-grey")
    for k in range(4):
        view.box(x - 26 + 14 * k, y, 7, 7, "ink fill-ink")
    view.text(x, y + 24, words, "small", "middle")


def _best_fit(view: Canvas) -> None:
    _arm(view, (150, 130))
    for x, y in ((96, 168), (150, 130), (184, 160), (190, 96), (130, 82)):
        view.line(206, 40, x, y, "green thin dotted")
        view.dot(x, y, "fill-green", 4)
    view.box(194, 22, 24, 18, "green fill-grey")
    view.text(186, 34, "tracker", "small green", "end")
    view.text(120, 222, "reads the tip at five poses", "small", "middle")


def _taught(view: Canvas) -> None:
    _arm(view, (120, 176))
    view.line(84, 178, 216, 178, "ink")
    view.path([(112, 178), (120, 192), (128, 178)], "green fill-green", closed=True)
    view.text(104, 196, "mark", "small green", "end")
    view.arrow(134, 170, 190, 170, "blue")
    view.dot(198, 172, "fill-ink", 4)
    view.text(198, 160, "work", "small", "middle")
    view.text(120, 222, "taught, then moves relative to it", "small", "middle")


def _three_points(view: Canvas) -> None:
    view.path([(84, 186), (178, 176), (226, 140), (134, 148)], "green fill-green soft", closed=True)
    for (x, y), name, below in (((96, 182), "origin", 18), ((172, 174), "x", 18), ((138, 150), "xy", 18)):
        view.dot(x, y, "fill-green", 4)
        view.text(x, y + below, name, "small green", "middle")
    _arm(view, (172, 174))
    view.text(120, 222, "touches three points of a fixture", "small", "middle")


def _tool_pivot(view: Canvas) -> None:
    tip = (168.0, 160.0)
    for attitude in (50.0, 130.0):
        angle = radians(attitude)
        end = (tip[0] - 58 * cos(angle), tip[1] - 58 * sin(angle))
        view.line(*end, *tip, "grey")
        view.ellipse(*end, 5, 5, "grey fill-paper")
    _arm(view, tip, 90, 58)
    view.path([(160, 192), tip, (176, 192)], "green fill-green", closed=True)
    view.line(130, 192, 206, 192, "ink")
    view.text(120, 222, "the tip stays on a spike", "small", "middle")


def _hand_eye(view: Canvas) -> None:
    _arm(view, (140, 128), 90, 14)
    view.line(140, 116, 152, 116, "ink thick")
    _camera(view, 152, 112)
    for x in (96, 140):
        view.line(161, 126, x, 180, "green thin dotted")
    for x in (190, 214):
        view.line(161, 126, x, 172, "blue thin dotted")
    _board(view, 118, 180, "board")
    view.box(190, 172, 24, 15, "blue fill-blue soft")
    view.text(202, 204, "part", "small blue", "middle")
    view.text(120, 222, "camera in the hand", "small", "middle")


def _eye_to_hand(view: Canvas) -> None:
    _arm(view, (128, 140), 90, 14)
    _board(view, 128, 140, "board")
    _camera(view, 196, 24)
    for x, y in ((104, 140), (152, 140)):
        view.line(205, 40, x, y, "green thin dotted")
    for x in (190, 214):
        view.line(205, 40, x, 172, "blue thin dotted")
    view.box(190, 172, 24, 15, "blue fill-blue soft")
    view.text(202, 204, "part", "small blue", "middle")
    view.text(120, 222, "fixed camera, board in the hand", "small", "middle")


def _camera(view: Canvas, x: float, y: float) -> None:
    """Draw a camera that looks down, its upper left corner at a point."""
    view.box(x, y, 18, 10, "ink fill-grey")
    view.path([(x + 5, y + 10), (x + 2, y + 16), (x + 16, y + 16), (x + 13, y + 10)], "ink fill-grey", closed=True)


PROCEDURES: Final[dict[str, tuple[str, Callable[[Canvas], None]]]] = {
    "best_fit": ("A tracker reads the tip at five poses", _best_fit),
    "taught": ("The tip is jogged to a mark and moves relative to it", _taught),
    "three_points": ("The tip touches three points of a fixture", _three_points),
    "tool_pivot": ("The tip stays on a spike in several attitudes", _tool_pivot),
    "hand_eye": ("A camera in the hand sees a board, then the part", _hand_eye),
    "eye_to_hand": ("A fixed camera sees a board in the hand, and the part", _eye_to_hand),
}
"""Title and sketch of each procedure."""

PICTURES: Final = {f"datum-{kind}.svg": kind for kind in PROCEDURES}
"""The procedure by the name of the file."""
