"""What a report has beside its poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, final

from precision_pin.render.html import Html
from precision_pin.render.scene import Scene


class Layer(Protocol):
    """Something more in the scene, which a box of the legend switches on and off."""

    @property
    def name(self) -> str:
        """Name of its node in the scene, and of its box, ``show-name``."""

    def draw(self, scene: Scene, length: float) -> None:
        """Add its shapes below the node of its name; ``length`` is that of the arm, m."""

    def legend(self) -> str:
        """Return its section of the legend, HTML, with its box."""

    def settings(self, length: float) -> dict[str, Any]:
        """Return the numbers that the scripts of the page need, for JSON."""


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
