"""First-order models of many poses at once.

They equal :attr:`precision_pin.model.pose_model.PoseModel.tangent` to rounding, at a tenth of its cost: tables of one
layout differ in twists and frames only, so that what depends on the parameters is computed once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final, final

import numpy as np

from precision_pin.base import se3
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import PoseModel
from precision_pin.terms.table import TermTable

AT_ONCE: Final = 256
"""Poses whose first-order models are computed together; their arrays stay in the processor's cache."""


@final
@dataclass(frozen=True, eq=False)
class Tangents(Fixed):
    """First-order models ``e = error + jacobian · (x - mean of x)`` at P poses.

    Attributes:
        error: Error of the exact model with every component at its mean, ``(6, P)``.
        jacobian: Its derivative by the components, ``(6, d, P)``.
        arms: Per unit of each term's product, the turn of what lies beyond its place, and a bound of the tip's shift:
            the place's shift plus turn times distance, ``(2, T, P)``.
        table: The table of one of the poses; targets, factors and formulas are the same at all.
    """

    error: Array
    jacobian: Array
    arms: Array
    table: TermTable


def tangents(models: Iterable[PoseModel]) -> Iterator[Tangents]:
    """Yield the first-order models of poses in order, up to `AT_ONCE` poses at a time."""
    remaining = iter(models)
    while chunk := list(islice(remaining, AT_ONCE)):
        while chunk:
            # tables of one layout share their arrays; the formulas of a model rarely change between poses
            first = chunk[0].table
            alike = next((k for k, at in enumerate(chunk) if not _is_alike(first, at.table)), len(chunk))
            yield _tangents(chunk[0].space, [at.table for at in chunk[:alike]])
            chunk = chunk[alike:]


def _is_alike(one: TermTable, other: TermTable) -> bool:
    return one.program is other.program and one.factors is other.factors and one.target is other.target


def _tangents(space: Space, tables: Sequence[TermTable]) -> Tangents:
    try:
        with np.errstate(over="raise", invalid="raise"):
            return _multiply_out(space.mean, tables)
    except FloatingPointError:
        raise InputError("an error is too large to compute with; the tolerances or loads are far too large") from None


def _multiply_out(mean: Array, tables: Sequence[TermTable]) -> Tangents:
    first, poses = tables[0], len(tables)
    products = first.products(first.program.evaluate(mean[:, None]))[:, 0]
    entries = zip(*first.product_slopes(mean), strict=True)
    twists = np.stack([table.twists for table in tables], axis=-1)
    frames = np.stack([table.frames for table in tables], axis=-1)
    tip = np.stack([table.pose[:3, 3] for table in tables], axis=-1)
    spatial, arms = np.zeros((6, len(products), poses)), np.zeros((2, len(products), poses))
    pivots = np.zeros((len(products), 3, poses))
    motion = np.broadcast_to(np.eye(4)[:, :, None], (4, 4, poses))
    for target in range(len(first.targets)):
        terms = np.flatnonzero(first.target == target)
        displacement = np.zeros((6, poses))
        for term in terms:
            displacement += twists[term] * products[term]
        if np.sqrt((displacement[3:] ** 2).sum(axis=0)).max(initial=0.0) >= np.pi:
            raise InputError("an error turns a place by half a turn or more; the tolerances or loads are far too large")
        frame = frames[target]
        local = np.moveaxis(twists[terms], 0, 1)
        turning = np.einsum("ijp,jtp->itp", se3.left_jacobian(displacement[3:]), local[3:])
        moving = local[:3] + _cross(displacement[:3, None], turning)
        before = se3.compose(motion, frame)
        turned = np.einsum("ijp,jtp->itp", before[:3, :3], turning)
        moved = np.einsum("ijp,jtp->itp", before[:3, :3], moving)
        spatial[:3, terms] = moved + _cross(before[:3, 3][:, None], turned)
        spatial[3:, terms] = turned
        arms[:, terms] = np.sqrt([(turned**2).sum(axis=0), (moved**2).sum(axis=0)])
        pivots[terms] = before[:3, 3]
        motion = se3.compose(before, se3.displacement(displacement), se3.inverse(frame))
    shift = np.einsum("ijp,jp->ip", motion[:3, :3], tip) + motion[:3, 3] - tip
    error = np.concatenate([shift, se3.log_rotation(motion[:3, :3])])
    turn = np.moveaxis(np.linalg.inv(np.moveaxis(se3.left_jacobian(error[3:]), -1, 0)), 0, -1)
    rates = np.concatenate(
        [spatial[:3] - _cross((tip + error[:3])[:, None], spatial[3:]), np.einsum("ijp,jtp->itp", turn, spatial[3:])]
    )
    jacobian = np.zeros((6, mean.size, poses))
    for term, component, slope in entries:
        jacobian[:, component] += rates[:, term] * slope
    arms[1] += arms[0] * np.sqrt(((tip + error[:3] - pivots) ** 2).sum(axis=1))
    return Tangents(error, jacobian, arms, first)


def _cross(left: Array, right: Array) -> Array:
    """Return the cross products of vectors ``(3, ...)``; ``np.cross`` is several times slower."""
    result = np.empty(np.broadcast_shapes(left.shape, right.shape))
    for k in range(3):
        one, other = (k + 1) % 3, (k + 2) % 3
        np.subtract(left[one] * right[other], left[other] * right[one], out=result[k])
    return result
