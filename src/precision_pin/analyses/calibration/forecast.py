"""Accuracy after a calibration, predicted before measuring, and calibrations of simulated robots as a check.

First order, at the numbers' means: after measuring, the unit-scope numbers have the covariance
``C = (Σ Hᵀ R⁻¹ H + Σ₀⁻¹)⁻¹`` with the nuisances of the set-up free, and the error left at a pose ``J C Jᵀ + K Σ Kᵀ``. The
second part, of pose- and visit-scope numbers, is the floor that no calibration removes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import compress
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
import scipy.linalg
from scipy import special

from precision_pin.analyses.calibration import design
from precision_pin.analyses.calibration.design import Estimator, Identifiability, UnitNumbers, scope_covariances
from precision_pin.analyses.calibration.noise import LEVEL
from precision_pin.analyses.number_law import NormalNorm
from precision_pin.analyses.provenance import Provenance
from precision_pin.analyses.readings import measurement_of, simulate_readings, stations_of, with_later_draws
from precision_pin.analyses.result import Outcome
from precision_pin.base.arguments import check_items, check_name, check_whole
from precision_pin.base.arrays import Array, Keys, Record
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.base.written_units import WrittenUnit
from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Law
from precision_pin.draws.laws.projection import Projection
from precision_pin.draws.space import Estimates, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel, Tables, of_one_layout
from precision_pin.render.html import preformatted
from precision_pin.robot.chain import Chain
from precision_pin.robot.pose_grids import random_poses
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sheet.measurement import Measurement
from precision_pin.statistics import quantile_ranks

ROBOTS: Final = 10_000
"""Robots sampled for the quantiles if a law is not normal."""

ERRORS: Final = ("before", "after", "seen", "floor")
"""Errors reported at a pose: before and after the calibration, after in the instrument's axes, and the floor."""
_SEED: Final = 0
"""Seed of the sampled robots, so that every forecast samples the same ones."""


@dataclass(frozen=True, eq=False)
class Posterior(Record):
    """Mean and covariance ``(U, U)`` of the numbers drawn once for each robot, and their prior means and deviations, SI."""

    KEYS: ClassVar[Keys] = ("names", "mean", "std", "prior_mean", "prior_std", "learned", "covariance")

    names: tuple[str, ...]
    mean: Mapping[str, float]
    covariance: Array
    prior_mean: Mapping[str, float]
    prior_std: Mapping[str, float]
    units: Mapping[str, WrittenUnit]
    """Display unit of each number."""

    @classmethod
    def of(cls, unit: UnitNumbers, mean: Array, covariance: Array) -> Posterior:
        """Return the posterior of the numbers of a space."""
        means, priors, std = (dict(zip(unit.names, a.tolist(), strict=True)) for a in (mean, unit.mean, unit.std))
        of = zip(unit.names, unit.quantities, unit.std.tolist(), strict=True)
        units = {name: WrittenUnit.suiting(quantity, [size]) for name, quantity, size in of}
        return cls(unit.names, means, covariance, priors, std, units)

    @cached_property
    def std(self) -> Mapping[str, float]:
        """Standard deviation of each number."""
        return dict(zip(self.names, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).tolist(), strict=True))

    @cached_property
    def learned(self) -> Mapping[str, float]:
        """Fraction of each number's prior variance that the measurements removed, 0 to 1."""
        return {name: float(np.clip(1 - (self.std[name] / self.prior_std[name]) ** 2, 0.0, 1.0)) for name in self.names}

    def covariance_of(self, one: str, other: str) -> float:
        """Return the covariance of two numbers, by name."""
        row, column = (self.names.index(check_name("component", name, self.names)) for name in (one, other))
        return float(self.covariance[row, column])


@dataclass(frozen=True, eq=False)
class ErrorLeft(Record):
    """The tip's error at a pose before and after a calibration, first order; base axes, m and rad.

    Attributes:
        name, q, sliding_joints: The pose, and the sliding joints, whose values are in m.
        before: Mean ``(6,)`` of the error before the calibration.
        covariance_before, covariance_after, covariance_seen: ``(6, 6)``; after it the error is that from the calibrated
            arm's own pose, of mean zero; seen: as of :meth:`Measurement.view_slopes`.
        floor: ``(6, 6)``, the part of pose- and visit-scope numbers, which no calibration removes.
        sampled: If a law is not normal: sorted sizes |d| and |δ| ``(2, N)`` of sampled robots' errors ``before``,
            ``after``, ``seen`` and ``floor``, to first order.
    """

    KEYS: ClassVar[Keys] = (
        *("name", "q", "*sizes", "mean_before=before"),
        *("covariance_before", "covariance_after", "covariance_seen", "covariance_floor=floor"),
    )

    name: str
    q: Mapping[str, float]
    sliding_joints: tuple[str, ...]
    before: Array
    covariance_before: Array
    covariance_after: Array
    covariance_seen: Array
    floor: Array
    sampled: Mapping[str, Array] = field(default_factory=dict, repr=False)

    def _normal(self, which: str, attitude: bool) -> tuple[Array, Array]:
        covariance = self.floor if which == "floor" else getattr(self, f"covariance_{which}")
        rows = slice(3, 6) if attitude else slice(0, 3)
        return self.before[rows] if which == "before" else np.zeros(3), covariance[rows, rows]

    def rms(self, which: str, *, attitude: bool = False) -> float:
        """Return the rms of the position (or attitude) error: ``before``, ``after``, ``seen`` or ``floor``."""
        mean, covariance = self._normal(which, attitude)
        return float(np.sqrt(max(np.trace(covariance), 0.0) + mean @ mean))

    def quantile(self, which: str, *, attitude: bool = False) -> float:
        """Return the 95 % quantile of |d| (or |δ|), of the normal error or of sampled robots.

        ``which`` is ``before``, ``after``, ``seen`` or ``floor``; robots are sampled if a law is not normal.
        """
        if self.sampled:
            return float(np.quantile(self.sampled[which][int(attitude)], LEVEL))
        mean, covariance = self._normal(which, attitude)
        if not covariance.any():
            return float(np.linalg.norm(mean))
        return float(NormalNorm(mean.copy(), covariance.copy()).quantile(LEVEL))

    def quantile_interval(self, which: str, *, attitude: bool = False) -> tuple[float, float] | None:
        """Return the distribution-free 95 % interval of a sampled :meth:`quantile`; None for a normal error."""
        if not self.sampled:
            return None
        sizes = self.sampled[which][int(attitude)]
        ranks = quantile_ranks(sizes.size, LEVEL, LEVEL)
        assert ranks is not None
        return float(sizes[ranks[0] - 1]), float(sizes[ranks[1] - 1])

    @property
    def sizes(self) -> dict[str, dict[str, Any]]:
        """Root mean squares and 95 % quantiles with their intervals, as in the JSON."""
        values: dict[str, Callable[..., Any]] = {
            "rms_{}": self.rms,
            "quantile_{}": self.quantile,
            "quantile_{}_interval": self.quantile_interval,
        }
        return {
            which: {
                key.format(name): value(which, attitude=name == "attitude")
                for name in ("position", "attitude")
                for key, value in values.items()
            }
            for which in ERRORS
        }


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PosesOutcome(Outcome):
    """Result with the remaining error at the user's poses."""

    measurement: Measurement
    identifiability: Identifiability
    poses: tuple[ErrorLeft, ...]

    @property
    def rank(self) -> int:
        """Number of independent combinations of the numbers that the readings determine."""
        return self.identifiability.rank

    @property
    def observability(self) -> dict[str, float]:
        """O1 to O5."""
        return self.identifiability.observability

    @cached_property
    def rms_position(self) -> dict[str, float]:
        """Root mean square position error over the user's poses: ``before``, ``after``, ``seen``, ``floor``."""
        return {which: float(np.sqrt(np.mean([entry.rms(which) ** 2 for entry in self.poses]))) for which in ERRORS}

    def _repr_html_(self) -> str:
        """Return the notebook view: the table of the command."""
        return preformatted(self._output("table:table")(self))


class SampledRobots(NamedTuple):
    """Robots with the laws of the sheet, each measured once, and the errors of their linear estimates.

    With C the covariance of z after measuring, the estimate leaves ``C z`` of z, and of the readings' noise a normal
    part with the covariance ``C - C²``: z enters with its law. ``deviations`` ``(d, N)`` are all numbers minus their
    means, ``z`` ``(r, N)`` those of unit scope in units of their root, ``errors`` ``(r + k, N)`` the rest of z and the
    nuisances' errors.
    """

    deviations: Array
    z: Array
    errors: Array

    @classmethod
    def of(cls, space: Space, unit: UnitNumbers, estimator: Estimator) -> SampledRobots | None:
        """Return the robots; None if all laws are normal, or no prior says how robots differ."""
        if not estimator.has_prior or all(draw.law.is_normal for draw in space.draws):
            return None
        deviations = space.sample(_SEED, 0, ROBOTS) - space.mean[:, None]
        z = np.linalg.pinv(unit.root) @ deviations[unit.columns]
        joint = estimator.joint_covariance
        through = joint[:, : len(z)]
        values, vectors = np.linalg.eigh(joint - through @ through.T)
        # symmetric, since rounding turns vectors of nearly equal values
        root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        noise = np.random.default_rng(_SEED).standard_normal((len(joint), ROBOTS))
        return cls(deviations, z, through @ z + root @ noise)

    def sizes(
        self, error: Array, jacobian: Array, unit: UnitNumbers, slopes: Array, later: tuple[Array, Array, Array]
    ) -> dict[str, Array]:
        """Return ``sampled`` of :class:`ErrorLeft`, given the derivatives by all numbers and by z.

        ``later`` are those after it: of the error by z, and of what is seen by the error, and by z and the nuisances.
        """
        repeated = np.delete(np.arange(len(self.deviations)), unit.columns)
        floor = jacobian[:, repeated] @ self.deviations[repeated]
        before = error[:, None] + slopes @ self.z + floor
        by_z, by_error, by_both = later
        after = by_z @ self.errors[: by_z.shape[1]] + floor
        seen = by_both @ self.errors[: by_both.shape[1]] + by_error @ floor
        errors = np.array([before, after, seen, floor]).reshape(4, 2, 3, -1)
        return dict(zip(ERRORS, np.sort(np.sqrt((errors**2).sum(axis=2)), axis=2), strict=True))


def errors_left(
    tasks: Iterable[tuple[str, PoseModel]],
    unit: UnitNumbers,
    estimator: Estimator,
    measurement: Measurement,
    space: Space,
    *,
    fitted: tuple[Array, Array] | None = None,
    is_sampled: bool = True,
) -> tuple[ErrorLeft, ...]:
    """Return the error at each named pose before and after; the first nuisances are those of the measurement.

    ``fitted`` are components ``(d,)`` and nuisances of the estimate (default: as in the sheet). Errors that are not normal are
    sampled, or else taken as normal.
    """
    robots, entries, named = SampledRobots.of(space, unit, estimator) if is_sampled else None, [], list(tasks)
    x, nuisances = (space.mean, np.zeros(len(measurement.nuisances))) if fitted is None else fitted
    nuisances = nuisances[: len(measurement.nuisances)]

    def tangents_of_poses() -> Iterator[tuple[Array, Array, Array, Array, Array]]:
        for chunk in of_one_layout(at for _, at in named):
            tables = Tables.of(chunk)
            means = tables.tangent(space.mean)
            estimate = means if fitted is None else tables.tangent(x)
            jacobians, others = (np.ascontiguousarray(np.moveaxis(of.jacobian, -1, 0)) for of in (means, estimate))
            repeats = scope_covariances(space, Scope.POSE, jacobians) + scope_covariances(space, Scope.VISIT, jacobians)
            yield from zip(means.error.T, jacobians, repeats, estimate.error.T, others, strict=True)

    for (name, at), (mean, jacobian, floor, error, tangent) in zip(named, tangents_of_poses(), strict=True):
        slopes, chain = jacobian[:, unit.columns] @ unit.root, at.posture.chain
        by_z = tangent[:, unit.columns] @ unit.root
        after = by_z @ estimator.covariance @ by_z.T + floor
        by_error, by_nuisance = measurement.view_slopes(at.posture.pose, error, nuisances)
        by_both = np.hstack([by_error @ by_z, by_nuisance])
        rows = by_both.shape[1]
        seen = by_both @ estimator.joint_covariance[:rows, :rows] @ by_both.T + by_error @ floor @ by_error.T
        q = dict(zip(chain.joint_names, map(float, at.posture.q), strict=True))
        sliding = tuple(compress(chain.joint_names, chain.prismatic))
        sampled = {} if robots is None else robots.sizes(mean, jacobian, unit, slopes, (by_z, by_error, by_both))
        before, covariance_before = mean.copy(), slopes @ slopes.T + floor
        entries.append(ErrorLeft(name, q, sliding, before, covariance_before, after, seen, floor, sampled))
    return tuple(entries)


_NOTHING: Final = 1e-9
"""Fraction of a variance below which a number counts as not learned."""
_REACH: Final = 9.0
"""Standard deviations s beyond which the readings exclude the law."""
_WITHIN: Final = 6.0
"""Score of a normal law beyond which the ends of a law are neglected: a probability of 2e-9."""
_CELLS: Final = 1000
"""Cells in which the weighted law is integrated."""


def interval_after(
    law: Law, number: int, estimate: float, std: float, variance_left: float, probability: float
) -> tuple[float, float]:
    """Return the interval of a number after a calibration, with equal probability outside on both sides.

    The number's law in the sheet is weighted by the readings. With v₀ and v its variance before and after, and x̂ its
    estimate for laws without bounds, they act like one reading ``y ± s`` of the number itself: 1/s² = 1/v - 1/v₀ and
    y/s² = x̂/v - μ/v₀ (all other numbers taken as normal). The interval is that of the law times ``exp(-(x -
    y)²/2s²)``. A number of which little is learned keeps the interval of its law, which a normal one would miss: ± 1.96
    standard deviations of a uniform law lie beyond its ends. ``std`` is v₀'s root, ``variance_left`` v/v₀, above 0 and
    up to 1.
    """
    mean = float(law.mean_vector[number])
    projection = law.projection(np.eye(law.size)[number])
    if projection is None:
        # normal numbers stay normal
        return normal_interval(estimate, std * float(np.sqrt(variance_left)), probability)
    precision = 1 / variance_left - 1
    if precision < _NOTHING:
        low, high = _quantiles(projection, 0.0, np.inf, probability)
    else:
        reading = (estimate - mean) / variance_left / precision
        low, high = _quantiles(projection, reading, std / np.sqrt(precision), probability)
    return mean + low, mean + high


def normal_interval(mean: float, std: float, probability: float) -> tuple[float, float]:
    """Return the interval of a normal number about its mean."""
    half_width = float(special.ndtri((1 + probability) / 2)) * std
    return mean - half_width, mean + half_width


def _quantiles(projection: Projection, reading: float, std: float, probability: float) -> tuple[float, float]:
    """Return the ends of the interval of a law of zero mean times ``exp(-(x - reading)²/2 std²)``."""
    support = projection.within(_WITHIN)
    for low, high in ((reading - _REACH * std, reading + _REACH * std), support):
        edges = np.linspace(max(support[0], low), min(support[1], high), _CELLS + 1)
        cumulative = projection.cumulative(edges)
        if edges[0] == support[0]:
            cumulative[0] = 0.0
        weights = np.diff(cumulative)
        # no weight remains: the readings are beyond an end of the law, or between its single values
        if edges[0] < edges[-1] and (weights > 0).any():
            break
    exponent = -0.5 * (((edges[1:] + edges[:-1]) / 2 - reading) / std) ** 2
    weights *= np.exp(np.minimum(exponent - exponent[weights > 0].max(), 0.0))
    within = np.concatenate([[0.0], np.cumsum(weights)])
    sides = (1 - probability) / 2
    lower, upper = np.interp([sides, 1 - sides], within / within[-1], edges)
    return float(lower), float(upper)


_TOGETHER: Final = 64
"""Random starts that are moved to contact at once."""
_ROUNDS: Final = 40
"""Groups of starts, after which too few poses in contact are an error."""
_MOST_STEPS: Final = 60
"""Maximum number of steps of a start to contact."""
_CLOSE: Final = 1e-12
"""Distance from contact, m, at which a pose touches."""
_LONGEST: Final = 0.5
"""Largest change of a joint value in a step."""
_DAMPING: Final = 1e-8
"""Added to the diagonal of J Jᵀ, m², which is singular where the target cannot move."""
_FAR: Final = 0.05
"""Distance from contact, m, beyond which a warning says that a pose does not touch."""


def contact_poses(chain: Chain, measurement: Measurement, count: int, *, seed: int = 0) -> PoseSet:
    """Return random poses in which the target touches the plane, or is in one of the sockets.

    Least-norm steps lead from random joint values to the nearest contact; poses beyond limits or in collision are redrawn.

    Raises:
        InputError: The measurement is not of kind ``"plane"`` or ``"socket"``, or too few poses are found.
    """
    place = measurement.place
    if place is None or measurement.kind not in ("plane", "socket"):
        raise InputError(f"a {measurement.kind} is measured without contact")
    arm = chain.with_target(measurement.target)
    starts = random_poses(arm, _TOGETHER * _ROUNDS, seed=seed).q
    contacts: list[Array] = []
    for k in range(_ROUNDS):
        raise_if_interrupted()
        q = _move_to_contact(arm, measurement, starts[:, _TOGETHER * k : _TOGETHER * (k + 1)].copy(), k)
        contacts.extend(q.T)
        if len(contacts) >= count:
            break
    if len(contacts) < count:
        raise InputError(
            f"only {len(contacts):,} of {_TOGETHER * _ROUNDS:,} random poses end in contact within joint limits; move the "
            f"{measurement.kind} closer, or give the poses"
        )
    names = tuple(f"contact {number}" for number in range(1, count + 1))
    return PoseSet.at(chain, np.ascontiguousarray(np.array(contacts[:count]).T), names)


def _move_to_contact(chain: Chain, measurement: Measurement, q: Array, number: int) -> Array:
    """Return the columns of joint values ``(n, S)`` that reach contact within limits by minimum-norm steps."""
    sockets = np.array(measurement.sockets)
    # cyclic assignment of sockets to starts, so that all are visited
    targets = (np.arange(q.shape[1]) + number) % max(len(sockets), 1)
    for _ in range(_MOST_STEPS):
        at = chain.at_columns(q)
        point, slopes = at.pose[:3, 3], at.joint_jacobian[:3]
        if measurement.plane is not None:
            normal = np.array(measurement.plane[1])
            offsets = (normal @ (point - np.array(measurement.plane[0])[:, None]))[None]
            slopes = np.einsum("i,ijs->js", normal, slopes)[None]
        else:
            offsets = point - sockets[targets].T
        if np.abs(offsets).max() < _CLOSE:
            break
        gram = np.einsum("ias,jas->sij", slopes, slopes) + _DAMPING * np.eye(len(offsets))
        pull = np.linalg.solve(gram, -offsets.T[:, :, None])[:, :, 0]
        step = np.einsum("ias,si->as", slopes, pull)
        q = q + step * np.minimum(1.0, _LONGEST / np.maximum(np.abs(step).max(axis=0), 1e-300))
    touches = (np.abs(offsets) < _CLOSE).all(axis=0) & ~chain.configurations.outside(q).any(axis=0)
    q = np.ascontiguousarray(q[:, touches])
    return q if chain.collision_check is None or not q.size else q[:, chain.collision_check.free(q)]


def seen_poses(chain: Chain, measurement: Measurement, poses: PoseSet) -> PoseSet | None:
    """Return the poses at which the instrument sees the target; ``None`` where it never does."""
    if measurement.visible_from is None:
        return poses
    nominal = np.moveaxis(chain.with_target((0.0, 0.0, 0.0)).at_columns(poses.q).pose, -1, 0)
    is_seen = np.array([measurement.sees(pose) for pose in nominal])
    return poses.of(is_seen) if is_seen.any() else None


def contact_warnings(measurement: Measurement, poses: Array) -> Iterator[Finding]:
    """Yield a warning if nominal poses ``(P, 4, 4)`` do not touch the plane or socket, or are hidden from the instrument."""
    hidden = sum(not measurement.sees(pose) for pose in poses)
    if hidden:
        message = f"at {hidden} of {len(poses)} poses the target faces away from the instrument by more than the cone"
        yield Finding("warning", "W_HIDDEN", message)
    gaps = np.array([measurement.away(pose) for pose in poses])
    distant = int((gaps > _FAR).sum())
    if distant:
        where = "the plane" if measurement.kind == "plane" else "a socket"
        message = f"{distant} of {len(gaps)} poses do not touch {where}, the farthest by {1e3 * gaps.max():.3g} mm"
        yield Finding("warning", "W_CONTACT", message)


_COUNTS: Final = (3, 4, 5, 6, 8, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500, 1000)
"""Numbers of poses for which the accuracy is forecast; those below the given number are used."""
_BEYOND: Final = (2, 4)
"""Multiples of the given poses for which the accuracy is forecast too."""
_ORDERS: Final = 8
"""Random orders of the poses over which the accuracy of fewer poses is averaged."""
_ORDER_SEED: Final = 0
"""Seed of these orders."""
_FACTORS: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Multiples of the instrument's standard deviation for which the accuracy is forecast."""


@dataclass(frozen=True)
class CurvePoint(Record):
    """Number of measured poses, or the instrument's standard deviation, and rms error of the position left over all poses, m."""

    value: float
    rms_position: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CalibrationForecast(PosesOutcome):
    """Accuracy after a calibration, in addition to :class:`PosesOutcome`.

    Attributes:
        readings, posterior: Number of readings, and the arm's numbers after the calibration, with the means before.
        by_count, by_instrument: Accuracy against the number of measured poses and against the instrument's deviation.
        model: The arm as it will be left: every other analysis runs on it. Its means are those of the sheet.
    """

    schema: ClassVar[str] = "precision-pin/calibration-forecast/1"
    KEYS: ClassVar[Keys] = (
        *("*head", "measurement", "readings", "rms_position", "identifiability", "posterior", "poses"),
        *("accuracy_by_count=by_count", "accuracy_by_instrument=by_instrument", "findings"),
    )

    readings: int
    posterior: Posterior
    by_count: tuple[CurvePoint, ...]
    by_instrument: tuple[CurvePoint, ...]
    model: ErrorModel

    def rms(self, which: str) -> float:
        """Return the root mean square error of the position over the user's poses: ``before``, ``after``, ``seen``, ``floor``."""
        return self.rms_position[which]

    def __repr__(self) -> str:
        before, after, floor = (1e3 * self.rms(which) for which in ("before", "after", "floor"))
        return (
            f"<CalibrationForecast of {self.provenance.robot}: {self.readings} readings, rms position {before:.3g} mm "
            f"before, {after:.3g} mm after, floor {floor:.3g} mm>"
        )


@design.on_one_thread
def forecast_calibration(
    model: ErrorModel,
    poses: object,
    measurement: Measurement | None = None,
    *,
    at: object = None,
    findings: Sequence[Finding] = (),
) -> CalibrationForecast:
    """Predict the posterior from measuring an arm at some poses, and the remaining error.

    Args:
        model: The model, whose sheet is the prior.
        poses: Measured poses: a list, an array ``(n, P)``, a mapping of joint values or a pose set. A pose given twice
            is measured twice.
        measurement: Instrument and set-up; those of the sheet if left out.
        at: The user's own poses, where the error is forecast; the model's named poses if left out, else the measured
            ones.
        findings: Findings to pass on, such as those of the sheet.

    Raises:
        InputError: Nothing varies from robot to robot, or the poses are wrong.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> q = np.random.default_rng(0).uniform(-2, 2, (4, 12))
        >>> forecast = pp.forecast_calibration(model, q, pp.Measurement("position", std="20 um"))
        >>> print(round(1e6 * forecast.rms("after")))
        24
    """
    measurement = measurement_of(model, measurement)
    model = model.bare
    findings = check_items("findings", findings, Finding)
    values, _ = design.read_poses(model, poses)
    unit = design.UnitNumbers.of(model.space)
    stations = stations_of(model, values, measurement)
    ahead, rows = design.stack_at_means(stations, unit, measurement), np.arange(values.shape[1])
    estimator = Estimator.of(*ahead.taken(rows), has_prior=True)
    tasks = design.task_poses(model, at, values)
    entries = errors_left(tasks, unit, estimator, measurement, model.space)
    identifiability = design.determined_by(stations, unit, measurement)
    slopes = np.concatenate([pose_model.jacobian[:3][:, unit.columns] @ unit.root for _, pose_model in tasks])
    nominal = np.array([station.at.posture.pose for station in stations])
    floor = float(np.mean([entry.rms("floor") ** 2 for entry in entries]))
    covariance = unit.root @ estimator.covariance @ unit.root.T
    return CalibrationForecast(
        provenance=Provenance.of(model, _ORDER_SEED),
        measurement=measurement,
        readings=values.shape[1],
        posterior=Posterior.of(unit, unit.mean, covariance),
        identifiability=identifiability,
        poses=entries,
        by_count=_by_count(ahead, slopes, floor),
        by_instrument=tuple(
            CurvePoint(
                factor * measurement.std,
                _rms(design.stack_at_means(stations, unit, measurement, factor).taken(rows), slopes, floor),
            )
            for factor in _FACTORS
        ),
        model=model.calibrated(Estimates(unit.names, unit.mean, covariance)),
        findings=(*findings, *_warnings(identifiability, model, unit), *contact_warnings(measurement, nominal)),
    )


def _rms(derivatives: tuple[Array, Array], slopes: Array, floor: float) -> float:
    covariance = Estimator.of(*derivatives, has_prior=True).covariance
    return float(np.sqrt(3 * np.einsum("ij,jk,ik->i", slopes, covariance, slopes).mean() + floor))


def _by_count(ahead: design.ReadingsAhead, slopes: Array, floor: float) -> tuple[CurvePoint, ...]:
    count = len(ahead.by_z)
    generator = np.random.default_rng(_ORDER_SEED)
    orders = [generator.permutation(count) for _ in range(_ORDERS)]
    points = []
    for number in (*(size for size in _COUNTS if size < count), count):
        subsets = [np.sort(order[:number]) for order in (orders if number < count else orders[:1])]
        squares = [_rms(ahead.taken(rows), slopes, floor) ** 2 for rows in subsets]
        points.append(CurvePoint(number, float(np.sqrt(np.mean(squares)))))
    multiples = [(k * count, ahead.taken(np.tile(np.arange(count), k))) for k in _BEYOND]
    return (*points, *(CurvePoint(number, _rms(derivatives, slopes, floor)) for number, derivatives in multiples))


def _warnings(result: design.Identifiability, model: ErrorModel, unit: design.UnitNumbers) -> Iterator[Finding]:
    yield from design.identifiability_warnings(result)
    draws = model.space.draws
    names = {draw.name for draw in draws if not draw.law.is_normal and set(draw.components) & set(unit.names)}
    if names:
        message = (
            f"{len(names)} of {len(draws)} draws are not normal; they enter rms values with their means and "
            "covariances, and the 95 % quantiles are those of sampled robots"
        )
        yield Finding("warning", "W_NOT_NORMAL", message)


_STEPS: Final = 30
"""Maximum number of steps of the simulated estimates."""
_SETTLED: Final = 1e-9
"""Largest change of z at which the estimates have converged."""
_TASK_POSE: Final = 1 << 19
"""Number of the first of the user's poses in the random streams, beyond all measured ones."""


@dataclass(frozen=True, eq=False)
class SimulatedCalibrations:
    """Calibrations of N simulated robots.

    Attributes:
        errors: Error of the tip from the calibrated arm's own pose, at each of the user's T poses at a later visit,
            ``(T, 6, N)``.
        estimates, truth: Estimated and true z, ``(r, N)``.
        chi_square, degrees_of_freedom: Sum of squares of residuals and estimates, ``(N,)``, and its expectation.
    """

    errors: Array
    estimates: Array
    truth: Array
    chi_square: Array
    degrees_of_freedom: int

    @property
    def rms_position(self) -> Array:
        """Root mean square of the position's error at each of the user's poses, ``(T,)``."""
        return np.asarray(np.sqrt((self.errors[:, :3] ** 2).sum(axis=1).mean(axis=1)))


@design.on_one_thread
def simulate_calibrations(
    model: ErrorModel, poses: object, measurement: Measurement, *, at: object = None, robots: int = 1000, seed: int = 0
) -> SimulatedCalibrations:
    """Simulate robots, measure each at all poses, and fit each with the exact model; arguments as of the forecast.

    Estimates satisfy the first-order normal equations at the means, with exact residuals. Bounds of laws are ignored.
    """
    measurement = measurement_of(model, measurement)
    model = model.bare
    check_whole("the number of robots", robots, 1, 10**6)
    values, _ = design.read_poses(model, poses)
    unit = design.UnitNumbers.of(model.space)
    stations = stations_of(model, values, measurement)
    x = model.space.sample(seed, 0, robots)
    readings = simulate_readings(stations, measurement, model, robots=robots, seed=seed)
    if measurement.drift is not None:
        raise InputError("simulated calibrations are those of an instrument without drift")
    by_z, by_nuisance = map(design.flat, design.stack_at_means(stations, unit, measurement)[:2])
    estimator = design.Estimator.of(by_z, by_nuisance, has_prior=True)
    zero = np.zeros(by_nuisance.shape[1])
    roots = [
        design.root_ahead(
            station,
            measurement,
            measurement.slopes(station.at.posture.pose, station.at.error_at_means, zero).error,
        )
        for station in stations
    ]
    z, nuisances = np.zeros((unit.root.shape[1], robots)), np.zeros((by_nuisance.shape[1], robots))

    def whitened_residuals() -> Array:
        result = np.empty_like(readings)
        for station, root in zip(stations, roots, strict=True):
            rows = list(station.rows)
            tip_errors = station.at.exact(unit.components(station.at.space, z))
            predicted = measurement.predict(station.at.posture.pose, tip_errors, nuisances)
            block = np.array([measurement.residual(readings[row], predicted) for row in rows])
            white = scipy.linalg.solve_triangular(root, block.reshape(len(rows) * measurement.size, -1), lower=True)
            result[rows] = white.reshape(block.shape)
        return result.reshape(-1, robots)

    for _ in range(_STEPS):
        residuals = whitened_residuals()
        new_z = estimator.estimate(residuals, z)
        step = new_z - z
        if nuisances.size:
            nuisances = nuisances + np.linalg.lstsq(by_nuisance, residuals - by_z @ step, rcond=None)[0]
        z = new_z
        if np.abs(step).max() < _SETTLED:
            break
    residuals = whitened_residuals()
    chi_square: Array = (residuals**2).sum(axis=0) + (z**2).sum(axis=0)
    errors = []
    for k, (_, pose_model) in enumerate(design.task_poses(model, at, values)):
        later = with_later_draws(model, x, seed, _TASK_POSE + k)
        errors.append(pose_model.exact(later) - pose_model.exact(unit.components(model.space, z)))
    truth = np.asarray(np.linalg.lstsq(unit.root, x[unit.columns] - unit.mean[:, None], rcond=None)[0], dtype=float)
    return SimulatedCalibrations(np.array(errors), z, truth, chi_square, len(by_z) - estimator.nuisance_rank)
