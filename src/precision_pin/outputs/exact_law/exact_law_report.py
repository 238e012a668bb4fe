"""Exact laws as text for a terminal and as a picture."""

from __future__ import annotations

import math
import textwrap
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.analyses.exact_law.exact_law import LEVELS, ExactLaw, ExactLawResult, PoseLaws
from precision_pin.analyses.exact_law.exact_law_result import bound_text
from precision_pin.display.tables import ROUNDING, quantity_label, symbol, unit
from precision_pin.outputs.kit.draw_distribution import BLUE, SKY, VERMILION, ticks
from precision_pin.outputs.kit.figure_style import (
    DOUBLE_COLUMN,
    LINE_HEIGHT,
    caption,
    labelled,
    legend_below,
    new_figure,
    set_height,
    style,
)
from precision_pin.outputs.monte_carlo.table import aligned, subject
from precision_pin.visible import one_line

__all__ = ["figure", "method_rows", "table"]

_METHOD_HEADER: Final = ["", "method", "draws", "error of F", "distance", "band", "samples"]
_SHOWN: Final = (0.00135, 0.05, 0.5, 0.95, 0.9973, 0.99865)


def table(result: ExactLawResult) -> str:
    """Return mean, spread and quantiles of every component, in mm and mrad, how exact they are and how they compare."""
    heading = result.heading
    blocks = []
    for entry in result.poses:
        methods = method_rows(entry)
        blocks.append(
            "\n".join(
                [
                    subject(heading, entry.pose),
                    f"exact law of the first-order model, statics {heading.statics}; errors in base axes",
                    "",
                    *aligned(_quantile_rows(entry)),
                    "",
                    *aligned([_METHOD_HEADER, *methods] if methods else []),
                    *_missing(entry),
                    *map(one_line, entry.warnings),
                ]
            )
        )
    blocks.append(
        f"compared with {result.samples:,} samples of the same model, seed {heading.seed}: the Kolmogorov distance stays "
        f"below the band at {100 * result.confidence:g} % confidence"
    )
    return "\n\n".join(blocks)


def figure(result: ExactLawResult, which: int = 0) -> Figure:
    """Return the densities of dx … δz at one of the poses over histograms of the samples, 174 mm wide.

    Parameters
    ----------
    result
        What is drawn.
    which
        Which of its poses, 0-based.
    """
    entry, heading = result.poses[which], result.heading
    lines = [
        *caption("exact law of the first-order model", heading, entry.pose),
        f"N = {result.samples:,}, seed {heading.seed}, first-order model, statics {heading.statics}",
    ]
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        panels = drawn.subplots(2, 3)
        components = [law for law in entry.laws.values() if not law.quantity.endswith("norm")]
        for axes, law in zip(panels.flat, components, strict=True):
            _draw(axes, law)
        legend_below(drawn, labelled(panels.flat), 3, lines)
        set_height(drawn, 100 + LINE_HEIGHT * (len(lines) + 1))
    return drawn


def _quantile_rows(entry: PoseLaws) -> list[list[str]]:
    rows = [["", "", "mean", "std", *(f"{100 * level:g} %" for level in _SHOWN)]]
    for law in entry.laws.values():
        if law.mean is None or law.std is None:
            continue
        quantiles = law.shown_quantiles(12)
        cells = [_milli(quantiles[level][0], law.std, quantiles[level][1]) if quantiles else "-" for level in _SHOWN]
        name = law.quantity
        rows.append([symbol(name), unit(name), _milli(law.mean, law.std), _milli(law.std, law.std), *cells])
    return rows


def method_rows(entry: PoseLaws) -> list[list[str]]:
    """Return for each known law: symbol, method, draws, error of F, distance to the samples, band, whether they agree."""
    rows = []
    for law in entry.laws.values():
        if law.law is None or law.agreement is None:
            continue
        agreement = law.agreement
        rows.append(
            [
                symbol(law.quantity),
                law.law.method,
                str(law.contributors),
                bound_text(law.error),
                f"{agreement.distance:.5f}",
                f"{agreement.band:.5f}",
                "agree" if agreement.agrees else "DISAGREE",
            ]
        )
    return rows


def _missing(entry: PoseLaws) -> list[str]:
    return [one_line(f"{symbol(law.quantity)}: {law.reason}") for law in entry.laws.values() if law.law is None]


def _milli(value: float, std: float, most: int = 12) -> str:
    """Return the value in thousandths, to a millionth of the spread, to seven digits at least and ``most`` at most."""
    if abs(value) <= ROUNDING:
        return "0"
    digits = 7 if std <= ROUNDING else min(12, max(7, math.ceil(math.log10(abs(value) / std) + 6)))
    return f"{1e3 * value:.{min(digits, most)}g}"


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
