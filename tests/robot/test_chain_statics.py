"""Statics of a chain: torques, wrenches and loads against the potential energy, free bodies and Pinocchio."""

import numpy as np
import pytest

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.sources.beam import Beam
from support.oracles import displacements
from support.plain_robot import PlainRobot, chain_of, joint, link, random_arm, robot

GRAVITY = (1.5, -2.5, -9.0)
ARM = random_arm(41, prismatic=(3,))
READING = PlainRobot.parse(ARM)
Q = dict(zip((f"joint{k}" for k in range(1, 8)), (0.3, -0.7, 0.2, 1.1, -1.3, 0.8, 2.5), strict=True))
EVERYTHING = Q | {"finger_joint": 0.07}


def chain_between(base: str, tip: str, text: str = ARM) -> Chain:
    names = chain_of(text, base=base, tip=tip).joint_names
    still = {name: value for name, value in EVERYTHING.items() if name not in names}
    return chain_of(text, base=base, tip=tip, locked=still, gravity=GRAVITY)


PAIRS = [("base", "tool"), ("tool", "base"), ("bracket", "finger"), ("half2", "base"), ("link5", "tool")]


@pytest.mark.parametrize(("base", "tip"), PAIRS)
def test_torques_against_the_slope_of_the_potential_energy(base, tip):
    """Everything that hangs on the chain counts: branches, finger, the old root where another link stands still."""
    chain = chain_between(base, tip)
    expected = READING.load_torque(chain.joint_names, EVERYTHING, GRAVITY, base)
    posture = chain.at({name: EVERYTHING[name] for name in chain.joint_names})
    np.testing.assert_allclose(posture.load_torque, expected, atol=1e-11)
    by_basis = [sum(posture.torque_on(k).values()) for k in range(len(chain.joints))]
    np.testing.assert_allclose(by_basis, expected, atol=1e-11)


@pytest.mark.parametrize(("base", "tip"), PAIRS)
def test_link_wrenches_against_free_bodies(base, tip):
    """The sum of weights beyond each joint, about the end of the link that carries it, in the end's axes."""
    chain = chain_between(base, tip)
    posture = chain.at({name: EVERYTHING[name] for name in chain.joint_names})
    centres = READING.centres(EVERYTHING, base)
    for number, name in enumerate(chain.joint_names):
        end = posture.place_pose(chain.end(number))
        total = np.zeros(6)
        for carried in READING.beyond(name, base) & set(centres):
            mass, centre = centres[carried]
            force = mass * np.array(GRAVITY)
            total[:3] += end[:3, :3].T @ force
            total[3:] += end[:3, :3].T @ np.cross(centre - end[:3, 3], force)
        np.testing.assert_allclose(posture.link_wrench[number], total, atol=1e-11)
        loads = [load for load in posture.loads if load.link > number]
        (wrench,) = posture.wrench_on(loads, end[:3, 3]).values() if loads else (np.zeros(6),)
        turned = np.concatenate([end[:3, :3].T @ wrench[:3], end[:3, :3].T @ wrench[3:]])
        np.testing.assert_allclose(turned, total, atol=1e-11)
    np.testing.assert_array_equal(posture.link_wrench[-1], np.zeros(6))


@pytest.mark.fast(2)
@pytest.mark.parametrize("where", ["tool", "finger", "half2", "base"])
def test_a_payload_is_a_link_more(where):
    centre = (0.1, -0.2, 0.3)
    bolted = ARM.replace("</robot>", joint("bolted", "fixed", where, "cargo") + link("cargo", 2.5, centre) + "</robot>")
    expected = chain_between("base", "tool", bolted).at(list(Q.values()))
    carrying = chain_between("base", "tool").with_payload(2.5, centre, where).at(list(Q.values()))
    np.testing.assert_allclose(carrying.load_torque, expected.load_torque, atol=1e-11)
    np.testing.assert_allclose(carrying.link_wrench, expected.link_wrench, atol=1e-11)
    basis = [sum(carrying.torque_on(k).values()) for k in range(7)]
    np.testing.assert_allclose(basis, expected.load_torque, atol=1e-11)


def test_payload_at_the_tip_by_default_and_none_of_zero_mass():
    chain = chain_of(ARM, tip="tool", gravity=GRAVITY)
    at_tip = chain.with_payload(1.5, (0.1, 0, 0)).at(Q).load_torque
    np.testing.assert_array_equal(at_tip, chain.with_payload(1.5, (0.1, 0, 0), "tool").at(Q).load_torque)
    np.testing.assert_allclose(chain.with_payload(0.0).at(Q).load_torque, chain.at(Q).load_torque, atol=1e-13)
    massless = chain_of(robot(link("a"), joint("j", "revolute", "a", "b", axis=(0, 1, 0)), link("b")))
    np.testing.assert_array_equal(massless.with_payload(0.0).at([0.0]).load_torque, [0.0])
    twice = chain.with_payload(1.0).with_payload(0.5).at(Q).load_torque
    np.testing.assert_allclose(twice, chain.with_payload(1.5).at(Q).load_torque, atol=1e-12)


@pytest.mark.parametrize(
    ("payload", "error", "message"),
    [
        ((-1.0,), InputError, "mass of a payload must be zero or more and finite"),
        ((float("inf"),), InputError, "mass of a payload must be zero or more and finite"),
        ((1.0, (0, 0)), InputError, "centre of a payload must be three finite numbers"),
        ((1.0, "there"), InputError, "centre of a payload must be three finite numbers.*'there'"),
        ((1.0, (0, 0, 0), "tol"), UnknownNameError, "no link named 'tol'; did you mean 'tool'"),
    ],
)
def test_wrong_payloads_are_refused(payload, error, message):
    with pytest.raises(error, match=message):
        chain_of(ARM, tip="tool").with_payload(*payload)


def test_splitting_a_link_or_adding_a_massless_one_changes_nothing():
    """Torques, wrenches and beams: a rod in one piece, in two pieces, and with an empty link of zero length between."""

    def arm(*pieces):
        parts = [link("base"), joint("j", "revolute", "base", "p0", (0, 0, 0.2), (0.3, 0, 0), (0, 1, 0))]
        for k, (length, mass) in enumerate(pieces):
            parts.append(link(f"p{k}", mass, (length / 2, 0, 0)) if mass else link(f"p{k}"))
            last = k == len(pieces) - 1
            parts.append(joint(f"c{k}", "revolute" if last else "fixed", f"p{k}", f"p{k + 1}", (length, 0, 0)))
        return robot(*parts, link(f"p{len(pieces)}", 1.7, (0.2, 0.1, 0.3)))

    whole = arm((1.2, 3.6))
    for other in (
        arm((0.4, 1.2), (0.8, 2.4)),
        arm((0.4, 1.2), (0.0, 0.0), (0.8, 2.4)),
        arm((0.0, 0.0), (1.2, 3.6)),
        arm((1.2, 3.6), (0.0, 0.0)),
    ):
        results = []
        for text in (whole, other):
            posture = chain_of(text, gravity=GRAVITY).at([0.6, -0.4])
            beam = Beam(link="p0", EI=900.0, GI=400.0, EA=1e5)
            at = ErrorModel(posture.chain, Space(), [beam]).at([0.6, -0.4])
            (displacement,) = displacements(at.terms, {}).values()
            results.append(
                (posture.pose, posture.load_torque, posture.link_wrench, displacement, at.exact(np.zeros((0, 1))))
            )
        for one, two in zip(*results, strict=True):
            np.testing.assert_allclose(one, two, atol=1e-13)
    cut = chain_of(arm((0.4, 1.2), (0.0, 0.0), (0.8, 2.4)))
    assert [cut.link_frame(name).path_rank for name in ("p0", "p1", "p2")] == [0, 1, 2]


def test_every_link_with_a_mass_is_one_load():
    chain = chain_between("base", "tool")
    total = sum(load.moments[0][0][0] for load in chain.loads)
    assert total == pytest.approx(sum(mass for mass, _ in READING.masses.values()))
    loads = dict(zip(READING.masses, chain.loads, strict=True))
    assert {name for name, load in loads.items() if load.along} == {"base", *(f"link{k}" for k in range(1, 8))}
    assert {name for name, load in loads.items() if load.stretch is None} == {"bracket", "finger"}
