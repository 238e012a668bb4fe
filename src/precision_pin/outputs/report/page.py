"""The whole page."""

from __future__ import annotations

import importlib.resources
from collections.abc import Sequence
from typing import Final

from precision_pin.analyses.registry import declarations
from precision_pin.outputs.kit.html import Html, element, joined, paragraph, section
from precision_pin.outputs.mcpc import geometry
from precision_pin.outputs.monte_carlo.section import distributions
from precision_pin.outputs.monte_carlo.verdict import describe_verdict, specifications
from precision_pin.outputs.report.assumptions import assumptions
from precision_pin.outputs.report.chapter import Chapter
from precision_pin.outputs.report.collect import Missing, Results
from precision_pin.outputs.report.parameters import parameters
from precision_pin.outputs.report.reproduction import reproduction
from precision_pin.outputs.report.scene import policy_hashes, scene
from precision_pin.outputs.report.summary import name_pose, picture, summary
from precision_pin.outputs.report.wording import describe_run, left_out

__all__ = ["page"]

_LAST: Final = {
    "assumptions": ("Assumptions", assumptions),
    "mcpc": ("MCPC", geometry),
    "parameters": ("Parameters", parameters),
    "reproduce": ("Reproduce", reproduction),
}
"""Sections after those of the poses: title in the list of contents, and function."""
_WITHOUT_SCRIPTS: Final = Html("<noscript><style>#view { display: none; }</style></noscript>")


def page(results: Results | Sequence[Results], chapters: Sequence[Chapter] = ()) -> str:
    """Return one self-contained HTML page about one pose or several: verdict, distributions, causes, bounds, 3-D view.

    It loads nothing from outside, runs no script but those of the 3-D view, which run in a sandboxed frame, and is the same
    text for the same results.

    Parameters
    ----------
    results
        What it shows, of several poses the worst first.
    chapters
        What it has beside its poses, such as a map or a path of the same chain.
    """
    poses = [results] if isinstance(results, Results) else list(results)
    worst = poses[0]
    analysis = worst.analysis
    title = f"Pose error of {worst.model.chain.robot.name}, {analysis.base} to {analysis.tip}"
    head = joined(
        [
            Html('<meta charset="utf-8">\n'),
            element("meta", http_equiv="Content-Security-Policy", content=_policy()),
            Html('\n<meta name="viewport" content="width=device-width, initial-scale=1">\n'),
            Html('<meta name="color-scheme" content="light dark">\n'),
            element("title", title),
            Html(f"\n<style>\n{_style()}</style>\n"),
            _WITHOUT_SCRIPTS,
        ]
    )
    sections = [
        summary(poses),
        _contents(poses, chapters),
        *_details(worst),
        *(_folded(other) for other in poses[1:]),
        *(chapter.section for chapter in chapters),
        scene(poses, [chapter.layer for chapter in chapters if chapter.layer is not None]),
        *(make(poses) for _, make in _LAST.values()),
    ]
    answers = [paragraph(line, class_="subject") for chapter in chapters for line in chapter.answers]
    header = element("header", element("h1", title), paragraph(describe_run(poses), class_="subject"), *answers)
    main = element("main", *sections, id="main", tabindex="-1")
    footer = element("footer", paragraph("Written by precision-pin."))
    body = joined([element("a", "Skip to the result", class_="skip", href="#main"), header, main, footer])
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head.text}\n</head>\n<body>\n{body.text}\n</body>\n</html>\n'


def _details(results: Results) -> list[Html]:
    """Return the sections of one pose."""
    return [distributions(results), *(_section(name, results) for name in results.found)]


def _folded(results: Results) -> Html:
    """Return the folded sections of a pose that is not the worst."""
    said = [f"Pose {name_pose(results)}"]
    if results.analysis.summary.specifications:
        said.append(describe_verdict(results.analysis.summary.specifications))
    heading = element("summary", element("h2", ": ".join(said), id=f"{results.prefix}heading"))
    parts = [heading, picture(results), specifications(results), *_details(results)]
    return element("details", *parts, class_="pose", id=f"{results.prefix}pose")


def _section(name: str, results: Results) -> Html:
    """Return an analysis's section."""
    declaration, result = declarations()[name], results.found[name]
    if isinstance(result, Missing):
        return section(f"{results.prefix}{name}", declaration.heading, left_out(declaration.title, result, results))
    return section(f"{results.prefix}{name}", declaration.heading, *declaration.content(result, results))


def _contents(poses: Sequence[Results], chapters: Sequence[Chapter]) -> Html:
    titles = {"verdict": "Result", "distributions": "Distributions"}
    titles |= {name: declarations()[name].title for name in poses[0].found}
    titles |= {f"{other.prefix}pose": f"Pose {name_pose(other)}" for other in poses[1:]}
    titles |= {chapter.name: chapter.title for chapter in chapters}
    titles |= {"view": "3-D view", **{name: title for name, (title, _) in _LAST.items()}}
    links = (element("li", element("a", title, href=f"#{name}")) for name, title in titles.items())
    return element("nav", element("ul", *links), aria_label="Contents")


def _policy() -> str:
    return (
        f"default-src 'none'; script-src {policy_hashes()}; style-src 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def _style() -> str:
    return importlib.resources.files(__package__).joinpath("style.css").read_text("utf-8")
