"""A compensation as a section of a report: the error before and after, the picture, the poses."""

from __future__ import annotations

from precision_pin.analyses.compensation.compensate import CompensationResult
from precision_pin.analyses.compensation.figure import figure
from precision_pin.analyses.compensation.layer import CompensationLayer
from precision_pin.analyses.compensation.table import EXPLANATION, headline, joint_rows, pose_rows, setting_lines
from precision_pin.model.error_model import ErrorModel
from precision_pin.render.chapter import Chapter
from precision_pin.render.html import Html, items, paragraph, section, table
from precision_pin.render.svg import figure as inline_figure


def compensation_chapter(result: CompensationResult, error_model: ErrorModel) -> Chapter:
    """Return the compensation of a model as a chapter."""
    answers = tuple(f"Compensation: {line}" for line in headline(result))
    layer = CompensationLayer.of(result, error_model)
    return Chapter("compensation", "Compensation", _section(result), answers, layer)


def _section(result: CompensationResult) -> Html:
    said, rows = headline(result), pose_rows(result)
    picture = inline_figure(
        figure(result),
        "compensation",
        f"Errors at {len(result.poses):,} poses before and after the correction: {said[0]}",
        "The error with every component at its mean, and the 95 % quantile of a normal law, first order, before and after.",
    )
    notes = [paragraph(line, class_="note") for line in (EXPLANATION, setting_lines(result)[1])]
    listed = (
        "The poses" if len(rows) > len(result.poses) else f"The worst {len(rows) - 1} of {len(result.poses):,} poses"
    )
    joints = joint_rows(result)
    values = [table("Corrected joint values", joints[0], joints[1:])] if len(joints) > 1 else []
    return section(
        "compensation", "Compensation", items(said), picture, *values, table(listed, rows[0], rows[1:]), *notes
    )
