"""A budget as a bar chart."""

from __future__ import annotations

from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font

from precision_pin.analyses.budget.budget_result import (
    VECTORS,
    BudgetResult,
    Group,
    PoseBudget,
)
from precision_pin.outputs.kit.draw_distribution import BLACK, BLUE, SKY
from precision_pin.outputs.kit.figure_style import DOUBLE_COLUMN, labelled, legend_below, new_figure, set_height, style
from precision_pin.visible import shortened
from precision_pin.visible import shown as quoted

__all__ = ["figure"]

MOST_BARS: Final = 12
MOST_CHARACTERS: Final = 48


def figure(result: BudgetResult, pose: int = 0) -> Figure:
    """Return bars of the first-order and total Sobol indices of position and attitude, largest first, 174 mm wide.

    Diamonds are the closed-form shares; whiskers the intervals.

    Parameters
    ----------
    result
        What was found.
    pose
        Which of its poses.
    """
    found = result.poses[pose]
    bars = max(1, min(MOST_BARS, len(found.groups)))
    with style():
        made = new_figure(DOUBLE_COLUMN)
        panels = made.subplots(2, 1)
        for axes, vector in zip(panels, VECTORS, strict=True):
            _bars(axes, found, vector)
        name = _shown(found.pose.name)
        made.suptitle(f"Error budget{f', pose {quoted(name)}' if name else ''}")
        caption = f"exact model, {result.samples:,} points, seed {result.provenance.seed}; "
        legend_below(made, labelled(panels[:1]), 3, [f"{caption}intervals at {100 * result.confidence:g} % confidence"])
        set_height(made, 42 + 2 * 6.0 * bars)
    return made


def _bars(axes: Axes, pose: PoseBudget, vector: str) -> None:
    """Draw one vector's bars; the indices of what does not fit are left out and counted in the axis's label."""
    groups = sorted(pose.groups, key=lambda group: _largest(group, vector), reverse=True)
    shown = groups[:MOST_BARS]
    for offset, which, colour, label in (
        (-0.2, "first", BLUE, "first-order index"),
        (0.2, "total", SKY, "total index"),
    ):
        found = [getattr(group, which)[vector] for group in shown]
        axes.barh(
            [row + offset for row in range(len(shown))],
            [0.0 if one is None else 100 * one.value for one in found],
            xerr=[0.0 if one is None else 100 * one.half_width for one in found],
            height=0.36,
            color=colour,
            label=label,
            error_kw={"elinewidth": 0.6, "capsize": 1.2, "capthick": 0.6},
        )
    axes.plot(
        [100 * (group.share[vector] or 0.0) for group in shown],
        range(len(shown)),
        linestyle="none",
        marker="D",
        markersize=3,
        markerfacecolor="white",
        markeredgecolor=BLACK,
        markeredgewidth=0.6,
        label="closed form, first order",
    )
    axes.set_yticks(range(len(shown)), [shortened(_shown(" + ".join(group.draws)), MOST_CHARACTERS) for group in shown])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
    left_out = len(groups) - len(shown)
    more = f" ({left_out} smaller ones not shown)" if left_out else ""
    axes.set_xlabel(f"share of the variance of the {vector} error [%]{more}")


def _largest(group: Group, vector: str) -> float:
    total = group.total[vector]
    return -1.0 if total is None else total.value


def _shown(name: str) -> str:
    """Return a name with a box for what the font of the figures does not have."""
    known = get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap()
    return "".join(character if ord(character) in known else "□" for character in name)
