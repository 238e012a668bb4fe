"""Bounds of the errors of a map's closed form: laws that are not normal, and terms of second and higher order.

Let v be the position error, the attitude error or one component of them, to first order ``v = m + Σ j_c x_c`` with the
draws' deviations x_c, and ``Q = |v|²``. The closed form takes v as normal. For any laws:

- Mean and variance of Q follow from the draws' cumulants up to the fourth; with them Cantelli's one-sided inequality
  bounds Q from both sides. A rare value shows in the fourth cumulant.
- A law is sub-Gaussian with proxy s² if E exp(t x) ≤ exp(t² s²/2); laws with tails no heavier than normal ones are with
  their variance, any law within an interval of length r with r²/4 (Hoeffding, JASA 58, 1963). Then E exp(t Q) is at
  most that of a normal vector with these variances, and the probability beyond x at most its least exp(K(t) - t x).
- |v| is at most ``|m| + Σ |j_c| max |x_c|``.
- Replacing the draws that are not normal by normal ones, one at a time (Lindeberg), beside a normal part with
  covariance G, changes the probability of any set by at most ``Σ c_3/6 E|x|³ b³ + c_4/24 (E x⁴ + 3 σ⁴) b⁴``, b the
  length of j_c in the metric of G⁻¹ and c_k = E|He_k(Z)|/2, the largest k-th derivative of a normal probability along a
  unit vector.

The exact error differs from first order by a remainder r. Places whose displacements turn by δ_j and move the tip by
u_k, in chain order, add ``Σ_(j<k) δ_j × u_k`` to second order, and each adds its own. Let a_c and h_c bound how far a
unit of x_c turns and moves. The products of different draws have a root of the second moment of at most ``√(AA HH +
AH²)``, with ``AH = Σ a_c h_c σ_c²`` and so on, and of the fourth moment of at most Λ times that: a polynomial of degree
2 in independent numbers is hypercontractive, with Λ = 3 for symmetric numbers with a kurtosis up to 9 and 12 √kurtosis
for others (O'Donnell, Analysis of Boolean Functions, 10.2). Squares, third order and heavy laws are bounded by Hölder's
and Minkowski's inequalities with the eighth moments; what products and formulas add beyond first order is estimated
from drawn robots. By Markov's inequality |r| exceeds ``‖r‖₄ η^(-1/4)`` with a probability of at most η.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from precision_pin.analyses.map.normal_norms import (
    norm_probabilities,
    norm_quantiles,
    norm_tail_bounds,
    norm_tail_quantiles,
    principal_axes,
)
from precision_pin.base.arrays import Array, Fixed, field_names
from precision_pin.draws.correlation import BlockCovariance
from precision_pin.draws.laws import FARTHEST_NORMAL, Law
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import Tangents
from precision_pin.terms.table import TermTable

_SCORES: Final = np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, 4001)
_WEIGHTS: Final = np.exp(-(_SCORES**2) / 2) / np.exp(-(_SCORES**2) / 2).sum()
_NORMAL_EIGHTH: Final = 105 ** (1 / 8)
# c_3/6, rounded up: E|Z³ - 3Z|/2 = (1 + 4 exp(-3/2))/√(2π) = 0.75499
_THIRD: Final = 0.7549 / 6
_FOURTH: Final = 1.4008 / 24
# fraction of the tail beyond a quantile reserved for remainders
_OF_TAIL: Final = 0.05
_REMAINDERS: Final = (1e-2, 1e-3, 1e-4)
_FLAT: Final = 1e-12

# terms, components and the derivative of the product of one with respect to the other
_Slopes = tuple[NDArray[np.intp], NDArray[np.intp], Array]


@final
@dataclass(frozen=True, eq=False)
class LawShapes(Fixed):
    """Moments of the d numbers of a space about their means, powers of SI units, ``(d,)`` each.

    Attributes:
        normal: Covariance of the numbers whose sums are normal.
        proxy: Covariance with which a normal vector has exponential moments at least as large.
        third, fourth_cumulant: Cumulants of numbers independent of all others. For numbers drawn together the first is
            0 and the second a bound of what each adds to that of their sum.
        together: E|x|³ of numbers drawn together, times the square of their count; 0 for others.
        replaced_third, replaced_fourth: E|x|³ and ``E x⁴ + 3 σ⁴``, or bounds of them; 0 for normal numbers.
        eighth: Bound of ``(E x⁸)^(1/8)``.
        farthest: Largest deviation in any sample.
        groups: Group of numbers that depend on one another.
        chaos: The constant Λ of these laws.
    """

    space: Space
    normal: BlockCovariance
    proxy: BlockCovariance
    third: Array
    fourth_cumulant: Array
    together: Array
    replaced_third: Array
    replaced_fourth: Array
    eighth: Array
    farthest: Array
    groups: NDArray[np.intp]
    chaos: float
    _products: dict[int, tuple[TermTable, _Slopes, Array, Array]] = field(default_factory=dict)

    @classmethod
    def of(cls, space: Space) -> LawShapes:
        """Return the moments of the draws of a space."""
        correlated = {name: group.names for group in space.correlations for name in group.names}
        laws = {draw.name: draw.law for draw in space.draws}
        whole = space.block_covariance
        arrays = np.zeros((7, space.size))
        normal, proxies = np.zeros(space.size), np.ones(space.size)
        groups, chaos = np.zeros(space.size, dtype=np.intp), 3.0
        numbers: dict[tuple[str, ...], int] = {}
        for draw, columns in zip(space.draws, space.slices, strict=True):
            law, group = draw.law, correlated.get(draw.name, ())
            many = len(group) or law.size
            is_normal = all(laws[name].is_normal for name in group or (draw.name,))
            # laws of several numbers with light tails are symmetric about their mean, and elliptic
            light = is_normal or (law.cumulants() is None and not group)
            ends = np.array([law.interval(k) for k in range(law.size)])
            far = np.abs(ends - law.mean_vector[:, None]).max(axis=1)
            variance = np.diag(law.covariance).clip(0.0)
            third, fourth, eighth = _moments(law, np.sqrt(variance), far)
            absolute = np.zeros_like(third) if light else many**2 * np.sqrt(variance * fourth)
            arrays[:, columns] = (
                (third, fourth - 3 * variance**2, 0 * third, np.abs(third))
                if many == 1
                else (0 * third, (not light) * many**3 * fourth, absolute, absolute)
            ) + ((not is_normal) * many**3 * (fourth + 3 * variance**2), eighth, far)
            normal[columns] = is_normal
            groups[columns] = numbers.setdefault(group or (draw.name,), len(numbers))
            kurtosis = float((fourth / np.where(variance > 0, variance, 1.0) ** 2).max(initial=0.0))
            if not (light or (many == 1 and kurtosis <= 9 and (np.abs(third) <= 1e-9 * variance**1.5).all())):
                chaos = max(chaos, 12 * many**2 * np.sqrt(kurtosis))
            if not light:
                spans = (ends[:, 1] - ends[:, 0]) ** 2 / 4
                proxies[columns] = many * np.maximum(spans / np.where(variance > 0, variance, spans + 1e-300), 1.0)
        kept = tuple((columns, block) for columns, block in whole.blocks if (proxies[columns] == 1).all())
        proxy = BlockCovariance(whole.variances * proxies, kept) if (proxies > 1).any() else whole
        third, cumulant, together, replaced_third, replaced_fourth, eighth, farthest = arrays
        moments = third, cumulant, together, replaced_third, replaced_fourth, eighth, farthest
        return cls(space, whole.scaled(normal), proxy, *moments, groups, chaos)

    @property
    def is_normal(self) -> bool:
        """Whether sums of all numbers are normal."""
        return not self.replaced_fourth.any()

    def _beyond(self, table: TermTable) -> tuple[_Slopes, Array, Array]:
        """Return the products' slopes, and the roots of the 8th and 4th moments beyond first order, ``(T,)``."""
        known = self._products.get(id(table.program))
        if known is not None:
            return known[1:]
        mean = self.space.mean[:, None]
        change = self.space.sample(0, 0, min(4096, max(256, 2**22 // max(len(mean), 1)))) - mean
        beyond = table.products(table.program.evaluate(change + mean))
        beyond = beyond - table.products(table.program.evaluate(mean))
        slopes = table.product_slopes(self.space.mean)
        for term, component, slope in zip(*slopes, strict=True):
            beyond[term] -= slope * change[component]
        scale = np.maximum(np.abs(beyond).max(axis=1, initial=0.0), 1e-300)
        eighth, fourth = (scale * ((beyond / scale[:, None]) ** k).mean(axis=1) ** (1 / k) for k in (8, 4))
        self._products[id(table.program)] = table, slopes, eighth, fourth
        return slopes, eighth, fourth

    def remainders(self, chunk: Tangents) -> Array:
        """Return bounds ``(2, P)`` of the root of the fourth moment of the remainders of position and attitude."""
        (terms, components, slopes), eighth, fourth = self._beyond(chunk.table)
        # few of the products of draws and terms are nonzero
        turn, move = (_sums(np.abs(slopes)[:, None] * arms[terms], components, len(self.groups)) for arms in chunk.arms)
        variance = self.space.block_covariance.variances
        count = int(self.groups.max(initial=-1)) + 1
        turns, moves = (_sums(self.eighth[:, None] * of, self.groups, count) for of in (turn, move))
        all_turns = turns.sum(axis=0) + eighth @ chunk.arms[0]
        found = []
        for arm, by_group, of in ((move, moves, chunk.arms[1]), (turn, turns, chunk.arms[0])):
            every = by_group.sum(axis=0) + eighth @ of
            pairs = np.sqrt((variance @ turn**2) * (variance @ arm**2) + (variance @ (turn * arm)) ** 2)
            beyond = every * (all_turns**2 + eighth @ chunk.arms[0])
            second = self.chaos * pairs + (turns * by_group).sum(axis=0) + beyond
            found.append(np.minimum(second, all_turns * every) + fourth @ of)
        return np.stack(found)

    def vectors(self, chunk: Tangents, covariance: Array, remainders: Array, rows: tuple[int, ...]) -> Vectors:
        """Return position (rows 0, 1, 2), attitude (3, 4, 5) or one component (one row) at the poses of a chunk."""
        chosen = list(rows)
        jacobian, mean = chunk.jacobian[chosen], chunk.error[chosen]
        own = covariance[np.ix_(chosen, chosen)]
        lengths = np.sqrt((jacobian**2).sum(axis=0))
        squares = lengths**2
        along = np.einsum("kdp,kp->dp", jacobian, mean)
        size = np.sqrt((mean**2).sum(axis=0))
        spread = 2 * (own**2).sum(axis=(0, 1)) + 4 * np.einsum("ip,ijp,jp->p", mean, own, mean)
        spread += 4 * (self.third @ (along * squares)) + self.fourth_cumulant @ squares**2
        spread += 4 * size * (self.together @ lengths**3)
        full, proxy = np.zeros((2, 3, 3, mean.shape[1]))
        first = np.ix_(range(len(rows)), range(len(rows)))
        full[first] = own
        proxy[first] = own if self.proxy is self.space.block_covariance else _between(self.proxy, jacobian)
        middle = np.zeros((3, mean.shape[1]))
        middle[: len(rows)] = mean
        return Vectors(
            mean=middle,
            covariance=full,
            proxy=proxy,
            square_spread=np.sqrt(np.maximum(spread, 0.0)),
            replaced=np.zeros(len(size)) if self.is_normal else self._replaced(jacobian, own),
            farthest=size + self.farthest @ lengths,
            remainder=remainders[int(rows[0] >= 3)],
        )

    def _replaced(self, jacobian: Array, covariance: Array) -> Array:
        """Return the largest change of a probability if the draws were normal, ``(P,)``."""
        values, vectors = np.linalg.eigh(np.moveaxis(_between(self.normal, jacobian), -1, 0))
        least = _FLAT * np.maximum(np.einsum("iip->p", covariance), 1e-300)
        other = self.replaced_fourth > 0
        turned = np.einsum("pik,idp->kdp", vectors, jacobian[:, other])
        lengths = np.sqrt((turned**2 / np.maximum(values.T, least)[:, None]).sum(axis=0))
        found = _THIRD * (self.replaced_third[other] @ lengths**3)
        found += _FOURTH * (self.replaced_fourth[other] @ lengths**4)
        return np.minimum(found, 1.0)


def _sums(rows: Array, numbers: NDArray[np.intp], count: int) -> Array:
    """Return the sums of the rows ``(k, P)`` of each number below ``count``, ``(count, P)``."""
    order = np.argsort(numbers, kind="stable")
    begins = np.flatnonzero(np.diff(numbers[order], prepend=-1))
    result = np.zeros((count, rows.shape[1]))
    if len(begins):
        result[numbers[order[begins]]] = np.add.reduceat(rows[order], begins, axis=0)
    return result


def times_each(covariance: BlockCovariance, jacobian: Array) -> Array:
    """Return ``Σ Jᵀ``, ``(d, r, P)``, for slopes ``(r, d, P)``."""
    rows, components, poses = jacobian.shape
    columns = np.moveaxis(jacobian, 1, 0).reshape(components, rows * poses)
    return covariance.times(columns).reshape(components, rows, poses)


def _between(covariance: BlockCovariance, jacobian: Array) -> Array:
    return np.einsum("idp,djp->ijp", jacobian, times_each(covariance, jacobian))


def _moments(law: Law, std: Array, far: Array) -> tuple[Array, Array, Array]:
    """Return E x³, E x⁴ and a bound of ``(E x⁸)^(1/8)`` of each number of a law, ``(size,)``."""
    eighth = (far**6 * std**2) ** (1 / 8)
    if law.is_normal:
        return 0 * std, 3 * std**4, _NORMAL_EIGHTH * std
    known = law.standardised_moments() if law.size == 1 else None
    if known is not None:
        values = np.abs(law.at_scores(_SCORES[None])[0] - law.mean_vector[0]) / max(float(std[0]), 1e-300)
        eighth = np.minimum(eighth, 1.02 * std * float(_WEIGHTS @ values**8) ** (1 / 8))
        return known[0] * std**3, known[1] * std**4, eighth
    cumulants = law.cumulants()
    if cumulants is None:
        return 0 * std, 3 * std**4, np.minimum(eighth, _NORMAL_EIGHTH * std)
    return cumulants[1], cumulants[2] + 3 * std**4, eighth


@final
@dataclass(frozen=True, eq=False)
class Vectors(Fixed):
    """Errors at P poses, each a vector with up to three components.

    Attributes:
        mean, covariance: ``(3, P)`` and ``(3, 3, P)``, zero beyond the components.
        proxy: A covariance so large that a normal vector has the larger exponential moments, ``(3, 3, P)``.
        square_spread: Standard deviation of the square, ``(P,)``; an upper bound where numbers are drawn together.
        replaced: Largest difference between the probability of any set and that of the normal law, ``(P,)``.
        farthest: Largest length in any sample, ``(P,)``.
        remainder: Bound of the root of the fourth moment of the terms beyond first order, ``(P,)``.
    """

    mean: Array
    covariance: Array
    proxy: Array
    square_spread: Array
    replaced: Array
    farthest: Array
    remainder: Array

    @classmethod
    def joined(cls, parts: Sequence[Vectors]) -> Vectors:
        """Return the errors at the poses of all parts."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in field_names(Vectors)))

    def of(self, part: slice) -> Vectors:
        """Return the errors at some of the poses."""
        return Vectors(*(getattr(self, name)[..., part] for name in field_names(Vectors)))

    @cached_property
    def axes(self) -> tuple[Array, Array]:
        """Variances and means along the principal axes, ``(3, P)`` each."""
        return principal_axes(self.mean, self.covariance)

    @cached_property
    def square_mean(self) -> Array:
        """Mean of the square, ``(P,)``."""
        return (self.mean**2).sum(axis=0) + np.einsum("iip->p", self.covariance)

    @cached_property
    def _heavier(self) -> tuple[Array, Array]:
        return principal_axes(self.mean, self.proxy)

    def quantile_bounds(self, level: float, quantile: Array) -> Array:
        """Return bounds of the quantile of the length, ``(2, P)``, given the quantile of the normal law ``(P,)``."""
        left = _OF_TAIL * (1 - level)
        beyond = self.remainder * left ** (-1 / 4)
        above, below = level + left, level - left
        square, spread = self.square_mean, self.square_spread
        high = np.minimum(np.sqrt(square + spread * np.sqrt(above / (1 - above))), self.farthest)
        high = np.minimum(high, norm_tail_quantiles(*self._heavier, 1 - above))
        low = np.sqrt(np.maximum(square - spread * np.sqrt((1 - below) / below), 0.0))
        near = self.replaced < 1 - above
        if near.any():
            axes, change = (self.axes[0][:, near], self.axes[1][:, near]), self.replaced[near]
            start = level, quantile[near]
            high[near] = np.minimum(high[near], norm_quantiles(*axes, above + change, start))
            low[near] = np.maximum(low[near], norm_quantiles(*axes, np.maximum(below - change, 1e-6), start))
        return np.stack([np.maximum(low - beyond, 0.0), high + beyond])

    def share_bounds(self, limit: float) -> Array:
        """Return bounds of the probability that the length is at most ``limit``, ``(2, P)``."""
        low, high = np.zeros_like(self.farthest), np.ones_like(self.farthest)
        square, variance = self.square_mean, self.square_spread**2
        for left in _REMAINDERS:
            beyond = self.remainder * left ** (-1 / 4)
            inner, outer = np.maximum(limit - beyond, 0.0), limit + beyond
            room, lack = np.maximum(inner**2 - square, 0.0), np.maximum(square - outer**2, 0.0)
            kept = np.where(room > 0, room**2 / np.maximum(variance + room**2, 1e-300), 0.0)
            kept = np.maximum(kept, 1 - norm_tail_bounds(*self._heavier, inner))
            kept = np.maximum(kept, norm_probabilities(*self.axes, inner) - self.replaced)
            kept = np.where(self.farthest <= inner, 1.0, kept)
            most = np.where(lack > 0, variance / np.maximum(variance + lack**2, 1e-300), 1.0)
            most = np.minimum(most, norm_probabilities(*self.axes, outer) + self.replaced)
            low, high = np.maximum(low, kept - left), np.minimum(high, most + left)
        return np.stack([low, high])

    def gamma_quantiles(self, level: float) -> tuple[Array, Array]:
        """Return estimates of a quantile of the length, ``(P,)`` each: for these laws, and for normal ones.

        The square is approximated by a gamma number with its mean and variance.
        """
        normal = 2 * (self.covariance**2).sum(axis=(0, 1))
        normal += 4 * np.einsum("ip,ijp,jp->p", self.mean, self.covariance, self.mean)
        found = []
        for variance in (self.square_spread**2, normal):
            shape = self.square_mean**2 / np.maximum(variance, 1e-12 * self.square_mean**2 + 1e-300)
            found.append(np.sqrt(special.gammaincinv(shape, level) / np.maximum(shape, 1e-300) * self.square_mean))
        return found[0], found[1]
