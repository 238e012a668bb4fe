"""Drives: backlash, compliance (eq 23), encoder and transmission, by hand and by the slope of the potential energy."""

from dataclasses import replace
from types import ModuleType

import numpy as np

from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources.force import Force
from precision_pin.sources.levelling import Levelling
from precision_pin.sources.payload import Payload
from precision_pin.terms.term import JointValue
from support.checks.common import MM, Q7, RandomArm, evaluated, one_link, same, slanted_arm


def arm_with_torques() -> tuple[RandomArm, np.ndarray]:
    """Return an arm, and the torques of its weights by the slope of the potential energy."""
    gravity = (1.0, -2.0, -9.0)
    arm = slanted_arm(14, prismatic=(5,), gravity=gravity)
    return arm, arm.reading.load_torque(arm.q, arm.q, gravity)


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
    arm, torque = arm_with_torques()
    assert len({*np.sign(torque)}) == 2
    for k, name in enumerate(arm.q):
        for share, decided in ((0.999, True), (1.001, False)):
            source = module.Backlash(joint=name, backlash=1e-3, band=share * abs(torque[k]))
            _, totals = evaluated(arm.chain, Q7, [source])
            same(totals[JointValue(k)], [np.sign(torque[k]) * 5e-4 if decided else 0.0], 1e-18)


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
    arm, torque = arm_with_torques()
    for k, name in enumerate(arm.q):
        source = module.JointCompliance(joint=name, compliance=Uniform(1e-6, mean=1e-5))
        component = f"joint_compliance[{name}].compliance"
        _, totals = evaluated(arm.chain, Q7, [source], {component: 1.7e-5})
        same(totals[JointValue(k)] / 1.7e-5, torque[k : k + 1], 1e-11)


ARCSEC = np.pi / 648000


def check_encoder(module: ModuleType) -> None:
    chain = one_link()

    def error(q: float, phase: float = 0.0, **settings) -> float:
        source = module.Encoder(joint="hinge", **settings)
        point = {"encoder[hinge].phase.x": np.cos(phase), "encoder[hinge].phase.y": np.sin(phase)}
        _, totals = evaluated(chain, [q], [source], point if source.draws("") else None)
        return float(totals[JointValue(0)][0]) if totals else 0.0

    # 412 e/D arcsec for 1 µm and 24.85 mm
    amplitude = 412.5 * 1 / 24.85 * ARCSEC
    same(error(0.0, np.pi / 2, eccentricity=1e-6, radius=24.85e-3 / 2), amplitude, 1e-4)
    same(error(np.pi / 2, 0.0, eccentricity=1e-6, radius=24.85e-3 / 2), amplitude, 1e-4)
    same(error(np.pi / 3, np.pi / 6, eccentricity=1e-6, radius=24.85e-3 / 2), amplitude, 1e-4)
    # on the motor's side: 50 times as fast, a 50th of it
    for q, phase in ((0.7, 1.1), (-2.3, 4.0)):
        same(error(q, phase, amplitude=2e-3, order=3, ratio=50), 2e-3 / 50 * np.sin(3 * 50 * q + phase), 1e-15)
        # the mean of what two heads read, each at its own angle
        for order in (1, 2, 3, 4):
            mean = np.mean([2e-3 * np.sin(order * (q + head) + phase) for head in (0.0, np.pi)])
            same(error(q, phase, amplitude=2e-3, order=order, heads=2), mean, 1e-15)
    # both numbers of the amplitude random
    source = module.Encoder(joint="hinge", eccentricity=Uniform(5e-6, mean=20e-6), radius=0.02)
    values = {"encoder[hinge].eccentricity": 18e-6, "encoder[hinge].phase.x": 0.6, "encoder[hinge].phase.y": 0.8}
    _, totals = evaluated(chain, [0.5], [source], values)
    same(totals[JointValue(0)], [9e-4 * np.sin(0.5 + np.arctan2(0.8, 0.6))], 1e-15)
    # JCGM 100, F.2.2.1: a step's standard uncertainty is 0.29 of it; here 17 bits, on the motor's side of 100:1
    step = 2 * np.pi / 2**17
    for ratio in (1.0, 100.0):
        source = module.Encoder(joint="hinge", resolution=step, ratio=ratio)
        at, totals = evaluated(chain, [0.5], [source], {"encoder[hinge].quantisation": 1e-5})
        same(totals[JointValue(0)], [1e-5], 1e-15)
        same(at.space.covariance, [[(step / ratio) ** 2 / 12]], 1e-15)
        (draw,) = at.space.draws
        same(draw.law.support([1.0]), step / 2 / ratio, 1e-15)
        assert draw.scope is Scope.POSE
    # a periodic error has its amplitude's variance, halved, at every pose
    for q in (0.0, 0.7):
        at, _ = evaluated(chain, [q], [module.Encoder(joint="hinge", amplitude=1e-3)])
        same(at.covariance[5, 5], 1e-6 / 2, 1e-18)
        assert all(draw.scope is Scope.UNIT for draw in at.space.draws)
    # zero
    source = module.Encoder(joint="hinge", offset=Normal(1e-3, mean=2e-3))
    _, totals = evaluated(chain, [0.5], [source], {"encoder[hinge].offset": 3e-3})
    same(totals[JointValue(0)], [3e-3], 1e-15)
    # a linear encoder at 0.3 m: 20 µm period, a scale 5 µm/m long
    slide = one_link("prismatic")
    for d in (0.3, 0.3 + 5e-6, -0.1 + 7e-6):
        source = module.Encoder(joint="hinge", amplitude=1e-7, period=20e-6, scale=Uniform(5e-6))
        values = {"encoder[hinge].scale": 5e-6, "encoder[hinge].phase.x": 0.6, "encoder[hinge].phase.y": -0.8}
        _, totals = evaluated(slide, [d], [source], values)
        expected = 5e-6 * d + 1e-7 * np.sin(2 * np.pi * d / 20e-6 - np.arctan2(0.8, 0.6))
        same(totals[JointValue(0)], [expected], 1e-15)


def check_servo(module: ModuleType) -> None:
    # hand case: 2 kg at 0.4 m on a hinge about y, τ = 2 · 9.81 · 0.4 = 7.848 N·m, falling is positive
    chain, load, k, friction, mu, share = (
        one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0)),
        7.848,
        50.0,
        0.4,
        0.1,
        0.8,
    )
    servo = module.Servo(joint="hinge", stiffness=Uniform(5.0, mean=k), friction=friction, load_friction=mu)
    for side in (1, -1):
        at = ErrorModel(chain, Space(), [servo]).at([0.0], approach={"hinge": side})
        same(at.error_at_means[4], (load - side * (friction + mu * load)) / k, 1e-12)
        # a compensated load rubs as before
        helped = replace(servo, gravity_compensation=share)
        at = ErrorModel(chain, Space(), [helped]).at([0.0], approach={"hinge": side})
        same(at.error_at_means[4], (load * (1 - share) - side * (friction + mu * load)) / k, 1e-12)
        # lifted by an applied moment, also beyond balance, where the load pulls the other way; friction follows the size of
        # the whole load, though with 4 N·m what is not compensated pulls the other way already
        for lift in (4.0, 10.0):
            lifted = Force(at="tool", moment=(0.0, -lift, 0.0))
            at = ErrorModel(chain, Space(), [helped, lifted]).at([0.0], approach={"hinge": side})
            held = load * (1 - share) - lift - side * (friction + mu * abs(load - lift))
            same(at.error_at_means[4], held / k, 1e-12)
    # where the direction is unknown one number stands for it, and a random payload is compensated at its mean
    payload = Payload(at="tool", mass=Uniform(0.2, mean=1.0))
    values = {"approach[hinge]": 0.25, "payload[tool].mass": 1.1, "servo[hinge].stiffness": 48.0}
    _, totals = evaluated(chain, [0.0], [helped, payload], values)
    torque = load + 1.1 * 9.81
    expected = torque - share * (load + 9.81) - 0.25 * (friction + mu * torque)
    same(totals[JointValue(0)], [expected / 48.0], 1e-13)
    alone = replace(helped, compensates="links")
    _, totals = evaluated(chain, [0.0], [alone, payload], values)
    same(totals[JointValue(0)], [(expected + share * 9.81) / 48.0], 1e-13)
    _, totals = evaluated(chain, [0.0], [replace(helped, integral=True)])
    assert not totals
    # an upright hinge feels only that the base leans, of which the controller knows nothing: -m g r 0.4
    upright, leaning = one_link(mass=2.0, com=(0.4, 0, 0)), Levelling(rx=1e-3)
    _, totals = evaluated(upright, [0.0], [module.Servo(joint="hinge", stiffness=k, gravity_compensation=1.0), leaning])
    same(totals[JointValue(0)], [-load * 1e-3 / k], 1e-15)


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
    # pieces: 60 N·m turn a gear of size 32 by 7.15e-4 rad (its maker), either way; half of the loss against the motion
    weightless = one_link(axis=(0, 1, 0), gravity=(0.0, 0.0, 0.0))
    gear = module.Transmission(
        joint="hinge", stiffness=(67e3, 110e3, 120e3), limit_torques=(29.0, 108.0), hysteresis_loss=3e-4
    )
    by_hand = 29 / 67e3 + 31 / 110e3
    for load in (60.0, -60.0):
        model = ErrorModel(weightless, Space(), [gear, Force(at="tool", moment=(0.0, load, 0.0))])
        for side in (1, -1):
            turn = model.at([0.0], approach={"hinge": side}).error_at_means[4]
            same(turn, np.sign(load) * by_hand - side * 1.5e-4, 1e-15)
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
    arm, torque = arm_with_torques()
    for k, name in enumerate(arm.q):
        source = module.Transmission(joint=name, stiffness=Uniform(1e3, mean=2e4))
        _, totals = evaluated(arm.chain, Q7, [source], {f"transmission[{name}].stiffness": 1.93e4})
        same(totals[JointValue(k)] * 1.93e4, torque[k : k + 1], 1e-11)
