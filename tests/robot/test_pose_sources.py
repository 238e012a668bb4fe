"""Poses: grids, sets, random designs and trajectories by hand and by forward kinematics, and directions of approach."""

import math
from typing import Any

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.robot.chain import Chain
from precision_pin.robot.configurations import approaches_along, read_approach, written_approach
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.joint_columns import joint_columns
from precision_pin.robot.pose_set import NO_BRANCH, PoseSet, smallest_singular_values
from support.oracles import ur5_branches, ur5_pose
from support.plain_robot import chain_of, gantry, joint, limits, link, planar_arm, robot


def test_a_joint_grid_has_every_combination_the_last_joint_first():
    poses = pp.joint_grid(gantry(), {"c": [0, math.pi / 6, 1.5], "x": [0.1, 0.2], "y": 0, "z": 0.5})
    right = math.pi / 6
    assert poses.q.T.tolist() == [
        [0.1, 0, 0.5, 0], [0.1, 0, 0.5, right], [0.1, 0, 0.5, 1.5], [0.2, 0, 0.5, 0], [0.2, 0, 0.5, right], [0.2, 0, 0.5, 1.5]
    ]  # fmt: skip
    assert poses.names[:2] == ("100 mm 0°", "100 mm 30°")
    assert poses.status == ("reached", "reached", "limit") * 2
    assert poses.node is None


@pytest.mark.slow
def test_a_place_grid_of_a_gantry_by_hand():
    # the tool turns by 1 rad at most: of four angles a quarter of a turn apart one is within
    places = pp.plane_places((0, 0, 0.5), (0, 2, 0), (0, 0, 1), [-0.5, 1.5], [0, 0.25])
    np.testing.assert_allclose(places, [[0] * 4, [-0.5, -0.5, 1.5, 1.5], [0.5, 0.75, 0.5, 0.75]])
    kinds = [pp.Orientation.free(), pp.Orientation.along((0, 0, 3), 4), pp.Orientation.given((0, 0, 0.5))]
    poses = pp.place_grid(gantry(), places, kinds)
    assert poses.node.tolist() == [node for node in range(12) for _ in range(4 if node % 3 == 1 else 1)]
    at_first = ("reached", "reached", "limit", "limit", "limit", "reached")
    assert poses.status == at_first * 2 + ("limit",) * 12
    np.testing.assert_allclose(poses.q[:3, [0, 1, 5]].T, [[0, -0.5, 0.5]] * 3, atol=1e-9)
    np.testing.assert_allclose(poses.q[3, [1, 5]], [0, 0.5], atol=1e-9)
    assert poses.names[:3] == ("0 -500 500 mm", "0 -500 500 mm, axis 0 0 1, 0°", "0 -500 500 mm, axis 0 0 1, 90°")
    assert poses.names[5] == "0 -500 500 mm, rpy 0 0 28.6479°"
    np.testing.assert_array_equal(poses.position[:, -1], [0, 1.5, 0.75])


@pytest.mark.slow
def test_every_node_of_a_ur5_is_reached_with_its_branches():
    ur5 = Chain.from_urdf(example_urdfs()["ur5"], tip="tool0")
    places = pp.box_places(x=[0.35, 0.6], y=0.2, z=0.3)
    direction = np.array([0.6, 0, -0.8])
    kinds = [pp.Orientation.along(direction, 3), pp.Orientation.along(direction)]
    poses = pp.place_grid(ur5, places, kinds, branches="all")
    assert poses.known.all()
    reached = np.moveaxis([ur5_pose(q) for q in poses.q.T], 0, -1)
    assert np.abs(reached[:3, 3] - places[:, poses.node // 2]).max() < 1e-9
    assert np.abs(reached[:3, 2] - direction[:, None]).max() < 1e-9
    for node in range(0, 4, 2):
        own = reached[:, :, poses.node == node]
        # a third of a turn about the direction at a time, in every branch
        turns = own[:3, 0].T @ np.cross(direction, own[:3, 0, 0]), own[:3, 0].T @ own[:3, 0, 0]
        thirds = np.rint(np.arctan2(*turns) / (2 * math.pi / 3)) % 3
        wanted = [own[:, :, thirds == third] for third in range(3)]
        assert [one.shape[2] for one in wanted] == [len(ur5_branches(one[:, :, 0])) for one in wanted]


def test_best_and_worst_compare_the_poses_of_a_node():
    planar = planar_arm(shoulder=3, elbow=(-3, 0.5))
    # nearly stretched; at a right angle, which the elbow allows on one side; folded a little; too far
    places = np.array([[0.999999, 0.5, 0.98, 0], [0, 0.5, 0, 2], [0] * 4])
    poses = pp.place_grid(planar, places, pp.Orientation.free(), branches="all")
    assert poses.status == ("reached",) * 5 + ("unreachable",)
    assert poses.node.tolist() == [0, 0, 1, 2, 2, 3]
    elbows = poses.q[1]
    np.testing.assert_allclose(elbows[2], -math.pi / 2, atol=1e-9)
    np.testing.assert_allclose(np.abs(elbows[3:5]), 2 * math.acos(0.98), atol=1e-9)
    best, worst = poses.best_and_worst([3, 1, 2, 7, 7, math.nan])
    assert best.tolist() == [1, 2, 3, -1]
    assert worst.tolist() == [0, 2, 3, -1]
    with pytest.raises(InputError, match=r"values of shape \(2,\) for 6 poses, expected \(6,\)"):
        poses.best_and_worst([1, 2])


def test_of_several_branches_the_best_has_the_largest_singular_value():
    # a tool beside the wrist makes the elbow up and down differ
    beside = chain_of(
        robot(
            link("base"), link("column"), link("upper"), link("lower"), link("tool"),
            joint("turn", "revolute", "base", "column"),
            joint("shoulder", "revolute", "column", "upper", (0.2, 0, 0.4), axis=(0, 1, 0)),
            joint("elbow", "revolute", "upper", "lower", (0.5, 0, 0), axis=(0, 1, 0)),
            joint("flange", "fixed", "lower", "tool", (0.4, 0.1, 0)),
        )
    )  # fmt: skip
    place = np.array([[0.5], [0.2], [0.3]])
    every, best = (pp.place_grid(beside, place, pp.Orientation.free(), branches=which) for which in ("all", "best"))
    assert len(every) == 4
    length = math.hypot(0.2, 0.4) + 0.5 + math.hypot(0.4, 0.1)
    values = [
        np.linalg.svd(np.diag([1 / length] * 3 + [1] * 3) @ beside.at(q).joint_jacobian)[1][-1] for q in every.q.T
    ]
    np.testing.assert_array_equal(best.q[:, 0], every.q[:, int(np.argmax(values))])
    assert np.ptp(values) > 0.005
    assert best.names == ("500 200 300 mm",)


@pytest.mark.slow
def test_a_random_design_lies_evenly_over_joints_or_places(monkeypatch):
    table = gantry()
    joints = pp.random_poses(table, 2000, seed=3)
    assert joints.known.all()
    assert set(joints.status) == {"reached"}
    # uniform over ±1: means and squares within four standard errors
    assert np.abs(joints.q.mean(axis=1)).max() < 4 / math.sqrt(3 * 2000)
    assert np.abs((joints.q**2).mean(axis=1) - 1 / 3).max() < 4 * math.sqrt(4 / 45 / 2000)
    assert np.abs(np.corrcoef(joints.q) - np.eye(4)).max() < 4 / math.sqrt(2000)
    # the same for a seed, the smaller design at the begin of the larger, however many are drawn together
    monkeypatch.setattr("precision_pin.robot.pose_grids._MOST", 48)
    np.testing.assert_array_equal(pp.random_poses(table, 100, seed=3).q, joints.q[:, :100])
    assert (pp.random_poses(table, 100, seed=4).q != joints.q[:, :100]).all()
    kinds = [pp.Orientation.along((0, 0, 1), 8), pp.Orientation.given((0, 0, 2.5))]
    places = pp.random_poses(table, 60, seed=3, box=[[0.5, 1.1], [-1, 1], [0, 0]], orientations=kinds)
    # a sixth of the box is out of reach in x; of nine attitudes three are within the limits of ±1 rad
    assert places.known.all()
    assert (places.position[0] <= 1).all()
    assert abs(places.position[0].mean() - 0.75) < 4 * 0.5 / math.sqrt(12 * 60)
    assert abs(places.position[1].mean()) < 4 * 2 / math.sqrt(12 * 60)
    turns = np.round(np.degrees(places.q[3])).astype(int)
    counts = [int((turns == angle).sum()) for angle in (-45, 0, 45)]
    assert sum(counts) == 60
    assert min(counts) > 60 / 3 - 4 * math.sqrt(60 * 2 / 9)
    reached = table.at_columns(places.q).pose[:3, 3]
    assert np.abs(reached - places.position).max() < 1e-9
    few = pp.random_poses(table, 4, seed=3, box=[[0.5, 1.1], [-1, 1], [0, 0]], orientations=kinds)
    np.testing.assert_array_equal(few.q, places.q[:, :4])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda arm: pp.joint_grid(arm, {"x": 0, "y": 0}), "no values for the joints z, c; a joint that is held has one value"),
        (lambda arm: pp.joint_grid(arm, {"x": 0, "y": 0, "z": [], "c": 0}), r"values of z: expected one or several numbers"),
        (lambda arm: pp.joint_grid(arm, dict.fromkeys("xyzc", np.zeros(40))), "40 × 40 × 40 × 40 = 2,560,000 poses; at most"),
        (lambda arm: pp.plane_places((0, 0, 0), (1, 0, 0), (1, 1, 0), 0, 0), "u and v of the plane are not at right angles"),
        (lambda arm: pp.place_grid(arm, np.zeros((3, 0)), pp.Orientation.free()), r"expected \(3,\) or \(3, N\) with at least"),
        (lambda arm: pp.place_grid(arm, (0, 0, 0), []), "no orientations; give at least one"),
        (lambda arm: pp.place_grid(arm, (0, 0, 0), pp.Orientation.free(), branches="worst"), "branches must be nearest or best"),
        (lambda arm: pp.random_poses(arm, 5, box=[[5, 6]] * 3), "only 0 of 10,016 random poses are within reach and in the box"),
        (lambda arm: pp.random_poses(arm, 5, box=[[6, 5]] * 3), "the box: its lowest x is above its highest"),
        (lambda arm: pp.random_poses(arm, 0), "the number of poses"),
        (lambda arm: pp.Orientation.along((0, 0, 1), 0), "the number of angles about the tool axis"),
    ],
)  # fmt: skip
def test_wrong_grids_are_refused(make, message):
    with pytest.raises(InputError, match=message) as caught:
        make(gantry())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("half", [0.5, 500.0])
def test_smallest_singular_value_by_hand(half):
    # straight: levers 1 and 1/2 of the length, so Jᵀ J = [[2, 3/2], [3/2, 5/4]]; the size of the arm does not matter
    found = smallest_singular_values(planar_arm(half=half), np.zeros((2, 1)))
    assert found == pytest.approx([math.sqrt((3.25 - math.sqrt(3.25**2 - 4 * 0.25)) / 2)], rel=1e-12)


def test_two_coaxial_joints_are_singular():
    wrist = chain_of(
        robot(
            link("base"), link("one"), link("two"), link("tool"),
            joint("roll", "revolute", "base", "one"),
            joint("twist", "revolute", "one", "two", (0, 0, 0.5)),
            joint("flange", "fixed", "two", "tool", (0.2, 0, 0.5)),
        )
    )  # fmt: skip
    assert PoseSet.at(wrist, np.array([[0.3], [0.2]])).status == ("singular",)


def test_statuses_positions_and_selection():
    q = np.array([[0.0, 1.5, 0.5], [0.0, 0.0, math.pi / 2]])
    poses = PoseSet.at(planar_arm(shoulder=1), q, ("home", "", "bent"), times=np.array([0.0, 1.0, 2.0]))
    assert poses.status == ("reached", "limit", "reached")
    assert poses.labels == ["home", "pose 2", "bent"]
    assert (poses.branch == NO_BRANCH).all()
    assert poses.position[:, 0] == pytest.approx([1, 0, 0])
    assert poses.position[:, 2] == pytest.approx(
        [0.5 * (math.cos(0.5) - math.sin(0.5)), 0.5 * (math.sin(0.5) + math.cos(0.5)), 0]
    )
    chosen = poses.of(np.array([True, False, True]))
    assert chosen.names == ("home", "bent")
    assert chosen.times == pytest.approx([0, 2])
    np.testing.assert_array_equal(chosen.q, q[:, [0, 2]])
    assert chosen.known.all()

    with pytest.raises(InputError, match="no poses; give at least one"):
        poses.of(np.array([False, False]))
    with pytest.raises(InputError, match="have 1, 3 poses, expected one number"):
        PoseSet(poses.q, ("one",), poses.status, poses.branch, poses.position)


JOINTS = ("base", "upper arm", "wrist")


@pytest.mark.parametrize(
    "approach",
    [
        "base +, wrist -",
        " wrist - ,upper arm 0,  base +1",
        {"wrist": -1, "base": 1.0, "upper arm": 0},
        ["+", "0", "-"],
        (1, 0, -1),
        np.array([1, 0, -1], dtype=np.int8),
        np.array(["+", "0", "-"]),
    ],
)
def test_every_way_to_write_one(approach: Any) -> None:
    found = read_approach(JOINTS, approach)
    assert found == (1, 0, -1)
    assert all(type(sign) is int for sign in found)
    assert written_approach(JOINTS, found) == {"base": "+", "wrist": "-"}
    assert not any(read_approach(JOINTS, type(approach)() if isinstance(approach, list | tuple) else {}))


@pytest.mark.parametrize(
    ("approach", "message"),
    [
        ("wrst +", "no joint on the chain named 'wrst'; did you mean 'wrist'"),
        ("wrist up", r"the approach of wrist must be \+, - or 0, got 'up'"),
        ("wrist", "'wrist' is no approach; write a joint and .*, or 'previous'"),
        ("base +, base -", "the approach of the joint 'base' is given twice"),
        ({"base": 2}, "got 2"),
        ({"base": True}, "got True"),
        ([1, -1], "2 directions of approach for 3 joints; expected base, upper arm, wrist"),
        (1, "an approach is"),
    ],
)
def test_a_wrong_one_is_told_in_a_line(approach: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_approach(JOINTS, approach)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, UnknownNameError) == ("no joint" in message)


def test_from_the_poses_before() -> None:
    q = np.array(
        [
            [0.0, 0.1, 0.1, 0.1, -0.2],
            [1.0, 1.0, 1.0, 0.5, 0.5],
            [0.3, 0.3 + 1e-14, 0.3, 0.3, 0.3],
        ]
    )
    # a joint that rests keeps the direction of its last motion; before the first it is not known
    assert approaches_along(q).tolist() == [[0, 1, 1, 1, -1], [0, 0, 0, -1, -1], [0, 0, 0, 0, 0]]
    assert approaches_along(q[:, :1]).tolist() == [[0], [0], [0]]


# --- trajectories ---


@pytest.fixture(scope="module")
def chain() -> Chain:
    return chain_of(
        robot(
            link("base"), link("carriage"), link("tool"),
            joint("rail", "prismatic", "base", "carriage", axis=(1, 0, 0), extra=limits(-1, 1)),
            joint("swing [old]", "revolute", "carriage", "tool", (0, 0, 0.5), axis=(0, 1, 0), extra=limits(-1, 1)),
        )
    )  # fmt: skip


def way(folder, chain, text, most=1000):
    (folder / "way.csv").write_text(text)
    return pp.read_trajectory(folder / "way.csv", chain, most)


WAY = "time [ms], swing [old] [deg], rail [mm]\n0,0,0\n500,30,100\n750,30,200\n2000,90,-1100\n"


def test_units_of_the_header(tmp_path, chain):
    read = way(tmp_path, chain, WAY)
    np.testing.assert_allclose(read.times, [0, 0.5, 0.75, 2], rtol=1e-15)
    np.testing.assert_allclose(read.values[:, 0], [0, 0.1, 0.2, -1.1], rtol=1e-15)
    np.testing.assert_allclose(read.values[:, 1], np.radians([0, 30, 30, 90]), rtol=1e-15)
    written = {column.heading: column.factor for column in joint_columns(("swing", "rail"), (False, True))}
    assert written == pytest.approx({"swing [deg]": math.radians(1), "rail [mm]": 1e-3})
    plain = way(tmp_path, chain, "t,swing [old],rail\n0,0,0\n0.5,0.25,0.1\n")
    np.testing.assert_array_equal(plain.values, [[0, 0], [0.1, 0.25]])
    poses = read.poses
    assert poses.status == ("reached", "reached", "reached", "limit")
    assert poses.names == ("t = 0 s", "t = 0.5 s", "t = 0.75 s", "t = 2 s")
    np.testing.assert_array_equal(poses.times, read.times)


def test_poses_between_the_rows_by_hand(tmp_path, chain):
    read = way(tmp_path, chain, WAY)
    finer = read.refined(time_step=0.5)
    np.testing.assert_allclose(finer.times, [0, 0.5, 0.75, 0.75 + 1.25 / 3, 0.75 + 2.5 / 3, 2], rtol=1e-15)
    third = (1.3 / 3, math.pi / 9)
    np.testing.assert_allclose(finer.values[3], [0.2 - third[0], math.pi / 6 + third[1]], rtol=1e-14)
    assert [float(f"{row:.4f}") for row in finer.rows] == [1, 2, 3, 3.3333, 3.6667, 4]
    # 30 deg in four parts, nothing, 60 deg in eight
    turned = read.refined(angle_step=math.radians(7.5))
    assert len(turned.times) == 1 + 4 + 1 + 8
    assert np.abs(np.diff(turned.values[:, 1])).max() <= math.radians(7.5) * (1 + 1e-12)
    # 0.1 m in two, 0.1 m in two, 1.3 m in 26; with a time step at once the finer one counts
    for steps in ({"length_step": 0.05}, {"length_step": 0.05, "time_step": 1.0}):
        assert len(read.refined(**steps).times) == 1 + 2 + 2 + 26
    for finer_way in (finer, turned):
        rows = np.flatnonzero(finer_way.rows % 1 == 0)
        np.testing.assert_array_equal(finer_way.values[rows], read.values)
        np.testing.assert_array_equal(finer_way.times[rows], read.times)
    untimed = way(tmp_path, chain, "rail [mm],swing [old]\n0,0\n100,0\n").refined(length_step=0.03)
    assert untimed.names == ("row 1", "row 1.25", "row 1.5", "row 1.75", "row 2")
    np.testing.assert_array_equal(read.refined().values, read.values)


def test_many_plain_rows_are_those_of_the_file_and_their_reading_is_in_view(tmp_path, chain, monkeypatch):
    monkeypatch.setattr("precision_pin.robot.trajectory._AT_ONCE", 7)
    monkeypatch.setattr("precision_pin.robot.pose_set._AT_ONCE", 6)
    values = np.random.default_rng(3).uniform(-1, 1, (20, 2))
    lines = ["t [ms],swing [old], rail [cm]", *(f"{k}, {a!r} ,{b!r}\r" for k, (a, b) in enumerate(values.tolist())), ""]
    read_at, posed = [], []
    (tmp_path / "many.csv").write_text("\n\n".join(lines), newline="")
    read = pp.read_trajectory(tmp_path / "many.csv", chain, progress=read_at.append)
    np.testing.assert_array_equal(read.values, values[:, ::-1] * [0.01, 1])
    np.testing.assert_allclose(read.times, np.arange(20) / 1000, rtol=1e-15)
    # 20 rows between blank lines, seven lines at a time; of the header nothing is said
    assert len(read_at) == 6
    assert sum(read_at) == len("\n\n".join(lines).replace("\r\n", "\n")) - len(lines[0]) - 1
    assert read.pose_set(posed.append).status == read.poses.status
    assert posed == [6, 6, 6, 2]
    np.testing.assert_allclose(read.poses.position[0], values[:, 1] / 100, atol=1e-12)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ({17: "17,nan,0"}, r"way.csv:18: .* 'nan' is not a finite number"),
        ({14: "13,0,0"}, r"way.csv:15: .* the time stands still at 13 s"),  # the first row of a part
        ({21: "21,0,0"}, r"way.csv:22: .* more than 20 poses"),
        ({9: '"9",0,"\n0"', 12: "12,0"}, r"way.csv:14: .* 2 values for 3 columns"),  # a row of two lines before it
    ],
)
def test_a_wrong_row_far_down_is_named_by_its_line(tmp_path, chain, monkeypatch, rows, message):
    """Rows are read seven lines at a time."""
    monkeypatch.setattr("precision_pin.robot.trajectory._AT_ONCE", 7)
    text = {0: "t,swing [old],rail", **{k: f"{k},0,0" for k in range(1, 21)}, **rows}
    with pytest.raises(InputError, match=message):
        way(tmp_path, chain, "\n".join(text.values()), most=20)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rail [deg],swing [old]\n0,0\n", "1: error E_TRAJECTORY: rail [deg]: 'deg' is not a unit of length; allowed: m, cm"),
        ("time [m],rail,swing [old]\n0,0,0\n", "time [m]: 'm' is not a unit of time; allowed: s, ms, min"),
        ("rail,rail [mm],swing [old]\n0,0,0\n", "the joint 'rail' has two columns"),
        ("rail,swing [deg]\n0,0\n", "the column 'swing' is no joint of the chain; did you mean 'swing [old]'?"),
        ("rail [cm],swing [old]\n0,x\n", "2: error E_TRAJECTORY: swing [old]: 'x' is not a finite number"),
    ],
)  # fmt: skip
def test_wrong_units_are_refused_by_column(tmp_path, chain, text, message):
    with pytest.raises(InputError) as caught:
        way(tmp_path, chain, text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_steps_are_refused(tmp_path, chain):
    untimed = way(tmp_path, chain, "rail,swing [old]\n0,0\n1,0\n")
    for steps, message in (
        ({"time_step": 0.1}, "time_step: the trajectory has no times"),
        ({"length_step": 1e-6, "most": 1000}, "the steps make 1,000,001 poses; at most 1,000 are allowed"),
        ({"length_step": 1e-300}, "at most 1,048,575 are allowed"),
        ({"angle_step": 0.0}, "angle_step must be positive"),
    ):
        with pytest.raises(InputError, match=message):
            untimed.refined(**steps)
