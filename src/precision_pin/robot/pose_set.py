"""Poses that are analysed together: a list, the nodes of a grid, or the points of a path."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base.arguments import check_number
from precision_pin.base.arrays import Array, field_names, fix_fields
from precision_pin.base.errors import InputError
from precision_pin.render.tables import pose_labels
from precision_pin.robot.chain import Chain
from precision_pin.robot.configurations import approach_entry, written_approach
from precision_pin.robot.joint_columns import Column

PoseStatus = Literal["reached", "unreachable", "limit", "singular", "collision", "kept out"]
"""Reached; no joint values; a joint outside its limits; near a singularity; the arm hits itself, or is kept out.

``kept out``: it is inside the sheet's ``keep_out`` or the plate of its base.
"""

SINGULAR_BELOW: Final = 0.01
"""Smallest singular value of the scaled Jacobian below which an arm is near a singularity."""
OBSTRUCTED: Final[tuple[PoseStatus, ...]] = ("collision", "kept out")
"""Statuses of poses at which the arm hits something."""
NO_BRANCH: Final = -1
"""Branch of a pose given by joint values."""
_AT_ONCE: Final = 4096
"""Poses whose statuses are computed together."""


@dataclass(frozen=True, eq=False)
class PoseSet:
    """P poses in order.

    Attributes:
        q: Joint values in chain order, rad and m, ``(n, P)``; NaN if unknown.
        names: A name or an empty text for each pose.
        branch: Number of the inverse kinematics solution, ``(P,)``; -1 where joint values were given.
        position: Tip in the base, or if unknown its wanted position, m, ``(3, P)``.
        times: Time of each point of a path, s, ``(P,)``; ``None`` without times.
        node: Rank of the place or wanted pose of each pose, ``(P,)``: poses of one node are its branches and wrist
            angles. ``None`` if each pose is its own.
        approaches: Direction in which each joint moved last, 1, -1 or 0, ``(n, P)``; see
            :mod:`precision_pin.robot.configurations`. ``None`` if no pose has one.
        columns: Columns of the file of a trajectory.
        left_out: For a random design, the number of dropped draws at which the arm hits something, by status.

    Raises:
        InputError: The fields have different numbers of poses, or there are none.
    """

    q: Array
    names: tuple[str, ...]
    status: tuple[PoseStatus, ...]
    branch: NDArray[np.int64]
    position: Array
    times: Array | None = None
    node: NDArray[np.int64] | None = None
    approaches: NDArray[np.int8] | None = None
    columns: tuple[Column, ...] = ()
    left_out: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        arrays = (self.q, self.branch, self.position, self.times, self.node, self.approaches)
        counts = {len(self.names), len(self.status), *(array.shape[-1] for array in arrays if array is not None)}
        if len(counts) > 1:
            count_text = ", ".join(map(str, sorted(counts)))
            raise InputError(f"the fields of a pose set have {count_text} poses, expected one number")
        if counts == {0}:
            raise InputError("no poses; give at least one")
        fix_fields(self)

    @classmethod
    def at(
        cls,
        chain: Chain,
        q: Array,
        names: tuple[str, ...] | None = None,
        times: Array | None = None,
        step: Callable[[int], object] = lambda _: None,
    ) -> PoseSet:
        """Return the poses of joint values ``(n, P)``, as from :meth:`Chain.configurations.many`, with their statuses.

        ``step`` is called with the number of poses done since the last call.
        """
        is_outside_limits = np.asarray(chain.configurations.outside(q).any(axis=0))
        position, singular = np.empty((3, q.shape[1])), np.empty(q.shape[1], dtype=np.bool_)
        for first in range(0, q.shape[1], _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            chunk = np.ascontiguousarray(q[:, part])
            position[:, part] = chain.at_columns(chunk).pose[:3, 3]
            singular[part] = smallest_singular_values(chain, chunk) < SINGULAR_BELOW
            step(chunk.shape[1])
        status: list[PoseStatus] = [
            "limit" if is_outside else "singular" if is_singular else "reached"
            for is_outside, is_singular in zip(is_outside_limits.tolist(), singular.tolist(), strict=True)
        ]
        return cls(
            q=q,
            names=("",) * q.shape[1] if names is None else names,
            status=tuple(status),
            branch=np.full(q.shape[1], NO_BRANCH, dtype=np.int64),
            position=position,
            times=times,
        )

    def __len__(self) -> int:
        return len(self.names)

    def entries(self, joints: Sequence[str]) -> list[dict[str, Any]]:
        """Return each pose as in the JSON of results: name, joint values, approach and time as far as known."""
        approaches = np.zeros(self.q.shape, dtype=np.int8) if self.approaches is None else self.approaches
        return [
            {
                "name": name,
                "q": dict(zip(joints, self.q[:, pose].tolist(), strict=True)),
                **approach_entry(written_approach(joints, tuple(approaches[:, pose].tolist()))),
                **({} if self.times is None else {"time": float(self.times[pose])}),
            }
            for pose, name in enumerate(self.names)
        ]

    @property
    def unreached(self) -> str:
        """Number, statuses and first name of the poses without joint values; empty without any."""
        if self.known.all():
            return ""
        others = self.of(~self.known)
        first = f"{'first ' * (len(others) > 1)}{others.names[0]!r}"
        return f"{len(others):,} of {len(self):,} poses are left out: {others.counts} ({first})"

    @property
    def counts(self) -> str:
        """Number of poses of each status, as text."""
        return ", ".join(f"{count:,} {status}" for status, count in Counter(self.status).items())

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask ``(P,)`` of the poses with known joint values."""
        return np.asarray(np.isfinite(self.q[0]))

    @classmethod
    def joined(cls, sets: Sequence[PoseSet]) -> PoseSet:
        """Return the poses of several sets in order, without times, nodes and approaches."""
        return cls(
            q=np.concatenate([poses.q for poses in sets], axis=1),
            names=tuple(name for poses in sets for name in poses.names),
            status=tuple(status for poses in sets for status in poses.status),
            branch=np.concatenate([poses.branch for poses in sets]),
            position=np.concatenate([poses.position for poses in sets], axis=1),
        )

    @property
    def labels(self) -> list[str]:
        """A unique label for each pose: its name, or ``pose 1``, ``pose 2``, …."""
        return list(self._labels)

    @cached_property
    def _labels(self) -> tuple[str, ...]:
        return tuple(pose_labels(self.names))

    def unobstructed(self, chain: Chain) -> PoseSet:
        """Return the poses with joint values at which the arm hits something removed, and the status to match."""
        ranks = np.flatnonzero(self.known)
        if chain.collision_check is None or not ranks.size:
            return self
        kinds = chain.collision_check.judge(np.ascontiguousarray(self.q[:, ranks]))
        hit: dict[int, PoseStatus] = {int(pose): kind for pose, kind in zip(ranks, kinds, strict=True) if kind}
        if not hit:
            return self
        q, branch = self.q.copy(), self.branch.copy()
        q[:, list(hit)], branch[list(hit)] = np.nan, NO_BRANCH
        return replace(self, q=q, branch=branch, status=tuple(hit.get(k, old) for k, old in enumerate(self.status)))

    @property
    def obstructed(self) -> dict[str, int]:
        """Number of poses, dropped ones included, without joint values because the arm hits something, by status."""
        counts = {kind: self.status.count(kind) + self.left_out.get(kind, 0) for kind in OBSTRUCTED}
        return {kind: count for kind, count in counts.items() if count}

    def of(self, mask: NDArray[np.bool_]) -> PoseSet:
        """Return the poses that a mask ``(P,)`` selects, in order."""
        return self.take(np.flatnonzero(mask))

    def best_and_worst(self, values: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the positions ``(N,)`` of the poses with the smallest and the largest value of each node, in order.

        They are its best and worst branch and angle about the tool axis. NaN is ignored; -1 for a node without a value.

        Args:
            values: A value for each pose, such as a spread or a quantile, ``(P,)``.
        """
        array = np.asarray(values, dtype=np.float64)
        if array.shape != (len(self),):
            raise InputError(f"values of shape {array.shape} for {len(self)} poses, expected ({len(self)},)")
        nodes = np.arange(len(self)) if self.node is None else self.node
        results = []
        for filler, choose in ((np.inf, np.minimum), (-np.inf, np.maximum)):
            filled = np.where(np.isnan(array), filler, array)
            extremes = np.full(int(nodes.max()) + 1, filler)
            choose.at(extremes, nodes, filled)
            is_extreme = (filled == extremes[nodes]) & ~np.isnan(array)
            positions = np.full(len(extremes), -1, dtype=np.intp)
            # the first of equal ones
            last_first = np.flatnonzero(is_extreme)[::-1]
            positions[nodes[last_first]] = last_first
            results.append(positions)
        return results[0], results[1]

    def with_singular_below(self, chain: Chain, value: float) -> PoseSet:
        """Return the poses with another threshold, not negative, below which one within the limits is singular."""
        limit = check_number("the smallest singular value", value, "zero or more and finite", lambda x: x >= 0)
        is_singular = np.zeros(len(self), dtype=bool)
        is_singular[self.known] = smallest_singular_values(chain, self.q[:, self.known]) < limit
        status: list[PoseStatus] = [
            label if label not in ("reached", "singular") else "singular" if is_near else "reached"
            for label, is_near in zip(self.status, is_singular.tolist(), strict=True)
        ]
        return replace(self, status=tuple(status))

    def take(self, chosen: NDArray[np.intp]) -> PoseSet:
        """Return the poses at some positions, in that order."""
        field_values = {name: getattr(self, name) for name in field_names(PoseSet)}
        selection: dict[str, Any] = {
            name: value[..., chosen] for name, value in field_values.items() if isinstance(value, np.ndarray)
        }
        selection |= {name: tuple(field_values[name][k] for k in chosen) for name in ("names", "status")}
        return replace(self, **selection)


def chain_length(chain: Chain) -> float:
    """Return the sum of the distances between a chain's joints and its tip, m; 1 m if all are zero."""
    return float(np.linalg.norm(chain.placements[1:, :3, 3], axis=1).sum()) or 1.0


def smallest_singular_values(chain: Chain, q: Array) -> Array:
    """Return the smallest singular value of the scaled Jacobian at configurations ``(n, P)``, ``(P,)``.

    Lengths count in chain lengths, the sum of the distances between joints, so that the value has no unit and does not
    depend on the robot's size: position rows are divided by it, and a prismatic joint moves in units of it. A chain of
    fewer than six joints has as many values as joints.
    """
    length = chain_length(chain)
    scaled = np.moveaxis(chain.at_columns(q).joint_jacobian, -1, 0).copy()
    scaled[:, :3] /= length
    scaled[:, :, chain.prismatic] *= length
    return np.array(np.linalg.svd(scaled, compute_uv=False)[:, -1])
