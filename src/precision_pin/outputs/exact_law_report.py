"""Exact laws as text for a terminal and as a picture."""

from __future__ import annotations

import math
import textwrap
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from precision_pin.analyses.exact_law import LEVELS, ExactLaw, ExactLawResult, PoseLaws
from precision_pin.outputs.drawing import BLUE, SKY, VERMILION
from precision_pin.outputs.plots import DOUBLE_COLUMN, MILLIMETRES_PER_INCH, new_figure, style
from precision_pin.outputs.text import ROUNDING, aligned, pose_text

__all__ = ["figure", "symbol_of", "table"]

_SHOWN: Final = (0.00135, 0.05, 0.5, 0.95, 0.9973, 0.99865)
_CAPTION_CHARACTERS: Final = 105
_LINE: Final = 3.6


def table(result: ExactLawResult) -> str:
    """Return mean, spread and quantiles of every component, in mm and mrad, how exact they are and how they compare."""
    heading = result.heading
    blocks = []
    for entry in result.poses:
        stands = pose_text(entry.pose.name, entry.pose.q, entry.pose.sliding_joints)
        blocks.append(
            "\n".join(
                [
                    f"{heading.robot}: {heading.base} to {heading.tip}, pose {stands}",
                    f"exact law of the first-order model, statics {heading.statics}; errors in base axes",
                    "",
                    *aligned(_quantile_rows(entry)),
                    "",
                    *aligned(_method_rows(entry)),
                    *_missing(entry),
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
    named = f" at pose {entry.pose.name}" if entry.pose.name else ""
    caption = [
        *textwrap.wrap(
            f"exact law of the first-order model of {heading.robot}, {heading.base} to {heading.tip}{named}",
            _CAPTION_CHARACTERS,
        ),
        f"N = {result.samples:,}, seed {heading.seed}, first-order model, statics {heading.statics}",
    ]
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        panels = drawn.subplots(2, 3)
        components = [law for law in entry.laws.values() if not law.quantity.endswith("norm")]
        labelled: dict[str, Any] = {}
        for axes, law in zip(panels.flat, components, strict=True):
            _draw(axes, law)
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                labelled.setdefault(label, handle)
        drawn.legend(
            list(labelled.values()), list(labelled), loc="outside lower center", ncols=3, frameon=False,
            title="\n".join(caption), handlelength=2.6,
        )  # fmt: skip
        height = 100 + _LINE * (len(caption) + 1)
        drawn.set_size_inches(DOUBLE_COLUMN / MILLIMETRES_PER_INCH, height / MILLIMETRES_PER_INCH)
    return drawn


def symbol_of(quantity: str) -> tuple[str, str]:
    """Return a quantity's symbol and the unit it is printed in."""
    vector, _, part = quantity.partition(".")
    symbol, unit = ("d", "mm") if vector == "position" else ("δ", "mrad")
    return (f"|{symbol}|" if part == "norm" else f"{symbol}{part}"), unit


def _quantile_rows(entry: PoseLaws) -> list[list[str]]:
    rows = [["", "", "mean", "std", *(f"{100 * level:g} %" for level in _SHOWN)]]
    for law in entry.laws.values():
        if law.mean is None or law.std is None:
            continue
        quantiles = dict(zip(LEVELS, law.quantiles, strict=False))
        cells = [_milli(quantiles[level], law.std) if law.quantiles else "-" for level in _SHOWN]
        symbol, unit = symbol_of(law.quantity)
        rows.append([symbol, unit, _milli(law.mean, law.std), _milli(law.std, law.std), *cells])
    return rows


def _method_rows(entry: PoseLaws) -> list[list[str]]:
    rows = [["", "method", "draws", "error of F", "distance", "band", "samples"]]
    for law in entry.laws.values():
        if law.law is None or law.agreement is None:
            continue
        agreement = law.agreement
        rows.append(
            [
                symbol_of(law.quantity)[0],
                law.law.method,
                str(law.contributors),
                f"{law.error:.0e}",
                f"{agreement.distance:.5f}",
                f"{agreement.band:.5f}",
                "agree" if agreement.agrees else "DISAGREE",
            ]
        )
    return rows if len(rows) > 1 else []


def _missing(entry: PoseLaws) -> list[str]:
    return [f"{symbol_of(law.quantity)[0]}: {law.reason}" for law in entry.laws.values() if law.law is None]


def _milli(value: float, std: float) -> str:
    """Return the value in thousandths, to a millionth of the spread or to nine digits."""
    if abs(value) <= ROUNDING:
        return "0"
    digits = 7 if std <= ROUNDING else min(12, max(7, math.ceil(math.log10(abs(value) / std) + 6)))
    return f"{1e3 * value:.{digits}g}"


def _draw(axes: Axes, law: ExactLaw) -> None:
    symbol, unit = symbol_of(law.quantity)
    axes.set_xlabel(f"{symbol} [{unit}]")
    if law.law is None or law.agreement is None:
        axes.set_yticks([])
        axes.set_xticks([])
        for line, words in enumerate(textwrap.wrap(law.reason, 30)):
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
    axes.set_ylabel(f"density [1/{unit}]")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10], min_n_ticks=2))
    axes.ticklabel_format(style="plain", useOffset=False)
