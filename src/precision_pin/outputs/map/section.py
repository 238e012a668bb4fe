"""A map as a section of a report: the worst pose, the verdicts, the picture, the worst poses."""

from __future__ import annotations

from precision_pin.analyses.map.map_result import MapResult
from precision_pin.outputs.kit.html import Html, items, paragraph, section, table
from precision_pin.outputs.kit.svg import figure as inline_figure
from precision_pin.outputs.map.figure import figure
from precision_pin.outputs.map.table import answers, verdict_lines, worst_rows

__all__ = ["map_section", "map_verdicts"]


def map_section(result: MapResult) -> Html:
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
        "Quantiles of |d| in mm, of |δ| in mrad, in closed form, to first order; sampled: the interval of fresh samples of the "
        "exact model; cause: of most variance.",
        class_="note",
    )
    poses = table("The worst poses of the map", list(rows[0]), [list(row.values()) for row in rows])
    return section("map", "Map", items(said), *pictures, poses, note)


def map_verdicts(result: MapResult | None) -> list[Html]:
    """Return a line for each specification, for the head of the page: what is met at its poses may be missed on the map."""
    lines = [] if result is None else verdict_lines(result)
    return [paragraph(f"On the map: {line}", class_="subject") for line in lines]
