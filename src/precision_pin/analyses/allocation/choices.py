"""Choices of grades in the order of their costs, each judged by samples: the cheapest one, and a lower bound.

No choice is rejected by a normal law. Most choices are far too wide; a sample of the first-order error with the laws of
the sheet rejects hundreds of them at a time, and the exact model is sampled for the rest. The error probability is
divided among all statements, so that together they hold with `CONFIDENCE`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.allocation.convex_program import ROUNDING, Programme
from precision_pin.analyses.allocation.problem import Problem
from precision_pin.analyses.allocation.tolerances import Contributions, changed_model, in_deviations
from precision_pin.base.arrays import Array
from precision_pin.model.error_model import ErrorModel
from precision_pin.sampling.many_poses import sample_poses
from precision_pin.sampling.poses_result import PosesResult
from precision_pin.statistics import Specification
from precision_pin.statistics.intervals import share_to_show, upper_ends

SAMPLES: Final = 50_000
"""Fresh samples of a verification."""
# robots times poses of a final round; at least `SAMPLES` and at most four times as many robots
_ROBOTS: Final = 1_000_000
CONFIDENCE: Final = 0.95
"""Confidence of all statements of one allocation together, and of the intervals that the margin is for."""
# probability of a wrong statement reserved for the first-order samples; the exact samples have the rest
_OF_SCREENS: Final = 0.01
_MOST_CHOICES: Final = 20_000
# choices examined together
_AT_ONCE: Final = 128
# first-order samples of every choice, and of those that the first do not decide
_FIRST, _SECOND = 4_096, 32_768
_TIMES_OFF: Final = 2.0
# approximate number of values in memory at once
_NUMBERS: Final = 2**22


@dataclass(frozen=True, eq=False)
class Judged:
    """Verdict of exact-model samples on tolerances.

    Attributes:
        sampled: Fractions inside and the ends of their intervals, ``(3, limits, poses)``.
        varies: Whether the quantity differs from robot to robot, ``(limits, poses)``.
        is_met, is_failed: Whether all lower ends reach the required probability; whether any upper end stays below it.
            Both are false where the samples do not decide.
        is_clear, is_short: The same with the margin.
    """

    sampled: Array
    varies: NDArray[np.bool_]
    is_met: bool
    is_failed: bool
    is_clear: bool
    is_short: bool

    @property
    def is_decided(self) -> bool:
        """Whether more samples would change nothing."""
        return self.is_clear or self.is_failed or (self.is_met and self.is_short)


class Judge:
    """Judges tolerances by fresh samples of the exact model; look n gets 1/(n(n+1)) of the error probability.

    ``aimed`` are the required probabilities plus the margin with which ``for_samples`` samples will show that they are
    kept. There is no margin where no number of samples inside would show that, or where the samples here could not.
    """

    def __init__(self, model: ErrorModel, task: Problem, seed: int, for_samples: int) -> None:
        self.model, self.task = model, task
        self.chances = tuple(one for one in task.limits if isinstance(one, Specification))
        self.required = np.array([one.required for one in self.chances])
        self.many = int(np.clip(_ROBOTS // len(task.poses), SAMPLES, 4 * SAMPLES))
        self._seed, self._looks = seed, 0
        self.for_samples = for_samples
        # probability with which the samples that the margin is for show every limit at every pose
        chance = 1 - (1 - 0.95) / max(len(self.chances) * len(task.poses), 1)
        most = ((1 - CONFIDENCE - _OF_SCREENS) / 4) ** (1 / self.many)
        shown = [for_samples and share_to_show(one, for_samples, CONFIDENCE, chance) for one in self.required.tolist()]
        self.aimed = np.array(
            [share if share and share < most else one for share, one in zip(shown, self.required, strict=True)]
        )

    def look(self, chosen: Array, samples: int = SAMPLES) -> Judged:
        """Return the verdict of fresh samples on tolerances ``(n,)``."""
        self._looks += 1
        wrong = (1 - CONFIDENCE - _OF_SCREENS) / (self._looks * (self._looks + 1))
        seed = (self._seed + self._looks) % 2**64
        found = self._sample(chosen, seed, samples, confidence=1 - wrong)
        shares, ends = found.probability, np.moveaxis(found.probability_interval, 1, 0)
        # one place is enough to fail, so that a wrong failure must be excluded at all of them
        most = upper_ends(np.round(shares * samples), samples, wrong / (2 * max(shares.size, 1)))
        required, aimed = self.required[:, None], self.aimed[:, None]
        varies = [[one.varies for one in each.results] for each in found.specification_results]
        return Judged(
            np.stack([shares, *ends]),
            np.array(varies, dtype=np.bool_),
            is_met=bool((ends[0] >= required).all()),
            is_failed=bool((most < required).any()),
            is_clear=bool((ends[0] >= aimed).all()),
            is_short=bool((most < aimed).any()),
        )

    def decide(self, chosen: Array, end: float) -> Judged:
        """Return the verdict, with more samples while it is open and time remains."""
        found = self.look(chosen)
        # factors on the number of fresh samples for a choice of grades that the first samples do not decide
        for times in (4, 16, 64):
            if found.is_decided or monotonic() > end:
                break
            found = self.look(chosen, times * SAMPLES)
        return found

    def same_robots(self, chosen: Array, seed: int, samples: int) -> Array:
        """Return fractions inside, ``(limits, poses)``, for the robots of a seed; no statement rests on them."""
        return self._sample(chosen, seed, samples).probability

    def _sample(self, chosen: Array, seed: int, samples: int, confidence: float = CONFIDENCE) -> PosesResult:
        model, poses = changed_model(self.model, self.task.tolerances, chosen), list(self.task.poses)
        return sample_poses(
            model, poses, samples=samples, seed=seed, specifications=self.chances, confidence=confidence
        )


@dataclass(frozen=True, eq=False)
class Walk:
    """End of a walk through the choices.

    Attributes:
        chosen, judged: The cheapest choice that is met with the margin, ``(n,)``; else the cheapest that is met, else
            the cheapest that the samples leave open; ``None`` if there is none.
        least_met: Cost of the cheapest choice that is met, with the margin or without; infinite if none is.
        lower_bound: Cost of the cheapest choice that was not shown to fail, infinite if all were.
        is_complete: Whether every cheaper choice was judged.
    """

    chosen: Array | None
    judged: Judged | None
    least_met: float
    lower_bound: float
    is_complete: bool


def walk(
    programme: Programme,
    choices: Sequence[Array | None],
    members: NDArray[np.intp],
    parts: Contributions,
    judge: Judge,
    seed: int,
    end: float,
) -> Walk | None:
    """Return the cheapest choice that keeps the limits; ``None`` unless all have grades, and for too many choices.

    Args:
        programme, choices, members: Costs and limits of the variables; their grades; the variable of each tolerance.
        parts: First-order error of each tolerance.
        seed: Seed of the first-order samples.
        end: Time at which to stop.
    """
    listed = [one for one in choices if one is not None]
    if len(listed) < len(choices) or not judge.chances or np.prod([float(len(one)) for one in listed]) > _MOST_CHOICES:
        return None
    grid = np.array(list(itertools.product(*listed))).T
    still = [one for one in programme.limits if one.kind != "quantile"]
    kept = np.ones(grid.shape[1], dtype=bool)
    for one in still:
        kept &= one.measure(grid).max(axis=1) <= one.limit * (1 + ROUNDING)
    grid = grid[:, kept]
    costs = programme.cost_of(grid).sum(axis=0)
    order = np.argsort(costs, kind="stable")
    screen = _Screen(judge, parts, members, seed, grid.shape[1])
    open_at, least_met = np.inf, np.inf
    left_open: tuple[Array, Judged] | None = None

    def stop_at(cost: float, *, is_complete: bool) -> Walk:
        chosen, judged = left_open or (None, None)
        return Walk(chosen, judged, least_met, min(open_at, cost), is_complete)

    for first in range(0, len(order), _AT_ONCE):
        some = order[first : first + _AT_ONCE]
        possible = screen.possible(grid[:, some])
        for k in some[possible]:
            cost = float(costs[k])
            if monotonic() > end:
                return stop_at(cost, is_complete=False)
            judged = judge.decide(grid[members, k], end)
            if judged.is_failed:
                continue
            is_first_met = judged.is_met and np.isinf(least_met)
            least_met = min(least_met, cost) if judged.is_met else least_met
            if left_open is None or is_first_met or judged.is_clear:
                left_open = grid[:, k], judged
            if judged.is_clear:
                return stop_at(cost, is_complete=True)
            open_at = min(open_at, cost)
        if monotonic() > end and first + _AT_ONCE < len(order):
            return stop_at(float(costs[order[first + _AT_ONCE]]), is_complete=False)
    return stop_at(np.inf, is_complete=True)


class _Screen:
    """First-order samples with the laws of the sheet, the same robots for every choice."""

    def __init__(self, judge: Judge, parts: Contributions, members: NDArray[np.intp], seed: int, choices: int) -> None:
        self._judge, self._parts, self._members, self._seed = judge, parts, members, seed
        self._tail = _OF_SCREENS / (2 * max(choices, 1) * max(len(judge.chances) * len(judge.task.poses), 1))
        # allowance for the first-order fraction: this, and twice the difference to the exact model on the same robots
        self._off = 1e-3

    def possible(self, t: Array) -> NDArray[np.bool_]:
        """Return which of the choices ``(n, m)`` are not shown to fail."""
        shares = self._shares(t, _FIRST)
        # the two models are compared at the choice closest to the required probability
        nearest = int(np.abs(shares - self._judge.required[:, None]).max(axis=(1, 2)).argmin())
        exact = self._judge.same_robots(t[self._members, nearest], self._seed, _FIRST)
        self._off = max(self._off, _TIMES_OFF * float(np.abs(exact - shares[nearest]).max()))
        found = self._is_possible(shares, _FIRST)
        left = np.flatnonzero(found)
        if left.size:
            found[left] = self._is_possible(self._shares(t[:, left], _SECOND), _SECOND)
        return found

    def _is_possible(self, shares: Array, samples: int) -> NDArray[np.bool_]:
        most = upper_ends(np.round(shares * samples), samples, self._tail) + self._off
        return np.asarray((most >= self._judge.required[:, None]).all(axis=(1, 2)))

    def _shares(self, t: Array, samples: int) -> Array:
        chances, poses = self._judge.chances, range(len(self._judge.task.poses))
        result = np.empty((t.shape[1], len(chances), len(poses)))
        numbers, shared = None, all(draw.scope.value == "unit" for draw in self._judge.model.space.draws)
        for pose in poses:
            if numbers is None or not shared:
                numbers = in_deviations(self._judge.model.space, self._seed, samples, pose)
            for k, one in enumerate(chances):
                rows = list(one.components)
                still = self._parts.mean[rows, pose][:, None] + self._parts.rest.times(numbers, pose, rows)
                moved = np.zeros((len(t), len(rows), samples))
                for of, part in zip(self._members, self._parts.moved, strict=True):
                    moved[of] += part.times(numbers, pose, rows)
                many = max(_NUMBERS // still.size, 1)
                for first in range(0, t.shape[1], many):
                    some = slice(first, first + many)
                    errors = still[:, None] + np.einsum("nrN,nm->rmN", moved, t[:, some])
                    result[some, k, pose] = ((errors**2).sum(axis=0) <= one.limit**2).mean(axis=1)
        return result
