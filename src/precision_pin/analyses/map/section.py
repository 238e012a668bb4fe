"""A map as a section of a report: the worst pose, the verdicts, the picture, the worst poses."""

from __future__ import annotations

from precision_pin.analyses.map.figure import figure
from precision_pin.analyses.map.layer import PlacesData
from precision_pin.analyses.map.map_result import MapResult
from precision_pin.analyses.map.table import answers, worst_rows
from precision_pin.render.chapter import Chapter
from precision_pin.render.html import Html, items, paragraph, section, table
from precision_pin.render.svg import figure as inline_figure


def _section(result: MapResult) -> Html:
    """Return the section."""
    said, rows = answers(result), worst_rows(result)
    pictures = [
        inline_figure(
            figure(result, quantity),
            f"map-{quantity}",
            f"Map of the {quantity} error over {len(result.poses):,} poses: {said[0]}",
            f"Within how much {symbol} 95 % of robots stay, to first order, at the worst branch and tool angle of each place.",
        )
        for quantity, symbol in (("position", "|d|"), ("attitude", "|δ|"))
    ]
    note = paragraph(
        "Quantiles of |d| in mm, of |δ| in mrad, in closed form, to first order; limits: of the exact 95 %, whatever the laws; "
        "sampled: the interval of the 95 % by fresh samples of the exact model; spec: the sampled share inside, * where it is "
        "not met, ? where the samples do not decide; cause: of most variance.",
        class_="note",
    )
    poses = table("The worst poses of the map", list(rows[0]), [list(row.values()) for row in rows])
    return section("map", "Map", items(said), *pictures, poses, note)


def map_chapter(result: MapResult) -> Chapter:
    """Return the map as a chapter; its answers are at the head too: what is met at the poses may be missed on the map."""
    said = tuple(f"On the map: {line}" for line in answers(result))
    return Chapter("map", "Map", _section(result), said, PlacesData.of(result))
