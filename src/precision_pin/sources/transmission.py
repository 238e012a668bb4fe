"""Transmissions: gears and screws."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from precision_pin.draws.space import LabelledSpace, entry_name
from precision_pin.sources.periodic import amplitude_remarks, periodic_terms, phase_draw
from precision_pin.terms import Dependence, Draw, Finding, InputError, JointValue, Posture, Setting, Source, Term, units


@dataclass(frozen=True, kw_only=True)
class Transmission(Source):
    """Errors of a joint's gear or screw: kinematic error, wind-up under load, lead error.

    The motor is in position, the joint is not. Kinematic error: a sum of ``amplitude · sin(2π order q/period + φ)`` with
    q the joint's value. The runout of a gear wheel has order 1, its teeth have their number as order, the wave generator
    of a strain wave gear twice the gear ratio (Tuttle and Seering, IEEE Transactions on Robotics and Automation 12,
    1996). Each φ is random, uniform over a turn, but the same at every pose of one built robot. A fixed amplitude t
    therefore gives the standard deviation t/√2, a random one ``√(E[t²]/2)``. Wind-up: ``τ/k`` with τ the torque (or
    force) of the load on the joint, as eq 23 of Wei, Jia and Chen (2015) with C = 1/k. Lead error of a screw or rack:
    ``lead_error · d``, the deviation of the specified travel in ISO 3408-3.

    Attributes:
        joint: The joint.
        amplitude: Amplitudes of the kinematic error, half of peak to peak, one or several: angles, or lengths for a
            prismatic joint. The phase covers both signs, so a law for an amplitude has its mean above zero.
        order: Number of repetitions of each in ``period``.
        period: Period of order 1 (default: a revolution of the joint). A prismatic joint needs it with amplitude: the
            lead of its screw.
        stiffness: k of the wind-up, of the whole drive train at the joint; a linear stiffness for a prismatic joint.
        lead_error: Lead error of a prismatic joint, relative to the travel from the joint's zero.

    Raises:
        InputError: No error, not one order for each amplitude, an order or period that is not positive, a stiffness
            that may reach zero, or a setting for the other kind of joint.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Transmission(joint="joint1", amplitude=(1e-4,), order=(2.0,))
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.019 0.264 0.   ]
    """

    takes_many: ClassVar[bool] = True
    is_in_drive: ClassVar[bool] = True
    deviations: ClassVar[tuple[str, ...]] = ("lead_error",)
    words: ClassVar[Mapping[str, str]] = {
        "amplitude": "gear error of {subject}, amplitude",
        "phase": "gear error of {subject}, phase",
        "stiffness": "gear stiffness of {subject}",
        "lead_error": "lead error of {subject}",
    }

    joint: str
    amplitude: Annotated[tuple[Setting, ...], units.PerJoint(units.ANGLE, units.LENGTH)] = ()
    order: Annotated[tuple[float, ...], units.RATIO] = ()
    period: Annotated[float | None, units.PerJoint(units.ANGLE, units.LENGTH)] = None
    stiffness: Annotated[Setting | None, units.PerJoint(units.ANGULAR_STIFFNESS, units.LINEAR_STIFFNESS)] = None
    lead_error: Annotated[Setting | None, units.RELATIVE_LENGTH] = None

    def __post_init__(self) -> None:
        if not self.amplitude and self.stiffness is None and self.lead_error is None:
            raise InputError("transmission needs one of amplitude:, stiffness: and lead_error:")
        if len(self.amplitude) != len(self.order):
            counts = f"{len(self.amplitude)} and {len(self.order)}"
            raise InputError(f"transmission needs one order: for each amplitude:, got {counts}")
        if not all(0 < order < math.inf for order in self.order):
            raise InputError("an order of transmission must be positive")
        if self.period is not None and not 0 < self.period < math.inf:
            raise InputError(f"the period of transmission must be positive, got {self.setting_text('period')}")
        if self.period is not None and not self.amplitude:
            raise InputError("period: of transmission is used only with amplitude:")

    @property
    def depends_on(self) -> Dependence:
        """The configuration, or the loads if there is a wind-up."""
        return "configuration" if self.stiffness is None else "loads"

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return a phase for each amplitude."""
        return tuple(phase_draw(f"{label}.{entry_name('phase', k)}") for k in range(len(self.amplitude)))

    def remarks(self, space: LabelledSpace) -> Iterator[Finding]:
        """Yield a warning for each amplitude that varies about zero."""
        for k, amplitude in enumerate(space.values("amplitude", self.amplitude)):
            yield from amplitude_remarks(entry_name("amplitude", k), amplitude, space)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield two terms for each amplitude, one for the lead, and one for each group of loads with the same factors."""
        joint = posture.chain.joint_index(self.joint)
        is_prismatic = bool(posture.chain.prismatic[joint])
        if is_prismatic and self.amplitude and self.period is None:
            raise InputError(f"{self.label()}: a prismatic joint needs period: with amplitude:")
        if not is_prismatic and self.lead_error is not None:
            raise InputError(f"{self.label()}: lead_error: is only for a prismatic joint")
        value = posture.q[joint]
        angle = 2 * math.pi * value / self.period if self.period is not None else value
        for k, amplitude in enumerate(space.values("amplitude", self.amplitude)):
            yield from periodic_terms(joint, self.order[k] * angle, amplitude, space, entry_name("phase", k))
        if self.lead_error is not None:
            yield Term.of(JointValue(joint), value, space.value("lead_error", self.lead_error))
        if self.stiffness is not None:
            flexibility = 1.0 / space.positive("stiffness", self.stiffness)
            for factors, torque in posture.torque_on(joint).items():
                yield Term.of(JointValue(joint), torque, *factors, flexibility, loaded=True)
