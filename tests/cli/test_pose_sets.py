"""The poses of a command line as one set, with their statuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from precision_pin.cli.options import PoseOptions
from precision_pin.cli.poses import read_pose_set
from precision_pin.errors import InputError
from precision_pin.sheet import read

SHEET = "gantry.errors.yaml"
LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"
NONE: PoseOptions = {"pose_names": (), "all_poses": False, "qs": (), "trajectory": None}


def test_every_way_to_name_poses_makes_a_set(folder):
    (folder / "way.csv").write_text(f"t,{LONG},y_axis\n0,0,0.25\n2,0.1,1.5\n")
    sheet = read(SHEET)
    first = read_pose_set(sheet, NONE)
    assert first.names == ("out",)
    np.testing.assert_allclose(first.q[:, 0], [0.25, math.radians(30)])
    assert read_pose_set(sheet, {**NONE, "all_poses": True}).names == ("out", "home")
    assert read_pose_set(sheet, {**NONE, "pose_names": ("home",)}).q.tolist() == [[0], [0]]
    assert read_pose_set(sheet, {**NONE, "qs": ("0.1 m, 10 deg",)}).labels == ["pose 1"]
    way = read_pose_set(sheet, {**NONE, "trajectory": "way.csv"})
    assert way.status == ("reached", "limit")
    assert way.times.tolist() == [0, 2]
    np.testing.assert_array_equal(way.q, [[0.25, 1.5], [0, 0.1]])
    # the arm hangs down by half a metre, one metre up
    np.testing.assert_allclose(way.position[:, 0], [0.1, 0.25, 0.5])
    with pytest.raises(InputError, match="no pose named 'inn'; valid: home, out"):
        read_pose_set(sheet, {**NONE, "pose_names": ("inn",)})
