"""A calibration as pictures: accuracy against effort, and residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from precision_pin.analyses.calibration.calibrate import CalibrationResult
from precision_pin.analyses.calibration.forecast import CalibrationForecast, CurvePoint
from precision_pin.analyses.calibration.plan import CalibrationPlan
from precision_pin.analyses.calibration.population import Population
from precision_pin.analyses.calibration.table import VERDICTS, describe_measurement, measured_text, verdict_text
from precision_pin.base.errors import visible
from precision_pin.render import figure_style
from precision_pin.render.draw_distribution import BLACK, BLUE, SKY, VERMILION

_HEIGHT: Final = 70.0
_ROW: Final = 4.5
"""Height of a tolerance, mm."""
_TOLERANCES: Final = 40
_NAMED: Final = 6
"""Most poses that are named, and most characters of a name."""
_NAME: Final = 14
_NARROW: Final = 5.0
"""Width of a figure, in inches, below which a legend has two columns."""
_LEAST: Final = 0.05
"""Scale at which an interval that begins at zero is drawn to begin, of the smallest that is above."""


def forecast_figure(result: CalibrationForecast) -> Figure:
    """Return the accuracy against the number of readings (left) and the instrument's deviation (right), 174 mm wide."""
    with figure_style.style():
        made = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        left, right = made.subplots(1, 2, sharey=True)
        _draw_curve(left, result, result.by_count, 1.0, "readings", float(result.readings))
        of_instrument = "standard deviation of the instrument [µm]"
        _draw_curve(right, result, result.by_instrument, 1e6, of_instrument, result.measurement.std)
        left.set_ylabel("rms position error [mm]")
        of = result.provenance
        title = f"forecast of a calibration of {visible(of.robot, 60)}: {visible(of.base)} to {visible(of.tip)}"
        _finish(made, left, title, f"{result.readings:,} readings of {describe_measurement(result.measurement)}")
    return made


def _finish(made: Figure, axes: Axes, title: str, note: str) -> None:
    """Add the title, and below it the legend of one panel and a note; set the height."""
    head = figure_style.wrapped(title, made)
    made.suptitle("\n".join(head))
    lines, entries = figure_style.wrapped(note, made), figure_style.labelled([axes])
    is_narrow = made.get_figwidth() < _NARROW
    columns = min(len(entries), 2) if is_narrow else len(entries)
    figure_style.legend_below(made, entries, columns, lines)
    rows = len(head) + len(lines) + -(-len(entries) // max(columns, 1))
    figure_style.set_height(made, _HEIGHT + rows * figure_style.LINE_HEIGHT)


def _draw_curve(
    axes: Axes, result: CalibrationForecast, points: Sequence[CurvePoint], per_si: float, label: str, here: float
) -> None:
    values = [point.value * per_si for point in points]
    axes.plot(values, [1e3 * point.rms_position for point in points], "o-", color=BLUE, markersize=2.5, label="after")
    axes.axhline(1e3 * result.rms("before"), color=BLACK, linewidth=0.8, label="before")
    if result.rms("floor") > 0:
        axes.axhline(1e3 * result.rms("floor"), color=VERMILION, linestyle="--", label="floor: repeatability")
    axes.axvline(here * per_si, color=SKY, linestyle=":", label="as asked")
    _log(axes, "x", "y")
    axes.set_xlabel(label)


def _log(axes: Axes, *names: str) -> None:
    """Make axes logarithmic, with plain numbers: 1, 2 and 5 where one spans less than two decades, else decades."""
    axes.set(**{f"{name}scale": "log" for name in names})
    for name in names:
        axis = getattr(axes, f"{name}axis")
        low, high = axis.get_view_interval()
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100 * low else (1.0,)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def plan_figure(result: CalibrationPlan) -> Figure:
    """Return the efficiency of the choice and of random ones (left), and the error left at each pose, 174 mm wide."""
    with figure_style.style():
        made = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        left, right = made.subplots(1, 2, width_ratios=(1, 2))
        left.bar(["random", "chosen"], [100 * result.random_efficiency, 100 * result.efficiency], color=[SKY, BLUE])
        left.axhline(100, color=BLACK, linewidth=0.8)
        left.set_ylabel("of the best choice, at least [%]")
        places = np.arange(len(result.poses)) + 1
        for which, colour, marker in (("before", BLACK, "_"), ("after", BLUE, "o"), ("floor", VERMILION, "_")):
            sizes = [1e3 * entry.rms(which) for entry in result.poses]
            if max(sizes) > 0:
                right.plot(places, sizes, marker, color=colour, label=which)
        _log(right, "y")
        if len(result.poses) <= _NAMED:
            names = [figure_style.shortened(visible(one.name), _NAME) for one in result.poses]
            right.set_xticks(places, names)
            right.set_xlim(0.5, len(result.poses) + 0.5)
        else:
            right.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True))
        right.set_xlabel("pose where accuracy counts")
        right.set_ylabel("rms position error [mm]")
        robot = visible(result.provenance.robot, 60)
        title = f"{result.count:,} of {result.candidates:,} poses of {robot} to measure"
        _finish(made, right, title, describe_measurement(result.measurement))
    return made


def calibration_figure(result: CalibrationResult, width: float = figure_style.DOUBLE_COLUMN) -> Figure:
    """Return the residuals of the readings before and after the calibration, and of each left out; so many mm wide."""
    rows = np.array(result.data.lines)
    sizes = {
        "before": np.linalg.norm(result.residuals_before[:, :3], axis=1),
        "after": np.linalg.norm(result.residuals[:, :3], axis=1),
        "left out of the fit": np.linalg.norm(result.left_out[:, :3], axis=1),
    }
    with figure_style.style():
        made = figure_style.new_figure(width)
        axes = made.subplots()
        for (label, values), colour, marker in zip(sizes.items(), (BLACK, BLUE, SKY), ("_", "o", "x"), strict=True):
            axes.plot(rows, 1e3 * np.maximum(values, 1e-12), marker, color=colour, markersize=3, label=label)
        gross = [error.reading for error in result.gross_errors]
        if gross:
            after = 1e3 * sizes["after"][gross]
            axes.plot(rows[gross], after, "o", ms=7, mfc="none", color=VERMILION, label="no weight")
        _log(axes, "y")
        axes.xaxis.set_major_locator(MaxNLocator(nbins=6 if width < figure_style.DOUBLE_COLUMN else 10, integer=True))
        axes.set_xlabel("row of the data")
        axes.set_ylabel("residual [mm]")
        title = f"{visible(result.provenance.robot, 60)}: {verdict_text(result)}; {VERDICTS[result.verdict]}"
        note = f"{measured_text(result)}; chi-square {result.chi_square:.4g} for {result.degrees_of_freedom:,} degrees of freedom"
        _finish(made, axes, title, note)
    return made


def population_figure(result: Population) -> Figure:
    """Return each measured tolerance over that of the sheet with its interval, the largest at the top, 174 mm wide."""
    shown = sorted(result.tolerances, key=lambda one: one.scale)[-_TOLERANCES:]
    least = _LEAST * min([1.0, *(one.scale for one in shown if one.scale > 0)])
    with figure_style.style():
        made = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        axes = made.subplots()
        for row, one in enumerate(shown):
            colour = BLUE if one.agrees else VERMILION
            most = one.high if np.isfinite(one.high) else 10 * max(one.scale, 1.0)
            axes.plot([max(one.low, least), most], [row, row], "-", color=colour, linewidth=1)
            axes.plot([max(one.scale, least)], [row], "o", color=colour, markersize=3)
        axes.axvline(1.0, color=BLACK, linewidth=0.8)
        _log(axes, "x")
        axes.set_ylim(-0.6, len(shown) - 0.4)
        axes.set_yticks(range(len(shown)), [visible(" and ".join(one.names), 40) for one in shown])
        axes.set_xlabel("measured standard deviation over that of the sheet")
        of = result.provenance
        made.suptitle(f"tolerances of {result.robots:,} robots {visible(of.robot, 60)}")
        lines = figure_style.wrapped(
            f"{100 * result.confidence:g} % intervals of the profile likelihood; orange: other than the sheet's", made
        )
        figure_style.legend_below(made, {}, 1, lines)
        figure_style.set_height(made, 30 + _ROW * len(shown) + len(lines) * figure_style.LINE_HEIGHT)
    return made
