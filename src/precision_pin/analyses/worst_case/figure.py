"""The worst case in pictures and in the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from precision_pin.analyses.collect import Results, sum_by_cause
from precision_pin.analyses.worst_case.table import NORM_COLUMNS, listed_contributions
from precision_pin.analyses.worst_case.worst_case import (
    SEEN_LEVEL,
    NormBound,
    PoseWorstCase,
    WorstCaseResult,
    bound_milli,
)
from precision_pin.render import figure_style
from precision_pin.render.columns import report_table
from precision_pin.render.draw_distribution import BLACK, BLUE, GREEN, PURPLE, SKY, VERMILION, display_unit
from precision_pin.render.html import Child, Html, beside, items, table
from precision_pin.render.tables import ROUNDING, milli, symbol, unit

_LISTED: Final = 15  # contributions in the table of the report
_MEANS: Final = "error at the means"
_BARS: Final = 8  # contributions in the figure of the report
_CUT: Final = 4  # draws named in a sentence


def content(result: WorstCaseResult, results: Results) -> list[Child]:
    """Return the bounds of the first-order model, the largest exact error found, and their contributions."""
    pose = result.poses[0]
    norms = (pose.position, pose.attitude)
    chart = figure_style.inline_figure(
        figure(result, 0, {bound.quantity: _entries(bound, results, _BARS) for bound in norms}),
        f"{results.prefix}worst-case",
        f"How the draws add up to the worst case: {'; '.join(_describe(bound, results) for bound in norms)}",
        "Each bar begins where the one above it ends.",
    )
    return [
        items(_assumptions(result, results), "note"),
        report_table("Worst case of the sizes; exact model, samples beside it", NORM_COLUMNS, norms),
        chart,
        report_table("Worst case of the components", result.COLUMNS, pose.components),
        beside(*(_contributions(bound, results) for bound in norms)),
    ]


def _assumptions(result: WorstCaseResult, results: Results) -> list[str]:
    descriptions = {name: cause.words for cause in results.causes for name in cause.names}
    cut_names = list(dict.fromkeys(descriptions.get(name, name) for name in result.cut))
    text = ", ".join(cut_names[:_CUT]) + (f" and {len(cut_names) - _CUT} more" if len(cut_names) > _CUT else "")
    return [*result.assumptions[:-1], result.say_cut(text), *explain_excess(result.poses[0])]


def _entries(bound: NormBound, results: Results, most: int) -> list[tuple[str, float]]:
    values = {entry.draw: entry.value for entry in bound.contributions}
    entries = [entry for entry in sum_by_cause(results.causes, values) if abs(entry[1]) > ROUNDING]
    largest, others = entries[:most], entries[most:]
    remainder = [(f"{len(others)} more", sum(value for _, value in others))] if others else []
    return [(_MEANS, bound.nominal), *largest, *remainder]


def _describe(bound: NormBound, results: Results) -> str:
    name, upper = bound.quantity, bound_milli(bound.first_order.upper, digits=5)
    return (
        f"{symbol(name)} bound {upper} {unit(name)}, exact model at least {milli(bound.found.norm, 5)}, "
        f"largest seen {milli(bound.seen.max, 5)}, of which "
        + ", ".join(f"{name} {milli(value, 4)}" for name, value in _entries(bound, results, 5))
    )


def _contributions(bound: NormBound, results: Results) -> Html:
    rows: list[list[Child]] = [[name, milli(value)] for name, value in _entries(bound, results, _LISTED)]
    rows.append(["sum: the worst case", milli(bound.nominal + sum(entry.value for entry in bound.contributions))])
    header = ["cause", f"adds [{unit(bound.quantity)}]"]
    return table(f"What adds up to the worst {symbol(bound.quantity)}", header, rows, last=True)


_LONGEST_NAME: Final = 44  # letters beside the bars
_BAR: Final = 4.6  # mm, height of a bar with its gap


def figure(
    result: WorstCaseResult, which: int = 0, entries: Mapping[str, Sequence[tuple[str, float]]] | None = None
) -> Figure:
    """Return how the draws add up to the worst case of |d| (above) and |δ| at one of the poses, 174 mm wide.

    Each bar begins where the one above it ends: the error at the means, the largest contributions, the rest. Lines mark
    the first-order bound, the largest exact error found, the largest seen and the 99.73 % quantile of the samples.
    """
    pose, provenance = result.poses[which], result.provenance
    lines = [
        figure_style.caption("worst case", provenance, pose.pose),
        f"N = {result.samples:,}, seed {provenance.seed}, exact model, statics {provenance.statics}",
    ]
    if result.cut:
        lines.append(f"unbounded laws cut at {result.k:g} standard deviations: {len(result.cut)} of {result.draws}")
    lines += explain_excess(pose)
    with figure_style.style():
        chart = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        bounds = (pose.position, pose.attitude)
        bars = [listed_contributions(bound, _MEANS) if entries is None else entries[bound.quantity] for bound in bounds]
        panels = chart.subplots(2, 1, height_ratios=[max(len(rows), 4) for rows in bars])
        for axes, bound, rows in zip(panels, bounds, bars, strict=True):
            _draw(axes, bound, rows)
        height = 34 + _BAR * sum(max(len(rows), 4) for rows in bars)
        figure_style.frame(chart, panels[:1], "", "\n".join(lines), height, 2)
    return chart


def draw(axes: Axes, result: WorstCaseResult, which: int, quantity: str) -> None:
    """Draw one vector, ``"position"`` or ``"attitude"``, on given axes."""
    bound = {"position": result.poses[which].position, "attitude": result.poses[which].attitude}[quantity]
    with figure_style.style():
        _draw(axes, bound, listed_contributions(bound, _MEANS))


def explain_excess(pose: PoseWorstCase) -> list[str]:
    """Return why an error beyond a bound was found, if one was."""
    lines = []
    for bound in (pose.position, pose.attitude):
        upper = bound.first_order.upper * (1 + 1e-9) + ROUNDING
        name = symbol(bound.quantity)
        if bound.found.norm > upper:
            lines.append(
                f"{name}: the exact model goes beyond its first-order bound: it is not linear over tolerances this large"
            )
        if bound.seen.max > upper:
            lines.append(f"{name}: samples lie beyond the bound, which cuts unbounded laws and is of the first order")
    return lines


def _draw(axes: Axes, bound: NormBound, entries: Sequence[tuple[str, float]]) -> None:
    name, unit = symbol(bound.quantity), display_unit(bound.seen)
    begin = 0.0
    for row, (_, value) in enumerate(entries):
        colour = BLUE if row == 0 else SKY
        axes.barh(row, value * unit.per_si, left=begin * unit.per_si, height=0.7, color=colour, linewidth=0)
        begin += value
    axes.set_yticks(range(len(entries)), [figure_style.shortened(name, _LONGEST_NAME) for name, _ in entries])
    axes.set_ylim(max(len(entries), 4) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    quantile = f"{100 * SEEN_LEVEL:g} % quantile of the samples"
    for size, colour, dashes, width, label in (
        (bound.first_order.upper, VERMILION, "-", 1.6, "bound of the first-order model"),
        (bound.found.norm, BLACK, (0, (1.2, 1.2)), 1.0, "largest error of the exact model found"),
        (bound.seen.max, GREEN, (0, (4, 1.5)), 1.0, "largest seen among the samples"),
        (bound.seen.resolved_quantile(SEEN_LEVEL), PURPLE, (0, (6, 1.5, 1.2, 1.5)), 1.0, quantile),
    ):
        if size is not None:
            axes.axvline(size * unit.per_si, color=colour, linestyle=dashes, linewidth=width, label=label)
    axes.axvline(0, color=BLACK, linewidth=0.6)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 2, 5, 10]))
    axes.ticklabel_format(axis="x", style="plain", useOffset=False)
    axes.margins(x=0.03)
    axes.set_xlabel(f"{name} [{unit.name}]")
    axes.set_title(
        f"{name}: bound {bound.first_order.upper * unit.per_si:.5g}, exact model at least "
        f"{bound.found.norm * unit.per_si:.5g}, largest seen {bound.seen.max * unit.per_si:.5g} {unit.name}",
        fontsize=7.5,
    )
