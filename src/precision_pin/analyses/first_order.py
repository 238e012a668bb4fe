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
- Replacing the draws that are not normal by normal ones, one at a time (Lindeberg), next to a normal part with
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
from precision_pin.model.error_model import ErrorModel, takes_datum
from precision_pin.model.pose_model import PoseModel, Tangents, tangents
from precision_pin.robot.chain import pose_findings
from precision_pin.statistics.limits import Limited
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
    return space.block_covariance.scaled(space.has_scope(*scopes).astype(float))


def first_order(
    error_model: ErrorModel,
    values: Array,
    approaches: NDArray[np.int8] | None,
    lines: Sequence[SourceLine],
    reference: PoseModel | None,
    step: Callable[[int], object],
    vectors: Sequence[Limited] = (),
) -> FirstOrder:
    """Return the moments at poses ``(n, P)``.

    Args:
        values, approaches: From :meth:`ErrorModel.configurations` and :meth:`ErrorModel.approaches_of`.
        lines: Lines of the shares.
        reference: The model at the pose where the robot is taught; ``None`` for absolute errors alone.
        step: Called with the number of poses done since the last call.
        vectors: Vectors whose lengths' laws are to be bounded.

    Raises:
        InputError: An error is too large to compute with.
    """
    space = error_model.space
    covariances, common = space.block_covariance, shared_covariance(space)
    at_reference = None if reference is None else reference.tangent
    parts: list[FirstOrder] = []
    shapes = LawShapes.of(space) if vectors else None
    turns = error_model.chain.at_columns(values).pose[:3, :3] if any(vector.in_tool for vector in vectors) else None
    begin = 0
    for chunk in tangents(error_model.at_columns(values, approaches)):
        poses = chunk.error.shape[1]
        spread = times_each(covariances, chunk.jacobian)
        covariance = np.einsum("idp,djp->ijp", chunk.jacobian, spread)
        by_component = np.einsum("idp,dip->dp", chunk.jacobian[:3], spread[:, :3])
        total = np.einsum("iip->p", covariance[:3, :3])
        shares = np.array([_part(line, chunk.jacobian[:3], by_component) for line in lines]).reshape(-1, poses)
        shares = np.where(total > 0, shares / np.where(total > 0, total, 1.0), 0.0)
        relative_mean, relative_covariance = np.zeros((6, 0)), np.zeros((6, 6, 0))
        if at_reference is not None and reference is not None:
            error, jacobian = at_reference
            relative_mean = chunk.error - error[:, None]
            between = np.einsum("idp,dj->ijp", chunk.jacobian, common.times(jacobian.T))
            relative_covariance = covariance + covariances.between(jacobian, jacobian)[:, :, None]
            relative_covariance -= between + between.swapaxes(0, 1)
            is_same = (values[:, begin : begin + poses] == reference.posture.q[:, None]).all(axis=0)
            if is_same.any():
                # draws of pose scope are shared too; the approach may differ, and with it the derivatives
                relative_covariance[:, :, is_same] = _local_covariance(space, chunk.jacobian[:, :, is_same], jacobian)
        bounded: tuple[Vectors, ...] = ()
        if shapes is not None:
            remainders = shapes.remainders(chunk)
            axes = None if turns is None else turns[:, :, begin : begin + poses]
            bounded = tuple(shapes.vectors(chunk, covariance, remainders, vector, axes) for vector in vectors)
        parts.append(FirstOrder(chunk.error, covariance, shares, relative_mean, relative_covariance, bounded))
        begin += poses
        step(poses)
    fields = ("mean", "covariance", "shares", "relative_mean", "relative_covariance")
    bounds = tuple(map(Vectors.joined, zip(*(part.vectors for part in parts), strict=True)))
    arrays = {name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in fields}
    return FirstOrder(vectors=bounds, **arrays)


def _part(line: SourceLine, jacobian: Array, by_component: Array) -> Array:
    """Return a line's part of the variance of the position ``(P,)``, for slopes ``(3, d, P)`` and components' parts."""
    part: Array = by_component[line.columns].sum(axis=0)
    for _, columns, form in line.parts:
        slopes = jacobian[:, columns]
        part = part + np.einsum("idp,dip->p", slopes, np.tensordot(form, slopes, (1, 1)))
    return part


def _local_covariance(space: Space, jacobian: Array, reference: Array) -> Array:
    """Return the covariance of the error minus that of the reference at its joint values, ``(6, 6, P)``."""
    shared, per_visit = shared_covariance(space, (Scope.UNIT, Scope.POSE)), shared_covariance(space, (Scope.VISIT,))
    change = jacobian - reference[:, :, None]
    covariance = np.einsum("idp,djp->ijp", change, times_each(shared, change)) + np.einsum(
        "idp,djp->ijp", jacobian, times_each(per_visit, jacobian)
    )
    return covariance + per_visit.between(reference, reference)[:, :, None]


def jacobians(error_model: ErrorModel, values: Array, approaches: NDArray[np.int8] | None) -> Array:
    """Return the derivative of the error with respect to the components at poses ``(n, P)``, ``(6, d, P)``."""
    return np.concatenate([chunk.jacobian for chunk in tangents(error_model.at_columns(values, approaches))], axis=2)


@warns_at_end
@takes_datum
def pose_covariance(model: ErrorModel, poses: ArrayLike | Mapping[str, ArrayLike] | Sequence[object]) -> Array:
    """Return the covariance between the errors of one robot at P poses, ``(P, 6, P, 6)``, first order, in closed form.

    ``Cov(e_p, e_q) = J_p Σ_unit J_qᵀ`` with the covariance of the draws of unit scope: a robot's draws of pose and
    visit scope at different poses are independent. For p = q it is ``J Σ Jᵀ`` of all draws. Base axes, m and rad.

    Args:
        model: Chain, draws and sources.
        poses: As for :func:`precision_pin.sample_poses`.

    Raises:
        InputError: Wrong poses, or more than fit into memory.
        UnknownNameError: No such pose or joint.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> print(pp.pose_covariance(model, ["paper", [0, 0, 0, 0]]).shape)
        (2, 6, 2, 6)
    """
    check_instance("model", model, ErrorModel, "as ErrorModel.load returns it")
    values, _ = model.configurations(poses)
    count = values.shape[1]
    check_memory(8.0 * 36 * count**2, f"the covariance between {count:,} poses", "give fewer poses")
    add(pose_findings(model.chain, values))
    slopes = np.moveaxis(jacobians(model, values, model.approaches_of(poses, values)), -1, 0)
    flat = slopes.reshape(6 * count, -1)
    space = model.space
    result = shared_covariance(space).between(flat, flat).reshape(count, 6, count, 6)
    for pose, pose_slopes in enumerate(slopes):
        result[pose, :, pose] = space.block_covariance.between(pose_slopes, pose_slopes)
    return result


_SCORES: Final = np.linspace(-FARTHEST_NORMAL, FARTHEST_NORMAL, 4001)
_WEIGHTS: Final = np.exp(-(_SCORES**2) / 2) / np.exp(-(_SCORES**2) / 2).sum()
_NORMAL_EIGHTH: Final = 105 ** (1 / 8)  # root of the eighth moment of a standard normal variable
_FLAT: Final = 1e-12  # relative variance below which a direction counts as constant: rounding

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
        covariances = space.block_covariance
        arrays = np.zeros((7, space.size))
        normal, proxies = np.zeros(space.size), np.ones(space.size)
        groups, chaos = np.zeros(space.size, dtype=np.intp), 3.0
        numbers: dict[tuple[str, ...], int] = {}
        for draw, columns in zip(space.draws, space.slices, strict=True):
            law, group = draw.law, correlated.get(draw.name, ())
            count = len(group) or law.size
            is_normal = all(laws[name].is_normal for name in group or (draw.name,))
            # laws of several numbers with light tails are symmetric about their mean, and elliptic
            is_light = is_normal or (law.cumulants() is None and not group)
            intervals = np.array([law.interval(k) for k in range(law.size)])
            farthest_values = np.abs(intervals - law.mean_vector[:, None]).max(axis=1)
            variance = np.diag(law.covariance).clip(0.0)
            third, fourth, eighth = _moments(law, np.sqrt(variance), farthest_values)
            absolute = np.zeros_like(third) if is_light else count**2 * np.sqrt(variance * fourth)
            arrays[:, columns] = (
                (third, fourth - 3 * variance**2, 0 * third, np.abs(third))
                if count == 1
                else (0 * third, (not is_light) * count**3 * fourth, absolute, absolute)
            ) + ((not is_normal) * count**3 * (fourth + 3 * variance**2), eighth, farthest_values)
            normal[columns] = is_normal
            groups[columns] = numbers.setdefault(group or (draw.name,), len(numbers))
            kurtosis = float((fourth / np.where(variance > 0, variance, 1.0) ** 2).max(initial=0.0))
            if not (is_light or (count == 1 and kurtosis <= 9 and (np.abs(third) <= 1e-9 * variance**1.5).all())):
                chaos = max(chaos, 12 * count**2 * np.sqrt(kurtosis))
            if not is_light:
                spans = (intervals[:, 1] - intervals[:, 0]) ** 2 / 4
                proxies[columns] = count * np.maximum(spans / np.where(variance > 0, variance, spans + 1e-300), 1.0)
        blocks = tuple((columns, block) for columns, block in covariances.blocks if (proxies[columns] == 1).all())
        proxy = BlockCovariance(covariances.variances * proxies, blocks) if (proxies > 1).any() else covariances
        third, cumulant, joint_moments, replaced_third, replaced_fourth, eighth, farthest = arrays
        moments = third, cumulant, joint_moments, replaced_third, replaced_fourth, eighth, farthest
        return cls(space, covariances.scaled(normal), proxy, *moments, groups, chaos)

    @property
    def is_normal(self) -> bool:
        """Whether sums of all numbers are normal."""
        return not self.replaced_fourth.any()

    @cached_property
    def _changes(self) -> Array:
        """Deviations of sampled numbers from their means, ``(d, N)``."""
        count = min(4096, max(256, 2**22 // max(self.space.size, 1)))
        return self.space.sample(0, 0, count) - self.space.mean[:, None]

    def _curvature(self, table: TermTable) -> tuple[_Slopes, Array, Array]:
        """Return the products' slopes, and the roots of the 8th and 4th moments beyond first order, ``(T,)``."""
        cached = self._products.get(id(table.program))
        if cached is not None:
            return cached[1:]
        mean, change = self.space.mean[:, None], self._changes
        curvature = table.products(table.program.evaluate(change + mean))
        curvature = curvature - table.products(table.program.evaluate(mean))
        slopes = table.product_slopes(self.space.mean)
        for term, component, slope in zip(*slopes, strict=True):
            curvature[term] -= slope * change[component]
        scale = np.maximum(np.abs(curvature).max(axis=1, initial=0.0), 1e-300)
        # a power of an array takes far longer than products
        fourths = (curvature / scale[:, None]) ** 2
        fourths *= fourths
        eighth, fourth = (scale * powers.mean(axis=1) ** (1 / k) for powers, k in ((fourths**2, 8), (fourths, 4)))
        self._products[id(table.program)] = table, slopes, eighth, fourth
        return slopes, eighth, fourth

    def remainders(self, chunk: Tangents) -> Array:
        """Return bounds ``(2, P)`` of the root of the fourth moment of the remainders of position and attitude."""
        (terms, components, slopes), eighth, fourth = self._curvature(chunk.table)
        # few of the products of draws and terms are nonzero
        turn, move = (_sums(np.abs(slopes)[:, None] * arms[terms], components, len(self.groups)) for arms in chunk.arms)
        variance = self.space.block_covariance.variances
        count = int(self.groups.max(initial=-1)) + 1
        turns, moves = (_sums(self.eighth[:, None] * of, self.groups, count) for of in (turn, move))
        all_turns = turns.sum(axis=0) + eighth @ chunk.arms[0]
        bounds = []
        for arm, by_group, of in ((move, moves, chunk.arms[1]), (turn, turns, chunk.arms[0])):
            total = by_group.sum(axis=0) + eighth @ of
            pairs = np.sqrt((variance @ turn**2) * (variance @ arm**2) + (variance @ (turn * arm)) ** 2)
            cubic = total * (all_turns**2 + eighth @ chunk.arms[0])
            second = self.chaos * pairs + (turns * by_group).sum(axis=0) + cubic
            bounds.append(np.minimum(second, all_turns * total) + fourth @ of)
        # the root of a fourth moment is a norm: that of a sum is at most the sum
        return sum(
            (np.einsum("ijp,jp->ip", gain, self.remainders(part)) for gain, part in chunk.added), np.stack(bounds)
        )

    def vectors(
        self, chunk: Tangents, covariance: Array, remainders: Array, of: Limited, tool_axes: Array | None
    ) -> Vectors:
        """Return the limited components at the poses of a chunk, whose tool axes are ``(3, 3, P)``."""
        rows = [of.first + axis for axis in of.axes]
        if of.in_tool and tool_axes is not None:
            part, along = slice(of.first, of.first + 3), tool_axes[:, list(of.axes)]
            jacobian = np.einsum("kap,kdp->adp", along, chunk.jacobian[part])
            mean = np.einsum("kap,kp->ap", along, chunk.error[part])
            block = np.einsum("kap,klp,lbp->abp", along, covariance[part, part], along)
        else:
            jacobian, mean, block = chunk.jacobian[rows], chunk.error[rows], covariance[np.ix_(rows, rows)]
        lengths = np.sqrt((jacobian**2).sum(axis=0))
        squares = lengths**2
        gradient = np.einsum("kdp,kp->dp", jacobian, mean)
        size = np.sqrt((mean**2).sum(axis=0))
        spread = 2 * (block**2).sum(axis=(0, 1)) + 4 * np.einsum("ip,ijp,jp->p", mean, block, mean)
        spread += 4 * (self.third @ (gradient * squares)) + self.fourth_cumulant @ squares**2
        spread += 4 * size * (self.together @ lengths**3)
        full, proxy = np.zeros((2, 3, 3, mean.shape[1]))
        first = np.ix_(range(len(rows)), range(len(rows)))
        full[first] = block
        proxy[first] = block if self.proxy is self.space.block_covariance else _between(self.proxy, jacobian)
        middle = np.zeros((3, mean.shape[1]))
        middle[: len(rows)] = mean
        return Vectors(
            mean=middle,
            covariance=full,
            proxy=proxy,
            square_spread=np.sqrt(np.maximum(spread, 0.0)),
            replaced=np.zeros(len(size)) if self.is_normal else self._normality_distance(jacobian, block),
            farthest=size + self.farthest @ lengths,
            remainder=remainders[of.first // 3],
        )

    def _normality_distance(self, jacobian: Array, covariance: Array) -> Array:
        """Return the largest change of a probability if the draws were normal, ``(P,)``."""
        values, vectors = np.linalg.eigh(np.moveaxis(_between(self.normal, jacobian), -1, 0))
        threshold = _FLAT * np.maximum(np.einsum("iip->p", covariance), 1e-300)
        other = self.replaced_fourth > 0
        rotated = np.einsum("pik,idp->kdp", vectors, jacobian[:, other])
        lengths = np.sqrt((rotated**2 / np.maximum(values.T, threshold)[:, None]).sum(axis=0))
        # c_3/6, rounded up: E|Z³ - 3Z|/2 = (1 + 4 exp(-3/2))/√(2π) = 0.75499
        distance = (0.7549 / 6) * (self.replaced_third[other] @ lengths**3)
        distance += (1.4008 / 24) * (self.replaced_fourth[other] @ lengths**4)
        return np.minimum(distance, 1.0)


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
    moments = law.standardised_moments() if law.size == 1 else None
    if moments is not None:
        values = np.abs(law.at_scores(_SCORES[None])[0] - law.mean_vector[0]) / max(float(std[0]), 1e-300)
        eighth = np.minimum(eighth, 1.02 * std * float(_WEIGHTS @ values**8) ** (1 / 8))
        return moments[0] * std**3, moments[1] * std**4, eighth
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
        tail = 0.05 * (1 - level)
        margin = self.remainder * tail ** (-1 / 4)
        above, below = level + tail, level - tail
        square, spread = self.square_mean, self.square_spread
        high = np.minimum(np.sqrt(square + spread * np.sqrt(above / (1 - above))), self.farthest)
        high = np.minimum(high, norm_tail_quantiles(*self._heavier, 1 - above))
        low = np.sqrt(np.maximum(square - spread * np.sqrt((1 - below) / below), 0.0))
        is_near = self.replaced < 1 - above
        if is_near.any():
            axes, change = (self.axes[0][:, is_near], self.axes[1][:, is_near]), self.replaced[is_near]
            start = level, quantile[is_near]
            high[is_near] = np.minimum(high[is_near], norm_quantiles(*axes, above + change, start))
            low[is_near] = np.maximum(low[is_near], norm_quantiles(*axes, np.maximum(below - change, 1e-6), start))
        return np.stack([np.maximum(low - margin, 0.0), high + margin])

    def share_bounds(self, limit: float) -> Array:
        """Return bounds of the probability that the length is at most ``limit``, ``(2, P)``."""
        low, high = np.zeros_like(self.farthest), np.ones_like(self.farthest)
        square, variance = self.square_mean, self.square_spread**2
        # probabilities left for a remainder beyond its bound
        for tail in (1e-2, 1e-3, 1e-4):
            margin = self.remainder * tail ** (-1 / 4)
            inner, outer = np.maximum(limit - margin, 0.0), limit + margin
            room, deficit = np.maximum(inner**2 - square, 0.0), np.maximum(square - outer**2, 0.0)
            lower = np.where(room > 0, room**2 / np.maximum(variance + room**2, 1e-300), 0.0)
            lower = np.maximum(lower, 1 - norm_tail_bounds(*self._heavier, inner))
            lower = np.maximum(lower, norm_probabilities(*self.axes, inner) - self.replaced)
            lower = np.where(self.farthest <= inner, 1.0, lower)
            upper = np.where(deficit > 0, variance / np.maximum(variance + deficit**2, 1e-300), 1.0)
            upper = np.minimum(upper, norm_probabilities(*self.axes, outer) + self.replaced)
            low, high = np.maximum(low, lower - tail), np.minimum(high, upper + tail)
        return np.stack([low, high])

    def gamma_quantiles(self, level: float) -> tuple[Array, Array]:
        """Return estimates of a quantile of the length, ``(P,)`` each: for these laws, and for normal ones.

        The square is approximated by a gamma number with its mean and variance.
        """
        normal = 2 * (self.covariance**2).sum(axis=(0, 1))
        normal += 4 * np.einsum("ip,ijp,jp->p", self.mean, self.covariance, self.mean)
        quantiles = []
        for variance in (self.square_spread**2, normal):
            shape = self.square_mean**2 / np.maximum(variance, 1e-12 * self.square_mean**2 + 1e-300)
            quantiles.append(np.sqrt(special.gammaincinv(shape, level) / np.maximum(shape, 1e-300) * self.square_mean))
        return quantiles[0], quantiles[1]


_NODES: Final = 32  # of half the path
_STEP: Final = 0.15
_PARAMETER: Final = (np.arange(_NODES) + 0.5)[:, None] * _STEP
# distances of the nodes on half of the path from the real axis, ``(nodes, 1)``, in units of 1/√K''
_ACROSS: Final = np.sinh(_PARAMETER)
_PATH_WEIGHTS: Final = np.cosh(_PARAMETER) * (_STEP / np.pi)
# largest distance from the mean, in standard deviations of the vector, at which a probability is computed
_FARTHEST: Final = 40.0
_ROUNDS: Final = 3  # Newton steps for a quantile, from the gamma approximation
# relative step after which the next one is at rounding: convergence is quadratic
_CLOSE: Final = 2e-5
_ROUNDING: Final = 1e-28  # relative variance below which a vector counts as constant: squared rounding
# largest |s| of an argument of K: there 1 - t/end is exp(-s)
_FAR: Final = 60.0
_MOST_STEPS: Final = 100  # of a root; bisection alone needs fewer
_LAST_STEP: Final = 1e-6  # the next one would be as small as its square
# vectors whose integrals are computed together, so that their arrays stay in the processor's cache
_AT_ONCE: Final = 128


def principal_axes(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Return variances and means along the principal axes, ``(3, P)`` each, for ``(3, P)`` and ``(3, 3, P)``."""
    values, vectors = np.linalg.eigh(np.moveaxis(covariance, -1, 0))
    return np.ascontiguousarray(np.maximum(values, 0.0).T), np.einsum("pij,ip->jp", vectors, mean)


def norm_probabilities(variances: Array, means: Array, radii: Array) -> Array:
    """Return P(|v| ≤ r), ``(P,)``, for vectors in principal axes ``(3, P)`` and radii ``(P,)``; errors below 1e-7."""
    law = _Law(variances, means)
    probabilities = law.evaluate(np.maximum(radii**2 - law.constant, 0.0))[0]
    return np.where(law.still, (radii**2 >= law.constant).astype(float), probabilities)


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
        starts = np.maximum(near[1] ** 2 - law.constant, 1e-3 * squares)
        x *= starts / special.gammaincinv(squares**2 / spreads, near[0])
    score, is_moving = special.ndtri(probability), np.ones(x.shape, dtype=np.bool_)
    for _ in range(_ROUNDS):
        probabilities, density = law.evaluate(x)
        scores = special.ndtri(np.clip(probabilities, 1e-15, 1 - 1e-15))
        slopes = np.maximum(density, 1e-300) * np.sqrt(2 * np.pi) * np.exp(scores**2 / 2)
        # the score is nearly linear in the logarithm of x far in the tails
        change = np.where(is_moving, np.clip((score - scores) / (slopes * x), -1.0, 1.0), 0.0)
        x = x * np.exp(change)
        is_moving = np.abs(change) >= _CLOSE
        if not is_moving.any():
            break
    return np.sqrt(np.where(law.still, 0.0, x) + law.constant)


def norm_tail_bounds(variances: Array, means: Array, radii: Array) -> Array:
    """Return min exp(K(t) - t r²), a bound of P(|v| > r), ``(P,)``; arguments as for `norm_probabilities`."""
    law = _Law(variances, means)
    x = np.minimum(radii**2 - law.constant, law.farthest)
    t = np.maximum(law.saddle(x), 0.0)
    return np.where(law.still, x < 0, np.exp(law.exponent(t) - t * x))


def norm_tail_quantiles(variances: Array, means: Array, tail: float) -> Array:
    """Return the length beyond which the bound of `norm_tail_bounds` is ``tail``, ``(P,)``."""
    law = _Law(variances, means)
    target = -np.log(tail)

    def excess(s: Array) -> tuple[Array, Array]:
        t = law.argument(s)
        first, second = law.derivatives(t)
        exponent = np.maximum(t * first - law.exponent(t), 1e-300)
        return np.log(exponent / target), t * second * (law.end - t) / exponent

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
        radius = np.sqrt(self._squares.sum(axis=0)) + _FARTHEST * np.sqrt(self._variances.sum(axis=0))
        self.farthest = radius**2

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean and variance, ``(P,)``."""
        first = (self._variances + self._squares).sum(axis=0)
        return first, (2 * self._variances * (self._variances + 2 * self._squares)).sum(axis=0)

    def evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return probability and density at ``x`` ``(P,)``."""
        x = np.minimum(x, self.farthest)
        saddle = self._crossing(x)
        density, tail = np.empty((2, len(x)))
        for first in range(0, len(x), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            path, values = self._integrand(x, saddle, part)
            density[part] = values.imag.sum(axis=0)
            tail[part] = (values / path).imag.sum(axis=0)
        probability: Array = np.clip(np.where(saddle[0] > 0, 1 - tail, -tail), 0.0, 1.0)
        return probability, density

    def variance_slopes(self, x: Array, means: Array) -> Array:
        """Return the derivative of the quantile ``x`` by the covariance in principal axes, ``(3, 3, P)``."""
        path, values = self._integrand(x, self._crossing(x), slice(None))
        widths = 1 / (1 - 2 * self._variances[:, None] * path)
        scaled_means = means[:, None] * widths
        rates = 2 * path * scaled_means[:, None] * scaled_means[None] + np.eye(3)[:, :, None, None] * widths
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
        return path, self._transform(path, x[part], part) * rates

    def argument(self, s: Array) -> Array:
        """Return the argument of K at which K' increases with s, from 0 to infinity."""
        return self.end * -np.expm1(-s)

    def saddle(self, x: Array) -> Array:
        """Return the argument at which the derivative of K is x, ``(P,)``."""
        smallest = self.derivatives(self.argument(np.full(x.shape, -_FAR)))[0]
        target = np.log(np.maximum(x, smallest))

        def excess(s: Array) -> tuple[Array, Array]:
            t = self.argument(s)
            first, second = self.derivatives(t)
            return np.log(first) - target, second * (self.end - t) / first

        # with equal variances and no means this is the solution
        start = target - np.log(self.derivatives(np.zeros(x.shape))[0])
        return self.argument(_root(excess, np.clip(start, -_FAR, _FAR), -_FAR, _FAR))

    def _crossing(self, x: Array) -> tuple[Array, Array, Array]:
        """Return where the path crosses the real axis, and the second and third derivative of K there."""
        t = self.saddle(x)
        # smallest distance of the path from the pole, in units of 1/√K''
        distance = 1.0 / np.sqrt(self.derivatives(t)[1])
        is_left = (t < 0) | (2 * distance > self.end)
        t = np.where(np.abs(t) >= distance, t, np.where(is_left, -distance, distance))
        return t, self.derivatives(t)[1], self.third_derivative(t)

    def _transform(self, t: NDArray[np.complex128], x: Array, part: slice) -> NDArray[np.complex128]:
        """Return exp(K(t) - t x) at ``t`` ``(nodes, P)`` in the upper half plane."""
        factors = 1 - 2 * self._variances[:, None, part] * t
        pair = factors[0] * factors[1]
        product = pair * factors[2]
        # each factor turns by 0 to -π, so the partial products give the branch of the square root; logarithms are
        # slower
        root = np.where((pair.imag > 0) | (product.imag > 0), -1.0, 1.0) * np.sqrt(product)
        return np.exp((self._squares[:, None, part] * t / factors).sum(axis=0) - t * x) / root

    def exponent(self, t: Array) -> Array:
        """Return K at real ``t`` ``(P,)`` below its end."""
        factors = 1 - 2 * self._variances * t
        return (self._squares * t / factors - np.log(factors) / 2).sum(axis=0)

    def derivatives(self, t: Array) -> tuple[Array, Array]:
        """Return the first and second derivative of K at real ``t`` ``(P,)`` below its end."""
        inverse = 1 / (1 - 2 * self._variances * t)
        v, m = self._variances * inverse, self._squares * inverse * inverse
        return (v + m).sum(axis=0), (2 * v * (v + 2 * m)).sum(axis=0)

    def third_derivative(self, t: Array) -> Array:
        """Return the third derivative of K at real ``t`` ``(P,)`` below its end."""
        inverse = 1 / (1 - 2 * self._variances * t)
        v = self._variances * inverse
        return (8 * v * v * (v + 3 * self._squares * inverse * inverse)).sum(axis=0)


def _root(function: Callable[[Array], tuple[Array, Array]], start: Array, least: float, most: float) -> Array:
    """Return the zero ``(P,)`` of an increasing function of values and slopes, to about 1e-12.

    Newton's method, with bisection where that would leave the bracket or is slower.
    """
    point, low, high = start, np.full(start.shape, least), np.full(start.shape, most)
    last_step = high - low
    for _ in range(_MOST_STEPS):
        values, slopes = function(point)
        low, high = np.where(values <= 0, point, low), np.where(values >= 0, point, high)
        change = -values / np.maximum(slopes, 1e-300)
        newton = (point + change >= low) & (point + change <= high) & (2 * np.abs(change) <= last_step)
        # after a small step the next one would be as small as its square
        change = np.where(last_step < _LAST_STEP, 0.0, np.where(newton, change, (low + high) / 2 - point))
        point, last_step = point + change, np.abs(change)
        if last_step.max(initial=0.0) < _LAST_STEP:
            break
    return point
