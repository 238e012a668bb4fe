"""What a page can show beside the arm and its errors: a map, a path; each with its shapes, its legend and its numbers."""

from __future__ import annotations

from typing import Any, Protocol

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
