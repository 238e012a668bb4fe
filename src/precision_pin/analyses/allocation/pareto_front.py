"""Pareto front of an allocation: the least cost against limits that are all wider or narrower by a factor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import monotonic
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.allocation.convex_program import Programme, Solution
from precision_pin.analyses.allocation.grades import solve_with_grades
from precision_pin.base.arrays import Array
from precision_pin.base.record import Record

MOST_POINTS: Final = 1000
_REACH: Final = 3.0
"""Largest factor of the limits, and its inverse."""
_EDGE: Final = 1.001


@final
@dataclass(frozen=True, eq=False)
class FrontPoint(Record):
    """The cheapest tolerances of the first-order model for limits that are multiplied by a factor.

    Attributes:
        factor, cost: Factor of every limit, and the least cost.
        lower_bound: Of the cost; ``None`` where it was not found in time.
        tolerances: The tolerances, m or rad, ``(n,)``.
    """

    factor: float
    cost: float
    lower_bound: float | None
    tolerances: Array


def solve(
    programme: Programme,
    choices: Sequence[Array | None],
    seconds: float,
    advance: Callable[[int], None],
    near: Array | None = None,
) -> Solution | None:
    """Return the cheapest tolerances, with or without grades, as :func:`solve_with_grades` does; ``near`` is where to begin."""
    if all(one is None for one in choices):
        return programme.solve(near)
    return solve_with_grades(programme, choices, max(seconds, 0.0), lambda _: advance(0))


def pareto_front(
    programme: Programme,
    choices: Sequence[Array | None],
    members: NDArray[np.intp],
    count: int,
    seconds: float,
    advance: Callable[[int], None],
) -> tuple[FrontPoint, ...]:
    """Return points from the narrowest limits that can be kept, or a third, to those that cost the least, or threefold.

    Args:
        programme, choices: What is solved.
        members: Number of the group of each tolerance.
        count: How many points; their factors have equal ratios, but for the one nearest to 1, which is 1.
        seconds: For all points together, where there are grades.
        advance: Called with 1 after each point.
    """
    least = float(programme.shares(programme.low[:, None]).max()) * _EDGE
    most = float(programme.shares(programme.high[:, None]).max())
    first = max(least, 1 / _REACH)
    end = monotonic() + seconds
    points, near = [], None
    factors = np.geomspace(first, max(min(most, _REACH), first * _EDGE), count)
    if factors[0] < 1 < factors[-1]:
        factors[1 + np.abs(np.log(factors[1:-1])).argmin() if count > 2 else 0] = 1.0
    for k, factor in enumerate(factors):
        limits = [replace(one, limit=one.limit * factor) for one in programme.limits]
        share = (end - monotonic()) / (count - k)
        found = solve(replace(programme, limits=limits), choices, share, advance, near)
        advance(1)
        if found is not None:
            near = found.t
            points.append(FrontPoint(float(factor), found.cost, found.lower_bound, found.t[members]))
    return tuple(points)
