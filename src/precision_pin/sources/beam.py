"""Link flexibility."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin import units
from precision_pin.chain import Chain, Factors, Load, Posture
from precision_pin.errors import InputError
from precision_pin.parameters import Value
from precision_pin.se3 import rotation_about
from precision_pin.space import LabelledSpace, Setting
from precision_pin.terms import Source, Term

__all__ = ["Beam", "beam_axes", "point_flexibility", "weight_flexibility"]

Array = NDArray[np.float64]

_PARALLEL: Final = 1e-9
"""Sine of the angle below which an axis counts as parallel to the beam."""


@final
@dataclass(frozen=True, kw_only=True)
class Beam(Source):
    """Flexibility of a link: a cantilever from its joint's origin to the next joint's (or the tip).

    x runs along it; z is its joint's axis made normal to x (where parallel: the next joint's axis, then the link's y);
    y = z × x; then both turned by ``roll`` about x. The tip carries what hangs beyond the link; the masses of the URDF
    links on the way are spread evenly along it; what else hangs on the link (payloads, fixed branches, locked joints)
    acts at its projection. Euler-Bernoulli, small deflection: ``Δl = F_x l/EA + q_x l²/2EA``,
    ``w_y = F_y l³/3EI_z + M_z l²/2EI_z + q_y l⁴/8EI_z``, ``θ_z = F_y l²/2EI_z + M_z l/EI_z + q_y l³/6EI_z``, likewise
    with the other sign for w_z and θ_y, ``Δφ = M_x l/GI``. Source: section 3.2 and eq 21 of Wei, Jia and Chen (2015),
    which prints θ_z before θ_y and gives EI and GI in N·m/rad; here EI and GI are rigidities in N·m², and stiffnesses
    of the whole link in N·m/rad are settings of their own (``EI = k l``).

    Attributes
    ----------
    link
        A URDF link of the chain link that bends.
    EI
        Bending rigidity about every axis normal to x; or ``EI_y`` and ``EI_z`` about y and z.
    GI
        Torsional rigidity.
    EA
        Axial rigidity; rigid if left out, as is each of the others.
    bending_stiffness, torsion_stiffness
        Instead of EI and GI: moment at the end for one radian there.
    roll
        Of the section about x.

    Raises
    ------
    InputError
        No stiffness at all, one given twice, or a link without length.
    """

    link: str
    EI: Annotated[Setting | None, units.BENDING_RIGIDITY] = None
    EI_y: Annotated[Setting | None, units.BENDING_RIGIDITY] = None
    EI_z: Annotated[Setting | None, units.BENDING_RIGIDITY] = None
    GI: Annotated[Setting | None, units.BENDING_RIGIDITY] = None
    EA: Annotated[Setting | None, units.AXIAL_RIGIDITY] = None
    bending_stiffness: Annotated[Setting | None, units.ANGULAR_STIFFNESS] = None
    torsion_stiffness: Annotated[Setting | None, units.ANGULAR_STIFFNESS] = None
    roll: Annotated[float, units.ANGLE] = 0.0

    def __post_init__(self) -> None:
        bending = (
            self.EI is not None,
            self.EI_y is not None or self.EI_z is not None,
            self.bending_stiffness is not None,
        )
        if sum(bending) > 1:
            raise InputError("beam needs one of EI:, EI_y: with EI_z:, and bending_stiffness:")
        if (self.EI_y is None) != (self.EI_z is None):
            raise InputError("beam needs both of EI_y: and EI_z:")
        if self.GI is not None and self.torsion_stiffness is not None:
            raise InputError("beam needs one of GI: and torsion_stiffness:")
        if not any(bending) and self.GI is None and self.EA is None and self.torsion_stiffness is None:
            raise InputError(
                "beam needs a stiffness: EI:, EI_y: with EI_z:, GI:, EA:, bending_stiffness:, torsion_stiffness:"
            )
        for name in ("EI", "EI_y", "EI_z", "GI", "EA", "bending_stiffness", "torsion_stiffness"):
            value = getattr(self, name)
            if isinstance(value, float | int) and not value > 0:
                raise InputError(f"{name} of a beam must be positive, got {value}")

    @property
    def subject(self) -> str:
        """The link."""
        return self.link

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each stiffness and each group of loads with the same random factors."""
        chain = posture.chain
        link = chain.link_frame(self.link).link
        place = chain.end(link)
        axes = beam_axes(chain, link, self.roll)
        length = float(np.linalg.norm(place.frame[:3, 3]))
        turn = _both(place.frame[:3, :3].T @ axes)
        to_beam = _both((posture.loaded_link_poses[link][:3, :3] @ axes).T)
        for stiffness, rows in self._stiffnesses(space, length):
            flexibility = 1.0 / stiffness
            for factors, displacement in self._unit_displacement(posture, link, length, axes, to_beam, rows).items():
                yield Term.of(place, turn @ displacement, *factors, flexibility, loaded=True)

    def _stiffnesses(self, space: LabelledSpace, length: float) -> Iterator[tuple[Value, tuple[int, ...]]]:
        """Yield each stiffness with the displacement rows it governs: Δl, w_y, w_z, Δφ, θ_y, θ_z."""
        for name, rows, factor in (
            ("EI", (1, 2, 4, 5), 1.0),
            ("EI_z", (1, 5), 1.0),
            ("EI_y", (2, 4), 1.0),
            ("bending_stiffness", (1, 2, 4, 5), length),
            ("GI", (3,), 1.0),
            ("torsion_stiffness", (3,), length),
            ("EA", (0,), 1.0),
        ):
            setting = getattr(self, name)
            if setting is not None:
                value = space.positive(name, setting)
                yield (value if factor == 1.0 else value * factor), rows

    def _unit_displacement(
        self, posture: Posture, link: int, length: float, axes: Array, to_beam: Array, rows: tuple[int, ...]
    ) -> dict[Factors, Array]:
        """Return the end's displacement, beam axes, for a stiffness of one, by the parameters that multiply it."""
        base = posture.loaded_link_poses[link]
        total: dict[Factors, Array] = {}

        def add(loads: list[Load], point: Array, flexibility: Array) -> None:
            for factors, wrench in posture.wrench_on(loads, point).items():
                displacement = np.zeros(6)
                displacement[list(rows)] = (flexibility @ to_beam @ wrench)[list(rows)]
                total[factors] = total.get(factors, np.zeros(6)) + displacement

        end = posture.loaded_ends[link][:3, 3]
        add([load for load in posture.loads if load.link > link], end, point_flexibility(length, length))
        own = [load for load in posture.loads if load.link == link]
        add([load for load in own if load.along], end, weight_flexibility(length))
        for load in own:
            if not load.along:
                reach = float(np.clip(axes[:, 0] @ load.attachment, 0.0, length))
                point = base[:3, :3] @ (axes[:, 0] * reach) + base[:3, 3]
                add([load], point, point_flexibility(length, reach))
        return total


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


def beam_axes(chain: Chain, link: int, roll: float = 0.0) -> Array:
    """Return the axes x, y, z of a chain link as a beam, as columns in the link's own axes, ``(3, 3)``.

    Raises
    ------
    InputError
        The link has no length.
    """
    way = chain.placements[link][:3, 3]
    length = float(np.linalg.norm(way))
    if length == 0:
        raise InputError(f"chain link {link} ({chain.end(link).name}) has no length, so it cannot bend")
    x = way / length
    candidates = []
    if link > 0:
        candidates.append(chain.axes[link - 1])
    if link < len(chain.joints):
        candidates.append(chain.placements[link][:3, :3] @ chain.axes[link])
    candidates += [np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])]
    z = next(normal for normal in (axis - x * (x @ axis) for axis in candidates) if np.linalg.norm(normal) > _PARALLEL)
    z = z / np.linalg.norm(z)
    axes: Array = np.array([x, np.cross(z, x), z]).T @ rotation_about((1, 0, 0), roll)
    return axes


def _both(turn: Array) -> Array:
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = turn
    return result
