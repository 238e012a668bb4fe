"""Causes of the error in words: the draws of each tolerance, merged."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

from precision_pin.analyses.budget.budget_result import DrawShare, Estimate, Group, PoseBudget
from precision_pin.draws.draw import Draw
from precision_pin.model.error_model import ErrorModel


@final
@dataclass(frozen=True)
class Part:
    """A draw's name in the sheet and its description."""

    name: str
    words: str


@final
@dataclass(frozen=True)
class Cause:
    """The draws that one tolerance makes, and how often they are drawn.

    Attributes:
        words, tolerance: Such as ``tilt of joint2 about z`` and ``±0.3 mm``; the latter empty for an unknown unit.
    """

    words: str
    tolerance: str
    scope: str
    parts: tuple[Part, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its draws."""
        return tuple(part.name for part in self.parts)

    @property
    def text(self) -> str:
        """Words and tolerance."""
        return f"{self.words}, {self.tolerance}" if self.tolerance else self.words


@final
@dataclass(frozen=True)
class CauseShare:
    """A cause's contribution to the variance of a vector.

    Attributes:
        share: Closed form; ``None`` where nothing varies.
        halved: Standard deviation with the tolerance halved, m or rad; ``None`` where its draws are correlated.
        first, total: Sobol indices of the exact model; ``None`` for several draws together and where not resolved.
    """

    cause: Cause
    share: float | None
    halved: float | None
    first: Estimate | None
    total: Estimate | None

    @property
    def rank(self) -> float:
        """Sort key: the share, or the total index where there is none."""
        if self.share is not None:
            return self.share
        return -1.0 if self.total is None else self.total.value


def find_causes(model: ErrorModel) -> tuple[Cause, ...]:
    """Return the causes of a model, in the order of their first draws.

    A source's own draws (bearings of an axis, a phase) that share a law, or have no tolerance, are one cause.
    """
    own = {
        draw.name: label
        for source, label in zip(model.sources, model.labels, strict=True)
        for draw in source.own_draws(label)
    }
    groups: dict[object, list[tuple[Draw, str]]] = {}
    first_of: dict[str, object] = {}
    for draw, words, owners in zip(model.space.draws, model.draw_words, model.owners, strict=True):
        label = own.get(draw.name)
        key: object = draw.name
        if label is not None:
            tolerance = draw.tolerance
            key = (label, draw.law, draw.scope) if tolerance else first_of.get(label, draw.name)
        if len(owners) == 1:
            first_of.setdefault(owners[0], key)
        groups.setdefault(key, []).append((draw, words))
    return tuple(_cause(members) for members in groups.values())


def rank_causes(causes: Sequence[Cause], budget: PoseBudget, vector: str) -> list[CauseShare]:
    """Return the shares of the variance of a vector, the largest first."""
    lines = {line.name: line for line in budget.draws}
    groups = {name: group for group in budget.groups for name in group.draws}
    found = [_share(cause, lines, groups, budget, vector) for cause in causes]
    return sorted(found, key=lambda one: -round(one.rank, 9))


def _cause(members: Sequence[tuple[Draw, str]]) -> Cause:
    draw, words = members[0]
    parts = tuple(Part(draw.name, words) for draw, words in members)
    # the two bearings of an axis merge into the axis, an amplitude and its phase into the amplitude
    stems = {text.rpartition(",")[0] for _, text in members}
    name = stems.pop() if len(members) > 1 and len(stems) == 1 else ""
    return Cause(name or words, draw.tolerance, draw.scope.value, parts)


def _share(
    cause: Cause, lines: Mapping[str, DrawShare], groups: Mapping[str, Group], budget: PoseBudget, vector: str
) -> CauseShare:
    of = [lines[name] for name in cause.names]
    free = all(len(groups[name].draws) == 1 for name in cause.names)
    shares = [line.share.get(vector) for line in of]
    share = None if None in shares else math.fsum(value for value in shares if value is not None)
    if len(of) == 1:
        group = groups[cause.names[0]]
        first, total = (group.first[vector], group.total[vector]) if free else (None, None)
        return CauseShare(cause, share, of[0].halved.std.get(vector), first, total)
    now = budget.sums[vector].std
    halved = math.sqrt(max(0.0, 1 - 0.75 * share)) * now if free and share is not None and now is not None else None
    return CauseShare(cause, share, halved, None, None)


def sum_by_cause(causes: Sequence[Cause], values: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the values of draws summed by cause, as text, largest first."""
    of = {name: cause.text for cause in causes for name in cause.names}
    sums: dict[str, float] = {}
    for names, value in values.items():
        known = [of.get(name, name) for name in ([names] if names in of else names.split(", "))]
        text = " and ".join(dict.fromkeys(known))
        sums[text] = sums.get(text, 0.0) + value
    return sorted(sums.items(), key=lambda entry: -round(abs(entry[1]), 15))
