"""Verdicts that must not pass without having looked: nothing varies, too few samples, assumptions, another pose's limits."""

from __future__ import annotations

import json
import math
import re
import shutil

import pytest

from precision_pin.robot.examples import example_urdfs, shipped_sheets

from .conftest import Run

HEAD = "precision-pin: 1\nrobot: 4dof.urdf\ntip: tool\nposes:\n  reach: 0 10 30 0 deg\n"
TURNS = "sources:\n  - joint_offset: {joint: joint1, offset: {normal: 0.02 deg}}\n"
SOFT = "  - joint_compliance: {joint: joint1, compliance: {uniform: 1e-6 rad/(N*m), mean: 1e-5 rad/(N*m)}}\n"
NOTHING = {
    "no sources": ("", "W_NO_SOURCES"),
    "a tolerance of zero": (TURNS.replace("0.02", "0"), "W_NOTHING_VARIES"),
    "what varies reaches nothing": (f"gravity: none\nsources:\n{SOFT}", "W_NOTHING_VARIES"),
}
REACHES = "sources:\n  - length: {frame: tool, parameters: PARAMETERS}\n"


@pytest.fixture
def judged(run: Run, folder):
    """Return what analyses a sheet with few samples against specifications."""

    def command(text: str, *specs: str):
        (folder / "own.yaml").write_text(HEAD + text, "utf-8")
        words = [word for spec in specs for word in ("--spec", spec)]
        outcome = run("analyze", "own.yaml", "--samples", "300", *words, "--json", "found.json")
        found = json.loads((folder / "found.json").read_text("utf-8"))
        return outcome, [entry["verdict"] for entry in found["spec"]]

    return command


@pytest.mark.parametrize("case", NOTHING)
def test_where_nothing_varies_a_specification_is_not_met(run: Run, folder, judged, case: str) -> None:
    text, code = NOTHING[case]
    outcome, verdicts = judged(text, "1 mm")
    assert (outcome.code, verdicts) == (1, ["nothing to judge"])
    assert "spec |d| within 1 mm for 95 %: NOTHING TO JUDGE - no source" in outcome.out
    found = json.loads((folder / "found.json").read_text("utf-8"))
    assert found["spec"][0]["met"] is False
    assert any(code in line for line in found["warnings"])
    rare = run("reliability", "own.yaml", "--samples", "300", "--spec", "1 mm", "--json", "found.json")
    assert rare.code == 1
    assert "|d| within 1 mm for 95 %: NOTHING TO JUDGE - no source" in rare.out
    (pose,) = json.loads((folder / "found.json").read_text("utf-8"))["poses"]
    assert [(entry["met"], entry["verdict"]) for entry in pose["spec"]] == [(False, "nothing to judge")]
    for err in (outcome.err, rare.err):
        assert re.findall("W_NO_SOURCES|W_NOTHING_VARIES", err) == [code]
    checked = run("check", "own.yaml")
    assert (checked.code, code in checked.out) == (0, True)


def test_each_quantity_is_judged_by_what_moves_it(judged) -> None:
    # joint1 turns about z: it moves no point up or down, and tilts nothing
    outcome, verdicts = judged(TURNS, "dz 1 mm", "dx 10 mm", "|d| 10 mm", "δx 1 mrad", "|δ| 1.5 mrad")
    assert verdicts == ["nothing to judge", "met", "met", "nothing to judge", "met"]
    assert outcome.code == 1
    assert "W_NOTHING" not in outcome.err
    # a constant error beyond the limit; and one of one size that changes its side
    outcome, verdicts = judged(REACHES.replace("PARAMETERS", "{fixed: 2 mm}"), "1 mm", "3 mm")
    assert (outcome.code, verdicts) == (1, ["not met", "nothing to judge"])
    assert judged(REACHES.replace("PARAMETERS", "{two_point: 1 mm}"), "1.1 mm")[1] == ["met"]


def test_a_rare_value_that_no_sample_met_is_judged(judged) -> None:
    # 1e-9 of the robots are off by 2 mm: 300 samples all alike hold 95 %, as Clopper and Pearson have it
    rare = "{two_point: 1 mm, centre: 1 mm, probability: 1e-9}"
    outcome, verdicts = judged(REACHES.replace("PARAMETERS", rare), "1 mm")
    assert (outcome.code, verdicts) == (0, ["met"])


def test_a_large_limit_of_the_attitude_is_told_in_degrees_too(run: Run, folder) -> None:
    outcome = run("analyze", "--samples", "300", "--spec", "0.5 rad", "--spec", "20 mrad")
    assert "|δ| within 500 mrad (28.65 deg) for 95 %: MET" in outcome.out
    assert "|δ| within 20 mrad for 95 %: MET" in outcome.out


def test_too_few_samples_are_undecided(run: Run, folder) -> None:
    (folder / "turns.yaml").write_text(HEAD + TURNS, "utf-8")
    for samples in (1, 71, 72):
        outcome = run("analyze", "turns.yaml", "--samples", str(samples), "--spec", "1 m")
        # with no failure the lower end is 0.025^(1/N), which reaches 95 % from N = 72 on
        enough = samples >= math.log(0.025) / math.log(0.95)
        assert outcome.code == (0 if enough else 1)
        assert ("within 1000 mm for 95 %: MET" if enough else "within 1000 mm for 95 %: UNDECIDED - 100") in outcome.out


# assumptions ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_verdict_says_that_it_rests_on_assumptions(run: Run, folder) -> None:
    line = "rests on assumptions: 1 of 1 sources are marked as assumed in the sheet (joint_offset)"
    caused = "they cause 100 % of the variance of the position, 100 % of the attitude"
    (folder / "assumed.yaml").write_text(HEAD + TURNS.replace("}}", "}, assumed: true}"), "utf-8")
    asked = ("assumed.yaml", "--samples", "300", "--spec", "5 mm", "--json", "found.json")
    for command, lines in (("analyze", slice(-3, -1)), ("reliability", slice(-2, None))):
        outcome = run(command, *asked, *(("--all",) if command == "analyze" else ()))
        assert outcome.code == 0
        first, second = outcome.out.splitlines()[lines]
        assert first == line
        assert second.startswith(caused)
        assert json.loads((folder / "found.json").read_text("utf-8"))["assumed"] == ["joint_offset[joint1]"]
    brief = run("analyze", *asked).out.replace("\n  ", " ")
    assert f"{line.removesuffix(' (joint_offset)')}; {caused}\n" in brief
    (folder / "own.yaml").write_text(HEAD + TURNS, "utf-8")
    own = run("analyze", "own.yaml", *asked[1:])
    assert "assum" not in own.out + own.err


def test_what_init_drafts_is_marked_as_assumed_in_every_source(run: Run, folder) -> None:
    assert "all its numbers assumptions" in run("init", "gantry.urdf", "--out", "drafted.yaml").err
    outcome = run("analyze", "drafted.yaml", "--samples", "300", "--spec", "1 m", "--json", "-")
    sources = re.findall(r"^  - \w+: .*", (folder / "drafted.yaml").read_text("utf-8"), re.MULTILINE)
    assert len(outcome.json["assumed"]) == len(sources) > 3


@pytest.mark.slow
def test_init_starts_from_the_sheet_with_sources_of_its_chain(run: Run, folder) -> None:
    if "ur5" not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    for name in ("ur5", "ur5e"):
        outcome = run("init", f"example:{name}")
        assert outcome.code == 0
        assert "the sheet with sources that comes with precision-pin" in outcome.err
        assert (folder / f"{name}.errors.yaml").read_text("utf-8") == shipped_sheets()[name].read_text("utf-8")
    assert run("check", "ur5.errors.yaml").code == 0
    # an arm of the same name; and the same arm with another chain
    shutil.copy(example_urdfs()["ur5"], folder / "mine.urdf")
    outcome = run("init", "mine.urdf", "--tip", "tool0")
    assert outcome.code == 0
    assert "(with sources: precision-pin init example:ur5, if this is such an arm)" in outcome.err
    outcome = run("init", "example:ur5", "--tip", "wrist_3_link", "--force")
    assert outcome.code == 0
    shipped = "the sheet with sources that comes with precision-pin is of world to tool0"
    assert f"all its numbers assumptions ({shipped})" in outcome.err
    assert "assumed: true" in (folder / "ur5.errors.yaml").read_text("utf-8")


# check at the poses --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_check_tells_limits_as_analyze_does_at_every_one_of_many_poses(run: Run, folder) -> None:
    more = "".join(f"  p{k}: 0 0 {400 if k == 299 else 0} 0 deg\n" for k in range(300))
    (folder / "many.yaml").write_text(HEAD.replace("10 30", "400 30") + more + TURNS, "utf-8")
    outcome = run("check", "many.yaml")
    assert outcome.code == 0
    first, last = outcome.out.splitlines()
    assert "W_JOINT_LIMIT: pose 'reach': joint joint2 at 400 deg is outside its limits -180 to 180 deg" in first
    assert first.replace("pose 'reach': ", "") in run("analyze", "many.yaml", "--samples", "10").err
    assert "pose 'p299': joint joint3 at 400 deg" in last


def test_what_analyze_refuses_at_a_pose_is_an_error_of_check(run: Run, folder) -> None:
    soft = "sources:\n  - frame: {joint: joint2, rx: {uniform: 1 deg, mean: 200 deg}}\n"
    (folder / "soft.yaml").write_text(HEAD + soft, "utf-8")
    refused = run("analyze", "soft.yaml", "--samples", "10")
    outcome = run("check", "soft.yaml")
    assert (refused.code, outcome.code) == (2, 2)
    assert refused.err.splitlines()[-1].partition("E_INPUT: ")[2] in outcome.out
    (folder / "bare.yaml").write_text("precision-pin: 1\nrobot: 4dof.urdf\ntip: tool\n" + TURNS, "utf-8")
    outcome = run("check", "bare.yaml")
    assert (outcome.code, "W_NO_POSES" in outcome.out) == (0, True)


@pytest.mark.slow
def test_joint_values_of_the_command_line_are_asked_about(run: Run) -> None:
    outcome = run("analyze", "--q", "90 0 45 0 rad", "--samples", "10")
    assert "W_ANGLE_UNIT: --q: joint1 at 90 rad is 5157 deg; did you mean deg?" in outcome.err
