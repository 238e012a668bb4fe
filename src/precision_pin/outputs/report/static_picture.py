"""A plain picture of the arm and its cloud of errors, for paper and for readers without scripts."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import NDArray

from precision_pin.outputs.kit.draw_distribution import BLACK, BLUE, GREEN, SKY, VERMILION
from precision_pin.outputs.kit.figure_style import labelled, legend_below, new_figure, set_height, style
from precision_pin.outputs.report.collect import Results
from precision_pin.outputs.view.scales import arm_length, default_factor
from precision_pin.robot.chain import Posture

__all__ = ["cloud_factor", "sketch"]

_WIDTH: Final = 130.0
_HEIGHT: Final = 112.0
_POINTS: Final = 600
_AXIS: Final = 0.12


def cloud_factor(results: Results) -> float:
    """Return by how much the errors are drawn too large."""
    return default_factor(results.cloud[:3], results.at.posture)


def sketch(results: Results) -> Figure:
    """Return the arm as rods between its joints, the frame of its tip, and the cloud of sampled positions, 130 mm wide."""
    posture = results.at.posture
    factor = cloud_factor(results)
    points = np.vstack([posture.link_poses[:, :3, 3], posture.pose[:3, 3]])
    cloud = posture.pose[:3, 3, None] + factor * results.cloud[:3, :_POINTS]
    with style():
        drawn = new_figure(_WIDTH)
        axes = drawn.add_subplot(projection="3d")
        axes.plot(*points.T, color=BLUE, linewidth=2.6, marker="o", markersize=4, label="arm, joints as dots")
        axes.plot(
            *cloud, linestyle="none", marker=".", markersize=2, color=SKY, label=f"sampled positions, ×{factor:g}"
        )
        _frame(axes, posture)
        _set_limits(axes, np.hstack([points.T, cloud]))
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
        axes.set_zlabel("z [m]")
        axes.set_box_aspect((1, 1, 1))
        axes.view_init(elev=22, azim=_azimuth(posture))
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
            axis.line.set_color(BLACK)
        legend_below(drawn, labelled([axes]), 2)
        set_height(drawn, _HEIGHT)
    return drawn


def _frame(axes: Axes3D, posture: Posture) -> None:
    """Draw the axes of the tip: x, y, z in vermilion, green, blue."""
    start, length = posture.pose[:3, 3], _AXIS * arm_length(posture)
    for column, colour in enumerate((VERMILION, GREEN, BLUE)):
        end = start + length * posture.pose[:3, column]
        axes.plot(*np.stack([start, end]).T, color=colour, linewidth=1.4)


def _set_limits(axes: Axes3D, points: NDArray[np.float64]) -> None:
    """Show all points ``(3, N)`` at one scale."""
    low, high = points.min(axis=1), points.max(axis=1)
    middle, half = (low + high) / 2, 0.55 * float((high - low).max()) or 0.5
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_zlim(middle[2] - half, middle[2] + half)


def _azimuth(posture: Posture) -> float:
    """Return the viewing direction in degrees: across the plane in which the arm stretches."""
    way = posture.pose[:2, 3] - posture.link_poses[0, :2, 3]
    return float(np.degrees(np.arctan2(way[1], way[0]))) - 65.0
