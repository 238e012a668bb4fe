"""The whole page."""

from __future__ import annotations

import importlib.resources
from collections.abc import Sequence
from typing import Final

from precision_pin.analyses.collect import Missing, Results
from precision_pin.analyses.monte_carlo.section import describe_verdict, distributions, specifications
from precision_pin.analyses.registry import declarations
from precision_pin.pages.report.sections import (
    assumptions,
    describe_run,
    geometry,
    left_out,
    parameters,
    reproduction,
    scene,
)
from precision_pin.pages.report.summary import name_pose, picture, summary
from precision_pin.pages.view import script_hashes
from precision_pin.render.chapter import Chapter
from precision_pin.render.html import Html, element, joined, paragraph, section

_LAST: Final = {
    "mcpc": ("MCPC", geometry),
    "parameters": ("Parameters", parameters),
    "reproduce": ("Reproduce", reproduction),
}
"""Sections after those of the poses: title in the list of contents, and function."""
_WITHOUT_SCRIPTS: Final = Html("<noscript><style>.fold:has(> #view) { display: none; }</style></noscript>")
_NOT_PRINTED: Final = (
    "Folded sections are not printed: open them first, or write the page with precision-pin report --full."
)


def page(
    results: Results | Sequence[Results],
    chapters: Sequence[Chapter] = (),
    *,
    missed: Sequence[str] = (),
    full: bool = False,
) -> str:
    """Return one self-contained HTML page about one or several poses: verdict, distributions, causes, bounds, 3-D view.

    Verdict, causes, changes and assumptions are open; every other section is folded, and printed only if it is open.
    The page loads nothing, runs only the 3-D view's scripts in a sandboxed frame, and is reproducible.

    Args:
        results: Results to show; of several poses the worst first.
        chapters: Chapters beside the poses, such as a map or a path of the same chain.
        missed: Where else a specification is not met, such as ``on the map``.
        full: Open all sections initially, except the 3-D view.
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
    details = [
        *_details(worst),
        *(_other_pose(other) for other in poses[1:]),
        *(chapter.section for chapter in chapters),
    ]
    last = [make(poses) for _, make in _LAST.values()]
    if full:
        details, last = _opened(details), _opened(last)
    sections = [
        summary(poses, [line for chapter in chapters for line in chapter.answers], missed),
        _contents(poses, chapters),
        assumptions(poses),
        *details,
        scene(poses, [chapter.layer for chapter in chapters if chapter.layer is not None]),
        *last,
    ]
    on_paper = [] if full else [paragraph(_NOT_PRINTED, class_="note paper")]
    header = element("header", element("h1", title), paragraph(describe_run(poses), class_="subject"), *on_paper)
    main = element("main", *sections, id="main", tabindex="-1")
    footer = element("footer", paragraph("Written by precision-pin."))
    body = joined([element("a", "Skip to the result", class_="skip", href="#main"), header, main, footer])
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head.text}\n</head>\n<body>\n{body.text}\n</body>\n</html>\n'


def _details(results: Results) -> list[Html]:
    return [distributions(results), *(_section(name, results) for name in results.found)]


def _opened(sections: Sequence[Html]) -> list[Html]:
    """Return sections with their folds open; small parts folded inside them, such as minor causes, stay folded."""
    # text is escaped, so this is always a tag
    return [Html(one.text.replace('<details class="fold"', '<details class="fold" open=""')) for one in sections]


def _other_pose(results: Results) -> Html:
    """Return all sections of a pose that is not the worst as one section."""
    said = [f"Pose {name_pose(results)}"]
    if results.analysis.summary.specifications:
        said.append(describe_verdict(results.analysis.summary.specifications))
    parts = [picture(results), specifications(results), *_details(results)]
    return section(f"{results.prefix}pose", ": ".join(said), *parts)


def _section(name: str, results: Results) -> Html:
    declaration, result = declarations()[name], results.found[name]
    if isinstance(result, Missing):
        return section(f"{results.prefix}{name}", declaration.heading, left_out(declaration.title, result, results))
    return section(f"{results.prefix}{name}", declaration.heading, *declaration.content(result, results))


def _contents(poses: Sequence[Results], chapters: Sequence[Chapter]) -> Html:
    titles = {"verdict": "Result", "assumptions": "Assumptions", "distributions": "Distributions"}
    titles |= {name: declarations()[name].title for name in poses[0].found}
    titles |= {f"{other.prefix}pose": f"Pose {name_pose(other)}" for other in poses[1:]}
    titles |= {chapter.name: chapter.title for chapter in chapters}
    titles |= {"view": "3-D view", **{name: title for name, (title, _) in _LAST.items()}}
    links = (element("li", element("a", title, href=f"#{name}")) for name, title in titles.items())
    return element("nav", element("ul", *links), aria_label="Contents")


def _policy() -> str:
    return (
        f"default-src 'none'; script-src {' '.join(script_hashes())}; style-src 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def _style() -> str:
    return importlib.resources.files(__package__).joinpath("style.css").read_text("utf-8")
