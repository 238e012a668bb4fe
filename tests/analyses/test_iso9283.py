"""The forecast of a test by ISO 9283: against plain loops over robots and visits, closed forms, and sampling at poses."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

import precision_pin as pp
from precision_pin.analyses.iso9283.cube import (
    Cube,
    ToolPoses,
    largest_cube,
    lattice_of,
    paths_of_approach,
    standard_poses,
)
from precision_pin.analyses.iso9283.result import FigureLaw
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET, shipped_sheets
from precision_pin.sources import Backlash, JointOffset, Length, Thermal
from sampling.cases import MODEL
from support import plain_robot

CHAIN = MODEL.chain
JOINTS = CHAIN.joint_names
Q = np.random.default_rng(5).uniform(-0.6, 0.6, (len(JOINTS), 5)) + MODEL.configuration()[:, None]

pytestmark = pytest.mark.filterwarnings("ignore:.*W_NO_VISITS")


def tool_errors(laws, scope) -> pp.ErrorModel:
    """Return the arm whose tool alone is displaced along x, y, z of the last joint."""
    draws = tuple(pp.Draw(f"d{axis}", law, scope) for axis, law in laws.items())
    sources = [Length(frame=CHAIN.tip, along=f"{axis} of {JOINTS[-1]}", parameters=(f"d{axis}",)) for axis in laws]
    return pp.ErrorModel(CHAIN, pp.Space(draws), sources)


def joint_errors(scopes) -> pp.ErrorModel:
    """Return the arm with a normal offset of a milliradian of each joint, of these scopes."""
    draws = tuple(pp.Draw(f"j{k}", pp.Normal(1e-3), scope) for k, scope in enumerate(scopes))
    sources = [JointOffset(joint=joint, offset=draw.name) for joint, draw in zip(JOINTS, draws, strict=False)]
    return pp.ErrorModel(CHAIN, pp.Space(draws), sources)


MIXED = joint_errors([pp.Scope.UNIT, pp.Scope.POSE, pp.Scope.VISIT, pp.Scope.VISIT])


# against plain loops -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def attained():
    """Return attained poses of MIXED ``(robots, poses, cycles, 4, 4)`` and commanded ones, by the plain model."""
    robots, cycles = 10, 4
    models = [MIXED.at(q) for q in Q.T]
    commanded = np.array([at.posture.pose for at in models])
    poses = np.tile(np.eye(4), (robots, 5, cycles, 1, 1))
    for robot, (p, at), visit in itertools.product(range(robots), enumerate(models), range(cycles)):
        error = at.exact(MIXED.space.sample(7, robot, 1, pose=p, visit=visit))[:, 0]
        poses[robot, p, visit, :3, 3] = commanded[p, :3, 3] + error[:3]
        poses[robot, p, visit, :3, :3] = Rotation.from_rotvec(error[3:]).as_matrix() @ commanded[p, :3, :3]
    return commanded, poses


@pytest.mark.slow
@pytest.mark.parametrize("target", [None, (0.02, -0.05, 0.1)])
def test_every_figure_of_every_robot(attained, target):
    commanded, poses = (one.copy() for one in attained)
    if target is not None:
        commanded[..., :3, 3] += commanded[..., :3, :3] @ target
        poses[..., :3, 3] += poses[..., :3, :3] @ target
    found = pp.iso9283(MIXED, Q, cycles=4, robots=10, seed=7, target=target)
    for robot, of_robot in enumerate(poses):
        for p, forecast in enumerate(found.poses.values()):
            one = pp.iso9283_of(commanded[p], of_robot[p])
            for name in one:
                assert getattr(forecast, name).values[robot] == pytest.approx(one[name], abs=1e-12), (name, robot, p)
        apart = pp.iso9283_distance(commanded[[1, 3]], of_robot[[1, 3]])
        assert found.AD.values[robot] == pytest.approx(apart.AD, abs=1e-12)
        assert found.RD.values[robot] == pytest.approx(apart.RD, abs=1e-12)
    middles = poses[:, 0, :, :3, 3].mean(axis=1)
    for group, first in enumerate((0, 5)):
        pairs = itertools.combinations(middles[first : first + 5], 2)
        assert found.E.values[group] == pytest.approx(max(math.dist(*pair) for pair in pairs), abs=1e-12)
    assert found.E.values.size == 2
    worst = np.max([forecast.RP.values for forecast in found.poses.values()], axis=0)
    np.testing.assert_array_equal(found.worst["RP"].values, worst)


def test_best_fit_of_the_base(attained):
    commanded, poses = attained
    found = pp.iso9283(MIXED, Q, cycles=4, robots=10, seed=7, fit_base=True)
    for robot, of_robot in enumerate(poses):
        middles, points = of_robot[..., :3, 3].mean(axis=1), commanded[:, :3, 3]
        # weights 1, as scipy's fit turns vectors about the origin
        fit = Rotation.align_vectors(points - points.mean(axis=0), middles - middles.mean(axis=0))[0]
        moved = of_robot.copy()
        moved[..., :3, 3] = (moved[..., :3, 3] - middles.mean(axis=0)) @ fit.as_matrix().T + points.mean(axis=0)
        moved[..., :3, :3] = fit.as_matrix() @ moved[..., :3, :3]
        for p, forecast in enumerate(found.poses.values()):
            one = pp.iso9283_of(commanded[p], moved[p])
            for name in ("AP", "AP_x", "AP_y", "AP_z", "AP_a", "AP_b", "AP_c", "RP"):
                assert getattr(forecast, name).values[robot] == pytest.approx(one[name], abs=1e-9), (name, robot, p)
    plain = pp.iso9283(MIXED, Q, cycles=4, robots=10, seed=7)
    np.testing.assert_array_equal(found.E.values, plain.E.values)
    assert found.worst["AP"].mean < plain.worst["AP"].mean


# against theory ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("axes", "factor"), [("xyz", 3.616088), ("xy", 3.218723), ("z", 2.606315)])
def test_repeatability_of_normal_visits(axes, factor):
    model = tool_errors({axis: pp.Normal(20e-6) for axis in axes}, pp.Scope.VISIT)
    found = pp.iso9283(model, Q[:, :1], robots=4000).poses["P1"]
    assert found.RP_limit.mean == pytest.approx(factor * 20e-6, rel=1e-6)
    assert found.RP_limit.std < 1e-9 * found.RP_limit.mean
    # 30 cycles: the same law as of normal numbers made here
    cloud = 20e-6 * np.random.default_rng(1).normal(size=(4000, 30, len(axes)))
    lengths = np.linalg.norm(cloud - cloud.mean(axis=1)[:, None], axis=2)
    independent = lengths.mean(axis=1) + 3 * lengths.std(axis=1, ddof=1)
    assert stats.ks_2samp(found.RP.values, independent).pvalue > 1e-3
    if axes == "xyz":
        assert found.RP.mean / found.RP_limit.mean == pytest.approx(1 - 0.022, abs=0.005)


def test_limit_of_visits_that_are_not_normal():
    """On a line, uniform over ±t: mean t/2, standard deviation t/√12; the normal limit would be 10 % higher."""
    t = 30e-6
    found = pp.iso9283(tool_errors({"z": pp.Uniform(t)}, pp.Scope.VISIT), Q[:, :1], robots=5).poses["P1"]
    assert found.RP_limit.mean == pytest.approx(t / 2 + 3 * t / math.sqrt(12), rel=5e-3)


@pytest.mark.slow
def test_limit_of_each_robot_by_a_long_test():
    """Robots whose visits scatter differently: joint 2 moves the tool more where joint 3 is built farther out."""
    space = pp.Space((pp.Draw("built", pp.Normal(0.3)), pp.Draw("again", pp.Normal(1e-4), pp.Scope.VISIT)))
    sources = [JointOffset(joint=JOINTS[2], offset="built"), JointOffset(joint=JOINTS[1], offset="again")]
    model = pp.ErrorModel(CHAIN, space, sources)
    found = pp.iso9283(model, Q[:, :1], robots=20, cycles=4000).poses["P1"]
    assert found.RP_limit.std > 0.02 * found.RP_limit.mean
    np.testing.assert_allclose(found.RP.values, found.RP_limit.values, rtol=0.04)
    assert stats.pearsonr(found.RP.values, found.RP_limit.values).statistic > 0.9


@pytest.mark.slow
def test_accuracy_is_the_law_of_one_visit_where_visits_do_not_scatter():
    model = joint_errors([pp.Scope.UNIT] * 4)
    found = pp.iso9283(model, Q, robots=3000, seed=2)
    sampled = pp.sample_poses(model, Q, samples=3000, seed=2)
    for p, forecast in enumerate(found.poses.values()):
        assert forecast.AP.mean == pytest.approx(sampled.norm_mean[0, p], rel=1e-9)
        assert forecast.AP.std == pytest.approx(sampled.norm_std[0, p], rel=1e-9)
        low, high = sampled.quantile_interval[1, 0, :, p]
        assert low <= forecast.AP.quantile(0.95) <= high
        assert not forecast.RP.values.any()
        assert not forecast.RP_limit.values.any()


def test_encoder_resolution_belongs_to_accuracy():
    """A draw of a pose is the same in all cycles there, and another at the next pose."""
    found = pp.iso9283(joint_errors([pp.Scope.POSE] * 4), Q, robots=500)
    first, second = found.poses["P1"], found.poses["P2"]
    assert not first.RP.values.any()
    assert first.AP.values.min() > 0
    assert abs(stats.pearsonr(first.AP_x.values, second.AP_x.values).statistic) < 0.15
    assert found.E is None
    assert "unit" in found.absent["E"]


@pytest.mark.slow
def test_a_load_is_a_payload_of_the_sheet():
    load = pp.sources.Payload(at=CHAIN.tip, mass=4.0, com=(0.0, 0.02, 0.1))
    own = pp.ErrorModel(CHAIN, MODEL.space, [*MODEL.sources, load])
    found = pp.iso9283(MODEL, Q[:, :2], robots=20, load=4.0, target=(0.0, 0.02, 0.1))
    expected = pp.iso9283(own, Q[:, :2], robots=20, target=(0.0, 0.02, 0.1))
    np.testing.assert_allclose(found.poses["P2"].AP.values, expected.poses["P2"].AP.values, rtol=1e-12)
    assert found.poses["P2"].AP.mean > 1.5 * pp.iso9283(MODEL, Q[:, :2], robots=20).poses["P2"].AP.mean
    assert found.to_dict()["load"] == 4


def test_no_visits_is_warned_of():
    with pytest.warns(PrecisionPinWarning, match="W_NO_VISITS"):
        found = pp.iso9283(MODEL, [MODEL.configuration()], robots=2)
    assert any("W_NO_VISITS" in line for line in found.warnings)
    assert (found.poses["P1"].RP.mean, found.AD, found.E) == (0, None, None)
    assert {"AD", "RD", "E", "vAP", "RP_bidirectional", "drift"} == set(found.absent)


# form ----------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_same_bits_for_any_number_of_threads():
    calls: list[int] = []
    one = pp.iso9283(MIXED, Q, robots=1200, threads=1, progress=calls.append)
    assert sum(calls) == 1200 * 5 * 30
    assert one.to_json() == pp.iso9283(MIXED, Q, robots=1200, threads=3).to_json()
    # the first robots of a longer run are those of a shorter one
    fewer = pp.iso9283(MIXED, Q, robots=600)
    np.testing.assert_array_equal(one.poses["P2"].RP.values[:600], fewer.poses["P2"].RP.values)


def test_json_has_the_keys_that_users_rely_on():
    found = json.loads(pp.iso9283(MIXED, Q, robots=200).to_json())
    assert found["schema"] == "precision-pin/iso9283/1"
    assert {"complete", "robot", "base", "tip", "seed", "versions", "findings", "cube"} <= set(found)
    assert list(found["poses"]) == ["P1", "P2", "P3", "P4", "P5"]
    figures = {"AP", "RP", "AP_a", "AP_b", "AP_c", "RP_a", "RP_b", "RP_c", "RP_limit"}
    assert figures | {"q", "name"} <= set(found["poses"]["P1"])
    law = found["poses"]["P1"]["RP"]
    assert set(law) == {"mean", "std", "quantiles", "quantile_interval"}
    low, high = law["quantile_interval"]["0.95"]
    assert low <= law["quantiles"]["0.95"] <= high
    assert law["quantiles"]["0.9973"] is None  # 200 robots are too few
    assert (found["vAP"], found["drift"]) == (None, None)
    assert set(found["AD"]) == set(law)


@pytest.mark.slow
def test_limits_are_kept_at_every_pose():
    middle = pp.iso9283(MIXED, Q, robots=300).worst["RP"].quantile(0.5)
    limits = [f"RP {middle!r} m @ 60 %", "AD 1 mm", "E 100 mm", "RP_c 1 urad"]
    found = pp.iso9283(MIXED, Q, robots=300, specifications=limits)
    shares = [one.probability for one in found.specifications]
    assert shares[0] == np.mean(np.max([at.RP.values for at in found.poses.values()], axis=0) <= middle)
    assert shares[0] == 0.5
    assert shares[1] == np.mean(np.abs(found.AD.values) <= 1e-3)
    assert (shares[2], shares[3]) == (1, 0)
    assert not found.met
    assert [one["met"] for one in found.to_dict()["spec"]] == [one.met for one in found.specifications]
    assert pp.iso9283(MIXED, Q, robots=300, specifications="E 100 mm @ 90 %").met


@pytest.mark.slow
def test_data_frame_and_dataset():
    found = pp.iso9283(MIXED, Q, robots=50)
    frame = found.to_pandas()
    assert frame.loc[("P3", "RP"), "mean"] == found.poses["P3"].RP.mean
    assert frame.loc[("", "AD"), "std"] == found.AD.std
    assert "P1" in found._repr_html_()
    assert "5 poses" in repr(found)


def test_quantiles_of_a_law():
    law = FigureLaw(np.random.default_rng(3).permutation(100.0 + np.arange(101)), 0.95)
    assert law.quantile(0.5) == 150
    low, high = law.quantile_interval(0.5)
    assert stats.binom.cdf(high - 101, 101, 0.5) - stats.binom.cdf(low - 100, 101, 0.5) > 0.9
    assert law.quantile(0.9973) is None
    with pytest.raises(pp.InputError, match="above 0 and below 1"):
        law.quantile(1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cycles": 1}, "cycles must be a whole number from 2"),
        ({"cycles": 5000}, "cycles must be a whole number from 2 to 4095"),
        ({"robots": 0}, "robots must be a whole number from 1"),
        ({"target": (0, 0)}, "target must be three numbers"),
        ({"target": (0, 0, 1e9)}, "target must lie within 1,000 m"),
        ({"load": -1}, "the load must be zero or more and finite, in kg"),
        ({"poses": None}, "the model has no pose to take the tool's orientation from"),
        ({"specifications": "0.1 mm"}, "no figure of a specification named '0.1'"),
        ({"specifications": "RP"}, "write it as 'RP 0.1 mm @ 95 %'"),
        ({"specifications": "RP 1 mrad"}, "RP is limited by a length"),
        ({"specifications": "RP_a 1 mm"}, "RP_a is limited by an angle"),
        ({"specifications": "RP x 1 mm"}, "RP is limited by a length"),
        ({"poses": Q[:, :1], "specifications": "AD 1 mm"}, "limits AD, which this forecast does not have: between P2"),
        ({"poses": Q[:, :2], "fit_base": True}, "three poses or more"),
        ({"poses": np.tile(Q, 30)}, "1 to 100 poses"),
    ],
)
def test_wrong_requests_are_refused_in_a_line(arguments, message):
    with pytest.raises(pp.InputError, match=message):
        pp.iso9283(MIXED, **{"poses": Q, "robots": 3, **arguments})


# the standard's poses -------------------------------------------------------------------------------------------------


def largest_where(reach):
    """Return the largest cube where a function of points says what is within reach; points stand for joint values."""
    return largest_cube(lambda points, starts=None: np.where(reach(points), points, np.nan), -np.ones(3), np.ones(3))


@pytest.mark.slow
def test_the_largest_cube_of_a_ball_by_hand():
    # within a sphere of radius 1 the largest cube has the edge 2/√3
    side, centre = largest_where(lambda points: (points**2).sum(axis=0) <= 1)
    assert (1 - 1e-3) * 2 / math.sqrt(3) < side <= 2 / math.sqrt(3)
    assert np.abs(centre).max() < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("inner", [0.3, 0.6])
def test_the_largest_cube_of_a_shell_is_that_of_a_dense_grid_of_centres(inner):
    """Between two spheres, above a floor: the half edge at a centre is the least of three lengths in closed form."""

    def reach(points):
        size = (points**2).sum(axis=0)
        return (size <= 1) & (size >= inner**2) & (points[2] >= -0.4)

    def half_edges(centres):
        low, high = np.zeros(centres.shape[1]), np.ones(centres.shape[1])
        for _ in range(40):
            h = (low + high) / 2
            farthest = ((np.abs(centres) + h) ** 2).sum(axis=0)
            nearest = (np.maximum(np.abs(centres) - h, 0) ** 2).sum(axis=0)
            fits = (farthest <= 1) & (nearest >= inner**2) & (centres[2] - h >= -0.4)
            low, high = np.where(fits, h, low), np.where(fits, high, h)
        return low

    lines, around = [np.linspace(0, 1, 41), np.linspace(0, 1, 41), np.linspace(-0.4, 1, 57)], 0.03
    for _ in range(6):
        centres = np.array(np.meshgrid(*lines, indexing="ij")).reshape(3, -1)
        found = half_edges(centres)
        best = centres[:, found.argmax()]
        lines = [np.linspace(one - around, one + around, 21) for one in best]
        around /= 5
    largest = 2 * float(found.max())
    side, centre = largest_where(reach)
    assert (1 - 1e-3) * largest < side <= largest * (1 + 1e-9)
    assert 2 * half_edges(centre[:, None])[0] >= side


@pytest.mark.slow
def test_the_largest_cube_of_the_papers_arm_by_hand():
    """Reach is a ball about the shoulder without a smaller one: no cube beside that one with a face at its middle is larger.

    Branch and bound over the centres, with the cylinder about joint 1 that is out of reach, gave the same to 2e-5.
    """
    outer, inner = math.hypot(1.97 + 1.77, 0.274), math.hypot(1.97 - 1.77, 0.274)
    # the far corners: (inner + e)² + e²/4 + e²/4 = outer²
    edge = (-2 * inner + math.sqrt(4 * inner**2 - 6 * (inner**2 - outer**2))) / 3
    paper = ErrorModel.load(PAPER_SHEET)
    _, cube = standard_poses(paper.chain, paper.configuration(), np.zeros(3))
    assert edge == pytest.approx(2.83155, abs=1e-5)
    assert (1 - 1e-3) * edge < cube.side <= edge * (1 + 1e-5)


@pytest.mark.slow
def test_all_of_the_largest_cube_of_the_panda_is_within_reach():
    """Inverse kinematics in closed form, for angles of joint 7 that were scanned and refined, judges the same points alike.

    Out of reach is a pocket in the middle of a face: joints 2 and 4 are at their limits there. It keeps the edge from 0.4886 m.
    """
    panda = ErrorModel.load(shipped_sheets()["panda"])
    tool = ToolPoses(panda.chain, panda.at("ready").posture.pose[:3, :3], np.zeros(3))
    assert np.isfinite(tool.solve(lattice_of(0.4868, np.array([0.48157, -0.00028, 0.12271])))).all()
    larger = np.array([[0.48017], [0.0], [0.12261]]) + 0.24432 * np.array([[-1.0, -0.98], [0.0, 0.0], [0.23, 0.23]])
    assert np.isfinite(tool.solve(larger)[0]).tolist() == [False, True]


@pytest.mark.parametrize("joints", [7, 4])
def test_joint_values_of_a_search_put_the_point_where_plain_kinematics_say(joints):
    text = plain_robot.random_arm(3, joints=joints, prismatic=(3,))
    plain, chain = plain_robot.PlainRobot.parse(text), plain_robot.chain_of(text, tip="tool")

    def tips(q):
        poses = [plain.poses(dict(zip(chain.joint_names, one, strict=True)))["tool"] for one in q.T]
        return np.moveaxis(np.array(poses), 0, -1)

    q, target = np.random.default_rng(2).uniform(-1, 1, (joints, 60)), np.array([0.1, -0.2, 0.05])
    wanted = tips(q[:, :1])[:3, :3, 0]
    tool = ToolPoses(chain, wanted, target)
    begin = q + np.random.default_rng(3).uniform(-0.1, 0.1, q.shape)
    points = tips(q)[:3, 3] + np.einsum("ijp,j->ip", tips(q)[:3, :3], target)
    if joints == 7:  # the first pose alone has the orientation: points near its own, from its joint values
        points, begin = points[:, :1] + np.random.default_rng(4).uniform(-0.03, 0.03, (3, 60)), np.tile(q[:, :1], 60)
    kept = begin.copy()
    found = tool.solve(points, begin)
    assert (begin == kept).all()
    arrived = np.isfinite(found[0])
    assert arrived.sum() > 50
    pose = tips(found[:, arrived])
    reached = pose[:3, 3] + np.einsum("ijp,j->ip", pose[:3, :3], target)
    np.testing.assert_allclose(reached, points[:, arrived], rtol=0, atol=1e-6)
    if joints == 7:
        np.testing.assert_allclose(
            pose[:3, :3], np.repeat(wanted[:, :, None], arrived.sum(), axis=2), rtol=0, atol=2e-5
        )


@pytest.mark.parametrize("plane", range(4))
def test_points_of_the_cube_are_those_of_the_standard(plane):
    points = Cube(1.0, np.array([1.0, 2.0, 3.0]), plane).points() - np.array([[1.0], [2.0], [3.0]])
    assert np.abs(points[:, 0]).max() == 0
    assert np.abs(np.abs(points[:, 1:]) - 0.4).max() < 1e-12
    assert np.linalg.matrix_rank(points) == 2  # a diagonal plane through the centre
    assert points[:, 1] == pytest.approx(-points[:, 3])
    assert points[:, 2] == pytest.approx(-points[:, 4])


@pytest.mark.slow
def test_paths_along_the_base_axes_move_the_joints_as_differences_say():
    model = ErrorModel.load(shipped_sheets()["ur5"])
    q = model.poses["ready"]
    ways = paths_of_approach(model.chain.at(q).joint_jacobian)
    step = 1e-5
    for axis, way in enumerate(ways):
        goal = model.chain.at(q).pose.copy()
        goal[axis, 3] += step
        found = pp.inverse_kinematics(model.chain, goal, reference=q)
        moved = found.q[:, 0] - q
        moved[np.abs(moved) < 1e-4 * np.abs(moved).max()] = 0
        assert way == tuple(np.sign(moved).astype(int))


@pytest.mark.slow
def test_poses_that_are_left_out_are_found_in_the_workspace():
    # three slides of 0.6, 0.9 and 0.7 m reach a box, whose largest cube has its shortest edge
    limits = [f'<limit lower="0" upper="{top}" effort="1" velocity="1"/>' for top in (0.6, 0.9, 0.7)]
    gantry = plain_robot.chain_of(
        plain_robot.robot(
            *map(plain_robot.link, ("base", "bridge", "carriage", "ram", "tool")),
            plain_robot.joint("x", "prismatic", "base", "bridge", axis=(1, 0, 0), extra=limits[0]),
            plain_robot.joint("y", "prismatic", "bridge", "carriage", axis=(0, 1, 0), extra=limits[1]),
            plain_robot.joint("z", "prismatic", "carriage", "ram", axis=(0, 0, 1), extra=limits[2]),
            plain_robot.joint("flange", "fixed", "ram", "tool"),
        ),
        tip="tool",
    )  # fmt: skip
    draws = pp.Space((pp.Draw("again", pp.Normal(1e-4), pp.Scope.VISIT),))
    model = ErrorModel(gantry, draws, [JointOffset(joint="x", offset="again")], {"home": [0.1, 0.1, 0.1]})
    made = pp.iso9283(model, robots=64, cycles=4)
    assert 0.6 * (1 - 1e-3) < made.cube.side <= 0.6 + 1e-6
    assert made.to_dict()["cube"]["axes"] == "base"
    points = made.cube.points()
    for rank, pose in enumerate(made.poses.values()):
        assert list(pose.label.q.values()) == pytest.approx(points[:, rank], abs=1e-5)


@pytest.mark.slow
def test_variation_over_paths_of_approach():
    # nothing follows the direction in the paper's sheet; a backlash does
    paper = ErrorModel.load(PAPER_SHEET)
    turned = np.radians([45, 3, 88, -91])
    assert pp.iso9283(paper, [turned], robots=20, cycles=3).vAP is None
    play = [Backlash(joint="joint1", backlash=1e-3, band=50.0)]
    loose = ErrorModel(paper.chain, paper.space, [*paper.sources, *play], paper.poses)
    variation = pp.iso9283(loose, [turned], robots=20, cycles=3).vAP
    # along x the upright joint 1 turns one way, along y the other: it rests on both flanks, 1 mrad apart at the tip's radius
    ways = paths_of_approach(paper.chain.at(turned).joint_jacobian)
    assert ways[0][0] == -ways[1][0] != 0
    radius = math.hypot(*paper.chain.at(turned).pose[:2, 3])
    assert variation.quantile(0.5) == pytest.approx(1e-3 * radius, rel=0.02)
    # all cycles together, robot by robot, as if they were measured
    tested = pp.iso9283(loose, [turned], robots=5, cycles=3)
    visits = pp.sample_approaches(loose, turned, approaches=ways, robots=5, cycles=3).shifts.reshape(9, 3, 5)
    for robot, value in enumerate(tested.RP_bidirectional.values):
        attained = np.concatenate([visits[:, :, robot], np.zeros((9, 3))], axis=1)
        assert value == pytest.approx(pp.iso9283_of(np.zeros(6), attained)["RP"], rel=1e-9)


# warming up ----------------------------------------------------------------------------------------------------------


def warming(*sources: Thermal, joints: bool = False) -> pp.ErrorModel:
    draws = tuple(pp.Draw(f"again[{joint}]", pp.Normal(1e-5), pp.Scope.VISIT) for joint in JOINTS) if joints else ()
    again = [JointOffset(joint=joint, offset=draw.name) for joint, draw in zip(JOINTS, draws, strict=False)]
    return pp.ErrorModel(CHAIN, pp.Space((pp.Draw("change", pp.Uniform(3.0, mean=10.0)), *draws)), [*sources, *again])


@pytest.mark.slow
def test_drift_is_growth_of_the_arm_from_cold():
    """All links alike: the tip moves by α ΔT of its distance from the base."""
    model = warming(Thermal(expansion=2e-5, temperature_change="change", time_constant=2 * 3600.0))
    found = pp.iso9283(model, Q[:, :1], robots=200, seed=3).drift
    assert found is not None
    change = model.space.sample(3, 0, 200)[0]
    distance = np.linalg.norm(CHAIN.at(Q[:, 0]).pose[:3, 3])
    np.testing.assert_allclose(found.values, 2e-5 * change * distance * (1 - math.exp(-4)), rtol=1e-9)


@pytest.mark.slow
def test_drift_is_largest_on_the_way_where_two_errors_come_and_go():
    """One is there in no time, the other follows slowly against it; half an hour is the first time looked at."""
    quick = Thermal(expansion=2e-5, temperature_change="change", time_constant=60.0)
    slow = Thermal(expansion=-2e-5, temperature_change="change", time_constant=4 * 3600.0)
    model = warming(quick, slow)
    found = pp.iso9283(model, Q[:, :1], robots=5).drift
    assert found is not None
    growth = 2e-5 * model.space.sample(0, 0, 5)[0] * np.linalg.norm(CHAIN.at(Q[:, 0]).pose[:3, 3])
    np.testing.assert_allclose(found.values, growth * math.exp(-0.125), rtol=1e-9)


@pytest.mark.slow
def test_drift_of_a_robot_that_scatters_by_a_plain_loop():
    model = warming(Thermal(expansion=2e-5, temperature_change="change", time_constant=3600.0), joints=True)
    found = pp.iso9283(model, Q[:, :1], robots=3, cycles=4, target=(0.0, 0.05, 0.1)).drift
    assert found is not None
    tip = CHAIN.at(Q[:, 0]).pose
    for robot in range(3):
        accuracy = []
        for k, hours in enumerate(np.linspace(0, 8, 17)):
            share = 1 - math.exp(-hours)
            at = warming(Thermal(expansion=2e-5 * share, temperature_change="change"), joints=True).at(Q[:, 0])
            visits = [at.exact(model.space.sample(0, robot, 1, visit=4 * k + cycle))[:, 0] for cycle in range(4)]
            lever = tip[:3, :3] @ (0.0, 0.05, 0.1)
            ways = [one[:3] + Rotation.from_rotvec(one[3:]).apply(lever) - lever for one in visits]
            accuracy.append(np.linalg.norm(np.mean(ways, axis=0)))
        assert found.values[robot] == pytest.approx(np.abs(np.array(accuracy) - accuracy[0]).max(), rel=1e-6)
