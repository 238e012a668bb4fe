"""The moments in pictures and in the report."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.analyses.collect import Results
from precision_pin.analyses.moments.moments import MomentsResult, PoseMoments
from precision_pin.analyses.shares import VECTORS
from precision_pin.base.written_units import WrittenUnit
from precision_pin.render import figure_style
from precision_pin.render.columns import report_table
from precision_pin.render.draw_distribution import BLACK, BLUE, SKY
from precision_pin.render.figure_style import inline_figure
from precision_pin.render.html import Child, Html, paragraph, table
from precision_pin.render.tables import milli, shown, symbol, unit
from precision_pin.statistics import COMPONENTS, QUANTITIES

_LABELS: Final = {"mean": "mean", "std": "standard deviation"}
_NEGLIGIBLE: Final = 1e-3
"""Mean, as a fraction of the largest standard deviation, below which no application heeds it."""


def figure(result: MomentsResult, which: int = 0) -> Figure:
    """Return mean and standard deviation of the components, exact next to first order, 174 mm wide."""
    pose = result.poses[which]
    run = result.provenance
    method_line = f"{result.how}; N = {result.samples:,}, seed {run.seed}, statics {run.statics}"
    caption = f"{figure_style.caption('moments of the error', run, pose.pose)}\n{method_line}"
    with figure_style.style():
        chart = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        panels = chart.subplots(2, 2)
        for column, vector in zip(panels.T, VECTORS, strict=True):
            _draw(column[0], pose, vector, "mean")
            _draw(column[1], pose, vector, "std")
        figure_style.frame(chart, panels.flat, "", caption, 92.0, 2)
    return chart


def draw(axes: Axes, result: MomentsResult, which: int, quantity: str) -> None:
    """Draw the standard deviations of one vector's components on given axes."""
    with figure_style.style():
        _draw(axes, result.poses[which], quantity, "std")


def _draw(axes: Axes, pose: PoseMoments, vector: str, which: str) -> None:
    exact, first_order = getattr(pose, which), getattr(pose, f"first_order_{which}")
    half = np.zeros(6) if exact.half_width is None else np.nan_to_num(exact.half_width)
    rows = [3 * VECTORS.index(vector) + k for k in range(3)]
    places, names = np.arange(3), [symbol(QUANTITIES[COMPONENTS[row]]) for row in rows]
    spread = float(pose.std.value[rows].max())
    axis_unit = WrittenUnit.of_axis(vector, max(spread, float(np.abs(pose.mean.value[rows]).max())))
    axes.bar(places - 0.2, axis_unit.per_si * first_order[rows], width=0.36, color=SKY, label="first order")
    axes.bar(
        places + 0.2,
        axis_unit.per_si * exact.value[rows],
        yerr=axis_unit.per_si * half[rows],
        width=0.36,
        color=BLUE,
        label="exact model",
        error_kw={"elinewidth": 0.6, "capsize": 1.2, "capthick": 0.6},
    )
    axes.axhline(0, color=BLACK, linewidth=0.6)
    axes.set_xticks(places, names)
    axes.set_ylabel(f"{_LABELS[which]} [{axis_unit.name}]")
    # rounding is drawn as zero, not enlarged to the panel's height
    low, high = axes.get_ylim()
    least = _NEGLIGIBLE * spread * axis_unit.per_si
    axes.set_ylim(min(low, -least), max(high, least))


def content(result: MomentsResult, results: Results) -> list[Child]:
    """Return mean, bias and standard deviation of every quantity, and the correlations of the components."""
    pose = result.poses[0]
    moments = report_table("Moments of the exact model and of the first order", result.COLUMNS, result.rows(pose))
    chart = inline_figure(
        figure(result),
        f"{results.prefix}moments",
        f"Mean and standard deviation of the components of the error: {'; '.join(_describe(pose))}",
        "Mean and standard deviation of the components, of the exact model with their intervals, beside the first order.",
    )
    note = paragraph(
        f"{result.how[0].upper()}{result.how[1:]}. Bias: mean of the exact model less that of the first order, which is the "
        "error at the means.",
        class_="note",
    )
    return [note, chart, moments, _correlations(pose)]


def _describe(pose: PoseMoments) -> list[str]:
    return [
        f"{symbol(QUANTITIES[row])} {milli(float(mean), 5)} and {milli(float(std), 5)} {unit(QUANTITIES[row])}"
        for row, mean, std in zip(COMPONENTS, pose.mean.value, pose.std.value, strict=True)
    ]


def _correlations(pose: PoseMoments) -> Html:
    names = [symbol(QUANTITIES[row]) for row in COMPONENTS]
    covariance = pose.covariance.value
    rows = []
    for i, name in enumerate(names):
        scales = [math.sqrt(max(covariance[i, i] * covariance[j, j], 0.0)) for j in range(len(names))]
        cells = [f"{covariance[i, j] / scale:.4f}" if scale > 0 else shown("-") for j, scale in enumerate(scales)]
        rows.append([name, *cells])
    return table("Correlations of the components, exact model", ["", *names], rows)
