"""The joints of a chain as a table for a notebook."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.render.notebook import Table
from precision_pin.robot.urdf import Joint


def joint_table(joints: Sequence[Joint], placements: Array, tip: str) -> Table:
    """Return the table of joints with limits and the pose of each in the one before, and of the tip.

    Parameters
    ----------
    joints
        n joints, base to tip.
    placements
        ``(n+1, 4, 4)``, the placements of the chain.
    tip
        Name of the last frame.
    """
    rows: list[tuple[str, ...]] = [
        (joint.name, joint.kind, spaced(np.array(joint.axis)), _limits(joint), *_placement(placement))
        for joint, placement in zip(joints, placements[:-1], strict=True)
    ]
    rows.append((tip, "tip", "", "", *_placement(placements[-1])))
    return Table(("joint", "kind", "axis", "limits", "x y z [mm]", "roll pitch yaw [°]"), rows, words=2)


def _limits(joint: Joint) -> str:
    if joint.limit is None or not np.isfinite((joint.limit.lower, joint.limit.upper)).any():
        return "none"
    factor, unit = (1e3, "mm") if joint.kind == "prismatic" else (math.degrees(1), "°")
    return f"{factor * joint.limit.lower:.6g} to {factor * joint.limit.upper:.6g} {unit}"


def _placement(pose: Array) -> tuple[str, str]:
    """Return a pose's position in mm, and roll, pitch and yaw in degrees; roll is zero where pitch is a right angle."""
    turn = pose[:3, :3]
    level = math.hypot(turn[0, 0], turn[1, 0])
    pitch = math.atan2(-turn[2, 0], level)
    if level > 1e-9:
        roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    else:
        roll, yaw = 0.0, math.atan2(-turn[0, 1], turn[1, 1])
    return spaced(1e3 * pose[:3, 3]), spaced(np.degrees((roll, pitch, yaw)))


def spaced(values: Array) -> str:
    """Return numbers separated by spaces, with six digits."""
    return " ".join(f"{round(value, 6) + 0.0:.6g}" for value in values.tolist())
