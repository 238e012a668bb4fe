"""Accuracy after a calibration, predicted before it is made; and calibrations of simulated robots, which check it.

First order, at the numbers' means: after measuring, the unit-scope numbers have the covariance
``C = (Σ Hᵀ R⁻¹ H + Σ₀⁻¹)⁻¹`` with the nuisances of the set-up free, and the error left at a pose ``J C Jᵀ + K Σ Kᵀ``. The
second part, of pose- and visit-scope numbers, is the floor that no calibration removes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, final

import numpy as np
import scipy.linalg

from precision_pin.analyses.calibration import design
from precision_pin.analyses.calibration.fit import Instruments, Problem
from precision_pin.analyses.calibration.posterior import PosesOutcome, Posterior, errors_left
from precision_pin.analyses.provenance import Provenance
from precision_pin.base import se3
from precision_pin.base.arguments import check_items, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.base.record import Keys, Record
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Estimates
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.pose_set import PoseSet
from precision_pin.robot.random_poses import random_poses
from precision_pin.sheet.measurement import KINDS, Measurement

_TOGETHER: Final = 64
_ROUNDS: Final = 40
_MOST_STEPS: Final = 60
_CLOSE: Final = 1e-12
"""Distance from contact, m, at which a pose touches."""
_LONGEST: Final = 0.5
"""Largest change of a joint value in a step."""
_DAMPING: Final = 1e-8
_FAR: Final = 0.05
"""Distance from contact, m, beyond which a warning says that a pose does not touch."""


def contact_poses(chain: Chain, measurement: Measurement, count: int, *, seed: int = 0) -> PoseSet:
    """Return random poses in which the target touches the plane, or is in one of the sockets.

    Least-norm steps lead from random joint values to the nearest contact; poses beyond limits or in collision are redrawn.

    Raises:
        InputError: The measurement is not of kind ``"plane"`` or ``"socket"``, or too few poses are found.
    """
    place = measurement.place
    if place is None or measurement.kind not in ("plane", "socket"):
        raise InputError(f"a {measurement.kind} is measured without contact")
    arm = chain.with_target(measurement.target)
    starts = random_poses(arm, _TOGETHER * _ROUNDS, seed=seed).q
    found: list[Array] = []
    for k in range(_ROUNDS):
        raise_if_interrupted()
        q = _touching(arm, measurement, starts[:, _TOGETHER * k : _TOGETHER * (k + 1)].copy(), k)
        found.extend(q.T)
        if len(found) >= count:
            break
    if len(found) < count:
        raise InputError(
            f"only {len(found):,} of {_TOGETHER * _ROUNDS:,} random poses end in contact within joint limits; move the "
            f"{measurement.kind} closer, or give the poses"
        )
    names = tuple(f"contact {number}" for number in range(1, count + 1))
    return PoseSet.at(chain, np.ascontiguousarray(np.array(found[:count]).T), names)


def _touching(chain: Chain, measurement: Measurement, q: Array, number: int) -> Array:
    """Return the columns of joint values ``(n, S)`` that reach contact within limits, after steps of least norm."""
    sockets = np.array(measurement.sockets)
    # a socket for each start, in turn, so that all are visited
    chosen = (np.arange(q.shape[1]) + number) % max(len(sockets), 1)
    for _ in range(_MOST_STEPS):
        at = chain.at_columns(q)
        point, slopes = at.pose[:3, 3], at.joint_jacobian[:3]
        if measurement.plane is not None:
            normal = np.array(measurement.plane[1])
            away = (normal @ (point - np.array(measurement.plane[0])[:, None]))[None]
            slopes = np.einsum("i,ijs->js", normal, slopes)[None]
        else:
            away = point - sockets[chosen].T
        if np.abs(away).max() < _CLOSE:
            break
        gram = np.einsum("ias,jas->sij", slopes, slopes) + _DAMPING * np.eye(len(away))
        pull = np.linalg.solve(gram, -away.T[:, :, None])[:, :, 0]
        step = np.einsum("ias,si->as", slopes, pull)
        q = q + step * np.minimum(1.0, _LONGEST / np.maximum(np.abs(step).max(axis=0), 1e-300))
    touches = (np.abs(away) < _CLOSE).all(axis=0) & ~chain.configurations.outside(q).any(axis=0)
    q = np.ascontiguousarray(q[:, touches])
    return q if chain.collision_check is None or not q.size else q[:, chain.collision_check.free(q)]


def seen_poses(chain: Chain, measurement: Measurement, poses: PoseSet) -> PoseSet | None:
    """Return the poses at which the instrument sees the target; ``None`` where it never does."""
    if measurement.visible_from is None:
        return poses
    nominal = np.moveaxis(chain.with_target((0.0, 0.0, 0.0)).at_columns(poses.q).pose, -1, 0)
    seen = np.array([measurement.sees(pose) for pose in nominal])
    return poses.of(seen) if seen.any() else None


def doubt_contact(measurement: Measurement, poses: Array) -> Iterator[Finding]:
    """Yield a warning where nominal poses ``(P, 4, 4)`` do not touch what they are measured at, or are not seen."""
    hidden = sum(not measurement.sees(pose) for pose in poses)
    if hidden:
        message = f"at {hidden} of {len(poses)} poses the target faces away from the instrument by more than the cone"
        yield Finding("warning", "W_HIDDEN", message)
    away = np.array([measurement.away(pose) for pose in poses])
    far = int((away > _FAR).sum())
    if far:
        where = "the plane" if measurement.kind == "plane" else "a socket"
        message = f"{far} of {len(away)} poses do not touch {where}, the farthest by {1e3 * away.max():.3g} mm"
        yield Finding("warning", "W_CONTACT", message)


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
    """Accuracy after a calibration, beside what :class:`PosesOutcome` has.

    Attributes:
        readings, posterior: Number of readings, and the arm's numbers after the calibration, with the means before.
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


@design.on_one_thread
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
    measurement = design.measurement_of(model, measurement)
    findings = check_items("findings", findings, Finding)
    values, _ = design.read_poses(model, poses)
    unit = design.UnitNumbers.of(model.space)
    stations = design.stations_of(model, values, measurement)
    by_z, by_nuisance = design.stack_at_means(stations, unit, measurement)
    estimator = design.Estimator.of(design.flat(by_z), design.flat(by_nuisance), has_prior=True)
    tasks = design.task_poses(model, at, values)
    entries = errors_left(tasks, unit, estimator, measurement.displaces_base, model.space)
    found = design.determined_by(stations, unit, measurement)
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
    covariance = design.covariance_with_prior(by_z, by_nuisance)
    return float(np.sqrt(3 * np.einsum("ij,jk,ik->i", slopes, covariance, slopes).mean() + floor))


def _by_count(by_z: Array, by_nuisance: Array, slopes: Array, floor: float) -> tuple[CurvePoint, ...]:
    count = len(by_z)
    generator = np.random.default_rng(_ORDER_SEED)
    orders = [generator.permutation(count) for _ in range(_ORDERS)]
    points = []
    for number in (*(one for one in _COUNTS if one < count), count):
        chosen = [np.sort(order[:number]) for order in (orders if number < count else orders[:1])]
        squares = [_rms(design.flat(by_z[rows]), design.flat(by_nuisance[rows]), slopes, floor) ** 2 for rows in chosen]
        points.append(CurvePoint(number, float(np.sqrt(np.mean(squares)))))
    for factor in _BEYOND:
        more = np.sqrt(factor)
        points.append(
            CurvePoint(factor * count, _rms(more * design.flat(by_z), more * design.flat(by_nuisance), slopes, floor))
        )
    return tuple(points)


def _by_instrument(
    stations: Sequence[design.Station], unit: design.UnitNumbers, measurement: Measurement, slopes: Array, floor: float
) -> tuple[CurvePoint, ...]:
    count = sum(len(station.rows) for station in stations)
    points = []
    for factor in _FACTORS:
        deviations = np.tile(factor * measurement.deviations, (count, 1))
        by_z, by_nuisance = design.stack_at_means(stations, unit, measurement, deviations)
        points.append(
            CurvePoint(factor * measurement.std, _rms(design.flat(by_z), design.flat(by_nuisance), slopes, floor))
        )
    return tuple(points)


def _remarks(found: design.Identifiability, model: ErrorModel, unit: design.UnitNumbers) -> Iterator[Finding]:
    yield from design.remarks_on(found)
    draws = model.space.draws
    names = {draw.name for draw in draws if not draw.law.is_normal and set(draw.components) & set(unit.names)}
    if names:
        message = (
            f"{len(names)} of {len(draws)} draws are not normal; they enter rms values with their means and "
            "covariances, and the 95 % quantiles are those of sampled robots"
        )
        yield Finding("warning", "W_NOT_NORMAL", message)


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
        return np.asarray(np.sqrt((self.errors[:, :3] ** 2).sum(axis=1).mean(axis=1)))


@design.on_one_thread
def simulate_calibrations(
    model: ErrorModel, poses: object, measurement: Measurement, *, at: object = None, robots: int = 1000, seed: int = 0
) -> SimulatedCalibrations:
    """Simulate robots, measure each at all poses, and fit each with the exact model; arguments as of the forecast.

    Estimates satisfy the first-order normal equations at the means, with exact residuals. Bounds of laws are ignored.
    """
    measurement = design.measurement_of(model, measurement)
    check_whole("the number of robots", robots, 1, 10**6)
    values, _ = design.read_poses(model, poses)
    unit = design.UnitNumbers.of(model.space)
    stations = design.stations_of(model, values, measurement)
    x = model.space.sample(seed, 0, robots)
    readings = simulate_readings(stations, measurement, model, robots=robots, seed=seed)
    by_z, by_nuisance = map(design.flat, design.stack_at_means(stations, unit, measurement))
    estimator = design.Estimator.of(by_z, by_nuisance, has_prior=True)
    deviations = np.tile(measurement.deviations, (len(readings), 1))
    alone = np.zeros(len(readings), dtype=np.intp), np.arange(len(readings))
    instruments, start = Instruments((measurement,)), np.zeros(by_nuisance.shape[1])
    roots = Problem(model, instruments, stations, readings, deviations, *alone, start).roots
    z, nuisances = np.zeros((unit.root.shape[1], robots)), np.zeros((by_nuisance.shape[1], robots))

    def whitened_residuals() -> Array:
        result = np.empty_like(readings)
        for station, root in zip(stations, roots, strict=True):
            rows = list(station.rows)
            tip_errors = station.at.exact(unit.components(station.at.space, z))
            predicted = measurement.predict(station.at.posture.pose, tip_errors, nuisances)
            own = np.array([measurement.residual(readings[row], predicted) for row in rows])
            white = scipy.linalg.solve_triangular(root, own.reshape(len(rows) * measurement.size, -1), lower=True)
            result[rows] = white.reshape(own.shape)
        return result.reshape(-1, robots)

    for _ in range(_STEPS):
        residuals = whitened_residuals()
        target = residuals + by_z @ z
        better = estimator.covariance @ (estimator.projected.T @ target)
        step = better - z
        if nuisances.size:
            nuisances = nuisances + np.linalg.lstsq(by_nuisance, residuals - by_z @ step, rcond=None)[0]
        z = better
        if np.abs(step).max() < _SETTLED:
            break
    residuals = whitened_residuals()
    chi_square: Array = (residuals**2).sum(axis=0) + (z**2).sum(axis=0)
    errors = []
    for k, (_, one) in enumerate(design.task_poses(model, at, values)):
        later = _with_later_draws(model, x, seed, _TASK_POSE + k)
        errors.append(one.exact(later) - one.exact(unit.components(model.space, z)))
    truth = np.asarray(np.linalg.lstsq(unit.root, x[unit.columns] - unit.mean[:, None], rcond=None)[0], dtype=float)
    return SimulatedCalibrations(np.array(errors), z, truth, chi_square, len(by_z) - estimator.nuisance_rank)


def simulate_readings(
    stations: tuple[design.Station, ...],
    measurement: Measurement,
    model: ErrorModel,
    *,
    robots: int = 1,
    seed: int = 0,
    first: int = 0,
) -> Array:
    """Return readings ``(P, m, N)`` of robots by the exact model, with the set-up at its nominal values.

    Robots ``first … first + robots - 1`` are those of `precision_pin.monte_carlo` with this seed, which the noise uses too;
    stations are the poses in the order of the random streams. Each kind of measurement has its own noise and visits.
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


def as_measured(readings: Array, stations: tuple[design.Station, ...], measurement: Measurement) -> Array:
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
