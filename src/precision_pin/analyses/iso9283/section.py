"""The forecast by ISO 9283 as a section of a report."""

from __future__ import annotations

from precision_pin.analyses.iso9283.figure import figure
from precision_pin.analyses.iso9283.result import Iso9283Result
from precision_pin.analyses.iso9283.table import angle_rows, answers, distance_rows, position_rows, setting_lines
from precision_pin.render.chapter import Chapter
from precision_pin.render.html import Html, items, paragraph, section, table
from precision_pin.render.svg import figure as inline_figure


def iso9283_chapter(result: Iso9283Result) -> Chapter:
    """Return the forecast as a chapter."""
    return Chapter("iso9283", "ISO 9283", _section(result), tuple(f"By ISO 9283: {line}" for line in answers(result)))


def _section(result: Iso9283Result) -> Html:
    said = answers(result)
    tables = [
        table(caption, rows[0], rows[1:])
        for caption, rows in (
            ("Accuracy and repeatability of the position", position_rows(result)),
            ("Accuracy and repeatability of the orientation", angle_rows(result)),
            ("Distances, directions, exchange of robots", distance_rows(result)),
        )
        if len(rows) > 1
    ]
    picture = inline_figure(
        figure(result),
        "iso9283",
        f"AP and RP at the poses: {said[0]}",
        "Laws of AP and RP over built robots and over tests.",
    )
    absent = [f"{name}: none, {why}" for name, why in result.absent.items()]
    notes = [paragraph(line, class_="note") for line in (*setting_lines(result), *absent)]
    return section("iso9283", "ISO 9283", items(said), picture, *tables, *notes)
