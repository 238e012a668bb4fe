"""A calibration as a section of a report: the answer, the residuals, what is left, what was learned, the worst readings."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.calibration import table as text
from precision_pin.analyses.calibration.calibrate import CalibrationResult
from precision_pin.analyses.calibration.figure import calibration_figure
from precision_pin.analyses.calibration.layer import CalibrationLayer
from precision_pin.render.chapter import Chapter
from precision_pin.render.figure_style import SINGLE_COLUMN
from precision_pin.render.html import Child, Html, element, items, joined, paragraph, section, table
from precision_pin.render.svg import figure as inline_figure

_NUMBERS: Final = 60
"""Most numbers of the table of what is learned."""
_SHOWN: Final = (
    "The arm in all other sections and in the 3-D view is that of the sheet, before this calibration. A report of the "
    "calibrated arm is made from the sheet that this command writes: ",
    element("code", "precision-pin calibrate --sheet"),
    ".",
)


def calibration_chapter(result: CalibrationResult) -> Chapter:
    """Return a calibration as a chapter; at its head whether it helps, whether the model fits, what is left, and gross errors."""
    said = text.headline(result)
    answers = [*said[:2], *said[3:]]
    lines = tuple(f"Calibration: {line[:1].lower()}{line[1:]}" for line in answers)
    return Chapter("calibration", "Calibration", _section(result), lines, CalibrationLayer.of(result))


def _section(result: CalibrationResult) -> Html:
    said = text.headline(result)
    sheet = result.original.sheet
    of_sheet = () if sheet is None else sheet.findings
    warnings = [one.message for one in result.findings if one not in of_sheet]
    picture = inline_figure(
        calibration_figure(result, SINGLE_COLUMN),
        "calibration",
        f"Residuals of {len(result.data):,} readings before and after the calibration: {said[0]} {said[1]}",
        "Residual of each reading: before the calibration, after it, and of a fit without that reading.",
    )
    parts: list[Child] = [
        items(said),
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
    rows = text.pose_rows(result.poses, result.measurement)
    notes = [*text.poses_with_less(len(result.poses)), text.explanation(result.poses)]
    notes += [text.SEEN] if result.measurement.displaces_base else []
    return [
        table("Position error of the tip, before and after, mm", rows[0], rows[1:]),
        paragraph(f"{'; '.join(notes)}.", class_="note"),
    ]


def _numbers(result: CalibrationResult) -> list[Child]:
    rows, count = text.estimate_rows(result, _NUMBERS), len(result.posterior.names)
    which = "The numbers" if count <= _NUMBERS else f"The {_NUMBERS} of {count:,} numbers of which most is learned"
    body = joined(
        [table(f"{which}, most learned first", rows[0], rows[1:]), paragraph(f"{text.LEARNED}.", class_="note")]
    )
    return [element("details", element("summary", f"What was learned of {count:,} numbers"), body)]


def _list(title: str, lines: list[str]) -> list[Child]:
    return [paragraph(title, class_="lead"), items(lines)] if lines else []
