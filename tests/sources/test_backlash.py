from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, SheetError, UnknownNameError
from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import examples
from precision_pin.robot.chain import Chain
from precision_pin.sources import backlash
from precision_pin.sources.backlash import Backlash
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.payload import Payload
from precision_pin.terms.term import JointValue
from support.checks.common import evaluated, leaning_hand, one_link, turn_and_slide
from support.checks.drives import check_backlash
from support.sheets import PAPER_Q

ARCMIN = np.pi / 10800


def test_by_hand_and_by_the_slope_of_the_potential_energy():
    check_backlash(backlash)


def test_r4_which_flank_each_joint_lies_on():
    """R4: the load puts (0, 121.999783, -1.515192, 0) N·m on the joints of the paper's arm."""
    chain = Chain.from_urdf(examples.PAPER_SHEET.parent / "4dof.urdf").with_payload(1.0)
    for band, sides in ((1.0, (0, 1, -1, 0)), (1.5, (0, 1, -1, 0)), (1.6, (0, 1, 0, 0)), (130.0, (0, 0, 0, 0))):
        sources = [Backlash(joint=name, backlash=2 * ARCMIN, band=band) for name in chain.joint_names]
        at, totals = evaluated(chain, PAPER_Q, sources)
        np.testing.assert_allclose([totals[JointValue(k)][0] for k in range(4)], np.array(sides) * ARCMIN, atol=1e-18)
        free = {factor.name for term in at.terms for factor in term.factors}
        assert free == {f"backlash[joint{k + 1}].side" for k in range(4) if not sides[k]}


def test_the_side_is_that_of_the_mean_load():
    chain = one_link(axis=(0, 1, 0))
    loads = [
        Payload(at="tool", mass=Uniform(1.9, mean=2.0)),
        Payload(at="tool", mass=Normal(0.05, mean=1.0), com=(-2.0, 0.0, 0.0)),
    ]
    source = Backlash(joint="hinge", backlash=1e-3, band=5.0)
    # 2 kg at 1 m against 1 kg at -1 m: 9.81 N·m; with 0.1 kg it would be -8.8
    for mass in (0.1, 2.0, 3.9):
        _, totals = evaluated(chain, [0.0], [*loads, source], {"payload[tool].mass": mass})
        np.testing.assert_array_equal(totals[JointValue(0)], [5e-4])


def test_no_random_number_stands_in_a_decided_side():
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    model = ErrorModel(chain, Space(), [Backlash(joint="hinge", backlash=1e-3, band=1.0)])
    errors = model.at([0.0]).exact(model.space.sample(1, 0, 100))
    assert np.ptp(errors, axis=1).max() == 0
    assert [draw.scope for draw in model.space.draws] == [Scope.VISIT]


def test_gravity_off_leaves_the_whole_gap():
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0), gravity=(0.0, 0.0, 0.0))
    at = ErrorModel(chain, Space(), [Backlash(joint="hinge", backlash=1e-3, band=1e-12)]).at([0.0])
    turned = at.linear(at.space.sample(1, 0, 4000))[4]
    assert np.abs(turned).max() <= 5e-4
    # uniform on ±b/2: variance b²/12, its estimate's standard error b²/12·sqrt(0.8/N); 5 of them
    assert abs((turned**2).mean() * 12 / 1e-6 - 1) < 5 * np.sqrt(0.8 / 4000)


def test_equilibrium_decides_on_the_deflected_arm():
    """The hand stands 10 mrad behind the vertical on an arm that droops by 50 mrad: it falls forwards, not back."""
    chain, load = leaning_hand()
    sources = [
        JointCompliance(joint="shoulder", compliance=0.05 / load),
        Backlash(joint="wrist", backlash=1e-3, band=0.01),
    ]
    found = {}
    for statics in ("nominal", "equilibrium"):
        at = ErrorModel(chain, Space(), sources, statics=statics).at([0.0, -0.010])
        (term,) = (term for term in at.terms if term.target == JointValue(1))
        assert not term.loaded
        found[statics] = term.twist[0]
    assert found == {"nominal": -5e-4, "equilibrium": 5e-4}


SHEET = """\
precision-pin: 1
robot: arm.urdf
gravity: {gravity}
poses:
  here: {{turn: 20 deg, slide: 150 mm}}
sources:
  - backlash: {{joint: turn, backlash: {{uniform: 0.5 arcmin, mean: 2 arcmin}}, band: 300 N*mm}}
  - backlash: {{joint: slide, backlash: 20 um, band: 0.1 kN, scope: pose}}
"""


def sheet(tmp_path, gravity="earth", old="", new="") -> ErrorModel:
    return turn_and_slide(tmp_path, SHEET.format(gravity=gravity), old, new, tool=(0.1, 0, 0), axis=(0, -1, 0))


def test_from_a_sheet_in_every_model(tmp_path):
    model = sheet(tmp_path)
    assert [source.band for source in model.sources] == pytest.approx([0.3, 100.0], rel=1e-15)
    assert model.space.components == ("backlash[turn].backlash", "backlash[turn].side", "backlash[slide].side")
    at = model.at("here")
    x = model.space.sample(5, 0, 200)
    turn, _, side = x
    # about -y the weight turns the joint back: the tip, at 0.55 m under 20°, goes down
    angle = np.radians(20) - turn / 2
    reach = 0.55 + side * 1e-5
    start = 0.55 * np.array([np.cos(np.radians(20)), np.sin(np.radians(20))])
    expected = np.array([reach * np.cos(angle) - start[0], reach * np.sin(angle) - start[1]])
    np.testing.assert_allclose(at.exact(x)[[0, 2]], expected, atol=1e-15)
    np.testing.assert_allclose(at.linear(x), at.exact(x), atol=1e-7)
    error, jacobian = at.tangent
    np.testing.assert_allclose(error[:, None] + jacobian @ (x - model.space.mean[:, None]), at.exact(x), atol=1e-7)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "band: 300 N*mm",
            "band: 300 N",
            "band: 'N' in '300 N' is not a unit of torque; allowed: N[*]m, N[*]mm, kN[*]m",
        ),
        ("band: 0.1 kN", "band: 1 N*m", "is not a unit of force"),
        ("20 um", "20 arcsec", "backlash: 'arcsec' in '20 arcsec' is not a unit of length"),
        ("20 um", "-20 um", r"backlash of backlash\[slide\] can become negative"),
        ("mean: 2 arcmin", "mean: 0.4 arcmin", r"backlash of backlash\[turn\] can become negative"),
        (", band: 0.1 kN", "", "the key 'band' is missing"),
        ("band: 0.1 kN", "band: 0 N", "the band of backlash must be positive, got 0.0"),
        ("scope: pose", "scope: day", "scope: input should be 'unit', 'pose' or 'visit'"),
    ],
)
def test_bad_settings_of_a_sheet_give_one_line(tmp_path, old, new, message):
    with pytest.raises(SheetError, match=message) as caught:
        sheet(tmp_path, old=old, new=new)
    (finding,) = caught.value.findings
    assert finding.line in (7, 8)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"band": 0.0}, "band of backlash must be positive"),
        ({"band": float("nan")}, "band of backlash must be positive"),
        ({"scope": "day"}, "scope of backlash must be one of unit, pose, visit, got 'day'"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Backlash(**{"joint": "hinge", "backlash": 1e-3, "band": 1.0} | settings)


def test_an_unknown_joint_is_named_with_the_nearest():
    with pytest.raises(UnknownNameError, match="no joint on the chain named 'hinges'; did you mean 'hinge'"):
        ErrorModel(one_link(), Space(), [Backlash(joint="hinges", backlash=1e-3, band=1.0)]).at([0.0])
