"""Spring, gas spring or cable between two links."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from precision_pin.base.arguments import check_instance
from precision_pin.robot.places import Pull
from precision_pin.terms import (
    Chain,
    Dependence,
    Expression,
    Factors,
    InputError,
    LabelledSpace,
    Load,
    Posture,
    Setting,
    Source,
    Term,
    Value,
    units,
)


@dataclass(frozen=True, kw_only=True)
class StrutEnd:
    """One end of a strut.

    Attributes:
        link: The link; ``base`` is that of the chain, whatever its name.
        point: Position in that link's frame.
    """

    link: str
    point: Annotated[tuple[float, float, float], units.LENGTH] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.point) != 3:
            raise InputError(f"the point: of strut has {len(self.point)} numbers, expected 3")

    def on(self, chain: Chain) -> Load:
        """Return the end as a load without a weight; UnknownNameError if there is no such link."""
        name = chain.base if self.link == "base" and "base" not in chain.link_frames else self.link
        carrier = chain.link_frame(name)
        return Load(carrier.link, carrier.frame_at(self.point), carrier.entry(self.point), along=False, moments=())


@dataclass(frozen=True, kw_only=True)
class Strut(Source):
    """A gas spring, a helical spring or a cable between points A and B of two links. It displaces nothing itself.

    Its tension T pulls the ends towards each other, a push is a negative tension, so with ``L = |B - A|`` a joint between the
    links feels ``τ = -T ∂L/∂q``, and bearings and links on the way from A to B the whole force. A gas spring has ``T = -(P₀ - c
    (L - L₀))``, linear in its length; a helical spring ``T = c (L - L_f)``, which pushes where it is shorter than L_f; a cable
    the same T at every length, as under a counterweight. With statics: equilibrium, length and direction are those of the
    deflected arm. Without friction, damping and mass.

    Attributes:
        from_: One end A, ``{link: …, point: …}``; the sheet's key is ``from``. ``link: base`` is that of the chain.
        to: The other end B, ``{link: …, point: …}``.
        push: P₀, the force with which a gas spring pushes at the length L₀.
        rate: c: by how much less a gas spring pushes, or more a helical one pulls, for each length that it extends.
        at_length: L₀, needed with the rate of a gas spring.
        free_length: L_f of a helical spring, the length without force; may be zero.
        tension: T of a cable.

    Raises:
        InputError: Not one of push, free_length and tension; a setting of another kind; both ends on one link.

    Examples:
        >>> from precision_pin.sources.strut import StrutEnd
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> above = StrutEnd(link="base", point=(3.74, -0.274, 1.085))
        >>> source = pp.sources.Strut(from_=above, to=StrutEnd(link="tool"), tension=9.80665)
        >>> compliance = pp.sources.JointCompliance(joint="joint2", compliance=1e-5)
        >>> at = pp.ErrorModel(chain, pp.Space(), [source, compliance]).at([0, 0, 0, 0])
        >>> print(round(1e3 * at.error_at_means[2], 3))
        -5.129
    """

    depends_on: ClassVar[Dependence] = "configuration"
    takes_many: ClassVar[bool] = True
    words: ClassVar[Mapping[str, str]] = {
        "push": "push of the strut {subject}",
        "rate": "rate of the strut {subject}",
        "at_length": "length of the strut {subject} at which its push is given",
        "free_length": "free length of the strut {subject}",
        "tension": "tension of the strut {subject}",
    }

    from_: StrutEnd
    to: StrutEnd
    push: Annotated[Setting | None, units.FORCE] = None
    rate: Annotated[Setting | None, units.LINEAR_STIFFNESS] = None
    at_length: Annotated[Setting | None, units.LENGTH] = None
    free_length: Annotated[Setting | None, units.LENGTH] = None
    tension: Annotated[Setting | None, units.FORCE] = None

    def __post_init__(self) -> None:
        for name, end in (("from", self.from_), ("to", self.to)):
            check_instance(f"{name} of strut", end, StrutEnd, "StrutEnd(link=…, point=…)")
        if self.from_.link == self.to.link:
            raise InputError(f"both ends of strut are on the link {self.to.link!r}, which it cannot move")
        if sum(setting is not None for setting in (self.push, self.free_length, self.tension)) != 1:
            raise InputError(
                "strut needs one of push: (a gas spring), free_length: with rate: (a helical one) and tension: (a cable)"
            )
        if self.free_length is not None and self.rate is None:
            raise InputError("free_length: of strut needs rate:")
        if self.tension is not None and self.rate is not None:
            raise InputError("tension: of strut is that of a cable, the same at every length; rate: is of a spring")
        if (self.at_length is None) is not (self.push is None or self.rate is None):
            raise InputError("a gas spring's rate: and at_length: of strut are given together")

    @property
    def subject(self) -> str:
        """Both links."""
        return f"{self.from_.link}-{self.to.link}"

    def is_alike_everywhere(self, chain: Chain) -> bool:
        """Return True: there are no terms."""
        return True

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield nothing; InputError if both ends are at one point."""
        pull = self._pull(posture.chain, space)
        pull.wrenches(pull.ends[0].link, posture.carrier)
        return iter(())

    def loads(self, posture: Posture, space: LabelledSpace) -> Iterator[Load]:
        """Yield both ends."""
        yield from self._pull(posture.chain, space).loads

    def _pull(self, chain: Chain, space: LabelledSpace) -> Pull:
        ends = self.from_.on(chain), self.to.on(chain)
        if ends[0].link == ends[1].link:
            raise InputError(f"{space.label}: no joint of the chain lies between its ends, so it does nothing")
        if self.tension is not None:
            return Pull(space.label, ends, (_part(1.0, 0.0, space.positive("tension", self.tension)),))
        parts = []
        if self.push is not None:
            parts.append(_part(-1.0, 0.0, space.positive("push", self.push, zero=True)))
        if self.rate is not None:
            rate = space.positive("rate", self.rate, zero=True)
            name = "free_length" if self.push is None else "at_length"
            length = space.positive(name, getattr(self, name), zero=True)
            parts += [_part(0.0, 1.0, rate), _part(-1.0, 0.0, rate, length)]
        return Pull(space.label, ends, tuple(parts))


def _part(constant: float, slope: float, *values: Value) -> tuple[float, float, Factors]:
    """Return a part of the tension that is multiplied by some values."""
    scale = float(np.prod([value for value in values if not isinstance(value, Expression)]))
    factors = tuple(value for value in values if isinstance(value, Expression))
    return constant * scale, slope * scale, factors
