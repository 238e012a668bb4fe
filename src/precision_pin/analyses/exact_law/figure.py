"""The exact laws in pictures and in the report."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.analyses.collect import Results
from precision_pin.analyses.exact_law.exact_law import (
    LAW_COLUMNS,
    LEVELS,
    METHOD_COLUMNS,
    ExactLaw,
    ExactLawResult,
    missing,
)
from precision_pin.analyses.shares import VECTORS
from precision_pin.base.errors import one_line
from precision_pin.render.columns import report_table
from precision_pin.render.draw_distribution import BLUE, SKY, VERMILION, ticks
from precision_pin.render.figure_style import DOUBLE_COLUMN, caption, frame, inline_figure, new_figure, style
from precision_pin.render.html import Child, items, paragraph
from precision_pin.render.tables import milli, quantity_label, symbol, unit
from precision_pin.statistics import Distribution


def content(result: ExactLawResult, results: Results) -> list[Child]:
    """Return exact laws over the sampled histograms, their quantiles, and their distances from samples."""
    laws = result.poses[0].laws
    pictures = []
    for vector in VECTORS:
        known_laws = [law for name, law in laws.items() if name.startswith(vector) and law.law is not None]
        if known_laws:
            pictures.append(
                inline_figure(
                    _overlay(known_laws, [results.analysis.summary.distribution(law.quantity) for law in known_laws]),
                    f"{results.prefix}exact-{vector}",
                    f"Exact law over the sampled {vector} error: {'; '.join(_describe(law) for law in known_laws)}",
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
    caption = f"How exact the laws are, and samples of the first-order model: band at {100 * result.confidence:g} % confidence"
    moments = [law for law in laws.values() if law.std is not None]
    compared_laws = [law for law in laws.values() if law.agreement]
    numbers = report_table("Exact law of the first-order model: moments and quantiles", LAW_COLUMNS, moments)
    parts: list[Child] = [explained, *pictures, numbers, report_table(caption, METHOD_COLUMNS, compared_laws)]
    if absent:
        parts.append(items(absent, "note"))
    return parts


def _describe(law: ExactLaw) -> str:
    quantiles = dict(zip(LEVELS, law.quantiles, strict=True))
    return (
        f"{symbol(law.quantity)} mean {milli(law.mean or 0.0, 5)}, standard deviation {milli(law.std or 0.0, 5)}, "
        f"5 % {milli(quantiles[0.05], 5)}, 95 % {milli(quantiles[0.95], 5)} {unit(law.quantity)}"
    )


# picture ------------------------------------------------------------------------------------


def _overlay(laws: Sequence[ExactLaw], distributions: Sequence[Distribution]) -> Figure:
    """Return densities above and cumulative laws below, a column for each quantity, 174 mm wide."""
    with style():
        chart = new_figure(DOUBLE_COLUMN)
        panels = chart.subplots(2, len(laws), squeeze=False, sharex="col")
        for column, law, distribution in zip(panels.T, laws, distributions, strict=True):
            _draw_method(column[0], column[1], law, distribution)
        for axes in panels[0, :1]:
            axes.set_ylabel(f"density [1/{unit(laws[0].quantity)}]")
        panels[1, 0].set_ylabel("cumulative probability")
        frame(chart, panels.flat, "", "", 88.0, 3)
    return chart


def _draw_method(density_axes: Axes, cumulative_axes: Axes, law: ExactLaw, distribution: Distribution) -> None:
    x, density, cumulative = law.curve
    bars = distribution.histogram()
    if bars is not None:
        density_axes.stairs(
            bars.density / 1e3, 1e3 * bars.edges, fill=True, color=SKY, alpha=0.55, linewidth=0, label="samples"
        )
        density_axes.set_ylim(0, 1.15 * float(bars.density.max()) / 1e3)
    if np.isfinite(density).any():
        density_axes.plot(1e3 * x, density / 1e3, color=VERMILION, label="exact law")
    values = np.linspace(x[0], x[-1], 300)
    cumulative_axes.plot(1e3 * values, distribution.cumulative(values), color=SKY, linewidth=3.2)
    cumulative_axes.plot(1e3 * x, cumulative, color=VERMILION)
    cumulative_axes.set_ylim(0, 1.03)
    cumulative_axes.set_xlabel(quantity_label(law.quantity))
    for axes in (density_axes, cumulative_axes):
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(ticks())
        axes.ticklabel_format(style="plain", useOffset=False)


def figure(result: ExactLawResult, which: int = 0) -> Figure:
    """Return the densities of dx … δz at one of the poses over histograms of the samples, 174 mm wide."""
    entry, provenance = result.poses[which], result.provenance
    lines = (
        caption("exact law of the first-order model", provenance, entry.pose),
        f"N = {result.samples:,}, seed {provenance.seed}, first-order model, statics {provenance.statics}",
    )
    with style():
        chart = new_figure(DOUBLE_COLUMN)
        panels = chart.subplots(2, 3)
        components = [law for law in entry.laws.values() if not law.quantity.endswith("norm")]
        for axes, law in zip(panels.flat, components, strict=True):
            _draw(axes, law)
        frame(chart, panels.flat, "", "\n".join(lines), 100.0, 3)
    return chart


def draw(axes: Axes, result: ExactLawResult, which: int, quantity: str) -> None:
    """Draw the law of a vector's length, or of its first component if the length has no exact law, on given axes."""
    laws = [law for name, law in result.poses[which].laws.items() if name.startswith(quantity)]
    sizes = [law for law in laws if law.quantity.endswith("norm") and law.law is not None]
    candidates = [*sizes, *(law for law in laws if law.law is not None), *laws]
    with style():
        _draw(axes, candidates[0])


def _draw(axes: Axes, law: ExactLaw) -> None:
    axes.set_xlabel(quantity_label(law.quantity))
    if law.law is None or law.agreement is None:
        axes.set_yticks([])
        axes.set_xticks([])
        for line, text in enumerate(textwrap.wrap(one_line(law.reason, 300), 30)):
            axes.text(0.03, 0.88 - 0.12 * line, text, transform=axes.transAxes)
        return
    x, density, _ = law.curve
    edges, counts = law.agreement.edges, law.agreement.counts
    heights = counts / (counts.sum() * np.diff(edges)) / 1e3
    axes.stairs(heights, 1e3 * edges, fill=True, color=SKY, alpha=0.55, linewidth=0, label="samples")
    if np.isfinite(density).any():
        axes.plot(1e3 * x, density / 1e3, color=BLUE, label="exact density")
    axes.set_ylim(0, 1.15 * float(heights.max()))
    for level in (0.00135, 0.99865):
        value = law.quantiles[LEVELS.index(level)]
        axes.axvline(1e3 * value, color=VERMILION, linestyle=(0, (4, 1.5)), label="0.135 % and 99.865 % quantiles")
    axes.set_ylabel(f"density [1/{unit(law.quantity)}]")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(ticks())
    axes.ticklabel_format(style="plain", useOffset=False)
