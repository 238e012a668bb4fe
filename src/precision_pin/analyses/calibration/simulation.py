"""Complete calibrations of simulated robots with the exact model: the check of a forecast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
import scipy.linalg

from precision_pin.analyses.calibration.design import (
    Estimator,
    Station,
    UnitNumbers,
    flat,
    measurement_of,
    read_poses,
    stack_at_means,
    stations_of,
    task_poses,
)
from precision_pin.analyses.calibration.fit import Problem
from precision_pin.analyses.calibration.set_up import Instruments
from precision_pin.base import se3
from precision_pin.base.arguments import check_whole
from precision_pin.base.arrays import Array
from precision_pin.draws.draw import Scope
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet.measurement import KINDS, Measurement

_STEPS: Final = 30
_SETTLED: Final = 1e-9
"""Largest change of z at which the estimates have settled."""
_POSES: Final = 100_000
"""Poses of each kind in the random streams."""
_TASK_POSE: Final = 1 << 19
"""Number of the first of the user's poses in the random streams, beyond all measured ones."""


@final
@dataclass(frozen=True, eq=False)
class SimulatedCalibrations:
    """Calibrations of N simulated robots.

    Attributes:
        errors: Error of the tip from the calibrated arm's own pose, at each of the user's T poses at a later visit,
            ``(T, 6, N)``.
        estimates, truth: Estimated and true z, ``(r, N)``.
        chi_square, degrees_of_freedom: Sum of squares of residuals and estimates, ``(N,)``, and its expectation.
    """

    errors: Array
    estimates: Array
    truth: Array
    chi_square: Array
    degrees_of_freedom: int

    @property
    def rms_position(self) -> Array:
        """Root mean square of the position's error at each of the user's poses, ``(T,)``."""
        result: Array = np.sqrt((self.errors[:, :3] ** 2).sum(axis=1).mean(axis=1))
        return result


def simulate_calibrations(
    model: ErrorModel, poses: object, measurement: Measurement, *, at: object = None, robots: int = 1000, seed: int = 0
) -> SimulatedCalibrations:
    """Build robots, measure each at all poses and fit each with the exact model.

    Every robot's estimate is iterated until its residuals, by the exact model, satisfy the normal equations of the first
    order at the means. Bounds of laws are not heeded.

    Args:
        model, poses, measurement, at: As for :func:`precision_pin.forecast_calibration`.
        robots, seed: Number of robots, and 64-bit seed.
    """
    measurement = measurement_of(model, measurement)
    check_whole("the number of robots", robots, 1, 10**6)
    values, _ = read_poses(model, poses)
    unit = UnitNumbers.of(model.space)
    stations = stations_of(model, values, measurement)
    x = model.space.sample(seed, 0, robots)
    readings = simulate_readings(stations, measurement, model, robots=robots, seed=seed)
    by_z, by_nuisance = map(flat, stack_at_means(stations, unit, measurement))
    estimator = Estimator.of(by_z, by_nuisance, has_prior=True)
    deviations = np.tile(measurement.deviations, (len(readings), 1))
    alone = np.zeros(len(readings), dtype=np.intp), np.arange(len(readings))
    instruments, start = Instruments((measurement,)), np.zeros(by_nuisance.shape[1])
    roots = Problem(model, instruments, stations, readings, deviations, *alone, start).roots
    z, nuisances = np.zeros((unit.root.shape[1], robots)), np.zeros((by_nuisance.shape[1], robots))
    for _ in range(_STEPS):
        residuals = _residuals(stations, roots, measurement, unit, readings, z, nuisances)
        target = residuals + by_z @ z
        better = estimator.covariance @ (estimator.projected.T @ target)
        step = better - z
        if nuisances.size:
            nuisances = nuisances + np.linalg.lstsq(by_nuisance, residuals - by_z @ step, rcond=None)[0]
        z = better
        if np.abs(step).max() < _SETTLED:
            break
    residuals = _residuals(stations, roots, measurement, unit, readings, z, nuisances)
    chi_square: Array = (residuals**2).sum(axis=0) + (z**2).sum(axis=0)
    errors = []
    for k, (_, one) in enumerate(task_poses(model, at, values)):
        later = _with_later_draws(model, x, seed, _TASK_POSE + k)
        errors.append(one.exact(later) - one.exact(unit.components(model.space, z)))
    truth = np.asarray(np.linalg.lstsq(unit.root, x[unit.columns] - unit.mean[:, None], rcond=None)[0], dtype=float)
    return SimulatedCalibrations(np.array(errors), z, truth, chi_square, len(by_z) - estimator.nuisance_rank)


def simulate_readings(
    stations: tuple[Station, ...],
    measurement: Measurement,
    model: ErrorModel,
    *,
    robots: int = 1,
    seed: int = 0,
    first: int = 0,
) -> Array:
    """Return readings ``(P, m, N)`` of robots by the exact model, with the set-up at its nominal values.

    They are the robots ``first … first + robots - 1`` of those that `precision_pin.monte_carlo` samples with the seed, which is
    that of the noise too; the stations are the poses in the order of the random streams. Each kind has its own noise and visits,
    so that readings of one robot by several instruments do not share them.
    """
    x = model.space.sample(seed, first, robots)
    count, kind = sum(len(station.rows) for station in stations), KINDS.index(measurement.kind)
    noise = np.random.default_rng([seed, 1, first, kind]).standard_normal((count, measurement.size, robots))
    readings = measurement.deviations[:, None] * noise
    set_up = np.zeros((len(measurement.nuisances), robots))
    for number, station in enumerate(stations):
        for visit, row in enumerate(station.rows):
            errors = station.at.exact(_with_later_draws(model, x, seed, kind * _POSES + number, visit, first))
            readings[row] += measurement.predict(station.at.posture.pose, errors, set_up)
    return readings


def as_measured(readings: Array, stations: tuple[Station, ...], measurement: Measurement) -> Array:
    """Return readings ``(P, m)`` of one robot as an instrument gives them, in the axes of a known base: whole attitudes."""
    if measurement.kind != "pose":
        return readings
    result = readings.copy()
    for station in stations:
        rows = list(station.rows)
        turned = np.einsum("ijn,jk->ikn", se3.exp_rotation(readings[rows, 3:].T), station.at.posture.pose[:3, :3])
        result[rows, 3:] = se3.log_rotation(turned).T
    return result


def _with_later_draws(model: ErrorModel, x: Array, seed: int, pose: int, visit: int = 0, first: int = 0) -> Array:
    """Return component values ``(d, N)`` of the same robots at another pose and visit."""
    if all(draw.scope is Scope.UNIT for draw in model.space.draws):
        return x
    return model.space.sample(seed, first, x.shape[1], pose=pose, visit=visit)


def _residuals(
    stations: tuple[Station, ...],
    roots: tuple[Array, ...],
    measurement: Measurement,
    unit: UnitNumbers,
    readings: Array,
    z: Array,
    nuisances: Array,
) -> Array:
    """Return whitened residuals ``(M, N)``."""
    result = np.empty_like(readings)
    for station, root in zip(stations, roots, strict=True):
        rows = list(station.rows)
        errors = station.at.exact(unit.components(station.at.space, z))
        predicted = measurement.predict(station.at.posture.pose, errors, nuisances)
        own = np.array([measurement.residual(readings[row], predicted) for row in rows])
        white = scipy.linalg.solve_triangular(root, own.reshape(len(rows) * measurement.size, -1), lower=True)
        result[rows] = white.reshape(own.shape)
    return result.reshape(-1, readings.shape[2])
