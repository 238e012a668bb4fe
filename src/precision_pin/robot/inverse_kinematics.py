"""Inverse kinematics: the joint values found that bring the tip of a serial chain to wanted poses.

Every wanted pose (node) is solved on its own by damped least squares (Levenberg-Marquardt), all nodes and starts
together. A node starts from those of a fixed list of postures whose tips are nearest to it, so its solutions do not
depend on the other nodes or their order, and nothing is random.

Residuals are in chain lengths and radians; prismatic joints move in chain lengths. The normal equations are solved by
loops over their entries, on arrays over nodes and starts, without BLAS, whose rounding depends on the machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import se3
from precision_pin.base.arguments import check_choice, check_numbers
from precision_pin.base.arrays import Array, Fixed
from precision_pin.base.errors import InputError
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.base.progress import steps_to
from precision_pin.robot.chain import Chain, HasChain, chain_of
from precision_pin.robot.pose_set import SINGULAR_BELOW, PoseSet, PoseStatus, chain_length, smallest_singular_values

if TYPE_CHECKING:
    from precision_pin.robot.collision import Obstruction

Task = Literal["pose", "axis", "position"]
"""Matched quantities: position and attitude; position and direction of the tool axis; position only."""

CONSTRAINTS: Final[dict[Task, int]] = {"pose": 6, "axis": 5, "position": 3}

TOLERANCE: Final = 1e-10
"""Largest distance (m) and angle (rad) between tip and wanted pose, and largest violation of joint limits."""
MOST_SOLUTIONS: Final = 16
"""Most solutions of a node; a chain of six revolute joints has no more, unless infinitely many."""
SAME: Final = 1e-4
"""Largest difference of any joint, rad or chain lengths, within one solution; at a singularity two meet."""

_LISTED: Final = 4096
"""Postures from which the starts are chosen."""
_STARTS: Final = 24
_ROUNDS: Final = 14
"""Starts of a node in a round, and most rounds."""
_FRUITLESS: Final = 6
"""Rounds without a new solution after which a node is done."""
_CHUNK: Final = 4096
"""Starts solved together: their matrices fit into the cache."""
_STEPS: Final = 80  # most damped steps of a start
_FIRST_DAMPING: Final = 1e-2  # of a start; it falls fivefold with a better step, else it rises fourfold
_LONGEST_STEP: Final = 1.0  # of a joint: rad, or lengths of the chain
_STALLED: Final = 1e-3
_STALLS: Final = 5
"""A start is abandoned after this many steps in a row that lower the squared residual by less than this fraction."""

Branches = Literal["nearest", "best", "all"]
"""Choice among several solutions."""


class SolutionSearch:
    """A task of a chain, for a unit tool axis and a reference value for each joint, with postures to start from."""

    def __init__(self, chain: Chain, task: Task, axis: Array, reference: Array) -> None:
        self.chain, self.task, self.axis, self.reference = chain, task, axis, reference
        self.length = length = chain_length(chain)
        self.low, self.high = low, high = chain.configurations.limits
        self.is_redundant = len(chain.joints) > CONSTRAINTS[task]
        # a whole turn if limits are checked afterwards or allow it, else what they allow
        turns = ~chain.prismatic & ((not self.is_redundant) | ((high - low) >= 2 * np.pi))
        bottom = np.where(turns, -np.pi, np.where(np.isfinite(low), low, reference - length))
        top = np.where(turns, np.pi, np.where(np.isfinite(high), high, reference + length))
        spread = bottom[:, None] + (top - bottom)[:, None] * spread_points(len(chain.joints), _LISTED)
        self.listed = np.column_stack([reference, spread])
        self.listed_features = _features(chain.at_columns(self.listed).pose, task, axis, length)
        self.units = np.where(chain.prismatic, length, 1.0)

    def solve(self, wanted: Array, step: Callable[[int], None]) -> list[tuple[Array, bool]]:
        """Return the solutions of wanted poses ``(4, 4, N)`` within the limits, and whether there are only others.

        For each pose ``(n, S)``, nearest to the reference first. ``step`` takes the poses solved since its last call.
        """
        result = []
        nodes = _CHUNK // _STARTS
        for begin in range(0, wanted.shape[2], nodes):
            solutions = self._solve_chunk(np.ascontiguousarray(wanted[:, :, begin : begin + nodes]))
            usable = map(self._choose_turns, solutions)
            result += [(q, bool(every.shape[1]) and not q.shape[1]) for q, every in zip(usable, solutions, strict=True)]
            step(len(solutions))
        return result

    def _solve_chunk(self, wanted: Array) -> list[Array]:
        """Return the distinct solutions ``(n, S)`` of each wanted pose, also those outside the limits."""
        starts = self._rank_starts(wanted)
        count = wanted.shape[2]
        solutions = [np.zeros((len(self.units), 0)) for _ in range(count)]
        fruitless = np.zeros(count, dtype=int)
        active = np.arange(count)
        for number in range(_ROUNDS):
            round_ = starts[:, number * _STARTS : (number + 1) * _STARTS]
            final_q = self._descend_from(wanted, active, round_, self.is_redundant)
            for node, q in zip(active, final_q, strict=True):
                old_count = solutions[node].shape[1]
                solutions[node] = self._merge(np.column_stack([solutions[node], q]))
                fruitless[node] = 0 if solutions[node].shape[1] > old_count else fruitless[node] + 1
            is_done = fruitless >= _FRUITLESS
            if self.is_redundant:
                is_done |= [q.shape[1] > 0 for q in solutions]
            active = np.flatnonzero(~is_done)
            if not len(active):
                break
        if self.is_redundant:
            # without limits, to tell unreachable poses from those that the limits forbid
            unsolved = np.array([k for k, q in enumerate(solutions) if not q.shape[1]], dtype=np.intp)
            for node, q in zip(unsolved, self._descend_from(wanted, unsolved, starts[:, :_STARTS], False), strict=True):
                solutions[node] = q
        return solutions

    def _descend_from(
        self, wanted: Array, nodes: NDArray[np.intp], starts: NDArray[np.intp], within_limits: bool
    ) -> list[Array]:
        """Return the solutions ``(n, S)`` found from ``starts`` ``(N, S)`` in the list, for each of some nodes."""
        count = starts.shape[1]
        targets = np.repeat(wanted[:, :, nodes], count, axis=2)
        final_q, is_solution = self._descend(targets, self.listed[:, starts[nodes].ravel()], within_limits)
        slices = [slice(rank * count, (rank + 1) * count) for rank in range(len(nodes))]
        return [final_q[:, rows][:, is_solution[rows]] for rows in slices]

    def _rank_starts(self, wanted: Array) -> NDArray[np.intp]:
        """Return the list positions of each node's starts, the reference first, then the nearest, ``(N, S)``."""
        features = _features(wanted, self.task, self.axis, self.length)
        squares = np.zeros((wanted.shape[2], self.listed.shape[1]))
        for of_nodes, of_list in zip(features, self.listed_features, strict=True):
            squares += (of_nodes[:, None] - of_list) ** 2
        squares[:, 0] = -1.0
        return np.argsort(squares, axis=1, kind="stable")[:, : _ROUNDS * _STARTS]

    def _descend(self, wanted: Array, starts: Array, within_limits: bool) -> tuple[Array, NDArray[np.bool_]]:
        """Return where the search from each start ``(n, S)`` ends, and whether it solves its pose ``(4, 4, S)``."""
        final_q, is_solution = starts.copy(), np.zeros(starts.shape[1], dtype=bool)
        rows = np.arange(starts.shape[1])
        q, target = starts, wanted
        damping = np.full(len(rows), _FIRST_DAMPING)
        stalls = np.zeros(len(rows), dtype=int)
        square, matrix, gradient, is_there = self._linearise(q, target)
        for _ in range(_STEPS):
            raise_if_interrupted()
            is_done = is_there | (stalls > _STALLS)
            if is_done.any():
                final_q[:, rows[is_done]], is_solution[rows[is_done]] = q[:, is_done], is_there[is_done]
                state: tuple[Any, ...] = (rows, q, target, damping, stalls, square, matrix, gradient)
                rows, q, target, damping, stalls, square, matrix, gradient = (array[..., ~is_done] for array in state)
            if not len(rows):
                break
            step = _solve_damped(matrix, gradient, damping)
            largest = np.abs(step).max(axis=0)
            step *= np.minimum(1.0, _LONGEST_STEP / np.maximum(largest, 1e-300)) * self.units[:, None]
            trial = q + step
            if within_limits:
                trial = np.clip(trial, self.low[:, None], self.high[:, None])
            new_square, new_matrix, new_gradient, new_is_there = self._linearise(trial, target)
            is_better = new_square < square
            stalls = np.where(new_square < (1 - _STALLED) * square, 0, stalls + 1)
            damping = np.where(is_better, np.maximum(damping * 0.2, 1e-14), damping * 4.0)
            is_there = new_is_there & is_better
            q = np.where(is_better, trial, q)
            square = np.where(is_better, new_square, square)
            matrix, gradient = np.where(is_better, new_matrix, matrix), np.where(is_better, new_gradient, gradient)
        return final_q, is_solution

    def _linearise(self, q: Array, wanted: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Return squared residual, normal matrix, gradient, and whether the tip is there, at postures ``(n, S)``."""
        postures = self.chain.at_columns(q)
        pose, jacobian = postures.pose, postures.joint_jacobian * self.units[:, None]
        shift = wanted[:3, 3] - pose[:3, 3]
        rows, residual = jacobian[:3] / self.length, shift / self.length
        is_there = (shift * shift).sum(axis=0) <= TOLERANCE**2
        if self.task != "position":
            if self.task == "pose":
                rotation = se3.log_rotation(np.einsum("ijs,kjs->iks", wanted[:3, :3], pose[:3, :3]))
                rotations = jacobian[3:]
            else:
                rotation, along = _turn_between(se3.turn(pose[:3, :3], self.axis), se3.turn(wanted[:3, :3], self.axis))
                # turning about the tool axis changes nothing
                rotations = jacobian[3:] - along[:, None] * (along[:, None] * jacobian[3:]).sum(axis=0)
            is_there &= (rotation * rotation).sum(axis=0) <= TOLERANCE**2
            rows, residual = np.concatenate([rows, rotations]), np.concatenate([residual, rotation])
        joints = len(q)
        matrix = np.empty((joints, joints, q.shape[1]))
        for i in range(joints):
            for k in range(i + 1):
                matrix[i, k] = matrix[k, i] = (rows[:, i] * rows[:, k]).sum(axis=0)
        gradient = (rows * residual[:, None]).sum(axis=0)
        return (residual * residual).sum(axis=0), matrix, gradient, is_there

    def _merge(self, columns: Array) -> Array:
        """Return the distinct columns of solutions ``(n, S)``, in order, at most :data:`MOST_SOLUTIONS`."""
        gaps = columns[:, :, None] - columns[:, None, :]
        turning = ~self.chain.prismatic
        gaps[turning] -= 2 * np.pi * np.rint(gaps[turning] / (2 * np.pi))
        alike = (np.abs(gaps) / self.units[:, None, None]).max(axis=0, initial=0.0) <= SAME
        indices: list[int] = []
        for column in range(columns.shape[1]):
            if not alike[column, indices].any():
                indices.append(column)
        return columns[:, indices[:MOST_SOLUTIONS]]

    def _choose_turns(self, columns: Array) -> Array:
        """Return the solutions within the limits, each by its turns nearest to the reference, the nearest first."""
        turning = ~self.chain.prismatic[:, None]
        low, high, middle = self.low[:, None], self.high[:, None], self.reference[:, None]
        q = columns - 2 * np.pi * np.rint((columns - middle) / (2 * np.pi)) * turning
        # the least number of turns up to the lower limit, or down to the upper one
        up = np.ceil(np.maximum(low - TOLERANCE - q, 0.0) / (2 * np.pi))
        down = np.ceil(np.maximum(q - high - TOLERANCE, 0.0) / (2 * np.pi))
        q = q + 2 * np.pi * (up - down) * turning
        is_inside = ((q >= low - TOLERANCE) & (q <= high + TOLERANCE)).all(axis=0)
        q = np.clip(q[:, is_inside], low, high)
        distances = (((q - middle) / self.units[:, None]) ** 2).sum(axis=0)
        return q[:, np.argsort(distances, kind="stable")]


def spread_points(dimensions: int, count: int) -> Array:
    """Return points ``(dimensions, count)`` that fill the unit cube evenly (Roberts 2018, R-sequence)."""
    ratio = 2.0
    for _ in range(64):
        ratio = float((1.0 + ratio) ** (1.0 / (dimensions + 1)))
    powers = ratio ** -np.arange(1.0, dimensions + 1)
    return np.mod(0.5 + powers[:, None] * np.arange(1.0, count + 1), 1.0)


def _features(poses: Array, task: Task, axis: Array, length: float) -> Array:
    """Return numbers ``(F, N)`` of poses ``(4, 4, N)`` that differ as the poses do: position, tool axis or all axes."""
    position, rotation = poses[:3, 3] / length, poses[:3, :3]
    if task == "position":
        return position
    return np.concatenate([position, se3.turn(rotation, axis) if task == "axis" else rotation.reshape(9, -1)])


def _turn_between(along: Array, wanted: Array) -> tuple[Array, Array]:
    """Return the smallest rotation vectors ``(3, S)`` that bring directions to wanted ones, and the directions."""
    across = np.cross(along, wanted, axis=0)
    sine = np.sqrt((across * across).sum(axis=0))
    cosine = (along * wanted).sum(axis=0)
    # opposite directions have no unique smallest rotation: any perpendicular axis will do
    opposite = (sine < 1e-12) & (cosine < 0)
    least = np.eye(3)[np.argmin(np.abs(along), axis=0)].T
    across = np.where(opposite, np.cross(along, least, axis=0), across)
    size = np.sqrt((across * across).sum(axis=0))
    return across * (np.arctan2(sine, cosine) / np.where(size > 0, size, 1.0)), along


def _solve_damped(matrix: Array, gradient: Array, damping: Array) -> Array:
    """Return the solutions ``(n, S)`` of (M + damping) x = gradient for symmetric M ``(n, n, S)``, by Cholesky."""
    factor, step = np.zeros_like(matrix), gradient.copy()
    for i in range(len(gradient)):
        for k in range(i):
            factor[i, k] = (matrix[i, k] - (factor[i, :k] * factor[k, :k]).sum(axis=0)) / factor[k, k]
        # rounding can make the pivot smaller than the damping
        square = matrix[i, i] + damping - (factor[i, :i] * factor[i, :i]).sum(axis=0)
        factor[i, i] = np.sqrt(np.maximum(square, damping))
        step[i] = (step[i] - (factor[i, :i] * step[:i]).sum(axis=0)) / factor[i, i]
    for i in reversed(range(len(gradient))):
        step[i] = (step[i] - (factor[i + 1 :, i] * step[i + 1 :]).sum(axis=0)) / factor[i, i]
    return step


@dataclass(frozen=True, eq=False)
class Solutions(Fixed):
    """Joint values that lead to N wanted poses ``(4, 4, N)``, M solutions within the joint limits in all.

    ``q`` ``(n, M)`` is in the order of the wanted poses, rad and m; ``node`` ``(M,)`` is the rank of the pose of each,
    ``branch`` ``(M,)`` its number among that pose's solutions, the nearest to the reference posture 0.
    ``singular_values`` ``(M,)`` are the smallest of the scaled Jacobian, see
    :func:`precision_pin.robot.pose_set.smallest_singular_values`. ``is_outside`` ``(N,)``: all solutions are outside
    the limits. ``hit``: whether the arm hits itself or is kept out at each solution, empty text if not; empty if not
    checked.
    """

    wanted: Array
    q: Array
    node: NDArray[np.int64]
    branch: NDArray[np.int64]
    singular_values: Array
    is_outside: NDArray[np.bool_]
    hit: tuple[Obstruction, ...] = ()

    def __len__(self) -> int:
        return int(self.wanted.shape[2])

    def poses(self, names: tuple[str, ...] | None = None, branches: Branches = "nearest") -> PoseSet:
        """Return the wanted poses with one solution each, or with all of them.

        A wanted pose without a solution within the joint limits is one pose of the set, without joint values.

        Args:
            names: A name for each wanted pose; with all solutions the number of the solution is added.
            branches: Which solutions: ``nearest`` to the reference posture; ``best``, farthest from a singularity, with
                the largest smallest singular value; ``all``. One at which the arm hits something is chosen only if
                there is no other, and left without joint values.

        Raises:
            InputError: Another word for the solutions, or another number of names.
        """
        check_choice("branches", branches, get_args(Branches))
        node_names = ("",) * len(self) if names is None else names
        if len(node_names) != len(self):
            raise InputError(f"{len(node_names)} names for {len(self)} wanted poses")
        bounds = np.searchsorted(self.node, np.arange(len(self) + 1))
        # -1, the last column, means no solution
        choices = [self._choose(begin, end, branches) or [-1] for begin, end in pairwise(bounds)]
        nodes = [node for node, choice in enumerate(choices) for _ in choice]
        columns = [column for choice in choices for column in choice]
        values = np.column_stack([self.q, np.full(len(self.q), np.nan)])
        values[:, [column for column, obstruction in enumerate(self.hit) if obstruction]] = np.nan
        numbers = np.append(self.branch, -1)[columns]
        return PoseSet(
            q=values[:, columns],
            names=tuple(
                f"{node_names[node]} branch {number}".strip() if branches == "all" and number >= 0 else node_names[node]
                for node, number in zip(nodes, numbers, strict=True)
            ),
            status=tuple(self._status(node, column) for node, column in zip(nodes, columns, strict=True)),
            branch=numbers,
            position=self.wanted[:3, 3, nodes],
            node=np.array(nodes, dtype=np.int64),
        )

    def _choose(self, begin: int, end: int, branches: Branches) -> list[int]:
        columns = list(range(begin, end))
        if branches == "all" or not columns:
            return columns
        columns = [column for column in columns if not (self.hit and self.hit[column])] or columns
        return [max(columns, key=self.singular_values.__getitem__) if branches == "best" else columns[0]]

    def _status(self, node: int, column: int) -> PoseStatus:
        if column < 0:
            return "limit" if self.is_outside[node] else "unreachable"
        if self.hit and (hit := self.hit[column]):
            return hit
        return "singular" if self.singular_values[column] < SINGULAR_BELOW else "reached"


def inverse_kinematics(
    chain: Chain | HasChain,
    wanted: ArrayLike,
    *,
    task: Task = "pose",
    tool_axis: ArrayLike = (0.0, 0.0, 1.0),
    reference: ArrayLike | None = None,
    progress: Callable[[int], None] | bool | None = None,
) -> Solutions:
    """Return the joint values found within the joint limits that bring the tip to wanted poses.

    If the task has as many constraints as there are joints, these are all solutions, at most 16 of a pose; a solution
    to which few starts lead can be missed. With more joints there are infinitely many, and the search returns those
    found from fixed starts. Angles that differ by whole turns are one solution, given by the turn within the limits
    that is nearest to the reference posture. Each solution is checked: its tip is within 1e-10 m and 1e-10 rad.

    Args:
        chain: The arm.
        wanted: Tip in the base, ``(4, 4)`` or ``(4, 4, N)``.
        task: What must match: ``pose``; ``axis``, position and direction of the tool axis; ``position``.
        tool_axis: The tool axis in the tip's frame, for ``axis``.
        reference: Joint values, rad and m, ``(n,)``; by default zero, or the limit nearest to it.
        progress: Function called with the number of poses solved since its last call; ``True`` shows a bar.

    Raises:
        InputError: A wrong shape, a number that is not finite, an invalid rotation, an axis of length zero.

    Examples:
        >>> chain = pp.Chain.from_urdf("4dof.urdf", tip="tool")
        >>> solutions = pp.inverse_kinematics(chain, chain.at(np.radians([10, 20, 30, 40])).pose)
        >>> print(np.degrees(solutions.q[2]).round(6))
        [ 30. -30.]
    """
    chain = chain_of(chain)
    check_choice("task", task, tuple(CONSTRAINTS))
    poses = _check_poses(wanted)
    axis = check_numbers("the tool axis", tool_axis, (3,), "three finite numbers")
    size = float(np.sqrt((axis * axis).sum()))
    if not size > 0:
        raise InputError("the tool axis has length zero; give a direction in the tip's frame, such as (0, 0, 1)")
    middle = np.clip(0.0, *chain.configurations.limits) if reference is None else chain.configuration(reference)
    search = SolutionSearch(chain, task, axis / size, middle)
    with steps_to(progress, poses.shape[2], "poses") as step:
        solutions = search.solve(poses, step)
    q = np.concatenate([values for values, _ in solutions], axis=1)
    counts = [values.shape[1] for values, _ in solutions]
    return Solutions(
        wanted=poses,
        q=q,
        node=np.repeat(np.arange(len(solutions)), counts),
        branch=np.concatenate([np.arange(count) for count in counts]),
        singular_values=smallest_singular_values(chain, q) if q.size else np.zeros(0),
        is_outside=np.array([is_outside for _, is_outside in solutions]),
        hit=() if chain.collision_check is None else tuple(chain.collision_check.judge(q)),
    )


def _check_poses(wanted: ArrayLike) -> Array:
    poses = check_numbers("the wanted poses", wanted, needs="finite numbers, (4, 4) or (4, 4, N)")
    if poses.shape[:2] != (4, 4) or poses.ndim > 3 or not poses.size:
        raise InputError(f"the wanted poses have the shape {poses.shape}, expected (4, 4) or (4, 4, N)")
    if poses.ndim == 2:
        poses = poses[:, :, None]
    rotation = poses[:3, :3]
    squares = np.einsum("ijn,kjn->ikn", rotation, rotation) - np.eye(3)[:, :, None]
    mirrored = np.linalg.det(np.moveaxis(rotation, -1, 0)) < 0
    is_wrong = (np.abs(squares).max(axis=(0, 1)) > 1e-9) | mirrored | (poses[3].T != (0, 0, 0, 1)).any(axis=1)
    if is_wrong.any():
        raise InputError(
            f"the wanted pose {int(np.argmax(is_wrong))} is no rigid motion: its rotation must be orthogonal to 1e-9, without "
            "mirroring, its last row 0 0 0 1"
        )
    return poses
