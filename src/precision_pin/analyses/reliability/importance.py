"""Importance sampling from mixtures that cover the whole failure surface, checked by independently found failures.

Subset simulation: a small probability as a product of larger ones, level by level. Both, stratum by stratum, and the
choice among all methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.reliability.estimates import (
    LARGEST_UNKNOWN,
    LARGEST_VARIATION,
    Estimate,
    Verdict,
    judged,
    log_normal_interval,
    plain_estimate,
    remarks,
    skewed_interval,
    summed,
)
from precision_pin.analyses.reliability.form import (
    FARTHEST,
    LEAST,
    NEGLIGIBLE,
    DesignPoint,
    Form,
    Jump,
    Margin,
    Strata,
    Stratum,
    form,
    stratified,
    towards_surface,
)
from precision_pin.base.arrays import Array, Fixed
from precision_pin.draws.space import Space
from precision_pin.statistics import clopper_pearson

METHOD: Final = "importance sampling"


# share of the law itself in the mixture: it bounds all weights by 10
_PLAIN: Final = 0.1
# share of a centre's samples that keep to the pieces of its numbers with jumps
_PIECE_SHARE: Final = 0.5
# maximum number of design points in the mixture, nearest first
_MOST_POINTS: Final = 32
# maximum number of known failures that are moved to the surface as first centres
_CENTRES: Final = 64
# maximum number of rounds in which centres are added
_ROUNDS: Final = 6
# steps of a failure towards the surface
_STEPS: Final = 3
# expected probability from which plain samples are taken
_OFTEN: Final = 0.05
# samples evaluated together, which limits memory
_AT_ONCE: Final = 8192
# design points beyond which no normal laws are fitted to the failures about them
_MOST_CLOUDS: Final = 12
# bounds of the standard deviations of such a law
_NARROWEST: Final = 0.7
_WIDEST: Final = 3.0
# weight of the shares fitted to failures; the rest keeps every centre in use
_FITTED_SHARE: Final = 0.7


@dataclass(frozen=True, eq=False)
class _Proposal:
    """Mixture of the law itself and normal laws about centres; half of the samples keep to the pieces of their centre.

    Attributes:
        centres, widths: ``(d, C)`` means and standard deviations; 0 and 1 for numbers with jumps.
        shares, pieces: ``(C,)`` weights (the law has the rest), and ``(len(jumps), C)`` pieces of numbers with jumps.
    """

    centres: Array
    widths: Array
    shares: Array
    jumps: Sequence[Jump]
    pieces: NDArray[np.intp]

    @classmethod
    def about(cls, points: Array, widths: Array, shares: Array, jumps: Sequence[Jump]) -> _Proposal:
        """Return the mixture about points; their numbers with jumps determine the pieces."""
        centres, wide, pieces = points.copy(), widths.copy(), np.zeros((len(jumps), points.shape[1]), dtype=np.intp)
        for k, jump in enumerate(jumps):
            pieces[k] = jump.pieces(points)
            centres[jump.row], wide[jump.row] = 0.0, 1.0
        return cls(centres, wide, shares, jumps, pieces)

    def draw(self, generator: np.random.Generator, count: int) -> Array:
        plain = 1 - float(self.shares.sum())
        component = generator.choice(self.shares.size + 1, size=count, p=[*self.shares, plain])
        of_centre = component < self.shares.size
        u = generator.standard_normal((self.centres.shape[0], count))
        centre = component[of_centre]
        u[:, of_centre] = self.centres[:, centre] + self.widths[:, centre] * u[:, of_centre]
        for jump, pieces in zip(self.jumps, self.pieces, strict=True):
            is_kept = of_centre & (generator.random(count) < _PIECE_SHARE)
            u[jump.row, is_kept] = jump.scores(pieces[component[is_kept]], generator.random(int(is_kept.sum())))
        return u

    def ratios(self, u: Array) -> Array:
        """Return the density of each centre divided by that of the law, ``(C, N)``."""
        narrow = 1 / self.widths**2
        exponent = (self.centres * narrow).T @ u + ((1 - narrow) / 2).T @ u**2
        exponent -= ((self.centres**2 * narrow) / 2 + np.log(self.widths)).sum(axis=0)[:, None]
        ratios: Array = np.exp(exponent)
        for jump, pieces in zip(self.jumps, self.pieces, strict=True):
            piece, shares = jump.pieces(u), np.diff(jump.edges)
            ratios *= (1 - _PIECE_SHARE) + _PIECE_SHARE * (piece == pieces[:, None]) / shares[pieces][:, None]
        return ratios

    def density(self, u: Array) -> Array:
        """Return the density of the mixture divided by that of the law."""
        return (1 - float(self.shares.sum())) + self.shares @ self.ratios(u)

    def fit_shares(self, failures: Array) -> _Proposal:
        """Return the mixture with shares fitted to the failures by a few steps of expectation-maximisation."""
        if not failures.shape[1]:
            return self
        ratios, shares = self.ratios(failures), self.shares
        total = float(shares.sum())
        for _ in range(20):
            shares = (shares[:, None] * ratios / ((1 - total) + shares @ ratios)).mean(axis=1)
            shares = total * shares / max(float(shares.sum()), 1e-300)
        return replace(self, shares=_FITTED_SHARE * shares + (1 - _FITTED_SHARE) * self.shares)


def importance_sampling(
    margin: Margin,
    size: int,
    points: Sequence[DesignPoint],
    *,
    seed: int,
    samples: int,
    confidence: float,
    failures: Array | None = None,
    expected: float = 0.0,
    jumps: Sequence[Jump] = (),
) -> Estimate:
    """Return the probability of failure from samples of a mixture that covers the failure surface.

    A tenth of the mixture is the law itself, which bounds the weights. The rest consists of unit normal laws about
    design points, and about points of the surface found from known failures. A surface that curves around the origin,
    or has several branches, is thereby covered in proportion to its failures. The estimate is unbiased for any centres.

    With r = φ/q the relative variance is (E[r | failure]/P - 1)/N, so that known failures reveal whether the mixture
    misses any of them. Centres are added about such failures before sampling. A separate set of failures, used for
    nothing else, gives a lower bound of the standard error. Those in regions with hardly any sample raise the upper
    end.

    Args:
        margin, size: Limit state, and number of its normal numbers.
        points: Design points, nearest first.
        failures: Failures ``(d, F)``, with the conditional distribution of failures.
        expected: Probability of failure, as far as known.
        jumps: Numbers with jumps in their values.
    """
    generator = np.random.Generator(np.random.Philox(seed))
    counts = [min(_AT_ONCE, samples - start) for start in range(0, samples, _AT_ONCE)]
    if expected >= _OFTEN:
        failed = sum(int((margin(generator.standard_normal((size, count))) < 0).sum()) for count in counts)
        return plain_estimate(failed, samples, confidence, METHOD)
    known = np.zeros((size, 0)) if failures is None else failures[:, generator.permutation(failures.shape[1])]
    design_points = np.array([point.u for point in points[:_MOST_POINTS]]).reshape(-1, size).T
    centre_count = min(_CENTRES, known.shape[1] // 3)
    pool, checks = np.array_split(known[:, centre_count:], [(known.shape[1] - centre_count) * 2 // 5], axis=1)
    clouds = _clouds(design_points, np.concatenate([known[:, :centre_count], pool], axis=1))
    spread = towards_surface(margin, known[:, :centre_count], jumps, _STEPS)
    proposal = _mixture(points, design_points, clouds, spread, jumps).fit_shares(pool)
    for _ in range(_ROUNDS):
        if not expected or not pool.shape[1]:
            break
        ratios = 1 / proposal.density(pool)
        # stop if the predicted accuracy suffices
        if _predict_variation(ratios, expected, samples) <= 0.03:
            break
        hardest = np.argsort(ratios)[::-1][:32]
        spread = np.concatenate([spread, towards_surface(margin, pool[:, hardest], jumps, _STEPS)], axis=1)
        proposal = _mixture(points, design_points, clouds, spread, jumps).fit_shares(pool)
    if not proposal.shares.size:
        return Estimate(METHOD, 0.0, (0.0, 1.0), math.inf, 0, False, "not resolved: no failure to start from")
    weights = np.concatenate([_weights(margin, proposal, generator, count) for count in counts])
    return _estimate(weights, proposal, checks, confidence)


def _clouds(points: Array, failures: Array) -> tuple[Array, Array]:
    """Return means and standard deviations ``(d, C)`` of the failures about each design point with enough of them."""
    if not 0 < points.shape[1] <= _MOST_CLOUDS:
        return points[:, :0], points[:, :0]
    nearest = (points.T @ failures / np.maximum(np.linalg.norm(points, axis=0), 1e-9)[:, None]).argmax(axis=0)
    groups = [failures[:, nearest == k] for k in range(points.shape[1])]
    groups = [group for group in groups if group.shape[1] >= 30]
    if not groups:
        return points[:, :0], points[:, :0]
    means = np.array([group.mean(axis=1) for group in groups]).T
    widths = np.array([group.std(axis=1) for group in groups]).T
    return means, np.clip(widths, _NARROWEST, _WIDEST)


def _mixture(
    points: Sequence[DesignPoint], near: Array, clouds: tuple[Array, Array], spread: Array, jumps: Sequence[Jump]
) -> _Proposal:
    """Return the mixture about design points, weighted by probability, and about equally weighted clouds and points."""
    chances = np.array([point.probability for point in points[:_MOST_POINTS]])
    means, widths = clouds
    parts = [
        chances / max(float(chances.sum()), 1e-300),
        np.full(means.shape[1], 1 / max(means.shape[1], 1)),
        np.full(spread.shape[1], 1 / max(spread.shape[1], 1)),
    ]
    shares = np.concatenate(parts)
    shares *= (1 - _PLAIN) / max(float(shares.sum()), 1e-300)
    centres = np.concatenate([near, means, spread], axis=1)
    wide = np.concatenate([np.ones_like(near), widths, np.ones_like(spread)], axis=1)
    return _Proposal.about(centres, wide, shares, jumps)


def _weights(margin: Margin, proposal: _Proposal, generator: np.random.Generator, count: int) -> Array:
    u = proposal.draw(generator, count)
    failed = margin(u) < 0
    weights = np.zeros(count)
    weights[failed] = 1 / proposal.density(u[:, failed])
    return weights


def _predict_variation(ratios: Array, probability: float, samples: int) -> float:
    """Return the coefficient of variation that failures predict from their φ/q."""
    return math.sqrt(max(float(ratios.mean()) / probability - 1, 0.0) / samples)


def _estimate(weights: Array, proposal: _Proposal, checks: Array, confidence: float) -> Estimate:
    samples, hits = weights.size, int((weights > 0).sum())
    probability, square = float(weights.mean()), float((weights**2).mean())
    if not hits:
        note = f"not resolved: no failure among {samples:,}"
        return Estimate(METHOD, 0.0, (0.0, 1.0), math.inf, samples, False, note)
    spread = math.sqrt(max(square - probability**2, 0.0))
    variation, missed_share = spread / math.sqrt(samples) / probability, 0.0
    # fewer failures say too little about missed regions
    if checks.shape[1] >= 60:
        ratios = np.sort(1 / proposal.density(checks))[::-1]
        # failures, by descending φ/q, in regions where fewer than five samples are expected
        count = int((np.cumsum(samples * probability / (ratios.size * ratios)) < 5.0).sum())
        missed_share = clopper_pearson(count, ratios.size, confidence)[1]
        if count < ratios.size:
            variation = max(variation, _predict_variation(ratios[count:], probability, samples))
    effective = float(weights.sum()) ** 2 / float((weights**2).sum())
    largest = float(weights.max() / weights.sum())
    skewness = float(((weights - probability) ** 3).mean()) / max(spread, 1e-300) ** 3
    # smallest effective number of failures, (Σw)²/Σw², of a resolved estimate
    # largest fraction of one sample in a resolved estimate
    is_resolved = effective >= 100 and largest <= 0.05 and variation <= LARGEST_VARIATION
    note = ""
    if missed_share > LARGEST_UNKNOWN:
        is_resolved, note = False, f"not resolved: may miss {100 * missed_share:.2g} % of the failures"
    elif not is_resolved:
        note = (
            f"not resolved: {hits} failures among {samples:,} samples count as {effective:.3g}, coefficient of variation "
            f"{variation:.2g}"
        )
    low, high = skewed_interval(probability, variation * probability, skewness, samples, confidence)
    high = min(high / (1 - missed_share), 1.0) if missed_share < 1 else 1.0
    return Estimate(METHOD, probability, (low, high), variation, samples, is_resolved, note)


REPLICATES: Final = 12
"""Independent replicates."""
SUBSET_METHOD: Final = "subset simulation"
# conditional probability of each level
_SHARE: Final = 0.1
# maximum number of levels after the first: probabilities down to about 1e-12
_MOST_LEVELS: Final = 12
# correlation of a sample with the one that it moves from
_KEEP: Final = 0.8
# maximum number of failures returned of a replicate
_MAX_FAILURES: Final = 160
# fraction of the probability found below which strata and sides have no further levels
_UNSEEN: Final = 1e-3
# smallest difference of two margins, relative to the limit
_FLAT: Final = 1e-12


@dataclass(frozen=True, eq=False)
class Subset(Fixed):
    """Result of subset simulation.

    Attributes:
        failures: ``(d, F)`` failures of all replicates in turn, with the conditional distribution of failures.
        first_level: Number of failures among the samples of the first level, and number of these samples.
        highest: Largest probability of a replicate, with that of the last level where it had no failure.
    """

    estimate: Estimate
    failures: Array
    first_level: tuple[int, int]
    highest: float


def subset_simulation(
    margin: Margin,
    size: int,
    *,
    seed: int,
    samples: int,
    confidence: float,
    levels: tuple[int, int] | None = None,
    least: float = 0.0,
) -> Subset:
    """Return the probability of failure as a product of conditional probabilities of 0.1 (Au and Beck, 2001).

    The samples of each level move by u ← 0.8 u + 0.6 z; a move out of the level is rejected (Papaioannou, Betz,
    Zwirglmaier and Straub, 2015). Twelve independent replicates give the mean, its coefficient of variation and its
    interval. The interval is that of a mean of log-normal values, because products of several estimates are skewed.

    Levels do not cross a valley. A margin with several rows ``(sides, N)``, those of exclusive failures, has levels for
    each: first for the nearest, then for the others down to a thousandth of the probability found.

    Args:
        samples: Samples of the first level.
        levels: Samples of each further level, for the nearest side and for the others.
        least: Probability below which no level is tried.
    """
    generator = np.random.Generator(np.random.Philox(seed))
    u = generator.standard_normal((REPLICATES, size, samples))
    values = _margins(margin, u)
    runs: list[_Run] = []
    totals = np.zeros(REPLICATES)
    order = np.argsort(values.mean(axis=(1, 2)), kind="stable").tolist()
    # a side without variation has no failure and no lower level
    for row in [row for row in order if np.ptp(values[row]) > _FLAT] or order[:1]:
        count = (levels or (samples, samples))[bool(runs)]
        runs.append(_Run(margin, row, generator, count, max(least, _UNSEEN * float(totals.mean()))))
        runs[-1].run(u, values[row])
        totals = totals + runs[-1].chances
    count, failed = REPLICATES * samples, int((values < 0).sum())
    probability, unseen = float(totals.mean()), sum(run.unseen for run in runs if not run.chances.any())
    evaluations = count + sum(run.evaluations for run in runs)
    if failed and all((run.levels == 0).all() for run in runs):
        estimate = plain_estimate(failed, count, confidence, SUBSET_METHOD)
    else:
        variation = float(totals.std(ddof=1)) / math.sqrt(REPLICATES) / probability if probability else math.inf
        is_resolved = bool((totals > 0).all()) and variation <= LARGEST_VARIATION
        note = "" if is_resolved else f"not resolved: coefficient of variation {variation:.2g}"
        if not probability:
            note = f"not resolved: no failure down to a probability of {unseen:.0e}"
        low, high = clopper_pearson(failed, count, confidence)
        if is_resolved:
            low, high = log_normal_interval(totals, confidence)
        interval = low, min(1.0, high + unseen * is_resolved)
        estimate = Estimate(SUBSET_METHOD, probability, interval, variation, evaluations, is_resolved, note)
    highest = sum(max(run.unseen, float(run.chances.max())) for run in runs)
    return Subset(estimate, _collect_failures(runs, totals), (failed, count), highest)


def _collect_failures(runs: Sequence[_Run], totals: Array) -> Array:
    """Return failures ``(d, F)`` of all replicates in turn, those of each side in proportion to its probability."""
    parts = [runs[0].failures[0][:, :0]]
    for k, total in enumerate(totals):
        failing = [(run.chances[k] / total, run.failures[k]) for run in runs if run.chances[k]]
        size = min([_MAX_FAILURES, *(failures.shape[1] / share for share, failures in failing)])
        for share, failures in failing:
            parts.append(failures[:, runs[0].generator.permutation(failures.shape[1])[: round(size * share)]])
    return np.concatenate(parts, axis=1)


def _margins(margin: Margin, u: Array) -> Array:
    """Return the margins ``(sides, replicates, N)`` of samples ``(replicates, d, N)``."""
    replicates, size, count = u.shape
    flat = np.moveaxis(u, 1, 0).reshape(size, -1)
    return margin(flat).reshape(-1, replicates, count)


class _Run:
    """The levels of all replicates to one side.

    Attributes:
        samples: Number of samples of each level but the first.
        chances, reached: ``(REPLICATES,)`` probability of failure, and of the last level.
        levels: Number of the last level, ``(REPLICATES,)``.
        failures: Failures ``(d, F)`` of each replicate.
    """

    def __init__(self, margin: Margin, row: int, generator: np.random.Generator, samples: int, least: float) -> None:
        self.margin, self.row, self.generator, self.samples, self.least = margin, row, generator, samples, least
        self.evaluations = 0
        self.chances, self.reached = np.zeros(REPLICATES), np.ones(REPLICATES)
        self.levels = np.zeros(REPLICATES, dtype=int)
        self.failures: list[Array] = []

    @property
    def unseen(self) -> float:
        """Geometric mean of the last levels' probabilities where no failure was found; 0 if it was in all."""
        reached = self.reached[self.chances == 0]
        return math.exp(float(np.log(reached).mean())) if reached.size else 0.0

    def run(self, u: Array, values: Array) -> None:
        """Run the levels from samples ``(REPLICATES, d, N)`` with margins ``(REPLICATES, N)``."""
        seeds = max(1, round(_SHARE * self.samples))
        active = np.arange(REPLICATES)
        self.failures = [u[0, :, :0]] * REPLICATES
        for number in range(_MOST_LEVELS + 1):
            rank = max(1, round(_SHARE * values.shape[1])) - 1
            levels = np.partition(values, rank, axis=1)[:, rank]
            states, ongoing = [], []
            for k, (replicate, level) in enumerate(zip(active, levels, strict=True)):
                at_most = values[k] <= level
                flat = at_most.all()  # equal margins have no lower level
                if level < 0 or flat or number == _MOST_LEVELS or self.reached[replicate] < self.least:
                    failed = values[k] < 0
                    self.chances[replicate] = self.reached[replicate] * failed.mean()
                    self.levels[replicate] = number
                    self.failures[replicate] = u[k][:, failed]
                    continue
                self.reached[replicate] *= at_most.mean()
                states.append((k, self.generator.permutation(np.flatnonzero(at_most))[:seeds]))
                ongoing.append(k)
            if not ongoing:
                break
            active, levels = active[ongoing], levels[ongoing]
            state = np.stack([u[k][:, columns] for k, columns in states])
            margins = np.stack([values[k][columns] for k, columns in states])
            u, values = self._move_samples(state, margins, levels)

    def _move_samples(self, state: Array, margins: Array, levels: Array) -> tuple[Array, Array]:
        """Return the full number of samples at or below the level of each replicate."""
        states, accepted = [state], [margins]
        while sum(part.shape[1] for part in accepted) < self.samples:
            trial = _KEEP * state + math.sqrt(1 - _KEEP**2) * self.generator.standard_normal(state.shape)
            new = _margins(self.margin, trial)[self.row]
            self.evaluations += new.size
            is_inside = new <= levels[:, None]
            state, margins = np.where(is_inside[:, None], trial, state), np.where(is_inside, new, margins)
            states.append(state)
            accepted.append(margins)
        return np.concatenate(states, axis=2)[:, :, : self.samples], np.concatenate(accepted, axis=1)[:, : self.samples]


SUBSET_SAMPLES: Final = 2_000
"""Samples in each level of each replicate."""

FEW_SAMPLES: Final = 500
"""Samples beyond the first level in strata of rare values and for sides other than the nearest."""

SMALL: Final = 0.01
"""Ratio of a stratum's probability to the failure probability found so far below which it is not evaluated."""

# known failures from which design points are searched
_STARTS_OF_FAILURES: Final = 12


@dataclass(frozen=True, eq=False, kw_only=True)
class RareEvents(Verdict):
    """Results of all methods, and the choice among them.

    Attributes:
        estimates: Estimates of the probability of failure, plain sampling first.
        form: Design points of all strata, nearest first.
        strata: Evaluated strata; the remainder was not evaluated.
        remarks: Differences between FORM and the best estimate, one line each. They are common and no contradiction.
    """

    estimates: tuple[Estimate, ...]
    form: Form
    strata: Strata
    remarks: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Part:
    stratum: Stratum
    form: Form
    estimates: tuple[Estimate, ...]


def rare_events(
    space: Space,
    margin: Callable[[Array], Array],
    starts: Sequence[Array],
    plain: Estimate,
    seed: int,
    confidence: float,
    sides: Callable[[Array], Array] | None = None,
) -> RareEvents:
    """Return the probability that a margin is below zero, by all methods.

    Args:
        margin: Margin to failure, ``(N,)``, for component values ``(d, N)``.
        starts: Starting points of FORM, standard normal numbers ``(d,)``.
        plain: Estimate by plain sampling.
        seed, confidence: Seed of the sampling, confidence of the intervals.
        sides: Margins ``(sides, N)`` of exclusive failures that together are all. They are used where a law jumps or is
            not symmetric, because most failures may then lie opposite the nearest one.
    """
    if not space.size:
        strata = Strata((Stratum(space),))
        return RareEvents(estimates=(plain,), **vars(judged([plain])), form=Form((), 0), strata=strata, remarks=())
    strata = stratified(space, margin, sides or margin)
    parts: list[_Part] = []
    unknown, total = strata.remainder, 0.0
    for number, stratum in enumerate(strata.parts):
        remaining = math.fsum(part.probability for part in strata.parts[number:])
        if number and not stratum.certain and remaining <= SMALL * total:
            unknown += stratum.probability
            continue
        least = max(LEAST, _UNSEEN * total / stratum.probability) if number else 0.0
        seeds = np.random.SeedSequence((seed, number))
        part = _within(stratum, margin, sides or margin, starts, least, seeds, confidence)
        parts.append(part)
        total += stratum.probability * max(entry.probability for entry in part.estimates)
    merged = _merge_forms(parts, unknown)
    estimates = [plain]
    for k, method in enumerate((METHOD, SUBSET_METHOD)):
        estimates.append(summed(method, [(part.stratum.probability, part.estimates[k]) for part in parts], unknown))
    verdict = judged(estimates)
    evaluated = Strata(tuple(part.stratum for part in parts), unknown)
    return RareEvents(
        **vars(verdict), estimates=tuple(estimates), form=merged, strata=evaluated, remarks=remarks(verdict, merged)
    )


def _side_margin(sides: Margin, row: int, normals: Array) -> Array:
    return np.asarray(sides(normals)[row])


def _within(
    stratum: Stratum,
    margin_of_values: Callable[[Array], Array],
    sides_of_values: Callable[[Array], Array],
    starts: Sequence[Array],
    least: float,
    seeds: np.random.SeedSequence,
    confidence: float,
) -> _Part:
    size = stratum.space.size

    def margin(normals: Array) -> Array:
        return margin_of_values(stratum.values(normals))

    if stratum.certain:
        failed = margin(stratum.middles) < 0
        fails = float(stratum.shares @ failed)
        known = Estimate("", fails, (fails, fails), 0.0, failed.size, True)
        points = stratum.middles[:, failed][:, : bool(stratum.rare)]
        return _Part(stratum, _all_fails(points), (replace(known, method=METHOD), replace(known, method=SUBSET_METHOD)))
    subset_seed, sampling_seed = (int(word) for word in seeds.generate_state(2, np.uint64))

    def toward(normals: Array) -> Array:
        return np.atleast_2d(sides_of_values(stratum.values(normals)))

    symmetric = stratum.is_symmetric
    sides = margin if symmetric else toward
    # few samples suffice to decide relevance, unless nothing is known yet
    for levels in ((FEW_SAMPLES if least else SUBSET_SAMPLES, FEW_SAMPLES), (SUBSET_SAMPLES, SUBSET_SAMPLES)):
        subset = subset_simulation(
            sides, size, seed=subset_seed, samples=SUBSET_SAMPLES, confidence=confidence, levels=levels, least=least
        )
        if subset.estimate.resolved or subset.estimate.probability <= 10 * least or (symmetric and not least):
            break
    # known failures and one-sided searches lead to design points that the symmetric starts may miss
    every = max(1, subset.failures.shape[1] // _STARTS_OF_FAILURES)
    is_limited = least > 0 and not subset.failures.size
    all_starts = [*(starts[:2] if is_limited else starts), *subset.failures.T[::every][:_STARTS_OF_FAILURES]]
    for row in range(0 if symmetric else len(sides(np.zeros((size, 1))))):
        side_form = form(partial(_side_margin, sides, row), size, [np.zeros(size), *starts[:2]], stratum.jumps)
        all_starts += [point.u for point in side_form.points]
    searched = form(margin, size, all_starts, stratum.jumps)
    shifted = importance_sampling(
        margin, size, searched.points, seed=sampling_seed, samples=20_000, confidence=confidence,
        failures=subset.failures, expected=subset.estimate.probability, jumps=stratum.jumps,
    )  # fmt: skip
    if not searched.points and stratum.rare and float(margin(np.zeros((size, 1)))[0]) < 0:
        searched = _all_fails(np.zeros((size, 1)), searched.starts)
    return _Part(stratum, searched, _bound_estimates(stratum, subset, shifted))


def _all_fails(points: Array, starts: int = 0) -> Form:
    """Return points ``(d, P)`` as design points of a stratum in which all searched points fail."""
    zeros = np.zeros(points.shape[0])
    return Form(tuple(DesignPoint(u, -FARTHEST, zeros) for u in points.T), starts)


def _bound_estimates(stratum: Stratum, subset: Subset, shifted: Estimate) -> tuple[Estimate, ...]:
    """Return both estimates in a stratum, or a bound from the first level's counts or ten times the largest found."""
    estimates = (shifted, subset.estimate)
    if stratum.probability == 1:
        return estimates
    low, high = subset.estimate.interval
    # ratio of the upper end for a stratum without an estimate to the largest probability of any method
    high = min(high, max(NEGLIGIBLE, 10.0 * max(subset.highest, shifted.probability)))
    return tuple(entry if entry.resolved else replace(entry, interval=(min(low, high), high)) for entry in estimates)


def _merge_forms(parts: Sequence[_Part], unknown: float) -> Form:
    """Return the design points of all strata, with distances that include the probability of the stratum."""
    if len(parts) == 1 and parts[0].stratum.probability == 1:
        return parts[0].form
    points: list[DesignPoint] = []
    low, high = 0.0, unknown
    for number, part in enumerate(parts):
        points += [_weight_point(point, part.stratum, number) for point in part.form.points]
        span = part.form.range
        if part.stratum.certain:
            span = (part.estimates[0].probability,) * 2
        if span is not None:
            low += part.stratum.probability * span[0]
            high += part.stratum.probability * span[1]
    points.sort(key=lambda point: abs(point.beta))
    starts = sum(part.form.starts for part in parts)
    return Form(tuple(points), starts, (low, min(high, 1.0)) if points else None)


def _weight_point(point: DesignPoint, stratum: Stratum, number: int) -> DesignPoint:
    """Return a design point with Φ(-β) times the stratum's probability; the rare draws get the added β²."""
    within = min(max(point.beta, -8.0), 38.0)
    beta = -float(special.ndtri_exp(special.log_ndtr(-within) + math.log(stratum.probability)))
    rare = stratum.rare_at(point.u)
    if not rare or beta <= 0:
        return replace(point, beta=beta, stratum=number)
    fraction = max(point.beta, 0.0) ** 2 / beta**2
    importance = point.importance * min(fraction, 1.0)
    rows = [stratum.space.index[draw.components[0]] for draw in stratum.space.draws if draw.name in rare]
    importance[rows] += (1 - min(fraction, 1.0)) / len(rows)
    return replace(point, beta=beta, importance=importance, stratum=number)
