"""The poses of a command line: several as one question, grids, steps, targets, approaches, one relative to another."""

import json
import math
import re
import shlex

import numpy as np
import pytest

from cli.conftest import LONG
from precision_pin.cli.poses import read_pose_set
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import read

SHEET = "gantry.errors.yaml"
FEW = ("--samples", "500")

# several as one question ---------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_ways_to_give_two_poses_are_one(run, folder):
    (folder / "way.csv").write_text(f"y_axis,{LONG}\n0.25,{math.radians(30)!r}\n0,0\n")
    named, everything, by_values, along = (
        run("analyze", SHEET, *given.split(), *FEW, "--json", "-")
        for given in ("--pose out --pose home", "--all-poses", "--q 0.25m,30deg --q 0m,0deg", "--trajectory way.csv")
    )
    assert named.out == everything.out
    assert [pose["pose"]["name"] for pose in named.json["poses"]] == ["out", "home"]
    assert [pose["pose"]["name"] for pose in along.json["poses"]] == ["row 1", "row 2"]
    for other in (by_values, along):
        for one, same in zip(named.json["poses"], other.json["poses"], strict=True):
            assert one["mean"] == pytest.approx(same["mean"], abs=1e-15)


def test_one_pose_in_any_form_is_the_analysis_of_one_pose(run, folder):
    (folder / "one.yaml").write_text((folder / SHEET).read_text().replace("  home: [0 mm, 0 deg]\n", ""))
    alone = run("analyze", "one.yaml", *FEW, "--json", "-")
    assert alone.out == run("analyze", "one.yaml", "--all-poses", *FEW, "--json", "-").out
    assert alone.json["schema"] == "precision-pin/analysis/1"


@pytest.mark.slow
def test_columns_of_others_come_back_in_the_corrected_poses(run, refused, folder):
    """``--columns``, the sheet's ``measurement: columns:`` and the plain header give the same; other columns go."""
    (folder / "plain.csv").write_text(f"t [s],y_axis [m],{LONG} [rad]\n0,0.25,0.5\n1,0.1,-0.25\n")
    (folder / "theirs.csv").write_text("q2;clock;note;q1\n0,5;0;a;250\n-0,25;1000;b;100\n")
    columns = f"q1=y_axis [mm], q2={LONG} [rad], clock=t [ms], note=ignore"
    text = (folder / SHEET).read_text()
    (folder / "said.errors.yaml").write_text(f"{text}measurement: {{columns: '{columns}, px=x [mm], *=[m]'}}\n")
    asked = ("--mode", "pose", "--weights", "1 1 1 0.1 0.1 0.1", "--trajectory")
    plain = run("compensate", SHEET, *asked, "plain.csv", "--csv", "plain.out.csv")
    for name, sheet, more in (("a", SHEET, ("--columns", columns)), ("b", "said.errors.yaml", ())):
        done = run("compensate", sheet, *asked, "theirs.csv", "--csv", f"{name}.csv", *more)
        assert done.out == plain.out
        rows = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1)
        expected = np.loadtxt(folder / "plain.out.csv", delimiter=",", skiprows=1)
        assert rows * [1e-3, 1, 1e-3] == pytest.approx(expected[:, [0, 2, 1]], rel=1e-12)
        assert (folder / f"{name}.csv").read_text().splitlines()[0] == f"t [ms],{LONG} [rad],y_axis [mm]"
    assert "theirs.csv:1: error E_TRAJECTORY: the column 'q2' is no joint" in refused(
        "compensate", SHEET, "--trajectory", "theirs.csv"
    )


@pytest.mark.slow
def test_wrap_takes_poses_of_any_origin_inside(run, folder):
    turned = math.degrees(0.5) + 360
    (folder / "way.csv").write_text(f"y_axis,{LONG} [deg]\n0.25,{turned!r}\n")
    sheet = (folder / SHEET).read_text().replace("30 deg", f"{turned!r} deg")
    (folder / "turned.errors.yaml").write_text(sheet)
    asked = (*FEW, "--spec", "1 m", "--json", "result.json")
    run("analyze", SHEET, "--q", "250 mm, 0.5 rad", *asked)
    inside = json.loads((folder / "result.json").read_text())
    for given in (
        (SHEET, "--q", f"250 mm, {turned!r} deg"),
        (SHEET, "--trajectory", "way.csv"),
        ("turned.errors.yaml",),
    ):
        outside = run("analyze", *given, *asked, code=1)
        assert "a whole turn less, 28.64789 deg, is inside: --wrap takes poses so" in outside.err
        assert "NOT JUDGED" in outside.out
        found = run("analyze", *given, *asked, "--wrap")
        assert "W_JOINT_LIMIT" not in found.err
        assert np.ravel(json.loads((folder / "result.json").read_text())["covariance"]) == pytest.approx(
            np.ravel(inside["covariance"]), rel=1e-9, abs=1e-20
        )


@pytest.mark.slow
def test_the_exit_code_the_worst_pose_and_a_row_for_each_pose(run, folder):
    kept = run("analyze", SHEET, "--all-poses", *FEW, "--spec", "2 mm", "--out", "plots")
    assert "within 2 mm for 95 % at every pose: MET" in kept.out
    plots = {f"{quantity}.{end}" for quantity in ("position", "attitude") for end in ("png", "svg")}
    assert {path.name for path in (folder / "plots").iterdir()} == {"poses.json", *plots}
    assert json.loads((folder / "plots/poses.json").read_text("utf-8"))["schema"] == "precision-pin/poses/1"
    missed = run("analyze", SHEET, "--all-poses", *FEW, "--spec", "0.05 mm", "--spec", "1 mrad", code=1)
    assert re.search(r"(?s)^worst pose .*^spec .*NOT MET - worst pose", missed.out.replace("\n  ", " "), re.MULTILINE)
    rows = [line for line in missed.out.splitlines() if line.startswith(("out ", "home "))]
    assert sorted(row.split()[0] for row in rows) == ["home", "out"]
    assert sum("(worst)" in row for row in rows) == 1


@pytest.mark.slow
@pytest.mark.parametrize("command", ["analyze", "map"])
def test_a_journal_of_several_poses_is_resumed_and_knows_its_run(run, refused, command):
    plain = run(command, SHEET, "--all-poses", *FEW, "--json", "-").out
    kept = (command, SHEET, "--all-poses", *FEW, "--journal", "run.journal", "--json", "-")
    assert run(*kept).out == plain
    again = run(*kept, "--resume")
    assert again.out == plain
    assert "the journal run.journal holds the first 2 poses" in again.err
    resumed = ("--journal", "run.journal", "--resume")
    other = refused(command, SHEET, "--all-poses", "--samples", "600", *resumed)
    assert "belongs to another run: samples was '500', is '600'" in other
    swapped = refused(command, SHEET, "--pose", "home", "--pose", "out", *FEW, *resumed)
    assert "the list of poses has changed" in swapped


def test_one_robot_at_all_poses(run):
    asked = ("analyze", SHEET, "--all-poses", *FEW, "--spec", "0.3 mm", "--spec-everywhere")
    everywhere = run(*asked, "--json", "-", code=None)
    (entry,) = everywhere.json["spec"]
    assert entry["everywhere"]["probability"] <= min(pose["probability"] for pose in entry["poses"])
    assert everywhere.code == (0 if entry["met"] else 1)
    assert "of robots keep it at all poses" in run(*asked, code=everywhere.code).out.replace("\n  ", " ")


def test_of_many_poses_the_six_worst_are_listed_within_100_columns(run, folder):
    rows = "".join(f"{0.02 * k},{0.01 * k}\n" for k in range(15))
    (folder / "way.csv").write_text(f"y_axis,{LONG}\n{rows}")
    asked = ("analyze", SHEET, "--trajectory", "way.csv", *FEW)
    found = run(*asked, "--spec", "0.05 mm", "--spec", "1 mrad", "--json", "j", code=1).out
    listed = re.findall(r"(?m)^row .*", found)
    assert len(listed) == 6
    assert "and 9 more poses: --all" in found
    assert len(re.findall(r"(?m)^row ", run(*asked, "--all").out)) == 15
    assert max(map(len, found.splitlines())) <= 100
    shares = [pose["probability"] for pose in json.loads((folder / "j").read_text())["spec"][0]["poses"]]
    assert listed[0].startswith(f"row {np.argmin(shares) + 1} (worst)")


@pytest.mark.slow
def test_warnings_at_each_pose_are_those_of_its_own_analysis(run, folder):
    sheet = folder / "4dof.errors.yaml"
    sheet.write_text(re.sub(r"accept:.*\n.*\n", "", sheet.read_text("utf-8")))
    at_one = run("analyze", sheet.name, "--q", "-90 3 88 -91 deg", *FEW)
    at_two = run("analyze", sheet.name, "--q", "-90 3 88 -91 deg", "--q", "-80 3 88 -91 deg", *FEW, "--json", "-")
    (warning,) = [line.split("W_STATICS: ")[1] for line in at_one.err_lines if "W_STATICS" in line]
    first, _ = [line for line in at_two.json["warnings"] if "W_STATICS" in line]
    assert first.endswith(warning)
    assert sum("W_STATICS" in line for line in at_two.err_lines) == 1


# sets of poses with their statuses -----------------------------------------------------------------------------------

NONE = {
    "pose_names": (), "all_poses": False, "qs": (), "trajectory": None, "grid": None, "approach": None, "steps": ()
}  # fmt: skip
GRID = """plane:
  origin: 100 0 1000 mm
  u: {direction: 0 1 0, values: [0.3 m, 5 m]}
  v: {direction: 0 0 1, values: [-500 mm, 9 m]}
orientations: any
"""


@pytest.mark.slow
def test_a_grid_makes_a_set_and_poses_without_what_is_out_of_reach(run, refused, folder):
    for name, text in {
        "grid.yaml": GRID,
        "near.yaml": GRID.replace("5 m", "500 mm").replace("9 m", "-0.4 m"),
        "far.yaml": GRID.replace("0.3 m", "4 m"),
        "many.yaml": GRID.replace("[0.3 m, 5 m]", "{from: -0.5 m, to: 0.5 m, count: 9}"),
    }.items():
        (folder / name).write_text(text)
    poses = read_pose_set(read(SHEET), {**NONE, "grid": "grid.yaml"})
    assert poses.status == ("reached", "unreachable", "limit", "unreachable")
    assert poses.known.tolist() == [True, False, False, False]
    # the arm hangs down, so that y is the rail's joint value
    np.testing.assert_allclose(poses.q[:, 0], [0.3, 0], atol=1e-4)
    left_out = "3 of 4 poses are left out: 2 unreachable, 1 limit (first '100 300 10000 mm')"
    for command, samples in (("analyze", "500"), ("moments", "1024")):
        done = run(command, SHEET, "--grid", "grid.yaml", "--samples", samples, "--json", "-")
        assert [found["message"] for found in done.json["findings"] if found["code"] == "W_UNREACHED"] == [left_out]
        assert sum(left_out in line for line in done.said) == 1
    done = run("analyze", SHEET, "--grid", "near.yaml", *FEW, "--json", "-")
    names = [f"100 {y} {z} mm" for y in (300, 500) for z in (500, 600)]
    assert [pose["pose"]["name"] for pose in done.json["poses"]] == names
    assert done.said == ["near.yaml: 4 poses: 4 reached"]
    why = "far.yaml: error E_GRID: no joint values lead to any of the 4 poses: 2 limit, 2 unreachable"
    assert refused("analyze", SHEET, "--grid", "far.yaml", "--quiet") == why
    many = refused("report", SHEET, "--grid", "many.yaml", "--out", "page.html")
    assert "18 poses; at most 12 are allowed here" in many


def test_the_approach_from_the_previous_pose_passes_over_what_is_not_reached(folder):
    text = GRID.replace("[0.3 m, 5 m]", "[0.3 m, 5 m, 0.1 m, 0.6 m]").replace("[-500 mm, 9 m]", "-500 mm")
    (folder / "grid.yaml").write_text(text)
    poses = read_pose_set(read(SHEET), {**NONE, "grid": "grid.yaml", "approach": "previous"})
    assert poses.known.tolist() == [True, False, True, True]
    assert poses.approaches[0].tolist() == [0, 0, -1, 1]


def test_near_a_singularity_the_note_states_the_value(folder, capsys):
    # stretched out, the three parallel joints of the paper's arm are in line; at a right angle the value is 0.259
    grid = "joints: {joint1: 0 deg, joint2: 10 deg, joint3: 0 90 deg, joint4: 0 deg}\n"
    for below, status, said in (
        ("", ("singular", "reached"), "singular: smallest singular value below 0.01"),
        ("singular_below: 0.26\n", ("singular", "singular"), "singular value below 0.26)"),
        ("singular_below: 0.25\n", ("singular", "reached"), "singular value below 0.25)"),
        ("singular_below: 0\n", ("reached", "reached"), ""),
    ):
        (folder / "grid.yaml").write_text(grid + below)
        assert read_pose_set(read(PAPER_SHEET), {**NONE, "grid": "grid.yaml"}).status == status
        assert said in capsys.readouterr().err


@pytest.mark.slow
def test_steps_put_poses_between_the_rows_of_a_trajectory(run, folder):
    (folder / "way.csv").write_text(f"time [s],{LONG} [deg],y_axis [mm]\n0,0,0\n1,10,30\n")
    along = run("moments", SHEET, "--trajectory", "way.csv", "--step", "0.5 s", "--step", "3 deg", "--json", "-")
    values = [list(pose["pose"]["q"].values()) for pose in along.json["poses"]]
    np.testing.assert_allclose(values, [[0.0075 * k, math.radians(2.5 * k)] for k in range(5)], atol=1e-15)


@pytest.mark.slow
def test_a_target_shifts_every_result_by_its_lever_arm(run):
    # the tool turns about x by 0.1 mrad (the sheet gives 3 sigma): a point 200 mm along y from the tip moves by 0.02 mm along z
    asked = (SHEET, "--q", "0 mm, 0 deg")
    assert "frame to tool + 0 200 0 mm" in run("worst-case", *asked, "--target", "0 200 0 mm").out
    tip, target = (
        np.array(run("moments", *asked, *words, "--json", "-").json["poses"][0]["std"]["value"])
        for words in ((), ("--target", "0 0.2 0 m"))
    )
    assert tip[2] == pytest.approx(0, abs=1e-7)
    assert target[1:3] == pytest.approx([tip[1], 0.1e-3 * 0.2], rel=1e-5)


# approaches ----------------------------------------------------------------------------------------------------------

PLAY = """\
precision-pin: 1
robot: 4dof.urdf
poses:
  home: -90 3 88 -91 deg
  up: {q: -80 10 70 -91 deg, approach: {joint2: +}}
sources:
  - backlash: {joint: joint2, backlash: 1 arcmin, band: 1000 N*m}
  - joint_offset: {joint: joint1, offset: {uniform: 1 arcmin}}
"""
AFTER_HOME = {"joint1": "+", "joint2": "+", "joint3": "-"}


@pytest.fixture
def play(folder):
    (folder / "play.yaml").write_text(PLAY)
    return "play.yaml"


def approaches(result):
    return [entry.get("pose", entry).get("approach") for entry in result.json["poses"]]


def test_an_approach_decides_the_flank_and_a_journal_is_of_one(run, refused, play, folder):
    found, built = {}, {}
    for sign in "+-":
        result = run("analyze", play, "--approach", f"joint2 {sign}", *FEW, "--json", "-").json
        assert result["pose"]["approach"] == {"joint2": sign}
        found[sign] = np.array(result["nominal"]["attitude"])
        run("export", play, "--approach", f"joint2 {sign}", "--out", sign)
        built[sign] = (folder / sign / "units.csv").read_text()
    assert found["+"] == pytest.approx(-found["-"], abs=1e-12)
    assert np.abs(found["+"]).max() == pytest.approx(1.4544e-4, rel=1e-3)  # half an arcmin
    assert built["+"] != built["-"]
    without = run("analyze", play, *FEW, "--json", "-").json
    assert "approach" not in without["pose"]
    assert without["nominal"]["attitude"] == pytest.approx([0, 0, 0], abs=1e-15)
    run("analyze", play, "--approach", "joint2 +", *FEW, "--journal", "run.journal")
    again = refused("analyze", play, "--approach", "joint2 -", *FEW, "--journal", "run.journal", "--resume")
    assert "(+)" in again
    assert "(-)" in again


@pytest.mark.slow
def test_approaches_of_the_sheet_of_the_option_and_from_the_pose_before(run, play, folder):
    table = run("analyze", play, "--pose", "up", *FEW)
    assert ", 10° (+), 70°, " in table.out.replace("\n  ", " ")
    (folder / "way.csv").write_text("joint1,joint2,joint3,joint4\n0,0,0,0\n0.1,0,-0.1,0\n0.1,0.2,-0.1,0\n")
    for words, expected in (
        ("moments --all-poses", [None, {"joint2": "+"}]),
        (
            "analyze --samples 500 --trajectory way.csv --approach previous",
            [None, {"joint1": "+", "joint3": "-"}, AFTER_HOME],
        ),
        ("analyze --samples 500 --pose home --pose up --approach previous", [None, AFTER_HOME]),
        ("exact-law --samples 500 --all-poses --approach 'joint4 -'", [{"joint4": "-"}] * 2),
        ("map --pose home --pose up --approach previous", [None, AFTER_HOME]),
        ("compensate --pose home --pose up --approach previous", [None, AFTER_HOME]),
    ):
        command, *options = shlex.split(words)
        assert approaches(run(command, play, *options, "--json", "-")) == expected


def test_rounding_is_zero_in_a_table_of_robots_of_which_few_turn_over(run, folder):
    """The turn about x is 0 or 0.29 mrad, but for rounding of 1e-42."""
    text = PLAY.replace(
        "band: 1000 N*m}", "band: 121 N*m}\n  - payload: {at: tool, mass: {normal: 100 g, mean: 1 kg, truncated: true}}"
    )
    (folder / "turns.yaml").write_text(text + "  - backlash: {joint: joint3, backlash: 1 arcmin, band: 1.5 N*m}\n")
    table = run("analyze", "turns.yaml", "--approach", "joint2 +, joint3 -", "--samples", "20000").out
    (row,) = (line for line in table.splitlines() if line.startswith("δx   mrad") and "to" not in line)
    assert max(map(len, row.split())) <= 8


# one pose relative to another ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_other_pose_by_name_and_by_values(run):
    named, by_values = (
        run("analyze", SHEET, "--relative-to", other, *FEW, "--json", "-").json for other in ("home", "0 mm, 0 deg")
    )
    assert named["relative_to"]["name"] == "home"
    # an offset of the slide moves the tip alike at both poses; the joint, ± 0.3 mrad as
    # 3 σ, moves the tip by the chord between both lever arms of 0.5 m
    assert named["position"] == by_values["position"]
    spread = 0.1e-3 * 0.5 * 2 * math.sin(math.radians(15))
    total = math.hypot(*(named["position"][axis]["std"] for axis in "xyz"))
    assert total == pytest.approx(spread, rel=0.15)
    table = run("analyze", SHEET, "--relative-to", "home", *FEW, "--spec", "0.001 mm", code=1).out
    assert "relative to the same robots at pose 'home' (" in table
    assert "spec |d| within 0.001 mm for 95 %: NOT MET" in table
