"""Cheapest tolerances that keep specifications at every pose: first order, then verified on the exact model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from time import monotonic
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.allocation.allocation_result import (
    AllocatedLimit,
    AllocationResult,
    Basis,
    ErrorParts,
    error_parts,
    tightest_of,
)
from precision_pin.analyses.allocation.choices import Judge, Judged, Walk, walk
from precision_pin.analyses.allocation.convex_program import Limit, Programme, Solution
from precision_pin.analyses.allocation.costs import Tolerance
from precision_pin.analyses.allocation.grades import MOST_POINTS, pareto_front, solve
from precision_pin.analyses.allocation.problem import Bound, Problem, common_grades, read_problem, unchosen
from precision_pin.analyses.allocation.scaling import (
    Contributions,
    NoScaleError,
    changed_model,
    contributions,
    in_deviations,
)
from precision_pin.analyses.arguments import check_common
from precision_pin.analyses.provenance import Provenance
from precision_pin.base.arguments import check_number, check_whole
from precision_pin.base.arrays import Array
from precision_pin.base.call_warnings import warns_at_end
from precision_pin.base.errors import Finding
from precision_pin.base.progress import steps_to
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.verdict_grounds import exact_findings, grounds_at
from precision_pin.robot.chain import pose_findings
from precision_pin.statistics import COMPONENTS, QUANTITIES, Specification

_ROUNDS: Final = 6
# share of a limit, first order, from which it may hold the choice
_HOLDS: Final = 0.9
_SAME: Final = 1e-6
# scores of the normal law by which the aim moves more each round, while the samples do not change their mind
_STRIDE: Final = 0.4
# probability that may be left between the lower end of an interval and what is required
_SPARE: Final = 0.002
SHOWN_BY: Final = 100_000
"""Samples that `analyze` takes where nothing else is asked."""
_MOST_SHOWN: Final = 10**9
_SHAPE_SAMPLES: Final = 8_192
# skewness and excess kurtosis (of a uniform law -1.2) up to which a law is about normal
_MOST_SKEWED, _MOST_CURVED = 0.3, 1.35


@warns_at_end
def allocate(
    error_model: ErrorModel,
    /,
    problem: Mapping[str, Any] | None = None,
    *,
    seed: int = 0,
    seconds: float = 60.0,
    pareto: int = 0,
    for_samples: int = SHOWN_BY,
    findings: Sequence[Finding] = (),
    progress: Callable[[int], None] | bool | None = None,
) -> AllocationResult:
    """Return the cheapest tolerances that keep every limit at every pose.

    The least cost is that of the first-order model with a normal error. The exact model with these tolerances is then
    sampled; specifications are held with a margin, so that ``for_samples`` other samples will show them too. Where the lower
    end of an interval misses the probability with its margin, or has much to spare, another one is aimed at and the tolerances
    are found anew, verified with fresh samples. The intervals of all rounds hold together.

    Args:
        error_model: Model read from a sheet or a dictionary.
        problem: ``tolerances``, ``specs`` and ``poses`` as the sheet's ``allocate:`` has them; by default the sheet's
            own.
        seed: 64-bit seed of the samples.
        seconds: Time for the choice of grades, and again for the front; then the best found is returned, with the gap
            that is left.
        pareto: How many points of the front of cost against accuracy to find: 0, or 2 to 1000.
        for_samples: Number of samples that are to show, with a chance of 95 %, that all specifications are met: as many
            as ``analyze`` takes. 0 for no margin.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Function called with the steps done since its last call, :func:`allocation_steps` in all; ``True``
            shows a bar.

    Raises:
        InputError: A wrong problem, or a tolerance with which the error does not scale.
        UnknownNameError: No such pose, source or key.
    """
    known = check_common(error_model, seed=seed, findings=findings, progress=progress)
    check_number("the seconds of an allocation", seconds, "a number above zero", lambda value: value > 0)
    if isinstance(pareto, bool) or not isinstance(pareto, int) or pareto != 0:
        check_whole("the number of points of the front", pareto, 2, MOST_POINTS, f"of 0, or from 2 to {MOST_POINTS}")
    check_whole("the samples that a margin is for", for_samples, 0, _MOST_SHOWN)
    task = read_problem(error_model, problem)
    with steps_to(progress, allocation_steps(task, pareto), "steps") as advance:
        bounded = any(isinstance(one, Bound) and one.kind == "worst_case" for one in task.limits)
        try:
            parts = contributions(error_model, task.tolerances, task.poses, worst_case=bounded, advance=advance)
        except NoScaleError as error:
            raise unchosen(error_model, error) from None
        judge = Judge(error_model, task, int(seed), int(for_samples))
        search = _Search(task, parts, _members(task.tolerances), judge, monotonic() + seconds)
        choices, members, end = search.choices, search.members, search.end
        programme = search.programme(judge.aimed.tolist())
        walked = walk(programme, choices, members, parts, judge, int(seed), end)
        if walked is not None and walked.is_complete:
            found = search.end_of(programme, walked)
            advance(_ROUNDS)
        else:
            rounds = search.rounds(advance)
            if (rounds[-1].solution is None or not rounds[-1].is_met) and (judge.aimed > judge.required).any():
                # what can be kept, but not with a margin
                judge.aimed = judge.required
                rounds += search.rounds(lambda _: None)
            found = rounds[-1]
            bound, basis = search.bound(rounds)
            if walked is not None:
                bound, basis = walked.lower_bound, "samples"
            if found.solution is None:
                found = replace(found, basis=basis)
            else:
                least = None if bound is None else min(bound, found.cost)
                found = replace(found, solution=replace(found.solution, lower_bound=least), basis=basis)
                if found.is_clear and (margin := judge.aimed - judge.required).any():
                    held = [one.probability for one in found.programme.limits if one.kind == "quantile"]
                    without = search.programme((np.array(held) - margin).tolist())
                    near = None if found.solution is None else found.solution.t
                    cheaper = solve(without, choices, end - monotonic(), lambda _: None, near)
                    found = replace(found, least_met=np.inf if cheaper is None else cheaper.cost)
        result = _result(search, found, int(seed), known)
        if not pareto:
            return result
        return replace(result, front=pareto_front(found.programme, choices, members, pareto, seconds, advance))


def allocation_steps(problem: Problem, pareto: int = 0) -> int:
    """Return the number of steps that ``progress`` is told of."""
    return len(problem.tolerances) + _ROUNDS + pareto


@dataclass(frozen=True, eq=False)
class _Attempt:
    """Tolerances of one round, what the samples say, what the bound of the cost rests on, and the cost without a margin."""

    programme: Programme
    solution: Solution | None
    chosen: Array
    judged: Judged | None = None
    basis: Basis = "proof"
    least_met: float = np.inf

    @property
    def is_clear(self) -> bool:
        return self.judged is not None and self.judged.is_clear

    @property
    def is_met(self) -> bool:
        return self.judged is not None and self.judged.is_met

    @property
    def cost(self) -> float:
        return np.inf if self.solution is None else self.solution.cost


@dataclass(frozen=True, eq=False)
class _Search:
    """Search for the cheapest tolerances by the first order; ``members`` has the group of each tolerance, ``end`` the time."""

    task: Problem
    parts: Contributions
    members: NDArray[np.intp]
    judge: Judge
    end: float

    @cached_property
    def together(self) -> list[list[Tolerance]]:
        """Tolerances of each group."""
        groups = range(int(self.members.max()) + 1)
        return [[one for one, own in zip(self.task.tolerances, self.members, strict=True) if own == g] for g in groups]

    @cached_property
    def choices(self) -> list[Array | None]:
        """Grades of each group."""
        return [common_grades(own) for own in self.together]

    def programme(self, aims: Sequence[float]) -> Programme:
        """Return costs and limits, with specifications held at these probabilities."""
        parts, members, together = self.parts, self.members, self.together
        listed = list(zip(together, self.choices, strict=True))
        low = np.array([max(one.low for one in own) if grades is None else grades[0] for own, grades in listed])
        high = np.array([min(one.high for one in own) if grades is None else grades[-1] for own, grades in listed])
        costs = [[one.cost for one in own] for own in together]

        def grouped(array: Array) -> Array:
            return np.stack([array[members == g].sum(axis=0) for g in range(len(together))])

        squares, reaches = grouped(parts.by_tolerance), grouped(parts.reach_by_tolerance)
        # correlated tolerances of one group are one square
        of = np.append(members, len(costs))[parts.pairs]
        for group, part in zip(of[:, 0][of[:, 0] == of[:, 1]], parts.by_pair[of[:, 0] == of[:, 1]], strict=True):
            squares[group] += part
        pairs = of[of[:, 0] != of[:, 1]]
        covariances = np.concatenate([squares, parts.by_pair[of[:, 0] != of[:, 1]]])
        limits, left = [], iter(aims)
        for one in self.task.limits:
            rows = list(one.components)
            kind, probability = (one.kind, 0.0) if isinstance(one, Bound) else ("quantile", next(left))
            grid = np.ix_(rows, rows)
            if kind == "worst_case":
                fixed, each, products = parts.reach[rows][:, None], reaches[:, rows][:, :, None], pairs[:0]
            else:
                fixed, each, products = parts.covariance[grid], np.stack([part[grid] for part in covariances]), pairs
            limits.append(Limit(kind, one.limit, probability, tuple(rows), parts.mean[rows], fixed, each, products))
        return Programme(costs, low, high, limits)

    def end_of(self, programme: Programme, walked: Walk) -> _Attempt:
        """Return the choice at which the walk ended; the narrowest one where none keeps the limits."""
        if walked.chosen is None:
            chosen = programme.least[self.members]
            return _Attempt(programme, None, chosen, self.judge.look(chosen), "samples")
        solution = replace(programme.priced(walked.chosen), lower_bound=walked.lower_bound)
        chosen = walked.chosen[self.members]
        return _Attempt(programme, solution, chosen, walked.judged, "samples", walked.least_met)

    def rounds(self, advance: Callable[[int], None]) -> list[_Attempt]:
        """Return the rounds by the first order, each aimed at what the samples of the one before say; the best is the last."""
        aims = self.judge.aimed.tolist()
        rounds: list[_Attempt] = []
        found: _Attempt | None = None
        tried: list[tuple[list[float], Array]] = []
        for _ in range(_ROUNDS):
            programme = self.programme(aims)
            near = None if found is None or found.solution is None else found.solution.t
            solution = solve(programme, self.choices, self.end - monotonic(), advance, near)
            # what cannot be met is verified with the tolerances that exceed it least
            chosen = (programme.least if solution is None else solution.t)[self.members]
            made = _Attempt(programme, solution, chosen)
            known = (
                found.judged if found is not None and np.allclose(chosen, found.chosen, rtol=_SAME, atol=0) else None
            )
            if not self.judge.chances or (known is not None and known.is_clear and solution is not None):
                rounds += [] if self.judge.chances else [made]
                found = found or made
                break
            # the narrowest ones again, where the first order still refuses what the samples show to be kept
            is_known = known is not None and known.is_clear
            made = replace(made, judged=known if is_known else self.judge.look(chosen, self.judge.many))
            rounds.append(made)
            advance(1)
            assert made.judged is not None
            spare = made.judged.sampled[1].min(axis=1) - self.judge.aimed
            # with the margin before without, then the cheaper; the last one where none is met
            better = found is not None and (made.is_clear, -made.cost) > (found.is_clear, -found.cost)
            if found is None or not found.is_met or (made.is_met and better):
                found = made
            # of several limits only those that hold the choice have something to give back
            holds = [
                one.measure(programme.least[:, None] if solution is None else solution.t[:, None]).max()
                > _HOLDS * one.limit
                for one in programme.limits
                if one.kind == "quantile"
            ]
            # the first order may refuse what the samples show to be kept
            if (solution is None and not made.is_clear) or (made.is_clear and not (holds & (spare > _SPARE)).any()):
                break
            tried.append((aims, spare))
            history = [np.array(one).T for one in zip(*tried, strict=True)]
            aims = [
                _next_aim(*own) if (held if made.is_clear else own[1][-1] < 0) else float(own[0][-1])
                for *own, held in zip(*history, holds, strict=True)
            ]
        assert found is not None
        advance(_ROUNDS - len(rounds) if self.judge.chances else _ROUNDS)
        return [*(one for one in rounds if one is not found), found]

    def bound(self, rounds: Sequence[_Attempt]) -> tuple[float | None, Basis]:
        """Return a lower bound of the cost of all that keeps the limits as they are stated, not as they were aimed at.

        With specifications it is the bound of the first order, whose probability is lowered by as much as the samples of any
        round may exceed it. Of laws that are far from a normal one that says nothing about other tolerances: no bound.
        """
        found = rounds[-1]
        if not self.judge.chances:
            return None if found.solution is None else found.solution.lower_bound, "proof"
        if found.solution is None or not _near_normal(self.judge, self.parts):
            return None, "normal law"
        excess = np.zeros(len(self.judge.chances))
        for one in rounds:
            t = one.programme.least if one.solution is None else one.solution.t
            limits = [limit for limit in one.programme.limits if limit.kind == "quantile"]
            normal = np.array([limit.probabilities(t) for limit in limits])
            assert one.judged is not None
            excess = np.maximum(excess, (one.judged.sampled[2] - normal).max(axis=1))
        programme = self.programme((self.judge.required - excess).tolist())
        wider = solve(programme, self.choices, max(self.end - monotonic(), 0.0), lambda _: None, found.solution.t)
        return (None if wider is None else wider.lower_bound), "normal law"


def _near_normal(judge: Judge, parts: Contributions) -> bool:
    """Return whether the laws of the chosen tolerances are about as near to a normal one as a uniform one is."""
    columns = np.unique(np.concatenate([one.columns for one in parts.moved]))
    numbers = in_deviations(judge.model.space, 0, _SHAPE_SAMPLES)[columns]
    skewness, excess = (numbers**3).mean(axis=1), (numbers**4).mean(axis=1) - 3
    return bool((np.abs(skewness) < _MOST_SKEWED).all() and (np.abs(excess) < _MOST_CURVED).all())


def _next_aim(aims: Array, spares: Array) -> float:
    """Return the probability to aim at after rounds in which the lower ends of the intervals had this much to spare.

    Between an aim that was too low and one that was high enough it is interpolated, in scores of the normal law. Without both
    the step grows from round to round: of a law far from normal it may have to be of another size.
    """
    aim, spare, short = float(aims[-1]), float(spares[-1]), spares < 0
    if short.any() and not short.all():
        low, high = int(np.where(short, aims, -1.0).argmax()), int(np.where(short, 2.0, aims).argmin())
        share = np.clip((_SPARE / 2 - spares[low]) / (spares[high] - spares[low]), 0.25, 0.75)
        ends = special.ndtri(aims[[low, high]])
        return float(special.ndtr(ends[0] + share * (ends[1] - ends[0])))
    stride = _STRIDE * (len(aims) - 1)
    if spare < 0:
        return max(min(aim - spare * 1.25, (1 + aim) / 2), float(special.ndtr(special.ndtri(aim) + stride)))
    step = max(aim - max(spare - _SPARE / 2, 0.0), 0.5 * aim)
    return min(step, float(special.ndtr(special.ndtri(aim) - stride)))


def _members(tolerances: Sequence[Tolerance]) -> NDArray[np.intp]:
    """Return the number of the group of each tolerance; one without a group has its own."""
    names = [one.group or f"\0{k}" for k, one in enumerate(tolerances)]
    order = list(dict.fromkeys(names))
    return np.array([order.index(name) for name in names])


def _result(search: _Search, found: _Attempt, seed: int, findings: tuple[Finding, ...]) -> AllocationResult:
    task, members, judge, model = search.task, search.members, search.judge, search.judge.model
    values, _ = model.configurations(list(task.poses))
    grounds = grounds_at(model, values, task.poses)
    programme, solution = found.programme, found.solution
    judged, places, row = [], [], 0
    t = programme.least if solution is None else solution.t
    for k, one in enumerate(task.limits):
        measure = programme.limits[k].measure(t[:, None])[0]
        worst = int(measure.argmax()) % len(task.poses)
        places.append(int(measure.argmax()))
        sampled: dict[str, Any] = {}
        if isinstance(one, Specification):
            assert found.judged is not None
            worst = int(found.judged.sampled[1, row].argmin())
            share, low, high = found.judged.sampled[:, row, worst].tolist()
            margin = float(judge.aimed[row] - judge.required[row]) if found.is_clear else 0.0
            sampled = {"required": one.required, "probability": share, "interval": (low, high), "margin": margin}
            sampled["varies"] = bool(found.judged.varies[row, worst])
            row += 1
        judged.append(
            AllocatedLimit(
                kind=programme.limits[k].kind,
                quantity=_quantity(one),
                limit=one.limit,
                aimed=None if found.basis == "samples" else programme.limits[k].probability or None,
                first_order=float(measure.max()),
                worst_pose=task.poses[worst],
                shadow_price=None if solution is None else solution.prices[k],
                grounds=grounds,
                **sampled,
            )
        )
    width = np.zeros(len(programme.low)) if solution is None else solution.bound_prices
    graded = np.array([search.choices[own] is not None for own in members])
    cost = np.array([float(one.cost.at(value)) for one, value in zip(task.tolerances, found.chosen, strict=True)])
    return AllocationResult(
        provenance=Provenance.of(model, seed),
        tolerances=task.tolerances,
        after=found.chosen,
        costs=cost,
        shadow_prices=np.where(graded, 0.0, width[members]),
        lower_bound=None if solution is None else solution.lower_bound,
        bound_basis=found.basis,
        limits=tuple(judged),
        for_samples=judge.for_samples,
        margin_cost=max(float(cost.sum()) - found.least_met, 0.0) if np.isfinite(found.least_met) else None,
        parts=_parts(model, task, found, places[tightest_of(judged)], tightest_of(judged)),
        poses=task.poses,
        feasible=solution is not None or all(one.is_kept for one in judged),
        grounds=grounds,
        findings=(
            *findings,
            *pose_findings(model.chain, values, task.poses),
            *exact_findings(model, values, model.approaches_of(list(task.poses), values)),
        ),
    )


def _parts(model: ErrorModel, task: Problem, found: _Attempt, place: int, limit: int) -> ErrorParts:
    """Return what causes the error at a place of a limit; those of a worst case are rows times poses."""
    one, rows = task.limits[limit], found.programme.limits[limit].rows
    worst_case = isinstance(one, Bound) and one.kind == "worst_case"
    row, pose = divmod(place, len(task.poses))
    if worst_case:
        rows = (rows[row],)
    name = _quantity(one) if not worst_case else QUANTITIES[COMPONENTS[rows[0]]]
    before = np.array([tolerance.before for tolerance in task.tolerances])
    models = [model, *(changed_model(model, task.tolerances, values) for values in (found.chosen, 2 * before))]
    return error_parts(models, task.poses[pose], rows, name, worst_case=worst_case)


def _quantity(one: Specification | Bound) -> str:
    if isinstance(one, Specification):
        return one.quantity
    part = "position" if one.is_position else "attitude"
    return f"{part}.norm" if one.kind == "rms" else part
