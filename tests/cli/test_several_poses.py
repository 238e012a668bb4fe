"""Several poses as one question: ``--pose`` and ``--q`` repeat, ``--all-poses``, ``--trajectory``; what is refused there."""

from __future__ import annotations

import json
import math
import re

import pytest

SHEET = "gantry.errors.yaml"
FEW = ("--samples", "500")
LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"


@pytest.mark.slow
def test_the_ways_to_give_two_poses_are_one(run, folder):
    header = f"y_axis,{LONG}"
    (folder / "way.csv").write_text(f"{header}\n0.25,{math.radians(30)!r}\n0,0\n")
    named = run("analyze", SHEET, "--pose", "out", "--pose", "home", *FEW, "--json", "-")
    everything = run("analyze", SHEET, "--all-poses", *FEW, "--json", "-")
    by_values = run("analyze", SHEET, "--q", "250 mm, 30 deg", "--q", "0 mm, 0 deg", *FEW, "--json", "-")
    along = run("analyze", SHEET, "--trajectory", "way.csv", *FEW, "--json", "-")
    assert {named.code, everything.code, by_values.code, along.code} == {0}
    assert named.out == everything.out
    assert named.json["schema"] == "precision-pin/poses/1"
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


def test_the_exit_code_the_worst_pose_and_a_row_for_each_pose(run):
    kept = run("analyze", SHEET, "--all-poses", *FEW, "--spec", "2 mm")
    assert kept.code == 0
    assert "within 2 mm for 95 % at every pose: MET" in kept.out
    missed = run("analyze", SHEET, "--all-poses", *FEW, "--spec", "0.05 mm", "--spec", "1 mrad")
    assert missed.code == 1
    lines = missed.out.splitlines()
    assert next(k for k, line in enumerate(lines) if line.startswith("worst pose")) < next(
        k for k, line in enumerate(lines) if line.startswith("spec")
    )
    assert "NOT MET - worst pose" in missed.out.replace("\n  ", " ")
    rows = [line for line in lines if line.startswith(("out ", "home "))]
    assert sorted(row.split()[0] for row in rows) == ["home", "out"]
    assert sum("(worst)" in row for row in rows) == 1


@pytest.mark.slow
def test_the_folder_holds_the_result_and_the_plots(run, new_files):
    assert run("analyze", SHEET, "--all-poses", *FEW, "--out", "plots").code == 0
    names = {"plots", "plots/poses.json"} | {f"plots/{q}.{s}" for q in ("position", "attitude") for s in ("png", "svg")}
    assert new_files() == names
    with open("plots/poses.json", encoding="utf-8") as file:
        assert len(json.load(file)["poses"]) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    ["budget", "exact-law", "worst-case", "moments"],
)
def test_the_analyses_take_poses_in_the_same_ways(run, folder, command):
    (folder / "way.csv").write_text(f"t,y_axis,{LONG}\n0,0.25,0\n1,0,0\n2,0.1,0.1\n")
    along = run(command, SHEET, "--trajectory", "way.csv", "--json", "-")
    assert len(along.json["poses"]) == 3
    everything = run(command, SHEET, "--all-poses", "--json", "-")
    assert everything.out == run(command, SHEET, "--pose", "out", "--pose", "home", "--json", "-").out
    by_values = run(command, SHEET, "--q", "0 mm, 0 deg", "--q", "1 mm, 1 deg", "--json", "-")
    assert len(by_values.json["poses"]) == 2


@pytest.mark.parametrize(
    ("option", "values"),
    [("--until", ["95 % to 0.01 mm"]), ("--relative-to", ["home"])],
)
def test_what_is_for_one_pose_is_refused_with_several(run, new_files, option, values):
    refused = run("analyze", SHEET, "--all-poses", option, *values)
    assert refused.code == 2
    assert len(refused.said) == 1
    assert f"{option} is for one pose, and 2 are given" in refused.said[0]
    assert new_files() == set()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["analyze", "map"])
def test_a_journal_of_several_poses_is_resumed_and_knows_its_run(run, folder, command):
    plain = run(command, SHEET, "--all-poses", *FEW, "--json", "-").out
    kept = (command, SHEET, "--all-poses", *FEW, "--journal", "run.journal", "--json", "-")
    assert run(*kept).out == plain
    again = run(*kept, "--resume")
    assert again.out == plain
    assert "the journal run.journal holds the first 2 poses" in again.err
    other = run(command, SHEET, "--all-poses", "--samples", "600", "--journal", "run.journal", "--resume")
    assert other.code == 2
    assert "belongs to another run: samples was '500', is '600'" in other.err
    swapped = run(command, SHEET, "--pose", "home", "--pose", "out", *FEW, "--journal", "run.journal", "--resume")
    assert "the list of poses has changed" in swapped.err


def test_a_journal_of_a_map_needs_samples(run, folder):
    refused = run("map", SHEET, "--all-poses", "--journal", "run.journal")
    assert refused.code == 2
    assert "a journal keeps sampled poses; give the number of samples too" in refused.err
    assert not (folder / "run.journal").exists()


@pytest.mark.parametrize("command", ["analyze", "budget", "view", "report --out page.html"])
@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("--pose", "out"), ("--q", "0 m, 0 deg")),
        (("--pose", "out"), ("--all-poses",)),
        (("--all-poses",), ("--trajectory", "way.csv")),
    ],
)
def test_two_ways_at_once_are_refused(run, command, one, other):
    refused = run(*command.split(), SHEET, *one, *other)
    assert refused.code == 2
    assert f"{one[0]} and {other[0]} exclude each other" in refused.err


def test_a_trajectory_is_not_written_over_nor_longer_than_a_report(run, folder):
    text = f"y_axis,{LONG}\n0,0\n0.1,0\n"
    (folder / "way.csv").write_text(text)
    rows = text + "0.1,0\n" * 12
    (folder / "long.csv").write_text(rows)
    refused = run("report", SHEET, "--trajectory", "long.csv", "--out", "page.html")
    assert (refused.code, len(refused.said)) == (2, 1)
    for command in ("analyze", "budget"):
        refused = run(command, SHEET, "--trajectory", "way.csv", "--json", "way.csv")
        assert (refused.code, (folder / "way.csv").read_text()) == (2, text)


def test_a_sheet_without_poses_has_no_all_poses(run, folder):
    text = (folder / SHEET).read_text()
    (folder / "none.yaml").write_text(text[: text.index("poses:")] + text[text.index("sources:") :])
    refused = run("analyze", "none.yaml", "--all-poses")
    assert refused.code == 2
    assert "the sheet has no poses" in refused.err


def test_one_robot_at_all_poses(run):
    everywhere = run("analyze", SHEET, "--all-poses", *FEW, "--spec", "0.3 mm", "--spec-everywhere", "--json", "-")
    (entry,) = everywhere.json["spec"]
    assert entry["everywhere"]["probability"] <= min(pose["probability"] for pose in entry["poses"])
    assert everywhere.code == (0 if entry["met"] else 1)
    shown = run("analyze", SHEET, "--all-poses", *FEW, "--spec", "0.3 mm", "--spec-everywhere").out
    assert "of robots keep it at all poses" in shown.replace("\n  ", " ")
    refused = run("analyze", SHEET, "--all-poses", "--spec-everywhere")
    assert (refused.code, len(refused.said)) == (2, 1)
    assert "--spec-everywhere needs a --spec" in refused.said[0]


def test_of_many_poses_the_six_worst_are_listed_within_100_columns(run, folder):
    rows = [f"{0.02 * k},{0.01 * k}" for k in range(15)]
    (folder / "way.csv").write_text("\n".join([f"y_axis,{LONG}", *rows, ""]))
    found = run(
        "analyze", SHEET, "--trajectory", "way.csv", *FEW, "--spec", "0.05 mm", "--spec", "1 mrad", "--json", "j"
    )
    listed = [line for line in found.out.splitlines() if line.startswith("row ")]
    assert len(listed) == 6
    assert "and 9 more poses: --all" in found.out
    every = run("analyze", SHEET, "--trajectory", "way.csv", *FEW, "--all")
    assert len([line for line in every.out.splitlines() if line.startswith("row ")]) == 15
    assert max(map(len, found.out.splitlines())) <= 100
    shares = [pose["probability"] for pose in json.loads((folder / "j").read_text())["spec"][0]["poses"]]
    worst = min(range(15), key=shares.__getitem__)
    assert listed[0].startswith(f"row {worst + 1} (worst)")


@pytest.mark.slow
def test_warnings_at_each_pose_are_those_of_its_own_analysis(run, folder):
    sheet = folder / "4dof.errors.yaml"
    sheet.write_text(re.sub(r"accept:.*\n.*\n", "", sheet.read_text("utf-8")))
    at_one = run("analyze", sheet.name, "--q", "-90 3 88 -91 deg", *FEW)
    at_two = run("analyze", sheet.name, "--q", "-90 3 88 -91 deg", "--q", "-80 3 88 -91 deg", *FEW, "--json", "-")
    (warning,) = [line.split("W_STATICS: ")[1] for line in at_one.err_lines if "W_STATICS" in line]
    warnings = [line for line in at_two.json["warnings"] if "W_STATICS" in line]
    assert len(warnings) == 2
    assert warnings[0].endswith(warning)
    assert sum("W_STATICS" in line for line in at_two.err_lines) == 1
