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
UNLOADED = f"gravity: none\nsources:\n{SOFT}"
ASSUMED = "sources:\n  - joint_offset: {joint: joint1, offset: {normal: 0.02 deg}, assumed: true}\n"
NOTHING = {
    "no sources": ("", "W_NO_SOURCES"),
    "an empty list": ("sources: []\n", "W_NO_SOURCES"),
    "a tolerance of zero": (TURNS.replace("0.02", "0"), "W_NOTHING_VARIES"),
    "what varies reaches nothing": (UNLOADED, "W_NOTHING_VARIES"),
    "a constant alone": ("sources:\n  - length: {joint: joint2, parameters: {fixed: 0.1 mm}}\n", "W_NOTHING_VARIES"),
}  # fmt: skip


@pytest.mark.parametrize("case", NOTHING)
class TestNothingVaries:
    def test_a_specification_is_not_met(self, run: Run, folder, case: str) -> None:
        text, code = NOTHING[case]
        (folder / "none.yaml").write_text(HEAD + text, "utf-8")
        outcome = run("analyze", "none.yaml", "--samples", "300", "--spec", "1 mm", "--json", "found.json")
        assert outcome.code == 1
        assert "spec |d| within 1 mm for 95 %: NOTHING TO JUDGE - no source" in outcome.out
        assert len(re.findall("W_NO_SOURCES|W_NOTHING_VARIES", outcome.err)) == 1
        assert code in outcome.err
        found = json.loads((folder / "found.json").read_text("utf-8"))
        assert [(entry["met"], entry["verdict"]) for entry in found["spec"]] == [(False, "nothing to judge")]
        assert any(code in line for line in found["warnings"])

    def test_check_and_reliability_say_so(self, run: Run, folder, case: str) -> None:
        text, code = NOTHING[case]
        (folder / "none.yaml").write_text(HEAD + text, "utf-8")
        checked = run("check", "none.yaml")
        assert checked.code == 0
        assert [line for line in checked.out.splitlines() if code in line]
        outcome = run("reliability", "none.yaml", "--samples", "300", "--spec", "1 mm", "--json", "found.json")
        assert outcome.code == 1
        assert len(re.findall("W_NO_SOURCES|W_NOTHING_VARIES", outcome.err)) == 1
        assert "|d| within 1 mm for 95 %: NOTHING TO JUDGE - no source" in outcome.out
        (pose,) = json.loads((folder / "found.json").read_text("utf-8"))["poses"]
        assert [(entry["met"], entry["verdict"]) for entry in pose["spec"]] == [(False, "nothing to judge")]


def test_a_constant_error_beyond_the_limit_is_not_met(run: Run, folder) -> None:
    text = HEAD + "sources:\n  - length: {frame: tool, parameters: {fixed: 2 mm}}\n"
    (folder / "constant.yaml").write_text(text, "utf-8")
    outcome = run("analyze", "constant.yaml", "--samples", "300", "--spec", "1 mm", "--spec", "3 mm")
    assert outcome.code == 1
    assert "within 1 mm for 95 %: NOT MET" in outcome.out
    assert "within 3 mm for 95 %: NOTHING TO JUDGE" in outcome.out


def test_each_quantity_is_judged_by_what_moves_it(run: Run, folder) -> None:
    # joint1 turns about z: it moves no point up or down, and tilts nothing
    (folder / "turns.yaml").write_text(HEAD + TURNS, "utf-8")
    specs = ("dz 1 mm", "dx 10 mm", "|d| 10 mm", "δx 1 mrad", "|δ| 1.5 mrad")
    words = [word for spec in specs for word in ("--spec", spec)]
    outcome = run("analyze", "turns.yaml", "--samples", "300", *words, "--json", "-")
    assert outcome.code == 1
    assert [entry["verdict"] for entry in outcome.json["spec"]] == [
        "nothing to judge", "met", "met", "nothing to judge", "met",
    ]  # fmt: skip
    assert "W_NOTHING" not in outcome.err


def test_an_error_of_one_size_that_changes_its_side_is_judged(run: Run, folder) -> None:
    (folder / "sides.yaml").write_text(
        HEAD + "sources:\n  - length: {frame: tool, parameters: {two_point: 1 mm}}\n", "utf-8"
    )
    outcome = run("analyze", "sides.yaml", "--samples", "300", "--spec", "1.1 mm", "--json", "-")
    assert [entry["verdict"] for entry in outcome.json["spec"]] == ["met"]


def test_a_rare_value_that_no_sample_met_is_judged(run: Run, folder) -> None:
    # 1e-9 of the robots are off by 2 mm: 300 samples all alike hold 95 %, as Clopper and Pearson have it
    text = (
        HEAD + "sources:\n  - length: {frame: tool, parameters: {two_point: 1 mm, centre: 1 mm, probability: 1e-9}}\n"
    )
    (folder / "rare.yaml").write_text(text, "utf-8")
    outcome = run("analyze", "rare.yaml", "--samples", "300", "--spec", "1 mm", "--json", "-")
    assert outcome.code == 0
    assert [entry["verdict"] for entry in outcome.json["spec"]] == ["met"]


def test_a_large_limit_of_the_attitude_is_told_in_degrees_too(run: Run, folder) -> None:
    outcome = run("analyze", "--samples", "300", "--spec", "0.5 rad", "--spec", "20 mrad")
    assert "|δ| within 500 mrad (28.65 deg) for 95 %: MET" in outcome.out
    assert "|δ| within 20 mrad for 95 %: MET" in outcome.out


@pytest.mark.parametrize("samples", [1, 10, 72, 73])
def test_too_few_samples_are_undecided(run: Run, folder, samples: int) -> None:
    # with no failure the lower end is 0.025^(1/N), which reaches 95 % from N = 72 on
    (folder / "turns.yaml").write_text(HEAD + TURNS, "utf-8")
    outcome = run("analyze", "turns.yaml", "--samples", str(samples), "--spec", "1 m")
    enough = 0.025 ** (1 / samples) >= 0.95
    assert enough == (samples >= math.log(0.025) / math.log(0.95))
    assert outcome.code == (0 if enough else 1)
    assert ("within 1000 mm for 95 %: MET" if enough else "within 1000 mm for 95 %: UNDECIDED - 100") in outcome.out


class TestAssumptions:
    LINE = "rests on assumptions: 1 of 1 sources are marked as assumed in the sheet (joint_offset)"

    @pytest.mark.slow
    def test_a_verdict_says_that_it_rests_on_them(self, run: Run, folder) -> None:
        (folder / "assumed.yaml").write_text(HEAD + ASSUMED, "utf-8")
        outcome = run("analyze", "assumed.yaml", "--samples", "300", "--spec", "5 mm", "--json", "found.json", "--all")
        assert outcome.code == 0
        caused = "they cause 100 % of the variance of the position, 100 % of the attitude"
        assert outcome.out.splitlines()[-3:-1] == [self.LINE, caused]
        brief = run("analyze", "assumed.yaml", "--samples", "300", "--spec", "5 mm").out.replace("\n  ", " ")
        assert f"{self.LINE.removesuffix(' (joint_offset)')}; {caused}\n" in brief
        assert json.loads((folder / "found.json").read_text("utf-8"))["assumed"] == ["joint_offset[joint1]"]
        rare = run("reliability", "assumed.yaml", "--samples", "300", "--spec", "5 mm", "--json", "rare.json")
        assert rare.out.splitlines()[-2] == self.LINE
        assert rare.out.splitlines()[-1].startswith(caused)
        assert json.loads((folder / "rare.json").read_text("utf-8"))["assumed"] == ["joint_offset[joint1]"]

    def test_and_no_longer_once_the_mark_is_gone(self, run: Run, folder) -> None:
        (folder / "own.yaml").write_text(HEAD + ASSUMED.replace(", assumed: true", ""), "utf-8")
        outcome = run("analyze", "own.yaml", "--samples", "300", "--spec", "5 mm")
        assert "assum" not in outcome.out + outcome.err

    def test_what_init_drafts_is_marked_in_every_source(self, run: Run, folder) -> None:
        assert "all its numbers assumptions" in run("init", "gantry.urdf", "--out", "drafted.yaml").err
        outcome = run("analyze", "drafted.yaml", "--samples", "300", "--spec", "1 m", "--json", "-")
        sources = re.findall(r"^  - \w+: .*", (folder / "drafted.yaml").read_text("utf-8"), re.MULTILINE)
        assert len(outcome.json["assumed"]) == len(sources) > 3


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in shipped_sheets() if name != "4dof"])
def test_init_starts_from_the_sheet_with_sources(run: Run, folder, name: str) -> None:
    if name not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    outcome = run("init", f"example:{name}")
    assert outcome.code == 0
    assert "the sheet with sources that comes with precision-pin" in outcome.err
    assert (folder / f"{name}.errors.yaml").read_text("utf-8") == shipped_sheets()[name].read_text("utf-8")
    assert run("check", f"{name}.errors.yaml").code == 0


@pytest.mark.slow
def test_init_names_the_sheet_with_sources_of_an_arm_of_the_same_name(run: Run, folder) -> None:
    if "ur5" not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    shutil.copy(example_urdfs()["ur5"], folder / "mine.urdf")
    outcome = run("init", "mine.urdf", "--tip", "tool0")
    assert outcome.code == 0
    assert "(with sources: precision-pin init example:ur5, if this is such an arm)" in outcome.err


@pytest.mark.slow
def test_init_drafts_where_the_chain_is_another(run: Run, folder) -> None:
    if "ur5" not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    outcome = run("init", "example:ur5", "--tip", "wrist_3_link")
    assert outcome.code == 0
    assert (
        "all its numbers assumptions (the sheet with sources that comes with precision-pin is of world to tool0)"
        in outcome.err
    )
    assert "assumed: true" in (folder / "ur5.errors.yaml").read_text("utf-8")


class TestCheckAtPoses:
    def test_limits_are_told_as_analyze_does(self, run: Run, folder) -> None:
        (folder / "out.yaml").write_text(HEAD.replace("10 30", "400 30") + "  folded: 0 0 30 0 deg\n" + TURNS, "utf-8")
        outcome = run("check", "out.yaml")
        assert outcome.code == 0
        (line,) = outcome.out.splitlines()
        assert "W_JOINT_LIMIT: pose 'reach': joint joint2 at 400 deg is outside its limits -180 to 180 deg" in line
        assert line.replace("pose 'reach': ", "") in run("analyze", "out.yaml", "--samples", "10").err

    @pytest.mark.slow
    def test_limits_are_told_of_very_many_poses(self, run: Run, folder) -> None:
        more = "".join(f"  p{k}: 0 0 {400 if k == 299 else 0} 0 deg\n" for k in range(300))
        (folder / "many.yaml").write_text(HEAD + more + TURNS, "utf-8")
        (line,) = run("check", "many.yaml").out.splitlines()
        assert "pose 'p299': joint joint3 at 400 deg" in line

    def test_what_analyze_refuses_at_a_pose_is_an_error(self, run: Run, folder) -> None:
        soft = "sources:\n  - frame: {joint: joint2, rx: {uniform: 1 deg, mean: 200 deg}}\n"
        (folder / "soft.yaml").write_text(HEAD + soft, "utf-8")
        refused = run("analyze", "soft.yaml", "--samples", "10")
        outcome = run("check", "soft.yaml")
        assert (refused.code, outcome.code) == (2, 2)
        assert refused.err.splitlines()[-1].partition("E_INPUT: ")[2] in outcome.out

    def test_a_sheet_without_poses_is_warned_of(self, run: Run, folder) -> None:
        (folder / "bare.yaml").write_text("precision-pin: 1\nrobot: 4dof.urdf\ntip: tool\n" + TURNS, "utf-8")
        outcome = run("check", "bare.yaml")
        assert (outcome.code, "W_NO_POSES" in outcome.out) == (0, True)

    @pytest.mark.slow
    def test_joint_values_of_the_command_line_are_asked_about(self, run: Run, folder) -> None:
        outcome = run("analyze", "--q", "90 0 45 0 rad", "--samples", "10")
        assert "W_ANGLE_UNIT: --q: joint1 at 90 rad is 5157 deg; did you mean deg?" in outcome.err
        assert "W_ANGLE_UNIT" not in run("analyze", "--q", "90 0 45 0 deg", "--samples", "10").err
