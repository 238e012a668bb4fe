"""Axis installation errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from precision_pin.draws.laws import Disc
from precision_pin.sources.places import seat_of
from precision_pin.terms import Dependence, Draw, InputError, LabelledSpace, Posture, Scope, Source, Term, units


@dataclass(frozen=True, kw_only=True)
class AxisInstall(Source):
    """Installation error of a joint's axis: the real axis passes through two points near the nominal axis.

    In the joint's frame turned so that z is the axis, the real axis passes through A in the plane z = start and B in
    the plane z = start + span, each uniform over a disc about the nominal axis. With ``AE = (x_B - x_A, y_B - y_A)``
    and ``L = span`` the joint's seat is displaced by ``d = A - AE·start/L`` and ``δ = (-AE_y, AE_x, 0)/L``. Source: eqs
    18 and 19 of Wei, Jia and Chen (2015); eq 19 prints the angles before the position, and has no span; the result is
    nearly proportional to 1/span. The points belong to the joint's parent link in the file, even if the base is beyond
    the joint.

    Attributes:
        joint: The joint.
        radius, diameter: Radius or diameter of the discs; give one of the two.
        span: Distance between the two planes (between the bearings).
        start: Position of the first plane on the axis as written in the file, from the joint's origin.

    Raises:
        InputError: Not exactly one of radius and diameter; a span that is not positive.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.AxisInstall(joint="joint2", radius=0.1e-3, span=0.1)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.232 2.645 0.232]
    """

    depends_on: ClassVar[Dependence] = "chain"
    is_dimensional: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {"A": "axis of {subject}, bearing A", "B": "axis of {subject}, bearing B"}

    joint: str
    radius: Annotated[float | None, units.LENGTH] = None
    diameter: Annotated[float | None, units.LENGTH] = None
    span: Annotated[float, units.LENGTH]
    start: Annotated[float, units.LENGTH] = 0.0

    def __post_init__(self) -> None:
        if (self.radius is None) == (self.diameter is None):
            raise InputError("axis_install needs either radius: or diameter:")
        if not (self.radius or self.diameter or 0.0) >= 0:
            raise InputError("the radius or diameter of axis_install must not be negative")
        if not self.span > 0:
            raise InputError(f"the span of axis_install must be positive, got {self.setting_text('span')}")

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the two points A and B."""
        radius = self.radius if self.radius is not None else (self.diameter or 0.0) / 2
        return tuple(Draw(f"{label}.{point}", Disc(radius), Scope.UNIT, (units.LENGTH,) * 2) for point in ("A", "B"))

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each coordinate of A and B."""
        chain = posture.chain
        joint = chain.joint_index(self.joint)
        place, axes = seat_of(chain, joint)
        crossing = self.start / self.span
        for point, share, sign in (("A", 1 + crossing, -1.0), ("B", -crossing, 1.0)):
            slope = sign / self.span
            yield Term.of(place, axes @ [share, 0, 0, 0, slope, 0], space.component(f"{point}.x"))
            yield Term.of(place, axes @ [0, share, 0, -slope, 0, 0], space.component(f"{point}.y"))
