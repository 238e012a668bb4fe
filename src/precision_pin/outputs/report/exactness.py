"""The exact law of the first-order model against the samples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from precision_pin.analyses.budget_result import VECTORS
from precision_pin.analyses.exact_law import LEVELS, ExactLaw, ExactLawResult
from precision_pin.outputs.drawing import SKY, VERMILION
from precision_pin.outputs.plots import DOUBLE_COLUMN, MILLIMETRES_PER_INCH, new_figure, style
from precision_pin.statistics import Distribution

from .elements import Child, Html, items, paragraph, section, table
from .figures import figure
from .numbers import MISSING, milli, symbol_of
from .results import Missing, Results
from .wording import left_out

__all__ = ["exactness"]

_SHOWN: Final = (0.00135, 0.05, 0.5, 0.95, 0.9973, 0.99865)
_HEIGHT: Final = 92.0


def exactness(results: Results) -> Html:
    """Return exact laws over the sampled histograms, their quantiles, and how far samples lie from them."""
    heading = "Exact law against sampling"
    if isinstance(results.exact_law, Missing):
        return section("exact-law", heading, left_out("Exact law", results.exact_law, results))
    result = results.exact_law
    laws = result.poses[0].laws
    pictures = []
    for vector in VECTORS:
        known = [law for name, law in laws.items() if name.startswith(vector) and law.law is not None]
        if known:
            pictures.append(
                figure(
                    _overlay(known, [results.analysis.summary.distribution(law.quantity) for law in known]),
                    f"exact-{vector}",
                    f"Exact law over the sampled {vector} error: {'; '.join(_described(law) for law in known)}",
                    f"Exact law of the first-order model over the samples ({results.analysis.model} model): {vector} error.",
                )
            )
    absent = [f"{symbol_of(law.quantity)[0]}: {law.reason}" for law in laws.values() if law.law is None]
    parts: list[Child] = [_explained(results), *pictures, _quantiles(laws.values()), _methods(result)]
    if absent:
        parts.append(items(absent, "note"))
    return section("exact-law", heading, *parts)


def _explained(results: Results) -> Html:
    compared = results.exact_law
    assert not isinstance(compared, Missing)
    return paragraph(
        "The law of the first-order model follows from the characteristic functions of the draws, without sampling, tails "
        f"included. The pictures lay it over the {results.analysis.samples:,} samples of the {results.analysis.model} model "
        "above: where the two differ, the arm is not linear over its tolerances. The last table compares it with "
        f"{compared.samples:,} samples of the first-order model itself.",
        class_="note",
    )


def _described(law: ExactLaw) -> str:
    symbol, unit = symbol_of(law.quantity)
    quantiles = dict(zip(LEVELS, law.quantiles, strict=True))
    return (
        f"{symbol} mean {milli(law.mean or 0.0, 5)}, standard deviation {milli(law.std or 0.0, 5)}, "
        f"5 % {milli(quantiles[0.05], 5)}, 95 % {milli(quantiles[0.95], 5)} {unit}"
    )


def _quantiles(laws: Iterable[ExactLaw]) -> Html:
    header = ["", "mean", "std", *(f"{100 * level:.5g} %" for level in _SHOWN)]
    rows = []
    for law in laws:
        if law.mean is None or law.std is None:
            continue
        symbol, unit = symbol_of(law.quantity)
        quantiles = dict(zip(LEVELS, law.quantiles, strict=False))
        cells = [milli(quantiles[level]) if law.quantiles else MISSING for level in _SHOWN]
        rows.append([f"{symbol} [{unit}]", milli(law.mean), milli(law.std), *cells])
    return table("Exact law of the first-order model: moments and quantiles", header, rows)


def _methods(result: ExactLawResult) -> Html:
    rows = []
    for law in result.poses[0].laws.values():
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
    header = ["", "method", "draws", "error bound of F", "Kolmogorov distance", "band", "samples"]
    caption = f"How exact the laws are, and samples of the first-order model: band at {100 * result.confidence:g} % confidence"
    return table(caption, header, rows, words=(1, 6))


# picture ------------------------------------------------------------------------------------


def _overlay(laws: Sequence[ExactLaw], sampled: Sequence[Distribution]) -> Figure:
    """Return densities above and cumulative laws below, a column for each quantity, 174 mm wide."""
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        panels = drawn.subplots(2, len(laws), squeeze=False, sharex="col")
        for column, law, distribution in zip(panels.T, laws, sampled, strict=True):
            _draw(column[0], column[1], law, distribution)
        for axes in panels[0, :1]:
            axes.set_ylabel(f"density [1/{symbol_of(laws[0].quantity)[1]}]")
        panels[1, 0].set_ylabel("cumulative probability")
        found: dict[str, Any] = {}
        for axes in panels.flat:
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                found.setdefault(label, handle)
        drawn.legend(list(found.values()), list(found), loc="outside lower center", ncols=3, frameon=False)
        drawn.set_size_inches(DOUBLE_COLUMN / MILLIMETRES_PER_INCH, _HEIGHT / MILLIMETRES_PER_INCH)
    return drawn


def _draw(above: Axes, below: Axes, law: ExactLaw, distribution: Distribution) -> None:
    symbol, unit = symbol_of(law.quantity)
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
    below.set_xlabel(f"{symbol} [{unit}]")
    for axes in (above, below):
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10], min_n_ticks=2))
        axes.ticklabel_format(style="plain", useOffset=False)
