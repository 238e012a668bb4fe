"""The top of the report: what was asked and what came out."""

from __future__ import annotations

from typing import Final

from precision_pin.display.tables import absolute, quantity_label, resting_on, symbol, unit
from precision_pin.outputs.kit.html import Child, Html, element, joined, paragraph, section, table
from precision_pin.outputs.monte_carlo.table import NOTHING_VARIES
from precision_pin.outputs.report.collect import Results
from precision_pin.outputs.report.numbers import milli_interval, statistic
from precision_pin.statistics import Distribution, SpecificationResult, Verdict, format_share

__all__ = ["verdict"]

_UNASKED = (0.95, 0.9973)
_WORDS: Final[dict[Verdict, str]] = {
    "met": "The specification is met",
    "not met": "The specification is not met",
    "undecided": "Whether the specification is met is undecided: the samples are too few",
    "nothing to judge": f"There is nothing to judge: {NOTHING_VARIES}",
}


def verdict(results: Results) -> Html:
    """Return whether every specification is met; without one, how large the errors are. Then what it rests on."""
    specifications = results.analysis.summary.specifications
    if not specifications:
        still = not any(results.analysis.summary.varying)
        alike = [paragraph(element("strong", "No source makes the error vary: every robot is alike."))] if still else []
        return section("verdict", "Result", *alike, _sizes(results), _resting(results))
    met = sum(result.met for result in specifications)
    if len(specifications) == 1:
        words = _WORDS[specifications[0].verdict]
    else:
        others = [result.verdict for result in specifications if result.verdict in ("undecided", "nothing to judge")]
        counts = [f"{others.count(verdict)} {verdict}" for verdict in dict.fromkeys(others)]
        words = ", ".join([f"{met} of {len(specifications)} specifications are met", *counts])
    good = met == len(specifications)
    headline = paragraph(element("strong", words), ".", class_="verdict met" if good else "verdict failed")
    return section("verdict", "Verdict", headline, _resting(results), _specifications(results), _rule(results))


def _resting(results: Results) -> Html:
    lines = resting_on(results.analysis.assumed, results.analysis.sources)
    return joined([paragraph(element("strong", f"{line[:1].upper()}{line[1:]}.")) for line in lines])


def _specifications(results: Results) -> Html:
    rows: list[list[Child]] = []
    for result in results.analysis.summary.specifications:
        share, low, high = format_share(result.probability, result.interval, result.required)
        rows.append(
            [
                _limit(result),
                f"{100 * result.required:.10g} %",
                f"{share} %",
                f"[{low}, {high}] %",
                element("strong", result.verdict, class_="good" if result.met else "bad"),
            ]
        )
    header = ["limit", "required inside", "inside", f"interval at {_confidence(results)}", "verdict"]
    return table("Specifications", header, rows, words=(4,))


def _limit(result: SpecificationResult) -> str:
    return f"{absolute(result.quantity)} ≤ {1e3 * result.limit:.6g} {unit(result.quantity)}"


def _rule(results: Results) -> Html:
    return paragraph(
        f"“Inside” is the share of {results.analysis.samples:,} sampled robots within the limit. A specification is met when "
        "the lower end of the interval reaches what is required, not met when the upper end does not, and undecided between.",
        class_="note",
    )


def _sizes(results: Results) -> Html:
    analysis = results.analysis
    rows = []
    for distribution in (analysis.position.norm, analysis.attitude.norm):
        cells = [
            cell for level in _UNASKED for cell in (statistic(distribution, level), milli_interval(distribution, level))
        ]
        rows.append([quantity_label(distribution.quantity), *cells])
    header = ["error", *(name for level in _UNASKED for name in (f"{100 * level:g} % stay within", "interval"))]
    return joined(
        [
            paragraph(_sentence(analysis.position.norm), " ", _sentence(analysis.attitude.norm), class_="verdict"),
            table(f"Errors that few robots exceed; intervals at {_confidence(results)}", header, rows),
            paragraph('No limit was asked about: --spec names one, such as --spec "0.5 mm @ 99.73 %".'),
        ]
    )


def _sentence(distribution: Distribution) -> Html:
    name = symbol(distribution.quantity)
    what = "a position" if distribution.quantity.startswith("position") else "an attitude"
    level = next((level for level in reversed(_UNASKED) if distribution.quantile(level) is not None), None)
    if level is None:
        return joined([f"The samples are too few for the far quantiles of the error {name}."])
    size = element("strong", f"{statistic(distribution, level)} {unit(distribution.quantity)}")
    return joined(
        [
            f"{100 * level:g} % of the robots have {what} error ",
            element("span", name, class_="symbol"),
            " of at most ",
            size,
            ".",
        ]
    )


def _confidence(results: Results) -> str:
    return f"{100 * results.analysis.summary.confidence:g} % confidence"
