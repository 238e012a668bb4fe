"""Joint offsets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from precision_pin.terms import Dependence, JointValue, LabelledSpace, Posture, Setting, Source, Term, units


@dataclass(frozen=True, kw_only=True)
class JointOffset(Source):
    """Error of a joint's value: encoder zero, homing, control.

    Added to the joint's value: Δθ of eqs 6 and 16 of Wei, Jia and Chen (2015), or Δd of a prismatic joint.

    Attributes:
        joint: The joint.
        offset: The error of its value: an angle, or a length for a prismatic joint.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.JointOffset(joint="joint1", offset=pp.Normal(1e-3))
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.274 3.74  0.   ]
    """

    depends_on: ClassVar[Dependence] = "chain"
    is_dimensional: ClassVar[bool] = True
    deviations: ClassVar[tuple[str, ...]] = ("offset",)
    words: ClassVar[Mapping[str, str]] = {"offset": "zero of {subject}"}

    joint: str
    offset: Annotated[Setting, units.PerJoint(units.ANGLE, units.LENGTH)]

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield one term."""
        joint = posture.chain.joint_index(self.joint)
        yield Term.of(JointValue(joint), 1.0, space.value("offset", self.offset))
