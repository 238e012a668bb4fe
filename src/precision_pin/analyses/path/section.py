"""A path as a section of a report: how far off at worst and where, the picture, the bands."""

from __future__ import annotations

from precision_pin.analyses.path.figure import figure
from precision_pin.analyses.path.layer import PathLayer
from precision_pin.analyses.path.path_result import PathResult
from precision_pin.analyses.path.table import band_lines, headline, maximum_rows, pose_rows, verdict_lines, where_line
from precision_pin.render.chapter import Chapter
from precision_pin.render.html import Html, items, paragraph, section, table
from precision_pin.render.svg import figure as inline_figure


def path_chapter(result: PathResult) -> Chapter:
    """Return the path as a chapter."""
    answers = tuple(f"Along the path: {line}" for line in (headline(result), *verdict_lines(result)))
    return Chapter("path", "Path", _section(result), answers, PathLayer.of(result))


def _section(result: PathResult) -> Html:
    share = f"{100 * result.probability:.6g} %"
    picture = inline_figure(
        figure(result),
        "path",
        f"Errors along a path of {len(result.poses):,} poses: {headline(result)}",
        "The quantile at each pose, and the band that holds the whole error curve of that share of the robots or more.",
    )
    maxima, listed = maximum_rows(result), pose_rows(result)
    poses = f"The largest errors of the path at {len(listed) - 1} of its poses"
    note = f"|d|, |δ|: {share} quantile at the pose; largest here: share of robots with their largest error of the path there."
    return section(
        "path",
        "Path",
        items([headline(result), where_line(result), *verdict_lines(result), *band_lines(result)]),
        picture,
        table("Largest error of the path", maxima[0], maxima[1:]),
        table(poses, listed[0], listed[1:]),
        paragraph(note, class_="note"),
    )
