"""Link flexibility."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from precision_pin.base import se3, units
from precision_pin.base.arguments import check_choice
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.base.se3 import rotation_about
from precision_pin.draws.expressions import Expression, Value
from precision_pin.robot.bent_shape import NO_LENGTH, BentShape, middle_of
from precision_pin.sources.places import PadsOn, block_diagonal, in_axes
from precision_pin.sources.profiles import Profile, Segment, Stretch, ends, stretches
from precision_pin.terms import Array, Chain, Factors, LabelledSpace, Load, Place, Posture, Setting, Source, Term
from precision_pin.terms.term import at_means

_PARALLEL: Final = 1e-9
"""Sine of the angle below which an axis counts as parallel to the beam: above rounding, below the angles of drawings."""
_ASIDE: Final = 0.1
"""Sine of the angle up to which a joint counts as sliding along the link: 6°, far above tolerances of an assembly."""
_FIRST_ORDER: Final = 0.005
"""Largest fraction of the buckling load at which a beam with a carriage bends to first order under equilibrium statics.

The bending neglects about this fraction of itself.
"""
_BACK: Final = np.array([-1.0, -1.0, 1.0])
"""Factors of the axes that rotate them by π about z, so that x points back."""
_FORCE: Final = np.repeat([1.0, 0.0], 3)
_MOMENT: Final = np.repeat([0.0, 1.0], 3)
"""Masks of force and moment in a wrench ``[F; M]``."""


@dataclass(frozen=True, kw_only=True)
class OnLink(Source):
    """Base class of a source on one link."""

    link: str


@dataclass(frozen=True, kw_only=True)
class Beam(Profile, OnLink):
    """Flexibility of a link: a cantilever from its joint's origin to the next joint's (or the tip), or to a carriage.

    x runs along the link; z is its joint's axis made normal to x (if parallel: the next joint's axis, then the link's
    y); y = z × x; ``roll`` turns y and z about x. If the base is beyond the link, clamp and free end swap, but x, y, z
    and the order of ``segments`` stay. All loads beyond the link act on the free end. Other loads on the link act at
    their projections on the beam: payloads at that of their mean centre of mass, branches (fixed, or behind locked
    joints) at that of the joint that holds them. Euler-Bernoulli, small deflection: ``Δl = F_x l/EA + q_x l²/2EA``,
    ``w_y = F_y l³/3EI_z + M_z l²/2EI_z + q_y l⁴/8EI_z``, ``θ_z = F_y l²/2EI_z + M_z l/EI_z + q_y l³/6EI_z``, likewise
    with the other sign for w_z and θ_y, ``Δφ = M_x l/GI``. With ``segments`` each part bends in this way under the
    loads beyond its start and carries the rest along. With ``statics: equilibrium`` the bending is of second order:
    loads act where the beam's shape has moved them, its sections bend about turned axes, and bending shortens it. The
    beam then buckles as a column: at Euler's load within 0.01 %, within 1 % if one half has a quarter of the other's
    rigidity or if the weight is at half the height, at 1.04 times that load if it is at a quarter.

    If the carriage of a sliding joint travels along the link, x is the joint's axis through the link's start, and the
    beam ends where the joint value puts the carriage; what lies aside of the beam is rigid. The axis counts as along the
    link within 6° of the line from the link's start to the joint's origin, at any angle if supports, start or span are
    given. With ``supports: both`` w, and φ about x, are zero at both ends, the slopes are free and u is held at the
    first: at a, with b = span - a, ``w_y = F_y a²b²/3EI_z L + M_z ab(b - a)/3EI_z L``, ``θ_z = F_y ab(b - a)/3EI_z L + M_z
    (a² - ab + b²)/3EI_z L``, ``φ = M_x ab/GI L`` (Gere and Timoshenko, Mechanics of Materials). The link's own body is
    spread over the span or, without one, from the first support as far beyond its centre of mass. Such beams bend to
    first order on the deflected arm too, and are refused there if a load along them exceeds 0.5 % of the buckling load.

    Source: section 3.2 and eq 21 of Wei, Jia and Chen (2015), which prints θ_z before θ_y and gives EI and GI in
    N·m/rad; here they are rigidities in N·m², and stiffnesses of the whole link in N·m/rad are separate settings
    (``EI = k l``). Sections: :mod:`precision_pin.sources.profiles`.

    Attributes:
        link: A URDF link of the chain link that bends.
        section: Shape of the section, instead of rigidities: ``tube``, ``rod`` (solid), ``box`` (rectangular tube) or
            ``general``.
        material: ``steel``, ``stainless_steel``, ``aluminium`` or ``titanium``: gives E, G and density.
        E, G: Modulus of elasticity and shear modulus, instead of the material's.
        poisson_ratio: Instead of G: ``G = E/(2 (1 + ν))``.
        density: Density instead of the material's, for ``self_weight: section``.
        outer_diameter: Outer diameter of a tube.
        diameter: Diameter of a rod.
        width, height: Outer dimensions of a box: along z (the joint's axis) and along y.
        wall: Wall thickness of a tube or box.
        area: Area of a general section.
        I_y, I_z: Second moments of area of a general section about y and z.
        J: Torsion constant of a general section.
        EI: Bending rigidity about every axis normal to x; or ``EI_y`` and ``EI_z`` about y and z.
        GI: Torsional rigidity.
        EA: Axial rigidity (default of all rigidities: rigid).
        segments: Parts with their own sections, starting at the link's own joint: each with ``length`` or ``fraction``
            (one may have neither) and any of the settings above.
        bending_stiffness, torsion_stiffness: Instead of EI and GI: moment at the end for one radian there.
        axial_stiffness: Instead of EA: force at the end for one metre there.
        roll: Angle of the section about x.
        self_weight: Distribution of the masses of the URDF links along the beam. ``uniform``: the mass of the link's
            own body (the child of its joint; frames without mass are skipped) is spread evenly over its part of the
            beam, that of a body bolted to it evenly about its centre of mass, as far as its own part reaches on both
            sides. ``centre``: each mass acts at the projection of its centre of mass, with the moment of the offset.
            ``section``: density × area instead of the own body's mass, the others as ``uniform``.
        supports: Which ends are held: the ``start``, or ``both``, a bridge.
        start: Position of the first support along x from the held end of the link: its start, or with ``pads_on: parent``
            its end.
        span: Length of the beam, the distance of two supports. Segments fill it.
        pads_on: For a sliding joint: the link that the pads are fixed to, ``child`` (a carriage, which travels along the
            beam) or ``parent`` (fixed guides, along which the beam itself travels: a ram, held at its end).

    Raises:
        InputError: No stiffness, a stiffness given twice, settings that do not define a section, a link without length,
            segments whose lengths do not add up to it, two sources that give a link its weight by section, a carriage
            beyond the beam, or two carriages on it.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Beam(link="link2", EI=8000.0, GI=4000.0)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print(round(1e3 * at.error_at_means[2], 3))
        -85.799
    """

    takes_many: ClassVar[bool] = True

    segments: tuple[Segment, ...] = ()
    bending_stiffness: Annotated[Setting | None, units.ANGULAR_STIFFNESS] = None
    torsion_stiffness: Annotated[Setting | None, units.ANGULAR_STIFFNESS] = None
    axial_stiffness: Annotated[Setting | None, units.LINEAR_STIFFNESS] = None
    roll: Annotated[float, units.ANGLE] = 0.0
    self_weight: Literal["uniform", "centre", "section"] = "uniform"
    supports: Literal["start", "both"] | None = None
    start: Annotated[float, units.LENGTH] = 0.0
    span: Annotated[float | None, units.LENGTH] = None
    pads_on: PadsOn = "child"

    def __post_init__(self) -> None:
        end_stiffnesses = self.given("bending_stiffness", "torsion_stiffness", "axial_stiffness")
        if self.self_weight not in ("uniform", "centre", "section"):
            raise UnknownNameError("self_weight", self.self_weight, ("uniform", "centre", "section"))
        check_choice("supports of beam", self.supports or "start", ("start", "both"))
        check_choice("pads_on of beam", self.pads_on, ("child", "parent"))
        if self.span is not None and not self.span > 0:
            raise InputError(f"the span of beam must be positive, got {self.setting_text('span')}")
        if self.supports == "both" and (self.span is None or self.segments):
            raise InputError("supports: both of beam needs span:, the distance of the two supports, and no segments:")
        if end_stiffnesses and (self.section is not None or self.segments):
            raise InputError(f"beam needs either section: or segments:, or {end_stiffnesses[0]}:")
        if self.bending_stiffness is not None and self.given("EI", "EI_y", "EI_z"):
            raise InputError("beam needs one of EI:, EI_y: with EI_z:, and bending_stiffness:")
        for rigidity, stiffness in (("GI", "torsion_stiffness"), ("EA", "axial_stiffness")):
            if len(self.given(rigidity, stiffness)) > 1:
                raise InputError(f"beam needs one of {rigidity}: and {stiffness}:")
        for name in end_stiffnesses:
            value = getattr(self, name)
            if isinstance(value, float | int) and not value > 0:
                raise InputError(f"{name} of a beam must be positive, got {self.setting_text(name)}")
        for part in stretches(self, self.segments):
            part.check(may_be_rigid=bool(end_stiffnesses), weighs=self.self_weight == "section")

    def loads(self, posture: Posture, space: LabelledSpace) -> Iterator[Load]:
        """For a weight by section, yield loads that cancel the masses of the URDF, and the weights of the section."""
        if self.self_weight != "section":
            return
        chain = posture.chain
        line = _Line.of(self, chain)
        for load in _along(chain.loads, line.link):
            yield dataclasses.replace(load, moments=tuple((-moment, factors) for moment, factors in load.moments))
        for _, _, load in self._weights(line, space):
            yield load

    def accepts_many(self, chain: Chain) -> bool:
        """Return whether no carriage travels on the beam."""
        return _Line.of(self, chain).is_link

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each stiffness and each group of loads with the same random factors."""
        line = _Line.of(self, posture.chain, posture.q)
        shape: BentShape | None = None
        if posture.deflection is not None and line.is_link:
            far_end = posture.chain.placements[line.link][:3, 3]
            shape = posture.deflection.shape(line.link, far_end).turned(line.axes.T)
        beam_loads = list(self._beam_loads(posture, space, line, shape))
        reaches = (line.reach,) if shape is None else (line.reach, line.reach / 2)

        def terms(bends: Array, *factors: Value) -> Iterator[Term]:
            yield Term.of(line.place, line.to_place @ bends[0], *factors, loaded=True)
            if shape is not None:
                bow = bends[1] - middle_of(line.reach) @ bends[0]
                yield Term.of(Place.bow(line.place), block_diagonal(line.axes) @ bow, *factors, loaded=True)

        if shape is not None:
            yield from terms(shape.second_order)
        for start, stop, part in self._parts(line):
            acting = [
                (beam_load, beam_load.on_shape(shape, start, stop))
                for beam_load in beam_loads
                if beam_load.stop > start or not line.is_link
            ]
            for stiffness, rows in self._stiffnesses(part, space, line.reach):
                flexibility = 1.0 / stiffness
                if posture.deflection is not None and not line.is_link and rows[-1] > 3:
                    line.check_load_along(beam_loads, flexibility, space)
                total: dict[Factors, Array] = {}
                for beam_load, on_shape in acting:
                    bends = np.array([line.displacement(beam_load, start, stop, rows, reach) for reach in reaches])
                    if on_shape is not None:
                        bends = bends + on_shape[:, list(rows)].sum(axis=1)
                    previous = total.get(beam_load.factors)
                    total[beam_load.factors] = bends if previous is None else previous + bends
                for factors, bends in total.items():
                    yield from terms(bends, *factors, flexibility)

    def _parts(self, line: _Line) -> Iterator[tuple[float, float, Stretch]]:
        """Yield start, end (m along the beam) and settings of each part from the first support on."""
        cuts, parts = (0.0, *ends(self.segments, line.span)), stretches(self, self.segments)
        if line.is_backwards and self.segments:
            cuts, parts = tuple(line.span - cut for cut in reversed(cuts)), parts[::-1]
        return zip(cuts[:-1], cuts[1:], parts, strict=True)

    def _stiffnesses(
        self, part: Stretch, space: LabelledSpace, length: float
    ) -> Iterator[tuple[Value, tuple[int, ...]]]:
        """Yield each stiffness of a part with the displacement rows it governs: Δl, w_y, w_z, Δφ, θ_y, θ_z."""
        values = part.rigidities(space)
        for name in self.given("bending_stiffness", "torsion_stiffness", "axial_stiffness"):
            values[name] = space.positive(name, getattr(self, name))
        for name, rows, factor in (
            ("EI", (1, 2, 4, 5), 1.0),
            ("EI_z", (1, 5), 1.0),
            ("EI_y", (2, 4), 1.0),
            ("bending_stiffness", (1, 2, 4, 5), length),
            ("GI", (3,), 1.0),
            ("torsion_stiffness", (3,), length),
            ("EA", (0,), 1.0),
            ("axial_stiffness", (0,), length),
        ):
            if name in values:
                yield (values[name] if factor == 1.0 else values[name] * factor), rows

    def _weights(self, line: _Line, space: LabelledSpace) -> Iterator[tuple[float, float, Load]]:
        for start, stop, part in self._parts(line):
            centre = line.origin + line.axes[:, 0] * ((start + stop) / 2)
            mass = part.mass_per_length(space) * (stop - start)
            factors, scale = ((mass,), 1.0) if isinstance(mass, Expression) else ((), mass)
            moments = ((scale * np.array([1.0, *centre]), factors),)
            stretch = line.origin + np.outer((start, stop), line.axes[:, 0])
            yield start, stop, Load(line.link, np.eye(4), centre, along=True, moments=moments, stretch=stretch)

    def _beam_loads(
        self, posture: Posture, space: LabelledSpace, line: _Line, shape: BentShape | None
    ) -> Iterator[_BeamLoad]:
        end, axes, link = line.end_in_base(posture), line.axes, line.link
        x, base = axes[:, 0], posture.loaded_link_poses[link]

        def beam_loads(loads: Sequence[Load], point: Array, start: float, stop: float) -> Iterator[_BeamLoad]:
            for factors, wrench in posture.wrench_on(loads, point).items():
                yield _BeamLoad(start, stop, in_axes(base[:3, :3], axes, wrench), factors)

        def attached_loads(load: Load) -> Iterator[_BeamLoad]:
            reach = float(x @ (load.attachment - line.origin)) if shape is None else load.reach_along(x, line.reach)
            start, stop = line.stretch(load)
            room = 0.0 if self.self_weight == "centre" else min(reach - start, stop - reach)
            half_spread = room if room > NO_LENGTH * line.reach else 0.0
            carrier = posture.carrier(load)
            point = se3.turn(carrier[:3, :3], line.origin + x * reach) + carrier[:3, 3]
            for beam_load in beam_loads([load], point, reach, reach):
                if half_spread == 0.0:
                    yield beam_load
                else:
                    force, moment = ((beam_load.wrench.T * part).T for part in (_FORCE, _MOMENT))
                    yield dataclasses.replace(beam_load, wrench=moment)
                    yield _BeamLoad(reach - half_spread, reach + half_spread, force, beam_load.factors)

        def on_link() -> Iterator[_BeamLoad]:
            link_loads = _along(posture.loads, link)
            match self.self_weight:
                case "uniform":
                    for load in link_loads:
                        start, stop = line.stretch(load)
                        yield from beam_loads([load], end, start, stop) if stop > start else attached_loads(load)
                case "centre":
                    for load in link_loads:
                        yield from attached_loads(load)
                case "section":
                    weights = list(self._weights(line, space))
                    # none of them where a force acts alone
                    if link_loads and len(link_loads) != 2 * len(_along(posture.chain.loads, link)) + len(weights):
                        raise InputError(f"two beams give the link of {self.link!r} its weight by section")
                    for start, stop, load in weights if link_loads else ():
                        yield from beam_loads([load], end, start, stop)
            for load in posture.loads:
                if load.link == link and not load.along:
                    yield from attached_loads(load)

        yield from beam_loads([load for load in posture.loads if load.link > link], end, line.reach, line.reach)
        for beam_load in on_link():
            yield beam_load if line.is_far else dataclasses.replace(beam_load, wrench=-beam_load.wrench)
            if not line.is_far:
                # seen from the supports, the reaction at the point on the side of the base is a load
                yield beam_load.moved_to(line.reach)


@dataclass(frozen=True, eq=False)
class _BeamLoad:
    """A load on a beam: at one point, or spread evenly between two.

    Attributes:
        start, stop: Ends of the loaded stretch, m along the beam; equal for a point.
        wrench: ``[F; M]``, beam axes, ``(6[, P])``: at the point; for a spread load its whole weight.
    """

    start: float
    stop: float
    wrench: Array
    factors: Factors

    def moved_to(self, reach: float) -> _BeamLoad:
        """Return the load at another point with equal reactions on a rigid beam."""
        wrench = self.wrench * _FORCE if self.stop > self.start else self.wrench
        return _BeamLoad(reach, reach, _lever((self.start + self.stop) / 2 - reach).T @ wrench, self.factors)

    def displacement(self, start: float, stop: float, length: float, rows: tuple[int, ...]) -> Array:
        """Return a cantilever's displacement at ``length`` by bending of one part, with unit stiffness in these rows."""
        matrix = np.zeros((6, 6))
        spread, stop = self.stop - self.start, min(stop, length)
        if start >= min(stop, self.stop):
            return np.zeros_like(self.wrench)
        if spread == 0.0:
            # a load beyond the part acts through the part's end
            reach = min(self.stop, stop)
            matrix = point_flexibility(stop - start, reach - start) @ _lever(self.stop - reach).T
        else:
            first, last = max(self.start, start), min(self.stop, stop)
            if last > first:
                matrix = stretch_flexibility(stop - start, first - start, last - start) * ((last - first) / spread)
            beyond = self.stop - max(self.start, stop)
            if beyond > 0.0:
                middle = self.stop - beyond / 2
                force = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * (beyond / spread)
                matrix = matrix + point_flexibility(stop - start, stop - start) @ _lever(middle - stop).T @ force
        displacement = np.zeros_like(self.wrench)
        displacement[list(rows)] = (matrix @ self.wrench)[list(rows)]
        return _lever(length - stop) @ displacement

    def on_shape(self, shape: BentShape | None, start: float, stop: float) -> Array | None:
        """Return the second-order displacements of end and middle by the load on the bent shape, ``(2, 6, 6)``."""
        # Each row is for unit flexibility of one part in that row; zero along x. None on the undeflected arm.
        if shape is None:
            return None
        result = np.zeros((2, 6, 6))
        result[:, 3:] = shape.bending(self.wrench, (self.start, self.stop), (start, stop))
        return result


@dataclass(frozen=True, eq=False)
class _Line:
    """The axis of a beam, x from its first support, and the point of interest: its end, or a carriage.

    Attributes:
        link: Index of the chain link.
        origin, axes: First support ``(3,)``, and axes of the beam as columns ``(3, 3)``, link's axes.
        reach, span: Distance of the point from the first support, and length of the beam, infinite if unknown, m.
        offset: From the point to the origin of the place, link's axes, ``(3,)``.
        place, to_place: The place displaced, and the matrix ``(6, 6)`` from the displacement of the point, beam axes.
        is_link: Whether it is a cantilever from the link's start to its end, at all joint values.
        is_far: Whether the point is on the side of the tip; if not, its supports are.
        is_backwards: Whether the file begins the beam at its other end.
        both: Whether both its ends are held.
    """

    link: int
    origin: Array
    axes: Array
    reach: float
    span: float
    offset: Array
    place: Place
    to_place: Array
    is_link: bool
    is_far: bool
    is_backwards: bool
    both: bool

    @classmethod
    def of(cls, beam: Beam, chain: Chain, q: Array | None = None) -> _Line:
        """Return the line of a beam at joint values (default: zero, on the beam or not).

        Raises:
            InputError: The link has no length, two joints slide along it, the carriage is not on the beam, or a setting is
                missing or not for a beam with a carriage.
        """
        link = chain.link_frame(beam.link).link
        place, backwards = chain.end(link), chain.runs_backwards(link)
        end, rotation = place.frame[:3, 3], place.frame[:3, :3]
        length = float(np.linalg.norm(end))
        sliding = []
        for joint in range(max(link - 1, 0), min(link + 1, len(chain.joints))):
            # a carriage travels on the link before the joint if its pads are on the link after it
            travels = ((beam.pads_on == "child") is bool(chain.reversed_joints[joint])) is (joint < link)
            axis = rotation @ chain.axes[joint] if joint == link else -chain.axes[joint]
            is_along = (
                beam.supports
                or beam.span
                or beam.start
                or np.linalg.norm(np.cross(end, axis)) <= _ASIDE * length + NO_LENGTH
            )
            if chain.prismatic[joint] and travels and is_along:
                sliding.append((joint, axis))
        if len(sliding) > 1:
            raise InputError(f"{beam.label()}: two carriages slide along the link, so neither of its ends is held")
        both = beam.supports == "both"
        is_link = not (sliding or both or beam.span is not None or beam.start)
        is_far = is_link or (sliding[0][0] == link if sliding else not backwards)
        support, point = (np.zeros(3), end) if is_far else (end, np.zeros(3))
        x = None
        for joint, axis in sliding:
            x, point = ((axis if is_far else -axis), point + axis * (0.0 if q is None else float(q[joint])))
            place = Place.start(joint + 1, f"seat of {chain.joint_names[joint]}") if is_far else chain.seat(joint)
        axes = beam_axes(chain, link, beam.roll, x) * (1.0 if is_far else _BACK)
        origin = support + beam.start * axes[:, 0]
        reach = float((point - origin) @ axes[:, 0]) if sliding else length - beam.start
        span = beam.span or (reach if is_link else np.inf)
        if beam.span is None and reach < 0:
            axes, reach = axes * _BACK, -reach
        if not is_link and beam.given("bending_stiffness", "torsion_stiffness", "axial_stiffness"):
            raise InputError(f"{beam.label()}: the link's stiffnesses change with its length: give EI:, GI: and EA:")
        if not is_link and beam.span is None and (beam.segments or beam.self_weight == "section"):
            raise InputError(f"{beam.label()}: segments: and self_weight: section need span:, the length of the beam")
        if q is not None and not is_link and not 0 <= round(reach, 12) <= span:
            raise InputError(f"{beam.label()}: the carriage is at {reach:.6g} m, beyond the ends at 0 and {span:g} m")
        offset = np.zeros(3) if is_link else (point if sliding else end) - origin - reach * axes[:, 0]
        shift = np.eye(6)
        shift[:3, 3:] = -se3.skew(axes.T @ offset)
        to_place = block_diagonal((np.eye(3) if sliding and not is_far else rotation.T) @ axes) @ shift
        return cls(link, origin, axes, reach, span, offset, place, to_place, is_link, is_far, is_far is backwards, both)

    def end_in_base(self, posture: Posture) -> Array:
        """Return the point in the base, ``(3[, P])``, on the loaded arm."""
        carriers = posture.loaded_link_poses if self.place.is_start else posture.loaded_ends
        return carriers[self.place.link][:3, 3] - se3.turn(posture.loaded_link_poses[self.link][:3, :3], self.offset)

    def stretch(self, load: Load) -> tuple[float, float]:
        """Return start and end (m along the beam) of the stretch of a weight, equal if it has no length."""
        if self.is_link:
            return load.stretch_along(self.axes[:, 0], self.reach)
        if load.along:
            reach = float(self.axes[:, 0] @ (load.attachment - self.origin))
            return 0.0, self.span if np.isfinite(self.span) else 2 * max(reach, 0.0)
        if load.stretch is None:
            return 0.0, 0.0
        along = (load.stretch - self.origin) @ self.axes[:, 0]
        start, stop = sorted(float(min(max(reach, 0.0), self.span)) for reach in along)
        return (start, stop) if stop - start > NO_LENGTH * self.reach else (start, start)

    def displacement(self, load: _BeamLoad, start: float, stop: float, rows: tuple[int, ...], reach: float) -> Array:
        """Return the displacement at ``reach`` by bending of one part, with unit stiffness in these rows."""
        if not self.both:
            return load.displacement(start, stop, reach, rows)
        # the second support loads the cantilever's end; then all rotates about the first until the end is on its support
        _, _, _, m_x, m_y, m_z = load.moved_to(0.0).wrench
        share = m_x * (load.start + load.stop) / 2
        reaction = _BeamLoad(self.span, self.span, np.array([0, -m_z, m_y, -share, 0, 0]) / self.span, load.factors)

        def evaluate(place: float) -> Array:
            return sum((part.displacement(start, stop, place, rows) for part in (load, reaction)), np.zeros(6))

        bend, end_bend = evaluate(reach), evaluate(self.span)
        return bend - _lever(reach) @ np.array([0, 0, 0, 0, -end_bend[2], end_bend[1]]) / self.span

    def check_load_along(self, loads: Iterable[_BeamLoad], flexibility: Value, space: LabelledSpace) -> None:
        """Raise InputError if the load along the beam is too near the buckling load for first-order bending."""
        factors, unit = ((flexibility,), 1.0) if isinstance(flexibility, Expression) else ((), flexibility)
        along = ({(*load.factors, *factors): unit * float(load.wrench[0])} for load in loads)
        share = abs(sum(float(at_means(force, space.space)) for force in along))
        share *= ((self.span if self.both else 2 * self.reach) / np.pi) ** 2
        if share > _FIRST_ORDER:
            raise InputError(
                f"{space.label}: the load along it is {share:.2g} of its buckling load; statics: equilibrium allows "
                f"{_FIRST_ORDER:g} for beams with a carriage or two supports"
            )


def _lever(reach: float) -> Array:
    """Return the matrix that moves a displacement ``reach`` (m) along x; its transpose moves a wrench back."""
    result = np.eye(6)
    result[1, 5], result[2, 4] = reach, -reach
    return result


def _along(loads: Iterable[Load], link: int) -> list[Load]:
    return [load for load in loads if load.link == link and load.along]


def point_flexibility(length: float, reach: float) -> Array:
    """Return the end's displacement for a wrench at ``reach`` (m) along a cantilever of unit stiffnesses.

    ``(6, 6)``: wrench ``[F; M]`` → ``[Δl, w_y, w_z; Δφ, θ_y, θ_z]``, each to be divided by its own stiffness.
    """
    a, l = reach, length  # noqa: E741
    return np.array(
        [
            [a, 0, 0, 0, 0, 0],
            [0, a**2 * (3 * l - a) / 6, 0, 0, 0, a * (2 * l - a) / 2],
            [0, 0, a**2 * (3 * l - a) / 6, 0, -a * (2 * l - a) / 2, 0],
            [0, 0, 0, a, 0, 0],
            [0, 0, -(a**2) / 2, 0, a, 0],
            [0, a**2 / 2, 0, 0, 0, a],
        ]
    )


def weight_flexibility(length: float) -> Array:
    """Return the end's displacement for a total weight spread along a cantilever; see :func:`point_flexibility`."""
    l = length  # noqa: E741
    result = np.zeros((6, 6))
    result[0, 0] = l / 2
    result[1, 1] = result[2, 2] = l**3 / 8
    result[5, 1] = l**2 / 6
    result[4, 2] = -(l**2) / 6
    return result


def stretch_flexibility(length: float, start: float, stop: float) -> Array:
    """Return :func:`point_flexibility` averaged over a weight spread between two points (m) of a cantilever."""
    if start == 0.0 and stop == length:
        return weight_flexibility(length)
    a, b, l = start, stop, length  # noqa: E741
    first, second, third = (a + b) / 2, (a**2 + a * b + b**2) / 3, (a + b) * (a**2 + b**2) / 4
    result = np.zeros((6, 6))
    result[0, 0] = first
    result[1, 1] = result[2, 2] = (3 * l * second - third) / 6
    result[5, 1] = second / 2
    result[4, 2] = -second / 2
    return result


def beam_axes(chain: Chain, link: int, roll: float = 0.0, x: Array | None = None) -> Array:
    """Return the axes x, y, z of a chain link as a beam, as columns in the link's own axes, ``(3, 3)``.

    ``x``, a unit vector, is by default the direction of the link's end. Raises InputError if the link has no length.
    """
    far_end, backwards = chain.placements[link], chain.runs_backwards(link)
    if x is None:
        length = float(np.linalg.norm(far_end[:3, 3]))
        if length == 0:
            raise InputError(
                f"chain link {link} ({chain.end(link).name}) has no length, so it cannot bend; name the link: on the other "
                "side of the joint, or the one that carries the rail of a sliding joint (pads_on: child) or slides (parent)"
            )
        x = far_end[:3, 3] / length
    end_axes = []
    if link > 0:
        end_axes.append(chain.written_axes[link - 1])
    if link < len(chain.joints):
        end_axes.append(far_end[:3, :3] @ chain.written_axes[link])
    # if the file starts the link at the far end, the joint and axes of that end apply, and x points back
    link_axes, x = (far_end[:3, :3], -x) if backwards else (np.eye(3), x)
    candidates = [*(reversed(end_axes) if backwards else end_axes), link_axes[:, 1], link_axes[:, 2]]
    z = next(normal for normal in (axis - x * (x @ axis) for axis in candidates) if np.linalg.norm(normal) > _PARALLEL)
    z = z / np.linalg.norm(z)
    axes: Array = np.array([x, np.cross(z, x), z]).T @ rotation_about((1, 0, 0), roll)
    return axes * _BACK if backwards else axes
