"""Inverse kinematics: all joint values found that bring the tip of a chain to wanted poses, for any serial chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, final, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_choice, check_instance, check_numbers
from precision_pin.base.array_checks import fix_fields
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError
from precision_pin.base.progress import steps_to
from precision_pin.robot.chain import Chain
from precision_pin.robot.pose_set import SINGULAR_BELOW, PoseSet, PoseStatus, smallest_singular_values
from precision_pin.robot.solution_search import CONSTRAINTS, SolutionSearch, Task

Branches = Literal["nearest", "best", "all"]
"""Which of several solutions."""


@final
@dataclass(frozen=True, eq=False)
class Solutions:
    """Joint values that lead to N wanted poses.

    Attributes
    ----------
    wanted
        The wanted poses, ``(4, 4, N)``.
    q
        Joint values of all M solutions within the joint limits, wanted pose by wanted pose, rad and m, ``(n, M)``.
    node
        Rank of the wanted pose to which each leads, ``(M,)``.
    branch
        Number of the solution among those of its wanted pose from 0, the nearest to the reference posture first, ``(M,)``.
    singular_values
        Smallest singular value of the scaled Jacobian at each, ``(M,)``; see
        :func:`precision_pin.robot.pose_set.smallest_singular_values`.
    is_outside
        True for each wanted pose that has solutions outside the joint limits only, ``(N,)``.
    """

    wanted: Array
    q: Array
    node: NDArray[np.int64]
    branch: NDArray[np.int64]
    singular_values: Array
    is_outside: NDArray[np.bool_]

    def __post_init__(self) -> None:
        fix_fields(self)

    def __len__(self) -> int:
        return int(self.wanted.shape[2])

    def poses(self, names: tuple[str, ...] | None = None, branches: Branches = "nearest") -> PoseSet:
        """Return the wanted poses with one solution each, or with all of them.

        A wanted pose without a solution within the joint limits is one pose of the set, without joint values.

        Parameters
        ----------
        names
            A name for each wanted pose; with all solutions the number of the solution is added.
        branches
            Which solutions: ``nearest`` to the reference posture; ``best``, farthest from a singularity, with the largest
            smallest singular value; ``all``.

        Raises
        ------
        InputError
            Another word for the solutions, or another number of names.
        """
        check_choice("branches", branches, get_args(Branches))
        given = ("",) * len(self) if names is None else names
        if len(given) != len(self):
            raise InputError(f"{len(given)} names for {len(self)} wanted poses")
        bounds = np.searchsorted(self.node, np.arange(len(self) + 1))
        nodes: list[int] = []
        columns: list[int] = []
        for node, (begin, end) in enumerate(pairwise(bounds)):
            own = self._choose(begin, end, branches) or [-1]
            nodes += [node] * len(own)
            columns += own
        # the last column stands for no solution
        values = np.column_stack([self.q, np.full(len(self.q), np.nan)])
        numbers = np.append(self.branch, -1)[columns]
        several = branches == "all"
        return PoseSet(
            q=values[:, columns],
            names=tuple(
                f"{given[node]} branch {number}".strip() if several and number >= 0 else given[node]
                for node, number in zip(nodes, numbers, strict=True)
            ),
            status=tuple(self._status(node, column) for node, column in zip(nodes, columns, strict=True)),
            branch=numbers,
            position=self.wanted[:3, 3, nodes],
            node=np.array(nodes, dtype=np.int64),
        )

    def _choose(self, begin: int, end: int, branches: Branches) -> list[int]:
        if branches == "best" and end > begin:
            return [begin + int(np.argmax(self.singular_values[begin:end]))]
        return list(range(begin, end if branches == "all" else min(end, begin + 1)))

    def _status(self, node: int, column: int) -> PoseStatus:
        if column < 0:
            return "limit" if self.is_outside[node] else "unreachable"
        return "singular" if self.singular_values[column] < SINGULAR_BELOW else "reached"


def inverse_kinematics(
    chain: Chain,
    wanted: ArrayLike,
    *,
    task: Task = "pose",
    tool_axis: ArrayLike = (0.0, 0.0, 1.0),
    reference: ArrayLike | None = None,
    progress: Callable[[int], None] | bool | None = None,
) -> Solutions:
    """Return the joint values found within the joint limits that bring the tip to wanted poses.

    Where the task has as many constraints as there are joints, these are all solutions, at most 16 of a pose; a solution to
    which few starts lead can be missed. Where there are more joints, infinitely many lead there: then they are what the
    search finds from fixed starts. Angles that differ by whole turns are one solution, given by the turn within the limits
    that is nearest to the reference posture. Each solution is checked: its tip is within 1e-10 m and 1e-10 rad.

    Parameters
    ----------
    chain
        The arm.
    wanted
        Tip in the base, ``(4, 4)`` or ``(4, 4, N)``.
    task
        What must agree: ``pose``; ``axis``, position and direction of the tool axis; ``position``.
    tool_axis
        The tool axis in the tip's frame, for ``axis``.
    reference
        Joint values, rad and m, ``(n,)``; zero, or the limit nearest to it, if left out.
    progress
        Function called with the number of poses solved since its last call; ``True`` shows a bar.

    Raises
    ------
    InputError
        A wrong shape, a number that is not finite, a rotation that is none, an axis of length zero.
    """
    check_instance("chain", chain, Chain, "as Chain.from_urdf returns it")
    check_choice("task", task, tuple(CONSTRAINTS))
    poses = _check_poses(wanted)
    axis = check_numbers("the tool axis", tool_axis, (3,), "three finite numbers")
    size = float(np.sqrt((axis * axis).sum()))
    if not size > 0:
        raise InputError("the tool axis has length zero; give a direction in the tip's frame, such as (0, 0, 1)")
    middle = np.clip(0.0, *chain.configurations.limits) if reference is None else chain.configuration(reference)
    search = SolutionSearch.of(chain, task, axis / size, middle)
    with steps_to(progress, poses.shape[2], "poses") as step:
        found = search.solve(poses, step)
    q = np.concatenate([own for own, _ in found], axis=1)
    counts = [own.shape[1] for own, _ in found]
    return Solutions(
        wanted=poses,
        q=q,
        node=np.repeat(np.arange(len(found)), counts),
        branch=np.concatenate([np.arange(count) for count in counts]),
        singular_values=smallest_singular_values(chain, q) if q.size else np.zeros(0),
        is_outside=np.array([is_outside for _, is_outside in found]),
    )


def _check_poses(wanted: ArrayLike) -> Array:
    poses = check_numbers("the wanted poses", wanted, needs="finite numbers, (4, 4) or (4, 4, N)")
    if poses.shape[:2] != (4, 4) or poses.ndim > 3 or not poses.size:
        raise InputError(f"the wanted poses have the shape {poses.shape}, expected (4, 4) or (4, 4, N)")
    if poses.ndim == 2:
        poses = poses[:, :, None]
    turn = poses[:3, :3]
    squares = np.einsum("ijn,kjn->ikn", turn, turn) - np.eye(3)[:, :, None]
    mirrored = np.linalg.det(np.moveaxis(turn, -1, 0)) < 0
    wrong = (np.abs(squares).max(axis=(0, 1)) > 1e-9) | mirrored | (poses[3].T != (0, 0, 0, 1)).any(axis=1)
    if wrong.any():
        raise InputError(
            f"the wanted pose {int(np.argmax(wrong))} is no rigid motion: its rotation must be orthogonal to 1e-9, without "
            "mirroring, its last row 0 0 0 1"
        )
    return poses
