"""Payload, by hand and against a chain that carries it."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.laws import Normal, Uniform
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.terms.term import JointValue
from support.checks.common import Q7, evaluated, one_link, same
from support.plain_robot import chain_of, random_arm


def check_payload(module: ModuleType) -> None:
    # hand case: mass and centre both random, on a hinge about y: τ = m g c_x at q = 0
    chain = one_link(axis=(0, 1, 0))
    mass, c_x, c_z, compliance = 1.3, 0.25, -0.1, 2e-4
    source = module.Payload(at="tool", mass=Uniform(0.1, mean=1.0), com=(Uniform(0.3), 0.0, Normal(0.1)))
    flexible = JointCompliance(joint="hinge", compliance=Uniform(1e-4, mean=1e-4))
    values = {
        "payload[tool].mass": mass,
        "payload[tool].com": c_x,
        "payload[tool].com[2]": c_z,
        "joint_compliance[hinge].compliance": compliance,
    }
    for q in (0.0, 0.6):
        at, totals = evaluated(chain, [q], [source, flexible], values)
        arm = (1 + c_x) * np.cos(q) + c_z * np.sin(q)
        same(totals[JointValue(0)], [compliance * mass * 9.81 * arm], 1e-14)
        assert max(len(term.factors) for term in at.terms) == 3
    # anywhere on any arm: the same as a chain that carries it
    text = random_arm(15, prismatic=(4,))
    for where in ("tool", "link3", "half2", "bracket", "finger"):
        settings = {"at": where, "mass": 2.5, "com": (0.11, -0.07, 0.05)}
        bare = chain_of(text, tip="tool")
        carrying = bare.with_payload(2.5, (0.11, -0.07, 0.05), where)
        for name in bare.joint_names:
            flexible = JointCompliance(joint=name, compliance=1e-3)
            _, by_source = evaluated(bare, Q7, [module.Payload(**settings), flexible])
            expected = 1e-3 * carrying.at(Q7).load_torque[bare.joint_index(name)]
            same(by_source[JointValue(bare.joint_index(name))], [expected], 1e-12)
