"""The fit of the exact model to readings: Gauss-Newton steps within bounds.

It minimises ``|R^(-1/2) (y - h(q; x, n))|² + |z|²`` over z, with ``x = μ + L z``, and the nuisances n; without a prior only
the first part, over the combinations of z that the readings determine. Derivatives are those of the displaced chain at the
current estimate. The noise R is that at the means.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
import scipy.linalg

from precision_pin.analyses.calibration.design import Station, UnitNumbers
from precision_pin.analyses.calibration.estimates import Estimator
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.estimates import bounds_of
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet.measurement import Measurement

STEPS: Final = 60
_SETTLED: Final = 1e-8
"""Largest change of z, and of whitened nuisances, at which the estimate has settled."""
_SMALL: Final = 1e-5
"""Change of z below which the derivatives of the last step serve for the next ones: they cost more than residuals."""
_HALVINGS: Final = 30


@final
@dataclass(frozen=True, eq=False)
class Problem:
    """Readings to fit.

    Attributes
    ----------
    model, unit, measurement
        Model, its numbers drawn once for each robot, and the instrument.
    stations
        The measured poses.
    readings, deviations
        As :meth:`Measurement.predict` returns them, and their standard deviations, ``(P, m)``.
    roots
        Lower root of the noise of each station's readings.
    start
        First guess of the nuisances, ``(k,)``.
    low, high
        Bounds of z, ``(r,)``.
    """

    model: ErrorModel
    unit: UnitNumbers
    measurement: Measurement
    stations: tuple[Station, ...]
    readings: Array
    deviations: Array
    roots: tuple[Array, ...]
    start: Array
    low: Array
    high: Array

    @classmethod
    def of(
        cls,
        model: ErrorModel,
        measurement: Measurement,
        stations: Sequence[Station],
        readings: Array,
        deviations: Array,
        start: Array,
    ) -> Problem:
        """Return the problem of readings ``(P, m)`` with standard deviations ``(P, m)``."""
        unit = UnitNumbers.of(model.space)
        roots: list[Array] = []
        for station in stations:
            slopes = measurement.slopes(station.at.posture.pose, station.at.error_at_means, start)
            roots.append(station.noise_root(measurement, slopes.error, deviations[list(station.rows)] ** 2))
        bounds = _bounds(model, unit)
        return cls(model, unit, measurement, tuple(stations), readings, deviations, tuple(roots), start, *bounds)

    def without(self, rows: Collection[int]) -> Problem:
        """Return the problem without some readings, which keep their places in the arrays."""
        kept = [Station(one.at, tuple(row for row in one.rows if row not in rows)) for one in self.stations]
        stations = [station for station in kept if station.rows]
        return Problem.of(self.model, self.measurement, stations, self.readings, self.deviations, self.start)

    def residuals(self, z: Array, nuisances: Array) -> Array:
        """Return readings less predictions, ``(P, m)``."""
        result = np.zeros_like(self.readings)
        x = self.unit.components(self.model.space, z[:, None])
        for station in self.stations:
            error = station.at.exact(x)
            predicted = self.measurement.predict(station.at.posture.pose, error, nuisances[:, None])
            for row in station.rows:
                result[row] = self.measurement.residual(self.readings[row, :, None], predicted)[:, 0]
        return result

    def whiten(self, values: Array) -> Array:
        """Return ``R^(-1/2)`` times ``(P, m, …)``, as ``(M, …)`` with the rows of each station together."""
        parts = []
        for station, root in zip(self.stations, self.roots, strict=True):
            own = values[list(station.rows)]
            parts.append(scipy.linalg.solve_triangular(root, own.reshape(root.shape[0], -1), lower=True))
        stacked = np.concatenate(parts)
        return stacked[:, 0] if values.ndim == 2 else stacked

    def slopes(self, z: Array, nuisances: Array) -> tuple[Array, Array]:
        """Return whitened derivatives of the readings by z and by the nuisances, ``(M, r)`` and ``(M, k)``."""
        return self._slopes(z, nuisances, self.unit.root)

    def plain_slopes(self, z: Array, nuisances: Array) -> tuple[Array, Array]:
        """Return the same by each number in units of its prior standard deviation, ``(M, U)``, and by the nuisances."""
        return self._slopes(z, nuisances, np.diag(self.unit.std))

    def _slopes(self, z: Array, nuisances: Array, root: Array) -> tuple[Array, Array]:
        x = self.unit.components(self.model.space, z[:, None])[:, 0]
        size = root.shape[1]
        whole = np.zeros((*self.readings.shape, size + nuisances.size))
        for station in self.stations:
            error, jacobian = station.at.tangent_at(x)
            found = self.measurement.slopes(station.at.posture.pose, error, nuisances)
            own = np.hstack([found.error @ jacobian[:, self.unit.columns] @ root, found.nuisances])
            whole[list(station.rows)] = own
        white = self.whiten(whole)
        return white[:, :size], white[:, size:]


def _bounds(model: ErrorModel, unit: UnitNumbers) -> tuple[Array, Array]:
    """Return the bounds of z where the numbers are independent; of correlated numbers none."""
    size = unit.root.shape[1]
    if not unit.is_independent:
        return np.full(size, -np.inf), np.full(size, np.inf)
    ends = [bounds_of(draw.law, k) for draw in model.space.draws for k in range(draw.law.size)]
    low, high = (np.array(ends)[unit.columns].T - unit.mean) / unit.std
    return low, high


@final
@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of a fit, reading by reading.

    Attributes
    ----------
    values
        Reading less prediction, ``(P, m)``.
    left_out
        Reading less the prediction of a fit without it, ``(P, m)``, first order.
    distance
        Size of ``left_out`` in units of its standard deviation, squared, ``(P,)``: chi-square of m degrees.
    """

    values: Array
    left_out: Array
    distance: Array


@final
@dataclass(frozen=True, eq=False)
class Fit:
    """An estimate.

    Attributes
    ----------
    z, nuisances
        The estimate, ``(r,)`` and ``(k,)``.
    without_bounds
        The estimate where no law had bounds, ``(r,)``, first order from z.
    estimator
        Derivatives at the estimate.
    chi_square, degrees_of_freedom
        Sum of squares of whitened residuals (with a prior, and of z), and its expectation where the model is right.
    residuals
        Reading by reading.
    steps
        Gauss-Newton steps.
    at_bounds
        Names of the numbers at a bound of their law.
    """

    z: Array
    nuisances: Array
    without_bounds: Array
    estimator: Estimator
    chi_square: float
    degrees_of_freedom: int
    residuals: Residuals
    steps: int
    at_bounds: tuple[str, ...]


def fit(problem: Problem, *, has_prior: bool, steps: int = STEPS) -> Fit:
    """Return the estimate of a problem, after a number of steps or when it has settled.

    Raises
    ------
    InputError
        The estimate has not settled after :data:`STEPS` steps.
    """
    z, nuisances = np.zeros(problem.unit.root.shape[1]), problem.start
    white = problem.whiten(problem.residuals(z, nuisances))
    cost = _cost(white, z, has_prior)
    # without a prior the combinations to estimate are those at the means, the same at every step
    kept = None if has_prior else Estimator.of(*problem.slopes(z, nuisances), has_prior=False).kept
    size, estimator = np.inf, None
    for step in range(1, steps + 1):
        if estimator is None or size > _SMALL:
            estimator = Estimator.of(*problem.slopes(z, nuisances), has_prior=has_prior, kept=kept)
        target = white + estimator.by_z @ z + estimator.by_nuisance @ nuisances
        better = estimator.estimate(target, problem.low, problem.high)
        other = estimator.nuisances(target - estimator.by_z @ better)
        change, other_change = better - z, other - nuisances
        size = max(np.abs(change).max(initial=0.0), np.abs(estimator.by_nuisance @ other_change).max(initial=0.0))
        z, nuisances, white, cost = _line_search(problem, z, nuisances, change, other_change, cost, has_prior)
        if size < _SETTLED * (1 + np.abs(z).max(initial=0.0)):
            return _result(problem, z, nuisances, white, step, has_prior, kept)
    if steps < STEPS:
        return _result(problem, z, nuisances, white, steps, has_prior, kept)
    raise InputError(
        f"the fit has not settled after {steps} steps; check the units of the data, the target and the base of the measurement"
    )


def _cost(white: Array, z: Array, has_prior: bool) -> float:
    return float(white @ white) + (float(z @ z) if has_prior else 0.0)


def _line_search(
    problem: Problem, z: Array, nuisances: Array, change: Array, other_change: Array, cost: float, has_prior: bool
) -> tuple[Array, Array, Array, float]:
    """Return the estimate, whitened residuals and cost after a step, halved until the cost does not rise."""
    share = 1.0
    for _ in range(_HALVINGS):
        new, other = z + share * change, nuisances + share * other_change
        try:
            white = problem.whiten(problem.residuals(new, other))
        except InputError:  # an error turns a place by half a turn
            share /= 2
            continue
        value = _cost(white, new, has_prior)
        # rounding of the sum must not hold up the last steps
        if value <= cost * (1 + 1e-9) + 1e-9:
            return new, other, white, value
        share /= 2
    return z, nuisances, problem.whiten(problem.residuals(z, nuisances)), cost


def _result(
    problem: Problem, z: Array, nuisances: Array, white: Array, steps: int, has_prior: bool, kept: Array | None
) -> Fit:
    estimator = Estimator.of(*problem.slopes(z, nuisances), has_prior=has_prior, kept=kept)
    estimated = estimator.nuisance_rank + (0 if has_prior else estimator.kept.shape[1])
    at_bounds: tuple[str, ...] = ()
    if has_prior and problem.unit.is_independent:
        held = (z <= problem.low) | (z >= problem.high)
        at_bounds = tuple(name for name, is_held in zip(problem.unit.names, held, strict=True) if is_held)
    return Fit(
        z,
        nuisances,
        estimator.estimate(white + estimator.by_z @ z) if at_bounds else z,
        estimator,
        _cost(white, z, has_prior),
        len(white) - estimated,
        _residuals(problem, estimator, problem.residuals(z, nuisances), white),
        steps,
        at_bounds,
    )


def _residuals(problem: Problem, estimator: Estimator, values: Array, white: Array) -> Residuals:
    """Return the residuals with those of each reading left out, from the precision of the residuals of each station."""
    hold = np.eye(len(white)) - estimator.leverage()
    left_out, distance = np.zeros_like(values), np.zeros(len(values))
    size, first = values.shape[1], 0
    for station, root in zip(problem.stations, problem.roots, strict=True):
        rows = slice(first, first + len(root))
        first += len(root)
        inverse = scipy.linalg.solve_triangular(root, np.eye(len(root)), lower=True)
        precision = inverse.T @ hold[rows, rows] @ inverse
        pull = inverse.T @ white[rows]
        for k, row in enumerate(station.rows):
            own = slice(k * size, (k + 1) * size)
            # a reading that alone determines something has no residual in that direction
            left_out[row] = np.linalg.pinv(precision[own, own], rcond=1e-9, hermitian=True) @ pull[own]
            distance[row] = max(float(pull[own] @ left_out[row]), 0.0)
    return Residuals(values, left_out, distance)


def left_out_together(problem: Problem, best: Fit, groups: Array) -> Array:
    """Return each reading less the prediction of a fit without its group, first order, ``(P, m)``.

    Parameters
    ----------
    problem, best
        The readings with weight, and their fit.
    groups
        Number of the group of each reading, ``(P,)``.
    """
    white = problem.whiten(best.residuals.values)
    hold = np.eye(len(white)) - best.estimator.leverage()
    inverse = scipy.linalg.block_diag(
        *(scipy.linalg.solve_triangular(root, np.eye(len(root)), lower=True) for root in problem.roots)
    )
    precision, pull = inverse.T @ hold @ inverse, inverse.T @ white
    size = problem.readings.shape[1]
    rows = np.array([row for station in problem.stations for row in station.rows])
    result = np.zeros_like(best.residuals.values)
    for group in np.unique(groups[rows]):
        own = np.flatnonzero(groups[rows] == group)
        places = (own[:, None] * size + np.arange(size)).ravel()
        inner = np.linalg.pinv(precision[np.ix_(places, places)], rcond=1e-9, hermitian=True)
        result[rows[own]] = (inner @ pull[places]).reshape(-1, size)
    return result
