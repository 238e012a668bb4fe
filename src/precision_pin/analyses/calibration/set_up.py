"""The instruments of a calibration, what they share of the set-up, and the first guess of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import Station, stations_of
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.record import Record
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.sheet.measurement import Anchor, Measurement, Plane, Slopes, Sockets


@final
@dataclass(frozen=True, eq=False)
class Instruments:
    """Measurements whose unknown numbers (nuisances) are shared where they have one name; one measurement or many.

    Raises:
        InputError: One name stands for different targets or places.
    """

    parts: tuple[Measurement, ...]

    def __post_init__(self) -> None:
        first: dict[str, Measurement] = {}
        for part in self.parts:
            target = "target" + (f"[{part.target_name}]" if part.target_name else "")
            for name in (*part.nuisances, f"{target}.x"):
                other = first.setdefault(name, part)
                if name.startswith("target"):
                    is_same = part.target_known == other.target_known and (
                        part.target_known or part.target == other.target
                    )
                else:
                    is_same = part.place == other.place
                if not is_same:
                    key = "target_name" if name.startswith("target") else "base_name"
                    raise InputError(
                        f"two measurements share {name.partition('.')[0]} and say different things of it; "
                        f"give each {key} of its own"
                    )

    @cached_property
    def nuisances(self) -> tuple[str, ...]:
        """Names of all unknown numbers of the set-up, those of a base first."""
        names = dict.fromkeys(name for part in self.parts for name in part.nuisances)
        return tuple(sorted(names, key=lambda name: not name.startswith("base")))

    @cached_property
    def columns(self) -> tuple[NDArray[np.intp], ...]:
        """Which of them each measurement has."""
        place = {name: k for k, name in enumerate(self.nuisances)}
        return tuple(np.array([place[name] for name in part.nuisances], dtype=np.intp) for part in self.parts)

    @property
    def displaces_base(self) -> bool:
        """Whether the first six nuisances displace the base."""
        return any(part.displaces_base for part in self.parts)

    def slopes(self, part: int, pose: Array, error: Array, nuisances: Array) -> Slopes:
        """Return the derivatives of a reading as :meth:`Measurement.slopes`, by all nuisances."""
        own = self.parts[part].slopes(pose, error, nuisances[self.columns[part]])
        whole = np.zeros((self.parts[part].size, nuisances.size))
        whole[:, self.columns[part]] = own.nuisances
        return Slopes(own.error, whole)


def stations_of_data(model: ErrorModel, data: CalibrationData) -> tuple[Station, ...]:
    """Return a station for each different pose and load."""
    found: list[Station] = []
    loads = [part.load for part in data.measurements]
    own = np.array([loads.index(load) for load in loads])[data.part]
    for k in np.unique(own):
        rows = np.flatnonzero(own == k)
        for station in stations_of(model, data.q[:, rows], data.measurements[k]):
            found.append(Station(station.at, tuple(rows[list(station.rows)].tolist())))
    return tuple(found)


@final
@dataclass(frozen=True, eq=False)
class SetUp(Record):
    """Set-up of an instrument as estimated; what does not belong to the readings is ``None``.

    Attributes:
        base: The robot's base in the instrument's axes, ``(4, 4)``; ``None`` where it is known.
        target, anchor, plane, sockets: In tool axes, ``(3,)``; in base axes ``(3,)``, point and unit normal ``(2, 3)``,
            and ``(S, 3)``; m.
        std: Standard deviation of each unknown number, m and rad.
    """

    base: Array | None
    target: Array
    anchor: Array | None
    plane: Array | None
    sockets: Array | None
    std: dict[str, float]

    @classmethod
    def of(cls, measurement: Measurement, base: Array, nuisances: Array, variances: Array) -> SetUp:
        """Return the set-up of the measurement's nuisances, estimated beside a first guess of the base, and their variances."""
        shift, turn, target, _ = measurement.split(nuisances[:, None])
        anchor, placed, plane, sockets = None, None, None, None
        place, own = measurement.place, shift[:, 0]
        if isinstance(place, Anchor):
            anchor = np.array(place.place) + own
        elif isinstance(place, Plane):
            plane = np.array(place.tilted(own))
        elif isinstance(place, Sockets):
            sockets = np.array(place.places) + own.reshape(-1, 3)
        elif turn is not None:
            placed = base @ se3.displacement(nuisances[:6])
        deviations = np.sqrt(np.maximum(variances, 0.0)).tolist()
        std = dict(zip(measurement.nuisances, deviations, strict=True))
        return cls(placed, target[:, 0], anchor, plane, sockets, std)


def first_guess(data: CalibrationData, tips: Array, instruments: Instruments) -> tuple[tuple[Array, ...], Array]:
    """Return for each measurement the base ``(4, 4)`` that fits tips ``(P, 4, 4)`` best, and the nuisances beside it."""
    nuisances, bases = np.zeros(len(instruments.nuisances)), [np.eye(4) for _ in data.measurements]
    targets = np.array([part.target for part in data.measurements])[data.part]
    points = tips[:, :3, 3] + np.einsum("pij,pj->pi", tips[:, :3, :3], targets)
    names = np.array([f"{'' if part.place is None else part.kind} {part.base_name}" for part in data.measurements])
    for name in dict.fromkeys(names.tolist()):
        chosen = [k for k, part in enumerate(data.measurements) if names[k] == name and part.base == "free"]
        rows = np.flatnonzero(np.isin(data.part, chosen))
        if not rows.size or data.measurements[chosen[0]].kind in ("plane", "socket"):
            continue
        part = data.measurements[chosen[0]]
        if part.kind == "distance":
            columns = instruments.columns[chosen[0]][:3]
            nuisances[columns] = _anchor(points[rows], data.readings[rows, 0]) - part.anchor
            continue
        attitudes = [row for row in rows.tolist() if data.measurements[data.part[row]].kind == "pose"]
        base = _base(points[rows], data.readings[rows, :3], tips[attitudes, :3, :3], data.readings[attitudes, 3:6])
        for k in chosen:
            bases[k] = base
    return tuple(bases), nuisances


def _base(nominal: Array, measured: Array, attitudes: Array, turned: Array) -> Array:
    """Return the base ``(4, 4)`` for points ``(P, 3)``, and attitudes ``(A, 3, 3)`` read as rotation vectors if there are any."""
    centre, other = nominal.mean(axis=0), measured.mean(axis=0)
    if len(attitudes):
        turns = np.einsum("ijp,pkj->ik", se3.exp_rotation(turned.T), attitudes)
    else:
        turns = (measured - other).T @ (nominal - centre)
        values = np.linalg.svd(turns, compute_uv=False)
        if len(nominal) < 3 or values[1] < 1e-6 * values[0]:
            raise InputError("a free base needs at least three positions that do not lie on one line")
    rotation = se3.nearest_rotation(turns)
    return se3.pose(rotation, other - rotation @ centre)


def _anchor(points: Array, distances: Array) -> Array:
    """Return the anchor ``(3,)`` from which points ``(P, 3)`` have these distances best: ``|p|² - d² = 2 p·a - |a|²``."""
    centre = points.mean(axis=0)
    near = points - centre
    rows = np.hstack([2 * near, -np.ones((len(near), 1))])
    if len(near) < 4 or np.linalg.svd(near, compute_uv=False)[2] < 1e-6 * np.abs(near).max():
        raise InputError("a free anchor needs distances of at least four points that do not lie in one plane")
    found = np.linalg.lstsq(rows, (near**2).sum(axis=1) - distances**2, rcond=None)[0]
    anchor: Array = centre + found[:3]
    return anchor


def readings_in_base(data: CalibrationData, poses: Array, bases: Sequence[Array]) -> Array:
    """Return readings ``(P, m)`` as :meth:`Measurement.predict` returns them: in base axes, turns from nominal ``(P, 4, 4)``."""
    result = np.nan_to_num(data.readings, nan=0.0)
    for row, number in enumerate(data.part):
        part, base = data.measurements[number], bases[number]
        if part.place is not None:
            continue
        result[row, :3] = (data.readings[row, :3] - base[:3, 3]) @ base[:3, :3]
        if part.kind == "pose":
            attitude = base[:3, :3].T @ se3.exp_rotation(data.readings[row, 3:6])
            result[row, 3:6] = se3.log_rotation(attitude @ poses[row, :3, :3].T)
    return result


def nominal_distance(chain: Chain, data: CalibrationData) -> float:
    """Return how far the readings are from the nominal arm whatever the set-up: root mean square of whitened residuals."""
    instruments = Instruments(data.measurements)
    poses = np.moveaxis(chain.with_target((0.0, 0.0, 0.0)).at_columns(np.ascontiguousarray(data.q)).pose, -1, 0)
    bases, start = first_guess(data, poses, instruments)
    readings = readings_in_base(data, poses, bases)
    values, slopes = [], []
    for row, number in enumerate(data.part):
        part, own = data.measurements[number], start[instruments.columns[number]]
        predicted = part.predict(poses[row], np.zeros((6, 1)), own[:, None])
        values.append(part.residual(readings[row, : part.size, None], predicted)[:, 0] / part.deviations)
        slopes.append(instruments.slopes(number, poses[row], np.zeros(6), start).nuisances / part.deviations[:, None])
    white, by_nuisance = np.concatenate(values), np.concatenate(slopes)
    left = white - by_nuisance @ np.linalg.lstsq(by_nuisance, white, rcond=1e-9)[0]
    return float(np.sqrt(np.mean(left**2)))
