"""Errors of any frame, against the displaced URDF."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Uniform
from support.checks.common import NAMES, SIX, evaluated, same, slanted_arm


def check_frame(module: ModuleType) -> None:
    arm = slanted_arm(12, prismatic=(4,))
    for where, kind, place in (
        ({"joint": "joint1"}, "joint", "joint1"),
        ({"joint": "joint4"}, "joint", "joint4"),
        ({"link": "link2"}, "joint", "joint3"),
        ({"link": "half2"}, "joint", "joint3"),
        ({"link": "base"}, "joint", "joint1"),
        ({"link": "link7"}, "link", "tool"),
        ({"frame": "half2"}, "link", "half2"),
        ({"frame": "link5"}, "link", "link5"),
        ({"frame": "tool"}, "link", "tool"),
    ):
        source = module.Frame(**where, **dict(zip(NAMES, SIX, strict=True)))
        at, _ = evaluated(arm.chain, arm.q, [source])
        same(at.exact(np.zeros((0, 1)))[:, 0], arm.moved(kind, place, SIX), 1e-13)
        assert [source.subject] == list(where.values())
        laws = [Draw(name, Uniform(0.0, mean=value)) for name, value in zip(NAMES, SIX, strict=True)]
        at, _ = evaluated(arm.chain, arm.q, [module.Frame(**where, **dict(zip(NAMES, NAMES, strict=True)))], {}, laws)
        same(at.exact(np.array(SIX)[:, None])[:, 0], arm.moved(kind, place, SIX), 1e-13)
