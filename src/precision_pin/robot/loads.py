"""The weights on a chain, and its state under load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from precision_pin.base.arguments import check_numbers
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.draws.expressions import Expression
from precision_pin.robot.places import LinkFrame
from precision_pin.robot.urdf import Robot

Factors = tuple[Expression, ...]
"""Parameters whose product multiplies a number; none for a constant."""


@final
@dataclass(frozen=True, eq=False)
class Load:
    """A weight on the chain.

    Attributes
    ----------
    link
        Chain link that carries it.
    frame
        The frame of its moments, in the chain link's axes, ``(4, 4)``.
    attachment
        The point of the chain link at which it acts, in the chain link's axes, ``(3,)``.
    along
        True for the weight of the link's own body, which is spread evenly along the link.
    moments
        Mass (kg) and first moment (kg·m) ``(4,)`` with the parameters that multiply them; these add.
    stretch
        Ends of the part of the link that it is the weight of, ``(2, 3)``, in the chain link's axes. ``None``: the whole
        link for a weight ``along`` it; for any other weight a point.
    """

    link: int
    frame: Array
    attachment: Array
    along: bool
    moments: tuple[tuple[Array, Factors], ...]
    stretch: Array | None = None

    def __post_init__(self) -> None:
        for name, shape in (("frame", (4, 4)), ("attachment", (3,)), ("stretch", (2, 3))):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, check_numbers(f"{name} of a load", getattr(self, name), shape))
        moments = tuple(
            (check_numbers("mass and first moment of a load", values, (4,)), factors)
            for values, factors in self.moments
        )
        object.__setattr__(self, "moments", moments)


@final
@dataclass(frozen=True, eq=False)
class Deflection:
    """The state of a chain under load.

    Attributes
    ----------
    links, ends
        Chain links and their far ends, ``(n+1, 4, 4)``, base.
    bending
        Displacement of each chain link's far end by the loads, ``[d; δ]`` in the end's axes, ``(n+1, 6)``.
    """

    links: Array
    ends: Array
    bending: Array

    def __post_init__(self) -> None:
        fix_fields(self)


def own_loads(robot: Robot, frames: Mapping[str, LinkFrame]) -> tuple[Load, ...]:
    """Return the weights of the URDF's links."""
    loads = []
    for link in robot.links:
        if link.inertial is None or link.inertial.mass == 0:
            continue
        where = frames[link.name]
        moments = link.inertial.mass * np.array([1.0, *link.inertial.com])
        entry = where.entry(link.inertial.com)
        loads.append(Load(where.link, where.frame, entry, where.is_own, ((moments, ()),), where.stretch))
    return tuple(loads)
