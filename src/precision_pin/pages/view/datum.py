"""Layer of the 3-D view that draws the procedures of datums: the tips of their poses, and their frames."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from matplotlib.colors import to_rgb

from precision_pin.base.arrays import Array
from precision_pin.model.pose_model import Solver
from precision_pin.render.html import escaped
from precision_pin.render.scene import Layer, Scene
from precision_pin.robot.datums import Datum

_COLOURS: Final = ("#cc79a7", "#e69f00", "#56b4e9")
"""Colours of the poses of the datums, in turn."""
_AXES: Final = ("#d55e00", "#009e73", "#0072b2")


@dataclass(frozen=True, eq=False)
class DatumLayer(Layer):
    """Nominal tips of the poses of each procedure, and triads of the datum's frames."""

    procedures: Solver

    @property
    def name(self) -> str:
        """Name of the layer."""
        return "datum"

    @property
    def _rows(self) -> Iterator[tuple[str, Datum, Array, dict[str, Array]]]:
        """Colour of each datum, the datum, nominal tips of its poses ``(V, 4, 4)``, and its frames."""
        for colour, (datum, places, tips) in zip(itertools.cycle(_COLOURS), self.procedures.by_datum(), strict=False):
            if len(tips):
                yield colour, datum, tips, datum.frames(places)

    def settings(self, length: float) -> dict[str, Any]:
        """Return nothing: the shapes are true to scale."""
        del length
        return {}

    def draw(self, scene: Scene, length: float) -> None:
        """Add a ball at the tip of each pose, and the axes of each frame."""
        for number, (colour, _, tips, frames) in enumerate(self._rows):
            for k, tip in enumerate(tips):
                scene.sphere(("datum", f"pose{number}-{k}"), 0.006 * length, (*to_rgb(colour), 1.0), tip)
            for (rank, frame), axis in itertools.product(enumerate(frames.values()), range(3)):
                origin, end = frame[:3, 3], frame[:3, 3] + 0.09 * length * frame[:3, axis]
                path = ("datum", f"axis{number}-{rank}-{axis}")
                scene.rod(path, origin, end, 0.003 * length, (*to_rgb(_AXES[axis]), 1.0))

    def legend(self) -> str:
        """Return the section of the legend: each procedure, and what is drawn in base axes."""
        rows = ""
        for colour, datum, tips, frames in self._rows:
            axes = f"; axes: {', '.join(frames)}" if frames else ""
            text = f"{datum.name} ({datum.kind}): tip at its {len(tips)} pose{'s' if len(tips) > 1 else ''}{axes}"
            dot = f"background: radial-gradient(circle, {colour} 3px, transparent 3.5px)"
            rows += f'<li class="row"><i class="dot" style="{dot}"></i><span>{escaped(text)}</span></li>'
        names = escaped(", ".join(datum.name for datum in self.procedures.datums))
        return (
            f'<section aria-label="Datum"><h2>Datum {names}</h2><ul class="legend controls"><li><label>'
            '<input type="checkbox" id="show-datum" checked><i class="axes"></i><span>procedure of the datum</span></label>'
            f'</li>{rows}</ul><p class="fine">Cloud, ellipsoids, sampled frames and arms with '
            "errors are drawn against the datum: each arm is moved as a whole, so that its tip errs as there.</p></section>"
        )
