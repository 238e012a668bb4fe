"""Link flexibility."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal, final

import numpy as np

from precision_pin import se3, units
from precision_pin.draws.expressions import Expression, Value
from precision_pin.draws.space import LabelledSpace, Setting
from precision_pin.errors import InputError, UnknownNameError
from precision_pin.robot.chain import Chain, Factors, Load, Posture
from precision_pin.se3 import rotation_about
from precision_pin.sources.bent_shape import BentShape
from precision_pin.sources.profiles import Profile, Segment, Stretch, ends, stretches
from precision_pin.terms.source import Source
from precision_pin.terms.term import Term
from precision_pin.typing import Array

__all__ = ["Beam", "beam_axes", "point_flexibility", "stretch_flexibility", "weight_flexibility"]


_PARALLEL: Final = 1e-9
"""Sine of the angle below which an axis counts as parallel to the beam."""
_NO_LENGTH: Final = 1e-9
"""Part of the beam's length up to which a stretch of it is a point."""
_FORCE: Final = np.repeat([1.0, 0.0], 3)
_MOMENT: Final = np.repeat([0.0, 1.0], 3)
"""Which components of a wrench are its force, and its moment."""


@dataclass(frozen=True, kw_only=True)
class OnLink(Source):
    """A source about one link."""

    link: str

    @property
    def subject(self) -> str:
        """The link."""
        return self.link


@final
@dataclass(frozen=True, kw_only=True)
class Beam(Profile, OnLink):
    """Flexibility of a link: a cantilever from its joint's origin to the next joint's (or the tip).

    x runs along it; z is its joint's axis made normal to x (where parallel: the next joint's axis, then the link's y);
    y = z × x; then both turned by ``roll`` about x. Where the base lies beyond the link, clamp and tip change places, but
    x, y, z and the order of ``segments`` stay. The tip carries what hangs beyond the link. What else is bolted to it acts
    at a projection: payloads on the way at that of their mean centre of mass, branches (fixed, or behind locked joints)
    at that of the joint that holds them. Euler-Bernoulli, small deflection:
    ``Δl = F_x l/EA + q_x l²/2EA``, ``w_y = F_y l³/3EI_z + M_z l²/2EI_z + q_y l⁴/8EI_z``,
    ``θ_z = F_y l²/2EI_z + M_z l/EI_z + q_y l³/6EI_z``, likewise with the other sign for w_z and θ_y, ``Δφ = M_x l/GI``;
    with ``segments`` each bends so under what acts beyond its start and carries the rest along. At rest under its loads
    (``statics: equilibrium``) it bends to second order: loads act where its shape, a cubic, has moved them, its sections
    bend about axes that have turned, and bent it is shorter. So it buckles as a column, at 1.0075 of Euler's load; in
    segments somewhat late, at 1.05 of it where one half has a quarter of the other's rigidity. Source: section 3.2 and
    eq 21 of Wei, Jia and Chen (2015), which prints θ_z before θ_y and gives EI and GI in N·m/rad; here EI and GI are
    rigidities in N·m², and stiffnesses of the whole link in N·m/rad are settings of their own (``EI = k l``). Sections:
    :mod:`precision_pin.sources.cross_sections`.

    Attributes
    ----------
    link
        A URDF link of the chain link that bends.
    section
        Shape of the section, in place of rigidities: ``tube``, ``rod`` (solid), ``box`` (rectangular tube) or
        ``general``.
    material
        ``steel``, ``stainless_steel``, ``aluminium`` or ``titanium``: gives E, G and density.
    E, G
        Modulus of elasticity, shear modulus: instead of the material's.
    poisson_ratio
        Instead of G: ``G = E/(2 (1 + ν))``.
    density
        Instead of the material's, for ``self_weight: section``.
    outer_diameter
        Of a tube.
    diameter
        Of a rod.
    width, height
        Of a box, outside: along z (the joint's axis) and along y.
    wall
        Thickness, of a tube or box.
    area
        Of a general section.
    I_y, I_z
        Second moments of area of a general section about y and z.
    J
        Torsion constant of a general section.
    EI
        Bending rigidity about every axis normal to x; or ``EI_y`` and ``EI_z`` about y and z.
    GI
        Torsional rigidity.
    EA
        Axial rigidity; rigid if left out, as is each of the others.
    segments
        Parts with sections of their own, from the link's own joint on: each with ``length`` or ``fraction`` (one may have
        neither) and any of the settings above.
    bending_stiffness, torsion_stiffness
        Instead of EI and GI: moment at the end for one radian there.
    axial_stiffness
        Instead of EA: force at the end for one metre there.
    roll
        Of the section about x.
    self_weight
        How the masses of the URDF links on the way act. ``uniform``: that of the link's own body (the child of its joint;
        a frame without mass is passed over) spread evenly over its part of the way, those bolted to it about their centres
        of mass as far as their own parts go to both sides; ``centre``: each at the projection of its centre of mass, with
        the moment of the offset; ``section``: density × area in place of the own body's mass, the others as ``uniform``.

    Raises
    ------
    InputError
        No stiffness at all, one given twice, settings that do not make a section, a link without length, segments of
        another length, or two sources that give a link its weight by section.
    """

    segments: tuple[Segment, ...] = ()
    bending_stiffness: Annotated[Setting | None, units.ANGULAR_STIFFNESS] = None
    torsion_stiffness: Annotated[Setting | None, units.ANGULAR_STIFFNESS] = None
    axial_stiffness: Annotated[Setting | None, units.LINEAR_STIFFNESS] = None
    roll: Annotated[float, units.ANGLE] = 0.0
    self_weight: Literal["uniform", "centre", "section"] = "uniform"

    def __post_init__(self) -> None:
        at_end = self.given("bending_stiffness", "torsion_stiffness", "axial_stiffness")
        if at_end and (self.section is not None or self.segments):
            raise InputError(f"beam needs either section: or segments:, or {at_end[0]}:")
        if self.bending_stiffness is not None and self.given("EI", "EI_y", "EI_z"):
            raise InputError("beam needs one of EI:, EI_y: with EI_z:, and bending_stiffness:")
        for rigidity, stiffness in (("GI", "torsion_stiffness"), ("EA", "axial_stiffness")):
            if len(self.given(rigidity, stiffness)) > 1:
                raise InputError(f"beam needs one of {rigidity}: and {stiffness}:")
        for name in at_end:
            value = getattr(self, name)
            if isinstance(value, float | int) and not value > 0:
                raise InputError(f"{name} of a beam must be positive, got {value}")
        if self.self_weight not in ("uniform", "centre", "section"):
            raise UnknownNameError("self_weight", self.self_weight, ("uniform", "centre", "section"))
        for part in stretches(self, self.segments):
            part.check(may_be_rigid=bool(at_end), weighs=self.self_weight == "section")

    def loads(self, posture: Posture, space: LabelledSpace) -> Iterator[Load]:
        """Yield, where the section gives the weight, what takes the URDF's masses away and what comes instead."""
        if self.self_weight != "section":
            return
        chain = posture.chain
        link = chain.link_frame(self.link).link
        for load in _along(chain.loads, link):
            yield dataclasses.replace(load, moments=tuple((-moment, factors) for moment, factors in load.moments))
        for _, _, load in self._weights(chain, space, link):
            yield load

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each stiffness and each group of loads with the same random factors."""
        chain = posture.chain
        link = chain.link_frame(self.link).link
        place = chain.end(link)
        axes = beam_axes(chain, link, self.roll)
        length = float(np.linalg.norm(place.frame[:3, 3]))
        turn = _both(place.frame[:3, :3].T @ axes)
        shape = BentShape.of(posture, link, axes)
        pushes = list(self._pushes(posture, space, link, length, axes, shape))
        if shape is not None:
            yield Term.of(place, turn @ shape.second_order, loaded=True)
        for start, stop, part in self._parts(length, chain.runs_backwards(link)):
            acting = [(push, push.on_shape(shape, start, stop)) for push in pushes if push.stop > start]
            for stiffness, rows in self._stiffnesses(part, space, length):
                flexibility = 1.0 / stiffness
                total: dict[Factors, Array] = {}
                for push, on_shape in acting:
                    displacement = push.displacement(start, stop, length, rows) + on_shape[list(rows)].sum(axis=0)
                    total[push.factors] = total.get(push.factors, np.zeros(6)) + displacement
                for factors, displacement in total.items():
                    yield Term.of(place, turn @ displacement, *factors, flexibility, loaded=True)

    def _parts(self, length: float, backwards: bool) -> Iterator[tuple[float, float, Stretch]]:
        """Return start, end (m along the beam) and settings of every part, from the clamp on.

        ``backwards`` where the first of the segments is the last from the clamp on.
        """
        cuts, parts = (0.0, *ends(self.segments, length)), stretches(self, self.segments)
        if backwards:
            cuts, parts = tuple(length - cut for cut in reversed(cuts)), parts[::-1]
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

    def _weights(self, chain: Chain, space: LabelledSpace, link: int) -> Iterator[tuple[float, float, Load]]:
        """Yield start, end and weight of every part, by its section."""
        axes = beam_axes(chain, link)
        length = float(np.linalg.norm(chain.placements[link][:3, 3]))
        for start, stop, part in self._parts(length, chain.runs_backwards(link)):
            centre = axes[:, 0] * ((start + stop) / 2)
            mass = part.mass_per_length(space) * (stop - start)
            factors, scale = ((mass,), 1.0) if isinstance(mass, Expression) else ((), mass)
            moments = ((scale * np.array([1.0, *centre]), factors),)
            yield start, stop, Load(link, np.eye(4), centre, along=True, moments=moments)

    def _pushes(
        self, posture: Posture, space: LabelledSpace, link: int, length: float, axes: Array, shape: BentShape | None
    ) -> Iterator[_Push]:
        """Yield what loads the beam."""
        chain, base = posture.chain, posture.loaded_link_poses[link]
        to_beam = _both((base[:3, :3] @ axes).T)

        def pushes(loads: Sequence[Load], point: Array, start: float, stop: float) -> Iterator[_Push]:
            for factors, wrench in posture.wrench_on(loads, point).items():
                yield _Push(start, stop, to_beam @ wrench, factors)

        def hung(load: Load) -> Iterator[_Push]:
            reach = float(axes[:, 0] @ load.attachment)
            room = 0.0 if self.self_weight == "centre" else _room(load, reach, axes[:, 0], length)
            point = axes[:, 0] * reach
            if shape is not None:
                # what is bolted to a bent beam moves and turns with it
                moved = _both(axes) @ shape.displacement(reach)
                about = se3.compose(se3.translation(point), se3.displacement(moved), se3.translation(-point))
                load, point = dataclasses.replace(load, frame=about @ load.frame), point + moved[:3]
            for push in pushes([load], base[:3, :3] @ point + base[:3, 3], reach, reach):
                if room == 0.0:
                    yield push
                else:
                    yield dataclasses.replace(push, wrench=push.wrench * _MOMENT)
                    yield _Push(reach - room, reach + room, push.wrench * _FORCE, push.factors)

        end = posture.loaded_ends[link][:3, 3]
        yield from pushes([load for load in posture.loads if load.link > link], end, length, length)
        own = _along(posture.loads, link)
        match self.self_weight:
            case "uniform":
                for load in own:
                    start, stop = _stretch(load, axes[:, 0], length)
                    yield from pushes([load], end, start, stop) if stop > start else hung(load)
            case "centre":
                for load in own:
                    yield from hung(load)
            case "section":
                weights = list(self._weights(chain, space, link))
                if len(own) != 2 * len(_along(chain.loads, link)) + len(weights):
                    raise InputError(f"two beams give the link of {self.link!r} its weight by section")
                for start, stop, load in weights:
                    yield from pushes([load], end, start, stop)
        for load in posture.loads:
            if load.link == link and not load.along:
                yield from hung(load)


@final
@dataclass(frozen=True, eq=False)
class _Push:
    """A load on a beam: at one point, or spread evenly between two.

    Attributes
    ----------
    start, stop
        Between where it acts, m along the beam.
    wrench
        ``[F; M]``, beam axes: at the point; of a spread load its weight.
    factors
        Parameters that multiply it.
    """

    start: float
    stop: float
    wrench: Array
    factors: Factors

    def displacement(self, start: float, stop: float, length: float, rows: tuple[int, ...]) -> Array:
        """Return how it displaces the beam's end by bending one part, of unit stiffness in the rows given."""
        bent = np.zeros((6, 6))
        spread = self.stop - self.start
        if spread == 0.0:
            # a point of the part feels what acts beyond it as at its end
            reach = min(self.stop, stop)
            bent = point_flexibility(stop - start, reach - start) @ _lever(self.stop - reach).T
        else:
            first, last = max(self.start, start), min(self.stop, stop)
            if last > first:
                bent = stretch_flexibility(stop - start, first - start, last - start) * ((last - first) / spread)
            beyond = self.stop - max(self.start, stop)
            if beyond > 0.0:
                middle = self.stop - beyond / 2
                force = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * (beyond / spread)
                bent = bent + point_flexibility(stop - start, stop - start) @ _lever(middle - stop).T @ force
        displacement = np.zeros(6)
        displacement[list(rows)] = (bent @ self.wrench)[list(rows)]
        return _lever(length - stop) @ displacement

    def on_shape(self, shape: BentShape | None, start: float, stop: float) -> Array:
        """Return by how much more it displaces the beam's end since it acts on the shape, for each row, ``(6, 6)``.

        For the flexibility of one part that governs the row; none along x, and none on the undeflected arm.
        """
        result = np.zeros((6, 6))
        if shape is not None:
            result[3:] = shape.bending(self.wrench, (self.start, self.stop), (start, stop))
        return result


def _lever(reach: float) -> Array:
    """Return what a displacement becomes ``reach`` (m) further along x; transposed, what a wrench becomes before it."""
    result = np.eye(6)
    result[1, 5], result[2, 4] = reach, -reach
    return result


def _along(loads: Iterable[Load], link: int) -> list[Load]:
    return [load for load in loads if load.link == link and load.along]


def _stretch(load: Load, x: Array, length: float) -> tuple[float, float]:
    """Return from where to where (m along the beam) a weight's part of the way goes; twice the same for no length."""
    if load.stretch is None:
        return (0.0, length) if load.along else (0.0, 0.0)
    start, stop = sorted(float(min(max(reach, 0.0), length)) for reach in load.stretch @ x)
    return (start, stop) if stop - start > _NO_LENGTH * length else (start, start)


def _room(load: Load, reach: float, x: Array, length: float) -> float:
    """Return how far (m) a weight's part of the way goes to both sides of its centre, which lies at ``reach``."""
    start, stop = _stretch(load, x, length)
    room = min(reach - start, stop - reach)
    return room if room > _NO_LENGTH * length else 0.0


def point_flexibility(length: float, reach: float) -> Array:
    """Return the end's displacement for a wrench at ``reach`` (m) along a cantilever of unit stiffnesses.

    Returns
    -------
    NDArray
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
    """Return the end's displacement for a total weight spread between two points (m) of a cantilever.

    The mean of :func:`point_flexibility` over the reach; of all of it :func:`weight_flexibility`.
    """
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


def beam_axes(chain: Chain, link: int, roll: float = 0.0) -> Array:
    """Return the axes x, y, z of a chain link as a beam, as columns in the link's own axes, ``(3, 3)``.

    Raises
    ------
    InputError
        The link has no length.
    """
    far_end = chain.placements[link]
    length = float(np.linalg.norm(far_end[:3, 3]))
    if length == 0:
        raise InputError(f"chain link {link} ({chain.end(link).name}) has no length, so it cannot bend")
    x = far_end[:3, 3] / length
    ends = []
    if link > 0:
        ends.append(chain.written_axes[link - 1])
    if link < len(chain.joints):
        ends.append(far_end[:3, :3] @ chain.written_axes[link])
    backwards = chain.runs_backwards(link)
    # in a link that the file begins at the far end, that end's joint and axes count, and x points back
    own_axes, x = (far_end[:3, :3], -x) if backwards else (np.eye(3), x)
    candidates = [*(reversed(ends) if backwards else ends), own_axes[:, 1], own_axes[:, 2]]
    z = next(normal for normal in (axis - x * (x @ axis) for axis in candidates) if np.linalg.norm(normal) > _PARALLEL)
    z = z / np.linalg.norm(z)
    axes: Array = np.array([x, np.cross(z, x), z]).T @ rotation_about((1, 0, 0), roll)
    return axes * [-1.0, -1.0, 1.0] if backwards else axes


def _both(turn: Array) -> Array:
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = turn
    return result
