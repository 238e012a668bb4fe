"""Estimates from independent replicates, with intervals that allow for skewness.

The standard error of a statistic follows from leaving out one replicate after another (jackknife). Means of few values
with heavy tails are skewed, and Student's symmetric interval then misses on one side. The pseudo-values of the
jackknife also give the skewness, and Hall's transformation of Student's ratio (Journal of the Royal Statistical Society
B 54, 1992, 221) gives an interval with unequal sides. The longer side is reported on both sides, at least as long as
Student's, and widened by a tenth. Without this widening, intervals of ratios and of nets, whose replicates are not
quite independent and normal, covered in 92 to 94 of 100 runs.

N samples contain no information on events with a probability below 1/N, and neither does an interval derived from them.
A jump of probability 1e-5, or the outermost values of a wide lognormal law, may nevertheless contribute much to a
variance. The known laws show whether they do. Each uniform number of a sample is varied from one end to the other, with
all others at their medians, on nodes that are dense towards both ends. This gives the second and third moments, as far
as single numbers cause them, of a statistic that is a mean over samples, and from these the skewness of the mean of all
replicates. The replicates of a net have one point in each n-th of each axis, so only the two outermost n-ths count. A
mean with a skewness above `MOST_SKEWNESS` is too far from normal for these intervals. It gets that of Chebyshev's
inequality with the known variance, which holds for all laws, or is not resolved where this is wider than `MOST_REACH`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.base.arguments import check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.space import Space
from precision_pin.statistics.intervals import studentised

REPLICATES: Final = 32
"""Number of independent runs, or scrambles of a net."""


def round_up_samples(samples: int, smallest: int, largest: int) -> tuple[int, list[Finding]]:
    """Return a number of samples, rounded up to a power of two for each replicate, and a warning if it changed.

    Args:
        smallest, largest: Exponents of the least and the greatest power of two.

    Raises:
        InputError: No whole number from 1 to the largest number.
    """
    given = check_whole("the number of samples", samples, 1, REPLICATES << largest)
    count = REPLICATES << max(smallest, (-(-given // REPLICATES) - 1).bit_length())
    message = f"{given:,} samples are rounded up to {count:,}: {REPLICATES} times a power of two"
    return count, [] if count == given else [Finding("warning", "W_SAMPLES", message)]


# relative spread below which the skewness of the replicates is rounding noise
_ROUNDING: Final = 1e-14


@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimates, NaN where not resolved, with half-widths of intervals, and the variance for a single replicate."""

    value: Array
    half_width: Array
    replicate_variance: Array

    @property
    def standard_error(self) -> Array:
        """Standard error of the values."""
        return np.sqrt(self.replicate_variance / REPLICATES)

    def where(self, resolved: Array | NDArray[np.bool_]) -> Estimates:
        """Return the estimates with NaN where they are not resolved."""
        keep = np.asarray(resolved, dtype=bool)
        return Estimates(*(np.where(keep, getattr(self, field.name), np.nan) for field in fields(self)))


def pseudo_values(statistic: Callable[[NDArray[np.bool_]], Array]) -> tuple[Array, Array]:
    """Return a statistic of a mask ``(REPLICATES,)``, and the jackknife's pseudo-values ``(REPLICATES, …)``."""
    is_used = np.ones(REPLICATES, dtype=bool)
    estimate = np.asarray(statistic(is_used), dtype=float)
    left_out = np.array([statistic(is_used & (np.arange(REPLICATES) != k)) for k in range(REPLICATES)])
    return estimate, estimate + (REPLICATES - 1) * (estimate - left_out)


def jackknife(statistic: Callable[[NDArray[np.bool_]], Array], confidence: float) -> Estimates:
    """Return a smooth statistic, as for :func:`pseudo_values`, with its interval."""
    return estimated(*pseudo_values(statistic), confidence)


def estimated(value: Array, pseudo: Array, confidence: float) -> Estimates:
    """Return estimates from their pseudo-values ``(REPLICATES, …)``."""
    return Estimates(value, half_widths(pseudo, confidence), pseudo.var(axis=0, ddof=1))


def half_widths(pseudo: Array, confidence: float) -> Array:
    """Return the half-widths of intervals of means of ``(REPLICATES, …)``; of a skewed mean, the longer side."""
    middle, spread = pseudo.mean(axis=0), pseudo.std(axis=0)
    varies = spread > _ROUNDING * np.abs(middle)
    cubes = ((pseudo - middle) ** 3).mean(axis=0)
    skewness = np.divide(cubes, spread**3, out=np.zeros_like(middle), where=varies & (spread > 0))
    student = float(special.stdtrit(REPLICATES - 1, (1 + confidence) / 2))
    small = np.abs(skewness) / math.sqrt(REPLICATES)
    ends = [studentised(side * student, small) for side in (-1, 1)]
    factor = np.maximum(np.maximum(np.abs(ends[0]), np.abs(ends[1])), student)
    return 1.1 * factor * spread * math.sqrt(1 / (REPLICATES - 1))


MOST_SKEWNESS: Final = 0.6
"""Largest skewness of the mean of all replicates; a count of 2.8 expected events has as much."""

MOST_REACH: Final = 0.1
"""Largest half-width of Chebyshev's interval, as a fraction of the estimate's scale."""

# exponent of the outermost cell's inner edges, 2⁻⁵⁰ from both ends
_DEEPEST: Final = -50

# octaves in a cell
_STEP: Final = 2

# expected number of samples below which a region may be without any
_FEW: Final = 3.0

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


def law_breaks(space: Space) -> list[tuple[float, ...]]:
    """Return, for each component, the uniform numbers at which the inverse of its law jumps or kinks."""
    result: list[tuple[float, ...]] = []
    for draw in space.draws:
        breaks = tuple(draw.law.breaks) if draw.law.size == 1 else ()
        # laws with more breaks, such as large tables, are treated as smooth: the nodes would be too many
        result += [breaks if len(breaks) <= 200 else ()] * draw.law.size
    return result


@dataclass(frozen=True, eq=False)
class Marginals:
    """Nodes along each of d uniform numbers.

    Attributes:
        uniforms: ``(d, M)`` nodes along the first number, then along the second, …, with all others at 1/2.
        weights: ``(M,)`` probability of each node; they sum to 1 along each number.
        columns: Columns of the nodes of each number.
        points, is_net: Points in a replicate, and whether they form a net instead of being random.
    """

    uniforms: Array
    weights: Array
    columns: tuple[slice, ...]
    points: int
    is_net: bool

    @classmethod
    def of(cls, dimension: int, points: int, *, is_net: bool, breaks: Sequence[tuple[float, ...]] = ()) -> Marginals:
        """Return the nodes for a dimension d, with jumps and kinks as from :func:`law_breaks`."""
        lines = [_line(points, tuple(breaks[number]) if breaks else ()) for number in range(dimension)]
        offsets = np.cumsum([0, *(u.size for u, _ in lines)]).tolist()
        columns = tuple(map(slice, offsets, offsets[1:]))
        uniforms = np.full((dimension, offsets[-1]), 0.5)
        for number, ((u, _), line) in enumerate(zip(lines, columns, strict=True)):
            uniforms[number, line] = u
        return cls(uniforms, np.concatenate([np.zeros(0), *(weights for _, weights in lines)]), columns, points, is_net)

    def subtract_means(self, values: Array) -> Array:
        """Return values ``(q, M)`` minus their mean along each number."""
        result = np.empty_like(values)
        for line in self.columns:
            part = values[:, line]
            result[:, line] = part - (part @ self.weights[line])[:, None]
        return result

    def evaluate(self, function: Callable[[Array], Array]) -> tuple[Marginals, Array]:
        """Return the nodes with the values ``(k, M)`` of a function of uniform numbers ``(d, M)``.

        Where it does not exist, far out on the tails, nodes move inwards to where it does.

        Raises:
            InputError: The function does not exist at the medians.
        """
        try:
            return self, function(self.uniforms)
        except InputError:
            pass
        uniforms, values = self.uniforms.copy(), []
        for number, line in enumerate(self.columns):
            for depth in range(-_DEEPEST, 0, -1):
                nodes = self.uniforms[:, line].copy()
                nodes[number] = np.clip(nodes[number], 0.5**depth, 1 - 0.5**depth)
                try:
                    values.append(function(nodes))
                except InputError:
                    if depth == 1:
                        raise
                else:
                    uniforms[:, line] = nodes
                    break
        return replace(self, uniforms=uniforms), np.concatenate(values, axis=1)

    def resolve(
        self, estimates: Estimates, contributions: Array, scale: Array, confidence: float, factors: Array | None = None
    ) -> Estimates:
        """Return estimates ``(…, q)`` with intervals that allow for the tails, NaN where they are not resolved.

        Args:
            found: Means of a statistic over all samples.
            contributions, factors: ``(q, M)`` contribution of a sample at each node; factors along each number, ``(d,
                …, q)``.
            scale: ``(q,)`` positive numbers to which the half-widths are compared.
            confidence: Confidence of the intervals.
        """
        second, third = np.zeros(estimates.value.shape), np.zeros(estimates.value.shape)
        for number, line in enumerate(self.columns):
            factor = 1.0 if factors is None else factors[number]
            for cell in self._cells(number):
                weights = self.weights[line][cell]
                share = weights.sum()
                part = contributions[:, line][:, cell]
                deviations = part - (part @ weights / share)[:, None]
                # each replicate has n·share numbers in the cell, and each of them has the weight 1/n
                count = self.points * share
                second += factor**2 * (count * (deviations**2 @ weights / share) / self.points**2)
                third += factor**3 * (count * (deviations**3 @ weights / share) / self.points**3)
        is_normal = np.abs(third) <= MOST_SKEWNESS * math.sqrt(REPLICATES) * second**1.5
        half_range = np.sqrt(second / (REPLICATES * (1 - confidence)))
        half_width = np.hypot(estimates.half_width, np.where(is_normal, 0.0, half_range))
        return replace(estimates, half_width=half_width).where(is_normal | (half_range <= MOST_REACH * scale))

    def outermost(self, numbers: Sequence[int], samples: int) -> tuple[NDArray[np.intp], Array]:
        """Return the outermost nodes along some numbers, beyond which few samples lie, and their weights."""
        is_inside = np.ones(self.weights.size, dtype=bool)
        for number in numbers:
            u = self.uniforms[number, self.columns[number]]
            is_inside[self.columns[number]] = np.minimum(u, 1 - u) >= _FEW / samples
        nodes = np.flatnonzero(~is_inside)
        return nodes, self.weights[nodes]

    def _cells(self, number: int) -> list[slice | NDArray[np.bool_]]:
        """Return the nodes of the parts of an axis that are sampled independently."""
        if not self.is_net:
            return [slice(None)]
        u = self.uniforms[number, self.columns[number]]
        return [u < 1 / self.points, u > 1 - 1 / self.points]


def _line(points: int, breaks: tuple[float, ...]) -> tuple[Array, Array]:
    """Return nodes and weights on (0, 1), in cells of two octaves towards both ends, split at 1/n and all breaks."""
    middle = -round(math.log2(points))
    outer = np.exp2([*range(middle, _DEEPEST, -_STEP), float(_DEEPEST)])
    inner = np.exp2([*range(middle, -1, _STEP), -1.0])
    below = np.concatenate([[0.0], outer, inner])
    cuts = [b for b in breaks if 0 < b < 1]
    edges = np.unique(np.concatenate([below, 1 - below, cuts]))
    half = np.diff(edges)[:, None] / 2
    u = (edges[:-1, None] + half * (_NODES + 1)).ravel()
    smallest = 0.5**53
    return np.clip(u, smallest, 1 - smallest), (half * (_WEIGHTS + 0 * half)).ravel()
