"""Cheapest tolerances that keep specifications at every pose: first order, then verified on the exact model."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from time import monotonic
from typing import Any, ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.allocation.choices import Judge, SampledVerdict, walk
from precision_pin.analyses.allocation.convex_program import (
    MOST_POINTS,
    FrontPoint,
    Limit,
    Programme,
    Solution,
    pareto_front,
    solve,
)
from precision_pin.analyses.allocation.problem import Bound, Problem, common_grades, no_scale_error, read_problem
from precision_pin.analyses.allocation.tolerances import (
    Contributions,
    NoScaleError,
    Tolerance,
    changed_model,
    contributions,
    in_deviations,
)
from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.result import AnalysisResult
from precision_pin.analyses.shares import by_draw, reaches
from precision_pin.base.arguments import check_number, check_whole
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError, warns_at_end
from precision_pin.base.progress import steps_to
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.render.html import preformatted
from precision_pin.robot.chain import pose_findings
from precision_pin.sampling.run import check_common
from precision_pin.sampling.verdict_grounds import exact_findings, grounds_at
from precision_pin.statistics import COMPONENTS, NO_GROUNDS, QUANTITIES, Grounds, Specification
from precision_pin.statistics.limits import LIMITED
from precision_pin.statistics.summary import Verdict, judge

Basis = Literal["proof", "samples", "normal law"]
"""Basis of a lower bound of the cost."""


@dataclass(frozen=True)
class AllocatedLimit(Record):
    """A limit at its worst pose, with the chosen tolerances.

    Attributes:
        kind: ``"quantile"``, ``"rms"`` or ``"worst_case"``.
        quantity, limit, required: Limited quantity, its limit in m or rad, and the required probability of a quantile.
        aimed: Probability at which the first-order quantile was held, so that samples show the required one; ``None``
            where every choice of grades was sampled.
        first_order: Largest quantile, root mean square or worst case over the poses, by the first-order model.
        worst_pose: By the samples of a quantile, else by the first-order model.
        shadow_price: Decrease of the least cost per m or rad of a limit, summed over the poses; ``None`` if infeasible.
        probability, interval: Fraction of fresh exact samples inside, and its 95 % interval; ``None`` without
            probability.
        varies: Whether the quantity differs from robot to robot.
        margin: Excess over the required probability, so that ``for_samples`` samples will show that it is kept.
        grounds: Why the limit cannot be judged, and what is taken as exact.
    """

    KEYS: ClassVar[Keys] = (
        *("kind", "quantity", "limit", "required", "aimed", "first_order", "worst_pose", "shadow_price"),
        *("probability", "interval", "met", "verdict", "margin"),
    )

    kind: str
    quantity: str
    limit: float
    aimed: float | None
    first_order: float
    worst_pose: str
    shadow_price: float | None
    required: float | None = None
    probability: float | None = None
    interval: tuple[float, float] | None = None
    varies: bool = True
    margin: float = 0.0
    grounds: Grounds = NO_GROUNDS

    @property
    def is_kept(self) -> bool:
        """Whether it is kept, regardless of whether it may be judged."""
        return self._limit_verdict == "met"

    @property
    def verdict(self) -> Verdict:
        """Verdict by the interval of the samples; for a limit without probability, by the first order."""
        return "not judged" if self.grounds.not_judged else self._limit_verdict

    @property
    def met(self) -> bool:
        """True if the verdict is ``"met"``."""
        return self.verdict == "met"

    @property
    def _limit_verdict(self) -> Verdict:
        if self.interval is None or self.required is None:
            keeps = self.first_order <= self.limit * (1 + 1e-9)
            return judge(holds=keeps, fails=not keeps)
        low, high = self.interval
        return judge(holds=low >= self.required, fails=high < self.required, varies=self.varies)


def tightest_of(limits: Sequence[AllocatedLimit]) -> int:
    """Return the index of the unkept limit that the first order exceeds most; else of the one with least reserve."""
    return max(range(len(limits)), key=lambda k: (not limits[k].is_kept, limits[k].first_order / limits[k].limit))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class AllocationResult(AnalysisResult):
    """Cheapest tolerances that keep every limit, or the narrowest ones where none do.

    Attributes:
        tolerances: Tolerances to choose, with the values of the sheet.
        after, costs: Chosen tolerances (SI) and the cost of each, ``(n,)``.
        shadow_prices: Saving per SI unit of an upper bound; negative at the lower bound, zero between and for grades.
        lower_bound: No tolerances that keep the limits as stated cost less. ``None`` if infeasible, where the time for
            a choice of grades ran out first, and for specifications with a law far from normal or a norm below 92 %.
        bound_basis: ``"proof"`` for limits of the first order; ``"samples"`` where every cheaper choice of grades was
            sampled and shown to fail, with 95 % confidence; else ``"normal law"``. The last assumes that no other
            tolerances exceed the normal law of the first order by more than the samples show, and that the variances
            that keep a norm's quantile form a convex set.
        limits: The limits with the chosen tolerances.
        for_samples: Number of samples meant to show that the specifications are met; 0 for no margin.
        margin_cost: Cost of the margin: by samples of the cheapest choice without one, else by the first order;
            ``None`` without margin and where unknown.
        parts: Contributions to the error at the worst pose of the tightest limit, before and after.
        poses: Names of the poses.
        grounds: Why the limits cannot be judged, and what is taken as exact.
        feasible: Whether tolerances within the bounds keep the limits; if not, the narrowest ones are given.
        front: Points of the front of cost against accuracy, if requested.
    """

    schema: ClassVar[str] = "precision-pin/allocation/1"

    KEYS: ClassVar[Keys] = (
        *("*head", "tolerances=tolerance_entries", "cost", "cost_before", "lower_bound", "lower_bound_is_proven"),
        *("lower_bound_basis=bound_basis", "gap", "for_samples", "margin_cost", "specs=limits", "parts", "poses"),
        *("feasible", "met", "*grounds", "pareto=front", "findings"),
    )

    tolerances: tuple[Tolerance, ...]
    after: Array
    costs: Array
    shadow_prices: Array
    lower_bound: float | None
    bound_basis: Basis
    limits: tuple[AllocatedLimit, ...]
    for_samples: int
    margin_cost: float | None
    parts: ErrorParts
    poses: tuple[str, ...]
    feasible: bool
    front: tuple[FrontPoint, ...] = ()
    grounds: Grounds = NO_GROUNDS

    @property
    def cost(self) -> float:
        """Sum of the costs."""
        return float(self.costs.sum())

    @property
    def cost_before(self) -> float:
        """Sum of the costs of the sheet's tolerances."""
        return float(sum(float(tolerance.cost.at(np.array(tolerance.before))) for tolerance in self.tolerances))

    @property
    def gap(self) -> float | None:
        """Largest fraction of the cost, margin included, that could still be saved; ``None`` if a limit is not met."""
        if self.lower_bound is None or not self.met:
            return None
        return max(self.cost - self.lower_bound, 0.0) / max(abs(self.cost), 1e-300)

    @property
    def met(self) -> bool:
        """Whether every limit is met; false where a pose is outside joint limits, unless the model is judged there."""
        return self.feasible and not self.grounds.not_judged and all(limit.met for limit in self.limits)

    @property
    def tightest(self) -> AllocatedLimit:
        """The limit that is exceeded most; where all are kept, the one with least reserve."""
        return self.limits[tightest_of(self.limits)]

    @property
    def changes(self) -> dict[str, str]:
        """The chosen tolerances by path, as for :meth:`ErrorModel.with_` and ``--set``."""
        return {tol.path: tol.written(width) for tol, width in zip(self.tolerances, self.after.tolist(), strict=True)}

    @property
    def lower_bound_is_proven(self) -> bool:
        """Whether the lower bound rests on a proof."""
        return self.bound_basis == "proof"

    @property
    def tolerance_entries(self) -> list[dict[str, Any]]:
        """The tolerances as in the JSON."""
        rows = zip(self.after.tolist(), self.costs.tolist(), self.shadow_prices.tolist(), strict=True)
        return [
            {"path": tol.path, "unit": tol.quantity.si, "before": tol.before, "after": after}
            | {"grade": tol.grade(after) or None}
            | {"cost": cost, "shadow_price": price}
            for tol, (after, cost, price) in zip(self.tolerances, rows, strict=True)
        ]

    def _repr_html_(self) -> str:
        return preformatted(self._output("table:allocation_table")(self))

    @property
    def summary(self) -> str:
        """Text of `repr` after the arm."""
        return f"{len(self.tolerances)} tolerances, cost {self.cost:.6g}"


def allocated_sheet(model: ErrorModel, result: AllocationResult, folder: Path) -> str:
    """Return the sheet of a model with the chosen tolerances, rounded down to four digits in one unit for each kind.

    The robot's file is named relative to ``folder``, where the sheet will be saved.

    Raises:
        InputError: The model was not read from a sheet.
    """
    kinds = {tolerance.quantity: tolerance.unit for tolerance in reversed(result.tolerances)}
    rows = zip(result.tolerances, result.after.tolist(), strict=True)
    texts = {tolerance.path: tolerance.rounded(size, kinds[tolerance.quantity]) for tolerance, size in rows}
    changed = model.with_(texts).sheet
    if changed is None or changed.contents is None:
        raise InputError("the model was not read from a sheet or a dictionary")
    return changed.contents.written(folder)


MEAN: Final = "constant part"
"""Name of the error with every component at its mean."""
TOGETHER: Final = "correlated draws"
"""Name of a group of correlated draws too large to be separated."""
# part of the error, relative to the largest, that counts as rounding
_ROUNDING: Final = 1e-9
# standard deviations at which the worst case of a normal law ends
_DEVIATIONS: Final = 3.0


@dataclass(frozen=True)
class SourcePart(Record):
    """Contribution of a source, the root mean square (worst case: largest deviation), m or rad.

    Attributes:
        source: Label of the source, or of those that share a draw; or `MEAN`.
        is_chosen: Whether the allocation chooses any of its tolerances.
    """

    KEYS: ClassVar[Keys] = ("source", "before", "after", "chosen=is_chosen")

    source: str
    before: float
    after: float
    is_chosen: bool


@dataclass(frozen=True)
class ErrorParts(Record):
    """Parts of the first-order error at the worst pose of the tightest limit, largest first.

    Attributes:
        quantity: ``position.norm``, ``attitude.x`` and so on.
        kind: ``"rms"``: squares of the parts add to the mean square; ``"worst_case"``: the parts add.
    """

    pose: str
    quantity: str
    kind: str
    sources: tuple[SourcePart, ...]

    def shares(self) -> list[float]:
        """Return the fraction of each part in the mean square or the worst case, with the chosen tolerances."""
        powers = [part.after ** (1 if self.kind == "worst_case" else 2) for part in self.sources]
        return [power / (sum(powers) or 1.0) for power in powers]


def _norm_parts(model: ErrorModel, pose: str, rows: list[int], worst_case: bool) -> dict[str, float]:
    at = model.at(pose)
    powers: Array = reaches(at, _DEVIATIONS)[:, rows[0]] if worst_case else by_draw(at)[:, rows].sum(axis=1)
    result: dict[str, float] = {}
    for owners, part in zip(model.owners, powers.tolist(), strict=True):
        # correlated groups of more than twelve draws are not split
        name = ", ".join(owners) if np.isfinite(part) else TOGETHER
        result[name] = result.get(name, 0.0) + (part if np.isfinite(part) else 0.0)
    if not worst_case:
        if TOGETHER in result:
            result[TOGETHER] = float(np.diag(at.covariance)[rows].sum()) - sum(result.values())
        result = {name: float(np.sqrt(max(part, 0.0))) for name, part in result.items()}
    return {MEAN: float(np.linalg.norm(at.error_at_means[rows]))} | result


# maximum number of rounds of aim, tolerances and samples
_ROUNDS: Final = 6
# relative difference up to which two rounds chose the same tolerances
_SAME_WIDTH: Final = 1e-6
# normal scores by which the aim moves more in each round, while the verdict of the samples does not change
_STRIDE: Final = 0.4
# probability that may remain between the lower end of an interval and the required one
_SPARE: Final = 0.002
SHOWN_BY: Final = 100_000
"""Default number of samples of `analyze`."""
# maximum number of samples that a margin can be for
_MAX_SHOWN: Final = 10**9
# samples for the skewness and excess kurtosis of the laws
_SHAPE_SAMPLES: Final = 8_192
# skewness and excess kurtosis (-1.2 for a uniform law) up to which a law is treated as nearly normal
_MOST_SKEWED, _MOST_CURVED = 0.3, 1.35


@warns_at_end
@takes_datum
def allocate(
    model: ErrorModel,
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
    sampled; specifications are held with a margin, so that ``for_samples`` other samples will show them too. Where the
    lower end of an interval misses the probability with its margin, or has much to spare, the aim is changed and the
    tolerances are chosen again and verified with fresh samples. The intervals of all rounds hold together.

    Args:
        model: Model read from a sheet or a dictionary.
        problem: ``tolerances``, ``specs`` and ``poses`` as in the sheet's ``allocate:``; by default the sheet's own.
        seed: 64-bit seed of the samples.
        seconds: Time for the choice of grades, and again for the front; then the best so far is returned, with its gap.
        pareto: Number of points of the front of cost against accuracy: 0, or 2 to 1000.
        for_samples: Samples of ``analyze`` that will, at 95 %, show that all specifications are met; 0: no margin.
        findings: Warnings to include in the result, such as those of the sheet.
        progress: Called with the steps done since its last call, of :func:`allocation_steps`; ``True`` shows a bar.

    Raises:
        InputError: A wrong problem, or a tolerance with which the error does not scale.
        UnknownNameError: No such pose, source or key.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> bearings = {"path": "axis_install[*].radius", "cost": {"reciprocal": "1 mm"}}
        >>> result = pp.allocate(model, {"specs": ["37.5 mm @ 95 %"], "tolerances": [bearings]}, for_samples=10_000)
        >>> print(result.met, result.cost_before, round(result.cost))
        True 10.0 57
    """
    common = check_common(model, seed=seed, findings=findings, progress=progress)
    check_number("the seconds of an allocation", seconds, "a number above zero", lambda value: value > 0)
    if isinstance(pareto, bool) or not isinstance(pareto, int) or pareto != 0:
        check_whole("the number of points of the front", pareto, 2, MOST_POINTS, f"of 0, or from 2 to {MOST_POINTS}")
    check_whole("the samples that a margin is for", for_samples, 0, _MAX_SHOWN)
    task = read_problem(model, problem)
    with steps_to(progress, allocation_steps(task, pareto), "steps") as advance:
        bounded = any(isinstance(limit, Bound) and limit.kind == "worst_case" for limit in task.limits)
        try:
            parts = contributions(model, task.tolerances, task.poses, worst_case=bounded, advance=advance)
        except NoScaleError as error:
            raise no_scale_error(model, error) from None
        judge = Judge(model, task, int(seed), int(for_samples))
        # tolerances of one group have one number; one without a group has its own
        names = [tolerance.group or f"\0{k}" for k, tolerance in enumerate(task.tolerances)]
        order = list(dict.fromkeys(names))
        members, deadline = np.array([order.index(name) for name in names]), monotonic() + seconds
        search = _Search(task, parts, members, judge, deadline)
        choices = search.choices
        programme = search.programme(judge.aimed.tolist())
        walked = walk(programme, choices, members, parts, judge, int(seed), deadline)
        if walked is not None and walked.is_complete:
            if walked.widths is None:
                widths = programme.least[members]
                attempt = _Attempt(programme, None, widths, judge.look(widths), "samples")
            else:
                solution = replace(programme.priced(walked.widths), lower_bound=walked.lower_bound)
                widths = walked.widths[members]
                attempt = _Attempt(programme, solution, widths, walked.verdict, "samples", walked.least_met)
            advance(_ROUNDS)
        else:
            rounds = search.rounds(advance)
            if (rounds[-1].solution is None or not rounds[-1].is_met) and (judge.aimed > judge.required).any():
                # limits that are kept without a margin
                judge.aimed = judge.required
                rounds += search.rounds(lambda _: None)
            attempt = rounds[-1]
            bound, basis = search.bound(rounds)
            if walked is not None:
                bound, basis = walked.lower_bound, "samples"
            if attempt.solution is None:
                attempt = replace(attempt, basis=basis)
            else:
                lower = None if bound is None else min(bound, attempt.cost)
                attempt = replace(attempt, solution=replace(attempt.solution, lower_bound=lower), basis=basis)
                if attempt.is_clear and (margin := judge.aimed - judge.required).any():
                    aims = [limit.probability for limit in attempt.programme.limits if limit.kind == "quantile"]
                    relaxed = search.programme((np.array(aims) - margin).tolist())
                    cheaper = solve(relaxed, choices, deadline - monotonic(), lambda _: None, attempt.t)
                    attempt = replace(attempt, least_met=np.inf if cheaper is None else cheaper.cost)
        result = _result(search, attempt, int(seed), common)
        if not pareto:
            return result
        return replace(result, front=pareto_front(attempt.programme, choices, members, pareto, seconds, advance))


def allocation_steps(problem: Problem, pareto: int = 0) -> int:
    """Return the total number of progress steps."""
    return len(problem.tolerances) + _ROUNDS + pareto


@dataclass(frozen=True, eq=False)
class _Attempt:
    """A round: tolerances, the samples' verdict, the basis of the lower bound, and the cost without a margin."""

    programme: Programme
    solution: Solution | None
    widths: Array
    verdict: SampledVerdict | None = None
    basis: Basis = "proof"
    least_met: float = np.inf

    @property
    def is_clear(self) -> bool:
        return self.verdict is not None and self.verdict.is_clear

    @property
    def is_met(self) -> bool:
        return self.verdict is not None and self.verdict.is_met

    @property
    def cost(self) -> float:
        return np.inf if self.solution is None else self.solution.cost

    @property
    def t(self) -> Array:
        """Value of each variable; of limits that cannot be met the tolerances that exceed them least."""
        return self.programme.least if self.solution is None else self.solution.t


@dataclass(frozen=True, eq=False)
class _Search:
    """First-order search for the cheapest tolerances; ``members`` are their groups, ``end`` is the deadline."""

    task: Problem
    parts: Contributions
    members: NDArray[np.intp]
    judge: Judge
    end: float

    @cached_property
    def groups(self) -> list[list[Tolerance]]:
        """Tolerances of each group."""
        groups = range(int(self.members.max()) + 1)
        return [list(itertools.compress(self.task.tolerances, self.members == g)) for g in groups]

    @cached_property
    def choices(self) -> list[Array | None]:
        """Grades of each group."""
        return [common_grades(members) for members in self.groups]

    def programme(self, aims: Sequence[float]) -> Programme:
        """Return costs and limits, with specifications held at these probabilities."""
        parts, members, groups = self.parts, self.members, self.groups
        graded = list(zip(groups, self.choices, strict=True))
        low = np.array([max(tol.low for tol in group) if grades is None else grades[0] for group, grades in graded])
        high = np.array([min(tol.high for tol in group) if grades is None else grades[-1] for group, grades in graded])
        costs = [[tol.cost for tol in group] for group in groups]

        def grouped(array: Array) -> Array:
            return np.stack([array[members == g].sum(axis=0) for g in range(len(groups))])

        squares, reaches = grouped(parts.by_tolerance), grouped(parts.reach_by_tolerance)
        # correlated tolerances of one group contribute one square
        of = np.append(members, len(costs))[parts.pairs]
        for group, part in zip(of[:, 0][of[:, 0] == of[:, 1]], parts.by_pair[of[:, 0] == of[:, 1]], strict=True):
            squares[group] += part
        pairs = of[of[:, 0] != of[:, 1]]
        covariances = np.concatenate([squares, parts.by_pair[of[:, 0] != of[:, 1]]])
        limits, remaining = [], iter(aims)
        for item in self.task.limits:
            limited = LIMITED[item.quantity] if isinstance(item, Specification) else item.of
            rows = limited.rows
            kind, probability = (item.kind, 0.0) if isinstance(item, Bound) else ("quantile", next(remaining))
            if kind == "worst_case":
                fixed, rates, products = parts.reach[rows][:, None], reaches[:, rows][:, :, None], pairs[:0]
                mean = parts.mean[rows]
            else:
                axes = self.judge.axes(limited)
                mean, products = np.einsum("kip,ip->kp", axes, parts.mean), pairs
                fixed, *rates_ = (
                    np.einsum("kip,ijp,ljp->klp", axes, c, axes) for c in (parts.covariance, *covariances)
                )
                rates = np.stack(rates_)
            limits.append(Limit(kind, item.limit, probability, tuple(rows), mean, fixed, rates, products))
        return Programme(costs, low, high, limits)

    def rounds(self, advance: Callable[[int], None]) -> list[_Attempt]:
        """Return the first-order rounds, each aimed by the samples of the previous one; the best comes last."""
        aims, judge = self.judge.aimed.tolist(), self.judge
        rounds: list[_Attempt] = []
        best: _Attempt | None = None
        trials: list[tuple[list[float], Array]] = []
        for _ in range(_ROUNDS):
            programme = self.programme(aims)
            start = None if best is None or best.solution is None else best.solution.t
            solution = solve(programme, self.choices, self.end - monotonic(), advance, start)
            trial = _Attempt(programme, solution, (programme.least if solution is None else solution.t)[self.members])
            is_same = best is not None and np.allclose(trial.widths, best.widths, rtol=_SAME_WIDTH, atol=0)
            verdict = best.verdict if best is not None and is_same and best.is_clear else None
            if not judge.chances or (verdict is not None and solution is not None):
                rounds += [] if judge.chances else [trial]
                best = best or trial
                break
            # retry the narrowest ones where the first order rejects what the samples accept
            trial = replace(trial, verdict=verdict or judge.look(trial.widths, judge.many))
            rounds.append(trial)
            advance(1)
            assert trial.verdict is not None
            spare = trial.verdict.sampled[1].min(axis=1) - judge.aimed
            # prefer attempts with the margin, then the cheaper; else the last one
            is_better = best is not None and (trial.is_clear, -trial.cost) > (best.is_clear, -best.cost)
            if best is None or not best.is_met or (trial.is_met and is_better):
                best = trial
            # of several limits only the active ones have reserve to give back
            # fraction of a limit, first order, from which it may be active
            holds = [
                limit.measure(trial.t[:, None]).max() > 0.9 * limit.limit
                for limit in programme.limits
                if limit.kind == "quantile"
            ]
            # the first order may reject what the samples accept
            if (solution is None and not trial.is_clear) or (trial.is_clear and not (holds & (spare > _SPARE)).any()):
                break
            trials.append((aims, spare))
            history = [np.array(column).T for column in zip(*trials, strict=True)]
            aims = [
                _next_aim(*past) if (is_active if trial.is_clear else past[1][-1] < 0) else float(past[0][-1])
                for *past, is_active in zip(*history, holds, strict=True)
            ]
        assert best is not None
        advance(_ROUNDS - len(rounds) if judge.chances else _ROUNDS)
        return [*(trial for trial in rounds if trial is not best), best]

    def bound(self, rounds: Sequence[_Attempt]) -> tuple[float | None, Basis]:
        """Return a lower bound of the cost under the limits as stated, not as aimed at; none for laws far from normal.

        With specifications it is the first-order bound, at a probability lowered by the samples' largest excess of any
        round.
        """
        best = rounds[-1]
        if not self.judge.chances:
            return None if best.solution is None else best.solution.lower_bound, "proof"
        # whether the laws of the chosen tolerances are about as close to normal as a uniform one is
        columns = np.unique(np.concatenate([effect.columns for effect in self.parts.effects]))
        numbers = in_deviations(self.judge.model.space, 0, _SHAPE_SAMPLES)[columns]
        skewness, curvature = (numbers**3).mean(axis=1), (numbers**4).mean(axis=1) - 3
        is_near = (np.abs(skewness) < _MOST_SKEWED).all() and (np.abs(curvature) < _MOST_CURVED).all()
        if best.solution is None or not is_near:
            return None, "normal law"
        excess = np.zeros(len(self.judge.chances))
        for attempt in rounds:
            normal = np.array(
                [limit.probabilities(attempt.t) for limit in attempt.programme.limits if limit.kind == "quantile"]
            )
            assert attempt.verdict is not None
            excess = np.maximum(excess, (attempt.verdict.sampled[2] - normal).max(axis=1))
        programme = self.programme((self.judge.required - excess).tolist())
        wider = solve(programme, self.choices, max(self.end - monotonic(), 0.0), lambda _: None, best.solution.t)
        return (None if wider is None else wider.lower_bound), "normal law"


def _next_aim(aims: Array, spares: Array) -> float:
    """Return the next probability to aim at, given the spare probabilities of the lower ends in earlier rounds.

    Between an aim that was too low and one that was high enough it is interpolated, in normal scores. Without both the
    step grows from round to round, because a law far from normal may need a step of another size.
    """
    aim, spare, short = float(aims[-1]), float(spares[-1]), spares < 0
    if short.any() and not short.all():
        low, high = int(np.where(short, aims, -1.0).argmax()), int(np.where(short, 2.0, aims).argmin())
        fraction = np.clip((_SPARE / 2 - spares[low]) / (spares[high] - spares[low]), 0.25, 0.75)
        scores = special.ndtri(aims[[low, high]])
        return float(special.ndtr(scores[0] + fraction * (scores[1] - scores[0])))
    stride = _STRIDE * (len(aims) - 1)
    if spare < 0:
        return max(min(aim - spare * 1.25, (1 + aim) / 2), float(special.ndtr(special.ndtri(aim) + stride)))
    step = max(aim - max(spare - _SPARE / 2, 0.0), 0.5 * aim)
    return min(step, float(special.ndtr(special.ndtri(aim) - stride)))


def _result(search: _Search, attempt: _Attempt, seed: int, findings: tuple[Finding, ...]) -> AllocationResult:
    task, members, judge, model = search.task, search.members, search.judge, search.judge.model
    values, _ = model.configurations(list(task.poses))
    grounds = grounds_at(model, values, task.poses)
    programme, solution = attempt.programme, attempt.solution
    allocated, places, row = [], [], 0
    for k, limit in enumerate(task.limits):
        measure = programme.limits[k].measure(attempt.t[:, None])[0]
        worst = int(measure.argmax()) % len(task.poses)
        places.append(int(measure.argmax()))
        sample: dict[str, Any] = {}
        if isinstance(limit, Specification):
            assert attempt.verdict is not None
            worst = int(attempt.verdict.sampled[1, row].argmin())
            share, low, high = attempt.verdict.sampled[:, row, worst].tolist()
            margin = float(judge.aimed[row] - judge.required[row]) if attempt.is_clear else 0.0
            sample = {"required": limit.required, "probability": share, "interval": (low, high), "margin": margin}
            sample["varies"] = bool(attempt.verdict.varies[row, worst])
            row += 1
        allocated.append(
            AllocatedLimit(
                kind=programme.limits[k].kind,
                quantity=_quantity(limit),
                limit=limit.limit,
                aimed=None if attempt.basis == "samples" else programme.limits[k].probability or None,
                first_order=float(measure.max()),
                worst_pose=task.poses[worst],
                shadow_price=None if solution is None else solution.prices[k],
                grounds=grounds,
                **sample,
            )
        )
    width = np.zeros(len(programme.low)) if solution is None else solution.bound_prices
    graded = np.array([search.choices[group] is not None for group in members])
    cost = np.array([float(tol.cost.at(value)) for tol, value in zip(task.tolerances, attempt.widths, strict=True)])
    tightest = tightest_of(allocated)
    return AllocationResult(
        provenance=Provenance.of(model, seed),
        tolerances=task.tolerances,
        after=attempt.widths,
        costs=cost,
        shadow_prices=np.where(graded, 0.0, width[members]),
        lower_bound=None if solution is None else solution.lower_bound,
        bound_basis=attempt.basis,
        limits=tuple(allocated),
        for_samples=judge.for_samples,
        margin_cost=max(float(cost.sum()) - attempt.least_met, 0.0) if np.isfinite(attempt.least_met) else None,
        parts=_parts(model, task, attempt, places[tightest], tightest),
        poses=task.poses,
        feasible=solution is not None or all(limit.is_kept for limit in allocated),
        grounds=grounds,
        findings=(
            *findings,
            *pose_findings(model.chain, values, task.poses),
            *exact_findings(model, values, model.approaches_of(list(task.poses), values)),
        ),
    )


def _parts(model: ErrorModel, task: Problem, attempt: _Attempt, place: int, limit: int) -> ErrorParts:
    """Return the contributions to the error at a place of a limit; a worst case has rows times poses as places."""
    bound, rows = task.limits[limit], attempt.programme.limits[limit].rows
    worst_case = isinstance(bound, Bound) and bound.kind == "worst_case"
    row, pose = divmod(place, len(task.poses))
    if worst_case:
        rows = (rows[row],)
    name = _quantity(bound) if not worst_case else QUANTITIES[COMPONENTS[rows[0]]]
    if LIMITED[name].in_tool:
        # the parts are those of the whole vector
        name = f"{name.partition('.')[0]}.norm"
    sheet = np.array([tolerance.before for tolerance in task.tolerances])
    # of the model as it is, with the chosen tolerances, and with all of them halved
    models = [model, *(changed_model(model, task.tolerances, values) for values in (attempt.widths, sheet / 2))]
    before, after, changed = (_norm_parts(m, task.poses[pose], list(rows), worst_case) for m in models)
    rounding = _ROUNDING * max(before.values())
    parts = [
        SourcePart(source, before[source], after[source], abs(changed[source] - before[source]) > rounding)
        for source in before
        if max(before[source], after[source]) > rounding
    ]
    sources = tuple(sorted(parts, key=lambda part: (-part.after, part.source)))
    return ErrorParts(task.poses[pose], name, "worst_case" if worst_case else "rms", sources)


def _quantity(limit: Specification | Bound) -> str:
    if isinstance(limit, Specification):
        return limit.quantity
    part = "position" if limit.is_position else "attitude"
    return f"{part}.norm" if limit.kind == "rms" else part
