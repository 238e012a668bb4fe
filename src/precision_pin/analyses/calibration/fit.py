"""The fit of the exact model to readings: Gauss-Newton steps within bounds, and what to doubt after it.

It minimises ``|R^(-1/2) (y - h(q; x, n))|² + |z|²`` over z, with ``x = μ + L z``, and the nuisances n; without a prior only
the first part, over the combinations of z that the readings determine. Derivatives are those of the displaced chain at the
current estimate. The noise R is that at the means.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final, NamedTuple, final

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray
from scipy import stats

from precision_pin.analyses.calibration.data import CalibrationData, describe_zeros, refuse_reversed
from precision_pin.analyses.calibration.design import Estimator, Station, UnitNumbers, stations_of
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.record import Record
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import bounds_of
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
        anchor = placed = plane = sockets = None
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
    return np.asarray(centre + found[:3])


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


STEPS: Final = 60
_SETTLED: Final = 1e-8
"""Largest change of z, and of whitened nuisances, at which the estimate has settled."""
_SMALL: Final = 1e-5
"""Change of z below which the derivatives of the last step serve for the next ones: they cost more than residuals."""
_HALVINGS: Final = 30
_ALONE: Final = 1e-9
"""Share of a group's readings that the others leave free, below which the group alone determines something."""


@final
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
    def places(self) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], ...]:
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
        roots: list[Array] = []
        for station, places in zip(self.stations, self.places, strict=True):
            slopes = self.slopes_at(station, station.at.error_at_means, self.start)
            roots.append(station.noise_root(slopes.error, self.deviations[places] ** 2, self.visit[places[0]]))
        return tuple(roots)

    def slopes_at(self, station: Station, error: Array, nuisances: Array) -> Slopes:
        """Return the derivatives of all numbers read at a station, ``(M, 6)`` and ``(M, k)``, where the tip's error is given."""
        parts = self.part[list(station.rows)].tolist()
        pose = station.at.posture.pose
        found = {part: self.instruments.slopes(part, pose, error, nuisances) for part in dict.fromkeys(parts)}
        return Slopes(
            np.concatenate([found[part].error for part in parts]),
            np.concatenate([found[part].nuisances for part in parts]),
        )

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

    def without(self, rows: Collection[int]) -> Problem:
        """Return the problem without some readings, which keep their places in the arrays."""
        kept = (Station(one.at, tuple(row for row in one.rows if row not in rows)) for one in self.stations)
        return replace(self, stations=tuple(station for station in kept if station.rows))

    def residuals(self, z: Array, nuisances: Array) -> Array:
        """Return readings less predictions, ``(P, m)``."""
        x = self.unit.components(self.model.space, z[:, None])
        return self.residuals_of([station.at.exact(x) for station in self.stations], nuisances)

    def residuals_of(self, errors: Sequence[Array], nuisances: Array) -> Array:
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
        parts = []
        for places, root in zip(self.places, self.roots, strict=True):
            own = values[places]
            parts.append(scipy.linalg.solve_triangular(root, own.reshape(root.shape[0], -1), lower=True))
        stacked = np.concatenate(parts)
        return stacked[:, 0] if values.ndim == 2 else stacked

    def slopes(self, z: Array, nuisances: Array, *, plain: bool = False) -> tuple[Array, Array]:
        """Return whitened derivatives of the readings by z (plain: by each number over its prior std) and by the nuisances."""
        root = np.diag(self.unit.std) if plain else self.unit.root
        x = self.unit.components(self.model.space, z[:, None])[:, 0]
        size = root.shape[1]
        whole = np.zeros((*self.readings.shape, size + nuisances.size))
        for station, places in zip(self.stations, self.places, strict=True):
            error, jacobian = station.at.tangent_at(x)
            found = self.slopes_at(station, error, nuisances)
            whole[places] = np.hstack([found.error @ jacobian[:, self.unit.columns] @ root, found.nuisances])
        white = self.whiten(whole)
        return white[:, :size], white[:, size:]

    def reading_deviations(self, best: Fit) -> Array:
        """Return the standard deviation of a new reading at each pose about its prediction by a fit, ``(P, m)``."""
        estimator, result = best.estimator, np.zeros_like(self.readings)
        is_whole = len(estimator.by_z) == self.spans[-1].stop
        white = (estimator.by_z, estimator.by_nuisance) if is_whole else self.slopes(best.z, best.nuisances)
        for places, span, root in zip(self.places, self.spans, self.roots, strict=True):
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


def fit(problem: Problem, *, has_prior: bool, steps: int = STEPS) -> Fit:
    """Return the estimate of a problem, after a number of steps or when it has settled; refuse one that does not."""
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
        better = estimator.estimate(target, *problem.bounds)
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
    residuals = problem.residuals(z, nuisances)
    estimated = estimator.nuisance_rank + (0 if has_prior else estimator.kept.shape[1])
    at_bounds, local = tuple[str, ...](), estimator
    if has_prior and problem.unit.is_independent:
        low, high = problem.bounds
        held = (z <= low) | (z >= high)
        at_bounds = tuple(name for name, is_held in zip(problem.unit.names, held, strict=True) if is_held)
        if at_bounds:  # what stops at a bound does not follow the readings
            local = Estimator.of(estimator.by_z[:, ~held], estimator.by_nuisance, has_prior=True)
    return Fit(
        z,
        nuisances,
        estimator.estimate(white + estimator.by_z @ z) if at_bounds else z,
        estimator,
        _cost(white, z, has_prior),
        len(white) - estimated,
        residuals,
        local,
        leave_out(problem, estimator, local, residuals, np.arange(len(residuals))),
        steps,
        at_bounds,
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
    found = LeftOut(
        np.zeros(shape), np.zeros(shape), np.zeros(len(residuals)), np.zeros(len(residuals), dtype=bool), 0.0
    )
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

_TRIED_STEPS: Final = 8
"""Steps of a fit that only shows whether far readings can be explained at all."""
FARTHEST: Final = 50.0
"""Root mean square of the readings' distances, in standard deviations, beyond which data are refused."""
ODD: Final = 5.0
"""The same beyond which another unit of the joint values is tried."""
_BETTER: Final = 5.0
"""How many times smaller distances must be for a unit to be called wrong."""


def probability(chi_square: float, degrees: int) -> float:
    """Return the probability that a right model gives a larger chi-square; 1 without degrees of freedom."""
    return float(stats.chi2.sf(chi_square, degrees)) if degrees > 0 else 1.0


def refuse_far_readings(problem: Problem, data: CalibrationData) -> None:
    """Refuse readings that no robot within the tolerances, by far, can have given: columns are swapped, or units."""
    z = np.zeros(problem.unit.root.shape[1])
    estimator = Estimator.of(*problem.slopes(z, problem.start), has_prior=True)
    values = problem.residuals(z, problem.start)
    white = problem.whiten(values)
    left = white - estimator.by_nuisance @ estimator.nuisances(white)
    far = float(np.sqrt(np.maximum(left @ estimator.hold() @ left, 0.0) / max(len(left), 1)))
    if far > ODD:
        _refuse_other_unit(problem.model, data)
    is_one = len(data.measurements) == 1
    zeros = refuse_reversed(problem.model.chain, data, data.measurements[0]) if is_one else None
    if far <= FARTHEST or _settles(problem):
        return
    median = float(np.median(np.linalg.norm(values[:, :3], axis=1)))
    free = " or the base is not known" if any(part.base == "known" for part in problem.instruments.parts) else ""
    message = (
        f"the readings are {1e3 * median:.3g} mm (median) from the nominal arm, "
        f"{far:.3g} standard deviations of all tolerances: columns or units are wrong, the target is another{free}"
    )
    if zeros is not None and zeros.rms < median / 10:
        message += (
            f"; zeros of the joints alone would explain them to {1e3 * zeros.rms:.3g} mm rms "
            f"({describe_zeros(problem.model.chain, zeros)}): give the zeros of joints wide tolerances"
        )
    raise InputError.of("E_DATA", message, data.file or None)


def _settles(problem: Problem) -> bool:
    """Return whether a few steps of the exact model explain readings that its tangent at the means does not."""
    try:
        found = fit(problem, has_prior=True, steps=_TRIED_STEPS)
    except InputError:
        return False
    return found.chi_square <= FARTHEST**2 * found.residuals.size


def _refuse_other_unit(model: ErrorModel, data: CalibrationData) -> None:
    """Refuse joint values that fit far better in degrees than in radians or the other way, all of them or those of one joint."""
    turning = ~model.chain.prismatic
    each = [turning, *(row.astype(bool) for row in np.eye(len(turning))[turning])]
    found: list[tuple[float, bool, str]] = [(np.inf, False, "")]
    before = nominal_distance(model.chain, data)
    for is_other in each:
        for factor in (180 / np.pi, np.pi / 180):
            scaled = data.q * np.where(is_other, factor, 1.0)[:, None]
            try:
                distance = nominal_distance(model.chain, replace(data, q=scaled))
            except InputError:
                continue
            joints = ", ".join(name for name, is_one in zip(model.chain.joint_names, is_other, strict=True) if is_one)
            found.append((distance, factor > 1, joints))
    distance, is_small, joints = min(found, key=lambda one: one[0])
    if distance < before / _BETTER:
        units = ("radians", "degrees") if is_small else ("degrees", "radians")
        message = (
            f"the readings fit {before / distance:.3g} times better if the values of {joints} are {units[0]}, not {units[1]} "
            "(a factor of 57.3): correct their unit"
        )
        raise InputError.of("E_DATA", message, data.file or None)


def doubt_model(problem: Problem, fit: Fit, chance: float | None, *, has_prior: bool) -> Iterator[Finding]:
    """Yield what to doubt where the model does not explain the readings; ``chance`` is ``None`` where that is not tested."""
    facts = f"chi-square {fit.chi_square:.4g} for {fit.degrees_of_freedom} degrees of freedom"
    if has_prior:
        yield from _pulled(problem, fit)
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


def _pulled(problem: Problem, fit: Fit) -> Iterator[Finding]:
    """Yield a warning for numbers farther from their means than their tolerances make likely."""
    if not problem.unit.is_independent:
        return
    expected = np.maximum(1 - np.diag(fit.estimator.covariance), 1e-12)
    ratio = np.where(expected > 1e-6, np.abs(fit.z) / np.sqrt(expected), 0.0)
    limit = float(stats.norm.isf(DOUBTFUL / 2 / len(ratio)))
    for k in np.argsort(-ratio, kind="stable")[:3]:
        if ratio[k] > limit:
            message = (
                f"{problem.unit.names[k]} is estimated {fit.z[k]:+.3g} standard deviations from its mean; "
                "doubt its tolerance, or an error that acts like it"
            )
            yield Finding("warning", "W_TOLERANCE", message)


def _suspect_joint(problem: Problem, fit: Fit) -> tuple[str, float]:
    """Return the joint whose own error explains residuals best, and by how much its squares exceed those expected."""
    white = problem.whiten(problem.residuals(fit.z, fit.nuisances))
    hold = fit.estimator.hold()
    values, expected = np.zeros((2, len(problem.model.chain.joints)))
    parts = zip(problem.stations, problem.places, problem.spans, problem.roots, strict=True)
    for station, places, rows, root in parts:
        posture = station.at.posture
        by_joints = posture.chain.at_columns(posture.q[:, None]).joint_jacobian[:, :, 0]
        moved = problem.slopes_at(station, station.at.error_at_means, fit.nuisances).error @ by_joints
        for visit in np.unique(problem.visit[places[0]]):
            own = np.where((problem.visit[places[0]] == visit)[:, None], moved, 0.0)
            along = np.linalg.solve(root, own)
            values += (along.T @ white[rows]) ** 2
            expected += np.einsum("ij,ik,kj->j", along, hold[rows, rows], along)
    ratio = values / np.where(expected > 0, expected, np.inf)
    best = int(np.argmax(ratio))
    return problem.model.chain.joint_names[best], float(ratio[best])
