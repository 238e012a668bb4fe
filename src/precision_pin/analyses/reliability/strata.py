"""Transformation of laws to normal numbers, and strata of the rare values of laws with jumps.

A law that jumps with a small probability (one of two values, a row of a table, an outlier among measured samples) can
hide a failure: no slope leads to it, and few samples reach it. Its rare values therefore become strata with known
probabilities, and the failures are searched within each: P = Σ p_s P(failure | s).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.base.arrays import Array, Fixed
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Law
from precision_pin.draws.space import Space

FARTHEST: Final = 8.2
"""Largest distance of the search in standard normal numbers: a probability of 1e-16."""

RARE: Final = 1e-2
"""Probability above which values are left to plain sampling."""

MOST_STRATA: Final = 32

_MOST_SINGLE: Final = 8
_MOST_COMBINATIONS: Final = 4096
_MOST_TOGETHER: Final = 64
_PROBES: Final = 8
_MOST_PROBED: Final = 100_000
_PROBED_AT_ONCE: Final = 16_384
_STEEP_SHARE: Final = 0.1
_STEEP_SCORE: Final = 0.5
_LEAST_PROBABILITY: Final = 1e-16


@final
@dataclass(frozen=True, eq=False)
class Jump(Fixed):
    """Normal number (``row``) whose value jumps at all inner ``edges``, ``(k + 1,)`` values of Φ(u) from 0 to 1."""

    row: int
    edges: Array

    def pieces(self, normals: Array) -> NDArray[np.intp]:
        """Return the number of the piece between two edges, ``(N,)``, for each sample ``(d, N)``."""
        found = np.searchsorted(self.edges, special.ndtr(normals[self.row]), side="right") - 1
        return np.clip(found, 0, self.edges.size - 2)

    def scores(self, pieces: NDArray[np.intp], shares: Array) -> Array:
        """Return the normal numbers at a relative position (0 to 1) within the pieces."""
        low, high = self.edges[pieces], self.edges[pieces + 1]
        return np.clip(special.ndtri(low + (high - low) * shares), -FARTHEST, FARTHEST)

    def nearest(self, pieces: NDArray[np.intp]) -> Array:
        """Return the smallest normal number, by absolute value, within each piece."""
        low, high = self.edges[pieces], self.edges[pieces + 1]
        inside = np.clip(0.5, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        return np.clip(special.ndtri(inside), -FARTHEST, FARTHEST)


@final
@dataclass(frozen=True, eq=False)
class Stratum(Fixed):
    """Stratum: some draws restricted to some of their values, in one or several combinations.

    Attributes:
        cuts: For each restricted draw, groups of intervals ``(k, 2)`` of its uniform number, the usual one first.
        combinations: Combinations of the stratum: one group of each such draw.
        shares: ``(combinations,)`` fractions of the stratum.
    """

    space: Space
    probability: float = 1.0
    cuts: Mapping[str, tuple[Array, ...]] = field(default_factory=dict)
    combinations: tuple[tuple[int, ...], ...] = ((),)
    shares: Array = field(default_factory=lambda: np.ones(1))

    @property
    def rare(self) -> tuple[str, ...]:
        """Draws with a rare value in any of the combinations."""
        return tuple(name for k, name in enumerate(self.cuts) if any(key[k] for key in self.combinations))

    def rare_at(self, normals: Array) -> tuple[str, ...]:
        """Return the draws with a rare value at a point ``(d,)``."""
        which, _ = self._select_combinations(normals[:, None])
        return tuple(name for name, group in zip(self.cuts, self.combinations[which[0]], strict=True) if group)

    def values(self, normals: Array) -> Array:
        """Return component values ``(d, N)`` for standard normal numbers ``(d, N)``; see :func:`from_normals`."""
        u = np.clip(np.asarray(normals, dtype=float), -FARTHEST, FARTHEST)
        x: Array = np.empty_like(u)
        scores = u.copy()
        uniforms = self._uniforms(u)
        for first, rows, root in self._mixing:
            if first in uniforms:
                scores[rows[0]] = np.clip(special.ndtri(uniforms[first]), -FARTHEST, FARTHEST)
            scores[rows] = np.clip(root @ scores[rows], -FARTHEST, FARTHEST)
        for draw, columns in zip(self.space.draws, self.space.slices, strict=True):
            if draw.name in uniforms:
                x[columns] = draw.law.sample(np.tile(uniforms[draw.name], (draw.law.size, 1)))
            else:
                x[columns] = draw.law.from_normals(scores[columns])
        return x

    @cached_property
    def jumps(self) -> tuple[Jump, ...]:
        """Normal numbers with jumps within the stratum."""
        found = []
        correlated = {name for correlation in self.space.correlations for name in correlation.names}
        for draw, columns in zip(self.space.draws, self.space.slices, strict=True):
            cells = _cells(draw.law)
            if cells is None or draw.name in correlated:
                continue  # correlated draws change the others smoothly
            if draw.name == self._selector and len(self.combinations) > 1:
                edges = np.concatenate([[0.0], np.cumsum(self.shares)])
            else:
                used = {key[list(self.cuts).index(draw.name)] for key in self.combinations if draw.name in self.cuts}
                if len(used) > 1:
                    continue
                parts = self.cuts[draw.name][used.pop()] if used else _pieces(draw.law, cells)
                edges = np.concatenate([[0.0], np.cumsum(parts[:, 1] - parts[:, 0])])
            if edges.size > 2:
                found.append(Jump(columns.start, edges / edges[-1]))
        return tuple(found)

    @cached_property
    def certain(self) -> bool:
        """True if only the combination varies within the stratum."""
        return all(
            (draw.name in self.cuts and all(len(cut) == 1 for cut in self.cuts[draw.name]) and _is_discrete(draw.law))
            or not draw.law.covariance.any()
            for draw in self.space.draws
        )

    @property
    def middles(self) -> Array:
        """Normal numbers ``(d, combinations)`` in the middle of each combination."""
        normals = np.zeros((self.space.size, len(self.combinations)))
        if self._selector:
            normals[self._rows[self._selector].start] = special.ndtri(np.cumsum(self.shares) - self.shares / 2)
        return normals

    @property
    def _selector(self) -> str:
        """Draw whose number selects the combination, and then a value within its group."""
        return next(iter(self.cuts), "")

    def _select_combinations(self, u: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the combination of each sample, and the relative position of its uniform number within it."""
        if len(self.combinations) == 1:
            at = special.ndtr(u[self._rows[self._selector].start]) if self.cuts else np.zeros(u.shape[1])
            return np.zeros(u.shape[1], dtype=np.intp), at
        ends = np.cumsum(self.shares)
        at = special.ndtr(u[self._rows[self._selector].start]) * ends[-1]
        which = np.minimum(np.searchsorted(ends, at, side="right"), ends.size - 1)
        return which, np.clip((at - (ends - self.shares)[which]) / self.shares[which], 0.0, 1.0)

    def _uniforms(self, u: Array) -> dict[str, Array]:
        which, through = self._select_combinations(u)
        found = {}
        for k, (name, cuts) in enumerate(self.cuts.items()):
            own = through if name == self._selector else special.ndtr(u[self._rows[name].start])
            groups = np.array([key[k] for key in self.combinations])
            used = np.unique(groups)
            if used.size == 1:
                found[name] = _within(cuts[used[0]], own)
                continue
            found[name] = np.empty(u.shape[1])
            for group in used:
                here = groups[which] == group
                found[name][here] = _within(cuts[group], own[here])
        return found

    @cached_property
    def _rows(self) -> dict[str, slice]:
        return {draw.name: rows for draw, rows in zip(self.space.draws, self.space.slices, strict=True)}

    @cached_property
    def _mixing(self) -> tuple[tuple[str, list[int], Array], ...]:
        """First name, rows and triangular root of each correlation, with restricted or else jumping draws first."""
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
    """Mutually exclusive strata, and the probability outside all of them."""

    parts: tuple[Stratum, ...]
    remainder: float = 0.0


def from_normals(space: Space, normals: Array) -> Array:
    """Return component values ``(d, N)``, distributed by their laws, for standard normal numbers ``(d, N)``.

    A number is F⁻¹(Φ(u)), for correlated draws after mixing. The point of a disc lies in the direction of its two
    numbers at r √(1 - exp(-|u|²/2)), because polar coordinates would be discontinuous at one angle. The angle of a
    circle is 4πΦ(u₁), so that every angle is reached within 0.7 of the middle. Numbers beyond ±8.2 are clipped.
    """
    return Stratum(space).values(normals)


def stratified(space: Space, margin: Callable[[Array], Array]) -> Strata:
    """Return the strata of a space for a limit state ``margin``, ``(N,)`` for component values ``(d, N)``.

    For a law of at most eight cells (values, or lines between quantiles), every cell with a probability below 0.01 is a
    group of its own. For other laws, such as large tables, the cells are sorted by ascending margin; those up to a
    cumulative probability of 0.01 form one group for each power of ten. The remaining cells are the usual group. Strata
    are combinations of groups: first the usual groups of all draws, then combinations of similar probability together,
    at most 64 in a stratum and 32 strata.
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
        # of correlated draws only one is restricted; for the rare values of the others only the probability is known
        for name in sorted(names, key=rare.__getitem__, reverse=True)[1:]:
            remainder += rare[name]
            del groups[name]
    if not groups:
        return Strata((Stratum(space),), remainder)
    # the combination is selected by draws without correlation
    correlated = {name for correlation in space.correlations for name in correlation.names}
    cuts = {name: tuple(groups[name]) for name in sorted(groups, key=lambda name: name in correlated)}
    combinations: list[tuple[float, tuple[int, ...]]] = [(1.0, ())]
    for own in cuts.values():
        wider = [(p * _length(cut), (*key, k)) for p, key in combinations for k, cut in enumerate(own)]
        combinations = sorted(wider, key=lambda entry: -entry[0])[:_MOST_COMBINATIONS]
    parts = []
    for together in _alike(combinations)[:MOST_STRATA]:
        probabilities = np.array([p for p, _ in together])
        whole = float(probabilities.sum())
        parts.append(Stratum(space, whole, cuts, tuple(key for _, key in together), probabilities / whole))
    if sum(len(part.combinations) for part in parts) < math.prod(map(len, cuts.values())):
        remainder += max(0.0, 1 - math.fsum(part.probability for part in parts))
    return Strata(tuple(parts), min(remainder, 1.0))


def _alike(combinations: Sequence[tuple[float, tuple[int, ...]]]) -> list[list[tuple[float, tuple[int, ...]]]]:
    """Return the combinations, most probable first, grouped by the power of ten of their probability."""
    found: list[list[tuple[float, tuple[int, ...]]]] = []
    for entry in combinations:
        if found and len(found[-1]) < _MOST_TOGETHER and found[-1][0][0] < 10 * entry[0] and any(found[-1][0][1]):
            found[-1].append(entry)
        else:
            found.append([entry])
    return found


def _within(cut: Array, uniforms: Array) -> Array:
    lengths = cut[:, 1] - cut[:, 0]
    ends = np.cumsum(lengths)
    at = uniforms * ends[-1]
    which = np.minimum(np.searchsorted(ends, at, side="right"), len(cut) - 1)
    return np.minimum(cut[which, 0] + (at - (ends - lengths)[which]), np.nextafter(cut[which, 1], 0))


def _is_discrete(law: Law) -> bool:
    return law.cell_edges is not None and law.lines is None


def _length(cut: Array) -> float:
    return float((cut[:, 1] - cut[:, 0]).sum())


def _cells(law: Law) -> Array | None:
    """Return the intervals ``(k, 2)`` of the uniform number on which a law is constant or linear; else None."""
    edges = law.cell_edges
    if edges is None:
        return None
    cells = np.column_stack([edges[:-1], edges[1:]])
    return cells[cells[:, 1] > cells[:, 0]]


def _pieces(law: Law, cells: Array) -> Array:
    """Return the cells, merged where the law is continuous from one to the next."""
    return cells if law.lines is None else _merged(cells, law.lines)


def _merged(cells: Array, lines: Array) -> Array:
    starts = np.concatenate([[True], (lines[1:, 1] != lines[:-1, 3]) | (cells[1:, 0] != cells[:-1, 1])])
    ends = np.append(starts[1:], True)
    return np.column_stack([cells[starts, 0], cells[ends, 1]])


def _hides(law: Law) -> bool:
    """Return whether a law has a jump or a steep rise, a tenth of its range within half a normal score."""
    if law.lines is None:
        return True
    begin, value, _, end = law.lines.T
    low, high = value[0], end[-1]
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
    found = []
    # the usual cells have the label 0
    for label in (0, *sorted(set(labels[labels != 0].tolist()))):
        chosen = labels == label
        found.append(_arrange_cells(draw.law, cells[chosen], severity[chosen], chosen))
    return found


def _severity(
    space: Space, draw: Draw, columns: slice, cells: Array, margin: Callable[[Array], Array]
) -> tuple[Array, bool]:
    """Return the least margin in each cell over several values of the others, and whether it depends on the cell."""
    # just inside both ends, and the middle
    inside = np.array([1e-9, 0.5, 1 - 1e-9]) if draw.law.lines is not None else np.array([0.5])
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


def _arrange_cells(law: Law, cells: Array, severity: Array, chosen: NDArray[np.bool_]) -> Array:
    """Return the chosen cells: values sorted by their margin, lines between quantiles merged where adjacent."""
    if law.lines is None:
        return cells[np.argsort(severity, kind="stable")]
    return _merged(cells, law.lines[chosen])
