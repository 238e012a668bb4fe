"""The stiffness in pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from precision_pin.analyses.stiffness.stiffness import Direction, PoseStiffness, StiffnessResult, vector_text
from precision_pin.analyses.stiffness.table import answer, pose_columns
from precision_pin.base.arrays import Array
from precision_pin.render import figure_style
from precision_pin.render.columns import report_table
from precision_pin.render.display_units import ColourScale
from precision_pin.render.draw_distribution import BLACK, BLUE, GREEN, PURPLE, SKY, VERMILION
from precision_pin.render.html import escaped, items, paragraph, section
from precision_pin.render.scene import Chapter, Colour, Layer, Scene

_PARTS: Final = 4
"""Elastic sources with a colour of their own."""
_COLOURS: Final = (BLUE, SKY, GREEN, PURPLE, "#F0E442")
_AXIS_COLOURS: Final = (BLUE, VERMILION, GREEN)
_COLOUR_MAP: Final = "cividis_r"
_LETTERS: Final = 40
_SIDES, _RINGS = 12, 5
"""Corners of the rings of an ellipsoid, and its rings."""
_LARGEST: Final = 0.12
"""Largest half-axis of an ellipsoid, in lengths of the arm."""
_DECIMALS: Final = 8
"""Decimals of a place, m: joint values come from an iteration."""
_MAP_WIDTH: Final = 120.0
"""Width of a map of a single view, mm."""
_VIEWS: Final = ((0, 1), (0, 2), (1, 2))
"""Axes of the views of a map: from above, and from the sides."""
_FLAT: Final = 0.02
"""Relative extent of the places below which a view shows a line."""


def figure(result: StiffnessResult, which: int | None = None) -> Figure:
    """Return a pose's compliances by elastic source, with displacement over force; by default the map of several poses."""
    if which is None and len(result.poses) > 1:
        return map_figure(result)
    pose = result.poses[which or 0]
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


def stiffness_chapter(result: StiffnessResult) -> Chapter:
    """Return the stiffness over poses as a chapter."""
    softest = result.poses[result.softest_pose]
    answers = (f"Stiffness, softest of {len(result.poses):,} poses: {answer(softest)}",)
    picture = figure_style.inline_figure(
        map_figure(result),
        "stiffness-map",
        f"Softest compliance over {len(result.poses):,} poses: {answers[0]}",
        "Compliance in the softest direction, which lines show, at the poses of the grid.",
    )
    rows = report_table(
        f"Compliance at the softest pose, {softest.pose.name}", pose_columns(result, softest), result.rows(softest)
    )
    sentences = (f"{line[0].upper()}{line[1:]}." for line in (result.how, *result.assumptions))
    note = paragraph(" ".join(sentences), class_="note")
    return Chapter(
        "stiffness", "Stiffness", section("stiffness", "Stiffness", items(answers), picture, rows, note), answers
    )


def _ball() -> tuple[Array, NDArray[np.uint32]]:
    """Return corners ``(V, 3)`` and faces ``(F, 3)`` of a ball of radius 1."""
    heights, turns = np.linspace(0, np.pi, _RINGS + 2), np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    h, t = (part.ravel() for part in np.meshgrid(heights, turns, indexing="ij"))
    corners = np.stack([np.sin(h) * np.cos(t), np.sin(h) * np.sin(t), np.cos(h)], axis=1)
    # each cell between two rings is two triangles; those at the poles have no area
    first = np.arange(len(corners) - _SIDES)
    after = first - first % _SIDES + (first + 1) % _SIDES
    cells = [[first, first + _SIDES, after], [after, first + _SIDES, after + _SIDES]]
    return corners, np.concatenate([np.transpose(cell) for cell in cells]).astype(np.uint32)


@dataclass(frozen=True, eq=False)
class ComplianceLayer(Layer):
    """Layer of compliance ellipsoids: what forces of one size in all directions do to the tip, at one scale for all poses.

    Attributes:
        positions, blocks: Places ``(M, 3)``, m, and the translational block of the compliance at the softest pose of each,
            ``(M, 3, 3)``, m/N.
        sizes: Softest compliance there, m/N.
        answer: The softest pose as text.
    """

    positions: Array
    blocks: Array
    sizes: Array
    answer: str
    name: str = "stiffness"

    @classmethod
    def of(cls, result: StiffnessResult, *_: object) -> ComplianceLayer:
        """Return the layer of a result; of several poses at one place the softest is drawn."""
        by_place = {tuple(pose.position.round(_DECIMALS)): pose for pose in sorted(result.poses, key=_softness)}
        poses = list(by_place.values())
        return cls(
            np.array([pose.position for pose in poses]),
            np.array([pose.compliance[:3, :3] for pose in poses]),
            np.array([pose.softest.compliance for pose in poses]),
            answer(result.poses[result.softest_pose]),
        )

    @property
    def scale(self) -> ColourScale:
        """Colours of the softest compliance."""
        return ColourScale.of(self.sizes)

    def settings(self, length: float) -> dict[str, Any]:
        """Return nothing: the ellipsoids have a fixed size."""
        del length
        return {}

    def draw(self, scene: Scene, length: float) -> None:
        """Add the ellipsoids: one surface for each colour."""
        corners, faces = _ball()
        largest = _LARGEST * length
        if len(self.positions) > 1:
            distances = cKDTree(self.positions).query(self.positions, k=2)[0][:, 1]
            largest = min(largest, 0.5 * float(np.median(distances)))
        scale, colours = self.scale, self.scale.stops
        span = scale.largest - scale.smallest
        share = (self.sizes - scale.smallest) / span if span > 0 else np.ones(len(self.sizes))
        stops = np.rint(share * (len(colours) - 1)).astype(int)
        for stop in np.unique(stops).tolist():
            chosen = np.flatnonzero(stops == stop)
            moved = largest / scale.largest * np.einsum("vj,mij->mvi", corners, self.blocks[chosen])
            shapes = faces + len(corners) * np.arange(len(chosen), dtype=np.uint32)[:, None, None]
            places = (self.positions[chosen, None] + moved).reshape(-1, 3)
            colour: Colour = (*to_rgb(colours[stop]), 1.0)
            scene.surface((self.name, f"level{stop}"), places, shapes.reshape(-1, 3), colour, np.eye(4))

    def legend(self) -> str:
        """Return the section of the legend."""
        count = len(self.positions)
        places = f"{count:,} place{'' if count == 1 else 's'}"
        label = f"compliance ellipsoids at {places}, all at one scale: long where the tool is soft"
        return (
            '<section aria-label="Stiffness"><h2>Softest compliance, mm/kN</h2>'
            f'{self.scale.bar(1e6)}<ul class="legend controls"><li><label><input type="checkbox" id="show-{self.name}" checked>'
            f'<i class="dot"></i><span>{escaped(label)}</span></label></li></ul>'
            f'<p class="fine">Softest: {escaped(self.answer)}.</p></section>'
        )


def _softness(pose: PoseStiffness) -> float:
    return pose.softest.compliance
