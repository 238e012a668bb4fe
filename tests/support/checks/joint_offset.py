"""Joint offsets, against the arm at other joint values."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.laws import Normal
from precision_pin.terms.term import JointValue
from support.checks.common import Q7, evaluated, one_link, same, slanted_arm
from support.plain_robot import pose_error


def check_joint_offset(module: ModuleType) -> None:
    # R5: 1R, L = 1 m along x, θ = 0, Δθ = 1 mrad; the tip runs on a circle
    chain = one_link()
    at, _ = evaluated(chain, [0.0], [module.JointOffset(joint="hinge", offset=1e-3)])
    same(at.exact(np.zeros((0, 1)))[:3, 0], [np.cos(1e-3) - 1, np.sin(1e-3), 0], 1e-15)
    arm = slanted_arm(13, prismatic=(3, 6))
    offsets = np.array([0.1, -0.2, 0.03, 0.15, -0.1, -0.04, 0.2])
    sources = [module.JointOffset(joint=name, offset=Normal(0.1)) for name in arm.chain.joint_names]
    values = {f"joint_offset[{name}].offset": value for name, value in zip(arm.q, offsets, strict=True)}
    at, totals = evaluated(arm.chain, Q7, sources, values)
    assert set(totals) == {JointValue(k) for k in range(7)}
    assert at.space.components == tuple(values)
    moved = arm.reading.poses(dict(zip(arm.q, np.add(Q7, offsets), strict=True)))["tool"]
    same(at.exact(offsets[:, None])[:, 0], pose_error(moved, arm.tool), 1e-13)
