"""Terminal table of a compensation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from precision_pin.analyses.compensation.compensate import CompensationResult
from precision_pin.base.errors import shortened, shown, some, visible
from precision_pin.base.files import csv_text
from precision_pin.render.text_table import aligned, limited, remainder
from precision_pin.robot.joint_columns import Column, joint_columns

_MOST_ROWS: Final = 20  # poses listed, the largest errors first
_MOST_NAMED: Final = 3  # poses without a correction named in a sentence
_MOST_LETTERS: Final = 16  # of a name in a table row
_MOST_OF_JOINT: Final = 40  # letters of a joint name with a single pose
_DECIMALS: Final = 4  # of corrected joint values
EXPLANATION: Final = (
    "first: what one step with the nominal Jacobian leaves; 95 %: quantile of |d| in mm of a normal law, first order"
)
_ZERO: Final = 1e-9
"""Errors (m and rad) below which nothing needs correction."""
_CORRECTED: Final = {"position": "position", "pose": "position and attitude"}
_REASONS: Final = {
    "limit": "no correction was found near the pose within the joint limits, which does not show that there is none",
    "singular": "near a singularity, where not every direction can be corrected, or only with another branch of the arm",
    "unreachable": "no joint values found, which does not show that there are none",
}


def compensation_table(result: CompensationResult) -> str:
    """Return the errors after the correction: the worst pose as text, then a row for each pose, mm and mrad."""
    rows, joints = pose_rows(result), joint_rows(result)
    lines = [*headline(result), "", *setting_lines(result), ""]
    lines += ["corrected joint values", *aligned(joints), ""] if len(joints) > 1 else []
    lines += aligned(rows)
    lines += remainder(len(result.poses) - len(rows) + 1, "poses")
    lines += [f"{reason}: {text}" for reason, text in _REASONS.items() if reason in result.correction.status]
    run = result.provenance
    lines += ["", EXPLANATION, *run.resting_lines]
    return "\n".join(lines)


def setting_lines(result: CompensationResult) -> list[str]:
    """Return the robot, the number of poses, and what was corrected."""
    run = result.provenance
    target = _CORRECTED[result.mode] if result.weights is None else "weighted position and attitude"
    count = len(result.poses)
    poses = f"{count:,} pose{'s' if count > 1 else ''}"
    return [
        f"{visible(run.arm)}, {poses}, {target} corrected",
        f"error with every component at its mean, exact model, statics {run.statics}; base axes",
    ]


def headline(result: CompensationResult) -> list[str]:
    """Return the largest errors before and after, and the number of poses without correction."""
    solution = result.correction
    is_known = np.array(solution.status) == "corrected"
    if not is_known.any():
        return [f"no pose has a correction: {', '.join(dict.fromkeys(solution.status))}"]
    names = result.poses.labels
    lines = []
    for letter, part, unit in (("|d|", slice(0, 3), "mm"), ("|δ|", slice(3, 6), "mrad")):
        before, after = (
            np.where(is_known, np.linalg.norm(error[part], axis=0), -1.0) for error in (solution.before, solution.after)
        )
        worst = int(before.argmax())
        lines.append(
            f"{letter} at the means: from {1e3 * before[worst]:.4g} {unit} at worst ({shown(names[worst])}) "
            f"to {_text(after.max())} {unit} at worst"
        )
    before, after = (np.where(is_known, spread[0], -1.0) for spread in (result.within_before, result.within_after))
    lines.append(
        f"95 % quantile of |d| of a normal law, first order: {1e3 * before.max():.4g} mm at the worst pose before, "
        f"{1e3 * after.max():.4g} mm after; not sampled"
    )
    uncorrected = uncorrected_poses(result)
    lines += [
        f"{len(uncorrected):,} of {len(names):,} poses have no correction: {some(uncorrected, _MOST_NAMED)}"
    ] * bool(uncorrected)
    return lines


def uncorrected_poses(result: CompensationResult) -> list[str]:
    """Return the poses without a correction, each with its status."""
    pairs = zip(result.poses.labels, result.correction.status, strict=True)
    return [f"{shown(label)} ({status})" for label, status in pairs if status != "corrected"]


def _list_poses(result: CompensationResult) -> list[int]:
    """Return the poses of the rows: of many, those without a correction first."""
    poses, most = list(range(len(result.poses))), limited(_MOST_ROWS)
    if most is None or len(poses) <= most:
        return poses
    size = np.linalg.norm(result.correction.before[:3], axis=0)
    status = result.correction.status
    return sorted(poses, key=lambda pose: (status[pose] == "corrected", -np.nan_to_num(size[pose])))[:most]


def pose_rows(result: CompensationResult) -> list[list[str]]:
    """Return a header and a row for each pose, mm and mrad: of many, those without a correction, then the worst."""
    header = ["pose", "|d| mm", "first", "after", "|δ| mrad", "after", "95 %", "after", "what remains", "status"]
    fix, labels = result.correction, result.poses.labels
    position, attitude = slice(0, 3), slice(3, 6)
    parts = [(error, position) for error in (fix.before, fix.first_order, fix.after)]
    parts += [(error, attitude) for error in (fix.before, fix.after)]
    rows = [header]
    for pose in _list_poses(result):
        sizes = [float(np.linalg.norm(error[part, pose])) for error, part in parts]
        sizes += [float(quantiles[0, pose]) for quantiles in (result.within_before, result.within_after)]
        source = shortened(visible(result.dominant_source[pose]), _MOST_LETTERS) or "-"
        rows.append([shortened(visible(labels[pose]), _MOST_LETTERS), *map(_text, sizes), source, fix.status[pose]])
    return rows


def joint_rows(result: CompensationResult) -> list[list[str]]:
    """Return a header and corrected joint values, ° and mm: a row for each joint of one pose, else for each pose."""
    units = [("mm", 1e3) if slides else ("°", 180 / np.pi) for slides in result.prismatic]
    letters = _MOST_OF_JOINT if len(result.poses) == 1 else _MOST_LETTERS
    names = [shortened(visible(name), letters) for name in result.joints]

    def written(value: float, unit: tuple[str, float]) -> str:
        return f"{round(value * unit[1], _DECIMALS) + 0.0:.{_DECIMALS}f}" if np.isfinite(value) else "-"

    if len(result.poses) == 1:
        if not np.isfinite(result.corrected).all():
            return [[]]
        columns = zip(names, units, result.poses.q[:, 0].tolist(), result.corrected[:, 0].tolist(), strict=True)
        return [
            ["joint", "", "asked", "corrected", "change"],
            *([name, unit[0], *(written(value, unit) for value in (q, to, to - q))] for name, unit, q, to in columns),
        ]
    rows = [["pose", *(f"{name} {unit}" for name, (unit, _) in zip(names, units, strict=True))]]
    for pose in _list_poses(result):
        cells = map(written, result.corrected[:, pose].tolist(), units)
        rows.append([shortened(visible(result.poses.labels[pose]), _MOST_LETTERS), *cells])
    return rows


def _text(value: float) -> str:
    """Return a length or an angle in mm or mrad, four digits; less than a nanometre is 0."""
    if not np.isfinite(value):
        return "-"
    return "0" if value < _ZERO else f"{1e3 * value:.4g}"


def corrected_csv(result: CompensationResult, columns: Sequence[Column] = ()) -> str:
    """Return the corrected joint values as ``--trajectory`` reads them: names, then a row for each pose.

    Poses without a correction are left out. ``columns`` gives the columns with their units; by default times, then the
    chain's order, in s, degrees and mm.
    """
    is_corrected = np.array(result.correction.status) == "corrected"
    times = result.poses.times
    columns_of = {name: result.corrected[row] for row, name in enumerate(result.joints)}
    order = list(columns)
    if not order:
        order = [Column("t [s]", "")] if times is not None else []
        order += joint_columns(result.joints, result.prismatic)
    if times is not None:
        columns_of[""] = times
    values = [(columns_of[column.joint][is_corrected] / column.factor).tolist() for column in order]
    rows = [[repr(value) for value in row] for row in zip(*values, strict=True)]
    return csv_text([column.heading for column in order], rows)
