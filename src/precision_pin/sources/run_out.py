"""Run-out of a joint that turns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from precision_pin.base.arguments import check_choice
from precision_pin.sources.periodic import amplitude_remarks, phase_draw, phased_terms
from precision_pin.sources.places import seat_of, wrench_at
from precision_pin.terms import (
    Dependence,
    Draw,
    Finding,
    InputError,
    LabelledSpace,
    Posture,
    Setting,
    Source,
    Term,
    units,
)

_ROWS: Final[Mapping[str, tuple[int, ...]]] = {"radial": (0, 1), "axial": (2,), "tilt": (3, 4)}
"""Rows of ``[d; δ]`` in the seat's axes, by amplitude."""


@dataclass(frozen=True, kw_only=True)
class RunOut(Source):
    """Error motion of a rotary axis (ISO 230-7), repeated ``order`` times in a turn of the joint.

    It displaces the seat before the joint turns: radially by ``x = a cos(nθ + φ)``, ``y = a sin(nθ + φ)``, along the axis by
    ``z = b cos(nθ + φ)``, and tilts it by ``α = t cos(nθ + φ)``, ``β = t sin(nθ + φ)``, θ the joint's value and each φ random
    but the same at all poses of one robot. With independent phases x and y, and α and β, have each their own. Radial and
    tilt motion of order 1 in phase with the joint is geometry, ``Rot(θ) Trans(c) = Trans(Rot(θ) c) Rot(θ)``, and refused.

    Attributes:
        joint: The joint.
        radial, axial: Amplitudes a and b, half of peak to valley.
        tilt: Amplitude t.
        order: n, a whole number.
        phases: ``one`` for both directions (the axis whirls), or ``independent`` ones.
        at_height: Position on the axis, from the joint's origin, at which the radial motion is given.

    Raises:
        InputError: No amplitude, order 1 of radial or tilt motion, or a joint that slides.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.RunOut(joint="joint2", axial=1e-5, order=2)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e6 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.    7.071 0.   ]
    """

    depends_on: ClassVar[Dependence] = "configuration"
    takes_many: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {name: f"{name} run-out of {{subject}}" for name in _ROWS} | {
        f"{name}_phase": f"{name} run-out of {{subject}}, phase" for name in _ROWS
    }

    joint: str
    radial: Annotated[Setting | None, units.LENGTH] = None
    axial: Annotated[Setting | None, units.LENGTH] = None
    tilt: Annotated[Setting | None, units.ANGLE] = None
    order: Annotated[float, units.RATIO] = 1.0
    phases: Literal["one", "independent"] = "one"
    at_height: Annotated[float, units.LENGTH] = 0.0

    def __post_init__(self) -> None:
        if not self._amplitudes:
            raise InputError("run_out needs one of radial:, axial: and tilt:")
        if not (self.order >= 1 and float(self.order).is_integer()):
            raise InputError(f"order of run_out must be 1, 2, 3, …, got {self.order:g}")
        check_choice("phases of run_out", self.phases, ("one", "independent"))
        if self.order == 1 and self.phases == "one" and not self._amplitudes.keys() <= {"axial"}:
            raise InputError(
                "radial and tilt run-out of order 1 in phase with the joint is geometry, the same at every angle: give it as a "
                "frame or mcpc, or another order"
            )

    @property
    def _amplitudes(self) -> dict[str, Setting]:
        return {name: value for name in _ROWS if (value := getattr(self, name)) is not None}

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the phases."""
        return tuple(phase_draw(f"{label}.{name}") for name in dict.fromkeys(self._phase_names()))

    def _phase_names(self) -> Iterator[str]:
        for name in self._amplitudes:
            for k in range(len(_ROWS[name])):
                yield f"{name}_phase" + ("" if self.phases == "one" or k == 0 else f"[{k}]")

    def remarks(self, space: LabelledSpace) -> Iterator[Finding]:
        """Yield a warning for each amplitude that varies about zero."""
        for name, setting in self._amplitudes.items():
            yield from amplitude_remarks(name, space.value(name, setting), space)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield two terms for each direction."""
        chain = posture.chain
        joint = chain.joint_index(self.joint)
        if chain.prismatic[joint]:
            raise InputError(f"{self.label()}: run_out is of a joint that turns")
        place, to_place = seat_of(chain, joint)
        to_place = to_place @ wrench_at(self.at_height).T
        cosine, sine = np.cos(self.order * posture.q[joint]), np.sin(self.order * posture.q[joint])
        phases = self._phase_names()
        for name, setting in self._amplitudes.items():
            amplitude = space.value(name, setting)
            for k, row in enumerate(_ROWS[name]):
                # cos(nθ + φ) in the first direction, sin(nθ + φ) in the second
                slopes = (cosine, -sine) if k == 0 else (sine, cosine)
                twists = [np.multiply.outer(to_place[:, row], slope) for slope in slopes]
                yield from phased_terms(place, twists, amplitude, space, next(phases))
