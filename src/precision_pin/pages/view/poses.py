"""Data of each pose for the page: poses of links, errors to draw and their ellipsoids, texts."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.model.pose_model import Part, PoseModel
from precision_pin.pages.view.headline import CONFIDENCE, LEVELS, Answer, answers, as_data, quantile
from precision_pin.pages.view.scales import arm_length
from precision_pin.pages.view.tolerances import Groups, LivePose, link_shares, samples_that_fit, tangent_of
from precision_pin.render.html import escaped
from precision_pin.robot import mcpc
from precision_pin.robot.chain import Posture
from precision_pin.statistics import NO_GROUNDS, Grounds, Specification, quantile_ranks

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
