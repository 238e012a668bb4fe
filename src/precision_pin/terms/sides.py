"""Sides on which play is taken up, decided by each robot's own load.

A load is as from :meth:`~precision_pin.robot.chain.Posture.torque_on`: numbers by the parameters that multiply them.
What is the same for every robot stays a number, so that it costs nothing to sample.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import reduce
from operator import add, mul

from precision_pin.draws.expressions import Component, Value, sign
from precision_pin.draws.space import Space
from precision_pin.robot.loads import Factors

Interval = tuple[float, float]


def load_value(load: Mapping[Factors, float]) -> Value:
    """Return a load as a number, or as a formula if it is random."""
    constant = float(load.get((), 0.0))
    parts = [reduce(mul, factors) * float(number) for factors, number in load.items() if factors and number]
    while len(parts) > 1:
        # in pairs, which keeps the formula shallow
        parts = [reduce(add, parts[k : k + 2]) for k in range(0, len(parts), 2)]
    return parts[0] + constant if parts and constant else parts[0] if parts else constant


def bounds_of(load: Mapping[Factors, float], space: Space) -> Interval:
    """Return bounds of a load over all robots; infinite where a parameter is a formula."""
    low = high = 0.0
    for factors, number in load.items():
        ends = [float(number)]
        for factor in factors if number else ():
            own = space.intervals[space.index[factor.name]] if isinstance(factor, Component) else (-math.inf, math.inf)
            ends = [end * other if end and other else 0.0 for end in ends for other in own]
        low, high = low + min(ends), high + max(ends)
    return low, high


def is_same_for_all(load: Mapping[Factors, float]) -> bool:
    """Return whether a load has no random part."""
    return not any(factors and number for factors, number in load.items())


def side_of(load: Mapping[Factors, float], space: Space) -> Value:
    """Return 1 for robots whose load is zero or positive, else -1: a number where all robots agree."""
    low, high = bounds_of(load, space)
    if low >= 0 or high < 0:
        return 1.0 if low >= 0 else -1.0
    value = load_value(load)
    return sign(value) if not isinstance(value, float) else 1.0 if value >= 0 else -1.0
