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
NONE: PoseOptions = {"pose_names": (), "all_poses": False, "qs": (), "trajectory": None, "grid": None}


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


GRID = """plane:
  origin: 100 0 1000 mm
  u: {direction: 0 1 0, values: [0.3 m, 5 m]}
  v: {direction: 0 0 1, values: [-500 mm, 9 m]}
orientations: any
"""


def test_a_grid_makes_a_set_and_poses_without_what_is_out_of_reach(run, folder):
    (folder / "grid.yaml").write_text(GRID)
    poses = read_pose_set(read(SHEET), {**NONE, "grid": "grid.yaml"})
    assert poses.status == ("reached", "unreachable", "limit", "unreachable")
    assert poses.known.tolist() == [True, False, False, False]
    # the arm hangs down, so that y is the rail's joint value
    np.testing.assert_allclose(poses.q[:, 0], [0.3, 0], atol=1e-4)
    left_out = "3 of 4 poses are left out: 2 unreachable, 1 limit (first '100 300 10000 mm')"
    for command in (("analyze", "--samples", "500"), ("moments",)):
        done = run(*command, SHEET, "--grid", "grid.yaml", "--json", "-")
        assert done.code == 0
        assert [found["message"] for found in done.json["findings"] if found["code"] == "W_UNREACHED"] == [left_out]
        assert sum(left_out in line for line in done.said) == 1
    (folder / "near.yaml").write_text(GRID.replace("5 m", "500 mm").replace("9 m", "-0.4 m"))
    done = run("analyze", SHEET, "--grid", "near.yaml", "--samples", "500", "--json", "-")
    names = [f"100 {y} {z} mm" for y in (300, 500) for z in (500, 600)]
    assert [pose["pose"]["name"] for pose in done.json["poses"]] == names
    assert done.said == ["near.yaml: 4 poses: 4 reached"]


def test_a_grid_out_of_reach_or_given_twice_is_refused(run, folder, new_files):
    (folder / "far.yaml").write_text(GRID.replace("0.3 m", "4 m"))
    far = run("analyze", SHEET, "--grid", "far.yaml", "--quiet")
    assert far.code == 2
    assert far.err_lines == [
        "far.yaml: error E_GRID: no joint values lead to any of the 4 poses: 2 limit, 2 unreachable"
    ]
    twice = run("analyze", SHEET, "--grid", "far.yaml", "--all-poses")
    assert (twice.code, "--all-poses and --grid exclude each other" in twice.err) == (2, True)
    over = run("analyze", SHEET, "--grid", "far.yaml", "--json", "far.yaml")
    assert over.code == 2
    assert (folder / "far.yaml").read_text() == GRID.replace("0.3 m", "4 m")
    (folder / "many.yaml").write_text(GRID.replace("[0.3 m, 5 m]", "{from: -0.5 m, to: 0.5 m, count: 9}"))
    many = run("report", SHEET, "--grid", "many.yaml", "--out", "page.html")
    assert many.code == 2
    assert "18 poses; at most 12 are allowed here" in many.err
    assert "page.html" not in new_files()
