"""Figure of a comparison: the fraction of robots within |d| and |δ|, one curve for each model."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.analyses.compare.compare import ComparisonResult, PoseComparison
from precision_pin.base.errors import visible
from precision_pin.base.written_units import WrittenUnit
from precision_pin.render import figure_style
from precision_pin.render.draw_distribution import BLACK, BLUE, PURPLE, SKY, VERMILION
from precision_pin.render.tables import symbol

_STYLES: Final = ((BLUE, "-"), (VERMILION, "--"), (PURPLE, "-."), (SKY, ":"))
_MOST_LETTERS: Final = 40  # of a name in the legend
_POINTS: Final = 400  # of each curve


def figure(result: ComparisonResult) -> Figure:
    """Return the figure, 174 mm wide: position next to attitude, at the first model's worst pose."""
    pose = result.poses[result.worst_pose()]
    with figure_style.style():
        chart = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        panels = chart.subplots(1, 2, sharey=True)
        for axes, vector in zip(panels, ("position", "attitude"), strict=True):
            _draw(axes, result, pose, vector)
        panels[0].set_ylabel("robots within [%]")
        place = f" at {visible(pose.label.name, 40)}" if pose.label.name else ""
        title = f"error of {visible(result.provenance.robot, 60)}{place}: {len(result.names)} sheets, the same robots"
        figure_style.frame(chart, panels, title, f"N = {result.samples:,}, seed {result.provenance.seed}", 75.0, 2)
    return chart


def _draw(axes: Axes, result: ComparisonResult, pose: PoseComparison, vector: str) -> None:
    laws = [getattr(law, vector).norm for law in pose.laws]
    smallest, largest = min(law.min for law in laws), max(law.max for law in laws)
    unit = WrittenUnit.of_axis(f"{vector}.norm", largest)
    places = np.linspace(smallest, largest, _POINTS)
    for rank, (name, law) in enumerate(zip(result.names, laws, strict=True)):
        colour, dashes = _STYLES[rank % len(_STYLES)]
        label = figure_style.shortened(visible(name), _MOST_LETTERS)
        axes.plot(places * unit.per_si, 100 * law.cumulative(places), color=colour, linestyle=dashes, label=label)
    for specification in result.specifications:
        if specification.quantity == f"{vector}.norm":
            axes.axvline(specification.limit * unit.per_si, color=BLACK, linewidth=0.8)
            axes.axhline(100 * specification.required, color=BLACK, linewidth=0.4)
    axes.axhline(95, color=BLACK, linewidth=0.4, linestyle=":")
    axes.set_ylim(0, 100)
    margin = 0.05 * (largest - smallest)
    axes.set_xlim(max(0.0, smallest - margin) * unit.per_si, (largest + margin) * unit.per_si or 1.0)
    axes.set_xlabel(f"{symbol(f'{vector}.norm')} [{unit.name}]")
