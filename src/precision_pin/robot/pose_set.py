"""Poses that are asked about together: a list, the nodes of a grid, or the points of a path."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.errors import InputError
from precision_pin.inputs.arrays import fix_fields
from precision_pin.robot.chain import Chain
from precision_pin.typing import Array

__all__ = ["NO_BRANCH", "SINGULAR_BELOW", "PoseSet", "PoseStatus", "smallest_singular_values"]

PoseStatus = Literal["reached", "unreachable", "limit", "singular"]
"""``reached``; ``unreachable``: no joint values lead there; ``limit``: a joint is outside its limits; ``singular``: joint values
are known, but the arm is near a singularity."""

SINGULAR_BELOW: Final = 0.01
"""Smallest singular value of the scaled Jacobian below which an arm is near a singularity."""
NO_BRANCH: Final = -1
"""Branch of a pose given by its joint values."""


@final
@dataclass(frozen=True, eq=False)
class PoseSet:
    """P poses in order.

    Attributes
    ----------
    q
        Joint values in chain order, rad and m, ``(n, P)``; a column of NaN where none are known.
    names
        A name for each pose, empty for a pose without one.
    status
        A status for each pose.
    branch
        Number of the solution of the inverse kinematics, ``(P,)``; -1 where joint values were given.
    position
        Tip in the base where it is known, else where it was wanted, m, ``(3, P)``.
    times
        Time of each point of a path, s, ``(P,)``; ``None`` where the poses are not passed in time.

    Raises
    ------
    InputError
        The fields have different numbers of poses, or there are none.
    """

    q: Array
    names: tuple[str, ...]
    status: tuple[PoseStatus, ...]
    branch: NDArray[np.int64]
    position: Array
    times: Array | None = None

    def __post_init__(self) -> None:
        counts = {self.q.shape[1], len(self.names), len(self.status), len(self.branch), self.position.shape[1]}
        counts |= set() if self.times is None else {len(self.times)}
        if len(counts) > 1:
            raise InputError(
                f"the fields of a pose set have {', '.join(map(str, sorted(counts)))} poses, expected one number"
            )
        if counts == {0}:
            raise InputError("no poses; give at least one")
        fix_fields(self)

    @classmethod
    def at(cls, chain: Chain, q: Array, names: tuple[str, ...] | None = None, times: Array | None = None) -> PoseSet:
        """Return the poses of joint values ``(n, P)``, as :meth:`Chain.configurations.many` reads them, with their statuses."""
        postures = chain.at_columns(q)
        outside = np.asarray(chain.configurations.outside(q).any(axis=0))
        singular = smallest_singular_values(chain, q) < SINGULAR_BELOW
        status = tuple(_status(bool(outside[k]), bool(singular[k])) for k in range(q.shape[1]))
        return cls(
            q=q,
            names=("",) * q.shape[1] if names is None else names,
            status=status,
            branch=np.full(q.shape[1], NO_BRANCH, dtype=np.int64),
            position=postures.pose[:3, 3].copy(),
            times=times,
        )

    def __len__(self) -> int:
        return len(self.names)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask ``(P,)`` of the poses whose joint values are known."""
        mask: NDArray[np.bool_] = np.isfinite(self.q[0])
        return mask

    def of(self, mask: NDArray[np.bool_]) -> PoseSet:
        """Return the poses that a mask ``(P,)`` selects, in order."""
        chosen = np.flatnonzero(mask)
        return replace(
            self,
            q=self.q[:, chosen],
            names=tuple(self.names[k] for k in chosen),
            status=tuple(self.status[k] for k in chosen),
            branch=self.branch[chosen],
            position=self.position[:, chosen],
            times=None if self.times is None else self.times[chosen],
        )


def smallest_singular_values(chain: Chain, q: Array) -> Array:
    """Return the smallest singular value of the scaled Jacobian at configurations ``(n, P)``, ``(P,)``.

    Lengths count in units of the chain's own, the sum of the distances between its joints, so that the value has no unit and
    does not change with the robot's size: rows of the position are divided by it, and a prismatic joint moves in units of it.
    Of a chain of fewer than six joints it is the smallest of as many values as it has joints.
    """
    length = float(np.linalg.norm(chain.placements[1:, :3, 3], axis=1).sum()) or 1.0
    scaled = np.moveaxis(chain.at_columns(q).joint_jacobian, -1, 0).copy()
    scaled[:, :3] /= length
    scaled[:, :, chain.prismatic] *= length
    singular_values: Array = np.asarray(np.linalg.svd(scaled, compute_uv=False), dtype=np.float64)
    return singular_values[:, -1].copy()


def _status(outside: bool, singular: bool) -> PoseStatus:
    return "limit" if outside else "singular" if singular else "reached"
