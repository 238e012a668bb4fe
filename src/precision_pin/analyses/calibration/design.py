"""Normal equations of measurements: stacked derivatives by the unit-scope numbers of a model.

Numbers drawn once for each robot are ``x = μ + L z`` with z of unit covariance, so that the prior information on z is
the identity. Readings are divided by the root of their noise

    R = diag(σ²) + H_e (K_v Σ_v K_vᵀ) H_eᵀ  of each visit, + H_e (K_p Σ_p K_pᵀ) H_eᵀ  common to the visits of one pose,

where K are the slopes of the tip's error by visit- and pose-scope numbers. What the nuisances could explain is
projected out; the rest is the information on z.

Also, which combinations of a model's numbers measurements can tell apart. The readings' derivatives by the numbers,
each in prior standard deviations, have a null space: the combinations that no reading sees. A basis of it is arbitrary;
its projector P is not. A number k with ``P_kk`` = 0 is determined by itself, one with ``P_kk`` = 1 is not seen at all.
All others fall into groups between which P has no entries: of n numbers in a group, some combinations are determined
and the rest are not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from itertools import compress
from typing import ClassVar, Final, NamedTuple, ParamSpec, TypeVar

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from threadpoolctl import threadpool_limits

from precision_pin.analyses.calibration.data import CalibrationData
from precision_pin.analyses.calibration.drift import Remainder, drift_ahead
from precision_pin.analyses.calibration.noise import Reduction
from precision_pin.analyses.readings import Station, each_station, measurement_of, stations_of
from precision_pin.base import se3
from precision_pin.base.arguments import check_instance
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError, some
from precision_pin.base.units import Quantity
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sheet.measurement import Anchor, Measurement, Plane, Slopes, Sockets

Given = ParamSpec("Given")
Returned = TypeVar("Returned")


def on_one_thread(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Run a function with one thread of BLAS: with more, small matrices take several times as long."""

    @wraps(function)
    def run(*args: Given.args, **kwargs: Given.kwargs) -> Returned:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return run


NEGLIGIBLE: Final = 1e-9
"""Singular value, relative to the largest, below which a combination of numbers changes no reading."""


@dataclass(frozen=True, eq=False)
class UnitNumbers:
    """Varying numbers drawn once for each robot: U columns of the space, prior means and deviations ``(U,)``, and L.

    ``root`` is L, ``(U, r)``: ``x = mean + L z``; ``quantities`` are what the numbers are of, ``None`` if unknown.
    """

    columns: NDArray[np.intp]
    names: tuple[str, ...]
    mean: Array
    std: Array
    root: Array
    quantities: tuple[Quantity | None, ...] = ()

    @classmethod
    def of(cls, space: Space) -> UnitNumbers:
        """Return the numbers of a space; raise if nothing varies from robot to robot."""
        columns = np.flatnonzero(space.has_scope(Scope.UNIT))
        std = np.sqrt(space.block_covariance.variances[columns])
        columns, std = columns[std > 0], std[std > 0]
        if not columns.size:
            raise InputError("nothing varies from robot to robot (scope unit), so that there is nothing to calibrate")
        correlation = space.block_covariance.within(columns) / np.outer(std, std)
        np.fill_diagonal(correlation, 1.0)
        if np.array_equal(correlation, np.eye(columns.size)):
            root = np.diag(std)
        else:
            values, vectors = np.linalg.eigh(correlation)
            is_kept = values > NEGLIGIBLE * values[-1]
            root = std[:, None] * (vectors[:, is_kept] * np.sqrt(values[is_kept]))
        quantities = [quantity for draw in space.draws for quantity in draw.known_quantities]
        names = tuple(space.components[k] for k in columns)
        return cls(columns, names, space.mean[columns], std, root, tuple(quantities[k] for k in columns))

    @cached_property
    def is_independent(self) -> bool:
        """True if the numbers are uncorrelated, so that L is diagonal."""
        return np.array_equal(self.root, np.diag(self.std))

    def values(self, z: Array) -> Array:
        """Return x for z ``(r, …)``."""
        mean = self.mean if z.ndim == 1 else self.mean[:, None]
        return np.asarray(mean + self.root @ z)

    def components(self, space: Space, z: Array) -> Array:
        """Return all components ``(d, N)`` for z ``(r, N)``, those of other scopes at their means."""
        x = np.repeat(space.mean[:, None], z.shape[1], axis=1)
        x[self.columns] = self.values(z)
        return x


def scope_covariances(space: Space, scope: Scope, jacobians: Array) -> Array:
    """Return the covariances ``(N, 6, 6)`` of the tip's error by the numbers of a scope, for derivatives ``(N, 6, d)``."""
    columns = np.flatnonzero(space.has_scope(scope))
    slopes = jacobians[:, :, columns]
    return np.asarray(slopes @ space.block_covariance.within(columns) @ slopes.swapaxes(1, 2))


def read_poses(model: ErrorModel, poses: object) -> tuple[Array, tuple[str, ...]]:
    """Return joint values ``(n, P)`` and names of poses: a list, an array ``(n, P)``, a mapping or a pose set."""
    check_instance("model", model, ErrorModel, "as ErrorModel.load returns it")
    if isinstance(poses, PoseSet):
        if not poses.known.all():
            raise InputError(f"{int((~poses.known).sum())} poses are not reached; omit them")
        return poses.q, poses.names
    values, names = model.configurations(poses)  # type: ignore[arg-type]
    if not values.shape[1]:
        raise InputError("no poses; give at least one")
    return values, names


class ReadingsAhead(NamedTuple):
    """Whitened derivatives of readings that are to be taken, each number as if read alone.

    By z ``(P, m, r)``, by nuisances ``(P, m, k)``, and by a shift of the instrument's axes at this reading ``(P, m, 3)``; with
    the measurement, whose standard deviations are ``factor`` times as large.
    """

    by_z: Array
    by_nuisance: Array
    by_shift: Array
    measurement: Measurement
    factor: float

    def _left(self, count: int) -> Remainder | None:
        """Return what will remain of the instrument's drift in so many readings; ``None`` if it does not drift."""
        drift, std = self.measurement.drift, self.factor * self.measurement.std
        return None if drift is None else drift_ahead(drift, count, std, is_free=self.measurement.base == "free")

    def taken(self, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return the derivatives ``(M, r)`` and ``(M, k)`` where some readings are taken in this order, with the drift then."""
        if (left := self._left(len(rows))) is None:
            return flat(self.by_z[rows]), flat(self.by_nuisance[rows])
        by_z, by_nuisance, by_shift = self._scattered(rows, left.steps.own)
        columns = [flat(stack) for stack in (by_shift @ left.steps.factors, by_nuisance, by_z)]
        reduction = Reduction.of([np.hstack(columns)], columns[0].shape[1], columns[1].shape[1])
        return reduction.rows[:, reduction.nuisances :], reduction.by_nuisance

    def apart(self, count: int) -> tuple[Array, Array]:
        """Return the stacks ``(P, m, r)`` and ``(P, m, k)`` as if the drift were of each reading alone.

        Its variance is the mean of what fixed targets leave in so many readings.
        """
        if (left := self._left(count)) is None:
            return self.by_z, self.by_nuisance
        variance = float((left.std**2).mean())
        by_z, by_nuisance, _ = self._scattered(np.arange(len(self.by_z)), np.full(len(self.by_z), variance))
        return by_z, by_nuisance

    def _scattered(self, rows: NDArray[np.intp], variances: Array) -> tuple[Array, Array, Array]:
        """Return the stacks of some readings, each with a further variance ``(R,)`` along each axis."""
        stacks = self.by_z[rows], self.by_nuisance[rows], self.by_shift[rows]
        more = variances[:, None, None] * stacks[2] @ stacks[2].swapaxes(1, 2)
        roots = np.linalg.cholesky(np.eye(more.shape[1]) + more)
        by_z, by_nuisance, by_shift = (np.linalg.solve(roots, stack) for stack in stacks)
        return by_z, by_nuisance, by_shift


def stack_at_means(
    stations: Sequence[Station], unit: UnitNumbers, measurement: Measurement, factor: float = 1.0
) -> ReadingsAhead:
    """Return the whitened derivatives of all readings at the means.

    The standard deviations of the readings are the instrument's times ``factor``.
    """
    count = sum(len(station.rows) for station in stations)
    by_z, points = np.zeros((count, measurement.size, unit.root.shape[1])), np.zeros((count, measurement.size))
    by_nuisance = np.zeros((count, measurement.size, len(measurement.nuisances)))
    by_shift = np.zeros((count, measurement.size, 3))
    zero = np.zeros(len(measurement.nuisances))
    for station in stations:
        rows = list(station.rows)
        pose, error = station.at.posture.pose, station.at.error_at_means
        slopes = measurement.slopes(pose, error, zero)
        points[rows] = measurement.predict(pose, error[:, None], zero[:, None])[:, 0]
        derivatives = np.hstack([slopes.error @ station.at.jacobian[:, unit.columns] @ unit.root, slopes.nuisances])
        root = root_ahead(station, measurement, slopes.error, factor)
        white = scipy.linalg.solve_triangular(root, np.tile(derivatives, (len(rows), 1)), lower=True)
        parts = np.split(white.reshape(len(rows), measurement.size, -1), [unit.root.shape[1]], axis=2)
        by_z[rows], by_nuisance[rows] = parts
        by_shift[rows] = _shifts(root, len(rows), measurement.size)
    single_part, deviations = np.zeros(count, dtype=np.intp), np.full(count, factor * measurement.std)
    unseen = Instruments((measurement,)).unseen_turns(single_part, points, deviations)
    return ReadingsAhead(by_z, without(by_nuisance, unseen), by_shift, measurement, factor)


def root_ahead(station: Station, measurement: Measurement, by_error: Array, factor: float = 1.0) -> Array:
    """Return the root of the noise of readings to be taken at a station, each at a visit of its own.

    ``by_error`` ``(m, 6)`` are the derivatives of a reading by the tip's error; deviations are the instrument's times
    ``factor``.
    """
    count = len(station.rows)
    instrument: Array = factor**2 * measurement.covariance(station.at.posture.pose)
    visits = np.repeat(np.arange(count), measurement.size)
    return station.noise_root(np.tile(by_error, (count, 1)), scipy.linalg.block_diag(*[instrument] * count), visits)


def _shifts(root: Array, readings: int, size: int) -> Array:
    """Return the whitened derivatives ``(R, m, 3)`` of readings at one pose by a shift of the axes at each."""
    inverse = scipy.linalg.solve_triangular(root, np.eye(len(root)), lower=True)
    blocks = inverse.reshape(readings, size, readings, size)[np.arange(readings), :, np.arange(readings)]
    return blocks @ np.eye(size, 3)


def without(derivatives: Array, unseen: Array) -> Array:
    """Return derivatives ``(…, k)`` without combinations ``(k, f)``, an orthonormal basis."""
    return derivatives - derivatives @ unseen @ unseen.T if unseen.size else derivatives


def basis_of(by_nuisance: Array) -> Array:
    """Return an orthonormal basis ``(M, rank)`` of what nuisances ``(M, k)`` explain."""
    return basis_by_columns(by_nuisance)[0]


def basis_by_columns(by_nuisance: Array) -> tuple[Array, Array]:
    """Return the basis of :func:`basis_of`, and its coefficients by the nuisances, ``(k, rank)``."""
    if not by_nuisance.shape[1]:
        return by_nuisance, np.zeros((0, 0))
    lengths = _lengths(by_nuisance)
    basis, values, rows = np.linalg.svd(by_nuisance / lengths, full_matrices=False)
    rank = int((values > NEGLIGIBLE * values[0]).sum())
    return basis[:, :rank], rows[:rank].T / values[:rank] / lengths[:, None]


def beside(columns: Array, basis: Array) -> Array:
    """Return columns ``(M, c)`` without their part in an orthonormal basis ``(M, b)``."""
    # projected twice, to remove the rounding of the first projection
    for _ in range(2):
        columns = columns - basis @ (basis.T @ columns)
    return columns


def _lengths(columns: Array) -> Array:
    lengths = np.linalg.norm(columns, axis=0)
    return np.where(lengths > 0, lengths, 1.0)


def set_up_of(by_nuisance: Array, readings: Array) -> Array:
    """Return the nuisances ``(k,)`` of minimum norm that explain whitened readings ``(M,)``.

    Combinations that the readings do not determine to 1 m or 1 rad, such as the height of a target that hardly tilts, are zero.
    """
    cutoff = 1 / max(1.0, float(np.linalg.norm(by_nuisance, 2)))
    return np.asarray(np.linalg.lstsq(by_nuisance, readings, rcond=max(cutoff, NEGLIGIBLE))[0])


def flat(stack: Array) -> Array:
    """Return ``(P, m, n)`` as ``(P m, n)``."""
    return stack.reshape(stack.shape[0] * stack.shape[1], stack.shape[2])


MOST_GROSS: Final = 0.2
"""Fraction of readings beyond which the model is wrong, rather than the readings."""
WEAKEST: Final = 1.0
"""Factor by which readings must beat a combination's tolerance for it to be estimated without a prior."""


@dataclass(frozen=True, eq=False)
class Estimator:
    """The linear estimate of z and the nuisances from whitened readings with derivatives ``(M, r)`` and ``(M, k)``.

    By orthogonal factors: the normal equations of precise readings and broad tolerances would lose half of the digits.

    Attributes:
        nuisance_basis: Orthonormal basis of what the determined nuisances explain, ``(M, rank)``.
        left, inverse: Factors ``(M, b)`` and ``(r, b)`` of the estimate at z = 0, ``inverse leftᵀ residuals``.
        covariance, basis: Of z after the measurements, ``(r, r)``, with a prior ``(I + Hᵀ(1 - P)H)⁻¹``, P the projector of
            the nuisances (K2); and a basis of the combinations estimated, ``(r, basis)``; all with a prior.
    """

    by_z: Array
    by_nuisance: Array
    nuisance_basis: Array
    left: Array
    inverse: Array
    covariance: Array
    basis: Array
    has_prior: bool

    @classmethod
    def of(cls, by_z: Array, by_nuisance: Array, *, has_prior: bool, basis: Array | None = None) -> Estimator:
        """Return the estimator of whitened derivatives; without a prior, of the combinations ``basis`` (default: determined)."""
        nuisance_basis = basis_of(by_nuisance)
        projected, unit = beside(by_z, nuisance_basis), np.eye(by_z.shape[1])
        if has_prior:
            basis, rows = unit, np.vstack([projected, unit])
        else:
            if basis is None:
                triangle = np.linalg.qr(projected, mode="r") if len(projected) > projected.shape[1] else projected
                _, values, directions = np.linalg.svd(triangle, full_matrices=True)
                basis = directions[: int((values > WEAKEST).sum())].T
            rows = projected @ basis
        orthogonal, triangle = np.linalg.qr(rows)
        left, values, right = np.linalg.svd(triangle, full_matrices=False)
        is_determined = values > 1e-12 * values.max(initial=0.0)
        inverse = basis @ (right.T / np.where(is_determined, values, 1.0))[:, is_determined]
        # combinations that the readings do not determine keep their prior
        covariance = inverse @ inverse.T + unit - basis @ basis.T
        left = orthogonal[: len(by_z)] @ left[:, is_determined]
        return cls(by_z, by_nuisance, nuisance_basis, left, inverse, covariance, basis, has_prior)

    @property
    def nuisance_rank(self) -> int:
        """Number of nuisances, or combinations, that are determined."""
        return self.nuisance_basis.shape[1]

    def estimate(self, residuals: Array, z: Array, low: Array | None = None, high: Array | None = None) -> Array:
        """Return z ``(r, …)`` for whitened residuals ``(M, …)`` at a given z, within bounds ``(r,)`` if given."""
        # leftᵀ by_z by the factors, so that rounding does not move what the readings do not see
        triangle = np.linalg.pinv(self.inverse)
        of_z = triangle - self.inverse.T if self.has_prior else triangle
        pulled = self.left.T @ residuals + of_z @ z
        unbounded = np.asarray(self.inverse @ pulled)
        if low is None or high is None or not self.has_prior or ((unbounded >= low) & (unbounded <= high)).all():
            return unbounded
        # BVLS is exact at the bounds, and the problem is small
        return np.asarray(scipy.optimize.lsq_linear(triangle, pulled, (low, high), method="bvls", tol=1e-14).x)

    def nuisances(self, readings: Array) -> Array:
        """Return the nuisances ``(k,)`` of minimum norm that explain whitened readings ``(M,)`` without the part of z."""
        if not self.by_nuisance.shape[1]:
            return np.zeros(0)
        return set_up_of(self.by_nuisance, readings)

    def leverage_root(self) -> Array:
        """Return Q ``(M, k + r)``, with fitted = Q Qᵀ readings, both whitened."""
        return np.hstack([self.nuisance_basis, self.left])

    @property
    def root_by_columns(self) -> Array:
        """Coefficients ``(k + r, n)`` with which the derivatives by nuisances and z are :meth:`leverage_root`."""
        coefficients = basis_by_columns(self.by_nuisance)[1]
        of_left = -coefficients @ (self.nuisance_basis.T @ self.by_z) @ self.inverse
        zeros = np.zeros((len(self.inverse), coefficients.shape[1]))
        return np.block([[coefficients, of_left], [zeros, self.inverse]])

    @cached_property
    def joint_covariance(self) -> Array:
        """Covariance of z and the nuisances together, ``(r + k, r + k)``, as far as nuisances are determined."""
        inverse = np.linalg.pinv(self.by_nuisance, rcond=1e-12) if self.by_nuisance.size else self.by_nuisance.T
        through = inverse @ self.by_z
        cross = -self.covariance @ through.T
        nuisance_covariance = inverse @ inverse.T + through @ self.covariance @ through.T
        return np.block([[self.covariance, cross], [cross.T, nuisance_covariance]])


def task_poses(model: ErrorModel, at: object, measured_q: Array) -> list[tuple[str, PoseModel]]:
    """Return names and models of the user's own poses: those given, the model's named ones, or the measured ones."""
    if at is not None:
        values, names = read_poses(model, at)
    elif model.poses:
        values, names = np.array(list(model.poses.values())).T, tuple(model.poses)
    else:
        values, names = measured_q, ("",) * measured_q.shape[1]
    labels = [name or f"pose {k + 1}" for k, name in enumerate(names)]
    return list(zip(labels, model.at_columns(np.ascontiguousarray(values)), strict=True))


_ENTRY: Final = 1e-6
"""Entry of a projector that counts as zero."""
_MOST_NAMED: Final = 4
"""Maximum number of numbers or combinations that a message names."""


@dataclass(frozen=True)
class Combination(Record):
    """A weighted sum of numbers in prior standard deviations; the squared weights add up to 1."""

    KEYS: ClassVar[Keys] = ("*weight_by_name",)

    names: tuple[str, ...]
    weights: tuple[float, ...]

    @property
    def weight_by_name(self) -> dict[str, float]:
        """The weight of each number."""
        return dict(zip(self.names, self.weights, strict=True))

    def __str__(self) -> str:
        return " ".join(f"{weight:+.3g}·{name}" for name, weight in self.weight_by_name.items())


@dataclass(frozen=True)
class Group(Record):
    """Numbers with only some combinations determined, and the unseen combination if there is only one."""

    names: tuple[str, ...]
    determined: int
    unseen: Combination | None

    def __str__(self) -> str:
        return self.described(len(self.names))

    def described(self, most: int) -> str:
        """Return the group as text with at most so many names."""
        text = f"{self.determined} of {len(self.names)} combinations of {some(self.names, most)}"
        return text if self.unseen is None or most < len(self.names) else f"{text} (not seen: {self.unseen})"


@dataclass(frozen=True, eq=False)
class Identifiability(Record):
    """Identifiability of a model's U numbers that are drawn once per robot.

    Attributes:
        rank, singular_values: Number of independent combinations determined, and the singular values of the
            derivatives, in units of noise and of prior standard deviation, falling.
        projector: Onto the combinations that no reading sees, ``(U, U)``, in units of prior standard deviation.
        nuisances, nuisance_rank: Unknown numbers of the set-up, and how many combinations of them are determined.
        set_up_projector: Onto the combinations of these that no reading sees, ``(k, k)``, in m and rad.
        observability: O1 to O5 of the determined combinations.
    """

    KEYS: ClassVar[Keys] = (
        *("rank", "parameters", "singular_values", "determined", "unseen", "combinations"),
        *("nuisances", "nuisance_rank", "set_up_combinations", "observability"),
    )

    names: tuple[str, ...]
    rank: int
    singular_values: Array
    projector: Array
    nuisances: tuple[str, ...]
    nuisance_rank: int
    set_up_projector: Array
    observability: dict[str, float]

    @property
    def parameters(self) -> int:
        """Number of numbers, U."""
        return len(self.names)

    @property
    def determined(self) -> tuple[str, ...]:
        """Numbers that are determined each by itself."""
        return tuple(compress(self.names, np.diag(self.projector) <= _ENTRY))

    @property
    def unseen(self) -> tuple[str, ...]:
        """Numbers that no reading sees."""
        return tuple(compress(self.names, np.diag(self.projector) >= 1 - _ENTRY))

    @property
    def combinations(self) -> tuple[Group, ...]:
        """Groups of numbers with only combinations determined."""
        return subspaces(self.names, self.projector)

    @property
    def set_up_combinations(self) -> tuple[Group, ...]:
        """Groups of numbers of the set-up with only combinations determined, in m and rad."""
        return subspaces(self.nuisances, self.set_up_projector)

    @property
    def set_up_unseen(self) -> str:
        """Description of the unseen part of the set-up: a rotation of the base about an axis, else combinations."""
        vector = np.linalg.eigh(self.set_up_projector)[1][:, -1]
        shift, tilt = vector[:3], vector[3:6]
        is_one = (
            len(self.nuisances) - self.nuisance_rank == 1 and self.nuisances[3:4] and "base.rx" in self.nuisances[3]
        )
        if is_one and np.abs(vector[6:]).max(initial=0.0) < _ENTRY and abs(shift @ tilt) < _ENTRY < float(tilt @ tilt):
            axis = tilt / np.linalg.norm(tilt) * np.sign(tilt[int(np.argmax(np.abs(tilt).round(9)))])
            line = 1e3 * np.cross(tilt, shift) / (tilt @ tilt), axis
            place, along = (" ".join(f"{x + 0.0:.4g}" for x in values.round(4)) for values in line)
            return f"a turn of the base about the line through {place} mm along {along}"
        single_names = compress(self.nuisances, np.diag(self.set_up_projector) >= 1 - _ENTRY)
        return some((*single_names, *(f"{group} (m, rad)" for group in self.set_up_combinations)), _MOST_NAMED, "; ")

    @property
    def is_complete(self) -> bool:
        """Whether the readings determine every number, of the model and of the set-up."""
        return self.rank == len(self.names) and self.nuisance_rank == len(self.nuisances)


def identifiability(model: ErrorModel, poses: object, measurement: Measurement | None = None) -> Identifiability:
    """Return the combinations of a model's unit-scope numbers that measurements at some poses determine.

    First order, at the numbers' means.

    Args:
        model: The model; :func:`precision_pin.every_frame` returns one with all geometric errors.
        poses: A list of poses, an array ``(n, P)``, a mapping of joint values or a
            :class:`~precision_pin.robot.pose_set.PoseSet`.
        measurement: Instrument and set-up; by default the sheet's.

    Raises:
        InputError: Nothing varies from robot to robot, or the poses are wrong.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> q = np.random.default_rng(0).uniform(-2, 2, (4, 30))
        >>> seen = pp.identifiability(model, q, pp.Measurement("position", target="50 30 20 mm"))
        >>> print(seen.rank, len(seen.names))
        21 26
    """
    measurement = measurement_of(model, measurement)
    model = model.bare
    values, _ = read_poses(model, poses)
    unit = UnitNumbers.of(model.space)
    return determined_by(stations_of(model, values, measurement), unit, measurement)


def determined_by(stations: Sequence[Station], unit: UnitNumbers, measurement: Measurement) -> Identifiability:
    """Return the identifiability from readings at some stations, at the means."""
    # a number determined by another forms a combination too: columns are numbers, not independent ones
    plain = replace(unit, root=np.diag(unit.std))
    by_number, by_nuisance, *_ = stack_at_means(stations, plain, measurement)
    return of_stack(unit.names, flat(by_number), flat(by_nuisance), measurement.nuisances, len(by_number))


def of_stack(
    names: tuple[str, ...], by_z: Array, by_nuisance: Array, nuisances: tuple[str, ...], poses: int
) -> Identifiability:
    """Return the identifiability from whitened derivatives ``(M, U)`` and ``(M, k)``."""
    nuisance_basis = basis_of(by_nuisance)
    projected, nuisance_rank = beside(by_z, nuisance_basis), nuisance_basis.shape[1]
    if len(projected) > projected.shape[1]:
        _, projected = np.linalg.qr(projected)
    _, singular_values, rows = np.linalg.svd(projected, full_matrices=True)
    scale = float(np.linalg.norm(by_z, 2))
    rank = int((singular_values > NEGLIGIBLE * scale).sum())
    null = rows[rank:]
    values = np.zeros(len(names))
    values[: singular_values.size] = singular_values
    lengths, unseen = _lengths(by_nuisance), np.zeros((len(nuisances), 0))
    if nuisance_rank < len(nuisances):
        triangle = np.linalg.qr(by_nuisance / lengths, mode="r")
        unseen = np.linalg.qr(scipy.linalg.null_space(triangle, rcond=NEGLIGIBLE) / lengths[:, None])[0]
    parts = names, rank, values, null.T @ null, nuisances, nuisance_rank, unseen @ unseen.T
    return Identifiability(*parts, observability(singular_values[:rank], poses))


def check_identifiable(result: Identifiability) -> None:
    """Raise if readings determine no combination of the arm's numbers."""
    if not result.rank:
        hint = ", or with the base known" if any(name.startswith("base") for name in result.nuisances) else ""
        raise InputError(
            "no reading sees any number that varies from robot to robot: there is nothing to estimate; "
            f"measure at other poses, under another load, with another instrument{hint}"
        )


def identifiability_warnings(result: Identifiability) -> Iterator[Finding]:
    """Yield warnings about numbers that the readings do not determine."""
    if result.nuisance_rank < len(result.nuisances):
        message = (
            f"the poses determine {result.nuisance_rank} of the {len(result.nuisances)} unknown numbers of the set-up "
            f"({', '.join(result.nuisances)}); not seen: {result.set_up_unseen}, which errors in the instrument's axes leave "
            "out; add poses that differ more"
        )
        yield Finding("warning", "W_SETUP", message)
    if not result.rank:
        message = (
            "no reading sees any number that varies from robot to robot; measure at other poses or another quantity"
        )
        yield Finding("warning", "W_UNOBSERVABLE", message)
    elif result.unseen:
        keeps = "they keep their tolerances" if len(result.unseen) > 1 else "it keeps its tolerance"
        yield Finding("warning", "W_UNOBSERVABLE", f"no reading sees {some(result.unseen, 3)}; {keeps}")


def rank_findings(result: Identifiability) -> Iterator[Finding]:
    """Yield a warning if the readings do not determine every number, as a fit without a prior needs."""
    if result.is_complete:
        return
    groups = [str(group) for group in result.combinations]
    parts = [f"not seen at all: {some(result.unseen, _MOST_NAMED)}"] if result.unseen else []
    parts += [f"only {some(groups, _MOST_NAMED, '; only ')}"] if groups else []
    if result.nuisance_rank < len(result.nuisances):
        parts.append(
            f"{result.nuisance_rank} of the {len(result.nuisances)} numbers of the set-up ({some(result.nuisances, _MOST_NAMED)})"
        )
    message = (
        f"without a prior, the readings determine {result.rank:,} combinations of {len(result.names):,} numbers: "
        f"{'; '.join(parts)}; measure other poses, hold these numbers fixed, or keep the prior"
    )
    yield Finding("warning", "W_RANK", message)


def observability(singular_values: Array, poses: int) -> dict[str, float]:
    """Return the observability indices O1 to O5 (Sun, Hollerbach 2008) of singular values in prior std and noise."""
    s = np.sort(singular_values)[::-1]
    indices = (0.0,) * 5
    if s.size and poses:
        indices = (np.exp(np.log(s).mean()) / np.sqrt(poses), s[-1] / s[0], s[-1], s[-1] ** 2 / s[0], 1 / (1 / s).sum())
    return {f"O{k}": float(value) for k, value in enumerate(indices, 1)}


def subspaces(names: Sequence[str], projector: Array) -> tuple[Group, ...]:
    """Return the groups of numbers with only combinations determined, from the projector on what is not seen."""
    weights = np.diag(projector)
    mixed = np.flatnonzero((weights > _ENTRY) & (weights < 1 - _ENTRY))
    if not mixed.size:
        return ()
    within = projector[np.ix_(mixed, mixed)]
    count, labels = connected_components(csr_array(np.abs(within) > _ENTRY), directed=False)
    groups = (mixed[labels == k] for k in range(count))
    return tuple(_group(tuple(names[k] for k in group), projector[np.ix_(group, group)]) for group in groups)


def _group(names: tuple[str, ...], block: Array) -> Group:
    values, vectors = np.linalg.eigh(block)
    nullity, weights = int((values > 0.5).sum()), vectors[:, -1]
    weights = weights * np.sign(weights[int(np.argmax(np.abs(weights).round(9)))])
    return Group(names, len(names) - nullity, Combination(names, tuple(weights.tolist())) if nullity == 1 else None)


@dataclass(frozen=True, eq=False)
class Instruments:
    """Measurements whose unknown numbers (nuisances) are shared where they have one name; one measurement or many.

    Raises:
        InputError: One name stands for different targets or places.
    """

    parts: tuple[Measurement, ...]

    def __post_init__(self) -> None:
        owners: dict[str, Measurement] = {}
        for part in self.parts:
            target = "target" + (f"[{part.target_name}]" if part.target_name else "")
            for name in (*part.nuisances, f"{target}.x"):
                owner = owners.setdefault(name, part)
                key, is_same = "base_name", part.place == owner.place
                if name.startswith("target"):
                    key, is_same = "target_name", part.target_known == owner.target_known
                    is_same &= part.target_known or part.target == owner.target
                if not is_same:
                    raise InputError(
                        f"two measurements share {name.partition('.')[0]} and say different things of it; "
                        f"give each {key} of its own"
                    )

    @cached_property
    def nuisances(self) -> tuple[str, ...]:
        """Names of all unknown numbers of the set-up, bases first."""
        names = dict.fromkeys(name for part in self.parts for name in part.nuisances)
        return tuple(sorted(names, key=lambda name: not name.startswith("base")))

    @cached_property
    def columns(self) -> tuple[NDArray[np.intp], ...]:
        """Nuisance columns of each measurement."""
        place = {name: k for k, name in enumerate(self.nuisances)}
        return tuple(np.array([place[name] for name in part.nuisances], dtype=np.intp) for part in self.parts)

    def unseen_turns(self, part: NDArray[np.intp], points: Array, deviations: Array) -> Array:
        """Return an orthonormal basis ``(k, f)`` of the turns of bases that points ``(P, 3)`` of deviations ``(P,)`` do not tell.

        They are about a line or a place, base axes, from which the points are less than two deviations away (root mean
        square), as at a gauge's two sockets. The arm is not as near to them, which is no knowledge of the base.
        """
        names = [instrument.base_name if instrument.displaces_base else None for instrument in self.parts]
        rotations = [np.zeros((len(self.nuisances), 0))]
        for name in dict.fromkeys(names):
            sharing = [k for k, base_name in enumerate(names) if base_name == name]
            rows = np.isin(part, sharing)
            if name is None or not rows.any() or any(self.parts[k].kind == "pose" for k in sharing):
                continue
            centre = points[rows, :3].mean(axis=0)
            arms = (points[rows, :3] - centre) / deviations[rows, None]
            values, axes = np.linalg.eigh((arms**2).sum() * np.eye(3) - arms.T @ arms)
            axes = axes[:, values < 4 * len(arms)]
            columns = np.zeros((len(self.nuisances), axes.shape[1]))
            columns[self.columns[sharing[0]][:6]] = np.vstack([np.cross(centre, axes.T).T, axes])
            rotations.append(columns)
        return np.linalg.qr(np.hstack(rotations))[0]

    def slopes(self, part: int, pose: Array, error: Array, nuisances: Array) -> Slopes:
        """Return the derivatives of a reading as :meth:`Measurement.slopes`, by all nuisances."""
        part_slopes = self.parts[part].slopes(pose, error, nuisances[self.columns[part]])
        by_nuisance = np.zeros((self.parts[part].size, nuisances.size))
        by_nuisance[:, self.columns[part]] = part_slopes.nuisances
        return Slopes(part_slopes.error, by_nuisance)


def stations_of_data(model: ErrorModel, data: CalibrationData) -> Iterator[Station]:
    """Yield a station for each different pose and load."""
    loads = [part.load for part in data.measurements]
    load_of_row = np.array([loads.index(load) for load in loads])[data.part]
    for k in np.unique(load_of_row).tolist():
        rows = np.flatnonzero(load_of_row == k)
        approaches = data.approaches[:, rows] if data.approaches.size else None
        for station in each_station(model, data.q[:, rows], data.measurements[k], approaches):
            yield Station(station.at, tuple(rows[list(station.rows)].tolist()))


@dataclass(frozen=True, eq=False)
class SetUp(Record):
    """Set-up of an instrument as estimated; what does not belong to the readings is ``None``.

    Attributes:
        base: The robot's base in the instrument's axes, ``(4, 4)``; ``None`` where it is known.
        target, anchor, plane, sockets: In tool axes, ``(3,)``; in base axes ``(3,)``, point and unit normal ``(2, 3)``,
            and ``(S, 3)``; m.
        std: Standard deviation of each unknown number, m and rad; infinite where readings determine combinations only.
        base_std: Standard deviations of the base's position and rotation vector in the instrument's axes, ``(6,)``, m and
            rad; infinite if any of them is.
    """

    KEYS: ClassVar[Keys] = ("base", "target", "anchor", "plane", "sockets", "std")

    base: Array | None
    target: Array
    anchor: Array | None
    plane: Array | None
    sockets: Array | None
    std: dict[str, float]
    base_std: Array

    @classmethod
    def of(cls, measurement: Measurement, base: Array, nuisances: Array, covariance: Array) -> SetUp:
        """Return the set-up from nuisances and their covariance, relative to a first guess of the base."""
        shift, rotation, target, _ = measurement.split(nuisances[:, None])
        anchor = fitted_base = plane = sockets = None
        base_std = np.full(6, np.inf)
        place, offset = measurement.place, shift[:, 0]
        if isinstance(place, Anchor):
            anchor = np.array(place.place) + offset
        elif isinstance(place, Plane):
            plane = np.array(place.tilted(offset))
        elif isinstance(place, Sockets):
            sockets = np.array(place.places) + offset.reshape(-1, 3)
        elif rotation is not None:
            fitted_base = base @ se3.displacement(nuisances[:6])
            if np.isfinite(covariance[:6, :6]).all():
                by_turn = se3.left_jacobian_inverse(se3.log_rotation(fitted_base[:3, :3])) @ base[:3, :3]
                slopes = scipy.linalg.block_diag(base[:3, :3], by_turn @ se3.left_jacobian(nuisances[3:6]))
                base_std = np.sqrt(np.maximum(np.diag(slopes @ covariance[:6, :6] @ slopes.T), 0.0))
        deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
        std = dict(zip(measurement.nuisances, deviations, strict=True))
        return cls(fitted_base, target[:, 0], anchor, plane, sockets, std, base_std)
