"""The same built robots at one pose under several approaches: repeatability, and distance between the approaches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, final

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arguments import check_instance, check_items, check_memory, check_quantities, check_whole
from precision_pin.base.arrays import Array, Fixed, returns_read_only
from precision_pin.base.errors import InputError
from precision_pin.base.units import LENGTH
from precision_pin.draws.draw import MOST_POSES, MOST_VISITS
from precision_pin.draws.space import check_seed
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.configurations import Approach


@final
@dataclass(frozen=True, eq=False)
class ApproachErrors(Fixed):
    """Errors of N built robots at one pose, in n visits under each of A approaches.

    Attributes:
        approaches: The approaches, 1, -1 or 0 for each joint in chain order.
        errors: ``[d; δ]`` of the tip, base axes, m and rad, ``(A, n, 6, N)``.
        shifts: Error of the target point's position, base axes, m, ``(A, n, 3, N)``.
    """

    approaches: tuple[Approach, ...]
    errors: Array
    shifts: Array

    @cached_property
    @returns_read_only
    def barycentres(self) -> Array:
        """Mean position error of each robot's visits under each approach, m, ``(A, 3, N)``."""
        return self.shifts.mean(axis=1)

    @property
    def variation(self) -> Array:
        """Largest distance between the barycentres of two approaches, m, ``(N,)``: vAP of ISO 9283."""
        apart = self.barycentres[:, None] - self.barycentres[None]
        return np.sqrt((apart**2).sum(axis=2)).max(axis=(0, 1))

    @property
    def unidirectional(self) -> Array:
        """Position repeatability of each robot under each approach, m, ``(A, N)``: RP of ISO 9283, l̄ + 3 S_l."""
        return np.array([_repeatability(visits) for visits in self.shifts])

    @property
    def bidirectional(self) -> Array:
        """Position repeatability of each robot over all visits together, m, ``(N,)``."""
        return _repeatability(self.shifts.reshape(-1, 3, self.shifts.shape[-1]))


def sample_approaches(
    error_model: ErrorModel,
    /,
    pose: ArrayLike | Mapping[str, float] | str | None = None,
    *,
    approaches: Sequence[object],
    robots: int = 2000,
    cycles: int = 30,
    seed: int = 0,
    model: Literal["exact", "linear"] = "exact",
    target: ArrayLike = (0.0, 0.0, 0.0),
    number: int = 0,
    first: int = 0,
) -> ApproachErrors:
    """Return the errors of the same built robots at one pose, visited several times under each of several approaches.

    A robot's draws of unit and pose scope are the same in all visits; those of visit scope are made at every visit.

    Args:
        error_model: Chain, draws and sources.
        pose: The pose: joint values in chain order, by joint name, or the name of a pose; by default the model's first.
        approaches: Two or more approaches, each as in :class:`precision_pin.ApproachedPose`. ISO 9283 takes three.
        robots, cycles: Number of built robots, and of visits under each approach, two or more.
        seed: 64-bit seed.
        model: ``"exact"`` evaluates the displaced chain, ``"linear"`` superposes first-order errors.
        target: The measured point in the axes of the tip, m, or text such as ``"0 0 100 mm"``.
        number: Number of the pose, from 0, for draws of pose and visit scope.
        first: Number of the first robot.

    Raises:
        InputError: Fewer than two approaches, wrong directions, a wrong pose or number, or too many visits.
        UnknownNameError: No such pose or joint.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> gears = [pp.sources.Backlash(joint="joint1", backlash=1e-3, band=5.0)]
        >>> arm = pp.ErrorModel(model.chain, pp.Space(), gears)
        >>> visits = pp.sample_approaches(arm, [0, 0, 0, 0], approaches=["joint1 +", "joint1 -"], robots=10, cycles=2)
        >>> print((1e3 * visits.variation[0]).round(2))
        3.75
    """
    check_instance("the error model", error_model, ErrorModel, "as ErrorModel.load returns it")
    sampler.stage_of(model)
    directions = check_items("the approaches", approaches, object)
    if len(directions) < 2:
        raise InputError(f"{len(directions)} approaches; to compare them, give two or more")
    check_whole("the number of robots", robots, 1, BLOCK * 2**20)
    check_whole("the number of cycles", cycles, 2, MOST_VISITS // len(directions))
    check_whole("the number of the pose", number, 0, MOST_POSES - 1)
    check_whole("first, the number of a robot,", first, 0, 2**63)
    check_seed(seed)
    point = check_quantities("the target", target, LENGTH, (3,), "three finite numbers, in m or with a unit")
    check_memory(
        2 * 72.0 * len(directions) * cycles * robots, f"keeping {cycles} visits of {robots:,} robots", "ask for fewer"
    )
    poses = [error_model.at(pose, approach=approach) for approach in directions]
    errors = np.empty((len(directions), cycles, 6, robots))
    for rank, layout in enumerate(map(sampler.to_arrays, poses)):
        for cycle in range(cycles):
            # visits of different approaches are different occasions
            visit = rank * cycles + cycle
            errors[rank, cycle] = sampler.errors(layout, model, int(seed), first, robots, pose=number, visit=visit)
    lever = poses[0].posture.pose[:3, :3] @ point
    rotations = se3.exp_rotation(np.moveaxis(errors[:, :, 3:], 2, 0).reshape(3, -1))
    offsets = np.einsum("ijn,j->in", rotations, lever) - lever[:, None]
    shifts = errors[:, :, :3] + np.moveaxis(offsets.reshape(3, len(directions), cycles, robots), 0, 2)
    return ApproachErrors(tuple(at.posture.approach for at in poses), errors, shifts)


def _repeatability(visits: Array) -> Array:
    """Return l̄ + 3 S_l of positions ``(n, 3, N)``: l the distances from their mean, n - 1 in S_l."""
    distances = np.sqrt(((visits - visits.mean(axis=0)) ** 2).sum(axis=1))
    return distances.mean(axis=0) + 3 * distances.std(axis=0, ddof=1)
