"""Normal numbers for every law, and strata: rare values of laws that jump, sorted out before anything is searched or sampled.

A law that jumps with a small probability (one of two values, a row of a table, an outlier among measured samples) hides a
failure where no slope leads to it and few samples come by. Its rare values become strata of their own, whose probabilities
are known; failure is then sought within each, P = Σ p_s P(failure | s).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.laws import Circle, Disc, Empirical, Law, Rows, TwoPoint
from precision_pin.laws.law import cumulative
from precision_pin.space import Draw, Space

__all__ = ["FARTHEST", "Jump", "Strata", "Stratum", "from_normals", "stratified"]

Array = NDArray[np.float64]

FARTHEST: Final = 8.2
"""Standard normal numbers are searched up to this distance: a probability of 1e-16."""

RARE: Final = 1e-2
"""What is more probable is left to sampling."""

MOST_STRATA: Final = 32

_MOST_SINGLE: Final = 8
_MOST_COMBINATIONS: Final = 4096
_PROBES: Final = 8
_MOST_PROBED: Final = 100_000
_PROBED_AT_ONCE: Final = 16_384
_STEEP_SHARE: Final = 0.1
_STEEP_SCORE: Final = 0.5
_LEAST_PROBABILITY: Final = 1e-16


@final
@dataclass(frozen=True, eq=False)
class Jump:
    """A normal number whose value jumps.

    Attributes
    ----------
    row
        Which of the normal numbers.
    edges
        ``(k + 1,)`` of Φ(u), rising from 0 to 1; the value jumps at all but the outer ones.
    """

    row: int
    edges: Array

    def pieces(self, normals: Array) -> NDArray[np.intp]:
        """Return between which edges each sample ``(d, N)`` lies, ``(N,)``."""
        found = np.searchsorted(self.edges, special.ndtr(normals[self.row]), side="right") - 1
        inside: NDArray[np.intp] = np.clip(found, 0, self.edges.size - 2)
        return inside

    def scores(self, pieces: NDArray[np.intp], shares: Array) -> Array:
        """Return the normal numbers a share (0 to 1) of the way through the pieces."""
        low, high = self.edges[pieces], self.edges[pieces + 1]
        scores: Array = np.clip(special.ndtri(low + (high - low) * shares), -FARTHEST, FARTHEST)
        return scores

    def nearest(self, pieces: NDArray[np.intp]) -> Array:
        """Return the smallest normal number, by absolute value, within each piece."""
        low, high = self.edges[pieces], self.edges[pieces + 1]
        inside = np.clip(0.5, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        scores: Array = np.clip(special.ndtri(inside), -FARTHEST, FARTHEST)
        return scores


@final
@dataclass(frozen=True, eq=False)
class Stratum:
    """A part of all samples: some draws confined to some of their values.

    Attributes
    ----------
    space
        The draws.
    probability
        Of the part.
    cuts
        Intervals ``(k, 2)`` of the uniform number of each draw that is confined.
    rare
        Which of these hold rare values.
    """

    space: Space
    probability: float = 1.0
    cuts: Mapping[str, Array] = field(default_factory=dict)
    rare: tuple[str, ...] = ()

    def values(self, normals: Array) -> Array:
        """Return component values ``(d, N)`` of independent standard normal numbers ``(d, N)``; see :func:`from_normals`."""
        u = np.clip(np.asarray(normals, dtype=float), -FARTHEST, FARTHEST)
        x: Array = np.empty_like(u)
        scores = u.copy()
        uniforms = {name: self._uniform(cut, u[self._rows[name].start]) for name, cut in self.cuts.items()}
        for first, rows, root in self._mixing:
            if first in uniforms:
                scores[rows[0]] = np.clip(special.ndtri(uniforms[first]), -FARTHEST, FARTHEST)
            scores[rows] = np.clip(root @ scores[rows], -FARTHEST, FARTHEST)
        for draw, columns in zip(self.space.draws, self.space.slices, strict=True):
            match draw.law:
                case Disc(radius=radius):
                    length = np.hypot(*u[columns])
                    unit = np.divide(u[columns], length, out=np.zeros_like(x[columns]), where=length > 0)
                    x[columns] = radius * np.sqrt(-np.expm1(-(length**2) / 2)) * unit
                case Circle(radius=radius):
                    turn = 4 * np.pi * cumulative(scores[columns][1])
                    x[columns] = radius * np.array([np.cos(turn), np.sin(turn)])
                case law if draw.name in uniforms:
                    x[columns] = law.sample(np.tile(uniforms[draw.name], (law.size, 1)))
                case law:
                    x[columns] = law.at_scores(scores[columns])
        return x

    @cached_property
    def jumps(self) -> tuple[Jump, ...]:
        """The normal numbers whose value still jumps within the part."""
        found = []
        correlated = {name for correlation in self.space.correlations for name in correlation.names}
        for draw, columns in zip(self.space.draws, self.space.slices, strict=True):
            cells = _cells(draw.law)
            if cells is None or draw.name in correlated:
                continue  # what is correlated moves others smoothly
            parts = self.cuts.get(draw.name, _pieces(draw.law, cells))
            if len(parts) > 1:
                edges = np.concatenate([[0.0], np.cumsum(parts[:, 1] - parts[:, 0])])
                found.append(Jump(columns.start, edges / edges[-1]))
        return tuple(found)

    @cached_property
    def certain(self) -> bool:
        """Whether nothing varies within the part."""
        return all(
            (draw.name in self.cuts and len(self.cuts[draw.name]) == 1 and isinstance(draw.law, TwoPoint | Rows))
            or not draw.law.covariance.any()
            for draw in self.space.draws
        )

    @staticmethod
    def _uniform(cut: Array, normals: Array) -> Array:
        lengths = cut[:, 1] - cut[:, 0]
        ends = np.cumsum(lengths)
        at = special.ndtr(normals) * ends[-1]
        which = np.minimum(np.searchsorted(ends, at, side="right"), len(cut) - 1)
        value: Array = np.minimum(cut[which, 0] + (at - (ends - lengths)[which]), np.nextafter(cut[which, 1], 0))
        return value

    @cached_property
    def _rows(self) -> dict[str, slice]:
        return {draw.name: rows for draw, rows in zip(self.space.draws, self.space.slices, strict=True)}

    @cached_property
    def _mixing(self) -> tuple[tuple[str, list[int], Array], ...]:
        """First name, rows and triangular root of each correlation; what is confined, or else what jumps, comes first."""
        found = []
        laws = {draw.name: draw.law for draw in self.space.draws}
        for correlation in self.space.correlations:
            order = sorted(
                range(len(correlation.names)),
                key=lambda k: (correlation.names[k] not in self.cuts, _cells(laws[correlation.names[k]]) is None),
            )
            matrix = np.array(correlation.matrix)[np.ix_(order, order)]
            rows = [self.space.index[correlation.names[k]] for k in order]
            found.append((correlation.names[order[0]], rows, np.linalg.cholesky(matrix)))
        return tuple(found)


@final
@dataclass(frozen=True, eq=False)
class Strata:
    """Parts that exclude each other, and the probability of what none of them holds."""

    parts: tuple[Stratum, ...]
    remainder: float = 0.0


def from_normals(space: Space, normals: Array) -> Array:
    """Return component values ``(d, N)`` of independent standard normal numbers ``(d, N)``; the law stays what it is.

    A number is F⁻¹(Φ(u)), of correlated draws after mixing. A disc's point lies in the direction of its two numbers, at
    r √(1 - exp(-|u|²/2)): smoother than polar coordinates one by one, which tear at an angle. A circle's angle is
    4πΦ(u₁), so that every angle is met within 0.7 of the middle. Beyond ±8.2, numbers are taken there.
    """
    return Stratum(space).values(normals)


def stratified(space: Space, margin: Callable[[Array], Array]) -> Strata:
    """Return the strata of a space for a limit state.

    Of a law of at most eight cells (values, or lines between quantiles) every cell of a probability below 0.01 is a group
    by itself. Of others, as of a table of many rows, cells are put in order, the one that leaves the least margin first;
    those up to a cumulative probability of 0.01 make a group for each power of ten. What is left is the usual group.
    Strata are the combinations of groups, the most probable 32.

    Parameters
    ----------
    space
        The draws.
    margin
        What is left up to failure, ``(N,)``, for component values ``(d, N)``.
    """
    remainder = 0.0
    groups: dict[str, list[Array]] = {}
    for draw, columns in zip(space.draws, space.slices, strict=True):
        cells = _cells(draw.law)
        if cells is not None and len(cells) > 1 and _hides(draw.law):
            found = _groups(space, draw, columns, cells, margin)
            if len(found) > 1:
                groups[draw.name] = found
    for correlation in space.correlations:
        names = [name for name in correlation.names if name in groups]
        rare = {name: sum(map(_length, groups[name][1:])) for name in names}
        # correlated draws are confined one at a time; of the others' rare values only the probability is known
        for name in sorted(names, key=rare.__getitem__, reverse=True)[1:]:
            remainder += rare[name]
            del groups[name]
    combinations: list[tuple[float, tuple[int, ...]]] = [(1.0, ())]
    for cuts in groups.values():
        wider = [(p * _length(cut), (*key, k)) for p, key in combinations for k, cut in enumerate(cuts)]
        combinations = sorted(wider, key=lambda entry: -entry[0])[:_MOST_COMBINATIONS]
    kept = combinations[:MOST_STRATA]
    if len(kept) < math.prod(map(len, groups.values())):
        remainder += max(0.0, 1 - math.fsum(p for p, _ in kept))
    parts = [
        Stratum(
            space,
            probability if groups else 1.0,
            {name: groups[name][k] for name, k in zip(groups, key, strict=True)},
            tuple(name for name, k in zip(groups, key, strict=True) if k),
        )
        for probability, key in kept
    ]
    return Strata(tuple(parts), min(remainder, 1.0))


def _length(cut: Array) -> float:
    return float((cut[:, 1] - cut[:, 0]).sum())


def _cells(law: Law) -> Array | None:
    """Return the intervals ``(k, 2)`` of the uniform number on which a law is constant or a line; None of other laws."""
    match law:
        case TwoPoint(threshold=threshold):
            edges = np.array([0.0, threshold, 1.0])
        case Rows(table=table):
            edges = np.arange(len(table) + 1) / len(table)
        case Empirical():
            edges = np.append(law.segments[:, 0], 1.0)
        case _:
            return None
    cells = np.column_stack([edges[:-1], edges[1:]])
    met: Array = cells[cells[:, 1] > cells[:, 0]]
    return met


def _pieces(law: Law, cells: Array) -> Array:
    """Return the cells, in a row where the law goes on from one to the next."""
    if not isinstance(law, Empirical):
        return cells
    torn = law.segments[1:, 1] != law.segments[:-1, 3]
    starts = np.concatenate([[True], torn | (cells[1:, 0] != cells[:-1, 1])])
    ends = np.append(starts[1:], True)
    return np.column_stack([cells[starts, 0], cells[ends, 1]])


def _hides(law: Law) -> bool:
    """Return whether a law jumps, or nearly so: by a tenth of its range within half a normal score."""
    if not isinstance(law, Empirical):
        return True
    low, high = law.ends
    begin, value, _, end = law.segments.T
    scores = special.ndtri(np.append(begin, 1.0))
    steep = np.abs(end - value) > _STEEP_SHARE * (high - low)
    torn = np.abs(value[1:] - end[:-1]) > _STEEP_SHARE * (high - low)
    return bool((steep & (np.diff(scores) < _STEEP_SCORE)).any() or torn.any())


def _groups(space: Space, draw: Draw, columns: slice, cells: Array, margin: Callable[[Array], Array]) -> list[Array]:
    """Return the usual cells of a draw, then groups of rare ones; each as intervals ``(k, 2)``."""
    shares = cells[:, 1] - cells[:, 0]
    if shares.min() >= RARE:
        return [cells]
    severity, matters = _severity(space, draw, columns, cells, margin)
    if not matters:
        return [cells]
    if len(cells) <= _MOST_SINGLE:
        labels = np.where(shares < RARE, np.arange(1, len(cells) + 1), 0)
        if not (labels == 0).any():
            return [cells]
    else:
        order = np.argsort(severity, kind="stable")
        reached = np.empty(len(cells))
        reached[order] = np.cumsum(shares[order])
        decade = np.minimum(np.floor(np.log10(np.maximum(reached, _LEAST_PROBABILITY)) + 1e-9), math.log10(RARE) - 1)
        labels = np.where(reached < RARE, -decade, 0).astype(int)
    usual = labels == 0
    found = [_ordered(draw.law, cells[usual], severity[usual], usual)]
    for label in sorted(set(labels[~usual].tolist())):
        chosen = labels == label
        found.append(_ordered(draw.law, cells[chosen], severity[chosen], chosen))
    return found


def _severity(
    space: Space, draw: Draw, columns: slice, cells: Array, margin: Callable[[Array], Array]
) -> tuple[Array, bool]:
    """Return the least margin in each cell, the other numbers in the middle and elsewhere, and whether it depends on the cell."""
    # a hair inside of both ends, and the middle
    inside = np.array([1e-9, 0.5, 1 - 1e-9]) if isinstance(draw.law, Empirical) else np.array([0.5])
    count = max(1, min(_PROBES, _MOST_PROBED // (inside.size * len(cells))))
    probes = np.random.Generator(np.random.Philox(0)).standard_normal((space.size, count))
    probes[:, 0] = 0.0
    others = from_normals(space, probes)
    least, most = np.full((count, len(cells)), np.inf), np.full((count, len(cells)), -np.inf)
    step = max(1, _PROBED_AT_ONCE // (count * inside.size))
    for first in range(0, len(cells), step):
        part = cells[first : first + step]
        uniforms = (part[:, :1] + (part[:, 1:] - part[:, :1]) * inside).ravel()
        x = np.repeat(others, uniforms.size, axis=1)
        x[columns] = draw.law.sample(np.tile(uniforms, (draw.law.size, count)))
        margins = margin(x).reshape(count, len(part), inside.size)
        least[:, first : first + step] = margins.min(axis=2)
        most[:, first : first + step] = margins.max(axis=2)
    span = most.max(axis=1) - least.min(axis=1)
    matters = bool((span > 1e-12 * (1 + np.abs(least).max(axis=1))).any())
    return least.min(axis=0), matters


def _ordered(law: Law, cells: Array, severity: Array, chosen: NDArray[np.bool_]) -> Array:
    """Return cells in a sensible order: rows by what they leave, the lines between quantiles joined where they can be."""
    if isinstance(law, Rows):
        ordered: Array = cells[np.argsort(severity, kind="stable")]
        return ordered
    if isinstance(law, Empirical):
        lines = law.segments[chosen]
        starts = np.concatenate([[True], (lines[1:, 1] != lines[:-1, 3]) | (cells[1:, 0] != cells[:-1, 1])])
        ends = np.append(starts[1:], True)
        return np.column_stack([cells[starts, 0], cells[ends, 1]])
    return cells
