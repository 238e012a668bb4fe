"""The worst case."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.worst_case.worst_case_result import (
    SEEN_LEVEL,
    NormBound,
    PoseWorstCase,
    WorstCaseResult,
    bound_milli,
)
from precision_pin.display.tables import ROUNDING, milli, quantity_label, symbol, unit
from precision_pin.outputs.kit.html import Child, Html, beside, items, table
from precision_pin.outputs.kit.svg import figure
from precision_pin.outputs.report.collect import Results
from precision_pin.outputs.report.numbers import milli_interval, statistic
from precision_pin.outputs.worst_case.figure import figure as bars

__all__ = ["content"]

_LISTED: Final = 15


def content(result: WorstCaseResult, results: Results) -> list[Child]:
    """Return the bounds of the first-order model, the largest exact error found, and what adds up to them."""
    del results
    pose = result.poses[0]
    norms = (pose.position, pose.attitude)
    chart = figure(
        bars(result),
        "worst-case",
        f"How the draws add up to the worst case: {'; '.join(_described(bound) for bound in norms)}",
        "Each bar begins where the one above it ends.",
    )
    return [
        items(_assumptions(result), "note"),
        _norms(pose),
        chart,
        _components(pose),
        beside(*(_contributions(bound) for bound in norms)),
    ]


def _assumptions(result: WorstCaseResult) -> list[str]:
    exceeded = [
        symbol(bound.quantity) for bound in (result.poses[0].position, result.poses[0].attitude) if bound.exceeded
    ]
    beyond = (
        [f"the exact model goes beyond the first-order bound of {' and of '.join(exceeded)} here"] if exceeded else []
    )
    return [*result.assumptions, *beyond]


def _described(bound: NormBound) -> str:
    name, upper = bound.quantity, bound_milli(bound.first_order.upper, up=True, digits=5)
    return (
        f"{symbol(name)} bound {upper} {unit(name)}, exact model at least {milli(bound.found.norm, 5)}, "
        f"largest seen {milli(bound.seen.max, 5)}, of which error at the means {milli(bound.nominal, 5)} and "
        + ", ".join(f"{entry.draw} {milli(entry.value, 4)}" for entry in bound.contributions[:5])
    )


def _norms(pose: PoseWorstCase) -> Html:
    header = [
        "",
        "first-order bound",
        "exact model there",
        "largest exact error found",
        "largest seen",
        f"{100 * SEEN_LEVEL:g} % of the samples within",
        "interval",
    ]
    rows = []
    for bound in (pose.position, pose.attitude):
        certified = "" if bound.first_order.certified else " (not certified to 1e-9)"
        rows.append(
            [
                quantity_label(bound.quantity),
                bound_milli(bound.first_order.upper, up=True) + certified,
                milli(bound.exact_norm),
                milli(bound.found.norm),
                milli(bound.seen.max),
                statistic(bound.seen, SEEN_LEVEL),
                milli_interval(bound.seen, SEEN_LEVEL),
            ]
        )
    return table("Worst case of the sizes; exact model, samples beside it", header, rows)


def _components(pose: PoseWorstCase) -> Html:
    header = ["", "lowest, first order", "highest, first order", "smallest seen", "largest seen"]
    rows = []
    for entry in pose.components:
        ends = bound_milli(entry.low, up=False), bound_milli(entry.high, up=True)
        rows.append([quantity_label(entry.quantity), *ends, *map(milli, entry.seen)])
    return table("Worst case of the components", header, rows)


def _contributions(bound: NormBound) -> Html:
    named = [entry for entry in bound.contributions if abs(entry.value) > ROUNDING][:_LISTED]
    rest = [entry for entry in bound.contributions if entry not in named]
    rows: list[list[Child]] = [["error at the means", milli(bound.nominal)]]
    rows += [[entry.draw, milli(entry.value)] for entry in named]
    if rest:
        rows.append([f"{len(rest)} more", milli(sum(entry.value for entry in rest))])
    rows.append(["sum: the worst case", milli(bound.nominal + sum(entry.value for entry in bound.contributions))])
    header = ["draw", f"adds [{unit(bound.quantity)}]"]
    return table(f"What adds up to the worst {symbol(bound.quantity)}", header, rows, last=True)
