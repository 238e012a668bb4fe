"""Drawing one distribution on given axes: bars or curve, marks, units, and only resolved digits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from precision_pin.base.written_units import WrittenUnit
from precision_pin.render.tables import symbol
from precision_pin.statistics import Distribution, Histogram, SpecificationResult, Verdict, format_inside, format_share

BLUE: Final = "#0072B2"
SKY: Final = "#56B4E9"
VERMILION: Final = "#D55E00"
GREEN: Final = "#009E73"
PURPLE: Final = "#CC79A7"
BLACK: Final = "#000000"

LIMIT_COLOURS: Final[dict[Verdict, str]] = {"met": GREEN, "not met": VERMILION}
"""By verdict; other verdicts are black."""
_LIMIT_DASHES: Final = (0, (6, 1.5, 1.2, 1.5))
# a limit farther from the data than this multiple of their span is named, not drawn: the data take a third of the axis or more
_FARTHEST_LIMIT: Final = 1.0


def display_unit(*distributions: Distribution) -> WrittenUnit:
    """Return the unit (mm or mrad from 0.1 to 10,000, else a neighbour) that suits the largest of these values."""
    return WrittenUnit.of_axis(
        distributions[0].quantity, max(max(abs(part.min), abs(part.max)) for part in distributions)
    )


@dataclass(frozen=True)
class _Ruler:
    """The horizontal axis: drawn = (value − origin) · unit.per_si; numbers in labels are in `text_unit`."""

    unit: WrittenUnit
    text_unit: WrittenUnit
    origin: float
    label: str

    def __call__(self, value: Any) -> Any:
        return (value - self.origin) * self.unit.per_si


def _ruler(distribution: Distribution, unit: WrittenUnit) -> _Ruler:
    """Return the axis in this unit, or in a smaller one where the span is far smaller."""
    # values with a span far below their size get an axis of differences from a round number
    name = symbol(distribution.quantity)
    span = distribution.max - distribution.min
    size = max(abs(distribution.min), abs(distribution.max))
    if span == 0 or span > 2e-3 * size:
        if 0 < span * unit.per_si < 0.02:  # its labels would need four decimals
            unit = WrittenUnit.of_axis(distribution.quantity, span)
        return _Ruler(unit, unit, 0.0, f"{name} [{unit.name}]")
    place = math.floor(math.log10(span * unit.per_si))
    rounded = round(distribution.mean * unit.per_si, -place)
    fine = WrittenUnit.of_axis(distribution.quantity, span)
    sign = "−" if rounded >= 0 else "+"
    offset = f"{abs(rounded):.{max(0, -place)}f}"
    return _Ruler(fine, unit, rounded / unit.per_si, f"{name} {sign} {offset} {unit.name} [{fine.name}]")


def draw_histogram(
    axes: Axes, distribution: Distribution, unit: WrittenUnit, specifications: Sequence[SpecificationResult]
) -> None:
    """Draw the probability density, with labels for a legend."""
    bars = distribution.histogram()
    ruler = _ruler(distribution, unit)
    if bars is not None:
        density = bars.density / ruler.unit.per_si
        axes.stairs(density, ruler(bars.edges), fill=True, color=SKY, alpha=0.55, linewidth=0)
        for result in specifications:
            if result.quantity == distribution.quantity:
                _draw_tails(axes, bars, distribution, ruler, result.limit)
        axes.set_ylim(0, 1.08 * density.max())
        axes.yaxis.set_major_locator(ticks())
    else:
        note = "all equal" if distribution.samples > 1 else "one sample"
        axes.text(0.03, 0.9, note, transform=axes.transAxes)
        axes.set_ylim(0, 1)
        axes.set_yticks([])
    axes.set_ylabel(f"density [1/{ruler.unit.name}]")
    _mark(axes, distribution, ruler, specifications)


def _draw_tails(axes: Axes, bars: Histogram, distribution: Distribution, ruler: _Ruler, limit: float) -> None:
    sides = [(limit, math.inf)] if distribution.is_norm else [(-math.inf, -limit), (limit, math.inf)]
    for low, high in sides:
        edges = np.clip(bars.edges, low, high)
        beyond = np.diff(edges) > 0
        if beyond.any():
            first, last = np.flatnonzero(beyond)[[0, -1]]
            density = bars.density[first : last + 1] / ruler.unit.per_si
            axes.stairs(density, ruler(edges[first : last + 2]), fill=True, color=VERMILION, linewidth=0)


def draw_cumulative(
    axes: Axes, distribution: Distribution, unit: WrittenUnit, specifications: Sequence[SpecificationResult]
) -> None:
    """Draw the cumulative distribution, with labels for a legend."""
    ruler = _ruler(distribution, unit)
    low, high = _range(distribution, ruler)
    margin = (1 + _FARTHEST_LIMIT) * (high - low)  # level to the axis's ends, wherever a limit puts them
    values = np.union1d(np.linspace(low, high, 600), [low - margin, distribution.min, distribution.max, high + margin])
    axes.plot(ruler(values), distribution.cumulative(values), color=BLUE, drawstyle="steps-post")
    axes.set_ylim(0, 1.03)
    axes.set_ylabel("cumulative probability")
    _mark(axes, distribution, ruler, specifications)


def share_scale(axes: Sequence[Axes], distributions: Sequence[Distribution], unit: WrittenUnit) -> list[bool]:
    """Give axes a common horizontal scale, except those in another unit or far narrower; return which share it."""
    rulers = [_ruler(distribution, unit) for distribution in distributions]
    spans = [distribution.max - distribution.min for distribution in distributions]
    alike = [
        ruler.unit == unit and ruler.origin == 0 and 0.05 * max(spans) <= span
        for ruler, span in zip(rulers, spans, strict=True)
    ]
    shared = [panel for panel, is_alike in zip(axes, alike, strict=True) if is_alike]
    limits = [panel.get_xlim() for panel in shared]
    for panel in shared:
        panel.set_xlim(min(low for low, _ in limits), max(high for _, high in limits))
    return alike if sum(alike) > 1 else [False] * len(alike)


def _mark(axes: Axes, distribution: Distribution, ruler: _Ruler, specifications: Sequence[SpecificationResult]) -> None:
    mean = _text(distribution.mean, distribution.mean_interval(), ruler.text_unit)
    axes.axvline(ruler(distribution.mean), color=BLACK, linestyle="-", label=f"mean: {mean}")
    first, second = (0.95, 0.9973) if distribution.is_norm else (0.05, 0.95)
    for p, colour, dashes in ((first, BLUE, (0, (4, 1.5))), (second, PURPLE, (0, (1.2, 1.2)))):
        value, interval = distribution.resolved_quantile(p), distribution.quantile_interval(p)
        label = f"{100 * p:g} % quantile: {_text(value, interval, ruler.text_unit)}"
        if value is None or interval is None:
            axes.plot([], [], color=colour, linestyle=dashes, label=label)
            continue
        axes.axvspan(ruler(interval[0]), ruler(interval[1]), color=colour, alpha=0.2, linewidth=0)
        axes.axvline(ruler(value), color=colour, linestyle=dashes, label=label)
    low, high = _range(distribution, ruler)
    ends = [low, high]
    for result in specifications:
        if result.quantity == distribution.quantity:
            ends += _mark_limit(axes, distribution, ruler, result)
    axes.set_xlim(ruler(min(ends)), ruler(max(ends)))
    axes.xaxis.set_major_locator(ticks())
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.set_xlabel(ruler.label)


def _mark_limit(axes: Axes, distribution: Distribution, ruler: _Ruler, result: SpecificationResult) -> list[float]:
    """Draw a limit if it is near the data, add it to the legend in any case, and return the range of the axis."""
    readable = 1e-3 <= result.limit * ruler.text_unit.per_si < 1e5
    unit = ruler.text_unit if readable else WrittenUnit.of_axis(result.quantity, result.limit)
    label = f"limit {result.limit * unit.per_si:.6g} {unit.name}"
    low, high = _range(distribution, ruler)
    farthest = _FARTHEST_LIMIT * (high - low)
    sides = (result.limit,) if distribution.is_norm else (-result.limit, result.limit)
    colour = LIMIT_COLOURS.get(result.verdict, BLACK)
    drawn = [side for side in sides if low - farthest <= side <= high + farthest]
    if not drawn:
        label += " (beyond this axis)"
        axes.plot([], [], color=colour, linestyle=_LIMIT_DASHES, linewidth=1.4)
    share, lower, upper = format_share(result.probability, result.interval, result.required)
    label += f":\n{share} % inside ({lower} to {upper} %)\n{100 * result.required:.6g} % required: {result.verdict}"
    for side in drawn:
        axes.axvline(ruler(side), color=colour, linestyle=_LIMIT_DASHES, linewidth=1.4)
    axes.get_lines()[-1].set_label(label)
    margin = 0.03 * (high - low)
    return [side + math.copysign(margin, side) for side in drawn]


def _range(distribution: Distribution, ruler: _Ruler) -> tuple[float, float]:
    """Return the range to draw; a norm's never reaches below zero."""
    span = distribution.max - distribution.min
    margin = 0.05 * span if span > 0 else 0.5 * abs(distribution.max) or 1 / ruler.unit.per_si
    low = distribution.min - margin
    return max(low, 0.0) if distribution.is_norm else low, distribution.max + margin


def ticks() -> MaxNLocator:
    """Return the tick locator of a small panel."""
    return MaxNLocator(nbins=4, steps=[1, 2, 5, 10], min_n_ticks=2)


def _text(value: float | None, interval: tuple[float, float] | None, unit: WrittenUnit) -> str:
    if value is None or interval is None:
        return "not resolved"
    return f"{format_inside(value * unit.per_si, (interval[0] * unit.per_si, interval[1] * unit.per_si))} {unit.name}"


def moments_text(distribution: Distribution, unit: WrittenUnit) -> str:
    """Return mean and standard deviation, as far as resolved, in two lines for a panel's title."""
    unit = _ruler(distribution, unit).text_unit
    mean = _text(distribution.mean, distribution.mean_interval(), unit)
    std = distribution.std
    small = std is not None and std * unit.per_si < 1e-3
    std_unit = WrittenUnit.of_axis(distribution.quantity, std) if std is not None and small else unit
    return f"mean {mean}\nstd {_text(std, distribution.std_interval(), std_unit)}"
