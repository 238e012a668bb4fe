"""Covariance of the instrument at each reading: one standard deviation, or one of each direction or axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.drift import CommonFactors
from precision_pin.base.arrays import Array


def instrument_covariance(data: CalibrationData, readings: Array, bases: Sequence[Array]) -> Array:
    """Return the covariances ``(P, m, m)`` of readings ``(P, m)`` in base axes, m and rad.

    What a row of the data says goes before the measurement. If std is estimated, the rows give only the ratios. ``bases``
    ``(4, 4)`` are those of each measurement in the axes of its readings: a free one stands at their origin, if nothing else is
    said. Included is what a drift adds to single readings alone.
    """
    result = np.zeros((*readings.shape, readings.shape[1]))
    for k, part in enumerate(data.measurements):
        rows, size = np.flatnonzero(data.part == k), part.size
        stds = np.full(rows.size, part.std)
        is_given = np.isfinite(data.std[rows]) if data.std.size else np.zeros(rows.size, dtype=bool)
        stds[is_given] = data.std[rows[is_given]]
        reference_std = part.std if part.std_known else np.sqrt((stds**2).mean())
        scale = stds / reference_std
        covariance = scale[:, None, None] ** 2 * np.diag(part.deviations**2)
        rotation = bases[k][:3, :3]
        if part.sight is not None and part.kind == "distance":
            covariance[~is_given, 0, 0] = part.sight.distance_variance(readings[rows[~is_given], 0])
        elif part.sight is not None:
            origin = -rotation.T @ bases[k][:3, 3] if part.station is None else np.array(part.station)
            covariance[~is_given, :3, :3] = part.sight.covariance(origin, readings[rows[~is_given], :3])
        if data.axis_ratios.size and size >= 3:
            axes = rotation.T * data.axis_ratios[rows[is_given], None]
            covariance[is_given, :3, :3] = covariance[is_given, :1, :1] * (axes @ np.swapaxes(axes, 1, 2))
        result[rows, :size, :size] = covariance
    for session in data.sessions:
        result[session.rows, :3, :3] += session.left.steps.own[:, None, None] * np.eye(3)
    return result


def fitted_covariance(data: CalibrationData, bases: Sequence[Array | None]) -> Array:
    """Return :func:`instrument_covariance` where the bases ``(4, 4)`` are fitted, or known: ``None``; with all of a drift."""
    places = [np.eye(4) if base is None else base for base in bases]
    readings = np.nan_to_num(data.readings, nan=0.0)
    for k, base in enumerate(places):
        rows = data.part == k
        if data.measurements[k].place is None:
            readings[rows, :3] = (readings[rows, :3] - base[:3, 3]) @ base[:3, :3]
    rotations = np.array([base[:3, :3].T for base in places])[data.part]
    of_drift = CommonFactors(data.sessions, readings.shape[1], rotations).covariances
    return instrument_covariance(data, readings, places) + of_drift


def length_stds(covariance: Array) -> Array:
    """Return the root mean square standard deviation of the lengths of each reading, ``(P,)``, of ``(P, m, m)``."""
    variances = np.diagonal(covariance, axis1=1, axis2=2)[:, :3]
    # zeros beyond the numbers of a shorter reading
    return np.asarray(np.sqrt(variances.sum(axis=1) / np.count_nonzero(variances, axis=1)))
