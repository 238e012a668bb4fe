"""Stiffness: closed forms, numbers of an independent code, and differences of the arm at rest under a small force."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import precision_pin as pp
from precision_pin.analyses.stiffness.figure import ComplianceLayer, figure, map_figure, stiffness_chapter
from precision_pin.analyses.stiffness.stiffness import split_goal
from precision_pin.analyses.stiffness.table import answer, table
from precision_pin.model.compliance import Elasticity
from precision_pin.sources import Beam, BearingStiffness, Force, JointCompliance, Payload, Servo, Transmission
from precision_pin.sources.strut import Strut, StrutEnd
from sources.test_force import planar
from sources.test_gears import K, T
from support.checks.common import one_link

LENGTHS, SOFT = (0.6, 0.5), (1 / 800.0, 1 / 400.0)
ANGLES = np.radians([30, -50])


def jacobian(angles):
    """Return the columns of the tip's twist of the planar arm, joints about -y."""
    sums = np.cumsum(angles)
    links = [length * np.array([np.cos(s), np.sin(s)]) for length, s in zip(LENGTHS, sums, strict=True)]
    points = np.array([np.zeros(2), *np.cumsum(links, axis=0)])
    reach = points[-1] - points[:-1]
    zero = np.zeros(2)
    return np.array([-reach[:, 1], zero, reach[:, 0], zero, -np.ones(2), zero])


def by_hand(angles=ANGLES):
    return jacobian(angles) @ np.diag(SOFT) @ jacobian(angles).T


def soft_arm(statics="nominal", *sources, gravity=(0.0, 0.0, 0.0), compliance=SOFT):
    joints = [JointCompliance(joint=f"j{k}", compliance=c) for k, c in enumerate(compliance, start=1)]
    return pp.ErrorModel(planar(2, gravity), pp.Space(), [*joints, *sources], {"work": ANGLES}, statics)


def test_a_planar_arm_is_that_of_the_closed_form():
    pose = pp.stiffness(soft_arm(), robots=10, axes="base").poses[0]
    expected = by_hand()
    assert_allclose(pose.compliance, expected, rtol=1e-12, atol=1e-18)
    sizes, vectors = np.linalg.eigh(expected[:3, :3])
    assert_allclose(pose.softest.compliance, sizes[-1], rtol=1e-12)
    assert_allclose(abs(pose.softest.direction @ vectors[:, -1]), 1.0, rtol=1e-12)
    # of an independent code
    assert_allclose(pose.softest.direction, [0.024554759335128143, 0.0, 0.9996984864417842], atol=1e-9)
    x = pose.axes[0]
    # the force is along x and the tip free sideways: held sideways it is stiffer, by the inverse of the block
    assert_allclose(x.stiffness, 10648.593755120159, rtol=1e-9)
    held = np.linalg.inv(expected[np.ix_([0, 2], [0, 2])])[0, 0]
    assert held > 1.005 * x.stiffness
    assert pose.axes[1].stiffness is None
    # robots alike: every quantile is the nominal one
    assert x.law.std == 0.0
    assert x.law.quantiles[0.5] == x.compliance
    assert_allclose(sum(part.share for part in pose.sources), 1.0, rtol=1e-12)
    assert_allclose(sum(part.axes for part in pose.sources), [entry.compliance for entry in pose.axes], atol=1e-18)


def test_axes_of_the_tool_and_a_direction():
    model, turn = soft_arm(), np.radians(-20)
    tool = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    pose = pp.stiffness(model, "work", robots=10, axes="tool").poses[0]
    assert_allclose([entry.direction for entry in pose.axes], tool, atol=1e-12)
    assert ") in base axes: " in answer(pose)
    # nothing varies
    alike = pp.stiffness(model, "work", robots=100)
    assert [row.robots for row in alike.rows(alike.poses[0])[:3]] == [
        f"{1e6 * entry.compliance:.4g}" for entry in alike.poses[0].axes
    ]
    assert_allclose([entry.compliance for entry in pose.axes], np.diag(tool @ by_hand()[:3, :3] @ tool.T), atol=1e-15)
    along = pp.stiffness(model, robots=10, axes=(2, 0, 2), rated="10 N").poses[0]
    u = np.array([1, 0, 1]) / np.sqrt(2)
    assert_allclose(along.axes[0].compliance, u @ by_hand()[:3, :3] @ u, rtol=1e-12)
    assert set(along.static_compliance) == {"+along", "-along"}


def test_a_cantilever_and_bearings_by_hand():
    length, ei, gi, tilt = 0.8, 900.0, 400.0, 5e4
    chain = one_link(axis=(0, 1, 0), length=length)
    sources = [Beam(link=chain.joints[0].child, EI=ei, GI=gi), BearingStiffness(joint="hinge", tilt=tilt)]
    pose = pp.stiffness(pp.ErrorModel(chain, pp.Space(), sources), [0.0], robots=10).poses[0]
    y, z = pose.axes[1], pose.axes[2]
    # a bearing of a hinge about y tilts about z under a force along y, not about y
    assert_allclose(z.stiffness, 3 * ei / length**3, rtol=1e-12)
    assert_allclose(y.compliance, length**3 / (3 * ei) + length**2 / tilt, rtol=1e-12)
    assert_allclose(
        [entry.compliance for entry in pose.rotation],
        [length / gi + 1 / tilt, length / ei, length / ei + 1 / tilt],
        rtol=1e-9,
    )


DEAD = (60.0, -100.0, 5.0)
# 2R under its weight and a dead force and moment, by an independent code
AT_REST = np.array(
    [
        [0.00016054098934391086, 0.00027137055536252767, -0.0006132596234289958],
        [0.0002713705553625277, 0.0014011677950739132, -0.0018789678580300256],
        [-0.0006132596234289958, -0.0018789678580300256, 0.0030954913812360637],
    ]
)
IN_PLANE = np.ix_([0, 2, 4], [0, 2, 4])


def test_at_rest_the_load_stiffness_counts():
    force = Force(at="tool", force=(DEAD[0], 0.0, DEAD[1]), moment=(0.0, -DEAD[2], 0.0))
    pose = pp.stiffness(soft_arm("equilibrium", force, gravity=(0.0, 0.0, -9.81)), robots=10).poses[0]
    assert_allclose(pose.compliance[IN_PLANE], AT_REST, rtol=1e-7, atol=1e-11)
    # without K_g it would be 17 % softer
    assert_allclose(pose.softest.compliance, 0.001457929495939454, rtol=1e-7)


@pytest.mark.parametrize("statics", ["nominal", "equilibrium"])
def test_a_small_force_moves_the_arm_by_the_compliance(statics):
    """A force source on the whole arm, solved at rest: differences of errors, through none of the code under test."""
    chain = pp.Chain.from_urdf("example:ur5", tip="tool0").with_target((0.05, 0.0, 0.1))
    names = chain.joint_names
    sources = [
        *(
            JointCompliance(joint=name, compliance=c)
            for name, c in zip(names[:4], (5e-5, 5e-5, 7e-5, 2e-4), strict=True)
        ),
        BearingStiffness(joint=names[1], radial=2e7, axial=3e7, tilt=4e4),
        Servo(joint=names[4], stiffness=4000.0, friction=3.0, load_friction=0.2),
        Beam(link="upper_arm_link", EI=8e3, GI=5e3, EA=4e7),
        Payload(at="tool0", mass=8.0, com=(0.0, 0.0, 0.1)),
        Force(at="tool0", force=(200.0, -150.0, 300.0), moment=(10.0, -20.0, 15.0), axes="tool"),
        Force(at="forearm_link", force=(-100.0, 150.0, 80.0), moment=(20.0, 30.0, -10.0)),
        Strut(
            from_=StrutEnd(link="base", point=(0.1, -0.1, 0.3)),
            to=StrutEnd(link="forearm_link", point=(0.05, 0.0, 0.1)),
            push=900.0,
            rate=4000.0,
            at_length=0.5,
        ),
    ]
    q = np.radians([30, -60, 80, -100, -80, 20])
    pose = pp.stiffness(pp.ErrorModel(chain, pp.Space(), sources, statics=statics), q, robots=10).poses[0]
    assert_allclose(pose.position, chain.at(q).pose[:3, 3])
    point = tuple(chain.target)

    def error(force):
        push = Force(at="tool0", force=tuple(force[:3]), moment=tuple(force[3:]), point=point)
        at = pp.ErrorModel(chain, pp.Space(), [*sources, push], statics=statics).at(q)
        # the direction of the last motion is unknown: its mean is 0
        return (at.linear if statics == "nominal" else at.exact)(at.space.mean[:, None])[:, 0]

    for column, step in ((0, 1.0), (2, 1.0), (4, 0.2)):
        force = step * np.eye(6)[column]
        plus, minus = error(force), error(-force)
        difference = (plus - minus) / (2 * step)
        if statics == "equilibrium":
            turns = [Rotation.from_rotvec(end[3:]) for end in (plus, minus)]
            difference[3:] = (turns[0] * turns[1].inv()).as_rotvec() / (2 * step)
        for rows in (slice(0, 3), slice(3, 6)):
            size = np.abs(difference[rows]).max()
            assert_allclose(pose.compliance[rows, column], difference[rows], rtol=0, atol=1e-6 * size)


def test_iso_9283_steps_by_sign_and_size():
    gears = [Transmission(joint=f"j{k}", stiffness=K, limit_torques=T) for k in (1, 2)]
    sources = [*gears, Payload(at="tool", mass=4.0)]
    model = pp.ErrorModel(planar(2), pp.Space(), sources, {"work": ANGLES}, "equilibrium")
    pose = pp.stiffness(model, rated="100 N", robots=10).poses[0]
    plus, minus = pose.static_compliance["+z"], pose.static_compliance["-z"]
    assert (plus.step, plus.rated, len(plus.force)) == (10.0, 100.0, 10)
    # mm/kN of an independent code: secants at 10 and at 100 N, and the tangent
    assert_allclose(
        1e6 * plus.compliance[[0, 4, 9]], [12.193087464829055, 13.030561771182336, 15.47074069446347], rtol=1e-7
    )
    assert_allclose(1e6 * minus.compliance[[0, 9]], [11.909224809025787, 10.539569714282381], rtol=1e-7)
    assert_allclose(1e6 * plus.displacement[9], [-38.48790667626556, 0.0, 1547.074069446347], rtol=1e-7, atol=1e-9)
    assert_allclose(1e6 * pose.axes[2].compliance, 12.192791458286309, rtol=1e-7)
    length, axis, force = pose.largest
    assert (round(1e6 * length, 6), axis, force) == (1547.074069, "+z", 100.0)


def test_without_pieces_the_steps_are_the_tangent():
    pose = pp.stiffness(soft_arm(), rated=50.0, robots=10).poses[0]
    steps = pose.static_compliance["-x"]
    assert_allclose(steps.compliance, pose.axes[0].compliance, rtol=1e-12)
    assert_allclose(steps.displacement[4], by_hand()[:3, 0] * -25.0, rtol=1e-12, atol=1e-15)


def test_the_dead_band_is_the_whole_width_between_the_sides():
    # 0.5 m, k = 50 N·m/rad, F = 0.4 + 0.1·|6 N·m| N·m: the tip may lie 20 mm apart by the direction of approach
    chain = one_link(axis=(0, 1, 0), length=0.5, gravity=(0.0, 0.0, 0.0))
    sources = [
        Servo(joint="hinge", stiffness=50.0, friction=0.4, load_friction=0.1),
        Force(at="tool", force=(0.0, 0.0, 12.0)),
    ]
    model = pp.ErrorModel(chain, pp.Space(), sources)
    pose = pp.stiffness(model, [0.0], robots=10).poses[0]
    held = pose.dead_band[0]
    assert (held.source, held.joint) == ("servo[hinge]", "hinge")
    assert_allclose(held.axes, [0.0, 0.0, 0.5 * 2 * 1.0 / 50.0], rtol=1e-12, atol=1e-18)
    sides = [model.at([0.0], approach=f"hinge {side}").linear(model.space.mean[:, None])[2, 0] for side in "+-"]
    assert_allclose(abs(sides[0] - sides[1]), pose.band[2], rtol=1e-12)
    # friction does not stiffen: the compliance is that of the spring
    assert_allclose(pose.axes[2].compliance, 0.5**2 / 50.0, rtol=1e-12)
    still = pp.ErrorModel(chain, pp.Space(), [Servo(joint="hinge", stiffness=50.0, friction=0.4, integral=True)])
    with pytest.raises(pp.InputError, match="nothing in the sheet gives way"):
        pp.stiffness(still, [0.0])


def laws(statics="nominal", gravity=(0.0, 0.0, 0.0)):
    return soft_arm(statics, gravity=gravity, compliance=[pp.Uniform(0.2 * c, mean=c) for c in SOFT])


def test_the_law_over_robots_is_that_of_a_plain_simulation():
    model = laws()
    robots = 20_000
    pose = pp.stiffness(model, robots=robots, seed=3).poses[0]
    rng = np.random.default_rng(5)
    factors = rng.uniform(0.8, 1.2, (robots, 2)) * SOFT
    blocks = np.einsum("ik,nk,jk->nij", jacobian(ANGLES)[:3], factors, jacobian(ANGLES)[:3])
    softest = np.linalg.eigvalsh(blocks)[:, -1]
    for law, values in ((pose.axes[0].law, blocks[:, 0, 0]), (pose.softest.law, softest)):
        assert abs(law.mean - values.mean()) < 4 * values.std() / np.sqrt(robots)
        assert_allclose(law.std, values.std(), rtol=0.03)
        for level in (0.05, 0.95):
            low, high = law.quantile_interval[level]
            assert low < law.quantiles[level] < high
            assert low - 0.01 * values.std() < np.quantile(values, level) < high + 0.01 * values.std()
    # closed form: C_zz is linear in the two compliances
    std = 0.2 / np.sqrt(3) * np.hypot(*(jacobian(ANGLES)[2] ** 2 * SOFT))
    assert_allclose(pose.axes[2].law.std, std, rtol=0.02)
    low, high = np.moveaxis(pose.compliance_interval, -1, 0)
    inside = ((blocks >= low[:3, :3]) & (blocks <= high[:3, :3]))[:, [0, 2], [0, 2]].mean(axis=0)
    assert ((inside > 0.945) & (inside < 0.965)).all()
    # robots one by one, by the compliance of each
    x = model.space.sample(3, 0, 5)
    alone = [
        Elasticity(soft_arm(compliance=tuple(x[:, k]))).at(ANGLES).whole(np.zeros((0, 1)))[..., 0] for k in range(5)
    ]
    assert_allclose(Elasticity(model).at(ANGLES).whole(x), np.moveaxis(alone, 0, -1), rtol=1e-12, atol=1e-18)
    assert pp.stiffness(model, robots=10).poses[0].softest.law.quantiles[0.95] is None
    assert pp.stiffness(model, robots=1).to_dict()["poses"][0]["softest"]["std"] is None


def test_robots_at_rest_are_those_solved_one_by_one():
    model = laws("equilibrium", (0.0, 0.0, -9.81))
    pose = pp.stiffness(model, robots=200, seed=1).poses[0]
    assert 0 < pose.solved_difference < 0.005
    elastic, x = Elasticity(model), model.space.sample(1, 0, 3)
    whole = elastic.at(ANGLES).whole(x)
    for k in range(3):
        heavy = soft_arm("equilibrium", gravity=(0.0, 0.0, -9.81), compliance=tuple(x[:, k]))
        alone = pp.stiffness(heavy, robots=10).poses[0].compliance
        assert_allclose(elastic.at(ANGLES, x[:, k]).whole(x[:, [k]])[..., 0], alone, rtol=1e-7, atol=1e-11)
        # the law takes K and K_g of each robot at the rest of the mean one
        assert_allclose(whole[..., k], alone, rtol=0, atol=0.005 * np.abs(alone).max())


def test_the_goal_says_how_much_stiffer():
    model, goal = laws(), 0.9 * np.linalg.eigvalsh(by_hand()[:3, :3])[-1]
    pose = pp.stiffness(model, robots=2000, goal=goal).poses[0]
    assert_allclose(pose.goal.together, 1 / 0.9, rtol=1e-12)
    assert pose.goal.interval[0] < pose.goal.probability < pose.goal.interval[1]
    for part in pose.sources:
        stiffer = list(SOFT)
        stiffer[int(part.source[-2]) - 1] /= part.factor
        compliance = jacobian(ANGLES)[:3] @ np.diag(stiffer) @ jacobian(ANGLES)[:3].T
        assert_allclose(np.linalg.eigvalsh(compliance)[-1], goal, rtol=1e-9)
    out_of_reach = pp.stiffness(model, robots=10, goal="1 um/kN").poses[0]
    assert [part.factor for part in out_of_reach.sources] == [None, None]
    along = pp.stiffness(model, robots=10, goal=1e-4, axes=(1, 0, 0)).poses[0]
    assert along.goal.together == 1.0
    assert [part.factor for part in along.sources] == [1.0, 1.0]


def test_a_split_of_the_goal_has_the_least_sum_of_factors():
    # along one direction factors go with the roots of the parts; the third stays, so the others share 2 - 0.25: √c (2 + 1)/1.75
    assert_allclose(split_goal(np.reshape([4.0, 1.0, 0.25], (3, 1, 1)), 2.0), [2 * 12 / 7, 12 / 7, 1.0], rtol=1e-4)
    levers = np.random.default_rng(4).normal(size=(8, 3, 2))
    blocks = levers @ np.swapaxes(levers, 1, 2)
    goal = 0.3 * np.linalg.eigvalsh(blocks.sum(axis=0))[-1]
    factors = split_goal(blocks, goal)

    def softest(factors):
        return np.linalg.eigvalsh((blocks / factors[:, None, None]).sum(axis=0))[-1]

    assert goal * (1 - 1e-5) < softest(factors) <= goal * (1 + 1e-6)
    # neighbours that keep the goal, by a common factor if need be, have a larger sum
    for change in np.random.default_rng(5).uniform(0.9, 1.1, (200, 8)):
        other = np.maximum(factors * change, 1.0)
        other = np.maximum(other * softest(other) / goal, 1.0)
        assert other.sum() > factors.sum() * (1 - 1e-6)
    part = pp.stiffness(laws(), robots=10, goal="1 um/kN").poses[0]
    assert sum(entry.split for entry in part.sources) < 2 * part.goal.together


def test_many_poses_are_those_one_by_one():
    chain = pp.Chain.from_urdf("example:ur5", tip="tool0")
    soft = [JointCompliance(joint=name, compliance=pp.Uniform(1e-5, mean=5e-5)) for name in chain.joint_names]
    # a gear in pieces looks at the payload's torque, so that it is asked pose by pose
    soft[2] = Transmission(joint=chain.joint_names[2], stiffness=(2e4, 4e4), limit_torques=(15.0,))
    model = pp.ErrorModel(chain, pp.Space(), [*soft, Payload(at="tool0", mass=3.0)])
    q = [*np.random.default_rng(2).uniform(-2, 2, (5, 6))]
    many = pp.stiffness(model, q, robots=100)
    for values, pose in zip(q, many.poses, strict=True):
        alone = pp.stiffness(model, values, robots=100).poses[0]
        assert_allclose(pose.compliance, alone.compliance, rtol=1e-9, atol=1e-16)
        assert_allclose(pose.softest.law.std, alone.softest.law.std, rtol=1e-6)
    text = table(many)
    assert text.startswith("worst pose")
    assert "softest mm/kN" in text
    assert map_figure(many).axes[0].get_xlabel() == "x [mm]"


def test_what_is_shown():
    result = pp.stiffness(laws(), rated="300 N", goal="1500 um/N", robots=1000)
    text = table(result)
    softest = np.linalg.eigh(by_hand()[:3, :3])[1][:, -1] @ jacobian(ANGLES)[:3, 0]
    share = 100 * softest**2 * SOFT[0] / 0.0017766968194753443
    assert text.startswith(
        "300 N along an axis move the tool by up to 533 mm (+z); softest along (0.02 0 1): 1777 mm/kN, 0.0005628 N/µm; "
    )
    assert f"joint_compliance[j1] gives {share:.0f} % of it" in text.split("\n")[0]
    assert "free sideways" in text
    assert "in base axes" not in text
    assert "interval" in text
    assert "× 1." in text
    data = json.loads(result.to_json())
    assert data["schema"] == "precision-pin/stiffness/1"
    pose = data["poses"][0]
    assert np.shape(pose["compliance"]) == (6, 6)
    assert np.shape(pose["compliance_interval"]) == (6, 6, 2)
    assert set(pose["softest"]) >= {"direction", "compliance", "quantiles"}
    assert pose["static_compliance"]["-z"]["step"] == 30.0
    assert pose["static_compliance"]["-z"]["rated"] == 300.0
    assert pose["dead_band"] == []
    drawn = figure(result)
    assert drawn.axes[1].get_xlabel() == "force [N]"
    assert len(result.to_pandas()) == 8


def test_the_layer_draws_what_forces_of_one_size_do():
    model, drawn = laws(), []
    poses = [ANGLES, ANGLES + 0.4, ANGLES]
    layer = ComplianceLayer.of(pp.stiffness(model, poses, robots=10))
    assert layer.positions.shape == (2, 3)

    class Recorder:
        def surface(self, path, vertices, faces, colour, pose):
            drawn.append((path, vertices, faces))

    layer.draw(Recorder(), 10.0)
    assert {path[0] for path, _, _ in drawn} == {"stiffness"}
    # all at one scale: half the distance of the places for the softest
    reach = 0.5 * np.linalg.norm(layer.positions[0] - layer.positions[1])
    balls = np.concatenate([vertices for _, vertices, _ in drawn]).reshape(2, -1, 3)
    for angles in poses[:2]:
        tip = np.array([jacobian(angles)[2, 0], 0.0, -jacobian(angles)[0, 0]])
        ball = balls[np.linalg.norm(balls.mean(axis=1) - tip, axis=1).argmin()] - tip
        size = reach * np.linalg.eigvalsh(by_hand(angles)[:3, :3])[-1] / layer.sizes.max()
        assert 0.95 * size < np.linalg.norm(ball, axis=1).max() <= size * (1 + 1e-9)
    assert all(faces.max() < len(vertices) for _, vertices, faces in drawn)
    assert 'id="show-stiffness"' in layer.legend()


def test_a_grid_is_a_chapter_of_the_report():
    chapter = stiffness_chapter(pp.stiffness(laws(), [ANGLES, ANGLES + 0.4], robots=100))
    assert chapter.answers[0].startswith("Stiffness, softest of 2 poses: 100 N move the tool by up to")
    assert "free sideways" in str(chapter.section)
    assert "figure-stiffness-map" in str(chapter.section)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rated": 0}, "rated must be positive"),
        ({"rated": "3 kg"}, "rated"),
        ({"axes": "world"}, "axes"),
        ({"axes": (0, 0, 0)}, "the direction is zero"),
        ({"robots": 0}, "robots"),
        ({"goal": "-1 um/N"}, "goal must be positive"),
    ],
)
def test_wrong_arguments_are_refused(settings, message):
    with pytest.raises(pp.InputError, match=message):
        pp.stiffness(soft_arm(), **settings)


def test_an_arm_that_buckles_under_the_rated_load_is_refused():
    upright = pp.ErrorModel(
        one_link(axis=(0, 1, 0), length=1.0, gravity=(0.0, 0.0, 0.0)),
        pp.Space(),
        [JointCompliance(joint="hinge", compliance=1 / 100.0)],
        statics="equilibrium",
    )
    # pushed along its length with more than k/l = 100 N
    with pytest.raises(pp.InputError, match=r"under 200 N along .* buckles"):
        pp.stiffness(upright, [0.0], rated=200.0, robots=10)
