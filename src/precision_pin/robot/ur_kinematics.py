"""Factory calibration of a UR robot as in its files: frames of the joints at zero.

A controller's ``calibration.conf`` has differences to the nominal Denavit-Hartenberg parameters,

    T_i = Rz(q_i + θ_i + Δθ_i) · Tz(d_i + Δd_i) · Tx(a_i + Δa_i) · Rx(α_i + Δα_i),

where the Δd of the nearly parallel axes 2, 3 and 4 can be hundreds of metres and cancel. The YAML of the ROS driver has
the frame of each joint in the previous one, as the origin of a URDF joint: fixed-axis roll, pitch, yaw. Only
the axes at zero and the flange matter, so both are converted to these.
"""

from __future__ import annotations

import itertools
import os
import re
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.files import UnreadableFileError, note_input, read_text_file

MODELS: Final = {
    "UR3": (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    "UR5": (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "UR10": (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    "UR3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "UR5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "UR10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "UR16e": (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
    "UR8 Long": (0.2186, -0.8989, -0.7149, 0.1824, 0.1361, 0.1434),
    "UR15": (0.2186, -0.6475, -0.5164, 0.1824, 0.1361, 0.1434),
    "UR18": (0.2186, -0.475, -0.3389, 0.1824, 0.1361, 0.1434),
    "UR20": (0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
    "UR30": (0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543),
}
"""Nominal d1, a2, a3, d4, d5 and d6 of each model, m, as published by its maker; a UR7e is a UR5e, a UR12e a UR10e."""
_ALPHA: Final = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
_LINKS: Final = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_NUMBERS: Final = ("x", "y", "z", "roll", "pitch", "yaw")
_DELTAS: Final = ("delta_theta", "delta_a", "delta_d", "delta_alpha")
_LARGEST: Final = 2**20  # bytes of a calibration file


@dataclass(frozen=True, eq=False)
class UrKinematics:
    """A six-joint arm at zero: frames of joints ``(6, 4, 4)``, z along the axes, and flange ``(4, 4)``, in the base.

    ``checksum`` is the file's ``hash``. ``is_whole``: the file has the arm itself, not differences to a model.
    ``was_folded``: the file has the forearm turned back, which was undone.
    """

    joints: Array
    flange: Array
    checksum: str = ""
    is_whole: bool = False
    was_folded: bool = False

    def pose(self, q: Array) -> Array:
        """Return the flange in the base, ``(…, 4, 4)``, at joint values ``(…, 6)``."""
        previous, result = np.eye(4), np.eye(4)
        for k, joint in enumerate(self.joints):
            rotation = np.zeros((*q.shape[:-1], 4, 4))
            rotation[..., 0, 0] = rotation[..., 1, 1] = np.cos(q[..., k])
            rotation[..., 1, 0] = np.sin(q[..., k])
            rotation[..., 0, 1] = -rotation[..., 1, 0]
            rotation[..., 2, 2] = rotation[..., 3, 3] = 1.0
            result = result @ (se3.inverse(previous) @ joint) @ rotation
            previous = joint
        return result @ (se3.inverse(previous) @ self.flange)

    @classmethod
    def of_dh(cls, theta: Array, a: Array, d: Array, alpha: Array) -> UrKinematics:
        """Return the arm of Denavit-Hartenberg parameters, ``(6,)`` each."""
        frames, frame = [], np.eye(4)
        for k in range(6):
            frame = frame @ _turn(theta[k]) @ se3.translation([0.0, 0.0, d[k]])
            frames.append(frame)
            frame = frame @ se3.translation([a[k], 0.0, 0.0]) @ se3.displacement([0.0, 0.0, 0.0, alpha[k], 0.0, 0.0])
        return cls(np.array(frames), frame)


def nominal_ur(name: str) -> UrKinematics:
    """Return a model of :data:`MODELS` as published by its maker."""
    return UrKinematics.of_dh(*_nominal(name))


def _nominal(name: str) -> tuple[Array, Array, Array, Array]:
    d1, a2, a3, d4, d5, d6 = MODELS[name]
    return np.zeros(6), np.array([0, a2, a3, 0, 0, 0]), np.array([d1, 0, 0, d4, d5, d6]), np.array(_ALPHA)


def read_ur_calibration(path: str | os.PathLike[str], name: str, *, x_y_z: bool = False) -> UrKinematics:
    """Return the arm of a factory calibration: a controller's ``calibration.conf``, or the YAML of the ROS driver.

    The differences of a ``calibration.conf`` are added to the model ``name``. ``x_y_z`` reads a YAML's angles as turns
    about x, the new y and the new z, as meant by the tool that extracts it, unlike URDF readers.
    """
    file = os.fspath(path)
    try:
        text = read_text_file(file, _LARGEST)
    except UnreadableFileError as error:
        raise InputError(f"the factory calibration {file} {error.reason}") from None
    note_input(file)
    if any(_find_assignment(text, key) for key in _DELTAS):
        deltas = [_list(file, text, key) for key in _DELTAS]
        theta, a, d, alpha = (value + delta for value, delta in zip(_nominal(name), deltas, strict=True))
        return UrKinematics.of_dh(theta, a, d, alpha)
    return _read_yaml(file, text, x_y_z=x_y_z)


def _find_assignment(text: str, key: str) -> re.Match[str] | None:
    # blanks within the line only: the search would restart at each of many blank lines
    return re.search(rf"^[^\S\n]*{key}[^\S\n]*=", text, re.MULTILINE)


def _list(file: str, text: str, key: str) -> Array:
    match = _find_assignment(text, key)
    opening, _, tail = ("", "", "") if match is None else text[match.end() :].partition("[")
    if match is None or opening.strip() or "]" not in tail:
        raise _wrong(file, f"{key} = [six numbers] is missing")
    try:
        values = np.array([float(part) for part in tail.partition("]")[0].split(",")])
    except ValueError:
        values = np.zeros(0)
    if values.shape != (6,) or not np.isfinite(values).all():
        raise _wrong(file, f"{key} needs six numbers", text[: match.end()].count("\n") + 1)
    return values


def _read_yaml(file: str, text: str, *, x_y_z: bool) -> UrKinematics:
    try:
        data: Any = YAML(typ="safe", pure=True).load(text)
    except (YAMLError, ValueError, RecursionError):
        data = None
    kinematics = data.get("kinematics") if isinstance(data, dict) else None
    if not isinstance(kinematics, dict):
        lacks = "neither delta_theta = [...] as in calibration.conf nor kinematics:"
        raise _wrong(file, f"this is no factory calibration: {lacks}")
    steps = []
    for link in _LINKS:
        entry = kinematics.get(link)
        values = [entry.get(number) for number in _NUMBERS] if isinstance(entry, dict) else []
        numbers = [float(value) for value in values if isinstance(value, int | float) and np.isfinite(value)]
        if len(numbers) != len(_NUMBERS):
            raise _wrong(file, f"kinematics: {link} needs the numbers {', '.join(_NUMBERS)}")
        steps.append(numbers)
    transforms = _transforms(steps, x_y_z=x_y_z)
    # wrist 1 lies back along the upper arm at zero; a UR is stretched there
    is_folded = bool(transforms[2, :2, 3] @ (transforms[2, :3, :3] @ transforms[3, :3, 3])[:2] < 0)
    if is_folded:
        transforms = _unfold(_transforms(steps, x_y_z=True))
    frames = np.array(list(itertools.accumulate(transforms, np.matmul)))
    return UrKinematics(frames, frames[-1], str(kinematics.get("hash") or ""), is_whole=True, was_folded=is_folded)


def _transforms(steps: list[list[float]], *, x_y_z: bool) -> Array:
    frames = []
    for x, y, z, *angles in steps:
        about_x, about_y, about_z = map(se3.exp_rotation, np.diag(angles))
        rotation = about_x @ about_y @ about_z if x_y_z else about_z @ about_y @ about_x
        frames.append(se3.pose(rotation, np.array([x, y, z])))
    return np.array(frames)


def _unfold(placed: Array) -> Array:
    """Return the frames without the half turns of elbow and wrist 1 added by older tools."""
    # `ur_calibration` before June 2024 uses the arctangent of y/x for the direction from the elbow to the axis of
    # wrist 1, which is the opposite one if |θ_2 + Δθ_2| exceeds π/2. The elbow is then turned by π about its axis,
    # wrist 1 turned back, and the axis of wrist 1 lies on the other side of the elbow. Wrist 1 is d along its axis from
    # where this meets the elbow's plane; turning that part with it gives the controller's robot.
    half = _turn(np.pi)
    elbow, wrist = placed[2] @ half, placed[3].copy()
    axis = wrist[:3, 2]
    along = axis * wrist[2, 3] / axis[2]
    wrist[:3, :3] = half[:3, :3] @ wrist[:3, :3]
    wrist[:3, 3] += half[:3, :3] @ along - along
    return np.array([*placed[:2], elbow, wrist, *placed[4:]])


def _turn(angle: float) -> Array:
    return se3.displacement([0.0, 0.0, 0.0, 0.0, 0.0, angle])


def _wrong(file: str, message: str, line: int | None = None) -> InputError:
    return InputError.of("E_DATA", message, file, line)
