"""Poses: grids and sets by hand and by forward kinematics, the direction of approach, branches of the inverse."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.robot.approach import approaches_along, read_approach, written_approach
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.pose_set import NO_BRANCH, PoseSet, smallest_singular_values
from support.oracles import ur5_branches, ur5_pose
from support.plain_robot import chain_of, joint, link, robot


def gantry() -> Chain:
    """Return a table that slides along x and y and lifts along z, with a turning tool."""
    limits = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    return chain_of(
        robot(
            link("base"), link("bridge"), link("carriage"), link("ram"), link("tool"),
            joint("x", "prismatic", "base", "bridge", axis=(1, 0, 0), extra=limits),
            joint("y", "prismatic", "bridge", "carriage", axis=(0, 1, 0), extra=limits),
            joint("z", "prismatic", "carriage", "ram", axis=(0, 0, 1), extra=limits),
            joint("c", "revolute", "ram", "tool", axis=(0, 0, 1), extra=limits),
        )
    )  # fmt: skip


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
    if "ur5" not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    ur5 = Chain.from_urdf(example_urdfs()["ur5"], tip="tool0")
    places = pp.box_places(x=[0.35, 0.6], y=0.2, z=[0.2, 0.4])
    direction = np.array([0.6, 0, -0.8])
    kinds = [pp.Orientation.along(direction, 3), pp.Orientation.along(direction)]
    poses = pp.place_grid(ur5, places, kinds, branches="all")
    assert poses.known.all()
    reached = np.moveaxis([ur5_pose(q) for q in poses.q.T], 0, -1)
    assert np.abs(reached[:3, 3] - places[:, poses.node // 2]).max() < 1e-9
    assert np.abs(reached[:3, 2] - direction[:, None]).max() < 1e-9
    counts = []
    for node in range(0, 8, 2):
        own = np.flatnonzero(poses.node == node)
        first = own[0]
        # a third of a turn about the direction at a time
        for third in range(3):
            wanted = reached[:, :, first].copy()
            along = np.array([[0, 0.8, 0], [-0.8, 0, -0.6], [0, 0.6, 0]])
            turn = np.eye(3) + math.sin(third * 2 * math.pi / 3) * along
            turn += (1 - math.cos(third * 2 * math.pi / 3)) * along @ along
            wanted[:3, :3] = turn @ wanted[:3, :3]
            same = [k for k in own if np.abs(reached[:, :, k] - wanted).max() < 1e-6]
            assert len(same) == len(ur5_branches(wanted))
            counts.append(len(same))
        assert sum(counts[-3:]) == len(own)
    assert max(counts) == 8


def test_best_and_worst_compare_the_poses_of_a_node():
    limits = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'
    arm = chain_of(
        robot(
            link("base"), link("upper"), link("lower"), link("tool"),
            joint("shoulder", "revolute", "base", "upper", extra=limits.format(-3, 3)),
            joint("elbow", "revolute", "upper", "lower", (0.5, 0, 0), extra=limits.format(-3, 0.5)),
            joint("flange", "fixed", "lower", "tool", (0.5, 0, 0)),
        )
    )  # fmt: skip
    # nearly stretched; at a right angle, which the elbow allows on one side; folded a little; too far
    places = np.array([[0.999999, 0.5, 0.98, 0], [0, 0.5, 0, 2], [0] * 4])
    poses = pp.place_grid(arm, places, pp.Orientation.free(), branches="all")
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
    arm = chain_of(
        robot(
            link("base"), link("column"), link("upper"), link("lower"), link("tool"),
            joint("turn", "revolute", "base", "column"),
            joint("shoulder", "revolute", "column", "upper", (0.2, 0, 0.4), axis=(0, 1, 0)),
            joint("elbow", "revolute", "upper", "lower", (0.5, 0, 0), axis=(0, 1, 0)),
            joint("flange", "fixed", "lower", "tool", (0.4, 0.1, 0)),
        )
    )  # fmt: skip
    place = np.array([[0.5], [0.2], [0.3]])
    every, best = (pp.place_grid(arm, place, pp.Orientation.free(), branches=which) for which in ("all", "best"))
    assert len(every) == 4
    length = math.hypot(0.2, 0.4) + 0.5 + math.hypot(0.4, 0.1)
    values = [np.linalg.svd(np.diag([1 / length] * 3 + [1] * 3) @ arm.at(q).joint_jacobian)[1][-1] for q in every.q.T]
    np.testing.assert_array_equal(best.q[:, 0], every.q[:, int(np.argmax(values))])
    assert np.ptp(values) > 0.005
    assert best.names == ("500 200 300 mm",)


@pytest.mark.slow
def test_a_random_design_lies_evenly_over_joints_or_places(monkeypatch):
    arm = gantry()
    joints = pp.random_poses(arm, 2000, seed=3)
    assert joints.known.all()
    assert set(joints.status) == {"reached"}
    # uniform over ±1: means and squares within four standard errors
    assert np.abs(joints.q.mean(axis=1)).max() < 4 / math.sqrt(3 * 2000)
    assert np.abs((joints.q**2).mean(axis=1) - 1 / 3).max() < 4 * math.sqrt(4 / 45 / 2000)
    assert np.abs(np.corrcoef(joints.q) - np.eye(4)).max() < 4 / math.sqrt(2000)
    # the same for a seed, the smaller design at the begin of the larger, however many are drawn together
    monkeypatch.setattr("precision_pin.robot.random_poses._MOST", 48)
    np.testing.assert_array_equal(pp.random_poses(arm, 100, seed=3).q, joints.q[:, :100])
    assert (pp.random_poses(arm, 100, seed=4).q != joints.q[:, :100]).all()
    kinds = [pp.Orientation.along((0, 0, 1), 8), pp.Orientation.given((0, 0, 2.5))]
    places = pp.random_poses(arm, 60, seed=3, box=[[0.5, 1.5], [-1, 1], [0, 0]], orientations=kinds)
    # half of the box is out of reach in x; of nine attitudes three are within the limits of ±1 rad
    assert places.known.all()
    assert (places.position[0] <= 1).all()
    assert abs(places.position[0].mean() - 0.75) < 4 * 0.5 / math.sqrt(12 * 60)
    assert abs(places.position[1].mean()) < 4 * 2 / math.sqrt(12 * 60)
    turns = np.round(np.degrees(places.q[3])).astype(int)
    counts = [int((turns == angle).sum()) for angle in (-45, 0, 45)]
    assert sum(counts) == 60
    assert min(counts) > 60 / 3 - 4 * math.sqrt(60 * 2 / 9)
    reached = arm.at_columns(places.q).pose[:3, 3]
    assert np.abs(reached - places.position).max() < 1e-9
    few = pp.random_poses(arm, 10, seed=3, box=[[0.5, 1.5], [-1, 1], [0, 0]], orientations=kinds)
    np.testing.assert_array_equal(few.q, places.q[:, :10])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda arm: pp.joint_grid(arm, {"x": 0, "y": 0}), "no values for the joints z, c; a joint that is held has one value"),
        (lambda arm: pp.joint_grid(arm, {"x": 0, "y": 0, "z": [], "c": 0}), r"values of z: expected one or several numbers"),
        (lambda arm: pp.joint_grid(arm, {"w": 0}), "no joint on the chain named 'w'"),
        (lambda arm: pp.joint_grid(arm, dict.fromkeys("xyzc", np.zeros(40))), "40 × 40 × 40 × 40 = 2,560,000 poses; at most"),
        (lambda arm: pp.plane_places((0, 0, 0), (1, 0, 0), (1, 1, 0), 0, 0), "u and v of the plane are not at right angles"),
        (lambda arm: pp.plane_places((0, 0, 0), (1, 0, 0), (0, 0, 0), 0, 0), "the direction v of the plane has length 0"),
        (lambda arm: pp.place_grid(arm, np.zeros((3, 0)), pp.Orientation.free()), r"expected \(3,\) or \(3, N\) with at least"),
        (lambda arm: pp.place_grid(arm, (0, 0, 0), []), "no orientations; give at least one"),
        (lambda arm: pp.place_grid(arm, (0, 0, 0), pp.Orientation.free(), branches="worst"), "branches must be nearest or best"),
        (lambda arm: pp.Orientation.given(np.diag([1, 1, -1])), "the orientation is no rotation"),
        (lambda arm: pp.Orientation.along((0, 0, 0)), "the direction has length zero"),
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


def arm(*, millimetres: bool = False):
    """Return a planar arm with two links of half a metre, or the same arm a thousand times as large."""
    half = 500.0 if millimetres else 0.5
    return chain_of(
        robot(
            link("base"), link("upper"), link("lower"), link("tool"),
            joint("shoulder", "revolute", "base", "upper", extra='<limit lower="-1" upper="1" effort="1" velocity="1"/>'),
            joint("elbow", "revolute", "upper", "lower", (half, 0, 0)),
            joint("flange", "fixed", "lower", "tool", (half, 0, 0)),
        )
    )  # fmt: skip


@pytest.mark.parametrize("millimetres", [False, True])
def test_smallest_singular_value_by_hand(millimetres):
    # straight: levers 1 and 1/2 of the length, so Jᵀ J = [[2, 3/2], [3/2, 5/4]]; the size of the arm does not matter
    found = smallest_singular_values(arm(millimetres=millimetres), np.zeros((2, 1)))
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
    poses = PoseSet.at(arm(), q, ("home", "", "bent"), times=np.array([0.0, 1.0, 2.0]))
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


def test_wrong_sets_are_refused():
    poses = PoseSet.at(arm(), np.zeros((2, 2)))
    with pytest.raises(InputError, match="no poses; give at least one"):
        poses.of(np.array([False, False]))
    with pytest.raises(InputError, match="have 1, 2 poses, expected one number"):
        PoseSet(poses.q, ("one",), poses.status, poses.branch, poses.position)


JOINTS = ("base", "upper arm", "wrist")


@pytest.mark.parametrize(
    "approach",
    [
        "base +, wrist -",
        " wrist - ,upper arm 0,  base +1",
        {"wrist": "-", "base": "+"},
        {"wrist": -1, "base": 1.0, "upper arm": 0},
        ["+", "0", "-"],
        (1, 0, -1),
        np.array([1, 0, -1], dtype=np.int8),
        np.array([1.0, 0.0, -1.0]),
        np.array(["+", "0", "-"]),
    ],
)
def test_every_way_to_write_one(approach: Any) -> None:
    found = read_approach(JOINTS, approach)
    assert found == (1, 0, -1)
    assert all(type(sign) is int for sign in found)
    assert written_approach(JOINTS, found) == {"base": "+", "wrist": "-"}


@pytest.mark.parametrize("approach", [(), [], {}])
def test_none(approach: Any) -> None:
    assert not any(read_approach(JOINTS, approach))


@pytest.mark.parametrize(
    ("approach", "message"),
    [
        ("wrst +", "no joint on the chain named 'wrst'; did you mean 'wrist'"),
        ({"elbow": "+"}, "no joint on the chain named 'elbow'"),
        ("wrist up", r"the approach of wrist must be \+, - or 0, got 'up'"),
        ("wrist", "'wrist' is no approach; write a joint and"),
        ("base +, base -", "the approach of the joint 'base' is given twice"),
        ({"base": 2}, "got 2"),
        ({"base": True}, "got True"),
        ({"base": None}, "got None"),
        ({"base": float("nan")}, "got nan"),
        ([1, -1], "2 directions of approach for 3 joints; expected base, upper arm, wrist"),
        (1, "an approach is"),
        (None, "an approach is"),
    ],
)
def test_a_wrong_one_is_told_in_a_line(approach: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_approach(JOINTS, approach)
    assert "\n" not in str(caught.value)


def test_an_unknown_joint_is_an_unknown_name() -> None:
    with pytest.raises(UnknownNameError):
        read_approach(JOINTS, {"elbow": "+"})


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
