"""Whether a calibration helps: readings left out of it, against base and target alone, and how honest their deviations are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse, spatial, stats

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import Estimator
from precision_pin.analyses.calibration.fit import STEPS, Fit, LeftOut, Problem, leave_out
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding
from precision_pin.base.record import Keys, Record
from precision_pin.statistics import clopper_pearson

LEVEL: Final = 0.95
"""Probability of the intervals, and of the ellipsoids that left-out readings should be within."""
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

    ``ratio`` is the root mean square of their sizes in standard deviations, 1 where these are right. Its interval is that of
    chi-square, that of the share Clopper's and Pearson's, both for as many trials as the groups are worth: readings of one group,
    and groups that share what a fit without them errs by, are no independent trials. The ratio gives the verdict, since it tells
    deviations that are too small sooner: ``honest`` where its interval holds 1, ``undecided`` where it goes beyond 1.5 too.
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


@final
@dataclass(frozen=True, eq=False)
class SetUpAlone:
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
    found: NDArray[np.intp] = sparse.csgraph.connected_components(near, directed=False)[1].astype(np.intp)
    return found


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
        message = (
            f"at poses left out the calibration {'is ' * (verdict[0] == 'n')}{verdict}{gain}; do not rely on it there"
        )
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

    By t from what each group adds, first order, on as many degrees of freedom as there are groups less the share ``taken`` that
    the fit takes of them. Groups left out one after another share the rest: the deviation is a tenth larger than that of
    independent groups, as coverage asks for (measured). Where little is gained both fits follow the same noise, and every pair of
    groups adds twice: it is then up to twice as large.
    """
    mean, left, count = float(weights @ before), float(weights @ after), len(weights)
    adds = weights * ((before - mean) / (2 * np.sqrt(mean)) - (after - left) / (2 * np.sqrt(left)))
    free = max(count * (1 - taken) - 1, 1.0)
    widened = 1.2 + 2.8 * min(left / mean, mean / left) ** 4
    deviation = np.sqrt(widened * count / free * float((adds**2).sum()))
    gain, reach = float(np.sqrt(mean) - np.sqrt(left)), float(stats.t.isf((1 - LEVEL) / 2, free) * deviation)
    return gain - reach, gain + reach
