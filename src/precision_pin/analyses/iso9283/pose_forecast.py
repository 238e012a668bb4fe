"""The forecast at a pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

from precision_pin.analyses.iso9283.figure_law import FigureLaw
from precision_pin.analyses.provenance import PoseLabel
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array

OF_POSITION: Final = ("AP", "RP", "AP_x", "AP_y", "AP_z")
"""Figures of the position."""
OF_ANGLES: Final = ("AP_a", "AP_b", "AP_c", "RP_a", "RP_b", "RP_c")
"""Figures of the orientation."""
OF_POSE: Final = (*OF_POSITION, *OF_ANGLES, "RP_limit")
"""All figures of a pose; the last is not measured."""
SINGLE: Final = ("AD", "RD", "E", "vAP", "RP_bidirectional", "drift")
"""Figures that a test has once."""


@final
@dataclass(frozen=True, eq=False)
class PoseForecast:
    """The laws of the figures at a pose, m and rad.

    Attributes
    ----------
    label
        Name of the pose in the sheet, empty where it has none, and its joint values.
    commanded
        Commanded pose of the tip in the base, ``(4, 4)``.
    point
        Commanded position of the target, ``(3,)``: that of the tip where no target is given.
    AP, AP_x, AP_y, AP_z, AP_a, AP_b, AP_c
        Accuracy: |x̄ - x_c|, its parts along the base axes, and the mean angles about them.
    RP, RP_a, RP_b, RP_c
        Repeatability: l̄ + 3 S_l, and three standard deviations of the angles.
    RP_limit
        RP of endless cycles, which varies over the robots only.
    """

    label: PoseLabel
    commanded: Array
    point: Array
    AP: FigureLaw
    RP: FigureLaw
    AP_x: FigureLaw
    AP_y: FigureLaw
    AP_z: FigureLaw
    AP_a: FigureLaw
    AP_b: FigureLaw
    AP_c: FigureLaw
    RP_a: FigureLaw
    RP_b: FigureLaw
    RP_c: FigureLaw
    RP_limit: FigureLaw

    def __post_init__(self) -> None:
        fix_fields(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``poses`` in the JSON."""
        laws = {name: getattr(self, name).to_dict() for name in OF_POSE}
        return {**self.label.to_dict(), "position": self.point.tolist(), **laws}
