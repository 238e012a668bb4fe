"""Backlash, by hand and by the slope of the potential energy."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.terms.term import JointValue
from support.checks.common import MM, Q7, evaluated, one_link, same, slanted_arm


def check_backlash(module: ModuleType) -> None:
    # 2 kg at 0.4 m on a hinge about y: 7.848 N·m about +y, on the other side of the hinge about -y
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    for q, side in ((0.0, 1), (1.0, 1), (2.0, -1), (np.pi, -1)):
        at, totals = evaluated(chain, [q], [module.Backlash(joint="hinge", backlash=3e-4, band=3.0)])
        same(totals[JointValue(0)], [side * 1.5e-4], 1e-19)
        # either way the tip goes down
        assert at.exact(at.space.mean[:, None])[2, 0] < 0
    # a vertical slide stands on its lower flank
    chain = one_link("prismatic", mass=2.0, com=(0.4, 0, 0))
    _, totals = evaluated(chain, [0.3], [module.Backlash(joint="hinge", backlash=0.02 * MM, band=19.6)])
    same(totals[JointValue(0)], [-0.01 * MM], 1e-19)
    # within the band it stands anywhere in the gap, whose size may be random too
    source = module.Backlash(joint="hinge", backlash=Uniform(0.01 * MM, mean=0.02 * MM), band=19.63, scope="pose")
    assert [(draw.law, draw.scope) for draw in source.own_draws("b")] == [(Uniform(1.0), Scope.POSE)]
    values = {"backlash[hinge].side": 0.6, "backlash[hinge].backlash": 0.028 * MM}
    at, totals = evaluated(chain, [0.3], [source], values)
    same(totals[JointValue(0)], [0.0084 * MM], 1e-19)
    assert not any(term.loaded for term in at.terms)
    # after a motion the drive leads by half the gap, unless the load of 7.848 N·m is larger than friction and runs ahead
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    for band, sides in ((10.0, (-1, 1)), (3.0, (1, 1))):
        model = ErrorModel(chain, Space(), [module.Backlash(joint="hinge", backlash=3e-4, band=band)])
        for direction, side in zip((1, -1), sides, strict=True):
            (term,) = model.at([0.0], approach=[direction]).terms
            same(term.twist, [side * 1.5e-4], 1e-19)
    # any arm: against the slope of the potential energy
    gravity = (1.0, -2.0, -9.0)
    arm = slanted_arm(14, prismatic=(5,), gravity=gravity)
    torque = arm.reading.load_torque(arm.q, arm.q, gravity)
    assert len({*np.sign(torque)}) == 2
    for k, name in enumerate(arm.q):
        for share, decided in ((0.999, True), (1.001, False)):
            source = module.Backlash(joint=name, backlash=1e-3, band=share * abs(torque[k]))
            _, totals = evaluated(arm.chain, Q7, [source])
            same(totals[JointValue(k)], [np.sign(torque[k]) * 5e-4 if decided else 0.0], 1e-18)
