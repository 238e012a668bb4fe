"""A factory calibration as text for a terminal."""

from __future__ import annotations

from typing import Final

from precision_pin.analyses.calibration.factory import FactoryCalibration
from precision_pin.base.text_escape import shortened, visible
from precision_pin.render.tables import milli
from precision_pin.render.text_table import aligned

_NAME: Final = 34


def factory_table(result: FactoryCalibration) -> str:
    """Return how far the built arm is from the nominal robot, and the displacement of each joint."""
    of, chain = result.provenance, result.model.chain
    rows = [["place", "", "x [mm]", "y [mm]", "z [mm]", "rx [mrad]", "ry [mrad]", "rz [mrad]"]]
    for name, values in zip((*chain.joint_names, chain.tip), result.displacements, strict=True):
        rows.append([shortened(name, _NAME), "", *(f"{1e3 * value + 0.0:.4f}" for value in values)])
    lines = [
        f"{visible(of.robot, 30)} is a {result.kind}; as its factory measured it, the tip is "
        f"{milli(result.rms_position, 3)} mm rms from the nominal",
        f"robot's, at most {milli(result.largest_position, 3)} mm (200 random poses); {visible(of.base)} to {visible(of.tip)}",
        f"{visible(result.file)}{f', hash {visible(result.checksum)}' if result.checksum else ''}",
        "",
        *aligned(rows),
        "displacement of each joint's origin and of the tip, in their own axes, as a shift and a rotation vector",
    ]
    return "\n".join(lines)
