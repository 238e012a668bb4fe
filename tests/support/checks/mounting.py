"""Mounting, against the displaced URDF."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Uniform
from support.checks.common import NAMES, SIX, evaluated, one_link, same, slanted_arm
from support.plain_robot import inserted, pose_error


def check_mounting(module: ModuleType) -> None:
    # hinge at 90°, tool 1 m along base y: a base turned by rz = 1 mrad moves it by -1 mm in x
    at, _ = evaluated(one_link(), [np.pi / 2], [module.Mounting(at="base", y=2e-3, rz=1e-3)])
    same(at.linear(np.zeros((0, 1)))[:, 0], [-1e-3, 2e-3, 0, 0, 0, 1e-3], 1e-17)
    # a tool of 1 m tilted on its flange: 1 mrad about y drops it by 1 mm; at the tip it only tilts
    at, _ = evaluated(one_link(), [0.0], [module.Mounting(at="tool", flange="arm", ry=1e-3)])
    same(at.linear(np.zeros((0, 1)))[:, 0], [0, 0, -1e-3, 0, 1e-3, 0], 1e-17)
    at, _ = evaluated(one_link(), [0.0], [module.Mounting(at="tool", ry=1e-3)])
    same(at.linear(np.zeros((0, 1)))[:, 0], [0, 0, 0, 0, 1e-3, 0], 1e-17)
    # any arm, large errors
    arm = slanted_arm(12, prismatic=(4,))
    exact, start = inserted(SIX), arm.tool
    for settings, expected in (
        ({"at": "base"}, pose_error(exact @ start, start)),
        ({"at": "tool"}, pose_error(start @ exact, start)),
        ({"at": "tool", "flange": "tool"}, pose_error(start @ exact, start)),
        ({"at": "tool", "flange": "link7"}, arm.moved("link", "link7", SIX)),
    ):
        source = module.Mounting(**settings, **dict(zip(NAMES, SIX, strict=True)))
        at, _ = evaluated(arm.chain, arm.q, [source])
        same(at.exact(np.zeros((0, 1)))[:, 0], expected, 1e-13)
        laws = [Draw(name, Uniform(0.0, mean=value)) for name, value in zip(NAMES, SIX, strict=True)]
        source = module.Mounting(**settings, **dict(zip(NAMES, NAMES, strict=True)))
        at, _ = evaluated(arm.chain, arm.q, [source], {}, laws)
        same(at.exact(np.array(SIX)[:, None])[:, 0], expected, 1e-13)
    # before everything else: whatever the arm itself does is moved with it
    bent = module.Mounting(at="tool", flange="link7", x=0.01, ry=0.2)
    based = module.Mounting(at="base", **dict(zip(NAMES, SIX, strict=True)))
    at, _ = evaluated(arm.chain, arm.q, [bent, based])
    tool = arm.reading.poses(arm.q, displaced={("link", "link7"): inserted([0.01, 0, 0, 0, 0.2, 0])})["tool"]
    same(at.exact(np.zeros((0, 1)))[:, 0], pose_error(exact @ tool, start), 1e-13)
