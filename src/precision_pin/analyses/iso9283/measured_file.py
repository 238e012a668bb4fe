"""Measured cycles of a test by ISO 9283 in a CSV file.

    pose, cycle, x [mm], y [mm], z [mm], a [deg], b [deg], c [deg]
    P1, 1, 850.02, -0.01, 600.11, 180.00, 0.01, 90.00

Positions and orientations are in base axes. a, b, c are angles about x, y, z, R = Rot(z, c) Rot(y, b) Rot(x, a); ``rx``, ``ry``,
``rz`` in their place are a rotation vector. Without either only positions are compared.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from precision_pin.base import csv_columns, units
from precision_pin.base.arrays import Array
from precision_pin.base.csv_columns import Measured
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.base.text_escape import shown

_POSITION: Final = ("x", "y", "z")
_TURNS: Final = (("a", "b", "c"), ("rx", "ry", "rz"))
_LONGEST: Final = 40


def read_cycles(path: str | os.PathLike[str], names: Mapping[str, str]) -> dict[str, Array]:
    """Return the attained poses of each pose in the order of the cycles, ``(n, 4, 4)``, or positions ``(n, 3)``.

    Parameters
    ----------
    path
        The file.
    names
        Name of the result's pose, P1 …, by what the file may call it.

    Raises
    ------
    InputError
        The file cannot be read, lacks a column, has one that has no meaning, names another pose, or has a cycle twice.
    """
    found = csv_columns.read(path, texts=("pose",))
    if "pose" not in found.texts:
        raise UnknownNameError(f"column in {found.file}", "pose", found.names)
    turn = next((axes for axes in _TURNS if any(axis in found.names for axis in axes)), ())
    for name in found.names:
        if name not in ("cycle", *_POSITION, *turn):
            other = "; a, b, c and rx, ry, rz exclude each other" if turn and name in sum(_TURNS, ()) else ""
            raise InputError(
                f"{found.file}: the column {shown(name, _LONGEST)} has no meaning; columns are pose, cycle, x, y, z and "
                f"a, b, c or rx, ry, rz{other}"
            )
    cycles = found.column("cycle", units.RATIO)
    values = _values(found, turn)
    rows: defaultdict[str, dict[float, int]] = defaultdict(dict)
    for row, (given, cycle) in enumerate(zip(found.texts["pose"], cycles, strict=True)):
        if given not in names:
            raise UnknownNameError(f"pose in {found.file}", given, names)
        of_pose = rows[names[given]]
        if cycle in of_pose:
            raise InputError(f"{found.file}: the pose {shown(given, _LONGEST)} has the cycle {cycle:g} twice")
        of_pose[cycle] = row
    counted = {pose: sorted(of_pose) for pose, of_pose in rows.items()}
    first, wanted = next(iter(counted.items()))
    for pose, numbers in counted.items():
        if numbers != wanted:
            raise InputError(
                f"{found.file}: {pose} has {len(numbers)} cycles and {first} has {len(wanted)}, or others: every pose "
                "needs the same cycles"
            )
    return {pose: values[[of_pose[cycle] for cycle in wanted]] for pose, of_pose in rows.items()}


def _values(found: Measured, turn: tuple[str, ...]) -> Array:
    """Return positions ``(R, 3)``, or poses ``(R, 4, 4)`` where the file has orientations."""
    positions = np.array([found.column(axis, units.LENGTH) for axis in _POSITION]).T
    if not turn:
        return positions
    angles = np.array([found.column(axis, units.ANGLE) for axis in turn]).T
    # small letters: about the fixed axes x, y, z in this order
    rotation = Rotation.from_euler("xyz", angles) if turn == _TURNS[0] else Rotation.from_rotvec(angles)
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, :3] = rotation.as_matrix()
    poses[:, :3, 3] = positions
    return poses
