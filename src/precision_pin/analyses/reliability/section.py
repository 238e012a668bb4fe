"""Report section: probability of exceeding the limits."""

from __future__ import annotations

from precision_pin.analyses.causes import sum_by_cause
from precision_pin.analyses.collect import Results
from precision_pin.analyses.monte_carlo.table import demanded
from precision_pin.analyses.reliability.estimates import in_words
from precision_pin.analyses.reliability.figure import figure
from precision_pin.analyses.reliability.reliability_result import ReliabilityResult, SpecificationReliability
from precision_pin.render.html import Child, Html, items, paragraph, table
from precision_pin.render.svg import figure as inline_figure
from precision_pin.render.tables import percent

_LISTED = 12
_NOTHING = 5e-5


def content(result: ReliabilityResult, results: Results) -> list[Child]:
    """Return the verdicts, the estimate of each method, and the draws that matter most for failure."""
    entries = result.poses[0].specifications
    chart = inline_figure(
        figure(result, 0, [_important(entry, results) for entry in entries]),
        f"{results.prefix}reliability",
        f"Probabilities of failure by method: {'; '.join(map(_described, entries))}",
        "Probability of failure by each method with its interval, and the draws that make the likeliest failure.",
    )
    verdicts = table(
        f"Probability of exceeding each limit; intervals at {100 * result.confidence:g} % confidence",
        ["specification", "probability of failure", "interval", "by", "verdict"],
        [[demanded(entry.specification), *entry.cells] for entry in entries],
        words=(3, 4),
    )
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


def _described(entry: SpecificationReliability) -> str:
    return f"{demanded(entry.specification)} {in_words(entry.best.interval)}, {entry.verdict}"


def _methods(entry: SpecificationReliability) -> Html:
    rows = [
        [one.method, f"{one.probability:.3g}", in_words(one.interval), f"{one.evaluations:,}", one.note]
        for one in entry.estimates
    ]
    header = ["method", "probability of failure", "interval", "evaluations", ""]
    return table(f"Methods, {demanded(entry.specification)}", header, rows, words=(4,))


def _important(entry: SpecificationReliability, results: Results) -> list[tuple[str, float]]:
    return sum_by_cause(results.causes, entry.failures[0].importance) if entry.failures else []


def _importance(entry: SpecificationReliability, results: Results) -> Html:
    first = entry.failures[0]
    rows = [[text, percent(share)] for text, share in _important(entry, results)[:_LISTED] if share >= _NOTHING]
    found = f"β = {first.beta:.5g}, Φ(-β) = {first.probability:.3g}"
    caption = f"Likeliest failure, {demanded(entry.specification)}: {found}"
    return table(caption, ["cause", "importance %"], rows)
