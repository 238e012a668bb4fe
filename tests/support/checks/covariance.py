"""Measured covariance, by hand and against the displaced URDF."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Scope
from support.checks.common import PLACES, SIX, evaluated, one_link, same, slanted_arm

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
    arm = slanted_arm(12, prismatic=(4,))
    for where, kind, place in PLACES:
        at, _ = evaluated(arm.chain, arm.q, [module.Covariance(**where, std=STD, mean=SIX)])
        same(at.space.mean, SIX, 1e-15)
        same(at.exact(np.array(SIX)[:, None])[:, 0], arm.moved(kind, place, SIX), 1e-13)
