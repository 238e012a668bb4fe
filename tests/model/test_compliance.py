"""Compliance of the end-effector by source, against closed forms and against a weight that is hung on the arm."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import precision_pin as pp
from precision_pin.model.compliance import ARM, compliances_of, loaded_terms, loads_of
from precision_pin.sources import Beam, JointCompliance, Payload

LENGTH, EI, GI, ANGULAR = 0.8, 900.0, 400.0, 2e-5


@pytest.fixture
def arm(tmp_path):
    """One joint about y, then a link along x without weight."""
    (tmp_path / "arm.urdf").write_text(
        f"""<robot name="arm"><link name="base"/><link name="beam"/><link name="tip"/>
        <joint name="turn" type="revolute"><parent link="base"/><child link="beam"/><axis xyz="0 1 0"/>
        <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
        <joint name="end" type="fixed"><parent link="beam"/><child link="tip"/><origin xyz="{LENGTH} 0 0"/></joint></robot>"""
    )
    chain = pp.Chain.from_urdf(tmp_path / "arm.urdf")
    sources = [JointCompliance(joint="turn", compliance=ANGULAR), Beam(link="beam", EI=EI, GI=GI, EA=1e7)]
    return pp.ErrorModel(chain, pp.Space(), sources)


def test_a_cantilever_on_a_soft_joint_by_hand(arm):
    found = compliances_of(arm, [0.0])
    beam = np.zeros((6, 6))
    bent, turned, twisted = LENGTH**3 / (3 * EI), LENGTH**2 / (2 * EI), LENGTH / EI
    beam[[0, 1, 2, 3, 4, 5], [0, 1, 2, 3, 4, 5]] = (LENGTH / 1e7, bent, bent, LENGTH / GI, twisted, twisted)
    # a force along y turns the end about z, one along z about -y
    beam[1, 5] = beam[5, 1] = turned
    beam[2, 4] = beam[4, 2] = -turned
    assert_allclose(found["beam[beam]"], beam, rtol=1e-12, atol=1e-18)
    axis = np.array([0, 0, -LENGTH, 0, 1, 0])  # the twist of the tip by a turn about y
    assert_allclose(found["joint_compliance[turn]"], ANGULAR * np.outer(axis, axis), rtol=1e-12, atol=1e-20)


def test_a_compliance_turns_with_the_arm_and_is_about_the_target(arm):
    chain = arm.chain.with_target((0.1, 0.05, 0.0))
    model = pp.ErrorModel(chain, pp.Space(), arm.sources)
    q = [0.7]
    whole = sum(compliances_of(model, q).values())
    assert_allclose(whole, whole.T, rtol=0, atol=1e-18)
    # by hand from the tip: C' = A C Aᵀ with the rigid motion from tip to target
    turn = model.at(q).posture.pose[:3, :3]
    reach = turn @ chain.target
    motion = np.eye(6)
    motion[:3, 3:] = -np.array([[0, -reach[2], reach[1]], [reach[2], 0, -reach[0]], [-reach[1], reach[0], 0]])
    assert_allclose(whole, motion @ sum(compliances_of(arm, q).values()) @ motion.T, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("q", [0.0, 0.6])
def test_a_weight_at_the_tip_displaces_it_by_the_compliance(arm, q):
    carrying = pp.ErrorModel(arm.chain, pp.Space(), [*arm.sources, Payload(at="tip", mass=3.0)])
    force = np.concatenate([3.0 * arm.chain.gravity, np.zeros(3)])
    expected = sum(compliances_of(carrying, [q]).values()) @ force
    assert_allclose(carrying.at([q]).linear(np.zeros((0, 1)))[:, 0], expected, rtol=1e-10, atol=1e-15)
    assert set(loads_of(carrying, [q])) == {ARM, "payload[tip]"}
    assert {label: len(terms) > 0 for label, terms in loaded_terms(carrying, [q]).items()} == {
        "joint_compliance[turn]": True,
        "beam[beam]": True,
    }
