"""The embedded 3-D view, and the picture that stands in its place on paper."""

from __future__ import annotations

from precision_pin.display.html import escaped
from precision_pin.display.tables import milli
from precision_pin.outputs.kit.html import Html, paragraph, section
from precision_pin.outputs.kit.svg import figure
from precision_pin.outputs.report.collect import Results
from precision_pin.outputs.report.static_picture import cloud_factor, sketch
from precision_pin.outputs.report.wording import subject
from precision_pin.outputs.view import ViewPose, page, script_hashes

__all__ = ["policy_hashes", "scene"]


def policy_hashes() -> str:
    """Return the scripts that run inside the view, as a Content-Security-Policy names them."""
    return " ".join(script_hashes())


def scene(results: Results) -> Html:
    """Return the 3-D view in a frame that may run its scripts and nothing else, and a still picture for paper."""
    analysis = results.analysis
    count = results.cloud.shape[1]
    inner = page(
        [ViewPose(results.at, results.cloud, analysis.pose_name or None)],
        title=f"{analysis.robot}: {analysis.base} to {analysis.tip}",
        seed=analysis.seed,
        model_name=analysis.model,
        points=count,
        package_dirs=results.package_dirs,
    )
    label = f"3-D view of {analysis.robot}, {subject(results)}: the arm, its end-effector frame and {count:,} sampled positions"
    return section(
        "view",
        "3-D view",
        _frame(inner, label),
        figure(sketch(results), "sketch", _described(results), _caption(results), class_="still"),
        paragraph(
            f"The arm without error, and the end-effector positions of the first {count:,} sampled robots about it, "
            "their errors drawn too large.",
            class_="note screen",
        ),
    )


def _frame(inner: str, label: str) -> Html:
    # in quotes only these two characters mean something; the page inside has done its own escaping
    quoted = inner.replace("&", "&amp;").replace('"', "&quot;")
    return Html(f'<iframe class="screen" sandbox="allow-scripts" title="{escaped(label)}" srcdoc="{quoted}"></iframe>')


def _described(results: Results) -> str:
    posture = results.at.posture
    place = ", ".join(milli(value, 5) for value in posture.pose[:3, 3])
    return (
        f"Sketch of the arm with {len(posture.q)} joints; the tip without error is at ({place}) mm in the base; "
        f"sampled positions about it are drawn {cloud_factor(results):g} times too far away"
    )


def _caption(results: Results) -> str:
    return (
        f"The arm without error and the cloud of sampled end-effector positions, errors drawn "
        f"{cloud_factor(results):g} times too large; the tip's axes x, y, z in red, green, blue."
    )
