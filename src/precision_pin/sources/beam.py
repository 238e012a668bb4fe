"""Link flexibility."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3, units
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.base.se3 import rotation_about
from precision_pin.draws.expressions import Expression, Value
from precision_pin.sources.places import block_diagonal, in_axes
from precision_pin.sources.profiles import Profile, Segment, Stretch, ends, stretches
from precision_pin.terms import Array, Chain, Factors, LabelledSpace, Load, Posture, Setting, Source, Term

_PARALLEL: Final = 1e-9
"""Sine of the angle below which an axis counts as parallel to the beam."""
_NO_LENGTH: Final = 1e-9
"""Fraction of the beam's length up to which a stretch counts as a point."""
_FORCE: Final = np.repeat([1.0, 0.0], 3)
_MOMENT: Final = np.repeat([0.0, 1.0], 3)
"""Masks of force and moment in a wrench ``[F; M]``."""


@dataclass(frozen=True, kw_only=True)
class OnLink(Source):
    """Base class of a source on one link."""

    link: str


@dataclass(frozen=True, kw_only=True)
class Beam(Profile, OnLink):
    """Flexibility of a link: a cantilever from its joint's origin to the next joint's (or the tip).

    x runs along the link; z is its joint's axis made normal to x (if parallel: the next joint's axis, then the link's
    y); y = z × x; ``roll`` turns y and z about x. If the base is beyond the link, clamp and free end swap, but x, y, z
    and the order of ``segments`` stay. All loads beyond the link act on the free end. Other loads on the link act at
    their projections on the beam: payloads at that of their mean centre of mass, branches (fixed, or behind locked
    joints) at that of the joint that holds them. Euler-Bernoulli, small deflection: ``Δl = F_x l/EA + q_x l²/2EA``,
    ``w_y = F_y l³/3EI_z + M_z l²/2EI_z + q_y l⁴/8EI_z``, ``θ_z = F_y l²/2EI_z + M_z l/EI_z + q_y l³/6EI_z``, likewise
    with the other sign for w_z and θ_y, ``Δφ = M_x l/GI``. With ``segments`` each part bends in this way under the
    loads beyond its start and carries the rest along. With ``statics: equilibrium`` the bending is of second order:
    loads act where the beam's shape, a cubic, has moved them, its sections bend about turned axes, and bending shortens
    it. The beam then buckles as a column, at 1.0075 times Euler's load; with segments later, at 1.05 times if one half
    has a quarter of the other's rigidity. Source: section 3.2 and eq 21 of Wei, Jia and Chen (2015), which prints θ_z
    before θ_y and gives EI and GI in N·m/rad; here they are rigidities in N·m², and stiffnesses of the whole link in
    N·m/rad are separate settings (``EI = k l``). Sections: :mod:`precision_pin.sources.profiles`.

    Attributes:
        link: A URDF link of the chain link that bends.
        section: Shape of the section, in place of rigidities: ``tube``, ``rod`` (solid), ``box`` (rectangular tube) or
            ``general``.
        material: ``steel``, ``stainless_steel``, ``aluminium`` or ``titanium``: gives E, G and density.
        E, G: Modulus of elasticity and shear modulus, in place of the material's.
        poisson_ratio: In place of G: ``G = E/(2 (1 + ν))``.
        density: Density in place of the material's, for ``self_weight: section``.
        outer_diameter: Outer diameter of a tube.
        diameter: Diameter of a rod.
        width, height: Outer dimensions of a box: along z (the joint's axis) and along y.
        wall: Wall thickness of a tube or box.
        area: Area of a general section.
        I_y, I_z: Second moments of area of a general section about y and z.
        J: Torsion constant of a general section.
        EI: Bending rigidity about every axis normal to x; or ``EI_y`` and ``EI_z`` about y and z.
        GI: Torsional rigidity.
        EA: Axial rigidity; rigid if left out, as is each of the others.
        segments: Parts with their own sections, starting at the link's own joint: each with ``length`` or ``fraction``
            (one may have neither) and any of the settings above.
        bending_stiffness, torsion_stiffness: In place of EI and GI: moment at the end for one radian there.
        axial_stiffness: In place of EA: force at the end for one metre there.
        roll: Angle of the section about x.
        self_weight: Distribution of the masses of the URDF links along the beam. ``uniform``: the mass of the link's
            own body (the child of its joint; frames without mass are skipped) is spread evenly over its part of the
            beam, that of a body bolted to it evenly about its centre of mass, as far as its own part reaches on both
            sides. ``centre``: each mass acts at the projection of its centre of mass, with the moment of the offset.
            ``section``: density × area in place of the own body's mass, the others as ``uniform``.

    Raises:
        InputError: No stiffness, a stiffness given twice, settings that do not define a section, a link without length,
            segments whose lengths do not add up to it, or two sources that give a link its weight by section.
    """

    takes_many: ClassVar[bool] = True

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
        """For a weight by section, yield loads that cancel the URDF's masses, and the weights instead."""
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
        turn = block_diagonal(place.frame[:3, :3].T @ axes)
        shape = BentShape.of(posture, link, axes)
        beam_loads = list(self._beam_loads(posture, space, link, length, axes, shape))
        if shape is not None:
            yield Term.of(place, turn @ shape.second_order, loaded=True)
        for start, stop, part in self._parts(length, chain.runs_backwards(link)):
            acting = [
                (beam_load, beam_load.on_shape(shape, start, stop))
                for beam_load in beam_loads
                if beam_load.stop > start
            ]
            for stiffness, rows in self._stiffnesses(part, space, length):
                flexibility = 1.0 / stiffness
                total: dict[Factors, Array] = {}
                for beam_load, on_shape in acting:
                    displacement = beam_load.displacement(start, stop, length, rows)
                    if on_shape is not None:
                        displacement = displacement + on_shape[list(rows)].sum(axis=0)
                    known = total.get(beam_load.factors)
                    total[beam_load.factors] = displacement if known is None else known + displacement
                for factors, displacement in total.items():
                    yield Term.of(place, turn @ displacement, *factors, flexibility, loaded=True)

    def _parts(self, length: float, backwards: bool) -> Iterator[tuple[float, float, Stretch]]:
        """Yield start, end (m along the beam) and settings of each part from the clamp, reversed if ``backwards``."""
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
        axes = beam_axes(chain, link)
        length = float(np.linalg.norm(chain.placements[link][:3, 3]))
        for start, stop, part in self._parts(length, chain.runs_backwards(link)):
            centre = axes[:, 0] * ((start + stop) / 2)
            mass = part.mass_per_length(space) * (stop - start)
            factors, scale = ((mass,), 1.0) if isinstance(mass, Expression) else ((), mass)
            moments = ((scale * np.array([1.0, *centre]), factors),)
            yield start, stop, Load(link, np.eye(4), centre, along=True, moments=moments)

    def _beam_loads(
        self, posture: Posture, space: LabelledSpace, link: int, length: float, axes: Array, shape: BentShape | None
    ) -> Iterator[_BeamLoad]:
        chain, base = posture.chain, posture.loaded_link_poses[link]

        def beam_loads(loads: Sequence[Load], point: Array, start: float, stop: float) -> Iterator[_BeamLoad]:
            for factors, wrench in posture.wrench_on(loads, point).items():
                yield _BeamLoad(start, stop, in_axes(base[:3, :3], axes, wrench), factors)

        def attached_loads(load: Load) -> Iterator[_BeamLoad]:
            reach = float(axes[:, 0] @ load.attachment)
            half_spread = 0.0 if self.self_weight == "centre" else _half_spread(load, reach, axes[:, 0], length)
            point = axes[:, 0] * reach
            if shape is not None:
                # a body bolted to a bent beam moves and turns with it
                moved = block_diagonal(axes) @ shape.displacement(reach)
                about = se3.compose(se3.translation(point), se3.displacement(moved), se3.translation(-point))
                load, point = dataclasses.replace(load, frame=about @ load.frame), point + moved[:3]
            for beam_load in beam_loads([load], se3.turn(base[:3, :3], point) + base[:3, 3], reach, reach):
                if half_spread == 0.0:
                    yield beam_load
                else:
                    force, moment = ((beam_load.wrench.T * part).T for part in (_FORCE, _MOMENT))
                    yield dataclasses.replace(beam_load, wrench=moment)
                    yield _BeamLoad(reach - half_spread, reach + half_spread, force, beam_load.factors)

        end = posture.loaded_ends[link][:3, 3]
        yield from beam_loads([load for load in posture.loads if load.link > link], end, length, length)
        own = _along(posture.loads, link)
        match self.self_weight:
            case "uniform":
                for load in own:
                    start, stop = _stretch(load, axes[:, 0], length)
                    yield from beam_loads([load], end, start, stop) if stop > start else attached_loads(load)
            case "centre":
                for load in own:
                    yield from attached_loads(load)
            case "section":
                weights = list(self._weights(chain, space, link))
                if len(own) != 2 * len(_along(chain.loads, link)) + len(weights):
                    raise InputError(f"two beams give the link of {self.link!r} its weight by section")
                for start, stop, load in weights:
                    yield from beam_loads([load], end, start, stop)
        for load in posture.loads:
            if load.link == link and not load.along:
                yield from attached_loads(load)


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

    def displacement(self, start: float, stop: float, length: float, rows: tuple[int, ...]) -> Array:
        """Return the displacement of the beam's end by bending of one part, with unit stiffness in the given rows."""
        bent = np.zeros((6, 6))
        spread = self.stop - self.start
        if spread == 0.0:
            # a load beyond the part acts through the part's end
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
        displacement = np.zeros_like(self.wrench)
        displacement[list(rows)] = (bent @ self.wrench)[list(rows)]
        return _lever(length - stop) @ displacement

    def on_shape(self, shape: BentShape | None, start: float, stop: float) -> Array | None:
        """Return the further displacement of the beam's end because the load acts on the bent shape, ``(6, 6)``."""
        # Each row is for unit flexibility of one part in that row; zero along x. None on the undeflected arm.
        if shape is None:
            return None
        result = np.zeros((6, 6))
        result[3:] = shape.bending(self.wrench, (self.start, self.stop), (start, stop))
        return result


def _lever(reach: float) -> Array:
    """Return the matrix that moves a displacement ``reach`` (m) along x; its transpose moves a wrench back."""
    result = np.eye(6)
    result[1, 5], result[2, 4] = reach, -reach
    return result


def _along(loads: Iterable[Load], link: int) -> list[Load]:
    return [load for load in loads if load.link == link and load.along]


def _stretch(load: Load, x: Array, length: float) -> tuple[float, float]:
    """Return the ends (m along the beam) of a weight's stretch, equal if it has no length."""
    if load.stretch is None:
        return (0.0, length) if load.along else (0.0, 0.0)
    start, stop = sorted(float(min(max(reach, 0.0), length)) for reach in load.stretch @ x)
    return (start, stop) if stop - start > _NO_LENGTH * length else (start, start)


def _half_spread(load: Load, reach: float, x: Array, length: float) -> float:
    """Return how far (m) a weight's stretch of the beam reaches on both sides of its centre at ``reach``."""
    start, stop = _stretch(load, x, length)
    half_spread = min(reach - start, stop - reach)
    return half_spread if half_spread > _NO_LENGTH * length else 0.0


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


def beam_axes(chain: Chain, link: int, roll: float = 0.0) -> Array:
    """Return the axes x, y, z of a chain link as a beam, as columns in the link's own axes, ``(3, 3)``.

    Raises InputError if the link has no length.
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
    # if the file begins the link at the far end, the joint and axes of that end count, and x points back
    own_axes, x = (far_end[:3, :3], -x) if backwards else (np.eye(3), x)
    candidates = [*(reversed(ends) if backwards else ends), own_axes[:, 1], own_axes[:, 2]]
    z = next(normal for normal in (axis - x * (x @ axis) for axis in candidates) if np.linalg.norm(normal) > _PARALLEL)
    z = z / np.linalg.norm(z)
    axes: Array = np.array([x, np.cross(z, x), z]).T @ rotation_about((1, 0, 0), roll)
    return axes * [-1.0, -1.0, 1.0] if backwards else axes


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
"""Gauss-Legendre rule, exact up to degree 9."""
_ALONG: Final = np.array([1.0, 0.0, 0.0])
_NEXT: Final = [1, 2, 0]
_AFTER: Final = [2, 0, 1]


@dataclass(frozen=True, eq=False)
class BentShape:
    """The shape of a cantilever: the cubic through the displacement and rotation of its end.

    It gives Euler's load of a column with one free end as 2.486 EI/l²; π²/4 = 2.467 is exact (Przemieniecki, Theory of
    Matrix Structural Analysis, 1968, chapter 15).

    Attributes:
        length: Length of the beam, m.
        end: ``[u, w_y, w_z; φ, θ_y, θ_z]`` of its end, beam axes.
    """

    length: float
    end: Array

    @classmethod
    def of(cls, posture: Posture, link: int, axes: Array) -> BentShape | None:
        """Return the shape of a chain link, ``axes`` as columns, on the deflected arm; None on the undeflected one."""
        if posture.deflection is None:
            return None
        place = posture.chain.placements[link]
        to_beam = axes.T @ place[:3, :3]
        bending = posture.deflection.bending[link]
        return cls(float(np.linalg.norm(place[:3, 3])), np.concatenate([to_beam @ bending[:3], to_beam @ bending[3:]]))

    def displacement(self, reach: ArrayLike) -> Array:
        """Return displacements ``(..., 6)``, beam axes, at ``reach`` ``(...)`` (m); beyond an end, as at the end."""
        l, along = self.length, np.asarray(reach, dtype=float)  # noqa: E741
        s, beyond = np.clip(along / l, 0.0, 1.0), np.maximum(along - l, 0.0)
        u, w_y, w_z, phi, theta_y, theta_z = self.end
        across, turned = s * s * (3 - 2 * s), l * s * s * (s - 1)
        across_slope, turned_slope = 6 * s * (1 - s) / l, s * (3 * s - 2)
        rows = (
            u * s,
            w_y * across + theta_z * (turned + beyond),
            w_z * across - theta_y * (turned + beyond),
            phi * s,
            theta_y * turned_slope - w_z * across_slope,
            theta_z * turned_slope + w_y * across_slope,
        )
        return np.stack(rows, axis=-1)

    def slope(self, reach: Array) -> Array:
        """Return the twist and curvatures at places along the beam, ``(N, 3)``, rad/m."""
        l, s = self.length, reach / self.length  # noqa: E741
        _, w_y, w_z, phi, theta_y, theta_z = self.end
        bent, straight = 6 * (1 - 2 * s) / l**2, (6 * s - 2) / l
        rows = (np.full_like(s, phi / l), theta_y * straight - w_z * bent, theta_z * straight + w_y * bent)
        return np.stack(rows, axis=-1)

    @property
    def second_order(self) -> Array:
        """The end's displacement ``(6,)``, beam axes, by the rotations along the beam beyond their sum.

        With θ(x) the rotation, ``δ = -½ ∫ θ × θ' dx`` (rotations do not commute) and ``d = ½ ∫ θ × (θ × e_x) dx``,
        which shortens a bent beam, plus the displacement that δ causes along the beam.
        """
        x, weights = _nodes(0.0, self.length)
        turn = self.displacement(x)[:, 3:]
        total = _at_end(_cross(self.slope(x), turn) / 2, self.length - x, weights)
        total[:3] += weights @ _cross(turn, _cross(turn, _ALONG)) / 2
        return total

    def bending(self, wrench: Array, loaded: tuple[float, float], part: tuple[float, float]) -> Array:
        """Return the further displacement of the beam's end because a load acts on the bent shape, ``(3, 6)``.

        The moment at x is that of the force at its displaced point, ``M + Δr × F``. It bends the section about axes
        turned by θ: ``κ = D (M + Δr × F - θ × M) + θ × D M`` to second order, D the flexibilities. One row each for
        unit flexibility about x, y and z, with the others rigid.

        Args:
            wrench: ``[F; M]``, beam axes: at its point, or of a weight spread evenly between two points.
            loaded: Ends of the loaded stretch, m along the beam.
            part: Ends of the bending part, m along the beam.
        """
        x, weights = _nodes(part[0], min(part[1], loaded[1]))
        begin, stop = np.maximum(loaded[0], x), loaded[1]
        at_point = loaded[0] == stop
        share = np.ones_like(x) if at_point else (stop - begin) / (stop - loaded[0])
        force = share[:, None] * wrench[:3]
        # lever along x only: (a, 0, 0) × F = (0, -a F_z, a F_y)
        lever = (begin + stop) / 2 - x
        moment = np.stack([np.zeros_like(x), -lever * force[:, 2], lever * force[:, 1]], axis=-1)
        if at_point:
            moment = moment + wrench[3:]
        here = self.displacement(x)
        beyond = self.displacement(stop)[:3] if at_point else self._mean_place(begin, stop)
        more = _cross(beyond - here[:, :3], force) - _cross(here[:, 3:], moment)
        about = np.eye(3)[:, None, :]
        return _at_end(
            about * more.T[:, :, None] + _cross(here[:, 3:], about) * moment.T[:, :, None], self.length - x, weights
        )

    def _mean_place(self, begin: Array, stop: float) -> Array:
        """Return the mean displacement between each of N places and ``stop``, ``(N, 3)``."""
        x = (begin[:, None] * (1 - _NODES) + stop * (1 + _NODES)) / 2
        return np.einsum("k,nki->ni", _WEIGHTS / 2, self.displacement(x)[..., :3])


def _nodes(start: float, stop: float) -> tuple[Array, Array]:
    half = (stop - start) / 2
    return start + half * (1 + _NODES), half * _WEIGHTS


def _at_end(turn: Array, reach: Array, weights: Array) -> Array:
    """Return the end's displacement ``(..., 6)`` by weighted rotations ``(..., N, 3)``, ``reach`` (m) before it."""
    lever = (weights * reach) @ turn
    zero = np.zeros_like(lever[..., 0])
    return np.concatenate([np.stack([zero, lever[..., 2], -lever[..., 1]], axis=-1), weights @ turn], axis=-1)


def _cross(one: Array, other: Array) -> Array:
    """Return vector products ``(..., 3)``; for few vectors faster than numpy's cross."""
    return one[..., _NEXT] * other[..., _AFTER] - one[..., _AFTER] * other[..., _NEXT]
