"""Pictures of the pose error's distribution: histograms and cumulative curves.

Functions take a `Summary` or one of its `Distribution`s and return matplotlib objects made without pyplot,
so no global state is touched. Text is 7 pt or larger when a figure is printed at its own size (85 mm wide
for one quantity, 174 mm for the six components), colours are those of Okabe and Ito (2008), which stay apart
for colour-blind readers, and every line differs in its dashes as well.
"""

from __future__ import annotations

import os
import tempfile
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
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

_STYLE: Final[dict[str, Any]] = {
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
_DASHES: Final = ((0, (4, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
_QUANTILE_COLOURS: Final = (VERMILION, PURPLE, GREEN)
_MARKED_OF_NORM: Final = (0.95, 0.9973)
_MARKED_OF_COMPONENT: Final = (0.05, 0.95)
# a limit farther from the data than this share of their span is named, not drawn
_FARTHEST_LIMIT: Final = 1.0
_CHARACTERS_PER_MILLIMETRE: Final = 0.62


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
)
_ANGLES: Final = (
    DisplayUnit("rad", 1.0),
    DisplayUnit("mrad", 1e3),
    DisplayUnit("µrad", 1e6),
    DisplayUnit("nrad", 1e9),
)


def display_unit(*distributions: Distribution) -> DisplayUnit:
    """Return the unit in which the largest of these values, all lengths or all angles, reads well.

    Millimetres or milliradians from 0.1 to 10,000; a thousandth or a millionth of them for smaller values.
    """
    units = _LENGTHS if distributions[0].quantity.startswith("position") else _ANGLES
    largest = max(max(abs(one.min), abs(one.max)) for one in distributions)
    if largest == 0:
        return units[1]
    for unit in units[1:]:
        if largest * unit.per_si >= 0.1:
            return units[0] if unit is units[1] and largest * unit.per_si >= 1e4 else unit
    return units[-1]


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
        Of the horizontal axis; chosen from the values if None.
    seed
        Named in the caption if given, together with N.
    specifications
        Those of this quantity are marked, others are left out.
    axes
        Where to draw. None makes a figure of its own with title, legend and caption; on given axes the
        lines carry labels, and legend and caption are the caller's.
    """
    unit = unit or display_unit(distribution)
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
    unit = unit or display_unit(distribution)
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
        Of the horizontal axes; chosen from the values if None.
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
        Of the horizontal axes; chosen from the values if None.
    """
    with _style():
        figure = _figure(DOUBLE_COLUMN, 105.0)
        grid = figure.subplots(2, 3)
        rows = ((summary.position, position_unit), (summary.attitude, attitude_unit))
        for row, (vector, given) in zip(grid, rows, strict=True):
            parts = (vector.x, vector.y, vector.z)
            unit = given or display_unit(*parts)
            for axes, part in zip(row, parts, strict=True):
                _draw_histogram(axes, part, unit, summary.specifications)
                axes.set_title(_moments(part, unit), fontsize=7)
        handles: dict[str, Line2D] = {}
        for axes in grid.flat:
            for line in axes.get_lines():
                kind = str(line.get_label()).split(":")[0]
                handles.setdefault(kind, line)
        _finish(figure, title, tuple(handles), tuple(handles.values()), summary, seed, columns=4)
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
    targets = (base.with_name(base.name + ".png"), base.with_name(base.name + ".svg"))
    written: list[Path] = []
    try:
        for target in targets:
            handle, name = tempfile.mkstemp(dir=base.parent, prefix=f".{base.name}-", suffix=target.suffix)
            os.close(handle)
            written.append(Path(name))
            metadata = {"Date": None, "Creator": "precision-pin"} if target.suffix == ".svg" else {"Software": None}
            with _style():
                figure.savefig(name, dpi=DOTS_PER_INCH, format=target.suffix[1:], metadata=metadata)
            Path(name).chmod(0o666 & ~_umask())
        for temporary, target in zip(written, targets, strict=True):
            temporary.replace(target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"cannot write {targets[0]} and .svg: {reason}; give a writable folder") from None
    finally:
        for temporary in written:
            temporary.unlink(missing_ok=True)
    return targets


# drawing -----------------------------------------------------------------------------------------------


@contextmanager
def _style() -> Iterator[None]:
    with mpl.rc_context(_STYLE):
        yield


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width / MILLIMETRES_PER_INCH, height / MILLIMETRES_PER_INCH), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _figure_of_norm(
    summary: Summary, norm: Distribution, title: str, seed: int | None, unit: DisplayUnit | None
) -> Figure:
    unit = unit or display_unit(norm)
    with _style():
        figure = _figure(SINGLE_COLUMN, 110.0)
        upper, lower = figure.subplots(2, 1, sharex=True)
        _draw_histogram(upper, norm, unit, summary.specifications)
        _draw_cumulative(lower, norm, unit, summary.specifications)
        upper.set_xlabel("")
        handles, labels = upper.get_legend_handles_labels()
        _finish(figure, title, labels, handles, norm, seed, columns=1)
    return figure


def _alone_or_on(
    axes: Axes | None,
    distribution: Distribution,
    draw: Any,
    title: str,
    unit: DisplayUnit,
    seed: int | None,
    specifications: Sequence[SpecificationResult],
) -> Axes:
    with _style():
        if axes is not None:
            draw(axes, distribution, unit, specifications)
            if title:
                axes.set_title(title)
            return axes
        figure = _figure(SINGLE_COLUMN, 75.0)
        own = figure.subplots()
        draw(own, distribution, unit, specifications)
        handles, labels = own.get_legend_handles_labels()
        _finish(figure, title, labels, handles, distribution, seed, columns=1)
    return own


def _finish(
    figure: Figure,
    title: str,
    labels: Sequence[str],
    handles: Sequence[Any],
    counted: Distribution | Summary,
    seed: int | None,
    *,
    columns: int,
) -> None:
    """Add title, legend and caption outside the axes, where they cannot cover anything."""
    width = figure.get_size_inches()[0] * MILLIMETRES_PER_INCH
    characters = int(width * _CHARACTERS_PER_MILLIMETRE)
    if title:
        figure.suptitle("\n".join(textwrap.wrap(title, characters)))
    caption = f"N = {counted.samples:,}" + ("" if seed is None else f", seed {seed}")
    caption += f"; intervals at {100 * counted.confidence:g} % confidence"
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=columns,
        frameon=False,
        title=caption,
        handlelength=2.6,
    )


def _draw_histogram(
    axes: Axes, distribution: Distribution, unit: DisplayUnit, specifications: Sequence[SpecificationResult]
) -> None:
    bars = distribution.histogram()
    if bars is not None:
        axes.stairs(bars.density / unit.per_si, bars.edges * unit.per_si, fill=True, color=SKY, alpha=0.55, linewidth=0)
        axes.set_ylim(0, 1.08 * bars.density.max() / unit.per_si)
        axes.yaxis.set_major_locator(MaxNLocator(nbins=5))
    else:
        axes.set_ylim(0, 1)
        axes.set_yticks([])
    axes.set_ylabel(f"density [1/{unit.name}]")
    _mark(axes, distribution, unit, specifications)


def _draw_cumulative(
    axes: Axes, distribution: Distribution, unit: DisplayUnit, specifications: Sequence[SpecificationResult]
) -> None:
    span = distribution.max - distribution.min
    reach = span if span > 0 else max(abs(distribution.max), 1e-12)
    values = np.linspace(distribution.min - 0.02 * reach, distribution.max + 0.02 * reach, 600)
    axes.plot(
        values * unit.per_si, distribution.cumulative(values), color=BLUE, label="_cumulative", drawstyle="steps-post"
    )
    axes.set_ylim(0, 1.03)
    axes.set_ylabel("cumulative probability")
    _mark(axes, distribution, unit, specifications)


def _mark(
    axes: Axes, distribution: Distribution, unit: DisplayUnit, specifications: Sequence[SpecificationResult]
) -> None:
    """Draw mean, quantiles with their intervals and limits as vertical lines, and set the axis."""

    def text(statistic: str | float, value: float | None) -> str:
        half_width = distribution.half_width(statistic)
        if value is None or half_width is None:
            return "not resolved"
        return f"{format_supported(value * unit.per_si, half_width * unit.per_si)} {unit.name}"

    mean = text("mean", distribution.mean)
    axes.axvline(distribution.mean * unit.per_si, color=BLACK, linestyle="-", label=f"mean: {mean}")
    marked = _MARKED_OF_NORM if distribution.is_norm else _MARKED_OF_COMPONENT
    for p, colour, dashes in zip(marked, _QUANTILE_COLOURS, _DASHES, strict=False):
        value = distribution.quantile(p)
        interval = distribution.quantile_interval(p)
        label = f"{100 * p:g} % quantile: {text(p, value)}"
        if value is None or interval is None:
            axes.plot([], [], color=colour, linestyle=dashes, label=label)
            continue
        axes.axvspan(interval[0] * unit.per_si, interval[1] * unit.per_si, color=colour, alpha=0.2, linewidth=0)
        axes.axvline(value * unit.per_si, color=colour, linestyle=dashes, label=label)
    shown = _range(distribution)
    for result in specifications:
        if result.quantity == distribution.quantity:
            shown = _mark_limit(axes, distribution, unit, result, shown)
    axes.set_xlim(shown[0] * unit.per_si, shown[1] * unit.per_si)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5, min_n_ticks=2))
    axes.set_xlabel(f"{_SYMBOLS[distribution.quantity]} [{unit.name}]")


def _range(distribution: Distribution) -> tuple[float, float]:
    span = distribution.max - distribution.min
    margin = 0.05 * span if span > 0 else max(0.5 * abs(distribution.max), 1e-9)
    return distribution.min - margin, distribution.max + margin


def _mark_limit(
    axes: Axes,
    distribution: Distribution,
    unit: DisplayUnit,
    result: SpecificationResult,
    shown: tuple[float, float],
) -> tuple[float, float]:
    """Draw a limit where it is near the data, widen the range to hold it, and label it either way."""
    low, high = (100 * end for end in result.interval)
    place = 100 * max(result.probability - result.interval[0], result.interval[1] - result.probability)
    percent = format_supported(100 * result.probability, place, most=7)
    limit = f"{result.limit * unit.per_si:.6g} {unit.name}"
    label = f"limit {limit}: {percent} % inside ({low:.4g} to {high:.4g} %)"
    lower, upper = _range(distribution)
    reach = _FARTHEST_LIMIT * (upper - lower)
    sides = (result.limit,) if distribution.is_norm else (-result.limit, result.limit)
    drawn = [side for side in sides if lower - reach <= side <= upper + reach]
    for index, side in enumerate(drawn):
        axes.axvline(
            side * unit.per_si,
            color=GREEN,
            linestyle=_DASHES[2],
            linewidth=1.4,
            label=label if index == 0 else "_limit",
        )
        margin = 0.03 * (upper - lower)
        shown = min(shown[0], side - margin), max(shown[1], side + margin)
    if not drawn:
        axes.plot([], [], color=GREEN, linestyle=_DASHES[2], linewidth=1.4, label=f"{label}; out of range")
    return shown


def _moments(distribution: Distribution, unit: DisplayUnit) -> str:
    """Return mean and standard deviation, as far as they are resolved, for a panel's title."""
    parts = []
    for name, value in (("mean", distribution.mean), ("std", distribution.std)):
        half_width = distribution.half_width(name)
        if value is not None and half_width is not None:
            parts.append(f"{name} {format_supported(value * unit.per_si, half_width * unit.per_si)}")
        else:
            parts.append(f"{name} not resolved")
    return f"{_SYMBOLS[distribution.quantity]}: " + ", ".join(parts)


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
