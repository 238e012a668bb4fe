"""Periodic errors of a joint's value, whose phase is random but the same wherever a built robot goes."""

from __future__ import annotations

import math
from collections.abc import Iterator

from precision_pin.laws import Circle
from precision_pin.parameters import Value
from precision_pin.space import Draw, LabelledSpace, Scope
from precision_pin.terms import JointValue, Term

__all__ = ["periodic_terms", "phase_draw"]


def phase_draw(name: str) -> Draw:
    """Return the draw of a phase φ: the point (cos φ, sin φ), φ uniform on the turn, once for each built robot."""
    return Draw(name, Circle(1.0), Scope.UNIT)


def periodic_terms(joint: int, angle: float, amplitude: Value, space: LabelledSpace, phase: str) -> Iterator[Term]:
    """Yield the terms of ``amplitude · sin(angle + φ)`` on a joint's value, linear in φ's point.

    Parameters
    ----------
    joint
        0-based.
    angle
        Where in its period the error is at this pose, rad.
    amplitude
        rad or m.
    space, phase
        What the source sees, and its own draw of φ.
    """
    yield Term.of(JointValue(joint), math.sin(angle), amplitude, space.component(f"{phase}.x"))
    yield Term.of(JointValue(joint), math.cos(angle), amplitude, space.component(f"{phase}.y"))
