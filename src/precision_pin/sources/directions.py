"""Directions as a sheet spells them."""

from __future__ import annotations

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.errors import InputError
from precision_pin.robot.chain import Posture

__all__ = ["direction_of"]

_DIRECTION: Final = re.compile(r"(-?)\s*(x|y|z|axis)\s+of\s+(.+)", re.DOTALL)
_AXES: Final = {"x": 0, "y": 1, "z": 2}


def direction_of(text: str, posture: Posture) -> NDArray[np.float64]:
    """Return the unit vector, base axes, of ``[-]x|y|z|axis of JOINT`` or ``[-]x|y|z of BASE``.

    ``x``, ``y``, ``z`` are the axes of the joint's URDF frame after it turned (those of its child link in the file), or
    of the chain's base link; ``axis`` is the joint's as the file writes it. All of them are the same directions in space
    wherever the base is.

    Raises
    ------
    InputError
        Spelled otherwise.
    UnknownNameError
        No such joint on the chain.
    """
    match = _DIRECTION.fullmatch(text.strip())
    if match is None:
        raise InputError(f"direction {text!r} is not understood; allowed: link, [-]x|y|z of JOINT, [-]axis of JOINT")
    name = match[3].strip()
    if name == posture.chain.base and name not in posture.chain.joint_names and match[2] != "axis":
        along = np.eye(3)[_AXES[match[2]]]
        return np.asarray(-along if match[1] else along, dtype=float)
    chain, joint = posture.chain, posture.chain.joint_index(name)
    is_reversed = bool(chain.reversed_joints[joint])
    if match[2] == "axis":
        direction = -posture.joint_axes[joint] if is_reversed else posture.joint_axes[joint]
    else:
        # what turns with the file's child is the link before a joint that the chain passes against the file
        turned = posture.link_poses[joint] @ chain.placements[joint] if is_reversed else posture.joint_poses[joint]
        direction = turned[:3, _AXES[match[2]]]
    return np.asarray(-direction if match[1] else direction, dtype=float)
