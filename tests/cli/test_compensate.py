"""``precision-pin compensate``: tables, files, exit codes, wrong input."""

from __future__ import annotations

import csv
import json
import math

import numpy as np
import pytest

from precision_pin import Chain

SHEET = "4dof.errors.yaml"
WAY = "t,joint4,joint3,joint2,joint1\n0,-1.588,1.536,0.0524,-1.571\n0.5,-1.4,1.3,0.1,-1.2\n"


@pytest.mark.slow
def test_the_first_lines_answer_the_question(run):
    done = run("compensate", SHEET)
    assert done.code == 0
    lines = done.out.splitlines()
    assert lines[0].startswith("|d| at the means: from 36.77 mm at worst")
    assert "to 0 mm" in lines[0]
    assert any("position corrected" in line for line in lines)
    assert max(map(len, lines)) <= 100


@pytest.mark.slow
def test_a_trajectory_comes_back_with_its_columns(run, folder, new_files):
    (folder / "way.csv").write_text(WAY)
    done = run("compensate", SHEET, "--trajectory", "way.csv", "--csv", "right.csv", "--json", "right.json")
    assert done.code == 0
    rows = list(csv.reader((folder / "right.csv").read_text().splitlines()))
    assert rows[0] == ["t", "joint4", "joint3", "joint2", "joint1"]
    assert [float(row[0]) for row in rows[1:]] == [0, 0.5]
    result = json.loads((folder / "right.json").read_text())
    assert result["schema"] == "precision-pin/compensation/1"
    for row, pose in zip(rows[1:], result["poses"], strict=True):
        assert [float(cell) for cell in row[:0:-1]] == pytest.approx(pose["q_corrected"], abs=1e-12)
        assert np.linalg.norm(pose["after"]["position"]) < 1e-9
    again = run("compensate", SHEET, "--trajectory", "right.csv", "--json", "-")
    assert again.json["poses"][0]["q"] == pytest.approx(result["poses"][0]["q_corrected"], abs=1e-12)
    assert new_files() == {"way.csv", "right.csv", "right.json"}


@pytest.mark.slow
def test_a_trajectory_in_degrees_comes_back_in_degrees(run, folder):
    (folder / "way.csv").write_text("joint1 [deg],joint2 [deg],joint3,joint4 [mrad]\n-90,3,1.5,-1600\n")
    done = run("compensate", SHEET, "--trajectory", "way.csv", "--csv", "right.csv", "--json", "-")
    header, row = csv.reader((folder / "right.csv").read_text().splitlines())
    assert header == ["joint1 [deg]", "joint2 [deg]", "joint3", "joint4 [mrad]"]
    corrected = done.json["poses"][0]["q_corrected"]
    units = (math.pi / 180, math.pi / 180, 1, 1e-3)
    assert [float(cell) * unit for cell, unit in zip(row, units, strict=True)] == pytest.approx(corrected, abs=1e-12)


@pytest.mark.slow
def test_the_corrected_arm_stands_where_it_was_meant_to(run, folder):
    """The file is read by other commands: nominal pose at the corrected values plus the error there is the pose wanted."""
    done = run("compensate", SHEET, "--csv", "right.csv", "--json", "right.json")
    header, row = csv.reader((folder / "right.csv").read_text().splitlines())
    assert header == [f"joint{k} [deg]" for k in range(1, 5)]
    corrected = np.deg2rad([float(cell) for cell in row])
    lines = [line.split() for line in done.out.splitlines()]
    assert [[float(cell) for cell in line[2:]] for line in lines if line[:1] and line[0] in ("joint1", "joint2")] == [
        pytest.approx([asked, math.degrees(to), math.degrees(to) - asked], abs=1e-4)
        for asked, to in zip((-90, 3), corrected, strict=False)
    ]
    error = run("analyze", SHEET, "--trajectory", "right.csv", "--samples", "1000", "--json", "-").json
    error = error["poses"][0] if "poses" in error else error
    chain = Chain.from_urdf(folder / "4dof.urdf", tip="tool")
    wanted, reached = (chain.at(np.array(q)).pose[:3, 3] for q in (np.deg2rad([-90, 3, 88, -91]), corrected))
    assert reached + error["nominal"]["position"] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.slow
def test_without_a_correction_the_code_is_one_and_no_joint_values_are_written(run, folder, new_files):
    text = (folder / SHEET).read_text()
    (folder / "way.csv").write_text("joint1,joint2,joint3,joint4\n0,0,0,0\n-1.571,0.0524,1.536,-1.588\n")
    done = run("compensate", SHEET, "--trajectory", "way.csv", "--csv", "right.csv")
    assert done.code == 1
    assert "1 of 2 poses have no correction" in done.out
    assert "the corrected joint values are not written: not every pose has them" in done.err
    assert new_files() == {"way.csv"}
    assert (folder / SHEET).read_text() == text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--mode", "pose"), "pose has 6 components, which 4 joints cannot all correct"),
        (("--weights", "1 1 1 0 0 0"), 'weights need mode="pose"'),
        (("--mode", "pose", "--weights", "1 2"), "six numbers are expected"),
    ],
)
def test_wrong_input_is_one_line(run, new_files, options, message):
    done = run("compensate", SHEET, *options)
    assert done.code == 2
    assert len(done.said) == 1
    assert message in done.said[0]
    assert new_files() == set()


@pytest.mark.slow
def test_a_page_shows_the_arm_before_and_after(run, folder):
    (folder / "way.csv").write_text(WAY)
    made = run("view", SHEET, "--samples", "20", "--compensate", "way.csv", "--out", "page.html")
    assert made.code == 0
    assert "at the means: from" in (folder / "page.html").read_text("utf-8")
    for command in ("view", "report"):
        refused = run(command, SHEET, "--compensate", "nosuch.csv", "--out", "other.html")
        assert (refused.code, len(refused.said)) == (2, 1)
        assert not (folder / "other.html").exists()


@pytest.mark.slow
def test_a_report_has_a_section_about_it(run, folder):
    (folder / "way.csv").write_text(WAY)
    made = run("report", SHEET, "--samples", "500", "--compensate", "way.csv", "--out", "page.html")
    assert made.code == 0
    page = (folder / "page.html").read_text("utf-8")
    assert 'href="#compensation"' in page
    assert "--compensate way.csv" in page
