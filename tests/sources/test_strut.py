"""Springs, gas springs and cables between links: closed forms, arms solved by their energy, and dead forces at rest."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import root

import precision_pin as pp
from precision_pin.base import se3
from precision_pin.draws.laws import Normal
from precision_pin.sources import Beam, BearingStiffness, Force, JointCompliance, Payload, Servo
from precision_pin.sources.strut import Strut, StrutEnd
from sources.test_force import LINKS, STIFFNESS, G, planar, soft
from support.checks.common import one_link
from support.engines import check_engines, written
from support.plain_robot import PlainRobot, chain_of, derivative, random_arm

A, B = (-0.1, 0.0, -0.2), (0.1, 0.0, -0.05)
Q = np.radians([30.0, -50.0])


def strut(start=("base", A), stop=("link2", B), **settings):
    ends = [StrutEnd(link=link, point=point) for link, point in (start, stop)]
    return Strut(from_=ends[0], to=ends[1], **settings)


def at_rest(push, rate, at_length, start="base"):
    """Return tip error ``(x, z, turn about y)`` and length of the strut of the 2R arm where its energy does not change."""
    (first, second), stiffness = np.array(LINKS[2]), np.array(STIFFNESS[2])

    def places(angles):
        along = np.cumsum(angles)
        x, z = np.array([np.cos(along), np.sin(along)]), np.array([-np.sin(along), np.cos(along)])
        elbow = first[0] * x[:, 0]
        lower = np.array([A[0], A[2]]) if start == "base" else A[0] * x[:, 0] + A[2] * z[:, 0]
        return elbow, elbow + second[0] * x[:, 1], lower, elbow + B[0] * x[:, 1] + B[2] * z[:, 1]

    def torques(angles):
        # -dV/dq by complex steps: exact to rounding
        result = np.zeros(2)
        for k in range(2):
            elbow, tip, lower, upper = places(angles + 1e-30j * np.eye(2)[k])
            length = np.sqrt(((upper - lower) ** 2).sum())
            height = first[1] * elbow[1] / 2 + second[1] * (elbow[1] + tip[1]) / 2
            energy = G * height - push * (length - at_length) + rate * (length - at_length) ** 2 / 2
            result[k] = -energy.imag / 1e-30
        return result

    shift = root(lambda shift: stiffness * shift - torques(Q + shift), np.zeros(2), tol=1e-14).x
    before, after = places(Q), places(Q + shift)
    return np.array([*(after[1] - before[1]), -shift.sum()]), float(np.linalg.norm(after[3] - after[2]))


def test_a_spring_of_no_free_length_balances_a_weight_at_every_angle():
    rate, height, reach = 800.0, 0.3, 0.4
    chain = one_link(axis=(0, -1, 0), mass=2.0, com=(0.5, 0.0, 0.0), gravity=(0.0, 0.0, 0.0))
    spring = strut(("base", (0.0, 0.0, height)), ("arm", (reach, 0.0, 0.0)), rate=rate, free_length=0.0)
    for angle in np.linspace(-3.0, 3.0, 13):
        torque = rate * height * reach * np.cos(angle)
        for drive in (JointCompliance(joint="hinge", compliance=1e-6), Servo(joint="hinge", stiffness=1e6)):
            turn = pp.ErrorModel(chain, pp.Space(), [spring, drive]).at([angle]).error_at_means[4]
            assert_allclose(turn, -1e-6 * torque, rtol=0, atol=1e-15)
    # m g l = c h r: the weight is in balance everywhere, also on the arm that gives way; a servo knows nothing of the spring
    heavy = one_link(axis=(0, -1, 0), mass=2.0, com=(0.5, 0.0, 0.0), gravity=(0.0, 0.0, -rate * height * reach))
    for statics in ("nominal", "equilibrium"):
        model = pp.ErrorModel(
            heavy, pp.Space(), [spring, JointCompliance(joint="hinge", compliance=1e-3)], statics=statics
        )
        assert all(np.abs(model.at([angle]).error_at_means).max() < 1e-12 for angle in (-1.0, 0.2, 1.3))
    servo = Servo(joint="hinge", stiffness=1e3, gravity_compensation=1.0)
    turn = pp.ErrorModel(heavy, pp.Space(), [spring, servo]).at([0.2]).error_at_means[4]
    assert_allclose(turn, -1e-3 * rate * height * reach * np.cos(0.2), rtol=1e-12)


@pytest.mark.parametrize(
    ("links", "prismatic"), [(("base", "tool"), (4,)), (("link2", "link6"), ()), (("link5", "bracket"), (3, 6))]
)
def test_on_any_arm_a_spring_of_no_free_length_has_the_energy_of_the_square(links, prismatic):
    text, points, rate = random_arm(9, prismatic=prismatic), ((0.3, -0.1, 0.2), (-0.05, 0.2, 0.1)), 800.0
    arm, reading = chain_of(text, tip="tool", gravity=(0.0, 0.0, 0.0)), PlainRobot.parse(text)
    q = dict(zip(arm.joint_names, (0.3, -0.7, 1.1, 0.4, -1.3, 0.8, 0.5), strict=True))

    def energy(values):
        poses = reading.poses(values)
        ends = [poses[name][:3, :3] @ point + poses[name][:3, 3] for name, point in zip(links, points, strict=True)]
        return rate * ((ends[1] - ends[0]) ** 2).sum() / 2

    spring = strut(*zip(links, points, strict=True), rate=rate, free_length=0.0)
    soft_joints = [JointCompliance(joint=name, compliance=1e-6) for name in q]
    at = pp.ErrorModel(arm, pp.Space(), [spring, *soft_joints]).at(list(q.values()))
    turns = np.zeros(7)
    for term in at.terms:
        turns[term.target.joint] += term.twist[0]
    # of a turn the energy is a + b cos q + c sin q, of a slide a parabola: these differences are exact
    torques = [-derivative(reading, name, energy, q) for name in q]
    assert np.abs(torques).max() > 10.0
    assert_allclose(turns, 1e-6 * np.array(torques), rtol=0, atol=1e-15)


PUSH = {"push": 300.0, "rate": 2000.0, "at_length": 0.6}


def test_a_planar_arm_with_a_gas_spring_at_rest():
    # errors x, z and turn about y, from an independent code
    expected = {
        "nominal": (-0.004928719639607393, -0.08222747094598637, 0.11081173675139472),
        "equilibrium": (-0.003485157046963394, -0.0772236496615997, 0.10192980383355425),
    }
    for statics, errors in expected.items():
        at = pp.ErrorModel(planar(2), pp.Space(), [*soft(2), strut(**PUSH)], statics=statics).at(Q)
        assert_allclose(at.error_at_means[[0, 2, 4]], errors, rtol=0, atol=1e-9)
    solved, length = at_rest(**PUSH)
    assert_allclose(at.error_at_means[[0, 2, 4]], solved, rtol=0, atol=1e-10)
    assert_allclose(length, 0.8006944268733777, rtol=0, atol=1e-9)


@pytest.mark.parametrize("start", ["base", "link1"])
def test_random_numbers_of_a_gas_spring_move_the_arm_at_rest(start):
    """The derivatives hold the change of the spring's length and direction with the deflection."""
    spring = strut((start, A), **{name: Normal(0.01 * value, mean=value) for name, value in PUSH.items()})
    at = pp.ErrorModel(planar(2), pp.Space(), [*soft(2), spring], statics="equilibrium").at(Q)
    assert_allclose(at.error_at_means[[0, 2, 4]], at_rest(**PUSH, start=start)[0], rtol=0, atol=1e-10)
    for column, (name, value) in enumerate(PUSH.items()):
        ends = [at_rest(**PUSH | {name: value * factor}, start=start)[0] for factor in (1.0001, 0.9999)]
        slope = (ends[0] - ends[1]) / (2e-4 * value)
        assert_allclose(at.jacobian[[0, 2, 4], column], slope, rtol=0, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("settings", [{"push": 400.0}, {"rate": 900.0, "free_length": 0.1}])
def test_at_rest_a_strut_is_a_dead_force(settings):
    """On joints, bearings and a beam of an arm in space: the force that lies on the strut where it has put the arm."""
    arm = chain_of(random_arm(15, prismatic=(4,)), tip="tool")
    q, start, point = (0.3, -0.7, 1.1, 0.04, -1.3, 0.8, 0.5), np.array([0.2, 0.1, 0.8]), np.array([0.05, -0.02, 0.03])
    sources = [JointCompliance(joint=name, compliance=2e-5) for name in arm.joint_names]
    sources += [BearingStiffness(joint="joint2", radial=1e6, axial=2e6, tilt=1e4), Payload(at="tool", mass=3.0)]
    sources += [Beam(link="link3", EI=2e3, GI=1e3, EA=1e6)]

    def model(load):
        return pp.ErrorModel(arm, pp.Space(), [*sources, load], statics="equilibrium").at(q)

    at = model(strut(("base", tuple(start)), ("tool", tuple(point)), **settings))
    tip, error = at.posture.pose, at.error_at_means
    stop = tip[:3, 3] + error[:3] + se3.exp_rotation(error[3:]) @ tip[:3, :3] @ point
    length = np.linalg.norm(stop - start)
    pull = settings.get("rate", 0.0) * (length - settings.get("free_length", 0.0)) - settings.get("push", 0.0)
    dead = model(Force(at="tool", point=tuple(point), force=tuple(pull * (start - stop) / length)))
    assert np.abs(error).max() > 1e-3
    assert_allclose(error, dead.error_at_means, rtol=0, atol=1e-10)


def test_a_strut_in_a_sheet_through_every_engine(tmp_path):
    ends = "from: {link: link1, point: [0 mm, 0 mm, 40 mm]}, to: {link: link3, point: 20 0 -30 mm}"
    push = "push: {normal: 30 N, mean: 300 N}, rate: 0.2 ± 0.01 N/mm, at_length: {uniform: 5 mm, mean: 600 mm}"
    lines = [f"strut: {{{ends}, {push}, provenance: {{push: data sheet, from: drawing}}}}"]
    lines += [
        f"joint_compliance: {{joint: joint{k}, compliance: {{normal: 1e-6 rad/(N*m), mean: 1e-5 rad/(N*m)}}}}"
        for k in (2, 3)
    ]
    lines += ["frame: {frame: tool, x: ±1 mm, y: ±1 mm, z: ±1 mm, rx: ±1 mrad, ry: ±1 mrad, rz: ±1 mrad}"]
    model = pp.ErrorModel.load(written(tmp_path, "\n".join(lines)))
    spring = model.sources[0]
    assert (spring.from_, spring.to.point) == (StrutEnd(link="link1", point=(0.0, 0.0, 0.04)), (0.02, 0.0, -0.03))
    assert model.space.components[:3] == tuple(f"strut[link1-link3].{name}" for name in PUSH)
    assert model.draw_words[0] == "push of the strut link1-link3"
    assert model.space.mean[:3] == pytest.approx([300.0, 200.0, 0.6])
    check_engines(model)
    moved = model.sheet.with_changes({"strut[link1-link3].from.point": "0 0 0 mm"})
    assert moved.sources[0].from_ == StrutEnd(link="link1")


def test_joints_before_both_ends_feel_nothing():
    arm = chain_of(random_arm(15), tip="tool", gravity=(0.0, 0.0, 0.0))
    sources = [JointCompliance(joint=name, compliance=1e-5) for name in arm.joint_names]
    sources += [strut(("link3", (0.1, 0.0, 0.2)), ("link6", (0.0, 0.1, 0.0)), tension=Normal(5.0, mean=300.0))]
    at = pp.ErrorModel(arm, pp.Space(), sources).at([0.3] * 7)
    loaded = {term.target.joint for term in at.terms if term.twist.any()}
    assert loaded == {3, 4, 5}


def test_the_base_goes_by_its_name_or_as_base():
    chain = pp.Chain.from_urdf("example:ur5e")
    soft_joint = JointCompliance(joint="elbow_joint", compliance=1e-5)
    errors = [
        pp.ErrorModel(chain, pp.Space(), [soft_joint, strut((name, A), (chain.tip, B), push=300.0)]).at([0.4] * 6)
        for name in (chain.base, "base")
    ]
    assert (errors[0].error_at_means == errors[1].error_at_means).all()
    assert errors[0].error_at_means.any()


def test_a_strut_whose_ends_meet_is_refused_at_that_pose():
    chain = one_link(axis=(0, -1, 0))
    model = pp.ErrorModel(chain, pp.Space(), [strut(("base", (1.0, 0.0, 0.0)), ("arm", (1.0, 0.0, 0.0)), push=9.0)])
    assert model.at([0.1]).error_at_means.max() == 0.0
    for ask in (lambda: model.at([0.0]), lambda: list(model.at_many(np.array([[0.1, 0.0]])))):
        with pytest.raises(
            pp.InputError, match=r"strut\[base-arm\]: its ends are at one point, so its force has no direction"
        ):
            ask()
