"""Terminal table of a budget."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from typing import Final

from precision_pin.analyses.budget.budget import check_quantities
from precision_pin.analyses.budget.budget_result import BudgetResult, DrawShare, Group, PoseBudget, scaled
from precision_pin.analyses.result import answer_of, subject
from precision_pin.analyses.shares import VECTORS, Shares, SourceShare
from precision_pin.base.errors import shortened
from precision_pin.render.tables import percent, plus_minus, symbol, unit
from precision_pin.render.text_table import aligned, limited

MOST_OF_NAME: Final = 40  # letters of a name in a table row


def table(result: BudgetResult, quantities: Sequence[str] = ()) -> str:
    """Return the budget of every pose: per cent, mm and mrad, half-widths of intervals after ±.

    Args:
        quantities: One block each: ``position`` and ``attitude`` by default, ``position.norm``, ``position.x``, …

    Raises:
        UnknownNameError: No such quantity.
    """
    quantities = check_quantities(quantities or VECTORS)
    lines = [*_answer(result, quantities), ""]
    rows = limited(10) or sys.maxsize
    for pose in result.poses:
        lines += _heads(result, pose)
        for quantity in quantities:
            lines += ["", _headline(result, pose, quantity), *aligned(_draw_rows(pose, quantity, rows))]
        names = list(dict.fromkeys(quantity for quantity in quantities if not quantity.endswith(".norm"))) or [*VECTORS]
        lines += ["", *aligned(_share_rows("source", names, ((source_name(s), s.share) for s in pose.sources), rows))]
        lines += ["", *aligned(_share_rows("joint or link", names, ((p.name, p.share) for p in pose.places), rows))]
        lines += ["", *_notes(result, pose, quantities), ""]
    return "\n".join(lines).rstrip()


def _answer(result: BudgetResult, quantities: Sequence[str]) -> list[str]:
    """Return for each quantity which tolerance causes most of its spread, at the worst pose."""
    lines = []
    for quantity in quantities:
        phrases, sizes = [], []
        for pose in result.poses:
            largest = next(iter(ranked(pose, quantity)), None)
            share = None if largest is None else largest.share.get(quantity)
            phrase = "no tolerance causes a spread"
            if largest is not None and share:
                width = f", {largest.tolerance}," if largest.tolerance else ""
                phrase = f"{shortened(largest.name, MOST_OF_NAME)}{width} causes {100 * share:.3g} % of the variance"
            phrases.append(f"{quantity}: {phrase}")
            sizes.append(pose.sums[quantity].std or 0.0)
        lines.append(answer_of([pose.pose for pose in result.poses], sizes, phrases))
    return lines


def _heads(result: BudgetResult, pose: PoseBudget) -> list[str]:
    run = result.provenance
    return [
        subject(run, pose.pose),
        f"exact model at {result.samples:,} points a set, seed {run.seed}, statics {run.statics}; base axes; "
        f"± half of an interval at {100 * result.confidence:g} % confidence",
        "share: of the variance, closed form, first order; ST: total Sobol index of the exact model; halved: change of the "
        f"{100 * result.marked:g} % quantile of the norm if this tolerance alone is halved",
    ]


def _headline(result: BudgetResult, pose: PoseBudget, quantity: str) -> str:
    sums = pose.sums[quantity]
    parts = []
    if sums.std is not None:
        parts.append(f"std {1e3 * sums.std:.5g} {unit(quantity)} in closed form")
    if sums.variance is None:
        parts.append("std not resolved by sampling")
    elif sums.variance.value > 0:
        below, above = sums.variance.interval
        low, sampled, high = (math.sqrt(max(end, 0.0)) for end in (below, sums.variance.value, above))
        half = max(high - sampled, sampled - low)
        parts.append(f"std {plus_minus(1e3 * sampled, 1e3 * half, decimals=6)} {unit(quantity)} sampled")
    norm = f"{quantity.partition('.')[0]}.norm"
    if quantity in (*VECTORS, norm):
        marked = pose.quantile[norm]
        within = "not resolved" if marked is None else f"within {scaled(marked, 1e3, 6)} {unit(norm)}"
        parts.append(f"{100 * result.marked:g} % of {symbol(norm)} {within}")
    return f"{quantity}: {'; '.join(parts)}"


def _draw_rows(pose: PoseBudget, quantity: str, count: int) -> list[list[str]]:
    """Return rows of the draws, largest first, then of the rest together, of correlated groups, and the sum."""
    norm = f"{quantity.partition('.')[0]}.norm"
    component = quantity not in (*VECTORS, norm)
    rows = [["draw", "tolerance", "share %", "ST %"]]
    rows[0] += ["worst case %", f"halved: std {unit(quantity)}"] if component else [f"halved: {unit(quantity)}"]
    empty = [""] * (len(rows[0]) - 4)

    def total(group: Group) -> str:
        return scaled(group.total[quantity], 100) + "*" * (quantity in group.nonlinear)

    draws = ranked(pose, quantity)
    for draw in draws[:count]:
        group = pose.group(draw.name)
        further = [scaled(draw.halved.change.get(norm), 1e3, signed=True)]
        if component:
            further = [percent(draw.worst_case.get(quantity)), f"{1e3 * draw.halved.std[quantity]:.5g}"]
        total_index = total(group) if len(group.draws) == 1 else "-"
        name = shortened(draw.name, MOST_OF_NAME)
        rows.append([name, draw.tolerance, percent(draw.share.get(quantity)), total_index, *further])
    if len(draws) > count:
        rest_shares = [draw.share.get(quantity) for draw in draws[count:]]
        rest_share = None if None in rest_shares else math.fsum(share for share in rest_shares if share is not None)
        rows.append([f"and {len(rest_shares)} more: --all", "", percent(rest_share), "", *empty])
    for group in pose.groups:
        if len(group.draws) > 1:
            name = f"correlated: {' + '.join(group.draws)}"
            rows.append([name, "", percent(group.share.get(quantity)), total(group), *empty])
    return [*rows, ["sum", "", percent(pose.sums[quantity].closed), "", *empty]]


def ranked(pose: PoseBudget, quantity: str) -> list[DrawShare]:
    """Return the draws by share of a quantity, largest first; by total index where there are no shares."""

    def rank(draw: DrawShare) -> float:
        share = draw.share.get(quantity)
        total = pose.group(draw.name).total[quantity]
        return share if share is not None else -1.0 if total is None else total.value

    return sorted(pose.draws, key=rank, reverse=True)


def _share_rows(
    heading: str, quantities: Sequence[str], lines: Iterable[tuple[str, Shares]], count: int
) -> list[list[str]]:
    sorted_lines = sorted(lines, key=lambda line: line[1][quantities[0]] or 0.0, reverse=True)
    rows = [[heading, "", *(f"{quantity} %" for quantity in quantities)]]
    rows += [[name, "", *(percent(share[quantity]) for quantity in quantities)] for name, share in sorted_lines[:count]]
    if len(sorted_lines) > count:
        rows.append([f"and {len(sorted_lines) - count} more: --all", "", *("" for _ in quantities)])
    return rows


def source_name(line: SourceShare) -> str:
    """Return the name of a source's line, with the sources if several or none use the draw."""
    if len(line.sources) == 1 or line.draws != (line.name,):
        return line.name
    return f"{line.name}: {', '.join(line.sources) if line.sources else 'no source'}"


def _notes(result: BudgetResult, pose: PoseBudget, quantities: Sequence[str]) -> list[str]:
    notes = [
        f"first-order Sobol indices: {', '.join(_first_order(pose, quantity) for quantity in quantities)}",
        "a draw that several sources name has its own line; a joint's or link's share is negative where it cancels another's",
    ]
    if any(quantity in group.nonlinear for group in pose.groups for quantity in quantities):
        notes.append("*: share and index are more than one percentage point apart; the exact model is not linear here")
    if any(pose.sums[quantity].variance is None for quantity in quantities):
        notes.append("- among the indices: not resolved; too few points for the tails or the rare values of the laws")
    if any(draw.unbounded for draw in pose.draws) and set(quantities) - {*VECTORS, "position.norm", "attitude.norm"}:
        notes.append(f"worst case: unbounded laws are cut off at {result.k:g} standard deviations")
    return notes


def _first_order(pose: PoseBudget, quantity: str) -> str:
    total = scaled(pose.sums[quantity].first, 100)
    return f"{quantity} sum to {total} %" if total != "-" else f"{quantity} not resolved"
