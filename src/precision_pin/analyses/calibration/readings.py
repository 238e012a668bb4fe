"""The readings of a calibration that are farthest from the calibrated arm: where it predicts them, and how far off they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.calibration.calibration_result import CalibrationResult
from precision_pin.analyses.calibration.design import stations_of
from precision_pin.base.arrays import Array
from precision_pin.sheet.measurement import Measurement


@final
@dataclass(frozen=True, eq=False)
class WorstReadings:
    """Readings, that with the largest residual of its lengths first, base axes.

    Attributes
    ----------
    rows
        Their indices in the data, ``(K,)``.
    lines
        Their rows in the file, from 1.
    points
        Place of the target where the calibrated arm predicts it, m, ``(3, K)``.
    after, before
        Residual after and before the calibration, m, ``(3, K)``: of a distance along the line of sight, of a height along the
        normal of the plane. Before, in the axes of the first guess of the base where that is not known.
    sizes
        Lengths of ``after``, m, ``(K,)``.
    deviations
        Size of the whole residual in standard deviations of the reading, ``(K,)``: of instrument and repeatability together; of
        a gross error, of the fit without it too.
    is_gross
        Whether a reading was given no weight, ``(K,)``.
    anchor
        Where distances are measured from, m, ``(3,)``; ``None`` for other readings.
    """

    rows: NDArray[np.intp]
    lines: tuple[int, ...]
    points: Array
    after: Array
    before: Array
    sizes: Array
    deviations: Array
    is_gross: NDArray[np.bool_]
    anchor: Array | None

    @classmethod
    def of(cls, result: CalibrationResult, most: int) -> WorstReadings:
        """Return the worst readings of a calibration, ``most`` of them or all."""
        sizes = np.linalg.norm(result.residuals[:, :3], axis=1)
        rows = np.argsort(-sizes, kind="stable")[:most]
        given, data, found = result.measurement, result.data, result.set_up
        known = _known(result)
        points, after, before = np.zeros((3, rows.size)), np.zeros((3, rows.size)), np.zeros((3, rows.size))
        deviations = np.zeros(rows.size)
        for station in stations_of(result.original, data.q[:, rows], given):
            pose, error = station.at.posture.pose, station.at.exact(result.components[:, None])
            point = Measurement(target=known.target).predict(pose, error, np.zeros((0, 1)))[:, 0]
            slopes = known.slopes(pose, error[:, 0], np.zeros(0))
            directions = np.eye(3)
            if known.place is not None:
                nominal = pose[:3, 3] + pose[:3, :3] @ given.target
                directions = known.place.slopes(point, np.zeros(len(known.place.names)), nominal)[0]
            for k in station.rows:
                row = int(rows[k])
                points[:, k] = point
                after[:, k] = result.residuals[row, : len(directions)] @ directions
                before[:, k] = result.residuals_before[row, : len(directions)] @ directions
                if found.base is not None:
                    place = found.base
                    after[:, k] = (data.readings[row, :3] - place[:3, 3]) @ place[:3, :3] - point
                scale = data.std[row] / given.std if data.std.size else 1.0
                alone = replace(station, rows=(k,))
                noise = alone.noise(known, slopes.error, (scale * given.deviations) ** 2)
                residual = result.residuals[row].copy()
                residual[:3] = after[:, k] if known.place is None else residual[:3]
                deviations[k] = np.sqrt(residual @ np.linalg.solve(noise, residual))
        gross = {error.line: error.deviations for error in result.gross_errors}
        lines = tuple(data.lines[row] for row in rows)
        is_gross = np.array([line in gross for line in lines], dtype=bool)
        deviations = np.array([gross.get(line, own) for line, own in zip(lines, deviations.tolist(), strict=True)])
        return cls(rows, lines, points, after, before, sizes[rows], deviations, is_gross, found.anchor)


def _known(result: CalibrationResult) -> Measurement:
    """Return the measurement with its set-up as estimated, in base axes."""
    found = result.set_up
    target = tuple(found.target.tolist())
    places: dict[str, object] = {}
    if found.anchor is not None:
        places["anchor"] = tuple(found.anchor.tolist())
    if found.plane is not None:
        places["plane"] = tuple(tuple(one) for one in found.plane.tolist())
    if found.sockets is not None:
        places["sockets"] = tuple(tuple(one) for one in found.sockets.tolist())
    return replace(result.measurement, target=target, base="known", target_known=True, **places)  # type: ignore[arg-type]
