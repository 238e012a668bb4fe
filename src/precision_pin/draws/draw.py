"""Draw: a law with a name and a scope; and the counter word of its pose and visit."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from precision_pin.base.arguments import check_instance, check_items, check_text, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import PerJoint, Quantity
from precision_pin.draws.expressions import Expression
from precision_pin.draws.laws import Law

MOST_POSES = 2**20 - 1
MOST_VISITS = 4095
"""Poses and visits that the 32-bit word of :func:`occasion` can number: 20 bits of a pose and 12 of a visit, without 0."""


class Scope(Enum):
    """Scope of a draw: one value per robot, per pose or per visit.

    Examples:
        >>> pp.Scope("visit")
        <Scope.VISIT: 'visit'>
    """

    UNIT = "unit"
    """Once for each built robot."""
    POSE = "pose"
    """Once for each robot and pose."""
    VISIT = "visit"
    """Once for each robot, pose and visit."""


def occasion(scope: Scope, pose: int = 0, visit: int = 0) -> int:
    """Return the last counter word of a draw; raise InputError for more than 2²⁰-1 poses or 4095 visits."""
    check_whole("the pose", pose, 0, MOST_POSES - 1)
    check_whole("the visit", visit, 0, MOST_VISITS - 1)
    first = (pose + 1) * 4096
    return {Scope.UNIT: 0, Scope.POSE: first, Scope.VISIT: first + visit + 1}[scope]


@dataclass(frozen=True)
class Draw:
    """The unit of randomness: a law with a name and a scope.

    Attributes:
        name: Selects the stream of random numbers. May be empty inside a source's setting: the draw is then named after
            the setting, ``source[joint or link].field``.
        law: The distribution.
        scope: Frequency of drawing.
        quantities: The quantity of each component, None if unknown; empty if all are. Not compared by ``==``.
        names: Names of the components; empty for the draw's name with the law's suffixes.
        limits: The limits of a drawing's tolerance as read; else empty. Not compared by ``==``.

    Examples:
        >>> gap = pp.Draw("gap", pp.Uniform(0.1e-3), pp.Scope.VISIT)
        >>> print(gap.name, gap.scope.value)
        gap visit
    """

    name: str
    law: Law
    scope: Scope = Scope.UNIT
    quantities: tuple[Quantity | PerJoint | None, ...] = field(default=(), compare=False, repr=False)
    names: tuple[str, ...] = field(default=(), repr=False)
    limits: str = field(default="", compare=False, repr=False)

    def __post_init__(self) -> None:
        check_text("the name of a draw", self.name)
        check_instance(f"the law of the draw {self.name!r}", self.law, Law, "such as Normal(0.1e-3)")  # type: ignore[type-abstract]
        check_instance(f"the scope of the draw {self.name!r}", self.scope, Scope, "such as Scope.UNIT")
        object.__setattr__(self, "names", check_items(f"the names of the draw {self.name!r}", self.names, str))
        if self.quantities and len(self.quantities) != self.law.size:
            raise InputError(
                f"the draw {self.name!r} has {len(self.quantities)} quantities for {self.law.size} numbers"
            )
        if self.names and len(self.names) != self.law.size:
            raise InputError(f"the draw {self.name!r} has {len(self.names)} names for {self.law.size} numbers")

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components."""
        return self.names or tuple(self.name + suffix for suffix in self.law.components)

    @property
    def tolerance(self) -> str:
        """The range of variation, :meth:`precision_pin.draws.laws.Law.tolerance`; empty if no quantity is known."""
        return self.law.tolerance(self.known_quantities)

    @property
    def known_quantities(self) -> tuple[Quantity | None, ...]:
        """The quantity of each component, None if unknown or if, outside a model, it depends on the kind of joint."""
        quantities = self.quantities or (None,) * self.law.size
        return tuple(None if isinstance(quantity, PerJoint) else quantity for quantity in quantities)

    @property
    def covariance(self) -> Array:
        """Covariance of the components, ``(size, size)``.

        Raises:
            InputError: It overflows.
        """
        try:
            matrix = self.law.covariance
        except (OverflowError, FloatingPointError):
            matrix = np.array([[np.inf]])
        if not np.isfinite(matrix).all():
            raise InputError(f"the variance of {self.name!r} overflows; its tolerance is far too large")
        return matrix


Setting = float | str | Law | Draw | Expression
"""A source's setting: a number (SI), a parameter's name, a law, a draw, or a formula."""
