"""Mean and covariance of the exact error from its derivatives at the means: no sampling.

With ζ numbers of mean 0 and covariance I of which the components are an affine map, and f_k, f_kl, … the derivatives of
the exact error to them at 0, the Taylor series gives (GUM, JCGM 100:2008, 5.1.2 note, carried on to the fourth order)

    E f   = f + Σ f_kk/2 + Σ f_kkk s_k/6 + [Σ f_kkkk q_k + Σ_(k≠l) 3 f_kkll κ_kl]/24 + …
    Cov f = Σ f_k f_kᵀ + sym Σ f_k f_kkᵀ s_k/2
            + [Σ f_kk f_kkᵀ (q_k - 1) + Σ_(k≠l) (f_kk f_llᵀ (κ_kl - 1) + 2 f_kl f_klᵀ κ_kl)]/4
            + sym Σ f_k (f_kkk q_k + Σ_(l≠k) 3 f_kll κ_kl)ᵀ/6 + …

where sym A = A + Aᵀ, s_k = E ζ_k³, q_k = E ζ_k⁴ and κ_kl = E ζ_k² ζ_l²; all other moments up to the fourth must vanish.
First derivatives are the analytic tangent, the higher ones differences of exact errors half and one standard deviation
from the means.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin import kernel
from precision_pin.errors import InputError
from precision_pin.laws import FARTHEST_NORMAL, Circle, Disc, JointNormal, Law, Normal, Rows
from precision_pin.model import PoseModel
from precision_pin.space import Space

__all__ = ["ClosedMoments", "closed_moments"]

Array = NDArray[np.float64]

STEP: Final = 0.5
"""Of the differences, standard deviations."""

_FLAT: Final = 1e-12
_PANELS: Final = 36
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


@final
@dataclass(frozen=True, eq=False)
class ClosedMoments:
    """Mean and covariance of the exact error, as far as the series goes.

    Attributes
    ----------
    mean, covariance
        ``(6,)`` and ``(6, 6)``.
    order
        Of the last terms, in powers of the spread: 4, or 2 where moments of the draws are not known.
    last_mean
        The terms beyond the second order of the mean (order 4), or of the second order (order 2).
    last_covariance
        The terms beyond the second order of the covariance; ``None`` at order 2, where there are none.
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
    numbers = _Uncorrelated.of(at.space)
    exact = _Exact(at)
    middle = exact.at(np.zeros((at.space.size, 1)))[:, 0]
    near = [exact.at(sign * STEP * numbers.columns) for sign in (1, -1)]
    far = [exact.at(sign * 2 * STEP * numbers.columns) for sign in (1, -1)]
    # five points: the error of three would be of the fourth order itself
    second = (16 * (near[0] + near[1]) - (far[0] + far[1]) - 30 * middle[:, None]) / (12 * STEP**2)
    curved = second.sum(axis=1) / 2
    if not numbers.is_complete:
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
        # of the two orders of a pair one is gone through
        last += (mixed * weight) @ mixed.T
        slopes[:, k] += 3 * (((pp + pm - 2 * plus) - (mp + mm - 2 * minus)) / (2 * STEP**3)) @ weight
        bent = (pp + mp - 2 * near[0][:, others]) - (pm + mm - 2 * near[1][:, others])
        slopes[:, others] += 3 * weight * bent / (2 * STEP**3)
        around = plus + minus + near[0][:, others] + near[1][:, others]
        last_mean += ((pp + pm + mp + mm - 2 * around + 4 * middle[:, None]) / STEP**4) @ weight / 4
    crossed = first @ (second * skewness / 2 + slopes / 6).T
    last += crossed + crossed.T
    return ClosedMoments(middle + curved + last_mean, at.covariance + last, 4, last_mean, last)


@final
class _Exact:
    """The exact error around the means."""

    def __init__(self, at: PoseModel) -> None:
        self._layout = kernel.compile_table(at)
        self._mean = at.space.mean[:, None]

    def at(self, deviations: Array) -> Array:
        try:
            return kernel.errors_at(self._layout, "exact", self._mean + deviations)
        except InputError as error:
            reason = error.findings[0].message.partition(": ")[2]
            raise InputError(
                f"one standard deviation from the means the exact error does not exist ({reason}); "
                "closed forms are no use for such wide draws"
            ) from None


@final
@dataclass(frozen=True, eq=False)
class _Uncorrelated:
    """Numbers ζ of mean 0 and covariance I, of which the components are an affine map.

    Attributes
    ----------
    columns
        ``(d, K)``, what each moves the components by.
    third, fourth
        ``(K,)`` their moments.
    pairs
        ``(K, K)`` E ζ_k² ζ_l²; the diagonal is not used.
    is_complete
        Whether all moments up to the fourth are known, and others than these vanish.
    """

    columns: Array
    third: Array
    fourth: Array
    pairs: Array
    is_complete: bool

    @property
    def size(self) -> int:
        """K."""
        return self.columns.shape[1]

    @classmethod
    def of(cls, space: Space) -> _Uncorrelated:
        """Return the numbers behind a space's components."""
        laws = {draw.name: draw.law for draw in space.draws}
        together = {name for correlation in space.correlations for name in correlation.names}
        groups = [[space.index[name] for name in correlation.names] for correlation in space.correlations]
        moments = [
            _NORMAL if all(isinstance(laws[name], Normal) for name in correlation.names) else None
            for correlation in space.correlations
        ]
        for draw, rows in zip(space.draws, space.slices, strict=True):
            if draw.name not in together:
                groups.append(list(range(rows.start, rows.stop)))
                moments.append(_moments(draw.law))
        columns, third, fourth, pairs = [], [], [], []
        for group, known in zip(groups, moments, strict=True):
            spread = space.covariance[np.ix_(group, group)]
            values, vectors = np.linalg.eigh(spread)
            varies = values > _FLAT * max(values.max(), 0.0)
            count = int(varies.sum())
            if not count:
                continue
            moved = np.zeros((space.size, count))
            moved[group] = vectors[:, varies] * np.sqrt(values[varies])
            skewness, kurtosis, across = _NORMAL if known is None else known
            columns.append(moved)
            # an axis of a single number may point downwards
            third += [skewness * (np.sign(moved.sum()) if len(group) == 1 else 1.0)] * count
            fourth += [kurtosis] * count
            pairs.append(np.full((count, count), across))
        size = len(third)
        matrix = np.ones((size, size))
        begin = 0
        for block in pairs:
            matrix[begin : begin + len(block), begin : begin + len(block)] = block
            begin += len(block)
        return cls(
            np.concatenate([np.zeros((space.size, 0)), *columns], axis=1),
            np.array(third, dtype=float),
            np.array(fourth, dtype=float),
            matrix,
            all(known is not None for known in moments),
        )


_Moments = tuple[float, float, float]
"""E ζ³, E ζ⁴ of standardised numbers and E ζ_k² ζ_l² of two of them."""

_NORMAL: Final[_Moments] = (0.0, 3.0, 1.0)
_DISC: Final[_Moments] = (0.0, 2.0, 2 / 3)
"""Of variance r²/4: E x⁴ = r⁴/8, E x² y² = r⁴/24."""
_CIRCLE: Final[_Moments] = (0.0, 1.5, 0.5)
"""Of variance r²/2: E x⁴ = 3 r⁴/8, E x² y² = r⁴/8."""


def _moments(law: Law) -> _Moments | None:
    """Return the moments of a law; ``None`` where they are not known, or where others than these do not vanish."""
    match law:
        case JointNormal():
            return _NORMAL
        case Disc():
            return _DISC
        case Circle():
            return _CIRCLE
        case _ if law.size > 1:
            return None
        case Rows():
            return _standardised(law.array[:, 0], np.full(len(law.array), 1 / len(law.array)))
        case _:
            # Gauss-Legendre in normal scores, cut where the law jumps or bends
            bends = special.ndtri(np.array(law.breaks, dtype=float))
            bends = bends[np.abs(bends) < FARTHEST_NORMAL]
            edges = np.union1d(np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, _PANELS + 1), bends)
            half = np.diff(edges)[:, None] / 2
            z = (edges[:-1, None] + half * (_NODES + 1)).ravel()
            weights = (half * _WEIGHTS).ravel() * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
            return _standardised(law.at_scores(z[None])[0], weights)


def _standardised(values: Array, weights: Array) -> _Moments:
    """Return moments of single numbers with weights; those of nothing that varies do not matter."""
    deviations = values - weights @ values
    variance = float(weights @ deviations**2)
    if variance <= 0:
        return _NORMAL
    third, fourth = (float(weights @ deviations**power) / variance ** (power / 2) for power in (3, 4))
    return third, fourth, 1.0
