"""Reliability as text for a terminal and as a picture."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from numpy.typing import NDArray

from precision_pin.analyses.reliability.estimates import SAMPLING, Estimate, in_words, rounded
from precision_pin.analyses.reliability.reliability_result import ReliabilityResult, SpecificationReliability
from precision_pin.analyses.reliability.strata import Stratum
from precision_pin.display.tables import resting_on, symbol, unit
from precision_pin.outputs.kit.draw_distribution import BLUE, GREEN, SKY, VERMILION
from precision_pin.outputs.kit.figure_style import (
    DOUBLE_COLUMN,
    LINE_HEIGHT,
    caption,
    new_figure,
    set_height,
    shortened,
    style,
)
from precision_pin.outputs.monte_carlo.table import NOTHING_VARIES, aligned, demanded, subject

__all__ = ["figure", "table"]

LISTED: Final = 6
_LONGEST_NAME: Final = 38
_PANEL: Final = 34.0


def table(result: ReliabilityResult) -> str:
    """Return, for every specification, the verdict, what each method gave, the design point, and disagreements."""
    heading = result.heading
    blocks = []
    for entry in result.poses:
        lines = [
            subject(heading, entry.pose),
            f"exact model, statics {heading.statics}, seed {heading.seed}; intervals at {100 * result.confidence:g} % "
            "confidence, base axes",
        ]
        for specification in entry.specifications:
            lines += ["", *_specification_lines(specification)]
        blocks.append("\n".join(lines))
    return "\n\n".join([*blocks, *resting_on(heading.assumed, heading.sources)])


def figure(result: ReliabilityResult, which: int = 0) -> Figure:
    """Return each specification's probabilities of failure by method, and the importance factors, 174 mm wide.

    Parameters
    ----------
    result
        What is drawn.
    which
        Which of its poses, 0-based.
    """
    entry, heading = result.poses[which], result.heading
    lines = [
        *caption("reliability", heading, entry.pose),
        f"seed {heading.seed}, exact model, statics {heading.statics}; bars: intervals at {100 * result.confidence:g} % "
        "confidence",
    ]
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        rows = len(entry.specifications)
        panels = drawn.subplots(rows, 2, squeeze=False)
        for (left, right), specification in zip(panels, entry.specifications, strict=True):
            _draw_methods(left, specification)
            _draw_importance(right, specification)
        drawn.suptitle("\n".join(lines))
        set_height(drawn, _PANEL * rows + LINE_HEIGHT * (len(lines) + 1))
    return drawn


# text ---------------------------------------------------------------------------------------


def _specification_lines(entry: SpecificationReliability) -> list[str]:
    rows = [["", "P(failure)", "interval", "c.o.v.", "evaluations", ""]]
    for estimate in entry.estimates:
        varies = f"{100 * estimate.variation:.2g} %" if math.isfinite(estimate.variation) else "-"
        rows.append(
            [
                f"  {estimate.method}",
                f"{estimate.probability:.3g}",
                in_words(estimate.interval),
                varies,
                f"{estimate.evaluations:,}",
                estimate.note,
            ]
        )
    return [
        _verdict(entry),
        *aligned(rows),
        *_form_lines(entry),
        *_strata_lines(entry),
        *(f"  DISAGREE: {line}" for line in entry.contradictions),
        *(f"  note: {line}" for line in entry.remarks),
        *_explained(entry),
    ]


def _verdict(entry: SpecificationReliability) -> str:
    interval = entry.best.interval
    if entry.verdict == "nothing to judge":
        said = NOTHING_VARIES
    elif entry.resolved:
        said = f"P(failure) {entry.best.probability:.3g} ({in_words(entry.best.interval)}, {entry.best.method})"
    else:
        span = in_words(interval) if interval[0] else f"below {rounded(interval[1], interval)}"
        said = f"P(failure) {span} by sampling" if entry.met else f"P(failure) NOT RESOLVED, {span}"
    return f"{demanded(entry.specification)}: {entry.verdict.upper()} - {said}"


def _form_lines(entry: SpecificationReliability) -> list[str]:
    found = entry.form
    if not entry.failures or found.range is None:
        return [f"  FORM  {found.starts} starts led to no design point within 8.2 standard deviations"]
    first = entry.failures[0]
    shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in list(first.importance.items())[:LISTED])
    count = len(found.points)
    together = "" if count == 1 else f"; all together at most {found.range[1]:.3g}"
    return [
        f"  FORM  β {first.beta:.6g}, Φ(-β) {first.probability:.3g}; {count} distinct design "
        f"point{'' if count == 1 else 's'} from {found.starts} starts{together}",
        f"  importance  {shares}",
        f"  error at the design point  d = ({_three(first.error[:3])}) mm, δ = ({_three(first.error[3:])}) mrad",
    ]


def _strata_lines(entry: SpecificationReliability) -> list[str]:
    parts = [part for part in entry.strata.parts if part.rare]
    if not parts and not entry.strata.remainder:
        return []
    named = ", ".join(f"{_rare(part)} {part.probability:.3g}" for part in parts[:LISTED])
    more = f", … ({len(parts)} in all)" if len(parts) > LISTED else ""
    left = f"; not looked at, added to the upper ends: {entry.strata.remainder:.3g}" if entry.strata.remainder else ""
    return [f"  rare values, each sought by itself, and their probabilities  {named or 'none'}{more}{left}"]


def _rare(part: Stratum) -> str:
    if len(part.combinations) == 1:
        return " and ".join(part.rare)
    return f"{len(part.combinations)} combinations of {', '.join(part.rare)}"


def _explained(entry: SpecificationReliability) -> list[str]:
    """Return why the probability is not resolved, and what the verdict rests on where methods disagree or have no answer."""
    if entry.verdict == "nothing to judge" or (entry.resolved and not entry.contradictions):
        return []
    counted = next(estimate for estimate in entry.estimates if estimate.method == SAMPLING)
    failures = round(counted.probability * counted.evaluations)
    rests = f"the verdict rests on {failures:,} failures among {counted.evaluations:,} samples alone, whose interval always holds"
    if entry.resolved:
        return [f"  {rests}"]
    return [f"  not resolved{' below that' if entry.met else ''}: {entry.reason}; {rests}"]


def _three(vector: NDArray[np.float64]) -> str:
    return ", ".join(f"{1e3 * value:.4g}" for value in vector.tolist())


# picture ------------------------------------------------------------------------------------


def _draw_methods(axes: Axes, entry: SpecificationReliability) -> None:
    shown: list[Estimate] = [
        estimate for estimate in entry.estimates if estimate.interval[1] < 1 or estimate.probability
    ]
    positive = [value for estimate in shown for value in (*estimate.interval, estimate.probability) if value > 0]
    positive += [*(entry.form.range or ()), 1 - entry.specification.required]
    lowest = 10.0 ** math.floor(math.log10(max(min(positive), 1e-15)) - 0.3)
    highest = 10.0 ** math.ceil(math.log10(max(positive)))
    for row, estimate in enumerate(shown):
        colour = BLUE if estimate.resolved else SKY
        low, high = (max(end, lowest) for end in estimate.interval)
        axes.plot([low, high], [row, row], color=colour, linewidth=2.4, solid_capstyle="butt")
        if estimate.probability:
            axes.plot([estimate.probability], [row], "o", color=colour, markersize=4)
    names = [estimate.method for estimate in shown]
    if entry.form.range is not None:
        axes.plot(entry.form.range, [len(shown)] * 2, color=VERMILION, linewidth=2.4)
        axes.plot([entry.form.range[0]], [len(shown)], "s", color=VERMILION, markersize=4)
        names.append("FORM")
    axes.axvline(1 - entry.specification.required, color=GREEN, linestyle=(0, (6, 1.5, 1.2, 1.5)))
    axes.set_xscale("log")
    axes.set_xlim(lowest, highest)
    decades = round(math.log10(highest / lowest))
    ticks = [highest * 10.0**-k for k in range(0, decades + 1, max(1, math.ceil(decades / 5)))]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0e}" if value < 1e-3 else f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(max(len(names), 3) - 0.4, -0.6)
    axes.set_xlabel("probability of failure (line: allowed)")
    limited = entry.specification
    axes.set_title(
        f"{symbol(limited.quantity)} within {1e3 * limited.limit:.6g} {unit(limited.quantity)}: {entry.verdict}",
        fontsize=7.5,
    )


def _draw_importance(axes: Axes, entry: SpecificationReliability) -> None:
    axes.set_xlabel("importance at the design point [%]")
    if not entry.failures:
        axes.text(0.03, 0.8, "no design point found", transform=axes.transAxes)
        axes.set_yticks([])
        axes.set_xticks([])
        return
    shares = list(entry.failures[0].importance.items())[:LISTED]
    axes.barh(range(len(shares)), [100 * share for _, share in shares], height=0.7, color=SKY, linewidth=0)
    axes.set_yticks(range(len(shares)), [shortened(name, _LONGEST_NAME) for name, _ in shares])
    axes.set_ylim(max(len(shares), 3) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.set_title(f"β = {entry.failures[0].beta:.4g}", fontsize=7.5)
