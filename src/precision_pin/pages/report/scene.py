"""The embedded 3-D view."""

from __future__ import annotations

from collections.abc import Sequence

from precision_pin.analyses.collect import Results
from precision_pin.pages.report.wording import subject
from precision_pin.pages.view import ViewPose, page, script_hashes
from precision_pin.render.html import Html, paragraph, section
from precision_pin.render.layers import Layer
from precision_pin.render.notebook import escaped


def policy_hashes() -> str:
    """Return the scripts that run inside the view, as a Content-Security-Policy names them."""
    return " ".join(script_hashes())


def scene(poses: Sequence[Results], layers: Sequence[Layer] = ()) -> Html:
    """Return the 3-D view of all poses in a frame that may run its scripts and nothing else; it is not for paper."""
    first = poses[0]
    analysis = first.analysis
    count = first.cloud.shape[1]
    inner = page(
        [
            ViewPose(results.at, results.cloud, results.analysis.pose_name or None, words=results.model.draw_words)
            for results in poses
        ],
        title=f"{analysis.robot}: {analysis.base} to {analysis.tip}",
        seed=analysis.seed,
        model_name=analysis.model,
        points=count,
        package_dirs=first.package_dirs,
        layers=layers,
    )
    label = f"3-D view of {analysis.robot}, {subject(first)}: the arm, its end-effector frame and {count:,} sampled positions"
    note = paragraph(
        f"The arm without error, and the end-effector positions of the first {count:,} sampled robots about it, "
        "their errors drawn too large.",
        class_="note",
    )
    return section("view", "3-D view", _frame(inner, label), note)


def _frame(inner: str, label: str) -> Html:
    # in quotes only these two characters mean something; the page inside has done its own escaping
    quoted = inner.replace("&", "&amp;").replace('"', "&quot;")
    return Html(f'<iframe sandbox="allow-scripts" title="{escaped(label)}" srcdoc="{quoted}"></iframe>')
