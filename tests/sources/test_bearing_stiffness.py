from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize

from precision_pin.base.errors import InputError, SheetError, UnknownNameError
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Component
from precision_pin.draws.laws import Normal, TruncatedNormal, Uniform
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import examples
from precision_pin.robot.chain import Chain
from precision_pin.robot.loads import Load
from precision_pin.sources import bearing_stiffness
from precision_pin.sources.bearing_stiffness import BearingStiffness
from precision_pin.sources.payload import Payload
from support.checks.bearings import check_bearing_stiffness
from support.checks.common import Q7, evaluated, in_base, one_link, turn_and_slide
from support.plain_robot import chain_of, random_arm
from support.sheets import PAPER_Q

NOTHING = np.zeros((0, 1))


def test_by_hand_and_by_the_balance_of_forces():
    check_bearing_stiffness(bearing_stiffness)


def test_r4_under_the_wrench_of_the_reference_case():
    """R4: joint 3 of the paper's arm carries F = (2.926470, 55.840368, 0) N, M = (7.113279, -0.372791, …) N·m.

    At 100 N/µm and 2e5 N·m/rad it moves by 0.029 and 0.558 µm and tilts by 35.6 and -1.86 µrad.
    """
    chain = Chain.from_urdf(examples.PAPER_SHEET.parent / "4dof.urdf").with_payload(1.0)
    source = BearingStiffness(joint="joint3", radial=1e8, axial=3e8, tilt=2e5)
    _, totals = evaluated(chain, PAPER_Q, [source])
    expected = np.array([0.02926470, 0.55840368, 0, 35.566395, -1.863955, 0]) * 1e-6
    np.testing.assert_allclose(totals[chain.seat(2)], expected, atol=5e-12)


def test_loads_do_work_on_one_another_alike():
    """Maxwell and Betti: the flexibility of the seat, off the bearing's centre too, is symmetric and never negative."""
    source = BearingStiffness(joint="hinge", radial=3e6, axial=5e6, tilt=2e4, centre=-0.13)
    columns = []
    for row in range(6):
        # a mass of 1 kg makes a force, a first moment of 1 kg·m without mass a moment, s × g
        gravity, moments = np.zeros(3), np.zeros(4)
        weight, arm = {3: (2, 1), 4: (0, 2), 5: (1, 0)}.get(row, (row, None))
        gravity[weight] = 1.0
        moments[0 if arm is None else 1 + arm] = 1.0
        chain = one_link(gravity=tuple(gravity))
        load = Load(1, np.eye(4), np.zeros(3), along=False, moments=((moments, ()),))
        terms = source.terms(chain.at([0.0]).with_loads([load]), LabelledSpace(Space(), source.label()))
        columns.append(sum(term.twist for term in terms))
    table = np.array(columns).T
    np.testing.assert_allclose(table, table.T, atol=1e-20)
    np.testing.assert_allclose(np.sort(np.linalg.eigvalsh(table))[0], 0, atol=1e-20)
    assert np.linalg.matrix_rank(table, tol=1e-12) == 5


def test_equilibrium_of_an_arm_on_a_tilting_bearing():
    """A rigid arm of 1 m with 30 kg at its end on an upright hinge: k θ = m g cos θ, and the axial spring by m g/k."""
    chain = one_link()
    sources = [Payload(at="tool", mass=30.0), BearingStiffness(joint="hinge", axial=1e5, tilt=4e3)]
    weight = 30.0 * 9.81
    angle = optimize.brentq(lambda turn: 4e3 * turn - weight * np.cos(turn), 0, 1, xtol=1e-15)
    at = ErrorModel(chain, Space(), sources, statics="equilibrium").at([0.0])
    expected = [np.cos(angle) - 1, 0, -np.sin(angle) - weight / 1e5, 0, angle, 0]
    np.testing.assert_allclose(at.exact(NOTHING)[:, 0], expected, atol=1e-11)


def test_products_of_random_loads_and_stiffnesses():
    chain = one_link()
    sources = [
        Payload(at="tool", mass=Uniform(0.5, mean=2.0), com=(Uniform(0.1), 0.0, 0.0)),
        BearingStiffness(joint="hinge", tilt=1e6 * (Component("span") * Component("span"))),
    ]
    values = {"payload[tool].mass": 1.7, "payload[tool].com": 0.06, "span": 0.08}
    at, totals = evaluated(chain, [0.0], sources, values, [Draw("span", Uniform(0.01, mean=0.09))])
    assert max(len(term.factors) for term in at.terms) == 3
    np.testing.assert_allclose(totals[chain.seat(0)][4], 1.7 * 9.81 * 1.06 / (1e6 * 0.0064), rtol=1e-14)


def test_gravity_off_leaves_nothing():
    chain = chain_of(random_arm(32), tip="tool", gravity=(0.0, 0.0, 0.0))
    sources = [BearingStiffness(joint=name, radial=1e6, axial=1e6, tilt=1e3) for name in chain.joint_names]
    np.testing.assert_array_equal(ErrorModel(chain, Space(), sources).at(Q7).linear(NOTHING), np.zeros((6, 1)))


def test_stiffnesses_left_out_are_rigid_and_the_rest_adds():
    chain = chain_of(random_arm(32), tip="tool")
    whole = BearingStiffness(joint="joint3", radial=1e6, axial=2e6, tilt=1e3, centre=0.03)
    parts = [
        BearingStiffness(joint="joint3", centre=0.03, **{name: getattr(whole, name)})
        for name in ("radial", "axial", "tilt")
    ]
    _, expected = evaluated(chain, Q7, [whole])
    at, totals = evaluated(chain, Q7, parts)
    np.testing.assert_allclose(in_base(at.posture, totals), in_base(at.posture, expected), rtol=1e-13, atol=1e-20)


SHEET = """\
precision-pin: 1
robot: arm.urdf
gravity: {gravity}
poses:
  here: {{turn: 20 deg, slide: 150 mm}}
parameters:
  k: {{normal: 10 N/um, mean: 80 N/um, truncated: true}}
sources:
  - bearing_stiffness: {{joint: turn, radial: k, axial: 120 kN/mm, centre: -20 mm,
      tilt: {{uniform: 5 N*m/arcmin, mean: 30 N*m/arcmin}}}}
  - bearing_stiffness: {{joint: slide, radial: 50 N/um, tilt: 2e4 N*m/rad, roll: 9 N*m/mrad, pads_on: parent}}
"""


def sheet(tmp_path, gravity="earth", old="", new="") -> ErrorModel:
    return turn_and_slide(tmp_path, SHEET.format(gravity=gravity), old, new, tool=(0.1, 0.2, 0))


def test_from_a_sheet_in_every_model(tmp_path):
    model = sheet(tmp_path)
    assert model.space.components == ("k", "bearing_stiffness[turn].tilt")
    assert model.space.draws[0].law == TruncatedNormal(1e7 / 3, 8e7, 3.0)
    at = model.at("here")
    x = model.space.sample(5, 0, 200)
    tilt = x[1]
    # upright: only the axial spring and the tilt move; the slide sinks, pitches about y and rolls about x of the arm
    force, first = 5.5 * 9.81, 9.81 * (4.0 * 0.2 + 1.5 * 0.65)
    side = 9.81 * 1.5 * 0.2
    tool = 1.5 * 9.81
    pitch = tool * 0.25 / 2e4
    down = -force / 1.2e8 - (first / tilt) * 0.55 - tool / 5e7 - pitch * 0.15
    np.testing.assert_allclose(at.linear(x)[2], down, rtol=1e-12)
    turn = np.radians(20)
    about = np.array([-side / tilt - side / 9e3, first / tilt + pitch])
    expected = [about[0] * np.cos(turn) - about[1] * np.sin(turn), about[0] * np.sin(turn) + about[1] * np.cos(turn)]
    np.testing.assert_allclose(at.linear(x)[3:5], expected, rtol=1e-12)
    np.testing.assert_allclose(at.linear(x), at.exact(x), atol=1e-7)
    error, jacobian = at.tangent
    # stiffnesses vary by a sixth: 1/k bends by a thirty-sixth of what they do
    np.testing.assert_allclose(
        error[:, None] + jacobian @ (x - model.space.mean[:, None]), at.exact(x), atol=0.03 * np.abs(error).max()
    )
    np.testing.assert_array_equal(sheet(tmp_path, "none").at("here").linear(x), np.zeros((6, 200)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "axial: 120 kN/mm",
            "axial: 120 N*m/rad",
            "axial: 'N[*]m/rad' in '120 N[*]m/rad' is not a unit of linear stiff",
        ),
        ("axial: 120 kN/mm", "axial: 0 N/m", r"axial of bearing_stiffness\[turn\] can become zero or negative"),
        ("radial: k", "radial: q", "no parameter named 'q'"),
        ("radial: 50 N/um", "axial: 50 N/um", "axial: of .* the joint slides along its axis; joint_compliance"),
        ("radial: k", "roll: 5 N*m/rad", "roll: of .* the joint turns about its axis; joint_compliance"),
        ("pads_on: parent", "pads_on: none", "pads_on: input should be 'child' or 'parent'"),
        ("mean: 30 N*m/arcmin", "mean: 4 N*m/arcmin", r"tilt of bearing_stiffness\[turn\] can become zero or negative"),
    ],
)
def test_bad_settings_of_a_sheet_give_one_line(tmp_path, old, new, message):
    with pytest.raises(SheetError, match=message) as caught:
        sheet(tmp_path, old=old, new=new)
    (finding,) = caught.value.findings
    assert 9 <= finding.line <= 11


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match="bearing_stiffness needs a stiffness: radial:, axial:, tilt: or roll:"):
        BearingStiffness(joint="hinge")
    with pytest.raises(InputError, match="pads_on of bearing_stiffness must be one of child, parent, got 'x'"):
        BearingStiffness(joint="hinge", radial=1.0, pads_on="x")
    with pytest.raises(InputError, match=r"radial of bearing_stiffness\[hinge\] can become zero or negative"):
        ErrorModel(one_link(), Space(), [BearingStiffness(joint="hinge", radial=Normal(1e6, mean=2e6))]).at([0.0])


def test_an_unknown_joint_is_named_with_the_nearest():
    with pytest.raises(UnknownNameError, match="no joint on the chain named 'hinges'; did you mean 'hinge'"):
        ErrorModel(one_link(), Space(), [BearingStiffness(joint="hinges", radial=1e6)]).at([0.0])
