"""Places of poses in a figure: over a plane, in space, along a line or a path, or a list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.render.draw_distribution import BLACK
from precision_pin.robot.pose_set import PoseSet

MOST_NAMED: Final = 24
"""Largest number of poses drawn as a list, with their names below the axis."""
COLOURS: Final = "cividis"
_MOST_TICKS: Final = 6
"""Ticks of an axis."""
_FLAT: Final = 1e-6
"""Relative extent of the places across a plane or a line below which they count as lying in it."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Layout of poses.

    Attributes:
        kind: ``"path"``, ``"list"``, ``"plane"`` or ``"space"``.
        places: Time or number ``(1, N)``, or coordinates, m, ``(2, N)`` or ``(3, N)``.
        names: Labels of the axes.
        axes: Directions of the coordinates in the base, ``(k, 3)``; ``(0, 3)`` if they are none.
    """

    kind: str
    places: Array
    names: tuple[str, ...]
    axes: Array = field(default_factory=lambda: np.zeros((0, 3)))


def layout_of(poses: PoseSet, nodes: NDArray[np.intp]) -> Layout:
    """Return how poses are drawn; ``nodes`` are the indices of the poses to draw."""
    count = len(nodes)
    if poses.times is not None:
        return Layout("path", poses.times[None, nodes], ("time [s]",))
    position = poses.position[:, nodes]
    is_finite = np.isfinite(position).all(axis=0)
    if (poses.node is None and count <= MOST_NAMED) or is_finite.sum() < 3:
        return Layout("list", np.arange(1.0, count + 1)[None], ("pose, in the order given",))
    centred = position - position[:, is_finite].mean(axis=1, keepdims=True)
    axes, sizes, _ = np.linalg.svd(centred[:, is_finite], full_matrices=False)
    rank = int((sizes > _FLAT * max(float(sizes[0]), 1e-12)).sum())
    if rank == 1:
        direction = axes[:, 0] * np.sign(axes[np.abs(axes[:, 0]).argmax(), 0])
        return Layout("path", (direction @ position)[None], (_axis_name(direction),), direction[None])
    if rank == 2:
        normal = axes[:, 2]
        k = int(np.abs(normal).argmax())
        if np.abs(normal[k]) > 1 - 1e-9:
            axis_pair = [axis for axis in range(3) if axis != k]
            names = tuple(f"{'xyz'[axis]} [mm]" for axis in axis_pair)
            return Layout("plane", position[axis_pair], names, np.eye(3)[axis_pair])
        first, second = axes[:, 0], axes[:, 1]
        pair = np.stack([first, second])
        return Layout("plane", pair @ position, (_axis_name(first), _axis_name(second)), pair)
    return Layout("space", position, ("x [mm]", "y [mm]", "z [mm]"), np.eye(3))


def _axis_name(direction: Array) -> str:
    k = int(np.abs(direction).argmax())
    if abs(direction[k]) > 1 - 1e-9:
        return f"{'xyz'[k]} [mm]"
    return f"along ({', '.join(f'{value:.2g}' for value in direction)}) [mm]"


def draw_field(
    chart: Figure,
    axes: Any,
    layout: Layout,
    values: Array,
    label: str,
    marks: Sequence[tuple[NDArray[np.bool_], str, str]] = (),
) -> None:
    """Draw values over a plane or in space, with their bar; places without one are crosses.

    ``marks`` are places ``(N,)`` with a dot, its colour and its label.
    """
    places = 1e3 * layout.places
    is_known = np.isfinite(values)
    cells = _cells(places, values) if layout.kind == "plane" else None
    if cells is not None:
        mesh = axes.pcolormesh(*cells, cmap=COLOURS, shading="nearest", rasterized=True)
    else:
        marker, size = "s" if layout.kind == "plane" else "o", float(np.clip(6000.0 / max(len(values), 1), 4.0, 40.0))
        mesh = axes.scatter(*places[:, is_known], c=values[is_known], cmap=COLOURS, s=size, marker=marker)
    if not is_known.all():
        axes.scatter(*places[:, ~is_known], c="#999999", s=6, marker="x", linewidths=0.6, label="not reached")
    for poses, colour, name in marks:
        if poses.any():
            axes.scatter(*places[:, poses], c=colour, s=5, marker="o", linewidths=0.4, edgecolors=BLACK, label=name)
    axes.set_xlabel(layout.names[0])
    axes.set_ylabel(layout.names[1])
    axes.set_aspect("equal")
    axes.locator_params(nbins=_MOST_TICKS, steps=[1, 2, 5, 10])
    if layout.kind == "space":
        axes.set_zlabel(layout.names[2])
    chart.colorbar(mesh, ax=axes, label=label, shrink=0.85, pad=0.1 if layout.kind == "space" else 0.02)


def _cells(places: Array, values: Array) -> tuple[Array, Array, Array] | None:
    """Return coordinates and values of a regular grid, NaN in empty cells; ``None`` if the places do not form one."""
    rounded = np.round(places, 6)
    (u, i), (v, j) = (np.unique(row, return_inverse=True) for row in rounded)
    # ratio of a grid's cells to its places above which the places are drawn as points
    if len(u) < 2 or len(v) < 2 or len(u) * len(v) > 2.0 * len(values):
        return None
    field = np.full((len(v), len(u)), np.nan)
    field[j, i] = values
    return u, v, np.ma.masked_invalid(field)
