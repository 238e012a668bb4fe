"""Length errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from precision_pin.base import se3, units
from precision_pin.sources.places import direction_of, is_fixed
from precision_pin.terms import Array, Chain, Dependence, InputError, LabelledSpace, Posture, Setting, Source, Term


@dataclass(frozen=True, kw_only=True)
class Length(Source):
    """Manufacturing error of a length: it moves a joint's origin, or a frame, along a direction.

    The displacement is ``direction × (sum of the parameters)`` at the end of the chain link that carries the joint's
    origin or the frame; all parts beyond it, seen from the base, move with it. Lengths may share parameters: in the
    paper's Table 1 the length a₁ is in y₁ and in z₄, so one random a₁ moves both. Source: section 3.1 of Wei, Jia and
    Chen (2015), ``Δx, Δy, Δz`` of a link.

    Attributes:
        joint, frame: The moved part: a joint's origin, or a frame on the path to the tip; give one of the two.
        along: Direction: ``link`` (from the link's start to its end, the default), or ``[-]x|y|z of JOINT`` (axes of
            its frame after its motion, which is its child link's) or ``[-]axis of JOINT`` (as written in the file).
        parameters: Deviations from the nominal length; they add.

    Raises:
        InputError: Not exactly one of joint and frame, or the direction ``link`` for a link without length.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Length(joint="joint3", along="x of joint2", parameters=(pp.Normal(1e-4),))
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.1 0.  0. ]
    """

    takes_many: ClassVar[bool] = True
    depends_on: ClassVar[Dependence] = "configuration"
    is_dimensional: ClassVar[bool] = True
    deviations: ClassVar[tuple[str, ...]] = ("parameters",)
    words: ClassVar[Mapping[str, str]] = {"parameters": "length to {subject}"}

    joint: str | None = None
    frame: str | None = None
    along: str = "link"
    parameters: Annotated[tuple[Setting, ...], units.LENGTH]

    def __post_init__(self) -> None:
        if (self.joint is None) == (self.frame is None):
            raise InputError("length needs either joint: or frame:")
        if not self.parameters:
            raise InputError("length needs at least one of parameters:")

    @classmethod
    def nominal_size(cls, settings: Mapping[str, Any], chain: Chain) -> float | None:
        """Return the distance along the direction if it is the same at every pose."""
        place = {name: settings[name] for name in ("joint", "frame", "along") if name in settings}
        source = cls(**place, parameters=(0.0,))
        if not source.is_alike_everywhere(chain):
            return None
        posture, link = chain.at(np.zeros(len(chain.joints))), source._link(chain)
        vector = posture.link_poses[link][:3, :3] @ chain.end(link).frame[:3, 3]
        return abs(float(source._direction(posture) @ vector))

    def is_alike_everywhere(self, chain: Chain) -> bool:
        """Return whether the direction is fixed in the link."""
        return self.along == "link" or is_fixed(self.along, chain, self._link(chain))

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield one term for each parameter."""
        chain = posture.chain
        place = chain.end(self._link(chain))
        to_place = posture.place_pose(place)[:3, :3].swapaxes(0, 1)
        twist = np.zeros((6, *posture.q.shape[1:]))
        twist[:3] = se3.turn(to_place, self._direction(posture))
        for value in space.values("parameters", self.parameters):
            yield Term.of(place, twist, value)

    def _direction(self, posture: Posture) -> Array:
        if self.along != "link":
            return direction_of(self.along, posture)
        link = self._link(posture.chain)
        vector = posture.chain.end(link).frame[:3, 3]
        length = float(np.linalg.norm(vector))
        if length == 0:
            raise InputError(f"{self.label()}: the link has no length; give a direction with along:")
        return se3.turn(posture.link_poses[link][:3, :3], vector) / length

    def _link(self, chain: Chain) -> int:
        if self.joint is not None:
            return chain.joint_index(self.joint)
        assert self.frame is not None
        return chain.frame_place(self.frame).link
