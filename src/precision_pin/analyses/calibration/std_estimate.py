"""Estimates of the instrument's standard deviation from readings, by restricted maximum likelihood.

Readings are ``y = H z + N n + e`` with z of unit covariance (the sheet), n without prior, and e of covariance ``σ² D² + F``: D
are deviations as stated, F what numbers of scope visit and pose cause. What N could explain is left out of the likelihood
(Patterson and Thompson 1971). Differences of readings at one pose hold no error of the model: where there are enough of them
they decide alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray
from scipy import stats

from precision_pin.analyses.calibration.design import Estimator, basis_by_columns
from precision_pin.analyses.calibration.fit import Problem
from precision_pin.analyses.calibration.noise import LEVEL, Reduction
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError

ENOUGH: Final = 10
"""Degrees of freedom from which differences at one pose decide alone: the interval is then 0.7 to 1.75 times the std."""
_DECADES: Final = 5.0
"""Range of the search below the largest deviation."""
_STEPS: Final = 41
"""Grid points of that range, from which the search is refined between neighbours."""
_REACH: Final = float(stats.chi2.ppf(LEVEL, 1))
"""Rise of -2 ln L from its minimum to the ends of a profile interval."""


@dataclass(frozen=True)
class EstimatedStd(Record):
    """A standard deviation estimated from readings, with the 95 % interval of its profile likelihood, m or rad.

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


StdBlock = tuple[Array, Array, Array]
"""F, D² of each kind, and columns of some numbers, as of :class:`Likelihood`."""


class Likelihood:
    """-2 ln of the restricted likelihood of factors, one for each kind of deviation.

    ``blocks`` are for each station F ``(b, b)``, D² of each kind ``(g, b, b)`` and columns ``[H, N, y]``, ``(b, r + k + 1)``, of
    which the first ``random`` are H. The columns of N are independent. ``empty`` ``(g,)`` are further numbers of each kind, whose
    columns are zero.
    """

    def __init__(self, blocks: list[StdBlock], random: int, empty: Array | None = None) -> None:
        sizes = sorted({len(block[0]) for block in blocks})
        self._stacks = [
            tuple(np.array(part) for part in zip(*(block for block in blocks if len(block[0]) == size), strict=True))
            for size in sizes
        ]
        width = blocks[0][2].shape[1]
        self._prior = np.eye(random, width)
        self.kinds = len(blocks[0][1])
        self._empty = np.zeros(self.kinds) if empty is None else empty

    def _white(self, logs: Array) -> list[tuple[Array, Array]]:
        """Return the roots of the noise and the columns over them, for each size of block."""
        white = []
        for fixed_noise, per_kind, columns in self._stacks:
            root = np.linalg.cholesky(fixed_noise + np.einsum("g,sgij->sij", np.exp(2 * logs), per_kind))
            white.append((root, np.linalg.solve(root, columns)))
        return white

    def __call__(self, logs: Array) -> float:
        """Return its value at logarithms of the factors, ``(g,)``; infinity where the noise is singular."""
        try:
            white = self._white(logs)
        except np.linalg.LinAlgError:
            return np.inf
        rows = [part.reshape(-1, part.shape[2]) for _, part in white]
        diagonal = np.abs(np.diag(np.linalg.qr(np.vstack([*rows, self._prior]), mode="r")))
        of_noise = sum(float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum()) for root, _ in white)
        of_noise += float(self._empty @ logs)
        return 2 * of_noise + 2 * float(np.log(diagonal[:-1]).sum()) + float(diagonal[-1] ** 2)

    def information(self, logs: Array) -> Array:
        """Return the degrees of freedom of each kind, ``(g,)``: twice the information on ln σ² of that kind."""
        white = self._white(logs)
        rows = [part.reshape(-1, part.shape[2]) for _, part in white]
        basis = np.linalg.qr(np.vstack([*rows, self._prior])[:, :-1])[0]
        result, offset = self._empty.copy(), 0
        cross = np.zeros((self.kinds, basis.shape[1], basis.shape[1]))
        for (root, columns), (_, per_kind, _) in zip(white, self._stacks, strict=True):
            count = root.shape[0] * root.shape[1]
            block_basis = basis[offset : offset + count].reshape(*columns.shape[:2], -1)
            offset += count
            for kind, variance in enumerate(np.exp(2 * logs)):
                half_whitened = np.linalg.solve(root, per_kind[:, kind])
                scaled_noise = variance * np.linalg.solve(root, np.swapaxes(half_whitened, 1, 2))
                scaled_basis = scaled_noise @ block_basis
                result[kind] += (scaled_noise**2).sum() - 2 * (scaled_basis**2).sum()
                cross[kind] += np.einsum("sbi,sbj->ij", block_basis, scaled_basis)
        return np.asarray(result + (cross**2).sum(axis=(1, 2)), dtype=float)


def largest_likelihood(likelihood: Likelihood, maximum: float) -> tuple[Array, list[tuple[float, float]]]:
    """Return the logarithms of the likeliest factors, at most ``maximum``, and their profile intervals; -inf is zero."""
    grid = np.linspace(maximum - _DECADES * np.log(10), maximum, _STEPS)
    step = float(grid[1] - grid[0])

    def along(kind: int, other_logs: Array, floor: float) -> tuple[float, float]:
        """Return the best logarithm of one kind, and the value there."""

        def value(log: float) -> float:
            return likelihood(np.insert(other_logs, kind, log))

        coarse = float(min(grid, key=value))
        optimum = scipy.optimize.minimize_scalar(
            value, bounds=(coarse - step, coarse + step), method="bounded", options={"xatol": floor}
        )
        return float(optimum.x), float(optimum.fun)

    point = np.full(likelihood.kinds, maximum - np.log(10))
    # the two kinds hardly depend on each other: alternate; a single kind needs one search
    for _ in range(20 if likelihood.kinds > 1 else 1):
        previous = point.copy()
        for kind in range(likelihood.kinds):
            point[kind], minimum = along(kind, np.delete(point, kind), 1e-7)
        if np.abs(point - previous).max() < 1e-6:
            break
    intervals = []
    for kind in range(likelihood.kinds):

        def excess(log: float, kind: int = kind) -> float:
            other_logs = np.delete(point, kind)
            if other_logs.size:
                return along(1 - kind, np.array([log]), 1e-4)[1] - minimum - _REACH
            return likelihood(np.array([log])) - minimum - _REACH

        low, high = point[kind] - step, point[kind] + step
        while excess(float(low)) < 0 and low > grid[0]:
            low -= step
        while excess(float(high)) < 0:
            high += step
        lower = -np.inf if low <= grid[0] else float(scipy.optimize.brentq(excess, low, point[kind], xtol=1e-6))
        intervals.append((lower, float(scipy.optimize.brentq(excess, point[kind], high, xtol=1e-6))))
    return point, intervals


def estimate_std(
    problem: Problem, z: Array, nuisances: Array, kinds: Mapping[str, NDArray[np.bool_]], *, has_prior: bool
) -> dict[str, tuple[float, EstimatedStd]]:
    """Return the factor on the stated deviation, and the estimate, of each kind; ``kinds`` name masks ``(P, m)`` of numbers."""
    masks, shared = list(kinds.values()), problem.common.size
    change, random = _columns(problem, z, nuisances, has_prior=has_prior)
    repeats = [
        block
        for station, labels in zip(_stations(problem, z, nuisances, change, masks), problem.labels, strict=True)
        if np.unique(labels).size < labels.size
        for block in [_differences(station, labels, shared)]
    ]
    if any(scope.any() for scope in problem.evaluation.at_means[1].values()):
        blocks, empty = list(_stations(problem, z, nuisances, change, masks)), np.zeros(len(masks))
    else:
        blocks, empty = _reduced(problem, z, nuisances, change, masks)
    maximum = _largest(blocks, random, int(empty.sum()))
    full = Likelihood(blocks, random, empty)
    of_all, bounds = largest_likelihood(full, maximum)
    estimates = [(of_all, bounds, full.information(of_all), "all readings")] * len(kinds)
    if repeats:
        pure = Likelihood(repeats, shared)
        point, bounds = largest_likelihood(pure, maximum)
        dof = pure.information(point)
        estimates = [(point, bounds, dof, "repeats") if dof[k] >= ENOUGH else pool for k, pool in enumerate(estimates)]
    result, rows = {}, np.concatenate(problem.stations)
    for k, ((name, mask), (point, bounds, dof, source)) in enumerate(zip(kinds.items(), estimates, strict=True)):
        stated = float(np.sqrt((problem.deviations[rows][mask[rows]] ** 2).mean()))
        low, high, std, std_of_all = (stated * float(np.exp(value)) for value in (*bounds[k], point[k], of_all[k]))
        result[name] = (std / stated, EstimatedStd(std, (low, high), float(dof[k]), source, std_of_all))  # type: ignore[arg-type]
    return result


def _columns(problem: Problem, z: Array, nuisances: Array, *, has_prior: bool) -> tuple[Array, int]:
    """Return coefficients ``(c, n)`` of :meth:`Problem.columns` for those of :class:`Likelihood`, and how many are random.

    First are those of what readings share.
    """
    reduction, shared = problem.reduce(z, nuisances), problem.common.size
    set_up, by_z = reduction.nuisances, problem.by_z(reduction)
    basis = by_z.T[:, :0]
    if not has_prior:
        basis = Estimator.of(by_z, reduction.by_nuisance, has_prior=False).basis
    fixed = basis_by_columns(np.hstack([reduction.by_nuisance, by_z @ basis]))[1]
    low, high = problem.bounds
    is_free = (low < z) & (z < high)  # a number at the bound of its law does not follow the readings
    of_z = np.eye(set_up + z.size)[:, set_up:][:, is_free]
    random = of_z if has_prior else of_z[:, :0]
    others = [random, scipy.linalg.block_diag(np.eye(set_up), basis) @ fixed, of_z @ z[is_free, None]]
    change = scipy.linalg.block_diag(np.eye(shared), problem.over_numbers(np.hstack(others)))
    return np.vstack([change, np.eye(1, change.shape[1], change.shape[1] - 1)]), shared + random.shape[1]


def _stations(
    problem: Problem, z: Array, nuisances: Array, change: Array, masks: list[NDArray[np.bool_]]
) -> Iterator[StdBlock]:
    """Yield the block of each station."""
    all_places = iter(problem.places)
    for chunk, columns in problem.columns(z, nuisances):
        of_numbers, first = problem.flat(chunk, columns) @ change, 0
        for noise, places in zip(chunk.noise.covariances, all_places, strict=False):
            instrument = problem.instrument_at(places)
            per_kind = np.array([instrument * np.outer(mask[places], mask[places]) for mask in masks])
            yield noise - per_kind.sum(axis=0), per_kind, of_numbers[first : first + len(noise)]
            first += len(noise)


def _reduced(
    problem: Problem, z: Array, nuisances: Array, change: Array, masks: list[NDArray[np.bool_]]
) -> tuple[list[StdBlock], Array]:
    """Return the numbers of each kind reduced, where the instrument alone makes noise, and how many are empty then, ``(g,)``.

    White numbers of one kind have one variance, whatever the factor is, so that orthogonal factors change no likelihood.
    """
    kind_of_number = np.full(problem.readings.shape, len(masks))
    for kind, mask in enumerate(masks):
        kind_of_number[mask] = kind
    blocks, empty = list[StdBlock](), np.zeros(len(masks))
    for kind in np.unique(kind_of_number[problem.numbers]).tolist():

        def chunks(kind: int = kind) -> Iterator[Array]:
            for chunk, columns in problem.columns(z, nuisances):
                is_of_kind = problem.flat(chunk, kind_of_number[chunk.rows]) == kind
                yield chunk.noise.whiten(columns @ change)[is_of_kind]

        reduction = Reduction.of(chunks(), 0, 0)
        unit, per_kind = np.eye(len(reduction.rows)), np.zeros((len(masks), *[len(reduction.rows)] * 2))
        if kind < len(masks):
            per_kind[kind], empty[kind] = unit, reduction.size - len(unit)
        blocks.append((unit - per_kind.sum(axis=0), per_kind, reduction.rows))
    return blocks, empty


def _differences(block: StdBlock, labels: NDArray[np.intp], shared: int) -> StdBlock:
    """Return the block of the differences of equal numbers at one pose, which neither the arm nor the set-up changes.

    Of its random columns the first, ``shared``, stay.
    """
    fixed_noise, per_kind, columns = block
    rows = []
    for repeats in (np.flatnonzero(labels == label) for label in np.unique(labels)):
        contrasts = np.zeros((repeats.size - 1, labels.size))
        contrasts[:, repeats] = scipy.linalg.helmert(repeats.size)
        rows.append(contrasts)
    change = np.concatenate(rows)
    remaining = change @ np.hstack([columns[:, :shared], columns[:, -1:]])
    return change @ fixed_noise @ change.T, change @ per_kind @ change.T, remaining


def _largest(blocks: list[StdBlock], random: int, empty: int) -> float:
    """Return the logarithm of an upper bound: three times the factor that attributes all readings to noise."""
    scale = np.concatenate([np.sqrt(np.diag(per_kind.sum(axis=0))) for _, per_kind, _ in blocks])
    is_varied = scale > 0
    columns = np.concatenate([block[2] for block in blocks])[is_varied] / scale[is_varied, None]
    fixed_columns, readings = columns[:, random:-1], columns[:, -1]
    residual = readings - fixed_columns @ np.linalg.lstsq(fixed_columns, readings, rcond=None)[0]
    size = float(np.sqrt((residual**2).sum() / (len(residual) + empty)))
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
    if any(std.decided_by != "repeats" for std in noise.values()) or degrees <= repeated:
        return None
    dof = degrees - repeated
    return float(stats.f.sf((chi_square - repeated) / dof, dof, sum(std.degrees_of_freedom for std in noise.values())))


def std_warnings(noise: Mapping[str, EstimatedStd]) -> Iterator[Finding]:
    """Yield a warning where a std was estimated from residuals of the model."""
    tuned = [name for name, std in noise.items() if std.decided_by != "repeats"]
    if tuned:
        message = (
            f"{' and '.join(tuned)} estimated from the residuals of the model, on {noise[tuned[0]].degrees_of_freedom:.3g} "
            "degrees of freedom: whether the model explains the readings is not tested, and the std includes the model's own "
            "errors; repeat poses"
        )
        yield Finding("warning", "W_STD_ESTIMATED", message)
