"""Figures of the pose error's distribution: histograms and cumulative curves.

They take a `Summary` or a `Distribution` and return matplotlib objects made without pyplot, so no global state is
touched. Text is at least 7 pt at the figure's own size (85 mm wide for one quantity, 174 mm for six components).
Colours are those of Okabe and Ito (2008), safe for colour-blind readers, and lines also differ in dashes.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnknownNameError, visible
from precision_pin.base.files import write_files
from precision_pin.base.written_units import WrittenUnit
from precision_pin.model.pose_model import PoseModel
from precision_pin.render import draw_distribution, figure_style
from precision_pin.render.tables import bounded, pose_labels, symbol
from precision_pin.sampling.clouds import sample_errors
from precision_pin.sampling.poses_result import LEVELS, PosesResult
from precision_pin.statistics import QUANTITIES, Distribution, SpecificationResult, Summary, format_share
from precision_pin.statistics.limits import LIMITED

DOTS_PER_INCH: Final = 200
_POINTS: Final = 5_000
"""Robots drawn in a zone: more hide the circle."""
_ACROSS: Final = ("position.lateral", "position.zone")

_Draw = Callable[[Axes, Distribution, WrittenUnit, Sequence[SpecificationResult]], None]


def figures_of(summary: Summary, seed: int, arm: str) -> dict[str, Figure]:
    """Return the figures of a Monte Carlo result by name: ``position``, ``attitude`` and ``components``."""
    return {
        "position": figure_position(summary, title=f"Position error of {arm}", seed=seed),
        "attitude": figure_attitude(summary, title=f"Attitude error of {arm}", seed=seed),
        "components": figure_components(summary, title=f"Components of the pose error of {arm}, base axes", seed=seed),
    }


def plot(summary: Summary, seed: int, arm: str, quantity: str, axes: Axes | None) -> Axes | Figure:
    """Implement :meth:`precision_pin.sampling.result.MonteCarloResult.plot`."""
    names = ("position", "attitude", "components", *QUANTITIES)
    if quantity not in names:
        raise UnknownNameError("quantity", quantity, names)
    if axes is None and quantity not in QUANTITIES:
        return figures_of(summary, seed, arm)[quantity]
    if quantity == "components":
        raise InputError(
            "the six components have a separate figure; plot one of them on given axes, such as position.x"
        )
    panel = histogram(
        summary.distribution(quantity if quantity in QUANTITIES else f"{quantity}.norm"),
        title=f"{symbol(quantity if quantity in QUANTITIES else f'{quantity}.norm')} of {arm}",
        seed=seed,
        specifications=summary.specifications,
        axes=axes,
    )
    return figure_style.figure_of(panel) if axes is None else panel


def histogram(
    distribution: Distribution,
    *,
    title: str = "",
    unit: WrittenUnit | None = None,
    seed: int | None = None,
    specifications: Sequence[SpecificationResult] = (),
    axes: Axes | None = None,
    draw: _Draw = draw_distribution.draw_histogram,
) -> Axes:
    """Draw the probability density with mean, quantiles (and their intervals) and limits."""
    with figure_style.style():
        ax = axes if axes is not None else figure_style.new_figure(figure_style.SINGLE_COLUMN).subplots()
        draw(ax, distribution, unit or draw_distribution.display_unit(distribution), specifications)
        if axes is not None:
            ax.set_title(title)
            return ax
        figure_style.frame(figure_style.figure_of(ax), [ax], title, _caption(distribution, seed), 50.0, 1)
    return ax


cumulative = partial(histogram, draw=draw_distribution.draw_cumulative)
"""Draw the cumulative distribution; arguments and marks as for `histogram`."""


def figure_position(
    summary: Summary, *, title: str = "Position error", seed: int | None = None, unit: WrittenUnit | None = None
) -> Figure:
    """Return the figure of |d|, 85 mm wide: density above, cumulative below (the paper's figure 5)."""
    return _figure_of_norm(summary, summary.position.norm, title, seed, unit)


def figure_attitude(
    summary: Summary, *, title: str = "Attitude error", seed: int | None = None, unit: WrittenUnit | None = None
) -> Figure:
    """Return the figure of |δ|, as `figure_position` (the paper's figure 6)."""
    return _figure_of_norm(summary, summary.attitude.norm, title, seed, unit)


def figure_components(
    summary: Summary,
    *,
    title: str = "Components of the pose error, base axes",
    seed: int | None = None,
    position_unit: WrittenUnit | None = None,
    attitude_unit: WrittenUnit | None = None,
) -> Figure:
    """Return the densities of dx, dy, dz, δx, δy, δz as two rows of three, 174 mm wide."""
    with figure_style.style():
        figure = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        grid = figure.subplots(2, 3)
        rows = ((summary.position, position_unit), (summary.attitude, attitude_unit))
        for row, (vector, forced_unit) in zip(grid, rows, strict=True):
            parts = (vector.x, vector.y, vector.z)
            unit = forced_unit or draw_distribution.display_unit(*parts)
            for axes, part in zip(row, parts, strict=True):
                draw_distribution.draw_histogram(axes, part, unit, summary.specifications)
                axes.set_title(draw_distribution.moments_text(part, unit), fontsize=7)
            shared = draw_distribution.share_scale(list(row), parts, unit)
            for axes, is_shared in zip(row, shared, strict=True):
                if not is_shared and any(shared):
                    axes.set_title(f"{axes.get_title()}\nown scale", fontsize=7)
        for axes in grid.flat:
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                handle.set_label(label.split(":")[0])
        figure_style.frame(figure, grid.flat, title, _caption(summary, seed), 95.0)
    return figure


def figures_across(
    at: PoseModel, arm: str, results: Sequence[SpecificationResult], samples: int, seed: int, model: Any, pose: int = 0
) -> dict[str, Figure]:
    """Return the figure ``zone`` of position errors seen along the tool's z, 85 mm wide, if a limit is across it.

    Points are of the first robots, in tool axes, mm, outside the narrowest zone in another colour; a circle is a limit
    of ``lateral`` or ``zone``, with the fraction of all samples inside.
    """
    limits = [one for one in results if one.quantity in _ACROSS]
    if not limits:
        return {}
    errors = sample_errors(at, min(samples, _POINTS), seed=seed, model=model, pose=pose, progress=lambda _: None)
    return {"zone": figure_across(at.posture.tool_axes.T @ errors[:3], limits, title=f"Zone of {arm}", seed=seed)}


def figure_across(
    points: Array, limits: Sequence[SpecificationResult], *, title: str = "Zone", seed: int | None = None
) -> Figure:
    """Return the figure of position errors ``(3, N)`` in tool axes within limits of ``lateral`` and ``zone``."""
    radii = [one.limit / LIMITED[one.quantity].factor for one in limits]
    across = np.hypot(points[0], points[1])
    unit = WrittenUnit.of_axis("position", max(*radii, float(across.max())))
    is_inside = across <= min(radii)
    with figure_style.style():
        figure = figure_style.new_figure(figure_style.SINGLE_COLUMN)
        axes = figure.subplots()
        for mask, colour in ((is_inside, draw_distribution.BLUE), (~is_inside, draw_distribution.VERMILION)):
            axes.plot(
                *(unit.per_si * points[:2, mask]), ".", color=colour, markersize=1.5, alpha=0.5, markeredgewidth=0
            )
        axes.plot([0], [0], "+", color=draw_distribution.BLACK, markersize=7)
        turns = np.linspace(0, 2 * np.pi, 361)
        for one, radius in zip(limits, radii, strict=True):
            share, low, high = format_share(one.probability, one.interval, one.required)
            axes.plot(
                unit.per_si * radius * np.cos(turns), unit.per_si * radius * np.sin(turns), linestyle=_LIMIT_DASHES,
                color=draw_distribution.LIMIT_COLOURS.get(one.verdict, draw_distribution.BLACK), linewidth=1.2,
                label=f"{bounded(one.quantity, one.limit)}: {share} % inside ({low} to {high} %)",
            )  # fmt: skip
        axes.set_aspect("equal", "datalim")
        axes.set_xlabel(f"tool x [{unit.name}]")
        axes.set_ylabel(f"tool y [{unit.name}]")
        points_text = f"{points.shape[1]:,} robots" + ("" if seed is None else f", seed {seed}")
        caption = f"{points_text}, seen along the tool's z; +: nominal axis"
        figure_style.frame(figure, [axes], title, caption, 85.0, 1)
    return figure


def save(figure: Figure, path_without_suffix: str | os.PathLike[str]) -> tuple[Path, Path]:
    """Write a figure as PNG (200 dpi) and SVG, both or neither, reproducibly to the byte, and return both paths."""
    base = Path(path_without_suffix)
    metadata: dict[str, dict[str, str | None]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": "precision-pin"},
    }
    files: dict[str | os.PathLike[str], bytes] = {}
    for suffix, entries in metadata.items():
        stream = io.BytesIO()
        with figure_style.style():
            figure.savefig(stream, dpi=DOTS_PER_INCH, format=suffix, metadata=entries)
        files[base.with_name(f"{base.name}.{suffix}")] = stream.getvalue()
    write_files(files)
    png, svg = map(Path, files)
    return png, svg


# figures --------------------------------------------------------------------------------


def _figure_of_norm(
    summary: Summary, norm: Distribution, title: str, seed: int | None, unit: WrittenUnit | None
) -> Figure:
    unit = unit or draw_distribution.display_unit(norm)
    with figure_style.style():
        figure = figure_style.new_figure(figure_style.SINGLE_COLUMN)
        upper, lower = figure.subplots(2, 1, sharex=True)
        draw_distribution.draw_histogram(upper, norm, unit, summary.specifications)
        draw_distribution.draw_cumulative(lower, norm, unit, summary.specifications)
        upper.set_xlabel("")
        figure_style.frame(figure, [upper], title, _caption(norm, seed), 85.0, 1)
    return figure


def _caption(counted: Distribution | Summary, seed: int | None) -> str:
    origin = "" if seed is None else f", seed {seed}"
    return f"N = {counted.samples:,}{origin}; intervals at {100 * counted.confidence:g} % confidence"


_MOST_NAMED: Final = 24
"""Most poses named below the axis; beyond, they are numbered."""
_MOST_LETTERS: Final = 18  # of a name on the axis
_MOST_LEVEL: Final = 80
"""Most letters of all names together without turning the labels."""
_LIMIT_DASHES: Final = (0, (6, 1.5, 1.2, 1.5))
_STYLES: Final = ((draw_distribution.SKY, "v"), (draw_distribution.BLUE, "o"), (draw_distribution.PURPLE, "^"))
"""Colour and marker of each quantile."""


def plot_poses(result: PosesResult, quantity: str, axes: Axes | None) -> Axes | Figure:
    """Implement :meth:`precision_pin.sampling.poses_result.PosesResult.plot`."""
    names = ("position", "attitude")
    if quantity not in names:
        raise UnknownNameError("quantity", quantity, names)
    title = f"{symbol(f'{quantity}.norm')} of {visible(result.robot, 60)} at {result.poses:,} poses"
    with figure_style.style():
        if axes is not None:
            _draw_poses(axes, result, names.index(quantity), quantity)
            axes.set_title(title)
            return axes
        figure = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        panel = figure.subplots()
        _draw_poses(panel, result, names.index(quantity), quantity)
        caption = f"N = {result.samples:,} at each pose, seed {result.seed}; "
        caption += f"bars: {100 * result.confidence:g} % intervals"
        figure_style.frame(figure, [panel], title, caption, 80.0, 3)
    return figure


def _draw_poses(axes: Axes, result: PosesResult, norm: int, vector: str) -> None:
    quantity = f"{vector}.norm"
    unit = WrittenUnit.of_axis(quantity, float(result.norm_max[norm].max()))
    labels = pose_labels(result.names)
    places = np.arange(1, result.poses + 1)
    for rank, (level, (colour, marker)) in enumerate(zip(LEVELS, _STYLES, strict=True)):
        intervals, quantiles = result.quantile_interval[rank, norm], result.quantile[rank, norm]
        value = quantiles * unit.per_si
        # a sketch's bin may end at its quantile: bars are never negative
        bars = np.maximum(np.abs(intervals * unit.per_si - value), 0.0)
        axes.errorbar(
            places, value, yerr=bars, color=colour, linestyle="none", marker=marker, markersize=2.5,
            elinewidth=0.6, capsize=1.2, label=f"{100 * level:g} % of robots" if rank else "median",
        )  # fmt: skip
    specs = [spec for spec in result.specification_results if spec.results[0].quantity.startswith(vector)]
    for spec in specs:
        specified = spec.results[0]
        if specified.quantity == quantity:
            axes.axhline(
                specified.limit * unit.per_si,
                color=draw_distribution.LIMIT_COLOURS.get(spec.verdict, draw_distribution.BLACK),
                linestyle=_LIMIT_DASHES,
                linewidth=1.2,
                label=f"limit {unit.short(specified.limit)} for {100 * specified.required:.6g} %",
            )
    unmet = [place for place in places if any(spec.results[place - 1].verdict == "not met" for spec in specs)]
    for place in unmet:
        axes.axvspan(place - 0.5, place + 0.5, color=draw_distribution.VERMILION, alpha=0.15, linewidth=0)
    if unmet:
        axes.fill_between(
            [], [], [], color=draw_distribution.VERMILION, alpha=0.15, linewidth=0, label="specification not met"
        )
    axes.set_xlim(0.5, result.poses + 0.5)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(f"{symbol(quantity)} [{unit.name}]")
    if result.poses <= _MOST_NAMED:
        labels = [figure_style.shortened(visible(label), _MOST_LETTERS) for label in labels]
        is_rotated = sum(map(len, labels)) > _MOST_LEVEL
        axes.set_xticks(places, labels, rotation=45 if is_rotated else 0, ha="right" if is_rotated else "center")
    else:
        axes.set_xlabel("pose, in the order given")
