"""The worst case."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.causes import sum_by_cause
from precision_pin.analyses.collect import Results
from precision_pin.analyses.report_cells import milli_interval, statistic
from precision_pin.analyses.worst_case.figure import explain_excess
from precision_pin.analyses.worst_case.figure import figure as bars
from precision_pin.analyses.worst_case.worst_case_result import (
    SEEN_LEVEL,
    NormBound,
    PoseWorstCase,
    WorstCaseResult,
    bound_milli,
)
from precision_pin.render.html import Child, Html, beside, items, table
from precision_pin.render.svg import figure
from precision_pin.render.tables import ROUNDING, milli, quantity_label, symbol, unit

_LISTED: Final = 15
_BARS: Final = 8
_CUT: Final = 4


def content(result: WorstCaseResult, results: Results) -> list[Child]:
    """Return the bounds of the first-order model, the largest exact error found, and their contributions."""
    pose = result.poses[0]
    norms = (pose.position, pose.attitude)
    chart = figure(
        bars(result, 0, {bound.quantity: _entries(bound, results, _BARS) for bound in norms}),
        f"{results.prefix}worst-case",
        f"How the draws add up to the worst case: {'; '.join(_described(bound, results) for bound in norms)}",
        "Each bar begins where the one above it ends.",
    )
    return [
        items(_assumptions(result, results), "note"),
        _norms(pose),
        chart,
        _components(pose),
        beside(*(_contributions(bound, results) for bound in norms)),
    ]


def _assumptions(result: WorstCaseResult, results: Results) -> list[str]:
    words = {name: cause.words for cause in results.causes for name in cause.names}
    cut = list(dict.fromkeys(words.get(name, name) for name in result.cut))
    named = ", ".join(cut[:_CUT]) + (f" and {len(cut) - _CUT} more" if len(cut) > _CUT else "")
    return [*result.assumptions[:-1], result.say_cut(named), *explain_excess(result.poses[0])]


def _entries(bound: NormBound, results: Results, most: int) -> list[tuple[str, float]]:
    """Return the error at the means, the largest causes, and the sum of the others."""
    values = {entry.draw: entry.value for entry in bound.contributions}
    entries = [entry for entry in sum_by_cause(results.causes, values) if abs(entry[1]) > ROUNDING]
    named, rest = entries[:most], entries[most:]
    more = [(f"{len(rest)} more", sum(value for _, value in rest))] if rest else []
    return [("error at the means", bound.nominal), *named, *more]


def _described(bound: NormBound, results: Results) -> str:
    name, upper = bound.quantity, bound_milli(bound.first_order.upper, up=True, digits=5)
    return (
        f"{symbol(name)} bound {upper} {unit(name)}, exact model at least {milli(bound.found.norm, 5)}, "
        f"largest seen {milli(bound.seen.max, 5)}, of which "
        + ", ".join(f"{name} {milli(value, 4)}" for name, value in _entries(bound, results, 5))
    )


def _norms(pose: PoseWorstCase) -> Html:
    header = [
        *("", "first-order bound", "exact model there", "largest exact error found", "largest seen"),
        *(f"{100 * SEEN_LEVEL:g} % of the samples within", "interval"),
    ]
    rows = []
    for bound in (pose.position, pose.attitude):
        certified = "" if bound.first_order.certified else " (not certified to 1e-9)"
        upper = bound_milli(bound.first_order.upper, up=True) + certified
        sizes = map(milli, (bound.exact_norm, bound.found.norm, bound.seen.max))
        seen = statistic(bound.seen, SEEN_LEVEL), milli_interval(bound.seen, SEEN_LEVEL)
        rows.append([quantity_label(bound.quantity), upper, *sizes, *seen])
    return table("Worst case of the sizes; exact model, samples beside it", header, rows)


def _components(pose: PoseWorstCase) -> Html:
    header = ["", "lowest, first order", "highest, first order", "smallest seen", "largest seen"]
    rows = []
    for entry in pose.components:
        ends = bound_milli(entry.low, up=False), bound_milli(entry.high, up=True)
        rows.append([quantity_label(entry.quantity), *ends, *map(milli, entry.seen)])
    return table("Worst case of the components", header, rows)


def _contributions(bound: NormBound, results: Results) -> Html:
    rows: list[list[Child]] = [[name, milli(value)] for name, value in _entries(bound, results, _LISTED)]
    rows.append(["sum: the worst case", milli(bound.nominal + sum(entry.value for entry in bound.contributions))])
    header = ["cause", f"adds [{unit(bound.quantity)}]"]
    return table(f"What adds up to the worst {symbol(bound.quantity)}", header, rows, last=True)
