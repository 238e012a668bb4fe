"""Terminal table of the exact laws."""

from __future__ import annotations

import math
from typing import Final

from precision_pin.analyses.exact_law.exact_law import (
    LEVELS_SHOWN,
    ExactLawResult,
    PoseLaws,
    bound_text,
    missing,
)
from precision_pin.analyses.monte_carlo.table import answer_of, subject
from precision_pin.base.errors import one_line
from precision_pin.render.tables import ROUNDING, symbol, unit
from precision_pin.render.text_table import aligned

_METHOD_HEADER: Final = ["", "method", "draws", "error of F", "distance", "band", "samples"]


def table(result: ExactLawResult) -> str:
    """Return mean, spread and quantiles of every component in mm and mrad, their accuracy, and the comparison."""
    provenance = result.provenance
    sizes = [
        max((law.std or 0.0 for law in entry.laws.values() if law.quantity.startswith("position.")), default=0.0)
        for entry in result.poses
    ]
    blocks = [answer_of([entry.pose for entry in result.poses], sizes, [*map(_answer, result.poses)])]
    for entry in result.poses:
        methods = method_rows(entry)
        lines = [
            subject(provenance, entry.pose),
            f"exact law of the first-order model, statics {provenance.statics}; errors in base axes",
            "",
            *aligned(_quantile_rows(entry)),
            "",
            *aligned([_METHOD_HEADER, *methods] if methods else []),
            *map(one_line, (*missing(entry.laws.values()), *entry.warnings)),
        ]
        blocks.append("\n".join(lines))
    blocks.append(
        f"compared with {result.samples:,} samples of the same model, seed {provenance.seed}: the Kolmogorov distance stays "
        f"below the band at {100 * result.confidence:g} % confidence"
    )
    return "\n\n".join(blocks)


def _answer(entry: PoseLaws) -> str:
    """Return the ends between which 99.73 % of the robots lie, for each component of the position."""
    parts = []
    for law in entry.laws.values():
        quantiles = law.shown_quantiles(12)
        if law.quantity.startswith("position.") and not law.quantity.endswith("norm") and quantiles:
            low, high = (f"{1e3 * quantiles[level][0]:.4g}" for level in (LEVELS_SHOWN[0], LEVELS_SHOWN[-1]))
            parts.append(f"{symbol(law.quantity)} {low} to {high}")
    return f"99.73 % of robots: {', '.join(parts)} mm" if parts else "no law is known"


def _quantile_rows(entry: PoseLaws) -> list[list[str]]:
    rows = [["", "", "mean", "std", *(f"{100 * level:g} %" for level in LEVELS_SHOWN)]]
    for law in entry.laws.values():
        if law.mean is None or law.std is None:
            continue
        quantiles = law.shown_quantiles(12)
        cells = [
            _milli(quantiles[level][0], law.std, quantiles[level][1]) if quantiles else "-" for level in LEVELS_SHOWN
        ]
        name = law.quantity
        rows.append([symbol(name), unit(name), _milli(law.mean, law.std), _milli(law.std, law.std), *cells])
    return rows


def method_rows(entry: PoseLaws) -> list[list[str]]:
    """Return for each known law: symbol, method, draws, error of F, distance to the samples, band, agreement."""
    rows = []
    for law in entry.laws.values():
        if law.law is None or law.agreement is None:
            continue
        compared = [f"{law.agreement.distance:.5f}", f"{law.agreement.band:.5f}", law.agreement.said]
        words = [symbol(law.quantity), law.law.method, str(law.contributors), bound_text(law.error)]
        rows.append([*words, *compared])
    return rows


def _milli(value: float, std: float, most: int = 12) -> str:
    """Return the value in thousandths, to a millionth of the spread, to at least seven and at most ``most`` digits."""
    if abs(value) <= ROUNDING:
        return "0"
    digits = 7 if std <= ROUNDING else min(12, max(7, math.ceil(math.log10(abs(value) / std) + 6)))
    return f"{1e3 * value:.{min(digits, most)}g}"
