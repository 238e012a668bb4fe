"""Thermal growth and bending."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from precision_pin.base import se3, units
from precision_pin.sources.places import direction_of, is_fixed
from precision_pin.terms import Array, Chain, Dependence, InputError, LabelledSpace, Posture, Setting, Source, Term


@dataclass(frozen=True, kw_only=True)
class Thermal(Source):
    """Links that are warmer than when they were measured, either evenly or on one side.

    With p from a link's start (its joint's origin) to its end (the next joint's, or the tip) and l = |p|, an even
    change ΔT moves the end by ``α ΔT p``. A gradient g across the link, G = g × its direction made normal to p, bends
    it into an arc: the warm side grows, the link bends away from it with curvature α|G|, its end turns by ``-α p × G``
    and moves by ``-α G l²/2``. Source: Boley and Weiner, Theory of Thermal Stresses (1960), free beams: a temperature
    that is linear over the section strains and bends them without stress. Bodies at rest; the travel of a prismatic
    joint does not grow, since its encoder sets it.

    Attributes:
        link: A URDF link of the chain link that is warmer (default: all links of the arm, with common draws).
        expansion: Coefficient of linear expansion α.
        temperature_change: ΔT, the link's mean temperature minus that at which it was measured (20 °C by ISO 1).
        gradient: g, change of temperature per distance across the link.
        across: Direction in which it gets warmer, ``[-]x|y|z of JOINT`` (axes of its frame after its motion) or of the
            chain's base link, or ``[-]axis of JOINT``; only its part normal to the link counts. Only with gradient.
        time_constant: τ of the warming-up: t after a start from cold, change and gradient are ``1 - exp(-t/τ)`` of what
            they become. Only drift (ISO 9283) looks at them before the end.

    Raises:
        InputError: Neither a change nor a gradient, a gradient without direction or the reverse, a time constant that
            is not positive, or a named link without length.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> source = pp.sources.Thermal(expansion=23e-6, temperature_change=10.0)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source]).at([0, 0, 0, 0])
        >>> print((1e3 * at.error_at_means[:3]).round(3))
        [ 0.86  -0.063  0.02 ]
    """

    takes_many: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {
        "expansion": "thermal expansion of {subject}",
        "temperature_change": "temperature of {subject}",
        "gradient": "temperature gradient of {subject}",
    }

    link: str | None = None
    expansion: Annotated[Setting, units.THERMAL_EXPANSION]
    temperature_change: Annotated[Setting | None, units.TEMPERATURE_DIFFERENCE] = None
    gradient: Annotated[Setting | None, units.TEMPERATURE_GRADIENT] = None
    across: str | None = None
    time_constant: Annotated[float | None, units.TIME] = None

    def __post_init__(self) -> None:
        if self.temperature_change is None and self.gradient is None:
            raise InputError("thermal needs temperature_change: or gradient:, or both")
        if (self.gradient is None) != (self.across is None):
            raise InputError("thermal needs both of gradient: and across:")
        if self.time_constant is not None and not self.time_constant > 0:
            raise InputError(f"time_constant must be positive, got {self.setting_text('time_constant')}")

    @property
    def subject(self) -> str:
        """The link, or ``arm`` for all links."""
        return self.link or "arm"

    @property
    def depends_on(self) -> Dependence:
        """The chain, or the configuration if there is a gradient, whose direction it turns."""
        return "chain" if self.gradient is None else "configuration"

    def is_alike_everywhere(self, chain: Chain) -> bool:
        """Return whether the direction of the gradient is fixed in every link that bends."""
        return self.across is None or all(is_fixed(self.across, chain, link) for link in self._links(chain))

    def after(self, seconds: float, space: LabelledSpace) -> Thermal:
        """Return the source with the part of its change and gradient present ``seconds`` after a cold start."""
        if self.time_constant is None:
            return self
        fraction = -math.expm1(-seconds / self.time_constant)
        parts = {
            name: fraction * space.value(name, setting)
            for name in ("temperature_change", "gradient")
            if (setting := getattr(self, name)) is not None
        }
        return replace(self, **parts)  # type: ignore[arg-type]

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for growth and one for bending, for each link that has a length."""
        chain = posture.chain
        expansion = space.value("expansion", self.expansion)
        for link in self._links(chain):
            place = chain.end(link)
            axes = place.frame[:3, :3].T
            vector = place.frame[:3, 3]
            if not vector.any():
                if self.link is not None:
                    raise InputError(f"{self.label()}: the link has no length, so it cannot grow or bend")
                continue
            if self.temperature_change is not None:
                change = space.value("temperature_change", self.temperature_change)
                yield Term.of(place, np.concatenate([axes @ vector, np.zeros(3)]), expansion, change)
            if self.gradient is not None:
                gradient = space.value("gradient", self.gradient)
                to_link = posture.link_poses[link][:3, :3].swapaxes(0, 1)
                bending = _bending(vector, se3.turn(to_link, self._direction(posture)))
                yield Term.of(place, np.concatenate([axes @ bending[:3], axes @ bending[3:]]), expansion, gradient)

    def _links(self, chain: Chain) -> Sequence[int]:
        return range(len(chain.joints) + 1) if self.link is None else (chain.link_frame(self.link).link,)

    def _direction(self, posture: Posture) -> Array:
        assert self.across is not None
        return direction_of(self.across, posture)


def _bending(vector: Array, gradient: Array) -> Array:
    """Return the end's shift and rotation ``(6[, P])`` for a unit ``gradient`` and unit expansion."""
    normal = (gradient.T - vector * ((gradient.T @ vector)[..., None] / (vector @ vector))).T
    return np.concatenate([-normal * (vector @ vector) / 2, -np.cross(vector, normal, axisb=0, axisc=0)])
