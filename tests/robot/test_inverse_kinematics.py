"""Inverse kinematics: the branches of a UR5 by its closed form, a planar arm by hand, statuses, bits."""

import math

import numpy as np
import pytest

from precision_pin.base.errors import InputError
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.inverse_kinematics import inverse_kinematics
from support.oracles import ur5_branches, ur5_pose
from support.plain_robot import chain_of, joint, limits, link, planar_arm, robot


@pytest.fixture(scope="module")
def ur5() -> Chain:
    return Chain.from_urdf(example_urdfs()["ur5"], tip="tool0")


def circular_distance(one, other) -> float:
    gaps = np.asarray(one) - np.asarray(other)
    return float(np.abs(gaps - 2 * np.pi * np.rint(gaps / (2 * np.pi))).max())


@pytest.mark.slow
def test_a_ur5_has_the_branches_of_its_closed_form(ur5):
    given = np.random.default_rng(3).uniform(-3, 3, (6, 6))
    wanted = np.moveaxis([ur5_pose(q) for q in given.T], 0, -1)
    found = inverse_kinematics(ur5, wanted)
    reached = np.moveaxis([ur5_pose(q) for q in found.q.T], 0, -1)
    assert np.abs(reached - wanted[:, :, found.node]).max() < 1e-9
    counts = set()
    for node, q in enumerate(given.T):
        branches = ur5_branches(wanted[:, :, node])
        assert min(circular_distance(q, branch) for branch in branches) < 1e-6
        own = found.q[:, found.node == node].T
        assert len(own) == len(branches)
        for branch in branches:
            assert min(circular_distance(branch, one) for one in own) < 1e-6
        assert found.branch[found.node == node].tolist() == list(range(len(own)))
        counts.add(len(own))
    assert max(counts) == 8


def test_the_nearest_to_the_reference_comes_first_by_its_nearest_turn(ur5):
    reference = np.array([2 * math.pi - 0.3, -1.2, 1.4, 0.5, -0.8, 0.4])
    found = inverse_kinematics(ur5, ur5_pose(reference + 0.05), reference=reference)
    np.testing.assert_allclose(found.q[:, 0], reference + 0.05, atol=1e-9)
    distances = np.linalg.norm(found.q - reference[:, None], axis=0)
    assert (np.diff(distances) > 0).all()


@pytest.mark.slow
def test_solutions_do_not_depend_on_the_other_poses(ur5):
    q = np.random.default_rng(4).uniform(-3, 3, (6, 2))
    wanted = ur5.at_columns(q).pose
    together, turned = inverse_kinematics(ur5, wanted), inverse_kinematics(ur5, wanted[:, :, ::-1])
    own = together.q[:, together.node == 0]
    np.testing.assert_array_equal(own, inverse_kinematics(ur5, wanted[:, :, 0]).q)
    np.testing.assert_array_equal(own, turned.q[:, turned.node == 1])


def at(x: float, y: float, z: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def test_statuses_of_a_planar_arm_by_hand():
    # elbow up or down at a right angle, stretched, too far, out of the plane
    wanted = np.moveaxis([at(0.5, 0.5), at(0.6, 0.8), at(1.1, 0), at(0.5, 0.5, 0.1)], 0, -1)
    found = inverse_kinematics(planar_arm(elbow=(-3, 3)), wanted, task="position")
    poses = found.poses(("square", "far", "farther", "above"), branches="all")
    assert poses.names == ("square branch 0", "square branch 1", "far branch 0", "farther", "above")
    assert poses.status == ("reached",) * 3 + ("unreachable",) * 2
    assert poses.branch.tolist() == [0, 1, 0, -1, -1]
    assert poses.node.tolist() == [0, 0, 1, 2, 3]
    right = math.pi / 2
    np.testing.assert_allclose(poses.q[:, :2], [[0, right], [right, -right]], atol=1e-9)
    np.testing.assert_allclose(poses.q[:, 2], [math.atan2(0.8, 0.6), 0], atol=1e-4)
    np.testing.assert_array_equal(poses.position[:, 3], [1.1, 0, 0])
    assert found.poses().known.tolist() == [True, True, False, False]
    # the elbow may turn neither way, or one way only
    assert inverse_kinematics(planar_arm(elbow=(2, 3)), wanted[:, :, 0], task="position").poses().status == ("limit",)
    one = inverse_kinematics(planar_arm(elbow=(1, 3)), wanted[:, :, 0], task="position")
    np.testing.assert_allclose(one.q[:, 0], [0, right], atol=1e-9)


def test_a_sliding_joint_and_the_tool_axis_alone():
    arm = chain_of(
        robot(
            link("base"), link("carriage"), link("turret"), link("tool"),
            joint("rail", "prismatic", "base", "carriage", axis=(1, 0, 0), extra=limits(-2, 2)),
            joint("tilt", "revolute", "carriage", "turret", (0, 0, 0.7), axis=(0, 1, 0)),
            joint("roll", "revolute", "turret", "tool", (0, 0, 0.3)),
        )
    )  # fmt: skip
    wanted = arm.at([0.4, 0.9, 0.2]).pose.copy()
    np.testing.assert_allclose(inverse_kinematics(arm, wanted).q.T, [[0.4, 0.9, 0.2]], atol=1e-9)
    # turned about the tool axis by any angle, tip and axis stay
    for task, count in (("axis", 1), ("position", 2)):
        found = inverse_kinematics(arm, wanted, task=task)
        tilts = np.unique(np.round(found.q[1], 6))
        assert len(tilts) == count
        reached = arm.at_columns(found.q).pose
        assert np.abs(reached[:3, 3] - wanted[:3, 3, None]).max() < 1e-9
    axis = inverse_kinematics(arm, wanted, task="axis")
    assert np.abs(arm.at_columns(axis.q).pose[:3, 2] - wanted[:3, 2, None]).max() < 1e-9


def test_more_joints_than_constraints_stay_within_their_limits():
    long = chain_of(
        robot(
            link("base"), *(link(f"link{k}") for k in range(5)),
            *(
                joint(f"joint{k}", "revolute", "base" if not k else f"link{k - 1}", f"link{k}", (0.3 * (k > 0), 0, 0),
                      axis=(0, 0, 1) if k % 2 else (0, 1, 0), extra=limits(-1, 1))
                for k in range(4)
            ),
            joint("flange", "fixed", "link3", "link4", (0.3, 0, 0)),
        )
    )  # fmt: skip
    q = np.array([0.5, -0.4, 0.8, 0.6])
    found = inverse_kinematics(long, long.at(q).pose, task="position")
    assert found.q.shape[1] > 1
    assert (np.abs(found.q) <= 1).all()
    assert np.abs(long.at_columns(found.q).pose[:3, 3] - long.at(q).pose[:3, 3, None]).max() < 1e-9
    # only folded back on itself does the tip come so near
    assert inverse_kinematics(long, at(0.1, 0, 0.05), task="position").poses().status == ("limit",)
    assert inverse_kinematics(planar_arm(elbow=(0.1, 3)), at(0, 0, 9), task="position").poses().status == (
        "unreachable",
    )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"wanted": np.zeros((4, 4))}, "the wanted pose 0 is no rigid motion: its rotation must be orthogonal"),
        ({"wanted": np.eye(3)}, r"the wanted poses have the shape \(3, 3\), expected \(4, 4\) or \(4, 4, N\)"),
        ({"wanted": np.zeros((4, 4, 0))}, r"have the shape \(4, 4, 0\)"),
        ({"wanted": np.eye(4), "task": "attitude"}, "task must be pose or axis or position"),
        ({"wanted": np.eye(4), "tool_axis": (0, 0, 0)}, "the tool axis has length zero"),
        ({"wanted": np.eye(4), "reference": (0, 0, 0)}, "3 joint values for 2 joints"),
    ],
)  # fmt: skip
def test_wrong_calls_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        inverse_kinematics(planar_arm(elbow=(-3, 3)), **given)
    with pytest.raises(InputError, match="2 names for 1 wanted poses"):
        inverse_kinematics(planar_arm(elbow=(-3, 3)), at(0.5, 0.5), task="position").poses(("one", "two"))
