"""Report sections of the sampled distributions and, at the top of the report, of specifications and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from precision_pin.analyses.collect import Results, bracketed, milli_interval, statistic
from precision_pin.render.columns import report_table
from precision_pin.render.figure_style import inline_figure
from precision_pin.render.html import Child, Html, element, joined, paragraph, section, table
from precision_pin.render.tables import MISSING, milli, quantity_label, shown, symbol, unit
from precision_pin.sampling import figures
from precision_pin.sampling.result import limit_text, specification_columns
from precision_pin.sampling.table import NOTHING_VARIES, tolerance_bounds
from precision_pin.statistics import Distribution, SpecificationResult, VectorDistribution, Verdict, format_share
from precision_pin.statistics.distribution import COMPONENT_LEVELS, CONTENTS

_LEVELS: Final = (0.95, 0.9973)
"""Quantiles of the head: the usual 95 %, and the ±3σ share of a normal law."""
_SENTENCES: Final[dict[Verdict, str]] = {
    "met": "The specification is met",
    "not met": "The specification is not met",
    "not judged": "The specification is not judged",
    "undecided": "Whether the specification is met is undecided: the samples are too few",
    "nothing to judge": f"There is nothing to judge: {NOTHING_VARIES}",
}


def verdict(results: Results, missed: Sequence[str] = ()) -> Html:
    """Return the verdict and the size of the errors."""
    judged = results.analysis.summary.specifications
    parts: list[Child] = []
    if judged:
        met = sum(result.met for result in judged)
        elsewhere = f", but not {' and not '.join(missed)}" if missed and met == len(judged) else ""
        headline = element("strong", describe_verdict(judged), elsewhere)
        text: list[Child] = [headline, "."]
        if len(judged) == 1 and judged[0].verdict not in ("nothing to judge", "not judged"):
            text.append(f" {_share_text(judged[0])}")
        parts.append(paragraph(*text, class_="verdict met" if met == len(judged) and not missed else "verdict failed"))
    else:
        if not any(results.analysis.summary.varying):
            parts.append(
                paragraph(element("strong", "No source makes the error vary: all robots have the same error."))
            )
        norms = (results.analysis.position.norm, results.analysis.attitude.norm)
        parts.append(paragraph(_sentence(norms[0]), " ", _sentence(norms[1]), class_="verdict"))
    return joined([*parts, _sizes(results)])


def describe_verdict(judged: Sequence[SpecificationResult]) -> str:
    """Return which specifications are met, as a phrase."""
    if len(judged) == 1:
        grounds = judged[0].grounds
        why = f": {grounds.why}" if grounds.not_judged else ""
        return f"{_SENTENCES[judged[0].verdict]}{grounds.taken if judged[0].met else ''}{why}"
    others = [result.verdict for result in judged if result.verdict not in ("met", "not met")]
    counts = [f"{others.count(verdict)} {verdict}" for verdict in dict.fromkeys(others)]
    met, grounds = sum(result.met for result in judged), judged[0].grounds
    why = f": {grounds.why}" if grounds.not_judged else ""
    return ", ".join([f"{met} of {len(judged)} specifications are met{grounds.taken if met else ''}", *counts]) + why


def specifications(results: Results) -> Html:
    """Return each specification with the fraction inside and its interval, or an example of the option if none is given."""
    judged = results.analysis.summary.specifications
    if not judged:
        return paragraph('No limit was given: --spec sets one, such as --spec "0.5 mm @ 99.73 %".', class_="note")
    return report_table("Specifications", specification_columns(results.analysis.summary.confidence), judged)


def _share_text(result: SpecificationResult) -> str:
    share, low, high = format_share(result.probability, result.interval, result.required)
    return (
        f"{share} % of the robots stay within {limit_text(result)} (interval [{low}, {high}] %); "
        f"{100 * result.required:.10g} % are required."
    )


def _sizes(results: Results) -> Html:
    analysis = results.analysis
    rows = [
        [quantity_label(norm.quantity), *(_quantile(norm, level) for level in _LEVELS)]
        for norm in (analysis.position.norm, analysis.attitude.norm)
    ]
    header = ["error", *(f"{100 * level:g} % within" for level in _LEVELS)]
    return table(
        f"Errors that few robots exceed, {100 * results.analysis.summary.confidence:g} % intervals", header, rows
    )


def _sentence(distribution: Distribution) -> Html:
    quantity = symbol(distribution.quantity)
    error = "a position" if distribution.quantity.startswith("position") else "an attitude"
    level = next((level for level in reversed(_LEVELS) if distribution.resolved_quantile(level) is not None), None)
    if level is None:
        return joined([f"The samples are too few for the far quantiles of the error {quantity}."])
    size = element("strong", f"{statistic(distribution, level)} {unit(distribution.quantity)}")
    name = element("span", quantity, class_="symbol")
    return joined([f"{100 * level:g} % of the robots have {error} error ", name, " of at most ", size, "."])


_EXTREMES: Final = (("min", "smallest seen"), ("max", "largest seen"))


def distributions(results: Results) -> Html:
    """Return the figures of |d|, |δ| and the six components with a table of their numbers."""
    analysis = results.analysis
    drawings = figures.figures_of(analysis.summary, analysis.seed, analysis.arm)
    pictures = element(
        "div",
        inline_figure(
            drawings["position"],
            f"{results.prefix}position",
            f"Density and cumulative distribution of the position error: {_described(analysis.position.norm)}",
            "Position error |d|: density above, cumulative distribution below.",
        ),
        inline_figure(
            drawings["attitude"],
            f"{results.prefix}attitude",
            f"Density and cumulative distribution of the attitude error: {_described(analysis.attitude.norm)}",
            "Attitude error |δ|: density above, cumulative distribution below.",
        ),
        class_="pair",
    )
    parts = [part for vector in (analysis.position, analysis.attitude) for part in (vector.x, vector.y, vector.z)]
    components = inline_figure(
        drawings["components"],
        f"{results.prefix}components",
        f"Densities of the six components: {'; '.join(_short(part) for part in parts)}",
        "The six components of the error.",
    )
    tables = [_table(results, vector) for vector in (analysis.position, analysis.attitude)]
    return section(
        f"{results.prefix}distributions", "Error distributions", pictures, components, *tables, _notes(results)
    )


def _described(norm: Distribution) -> str:
    name = norm.quantity
    return (
        f"{symbol(name)} has mean {statistic(norm, 'mean')} {unit(name)}, standard deviation {statistic(norm, 'std')}, "
        f"95 % quantile {statistic(norm, 0.95)}, 99.73 % quantile {statistic(norm, 0.9973)}, "
        f"and lies between {milli(norm.min, 5)} and {milli(norm.max, 5)} {unit(name)} in {norm.samples:,} samples"
    )


def _short(part: Distribution) -> str:
    name = part.quantity
    return f"{symbol(name)} mean {statistic(part, 'mean')}, standard deviation {statistic(part, 'std')} {unit(name)}"


def _table(results: Results, vector: VectorDistribution) -> Html:
    parts = (vector.norm, vector.x, vector.y, vector.z)
    what, _, _ = vector.norm.quantity.partition(".")
    rows: list[list[Child]] = [
        ["mean", *(_with_interval(statistic(part, "mean"), _moment(part.mean_interval())) for part in parts)],
        [
            "standard deviation",
            *(_with_interval(statistic(part, "std"), _moment(part.std_interval())) for part in parts),
        ],
    ]
    rows += [
        [f"{100 * level:.4g} %", *(_quantile(part, level) if level in part.levels else "" for part in parts)]
        for level in COMPONENT_LEVELS
    ]
    rows += [
        [f"bounds of {100 * content:.4g} % of robots", *(shown(tolerance_bounds(part, content)) for part in parts)]
        for content in CONTENTS
    ]
    rows += [[words, *(statistic(part, which) for part in parts)] for which, words in _EXTREMES]
    header = [f"[{unit(what)}]", *(symbol(part.quantity) for part in parts)]
    confidence = f"{100 * results.analysis.summary.confidence:g} %"
    return table(f"Numbers of the {what} error, with intervals at {confidence} confidence", header, rows)


def _quantile(part: Distribution, level: float) -> Child:
    return _with_interval(statistic(part, level), milli_interval(part, level))


def _moment(interval: tuple[float, float] | None) -> str:
    return MISSING if interval is None else bracketed(*interval)


def _with_interval(value: str, interval: str) -> Child:
    return value if MISSING in (value, interval) else joined([value, " ", element("small", interval)])


def _notes(results: Results) -> Html:
    analysis = results.analysis
    return paragraph(
        f"{analysis.samples:,} sampled robots, seed {analysis.seed}, {analysis.model} model. The smallest and largest seen "
        "are no bounds. Tolerance bounds hold at least that share of all robots, with the confidence stated; of a norm they are "
        "upper ones.",
        class_="note",
    )
