"""The fit of the exact model to readings: Gauss-Newton steps within bounds, and what to doubt after it.

It minimises ``|R^(-1/2) (y - h(q; x, n))|² + |z|²`` over z, with ``x = μ + L z``, and the nuisances n; without a prior only
the first part, over the combinations of z that the readings determine. Derivatives are those of the displaced chain at the
current estimate. The noise R is that at the means.

The standard deviation of the instrument is estimated by restricted maximum likelihood. Readings are ``y = H z + N n + e`` with z
of unit covariance (the sheet), n without prior, and e of covariance ``σ² D² + F``: D are deviations as stated, F what numbers of
scope visit and pose cause. What N could explain is left out of the likelihood (Patterson and Thompson 1971). Differences of
readings at one pose hold no error of the model: where there are enough of them they decide alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress, pairwise
from typing import ClassVar, Final, Literal, NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.sparse
from numpy.typing import NDArray
from scipy import stats

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import (
    MOST_GROSS,
    NEGLIGIBLE,
    Estimator,
    Instruments,
    UnitNumbers,
    stations_of_data,
    without,
)
from precision_pin.analyses.calibration.start import REWEIGHED, first_guess, readings_in_base, reweighed_sizes
from precision_pin.analyses.readings import Station
from precision_pin.base import se3
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import bounds_of
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet.measurement import Slopes

Places = tuple[NDArray[np.intp], NDArray[np.intp]]
STEPS: Final = 60
_SETTLED: Final = 1e-8
"""Largest change of z, and of whitened nuisances, at which the estimate has settled."""
_SMALL: Final = 1e-5
"""Change of z below which the derivatives of the last step serve for the next ones: they cost more than residuals."""
_HALVINGS: Final = 30
_TRIED_STEPS: Final = 8
"""Steps of a fit that only shows which readings, if any, are not explained."""
_GROSS: Final = 1e-3
"""Probability that any right reading of a set is taken for a gross error."""
_MOST_LEFT_OUT: Final = 0.4
"""Share of readings that a fit may leave out to find on what most agree."""
FARTHEST: Final = 50.0
"""Root mean square of whitened residuals of most readings beyond which data are refused."""
ODD: Final = 5.0
"""Root mean square of whitened residuals beyond which gross errors, and then another unit of the joint values, are sought."""
_ALONE: Final = 1e-9
"""Share of a group's readings that the others leave free, below which the group alone determines something."""


@dataclass(frozen=True, eq=False)
class _AtStations:
    """The exact model at component values ``(d, 1)``: at each station the error ``(6, 1)`` and its derivative ``(6, d)``."""

    stations: tuple[Station, ...]
    x: Array

    @cached_property
    def errors(self) -> list[Array]:
        return [station.at.exact(self.x) for station in self.stations]

    @cached_property
    def jacobians(self) -> list[Array]:
        pairs = zip(self.stations, self.errors, strict=True)
        return [station.at.jacobian_at(self.x[:, 0], error[:, 0]) for station, error in pairs]


@dataclass(frozen=True, eq=False)
class Problem:
    """Readings ``(P, m)`` to fit, as :meth:`Measurement.predict` returns them, and where the fit begins.

    Attributes:
        instruments, part: The measurements, and the number of that of each reading, ``(P,)``.
        readings, deviations: ``(P, m)`` each; a reading of fewer numbers has zeros beyond them, as its residuals have.
        visit: Readings of one visit were taken together, ``(P,)``.
        start: First nuisances, ``(k,)``.
    """

    model: ErrorModel
    instruments: Instruments
    stations: tuple[Station, ...]
    readings: Array
    deviations: Array
    part: NDArray[np.intp]
    visit: NDArray[np.intp]
    start: Array

    @classmethod
    def of(cls, model: ErrorModel, data: CalibrationData) -> tuple[Problem, tuple[Array, ...]]:
        """Return the problem of all readings, and of each measurement the first guess of the base in its axes, ``(4, 4)``."""
        instruments = Instruments(data.measurements)
        stations = stations_of_data(model, data)
        poses, tips = np.zeros((len(data), 4, 4)), np.zeros((len(data), 4, 4))
        for station in stations:
            poses[list(station.rows)] = station.at.posture.pose
            tips[list(station.rows)] = se3.displaced(station.at.posture.pose, station.at.error_at_means)
        bases, start = first_guess(data, tips, instruments)
        deviations = np.ones(data.readings.shape)
        for k, part in enumerate(data.measurements):
            rows = np.flatnonzero(data.part == k)
            given = data.std[rows] if data.std.size else np.full(rows.size, part.std)
            # of a std that is to be estimated the file's say only how they are to each other
            usual = part.std if part.std_known else np.sqrt((given**2).mean())
            deviations[rows, : part.size] = part.deviations * (given / usual)[:, None]
        readings = readings_in_base(data, poses, bases)
        return cls(model, instruments, stations, readings, deviations, data.part, data.visit, start), bases

    @cached_property
    def unit(self) -> UnitNumbers:
        """The model's numbers drawn once for each robot."""
        return UnitNumbers.of(self.model.space)

    @cached_property
    def sizes(self) -> NDArray[np.intp]:
        """How many numbers each reading has, ``(P,)``."""
        return np.array([part.size for part in self.instruments.parts])[self.part]

    @cached_property
    def places(self) -> tuple[Places, ...]:
        """Row and column in the readings of every number read at a station, in the order of its whitened numbers."""
        listed = ((np.array(station.rows), self.sizes[list(station.rows)]) for station in self.stations)
        return tuple((np.repeat(rows, sizes), np.concatenate([*map(np.arange, sizes)])) for rows, sizes in listed)

    @cached_property
    def spans(self) -> tuple[slice, ...]:
        """Where the whitened numbers of each station lie."""
        ends = np.cumsum([0, *(len(rows) for rows, _ in self.places)]).tolist()
        return tuple(slice(first, last) for first, last in pairwise(ends))

    @cached_property
    def labels(self) -> tuple[NDArray[np.intp], ...]:
        """What every number read at a station is of: equal for repeated readings of one number."""
        width = self.readings.shape[1]
        return tuple(self.part[rows] * width + columns for rows, columns in self.places)

    @cached_property
    def unknown_deviations(self) -> dict[str, NDArray[np.bool_]]:
        """Which numbers ``(P, m)`` have a standard deviation to be estimated, by the name of that deviation; refuse two kinds."""
        unknown = [part for part in self.instruments.parts if not part.std_known]
        if len({part.kind for part in unknown}) > 1:
            raise InputError("std: estimate is for readings of one kind; give the std of the others")
        found: dict[str, NDArray[np.bool_]] = {}
        for k, part in enumerate(self.instruments.parts):
            for name, mask in part.unknown_deviations.items():
                all_numbers = found.setdefault(name, np.zeros(self.readings.shape, dtype=bool))
                all_numbers[np.ix_(self.part == k, np.flatnonzero(mask))] = True
        return found

    @cached_property
    def roots(self) -> tuple[Array, ...]:
        """Lower root of the noise of each station's readings."""
        return tuple(
            station.noise_root(
                self.slopes_at(station, station.at.error_at_means, self.start).error,
                self.deviations[places] ** 2,
                self.visit[places[0]],
            )
            for station, places in zip(self.stations, self.places, strict=True)
        )

    def slopes_at(self, station: Station, error: Array, nuisances: Array) -> Slopes:
        """Return the derivatives of all numbers read at a station, ``(M, 6)`` and ``(M, k)``, where the tip's error is given."""
        parts = self.part[list(station.rows)].tolist()
        pose = station.at.posture.pose
        found = {part: self.instruments.slopes(part, pose, error, nuisances) for part in dict.fromkeys(parts)}
        return Slopes(*(np.concatenate(each) for each in zip(*(found[part] for part in parts), strict=True)))

    @cached_property
    def unseen_turns(self) -> Array:
        """Turns of bases that the readings do not tell, ``(k, f)``."""
        rows = [row for station in self.stations for row in station.rows]
        return self.instruments.unseen_turns(self.part[rows], self.readings[rows], self.deviations[rows, 0])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Bounds of z where the numbers are independent, ``(r,)`` each; of correlated numbers none."""
        unit = self.unit
        size = unit.root.shape[1]
        if not unit.is_independent:
            return np.full(size, -np.inf), np.full(size, np.inf)
        ends = [bounds_of(draw.law, k) for draw in self.model.space.draws for k in range(draw.law.size)]
        low, high = (np.array(ends)[unit.columns].T - unit.mean) / unit.std
        return low, high

    @property
    def at_stations(self) -> Iterator[tuple[Station, Places, slice, Array]]:
        """Each station with its entries of ``places``, ``spans`` and ``roots``."""
        return zip(self.stations, self.places, self.spans, self.roots, strict=True)

    def without(self, rows: Collection[int]) -> Problem:
        """Return the problem without some readings, which keep their places in the arrays."""
        kept = (Station(one.at, tuple(row for row in one.rows if row not in rows)) for one in self.stations)
        return replace(self, stations=tuple(station for station in kept if station.rows))

    @cached_property
    def _last(self) -> list[_AtStations]:
        return []

    def _at(self, z: Array) -> _AtStations:
        """Return the model at z; the last one is kept, since residuals and derivatives are asked for at the same z in turn."""
        x = self.unit.components(self.model.space, z[:, None])
        if not self._last or self._last[0].x.tobytes() != x.tobytes():
            self._last[:] = [_AtStations(self.stations, x)]
        return self._last[0]

    def residuals(self, z: Array, nuisances: Array) -> Array:
        """Return readings less predictions, ``(P, m)``."""
        return self.residuals_of(self._at(z).errors, nuisances)

    def residuals_of(self, errors: list[Array], nuisances: Array) -> Array:
        """Return readings less predictions, ``(P, m)``, for the error ``(6, 1)`` at each station."""
        result = np.zeros_like(self.readings)
        for station, error in zip(self.stations, errors, strict=True):
            pose = station.at.posture.pose
            predicted: dict[int, Array] = {}
            for row in station.rows:
                part = int(self.part[row])
                measurement, own = self.instruments.parts[part], nuisances[self.instruments.columns[part], None]
                if part not in predicted:
                    predicted[part] = measurement.predict(pose, error, own)
                reading = self.readings[row, : measurement.size, None]
                result[row, : measurement.size] = measurement.residual(reading, predicted[part])[:, 0]
        return result

    def whiten(self, values: Array) -> Array:
        """Return ``R^(-1/2)`` times ``(P, m, …)``, as ``(M, …)`` with the rows of each station together."""
        stacked = np.concatenate(
            [
                scipy.linalg.solve_triangular(root, values[places].reshape(len(root), -1), lower=True)
                for places, root in zip(self.places, self.roots, strict=True)
            ]
        )
        return stacked[:, 0] if values.ndim == 2 else stacked

    def slopes(self, z: Array, nuisances: Array, *, plain: bool = False) -> tuple[Array, Array]:
        """Return whitened derivatives of the readings by z (plain: by each number over its prior std) and by the nuisances."""
        root = np.diag(self.unit.std) if plain else self.unit.root
        size = root.shape[1]
        whole = np.zeros((*self.readings.shape, size + nuisances.size))
        at = self._at(z)
        for station, places, error, jacobian in zip(self.stations, self.places, at.errors, at.jacobians, strict=True):
            found = self.slopes_at(station, error[:, 0], nuisances)
            whole[places] = np.hstack([found.error @ jacobian[:, self.unit.columns] @ root, found.nuisances])
        white = self.whiten(whole)
        return white[:, :size], without(white[:, size:], self.unseen_turns)

    @property
    def spread(self) -> float:
        """Standard deviation of the places of the nominal tip along each axis, m."""
        points = np.array([station.at.posture.pose[:3, 3] for station in self.stations])
        return float(np.sqrt(((points - points.mean(axis=0)) ** 2).mean()))

    @cached_property
    def consensus(self) -> Consensus:
        """What most readings agree on, with the sheet as prior.

        Least trimmed squares (Rousseeuw 1984): the readings to leave out first are the farthest in a linear fit that they
        hardly pull, then those that the exact fit of the others does not explain.
        """
        z, nuisances = np.zeros(self.unit.root.shape[1]), self.start
        white, numbers = self.whiten(self.residuals(z, nuisances)), np.concatenate([rows for rows, _ in self.places])
        sizes = reweighed_sizes(white, *self.slopes(z, nuisances), numbers)
        scale, most = float(np.sqrt((sizes**2).mean())), int(_MOST_LEFT_OUT * len(sizes))
        if sizes.max() <= ODD:
            return Consensus({}, scale, ())
        gross = dict.fromkeys(np.argsort(-sizes)[:most].tolist(), np.inf)
        for _ in range(REWEIGHED):
            try:
                best = Descent(self.without(gross), has_prior=True, at=(z, nuisances)).fit(_TRIED_STEPS)
            except InputError:  # an error turns a place by half a turn
                return Consensus({}, scale, ())
            scale = float(np.sqrt(best.chi_square / max(best.degrees_of_freedom, 1)))
            z, nuisances = best.z, best.nuisances
            (distance, excess), before = self.outlying(best, gross), gross.keys()
            gross = {row: float(distance[row]) for row in np.argsort(-excess)[:most].tolist() if excess[row] > 1}
            if gross.keys() == before:
                break
        if len(gross) <= MOST_GROSS * len(sizes):
            return Consensus(gross, scale, ())
        return Consensus({}, scale, tuple(sorted(row for row in gross if distance[row] > FARTHEST**2)))

    def outlying(self, best: Fit, gross: Collection[int]) -> tuple[Array, Array]:
        """Return squared sizes ``(P,)``, in standard deviations, about a fit without each and without gross errors, over limits.

        The second are ratios to what one right set of readings in a thousand exceeds, wider where half of the others do.
        """
        distance, left_out = best.left_out.distance.copy(), list(gross)
        if left_out:
            deviations = self.reading_deviations(best)[left_out]
            off = self.residuals(best.z, best.nuisances)[left_out] / np.where(deviations > 0, deviations, 1.0)
            distance[left_out] = (off**2).sum(axis=1)
        limit, middle = stats.chi2.isf(_GROSS / len(distance), self.sizes), stats.chi2.median(self.sizes)
        return distance, distance / limit / max(1.0, float(np.median(np.delete(distance / middle, left_out))))

    def reading_deviations(self, best: Fit) -> Array:
        """Return the standard deviation of a new reading at each pose about its prediction by a fit, ``(P, m)``."""
        estimator, result = best.estimator, np.zeros_like(self.readings)
        is_whole = len(estimator.by_z) == self.spans[-1].stop
        white = (estimator.by_z, estimator.by_nuisance) if is_whole else self.slopes(best.z, best.nuisances)
        for _, places, span, root in self.at_stations:
            own = root @ np.hstack([part[span] for part in white])
            variances = (root**2).sum(axis=1) + np.einsum("ij,jk,ik->i", own, estimator.joint_covariance, own)
            result[places] = np.sqrt(variances)
        return result


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
    """What most readings agree on.

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
    """Steps of a fit, from the means or the point given; it can go on after an estimate was taken.

    Attributes:
        problem, has_prior: What is fitted.
        steps: Number of steps taken.
    """

    def __init__(self, problem: Problem, *, has_prior: bool, at: tuple[Array, Array] | None = None) -> None:
        self.problem, self.has_prior, self.steps = problem, has_prior, 0
        self._z, self._nuisances = at or (np.zeros(problem.unit.root.shape[1]), problem.start)
        self._white, self._cost = self._measured(self._z, self._nuisances)
        # without a prior the combinations to estimate are those at the means, the same at every step
        self._kept = None if has_prior else self._estimator().kept
        self._last: Estimator | None = None
        self._size, self._is_settled = np.inf, False

    def _measured(self, z: Array, nuisances: Array) -> tuple[Array, float]:
        """Return whitened residuals, and the cost."""
        white = self.problem.whiten(self.problem.residuals(z, nuisances))
        return white, float(white @ white) + (float(z @ z) if self.has_prior else 0.0)

    def _estimator(self, kept: Array | None = None) -> Estimator:
        slopes = self.problem.slopes(self._z, self._nuisances)
        return Estimator.of(*slopes, has_prior=self.has_prior, kept=kept)

    def fit(self, steps: int = STEPS) -> Fit:
        """Return the estimate after a number of steps in all, or when it has settled; refuse one that does not."""
        while not self._is_settled and self.steps < steps:
            self._step()
        if not self._is_settled and steps >= STEPS:
            raise InputError(
                f"the fit has not settled after {steps} steps; check the units of the data, the target and the base of the "
                "measurement"
            )
        return self._estimate()

    def _step(self) -> None:
        self.steps += 1
        if self._last is None or self._size > _SMALL:
            self._last = self._estimator(self._kept)
        estimator, z, nuisances = self._last, self._z, self._nuisances
        target = self._white + estimator.by_z @ z + estimator.by_nuisance @ nuisances
        better = estimator.estimate(target, *self.problem.bounds)
        change, other_change = better - z, estimator.nuisances(target - estimator.by_z @ better) - nuisances
        self._size = max(np.abs(change).max(initial=0.0), np.abs(estimator.by_nuisance @ other_change).max(initial=0.0))
        # the step is halved until the cost does not rise
        for share in 0.5 ** np.arange(_HALVINGS):
            new, other = z + share * change, nuisances + share * other_change
            try:
                there, value = self._measured(new, other)
            except InputError:  # an error turns a place by half a turn
                continue
            # rounding of the sum must not hold up the last steps
            if value <= self._cost * (1 + 1e-9) + 1e-9:
                self._z, self._nuisances, self._white, self._cost = new, other, there, value
                break
        self._is_settled = bool(self._size < _SETTLED * (1 + np.abs(self._z).max(initial=0.0)))

    def _estimate(self) -> Fit:
        problem, z, nuisances, white, cost = self.problem, self._z, self._nuisances, self._white, self._cost
        estimator = self._estimator(self._kept)
        residuals = problem.residuals(z, nuisances)
        degrees = len(white) - estimator.nuisance_rank - (0 if self.has_prior else estimator.kept.shape[1])
        at_bounds, local = tuple[str, ...](), estimator
        if self.has_prior and problem.unit.is_independent:
            low, high = problem.bounds
            held = (z <= low) | (z >= high)
            at_bounds = tuple(compress(problem.unit.names, held))
            if at_bounds:  # what stops at a bound does not follow the readings
                local = Estimator.of(estimator.by_z[:, ~held], estimator.by_nuisance, has_prior=True)
        without_bounds = estimator.estimate(white + estimator.by_z @ z) if at_bounds else z
        left_out = leave_out(problem, estimator, local, residuals, np.arange(len(residuals)))
        return Fit(
            z, nuisances, without_bounds, estimator, cost, degrees, residuals, local, left_out, self.steps, at_bounds
        )


def leave_out(
    problem: Problem, estimator: Estimator, local: Estimator, residuals: Array, groups: NDArray[np.intp]
) -> LeftOut:
    """Return readings less the prediction of a fit without their group, from residuals ``(P, m)`` and groups ``(P,)``.

    With T = R^(-1/2)ᵀ Q and Q of :meth:`Estimator.leverage_root`, those of a group are the inverse of its block of R⁻¹ - T Tᵀ
    times its rows of R⁻¹ r, and that inverse is their covariance. They are those of ``local``, their covariance that of
    ``estimator``: a number that stops at a bound follows no reading, but is not known.
    """
    shape = residuals.shape
    inverses = (scipy.linalg.solve_triangular(root, np.eye(len(root)), lower=True) for root in problem.roots)
    inverse = scipy.sparse.block_diag([scipy.sparse.coo_array(one) for one in inverses], format="csr")
    pull, noise = inverse.T @ problem.whiten(residuals), (inverse.T @ inverse).tocsr()
    throughs = [inverse.T @ one.leverage_root() for one in (estimator, *([] if local is estimator else [local]))]
    rows, columns = (np.concatenate(parts) for parts in zip(*problem.places, strict=True))
    found = LeftOut(np.zeros(shape), np.zeros(shape), np.zeros(shape[0]), np.zeros(shape[0], dtype=bool), 0.0)
    shared, alone, count = np.zeros((throughs[0].shape[1],) * 2), 0.0, 0
    for group in np.unique(groups[rows]):
        own = np.flatnonzero(groups[rows] == group)
        block = noise[own][:, own].toarray()
        covariances, seen = zip(*(_of_group(block, through[own]) for through in throughs), strict=True)
        left, scale = covariances[-1] @ pull[own], 1 / np.sqrt(np.diag(block))
        found.values[rows[own], columns[own]] = left
        found.std[rows[own], columns[own]] = np.sqrt(np.diag(covariances[0]))
        for row in np.unique(rows[own]):
            mine = rows[own] == row
            unit, white = scale[mine], left[mine] / scale[mine]
            covariance = covariances[0][np.ix_(mine, mine)] / np.outer(unit, unit)
            weighed = np.linalg.pinv(covariance, rcond=1e-9, hermitian=True)
            found.distance[row] = max(float(white @ weighed @ white), 0.0)
            found.is_predicted[row] = all(seen)
        if all(seen):
            # of u and v, left out and white, the covariance is V_u V_vᵀ: the sum of its squares over all pairs is that of ΣVᵀV
            spread, weight = throughs[0][own].T @ covariances[0] @ throughs[0][own], np.unique(rows[own]).size
            shared += weight / np.sqrt(own.size) * spread
            alone += weight**2 * (1 - (spread**2).sum() / own.size)
            count += weight
    return found._replace(trials=count**2 / (alone + float((shared**2).sum())) if count else 0.0)


def _of_group(block: Array, through: Array) -> tuple[Array, bool]:
    """Return the covariance of a group that is left out, and whether the others determine all of it."""
    # lengths and angles side by side: in units of each number's own precision
    scale = np.sqrt(np.diag(block))
    values, vectors = np.linalg.eigh((block - through @ through.T) / np.outer(scale, scale))
    # what a group alone determines has no residual
    seen = values > _ALONE
    vectors = vectors[:, seen] / scale[:, None]
    return (vectors / values[seen]) @ vectors.T, bool(seen.all())


DOUBTFUL: Final = 1e-3
"""Probability of a larger chi-square below which the model does not explain the readings."""


def doubt_model(problem: Problem, fit: Fit, chance: float | None, *, has_prior: bool) -> Iterator[Finding]:
    """Yield what to doubt where the model does not explain the readings; ``chance`` is ``None`` where that is not tested."""
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


def _suspect_joint(problem: Problem, fit: Fit) -> tuple[str, float]:
    """Return the joint whose own error explains residuals best, and by how much its squares exceed those expected."""
    white = problem.whiten(problem.residuals(fit.z, fit.nuisances))
    hold = fit.estimator.hold()
    values, expected = np.zeros((2, len(problem.model.chain.joints)))
    for station, places, rows, root in problem.at_stations:
        by_error = problem.slopes_at(station, station.at.error_at_means, fit.nuisances).error
        moved = by_error @ station.at.posture.joint_jacobian
        for visit in np.unique(problem.visit[places[0]]):
            own = np.where((problem.visit[places[0]] == visit)[:, None], moved, 0.0)
            along = np.linalg.solve(root, own)
            values += (along.T @ white[rows]) ** 2
            expected += np.einsum("ij,ik,kj->j", along, hold[rows, rows], along)
    ratio = values / np.where(expected > 0, expected, np.inf)
    best = int(np.argmax(ratio))
    return problem.model.chain.joint_names[best], float(ratio[best])


LEVEL: Final = 0.95
"""Probability of the intervals, and of the ellipsoids that left-out readings should be within."""
ENOUGH: Final = 10
"""Degrees of freedom of differences at one pose from which they decide alone: the interval is then from 0.7 to 1.75 of it."""
_DECADES: Final = 5.0
"""Range of the search below the largest deviation."""
_STEPS: Final = 41
_REACH: Final = float(stats.chi2.ppf(LEVEL, 1))


@dataclass(frozen=True)
class EstimatedStd(Record):
    """A standard deviation that readings tell, with the 95 % interval of its profile likelihood, m or rad.

    ``decided_by`` are the ``repeats`` (differences of readings at one pose, free of the model's errors) or ``all readings``,
    which hold what the model leaves unexplained too; ``of_all`` is the estimate from these, and ``degrees_of_freedom`` the
    information: the number of independent readings of a known mean that would tell as much.
    """

    KEYS: ClassVar[Keys] = ("std", "interval", "probability", "degrees_of_freedom", "decided_by", "of_all")
    probability: ClassVar[float] = LEVEL

    std: float
    interval: tuple[float, float]
    degrees_of_freedom: float
    decided_by: Literal["repeats", "all readings"]
    of_all: float


class Likelihood:
    """-2 ln of the restricted likelihood of factors, one for each kind of deviation.

    ``blocks`` are for each station F ``(b, b)``, D² of each kind ``(g, b, b)`` and the columns ``[H, N, y]``, ``(b, r + k + 1)``,
    of which the first ``random`` are H. The columns of N are independent.
    """

    def __init__(self, blocks: list[tuple[Array, Array, Array]], random: int) -> None:
        sizes = sorted({len(block[0]) for block in blocks})
        self._stacks = [
            tuple(np.array(part) for part in zip(*(one for one in blocks if len(one[0]) == size), strict=True))
            for size in sizes
        ]
        width = blocks[0][2].shape[1]
        self._prior = np.eye(random, width)
        self.kinds = len(blocks[0][1])

    def _white(self, logs: Array) -> list[tuple[Array, Array]]:
        """Return the roots of the noise and the columns over them, for each size of block."""
        found = []
        for fixed, each, columns in self._stacks:
            root = np.linalg.cholesky(fixed + np.einsum("g,sgij->sij", np.exp(2 * logs), each))
            found.append((root, np.linalg.solve(root, columns)))
        return found

    def __call__(self, logs: Array) -> float:
        """Return its value at logarithms of the factors, ``(g,)``; infinity where the noise is singular."""
        try:
            white = self._white(logs)
        except np.linalg.LinAlgError:
            return np.inf
        rows = [part.reshape(-1, part.shape[2]) for _, part in white]
        diagonal = np.abs(np.diag(np.linalg.qr(np.vstack([*rows, self._prior]), mode="r")))
        of_noise = sum(float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum()) for root, _ in white)
        return 2 * of_noise + 2 * float(np.log(diagonal[:-1]).sum()) + float(diagonal[-1] ** 2)

    def information(self, logs: Array) -> Array:
        """Return the degrees of freedom of each kind, ``(g,)``: twice the information on ln σ² of that kind."""
        white = self._white(logs)
        rows = [part.reshape(-1, part.shape[2]) for _, part in white]
        basis = np.linalg.qr(np.vstack([*rows, self._prior])[:, :-1])[0]
        result, first = np.zeros(self.kinds), 0
        inner = np.zeros((self.kinds, basis.shape[1], basis.shape[1]))
        for (root, columns), (_, each, _) in zip(white, self._stacks, strict=True):
            count = root.shape[0] * root.shape[1]
            own = basis[first : first + count].reshape(*columns.shape[:2], -1)
            first += count
            for kind, variance in enumerate(np.exp(2 * logs)):
                half = np.linalg.solve(root, each[:, kind])
                share = variance * np.linalg.solve(root, np.swapaxes(half, 1, 2))
                moved = share @ own
                result[kind] += (share**2).sum() - 2 * (moved**2).sum()
                inner[kind] += np.einsum("sbi,sbj->ij", own, moved)
        return np.asarray(result + (inner**2).sum(axis=(1, 2)), dtype=float)


def largest_likelihood(likelihood: Likelihood, most: float) -> tuple[Array, list[tuple[float, float]]]:
    """Return the logarithms of the likeliest factors, at most ``most``, and the ends of their profile intervals; -inf is zero."""
    grid = np.linspace(most - _DECADES * np.log(10), most, _STEPS)
    step = float(grid[1] - grid[0])

    def along(kind: int, others: Array, floor: float) -> tuple[float, float]:
        """Return the best logarithm of one kind, and the value there."""

        def value(log: float) -> float:
            return likelihood(np.insert(others, kind, log))

        near = float(min(grid, key=value))
        found = scipy.optimize.minimize_scalar(
            value, bounds=(near - step, near + step), method="bounded", options={"xatol": floor}
        )
        return float(found.x), float(found.fun)

    point = np.full(likelihood.kinds, most - np.log(10))
    # both kinds hardly depend on each other: alternate; one alone is found at once
    for _ in range(20 if likelihood.kinds > 1 else 1):
        before = point.copy()
        for kind in range(likelihood.kinds):
            point[kind], least = along(kind, np.delete(point, kind), 1e-7)
        if np.abs(point - before).max() < 1e-6:
            break
    ends = []
    for kind in range(likelihood.kinds):

        def excess(log: float, kind: int = kind) -> float:
            others = np.delete(point, kind)
            if others.size:
                return along(1 - kind, np.array([log]), 1e-4)[1] - least - _REACH
            return likelihood(np.array([log])) - least - _REACH

        low, high = point[kind] - step, point[kind] + step
        while excess(float(low)) < 0 and low > grid[0]:
            low -= step
        while excess(float(high)) < 0:
            high += step
        below = -np.inf if low <= grid[0] else float(scipy.optimize.brentq(excess, low, point[kind], xtol=1e-6))
        ends.append((below, float(scipy.optimize.brentq(excess, point[kind], high, xtol=1e-6))))
    return point, ends


def estimate_std(
    problem: Problem, z: Array, nuisances: Array, kinds: Mapping[str, NDArray[np.bool_]], *, has_prior: bool
) -> dict[str, tuple[float, EstimatedStd]]:
    """Return the factor on the stated deviation, and the estimate, of each kind; ``kinds`` name masks ``(P, m)`` of numbers."""
    blocks, random = _blocks(problem, z, nuisances, list(kinds.values()), has_prior=has_prior)
    repeats = [block for block in map(_differences, blocks, problem.labels) if block is not None]
    most = _largest(blocks, random)
    whole = Likelihood([block[:3] for block in blocks], random)
    of_all, ends = largest_likelihood(whole, most)
    found = [(of_all, ends, whole.information(of_all), "all readings")] * len(kinds)
    if repeats:
        pure = Likelihood(repeats, 0)
        point, ends = largest_likelihood(pure, most)
        free = pure.information(point)
        found = [(point, ends, free, "repeats") if free[k] >= ENOUGH else one for k, one in enumerate(found)]
    result, rows = {}, [row for station in problem.stations for row in station.rows]
    for k, ((name, mask), (point, ends, free, source)) in enumerate(zip(kinds.items(), found, strict=True)):
        stated = float(np.sqrt((problem.deviations[rows][mask[rows]] ** 2).mean()))
        low, high, std, every = (stated * float(np.exp(value)) for value in (*ends[k], point[k], of_all[k]))
        result[name] = (std / stated, EstimatedStd(std, (low, high), float(free[k]), source, every))  # type: ignore[arg-type]
    return result


def _blocks(
    problem: Problem, z: Array, nuisances: Array, masks: list[NDArray[np.bool_]], *, has_prior: bool
) -> tuple[list[tuple[Array, Array, Array]], int]:
    """Return the blocks of :class:`Likelihood`, and the number of random columns."""
    by_z, fixed = problem.slopes(z, nuisances)
    if not has_prior:
        fixed = np.hstack([fixed, by_z @ Estimator.of(by_z, fixed, has_prior=False).kept])
    readings = problem.whiten(problem.residuals(z, nuisances)) + by_z @ z
    lengths = np.linalg.norm(fixed, axis=0)
    basis, values, _ = np.linalg.svd(fixed / np.where(lengths > 0, lengths, 1.0), full_matrices=False)
    basis = basis[:, : int((values > NEGLIGIBLE * values.max(initial=0.0)).sum())]
    random = by_z if has_prior else by_z[:, :0]
    white, blocks = np.hstack([random, basis, readings[:, None]]), []
    for station, places, span, root in problem.at_stations:
        slopes = problem.slopes_at(station, station.at.error_at_means, problem.start)
        variances = problem.deviations[places] ** 2
        each = np.array([np.diag(variances * mask[places]) for mask in masks])
        known = station.noise(slopes.error, variances, problem.visit[places[0]]) - each.sum(axis=0)
        blocks.append((known, each, root @ white[span]))
    return blocks, random.shape[1]


def _differences(block: tuple[Array, Array, Array], labels: NDArray[np.intp]) -> tuple[Array, Array, Array] | None:
    """Return the block of the differences of equal numbers at one pose, which neither the arm nor the set-up changes."""
    fixed, each, columns = block
    rows = []
    for own in (np.flatnonzero(labels == label) for label in np.unique(labels)):
        contrasts = np.zeros((own.size - 1, labels.size))
        contrasts[:, own] = scipy.linalg.helmert(own.size)
        rows.append(contrasts)
    change = np.concatenate(rows)
    found = change @ fixed @ change.T, change @ each @ change.T, change @ columns[:, -1:]
    return found if len(change) else None


def _largest(blocks: list[tuple[Array, Array, Array]], random: int) -> float:
    """Return the logarithm of a factor that is too large: three times that which takes all of the readings for noise."""
    scale = np.concatenate([np.sqrt(np.diag(each.sum(axis=0))) for _, each, _ in blocks])
    seen = scale > 0
    columns = np.concatenate([block[2] for block in blocks])[seen] / scale[seen, None]
    fixed, readings = columns[:, random:-1], columns[:, -1]
    left = readings - fixed @ np.linalg.lstsq(fixed, readings, rcond=None)[0]
    size = float(np.sqrt((left**2).mean()))
    if not size > 0:
        raise InputError(
            "the readings are those of the sheet's means to the last digit; no std can be estimated from them"
        )
    return float(np.log(3 * size))


def chance_of(chi_square: float, degrees: int, noise: Mapping[str, EstimatedStd], repeated: int) -> float | None:
    """Return the probability that a right model gives a larger chi-square; ``None`` where a std was tuned to its residuals.

    By a std of repeats, of which ``repeated`` numbers of chi-square are, the others are judged by F.
    """
    if not noise:
        return float(stats.chi2.sf(chi_square, degrees)) if degrees > 0 else 1.0
    if any(one.decided_by != "repeats" for one in noise.values()) or degrees <= repeated:
        return None
    free = degrees - repeated
    return float(
        stats.f.sf((chi_square - repeated) / free, free, sum(one.degrees_of_freedom for one in noise.values()))
    )


def doubt_std(noise: Mapping[str, EstimatedStd]) -> Iterator[Finding]:
    """Yield a warning where a std was estimated from residuals of the model."""
    tuned = [name for name, one in noise.items() if one.decided_by != "repeats"]
    if tuned:
        message = (
            f"{' and '.join(tuned)} estimated from the residuals of the model, on {noise[tuned[0]].degrees_of_freedom:.3g} "
            "degrees of freedom: whether the model explains the readings is not tested, and the std includes the model's own "
            "errors; repeat poses"
        )
        yield Finding("warning", "W_STD_ESTIMATED", message)
