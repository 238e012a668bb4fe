"""Simulated tests of built robots: every robot comes n times to each pose, which gives the figures of its test.

Draws of unit scope are the same in all cycles of a robot, those of pose scope in all its cycles at a pose, those of
visit scope new in every cycle. A robot's figures depend on model, seed and its number only, for any number of threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final, final

import numpy as np

from precision_pin.analyses.iso9283.cube import paths_of_approach
from precision_pin.analyses.iso9283.figures import (
    angles_of,
    barycentre,
    distance_figures,
    pose_figures,
    repeatability_limit,
    turn_angles,
)
from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.draws.draw import Scope
from precision_pin.kernel import sampler
from precision_pin.kernel.arrays import SamplerArrays
from precision_pin.model.error_model import ErrorModel
from precision_pin.sampling.approaches import ApproachErrors, sample_approaches

ROBOTS: Final = 512
"""Robots that are tested together: enough for the compiled loops, few enough for the cache."""
DISTANCE: Final = (1, 3)
"""Indices of the two poses of AD and RD, P2 and P4."""
# step of a difference quotient in standard deviations of a visit's draws: inside the support of every law
_STEP: Final = 0.5
# visits of the mean robot that determine the shape of a cloud that is not normal
_VISITS: Final = 2**14


@final
@dataclass(frozen=True, eq=False)
class Setup:
    """Data common to all robots.

    Attributes:
        layouts: The model at each pose.
        commanded: Commanded poses of the tip, ``(P, 4, 4)``.
        target: The measured point in tool axes, m, ``(3,)``.
        seed, cycles: 64-bit seed, and cycles of a test.
        fit_base: Whether positions and orientations are aligned by the best fit over the poses.
        root: ``(d, r)``, from `visit_root`.
        shape: ``(P,)``, from `shape_factor`.
    """

    layouts: tuple[SamplerArrays, ...]
    commanded: Array
    target: Array
    seed: int
    cycles: int
    fit_base: bool
    root: Array
    shape: Array

    @property
    def points(self) -> Array:
        """Commanded positions of the target, ``(P, 3)``."""
        return self.commanded[:, :3, 3] + np.einsum("pij,j->pi", self.commanded[:, :3, :3], self.target)


@final
@dataclass(frozen=True, eq=False)
class RobotFigures:
    """Figures of N robots, each tested once, m and rad; the last axis of every array is the robot.

    Attributes:
        AP, RP, RP_limit: ``(P, N)``; the last is RP of infinitely many cycles.
        AP_xyz, AP_abc, RP_abc: ``(P, 3, N)``.
        AD, RD: ``(1, N)``, or ``(0, N)`` with fewer than four poses.
        first: Barycentre minus commanded position at P1, without any fit, ``(3, N)``.
    """

    AP: Array
    RP: Array
    RP_limit: Array
    AP_xyz: Array
    AP_abc: Array
    RP_abc: Array
    AD: Array
    RD: Array
    first: Array

    @classmethod
    def joined(cls, parts: list[RobotFigures]) -> RobotFigures:
        """Concatenate the figures of consecutive robots."""
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names})


def simulate_tests(setup: Setup, first: int, count: int) -> RobotFigures:
    """Return the figures of robots ``first … first + count - 1``."""
    moved, turned = [], []
    for pose, layout in enumerate(setup.layouts):
        errors = _errors(setup, layout, pose, first, count)
        moved.append(_at_target(setup, pose, errors))
        turned.append(errors[:, 3:])
    angles = [_angles(vectors) for vectors in turned]
    found = [pose_figures(*both) for both in zip(moved, angles, strict=True)]
    distances = []
    if len(moved) > max(DISTANCE):
        one, other = setup.points[list(DISTANCE)]
        attained = (moved[k] + at[:, None] for k, at in zip(DISTANCE, (one, other), strict=True))
        distances = [distance_figures(one - other, *attained)]
    names = ("AP_xyz", "AP_abc", "RP", "RP_abc")
    accuracy, mean_angles, repeated, scatter_angles = (np.stack([getattr(at, name) for at in found]) for name in names)
    unfitted = accuracy[0]
    if setup.fit_base:
        turn, accuracy = fit_to(setup.points, accuracy)
        fitted = [_angles(vectors, turn) for vectors in turned]
        mean_angles = np.stack([barycentre(one) for one in fitted])
    return RobotFigures(
        AP=np.sqrt((accuracy * accuracy).sum(axis=1)),
        RP=repeated,
        RP_limit=np.stack([_limit(setup, pose, first, count) for pose in range(len(setup.layouts))]),
        AP_xyz=accuracy,
        AP_abc=mean_angles,
        RP_abc=scatter_angles,
        AD=np.array([at.AD for at in distances]).reshape(-1, count),
        RD=np.array([at.RD for at in distances]).reshape(-1, count),
        first=unfitted,
    )


def visit_root(layout: SamplerArrays) -> Array:
    """Return C ``(d, r)`` with C Cᵀ the covariance of the draws of visit scope, zero in all other rows."""
    space = layout.space
    columns = visit_columns(layout)
    root = np.zeros((space.size, columns.size))
    values, vectors = np.linalg.eigh(space.block_covariance.within(columns))
    root[columns] = vectors * np.sqrt(np.maximum(values, 0.0))
    return root[:, (root != 0).any(axis=0)]


def visit_columns(layout: SamplerArrays) -> Array:
    """Return the components of visit scope that vary."""
    space = layout.space
    columns = [
        column
        for draw, of_draw in zip(space.draws, space.slices, strict=True)
        if draw.scope is Scope.VISIT and draw.law.streamed
        for column in range(of_draw.start, of_draw.stop)
    ]
    return np.array(columns, dtype=np.intp)


def shape_factor(layout: SamplerArrays, pose: int, seed: int) -> float:
    """Return the limit of RP relative to a normal cloud of the same covariance, 1 if all visit draws are normal."""
    space = layout.space
    laws = [draw.law for draw in space.draws if draw.scope is Scope.VISIT]
    columns = visit_columns(layout)
    if not columns.size or all(law.is_normal for law in laws):
        return 1.0
    x = np.repeat(space.mean[:, None], _VISITS, axis=1)
    x[columns] = sampler.sample(layout, seed, 0, _VISITS, pose=pose)[columns]
    positions = sampler.errors_at(layout, "exact", x)[:3]
    shifted = positions - positions.mean(axis=1)[:, None]
    distances = np.sqrt((shifted * shifted).sum(axis=0))
    normal = float(repeatability_limit(np.einsum("in,jn->ij", shifted, shifted) / _VISITS))
    return float(distances.mean() + 3 * distances.std()) / normal if normal > 0 else 1.0


# private -------------------------------------------------------------------------------------------------------------


def _errors(setup: Setup, layout: SamplerArrays, pose: int, first: int, count: int) -> Array:
    """Return the errors at the visits of a pose, ``(cycles, 6, N)``."""
    errors = np.empty((setup.cycles, 6, count))
    # without draws of visit scope all cycles are the same
    different = setup.cycles if setup.root.shape[1] else 1
    for visit in range(different):
        errors[visit] = sampler.errors(layout, "exact", setup.seed, first, count, pose=pose, visit=visit)
    errors[different:] = errors[0]
    return errors


def _at_target(setup: Setup, pose: int, errors: Array) -> Array:
    """Return the displacement of the target from its commanded position, ``(cycles, 3, N)``."""
    if not setup.target.any():
        return errors[:, :3]
    lever = np.einsum("ij,j->i", setup.commanded[pose, :3, :3], setup.target)
    result = np.empty((len(errors), 3, errors.shape[2]))
    for cycle, error in enumerate(errors):
        rotation = se3.exp_rotation(error[3:])
        result[cycle] = error[:3] + np.einsum("ijn,j->in", rotation, lever) - lever[:, None]
    return result


def _angles(vectors: Array, turn: Array | None = None) -> Array:
    """Return a, b, c ``(cycles, 3, N)`` of rotation vectors, after a further rotation ``(3, 3, N)`` of the base."""
    if turn is None:
        return np.stack([turn_angles(one) for one in vectors])
    return np.stack([angles_of(np.einsum("ijn,jkn->ikn", turn, se3.exp_rotation(one))) for one in vectors])


def fit_to(points: Array, deviations: Array) -> tuple[Array, Array]:
    """Return rotation ``(3, 3, N)`` and residuals of AP_xyz of the best fit of the barycentres to the commanded points.

    The fit minimises the sum of squared distances at the poses over all motions of the base (Kabsch 1976).
    """
    attained = points[:, :, None] + deviations
    centre, wanted = attained.mean(axis=0), points.mean(axis=0)
    cross = np.einsum("pi,pjn->nij", points - wanted, attained - centre)
    left, _, right = np.linalg.svd(cross)
    # a reflection is not a motion
    left[:, :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    turn = np.einsum("nij,njk->ikn", left, right)
    moved = np.einsum("ijn,pjn->pin", turn, attained - centre) + wanted[:, None]
    return turn, moved - points[:, :, None]


def _limit(setup: Setup, pose: int, first: int, count: int) -> Array:
    """Return RP of infinitely many cycles of each robot, ``(N,)``; its cloud is first order in the visits' draws."""
    layout, root = setup.layouts[pose], setup.root
    if not root.shape[1]:
        return np.zeros(count)
    x = sampler.sample(layout, setup.seed, first, count, pose=pose)
    columns = visit_columns(layout)
    x[columns] = layout.space.mean[columns][:, None]
    slopes = np.empty((root.shape[1], 3, count))
    for k, direction in enumerate(_STEP * root.T[:, :, None]):
        ends = np.stack([sampler.errors_at(layout, "exact", x + side * direction) for side in (1, -1)])
        moved = _at_target(setup, pose, ends)
        slopes[k] = (moved[0] - moved[1]) / (2 * _STEP)
    covariance = np.einsum("kin,kjn->nij", slopes, slopes)
    return setup.shape[pose] * repeatability_limit(covariance)


def approach_figures(
    error_model: ErrorModel, q: Array, target: Array, robots: int, cycles: int, seed: int
) -> ApproachErrors | None:
    """Return the errors of visits over paths along the base axes; ``None`` if no error depends on the path.

    ``q`` is ``(n,)``, the measured point ``target`` is in tool axes, m, ``(3,)``; ``cycles`` are those of each path.
    """
    posture = error_model.at(q).posture
    lever = posture.pose[:3, :3] @ target
    jacobian = error_model.chain.at_columns(q[:, None]).joint_jacobian[:, :, 0].copy()
    jacobian[:3] += np.cross(jacobian[3:], lever, axis=0)
    ways = paths_of_approach(jacobian)
    if not _follows(error_model, q, ways):
        return None
    return sample_approaches(error_model, q, approaches=ways, robots=robots, cycles=cycles, seed=seed, target=target)


def _follows(error_model: ErrorModel, q: Array, ways: Sequence[tuple[int, ...]]) -> bool:
    """Return whether any source's terms differ for another approach."""
    first, *others = [error_model.at(q, approach=way).terms for way in ways]
    return any(
        [term.factors for term in terms] != [term.factors for term in first]
        or any(not np.array_equal(one.twist, other.twist) for one, other in zip(terms, first, strict=True))
        for terms in others
    )


HOURS: Final = 8.0
"""Duration of the test; the standard ends it there, or earlier once the drift is slow."""
# times at which AP is measured, the first at the start: every half hour
_TESTS: Final = 17


def drift_from_cold(
    error_model: ErrorModel, q: Array, target: Array, robots: int, cycles: int, seed: int
) -> Array | None:
    """Return ``max |AP_0 - AP_t|`` of each robot over a test that starts cold, m, ``(N,)``; ``None`` if none drifts."""
    bound = error_model.bound_sources
    if all(one.source.after(0.0, one.view) is one.source for one in bound):
        return None
    found = []
    for k, seconds in enumerate(np.linspace(0.0, 3600 * HOURS, _TESTS)):
        sources = [one.source.after(float(seconds), one.view) for one in bound]
        model = ErrorModel(error_model.chain, error_model.space, sources, statics=error_model.statics)
        found.append(_accuracy(model, q, target, robots, range(k * cycles, (k + 1) * cycles), seed))
    return np.abs(np.array(found[1:]) - found[0]).max(axis=0)


def _accuracy(model: ErrorModel, q: Array, target: Array, robots: int, visits: range, seed: int) -> Array:
    """Return AP of each robot, ``(N,)``: the distance of the barycentre of its visits from the commanded position."""
    at = model.at(q)
    layout = sampler.to_arrays(at)
    lever = at.posture.pose[:3, :3] @ target
    barycentre = np.zeros((3, robots))
    for visit in visits:
        error = sampler.errors(layout, "exact", seed, 0, robots, visit=visit)
        barycentre += error[:3] + np.einsum("ijn,j->in", se3.exp_rotation(error[3:]), lever) - lever[:, None]
    return np.sqrt(((barycentre / len(visits)) ** 2).sum(axis=0))
