"""Mean and covariance of the exact error from its derivatives at the means, without sampling.

Let the components be an affine map of numbers ζ with mean 0 and covariance I, and f_k, f_kl, … the derivatives of the exact
error with respect to ζ at 0. The Taylor series gives (GUM, JCGM 100:2008, 5.1.2 note, continued to the fourth order)

    E f   = f + Σ f_kk/2 + Σ f_kkk s_k/6 + [Σ f_kkkk q_k + Σ_(k≠l) 3 f_kkll κ_kl]/24 + …
    Cov f = Σ f_k f_kᵀ + sym Σ f_k f_kkᵀ s_k/2
            + [Σ f_kk f_kkᵀ (q_k - 1) + Σ_(k≠l) (f_kk f_llᵀ (κ_kl - 1) + 2 f_kl f_klᵀ κ_kl)]/4
            + sym Σ f_k (f_kkk q_k + Σ_(l≠k) 3 f_kll κ_kl)ᵀ/6 + …

where sym A = A + Aᵀ, s_k = E ζ_k³, q_k = E ζ_k⁴ and κ_kl = E ζ_k² ζ_l²; all other moments up to the fourth must vanish.
First derivatives are the analytic tangent; higher ones are differences of exact errors at half and one standard deviation
from the means.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from precision_pin.analyses.moments.uncorrelated import STEP, ErrorAround, Uncorrelated
from precision_pin.base.arrays import Array
from precision_pin.model.pose_model import PoseModel


@final
@dataclass(frozen=True, eq=False)
class ClosedMoments:
    """Mean and covariance of the exact error from the truncated series.

    Attributes
    ----------
    mean, covariance
        ``(6,)`` mean and ``(6, 6)`` covariance.
    order
        Order of the last terms, in powers of the spread: 4, or 2 where moments of the draws are unknown.
    last_mean
        Terms of the mean beyond the second order (order 4), or of the second order (order 2).
    last_covariance
        Terms of the covariance beyond the second order; ``None`` at order 2, where there are none.
    """

    mean: Array
    covariance: Array
    order: int
    last_mean: Array
    last_covariance: Array | None


def closed_moments(at: PoseModel) -> ClosedMoments:
    """Return mean and covariance of the exact error at a pose.

    Raises
    ------
    InputError
        The exact error does not exist one standard deviation from the means.
    """
    numbers = Uncorrelated.of(at.space)
    exact = ErrorAround(at)
    middle = exact.at(np.zeros((at.space.size, 1)))[:, 0]
    near = [exact.at(sign * STEP * numbers.columns) for sign in (1, -1)]
    far = [exact.at(sign * 2 * STEP * numbers.columns) for sign in (1, -1)]
    # five points, because the error of three points would be of the fourth order
    second = (16 * (near[0] + near[1]) - (far[0] + far[1]) - 30 * middle[:, None]) / (12 * STEP**2)
    curved = second.sum(axis=1) / 2
    if not numbers.known.all():
        return ClosedMoments(middle + curved, at.covariance.copy(), 2, curved, None)
    first = at.jacobian @ numbers.columns
    third = (far[0] - 2 * near[0] + 2 * near[1] - far[1]) / (2 * STEP**3)
    fourth = (far[0] - 4 * near[0] + 6 * middle[:, None] - 4 * near[1] + far[1]) / STEP**4
    skewness, kurtosis = numbers.third, numbers.fourth
    pairs = numbers.pairs - 1
    np.fill_diagonal(pairs, kurtosis - 1)
    last_mean = third @ skewness / 6 + fourth @ kurtosis / 24
    last = second @ pairs @ second.T / 4
    slopes = third * kurtosis
    for k in range(numbers.size - 1):
        others = np.arange(k + 1, numbers.size)
        own, theirs = STEP * numbers.columns[:, [k]], STEP * numbers.columns[:, others]
        both = exact.at(np.concatenate([own + theirs, own - theirs, -own + theirs, -own - theirs], axis=1))
        pp, pm, mp, mm = np.split(both, 4, axis=1)
        plus, minus = near[0][:, [k]], near[1][:, [k]]
        mixed = (pp - pm - mp + mm) / (4 * STEP**2)
        weight = numbers.pairs[k, others]
        # each pair is visited once, not in both orders
        last += (mixed * weight) @ mixed.T
        slopes[:, k] += 3 * (((pp + pm - 2 * plus) - (mp + mm - 2 * minus)) / (2 * STEP**3)) @ weight
        bent = (pp + mp - 2 * near[0][:, others]) - (pm + mm - 2 * near[1][:, others])
        slopes[:, others] += 3 * weight * bent / (2 * STEP**3)
        around = plus + minus + near[0][:, others] + near[1][:, others]
        last_mean += ((pp + pm + mp + mm - 2 * around + 4 * middle[:, None]) / STEP**4) @ weight / 4
    crossed = first @ (second * skewness / 2 + slopes / 6).T
    last += crossed + crossed.T
    last = (last + last.T) / 2
    return ClosedMoments(middle + curved + last_mean, at.covariance + last, 4, last_mean, last)
