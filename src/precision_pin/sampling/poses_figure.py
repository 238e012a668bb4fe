"""The sampled pose error over the poses as a picture."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.base.errors import UnknownNameError
from precision_pin.base.text_escape import visible
from precision_pin.render.display_units import WrittenUnit
from precision_pin.render.draw_distribution import BLACK, BLUE, LIMIT_COLOURS, PURPLE, SKY, VERMILION
from precision_pin.render.figure_style import (
    DOUBLE_COLUMN,
    LINE_HEIGHT,
    labelled,
    legend_below,
    new_figure,
    set_height,
    shortened,
    style,
    wrapped,
)
from precision_pin.render.tables import pose_labels, symbol
from precision_pin.sampling.poses_result import LEVELS, PosesResult

_MOST_NAMED: Final = 24
"""Most poses named below the axis; more are numbered."""
_MOST_LETTERS: Final = 18
_MOST_LEVEL: Final = 80
"""Most letters of all names together without turning them."""
_LIMIT_DASHES: Final = (0, (6, 1.5, 1.2, 1.5))
_STYLES: Final = ((SKY, ":"), (BLUE, "-"), (PURPLE, "--"))
"""Colour and dashes of each quantile."""


def plot(result: PosesResult, quantity: str, axes: Axes | None) -> Axes | Figure:
    """Return what :meth:`precision_pin.sampling.poses_result.PosesResult.plot` does.

    Raises
    ------
    UnknownNameError
        No such quantity.
    """
    names = ("position", "attitude")
    if quantity not in names:
        raise UnknownNameError("quantity", quantity, names)
    if axes is None:
        return figure(result, quantity)
    with style():
        _draw(axes, result, quantity)
        axes.set_title(_title(result, quantity))
    return axes


def figure(result: PosesResult, quantity: str) -> Figure:
    """Return the figure of ``"position"`` or ``"attitude"``, 174 mm wide."""
    with style():
        made = new_figure(DOUBLE_COLUMN)
        axes = made.subplots()
        _draw(axes, result, quantity)
        caption = (
            f"N = {result.samples:,} at each pose, seed {result.seed}; bars: {100 * result.confidence:g} % intervals"
        )
        entries, below = labelled([axes]), wrapped(caption, made)
        made.suptitle("\n".join(wrapped(_title(result, quantity), made)))
        legend_below(made, entries, 3, below)
        set_height(made, 80.0 + (len(below) + 1 + len(entries) / 3) * LINE_HEIGHT)
    return made


def _title(result: PosesResult, quantity: str) -> str:
    return f"{symbol(f'{quantity}.norm')} of {visible(result.robot, 60)} at {result.poses:,} poses"


def _draw(axes: Axes, result: PosesResult, quantity: str) -> None:
    norm = ("position", "attitude").index(quantity)
    quantiles, ends = result.quantile[:, norm], result.quantile_interval[:, norm]
    unit = WrittenUnit.of_axis(f"{quantity}.norm", float(result.norm_max[norm].max()))
    places = np.arange(1, result.poses + 1)
    for rank, (level, (colour, dashes)) in enumerate(zip(LEVELS, _STYLES, strict=True)):
        value = quantiles[rank] * unit.per_si
        # a sketch's bin may reach no farther than its quantile: never a negative bar
        bars = np.maximum(np.abs(ends[rank] * unit.per_si - value), 0.0)
        label = "median" if level == LEVELS[0] else f"{100 * level:g} % of robots"
        axes.errorbar(
            places, value, yerr=bars, color=colour, linestyle=dashes, marker="o", markersize=2.5,
            elinewidth=0.6, capsize=1.2, label=label,
        )  # fmt: skip
    for specification in result.specification_results:
        specified = specification.results[0]
        if specified.quantity == f"{quantity}.norm":
            axes.axhline(
                specified.limit * unit.per_si,
                color=LIMIT_COLOURS.get(specification.verdict, BLACK),
                linestyle=_LIMIT_DASHES,
                linewidth=1.2,
                label=f"limit {unit.short(specified.limit)} for {100 * specified.required:.6g} %",
            )
    judged = [of for of in result.specification_results if of.results[0].quantity.startswith(quantity)]
    missed = [pose + 1 for pose in range(result.poses) if any(of.results[pose].verdict == "not met" for of in judged)]
    for place in missed:
        axes.axvspan(place - 0.5, place + 0.5, color=VERMILION, alpha=0.15, linewidth=0)
    if missed:
        axes.fill_between([], [], [], color=VERMILION, alpha=0.15, linewidth=0, label="specification not met")
    axes.set_xlim(0.5, result.poses + 0.5)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(f"{symbol(f'{quantity}.norm')} [{unit.name}]")
    if result.poses <= _MOST_NAMED:
        labels = [shortened(visible(label), _MOST_LETTERS) for label in pose_labels(result.names)]
        turned = sum(map(len, labels)) > _MOST_LEVEL
        axes.set_xticks(places, labels, rotation=45 if turned else 0, ha="right" if turned else "center")
    else:
        axes.set_xlabel("pose, in the order given")
