"""Contribution of each tolerance to the first-order error, and a check that it is proportional to the tolerance."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.analyses.allocation.costs import Tolerance
from precision_pin.analyses.worst_case.convex_bodies import Supports
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError
from precision_pin.draws.correlation import BlockCovariance
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import tangents

# factors on the tolerances to find their contributions, and to check them
_WIDE: Final = 2.0
_NARROW: Final = 0.5
# relative error of a contribution, by the largest, above which it does not scale with its tolerance
_LEAST: Final = 1e-6
# slope, relative to the largest, that counts as rounding
_ROUNDING: Final = 1e-12
# standard deviations at which the worst case of a normal law ends
_WIDTH: Final = 3.0
# samples to check whether a law keeps its shape
_FEW: Final = 64


@final
class NoScaleError(InputError):
    """The error is not proportional to the tolerance at ``path``."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f"allocate: {reason}")
        self.path = path


@final
@dataclass(frozen=True, eq=False)
class Contributions(Fixed):
    """First-order error at P poses: ``mean + rest z + Σ t_i moved_i z``, z the components in standard deviations.

    Attributes:
        mean: Error at the means ``(6, P)``.
        covariance, by_tolerance: Fixed covariance ``(6, 6, P)``, and that of each tolerance of 1 m or rad ``(n, 6, 6,
            P)``.
        pairs, by_pair: Numbers of two tolerances with correlated draws, n for the unchosen rest, ``(m, 2)``; the
            contribution of their product to the covariance, ``(m, 6, 6, P)``.
        reach, reach_by_tolerance: Largest deviations of the components, ``(6, P)`` and ``(n, 6, P)``.
        moved, rest: Slopes of the error by the components that each tolerance moves, columns ``(c,)`` and ``(6, c,
            P)``; and those of the unchosen rest.
    """

    mean: Array
    covariance: Array
    by_tolerance: Array
    pairs: NDArray[np.intp]
    by_pair: Array
    reach: Array
    reach_by_tolerance: Array
    moved: tuple[Moved, ...]
    rest: Moved


@dataclass(frozen=True, eq=False)
class _Errors:
    """First-order error of a model: mean ``(6, P)``, slopes by deviation ``(6, d, P)``, deviations ``(d,)``."""

    mean: Array
    slopes: Array
    reach: Array
    deviations: Array
    correlation: BlockCovariance
    numbers: Array
    """A few samples of the components, in standard deviations from their means."""


def contributions(
    model: ErrorModel,
    tolerances: Sequence[Tolerance],
    poses: Sequence[str],
    *,
    worst_case: bool,
    advance: Callable[[int], None],
) -> Contributions:
    """Return the parts of the first-order error at named poses; ``advance`` is called with 1 for each tolerance.

    Each tolerance is doubled, and all are halved together: the error must be proportional, and nothing else may change.

    Raises:
        InputError: A tolerance whose part is not proportional, or that changes the mean or other tolerances' parts.
    """
    whole = _errors(model, poses, worst_case)
    scale = max(float(np.abs(whole.slopes).max(initial=0.0)), 1e-300)
    size = max(float(np.abs(whole.mean).max(initial=0.0)), scale)
    parts, reaches = [], []
    for one in tolerances:
        wide = _at_factor(model, [one], _WIDE, poses, worst_case)
        if wide.slopes.shape != whole.slopes.shape:
            raise NoScaleError(one.path, f"{one.path} changes which numbers are drawn; only a tolerance can be chosen")
        if np.abs(wide.mean - whole.mean).max() > _LEAST * size:
            raise NoScaleError(one.path, f"{one.path} changes the mean of the error and cannot be chosen")
        part = _without_rounding((wide.slopes - whole.slopes) / (_WIDE - 1), scale)
        if not part.any() and np.array_equal(wide.deviations, whole.deviations):
            raise NoScaleError(one.path, f"{one.path} changes neither a law nor the error and cannot be chosen")
        parts.append(part)
        reaches.append((wide.reach - whole.reach) / (_WIDE - 1))
        advance(1)
    largest = max(float(whole.reach.max(initial=0.0)), 1e-300)
    # halving all at once shows whether any part is not proportional, halving one shows which
    together = _at_factor(model, tolerances, _NARROW, poses, worst_case)
    if not _follows(together, whole, np.sum(parts, axis=0), scale):
        for one, part in zip(tolerances, parts, strict=True):
            own = max(float(np.abs(part).max(initial=0.0)), 1e-300)
            if not _follows(_at_factor(model, [one], _NARROW, poses, worst_case), whole, part, own):
                reason = f"the error does not scale with {one.path}; its law has other numbers, or it is no tolerance"
                raise NoScaleError(one.path, reason)
        raise InputError("allocate: tolerances change one random number together; choose one of them")
    rest = _without_rounding(whole.slopes - sum(parts), scale)
    before = np.array([one.before for one in tolerances])
    moved = tuple(Moved.of(part / one) for part, one in zip(parts, before.tolist(), strict=True))
    pairs, by_pair = _products([*moved, Moved.of(rest)], whole.correlation)
    if _differ(together.reach, whole.reach + (_NARROW - 1) * sum(reaches), _LEAST * largest):
        for one, reached in zip(tolerances, reaches, strict=True):
            alone = _at_factor(model, [one], _NARROW, poses, worst_case).reach
            if _differ(alone, whole.reach + (_NARROW - 1) * reached, _LEAST * largest) and not len(pairs):
                raise InputError(f"allocate: the largest deviation does not scale with {one.path}")
        paths = [*(one.path for one in tolerances), "what is not chosen"]
        named = [paths[k] for k in pairs[:1].ravel().tolist()]
        raise InputError(
            f"allocate: worst_case: {' and '.join(named)} are correlated, so that their largest deviations do not add; "
            "limit rms or a quantile instead, or take the correlation out of the sheet"
        )
    spreads = (one.spread(whole.deviations.size) for one in moved)
    return Contributions(
        mean=whole.mean,
        covariance=_covariance(rest, rest, whole.correlation),
        by_tolerance=np.stack([_covariance(one, one, whole.correlation) for one in spreads]),
        pairs=pairs,
        by_pair=by_pair,
        reach=np.maximum(whole.reach - sum(reaches), 0.0),
        reach_by_tolerance=np.stack(reaches) / before[:, None, None],
        moved=moved,
        rest=Moved.of(rest),
    )


@final
@dataclass(frozen=True, eq=False)
class Moved(Fixed):
    """Columns ``(c,)`` of components, and the slopes of the error by them in standard deviations, ``(6, c, P)``."""

    columns: NDArray[np.intp]
    slopes: Array

    @classmethod
    def of(cls, slopes: Array) -> Moved:
        """Return the nonzero columns of slopes ``(6, d, P)``."""
        largest = np.abs(slopes).max(axis=(0, 2), initial=0.0)
        columns = np.flatnonzero(largest)
        return cls(columns, slopes[:, columns])

    def times(self, numbers: Array, pose: int, rows: Sequence[int]) -> Array:
        """Return rows of the error ``(r, N)`` at a pose for components in standard deviations ``(d, N)``."""
        return np.asarray(self.slopes[list(rows), :, pose] @ numbers[self.columns])

    def spread(self, size: int) -> Array:
        """Return the slopes by all components, ``(6, d, P)``."""
        slopes = np.zeros((6, size, self.slopes.shape[2]))
        slopes[:, self.columns] = self.slopes
        return slopes


def _products(moved: Sequence[Moved], correlation: BlockCovariance) -> tuple[NDArray[np.intp], Array]:
    """Return the pairs whose draws are correlated, and the contributions of their products to the covariance."""
    blocks = [
        set(columns.tolist())
        for columns, matrix in correlation.blocks
        if _differ(matrix, np.diag(np.diag(matrix)), 1e-12)
    ]
    own = [set(one.columns.tolist()) for one in moved]
    pairs, parts = [], []
    for i, j in itertools.combinations(range(len(moved)), 2):
        if own[i] & own[j] or any(block & own[i] and block & own[j] for block in blocks):
            one, other = (moved[k].spread(correlation.variances.size) for k in (i, j))
            crossed = _covariance(one, other, correlation)
            part = crossed + crossed.transpose(1, 0, 2)
            if part.any():
                pairs.append((i, j))
                parts.append(part)
    shape = (0, 6, 6, moved[0].slopes.shape[2])
    return np.array(pairs, dtype=np.intp).reshape(-1, 2), np.stack(parts) if parts else np.zeros(shape)


def _covariance(one: Array, other: Array, correlation: BlockCovariance) -> Array:
    return np.stack(
        [correlation.between(a, b) for a, b in zip(np.moveaxis(one, -1, 0), np.moveaxis(other, -1, 0), strict=True)],
        axis=-1,
    )


def _follows(narrow: _Errors, whole: _Errors, part: Array, scale: float) -> bool:
    """Return whether the error changes in proportion to its part, and no other law changes."""
    return (
        not _differ(narrow.slopes, whole.slopes + (_NARROW - 1) * part, _LEAST * scale)
        and not _differ(narrow.numbers, whole.numbers, 1e-6 * float(np.abs(whole.numbers).max(initial=1.0)))
        and not _differ(narrow.mean, whole.mean, _LEAST * max(float(np.abs(whole.mean).max()), scale))
    )


def _at_factor(
    model: ErrorModel, tolerances: Sequence[Tolerance], factor: float, poses: Sequence[str], worst_case: bool
) -> _Errors:
    return _errors(
        changed_model(model, tolerances, np.array([factor * one.before for one in tolerances])), poses, worst_case
    )


def _without_rounding(slopes: Array, scale: float) -> Array:
    return np.where(np.abs(slopes) > _ROUNDING * scale, slopes, 0.0)


def _differ(one: Array, other: Array, most: float) -> bool:
    return bool(np.abs(one - other).max(initial=0.0) > most)


def changed_model(model: ErrorModel, tolerances: Sequence[Tolerance], values: Array) -> ErrorModel:
    """Return the model with other tolerances."""
    return model.with_({one.path: one.written(value) for one, value in zip(tolerances, values.tolist(), strict=True)})


def in_deviations(space: Space, seed: int, count: int, pose: int = 0) -> Array:
    """Return samples of the components in standard deviations from their means, ``(d, count)``."""
    deviations = np.sqrt(space.block_covariance.variances)
    moved = space.sample(seed, 0, count, pose=pose) - space.mean[:, None]
    return np.asarray(moved / np.where(deviations > 0, deviations, 1.0)[:, None])


def _errors(model: ErrorModel, poses: Sequence[str], worst_case: bool) -> _Errors:
    values, _ = model.configurations(list(poses))
    chunks = list(tangents(model.at_columns(values, model.approaches_of(list(poses), values))))
    mean = np.concatenate([chunk.error for chunk in chunks], axis=1)
    jacobian = np.concatenate([chunk.jacobian for chunk in chunks], axis=2)
    covariance = model.space.block_covariance
    deviations = np.sqrt(covariance.variances)
    units = np.where(deviations > 0, deviations, 1.0)
    correlation = BlockCovariance(
        (deviations > 0).astype(float),
        tuple((columns, block / np.outer(units[columns], units[columns])) for columns, block in covariance.blocks),
    )
    reach = np.zeros(mean.shape)
    if worst_case:
        supports = Supports.of(model.space, _WIDTH)
        slopes = np.moveaxis(jacobian, -1, 0)
        up, down = (np.stack([supports.heights(way * one).sum(axis=0) for one in slopes], axis=-1) for way in (1, -1))
        reach = np.maximum(up, down)
    return _Errors(
        mean, jacobian * deviations[:, None], reach, deviations, correlation, in_deviations(model.space, 0, _FEW)
    )
