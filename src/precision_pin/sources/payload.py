"""Payload."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from precision_pin.draws.expressions import Expression, Value
from precision_pin.robot.places import Factors, Load
from precision_pin.terms import Dependence, InputError, LabelledSpace, Posture, Setting, Source, Term, at_means, units


@dataclass(frozen=True, kw_only=True)
class Payload(Source):
    """A payload on the arm. It displaces nothing itself: its weight loads the flexible joints and links.

    Mass m and first moment m·c enter torques and link wrenches linearly, so a random mass or centre is a product. On a
    ``beam`` it acts at the projection of its mean centre of mass or, on a branch, of the branch's attachment.

    Attributes:
        at: The link that carries it.
        mass: Its mass.
        com: Its centre of mass in that link's frame: three numbers, any of them random if need be.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Payload(at="tool", mass=1.0)
        >>> compliance = pp.sources.JointCompliance(joint="joint2", compliance=1e-5)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source, compliance]).at([0, 0, 0, 0])
        >>> print(round(1e3 * at.error_at_means[2], 3))
        -7.873
    """

    depends_on: ClassVar[Dependence] = "chain"
    is_put_down: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {"mass": "payload mass at {subject}", "com": "payload centre at {subject}"}

    at: str
    mass: Annotated[Setting, units.MASS]
    com: Annotated[tuple[Setting, Setting, Setting], units.LENGTH] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.com) != 3:
            raise InputError(f"the com of a payload has {len(self.com)} numbers, expected 3")

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield nothing."""
        posture.chain.link_frame(self.at)
        return iter(())

    def loads(self, posture: Posture, space: LabelledSpace) -> Iterator[Load]:
        """Yield the weight."""
        carrier = posture.chain.link_frame(self.at)
        mass = space.positive("mass", self.mass, zero=True)
        centre = space.values("com", self.com)
        moments = [_moment(0, mass), *(_moment(k + 1, mass, value) for k, value in enumerate(centre))]
        entry = carrier.entry([_at_means(value, space) for value in centre])
        yield Load(carrier.link, carrier.frame, entry, along=False, moments=tuple(moments))


def _moment(row: int, *values: Value) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], Factors]:
    moments = np.zeros(4)
    moments[row] = np.prod([value for value in values if not isinstance(value, Expression)])
    return moments, tuple(value for value in values if isinstance(value, Expression))


def _at_means(value: Value, space: LabelledSpace) -> float:
    return float(at_means({(value,): 1.0}, space.space)) if isinstance(value, Expression) else value
