"""Terms: displacements of places or joint values, multiplied by random parameters.

    term = (target, twist, factors)      displacement of target += twist × product of the factors

A *target* is a joint value or a place; its twist a number or ``[d; δ]`` in the place's axes; up to three *factors* are
parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add, mul
from typing import Any, ClassVar, overload

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arguments import check_flag, check_items, check_number, check_numbers, shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.expressions import Component, Expression, Program, Value, sign
from precision_pin.draws.space import Space
from precision_pin.robot.chain import Chain
from precision_pin.robot.places import Factors, Place

MOST_FACTORS = 3
"""Maximum number of parameters in a term, the width of the term table; longer products become formulas."""


@dataclass(frozen=True)
class JointValue:
    """A joint value as a target: Δθ in rad or Δd in m of a joint (0-based on the chain)."""

    joint: int
    is_bow: ClassVar[bool] = False


Target = JointValue | Place


@dataclass(frozen=True, eq=False)
class Term:
    """A displacement: ``target += twist × product of factors``.

    Attributes:
        target: A joint value or a place.
        twist: ``(1[, P])`` for a joint value (rad or m), ``(6[, P])`` ``[d; δ]`` in a place's axes; P for a posture of
            P configurations.
        factors: At most three parameters.
        loaded: True if a load causes it, so that it depends on the location of the loads.

    Raises:
        InputError: More than three factors, or a twist of the wrong size or not finite.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> growth = pp.Term(chain.end(1), np.array([1e-3, 0, 0, 0, 0, 0]))
        >>> print(growth.loaded, growth.factors)
        False ()
    """

    target: Target
    twist: Array
    factors: Factors = ()
    loaded: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.target, JointValue | Place):
            raise InputError(f"the target of a term must be a JointValue or a Place, got {shown(self.target)}")
        size = 1 if isinstance(self.target, JointValue) else 6
        shape = (size, None) if getattr(self.twist, "ndim", 1) == 2 else (size,)
        twist = check_numbers("the twist of a term", self.twist, shape, f"{size} finite numbers for its target")
        object.__setattr__(self, "twist", twist)
        if type(self.factors) is not tuple or not all(isinstance(factor, Expression) for factor in self.factors):
            object.__setattr__(self, "factors", check_items("the factors of a term", self.factors, Expression))
        if not isinstance(self.loaded, bool):
            object.__setattr__(self, "loaded", check_flag("loaded of a term", self.loaded))
        if len(self.factors) > MOST_FACTORS:
            raise InputError(
                f"a term on {self.target} has {len(self.factors)} factors, at most {MOST_FACTORS} are allowed"
            )

    @classmethod
    def of(cls, target: Target, twist: ArrayLike, *values: Value | Array, loaded: bool = False) -> Term:
        """Return the term with numbers multiplied into the twist and expressions kept as factors.

        With more than three factors, the first ones are merged into a formula, their product. A joint value takes a
        number as twist, or P numbers for a posture of P configurations, for which a value may be P numbers too.
        """
        # most twists are numbers already, which the term checks
        is_number = isinstance(twist, float) or (type(twist) is np.ndarray and twist.dtype == np.float64)
        scaled: Array = np.atleast_1d(twist if is_number else check_numbers("the twist of a term", twist))
        if isinstance(target, JointValue) and scaled.shape[0] > 1 == scaled.ndim:
            scaled = scaled[None]
        factors: list[Expression] = []
        for value in values:
            if isinstance(value, Expression):
                factors.append(value)
            elif isinstance(value, np.ndarray):
                allowed = "a number or a parameter, or a number for each configuration"
                numbers = check_numbers("a factor of a term", value, (None,) * min(value.ndim, 1), allowed)
                scaled = (scaled.reshape(len(scaled), -1) if numbers.ndim else scaled) * numbers
            else:
                scaled = scaled * check_number("a factor of a term", value, "a number or a parameter")
        while len(factors) > MOST_FACTORS:
            factors[:2] = [factors[0] * factors[1]]
        return cls(target, scaled, tuple(factors), loaded)


class DifferentFormulas(Exception):
    """Terms at many configurations whose factors differ; each configuration alone has its own formulas."""


class TermsOfPose(Sequence[Term]):
    """Terms of posture ``pose`` of P, created on access from common terms with P twists or a common twist."""

    def __init__(self, terms: Sequence[Term], pose: int) -> None:
        self._terms, self._pose = terms, pose

    def __len__(self) -> int:
        return len(self._terms)

    @overload
    def __getitem__(self, key: int) -> Term: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[Term, ...]: ...
    def __getitem__(self, key: int | slice) -> Term | tuple[Term, ...]:
        if isinstance(key, slice):
            return tuple(self[k] for k in range(*key.indices(len(self))))
        term = self._terms[key]
        return replace(term, twist=term.twist[:, self._pose]) if term.twist.ndim == 2 else term


def on_target(target: Target, chain: Chain, twist: Array) -> Array:
    """Return a twist ``(6,)`` in a target's axes as a term takes it: of a joint value, the number along its axis."""
    if not isinstance(target, JointValue):
        return twist
    return np.atleast_1d(
        chain.axes[target.joint] @ twist[slice(0, 3) if chain.prismatic[target.joint] else slice(3, 6)]
    )


def at_means(values: Mapping[Factors, ArrayLike], space: Space) -> Array:
    """Return the sum of values × product of their factors with every component at its mean, in the shape of the values.

    This is the mean if the factors are independent and contain no formulas; zero for no values.

    Args:
        values: Numbers, all of one shape, by the parameters that multiply them: from
            :meth:`~precision_pin.robot.chain.Posture.wrench_on` or
            :meth:`~precision_pin.robot.chain.Posture.torque_on`.

    Raises:
        InputError: A formula has no value at the means.
    """
    total: Array = np.zeros(())
    for factors, value in values.items():
        share = Program.compile(factors, space.index).evaluate(space.mean[:, None]).prod() if factors else 1.0
        total = total + np.asarray(value, dtype=float) * share
    return total


def load_value(load: Mapping[Factors, float]) -> Value:
    """Return a load as a number, or as a formula if it is random."""
    constant = float(load.get((), 0.0))
    parts = [reduce(mul, factors) * float(number) for factors, number in load.items() if factors and number]
    while len(parts) > 1:
        # in pairs, which keeps the formula shallow
        parts = [reduce(add, parts[k : k + 2]) for k in range(0, len(parts), 2)]
    return parts[0] + constant if parts and constant else parts[0] if parts else constant


def bounds_of(load: Mapping[Factors, ArrayLike], space: Space) -> tuple[Array, Array]:
    """Return bounds of a load ``([P])`` over all robots; infinite if a parameter is a formula."""
    low = high = np.zeros(())
    for factors, number in load.items():
        ends = [np.asarray(number, dtype=float)]
        for factor in factors if np.any(number) else ():
            pair = space.intervals[space.index[factor.name]] if isinstance(factor, Component) else (-math.inf, math.inf)
            with np.errstate(invalid="ignore"):  # zero times an infinite bound is zero
                ends = [np.where((end == 0) | (other == 0), 0.0, end * other) for end in ends for other in pair]
        low, high = low + np.min(ends, axis=0), high + np.max(ends, axis=0)
    return low, high


def is_same_for_all(load: Mapping[Factors, ArrayLike]) -> bool:
    """Return whether a load has no random part."""
    return not any(factors and np.any(number) for factors, number in load.items())


def side_of(load: Mapping[Factors, Any], space: Space) -> Value | Array:
    """Return 1 for robots with a load ``([P])`` of zero or more, else -1: a number ``([P])`` if all robots agree.

    Raises:
        DifferentFormulas: Robots differ at one of P configurations.
    """
    low, high = bounds_of(load, space)
    if np.all((low >= 0) | (high < 0)):
        side: Array = np.where(low >= 0, 1.0, -1.0)
        return side if side.ndim else float(side)
    if low.ndim:
        raise DifferentFormulas
    value = load_value(load)
    return sign(value) if not isinstance(value, float) else 1.0 if value >= 0 else -1.0
