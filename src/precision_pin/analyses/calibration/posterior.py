"""What is known of a model's numbers after a calibration, and the errors that are left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, final

import numpy as np

from precision_pin.analyses.calibration.design import UnitNumbers, repeat_covariance
from precision_pin.analyses.calibration.estimates import Estimator
from precision_pin.analyses.exact_law.number_law import NormalNorm
from precision_pin.base import se3
from precision_pin.base.arguments import check_name
from precision_pin.base.arrays import Array
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import PoseModel
from precision_pin.sheet.measurement import Measurement
from precision_pin.statistics import quantile_ranks

LEVEL: Final = 0.95
"""Probability of the intervals of numbers, and of the quantiles of the error that is left."""
ROBOTS: Final = 10_000
"""Robots that are sampled for the quantiles where a law is not normal."""

_SEED: Final = 0


@final
@dataclass(frozen=True, eq=False)
class Posterior:
    """Mean and covariance of the numbers drawn once for each robot, SI.

    Attributes
    ----------
    names
        The numbers.
    mean
        Mean of each number.
    covariance
        ``(U, U)``, rows and columns in the order of the names.
    prior_mean, prior_std
        Before the calibration.
    """

    names: tuple[str, ...]
    mean: Mapping[str, float]
    covariance: Array
    prior_mean: Mapping[str, float]
    prior_std: Mapping[str, float]

    @classmethod
    def of(cls, unit: UnitNumbers, mean: Array, covariance: Array) -> Posterior:
        """Return the posterior of the numbers of a space."""
        means = dict(zip(unit.names, mean.tolist(), strict=True))
        before = dict(zip(unit.names, unit.mean.tolist(), strict=True))
        return cls(unit.names, means, covariance, before, dict(zip(unit.names, unit.std.tolist(), strict=True)))

    @cached_property
    def std(self) -> Mapping[str, float]:
        """Standard deviation of each number."""
        return dict(zip(self.names, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).tolist(), strict=True))

    @cached_property
    def learned(self) -> Mapping[str, float]:
        """Share of each number's prior variance that the measurements removed, 0 to 1."""
        return {name: float(np.clip(1 - (self.std[name] / self.prior_std[name]) ** 2, 0.0, 1.0)) for name in self.names}

    def covariance_of(self, one: str, other: str) -> float:
        """Return the covariance of two numbers.

        Raises
        ------
        UnknownNameError
            There is no such number.
        """
        row, column = (self.names.index(check_name("component", name, self.names)) for name in (one, other))
        return float(self.covariance[row, column])

    def to_dict(self) -> dict[str, Any]:
        """Return the posterior as in the JSON."""
        return {
            "names": list(self.names),
            "mean": dict(self.mean),
            "std": dict(self.std),
            "prior_mean": dict(self.prior_mean),
            "prior_std": dict(self.prior_std),
            "learned": dict(self.learned),
            "covariance": self.covariance.tolist(),
        }


@final
@dataclass(frozen=True, eq=False)
class ErrorLeft:
    """The tip's error at a pose before and after a calibration, first order; base axes, m and rad.

    Attributes
    ----------
    name, q, sliding_joints
        The pose, and the sliding joints, whose values are in m.
    before
        Mean ``(6,)`` of the error before the calibration.
    covariance_before, covariance_after
        ``(6, 6)``; after it the error is that from the calibrated arm's own pose, of mean zero.
    covariance_seen
        Covariance after the calibration of the error in the instrument's axes, which a free base shares, ``(6, 6)``; that
        of ``covariance_after`` where the base is known.
    floor
        ``(6, 6)``, the part that pose- and visit-scope numbers cause, which no calibration removes.
    sampled
        Where a law is not normal: the sizes |d| and |δ| ``(2, N)`` of the errors ``before``, ``after``, ``seen`` and ``floor`` of
        sampled robots in rising order, to first order.
    """

    name: str
    q: Mapping[str, float]
    sliding_joints: tuple[str, ...]
    before: Array
    covariance_before: Array
    covariance_after: Array
    covariance_seen: Array
    floor: Array
    sampled: Mapping[str, Array] = field(default_factory=dict, repr=False)

    @property
    def _matrices(self) -> dict[str, Array]:
        seen = self.covariance_seen
        return {"before": self.covariance_before, "after": self.covariance_after, "seen": seen, "floor": self.floor}

    def rms(self, which: str, *, attitude: bool = False) -> float:
        """Return the root mean square of the position's (or attitude's) error: ``before``, ``after``, ``seen`` or ``floor``."""
        rows = slice(3, 6) if attitude else slice(0, 3)
        matrix = self._matrices[which]
        mean = self.before[rows] if which == "before" else np.zeros(3)
        return float(np.sqrt(max(np.trace(matrix[rows, rows]), 0.0) + mean @ mean))

    def quantile(self, which: str, *, attitude: bool = False) -> float:
        """Return the 95 % quantile of |d| (or |δ|): ``before``, ``after``, ``seen`` or ``floor``.

        Where all laws are normal it is that of the normal error, otherwise that of the sampled robots.
        """
        if self.sampled:
            return float(np.quantile(self.sampled[which][int(attitude)], LEVEL))
        rows = slice(3, 6) if attitude else slice(0, 3)
        matrix = self._matrices[which]
        mean = self.before[rows] if which == "before" else np.zeros(3)
        if not matrix[rows, rows].any():
            return float(np.linalg.norm(mean))
        return float(NormalNorm(mean.copy(), matrix[rows, rows].copy()).quantile(LEVEL))

    def quantile_interval(self, which: str, *, attitude: bool = False) -> tuple[float, float] | None:
        """Return the distribution-free 95 % interval of a sampled :meth:`quantile`; None where it is that of a normal error."""
        if not self.sampled:
            return None
        ordered = self.sampled[which][int(attitude)]
        ranks = quantile_ranks(ordered.size, LEVEL, LEVEL)
        assert ranks is not None
        return float(ordered[ranks[0] - 1]), float(ordered[ranks[1] - 1])

    def to_dict(self) -> dict[str, Any]:
        """Return the entry as in the JSON."""
        sizes = {
            which: {
                "rms_position": self.rms(which),
                "quantile_position": self.quantile(which),
                "quantile_position_interval": self.quantile_interval(which),
                "rms_attitude": self.rms(which, attitude=True),
                "quantile_attitude": self.quantile(which, attitude=True),
                "quantile_attitude_interval": self.quantile_interval(which, attitude=True),
            }
            for which in ("before", "after", "seen", "floor")
        }
        return {
            "name": self.name,
            "q": dict(self.q),
            **sizes,
            "mean_before": self.before.tolist(),
            "covariance_before": self.covariance_before.tolist(),
            "covariance_after": self.covariance_after.tolist(),
            "covariance_seen": self.covariance_seen.tolist(),
            "covariance_floor": self.floor.tolist(),
        }


@final
@dataclass(frozen=True, eq=False)
class SampledRobots:
    """Robots with the laws of the sheet, each measured once: what the linear estimate leaves of their numbers.

    With C the covariance of z after measuring, the estimate leaves ``C z`` of z, and of the noise of the readings a normal part
    with the covariance ``C - C²``: z enters with its law.

    Attributes
    ----------
    deviations
        All numbers minus their means, ``(d, N)``.
    z
        Unit-scope numbers in units of their root, ``(r, N)``.
    left
        What is left of z and, below, the nuisances' errors, ``(r + k, N)``.
    """

    deviations: Array
    z: Array
    left: Array

    @classmethod
    def of(cls, space: Space, unit: UnitNumbers, estimator: Estimator) -> SampledRobots | None:
        """Return the robots; None where all laws are normal, or no prior says how robots differ."""
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


def error_left(
    at: PoseModel,
    name: str,
    unit: UnitNumbers,
    estimator: Estimator,
    measurement: Measurement,
    robots: SampledRobots | None,
) -> ErrorLeft:
    """Return the error at a pose before and after a calibration, its quantiles those of the robots where there are any."""
    slopes = at.jacobian[:, unit.columns] @ unit.root
    floor = repeat_covariance(at)
    chain = at.posture.chain
    after = slopes @ estimator.covariance @ slopes.T + floor
    seen, together = after, slopes
    if measurement.displaces_base:
        base = np.eye(6)
        base[:3, 3:] = -se3.skew(at.posture.pose[:3, 3] + at.error_at_means[:3])
        together = np.hstack([slopes, base])
        rows = together.shape[1]
        seen = together @ estimator.joint_covariance[:rows, :rows] @ together.T + floor
    return ErrorLeft(
        name,
        dict(zip(chain.joint_names, map(float, at.posture.q), strict=True)),
        tuple(joint.name for joint in chain.joints if joint.kind == "prismatic"),
        at.error_at_means,
        slopes @ slopes.T + floor,
        after,
        seen,
        floor,
        {} if robots is None else robots.sizes(at, unit, slopes, together),
    )
