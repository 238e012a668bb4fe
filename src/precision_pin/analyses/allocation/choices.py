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
from precision_pin.statistics.limits import LIMITED, Limited

SAMPLES: Final = 50_000
"""Fresh samples of a verification."""
# robots times poses of a final round; at least `SAMPLES` and at most four times as many robots
_ROBOTS: Final = 1_000_000
CONFIDENCE: Final = 0.95
"""Confidence of all statements of one allocation together, and of the intervals that the margin is for."""
# probability of a wrong statement reserved for the first-order samples; the exact samples have the rest
_SCREEN_RISK: Final = 0.01
# maximum number of combinations of grades; beyond it the first order chooses
_MOST_CHOICES: Final = 20_000
# choices examined together
_AT_ONCE: Final = 128
# first-order samples of every choice, and of those that the first do not decide
_FIRST_SAMPLES, _SECOND_SAMPLES = 4_096, 32_768
# factor on the difference between first order and exact model that gives the allowance
_ALLOWANCE_FACTOR: Final = 2.0
# approximate number of values in memory at once
_NUMBERS: Final = 2**22


@dataclass(frozen=True, eq=False)
class SampledVerdict:
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
        self._tool_axes = [model.at(pose).posture.tool_axes for pose in task.poses]
        self.chances = tuple(limit for limit in task.limits if isinstance(limit, Specification))
        self.required = np.array([spec.required for spec in self.chances])
        self.many = int(np.clip(_ROBOTS // len(task.poses), SAMPLES, 4 * SAMPLES))
        self._seed, self._look_count = seed, 0
        self.for_samples = for_samples
        # probability with which the samples that the margin is for show every limit at every pose
        chance = 1 - (1 - 0.95) / max(len(self.chances) * len(task.poses), 1)
        ceiling = ((1 - CONFIDENCE - _SCREEN_RISK) / 4) ** (1 / self.many)
        targets = [for_samples and share_to_show(p, for_samples, CONFIDENCE, chance) for p in self.required.tolist()]
        self.aimed = np.array(
            [target if target and target < ceiling else p for target, p in zip(targets, self.required, strict=True)]
        )

    def axes(self, of: Limited) -> Array:
        """Return the axes of the limited components at each pose, ``(k, 6, P)``."""
        return np.stack([of.along(axes) for axes in self._tool_axes], axis=-1)

    def look(self, tolerances: Array, samples: int = SAMPLES) -> SampledVerdict:
        """Return the verdict of fresh samples on tolerances ``(n,)``."""
        self._look_count += 1
        wrong = (1 - CONFIDENCE - _SCREEN_RISK) / (self._look_count * (self._look_count + 1))
        seed = (self._seed + self._look_count) % 2**64
        result = self._sample(tolerances, seed, samples, confidence=1 - wrong)
        fractions, bounds = result.probability, np.moveaxis(result.probability_interval, 1, 0)
        # one place is enough to fail, so that a wrong failure must be excluded at all of them
        upper = upper_ends(np.round(fractions * samples), samples, wrong / (2 * max(fractions.size, 1)))
        required, aimed = self.required[:, None], self.aimed[:, None]
        varies = [[spec.varies for spec in specs.results] for specs in result.specification_results]
        return SampledVerdict(
            np.stack([fractions, *bounds]),
            np.array(varies, dtype=np.bool_),
            is_met=bool((bounds[0] >= required).all()),
            is_failed=bool((upper < required).any()),
            is_clear=bool((bounds[0] >= aimed).all()),
            is_short=bool((upper < aimed).any()),
        )

    def decide(self, tolerances: Array, deadline: float) -> SampledVerdict:
        """Return the verdict, with more samples while it is open and time remains."""
        verdict = self.look(tolerances)
        # factors on the number of fresh samples for a choice of grades that the first samples do not decide
        for times in (4, 16, 64):
            if verdict.is_decided or monotonic() > deadline:
                break
            verdict = self.look(tolerances, times * SAMPLES)
        return verdict

    def same_robots(self, tolerances: Array, seed: int, samples: int) -> Array:
        """Return fractions inside, ``(limits, poses)``, for the robots of a seed; no statement rests on them."""
        return self._sample(tolerances, seed, samples).probability

    def _sample(self, tolerances: Array, seed: int, samples: int, confidence: float = CONFIDENCE) -> PosesResult:
        model, poses = changed_model(self.model, self.task.tolerances, tolerances), list(self.task.poses)
        return sample_poses(
            model, poses, samples=samples, seed=seed, specifications=self.chances, confidence=confidence
        )


@dataclass(frozen=True, eq=False)
class Walk:
    """End of a walk through the choices.

    Attributes:
        widths, verdict: The cheapest choice that is met with the margin, ``(n,)``; else the cheapest that is met, else
            the cheapest that the samples leave open; ``None`` if there is none.
        least_met: Cost of the cheapest choice that is met, with the margin or without; infinite if none is.
        lower_bound: Cost of the cheapest choice that was not shown to fail, infinite if all were.
        is_complete: Whether every cheaper choice was judged.
    """

    widths: Array | None
    verdict: SampledVerdict | None
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
    deadline: float,
) -> Walk | None:
    """Return the cheapest choice that keeps the limits; ``None`` unless all have grades, and for too many choices.

    Args:
        programme, choices, members: Costs and limits of the variables; their grades; the variable of each tolerance.
        parts: First-order error of each tolerance.
        seed: Seed of the first-order samples.
        end: Time at which to stop.
    """
    grids = [g for g in choices if g is not None]
    if len(grids) < len(choices) or not judge.chances or np.prod([float(len(g)) for g in grids]) > _MOST_CHOICES:
        return None
    grid = np.array(list(itertools.product(*grids))).T
    fixed_limits = [limit for limit in programme.limits if limit.kind != "quantile"]
    is_kept = np.ones(grid.shape[1], dtype=bool)
    for limit in fixed_limits:
        is_kept &= limit.measure(grid).max(axis=1) <= limit.limit * (1 + ROUNDING)
    grid = grid[:, is_kept]
    costs = programme.cost_of(grid).sum(axis=0)
    order = np.argsort(costs, kind="stable")
    screen = _Screen(judge, parts, members, seed, grid.shape[1])
    open_at, least_met = np.inf, np.inf
    left_open: tuple[Array, SampledVerdict] | None = None

    def stop_at(cost: float, *, is_complete: bool) -> Walk:
        widths, verdict = left_open or (None, None)
        return Walk(widths, verdict, least_met, min(open_at, cost), is_complete)

    for start in range(0, len(order), _AT_ONCE):
        batch = order[start : start + _AT_ONCE]
        possible = screen.possible(grid[:, batch])
        for k in batch[possible]:
            cost = float(costs[k])
            if monotonic() > deadline:
                return stop_at(cost, is_complete=False)
            verdict = judge.decide(grid[members, k], deadline)
            if verdict.is_failed:
                continue
            is_first_met = verdict.is_met and np.isinf(least_met)
            least_met = min(least_met, cost) if verdict.is_met else least_met
            if left_open is None or is_first_met or verdict.is_clear:
                left_open = grid[:, k], verdict
            if verdict.is_clear:
                return stop_at(cost, is_complete=True)
            open_at = min(open_at, cost)
        if monotonic() > deadline and start + _AT_ONCE < len(order):
            return stop_at(float(costs[order[start + _AT_ONCE]]), is_complete=False)
    return stop_at(np.inf, is_complete=True)


class _Screen:
    """First-order samples with the laws of the sheet, the same robots for every choice."""

    def __init__(self, judge: Judge, parts: Contributions, members: NDArray[np.intp], seed: int, choices: int) -> None:
        self._judge, self._parts, self._members, self._seed = judge, parts, members, seed
        self._tail = _SCREEN_RISK / (2 * max(choices, 1) * max(len(judge.chances) * len(judge.task.poses), 1))
        # allowance for the first-order fraction: this, and twice the difference to the exact model on the same robots
        self._allowance = 1e-3

    def possible(self, t: Array) -> NDArray[np.bool_]:
        """Return a mask of the choices ``(n, m)`` that are not shown to fail."""
        fractions = self._shares(t, _FIRST_SAMPLES)
        # the two models are compared at the choice closest to the required probability
        nearest = int(np.abs(fractions - self._judge.required[:, None]).max(axis=(1, 2)).argmin())
        exact = self._judge.same_robots(t[self._members, nearest], self._seed, _FIRST_SAMPLES)
        self._allowance = max(self._allowance, _ALLOWANCE_FACTOR * float(np.abs(exact - fractions[nearest]).max()))
        is_possible = self._is_possible(fractions, _FIRST_SAMPLES)
        undecided = np.flatnonzero(is_possible)
        if undecided.size:
            is_possible[undecided] = self._is_possible(self._shares(t[:, undecided], _SECOND_SAMPLES), _SECOND_SAMPLES)
        return is_possible

    def _is_possible(self, fractions: Array, samples: int) -> NDArray[np.bool_]:
        upper = upper_ends(np.round(fractions * samples), samples, self._tail) + self._allowance
        return np.asarray((upper >= self._judge.required[:, None]).all(axis=(1, 2)))

    def _shares(self, t: Array, samples: int) -> Array:
        chances, poses = self._judge.chances, range(len(self._judge.task.poses))
        result = np.empty((t.shape[1], len(chances), len(poses)))
        numbers, shared = None, all(draw.scope.value == "unit" for draw in self._judge.model.space.draws)
        for pose in poses:
            if numbers is None or not shared:
                numbers = in_deviations(self._judge.model.space, self._seed, samples, pose)
            for k, spec in enumerate(chances):
                limited = LIMITED[spec.quantity]
                rows, axes = limited.rows, self._judge.axes(limited)[:, :, pose]
                along = axes[:, rows]
                fixed = along @ (
                    self._parts.mean[rows, pose][:, None] + self._parts.unchosen.times(numbers, pose, rows)
                )
                slopes = np.zeros((len(t), len(along), samples))
                for of, part in zip(self._members, self._parts.effects, strict=True):
                    slopes[of] += along @ part.times(numbers, pose, rows)
                batch = max(_NUMBERS // fixed.size, 1)
                for start in range(0, t.shape[1], batch):
                    columns = slice(start, start + batch)
                    errors = fixed[:, None] + np.einsum("nrN,nm->rmN", slopes, t[:, columns])
                    result[columns, k, pose] = ((errors**2).sum(axis=0) <= spec.limit**2).mean(axis=1)
        return result
