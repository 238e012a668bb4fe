"""Which of thousands of tool poses are within reach: one solution of each, by damped Gauss-Newton steps for all at once.

:mod:`precision_pin.robot.inverse_kinematics` finds all solutions of a pose, which takes a thousand times as long. The steps
start from the nearest of many known configurations.

An arm of six joints or more keeps the orientation; one of fewer is free to turn the tool. What is found is checked by the
forward kinematics: position to a micrometre, orientation to a microradian, joints inside their limits. What is not found counts
as out of reach: of 4,000 points about a Panda none that inverse kinematics in closed form reaches.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.robot.chain import Chain

_KNOWN: Final = 40_000
"""Configurations that steps start from, drawn evenly between the limits."""
_SEED: Final = 9283
_STARTS: Final = 10
_NEIGHBOURS: Final = 6
_MANY: Final = 100
"""Points found in a call, from which its solutions are starts of later calls."""
_ITERATIONS: Final = 30
_LONGEST_STEP: Final = 0.5
"""rad, and m."""
_NEAR: Final = 1e-6
"""m and rad."""
_STALLED: Final = 0.9
"""Share of the error that is left after some steps where they lead nowhere."""
_PATIENCE: Final = 6


@final
@dataclass(frozen=True, eq=False)
class ToolPoses:
    """Joint values for points that the tool takes with one orientation.

    Attributes
    ----------
    chain
        The arm.
    orientation
        Of the tool in the base, ``(3, 3)``.
    target
        The point in tool axes that is to be at the points, m.
    """

    chain: Chain
    orientation: Array
    target: Array

    @property
    def keeps_orientation(self) -> bool:
        """Whether the arm has enough joints for the orientation."""
        return len(self.chain.joints) >= 6

    def solve(self, points: Array, starts: Array | None = None) -> Array:
        """Return joint values ``(n, P)`` for points ``(3, P)``, NaN where none are found.

        Parameters
        ----------
        points
            Positions of the target in the base.
        starts
            Configurations ``(n, P)`` to start from. Where left out: the solution of the nearest point that an earlier call
            found, then the nearest known configurations, then the solutions of more points nearby.
        """
        if starts is not None:
            return self._descend(points, starts)
        found = np.full((len(self.chain.joints), points.shape[1]), np.nan)
        if self._found:
            found = self._from(points, self._beside(points, 1), found)
        left = np.flatnonzero(np.isnan(found[0]))
        nearest = self._known[0][:, self._nearest(points[:, left])]
        found[:, left] = self._from(points[:, left], nearest[..., :1], found[:, left])
        still = np.isnan(found[0, left])
        found[:, left[still]] = self._from(points[:, left[still]], nearest[:, still, 1:], found[:, left[still]])
        known, left = np.isfinite(found[0]), np.flatnonzero(np.isnan(found[0]))
        if np.count_nonzero(known) >= (_MANY if self._found else _NEIGHBOURS):
            self._found.append((points[:, known], found[:, known]))
            self.__dict__.pop("_found_tree", None)
        if self._found and left.size:
            # a point that was missed beside some that were found is tried again from there
            found[:, left] = self._from(points[:, left], self._beside(points[:, left], _NEIGHBOURS), found[:, left])
        return found

    def _from(self, points: Array, starts: Array, found: Array) -> Array:
        """Return joint values ``(n, P)`` after steps from starts ``(n, P, K)``, those found before where none arrive."""
        count = starts.shape[2]
        arrived = self._descend(np.repeat(points, count, axis=1), starts.reshape(starts.shape[0], -1))
        arrived = arrived.reshape(starts.shape)
        first = np.argmax(np.isfinite(arrived[0]), axis=1)
        chosen: Array = np.take_along_axis(arrived, first[None, :, None], axis=2)[..., 0]
        return np.where(np.isnan(chosen[:1]), found, chosen)

    def _beside(self, points: Array, count: int) -> Array:
        """Return the solutions ``(n, P, count)`` of the nearest points that were found earlier."""
        tree, q = self._found_tree
        return q[:, tree.query(points.T, k=np.arange(1, count + 1))[1]]

    @cached_property
    def _found(self) -> list[tuple[Array, Array]]:
        """Points and joint values that earlier calls for many points have found."""
        return []

    @cached_property
    def _found_tree(self) -> tuple[cKDTree, Array]:
        points, q = (np.concatenate(parts, axis=1) for parts in zip(*self._found, strict=True))
        return cKDTree(points.T), q

    @property
    def ball(self) -> tuple[Array, float]:
        """Centre and radius of a ball that holds every known position of the target."""
        positions = self._known[1][:, :3]
        middle = (positions.max(axis=0) + positions.min(axis=0)) / 2
        return middle, float(np.abs(positions - middle).max()) * 1.02

    @property
    def _lever(self) -> Array:
        return self.orientation @ self.target

    @cached_property
    def _scale(self) -> float:
        """Length that counts as much as a radian, m."""
        return float(np.linalg.norm(self.chain.placements[1:, :3, 3], axis=1).sum()) / 4 or 1.0

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        low, high = self.chain.configurations.limits
        # a full turn is enough of a joint that turns farther
        turns = (high - low >= 2 * np.pi) & ~np.array(self.chain.prismatic)
        return np.where(turns, -np.pi, low), np.where(turns, np.pi, high)

    @cached_property
    def _known(self) -> tuple[Array, Array]:
        """Configurations ``(n, K)``, and position of the target and scaled axes of the tool, ``(K, 3 or 12)``."""
        low, high = self._limits
        q = low[:, None] + (high - low)[:, None] * np.random.default_rng(_SEED).random((low.size, _KNOWN))
        pose = self.chain.at_columns(q).pose
        return q, self._features(pose[:3, 3] + np.einsum("ijn,j->in", pose[:3, :3], self.target), pose[:3, :3])

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._known[1])

    def _features(self, positions: Array, rotations: Array) -> Array:
        if not self.keeps_orientation:
            return positions.T.copy()
        return np.concatenate([positions.T, self._scale / np.sqrt(2) * rotations.reshape(9, -1).T], axis=1)

    def _nearest(self, points: Array) -> NDArray[np.int64]:
        turned = np.repeat(self.orientation[:, :, None], points.shape[1], axis=2)
        found: NDArray[np.int64] = self._tree.query(self._features(points, turned), k=_STARTS)[1]
        return found

    def _descend(self, points: Array, begin: Array) -> Array:
        """Return joint values ``(n, P)`` after steps from some, NaN where they do not arrive."""
        low, high = self.chain.configurations.limits
        found = np.full(begin.shape, np.nan)
        q, active = begin.copy(), np.arange(points.shape[1])
        before = np.full(points.shape[1], np.inf)
        for iteration in range(_ITERATIONS):
            error, jacobian = self._errors(q[:, active], points[:, active])
            size = np.sqrt((error * error).sum(axis=0))
            arrived = size < _NEAR
            found[:, active[arrived]] = q[:, active[arrived]]
            going = ~arrived
            if iteration % _PATIENCE == _PATIENCE - 1:
                going &= size < _STALLED * before[active]
                before[active] = size
            active, error, jacobian, size = active[going], error[:, going], jacobian[..., going], size[going]
            if not active.size:
                break
            step = _damped_step(jacobian, error, size)
            # a joint that a limit stops is left out: the others reach what it does not, if they can
            here = q[:, active]
            stopped = ((here <= low[:, None]) & (step < 0)) | ((here >= high[:, None]) & (step > 0))
            held = np.flatnonzero(stopped.any(axis=0))
            if held.size:
                step[:, held] = _damped_step(jacobian[..., held] * ~stopped[:, held], error[:, held], size[held])
            step *= np.minimum(1.0, _LONGEST_STEP / np.maximum(np.abs(step).max(axis=0), 1e-300))
            q[:, active] = np.clip(q[:, active] + step, low[:, None], high[:, None])
        return found

    def _errors(self, q: Array, points: Array) -> tuple[Array, Array]:
        """Return what is missing, ``(3 or 6, P)``, angles in units of length, and its slopes by the joints."""
        many = self.chain.at_columns(q)
        pose, jacobian = many.pose, many.joint_jacobian
        lever = np.einsum("ijn,j->in", pose[:3, :3], self.target)
        moved = jacobian[:3] + np.cross(jacobian[3:], lever[:, None], axis=0)
        missing = points - pose[:3, 3] - lever
        if not self.keeps_orientation:
            return missing, moved
        turn = se3.log_rotation(np.einsum("ij,kjn->ikn", self.orientation, pose[:3, :3]))
        return np.concatenate([missing, self._scale * turn]), np.concatenate([moved, self._scale * jacobian[3:]])


def _damped_step(jacobian: Array, error: Array, size: Array) -> Array:
    """Return Jᵀ (J Jᵀ + λ 1)⁻¹ e, ``(n, P)``, damped by the square of the error (Sugihara 2011)."""
    slopes = np.moveaxis(jacobian, -1, 0)
    square = slopes @ slopes.transpose(0, 2, 1)
    square += (1e-2 * size**2 + 1e-12)[:, None, None] * np.eye(square.shape[-1])
    weights = np.linalg.solve(square, error.T[..., None])
    step: Array = (slopes.transpose(0, 2, 1) @ weights)[..., 0].T
    return step
