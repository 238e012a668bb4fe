"""Clearance of a joint's bearings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal, cast

import numpy as np

from precision_pin.draws.draw import Draw, Scope, Setting
from precision_pin.draws.expressions import Constant, Value, sign, sqrt
from precision_pin.draws.laws import Circle, Disc, Uniform
from precision_pin.draws.space import LabelledSpace, Space, entry_name
from precision_pin.sources.places import PadsOn, height_above_seat, seat_of, seat_wrench, shift_of_point, travels
from precision_pin.terms import Array, Chain, Dependence, Factors, InputError, Posture, Source, Term, at_means, units
from precision_pin.terms.term import DifferentFormulas, bounds_of, is_same_for_all, load_value, side_of

_NOTHING: Final = 1e-12
"""Fraction of the band added to a load, squared, so that a zero load has a direction; changes no other load's digits."""


@dataclass(frozen=True, kw_only=True)
class Clearance(Source):
    """Clearance of a joint's two bearings: each journal is off centre by half the diametral clearance.

    The bearings are on the axis at A, ``z = start``, and B, ``z = start + span``. With ``direction: load`` the load
    presses a journal against its bearing, along the bearing's reaction. The loads are those of a beam on two supports:
    with F and M of all loads beyond the joint, all parameters at their means, about the joint's origin, ``P_B = ((M_y,
    -M_x) - z_A (F_x, F_y)) / span`` and ``P_A = (F_x, F_y) - P_B``. If a load is below the band, or with ``direction:
    random``, the journal is off centre in a random direction: always in contact, on a circle (Ting, Zhu and Watkins,
    Mechanism and Machine Theory 35, 2000), or anywhere in the disc (Zhu and Ting, ASME DETC 1998). The axis runs
    through both journals, which displaces the seat as in eqs 18 and 19 of Wei, Jia and Chen (2015). Random directions are
    fixed in the joint's parent link in the file, even if the base is beyond the joint. Axial play shifts
    the seat by half the play to the side of the axial force; if that force is below the band, or with ``direction:
    random``, uniformly between minus and plus this half.

    The direction is that of the mean load, regardless of the scatter of the load. At a pose with an approach of the
    joint, the load of each robot decides between this direction and a random one, and gives the direction. The sign of
    the approach does not matter: friction makes a journal climb against its rotation by the angle of friction, which no
    setting gives, and play along the axis has no direction of motion. The shift does not grow with the load and is no
    deflection: equilibrium statics turns it with the deflected arm, but takes no derivative of it.

    A prismatic joint runs on two pads with the same lateral play in every direction; its play along the axis is
    ``backlash``, and this source does not turn it about the axis.

    Attributes:
        joint: The joint.
        diametral: Total radial play, from one side to the opposite one: bore minus journal. One value for both
            bearings, or two values, for A and for B.
        span: Distance between the bearings.
        start: Position of bearing A on the axis as written in the file, from the joint's origin.
        axial: Total axial play, from one end to the other; not for a prismatic joint.
        direction: Direction of the shifts: ``load`` or ``random``.
        band: Load of a bearing below which its direction is random; only with ``direction: load``.
        law: Law of a random direction: ``circle`` (in contact) or ``disc``.
        scope: How often a random direction is drawn: once for each ``unit``, at each ``pose`` or at each ``visit``.
        pads_on: For a prismatic joint: the link that the pads are fixed to, ``child`` (a carriage, which travels along
            its rail; ``start`` is measured from the joint's frame after its motion) or ``parent`` (fixed guides).

    Raises:
        InputError: Not one or two diametral clearances, a span or band that is not positive, a band that is missing or
            not needed, or a word that is none of those above.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Clearance(joint="joint2", diametral=(0.04e-3,), span=0.1, band=5.0)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print(round(1e3 * at.error_at_means[2], 3))
        -0.13
    """

    words: ClassVar[Mapping[str, str]] = {
        "diametral": "bearing clearance of {subject}",
        "axial": "axial play of {subject}",
        "A": "play in bearing A of {subject}",
        "B": "play in bearing B of {subject}",
        "side": "side of the axial play of {subject}",
    }

    joint: str
    diametral: Annotated[tuple[Setting, ...], units.LENGTH]
    span: Annotated[float, units.LENGTH]
    start: Annotated[float, units.LENGTH] = 0.0
    axial: Annotated[Setting, units.LENGTH] = 0.0
    direction: Literal["load", "random"] = "load"
    band: Annotated[float | None, units.FORCE] = None
    law: Literal["circle", "disc"] = "circle"
    scope: Literal["unit", "pose", "visit"] = "visit"
    pads_on: PadsOn = "child"

    def __post_init__(self) -> None:
        if not isinstance(self.diametral, tuple) or len(self.diametral) not in (1, 2):
            raise InputError("clearance needs one or two diametral: clearances, of both bearings or of A and of B")
        if not 0 < self.span < np.inf:
            raise InputError(f"the span of clearance must be positive, got {self.setting_text('span')}")
        for name, allowed in (
            ("direction", ("load", "random")),
            ("law", ("circle", "disc")),
            ("scope", tuple(scope.value for scope in Scope)),
            ("pads_on", ("child", "parent")),
        ):
            if getattr(self, name) not in allowed:
                raise InputError(
                    f"{name} of clearance must be one of {', '.join(allowed)}, got {getattr(self, name)!r}"
                )
        if self.direction == "load" and self.band is None:
            raise InputError("clearance with direction: load needs band:, the load below which a direction is random")
        if self.direction == "random" and self.band is not None:
            raise InputError("band: of clearance is used only with direction: load")
        if self.band is not None and not 0 < self.band < np.inf:
            raise InputError(f"the band of clearance must be positive, got {self.setting_text('band')}")

    @property
    def depends_on(self) -> Dependence:
        """The loads if they decide the direction; else the configuration, since a carriage may travel."""
        return "loads" if self.direction == "load" else "configuration"

    def accepts_many(self, chain: Chain) -> bool:
        """Return whether the pads do not travel."""
        return not travels(chain, chain.joint_index(self.joint), self.pads_on)

    def is_alike_everywhere(self, chain: Chain) -> bool:
        """Return whether the directions are random and the pads do not travel."""
        return self.direction == "random" and self.accepts_many(chain)

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the random directions of A and B, of unit radius, and the axial side, -1 to 1."""
        scope = Scope(self.scope)
        unit = Circle(1.0) if self.law == "circle" else Disc(1.0)
        draws = [Draw(f"{label}.{name}", unit, scope, (units.RATIO,) * 2) for name in ("A", "B")]
        if self.axial != 0.0:
            draws.append(Draw(f"{label}.side", Uniform(1.0), scope, (units.RATIO,)))
        return tuple(draws)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield one term for a journal placed by the mean load, two for any other, and one for the axial play.

        If each robot's load decides, or at P configurations, there are terms for both outcomes.
        """
        chain = posture.chain
        joint = chain.joint_index(self.joint)
        if chain.prismatic[joint] and self.axial != 0.0:
            raise InputError(
                f"{self.joint} slides: give its play along the axis as backlash, not as axial: of clearance"
            )
        place, to_place = seat_of(chain, joint)
        load = at_means(seat_wrench(posture, joint), space.space)
        load = load if load.ndim else np.zeros(6)
        is_approached = np.any(posture.direction_of(joint))
        robot_wrenches = seat_wrench(posture.deciding or posture, joint) if is_approached else {}
        if load.ndim > 1 and self.band is not None and not is_same_for_all(robot_wrenches):
            raise DifferentFormulas
        height_a = height_above_seat(posture, joint, self.start, self.pads_on)
        height_b = height_a + self.span
        size_a, *others = [
            space.positive(entry_name("diametral", k), size, zero=True) for k, size in enumerate(self.diametral)
        ]
        size_b = others[0] if others else size_a
        for name, height, other, size in (("A", height_a, height_b, size_a), ("B", height_b, height_a, size_b)):
            shift = shift_of_point(height, other)
            force = shift.T @ load
            robot_directions = self._radial_directions(
                {factors: shift.T @ wrench for factors, wrench in robot_wrenches.items()}, space.space
            )
            components = [space.component(f"{name}.{axis}") for axis in "xy"]
            if robot_directions is not None:
                *directions, free = robot_directions
                for column, share, component in zip(shift.T, directions, components, strict=True):
                    yield Term.of(place, to_place @ column, *_half_factors(size), share)
                    if free != 0.0:
                        yield Term.of(place, to_place @ column, *_half_factors(size), free, component)
                continue
            amount = np.sqrt(np.einsum("k...,k...->...", force, force))
            is_pressed = amount >= self._threshold
            if is_pressed.any():
                twist = to_place @ shift @ (force * is_pressed) / np.where(is_pressed, amount, 1.0)
                yield Term.of(place, twist, *_half_factors(size))
            if not is_pressed.all():
                for column, component in zip(shift.T, components, strict=True):
                    twist = np.multiply.outer(to_place @ column, ~is_pressed)
                    yield Term.of(place, twist, *_half_factors(size), component)
        if self.axial != 0.0:
            along = to_place[:, 2]
            size = space.positive("axial", self.axial, zero=True)
            sides = self._axial_sides({factors: wrench[2] for factors, wrench in robot_wrenches.items()}, space.space)
            if sides is not None:
                side, free = sides
                yield Term.of(place, along, *_half_factors(size), side)
                if free != 0.0:
                    yield Term.of(place, along, *_half_factors(size), free, space.component("side"))
                return
            is_pressed = np.abs(load[2]) >= self._threshold
            if is_pressed.any():
                yield Term.of(place, np.multiply.outer(along, np.sign(load[2]) * is_pressed), *_half_factors(size))
            if not is_pressed.all():
                twist = np.multiply.outer(along, ~is_pressed)
                yield Term.of(place, twist, *_half_factors(size), space.component("side"))

    @property
    def _threshold(self) -> float:
        """Load from which on the mean load gives the direction."""
        return math.inf if self.band is None else self.band

    def _radial_directions(self, forces: Mapping[Factors, Array], space: Space) -> tuple[Value, Value, Value] | None:
        """Return the load direction ``(x, y)`` on a journal, and 1 in robots with a load below the band, else 0."""
        # the direction is zero below the band; `None` if no robot's load decides, or all robots have equal loads
        if self.band is None or is_same_for_all(forces):
            return None
        x, y = ({factors: float(force[k]) for factors, force in forces.items()} for k in range(2))
        bounds = [(float(low), float(high)) for low, high in (bounds_of(x, space), bounds_of(y, space))]
        lowest, highest = (math.hypot(*map(distance, bounds)) for distance in (_nearest, _farthest))
        if highest < self.band:
            return None
        along_x, along_y = load_value(x), load_value(y)
        # never zero, and exact if the load decides
        length = sqrt(Constant((_NOTHING * self.band) ** 2) + along_x * along_x + along_y * along_y)
        if self.band <= lowest:
            return along_x / length, along_y / length, 0.0
        contact = (sign(length - self.band) + 1.0) * 0.5
        return along_x / length * contact, along_y / length * contact, 1.0 - contact

    def _axial_sides(self, force: Mapping[Factors, float], space: Space) -> tuple[Value, Value] | None:
        """Return the side of the axial load (1, -1, or 0 below the band), and 1 in robots below the band, else 0."""
        # `None` if all robots have equal loads
        if self.band is None or is_same_for_all(force):
            return None
        shifted = ({**force, (): force.get((), 0.0) + shift} for shift in (-self.band, self.band))
        above, below = (cast("Value", side_of(load, space)) for load in shifted)
        return (above + below) * 0.5, (below - above) * 0.5


def _nearest(interval: tuple[float, float]) -> float:
    """Return the smallest absolute value in an interval."""
    return max(interval[0], -interval[1], 0.0)


def _farthest(interval: tuple[float, float]) -> float:
    """Return the largest absolute value in an interval."""
    return max(abs(interval[0]), abs(interval[1]))


def _half_factors(play: Value) -> tuple[Value, float]:
    return play, 0.5
