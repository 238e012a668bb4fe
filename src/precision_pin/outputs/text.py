"""Results as text for a terminal."""

from __future__ import annotations

import math

from precision_pin.errors import Finding
from precision_pin.mcpc import Mcpc
from precision_pin.result import Analysis
from precision_pin.statistics import Distribution, SpecificationResult, format_supported

__all__ = ["analysis_table", "findings_text", "mcpc_table"]

_COLUMNS = ("mean", "std", "min", "max", "mode", 0.5, 0.95, 0.99, 0.9973)


def analysis_table(analysis: Analysis) -> str:
    """Return what a designer wants to read of an analysis: error statistics in mm and mrad.

    Only the digits that the sampling supports are printed; min and max are the smallest and largest seen.
    """
    lines = [
        f"{analysis.robot}: {analysis.base} to {analysis.tip}, pose {_pose(analysis)}",
        f"{analysis.samples:,} samples, seed {analysis.seed}, {analysis.model} model, statics {analysis.statics}; "
        "errors in base axes, intervals and digits at "
        f"{analysis.summary.confidence:.0%} confidence",
        "",
        *_aligned([_header(), *_rows(analysis)]),
        "",
        "min and max are the smallest and largest seen, not bounds; - is not resolved by this many samples",
        f"mode: peak of the histogram smoothed by {_bandwidths(analysis)}",
        "error with every parameter at its mean: "
        f"d = ({', '.join(f'{1e3 * value:.4g}' for value in analysis.nominal[:3])}) mm, "
        f"δ = ({', '.join(f'{1e3 * value:.4g}' for value in analysis.nominal[3:])}) mrad",
    ]
    lines += [_verdict(result) for result in analysis.summary.specifications]
    return "\n".join(lines)


def _pose(analysis: Analysis) -> str:
    values = ", ".join(f"{name} {math.degrees(value):.6g}°" for name, value in analysis.q.items())
    return f"{analysis.pose_name!r} ({values})" if analysis.pose_name else f"({values})"


def _header() -> list[str]:
    return ["", "", *(column if isinstance(column, str) else f"{100 * column:.4g} %" for column in _COLUMNS)]


def _rows(analysis: Analysis) -> list[list[str]]:
    rows = []
    for vector, symbol, unit in ((analysis.position, "d", "mm"), (analysis.attitude, "δ", "mrad")):
        for part in ("norm", "x", "y", "z"):
            distribution: Distribution = getattr(vector, part)
            name = f"|{symbol}|" if part == "norm" else f"{symbol}{part}"
            rows.append([name, unit, *(_cell(distribution, column) for column in _COLUMNS)])
    return rows


def _cell(distribution: Distribution, column: str | float) -> str:
    value = distribution.quantile(column) if isinstance(column, float) else getattr(distribution, column)
    half_width = distribution.half_width(column)
    if value is None or half_width is None:
        return "-"
    return format_supported(1e3 * value, 1e3 * half_width, most=5)


def _bandwidths(analysis: Analysis) -> str:
    parts = []
    for distribution, symbol, unit in ((analysis.position.norm, "|d|", "mm"), (analysis.attitude.norm, "|δ|", "mrad")):
        width = distribution.mode_bandwidth
        parts.append(f"{symbol} {'-' if width is None else f'{1e3 * width:.2g} {unit}'}")
    return ", ".join(parts)


def _verdict(result: SpecificationResult) -> str:
    unit = "mm" if result.quantity.startswith("position") else "mrad"
    low, high = result.interval
    return (
        f"spec {result.quantity} within {1e3 * result.limit:.6g} {unit} for {100 * result.required:.6g} %: "
        f"{'MET' if result.met else 'NOT MET'} - {100 * result.probability:.4f} % inside, "
        f"interval {100 * low:.4f} to {100 * high:.4f} %"
    )


def mcpc_table(mcpc: Mcpc) -> str:
    """Return the MCPC parameters as the paper's Table 1 lays them out, in degrees and mm."""
    rows = [["i", "joint", "offset °", "α °", "β °", "γ °", "x mm", "y mm", "z mm"]]
    for row in mcpc.table:
        gamma = "" if row.gamma is None else _plain(math.degrees(row.gamma))
        z = "" if row.z is None else _plain(1e3 * row.z)
        turns = [_plain(math.degrees(value)) for value in (row.turn, row.alpha, row.beta)]
        joint = "base" if row.joint is None else f"{row.joint} (slides)" if row.prismatic else row.joint
        rows.append([str(row.link), joint, *turns, gamma, _plain(1e3 * row.x), _plain(1e3 * row.y), z])
    return "\n".join(_aligned(rows))


def findings_text(findings: tuple[Finding, ...]) -> str:
    """Return findings, one line each."""
    return "\n".join(str(finding) for finding in findings)


def _plain(value: float) -> str:
    return f"{round(value, 9) + 0.0:.9g}"


def _aligned(rows: list[list[str]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if k < 2 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
