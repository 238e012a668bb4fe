"""Picture of the arm with the cloud of its sampled errors, for pages without scripts and for paper.

Triangles become an image by parallel projection, hidden surfaces by depth, and flat shading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.pages.view.arm import draw_arm
from precision_pin.pages.view.scales import arm_length, joint_points
from precision_pin.render.draw_distribution import BLACK, BLUE, GREEN, VERMILION
from precision_pin.render.figure_style import new_figure, set_height, style
from precision_pin.render.scene import Triangles
from precision_pin.robot.chain import Posture

WIDTH: Final = 100.0
"""Width of the picture, mm."""

_PIXELS: Final = 760
_AZIMUTHS: Final = 24
# fractions of the arm's extent in the picture: the cloud with the line to it, a limit at most, and the least size left
# for the cloud
_CLOUD: Final = 0.27
_LIMIT: Final = 0.36
_SMALLEST: Final = 0.08


@dataclass(frozen=True, eq=False)
class Cloud:
    """The cloud and circles drawn about the tip.

    Attributes:
        errors: Sampled position errors ``(3, N)``, m, base axes.
        within: Distance from ``middle`` that holds 95 % of them, m, if resolved.
        limit, is_met: Limit of their size, m, if one was given, and whether it is kept.
        middle: The error drawn at the tip, ``(3,)``, m, such as the mean. A limit has its circle about zero error only.
    """

    errors: Array
    within: float | None = None
    limit: float | None = None
    is_met: bool = True
    middle: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture and the facts for its caption.

    ``factor`` is the magnification of errors, ``points`` their number, ``shows_limit`` whether the limit has its circle
    (one far larger than the cloud does not).
    """

    figure: Figure
    factor: float
    points: int
    shows_limit: bool


def draw_picture(posture: Posture, cloud: Cloud, package_dirs: Sequence[Path] = ()) -> Picture:
    """Return the arm at a posture, undisplaced, with its magnified cloud of errors about the tip, 100 mm wide."""
    triangles = Triangles()
    draw_arm(triangles, posture, package_dirs)
    corners, tip = triangles.corners, posture.pose[:3, 3]
    camera = _choose_camera(posture, corners)
    skeleton = camera.project(joint_points(posture)) - camera.project(tip)
    seen = camera.project(corners) - camera.project(tip)
    arm = _arm_frame(skeleton, seen)
    drawn = camera.project(cloud.errors[:, :700].T - np.array(cloud.middle))[:, :2]
    factor, shows_limit = _choose_factor(cloud, drawn, float(np.ptp(arm, axis=0).max()))
    radius = max(cloud.within or 0.0, (shows_limit and cloud.limit) or 0.0)
    frame = _whole_frame(arm, factor * drawn, factor * radius)
    (left, bottom), (right, top) = frame.tolist()
    size = (right - left) / _PIXELS
    shape = (max(1, round((top - bottom) / size)), _PIXELS)
    image = draw_triangles(seen, triangles.colours, frame[0], size, shape)
    with style():
        figure = new_figure(WIDTH)
        figure.set_layout_engine("none")
        set_height(figure, WIDTH * shape[0] / shape[1])
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.imshow(image, extent=(left, right, bottom, top), interpolation="none", aspect="auto")
        _draw_cloud(axes, cloud, drawn, factor, shows_limit)
        _draw_scale(axes, frame, factor)
        _draw_base(axes, frame, camera)
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
    return Picture(figure, factor, len(drawn), shows_limit)


# camera and frame ----------------------------------------------------------------------------


def _choose_camera(posture: Posture, corners: Array) -> Camera:
    """Return the camera that shows the arm widest with the least of it in front of the tip."""
    points = joint_points(posture)
    near = _CLOUD / 2 * arm_length(posture)
    sample = corners[:: max(1, len(corners) // 4000), 0] if len(corners) else points

    def rate(camera: Camera) -> float:
        lengths = np.linalg.norm(np.diff(camera.project(points)[:, :2], axis=0), axis=1).sum() / arm_length(posture)
        relative = camera.project(sample) - camera.project(points[-1])
        about = np.linalg.norm(relative[:, :2], axis=1) < near
        hiding = float((about & (relative[:, 2] > near / 4)).mean())
        return round(float(lengths) - 4 * hiding, 6)

    azimuths = 2 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS + np.pi / _AZIMUTHS
    return max((Camera(float(azimuth), math.radians(20)) for azimuth in azimuths), key=rate)


def _arm_frame(skeleton: Array, seen: Array) -> Array:
    """Return low and high corner of all that is drawn, or of the chain if the rest of the robot is far larger, ``(2, 2)``."""
    low, high = skeleton[:, :2].min(axis=0), skeleton[:, :2].max(axis=0)
    size = max(float((high - low).max()), 1e-6)
    if not len(seen):
        return np.array([low - 0.1 * size, high + 0.1 * size])
    lowest, highest = seen[:, :, :2].min(axis=(0, 1)), seen[:, :, :2].max(axis=(0, 1))
    lowest, highest = np.maximum(lowest, low - 0.4 * size), np.minimum(highest, high + 0.4 * size)
    return np.array([np.minimum(lowest, low), np.maximum(highest, high)])


def _choose_factor(cloud: Cloud, drawn: Array, extent: float) -> tuple[float, bool]:
    """Return a round magnification of errors, and whether the limit then fits."""
    points = np.vstack([drawn, np.zeros((1, 2))])
    span = float(np.ptp(np.quantile(points, [0.01, 0.99], axis=0), axis=0).max()) if len(drawn) > 1 else 0.0
    radius = max(span, float(np.linalg.norm(drawn.mean(axis=0))) if len(drawn) else 0.0)
    if radius <= 1e-15 * extent:
        return 1.0, False
    factor = _CLOUD * extent / radius
    limit = None if any(cloud.middle) else cloud.limit
    shows_limit = limit is not None
    if limit is not None and factor * limit > _LIMIT * extent:
        smaller = _LIMIT * extent / limit
        shows_limit = smaller * radius >= _SMALLEST * extent
        factor = smaller if shows_limit else factor
    return _round(factor), shows_limit


def _round(value: float) -> float:
    """Return the closest of the round numbers 1, 1.5, 2, … times a power of ten, at least 1."""
    if value <= 1:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    rounds = [power * digit for digit in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)]
    return float(f"{min(rounds, key=lambda candidate: abs(math.log(candidate / value))):.6g}")


def _whole_frame(arm: Array, drawn: Array, radius: float) -> Array:
    """Return the rectangle about arm, cloud and circles, with a margin, neither too wide nor too high."""
    around = np.array([[-radius, -radius], [radius, radius]])
    points = np.vstack([arm, drawn, around])
    low, high = points.min(axis=0), points.max(axis=0)
    if radius > 0:  # a line of text below the circle
        low[1] = min(low[1], -radius - 0.05 * float((high - low).max()))
    margin = 0.05 * float((high - low).max())
    low, high = low - margin, high + margin
    low[1] -= margin  # the scale is below
    size, middle = high - low, (low + high) / 2
    height = max(size[1], 0.78 * size[0])
    width = max(size[0], height / 1.05)
    half = np.array([width, height]) / 2
    return np.array([middle - half, middle + half])


# over the arm ---------------------------------------------------------------------------------


def _draw_cloud(axes: Axes, cloud: Cloud, drawn: Array, factor: float, shows_limit: bool) -> None:
    sizes = np.linalg.norm(cloud.errors[:, : len(drawn)], axis=0)
    outside = sizes > (math.inf if cloud.limit is None else cloud.limit)
    for chosen, colour in ((~outside, BLUE), (outside, VERMILION)):
        if chosen.any():
            axes.plot(*(factor * drawn[chosen]).T, ".", color=colour, markersize=3.0, markeredgewidth=0, alpha=0.8)
    axes.plot(0, 0, "+", color=BLACK, markersize=7, markeredgewidth=1.0, path_effects=_halo())
    height = float(np.ptp(axes.get_ylim()))
    if cloud.within is not None and cloud.within > 0:
        _draw_circle(axes, factor * cloud.within, BLACK, (0, (4, 1.5)), "95 %", 0.012 * height)
    if shows_limit and cloud.limit is not None:
        colour = GREEN if cloud.is_met else VERMILION
        _draw_circle(axes, factor * cloud.limit, colour, "-", "limit", -0.012 * height)


def _draw_circle(axes: Axes, radius: float, colour: str, dashes: object, label: str, above: float) -> None:
    line = {"edgecolor": colour, "linestyle": dashes, "linewidth": 1.2, "path_effects": _halo()}
    axes.add_patch(Circle((0, 0), radius, fill=False, **line))
    place = radius + above if above > 0 else -radius + above
    _write(axes, 0, place, label, ha="center", va="bottom" if above > 0 else "top", color=colour)


def _draw_scale(axes: Axes, frame: Array, factor: float) -> None:
    width, height = np.ptp(frame, axis=0).tolist()
    target = 0.16 * width / factor
    power = 10.0 ** math.floor(math.log10(target))
    length = max(digit * power for digit in (1, 2, 5) if digit * power <= target)
    right = float(frame[1, 0] - 0.03 * width)
    low = float(frame[0, 1] + 0.03 * height)
    left = right - factor * length
    axes.plot([left, right], [low, low], color=BLACK, linewidth=2.2, solid_capstyle="butt", path_effects=_halo())
    text = f"{1e3 * length:g} mm" if length >= 1e-4 else f"{1e6 * length:g} µm"
    _write(axes, right, low + 0.015 * height, f"{text} of error, ×{factor:g}", ha="right", va="bottom", color=BLACK)


def _draw_base(axes: Axes, frame: Array, camera: Camera) -> None:
    size = float(np.ptp(frame, axis=0).max())
    length = 0.085 * size
    directions = camera.axes[:2].T
    start = frame[0] + 0.035 * size + length * np.maximum(0.0, -directions.min(axis=0))
    # towards the viewer last
    for k in np.argsort(camera.axes[2]):
        colour, way = (VERMILION, GREEN, BLUE)[k], directions[k]
        end = start + length * way
        axes.plot(*np.stack([start, end]).T, color=colour, linewidth=1.6, path_effects=_halo())
        x, y = start + 1.22 * length * way
        _write(axes, x, y, "xyz"[k], ha="center", va="center", color=colour)


def _write(axes: Axes, x: float, y: float, text: str, *, ha: str, va: str, color: str) -> None:
    axes.text(x, y, text, ha=ha, va=va, color=color, fontsize=8, path_effects=_halo())


def _halo() -> list[withStroke]:
    return [withStroke(linewidth=2.4, foreground="white")]


# triangles as an image ----------------------------------------------------------------------------

_OVERSAMPLING: Final = 2
# direction of the light in the camera's axes: right, up, towards the viewer
_LIGHT: Final = np.array([-0.45, 0.65, 0.62])
_AMBIENT: Final = 0.42
# colours are kept away from black and white, so that the arm stands out on dark and light backgrounds
_DARKEST: Final = 0.16
_LIGHTEST: Final = 0.88


@dataclass(frozen=True)
class Camera:
    """Viewing direction (azimuth and elevation, rad) of a parallel projection with the base's z axis up."""

    azimuth: float
    elevation: float

    @property
    def axes(self) -> Array:
        """Right, up and towards the viewer in base axes, ``(3, 3)`` by rows."""
        (ca, sa), (ce, se) = ((np.cos(angle), np.sin(angle)) for angle in (self.azimuth, self.elevation))
        towards = np.array([ce * ca, ce * sa, se])
        right = np.array([-sa, ca, 0.0])
        return np.stack([right, np.cross(towards, right), towards])

    def project(self, points: Array) -> Array:
        """Return points ``(…, 3)`` in the camera's axes."""
        return points @ self.axes.T


def draw_triangles(
    corners: Array, colours: Array, low: Array, size: float, shape: tuple[int, int]
) -> NDArray[np.uint8]:
    """Return an image with transparent background, ``(rows, columns, 4)``; the same bytes for the same triangles.

    Args:
        corners: Triangles in the camera's axes, ``(F, 3, 3)``, m.
        colours: Red, green, blue from 0 to 1, ``(F, 3)``.
        low: Lower left corner of the image, ``(2,)``, m.
        size: Size of a pixel, m.
        shape: Rows and columns.
    """
    rows, columns = (_OVERSAMPLING * count for count in shape)
    step = size / _OVERSAMPLING
    points = corners.copy()
    points[:, :, :2] = (corners[:, :, :2] - low) / step
    which, depth = _nearest(points, rows, columns)
    shaded = np.vstack([_shade(corners, colours), np.zeros(3)])[which]
    extent = float(np.ptp(corners[:, :, :2], axis=(0, 1)).max()) if len(corners) else 1.0
    edges = _edges(which, depth, 0.02 * extent)
    shaded[edges] *= 0.55
    seen = (which >= 0).astype(float)
    whole = np.dstack([shaded * seen[:, :, None], seen])
    mean = whole.reshape(shape[0], _OVERSAMPLING, shape[1], _OVERSAMPLING, 4).mean(axis=(1, 3))
    mean[:, :, :3] /= np.maximum(mean[:, :, 3:], 1e-9)
    # rows from the top
    return np.rint(255 * mean[::-1]).astype(np.uint8)


def _shade(corners: Array, colours: Array) -> Array:
    """Return the colours of the triangles under one light, for either orientation of their corners."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    normals *= np.where(normals[:, 2:] < 0, -1.0, 1.0)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    bright = _AMBIENT + (1 - _AMBIENT) * np.maximum(normals @ light, 0.0)
    # in coarse steps, which are invisible and keep the file small
    return np.clip(np.rint(64 * (_DARKEST + (_LIGHTEST - _DARKEST) * colours * bright[:, None])) / 64, 0, 1)


def _nearest(points: Array, rows: int, columns: int) -> tuple[NDArray[np.int64], Array]:
    """Return the triangle closest to the viewer at each pixel (-1: none), and its depth; rows from below."""
    which = np.full(rows * columns, -1, dtype=np.int64)
    depth = np.full(rows * columns, -np.inf)
    edges = points[:, 1:] - points[:, :1]
    area = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 1, 0] * edges[:, 0, 1]
    first, count = _centres(points[:, :, 1].min(axis=1), points[:, :, 1].max(axis=1), rows)
    chosen = np.flatnonzero((count > 0) & (np.abs(area) > 1e-6))
    boxes = count[chosen] * (np.ptp(points[chosen, :, 0], axis=1) + 1)
    # limited by memory
    for batch in np.split(chosen, np.flatnonzero(np.diff(np.cumsum(boxes) // 2_000_000)) + 1):
        of, row = _spread(first[batch], count[batch])
        triangle = batch[of]
        corner, y = points[triangle], row + 0.5
        ends = []
        for start, end in ((0, 1), (1, 2), (2, 0)):
            (ax, ay), (bx, by) = corner[:, start, :2].T, corner[:, end, :2].T
            crosses = (ay <= y) != (by <= y)
            share = np.divide(y - ay, by - ay, out=np.zeros_like(y), where=crosses)
            ends.append(np.where(crosses, ax + share * (bx - ax), np.nan))
        low, high = np.fmin.reduce(ends), np.fmax.reduce(ends)
        column, width = _centres(np.nan_to_num(low, nan=1.0), np.nan_to_num(high, nan=0.0), columns)
        line, x = _spread(column, width)
        triangle = triangle[line]
        # the triangle's plane
        origin = points[triangle, 0]
        (ux, uy, uz), (vx, vy, vz) = (points[triangle, k].T - origin.T for k in (1, 2))
        dx, dy = x + 0.5 - origin[:, 0], y[line] - origin[:, 1]
        z = origin[:, 2] + ((dx * vy - dy * vx) * uz + (dy * ux - dx * uy) * vz) / area[triangle]
        at = row[line] * columns + x
        nearer = z > depth[at]
        at, z, triangle = at[nearer], z[nearer], triangle[nearer]
        # the last one written at a pixel remains: the closest
        order = np.argsort(z, kind="stable")
        depth[at[order]] = z[order]
        which[at[order]] = triangle[order]
    return which.reshape(rows, columns), depth.reshape(rows, columns)


def _centres(low: Array, high: Array, most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first pixel whose centre lies between two coordinates, and the number of such pixels."""
    first = np.clip(np.ceil(low - 0.5), 0, most).astype(np.int64)
    last = np.clip(np.floor(high - 0.5), -1, most - 1).astype(np.int64)
    return first, np.maximum(last - first + 1, 0)


def _spread(first: NDArray[np.int64], count: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the range and the number of every number in the ranges that begin at ``first``."""
    of = np.repeat(np.arange(len(count)), count)
    starts = np.cumsum(count) - count
    return of, first[of] + np.arange(len(of)) - starts[of]


def _edges(which: NDArray[np.int64], depth: Array, step: float) -> NDArray[np.bool_]:
    """Return where a surface ends before another one farther behind, or before nothing."""
    is_edge = np.zeros(which.shape, dtype=bool)
    with np.errstate(invalid="ignore"):  # nothing less nothing
        for axis in (0, 1):
            for way in (1, -1):
                behind = depth - np.roll(depth, way, axis=axis)
                is_edge |= (which >= 0) & (behind > step)
    return is_edge
