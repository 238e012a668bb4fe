"""Measured covariance, by hand and against the displaced URDF."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Scope
from support.checks.common import Q7, evaluated, one_link, same
from support.plain_robot import PlainRobot, chain_of, inserted, pose_error, random_arm

STD = (1e-4, 2e-4, 3e-4, 1e-3, 2e-3, 3e-3)
CORRELATION = np.eye(6)
CORRELATION[1, 5] = CORRELATION[5, 1] = 0.5
CORRELATION[0, 2] = CORRELATION[2, 0] = -0.25


def rows(matrix) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, row)) for row in matrix)


def check_covariance(module: ModuleType) -> None:
    # at the hinge with the tip 1 m along x: y of the tip is y + 1 m · rz, z of the tip z - 1 m · ry
    by_std = module.Covariance(joint="hinge", std=STD, correlation=rows(CORRELATION))
    (draw,) = by_std.draws("covariance[hinge]")
    assert draw.name == "covariance[hinge].error"
    assert draw.scope is Scope.UNIT
    same(draw.law.covariance[1, 5], 0.5 * 2e-4 * 3e-3, 1e-18)
    same(np.sqrt(np.diag(draw.law.covariance)), STD, 1e-15)
    for source in (by_std, module.Covariance(joint="hinge", matrix=rows(CORRELATION * np.outer(STD, STD)))):
        at, _ = evaluated(one_link(), [0.0], [source])
        covariance = at.covariance
        same(covariance[0, 0], 1e-8, 1e-18)
        same(covariance[1, 1], 4e-8 + 2 * 0.5 * 2e-4 * 3e-3 + 9e-6, 1e-17)
        same(covariance[2, 2], 9e-8 + 4e-6, 1e-17)
        same(covariance[0, 2], -0.25 * 1e-4 * 3e-4, 1e-18)
        same(covariance[1, 5], 0.5 * 2e-4 * 3e-3 + 9e-6, 1e-17)
        same(covariance[3:, 3:], np.diag([1e-6, 4e-6, 9e-6]), 1e-17)
    # every place, any size
    text = random_arm(12, prismatic=(4,))
    reading = PlainRobot.parse(text)
    chain = chain_of(text, tip="tool")
    q7 = dict(zip(chain.joint_names, Q7, strict=True))
    nominal = reading.poses(q7)["tool"]
    six = np.array([0.03, -0.05, 0.02, 0.3, -0.4, 0.25])
    for where, place in (
        ({"joint": "joint4"}, ("joint", "joint4")),
        ({"link": "half2"}, ("joint", "joint3")),
        ({"frame": "half2"}, ("link", "half2")),
        ({"frame": "tool"}, ("link", "tool")),
    ):
        source = module.Covariance(**where, std=STD, mean=tuple(map(float, six)))
        at, _ = evaluated(chain, q7, [source])
        moved = reading.poses(q7, displaced={place: inserted(six)})["tool"]
        same(at.space.mean, six, 1e-15)
        same(at.exact(six[:, None])[:, 0], pose_error(moved, nominal), 1e-13)
