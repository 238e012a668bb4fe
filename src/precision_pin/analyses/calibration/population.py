"""Tolerances from several robots of one kind (variance components of their numbers), and the factory calibration of one UR."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike
from scipy import stats

from precision_pin.analyses.calibration import design
from precision_pin.analyses.calibration.calibrate import CalibrationResult, measured_problem, without_gross_errors
from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.readings import measurements_of
from precision_pin.analyses.result import Outcome
from precision_pin.base import se3, units
from precision_pin.base.arguments import check_choice, check_instance, check_items, check_number, check_path
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError, UnitError, some, visible
from precision_pin.base.files import write_files
from precision_pin.base.progress import stepped, steps_to
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel, displaced_arm
from precision_pin.robot.chain import Chain
from precision_pin.robot.ur_kinematics import MODELS, UrKinematics, nominal_ur, read_ur_calibration
from precision_pin.sheet.drawing_tolerances import TOLERANCE_PATTERN
from precision_pin.sheet.measurement import Measurement
from precision_pin.sheet.reader import check_calibrated_robot, read_calibration
from precision_pin.terms.term import JointValue, Target
from precision_pin.writers.as_built import AsBuilt

_FEW: Final = 10
"""Robots below which a warning says that intervals are wide."""
_UNSEEN: Final = 1e-3
"""Fraction of a component's information that the others do not share, below which only groups are determined."""


@dataclass(frozen=True)
class MeasuredTolerance(Record):
    """The tolerance of a draw as shown by several robots.

    Attributes:
        names, numbers: The draws that share it, one or several that the sheet correlates, and their numbers.
        scale, low, high: Standard deviation over the sheet's, and its confidence interval; ``high`` may be infinite.
        std: Measured standard deviation of the first number, SI.
        means: Mean of each number less the sheet's, in the sheet's standard deviations; zeros if not estimated.
    """

    KEYS: ClassVar[Keys] = ("draws=names", "numbers", "scale", "low", "high", "std", "means")

    names: tuple[str, ...]
    numbers: tuple[str, ...]
    scale: float
    low: float
    high: float
    std: float
    means: tuple[float, ...]

    @property
    def agrees(self) -> bool:
        """Whether the sheet's tolerance lies within the interval."""
        return self.low <= 1.0 <= self.high


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Population(Outcome):
    """Tolerances shown by several robots.

    Attributes:
        robots, means, confidence: Number of robots, ``"sheet"`` or ``"estimated"`` means, and the confidence of
            intervals.
        tolerances, unseen, groups: What the readings show; draws that no reading shows, which keep their tolerances;
            and draws of which the readings show only a joint tolerance.
        log_likelihood_ratio: Twice the logarithm of the likelihood of these tolerances over that of the sheet's.
        model: The model that was given.
    """

    schema: ClassVar[str] = "precision-pin/population/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "robots", "means", "confidence", "tolerances", "unseen", "groups"),
        *("log_likelihood_ratio", "findings"),
    )

    robots: int
    means: Literal["sheet", "estimated"]
    confidence: float
    tolerances: tuple[MeasuredTolerance, ...]
    unseen: tuple[str, ...]
    groups: tuple[design.Group, ...]
    log_likelihood_ratio: float
    model: ErrorModel

    def __repr__(self) -> str:
        others = sum(not tolerance.agrees for tolerance in self.tolerances)
        return (
            f"<Population of {self.robots} robots {self.provenance.robot}: {len(self.tolerances)} tolerances, {others} other "
            "than those of the sheet>"
        )


@design.on_one_thread
def population(
    model: ErrorModel,
    robots: Sequence[object],
    measurement: Measurement | Sequence[Measurement] | None = None,
    *,
    means: Literal["sheet", "estimated"] = "sheet",
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    progress: Callable[[int], None] | bool | None = None,
) -> Population:
    """Return the tolerances that several robots show, by maximum likelihood.

    A calibration draws a robot's numbers towards the sheet, the more the less its readings say. So estimates of
    calibrated robots are not a sample of their law. Instead the likelihood of the readings alone enters; for a
    calibration, its posterior less its prior.

    Args:
        model: The model, whose sheet has the laws whose widths are estimated.
        robots: For each robot its readings (path of a CSV file, or a pair of poses and readings, as for
            :func:`calibrate`) or its calibration with the prior of this model (the result, or the path of its JSON).
        measurement: Instrument and set-up of the readings, or several as for :func:`calibrate`; by default the sheet's.
        means: ``"sheet"``: the means are those of the sheet. ``"estimated"``: they are estimated too, and tolerances by
            the restricted likelihood.
        confidence: Of each interval, between 0 and 1.
        findings: Findings to pass on, such as those of the sheet.
        progress: Function called with the number of steps done since its last call, of robots and draws; ``True`` shows
            a bar.

    Raises:
        InputError: Fewer than two robots, wrong data, a calibration of another model or without prior, or the sheet of
            a calibrated robot.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> zeros = [pp.sources.JointOffset(joint=f"joint{k}", offset=pp.Normal(1e-3)) for k in (1, 2)]
        >>> model = pp.ErrorModel(chain, pp.Space(), zeros)
        >>> q, arms = np.array([[0, 1, 2], [0, 1, 0], [1, 0, 1], [0, 0, 0]]), model.space.sample(seed=0, first=0, count=20)
        >>> tips = np.array([at.posture.pose[:3, 3, None] + at.exact(arms)[:3] for at in model.at_many(q)])
        >>> result = pp.population(model, [(q, tips[..., k]) for k in range(20)], pp.Measurement(std="20 um"))
        >>> print(result.robots, len(result.tolerances))
        20 2
    """
    check_instance("model", model, ErrorModel, "as ErrorModel.load returns it")
    model = model.bare
    if model.sheet is not None and model.sheet.estimates is not None:
        raise InputError(
            "the sheet is that of one calibrated robot, whose numbers say nothing about others; for tolerances of several robots "
            "use the sheet without calibrated:, or --set calibrated=none"
        )
    findings = check_items("findings", findings, Finding)
    check_choice("means", means, ("sheet", "estimated"))
    confidence = check_number("the confidence", confidence, "between 0 and 1", lambda n: 0 < n < 1)
    if isinstance(robots, str | bytes | Mapping) or not isinstance(robots, Sequence) or len(robots) < 2:
        raise InputError("robots: at least two robots are needed, each with its readings or its calibration")
    unit = design.UnitNumbers.of(model.space)
    components = _components(model.space, unit)
    with steps_to(progress, len(robots) + len(components), "steps") as step:
        scores = [_evidence(model, unit, robot, measurement) for robot in stepped(robots, step)]
        evidence = Evidence(*(np.array(parts) for parts in zip(*scores, strict=True)))
        total = np.diag(evidence.information.sum(axis=0))
        visible_components = {
            names: rows for names, rows in components.items() if total[rows].max() > design.NEGLIGIBLE * total.max()
        }
        if not visible_components or total.max() <= 0:
            raise InputError("no reading of any robot shows a number that varies from robot to robot")
        correlation = _correlation(model.space, unit)
        members = [np.isin(np.arange(len(total)), rows) for rows in visible_components.values()]
        # C of the numbers of each component
        blocks = np.array([np.where(np.outer(member, member), correlation, 0.0) for member in members])
        step(len(components) - len(visible_components))
        estimates = variance_components(
            evidence, blocks, has_means=means == "estimated", confidence=confidence, advance=step
        )
    intervals = zip(estimates.scale.tolist(), estimates.low.tolist(), estimates.high.tolist(), strict=True)
    tolerances = tuple(
        MeasuredTolerance(
            names,
            tuple(unit.names[row] for row in rows),
            *(scale, low, high, float(scale * unit.std[rows[0]])),
            tuple(estimates.means[rows].tolist()),
        )
        for (names, rows), (scale, low, high) in zip(visible_components.items(), intervals, strict=True)
    )
    groups = _groups([" and ".join(names) for names in visible_components], evidence, blocks)
    unseen = tuple(name for names in components if names not in visible_components for name in names)
    return Population(
        provenance=Provenance.of(model, 0),
        robots=len(robots),
        means=means,
        confidence=confidence,
        tolerances=tolerances,
        unseen=unseen,
        groups=groups,
        log_likelihood_ratio=2 * (estimates.log_likelihood - estimates.at_sheet),
        model=model,
        findings=(*findings, *_warnings(len(robots), tolerances, unseen, groups)),
    )


def _components(space: Space, unit: design.UnitNumbers) -> dict[tuple[str, ...], list[int]]:
    """Return the numbers of each draw, or of correlated draws, by the names of these draws."""
    owner = {draw.name: draw.name for draw in space.draws}
    for correlation in space.correlations:
        linked = {owner[name] for name in correlation.names}
        owner = {name: min(linked) if group in linked else group for name, group in owner.items()}
    grouped: dict[str, tuple[list[str], list[int]]] = {}
    for draw in space.draws:
        draw_rows = [row for row, name in enumerate(unit.names) if name in draw.components]
        if draw_rows:
            names, rows = grouped.setdefault(owner[draw.name], ([], []))
            names.append(draw.name)
            rows.extend(draw_rows)
    return {tuple(names): rows for names, rows in grouped.values()}


def _correlation(space: Space, unit: design.UnitNumbers) -> Array:
    return np.asarray(space.block_covariance.within(unit.columns) / np.outer(unit.std, unit.std))


def _evidence(
    model: ErrorModel, unit: design.UnitNumbers, robot: object, measurement: Measurement | Sequence[Measurement] | None
) -> tuple[Array, Array]:
    """Return A ``(U, U)`` and b ``(U,)`` of one robot."""
    contents, file = None, "a calibration"
    if isinstance(robot, CalibrationResult):
        contents = robot.to_dict()
        check_calibrated_robot(contents, file, model.chain.robot)
    elif isinstance(robot, str | os.PathLike) and Path(robot).suffix.lower() == ".json":
        file = os.fspath(robot)
        contents = read_calibration(Path(file), f"the calibration {file}", model.chain.robot)
    if contents is not None:
        if "data" not in contents or (contents.get("prior") and not contents.get("at_bounds")):
            return _calibration_evidence(model, unit, contents, file)
        robot = _readings(contents, file, measurements_of(model, measurement))
    readings, _, problem = measured_problem(model, robot, measurements_of(model, measurement))
    clean, fit, _ = without_gross_errors(problem, readings, has_prior=True)
    by_number, numbers = clean.by_number(fit.reduction), (unit.values(fit.z) - unit.mean) / unit.std
    target = fit.reduction.white + by_number @ numbers
    projected = design.beside(by_number, design.basis_of(fit.reduction.by_nuisance))
    return projected.T @ projected, projected.T @ target


def _readings(data: dict[str, Any], file: str, measurements: tuple[Measurement, ...]) -> CalibrationData:
    """Return the readings stored in a calibration whose estimates do not determine their information."""
    known = {json.dumps(_set_up(setup.to_dict()), sort_keys=True): setup for setup in measurements}
    try:
        stored = data.get("measurements", [data["measurement"]])
        parts = [(known.get(json.dumps(_set_up(item), sort_keys=True)), item.get("target_name", "")) for item in stored]
        entries = data["data"]
        q, readings = (np.array(entries[name], dtype=float) for name in ("q", "readings"))
        std, group = (np.array(entries.get(name, ()), dtype=float) for name in ("std", "group"))
        ratios = np.array(entries.get("axis_ratios", ()), dtype=float).reshape(-1, 3)
        part, visit = (np.array(entries.get(name, ()), dtype=np.intp) for name in ("measured_by", "visit"))
        lines, has_drift = tuple(map(int, data["lines"])), bool(data.get("drift"))
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(f"{file}: incomplete readings; write it again with calibrate") from None
    devices = tuple(replace(entry, target_name=name) for entry, name in parts if entry is not None)
    if has_drift:
        raise InputError(f"{file}: its instrument drifted, so that its readings are fitted again; give their file")
    if len(devices) < len(parts):
        raise InputError(
            f"{file}: estimated at a bound or without prior, so that its readings are fitted again, and they were measured in "
            "another way; give the options of that calibration"
        )
    return CalibrationData(
        *(np.ascontiguousarray(q.T), readings, std, group, file, lines, devices, (file,) * len(devices), part, visit),
        axis_ratios=ratios,
    )


def _set_up(measurement: dict[str, Any]) -> dict[str, Any]:
    """Return a measurement in the JSON without the name of its target, given by a file of several targets."""
    later = dict.fromkeys(("sight", "stands_at", "drift"))
    return {"base_name": "", **later, **measurement, "target_name": "", "nuisances": []}


def _calibration_evidence(
    model: ErrorModel, unit: design.UnitNumbers, data: dict[str, Any], file: str
) -> tuple[Array, Array]:
    """Return a calibration's information without its prior (difference of inverse covariances), and score."""
    if data.get("prior") is False:
        raise InputError(f"{file}: a calibration without prior does not say what its readings show; give its readings")
    try:
        posterior = data["posterior"]
        names = tuple(posterior["names"])
        mean = np.array([posterior["mean"][name] for name in names], dtype=float)
        prior_mean = np.array([posterior["prior_mean"][name] for name in names], dtype=float)
        std = np.array([posterior["prior_std"][name] for name in names], dtype=float)
        covariance = np.array(posterior["covariance"], dtype=float).reshape(len(names), len(names))
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{file}: incomplete estimates; write it again with calibrate") from None
    is_same = names == unit.names and np.allclose(prior_mean, unit.mean, rtol=1e-9, atol=1e-15)
    if not is_same or not np.allclose(std, unit.std, rtol=1e-9):
        raise InputError(f"{file}: its prior is not that of this sheet; calibrate with this sheet, or give readings")
    if data.get("at_bounds"):
        raise InputError(
            f"{file}: numbers at a bound of their law do not say what its readings show; give its readings"
        )
    scaled_covariance = covariance / np.outer(std, std)
    prior = _correlation(model.space, unit)
    if np.linalg.eigvalsh(prior)[0] < design.NEGLIGIBLE:
        raise InputError(f"{file}: the sheet fixes some numbers by others; give its readings")
    inverse = np.linalg.inv(scaled_covariance)
    return inverse - np.linalg.inv(prior), inverse @ ((mean - prior_mean) / std)


def _groups(names: Sequence[str], evidence: Evidence, blocks: Array) -> tuple[design.Group, ...]:
    """Return the groups of components with only a joint tolerance, by the information on variances at the sheet."""
    spread = np.eye(blocks.shape[1]) + evidence.information @ blocks.sum(axis=0)
    width = np.linalg.solve(spread, evidence.information)
    sides = np.einsum("rij,kjl->rkil", width, blocks)
    fisher = np.einsum("rkil,rmli->km", sides, sides)
    size = np.sqrt(np.diag(fisher))
    values, vectors = np.linalg.eigh(fisher / np.outer(size, size))
    null = vectors[:, values < _UNSEEN * float(values[-1])]
    return design.subspaces(names, null @ null.T)


def _warnings(
    robots: int, tolerances: Sequence[MeasuredTolerance], unseen: Sequence[str], groups: Sequence[design.Group]
) -> Iterator[Finding]:
    if robots < _FEW:
        message = f"{robots} robots only: the intervals are wide, and hold at large numbers"
        yield Finding("warning", "W_FEW_ROBOTS", message)
    outside = [tolerance for tolerance in tolerances if not tolerance.agrees]
    if outside:
        text = some([f"{' and '.join(tolerance.names)} × {tolerance.scale:.3g}" for tolerance in outside], 3)
        yield Finding("warning", "W_OTHER_TOLERANCE", f"the sheet's tolerance is outside the interval of {text}")
    if unseen:
        yield Finding("warning", "W_UNOBSERVABLE", f"no reading of any robot shows {some(unseen, 3)}")
    if groups:
        message = (
            f"the readings show hardly more than a joint tolerance of {', '.join(groups[0].names)}; "
            "their own intervals are wide, or begin at zero"
        )
        yield Finding("warning", "W_JOINT_TOLERANCE", message)


_WIDEST: Final = 1e4
"""Largest upper end of a scale's interval; beyond it there is no upper limit."""
_ZERO: Final = 1e-6
"""Scale below which the estimate counts as zero."""
_STEPS: Final = 500
"""Maximum number of steps of a search for the largest likelihood."""
_SLACK: Final = 1e-12
"""Fraction of ln L that a search for an interval's end may miss; the end is found to 1e-4 of itself."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Information of R robots' readings on their U numbers, in prior deviations: A ``(R, U, U)`` and b ``(R, U)``."""

    information: Array
    score: Array

    @cached_property
    def seen(self) -> Array:
        """Basis of the combinations that any robot shows, ``(U, k)``."""
        values, vectors = np.linalg.eigh(self.information.sum(axis=0))
        return np.asarray(vectors[:, values > design.NEGLIGIBLE * max(float(values[-1]), 0.0)])


class VarianceComponents(NamedTuple):
    """Scales of K components, standard deviation over the sheet's.

    ``scale``, ``low`` and ``high`` ``(K,)`` are estimate and interval, whose upper end may be infinite; ``means``
    ``(U,)`` estimated means less the sheet's, in prior deviations; the log likelihoods share one constant.
    """

    scale: Array
    low: Array
    high: Array
    means: Array
    log_likelihood: float
    at_sheet: float


@dataclass(frozen=True, eq=False)
class _Likelihood:
    evidence: Evidence
    blocks: Array
    has_means: bool

    def of(self, scales: Array) -> tuple[float, Array]:
        """Return ln L and its derivatives by the scales ``(K,)``."""
        spread, width, means, score, residual_score = self._parts(scales)
        covariance = self._covariance(scales)
        value = float((residual_score @ covariance * score).sum() - np.linalg.slogdet(spread)[1].sum())
        squares = self._within(residual_score.T @ residual_score)
        traces = self._within(width.sum(axis=0))
        if self.has_means:
            basis, plain = self.evidence.seen, self.evidence
            value += float(2 * means @ plain.score.sum(axis=0) - means @ plain.information.sum(axis=0) @ means)
            total = basis.T @ width.sum(axis=0) @ basis
            value -= float(np.linalg.slogdet(total)[1])
            inverse = basis @ np.linalg.inv(total) @ basis.T
            traces -= self._within((width @ inverse @ width).sum(axis=0))
        return value / 2, scales * (squares - traces)

    def _within(self, matrix: Array) -> Array:
        """Return tr(C_k M) of each block, ``(K,)``."""
        return np.asarray(self.blocks.reshape(len(self.blocks), -1) @ matrix.T.ravel())

    def _covariance(self, scales: Array) -> Array:
        # a matrix product, because einsum over the blocks dominated the run time for 48 draws
        return np.asarray((scales**2 @ self.blocks.reshape(len(self.blocks), -1)).reshape(self.blocks.shape[1:]))

    def _parts(self, scales: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return I + A D, W, the means, b̃ and v."""
        information, score = self.evidence.information, self.evidence.score
        spread = np.eye(self.blocks.shape[1]) + information @ self._covariance(scales)
        solution = np.asarray(np.linalg.solve(spread, np.concatenate([information, score[:, :, None]], 2)), dtype=float)
        width, residual_score = solution[:, :, :-1], solution[:, :, -1]
        means = np.zeros(self.blocks.shape[1])
        if self.has_means:
            basis = self.evidence.seen
            total = basis.T @ width.sum(axis=0) @ basis
            means = np.asarray(basis @ np.linalg.solve(total, basis.T @ residual_score.sum(axis=0)), dtype=float)
            score, residual_score = score - information @ means, residual_score - width @ means
        return spread, width, means, score, residual_score

    def best(self, start: Array, fixed_index: int | None = None, tolerance: float = 1e-13) -> tuple[Array, float]:
        """Return the scales of the largest likelihood and ln L there, perhaps with one scale fixed at its start."""
        # the search ends at a step that gains less than `tolerance` of ln L
        free_indices = np.array([k for k in range(start.size) if k != fixed_index], dtype=np.intp)
        if not free_indices.size:
            return start, self.of(start)[0]

        def loss(values: Array) -> tuple[float, Array]:
            scales = start.copy()
            scales[free_indices] = values
            value, slopes = self.of(scales)
            return -value, -slopes[free_indices]

        # start away from zero, where the derivative with respect to a scale vanishes
        begin, bounds = np.maximum(start[free_indices], 1e-2), [(0.0, _WIDEST)] * free_indices.size
        options = {"maxiter": _STEPS, "ftol": tolerance, "gtol": 1e-7, "maxcor": 40}
        optimum = scipy.optimize.minimize(loss, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        scales = start.copy()
        scales[free_indices] = optimum.x
        return scales, -float(optimum.fun)


def variance_components(
    evidence: Evidence,
    blocks: Array,
    *,
    has_means: bool = False,
    confidence: float = 0.95,
    advance: Callable[[int], None] = lambda _: None,
) -> VarianceComponents:
    """Return the scales of components with the correlations ``blocks`` ``(K, U, U)``, and their intervals.

    In units of the sheet's standard deviations the numbers of a robot are u with mean m and covariance ``D(s) = Σ s_k
    C_k``, C_k the sheet's correlations of component k and s_k the square of its scale. Readings with unit noise, with
    the set-up projected out, are ``y = H u + e``. They enter by ``A = HᵀH`` and ``b = Hᵀy`` alone:

        2 ln L = Σ_r [ vᵀ D b̃ + 2 mᵀb - mᵀA m - ln det(I + A D) ],  v = (I + A D)⁻¹ b̃,  b̃ = b - A m.

    That is the likelihood of the readings, without any prior on u. Means that are estimated too (``has_means``) cost
    degrees of freedom; the restricted likelihood (Patterson and Thompson 1971) adds ``-ln det Σ_r W_r``, ``W = (I + A
    D)⁻¹ A``, over the combinations that any robot shows. Intervals are those of the profile likelihood.
    """
    likelihood, sheet = _Likelihood(evidence, blocks, has_means), np.ones(len(blocks))
    scale, largest = likelihood.best(sheet)
    limit = largest - float(stats.chi2.ppf(confidence, 1)) / 2
    intervals = []
    for k in range(len(blocks)):
        intervals.append(_interval(likelihood, scale, k, limit))
        advance(1)
    low, high = np.array(intervals).T
    return VarianceComponents(scale, low, high, likelihood._parts(scale)[2], largest, likelihood.of(sheet)[0])


def _interval(likelihood: _Likelihood, scale: Array, k: int, limit: float) -> tuple[float, float]:
    """Return the scales of component k between which the profile likelihood stays above a limit."""

    def excess(value: float) -> float:
        # start from the optimum, not from the previous end: the likelihood has several peaks
        start = scale.copy()
        start[k] = value
        return likelihood.best(start, k, _SLACK)[1] - limit

    estimate = float(scale[k])
    is_above_zero = estimate > _ZERO and excess(0.0) < 0
    low = float(scipy.optimize.brentq(excess, 0.0, estimate, rtol=1e-4)) if is_above_zero else 0.0
    inner, high = estimate, max(1.5 * estimate, 0.1)
    while excess(high) > 0:
        inner, high = high, 2 * high
        if high > _WIDEST:
            return low, np.inf
    return low, float(scipy.optimize.brentq(excess, inner, high, rtol=1e-4))


_WIDTHS: Final = ("uniform", "normal", "triangular", "arcsine", "disc", "circle", "sphere", "two_point")
"""Laws whose key is a width proportional to their standard deviation."""
_DIGITS: Final = 4
"""Significant digits of a width written into the sheet."""


def population_sheet(result: Population, folder: Path) -> str:
    """Return the sheet of the model with the measured tolerances, each with its interval in a comment at the top.

    A law keeps its kind: its width is multiplied by the measured scale. Laws without a width, or whose scale has no
    upper limit, stay, as a comment says. The robot's path is relative to ``folder``, where the sheet will be.
    """
    sheet = result.model.sheet
    if sheet is None or sheet.contents is None:
        raise InputError("the model was not read from a sheet or a dictionary")
    changes: dict[str, Any] = {}
    notes = [
        f"measured: {result.robots} robots; tolerances by maximum likelihood, means "
        f"{'estimated too' if result.means == 'estimated' else 'those of the sheet'}",
        f"tolerance: measured over former width, {100 * result.confidence:g} % interval",
    ]
    parameters = {draw.name for draw in sheet.space.draws}
    for entry in result.tolerances:
        for name in entry.names:
            path = f"parameters.{name}" if name in parameters else name
            values = sheet.contents.values_at(sheet, path)
            if isinstance(values.get(path), list):
                # a draw without a number in its name is the first of a list
                path = f"{path}[0]"
                values = sheet.contents.values_at(sheet, path)
            has_limit = entry.scale > 0 and entry.high < float("inf")
            new_law = _scale_law(*values.values(), factor=entry.scale) if has_limit and len(values) == 1 else None
            changes |= {} if new_law is None else {path: new_law}
            suffix = "; kept as it was" if new_law is None else ""
            notes.append(f"{visible(name)}: × {entry.scale:.3g}, {entry.low:.3g} to {entry.high:.3g}{suffix}")
    notes += [f"{visible(name)}: not shown by any reading; kept as it was" for name in result.unseen]
    changed = result.model.with_(changes).sheet if changes else sheet
    assert changed is not None
    assert changed.contents is not None
    provenance = {path: {"measured": f"{result.robots} robots"} for path in changes}
    stated = {"provenance": {**changed.contents.text.data.get("provenance", {}), **provenance}} if provenance else {}
    return "".join(f"# {note}\n" for note in notes) + changed.contents.written(folder, **stated)


def _scale_law(value: object, *, factor: float) -> object:
    """Return a law with its width multiplied, as in a sheet; ``None`` if it has no width."""
    if isinstance(value, str):
        parts = re.split(f"({TOLERANCE_PATTERN})", value, maxsplit=1)
        width = _times(parts[2], factor) if len(parts) == 3 else None
        return None if width is None else f"{parts[0].strip()} ± {width}".strip()
    key = next((key for key in _WIDTHS if key in value), None) if isinstance(value, Mapping) else None
    if key is None or not isinstance(value, Mapping):
        return None
    width_entry = value[key]
    is_std = isinstance(width_entry, Mapping) and set(width_entry) == {"std"}
    width = _times(width_entry["std"] if is_std else width_entry, factor)
    return None if width is None else {**value, key: {"std": width} if is_std else width}


def _times(text: object, factor: float) -> str | None:
    try:
        numbers, unit = units.split(text)
    except UnitError:
        return None
    return f"{numbers[0] * factor:.{_DIGITS}g} {unit}" if len(numbers) == 1 else None


_SAME: Final = (1e-3, 1e-3)
"""Distance (m) and angle (rad) from a model's axes within which a robot is of this model."""
_CALIBRATED: Final = (0.05, 0.05)
"""Distance (m) and angle (rad) of a calibrated axis beyond which a file belongs to another model."""
_CHECKED: Final = 200
"""Random poses at which the arms are compared."""
_CLEARLY: Final = 0.5
"""Fraction of the distance from a model within which another fits clearly better.

For 16 robots measured by their maker, the correct model had at most 4 mm rms, the others at least 21 mm.
"""
_NOTED: Final = 1e-7
"""Difference, m, between the two ways to read a YAML's angles that triggers a warning."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FactoryCalibration(Outcome):
    """A UR robot as in its factory calibration.

    Attributes:
        file, checksum: The file, and its ``hash`` or an empty text.
        kind: The model of UR, such as ``"UR5e"``.
        arm, model: The built arm: fixed displacements at each joint and at the tip; with the sources of the given model,
            but for errors of dimensions that the factory measured (those of base and tool stay).
        displacements: These displacements, ``[d; δ]`` in the axes of each seat, m and rad, ``(7, 6)``; the last is the
            tip's.
        rms_position, largest_position: Distance of the tip from the nominal robot over 200 random poses, m.
    """

    schema: ClassVar[str] = "precision-pin/factory-calibration/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "file", "hash=checksum", "model=kind", "displacements=by_place"),
        *("rms_position", "largest_position", "findings"),
    )

    file: str
    checksum: str
    kind: str
    arm: ErrorModel
    model: ErrorModel
    displacements: Array
    rms_position: float
    largest_position: float

    @property
    def by_place(self) -> dict[str, Array]:
        """Displacement of each joint and of the tip, by name."""
        chain = self.model.chain
        return dict(zip((*chain.joint_names, chain.tip), self.displacements, strict=True))

    def predict(self, q: ArrayLike | Mapping[str, float] | str | None = None) -> Array:
        """Return the tip by the file alone in the base, ``(4, 4)``; ``q`` as for :meth:`ErrorModel.at`."""
        at = self.arm.at(self.model.configuration(q))
        return se3.displaced(at.posture.pose, at.exact(np.zeros((0, 1)))[:, 0])

    def to_urdf(self, path: str | os.PathLike[str]) -> None:
        """Write the built arm as a URDF, with nothing of the model but the factory calibration.

        Raises:
            OutputError: The file cannot be written.
            InputError: The robot's file has changed.
        """
        name = check_path("the path of the URDF", path)
        writer = AsBuilt.prepare(self.arm, np.zeros(6))
        write_files({name: writer.fitted(np.zeros(0))})

    def __repr__(self) -> str:
        return (
            f"<FactoryCalibration of {self.provenance.robot}, a {self.kind}: tip {1e3 * self.rms_position:.3g} mm rms from the "
            f"nominal robot, at most {1e3 * self.largest_position:.3g} mm>"
        )


def ur_calibration(file: str | os.PathLike[str], robot: ErrorModel | Chain) -> FactoryCalibration:
    """Return a UR robot as in its factory calibration.

    Args:
        file: ``calibration.conf`` of the controller (differences to Denavit-Hartenberg parameters), or the YAML of
            ``ur_calibration`` that the ROS driver reads. Its angles are read as by URDF readers.
        robot: The nominal arm of six joints, a UR3 to UR30, with any frames, base and tip; or a model of it.

    Raises:
        InputError: The file cannot be read or is of another robot, or the robot is not a UR.
    """
    name = check_path("the factory calibration", file)
    if not isinstance(robot, ErrorModel | Chain):
        raise InputError("the robot must be an ErrorModel or a Chain, as Chain.from_urdf returns it")
    chain = robot.chain if isinstance(robot, ErrorModel) else robot
    kind, base = _model_of(chain)
    kinematics = read_ur_calibration(name, kind)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (_CHECKED, 6))
    if kinematics.is_whole:
        _check_model(name, kind, kinematics, q)
    placements = _placements(chain, kind, base, kinematics, name)
    arm = displaced_arm(replace(chain, obstacles=None), placements)
    from_flange = se3.inverse(base @ nominal_ur(kind).flange) @ _seats(chain)[5]

    def is_measured(target: Target) -> bool:
        # neither the base nor the tool
        if isinstance(target, JointValue) or 0 < target.link < 6:
            return True
        pose = from_flange if target.link else se3.inverse(base)
        height = float((pose @ target.frame)[2, 3])
        return height < _SAME[0] if target.link else height > _SAME[0]

    if isinstance(robot, ErrorModel):
        model = robot.bare.measured_as(arm, is_measured).against(*robot.datums)
    else:
        model = displaced_arm(chain, placements)
    steps = [se3.inverse(old) @ new for old, new in zip(chain.placements, placements, strict=True)]
    displacements = np.array([[*step[:3, 3], *se3.log_rotation(step[:3, :3])] for step in steps])
    distances = _distances(kinematics, q, kind)[0]
    return FactoryCalibration(
        provenance=Provenance.of(model, 0),
        file=os.path.basename(name),
        checksum=kinematics.checksum,
        kind=kind,
        arm=arm,
        model=model,
        displacements=displacements,
        rms_position=float(np.sqrt(np.mean(np.square(distances)))),
        largest_position=float(distances.max()),
        findings=_factory_warnings(name, kind, kinematics, q),
    )


def _distances(kinematics: UrKinematics, q: Array, *kinds: str) -> Array:
    """Return the distances of the flange from some models' at poses ``(P, 6)``, m, ``(kinds, P)``."""
    tip, *other_points = (arm.pose(q)[:, :3, 3] for arm in (kinematics, *map(nominal_ur, kinds)))
    return np.asarray(np.linalg.norm(np.array(other_points) - tip, axis=2))


def _check_model(file: str, kind: str, kinematics: UrKinematics, q: Array) -> None:
    sizes = np.sqrt((_distances(kinematics, q, *MODELS) ** 2).mean(axis=1))
    rms = dict(zip(MODELS, sizes.tolist(), strict=True))
    closest = min(rms, key=lambda name: rms[name])
    if rms[closest] < _CLEARLY * rms[kind]:
        message = (
            f"this is the calibration of a {closest}, not of a {kind}: its tip is {1e3 * rms[closest]:.3g} mm rms from that of a "
            f"nominal {closest} and {1e3 * rms[kind]:.3g} mm from that of a {kind}; give the URDF of a {closest}, or another file"
        )
        raise InputError.of("E_DATA", message, file)


def _factory_warnings(file: str, kind: str, kinematics: UrKinematics, q: Array) -> tuple[Finding, ...]:
    """Return warnings of a forearm turned back, or of angles that differ between the two ways to read a YAML."""
    if kinematics.was_folded:
        message = (
            "the forearm points back at zero, as ur_calibration before June 2024 writes some robots; read as the robot that the "
            "controller has; a ROS driver with this file is wrong by twice the forearm: extract it with a newer version"
        )
        return (Finding("warning", "W_FACTORY_FOLDED", message, file),)
    alternative = read_ur_calibration(file, kind, x_y_z=True)
    gap = float(np.linalg.norm(kinematics.pose(q)[:, :3, 3] - alternative.pose(q)[:, :3, 3], axis=1).max())
    if gap <= _NOTED:
        return ()
    message = (
        "roll, pitch and yaw are read as URDF readers do; the tool that extracts them means turns about x, y and z in this "
        f"order, which puts the tip up to {1e3 * gap:.2g} mm elsewhere; calibration.conf of the controller has no such doubt"
    )
    return (Finding("warning", "W_FACTORY_ANGLES", message, file),)


def _seats(chain: Chain) -> Array:
    return np.array(list(accumulate(chain.placements, np.matmul, initial=np.eye(4)))[1:])


def _model_of(chain: Chain) -> tuple[str, Array]:
    if len(chain.joints) == 6 and not chain.prismatic.any():
        seats = _seats(chain)[:6]
        directions = np.einsum("kij,kj->ki", seats[:, :3, :3], chain.axes)
        closest, distance = "", np.inf
        for kind in MODELS:
            frames = nominal_ur(kind).joints
            base, offset, tilt = _fit_lines(frames[:, :3, 3], frames[:, :3, 2], seats[:, :3, 3], directions)
            if tilt < _SAME[1] and offset < distance:
                closest, base_pose, distance = kind, base, offset
        if closest and distance < _SAME[0]:
            return closest, base_pose
    raise InputError(
        f"{os.path.basename(chain.robot.file)}, {chain.base} to {chain.tip_label}, is none of {', '.join(MODELS)}: a factory "
        "calibration is that of a nominal UR robot with six joints"
    )


def _fit_lines(points: Array, directions: Array, places: Array, axes: Array) -> tuple[Array, float, float]:
    """Return the pose that moves lines onto others, and the largest remaining distance and angle; ``(n, 3)`` each."""
    rotation = se3.nearest_rotation(axes.T @ directions)
    across = np.eye(3) - np.einsum("ki,kj->kij", axes, axes)
    right_side = np.einsum("kij,kj->i", across, places - points @ rotation.T)
    shift = np.linalg.solve(across.sum(axis=0), right_side)
    offsets = np.einsum("kij,kj->ki", across, places - points @ rotation.T - shift)
    tilts = np.linalg.norm(np.cross(directions @ rotation.T, axes), axis=1)
    is_opposite = ((directions @ rotation.T) * axes).sum(axis=1).min() < 0
    return (
        se3.pose(rotation, shift),
        float(np.linalg.norm(offsets, axis=1).max()),
        np.pi if is_opposite else float(tilts.max()),
    )


def _placements(chain: Chain, kind: str, base: Array, kinematics: UrKinematics, file: str) -> Array:
    """Return the built arm's placements: seats at their axes' points nearest to the nominal ones, turned least."""
    # only the axes and the tip at zero change poses, not where a frame lies along its axis or how it turns about it
    seats = _seats(chain)
    new = []
    for k, frame in enumerate(base @ kinematics.joints):
        axis, centre = seats[k, :3, :3] @ chain.axes[k], seats[k, :3, 3]
        point, direction = frame[:3, 3], frame[:3, 2]
        foot = point + direction * float(direction @ (centre - point))
        sine = np.cross(axis, direction)
        size = float(np.linalg.norm(sine))
        rotation = sine * (np.arctan2(size, float(axis @ direction)) / size if size > 0 else 1.0)
        gap, angle = float(np.linalg.norm(foot - centre)), float(np.linalg.norm(rotation))
        if gap > _CALIBRATED[0] or angle > _CALIBRATED[1]:
            message = (
                f"{chain.joint_names[k]} would be {1e3 * gap:.3g} mm and {angle:.3g} rad from that of a {kind}: the file is of "
                "another robot"
            )
            raise InputError.of("E_DATA", message, file)
        new.append(se3.pose(se3.exp_rotation(rotation) @ seats[k, :3, :3], foot))
    new.append(base @ kinematics.flange @ se3.inverse(base @ nominal_ur(kind).flange) @ seats[6])
    parents = [np.eye(4), *new[:-1]]
    return np.array([se3.inverse(parent) @ placement for parent, placement in zip(parents, new, strict=True)])
