"""What residuals tell: the standard deviation of the instrument, and whether a calibration helps.

The standard deviation is estimated by restricted maximum likelihood. Readings are ``y = H z + N n + e`` with z of unit
covariance (the sheet), n without prior, and e of covariance ``σ² D² + F``: D are deviations as stated, F what numbers of scope
visit and pose cause. What N could explain is left out of the likelihood (Patterson and Thompson 1971). Differences of readings
at one pose hold no error of the model: where there are enough of them they decide alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, NamedTuple, final

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray
from scipy import sparse, spatial, stats

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import NEGLIGIBLE, Estimator
from precision_pin.analyses.calibration.fit import STEPS, Fit, LeftOut, Problem, leave_out, probability
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.record import Keys, Record
from precision_pin.statistics import clopper_pearson

LEVEL: Final = 0.95
"""Probability of the intervals, and of the ellipsoids that left-out readings should be within."""
ENOUGH: Final = 10
"""Degrees of freedom of differences at one pose from which they decide alone: the interval is then from 0.7 to 1.75 of it."""
_MOST: Final = 0.1
"""Share of the spread of the poses beyond which an estimated std shows that the data are not of this arm."""
_DECADES: Final = 5.0
"""Range of the search below the largest deviation."""
_STEPS: Final = 41
_REACH: Final = float(stats.chi2.ppf(LEVEL, 1))


@final
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


@final
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
    point, ends = largest_likelihood(whole, most)
    free, source = whole.information(point), ["all readings"] * len(kinds)
    of_all = point.copy()
    if repeats:
        pure = Likelihood(repeats, 0)
        own_point, own_ends = largest_likelihood(pure, most)
        own_free = pure.information(own_point)
        for kind in range(len(kinds)):
            if own_free[kind] >= ENOUGH:
                point[kind], ends[kind], free[kind] = own_point[kind], own_ends[kind], own_free[kind]
                source[kind] = "repeats"
    result = {}
    for k, (name, mask) in enumerate(kinds.items()):
        rows = [row for station in problem.stations for row in station.rows]
        stated = float(np.sqrt((problem.deviations[rows][mask[rows]] ** 2).mean()))
        low, high = (stated * float(np.exp(end)) for end in ends[k])
        std, every = (stated * float(np.exp(value[k])) for value in (point, of_all))
        result[name] = (std / stated, EstimatedStd(std, (low, high), float(free[k]), source[k], every))  # type: ignore[arg-type]
    return result


def _blocks(
    problem: Problem, z: Array, nuisances: Array, masks: list[NDArray[np.bool_]], *, has_prior: bool
) -> tuple[list[tuple[Array, Array, Array]], int]:
    """Return the blocks of :class:`Likelihood`, and the number of random columns."""
    by_z, by_nuisance = problem.slopes(z, nuisances)
    estimator = Estimator.of(by_z, by_nuisance, has_prior=has_prior)
    fixed = by_nuisance if has_prior else np.hstack([by_nuisance, by_z @ estimator.kept])
    readings = problem.whiten(problem.residuals(z, nuisances)) + by_z @ z
    lengths = np.linalg.norm(fixed, axis=0)
    basis, values, _ = np.linalg.svd(fixed / np.where(lengths > 0, lengths, 1.0), full_matrices=False)
    basis = basis[:, : int((values > NEGLIGIBLE * values.max(initial=0.0)).sum())]
    random = by_z if has_prior else by_z[:, :0]
    white, blocks = np.hstack([random, basis, readings[:, None]]), []
    for station, places, span, root in zip(problem.stations, problem.places, problem.spans, problem.roots, strict=True):
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
    if not len(change):
        return None
    return change @ fixed @ change.T, change @ each @ change.T, change @ columns[:, -1:]


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
        return probability(chi_square, degrees)
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


def refuse_noise(problem: Problem, found: EstimatedStd, file: str) -> None:
    """Refuse readings that are no readings of this arm, by a std near the size of the space they are in."""
    points = np.array([station.at.posture.pose[:3, 3] for station in problem.stations])
    spread = float(np.sqrt(((points - points.mean(axis=0)) ** 2).mean()))
    if found.std > _MOST * spread:
        message = (
            f"the std of the readings is estimated as {1e3 * found.std:.3g} mm, where the tip itself spreads by "
            f"{1e3 * spread:.3g} mm: columns or units are wrong, the target is another or the base is not known"
        )
        raise InputError.of("E_DATA", message, file or None)


FEWEST: Final = 4
"""Groups below which nothing is said of the improvement."""
_SAME_POSE: Final = (1e-3, 1e-4)
"""Difference of joint values (rad, m) up to which two poses are the same: they are left out together."""
_SETTLED: Final = 1e-9
SURE: Final = 1e9
"""Degrees of freedom of a standard deviation that is known."""
_TOLD: Final = 1.5
"""How many times too small deviations may be that are called honest."""


@final
@dataclass(frozen=True)
class LeftOutShare(Record):
    """How far off left-out readings are against their own covariance, and the share of them within its 95 % ellipsoid.

    ``ratio`` is the root mean square of their sizes in standard deviations, 1 where these are right, with the chi-square
    interval; the share has that of Clopper and Pearson; both for as many independent trials as the groups are worth. The
    ratio gives the verdict: ``honest`` where its interval holds 1, ``undecided`` where it passes 1.5 too.
    """

    KEYS: ClassVar[Keys] = ("verdict", "ratio", "ratio_interval", "within", "interval", "probability")
    probability: ClassVar[float] = LEVEL

    ratio: float
    ratio_interval: tuple[float, float]
    within: float
    interval: tuple[float, float]

    @classmethod
    def of(cls, squares: Array, sizes: NDArray[np.intp], trials: float, known: float = SURE) -> LeftOutShare:
        """Return that of readings ``(P,)`` of so many numbers and squared sizes, worth so many independent trials.

        ``known`` are the degrees of freedom that the standard deviation rests on.
        """
        within = float((squares <= stats.chi2.ppf(LEVEL, sizes)).mean())
        ratio, free = float((squares / sizes).mean()), trials * float(sizes.mean())
        ends = [ratio / float(stats.f.isf(side, free, known)) for side in ((1 - LEVEL) / 2, (1 + LEVEL) / 2)]
        low, high = np.sqrt(ends).tolist()
        return cls(float(np.sqrt(ratio)), (low, high), within, clopper_pearson(within * trials, trials, LEVEL))

    @property
    def verdict(self) -> Literal["over-confident", "honest", "over-cautious", "undecided"]:
        """Whether the deviations are too small, or too large, or too few poses tell."""
        low, high = self.ratio_interval
        if low > 1:
            return "over-confident"
        if high < 1:
            return "over-cautious"
        return "honest" if high <= _TOLD else "undecided"


@final
@dataclass(frozen=True)
class Improvement(Record):
    """Root mean square lengths (m) of left-out readings by base and target alone, and by the calibrated arm.

    Attributes:
        before, after: Of readings left out of the fit of base and target alone, the arm at the sheet's means; and of
            the calibration.
        interval: 95 % interval of the gain, ``before - after``, at a pose drawn as those measured were; ``None`` of too
            few groups.
        residual_before: Of readings in the fit of base and target alone.
        groups, grouped_by, readings: Groups that are left out one after another, ``poses`` or ``groups`` of the data's
            column, and their readings.
        share: How far off they are against their deviations, and how many lie within.
    """

    KEYS: ClassVar[Keys] = (
        *("verdict", "before", "after", "gain", "interval", "probability", "residual_before", "groups", "grouped_by"),
        *("readings", "share"),
    )
    probability: ClassVar[float] = LEVEL

    before: float
    after: float
    interval: tuple[float, float] | None
    residual_before: float
    groups: int
    grouped_by: Literal["poses", "groups"]
    readings: int
    share: LeftOutShare

    @property
    def gain(self) -> float:
        """What the calibration takes off, m."""
        return self.before - self.after

    @property
    def verdict(self) -> Literal["helps", "not shown to help", "makes unseen poses worse"]:
        """Whether the interval of the gain is above zero, or below."""
        if self.interval is not None and self.interval[1] < 0:
            return "makes unseen poses worse"
        return "helps" if self.interval is not None and self.interval[0] > 0 else "not shown to help"


class SetUpAlone(NamedTuple):
    """The fit of base and target, the arm at the sheet's means: the estimate, and the residuals ``(P, m)``."""

    nuisances: Array
    residuals: Array
    estimator: Estimator

    @classmethod
    def of(cls, problem: Problem) -> SetUpAlone:
        """Return the fit to the readings of a problem."""
        means = problem.model.space.mean[:, None]
        errors = [station.at.exact(means) for station in problem.stations]
        nuisances = problem.start
        for _ in range(STEPS):
            residuals = problem.residuals_of(errors, nuisances)
            slopes = np.zeros((*problem.readings.shape, nuisances.size))
            for station, places, error in zip(problem.stations, problem.places, errors, strict=True):
                slopes[places] = problem.slopes_at(station, error[:, 0], nuisances).nuisances
            by_nuisance, white = problem.whiten(slopes), problem.whiten(residuals)
            nothing = np.zeros((len(by_nuisance), 0))
            estimator = Estimator.of(nothing, by_nuisance, has_prior=False, kept=np.zeros((0, 0)))
            step = estimator.nuisances(white)
            if np.abs(by_nuisance @ step).max(initial=0.0) < _SETTLED * (1 + np.abs(white).max()):
                break
            nuisances = nuisances + step
        return cls(nuisances, residuals, estimator)


def groups_of(data: CalibrationData, sliding: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the number of the group of each reading, ``(P,)``: the data's own, or one for readings at the same pose."""
    if data.group.size:
        return np.unique(data.group, return_inverse=True)[1].astype(np.intp)
    scaled = data.q.T / np.where(sliding, _SAME_POSE[1], _SAME_POSE[0])
    pairs = spatial.cKDTree(scaled).query_pairs(1.0, p=np.inf, output_type="ndarray")
    near = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(data), len(data)))
    return sparse.csgraph.connected_components(near, directed=False)[1].astype(np.intp)


def judge(
    problem: Problem,
    best: Fit,
    after: LeftOut,
    alone: SetUpAlone,
    groups: NDArray[np.intp],
    *,
    of_column: bool,
    known: float = SURE,
) -> Improvement | None:
    """Return how a fit does on the groups left out of it; ``None`` where no group's readings follow from the others.

    ``known`` are the degrees of freedom that the standard deviation rests on, apart from these readings.
    """
    residuals = alone.residuals
    before = leave_out(problem, alone.estimator, alone.estimator, residuals, groups)
    used = np.flatnonzero(before.is_predicted & after.is_predicted)
    if not used.size:
        return None
    _, group = np.unique(groups[used], return_inverse=True)
    sizes = np.bincount(group)
    squares = [
        np.bincount(group, (one[used, :3] ** 2).sum(axis=1)) / sizes for one in (before.values, after.values, residuals)
    ]
    weights, count = sizes / used.size, len(sizes)
    means = [float(weights @ one) for one in squares]
    interval = None
    if count >= FEWEST and means[0] > 0 and means[1] > 0:
        root = best.local.leverage_root()
        interval = gain_interval(squares[0], squares[1], weights, float((root**2).sum()) / len(root))
    share = LeftOutShare.of(after.distance[used], problem.sizes[used], min(after.trials, count), known)
    roots = [float(np.sqrt(mean)) for mean in means]
    by: Literal["poses", "groups"] = "groups" if of_column else "poses"
    return Improvement(roots[0], roots[1], interval, roots[2], count, by, int(used.size), share)


def doubt_improvement(found: Improvement | None) -> Iterator[Finding]:
    """Yield warnings where unseen poses gain nothing, or readings left out are farther off than their deviations say."""
    if found is None or found.verdict != "helps":
        gain = "" if found is None else f": {1e3 * found.before:.3g} mm rms before, {1e3 * found.after:.3g} mm after"
        verdict = "not shown to help" if found is None else found.verdict
        verb = f"{'is ' * (verdict[0] == 'n')}{verdict}"
        message = f"at poses left out the calibration {verb}{gain}; do not rely on it there"
        yield Finding("warning", "W_NO_GAIN", message)
    if found is not None and found.share.verdict == "over-confident":
        low, high = found.share.ratio_interval
        message = (
            f"over-confident: left-out readings are {found.share.ratio:.3g} times ({low:.3g} to {high:.3g}) as far off as their "
            f"standard deviations say, {100 * found.share.within:.3g} % within their 95 %; the errors left are larger than stated"
        )
        yield Finding("warning", "W_OVER_CONFIDENT", message)


def gain_interval(before: Array, after: Array, weights: Array, taken: float) -> tuple[float, float]:
    """Return the interval of ``sqrt(weights @ before) - sqrt(weights @ after)`` over groups with mean squares ``(G,)``.

    Student's t from what each group adds, first order, with as many degrees of freedom as groups less the fraction ``taken``
    by the fit. Groups left out in turn share the rest, so the deviation is a tenth larger (measured by coverage); where
    little is gained both fits follow the same noise, and it is up to twice as large.
    """
    mean, left, count = float(weights @ before), float(weights @ after), len(weights)
    adds = weights * ((before - mean) / (2 * np.sqrt(mean)) - (after - left) / (2 * np.sqrt(left)))
    free = max(count * (1 - taken) - 1, 1.0)
    widened = 1.2 + 2.8 * min(left / mean, mean / left) ** 4
    deviation = np.sqrt(widened * count / free * float((adds**2).sum()))
    gain, reach = float(np.sqrt(mean) - np.sqrt(left)), float(stats.t.isf((1 - LEVEL) / 2, free) * deviation)
    return gain - reach, gain + reach
