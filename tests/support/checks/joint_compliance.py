"""Joint flexibility, eq 23, by hand and against the slope of the potential energy."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.laws import Uniform
from precision_pin.terms.term import JointValue
from support.checks.common import Q7, evaluated, one_link, same, slanted_arm


def check_joint_compliance(module: ModuleType) -> None:
    # 2 kg at 0.4 m on a hinge about y: the load turns it about +y, so the arm droops
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    at, totals = evaluated(chain, [0.0], [module.JointCompliance(joint="hinge", compliance=1e-4)])
    same(totals[JointValue(0)], [1e-4 * 2.0 * 9.81 * 0.4], 1e-15)
    assert at.exact(np.zeros((0, 1)))[2, 0] < 0
    # a vertical slide sinks by C m g
    chain = one_link("prismatic", mass=2.0, com=(0.4, 0, 0))
    _, totals = evaluated(chain, [0.3], [module.JointCompliance(joint="hinge", compliance=1e-6)])
    same(totals[JointValue(0)], [-1e-6 * 2.0 * 9.81], 1e-15)
    # any arm: against the slope of the potential energy
    gravity = (1.0, -2.0, -9.0)
    arm = slanted_arm(14, prismatic=(5,), gravity=gravity)
    torque = arm.reading.load_torque(arm.q, arm.q, gravity)
    for k, name in enumerate(arm.q):
        source = module.JointCompliance(joint=name, compliance=Uniform(1e-6, mean=1e-5))
        component = f"joint_compliance[{name}].compliance"
        _, totals = evaluated(arm.chain, Q7, [source], {component: 1.7e-5})
        same(totals[JointValue(k)] / 1.7e-5, torque[k : k + 1], 1e-11)
