"""Moments and shares of the first-order model at many poses, and bounds of the exact error's law.

Bounds of the errors of a map's closed form: laws that are not normal, and terms of second and higher order.

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

Lengths of many normal vectors at once: :class:`precision_pin.analyses.number_law.NormalNorm` computes the
same law for one vector to twelve digits; a map needs it for thousands. With λ and m the variances and means along the
principal axes, ``Q = |v|²`` has the cumulant generating function ``K(t) = Σ [m² t/(1 - 2λt) - ln(1 - 2λt)/2]``, and
``P(Q > x) = 1/(2πi) ∫ exp(K(t) - t x)/t dt`` on a path that crosses the real axis between 0 and 1/(2 max λ); crossing
it below 0 gives ``-P(Q ≤ x)``. The path is the parabola of steepest descent from the saddle point ``K'(t) = x``
(Daniels, Annals of Mathematical Statistics 25, 1954; Rice, SIAM Journal on Scientific and Statistical Computing 1,
1980), moved away from the pole where the two are close. The integrand falls like a normal density along it, so that the
trapezoidal rule converges exponentially.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from precision_pin.analyses.shares import SourceLine
from precision_pin.base.arguments import check_instance, check_memory
from precision_pin.base.arrays import Array, Fixed, field_names
from precision_pin.base.errors import add, warns_at_end
from precision_pin.draws.correlation import BlockCovariance
from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import FARTHEST_NORMAL, Law
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel, Tangents, tangents
from precision_pin.robot.chain import pose_findings
from precision_pin.terms.table import TermTable


@dataclass(frozen=True, eq=False)
class FirstOrder(Fixed):
    """First-order moments at P poses, base axes, m and rad.

    Attributes:
        mean: Error with every component at its mean, ``(6, P)``.
        covariance: ``J Σ Jᵀ``, ``(6, 6, P)``.
        shares: Fraction of each line of sources in the variance of the position, ``(lines, P)``: ``Cov(e_k, e)`` of its
            part of the error, the Shapley value of the variance of a sum, and the Shapley effect of its numbers in a
            draw divided among lines; zero where the position does not vary.
        relative_mean, relative_covariance: The same for errors relative to the reference, ``(6, P)``, ``(6, 6, P)``;
            empty without one.
        vectors: Each requested vector of rows of the error, with the bounds of its law.
    """

    mean: Array
    covariance: Array
    shares: Array
    relative_mean: Array
    relative_covariance: Array
    vectors: tuple[Vectors, ...] = ()


def shared_covariance(space: Space, scopes: Sequence[Scope] = (Scope.UNIT,)) -> BlockCovariance:
    """Return the covariance of the draws of some scopes alone, by default those shared by a robot's poses."""
    shared = np.repeat([draw.scope in scopes for draw in space.draws], [draw.law.size for draw in space.draws])
    return space.block_covariance.scaled(shared.astype(float))


def first_order(
    error_model: ErrorModel,
    values: Array,
    approaches: NDArray[np.int8] | None,
    lines: Sequence[SourceLine],
    reference: PoseModel | None,
    step: Callable[[int], object],
    vectors: Sequence[tuple[int, ...]] = (),
) -> FirstOrder:
    """Return the moments at poses ``(n, P)``.

    Args:
        values, approaches: From :meth:`ErrorModel.configurations` and :meth:`ErrorModel.approaches_of`.
        lines: Lines of the shares.
        reference: The model at the pose where the robot is taught; ``None`` for absolute errors alone.
        step: Called with the number of poses done since the last call.
        vectors: Rows of each vector whose law is to be bounded: those of position or attitude, or a single one.

    Raises:
        InputError: An error is too large to compute with.
    """
    space = error_model.space
    whole, own = space.block_covariance, shared_covariance(space)
    at_reference = None if reference is None else reference.tangent
    parts: list[FirstOrder] = []
    shapes = LawShapes.of(space) if vectors else None
    begin = 0
    for chunk in tangents(error_model.at_columns(values, approaches)):
        poses = chunk.error.shape[1]
        spread = times_each(whole, chunk.jacobian)
        covariance = np.einsum("idp,djp->ijp", chunk.jacobian, spread)
        by_component = np.einsum("idp,dip->dp", chunk.jacobian[:3], spread[:, :3])
        total = np.einsum("iip->p", covariance[:3, :3])
        shares = np.array([_part(line, chunk.jacobian[:3], by_component) for line in lines]).reshape(-1, poses)
        shares = np.where(total > 0, shares / np.where(total > 0, total, 1.0), 0.0)
        relative_mean, relative_covariance = np.zeros((6, 0)), np.zeros((6, 6, 0))
        if at_reference is not None and reference is not None:
            error, jacobian = at_reference
            relative_mean = chunk.error - error[:, None]
            between = np.einsum("idp,dj->ijp", chunk.jacobian, own.times(jacobian.T))
            relative_covariance = covariance + whole.between(jacobian, jacobian)[:, :, None]
            relative_covariance -= between + between.swapaxes(0, 1)
            same = (values[:, begin : begin + poses] == reference.posture.q[:, None]).all(axis=0)
            if same.any():
                # draws of pose scope are shared too; the approach may differ, and with it the derivatives
                relative_covariance[:, :, same] = _at_the_same_pose(space, chunk.jacobian[:, :, same], jacobian)
        bounded: tuple[Vectors, ...] = ()
        if shapes is not None:
            remainders = shapes.remainders(chunk)
            bounded = tuple(shapes.vectors(chunk, covariance, remainders, rows) for rows in vectors)
        parts.append(FirstOrder(chunk.error, covariance, shares, relative_mean, relative_covariance, bounded))
        begin += poses
        step(poses)
    fields = ("mean", "covariance", "shares", "relative_mean", "relative_covariance")
    joined = tuple(map(Vectors.joined, zip(*(part.vectors for part in parts), strict=True)))
    arrays = {name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in fields}
    return FirstOrder(vectors=joined, **arrays)


def _part(line: SourceLine, jacobian: Array, by_component: Array) -> Array:
    """Return a line's part of the variance of the position ``(P,)``, for slopes ``(3, d, P)`` and components' parts."""
    part: Array = by_component[line.columns].sum(axis=0)
    for _, columns, form in line.parts:
        slopes = jacobian[:, columns]
        part = part + np.einsum("idp,dip->p", slopes, np.tensordot(form, slopes, (1, 1)))
    return part


def _at_the_same_pose(space: Space, jacobian: Array, reference: Array) -> Array:
    """Return the covariance of the error minus that of the reference at its joint values, ``(6, 6, P)``."""
    kept, anew = shared_covariance(space, (Scope.UNIT, Scope.POSE)), shared_covariance(space, (Scope.VISIT,))
    change = jacobian - reference[:, :, None]
    own = np.einsum("idp,djp->ijp", change, times_each(kept, change)) + np.einsum(
        "idp,djp->ijp", jacobian, times_each(anew, jacobian)
    )
    return own + anew.between(reference, reference)[:, :, None]


def jacobians(error_model: ErrorModel, values: Array, approaches: NDArray[np.int8] | None) -> Array:
    """Return the derivative of the error with respect to the components at poses ``(n, P)``, ``(6, d, P)``."""
    return np.concatenate([chunk.jacobian for chunk in tangents(error_model.at_columns(values, approaches))], axis=2)


@warns_at_end
def pose_covariance(error_model: ErrorModel, poses: ArrayLike | Mapping[str, ArrayLike] | Sequence[object]) -> Array:
    """Return the covariance between the errors of one robot at P poses, ``(P, 6, P, 6)``, first order, in closed form.

    ``Cov(e_p, e_q) = J_p Σ_unit J_qᵀ`` with the covariance of the draws of unit scope: a robot's draws of pose and
    visit scope at different poses are independent. For p = q it is ``J Σ Jᵀ`` of all draws. Base axes, m and rad.

    Args:
        error_model: Chain, draws and sources.
        poses: As for :func:`precision_pin.sample_poses`.

    Raises:
        InputError: Wrong poses, or more than fit into memory.
        UnknownNameError: No such pose or joint.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> print(pp.pose_covariance(model, ["paper", [0, 0, 0, 0]]).shape)
        (2, 6, 2, 6)
    """
    check_instance("error_model", error_model, ErrorModel, "as ErrorModel.load makes it")
    values, _ = error_model.configurations(poses)
    count = values.shape[1]
    check_memory(8.0 * 36 * count**2, f"the covariance between {count:,} poses", "give fewer poses")
    add(pose_findings(error_model.chain, values))
    slopes = np.moveaxis(jacobians(error_model, values, error_model.approaches_of(poses, values)), -1, 0)
    flat = slopes.reshape(6 * count, -1)
    space = error_model.space
    result = shared_covariance(space).between(flat, flat).reshape(count, 6, count, 6)
    for pose, own in enumerate(slopes):
        result[pose, :, pose] = space.block_covariance.between(own, own)
    return result


_SCORES: Final = np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, 4001)
_WEIGHTS: Final = np.exp(-(_SCORES**2) / 2) / np.exp(-(_SCORES**2) / 2).sum()
_NORMAL_EIGHTH: Final = 105 ** (1 / 8)
_FLAT: Final = 1e-12

# terms, components and the derivative of the product of one with respect to the other
_Slopes = tuple[NDArray[np.intp], NDArray[np.intp], Array]


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
        # c_3/6, rounded up: E|Z³ - 3Z|/2 = (1 + 4 exp(-3/2))/√(2π) = 0.75499
        found = (0.7549 / 6) * (self.replaced_third[other] @ lengths**3)
        found += (1.4008 / 24) * (self.replaced_fourth[other] @ lengths**4)
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
        # fraction of the tail beyond a quantile reserved for remainders
        left = 0.05 * (1 - level)
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
        # probabilities left for a remainder beyond its bound
        for left in (1e-2, 1e-3, 1e-4):
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


_NODES: Final = 32
_STEP: Final = 0.15
_PARAMETER: Final = (np.arange(_NODES) + 0.5)[:, None] * _STEP
# distances of the nodes on half of the path from the real axis, ``(nodes, 1)``, in units of 1/√K''
_ACROSS: Final = np.sinh(_PARAMETER)
_PATH_WEIGHTS: Final = np.cosh(_PARAMETER) * (_STEP / np.pi)
# largest distance from the mean, in standard deviations of the vector, at which a probability is computed
_FARTHEST: Final = 40.0
_ROUNDS: Final = 3
# relative step after which the next one is at rounding: convergence is quadratic
_CLOSE: Final = 2e-5
_ROUNDING: Final = 1e-28
# largest |s| of an argument of K: there 1 - t/end is exp(-s)
_FAR: Final = 60.0
_MOST_STEPS: Final = 100
_LAST_STEP: Final = 1e-6
# vectors whose integrals are computed together, so that their arrays stay in the processor's cache
_AT_ONCE: Final = 128


def principal_axes(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Return variances and means along the principal axes, ``(3, P)`` each, for ``(3, P)`` and ``(3, 3, P)``."""
    values, vectors = np.linalg.eigh(np.moveaxis(covariance, -1, 0))
    return np.ascontiguousarray(np.maximum(values, 0.0).T), np.einsum("pij,ip->jp", vectors, mean)


def norm_probabilities(variances: Array, means: Array, radii: Array) -> Array:
    """Return P(|v| ≤ r), ``(P,)``, for vectors in principal axes ``(3, P)`` and radii ``(P,)``; errors below 1e-7."""
    law = _Law(variances, means)
    found = law.evaluate(np.maximum(radii**2 - law.constant, 0.0))[0]
    return np.where(law.still, (radii**2 >= law.constant).astype(float), found)


def norm_quantiles(
    variances: Array, means: Array, probability: float | Array, near: tuple[float, Array] | None = None
) -> Array:
    """Return the quantile of |v|, ``(P,)``, for vectors in principal axes ``(3, P)``; relative errors below 1e-5.

    Newton's method in normal scores, from a gamma law with the first two moments of |v|²; ``near`` is a probability
    close to the requested one and its quantiles ``(P,)``, which improve the start.
    """
    law = _Law(variances, means)
    squares, spreads = law.moments
    x = special.gammaincinv(squares**2 / spreads, probability)
    if near is None:
        x *= spreads / squares
    else:
        known = np.maximum(near[1] ** 2 - law.constant, 1e-3 * squares)
        x *= known / special.gammaincinv(squares**2 / spreads, near[0])
    score, going = special.ndtri(probability), np.ones(x.shape, dtype=np.bool_)
    for _ in range(_ROUNDS):
        found, density = law.evaluate(x)
        scores = special.ndtri(np.clip(found, 1e-15, 1 - 1e-15))
        slopes = np.maximum(density, 1e-300) * np.sqrt(2 * np.pi) * np.exp(scores**2 / 2)
        # the score is nearly linear in the logarithm of x far in the tails
        change = np.where(going, np.clip((score - scores) / (slopes * x), -1.0, 1.0), 0.0)
        x = x * np.exp(change)
        going = np.abs(change) >= _CLOSE
        if not going.any():
            break
    return np.sqrt(np.where(law.still, 0.0, x) + law.constant)


def norm_tail_bounds(variances: Array, means: Array, radii: Array) -> Array:
    """Return the least exp(K(t) - t r²), a bound of P(|v| > r), ``(P,)``; arguments as for `norm_probabilities`."""
    law = _Law(variances, means)
    x = np.minimum(radii**2 - law.constant, law.farthest)
    t = np.maximum(law.saddle(x), 0.0)
    return np.where(law.still, x < 0, np.exp(law.exponent(t) - t * x))


def norm_tail_quantiles(variances: Array, means: Array, tail: float) -> Array:
    """Return the length beyond which the bound of `norm_tail_bounds` is ``tail``, ``(P,)``."""
    law = _Law(variances, means)
    wanted = -np.log(tail)

    def excess(s: Array) -> tuple[Array, Array]:
        t = law.argument(s)
        first, second = law.derivatives(t)
        below = np.maximum(t * first - law.exponent(t), 1e-300)
        return np.log(below / wanted), t * second * (law.end - t) / below

    t = law.argument(_root(excess, np.full(means.shape[1], 1.0), 0.0, _FAR))
    return np.sqrt(np.where(law.still, 0.0, law.derivatives(t)[0]) + law.constant)


def norm_quantile_slopes(mean: Array, covariance: Array, radii: Array) -> Array:
    """Return the derivative of a quantile of |v| with respect to the covariance, ``(3, 3, P)``; zeros for a constant.

    For a change dΣ the quantile, which is ``radii``, changes by the sum of the products of the entries. The probability
    is constant when x = r² changes by ``∫ exp(K - t x) dK/t dt / ∫ exp(K - t x) dt``, with ``dK = t tr(W dΣ) + 2 t² mᵀ
    W dΣ W m`` and ``W = (1 - 2 t Σ)⁻¹``. ``mean``, ``covariance``, ``radii`` are ``(3, P)``, ``(3, 3, P)``, ``(P,)``.
    """
    values, vectors = np.linalg.eigh(np.moveaxis(covariance, -1, 0))
    means = np.einsum("pij,ip->jp", vectors, mean)
    law = _Law(np.ascontiguousarray(np.maximum(values, 0.0).T), means)
    slopes = law.variance_slopes(np.maximum(radii**2 - law.constant, 0.0), means) / (2 * np.maximum(radii, 1e-300))
    return np.asarray(np.einsum("pik,klp,pjl->ijp", vectors, np.where(law.still, 0.0, slopes), vectors))


class _Law:
    """Law of |v|² minus its constant part, for vectors in principal axes ``(3, P)``."""

    def __init__(self, variances: Array, means: Array) -> None:
        largest = variances.max(axis=0)
        squares = means**2
        self.still = largest <= _ROUNDING * np.maximum(1.0, squares.sum(axis=0))
        # variance along an axis, relative to the largest, below which the vector is constant along it
        flat = variances <= 1e-14 * largest
        self.constant = np.where(flat | self.still, squares, 0.0).sum(axis=0)
        # where nothing varies, any law will do
        self._variances = np.where(self.still, 1.0, np.where(flat, 0.0, variances))
        self._squares = np.where(self.still | flat, 0.0, squares)
        self.end = 1 / (2 * self._variances.max(axis=0))
        # farther out the probability vanishes, and the saddle is indistinguishable from the pole
        most = np.sqrt(self._squares.sum(axis=0)) + _FARTHEST * np.sqrt(self._variances.sum(axis=0))
        self.farthest = most**2

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean and variance, ``(P,)``."""
        first = (self._variances + self._squares).sum(axis=0)
        return first, (2 * self._variances * (self._variances + 2 * self._squares)).sum(axis=0)

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return probability and density at ``x`` ``(P,)``."""
        x = np.minimum(x, self.farthest)
        saddle = self._crossing(x)
        density, beyond = np.empty((2, len(x)))
        for first in range(0, len(x), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            path, values = self._integrand(x, saddle, part)
            density[part] = values.imag.sum(axis=0)
            beyond[part] = (values / path).imag.sum(axis=0)
        probability: Array = np.clip(np.where(saddle[0] > 0, 1 - beyond, -beyond), 0.0, 1.0)
        return probability, density

    def variance_slopes(self, x: Array, means: Array) -> Array:
        """Return the derivative of the quantile ``x`` by the covariance in principal axes, ``(3, 3, P)``."""
        path, values = self._integrand(x, self._crossing(x), slice(None))
        wide = 1 / (1 - 2 * self._variances[:, None] * path)
        turned = means[:, None] * wide
        rates = 2 * path * turned[:, None] * turned[None] + np.eye(3)[:, :, None, None] * wide
        return np.asarray((values * rates).imag.sum(axis=2) / values.imag.sum(axis=0))

    def _integrand(
        self, x: Array, saddle: tuple[Array, Array, Array], part: slice
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the nodes of the path through a saddle from `_crossing` and the weighted integrand, ``(nodes, P)``."""
        crossing, second, third = (of[part] for of in saddle)
        width = 1 / np.sqrt(second)
        bend = third * width / (6 * second)
        # slope to which the parabola flattens: with 1 or more the integrand of a long vector may grow again
        flattening = 1 / np.sqrt(1 + (bend * _ACROSS / 0.7) ** 2)
        path, rates = np.empty((2, _NODES, len(width)), dtype=np.complex128)
        path.real, path.imag = crossing + width * bend * _ACROSS**2 * flattening, width * _ACROSS
        rates.real = width * bend * _ACROSS * _PATH_WEIGHTS * flattening * (1 + flattening**2)
        rates.imag = width * _PATH_WEIGHTS
        return path, self._transformed(path, x[part], part) * rates

    def argument(self, s: Array) -> Array:
        """Return the argument of K at which K' increases with s, from 0 to infinity."""
        return self.end * -np.expm1(-s)

    def saddle(self, x: Array) -> Array:
        """Return the argument at which the derivative of K is x, ``(P,)``."""
        least = self.derivatives(self.argument(np.full(x.shape, -_FAR)))[0]
        wanted = np.log(np.maximum(x, least))

        def excess(s: Array) -> tuple[Array, Array]:
            t = self.argument(s)
            first, second = self.derivatives(t)
            return np.log(first) - wanted, second * (self.end - t) / first

        # with equal variances and no means this is the solution
        start = wanted - np.log(self.derivatives(np.zeros(x.shape))[0])
        return self.argument(_root(excess, np.clip(start, -_FAR, _FAR), -_FAR, _FAR))

    def _crossing(self, x: Array) -> tuple[Array, Array, Array]:
        """Return where the path crosses the real axis, and the second and third derivative of K there."""
        t = self.saddle(x)
        # smallest distance of the path from the pole, in units of 1/√K''
        away = 1.0 / np.sqrt(self.derivatives(t)[1])
        left = (t < 0) | (2 * away > self.end)
        t = np.where(np.abs(t) >= away, t, np.where(left, -away, away))
        return t, self.derivatives(t)[1], self.third_derivative(t)

    def _transformed(self, t: NDArray[np.complex128], x: Array, part: slice) -> NDArray[np.complex128]:
        """Return exp(K(t) - t x) at ``t`` ``(nodes, P)`` in the upper half plane."""
        left = 1 - 2 * self._variances[:, None, part] * t
        pair = left[0] * left[1]
        product = pair * left[2]
        # each factor turns by 0 to -π, so the partial products give the branch of the square root; logarithms are
        # slower
        root = np.where((pair.imag > 0) | (product.imag > 0), -1.0, 1.0) * np.sqrt(product)
        return np.exp((self._squares[:, None, part] * t / left).sum(axis=0) - t * x) / root

    def exponent(self, t: Array) -> Array:
        """Return K at real ``t`` ``(P,)`` below its end."""
        left = 1 - 2 * self._variances * t
        return (self._squares * t / left - np.log(left) / 2).sum(axis=0)

    def derivatives(self, t: Array) -> tuple[Array, Array]:
        """Return the first and second derivative of K at real ``t`` ``(P,)`` below its end."""
        over = 1 / (1 - 2 * self._variances * t)
        small, large = self._variances * over, self._squares * over * over
        return (small + large).sum(axis=0), (2 * small * (small + 2 * large)).sum(axis=0)

    def third_derivative(self, t: Array) -> Array:
        """Return the third derivative of K at real ``t`` ``(P,)`` below its end."""
        over = 1 / (1 - 2 * self._variances * t)
        small = self._variances * over
        return (8 * small * small * (small + 3 * self._squares * over * over)).sum(axis=0)


def _root(function: Callable[[Array], tuple[Array, Array]], start: Array, least: float, most: float) -> Array:
    """Return the zero ``(P,)`` of an increasing function of values and slopes, to about 1e-12.

    Newton's method, with bisection where that would leave the bracket or is slower.
    """
    at, low, high = start, np.full(start.shape, least), np.full(start.shape, most)
    last = high - low
    for _ in range(_MOST_STEPS):
        values, slopes = function(at)
        low, high = np.where(values <= 0, at, low), np.where(values >= 0, at, high)
        change = -values / np.maximum(slopes, 1e-300)
        newton = (at + change >= low) & (at + change <= high) & (2 * np.abs(change) <= last)
        # after a small step the next one would be as small as its square
        change = np.where(last < _LAST_STEP, 0.0, np.where(newton, change, (low + high) / 2 - at))
        at, last = at + change, np.abs(change)
        if last.max(initial=0.0) < _LAST_STEP:
            break
    return at
