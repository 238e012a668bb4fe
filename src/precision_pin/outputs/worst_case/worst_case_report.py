"""The worst case as text for a terminal and as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from precision_pin.analyses.exact_law.exact_law_result import bound_text
from precision_pin.analyses.worst_case.worst_case_result import (
    SEEN_LEVEL,
    NormBound,
    PoseWorstCase,
    WorstCaseResult,
    bound_milli,
)
from precision_pin.display.tables import ROUNDING, milli, symbol, unit
from precision_pin.outputs.kit.draw_distribution import (
    BLACK,
    BLUE,
    GREEN,
    PURPLE,
    SKY,
    VERMILION,
    DisplayUnit,
    display_unit,
)
from precision_pin.outputs.kit.figure_style import (
    DOUBLE_COLUMN,
    LINE_HEIGHT,
    caption,
    labelled,
    legend_below,
    new_figure,
    set_height,
    shortened,
    style,
)
from precision_pin.outputs.monte_carlo.table import aligned, statistic, subject

__all__ = ["figure", "table"]

LISTED: Final = 8
"""How many draws are named, the largest contributions first; the rest stands in one line."""

_LONGEST_NAME: Final = 44
_BAR: Final = 4.6


def table(result: WorstCaseResult) -> str:
    """Return the bounds, what the exact model reaches, what was seen, and who contributes; mm and mrad."""
    cut = f"cut at {result.k:g} standard deviations: {', '.join(result.cut)}" if result.cut else "every law is bounded"
    heading = result.heading
    parts = []
    for pose in result.poses:
        lines = [
            subject(heading, pose.heading),
            f"worst case of {result.draws} draws, {cut}",
            f"beside it {result.samples:,} samples, seed {heading.seed}, exact model, statics {heading.statics}; "
            "errors in base axes",
            "",
            *aligned(_norm_rows(pose)),
            "",
            *aligned(_component_rows(pose)),
        ]
        for bound in (pose.position, pose.attitude):
            lines += ["", *_contributions(bound)]
        lines += _exceeded(pose)
        parts.append("\n".join(lines))
    parts.append(
        "first order: largest error of the tangent model, a bound; there: the exact model at the same parameters;\n"
        "found: the largest error of the exact model found, not a bound; seen: among the samples, not a bound"
    )
    return "\n\n".join(parts)


def figure(result: WorstCaseResult, which: int = 0) -> Figure:
    """Return how the draws add up to the worst case of |d| (above) and |δ| at one of the poses, 174 mm wide.

    Each bar begins where the one above it ends: the error at the means, the largest contributions, the rest. Lines mark
    the first-order bound, the largest exact error found, the largest seen and the 99.73 % quantile of the samples.

    Parameters
    ----------
    result
        What is drawn.
    which
        Which of its poses, 0-based.
    """
    pose, heading = result.poses[which], result.heading
    lines = [
        *caption("worst case", heading, pose.heading),
        f"N = {result.samples:,}, seed {heading.seed}, exact model, statics {heading.statics}",
    ]
    if result.cut:
        lines.append(f"unbounded laws cut at {result.k:g} standard deviations: {len(result.cut)} of {result.draws}")
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        bounds = (pose.position, pose.attitude)
        bars = [_bars(bound) for bound in bounds]
        panels = drawn.subplots(2, 1, height_ratios=[max(len(entries), 4) for entries in bars])
        for axes, bound, entries in zip(panels, bounds, bars, strict=True):
            _draw(axes, bound, entries)
        legend_below(drawn, labelled(panels[:1]), 2, lines)
        set_height(drawn, 34 + _BAR * sum(max(len(entries), 4) for entries in bars) + LINE_HEIGHT * (len(lines) + 2))
    return drawn


# text ---------------------------------------------------------------------------------------


def _norm_rows(pose: PoseWorstCase) -> list[list[str]]:
    rows = [["", "", "first order", "there", "found", "largest seen", f"{100 * SEEN_LEVEL:g} % seen"]]
    for bound in (pose.position, pose.attitude):
        sizes = (bound.exact_norm, bound.found.norm, bound.seen.max)
        cells = [bound_milli(bound.first_order.upper, up=True), *map(milli, sizes), statistic(bound.seen, SEEN_LEVEL)]
        rows.append([symbol(bound.quantity), unit(bound.quantity), *cells])
    return rows


def _component_rows(pose: PoseWorstCase) -> list[list[str]]:
    rows = [["", "", "lowest, first order", "highest", "smallest seen", "largest seen"]]
    for entry in pose.components:
        ends = bound_milli(entry.low, up=False), bound_milli(entry.high, up=True)
        rows.append([symbol(entry.quantity), unit(entry.quantity), *ends, *map(milli, entry.seen)])
    return rows


def _contributions(bound: NormBound) -> list[str]:
    """Return how the draws add up, and at which values; whether the bound is certified stands in the heading."""
    found = bound.first_order
    if found.certified:
        width = 0.0 if found.upper == 0 else found.upper / found.lower - 1
        proof = "in closed form" if found.cells == 0 else f"with {found.cells:,} spherical triangles"
        how = f"global within {bound_text(max(width, 1e-12))}, {proof}"
    else:
        how = (
            f"NOT resolved to 1e-9 with {found.cells:,} spherical triangles: the largest first-order error lies between "
            f"{1e3 * found.lower:.9g} and {1e3 * found.upper:.9g} {unit(bound.quantity)}"
        )
    rows = [
        [f"  {name}", unit(bound.quantity), milli(value), _values(bound, name)]
        for name, value in _listed(bound, "error at the means")
    ]
    return [f"what makes up {symbol(bound.quantity)} ({how}):", *aligned(rows)]


def _exceeded(pose: PoseWorstCase) -> list[str]:
    lines = []
    for bound in (pose.position, pose.attitude):
        if bound.exceeded:
            lines.append(
                f"the exact model goes beyond the first-order bound of {symbol(bound.quantity)} by "
                f"{1e3 * (bound.found.norm - bound.first_order.upper):.3g} {unit(bound.quantity)}: "
                "it bends over tolerances this large"
            )
    return ["", *lines] if lines else []


def _listed(bound: NormBound, nominal: str) -> list[tuple[str, float]]:
    """Return the error at the means, the largest contributions and what the others add together."""
    entries = [entry for entry in bound.contributions if abs(entry.value) > ROUNDING]
    few = len(entries) <= LISTED + 1
    named, rest = (entries, []) if few else (entries[:LISTED], entries[LISTED:])
    listed = [(nominal, bound.nominal), *((entry.draw, entry.value) for entry in named)]
    if rest:
        listed.append((f"{len(rest)} others", sum(entry.value for entry in rest)))
    return listed


def _values(bound: NormBound, name: str) -> str:
    """Return the values of a draw's components in the worst case, SI."""
    for entry in bound.contributions:
        if entry.draw == name:
            return "at " + ", ".join(f"{bound.parameters[component]:.6g}" for component in entry.components) + " (SI)"
    return ""


# picture ------------------------------------------------------------------------------------


def _bars(bound: NormBound) -> list[tuple[str, float]]:
    return [(shortened(name, _LONGEST_NAME), value) for name, value in _listed(bound, "error at the means")]


def _draw(axes: Axes, bound: NormBound, entries: Sequence[tuple[str, float]]) -> None:
    name, shown = symbol(bound.quantity), display_unit(bound.seen)
    begin = 0.0
    for row, (_, value) in enumerate(entries):
        colour = BLUE if row == 0 else SKY
        axes.barh(row, value * shown.per_si, left=begin * shown.per_si, height=0.7, color=colour, linewidth=0)
        begin += value
    axes.set_yticks(range(len(entries)), [name for name, _ in entries])
    axes.set_ylim(max(len(entries), 4) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    for value, colour, dashes, width, label in _lines(bound, shown):
        axes.axvline(value, color=colour, linestyle=dashes, linewidth=width, label=label)
    axes.axvline(0, color=BLACK, linewidth=0.6)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 2, 5, 10]))
    axes.ticklabel_format(axis="x", style="plain", useOffset=False)
    axes.margins(x=0.03)
    axes.set_xlabel(f"{name} [{shown.name}]")
    axes.set_title(
        f"{name}: bound {bound.first_order.upper * shown.per_si:.5g}, exact model at least "
        f"{bound.found.norm * shown.per_si:.5g}, largest seen {bound.seen.max * shown.per_si:.5g} {shown.name}",
        fontsize=7.5,
    )


def _lines(bound: NormBound, shown: DisplayUnit) -> list[tuple[float, str, object, float, str]]:
    quantile = bound.seen.quantile(SEEN_LEVEL)
    lines: list[tuple[float, str, object, float, str]] = [
        (bound.first_order.upper, VERMILION, "-", 1.6, "bound of the first-order model"),
        (bound.found.norm, BLACK, (0, (1.2, 1.2)), 1.0, "largest error of the exact model found"),
        (bound.seen.max, GREEN, (0, (4, 1.5)), 1.0, "largest seen among the samples"),
    ]
    if quantile is not None:
        lines.append(
            (quantile, PURPLE, (0, (6, 1.5, 1.2, 1.5)), 1.0, f"{100 * SEEN_LEVEL:g} % quantile of the samples")
        )
    return [(value * shown.per_si, colour, dashes, width, label) for value, colour, dashes, width, label in lines]
