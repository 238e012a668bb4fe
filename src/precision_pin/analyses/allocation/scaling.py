"""Part of each tolerance in the first-order error, and a check that it grows in proportion to the tolerance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from precision_pin.analyses.allocation.problem import Tolerance
from precision_pin.analyses.worst_case.convex_bodies import Supports
from precision_pin.errors import InputError
from precision_pin.inputs.arrays import fix_fields
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.tangents import tangents
from precision_pin.typing import Array

__all__ = ["Contributions", "changed_model", "contributions"]

_WIDE: Final = 2.0
_NARROW: Final = 0.5
"""Factors of the tolerances by which their parts are found, and checked."""
_LEAST: Final = 1e-6
"""Error of a contribution, of the largest, above which it does not scale with its tolerance."""
_WIDTH: Final = 3.0
"""Standard deviations of a normal law at which a worst case ends."""


@final
@dataclass(frozen=True, eq=False)
class Contributions:
    """First-order error at P poses, in parts.

    Attributes
    ----------
    mean
        Error at the means ``(6, P)``.
    covariance, by_tolerance
        Covariance that no tolerance changes ``(6, 6, P)``, and that of each tolerance of 1 m or rad ``(n, 6, 6, P)``.
    reach, reach_by_tolerance
        Largest deviations of the components, ``(6, P)`` and ``(n, 6, P)``.
    """

    mean: Array
    covariance: Array
    by_tolerance: Array
    reach: Array
    reach_by_tolerance: Array

    def __post_init__(self) -> None:
        fix_fields(self)


def contributions(
    model: ErrorModel,
    tolerances: Sequence[Tolerance],
    poses: Sequence[str],
    *,
    worst_case: bool,
    advance: Callable[[int], None],
) -> Contributions:
    """Return the parts of the first-order error at named poses; ``advance`` is called with 1 for each tolerance.

    Each tolerance is doubled, and all are halved together: the parts must follow in proportion, and nothing else may change.

    Raises
    ------
    InputError
        A tolerance whose part does not follow in proportion, or that changes the mean or other tolerances' parts.
    """
    mean, whole, reach = _errors(model, poses, worst_case)
    parts, reaches = [], []
    scale = max(float(np.abs(whole).max()), 1e-300)
    size = max(float(np.abs(mean).max()), scale**0.5)
    together = _at_factor(model, tolerances, _NARROW, poses, worst_case)
    for one in tolerances:
        moved, *wide = _at_factor(model, [one], _WIDE, poses, worst_case)
        if np.abs(moved - mean).max() > _LEAST * size:
            raise InputError(f"allocate: {one.path} changes the mean of the error; only a tolerance can be chosen")
        parts.append((wide[0] - whole) / (_WIDE**2 - 1))
        reaches.append((wide[1] - reach) / (_WIDE - 1))
        advance(1)
    # all of them narrower at once show whether any part does not follow in proportion, one alone which
    narrow = [whole + (_NARROW**2 - 1) * sum(parts), reach + (_NARROW - 1) * sum(reaches)]
    largest = max(float(reach.max(initial=0.0)), 1e-300)
    if _differ(together[1], narrow[0], _LEAST * scale) or _differ(together[2], narrow[1], _LEAST * largest):
        for one, part, part_of_reach in zip(tolerances, parts, reaches, strict=True):
            _, covariance, reached = _at_factor(model, [one], _NARROW, poses, worst_case)
            uneven = _differ(
                covariance, whole + (_NARROW**2 - 1) * part, _LEAST * float(np.abs(part).max()) + 1e-12 * scale
            )
            if uneven or _differ(reached, reach + (_NARROW - 1) * part_of_reach, _LEAST * largest):
                raise InputError(
                    f"allocate: the error does not scale with {one.path}; its law has other numbers, or it is no tolerance"
                )
        raise InputError("allocate: tolerances share a part of the error; each must have draws of its own")
    rest = whole - sum(parts)
    least = np.linalg.eigvalsh(np.moveaxis(rest, -1, 0)).min()
    if least < -_LEAST * scale:
        raise InputError("allocate: tolerances share a part of the error; each must have draws of its own")
    before = np.array([one.before for one in tolerances])
    still = np.maximum(reach - sum(reaches), 0.0)
    return Contributions(
        mean,
        rest,
        np.stack(parts) / before[:, None, None, None] ** 2,
        still,
        np.stack(reaches) / before[:, None, None],
    )


def _at_factor(
    model: ErrorModel, tolerances: Sequence[Tolerance], factor: float, poses: Sequence[str], worst_case: bool
) -> tuple[Array, Array, Array]:
    return _errors(_changed(model, {one: factor * one.before for one in tolerances}), poses, worst_case)


def _differ(one: Array, other: Array, most: float) -> bool:
    return bool(np.abs(one - other).max(initial=0.0) > most)


def changed_model(model: ErrorModel, tolerances: Sequence[Tolerance], values: Array) -> ErrorModel:
    """Return the model with other tolerances."""
    return _changed(model, dict(zip(tolerances, values.tolist(), strict=True)))


def _changed(model: ErrorModel, values: Mapping[Tolerance, float]) -> ErrorModel:
    return model.with_({one.path: one.written(value) for one, value in values.items()})


def _errors(model: ErrorModel, poses: Sequence[str], worst_case: bool) -> tuple[Array, Array, Array]:
    """Return mean, covariance and largest deviation of the error at poses."""
    values, _ = model.configurations(list(poses))
    chunks = list(tangents(model.at_columns(values, model.approaches_of(list(poses), values))))
    mean = np.concatenate([chunk.error for chunk in chunks], axis=1)
    slopes = np.moveaxis(np.concatenate([chunk.jacobian for chunk in chunks], axis=2), -1, 0)
    block = model.space.block_covariance
    covariance = np.stack([block.between(one, one) for one in slopes], axis=-1)
    if not worst_case:
        return mean, covariance, np.zeros(mean.shape)
    supports = Supports.of(model.space, _WIDTH)
    up, down = (np.stack([supports.heights(way * one).sum(axis=0) for one in slopes], axis=-1) for way in (1, -1))
    return mean, covariance, np.maximum(up, down)
