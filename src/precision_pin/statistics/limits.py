"""Quantities that a specification limits, and their values at a pose.

Each is the length of one to three components of the error ``[d; δ]``, along base axes or along the tool's axes at the
nominal pose R, whose columns they are:

- ``lateral``: distance across the tool's z, ``√((Rᵀd)₁² + (Rᵀd)₂²)``; ``axial``: ``|(Rᵀd)₃|``, the distance along it;
- ``zone``: twice ``lateral``, the smallest diametral position zone of ISO 1101 about the nominal axis that holds the tip;
- ``tilt``: angle between the tool's z and its nominal z, exact: with θ = |δ| its chord ``2 sin(tilt/2)`` is
  ``√((Rᵀδ)₁² + (Rᵀδ)₂²) · sin(θ/2)/(θ/2)``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arrays import Array

_ALONG: Final = {"x": (0,), "y": (1,), "z": (2,)}


@dataclass(frozen=True)
class Limited:
    """A quantity as the length of components of the error.

    Attributes:
        symbol: Symbol of its absolute value.
        first: First row of its vector in ``[d; δ]``: 0 or 3.
        axes: Components of this vector.
        in_tool: Whether they are along the tool's axes instead of base axes.
        factor: Number of lengths in a quantity: 2 for a diameter.
        is_tilt: Whether it is the angle between the tool's z and its nominal z.
    """

    symbol: str
    first: int
    axes: tuple[int, ...]
    in_tool: bool = False
    factor: float = 1.0
    is_tilt: bool = False

    @property
    def rows(self) -> list[int]:
        """Rows of ``[d; δ]`` that its components are made of."""
        return [self.first + axis for axis in ((0, 1, 2) if self.in_tool else self.axes)]

    def along(self, tool_axes: ArrayLike) -> Array:
        """Return its components as rows to multiply with ``[d; δ]``, ``(k, 6)``, the factor included."""
        rows = np.zeros((len(self.axes), 6))
        axes = np.asarray(tool_axes, dtype=float).T if self.in_tool else np.eye(3)
        rows[:, self.first : self.first + 3] = self.factor * axes[list(self.axes)]
        return rows

    def length(self, limit: float) -> float:
        """Return the length of the components at a limit: of a tilt its chord, which the length of δ exceeds."""
        return 2 * math.sin(limit / 2) if self.is_tilt else limit / self.factor


LIMITED: Final = {
    "position.norm": Limited("|d|", 0, (0, 1, 2)),
    **{f"position.{axis}": Limited(f"|d{axis}|", 0, rows) for axis, rows in _ALONG.items()},
    "attitude.norm": Limited("|δ|", 3, (0, 1, 2)),
    **{f"attitude.{axis}": Limited(f"|δ{axis}|", 3, rows) for axis, rows in _ALONG.items()},
    **{f"position.tool_{axis}": Limited(f"|tool d{axis}|", 0, rows, True) for axis, rows in _ALONG.items()},
    **{f"attitude.tool_{axis}": Limited(f"|tool δ{axis}|", 3, rows, True) for axis, rows in _ALONG.items()},
    "position.lateral": Limited("lateral", 0, (0, 1), True),
    "position.axial": Limited("axial", 0, (2,), True),
    "position.zone": Limited("zone", 0, (0, 1), True, factor=2.0),
    "attitude.tilt": Limited("tilt", 3, (0, 1), True, is_tilt=True),
}
"""Limited quantities by result name; the eight of every result come first."""

LIMITED_WORDS: Final = {
    **{f"tool {axis}": f"position.tool_{axis}" for axis in _ALONG},
    **{f"tool r{axis}": f"attitude.tool_{axis}" for axis in _ALONG},
    **{name.partition(".")[2]: name for name, of in LIMITED.items() if of.in_tool and "tool_" not in name},
}
"""Words for the quantities along tool axes."""

SINE_SERIES: Final = tuple(accumulate(range(1, 13), lambda last, k: -last / (2 * k * (2 * k + 1)), initial=1.0))
"""Coefficients of ``sin(√q)/√q`` in powers of q, to rounding for rotations up to 2π."""


class Condition(NamedTuple):
    """At a pose: the length of ``axes @ [d; δ]``, axes ``(1 to 3, 6)``, is at most ``limit``; of a tilt, its chord."""

    axes: Array
    limit: float
    is_tilt: bool

    @property
    def matrix(self) -> Array:
        """The axes with rows of zeros, ``(3, 6)``."""
        return np.pad(self.axes, ((0, 3 - len(self.axes)), (0, 0)))

    def lengths(self, errors: Array) -> Array:
        """Return the lengths ``(N,)`` for errors ``(6, N)``, with the bits of the compiled sampler."""
        square = np.zeros(errors.shape[1])
        for row in self.axes:
            along = row[0] * errors[0]
            for k in range(1, 6):
                along = along + row[k] * errors[k]
            square = square + along * along
        length = np.sqrt(square)
        if self.is_tilt:
            quarter = 0.25 * (errors[3] * errors[3] + errors[4] * errors[4] + errors[5] * errors[5])
            shortening = np.full_like(quarter, SINE_SERIES[-1])
            for coefficient in SINE_SERIES[-2::-1]:
                shortening = shortening * quarter + coefficient
            length = length * shortening
        return length


def condition(quantity: str, limit: float, tool_axes: ArrayLike) -> Condition:
    """Return the condition |quantity| ≤ limit at a pose with tool axes ``(3, 3)``, columns in the base."""
    of = LIMITED[quantity]
    return Condition(of.along(tool_axes), of.factor * of.length(limit), of.is_tilt)


def absolute_values(quantity: str, errors: Array, tool_axes: ArrayLike) -> Array:
    """Return the absolute values ``(N,)``, m or rad, of a quantity for errors ``(6, N)``."""
    lengths = condition(quantity, 0.0, tool_axes).lengths(errors)
    return 2 * np.arcsin(np.minimum(lengths / 2, 1.0)) if LIMITED[quantity].is_tilt else lengths


def are_inside(conditions: Iterable[Condition], errors: Array) -> NDArray[np.bool_]:
    """Return which of the errors ``(6, N)`` keep all conditions, ``(N,)``."""
    is_inside = np.ones(errors.shape[1], dtype=np.bool_)
    for one in conditions:
        is_inside &= one.lengths(errors) <= one.limit
    return is_inside


_NO_SPREAD: Final = 1e-6
"""Fraction of a vector's spread below which the spread along an axis counts as rounding of its covariance."""


def moves(conditions: Sequence[Condition], covariance: Array, least: float) -> bool:
    """Return whether errors of covariance ``(6, 6)`` spread by more than ``least`` along the rows of a condition."""
    spreads = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    for one in conditions:
        along = np.einsum("ri,ij,rj->r", one.axes, covariance, one.axes)
        rounding = _NO_SPREAD * (np.abs(one.axes) @ spreads)
        if (np.sqrt(np.maximum(along, 0.0)) > np.maximum(rounding, least)).any():
            return True
    return False
