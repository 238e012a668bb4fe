"""Subset simulation: a small probability as a product of larger ones, level by level."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.reliability.estimates import (
    LARGEST_VARIATION,
    Estimate,
    log_normal_interval,
    plain_estimate,
)
from precision_pin.analyses.reliability.form import Margin
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.statistics import clopper_pearson

REPLICATES: Final = 12
METHOD: Final = "subset simulation"
_SHARE: Final = 0.1
_MOST_LEVELS: Final = 12
_KEPT: Final = 0.8
_TOLD: Final = 160


@final
@dataclass(frozen=True, eq=False)
class Subset:
    """Result of subset simulation.

    Attributes
    ----------
    estimate
        Estimate of the probability.
    failures
        ``(d, F)`` failures of all replicates in turn, with the conditional distribution of failures.
    counted
        Number of failures among the samples of the first level, and number of these samples.
    highest
        Largest probability of a replicate, or of the last level of a replicate without failure.
    """

    estimate: Estimate
    failures: Array
    counted: tuple[int, int]
    highest: float

    def __post_init__(self) -> None:
        fix_fields(self)


def subset_simulation(margin: Margin, size: int, *, seed: int, samples: int, confidence: float) -> Subset:
    """Return the probability of failure as a product of conditional probabilities of 0.1 (Au and Beck, 2001), and failures.

    The samples of each level move by u ← 0.8 u + 0.6 z; a move out of the level is rejected (Papaioannou, Betz, Zwirglmaier
    and Straub, 2015). Twelve independent replicates give the mean, its coefficient of variation and its interval. The
    interval is that of a mean of log-normal values, because products of several estimates are skewed.

    Parameters
    ----------
    margin, size
        Limit state, and number of its normal numbers.
    seed, samples, confidence
        Seed of the sampling; number of samples in each level of each replicate, a multiple of 10; confidence of the interval.
    """
    run = _Run(margin, np.random.Generator(np.random.Philox(seed)), samples)
    found, reached, levels = run.found(size)
    count = REPLICATES * samples
    probability = float(found.mean())
    kept = [failed[:, run.generator.permutation(failed.shape[1])[:_TOLD]] for failed in run.failures]
    highest = float(np.where(found > 0, found, reached).max())
    if run.counted and (levels == 0).all():
        estimate = plain_estimate(run.counted, count, confidence, METHOD)
    else:
        variation = float(found.std(ddof=1)) / math.sqrt(REPLICATES) / probability if probability else math.inf
        enough = bool((found > 0).all()) and variation <= LARGEST_VARIATION
        note = "" if enough else f"not resolved: coefficient of variation {variation:.2g}"
        if not probability:
            note = f"not resolved: no failure down to a probability of {_SHARE ** int(levels.max()):.0e}"
        known = clopper_pearson(run.counted, count, confidence)
        interval = log_normal_interval(found, confidence) if enough else known
        estimate = Estimate(METHOD, probability, interval, variation, run.evaluations, enough, note)
    return Subset(estimate, np.concatenate(kept, axis=1), (run.counted, count), highest)


@final
class _Run:
    """Simultaneous replicates, each with its own levels."""

    def __init__(self, margin: Margin, generator: np.random.Generator, samples: int) -> None:
        self.margin, self.generator, self.samples = margin, generator, samples
        self.evaluations = self.counted = 0
        self.failures: list[Array] = []

    def found(self, size: int) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return, for each replicate, the probability of failure, that of its last level, and the number of levels."""
        seeds = max(1, round(_SHARE * self.samples))
        u = self.generator.standard_normal((REPLICATES, size, self.samples))
        values = self._margins(u)
        self.counted = int((values < 0).sum())
        found, ended = np.zeros(REPLICATES), np.zeros(REPLICATES, dtype=int)
        reached, active = np.ones(REPLICATES), np.arange(REPLICATES)
        self.failures = [u[0, :, :0]] * REPLICATES
        for number in range(_MOST_LEVELS + 1):
            levels = np.partition(values, seeds - 1, axis=1)[:, seeds - 1]
            states, goes = [], []
            for k, (replicate, level) in enumerate(zip(active, levels, strict=True)):
                at_most = values[k] <= level
                flat = at_most.all()  # all margins are equal: there is no lower level
                if level < 0 or flat or number == _MOST_LEVELS:
                    failed = values[k] < 0
                    found[replicate] = reached[replicate] * failed.mean()
                    ended[replicate] = number
                    self.failures[replicate] = u[k][:, failed]
                    continue
                reached[replicate] *= at_most.mean()
                states.append((k, self.generator.permutation(np.flatnonzero(at_most))[:seeds]))
                goes.append(k)
            if not goes:
                break
            active, levels = active[goes], levels[goes]
            state = np.stack([u[k][:, chosen] for k, chosen in states])
            margins = np.stack([values[k][chosen] for k, chosen in states])
            u, values = self._move_samples(state, margins, levels)
        return found, reached, ended

    def _move_samples(self, state: Array, margins: Array, levels: Array) -> tuple[Array, Array]:
        """Return the full number of samples at or below the level of each replicate."""
        states, kept = [state], [margins]
        while sum(part.shape[1] for part in kept) < self.samples:
            tried = _KEPT * state + math.sqrt(1 - _KEPT**2) * self.generator.standard_normal(state.shape)
            news = self._margins(tried)
            inside = news <= levels[:, None]
            state, margins = np.where(inside[:, None], tried, state), np.where(inside, news, margins)
            states.append(state)
            kept.append(margins)
        return np.concatenate(states, axis=2)[:, :, : self.samples], np.concatenate(kept, axis=1)[:, : self.samples]

    def _margins(self, u: Array) -> Array:
        """Return the margins ``(R, N)`` of samples ``(R, d, N)``."""
        replicates, size, count = u.shape
        self.evaluations += replicates * count
        flat = np.moveaxis(u, 1, 0).reshape(size, -1)
        return self.margin(flat).reshape(replicates, count)
