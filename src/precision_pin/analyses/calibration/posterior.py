"""What is known of a model's numbers after a calibration, and the remaining errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Final, NamedTuple, final

import numpy as np
from scipy import special

from precision_pin.analyses.calibration.design import Estimator, Identifiability, UnitNumbers, repeat_covariance
from precision_pin.analyses.exact_law.number_law import NormalNorm
from precision_pin.analyses.result import Outcome
from precision_pin.base import se3
from precision_pin.base.arguments import check_name
from precision_pin.base.arrays import Array
from precision_pin.base.record import Keys, Record
from precision_pin.draws.laws import Law
from precision_pin.draws.laws.projection import Projection
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.html import preformatted
from precision_pin.sheet.measurement import Measurement
from precision_pin.statistics import quantile_ranks

LEVEL: Final = 0.95
"""Probability of the intervals of numbers, and of the quantiles of the remaining error."""
ROBOTS: Final = 10_000
"""Robots sampled for the quantiles if a law is not normal."""

ERRORS: Final = ("before", "after", "seen", "floor")
"""Errors reported at a pose: before and after the calibration, after in the instrument's axes, and the floor."""
_SEED: Final = 0


@final
@dataclass(frozen=True, eq=False)
class Posterior(Record):
    """Mean and covariance ``(U, U)`` of the numbers drawn once for each robot, and their prior means and deviations, SI."""

    KEYS: ClassVar[Keys] = ("names", "mean", "std", "prior_mean", "prior_std", "learned", "covariance")

    names: tuple[str, ...]
    mean: Mapping[str, float]
    covariance: Array
    prior_mean: Mapping[str, float]
    prior_std: Mapping[str, float]

    @classmethod
    def of(cls, unit: UnitNumbers, mean: Array, covariance: Array) -> Posterior:
        """Return the posterior of the numbers of a space."""
        means, before, std = (
            dict(zip(unit.names, values.tolist(), strict=True)) for values in (mean, unit.mean, unit.std)
        )
        return cls(unit.names, means, covariance, before, std)

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


@final
@dataclass(frozen=True, eq=False)
class ErrorLeft(Record):
    """The tip's error at a pose before and after a calibration, first order; base axes, m and rad.

    Attributes:
        name, q, sliding_joints: The pose, and the sliding joints, whose values are in m.
        before: Mean ``(6,)`` of the error before the calibration.
        covariance_before, covariance_after, covariance_seen: ``(6, 6)``; after it the error is that from the calibrated
            arm's own pose, of mean zero; seen in the instrument's axes, which a free base shares.
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
        ordered = self.sampled[which][int(attitude)]
        ranks = quantile_ranks(ordered.size, LEVEL, LEVEL)
        assert ranks is not None
        return float(ordered[ranks[0] - 1]), float(ordered[ranks[1] - 1])

    @property
    def sizes(self) -> dict[str, dict[str, Any]]:
        """Root mean squares and 95 % quantiles with their intervals, as in the JSON."""
        found: dict[str, dict[str, Any]] = {which: {} for which in ERRORS}
        for which, entry in found.items():
            for name, attitude in (("position", False), ("attitude", True)):
                entry[f"rms_{name}"] = self.rms(which, attitude=attitude)
                entry[f"quantile_{name}"] = self.quantile(which, attitude=attitude)
                entry[f"quantile_{name}_interval"] = self.quantile_interval(which, attitude=attitude)
        return found


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
    """Robots with the laws of the sheet, each measured once: what the linear estimate leaves of their numbers.

    With C the covariance of z after measuring, the estimate leaves ``C z`` of z, and of the readings' noise a normal
    part with the covariance ``C - C²``: z enters with its law. ``deviations`` ``(d, N)`` are all numbers minus their
    means, ``z`` ``(r, N)`` those of unit scope in units of their root, ``left`` ``(r + k, N)`` the rest of z and the
    nuisances' errors.
    """

    deviations: Array
    z: Array
    left: Array

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
        noise = np.random.default_rng(_SEED).standard_normal((len(joint), ROBOTS))
        return cls(deviations, z, through @ z + (vectors * np.sqrt(np.maximum(values, 0.0))) @ noise)

    def sizes(self, at: PoseModel, unit: UnitNumbers, slopes: Array, together: Array) -> dict[str, Array]:
        """Return ``sampled`` of :class:`ErrorLeft`, given the derivatives by z, and by z and the nuisances."""
        repeated = np.ones(len(self.deviations), dtype=bool)
        repeated[unit.columns] = False
        floor = at.jacobian[:, repeated] @ self.deviations[repeated]
        errors = {
            "before": at.error_at_means[:, None] + slopes @ self.z + floor,
            "after": slopes @ self.left[: len(self.z)] + floor,
            "seen": together @ self.left[: together.shape[1]] + floor,
            "floor": floor,
        }
        return {
            which: np.sort(np.sqrt((error.reshape(2, 3, -1) ** 2).sum(axis=1)), axis=1)
            for which, error in errors.items()
        }


def errors_left(
    tasks: Iterable[tuple[str, PoseModel]], unit: UnitNumbers, estimator: Estimator, displaces_base: bool, space: Space
) -> tuple[ErrorLeft, ...]:
    """Return the error at each named pose before and after; the first six nuisances may displace the base."""
    robots, found = SampledRobots.of(space, unit, estimator), []
    for name, at in tasks:
        slopes = at.jacobian[:, unit.columns] @ unit.root
        floor = repeat_covariance(at)
        chain = at.posture.chain
        after = slopes @ estimator.covariance @ slopes.T + floor
        seen, together = after, slopes
        if displaces_base:
            base = np.eye(6)
            base[:3, 3:] = -se3.skew(at.posture.pose[:3, 3] + at.error_at_means[:3])
            together = np.hstack([slopes, base])
            rows = together.shape[1]
            seen = together @ estimator.joint_covariance[:rows, :rows] @ together.T + floor
        q = dict(zip(chain.joint_names, map(float, at.posture.q), strict=True))
        sliding = tuple(joint.name for joint in chain.joints if joint.kind == "prismatic")
        sampled = {} if robots is None else robots.sizes(at, unit, slopes, together)
        before, around = at.error_at_means, slopes @ slopes.T + floor
        found.append(ErrorLeft(name, q, sliding, before, around, after, seen, floor, sampled))
    return tuple(found)


_NOTHING: Final = 1e-9
"""Fraction of a variance below which nothing counts as learned."""
_REACH: Final = 9.0
"""Deviations s beyond which the readings leave nothing of the law."""
_WITHIN: Final = 6.0
"""Score of a normal law beyond which the ends of a law are neglected: a probability of 2e-9."""
_CELLS: Final = 1000


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
    reach = float(special.ndtri((1 + probability) / 2)) * std
    return mean - reach, mean + reach


def _quantiles(projection: Projection, reading: float, std: float, probability: float) -> tuple[float, float]:
    """Return the ends of the interval of a law of zero mean times ``exp(-(x - reading)²/2 std²)``."""
    ends = projection.within(_WITHIN)
    for low, high in ((reading - _REACH * std, reading + _REACH * std), ends):
        edges = np.linspace(max(ends[0], low), min(ends[1], high), _CELLS + 1)
        below = projection.cumulative(edges)
        if edges[0] == ends[0]:
            below[0] = 0.0
        share = np.diff(below)
        # nothing left: the readings are beyond an end of the law, or between its single values
        if edges[0] < edges[-1] and (share > 0).any():
            break
    exponent = -0.5 * (((edges[1:] + edges[:-1]) / 2 - reading) / std) ** 2
    share *= np.exp(np.minimum(exponent - exponent[share > 0].max(), 0.0))
    within = np.concatenate([[0.0], np.cumsum(share)])
    sides = (1 - probability) / 2
    first, last = np.interp([sides, 1 - sides], within / within[-1], edges)
    return float(first), float(last)
