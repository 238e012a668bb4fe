"""Tolerances of zero, the order of sources, where the base stands, how a link is cut: what must not matter."""

import numpy as np
import pytest

from precision_pin import Chain, Draw, ErrorModel, InputError, Normal, Source, Space, Uniform
from precision_pin import sources as kinds
from precision_pin.draws.expressions import Component
from precision_pin.model.pose_model import PoseModel
from precision_pin.sheet import read
from precision_pin.terms.term import JointValue, Term, at_means
from support.checks.common import Q7, one_link
from support.checks.places import rows
from support.engines import check_no_spread, written
from support.oracles import value_of
from support.plain_robot import PlainRobot, chain_of, joint, link, random_arm
from support.sheets import SEVEN_Q, loads

GRAVITY = (0.5, -1.0, -9.0)
K = Draw("k", Uniform(1e6, mean=5e6))
SIX = ("x", "y", "z", "rx", "ry", "rz")
RANDOM = Uniform(2.0, mean=3.0)
ZERO = {
    "backlash": [{"backlash": 0.0, "band": 1e9}],
    "bearing_stiffness": [{"radial": RANDOM, "axial": RANDOM, "tilt": RANDOM}],
    "clearance": [{"diametral": (0.0,), "span": 0.1, "band": 1e9}],
    "covariance": [{"std": (0.0,) * 6, "mean": (1e-3, 0.0, 0.0, 0.0, 1e-3, 0.0)}],
    "encoder": [
        {"resolution": 0.0, "offset": 0.0, "amplitude": 0.0},
        {"resolution": 0.0, "offset": 0.0, "amplitude": 0.0, "period": 1e-3, "scale": 0.0},
        {"eccentricity": 1e-5, "radius": 0.02, "heads": 2},
    ],
    "levelling": [{"rx": RANDOM, "ry": RANDOM, "rz": RANDOM}],
    "mounting": [
        {"at": "base"} | dict.fromkeys(SIX, Normal(0.0)),
        {"at": "tool", "flange": "arm"} | dict.fromkeys(SIX, Normal(0.0)),
    ],
    "thermal": [
        {"expansion": 0.0, "temperature_change": RANDOM, "gradient": RANDOM, "across": "z of hinge"},
        {"expansion": RANDOM, "temperature_change": 0.0, "gradient": 0.0, "across": "z of hinge"},
    ],
    "transmission": [
        {"stiffness": RANDOM},
        {"amplitude": (0.0, 0.0), "order": (1.0, 2.0), "period": 0.01, "lead_error": 0.0, "stiffness": RANDOM},
    ],
}
"""By kind, settings without a tolerance, or without an effect where there is no weight."""


@pytest.mark.parametrize("kind", ZERO)
def test_no_tolerance_or_no_weight_no_spread(kind):
    for settings in ZERO[kind]:
        own = {} if kind in ("levelling", "mounting", "thermal") else {"joint": "hinge"}
        chain = one_link(
            "prismatic" if "period" in settings else "revolute", gravity=(0, 0, 0), mass=2.0, com=(0.4, 0, 0)
        )
        flexible = kinds.JointCompliance(joint="hinge", compliance=1e-4)
        model = ErrorModel(chain, Space(), [flexible, kinds.catalogue()[kind](**own, **settings)])
        check_no_spread(model, [0.2])
        if "stiffness" in kind or "stiffness" in settings:
            np.testing.assert_array_equal(model.at([0.2]).exact(model.space.mean[:, None]), np.zeros((6, 1)))


def test_one_measured_row_is_no_spread(tmp_path):
    (tmp_path / "one.csv").write_text("x [mm]\n0.3\n", encoding="utf-8")
    model = ErrorModel(one_link(), Space(), [kinds.Table(joint="hinge", file=tmp_path / "one.csv")])
    check_no_spread(model, [0.2])
    assert model.at([0.0]).exact(model.space.mean[:, None])[0, 0] == pytest.approx(0.3e-3, rel=1e-12)


def test_a_direction_that_does_not_vary():
    """Measured in a plane: rank 3, fully correlated."""
    correlation = np.eye(6)
    correlation[0, 5] = correlation[5, 0] = 1.0
    source = kinds.Covariance(joint="hinge", std=(1e-4, 1e-4, 0.0, 0.0, 0.0, 1e-3), correlation=rows(correlation))
    model = ErrorModel(one_link(), Space(), [source])
    x = model.space.sample(1, 0, 50)
    np.testing.assert_allclose(x[0] / 1e-4, x[5] / 1e-3, rtol=1e-12)
    np.testing.assert_array_equal(x[2:5], np.zeros((3, 50)))


@pytest.mark.slow
def test_the_order_of_tilts_and_loads_does_not_matter_and_a_mounting_is_no_tilt():
    chain = chain_of(random_arm(43, prismatic=(4,)), tip="tool")
    space, laden = loads()
    plain = ErrorModel(chain, space, laden).at(Q7)
    for still in (kinds.Levelling(), kinds.Mounting(at="base", rx=0.1, ry=0.2)):
        level = ErrorModel(chain, space, [still, *laden]).at(Q7)
        assert level.posture.tilts == ()
        loaded = [term for term in level.terms if term.loaded]
        for one, two in zip((term for term in plain.terms if term.loaded), loaded, strict=True):
            np.testing.assert_array_equal(one.twist, two.twist)
            assert one.factors == two.factors
    tilts = [kinds.Levelling(rx=Normal(1e-3), rz=0.02), kinds.Levelling(ry=Uniform(1e-3))]
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
    a, b, c, d = (Component(name) for name in "abcd")
    term = Term.of(JointValue(0), 2.0, a, b, 3.0, c, d)
    assert term.factors == (a * b, c, d)
    np.testing.assert_array_equal(term.twist, [6.0])
    five = Term.of(JointValue(0), 1.0, a, b, c, d, a)
    values = {"a": 2.0, "b": 3.0, "c": 5.0, "d": 7.0}
    assert len(five.factors) == 3
    assert np.prod([value_of(factor, values) for factor in five.factors]) == 2 * 3 * 5 * 7 * 2


def test_the_gradient_of_the_whole_arm_bends_every_link():
    chain = chain_of(random_arm(33, prismatic=(2,)), tip="tool")
    settings = {"expansion": 12e-6, "gradient": 3.0, "across": "y of joint3"}
    links = [kinds.Thermal(link=name, **settings) for name in ("base", *(f"link{k}" for k in range(1, 8)))]
    none = np.zeros((0, 1))
    whole, single = (ErrorModel(chain, Space(), of).at(Q7).exact(none) for of in ([kinds.Thermal(**settings)], links))
    np.testing.assert_allclose(single, whole, rtol=0, atol=1e-15)


# --- bearings and drives ---


def on_every_joint(chain: Chain) -> list[Source]:
    sources: list[Source] = [
        kinds.Payload(at="tool", mass=Uniform(0.5, mean=2.0), com=(Normal(0.01), 0.0, 0.1)),
        kinds.Beam(link="link3", EI=5e4, GI=4e4),
    ]
    for slides, name in zip(chain.prismatic, chain.joint_names, strict=True):
        free = {"roll": 1e4} if slides else {"axial": 2.0 * Component("k")}
        play = {} if slides else {"axial": Uniform(1e-5, mean=3e-5)}
        sources += [
            kinds.BearingStiffness(joint=name, radial="k", tilt=Uniform(1e3, mean=1e4), centre=0.03, **free),
            kinds.Clearance(
                joint=name, diametral=(Uniform(1e-5, mean=4e-5), 3e-5), span=0.1, start=-0.02, band=40.0, **play
            ),
            kinds.Backlash(joint=name, backlash=Uniform(1e-4, mean=3e-4), band=4.0),
        ]
    return sources


def in_tool_axes(at: PoseModel, engine: str, x) -> np.ndarray:
    tool = at.posture.pose[:3, :3].T
    error = getattr(at, engine)(x)
    return np.concatenate([tool @ error[:3], tool @ error[3:]])


@pytest.mark.slow
@pytest.mark.parametrize("statics", ["nominal", "equilibrium"])
def test_where_the_base_stands_and_in_what_order_sources_do_not_matter(statics):
    text = random_arm(51, joints=4, prismatic=(4,))
    mount = joint("mount", "fixed", "ground", "base", (0, 0, 0), (0.3, -0.4, 1.2))
    turned = text.replace('<robot name="arm">', f'<robot name="arm">{link("ground")}{mount}')
    rotation = PlainRobot.parse(turned).poses({})["base"][:3, :3]
    straight = chain_of(text, tip="tool", gravity=GRAVITY)
    tilted = chain_of(turned, tip="tool", gravity=tuple(rotation @ GRAVITY))
    sources = on_every_joint(straight)
    one = ErrorModel(straight, Space((K,)), sources, statics=statics)
    at = one.at(SEVEN_Q[:4])
    sided = {factor.name for term in at.terms for factor in term.factors if isinstance(factor, Component)}
    # some bearings and drives are decided and some are not
    assert 1 < sum(name.endswith((".A.x", ".B.x", ".side")) for name in sided) < 12
    x = one.space.sample(4, 0, 5)
    expected = {engine: in_tool_axes(at, engine, x) for engine in ("exact", "linear")}
    shuffled = [sources[k] for k in np.random.default_rng(1).permutation(len(sources))]
    other = ErrorModel(tilted, Space((K,)), shuffled, statics=statics)
    rows = [one.space.index[name] for name in other.space.components]
    there = other.at(SEVEN_Q[:4])
    for engine, same in expected.items():
        np.testing.assert_allclose(in_tool_axes(there, engine, x[rows]), same, rtol=0, atol=1e-12)


def test_numbers_at_the_means_of_their_factors():
    space = Space((K, Draw("m", Uniform(1.0, mean=2.0)), Draw("w", Normal(0.1, mean=-0.5))))
    k, m, w = (space.parameter(name) for name in ("k", "m", "w"))
    wrench = np.arange(1.0, 7.0)
    values = {(): wrench, (m,): 10 * wrench, (m, w): 100 * wrench, (m, m / k, w): -1e6 * wrench}
    # 1 + 10·2 + 100·2·(-0.5) - 1e6·2·(2/5e6)·(-0.5)
    np.testing.assert_allclose(at_means(values, space), (1 + 20 - 100 + 0.4) * wrench, rtol=1e-14)
    assert at_means({}, space) == 0.0
    with pytest.raises(InputError, match="formula"):
        at_means({(1 / (k - 5e6),): 1.0}, space)


# --- periodic errors about zero ---


@pytest.mark.parametrize(
    ("kind", "settings", "what"),
    [
        ("transmission", "amplitude: {normal: 30 arcsec}, order: 200", "amplitude"),
        ("encoder", "amplitude: {uniform: 30 arcsec}", "amplitude"),
        ("encoder", "eccentricity: {normal: 5 um}, radius: 20 mm", "eccentricity"),
        ("transmission", "amplitude: [30 arcsec, {triangular: 9 arcsec}], order: [1, 2]", "amplitude[1]"),
        ("transmission", "amplitude: {normal: 30 arcsec, mean: 31 arcsec}, order: 200", ""),
        ("transmission", "amplitude: {fixed: 0 arcsec}, order: 200", ""),
        ("encoder", "offset: {normal: 30 arcsec}, resolution: 10 arcsec", ""),
    ],
)
def test_an_amplitude_about_zero_is_warned_of_at_its_line(tmp_path, kind, settings, what):
    line = f"{kind}: {{joint: joint2, {settings}}}"
    file = written(tmp_path, f"joint_offset: {{joint: joint1, offset: {{normal: 0.01 deg}}}}\n{line}")
    found = [finding for finding in read(file).findings if finding.code == "W_AMPLITUDE"]
    assert len(found) == bool(what)
    for finding in found:
        assert finding.severity == "warning"
        assert finding.message.startswith(f"{what} of {kind}[joint2] varies about zero")
        assert line[:12] in file.read_text(encoding="utf-8").splitlines()[finding.line - 1]
