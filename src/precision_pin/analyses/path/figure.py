"""The error along a path as a picture: the quantile at each pose, and the band that holds whole error curves."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from precision_pin.analyses.path.path_result import PathResult
from precision_pin.base.text_escape import visible
from precision_pin.render.display_units import WrittenUnit
from precision_pin.render.draw_distribution import BLACK, BLUE, LIMIT_COLOURS, PURPLE, SKY
from precision_pin.render.figure_style import DOUBLE_COLUMN, frame, new_figure, shortened, style
from precision_pin.render.tables import symbol

_MOST_NAMED: Final = 12
_MOST_LETTERS: Final = 16
_MOST_LEVEL: Final = 36
_LIMIT_DASHES: Final = (0, (6, 1.5, 1.2, 1.5))


def figure(result: PathResult) -> Figure:
    """Return the figure, 174 mm wide: position beside attitude."""
    with style():
        made = new_figure(DOUBLE_COLUMN)
        panels = made.subplots(1, 2)
        for norm, axes in enumerate(panels):
            _draw(axes, result, norm)
        share = f"{100 * result.probability:.6g} %"
        title = f"error of {visible(result.provenance.robot, 60)} along a path of {len(result.poses):,} poses"
        below = " and ".join(f"{100 * result.pointwise(norm).coverage:.1f} %" for norm in (0, 1))
        caption = (
            f"N = {result.samples:,}, seed {result.provenance.seed}; the band of the whole path holds at least {share} of "
            f"robots, {100 * result.confidence:.4g} % sure; the {share} at each pose hold {below} of them at every pose"
        )
        frame(made, panels, title, caption, 75.0, 3)
    return made


def _draw(axes: Axes, result: PathResult, norm: int) -> None:
    quantity = ("position.norm", "attitude.norm")[norm]
    share = f"{100 * result.probability:.6g} %"
    unit = WrittenUnit.of_axis(quantity, float(result.band[norm].max()))
    times = result.poses.times
    places = np.arange(1.0, len(result.poses) + 1) if times is None else times
    band, curve = result.band[norm] * unit.per_si, result.curve[norm] * unit.per_si
    low, high = result.curve_interval[:, norm] * unit.per_si
    axes.fill_between(places, 0.0, band, color=SKY, alpha=0.2, linewidth=0)
    axes.plot(places, band, color=PURPLE, linestyle="--", label=f"{share} of robots along the whole path")
    axes.fill_between(places, low, high, color=BLUE, alpha=0.35, linewidth=0)
    marker = "o" if len(places) <= _MOST_NAMED else ""
    axes.plot(places, curve, color=BLUE, marker=marker, markersize=2.5, label=f"{share} of robots at each pose")
    for specified in result.specification_results:
        if specified.quantity == quantity:
            axes.axhline(
                specified.limit * unit.per_si,
                color=LIMIT_COLOURS.get(specified.verdict, BLACK),
                linestyle=_LIMIT_DASHES,
                linewidth=1.2,
                label=f"limit {unit.short(specified.limit)} for {100 * specified.required:.6g} %",
            )
    axes.set_ylim(bottom=0)
    axes.set_ylabel(f"{symbol(quantity)} [{unit.name}]")
    if times is not None:
        axes.set_xlabel("time [s]")
    elif len(places) <= _MOST_NAMED:
        labels = [shortened(visible(label), _MOST_LETTERS) for label in result.poses.labels]
        turned = sum(map(len, labels)) > _MOST_LEVEL
        axes.set_xticks(places, labels, rotation=45 if turned else 0, ha="right" if turned else "center")
    else:
        axes.set_xlabel("pose, in the order given")
        axes.xaxis.set_major_locator(MaxNLocator(nbins=8, integer=True))
    # room for the markers of single poses
    room = 0.03 * float(np.ptp(places)) if marker else 0.0
    axes.set_xlim(float(places.min()) - room, (float(places.max()) + room) if np.ptp(places) > 0 else None)
