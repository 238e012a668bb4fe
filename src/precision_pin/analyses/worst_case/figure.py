"""The worst case as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from precision_pin.analyses.worst_case.table import listed_contributions
from precision_pin.analyses.worst_case.worst_case_result import SEEN_LEVEL, NormBound, PoseWorstCase, WorstCaseResult
from precision_pin.render.draw_distribution import BLACK, BLUE, GREEN, PURPLE, SKY, VERMILION, display_unit
from precision_pin.render.figure_style import (
    DOUBLE_COLUMN,
    LINE_HEIGHT,
    caption,
    end_figure,
    new_figure,
    shortened,
    style,
)
from precision_pin.render.tables import ROUNDING, symbol

_LONGEST_NAME: Final = 44
_BAR: Final = 4.6


def figure(
    result: WorstCaseResult, which: int = 0, entries: Mapping[str, Sequence[tuple[str, float]]] | None = None
) -> Figure:
    """Return how the draws add up to the worst case of |d| (above) and |δ| at one of the poses, 174 mm wide.

    Each bar begins where the one above it ends: the error at the means, the largest contributions, the rest. Lines mark
    the first-order bound, the largest exact error found, the largest seen and the 99.73 % quantile of the samples.
    """
    pose, provenance = result.poses[which], result.provenance
    lines = [
        *caption("worst case", provenance, pose.pose),
        f"N = {result.samples:,}, seed {provenance.seed}, exact model, statics {provenance.statics}",
    ]
    if result.cut:
        lines.append(f"unbounded laws cut at {result.k:g} standard deviations: {len(result.cut)} of {result.draws}")
    lines += explain_excess(pose)
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        bounds = (pose.position, pose.attitude)
        bars = [_bars(bound) if entries is None else _shorten(entries[bound.quantity]) for bound in bounds]
        panels = drawn.subplots(2, 1, height_ratios=[max(len(rows), 4) for rows in bars])
        for axes, bound, rows in zip(panels, bounds, bars, strict=True):
            _draw(axes, bound, rows)
        height = 34 + _BAR * sum(max(len(rows), 4) for rows in bars) + LINE_HEIGHT * (len(lines) + 2)
        end_figure(drawn, panels[:1], lines, height)
    return drawn


def draw(axes: Axes, result: WorstCaseResult, which: int, quantity: str) -> None:
    """Draw one vector, ``"position"`` or ``"attitude"``, on given axes."""
    bound = {"position": result.poses[which].position, "attitude": result.poses[which].attitude}[quantity]
    with style():
        _draw(axes, bound, _bars(bound))


def explain_excess(pose: PoseWorstCase) -> list[str]:
    """Return why an error beyond a bound was found, where one was."""
    lines = []
    for bound in (pose.position, pose.attitude):
        upper = bound.first_order.upper * (1 + 1e-9) + ROUNDING
        name = symbol(bound.quantity)
        if bound.found.norm > upper:
            lines.append(
                f"{name}: the exact model goes beyond its first-order bound: it is not linear over tolerances this large"
            )
        if bound.seen.max > upper:
            lines.append(f"{name}: samples lie beyond the bound, which cuts unbounded laws and is of the first order")
    return lines


def _bars(bound: NormBound) -> list[tuple[str, float]]:
    return _shorten(listed_contributions(bound, "error at the means"))


def _shorten(entries: Sequence[tuple[str, float]]) -> list[tuple[str, float]]:
    return [(shortened(name, _LONGEST_NAME), value) for name, value in entries]


def _draw(axes: Axes, bound: NormBound, entries: Sequence[tuple[str, float]]) -> None:
    name, shown = symbol(bound.quantity), display_unit(bound.seen)
    begin = 0.0
    for row, (_, value) in enumerate(entries):
        colour = BLUE if row == 0 else SKY
        axes.barh(row, value * shown.per_si, left=begin * shown.per_si, height=0.7, color=colour, linewidth=0)
        begin += value
    axes.set_yticks(range(len(entries)), [name for name, _ in entries])
    axes.set_ylim(max(len(entries), 4) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    quantile = f"{100 * SEEN_LEVEL:g} % quantile of the samples"
    for size, colour, dashes, width, label in (
        (bound.first_order.upper, VERMILION, "-", 1.6, "bound of the first-order model"),
        (bound.found.norm, BLACK, (0, (1.2, 1.2)), 1.0, "largest error of the exact model found"),
        (bound.seen.max, GREEN, (0, (4, 1.5)), 1.0, "largest seen among the samples"),
        (bound.seen.quantile(SEEN_LEVEL), PURPLE, (0, (6, 1.5, 1.2, 1.5)), 1.0, quantile),
    ):
        if size is not None:
            axes.axvline(size * shown.per_si, color=colour, linestyle=dashes, linewidth=width, label=label)
    axes.axvline(0, color=BLACK, linewidth=0.6)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 2, 5, 10]))
    axes.ticklabel_format(axis="x", style="plain", useOffset=False)
    axes.margins(x=0.03)
    axes.set_xlabel(f"{name} [{shown.name}]")
    axes.set_title(
        f"{name}: bound {bound.first_order.upper * shown.per_si:.5g}, exact model at least "
        f"{bound.found.norm * shown.per_si:.5g}, largest seen {bound.seen.max * shown.per_si:.5g} {shown.name}",
        fontsize=7.5,
    )
