"""Reliability as a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from precision_pin.analyses.reliability.reliability_result import ReliabilityResult, SpecificationReliability
from precision_pin.base.errors import InputError
from precision_pin.render.draw_distribution import BLACK, BLUE, GREEN, PURPLE, SKY, VERMILION
from precision_pin.render.figure_style import (
    DOUBLE_COLUMN,
    LINE_HEIGHT,
    caption,
    new_figure,
    set_height,
    shortened,
    style,
)
from precision_pin.render.tables import absolute, unit

LISTED: Final = 6
_LONGEST_NAME: Final = 38
_PANEL: Final = 34.0


def figure(
    result: ReliabilityResult, which: int = 0, importance: Sequence[Sequence[tuple[str, float]]] | None = None
) -> Figure:
    """Return each specification's probabilities of failure by method, and the importance factors, 174 mm wide."""
    entry, provenance = result.poses[which], result.provenance
    lines = [
        *caption("reliability", provenance, entry.pose),
        f"N = {result.samples:,}, seed {provenance.seed}, exact model, statics {provenance.statics}; "
        f"bars: intervals at {100 * result.confidence:g} % confidence",
    ]
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        rows = len(entry.specifications)
        panels = drawn.subplots(rows, 2, squeeze=False)
        for k, specification in enumerate(entry.specifications):
            _draw_methods(panels[k, 0], specification)
            named = list(specification.failures[0].importance.items()) if specification.failures else []
            _draw_importance(panels[k, 1], specification, named if importance is None else importance[k])
        drawn.suptitle("\n".join(lines))
        set_height(drawn, _PANEL * rows + LINE_HEIGHT * (len(lines) + 1))
    return drawn


def draw(axes: Axes, result: ReliabilityResult, which: int, quantity: str) -> None:
    """Draw the methods' probabilities of failure of the first specification of a vector on given axes."""
    entries = result.poses[which].specifications
    found = [entry for entry in entries if entry.specification.quantity.startswith(quantity)]
    if not found:
        raise InputError(f"no specification limits the {quantity}")
    with style():
        _draw_methods(axes, found[0])


def _draw_methods(axes: Axes, entry: SpecificationReliability) -> None:
    shown = [one for one in entry.estimates if one.interval[1] < 1 or one.probability]
    positive = [value for one in shown for value in (*one.interval, one.probability) if value > 0]
    positive += [*(entry.form.range or ()), 1 - entry.specification.required]
    lowest = 10.0 ** math.floor(math.log10(max(min(positive), 1e-15)) - 0.3)
    highest = 10.0 ** math.ceil(math.log10(max(positive)))
    for row, estimate in enumerate(shown):
        colour = BLUE if estimate.resolved else SKY
        low, high = (max(end, lowest) for end in estimate.interval)
        axes.plot([low, high], [row, row], color=colour, linewidth=2.4, solid_capstyle="butt")
        if estimate.probability:
            axes.plot([estimate.probability], [row], "o", color=colour, markersize=4)
    names = [estimate.method for estimate in shown]
    if entry.form.range is not None:
        axes.plot(entry.form.range, [len(shown)] * 2, color=PURPLE, linewidth=2.4)
        axes.plot([entry.form.range[0]], [len(shown)], "s", color=PURPLE, markersize=4)
        names.append("FORM")
    colour = VERMILION if entry.verdict == "not met" else GREEN if entry.met else BLACK
    axes.axvline(1 - entry.specification.required, color=colour, linestyle=(0, (6, 1.5, 1.2, 1.5)))
    axes.set_xscale("log")
    axes.set_xlim(lowest, highest)
    decades = round(math.log10(highest / lowest))
    ticks = [highest * 10.0**-k for k in range(0, decades + 1, max(1, math.ceil(decades / 5)))]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0e}" if value < 1e-3 else f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(max(len(names), 3) - 0.4, -0.6)
    axes.set_xlabel("probability of failure (line: allowed)")
    limited = entry.specification
    within = f"{1e3 * limited.limit:.6g} {unit(limited.quantity)}"
    axes.set_title(f"{absolute(limited.quantity)} within {within}: {entry.verdict}", fontsize=7.5)


def _draw_importance(axes: Axes, entry: SpecificationReliability, importance: Sequence[tuple[str, float]]) -> None:
    axes.set_xlabel("importance at the design point [%]")
    if not entry.failures:
        axes.text(0.03, 0.8, "no design point found", transform=axes.transAxes)
        axes.set_yticks([])
        axes.set_xticks([])
        return
    shares = importance[:LISTED]
    axes.barh(range(len(shares)), [100 * share for _, share in shares], height=0.7, color=SKY, linewidth=0)
    axes.set_yticks(range(len(shares)), [shortened(name, _LONGEST_NAME) for name, _ in shares])
    axes.set_ylim(max(len(shares), 3) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.set_title(f"β = {entry.failures[0].beta:.4g}", fontsize=7.5)
