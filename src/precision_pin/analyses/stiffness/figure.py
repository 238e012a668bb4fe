"""The stiffness in pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.analyses.stiffness.stiffness import Direction, PoseStiffness, StiffnessResult, vector_text
from precision_pin.analyses.stiffness.table import answer
from precision_pin.render import figure_style
from precision_pin.render.draw_distribution import BLACK, BLUE, GREEN, PURPLE, SKY, VERMILION

_PARTS: Final = 4
"""Elastic sources with a colour of their own."""
_COLOURS: Final = (BLUE, SKY, GREEN, PURPLE, "#F0E442")
_AXIS_COLOURS: Final = (BLUE, VERMILION, GREEN)
_COLOUR_MAP: Final = "cividis_r"
_LETTERS: Final = 40
_MAP_WIDTH: Final = 120.0
"""Width of a map of a single view, mm."""
_VIEWS: Final = ((0, 1), (0, 2), (1, 2))
"""Axes of the views of a map: from above, and from the sides."""
_FLAT: Final = 0.02
"""Relative extent of the places below which a view shows a line."""


def figure(result: StiffnessResult, which: int = 0) -> Figure:
    """Return the compliances along the axes by elastic source, and the displacement by force, 174 mm wide."""
    pose = result.poses[which]
    caption = f"{figure_style.caption('stiffness', result.provenance, pose.pose)}\n{result.how}"
    with figure_style.style():
        chart = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        panels = chart.subplots(1, 2)
        _draw_parts(panels[0], pose)
        if pose.static_compliance:
            _draw_steps(panels[1], pose)
        else:
            _draw_rotations(panels[1], pose)
        figure_style.frame(chart, panels, answer(pose), caption, 72.0, 3)
    return chart


def _draw_parts(axes: Axes, pose: PoseStiffness) -> None:
    """Draw the compliance along each axis and in the softest direction, stacked by source, with 5 to 95 % of the robots."""
    entries = [*pose.axes, pose.softest]
    ranked = sorted(pose.sources, key=lambda part: -max(part.compliance, *part.axes))
    named, others = ranked[:_PARTS], ranked[_PARTS:]
    bars = [(part.source, np.append(part.axes, part.compliance)) for part in named]
    if others:
        rest = np.sum([np.append(part.axes, part.compliance) for part in others], axis=0)
        bars.append((f"{len(others)} more", rest))
    bottom = np.zeros(len(entries))
    for (name, values), colour in zip(bars, _COLOURS, strict=False):
        label = figure_style.shortened(name, _LETTERS)
        axes.bar(range(len(entries)), 1e6 * values, 0.6, 1e6 * bottom, color=colour, label=label, linewidth=0)
        bottom = bottom + values
    _draw_robots(axes, entries, 1e6)
    names = [entry.axis for entry in entries]
    axes.set_xticks(range(len(entries)), [*names[:-1], f"softest\n{vector_text(pose.softest.direction)}"])
    axes.set_ylabel("compliance [mm/kN]")


def _draw_rotations(axes: Axes, pose: PoseStiffness) -> None:
    entries = [*pose.rotation, pose.softest_rotation]
    axes.bar(range(len(entries)), [1e3 * entry.compliance for entry in entries], 0.6, color=SKY, linewidth=0)
    _draw_robots(axes, entries, 1e3)
    names = [f"about {entry.axis}" for entry in pose.rotation]
    axes.set_xticks(range(len(entries)), [*names, f"softest\n{vector_text(pose.softest_rotation.direction)}"])
    axes.set_ylabel("turn by moment [mrad/(N·m)]")


def _draw_robots(axes: Axes, entries: Sequence[Direction], per_si: float) -> None:
    for k, entry in enumerate(entries):
        low, high = entry.law.quantiles[0.05], entry.law.quantiles[0.95]
        if low is not None and high is not None and high > low:
            label = "5 to 95 % of robots" if k == 0 else None
            axes.plot([k, k], [per_si * low, per_si * high], color=BLACK, linewidth=1.4, label=label)


def _draw_steps(axes: Axes, pose: PoseStiffness) -> None:
    """Draw the displacement along the force over the force, with the tangent at no force, and the dead band."""
    for k, entry in enumerate(pose.axes):
        colour = _AXIS_COLOURS[k]
        minus, plus = (pose.static_compliance[f"{sign}{entry.axis}"] for sign in "-+")
        force = np.concatenate([-minus.force[::-1], [0.0], plus.force])
        moved = np.concatenate([(-minus.compliance * minus.force)[::-1], [0.0], plus.compliance * plus.force])
        axes.plot(force, 1e3 * moved, color=colour, marker=".", markersize=3, label=f"force along {entry.axis}")
        axes.plot(force, 1e3 * entry.compliance * force, color=colour, linestyle=":", linewidth=0.8)
    axes.plot([], [], color=BLACK, linestyle=":", linewidth=0.8, label="tangent at no force")
    axes.axhline(0, color=BLACK, linewidth=0.5)
    axes.axvline(0, color=BLACK, linewidth=0.5)
    axes.set_xlabel("force [N]")
    axes.set_ylabel("displacement along the force [mm]")


def map_figure(result: StiffnessResult) -> Figure:
    """Return the target's places coloured by their softest compliance, with its direction, from above and from the side."""
    places = 1e3 * np.array([pose.position for pose in result.poses])
    sizes = 1e6 * np.array([pose.softest.compliance for pose in result.poses])
    ways = np.array([pose.softest.direction for pose in result.poses])
    softest, order = result.poses[result.softest_pose], np.argsort(sizes)
    caption = f"{figure_style.caption('softest compliance', result.provenance, softest.pose)}: {answer(softest)}\n{result.how}"
    extent = np.ptp(places, axis=0)
    views = [pair for pair in _VIEWS if extent[list(pair)].min() > _FLAT * extent.max()] or _VIEWS[:1]
    with figure_style.style():
        chart = figure_style.new_figure(figure_style.DOUBLE_COLUMN if len(views) > 1 else _MAP_WIDTH)
        panels = chart.subplots(1, len(views), squeeze=False)[0]
        for axes, view in zip(panels, map(list, views), strict=True):
            marks = axes.scatter(*places[order][:, view].T, c=sizes[order], cmap=_COLOUR_MAP, s=24, zorder=2)
            axes.quiver(
                *places[:, view].T, *ways[:, view].T, pivot="middle", headwidth=1, headlength=0, headaxislength=0,
                width=0.003, units="height", scale=18, color=VERMILION, zorder=3,
            )  # fmt: skip
            axes.set_aspect("equal")
            axes.margins(0.08)
            axes.locator_params(nbins=6)
            for name, row in zip((axes.set_xlabel, axes.set_ylabel), view, strict=True):
                name(f"{'xyz'[row]} [mm]")
        chart.colorbar(marks, ax=panels, label="softest compliance [mm/kN]", shrink=0.8)
        title = f"{len(places):,} poses: {sizes.min():.4g} to {sizes.max():.4g} mm/kN in the softest direction (lines)"
        figure_style.frame(chart, [], title, caption, 84.0)
    return chart
