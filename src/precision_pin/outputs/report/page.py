"""The whole page."""

from __future__ import annotations

import importlib.resources
from typing import Final

from precision_pin.outputs.budget.section import causes
from precision_pin.outputs.exact_law.section import exactness
from precision_pin.outputs.kit.html import Html, element, joined, paragraph
from precision_pin.outputs.mcpc import geometry
from precision_pin.outputs.monte_carlo.section import distributions
from precision_pin.outputs.monte_carlo.verdict import verdict
from precision_pin.outputs.report.assumptions import assumptions
from precision_pin.outputs.report.collect import Results
from precision_pin.outputs.report.parameters import parameters
from precision_pin.outputs.report.reproduction import reproduction
from precision_pin.outputs.report.scene import policy_hashes, scene
from precision_pin.outputs.report.wording import subject
from precision_pin.outputs.worst_case.section import bounds

__all__ = ["page"]

_CONTENTS: Final = (
    ("verdict", "Result"),
    ("assumptions", "Assumptions"),
    ("distributions", "Distributions"),
    ("budget", "Budget"),
    ("worst-case", "Worst case"),
    ("exact-law", "Exact law"),
    ("mcpc", "MCPC"),
    ("parameters", "Parameters"),
    ("view", "3-D view"),
    ("reproduce", "Reproduce"),
)
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
    sections = (
        verdict,
        assumptions,
        distributions,
        causes,
        bounds,
        exactness,
        geometry,
        parameters,
        scene,
        reproduction,
    )
    header = element(
        "header",
        element("h1", title),
        paragraph(f"{analysis.robot}: {subject(results)}", class_="subject"),
    )
    main = element("main", *(make(results) for make in sections), id="main", tabindex="-1")
    footer = element("footer", paragraph("Written by precision-pin."))
    body = joined([element("a", "Skip to the result", class_="skip", href="#main"), header, _contents(), main, footer])
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head.text}\n</head>\n<body>\n{body.text}\n</body>\n</html>\n'


def _contents() -> Html:
    links = (element("li", element("a", name, href=f"#{anchor}")) for anchor, name in _CONTENTS)
    return element("nav", element("ul", *links), aria_label="Contents")


def _policy() -> str:
    return (
        f"default-src 'none'; script-src {policy_hashes()}; style-src 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def _style() -> str:
    return importlib.resources.files(__package__).joinpath("style.css").read_text("utf-8")
