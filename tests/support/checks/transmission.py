"""Transmissions: kinematic error and lead by hand, wind-up against the slope of the potential energy."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.laws import Uniform
from precision_pin.terms.term import JointValue
from support.checks.common import Q7, evaluated, one_link, same, slanted_arm


def check_transmission(module: ModuleType) -> None:
    # a strain wave gear of 100:1: 0.5 arcmin peak to peak twice in a turn of the motor, runout once in one of the joint
    chain = one_link()
    fast, slow = np.pi / 10800 / 4, 2e-4
    source = module.Transmission(joint="hinge", amplitude=(fast, Uniform(1e-4, mean=2e-4)), order=(200.0, 1.0))
    for q, one, two in ((0.0, 0.3, 1.2), (0.7, 2.0, -1.0), (-3.0, 5.0, 0.0)):
        values = {
            "transmission[hinge].phase.x": np.cos(one),
            "transmission[hinge].phase.y": np.sin(one),
            "transmission[hinge].phase[1].x": np.cos(two),
            "transmission[hinge].phase[1].y": np.sin(two),
            "transmission[hinge].amplitude[1]": slow,
        }
        at, totals = evaluated(chain, [q], [source], values)
        same(totals[JointValue(0)], [fast * np.sin(200 * q + one) + slow * np.sin(q + two)], 1e-15)
        assert not any(term.loaded for term in at.terms)
    # a phase anywhere on the turn: half the amplitude's square at every pose
    for q in (0.0, 0.7):
        at, _ = evaluated(chain, [q], [module.Transmission(joint="hinge", amplitude=(1e-3, 2e-3), order=(3.0, 1.0))])
        same(at.covariance[5, 5], 5e-6 / 2, 1e-17)
    # the same by the motor's turn as the period
    values = {"transmission[hinge].phase.x": 0.6, "transmission[hinge].phase.y": 0.8}
    source = module.Transmission(joint="hinge", amplitude=(fast,), order=(2.0,), period=2 * np.pi / 100)
    _, totals = evaluated(chain, [0.7], [source], values)
    same(totals[JointValue(0)], [fast * np.sin(200 * 0.7 + np.arctan2(0.8, 0.6))], 1e-12)
    # a ball screw of 10 mm lead, ISO 3408-3 grade 5: 23 µm over 300 mm, 8 µm peak to peak within a turn
    slide = one_link("prismatic")
    source = module.Transmission(
        joint="hinge", amplitude=(4e-6,), order=(1.0,), period=0.01, lead_error=Uniform(23e-6 / 0.3)
    )
    values |= {"transmission[hinge].lead_error": 23e-6 / 0.3}
    for d, turned in ((0.3, 0.0), (0.3025, np.pi / 2), (-0.3, 0.0)):
        _, totals = evaluated(slide, [d], [source], values)
        expected = 23e-6 * d / 0.3 + 4e-6 * np.sin(turned + np.arctan2(0.8, 0.6))
        same(totals[JointValue(0)], [expected], 1e-15)
    # wind-up: 2 kg at 0.4 m on a hinge about y droop by τ/k
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    at, totals = evaluated(chain, [0.0], [module.Transmission(joint="hinge", stiffness=1e4)])
    same(totals[JointValue(0)], [2.0 * 9.81 * 0.4 / 1e4], 1e-15)
    assert at.exact(np.zeros((0, 1)))[2, 0] < 0
    assert all(term.loaded for term in at.terms)
    # any arm, random stiffness
    arm = slanted_arm(24, prismatic=(5,))
    torque = arm.reading.load_torque(arm.q, arm.q)
    for k, name in enumerate(arm.q):
        source = module.Transmission(joint=name, stiffness=Uniform(1e3, mean=2e4))
        _, totals = evaluated(arm.chain, Q7, [source], {f"transmission[{name}].stiffness": 1.93e4})
        same(totals[JointValue(k)] * 1.93e4, torque[k : k + 1], 1e-11)
