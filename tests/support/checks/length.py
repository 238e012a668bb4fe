"""Lengths, by hand and by moving the origin in the URDF."""

from __future__ import annotations

import itertools
from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Uniform
from support.checks.common import evaluated, same, slanted_arm
from support.plain_robot import chain_of, joint, link, pose_error, robot, unit


def check_length(module: ModuleType) -> None:
    # a hand case: L of two moving links in a plane; q turns link 2's x from base x to base y
    planar = chain_of(
        robot(
            link("base"),
            joint("one", "revolute", "base", "upper"),
            link("upper"),
            joint("two", "revolute", "upper", "lower", (1, 0, 0)),
            link("lower"),
            joint("flange", "fixed", "lower", "tool", (0.5, 0, 0)),
            link("tool"),
        )
    )
    q = np.radians([30, 60])
    length = [
        module.Length(joint="two", parameters=(1e-3,)),
        module.Length(frame="tool", parameters=(-0.3e-3, -0.2e-3)),
    ]
    at, _ = evaluated(planar, q, length)
    expected = 1e-3 * np.array([np.cos(q[0]), np.sin(q[0]) - 0.5, 0, 0, 0, 0])
    same(at.linear(np.zeros((0, 1)))[:, 0], expected, 1e-16)
    same(at.exact(np.zeros((0, 1)))[:, 0], expected, 1e-15)

    # another way: the same robot with the origin moved
    arm = slanted_arm(11)
    reading, chain = arm.reading, arm.chain
    nominal = reading.poses(arm.q)
    for target, along in itertools.product(
        ({"joint": "joint4"}, {"frame": "tool"}, {"joint": "joint1"}),
        ("link", "x of joint2", "-y of joint5", "z of joint7", "axis of joint3", "-axis of joint4"),
    ):
        source = module.Length(**target, along=along, parameters=(0.8e-3, "extra"))
        at, _ = evaluated(chain, arm.q, [source], {}, [Draw("extra", Uniform(1e-3, mean=0.4e-3))])
        moved_joint = target.get("joint", "flange")
        ((parent, origin),) = ((entry.parent, entry.origin) for entry in reading.joints if entry.name == moved_joint)
        start = nominal[parent][:3, :3] @ origin[:3, 3]
        end = nominal[parent][:3, 3] + start
        if along == "link":
            chain_link = {"joint4": "link3", "flange": "link7", "joint1": "base"}[moved_joint]
            direction = unit(end - nominal[chain_link][:3, 3])
        else:
            name = along.split()[-1]
            (child, axis) = next((entry.child, entry.axis) for entry in reading.joints if entry.name == name)
            which = along.lstrip("-").split()[0]
            vector = axis if which == "axis" else np.eye(3)["xyz".index(which)]
            direction = nominal[child][:3, :3] @ vector * (-1 if along.startswith("-") else 1)
        shift = np.eye(4)
        shift[:3, 3] = (nominal[parent][:3, :3] @ origin[:3, :3]).T @ direction * 1.2e-3
        moved = reading.poses(arm.q, displaced={("joint", moved_joint): shift})["tool"]
        same(at.exact([[0.4e-3]])[:, 0], pose_error(moved, nominal["tool"]), 1e-14)
        same(at.exact([[0.4e-3]])[:3, 0], 1.2e-3 * direction, 1e-14)
