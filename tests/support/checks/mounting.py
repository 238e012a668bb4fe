"""Mounting, against the displaced URDF."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Uniform
from support.checks.common import Q7, evaluated, one_link, same
from support.plain_robot import PlainRobot, chain_of, inserted, pose_error, random_arm

NAMES = ("x", "y", "z", "rx", "ry", "rz")


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
    text = random_arm(12, prismatic=(4,))
    reading = PlainRobot.parse(text)
    chain = chain_of(text, tip="tool")
    q7 = dict(zip(chain.joint_names, Q7, strict=True))
    nominal = reading.poses(q7)["tool"]
    six = np.array([0.03, -0.05, 0.02, 0.3, -0.4, 0.25])
    for settings, moved in (
        ({"at": "base"}, inserted(six) @ nominal),
        ({"at": "tool"}, nominal @ inserted(six)),
        ({"at": "tool", "flange": "tool"}, nominal @ inserted(six)),
        (
            {"at": "tool", "flange": "link7"},
            reading.poses(q7, displaced={("link", "link7"): inserted(six)})["tool"],
        ),
    ):
        source = module.Mounting(**settings, **dict(zip(NAMES, map(float, six), strict=True)))
        at, _ = evaluated(chain, q7, [source])
        same(at.exact(np.zeros((0, 1)))[:, 0], pose_error(moved, nominal), 1e-13)
        laws = [Draw(name, Uniform(0.0, mean=value)) for name, value in zip(NAMES, six, strict=True)]
        source = module.Mounting(**settings, **dict(zip(NAMES, NAMES, strict=True)))
        at, _ = evaluated(chain, q7, [source], {}, laws)
        same(at.exact(six[:, None])[:, 0], pose_error(moved, nominal), 1e-13)
    # before everything else: whatever the arm itself does is moved with it
    arm = module.Mounting(at="tool", flange="link7", x=0.01, ry=0.2)
    at, _ = evaluated(chain, q7, [arm, module.Mounting(at="base", **dict(zip(NAMES, map(float, six), strict=True)))])
    bent = reading.poses(q7, displaced={("link", "link7"): inserted([0.01, 0, 0, 0, 0.2, 0])})["tool"]
    same(at.exact(np.zeros((0, 1)))[:, 0], pose_error(inserted(six) @ bent, nominal), 1e-13)
