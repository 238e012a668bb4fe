"""A compensation in pictures, report and view: the error over the poses, before and after."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from precision_pin.analyses.compensation.compensate import CompensationResult
from precision_pin.analyses.compensation.table import EXPLANATION, headline, joint_rows, pose_rows, setting_lines
from precision_pin.analyses.pose_axis import mark_poses
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import visible
from precision_pin.base.written_units import WrittenUnit
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import Part, PoseModel
from precision_pin.render import figure_style
from precision_pin.render.display_units import round_number
from precision_pin.render.draw_distribution import BLUE, VERMILION
from precision_pin.render.figure_style import inline_figure
from precision_pin.render.html import escaped, items, paragraph, section, table
from precision_pin.render.scene import Chapter, Layer, Scene, rounded
from precision_pin.render.tables import count_poses, symbol
from precision_pin.robot.chain import Posture

_MOST_LETTERS: Final = 18  # of a name on the axis
_MOST_LEVEL: Final = 40  # letters of all names together without rotated labels


def figure(result: CompensationResult) -> Figure:
    """Return the figure, 174 mm wide: position next to attitude."""
    with figure_style.style():
        chart = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        panels = chart.subplots(1, 2)
        for norm, axes in enumerate(panels):
            _draw(axes, result, norm)
        goal = "position" if result.mode == "position" else "position and attitude"
        title = f"{goal} corrected: {visible(result.provenance.robot, 60)} at {count_poses(len(result.poses))}"
        caption = "mean: error with every component at its mean; 95 %: quantile of a normal law, first order"
        figure_style.frame(chart, panels, title, caption, 75.0)
    return chart


def _draw(axes: Axes, result: CompensationResult, norm: int) -> None:
    part = slice(3 * norm, 3 * norm + 3)
    quantity = ("position.norm", "attitude.norm")[norm]
    correction = result.correction
    sizes_before = np.linalg.norm(correction.before[part], axis=0)
    sizes_after = np.linalg.norm(correction.after[part], axis=0)
    unit = WrittenUnit.of_axis(quantity, float(np.nanmax(result.within_before[norm])))
    places, marker = mark_poses(axes, result.poses, _MOST_LETTERS, _MOST_LEVEL)
    curves = (
        (sizes_before, VERMILION, "-", "o", "mean before"),
        (result.within_before[norm], VERMILION, "--", "^", "95 % of robots before"),
        (sizes_after, BLUE, "-", "o", "mean after"),
        (result.within_after[norm], BLUE, "--", "^", "95 % of robots after"),
    )
    # only poses of one motion are joined
    is_path = result.poses.times is not None
    for values, colour, dashes, mark, label in curves:
        line_style: Any = {"linestyle": dashes if is_path else "none", "marker": mark if marker or not is_path else ""}
        axes.plot(places, values * unit.per_si, color=colour, markersize=2.5, label=label, **line_style)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(f"{symbol(quantity)} [{unit.name}]")
    if marker and result.poses.times is None:
        axes.set_xlim(0.5, len(places) + 0.5)


def compensation_chapter(result: CompensationResult) -> Chapter:
    """Return the compensation of a model as a chapter."""
    lines, rows, joints = headline(result), pose_rows(result), joint_rows(result)
    picture = inline_figure(
        figure(result),
        "compensation",
        f"Errors at {len(result.poses):,} poses before and after the correction: {lines[0]}",
        "The error with every component at its mean, and the 95 % quantile of a normal law, first order, before and after.",
    )
    notes = [paragraph(line, class_="note") for line in (EXPLANATION, setting_lines(result)[1])]
    caption_ = (
        "The poses" if len(rows) > len(result.poses) else f"The worst {len(rows) - 1} of {len(result.poses):,} poses"
    )
    tables = [table("Corrected joint values", joints[0], joints[1:])] if len(joints) > 1 else []
    tables.append(table(caption_, rows[0], rows[1:]))
    content = section("compensation", "Compensation", items(lines), picture, *tables, *notes)
    answers = tuple(f"Compensation: {line}" for line in lines)
    return Chapter("compensation", "Compensation", content, answers)


_GREEN: Final = "#009e73"
_LARGEST: Final = 0.12
"""Initial size of the largest displacement, in lengths of the arm."""
_LINES: Final = (
    ("deflected", VERMILION, 1.0, "deflected: at the joint values asked for, with its mean errors"),
    ("commanded", _GREEN, 0.8, "commanded: at the corrected joint values, without errors"),
    ("corrected", BLUE, 1.2, "corrected: at the corrected joint values, with its mean errors"),
)


@dataclass(frozen=True, eq=False)
class CompensationLayer(Layer):
    """Layer of a compensation.

    Attributes:
        worst: The corrected pose with the largest error before; ``None`` if no pose is corrected.
        nominal: Base, joints and tip of the arm without error there, m, ``(3, K)``.
        arms: Displacements from there of the deflected, the commanded (without errors) and the corrected arm, ``(3, 3,
            K)``.
        commanded: Displacement of the tip without errors at each pose, at the corrected joint values, m, ``(3, P)``.
    """

    result: CompensationResult
    worst: int | None
    nominal: Array
    arms: Array
    commanded: Array
    name: str = "compensation"

    @classmethod
    def of(cls, result: CompensationResult, error_model: ErrorModel) -> CompensationLayer:
        """Return the layer of a compensation of this model."""
        correction, poses = result.correction, result.poses
        k = np.flatnonzero([status == "corrected" for status in correction.status])
        commanded = np.full((3, len(poses)), np.nan)
        if not k.size:
            return cls(result, None, np.empty((3, 0)), np.empty((3, 3, 0)), commanded)
        commanded[:, k] = error_model.chain.at_columns(correction.q[:, k]).pose[:3, 3] - poses.position[:, k]
        worst = int(k[np.linalg.norm(correction.before[:3, k], axis=0).argmax()])
        sides = None if poses.approaches is None else poses.approaches[:, [worst, worst]]
        before, after = error_model.at_columns(np.stack([poses.q[:, worst], correction.q[:, worst]], axis=1), sides)
        nominal = _joints(before.posture)
        arms = np.stack([_displaced_arm(before), _joints(after.posture), _displaced_arm(after)]) - nominal
        return cls(result, worst, nominal, arms, commanded)

    def draw(self, scene: Scene, length: float) -> None:
        """Add the intended path of the tip, and the arm without error at the worst pose, as thin lines."""
        del length
        for name, points in (("wanted", self._points(self.result.poses.position)), ("nominal", self.nominal)):
            scene.segments((self.name, name), np.repeat(points, 2, axis=1)[:, 1:-1], (0.1, 0.1, 0.1, 1.0))

    def settings(self, length: float) -> dict[str, Any]:
        """Return the lines, points and displacements by x, y, z in m, and their initial magnification."""
        if self.worst is None:
            return {"times": 1.0, "lines": []}
        correction, targets = self.result.correction, self.result.poses.position
        moves = {"deflected": correction.before[:3], "commanded": self.commanded, "corrected": correction.after[:3]}
        lines = []
        for (name, colour, share, _), arm in zip(_LINES, self.arms, strict=True):
            # radius of the arms' rods, in lengths of the arm; corrected is the thickest, to be visible where all
            # coincide
            lines.append(_line(colour, share * 0.005 * length, self.nominal, arm))
            lines.append(_line(colour, 0.0, self._points(targets), self._points(moves[name])))
        largest = float(np.linalg.norm(self.arms, axis=1).max())
        return {"times": round_number(_LARGEST * length / largest) if largest > 0 else 1.0, "lines": lines}

    def legend(self) -> str:
        """Return the section of the legend: the answer, the colours, and the magnification."""
        text = "".join(f"<p>{escaped(line[:1].upper() + line[1:])}</p>" for line in headline(self.result))
        place = "" if self.worst is None else f" at {self.result.poses.labels[self.worst]}"
        swatches = "".join(
            f'<li class="row"><i class="line" style="background-image: linear-gradient({to_hex(colour)}, {to_hex(colour)})"></i>'
            f"<span>{escaped(label)}</span></li>"
            for _, colour, _, label in _LINES
        )
        return (
            f'<section aria-label="Compensation"><h2>Compensation</h2>{text}<ul class="legend controls"><li><label>'
            '<input type="checkbox" id="show-compensation" checked><i class="line"></i>'
            f"<span>{escaped(f'arm without error{place}, and way of its tip')}</span></label></li>{swatches}</ul>"
            '<p class="fine">Displacements are drawn at <span id="compensation-times"></span> times their size.</p></section>'
        )

    def _points(self, points: Array) -> Array:
        return points[:, np.isfinite(self.commanded).all(axis=0)]


def _joints(posture: Posture) -> Array:
    """Return base, joints and tip, ``(3, K)``."""
    return np.column_stack([posture.link_poses[:, :3, 3].T, posture.pose[:3, 3]])


def _displaced_arm(at: PoseModel) -> Array:
    """Return base, joints and tip of the arm with every component at its mean, ``(3, K)``.

    The displacements E of the targets before a point, in their frames T, move it by Π T E T⁻¹.
    """
    table = at.table
    moves = table.displacements(table.products(table.program.evaluate(at.space.mean[:, None])))[:, :, 0]
    motions = [np.eye(4)]
    for frame, move in zip(table.frames, moves, strict=True):
        error_pose = se3.pose(se3.exp_rotation(move[3:]), move[:3])
        motions.append(motions[-1] @ frame @ error_pose @ np.linalg.inv(frame))
    points = _joints(at.posture)
    last = points.shape[1] - 1
    places = [Part("", link, np.eye(4), 0 if link < last else None) for link in range(last + 1)]
    points_ = [motions[place.targets_before(table.targets)] @ [*points[:, place.link], 1.0] for place in places]
    return np.column_stack(points_)[:3]


def _line(colour: str, radius: float, points: Array, moves: Array) -> dict[str, Any]:
    numbers = {key: rounded(values.T.ravel()) for key, values in (("points", points), ("moves", moves))}
    return {"colour": to_hex(colour), "radius": radius, **numbers}
