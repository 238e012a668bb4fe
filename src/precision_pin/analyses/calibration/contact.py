"""Poses in which the nominal arm touches what it is measured at, a plane or sockets, or is seen by the instrument."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.interrupts import raise_if_interrupted
from precision_pin.robot.chain import Chain
from precision_pin.robot.pose_set import PoseSet
from precision_pin.robot.random_poses import random_poses
from precision_pin.sheet.measurement import Measurement

_TOGETHER: Final = 64
_ROUNDS: Final = 40
_STEPS: Final = 60
_CLOSE: Final = 1e-12
"""Distance from contact, m, at which a pose touches."""
_LONGEST: Final = 0.5
"""Largest change of a joint value in a step."""
_DAMPING: Final = 1e-8
_FAR: Final = 0.05
"""Distance from contact, m, beyond which a warning says that a pose does not touch."""


def contact_poses(chain: Chain, measurement: Measurement, count: int, *, seed: int = 0) -> PoseSet:
    """Return random poses in which the target touches the plane, or is in one of the sockets.

    From random joint values within their limits the nearest contact is found by steps of least norm; those that end outside the
    limits, or where the arm hits something, are drawn again.

    Args:
        chain, measurement: The arm, and a measurement of kind ``"plane"`` or ``"socket"``.
        count, seed: Number of poses, and 64-bit seed.

    Raises:
        InputError: Another kind of measurement, or too few poses are found.
    """
    place = measurement.place
    if place is None or measurement.kind not in ("plane", "socket"):
        raise InputError(f"a {measurement.kind} is measured without contact")
    arm = chain.with_target(measurement.target)
    starts = random_poses(arm, _TOGETHER * _ROUNDS, seed=seed).q
    found: list[Array] = []
    for k in range(_ROUNDS):
        raise_if_interrupted()
        q = _touching(arm, measurement, starts[:, _TOGETHER * k : _TOGETHER * (k + 1)].copy(), k)
        found.extend(q.T)
        if len(found) >= count:
            break
    if len(found) < count:
        raise InputError(
            f"only {len(found):,} of {_TOGETHER * _ROUNDS:,} random poses end in contact within joint limits; move the "
            f"{measurement.kind} closer, or give the poses"
        )
    names = tuple(f"contact {number}" for number in range(1, count + 1))
    return PoseSet.at(chain, np.ascontiguousarray(np.array(found[:count]).T), names)


def _touching(chain: Chain, measurement: Measurement, q: Array, number: int) -> Array:
    """Return the columns of joint values ``(n, S)`` that reach contact within limits, after steps of least norm."""
    sockets = np.array(measurement.sockets)
    # a socket for each start, in turn, so that all are visited
    chosen = (np.arange(q.shape[1]) + number) % max(len(sockets), 1)
    for _ in range(_STEPS):
        at = chain.at_columns(q)
        point, slopes = at.pose[:3, 3], at.joint_jacobian[:3]
        if measurement.plane is not None:
            normal = np.array(measurement.plane[1])
            away = (normal @ (point - np.array(measurement.plane[0])[:, None]))[None]
            slopes = np.einsum("i,ijs->js", normal, slopes)[None]
        else:
            away = point - sockets[chosen].T
        if np.abs(away).max() < _CLOSE:
            break
        gram = np.einsum("ias,jas->sij", slopes, slopes) + _DAMPING * np.eye(len(away))
        pull = np.linalg.solve(gram, -away.T[:, :, None])[:, :, 0]
        step = np.einsum("ias,si->as", slopes, pull)
        q = q + step * np.minimum(1.0, _LONGEST / np.maximum(np.abs(step).max(axis=0), 1e-300))
    touches = (np.abs(away) < _CLOSE).all(axis=0) & ~chain.configurations.outside(q).any(axis=0)
    q = np.ascontiguousarray(q[:, touches])
    return q if chain.collision_check is None or not q.size else q[:, chain.collision_check.free(q)]


def seen_poses(chain: Chain, measurement: Measurement, poses: PoseSet) -> PoseSet | None:
    """Return the poses at which the instrument sees the target; ``None`` where it never does."""
    if measurement.visible_from is None:
        return poses
    nominal = np.moveaxis(chain.with_target((0.0, 0.0, 0.0)).at_columns(poses.q).pose, -1, 0)
    seen = np.array([measurement.sees(pose) for pose in nominal])
    return poses.of(seen) if seen.any() else None


def doubt_contact(measurement: Measurement, poses: Array) -> Iterator[Finding]:
    """Yield a warning where nominal poses ``(P, 4, 4)`` do not touch what they are measured at, or are not seen."""
    hidden = sum(not measurement.sees(pose) for pose in poses)
    if hidden:
        message = f"at {hidden} of {len(poses)} poses the target faces away from the instrument by more than the cone"
        yield Finding("warning", "W_HIDDEN", message)
    away = np.array([measurement.away(pose) for pose in poses])
    far = int((away > _FAR).sum())
    if far:
        where = "the plane" if measurement.kind == "plane" else "a socket"
        message = f"{far} of {len(away)} poses do not touch {where}, the farthest by {1e3 * away.max():.3g} mm"
        yield Finding("warning", "W_CONTACT", message)
