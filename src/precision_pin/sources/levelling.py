"""Levelling: the direction of gravity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from precision_pin.terms import Dependence, Expression, Factors, LabelledSpace, Posture, Setting, Source, Term, units


@dataclass(frozen=True, kw_only=True)
class Levelling(Source):
    """A base that is not level, so that gravity acts in another direction than drawn.

    The base is tilted by the small rotation vector r = (rx, ry, rz), so in its axes gravity turns the other way: ``g' =
    g - r × g``. The weights on every flexible source change with it; nothing else moves. The tilt's displacement of the
    tip in the world is a ``mounting`` at the base, which may share the parameters. First order in r: the neglected part
    of ``Exp(-r) g`` is below |r|²/2 of the weight. Source: the Euler-Rodrigues formula.

    Attributes:
        rx, ry, rz: Tilt of the base about its own x, y and z. A rotation about the direction of gravity has no effect.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Levelling(rx=pp.Normal(1e-3))
        >>> compliance = pp.sources.JointCompliance(joint="joint1", compliance=1e-5)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source, compliance]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.    0.007 0.   ]
    """

    depends_on: ClassVar[Dependence] = "chain"
    subject: ClassVar[str] = "base"
    deviations: ClassVar[tuple[str, ...]] = ("rx", "ry", "rz")
    words: ClassVar[Mapping[str, str]] = {name: f"level of the base about {name[1]}" for name in ("rx", "ry", "rz")}

    rx: Annotated[Setting, units.ANGLE] = 0.0
    ry: Annotated[Setting, units.ANGLE] = 0.0
    rz: Annotated[Setting, units.ANGLE] = 0.0

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield nothing."""
        return iter(())

    def gravity(
        self, posture: Posture, space: LabelledSpace
    ) -> Iterator[tuple[np.ndarray[tuple[int], np.dtype[np.float64]], Factors]]:
        """Yield ``-e × g`` for each axis e about which the base is tilted."""
        for axis, field in zip(np.eye(3), ("rx", "ry", "rz"), strict=True):
            tilt = space.value(field, getattr(self, field))
            change: NDArray[np.float64] = -np.cross(axis, posture.chain.gravity)
            if isinstance(tilt, Expression):
                yield change, (tilt,)
            elif tilt != 0.0:
                yield change * tilt, ()
