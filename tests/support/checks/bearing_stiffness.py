"""Flexibility of bearings, by hand and by the balance of forces on any arm."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from precision_pin.draws.laws import Uniform
from support.checks.clearance import GRAVITY, free_body
from support.checks.common import Q7, evaluated, in_base, one_link, same, slanted_arm

RADIAL, AXIAL, TILT, ROLL = 3e6, 5e6, 2e4, 7e3


def check_bearing_stiffness(module: ModuleType) -> None:
    _check_hinges(module)
    _check_two_bearings(module)
    _check_any_arm(module)


def _check_hinges(module: ModuleType) -> None:
    # 2 kg at 0.4 m on an upright hinge: 19.62 N down the axis, 7.848 N·m that tip it about +y; the arm droops
    chain = one_link(mass=2.0, com=(0.4, 0, 0))
    source = module.BearingStiffness(joint="hinge", radial=RADIAL, axial=AXIAL, tilt=TILT)
    at, totals = evaluated(chain, [0.0], [source])
    same(totals[chain.seat(0)], [0, 0, -19.62 / AXIAL, 0, 7.848 / TILT, 0], 1e-19)
    assert at.exact(np.zeros((0, 1)))[2, 0] < -19.62 / AXIAL
    assert all(term.loaded for term in at.terms)
    # a lying hinge: all radial; what turns it about its axis is the drive's
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    at, totals = evaluated(chain, [0.0], [source])
    same(in_base(at.posture, totals), [0, 0, -19.62 / RADIAL, 0, 0, 0], 1e-19)
    # an upright slide with a carriage: tips and rolls, and leaves the weight to the drive
    chain = one_link("prismatic", mass=2.0, com=(0.4, 0.1, 0.3), gravity=(0.0, -9.81, -9.81))
    source = module.BearingStiffness(joint="hinge", radial=RADIAL, tilt=TILT, roll=ROLL)
    for pads_on, lever in (("child", 0.3), ("parent", 0.5)):
        source = module.BearingStiffness(joint="hinge", radial=RADIAL, tilt=TILT, roll=ROLL, pads_on=pads_on)
        _, totals = evaluated(chain, [0.2], [source])
        # (0.4, 0.1, lever) × (0, -19.62, -19.62) about the pads; the rail's origin lies 0.2 m below those of a carriage
        turn = np.array([19.62 * (lever - 0.1) / TILT, 0.4 * 19.62 / TILT, -0.4 * 19.62 / ROLL])
        shift = np.array([0, -19.62 / RADIAL, 0]) + np.cross(turn, (0, 0, lever - 0.5))
        same(totals[chain.seat(0)], [*shift, *turn], 1e-18)


def _check_two_bearings(module: ModuleType) -> None:
    # an upright shaft on springs of 1e6 N/m at z = -20 and 60 mm, with 19.62 N along x at z = 100 mm and 7.848 N·m about
    # y from the weight, so 9.81 N·m in all: they get (9.81 + 0.02·19.62)/0.08 = 127.53 N above, -107.91 N below
    chain = one_link(mass=2.0, com=(0.4, 0, 0.1), gravity=(9.81, 0.0, -9.81))
    source = module.BearingStiffness(joint="hinge", radial=2e6, tilt=1e6 * 0.08**2 / 2, centre=0.02)
    _, totals = evaluated(chain, [0.0], [source])
    below, above = -107.91e-6, 127.53e-6
    tipped = (above - below) / 0.08
    same(totals[chain.seat(0)], [below + 0.02 * tipped, 0, 0, 0, tipped, 0], 1e-17)


def _check_any_arm(module: ModuleType) -> None:
    arm = slanted_arm(32, prismatic=(2, 5), gravity=GRAVITY)
    chain, reading, q = arm.chain, arm.reading, arm.q
    for number, name in enumerate(chain.joint_names):
        slides = bool(chain.prismatic[number])
        _, axis, force, moment = free_body(reading, name, q, GRAVITY)
        along = np.outer(axis, axis)
        across = np.eye(3) - along
        lever = (0.07 + (q[name] if slides else 0.0)) * axis
        settings = {"roll": ROLL} if slides else {"axial": AXIAL}
        source = module.BearingStiffness(
            joint=name, radial=Uniform(1e6, mean=RADIAL), tilt=TILT, centre=0.07, **settings
        )
        values = {f"bearing_stiffness[{name}].radial": 3.7e6}
        at, totals = evaluated(chain, Q7, [source], values)
        turn = across @ (moment - np.cross(lever, force)) / TILT
        shift = across @ force / 3.7e6
        if slides:
            turn = turn + along @ moment / ROLL
        else:
            shift = shift + along @ force / AXIAL
        same(in_base(at.posture, totals) * 1e6, np.concatenate([shift + np.cross(turn, -lever), turn]) * 1e6, 1e-9)
