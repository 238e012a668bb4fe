"""Variances of numbers that differ from robot to robot, from what each robot's readings say of its own numbers.

In units of the sheet's standard deviations the numbers of a robot are u with mean m and covariance ``D(s) = Σ s_k C_k``, C_k the
sheet's correlations of component k and s_k the square of its scale. Readings with unit noise, freed of what the set-up explains,
are ``y = H u + e``. They enter by ``A = HᵀH`` and ``b = Hᵀy`` alone:

    2 ln L = Σ_r [ vᵀ D b̃ + 2 mᵀb - mᵀA m - ln det(I + A D) ],  v = (I + A D)⁻¹ b̃,  b̃ = b - A m.

That is the likelihood of the readings, without any prior on u. Means that are estimated too cost degrees of freedom; the
restricted likelihood (Patterson and Thompson 1971) has ``-ln det Σ_r W_r`` besides, ``W = (I + A D)⁻¹ A``, over the
combinations that any robot shows. Intervals are those of the profile likelihood.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
import scipy.optimize
from scipy import stats

from precision_pin.analyses.calibration.design import NEGLIGIBLE
from precision_pin.base.arrays import Array

_WIDEST: Final = 1e4
"""Largest scale that an interval can end at; beyond it there is no upper limit."""
_ZERO: Final = 1e-6
_STEPS: Final = 500


@final
@dataclass(frozen=True, eq=False)
class Evidence:
    """What the readings of R robots say of their U numbers, in units of prior standard deviations.

    Attributes
    ----------
    information
        A, ``(R, U, U)``.
    score
        b, about the prior means, ``(R, U)``.
    """

    information: Array
    score: Array

    @cached_property
    def seen(self) -> Array:
        """Basis of the combinations that any robot shows, ``(U, k)``."""
        values, vectors = np.linalg.eigh(self.information.sum(axis=0))
        basis: Array = vectors[:, values > NEGLIGIBLE * max(float(values[-1]), 0.0)]
        return basis


@final
@dataclass(frozen=True, eq=False)
class VarianceComponents:
    """Scales of the components: standard deviation over that of the sheet.

    Attributes
    ----------
    scale, low, high
        Estimate and confidence interval, ``(K,)`` each; an upper limit may be infinite.
    means
        Estimated means, in units of prior standard deviations from those of the sheet, ``(U,)``; zeros where they are not.
    log_likelihood, at_sheet
        Of the estimate and of the sheet's scales, up to the same constant.
    """

    scale: Array
    low: Array
    high: Array
    means: Array
    log_likelihood: float
    at_sheet: float


@final
@dataclass(frozen=True, eq=False)
class _Likelihood:
    evidence: Evidence
    blocks: Array
    has_means: bool

    def of(self, scales: Array) -> tuple[float, Array]:
        """Return ln L and its derivatives by the scales ``(K,)``."""
        spread, width, means, score = self._parts(scales)
        moved = np.linalg.solve(spread, score[:, :, None])[:, :, 0]
        covariance = self._covariance(scales)
        value = float(np.einsum("ri,ij,rj->", moved, covariance, score) - np.linalg.slogdet(spread)[1].sum())
        squares = np.einsum("ri,kij,rj->k", moved, self.blocks, moved)
        traces = np.einsum("rij,kji->k", width, self.blocks)
        if self.has_means:
            basis, plain = self.evidence.seen, self.evidence
            value += float(2 * means @ plain.score.sum(axis=0) - means @ plain.information.sum(axis=0) @ means)
            total = basis.T @ width.sum(axis=0) @ basis
            value -= float(np.linalg.slogdet(total)[1])
            inverse = basis @ np.linalg.inv(total) @ basis.T
            traces -= np.einsum("ij,rja,kab,rbi->k", inverse, width, self.blocks, width, optimize=True)
        return value / 2, scales * (squares - traces)

    def _covariance(self, scales: Array) -> Array:
        result: Array = np.einsum("k,kij->ij", scales**2, self.blocks)
        return result

    def _parts(self, scales: Array) -> tuple[Array, Array, Array, Array]:
        """Return I + A D, W, the means and b̃."""
        spread = np.eye(self.blocks.shape[1]) + self.evidence.information @ self._covariance(scales)
        width = np.asarray(np.linalg.solve(spread, self.evidence.information), dtype=float)
        means = np.zeros(self.blocks.shape[1])
        score = self.evidence.score
        if self.has_means:
            basis = self.evidence.seen
            pull = np.linalg.solve(spread, score[:, :, None])[:, :, 0].sum(axis=0)
            means = np.asarray(
                basis @ np.linalg.solve(basis.T @ width.sum(axis=0) @ basis, basis.T @ pull), dtype=float
            )
            score = np.asarray(score - self.evidence.information @ means, dtype=float)
        return spread, width, means, score

    def means(self, scales: Array) -> Array:
        return self._parts(scales)[2]

    def best(self, start: Array, fixed: int | None = None) -> tuple[Array, float]:
        """Return the scales of the largest likelihood and ln L there, one of them fixed at its start if it is named."""
        free = np.array([k for k in range(start.size) if k != fixed], dtype=np.intp)
        if not free.size:
            return start, self.of(start)[0]

        def loss(values: Array) -> tuple[float, Array]:
            scales = start.copy()
            scales[free] = values
            value, slopes = self.of(scales)
            return -value, -slopes[free]

        # away from zero, where the derivative by a scale vanishes
        begin = np.maximum(start[free], 1e-2)
        found = scipy.optimize.minimize(
            loss,
            begin,
            jac=True,
            method="L-BFGS-B",
            bounds=[(0.0, _WIDEST)] * free.size,
            options={"maxiter": _STEPS, "ftol": 1e-13, "gtol": 1e-7},
        )
        scales = start.copy()
        scales[free] = found.x
        return scales, -float(found.fun)


def variance_components(
    evidence: Evidence,
    blocks: Array,
    *,
    has_means: bool = False,
    confidence: float = 0.95,
    advance: Callable[[int], None] = lambda _: None,
) -> VarianceComponents:
    """Return the scales of the components and their intervals.

    Parameters
    ----------
    evidence
        What the readings say.
    blocks
        C of each component, ``(K, U, U)``.
    has_means
        Whether the means of all numbers are estimated with them; they are those of the sheet otherwise.
    confidence
        Of each interval.
    advance
        Called with 1 for each component.
    """
    likelihood = _Likelihood(evidence, blocks, has_means)
    scale, largest = likelihood.best(np.ones(len(blocks)))
    limit = largest - float(stats.chi2.ppf(confidence, 1)) / 2
    low, high = np.zeros_like(scale), np.full_like(scale, np.inf)
    for k in range(len(blocks)):
        low[k], high[k] = _interval(likelihood, scale, k, limit)
        advance(1)
    return VarianceComponents(
        scale,
        low,
        high,
        likelihood.means(scale),
        largest,
        likelihood.of(np.ones(len(blocks)))[0],
    )


def _interval(likelihood: _Likelihood, scale: Array, k: int, limit: float) -> tuple[float, float]:
    """Return the scales of component k between which the profile likelihood stays above a limit."""

    def above(value: float) -> float:
        start = scale.copy()
        start[k] = value
        return likelihood.best(start, k)[1] - limit

    here = float(scale[k])
    low = 0.0
    if here > _ZERO and above(0.0) < 0:
        low = float(scipy.optimize.brentq(above, 0.0, here, rtol=1e-4))
    inside, high = here, max(1.5 * here, 0.1)
    while above(high) > 0:
        inside, high = high, 2 * high
        if high > _WIDEST:
            return low, np.inf
    return low, float(scipy.optimize.brentq(above, inside, high, rtol=1e-4))
