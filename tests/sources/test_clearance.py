from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from precision_pin.base.errors import InputError, SheetError, UnknownNameError
from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import examples
from precision_pin.robot.chain import Chain
from precision_pin.sources import clearance
from precision_pin.sources.clearance import Clearance
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.payload import Payload
from support.checks.bearings import check_clearance
from support.checks.common import MM, evaluated, one_link, turn_and_slide
from support.plain_robot import chain_of, joint, link, robot
from support.sheets import PAPER_Q


@pytest.mark.slow
def test_by_hand_and_by_the_balance_of_forces():
    check_clearance(clearance)


def test_r4_which_side_each_bearing_is_pushed():
    """Joint 3 of the paper's arm with 1 kg at the tool: R4 gives its wrench, the rest is a beam on two supports.

    F = (2.926470, 55.840368, 0) N and M = (7.113279, -0.372791, …) N·m, in the axes of link 2. With bearings 40 mm to
    either side of the joint's origin, ``P_B = ((-0.372791, -7.113279) + 0.04 F)/0.08 = (-3.196653, -60.995803)`` N and
    ``P_A = F - P_B = (6.123123, 116.836171)`` N: the tool hangs beside the axis, so they are pushed opposite ways.
    """
    chain = Chain.from_urdf(examples.PAPER_SHEET.parent / "4dof.urdf").with_payload(1.0)
    _, totals = evaluated(
        chain, PAPER_Q, [Clearance(joint="joint3", diametral=(0.02 * MM,), start=-0.04, span=0.08, band=1.0)]
    )
    on_a, on_b = np.array([6.123123, 116.836171]), np.array([-3.196653, -60.995803])
    a, b = 0.01 * MM * on_a / np.linalg.norm(on_a), 0.01 * MM * on_b / np.linalg.norm(on_b)
    tilt = (b - a) / 0.08
    # link 2's x, y, z are those of joint 3's frame before it turns; six decimals of F and M make 7e-6 of 61 N on B
    np.testing.assert_allclose(totals[chain.seat(2)], [*(a + b) / 2, 0, -tilt[1], tilt[0], 0], atol=3e-11)
    # no force along the axis: its play is taken up at random
    _, totals = evaluated(
        chain,
        PAPER_Q,
        [Clearance(joint="joint3", diametral=(0.0,), axial=0.1 * MM, span=0.08, band=1.0)],
        {"clearance[joint3].side": 0.3},
    )
    np.testing.assert_allclose(totals[chain.seat(2)], [0, 0, 0.015 * MM, 0, 0, 0], atol=1e-18)


def test_a_scattering_load_does_not_turn_the_shift():
    chain = one_link()
    payload = Payload(at="tool", mass=Normal(0.1, mean=2.0))
    source = Clearance(joint="hinge", diametral=(Uniform(0.01 * MM, mean=0.02 * MM),), span=0.1, band=1.0)
    for mass in (1.5, 2.0, 2.5):
        _, totals = evaluated(
            chain, [0.0], [payload, source], {"payload[tool].mass": mass, "clearance[hinge].diametral": 0.026 * MM}
        )
        np.testing.assert_allclose(totals[chain.seat(0)][:3], [-0.013 * MM, 0, 0], atol=1e-18)


def test_the_mean_load_decides_where_loads_are_random():
    """Twice the mass on this side on the mean, so that side counts, though in some samples the other one is heavier."""
    chain = one_link()
    loads = [Payload(at="tool", mass=Uniform(1.9, mean=2.0)), Payload(at="base", mass=50.0)]
    away = Payload(at="tool", mass=Uniform(0.9, mean=1.0), com=(-2.0, 0.0, 0.0))
    source = Clearance(joint="hinge", diametral=(0.02 * MM,), span=0.1, band=1.0)
    _, totals = evaluated(
        chain, [0.0], [*loads, away, source], {"payload[tool].mass": 0.1, "payload[tool]#2.mass": 1.9}
    )
    np.testing.assert_allclose(totals[chain.seat(0)][:3], [-0.01 * MM, 0, 0], atol=1e-18)


def test_gravity_off_leaves_the_random_directions():
    chain = one_link(mass=2.0, com=(0.4, 0, 0), gravity=(0.0, 0.0, 0.0))
    settings = {"joint": "hinge", "diametral": (0.02 * MM,), "axial": 0.1 * MM, "span": 0.1}
    by_load = ErrorModel(chain, Space(), [Clearance(band=1e-9, **settings)]).at([0.3])
    at_random = ErrorModel(chain, Space(), [Clearance(direction="random", **settings)]).at([0.3])
    x = by_load.space.sample(3, 0, 50)
    np.testing.assert_array_equal(by_load.exact(x), at_random.exact(x))
    np.testing.assert_array_equal(by_load.exact(by_load.space.mean[:, None]), np.zeros((6, 1)))


def test_no_play_no_error():
    at = ErrorModel(
        one_link(mass=2.0, com=(0.4, 0, 0)), Space(), [Clearance(joint="hinge", diametral=(0.0,), span=0.1, band=1e9)]
    ).at([0.3])
    np.testing.assert_array_equal(at.exact(at.space.sample(3, 0, 50)), np.zeros((6, 50)))


def test_journals_stay_in_contact_on_a_circle():
    chain = one_link(gravity=(0.0, 0.0, 0.0))
    source = Clearance(joint="hinge", diametral=(0.02 * MM,), span=0.1, direction="random")
    at = ErrorModel(chain, Space(), [source]).at([0.0])
    x = at.space.sample(3, 0, 200)
    # A is at the seat, and a tilt moves the tip, 1 m out along x, in z only
    np.testing.assert_allclose(np.hypot(*at.linear(x)[:2]), 0.01 * MM, rtol=1e-12)
    assert all(draw.scope is Scope.VISIT for draw in at.space.draws)


def test_in_equilibrium_the_load_hangs_straight_down_in_the_clearance():
    """A rigid arm of 1 m on a soft hinge turns by θ = C m g cos θ; the second hinge's journals then lie lowest."""
    chain = chain_of(
        robot(
            link("base"),
            joint("shoulder", "revolute", "base", "upper", axis=(0, 1, 0)),
            link("upper"),
            joint("wrist", "revolute", "upper", "hand", (1, 0, 0), axis=(0, 1, 0)),
            link("hand", 3.0, (0.0, 0.05, 0.0)),
        )
    )
    sources = [
        JointCompliance(joint="shoulder", compliance=5e-3),
        Clearance(joint="wrist", diametral=(2 * MM,), span=0.1, band=1.0),
    ]
    angle = 0.0
    for _ in range(200):
        angle = 5e-3 * 3.0 * 9.81 * np.cos(angle)
    at = ErrorModel(chain, Space(), sources, statics="equilibrium").at([0.0, 0.4])
    x = at.space.mean[:, None]
    expected = np.array([np.cos(angle) - 1, 0, -np.sin(angle) - 1 * MM, 0, angle, 0])
    np.testing.assert_allclose(at.exact(x)[:, 0], expected, atol=1e-12)
    # taken on the undeflected arm, the shift turns with the hinge
    at = ErrorModel(chain, Space(), sources).at([0.0, 0.4])
    angle = 5e-3 * 3.0 * 9.81
    turned = Rotation.from_rotvec([0, angle, 0]).apply([1, 0, -1 * MM]) - [1, 0, 0]
    np.testing.assert_allclose(at.exact(x)[:3, 0], turned, atol=1e-14)


def test_the_tangent_is_the_slope_of_the_displaced_chain():
    chain = one_link(mass=2.0, com=(0.4, 0.1, 0.05), axis=(0.6, 0, 0.8))
    source = Clearance(
        joint="hinge",
        diametral=(Uniform(0.1 * MM, mean=0.3 * MM), Uniform(0.1 * MM, mean=0.2 * MM)),
        span=0.1,
        band=70.0,
    )
    at = ErrorModel(chain, Space(), [source]).at([0.3])
    factors = {factor.name for term in at.terms for factor in term.factors}
    assert {name.rpartition("].")[2] for name in factors} == {"A.x", "A.y", "diametral", "diametral[1]"}  # B is decided
    for k in range(at.space.size):
        step = np.zeros(at.space.size)
        step[k] = 1e-3 if ".A." in at.space.components[k] or ".B." in at.space.components[k] else 1e-6
        ahead, behind = (at.exact((at.space.mean + sign * step)[:, None])[:, 0] for sign in (1, -1))
        np.testing.assert_allclose(at.jacobian[:, k], (ahead - behind) / (2 * step[k]), rtol=1e-5, atol=1e-9)


SHEET = """\
precision-pin: 1
robot: arm.urdf
gravity: {gravity}
poses:
  here: {{turn: 20 deg, slide: 150 mm}}
parameters:
  seat: {{triangular: 4 um, mean: 15 um}}
sources:
  - clearance: {{joint: turn, diametral: [seat, {{uniform: 5 um, mean: 0.01 mm}}], axial: 8 um, start: -40 mm, span: 8 cm,
      band: 2 N}}
  - clearance: {{joint: slide, diametral: 0.03 mm, span: 60 mm, direction: random, law: disc, scope: unit,
      pads_on: parent}}
"""


def sheet(tmp_path, gravity="earth", old="", new="") -> ErrorModel:
    return turn_and_slide(tmp_path, SHEET.format(gravity=gravity), old, new, tool=(0.1, 0, 0.05), rpy=(0.2, 0.1, 0.3))


def test_from_a_sheet_in_every_model(tmp_path):
    model = sheet(tmp_path)
    source, slide = model.sources
    assert (source.start, source.span, source.band, source.axial) == pytest.approx((-0.04, 0.08, 2.0, 8e-6), rel=1e-15)
    assert (slide.law, slide.scope, slide.pads_on, slide.diametral) == ("disc", "unit", "parent", (3e-5,))
    assert set(model.space.components) == {
        "seat",
        "clearance[turn].diametral[1]",
        *(f"clearance[turn].{name}" for name in ("A.x", "A.y", "B.x", "B.y", "side")),
        *(f"clearance[slide].{name}" for name in ("A.x", "A.y", "B.x", "B.y")),
    }
    at = model.at("here")
    x = model.space.sample(5, 0, 200)
    linear, exact = at.linear(x), at.exact(x)
    # shifts of 15 µm and turns of 0.5 mrad on an arm of 1 m: they differ to second order
    assert 1e-5 < np.abs(linear).max() < 1e-3
    np.testing.assert_allclose(linear, exact, atol=2e-7)
    error, jacobian = at.tangent
    np.testing.assert_allclose(error[:, None] + jacobian @ (x - model.space.mean[:, None]), exact, atol=2e-7)
    assert np.isfinite(at.covariance).all()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("band: 2 N", "band: 2 N*m", "band: 'N[*]m' in '2 N[*]m' is not a unit of force"),
        (",\n      band: 2 N", "", "needs band:, the load below which a direction is random"),
        ("band: 2 N", "band: 0 N", "the band of clearance must be positive, got 0.0 N"),
        ("span: 8 cm", "span: 0 mm", "the span of clearance must be positive, got 0.0 m"),
        ("law: disc", "law: square", "law: input should be 'circle' or 'disc'"),
        ("scope: unit", "scope: day", "scope: input should be 'unit', 'pose' or 'visit'"),
        ("diametral: 0.03 mm", "diametral: 0.03", "diametral: '0.03' has no unit"),
        ("diametral: 0.03 mm", "diametral: -0.03 mm", r"diametral of clearance\[slide\] can become negative"),
        ("diametral: 0.03 mm", "diametral: [1 um, 2 um, 3 um]", "needs one or two diametral:"),
        ("diametral: 0.03 mm", "diametral: {normal: 1 um}", r"diametral of clearance\[slide\] can become negative"),
        (
            "direction: random",
            "direction: random, axial: 3 um",
            "slide slides: give its play along the axis as backlash",
        ),
        ("direction: random", "direction: random, band: 3 N", "band: of clearance is used only with direction: load"),
        ("joint: turn", "joint: trun", "no joint on the chain named 'trun'; did you mean 'turn'"),
    ],
)
def test_bad_settings_of_a_sheet_give_one_line(tmp_path, old, new, message):
    with pytest.raises(SheetError, match=message) as caught:
        sheet(tmp_path, old=old, new=new)
    (finding,) = caught.value.findings
    assert 9 <= finding.line <= 12


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"diametral": 1e-5}, "diametral of clearance must be a list"),
        ({"diametral": ()}, "one or two diametral:"),
        ({"span": float("nan")}, "span of clearance must be positive"),
        ({"band": float("inf")}, "band of clearance must be positive"),
        ({"direction": "down"}, "direction of clearance must be one of load, random, got 'down'"),
        ({"law": "square"}, "law of clearance must be one of circle, disc"),
        ({"scope": "day"}, "scope of clearance must be one of unit, pose, visit"),
        ({"pads_on": "both"}, "pads_on of clearance must be one of child, parent"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Clearance(**{"joint": "hinge", "diametral": (1e-5,), "span": 0.1, "band": 1.0} | settings)


def test_an_unknown_joint_is_named_with_the_nearest():
    with pytest.raises(UnknownNameError, match="no joint on the chain named 'hinges'; did you mean 'hinge'"):
        ErrorModel(one_link(), Space(), [Clearance(joint="hinges", diametral=(1e-5,), span=0.1, band=1.0)]).at([0.0])


def test_two_on_one_joint_draw_apart():
    source = Clearance(joint="hinge", diametral=(1e-5,), span=0.1, direction="random")
    model = ErrorModel(one_link(), Space(), [source, source])
    assert len(set(model.space.components)) == 8


def test_bearings_nearer_than_numbers_tell_are_refused():
    """A slide 0.5 m out has its bearings at 0.5 m ± half the span."""
    slide = chain_of(robot(link("a"), joint("j", "prismatic", "a", "b", axis=(0, 0, 1)), link("b")))
    play = Clearance(joint="j", diametral=(0.02 * MM,), span=1e-14, direction="random", pads_on="child")
    assert np.isfinite(ErrorModel(slide, Space(), [play]).at([0.0]).jacobian).all()
    with pytest.raises(InputError, match=r"the span is too small: both bearings are at .* m along the axis"):
        ErrorModel(slide, Space(), [play]).at([0.5])
