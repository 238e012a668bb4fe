"""Whether samples can have met what matters: the tails and the rare values of the laws, looked at one number at a time.

A sample of N knows nothing of what happens with a probability below 1/N, and an interval found from it does not either: a
jump of probability 1e-5, or the outermost numbers of a wide lognormal law, may carry much of a variance. The laws are
known, though. Every uniform number behind a sample is moved by itself from one end to the other, all others at their
medians, on nodes that crowd towards both ends; a statistic that is a mean over samples then has a known second and third
moment, as far as single numbers cause them. From these follows the skewness of the mean of all replicates (of a net, whose
replicates have one point in each n-th of each axis, that of the two outermost n-ths). A mean whose skewness is above
`MOST_SKEWNESS` is not near enough to normal for any interval from its replicates, and is not resolved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.replicates import REPLICATES
from precision_pin.draws.space import Space
from precision_pin.typing import Array

__all__ = ["MOST_SKEWNESS", "Marginals", "law_breaks"]


MOST_SKEWNESS: Final = 0.6
"""Of the mean of all replicates: that of a count of 2.8 expected events."""

_DEEPEST: Final = -50
"""Nodes go from 2 to this to 1 less as much."""

_STEP: Final = 2
"""Octaves in a cell."""

_FEW: Final = 3.0
"""Samples expected where it may be that none lies."""

_MOST_BREAKS: Final = 200
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_ROUNDING: Final = 1e-24


def law_breaks(space: Space) -> list[tuple[float, ...]]:
    """Return for each component the uniform numbers at which its law jumps or bends."""
    result: list[tuple[float, ...]] = []
    for draw in space.draws:
        breaks = tuple(draw.law.breaks) if draw.law.size == 1 else ()
        result += [breaks if len(breaks) <= _MOST_BREAKS else ()] * draw.law.size
    return result


@final
@dataclass(frozen=True, eq=False)
class Marginals:
    """Nodes along each of d uniform numbers.

    Attributes
    ----------
    uniforms
        ``(d, M)``, those along the first number, then those along the second, …; all others at 1/2.
    weights
        ``(M,)`` probability of each node, 1 in all for each number.
    columns
        Of each number.
    points
        Of a replicate.
    is_net
        Whether a replicate is a net, or random.
    """

    uniforms: Array
    weights: Array
    columns: tuple[slice, ...]
    points: int
    is_net: bool

    @classmethod
    def of(cls, dimension: int, points: int, *, is_net: bool, breaks: Sequence[tuple[float, ...]] = ()) -> Marginals:
        """Return the nodes.

        Parameters
        ----------
        dimension
            d.
        points
            Of a replicate.
        is_net
            Whether a replicate is a net.
        breaks
            Of each number where a law jumps or bends.
        """
        rows, shares, columns = [], [], []
        first = 0
        for number in range(dimension):
            u, weights = _line(points, tuple(breaks[number]) if breaks else ())
            rows.append(u)
            shares.append(weights)
            columns.append(slice(first, first + u.size))
            first += u.size
        uniforms = np.full((dimension, first), 0.5)
        for number, (row, where) in enumerate(zip(rows, columns, strict=True)):
            uniforms[number, where] = row
        return cls(uniforms, np.concatenate([np.zeros(0), *shares]), tuple(columns), points, is_net)

    def centred(self, values: Array) -> Array:
        """Return values ``(q, M)`` less their mean along each number."""
        result = np.empty_like(values)
        for where in self.columns:
            part = values[:, where]
            result[:, where] = part - (part @ self.weights[where])[:, None]
        return result

    def resolved(
        self, contributions: Array, replicate_variance: Array, factors: Array | None = None
    ) -> NDArray[np.bool_]:
        """Return whether the mean of a statistic over all samples is near enough to normal, ``(q,)``.

        Parameters
        ----------
        contributions
            What a sample at each node adds to the mean, ``(q, M)``.
        replicate_variance
            Variance of a replicate's mean that was seen, ``(q,)``.
        factors
            Of the contributions along each number, ``(d, q)``; 1 if left out.
        """
        second, third = np.zeros(len(contributions)), np.zeros(len(contributions))
        for number, where in enumerate(self.columns):
            factor = 1.0 if factors is None else factors[number]
            for cell in self._cells(number):
                weights = self.weights[where][cell]
                share = weights.sum()
                part = contributions[:, where][:, cell]
                off = part - (part @ weights / share)[:, None]
                # n·share numbers of the cell in each replicate, each n-th of what a replicate adds
                count = self.points * share
                second += factor**2 * (count * (off**2 @ weights / share) / self.points**2)
                third += factor**3 * (count * (off**3 @ weights / share) / self.points**3)
        variance = np.maximum(second, np.nan_to_num(replicate_variance))
        limit = MOST_SKEWNESS * math.sqrt(REPLICATES) * variance**1.5
        result: NDArray[np.bool_] = np.abs(third) <= limit
        return result

    def outermost(self, numbers: Sequence[int], samples: int) -> tuple[NDArray[np.intp], Array]:
        """Return the nodes along some numbers beyond which few of so many samples lie, and their weights."""
        inside = np.ones(self.weights.size, dtype=bool)
        for number in numbers:
            u = self.uniforms[number, self.columns[number]]
            inside[self.columns[number]] = np.minimum(u, 1 - u) >= _FEW / samples
        nodes = np.flatnonzero(~inside)
        return nodes, self.weights[nodes]

    def _cells(self, number: int) -> list[slice | NDArray[np.bool_]]:
        """Return the nodes of parts that are sampled each by itself."""
        if not self.is_net:
            return [slice(None)]
        u = self.uniforms[number, self.columns[number]]
        return [u < 1 / self.points, u > 1 - 1 / self.points]


def _line(points: int, breaks: tuple[float, ...]) -> tuple[Array, Array]:
    """Return nodes and weights on (0, 1): cells of two octaves towards both ends, with edges at 1/n and at all breaks."""
    middle = -round(math.log2(points))
    outer = np.exp2([*range(middle, _DEEPEST, -_STEP), float(_DEEPEST)])
    inner = np.exp2([*range(middle, -1, _STEP), -1.0])
    below = np.concatenate([[0.0], outer, inner])
    inside = [b for b in breaks if 0 < b < 1]
    edges = np.unique(np.concatenate([below, 1 - below, inside]))
    half = np.diff(edges)[:, None] / 2
    u = (edges[:-1, None] + half * (_NODES + 1)).ravel()
    smallest = 0.5**53
    return np.clip(u, smallest, 1 - smallest), (half * (_WEIGHTS + 0 * half)).ravel()
