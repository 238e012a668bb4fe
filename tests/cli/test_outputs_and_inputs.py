"""Outputs meant for where inputs stand: refused in one line before any work, and the inputs are what they were."""

from __future__ import annotations

import os
import re

import pytest

SHEET = """precision-pin: 1
robot: gantry.urdf
poses: {home: [0 mm, 0 deg]}
sources:
  - joint_offset: {joint: y_axis, offset: {empirical: {samples: {file: TABLE, column: gap}}}}
"""
TABLE = "gap [mm]\n" + "\n".join(f"{k / 100}" for k in range(50)) + "\n"
A = ("analyze", "--samples", "10", "4dof.urdf", "4dof.errors.yaml")
MESH = '<link name="tool"><visual><geometry><mesh filename="part.stl"/></geometry></visual></link>'


@pytest.fixture
def files(folder):
    """Make links to the inputs, a robot with a mesh, tables whose names are those of outputs."""
    os.symlink("4dof.urdf", folder / "soft.urdf")
    os.link(folder / "4dof.urdf", folder / "hard.urdf")
    # pages are refused by their names first: these could be pages
    os.symlink("4dof.errors.yaml", folder / "sheet.html")
    os.link(folder / "4dof.urdf", folder / "robot.html")
    os.symlink("way.csv", folder / "way.html")
    (folder / "plots").mkdir()
    for number, table in enumerate(("table.csv", "plots/analysis.json", "plots/budget-3.png", "units.csv")):
        (folder / table).write_text(TABLE)
        (folder / f"table{number}.yaml").write_text(SHEET.replace("TABLE", table))
    (folder / "part.stl").write_text("solid part\nendsolid part\n")
    (folder / "mesh.urdf").write_text((folder / "gantry.urdf").read_text("utf-8").replace('<link name="tool"/>', MESH))
    (folder / "way.csv").write_text("joint1,joint2,joint3,joint4\n0,0,0,0\n")
    return folder


INPUTS = {
    "json over the sheet": (*A, "--json", "4dof.errors.yaml"),
    "json over the robot": (*A, "--json", "./4dof.urdf"),
    "json over the robot that the sheet names": ("analyze", "4dof.errors.yaml", "--json", "4dof.urdf"),
    "json over a link": (*A, "--json", "soft.urdf"),
    "json over a hard link": (*A, "--json", "hard.urdf"),
    "json over a table": ("analyze", "table0.yaml", "--json", "table.csv"),
    "json over a mesh": ("analyze", "mesh.urdf", "gantry.errors.yaml", "--json", "part.stl"),
    "journal over the sheet": (*A, "--journal", "4dof.errors.yaml"),
    "journal over the sheet, resumed": (*A, "--journal", "4dof.errors.yaml", "--resume"),
    "folder with a table": ("analyze", "table1.yaml", "--out", "plots"),
    "budget's folder with a table": ("budget", "table2.yaml", "--out", "plots/"),
    "report over the sheet": ("report", "4dof.errors.yaml", "--out", "sheet.html"),
    "report over the robot": ("report", "4dof.errors.yaml", "--out", "robot.html"),
    "view over the sheet": ("view", "4dof.errors.yaml", "--out", "sheet.html"),
    "view over the trajectory": ("view", "4dof.errors.yaml", "--trajectory", "way.csv", "--out", "way.html"),
    "export over a table": ("export", "table3.yaml", "--out", "."),
    "simulate over the poses": ("simulate", "4dof.errors.yaml", "--trajectory", "way.csv", "--out", "way.csv"),
    "init over the robot": ("init", "4dof.urdf", "--force", "--out", "4dof.urdf"),
    "init over a mesh": ("init", "mesh.urdf", "--force", "--out", "part.stl"),
}
MEETING = {
    "json and journal": ((*A, "--json", "new", "--journal", "./new"), "--journal and --json name the same file"),
    "json and folder": ((*A, "--json", "new", "--out", "new"), "--json and --out name the same place"),
    "json in the folder": ((*A, "--json", "plots/analysis.json", "--out", "plots"), "lies in the folder of --out"),
    "journal in the folder": ((*A, "--journal", "plots/j", "--out", "plots"), "lies in the folder of --out"),
    "existing sheet": (("init", "4dof.urdf", "--out", "4dof.errors.yaml"), "--force overwrites it"),
    "json slash": ((*A, "--json", "new/"), "cannot write new/: it is a folder"),
    "journal slash": ((*A, "--journal", "new/"), "cannot write new/: it is a folder"),
    "init slash": (("init", "4dof.urdf", "--out", "new/"), "cannot write new/: it is a folder"),
    "package folder": (("check", "4dof.urdf", "--package-dir", "nosuch"), "Directory 'nosuch' does not exist"),
    "package file": (("mcpc", "4dof.urdf", "--package-dir", "4dof.urdf"), "'4dof.urdf' is a file"),
}
LONG = "x" * 300
TOO_LONG = {
    "json": (*A, "--json", LONG),
    "out": (*A, "--out", LONG),
    "journal": (*A, "--journal", LONG),
    "report": ("report", "--out", LONG + ".html"),
    "view": ("view", "--out", LONG + ".html"),
    "export": ("export", "--out", LONG),
    "init": ("init", "4dof.urdf", "--out", LONG),
    "robot": ("analyze", LONG + ".urdf"),
    "sheet beside": ("analyze", "y" * 250 + ".urdf"),
    "sheet": ("analyze", LONG + ".yaml"),
    "trajectory": ("view", "--trajectory", LONG, "--out", "page.html"),
    "packages": ("mcpc", "4dof.urdf", "--package-dir", LONG),
}


def refused(outcome):
    """Return the one line that is not a warning."""
    assert outcome.code == 2, outcome
    (line,) = [line for line in (outcome.out + outcome.err).splitlines() if " warning " not in line]
    assert " error E_" in line
    assert len(line) < 1000
    return line


@pytest.mark.fast(9)
@pytest.mark.parametrize("case", INPUTS)
def test_no_input_is_written_over(run, files, contents, monkeypatch, case):
    monkeypatch.setattr(
        "precision_pin.model.error_model.ErrorModel.from_sheet", lambda *_: pytest.fail("work was begun")
    )
    before = contents()
    assert re.search(r"cannot write \S+: it is an input of this command", refused(run(*INPUTS[case])))
    assert contents() == before


@pytest.mark.parametrize("case", MEETING)
def test_outputs_do_not_meet(run, files, contents, case):
    arguments, words = MEETING[case]
    before = contents()
    assert words in refused(run(*arguments))
    assert contents() == before


@pytest.mark.parametrize("case", TOO_LONG)
def test_a_name_that_is_too_long(run, files, contents, case):
    before = contents()
    refused(run(*TOO_LONG[case]))
    assert contents() == before


@pytest.mark.parametrize("there", [False, True])
def test_a_page_goes_into_a_folder_by_its_own_name(run, files, there):
    if there:
        (files / "pages").mkdir()
    assert run("view", "--samples", "10", "--out", "pages/").code == 0
    assert [path.name for path in (files / "pages").iterdir()] == ["view.html"]


@pytest.mark.slow
def test_outputs_of_an_earlier_run_are_written_over(run, files):
    for _ in range(2):
        assert run("export", "4dof.errors.yaml", "--out", "new").code == 0
        assert run(*A, "--json", "new/result.json").code == 0
