"""``precision-pin analyze`` as its users meet it: which arm, which pose, what is printed, how it ends."""

from __future__ import annotations

import math

import pytest


def test_no_arguments_run_the_papers_case(run):
    outcome = run("analyze")
    assert outcome.code == 0
    assert outcome.err == ""
    first, second = outcome.out.splitlines()[:2]
    assert first == "4dof.urdf: base to tool, pose 'paper' (joint1 -90°, joint2 3°, joint3 88°, joint4 -91°)"
    assert second.startswith("100,000 samples, seed 0, exact model, statics nominal; errors in base axes")


def test_the_robot_and_the_sheet_may_come_in_either_order(run):
    arguments = ("--samples", "100", "--json", "-")
    one = run("analyze", "4dof.urdf", "4dof.errors.yaml", *arguments)
    other = run("analyze", "4dof.errors.yaml", "4dof.urdf", *arguments)
    assert one.code == other.code == 0
    assert one.out == other.out


@pytest.mark.parametrize("arguments", [("4dof.urdf",), ("4dof.errors.yaml",)])
def test_a_sheet_beside_the_robot_is_found_and_a_sheet_names_its_robot(run, arguments):
    outcome = run("analyze", *arguments, "--samples", "100", "--json", "-")
    assert outcome.code == 0
    assert outcome.json["robot"] == "4dof.urdf"
    assert outcome.json["pose"]["name"] == "paper"
    assert outcome.out == run("analyze", "--samples", "100", "--json", "-").out


def test_a_robot_on_the_command_line_overrides_the_sheets(run, folder):
    text = (folder / "4dof.urdf").read_text()
    (folder / "longer.urdf").write_text(text.replace('xyz="1.770 0 0"', 'xyz="1.9 0 0"').replace("1.77 0 0", "1.9 0 0"))
    outcome = run("analyze", "longer.urdf", "4dof.errors.yaml", "--samples", "100", "--json", "-")
    assert outcome.code == 0
    assert outcome.json["robot"] == "longer.urdf"
    # the deflected arm is longer, so its tip is moved further than the paper's
    paper = run("analyze", "--samples", "100", "--json", "-").json
    assert abs(outcome.json["nominal"]["position"][2]) > abs(paper["nominal"]["position"][2]) * 1.01


def test_an_example_robot_with_a_sheet(run, folder):
    (folder / "mine.yaml").write_text(
        "precision-pin: 1\nrobot: 4dof.urdf\ntip: tool0\nposes: {bent: 20 -70 80 -100 -90 10 deg}\n"
        "sources:\n  - joint_offset: {joint: elbow_joint, offset: {uniform: 1 mrad}}\n"
    )
    outcome = run("analyze", "example:ur5", "mine.yaml", "--samples", "200", "--json", "-")
    assert outcome.code == 0
    assert outcome.json["robot"].startswith("ur5")
    assert list(outcome.json["pose"]["q"]) == [
        "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
    ]  # fmt: skip
    # one joint that errs by at most 1 mrad turns the tool by at most that
    assert 0.9e-3 < outcome.json["attitude"]["norm"]["max"] <= 1e-3


def test_a_robot_without_a_sheet_says_how_to_get_one(run, new_files):
    outcome = run("analyze", "example:ur5")
    assert outcome.code == 2
    assert "precision-pin init example:ur5" in outcome.err
    assert len(outcome.err_lines) == 1
    assert new_files() == set()


def test_tip_and_base_override_the_sheets(run, folder):
    sheet = folder / "4dof.errors.yaml"
    kept = [line for line in sheet.read_text().splitlines() if "length: {frame: tool" not in line]
    sheet.write_text("\n".join(kept))
    outcome = run("analyze", "4dof.errors.yaml", "--tip", "link4", "--samples", "50", "--json", "-")
    assert outcome.code == 2  # the payload hangs on the tool, which is beyond the tip and still carried: not refused
