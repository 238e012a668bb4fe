"""The exact law of the first-order model against the samples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.analyses.budget.budget_result import VECTORS
from precision_pin.analyses.collect import Results
from precision_pin.analyses.exact_law.exact_law_result import LEVELS, LEVELS_SHOWN, ExactLaw, ExactLawResult, missing
from precision_pin.analyses.exact_law.table import method_rows
from precision_pin.analyses.report_cells import MISSING
from precision_pin.render.draw_distribution import SKY, VERMILION, ticks
from precision_pin.render.figure_style import DOUBLE_COLUMN, end_figure, new_figure, style
from precision_pin.render.html import Child, Html, items, paragraph, table
from precision_pin.render.svg import figure
from precision_pin.render.tables import milli, quantity_label, symbol, unit
from precision_pin.statistics import Distribution

_HEIGHT: Final = 92.0


def content(result: ExactLawResult, results: Results) -> list[Child]:
    """Return exact laws over the sampled histograms, their quantiles, and how far samples lie from them."""
    laws = result.poses[0].laws
    pictures = []
    for vector in VECTORS:
        known = [law for name, law in laws.items() if name.startswith(vector) and law.law is not None]
        if known:
            pictures.append(
                figure(
                    _overlay(known, [results.analysis.summary.distribution(law.quantity) for law in known]),
                    f"{results.prefix}exact-{vector}",
                    f"Exact law over the sampled {vector} error: {'; '.join(_described(law) for law in known)}",
                    f"Exact law of the first-order model over the samples ({results.analysis.model} model): {vector} error.",
                )
            )
    absent = [*missing(laws.values()), *result.poses[0].warnings]
    explained = paragraph(
        "The law of the first-order model follows from the characteristic functions of the draws, without sampling, tails "
        f"included. The pictures lay it over the {results.analysis.samples:,} samples of the {results.analysis.model} model "
        "above: where the two differ, the arm is not linear over its tolerances. The last table compares it with "
        f"{result.samples:,} samples of the first-order model itself.",
        class_="note",
    )
    parts: list[Child] = [explained, *pictures, _quantiles(laws.values()), _methods(result)]
    if absent:
        parts.append(items(absent, "note"))
    return parts


def _described(law: ExactLaw) -> str:
    quantiles = dict(zip(LEVELS, law.quantiles, strict=True))
    return (
        f"{symbol(law.quantity)} mean {milli(law.mean or 0.0, 5)}, standard deviation {milli(law.std or 0.0, 5)}, "
        f"5 % {milli(quantiles[0.05], 5)}, 95 % {milli(quantiles[0.95], 5)} {unit(law.quantity)}"
    )


def _quantiles(laws: Iterable[ExactLaw]) -> Html:
    header = ["", "mean", "std", *(f"{100 * level:.5g} %" for level in LEVELS_SHOWN)]
    rows = []
    for law in laws:
        if law.mean is None or law.std is None:
            continue
        quantiles = law.shown_quantiles(6)
        cells = [milli(*quantiles[level]) if quantiles else MISSING for level in LEVELS_SHOWN]
        rows.append([quantity_label(law.quantity), milli(law.mean), milli(law.std), *cells])
    return table("Exact law of the first-order model: moments and quantiles", header, rows)


def _methods(result: ExactLawResult) -> Html:
    header = ["", "method", "draws", "error bound of F", "Kolmogorov distance", "band", "samples"]
    caption = f"How exact the laws are, and samples of the first-order model: band at {100 * result.confidence:g} % confidence"
    return table(caption, header, method_rows(result.poses[0]), words=(1, 6))


# picture ------------------------------------------------------------------------------------


def _overlay(laws: Sequence[ExactLaw], sampled: Sequence[Distribution]) -> Figure:
    """Return densities above and cumulative laws below, a column for each quantity, 174 mm wide."""
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        panels = drawn.subplots(2, len(laws), squeeze=False, sharex="col")
        for column, law, distribution in zip(panels.T, laws, sampled, strict=True):
            _draw(column[0], column[1], law, distribution)
        for axes in panels[0, :1]:
            axes.set_ylabel(f"density [1/{unit(laws[0].quantity)}]")
        panels[1, 0].set_ylabel("cumulative probability")
        end_figure(drawn, panels.flat, (), _HEIGHT, 3)
    return drawn


def _draw(above: Axes, below: Axes, law: ExactLaw, distribution: Distribution) -> None:
    x, density, cumulative = law.curve
    bars = distribution.histogram()
    if bars is not None:
        above.stairs(
            bars.density / 1e3, 1e3 * bars.edges, fill=True, color=SKY, alpha=0.55, linewidth=0, label="samples"
        )
        above.set_ylim(0, 1.15 * float(bars.density.max()) / 1e3)
    if np.isfinite(density).any():
        above.plot(1e3 * x, density / 1e3, color=VERMILION, label="exact law")
    values = np.linspace(x[0], x[-1], 300)
    below.plot(1e3 * values, distribution.cumulative(values), color=SKY, linewidth=3.2)
    below.plot(1e3 * x, cumulative, color=VERMILION)
    below.set_ylim(0, 1.03)
    below.set_xlabel(quantity_label(law.quantity))
    for axes in (above, below):
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(ticks())
        axes.ticklabel_format(style="plain", useOffset=False)
