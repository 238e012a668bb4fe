"""Check for numbers that are too large for metres, radians or kilograms."""

from __future__ import annotations

import math

from precision_pin.robot.urdf.data import Vector
from precision_pin.robot.urdf.findings import Findings

LONGEST_REACH = 20.0
BEYOND_USE = 1e6
# a full turn written with four digits is still a full turn
WIDEST_ANGLE = 2 * math.pi * (1 + 1e-4)


def check_length(vector: Vector, what: str, line: int, findings: Findings) -> None:
    """Refuse a vector beyond 1000 km (``E_UNITS``), warn beyond 20 m (``W_UNITS``)."""
    largest = max(vector, key=abs)
    if abs(largest) > BEYOND_USE:
        message = f"{what} contains {largest:g} m, which is implausibly large; lengths are in metres"
        findings.error("E_UNITS", message, line)
    elif math.hypot(*vector) > LONGEST_REACH:
        message = f"{what} holds {largest:g} m; are these millimetres? lengths are in metres"
        findings.warning("W_UNITS", message, line)


def check_angle(rpy: Vector, what: str, line: int, findings: Findings) -> None:
    """Refuse angles beyond 1e6 rad (``E_UNITS``), warn beyond a full turn (``W_UNITS``)."""
    largest = max(rpy, key=abs)
    if abs(largest) > BEYOND_USE:
        findings.error(
            "E_UNITS", f"{what} contains {largest:g} rad, which is implausibly large; angles are in radians", line
        )
    elif abs(largest) > WIDEST_ANGLE:
        message = f"{what} holds {largest:g} rad, over a full turn; are these degrees? angles are in radians"
        findings.warning("W_UNITS", message, line)
