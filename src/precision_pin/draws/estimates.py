"""Calibration estimates of numbers drawn once for each robot, and the space that remains."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, final

import numpy as np

from precision_pin.base.arguments import check_name
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import JointNormal, Law
from precision_pin.draws.space import Space

_UNTOUCHED: Final = 1e-9
"""Change of a mean, variance or correlation, in units of the prior, that counts as none."""

_HALF: Final = 0.5
"""Fraction of a number's variance left, up to which it rests more on the data than on its tolerance."""
_FREE: Final = 0.5
"""Ratio of conditional (given all others) to marginal standard deviation above which a number counts as independent."""


def held_at_mean(draw: Draw) -> Draw:
    """Return a draw of the same names, fixed at its mean."""
    mean = tuple(draw.law.mean_vector.tolist())
    law = JointNormal(tuple((0.0,) * len(mean) for _ in mean), mean)
    return dataclasses.replace(draw, law=law, names=draw.components)


@final
@dataclass(frozen=True, eq=False)
class Estimates:
    """Mean and covariance of numbers of a space after a calibration, SI.

    Attributes:
        stated: Mean and standard deviation of each in the sheet that was calibrated; empty if unknown.
    """

    names: tuple[str, ...]
    mean: Array
    covariance: Array
    stated: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def remaining_space(self, space: Space) -> Space:
        """Return the space of the calibrated arm; parameters that the data do not inform keep their prior.

        The others form one joint normal draw, ``calibrated``, under their own names. A number whose law has bounds
        within the normal law's reach is cut at them, unless a combination of it with others is known, which cutting
        would spoil. None crosses a zero that its prior does not cross. Raises InputError if a name is not that of a
        number drawn once for each robot.
        """
        scopes = {name: draw.scope for draw in space.draws for name in draw.components}
        for name in self.names:
            if scopes[check_name("component", name, scopes)] is not Scope.UNIT:
                raise InputError(f"{name} is not drawn once for each robot")
        touched = self._touched(space)
        if not touched:
            return space
        members = [draw for draw in space.draws if draw.name in touched]
        wanted = [name for draw in members for name in draw.components]
        position = {name: k for k, name in enumerate(self.names)}
        matrix, centre = np.zeros((len(wanted), len(wanted))), space.mean[[space.index[name] for name in wanted]].copy()
        known = [k for k, name in enumerate(wanted) if name in position]
        rows = [position[wanted[k]] for k in known]
        matrix[np.ix_(known, known)] = self.covariance[np.ix_(rows, rows)]
        centre[known] = self.mean[rows]
        normal = JointNormal(tuple(map(tuple, ((matrix + matrix.T) / 2).tolist())), tuple(centre.tolist()))
        kept = [draw for draw in space.draws if draw.name not in touched]
        law = _clip(normal, [bounds_of(draw.law, k) for draw in members for k in range(draw.law.size)])
        taken = {name for draw in space.draws for name in (draw.name, *draw.components)}
        name = "calibrated"
        while name in taken:
            name += "_"
        others = tuple(one for one in space.correlations if not touched & set(one.names))
        return Space((Draw(name, law, names=tuple(wanted)), *kept), others)

    def without_changed(self, before: Space, after: Space) -> tuple[Estimates | None, tuple[str, ...]]:
        """Return the estimates without changed draws (None if nothing is left), and which of those had been learned."""
        now = {draw.name: draw for draw in after.draws}
        changed = {name for draw in before.draws if now.get(draw.name) != draw for name in draw.components}
        kept = [k for k, name in enumerate(self.names) if name not in changed]
        if len(kept) == len(self.names):
            return self, ()
        touched = self._touched(before)
        known = {name for draw in before.draws if draw.name in touched for name in draw.components}
        replaced = tuple(name for name in self.names if name in changed & known)
        if not kept:
            return None, replaced
        names = tuple(self.names[k] for k in kept)
        return Estimates(names, self.mean[kept], self.covariance[np.ix_(kept, kept)]), replaced

    def edited(self, space: Space) -> dict[str, tuple[float, float]]:
        """Return the new mean and deviation of each number for which they differ from the stated ones."""
        found = {}
        stds = np.sqrt(space.block_covariance.variances)
        for name, (mean, std) in self.stated.items():
            if (column := space.index.get(name)) is None:
                continue
            now = float(space.mean[column]), float(stds[column])
            if max(abs(now[0] - mean), abs(now[1] - std)) > _UNTOUCHED * max(std, abs(mean)):
                found[name] = now
        return found

    def learned(self, space: Space) -> tuple[str, ...]:
        """Return the numbers whose variance in the original space the data reduced by at least half."""
        columns = np.array([space.index[name] for name in self.names], dtype=np.intp)
        before = space.block_covariance.variances[columns]
        less = np.diag(self.covariance) <= _HALF * before
        return tuple(name for name, is_less in zip(self.names, less.tolist(), strict=True) if is_less)

    def _touched(self, space: Space) -> set[str]:
        columns = np.array([space.index[name] for name in self.names], dtype=np.intp)
        prior = space.block_covariance.within(columns)
        std = np.sqrt(np.diag(prior))
        std = np.where(std > 0, std, 1.0)
        scaled = (self.covariance - prior) / np.outer(std, std)
        moved = np.abs(self.mean - space.mean[columns]) / std
        changed = (np.abs(scaled).max(axis=1) > _UNTOUCHED) | (moved > _UNTOUCHED)
        names = {name for name, is_changed in zip(self.names, changed, strict=True) if is_changed}
        touched = {draw.name for draw in space.draws if names & set(draw.components)}
        for correlation in space.correlations:
            if touched & set(correlation.names):
                touched |= set(correlation.names)
        return touched


def bounds_of(law: Law, number: int) -> tuple[float, float]:
    """Return the bounds of one of a law's numbers, infinite for none."""
    axis = np.eye(law.size)[number]
    return -float(law.support(-axis)), float(law.support(axis))


def _clip(normal: JointNormal, bounds: Sequence[tuple[float, float]]) -> Law:
    """Return the law with those bounds that lie within its reach; the normal law itself if none does."""
    # A number of which a combination with others is known is not cut: that would spoil what is known. But a number that
    # its prior keeps on one side of zero, such as a stiffness, stays there: it is cut half way from its bound to zero,
    # which the normal law hardly reaches.
    std = np.sqrt(np.diag(normal.covariance))
    unit = np.where(std > 0, std, 1.0)
    correlation = normal.covariance / np.outer(unit, unit)
    np.fill_diagonal(correlation, 1.0)
    own = 1 / np.sqrt(np.diag(np.linalg.inv(correlation + _UNTOUCHED * np.eye(len(unit)))))
    reached = []
    for k, (low, high) in enumerate(bounds):
        first, last = normal.interval(k)
        if own[k] <= _FREE:
            low, high = (low / 2 if low >= 0 else -np.inf), (high / 2 if high <= 0 else np.inf)
        reached.append((low if first < low else -np.inf, high if last > high else np.inf))
    return dataclasses.replace(normal, bounds=tuple(reached)) if np.isfinite(reached).any() else normal
