"""Fit of the exact model to readings: Gauss-Newton steps within bounds, and warnings about the result.

It minimises ``|R^(-1/2) (y - h(q; x, n))|² + |z|²`` over z, with ``x = μ + L z``, and the nuisances n; without a prior only
the first part, over the combinations of z that the readings determine. Derivatives are those of the displaced chain at the
current estimate. The noise R is that at the means. Derivatives of a chunk of readings are in memory at a time, and reduced.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress, pairwise
from typing import Final, NamedTuple, Protocol

import numpy as np
import scipy.linalg
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
from precision_pin.analyses.calibration.drift import CommonFactors
from precision_pin.analyses.calibration.evaluation import Evaluation
from precision_pin.analyses.calibration.instrument import instrument_covariance
from precision_pin.analyses.calibration.noise import (
    LargeGroup,
    Noise,
    Places,
    Precision,
    Reduction,
    SmallGroups,
    blocks_of,
)
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
"""Largest change of z, and root mean square change of whitened readings by nuisances, at which the estimate has converged."""
_STALLED: Final = 1e-6
"""The same where it is not smaller than in the step before."""
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
_LARGE: Final = 300
"""Components of a group beyond which T has far fewer columns."""


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
        common: Factors of what readings share, in their axes: what remains of the instrument's drift.
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
    common: CommonFactors

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
        common = CommonFactors(data.sessions, readings.shape[1], rotations)
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
        return tuple(_places(rows, self.sizes[list(rows)]) for rows in map(np.array, self.stations))

    @cached_property
    def numbers(self) -> Places:
        """Row and column in the readings of every whitened number."""
        rows = np.concatenate(self.stations)
        return _places(rows, self.sizes[rows])

    @property
    def precision(self) -> Precision:
        """The inverse of the noise apart from what readings share."""
        parts = [chunk.noise.precision for chunk in self.chunks]
        width = max(part.rows.shape[1] for part in parts)
        rows = [np.pad(part.rows, ((0, 0), (0, width - part.rows.shape[1]))) for part in parts]
        firsts = np.cumsum([0, *(part.station[-1] + 1 for part in parts)])
        stations = [part.station + first for part, first in zip(parts, firsts[:-1], strict=True)]
        return Precision(np.vstack(rows), np.concatenate([part.place for part in parts]), np.concatenate(stations))

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
    def chunks(self) -> tuple[Chunk, ...]:
        """The readings in chunks of stations, with their noise: at each station as of :meth:`Station.noise`."""
        by_error, (_, scopes) = self.evaluation.by_error(self.start), self.evaluation.at_means
        firsts = np.cumsum([0, *map(len, self.evaluation.chunks)])
        at = np.empty(len(self.readings), dtype=np.intp)  # place of each reading in its chunk
        at[np.concatenate(self.evaluation.chunks)] = np.arange(firsts[-1])
        owners = np.searchsorted(firsts, at[[rows[0] for rows in self.stations]], side="right") - 1
        result, first = [], 0
        for number in np.unique(owners).tolist():
            stations = [self.stations[k] for k in np.flatnonzero(owners == number)]
            rows, blocks, covariances = np.concatenate(stations), blocks_of(_local(stations, self.sizes)), []
            for block in blocks:
                of_block, columns = rows[block.places[0]], block.places[1]
                slopes, pose = by_error[of_block, columns], self.evaluation.station[of_block[:, 0]]
                of_visit, of_pose = (
                    slopes @ scopes[scope][pose] @ slopes.swapaxes(1, 2) for scope in (Scope.VISIT, Scope.POSE)
                )
                visits, instrument = self.visit[of_block], self.instrument_at((of_block, columns))
                covariances.append(instrument + of_visit * (visits[:, :, None] == visits[:, None]) + of_pose)
            try:
                noise = Noise(blocks, covariances)
            except np.linalg.LinAlgError:
                self._check_noise()
                raise
            count = int(self.sizes[rows].sum())
            result.append(Chunk(number, rows, at[rows] - firsts[number], slice(first, first + count), noise))
            first += count
        return tuple(result)

    def _check_noise(self) -> None:
        """Raise where the noise of a station is singular."""
        by_error = self.evaluation.by_error(self.start)
        for station, places in zip(self.each_station(), self.places, strict=True):
            station.noise_root(by_error[places], self.instrument_at(places), self.visit[places[0]])

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

    def _components(self, z: Array) -> Array:
        return self.unit.components(self.model.space, z[:, None])[:, 0]

    def columns(
        self, z: Array, nuisances: Array, causes: Causes | None = None, *, of: Iterable[Chunk] = ()
    ) -> Iterator[tuple[Chunk, Array]]:
        """Yield chunks, all by default, and columns of their readings ``(R, m, w + k + U + … + 1)``.

        These are what readings share, derivatives by the nuisances and by each number over its prior std, further causes, and
        readings less predictions.
        """
        x = self._components(z)
        for chunk in of or self.chunks:
            point = self.evaluation.at(chunk.number, x, self.unit.columns, nuisances)
            by_number, by_nuisance = np.split(point.derivatives[chunk.at], [self.unit.columns.size], axis=2)
            residuals = self._less(chunk.rows, point.values[chunk.at])[:, :, None]
            by_nuisance = without(by_nuisance, self.unseen_turns)
            further = [] if causes is None else [causes.of(chunk.rows)]
            shared = self.common.of(chunk.rows)
            yield chunk, np.concatenate([shared, by_nuisance, by_number * self.unit.std, *further, residuals], axis=2)

    def white_columns(
        self, z: Array, nuisances: Array, causes: Causes | None = None
    ) -> Iterator[tuple[NDArray[np.intp], Array]]:
        """Yield the reading of each number and the whitened columns of each chunk, ``(m,)`` and ``(m, w + k + U + … + 1)``."""
        for chunk, columns in self.columns(z, nuisances, causes):
            yield np.repeat(chunk.rows, self.sizes[chunk.rows]), chunk.noise.whiten(columns)

    def reduce(self, z: Array, nuisances: Array, causes: Causes | None = None) -> Reduction:
        """Return the reduction of the whitened columns."""
        chunks = (columns for _, columns in self.white_columns(z, nuisances, causes))
        return Reduction.of(chunks, self.common.size, nuisances.size)

    def by_z(self, reduction: Reduction) -> Array:
        """Return the reduced columns by z."""
        return self.by_number(reduction) @ self._number_by_z

    def by_number(self, reduction: Reduction) -> Array:
        """Return the reduced columns by each number over its prior std."""
        return reduction.rows[:, reduction.nuisances :][:, : self.unit.columns.size]

    def over_numbers(self, coefficients: Array) -> Array:
        """Return coefficients ``(k + U, …)`` of nuisances and numbers, for ``(k + r, …)`` of nuisances and z."""
        return np.concatenate([coefficients[: self.start.size], self._number_by_z @ coefficients[self.start.size :]])

    @cached_property
    def _number_by_z(self) -> Array:
        return self.unit.root / self.unit.std[:, None]

    def residuals(self, z: Array, nuisances: Array) -> Array:
        """Return readings less predictions, ``(P, m)``."""
        result, x = np.zeros(self.readings.shape), self._components(z)
        for chunk in self.chunks:
            point = self.evaluation.at(chunk.number, x, self.unit.columns, nuisances)
            result[chunk.rows] = self._less(chunk.rows, point.values[chunk.at])
        return result

    def combined(self, z: Array, nuisances: Array, coefficients: Array, causes: Causes | None = None) -> Array:
        """Return the sum of the columns times coefficients of the nuisances, the numbers and the causes, ``(P, m)``."""
        result, first = np.zeros(self.readings.shape), self.common.size
        for chunk, columns in self.columns(z, nuisances, causes):
            result[chunk.rows] = columns[:, :, first : first + coefficients.size] @ coefficients
        return result

    def _less(self, rows: NDArray[np.intp], values: Array) -> Array:
        result = np.zeros_like(values)
        for number in np.unique(self.part[rows]).tolist():
            part, of_part = self.instruments.parts[number], self.part[rows] == number
            readings, predicted = self.readings[rows[of_part], : part.size].T, values[of_part, : part.size].T
            result[of_part, : part.size] = part.residual(readings, predicted).T
        return result

    def flat(self, chunk: Chunk, values: Array) -> Array:
        """Return values of the readings of a chunk ``(R, m, …)`` in the order of whitened numbers, ``(M, …)``."""
        return np.asarray(values[_places(np.arange(len(chunk.rows)), self.sizes[chunk.rows])])

    def precision_times(self, values: Array) -> Array:
        """Return R⁻¹ times readings ``(P, m)``, in the order of whitened numbers, ``(M,)``."""
        white = [chunk.noise.whiten(values[chunk.rows]) for chunk in self.chunks]
        if self.common.size:
            pulled = sum(w.T @ part for w, part in zip(self._shared(), white, strict=True))
            inner = scipy.linalg.cho_solve((Reduction.of(self._shared(), self.common.size, 0).shared, False), pulled)
            white = [part - w @ inner for w, part in zip(self._shared(), white, strict=True)]
        return np.concatenate([chunk.noise.pull(part) for chunk, part in zip(self.chunks, white, strict=True)])

    def _shared(self) -> Iterator[Array]:
        """Yield the whitened factors of what the readings of each chunk share."""
        return (chunk.noise.whiten(self.common.of(chunk.rows)) for chunk in self.chunks)

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

    def through(
        self, at: tuple[Array, Array], reduction: Reduction, *coefficients: Array, causes: Causes | None = None
    ) -> Through:
        """Return T of columns at z and nuisances times coefficients ``(c, n)``, beside what readings share."""
        size = max(map(len, coefficients))
        filled = [np.vstack([part, np.zeros((size - len(part), part.shape[1]))]) for part in coefficients]
        return Through(self, at, reduction.over(np.hstack(filled)), causes)

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
        sizes = reweighed_sizes(lambda: self._robust_columns(z, nuisances), self.start.size, len(self.readings))
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

    def _robust_columns(self, z: Array, nuisances: Array) -> Iterator[tuple[NDArray[np.intp], Array]]:
        """Yield the columns of :func:`reweighed_sizes`, with what readings share among the numbers of unit prior."""
        first, last = self.common.size, self.common.size + self.start.size
        for rows, columns in self.white_columns(z, nuisances):
            shared, by_nuisance, by_number, white = np.split(columns, [first, last, -1], axis=1)
            yield rows, np.hstack([by_nuisance, shared, by_number @ self._number_by_z, white])

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
        result, shared, set_up = np.zeros(self.readings.shape), self.common.size, self.start.size
        for chunk, columns in self.columns(fit.z, fit.nuisances):
            by_nuisance, by_number = np.split(columns[:, :, shared:-1], [set_up], axis=2)
            slopes = np.concatenate([by_number @ self._number_by_z, by_nuisance], axis=2)
            variances = np.einsum("pmj,jk,pmk->pm", slopes, fit.estimator.joint_covariance, slopes, optimize=True)
            variances += (columns[:, :, :shared] ** 2).sum(axis=2)
            is_read = np.arange(variances.shape[1]) < self.sizes[chunk.rows, None]
            variances[is_read] += chunk.noise.variances
            result[chunk.rows] = np.sqrt(variances)
        return result


class Causes(Protocol):
    """Further columns of readings."""

    def of(self, rows: NDArray[np.intp]) -> Array:
        """Return the columns of some readings, ``(R, m, C)``."""


class Chunk(NamedTuple):
    """Readings of some stations.

    Attributes:
        number: Of the chunk in :class:`Evaluation`.
        rows: Numbers of its readings, station by station, ``(R,)``.
        at: Their places in the chunk of the evaluation, ``(R,)``.
        white: Its whitened numbers among those of all chunks.
        noise: Their noise apart from what they share; its readings are those of the chunk, ``(R, m)``.
    """

    number: int
    rows: NDArray[np.intp]
    at: NDArray[np.intp]
    white: slice
    noise: Noise


class Through(NamedTuple):
    """T of a fit, with which R⁻¹ - T Tᵀ, of D⁻¹ - T Tᵀ, takes what is left of readings: rows are made where they are needed.

    T is ``D⁻¹ [W | N | …] over``, of the columns of :meth:`Problem.columns` at z and nuisances ``point``, and of
    :meth:`Reduction.over`.
    """

    problem: Problem
    point: tuple[Array, Array]
    over: Array
    causes: Causes | None

    def of(self, chunks: Sequence[Chunk]) -> Array:
        """Return the rows of the numbers of some chunks, ``(M, c)``."""
        parts = self.problem.columns(*self.point, self.causes, of=chunks)
        return np.concatenate(
            [
                chunk.noise.pull(chunk.noise.whiten(columns[:, :, : len(self.over)] @ self.over))
                for chunk, columns in parts
            ]
        )

    def times(self, values: Array) -> Array:
        """Return Tᵀ times readings ``(P, m)``, ``(c,)``."""
        rows, columns = self.problem.numbers
        of_numbers = values[rows, columns]
        return np.asarray(sum(self.of([chunk]).T @ of_numbers[chunk.white] for chunk in self.problem.chunks))


def _places(rows: NDArray[np.intp], sizes: NDArray[np.intp]) -> Places:
    """Return row and column of every number of readings with ``sizes`` numbers."""
    return np.repeat(rows, sizes), np.concatenate([*map(np.arange, sizes)])


def _local(stations: Sequence[Sequence[int]], sizes: NDArray[np.intp]) -> list[Places]:
    """Return the places of numbers read at stations, whose readings are counted from 0."""
    firsts = np.cumsum([0, *map(len, stations)])
    return [
        _places(np.arange(a, b), sizes[list(rows)]) for (a, b), rows in zip(pairwise(firsts), stations, strict=True)
    ]


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

    @classmethod
    def empty(cls, problem: Problem) -> LeftOut:
        """Return zeros for all readings."""
        count, size = problem.readings.shape
        values, std = np.zeros((2, count, size))
        return cls(values, std, np.zeros(count), np.zeros(count, dtype=bool), 0.0)


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
        reduction, estimator: Derivatives there and residuals, reduced, and the linear estimate by these.
        chi_square, degrees_of_freedom: Sum of squares of whitened residuals (with a prior, and of z), and its expectation.
        residuals, left_out: Reading less prediction, ``(P, m)``; less that of a fit without it.
        is_free: Whether a number follows the readings, and does not stop at a bound, ``(r,)``.
        steps, at_bounds: Gauss-Newton steps, and names of the numbers at a bound of their law.
    """

    z: Array
    nuisances: Array
    without_bounds: Array
    reduction: Reduction
    estimator: Estimator
    chi_square: float
    degrees_of_freedom: int
    residuals: Array
    is_free: NDArray[np.bool_]
    left_out: LeftOut
    steps: int
    at_bounds: tuple[str, ...]

    def local(self, reduction: Reduction, by_z: Array) -> Estimator:
        """Return the estimator by a reduction at the estimate where numbers at a bound are known: they do not follow readings."""
        has_prior, basis = self.estimator.has_prior, self.estimator.basis
        return Estimator.of(by_z * self.is_free, reduction.by_nuisance, has_prior=has_prior, basis=basis)

    def throughs(self, problem: Problem) -> list[Through]:
        """Return T of the fit, and without the numbers at a bound where there are any."""
        by_z = problem.by_z(self.reduction)
        overs = [problem.over_numbers(self.estimator.root_by_columns)]
        overs += [] if self.is_free.all() else [self.over(problem, self.local(self.reduction, by_z))]
        return [problem.through((self.z, self.nuisances), self.reduction, over) for over in overs]

    def over(self, problem: Problem, local: Estimator) -> Array:
        """Return coefficients ``(k + U, n)`` with which nuisances and numbers are the root of the leverage of :meth:`local`."""
        coefficients = local.root_by_columns
        coefficients[self.nuisances.size :] *= self.is_free[:, None]
        return problem.over_numbers(coefficients)


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
        self._basis = None if has_prior else self._estimator(problem.reduce(*means), None).basis
        self._z, self._nuisances = at or means
        self._reduction, self._cost = self._evaluate(self._z, self._nuisances)
        self._size, self._is_settled = np.inf, False
        self._settled_fit: Fit | None = None

    def _evaluate(self, z: Array, nuisances: Array) -> tuple[Reduction, float]:
        """Return the reduction at a point, and the cost."""
        reduction = self.problem.reduce(z, nuisances)
        return reduction, float(reduction.white @ reduction.white) + (float(z @ z) if self.has_prior else 0.0)

    def _estimator(self, reduction: Reduction, basis: Array | None) -> Estimator:
        return Estimator.of(self.problem.by_z(reduction), reduction.by_nuisance, has_prior=self.has_prior, basis=basis)

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
        z, nuisances, white, count = self._z, self._nuisances, self._reduction.white, self._reduction.size
        estimator = self._estimator(self._reduction, self._basis)
        new_z = estimator.estimate(white, z, *self.problem.bounds)
        z_step = new_z - z
        n_step = estimator.nuisances(white - estimator.by_z @ z_step + estimator.by_nuisance @ nuisances) - nuisances
        last_size = self._size
        change = float(np.linalg.norm(estimator.by_nuisance @ n_step)) / count**0.5
        self._size = max(np.abs(z_step).max(initial=0.0), change)
        # the step is halved until the cost does not rise
        for fraction in 0.5 ** np.arange(_HALVINGS):
            trial_z, trial_nuisances = z + fraction * z_step, nuisances + fraction * n_step
            try:
                trial, trial_cost = self._evaluate(trial_z, trial_nuisances)
            except InputError:  # an error turns a place by half a turn
                continue
            # rounding of the sum must not hold up the last steps
            if trial_cost <= self._cost * (1 + 1e-9) + 1e-9:
                self._z, self._nuisances, self._reduction, self._cost = trial_z, trial_nuisances, trial, trial_cost
                break
        # small steps that no longer shrink are rounding
        limit = _SETTLED if self._size < last_size else _STALLED
        self._is_settled = bool(self._size < limit * (1 + np.abs(self._z).max(initial=0.0)))

    def _estimate(self) -> Fit:
        problem, z, nuisances, reduction, cost = self.problem, self._z, self._nuisances, self._reduction, self._cost
        estimator = self._estimator(reduction, self._basis)
        residuals = problem.residuals(z, nuisances)
        degrees = reduction.size - estimator.nuisance_rank - (0 if self.has_prior else estimator.basis.shape[1])
        is_free = np.ones(z.size, dtype=bool)
        if self.has_prior and problem.unit.is_independent:
            low, high = problem.bounds
            is_free = (low < z) & (z < high)
        at_bounds = () if is_free.all() else tuple(compress(problem.unit.names, ~is_free))
        without_bounds = estimator.estimate(reduction.white, z) if at_bounds else z
        facts = z, nuisances, without_bounds, reduction, estimator, cost, degrees, residuals, is_free
        fit = Fit(*facts, LeftOut.empty(problem), self.steps, at_bounds)
        left_out = leave_out(problem, fit.throughs(problem), residuals, np.arange(len(residuals)))
        return fit._replace(left_out=left_out)


def leave_out(problem: Problem, throughs: Sequence[Through], residuals: Array, groups: NDArray[np.intp]) -> LeftOut:
    """Return readings less the prediction of a fit without their group, from residuals ``(P, m)`` and groups ``(P,)``.

    With T of :class:`Through`, those of a group are the inverse of its block of R⁻¹ = D⁻¹ - T Tᵀ times its rows of R⁻¹ r, and
    that inverse is their covariance. The last of ``throughs`` is of the fit that left the residuals, the first of what is
    known: a number that stops at a bound follows no reading, but is not known.
    """
    pull, chunks, result = problem.precision_times(residuals), problem.chunks, LeftOut.empty(problem)
    firsts, precision = np.array([chunk.white.start for chunk in chunks]), problem.precision
    rows, columns = problem.numbers
    shared, squares, count = np.zeros((throughs[0].over.shape[1],) * 2), 0.0, 0
    for cells in _cells_of_groups(groups[rows], rows):
        kind = LargeGroup if cells.shape[1] > _LARGE else SmallGroups
        owners, owner = np.unique(np.searchsorted(firsts, cells, side="right") - 1, return_inverse=True)
        of_cells = [chunks[k] for k in owners.tolist()]
        starts = np.cumsum([0, *(chunk.white.stop - chunk.white.start for chunk in of_cells)])[:-1] - firsts[owners]
        at = cells + starts[owner.reshape(cells.shape)]
        parts = [through.of(of_cells)[at] for through in throughs]
        covariances = [kind.of(precision, cells, part) for part in parts]
        is_predicted = np.all([covariance.is_determined for covariance in covariances], axis=0)
        residual = covariances[-1].times(pull[cells][:, :, None])[:, :, 0]
        scale = 1 / np.sqrt(precision.rows[cells, precision.place[cells]])
        result.values[rows[cells], columns[cells]] = residual
        result.std[rows[cells], columns[cells]] = np.sqrt(covariances[0].variances)
        readings = np.split(np.arange(cells.shape[1]), np.flatnonzero(np.diff(rows[cells[0]])) + 1)
        for of_row in readings:
            unit = scale[:, of_row]
            white = residual[:, of_row] / unit
            covariance = covariances[0].block(of_row) / (unit[:, :, None] * unit[:, None])
            inverse = np.linalg.pinv(covariance, rcond=1e-9, hermitian=True)
            row_numbers = rows[cells[:, of_row[0]]]
            result.distance[row_numbers] = np.maximum(np.einsum("gi,gij,gj->g", white, inverse, white), 0.0)
            result.is_predicted[row_numbers] = is_predicted
        # of u and v, left out and white, the covariance is V_u V_vᵀ: the sum of its squares over all pairs is that of ΣVᵀV
        through, spread = parts[0][is_predicted], covariances[0].times(parts[0])[is_predicted]
        size, weight = cells.shape[1], len(readings)
        back = spread.swapaxes(1, 2)
        products = back @ through if kind is LargeGroup else through @ back
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
        at_once = 1 if len(same[0]) > _LARGE else max(_CELLS // len(same[0]), 1)
        yield from (np.array(same[k : k + at_once]) for k in range(0, len(same), at_once))


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


def _visit_numbers(problem: Problem) -> NDArray[np.intp]:
    """Return whether a reading was taken at the first visit of its pose, 0, at the second, and so on, ``(P,)``; -1 for none."""
    number = np.full(len(problem.readings), -1)
    for rows in map(list, problem.stations):
        number[rows] = np.unique(problem.visit[rows], return_inverse=True)[1]
    return number


def _suspect_joint(problem: Problem, fit: Fit) -> tuple[str, float]:
    """Return the joint whose error explains residuals best, and the ratio of its squares to the expected ones."""
    count, pull, (through, *_) = (
        len(problem.model.chain.joints),
        problem.precision_times(fit.residuals),
        fit.throughs(problem),
    )
    values, expected = np.zeros((2, count))
    by_error, by_joint = problem.evaluation.by_error(fit.nuisances), np.zeros((*problem.readings.shape, count))
    for station, places in zip(problem.each_station(), problem.places, strict=True):
        by_joint[places] = by_error[places] @ station.at.posture.joint_jacobian
    visits = _visit_numbers(problem)
    for chunk in problem.chunks:
        leverage, of_chunk, visit_numbers = through.of([chunk]), by_joint[chunk.rows], visits[chunk.rows, None, None]
        starts = np.flatnonzero(np.diff(chunk.noise.precision.station, prepend=-1))
        for visit in range(visit_numbers.max() + 1):
            of_visit = np.where(visit_numbers == visit, of_chunk, 0.0)
            along, white = problem.flat(chunk, of_visit), chunk.noise.whiten(of_visit)
            values += (np.add.reduceat(along * pull[chunk.white, None], starts) ** 2).sum(axis=0)
            expected += (white**2).sum(axis=0)
            for joint in range(count):
                expected[joint] -= (np.add.reduceat(along[:, joint, None] * leverage, starts) ** 2).sum()
    ratio = values / np.where(expected > 0, expected, np.inf)
    suspect = int(np.argmax(ratio))
    return problem.model.chain.joint_names[suspect], float(ratio[suspect])
