"""Directions written in a sheet."""

from __future__ import annotations

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base import se3
from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain, Posture

_DIRECTION: Final = re.compile(r"(-?)\s*(x|y|z|axis)\s+of\s+(.+)", re.DOTALL)
_AXES: Final = {"x": 0, "y": 1, "z": 2}
_PARALLEL: Final = 1e-9
"""Sine of the angle below which a direction counts as parallel to an axis."""


def direction_of(text: str, posture: Posture) -> NDArray[np.float64]:
    """Return the unit vector ``(3[, P])``, base axes, of ``[-]x|y|z|axis of JOINT`` or ``[-]x|y|z of BASE``.

    ``x``, ``y``, ``z`` are the axes of the joint's URDF frame after its motion (those of its child link in the file), or
    of the chain's base link; ``axis`` is the joint's axis as written in the file. The directions in space do not depend
    on the choice of the base.

    Raises
    ------
    InputError
        Written in another form.
    UnknownNameError
        No such joint on the chain.
    """
    sign, letter, joint = _parse(text, posture.chain)
    if joint is None:
        along = np.eye(3)[_AXES[letter]]
        return np.asarray(-along if sign < 0 else along, dtype=float)
    chain = posture.chain
    is_reversed = bool(chain.reversed_joints[joint])
    if letter == "axis":
        direction = -posture.joint_axes[joint] if is_reversed else posture.joint_axes[joint]
    else:
        # for a joint that the chain passes against the file, the file's child link is the one before the joint
        before = se3.compose(posture.link_poses[joint], chain.placements[joint])
        turned = before if is_reversed else posture.joint_poses[joint]
        direction = turned[:3, _AXES[letter]]
    return np.asarray(-direction if sign < 0 else direction, dtype=float)


def is_fixed(text: str, chain: Chain, link: int) -> bool:
    """Return whether a direction, written as for :func:`direction_of`, is fixed in a chain link at all joint values."""
    _, letter, joint = _parse(text, chain)
    if joint is None:
        carrier, direction = 0, np.eye(3)[_AXES[letter]]
    elif letter == "axis":
        carrier, direction = joint + 1, chain.axes[joint]
    elif chain.reversed_joints[joint]:
        carrier, direction = joint, chain.placements[joint][:3, _AXES[letter]]
    else:
        carrier, direction = joint + 1, np.eye(3)[_AXES[letter]]
    while carrier != link:
        # forward through the joint after the carrier, or back through the one before it
        forward = carrier < link
        passed = carrier if forward else carrier - 1
        turn = chain.placements[passed][:3, :3]
        direction = turn.T @ direction if forward else direction
        if not chain.prismatic[passed] and np.linalg.norm(np.cross(chain.axes[passed], direction)) > _PARALLEL:
            return False
        direction = direction if forward else turn @ direction
        carrier += 1 if forward else -1
    return True


def _parse(text: str, chain: Chain) -> tuple[float, str, int | None]:
    """Return a direction's sign, its letter or ``axis``, and the joint it belongs to, None for the base."""
    match = _DIRECTION.fullmatch(text.strip())
    if match is None:
        raise InputError(f"direction {text!r} is not understood; allowed: link, [-]x|y|z of JOINT, [-]axis of JOINT")
    name, sign = match[3].strip(), -1.0 if match[1] else 1.0
    if name == chain.base and name not in chain.joint_names and match[2] != "axis":
        return sign, match[2], None
    return sign, match[2], chain.joint_index(name)
