"""Periodic errors of a joint's value, with a random phase, equal at all poses of a built robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.draws.expressions import Component, Value
from precision_pin.draws.laws import Circle
from precision_pin.terms import Array, Draw, Finding, JointValue, LabelledSpace, Scope, Term, units
from precision_pin.terms.term import Target

_ROUNDING: Final = 1e-9
"""Ratio of the mean of an amplitude to its standard deviation below which the mean is rounding of an intended zero."""


def phase_draw(name: str) -> Draw:
    """Return the draw of a phase φ as (cos φ, sin φ), with φ uniform over a turn, once for each built robot."""
    return Draw(name, Circle(1.0), Scope.UNIT, (units.RATIO,) * 2)


def periodic_terms(
    joint: int, angle: Array | float, amplitude: Value, space: LabelledSpace, phase: str
) -> Iterator[Term]:
    """Yield the terms of ``amplitude · sin(angle + φ)`` on a joint's value, linear in (cos φ, sin φ).

    Args:
        joint: Index of the joint, 0-based.
        angle: Angle of the error within its period at this pose, rad; ``(P,)`` for a posture of P configurations.
        amplitude: rad or m.
        space, phase: Space of the source, and the name of its draw of φ.
    """
    yield from phased_terms(JointValue(joint), (np.sin(angle), np.cos(angle)), amplitude, space, phase)


def phased_terms(
    target: Target, twists: Sequence[ArrayLike], amplitude: Value, space: LabelledSpace, phase: str
) -> Iterator[Term]:
    """Yield the terms ``amplitude · (twists[0] cos φ + twists[1] sin φ)`` on a target, with φ of the draw ``phase``."""
    for twist, part in zip(twists, ("x", "y"), strict=True):
        yield Term.of(target, twist, amplitude, space.component(f"{phase}.{part}"))


def amplitude_remarks(
    field: str, amplitude: Value, space: LabelledSpace, size: str = "amplitude", divisor: str = "√2"
) -> Iterator[Finding]:
    """Yield a warning if an amplitude varies about zero.

    As the phase is random already, such an error has the standard deviation ``√(E[amplitude²]/2)``, the law's over √2,
    and is zero in the first-order model, which takes the mean. ``size`` names what is given, the error's standard deviation
    times ``divisor``.
    """
    if not isinstance(amplitude, Component):
        return
    column = space.space.index[amplitude.name]
    mean, deviation = float(space.space.mean[column]), float(space.space.block_covariance.variances[column]) ** 0.5
    if deviation > 0 and abs(mean) <= _ROUNDING * deviation:
        message = (
            f"{field} of {space.label} varies about zero, so first-order analyses miss it; the phase is random already: "
            f"write a known {size} as a plain number (the error's standard deviation is then the {size} over {divisor}), an "
            "uncertain one with a mean: above zero"
        )
        yield Finding("warning", "W_AMPLITUDE", message)
