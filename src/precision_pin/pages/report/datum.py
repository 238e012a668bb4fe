"""Errors against a datum and in base axes on the first page of the report: what cancelled, and what came on top."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from precision_pin.analyses.collect import Results
from precision_pin.model.datum import DatumEffect
from precision_pin.render.draw_distribution import BLACK, GREEN, PURPLE, SKY, VERMILION
from precision_pin.render.figure_style import DOUBLE_COLUMN, inline_figure, new_figure, set_height, style
from precision_pin.render.html import Child, joined, paragraph
from precision_pin.sampling.table import datum_lines

_PARTS: Final = (
    ("robot", "robot at the task", SKY),
    ("procedure", "robot at the procedure", SKY),
    ("common", "common to both", GREEN),
    ("visits", "new draws at the visits", PURPLE),
    ("noise", "noise of the procedure", VERMILION),
    ("total", "against the datum", BLACK),
)


def datum_effect(results: Results) -> Child:
    """Return a line with both sizes of the error, and a figure of the parts of the variance; nothing in base axes."""
    record = results.analysis.datum
    if record is None:
        return joined([])
    (line,) = datum_lines(results.analysis)
    text = paragraph(f"{line[0].upper()}{line[1:]}.")
    if record.effect is None:
        return text
    caption = (
        "Parts of the variance of d and δ, to first order, in % of the variance in base axes. What is common to both errors "
        f"of the robot cancels; the last bar is what remains against datum {record.name}."
    )
    chart = inline_figure(_figure(record.effect), f"{results.prefix}datum", line, caption)
    return joined([text, chart])


def _figure(effect: DatumEffect) -> Figure:
    """Return the parts of the variances one after another, in % of base axes, or of the sum if nothing varies there."""
    keys, names, colours = zip(*_PARTS, strict=True)
    parts, rows = np.array([getattr(effect, key) for key in keys]), range(len(keys))
    percents = 100 * parts / np.maximum(np.where(parts[0] > 0, parts[0], parts[-1]), 1e-300)
    with style():
        figure = new_figure(DOUBLE_COLUMN)
        panels = figure.subplots(1, 2, sharey=True)
        for axes, symbol, values in zip(panels, "dδ", percents.T, strict=True):
            starts = np.array([0.0, *np.cumsum(values[:-2]), 0.0])
            axes.barh(rows, values, left=starts, height=0.7, color=colours, linewidth=0)
            for row, value in enumerate(values):
                text = f"{value:+.3g}" if 0 < row < rows[-1] else f"{value:.3g}"
                axes.text(1.02, row, text, transform=axes.get_yaxis_transform(), va="center", fontsize=9)
            axes.axvline(0, color=BLACK, linewidth=0.6)
            axes.set_xlabel(f"variance of {symbol} [% of base axes]", fontsize=9)
            axes.tick_params(labelsize=9)
        panels[0].set_yticks(rows, names)
        panels[0].set_ylim(len(rows) - 0.5, -0.5)
        set_height(figure, 46)
    return figure
