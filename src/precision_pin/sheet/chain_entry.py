"""Reader of a sheet's arm: robot, tip, base, gravity, locked joints and target."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Final, final

from precision_pin.base import units
from precision_pin.base.errors import InputError, UrdfError
from precision_pin.robot.chain import EARTH, Chain
from precision_pin.robot.examples import resolve_robot
from precision_pin.robot.urdf import Robot
from precision_pin.robot.urdf import read as read_urdf
from precision_pin.sheet.findings import Findings
from precision_pin.sheet.poses import joint_quantity
from precision_pin.sheet.schema import Document
from precision_pin.sheet.target import parse_target

GRAVITIES: Final = {"earth": EARTH, "moon": (0.0, 0.0, -1.62), "none": (0.0, 0.0, 0.0)}


@final
@dataclass(frozen=True)
class Overrides:
    """Values from the command line in place of the sheet's; ``None`` keeps the sheet's."""

    robot: FilePath | None = None
    tip: str | None = None
    base: str | None = None
    package_dirs: tuple[str, ...] = ()
    target: str | None = None


def read_chain(document: Document, findings: Findings, overrides: Overrides, folder: FilePath) -> Chain | None:
    """Return the arm of a sheet; ``None`` where it could not be read, which the findings then say."""
    try:
        robot = read_urdf(overrides.robot or resolve_robot(document.robot, folder), package_dirs=overrides.package_dirs)
    except UrdfError as error:
        findings.found += error.findings
        return None
    except InputError as error:
        findings.take(("robot",), error)
        return None
    gravity = _gravity(document, findings)
    locked = _parse_locked(document, findings, robot)
    if locked is None:
        return None
    try:
        chain = Chain.from_robot(robot, overrides.tip or document.tip, overrides.base or document.base, gravity, locked)
        target = overrides.target or document.target
        return chain if target is None else chain.with_target(parse_target(target))
    except InputError as error:
        findings.take((), error)
        return None


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


def _parse_locked(document: Document, findings: Findings, robot: Robot) -> dict[str, float] | None:
    values: dict[str, float] = {}
    for name, value in document.locked.items():
        try:
            values[name] = units.parse(value, joint_quantity(robot.joint(name)))
        except InputError as error:
            findings.take(("locked", name), error)
    return values if len(values) == len(document.locked) else None
