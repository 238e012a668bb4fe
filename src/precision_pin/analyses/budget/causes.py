"""Shares of the causes of the error in its variance, for a report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from precision_pin.analyses.budget.budget_result import DrawShare, Group, PoseBudget
from precision_pin.analyses.collect import Cause, CauseShare


def rank_causes(causes: Sequence[Cause], budget: PoseBudget, vector: str) -> list[CauseShare]:
    """Return the shares of the variance of a vector, the largest first."""
    lines = {line.name: line for line in budget.draws}
    groups = {name: group for group in budget.groups for name in group.draws}
    shares = [_share(cause, lines, groups, budget, vector) for cause in causes]
    return sorted(shares, key=lambda share: -round(share.rank, 9))


def _share(
    cause: Cause, lines: Mapping[str, DrawShare], groups: Mapping[str, Group], budget: PoseBudget, vector: str
) -> CauseShare:
    cause_lines = [lines[name] for name in cause.names]
    free = all(len(groups[name].draws) == 1 for name in cause.names)
    shares = [line.share.get(vector) for line in cause_lines]
    share = None if None in shares else math.fsum(value for value in shares if value is not None)
    if len(cause_lines) == 1:
        group = groups[cause.names[0]]
        first, total = (group.first[vector], group.total[vector]) if free else (None, None)
        return CauseShare(cause, share, cause_lines[0].halved.std.get(vector), first, total)
    std = budget.sums[vector].std
    halved = math.sqrt(max(0.0, 1 - 0.75 * share)) * std if free and share is not None and std is not None else None
    return CauseShare(cause, share, halved, None, None)
