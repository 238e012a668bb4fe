"""Start of a fit: base and targets in closed form, distance of the readings from the nominal arm, joint directions.

A quick fit of the nominal arm finds joint zeros and directions that no tolerance can explain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations, compress, islice, permutations
from typing import Final, NamedTuple

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from precision_pin.analyses.calibration.data import CONTACT, CalibrationData
from precision_pin.analyses.calibration.design import MOST_GROSS, Estimator, Instruments, set_up_of
from precision_pin.analyses.calibration.noise import Reduction
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain
from precision_pin.sheet.measurement import Measurement, written_sums

REWEIGHED: Final = 6
"""Rounds of a reweighted fit; outliers weigh less in each."""
_AT_ONCE: Final = 512
"""Readings whose equations are made at once."""


def reweighed_sizes(parts: Callable[[], Iterable[tuple[NDArray[np.intp], Array]]], nuisances: int, count: int) -> Array:
    """Return the root mean square residual of each reading in a linear fit that is robust against outliers, ``(count,)``.

    Weights are those of Huber (1964), whose fit is unique, then their squares, which nearly exclude outliers.

    Args:
        parts: Yields, chunk by chunk, the reading of each number ``(m,)``, and columns ``(m, k + r + 1)``: whitened
            derivatives by the nuisances and by numbers of unit prior, and the whitened number.
        nuisances, count: k, and the number of readings.
    """
    numbers = sum(np.bincount(rows, minlength=count) for rows, _ in parts())
    weights = np.ones(count)
    for power in np.repeat([1, 2], 2 * REWEIGHED):
        roots, squares = np.sqrt(weights), np.zeros(count)
        reduction = Reduction.of((roots[rows, None] * columns for rows, columns in parts()), 0, nuisances)
        by_z = reduction.rows[:, nuisances:-1]
        estimator = Estimator.of(by_z, reduction.by_nuisance, has_prior=True)
        z = estimator.estimate(reduction.white, np.zeros(by_z.shape[1]))
        estimates = np.concatenate([estimator.nuisances(reduction.white - by_z @ z), z, [-1.0]])
        for rows, columns in parts():
            squares += np.bincount(rows, (columns @ estimates) ** 2, count)
        sizes = np.sqrt(squares / np.maximum(numbers, 1))
        weights = np.maximum(1.0, sizes / max(1.0, float(np.median(sizes[numbers > 0])))) ** -float(power)
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
    target = np.array([-1 if part.target_known else names.index(part.target_name) for part in parts])
    is_free, is_pose = parts[0].base == "free", np.array([part.kind == "pose" for part in parts])
    vectors, arm = np.zeros((len(rows), 4, 3)), np.zeros((len(rows), 4, 3))
    vectors[:, 0], arm[:, 0] = data.readings[rows, :3], points
    if is_pose.any():
        vectors[is_pose, 1:] = se3.exp_rotation(data.readings[rows[is_pose], 3:6].T).transpose(2, 1, 0)
    arm[target < 0, 1:] = rotations[target < 0].swapaxes(1, 2)
    scale = np.array([1 / part.deviations[[0, -1, -1, -1]] for part in parts])
    scale[~is_pose, 1:] = 0.0
    chunks = [slice(k, k + _AT_ONCE) for k in range(0, len(rows), _AT_ONCE)]
    weights, minimum, solution = np.ones(len(rows)), np.inf, np.zeros(3 * is_free + 12 * len(names))

    def others(chunk: slice) -> Array:
        """Return the coefficients of the shift and the targets, ``(p, 4, 3, c)``."""
        known = target[chunk]
        result, is_unknown = np.zeros((len(known), 4, 3, solution.size)), np.flatnonzero(known >= 0)
        by_target = result[..., 3 * is_free :].reshape(len(known), 4, 3, len(names), 4, 3)
        for k in range(4):
            by_target[is_unknown, k, :, known[is_unknown], k] = -rotations[chunk][is_unknown]
        result[..., 3 * is_free :] = by_target.reshape(len(known), 4, 3, -1)
        result[:, 0, :, : 3 * is_free] = np.eye(3)[:, : 3 * is_free]
        return result

    def solve(right: Array, by_base: Callable[[slice], Array] | None = None) -> Array:
        def white(chunk: slice) -> Array:
            columns = [others(chunk), right[chunk, :, :, None]]
            columns = columns if by_base is None else [by_base(chunk), *columns]
            root = scale[chunk] * np.sqrt(weights[chunk, None])
            whole = root[:, :, None, None] * np.concatenate(columns, axis=3)
            return whole.reshape(-1, whole.shape[3])

        reduction = Reduction.of(map(white, chunks), 0, 0)
        return set_up_of(reduction.rows[:, :-1], reduction.white)

    def by_base(chunk: slice) -> Array:
        part = vectors[chunk]
        return np.einsum("ab,pjc->pjabc", np.eye(3), part).reshape(len(part), 4, 3, 9)

    def times(estimate: Array) -> Array:
        return np.concatenate([others(chunk) @ estimate for chunk in chunks])

    for _ in range(REWEIGHED):
        candidates = [np.eye(3)]
        if is_free:
            mass = (scale**2 * weights[:, None])[:, :, None]
            arm_vectors, read_vectors = arm - times(solution), vectors.copy()
            for vector_set in (arm_vectors, read_vectors):  # only positions have shifts
                vector_set[:, 0] -= np.average(vector_set[:, 0], axis=0, weights=mass[:, 0, 0])
            candidates = [np.einsum("pja,pjb->ab", mass * arm_vectors, read_vectors)]
            sizes = np.linalg.svd(candidates[0], compute_uv=False)
            if sizes[1] <= 1e-6 * sizes[0]:  # collinear or coincident points: the smallest of the rotations that fit
                candidates[0] += max(1e-6 * sizes[0], np.finfo(float).tiny) * np.eye(3)
            else:
                candidates.append(solve(arm, by_base)[:9].reshape(3, 3))
        for rotation in map(se3.nearest_rotation, candidates):
            right = arm - vectors @ rotation.T
            trial = solve(right)
            squares = ((scale[:, :, None] * (right - times(trial))) ** 2).sum(axis=(1, 2))
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
    parts = [(rows, np.column_stack([by_nuisance, white]))]
    sizes = reweighed_sizes(lambda: parts, start.size, len(data))
    return float(np.sqrt(np.mean(np.sort(sizes)[: -int(MOST_GROSS * len(sizes)) or None] ** 2)))


# joint zeros and directions -------------------------------------------------------------------------------------------

_BAD: Final = 0.01
"""Residual, as a fraction of the arm's length, above which a joint direction may be wrong after fitting zeros."""
_DEVIATIONS: Final = 10.0
"""Minimum of this residual, in standard deviations of the instrument."""
_BETTER: Final = 3.0
"""Factor by which a reversed direction must reduce the residual."""
_CLEARLY: Final = 1.5
"""The factor for joints whose direction has little effect, after the others are reversed."""
_MOST_TRIED: Final = 64
"""Maximum number of combinations of reversed joints."""
_EVALUATIONS: Final = 15
"""Evaluations of a fit of zeros; the correct combination needs fewer."""
_HOLD: Final = 1e-4
"""Weight of a zero, m/rad, which keeps zeros at nominal if no reading depends on them."""
_ALIGNED: Final = 4
"""Alignments of points with readings; outliers weigh less in each."""
_OUTSIDE: Final = 5.0
"""Residual, in medians of all, of a reading that does not count."""


class Zeros(NamedTuple):
    """Offsets of the joint zeros from nominal ``(n,)``, rad or m, and the root mean square (m) of the residual."""

    values: Array
    rms: float

    def describe(self, chain: Chain) -> str:
        """Return a description of the zeros, largest first."""
        order = np.argsort(-np.abs(self.values), kind="stable")[:3]
        scales = [(1e3, " mm") if slides else (180 / np.pi, "°") for slides in chain.prismatic]
        return ", ".join(f"{chain.joint_names[k]} {scales[k][0] * self.values[k]:+.3g}{scales[k][1]}" for k in order)


def fit_zeros(chain: Chain, q: Array, readings: Array, measurement: Measurement, evaluations: int = 40) -> Zeros:
    """Return the best zeros, fitted with unknown base, target or anchor to readings ``(P, 3)`` or ``(P, 1)``.

    Outliers have little weight. ``evaluations`` is their maximum number.
    """
    count = len(chain.joints)
    is_free, is_distance = measurement.base == "free", measurement.kind == "distance"
    is_estimated = [True] * count + [not measurement.target_known] * 3 + [True] * (3 if is_distance and is_free else 0)

    def residuals(y: Array) -> Array:
        x = np.zeros(len(is_estimated))
        x[is_estimated] = y
        pose = chain.at_columns(q + x[:count, None]).pose
        target = np.array(measurement.target) + x[count : count + 3]
        points = (pose[:3, 3] + np.einsum("ijp,j->ip", pose[:3, :3], target)).T
        if is_distance:
            anchor = np.array(measurement.anchor) + (x[count + 3 :] if is_free else 0.0)
            offsets = np.linalg.norm(points - anchor, axis=1) - readings[:, 0]
        else:
            offsets = (_align(points, readings) if is_free else points) - readings
        return np.concatenate([offsets.ravel(), _HOLD * y[: count + (0 if measurement.target_known else 3)]])

    solution = scipy.optimize.least_squares(
        residuals, np.zeros(sum(is_estimated)), max_nfev=evaluations, loss="soft_l1", f_scale=_BAD * _length(chain)
    )
    sizes = np.linalg.norm(solution.fun[: readings.size].reshape(readings.shape), axis=1)
    return Zeros(solution.x[:count], float(np.sqrt((sizes[sizes <= _OUTSIDE * np.median(sizes)] ** 2).mean())))


def _length(chain: Chain) -> float:
    return float(np.linalg.norm(chain.placements[:, :3, 3], axis=1).sum())


def _align(points: Array, readings: Array) -> Array:
    weights = np.ones(len(points))
    for _ in range(_ALIGNED):
        centre, target_centre = (np.average(cloud, axis=0, weights=weights) for cloud in (points, readings))
        rotation = se3.nearest_rotation((weights[:, None] * (readings - target_centre)).T @ (points - centre))
        aligned = (points - centre) @ rotation.T + target_centre
        sizes = np.linalg.norm(aligned - readings, axis=1)
        weights = 1 / (sizes + np.median(sizes) + 1e-12)
    return np.asarray(aligned)


def check_directions(chain: Chain, data: CalibrationData, measurement: Measurement) -> Zeros | None:
    """Raise if readings fit far better with reversed or coupled joints; return the best zeros."""
    # not for contact readings, which depend on the assumed arm
    if measurement.kind in CONTACT:
        return None
    rows = np.flatnonzero(data.part == data.measurements.index(measurement))
    q, readings = data.q[:, rows], data.readings[rows, : min(measurement.size, 3)]
    plain = fit_zeros(chain, q, readings, measurement)
    suspicious_rms = max(_DEVIATIONS * measurement.std, _BAD * _length(chain))
    if not suspicious_rms < plain.rms < _length(chain):  # beyond the arm's length, joint values are not the cause
        return plain

    def rms_of(mixing: Array) -> float:
        return fit_zeros(chain, mixing @ q, readings, measurement, _EVALUATIONS).rms

    for alternatives in _mixings(chain):
        sizes = [rms_of(mixing) for mixing in alternatives]
        mixing, rms = alternatives[int(np.argmin(sizes))], min(sizes)
        if rms < min(plain.rms / _BETTER, suspicious_rms):
            mixing, rms = _refine_mixing(rms_of, mixing, rms)
            residuals = f"(residuals {1e3 * rms:.3g} mm rms instead of {1e3 * plain.rms:.3g} mm, all zeros free)"
            if sums := written_sums(mixing, chain.joint_names):
                message = (
                    f"readings fit far better where one joint is shown with another {residuals}; if the control does so, "
                    f"write measurement: {{coupled: {{{sums}}}}} in the sheet"
                )
                raise InputError.of("E_COUPLED", message, data.file or None)
            names = " and ".join(compress(chain.joint_names, np.diag(mixing) < 0))
            message = (
                f"{names}: readings fit far better with the direction reversed {residuals}; change the sign of the column, or "
                "turn the axis and its limits around in the URDF; or two position columns are swapped"
            )
            raise InputError.of("E_REVERSED", message, data.file or None)
    return plain


def _refine_mixing(rms_of: Callable[[Array], float], mixing: Array, rms: float) -> tuple[Array, float]:
    """Return a mixing after reversing less important joints one by one while the fit improves clearly."""
    while True:
        candidates = [np.where(np.arange(len(mixing)) == k, -1.0, 1.0)[:, None] * mixing for k in range(len(mixing))]
        sizes = [rms_of(candidate) for candidate in candidates]
        best_index = int(np.argmin(sizes))
        if sizes[best_index] > rms / _CLEARLY:
            return mixing, rms
        mixing, rms = candidates[best_index], sizes[best_index]


def _mixings(chain: Chain) -> Iterator[list[Array]]:
    """Yield mixings ``(n, n)`` of joint values to choose from: one joint reversed, or with another; then more reversed."""
    slides, unit = chain.prismatic, np.eye(count := len(chain.joints))
    flips = (row for number in range(1, count + 1) for row in combinations(range(count), number))
    reversals = [np.diag(np.where(np.isin(np.arange(count), row), -1.0, 1.0)) for row in islice(flips, _MOST_TRIED)]
    pairs = [pair for pair in permutations(range(count), 2) if slides[pair[0]] == slides[pair[1]]]
    couplings = [(a, unit + sign * np.outer(unit[a], unit[b])) for a, b in pairs for sign in (1.0, -1.0)]
    yield [*reversals[:count], *(mixing for _, mixing in couplings)]
    yield from ([mixing] for mixing in reversals[count:])
    if couplings:
        yield [reversals[joint] @ mixing for joint, mixing in couplings]
