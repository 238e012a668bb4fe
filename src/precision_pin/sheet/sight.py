"""Standard deviation of an instrument that measures along a line of sight, such as a laser tracker.

At the distance r the standard deviations are ``a₀ + a₁ r`` along the line and ``b₀ + b₁ r`` in each direction across it. With
the unit vector u of the line, a reading of a point has the covariance

    (a₀ + a₁ r)² u uᵀ + (b₀ + b₁ r)² (I - u uᵀ).

A distance, as of an interferometer or a ballbar, has the first of both only.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field

from precision_pin.base import units
from precision_pin.base.arguments import shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.units import LENGTH, RELATIVE_LENGTH

DIRECTIONS: Final = ("along", "across")
_PLUS: Final = re.compile(r"(?<=[^eE\s])\s*\+")
_DEFAULT: Final = "10 um + 5 um/m"


class SightEntry(BaseModel):
    """Standard deviations along the line of sight and across it."""

    model_config = ConfigDict(extra="forbid")

    along: str = Field(description="Along the line of sight, such as '10 um + 0.3 um/m'.")
    across: str = Field(description="In each direction across it, such as '15 um + 6 um/m'.")


@dataclass(frozen=True)
class Sight:
    """Standard deviations: a constant, m, and a share of the distance, m/m, each along the line of sight and across it.

    ``across`` is ``None`` where only distances are read.
    """

    along: tuple[float, float]
    across: tuple[float, float] | None

    @classmethod
    def of(cls, value: Mapping[str, object]) -> Sight:
        """Return the deviations of ``{along: …, across: …}``, texts or lengths in m; raise for anything else."""
        if set(value) != set(DIRECTIONS):
            raise InputError(
                f"std of a measurement needs along and across, such as {{along: {_DEFAULT}, across: {_DEFAULT}}}, got "
                f"{shown(dict(value))}"
            )
        return cls(*(_terms(f"std, {name} the line of sight,", value[name]) for name in DIRECTIONS))

    @classmethod
    def of_distance(cls, text: str) -> Sight | None:
        """Return the deviations of a distance, ``"10 um + 0.3 um/m"``; ``None`` for a text of one number."""
        return cls(_terms("std of a distance", text), None) if _PLUS.search(text) else None

    def distance_variance(self, distances: ArrayLike) -> Array:
        """Return the variances of distances ``(P,)``, m²."""
        return np.asarray((self.along[0] + self.along[1] * np.asarray(distances)) ** 2)

    def covariance(self, origin: Array, points: Array) -> Array:
        """Return the covariances ``(P, 3, 3)``, m², of points ``(P, 3)`` read from an origin ``(3,)``, in their axes, m."""
        lines = np.asarray(points) - origin
        distances = np.linalg.norm(lines, axis=1)
        # at the origin itself there is no line, and all directions are across
        directions = lines / np.where(distances > 0, distances, 1.0)[:, None]
        constant, share = self.across or self.along
        along, across = self.distance_variance(distances), (constant + share * distances) ** 2
        lengthwise = np.einsum("pi,pj->pij", directions, directions)
        return np.asarray(across[:, None, None] * np.eye(3) + (along - across)[:, None, None] * lengthwise)

    def __str__(self) -> str:
        if self.across is None:
            return _text(self.along)
        return f"{_text(self.along)} along, {_text(self.across)} across"


def _text(terms: tuple[float, float]) -> str:
    return f"{1e6 * terms[0]:.4g} µm + {1e6 * terms[1]:.4g} µm/m"


def _terms(what: str, value: object) -> tuple[float, float]:
    """Return constant and share of ``"10 um + 0.3 um/m"``, in either order; of a number in m."""
    terms: dict[str, float] = {}
    texts = map(str.strip, _PLUS.split(value)) if isinstance(value, str) else [f"{value} m"]
    for text in texts:
        try:
            number = units.parse(text, LENGTH, RELATIVE_LENGTH)
        except InputError as error:
            raise InputError(f"{what} such as {_DEFAULT!r}: {error.findings[0].message}") from None
        quantity = "share" if units.split(text)[1] in RELATIVE_LENGTH.units else "constant"
        if number < 0 or quantity in terms:
            raise InputError(f"{what} must be a length and a share of the distance, not negative, got {shown(value)}")
        terms[quantity] = number
    if not terms.get("constant"):
        raise InputError(f"{what} must have a length above zero, as {_DEFAULT!r} has, got {shown(value)}")
    return terms["constant"], terms.get("share", 0.0)
