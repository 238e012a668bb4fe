"""Table of all draws: law, scope and sources."""

from __future__ import annotations

from collections.abc import Sequence

from precision_pin.analyses.collect import Results
from precision_pin.base.units import Quantity
from precision_pin.render.html import Child, Html, items, paragraph, section, table


def parameters(poses: Sequence[Results]) -> Html:
    """Return the table of draws, and the sources that draw nothing."""
    model = poses[0].model
    rows: list[list[Child]] = []
    drawing: set[str] = set()
    for draw, words, feeds in zip(model.space.draws, model.draw_words, model.owners, strict=True):
        of = draw.known_quantities
        names = {_named(quantity) for quantity in of}
        rows.append(
            [
                words,
                draw.law.describe(of),
                " and ".join(sorted(names)),
                draw.scope.value,
                draw.name,
                ", ".join(feeds) if feeds else "none",
            ]
        )
        drawing.update(feeds)
    quiet = [label for label in model.labels if label not in drawing]
    parts: list[Child] = []
    if rows:
        header = ["what varies", "law", "quantity", "drawn per", "name", "feeds"]
        parts.append(table("Random numbers of the model", header, rows, words=(1, 2, 3, 4, 5)))
    else:
        parts.append(paragraph("Nothing is drawn at random."))
    if quiet:
        parts += [paragraph("Sources without their own random numbers:", class_="note"), items(quiet, "note")]
    return section("parameters", "Parameters", *parts)


def _named(quantity: Quantity | None) -> str:
    if quantity is None:
        return "not known"
    return quantity.name if quantity.si else "number"
