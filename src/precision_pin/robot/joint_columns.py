"""Columns of joint values in files: our own, and those of recorders that do not name the joints plainly."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from precision_pin.base.csv_columns import ColumnNames
from precision_pin.base.errors import InputError

_UR: Final = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
"""Joints of UR's robots in the order of the controller, as their URDFs name them before ``_joint``."""


@dataclass(frozen=True)
class Column:
    """A column of a file of joint values: its heading, its joint (empty for times), and its unit in s, rad or m."""

    heading: str
    joint: str
    factor: float = 1.0
    has_unit: bool = True


def joint_columns(names: Iterable[str], slides: Iterable[bool]) -> list[Column]:
    """Return the columns for writing joint values: degrees, or mm for sliding joints."""
    return [
        Column(f"{name} [mm]", name, 1e-3) if is_slide else Column(f"{name} [deg]", name, math.pi / 180)
        for name, is_slide in zip(names, slides, strict=True)
    ]


def sheet_values(names: Iterable[str], slides: Iterable[bool], q: Iterable[float]) -> str | list[str]:
    """Return joint values as a pose of a sheet: in degrees and mm, to six decimals; one text if all have one unit."""
    columns = joint_columns(names, slides)
    numbers = [f"{value / column.factor:.6f}".rstrip("0").rstrip(".") for column, value in zip(columns, q, strict=True)]
    units = [column.heading.rpartition("[")[2].rstrip("]") for column in columns]
    if len(set(units)) == 1:
        return f"{' '.join(numbers)} {units[0]}"
    return [f"{number} {unit}" for number, unit in zip(numbers, units, strict=True)]


def recorded(header: Sequence[str], row: Sequence[str], joints: Mapping[str, str], given: ColumnNames) -> ColumnNames:
    """Return the columns of a recorder by the first two rows of its file.

    They are the ``given`` ones where these or the header name the joints, or for no known recorder.

    Known are ``actual_q_0`` to ``_5``, or ``target_q_…``, of the RTDE client of Universal Robots (its ``record.py``, and
    ur_rtde), ``field.position0`` … of ``rostopic echo -p`` with the names in ``field.name0`` …, and PlotJuggler's
    ``/joint_states/NAME/position``. All write rad and m.

    Args:
        joints: The SI unit of each joint by its name, in chain order.

    Raises:
        InputError: The columns are those of UR's RTDE, and the joints have other names than in UR's URDFs.
    """
    if set(joints) <= {given.names.get(column, (column, ""))[0] for column in header}:
        return given
    first, cells = dict(zip(header, row, strict=False)), dict[str, str]()
    positions = [match[1] for column in header if (match := re.fullmatch(r"field\.position(\d+)", column))]
    q = next((q for q in ("actual_q_", "target_q_") if {f"{q}{k}" for k in range(len(_UR))} <= set(header)), "")
    if q:
        recorder = f"UR's RTDE recorder ({q}0 ...)"
        ur_joints = {name: joint for joint in joints for name in _UR if joint.removesuffix("_joint").endswith(name)}
        if len(ur_joints) < len(_UR):
            example = ", ".join(f"{q}{k}={joint} [rad]" for k, joint in enumerate(joints))
            message = f"these are columns of {recorder}, and the joints have other names than UR's; say which is which"
            raise InputError(f"{message}: --columns '{example}, timestamp=t [s], *=ignore'")
        joint_of = {f"{q}{k}": ur_joints[name] for k, name in enumerate(_UR)}
    elif positions:
        recorder = "rostopic echo -p (field.position0 ... by field.name0 ...)"
        cells = {f"field.name{k}": first.get(f"field.name{k}", "") for k in positions}
        joint_of = {f"field.position{k}": cells[f"field.name{k}"] for k in positions}
    else:
        recorder = "PlotJuggler (TOPIC/JOINT/position)"
        joint_of = {column: column.split("/")[-2] for column in header if re.fullmatch(r"/.+/[^/]+/position", column)}
    names = {column: (joint, joints[joint]) for column, joint in joint_of.items() if joint in joints}
    columns = replace(given, names={**names, **given.names}, ignores_others=True, cells=cells, recorder=recorder)
    return columns if names else given
