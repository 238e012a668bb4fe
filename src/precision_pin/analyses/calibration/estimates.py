"""Estimates of the unit-scope numbers from whitened derivatives: the normal equations solved."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
import scipy.optimize

from precision_pin.analyses.calibration.design import project_out
from precision_pin.base.arrays import Array

WEAKEST: Final = 1.0
"""Without a prior, a combination is estimated if the readings alone determine it better than its tolerance, by this factor."""


def covariance_with_prior(by_z: Array, by_nuisance: Array) -> Array:
    """Return the covariance of z after measurements, ``(r, r)``: ``(I + Hᵀ(1 - P)H)⁻¹`` with P that of the nuisances.

    Parameters
    ----------
    by_z, by_nuisance
        Whitened derivatives of the readings, ``(M, r)`` and ``(M, k)``.
    """
    left, _ = project_out(by_z, by_nuisance)
    values, vectors = np.linalg.eigh(left.T @ left)
    result: Array = (vectors / (1 + np.maximum(values, 0.0))) @ vectors.T
    return result


@final
@dataclass(frozen=True, eq=False)
class Estimator:
    """The linear estimate of z and the nuisances from whitened readings.

    Attributes
    ----------
    by_z, by_nuisance
        Whitened derivatives of the readings, ``(M, r)`` and ``(M, k)``.
    projected
        ``by_z`` without what nuisances could explain.
    nuisance_rank
        Combinations of nuisances that are determined.
    covariance
        Of z after the measurements, ``(r, r)``.
    kept
        Basis of the combinations that are estimated, ``(r, kept)``; all of them with a prior.
    has_prior
        Whether z has its prior of mean zero and unit covariance.
    """

    by_z: Array
    by_nuisance: Array
    projected: Array
    nuisance_rank: int
    covariance: Array
    kept: Array
    has_prior: bool

    @classmethod
    def of(cls, by_z: Array, by_nuisance: Array, *, has_prior: bool, kept: Array | None = None) -> Estimator:
        """Return the estimator of whitened derivatives.

        Parameters
        ----------
        by_z, by_nuisance
            Whitened derivatives of the readings.
        has_prior
            Whether z has its prior.
        kept
            Without a prior, the basis of the combinations to estimate; those that the readings determine if left out.
        """
        projected, rank = project_out(by_z, by_nuisance)
        if has_prior:
            whole = np.eye(by_z.shape[1])
            return cls(by_z, by_nuisance, projected, rank, covariance_with_prior(by_z, by_nuisance), whole, has_prior)
        if kept is None:
            _, values, rows = np.linalg.svd(projected, full_matrices=True)
            kept = rows[: int((values > WEAKEST).sum())].T
        _, triangle = np.linalg.qr(projected @ kept)
        inverse = np.linalg.pinv(triangle, rcond=1e-12)
        # combinations that the readings do not determine keep their prior
        covariance = kept @ inverse @ inverse.T @ kept.T + np.eye(len(kept)) - kept @ kept.T
        return cls(by_z, by_nuisance, projected, rank, covariance, kept, has_prior)

    def estimate(self, readings: Array, low: Array | None = None, high: Array | None = None) -> Array:
        """Return z ``(r,)`` for whitened readings ``(M,)``, within bounds ``(r,)`` if they are given."""
        if not self.has_prior:
            found: Array = self.covariance @ (self.kept @ (self.kept.T @ (self.projected.T @ readings)))
            return found
        free: Array = self.covariance @ (self.projected.T @ readings)
        if low is None or high is None or ((free >= low) & (free <= high)).all():
            return free
        rows = np.vstack([self.projected, np.eye(free.size)])
        target = np.concatenate([readings, np.zeros(free.size)])
        # BVLS is exact at the bounds, and the problem is small
        bounded: Array = scipy.optimize.lsq_linear(rows, target, (low, high), method="bvls", tol=1e-14).x
        return bounded

    def nuisances(self, readings: Array) -> Array:
        """Return the nuisances ``(k,)`` that explain whitened readings less what z explains, ``(M,)``, with least norm."""
        if not self.by_nuisance.shape[1]:
            return np.zeros(0)
        scale = np.linalg.norm(self.by_nuisance, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        found: Array = np.linalg.lstsq(self.by_nuisance / scale, readings, rcond=1e-9)[0] / scale
        return found

    def leverage(self) -> Array:
        """Return the share G ``(M, M)`` of whitened readings that the estimate follows: fitted = G readings."""
        basis = np.zeros((len(self.by_z), 0))
        if self.by_nuisance.shape[1]:
            scale = np.linalg.norm(self.by_nuisance, axis=0)
            vectors, _, _ = np.linalg.svd(self.by_nuisance / np.where(scale > 0, scale, 1.0), full_matrices=False)
            basis = vectors[:, : self.nuisance_rank]
        within = self.kept @ (self.kept.T @ self.covariance @ self.kept) @ self.kept.T
        result: Array = basis @ basis.T + self.projected @ within @ self.projected.T
        return result

    @cached_property
    def joint_covariance(self) -> Array:
        """Covariance of z and the nuisances together, ``(r + k, r + k)``; of nuisances that are determined."""
        inverse = np.linalg.pinv(self.by_nuisance, rcond=1e-12) if self.by_nuisance.size else self.by_nuisance.T
        through = inverse @ self.by_z
        cross = -self.covariance @ through.T
        own = inverse @ inverse.T + through @ self.covariance @ through.T
        return np.block([[self.covariance, cross], [cross.T, own]])

    def nuisance_covariance(self) -> Array:
        """Return the covariance of the nuisances, ``(k, k)``, of those combinations that are determined."""
        size = self.by_z.shape[1]
        return self.joint_covariance[size:, size:]
