"""The whole page of the report, and its sections beside the analyses: assumptions, 3-D view, parameters, reproduction."""

from __future__ import annotations

import importlib.resources
import platform
import re
import shlex
from collections.abc import Iterable, Sequence

from precision_pin.analyses.collect import Missing, Results
from precision_pin.analyses.registry import declarations
from precision_pin.base.units import Quantity
from precision_pin.base.versions import versions
from precision_pin.model.datum import datum_text
from precision_pin.pages import view
from precision_pin.pages.report.datum import datum_effect
from precision_pin.pages.report.distributions import describe_verdict, distributions, specifications
from precision_pin.pages.report.summary import name_pose, picture, summary
from precision_pin.render.columns import report_table
from precision_pin.render.html import (
    Child,
    Html,
    definitions,
    element,
    escaped,
    items,
    joined,
    paragraph,
    section,
    table,
)
from precision_pin.render.scene import Chapter, Layer
from precision_pin.render.tables import milli, resting_on
from precision_pin.robot.mcpc import COLUMNS
from precision_pin.sampling.table import pose_text


def subject(results: Results) -> str:
    """Return robot, ends and pose."""
    analysis = results.analysis
    pose = pose_text(analysis.pose_name, analysis.q, analysis.sliding_joints, analysis.approach)
    return f"{analysis.base} to {analysis.tip}, pose {pose}"


def without_folders(text: str, results: Results) -> str:
    """Return a message with its files by name only."""
    for folder in results.folders:
        text = text.replace(f"{folder}/", "")
    # folders of an absolute path; not the slash of a unit, of package:// or of a relative path
    return re.sub(r"(?<![\w.:/)])(?:/[^/\s'\"]+)+/(?=[^/\s'\"])", "", text)


def explain_absence(title: str, missing: Missing, results: Results) -> Html:
    """Return why a section has no content."""
    return paragraph(f"{title}: not available. {without_folders(missing.reason, results)}.", class_="note")


_MODELS = {
    "exact": "exact: the displaced chain is multiplied out for every sampled robot",
    "linear": "linear: the displacements are superposed to first order, as in the paper",
}
_STATICS = {
    "nominal": "nominal: loads act on the undeflected arm",
    "equilibrium": "equilibrium: loads act on the arm as it comes to rest under them",
}
_RULE = (
    "met when the lower end of the interval of the share inside reaches what is required, not met when the upper end does "
    "not, undecided between"
)
_SCOPES = {"unit": "once for each built robot", "pose": "once for each robot and pose", "visit": "at each visit"}


def assumptions(poses: Sequence[Results]) -> Html:
    """Return poses, model, statics, scopes, confidence, the error at the means and all warnings."""
    results = poses[0]
    analysis = results.analysis
    counts = [f"{count:,} {_SCOPES[scope]}" for scope, count in analysis.scopes.items() if count]
    at_means = []
    for pose in poses:
        nominal = [milli(value, 5) for value in pose.analysis.nominal]
        where = f"pose {pose.analysis.pose_name}: " if len(poses) > 1 and pose.analysis.pose_name else ""
        vectors = f"d = ({', '.join(nominal[:3])}) mm, δ = ({', '.join(nominal[3:])}) mrad"
        at_means.append(f"{where}with every parameter at its mean: {vectors}")
    entries = [
        *(("Pose", subject(pose)) for pose in poses),
        ("Model", _MODELS[analysis.model]),
        ("Statics", _STATICS[analysis.statics]),
        (
            "Axes",
            f"errors are position d and rotation vector δ of {analysis.tip}, in the axes of {analysis.base}"
            + datum_text(analysis.datum),
        ),
        (
            "Nominal",
            "zero error is the chain of the URDF, rigid and without tolerances, at the joint values of the pose",
        ),
        *(("Error at the means", text) for text in at_means),
        *(("Assumed", line) for line in resting_on(analysis.assumed, analysis.sources, analysis.origins)),
        ("Random numbers", ", ".join(counts) or "none: nothing varies"),
        *([("Verdict", _RULE)] if analysis.summary.specifications else []),
        ("Confidence", f"{100 * analysis.summary.confidence:g} % for each interval by itself"),
        ("Digits", "only those that the samples support; – is not resolved by this many samples"),
    ]
    entries += [("Correlation", pair) for group in analysis.correlations for pair in group.pairs]
    return section("assumptions", "Assumptions and warnings", definitions(entries), _warnings(poses), folded=False)


def _warnings(poses: Sequence[Results]) -> Html:
    lines = [(line, results) for results in poses for line in results.analysis.warnings]
    for results in poses:
        for name, result in results.found.items():
            # what a section states itself is not repeated
            if not isinstance(result, Missing) and not declarations()[name].has_warnings_in_table:
                lines += [(line, results) for line in result.warnings]
    warnings = list(dict.fromkeys(without_folders(line, results) for line, results in lines))
    none = paragraph("None of the sheet, the URDF, the pose or the statics.")
    return joined([element("h3", "Warnings"), items(warnings, "warnings") if warnings else none])


def scene(poses: Sequence[Results], layers: Sequence[Layer] = ()) -> Html:
    """Return the 3-D view of all poses in a frame that may only run its own scripts; it is not printed."""
    first = poses[0]
    analysis = first.analysis
    count = first.cloud.shape[1]
    inner = view.page(
        [
            view.ViewPose(results.at, results.cloud, results.analysis.pose_name or None, words=results.model.draw_words)
            for results in poses
        ],
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
    # in quotes only these two characters are special; the page inside has done its own escaping
    quoted = inner.replace("&", "&amp;").replace('"', "&quot;")
    frame = Html(f'<iframe sandbox="allow-scripts" title="{escaped(label)}" srcdoc="{quoted}"></iframe>')
    return section("view", "3-D view", frame, note)


def geometry(poses: Sequence[Results]) -> Html:
    """Return the table of MCPC parameters in the layout of the paper's Table 1."""
    results, heading = poses[0], "MCPC parameters"
    if isinstance(results.mcpc, Missing):
        return section("mcpc", heading, explain_absence(heading, results.mcpc, results))
    note = paragraph(
        "The nominal chain in the modified complete and parametrically continuous model of Zhuang, Wang and Roth (1993), "
        "laid out as Table 1 of Wei, Jia and Chen (2015).",
        class_="note",
    )
    parameters = report_table("MCPC parameters of the nominal chain", COLUMNS, results.mcpc.table)
    return section("mcpc", heading, parameters, note)


def parameters(poses: Sequence[Results]) -> Html:
    """Return the table of draws, and the sources that draw nothing."""
    model = poses[0].model
    rows: list[list[Child]] = []
    drawing: set[str] = set()
    for draw, words, feeds in zip(model.space.draws, model.draw_words, model.owners, strict=True):
        of = draw.known_quantities
        names = " and ".join(sorted({_named(quantity) for quantity in of}))
        rows.append([words, draw.law.describe(of), names, draw.scope.value, draw.name, ", ".join(feeds) or "none"])
        drawing.update(feeds)
    quiet = [label for label in model.labels if label not in drawing]
    header = ["what varies", "law", "quantity", "drawn per", "name", "feeds"]
    drawn = table("Random numbers of the model", header, rows, words=(1, 2, 3, 4, 5))
    parts = [drawn if rows else paragraph("Nothing is drawn at random.")]
    if quiet:
        parts += [paragraph("Sources without their own random numbers:", class_="note"), items(quiet, "note")]
    return section("parameters", "Parameters", *parts)


def _named(quantity: Quantity | None) -> str:
    if quantity is None:
        return "not known"
    return quantity.name if quantity.si else "number"


def reproduction(poses: Sequence[Results]) -> Html:
    """Return command line, seed, versions, platform and the files' SHA-256."""
    results = poses[0]
    note = "Files are named without their folders. The same files, command and versions give the same page."
    return section(
        "reproduce",
        "How to reproduce this",
        element("pre", element("code", shlex.join(results.command)), tabindex="0", aria_label="Command line"),
        definitions(
            [
                ("Seed", str(results.analysis.seed)),
                ("Samples", f"{results.analysis.samples:,}"),
                (
                    "Versions",
                    ", ".join(f"{name} {version}" for name, version in versions("matplotlib", "meshcat").items()),
                ),
                ("Platform", f"{platform.system()} {platform.machine()}"),
            ]
        ),
        table(
            "Files that were read",
            ["file", "SHA-256"],
            [[name, element("code", digest, class_="digest")] for name, digest in results.digests],
            words=(1,),
        ),
        paragraph(note, class_="note"),
    )


def page(
    results: Results | Sequence[Results],
    chapters: Sequence[Chapter] = (),
    layers: Sequence[Layer] = (),
    *,
    missed: Sequence[str] = (),
    headline: Sequence[str] = (),
    full: bool = False,
) -> str:
    """Return one self-contained HTML page about one or several poses: verdict, distributions, causes, bounds, 3-D view.

    Verdict, causes, changes and assumptions are open; every other section is folded, and printed only if it is open.
    The page loads nothing, runs only the 3-D view's scripts in a sandboxed frame, and is reproducible.

    Args:
        results: Results to show; of several poses the worst first.
        chapters: Chapters beside the poses, such as a map or a path of the same chain.
        layers: What the 3-D view shows of them.
        missed: Where else a specification is not met, such as ``on the map``.
        headline: Answer above the verdict, and the line between the two.
        full: Open all sections initially, except the 3-D view.
    """
    poses = [results] if isinstance(results, Results) else list(results)
    worst = poses[0]
    analysis = worst.analysis
    title = f"Pose error of {worst.model.chain.robot.name}, {analysis.base} to {analysis.tip}"
    policy = (
        f"default-src 'none'; script-src {' '.join(view.script_hashes(layers))}; style-src 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
    style = importlib.resources.files(__package__).joinpath("style.css").read_text("utf-8")
    head = joined(
        [
            Html('<meta charset="utf-8">\n'),
            element("meta", http_equiv="Content-Security-Policy", content=policy),
            Html('\n<meta name="viewport" content="width=device-width, initial-scale=1">\n'),
            Html('<meta name="color-scheme" content="light dark">\n'),
            element("title", title),
            Html(f"\n<style>\n{style}</style>\n"),
            Html("<noscript><style>.fold:has(> #view) { display: none; }</style></noscript>"),
        ]
    )
    titles = {"verdict": "Result", "assumptions": "Assumptions", "distributions": "Distributions"}
    titles |= {name: declarations()[name].title for name in worst.found}
    details = _details(worst)
    for other in poses[1:]:
        judged, name = other.analysis.summary.specifications, f"{other.prefix}pose"
        titles[name] = f"Pose {name_pose(other)}"
        heading = f"{titles[name]}: {describe_verdict(judged)}" if judged else titles[name]
        details.append(
            section(name, heading, picture(other), datum_effect(other), specifications(other), *_details(other))
        )
    details += [chapter.section for chapter in chapters]
    titles |= {chapter.name: chapter.title for chapter in chapters}
    titles |= {"view": "3-D view", "mcpc": "MCPC", "parameters": "Parameters", "reproduce": "Reproduce"}
    last = [geometry(poses), parameters(poses), reproduction(poses)]
    if full:
        details, last = _opened(details), _opened(last)
    links = (element("li", element("a", title, href=f"#{name}")) for name, title in titles.items())
    main = element(
        "main",
        summary(poses, [line for chapter in chapters for line in chapter.answers], missed, headline),
        element("nav", element("ul", *links), aria_label="Contents"),
        assumptions(poses),
        *details,
        scene(poses, layers),
        *last,
        id="main",
        tabindex="-1",
    )
    unprinted = "Folded sections are not printed: open them first, or write the page with precision-pin report --full."
    on_paper = [] if full else [paragraph(unprinted, class_="note paper")]
    named = f"pose '{analysis.pose_name}'" if analysis.pose_name else name_pose(worst)
    where = named if len(poses) == 1 else f"{len(poses)} poses"
    sampled = f"{analysis.samples:,} sampled robots, seed {analysis.seed}, {analysis.model} model"
    run = paragraph(f"{analysis.robot}, {where}, {sampled}", class_="subject")
    header = element("header", element("h1", title), run, *on_paper)
    footer = element("footer", paragraph("Written by precision-pin."))
    body = joined([element("a", "Skip to the result", class_="skip", href="#main"), header, main, footer])
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head.text}\n</head>\n<body>\n{body.text}\n</body>\n</html>\n'


def _details(results: Results) -> list[Html]:
    """Return the sections of a pose; an analysis without a result says why."""
    sections = [distributions(results)]
    for name, result in results.found.items():
        declaration = declarations()[name]
        if isinstance(result, Missing):
            parts: Iterable[Child] = [explain_absence(declaration.title, result, results)]
        else:
            parts = declaration.content(result, results)
        sections.append(section(f"{results.prefix}{name}", declaration.heading, *parts))
    return sections


def _opened(sections: Sequence[Html]) -> list[Html]:
    """Return sections with everything that is folded open, also parts folded inside them, such as minor causes."""
    # text is escaped, so this is always a tag
    return [Html(part.text.replace("<details", '<details open=""')) for part in sections]
