"""Statics on the arm at rest against geometrically exact rods, and against arms settled anew.

Reference: |d| 35.877 mm, |δ| 15.614 mrad, ∂d/∂payload (2.703, 4.264, -3.639) mm/kg, ∂d/∂ln(all stiffness)
(-7.026, -26.942, 21.190) mm, and relative distances of loads re-evaluated until settled of 0.528, 0.267, 0.134, 0.054,
0.027 and 0.0027 % at stiffness factors 0.5, 1, 2, 5, 10 and 100.
"""

from __future__ import annotations

import numpy as np
import pytest

from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Component
from precision_pin.draws.laws import Disc, Fixed, Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.beam import Beam
from precision_pin.sources.frame import Frame
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.length import Length
from precision_pin.sources.payload import Payload
from precision_pin.sources.profiles import Segment
from precision_pin.terms.term import JointValue
from support.oracles import rods_error, settled_errors
from support.plain_robot import chain_of, joint, link, robot
from support.sheets import PAPER_Q

MM = 1e-3
FACTORS = (0.5, 1.0, 2.0, 5.0, 10.0, 100.0)
JOINTS = ("joint1", "joint2", "joint3", "joint4")


@pytest.fixture(scope="module")
def arm() -> Chain:
    return Chain.from_urdf(PAPER_SHEET.parent / "4dof.urdf", tip="tool")


def settings(arm: Chain, statics="equilibrium", **means: float) -> ErrorModel:
    """Return the paper's loads and stiffnesses, every one a number of its own."""
    given = {"mass": 1.0, "EI2": 8000.0, "GI2": 4000.0, "EI3": 8000.0, "GI3": 1000.0}
    given |= {f"C{k}": 1e-5 for k in range(1, 5)} | {"x": 0.02, "y": -0.03} | means
    space = Space(tuple(Draw(name, Fixed(value)) for name, value in given.items()))
    sources = [
        Payload(at="tool", mass="mass", com=("x", "y", 0.0)),
        Beam(link="link2", EI="EI2", GI="GI2"),
        Beam(link="link3", EI="EI3", GI="GI3"),
        *(JointCompliance(joint=name, compliance=f"C{k}") for k, name in enumerate(JOINTS, 1)),
    ]
    return ErrorModel(arm, space, sources, statics=statics)


def scaled(arm: Chain, stiffness: float = 1.0, statics="equilibrium") -> ErrorModel:
    """Return the arm with all stiffness times one factor, payload at the tool point."""
    factor = Component("factor")
    sources = [
        Payload(at="tool", mass="mass"),
        Beam(link="link2", EI=8000.0 * factor, GI=4000.0 * factor),
        Beam(link="link3", EI=8000.0 * factor, GI=1000.0 * factor),
        *(JointCompliance(joint=name, compliance=1e-5 / factor) for name in JOINTS),
    ]
    space = Space((Draw("factor", Fixed(stiffness)), Draw("mass", Fixed(1.0))))
    return ErrorModel(arm, space, sources, statics=statics)


# --- exact rods ---


@pytest.mark.slow
def test_the_rods_are_those_of_the_reference():
    error = rods_error()
    assert np.linalg.norm(error[:3]) / MM == pytest.approx(35.877, abs=5e-4)
    assert np.linalg.norm(error[3:]) / MM == pytest.approx(15.614, abs=5e-4)
    by_payload = (rods_error(payload=1.01) - rods_error(payload=0.99))[:3] / 0.02
    np.testing.assert_allclose(by_payload / MM, [2.703, 4.264, -3.639], atol=5.1e-4)
    # the reference's derivative to ln(stiffness) is the difference over ± 5 %, 0.25 % above the limit
    by_stiffness = (rods_error(1.05) - rods_error(0.95))[:3] / 0.1
    np.testing.assert_allclose(by_stiffness / MM, [-7.026, -26.942, 21.190], atol=5.1e-4)
    np.testing.assert_allclose(rods_error(pieces=40), error, atol=1e-9)


@pytest.mark.slow
def test_distance_to_the_rods(arm):
    """At most a tenth of what loads re-evaluated until they settle leave, and never more than 0.04 %."""
    settled_only = np.array([0.528, 0.267, 0.134, 0.054, 0.027, 0.0027]) / 100
    for factor, bound in zip(FACTORS, settled_only, strict=True):
        exact = rods_error(factor)
        error = scaled(arm, factor).at(PAPER_Q).tangent[0]
        for rows in (slice(0, 3), slice(3, 6)):
            assert np.linalg.norm((error - exact)[rows]) < 0.1 * bound * np.linalg.norm(exact[rows])


@pytest.mark.slow
def test_slopes_are_those_of_the_rods(arm):
    jacobian = scaled(arm).at(PAPER_Q).jacobian
    h = 0.01
    by_payload = (rods_error(payload=1 + h) - rods_error(payload=1 - h)) / (2 * h)
    by_stiffness = (rods_error(np.exp(h)) - rods_error(np.exp(-h))) / (2 * h)
    for column, exact in ((1, by_payload), (0, by_stiffness)):
        for rows in (slice(0, 3), slice(3, 6)):
            gap = np.linalg.norm(jacobian[rows, column] - exact[rows])
            assert gap < 0.002 * np.linalg.norm(exact[rows])


# --- derivatives ---


@pytest.mark.slow
def test_slopes_are_those_of_arms_settled_anew(arm):
    """Every load and stiffness, to 1e-6 of the column, against fourth-order differences."""
    model = settings(arm)
    error, jacobian = model.at(PAPER_Q).tangent
    check_slopes(model, PAPER_Q, jacobian)
    assert np.linalg.norm(error[:3]) > 0.03


@pytest.mark.slow
def test_slopes_with_segments_a_sliding_joint_and_a_branch():
    """Two links, the second slides at a slant and carries a bracket; every law about its mean."""
    chain = chain_of(
        robot(
            link("base"),
            joint("turn", "revolute", "base", "upper", (0.1, 0, 0.3), (0.2, 0.1, 0), (0, 1, 0)),
            link("upper", 4.0, (0.4, 0.02, 0)),
            joint("slide", "prismatic", "upper", "fore", (0.9, 0.1, 0.05), (0, 0.4, 0.3), (0.6, 0, 0.8)),
            link("fore", 2.0, (0.3, 0, 0.02)),
            joint("bolt", "fixed", "fore", "bracket", (0.3, 0.1, 0)),
            link("bracket", 1.0, (0, 0.1, 0.1)),
            joint("flange", "fixed", "fore", "tool", (0.7, 0, 0.1)),
            link("tool", 0.5, (0, 0, 0.1)),
        ),
        tip="tool",
        gravity=(1.0, -2.0, -9.0),
    )
    means = {"EI": 300.0, "GI": 200.0, "C": 2e-4, "D": 4e-5, "wall": 2e-3, "m": 1.5}

    def model() -> ErrorModel:
        segments = (
            Segment(fraction=0.4, section="tube", outer_diameter=0.03, wall="wall", material="aluminium"),
            Segment(EI="EI", GI="GI"),
        )
        sources = [
            Payload(at="tool", mass="m", com=(0.05, 0.0, 0.1)),
            Beam(link="upper", segments=segments),
            Beam(link="fore", section="rod", diameter=0.02, material="steel", self_weight="section"),
            JointCompliance(joint="turn", compliance="C"),
            JointCompliance(joint="slide", compliance="D"),
        ]
        space = Space(tuple(Draw(name, Fixed(value)) for name, value in means.items()))
        return ErrorModel(chain, space, sources, statics="equilibrium")

    q = [0.3, 0.2]
    error, jacobian = model().at(q).tangent
    assert np.linalg.norm(error[:3]) > 0.02
    check_slopes(model(), q, jacobian)


def check_slopes(model: ErrorModel, q, jacobian: np.ndarray) -> None:
    mean = model.space.mean
    for column, name in enumerate(model.space.components):
        h = 1e-3 * mean[column]
        steps = np.outer(np.eye(mean.size)[column], [h, -h, 2 * h, -2 * h])
        ahead, behind, far_ahead, far_behind = settled_errors(model, q, mean[:, None] + steps).T
        slope = (8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * h)
        np.testing.assert_allclose(jacobian[:, column], slope, atol=1e-6 * np.abs(slope).max(), err_msg=name)


def test_a_sliding_joint_on_a_spring_by_hand():
    """A weight slides down a slope on a spring: the force does not change with the way, so x = C m g sin α exactly.

    The hinge before it turns by C' m g (l + x) cos(α + turn).
    """
    slope, reach, mass, give, twist = 0.4, 0.8, 3.0, 1e-3, 2e-3
    chain = chain_of(
        robot(
            link("base"),
            joint("hinge", "revolute", "base", "rail", axis=(0, 1, 0)),
            link("rail"),
            joint("slide", "prismatic", "rail", "tool", axis=(1, 0, 0)),
            link("tool", mass),
        )
    )
    sources = [
        JointCompliance(joint="slide", compliance=Uniform(1e-4, mean=give)),
        JointCompliance(joint="hinge", compliance=twist),
    ]
    at = ErrorModel(chain, Space(), sources, statics="equilibrium").at([slope, reach])
    weight, angle, way = mass * 9.81, slope, reach
    for _ in range(200):
        angle, way = slope + twist * weight * way * np.cos(angle), reach + give * weight * np.sin(angle)
    start, rest = (r * np.array([np.cos(a), 0, -np.sin(a)]) for r, a in ((reach, slope), (way, angle)))
    error, jacobian = at.tangent
    np.testing.assert_allclose(error, [*(rest - start), 0, angle - slope, 0], atol=1e-12)
    # dx = sin a W dC + C W cos a da, da = C' W (cos a dx - x sin a da)
    matrix = [
        [1, -give * weight * np.cos(angle)],
        [-twist * weight * np.cos(angle), 1 + twist * weight * way * np.sin(angle)],
    ]
    dway, dangle = np.linalg.solve(matrix, [weight * np.sin(angle), 0])
    along, across = (np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([-np.sin(angle), 0, -np.cos(angle)]))
    np.testing.assert_allclose(jacobian[:3, 0], along * dway + way * across * dangle, atol=1e-7)


# --- limits ---


@pytest.mark.slow
def test_a_stiff_arm_has_the_nominal_answer(arm):
    nominal, rest = (scaled(arm, 1e6, statics).at(PAPER_Q) for statics in ("nominal", "equilibrium"))
    np.testing.assert_allclose(rest.tangent[0], nominal.tangent[0], rtol=1e-6, atol=1e-13)
    np.testing.assert_allclose(rest.jacobian, nominal.jacobian, rtol=1e-5, atol=1e-12)


@pytest.mark.slow
def test_geometry_keeps_its_terms_exactly(arm):
    """Lengths, frames and offsets stand beside loads as in nominal statics, bit for bit; only loaded terms are new."""
    nominal, rest = (settings(arm, statics) for statics in ("nominal", "equilibrium"))
    geometry = [
        Length(joint="joint3", parameters=(Uniform(1e-3, mean=2e-4),)),
        Frame(joint="joint4", x=Uniform(1e-3), ry=Normal(1e-4)),
        JointOffset(joint="joint2", offset=Uniform(1e-3)),
    ]
    tables = []
    for model in (nominal, rest):
        at = ErrorModel(arm, model.space, [*model.sources, *geometry], statics=model.statics).at(PAPER_Q)
        tables.append([term for term in at.terms if not term.loaded])
    assert len(tables[0]) == 4
    for one, other in zip(*tables, strict=True):
        assert one.target == other.target
        assert one.factors == other.factors
        np.testing.assert_array_equal(one.twist, other.twist)


def test_a_joint_that_gives_and_errs_does_both(arm):
    offset = JointOffset(joint="joint2", offset=Uniform(1e-3, mean=2e-3))
    soft = JointCompliance(joint="joint2", compliance=1e-5)
    at = ErrorModel(arm, Space(), [offset, soft], statics="equilibrium").at(PAPER_Q)
    column = at.space.index["joint_offset[joint2].offset"]
    at_mean = at.exact(np.array([[2e-3]]))[:, 0]
    np.testing.assert_array_equal(at_mean, at.tangent[0])
    assert column == 0
    turns = [term for term in at.terms if term.target == JointValue(1)]
    # loads hang on the arm that errs by its mean, too: the load's turn is that of the joint at 3° + 2 mrad + its own
    torque = at.posture.torque_on(1)[()]
    caused = sum(term.twist[0] * (2e-3 if term.factors else 1.0) for term in turns if term.loaded)
    assert caused != pytest.approx(1e-5 * torque, rel=1e-6)
    moved = ErrorModel(arm, Space(), [soft], statics="equilibrium").at([*PAPER_Q[:1], PAPER_Q[1] + 2e-3, *PAPER_Q[2:]])
    (own,) = (term.twist[0] for term in moved.terms if not term.factors)
    assert caused == pytest.approx(own, rel=1e-12)


# --- the warning ---


def warned(model: ErrorModel) -> list[str]:
    return [finding.code for finding in model.statics_findings(model.at(PAPER_Q))]


@pytest.mark.slow
def test_nominal_statics_warn_where_they_are_stretched(arm):
    """About a millimetre apart at the paper's stiffness: more than a tenth of a spread of 1 mm, less of one of 20 mm."""
    tolerance = {spread: Length(joint="joint3", parameters=(Uniform(spread * np.sqrt(3)),)) for spread in (1e-3, 20e-3)}

    def model(factor: float, spread: float, statics="nominal") -> ErrorModel:
        soft = scaled(arm, factor, statics)
        return ErrorModel(arm, soft.space, [*soft.sources, tolerance[spread]], statics=statics)

    soft = model(1.0, 1e-3)
    (finding,) = soft.statics_findings(soft.at(PAPER_Q))
    gap = np.linalg.norm((soft.at(PAPER_Q).tangent[0] - scaled(arm).at(PAPER_Q).tangent[0])[:3])
    assert finding.code == "W_STATICS"
    assert finding.severity == "warning"
    assert f"put the tip {gap * 1e3:.3g} mm away" in finding.message
    assert warned(model(1.0, 20e-3)) == []
    assert warned(model(10.0, 1e-3)) == []
    assert warned(model(1.0, 1e-3, "equilibrium")) == []
    assert warned(model(0.02, 1e-3)) == ["W_DEFLECTION", "W_STATICS"]  # links bend by more than a radian
    stiff = ErrorModel(arm, Space(), [tolerance[1e-3], Frame(joint="joint1", x=Disc(1e-3).mean_vector[0])])
    assert warned(stiff) == []
