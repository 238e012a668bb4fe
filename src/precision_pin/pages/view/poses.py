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
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.analyses.shares import by_key, moved_link, noise_of_datums
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.draws.draw import Scope
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import Part, PoseModel, origin_shares
from precision_pin.pages.view.headline import CONFIDENCE, LEVELS, Answer, answers, quantile
from precision_pin.pages.view.scales import arm_length
from precision_pin.render.html import escaped
from precision_pin.render.tables import resting_on
from precision_pin.sampling import Progress
from precision_pin.sampling.clouds import sample_errors
from precision_pin.sampling.verdict_grounds import by_both_models, exact_findings_at, grounds_at
from precision_pin.statistics import NO_GROUNDS, Grounds, Specification, quantile_ranks

MOST_TOLERANCES: Final = 12
"""Number of tolerances with their own slider; all others share one."""

_STEPS: Final = 32_767
_DIMENSION: Final = 6


@dataclass(frozen=True)
class Groups:
    """Names and indices of draws that are scaled together: the largest contributors alone, the others as one group."""

    names: tuple[str, ...]
    draws: tuple[tuple[int, ...], ...]


def tangent_of(at: PoseModel, model: str) -> tuple[Array, Array]:
    """Return the first-order model of ``exact`` or ``linear`` errors: ``(6,)`` at every mean, and Jacobian ``(6, d)``."""
    if model == "exact":
        return at.tangent
    mean = at.space.mean
    jacobian = np.zeros((6, at.space.size))
    for sensitivity, local in zip(at.table.sensitivities, at.table.displacement_slopes(mean), strict=True):
        jacobian[:, local.columns] += sensitivity @ local.slopes
    if at.datum is not None:
        jacobian += at.datum.noise + sum(gain @ tangent_of(visit, model)[1] for gain, visit in at.datum.counted)
    return at.linear(mean[:, None])[:, 0], jacobian


def choose_groups(pose_models: Sequence[PoseModel], words: Sequence[str] = (), *, attitude: bool = False) -> Groups:
    """Return the tolerances of a page, those that contribute most to the spread at one of its poses first.

    ``words`` describe the draws (by default their names); those of the attitude alone count only with ``attitude``.
    """
    space = pose_models[0].space
    share = np.zeros(len(space.draws))
    for at in pose_models:
        covariances = np.array(
            [
                np.einsum("ij,jk,ik->i", at.jacobian[:, columns], draw.covariance, at.jacobian[:, columns])
                for draw, columns in zip(space.draws, space.slices, strict=True)
            ]
        ).reshape(-1, 6)
        for rows in (slice(0, 3), slice(3, 6))[: 1 + attitude]:
            part = covariances[:, rows].sum(axis=1)
            share = np.maximum(share, part / (part.sum() or 1.0))
    ranked = [int(k) for k in np.argsort(-share, kind="stable") if share[k] > 1e-9]
    alone = ranked if len(ranked) <= MOST_TOLERANCES + 1 else ranked[:MOST_TOLERANCES]
    remaining = ranked[len(alone) :]
    pairs = zip(words, (draw.tolerance for draw in space.draws), strict=False)
    known = [", ".join(filter(None, pair)) for pair in pairs] or [draw.name for draw in space.draws]
    names = [known[k] for k in alone] + ([f"{len(remaining)} smaller ones together"] if remaining else [])
    return Groups(tuple(names), (*((k,) for k in alone), *((tuple(remaining),) if remaining else ())))


def samples_that_fit(space: Space, groups: Groups, poses: int) -> int:
    """Return how many samples fit the size limit; draws made once for each robot are stored once for all poses."""
    once, each = 0, 0
    for draws in groups.draws:
        numbers = sum(space.draws[k].law.size for k in draws)
        if numbers <= _DIMENSION and all(space.draws[k].scope is Scope.UNIT for k in draws):
            once += numbers
        else:
            each += min(_DIMENSION, numbers)
    # 600,000 deviations in a page, two bytes each
    return max(1, 600_000 // max(1, once + poses * each))


def share_rows(poses: Sequence[dict[str, Any]]) -> list[str]:
    """Return the distinct rows of deviations of all poses, and store their indices in the poses' settings."""
    rows: dict[str, int] = {}
    for numbers in (pose["live"] for pose in poses if pose["live"] is not None):
        numbers["deviations"] = [rows.setdefault(row, len(rows)) for row in numbers["deviations"]]
    return list(rows)


def link_shares(at: PoseModel) -> list[float]:
    """Return the first-order share of each chain link, with the joint before it, in the variance of the position."""
    shares = np.zeros(len(at.posture.link_poses))
    for link, part in by_key(at, moved_link).items():
        shares[link] = part[:3].sum()
    total = shares.sum() + sum(part[:3].sum() for part in noise_of_datums(at).values())
    return (shares / total if total > 0 else shares).tolist()


def shown_names(names: Iterable[str]) -> list[str]:
    """Return printable names; the page's script inserts them as text."""
    return [html.unescape(escaped(name)) for name in names]


MOST_FRAMES: Final = 5
"""Number of sampled end-effector frames drawn."""

MOST_GHOSTS: Final = 3
"""Number of arms as built."""

SHARES: Final = (0.95, 0.9973)
"""Fractions drawn as ellipsoids, the inner one first."""

# relative spread of a direction, by the widest, below which it is rounding
_FLAT: Final = 1e-9


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


def sample_views(
    error_model: ErrorModel,
    poses: Sequence[tuple[Any, str]],
    *,
    samples: int,
    seed: int,
    model: Literal["exact", "linear"],
    specifications: Sequence[Specification] = (),
    progress: Progress = lambda _: None,
) -> tuple[list[ViewPose], list[tuple[Finding, ...]]]:
    """Return the errors of the same robots at every pose, given with its name, and the findings at each.

    The verdicts on ``specifications`` are grounded.
    """
    views, findings = [], []
    for number, (pose, name) in enumerate(poses):
        at = error_model.at(pose)
        findings.append((*at.findings(model), *error_model.statics_findings(at), *exact_findings_at(error_model, at)))
        grounds = grounds_at(error_model, at.posture.q[:, None], both=by_both_models([at], model, seed, specifications))
        errors = sample_errors(at, samples, seed=seed, model=model, pose=number, progress=progress)
        views.append(ViewPose(at, errors, name or None, number, error_model.draw_words, grounds))
    return views, findings


def remarks_on(error_model: ErrorModel, views: Sequence[ViewPose]) -> list[str]:
    """Return lines that say how much of the answer rests on assumptions."""
    shares = origin_shares(error_model.origins, views[0].pose_model)
    return resting_on(error_model.assumed, len(error_model.sources), shares)


@dataclass(frozen=True, eq=False)
class PageData:
    """Data of all poses of a page; ``points``: most samples drawn at a pose, ``count``: number of poses."""

    seed: int
    parts: Sequence[Part]
    points: int
    count: int
    groups: Groups
    specifications: Sequence[Specification]


class PoseData:
    """Pose ``number`` (from 1) of a page, with its checked errors ``(6, N)``.

    Attributes:
        texts: Texts of the page by the identifier of their element, not yet escaped.
        settings: The pose as the page's script reads it; matrices are 16 numbers by columns, long arrays base64 of float32.
        ghosts: Displacements ``(K, 6)`` of the targets of the first units; none if the errors are not theirs.
        deflected: The same with every draw at its mean.
    """

    def __init__(self, shown: ViewPose, page: PageData, number: int) -> None:
        at, errors = shown.pose_model, shown.errors
        samples = errors.shape[1]
        points = min(page.points, samples)
        rank = f"({number} of {page.count})" if page.count > 1 else ""
        title = " ".join(filter(None, (shown.name, rank))) or "without a name"
        drawn = "" if points == samples else f", of which the first {points:,} are drawn"
        self.ellipsoids = ellipsoids(errors[:3])
        inside = [f"{100 * ellipsoid.inside:.2f} % of the samples inside" for ellipsoid in self.ellipsoids]
        inside = inside or ["none, too few samples or no spread"] * len(SHARES)
        self.answers = _answers(shown, page.specifications)
        self.texts = {
            "pose-text": title,
            "caption-pose": title,
            "caption-joints": ", ".join(
                f"{joint.name} {1e3 * q:.5g} mm" if joint.kind == "prismatic" else f"{joint.name} {np.degrees(q):.5g}°"
                for joint, q in zip(at.posture.chain.joints, at.posture.q, strict=True)
            ),
            "caption-samples": f"N = {samples:,}{drawn}",
            "drawn": f"{points:,}",
            "inside-inner": inside[0],
            "inside-outer": inside[1],
        }
        x = at.space.sample(page.seed, 0, min(MOST_GHOSTS, samples), pose=shown.pose)
        model = _model_of(shown, x)
        self.ghosts = _displacements(at, x) if model and at.table.targets else ()
        (self.deflected,) = _displacements(at, at.space.mean[:, None])
        attitude = errors[3:, :points].T if limits_attitude(page.specifications) else ()
        marks = [quantile(np.linalg.norm(errors[:3], axis=0), level) for level in LEVELS]
        self.settings = {
            "links": [columns(pose) for pose in at.posture.link_poses],
            "tip": columns(at.posture.pose),
            "points": _packed(errors[:3, :points].T),
            "turns": _packed(attitude),
            "answers": [astuple(answer) for answer in self.answers],
            "grounds": [shown.grounds.why, shown.grounds.taken],
            "marks": [None if mark is None else [mark[0], *mark[1]] for mark in marks],
            "shares": link_shares(at),
            "live": _live(shown, page, model, points),
            "mean": errors.mean(axis=1).tolist(),
            "ellipsoids": [columns(ellipsoid.matrix) for ellipsoid in self.ellipsoids],
            "frames": errors[:, :MOST_FRAMES].T.tolist(),
            "targets": _packed(_target_frames(at).swapaxes(1, 2)),
            "before": [(at.datum is not None) + part.targets_before(at.table.targets) for part in page.parts],
            "ghosts": [_packed(displacements) for displacements in self.ghosts],
            "deflected": _packed(self.deflected),
            # the script inserts them as text, never as markup
            "texts": dict(zip(self.texts, shown_names(self.texts.values()), strict=True)),
        }


def _model_of(view_pose: ViewPose, x: Array) -> str | None:
    """Return the model that gives the first errors with these numbers, None if neither does."""
    at, errors = view_pose.pose_model, view_pose.errors[:, : x.shape[1]]
    for model, errors_of in (("exact", at.exact), ("linear", at.linear)):
        with suppress(InputError):
            if np.allclose(errors_of(x), errors, rtol=1e-6, atol=1e-12):
                return model
    return None


def _displacements(at: PoseModel, x: Array) -> tuple[Array, ...]:
    """Return the displacements ``(K, 6)`` of the targets of each unit, for component values ``(d, N)``.

    Against a datum the first one moves the whole arm, so that its tip errs as in the datum.
    """
    displacements = at.table.displacements(at.table.products(at.table.program.evaluate(x)))
    if at.datum is not None:
        (error, shift), (built, built_shift) = (_displaced_tip(at, model.exact(x)) for model in (at, at.arm))
        turn = np.einsum("ijn,kjn->ikn", error, built)
        moved = shift - np.einsum("ijn,jn->in", turn, built_shift)
        whole = np.concatenate([moved, se3.log_rotation(turn)])
        displacements = np.concatenate([whole[None], displacements])
    return tuple(displacements.transpose(2, 0, 1))


def _target_frames(at: PoseModel) -> Array:
    """Return the frames ``(K, 4, 4)`` of the targets; against a datum the base is one."""
    return at.table.frames if at.datum is None else np.concatenate([np.eye(4)[None], at.table.frames])


def _displaced_tip(at: PoseModel, errors: Array) -> tuple[Array, Array]:
    """Return the rotations ``(3, 3, N)`` and positions ``(3, N)`` of tips with errors ``(6, N)``."""
    return se3.exp_rotation(errors[3:]), at.posture.pose[:3, 3, None] + errors[:3]


def _live(view_pose: ViewPose, page: PageData, model: str | None, points: int) -> dict[str, Any] | None:
    """Return the numbers with which samples follow the sliders, for as many samples as the size limit allows."""
    at, groups = view_pose.pose_model, page.groups
    if model is None or not groups.names:
        return None
    room = samples_that_fit(at.space, groups, page.count)
    x = at.space.sample(page.seed, 0, min(points, room), pose=view_pose.pose)
    centre, jacobian = tangent_of(at, model)
    # the arm's length weights attitude errors against position errors
    weights = np.repeat([1.0, arm_length(at.posture)], 3)[:, None]
    group_columns = [
        [column for k in draws for column in range(at.space.slices[k].start, at.space.slices[k].stop)]
        for draws in groups.draws
    ]
    parts = [_rows(jacobian[:, part], x[part] - at.space.mean[part, None], weights) for part in group_columns]
    numbers = np.concatenate([numbers for _, numbers in parts])
    largest = np.abs(numbers).max(axis=1)
    # each row of deviations as integer steps of two bytes
    steps = np.rint(_STEPS * numbers / np.where(largest > 0, largest, 1.0)[:, None]).astype("<i2")
    return {
        "count": numbers.shape[1],
        "centre": centre.tolist(),
        "deviations": [base64.b64encode(row.tobytes()).decode("ascii") for row in steps],
        # value of one step
        "slopes": _rounded(np.concatenate([slopes.T for slopes, _ in parts]) * (largest / _STEPS)[:, None]),
        "group": [number for number, (slopes, _) in enumerate(parts) for _ in range(slopes.shape[1])],
        "variances": _rounded(_variances(at, jacobian, group_columns)),
        "ranks": [quantile_ranks(x.shape[1], level, CONFIDENCE) for level in LEVELS],
        "reach": [[ellipsoid_reach(share, freedom) for share in SHARES] for freedom in (1, 2, 3)],
    }


def _rows(jacobian: Array, deviations: Array, weights: Array) -> tuple[Array, Array]:
    """Return a group's slopes ``(6, r)`` and numbers ``(r, M)``, r ≤ 6; their product is the group's error."""
    if len(deviations) <= _DIMENSION:
        return jacobian, deviations
    # many numbers span at most six directions
    weighted = weights * (jacobian @ deviations)
    directions, sizes, _ = np.linalg.svd(weighted, full_matrices=False)
    basis = directions[:, sizes > 1e-12 * sizes.max()] if sizes.max() > 0 else directions[:, :1]
    return basis / weights, basis.T @ weighted


def _variances(at: PoseModel, jacobian: Array, group_columns: Sequence[list[int]]) -> Array:
    """Return the groups' parts of the variance of the position, ``(G, G)``, m²; their sum is the variance."""
    rows = []
    for part in group_columns:
        alone = np.zeros((3, at.space.size))
        alone[:, part] = jacobian[:3, part]
        with_all = at.space.block_covariance.times(alone.T)
        rows.append([float(np.einsum("ij,ji->", jacobian[:3, other], with_all[other])) for other in group_columns])
    return np.array(rows)


def _rounded(numbers: Array) -> list[list[float]]:
    return [[float(f"{number:.9g}") for number in row] for row in numbers.tolist()]


def limits_kept(view_poses: Sequence[ViewPose], specifications: Sequence[Specification]) -> bool:
    """Return whether every limit is met at every pose."""
    return all(answer.verdict in ("", "met") for pose in view_poses for answer in _answers(pose, specifications))


def _answers(view_pose: ViewPose, specifications: Sequence[Specification]) -> tuple[Answer, ...]:
    at = view_pose.pose_model
    return answers(view_pose.errors, specifications, at.covariance, view_pose.grounds, at.posture.tool_axes)


def limits_attitude(specifications: Sequence[Specification]) -> bool:
    """Return whether any limit is of the attitude."""
    return any(quantity.startswith("attitude") for limit in specifications for quantity, _ in limit.parts)


def columns(pose: ArrayLike) -> list[float]:
    """Return a pose ``(4, 4)`` as 16 numbers by columns."""
    return np.asarray(pose, dtype=float).T.reshape(-1).tolist()


def _packed(numbers: ArrayLike) -> str:
    return base64.b64encode(np.asarray(numbers, dtype="<f4").tobytes()).decode("ascii")


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
    if count < 4:  # three only span a plane
        return ()
    centred = values - mean[:, None]
    directions, singular, _ = np.linalg.svd(centred, full_matrices=False)
    deviations = singular / math.sqrt(count - 1)
    if deviations[0] <= _FLAT * np.abs(values).max():
        return ()
    spread = deviations > _FLAT * deviations[0]
    scaled = (directions.T @ centred)[spread] / deviations[spread, None]
    squares = (scaled * scaled).sum(axis=0)
    # a direction without spread has half an axis that can still be drawn
    axes = np.maximum(deviations, 1e-4 * deviations[0])
    reaches = [ellipsoid_reach(share, int(spread.sum())) for share in SHARES]
    return tuple(
        Ellipsoid(share, se3.pose(directions * (reach * axes), mean), float((squares <= reach**2).mean()))
        for share, reach in zip(SHARES, reaches, strict=True)
    )


def ellipsoid_reach(share: float, freedom: int) -> float:
    """Return half an axis in standard deviations: the root of a chi-square quantile, 1 to 3 degrees of freedom."""
    # imported late, it costs 0.1 s; a chi-square variable is twice a gamma variable of half its degrees of freedom
    from scipy.special import gammaincinv

    return math.sqrt(2 * float(gammaincinv(freedom / 2, share)))
