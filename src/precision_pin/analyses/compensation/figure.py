"""A compensation as a picture: the error over the poses, before and after."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from precision_pin.analyses.compensation.compensate import CompensationResult
from precision_pin.base.text_escape import visible
from precision_pin.render import figure_style
from precision_pin.render.display_units import WrittenUnit
from precision_pin.render.draw_distribution import BLUE, VERMILION
from precision_pin.render.tables import symbol

_MOST_NAMED: Final = 12
_MOST_LETTERS: Final = 18
_MOST_LEVEL: Final = 40


def figure(result: CompensationResult) -> Figure:
    """Return the figure, 174 mm wide: position beside attitude."""
    with figure_style.style():
        made = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        panels = made.subplots(1, 2)
        for norm, axes in enumerate(panels):
            _draw(axes, result, norm)
        goal = "position" if result.mode == "position" else "position and attitude"
        title = f"{goal} corrected: {visible(result.provenance.robot, 60)} at {len(result.poses):,} poses"
        caption = "mean: error with every component at its mean; 95 %: quantile of a normal law, first order"
        figure_style.frame(made, panels, title, caption, 75.0)
    return made


def _draw(axes: Axes, result: CompensationResult, norm: int) -> None:
    part = slice(3 * norm, 3 * norm + 3)
    quantity = ("position.norm", "attitude.norm")[norm]
    made = result.correction
    before = np.linalg.norm(made.before[part], axis=0)
    after = np.linalg.norm(made.after[part], axis=0)
    unit = WrittenUnit.of_axis(quantity, float(np.nanmax(result.within_before[norm])))
    times = result.poses.times
    places = np.arange(1.0, len(result.poses) + 1) if times is None else times
    marker = "o" if len(places) <= _MOST_NAMED else ""
    curves = (
        (before, VERMILION, "-", "mean before"),
        (result.within_before[norm], VERMILION, "--", "95 % of robots before"),
        (after, BLUE, "-", "mean after"),
        (result.within_after[norm], BLUE, "--", "95 % of robots after"),
    )
    for values, colour, dashes, label in curves:
        axes.plot(
            places, values * unit.per_si, color=colour, linestyle=dashes, marker=marker, markersize=3, label=label
        )
    axes.set_ylim(bottom=0)
    axes.set_ylabel(f"{symbol(quantity)} [{unit.name}]")
    if times is not None:
        axes.set_xlabel("time [s]")
    elif len(places) <= _MOST_NAMED:
        labels = [figure_style.shortened(visible(label), _MOST_LETTERS) for label in result.poses.labels]
        turned = sum(map(len, labels)) > _MOST_LEVEL
        axes.set_xticks(places, labels, rotation=45 if turned else 0, ha="right" if turned else "center")
        axes.set_xlim(0.5, len(places) + 0.5)
    else:
        axes.set_xlabel("pose, in the order given")
        axes.xaxis.set_major_locator(MaxNLocator(nbins=8, integer=True))
