"""Errors of any frame, against the displaced URDF."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Uniform
from support.checks.common import Q7, evaluated, same
from support.plain_robot import (
    PlainRobot,
    chain_of,
    inserted,
    pose_error,
    random_arm,
)


def check_frame(module: ModuleType) -> None:
    text = random_arm(12, prismatic=(4,))
    reading = PlainRobot.parse(text)
    chain = chain_of(text, tip="tool")
    q7 = dict(zip(chain.joint_names, Q7, strict=True))
    nominal = reading.poses(q7)["tool"]
    six = np.array([0.03, -0.05, 0.02, 0.3, -0.4, 0.25])
    for where, place in (
        ({"joint": "joint1"}, ("joint", "joint1")),
        ({"joint": "joint4"}, ("joint", "joint4")),
        ({"link": "link2"}, ("joint", "joint3")),
        ({"link": "half2"}, ("joint", "joint3")),
        ({"link": "base"}, ("joint", "joint1")),
        ({"link": "link7"}, ("link", "tool")),
        ({"frame": "half2"}, ("link", "half2")),
        ({"frame": "link5"}, ("link", "link5")),
        ({"frame": "tool"}, ("link", "tool")),
    ):
        names = ("x", "y", "z", "rx", "ry", "rz")
        source = module.Frame(**where, **dict(zip(names, map(float, six), strict=True)))
        at, _ = evaluated(chain, q7, [source])
        moved = reading.poses(q7, displaced={place: inserted(six)})["tool"]
        same(at.exact(np.zeros((0, 1)))[:, 0], pose_error(moved, nominal), 1e-13)
        (subject,) = where.values()
        laws = [Draw(name, Uniform(0.0, mean=value)) for name, value in zip(names, six, strict=True)]
        at, _ = evaluated(chain, q7, [module.Frame(**where, **dict(zip(names, names, strict=True)))], {}, laws)
        same(at.exact(six[:, None])[:, 0], pose_error(moved, nominal), 1e-13)
        assert source.subject == subject
