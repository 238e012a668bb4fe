"""The moments of the exact error beside those of the first order."""

from __future__ import annotations

import math

from precision_pin.analyses.collect import Results
from precision_pin.analyses.moments.figure import figure
from precision_pin.analyses.moments.moments import MomentsResult, PoseMoments
from precision_pin.analyses.moments.table import moment_rows
from precision_pin.analyses.report_cells import shown
from precision_pin.render.html import Child, Html, paragraph, table
from precision_pin.render.svg import figure as inline_figure
from precision_pin.render.tables import milli, quantity_label, symbol, unit
from precision_pin.statistics import COMPONENTS, QUANTITIES


def content(result: MomentsResult, results: Results) -> list[Child]:
    """Return mean, bias and standard deviation of every quantity, and the correlations of the components."""
    pose = result.poses[0]
    header = ["", "mean", "bias", "standard deviation", "standard deviation, first order", "exact / first order"]
    rows = [
        [quantity_label(name), *map(shown, cells)]
        for name, (_, _, *cells) in zip(QUANTITIES, moment_rows(pose), strict=True)
    ]
    chart = inline_figure(
        figure(result),
        f"{results.prefix}moments",
        f"Mean and standard deviation of the components of the error: {'; '.join(_described(pose))}",
        "Mean and standard deviation of the components, of the exact model with their intervals, beside the first order.",
    )
    note = paragraph(
        f"{result.how[0].upper()}{result.how[1:]}. Bias: mean of the exact model less that of the first order, which is the "
        "error at the means.",
        class_="note",
    )
    return [note, chart, table("Moments of the exact model and of the first order", header, rows), _correlations(pose)]


def _described(pose: PoseMoments) -> list[str]:
    return [
        f"{symbol(QUANTITIES[row])} {milli(float(mean), 5)} and {milli(float(std), 5)} {unit(QUANTITIES[row])}"
        for row, mean, std in zip(COMPONENTS, pose.mean.value, pose.std.value, strict=True)
    ]


def _correlations(pose: PoseMoments) -> Html:
    """Return the covariance of the exact model, as correlations of the components."""
    names = [symbol(QUANTITIES[row]) for row in COMPONENTS]
    covariance = pose.covariance.value
    rows = []
    for i, name in enumerate(names):
        scales = [math.sqrt(max(covariance[i, i] * covariance[j, j], 0.0)) for j in range(len(names))]
        cells = [f"{covariance[i, j] / scale:.4f}" if scale > 0 else shown("-") for j, scale in enumerate(scales)]
        rows.append([name, *cells])
    return table("Correlations of the components, exact model", ["", *names], rows)
