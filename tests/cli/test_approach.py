"""``--approach``: by joint or from the pose before, in every command that takes poses."""

from __future__ import annotations

import pytest

SHEET = """\
precision-pin: 1
robot: 4dof.urdf
poses:
  home: -90 3 88 -91 deg
  up: {q: -80 10 70 -91 deg, approach: {joint2: +}}
sources:
  - backlash: {joint: joint2, backlash: 1 arcmin, band: 1000 N*m}
  - joint_offset: {joint: joint1, offset: {uniform: 1 arcmin}}
"""
FEW = ("--samples", "200")


@pytest.fixture
def sheet(folder):
    (folder / "play.yaml").write_text(SHEET)
    return "play.yaml"


def poses(result):
    return [entry["pose"] for entry in result.json["poses"]]


def test_it_decides_the_flank(run, sheet):
    found = {}
    for sign in "+-":
        result = run("analyze", sheet, "--approach", f"joint2 {sign}", *FEW, "--json", "-")
        assert result.code == 0
        assert result.json["pose"]["approach"] == {"joint2": sign}
        found[sign] = result.json["nominal"]["attitude"]
    assert found["+"] == pytest.approx([-number for number in found["-"]], abs=1e-12)
    assert max(map(abs, found["+"])) == pytest.approx(1.4544e-4, rel=1e-3)  # half an arcmin
    without = run("analyze", sheet, *FEW, "--json", "-").json
    assert "approach" not in without["pose"]
    assert without["nominal"]["attitude"] == pytest.approx([0, 0, 0], abs=1e-15)


@pytest.mark.slow
def test_of_the_sheet_and_in_the_table(run, sheet):
    table = run("analyze", sheet, "--pose", "up", *FEW)
    assert ", 10° (+), 70°, " in table.out.replace("\n  ", " ")
    assert run("analyze", sheet, "--pose", "up", *FEW, "--json", "-").json["pose"]["approach"] == {"joint2": "+"}
    result = run("budget", sheet, "--all-poses", "--samples", "1024", "--json", "-")
    assert [pose.get("approach") for pose in poses(result)] == [None, {"joint2": "+"}]


@pytest.mark.slow
def test_from_the_pose_before(run, sheet, folder):
    (folder / "way.csv").write_text("joint1,joint2,joint3,joint4\n0,0,0,0\n0.1,0,-0.1,0\n0.1,0.2,-0.1,0\n")
    result = run("analyze", sheet, "--trajectory", "way.csv", "--approach", "previous", *FEW, "--json", "-")
    assert [pose.get("approach") for pose in poses(result)] == [
        None,
        {"joint1": "+", "joint3": "-"},
        {"joint1": "+", "joint2": "+", "joint3": "-"},
    ]
    named = run("analyze", sheet, "--pose", "home", "--pose", "up", "--approach", "previous", *FEW, "--json", "-")
    assert poses(named)[1]["approach"] == {"joint1": "+", "joint2": "+", "joint3": "-"}
    both = run("exact-law", sheet, "--all-poses", "--approach", "joint4 -", *FEW, "--json", "-")
    assert [pose["approach"] for pose in poses(both)] == [{"joint4": "-"}] * 2


def test_rounding_is_zero_in_a_table_of_robots_of_which_few_turn_over(run, sheet, folder):
    """The turn about x is 0 or 0.29 mrad, but for rounding of 1e-42."""
    text = SHEET.replace(
        "band: 1000 N*m}", "band: 121 N*m}\n  - payload: {at: tool, mass: {normal: 100 g, mean: 1 kg, truncated: true}}"
    )
    (folder / "turns.yaml").write_text(text + "  - backlash: {joint: joint3, backlash: 1 arcmin, band: 1.5 N*m}\n")
    table = run("analyze", "turns.yaml", "--approach", "joint2 +, joint3 -", "--samples", "20000").out
    (row,) = (line for line in table.splitlines() if line.startswith("δx   mrad") and "to" not in line)
    assert max(map(len, row.split())) <= 8


@pytest.mark.parametrize("command", ["map", "compensate"])
def test_the_approach_of_every_pose_is_in_the_result(run, sheet, command):
    made = run(command, sheet, "--pose", "home", "--pose", "up", "--approach", "previous", "--json", "-")
    assert made.json["poses"][1]["approach"] == {"joint1": "+", "joint2": "+", "joint3": "-"}
    plain = run(command, sheet, "--pose", "home", "--json", "-")
    assert "approach" not in plain.json["poses"][0]


def test_a_journal_is_of_one_approach(run, sheet):
    first = run("analyze", sheet, "--approach", "joint2 +", *FEW, "--journal", "run.journal")
    again = run("analyze", sheet, "--approach", "joint2 -", *FEW, "--journal", "run.journal", "--resume")
    assert (first.code, again.code) == (0, 2)
    assert "(+)" in again.err
    assert "(-)" in again.err


def test_export_at_an_approach(run, sheet, folder):
    assert run("export", sheet, "--approach", "joint2 -", "--out", "built").code == 0
    assert (folder / "built" / "units.csv").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--approach", "jont2 -"), "--approach: no joint on the chain named 'jont2'; did you mean 'joint2'"),
        (("--approach", "joint2 up"), "--approach: the approach of joint2 must be +, - or 0, got 'up'"),
        (("--approach", "joint2"), "--approach: 'joint2' is no approach"),
        (("--approach", ""), "--approach: '' is no approach"),
        (("--approach", "previous"), "--approach previous is the way from the pose before, and there is one pose"),
        (
            ("--pose", "home", "--pose", "upp", "--approach", "previous"),
            "no pose named 'upp'; did you mean 'up'",
        ),
    ],
)
def test_a_wrong_one_is_one_line(run, sheet, options, message):
    result = run("analyze", sheet, *options, *FEW)
    assert result.code == 2
    (line,) = result.err.splitlines()
    assert message in line
