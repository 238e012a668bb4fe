"""Every draw: what it is, how often it is made, and what it feeds."""

from __future__ import annotations

from precision_pin.analyses.budget.shares import owners
from precision_pin.outputs.kit.html import Child, Html, items, paragraph, section, table
from precision_pin.outputs.report.collect import Results
from precision_pin.outputs.report.quantities import quantities_of
from precision_pin.units import Quantity

__all__ = ["parameters"]


def parameters(results: Results) -> Html:
    """Return the table of draws, and the sources that draw nothing."""
    model = results.model
    known = quantities_of(model)
    rows: list[list[Child]] = []
    drawing: set[str] = set()
    for draw, feeds in zip(model.space.draws, owners(model), strict=True):
        quantities = [known.get(component) for component in draw.components]
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


def _named(quantity: Quantity | None) -> str:
    if quantity is None:
        return "not known"
    return quantity.name if quantity.si else "number"
