"""Flexibility of a joint's bearing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

import numpy as np

from precision_pin.sources.places import PadsOn, height_above_seat, seat_of, seat_wrench, travels, wrench_at
from precision_pin.terms import Chain, InputError, LabelledSpace, Posture, Setting, Source, Term, Value, units

_ROWS: Final = {"radial": (0, 1), "axial": (2,), "tilt": (3, 4), "roll": (5,)}
"""Components of wrench and displacement related by each stiffness."""


@dataclass(frozen=True, kw_only=True)
class BearingStiffness(Source):
    """Flexibility of a joint's bearing: the seat yields under the wrench of all loads beyond the joint.

    z is the joint's axis, and F and M act at the bearing's centre. The centre is displaced by ``d = (F_x/k_r, F_y/k_r,
    F_z/k_a)`` and turned by ``δ = (M_x/k_t, M_y/k_t, 0)``. A revolute joint is free about its axis, a prismatic one
    along it; there the drive carries the load, see ``joint_compliance``. Linear, without play; radial force and tilt
    are uncoupled at the centre. Two bearings of radial stiffness k at a span L have, about their midpoint, ``k_r =
    2k``, ``k_t = k L²/2``. Source: the bushing of multibody mechanics with uncoupled springs; ISO/TS 16281 for the
    stiffness of a rolling bearing from its internal geometry.

    Attributes:
        joint: The joint.
        radial: k_r, normal to the axis (default of all stiffnesses: rigid).
        axial: k_a, along the axis; not for a prismatic joint.
        tilt: k_t, about every axis normal to the joint's: the moment stiffness of a data sheet.
        roll: For a prismatic joint: about its axis, ``δ_z = M_z/k``.
        centre: Position of the bearing's centre on the axis as written in the file, from the joint's origin.
        pads_on: For a prismatic joint: the link that the bearing is fixed to, ``child`` (a carriage, which travels
            along its rail; ``centre`` is measured from the joint's frame after its motion) or ``parent`` (fixed
            guides).

    Raises:
        InputError: No stiffness, or pads on neither link.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.BearingStiffness(joint="joint2", tilt=1e5)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print(round(1e3 * at.error_at_means[2], 3))
        -0.012
    """

    words: ClassVar[Mapping[str, str]] = {
        name: f"{name} bearing stiffness of {{subject}}" for name in ("radial", "axial", "tilt", "roll")
    }

    joint: str
    radial: Annotated[Setting | None, units.LINEAR_STIFFNESS] = None
    axial: Annotated[Setting | None, units.LINEAR_STIFFNESS] = None
    tilt: Annotated[Setting | None, units.ANGULAR_STIFFNESS] = None
    roll: Annotated[Setting | None, units.ANGULAR_STIFFNESS] = None
    centre: Annotated[float, units.LENGTH] = 0.0
    pads_on: PadsOn = "child"

    def __post_init__(self) -> None:
        if all(getattr(self, name) is None for name in _ROWS):
            raise InputError("bearing_stiffness needs a stiffness: radial:, axial:, tilt: or roll:")
        if self.pads_on not in ("child", "parent"):
            raise InputError(f"pads_on of bearing_stiffness must be one of child, parent, got {self.pads_on!r}")

    def accepts_many(self, chain: Chain) -> bool:
        """Return whether the bearing does not travel."""
        return not travels(chain, chain.joint_index(self.joint), self.pads_on)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each stiffness and each group of loads with the same random factors."""
        chain = posture.chain
        joint = chain.joint_index(self.joint)
        is_prismatic = bool(chain.prismatic[joint])
        free = "axial" if is_prismatic else "roll"
        if getattr(self, free) is not None:
            motion = "slides along" if is_prismatic else "turns about"
            raise InputError(
                f"{free}: of {self.label()}: the joint {motion} its axis; joint_compliance gives the flexibility of its drive"
            )
        place, to_place = seat_of(chain, joint)
        to_centre = wrench_at(height_above_seat(posture, joint, self.centre, self.pads_on))
        wrenches = seat_wrench(posture, joint)
        for name, rows in _ROWS.items():
            setting = getattr(self, name)
            if setting is None:
                continue
            flexibility: Value = 1.0 / space.positive(name, setting)
            selection = np.zeros((6, 6))
            selection[rows, rows] = 1.0
            for factors, wrench in wrenches.items():
                displacement = to_centre.T @ selection @ to_centre @ wrench
                yield Term.of(place, to_place @ displacement, *factors, flexibility, loaded=True)
