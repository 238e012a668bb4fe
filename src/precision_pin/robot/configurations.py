"""Joint values of a chain, one configuration or many, and the way that each joint moved last, before it came to rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from precision_pin.base import arguments
from precision_pin.base.arrays import Array, fix_copy, returns_read_only
from precision_pin.base.errors import Finding, InputError, UnknownNameError
from precision_pin.base.units import ANGLE, LENGTH, Quantity
from precision_pin.robot.urdf import Joint

LONGEST: Final = 1e6
"""Largest value (m) of a prismatic joint; larger ones leave too few digits for errors of nanometres."""
SLACK: Final = 1e-5
"""Tolerance (rad, m) of a limit: files round limits, as 180° to 3.14159."""
_LARGEST_TURN: Final = 4 * np.pi
"""Distance, rad, of an angle from the middle of narrower limits above which its unit counts as wrong."""
_FAR: Final = 10.0
"""Ratio of joint values to their limits, in units of the range, above which their unit counts as wrong."""


@dataclass(frozen=True)
class Configurations:
    """Reader of joint values, for joints in a fixed order; if it ``wraps``, as of :meth:`wrapped`."""

    joints: tuple[Joint, ...]
    wraps: bool = False

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    def one(self, q: ArrayLike | Mapping[str, float]) -> Array:
        """Return joint values ``(n,)``; see :meth:`precision_pin.robot.chain.Chain.configuration`."""
        if isinstance(q, Mapping):
            self._check_names(q)
            q = [
                arguments.check_quantity(f"the joint value of {joint.name}", q[joint.name], joint_quantity(joint))
                for joint in self.joints
            ]
        values = arguments.check_numbers(
            "joint values", q, needs="a number for each joint, rad or m, in chain order or by name"
        )
        if values.shape != (len(self.names),):
            raise InputError(
                f"{values.size} joint values for {len(self.names)} joints; expected {', '.join(self.names)}"
            )
        self._check_travel(values[:, None])
        return self.taken(values[:, None])[:, 0]

    def many(self, q: ArrayLike | Mapping[str, ArrayLike] | Sequence[object]) -> Array:
        """Return the values of P poses, ``(n, P)``; see :meth:`precision_pin.robot.chain.Chain.at_many`."""
        if isinstance(q, list | tuple):
            return self.taken(self._read_list(q))
        if isinstance(q, Mapping):
            self._check_names(q)
            rows = [
                np.atleast_1d(
                    arguments.check_quantities(f"joint values of {joint.name}", q[joint.name], joint_quantity(joint))
                )
                for joint in self.joints
            ]
            if len({row.shape for row in rows if row.size != 1}) > 1 or any(row.ndim != 1 for row in rows):
                raise InputError("the joints have different numbers of values; each needs one, or one for each pose")
            q = np.array(np.broadcast_arrays(*rows))
        values = arguments.check_numbers("joint values", q, needs="a row for each joint, or poses in a list")
        if values.ndim != 2 or len(values) != len(self.names):
            hint = "; poses are columns, so transpose it" if values.shape[1:] == (len(self.names),) else ""
            raise InputError(
                f"joint values of shape {values.shape} for many poses, expected ({len(self.names)}, P): "
                f"a row for each of {', '.join(self.names)}{hint}"
            )
        self._check_travel(values)
        return self.taken(values)

    def taken(self, values: Array) -> Array:
        """Return joint values ``(n, P)``, wrapped if this reader wraps."""
        return self.wrapped(values) if self.wraps else values

    def wrapped(self, values: Array) -> Array:
        """Return joint values ``(n, P)`` where angles outside limits are inside, if whole turns bring them there."""
        low, high = (ends[:, None] for ends in self.limits)
        # an infinite limit is never passed
        excess, deficit = np.maximum(values - high - SLACK, 0), np.maximum(low - SLACK - values, 0)
        wrapped = values + 2 * np.pi * (np.ceil(deficit / (2 * np.pi)) - np.ceil(excess / (2 * np.pi)))
        is_better = self.turning[:, None] & self.outside(values) & ~self.outside(wrapped)
        return fix_copy(np.where(is_better, wrapped, values))

    def wrap_hint(self, joint: int, values: Array) -> str:
        """Return the end of a message if whole turns bring a joint's value of one pose ``(n, 1)`` inside, else nothing."""
        value, wrapped = float(values[joint, 0]), float(self.wrapped(values)[joint, 0])
        turns = round(abs(value - wrapped) / (2 * np.pi))
        hint = f"{turns if turns > 1 else 'a'} whole turn{'s' * (turns > 1)} {'less' if wrapped < value else 'more'}"
        return f"; {hint}, {np.degrees(wrapped):.7g} deg, is inside: --wrap takes poses so" if turns else ""

    def far(self, values: Array) -> NDArray[np.bool_]:
        """Return a mask ``(n, P)`` of joint values so far outside that their unit is doubtful."""
        low, high = np.where(np.isinf(self.limits), [[-np.pi], [np.pi]], self.limits)
        span, maximum = high - low, (0.5 + _FAR) * (high - low)
        maximum = np.where(self.turning, np.minimum(maximum, np.maximum(span, _LARGEST_TURN)), maximum)
        return np.asarray(np.abs(values - (high + low)[:, None] / 2) > maximum[:, None])

    @cached_property
    @returns_read_only
    def turning(self) -> NDArray[np.bool_]:
        """Mask ``(n,)`` of the joints that turn."""
        return np.array([joint.kind != "prismatic" for joint in self.joints])

    def doubts(self, q: object) -> tuple[Finding, ...]:
        """Return a warning if the poses of a square array, read by columns, may be its rows."""
        count = len(self.names)
        if not isinstance(q, np.ndarray) or q.shape != (count, count) or count == 1:
            return ()
        columns, rows = (bool(self.outside(values).any()) for values in (q, q.T))
        if rows and not columns:
            return ()
        hint = "; as rows they would be within the joint limits, as columns they are not"
        message = (
            f"an array of {count} by {count} joint values is taken as {count} poses in columns"
            f"{hint if columns and not rows else ''}; transpose it if they are rows, or give a list of poses"
        )
        return (Finding("warning", "W_SQUARE_POSES", message),)

    def outside(self, values: Array) -> NDArray[np.bool_]:
        """Return a mask ``(n, P)`` of the joint values outside their limits by more than `SLACK`."""
        low, high = self.limits
        return (values < low[:, None] - SLACK) | (values > high[:, None] + SLACK)

    @cached_property
    @returns_read_only
    def limits(self) -> tuple[Array, Array]:
        """Lowest and highest value of each joint, infinite without limits."""
        limits = [None if joint.kind == "continuous" else joint.limit for joint in self.joints]
        low, high = np.array([(limit.lower, limit.upper) if limit else (-np.inf, np.inf) for limit in limits]).T
        return low, high

    @staticmethod
    def count(q: object) -> int:
        """Return the number of poses given for :meth:`many`, without checking their values."""
        if isinstance(q, list | tuple):
            return len(q)
        if isinstance(q, Mapping):
            return max((Configurations.count(row) for row in q.values()), default=0)
        return q.shape[-1] if isinstance(q, np.ndarray) and q.ndim else 1

    def _read_list(self, poses: Sequence[object]) -> Array:
        if poses and all(map(_is_row, poses)):
            # all at once; the loop below finds a wrong one
            with suppress(InputError):
                return fix_copy(arguments.check_numbers("joint values", poses, (None, len(self.names))).T)
        columns = []
        for number, pose in enumerate(poses):
            try:
                columns.append(self.one(pose))  # type: ignore[arg-type]
            except InputError as error:
                hint = "; in an array, not a list, joints are rows" if len(poses) == len(self.names) else ""
                raise InputError(f"pose {number} of the list: {error.findings[0].message}{hint}") from None
        if not columns:
            raise InputError("no poses to sample or place; give at least one")
        return fix_copy(np.column_stack(columns))

    def _check_travel(self, values: Array) -> None:
        """Raise if values ``(n, P)`` of prismatic joints exceed `LONGEST`."""
        for name, joint, row in zip(self.names, self.joints, values, strict=True):
            if joint.kind == "prismatic" and (excess := row[np.abs(row) > LONGEST]).size:
                raise InputError(f"joint value {excess[0]:g} m of {name}; it slides {LONGEST:,.0f} m at most")

    def _check_names(self, q: Mapping[str, object]) -> None:
        for name in arguments.check_mapping("joint values", q):
            arguments.check_name("joint on the chain", name, self.names)
        missing = [name for name in self.names if name not in q]
        if missing:
            raise InputError(f"no value for the joints {', '.join(missing)}")


def joint_quantity(joint: Joint) -> Quantity:
    """Return length for a joint that slides, else angle."""
    return LENGTH if joint.kind == "prismatic" else ANGLE


def _is_row(pose: object) -> bool:
    """Return whether a pose is a list or an array without booleans."""
    if isinstance(pose, np.ndarray):
        return bool(pose.dtype.kind != "b")
    return isinstance(pose, list | tuple) and not any(isinstance(value, bool | np.bool_) for value in pose)


Approach = tuple[int, ...]
"""1, -1 or 0 for each joint in chain order: up, down, or unknown; empty without an approach."""

PREVIOUS: Final = "previous"
"""Approach from the previous pose in a list."""

_SIGNS: Final[Mapping[object, int]] = {"+": 1, "-": -1, "0": 0, "+1": 1, "1": 1, "-1": -1, 1: 1, -1: -1, 0: 0}
_STILL: Final = 1e-12
"""Largest change of a joint value (rad, m) between two poses that counts as none."""


@dataclass(frozen=True, eq=False)
class ApproachedPose:
    """A pose with the direction in which each joint moved last, for every analysis that takes a pose.

    Attributes:
        pose: The pose: a name, joint values in chain order or by name, or ``None`` for the model's first.
        approach: ``"+"``, ``"-"`` or ``"0"`` (unknown, the default; 1, -1 and 0 mean the same) by joint; or for every
            joint in chain order; or as text, ``"joint1 +, joint2 -"``. In a list of poses also ``"previous"``: from the
            pose before, or for a joint that did not move from there, from the last pose from which it did.

    Examples:
        >>> model = pp.ErrorModel.load("4dof.errors.yaml")
        >>> print(model.approach(pp.ApproachedPose("paper", "joint2 +, joint3 -")))
        (0, 1, -1, 0)
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
        approach = _read_signs(approach)
    if isinstance(approach, Mapping):
        for name in approach:
            if name not in joints:
                raise UnknownNameError("joint on the chain", str(name), joints)
        return tuple(_sign(name, approach.get(name, 0)) for name in joints)
    if not isinstance(approach, Sequence | np.ndarray):
        raise InputError(
            f"an approach is + or - by joint, such as 'joint1 +, joint2 -', got {arguments.shown(approach)}"
        )
    if len(approach) not in (0, len(joints)):
        raise InputError(
            f"{len(approach)} directions of approach for {len(joints)} joints; expected {', '.join(joints)}"
        )
    return tuple(map(_sign, joints, approach)) if len(approach) else ()


def read_approaches(poses: object, q: Array, approach: Callable[[Any], Approach]) -> NDArray[np.int8] | None:
    """Return the approach of each of P poses, ``(n, P)``; ``None`` if none has one.

    ``approach`` reads a named or approached pose; an :class:`ApproachedPose` of many poses holds for each.
    """
    is_common = isinstance(poses, ApproachedPose)
    pose_list = poses if isinstance(poses, list | tuple) else [poses]
    signs = np.zeros(q.shape, dtype=np.int8)
    along = cache(lambda: approaches_along(q))
    for k, pose in enumerate(pose_list):
        columns = slice(None) if is_common else slice(k, k + 1)
        if isinstance(pose, ApproachedPose) and pose.is_from_previous:
            signs[:, columns] = along()[:, columns]
        elif isinstance(pose, str | ApproachedPose) and (joint_signs := approach(pose)):
            signs[:, columns] = np.array(joint_signs, dtype=np.int8)[:, None]
    return signs if signs.any() else None


def approaches_along(q: Array) -> NDArray[np.int8]:
    """Return the approach ``(n, P)`` of P poses passed in order: each joint's last motion, 0 before its first."""
    steps = np.diff(q, axis=1, prepend=q[:, :1])
    is_moving = np.abs(steps) > _STILL
    last_columns = np.maximum.accumulate(np.where(is_moving, np.arange(q.shape[1]), 0), axis=1)
    # column 0 never moves, so poses before a joint's first motion read it
    return np.sign(np.where(is_moving, steps, 0.0))[np.arange(len(q))[:, None], last_columns].astype(np.int8)


def approach_entry(written: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return the key ``approach`` of a pose in JSON, or an empty dictionary."""
    return {"approach": dict(written)} if written else {}


def written_approach(joints: Sequence[str], approach: Approach) -> dict[str, str]:
    """Return ``+`` or ``-`` by joint name, where known."""
    return {
        name: "+" if sign > 0 else "-"
        for name, sign in zip(joints, approach or (0,) * len(joints), strict=True)
        if sign
    }


def _read_signs(text: str) -> dict[str, str]:
    signs: dict[str, str] = {}
    for entry in text.split(","):
        name, _, sign = entry.strip().rpartition(" ")
        if not name:
            raise InputError(
                f"{entry.strip()!r} is no approach; write a joint and + or -, such as 'joint1 +, joint2 -', or 'previous'"
            )
        name = name.strip()
        if name in signs:
            raise InputError(f"the approach of the joint {name!r} is given twice")
        signs[name] = sign
    return signs


def _sign(joint: str, value: object) -> int:
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, bool) or not isinstance(value, str | int | float) or value not in _SIGNS:
        raise InputError(f"the approach of {joint} must be +, - or 0, got {arguments.shown(value)}")
    return _SIGNS[value]
