"""A path in the scene: its line, and about each point the errors that most robots keep within, drawn as a tube."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from precision_pin.analyses.path.path_result import PathResult
from precision_pin.base.arrays import Array
from precision_pin.render.colour_scale import ColourScale, round_number
from precision_pin.render.notebook import escaped
from precision_pin.render.scene import Scene
from precision_pin.statistics.digits import format_inside, format_interval

# largest lower end of the colours, of their upper end
_LEAST_SPAN: Final = 0.9
# largest radius of the outer tube at first, in lengths of the arm
_WIDEST: Final = 0.025


@final
@dataclass(frozen=True, eq=False)
class PathLayer:
    """A path and its band.

    Attributes:
        result: Law of the errors along the path.
        scale: Colours of the quantile of |d| at each pose.
    """

    result: PathResult
    scale: ColourScale

    @classmethod
    def of(cls, result: PathResult) -> PathLayer:
        """Return the layer of a path."""
        sizes = result.curve[0]
        # the quantiles are sampled: a scale of less than their scatter would colour nothing else
        return cls(result, ColourScale.of(np.append(sizes, min(sizes.min(), _LEAST_SPAN * sizes.max()))))

    @property
    def name(self) -> str:
        """Name of the layer."""
        return "path"

    def draw(self, scene: Scene, length: float) -> None:
        """Add the line of the nominal path; the scripts add the tubes, which the factor widens."""
        del length
        points = self.result.poses.position
        scene.segments(("path", "line"), np.repeat(points, 2, axis=1)[:, 1:-1], (0.1, 0.1, 0.1, 1.0))

    def settings(self, length: float) -> dict[str, Any]:
        """Return the points, m by x, y, z, the radii of both tubes, m, the colours' ends and the worst point.

        ``times`` is how many times too large the radii are drawn at first: errors of whole robots would fill the picture.
        """
        result = self.result
        widest = float(result.band[0].max())
        return {
            "times": round_number(_WIDEST * length / widest) if widest > 0 else 1.0,
            "points": _rounded(result.poses.position.T.ravel()),
            "band": _rounded(result.band[0]),
            "quantile": _rounded(result.curve[0]),
            "colours": [self.scale.smallest, self.scale.largest],
            "worst": result.worst_pose(0),
        }

    def legend(self) -> str:
        """Return the section of the legend: the answer, the colours, and what the tubes are."""
        result = self.result
        share = f"{100 * result.probability:.6g} %"
        largest = result.maximum_quantile(0, result.probability)
        label = result.poses.labels[result.worst_pose(0)]
        assert largest.value is not None
        assert largest.interval is not None
        low, high = format_interval(*largest.interval, 1e3)
        value = format_inside(1e3 * largest.value, (1e3 * largest.interval[0], 1e3 * largest.interval[1]))
        answer = (
            f"{share} of robots stay within {value} mm all along the path of {len(result.poses):,} points, "
            f"interval {low} to {high} mm at {100 * result.confidence:.4g} % confidence; most have their largest error at {label}"
        )
        words = f"inner tube: {share} of robots at each point; outer tube: {share} or more along the whole path; cone: {label}"
        return (
            f'<section aria-label="Path"><h2>Path: {share} of robots within |d|, {self.scale.unit.name}</h2>'
            f'<p id="path-answer">{escaped(answer)}</p>{self.scale.bar()}'
            '<ul class="legend controls"><li><label><input type="checkbox" id="show-path" checked>'
            f'<i class="line"></i><span>{escaped(words)}</span></label></li></ul>'
            '<p class="fine">The radii of the tubes are drawn at <span id="path-times"></span> times their size.</p></section>'
        )


def _rounded(values: Array) -> list[float]:
    """Return numbers with the digits that a picture can show."""
    return [float(f"{value:.7g}") for value in values]
