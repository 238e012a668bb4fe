"""Errors of MCPC parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, ClassVar

import numpy as np

from precision_pin.base import se3, units
from precision_pin.robot import mcpc
from precision_pin.sources.places import deviation_terms
from precision_pin.terms import Chain, Dependence, InputError, LabelledSpace, Place, Posture, Setting, Source, Term


@dataclass(frozen=True, kw_only=True)
class Mcpc(Source):
    """Errors of one link's MCPC parameters, exact at any size.

    Places are inserted at the axes of Rot(x, α), Rot(y, β) and Rot(z, γ) and at the translation of the link. The
    displaced link is then ``Rot(x, α+Δα) Rot(y, β+Δβ) [Rot(z, γ+Δγ)] Trans(x+Δx, y+Δy, [z+Δz])``. Source: eqs 1 and 2 of
    Wei, Jia and Chen (2015). An error of θ is a ``joint_offset``.

    Attributes:
        link: A URDF link of the chain link whose parameters have errors.
        alpha, beta, gamma: Δα, Δβ, Δγ; Δγ only for the last link.
        x, y, z: Δx, Δy, Δz; Δz only for the last link.

    Raises:
        InputError: Δγ or Δz on a link that is not the last.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Mcpc(link="link2", x=pp.Normal(1e-4))
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * np.sqrt(np.diag(at.covariance)[:3])).round(3))
        [0.1 0.  0. ]
    """

    depends_on: ClassVar[Dependence] = "chain"
    is_dimensional: ClassVar[bool] = True
    deviations: ClassVar[tuple[str, ...]] = ("alpha", "beta", "gamma", "x", "y", "z")
    words: ClassVar[Mapping[str, str]] = {
        **{name: f"position of {{subject}} along {name}" for name in ("x", "y", "z")},
        **{name: f"angle {name} of {{subject}}" for name in ("alpha", "beta", "gamma")},
    }

    link: str
    alpha: Annotated[Setting, units.ANGLE] = 0.0
    beta: Annotated[Setting, units.ANGLE] = 0.0
    gamma: Annotated[Setting, units.ANGLE] = 0.0
    x: Annotated[Setting, units.LENGTH] = 0.0
    y: Annotated[Setting, units.LENGTH] = 0.0
    z: Annotated[Setting, units.LENGTH] = 0.0

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each parameter whose error is not zero."""
        chain = posture.chain
        link = chain.link_frame(self.link).link
        is_last = link == len(chain.joints)
        if not is_last and (self.gamma != 0.0 or self.z != 0.0):
            raise InputError(f"{self.label()}: gamma and z are parameters of the last link only")
        nominal = _nominal(chain)
        start = nominal.frame_in_link[link]
        after_alpha = start @ se3.pose(se3.rotation_about((1, 0, 0), nominal.alpha[link]), np.zeros(3))
        after_beta = after_alpha @ se3.pose(se3.rotation_about((0, 1, 0), nominal.beta[link]), np.zeros(3))
        gamma = nominal.gamma if is_last else 0.0
        after_gamma = after_beta @ se3.pose(se3.rotation_about((0, 0, 1), gamma), np.zeros(3))
        for rank, (field, row, frame) in enumerate(
            (("alpha", 3, start), ("beta", 4, after_alpha), ("gamma", 5, after_beta))
        ):
            place = Place.custom(link, rank, f"MCPC {field} of link {link}", frame)
            yield from deviation_terms(self, place, space, {row: field})
        place = Place.custom(link, 3, f"MCPC translation of link {link}", after_gamma)
        yield from deviation_terms(self, place, space, dict(enumerate("xyz")))


@lru_cache(maxsize=8)
def _nominal(chain: Chain) -> mcpc.Mcpc:
    return mcpc.from_chain(chain)
