"""Poses of a sheet, from text: joint values, and the approach of those that have one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from precision_pin.base import units
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.approach import PREVIOUS, Approach, approaches_along, read_approach
from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import Joint
from precision_pin.sheet.findings import POSE_VALUES, Findings
from precision_pin.sheet.law_reader import SettingError

PlainPose = str | list[str] | Mapping[str, str]
"""Joint values as text: numbers with one unit, a list, or by joint."""
PoseText = PlainPose | Mapping[str, str | list[str] | dict[str, str]]
"""A pose of a sheet: joint values, or these with an approach."""

VALUES: Final = "q"
APPROACH: Final = "approach"


def parse_poses(
    given: Mapping[str, PoseText], findings: Findings, chain: Chain
) -> tuple[dict[str, Array], dict[str, Approach]]:
    """Return joint values by the poses' names, and the approaches of those that have one; those that are wrong are left out."""
    poses: dict[str, Array] = {}
    approaches: dict[str, Approach] = {}
    following: list[str] = []
    for rank, (name, value) in enumerate(given.items()):
        if name == "<<":
            findings.error(("poses", name), "'<<' would merge keys, which sheets do not support; write the keys out")
            continue
        try:
            q, approach = split_pose(value, chain)
            poses[name] = parse_pose(q, chain)
        except InputError as error:
            findings.take(("poses", name), error)
            continue
        if approach == PREVIOUS and not rank:
            message = "the approach is from the previous pose, but this is the first; give + or - by joint"
            findings.error(("poses", name, APPROACH), message)
        elif approach == PREVIOUS:
            following.append(name)
        else:
            try:
                approaches[name] = read_approach(chain.joint_names, approach)
            except InputError as error:
                findings.take(("poses", name, APPROACH), error)
    along = approaches_along(np.column_stack([*poses.values()])) if following else np.zeros(0)
    ranks = {name: rank for rank, name in enumerate(poses)}
    approaches |= {name: tuple(along[:, ranks[name]].tolist()) for name in following}
    return poses, {name: approaches[name] for name in poses if any(approaches.get(name, ()))}


def split_pose(value: PoseText, chain: Chain) -> tuple[PlainPose, Any]:
    """Return the joint values of a pose as text, and its approach, which is empty where none is given.

    A mapping with ``q`` and ``approach`` has both, unless these are names of joints.

    Raises
    ------
    InputError
        The mapping has other keys beside these, or a joint's value is no text.
    """
    approach: Any = ()
    if isinstance(value, Mapping) and {VALUES, APPROACH} & (value.keys() - set(chain.joint_names)):
        wrong = [key for key in value if key not in (VALUES, APPROACH)]
        if wrong or VALUES not in value:
            what = (
                f"unknown key {wrong[0]!r} beside q: and approach:"
                if wrong
                else "approach: needs the joint values as q:"
            )
            raise InputError(f"{what}; write {{q: 10 20 30 deg, approach: {{joint: +}}}}")
        approach = value.get(APPROACH, ())
        value = value[VALUES]
    if isinstance(value, Mapping) and not all(isinstance(text, str) for text in value.values()):
        raise InputError(POSE_VALUES)
    return value, approach  # type: ignore[return-value]


def parse_pose(value: PlainPose, chain: Chain) -> Array:
    """Return joint values in chain order from text: numbers with one unit, a list, or a mapping by joint.

    Raises
    ------
    InputError
        Wrong count, unit or joint.
    """
    quantities = [joint_quantity(joint) for joint in chain.joints]
    if isinstance(value, Mapping):
        named = {name: _parse_at(name, text, quantities[chain.joint_index(name)]) for name, text in value.items()}
        return chain.configuration(named)
    if isinstance(value, str):
        if len(set(quantities)) > 1:
            raise InputError(
                "the chain has revolute and prismatic joints: give each joint value its own unit, by joint name"
            )
        return chain.configuration(units.parse_vector(value, quantities[0]))
    if len(value) != len(quantities):
        raise InputError(f"{len(value)} joint values for {len(quantities)} joints: {', '.join(chain.joint_names)}")
    return chain.configuration([_parse_at(k, text, quantities[k]) for k, text in enumerate(value)])


def joint_quantity(joint: Joint) -> units.Quantity:
    """Return the quantity of a joint's value."""
    return units.LENGTH if joint.kind == "prismatic" else units.ANGLE


def _parse_at(where: str | int, text: str, quantity: units.Quantity) -> float:
    try:
        return units.parse(text, quantity)
    except InputError as error:
        raise SettingError((where,), error) from None
