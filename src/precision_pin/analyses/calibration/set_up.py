"""The first guess of an unknown set-up: base of the robot in the instrument's axes, or anchor of distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import Station
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.sheet.measurement import Anchor, Measurement, Plane, Sockets


@final
@dataclass(frozen=True, eq=False)
class SetUp:
    """Set-up of the instrument as estimated.

    Attributes
    ----------
    base
        The robot's base in the instrument's axes, ``(4, 4)``; ``None`` where it is known.
    target, anchor
        Target in tool axes, and the anchor of distances in base axes, m, ``(3,)``; no anchor for other readings.
    plane
        Point and unit normal of the plane in base axes, ``(2, 3)``; ``None`` for other readings.
    sockets
        Places of sockets in base axes, m, ``(S, 3)``; ``None`` for other readings.
    std
        Standard deviation of each unknown number, m and rad.
    """

    base: Array | None
    target: Array
    anchor: Array | None
    plane: Array | None
    sockets: Array | None
    std: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the set-up as in the JSON."""
        return {
            "base": None if self.base is None else self.base.tolist(),
            "target": self.target.tolist(),
            "anchor": None if self.anchor is None else self.anchor.tolist(),
            "plane": None if self.plane is None else self.plane.tolist(),
            "sockets": None if self.sockets is None else self.sockets.tolist(),
            "std": self.std,
        }

    @classmethod
    def of(cls, measurement: Measurement, base: Array, nuisances: Array, covariance: Array) -> SetUp:
        """Return the set-up of estimated nuisances ``(k,)`` beside a first guess of the base."""
        value = dict(zip(measurement.nuisances, nuisances.tolist(), strict=True))
        axes = ("x", "y", "z")
        target = np.array(measurement.target) + [value.get(f"target.{axis}", 0.0) for axis in axes]
        anchor, placed, plane, sockets = None, None, None, None
        place = measurement.place
        own = np.zeros(0) if place is None else np.array([value.get(name, 0.0) for name in place.names])
        if isinstance(place, Anchor):
            anchor = np.array(place.place) + own
        elif isinstance(place, Plane):
            plane = np.array(place.tilted(own))
        elif isinstance(place, Sockets):
            sockets = np.array(place.places) + own.reshape(-1, 3)
        elif measurement.base == "free":
            placed = base @ se3.displacement(nuisances[:6])
        deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
        return cls(placed, target, anchor, plane, sockets, dict(zip(measurement.nuisances, deviations, strict=True)))


def first_guess(data: CalibrationData, stations: Sequence[Station], measurement: Measurement) -> tuple[Array, Array]:
    """Return the base in the instrument's axes, ``(4, 4)``, that fits the nominal arm best, and the nuisances beside it.

    Raises
    ------
    InputError
        There are too few positions for a base, or they lie on one line.
    """
    nuisances = np.zeros(len(measurement.nuisances))
    if measurement.base == "known" or measurement.kind in ("plane", "socket"):
        return np.eye(4), nuisances
    nominal, turns = np.zeros((len(data), 3)), np.zeros((3, 3))
    plain = Measurement("pose", target=measurement.target)
    for station in stations:
        pose = station.at.posture.pose
        predicted = plain.predict(pose, station.at.error_at_means[:, None], np.zeros((0, 1)))[:, 0]
        nominal[list(station.rows)] = predicted[:3]
        for row in station.rows if measurement.kind == "pose" else ():
            expected = se3.exp_rotation(predicted[3:]) @ pose[:3, :3]
            turns += se3.exp_rotation(data.readings[row, 3:]) @ expected.T
    if measurement.kind == "distance":
        nuisances[:3] = _anchor(nominal, data.readings[:, 0]) - measurement.anchor
        return np.eye(4), nuisances
    measured = data.readings[:, :3]
    centre, other = nominal.mean(axis=0), measured.mean(axis=0)
    if measurement.kind == "position":
        turns = (measured - other).T @ (nominal - centre)
        values = np.linalg.svd(turns, compute_uv=False)
        if len(nominal) < 3 or values[1] < 1e-6 * values[0]:
            raise InputError("a free base needs at least three positions that do not lie on one line")
    left, _, right = np.linalg.svd(turns)
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return se3.pose(rotation, other - rotation @ centre), nuisances


def _anchor(points: Array, distances: Array) -> Array:
    """Return the anchor ``(3,)`` from which points ``(P, 3)`` have these distances best: ``|p|² - d² = 2 p·a - |a|²``.

    Raises
    ------
    InputError
        There are too few points, or they lie in one plane.
    """
    centre = points.mean(axis=0)
    near = points - centre
    rows = np.hstack([2 * near, -np.ones((len(near), 1))])
    if len(near) < 4 or np.linalg.svd(near, compute_uv=False)[2] < 1e-6 * np.abs(near).max():
        raise InputError("a free anchor needs distances of at least four points that do not lie in one plane")
    found = np.linalg.lstsq(rows, (near**2).sum(axis=1) - distances**2, rcond=None)[0]
    anchor: Array = centre + found[:3]
    return anchor


def readings_in_base(
    data: CalibrationData, stations: Sequence[Station], base: Array, measurement: Measurement
) -> Array:
    """Return readings ``(P, m)`` as :meth:`Measurement.predict` returns them: in base axes, turns from the nominal attitude."""
    if measurement.place is not None:
        return data.readings
    rotation = base[:3, :3]
    result = data.readings.copy()
    result[:, :3] = (data.readings[:, :3] - base[:3, 3]) @ rotation
    if measurement.kind == "pose":
        for station in stations:
            nominal = station.at.posture.pose[:3, :3]
            for row in station.rows:
                attitude = rotation.T @ se3.exp_rotation(data.readings[row, 3:])
                result[row, 3:] = se3.log_rotation(attitude @ nominal.T)
    return result
