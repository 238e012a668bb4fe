"""A calibration in the scene: where the calibrated arm predicts the readings, and how far from there they were measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from precision_pin.analyses.calibration.calibrate import CalibrationResult, WorstReadings
from precision_pin.analyses.calibration.table import MOST_READINGS, deviations_text, headline
from precision_pin.base.arrays import Array
from precision_pin.render.colour_scale import ColourScale, round_number
from precision_pin.render.html import escaped
from precision_pin.render.scene import Scene
from precision_pin.render.tables import milli

MOST_DRAWN: Final = 200
"""The most readings of one page, the worst ones."""
_LARGEST: Final = 0.12
"""Largest residual of a reading with weight at first, in lengths of the arm."""
_LONGEST: Final = 0.2
"""Longest line, in lengths of the arm."""
_FEW: Final = 60
"""The most readings whose residuals before the calibration are shown at first."""
_ROUNDING: Final = 1e-12
"""Residuals (m) below which a reading is where it is predicted."""
_PER_METRE: Final = 1e3
_LIMITED: Final = {
    "distance": "Only the part along the line of sight is measured, and drawn; that line is shown for the marked reading.",
    "plane": "Only the height over the plane is measured: lines are along its normal.",
}
"""What lines show of readings that have not three lengths."""


@final
@dataclass(frozen=True, eq=False)
class CalibrationLayer:
    """A calibration, its worst readings, which are drawn, and colours for residuals of readings that have weight."""

    result: CalibrationResult
    worst: WorstReadings
    scale: ColourScale

    @classmethod
    def of(cls, result: CalibrationResult) -> CalibrationLayer:
        """Return the layer of a calibration."""
        worst = WorstReadings.of(result, MOST_DRAWN)
        counted = worst.sizes[~worst.is_gross & (worst.sizes > _ROUNDING)]
        return cls(result, worst, ColourScale.of(np.append(counted, 0.0)))

    @property
    def name(self) -> str:
        """Name of the layer."""
        return "calibration"

    def draw(self, scene: Scene, length: float) -> None:
        """Add the predicted places as crosses; the scripts add the residuals."""
        half = 0.004 * length
        ends = [
            point + sign * half * axis for point in self.worst.points.T for axis in np.eye(3) for sign in (-1.0, 1.0)
        ]
        scene.segments((self.name, "predicted"), np.array(ends).T, (0.1, 0.1, 0.1, 1.0))

    def settings(self, length: float) -> dict[str, Any]:
        """Return places and residuals by x, y, z in m, worst first, and how many times too large they are drawn at first."""
        worst = self.worst
        return {
            "times": round_number(_LARGEST * length / self.scale.largest) if self.scale.largest > 0 else 1.0,
            "longest": _LONGEST * length,
            "points": _rounded(worst.points),
            "after": _rounded(worst.after),
            "before": _rounded(worst.before),
            "gross": np.flatnonzero(worst.is_gross).tolist(),
            "rows": list(worst.lines),
            "largest": self.scale.largest,
            "anchor": None if worst.anchor is None else worst.anchor.tolist(),
        }

    def legend(self) -> str:
        """Return the section of the legend: the answer, the worst readings, the colours, and how large all is drawn."""
        result, worst = self.result, self.worst
        said = "".join(f"<p>{escaped(line)}</p>" for line in headline(result))
        count, drawn = len(result.data), len(worst.lines)
        which = f"the worst {drawn:,} of {count:,} readings" if drawn < count else _counted(count)
        before = " checked" if drawn <= _FEW else ""
        limited = " ".join(dict.fromkeys(_LIMITED.get(one.kind, "") for one in result.data.measurements))
        return (
            f'<section aria-label="Calibration"><h2>Calibration: readings against predictions</h2>{said}'
            '<div class="controls"><p>The worst readings first, in mm and in standard deviations (std); press one to mark it:</p>'
            f'<ol class="readings">{self._buttons()}</ol></div>'
            f'<div id="calibration-bar"><h2>Residual after calibration, mm</h2>{self.scale.bar(_PER_METRE)}</div>'
            '<ul class="legend controls">'
            '<li><label><input type="checkbox" id="show-calibration" checked><i class="line measured"></i>'
            f"<span>{escaped(which)}: line from the predicted place (cross) to the measured one (ball)</span></label></li>"
            f"{self._gross()}"
            f'<li><label><input type="checkbox" id="calibration-before"{before}><i class="line thin"></i>'
            "<span>thin line: the same before calibration</span></label></li></ul>"
            '<p class="fine">Residuals are drawn at <span id="calibration-times"></span> times their size. Lines that would be '
            f"longer than a fifth of the arm are cut; a thick one then has no ball. {escaped(limited)} The arm and the sampled "
            "robots are those of the sheet, before calibration.</p></section>"
        )

    def _buttons(self) -> str:
        """Return a button for each of the worst readings; the first is pressed."""
        worst = self.worst
        entries = []
        for k in range(min(MOST_READINGS, len(worst.lines))):
            unweighted = ", no weight" if worst.is_gross[k] else ""
            size, deviations = milli(float(worst.sizes[k]), 3), deviations_text(worst.deviations[k])
            text = f"{worst.labels[k]}: {size} mm, {deviations} std{unweighted}"
            pressed = "false" if k else "true"
            entries.append(
                f'<li><button type="button" data-reading="{k}" aria-pressed="{pressed}">{escaped(text)}</button></li>'
            )
        return "".join(entries)

    def _gross(self) -> str:
        """Return the line of the legend about gross errors, if there are any."""
        if not self.worst.is_gross.any():
            return ""
        words = "red: readings that fit no other and were given no weight"
        return f'<li class="row"><i class="line gross"></i><span>{escaped(words)}</span></li>'


def _counted(count: int) -> str:
    return "the reading" if count == 1 else f"all {count:,} readings"


def _rounded(values: Array) -> list[float]:
    """Return vectors ``(3, K)`` by x, y, z with the digits that a picture can show."""
    return [float(f"{value:.7g}") for value in values.T.ravel()]
