"""Figures, chapter and view layer of a calibration: accuracy against effort, residuals, estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from precision_pin.analyses.calibration import table as text
from precision_pin.analyses.calibration.calibrate import CalibrationResult
from precision_pin.analyses.calibration.forecast import CalibrationForecast, CurvePoint
from precision_pin.analyses.calibration.plan import CalibrationPlan
from precision_pin.analyses.calibration.population import Population
from precision_pin.analyses.calibration.table import WorstReadings, describe_measurement, measured_text
from precision_pin.base.arrays import Array
from precision_pin.base.errors import visible
from precision_pin.render import figure_style
from precision_pin.render.display_units import ColourScale, round_number
from precision_pin.render.draw_distribution import BLACK, BLUE, SKY, VERMILION
from precision_pin.render.figure_style import SINGLE_COLUMN, inline_figure
from precision_pin.render.html import Child, Html, element, escaped, items, joined, paragraph, section, table
from precision_pin.render.scene import Chapter, Layer, Scene
from precision_pin.render.tables import milli

_HEIGHT: Final = 70.0
"""Height of the axes, mm; title, legend and note are added."""
_ROW: Final = 4.5
"""Height of a tolerance, mm."""
_TOLERANCES: Final = 40
"""Maximum number of tolerances in the figure, the largest."""
_NAMED: Final = 6
"""Maximum number of poses with a name on the axis."""
_NAME: Final = 14
"""Maximum number of characters of a pose's name."""
_NARROW: Final = 5.0
"""Width of a figure, in inches, below which a legend has two columns."""
_LEAST: Final = 0.05
"""Start of intervals that begin at zero, relative to the smallest positive scale."""


def forecast_figure(result: CalibrationForecast) -> Figure:
    """Return the accuracy against the number of readings (left) and the instrument's deviation (right), 174 mm wide."""
    with figure_style.style():
        figure = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        left_axes, right_axes = figure.subplots(1, 2, sharey=True)
        _draw_curve(left_axes, result, result.by_count, 1.0, "readings", float(result.readings))
        of_instrument = "standard deviation of the instrument [µm]"
        _draw_curve(right_axes, result, result.by_instrument, 1e6, of_instrument, result.measurement.std)
        left_axes.set_ylabel("rms position error [mm]")
        of = result.provenance
        title = f"forecast of a calibration of {visible(of.robot, 60)}: {visible(of.base)} to {visible(of.tip)}"
        _finish(figure, left_axes, title, f"{result.readings:,} readings of {describe_measurement(result.measurement)}")
    return figure


def _finish(figure: Figure, axes: Axes, title: str, note: str) -> None:
    figure_style.frame(figure, [axes], title, note, _HEIGHT, 2 if figure.get_figwidth() < _NARROW else 4)


def _draw_curve(
    axes: Axes, result: CalibrationForecast, points: Sequence[CurvePoint], per_si: float, label: str, current: float
) -> None:
    values = [point.value * per_si for point in points]
    axes.plot(values, [1e3 * point.rms_position for point in points], "o-", color=BLUE, markersize=2.5, label="after")
    axes.axhline(1e3 * result.rms("before"), color=BLACK, linewidth=0.8, label="before")
    if result.rms("floor") > 0:
        axes.axhline(1e3 * result.rms("floor"), color=VERMILION, linestyle="--", label="floor: repeatability")
    axes.axvline(current * per_si, color=SKY, linestyle=":", label="as asked")
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
        figure = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        bars, panel = figure.subplots(1, 2, width_ratios=(1, 2))
        bars.bar(["random", "chosen"], [100 * result.random_efficiency, 100 * result.efficiency], color=[SKY, BLUE])
        bars.axhline(100, color=BLACK, linewidth=0.8)
        bars.set_ylabel("of the best choice, at least [%]")
        places = np.arange(len(result.poses)) + 1
        for key, colour, marker in (("before", BLACK, "_"), ("after", BLUE, "o"), ("floor", VERMILION, "_")):
            sizes = [1e3 * entry.rms(key) for entry in result.poses]
            if max(sizes) > 0:
                panel.plot(places, sizes, marker, color=colour, label=key)
        _log(panel, "y")
        if len(result.poses) <= _NAMED:
            names = [figure_style.shortened(visible(entry.name), _NAME) for entry in result.poses]
            panel.set_xticks(places, names)
            panel.set_xlim(0.5, len(result.poses) + 0.5)
        else:
            panel.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True))
        panel.set_xlabel("pose where accuracy counts")
        panel.set_ylabel("rms position error [mm]")
        robot = visible(result.provenance.robot, 60)
        title = f"{result.count:,} of {result.candidates:,} poses of {robot} to measure"
        _finish(figure, panel, title, describe_measurement(result.measurement))
    return figure


def calibration_figure(result: CalibrationResult, width: float = figure_style.DOUBLE_COLUMN) -> Figure:
    """Return the residuals of the readings before and after the calibration, and of the fit without each; ``width`` mm wide."""
    rows = np.array(result.data.lines)
    sizes = {
        "before": np.linalg.norm(result.residuals_before[:, :3], axis=1),
        "after": np.linalg.norm(result.residuals[:, :3], axis=1),
        "left out of the fit": np.linalg.norm(result.left_out[:, :3], axis=1),
    }
    with figure_style.style():
        figure = figure_style.new_figure(width)
        axes = figure.subplots()
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
        title = f"{visible(result.provenance.robot, 60)}: {text.verdict_text(result)}; {text.VERDICTS[result.verdict]}"
        note = f"{measured_text(result)}; chi-square {result.chi_square:.4g} for {result.degrees_of_freedom:,} degrees of freedom"
        _finish(figure, axes, title, note)
    return figure


def population_figure(result: Population) -> Figure:
    """Return each measured tolerance over that of the sheet with its interval, the largest at the top, 174 mm wide."""
    entries = sorted(result.tolerances, key=lambda tolerance: tolerance.scale)[-_TOLERANCES:]
    minimum = _LEAST * min([1.0, *(tolerance.scale for tolerance in entries if tolerance.scale > 0)])
    with figure_style.style():
        figure = figure_style.new_figure(figure_style.DOUBLE_COLUMN)
        axes = figure.subplots()
        for row, tolerance in enumerate(entries):
            colour = BLUE if tolerance.agrees else VERMILION
            maximum = tolerance.high if np.isfinite(tolerance.high) else 10 * max(tolerance.scale, 1.0)
            axes.plot([max(tolerance.low, minimum), maximum], [row, row], "-", color=colour, linewidth=1)
            axes.plot([max(tolerance.scale, minimum)], [row], "o", color=colour, markersize=3)
        axes.axvline(1.0, color=BLACK, linewidth=0.8)
        _log(axes, "x")
        axes.set_ylim(-0.6, len(entries) - 0.4)
        axes.set_yticks(range(len(entries)), [visible(" and ".join(entry.names), 40) for entry in entries])
        axes.set_xlabel("measured standard deviation over that of the sheet")
        of = result.provenance
        title = f"tolerances of {result.robots:,} robots {visible(of.robot, 60)}"
        note = f"{100 * result.confidence:g} % intervals of the profile likelihood; orange: other than the sheet's"
        figure_style.frame(figure, (), title, note, 27 + _ROW * len(entries))
    return figure


MOST_DRAWN: Final = 200
"""Maximum number of readings on a page, worst first."""
_LARGEST: Final = 0.12
"""Initial length of the largest residual with weight, in lengths of the arm."""
_LONGEST: Final = 0.2
"""Longest line, in lengths of the arm."""
_FEW: Final = 60
"""Number of readings up to which residuals before the calibration are shown initially."""
_ROUNDING: Final = 1e-12
"""Residuals (m) below which a reading equals its prediction."""
_PER_METRE: Final = 1e3
"""Residuals are shown in mm."""
_LIMITED: Final = {
    "distance": "Only the part along the line of sight is measured, and drawn; that line is shown for the marked reading.",
    "plane": "Only the height over the plane is measured: lines are along its normal.",
}
"""Explanation of the lines of readings with fewer than three lengths."""


@dataclass(frozen=True, eq=False)
class CalibrationLayer(Layer):
    """A calibration, its worst readings, which are drawn, and colours for residuals of readings that have weight."""

    result: CalibrationResult
    worst: WorstReadings
    scale: ColourScale

    @classmethod
    def of(cls, result: CalibrationResult, *_: object) -> CalibrationLayer:
        """Return the layer of a calibration."""
        worst = WorstReadings.of(result, MOST_DRAWN)
        sizes = worst.sizes[~worst.is_gross & (worst.sizes > _ROUNDING)]
        return cls(result, worst, ColourScale.of(np.append(sizes, 0.0)))

    @property
    def name(self) -> str:
        """Name of the layer."""
        return "calibration"

    def draw(self, scene: Scene, length: float) -> None:
        """Add the predicted places as crosses; the scripts add the residuals."""
        size = 0.004 * length
        endpoints = [
            point + sign * size * axis for point in self.worst.points.T for axis in np.eye(3) for sign in (-1.0, 1.0)
        ]
        scene.segments((self.name, "predicted"), np.array(endpoints).T, (0.1, 0.1, 0.1, 1.0))

    def settings(self, length: float) -> dict[str, Any]:
        """Return places and residuals by x, y, z in m, worst first, and how many times too large they are drawn at first."""
        worst = self.worst
        return {
            "times": round_number(_LARGEST * length / self.scale.largest) if self.scale.largest > 0 else 1.0,
            "longest": _LONGEST * length,
            "points": _rounded(worst.points),
            "after": _rounded(worst.after),
            "before": _rounded(worst.before),
            "gross": np.flatnonzero(worst.is_gross).tolist(),
            "rows": list(worst.lines),
            "largest": self.scale.largest,
            "anchor": None if worst.anchor is None else worst.anchor.tolist(),
        }

    def legend(self) -> str:
        """Return the section of the legend: the answer, the worst readings, the colours, and how large all is drawn."""
        result, worst = self.result, self.worst
        paragraphs = "".join(f"<p>{escaped(line)}</p>" for line in text.headline(result))
        count, shown_count = len(result.data), len(worst.lines)
        subject = "the reading" if count == 1 else f"all {count:,} readings"
        subject = f"the worst {shown_count:,} of {count:,} readings" if shown_count < count else subject
        is_checked = " checked" if shown_count <= _FEW else ""
        limits = " ".join(dict.fromkeys(_LIMITED.get(measurement.kind, "") for measurement in result.data.measurements))
        return (
            f'<section aria-label="Calibration"><h2>Calibration: readings against predictions</h2>{paragraphs}'
            '<div class="controls"><p>The worst readings first, in mm and in standard deviations (std); press one to mark it:</p>'
            f'<ol class="readings">{self._buttons()}</ol></div>'
            f'<div id="calibration-bar"><h2>Residual after calibration, mm</h2>{self.scale.bar(_PER_METRE)}</div>'
            '<ul class="legend controls">'
            '<li><label><input type="checkbox" id="show-calibration" checked><i class="line measured"></i>'
            f"<span>{escaped(subject)}: line from the predicted place (cross) to the measured one (ball)</span></label></li>"
            f"{self._gross()}"
            f'<li><label><input type="checkbox" id="calibration-before"{is_checked}><i class="line thin"></i>'
            "<span>thin line: the same before calibration</span></label></li></ul>"
            '<p class="fine">Residuals are drawn at <span id="calibration-times"></span> times their size. Lines that would be '
            f"longer than a fifth of the arm are cut; a thick one then has no ball. {escaped(limits)} The arm and the sampled "
            "robots are those of the sheet, before calibration.</p></section>"
        )

    def _buttons(self) -> str:
        worst = self.worst
        entries = []
        for k in range(min(text.MOST_READINGS, len(worst.lines))):
            unweighted = ", no weight" if worst.is_gross[k] else ""
            size, deviations = milli(float(worst.sizes[k]), 3), text.deviations_text(worst.deviations[k])
            label = f"{worst.labels[k]}: {size} mm, {deviations} std{unweighted}"
            pressed = "false" if k else "true"
            entries.append(
                f'<li><button type="button" data-reading="{k}" aria-pressed="{pressed}">{escaped(label)}</button></li>'
            )
        return "".join(entries)

    def _gross(self) -> str:
        if not self.worst.is_gross.any():
            return ""
        label = "red: readings that fit no other and were given no weight"
        return f'<li class="row"><i class="line gross"></i><span>{escaped(label)}</span></li>'


def _rounded(values: Array) -> list[float]:
    """Return vectors ``(3, K)`` by x, y, z with the digits that a picture can show."""
    return [float(f"{value:.7g}") for value in values.T.ravel()]


_NUMBERS: Final = 60
"""Maximum number of numbers of the table of what is learned."""
_SHOWN: Final = (
    "The arm in all other sections and in the 3-D view is that of the sheet, before this calibration. A report of the "
    "calibrated arm is made from the sheet that this command writes: ",
    element("code", "precision-pin calibrate --sheet"),
    ".",
)


def calibration_chapter(result: CalibrationResult) -> Chapter:
    """Return a calibration as a chapter; at its head whether it helps, whether the model fits, what is left, and gross errors."""
    sentences = text.headline(result)
    summary = [*sentences[:2], *sentences[3:]]
    lines = tuple(f"Calibration: {line[:1].lower()}{line[1:]}" for line in summary)
    return Chapter("calibration", "Calibration", _section(result), lines)


def _section(result: CalibrationResult) -> Html:
    sentences = text.headline(result)
    sheet = result.original.sheet
    of_sheet = () if sheet is None else sheet.findings
    warnings = [finding.message for finding in result.findings if finding not in of_sheet]
    picture = inline_figure(
        calibration_figure(result, SINGLE_COLUMN),
        "calibration",
        f"Residuals of {len(result.data):,} readings before and after the calibration: {sentences[0]} {sentences[1]}",
        "Residual of each reading: before the calibration, after it, and of a fit without that reading.",
    )
    parts: list[Child] = [
        items(sentences),
        paragraph(*_SHOWN),
        paragraph(f"{text.measured_text(result)}.", class_="note"),
        *([] if result.has_prior else [paragraph(f"{text.NO_PRIOR.capitalize()}.", class_="note")]),
        element("div", picture, class_="pair"),  # narrow enough for a small screen
        *_readings(result),
        *_poses(result),
        *_numbers(result),
        *_list("What the readings determine", text.identifiability_lines(result.identifiability)),
        *_list("Set-up as estimated", text.set_up_lines(result.set_ups)),
        *_list("Warnings of the calibration", warnings),
    ]
    return section("calibration", "Calibration", *parts)


def _readings(result: CalibrationResult) -> list[Child]:
    rows, gross = text.reading_rows(result), text.gross_rows(result)
    parts: list[Child] = [table("The worst readings, worst first; residuals in mm", rows[0], rows[1:])]
    if len(gross) > 1:
        parts.append(table("Readings that fit no other and were given no weight", gross[0], gross[1:]))
    return [*parts, paragraph(f"{text.LEFT_OUT}.", class_="note")]


def _poses(result: CalibrationResult) -> list[Child]:
    rows = text.pose_rows(result)
    notes = [*text.poses_with_less(result), text.explanation(result), *text.seen_lines(result.measurement)]
    return [
        table("Position error of the tip, before and after, mm", rows[0], rows[1:]),
        paragraph(f"{'; '.join(notes)}.", class_="note"),
    ]


def _numbers(result: CalibrationResult) -> list[Child]:
    rows, count = text.estimate_rows(result, _NUMBERS), len(result.posterior.names)
    caption = "The numbers" if count <= _NUMBERS else f"The {_NUMBERS} of {count:,} numbers of which most is learned"
    body = joined(
        [table(f"{caption}, most learned first", rows[0], rows[1:]), paragraph(f"{text.LEARNED}.", class_="note")]
    )
    return [element("details", element("summary", f"What was learned of {count:,} numbers"), body)]


def _list(title: str, lines: list[str]) -> list[Child]:
    return [paragraph(title, class_="lead"), items(lines)] if lines else []
