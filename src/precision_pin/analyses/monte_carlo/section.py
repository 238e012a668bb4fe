"""The sampled distributions: pictures and numbers."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.collect import Results
from precision_pin.analyses.monte_carlo.table import tolerance_bounds
from precision_pin.analyses.report_cells import MISSING, bracketed, milli_interval, shown, statistic
from precision_pin.render.html import Child, Html, element, joined, paragraph, section, table
from precision_pin.render.svg import figure
from precision_pin.render.tables import milli, symbol, unit
from precision_pin.sampling import figures
from precision_pin.statistics import Distribution, VectorDistribution
from precision_pin.statistics.distribution import COMPONENT_LEVELS, CONTENTS

_EXTREMES: Final = (("min", "smallest seen"), ("max", "largest seen"))


def distributions(results: Results) -> Html:
    """Return the figures of |d|, |δ| and the six components with a table of their numbers."""
    analysis = results.analysis
    drawn = figures.figures_of(analysis.summary, analysis.seed, analysis.arm)
    pictures = element(
        "div",
        figure(
            drawn["position"],
            f"{results.prefix}position",
            f"Density and cumulative distribution of the position error: {_described(analysis.position.norm)}",
            "Position error |d|: density above, cumulative distribution below.",
        ),
        figure(
            drawn["attitude"],
            f"{results.prefix}attitude",
            f"Density and cumulative distribution of the attitude error: {_described(analysis.attitude.norm)}",
            "Attitude error |δ|: density above, cumulative distribution below.",
        ),
        class_="pair",
    )
    parts = [part for vector in (analysis.position, analysis.attitude) for part in (vector.x, vector.y, vector.z)]
    components = figure(
        drawn["components"],
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
    for level in COMPONENT_LEVELS:
        cells = [
            _with_interval(statistic(part, level), milli_interval(part, level)) if level in part.levels else ""
            for part in parts
        ]
        rows.append([f"{100 * level:.4g} %", *cells])
    rows += [
        [f"bounds of {100 * content:.4g} % of robots", *(shown(tolerance_bounds(part, content)) for part in parts)]
        for content in CONTENTS
    ]
    rows += [[words, *(statistic(part, which) for part in parts)] for which, words in _EXTREMES]
    header = [f"[{unit(what)}]", *(symbol(part.quantity) for part in parts)]
    confidence = f"{100 * results.analysis.summary.confidence:g} %"
    return table(f"Numbers of the {what} error, with intervals at {confidence} confidence", header, rows)


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
