from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import SheetError
from precision_pin.draws.expressions import Component, Operation
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import levelling
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.levelling import Levelling
from precision_pin.sources.mounting import Mounting
from precision_pin.terms.term import JointValue, Term
from support.checks.common import Q7, one_link
from support.checks.loads import check_levelling
from support.engines import check_engines, check_no_spread, written
from support.oracles import value_of
from support.plain_robot import chain_of, random_arm
from support.sheets import loads

SHEET = """\
levelling: {rx: {normal: 0.3 mrad}, ry: {normal: 0.3 mrad}}
joint_compliance: {joint: joint2, compliance: {uniform: 1e-6 rad/(N*m), mean: 1e-5 rad/(N*m)}}
joint_compliance: {joint: joint1, compliance: 1e-5 rad/(N*m)}
beam: {link: link2, EI: {uniform: 400 N*m^2, mean: 8000 N*m^2}, GI: 4000 N*m^2}
payload: {at: tool, mass: {uniform: 0.5 kg, mean: 5 kg}, com: [{uniform: 5 mm}, 0 mm, 0 mm]}
"""


def test_by_hand_and_against_a_turned_base_and_turned_gravity():
    check_levelling(levelling)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*W_SUPERPOSITION")
def test_from_a_sheet_through_every_engine(tmp_path):
    model = ErrorModel.load(written(tmp_path, SHEET))
    assert {"levelling[base].rx", "levelling[base].ry"} < set(model.space.components)
    check_engines(model)


@pytest.mark.slow
def test_in_equilibrium_the_slope_is_that_of_turned_gravity(tmp_path):
    """Slope to a tilt, at rest: difference of two arms at rest under gravity turned either way."""
    model = ErrorModel.load(written(tmp_path, SHEET, extra="statics: equilibrium"))
    sources = [source for source in model.sources if not isinstance(source, Levelling)]
    step = 1e-4
    ends = []
    for sign in (1, -1):
        tilted = [*sources, Levelling(rx=sign * step)]
        at = ErrorModel(model.chain, Space(), tilted, model.poses, "equilibrium").at("here")
        ends.append(at.tangent[0])
    slope = (ends[0] - ends[1]) / (2 * step)
    column = model.at("here").jacobian[:, model.space.index["levelling[base].rx"]]
    assert np.abs(slope).max() > 1e-3
    np.testing.assert_allclose(column, slope, rtol=0, atol=1e-6 * np.abs(slope).max())


def test_a_tilted_base_shares_its_angle_with_its_mounting():
    """Mounting moves the tip in the cell, levelling turns the weight: together, the arm on a turned mount."""
    chain = one_link(axis=(0, 0, 1), mass=2.0, com=(0.4, 0, 0))
    tilt, compliance = 1e-4, 1e-3
    sources = [
        Mounting(at="base", rx="tilt"),
        Levelling(rx="tilt"),
        JointCompliance(joint="hinge", compliance=compliance),
    ]
    space = ErrorModel(chain, Space(), [Levelling(rx=Normal(1e-3))]).space
    named = Space(tuple(type(draw)("tilt", draw.law) for draw in space.draws))
    at = ErrorModel(chain, named, sources).at([0.0])
    error = at.linear([[tilt]])[:, 0]
    # the tip, 1 m along x, swings to -y by C m g tilt 0.4 and turns with the base about x
    swing = compliance * 2 * 9.81 * tilt * 0.4
    np.testing.assert_allclose(error, [0, -swing, 0, tilt, 0, -swing], rtol=0, atol=1e-18)


@pytest.mark.slow
def test_without_it_loads_are_as_before_and_order_does_not_matter():
    chain = chain_of(random_arm(43, prismatic=(4,)), tip="tool")
    space, laden = loads()
    plain = ErrorModel(chain, space, laden).at(Q7)
    assert plain.posture.tilts == ()
    level = ErrorModel(chain, space, [Levelling(), *laden]).at(Q7)
    assert level.posture.tilts == ()
    for one, two in zip(plain.terms, level.terms, strict=True):
        np.testing.assert_array_equal(one.twist, two.twist)
        assert one.factors == two.factors
    tilts = [Levelling(rx=Normal(1e-3), rz=0.02), Levelling(ry=Uniform(1e-3))]
    first = ErrorModel(chain, space, [*tilts, *laden])
    last = ErrorModel(chain, space, [*laden, *tilts[::-1]])
    x = first.space.sample(4, 0, 10)
    rows = dict(zip(first.space.components, x, strict=True))
    y = np.array([rows[name] for name in last.space.components])
    np.testing.assert_allclose(last.at(Q7).exact(y), first.at(Q7).exact(x), rtol=0, atol=1e-14)
    # load_torque and wrench_basis stay those of the chain's own gravity
    posture = first.at(Q7).posture
    np.testing.assert_array_equal(posture.load_torque, plain.posture.load_torque)
    for load in plain.posture.loads:
        np.testing.assert_array_equal(
            posture.wrench_basis(load, np.ones(3)), plain.posture.wrench_basis(load, np.ones(3))
        )


def test_a_fourth_factor_becomes_part_of_a_formula():
    four = [Component(name) for name in "abcd"]
    term = Term.of(JointValue(0), 2.0, *four[:2], 3.0, *four[2:])
    assert term.factors == (four[0] * four[1], four[2], four[3])
    assert isinstance(term.factors[0], Operation)
    np.testing.assert_array_equal(term.twist, [6.0])
    five = Term.of(JointValue(0), 1.0, *four, four[0])
    values = {"a": 2.0, "b": 3.0, "c": 5.0, "d": 7.0}
    assert len(five.factors) == 3
    assert np.prod([value_of(factor, values) for factor in five.factors]) == 2 * 3 * 5 * 7 * 2


def test_without_weight_or_tolerance_no_spread():
    flexible = JointCompliance(joint="hinge", compliance=1e-4)
    tilted = Levelling(rx=Normal(1e-3), ry=Normal(1e-3), rz=Normal(1e-3))
    weightless = one_link(gravity=(0, 0, 0), mass=2.0, com=(0.4, 0, 0))
    check_no_spread(ErrorModel(weightless, Space(), [flexible, tilted]), [0.2])
    chain = one_link(mass=2.0, com=(0.4, 0, 0))
    check_no_spread(ErrorModel(chain, Space(), [flexible, Levelling(rx=Normal(0.0), ry=0.1)]), [0.2])
    # nothing gives way: nothing moves
    assert ErrorModel(chain, Space(), [tilted]).at([0.2]).terms == ()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("levelling: {rx: 0.02 mm}", "'mm' in '0.02 mm' is not a unit of angle"),
        ("levelling: {rx: tilt}", "no parameter named 'tilt'"),
        ("levelling: {x: 1 deg}", "unknown key 'x'"),
    ],
)
def test_bad_sheets_give_one_line(tmp_path, line, message):
    with pytest.raises(SheetError, match=rf"arm\.errors\.yaml:6: error E_\w+: .*{message}") as caught:
        ErrorModel.load(written(tmp_path, line))
    assert len(caught.value.findings) == 1
