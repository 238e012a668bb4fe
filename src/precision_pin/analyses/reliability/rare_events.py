"""Probability of failure by all methods, stratum by stratum, and the choice among them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from precision_pin.analyses.reliability.estimates import Estimate, Verdict, judged, remarks, summed
from precision_pin.analyses.reliability.form import DesignPoint, Form, form
from precision_pin.analyses.reliability.importance import METHOD as IMPORTANCE
from precision_pin.analyses.reliability.importance import SUBSET_METHOD as SUBSET
from precision_pin.analyses.reliability.importance import Subset, importance_sampling, subset_simulation
from precision_pin.analyses.reliability.strata import FARTHEST, Strata, Stratum, stratified
from precision_pin.base.arrays import Array
from precision_pin.draws.space import Space

IMPORTANCE_SAMPLES: Final = 20_000
SUBSET_SAMPLES: Final = 2_000
"""Samples in each level of each replicate."""

NEGLIGIBLE: Final = 1e-9
"""Smallest upper end for a stratum without an estimate, even if levels down to 1e-12 had no failure."""

SMALL: Final = 0.01
"""Ratio of a stratum's probability to the failure probability found so far below which it is not evaluated."""

_STARTS_OF_FAILURES: Final = 12
# ratio of the upper end for a stratum without an estimate to the largest probability of any method
_MARGIN_OF_BOUND: Final = 10.0


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
) -> RareEvents:
    """Return the probability that a margin is below zero, by all methods.

    Args:
        margin: Margin to failure, ``(N,)``, for component values ``(d, N)``.
        starts: Starting points of FORM, standard normal numbers ``(d,)``.
        plain: Estimate by plain sampling.
        seed, confidence: Seed of the sampling, confidence of the intervals.
    """
    if not space.size:
        strata = Strata((Stratum(space),))
        return RareEvents(estimates=(plain,), **vars(judged([plain])), form=Form((), 0), strata=strata, remarks=())
    strata = stratified(space, margin)
    parts: list[_Part] = []
    unknown, found = strata.remainder, 0.0
    for number, stratum in enumerate(strata.parts):
        if number and not stratum.certain and stratum.probability <= SMALL * found:
            unknown += stratum.probability
            continue
        part = _within(stratum, margin, starts, np.random.SeedSequence((seed, number)), confidence)
        parts.append(part)
        found += stratum.probability * max(entry.probability for entry in part.estimates)
    searched = _together(parts, unknown)
    estimates = [plain]
    for k, method in enumerate((IMPORTANCE, SUBSET)):
        estimates.append(summed(method, [(part.stratum.probability, part.estimates[k]) for part in parts], unknown))
    verdict = judged(estimates)
    looked_at = Strata(tuple(part.stratum for part in parts), unknown)
    return RareEvents(
        **vars(verdict), estimates=tuple(estimates), form=searched, strata=looked_at, remarks=remarks(verdict, searched)
    )


def _within(
    stratum: Stratum,
    margin_of_values: Callable[[Array], Array],
    starts: Sequence[Array],
    seeds: np.random.SeedSequence,
    confidence: float,
) -> _Part:
    size = stratum.space.size

    def margin(normals: Array) -> Array:
        return margin_of_values(stratum.values(normals))

    if stratum.certain:
        failed = margin(stratum.middles) < 0
        fails = float(stratum.shares @ failed)
        sure = Estimate("", fails, (fails, fails), 0.0, failed.size, True)
        failing = stratum.middles[:, failed][:, : bool(stratum.rare)]
        return _Part(stratum, _all_fails(failing), (replace(sure, method=IMPORTANCE), replace(sure, method=SUBSET)))
    first, second = (int(word) for word in seeds.generate_state(2, np.uint64))
    subset = subset_simulation(margin, size, seed=first, samples=SUBSET_SAMPLES, confidence=confidence)
    # known failures lead to design points that the symmetric starts may miss
    every = max(1, subset.failures.shape[1] // _STARTS_OF_FAILURES)
    searched = form(margin, size, [*starts, *subset.failures.T[::every][:_STARTS_OF_FAILURES]], stratum.jumps)
    shifted = importance_sampling(
        margin, size, searched.points, seed=second, samples=IMPORTANCE_SAMPLES, confidence=confidence,
        failures=subset.failures, expected=subset.estimate.probability, jumps=stratum.jumps,
    )  # fmt: skip
    if not searched.points and stratum.rare and float(margin(np.zeros((size, 1)))[0]) < 0:
        searched = _all_fails(np.zeros((size, 1)), searched.starts)
    return _Part(stratum, searched, _bound_estimates(stratum, subset, shifted))


def _all_fails(points: Array, starts: int = 0) -> Form:
    """Return points ``(d, P)`` as design points of a stratum in which all searched points fail."""
    nothing = np.zeros(points.shape[0])
    return Form(tuple(DesignPoint(u, -FARTHEST, nothing) for u in points.T), starts)


def _bound_estimates(stratum: Stratum, subset: Subset, shifted: Estimate) -> tuple[Estimate, ...]:
    """Return both estimates in a stratum, or a bound from the first level's counts or ten times the largest found."""
    estimates = (shifted, subset.estimate)
    if stratum.probability == 1:
        return estimates
    low, high = subset.estimate.interval
    high = min(high, max(NEGLIGIBLE, _MARGIN_OF_BOUND * max(subset.highest, shifted.probability)))
    return tuple(entry if entry.resolved else replace(entry, interval=(min(low, high), high)) for entry in estimates)


def _together(parts: Sequence[_Part], unknown: float) -> Form:
    """Return the design points of all strata, with distances that include the probability of the stratum."""
    if len(parts) == 1 and parts[0].stratum.probability == 1:
        return parts[0].form
    points: list[DesignPoint] = []
    low, high = 0.0, unknown
    for number, part in enumerate(parts):
        points += [_of_stratum(point, part.stratum, number) for point in part.form.points]
        span = part.form.range
        if part.stratum.certain:
            span = (part.estimates[0].probability,) * 2
        if span is not None:
            low += part.stratum.probability * span[0]
            high += part.stratum.probability * span[1]
    points.sort(key=lambda point: abs(point.beta))
    starts = sum(part.form.starts for part in parts)
    return Form(tuple(points), starts, (low, min(high, 1.0)) if points else None)


def _of_stratum(point: DesignPoint, stratum: Stratum, number: int) -> DesignPoint:
    """Return a design point with Φ(-β) times the stratum's probability; the rare draws get the added β²."""
    within = min(max(point.beta, -8.0), 38.0)
    beta = -float(special.ndtri_exp(special.log_ndtr(-within) + math.log(stratum.probability)))
    rare = stratum.rare_at(point.u)
    if not rare or beta <= 0:
        return replace(point, beta=beta, stratum=number)
    own = max(point.beta, 0.0) ** 2 / beta**2
    importance = point.importance * min(own, 1.0)
    rows = [stratum.space.index[draw.components[0]] for draw in stratum.space.draws if draw.name in rare]
    importance[rows] += (1 - min(own, 1.0)) / len(rows)
    return replace(point, beta=beta, importance=importance, stratum=number)
