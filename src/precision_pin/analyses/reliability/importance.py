"""Importance sampling from proposals that cover the whole failure surface, and are checked by failures met otherwise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.reliability.estimates import (
    LARGEST_UNKNOWN,
    LARGEST_VARIATION,
    Estimate,
    plain_estimate,
    skewed_interval,
)
from precision_pin.analyses.reliability.form import DesignPoint, Margin, towards_surface
from precision_pin.analyses.reliability.strata import Jump
from precision_pin.statistics import clopper_pearson
from precision_pin.typing import Array

__all__ = ["FEWEST_EFFECTIVE", "importance_sampling"]


METHOD: Final = "importance sampling"
FEWEST_EFFECTIVE: Final = 100
"""Effective number of failures, (Σw)²/Σw², below which the estimate is not resolved."""

LARGEST_WEIGHT: Final = 0.05
"""Largest share that one sample may have in the estimate."""

_PLAIN: Final = 0.1
_STAYING: Final = 0.5
_MOST_POINTS: Final = 32
_CENTRES: Final = 64
_MORE_CENTRES: Final = 32
_ROUNDS: Final = 6
_GOOD_VARIATION: Final = 0.03
_STEPS: Final = 3
_OFTEN: Final = 0.05
_FEWEST_CHECKS: Final = 60
_FEWEST_EXPECTED: Final = 5.0
_AT_ONCE: Final = 8192
_MOST_CLOUDS: Final = 12
_FEWEST_IN_CLOUD: Final = 30
_NARROWEST: Final = 0.7
_WIDEST: Final = 3.0
_STEPS_OF_SHARES: Final = 20
_FITTED: Final = 0.7


@final
@dataclass(frozen=True, eq=False)
class _Proposal:
    """A mixture: the law itself, and normal laws about centres that keep to their pieces half of the time.

    Attributes
    ----------
    centres, widths
        ``(d, C)`` means and standard deviations; 0 and 1 in numbers that jump.
    shares
        ``(C,)`` of the centres; what they leave of 1 is the law itself.
    jumps
        Numbers that jump.
    pieces
        ``(len(jumps), C)`` each centre's piece of each such number.
    """

    centres: Array
    widths: Array
    shares: Array
    jumps: Sequence[Jump]
    pieces: NDArray[np.intp]

    @classmethod
    def about(cls, points: Array, widths: Array, shares: Array, jumps: Sequence[Jump]) -> _Proposal:
        """Return the mixture about points whose numbers that jump tell the pieces."""
        centres, wide, pieces = points.copy(), widths.copy(), np.zeros((len(jumps), points.shape[1]), dtype=np.intp)
        for k, jump in enumerate(jumps):
            pieces[k] = jump.pieces(points)
            centres[jump.row], wide[jump.row] = 0.0, 1.0
        return cls(centres, wide, shares, jumps, pieces)

    def drawn(self, generator: np.random.Generator, count: int) -> Array:
        """Return samples ``(d, N)``."""
        plain = 1 - float(self.shares.sum())
        which = generator.choice(self.shares.size + 1, size=count, p=[*self.shares, plain])
        of_centre = which < self.shares.size
        u = generator.standard_normal((self.centres.shape[0], count))
        own = which[of_centre]
        u[:, of_centre] = self.centres[:, own] + self.widths[:, own] * u[:, of_centre]
        for jump, pieces in zip(self.jumps, self.pieces, strict=True):
            stays = of_centre & (generator.random(count) < _STAYING)
            u[jump.row, stays] = jump.scores(pieces[which[stays]], generator.random(int(stays.sum())))
        return u

    def ratios(self, u: Array) -> Array:
        """Return each centre's density over that of the law, ``(C, N)``."""
        narrow = 1 / self.widths**2
        exponent = (self.centres * narrow).T @ u + ((1 - narrow) / 2).T @ u**2
        exponent -= ((self.centres**2 * narrow) / 2 + np.log(self.widths)).sum(axis=0)[:, None]
        ratios: Array = np.exp(exponent)
        for jump, pieces in zip(self.jumps, self.pieces, strict=True):
            here, shares = jump.pieces(u), np.diff(jump.edges)
            ratios *= (1 - _STAYING) + _STAYING * (here == pieces[:, None]) / shares[pieces][:, None]
        return ratios

    def density(self, u: Array) -> Array:
        """Return the density over that of the law."""
        value: Array = (1 - float(self.shares.sum())) + self.shares @ self.ratios(u)
        return value

    def suited_to(self, failures: Array) -> _Proposal:
        """Return the mixture with shares under which the failures are likelier (a few steps of expectation-maximisation)."""
        if not failures.shape[1]:
            return self
        ratios, shares = self.ratios(failures), self.shares
        total = float(shares.sum())
        for _ in range(_STEPS_OF_SHARES):
            shares = (shares[:, None] * ratios / ((1 - total) + shares @ ratios)).mean(axis=1)
            shares = total * shares / max(float(shares.sum()), 1e-300)
        return replace(self, shares=_FITTED * shares + (1 - _FITTED) * self.shares)


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

    A tenth of the mixture is the law itself, which bounds the weights; the rest are unit normal laws about design points
    and about points of the surface to which failures met elsewhere lead, so that a surface that curves round the origin, or
    has several branches, is covered in proportion to what fails there. The estimate has no bias whatever the centres. With
    r = φ/q its relative variance is (E[r | failure]/P - 1)/N: failures tell whether the mixture misses any of them. Centres
    are added where some say so, before anything is sampled; others, used for nothing else, bound the standard error from
    below, and the share of those that lie where next to no sample comes widens the interval at its upper end.

    Parameters
    ----------
    margin, size
        The limit state and how many numbers it takes.
    points
        Design points, nearest first.
    seed, samples, confidence
        Of the sampling.
    failures
        Failures ``(d, F)``, distributed as they are.
    expected
        Their probability, as far as it is known.
    jumps
        Numbers whose values jump.
    """
    generator = np.random.Generator(np.random.Philox(seed))
    if expected >= _OFTEN:
        return plain_estimate(_plain_failures(margin, size, generator, samples), samples, confidence, METHOD)
    known = np.zeros((size, 0)) if failures is None else failures[:, generator.permutation(failures.shape[1])]
    near = np.array([point.u for point in points[:_MOST_POINTS]]).reshape(-1, size).T
    used = min(_CENTRES, known.shape[1] // 3)
    pool, checks = np.array_split(known[:, used:], [(known.shape[1] - used) * 2 // 5], axis=1)
    clouds = _clouds(near, np.concatenate([known[:, :used], pool], axis=1))
    spread = towards_surface(margin, known[:, :used], jumps, _STEPS)
    proposal = _mixture(points, near, clouds, spread, jumps).suited_to(pool)
    for _ in range(_ROUNDS):
        if not expected or not pool.shape[1]:
            break
        ratios = 1 / proposal.density(pool)
        if _foreseen(ratios, expected, samples) <= _GOOD_VARIATION:
            break
        worst = np.argsort(ratios)[::-1][:_MORE_CENTRES]
        spread = np.concatenate([spread, towards_surface(margin, pool[:, worst], jumps, _STEPS)], axis=1)
        proposal = _mixture(points, near, clouds, spread, jumps).suited_to(pool)
    if not proposal.shares.size:
        return Estimate(METHOD, 0.0, (0.0, 1.0), math.inf, 0, False, "not resolved: no failure to begin from")
    weights = np.concatenate(
        [_weights(margin, proposal, generator, min(_AT_ONCE, samples - first)) for first in range(0, samples, _AT_ONCE)]
    )
    return _estimate(weights, proposal, checks, confidence)


def _clouds(near: Array, failures: Array) -> tuple[Array, Array]:
    """Return means and standard deviations ``(d, C)`` of the failures about each design point, where there are enough."""
    if not 0 < near.shape[1] <= _MOST_CLOUDS:
        return near[:, :0], near[:, :0]
    nearest = (near.T @ failures / np.maximum(np.linalg.norm(near, axis=0), 1e-9)[:, None]).argmax(axis=0)
    groups = [failures[:, nearest == k] for k in range(near.shape[1])]
    groups = [group for group in groups if group.shape[1] >= _FEWEST_IN_CLOUD]
    if not groups:
        return near[:, :0], near[:, :0]
    means = np.array([group.mean(axis=1) for group in groups]).T
    widths = np.array([group.std(axis=1) for group in groups]).T
    return means, np.clip(widths, _NARROWEST, _WIDEST)


def _mixture(
    points: Sequence[DesignPoint], near: Array, clouds: tuple[Array, Array], spread: Array, jumps: Sequence[Jump]
) -> _Proposal:
    """Return the mixture about design points, by their probabilities, clouds and points of the surface, all alike."""
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
    u = proposal.drawn(generator, count)
    failed = margin(u) < 0
    weights = np.zeros(count)
    weights[failed] = 1 / proposal.density(u[:, failed])
    return weights


def _plain_failures(margin: Margin, size: int, generator: np.random.Generator, samples: int) -> int:
    counts = [
        int((margin(generator.standard_normal((size, min(_AT_ONCE, samples - first)))) < 0).sum())
        for first in range(0, samples, _AT_ONCE)
    ]
    return sum(counts)


def _foreseen(ratios: Array, probability: float, samples: int) -> float:
    """Return the coefficient of variation that failures foresee from their φ/q."""
    return math.sqrt(max(float(ratios.mean()) / probability - 1, 0.0) / samples)


def _estimate(weights: Array, proposal: _Proposal, checks: Array, confidence: float) -> Estimate:
    samples, hits = weights.size, int((weights > 0).sum())
    probability, square = float(weights.mean()), float((weights**2).mean())
    if not hits:
        return Estimate(
            METHOD, 0.0, (0.0, 1.0), math.inf, samples, False, f"not resolved: no failure among {samples:,}"
        )
    spread = math.sqrt(max(square - probability**2, 0.0))
    variation, missed = spread / math.sqrt(samples) / probability, 0.0
    if checks.shape[1] >= _FEWEST_CHECKS:
        ratios = np.sort(1 / proposal.density(checks))[::-1]
        count = _unseen(ratios, probability, samples)
        missed = clopper_pearson(count, ratios.size, confidence)[1]
        if count < ratios.size:
            variation = max(variation, _foreseen(ratios[count:], probability, samples))
    effective = float(weights.sum()) ** 2 / float((weights**2).sum())
    largest = float(weights.max() / weights.sum())
    skewness = float(((weights - probability) ** 3).mean()) / max(spread, 1e-300) ** 3
    enough = effective >= FEWEST_EFFECTIVE and largest <= LARGEST_WEIGHT and variation <= LARGEST_VARIATION
    note = ""
    if missed > LARGEST_UNKNOWN:
        enough, note = False, f"not resolved: may miss {100 * missed:.2g} % of the failures"
    elif not enough:
        note = (
            f"not resolved: {hits} failures among {samples:,} samples count as {effective:.3g}, coefficient of variation "
            f"{variation:.2g}"
        )
    low, high = skewed_interval(probability, variation * probability, skewness, samples, confidence)
    return Estimate(METHOD, probability, (low, min(1.0, high / (1 - missed))), variation, samples, enough, note)


def _unseen(ratios: Array, probability: float, samples: int) -> int:
    """Return how many of the failures, those of largest φ/q first, lie where fewer than five samples are to be expected."""
    expected = np.cumsum(samples * probability / (ratios.size * ratios))
    return int((expected < _FEWEST_EXPECTED).sum())
