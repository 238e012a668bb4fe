"""Start of a fit: base and targets in closed form, and distance of the readings from the nominal arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.design import MOST_GROSS, Estimator, Instruments, set_up_of
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain

REWEIGHED: Final = 6
"""Rounds of a reweighted fit; outliers weigh less in each."""


def reweighed_sizes(white: Array, by_z: Array, by_nuisance: Array, rows: NDArray[np.intp]) -> Array:
    """Return the root mean square residual of each reading in a linear fit that is robust against outliers.

    Weights are those of Huber (1964), whose fit is unique, then their squares, which nearly exclude outliers.

    Args:
        white, by_z, by_nuisance: Whitened numbers ``(M,)`` and their derivatives ``(M, r)``, of unit prior, and ``(M, k)``.
        rows: The reading of each number, ``(M,)``.
    """
    counts, weights = np.maximum(np.bincount(rows), 1), np.ones(rows.max() + 1)
    for power in np.repeat([1, 2], 2 * REWEIGHED):
        root = np.sqrt(weights)[rows]
        estimator = Estimator.of(root[:, None] * by_z, root[:, None] * by_nuisance, has_prior=True)
        residuals = white - by_z @ estimator.estimate(root * white)
        residuals = residuals - by_nuisance @ estimator.nuisances(root * residuals)
        sizes = np.sqrt(np.bincount(rows, residuals**2) / counts)
        weights = np.maximum(1.0, sizes / max(1.0, float(np.median(sizes[np.unique(rows)])))) ** -float(power)
    return np.asarray(sizes)


def first_guess(data: CalibrationData, tips: Array, instruments: Instruments) -> tuple[tuple[Array, ...], Array]:
    """Return the base ``(4, 4)`` of each measurement that fits tips ``(P, 4, 4)`` best, and nuisances relative to it."""
    nuisances, bases = np.zeros(len(instruments.nuisances)), [np.eye(4) for _ in data.measurements]
    targets = np.array([part.target for part in data.measurements])[data.part]
    points = tips[:, :3, 3] + np.einsum("pij,pj->pi", tips[:, :3, :3], targets)
    keys = [("" if part.place is None else part.kind, part.base_name, part.base) for part in data.measurements]
    for key in dict.fromkeys(keys):
        sharing = [k for k, part_key in enumerate(keys) if part_key == key]
        rows, part = np.flatnonzero(np.isin(data.part, sharing)), data.measurements[sharing[0]]
        if part.kind in ("plane", "socket") or not any(instruments.columns[k].size for k in sharing) or not rows.size:
            continue
        if part.kind == "distance":
            if part.base == "free":
                columns = instruments.columns[sharing[0]][:3]
                nuisances[columns] = _anchor(points[rows], data.readings[rows, 0]) - part.anchor
            continue
        base, fitted_targets = _base_and_targets(data, rows, points[rows], tips[rows, :3, :3])
        for k in sharing:
            bases[k] = base
            if not data.measurements[k].target_known:
                size = data.measurements[k].size
                nuisances[instruments.columns[k][-size:]] = fitted_targets[data.measurements[k].target_name][:size]
    return tuple(bases), nuisances


def _base_and_targets(
    data: CalibrationData, rows: NDArray[np.intp], points: Array, rotations: Array
) -> tuple[Array, dict[str, Array]]:
    """Return the base ``(4, 4)``, and shift and turn ``(6,)`` of each unknown target, whatever these turns are.

    A position, and each column of an attitude, is a vector v with ``S v + d = p + R u``: S and d are the inverse of the base,
    u the unknown target or a column of its turn. These equations are linear where S may be any matrix. Tried are the rotation
    nearest to it, and the one that fits the readings to the targets found before; d and u follow by linear equations.
    """
    parts = [data.measurements[k] for k in data.part[rows]]
    names = list(dict.fromkeys(part.target_name for part in parts if not part.target_known))
    is_free, is_pose = parts[0].base == "free", np.array([part.kind == "pose" for part in parts])
    shape = (len(rows), 4, 3)
    vectors, arm, by_target = np.zeros(shape), np.zeros(shape), np.zeros((*shape, len(names), 4, 3))
    vectors[:, 0], arm[:, 0] = data.readings[rows, :3], points
    if is_pose.any():
        vectors[is_pose, 1:] = se3.exp_rotation(data.readings[rows[is_pose], 3:6].T).transpose(2, 1, 0)
    for k, part in enumerate(parts):
        if part.target_known:
            arm[k, 1:] = rotations[k].T
        else:
            by_target[k, range(4), :, names.index(part.target_name), range(4)] = -rotations[k]
    by_base = np.einsum("ab,pjc->pjabc", np.eye(3), vectors).reshape(*shape, 9)
    others = np.zeros((*shape, 3 * is_free + 12 * len(names)))
    others[..., 3 * is_free :] = by_target.reshape(*shape, -1)
    others[:, 0, :, : 3 * is_free] = np.eye(3)[:, : 3 * is_free]
    scale = np.array([1 / part.deviations[[0, -1, -1, -1]] for part in parts])
    scale[~is_pose, 1:] = 0.0
    weights, minimum, solution = np.ones(len(rows)), np.inf, np.zeros(others.shape[-1])

    def solve(matrix: Array, right: Array) -> Array:
        root = scale * np.sqrt(weights)[:, None]
        white = (root[:, :, None, None] * matrix).reshape(-1, matrix.shape[-1])
        return set_up_of(white, (root[:, :, None] * right).ravel())

    for _ in range(REWEIGHED):
        candidates = [np.eye(3)]
        if is_free:
            mass = (scale**2 * weights[:, None])[:, :, None]
            arm_vectors, read_vectors = arm - others @ solution, vectors.copy()
            for vector_set in (arm_vectors, read_vectors):  # only positions have shifts
                vector_set[:, 0] -= np.average(vector_set[:, 0], axis=0, weights=mass[:, 0, 0])
            candidates = [np.einsum("pja,pjb->ab", mass * arm_vectors, read_vectors)]
            sizes = np.linalg.svd(candidates[0], compute_uv=False)
            if sizes[1] <= 1e-6 * sizes[0]:  # collinear or coincident points: the smallest of the rotations that fit
                candidates[0] += max(1e-6 * sizes[0], np.finfo(float).tiny) * np.eye(3)
            else:
                candidates.append(solve(np.concatenate([by_base, others], axis=3), arm)[:9].reshape(3, 3))
        for rotation in map(se3.nearest_rotation, candidates):
            right = arm - vectors @ rotation.T
            trial = solve(others, right)
            squares = ((scale[:, :, None] * (right - others @ trial)) ** 2).sum(axis=(1, 2))
            if np.median(squares) < minimum:
                minimum, base_rotation, solution, best_squares = float(np.median(squares)), rotation.T, trial, squares
        weights = 1 / np.sqrt(1 + best_squares / max(minimum, np.finfo(float).tiny))
    target_columns = solution[3 * is_free :].reshape(-1, 4, 3)
    tilts = (se3.log_rotation(se3.nearest_rotation(u[1:].T)) for u in target_columns)
    targets = {name: np.concatenate([u[0], tilt]) for name, u, tilt in zip(names, target_columns, tilts, strict=True)}
    return se3.pose(base_rotation, -base_rotation @ solution[:3] if is_free else np.zeros(3)), targets


def _anchor(points: Array, distances: Array) -> Array:
    """Return the anchor ``(3,)`` from which points ``(P, 3)`` have these distances best: ``|p|² - d² = 2 p·a - |a|²``."""
    centre = points.mean(axis=0)
    centred = points - centre
    rows = np.hstack([2 * centred, -np.ones((len(centred), 1))])
    if len(centred) < 4 or np.linalg.svd(centred, compute_uv=False)[2] < 1e-6 * np.abs(centred).max():
        raise InputError("a free anchor needs distances of at least four points that do not lie in one plane")
    solution = np.linalg.lstsq(rows, (centred**2).sum(axis=1) - distances**2, rcond=None)[0]
    return np.asarray(centre + solution[:3])


def readings_in_base(data: CalibrationData, poses: Array, bases: Sequence[Array]) -> Array:
    """Return readings ``(P, m)`` as :meth:`Measurement.predict` returns them: in base axes, turns from nominal ``(P, 4, 4)``."""
    result = np.nan_to_num(data.readings, nan=0.0)
    for row, number in enumerate(data.part):
        part, base = data.measurements[number], bases[number]
        if part.place is not None:
            continue
        result[row, :3] = (data.readings[row, :3] - base[:3, 3]) @ base[:3, :3]
        if part.kind == "pose":
            attitude = base[:3, :3].T @ se3.exp_rotation(data.readings[row, 3:6])
            result[row, 3:6] = se3.log_rotation(attitude @ poses[row, :3, :3].T)
    return result


def nominal_distance(chain: Chain, data: CalibrationData) -> float:
    """Return the distance of the readings from the nominal arm, set-up fitted: root mean square of whitened residuals.

    The farthest readings, as many as may be gross errors, are omitted.
    """
    instruments = Instruments(data.measurements)
    poses = np.moveaxis(chain.with_target((0.0, 0.0, 0.0)).at_columns(np.ascontiguousarray(data.q)).pose, -1, 0)
    bases, start = first_guess(data, poses, instruments)
    readings = readings_in_base(data, poses, bases)
    values, slopes = [], []
    for row, number in enumerate(data.part):
        part, part_nuisances = data.measurements[number], start[instruments.columns[number], None]
        predicted = part.predict(poses[row], np.zeros((6, 1)), part_nuisances)
        values.append(part.residual(readings[row, : part.size, None], predicted)[:, 0] / part.deviations)
        slopes.append(instruments.slopes(number, poses[row], np.zeros(6), start).nuisances / part.deviations[:, None])
    rows = np.repeat(np.arange(len(data)), [len(residuals) for residuals in values])
    white, by_nuisance = np.concatenate(values), np.concatenate(slopes)
    sizes = reweighed_sizes(white, np.zeros((len(white), 0)), by_nuisance, rows)
    return float(np.sqrt(np.mean(np.sort(sizes)[: -int(MOST_GROSS * len(sizes)) or None] ** 2)))
