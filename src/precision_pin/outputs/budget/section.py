"""The error budget: who causes how much."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from precision_pin.analyses.budget.budget_result import VECTORS, BudgetResult, DrawShare, PoseBudget
from precision_pin.display.tables import milli, plus_minus, quantity_label, unit
from precision_pin.outputs.budget.figure import figure as bars
from precision_pin.outputs.budget.table import draw_rows, ranked, source_name
from precision_pin.outputs.kit.html import Child, Html, beside, paragraph, table
from precision_pin.outputs.kit.svg import figure
from precision_pin.outputs.report.collect import Results
from precision_pin.outputs.report.numbers import percent, shown

__all__ = ["content"]

_NAMED: Final = 5
_LISTED: Final = 40


def content(result: BudgetResult, results: Results) -> list[Child]:
    """Return the chart, a table of the draws for position and one for attitude, and one of sources and places."""
    del results
    pose = result.poses[0]
    if not pose.draws:
        return [paragraph("Nothing varies: there is nothing to share.")]
    chart = figure(
        bars(result),
        "budget",
        f"Shares of the variance: {'; '.join(_largest(pose, vector) for vector in VECTORS)}",
        "Sobol indices of the exact model with their intervals; diamonds are the closed form of the first order.",
    )
    draws = [_draws(pose, vector, result.marked) for vector in VECTORS]
    return [_explained(result), chart, *draws, beside(*_shares(pose))]


def _explained(result: BudgetResult) -> Html:
    return paragraph(
        "Share: of the variance, to first order, in closed form. S1 and ST: first-order and total Sobol index of the exact "
        f"model from {result.samples:,} points a set, seed {result.provenance.seed}, behind ± half of the interval at "
        f"{100 * result.confidence:g} % confidence. Halved: what results if the tolerance of this draw alone is halved.",
        class_="note",
    )


def _largest(pose: PoseBudget, vector: str) -> str:
    largest = ranked(pose, vector)[:_NAMED]
    return f"of the {vector} error " + ", ".join(f"{draw.name} {percent(draw.share[vector])} %" for draw in largest)


def _draws(pose: PoseBudget, vector: str, marked: float) -> Html:
    norm = f"{vector}.norm"

    def halved(draw: DrawShare) -> list[str]:
        change = draw.halved.change[norm]
        gain = "-" if change is None else plus_minus(1e3 * change.value, 1e3 * change.half_width, decimals=3)
        return [milli(draw.halved.std[vector], 5), gain]

    rows = [[name, scope, *map(shown, cells)] for name, scope, *cells in draw_rows(pose, vector, _LISTED, halved, 2)]
    header = [
        "draw",
        "drawn per",
        "share %",
        "S1 %",
        "ST %",
        f"halved: std [{unit(norm)}]",
        f"change of {100 * marked:g} % of {quantity_label(norm)}",
    ]
    now = f"std {milli(pose.std[vector], 5)} {unit(norm)} now"
    return table(f"Draws, {vector} error ({now})", header, rows, words=(1,), last=True)


def _shares(pose: PoseBudget) -> list[Html]:
    sources = [(source_name(line), line.share) for line in pose.sources]
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


def _ranked(caption: str, heading: str, lines: Iterable[tuple[str, Mapping[str, float | None]]]) -> Html:
    largest = sorted(lines, key=lambda line: max(line[1][vector] or 0.0 for vector in VECTORS), reverse=True)
    rows = [[name, *(percent(share[vector]) for vector in VECTORS)] for name, share in largest]
    return table(caption, [heading, *(f"{vector} %" for vector in VECTORS)], rows)
