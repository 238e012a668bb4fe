"""Readings of an instrument: the poses where they are taken, readings of simulated robots, and their files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import compress
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import se3
from precision_pin.base.arguments import check_instance, check_whole
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError
from precision_pin.base.files import csv_text
from precision_pin.draws.draw import MOST_VISITS, Scope
from precision_pin.draws.space import check_seed
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.joint_columns import joint_columns
from precision_pin.sheet.measurement import KINDS, Measurement
from precision_pin.terms.bound_source import LabelledSources

COLUMNS: Final = {
    "position": ("x", "y", "z"),
    "pose": ("x", "y", "z", "rx", "ry", "rz"),
    "distance": ("distance",),
    "plane": ("height",),
    "socket": ("x", "y", "z"),
}
"""Names of the numbers of a reading, by kind: lengths, or angles if they start with r."""


def scope_covariance(at: PoseModel, scope: Scope) -> Array:
    """Return the covariance ``(6, 6)`` of the error by the numbers of a scope, first order."""
    columns = np.flatnonzero(at.space.has_scope(scope))
    slopes = at.jacobian[:, columns]
    return np.asarray(slopes @ at.space.block_covariance.within(columns) @ slopes.T)


class Station(NamedTuple):
    """A pose where readings are taken: the model there, and the indices of its readings."""

    at: PoseModel
    rows: tuple[int, ...]

    def noise(self, by_error: Array, instrument: Array, visits: NDArray[np.intp]) -> Array:
        """Return the covariance of the numbers read here, ``(M, M)``.

        ``by_error`` ``(M, 6)`` are their derivatives by the tip's error, ``instrument`` ``(M, M)`` its covariance;
        numbers of one of ``visits`` ``(M,)`` were read together.
        """
        visit_covariance = by_error @ scope_covariance(self.at, Scope.VISIT) @ by_error.T
        common = by_error @ scope_covariance(self.at, Scope.POSE) @ by_error.T
        return np.asarray(instrument + visit_covariance * (visits[:, None] == visits) + common)

    def noise_root(self, by_error: Array, instrument: Array, visits: NDArray[np.intp]) -> Array:
        """Return the lower triangular root of :meth:`noise`; raise if the instrument's part is lost in rounding."""
        noise = self.noise(by_error, instrument, visits)
        try:
            return np.asarray(np.linalg.cholesky(noise), dtype=float)
        except np.linalg.LinAlgError:
            widest, smallest = float(np.sqrt(np.diag(noise).max())), float(np.sqrt(np.diag(instrument).min()))
            raise InputError(
                f"numbers of scope visit or pose spread a reading by {1e3 * widest:.3g} mm or mrad, beside which the std of "
                f"the instrument, {1e3 * smallest:.3g} mm or mrad, is lost in rounding; give smaller tolerances, or a larger std"
            ) from None


def measurement_of(model: ErrorModel, measurement: Measurement | None, *, has_data: bool = False) -> Measurement:
    """Return the measurement given, or the sheet's; raise for an unknown std without readings to estimate it."""
    check_instance("model", model, ErrorModel, "as ErrorModel.load returns it")
    result = measurement if measurement is not None or model.sheet is None else model.sheet.measurement
    if result is None:
        raise InputError(
            "nothing says what is measured; give pp.Measurement(kind=..., std=...), or measurement: in the sheet"
        )
    check_instance("measurement", result, Measurement, "pp.Measurement(kind=..., std=...)")
    if not result.std_known and not has_data:
        raise InputError(
            "std: estimate belongs to the readings of one robot; give a standard deviation, such as --std 0.1mm"
        )
    return result


def measurements_of(
    model: ErrorModel, given: Measurement | Sequence[Measurement] | None, *, has_data: bool = False
) -> tuple[Measurement, ...]:
    """Return the measurement or measurements given, or the sheet's, as :func:`measurement_of` does."""
    check_instance("model", model, ErrorModel, "as ErrorModel.load returns it")
    if given is None and model.sheet is not None and model.sheet.measurements:
        return model.sheet.measurements
    items = given if isinstance(given, list | tuple) and given else (given,)
    return tuple(measurement_of(model, item, has_data=has_data) for item in items)


def measured_model(model: ErrorModel, measurement: Measurement) -> ErrorModel:
    """Return the model as measured: errors are those of the tip, to which targets are relative, under its load then."""
    chain = model.chain.with_target((0.0, 0.0, 0.0)) if model.chain.target.any() else model.chain
    if measurement.load is None:
        return model if chain is model.chain else model.like(chain, model.space)
    is_kept = [not source.is_put_down for source in model.sources]
    # the numbers of absent payloads stay in the space and change nothing
    other = model.like(chain, model.space)
    labels = (*compress(model.labels, is_kept), *(f"load[{k + 1}]" for k in range(len(measurement.load))))
    other.sources = LabelledSources((*compress(model.sources, is_kept), *measurement.load), labels)
    return other


def stations_of(
    model: ErrorModel, values: Array, measurement: Measurement, approaches: NDArray[np.int8] | None = None
) -> tuple[Station, ...]:
    """Return the stations of :func:`each_station`."""
    return tuple(each_station(model, values, measurement, approaches))


def each_station(
    model: ErrorModel, values: Array, measurement: Measurement, approaches: NDArray[np.int8] | None = None
) -> Iterator[Station]:
    """Return an iterator of stations, one for each distinct pose of ``(n, P)``, in order, with the columns that hold it."""
    signs = np.zeros(values.shape, dtype=np.int8) if approaches is None else approaches
    rows: dict[bytes, list[int]] = {}
    for k in range(values.shape[1]):
        rows.setdefault((values[:, k] + 0.0).tobytes() + signs[:, k].tobytes(), []).append(k)
    first = np.array([pose_rows[0] for pose_rows in rows.values()], dtype=np.intp)
    sides = None if approaches is None else np.ascontiguousarray(approaches[:, first])
    models = measured_model(model, measurement).at_columns(np.ascontiguousarray(values[:, first]), sides)
    return (Station(at, tuple(pose_rows)) for at, pose_rows in zip(models, rows.values(), strict=True))


_POSES: Final = 100_000
"""Poses of each kind in the random streams."""


def simulate_readings(
    stations: tuple[Station, ...],
    measurement: Measurement,
    model: ErrorModel,
    *,
    robots: int = 1,
    seed: int = 0,
    first: int = 0,
) -> Array:
    """Return readings ``(P, m, N)`` of robots by the exact model, with the set-up at its nominal values.

    Robots ``first … first + robots - 1`` are those of `precision_pin.monte_carlo` with this seed, which the noise uses too;
    stations are the poses in the order of the random streams. Each kind of measurement has its own noise and visits.
    """
    x = model.space.sample(seed, first, robots)
    count, kind = sum(len(station.rows) for station in stations), KINDS.index(measurement.kind)
    noise = np.random.default_rng([seed, 1, first, kind]).standard_normal((count, measurement.size, robots))
    readings = np.empty_like(noise)
    set_up = np.zeros((len(measurement.nuisances), robots))
    for number, station in enumerate(stations):
        rows, covariance = list(station.rows), measurement.covariance(station.at.posture.pose)
        root = np.linalg.cholesky(covariance) if measurement.sight else np.diag(measurement.deviations)
        readings[rows] = root @ noise[rows]
        for visit, row in enumerate(station.rows):
            errors = station.at.exact(with_later_draws(model, x, seed, kind * _POSES + number, visit, first))
            readings[row] += measurement.predict(station.at.posture.pose, errors, set_up)
    return readings


@dataclass(frozen=True, eq=False)
class Readings(Fixed):
    """Readings of one simulated robot.

    Attributes:
        model, measurement: Arm and instrument.
        q: Joint values of each reading, ``(n, P)``, rad and m.
        values: What the instrument shows, ``(P, m)``, m and rad.
        times: When each reading is taken, s or a number of readings, ``(P,)``; empty if the instrument does not drift.
        fixed: Times and numbers of readings of fixed targets, ``(F,)``, and what the instrument shows, ``(F, 3)``, m.
    """

    model: ErrorModel
    measurement: Measurement
    q: Array
    values: Array
    times: Array = field(default_factory=lambda: np.zeros(0))
    fixed: tuple[Array, NDArray[np.intp], Array] = field(
        default_factory=lambda: (np.zeros(0), np.zeros(0, int), np.zeros((0, 3)))
    )

    def to_csv(self, comments: Sequence[str] = ()) -> str:
        """Return the file that ``calibrate`` reads, below comments."""
        # couplings: what the controller shows is not what the joints have
        columns = np.asarray(np.linalg.solve(self.measurement.mixing(self.model.chain), self.q), dtype=float)
        # what no column can say is said by the sheet
        kind, std = self.measurement.kind, None if self.measurement.sight else self.measurement.std
        headings, rows = _rows(self.model.chain, columns, kind, self.values, std)
        if (drift := self.measurement.drift) is not None:
            times, targets, values = self.fixed
            # a target that stands still has no joint values, and no attitude
            joints, ends = [""] * len(columns), [""] * (self.values.shape[1] - 3)
            ends += [] if std is None else [f"{1e3 * std:.6f}"]
            fixed = zip(targets.tolist(), *_readings(COLUMNS["position"], values)[1], strict=True)
            rows = [[*row, ""] for row in rows] + [
                [*joints, *cells, *ends, f"T{target + 1}"] for target, *cells in fixed
            ]
            moments = np.concatenate([self.times, times])
            # readings are counted by the rows of the file, a clock has a column
            clock = [] if drift.is_counted else [f"{moment:.6f}" for moment in moments]
            rows = [[*rows[k], *clock[k : k + 1]] for k in np.argsort(moments, kind="stable").tolist()]
            headings += ["fixed", *(["time [s]"] if clock else [])]
        return csv_text(headings, rows, comments)

    def to_cycles(self, cycles: int, comments: Sequence[str] = ()) -> str:
        """Return the file that ``iso9283 --measured`` reads, if each pose was read ``cycles`` times in a row."""
        names = [f"P{rank}" for rank in range(1, self.q.shape[1] // cycles + 1)]
        return cycles_csv(names, cycles, self.measurement.kind, self.values, comments)


def simulate(
    model: ErrorModel,
    poses: object,
    measurement: Measurement | None = None,
    *,
    unit: int = 0,
    cycles: int = 1,
    seed: int = 0,
) -> Readings:
    """Return readings of one sampled robot, with the noise of the instrument: a rehearsal without a robot.

    The robot is one of those that :func:`precision_pin.monte_carlo` samples with the same seed: it has all its errors at
    each pose by the exact model. A pose given twice is visited twice.

    Args:
        model: Arm with its errors.
        poses: As for :func:`precision_pin.sample_poses`.
        measurement: The instrument; by default the sheet's.
        unit: Number of the robot.
        cycles: How often each pose is visited, one visit after the other.
        seed: 64-bit seed.

    Raises:
        InputError: Wrong poses or numbers, or no measurement.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> readings = pp.simulate(model, ["paper"], pp.Measurement(std="0.02 mm"), unit=3)
        >>> print(readings.values.shape)
        (1, 3)
    """
    instrument = measurement_of(model, measurement)
    model = model.bare
    check_whole("unit", unit, 0, 2**64 - 1, "from 0 to 2^64 - 1")
    check_whole("cycles", cycles, 1, MOST_VISITS)
    check_seed(seed)
    q, _ = model.configurations(poses)  # type: ignore[arg-type]
    approaches = model.approaches_of(poses, q)
    q = np.repeat(q, cycles, axis=1)
    approaches = None if approaches is None else np.repeat(approaches, cycles, axis=1)
    stations = stations_of(model, q, instrument, approaches)
    simulated = simulate_readings(stations, instrument, model, seed=seed, first=unit)[:, :, 0]
    values = as_measured(simulated, stations, instrument)
    if instrument.drift is None:
        return Readings(model, instrument, q, values)
    times, fixed_times, targets = instrument.drift.schedule(q.shape[1])
    generator = np.random.default_rng([seed, 2, unit])
    walk, white = instrument.drift.walk(np.concatenate([times, fixed_times]), generator), generator.standard_normal
    places = generator.uniform(-1, 1, (instrument.drift.fixed, 3))[targets]
    roots = np.linalg.cholesky(instrument.point_covariances(places))
    values[:, :3] += walk[: times.size]
    fixed = places + walk[times.size :] + np.einsum("fij,fj->fi", roots, white(places.shape))
    return Readings(model, instrument, q, values, times, (fixed_times, targets, fixed))


def as_measured(readings: Array, stations: tuple[Station, ...], measurement: Measurement) -> Array:
    """Return readings ``(P, m)`` of one robot as an instrument gives them, in the axes of a known base: whole attitudes."""
    if measurement.kind != "pose":
        return readings
    result = readings.copy()
    for station in stations:
        rows = list(station.rows)
        rotations = np.einsum("ijn,jk->ikn", se3.exp_rotation(readings[rows, 3:].T), station.at.posture.pose[:3, :3])
        result[rows, 3:] = se3.log_rotation(rotations).T
    return result


def with_later_draws(model: ErrorModel, x: Array, seed: int, pose: int, visit: int = 0, first: int = 0) -> Array:
    """Return component values ``(d, N)`` of the same robots at another pose and visit."""
    if all(draw.scope is Scope.UNIT for draw in model.space.draws):
        return x
    return model.space.sample(seed, first, x.shape[1], pose=pose, visit=visit)


def _rows(chain: Chain, q: Array, kind: str, readings: Array, std: float | None) -> tuple[list[str], list[list[str]]]:
    """Return headings and rows of readings ``(P, m)`` (m, rad; ``std`` in m) of one robot, as ``calibrate`` reads them."""
    headings, columns = joint_cells(chain, q)
    value_columns, values = _readings(COLUMNS[kind], readings)
    if std is not None:
        value_columns.append("std [mm]")
        values.append([f"{1e3 * std:.6f}"] * len(readings))
    return [*headings, *value_columns], [*map(list, zip(*columns, *values, strict=True))]


def cycles_csv(names: Sequence[str], cycles: int, kind: str, readings: Array, comments: Sequence[str]) -> str:
    """Return measured cycles as ``iso9283 --measured`` reads them.

    The readings ``(P·n, m)``, m and rad, of kind ``"position"`` or ``"pose"``, are all cycles of one pose after
    another.
    """
    value_columns, values = _readings(COLUMNS[kind], readings)
    visits = [(name, str(cycle)) for name in names for cycle in range(1, cycles + 1)]
    rows = zip(visits, *values, strict=True)
    return csv_text(["pose", "cycle", *value_columns], ((*visit, *cells) for visit, *cells in rows), comments)


def joint_cells(chain: Chain, q: Array) -> tuple[list[str], list[list[str]]]:
    """Return headings with units, and the columns of joint values ``(n, P)``."""
    columns = joint_columns(chain.joint_names, chain.prismatic)
    # 1e-12 degrees: the rounding of a conversion from degrees and back
    values = [(row / column.factor).tolist() for column, row in zip(columns, q, strict=True)]
    return [column.heading for column in columns], [[repr(round(value, 12)) for value in row] for row in values]


def _readings(names: Sequence[str], readings: Array) -> tuple[list[str], list[list[str]]]:
    """Return headings with units, and the columns of the readings, to 1 nm and 1 nrad."""
    headings = [f"{name} [{'mrad' if name.startswith('r') else 'mm'}]" for name in names]
    return headings, [[f"{value:.6f}" for value in column] for column in (1e3 * readings.T).tolist()]
