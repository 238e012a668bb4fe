"""Data of each pose for the page: poses of links, errors to draw, texts, and the effect of each tolerance to first order.

The deviation of a draw from its mean moves the tip by J times the deviation. A tolerance k times as wide moves it k
times as far, for any law. A sample of the changed sheet is therefore

    e = e₀ + Σ k_g J_g (x_g − mean_g) + s r,

with r the remainder of the sample beyond first order, and s the current variance relative to the sheet's, because the
remainder is of second order. With every k at 1 it is the sample itself.
"""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.analyses.budget.shares import by_key, moved_link
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space
from precision_pin.model.pose_model import Part, PoseModel
from precision_pin.pages.view.headline import CONFIDENCE, LEVELS, Answer, answers, as_data, quantile
from precision_pin.pages.view.scales import arm_length
from precision_pin.render.html import escaped
from precision_pin.robot import mcpc
from precision_pin.robot.chain import Posture
from precision_pin.statistics import NO_GROUNDS, Grounds, Specification, quantile_ranks

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


MOST_FRAMES: Final = 5
"""Number of sampled end-effector frames drawn."""

MOST_GHOSTS: Final = 3
"""Number of arms as built."""

SHARES: Final = (0.95, 0.9973)
"""Fractions drawn as ellipsoids, the inner one first."""

FEWEST: Final = 4
"""Fewest samples for an ellipsoid: three only span a plane."""

# relative spread of a direction, by the widest, below which it is rounding
_FLAT: Final = 1e-9
# half axis of a direction without spread, relative to the longest, so that the ellipsoid can still be drawn
_THINNEST: Final = 1e-4


@final
@dataclass(frozen=True, eq=False)
class ViewPose:
    """A pose and the errors sampled there.

    Attributes:
        errors: Its errors ``(6, N)``, ``[d; δ]`` in base axes, m and rad; those of units 0 to N - 1 if sampled.
        name: The pose's name, for the caption; ``None`` for a pose without one.
        pose: Number of the pose for draws of pose scope, as in :meth:`precision_pin.draws.space.Space.sample`.
        words: Description of each draw, as :attr:`precision_pin.model.error_model.ErrorModel.draw_words`.
        grounds: Why limits cannot be judged there, and what is taken as exact.
    """

    pose_model: PoseModel
    errors: Array
    name: str | None = None
    pose: int = 0
    words: tuple[str, ...] = ()
    grounds: Grounds = NO_GROUNDS


@final
@dataclass(frozen=True, eq=False)
class PageData:
    """Data of all poses of a page; ``points``: most samples drawn at a pose, ``count``: number of poses."""

    seed: int
    parts: Sequence[Part]
    points: int
    count: int
    groups: Groups
    specifications: Sequence[Specification]


@final
class PoseData:
    """Pose ``number`` (from 1) of a page, with its checked errors ``(6, N)``."""

    def __init__(self, shown: ViewPose, page: PageData, number: int) -> None:
        self._at = shown.pose_model
        self._errors = shown.errors
        self._page = page
        self._shown = shown
        self._points = min(page.points, shown.errors.shape[1])
        rank = f"({number} of {page.count})" if page.count > 1 else ""
        self._title = " ".join(filter(None, (shown.name, rank)))
        self.ellipsoids = ellipsoids(self._errors[:3])
        # relative to the given errors, if they belong to the seed
        self._model = self._model_of(page.seed)
        self.ghosts = self._as_built(page.seed)
        self.deflected = self._displacements(self._at.space.mean[:, None])[:, :, 0]

    @property
    def answers(self) -> tuple[Answer, ...]:
        """The verdict, and the size of the errors."""
        return answers(self._errors, self._page.specifications, _spread(self._at), self._shown.grounds)

    @property
    def texts(self) -> dict[str, str]:
        """Texts of the page by the identifier of their element, not yet escaped."""
        samples = self._errors.shape[1]
        drawn = "" if self._points == samples else f", of which the first {self._points:,} are drawn"
        inside = [f"{100 * one.inside:.2f} % of the samples inside" for one in self.ellipsoids]
        none = ["none, too few samples or no spread"] * 2
        return {
            "pose-text": self._title or "without a name",
            "caption-pose": self._title or "without a name",
            "caption-joints": _joints(self._at.posture),
            "caption-samples": f"N = {samples:,}{drawn}",
            "drawn": f"{self._points:,}",
            **dict(zip(("inside-inner", "inside-outer"), inside or none, strict=True)),
        }

    @property
    def settings(self) -> dict[str, Any]:
        """The pose as the page's script reads it; matrices are 16 numbers by columns, long arrays base64 of float32."""
        posture, errors = self._at.posture, self._errors
        return {
            "links": [columns(pose) for pose in posture.link_poses],
            "tip": columns(posture.pose),
            "points": _packed(errors[:3, : self._points].T),
            "turns": _packed(errors[3:, : self._points].T) if limits_attitude(self._page.specifications) else "",
            "answers": as_data(self.answers),
            "grounds": [self._shown.grounds.why, self._shown.grounds.taken],
            "marks": [None if mark is None else [mark[0], *mark[1]] for mark in map(self._quantile, LEVELS)],
            "shares": link_shares(self._at),
            "live": self._live(),
            "mean": errors.mean(axis=1).tolist(),
            "ellipsoids": [columns(one.matrix) for one in self.ellipsoids],
            "frames": errors[:, :MOST_FRAMES].T.tolist(),
            "targets": _packed(self._at.table.frames.swapaxes(1, 2)),
            "before": [part.targets_before(self._at.table.targets) for part in self._page.parts],
            "ghosts": [_packed(displacements) for displacements in self.ghosts],
            "deflected": _packed(self.deflected),
            # the script inserts them as text, never as markup
            "texts": {name: html.unescape(escaped(text)) for name, text in self.texts.items()},
        }

    def _displacements(self, x: Array) -> Array:
        """Return every target's displacement ``(K, 6, N)`` for component values ``(d, N)``."""
        table = self._at.table
        return table.displacements(table.products(table.program.evaluate(x)))

    def _quantile(self, level: float) -> tuple[float, tuple[float, float]] | None:
        return quantile(np.linalg.norm(self._errors[:3], axis=0), level)

    def _sample(self, seed: int, count: int) -> Array:
        return self._at.space.sample(seed, 0, count, pose=self._shown.pose)

    def _model_of(self, seed: int) -> str | None:
        """Return the model that gives these errors with this seed, None if neither does."""
        count = min(MOST_GHOSTS, self._errors.shape[1])
        x = self._sample(seed, count)
        for model, errors_of in (("exact", self._at.exact), ("linear", self._at.linear)):
            try:
                same = np.allclose(errors_of(x), self._errors[:, :count], rtol=1e-6, atol=1e-12)
            except InputError:
                continue
            if same:
                return model
        return None

    def _as_built(self, seed: int) -> tuple[Array, ...]:
        """Return the targets' displacements ``(K, 6)`` of the first units; none if the errors are not theirs."""
        if self._model is None or not self._at.table.targets:
            return ()
        x = self._sample(seed, min(MOST_GHOSTS, self._errors.shape[1]))
        return tuple(self._displacements(x).transpose(2, 0, 1))

    def _live(self) -> dict[str, Any] | None:
        """Return the numbers with which samples follow the sliders, for as many samples as the size limit allows."""
        if self._model is None or not self._page.groups.names:
            return None
        groups = self._page.groups
        room = samples_that_fit(self._at.space, groups, self._page.count)
        x = self._sample(self._page.seed, min(self._points, room))
        live = LivePose(self._at, groups, x, tangent_of(self._at, self._model), arm_length(self._at.posture))
        return live.settings | {
            "ranks": [quantile_ranks(x.shape[1], level, CONFIDENCE) for level in LEVELS],
            "reach": [[ellipsoid_reach(share, freedom) for share in SHARES] for freedom in (1, 2, 3)],
        }


def limits_kept(shown: Sequence[ViewPose], specifications: Sequence[Specification]) -> bool:
    """Return whether the verdict is that every limit is met at every pose."""
    return all(
        answer.verdict in ("", "met")
        for one in shown
        for answer in answers(one.errors, specifications, _spread(one.pose_model), one.grounds)
    )


def _spread(at: PoseModel) -> Array:
    return np.sqrt(np.maximum(np.diag(at.covariance), 0.0))


def limits_attitude(specifications: Sequence[Specification]) -> bool:
    """Return whether any limit is of the attitude."""
    return any(one.quantity.startswith("attitude") for one in specifications)


def mcpc_frames(posture: Posture) -> list[dict[str, Any]]:
    """Return chain link and pose in it of the MCPC frames 0 to n + 1, the tip (Wei, Jia and Chen, 2015, Fig 4)."""
    frames = mcpc.from_chain(posture.chain).frame_in_link
    standing = [*enumerate(frames), (len(frames) - 1, posture.chain.placements[-1])]
    return [{"link": link, "frame": columns(frame)} for link, frame in standing]


def columns(pose: ArrayLike) -> list[float]:
    """Return a pose ``(4, 4)`` as 16 numbers by columns."""
    return np.asarray(pose, dtype=float).T.reshape(-1).tolist()


def _packed(numbers: ArrayLike) -> str:
    return base64.b64encode(np.asarray(numbers, dtype="<f4").tobytes()).decode("ascii")


def _joints(posture: Posture) -> str:
    return ", ".join(
        f"{joint.name} {1e3 * value:.5g} mm" if joint.kind == "prismatic" else f"{joint.name} {np.degrees(value):.5g}°"
        for joint, value in zip(posture.chain.joints, posture.q, strict=True)
    )


@final
@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An ellipsoid of position errors, with the fraction of the samples inside.

    Attributes:
        share: Probability inside it of a normal law with the samples' mean and covariance.
        matrix: Maps the unit ball to it, ``(4, 4)``, m, base axes, from the nominal tip.
    """

    share: float
    matrix: Array
    inside: float


def ellipsoids(positions: ArrayLike) -> tuple[Ellipsoid, ...]:
    """Return an ellipsoid for each of `SHARES`, for position errors ``(3, N)``, m.

    The squared distance ``(d - mean)ᵀ C⁻¹ (d - mean)`` of a normal law with covariance C in three directions is
    chi-square with 3 degrees of freedom; the ellipsoid ends at its quantile. Samples that spread in only one or two
    directions have as many degrees of freedom and a flat ellipsoid. None for fewer than four samples, or no spread.
    """
    values = np.asarray(positions, dtype=float)
    count = values.shape[1]
    mean = values.mean(axis=1)
    if count < FEWEST:
        return ()
    centred = values - mean[:, None]
    directions, singular, _ = np.linalg.svd(centred, full_matrices=False)
    deviations = singular / math.sqrt(count - 1)
    if deviations[0] <= _FLAT * np.abs(values).max():
        return ()
    spread = deviations > _FLAT * deviations[0]
    scaled = (directions.T @ centred)[spread] / deviations[spread, None]
    squares = (scaled * scaled).sum(axis=0)
    result = []
    for share in SHARES:
        reach = ellipsoid_reach(share, int(spread.sum()))
        matrix = np.eye(4)
        matrix[:3, :3] = directions * (reach * np.maximum(deviations, _THINNEST * deviations[0]))
        matrix[:3, 3] = mean
        result.append(Ellipsoid(share, matrix, float((squares <= reach**2).mean())))
    return tuple(result)


def ellipsoid_reach(share: float, freedom: int) -> float:
    """Return half an axis in standard deviations: the root of a chi-square quantile, 1 to 3 degrees of freedom."""
    # imported late, it costs 0.1 s; a chi-square variable is twice a gamma variable of half its degrees of freedom
    from scipy.special import gammaincinv

    return math.sqrt(2 * float(gammaincinv(freedom / 2, share)))
