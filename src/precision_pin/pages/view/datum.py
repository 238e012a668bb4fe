"""Layer of the 3-D view that draws the procedures of datums: the tips of their poses, and their frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.colors import to_rgb

from precision_pin.model.datum import Procedures
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.html import escaped
from precision_pin.render.scene import Layer, Scene

_COLOURS: Final = ("#cc79a7", "#e69f00", "#56b4e9")
"""Colours of the poses of the datums, in turn."""
_AXES: Final = ("#d55e00", "#009e73", "#0072b2")


def datum_layers(at: PoseModel) -> tuple[Layer, ...]:
    """Return the layer of a model's datums; none in base axes."""
    return () if at.datum is None else (DatumLayer(at.datum.procedures),)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class DatumLayer(Layer):
    """Nominal tips of the poses of each procedure, and triads of the datum's frames."""

    procedures: Procedures

    @property
    def name(self) -> str:
        """Name of the layer."""
        return "datum"

    def settings(self, length: float) -> dict[str, Any]:
        """Return nothing: the shapes are true to scale."""
        del length
        return {}

    def draw(self, scene: Scene, length: float) -> None:
        """Add a ball at the tip of each pose, and the axes of each frame."""
        for number, (datum, visits) in enumerate(self.procedures.by_datum):
            colour = (*to_rgb(_COLOURS[number % len(_COLOURS)]), 1.0)
            for k, visit in enumerate(visits):
                scene.sphere(("datum", f"pose{number}-{k}"), 0.008 * length, colour, visit.at.posture.pose)
            frames = datum.frames(np.array([visit.place for visit in visits]))
            for rank, frame in enumerate(frames.values()):
                for axis, shade in enumerate(_AXES):
                    end = frame[:3, 3] + 0.09 * length * frame[:3, axis]
                    path = ("datum", f"axis{number}-{rank}-{axis}")
                    scene.rod(path, frame[:3, 3], end, 0.003 * length, (*to_rgb(shade), 1.0))

    def legend(self) -> str:
        """Return the section of the legend: each procedure, and what is drawn in base axes."""
        rows = []
        for number, (datum, visits) in enumerate(self.procedures.by_datum):
            colour = _COLOURS[number % len(_COLOURS)]
            frames = datum.frames(np.array([visit.place for visit in visits]))
            axes = f"; axes: {', '.join(frames)}" if frames else ""
            text = f"{datum.name} ({datum.kind}): tip at its {len(visits)} pose{'s' if len(visits) > 1 else ''}{axes}"
            dot = f"background: radial-gradient(circle, {colour} 3px, transparent 3.5px)"
            rows.append(f'<li class="row"><i class="dot" style="{dot}"></i><span>{escaped(text)}</span></li>')
        names = escaped(", ".join(datum.name for datum, _ in self.procedures.by_datum))
        return (
            f'<section aria-label="Datum"><h2>Datum {names}</h2><ul class="legend controls"><li><label>'
            '<input type="checkbox" id="show-datum" checked><i class="axes"></i><span>procedure of the datum</span></label>'
            f'</li>{"".join(rows)}</ul><p class="fine">Cloud, ellipsoids and sampled frames are errors against the datum. Arms '
            "with errors stand in base axes, so their tips are not in the cloud.</p></section>"
        )
