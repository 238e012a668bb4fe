"""The fit of the exact model to readings: Gauss-Newton steps within bounds, and what to doubt after it.

It minimises ``|R^(-1/2) (y - h(q; x, n))|² + |z|²`` over z, with ``x = μ + L z``, and the nuisances n; without a prior only
the first part, over the combinations of z that the readings determine. Derivatives are those of the displaced chain at the
current estimate. The noise R is that at the means.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, final

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray
from scipy import stats

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import Estimator, Station, UnitNumbers
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.draw import Scope
from precision_pin.draws.estimates import bounds_of
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.sheet.measurement import Measurement

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
    """Readings ``(P, m)`` to fit, as :meth:`Measurement.predict` returns them, their deviations, and first nuisances ``(k,)``."""

    model: ErrorModel
    measurement: Measurement
    stations: tuple[Station, ...]
    readings: Array
    deviations: Array
    start: Array

    @cached_property
    def unit(self) -> UnitNumbers:
        """The model's numbers drawn once for each robot."""
        return UnitNumbers.of(self.model.space)

    @cached_property
    def roots(self) -> tuple[Array, ...]:
        """Lower root of the noise of each station's readings."""
        roots: list[Array] = []
        for station in self.stations:
            slopes = self.measurement.slopes(station.at.posture.pose, station.at.error_at_means, self.start)
            roots.append(station.noise_root(slopes.error, self.deviations[list(station.rows)] ** 2))
        return tuple(roots)

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

    def slopes(self, z: Array, nuisances: Array, *, plain: bool = False) -> tuple[Array, Array]:
        """Return whitened derivatives of the readings by z (plain: by each number over its prior std) and by the nuisances."""
        root = np.diag(self.unit.std) if plain else self.unit.root
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

    def reading_deviations(self, best: Fit) -> Array:
        """Return the standard deviation of a new reading at each pose about its prediction by a fit, ``(P, m)``."""
        estimator, result, first = best.estimator, np.zeros_like(self.readings), 0
        is_whole = len(estimator.by_z) == self.readings.size
        white = (estimator.by_z, estimator.by_nuisance) if is_whole else self.slopes(best.z, best.nuisances)
        for station, root in zip(self.stations, self.roots, strict=True):
            own = root @ np.hstack([part[first : first + len(root)] for part in white])
            first += len(root)
            variances = (root**2).sum(axis=1) + np.einsum("ij,jk,ik->i", own, estimator.joint_covariance, own)
            result[list(station.rows)] = np.sqrt(variances).reshape(len(station.rows), -1)
        return result


@final
@dataclass(frozen=True, eq=False)
class LeftOut:
    """Readings less the prediction of a fit without their group, first order.

    Attributes
    ----------
    values, std
        The difference and its standard deviation, what is left of the arm and set-up with the reading's noise, ``(P, m)``.
    distance
        Its size in units of its standard deviation, squared, ``(P,)``: chi-square of m degrees.
    is_predicted
        Whether the other groups determine the prediction, ``(P,)``.
    """

    values: Array
    std: Array
    distance: Array
    is_predicted: NDArray[np.bool_]


@final
@dataclass(frozen=True, eq=False)
class Fit:
    """An estimate.

    Attributes
    ----------
    z, nuisances, without_bounds
        The estimate, ``(r,)`` and ``(k,)``; z where no law had bounds, first order.
    estimator, chi_square, degrees_of_freedom
        Derivatives there, sum of squares of whitened residuals (with a prior, and of z), and its expectation.
    residuals, left_out
        Reading less prediction, ``(P, m)``; less that of a fit without it.
    local
        The estimator without the numbers that stop at a bound.
    steps, at_bounds
        Gauss-Newton steps, and names of the numbers at a bound of their law.
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
    at_bounds: tuple[str, ...] = ()
    local = estimator
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
    size, shape = problem.readings.shape[1], residuals.shape
    inverse = scipy.sparse.block_diag(
        [scipy.linalg.solve_triangular(root, np.eye(len(root)), lower=True) for root in problem.roots], format="csr"
    )
    pull, noise = inverse.T @ problem.whiten(residuals), (inverse.T @ inverse).tocsr()
    throughs = [inverse.T @ one.leverage_root() for one in (estimator, *([] if local is estimator else [local]))]
    rows = np.array([row for station in problem.stations for row in station.rows])
    found = LeftOut(np.zeros(shape), np.zeros(shape), np.zeros(len(residuals)), np.zeros(len(residuals), dtype=bool))
    for group in np.unique(groups[rows]):
        own = np.flatnonzero(groups[rows] == group)
        places = (own[:, None] * size + np.arange(size)).ravel()
        block = noise[places][:, places].toarray()
        covariances, seen = zip(*(_of_group(block, through[places]) for through in throughs), strict=True)
        scale = 1 / np.sqrt(np.diag(block))
        for k, (row, left) in enumerate(
            zip(rows[own], (covariances[-1] @ pull[places]).reshape(-1, size), strict=True)
        ):
            mine = slice(k * size, (k + 1) * size)
            covariance, unit = covariances[0][mine, mine], scale[mine]
            found.values[row], found.std[row] = left, np.sqrt(np.diag(covariance))
            weighed = np.linalg.pinv(covariance / np.outer(unit, unit), rcond=1e-9, hermitian=True)
            found.distance[row] = max(float((left / unit) @ weighed @ (left / unit)), 0.0)
            found.is_predicted[row] = all(seen)
    return found


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

FARTHEST: Final = 50.0
"""Root mean square of the readings' distances, in standard deviations, beyond which data are refused."""


def probability(chi_square: float, degrees: int) -> float:
    """Return the probability that a right model gives a larger chi-square; 1 without degrees of freedom."""
    return float(stats.chi2.sf(chi_square, degrees)) if degrees > 0 else 1.0


def refuse_far_readings(problem: Problem, data: CalibrationData) -> None:
    """Refuse readings that no robot within the tolerances, by far, can have given: columns are swapped, or units."""
    z = np.zeros(problem.unit.root.shape[1])
    values = problem.residuals(z, problem.start)
    estimator = Estimator.of(*problem.slopes(z, problem.start), has_prior=True)
    hold = estimator.hold()
    white = problem.whiten(values)
    nuisances = estimator.nuisances(white)
    left = white - estimator.by_nuisance @ nuisances
    squared = float(left @ hold @ left) / max(len(left), 1)
    if squared <= FARTHEST**2:
        return
    far = float(np.median(np.linalg.norm(values[:, :3], axis=1)))
    free = " or the base is not known" if problem.measurement.base == "known" else ""
    message = (
        f"the readings are {1e3 * far:.3g} mm (median) from the nominal arm, {np.sqrt(squared):.3g} standard deviations of all "
        f"tolerances: columns or units are wrong, the target is another{free}"
    )
    raise InputError([Finding("error", "E_DATA", message, data.file or None)])


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
    values, first = np.zeros(len(problem.model.chain.joints)), 0
    expected = np.zeros_like(values)
    for station, root in zip(problem.stations, problem.roots, strict=True):
        rows = slice(first, first + len(root))
        first += len(root)
        slopes = problem.measurement.slopes(station.at.posture.pose, station.at.error_at_means, fit.nuisances)
        moved = slopes.error @ _joint_jacobian(station.at)
        size = len(moved)
        for k in range(len(station.rows)):
            own = np.zeros((len(root), moved.shape[1]))
            own[k * size : (k + 1) * size] = moved
            along = np.linalg.solve(root, own)
            values += (along.T @ white[rows]) ** 2
            expected += np.einsum("ij,ik,kj->j", along, hold[rows, rows], along)
    ratio = values / np.where(expected > 0, expected, np.inf)
    best = int(np.argmax(ratio))
    return problem.model.chain.joint_names[best], float(ratio[best])


def _joint_jacobian(at: PoseModel) -> Array:
    result: Array = at.posture.chain.at_columns(at.posture.q[:, None]).joint_jacobian[:, :, 0]
    return result
