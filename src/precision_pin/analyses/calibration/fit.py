"""Fit of the exact model to readings: Gauss-Newton steps within bounds, and warnings about the result.

It minimises ``|R^(-1/2) (y - h(q; x, n))|² + |z|²`` over z, with ``x = μ + L z``, and the nuisances n; without a prior only
the first part, over the combinations of z that the readings determine. Derivatives are those of the displaced chain at the
current estimate. The noise R is that at the means.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress, pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import (
    MOST_GROSS,
    Estimator,
    Instruments,
    UnitNumbers,
    stations_of_data,
    without,
)
from precision_pin.analyses.calibration.drift import common_factors
from precision_pin.analyses.calibration.evaluation import Evaluation, Point
from precision_pin.analyses.calibration.instrument import instrument_covariance
from precision_pin.analyses.calibration.noise import Noise, Places, blocks_of
from precision_pin.analyses.calibration.start import REWEIGHED, first_guess, readings_in_base, reweighed_sizes
from precision_pin.analyses.readings import Station
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import bounds_of
from precision_pin.model.error_model import ErrorModel

STEPS: Final = 60
"""Gauss-Newton steps after which a fit that has not converged is rejected."""
_SETTLED: Final = 1e-8
"""Largest change of z, and of whitened nuisances, at which the estimate has converged."""
_STALLED: Final = 1e-6
"""The same where it is not smaller than in the step before."""
_SMALL: Final = 1e-5
"""Change of z below which derivatives are reused, because they cost more than residuals."""
_HALVINGS: Final = 30
"""Halvings of a step, down to 2e-9 of it."""
_TRIED_STEPS: Final = 8
"""Steps of a fit that only searches for unexplained readings."""
GROSS: Final = 1e-3
"""Probability that any correct reading of a set is classified as a gross error."""
_MOST_LEFT_OUT: Final = 0.4
"""Fraction of readings that the search for a consensus may omit."""
FARTHEST: Final = 50.0
"""Root mean square of whitened residuals of most readings beyond which data are rejected."""
ODD: Final = 5.0
"""Root mean square of whitened residuals beyond which gross errors, and then another unit of the joint values, are sought."""
_ALIKE: Final = 0.2
"""Angle, rad, within which the tool's attitudes are alike."""
_CELLS: Final = 4096
"""Components of groups that are left out at once, so that memory does not grow with the readings."""
_ALONE: Final = 1e-9
"""Fraction of a group's readings left free by the others, below which the group alone determines a combination."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Readings ``(P, m)`` to fit, as :meth:`Measurement.predict` returns them, and where the fit begins.

    Attributes:
        model, data: The arm, and all readings as they were given.
        instruments, part: The measurements, and the number of that of each reading, ``(P,)``.
        stations: Numbers of the readings at each station.
        readings: ``(P, m)``; a reading of fewer numbers has zeros beyond them, as its residuals and covariance have.
        instrument: Covariance of the instrument, ``(P, m, m)``, in the axes of ``readings``.
        visit: Readings of one visit were taken together, ``(P,)``.
        start: First nuisances, ``(k,)``.
        evaluation: The model at all stations, also at those that :meth:`without` omits.
        common: Factors ``(P, m, k)`` of what readings share, in their axes: what remains of the instrument's drift.
    """

    model: ErrorModel
    data: CalibrationData
    instruments: Instruments
    stations: tuple[tuple[int, ...], ...]
    readings: Array
    instrument: Array
    part: NDArray[np.intp]
    visit: NDArray[np.intp]
    start: Array
    evaluation: Evaluation
    common: Array

    @classmethod
    def of(cls, model: ErrorModel, data: CalibrationData) -> tuple[Problem, tuple[Array, ...]]:
        """Return the problem of all readings, and of each measurement the first guess of the base in its axes, ``(4, 4)``."""
        instruments = Instruments(data.measurements)
        evaluation = Evaluation(model.space, instruments, stations_of_data(model, data), data.part)
        errors = evaluation.at_means[0]
        tips = np.array([se3.displaced(*pair) for pair in zip(evaluation.poses, errors, strict=True)])
        poses, tips = evaluation.poses[evaluation.station], tips[evaluation.station]
        bases, start = first_guess(data, tips, instruments)
        readings = readings_in_base(data, poses, bases)
        noise = instrument_covariance(data, readings, bases)
        rotations = np.array([base[:3, :3].T for base in bases])[data.part]
        common = common_factors(data.sessions, readings.shape, rotations)
        return cls(
            model, data, instruments, evaluation.rows, readings, noise, data.part, data.visit, start, evaluation, common
        ), bases

    @cached_property
    def deviations(self) -> Array:
        """Standard deviation of the instrument, ``(P, m)``."""
        return np.asarray(np.sqrt(np.diagonal(self.instrument, axis1=1, axis2=2)))

    def scaled(self, factors: Array) -> Problem:
        """Return the problem with the instrument's deviations times factors that broadcast to ``(P, m)``."""
        factors = np.broadcast_to(factors, self.readings.shape)
        return replace(self, instrument=factors[:, :, None] * self.instrument * factors[:, None])

    def instrument_at(self, places: Places) -> Array:
        """Return the covariance of the instrument of the numbers read at stations, ``([S, ]b, b)``."""
        rows, columns = places
        is_one = rows[..., :, None] == rows[..., None, :]
        return np.where(is_one, self.instrument[rows[..., :, None], columns[..., :, None], columns[..., None, :]], 0.0)

    @cached_property
    def unit(self) -> UnitNumbers:
        """The model's numbers drawn once for each robot."""
        return UnitNumbers.of(self.model.space)

    @cached_property
    def sizes(self) -> NDArray[np.intp]:
        """Number of components of each reading, ``(P,)``."""
        return np.array([part.size for part in self.instruments.parts])[self.part]

    @cached_property
    def places(self) -> tuple[Places, ...]:
        """Row and column in the readings of every number read at a station, in the order of its whitened numbers."""
        station_rows = ((np.array(rows), self.sizes[list(rows)]) for rows in self.stations)
        return tuple((np.repeat(rows, sizes), np.concatenate([*map(np.arange, sizes)])) for rows, sizes in station_rows)

    @cached_property
    def spans(self) -> tuple[slice, ...]:
        """Rows of each station's whitened components."""
        bounds = np.cumsum([0, *(len(rows) for rows, _ in self.places)]).tolist()
        return tuple(slice(start, stop) for start, stop in pairwise(bounds))

    @cached_property
    def labels(self) -> tuple[NDArray[np.intp], ...]:
        """Identity of each component measured at a station; equal for repeated readings of one component."""
        width = self.readings.shape[1]
        return tuple(self.part[rows] * width + columns for rows, columns in self.places)

    @cached_property
    def unknown_deviations(self) -> dict[str, NDArray[np.bool_]]:
        """Masks ``(P, m)`` of components whose standard deviation is estimated, by its name; raise for two kinds."""
        uncalibrated = [part for part in self.instruments.parts if not part.std_known]
        if len({part.kind for part in uncalibrated}) > 1:
            raise InputError("std: estimate works for one kind of readings only; give the std of the others")
        masks: dict[str, NDArray[np.bool_]] = {}
        for k, part in enumerate(self.instruments.parts):
            for name, mask in part.unknown_deviations.items():
                all_numbers = masks.setdefault(name, np.zeros(self.readings.shape, dtype=bool))
                all_numbers[np.ix_(self.part == k, np.flatnonzero(mask))] = True
        return masks

    @cached_property
    def noise(self) -> Noise:
        """Noise of the readings, at each station as of :meth:`Station.noise`."""
        by_error, (_, scopes) = self.at_means(self.start)[1], self.evaluation.at_means
        blocks, covariances = blocks_of(self.places), []
        for block in blocks:
            rows, slopes = block.places[0], by_error[block.places]
            stations, visits = self.evaluation.station[rows[:, 0]], self.visit[rows]
            visit, pose = (
                slopes @ scopes[scope][stations] @ slopes.swapaxes(1, 2) for scope in (Scope.VISIT, Scope.POSE)
            )
            instrument = self.instrument_at(block.places)
            covariances.append(instrument + visit * (visits[:, :, None] == visits[:, None]) + pose)
        try:
            return Noise(self.readings.shape, blocks, covariances, self.common)
        except np.linalg.LinAlgError:
            for station, places in zip(self.each_station(), self.places, strict=True):
                station.noise_root(by_error[places], self.instrument_at(places), self.visit[places[0]])
            raise

    @property
    def roots(self) -> tuple[Array, ...]:
        """Lower root of the noise of each station's readings, apart from what stations share."""
        return self.noise.roots

    def at_means(self, nuisances: Array) -> tuple[Array, Array, Array]:
        """Return, with the means of the sheet, residuals ``(P, m)``, and derivatives by the tip's error and the nuisances."""
        values, by_error, by_nuisance = self.evaluation.predictions_at_means(nuisances)
        return self._less(values), by_error, by_nuisance

    @cached_property
    def unseen_turns(self) -> Array:
        """Rotations of bases that the readings do not determine, ``(k, f)``."""
        rows = [row for of_station in self.stations for row in of_station]
        return self.instruments.unseen_turns(self.part[rows], self.readings[rows], self.deviations[rows, 0])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Bounds of z where the numbers are independent, ``(r,)`` each; of correlated numbers none."""
        unit = self.unit
        size = unit.root.shape[1]
        if not unit.is_independent:
            return np.full(size, -np.inf), np.full(size, np.inf)
        limits = [bounds_of(draw.law, k) for draw in self.model.space.draws for k in range(draw.law.size)]
        low, high = (np.array(limits)[unit.columns].T - unit.mean) / unit.std
        return low, high

    def without(self, rows: Collection[int]) -> Problem:
        """Return the problem without some readings, which keep their places in the arrays."""
        rows = set(rows)
        reduced = (tuple(row for row in of_station if row not in rows) for of_station in self.stations)
        return replace(self, stations=tuple(of_station for of_station in reduced if of_station))

    def each_station(self) -> Iterator[Station]:
        """Yield each station with its model, made anew: those of many poses would fill the memory."""
        remaining = iter(self.stations)
        rows = next(remaining, ())
        for station in stations_of_data(self.model, self.data):
            if rows and rows[0] in station.rows:
                yield Station(station.at, rows)
                rows = next(remaining, ())

    def _point(self, z: Array, nuisances: Array) -> Point:
        x = self.unit.components(self.model.space, z[:, None])[:, 0]
        return self.evaluation.at(x, self.unit.columns, nuisances)

    def residuals(self, z: Array, nuisances: Array) -> Array:
        """Return readings less predictions, ``(P, m)``."""
        return self._less(self._point(z, nuisances).values)

    def _less(self, values: Array) -> Array:
        result, rows = np.zeros_like(self.readings), np.concatenate(self.stations)
        for number, part in enumerate(self.instruments.parts):
            of_part = rows[self.part[rows] == number]
            readings, predicted = (array[of_part, : part.size].T for array in (self.readings, values))
            result[of_part, : part.size] = part.residual(readings, predicted).T
        return result

    def whiten(self, values: Array) -> Array:
        """Return ``R^(-1/2)`` times ``(P, m, …)``, as ``(M, …)`` with the rows of each station together."""
        return self.noise.whiten(values)

    def slopes(self, z: Array, nuisances: Array, *, plain: bool = False) -> tuple[Array, Array]:
        """Return whitened derivatives of the readings by z (plain: by each number over its prior std) and by the nuisances."""
        by_number, by_nuisance = np.split(self._point(z, nuisances).derivatives, [self.unit.columns.size], axis=2)
        root = np.diag(self.unit.std) if plain else self.unit.root
        return self.whiten(by_number @ root), without(self.whiten(by_nuisance), self.unseen_turns)

    @property
    def alike_attitudes(self) -> str:
        """What to say where readings hardly tell an unknown target from the base, since the tool hardly turns; else nothing."""
        tilts = self.evaluation.poses[:, :3, :3] @ self.evaluation.poses[0, :3, :3].T
        turn = float(np.linalg.norm(se3.log_rotation(np.moveaxis(tilts, 0, -1)), axis=0).max())
        if turn > _ALIKE or all(part.target_known or part.base == "known" for part in self.instruments.parts):
            return ""
        return (
            f"attitudes of the tool differ by {np.degrees(turn):.2g} deg only, so that readings hardly tell the target from the "
            "base: give the target as known, or turn the tool"
        )

    def through(self, leverage_root: Array) -> Array:
        """Return ``T = R^(-1/2)ᵀ Q`` of a fit ``(M, k)`` by Q of :meth:`Estimator.leverage_root`, beside what stations share."""
        pulled, shared = self.noise.pull(leverage_root), self.noise.precision_root
        return np.hstack([pulled, shared]) if shared.shape[1] else pulled

    def throughs(self, estimator: Estimator, local: Estimator) -> list[Array]:
        """Return T of estimators, once of equal ones."""
        return [self.through(part.leverage_root()) for part in dict.fromkeys((estimator, local))]

    @property
    def spread(self) -> float:
        """Standard deviation of the places of the nominal tip along each axis, m."""
        points = self.evaluation.poses[self.evaluation.station[[rows[0] for rows in self.stations]], :3, 3]
        return float(np.sqrt(((points - points.mean(axis=0)) ** 2).mean()))

    @cached_property
    def consensus(self) -> Consensus:
        """Consensus of the readings, with the sheet as prior.

        Least trimmed squares (Rousseeuw 1984): the readings to leave out first are the farthest in a linear fit that they
        hardly pull, then those that the exact fit of the others does not explain.
        """
        z, nuisances = np.zeros(self.unit.root.shape[1]), self.start
        white, numbers = self.whiten(self.residuals(z, nuisances)), np.concatenate([rows for rows, _ in self.places])
        sizes = reweighed_sizes(white, *self.slopes(z, nuisances), numbers)
        scale, limit = float(np.sqrt((sizes**2).mean())), int(_MOST_LEFT_OUT * len(sizes))
        if sizes.max() <= ODD:
            return Consensus({}, scale, ())
        gross = dict.fromkeys(np.argsort(-sizes)[:limit].tolist(), np.inf)
        for _ in range(REWEIGHED):
            try:
                fit = Descent(self.without(gross), has_prior=True, at=(z, nuisances)).fit(_TRIED_STEPS)
            except InputError:  # an error turns a place by half a turn
                return Consensus({}, scale, ())
            scale = float(np.sqrt(fit.chi_square / max(fit.degrees_of_freedom, 1)))
            z, nuisances = fit.z, fit.nuisances
            (distance, excess), previous = self.outlying(fit, gross), gross.keys()
            gross = {row: float(distance[row]) for row in np.argsort(-excess)[:limit].tolist() if excess[row] > 1}
            if gross.keys() == previous:
                break
        if len(gross) <= MOST_GROSS * len(sizes):
            return Consensus(gross, scale, ())
        return Consensus({}, scale, tuple(sorted(row for row in gross if distance[row] > FARTHEST**2)))

    def outlying(self, fit: Fit, gross: Collection[int]) -> tuple[Array, Array]:
        """Return squared sizes ``(P,)``, in standard deviations, about a fit without each and without gross errors, over limits.

        The second are ratios to what one right set of readings in a thousand exceeds, wider where half of the others do.
        """
        distance, left_out = fit.left_out.distance.copy(), list(gross)
        if left_out:
            deviations = self.reading_deviations(fit)[left_out]
            scaled = self.residuals(fit.z, fit.nuisances)[left_out] / np.where(deviations > 0, deviations, 1.0)
            distance[left_out] = (scaled**2).sum(axis=1)
        limit, middle = stats.chi2.isf(GROSS / len(distance), self.sizes), stats.chi2.median(self.sizes)
        return distance, distance / limit / max(1.0, float(np.median(np.delete(distance / middle, left_out))))

    def reading_deviations(self, fit: Fit) -> Array:
        """Return the standard deviation of a new reading at each pose about its prediction by a fit, ``(P, m)``."""
        estimator = fit.estimator
        is_whole = len(estimator.by_z) == self.spans[-1].stop
        white = (estimator.by_z, estimator.by_nuisance) if is_whole else self.slopes(fit.z, fit.nuisances)
        slopes = self.noise.colour(np.hstack(white))
        variances = np.einsum("pmj,jk,pmk->pm", slopes, estimator.joint_covariance, slopes, optimize=True)
        return np.sqrt(self.noise.variances + variances)


class LeftOut(NamedTuple):
    """Readings less the prediction of a fit without their group, first order.

    Attributes:
        values, std: The difference and its standard deviation, what is left of the arm and set-up with the reading's
            noise, ``(P, m)``.
        distance: Its size in units of its standard deviation, squared, ``(P,)``: chi-square of m degrees.
        is_predicted: Whether the other groups determine the prediction, ``(P,)``.
        trials: How many independent groups the predicted ones are worth: each counts with those that it shares errors
            with, by the mean square of their correlations, weighed by readings.
    """

    values: Array
    std: Array
    distance: Array
    is_predicted: NDArray[np.bool_]
    trials: float


class Consensus(NamedTuple):
    """Readings on which most others do not agree, and the scale of the residuals.

    Attributes:
        gross: Readings that a fit of the others does not explain, with the squares of their sizes in standard deviations; none
            where these are too many.
        scale: Root mean square of the whitened residuals of the others.
        too_many: Those of too many that are far off.
    """

    gross: dict[int, float]
    scale: float
    too_many: tuple[int, ...]


class Fit(NamedTuple):
    """An estimate.

    Attributes:
        z, nuisances, without_bounds: The estimate, ``(r,)`` and ``(k,)``; z where no law had bounds, first order.
        estimator, chi_square, degrees_of_freedom: Derivatives there, sum of squares of whitened residuals (with a
            prior, and of z), and its expectation.
        residuals, left_out: Reading less prediction, ``(P, m)``; less that of a fit without it.
        local: The estimator without the numbers that stop at a bound.
        steps, at_bounds: Gauss-Newton steps, and names of the numbers at a bound of their law.
    """

    z: Array
    nuisances: Array
    without_bounds: Array
    estimator: Estimator
    chi_square: float
    degrees_of_freedom: int
    residuals: Array
    local: Estimator
    left_out: LeftOut
    steps: int
    at_bounds: tuple[str, ...]


class Descent:
    """Steps of a fit from the means or a given point; it can continue after an estimate.

    Attributes:
        problem, has_prior: What is fitted.
        steps: Number of steps taken.
    """

    def __init__(self, problem: Problem, *, has_prior: bool, at: tuple[Array, Array] | None = None) -> None:
        self.problem, self.has_prior, self.steps = problem, has_prior, 0
        means = np.zeros(problem.unit.root.shape[1]), problem.start
        # without a prior the combinations to estimate are those at the means, at every step
        self._basis = None if has_prior else Estimator.of(*problem.slopes(*means), has_prior=False).basis
        self._z, self._nuisances = at or means
        self._white, self._cost = self._evaluate(self._z, self._nuisances)
        self._last_estimator: Estimator | None = None
        self._size, self._is_settled = np.inf, False
        self._settled_fit: Fit | None = None

    def _evaluate(self, z: Array, nuisances: Array) -> tuple[Array, float]:
        """Return whitened residuals, and the cost."""
        white = self.problem.whiten(self.problem.residuals(z, nuisances))
        return white, float(white @ white) + (float(z @ z) if self.has_prior else 0.0)

    def _estimator(self) -> Estimator:
        slopes = self.problem.slopes(self._z, self._nuisances)
        return Estimator.of(*slopes, has_prior=self.has_prior, basis=self._basis)

    def fit(self, steps: int = STEPS) -> Fit:
        """Return the estimate after a total number of steps or at convergence; raise if it does not converge."""
        while not self._is_settled and self.steps < steps:
            self._step()
        if not self._is_settled and steps >= STEPS:
            hint = (
                self.problem.alike_attitudes
                or "check the units of the data, the target and the base of the measurement"
            )
            raise InputError(f"the fit has not settled after {steps} steps; {hint}")
        if self._settled_fit is not None:
            return self._settled_fit
        fit = self._estimate()
        if self._is_settled:
            self._settled_fit = fit
        return fit

    def _step(self) -> None:
        self.steps += 1
        if self._last_estimator is None or self._size > _SMALL:
            self._last_estimator = self._estimator()
        estimator, z, nuisances = self._last_estimator, self._z, self._nuisances
        new_z = estimator.estimate(self._white, z, *self.problem.bounds)
        z_step = new_z - z
        n_step = (
            estimator.nuisances(self._white - estimator.by_z @ z_step + estimator.by_nuisance @ nuisances) - nuisances
        )
        last_size = self._size
        self._size = max(np.abs(z_step).max(initial=0.0), np.abs(estimator.by_nuisance @ n_step).max(initial=0.0))
        # the step is halved until the cost does not rise
        for fraction in 0.5 ** np.arange(_HALVINGS):
            trial_z, trial_nuisances = z + fraction * z_step, nuisances + fraction * n_step
            try:
                trial_white, trial_cost = self._evaluate(trial_z, trial_nuisances)
            except InputError:  # an error turns a place by half a turn
                continue
            # rounding of the sum must not hold up the last steps
            if trial_cost <= self._cost * (1 + 1e-9) + 1e-9:
                self._z, self._nuisances, self._white, self._cost = trial_z, trial_nuisances, trial_white, trial_cost
                break
        # small steps that no longer shrink are rounding
        limit = _SETTLED if self._size < last_size else _STALLED
        self._is_settled = bool(self._size < limit * (1 + np.abs(self._z).max(initial=0.0)))

    def _estimate(self) -> Fit:
        problem, z, nuisances, white, cost = self.problem, self._z, self._nuisances, self._white, self._cost
        self._last_estimator = None  # as large as the new one
        estimator = self._estimator()
        residuals = problem.residuals(z, nuisances)
        degrees = len(white) - estimator.nuisance_rank - (0 if self.has_prior else estimator.basis.shape[1])
        at_bounds, local = tuple[str, ...](), estimator
        if self.has_prior and problem.unit.is_independent:
            low, high = problem.bounds
            is_at_bound = (z <= low) | (z >= high)
            at_bounds = tuple(compress(problem.unit.names, is_at_bound))
            if at_bounds:  # numbers at a bound do not follow the readings
                local = Estimator.of(estimator.by_z[:, ~is_at_bound], estimator.by_nuisance, has_prior=True)
        without_bounds = estimator.estimate(white, z) if at_bounds else z
        throughs = problem.throughs(estimator, local)
        left_out = leave_out(problem, throughs, residuals, np.arange(len(residuals)))
        return Fit(
            z, nuisances, without_bounds, estimator, cost, degrees, residuals, local, left_out, self.steps, at_bounds
        )


def leave_out(problem: Problem, throughs: Sequence[Array], residuals: Array, groups: NDArray[np.intp]) -> LeftOut:
    """Return readings less the prediction of a fit without their group, from residuals ``(P, m)`` and groups ``(P,)``.

    With T of :meth:`Problem.through`, those of a group are the inverse of its block of R⁻¹ - T Tᵀ times its rows of R⁻¹ r, and
    that inverse is their covariance; R⁻¹ is that of the stations less what these share. The last of ``throughs`` is of the fit
    that left the residuals, the first of what is known: a number that stops at a bound follows no reading, but is not known.
    """
    shape = residuals.shape
    pull, (noise, place, station) = problem.noise.pull(problem.whiten(residuals)), problem.noise.precision
    rows, columns = (np.concatenate(parts) for parts in zip(*problem.places, strict=True))
    result = LeftOut(np.zeros(shape), np.zeros(shape), np.zeros(shape[0]), np.zeros(shape[0], dtype=bool), 0.0)
    shared, squares, count = np.zeros((throughs[0].shape[1],) * 2), 0.0, 0
    for cells in _cells_of_groups(groups[rows], rows):
        is_same = station[cells][:, :, None] == station[cells][:, None]
        block = np.where(is_same, noise[cells[:, :, None], place[cells][:, None]], 0.0)
        covariances, checks = zip(*(_group_covariances(block, through[cells]) for through in throughs), strict=True)
        is_predicted = np.all(checks, axis=0)
        residual = (covariances[-1] @ pull[cells][:, :, None])[:, :, 0]
        scale = 1 / np.sqrt(np.diagonal(block, axis1=1, axis2=2))
        result.values[rows[cells], columns[cells]] = residual
        result.std[rows[cells], columns[cells]] = np.sqrt(np.diagonal(covariances[0], axis1=1, axis2=2))
        readings = np.split(np.arange(cells.shape[1]), np.flatnonzero(np.diff(rows[cells[0]])) + 1)
        for of_row in readings:
            unit = scale[:, of_row]
            white = residual[:, of_row] / unit
            covariance = covariances[0][:, of_row[:, None], of_row] / (unit[:, :, None] * unit[:, None])
            precision = np.linalg.pinv(covariance, rcond=1e-9, hermitian=True)
            row_numbers = rows[cells[:, of_row[0]]]
            result.distance[row_numbers] = np.maximum(np.einsum("gi,gij,gj->g", white, precision, white), 0.0)
            result.is_predicted[row_numbers] = is_predicted
        # of u and v, left out and white, the covariance is V_u V_vᵀ: the sum of its squares over all pairs is that of ΣVᵀV
        through, covariance = throughs[0][cells[is_predicted]], covariances[0][is_predicted]
        size, weight, spread = cells.shape[1], len(readings), covariance @ through
        products = through @ spread.swapaxes(1, 2)
        shared += weight / np.sqrt(size) * np.tensordot(through, spread, axes=([0, 1], [0, 1]))
        squares += weight**2 * float((1 - np.einsum("gij,gji->g", products, products) / size).sum())
        count += weight * len(through)
    return result._replace(trials=count**2 / (squares + float((shared**2).sum())) if count else 0.0)


def _cells_of_groups(groups: NDArray[np.intp], rows: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Yield the components ``(G, g)`` of groups whose readings have the same numbers of components."""
    order = np.argsort(groups, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(groups[order])) + 1)
    alike: dict[bytes, list[NDArray[np.intp]]] = {}
    for cells in members:
        alike.setdefault(np.diff(rows[cells]).astype(bool).tobytes(), []).append(cells)
    for same in alike.values():
        at_once = max(_CELLS // len(same[0]), 1)
        yield from (np.array(same[k : k + at_once]) for k in range(0, len(same), at_once))


def _group_covariances(blocks: Array, through: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the covariances ``(G, g, g)`` of left-out groups, and whether the others determine all of each."""
    # scaled to each component's precision, since lengths and angles are mixed
    scale = np.sqrt(np.diagonal(blocks, axis1=1, axis2=2))
    scaled = (blocks - through @ through.swapaxes(1, 2)) / (scale[:, :, None] * scale[:, None])
    values, vectors = np.linalg.eigh(scaled)
    # what a group alone determines has no residual
    is_determined = values > _ALONE
    vectors = vectors * is_determined[:, None] / scale[:, :, None]
    covariances = (vectors / np.where(is_determined, values, 1.0)[:, None]) @ vectors.swapaxes(1, 2)
    return covariances, np.asarray(is_determined.all(axis=1))


DOUBTFUL: Final = 1e-3
"""Probability of a larger chi-square below which the model is rejected."""


def model_warnings(problem: Problem, fit: Fit, chance: float | None, *, has_prior: bool) -> Iterator[Finding]:
    """Yield warnings if the model does not explain the readings; ``chance`` is ``None`` if this is not tested."""
    facts = f"chi-square {fit.chi_square:.4g} for {fit.degrees_of_freedom} degrees of freedom"
    if has_prior and problem.unit.is_independent:
        # numbers farther from their means than their tolerances make likely
        expected = np.maximum(1 - np.diag(fit.estimator.covariance), 1e-12)
        ratios = np.where(expected > 1e-6, np.abs(fit.z) / np.sqrt(expected), 0.0)
        limit = float(stats.norm.isf(DOUBTFUL / 2 / len(ratios)))
        for k in np.argsort(-ratios, kind="stable")[:3]:
            if ratios[k] > limit:
                message = (
                    f"{problem.unit.names[k]} is estimated {fit.z[k]:+.3g} standard deviations from its mean; "
                    "doubt its tolerance, or an error that acts like it"
                )
                yield Finding("warning", "W_TOLERANCE", message)
    if chance is not None and chance < DOUBTFUL:
        joint, ratio = _suspect_joint(problem, fit)
        message = (
            f"the model does not explain the readings: {facts} (probability {chance:.2g}); residuals look most like "
            f"an error of {joint} that changes from reading to reading ({ratio:.3g} times the expected square); "
            "doubt that joint, the instrument's std, or a source that the sheet lacks"
        )
        yield Finding("warning", "W_MODEL", message)
    elif chance is not None and fit.degrees_of_freedom > 0 and 1 - chance < DOUBTFUL:
        message = (
            f"residuals are smaller than std says: {facts}; the instrument or the tolerances are better than stated"
        )
        yield Finding("warning", "W_NOISE", message)
    if all(draw.scope is Scope.UNIT for draw in problem.model.space.draws):
        message = (
            "the sheet has no draw of scope visit or pose: repeatability counts as perfect, here and in the error left"
        )
        yield Finding("warning", "W_NO_REPEATABILITY", message)


def _visit_numbers(problem: Problem) -> Iterator[NDArray[np.bool_]]:
    """Yield which readings ``(P,)`` were taken at the first visit of their pose, at the second, and so on."""
    number = np.full(len(problem.readings), -1)
    for rows in map(list, problem.stations):
        number[rows] = np.unique(problem.visit[rows], return_inverse=True)[1]
    yield from (number == k for k in range(number.max() + 1))


def _suspect_joint(problem: Problem, fit: Fit) -> tuple[str, float]:
    """Return the joint whose error explains residuals best, and the ratio of its squares to the expected ones."""
    white, leverage = problem.whiten(problem.residuals(fit.z, fit.nuisances)), fit.estimator.leverage_root()
    count = len(problem.model.chain.joints)
    values, expected = np.zeros((2, count))
    by_error, by_joint = problem.at_means(fit.nuisances)[1], np.zeros((*problem.readings.shape, count))
    for station, places in zip(problem.each_station(), problem.places, strict=True):
        by_joint[places] = by_error[places] @ station.at.posture.joint_jacobian
    starts = [span.start for span in problem.spans]
    for visit in _visit_numbers(problem):
        along = problem.whiten(np.where(visit[:, None, None], by_joint, 0.0))
        values += (np.add.reduceat(along * white[:, None], starts) ** 2).sum(axis=0)
        expected += (along**2).sum(axis=0)
        for joint in range(count):
            expected[joint] -= (np.add.reduceat(along[:, joint, None] * leverage, starts) ** 2).sum()
    ratio = values / np.where(expected > 0, expected, np.inf)
    suspect = int(np.argmax(ratio))
    return problem.model.chain.joint_names[suspect], float(ratio[suspect])
