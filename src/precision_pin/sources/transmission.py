"""Transmissions: gears and screws."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, cast

import numpy as np

from precision_pin.draws.expressions import Value, sign
from precision_pin.draws.space import LabelledSpace, entry_name
from precision_pin.sources.periodic import amplitude_remarks, periodic_terms, phase_draw
from precision_pin.sources.places import approach_draw, approach_of
from precision_pin.sources.published import take_published
from precision_pin.terms import (
    Array,
    Dependence,
    Draw,
    Expression,
    Finding,
    InputError,
    JointValue,
    Posture,
    Setting,
    Source,
    Term,
    units,
)
from precision_pin.terms.term import DifferentFormulas, bounds_of, load_value, side_of

_LOST: Final = 0.03
"""Torque at which lost motion is measured, as a share of the rated torque."""


@dataclass(frozen=True, kw_only=True)
class Transmission(Source):
    """Errors of a joint's gear or screw: kinematic error, wind-up under load, lead error.

    The motor is in position, the joint is not. Kinematic error: a sum of ``amplitude · sin(2π order q/period + φ)`` with
    q the joint's value. The runout of a gear wheel has order 1, its teeth have their number as order, the wave generator
    of a strain wave gear twice the gear ratio (Tuttle and Seering, IEEE Transactions on Robotics and Automation 12,
    1996). Each φ is random, uniform over a turn, but the same at every pose of one built robot. A fixed amplitude t
    therefore gives the standard deviation t/√2, a random one ``√(E[t²]/2)``. Wind-up: ``τ/k`` with τ the torque (or
    force) of the load on the joint, as eq 23 of Wei, Jia and Chen (2015) with C = 1/k; with stiffnesses K_i in pieces up to
    the torques T_i, ``φ(τ) = sign τ Σ (clamp(|τ|, T_(i-1), T_i) - T_(i-1)) / K_i`` of every robot's own torque (manual 1018856
    of Harmonic Drive, 2018). Hysteresis: the joint trails its motion by half the loss, ``-s h``. Lead error of a screw or rack:
    ``lead_error · d``, the deviation of the specified travel in ISO 3408-3.

    Attributes:
        joint: The joint.
        amplitude: Amplitudes of the kinematic error, half of peak to peak, one or several: angles, or lengths for a
            prismatic joint. The phase covers both signs, so a law for an amplitude has its mean above zero.
        order: Number of repetitions of each in ``period``.
        period: Period of order 1 (default: a revolution of the joint). A prismatic joint needs it with amplitude: the
            lead of its screw.
        stiffness: k of the wind-up, of the whole drive train at the joint, or K_i of its pieces from zero torque on; linear
            stiffnesses for a prismatic joint.
        limit_torques: T_i at which the pieces end, rising; forces for a prismatic joint.
        stiffness_factor: Relative deviation of all pieces, the same for all.
        lost_motion, rated_torque: In place of a first piece: the width between 3 % of the rated torque either way. The
            stiffness is that beyond.
        hysteresis_loss: Full width 2h of the loop, as printed.
        lead_error: Lead error of a prismatic joint, relative to the travel from the joint's zero.
        gear: Name of a published gear, whose figures stand for the settings that are left out; a stiffness that is given
            replaces all its pieces.

    Raises:
        InputError: A gear that is not published, no error, not one order for each amplitude, an order or period that is
            not positive, a stiffness that may reach zero, pieces without their limits, or a setting for the other kind
            of joint.

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
        "stiffness_factor": "gear stiffness of {subject}, deviation",
        "lost_motion": "lost motion of {subject}",
        "hysteresis_loss": "hysteresis loss of {subject}",
        "approach": "direction in which {subject} arrived",
        "lead_error": "lead error of {subject}",
    }

    joint: str
    amplitude: Annotated[tuple[Setting, ...], units.PerJoint(units.ANGLE, units.LENGTH)] = ()
    order: Annotated[tuple[float, ...], units.RATIO] = ()
    period: Annotated[float | None, units.PerJoint(units.ANGLE, units.LENGTH)] = None
    stiffness: Annotated[
        Setting | tuple[Setting, ...] | None, units.PerJoint(units.ANGULAR_STIFFNESS, units.LINEAR_STIFFNESS)
    ] = None
    limit_torques: Annotated[tuple[float, ...], units.PerJoint(units.TORQUE, units.FORCE)] = ()
    stiffness_factor: Annotated[Setting | None, units.RATIO] = None
    lost_motion: Annotated[Setting | None, units.PerJoint(units.ANGLE, units.LENGTH)] = None
    rated_torque: Annotated[float | None, units.PerJoint(units.TORQUE, units.FORCE)] = None
    hysteresis_loss: Annotated[Setting | None, units.PerJoint(units.ANGLE, units.LENGTH)] = None
    lead_error: Annotated[Setting | None, units.RELATIVE_LENGTH] = None
    gear: str | None = None

    def __post_init__(self) -> None:
        take_published(self, "gear", "stiffness", "limit_torques")
        if self.gear is not None and self.limit_torques and self.stiffness is None:
            raise InputError("limit_torques: of transmission beside gear: need the stiffness: of their pieces too")
        if not self.amplitude and all(
            value is None for value in (self.stiffness, self.lead_error, self.hysteresis_loss)
        ):
            raise InputError(
                "transmission needs one of amplitude:, stiffness:, hysteresis_loss:, lead_error: and gear:"
            )
        self._check_pieces()
        if len(self.amplitude) != len(self.order):
            counts = f"{len(self.amplitude)} and {len(self.order)}"
            raise InputError(f"transmission needs one order: for each amplitude:, got {counts}")
        if not all(0 < order < math.inf for order in self.order):
            raise InputError("an order of transmission must be positive")
        if self.period is not None and not 0 < self.period < math.inf:
            raise InputError(f"the period of transmission must be positive, got {self.setting_text('period')}")
        if self.period is not None and not self.amplitude:
            raise InputError("period: of transmission is used only with amplitude:")

    def _check_pieces(self) -> None:
        pieces, limits = self._pieces, self.limit_torques
        if (self.lost_motion is None) is not (self.rated_torque is None):
            raise InputError("transmission needs both of lost_motion: and rated_torque:")
        if self.lost_motion is not None and (len(pieces) != 1 or limits):
            raise InputError("lost_motion: of transmission needs one stiffness:, that beyond it, and no limit_torques:")
        if self.rated_torque is not None and not 0 < self.rated_torque < math.inf:
            raise InputError(
                f"the rated_torque of transmission must be positive, got {self.setting_text('rated_torque')}"
            )
        if len(limits) != max(len(pieces) - 1, 0):
            raise InputError(
                f"transmission needs a limit torque between every two pieces of stiffness:, got {len(limits)} for {len(pieces)}"
            )
        if any(low >= high for low, high in zip((0.0, *limits), limits, strict=False)):
            raise InputError("the limit_torques of transmission must be positive and rise")
        if self.stiffness_factor is not None and not pieces:
            raise InputError("stiffness_factor: of transmission is used only with stiffness:")

    @property
    def _pieces(self) -> tuple[Setting, ...]:
        if self.stiffness is None:
            return ()
        return self.stiffness if isinstance(self.stiffness, tuple) else (self.stiffness,)

    @property
    def depends_on(self) -> Dependence:
        """The configuration, or the loads if there is a wind-up."""
        return "configuration" if self.stiffness is None and self.hysteresis_loss is None else "loads"

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return a phase for each amplitude, and how the joint arrived if that matters."""
        phases = (phase_draw(f"{label}.{entry_name('phase', k)}") for k in range(len(self.amplitude)))
        return (*phases, *((approach_draw(self.joint),) if self.hysteresis_loss is not None else ()))

    def remarks(self, space: LabelledSpace) -> Iterator[Finding]:
        """Yield a warning for each amplitude that varies about zero."""
        for k, amplitude in enumerate(space.values("amplitude", self.amplitude)):
            yield from amplitude_remarks(entry_name("amplitude", k), amplitude, space)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield two terms for each amplitude, one for the lead, and those of wind-up and hysteresis."""
        joint = posture.chain.joint_index(self.joint)
        is_prismatic = bool(posture.chain.prismatic[joint])
        if is_prismatic and self.amplitude and self.period is None:
            raise InputError(f"{self.label()}: a prismatic joint needs period: with amplitude:")
        if not is_prismatic and self.lead_error is not None:
            raise InputError(f"{self.label()}: lead_error: is only for a prismatic joint")
        if is_prismatic and self.gear is not None:
            raise InputError(f"{self.label()}: gear: is only for a revolute joint")
        value = posture.q[joint]
        angle = 2 * math.pi * value / self.period if self.period is not None else value
        for k, amplitude in enumerate(space.values("amplitude", self.amplitude)):
            yield from periodic_terms(joint, self.order[k] * angle, amplitude, space, entry_name("phase", k))
        if self.lead_error is not None:
            yield Term.of(JointValue(joint), value, space.value("lead_error", self.lead_error))
        if self.stiffness is not None:
            yield from self._wind_up(posture, joint, space)
        if self.hysteresis_loss is not None:
            width = space.positive("hysteresis_loss", self.hysteresis_loss, zero=True)
            for direction, approach in approach_of(posture, self.joint, space):
                yield Term.of(JointValue(joint), -0.5 * direction, *approach, width)

    def _flexibilities(self, space: LabelledSpace) -> tuple[tuple[float, ...], list[Value]]:
        """Return the torques between the pieces, and the flexibility of each."""
        values = [1.0 / space.positive(entry_name("stiffness", k), setting) for k, setting in enumerate(self._pieces)]
        limits = self.limit_torques
        if self.lost_motion is not None and self.rated_torque is not None:
            limits = (_LOST * self.rated_torque,)
            values.insert(0, space.positive("lost_motion", self.lost_motion) * (0.5 / limits[0]))
        if self.stiffness_factor is not None:
            deviation = space.value("stiffness_factor", self.stiffness_factor)
            if space.interval(deviation)[0] <= -1.0:
                raise InputError(f"stiffness_factor of {space.label} can reach -100 %, no stiffness at all")
            values = [value / (1.0 + deviation) for value in values]
        return limits, values

    def _wind_up(self, posture: Posture, joint: int, space: LabelledSpace) -> Iterator[Term]:
        """Yield τ times the first flexibility, and beyond each limit the change of the flexibility times what exceeds it."""
        limits, flexibilities = self._flexibilities(space)
        torques = posture.torque_on(joint)
        for factors, torque in torques.items():
            yield Term.of(JointValue(joint), torque, *factors, flexibilities[0], loaded=True)
        if not limits:
            return
        # the load of each robot decides about its piece; derivatives take the piece as it is
        deciding = (posture.deciding or posture).torque_on(joint)
        low, high = bounds_of(deciding, space.space)
        side = side_of(deciding, space.space)
        for limit, before, after in zip(limits, flexibilities, flexibilities[1:], strict=False):
            is_within = (low >= -limit) & (high <= limit)
            if np.all(is_within):
                continue
            beyond: Value | Array = np.where(is_within, 0.0, 1.0)
            if not np.all(is_within | (low >= limit) | (high <= -limit)):
                if low.ndim:
                    raise DifferentFormulas
                load = cast("Expression", load_value(deciding))
                beyond = (1.0 + sign(load * load - limit**2)) / 2
            change = after - before
            for factors, torque in torques.items():
                yield Term.of(JointValue(joint), torque, *factors, beyond, change, loaded=True)
            yield Term.of(JointValue(joint), -limit, side, beyond, change)
