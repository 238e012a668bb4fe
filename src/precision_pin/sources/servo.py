"""Position servo of a joint: droop under load, and the dead band of its friction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

from precision_pin.base.arguments import check_choice
from precision_pin.sources.places import approach_draw, approach_of
from precision_pin.sources.published import take_published
from precision_pin.terms import (
    Array,
    Draw,
    InputError,
    JointValue,
    LabelledSpace,
    Posture,
    Setting,
    Source,
    Term,
    at_means,
    units,
)
from precision_pin.terms.term import side_of


@dataclass(frozen=True, kw_only=True)
class Servo(Source):
    """A servo without integral action gives way under load, and its friction stops the joint short.

    ``Δθ = (τ - γ τ_m - s F) / k`` with τ the torque of the load on the joint, τ_m the torque of the weights that the
    controller knows, at the commanded pose, and ``F = F0 + μ |τ|`` the friction; s is 1 or -1, the direction in which the
    joint moved last. At a pose without an approach, s is a random number u, uniform on -1 to 1, one for each joint and
    visit. The load is there while the joint arrives. The balance holds for every robot's own load, also beyond the
    friction: an unlocked joint follows both. With integral action nothing of this remains.

    Left out: Stribeck and viscous friction, the lower friction after a fast stop, and a force that comes after the stop,
    which a joint at rest resists up to 2F.

    Attributes:
        joint: The joint.
        stiffness: k, torque by angle at the joint; a linear stiffness for a prismatic joint.
        friction: F0, dry friction of the joint and its drive as the motor feels it; a force for a prismatic joint.
        load_friction: μ, friction relative to the load.
        gravity_compensation: γ, share of the known weights that the controller compensates.
        compensates: The weights that the controller knows: ``all`` of them, payloads at their means, or those of the URDF's
            ``links``. Never a ``force`` nor what is random.
        encoder: Where the joint is measured: at the ``motor``, or at the ``joint``, which removes errors of the drive.
        integral: Whether the controller has integral action.
        servo: Name of a published servo, whose figures stand for the settings that are left out.

    Raises:
        InputError: A servo that is not published, no stiffness or one that may reach zero, a negative friction or share, or
            a choice that does not exist.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Servo(joint="joint2", stiffness=1e5, friction=5.0)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print(round(1e3 * at.error_at_means[2], 3))
        -6.501
    """

    takes_many: ClassVar[bool] = True
    holds_joint: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {
        "stiffness": "servo stiffness of {subject}",
        "friction": "friction of {subject}",
        "load_friction": "friction of {subject} by load",
        "gravity_compensation": "gravity compensation of {subject}",
        "approach": "direction in which {subject} arrived",
    }

    joint: str
    stiffness: Annotated[Setting | None, units.PerJoint(units.ANGULAR_STIFFNESS, units.LINEAR_STIFFNESS)] = None
    friction: Annotated[Setting | None, units.PerJoint(units.TORQUE, units.FORCE)] = None
    load_friction: Annotated[Setting, units.RATIO] = 0.0
    gravity_compensation: Annotated[Setting, units.RATIO] = 0.0
    compensates: Literal["all", "links"] = "all"
    encoder: Literal["motor", "joint"] = "motor"
    integral: bool = False
    servo: str | None = None

    def __post_init__(self) -> None:
        take_published(self, "servo")
        if self.stiffness is None:
            raise InputError("servo needs stiffness:, or servo: with the name of a published one")
        check_choice("compensates of servo", self.compensates, ("all", "links"))
        check_choice("encoder of servo", self.encoder, ("motor", "joint"))

    def clash(self, sources: Sequence[Source]) -> str:
        """Return an error for a second servo on the joint, or errors of a drive that the encoder sees."""
        others = [other for other in sources if other.subject == self.joint and other is not self]
        if any(isinstance(other, Servo) for other in others):
            return f"two servos on the joint {self.joint!r}; give one, with the stiffness of both"
        drive = [other.label() for other in others if other.is_in_drive]
        if drive and self.encoder == "joint":
            return (
                f"an encoder at the joint sees the errors of {drive[0]}, so the servo removes them; give one of the two"
            )
        return ""

    @property
    def has_friction(self) -> bool:
        """Whether the direction of the last motion matters."""
        return not self.integral and not (self.friction in (None, 0.0) and self.load_friction == 0.0)

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the direction of the last motion where no approach gives it."""
        return (approach_draw(self.joint),) if self.has_friction else ()

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield terms for the load by group, its compensation, and the friction."""
        joint = posture.chain.joint_index(self.joint)
        if self.servo is not None and posture.chain.prismatic[joint]:
            raise InputError(f"{self.label()}: servo: is only for a revolute joint")
        assert self.stiffness is not None
        target, flexibility = JointValue(joint), 1.0 / space.positive("stiffness", self.stiffness)
        if self.integral:
            return
        torques = posture.torque_on(joint)
        for factors, torque in torques.items():
            yield Term.of(target, torque, *factors, flexibility, loaded=True)
        share = space.positive("gravity_compensation", self.gravity_compensation, zero=True)
        if share != 0.0:
            yield Term.of(target, -self._known_torque(posture, joint, space), share, flexibility)
        if not self.has_friction:
            return
        friction = space.positive("friction", 0.0 if self.friction is None else self.friction, zero=True)
        directions = list(approach_of(posture, self.joint, space))
        for direction, approach in directions:
            yield Term.of(target, -direction, *approach, friction, flexibility)
        coefficient = space.positive("load_friction", self.load_friction, zero=True)
        if coefficient != 0.0:
            side = side_of((posture.deciding or posture).torque_on(joint), space.space)
            for direction, approach in directions:
                for factors, torque in torques.items():
                    twist = -torque * direction
                    yield Term.of(target, twist, *factors, *approach, side, coefficient, flexibility, loaded=True)

    def _known_torque(self, posture: Posture, joint: int, space: LabelledSpace) -> Array:
        loads = posture.chain.loads if self.compensates == "links" else posture.loads
        weights = tuple(replace(load, wrenches=()) for load in loads if load.moments)
        commanded = replace(posture, loads=weights, tilts=(), deflection=None)
        return at_means(commanded.torque_on(joint), space.space)
