"""Arms of sliding joints, whose error is known exactly."""

from __future__ import annotations

import numpy as np

from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources.joint_offset import JointOffset
from support.plain_robot import chain_of, joint, link, robot


def slides(axes, offsets, space: Space | None = None) -> ErrorModel:
    """Return an arm of sliding joints: its error is the sum of its joints' errors along their axes, exactly."""
    names = ["base", *(f"link{k}" for k in range(1, len(axes))), "tool"]
    parts = [link(name) for name in names]
    for k, axis in enumerate(axes):
        parts.append(joint(f"joint{k + 1}", "prismatic", names[k], names[k + 1], axis=axis))
    chain = chain_of(robot(*parts), tip="tool")
    sources = [JointOffset(joint=f"joint{k + 1}", offset=offset) for k, offset in enumerate(offsets)]
    return ErrorModel(chain, space or Space(), sources, {"rest": np.zeros(len(axes))})
