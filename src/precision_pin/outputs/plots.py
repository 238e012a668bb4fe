"""Pictures of the pose error's distribution: histograms and cumulative curves.

Functions take a `Summary` or one of its `Distribution`s and return matplotlib objects made without pyplot,
so no global state is touched. Text is 7 pt or larger when a figure is printed at its own size (85 mm wide
for one quantity, 174 mm for the six components), colours are those of Okabe and Ito (2008), which stay apart
for colour-blind readers, and every line differs in its dashes as well.
"""

from __future__ import annotations

import math
import os
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from precision_pin.errors import OutputError
from precision_pin.statistics import Distribution, SpecificationResult, Summary, format_supported

__all__ = [
    "DisplayUnit",
    "cumulative",
    "display_unit",
    "figure_attitude",
    "figure_components",
    "figure_position",
    "histogram",
    "save",
]

MILLIMETRES_PER_INCH: Final = 25.4
SINGLE_COLUMN: Final = 85.0
DOUBLE_COLUMN: Final = 174.0
DOTS_PER_INCH: Final = 200

BLUE: Final = "#0072B2"
SKY: Final = "#56B4E9"
VERMILION: Final = "#D55E00"
GREEN: Final = "#009E73"
PURPLE: Final = "#CC79A7"
BLACK: Final = "#000000"

_STYLE: Final[Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.labelsize": 7.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.title_fontsize": 7,
    "figure.titlesize": 8,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.unicode_minus": True,
    "text.usetex": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "precision-pin",
    "savefig.bbox": None,
    "savefig.facecolor": "white",
    "path.simplify": True,
}

_SYMBOLS: Final = {
    "position.norm": "|d|",
    "position.x": "dx",
    "position.y": "dy",
    "position.z": "dz",
    "attitude.norm": "|δ|",
    "attitude.x": "δx",
    "attitude.y": "δy",
    "attitude.z": "δz",
}
_QUANTILE_LINES: Final = ((VERMILION, (0, (4, 1.5))), (PURPLE, (0, (1.2, 1.2))))
_LIMIT_DASHES: Final = (0, (6, 1.5, 1.2, 1.5))
_MARKED_OF_NORM: Final = (0.95, 0.9973)
_MARKED_OF_COMPONENT: Final = (0.05, 0.95)
# below this ratio of span to size, values are drawn as differences from a round number
_SMALLEST_RATIO: Final = 2e-3
# a limit farther from the data than this share of their span is named, not drawn
_FARTHEST_LIMIT: Final = 1.0
_CHARACTERS_PER_MILLIMETRE: Final = 0.62
_LINE_HEIGHT: Final = 3.6
_MOST_TICKS: Final = 5


_Draw = Callable[[Axes, Distribution, "DisplayUnit", Sequence[SpecificationResult]], None]


@final
@dataclass(frozen=True)
class DisplayUnit:
    """A unit for display: its name and how many of it make one SI unit."""

    name: str
    per_si: float


_LENGTHS: Final = (
    DisplayUnit("m", 1.0),
    DisplayUnit("mm", 1e3),
    DisplayUnit("µm", 1e6),
    DisplayUnit("nm", 1e9),
    DisplayUnit("pm", 1e12),
)
_ANGLES: Final = (
    DisplayUnit("rad", 1.0),
    DisplayUnit("mrad", 1e3),
    DisplayUnit("µrad", 1e6),
    DisplayUnit("nrad", 1e9),
    DisplayUnit("prad", 1e12),
)


def display_unit(*distributions: Distribution) -> DisplayUnit:
    """Return the unit in which the largest of these values, all lengths or all angles, reads well.

    Millimetres or milliradians from 0.1 to 10,000; a thousandth, a millionth … of them for smaller values.
    """
    return _unit_for(max(max(abs(one.min), abs(one.max)) for one in distributions), distributions[0].quantity)


def histogram(
    distribution: Distribution,
    *,
    title: str = "",
    unit: DisplayUnit | None = None,
    seed: int | None = None,
    specifications: Sequence[SpecificationResult] = (),
    axes: Axes | None = None,
) -> Axes:
    """Draw the probability density with mean, quantiles (and their intervals) and limits marked.

    Parameters
    ----------
    distribution
        What is drawn.
    title
        Above the figure, wrapped to its width.
    unit
        Of the values; chosen from them if None.
    seed
        Named in the caption if given, together with N.
    specifications
        Those of this quantity are marked, others are left out.
    axes
        Where to draw. None makes a figure of its own with title, legend and caption; on given axes the
        lines carry labels, and legend and caption are the caller's.
    """
    return _alone_or_on(axes, distribution, _draw_histogram, title, unit, seed, specifications)


def cumulative(
    distribution: Distribution,
    *,
    title: str = "",
    unit: DisplayUnit | None = None,
    seed: int | None = None,
    specifications: Sequence[SpecificationResult] = (),
    axes: Axes | None = None,
) -> Axes:
    """Draw the cumulative distribution, marked as the histogram is; arguments as in `histogram`."""
    return _alone_or_on(axes, distribution, _draw_cumulative, title, unit, seed, specifications)


def figure_position(
    summary: Summary, *, title: str = "Position error", seed: int | None = None, unit: DisplayUnit | None = None
) -> Figure:
    """Return the distribution of |d|, density above and cumulative below (the paper's figure 5), 85 mm wide.

    Parameters
    ----------
    summary
        What is drawn; its specifications of ``position.norm`` are marked.
    title
        Above the figure, wrapped to its width.
    seed
        Named in the caption if given.
    unit
        Of the values; chosen from them if None.
    """
    return _figure_of_norm(summary, summary.position.norm, title, seed, unit)


def figure_attitude(
    summary: Summary, *, title: str = "Attitude error", seed: int | None = None, unit: DisplayUnit | None = None
) -> Figure:
    """Return the distribution of |δ| (the paper's figure 6); arguments as in `figure_position`."""
    return _figure_of_norm(summary, summary.attitude.norm, title, seed, unit)


def figure_components(
    summary: Summary,
    *,
    title: str = "Components of the pose error, base axes",
    seed: int | None = None,
    position_unit: DisplayUnit | None = None,
    attitude_unit: DisplayUnit | None = None,
) -> Figure:
    """Return the densities of dx, dy, dz, δx, δy, δz as two rows of three, 174 mm wide.

    Parameters
    ----------
    summary
        What is drawn; its specifications of components are marked.
    title
        Above the figure, wrapped to its width.
    seed
        Named in the caption if given.
    position_unit, attitude_unit
        Of the values; chosen from them if None.
    """
    with _style():
        figure = _figure(DOUBLE_COLUMN)
        grid = figure.subplots(2, 3)
        rows = ((summary.position, position_unit), (summary.attitude, attitude_unit))
        entries: dict[str, Any] = {}
        for row, (vector, given) in zip(grid, rows, strict=True):
            parts = (vector.x, vector.y, vector.z)
            unit = given or display_unit(*parts)
            for axes, part in zip(row, parts, strict=True):
                _draw_histogram(axes, part, unit, summary.specifications)
                axes.set_title(_moments(part, unit), fontsize=7)
                for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                    entries.setdefault(label.split(":")[0], handle)
        _finish(figure, 95.0, title, list(entries), list(entries.values()), summary, seed, columns=4)
    return figure


def save(figure: Figure, path_without_suffix: str | os.PathLike[str]) -> tuple[Path, Path]:
    """Write a figure as PNG (200 dpi) and SVG, the same bytes for the same figure, and return both paths.

    Both are written beside their places first and then moved there, so neither is ever seen half-written.

    Raises
    ------
    OutputError
        The folder does not exist or cannot be written to.
    """
    base = Path(path_without_suffix)
    targets = (base.with_name(f"{base.name}.png"), base.with_name(f"{base.name}.svg"))
    temporaries = [target.with_name(f".{target.name}.{os.getpid()}.part") for target in targets]
    metadata = ({"Software": None}, {"Date": None, "Creator": "precision-pin"})
    try:
        with _style():
            for target, temporary, entries in zip(targets, temporaries, metadata, strict=True):
                figure.savefig(temporary, dpi=DOTS_PER_INCH, format=target.suffix[1:], metadata=entries)
        for target, temporary in zip(targets, temporaries, strict=True):
            temporary.replace(target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"cannot write {targets[0]} and .svg: {reason}; give a writable folder") from None
    finally:
        for temporary in temporaries:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
    return targets


# figures and text --------------------------------------------------------------------------------------


@contextmanager
def _style() -> Iterator[None]:
    with mpl.rc_context(_STYLE):
        yield


def _figure(width: float) -> Figure:
    figure = Figure(figsize=(width / MILLIMETRES_PER_INCH, 1.0), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _figure_of_norm(
    summary: Summary, norm: Distribution, title: str, seed: int | None, unit: DisplayUnit | None
) -> Figure:
    with _style():
        figure = _figure(SINGLE_COLUMN)
        upper, lower = figure.subplots(2, 1, sharex=True)
        _draw_histogram(upper, norm, unit or display_unit(norm), summary.specifications)
        _draw_cumulative(lower, norm, unit or display_unit(norm), summary.specifications)
        upper.set_xlabel("")
        handles, labels = upper.get_legend_handles_labels()
        _finish(figure, 85.0, title, labels, handles, norm, seed, columns=1)
    return figure


def _alone_or_on(
    axes: Axes | None,
    distribution: Distribution,
    draw: _Draw,
    title: str,
    unit: DisplayUnit | None,
    seed: int | None,
    specifications: Sequence[SpecificationResult],
) -> Axes:
    with _style():
        own = axes if axes is not None else _figure(SINGLE_COLUMN).subplots()
        draw(own, distribution, unit or display_unit(distribution), specifications)
        if axes is not None:
            own.set_title(title)
            return own
        handles, labels = own.get_legend_handles_labels()
        figure = own.get_figure(root=True)
        assert figure is not None
        _finish(figure, 50.0, title, labels, handles, distribution, seed, columns=1)
    return own


def _finish(
    figure: Figure,
    height: float,
    title: str,
    labels: Sequence[str],
    handles: Sequence[Any],
    counted: Distribution | Summary,
    seed: int | None,
    *,
    columns: int,
) -> None:
    """Add title, legend and caption outside the axes, where they cover nothing, and set the height (mm)."""
    width = figure.get_size_inches()[0]
    characters = int(width * MILLIMETRES_PER_INCH * _CHARACTERS_PER_MILLIMETRE)
    caption = f"N = {counted.samples:,}" + ("" if seed is None else f", seed {seed}")
    caption += f"; intervals at {100 * counted.confidence:g} % confidence"
    above = textwrap.wrap(title, characters)
    below = textwrap.wrap(caption, characters)
    if above:
        figure.suptitle("\n".join(above))
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=columns,
        frameon=False,
        title="\n".join(below),
        handlelength=2.6,
    )
    lines = len(above) + len(below) + sum(1 + label.count("\n") for label in labels) / columns
    figure.set_size_inches(width, (height + lines * _LINE_HEIGHT) / MILLIMETRES_PER_INCH)


def _ladder(quantity: str) -> tuple[DisplayUnit, ...]:
    return _LENGTHS if quantity.startswith("position") else _ANGLES


def _unit_for(size: float, quantity: str) -> DisplayUnit:
    ladder = _ladder(quantity)
    if size == 0:
        return ladder[1]
    if size >= 10:
        return ladder[0]
    return next((unit for unit in ladder[1:] if size * unit.per_si >= 0.1), ladder[-1])


def _text(value: float | None, half_width: float | None, unit: DisplayUnit) -> str:
    if value is None or half_width is None:
        return "not resolved"
    most = 12 if half_width > 0 else 6
    return f"{format_supported(value * unit.per_si, half_width * unit.per_si, most=most)} {unit.name}"


def _moments(distribution: Distribution, unit: DisplayUnit) -> str:
    """Return mean and standard deviation, as far as they are resolved, for a panel's title."""
    mean = _text(distribution.mean, distribution.half_width("mean"), unit)
    std, half_width = distribution.std, distribution.half_width("std")
    small = std is not None and std * unit.per_si < 1e-3
    std_unit = _unit_for(std, distribution.quantity) if std is not None and small else unit
    return f"mean {mean}\nstd {_text(std, half_width, std_unit)}"


# drawing -----------------------------------------------------------------------------------------------


@final
@dataclass(frozen=True)
class _Ruler:
    """The horizontal axis: drawn = (value − origin) · unit.per_si."""

    unit: DisplayUnit
    origin: float
    label: str

    def __call__(self, value: float) -> float:
        return (value - self.origin) * self.unit.per_si


def _ruler(distribution: Distribution, unit: DisplayUnit) -> _Ruler:
    """Return the axis in this unit; where the values hardly differ, one of differences from a round number."""
    symbol = _SYMBOLS[distribution.quantity]
    span = distribution.max - distribution.min
    size = max(abs(distribution.min), abs(distribution.max))
    if span == 0 or span > _SMALLEST_RATIO * size:
        return _Ruler(unit, 0.0, f"{symbol} [{unit.name}]")
    place = math.floor(math.log10(span * unit.per_si))
    rounded = round(distribution.mean * unit.per_si, -place)
    fine = _unit_for(span, distribution.quantity)
    sign = "−" if rounded >= 0 else "+"
    offset = f"{abs(rounded):.{max(0, -place)}f}"
    return _Ruler(fine, rounded / unit.per_si, f"{symbol} {sign} {offset} {unit.name} [{fine.name}]")


def _draw_histogram(
    axes: Axes, distribution: Distribution, unit: DisplayUnit, specifications: Sequence[SpecificationResult]
) -> None:
    bars = distribution.histogram()
    ruler = _ruler(distribution, unit)
    if bars is not None:
        density = bars.density / ruler.unit.per_si
        edges = (bars.edges - ruler.origin) * ruler.unit.per_si
        axes.stairs(density, edges, fill=True, color=SKY, alpha=0.55, linewidth=0)
        axes.set_ylim(0, 1.08 * density.max())
        axes.yaxis.set_major_locator(_ticks())
    else:
        note = "all samples are equal" if distribution.samples > 1 else "one sample"
        axes.text(0.03, 0.9, note, transform=axes.transAxes)
        axes.set_ylim(0, 1)
        axes.set_yticks([])
    axes.set_ylabel(f"density [1/{ruler.unit.name}]")
    _mark(axes, distribution, unit, ruler, specifications)


def _draw_cumulative(
    axes: Axes, distribution: Distribution, unit: DisplayUnit, specifications: Sequence[SpecificationResult]
) -> None:
    ruler = _ruler(distribution, unit)
    values = np.union1d(np.linspace(*_range(distribution, ruler), 600), [distribution.min, distribution.max])
    axes.plot(
        (values - ruler.origin) * ruler.unit.per_si,
        distribution.cumulative(values),
        color=BLUE,
        drawstyle="steps-post",
    )
    axes.set_ylim(0, 1.03)
    axes.set_ylabel("cumulative probability")
    _mark(axes, distribution, unit, ruler, specifications)


def _mark(
    axes: Axes,
    distribution: Distribution,
    unit: DisplayUnit,
    ruler: _Ruler,
    specifications: Sequence[SpecificationResult],
) -> None:
    """Draw mean, quantiles with their intervals and limits as vertical lines, and set the axis."""
    mean = _text(distribution.mean, distribution.half_width("mean"), unit)
    axes.axvline(ruler(distribution.mean), color=BLACK, linestyle="-", label=f"mean: {mean}")
    marked = _MARKED_OF_NORM if distribution.is_norm else _MARKED_OF_COMPONENT
    for p, (colour, dashes) in zip(marked, _QUANTILE_LINES, strict=True):
        value, interval = distribution.quantile(p), distribution.quantile_interval(p)
        label = f"{100 * p:g} % quantile: {_text(value, distribution.half_width(p), unit)}"
        if value is None or interval is None:
            axes.plot([], [], color=colour, linestyle=dashes, label=label)
            continue
        axes.axvspan(ruler(interval[0]), ruler(interval[1]), color=colour, alpha=0.2, linewidth=0)
        axes.axvline(ruler(value), color=colour, linestyle=dashes, label=label)
    low, high = _range(distribution, ruler)
    shown = [low, high]
    for result in specifications:
        if result.quantity == distribution.quantity:
            shown += _mark_limit(axes, distribution, unit, ruler, result)
    axes.set_xlim(ruler(min(shown)), ruler(max(shown)))
    axes.xaxis.set_major_locator(_ticks())
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.set_xlabel(ruler.label)


def _mark_limit(
    axes: Axes, distribution: Distribution, unit: DisplayUnit, ruler: _Ruler, result: SpecificationResult
) -> list[float]:
    """Draw a limit where it is near the data, name it either way, and return what the axis has to show."""
    label = f"limit {result.limit * unit.per_si:.6g} {unit.name}"
    low, high = _range(distribution, ruler)
    reach = _FARTHEST_LIMIT * (high - low)
    sides = (result.limit,) if distribution.is_norm else (-result.limit, result.limit)
    drawn = [side for side in sides if low - reach <= side <= high + reach]
    if not drawn:
        label += " (beyond this axis)"
        axes.plot([], [], color=GREEN, linestyle=_LIMIT_DASHES, linewidth=1.4)
    label += f":\n{_percentages(result)}"
    for side in drawn:
        axes.axvline(ruler(side), color=GREEN, linestyle=_LIMIT_DASHES, linewidth=1.4)
    axes.get_lines()[-1].set_label(label)
    margin = 0.03 * (high - low)
    return [side + math.copysign(margin, side) for side in drawn]


def _percentages(result: SpecificationResult) -> str:
    """Return the share inside and its interval in per cent, the interval's ends rounded outwards."""
    lower, upper = result.interval
    half_width = 100 * max(result.probability - lower, upper - result.probability)
    share = format_supported(100 * result.probability, half_width, most=12)
    decimals = max(0, math.ceil(-math.log10(half_width))) + 1
    step = 10.0**-decimals
    low = max(math.floor(100 * lower / step) * step, 0.0)
    high = min(math.ceil(100 * upper / step) * step, 100.0)
    return f"{share} % inside ({low:.{decimals}f} to {high:.{decimals}f} %)"


def _range(distribution: Distribution, ruler: _Ruler) -> tuple[float, float]:
    span = distribution.max - distribution.min
    if span > 0:
        margin = 0.05 * span
    else:
        margin = 0.5 * abs(distribution.max) or 1 / ruler.unit.per_si
    return distribution.min - margin, distribution.max + margin


def _ticks() -> MaxNLocator:
    return MaxNLocator(nbins=_MOST_TICKS, steps=[1, 2, 2.5, 5, 10], min_n_ticks=2)
