"""Probabilities too small for plain sampling: importance sampling around design points, and subset simulation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.design_points import DesignPoint, Margin
from precision_pin.statistics import clopper_pearson

__all__ = ["Estimate", "importance_sampling", "subset_simulation"]

Array = NDArray[np.float64]

LARGEST_VARIATION: Final = 0.3
"""An estimate with a larger coefficient of variation is not resolved."""

REPLICATES: Final = 12
FEWEST_HITS: Final = 100
_SHARE: Final = 0.1
_MOST_LEVELS: Final = 12
_KEPT: Final = 0.8
_PLAIN: Final = 0.1
_MOST_CENTRES: Final = 32
_AT_ONCE: Final = 8192
_TOLD: Final = 2


@final
@dataclass(frozen=True)
class Estimate:
    """A probability of failure with its uncertainty.

    Attributes
    ----------
    method
        ``"sampling"``, ``"importance sampling"`` or ``"subset simulation"``.
    probability
        Of failure.
    interval
        At the confidence stated.
    variation
        Coefficient of variation, infinite where no failure was met.
    evaluations
        Of the error model.
    resolved
        Whether it may be relied on; the reason why not stands in ``note``.
    note
        In words.
    """

    method: str
    probability: float
    interval: tuple[float, float]
    variation: float
    evaluations: int
    resolved: bool
    note: str = ""

    def to_dict(self) -> dict[str, object]:
        """Return the estimate as the JSON has it; null for an infinite coefficient of variation."""
        return {
            "method": self.method,
            "probability": self.probability,
            "interval": list(self.interval),
            "coefficient_of_variation": self.variation if math.isfinite(self.variation) else None,
            "evaluations": self.evaluations,
            "resolved": self.resolved,
            "note": self.note or None,
        }


def importance_sampling(
    margin: Margin, size: int, points: Sequence[DesignPoint], *, seed: int, samples: int, confidence: float
) -> Estimate:
    """Return the probability of failure from normal samples about design points.

    The sampling density is a mixture: a tenth of it the law itself, which bounds the weights, the rest unit normal laws
    about the design points in proportion to Φ(-β). The estimate has no bias whatever the points; its interval is that of
    the central limit theorem.

    Parameters
    ----------
    margin, size
        The limit state and how many numbers it takes.
    points
        Design points, nearest first.
    seed, samples, confidence
        Of the sampling.
    """
    centres = np.array([point.u for point in points[:_MOST_CENTRES]])
    shares = np.array([point.probability for point in points[:_MOST_CENTRES]])
    shares = (1 - _PLAIN) * shares / shares.sum()
    generator = np.random.Generator(np.random.Philox(seed))
    total = square = 0.0
    hits = 0
    for first in range(0, samples, _AT_ONCE):
        count = min(_AT_ONCE, samples - first)
        which = generator.choice(len(shares) + 1, size=count, p=[_PLAIN, *shares])
        u = generator.standard_normal((size, count)) + np.vstack([np.zeros(size), centres])[which].T
        # density of a point over that of the law: exp(c·u - |c|²/2) for the centre c
        ratios = np.exp(centres @ u - (centres**2).sum(axis=1)[:, None] / 2)
        weights = np.where(margin(u) < 0, 1 / (_PLAIN + shares @ ratios), 0.0)
        hits += int((weights > 0).sum())
        total += float(weights.sum())
        square += float((weights**2).sum())
    probability = total / samples
    error = math.sqrt(max(square / samples - probability**2, 0.0) / samples)
    variation = error / probability if probability else math.inf
    reach = float(special.ndtri((1 + confidence) / 2)) * error
    enough = hits >= FEWEST_HITS and variation <= LARGEST_VARIATION
    return Estimate(
        "importance sampling",
        probability,
        (max(0.0, probability - reach), min(1.0, probability + reach)),
        variation,
        samples,
        enough,
        ""
        if enough
        else f"not resolved: {hits} failures among {samples:,} samples, coefficient of variation {variation:.2g}",
    )


def subset_simulation(
    margin: Margin, size: int, *, seed: int, samples: int, confidence: float
) -> tuple[Estimate, Array]:
    """Return the probability of failure as a product of conditional ones of 0.1 (Au and Beck, 2001), and failures.

    Each level's samples are moved by u ← 0.8 u + 0.6 z, refused where they leave the level (Papaioannou, Betz, Zwirglmaier
    and Straub, 2015). Twelve replicates by themselves give the mean, its coefficient of variation and, by Student's t, its
    interval.

    Parameters
    ----------
    margin, size
        The limit state and how many numbers it takes.
    seed, samples, confidence
        Of the sampling; ``samples`` in each level of each replicate, a multiple of 10.

    Returns
    -------
    tuple
        The estimate, and failures ``(d, F)``, a few of each replicate, wherever they lie.
    """
    found, evaluations, failures = np.zeros(REPLICATES), 0, []
    for replicate, child in enumerate(np.random.SeedSequence(seed).spawn(REPLICATES)):
        generator = np.random.Generator(np.random.Philox(child))
        found[replicate], used, failed = _one_subset(margin, size, generator, samples)
        evaluations += used
        failures.append(failed[:, generator.permutation(failed.shape[1])[:_TOLD]])
    probability = float(found.mean())
    error = float(found.std(ddof=1)) / math.sqrt(REPLICATES)
    variation = error / probability if probability else math.inf
    reach = float(special.stdtrit(REPLICATES - 1, (1 + confidence) / 2)) * error
    enough = bool((found > 0).all()) and variation <= LARGEST_VARIATION
    note = "" if enough else f"not resolved: coefficient of variation {variation:.2g}"
    if not probability:
        note = f"not resolved: no failure down to a probability of {_SHARE ** (_MOST_LEVELS - 1):.0e}"
    interval = (max(0.0, probability - reach), min(1.0, probability + reach))
    if not error:
        # all replicates alike: without a failure nothing is known, with failures only they were counted
        count = REPLICATES * samples
        interval = clopper_pearson(round(probability * count), count, confidence) if probability else (0.0, 1.0)
    estimate = Estimate("subset simulation", probability, interval, variation, evaluations, enough, note)
    return estimate, np.concatenate(failures, axis=1)


def _one_subset(margin: Margin, size: int, generator: np.random.Generator, samples: int) -> tuple[float, int, Array]:
    """Return one replicate's probability, how often it evaluated the margin, and its failures ``(d, F)``."""
    u = generator.standard_normal((size, samples))
    values = margin(u)
    seeds = max(1, round(_SHARE * samples))
    evaluations, reached = samples, 1.0
    for _ in range(_MOST_LEVELS):
        order = np.argsort(values, kind="stable")
        level = float(values[order[seeds - 1]])
        if level < 0:
            return reached * float((values < 0).mean()), evaluations, u[:, values < 0]
        at_most = values <= level
        if at_most.all():
            return 0.0, evaluations, u[:, :0]  # nothing leads further: the margin is flat here
        share = float(at_most.mean())
        chosen = generator.permutation(np.flatnonzero(at_most))[:seeds]
        state, margins = u[:, chosen], values[chosen]
        moved, kept = [state], [margins]
        while sum(part.size for part in kept) < samples:
            tried = _KEPT * state + math.sqrt(1 - _KEPT**2) * generator.standard_normal(state.shape)
            news = margin(tried)
            evaluations += news.size
            inside = news <= level
            state, margins = np.where(inside, tried, state), np.where(inside, news, margins)
            moved.append(state)
            kept.append(margins)
        u, values = np.concatenate(moved, axis=1)[:, :samples], np.concatenate(kept)[:samples]
        reached *= share
    failed = float((values < 0).mean())
    return reached * failed, evaluations, u[:, values < 0]
