"""Sets of poses: statuses, singular values by hand, selection."""

from __future__ import annotations

import math

import numpy as np
import pytest

from precision_pin.base.errors import InputError
from precision_pin.robot.pose_set import NO_BRANCH, PoseSet, smallest_singular_values
from support.plain_robot import chain_of, joint, link, robot


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
