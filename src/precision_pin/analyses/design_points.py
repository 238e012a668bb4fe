"""FORM: the most likely failures, searched from many sides.

In standard normal numbers u, the point of the failure surface nearest to the origin is the most likely failure; its
distance β is the reliability index, Φ(-β) the probability beyond the tangent plane there, and the squares of the unit
vector towards it tell how much each number matters (Hasofer and Lind 1974; Rackwitz and Fiessler 1978).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

__all__ = ["FARTHEST", "DesignPoint", "Form", "Margin", "form"]

Array = NDArray[np.float64]
Margin = Callable[[Array], Array]
"""What is left up to failure, ``(N,)``, for standard normal numbers ``(d, N)``; negative where it fails."""

FARTHEST: Final = 8.2
"""Standard normal numbers are searched up to this distance: a probability of 1e-16."""

_STEP: Final = 1e-4
_MOST_STEPS: Final = 200
_MOST_BEYOND: Final = 12
_HALVINGS: Final = 12
_TOLERANCE: Final = 1e-7
_APART: Final = 1e-2


@final
@dataclass(frozen=True, eq=False)
class DesignPoint:
    """A point of the failure surface nearest to the origin among its neighbours.

    Attributes
    ----------
    u
        Standard normal numbers, ``(d,)``.
    beta
        Its distance, negative where the origin itself fails.
    importance
        Squares of the unit vector towards it, ``(d,)``, with the sum 1.
    """

    u: Array
    beta: float
    importance: Array

    @property
    def probability(self) -> float:
        """Φ(-β)."""
        return float(special.ndtr(-self.beta))


@final
@dataclass(frozen=True, eq=False)
class Form:
    """What the search found.

    Attributes
    ----------
    points
        Distinct design points, nearest first; empty if there is none within 8.2.
    starts
        From how many points it started.
    """

    points: tuple[DesignPoint, ...]
    starts: int

    @property
    def probability(self) -> float | None:
        """Φ(-β) of the nearest point."""
        return self.points[0].probability if self.points else None

    @property
    def range(self) -> tuple[float, float] | None:
        """Between the largest single probability and the sum of all: the bounds of a union of half spaces."""
        if not self.points:
            return None
        if self.points[0].beta < 0:
            return self.points[0].probability, self.points[0].probability
        return self.points[0].probability, min(1.0, sum(point.probability for point in self.points))


def form(margin: Margin, size: int, starts: Sequence[Array]) -> Form:
    """Return the distinct design points that the searches from ``starts``, each ``(d,)``, lead to.

    Each step is that of Hasofer, Lind, Rackwitz and Fiessler, shortened until the merit |u|²/2 + c |g| falls (Zhang and
    Der Kiureghian, 1995); gradients are central differences.

    Parameters
    ----------
    margin
        The limit state.
    size
        d, how many numbers.
    starts
        Where to begin.
    """
    at_origin = float(margin(np.zeros((size, 1)))[0])
    found: list[DesignPoint] = []
    for start in starts:
        u = _search(margin, start.astype(float), abs(at_origin) or 1.0)
        if u is None:
            continue
        distance = float(np.linalg.norm(u))
        _, gradient = _with_gradient(margin, u)
        slope = float(np.linalg.norm(gradient))
        towards = gradient / slope if distance < 1e-9 and slope > 0 else u / max(distance, 1e-300)
        found.append(DesignPoint(u, math.copysign(distance, at_origin), towards**2))
    distinct: list[DesignPoint] = []
    for point in sorted(found, key=lambda point: abs(point.beta)):
        if all(np.linalg.norm(point.u - other.u) > _APART * max(1.0, abs(point.beta)) for other in distinct):
            distinct.append(point)
    return Form(tuple(distinct), len(starts))


def _search(margin: Margin, u: Array, scale: float) -> Array | None:
    """Return the point that one search ends at, or None if it does not settle within 8.2."""
    value, gradient = _with_gradient(margin, u)
    beyond = 0
    for _ in range(_MOST_STEPS):
        square = float(gradient @ gradient)
        if square <= (1e-12 * scale) ** 2:
            return None
        aim = (gradient @ u - value) / square * gradient
        if float(np.linalg.norm(aim)) > FARTHEST:
            aim *= FARTHEST / float(np.linalg.norm(aim))
            beyond += 1
            if beyond > _MOST_BEYOND:
                return None
        else:
            beyond = 0
        direction = aim - u
        if abs(value) <= _TOLERANCE * scale and float(np.linalg.norm(direction)) <= _TOLERANCE * 10:
            return u
        penalty = 2 * max(float(np.linalg.norm(u)), float(np.linalg.norm(aim)), 1.0) / math.sqrt(square)
        merit = float(u @ u) / 2 + penalty * abs(value)
        lengths = 0.5 ** np.arange(_HALVINGS)
        tried = u[:, None] + direction[:, None] * lengths
        merits = (tried**2).sum(axis=0) / 2 + penalty * np.abs(margin(tried))
        better = np.flatnonzero(merits < merit)
        if not better.size:
            return u if abs(value) <= 1e-6 * scale and float(np.linalg.norm(direction)) <= 1e-3 else None
        u = tried[:, better[0]]
        value, gradient = _with_gradient(margin, u)
    return u if abs(value) <= 1e-6 * scale and float(np.linalg.norm(direction)) <= 1e-3 else None


def _with_gradient(margin: Margin, u: Array) -> tuple[float, Array]:
    steps = _STEP * np.eye(u.size)
    values = margin(np.concatenate([u[:, None], u[:, None] + steps, u[:, None] - steps], axis=1))
    return float(values[0]), (values[1 : u.size + 1] - values[u.size + 1 :]) / (2 * _STEP)
