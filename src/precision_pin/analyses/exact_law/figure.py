"""Exact laws as a picture."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.analyses.exact_law.exact_law_result import LEVELS, ExactLaw, ExactLawResult
from precision_pin.base.text_escape import one_line
from precision_pin.render.draw_distribution import BLUE, SKY, VERMILION, ticks
from precision_pin.render.figure_style import DOUBLE_COLUMN, LINE_HEIGHT, caption, end_figure, new_figure, style
from precision_pin.render.tables import quantity_label, unit


def figure(result: ExactLawResult, which: int = 0) -> Figure:
    """Return the densities of dx … δz at one of the poses over histograms of the samples, 174 mm wide."""
    entry, provenance = result.poses[which], result.provenance
    lines = [
        *caption("exact law of the first-order model", provenance, entry.pose),
        f"N = {result.samples:,}, seed {provenance.seed}, first-order model, statics {provenance.statics}",
    ]
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        panels = drawn.subplots(2, 3)
        components = [law for law in entry.laws.values() if not law.quantity.endswith("norm")]
        for axes, law in zip(panels.flat, components, strict=True):
            _draw(axes, law)
        end_figure(drawn, panels.flat, lines, 100 + LINE_HEIGHT * (len(lines) + 1), 3)
    return drawn


def draw(axes: Axes, result: ExactLawResult, which: int, quantity: str) -> None:
    """Draw the law of a vector's size, or of its first component where the size has no exact law, on given axes."""
    laws = [law for name, law in result.poses[which].laws.items() if name.startswith(quantity)]
    sizes = [law for law in laws if law.quantity.endswith("norm") and law.law is not None]
    known = [*sizes, *(law for law in laws if law.law is not None), *laws]
    with style():
        _draw(axes, known[0])


def _draw(axes: Axes, law: ExactLaw) -> None:
    axes.set_xlabel(quantity_label(law.quantity))
    if law.law is None or law.agreement is None:
        axes.set_yticks([])
        axes.set_xticks([])
        for line, words in enumerate(textwrap.wrap(one_line(law.reason, 300), 30)):
            axes.text(0.03, 0.88 - 0.12 * line, words, transform=axes.transAxes)
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
