"""Errors that a sheet lacks: score tests of a fit's residuals along the directions of known causes.

Whitened readings are ``y = G a + H z + N n + e`` with z of unit covariance (the sheet), n without prior, and a zero if the
sheet is complete. With S the residual matrix of y, the residuals are S y, and the score by a at a = 0 is G'S y with the
covariance A = G'S G. For amplitudes of one unknown variance the most powerful test against small ones is the quadratic form
|G'S y|². The probabilities of all causes, which depend on each other, are combined by Cauchy variables (Liu and Xie 2020). Causes
that are found compete by their largest likelihood over that variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy import stats

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import Estimator
from precision_pin.analyses.calibration.fit import GROSS, Fit, Problem, leave_out
from precision_pin.analyses.calibration.forecast import normal_interval
from precision_pin.analyses.calibration.noise import LEVEL, Reduction
from precision_pin.analyses.number_law import tail
from precision_pin.base.arrays import Array, Record
from precision_pin.terms import at_means

FALSE_ALARMS: Final = 0.0075
"""Probability, over all causes, that any is found on a robot of the sheet; by simulation 0.008 to 0.011."""
AS_LIKELY: Final = 20.0
"""Ratio of likelihoods up to which another cause explains the readings as well."""
_KNOWN: Final = 0.999
"""Cosine to a number of the sheet above which a cause counts as this number."""
_UNSEEN: Final = 1e-9
"""Share of a direction that set-up and arm must leave for it to be tested, and square of a tolerance's effect, in variances."""
_ROUNDED: Final = 9
"""Decimal places of a torque, N*m: the axis of a joint that carries nothing has rounding only."""
_VARIANCES: Final = np.logspace(-3, 8, 111)
"""Variances of amplitudes at which the likelihood is evaluated, over the mean variance of their estimates."""

Label = tuple[str, str, str]
"""Kind of a cause, its joint and unit."""
WAVES: Final = tuple(f"wave, {order} in a turn" for order in range(1, 5))
"""Orders of joint waves that are tested."""
COMPLIANCE: Final = "compliance"
SETTLING: Final = "settling"
"""Read before the arm had arrived: a share of the step from the pose before is left, or its speed times a time."""
BACKLASH: Final = ("backlash by motion", "backlash by load")
OF_JOINTS: Final = ("zero", *np.repeat(WAVES, 2).tolist(), *BACKLASH, COMPLIANCE, SETTLING)
"""Kinds of the columns of each joint, a sine and a cosine for each wave."""
OF_SET_UP: Final = (*[("drift of base or instrument", "", "m")] * 3, ("growth of the arm", "", "1"))
"""Kinds, joints and units of the columns of the set-up: a drift along each axis, and a growth, in the order of readings."""
BY_TEMPERATURE: Final = (*[("drift by temperature", "", "m/K")] * 3, ("growth by temperature", "", "1/K"))
"""The same by the temperature, where the readings have one."""
_UNITS: Final = {True: ("m", "m/N"), False: ("rad", "rad/(N*m)")}
"""Units of a joint's error and of its compliance, by whether it is prismatic."""
_PRINTED: Final = {
    "rad": (1e3, "mrad"),
    "m": (1e3, "mm"),
    "1": (1e6, "ppm"),
    "m/K": (1e3, "mm/K"),
    "1/K": (1e6, "ppm/K"),
    "step": (1e2, "% of the step"),
    "s": (1e3, "ms"),
}
"""Factor and printed unit of each SI unit."""
TOLERANCE: Final = "tolerance too small"


@dataclass(frozen=True)
class Cause(Record):
    """An error that the sheet lacks and that explains what the fit leaves.

    Attributes:
        kind: What it is; ``tolerance too small`` is no other error, but a number of the sheet, which ``joint`` names then.
        joint: The joint, or of several joints that with the largest error; empty for the set-up.
        is_shared: Whether several joints have it.
        size, interval, unit: Amplitude of a wave, gap of a backlash, compliance, share of the step that is left or, of given
            speeds, time, way of a drift or share of a growth from the first reading to the last or for each kelvin, in prior
            standard deviations of a tolerance: posterior mean and 95 % interval, for a variance as likely as possible.
        likelihood: Relative to that of the likeliest cause.
        left_out: Root mean square (m) by which it displaces readings left out of the fit from their predictions.
    """

    kind: str
    joint: str
    is_shared: bool
    size: float
    interval: tuple[float, float]
    unit: str
    likelihood: float
    left_out: float

    def __str__(self) -> str:
        scale, unit = _PRINTED.get(self.unit, (1.0, self.unit))
        low, high = (f"{scale * bound:.3g}" for bound in self.interval)
        name = labelled(self.kind, self.joint, is_shared=self.is_shared)
        return f"{name} ({scale * self.size:.3g} {unit}; 95 %: {low} to {high})"


def labelled(kind: str, joint: str, *, is_shared: bool) -> str:
    """Return a cause in words."""
    return f"{kind} of {joint}{' and others' * is_shared}" if joint else kind


class CauseScore(NamedTuple):
    """A cause: its columns, the probability of larger scores, the log of its likelihood ratio, amplitudes there, their std."""

    columns: NDArray[np.intp]
    chance: float
    gain: float
    mean: Array
    covariance: Array
    std: float


Scores = tuple[Array, Array, float, int, float | None]
"""Scores G'S y ``(C,)``, G'S G ``(C, C)``, y'S y, its degrees of freedom, and those apart from these readings that the standard
deviation rests on; ``None`` where it was tuned to them."""


def weigh(columns: NDArray[np.intp], of: Scores) -> CauseScore:
    """Return the evidence for a cause with some columns."""
    amplitudes, information, total, degrees, std_degrees = of
    values, vectors = np.linalg.eigh(information[np.ix_(columns, columns)])
    values, scores = np.maximum(values, 0.0), vectors.T @ amplitudes[columns]
    # of a std that was tuned, the score's share of chi-square
    ratio = float(scores @ scores) / (std_degrees or total)
    chance = tail(values - ratio * (not std_degrees), ratio, std_degrees or max(degrees - len(values), 0))
    shrunk = 1 / (values.mean() / _VARIANCES[:, None] + values)
    gains = (shrunk * scores**2 + np.log(shrunk * values.mean() / _VARIANCES[:, None])).sum(axis=1) / 2
    best = int(np.argmax(gains))
    spread, std = vectors * shrunk[best], float(np.sqrt(_VARIANCES[best] / max(values.mean(), 1e-300)))
    return CauseScore(columns, chance, float(gains.max()), spread @ scores, spread @ vectors.T, std)


@dataclass(frozen=True, eq=False)
class CauseColumns:
    """Readings per unit of every cause.

    Attributes:
        labels: What the causes are.
        by_error: Derivatives of readings by the tip's error, ``(P, m, 6)``.
        statics: The joints' Jacobian ``(P, 6, n)``, the torques on joints ``(P, n)`` and the tip ``(P, 3)``.
        angles, motion_signs, unsettled: Angles of the waves, directions of the last motion, and steps or speeds, ``(n, P)``.
        clocks: Time, and temperature if the readings have one, each about its mean, ``(c, P)``.
        chosen: Numbers of the causes that are wanted.
    """

    labels: list[Label]
    by_error: Array
    statics: tuple[Array, Array, Array]
    angles: Array
    motion_signs: Array
    unsettled: Array
    clocks: Array
    chosen: NDArray[np.intp]

    @classmethod
    def at(cls, problem: Problem, data: CalibrationData, nuisances: Array) -> CauseColumns:
        """Return the causes of errors in readings."""
        chain, q = problem.model.chain, data.q
        of_settling = "s" if data.speed.size else "step"
        labels = [
            (kind, name, of_settling if kind == SETTLING else _UNITS[slides][kind == COMPLIANCE])
            for name, slides in zip(chain.joint_names, chain.prismatic.tolist(), strict=True)
            for kind in OF_JOINTS
        ]
        labels += [*OF_SET_UP, *(BY_TEMPERATURE if data.temperature.size else ())]
        _, first_rows, visit = np.unique(problem.visit, return_index=True, return_inverse=True)
        steps = np.diff(q[:, first_rows], axis=1, prepend=q[:, first_rows[:1]])
        # a joint at rest keeps the direction of its last motion
        moves = np.maximum.accumulate(np.where(np.abs(steps) > _UNSEEN, np.arange(first_rows.size), 0), axis=1)
        motion_signs = np.sign(np.take_along_axis(steps, moves, axis=1))[:, visit]
        angles = 2 * np.pi * q / np.where(chain.prismatic, np.maximum(np.ptp(q, axis=1), _UNSEEN), 2 * np.pi)[:, None]
        clocks = [visit / max(first_rows.size - 1, 1) - 0.5]
        clocks += [data.temperature - data.temperature.mean()] if data.temperature.size else []
        unsettled = data.speed if data.speed.size else steps[:, visit]
        of_joints = _statics(problem), angles, motion_signs, unsettled
        return cls(labels, problem.evaluation.by_error(nuisances), *of_joints, np.array(clocks), np.arange(len(labels)))

    def only(self, chosen: NDArray[np.intp]) -> CauseColumns:
        """Return some of the causes."""
        return replace(self, chosen=chosen)

    def of(self, rows: NDArray[np.intp]) -> Array:
        """Return the readings per unit of the causes of some rows, ``(R, m, C)``."""
        jacobians, torques, points = (of_all[rows] for of_all in self.statics)
        angles, motion_signs, unsettled = self.angles[:, rows], self.motion_signs[:, rows], self.unsettled[:, rows]
        errors = []
        for k in range(len(angles)):
            waves = [wave(order * angles[k]) for order in range(1, len(WAVES) + 1) for wave in (np.sin, np.cos)]
            signs = motion_signs[k] / 2, np.sign(torques[:, k]) / 2
            shapes = np.column_stack([np.ones(len(rows)), *waves, *signs, torques[:, k], unsettled[k]])
            errors.append(jacobians[:, :, k, None] * shapes[:, None])
        shifts = np.broadcast_to(np.eye(6, 3), (len(rows), 6, 3))
        growth = np.eye(6, 3) @ points[:, :, None]
        errors += [clock[rows, None, None] * np.concatenate([shifts, growth], axis=2) for clock in self.clocks]
        return np.asarray(self.by_error[rows] @ np.concatenate(errors, axis=2)[:, :, self.chosen])


def _statics(problem: Problem) -> tuple[Array, Array, Array]:
    """Return the joints' Jacobian ``(P, 6, n)``, the torques on joints at the means ``(P, n)`` and the tip ``(P, 3)``."""
    count, joints = len(problem.readings), len(problem.model.chain.joints)
    jacobians, torques, points = np.zeros((count, 6, joints)), np.zeros((count, joints)), np.zeros((count, 3))
    share = cache(lambda factors: float(at_means({factors: 1.0}, problem.model.space)))
    for station in problem.each_station():
        posture, rows = station.at.posture, list(station.rows)
        jacobians[rows], points[rows] = posture.joint_jacobian, posture.pose[:3, 3]
        torques[rows] = [
            sum(float(part) * share(factors) for factors, part in posture.torque_on(k).items()) for k in range(joints)
        ]
    return jacobians, torques.round(_ROUNDED), points


def rank(
    of: Scores, labels: Sequence[Label], is_usable: NDArray[np.bool_]
) -> tuple[float, list[CauseScore], dict[str, CauseScore]]:
    """Return the probability of such scores if the sheet is complete, the causes that explain them best, that of each kind."""
    groups = dict[tuple[str, str], list[int]]()
    for k in np.flatnonzero(is_usable).tolist():
        for key in dict.fromkeys([labels[k][:2], (labels[k][0], "")]):
            groups.setdefault(key, []).append(k)
    # a kind with a single joint has one candidate only
    causes = {key: weigh(np.array(ids), of) for ids, key in {tuple(ids): key for key, ids in groups.items()}.items()}
    # single joints and shared causes have half of the weight each
    non_tolerances = [key for key in causes if key[0] != TOLERANCE]
    is_shared = np.array([not joint for _, joint in non_tolerances], dtype=bool)
    weights = 1 / np.maximum(np.where(is_shared, is_shared.sum(), (~is_shared).sum()), 1)
    variables = [np.tan((0.5 - np.clip(causes[key].chance, 1e-15, 0.99)) * np.pi) for key in non_tolerances]
    chance = float(stats.cauchy.sf(weights @ variables / max(weights.sum(), 1.0)))
    likely = sorted(causes, key=lambda key: -round(causes[key].gain, 3))
    bound = max(causes[likely[0]].gain - np.log(AS_LIKELY), 0.0) if likely else 0.0
    # the likeliest kind shared by several joints is no separate cause
    close = [key for key in likely if causes[key].gain > bound and (key == likely[0] or key != (likely[0][0], ""))]
    best_of_kinds = {key[0]: causes[key] for key in reversed(likely)}
    return chance, [causes[key] for key in close], best_of_kinds


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the residuals of a fit say about causes.

    Attributes:
        problem, fit: Readings with weight, and their fit.
        causes: Their readings per unit of every cause.
        reduction: Of the readings at the estimate, with the causes.
        columns, labels: Reduced readings ``(R, C)`` per unit of every cause and of every number, and what they are.
        root, over: Root of the leverage of the fit that is tested, reduced ``(R, n)``; as coefficients ``(k + U, n)`` of the
            nuisances and numbers.
        chance, likely: Probability of such residuals if the sheet is complete, and the causes that explain them best.
        best_of_kinds: The likeliest cause of each kind.
    """

    problem: Problem
    fit: Fit
    causes: CauseColumns
    reduction: Reduction
    columns: Array
    labels: list[Label]
    root: Array
    over: Array
    chance: float
    likely: list[CauseScore]
    best_of_kinds: dict[str, CauseScore]

    @classmethod
    def of(cls, problem: Problem, fit: Fit, data: CalibrationData, known: float | None) -> Evidence:
        """Return the evidence of readings with weight and their fit.

        ``known`` are the degrees of freedom of the standard deviation apart from these readings; ``None`` where it was tuned
        to them.
        """
        causes = CauseColumns.at(problem, data, fit.nuisances)
        reduction = problem.reduce(fit.z, fit.nuisances, causes)
        by_z, by_number, set_up = problem.by_z(reduction), problem.by_number(reduction), reduction.nuisances
        # parameters that are not estimated have their prior, all others none
        basis = fit.estimator.basis[:, :0] if fit.estimator.has_prior else fit.estimator.basis
        estimator = Estimator.of(by_z, np.hstack([reduction.by_nuisance, by_z @ basis]), has_prior=True)
        of_fixed, of_z = np.split(estimator.root_by_columns, [set_up + basis.shape[1]])
        over = scipy.linalg.block_diag(np.eye(set_up), basis) @ of_fixed
        over[set_up:] += of_z
        columns = np.hstack([reduction.rows[:, set_up + by_number.shape[1] : -1], by_number])
        readings, root, new = reduction.white + by_z @ fit.z, estimator.leverage_root(), len(causes.labels)
        gram, through, residuals = columns.T @ columns, root.T @ columns, readings - root @ (root.T @ readings)
        information, squares = gram - through.T @ through, np.diag(gram)
        is_usable = np.diag(information) > _UNSEEN * squares
        is_usable[new:] &= squares[new:] > _UNSEEN
        is_usable[:new] &= (gram[:new, new:] ** 2 <= _KNOWN**2 * np.outer(squares[:new], squares[new:])).all(axis=1)
        labels = [*causes.labels, *((TOLERANCE, name, "prior std") for name in problem.unit.names)]
        total, degrees = float(readings @ residuals), reduction.size - estimator.nuisance_rank
        ranked = rank((columns.T @ residuals, information, total, degrees, known), labels, is_usable)
        over = problem.over_numbers(over)
        return cls(problem, fit, causes, reduction, columns, labels, root, over, *ranked)

    def chosen(self, candidate: CauseScore) -> tuple[Reduction, CauseColumns]:
        """Return the reduction of nuisances, numbers and a cause, and the columns of the cause; those of numbers are there."""
        columns, size = candidate.columns[candidate.columns < len(self.causes.labels)], len(self.over)
        return self.reduction.only(np.concatenate([np.arange(size), size + columns])), self.causes.only(columns)

    def coefficients(self, candidate: CauseScore, of_cause: Array, of_others: Array) -> Array:
        """Return coefficients of nuisances, numbers and a cause, ``(c, …)``, for those of the cause and of the others."""
        number = candidate.columns - len(self.causes.labels)
        others = of_others.copy()
        others[self.reduction.nuisances + number[number >= 0]] += of_cause[number >= 0]
        return np.concatenate([others, of_cause[number < 0]])

    def owner(self, candidate: CauseScore) -> tuple[str, str, bool]:
        """Return the kind of a cause, its joint, of several that with the largest error, and whether there are several."""
        owners = np.array([self.labels[k][1] for k in candidate.columns])
        joint = max(owners.tolist(), key=lambda name: float(np.linalg.norm(candidate.mean[owners == name])))
        return self.labels[candidate.columns[0]][0], joint, np.unique(owners).size > 1


def explained(evidence: Evidence, problem: Problem, data: CalibrationData, gross: Sequence[int]) -> list[int]:
    """Return which of readings without weight the likeliest cause explains: beside it they are no gross errors.

    ``problem`` has all readings. The fit of the others follows the cause too, first order.
    """
    fit, candidate = evidence.fit, evidence.likely[0]
    alone = problem.without(np.setdiff1d(np.arange(len(data)), gross).tolist())
    local = fit.local(evidence.reduction, evidence.problem.by_z(evidence.reduction))
    of_fit = evidence.columns[:, candidate.columns] @ candidate.mean
    z = local.inverse @ (local.left.T @ of_fit)
    followed = problem.over_numbers(np.concatenate([local.nuisances(of_fit - local.by_z @ z), z]))
    causes = CauseColumns.at(alone, data, fit.nuisances).only(evidence.chosen(candidate)[1].chosen)
    change = np.append(evidence.coefficients(candidate, -candidate.mean, followed), 1.0)
    result = list[int]()
    for rows, columns in alone.white_columns(fit.z, fit.nuisances, causes):
        shared, white = columns[:, : -change.size], columns[:, -change.size :] @ change
        for row in np.unique(rows).tolist():
            w, y = shared[rows == row], white[rows == row]
            if y @ np.linalg.solve(np.eye(len(y)) + w @ w.T, y) <= stats.chi2.isf(GROSS / len(data), len(y)):
                result.append(row)
    return sorted(result)


def find_causes(evidence: Evidence, groups: NDArray[np.intp]) -> list[Cause]:
    """Return the errors that explain the residuals of a fit, likeliest first; none if a complete sheet explains them.

    ``groups`` tell which readings are left out together, ``(P,)``.
    """
    problem, fit, root, causes = evidence.problem, evidence.fit, evidence.root, []
    point, likely = (fit.z, fit.nuisances), evidence.likely if evidence.chance <= FALSE_ALARMS else []
    throughs = [problem.through(point, evidence.reduction, evidence.over)] if likely else []
    for candidate in likely:
        followed = evidence.over @ (root.T @ (evidence.columns[:, candidate.columns] @ candidate.mean))
        left = evidence.coefficients(candidate, candidate.mean, -followed)
        effect = problem.combined(*point, left, evidence.chosen(candidate)[1])
        without = leave_out(problem, throughs, effect, groups)
        shifts = without.values[without.is_predicted, :3]
        kind, joint, is_shared = evidence.owner(candidate)
        of_joint = [evidence.labels[k][1] == joint for k in candidate.columns]
        size = float(np.linalg.norm(mean := np.where(of_joint, candidate.mean, 0.0)))
        low, high = normal_interval(size, float(np.sqrt(mean @ candidate.covariance @ mean)) / size, LEVEL)
        unit = evidence.labels[candidate.columns[int(np.argmax(of_joint))]][2]
        facts = size, (max(low, 0.0), high), unit, float(np.exp(candidate.gain - evidence.likely[0].gain))
        rms = float(np.linalg.norm(shifts)) / max(len(shifts), 1) ** 0.5
        causes.append(Cause(kind, joint, is_shared, *facts, rms))
    return causes
