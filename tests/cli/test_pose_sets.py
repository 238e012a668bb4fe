"""The poses of a command line as one set, with their statuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from precision_pin.base.errors import InputError
from precision_pin.cli.options import Options
from precision_pin.cli.poses import read_pose_set
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import read

SHEET = "gantry.errors.yaml"
LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"
NONE: Options = {
    "pose_names": (), "all_poses": False, "qs": (), "trajectory": None, "grid": None, "approach": None, "steps": ()
}  # fmt: skip


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


@pytest.mark.slow
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


def test_the_approach_from_the_previous_pose_passes_over_what_is_not_reached(folder):
    (folder / "grid.yaml").write_text(
        GRID.replace("[0.3 m, 5 m]", "[0.3 m, 5 m, 0.1 m, 0.6 m]").replace("[-500 mm, 9 m]", "-500 mm")
    )
    poses = read_pose_set(read(SHEET), {**NONE, "grid": "grid.yaml", "approach": "previous"})
    assert poses.known.tolist() == [True, False, True, True]
    assert poses.approaches[0].tolist() == [0, 0, -1, 1]


def test_near_a_singularity_the_note_states_the_value(folder, capsys):
    # stretched out, the three parallel joints of the paper's arm are in line
    (folder / "grid.yaml").write_text("joints: {joint1: 0 deg, joint2: 10 deg, joint3: 0 90 deg, joint4: 0 deg}\n")
    poses = read_pose_set(read(PAPER_SHEET), {**NONE, "grid": "grid.yaml"})
    assert poses.status == ("singular", "reached")
    assert "singular: smallest singular value below 0.01" in capsys.readouterr().err
    # at a right angle it is 0.259
    for below, status in (
        (0.26, ("singular", "singular")),
        (0.25, ("singular", "reached")),
        (0, ("reached", "reached")),
    ):
        (folder / "other.yaml").write_text((folder / "grid.yaml").read_text() + f"singular_below: {below}\n")
        assert read_pose_set(read(PAPER_SHEET), {**NONE, "grid": "other.yaml"}).status == status
    assert "singular value below 0.26)" in capsys.readouterr().err


@pytest.mark.slow
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


@pytest.mark.slow
def test_steps_put_poses_between_the_rows_of_a_trajectory(run, folder):
    (folder / "way.csv").write_text(f"time [s],{LONG} [deg],y_axis [mm]\n0,0,0\n1,10,30\n")
    along = run("moments", SHEET, "--trajectory", "way.csv", "--step", "0.5 s", "--step", "3 deg", "--json", "-")
    values = [list(pose["pose"]["q"].values()) for pose in along.json["poses"]]
    np.testing.assert_allclose(values, [[0.0075 * k, math.radians(2.5 * k)] for k in range(5)], atol=1e-15)
    for steps, message in (
        (("2 parsec",), "--step '2 parsec': 'parsec' in '2 parsec' is not a unit of time or angle or length"),
        (("0 s",), "--step '0 s': time_step must be positive"),
        (("1 s", "1 ms"), "--step '1 ms': a second step of time"),
        (("1e-9 s",), "--step '1e-9 s': the steps make 1,000,000,001 poses"),
    ):
        words = [word for step in steps for word in ("--step", step)]
        refused = run("analyze", SHEET, "--trajectory", "way.csv", *words)
        assert refused.code == 2
        assert refused.said[0].startswith("way.csv: error E_TRAJECTORY: ")
        assert message in refused.err
    alone = run("analyze", SHEET, "--step", "1 s")
    assert (alone.code, "--step needs a --trajectory" in alone.err) == (2, True)


@pytest.mark.slow
def test_a_target_shifts_every_result_by_its_lever_arm(run):
    # the tool turns about x by 0.1 mrad (the sheet gives 3 sigma): a point 200 mm along y from the tip moves by 0.02 mm along z
    for command in ("moments", "budget", "worst-case"):
        titled = run(command, SHEET, "--q", "0 mm, 0 deg", "--target", "0 200 0 mm").out
        assert "frame to tool + 0 200 0 mm" in titled
    tip, target = (
        run("moments", SHEET, "--q", "0 mm, 0 deg", *words, "--json", "-").json["poses"][0]
        for words in ((), ("--target", "0 0.2 0 m"))
    )
    assert tip["std"]["value"][2] == pytest.approx(0, abs=1e-7)
    assert target["std"]["value"][2] == pytest.approx(0.1e-3 * 0.2, rel=1e-5)
    assert target["std"]["value"][1] == pytest.approx(tip["std"]["value"][1], rel=1e-5)
    refused = run("analyze", SHEET, "--target", "0 200 mm")
    assert refused.code == 2
    (line,) = refused.said
    assert line.startswith(
        "precision-pin: error E_USAGE: --target: '0 200 mm' has 2 numbers, expected 3; write it as '0 0"
    )
