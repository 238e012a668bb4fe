"""Right angles that are written with too few digits."""

from __future__ import annotations

import math
from dataclasses import replace
from decimal import Decimal

from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.data import Joint
from precision_pin.robot.urdf.findings import Findings
from precision_pin.robot.urdf.robot import Robot

EIGHTH = math.pi / 4
# 1.570796 (0.33 µrad off) is good enough for a thousandth of a millimetre at 2 m, 1.5708 (3.7 µrad) is not
GOOD_ENOUGH = 1e-6
WIDEST_SLIP = 2e-3
MOST_DECIMALS = 5
WIDEST = 4 * math.pi


def _find_exact_angle(angle: float) -> float | None:
    """Return the multiple of 45° that an angle is rounded from, None if it is not rounded.

    A right angle counts as rounded if it is off by up to 2 mrad and written with up to five decimals, since more
    decimals look measured. An odd multiple of 45° must be truncated or rounded at its last decimal.
    """
    if abs(angle) > WIDEST:
        return None
    turns = round(angle / EIGHTH)
    exact = turns * EIGHTH
    slip = abs(angle - exact)
    if turns == 0 or not GOOD_ENOUGH < slip <= WIDEST_SLIP:
        return None
    exponent = Decimal(repr(angle)).as_tuple().exponent
    decimals = -exponent if isinstance(exponent, int) else 0
    if decimals > MOST_DECIMALS or (turns % 2 and slip > 10.0**-decimals):
        return None
    return exact


def check_angles(joint: Joint, findings: Findings) -> None:
    """Warn of rounded right angles in a joint's origin (``W_ANGLE_ROUNDED``)."""
    for name, angle in zip(("roll", "pitch", "yaw"), joint.rpy, strict=True):
        exact = _find_exact_angle(angle)
        if exact is not None:
            degrees = round(math.degrees(exact))
            message = (
                f"joint {shown(joint.name)}: {name} {angle!r} is {abs(angle - exact):.1e} rad off {degrees}°; "
                f"write {exact!r} if that is intended (snapping does it)"
            )
            findings.warning("W_ANGLE_ROUNDED", message, joint.line)


def snapped(robot: Robot) -> Robot:
    """Return the robot with rounded right angles of its joint origins made exact.

    Only angles with a ``W_ANGLE_ROUNDED`` warning change; these warnings are removed.
    """
    joints = []
    for joint in robot.joints:
        roll, pitch, yaw = (angle if (exact := _find_exact_angle(angle)) is None else exact for angle in joint.rpy)
        joints.append(replace(joint, rpy=(roll, pitch, yaw)))
    findings = tuple(found for found in robot.findings if found.code != "W_ANGLE_ROUNDED")
    return replace(robot, joints=tuple(joints), findings=findings)
