"""Moments and shares of the first-order model at many poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.analyses.budget.shares import SourceLine
from precision_pin.analyses.map.law_bounds import LawShapes, Vectors, times_each
from precision_pin.base.arguments import check_instance, check_memory
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import add, warns_at_end
from precision_pin.draws.correlation import BlockCovariance
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel, tangents
from precision_pin.robot.chain import pose_findings


@final
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
