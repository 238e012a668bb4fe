"""Periodic errors of a joint's value, whose phase is random but the same wherever a built robot goes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from precision_pin import units
from precision_pin.draws.expressions import Component, Value
from precision_pin.draws.laws import Circle
from precision_pin.draws.space import Draw, LabelledSpace, Scope
from precision_pin.errors import Finding
from precision_pin.terms.term import JointValue, Term

__all__ = ["amplitude_remarks", "periodic_terms", "phase_draw"]

_ROUNDING: Final = 1e-9


def phase_draw(name: str) -> Draw:
    """Return the draw of a phase φ: the point (cos φ, sin φ), φ uniform on the turn, once for each built robot."""
    return Draw(name, Circle(1.0), Scope.UNIT, (units.RATIO,) * 2)


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


def amplitude_remarks(field: str, amplitude: Value, space: LabelledSpace) -> Iterator[Finding]:
    """Yield a warning where an amplitude varies about zero.

    The phase is random already, so the error has the standard deviation ``√(E[amplitude²]/2)``: of a law about zero that
    of the tolerance over √2, and nothing of an amplitude. The first-order model, taken at the mean, has none at all.
    """
    if not isinstance(amplitude, Component):
        return
    column = space.space.index[amplitude.name]
    mean, deviation = float(space.space.mean[column]), float(space.space.block_covariance.variances[column]) ** 0.5
    if deviation > 0 and abs(mean) <= _ROUNDING * deviation:
        message = (
            f"{field} of {space.label} varies about zero, where first-order analyses see nothing of it; its phase is "
            "random already: write a known amplitude as a plain number (the error's standard deviation is it over √2), "
            "one with a tolerance with a mean: above zero"
        )
        yield Finding("warning", "W_AMPLITUDE", message)
