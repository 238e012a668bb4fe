"""Every draw: what it is, how often it is made, and what it feeds."""

from __future__ import annotations

import itertools

from precision_pin.draws.space import Draw
from precision_pin.outputs.kit.html import Child, Html, items, paragraph, section, table
from precision_pin.outputs.report.collect import Results
from precision_pin.units import PerJoint, Quantity

__all__ = ["parameters"]


def parameters(results: Results) -> Html:
    """Return the table of draws, and the sources that draw nothing."""
    model = results.model
    rows: list[list[Child]] = []
    drawing: set[str] = set()
    for draw, feeds in zip(model.space.draws, model.owners, strict=True):
        quantities = _quantities(draw)
        names = {_named(quantity) for quantity in quantities}
        rows.append(
            [
                draw.name,
                " and ".join(sorted(names)),
                draw.law.describe(quantities),
                draw.scope.value,
                ", ".join(feeds) if feeds else "none",
            ]
        )
        drawing.update(feeds)
    quiet = [label for label in model.labels if label not in drawing]
    parts: list[Child] = []
    if rows:
        header = ["draw", "quantity", "law", "drawn per", "feeds"]
        parts.append(table("Random numbers of the model", header, rows, words=(1, 2, 3, 4)))
    else:
        parts.append(paragraph("Nothing is drawn at random."))
    if quiet:
        parts += [paragraph("Sources without random numbers of their own:", class_="note"), items(quiet, "note")]
    return section("parameters", "Parameters", *parts)


def _quantities(draw: Draw) -> list[Quantity | None]:
    """Return what each number of a draw is; a model's draws know which kind of joint they are at."""
    known = itertools.zip_longest(draw.components, draw.quantities)
    return [None if isinstance(quantity, PerJoint) else quantity for _, quantity in known]


def _named(quantity: Quantity | None) -> str:
    if quantity is None:
        return "not known"
    return quantity.name if quantity.si else "number"
