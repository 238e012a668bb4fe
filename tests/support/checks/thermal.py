"""Warm links: similarity of the whole arm, Roark's cantilever, and a link cut into slices."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.laws import Normal, Uniform
from support.checks.common import Q7, evaluated, in_base, one_link, same, slanted_arm
from support.plain_robot import chain_of, inserted, pose_error, random_arm


def check_thermal(module: ModuleType) -> None:
    # an aluminium arm of 1 m, 2 K warmer: 46 µm longer
    chain = one_link()
    source = module.Thermal(link="arm", expansion=23e-6, temperature_change=2.0)
    at, totals = evaluated(chain, [np.pi / 2], [source])
    same(in_base(at.posture, totals), [0, 46e-6, 0, 0, 0, 0], 1e-18)
    # Roark, cantilevers with 1 K over 0.1 m of height: α ΔT l²/(2h) away from the warm side, turned by α ΔT l/h
    source = module.Thermal(link="arm", expansion=12e-6, gradient=1 / 0.1, across="z of hinge")
    at, totals = evaluated(chain, [0.0], [source])
    same(in_base(at.posture, totals), [0, 0, -60e-6, 0, 120e-6, 0], 1e-18)
    for direction in ("y of hinge", "y of base"):
        source = module.Thermal(link="arm", expansion=12e-6, gradient=10.0, across=direction)
        at, totals = evaluated(chain, [0.0], [source])
        same(in_base(at.posture, totals), [0, -60e-6, 0, 0, 0, -120e-6], 1e-18)
    # along the link a gradient bends nothing, from base axes it turns with the joint
    source = module.Thermal(link="arm", expansion=12e-6, gradient=10.0, across="y of base")
    at, totals = evaluated(chain, [np.pi / 2], [source])
    same(in_base(at.posture, totals), np.zeros(6), 1e-18)
    at, totals = evaluated(chain, [np.pi / 3], [source])
    away = 60e-6 * np.cos(np.pi / 3) * np.array([np.sin(np.pi / 3), -np.cos(np.pi / 3), 0])
    same(in_base(at.posture, totals), [*away, 0, 0, -120e-6 * np.cos(np.pi / 3)], 1e-18)
    _check_whole_arm(module)
    _check_slices(module)


def _check_whole_arm(module: ModuleType) -> None:
    """Check that the tip's position grows by the one factor of every length, and nothing turns."""
    chain = chain_of(random_arm(31), tip="tool")
    source = module.Thermal(expansion=Uniform(1e-6, mean=12e-6), temperature_change=Normal(3.0))
    for change, expansion in ((2.0, 11.5e-6), (300.0, 1e-4)):
        values = {"thermal[arm].expansion": expansion, "thermal[arm].temperature_change": change}
        at, _ = evaluated(chain, Q7, [source], values)
        x = np.array([[values[name]] for name in at.space.components])
        expected = np.concatenate([expansion * change * at.posture.pose[:3, 3], np.zeros(3)])
        for error in (at.linear(x), at.exact(x)):
            np.testing.assert_allclose(error[:, 0], expected, rtol=1e-12, atol=1e-14)


def _check_slices(module: ModuleType) -> None:
    """Compare with a link cut into slices, whose fibres grow as their temperatures say."""
    arm = slanted_arm(32, prismatic=(3,))
    chain, reading, q7 = arm.chain, arm.reading, arm.q
    poses = reading.poses(q7)
    expansion, gradient = 3e-8, 2.0  # second order: 1e-15
    for link, start, place, warm in (
        ("link4", "link4", ("joint", "joint5"), poses["link2"][:3, 0]),
        ("link7", "link7", ("link", "tool"), -poses["link1"][:3, 2]),
        ("base", "base", ("joint", "joint1"), np.array([0.0, 0.0, 1.0])),
    ):
        across = {"link4": "x of joint2", "link7": "-z of joint1", "base": "z of base"}[link]
        end = chain.placements[chain.link_frame(link).link]
        local = poses[start][:3, :3].T @ warm
        moved = _grown(end[:3, 3], local * gradient, expansion)
        displaced = np.linalg.inv(end) @ moved @ end
        tip = reading.poses(q7, displaced={place: displaced})["tool"]
        source = module.Thermal(link=link, expansion=expansion, gradient=gradient, across=across)
        at, _ = evaluated(chain, q7, [source])
        expected = pose_error(tip, poses["tool"])
        assert np.linalg.norm(expected[:3]) > 1e-9
        np.testing.assert_allclose(at.exact(np.zeros((0, 1)))[:, 0], expected, rtol=0, atol=3e-14)


def _grown(way: np.ndarray, warming: np.ndarray, expansion: float, slices: int = 200) -> np.ndarray:
    """Return the motion, axes of the link, of what the end of a link along ``way`` (from the origin) carries.

    The temperature rises by ``warming`` (K/m) across the link; growth along it cancels about its middle.
    """
    along = way / np.linalg.norm(way)
    warming = warming - along * (along @ warming)
    corners = [np.cross(along, axis) for axis in np.eye(3)]
    # a slice turns so that a corner r moves along the link as the fibre there grows: (δ × r)·along = growth
    rows = [np.cross(corner, along) for corner in corners] + [along]
    length = np.linalg.norm(way) / slices
    growth = [expansion * (warming @ corner) * length for corner in corners] + [0.0]
    turn = np.linalg.lstsq(np.array(rows), np.array(growth), rcond=None)[0]
    motion = np.eye(4)
    for k in range(slices):
        pivot = inserted([*(way * (k + 0.5) / slices), 0, 0, 0])
        motion = motion @ pivot @ inserted([0, 0, 0, *turn]) @ np.linalg.inv(pivot)
    return motion
