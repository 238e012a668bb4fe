"""What the attitude of the tool must be at a place: given, a direction of the tool axis, or any."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arguments import check_numbers, check_text, check_whole
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.postures import alignment
from precision_pin.robot.solution_search import Task

MOST_ANGLES: Final = 3600
Z: Final = (0.0, 0.0, 1.0)


@final
@dataclass(frozen=True, eq=False)
class Orientation:
    """What the attitude of the tool must be at a place; made by :meth:`given`, :meth:`along` or :meth:`free`.

    Attributes
    ----------
    task
        What must agree: ``pose``, ``axis`` or ``position``.
    rotations
        Attitudes of the tip in the base that are tried, ``(A, 3, 3)``; with ``axis`` and ``position`` a single one.
    tool_axis
        The tool axis in the tip's frame.
    label
        Its name; empty where every attitude will do.
    """

    task: Task
    rotations: Array
    tool_axis: Array
    label: str = ""

    def __post_init__(self) -> None:
        fix_fields(self)

    @classmethod
    def given(cls, rotation: ArrayLike, label: str = "") -> Orientation:
        """Return one attitude: a rotation matrix ``(3, 3)``, or roll, pitch and yaw ``(3,)`` in rad, in base axes.

        Raises
        ------
        InputError
            Neither, or a matrix that is no rotation to 1e-9.
        """
        check_text("the label of an orientation", label)
        values = check_numbers("the orientation", rotation, needs="a rotation (3, 3), or roll, pitch and yaw (3,)")
        if values.shape == (3,):
            degrees = " ".join(f"{angle:.6g}" for angle in np.degrees(values) + 0.0)
            return cls("pose", se3.rpy_rotation(values)[None], np.array(Z), label or f"rpy {degrees}°")
        if values.shape != (3, 3):
            raise InputError(
                f"the orientation has the shape {values.shape}, expected a rotation (3, 3), or roll, pitch and yaw (3,)"
            )
        if np.abs(values.T @ values - np.eye(3)).max() > 1e-9 or np.linalg.det(values) < 0:
            raise InputError(
                "the orientation is no rotation: its columns must be orthonormal to 1e-9, without mirroring"
            )
        return cls("pose", values[None], np.array(Z), label or "given")

    @classmethod
    def along(cls, direction: ArrayLike, angles: int | None = None, tool_axis: ArrayLike = Z) -> Orientation:
        """Return a direction of the tool axis in the base, with any angle about it or with some.

        Parameters
        ----------
        direction
            Where the tool axis points, ``(3,)``; its length does not matter.
        angles
            How many angles about the tool axis are tried, in equal steps of a turn; ``None`` leaves the angle to the inverse
            kinematics.
        tool_axis
            The tool axis in the tip's frame, ``(3,)``.

        Raises
        ------
        InputError
            A direction of length zero, or a wrong number of angles.
        """
        unit, axis = _direction("the direction", direction), _direction("the tool axis", tool_axis)
        label = "axis " + " ".join(f"{value:.4g}" for value in unit + 0.0)
        # einsum, as the rounding of a matrix product depends on the machine
        upright = np.einsum("ij,kj->ik", alignment(unit), alignment(axis))
        if angles is None:
            return cls("axis", upright[None], axis, label)
        check_whole("the number of angles about the tool axis", angles, 1, MOST_ANGLES)
        turns = se3.rotation_about(unit, 2 * np.pi * np.arange(angles) / angles)
        return cls("pose", np.einsum("ija,jk->aik", turns, upright), axis, label)

    @classmethod
    def free(cls) -> Orientation:
        """Return that every attitude will do."""
        return cls("position", np.eye(3)[None], np.array(Z))

    @property
    def angle_labels(self) -> tuple[str, ...]:
        """A label for each attitude that is tried: its angle about the tool axis, empty where there is one."""
        count = len(self.rotations)
        return ("",) if count == 1 else tuple(f"{360 * k / count:.6g}°" for k in range(count))


def _direction(name: str, value: ArrayLike) -> Array:
    vector = check_numbers(name, value, (3,), "three finite numbers")
    scaled = vector / max(float(np.abs(vector).max()), 1e-300)
    size = float(np.sqrt((scaled * scaled).sum()))
    if not size > 0:
        raise InputError(f"{name} has length zero; give a direction, such as (0, 0, -1)")
    return scaled / size
