"""Where in its workspace an arm still errs after a calibration, and by how much it was off there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from precision_pin.analyses.calibration.calibrate import CalibrationResult
from precision_pin.analyses.calibration.design import UnitNumbers
from precision_pin.analyses.calibration.forecast import errors_left
from precision_pin.analyses.pose_layout import draw_field, layout_of
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, visible
from precision_pin.render import figure_style
from precision_pin.render.draw_distribution import BLACK, BLUE, VERMILION
from precision_pin.render.tables import count_poses, milli
from precision_pin.robot.pose_set import PoseSet

_HEIGHT: Final = 80.0
"""Height of the axes, mm."""
_MOST_ARROWS: Final = 100
"""Arrows of readings; more of these would hide the map."""
_MANY: Final = 150
"""Places from which not each has an arrow."""
_ARROW: Final = 0.12
"""Length of the longest arrow, in widths of the map."""


@dataclass(frozen=True, eq=False)
class RemainingError:
    """The error of a calibrated arm at the poses of a grid: base axes, m, first order, normal; NaN where no pose is known.

    Attributes:
        poses: P poses.
        found: What the calibration found the nominal tip to be off by, so what compensation takes away, ``(3, P)``.
        rms, quantile: Of |d| that is left, rms and 95 %, ``(P,)``; as the instrument sees it.
        read, left_out: Tip at the poses of the R readings with weight, and the position's error when each is left out of the
            fit, ``(3, R)``; no errors where readings are not places.
    """

    poses: PoseSet
    found: Array
    rms: Array
    quantile: Array
    read: Array
    left_out: Array

    @classmethod
    def of(cls, result: CalibrationResult, poses: PoseSet) -> RemainingError:
        """Return the error left by a calibration; raise if no pose is known."""
        known = np.flatnonzero(poses.known)
        if not known.size:
            raise InputError("no place of the grid can be reached")
        q, model, data = np.ascontiguousarray(poses.q[:, known]), result.fitted, result.data
        unit, tasks = UnitNumbers.of(model.space), [("", at) for at in model.at_columns(q)]
        fitted = model.space.mean.copy()
        fitted[unit.columns] = list(result.posterior.mean.values())
        entries = errors_left(
            *(tasks, unit, result.estimator, result.measurement, model.space),
            fitted=(fitted, result.nuisances),
            is_sampled=False,
        )
        which = "seen" if result.measurement.sees_apart else "after"
        found, (rms, quantile) = np.full((3, len(poses)), np.nan), np.full((2, len(poses)), np.nan)
        x = result.components[:, None]
        found[:, known] = np.array([at.exact(x)[:3, 0] for at in result.original.at_columns(q)]).T
        rms[known] = [entry.rms(which) for entry in entries]
        quantile[known] = [entry.quantile(which) for entry in entries]
        weighted = np.setdiff1d(np.arange(len(data)), [error.reading for error in result.gross_errors])
        read = model.chain.at_columns(np.ascontiguousarray(data.q[:, weighted])).pose[:3, 3]
        is_place = all(part.kind in ("position", "pose") for part in data.measurements)
        left_out = result.left_out[weighted, :3].T if is_place else np.zeros((3, 0))
        return cls(poses, found, rms, quantile, read, left_out)

    def __str__(self) -> str:
        worst = int(np.nanargmax(self.quantile))
        place = " ".join(f"{1e3 * x:.4g}" for x in self.poses.position[:, worst])
        least, most = (milli(float(choose(self.quantile)), 3) for choose in (np.nanmin, np.nanmax))
        return (
            f"map of {count_poses(int(np.isfinite(self.quantile).sum()))}: 95 % of |d| left {least} to {most} mm, most at "
            f"{place} mm; the nominal arm is {milli(float(np.sqrt(np.nanmean((self.found**2).sum(axis=0)))), 3)} mm rms off there"
        )


def remaining_figure(result: CalibrationResult, left: RemainingError) -> Figure:
    """Return the map of what the calibration found (left) and of what it leaves (right) with the poses read, 174 mm wide."""
    nodes = left.poses.best_and_worst(left.quantile)[1]
    firsts = (
        np.unique(left.poses.node, return_index=True)[1] if left.poses.node is not None else np.arange(len(left.rms))
    )
    nodes = np.where(nodes >= 0, nodes, firsts)
    layout = layout_of(left.poses, nodes)
    found = np.linalg.norm(left.found, axis=0)
    panels = [
        ("found in the nominal arm, and corrected", found[nodes], "|mean| [mm]"),
        ("left by the calibration", left.quantile[nodes], "95 % of |d| [mm]"),
    ]
    with figure_style.style():
        chart = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        is_field = layout.kind in ("plane", "space")
        if is_field:
            # panels with equal axes leave room next to them: close the gap, together with their bars
            chart.set_layout_engine("compressed")
        subplots: dict[str, Any] = {"projection": "3d"} if layout.kind == "space" else {}
        both = chart.subplots(1, 2, subplot_kw=subplots)
        for axes, (title, values, label) in zip(both, panels, strict=True):
            axes.set_title(title)
            if is_field:
                draw_field(chart, axes, layout, 1e3 * values, label)
            else:
                axes.plot(layout.places[0] * (1e3 if layout.axes.size else 1), 1e3 * values, ".-", color=BLUE)
                axes.set(xlabel=layout.names[0], ylabel=label)
                axes.set_ylim(bottom=0)
        note = ""
        if layout.kind == "plane":
            # of many places every second in each direction
            ranks = [np.unique(row.round(6), return_inverse=True)[1] for row in layout.places]
            spaced = np.flatnonzero(np.all([rank % (1 + (nodes.size > _MANY)) == 0 for rank in ranks], axis=0))
            _arrows(both[0], layout.places[:, spaced], layout.axes @ left.found[:, nodes[spaced]], BLACK)
            read, errors = layout.axes @ left.read, layout.axes @ left.left_out
            are_many = read.shape[1] > _MOST_ARROWS
            mark, size = (".", 2) if are_many else ("+", 4)
            both[1].plot(*1e3 * read, mark, color=VERMILION, markersize=size, label="poses that were read, projected")
            drawn = np.sort(np.argsort(-np.linalg.norm(errors, axis=0), kind="stable")[:_MOST_ARROWS])
            longest = _arrows(both[1], read[:, drawn], errors[:, drawn], VERMILION)
            if longest:
                which = f"the {_MOST_ARROWS} largest of " * are_many
                note = f"; arrows: {which}readings less predictions of fits without them, the longest {milli(longest, 3)} mm"
        robot = visible(result.provenance.robot, 60)
        caption = f"first order, normal; {left}{note}"
        figure_style.frame(chart, both.tolist(), f"{robot} before and after its calibration", caption, _HEIGHT, 2)
    return chart


def _arrows(axes: Any, places: Array, errors: Array, colour: str) -> float:
    """Draw errors ``(2, N)``, m, at places, the longest with a set length, which is returned, m; 0 if there are none."""
    sizes = np.linalg.norm(errors, axis=0)
    is_drawn = np.isfinite(sizes) & (sizes > 0)
    if not is_drawn.any():
        return 0.0
    longest = float(sizes[is_drawn].max())
    low, high = axes.get_xlim()
    scale = longest / (_ARROW * (high - low))
    axes.quiver(
        *1e3 * places[:, is_drawn], *errors[:, is_drawn], color=colour, angles="xy", scale_units="xy", scale=scale,
        width=0.003,
    )  # fmt: skip
    return longest
