"""Terminal table of the stiffness."""

from __future__ import annotations

from typing import Final

import numpy as np

from precision_pin.analyses.result import answer_of, subject
from precision_pin.analyses.stiffness.stiffness import (
    Direction,
    PoseStiffness,
    StiffnessResult,
    number,
    per_kilonewton,
    vector_text,
)
from precision_pin.base.errors import visible
from precision_pin.render.columns import Column, text_lines
from precision_pin.render.tables import milli, percent
from precision_pin.render.text_table import aligned, limited, remainder

_EVEN: Final = 1e-4
"""Relative difference between steps that is none."""
_SAME: Final = 5e-3
"""Excess of a factor over one that no part needs: less than its digits."""
_PARTS: Final = 8
"""Elastic sources listed."""
_DETAILED: Final = 3
"""Poses up to which each has tables of its own."""
_LISTED: Final = 12
"""Poses listed otherwise, the softest first."""


def table(result: StiffnessResult) -> str:
    """Return how far the tool gives way, then compliances along the axes and the parts that give, mm/kN and mrad/(N·m)."""
    poses = result.poses
    parts = [
        answer_of(
            [pose.pose for pose in poses], [pose.softest.compliance for pose in poses], [answer(pose) for pose in poses]
        )
    ]
    if len(poses) > _DETAILED:
        parts.append("\n".join([result.how, "", *_overview(result)]))
        poses = (poses[result.softest_pose],)
    parts += ["\n".join(_pose_lines(result, pose)) for pose in poses]
    parts.append(
        "compliance: displacement over force along the axis, free sideways, as a dial gauge sees it; N/µm: one over it;\n"
        "95 % of robots: the quantile with its interval; what has no stiffness in the sheet is rigid"
    )
    return "\n\n".join(parts)


def answer(pose: PoseStiffness) -> str:
    """Return how far the tool gives way, where it is softest and what gives most, as a sentence."""
    length, axis, force = pose.largest
    softest, first = pose.softest, pose.sources[0]
    where = f"{_along(pose)}: {per_kilonewton(softest.compliance)} mm/kN, {_stiffness(softest)} N/µm"
    by = f"by up to {1e3 * length:.3g} mm"
    moved = f"along an axis move the tool {by} ({axis}); softest along" if axis else f"move the tool {by}, along"
    return f"{force:g} N {moved} {where}; {visible(first.source)} gives {100 * first.share:.0f} % of it"


def _along(pose: PoseStiffness) -> str:
    """Return the softest direction as text, with its axes where those of the forces are others."""
    is_base = np.array_equal([entry.direction for entry in pose.axes], np.eye(3))
    return vector_text(pose.softest.direction) + ("" if is_base else " in base axes")


def _stiffness(entry: Direction) -> str:
    return "-" if entry.stiffness is None else number(1e-6 * entry.stiffness)


def _pose_lines(result: StiffnessResult, pose: PoseStiffness) -> list[str]:
    lines = [
        subject(result.provenance, pose.pose),
        result.how,
        "",
        *text_lines(pose_columns(result, pose), result.rows(pose)),
    ]
    if pose.solved_difference is not None:
        lines += [
            "",
            f"softest and stiffest robot solved one by one: {100 * pose.solved_difference:.2g} % from the law",
        ]
    lines += ["", f"what gives way along {_along(pose)}:", *aligned(_part_rows(result, pose))]
    lines += remainder(len(pose.sources) - len(pose.sources[: limited(_PARTS)]), "parts")
    if pose.goal is not None:
        low, high = pose.goal.interval
        lines.append(
            f"within {per_kilonewton(pose.goal.limit)} mm/kN: {percent(pose.goal.probability)} % of robots, interval "
            f"{percent(low)} to {percent(high)} %"
            + (f"; all parts together × {pose.goal.together:.3g}" if pose.goal.together > 1 else "")
        )
    lines += _step_lines(pose)
    if pose.dead_band:
        names = [entry.axis for entry in pose.axes]
        rows = [["held by friction", *(f"{name} mm" for name in names)]]
        rows += [[visible(held.source), *(milli(length, 4) for length in held.axes)] for held in pose.dead_band]
        lines += ["", *aligned(rows, words=1)]
    return lines


def pose_columns(result: StiffnessResult, pose: PoseStiffness) -> list[Column]:
    """Return the columns that have values at a pose."""
    unused = set() if pose.static_compliance else {"plus", "minus"}
    unused |= set() if pose.dead_band else {"band"}
    return [column for column in result.COLUMNS if column.value not in unused]


def _part_rows(result: StiffnessResult, pose: PoseStiffness) -> list[list[str]]:
    rows = [
        [
            "mm/kN",
            "share",
            "softest",
            *(entry.axis for entry in pose.axes),
            *(["stiffer alone", "split"] if pose.goal else []),
        ]
    ]
    for part in pose.sources[: limited(_PARTS)]:
        sizes = (per_kilonewton(size) for size in (part.compliance, *part.axes))
        row = [visible(part.source), f"{percent(part.share)} %", *sizes]
        if pose.goal is not None:
            row.append("not alone" if part.factor is None else _times(part.factor))
            row.append(_times(part.split))
        rows.append(row)
    return rows


def _times(factor: float | None) -> str:
    """Return how many times stiffer a part must be, as text."""
    return "-" if factor is None else "kept" if factor < 1 + _SAME else f"× {factor:.3g}"


def _step_lines(pose: PoseStiffness) -> list[str]:
    """Return the static compliance at each step of the load, or that it is the tangent's."""
    if not pose.static_compliance:
        return []
    entries = [*pose.static_compliance.items()]
    first = entries[0][1]
    if all(np.ptp(entry.compliance) <= _EVEN * entry.compliance.max() for _, entry in entries):
        return ["", f"static compliance: the same at every step of {first.step:g} N up to {first.rated:g} N"]
    rows = [["force N", *(f"{force:g}" for force in first.force)]]
    rows += [[name, *(per_kilonewton(c) for c in entry.compliance)] for name, entry in entries]
    return ["", "static compliance along the force, mm/kN:", *aligned(rows, words=1)]


def _overview(result: StiffnessResult) -> list[str]:
    order = sorted(range(len(result.poses)), key=lambda k: -result.poses[k].softest.compliance)
    names = [entry.axis for entry in result.poses[0].axes]
    rows = [["pose", "softest mm/kN", "along", "N/µm", *(f"{name} mm/kN" for name in names), "most by"]]
    for k in order[: limited(_LISTED)]:
        pose = result.poses[k]
        rows.append(
            [
                visible(result.labels[k]),
                *(
                    per_kilonewton(pose.softest.compliance),
                    vector_text(pose.softest.direction),
                    _stiffness(pose.softest),
                ),
                *(per_kilonewton(entry.compliance) for entry in pose.axes),
                visible(pose.sources[0].source),
            ]
        )
    return [*aligned(rows, words=1), *remainder(len(order) - len(rows) + 1, "poses")]
