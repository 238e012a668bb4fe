"""Costs of a tolerance as functions of its width."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from precision_pin import units
from precision_pin.errors import InputError
from precision_pin.inputs.arguments import shown
from precision_pin.typing import Array

__all__ = ["Cost", "read_cost"]

_COUNTS: Final = {"reciprocal": 1, "squared": 1, "power": 2, "exponential": 2, "logarithmic": 2}


@final
@dataclass(frozen=True)
class Cost:
    """A cost that falls with the tolerance t (m, rad) and is convex in it.

    Attributes
    ----------
    kind
        ``reciprocal`` c/t, ``squared`` c/t², ``power`` b t^(-k), ``exponential`` b exp(-c t), ``logarithmic`` c ln(t_max/t).
    numbers
        Its one or two positive numbers, SI.
    """

    kind: str
    numbers: tuple[float, ...]

    def at(self, t: Array) -> Array:
        """Return the cost of tolerances."""
        first = self.numbers[0]
        if self.kind == "exponential":
            result: Array = first * np.exp(-self.numbers[1] * t)
        elif self.kind == "logarithmic":
            result = first * np.log(self.numbers[1] / t)
        else:
            result = first * t**-self._power
        return result

    def slope(self, t: Array) -> Array:
        """Return its derivative with respect to the tolerance, which is negative."""
        first = self.numbers[0]
        if self.kind == "exponential":
            result: Array = -first * self.numbers[1] * np.exp(-self.numbers[1] * t)
        elif self.kind == "logarithmic":
            result = -first / t
        else:
            result = -first * self._power * t ** (-self._power - 1)
        return result

    @property
    def _power(self) -> float:
        return {"reciprocal": 1.0, "squared": 2.0}.get(self.kind) or self.numbers[1]


def read_cost(given: object, where: str) -> Cost:
    """Return the cost that a mapping of one kind to its numbers states.

    Raises
    ------
    InputError
        Another kind, or numbers that are not positive.
    """
    if not isinstance(given, Mapping) or len(given) != 1 or next(iter(given)) not in _COUNTS:
        raise InputError(f"{where}: a cost is one of {', '.join(_COUNTS)} with its numbers, got {shown(given)}")
    kind, numbers = next(iter(given.items()))
    listed = list(numbers) if isinstance(numbers, list | tuple) else [numbers]
    if len(listed) != _COUNTS[kind]:
        raise InputError(f"{where}: the cost {kind} has {_COUNTS[kind]} numbers, got {shown(numbers)}")
    values = tuple(_number(one, where) for one in listed)
    return Cost(kind, values)


def _number(given: object, where: str) -> float:
    """Return a positive number; a length or an angle in SI, without a unit as it stands."""
    try:
        numbers, unit = units.split(str(given))
        value = units.parse(str(given), units.LENGTH, units.ANGLE) if unit else numbers[0]
    except InputError as error:
        raise InputError(f"{where}: {error.findings[0].message}") from None
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{where}: a number of a cost must be positive, got {shown(given)}")
    return float(value)
