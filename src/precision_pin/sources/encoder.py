"""Encoders."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

from precision_pin.draws.draw import Draw, Scope, Setting
from precision_pin.draws.laws import Uniform
from precision_pin.sources.periodic import amplitude_remarks, periodic_terms, phase_draw
from precision_pin.terms import Dependence, Finding, InputError, JointValue, LabelledSpace, Posture, Source, Term, units

_AT_JOINT: Final = units.PerJoint(units.ANGLE, units.LENGTH)
"""Quantity of a joint value."""


@dataclass(frozen=True, kw_only=True)
class Encoder(Source):
    """Errors of a joint's encoder: resolution, zero, eccentricity or another periodic error, scale.

    A controller holds the reading, so a reading that is too small means a joint value that is too large: every error
    here is true value minus reading and is added to the joint's value. Resolution: uniform, ± half a step (JCGM
    100:2008, F.2.2.1). Periodic: ``amplitude · sin(order · θ + φ)`` with θ the angle of the encoder's shaft. The phase
    φ is random, uniform over a turn, but the same at every pose of one built robot. A fixed amplitude t therefore gives
    the standard deviation t/√2, a random one ``√(E[t²]/2)``. A disc with an eccentricity e, read at radius r, gives the
    once-per-turn error of amplitude e/r, ±412 e/D arcsec for e in µm and the diameter D in mm (Heidenhain, Angle
    Encoders without Integral Bearing). The mean of two opposite heads cancels the odd orders, which include
    eccentricity. On the motor's side θ turns ``ratio`` times as fast as the joint, and a shaft error is 1/ratio of it
    at the joint. At a prismatic joint the linear encoder has ``sin(2π · order · d / period + φ)`` and a scale that is
    too long or too short: ``scale · d``.

    Attributes:
        joint: The joint.
        resolution: One step of the encoder's shaft, or of a linear encoder.
        scope: Scope of the resolution's error: ``pose`` (a pose is at one position within its step) or ``visit``.
        offset: Position of the encoder's zero on the joint's own scale, added to the joint's value. A reading that is
            too large by o is the offset -o.
        amplitude: Amplitude of the periodic error at the encoder's shaft, half of peak to peak. The phase covers both
            signs, so a law for the amplitude has its mean above zero.
        eccentricity, radius: Instead of amplitude: distance of the disc's centre from the shaft's axis, and mean
            radius of its graduation.
        order: Periods of the periodic error in a turn of the encoder's shaft, or in ``period``.
        heads: Reading heads, 1 or 2 opposite each other.
        ratio: Turns of the encoder's shaft for one turn of the joint: 1 on the joint's side, the gear ratio on the
            motor's.
        period: Length of one period of a linear encoder's periodic error.
        scale: Error of a linear encoder's pitch, relative to the travel from the joint's zero: positive if it is too
            long and the joint travels too far.

    Raises:
        InputError: No error, half of a pair, a step, radius, ratio or period out of range, or a setting for the other
            kind of joint.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Encoder(joint="joint1", resolution=1e-4)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.008 0.108 0.   ]
    """

    takes_many: ClassVar[bool] = True
    is_dimensional: ClassVar[bool] = True
    deviations: ClassVar[tuple[str, ...]] = ("offset", "scale")
    words: ClassVar[Mapping[str, str]] = {
        "offset": "encoder offset of {subject}",
        "amplitude": "encoder amplitude of {subject}",
        "eccentricity": "encoder eccentricity of {subject}",
        "scale": "encoder scale of {subject}",
        "phase": "encoder phase of {subject}",
        "quantisation": "encoder step of {subject}",
    }

    joint: str
    resolution: Annotated[float | None, _AT_JOINT] = None
    scope: Literal["pose", "visit"] = "pose"
    offset: Annotated[Setting | None, _AT_JOINT] = None
    amplitude: Annotated[Setting | None, _AT_JOINT] = None
    eccentricity: Annotated[Setting | None, units.LENGTH] = None
    radius: Annotated[float | None, units.LENGTH] = None
    order: int = 1
    heads: int = 1
    ratio: Annotated[float, units.RATIO] = 1.0
    period: Annotated[float | None, units.LENGTH] = None
    scale: Annotated[Setting | None, units.RELATIVE_LENGTH] = None

    def __post_init__(self) -> None:
        errors = (self.resolution, self.offset, self.amplitude, self.eccentricity, self.scale)
        if all(setting is None for setting in errors):
            raise InputError("encoder needs one of resolution:, offset:, amplitude:, eccentricity: and scale:")
        if self.amplitude is not None and self.eccentricity is not None:
            raise InputError("encoder needs one of amplitude: and eccentricity:")
        if (self.eccentricity is None) != (self.radius is None):
            raise InputError("encoder needs both of eccentricity: and radius:")
        if self.resolution is not None and not 0 <= self.resolution < math.inf:
            raise InputError(f"the resolution of encoder must be zero or more, got {self.setting_text('resolution')}")
        for name in ("radius", "ratio", "period"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise InputError(f"the {name} of encoder must be positive, got {self.setting_text(name)}")
        if self.order != int(self.order) or self.order < 1:
            raise InputError(f"the order of encoder must be 1, 2, 3, …, got {self.order}")
        if self.eccentricity is not None and self.order != 1:
            raise InputError(
                "eccentricity: of encoder is a once-per-turn error; give other orders with amplitude: and order:"
            )
        if self.heads not in (1, 2):
            raise InputError(f"heads: of encoder must be 1 or 2, got {self.heads}")
        if self.scope not in ("pose", "visit"):
            raise InputError(f"scope: of encoder must be pose or visit, got {self.scope!r}")

    @property
    def depends_on(self) -> Dependence:
        """The chain, or the configuration if the error depends on the joint value."""
        return "configuration" if self.scale is not None or self._is_periodic else "chain"

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the position within a step, and the phase."""
        draws = []
        if self.resolution is not None:
            step = self.resolution / self.ratio
            draws.append(Draw(f"{label}.quantisation", Uniform(step / 2), Scope(self.scope), (_AT_JOINT,)))
        if self._is_periodic:
            draws.append(phase_draw(f"{label}.phase"))
        return tuple(draws)

    def remarks(self, space: LabelledSpace) -> Iterator[Finding]:
        """Yield a warning if the amplitude or the eccentricity varies about zero."""
        for field in ("amplitude", "eccentricity"):
            setting = getattr(self, field)
            if setting is not None and self._is_periodic:
                yield from amplitude_remarks(field, space.value(field, setting), space)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each error, two for the periodic one."""
        joint = posture.chain.joint_index(self.joint)
        is_prismatic = bool(posture.chain.prismatic[joint])
        self._check_kind(is_prismatic)
        target, value = JointValue(joint), posture.q[joint]
        if self.resolution is not None:
            yield Term.of(target, 1.0, space.component("quantisation"))
        if self.offset is not None:
            yield Term.of(target, 1.0, space.value("offset", self.offset))
        if self.scale is not None:
            yield Term.of(target, value, space.value("scale", self.scale))
        if self._is_periodic:
            if self.amplitude is not None:
                amplitude = space.value("amplitude", self.amplitude)
            else:
                assert self.eccentricity is not None
                assert self.radius is not None
                amplitude = space.value("eccentricity", self.eccentricity) / self.radius
            angle = 2 * math.pi * value / self.period if self.period is not None else self.ratio * value
            yield from periodic_terms(joint, self.order * angle, amplitude / self.ratio, space, "phase")

    @property
    def _is_periodic(self) -> bool:
        """True if a periodic error remains after the heads."""
        has_amplitude = self.amplitude is not None or self.eccentricity is not None
        return has_amplitude and (self.heads == 1 or self.order % 2 == 0)

    def _check_kind(self, is_prismatic: bool) -> None:
        """Raise InputError if a setting is for the other kind of joint, or a linear encoder's period is missing."""
        if not is_prismatic:
            for name in ("period", "scale"):
                if getattr(self, name) is not None:
                    raise InputError(f"{self.label()}: {name}: is only for a prismatic joint")
            return
        if self.eccentricity is not None or self.heads != 1 or self.ratio != 1:
            raise InputError(f"{self.label()}: eccentricity:, heads: and ratio: are only for a revolute joint")
        if (self.amplitude is None) != (self.period is None):
            raise InputError(f"{self.label()}: a linear encoder needs both of amplitude: and period:")
