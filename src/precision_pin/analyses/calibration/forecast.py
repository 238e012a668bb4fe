"""What a calibration will buy, before anything is measured.

First order, at the numbers' means: the covariance of the unit-scope numbers after measuring is

    C = (Σ Hᵀ R⁻¹ H + Σ₀⁻¹)⁻¹

with the nuisances of the set-up free, and the error that is left at a pose has the covariance ``J C Jᵀ + K Σ Kᵀ``. The second
part comes from pose- and visit-scope numbers. No calibration removes it: it is the floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, final

import numpy as np

from precision_pin.analyses.calibration.contact import doubt_contact
from precision_pin.analyses.calibration.design import (
    Estimator,
    Station,
    UnitNumbers,
    covariance_with_prior,
    flat,
    measurement_of,
    read_poses,
    stack_at_means,
    stations_of,
    task_poses,
)
from precision_pin.analyses.calibration.identifiability import Identifiability, determined_by, remarks_on
from precision_pin.analyses.calibration.posterior import PosesOutcome, Posterior, errors_left
from precision_pin.analyses.provenance import Provenance
from precision_pin.base.arguments import check_items
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding
from precision_pin.base.record import Keys, Record
from precision_pin.draws.estimates import Estimates
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet.measurement import Measurement

_COUNTS: Final = (3, 4, 5, 6, 8, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500, 1000)
_BEYOND: Final = (2, 4)
"""Multiples of the given poses for which the accuracy is forecast too."""
_ORDERS: Final = 8
"""Random orders of the poses over which the accuracy of fewer poses is averaged."""
_ORDER_SEED: Final = 0
_FACTORS: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Multiples of the instrument's standard deviation for which the accuracy is forecast."""


@final
@dataclass(frozen=True)
class CurvePoint(Record):
    """Number of measured poses, or the instrument's standard deviation, and rms error of the position left over all poses, m."""

    value: float
    rms_position: float


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CalibrationForecast(PosesOutcome):
    """What a calibration will buy, beside what :class:`PosesOutcome` has.

    Attributes:
        readings, posterior: Number of readings, and the numbers of the arm after the calibration; their means are those
            before.
        by_count, by_instrument: Accuracy against the number of measured poses and against the instrument's deviation.
        model: The arm as it will be left: every other analysis runs on it. Its means are those of the sheet.
    """

    schema: ClassVar[str] = "precision-pin/calibration-forecast/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "measurement", "readings", "rms_position", "identifiability", "posterior", "poses"),
        *("accuracy_by_count=by_count", "accuracy_by_instrument=by_instrument", "findings"),
    )

    readings: int
    posterior: Posterior
    by_count: tuple[CurvePoint, ...]
    by_instrument: tuple[CurvePoint, ...]
    model: ErrorModel

    def rms(self, which: str) -> float:
        """Return the root mean square error of the position over the user's poses: ``before``, ``after``, ``seen``, ``floor``."""
        return self.rms_position[which]

    def __repr__(self) -> str:
        before, after, floor = (1e3 * self.rms(which) for which in ("before", "after", "floor"))
        return (
            f"<CalibrationForecast of {self.provenance.robot}: {self.readings} readings, rms position {before:.3g} mm "
            f"before, {after:.3g} mm after, floor {floor:.3g} mm>"
        )


def forecast_calibration(
    model: ErrorModel,
    poses: object,
    measurement: Measurement | None = None,
    *,
    at: object = None,
    findings: Sequence[Finding] = (),
) -> CalibrationForecast:
    """Forecast what measuring an arm at some poses will tell, and the error that is left.

    Args:
        model: The model, whose sheet is the prior.
        poses: Measured poses: a list, an array ``(n, P)``, a mapping of joint values or a pose set. A pose given twice
            is measured twice.
        measurement: Instrument and set-up; those of the sheet if left out.
        at: The user's own poses, where the error is forecast; the model's named poses if left out, else the measured
            ones.
        findings: Findings to pass on, such as those of the sheet.

    Raises:
        InputError: Nothing varies from robot to robot, or the poses are wrong.
    """
    measurement = measurement_of(model, measurement)
    findings = check_items("findings", findings, Finding)
    values, _ = read_poses(model, poses)
    unit = UnitNumbers.of(model.space)
    stations = stations_of(model, values, measurement)
    by_z, by_nuisance = stack_at_means(stations, unit, measurement)
    estimator = Estimator.of(flat(by_z), flat(by_nuisance), has_prior=True)
    tasks = task_poses(model, at, values)
    entries = errors_left(tasks, unit, estimator, measurement.displaces_base, model.space)
    found = determined_by(stations, unit, measurement)
    slopes = np.concatenate([one.jacobian[:3][:, unit.columns] @ unit.root for _, one in tasks])
    nominal = np.array([station.at.posture.pose for station in stations])
    floor = float(np.mean([entry.rms("floor") ** 2 for entry in entries]))
    left = unit.root @ estimator.covariance @ unit.root.T
    return CalibrationForecast(
        provenance=Provenance.of(model, _ORDER_SEED),
        measurement=measurement,
        readings=values.shape[1],
        posterior=Posterior.of(unit, unit.mean, left),
        identifiability=found,
        poses=entries,
        by_count=_by_count(by_z, by_nuisance, slopes, floor),
        by_instrument=_by_instrument(stations, unit, measurement, slopes, floor),
        model=model.calibrated(Estimates(unit.names, unit.mean, left)),
        findings=(*findings, *_remarks(found, model, unit), *doubt_contact(measurement, nominal)),
    )


def _rms(by_z: Array, by_nuisance: Array, slopes: Array, floor: float) -> float:
    covariance = covariance_with_prior(by_z, by_nuisance)
    return float(np.sqrt(3 * np.einsum("ij,jk,ik->i", slopes, covariance, slopes).mean() + floor))


def _by_count(by_z: Array, by_nuisance: Array, slopes: Array, floor: float) -> tuple[CurvePoint, ...]:
    """Return the accuracy with fewer poses, averaged over random orders, and with more of the same kind."""
    count = len(by_z)
    generator = np.random.default_rng(_ORDER_SEED)
    orders = [generator.permutation(count) for _ in range(_ORDERS)]
    points = []
    for number in (*(one for one in _COUNTS if one < count), count):
        chosen = [np.sort(order[:number]) for order in (orders if number < count else orders[:1])]
        squares = [_rms(flat(by_z[rows]), flat(by_nuisance[rows]), slopes, floor) ** 2 for rows in chosen]
        points.append(CurvePoint(number, float(np.sqrt(np.mean(squares)))))
    for factor in _BEYOND:
        more = np.sqrt(factor)
        points.append(CurvePoint(factor * count, _rms(more * flat(by_z), more * flat(by_nuisance), slopes, floor)))
    return tuple(points)


def _by_instrument(
    stations: Sequence[Station], unit: UnitNumbers, measurement: Measurement, slopes: Array, floor: float
) -> tuple[CurvePoint, ...]:
    count = sum(len(station.rows) for station in stations)
    points = []
    for factor in _FACTORS:
        deviations = np.tile(factor * measurement.deviations, (count, 1))
        by_z, by_nuisance = stack_at_means(stations, unit, measurement, deviations)
        points.append(CurvePoint(factor * measurement.std, _rms(flat(by_z), flat(by_nuisance), slopes, floor)))
    return tuple(points)


def _remarks(found: Identifiability, model: ErrorModel, unit: UnitNumbers) -> tuple[Finding, ...]:
    remarks = list(remarks_on(found))
    laws = {
        draw.name for draw in model.space.draws if not draw.law.is_normal and set(draw.components) & set(unit.names)
    }
    if laws:
        message = (
            f"{len(laws)} of {len(model.space.draws)} draws are not normal; they enter rms values with their means and "
            "covariances, and the 95 % quantiles are those of sampled robots"
        )
        remarks.append(Finding("warning", "W_NOT_NORMAL", message))
    return tuple(remarks)
