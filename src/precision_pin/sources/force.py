"""Applied force and moment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from precision_pin.base.arguments import check_choice
from precision_pin.base.arrays import Array
from precision_pin.draws.draw import Scope
from precision_pin.draws.expressions import Value
from precision_pin.draws.laws import Sphere
from precision_pin.sources.places import block_diagonal
from precision_pin.terms import (
    Dependence,
    Draw,
    Expression,
    Factors,
    InputError,
    LabelledSpace,
    Load,
    Posture,
    Setting,
    Source,
    Term,
    units,
)


@dataclass(frozen=True, kw_only=True)
class Force(Source):
    """A force and a moment on the arm, as by a process, a cable or a person. It displaces nothing itself.

    It loads joints, bearings and links as a payload does, ``τ_k = a_k · ((p - p_k) × F + M)`` on a joint with axis a_k
    through p_k. A force with ``axes: base`` keeps its direction when the arm deflects (a dead load); with ``link`` or
    ``tool`` it turns with the arm (a follower load). They differ only with statics: equilibrium. A force of given magnitude
    and any direction is ``F = f u``, u uniform on the unit sphere. First order takes f at its mean: it sees F with the
    covariance f̄²/3 along every axis, where it is E f²/3.

    Attributes:
        at: The link on which it acts.
        force: Components of the force, any of them random.
        moment: Components of the moment, any of them random.
        magnitude: f of a force of any direction, in place of components.
        direction: ``any``, with ``magnitude``.
        point: Point at which it acts, in that link's frame.
        axes: Axes of the components: of the ``base``, of the ``link``, or of the ``tool`` (the tip; only for a force on the
            link that carries it).
        scope: How often a random direction is drawn: once for each ``unit``, at each ``pose`` or at each ``visit``.

    Raises:
        InputError: Neither or both of components and magnitude, or other axes, direction or scope.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Force(at="tool", force=(0.0, 0.0, -9.80665))
        >>> compliance = pp.sources.JointCompliance(joint="joint2", compliance=1e-5)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source, compliance]).at([0, 0, 0, 0])
        >>> print(round(1e3 * at.error_at_means[2], 3))
        -7.872
    """

    depends_on: ClassVar[Dependence] = "chain"
    is_put_down: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {
        "force": "force on {subject}",
        "moment": "moment on {subject}",
        "magnitude": "size of the force on {subject}",
        "direction": "direction of the force on {subject}",
    }

    at: str
    force: Annotated[tuple[Setting, ...], units.FORCE] = ()
    moment: Annotated[tuple[Setting, ...], units.TORQUE] = ()
    magnitude: Annotated[Setting | None, units.FORCE] = None
    direction: Literal["any"] | None = None
    point: Annotated[tuple[float, float, float], units.LENGTH] = (0.0, 0.0, 0.0)
    axes: Literal["base", "link", "tool"] = "base"
    scope: Literal["unit", "pose", "visit"] = "unit"

    def __post_init__(self) -> None:
        for name in ("force", "moment"):
            if len(getattr(self, name)) not in (0, 3):
                raise InputError(f"the {name}: of force has {len(getattr(self, name))} numbers, expected 3")
        if len(self.point) != 3:
            raise InputError(f"the point: of force has {len(self.point)} numbers, expected 3")
        check_choice("axes of force", self.axes, ("base", "link", "tool"))
        check_choice("scope of force", self.scope, tuple(scope.value for scope in Scope))
        if (self.magnitude is None) is not (self.direction is None):
            raise InputError("magnitude: of force needs direction: any; for a known direction give force:")
        if self.direction is not None:
            check_choice("direction of force", self.direction, ("any",))
        has_size = self.magnitude is not None
        if (has_size and self.force) or not (has_size or self.force or self.moment):
            raise InputError("force needs one of force: and magnitude:, or moment:")

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the numbers of a random direction; at their means the force is zero, as are other random forces."""
        if self.direction is None:
            return ()
        return (Draw(f"{label}.direction", Sphere(1.0), Scope(self.scope), (units.RATIO,) * 3),)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield nothing."""
        posture.chain.link_frame(self.at)
        return iter(())

    def loads(self, posture: Posture, space: LabelledSpace) -> Iterator[Load]:
        """Yield the load."""
        chain = posture.chain
        carrier = chain.link_frame(self.at)
        rotation = np.eye(3)
        if self.axes == "tool":
            if carrier.link != len(chain.joints):
                raise InputError(
                    f"{space.label}: axes: tool needs a force on the link that carries the tip; give axes: link"
                )
            rotation = carrier.frame[:3, :3].T @ chain.target_placement[:3, :3]
        to_axes = block_diagonal(rotation)
        values = [*enumerate(self._force(space)), *enumerate(space.values("moment", self.moment), start=3)]
        wrenches = tuple(_wrench(to_axes[:, row], value) for row, value in values)
        frame = carrier.frame_at(self.point)
        turns = self.axes != "base"
        yield Load(carrier.link, frame, carrier.entry(self.point), False, (), wrenches=wrenches, turns=turns)

    def _force(self, space: LabelledSpace) -> tuple[Value, ...]:
        if self.magnitude is None:
            return space.values("force", self.force)
        size = space.positive("magnitude", self.magnitude, zero=True)
        return tuple(size * space.component(f"direction.{axis}") for axis in "xyz")


def _wrench(unit: Array, value: Value) -> tuple[Array, Factors]:
    return (unit, (value,)) if isinstance(value, Expression) else (unit * value, ())
