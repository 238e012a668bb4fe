"""Checks of data before a fit, and of a model after it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy import stats

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.estimates import Estimator
from precision_pin.analyses.calibration.fit import Fit, Problem
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.draw import Scope
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.chain import limit_findings

DOUBTFUL: Final = 1e-3
"""Probability of a larger chi-square below which the model does not explain the readings."""

FARTHEST: Final = 50.0
"""Root mean square of the readings' distances, in standard deviations, beyond which data are refused."""


def probability(chi_square: float, degrees: int) -> float:
    """Return the probability that a right model gives a larger chi-square; 1 without degrees of freedom."""
    return float(stats.chi2.sf(chi_square, degrees)) if degrees > 0 else 1.0


def check_data(model: ErrorModel, data: CalibrationData) -> Iterator[Finding]:
    """Yield warnings about data: poses outside limits, and rows that are given twice."""
    yield from limit_findings(model.chain, data.q)
    rows = np.hstack([data.q.T, data.readings])
    _, first, counts = np.unique(rows, axis=0, return_index=True, return_counts=True)
    twice = np.sort(first[counts > 1])
    if twice.size:
        row = int(twice[0])
        again = int(np.flatnonzero((rows == rows[row]).all(axis=1))[1])
        message = (
            f"the rows {data.lines[row]} and {data.lines[again]} are the same to the last digit, and so are "
            f"{int(counts.sum() - len(counts))} in all; a reading copied is no second reading, leave it out"
        )
        yield Finding(
            "warning", "W_REPEATED_READING", message, data.file or None, data.lines[again] if data.file else None
        )


def refuse_far_readings(problem: Problem, data: CalibrationData) -> None:
    """Refuse readings that no robot within the tolerances, by far, can have given.

    Raises
    ------
    InputError
        They lie more than :data:`FARTHEST` standard deviations, of tolerances and instrument, from the nominal arm, as most
        readings do where columns are swapped, or units or axes are others.
    """
    z = np.zeros(problem.unit.root.shape[1])
    values = problem.residuals(z, problem.start)
    estimator = Estimator.of(*problem.slopes(z, problem.start), has_prior=True)
    hold = np.eye(len(estimator.by_z)) - estimator.leverage()
    white = problem.whiten(values)
    nuisances = estimator.nuisances(white)
    left = white - estimator.by_nuisance @ nuisances
    squared = float(left @ hold @ left) / max(len(left), 1)
    if squared <= FARTHEST**2:
        return
    far = float(np.median(np.linalg.norm(values[:, :3], axis=1)))
    free = " or the base is not known" if problem.measurement.base == "known" else ""
    message = (
        f"the readings are {1e3 * far:.3g} mm (median) from the nominal arm, {np.sqrt(squared):.3g} standard deviations of all "
        f"tolerances: columns or units are wrong, the target is another{free}"
    )
    raise InputError([Finding("error", "E_DATA", message, data.file or None)])


def doubt_model(problem: Problem, fit: Fit, *, has_prior: bool) -> Iterator[Finding]:
    """Yield what to doubt where the model does not explain the readings."""
    chance = probability(fit.chi_square, fit.degrees_of_freedom)
    facts = f"chi-square {fit.chi_square:.4g} for {fit.degrees_of_freedom} degrees of freedom"
    if has_prior:
        yield from _pulled(problem, fit)
    if chance < DOUBTFUL:
        joint, ratio = _suspect_joint(problem, fit)
        message = (
            f"the model does not explain the readings: {facts} (probability {chance:.2g}); residuals look most like "
            f"an error of {joint} that changes from reading to reading ({ratio:.3g} times the expected square); "
            "doubt that joint, the instrument's std, or a source that the sheet lacks"
        )
        yield Finding("warning", "W_MODEL", message)
    elif fit.degrees_of_freedom > 0 and 1 - chance < DOUBTFUL:
        message = (
            f"residuals are smaller than std says: {facts}; the instrument or the tolerances are better than stated"
        )
        yield Finding("warning", "W_NOISE", message)
    if all(draw.scope is Scope.UNIT for draw in problem.model.space.draws):
        message = (
            "the sheet has no draw of scope visit or pose: repeatability counts as perfect, here and in the error left"
        )
        yield Finding("warning", "W_NO_REPEATABILITY", message)


def _pulled(problem: Problem, fit: Fit) -> Iterator[Finding]:
    """Yield a warning for numbers farther from their means than their tolerances make likely."""
    if not problem.unit.is_independent:
        return
    expected = np.maximum(1 - np.diag(fit.estimator.covariance), 1e-12)
    ratio = np.where(expected > 1e-6, np.abs(fit.z) / np.sqrt(expected), 0.0)
    limit = float(stats.norm.isf(DOUBTFUL / 2 / len(ratio)))
    for k in np.argsort(-ratio, kind="stable")[:3]:
        if ratio[k] > limit:
            message = (
                f"{problem.unit.names[k]} is estimated {fit.z[k]:+.3g} standard deviations from its mean; "
                "doubt its tolerance, or an error that acts like it"
            )
            yield Finding("warning", "W_TOLERANCE", message)


def _suspect_joint(problem: Problem, fit: Fit) -> tuple[str, float]:
    """Return the joint whose own error explains residuals best, and by how much its squares exceed those expected."""
    white = problem.whiten(problem.residuals(fit.z, fit.nuisances))
    hold = np.eye(len(white)) - fit.estimator.leverage()
    values, first = np.zeros(len(problem.model.chain.joints)), 0
    expected = np.zeros_like(values)
    for station, root in zip(problem.stations, problem.roots, strict=True):
        rows = slice(first, first + len(root))
        first += len(root)
        slopes = problem.measurement.slopes(station.at.posture.pose, station.at.error_at_means, fit.nuisances)
        moved = slopes.error @ _joint_jacobian(station.at)
        size = len(moved)
        for k in range(len(station.rows)):
            own = np.zeros((len(root), moved.shape[1]))
            own[k * size : (k + 1) * size] = moved
            along = np.linalg.solve(root, own)
            values += (along.T @ white[rows]) ** 2
            expected += np.einsum("ij,ik,kj->j", along, hold[rows, rows], along)
    ratio = values / np.where(expected > 0, expected, np.inf)
    best = int(np.argmax(ratio))
    return problem.model.chain.joint_names[best], float(ratio[best])


def _joint_jacobian(at: PoseModel) -> Array:
    result: Array = at.posture.chain.at_columns(at.posture.q[:, None]).joint_jacobian[:, :, 0]
    return result
