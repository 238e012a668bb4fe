"""The error along a path in pictures, report and view: quantile at each pose, band of whole curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.analyses.path.path_law import PathResult
from precision_pin.analyses.path.table import (
    band_lines,
    headline,
    maximum_rows,
    pose_rows,
    quantile_text,
    verdict_lines,
    where_line,
)
from precision_pin.analyses.pose_axis import mark_poses
from precision_pin.base.errors import visible
from precision_pin.base.written_units import WrittenUnit
from precision_pin.render.display_units import ColourScale, round_number
from precision_pin.render.draw_distribution import BLACK, BLUE, LIMIT_COLOURS, PURPLE, SKY
from precision_pin.render.figure_style import DOUBLE_COLUMN, frame, inline_figure, new_figure, style
from precision_pin.render.html import escaped, items, paragraph, section, table
from precision_pin.render.scene import Chapter, Layer, Scene, rounded
from precision_pin.render.tables import symbol

_MOST_LETTERS: Final = 16  # of a name on the axis
_MOST_LEVEL: Final = 36  # letters of all names together without rotated labels
_LIMIT_DASHES: Final = (0, (6, 1.5, 1.2, 1.5))


def figure(result: PathResult) -> Figure:
    """Return the figure, 174 mm wide: position next to attitude."""
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
    places, marker = mark_poses(axes, result.poses, _MOST_LETTERS, _MOST_LEVEL)
    band, curve = result.band[norm] * unit.per_si, result.curve[norm] * unit.per_si
    low, high = result.curve_interval[:, norm] * unit.per_si
    axes.fill_between(places, 0.0, band, color=SKY, alpha=0.2, linewidth=0)
    axes.plot(places, band, color=PURPLE, linestyle="--", label=f"{share} of robots along the whole path")
    axes.fill_between(places, low, high, color=BLUE, alpha=0.35, linewidth=0)
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
    # room for the markers of single poses
    room = 0.03 * float(np.ptp(places)) if marker else 0.0
    axes.set_xlim(float(places.min()) - room, (float(places.max()) + room) if np.ptp(places) > 0 else None)


def path_chapter(result: PathResult) -> Chapter:
    """Return the path as a chapter."""
    share = f"{100 * result.probability:.6g} %"
    picture = inline_figure(
        figure(result),
        "path",
        f"Errors along a path of {len(result.poses):,} poses: {headline(result)}",
        "The quantile at each pose, and the band that holds the whole error curve of that share of the robots or more.",
    )
    maxima, listed = maximum_rows(result), pose_rows(result)
    poses = f"The largest errors of the path at {len(listed) - 1} of its poses"
    note = f"|d|, |δ|: {share} quantile at the pose; largest here: share of robots with their largest error of the path there."
    said = items([headline(result), where_line(result), *verdict_lines(result), *band_lines(result)])
    tables = table("Largest error of the path", maxima[0], maxima[1:]), table(poses, listed[0], listed[1:])
    content = section("path", "Path", said, picture, *tables, paragraph(note, class_="note"))
    answers = tuple(f"Along the path: {line}" for line in (headline(result), *verdict_lines(result)))
    return Chapter("path", "Path", content, answers)


# largest initial radius of the outer tube, in lengths of the arm
_WIDEST: Final = 0.025


@dataclass(frozen=True, eq=False)
class PathLayer(Layer):
    """Layer of a path and its band, with the colours of the quantile of |d| at each pose."""

    result: PathResult
    scale: ColourScale
    name: str = "path"

    @classmethod
    def of(cls, result: PathResult, *_: object) -> PathLayer:
        """Return the layer of a path."""
        sizes = result.curve[0]
        # the quantiles are sampled: a narrower scale would only colour their scatter
        # largest lower end of the colour scale, as a fraction of its upper end
        return cls(result, ColourScale.of(np.append(sizes, min(sizes.min(), 0.9 * sizes.max()))))

    def draw(self, scene: Scene, length: float) -> None:
        """Add the line of the nominal path; the page's scripts add the tubes, which depend on the magnification."""
        del length
        points = self.result.poses.position
        scene.segments(("path", "line"), np.repeat(points, 2, axis=1)[:, 1:-1], (0.1, 0.1, 0.1, 1.0))

    def settings(self, length: float) -> dict[str, Any]:
        """Return points (m), radii of both tubes (m), ends of the colour scale and the worst point.

        ``times`` is the initial magnification of the radii: errors of whole robots would fill the view.
        """
        result = self.result
        widest = float(result.band[0].max())
        return {
            "times": round_number(_WIDEST * length / widest) if widest > 0 else 1.0,
            "points": rounded(result.poses.position.T.ravel()),
            "band": rounded(result.band[0]),
            "quantile": rounded(result.curve[0]),
            "colours": [self.scale.smallest, self.scale.largest],
            "worst": result.worst_pose(0),
        }

    def legend(self) -> str:
        """Return the section of the legend: the answer, the colours, and the meaning of the tubes."""
        result = self.result
        share = f"{100 * result.probability:.6g} %"
        value, interval = quantile_text(result, 0, result.probability, most=6)
        label = result.poses.labels[result.worst_pose(0)]
        answer = (
            f"{share} of robots stay within {value} mm all along the path of {len(result.poses):,} points, "
            f"interval {interval} mm at {100 * result.confidence:.4g} % confidence; most have their largest error at {label}"
        )
        words = f"inner tube: {share} of robots at each point; outer tube: {share} or more along the whole path; cone: {label}"
        return (
            f'<section aria-label="Path"><h2>Path: {share} of robots within |d|, {self.scale.unit.name}</h2>'
            f'<p id="path-answer">{escaped(answer)}</p>{self.scale.bar()}'
            '<ul class="legend controls"><li><label><input type="checkbox" id="show-path" checked>'
            f'<i class="line"></i><span>{escaped(words)}</span></label></li></ul>'
            '<p class="fine">The radii of the tubes are drawn at <span id="path-times"></span> times their size.</p></section>'
        )
