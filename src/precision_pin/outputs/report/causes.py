"""The error budget: who causes how much."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

from precision_pin.analyses.budget_result import (
    VECTORS,
    BudgetResult,
    DrawShare,
    Estimate,
    Group,
    PoseBudget,
    SourceShare,
)
from precision_pin.outputs import budget_report

from .elements import Child, Html, beside, paragraph, section, table
from .figures import figure
from .numbers import MISSING, milli, percent, symbol_of, with_half_width
from .results import Missing, Results
from .wording import left_out

__all__ = ["causes"]

_NAMED: Final = 5
_LISTED: Final = 40


def causes(results: Results) -> Html:
    """Return the chart, a table of the draws for position and one for attitude, and one of sources and places."""
    if isinstance(results.budget, Missing):
        return section("budget", "Error budget", left_out("Budget", results.budget, results))
    result = results.budget
    pose = result.poses[0]
    if not pose.draws:
        return section("budget", "Error budget", paragraph("Nothing varies: there is nothing to share."))
    chart = figure(
        budget_report.figure(result),
        "budget",
        f"Shares of the variance: {'; '.join(_largest(pose, vector) for vector in VECTORS)}",
        "Sobol indices of the exact model with their intervals; diamonds are the closed form of the first order.",
    )
    draws = [_draws(pose, vector) for vector in VECTORS]
    return section("budget", "Error budget", _explained(result), chart, *draws, beside(*_shares(pose)))


def _explained(result: BudgetResult) -> Html:
    return paragraph(
        "Share: of the variance, to first order, in closed form. S1 and ST: first-order and total Sobol index of the exact "
        f"model from {result.samples:,} points a set, seed {result.heading.seed}, behind ± half of the interval at "
        f"{100 * result.confidence:g} % confidence. Halved: what results if the tolerance of this draw alone is halved.",
        class_="note",
    )


def _largest(pose: PoseBudget, vector: str) -> str:
    ranked = sorted(pose.draws, key=lambda draw: _rank(pose, draw, vector), reverse=True)[:_NAMED]
    return f"of the {vector} error " + ", ".join(f"{draw.name} {percent(draw.share[vector])} %" for draw in ranked)


def _rank(pose: PoseBudget, draw: DrawShare, vector: str) -> float:
    share = draw.share[vector]
    if share is not None:
        return share
    total = pose.group(draw.name).total[vector]
    return -1.0 if total is None else total.value


def _draws(pose: PoseBudget, vector: str) -> Html:
    symbol, unit = symbol_of(f"{vector}.norm")
    ranked = sorted(pose.draws, key=lambda draw: _rank(pose, draw, vector), reverse=True)
    rows: list[list[Child]] = []
    for draw in ranked[:_LISTED]:
        group = pose.group(draw.name)
        indices = _indices(group, vector) if len(group.draws) == 1 else [MISSING, MISSING]
        change = draw.halved.change[f"{vector}.norm"]
        rows.append(
            [
                draw.name,
                draw.scope,
                percent(draw.share[vector]),
                *indices,
                milli(draw.halved.std[vector], 5),
                with_half_width(change.value, change.half_width, 1e3),
            ]
        )
    if len(ranked) > _LISTED:
        rest = [draw.share[vector] for draw in ranked[_LISTED:]]
        together = None if None in rest else math.fsum(share for share in rest if share is not None)
        rows.append([f"{len(rest)} more", "", percent(together), "", "", "", ""])
    for group in pose.groups:
        if len(group.draws) > 1:
            name = f"correlated: {' + '.join(group.draws)}"
            rows.append([name, "", percent(group.share[vector]), *_indices(group, vector), "", ""])
    sums = pose.sums[vector]
    rows.append(["sum", "", percent(sums.closed), _estimate(sums.first), "", "", ""])
    header = [
        "draw",
        "drawn per",
        "share %",
        "S1 %",
        "ST %",
        f"halved: std [{unit}]",
        f"change of 99.73 % of {symbol} [{unit}]",
    ]
    now = pose.std[vector]
    return table(f"Draws, {vector} error (std {milli(now, 5)} {unit} now)", header, rows, words=(1,), last=True)


def _indices(group: Group, vector: str) -> list[Child]:
    return [_estimate(group.first[vector]), _estimate(group.total[vector])]


def _estimate(estimate: Estimate | None) -> str:
    return MISSING if estimate is None else with_half_width(estimate.value, estimate.half_width)


def _shares(pose: PoseBudget) -> list[Html]:
    sources = [(_source(line), line.share) for line in pose.sources]
    places = [(place.name, place.share) for place in pose.places]
    return [
        _ranked(
            "Sources: shares of the variance; a draw that several sources name has a line of its own", "source", sources
        ),
        _ranked(
            "Joints and links: covariance of their part with the whole, negative where one undoes what others do",
            "joint or link",
            places,
        ),
    ]


def _source(line: SourceShare) -> str:
    if len(line.sources) == 1:
        return line.sources[0]
    return f"{line.draws[0]}: {', '.join(line.sources) if line.sources else 'no source'}"


def _ranked(caption: str, heading: str, lines: Iterable[tuple[str, Mapping[str, float | None]]]) -> Html:
    ranked = sorted(lines, key=lambda line: max(line[1][vector] or 0.0 for vector in VECTORS), reverse=True)
    rows = [[name, *(percent(share[vector]) for vector in VECTORS)] for name, share in ranked]
    return table(caption, [heading, *(f"{vector} %" for vector in VECTORS)], rows)
