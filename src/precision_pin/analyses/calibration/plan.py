"""Which poses to measure: the best of many candidates, with a certified bound.

With weights w_i of candidates, the information on z and nuisances is ``M(w) = diag(I, 0) + Σ w_i A_iᵀ A_i``, A_i the whitened
derivatives of candidate i. Two measures of a design:

- *D*: ``ln det S(w)``, S the Schur complement of the nuisances: the information on z with the nuisances free;
- *task*: ``tr(G S(w)⁻¹)``, G = Σ JᵀJ over the user's poses: the mean square position error that is left there.

The first is concave in w, the second convex. So the relaxed problem, 0 ≤ w_i ≤ 1 and Σ w_i = count, bounds every choice of
poses, and at any w the tangent bounds the relaxed problem: the largest sum of ``count`` slopes is its maximum over all designs.
Poses are exchanged (Fedorov 1972) while one exchange improves the measure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal, final

import numpy as np

from precision_pin.analyses.calibration.design import (
    NEGLIGIBLE,
    Station,
    UnitNumbers,
    flat,
    project_out,
    read_poses,
    stack_at_means,
)
from precision_pin.analyses.calibration.estimates import Estimator
from precision_pin.analyses.calibration.forecast import task_poses
from precision_pin.analyses.calibration.identifiability import Identifiability, of_stack
from precision_pin.analyses.calibration.measurement import Measurement
from precision_pin.analyses.calibration.posterior import ErrorLeft, error_left
from precision_pin.analyses.provenance import Provenance
from precision_pin.display.stored import JsonResult
from precision_pin.draws.space import check_seed
from precision_pin.errors import Finding, InputError
from precision_pin.inputs.arguments import check_choice, check_instance, check_whole
from precision_pin.model.error_model import ErrorModel
from precision_pin.typing import Array

__all__ = ["CalibrationPlan", "plan_calibration"]

_STARTS: Final = 3
_EXCHANGES: Final = 500
_RIDGE: Final = 1e-9
"""Information on nuisances that is added, as a share of that of all candidates, so that few poses are no singular case."""
_STEPS: Final = 400
_GAP: Final = 5e-4
"""Gap of the relaxed problem, in units of the efficiency, at which it is solved."""

Criterion = Literal["task", "D"]


@final
@dataclass(frozen=True, eq=False, repr=False)
class CalibrationPlan(JsonResult):
    """The poses to measure.

    Attributes
    ----------
    provenance
        Robot, seed and versions.
    measurement
        Instrument and set-up.
    criterion
        ``"task"`` or ``"D"``.
    chosen
        Candidates to measure, in their order, from 0.
    names, q
        Their names, and joint values ``(n, count)``.
    candidates
        How many there were.
    value, bound
        The measure of the choice, and a bound that no choice of as many candidates can pass: ln det of the information on z
        (largest is best), or the mean square position error without the floor, m² (smallest is best).
    efficiency
        Of the choice, at least: for D ``exp((value - bound) / L)`` with L the combinations that all candidates together determine, for a task bound / value.
    random_efficiency
        The same of a random choice, the median of 25.
    identifiability
        What the chosen readings determine.
    poses
        The error before and after at each of the user's poses.
    findings
        Warnings.
    """

    schema: ClassVar[str] = "precision-pin/calibration-plan/1"
    provenance: Provenance
    measurement: Measurement
    criterion: Criterion
    chosen: tuple[int, ...]
    names: tuple[str, ...]
    q: Array
    candidates: int
    value: float
    bound: float
    efficiency: float
    random_efficiency: float
    identifiability: Identifiability
    poses: tuple[ErrorLeft, ...]
    findings: tuple[Finding, ...]

    @property
    def sliding_joints(self) -> tuple[str, ...]:
        """Sliding joints, whose values are in m."""
        return self.poses[0].sliding_joints

    @property
    def rank(self) -> int:
        """How many independent combinations of the numbers the chosen readings determine."""
        return self.identifiability.rank

    @property
    def observability(self) -> dict[str, float]:
        """O1 to O5."""
        return self.identifiability.observability

    def rms(self, which: str) -> float:
        """Return the root mean square error of the position over the user's poses: ``before``, ``after``, ``floor``."""
        return float(np.sqrt(np.mean([entry.rms(which) ** 2 for entry in self.poses])))

    def to_dict(self) -> dict[str, Any]:
        """Return the result in its JSON schema, SI units, base axes."""
        joints = tuple(self.poses[0].q)
        return {
            **self.provenance.to_dict(self.schema),
            "measurement": self.measurement.to_dict(),
            "criterion": self.criterion,
            "candidates": self.candidates,
            "count": len(self.chosen),
            "value": self.value,
            "bound": self.bound,
            "efficiency": self.efficiency,
            "random_efficiency": self.random_efficiency,
            "chosen": [
                {"candidate": k, "name": name, "q": dict(zip(joints, map(float, values), strict=True))}
                for k, name, values in zip(self.chosen, self.names, self.q.T, strict=True)
            ],
            "rms_position": {which: self.rms(which) for which in ("before", "after", "seen", "floor")},
            "identifiability": self.identifiability.to_dict(),
            "observability": self.observability,
            "poses": [entry.to_dict() for entry in self.poses],
            "findings": [finding.to_dict() for finding in self.findings],
        }

    def __repr__(self) -> str:
        return (
            f"<CalibrationPlan of {self.provenance.robot}: {len(self.chosen)} of {self.candidates} poses, {self.criterion} "
            f"efficiency at least {self.efficiency:.4g}>"
        )


def plan_calibration(
    model: ErrorModel,
    candidates: object,
    count: int,
    measurement: Measurement,
    *,
    at: object = None,
    criterion: Criterion = "task",
    seed: int = 0,
    findings: Sequence[Finding] = (),
) -> CalibrationPlan:
    """Choose the poses to measure among candidates.

    Parameters
    ----------
    model
        The model, whose sheet is the prior.
    candidates
        Poses that can be measured: a list, an array ``(n, P)``, a mapping of joint values or a pose set.
    count
        How many of them are measured, each once.
    measurement
        Instrument and set-up.
    at
        The user's own poses; the model's named poses if left out, else the candidates.
    criterion
        ``"task"``: the mean square position error left at the user's poses. ``"D"``: the determinant of the information.
    seed
        64-bit seed of the starting choices.
    findings
        Findings to pass on, such as those of the sheet.

    Raises
    ------
    InputError
        Fewer candidates than poses to choose, nothing varies from robot to robot, or no candidate sees anything.
    """
    check_instance("measurement", measurement, Measurement, "pp.Measurement(kind=..., std=...)")
    check_choice("the criterion", criterion, ("task", "D"))
    check_seed(seed)
    values, names = read_poses(model, candidates)
    total = values.shape[1]
    count = check_whole(
        "the number of poses to choose", count, 1, total, f"from 1 to {total}, the number of candidates"
    )
    unit = UnitNumbers.of(model.space)
    # each candidate by itself: one reading at its own pose
    stations = tuple(Station(one, (k,)) for k, one in enumerate(model.at_columns(np.ascontiguousarray(values))))
    by_z, by_nuisance = stack_at_means(stations, unit, measurement)
    if not by_z.any():
        raise InputError(
            "no candidate sees any number that varies from robot to robot; give other poses or another instrument"
        )
    tasks = task_poses(model, at, values)
    slopes = [one.jacobian[:3][:, unit.columns] @ unit.root for _, one in tasks]
    goal = sum((one.T @ one for one in slopes), np.zeros((by_z.shape[2],) * 2)) / len(slopes)
    design = _Design.of(by_z, by_nuisance, goal if criterion == "task" else None)
    generator = np.random.default_rng(seed)
    choices = [design.exchange(generator.permutation(total)[:count]) for _ in range(_STARTS)]
    best = min(choices, key=lambda chosen: design.loss(design.information(chosen)))
    bound = design.bound(best, count)
    rounded = np.sort(design.exchange(bound.rounded))
    chosen = min((np.sort(best), rounded), key=lambda one: design.loss(design.information(one)))
    loss = design.loss(design.information(chosen))
    random = [design.loss(design.information(generator.permutation(total)[:count])) for _ in range(25)]
    estimator = Estimator.of(flat(by_z[chosen]), flat(by_nuisance[chosen]), has_prior=True)
    plain = UnitNumbers(unit.columns, unit.names, unit.mean, unit.std, np.diag(unit.std))
    own = tuple(Station(stations[k].at, (row,)) for row, k in enumerate(chosen))
    found = of_stack(unit.names, *map(flat, stack_at_means(own, plain, measurement)), measurement, count)
    return CalibrationPlan(
        provenance=Provenance.of(model, seed),
        measurement=measurement,
        criterion=criterion,
        chosen=tuple(map(int, chosen)),
        names=tuple(names[k] for k in chosen),
        q=values[:, chosen],
        candidates=total,
        value=-loss if criterion == "D" else loss,
        bound=-bound.loss if criterion == "D" else bound.loss,
        efficiency=design.efficiency(loss, bound.loss),
        random_efficiency=design.efficiency(float(np.median(random)), bound.loss),
        identifiability=found,
        poses=tuple(error_left(one, name, unit, estimator, measurement) for name, one in tasks),
        findings=(*findings, *_remarks(found, design.efficiency(loss, bound.loss))),
    )


def _remarks(found: Identifiability, efficiency: float) -> tuple[Finding, ...]:
    remarks = []
    if efficiency < 0.99:
        message = (
            f"the choice is certified to {100 * efficiency:.3g} % of the best only; the bound counts parts of poses, and no "
            "exchange of two poses is better"
        )
        remarks.append(Finding("warning", "W_PLAN", message))
    if found.nuisance_rank < len(found.nuisances):
        message = (
            f"the chosen poses determine {found.nuisance_rank} of the {len(found.nuisances)} unknown numbers of the set-up; "
            "choose more"
        )
        remarks.append(Finding("warning", "W_SETUP", message))
    if found.unseen:
        listed = ", ".join(found.unseen[:3]) + (f" and {len(found.unseen) - 3} more" if len(found.unseen) > 3 else "")
        remarks.append(
            Finding("warning", "W_UNOBSERVABLE", f"no chosen pose sees {listed}; they keep their tolerances")
        )
    return tuple(remarks)


@final
@dataclass(frozen=True, eq=False)
class _Bound:
    """A bound of the loss of every choice, and the candidates with the largest weights of the relaxed design."""

    loss: float
    rounded: Array


@final
@dataclass(frozen=True, eq=False)
class _Design:
    """Losses of designs, to be minimised: -ln det S, or tr(G S⁻¹).

    Attributes
    ----------
    rows
        Derivatives of each candidate by z and by scaled nuisances, ``(P, m, r + k)``.
    prior
        Information before any reading, ``(r + k,) * 2``.
    size, rank
        r, and how many combinations of z all candidates together determine.
    goal
        G, ``(r, r)``; None for the determinant.
    """

    rows: Array
    prior: Array
    size: int
    rank: int
    goal: Array | None

    @classmethod
    def of(cls, by_z: Array, by_nuisance: Array, goal: Array | None) -> _Design:
        """Return the design of candidates; nuisances are scaled so that all candidates together give them unit information."""
        size, count = by_z.shape[2], by_nuisance.shape[2]
        scaled = by_nuisance
        if count:
            _, values, rows = np.linalg.svd(flat(by_nuisance), full_matrices=False)
            kept = values > 1e-9 * values[0]
            scaled = by_nuisance @ (rows[kept].T / values[kept])
        prior = np.diag(np.concatenate([np.ones(size), np.full(scaled.shape[2], _RIDGE)]))
        found = np.linalg.svd(project_out(flat(by_z), flat(by_nuisance))[0], compute_uv=False)
        rank = max(int((found > NEGLIGIBLE * found[0]).sum()), 1)
        return cls(np.concatenate([by_z, scaled], axis=2), prior, size, rank, goal)

    def information(self, chosen: Sequence[int] | Array) -> Array:
        """Return M of some candidates."""
        rows = flat(self.rows[np.asarray(chosen, dtype=np.intp)])
        result: Array = self.prior + rows.T @ rows
        return result

    def weighted(self, weights: Array) -> Array:
        """Return M of weights ``(P,)``."""
        rows = flat(self.rows)
        result: Array = self.prior + (rows * np.repeat(weights, self.rows.shape[1])[:, None]).T @ rows
        return result

    def loss(self, information: Array) -> float:
        """Return the loss of M."""
        if self.goal is None:
            nuisance = information[self.size :, self.size :]
            return float(np.linalg.slogdet(nuisance)[1] - np.linalg.slogdet(information)[1])
        inverse = np.linalg.inv(information)[: self.size, : self.size]
        return float(np.einsum("ij,ji->", self.goal, inverse))

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
            left = inverse[:, : self.size]
            middle = left @ self.goal @ left.T
        gains = np.einsum("pmi,ij,pmj->p", self.rows, middle, self.rows, optimize=True)
        return self.loss(information), -gains

    def exchange(self, chosen: Array) -> Array:
        """Return a choice that no exchange of one pose for another improves."""
        chosen = np.array(chosen, dtype=np.intp)
        rest = np.setdiff1d(np.arange(len(self.rows)), chosen)
        for _ in range(_EXCHANGES):
            if not rest.size:
                break
            change = self._changes(chosen, rest)
            out, into = np.unravel_index(int(np.argmin(change)), change.shape)
            here = self.loss(self.information(chosen))
            chosen[out], rest[into] = rest[into], chosen[out]
            there = self.loss(self.information(chosen))
            if not there < here - 1e-12 * max(1.0, abs(here)):
                chosen[out], rest[into] = rest[into], chosen[out]
                break
        return chosen

    def _changes(self, chosen: Array, rest: Array) -> Array:
        """Return the change of loss of every exchange, ``(count, P - count)``, by updates of low rank."""
        inverse = np.linalg.inv(self.information(chosen))
        change = _log_changes(self.rows, inverse, chosen, rest)
        if self.goal is None:
            nuisance = self.rows[:, :, self.size :]
            if nuisance.shape[2]:
                own = np.linalg.inv(self.information(chosen)[self.size :, self.size :])
                return _log_changes(nuisance, own, chosen, rest) - change
            return -change
        left = inverse[:, : self.size]
        return _trace_changes(self.rows, inverse, left @ self.goal @ left.T, chosen, rest)

    def bound(self, start: Array, count: int) -> _Bound:
        """Return a bound of the loss of every choice of so many candidates, by the relaxed design."""
        weights = np.full(len(self.rows), count / len(self.rows))
        weights[start] += 1.0
        weights = _project(weights / 2, count)
        best, step = -np.inf, 1.0
        loss, slopes = self.slopes(weights)
        for _ in range(_STEPS):
            order = np.argsort(slopes, kind="stable")
            vertex = np.zeros_like(weights)
            vertex[order[:count]] = 1.0
            best = max(best, loss + float(slopes @ (vertex - weights)))
            if self.efficiency(loss, best) > 1 - _GAP:
                break
            weights, loss, slopes, step = self._descend(weights, loss, slopes, step, count)
        return _Bound(best, np.argsort(-weights, kind="stable")[:count])

    def _descend(
        self, weights: Array, loss: float, slopes: Array, step: float, count: int
    ) -> tuple[Array, float, Array, float]:
        """Return weights after a projected gradient step, with their loss and slopes, and the length of the next step."""
        scale = step / max(float(np.abs(slopes).max()), 1e-300)
        for _ in range(40):
            moved = _project(weights - scale * slopes, count)
            change = moved - weights
            new_loss, new_slopes = self.slopes(moved)
            if new_loss <= loss + 1e-4 * float(slopes @ change):
                curvature = float((new_slopes - slopes) @ change)
                length = float(change @ change) / curvature if curvature > 0 else 2 * scale
                return moved, new_loss, new_slopes, length * max(float(np.abs(new_slopes).max()), 1e-300)
            scale /= 4
        return weights, loss, slopes, step / 10


def _project(weights: Array, count: int) -> Array:
    """Return the closest weights within 0 and 1 whose sum is ``count``."""
    low, high = float(weights.min()) - 1.0, float(weights.max())
    for _ in range(100):
        middle = (low + high) / 2
        if np.clip(weights - middle, 0.0, 1.0).sum() > count:
            low = middle
        else:
            high = middle
    result: Array = np.clip(weights - (low + high) / 2, 0.0, 1.0)
    return result


def _pairs(rows: Array, middle: Array, chosen: Array, rest: Array) -> tuple[Array, Array, Array]:
    """Return ``A_i X A_iᵀ`` of chosen ones, of the rest, and ``A_i X A_jᵀ`` of all pairs ``(count, rest, m, m)``."""
    size = rows.shape[1]
    ours, others = rows[chosen], rows[rest]
    through = ours @ middle
    own = np.einsum("pmi,pni->pmn", through, ours)
    their = np.einsum("pmi,pni->pmn", others @ middle, others)
    cross = (flat(through) @ flat(others).T).reshape(len(ours), size, len(others), size).transpose(0, 2, 1, 3)
    return own, their, cross


def _log_changes(rows: Array, inverse: Array, chosen: Array, rest: Array) -> Array:
    """Return the change of ln det M of every exchange: det(I - U) det(I + V + Cᵀ (I - U)⁻¹ C) with Schur complements."""
    own, their, cross = _pairs(rows, inverse, chosen, rest)
    eye = np.eye(rows.shape[1])
    left = eye - own
    inner = eye + their[None] + np.swapaxes(cross, 2, 3) @ np.linalg.solve(left[:, None], cross)
    result: Array = np.linalg.slogdet(left)[1][:, None] + np.linalg.slogdet(inner)[1]
    return result


def _trace_changes(rows: Array, inverse: Array, middle: Array, chosen: Array, rest: Array) -> Array:
    """Return the change of ``tr(G S⁻¹)`` of every exchange: ``-tr((D + W)⁻¹ F)`` with D = diag(-I, I)."""
    size = rows.shape[1]
    blocks = []
    for kernel in (inverse, middle):
        own, their, cross = _pairs(rows, kernel, chosen, rest)
        block = np.empty((len(chosen), len(rest), 2 * size, 2 * size))
        block[:, :, :size, :size] = own[:, None]
        block[:, :, size:, size:] = their[None]
        block[:, :, :size, size:] = cross
        block[:, :, size:, :size] = np.swapaxes(cross, 2, 3)
        blocks.append(block)
    weights, effect = blocks
    signs = np.diag(np.concatenate([-np.ones(size), np.ones(size)]))
    result: Array = -np.einsum("abii->ab", np.linalg.solve(weights + signs, effect))
    return result
