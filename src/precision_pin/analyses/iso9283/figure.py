"""The ISO 9283 forecast in pictures and report: laws of AP and RP at every pose, with measured figures."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.analyses.iso9283.result import Iso9283Result
from precision_pin.analyses.iso9283.table import angle_rows, answers, distance_rows, position_rows, setting_lines
from precision_pin.base.errors import visible
from precision_pin.base.written_units import WrittenUnit
from precision_pin.render.draw_distribution import BLACK, BLUE, PURPLE, SKY, VERMILION
from precision_pin.render.figure_style import DOUBLE_COLUMN, frame, inline_figure, new_figure, shortened, style
from precision_pin.render.html import items, paragraph, section, table
from precision_pin.render.scene import Chapter

# bins of the density
_BINS: Final = 30
# half the width of a law on the pose axis
_HALF_WIDTH: Final = 0.4
# maximum number of letters of a pose's name
_MOST_LETTERS: Final = 14


def figure(result: Iso9283Result) -> Figure:
    """Return the figure, 174 mm wide: a panel for AP and one for RP."""
    with style():
        drawing = new_figure(DOUBLE_COLUMN)
        panels = drawing.subplots(1, 2)
        for axes, name in zip(panels, ("AP", "RP"), strict=True):
            _draw(axes, result, name)
        of = result.provenance
        caption = (
            f"{result.robots:,} robots, each tested once with {result.cycles} cycles, seed {of.seed}; width: density over "
            "robots and tests"
        )
        title = f"ISO 9283 of {visible(of.robot, 60)}: {visible(of.base, 30)} to {visible(of.tip, 30)}"
        frame(drawing, panels, title, caption, 80.0)
    return drawing


def _draw(axes: Axes, result: Iso9283Result, name: str) -> None:
    laws, measured = [getattr(at, name) for at in result.poses.values()], result.measured
    values = [] if measured is None else [entry.value for entry in measured.figures if entry.name == name]
    unit = WrittenUnit.of_axis("position.norm", max([float(law.sorted[-1]) for law in laws] + values))
    for place, (pose, law) in enumerate(zip(result.poses, laws, strict=True), start=1):
        _draw_law(axes, place, law.values * unit.per_si)
        for level, colour, dashes, label in ((0.5, BLUE, "-", "median"), (0.95, PURPLE, "--", "95 % of robots")):
            quantile = law.resolved_quantile(level)
            if quantile is not None:
                span = [place - _HALF_WIDTH, place + _HALF_WIDTH]
                axes.plot(span, [quantile * unit.per_si] * 2, color=colour, linestyle=dashes, label=label)
        if name == "RP":
            limit = result.poses[pose].RP_limit.mean * unit.per_si
            axes.plot(place, limit, color=BLACK, marker="_", markersize=9, linestyle="", label="RP of endless cycles")
        reading = None if measured is None else measured.figure(pose, name)
        if reading is not None:
            value = reading.value * unit.per_si
            axes.plot(place, value, color=VERMILION, marker="D", markersize=4, linestyle="", label="measured")
    if name == "RP" and all(float(law.sorted[-1]) == 0 for law in laws):
        axes.text(0.5, 0.5, "0: every cycle is as the first", ha="center", transform=axes.transAxes)
    # poses of the cube have no names but P1 to P5
    names = [("" if at.label.name == pose else at.label.name) for pose, at in result.poses.items()]
    labels = [
        f"{pose}\n{shortened(visible(name), _MOST_LETTERS)}" for pose, name in zip(result.poses, names, strict=True)
    ]
    axes.set_xticks(np.arange(1, len(laws) + 1), [label.rstrip() for label in labels])
    axes.set_xlim(0.4, len(laws) + 0.6)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(f"{name} [{unit.name}]")


def _draw_law(axes: Axes, place: int, values: np.ndarray) -> None:
    """Draw the density of values across a vertical line; a constant has none."""
    if values.max() - values.min() <= 1e-9 * abs(values.max()):
        return
    density, edges = np.histogram(values, bins=_BINS, density=True)
    widths = np.repeat(_HALF_WIDTH * density / density.max(), 2)
    axes.fill_betweenx(np.repeat(edges, 2)[1:-1], place - widths, place + widths, color=SKY, alpha=0.55, linewidth=0)


def iso9283_chapter(result: Iso9283Result) -> Chapter:
    """Return the forecast as a chapter."""
    sentences = answers(result)
    tables = [
        table(caption, rows[0], rows[1:])
        for caption, rows in (
            ("Accuracy and repeatability of the position", position_rows(result)),
            ("Accuracy and repeatability of the orientation", angle_rows(result)),
            ("Distances, directions, exchange of robots", distance_rows(result)),
        )
        if len(rows) > 1
    ]
    picture = inline_figure(
        figure(result),
        "iso9283",
        f"AP and RP at the poses: {sentences[0]}",
        "Laws of AP and RP over built robots and over tests.",
    )
    absent = [f"{name}: none, {why}" for name, why in result.absent.items()]
    notes = [paragraph(line, class_="note") for line in (*setting_lines(result), *absent)]
    content = section("iso9283", "ISO 9283", items(sentences), picture, *tables, *notes)
    return Chapter("iso9283", "ISO 9283", content, tuple(f"By ISO 9283: {line}" for line in sentences))
