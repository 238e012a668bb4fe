"""Applied forces: planar arms solved in closed form and robot by robot, dead and following the arm."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from scipy.integrate import quad
from scipy.optimize import brentq, root

import precision_pin as pp
from precision_pin.sources import BearingStiffness, Force, JointCompliance, Payload
from support.plain_robot import chain_of, joint, link, random_arm, robot

G = 9.81
LINKS = {2: ((0.6, 4.0), (0.5, 3.0)), 3: ((0.5, 3.0), (0.4, 2.0), (0.3, 1.0))}
STIFFNESS = {2: (800.0, 400.0), 3: (900.0, 600.0, 300.0)}


def planar(count, gravity=(0.0, 0.0, -G)):
    """Links along x, centres of mass half way, joints about -y."""
    parts, before = [link("base")], ("base", (0.0, 0.0, 0.0))
    for k, (length, mass) in enumerate(LINKS[count], start=1):
        parts.append(joint(f"j{k}", "revolute", before[0], f"link{k}", before[1], (0, 0, 0), (0, -1, 0)))
        parts.append(link(f"link{k}", mass=mass, com=(length / 2, 0, 0)))
        before = (f"link{k}", (length, 0.0, 0.0))
    return chain_of(
        robot(*parts, joint("flange", "fixed", *[before[0], "tool"], before[1]), link("tool")), gravity=gravity
    )


def soft(count):
    return [JointCompliance(joint=f"j{k}", compliance=1 / c) for k, c in enumerate(STIFFNESS[count], start=1)]


def in_plane(numbers, **settings):
    """Return forces by ``(F_x, F_z, moment about -y)``."""
    x, z, moment = numbers
    return Force(at="tool", force=(x, 0.0, z), moment=(0.0, -moment, 0.0), **settings)


def at_rest(count, q, forces, statics):
    model = pp.ErrorModel(planar(count), pp.Space(), [*soft(count), *forces], statics=statics)
    return model.at(np.radians(q)).error_at_means


def energy_gradient_rest(count, q, dead, follower):
    """Return tip displacement and turn of the planar arm at rest, from the balance of torques in the plane."""
    lengths, masses = np.array(LINKS[count]).T
    stiffness, start = np.array(STIFFNESS[count]), np.radians(q)

    def torques(angles):
        sums = np.cumsum(angles)
        along = np.array([np.cos(sums), np.sin(sums)])
        points = np.concatenate([np.zeros((2, 1)), np.cumsum(lengths * along, axis=1)], axis=1)
        turn = np.array([[along[0, -1], -along[1, -1]], [along[1, -1], along[0, -1]]])
        force = np.array(dead[:2]) + turn @ follower[:2]
        result = np.zeros(count)
        for k in range(count):
            arm = points[:, -1] - points[:, k]
            result[k] = arm[0] * force[1] - arm[1] * force[0] + dead[2] + follower[2]
            for i in range(k, count):
                centre = (points[:, i] + points[:, i + 1]) / 2 - points[:, k]
                result[k] -= masses[i] * G * centre[0]
        return result, points[:, -1]

    tip = torques(start)[1]
    solution = root(lambda shift: stiffness * shift - torques(start + shift)[0], np.zeros(count), tol=1e-13).x
    moved = torques(start + solution)[1] - tip
    return np.array([moved[0], 0.0, moved[1], 0.0, -solution.sum(), 0.0])


# (links, degrees, dead, follower, nominal, equilibrium): errors x, z and turn about y, from an independent code
PLANAR = [
    (2, (30, -50), (60, -100, 5), (-80, 40, 2),
     (-0.0020704581260629906, -0.09313791869698518, 0.11645632693640938),
     (0.0004011308178468731, -0.08200579769049995, 0.09849002569319229)),
    (2, (10, 60), None, (-80, 40, 2),
     (0.004441167669216872, -0.028990656289763383, 0.00012668895794775846),
     (0.006092326848428309, -0.031292753685251196, 0.0031699836179247196)),
    (3, (20, -40, 60), (30, -50, 2.5), None,
     (0.023315495972215716, -0.1575952562617061, 0.21332357936360735),
     (0.023506977747646873, -0.1510689212222199, 0.20608452810805516)),
]  # fmt: skip


@pytest.mark.parametrize(("count", "q", "dead", "follower", "nominal", "equilibrium"), PLANAR)
def test_planar_arms_dead_and_following(count, q, dead, follower, nominal, equilibrium):
    forces = [in_plane(dead)] if dead else []
    forces += [in_plane(follower, axes="tool")] if follower else []
    for statics, expected in (("nominal", nominal), ("equilibrium", equilibrium)):
        error = at_rest(count, q, forces, statics)
        assert_allclose(error[[0, 2, 4]], expected, rtol=0, atol=1e-9)
    nothing = (0.0, 0.0, 0.0)
    solved = energy_gradient_rest(count, q, dead or nothing, np.array(follower or nothing))
    assert_allclose(at_rest(count, q, forces, "equilibrium"), solved, rtol=0, atol=1e-10)


def test_random_forces_move_the_arm_at_rest():
    """The derivatives hold that a dead force keeps its direction, and a following one turns, as the arm gives way."""
    count, q, *forces = PLANAR[0][:4]
    forces = np.array(forces, dtype=float)

    def law(number):
        return pp.Normal(0.1, mean=float(number))

    sources = [
        Force(at="tool", force=(law(x), 0.0, law(z)), moment=(0.0, law(-moment), 0.0), axes=axes)
        for (x, z, moment), axes in zip(forces, ("base", "tool"), strict=True)
    ]
    at = pp.ErrorModel(planar(count), pp.Space(), [*soft(count), *sources], statics="equilibrium").at(np.radians(q))
    for column in range(6):
        step = 1e-2 * np.eye(6)[column].reshape(2, 3)
        ends = [energy_gradient_rest(count, q, *(forces + sign * step)) for sign in (1, -1)]
        slope = (ends[0] - ends[1]) / 2e-2 * (-1.0 if column in (2, 5) else 1.0)
        assert_allclose(at.jacobian[:, column], slope, rtol=0, atol=1e-6 * np.abs(slope).max())


def test_two_spatial_forces_on_joints_and_bearings():
    sources = [*soft(2), BearingStiffness(joint="j1", radial=2e7, axial=3e7, tilt=4e4)]
    sources += [BearingStiffness(joint="j2", radial=1e7, axial=1.5e7, tilt=2e4)]
    sources += [Force(at="tool", force=(60, -40, -100), moment=(2, 3, -1), axes="tool")]
    sources += [Force(at="link1", point=(0.4, 0.05, 0.02), force=(10, 20, -30), moment=(0, 1, 0), axes="link")]
    expected = {
        "nominal": [-0.028586798817353376, -0.0013707087902655106, -0.22006948690578138, -0.00011788147460345278,
                    0.2979311882524772, -0.0019001185039482994],
        "equilibrium": [-0.0281884861655346, -0.0013645088029092516, -0.21572680354410761, -0.00045220209735647197,
                        0.2934126072767244, -0.0018490979332114509],
    }  # fmt: skip
    for statics, errors in expected.items():
        model = pp.ErrorModel(planar(2, gravity=(0, 0, 0)), pp.Space(), sources, statics=statics)
        assert_allclose(model.at(np.radians([30, -50])).error_at_means, errors, rtol=0, atol=1e-9)


Q = (0.3, -0.7, 1.1, 0.04, -1.3, 0.8, 0.5)
ARMS = (15, (4,)), (3, ()), (8, (2, 5))


def flexible(arm):
    """Return a compliance of each joint and of a bearing."""
    soft_joints = [JointCompliance(joint=name, compliance=2e-5) for name in arm.joint_names]
    return [*soft_joints, BearingStiffness(joint="joint3", radial=1e6, axial=2e6, tilt=1e4)]


def same_errors(first, second, statics):
    """Compare the errors of two pairs of an arm and a load."""
    errors = [
        pp.ErrorModel(arm, pp.Space(), [*flexible(arm), load], statics=statics).at(Q).error_at_means
        for arm, load in (first, second)
    ]
    assert np.abs(errors[0]).max() > 1e-4
    assert_allclose(errors[1], errors[0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("statics", ["nominal", "equilibrium"])
@pytest.mark.parametrize(("seed", "prismatic"), ARMS)
def test_on_any_arm_a_payload_is_a_dead_force_and_a_point_further_away_adds_a_moment(seed, prismatic, statics):
    text = random_arm(seed, prismatic=prismatic)
    arm, where, point, force = chain_of(text, tip="tool"), "half2", (0.11, -0.07, 0.05), (30.0, -70.0, 50.0)
    weight = Force(at=where, force=tuple(2.5 * arm.gravity), point=point)
    same_errors((arm, Payload(at=where, mass=2.5, com=point)), (arm, weight), statics)
    # in axes of the link the moment turns with it
    stated = Force(at="tool", force=force, moment=tuple(np.cross(point, force)), axes="link")
    same_errors((arm, Force(at="tool", force=force, point=point, axes="link")), (arm, stated), statics)
    # without masses, a kilogram where gravity is the force
    massless = re.sub("<inertial>.*?</inertial>", "", text)
    bare, pulled = (chain_of(massless, tip="tool", gravity=gravity) for gravity in ((0.0, 0.0, 0.0), force))
    dead = Force(at="tool", force=force, point=point)
    same_errors((pulled, Payload(at="tool", mass=1.0, com=point)), (bare, dead), statics)
    # in base axes only as long as the arm does not turn
    if statics == "nominal":
        turn = arm.at(Q).pose[:3, :3]
        moved = Force(at="tool", force=force, moment=tuple(np.cross(turn @ point, force)))
        same_errors((bare, dead), (bare, moved), statics)
        # along the axes of the tip, on a link beneath whose own are others
        of_tool = Force(at="link7", force=force, moment=point, axes="tool")
        in_base = Force(at="link7", force=tuple(turn @ force), moment=tuple(turn @ point))
        same_errors((arm, of_tool), (arm, in_base), statics)


def test_the_base_feels_nothing():
    chain = planar(2)
    alone, loaded = (
        pp.ErrorModel(chain, pp.Space(), [*soft(2), *more]).at([0.4, -0.9]).error_at_means
        for more in ((), (Force(at="base", force=(100.0, 0.0, 0.0)),))
    )
    assert (alone == loaded).all()


def test_a_random_direction_is_uniform_on_the_sphere():
    chain = chain_of(random_arm(3), tip="tool", gravity=(0.0, 0.0, 0.0))
    flexible = [JointCompliance(joint=name, compliance=1e-5) for name in chain.joint_names]
    force = Force(at="tool", magnitude=pp.Uniform(100.0, mean=500.0), direction="any")
    model = pp.ErrorModel(chain, pp.Space(), [*flexible, force])
    at = model.at([0.3] * len(chain.joints))
    errors = at.exact(model.space.sample(7, 0, 20000))
    compliance = np.einsum("ij,kj->ik", at.posture.joint_jacobian[:3], at.posture.joint_jacobian[:3]) * 1e-5
    # E[F Fᵀ] = E[f²]/3, f² = 500² + 100²/3
    expected = compliance @ compliance.T * (500.0**2 + 100.0**2 / 3) / 3
    sampled = errors[:3] @ errors[:3].T / errors.shape[1]
    # the relative standard error of a second moment of 20,000 draws is about 1 %
    assert_allclose(sampled, expected, rtol=0.04, atol=0.04 * np.abs(expected).max())
    run = pp.monte_carlo(model, [0.3] * len(chain.joints), samples=20000, seed=1)
    assert_allclose(run.summary.covariance[:3, :3], expected, rtol=0.04, atol=0.04 * np.abs(expected).max())


@pytest.mark.parametrize("scope", ["unit", "visit"])
def test_first_order_sees_a_direction_alike_along_all_axes(scope):
    """Covariance f²/3 along every axis, a component uniform, the worst case the spectral norm: of a ball, not of a cube."""
    chain, size = chain_of(random_arm(3), tip="tool", gravity=(0.0, 0.0, 0.0)), 500.0
    flexible = [JointCompliance(joint=name, compliance=1e-6) for name in chain.joint_names]
    force = Force(at="tool", magnitude=size, direction="any", scope=scope)
    model, q = pp.ErrorModel(chain, pp.Space(), [*flexible, force]), [0.3] * len(chain.joints)
    at = model.at(q)
    jacobian = at.posture.joint_jacobian
    compliance = 1e-6 * jacobian @ jacobian[:3].T
    assert np.linalg.cond(compliance[:3]) < 1e3
    back = np.linalg.inv(compliance[:3])
    assert_allclose(back @ at.covariance[:3, :3] @ back.T, size**2 / 3 * np.eye(3), rtol=1e-12, atol=1e-12 * size**2)
    assert_allclose(at.covariance, compliance @ compliance.T * size**2 / 3, rtol=1e-12, atol=1e-20)
    reach = size * np.linalg.norm(compliance, axis=1)
    found = pp.worst_case(model, q, samples=500).poses[0]
    assert_allclose(
        [[one.low, one.high] for one in found.components], np.transpose([-reach, reach]), rtol=1e-12, atol=1e-14
    )
    for bound, rows in ((found.position, compliance[:3]), (found.attitude, compliance[3:])):
        farthest = size * np.linalg.norm(rows, 2)
        assert bound.first_order.lower == pytest.approx(farthest, rel=1e-9)
        assert farthest * (1 - 1e-12) <= bound.first_order.upper <= farthest * (1 + 1e-6)
    law = pp.exact_law(model, q, samples=2000).poses[0].laws["position.x"].law
    x = np.linspace(-0.9, 0.9, 7)
    assert_allclose(law.cumulative(reach[0] * x), (1 + x) / 2, rtol=0, atol=1e-9)
    # with the size random too, E f² u uᵀ is a product that the closed form of the moments knows
    soft = [JointCompliance(joint=name, compliance=1e-9) for name in chain.joint_names]
    sized = Force(at="tool", magnitude=pp.Uniform(300.0, mean=size), direction="any", scope=scope)
    found = pp.moments(pp.ErrorModel(chain, pp.Space(), [*soft, sized]), q, method="closed").poses[0].covariance.value
    expected = 1e-6 * compliance @ compliance.T * (size**2 + 300.0**2 / 3) / 3
    assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("share", [1e-3, 1e-6])
def test_rare_errors_of_a_force_of_any_direction(share):
    """P(|dx| > c f̄ h) is that of f (1 - c f̄/f), h the length of the row of the compliance; 1 - c for a known size."""
    chain, q = chain_of(random_arm(5), tip="tool", gravity=(0.0, 0.0, 0.0)), [0.3, -0.4, 0.9, 0.2, -0.6, 0.5, 0.1]
    soft = [JointCompliance(joint=name, compliance=1e-9) for name in chain.joint_names]
    for size, spread in ((600.0, 0.0), (600.0, 60.0)):
        magnitude = pp.Normal(spread, mean=size) if spread else size
        sources = [*soft, Force(at="tool", magnitude=magnitude, direction="any")]
        model = pp.ErrorModel(chain, pp.Space(), sources)
        jacobian = model.at(q).posture.joint_jacobian
        height = np.linalg.norm(1e-9 * jacobian[0] @ jacobian[:3].T)

        def beyond(force, size=size, spread=spread):
            if not spread:
                return 1 - force / size
            law = stats.norm(size, spread)
            return quad(lambda f: law.pdf(f) * (1 - force / f), force, size + 12 * spread, epsabs=0, epsrel=1e-9)[0]

        force = brentq(lambda force: np.log(beyond(force) / share), 300.0, size * (1 - 1e-9) + 8 * spread)
        demand = pp.specification(f"dx {float(1e3 * force * height)!r} mm @ 90 %")
        found = pp.reliability(model, [demand], q, samples=20_000, confidence=0.999).poses[0].specifications[0]
        assert found.resolved
        for one in found.estimates:
            assert one.interval[0] <= share <= one.interval[1], one


def test_forces_in_a_plane_and_in_space_are_the_numbers_of_a_circle_and_of_a_sphere():
    joints = pp.Chain.from_urdf("example:ur5", tip="tool0").joint_names
    stated = {
        "precision-pin": 1, "robot": "example:ur5", "tip": "tool0", "gravity": "0 0 0 m/s^2",
        "poses": {"work": "30 -70 80 -100 -90 20 deg"},
        "parameters": {"push": {"circle": "50 N"}, "gust": {"sphere": "20 N", "scope": "visit"}},
        "sources": [
            *({"joint_compliance": {"joint": name, "compliance": "1e-6 rad/(N*m)"}} for name in joints),
            {"force": {"at": "tool0", "force": ["push.x", "push.y", "0 N"]}},
            {"force": {"at": "tool0", "force": ["gust.x", "gust.y", "gust.z"]}},
        ],
    }  # fmt: skip
    model = pp.ErrorModel.from_dict(stated)
    for changes, squares in (
        ({}, (50**2 / 2 + 20**2 / 3, 50**2 / 2 + 20**2 / 3, 20**2 / 3)),
        ({"parameters.push.circle": "30 N", "parameters.gust": {"sphere": "60 N"}}, (1650.0, 1650.0, 1200.0)),
    ):
        at = model.with_(changes).at("work")
        compliance = 1e-6 * at.posture.joint_jacobian @ at.posture.joint_jacobian[:3].T
        expected = compliance * squares @ compliance.T
        assert_allclose(at.covariance, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_a_force_of_any_direction_on_an_arm_at_rest():
    # 100,000 robots of an independent code, each at its rest: mean and standard deviation of |d|, mm
    mean, std, count = 11.931059564681284, 4.131921404596513, 100_000
    chain = pp.Chain.from_urdf("example:ur5", tip="tool0", gravity=(0.0, 0.0, 0.0))
    stiffness = (20000.0, 20000.0, 15000.0, 5000.0, 5000.0, 5000.0)
    sources = [
        JointCompliance(joint=name, compliance=pp.Uniform(0.2 / k, mean=1 / k))
        for name, k in zip(chain.joint_names, stiffness, strict=True)
    ]
    sources.append(Force(at="tool0", magnitude=pp.Uniform(100.0, mean=500.0), direction="any"))
    model = pp.ErrorModel(chain, pp.Space(), sources, statics="equilibrium")
    errors = model.at(np.radians([30, -70, 80, -100, -90, 20])).exact(model.space.sample(5, 0, count))
    sizes = 1e3 * np.linalg.norm(errors[:3], axis=0)
    standard_error = std * np.sqrt(2 / count)
    assert abs(sizes.mean() - mean) < 3 * standard_error
    assert abs(sizes.std() - std) < 3 * standard_error  # of a law flatter than the normal: less than std / sqrt(2 n)
