"""Levelling: by hand, and against arms whose base or whose gravity is turned."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
from scipy.spatial.transform import Rotation

from precision_pin.draws.laws import Normal, Uniform
from precision_pin.sources.beam import Beam
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.payload import Payload
from precision_pin.terms.term import JointValue
from support.checks.common import Q7, evaluated, one_link, same
from support.plain_robot import chain_of, joint, link, random_arm


def check_levelling(module: ModuleType) -> None:
    # 2 kg at 0.4 m along x on an upright hinge, which feels no weight until the base's y side is raised by r:
    # then it falls towards -y, the torque is -m g r 0.4
    chain = one_link(mass=2.0, com=(0.4, 0, 0))
    flexible = JointCompliance(joint="hinge", compliance=Uniform(1e-5, mean=1e-4))
    values = {"levelling[base].rx": 1e-3, "joint_compliance[hinge].compliance": 1.1e-4}
    at, totals = evaluated(chain, [0.0], [module.Levelling(rx=Normal(1e-3)), flexible], values)
    same(totals[JointValue(0)], [-1.1e-4 * 2 * 9.81 * 1e-3 * 0.4], 1e-18)
    assert at.posture.load_torque[0] == 0
    # raised at the x side nothing pulls sideways; at 90° it is the x side that counts, its raising is -ry
    for q, tilt, torque in ((0.0, {"ry": 1e-3}, 0.0), (np.pi / 2, {"ry": -1e-3}, 1.0), (0.3, {"rz": 0.5}, 0.0)):
        _, totals = evaluated(chain, [q], [module.Levelling(**tilt), replace(flexible, compliance=1e-4)])
        same(totals[JointValue(0)], [torque * 1e-4 * 2 * 9.81 * 1e-3 * 0.4], 1e-16)
    _check_turned_base(module)
    _check_turned_gravity(module)


def _check_turned_base(module: ModuleType) -> None:
    """Compare the torques of an arm on a mount that is turned by a small rotation vector."""
    text = random_arm(41, prismatic=(4,))
    tilt = np.array([3e-6, -2e-6, 4e-6])
    rpy = Rotation.from_rotvec(tilt).as_euler("xyz")
    mount = joint("mount", "fixed", "ground", "base", (0, 0, 0), rpy)
    turned = text.replace('<robot name="arm">', f'<robot name="arm">{link("ground")}{mount}')
    gravity = (1.0, -3.0, -9.0)
    straight, tilted = (chain_of(each, tip="tool", gravity=gravity) for each in (text, turned))
    change = tilted.at(Q7).load_torque - straight.at(Q7).load_torque
    rx, ry, rz = map(float, tilt)
    for k, name in enumerate(straight.joint_names):
        flexible = JointCompliance(joint=name, compliance=1.0)
        tilting = module.Levelling(rx=rx, ry=ry, rz=rz)
        (level,), (off_level,) = (
            evaluated(straight, Q7, sources)[1].values() for sources in ([flexible], [flexible, tilting])
        )
        # second order: 3e-11 of torques of some 30 N·m
        np.testing.assert_allclose(off_level - level, change[k : k + 1], rtol=0, atol=1e-9)


def _check_turned_gravity(module: ModuleType) -> None:
    """Compare all that loads bend, with mass, centre, stiffness and tilt random, with gravity turned so."""
    text = random_arm(42, prismatic=(4,))
    gravity, tilt = np.array([1.0, -3.0, -9.0]), np.array([0.02, -0.03, 0.05])
    sources = [
        Payload(at="tool", mass=Uniform(0.1, mean=2.0), com=(Uniform(0.1), 0.0, Uniform(0.1))),
        *(JointCompliance(joint=f"joint{k}", compliance=Uniform(1e-6, mean=1e-5)) for k in (1, 4, 6)),
        Beam(link="link2", EI=Uniform(100.0, mean=900.0), GI=400.0, EA=1e5),
    ]
    straight, tilted = (
        chain_of(text, tip="tool", gravity=tuple(each)) for each in (gravity, gravity - np.cross(tilt, gravity))
    )
    levelling = module.Levelling(rx=Normal(0.01), ry=Normal(0.01), rz=Normal(0.01))
    at, _ = evaluated(straight, Q7, [*sources, levelling])
    assert max(len(term.factors) for term in at.terms) == 3
    other, _ = evaluated(tilted, Q7, sources)
    x = other.space.sample(3, 0, 20)
    tilts = {
        f"levelling[base].{name}": np.full(20, value) for name, value in zip(("rx", "ry", "rz"), tilt, strict=True)
    }
    rows = dict(zip(other.space.components, x, strict=True)) | tilts
    y = np.array([rows[name] for name in at.space.components])
    for engine in ("linear", "exact"):
        np.testing.assert_allclose(getattr(at, engine)(y), getattr(other, engine)(x), rtol=0, atol=1e-13)
