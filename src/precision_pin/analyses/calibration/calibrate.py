"""The calibration of one robot from its readings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from scipy import stats

from precision_pin.analyses.calibration.calibration_result import CalibrationResult, GrossError
from precision_pin.analyses.calibration.checks import check_data, doubt_model, refuse_far_readings
from precision_pin.analyses.calibration.data import CalibrationData, read_data
from precision_pin.analyses.calibration.design import measurement_of, stations_of
from precision_pin.analyses.calibration.fit import Fit, Problem, fit, left_out_together
from precision_pin.analyses.calibration.forecast import task_poses
from precision_pin.analyses.calibration.identifiability import (
    of_stack,
    rank_findings,
    refuse_where_nothing_is_seen,
    remarks_on,
)
from precision_pin.analyses.calibration.posterior import Posterior, SampledRobots, error_left
from precision_pin.analyses.calibration.set_up import SetUp, first_guess, readings_in_base
from precision_pin.analyses.provenance import Provenance
from precision_pin.base.arguments import check_flag, check_items
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding
from precision_pin.draws.estimates import Estimates
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet.measurement import Measurement

_GROSS: Final = 1e-3
"""Probability that any right reading of a set is taken for a gross error."""
_MOST_GROSS: Final = 0.2
"""Share of readings beyond which they are no gross errors but a model that is wrong."""
_FEW_STEPS: Final = 3
"""Steps of a fit that only serves to find gross errors, which need not settle while there are any."""


def calibrate(
    model: ErrorModel,
    data: object,
    measurement: Measurement | None = None,
    *,
    prior: bool = True,
    at: object = None,
    findings: Sequence[Finding] = (),
) -> CalibrationResult:
    """Fit the exact model to readings of one robot.

    Parameters
    ----------
    model
        The model, whose sheet is the prior.
    data
        Path of a CSV file, or a pair of poses (a list, or an array ``(n, P)``) and readings ``(P, m)`` in m and rad; of
        poses ``(P, 4, 4)`` too.
    measurement
        Instrument and set-up; those of the sheet if left out.
    prior
        Maximum a posteriori with the sheet as the prior; ``False``: maximum likelihood on the combinations that the
        readings determine, where all others keep their tolerances.
    at
        Poses where the error that is left is computed; the model's named poses if left out, else the measured ones.
    findings
        Findings to pass on, such as those of the sheet.

    Raises
    ------
    InputError
        The data are wrong, nothing varies from robot to robot or no reading sees it, or the fit does not settle.
    """
    measurement = measurement_of(model, measurement)
    findings = check_items("findings", findings, Finding)
    check_flag("prior", prior)
    given, base, whole = measured_problem(model, data, measurement)
    used, best, distances = without_gross_errors(whole, given, has_prior=prior)
    residuals = whole.residuals(best.z, best.nuisances)
    without = left_out_together(used, best, given.group) if given.group.size else best.residuals.left_out
    left_out = np.where(np.isin(np.arange(len(given)), list(distances))[:, None], residuals, without)
    unit, estimator = whole.unit, best.estimator
    seen = of_stack(unit.names, *used.plain_slopes(best.z, best.nuisances), measurement, len(given) - len(distances))
    refuse_where_nothing_is_seen(seen)
    mean, covariance = unit.values(best.z), unit.root @ estimator.covariance @ unit.root.T
    gross = tuple(
        GrossError(given.lines[row], float(np.linalg.norm(residuals[row, :3])), float(np.sqrt(distances[row])))
        for row in sorted(distances)
    )
    robots = SampledRobots.of(model.space, unit, estimator)
    return CalibrationResult(
        provenance=Provenance.of(model, 0),
        measurement=measurement,
        has_prior=prior,
        posterior=Posterior.of(unit, mean, covariance),
        without_bounds=unit.values(best.without_bounds),
        identifiability=seen,
        set_up=SetUp.of(measurement, base, best.nuisances, estimator.nuisance_covariance()),
        chi_square=best.chi_square,
        degrees_of_freedom=best.degrees_of_freedom,
        residuals=residuals,
        residuals_before=whole.residuals(np.zeros_like(best.z), whole.start),
        left_out=left_out,
        gross_errors=gross,
        at_bounds=best.at_bounds,
        poses=tuple(
            error_left(one, name, unit, estimator, measurement, robots) for name, one in task_poses(model, at, given.q)
        ),
        original=model,
        model=model.calibrated(Estimates(unit.names, mean, covariance)),
        data=given,
        steps=best.steps,
        findings=(
            *findings,
            *check_data(model, given),
            *_remarks(given, best, gross),
            *remarks_on(seen),
            *(() if prior else rank_findings(seen)),
            *doubt_model(used, best, has_prior=prior),
        ),
    )


def measured_problem(
    model: ErrorModel, data: object, measurement: Measurement
) -> tuple[CalibrationData, Array, Problem]:
    """Return the data, the first guess of the base in the instrument's axes ``(4, 4)``, and the problem of all readings.

    Raises
    ------
    InputError
        The data are wrong, or far from the nominal arm.
    """
    given = read_data(model, data, measurement)
    stations = stations_of(model, given.q, measurement)
    base, start = first_guess(given, stations, measurement)
    readings = readings_in_base(given, stations, base, measurement)
    whole = Problem.of(model, measurement, stations, readings, _deviations(given, measurement), start)
    refuse_far_readings(whole, given)
    return given, base, whole


def _deviations(data: CalibrationData, measurement: Measurement) -> Array:
    """Return the standard deviation of every number of every reading, ``(P, m)``; angles in proportion to lengths."""
    deviations = np.tile(measurement.deviations, (len(data), 1))
    return deviations * data.std[:, None] / measurement.std if data.std.size else deviations


def without_gross_errors(
    whole: Problem, data: CalibrationData, *, has_prior: bool
) -> tuple[Problem, Fit, dict[int, float]]:
    """Return the problem and fit without gross errors, and the squared size of each of these by its row.

    One reading after another is left out, that with the largest residual of a fit without it, where that is too large for
    the spread of the others.
    """
    best = fit(whole, has_prior=has_prior, steps=_FEW_STEPS)
    used, size, found = whole, whole.readings.shape[1], dict[int, float]()
    limit = float(stats.chi2.isf(_GROSS / len(data), size))
    middle = float(stats.chi2.median(size))
    while True:
        kept = np.array([row for row in range(len(data)) if row not in found])
        distance = best.residuals.distance[kept]
        scale = max(1.0, float(np.median(distance)) / middle)
        worst = int(np.argmax(distance))
        if distance[worst] <= limit * scale:
            return used, fit(used, has_prior=has_prior), found
        if len(found) + 1 > _MOST_GROSS * len(data):
            return whole, fit(whole, has_prior=has_prior), {}
        found[int(kept[worst])] = float(distance[worst])
        used = whole.without(found)
        best = fit(used, has_prior=has_prior, steps=_FEW_STEPS)


def _remarks(data: CalibrationData, best: Fit, gross: tuple[GrossError, ...]) -> Iterator[Finding]:
    if gross:
        worst = max(gross, key=lambda error: error.deviations)
        listed = ", ".join(str(error.line) for error in gross)
        message = (
            f"readings that fit no other and were given no weight: rows {listed}; the worst, row {worst.line}, is "
            f"{worst.deviations:.3g} standard deviations off ({1e3 * worst.size:.3g} mm)"
        )
        yield Finding("warning", "W_GROSS_ERROR", message, data.file or None)
    if best.at_bounds:
        yield Finding("warning", "W_AT_BOUND", f"estimated at a bound of their tolerance: {', '.join(best.at_bounds)}")
    if not best.estimator.has_prior:
        message = (
            f"without a prior {best.estimator.kept.shape[1]} of {best.z.size} combinations are estimated; "
            "the others keep their means and tolerances"
        )
        yield Finding("warning", "W_NO_PRIOR", message)
