"""Parts of a report and layers of the view besides the poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, final

from precision_pin.render.html import Html
from precision_pin.render.scene import Scene


class Layer(Protocol):
    """Extra shapes in the scene, switched on and off by a box of the legend."""

    @property
    def name(self) -> str:
        """Name of the scene node, and of the box, ``show-name``."""

    def draw(self, scene: Scene, length: float) -> None:
        """Add the shapes below the layer's node; ``length`` is that of the arm, m."""

    def legend(self) -> str:
        """Return the HTML of the layer's section of the legend, with its box."""

    def settings(self, length: float) -> dict[str, Any]:
        """Return the numbers for the page's scripts, for JSON."""


@final
@dataclass(frozen=True)
class Chapter:
    """A section of its own.

    Attributes:
        name, title: Identifier, and title in the table of contents.
        answers: Lines for the head of the page.
        layer: What the 3-D view shows of it.
    """

    name: str
    title: str
    section: Html
    answers: tuple[str, ...] = ()
    layer: Layer | None = None
