"""What a report has beside its poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from precision_pin.render.html import Html
from precision_pin.render.layers import Layer


@final
@dataclass(frozen=True)
class Chapter:
    """A section of its own, with its answers at the head of the page.

    Attributes:
        name, title: Identifier of the section, and title in the list of contents.
        section: The section.
        answers: Lines for the head of the page.
        layer: What the 3-D view shows of it.
    """

    name: str
    title: str
    section: Html
    answers: tuple[str, ...] = ()
    layer: Layer | None = None
