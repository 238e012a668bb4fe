"""Terminal table of the moments."""

from __future__ import annotations

import numpy as np

from precision_pin.analyses.moments.moments import MomentsResult, PoseMoments, cell, entries
from precision_pin.analyses.monte_carlo.table import answer_of, subject
from precision_pin.render.tables import milli, plus_minus, symbol, unit
from precision_pin.render.text_table import aligned
from precision_pin.statistics import COMPONENTS, NORMS, QUANTITIES


def table(result: MomentsResult) -> str:
    """Return mean, bias and standard deviation of every quantity at every pose, mm and mrad, beside the first order."""
    sizes = [float(np.linalg.norm(pose.first_order_std[:3])) for pose in result.poses]
    blocks = [answer_of([pose.pose for pose in result.poses], sizes, [*map(_answer, result.poses)])]
    for pose in result.poses:
        # the ratio says the standard deviation of the first order
        rows = [[*cells, ratio] for *cells, _, ratio in moment_rows(pose)]
        how = f"{result.how}; statics {result.provenance.statics}; errors in base axes"
        table = aligned([["", "", "mean", "bias", "std", "/ first order"], *rows])
        blocks.append("\n".join([subject(result.provenance, pose.pose), how, "", *table]))
    blocks.append("bias: mean of the exact model less that of the first order; / first order: ratio of the stds")
    return "\n\n".join(blocks)


def _answer(pose: PoseMoments) -> str:
    parts = []
    for row in NORMS:
        quantity, (mean, std) = QUANTITIES[row], map(cell, entries(pose, row))
        parts.append(f"{symbol(quantity)} mean {mean} {unit(quantity)}, std {std} {unit(quantity)}")
    return "; ".join(parts)


def moment_rows(pose: PoseMoments) -> list[list[str]]:
    """Return for each quantity: symbol, unit, mean, bias, std, first-order std and the ratio of both."""
    rows = []
    for row, quantity in enumerate(QUANTITIES):
        mean, std = entries(pose, row)
        bias, first, ratio = "-", "-", "-"
        if row in COMPONENTS:
            index = COMPONENTS.index(row)
            half = 0.0 if pose.bias.half_width is None else float(pose.bias.half_width[index])
            bias = plus_minus(1e3 * float(pose.bias.value[index]), 1e3 * half, decimals=9)
            spread = float(pose.first_order_std[index])
            first = milli(spread)
            ratio = "-" if std is None or not spread else f"{std[0] / spread:.6g}"
        rows.append([symbol(quantity), unit(quantity), cell(mean), bias, cell(std), first, ratio])
    return rows
