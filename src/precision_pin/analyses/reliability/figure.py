"""Figure and report section of the reliability."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from precision_pin.analyses.collect import Results, sum_by_cause
from precision_pin.analyses.reliability.estimates import in_words
from precision_pin.analyses.reliability.reliability import METHOD_COLUMNS, ReliabilityResult, SpecificationReliability
from precision_pin.base.errors import InputError
from precision_pin.render import figure_style
from precision_pin.render.columns import report_table
from precision_pin.render.draw_distribution import BLACK, BLUE, GREEN, PURPLE, SKY, VERMILION
from precision_pin.render.html import Child, Html, items, paragraph, table
from precision_pin.render.tables import bounded, percent
from precision_pin.sampling.table import demanded

LISTED: Final = 6
"""Maximum number of draws in the figure."""
# maximum number of characters of a draw's name
_LONGEST_NAME: Final = 38


def figure(
    result: ReliabilityResult, which: int = 0, importance: Sequence[Sequence[tuple[str, float]]] | None = None
) -> Figure:
    """Return each specification's probabilities of failure by method, and the importance factors, 174 mm wide."""
    entry, provenance = result.poses[which], result.provenance
    lines = [
        figure_style.caption("reliability", provenance, entry.pose),
        f"N = {result.samples:,}, seed {provenance.seed}, exact model, statics {provenance.statics}; "
        f"bars: intervals at {100 * result.confidence:g} % confidence",
    ]
    with figure_style.style():
        drawing = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        rows = len(entry.specifications)
        panels = drawing.subplots(rows, 2, squeeze=False)
        for k, specification in enumerate(entry.specifications):
            _draw_methods(panels[k, 0], specification)
            importances = list(specification.failures[0].importance.items()) if specification.failures else []
            _draw_importance(panels[k, 1], specification, importances if importance is None else importance[k])
        figure_style.frame(drawing, (), "\n".join(lines), "", 34.0 * rows + figure_style.LINE_HEIGHT)
    return drawing


def draw(axes: Axes, result: ReliabilityResult, which: int, quantity: str) -> None:
    """Draw the methods' probabilities of failure of the first specification of a vector on given axes."""
    entries = result.poses[which].specifications
    matches = [entry for entry in entries if entry.specification.quantity.startswith(quantity)]
    if not matches:
        raise InputError(f"no specification limits the {quantity}")
    with figure_style.style():
        _draw_methods(axes, matches[0])


def _draw_methods(axes: Axes, entry: SpecificationReliability) -> None:
    estimates = [estimate for estimate in entry.estimates if estimate.interval[1] < 1 or estimate.probability]
    positive = [value for estimate in estimates for value in (*estimate.interval, estimate.probability) if value > 0]
    positive += [*(entry.form.range or ()), 1 - entry.specification.required]
    lowest = 10.0 ** math.floor(math.log10(max(min(positive), 1e-15)) - 0.3)
    highest = 10.0 ** math.ceil(math.log10(max(positive)))
    for row, estimate in enumerate(estimates):
        colour = BLUE if estimate.resolved else SKY
        low, high = (max(bound, lowest) for bound in estimate.interval)
        axes.plot([low, high], [row, row], color=colour, linewidth=2.4, solid_capstyle="butt")
        if estimate.probability:
            axes.plot([estimate.probability], [row], "o", color=colour, markersize=4)
    names = [estimate.method for estimate in estimates]
    if entry.form.range is not None:
        axes.plot(entry.form.range, [len(estimates)] * 2, color=PURPLE, linewidth=2.4)
        axes.plot([entry.form.range[0]], [len(estimates)], "s", color=PURPLE, markersize=4)
        names.append("FORM")
    colour = VERMILION if entry.verdict == "not met" else GREEN if entry.met else BLACK
    axes.axvline(1 - entry.specification.required, color=colour, linestyle=(0, (6, 1.5, 1.2, 1.5)))
    axes.set_xscale("log")
    axes.set_xlim(lowest, highest)
    decades = round(math.log10(highest / lowest))
    ticks = [highest * 10.0**-k for k in range(0, decades + 1, max(1, math.ceil(decades / 5)))]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0e}" if value < 1e-3 else f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(max(len(names), 3) - 0.4, -0.6)
    axes.set_xlabel("probability of failure (line: allowed)")
    spec = entry.specification
    axes.set_title(f"{bounded(spec.quantity, spec.limit, ' within ')}: {entry.verdict}", fontsize=7.5)


def _draw_importance(axes: Axes, entry: SpecificationReliability, importance: Sequence[tuple[str, float]]) -> None:
    axes.set_xlabel("importance at the design point [%]")
    if not entry.failures:
        axes.text(0.03, 0.8, "no design point found", transform=axes.transAxes)
        axes.set_yticks([])
        axes.set_xticks([])
        return
    shares = importance[:LISTED]
    axes.barh(range(len(shares)), [100 * share for _, share in shares], height=0.7, color=SKY, linewidth=0)
    axes.set_yticks(range(len(shares)), [figure_style.shortened(name, _LONGEST_NAME) for name, _ in shares])
    axes.set_ylim(max(len(shares), 3) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.set_title(f"β = {entry.failures[0].beta:.4g}", fontsize=7.5)


# maximum number of causes in the report's table
_LISTED = 12
# importance below which a cause is omitted
_NOTHING = 5e-5


def content(result: ReliabilityResult, results: Results) -> list[Child]:
    """Return the verdicts, the estimate of each method, and the draws that matter most for failure."""
    entries = result.poses[0].specifications
    chart = figure_style.inline_figure(
        figure(result, 0, [_shares_by_cause(entry, results) for entry in entries]),
        f"{results.prefix}reliability",
        f"Probabilities of failure by method: {'; '.join(map(_describe, entries))}",
        "Probability of failure by each method with its interval, and the draws that make the likeliest failure.",
    )
    caption = f"Probability of exceeding each limit; intervals at {100 * result.confidence:g} % confidence"
    verdicts = report_table(caption, result.COLUMNS, entries)
    lines = [
        f"{demanded(entry.specification)}: {line}"
        for entry in entries
        for line in (*([entry.reason] if entry.reason else []), *entry.comments)
    ]
    explained = paragraph(
        "Plain sampling, FORM, importance sampling and subset simulation answer the same question on the exact model: "
        f"{result.samples:,} plain samples, seed {result.provenance.seed}.",
        class_="note",
    )
    parts: list[Child] = [explained, chart, verdicts, *(_methods(entry) for entry in entries)]
    parts += [_importance(entry, results) for entry in entries if entry.failures]
    return [*parts, items(lines, "note")] if lines else parts


def _describe(entry: SpecificationReliability) -> str:
    return f"{demanded(entry.specification)} {in_words(entry.best.interval)}, {entry.verdict}"


def _methods(entry: SpecificationReliability) -> Html:
    return report_table(f"Methods, {demanded(entry.specification)}", METHOD_COLUMNS, entry.estimates)


def _shares_by_cause(entry: SpecificationReliability, results: Results) -> list[tuple[str, float]]:
    return sum_by_cause(results.causes, entry.failures[0].importance) if entry.failures else []


def _importance(entry: SpecificationReliability, results: Results) -> Html:
    point = entry.failures[0]
    rows = [[text, percent(share)] for text, share in _shares_by_cause(entry, results)[:_LISTED] if share >= _NOTHING]
    facts = f"β = {point.beta:.5g}, Φ(-β) = {point.probability:.3g}"
    caption = f"Likeliest failure, {demanded(entry.specification)}: {facts}"
    return table(caption, ["cause", "importance %"], rows)
