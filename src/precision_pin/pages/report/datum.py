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
)


def datum_effect(results: Results) -> Child:
    """Return a line with both sizes of the error, and a figure of the parts of the variance; nothing in base axes."""
    record = results.analysis.datum
    if record is None or record.effect is None:
        return joined([])
    (line,) = datum_lines(results.analysis)
    percents = _percents(record.effect)
    label = "; ".join(
        f"{symbol}: " + ", ".join(f"{name} {value:.3g} %" for (_, name, _), value in zip(_PARTS, column, strict=False))
        for symbol, column in zip("dδ", percents.T, strict=True)
    )
    caption = (
        "Parts of the variance of d and δ, to first order, in % of the variance in base axes. What is common to both errors "
        f"of the robot cancels; the last bar is what remains against datum {record.name}."
    )
    chart = inline_figure(_figure(percents), f"{results.prefix}datum", f"Variance by part: {label}", caption)
    return joined([paragraph(f"{line[0].upper()}{line[1:]}."), chart])


def _percents(effect: DatumEffect) -> np.ndarray:
    """Return each part of the variances, and their sums, ``(6, 2)``, in % of base axes, or of the sum if there is none."""
    parts = np.array([getattr(effect, key) for key, _, _ in _PARTS] + [effect.total])
    scale = np.where(parts[0] > 0, parts[0], parts[-1])
    return 100 * parts / np.where(scale > 0, scale, 1.0)


def _figure(percents: np.ndarray) -> Figure:
    names = [*(name for _, name, _ in _PARTS), "against the datum"]
    colours = [*(colour for _, _, colour in _PARTS), BLACK]
    rows = np.arange(len(names))
    with style():
        figure = new_figure(DOUBLE_COLUMN)
        panels = figure.subplots(1, 2, sharey=True)
        for axes, symbol, values in zip(panels, "dδ", percents.T, strict=True):
            starts = np.array([0.0, *np.cumsum(values[:-2]), 0.0])
            axes.barh(rows, values, left=starts, height=0.7, color=colours, linewidth=0)
            for row, value in enumerate(values):
                text = f"{value:{'+' if 0 < row < len(rows) - 1 else ''}.3g}"
                axes.text(1.02, row, text, transform=axes.get_yaxis_transform(), va="center", fontsize=9)
            axes.axvline(0, color=BLACK, linewidth=0.6)
            axes.set_xlabel(f"variance of {symbol} [% of base axes]", fontsize=9)
            axes.tick_params(labelsize=9)
        panels[0].set_yticks(rows, names)
        panels[0].set_ylim(len(rows) - 0.5, -0.5)
        set_height(figure, 46)
    return figure
