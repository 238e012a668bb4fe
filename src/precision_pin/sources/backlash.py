"""Backlash of a joint's drive."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from precision_pin.draws.draw import Draw, Scope, Setting
from precision_pin.draws.laws import Uniform
from precision_pin.sources.places import approach_name
from precision_pin.terms import Factors, InputError, JointValue, LabelledSpace, Posture, Source, Term, at_means, units
from precision_pin.terms.term import side_of


@dataclass(frozen=True, kw_only=True)
class Backlash(Source):
    """Backlash of a joint's drive: the load pushes the joint onto one flank, half the backlash from the middle of the gap.

    ``Δθ = sign(τ) b/2`` with τ the torque of the load on the joint, all parameters at their means, as in eq 23 of Wei,
    Jia and Chen (2015). If ``|τ|`` is below the band, friction holds the joint where it came to rest: ``Δθ = u b/2``
    with u uniform on -1 to 1; beside a servo or a gear with hysteresis ``-u b/2`` with their u, the direction in which the
    joint arrived. The side follows from the mean load, so it needs no random number and does not change
    with the scatter of the load. The deviation does not grow with the load and is no deflection; equilibrium statics
    takes the side from the deflected arm. There the band must exceed the change of the torque across the gap, since an
    arm that rests between the flanks has no side.

    At a pose with an approach, a joint that moved last in the direction s (1 or -1) against the friction F, the band,
    lies on the flank behind the drive, unless a load larger than the friction drives it: ``Δθ = sign(τ - s F) b/2``, so
    ``-s b/2`` up to ``s τ = F``. τ is each robot's own load, so the side flips with the scatter of the load. The
    derivative of the side by the load counts as zero.

    Attributes:
        joint: The joint.
        backlash: b, the whole gap from flank to flank, at the joint; a length for a prismatic joint.
        band: Torque (for a prismatic joint: force) below which the side is random: about the friction of the joint.
        scope: How often a random side is drawn: once for each ``unit``, at each ``pose`` or at each ``visit``.

    Raises:
        InputError: A band that is not positive, or a scope that is none of the three.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Backlash(joint="joint2", backlash=1e-3, band=5.0)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print(round(1e3 * at.error_at_means[2], 3))
        -1.87
    """

    takes_many: ClassVar[bool] = True
    is_in_drive: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {
        "backlash": "backlash of {subject}",
        "side": "side of the backlash of {subject}",
    }

    joint: str
    backlash: Annotated[Setting, units.PerJoint(units.ANGLE, units.LENGTH)]
    band: Annotated[float, units.PerJoint(units.TORQUE, units.FORCE)]
    scope: Literal["unit", "pose", "visit"] = "visit"

    def __post_init__(self) -> None:
        if not 0 < self.band < np.inf:
            raise InputError(f"the band of backlash must be positive, got {self.setting_text('band')}")
        allowed = [scope.value for scope in Scope]
        if self.scope not in allowed:
            raise InputError(f"scope of backlash must be one of {', '.join(allowed)}, got {self.scope!r}")

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the position in the gap, -1 to 1, for a load below the band."""
        return (Draw(f"{label}.side", Uniform(1.0), Scope(self.scope), (units.RATIO,)),)

    def idle_draws(self, label: str, names: Collection[str]) -> Collection[str]:
        """Return the position in the gap if a servo or gear of the joint has the direction in which it arrived."""
        return (f"{label}.side",) if self.scope == "visit" and approach_name(self.joint) in names else ()

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield one term, or one for each way in which it arises at P configurations."""
        joint = posture.chain.joint_index(self.joint)
        gap = space.positive("backlash", self.backlash, zero=True)
        direction = np.asarray(posture.direction_of(joint))
        if direction.any():
            # friction minus load, in the direction of motion: not negative on the flank behind the drive
            margin: dict[Factors, Any] = {(): self.band}
            for factors, share in (posture.deciding or posture).torque_on(joint).items():
                margin[factors] = margin.get(factors, 0.0) - direction * share
            yield Term.of(JointValue(joint), -direction / 2, gap, side_of(margin, space.space))
        torque = at_means(posture.torque_on(joint), space.space)
        is_pressed = (direction == 0) & (np.abs(torque) >= self.band)
        is_held = (direction == 0) & ~is_pressed
        if is_pressed.any():
            yield Term.of(JointValue(joint), np.sign(torque) / 2 * is_pressed, gap)
        if is_held.any() and self.idle_draws(space.label, space.space.index):
            # one direction for all of them
            approach = space.space.parameter(approach_name(self.joint))
            yield Term.of(JointValue(joint), -0.5 * is_held, gap, approach)
        elif is_held.any():
            yield Term.of(JointValue(joint), 0.5 * is_held, gap, space.component("side"))
