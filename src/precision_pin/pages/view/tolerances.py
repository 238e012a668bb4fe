"""Data for changing tolerances in the page: the effect of each on each sampled robot, to first order.

The deviation of a draw from its mean moves the tip by J times the deviation. A tolerance k times as wide moves it k
times as far, for any law. A sample of the changed sheet is therefore

    e = e₀ + Σ k_g J_g (x_g − mean_g) + s r,

with r the remainder of the sample beyond first order, and s the current variance relative to the sheet's, because the
remainder is of second order. With every k at 1 it is the sample itself.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from precision_pin.analyses.budget.shares import by_key, moved_link
from precision_pin.base.arrays import Array
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import PoseModel
from precision_pin.render.html import escaped

MOST_TOLERANCES: Final = 12
"""Number of tolerances with their own slider; all others share one."""

MOST_NUMBERS: Final = 600_000
"""Largest number of deviations in a page, two bytes each."""

_SMALLEST_SHARE: Final = 1e-9
_STEPS: Final = 32_767
_DIMENSION: Final = 6

Reference = tuple[Array, Array]
"""The first-order model at a pose: error with every draw at its mean ``(6,)``, Jacobian ``(6, d)``."""


@final
@dataclass(frozen=True)
class Groups:
    """Names and indices of draws that are scaled together: the largest contributors alone, the others as one group."""

    names: tuple[str, ...]
    draws: tuple[tuple[int, ...], ...]


def tangent_of(at: PoseModel, model: str) -> Reference:
    """Return the first-order model of ``exact`` or ``linear`` errors."""
    if model == "exact":
        return at.tangent
    mean = at.space.mean
    jacobian = np.zeros((6, at.space.size))
    for sensitivity, local in zip(at.table.sensitivities, at.table.displacement_slopes(mean), strict=True):
        jacobian[:, local.columns] += sensitivity @ local.slopes
    return at.linear(mean[:, None])[:, 0], jacobian


def choose_groups(pose_models: Sequence[PoseModel], words: Sequence[str] = (), *, attitude: bool = False) -> Groups:
    """Return the tolerances of a page, those that contribute most to the spread at one of its poses first.

    ``words`` describe the draws (by default their names); those of the attitude alone count only with ``attitude``.
    """
    space = pose_models[0].space
    share = np.zeros(len(space.draws))
    for at in pose_models:
        own = np.array(
            [
                np.einsum("ij,jk,ik->i", at.jacobian[:, columns], draw.covariance, at.jacobian[:, columns])
                for draw, columns in zip(space.draws, space.slices, strict=True)
            ]
        ).reshape(-1, 6)
        for rows in (slice(0, 3), slice(3, 6))[: 1 + attitude]:
            part = own[:, rows].sum(axis=1)
            share = np.maximum(share, part / (part.sum() or 1.0))
    ranked = [int(k) for k in np.argsort(-share, kind="stable") if share[k] > _SMALLEST_SHARE]
    alone = ranked if len(ranked) <= MOST_TOLERANCES + 1 else ranked[:MOST_TOLERANCES]
    rest = ranked[len(alone) :]
    pairs = zip(words, (draw.tolerance for draw in space.draws), strict=False)
    known = [", ".join(filter(None, pair)) for pair in pairs] or [draw.name for draw in space.draws]
    names = [known[k] for k in alone] + ([f"{len(rest)} smaller ones together"] if rest else [])
    return Groups(tuple(names), (*((k,) for k in alone), *((tuple(rest),) if rest else ())))


def samples_that_fit(space: Space, groups: Groups, poses: int) -> int:
    """Return how many samples fit the size limit; draws made once for each robot are stored once for all poses."""
    once, each = 0, 0
    for draws in groups.draws:
        numbers = sum(space.draws[k].law.size for k in draws)
        if numbers <= _DIMENSION and all(space.draws[k].scope is Scope.UNIT for k in draws):
            once += numbers
        else:
            each += min(_DIMENSION, numbers)
    return max(1, MOST_NUMBERS // max(1, once + poses * each))


def share_rows(poses: Sequence[dict[str, Any]]) -> list[str]:
    """Return the distinct rows of deviations of all poses, and store their indices in the poses' settings."""
    rows: dict[str, int] = {}
    for live in (pose["live"] for pose in poses if pose["live"] is not None):
        live["deviations"] = [rows.setdefault(row, len(rows)) for row in live["deviations"]]
    return list(rows)


@final
class LivePose:
    """The first-order model of the samples at one pose.

    Args:
        groups: The page's tolerances.
        x: Component values ``(d, M)`` of the samples that follow the sliders.
        reference: The first-order model of their errors.
        length: The arm's length, m, which weights attitude errors against position errors.
    """

    def __init__(self, at: PoseModel, groups: Groups, x: Array, reference: Reference, length: float) -> None:
        self._centre, jacobian = reference
        self._columns = [
            [column for k in draws for column in range(at.space.slices[k].start, at.space.slices[k].stop)]
            for draws in groups.draws
        ]
        weights = np.repeat([1.0, length], 3)
        parts = [
            self._rows(jacobian[:, columns], x[columns] - at.space.mean[columns, None], weights)
            for columns in self._columns
        ]
        self._slopes = np.concatenate([slopes.T for slopes, _ in parts])
        self._numbers = np.concatenate([numbers for _, numbers in parts])
        self._group = [number for number, (slopes, _) in enumerate(parts) for _ in range(slopes.shape[1])]
        self._variances = self._covariance(at, jacobian)

    @property
    def settings(self) -> dict[str, Any]:
        """Settings for the page's script: each row of deviations as integer steps of two bytes."""
        largest = np.abs(self._numbers).max(axis=1)
        steps = np.rint(_STEPS * self._numbers / np.where(largest > 0, largest, 1.0)[:, None]).astype("<i2")
        return {
            "count": self._numbers.shape[1],
            "centre": self._centre.tolist(),
            "deviations": [base64.b64encode(row.tobytes()).decode("ascii") for row in steps],
            # value of one step
            "slopes": _rounded(self._slopes * (largest / _STEPS)[:, None]),
            "group": self._group,
            "variances": _rounded(self._variances),
        }

    @staticmethod
    def _rows(jacobian: Array, deviations: Array, weights: Array) -> tuple[Array, Array]:
        """Return a group's slopes ``(6, r)`` and numbers ``(r, M)``, r ≤ 6; their product is the group's error."""
        if len(deviations) <= _DIMENSION:
            return jacobian, deviations
        # many numbers span at most six directions
        directions, sizes, _ = np.linalg.svd(weights[:, None] * (jacobian @ deviations), full_matrices=False)
        kept = directions[:, sizes > 1e-12 * sizes.max()] if sizes.max() > 0 else directions[:, :1]
        return kept / weights[:, None], kept.T @ (weights[:, None] * (jacobian @ deviations))

    def _covariance(self, at: PoseModel, jacobian: Array) -> Array:
        """Return the groups' parts of the variance of the position, ``(G, G)``, m²; their sum is the variance."""
        rows = []
        for columns in self._columns:
            alone = np.zeros((3, at.space.size))
            alone[:, columns] = jacobian[:3, columns]
            with_all = at.space.block_covariance.times(alone.T)
            rows.append([float(np.einsum("ij,ji->", jacobian[:3, other], with_all[other])) for other in self._columns])
        return np.array(rows)


def _rounded(numbers: Array) -> list[list[float]]:
    return [[float(f"{number:.9g}") for number in row] for row in numbers.tolist()]


def link_shares(at: PoseModel) -> list[float]:
    """Return the first-order share of each chain link, with the joint before it, in the variance of the position."""
    shares = np.zeros(len(at.posture.link_poses))
    for link, part in by_key(at, moved_link).items():
        shares[link] = part[:3].sum()
    total = shares.sum()
    return (shares / total if total > 0 else shares).tolist()


def shown_names(names: Sequence[str]) -> list[str]:
    """Return printable names; the page's script inserts them as text."""
    return [html.unescape(escaped(name)) for name in names]
