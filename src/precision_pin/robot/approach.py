"""The direction of approach of a pose: the way each joint moved last, before it came to rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arguments import shown
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, UnknownNameError

Approach = tuple[int, ...]
"""1, -1 or 0 for each joint in chain order: up, down, or unknown; empty without an approach."""

PREVIOUS: Final = "previous"
"""Approach from the previous pose in a list."""

_SIGNS: Final[Mapping[object, int]] = {"+": 1, "-": -1, "0": 0, "+1": 1, "1": 1, "-1": -1, 1: 1, -1: -1, 0: 0}
_NAMES: Final = {1: "+", -1: "-", 0: "0"}
_STILL: Final = 1e-12
"""Largest change of a joint value (rad, m) between two poses that counts as none."""


@final
@dataclass(frozen=True, eq=False)
class ApproachedPose:
    """A pose with the direction in which each joint moved last, for every analysis that takes a pose.

    Attributes:
        pose: The pose: a name, joint values in chain order or by name, or ``None`` for the model's first.
        approach: ``"+"``, ``"-"`` or ``"0"`` (unknown, the default; 1, -1 and 0 mean the same) by joint; or for every
            joint in chain order; or as text, ``"joint1 +, joint2 -"``. In a list of poses also ``"previous"``: from the
            pose before, or for a joint that did not move from there, from the last pose from which it did.
    """

    pose: Any
    approach: Any

    @property
    def is_from_previous(self) -> bool:
        """Whether the approach is from the previous pose in a list."""
        return isinstance(self.approach, str) and self.approach == PREVIOUS


def read_approach(joints: Sequence[str], approach: object) -> Approach:
    """Return the approach of one pose, given as for :class:`ApproachedPose`, for joint names in chain order."""
    if isinstance(approach, str):
        approach = _by_joint(approach)
    if isinstance(approach, Mapping):
        for name in approach:
            if name not in joints:
                raise UnknownNameError("joint on the chain", str(name), joints)
        return tuple(_sign(name, approach.get(name, 0)) for name in joints)
    if not isinstance(approach, Sequence | np.ndarray):
        raise InputError(f"an approach is + or - by joint, such as 'joint1 +, joint2 -', got {shown(approach)}")
    if len(approach) not in (0, len(joints)):
        given = f"{len(approach)} directions of approach for {len(joints)} joints"
        raise InputError(f"{given}; expected {', '.join(joints)}")
    return tuple(map(_sign, joints, approach)) if len(approach) else ()


def read_approaches(poses: object, q: Array, approach: Callable[[Any], Approach]) -> NDArray[np.int8] | None:
    """Return the approach of each of P poses, ``(n, P)``; ``None`` if none has one.

    ``approach`` returns that of a named or approached pose; an :class:`ApproachedPose` of many poses holds for each.
    """
    whole = isinstance(poses, ApproachedPose)
    listed = poses if isinstance(poses, list | tuple) else [poses]
    found = np.zeros(q.shape, dtype=np.int8)
    along: NDArray[np.int8] | None = None
    for k, one in enumerate(listed):
        columns = slice(None) if whole else slice(k, k + 1)
        if isinstance(one, ApproachedPose) and one.is_from_previous:
            along = approaches_along(q) if along is None else along
            found[:, columns] = along[:, columns]
        elif isinstance(one, str | ApproachedPose) and (own := approach(one)):
            found[:, columns] = np.array(own, dtype=np.int8)[:, None]
    return found if found.any() else None


def approaches_along(q: Array) -> NDArray[np.int8]:
    """Return the approach ``(n, P)`` of P poses passed in order: each joint's last motion, 0 before its first."""
    steps = np.diff(q, axis=1, prepend=q[:, :1])
    moved = np.abs(steps) > _STILL
    last = np.maximum.accumulate(np.where(moved, np.arange(q.shape[1]), 0), axis=1)
    # column 0 never moves, so poses before a joint's first motion read it
    return np.sign(np.where(moved, steps, 0.0))[np.arange(len(q))[:, None], last].astype(np.int8)


def approach_entry(written: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return the key ``approach`` of a pose in JSON, or an empty dictionary."""
    return {"approach": dict(written)} if written else {}


def written_approach(joints: Sequence[str], approach: Approach) -> dict[str, str]:
    """Return ``+`` or ``-`` by joint name, where known."""
    return {name: _NAMES[sign] for name, sign in zip(joints, approach, strict=True) if sign} if approach else {}


def _by_joint(text: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for entry in text.split(","):
        name, _, sign = entry.strip().rpartition(" ")
        if not name:
            write = "write a joint and + or -, such as 'joint1 +, joint2 -'"
            raise InputError(f"{entry.strip()!r} is no approach; {write}")
        name = name.strip()
        if name in found:
            raise InputError(f"the approach of the joint {name!r} is given twice")
        found[name] = sign
    return found


def _sign(joint: str, value: object) -> int:
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, bool) or not isinstance(value, str | int | float) or value not in _SIGNS:
        raise InputError(f"the approach of {joint} must be +, - or 0, got {shown(value)}")
    return _SIGNS[value]
