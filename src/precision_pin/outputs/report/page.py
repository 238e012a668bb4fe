"""The whole page."""

from __future__ import annotations

import importlib.resources
from typing import Final

from precision_pin.analyses.registry import declarations
from precision_pin.outputs.kit.html import Html, element, joined, paragraph, section
from precision_pin.outputs.mcpc import geometry
from precision_pin.outputs.monte_carlo.section import distributions
from precision_pin.outputs.monte_carlo.verdict import verdict
from precision_pin.outputs.report.assumptions import assumptions
from precision_pin.outputs.report.collect import Missing, Results
from precision_pin.outputs.report.parameters import parameters
from precision_pin.outputs.report.reproduction import reproduction
from precision_pin.outputs.report.scene import policy_hashes, scene
from precision_pin.outputs.report.wording import left_out, subject

__all__ = ["page"]

_FIRST: Final = {
    "verdict": ("Result", verdict),
    "assumptions": ("Assumptions", assumptions),
    "distributions": ("Distributions", distributions),
}
_LAST: Final = {
    "mcpc": ("MCPC", geometry),
    "parameters": ("Parameters", parameters),
    "view": ("3-D view", scene),
    "reproduce": ("Reproduce", reproduction),
}
"""Sections before and after those of the analyses: in the list of contents, and what makes them."""
_WITHOUT_SCRIPTS: Final = Html(
    "<noscript><style>.still { display: block; } iframe.screen, .note.screen { display: none; }</style></noscript>"
)


def page(results: Results) -> str:
    """Return one self-contained HTML page about one pose: verdict, distributions, causes, bounds, 3-D view.

    It loads nothing from outside, runs no script but those of the 3-D view, which run in a sandboxed frame, and is the same
    text for the same results.

    Parameters
    ----------
    results
        What it shows.
    """
    analysis = results.analysis
    title = f"Pose error of {results.model.chain.robot.name}, {analysis.base} to {analysis.tip}"
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
        *(make(results) for _, make in _FIRST.values()),
        *(_section(name, results) for name in results.found),
        *(make(results) for _, make in _LAST.values()),
    ]
    header = element(
        "header",
        element("h1", title),
        paragraph(f"{analysis.robot}: {subject(results)}", class_="subject"),
    )
    main = element("main", *sections, id="main", tabindex="-1")
    footer = element("footer", paragraph("Written by precision-pin."))
    body = joined(
        [element("a", "Skip to the result", class_="skip", href="#main"), header, _contents(results), main, footer]
    )
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head.text}\n</head>\n<body>\n{body.text}\n</body>\n</html>\n'


def _section(name: str, results: Results) -> Html:
    """Return an analysis's section."""
    declaration, result = declarations()[name], results.found[name]
    if isinstance(result, Missing):
        return section(name, declaration.heading, left_out(declaration.title, result, results))
    return section(name, declaration.heading, *declaration.content(result, results))


def _contents(results: Results) -> Html:
    titles = {name: title for name, (title, _) in _FIRST.items()}
    titles |= {name: declarations()[name].title for name in results.found}
    titles |= {name: title for name, (title, _) in _LAST.items()}
    links = (element("li", element("a", title, href=f"#{name}")) for name, title in titles.items())
    return element("nav", element("ul", *links), aria_label="Contents")


def _policy() -> str:
    return (
        f"default-src 'none'; script-src {policy_hashes()}; style-src 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def _style() -> str:
    return importlib.resources.files(__package__).joinpath("style.css").read_text("utf-8")
