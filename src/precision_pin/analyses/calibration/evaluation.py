"""The readings of all poses at a point of the fit: predictions, residuals and derivatives, computed for many poses at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.calibration.design import Instruments, scope_covariances
from precision_pin.analyses.readings import Station
from precision_pin.base.arrays import Array
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import PoseModel, Tables, of_one_layout
from precision_pin.sheet.measurement import Linearised


class Point(NamedTuple):
    """Predicted readings ``(R, m)``, and their derivatives by c components of the space and by the nuisances.

    ``derivatives`` are ``(R, m, c + k)``.
    """

    values: Array
    derivatives: Array


_KEPT: Final = 32_000_000
"""Bytes of derivatives at one point that are kept, since fits without some readings share them."""


class Evaluation:
    """The exact model at the stations of P readings, in chunks of stations.

    Of the models only their tables stay in memory, and of the derivatives at the last point as many as have a fixed size.

    Attributes:
        rows: Numbers of the readings at each station.
        poses: Nominal tip of each station, ``(S, 4, 4)``.
        station: Number of the station of each reading, ``(P,)``, -1 for none.
        chunks: Numbers of the readings in each chunk of stations, station by station.
        at_means: The error at the means at each station, ``(S, 6)``, and its covariances by numbers of scope visit and pose.
    """

    def __init__(
        self, space: Space, instruments: Instruments, stations: Iterable[Station], part: NDArray[np.intp]
    ) -> None:
        self._instruments, self._part, self._tables = instruments, part, list[Tables]()
        self._width = max(measurement.size for measurement in instruments.parts)
        rows, poses, errors, covariances = [], [], [], {scope: list[Array]() for scope in (Scope.VISIT, Scope.POSE)}

        def models() -> Iterator[PoseModel]:
            for station in stations:
                rows.append(station.rows)
                yield station.at

        for chunk in of_one_layout(models()):
            self._tables.append(Tables.of(chunk))
            poses += [at.posture.pose for at in chunk]
            tangent = self._tables[-1].tangent(space.mean)
            errors.append(tangent.error.T)
            for scope, parts in covariances.items():
                parts.append(scope_covariances(space, scope, np.moveaxis(tangent.jacobian, -1, 0)))
        self.rows, self.poses = tuple(rows), np.array(poses).reshape(-1, 4, 4)
        is_drawn = {scope: space.has_scope(scope).any() for scope in covariances}
        nothing = np.broadcast_to(np.zeros((6, 6)), (len(rows), 6, 6))
        scopes = {scope: np.concatenate(parts) if is_drawn[scope] else nothing for scope, parts in covariances.items()}
        self.at_means = np.concatenate(errors), scopes
        self.station = np.full(len(part), -1)
        for number, of_station in enumerate(self.rows):
            self.station[list(of_station)] = number
        self._firsts = np.cumsum([0, *map(len, errors)])
        order = np.argsort(self.station, kind="stable")
        self.chunks = np.split(order, np.searchsorted(self.station[order], self._firsts))[1:-1]
        self._last: tuple[bytes, dict[int, Point]] = (b"", {})

    def by_error(self, nuisances: Array) -> Array:
        """Return the derivatives of the readings by the tip's error, with the means of the sheet, ``(P, m, 6)``."""
        result = np.zeros((len(self._part), self._width, 6))
        for number, chunk in enumerate(self.chunks):
            errors = self.at_means[0][self._firsts[number] : self._firsts[number + 1]]
            for at, _, of_rows in self._predict(number, errors, nuisances):
                result[chunk[at], : of_rows.values.shape[1]] = of_rows.by_error
        return result

    def at(self, number: int, x: Array, components: NDArray[np.intp], nuisances: Array) -> Point:
        """Return one chunk's predictions and derivatives by some components, at values ``(d,)`` and nuisances ``(k,)``."""
        key = x.tobytes() + nuisances.tobytes()
        if self._last[0] != key:
            self._last = key, {}
        known = self._last[1]
        if number not in known:
            tangent = self._tables[number].tangent(x)
            by_component = np.moveaxis(tangent.jacobian[:, components], -1, 0)
            chunk, count, first = self.chunks[number], components.size, self._firsts[number]
            shape = len(chunk), self._width
            point = Point(np.zeros(shape), np.zeros((*shape, count + nuisances.size)))
            for at, columns, of_rows in self._predict(number, tangent.error.T, nuisances):
                size = of_rows.values.shape[1]
                point.values[at, :size] = of_rows.values
                point.derivatives[at, :size, :count] = of_rows.by_error @ by_component[self.station[chunk[at]] - first]
                point.derivatives[at[:, None], :size, count + columns] = of_rows.by_nuisance.swapaxes(1, 2)
            if sum(other.derivatives.nbytes for other in known.values()) + point.derivatives.nbytes > _KEPT:
                return point
            known[number] = point
        return known[number]

    def _predict(
        self, number: int, errors: Array, nuisances: Array
    ) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], Linearised]]:
        """Yield for each measurement the places of its readings in a chunk, its nuisances and predictions."""
        chunk, first = self.chunks[number], self._firsts[number]
        for of_part in np.unique(self._part[chunk]).tolist():
            at, columns = np.flatnonzero(self._part[chunk] == of_part), self._instruments.columns[of_part]
            stations, part = self.station[chunk[at]], self._instruments.parts[of_part]
            yield at, columns, part.linearised(self.poses[stations], errors[stations - first], nuisances[columns])
