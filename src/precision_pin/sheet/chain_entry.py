"""Reader of a sheet's arm and poses: robot, tip, base, gravity, locked joints, target, joint values, approaches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from precision_pin.base import units
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UrdfError
from precision_pin.robot.chain import EARTH, FARTHEST_TARGET, Chain
from precision_pin.robot.collision import KeepOut, Obstacles
from precision_pin.robot.configurations import (
    PREVIOUS,
    SLACK,
    Approach,
    approaches_along,
    joint_quantity,
    read_approach,
)
from precision_pin.robot.examples import resolve_robot
from precision_pin.robot.urdf import Limit
from precision_pin.robot.urdf import read as read_urdf
from precision_pin.sheet.schema import POSE_VALUES, Document, Findings
from precision_pin.sheet.settings import SettingError, placed

PlainPose = str | list[str] | Mapping[str, str]
"""Joint values as text: numbers with one unit, a list, or by joint."""
PoseText = PlainPose | Mapping[str, str | list[str] | dict[str, str]]
"""A pose of a sheet: joint values, perhaps with an approach."""

VALUES: Final = "q"
APPROACH: Final = "approach"
"""Keys of a pose with an approach."""


def parse_poses(
    entries: Mapping[str, PoseText], findings: Findings, chain: Chain
) -> tuple[dict[str, Array], dict[str, Approach]]:
    """Return joint values by pose name, and the approaches of poses that have one, without invalid poses."""
    poses: dict[str, Array] = {}
    approaches: dict[str, Approach] = {}
    path_poses: list[str] = []
    for rank, (name, value) in enumerate(entries.items()):
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
            path_poses.append(name)
        else:
            with findings.taking("poses", name, APPROACH):
                approaches[name] = read_approach(chain.joint_names, approach)
    path_approaches = approaches_along(np.column_stack([*poses.values()])) if path_poses else np.zeros(0)
    ranks = {name: rank for rank, name in enumerate(poses)}
    approaches |= {name: tuple(path_approaches[:, ranks[name]].tolist()) for name in path_poses}
    return poses, {name: approaches[name] for name in poses if any(approaches.get(name, ()))}


def split_pose(value: PoseText, chain: Chain) -> tuple[PlainPose, Any]:
    """Return the joint values of a pose as text, and its approach or an empty one.

    A mapping with ``q`` and ``approach`` has both, unless these are names of joints.
    """
    approach: Any = ()
    if isinstance(value, Mapping) and {VALUES, APPROACH} & (value.keys() - set(chain.joint_names)):
        unknown = [key for key in value if key not in (VALUES, APPROACH)]
        if unknown or VALUES not in value:
            what = (
                f"unknown key {unknown[0]!r} next to q: and approach:"
                if unknown
                else "approach: needs the joint values as q:"
            )
            raise InputError(f"{what}; write {{q: 10 20 30 deg, approach: {{joint: +}}}}")
        approach = value.get(APPROACH, ())
        value = value[VALUES]
    if isinstance(value, Mapping) and not all(isinstance(text, str) for text in value.values()):
        raise InputError(POSE_VALUES)
    return value, approach  # type: ignore[return-value]


def parse_pose(value: PlainPose, chain: Chain) -> Array:
    """Return joint values in chain order from text: numbers with one unit, a list, or a mapping by joint."""
    quantities = [joint_quantity(joint) for joint in chain.joints]
    if isinstance(value, Mapping):
        values = {name: _parse_at(name, text, quantities[chain.joint_index(name)]) for name, text in value.items()}
        return chain.configuration(values)
    if isinstance(value, str):
        if len(set(quantities)) > 1:
            message = "the chain has revolute and prismatic joints: give each joint value its own unit, by joint name"
            raise InputError(message)
        return chain.configuration(units.parse_vector(value, quantities[0]))
    if len(value) != len(quantities):
        raise InputError(f"{len(value)} joint values for {len(quantities)} joints: {', '.join(chain.joint_names)}")
    return chain.configuration([_parse_at(k, text, quantities[k]) for k, text in enumerate(value)])


def _parse_at(where: str | int, text: str, quantity: units.Quantity) -> float:
    with placed(where):
        return units.parse(text, quantity)


_EXAMPLE: Final = "0 0 100 mm"
"""A target, for messages: a tool tip 100 mm along z."""


def parse_target(text: str) -> list[float]:
    """Return a point in the tip's axes, m, from text such as ``0 0 100 mm``."""
    try:
        point = units.parse_vector(text, units.LENGTH, count=3)
        if max(map(abs, point)) > FARTHEST_TARGET:
            raise InputError(f"{text!r} is farther than {FARTHEST_TARGET:,.0f} m from the tip")
    except InputError as error:
        message = f"target: {error.findings[0].message}; write it as {_EXAMPLE!r}, in the tip's axes"
        raise SettingError(("target",), InputError(message)) from None
    return point


GRAVITIES: Final = {"earth": EARTH, "moon": (0.0, 0.0, -1.62), "none": (0.0, 0.0, 0.0)}
"""Named values of ``gravity:``, base axes with z up, m/s²; at the surface of the moon 1.62."""


@dataclass(frozen=True)
class Overrides:
    """Values from the command line that replace values of the sheet; ``None`` keeps the sheet's."""

    robot: FilePath | None = None
    tip: str | None = None
    base: str | None = None
    package_dirs: tuple[str, ...] = ()
    target: str | None = None
    ignores_collisions: bool = False
    wraps: bool = False


_ARM: Final = ("robot", "tip", "base", "target", "gravity", "locked", "limits", "keep_out")
"""Keys of a sheet that :func:`read_chain` reads."""


def is_same_arm(data: Mapping[str, object], other: Mapping[str, object]) -> bool:
    """Return whether two sheets in one folder, with equal overrides, describe the same arm."""
    return all(data.get(key) == other.get(key) for key in _ARM)


def read_chain(document: Document, findings: Findings, overrides: Overrides, folder: FilePath) -> Chain | None:
    """Return the arm of a sheet; ``None`` if it cannot be read: the findings have the reason."""
    try:
        robot = read_urdf(overrides.robot or resolve_robot(document.robot, folder), package_dirs=overrides.package_dirs)
    except UrdfError as error:
        findings.found += error.findings
        return None
    except InputError as error:
        findings.take(("robot",), error)
        return None
    gravity = _gravity(document, findings)
    locked: dict[str, float] = {}
    for name, value in document.locked.items():
        with findings.taking("locked", name):
            locked[name] = units.parse(value, joint_quantity(robot.joint(name)))
    if len(locked) < len(document.locked):
        return None
    try:
        # an empty name is passed on: no link has it
        tip = document.tip if overrides.tip is None else overrides.tip
        base = document.base if overrides.base is None else overrides.base
        chain = Chain.from_robot(robot, tip, base, gravity, locked)
        target = overrides.target or document.target
        chain = chain if target is None else chain.with_target(parse_target(target))
    except InputError as error:
        findings.take((), error)
        return None
    chain = _limited(document, findings, replace(chain, wraps=overrides.wraps))
    keep_out = _keep_out(document, findings)
    folders = tuple(map(FilePath, overrides.package_dirs))
    return chain if overrides.ignores_collisions else replace(chain, obstacles=Obstacles(keep_out, folders))


def _limited(document: Document, findings: Findings, chain: Chain) -> Chain:
    joints = list(chain.joints)
    for name, text in document.limits.items():
        with findings.taking("limits", name):
            number = chain.joint_index(name)
            joint = joints[number]
            low, high = units.parse_vector(text, joint_quantity(joint), count=2)
            minimum, maximum = (float(limit[number]) for limit in chain.configurations.limits)
            if not minimum - SLACK <= low < high <= maximum + SLACK:
                message = f"limits are the lowest and the highest value, within {minimum:g} to {maximum:g} of the URDF (rad, m)"
                raise InputError(f"{message}; got {text!r}")
            urdf_limit = joint.limit or Limit(low, high, np.inf, np.inf)
            # a continuous joint with limits is revolute
            kind = "revolute" if joint.kind == "continuous" else joint.kind
            joints[number] = replace(joint, kind=kind, limit=replace(urdf_limit, lower=low, upper=high))
    return replace(chain, joints=tuple(joints)) if document.limits else chain


def _keep_out(document: Document, findings: Findings) -> tuple[KeepOut, ...] | None:
    if document.keep_out is None:
        return None
    obstacles = []
    for number, entry in enumerate(() if document.keep_out == "none" else document.keep_out):
        with findings.taking("keep_out", number):
            if (entry.plane is None) == (entry.box is None):
                message = "keep_out: an entry is {plane: 0 0 1, at: 0 0 0 mm} or {box: 800 600 40 mm, at: 0 0 -20 mm}"
                raise InputError(message)
            at = tuple(units.parse_vector(entry.at, units.LENGTH, count=3))
            if entry.box is not None:
                size = tuple(units.parse_vector(entry.box, units.LENGTH, count=3))
                if min(size) <= 0:
                    raise InputError(f"keep_out: the edges of a box are above zero, got {entry.box!r}")
                obstacles.append(KeepOut(at, size=size))
                continue
            normal = np.array(units.parse_vector(entry.plane, units.RATIO, count=3))
            if not normal.any():
                raise InputError("keep_out: the normal of a plane is zero")
            obstacles.append(KeepOut(at, normal=tuple((normal / np.linalg.norm(normal)).tolist())))
    return tuple(obstacles)


def _gravity(document: Document, findings: Findings) -> tuple[float, ...]:
    if document.gravity in GRAVITIES:
        return GRAVITIES[document.gravity]
    try:
        return tuple(units.parse_vector(document.gravity, units.ACCELERATION, count=3))
    except InputError as error:
        allowed = ", ".join(GRAVITIES)
        message = f"gravity: {error.findings[0].message}; give three numbers in m/s^2, or one of {allowed}"
        findings.error(("gravity",), message)
        return EARTH
