"""Play and its side: at a pose with a direction of approach each robot's own load decides, without one the mean load."""

from typing import Any

import numpy as np
import pytest
from scipy import optimize
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from precision_pin import ErrorModel, Normal, Space, Uniform
from precision_pin.draws.expressions import signs_of
from precision_pin.kernel import sampler
from precision_pin.sources import Backlash, BearingStiffness, Clearance, JointCompliance, Levelling, Payload
from precision_pin.terms.term import JointValue, bounds_of
from support.checks.common import MM, Q7, evaluated, leaning_hand, one_link
from support.plain_robot import chain_of, joint, link, random_arm, robot

G = 9.81
NOTHING = np.zeros((0, 1))


def flank(model: ErrorModel, q: list[float], approach: Any) -> float:
    (term,) = (term for term in model.at(q, approach=approach).terms if term.target == JointValue(0))
    assert not term.factors  # no random number where all robots agree
    return float(term.twist[0])


@pytest.mark.parametrize(
    ("q", "band", "direction", "side"),
    [
        # 2 kg at 0.4 m turn the hinge by +7.848 N·m at 0 and by -7.848 N·m at π
        (0.0, 10.0, "+", -1),  # the drive pushes it up against friction: behind the drive
        (0.0, 10.0, "-", +1),
        (np.pi, 10.0, "+", -1),
        (0.0, 7.847, "+", +1),  # more load than friction: it runs ahead of the drive
        (0.0, 7.849, "+", -1),
        (np.pi, 7.847, "-", -1),
        (np.pi, 7.849, "-", +1),
    ],
)
def test_the_flank_by_hand(q: float, band: float, direction: str, side: int) -> None:
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    model = ErrorModel(chain, Space(), [Backlash(joint="hinge", backlash=3e-4, band=band)])
    assert flank(model, [q], {"hinge": direction}) == side * 1.5e-4


def test_a_slide_moved_up_and_down_and_one_whose_motion_is_not_known() -> None:
    chain = one_link("prismatic", mass=2.0, com=(0.4, 0, 0))  # 19.62 N down
    model = ErrorModel(chain, Space(), [Backlash(joint="hinge", backlash=2e-5, band=30.0)])
    assert [flank(model, [0.1], sign) for sign in ("hinge +", "hinge -")] == [-1e-5, 1e-5]
    heavy = ErrorModel(chain, Space(), [Backlash(joint="hinge", backlash=2e-5, band=10.0)])
    assert [flank(heavy, [0.1], sign) for sign in ("hinge +", "hinge -")] == [-1e-5, -1e-5]
    for one in (model, heavy):
        plain, unknown = (one.at([0.1], approach=approach).terms for approach in (None, {"hinge": 0}))
        assert [(term.twist.tolist(), term.factors) for term in plain] == [
            (term.twist.tolist(), term.factors) for term in unknown
        ]


def hinge_with_load(band: float = 98.0) -> ErrorModel:
    """Return a hinge with a load of 98.1 N·m ± 3.924 N·m (one standard deviation)."""
    loads = [Payload(at="tool", mass=Normal(0.4, mean=10.0))]
    source = Backlash(joint="hinge", backlash=1e-3, band=band)
    return ErrorModel(one_link(axis=(0, 1, 0)), Space(), [*loads, source])


@pytest.mark.parametrize("band", [94.0, 103.0])
def test_the_side_turns_over_with_the_scatter_of_the_load(band: float) -> None:
    model, count = hinge_with_load(band), 100_000
    mass = model.space.sample(3, 0, count)[model.space.index["payload[tool].mass"]]
    turned = sampler.errors(sampler.to_arrays(model.at([0.0], approach="hinge +")), "linear", 3, 0, count)[4]
    # each robot by its own load, and nothing between the flanks
    np.testing.assert_array_equal(turned, np.where(G * mass > band, 5e-4, -5e-4))
    expected = norm.cdf((10.0 * G - band) / (0.4 * G))
    assert abs((turned > 0).mean() - expected) < 5 * np.sqrt(expected * (1 - expected) / count)
    # without an approach the mean load decides: no robot turns over
    plain = sampler.errors(sampler.to_arrays(model.at([0.0])), "linear", 3, 0, 1000)[4]
    assert set(plain) <= {5e-4} if band < 98.1 else np.ptp(plain) > 5e-4


def test_without_an_approach_the_side_is_that_of_the_mean_load() -> None:
    """2 kg at 1 m against 1 kg at -1 m, though in some samples the other one is heavier: 9.81 N·m and 9.81 N·m."""
    loads = [
        Payload(at="tool", mass=Uniform(1.9, mean=2.0)),
        Payload(at="tool", mass=Uniform(0.9, mean=1.0), com=(-2.0, 0.0, 0.0)),
    ]
    lying, upright = one_link(axis=(0, 1, 0)), one_link()
    gap = Backlash(joint="hinge", backlash=1e-3, band=5.0)
    play = Clearance(joint="hinge", diametral=(Uniform(0.01 * MM, mean=0.02 * MM),), span=0.1, band=1.0)
    for one, other in ((0.1, 1.9), (2.0, 1.0), (3.9, 0.1)):
        masses = {"payload[tool].mass": one, "payload[tool]#2.mass": other}
        _, totals = evaluated(lying, [0.0], [*loads, gap], masses)
        np.testing.assert_array_equal(totals[JointValue(0)], [5e-4])
        _, totals = evaluated(upright, [0.0], [*loads, play], masses | {"clearance[hinge].diametral": 0.026 * MM})
        np.testing.assert_allclose(totals[upright.seat(0)][:3], [-0.013 * MM, 0, 0], atol=1e-18)


def arm_with_loads() -> ErrorModel:
    chain = chain_of(random_arm(14, prismatic=(5,)), tip="tool", gravity=(1.0, -2.0, -9.0))
    torque = chain.at(Q7).load_torque
    loads = [
        Payload(at="tool", mass=Normal(0.3, mean=3.0), com=(Uniform(0.05), Uniform(0.05, mean=0.1), 0.02)),
        Payload(at="link3", mass=Uniform(0.4, mean=1.0)),
        Levelling(rx=Normal(0.01), ry=Normal(0.01)),
    ]
    plays = [
        Backlash(joint=name, backlash=1e-3, band=abs(share) + 0.1)
        for name, share in zip(chain.joint_names, torque, strict=True)
    ]
    bearings = [
        Clearance(joint=name, diametral=(1e-4, 2e-4), span=0.1, start=-0.02, band=60.0, axial=0.0 if k == 4 else 5e-5)
        for k, name in enumerate(chain.joint_names)
    ]
    soft = [JointCompliance(joint=name, compliance=1e-6) for name in chain.joint_names]
    return ErrorModel(chain, Space(), [*loads, *plays, *bearings, *soft], {"here": list(Q7)})


@pytest.mark.slow
def test_the_compiled_sampler_against_numpy() -> None:
    model = arm_with_loads()
    at = model.at("here", approach=[1, -1, 1, -1, 1, -1, 1])
    assert sum(bool(signs_of(term.factors)) for term in at.terms) > 7  # backlash and bearings
    x = model.space.sample(1, 0, 1500)
    layout = sampler.to_arrays(at)
    # the product of poses rounds alike with and without an approach
    np.testing.assert_allclose(sampler.errors(layout, "exact", 1, 0, 1500), at.exact(x), rtol=0, atol=2e-14)
    np.testing.assert_allclose(sampler.errors(layout, "linear", 1, 0, 1500), at.linear(x), rtol=0, atol=1e-17)


def test_the_play_of_a_bearing_follows_the_load_of_each_robot() -> None:
    """A beam on two supports by hand: loads at 30 mm and -40 mm beside a shaft whose bearings are at ±50 mm."""
    chain = one_link(axis=(0, 1, 0))
    band, half = 5.0, 5e-5
    loads = [
        Payload(at="tool", mass=Uniform(2.5, mean=4.0), com=(0.0, 0.15, 0.0)),
        Payload(at="tool", mass=Uniform(1.5, mean=2.0), com=(0.0, -0.20, 0.0)),
    ]
    source = Clearance(joint="hinge", diametral=(2 * half,), span=0.1, start=-0.05, band=band)
    model = ErrorModel(chain, Space(), [*loads, source])
    x = model.space.sample(2, 0, 20_000)
    one, other = x[:2]
    on_b = -G * (one * (0.15 + 0.05) + other * (-0.20 + 0.05)) / 0.1
    on_a = -G * (one + other) - on_b
    held = (np.abs(on_a) >= band) & (np.abs(on_b) >= band)
    assert 0.05 < (on_b > 0).mean() < 0.95
    assert 0.01 < (~held).mean() < 0.5
    a, b = half * np.sign(on_a), half * np.sign(on_b)
    errors = model.at([0.0], approach="hinge +").linear(x)
    np.testing.assert_allclose(errors[2, held], ((a + b) / 2)[held], rtol=0, atol=1e-16)
    np.testing.assert_allclose(errors[3, held], ((b - a) / 0.1)[held], rtol=0, atol=1e-15)
    # the others lie in a random direction, in contact: B's shift alone where only that bearing is loose
    loose = (np.abs(on_a) >= band) & (np.abs(on_b) < band)
    seat = errors[:3, loose] - np.stack([0 * a[loose], errors[5, loose], 0 * a[loose]])  # the tip is 1 m away along x
    shift = seat + 0.05 * np.stack([-errors[5, loose], 0 * a[loose], errors[3, loose]])
    np.testing.assert_allclose(np.linalg.norm(shift, axis=0), half, rtol=1e-9)
    assert np.abs(shift[0]).max() > 0.5 * half
    # the direction of the approach does not matter, that there is one does
    np.testing.assert_array_equal(errors, model.at([0.0], approach="hinge -").linear(x))
    assert np.ptp(model.at([0.0]).linear(x)[3]) < np.ptp(errors[3])


@pytest.mark.parametrize("approach", [None, "wrist +"])
def test_equilibrium_takes_the_load_on_the_deflected_arm(approach: str | None) -> None:
    """A hand that leans back by 10 mrad falls forwards on an arm that droops by 50 mrad, if friction lets it."""
    chain, load = leaning_hand()
    # 2.1 kg at 0.3 m: -0.062 N·m undeflected, +0.247 N·m deflected, of a robot of mean load
    sources = [
        Payload(at="hand", mass=Uniform(0.05, mean=0.1), com=(0.0, 0.0, 0.3)),
        JointCompliance(joint="shoulder", compliance=0.05 / load),
        Backlash(joint="wrist", backlash=1e-3, band=0.1 if approach else 0.01),
    ]
    found = {}
    for statics in ("nominal", "equilibrium"):
        model = ErrorModel(chain, Space(), sources, statics=statics)
        at = model.at([0.0, -0.010], approach=approach)
        (term,) = (term for term in at.terms if term.target == JointValue(1))
        displaced = at.table.displacements(at.table.products(at.table.program.evaluate(model.space.mean[:, None])))
        index = [target == JointValue(1) for target in at.table.targets].index(True)
        found[statics] = float(displaced[index, 4, 0])
        assert not term.loaded
    assert found == {"nominal": -5e-4, "equilibrium": 5e-4}


@pytest.mark.slow
def test_equilibrium_says_where_single_robots_lie_otherwise() -> None:
    """The lever of the hand about the wrist is that of the droop, which differs from robot to robot."""
    chain, load = leaning_hand()

    def found(mean: float, compliance: float) -> list[str]:
        sources = [
            Payload(at="hand", mass=Uniform(2.0, mean=3.0), com=(0.0, 0.0, 0.3)),
            JointCompliance(joint="shoulder", compliance=compliance),
            Backlash(joint="wrist", backlash=1e-3, band=mean),
        ]
        model = ErrorModel(chain, Space(), sources, statics="equilibrium")
        return [finding.code for finding in model.statics_findings(model.at([0.0, -0.01], approach="wrist +"))]

    assert found(0.6, 0.05 / load) == ["W_TURNOVER"]
    assert found(10.0, 0.05 / load) == []  # friction holds every robot
    assert found(0.6, 1e-7) == []  # an arm that hardly bends


def test_in_equilibrium_the_load_hangs_straight_down_in_the_clearance():
    """A rigid arm of 1 m on a soft hinge turns by θ = C m g cos θ; the second hinge's journals then lie lowest."""
    shoulder = joint("shoulder", "revolute", "base", "upper", axis=(0, 1, 0))
    wrist = joint("wrist", "revolute", "upper", "hand", (1, 0, 0), axis=(0, 1, 0))
    chain = chain_of(robot(link("base"), shoulder, link("upper"), wrist, link("hand", 3.0, (0.0, 0.05, 0.0))))
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


def test_equilibrium_of_an_arm_on_a_tilting_bearing():
    """A rigid arm of 1 m with 30 kg at its end on an upright hinge: k θ = m g cos θ, and the axial spring by m g/k."""
    chain = one_link()
    sources = [Payload(at="tool", mass=30.0), BearingStiffness(joint="hinge", axial=1e5, tilt=4e3)]
    weight = 30.0 * 9.81
    angle = optimize.brentq(lambda turn: 4e3 * turn - weight * np.cos(turn), 0, 1, xtol=1e-15)
    at = ErrorModel(chain, Space(), sources, statics="equilibrium").at([0.0])
    expected = [np.cos(angle) - 1, 0, -np.sin(angle) - weight / 1e5, 0, angle, 0]
    np.testing.assert_allclose(at.exact(NOTHING)[:, 0], expected, atol=1e-11)


def test_bounds_of_a_load_hold_all_robots() -> None:
    model = arm_with_loads()
    posture, x = model.at("here").posture, model.space.sample(9, 0, 2000)
    for number in range(7):
        load = posture.torque_on(number)
        low, high = bounds_of(load, model.space)
        index = model.space.index
        total = sum(
            value * np.prod([x[index[factor.name]] for factor in factors], axis=0) for factors, value in load.items()
        )
        assert low <= np.min(total) <= np.max(total) <= high
