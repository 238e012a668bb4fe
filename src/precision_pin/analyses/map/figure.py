"""A map in pictures, report and view: over a plane, in space, along a path or over a list of poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from precision_pin.analyses.map.map_poses import MapResult
from precision_pin.analyses.map.map_verdicts import MET, NOT_JUDGED
from precision_pin.analyses.map.table import answers, worst_rows
from precision_pin.analyses.pose_layout import MOST_NAMED, Layout, draw_field, layout_of
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnknownNameError, shown, visible
from precision_pin.base.written_units import WrittenUnit
from precision_pin.render.display_units import ColourScale
from precision_pin.render.draw_distribution import BLACK, BLUE, PURPLE, SKY, VERMILION
from precision_pin.render.figure_style import DOUBLE_COLUMN, frame, inline_figure, new_figure, shortened, style
from precision_pin.render.html import Html, escaped, items, paragraph, section, table
from precision_pin.render.scene import Chapter, Colour, Layer, Scene
from precision_pin.render.tables import count_poses, symbol
from precision_pin.sampling.poses_result import LEVELS
from precision_pin.statistics.intervals import format_interval

_MOST_LETTERS: Final = 18  # of a name on the axis
_MOST_LEVEL: Final = 60  # letters of all names together without rotated labels
# colour, dashes and marker of each quantile
_STYLES: Final = ((SKY, ":", "v"), (BLUE, "-", "o"), (PURPLE, "--", "^"))
_MARKS: Final = ((VERMILION, "specification not met"), ("#ffffff", "undecided"))


def figure(result: MapResult, quantity: str = "position", level: float = 0.95) -> Figure:
    """Return the figure of a quantile of ``"position"`` or ``"attitude"``, 174 mm wide; see :meth:`MapResult.plot`.

    Raises:
        UnknownNameError: Another quantity.
        InputError: A level that the map does not have.
    """
    names = ("position", "attitude")
    if quantity not in names:
        raise UnknownNameError("quantity", quantity, names)
    if level not in LEVELS:
        raise InputError(f"level {level!r}: a map has the quantiles {', '.join(map(str, LEVELS))}")
    norm, rank = names.index(quantity), LEVELS.index(level)
    of_nodes = result.poses.best_and_worst(result.quantile[rank, norm])[1]
    node = result.poses.node
    firsts = np.arange(len(result.poses)) if node is None else np.unique(node, return_index=True)[1]
    nodes = np.where(of_nodes >= 0, of_nodes, firsts)
    layout = layout_of(result.poses, nodes)
    panels = [("", result.quantile[:, norm][:, nodes])]
    if result.relative is not None:
        panels.append(("relative to the reference", result.relative.quantile[:, norm][:, nodes]))
    size = symbol(f"{quantity}.norm")
    unit = WrittenUnit.of_axis(f"{quantity}.norm", max(float(np.nanmax(values)) for _, values in panels))
    with style():
        chart = new_figure(DOUBLE_COLUMN)
        is_curve = layout.kind in ("path", "list")
        if not is_curve:
            # panels with equal axes leave room next to them: close the gap, together with their bars
            chart.set_layout_engine("compressed")
        subplots: dict[str, Any] = {"projection": "3d"} if layout.kind == "space" else {}
        axes = np.atleast_1d(chart.subplots(1, 1 if is_curve else len(panels), subplot_kw=subplots, squeeze=True))
        masks = [poses[nodes] for poses in _marks(result)]
        for place, (title, values) in enumerate(panels):
            panel = axes[0 if is_curve else place]
            if is_curve:
                _draw_curves(panel, result, layout, values * unit.per_si, title, nodes)
            else:
                unmet = [(poses & (not title), *mark) for poses, mark in zip(masks, _MARKS, strict=True)]
                draw_field(chart, panel, layout, values[rank] * unit.per_si, f"{size} [{unit.name}]", unmet)
                panel.set_title(title)
        if is_curve:
            axes[0].set_ylabel(f"{size} [{unit.name}]")
            axes[0].set_ylim(bottom=0)
        has_branches = result.poses.node is not None and len(nodes) < len(result.poses)
        note = "; one branch of each place, neighbours may have others" if result.poses.node is not None else ""
        places_shown = "; the worst branch and tool angle of each place" if has_branches else note
        caption = f"first order, closed form{places_shown}; {worst_said(result, norm, rank)}"
        what = size if is_curve else f"{100 * level:g} % of robots within {size}"
        title = f"{what}: {visible(result.provenance.robot, 60)} at {count_poses(len(nodes))}"
        frame(chart, axes.tolist(), title, caption, 95.0 if len(panels) == 1 and not is_curve else 80.0)
    return chart


def worst_said(result: MapResult, norm: int, rank: int) -> str:
    """Return a quantile at the worst pose as text: in closed form, its bounds, and the sampled interval."""
    worst = result.worst_first[0]
    unit = ("mm", "mrad")[norm]
    low, high = 1e3 * result.quantile_bounds[rank, norm, :, worst]
    text = (
        f"at {shown(result.poses.labels[worst])}, the worst{'' if result.sampled is None else ' of those sampled'}, "
        f"{1e3 * result.quantile[rank, norm, worst]:.4g} {unit}, limits whatever the laws {low:.3g} to {high:.3g} {unit}"
    )
    if result.sampled is None or worst not in result.sampled.poses:
        return text
    place = int(np.flatnonzero(result.sampled.poses == worst)[0])
    interval = result.sampled.result.quantile_interval[rank, norm, :, place].tolist()
    return (
        text
        if np.isnan(interval).any()
        else f"{text}, sampled {' to '.join(format_interval(interval[0], interval[1], 1e3))} {unit}"
    )


def _marks(result: MapResult) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the poses ``(P,)`` at which the sampled robots miss a specification, and those left undecided."""
    order = result.judged.order.min(axis=0, initial=NOT_JUDGED)
    return order == 0, (order > 0) & (order < MET)


def _draw_curves(
    axes: Axes, result: MapResult, layout: Layout, values: Array, title: str, nodes: NDArray[np.intp]
) -> None:
    places = layout.places[0] * (1e3 if layout.names[0].endswith("[mm]") else 1.0)
    order = np.argsort(places, kind="stable")
    is_short = len(places) <= MOST_NAMED
    for rank, (level, (colour, dashes, marker)) in enumerate(zip(LEVELS, _STYLES, strict=True)):
        if title and level != 0.95:
            continue
        label = "median" if level == LEVELS[0] else f"{100 * level:g} % of robots"
        lines: Any = {"color": BLACK, "linestyle": (0, (1, 1))} if title else {"color": colour, "linestyle": dashes}
        # only poses of one motion, or along a line, are joined
        lines |= {"linestyle": "none"} if layout.kind == "list" else {}
        axes.plot(
            places[order], values[rank][order], marker=marker if is_short else "", markersize=2.5,
            label=f"{label}, {title}" if title else label, **lines,
        )  # fmt: skip
    if title:
        return
    if layout.kind != "list":
        axes.fill_between(places[order], 0, values[LEVELS.index(0.95)][order], color=SKY, alpha=0.12, linewidth=0)
    unknown = ~np.isfinite(values[0])
    if unknown.any():
        axes.plot(
            places[unknown], np.zeros(unknown.sum()), "x", color=BLACK, markersize=4, label="not reached", clip_on=False
        )
    quantiles = values[LEVELS.index(0.95)]
    for poses, (colour, label) in zip(_marks(result), _MARKS, strict=True):
        marked = poses[nodes]
        if marked.any():
            axes.plot(
                places[marked],
                quantiles[marked],
                "o",
                color=colour,
                markersize=3.5,
                label=label,
                markeredgecolor=BLACK,
                markeredgewidth=0.4,
            )
    axes.set_xlabel(layout.names[0])
    if layout.kind == "list":
        labels = [shortened(visible(result.poses.labels[pose]), _MOST_LETTERS) for pose in nodes]
        is_rotated = sum(map(len, labels)) > _MOST_LEVEL
        axes.set_xlabel("")
        axes.set_xticks(places, labels, rotation=45 if is_rotated else 0, ha="right" if is_rotated else "center")
        axes.set_xlim(0.5, len(places) + 0.5)


def _section(result: MapResult) -> Html:
    lines, rows = answers(result), worst_rows(result)
    pictures = [
        inline_figure(
            figure(result, quantity),
            f"map-{quantity}",
            f"Map of the {quantity} error over {len(result.poses):,} poses: {lines[0]}",
            f"Within how much {symbol} 95 % of robots stay, to first order, at the worst branch and tool angle of each place.",
        )
        for quantity, symbol in (("position", "|d|"), ("attitude", "|δ|"))
    ]
    note = paragraph(
        "Quantiles of |d| in mm, of |δ| in mrad, in closed form, to first order; limits: of the exact 95 %, whatever the laws; "
        "sampled: the interval of the 95 % by fresh samples of the exact model; spec: the sampled share inside, * where it is "
        "not met, ? where the samples do not decide; cause: of most variance.",
        class_="note",
    )
    poses = table("The worst poses of the map", list(rows[0]), [list(row.values()) for row in rows])
    return section("map", "Map", items(lines), *pictures, poses, note)


def map_chapter(result: MapResult) -> Chapter:
    """Return the map as a chapter with its answers at the top: what is met at the poses may be missed on the map."""
    lines = tuple(f"On the map: {line}" for line in answers(result))
    return Chapter("map", "Map", _section(result), lines)


_CORNERS: Final = np.concatenate([np.eye(3), -np.eye(3)])
# an octahedron
_FACES: Final = np.array(
    [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]], dtype=np.uint32
)
# decimals of places in m: joint values come from an iteration, so that places do not agree to the last bit
_DECIMALS: Final = 8


@dataclass(frozen=True, eq=False)
class PlacesData(Layer):
    """Layer with the places of a map, ``(3, M)``, m, and the result at the worst pose as text.

    Attributes:
        sizes: 95 % quantile of |d| in closed form at the worst pose there, m, ``(M,)``; NaN without joint values.
    """

    positions: Array
    sizes: Array
    scale: ColourScale
    worst: str

    @classmethod
    def of(cls, result: MapResult, *_: object) -> PlacesData:
        """Return the places of a map; solutions and orientations at one place are merged."""
        quantile = result.quantile[LEVELS.index(0.95), 0]
        positions, place = np.unique(result.poses.position.round(_DECIMALS), axis=1, return_inverse=True)
        worst = np.full(positions.shape[1], -np.inf)
        is_known = np.isfinite(quantile)
        np.maximum.at(worst, place.ravel()[is_known], quantile[is_known])
        sizes = np.where(np.isfinite(worst), worst, np.nan)
        text = worst_said(result, 0, LEVELS.index(0.95))
        return cls(positions, sizes, ColourScale.of(sizes[np.isfinite(sizes)]), text)

    @property
    def name(self) -> str:
        """Name of the layer."""
        return "map"

    def settings(self, length: float) -> dict[str, Any]:
        """Return nothing: the marks have a fixed size."""
        del length
        return {}

    def draw(self, scene: Scene, length: float) -> None:
        """Add a mark at each place: one surface for each colour, so that a page with thousands still opens quickly."""
        radius = _radius(self.positions, length)
        colours, scale = self.scale.stops, self.scale
        span = scale.largest - scale.smallest
        share = (self.sizes - scale.smallest) / span if span > 0 else np.where(np.isnan(self.sizes), np.nan, 1.0)
        is_known = np.isfinite(share)
        stops = np.rint(np.where(is_known, share, 0) * (len(colours) - 1)).astype(int)
        for stop, colour in enumerate(colours):
            is_of_colour = is_known & (stops == stop)
            _draw_marks(scene, f"level{stop}", self.positions[:, is_of_colour], radius, (*to_rgb(colour), 1.0))
        # grey
        # radius of an unreached place, relative to the others
        _draw_marks(scene, "unreached", self.positions[:, ~is_known], 0.4 * radius, (0.62, 0.62, 0.62, 1.0))

    def legend(self) -> str:
        """Return the section of the legend: the colours, and the number of places."""
        unreached = int(np.isnan(self.sizes).sum())
        noun = "places that are" if unreached > 1 else "place that is"
        grey = f"; grey: {unreached:,} {noun} not reached" if unreached else ""
        count = len(self.sizes) - unreached
        label = f"{count:,} place{'' if count == 1 else 's'}, coloured by the worst pose at each{grey}"
        return (
            f'<section aria-label="Map"><h2>Map: 95 % of robots within |d|, {self.scale.unit.name}</h2>'
            f'{self.scale.bar()}<ul class="legend controls"><li><label><input type="checkbox" id="show-map" checked>'
            f'<i class="dot"></i><span>{escaped(label)}</span></label></li></ul>'
            f'<p class="fine">To first order; {escaped(self.worst)}. Places and arm are true to scale.</p></section>'
        )


def _draw_marks(scene: Scene, name: str, positions: Array, radius: float, colour: Colour) -> None:
    count = positions.shape[1]
    if count == 0:
        return
    corners = (positions.T[:, None] + radius * _CORNERS).reshape(-1, 3)
    faces: NDArray[np.uint32] = (_FACES + 6 * np.arange(count, dtype=np.uint32)[:, None, None]).reshape(-1, 3)
    scene.surface(("map", name), corners, faces, colour, np.eye(4))


def _radius(positions: Array, length: float) -> float:
    # smallest and largest radius of a mark, in lengths of the arm
    smallest, largest = (share * length for share in (0.004, 0.03))
    if positions.shape[1] < 2:
        return largest
    distances = cKDTree(positions.T).query(positions.T, k=2)[0][:, 1]
    return float(np.clip(0.3 * np.median(distances), smallest, largest))
