"""Poses to measure: optimal selection from candidates, with certified efficiency.

With weights w_i of candidates, the information on z and nuisances is ``M(w) = diag(I, 0) + Σ w_i A_iᵀ A_i``, A_i the whitened
derivatives of candidate i. Two measures of a design:

- *D*: ``ln det S(w)``, S the Schur complement of the nuisances: the information on z with the nuisances free;
- *task*: ``tr(G S(w)⁻¹)``, G = Σ JᵀJ over the user's poses: the mean square position error that is left there.

Poses are exchanged while that improves the measure: first by adding the best candidate and leaving out the worst pose, or the
other way round (Mitchell 1974), which is quick; then by the best of all exchanges of one pose for another (Fedorov 1972).

The first measure is concave in w, the second convex. So with weights between 0 and 1 instead of 0 or 1 the tangent of the loss
at any weights bounds it from below over all designs: the loss there plus the least that the slopes allow. Where the relaxed
design counts parts of poses, the problem is split: a candidate is measured or it is not. The least bound of all parts is the
bound (Land and Doig 1960).
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from precision_pin.analyses.calibration import design as linear
from precision_pin.analyses.calibration.forecast import PosesOutcome, contact_warnings, errors_left, seen_poses
from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.readings import Station, measured_model, measurement_of
from precision_pin.base.arguments import check_choice, check_items, check_whole
from precision_pin.base.arrays import Array, Keys
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.base.progress import stepped, steps_to
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sheet.measurement import Measurement

_EXCHANGES: Final = 500
"""Maximum number of exchanges of one search."""
_RIDGE: Final = 1e-9
"""Information added on nuisances, relative to all candidates, so that few poses are not singular."""


@dataclass(frozen=True, eq=False)
class Design:
    """Losses of designs, to be minimised: -ln det S, or tr(G S⁻¹).

    Attributes:
        rows: Derivatives of each candidate by z and by scaled nuisances, ``(P, m, r + k)``.
        prior: Information before any reading, ``(r + k,) * 2``.
        size, rank: r, and how many combinations of z all candidates together determine.
        goal: G, ``(r, r)``; None for the determinant.
    """

    rows: Array
    prior: Array
    size: int
    rank: int
    goal: Array | None

    @classmethod
    def of(cls, by_z: Array, by_nuisance: Array, goal: Array | None) -> Design:
        """Return the design of candidates; nuisances are scaled so that all candidates together give them unit information."""
        size, scaled_nuisances = by_z.shape[2], by_nuisance
        if by_nuisance.shape[2]:
            _, values, rows = np.linalg.svd(linear.flat(by_nuisance), full_matrices=False)
            is_determined = values > 1e-9 * values[0]
            scaled_nuisances = by_nuisance @ (rows[is_determined].T / values[is_determined])
        prior = np.diag(np.concatenate([np.ones(size), np.full(scaled_nuisances.shape[2], _RIDGE)]))
        projected = linear.beside(linear.flat(by_z), linear.basis_of(linear.flat(by_nuisance)))
        spectrum = np.linalg.svd(projected, compute_uv=False)
        rank = max(int((spectrum > linear.NEGLIGIBLE * spectrum[0]).sum()), 1)
        return cls(np.concatenate([by_z, scaled_nuisances], axis=2), prior, size, rank, goal)

    def information(self, choice: NDArray[np.intp]) -> Array:
        """Return M of some candidates."""
        rows = linear.flat(self.rows[choice])
        return np.asarray(self.prior + rows.T @ rows)

    def weighted(self, weights: Array) -> Array:
        """Return M of weights ``(P,)``."""
        rows = linear.flat(self.rows)
        return np.asarray(self.prior + (rows * np.repeat(weights, self.rows.shape[1])[:, None]).T @ rows)

    def loss(self, information: Array) -> float:
        """Return the loss of M."""
        if self.goal is None:
            nuisance = information[self.size :, self.size :]
            return float(np.linalg.slogdet(nuisance)[1] - np.linalg.slogdet(information)[1])
        inverse = np.linalg.inv(information)[: self.size, : self.size]
        return float(np.einsum("ij,ji->", self.goal, inverse))

    def exact_loss(self, choice: NDArray[np.intp]) -> float:
        """Return the loss of some candidates without the information that is added on nuisances; never the smaller one."""
        by_z, by_nuisance = np.split(self.rows[choice], [self.size], axis=2)
        covariance = linear.Estimator.of(linear.flat(by_z), linear.flat(by_nuisance), has_prior=True).covariance
        if self.goal is None:
            return float(np.linalg.slogdet(covariance)[1])
        return float(np.einsum("ij,ji->", self.goal, covariance))

    def efficiency(self, loss: float, bound: float) -> float:
        """Return the efficiency of a loss, at least."""
        if self.goal is None:
            return float(np.exp(min(bound - loss, 0.0) / self.rank))
        return float(np.clip(bound / loss, 0.0, 1.0)) if loss > 0 else 1.0

    def slopes(self, weights: Array) -> tuple[float, Array]:
        """Return the loss of weights, and its derivatives ``(P,)``, all zero or less."""
        information = self.weighted(weights)
        inverse = np.linalg.inv(information)
        if self.goal is None:
            middle = inverse.copy()
            nuisance = information[self.size :, self.size :]
            middle[self.size :, self.size :] -= np.linalg.inv(nuisance)
        else:
            columns = inverse[:, : self.size]
            middle = columns @ self.goal @ columns.T
        gains = np.einsum("pmi,ij,pmj->p", self.rows, middle, self.rows, optimize=True)
        return self.loss(information), -gains

    def swap(self, choice: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return a choice that neither adding the best candidate, then leaving out the worst pose, improves, nor the reverse."""
        is_chosen = np.zeros(len(self.rows), dtype=bool)
        is_chosen[choice] = True
        information = self.information(choice)
        loss = self.loss(information)
        for _ in range(_EXCHANGES):
            raise_if_interrupted()
            for first_sign in (1.0, -1.0):
                trial, changed, trial_loss = is_chosen.copy(), information, loss
                for sign in (first_sign, -first_sign):
                    changes = self._changes_by_one(changed, sign)
                    changes[trial if sign > 0 else ~trial] = np.inf
                    best_candidate = int(np.argmin(changes))
                    trial[best_candidate] = sign > 0
                    changed = changed + sign * self.rows[best_candidate].T @ self.rows[best_candidate]
                    trial_loss += float(changes[best_candidate])
                if trial_loss < loss - 1e-9 * max(1.0, abs(loss)):
                    break
            else:
                break
            is_chosen = trial
            # recomputed without the rounding of the sums
            information = self.information(np.flatnonzero(is_chosen))
            loss = self.loss(information)
        return np.flatnonzero(is_chosen)

    def _changes_by_one(self, information: Array, sign: float) -> Array:
        """Return the change of loss if a candidate is added (1) or removed (-1), ``(P,)``; infinite if none remains."""
        inverse: Array = scipy.linalg.inv(information)
        eye = np.eye(self.rows.shape[1])
        through = self.rows @ inverse
        core = eye + sign * through @ self.rows.transpose(0, 2, 1)
        with np.errstate(divide="ignore"):
            if self.goal is not None:
                effect = through[:, :, : self.size] @ self.goal @ through[:, :, : self.size].transpose(0, 2, 1)
                return np.asarray(-sign * np.einsum("pii->p", np.linalg.solve(core, effect)))
            change = -np.linalg.slogdet(core)[1]
            nuisance = self.rows[:, :, self.size :]
            if nuisance.shape[2]:
                nuisance_inverse: Array = scipy.linalg.inv(information[self.size :, self.size :])
                change += np.linalg.slogdet(eye + sign * nuisance @ nuisance_inverse @ nuisance.transpose(0, 2, 1))[1]
        return np.where(np.isfinite(change), change, np.inf)

    def exchange(self, choice: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return a choice that no exchange of one pose for another improves."""
        choice = self.swap(choice)
        others = np.setdiff1d(np.arange(len(self.rows)), choice)
        for _ in range(_EXCHANGES if others.size else 0):
            raise_if_interrupted()
            change = self._changes(choice, others)
            removed, added = np.unravel_index(int(np.argmin(change)), change.shape)
            loss = self.loss(self.information(choice))
            choice[removed], others[added] = others[added], choice[removed]
            new_loss = self.loss(self.information(choice))
            if not new_loss < loss - 1e-12 * max(1.0, abs(loss)):
                choice[removed], others[added] = others[added], choice[removed]
                break
        return choice

    def _changes(self, choice: NDArray[np.intp], others: NDArray[np.intp]) -> Array:
        """Return the change of loss of every exchange, ``(count, P - count)``, by updates of low rank."""
        information = self.information(choice)
        inverse: Array = scipy.linalg.inv(information)
        if self.goal is not None:
            columns = inverse[:, : self.size]
            return _trace_changes(self.rows, inverse, columns @ self.goal @ columns.T, choice, others)
        change = -_log_changes(self.rows, inverse, choice, others)
        nuisance = self.rows[:, :, self.size :]
        if nuisance.shape[2]:
            nuisance_inverse: Array = scipy.linalg.inv(information[self.size :, self.size :])
            change += _log_changes(nuisance, nuisance_inverse, choice, others)
        return change


def _pairs(rows: Array, middle: Array, picks: NDArray[np.intp], others: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Return ``A_i X A_iᵀ`` of chosen ones, of the rest, and ``A_i X A_jᵀ`` of all pairs ``(count, rest, m, m)``."""
    size = rows.shape[1]
    chosen_rows, other_rows = rows[picks], rows[others]
    through = chosen_rows @ middle
    own_blocks = np.einsum("pmi,pni->pmn", through, chosen_rows)
    other_blocks = np.einsum("pmi,pni->pmn", other_rows @ middle, other_rows)
    cross = (linear.flat(through) @ linear.flat(other_rows).T).reshape(len(chosen_rows), size, len(other_rows), size)
    return own_blocks, other_blocks, cross.transpose(0, 2, 1, 3)


def _log_changes(rows: Array, inverse: Array, choice: NDArray[np.intp], others: NDArray[np.intp]) -> Array:
    """Return the change of ln det M of every exchange: det(I - U) det(I + V + Cᵀ (I - U)⁻¹ C) with Schur complements."""
    own_blocks, other_blocks, cross = _pairs(rows, inverse, choice, others)
    eye = np.eye(rows.shape[1])
    remainder = eye - own_blocks
    complement = eye + other_blocks[None] + np.swapaxes(cross, 2, 3) @ np.linalg.solve(remainder[:, None], cross)
    return np.asarray(np.linalg.slogdet(remainder)[1][:, None] + np.linalg.slogdet(complement)[1])


def _trace_changes(
    rows: Array, inverse: Array, middle: Array, choice: NDArray[np.intp], others: NDArray[np.intp]
) -> Array:
    """Return the change of ``tr(G S⁻¹)`` of every exchange: ``-tr((D + W)⁻¹ F)`` with D = diag(-I, I)."""
    size = rows.shape[1]
    blocks = []
    for kernel in (inverse, middle):
        own_blocks, other_blocks, cross = _pairs(rows, kernel, choice, others)
        quadrants = np.broadcast_arrays(own_blocks[:, None], cross, np.swapaxes(cross, 2, 3), other_blocks[None])
        blocks.append(np.block([[quadrants[0], quadrants[1]], [quadrants[2], quadrants[3]]]))
    weights, effect = blocks
    signs = np.diag(np.concatenate([-np.ones(size), np.ones(size)]))
    return np.asarray(-np.einsum("abii->ab", np.linalg.solve(weights + signs, effect)))


_MAX_STEPS: Final = 400
"""Maximum number of gradient steps of a relaxed problem."""
_GAP: Final = 2e-5
"""Gap of the relaxed problem, in units of the efficiency, at which it is solved."""
_WORK: Final = 24_000
"""Parts that are bounded, times candidates."""
_MAX_PARTS: Final = 120
"""Maximum number of parts that are bounded."""
_ENOUGH: Final = 0.995
"""Efficiency at which the search for a better bound stops."""


@dataclass(frozen=True, eq=False)
class Relaxed:
    """A relaxed problem: a bound of its loss, weights ``(P,)``, and their limits, equal where a candidate is settled."""

    bound: float
    weights: Array
    low: Array
    high: Array

    def rounded(self, count: int) -> NDArray[np.intp]:
        """Return the candidates with the largest weights, ``(count,)``."""
        return np.argsort(-self.weights, kind="stable")[:count]

    def __lt__(self, other: Relaxed) -> bool:
        return self.bound < other.bound


def relaxed(design: Design, count: int, weights: Array, low: Array, high: Array) -> Relaxed:
    """Return the solution of the relaxed problem within limits, from first weights ``(P,)``."""
    weights, bound, step = _project(weights, count, low, high), -np.inf, 1.0
    loss, slopes = design.slopes(weights)
    for _ in range(_MAX_STEPS):
        bound = max(bound, loss + float(slopes @ (_cheapest_weights(slopes, count, low, high) - weights)))
        if design.efficiency(loss, bound) > 1 - _GAP:
            break
        scale = step / max(float(np.abs(slopes).max()), 1e-300)
        for _ in range(40):
            trial = _project(weights - scale * slopes, count, low, high)
            change = trial - weights
            new_loss, new_slopes = design.slopes(trial)
            if new_loss <= loss + 1e-4 * float(slopes @ change):
                curvature = float((new_slopes - slopes) @ change)
                length = float(change @ change) / curvature if curvature > 0 else 2 * scale
                step = length * max(float(np.abs(new_slopes).max()), 1e-300)
                weights, loss, slopes = trial, new_loss, new_slopes
                break
            scale /= 4
        else:  # only rounding is left
            break
    return Relaxed(bound, weights, low, high)


def branches(design: Design, count: int, root: Relaxed, choice: NDArray[np.intp]) -> tuple[float, NDArray[np.intp]]:
    """Return a bound at least as good as the root's, of no candidate settled, and a choice at least as good as that given."""
    best_loss, parts = design.exact_loss(choice), [root]
    for _ in range(min(_MAX_PARTS, _WORK // len(root.weights)) // 2):
        raise_if_interrupted()
        if design.efficiency(best_loss, parts[0].bound) >= _ENOUGH:
            break
        part = heapq.heappop(parts)
        fractionality = part.weights * (1 - part.weights) * (part.low < part.high)
        candidate = int(np.argmax(fractionality))
        if not fractionality[candidate] > 0:  # already a choice: it has no parts
            heapq.heappush(parts, part)
            break
        for value in (0.0, 1.0):
            low, high = part.low.copy(), part.high.copy()
            low[candidate] = high[candidate] = value
            if not low.sum() <= count <= high.sum():
                continue
            solution = relaxed(design, count, part.weights, low, high)
            # a part of a problem is bounded by the whole's bound as well
            heapq.heappush(parts, Relaxed(max(solution.bound, part.bound), solution.weights, low, high))
            trial = design.swap(solution.rounded(count))
            loss = design.exact_loss(trial)
            if loss < best_loss:
                choice, best_loss = trial, loss
    return parts[0].bound, choice


def _cheapest_weights(slopes: Array, count: int, low: Array, high: Array) -> Array:
    """Return the weights within their limits, of sum ``count``, with the minimum sum of slopes."""
    order = np.argsort(slopes, kind="stable")
    room = (high - low)[order]
    result = low.copy()
    result[order] += np.clip(count - float(low.sum()) - (np.cumsum(room) - room), 0.0, room)
    return result


def _project(weights: Array, count: int, low: Array, high: Array) -> Array:
    """Return the closest weights within their limits whose sum is ``count``."""
    # the sum of clip(weights - shift, low, high) falls by straight pieces as the shift grows
    breakpoints = np.concatenate([weights - high, weights - low])
    order = np.argsort(breakpoints, kind="stable")
    breakpoints = breakpoints[order]
    slopes = np.cumsum(np.where(order < len(weights), -1.0, 1.0))
    sums = float(high.sum()) + np.concatenate([[0.0], np.cumsum(slopes[:-1] * np.diff(breakpoints))])
    piece = int(np.clip(np.searchsorted(-sums, -count, side="right") - 1, 0, len(breakpoints) - 1))
    shift = breakpoints[piece] + (sums[piece] - count) / max(-slopes[piece], 1.0)
    return np.asarray(np.clip(weights - shift, low, high))


_STARTS: Final = 3
"""Random choices from which poses are exchanged."""
PLAN_STEPS: Final = _STARTS + 3
"""Steps of a plan: an exchange from each start, the relaxed design, the perturbed choices, and branches of the bound."""
_PERTURBED: Final = 200
"""Searches from the best choice with some poses replaced at random."""
_MAX_REPLACED: Final = 0.3
"""Largest share of poses that are replaced."""
_CERTAIN: Final = 0.999
"""Efficiency at which the search for a better choice stops."""
_RANDOM: Final = 25
"""Random choices for comparison."""

Criterion = Literal["task", "D"]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CalibrationPlan(PosesOutcome):
    """The poses to measure, in addition to :class:`PosesOutcome`.

    Attributes:
        criterion, candidates: ``"task"`` or ``"D"``, and how many candidates there were that the instrument sees.
        chosen, names, q: Candidates to measure, in their order, from 0; their names, and joint values ``(n, count)``.
        left_out: How many candidates, or draws of random ones, are left out: ``collision``, ``kept out``, ``hidden``
            from the instrument.
        value, bound: The measure of the choice, and a bound that no choice of as many candidates can pass: ln det of
            the information on z (largest is best), or the mean square position error without the floor, m² (smallest is
            best).
        efficiency, random_efficiency: Of the choice, at least: for D ``exp((value - bound) / L)`` with L the
            combinations that all candidates together determine, for a task bound / value. The same of a random choice,
            the median of 25.
    """

    schema: ClassVar[str] = "precision-pin/calibration-plan/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "measurement", "criterion", "candidates", "left_out", "count", "value", "bound", "efficiency"),
        *("random_efficiency", "chosen=choices", "rms_position", "identifiability", "observability"),
        *("poses", "findings"),
    )

    criterion: Criterion
    chosen: tuple[int, ...]
    names: tuple[str, ...]
    q: Array
    candidates: int
    left_out: Mapping[str, int]
    value: float
    bound: float
    efficiency: float
    random_efficiency: float

    @property
    def sliding_joints(self) -> tuple[str, ...]:
        """Sliding joints, whose values are in m."""
        return self.poses[0].sliding_joints

    @property
    def count(self) -> int:
        """How many candidates are measured."""
        return len(self.chosen)

    @property
    def choices(self) -> list[dict[str, Any]]:
        """Number, name and joint values of each candidate to measure, as in the JSON."""
        return [
            {"candidate": k, "name": name, "q": dict(zip(self.poses[0].q, values, strict=True))}
            for k, name, values in zip(self.chosen, self.names, self.q.T, strict=True)
        ]

    def rms(self, which: str) -> float:
        """Return the root mean square error of the position over the user's poses: ``before``, ``after``, ``floor``."""
        return self.rms_position[which]

    def __repr__(self) -> str:
        return (
            f"<CalibrationPlan of {self.provenance.robot}: {self.count} of {self.candidates} poses, {self.criterion} "
            f"efficiency at least {self.efficiency:.4g}>"
        )


@linear.on_one_thread
def plan_calibration(
    model: ErrorModel,
    candidates: object,
    count: int,
    measurement: Measurement | None = None,
    *,
    at: object = None,
    criterion: Criterion = "task",
    seed: int = 0,
    findings: Sequence[Finding] = (),
    progress: Callable[[int], None] | bool | None = None,
) -> CalibrationPlan:
    """Choose the poses to measure among candidates.

    Args:
        model: The model, whose sheet is the prior.
        candidates: Poses that can be measured: a list, an array ``(n, P)``, a mapping of joint values or a pose set.
        count: How many of them are measured, each once.
        measurement: Instrument and set-up; those of the sheet if left out.
        at: The user's own poses; the model's named poses if left out, else the candidates.
        criterion: ``"task"``: the mean square position error left at the user's poses. ``"D"``: the determinant of the
            information.
        seed: 64-bit seed of the starting choices.
        findings: Findings to pass on, such as those of the sheet.
        progress: Function called with the number of steps done since its last call, of :data:`PLAN_STEPS`; ``True``
            shows a bar.

    Raises:
        InputError: Fewer candidates than poses to choose, a candidate twice, nothing varies from robot to robot, or no
            candidate sees anything.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> candidates = np.random.default_rng(0).uniform(-2, 2, (4, 20))
        >>> plan = pp.plan_calibration(model, candidates, 8, pp.Measurement("position", std="20 um"))
        >>> print(len(plan.chosen), plan.efficiency > 0.9)
        8 True
    """
    measurement = measurement_of(model, measurement)
    model = model.bare
    findings = check_items("findings", findings, Finding)
    check_choice("the criterion", criterion, ("task", "D"))
    check_seed(seed)
    usable, left_out, notes = usable_candidates(model, candidates, measurement, 1, count)
    values, names, total = usable.q, usable.names, len(usable)
    unit = linear.UnitNumbers.of(model.space)
    # one station with one reading per candidate
    pose_models = measured_model(model, measurement).at_columns(np.ascontiguousarray(values))
    stations = tuple(Station(pose_model, (k,)) for k, pose_model in enumerate(pose_models))
    ahead = linear.stack_at_means(stations, unit, measurement)
    by_z, by_nuisance = ahead.apart(count)
    linear.check_identifiable(
        linear.of_stack(unit.names, linear.flat(by_z), linear.flat(by_nuisance), measurement.nuisances, total)
    )
    tasks = linear.task_poses(model, at, values)
    slopes = [pose_model.jacobian[:3][:, unit.columns] @ unit.root for _, pose_model in tasks]
    goal = sum((slope.T @ slope for slope in slopes), np.zeros((by_z.shape[2],) * 2)) / len(slopes)
    design = Design.of(by_z, by_nuisance, goal if criterion == "task" else None)
    generator = np.random.default_rng(seed)
    with steps_to(progress, PLAN_STEPS, "steps") as step:
        starts = (generator.permutation(total)[:count] for _ in range(_STARTS))
        choices = [design.exchange(start) for start in stepped(starts, step)]
        root = relaxed(design, count, np.full(total, count / total), np.zeros(total), np.ones(total))
        choice = min((*choices, design.exchange(root.rounded(count))), key=design.exact_loss)
        step(1)
        choice = _perturbed(design, choice, root.bound, generator)
        step(1)
        bound, choice = branches(design, count, root, choice)
        choice = np.sort(design.exchange(choice))
        step(1)
    loss = design.exact_loss(choice)
    efficiency = design.efficiency(loss, bound)
    random = [design.exact_loss(generator.permutation(total)[:count]) for _ in range(_RANDOM)]
    estimator = linear.Estimator.of(*ahead.taken(choice), has_prior=True)
    nominal = np.array([stations[k].at.posture.pose for k in choice])
    chosen_stations = tuple(Station(stations[k].at, (row,)) for row, k in enumerate(choice))
    identifiability = linear.determined_by(chosen_stations, unit, measurement)
    return CalibrationPlan(
        provenance=Provenance.of(model, seed),
        measurement=measurement,
        criterion=criterion,
        chosen=tuple(map(int, choice)),
        names=tuple(names[k] for k in choice),
        q=values[:, choice],
        candidates=total,
        left_out=left_out,
        value=-loss if criterion == "D" else loss,
        bound=-bound if criterion == "D" else bound,
        efficiency=efficiency,
        random_efficiency=design.efficiency(float(np.median(random)), bound),
        identifiability=identifiability,
        poses=errors_left(tasks, unit, estimator, measurement, model.space),
        findings=(
            *findings,
            *notes,
            *_warnings(identifiability, efficiency),
            *contact_warnings(measurement, nominal),
        ),
    )


def usable_candidates(
    model: ErrorModel, candidates: object, measurement: Measurement | None, least: int, count: int
) -> tuple[PoseSet, dict[str, int], tuple[Finding, ...]]:
    """Return the candidates at which the arm hits nothing and an instrument sees the target.

    Also the number of the others by reason, with random draws left out before, and what to say of them.

    Raises:
        InputError: None is left, one is given twice, or the number to choose is not from ``least`` to that of candidates.
    """
    before: Counter[str] = Counter()
    if isinstance(candidates, PoseSet):
        before.update(candidates.obstructed)
        candidates = candidates.of(candidates.known) if candidates.known.any() else candidates
    values, names = linear.read_poses(model, candidates)
    pose_set = PoseSet.at(model.chain, np.ascontiguousarray(values), names).unobstructed(model.chain)
    obstructed = len(pose_set) - int(pose_set.known.sum())
    if obstructed == len(pose_set):
        raise InputError(f"at each of {obstructed} candidates the arm hits itself or what it is kept out of")
    free = pose_set.of(pose_set.known) if obstructed else pose_set
    usable = free if measurement is None else seen_poses(model.chain, measurement, free)
    if usable is None:
        raise InputError(f"the instrument sees the target at none of {len(free)} candidates")
    _check_distinct(usable.q)
    left_out = before + Counter({**pose_set.obstructed, "hidden": len(free) - len(usable)})
    allowed = f"from {least} to {len(usable)}, the number of candidates"
    check_whole("the number of poses to choose", count, least, len(usable), allowed)
    notes = model.chain.collision_notes if left_out else ()
    return usable, dict(left_out), (*notes, *_left_out_warnings(obstructed, left_out["hidden"]))


def _perturbed(
    design: Design, choice: NDArray[np.intp], bound: float, generator: np.random.Generator
) -> NDArray[np.intp]:
    """Return the best of searches that begin at a choice with some of its poses replaced (iterated local search)."""
    available = len(design.rows) - len(choice)
    maximum = min(max(2, round(_MAX_REPLACED * len(choice))), len(choice), available)
    best_loss = design.exact_loss(choice)
    for number in range(_PERTURBED if maximum else 0):
        if design.efficiency(best_loss, bound) >= _CERTAIN:
            break
        replacements = 1 + number % maximum
        unused = np.setdiff1d(np.arange(len(design.rows)), choice)
        trial = choice.copy()
        trial[generator.permutation(len(choice))[:replacements]] = generator.permutation(unused)[:replacements]
        trial = design.swap(trial)
        loss = design.exact_loss(trial)
        if loss < best_loss:
            choice, best_loss = trial, loss
    return choice


def _check_distinct(values: Array) -> None:
    _, first_columns, place = np.unique(values, axis=1, return_index=True, return_inverse=True)
    originals = first_columns[place.ravel()]
    copies = np.flatnonzero(originals != np.arange(values.shape[1]))
    if copies.size:
        raise InputError(
            f"the candidates {originals[copies[0]] + 1} and {copies[0] + 1} are one pose, and each is measured once; omit "
            "copies"
        )


def _left_out_warnings(obstructed: int, hidden: int) -> Iterator[Finding]:
    """Yield warnings about candidates that are left out."""
    if obstructed:
        message = f"{obstructed} candidates are left out: the arm hits itself or what it is kept out of"
        yield Finding("warning", "W_COLLISION", message)
    if hidden:
        message = f"{hidden} candidates are left out: the target faces away from the instrument by more than the cone"
        yield Finding("warning", "W_HIDDEN", message)


def _warnings(result: linear.Identifiability, efficiency: float) -> Iterator[Finding]:
    if efficiency < 0.99:
        message = (
            f"the choice is certified to {100 * efficiency:.3g} % of the best only: the bound may be beyond every choice, and no "
            "exchange of two poses is better"
        )
        yield Finding("warning", "W_PLAN", message)
    yield from linear.identifiability_warnings(result)
