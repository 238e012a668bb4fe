"""The calibration of one robot from its readings."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress, product
from typing import Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse, spatial, stats

from precision_pin.analyses.calibration import design
from precision_pin.analyses.calibration import fit as fitting
from precision_pin.analyses.calibration.causes import Cause, Evidence, explained, find_causes
from precision_pin.analyses.calibration.data import CalibrationData, approached, check_data, read_data
from precision_pin.analyses.calibration.drift import drift_warnings
from precision_pin.analyses.calibration.forecast import (
    PosesOutcome,
    Posterior,
    errors_left,
    interval_after,
    normal_interval,
)
from precision_pin.analyses.calibration.gains import MIN_GROUPS, CauseGain, cause_warnings, find_gains, gain_interval
from precision_pin.analyses.calibration.instrument import length_stds
from precision_pin.analyses.calibration.noise import LEVEL
from precision_pin.analyses.calibration.start import check_directions, nominal_distance
from precision_pin.analyses.calibration.std_estimate import EstimatedStd, chance_of, estimate_std, std_warnings
from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.readings import measurements_of
from precision_pin.base import se3
from precision_pin.base.arguments import check_flag, check_items, check_name, check_number, check_path
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.files import write_files
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Estimates, Space, held_at_mean
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.pose_grids import random_poses
from precision_pin.sheet.measurement import Measurement
from precision_pin.statistics import clopper_pearson
from precision_pin.writers.as_built import AsBuilt

_STD_ROUNDS: Final = 8
"""Largest number of rounds in which std and gross errors are estimated in turn."""
_UNSEEN_POSES: Final = 100
"""Random poses at which a written URDF is compared."""
_STD_SETTLED: Final = 0.01
"""Relative change of an estimated std at which it has converged; its own interval is some 10 % wide."""
_SEARCH_STEPS: Final = 3
"""Steps of a fit that only searches for gross errors; it need not converge while there are any."""


@dataclass(frozen=True)
class GrossError(Record):
    """A reading without weight: its row, from 1, the length (m) of its residual in the fit without it, its size in std.

    ``reading`` is its number in the data, from 0; ``turn`` the angle (rad) of the residual of an attitude.
    """

    KEYS: ClassVar[Keys] = ("line", "reading", "size", "turn", "deviations", "weight")
    weight: ClassVar[float] = 0.0

    line: int
    size: float
    deviations: float
    reading: int
    turn: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CalibrationResult(PosesOutcome):
    """A calibrated robot, in addition to :class:`PosesOutcome`.

    Attributes:
        has_prior: Whether the sheet was the prior.
        posterior, without_bounds: The numbers drawn once for each robot, and their estimates where no law had bounds,
            ``(U,)``.
        set_ups: The estimated set-up of each of ``data.measurements``; ``measurement`` and ``set_up`` are the first.
        chi_square, degrees_of_freedom: Sum of squares of whitened residuals (with a prior, and of z), its expectation.
        residuals, residuals_before: Reading less prediction of the calibrated arm, in base axes, ``(P, m)``; of the
            sheet's means with the set-up that fits them best. Readings of fewer numbers end in zeros.
        left_out: Reading less the prediction of a fit without its pose (its group, where the data have groups),
            ``(P, m)``, first order.
        std_left_out, std_predicted: Standard deviation of ``left_out``, and of a new reading at the pose from the
            calibrated arm's prediction: what is left of arm and set-up, repeatability and instrument, ``(P, m)``.
        improvement: Whether the calibration helps at poses left out of it; ``None`` where none can be predicted.
        causes: Errors that the sheet lacks, the likeliest first; empty where it may be complete.
        gains: What each kind of cause, and joint values as read, would change at left-out poses, the best first.
        noise, repeated: Standard deviations that were estimated, by name, and the numbers read again at a pose.
        gross_errors, at_bounds: Readings that were given no weight, and numbers estimated at a bound of their law.
        original, model: The model before, and the arm that is left: means moved, remaining uncertainty correlated.
        fitted, estimator, nuisances: The model whose numbers were estimated, the linear estimate of these, and the set-up, from a
            first guess of the base.
        data, steps: The readings as given, and Gauss-Newton steps.
    """

    schema: ClassVar[str] = "precision-pin/calibration/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "measurement", "measurements=data.measurements", "prior=has_prior", "readings"),
        *("verdict", "causes", "gains"),
        *("chi_square", "degrees_of_freedom", "probability", "steps", "rms_residual", "gross_errors", "at_bounds"),
        *("set_up", "set_ups", "rank", "observability", "identifiability", "posterior", "in_sheet", "intervals"),
        *("poses", "residuals", "residuals_before", "residuals_left_out=left_out", "std_left_out", "std_predicted"),
        *("improvement", "noise", "drift=data.sessions", "lines=data.lines", "data=given"),
        *("kinematics=original.chain.kinematics", "findings"),
    )

    has_prior: bool
    posterior: Posterior
    without_bounds: Array
    set_ups: tuple[design.SetUp, ...]
    chi_square: float
    degrees_of_freedom: int
    residuals: Array
    residuals_before: Array
    left_out: Array
    std_left_out: Array
    std_predicted: Array
    improvement: Improvement | None
    causes: tuple[Cause, ...]
    gains: tuple[CauseGain, ...]
    noise: Mapping[str, EstimatedStd]
    repeated: int
    gross_errors: tuple[GrossError, ...]
    at_bounds: tuple[str, ...]
    original: ErrorModel
    model: ErrorModel
    fitted: ErrorModel
    estimator: design.Estimator
    nuisances: Array
    data: CalibrationData
    steps: int

    @property
    def set_up(self) -> design.SetUp:
        """The set-up of the first measurement as estimated."""
        return self.set_ups[0]

    @property
    def readings(self) -> int:
        """Number of readings."""
        return len(self.data)

    @property
    def probability(self) -> float | None:
        """Probability that a right model gives a larger chi-square; ``None`` where a std was tuned to the model's residuals."""
        return chance_of(self.chi_square, self.degrees_of_freedom, self.noise, self.repeated)

    @property
    def verdict(self) -> Verdict:
        """Whether model and data agree."""
        chance = self.probability
        if self.causes or chance is None or chance < fitting.DOUBTFUL:
            return "disagrees" if self.causes or chance is not None else "not tested"
        return "better than stated" if self.degrees_of_freedom > 0 and 1 - chance < fitting.DOUBTFUL else "agrees"

    def interval(self, name: str, probability: float = LEVEL) -> tuple[float, float]:
        """Return the interval of a number drawn once for each robot, SI, with the same probability outside on both sides.

        It heeds the number's own law: of a number of which little is learned it is that of the law. Without a prior it is that
        of a normal number where anything is learned. A wrong name or probability is an :class:`InputError`.
        """
        number = self.posterior.names.index(check_name("component", name, self.posterior.names))
        check_number("the probability", probability, "between 0 and 1", lambda value: 0 < value < 1)
        # where the number itself stops at a bound, how far the readings would have it beyond says how much lies near the bound
        estimate = float(self.without_bounds[number]) if name in self.at_bounds else self.posterior.mean[name]
        variance_left = 1 - self.posterior.learned[name]
        if not self.has_prior and variance_left < 1:
            return normal_interval(estimate, self.posterior.std[name], probability)
        owner = next(draw for draw in self.original.space.draws if name in draw.components)
        std = self.posterior.prior_std[name]
        return interval_after(owner.law, owner.components.index(name), estimate, std, variance_left, probability)

    @cached_property
    def components(self) -> Array:
        """Estimated values of all components of the original model's space, ``(d,)``; of other scopes their means."""
        space = self.original.space
        x = space.mean.copy()
        x[[space.index[name] for name in self.posterior.names]] = list(self.posterior.mean.values())
        return x

    def predict(self, q: ArrayLike | Mapping[str, float] | str | None = None) -> Array:
        """Return the tip of the calibrated arm in the base, ``(4, 4)``; ``q`` as for :meth:`ErrorModel.at`."""
        at = self.original.at(q)
        return se3.displaced(at.posture.pose, at.exact(self.components[:, None])[:, 0])

    def to_urdf(
        self,
        path: str | os.PathLike[str],
        q: ArrayLike | Mapping[str, float] | str | None = None,
        *,
        loads: bool = True,
    ) -> tuple[str, ...]:
        """Write the calibrated arm as a URDF, and return the labels of the sources that hold at one pose only.

        What loads cause, and what changes with the pose, is written as it is at the pose ``q``, the model's first if left
        out; everything else holds at every pose. Without ``loads`` what they cause is left out.

        Raises:
            OutputError: The file cannot be written.
            InputError: The robot's file has changed.
        """
        name = check_path("the path of the URDF", path)
        check_flag("loads", loads)
        writer = AsBuilt.prepare(self.original, q, loads=loads)
        write_files({name: writer.fitted(self.components)})
        return writer.frozen

    def urdf_error(self, q: ArrayLike | Mapping[str, float] | str | None = None, *, loads: bool = True) -> float:
        """Return how far the tip of the URDF of :meth:`to_urdf` is from the calibrated arm's, m, rms over 100 random poses."""
        writer, model = AsBuilt.prepare(self.original, q, loads=loads), self.original
        poses = random_poses(model.chain, _UNSEEN_POSES).q
        tips, _ = writer.tips(writer.fitted(self.components), poses)
        x = self.components[:, None]
        arms = [se3.displaced(at.posture.pose, at.exact(x)[:, 0]) for at in model.at_columns(poses)]
        return float(np.sqrt(((np.array(tips) - arms)[:, :3, 3] ** 2).sum(axis=1).mean()))

    def rms(self, which: Literal["before", "after", "left out"]) -> float:
        """Return the root mean square length (m) of the residuals of the readings that have weight."""
        values = {"before": self.residuals_before, "after": self.residuals, "left out": self.left_out}[which]
        weighted = np.delete(values, [error.reading for error in self.gross_errors], axis=0)
        return float(np.sqrt((weighted[:, :3] ** 2).sum(axis=1).mean()))

    @property
    def rms_residual(self) -> dict[str, float]:
        """Root mean squares of :meth:`rms`, as in the JSON."""
        return {which.replace(" ", "_"): self.rms(which) for which in ("before", "after", "left out")}

    @property
    def in_sheet(self) -> dict[str, dict[str, float]]:
        """Mean and deviation of each number by the sheet's laws, as in the JSON; of a sheet calibrated before not the prior."""
        if self.original.sheet is None:
            return {}
        space = self.original.sheet.whole_space
        stds = np.sqrt(space.block_covariance.variances)
        columns = {name: space.index[name] for name in self.posterior.names if name in space.index}
        return {name: {"mean": float(space.mean[k]), "std": float(stds[k])} for name, k in columns.items()}

    @property
    def intervals(self) -> dict[str, Any]:
        """The 95 % interval of each number, as in the JSON."""
        return {"probability": LEVEL, "numbers": {name: self.interval(name) for name in self.posterior.names}}

    @property
    def given(self) -> dict[str, Any]:
        """Joint values and readings as in the JSON, a row for each reading; ``std`` and ``group`` where they are given."""
        data, joints = self.data, self.original.chain.joint_names
        several = {"measured_by": data.part, "visit": data.visit} if len(data.measurements) > 1 else {}
        axes = {
            "axis_ratios": data.axis_ratios,
            "q_read": data.q_read.T,
            "speed": data.speed.T,
            "temperature": data.temperature,
        }
        extras = {"std": data.std, "group": data.group, **axes}
        optional = {name: values for name, values in extras.items() if values.size}
        readings = data.readings.copy()
        for session in data.sessions:
            readings[session.rows, :3] += session.left.mean
        return {"joints": joints, "q": data.q.T, "readings": readings, **optional, **several}

    def __repr__(self) -> str:
        return (
            f"<CalibrationResult of {self.provenance.robot}: {len(self.data)} readings, residuals "
            f"{1e3 * self.rms('before'):.3g} mm before, {1e3 * self.rms('after'):.3g} mm after, model and data: {self.verdict}>"
        )


@design.on_one_thread
def calibrate(
    model: ErrorModel,
    data: object,
    measurement: Measurement | Sequence[Measurement] | None = None,
    *,
    prior: bool = True,
    only: Sequence[str] = (),
    approach: object = None,
    at: object = None,
    findings: Sequence[Finding] = (),
) -> CalibrationResult:
    """Fit the exact model to readings of one robot.

    Args:
        model: The model, whose sheet is the prior.
        data: Path of a CSV file, or a pair of poses (a list, or an array ``(n, P)``) and readings ``(P, m)`` in m and
            rad; of poses ``(P, 4, 4)`` too. Several: a list, one for each measurement.
        measurement: Instrument and set-up, or a list of several; those of the sheet if left out. Of several that read
            one file each finds its own columns.
        prior: Maximum a posteriori with the sheet as the prior; ``False``: maximum likelihood on the combinations that
            the readings determine, where all others keep their tolerances.
        only: Kinds of source, such as ``joint_offset``, whose numbers are estimated; those of all others stay at their
            means, and the errors before and after leave them out. All if empty.
        approach: Approach of the poses that were read, as in :class:`precision_pin.ApproachedPose`: ``"previous"``, from
            row to row, for readings in the order in which they were taken.
        at: Poses where the error that is left is computed; the model's named poses if left out, else the measured ones.
        findings: Findings to pass on, such as those of the sheet.

    Raises:
        InputError: The data are wrong, nothing varies from robot to robot or no reading sees it, or the fit does not
            settle.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> rng = np.random.default_rng(0)
        >>> q, noise = rng.uniform(-2, 2, (4, 20)), rng.normal(0, 20e-6, (20, 3))
        >>> built = model.space.sample(seed=7, first=0, count=1)
        >>> tips = [at.posture.pose[:3, 3] + at.exact(built)[:3, 0] for at in model.at_many(q)]
        >>> arm = pp.calibrate(model, (q, np.array(tips) + noise), pp.Measurement("position", std="20 um"))
        >>> print(arm.verdict, arm.rms("after") < 50e-6)
        agrees True
    """
    measurements = measurements_of(model, measurement, has_data=True)
    findings = check_items("findings", findings, Finding)
    check_flag("prior", prior)
    datums, model = model.datums, model.bare
    fitted, held_findings = _hold_other_sources(model, only)
    readings, bases, problem = measured_problem(fitted, data, measurements, approach)
    tasks = design.task_poses(fitted, at, readings.q)
    noise: dict[str, EstimatedStd] = {}
    if problem.unknown_deviations:
        readings, problem, (clean, fit, distances), noise = _with_std(problem, readings, has_prior=prior)
    else:
        clean, fit, distances = without_gross_errors(problem, readings, has_prior=prior)
    repeated = sum(labels.size - np.unique(labels).size for labels in clean.labels)
    chance = chance_of(fit.chi_square, fit.degrees_of_freedom, noise, repeated)
    residuals = problem.residuals(fit.z, fit.nuisances)
    groups = groups_of(readings, np.array(model.chain.prismatic))
    left_out = fitting.leave_out(clean, fit.throughs(clean), fit.residuals, groups)
    set_up_fit = SetUpAlone.of(clean)
    std_free = min((std.degrees_of_freedom for std in noise.values() if std.decided_by == "repeats"), default=KNOWN_STD)
    grouped_by: Literal["poses", "groups"] = "groups" if readings.group.size else "poses"
    improvement = judge(clean, left_out, set_up_fit, groups, grouped_by, std_free)
    unit, estimator = problem.unit, fit.estimator
    predicted = problem.reading_deviations(fit)
    is_gross = np.isin(np.arange(len(readings)), list(distances))[:, None]
    derivatives, weighed = (clean.by_number(fit.reduction), fit.reduction.by_nuisance), len(readings) - len(distances)
    identifiability = design.of_stack(unit.names, *derivatives, clean.instruments.nuisances, weighed)
    design.check_identifiable(identifiability)
    evidence = Evidence.of(clean, fit, readings, None if chance is None else std_free)
    causes, gains, without_weight = find_causes(evidence, groups), find_gains(evidence, readings, groups, left_out), ""
    if causes and distances:
        rows = explained(evidence, problem, readings, sorted(distances))
        without_weight = f"; it explains {len(rows)} of {len(distances)} readings without weight" * bool(rows)
    mean, covariance = unit.values(fit.z), unit.root @ estimator.covariance @ unit.root.T
    is_mixed = np.diag(identifiability.set_up_projector) > design.NEGLIGIBLE
    set_up_covariance = estimator.joint_covariance[fit.z.size :, fit.z.size :].copy()
    np.fill_diagonal(set_up_covariance, np.where(is_mixed, np.inf, np.diag(set_up_covariance)))
    gross = tuple(
        GrossError(readings.lines[row], size, float(np.sqrt(distances[row])), row, rotation)
        for row in sorted(distances)
        for size, rotation in [(float(np.linalg.norm(residuals[row, :3])), float(np.linalg.norm(residuals[row, 3:])))]
    )
    return CalibrationResult(
        provenance=Provenance.of(model, 0),
        measurement=readings.measurements[0],
        has_prior=prior,
        posterior=Posterior.of(unit, mean, covariance),
        without_bounds=unit.values(fit.without_bounds),
        identifiability=identifiability,
        set_ups=tuple(
            design.SetUp.of(part, base, fit.nuisances[columns], set_up_covariance[np.ix_(columns, columns)])
            for part, base, columns in zip(readings.measurements, bases, clean.instruments.columns, strict=True)
        ),
        chi_square=fit.chi_square,
        degrees_of_freedom=fit.degrees_of_freedom,
        residuals=residuals,
        residuals_before=problem.residuals(np.zeros_like(fit.z), set_up_fit.nuisances),
        left_out=np.where(is_gross, residuals, left_out.values),
        std_left_out=np.where(is_gross, predicted, left_out.std),
        std_predicted=predicted,
        improvement=improvement,
        causes=tuple(causes),
        gains=tuple(gains),
        noise=noise,
        repeated=repeated,
        gross_errors=gross,
        at_bounds=fit.at_bounds,
        poses=errors_left(
            *(tasks, unit, estimator, readings.measurements[0], fitted.space),
            fitted=(unit.components(fitted.space, fit.z[:, None])[:, 0], fit.nuisances),
        ),
        original=model,
        fitted=fitted,
        estimator=estimator,
        nuisances=fit.nuisances,
        model=model.calibrated(Estimates(unit.names, mean, covariance)).against(*datums),
        data=readings,
        steps=fit.steps,
        findings=(
            *findings,
            *check_data(model, readings),
            *_warnings(readings, fit, gross),
            *held_findings,
            *design.identifiability_warnings(identifiability),
            *(() if prior else design.rank_findings(identifiability)),
            *fitting.model_warnings(clean, fit, chance, has_prior=prior),
            *cause_warnings(causes, gains, without_weight),
            *std_warnings(noise),
            *drift_warnings(readings.sessions),
            *improvement_warnings(improvement),
        ),
    )


def _hold_other_sources(model: ErrorModel, only: Sequence[str]) -> tuple[ErrorModel, list[Finding]]:
    """Return the model with the numbers of all but some kinds of source at their means, and a finding that says so."""
    kinds = {label: source.kind() for source, label in zip(model.sources, model.labels, strict=True)}
    known_kinds = sorted(set(kinds.values()))
    wanted_kinds = {check_name("kind of source", kind, known_kinds) for kind in check_items("only", only, str)}
    if not wanted_kinds:
        return model, []
    held_draws = [
        draw
        for draw, owners in zip(model.space.draws, model.owners, strict=True)
        if draw.scope is Scope.UNIT and not wanted_kinds & {kinds[owner] for owner in owners}
    ]
    names, count = {draw.name for draw in held_draws}, sum(draw.law.size for draw in held_draws)
    draws = tuple(held_at_mean(draw) if draw.name in names else draw for draw in model.space.draws)
    space = Space(draws, tuple(item for item in model.space.correlations if not names & set(item.names)))
    message = (
        f"only {', '.join(sorted(wanted_kinds))}: {count} numbers of other sources are held at their means; the errors before "
        "and after leave them out"
    )
    return model.like(model.chain, space), [Finding("warning", "W_ONLY", message)] if count else []


def measured_problem(
    model: ErrorModel, data: object, measurements: tuple[Measurement, ...], approach: object = None
) -> tuple[CalibrationData, tuple[Array, ...], fitting.Problem]:
    """Return the data, for each measurement the first guess of the base ``(4, 4)``, and the problem of all readings."""
    readings = read_data(model, data, measurements)
    readings = readings if approach is None else approached(model, readings, approach)
    problem, bases = fitting.Problem.of(model, readings)
    _check_readings(problem, readings)
    return readings, bases, problem


_MAX_NOISE: Final = 0.1
"""Fraction of the spread of the poses beyond which an estimated std shows that the data belong to another arm."""
_BETTER: Final = 5.0
"""Factor by which another unit must reduce the distance to be reported."""
_UNITS: Final = {180 / np.pi: "radians, not degrees", np.pi / 180: "degrees, not radians"}
"""Actual unit of joint values that fit after multiplication by a factor."""


def _check_readings(problem: fitting.Problem, data: CalibrationData) -> None:
    """Raise if most readings are far beyond any robot within the tolerances: swapped columns or wrong units."""
    is_known = not problem.unknown_deviations
    if not is_known:  # whatever it is, it is no such share of the space that the arm is in
        factor = _MAX_NOISE * problem.spread / fitting.FARTHEST / float(np.median(problem.deviations[:, 0]))
        problem = problem.scaled(np.array(factor))
    scale, odd = problem.consensus.scale, problem.consensus.too_many
    if scale <= fitting.ODD:
        if len(odd) > design.MOST_GROSS * len(data):
            rows = ", ".join(data.label(row).removeprefix("row ") for row in odd)
            message = f"{len(odd)} of {len(data)} readings do not fit the others, which agree: rows {rows}; measure these again"
            raise InputError.of("E_DATA", message, data.file or None)
        return
    _check_units(problem.model, data)
    zeros = check_directions(problem.model.chain, data, data.measurements[int(np.bincount(data.part).argmax())])
    if scale <= fitting.FARTHEST or not is_known:
        return
    values = problem.residuals(np.zeros(problem.unit.root.shape[1]), problem.start)
    median = float(np.median(np.linalg.norm(values[:, :3], axis=1)))
    base_hint = " or the base is not known" if any(part.base == "known" for part in problem.instruments.parts) else ""
    message = (
        f"the readings are {1e3 * median:.3g} mm (median) from the nominal arm, "
        f"{scale:.3g} standard deviations of all tolerances: columns or units are wrong, the target is another{base_hint}"
    )
    if zeros is not None and zeros.rms < median / 10:
        message += (
            f"; zeros of the joints alone would explain them to {1e3 * zeros.rms:.3g} mm rms "
            f"({zeros.describe(problem.model.chain)}): give the zeros of joints wide tolerances"
        )
    raise InputError.of("E_DATA", message, data.file or None)


def _check_units(model: ErrorModel, data: CalibrationData) -> None:
    """Raise if joint values, all or those of one joint, fit far better in the other unit of angles."""
    turning = ~model.chain.prismatic
    masks = [turning, *(row.astype(bool) for row in np.eye(len(turning))[turning])]
    trials: list[tuple[float, str]] = [(np.inf, "")]
    nominal = nominal_distance(model.chain, data)
    for is_other, (factor, units) in product(masks, _UNITS.items()):
        scaled_q = data.q * np.where(is_other, factor, 1.0)[:, None]
        with suppress(InputError):
            distance = nominal_distance(model.chain, replace(data, q=scaled_q))
            trials.append((distance, f"{', '.join(compress(model.chain.joint_names, is_other))} are {units}"))
    distance, change = min(trials, key=lambda trial: trial[0])
    if distance < nominal / _BETTER:
        message = (
            f"the readings fit {nominal / distance:.3g} times better if the values of {change} (a factor of 57.3): correct their "
            "unit"
        )
        raise InputError.of("E_DATA", message, data.file or None)


def _check_noise(problem: fitting.Problem, estimate: EstimatedStd, file: str) -> None:
    """Raise if the estimated std is so large that the readings cannot belong to this arm."""
    if estimate.std > _MAX_NOISE * problem.spread:
        message = (
            f"the std of the readings is estimated as {1e3 * estimate.std:.3g} mm, where the tip itself spreads by "
            f"{1e3 * problem.spread:.3g} mm: columns or units are wrong, the target is another or the base is not known"
        )
        raise InputError.of("E_DATA", message, file or None)


CleanFit = tuple[fitting.Problem, fitting.Fit, dict[int, float]]
"""Problem and fit without gross errors, and the squared size of each of these by its row."""


def _with_std(
    problem: fitting.Problem, data: CalibrationData, *, has_prior: bool
) -> tuple[CalibrationData, fitting.Problem, CleanFit, dict[str, EstimatedStd]]:
    """Return data, problem, result of :func:`without_gross_errors`, and the estimated standard deviations."""
    kinds = problem.unknown_deviations
    clean, z, nuisances = problem.without(problem.consensus.gross), np.zeros(problem.unit.root.shape[1]), problem.start
    for _ in range(_STD_ROUNDS):
        estimates = estimate_std(clean, z, nuisances, kinds, has_prior=has_prior)
        factors = np.ones(problem.readings.shape)
        for name, (factor, _) in estimates.items():
            factors[kinds[name]] = factor
        problem = problem.scaled(factors)
        _check_noise(problem, estimates["std"][1], data.file)
        clean, fit, gross = without_gross_errors(problem, data, has_prior=has_prior, at=(z, nuisances))
        z, nuisances = fit.z, fit.nuisances
        if np.abs(np.log(factors)).max() < _STD_SETTLED:
            break
    noise = {name: estimate for name, (_, estimate) in estimates.items()}
    stds = {name: estimate.std for name, estimate in noise.items()}
    parts = tuple(part if part.std_known else replace(part, **stds) for part in data.measurements)  # type: ignore[arg-type]
    is_new = problem.unknown_deviations["std"][:, 0]
    std = np.where(is_new, length_stds(problem.instrument), data.std) if data.std.size else data.std
    data = replace(data, measurements=parts, std=std)
    return data, problem, (clean, fit, gross), noise


def without_gross_errors(
    problem: fitting.Problem, data: CalibrationData, *, has_prior: bool, at: tuple[Array, Array] | None = None
) -> CleanFit:
    """Return problem and fit without gross errors, and the squared sizes of the gross errors by row.

    To those that most readings do not agree with, others are added one at a time: the one with the largest residual in a fit
    without it, if too large for the rest. Where these are too many, only the first have no weight. The first fit starts at z and
    nuisances ``at``, if given, each other where the last ended.
    """
    gross, first_descent = dict(problem.consensus.gross), None
    while True:
        descent = fitting.Descent(problem.without(gross), has_prior=has_prior, at=at)
        first_descent = first_descent or descent
        fit = descent.fit(_SEARCH_STEPS)
        at, (distance, excess) = (fit.z, fit.nuisances), problem.outlying(fit, gross)
        excess[list(gross)] = 0.0
        worst = int(np.argmax(excess))
        if excess[worst] <= 1:
            return descent.problem, descent.fit(), gross
        if len(gross) + 1 > design.MOST_GROSS * len(data):
            return first_descent.problem, first_descent.fit(), dict(problem.consensus.gross)
        gross[worst] = float(distance[worst])


def _warnings(data: CalibrationData, fit: fitting.Fit, gross: tuple[GrossError, ...]) -> Iterator[Finding]:
    if gross:
        worst = max(gross, key=lambda error: error.deviations)
        file = data.file if len(set(data.files)) == 1 and data.file else None
        rows = [data.label(error.reading).removeprefix("row ") for error in gross]
        row_list = (", " if all(map(str.isdecimal, rows)) else "; ").join(rows)
        message = (
            f"readings that fit no other and were given no weight: rows {row_list}; the worst, {data.label(worst.reading)}, is "
            f"{worst.deviations:.3g} standard deviations off ({1e3 * worst.size:.3g} mm"
            f"{f', {1e3 * worst.turn:.3g} mrad' if worst.turn else ''})"
        )
        yield Finding("warning", "W_GROSS_ERROR", message, file)
    if fit.at_bounds:
        yield Finding("warning", "W_AT_BOUND", f"estimated at a bound of their tolerance: {', '.join(fit.at_bounds)}")
    if not fit.estimator.has_prior:
        message = (
            f"without a prior {fit.estimator.basis.shape[1]} of {fit.z.size} combinations are estimated; "
            "the others keep their means and tolerances"
        )
        yield Finding("warning", "W_NO_PRIOR", message)


Verdict = Literal["agrees", "disagrees", "better than stated", "not tested"]


_SAME_POSE: Final = (1e-3, 1e-4)
"""Difference of joint values (rad, m) up to which two poses count as one: they are omitted together."""
_SETTLED: Final = 1e-9
"""Root mean square change of whitened readings in the last step of a fit of base and target, over 1 + that of residuals."""
KNOWN_STD: Final = 1e9
"""Degrees of freedom of a standard deviation that is known."""
_MAX_HONEST_RATIO: Final = 1.5
"""Factor up to which deviations may be too small and still count as honest."""


@dataclass(frozen=True)
class LeftOutShare(Record):
    """Size of left-out readings relative to their covariance, and the fraction within its 95 % ellipsoid.

    ``ratio`` is the root mean square of their sizes in standard deviations, 1 where these are right, with the chi-square
    interval; the share has that of Clopper and Pearson; both for as many independent trials as the groups are worth. The
    ratio gives the verdict: ``honest`` where its interval holds 1, ``undecided`` where it passes 1.5 too.
    """

    KEYS: ClassVar[Keys] = ("verdict", "ratio", "ratio_interval", "within", "interval", "probability")
    probability: ClassVar[float] = LEVEL

    ratio: float
    ratio_interval: tuple[float, float]
    within: float
    interval: tuple[float, float]

    @classmethod
    def of(cls, squares: Array, sizes: NDArray[np.intp], trials: float, known: float = KNOWN_STD) -> LeftOutShare:
        """Return the result for squared sizes ``(P,)`` of readings with ``sizes`` components, worth ``trials`` groups.

        ``known`` are the degrees of freedom of the standard deviation.
        """
        within = float((squares <= stats.chi2.ppf(LEVEL, sizes)).mean())
        ratio, dof = float((squares / sizes).mean()), trials * float(sizes.mean())
        bounds = [ratio / float(stats.f.isf(side, dof, known)) for side in ((1 - LEVEL) / 2, (1 + LEVEL) / 2)]
        low, high = np.sqrt(bounds).tolist()
        return cls(float(np.sqrt(ratio)), (low, high), within, clopper_pearson(within * trials, trials, LEVEL))

    @property
    def verdict(self) -> Literal["over-confident", "honest", "over-cautious", "undecided"]:
        """Whether the deviations are too small or too large, or too few poses decide."""
        low, high = self.ratio_interval
        if low > 1:
            return "over-confident"
        if high < 1:
            return "over-cautious"
        return "honest" if high <= _MAX_HONEST_RATIO else "undecided"


@dataclass(frozen=True)
class Improvement(Record):
    """Root mean square lengths (m) of left-out readings by base and target alone, and by the calibrated arm.

    Attributes:
        before, after: Of readings left out of the fit of base and target alone, the arm at the sheet's means; and of
            the calibration.
        interval, before_interval: 95 % intervals of the gain, ``before - after``, and of the error before, at a pose drawn
            as those measured were: the gain ends below the error before. ``None`` of too few groups.
        residual_before: Of readings in the fit of base and target alone.
        groups, grouped_by, readings: Groups that are left out one after another, ``poses`` or ``groups`` of the data's
            column, and their readings.
        share: How far off they are against their deviations, and how many lie within.
    """

    KEYS: ClassVar[Keys] = (
        *("verdict", "before", "after", "gain", "interval", "before_interval", "probability", "residual_before"),
        *("groups", "grouped_by", "readings", "share"),
    )
    probability: ClassVar[float] = LEVEL

    before: float
    after: float
    interval: tuple[float, float] | None
    before_interval: tuple[float, float] | None
    residual_before: float
    groups: int
    grouped_by: Literal["poses", "groups"]
    readings: int
    share: LeftOutShare

    @property
    def gain(self) -> float:
        """Error reduction by the calibration, m."""
        return self.before - self.after

    @property
    def verdict(self) -> Literal["helps", "not shown to help", "makes unseen poses worse"]:
        """Whether the interval of the gain is above zero, or below."""
        if self.interval is not None and self.interval[1] < 0:
            return "makes unseen poses worse"
        return "helps" if self.interval is not None and self.interval[0] > 0 else "not shown to help"


class SetUpAlone(NamedTuple):
    """The fit of base and target, the arm at the sheet's means: the estimate, the residuals ``(P, m)``, and T."""

    nuisances: Array
    residuals: Array
    through: fitting.Through

    @classmethod
    def of(cls, problem: fitting.Problem) -> SetUpAlone:
        """Return the fit to the readings of a problem."""
        nuisances, z = problem.start, np.zeros(problem.unit.root.shape[1])
        for _ in range(fitting.STEPS):
            reduction = problem.reduce(z, nuisances)
            no_columns = np.zeros((len(reduction.rows), 0))
            estimator = design.Estimator.of(no_columns, reduction.by_nuisance, has_prior=False, basis=np.zeros((0, 0)))
            step = estimator.nuisances(reduction.white)
            change, size = (float(np.linalg.norm(part)) for part in (reduction.by_nuisance @ step, reduction.white))
            if change < _SETTLED * (reduction.size**0.5 + size):
                break
            nuisances = nuisances + step
        through = problem.through((z, nuisances), reduction, estimator.root_by_columns)
        return cls(nuisances, problem.residuals(z, nuisances), through)


def groups_of(data: CalibrationData, sliding: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the number of the group of each reading, ``(P,)``: the data's own, or one for readings at the same pose."""
    if data.group.size:
        return np.unique(data.group, return_inverse=True)[1].astype(np.intp)
    scaled_q = data.q.T / np.where(sliding, _SAME_POSE[1], _SAME_POSE[0])
    pairs = spatial.cKDTree(scaled_q).query_pairs(1.0, p=np.inf, output_type="ndarray")
    adjacency = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(data), len(data)))
    return sparse.csgraph.connected_components(adjacency, directed=False)[1].astype(np.intp)


def judge(
    problem: fitting.Problem,
    after: fitting.LeftOut,
    set_up_fit: SetUpAlone,
    groups: NDArray[np.intp],
    grouped_by: Literal["poses", "groups"],
    std_degrees: float,
) -> Improvement | None:
    """Return the cross-validation result of a fit; ``None`` if no group can be predicted from the others.

    ``std_degrees`` are the degrees of freedom of the standard deviation, apart from these readings.
    """
    residuals = set_up_fit.residuals
    before = fitting.leave_out(problem, [set_up_fit.through], residuals, groups)
    common = np.flatnonzero(before.is_predicted & after.is_predicted)
    if not common.size:
        return None
    _, group = np.unique(groups[common], return_inverse=True)
    sizes = np.bincount(group)
    squares = [
        np.bincount(group, (r[common, :3] ** 2).sum(axis=1)) / sizes for r in (before.values, after.values, residuals)
    ]
    weights, count = sizes / common.size, len(sizes)
    means = [float(weights @ group_squares) for group_squares in squares]
    trials = min(before.trials, count), min(after.trials, count)
    lengths = float(np.minimum(problem.sizes[common], 3).mean())
    intervals: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, None)
    if count >= MIN_GROUPS and means[0] > 0 and means[1] > 0:
        intervals = gain_interval(squares[0], squares[1], weights, trials, lengths)
    share = LeftOutShare.of(after.distance[common], problem.sizes[common], trials[1], std_degrees)
    before_rms, after_rms, rms = (float(np.sqrt(mean)) for mean in means)
    return Improvement(before_rms, after_rms, *intervals, rms, count, grouped_by, int(common.size), share)


def improvement_warnings(trial: Improvement | None) -> Iterator[Finding]:
    """Yield warnings if unseen poses gain nothing, or left-out readings exceed their standard deviations."""
    if trial is None or trial.verdict != "helps":
        gain = "" if trial is None else f": {1e3 * trial.before:.3g} mm rms before, {1e3 * trial.after:.3g} mm after"
        verdict = "not shown to help" if trial is None else trial.verdict
        verb = f"{'is ' * (verdict[0] == 'n')}{verdict}"
        message = f"at poses left out the calibration {verb}{gain}; do not rely on it there"
        yield Finding("warning", "W_NO_GAIN", message)
    if trial is not None and trial.share.verdict == "over-confident":
        low, high = trial.share.ratio_interval
        message = (
            f"over-confident: left-out readings are {trial.share.ratio:.3g} times ({low:.3g} to {high:.3g}) as far off as their "
            f"standard deviations say, {100 * trial.share.within:.3g} % within their 95 %; the errors left are larger than stated"
        )
        yield Finding("warning", "W_OVER_CONFIDENT", message)
