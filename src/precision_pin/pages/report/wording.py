"""Words that several sections share."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from precision_pin.analyses.collect import Missing, Results
from precision_pin.analyses.monte_carlo.table import pose_text
from precision_pin.render.html import Html, paragraph

# an absolute path's folders; not the slash of a unit, of package:// or of a relative path
_FOLDERS: Final = re.compile(r"(?<![\w.:/)])(?:/[^/\s'\"]+)+/(?=[^/\s'\"])")


def subject(results: Results) -> str:
    """Return robot, ends and pose."""
    analysis = results.analysis
    pose = pose_text(analysis.pose_name, analysis.q, analysis.sliding_joints, analysis.approach)
    return f"{analysis.base} to {analysis.tip}, pose {pose}"


def describe_run(poses: Sequence[Results]) -> str:
    """Return a short description of the sampling."""
    analysis = poses[0].analysis
    named = f"pose '{analysis.pose_name}'" if analysis.pose_name else "joint values of the command line"
    where = named if len(poses) == 1 else f"{len(poses)} poses"
    return (
        f"{analysis.robot}, {where}, {analysis.samples:,} sampled robots, seed {analysis.seed}, {analysis.model} model"
    )


def without_folders(text: str, results: Results) -> str:
    """Return a message with the files in it by name only."""
    for folder in results.folders:
        text = text.replace(f"{folder}/", "")
    return _FOLDERS.sub("", text)


def left_out(what: str, missing: Missing, results: Results) -> Html:
    """Return why a section has no content."""
    return paragraph(f"{what}: not available. {without_folders(missing.reason, results)}.", class_="note")
