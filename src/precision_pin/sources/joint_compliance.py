"""Joint flexibility."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from precision_pin.terms import JointValue, LabelledSpace, Posture, Setting, Source, Term, units


@dataclass(frozen=True, kw_only=True)
class JointCompliance(Source):
    """Flexibility of a joint: it turns (or slides) by its compliance times the load on it.

    ``dθ = C τ``, τ the torque of the *load* on the joint. Source: eq 23 of Wei, Jia and Chen (2015), after Spong.

    Attributes:
        joint: The joint.
        compliance: C; a linear compliance for a prismatic joint.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.JointCompliance(joint="joint2", compliance=1e-5)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print(round(1e3 * at.error_at_means[2], 3))
        -6.501
    """

    takes_many: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {"compliance": "compliance of {subject}"}

    joint: str
    compliance: Annotated[Setting, units.PerJoint(units.ANGULAR_COMPLIANCE, units.LINEAR_COMPLIANCE)]

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each group of loads with the same random factors."""
        joint = posture.chain.joint_index(self.joint)
        compliance = space.positive("compliance", self.compliance, zero=True)
        for factors, torque in posture.torque_on(joint).items():
            yield Term.of(JointValue(joint), torque, *factors, compliance, loaded=True)
