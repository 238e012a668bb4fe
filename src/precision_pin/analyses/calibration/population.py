"""Tolerances from several robots of one kind: variance components of their numbers."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, final

import numpy as np

from precision_pin.analyses.calibration.calibrate import measured_problem, without_gross_errors
from precision_pin.analyses.calibration.calibration_result import CalibrationResult
from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import NEGLIGIBLE, UnitNumbers, measurement_of, project_out
from precision_pin.analyses.calibration.identifiability import Group, subspaces
from precision_pin.analyses.calibration.variance_components import Evidence, variance_components
from precision_pin.analyses.provenance import Provenance
from precision_pin.base.arguments import check_choice, check_instance, check_items, check_number
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.input_files import UnreadableFileError, note_input, read_text_file
from precision_pin.base.progress import steps_to
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.render.result_io import JsonResult
from precision_pin.sheet.measurement import Measurement

_LARGEST: Final = 64 * 2**20
_FEW: Final = 10
"""Robots below which a warning says that intervals are wide."""
_UNSEEN: Final = 1e-3
"""Share of a component's own information that must be left beside the others; below it only groups are determined."""


@final
@dataclass(frozen=True)
class MeasuredTolerance:
    """The tolerance of a draw as several robots show it.

    Attributes
    ----------
    names
        The draws that share it: one, or several that the sheet correlates.
    numbers
        Names of their numbers.
    scale, low, high
        Standard deviation over that of the sheet, and its confidence interval; ``high`` may be infinite.
    std
        Measured standard deviation of the first number, SI.
    means
        Mean of each number less that of the sheet, in the sheet's standard deviations; zeros where means are not estimated.
    """

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

    def to_dict(self) -> dict[str, Any]:
        """Return the tolerance as in the JSON; an upper limit that does not exist is null."""
        return {
            "draws": list(self.names),
            "numbers": list(self.numbers),
            "scale": self.scale,
            "low": self.low,
            "high": self.high if np.isfinite(self.high) else None,
            "std": self.std,
            "means": list(self.means),
        }


@final
@dataclass(frozen=True, eq=False, repr=False)
class Population(JsonResult):
    """Tolerances that several robots show.

    Attributes
    ----------
    provenance
        Robot and versions.
    robots
        Number of robots.
    means
        ``"sheet"`` or ``"estimated"``.
    confidence
        Of each interval.
    tolerances
        What the readings show.
    unseen
        Draws that no reading of any robot shows; they keep their tolerances.
    groups
        Draws of which the readings show only a joint tolerance.
    log_likelihood_ratio
        Twice the logarithm of the likelihood of these tolerances over that of the sheet's.
    model
        The model that was given.
    findings
        Warnings.
    """

    schema: ClassVar[str] = "precision-pin/population/1"
    provenance: Provenance
    robots: int
    means: Literal["sheet", "estimated"]
    confidence: float
    tolerances: tuple[MeasuredTolerance, ...]
    unseen: tuple[str, ...]
    groups: tuple[Group, ...]
    log_likelihood_ratio: float
    model: ErrorModel
    findings: tuple[Finding, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the result in its JSON schema."""
        return {
            **self.provenance.to_dict(self.schema),
            "robots": self.robots,
            "means": self.means,
            "confidence": self.confidence,
            "tolerances": [one.to_dict() for one in self.tolerances],
            "unseen": list(self.unseen),
            "groups": [group.to_dict() for group in self.groups],
            "log_likelihood_ratio": self.log_likelihood_ratio,
            "findings": [finding.to_dict() for finding in self.findings],
        }

    def __repr__(self) -> str:
        other = sum(not one.agrees for one in self.tolerances)
        return (
            f"<Population of {self.robots} robots {self.provenance.robot}: {len(self.tolerances)} tolerances, {other} other than "
            "those of the sheet>"
        )


def population(
    model: ErrorModel,
    robots: Sequence[object],
    measurement: Measurement | None = None,
    *,
    means: Literal["sheet", "estimated"] = "sheet",
    confidence: float = 0.95,
    findings: Sequence[Finding] = (),
    progress: Callable[[int], None] | bool | None = None,
) -> Population:
    """Return the tolerances that several robots show, by maximum likelihood.

    A calibration draws a robot's numbers towards the sheet, the more the less its readings say. So estimates of calibrated
    robots are no sample of their law, and are not used as one: what enters is the likelihood of the readings alone, of a
    calibration its posterior less its prior.

    Parameters
    ----------
    model
        The model, whose sheet has the laws whose widths are sought.
    robots
        Of each robot its readings (path of a CSV file, or a pair of poses and readings, as for :func:`calibrate`) or its
        calibration with the prior of this model (the result, or the path of its JSON).
    measurement
        Instrument and set-up of the readings; those of the sheet if left out.
    means
        ``"sheet"``: the means are those of the sheet. ``"estimated"``: they are estimated too, and tolerances by the restricted
        likelihood.
    confidence
        Of each interval, between 0 and 1.
    findings
        Findings to pass on, such as those of the sheet.
    progress
        Function called with the number of steps done since its last call, of robots and draws; ``True`` shows a bar.

    Raises
    ------
    InputError
        Fewer than two robots, wrong data, or a calibration of another model or without prior.
    """
    check_instance("model", model, ErrorModel, "as ErrorModel.load returns it")
    findings = check_items("findings", findings, Finding)
    check_choice("means", means, ("sheet", "estimated"))
    confidence = check_number("the confidence", confidence, "between 0 and 1", lambda n: 0 < n < 1)
    if isinstance(robots, str | bytes | Mapping) or not isinstance(robots, Sequence) or len(robots) < 2:
        raise InputError("robots: at least two robots are needed, each with its readings or its calibration")
    unit = UnitNumbers.of(model.space)
    components = _components(model.space, unit)
    with steps_to(progress, len(robots) + len(components), "steps") as step:
        found = []
        for one in robots:
            found.append(_evidence(model, unit, one, measurement))
            step(1)
        evidence = Evidence(np.array([each[0] for each in found]), np.array([each[1] for each in found]))
        total = np.diag(evidence.information.sum(axis=0))
        shown = {names: rows for names, rows in components.items() if total[rows].max() > NEGLIGIBLE * total.max()}
        if not shown or total.max() <= 0:
            raise InputError("no reading of any robot shows a number that varies from robot to robot")
        blocks = np.array([_block(model.space, unit, rows) for rows in shown.values()])
        step(len(components) - len(shown))
        estimated = variance_components(
            evidence, blocks, has_means=means == "estimated", confidence=confidence, advance=step
        )
    tolerances = tuple(
        MeasuredTolerance(
            names,
            tuple(unit.names[row] for row in rows),
            float(estimated.scale[k]),
            float(estimated.low[k]),
            float(estimated.high[k]),
            float(estimated.scale[k] * unit.std[rows[0]]),
            tuple(estimated.means[rows].tolist()),
        )
        for k, (names, rows) in enumerate(shown.items())
    )
    groups = _groups([" and ".join(names) for names in shown], evidence, blocks)
    unseen = tuple(name for names in components if names not in shown for name in names)
    return Population(
        Provenance.of(model, 0),
        len(robots),
        means,
        confidence,
        tolerances,
        unseen,
        groups,
        2 * (estimated.log_likelihood - estimated.at_sheet),
        model,
        (*findings, *_remarks(len(robots), tolerances, unseen, groups)),
    )


def _components(space: Space, unit: UnitNumbers) -> dict[tuple[str, ...], list[int]]:
    """Return the numbers of each draw, or of draws that are correlated, by the names of these draws."""
    owner = {draw.name: draw.name for draw in space.draws}
    for correlation in space.correlations:
        linked = {owner[name] for name in correlation.names}
        owner = {name: min(linked) if group in linked else group for name, group in owner.items()}
    rows: dict[str, list[int]] = {}
    names: dict[str, list[str]] = {}
    place = {name: row for row, name in enumerate(unit.names)}
    for draw in space.draws:
        own = [place[name] for name in draw.components if name in place]
        if draw.scope is Scope.UNIT and own:
            rows.setdefault(owner[draw.name], []).extend(own)
            names.setdefault(owner[draw.name], []).append(draw.name)
    return {tuple(names[key]): rows[key] for key in rows}


def _correlation(space: Space, unit: UnitNumbers) -> Array:
    matrix: Array = space.block_covariance.within(unit.columns) / np.outer(unit.std, unit.std)
    return matrix


def _block(space: Space, unit: UnitNumbers, rows: list[int]) -> Array:
    """Return C of some numbers, ``(U, U)``."""
    block = np.zeros((unit.std.size,) * 2)
    block[np.ix_(rows, rows)] = _correlation(space, unit)[np.ix_(rows, rows)]
    return block


def _evidence(
    model: ErrorModel, unit: UnitNumbers, robot: object, measurement: Measurement | None
) -> tuple[Array, Array]:
    """Return A ``(U, U)`` and b ``(U,)`` of one robot."""
    found, file = None, "a calibration"
    if isinstance(robot, CalibrationResult):
        found = robot.to_dict()
    elif isinstance(robot, str | os.PathLike) and Path(robot).suffix.lower() == ".json":
        file = os.fspath(robot)
        found = _read(file)
    if found is not None:
        if "data" not in found or (found.get("prior") and not found.get("at_bounds")):
            return _of_calibration(model, unit, found, file)
        robot = _readings(found, file, measurement_of(model, measurement))

    given, _, whole = measured_problem(model, robot, measurement_of(model, measurement))
    used, best, _ = without_gross_errors(whole, given, has_prior=True)
    by_number, by_nuisance = used.plain_slopes(best.z, best.nuisances)
    numbers = (unit.values(best.z) - unit.mean) / unit.std
    target = used.whiten(used.residuals(best.z, best.nuisances)) + by_number @ numbers
    projected, _ = project_out(by_number, by_nuisance)
    return projected.T @ projected, projected.T @ target


def _read(file: str) -> dict[str, Any]:
    try:
        data = json.loads(read_text_file(file, _LARGEST))
    except UnreadableFileError as error:
        raise InputError(f"the calibration {file} {error.reason}") from None
    except (ValueError, RecursionError):
        data = None
    note_input(file)
    if not isinstance(data, dict) or data.get("schema") != CalibrationResult.schema:
        raise InputError(f"{file} is no result of calibrate ({CalibrationResult.schema}); calibrate --json writes it")
    return data


def _readings(data: dict[str, Any], file: str, measurement: Measurement) -> CalibrationData:
    """Return the readings that a calibration keeps, of one whose estimates do not say what they show.

    Raises
    ------
    InputError
        They were measured in another way, or are not complete.
    """
    if data.get("measurement") != measurement.to_dict():
        raise InputError(
            f"{file}: estimated at a bound or without prior, so that its readings are fitted again, and they were measured in "
            "another way; give the options of that calibration"
        )
    try:
        given = data["data"]
        q, readings = (np.array(given[name], dtype=float) for name in ("q", "readings"))
        std, group = (np.array(given.get(name, ()), dtype=float) for name in ("std", "group"))
        lines = tuple(map(int, data["lines"]))
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{file}: the readings are not complete; let calibrate write it again") from None
    return CalibrationData(np.ascontiguousarray(q.T), readings, std, group, file, lines)


def _of_calibration(model: ErrorModel, unit: UnitNumbers, data: dict[str, Any], file: str) -> tuple[Array, Array]:
    """Return what a calibration says without its prior: the difference of the inverse covariances, and its score."""
    if data.get("prior") is False:
        raise InputError(f"{file}: a calibration without prior does not say what its readings show; give its readings")
    try:
        posterior = data["posterior"]
        names = tuple(posterior["names"])
        mean = np.array([posterior["mean"][name] for name in names], dtype=float)
        before = np.array([posterior["prior_mean"][name] for name in names], dtype=float)
        std = np.array([posterior["prior_std"][name] for name in names], dtype=float)
        covariance = np.array(posterior["covariance"], dtype=float).reshape(len(names), len(names))
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{file}: the estimates are not complete; let calibrate write it again") from None
    same = names == unit.names and np.allclose(before, unit.mean, rtol=1e-9, atol=1e-15)
    if not same or not np.allclose(std, unit.std, rtol=1e-9):
        raise InputError(f"{file}: its prior is not that of this sheet; calibrate with this sheet, or give readings")
    if data.get("at_bounds"):
        raise InputError(
            f"{file}: numbers at a bound of their law do not say what its readings show; give its readings"
        )
    scaled = covariance / np.outer(std, std)
    prior = _correlation(model.space, unit)
    if np.linalg.eigvalsh(prior)[0] < NEGLIGIBLE:
        raise InputError(f"{file}: the sheet fixes some numbers by others; give its readings")
    inverse = np.linalg.inv(scaled)
    return inverse - np.linalg.inv(prior), inverse @ ((mean - before) / std)


def _groups(names: Sequence[str], evidence: Evidence, blocks: Array) -> tuple[Group, ...]:
    """Return the groups of components of which only a joint tolerance shows: by the information on variances at the sheet."""
    spread = np.eye(blocks.shape[1]) + evidence.information @ blocks.sum(axis=0)
    width = np.linalg.solve(spread, evidence.information)
    sides = np.einsum("rij,kjl->rkil", width, blocks)
    fisher = np.einsum("rkil,rmli->km", sides, sides)
    size = np.sqrt(np.diag(fisher))
    values, vectors = np.linalg.eigh(fisher / np.outer(size, size))
    null = vectors[:, values < _UNSEEN * float(values[-1])]
    return subspaces(names, null @ null.T)


def _remarks(
    robots: int, tolerances: Sequence[MeasuredTolerance], unseen: Sequence[str], groups: Sequence[Group]
) -> Iterator[Finding]:
    if robots < _FEW:
        yield Finding(
            "warning", "W_FEW_ROBOTS", f"{robots} robots only: the intervals are wide, and hold at large numbers"
        )
    other = [one for one in tolerances if not one.agrees]
    if other:
        listed = ", ".join(f"{' and '.join(one.names)} × {one.scale:.3g}" for one in other[:3])
        more = f" and {len(other) - 3} more" if len(other) > 3 else ""
        yield Finding(
            "warning", "W_OTHER_TOLERANCE", f"the sheet's tolerance is outside the interval of {listed}{more}"
        )
    if unseen:
        listed = ", ".join(unseen[:3]) + (f" and {len(unseen) - 3} more" if len(unseen) > 3 else "")
        yield Finding("warning", "W_UNOBSERVABLE", f"no reading of any robot shows {listed}")
    for group in groups[:1]:
        message = (
            f"the readings show hardly more than a joint tolerance of {', '.join(group.names)}; "
            "their own intervals are wide, or begin at zero"
        )
        yield Finding("warning", "W_JOINT_TOLERANCE", message)
