"""Errors of any frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from precision_pin.sources.places import AtPlace, deviation_terms
from precision_pin.terms import LabelledSpace, Posture, Setting, Term, units


@dataclass(frozen=True, kw_only=True)
class Frame(AtPlace):
    """Six errors at any place: a shift and a small turn in the place's own axes.

    The place's displacement is ``Trans(x, y, z)·Exp((rx, ry, rz))``; displacements of the same place by other sources add.

    Attributes:
        joint, link, frame: The place; give one of the three: the seat of a joint (its URDF origin frame before its
            motion; if the base is beyond the joint, the frame of its child link), the end of the chain link that a URDF
            link belongs to (the next joint's origin frame, or the tip), or the frame of a URDF link on the path to the
            tip.
        x, y, z: Shift.
        rx, ry, rz: Rotation vector.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Frame(joint="joint2", rz=pp.Normal(1e-3))
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.   0.   3.74]
    """

    deviations: ClassVar[tuple[str, ...]] = ("x", "y", "z", "rx", "ry", "rz")
    words: ClassVar[Mapping[str, str]] = {
        **{name: f"position of {{subject}} along {name}" for name in ("x", "y", "z")},
        **{f"r{name}": f"tilt of {{subject}} about {name}" for name in ("x", "y", "z")},
    }

    x: Annotated[Setting, units.LENGTH] = 0.0
    y: Annotated[Setting, units.LENGTH] = 0.0
    z: Annotated[Setting, units.LENGTH] = 0.0
    rx: Annotated[Setting, units.ANGLE] = 0.0
    ry: Annotated[Setting, units.ANGLE] = 0.0
    rz: Annotated[Setting, units.ANGLE] = 0.0

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Return a term for each error that is not zero."""
        return deviation_terms(self, self.place(posture.chain), space)
