"""Gears whose stiffness has pieces: the maker's example, laws across a limit, whole arms at rest, hysteresis."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate, stats

import precision_pin as pp
from precision_pin.model.compliance import compliances_of
from precision_pin.sources import Backlash, Force, Payload, Servo, Transmission
from sources.test_force import planar
from support.checks.common import one_link

# strain wave gear of size 32 (manual 1018856 of Harmonic Drive, 08/2018, p. 42)
K, T = (67000.0, 110000.0, 120000.0), (29.0, 108.0)
ARC_MINUTE = np.pi / 180 / 60


def wind_up(torque, stiffness=K, limits=T):
    """Return the torsion by the integral of the flexibility from no torque on."""
    flexibility = lambda t: 1 / stiffness[int(np.searchsorted(limits, abs(t)))]  # noqa: E731
    points = [sign * limit for limit in limits for sign in (1, -1) if abs(torque) > limit and sign * torque > 0]
    return integrate.quad(flexibility, 0, torque, points=points or None)[0]


def turned(gear, torque):
    chain = one_link(axis=(0, 1, 0), gravity=(0.0, 0.0, 0.0))
    load = Force(at="tool", moment=(0.0, torque, 0.0))
    return pp.ErrorModel(chain, pp.Space(), [gear, load]).at([0.0])


@pytest.mark.parametrize("torque", [0.0, 10.0, -29.0, 60.0, -60.0, 150.0, -400.0])
def test_pieces_are_the_integral_of_the_flexibility(torque):
    at = turned(Transmission(joint="hinge", stiffness=K, limit_torques=T), torque)
    assert_allclose(at.error_at_means[4], wind_up(torque), rtol=1e-10, atol=1e-18)


def test_the_makers_example():
    at = turned(Transmission(joint="hinge", stiffness=K, limit_torques=T), 60.0)
    assert round(float(at.error_at_means[4]), 6) == 7.15e-4


@pytest.mark.parametrize(
    ("torque", "minutes"),
    [(5.0, 0.20226537216828477), (12.36, 0.5), (412.0, 4.20037037037037), (-100.0, -1.3114814814814815)],
)
def test_lost_motion_is_a_soft_first_piece(torque, minutes):
    gear = Transmission(joint="hinge", lost_motion=ARC_MINUTE, rated_torque=412.0, stiffness=108.0 / ARC_MINUTE)
    assert_allclose(turned(gear, torque).error_at_means[4], minutes * ARC_MINUTE, rtol=1e-10)


@pytest.mark.parametrize("torque", [pp.Normal(12.0, mean=40.0), pp.Uniform(50.0), pp.Normal(30.0, mean=-100.0)])
def test_every_robot_has_the_piece_of_its_torque(torque):
    at = turned(Transmission(joint="hinge", stiffness=K, limit_torques=T, stiffness_factor=pp.Uniform(0.1)), torque)
    x = at.space.sample(3, 0, 300)
    factor, torques = (
        x[at.space.index["transmission[hinge].stiffness_factor"]],
        x[at.space.index["force[tool].moment[1]"]],
    )
    expected = [wind_up(one) / (1 + f) for one, f in zip(torques, factor, strict=True)]
    assert_allclose(at.exact(x)[4], expected, rtol=1e-9, atol=1e-15)
    assert_allclose(at.linear(x)[4], expected, rtol=1e-9, atol=1e-15)
    # the derivative at a torque that is on no limit is the flexibility there
    step = 1e-3 * np.eye(at.space.size)[at.space.index["force[tool].moment[1]"]]
    start = x[:, 0]
    slope = at.jacobian_at(start, at.exact(start[:, None])[:, 0])[4, at.space.index["force[tool].moment[1]"]]
    difference = (at.exact((start + step)[:, None]) - at.exact((start - step)[:, None]))[4, 0] / 2e-3
    assert_allclose(slope, difference, rtol=1e-6)


def test_a_law_across_a_limit():
    # a payload of 5 kg, standard deviation 1.5 kg, on 0.5 m of 3 kg: the turn is a function of one normal number
    def moment(power, ends):
        share = stats.norm.cdf(ends) - stats.norm.cdf(-ends)
        turn = lambda z: wind_up(9.81 * (0.75 + 0.5 * (5 + 1.5 * z)))  # noqa: E731
        return integrate.quad(lambda z: turn(z) ** power * stats.norm.pdf(z) / share, -ends, ends, limit=400)[0]

    # of an independent code, by quadrature
    assert_allclose(moment(1, 8), 0.44902613642110145e-3, rtol=1e-6)
    mean, std, count = moment(1, 3), np.sqrt(moment(2, 3) - moment(1, 3) ** 2), 100_000
    gear = Transmission(joint="hinge", stiffness=K, limit_torques=T)
    payload = Payload(at="tool", mass=pp.TruncatedNormal(1.5, mean=5.0))
    model = pp.ErrorModel(
        one_link(axis=(0, 1, 0), length=0.5, mass=3.0, com=(0.25, 0.0, 0.0)), pp.Space(), [gear, payload]
    )
    turns = model.at([0.0]).exact(model.space.sample(2, 0, count))[4]
    assert abs(turns.mean() - mean) < 3 * std / np.sqrt(count)
    assert abs(turns.std() - std) < 3 * std / np.sqrt(count)


NOMINAL = np.array(
    [
        [5.877424444e-07, 0.0, 3.895266263e-08, 0.0, -1.379753417e-06, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3.895266263e-08, 0.0, 1.219516962e-05, 0.0, -1.600773652e-05, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-1.379753417e-06, 0.0, -1.600773652e-05, 0.0, 2.401628223e-05, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)
UNLOADED = np.array(
    [
        [6.848186003e-07, 0.0, -7.057033367e-07, 0.0, -6.271663183e-07, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-7.057033367e-07, 0.0, 1.790730925e-05, 0.0, -2.178071437e-05, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-6.271663183e-07, 0.0, -2.178071437e-05, 0.0, 2.985074627e-05, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)


def test_a_compliance_is_that_of_the_pieces_at_the_load():
    gears = [Transmission(joint=f"j{k}", stiffness=K, limit_torques=T) for k in (1, 2)]
    q = np.radians([30, -50])
    loaded = pp.ErrorModel(planar(2), pp.Space(), [*gears, Payload(at="tool", mass=4.0)])
    assert_allclose(sum(compliances_of(loaded, q).values()), NOMINAL, rtol=1e-9, atol=1e-20)
    alone = pp.ErrorModel(planar(2, (0, 0, 0)), pp.Space(), gears)
    assert_allclose(sum(compliances_of(alone, q).values()), UNLOADED, rtol=1e-9, atol=1e-20)


# UR5 with gears of both sizes, half widths of 0.5 and 0.75 arcmin, 3 kg 0.1 m before the flange; by an independent code
WHOLE = {
    ("nominal", 1): [0.0001199647543, -5.6665877e-05, -0.0004494031726, -0.0006462118107, 0.0006832720427, 7.28218357e-05],
    ("equilibrium", 1): [0.0001200441923, -5.66061352e-05, -0.0004493998121, -0.0006458132318, 0.00068287391, 7.282170952e-05],
    ("nominal", -1): [-2.320767733e-05, 0.0001125246513, -0.0008126951801, -0.0007778397409, 0.001782887297, -7.293287656e-05],
    ("equilibrium", -1): [-2.30438074e-05, 0.0001126053975, -0.0008126316842, -0.0007773474578, 0.001781742664, -7.29326004e-05],
    ("nominal", 0): [4.841177196e-05, 2.795054957e-05, -0.0006310604916, -0.000711925786, 0.001233091633, 1.365360133e-16],
    ("equilibrium", 0): [4.853341128e-05, 2.802077807e-05, -0.0006310270652, -0.0007114804616, 0.001232320308, 7.696321304e-17],
}  # fmt: skip


@pytest.mark.parametrize(("statics", "side"), WHOLE)
def test_a_whole_arm_with_gears_and_hysteresis(statics, side):
    chain = pp.Chain.from_urdf("example:ur5", tip="tool0", gravity=(0.0, 0.0, -9.81))
    small = ((8000.0, 12000.0, 15000.0), (4.0, 14.0))
    sources = [Payload(at="tool0", mass=3.0, com=(0.0, 0.0, 0.1))]
    for k, name in enumerate(chain.joint_names):
        stiffness, limits = (K, T) if k < 3 else small
        loss = (1.0 if k < 3 else 1.5) * ARC_MINUTE * abs(side)
        sources.append(Transmission(joint=name, stiffness=stiffness, limit_torques=limits, hysteresis_loss=loss))
    at = pp.ErrorModel(chain, pp.Space(), sources, statics=statics).at(
        np.radians([30, -70, 80, -100, -90, 20]), approach=dict.fromkeys(chain.joint_names, side) if side else None
    )
    assert_allclose(at.error_at_means, WHOLE[statics, side], rtol=0, atol=1e-9)


def test_servo_and_hysteresis_of_a_joint_arrive_alike():
    # τ = 20 N·m, one friction of 13 N·m as the motor feels it, the gear trails by half an arc minute besides
    sources = [
        Servo(joint="hinge", stiffness=20000.0, friction=13.0),
        Transmission(joint="hinge", stiffness=K, limit_torques=T, hysteresis_loss=ARC_MINUTE),
        Force(at="tool", moment=(0.0, 20.0, 0.0)),
    ]
    model = pp.ErrorModel(one_link(axis=(0, 1, 0), gravity=(0.0, 0.0, 0.0)), pp.Space(), sources)
    for side, turn in ((1, 0.0005030633583537064), (-1, 0.002093951567019428)):
        assert_allclose(model.at([0.0], approach={"hinge": side}).error_at_means[4], turn, rtol=1e-12)
    assert [draw.name for draw in model.space.draws] == ["approach[hinge]"]
    x = model.space.sample(0, 0, 50)
    half = (0.002093951567019428 - 0.0005030633583537064) / 2
    assert_allclose(model.at([0.0]).exact(x)[4], (0.002093951567019428 + 0.0005030633583537064) / 2 - half * x[0])


@pytest.mark.parametrize(
    "other",
    [Servo(joint="hinge", stiffness=20000.0, friction=13.0), Transmission(joint="hinge", hysteresis_loss=1.3e-3)],
)
def test_play_lies_on_the_flank_to_which_servo_or_hysteresis_of_the_joint_arrived(other):
    # 13/20000 or 1.3e-3/2, and half of the gap besides, all against one motion
    def model(**settings):
        gap = Backlash(joint="hinge", backlash=3e-4, band=13.0, **settings)
        load = Force(at="tool", moment=(0.0, 8.0, 0.0))
        return pp.ErrorModel(one_link(axis=(0, 1, 0), gravity=(0.0, 0.0, 0.0)), pp.Space(), [other, gap, load])

    start = 8.0 / 20000.0 if isinstance(other, Servo) else 0.0
    for side in (1, -1):
        turned_to = model().at([0.0], approach={"hinge": side}).error_at_means[4]
        assert_allclose(turned_to, start - side * (6.5e-4 + 1.5e-4), rtol=1e-12)
    # only a side that a unit keeps is drawn besides, which changes no other number
    assert model().space.components == ("approach[hinge]",)
    of_unit = model(scope="unit")
    x = of_unit.space.sample(0, 0, 50)
    arrived, lies = (x[of_unit.space.index[name]] for name in ("approach[hinge]", "backlash[hinge].side"))
    assert np.array_equal(model().space.sample(0, 0, 50), arrived[None])
    turned = model().at([0.0]).exact(arrived[None])[4]
    assert_allclose(turned, start - (6.5e-4 + 1.5e-4) * arrived, rtol=1e-9, atol=1e-16)
    # it is no matter of a visit's arrival
    expected = start - 6.5e-4 * arrived + 1.5e-4 * lies
    assert_allclose(of_unit.at([0.0]).exact(x)[4], expected, rtol=1e-9, atol=1e-16)
