"""What a newcomer types: the command says in one line what was wrong and what to do next, or finds what was meant."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from precision_pin.analyses.registry import declarations
from precision_pin.cli import export
from precision_pin.cli.commands import list_commands
from precision_pin.cli.targets import check_folder_name, check_page_name
from precision_pin.robot.examples import example_urdfs

SDF = '<sdf version="1.6"><model name="arm"><link name="base"/></model></sdf>\n'
XACRO = '<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="a" value="1"/></robot>\n'
MJCF = '<mujoco model="arm"><worldbody/></mujoco>\n'
OTHER_FORMATS = {"arm.sdf": (SDF, "SDF"), "arm.urdf.xacro": (XACRO, "xacro"), "arm.xml": (MJCF, "MJCF")}
WITH_ROBOT = {
    "analyze": (),
    "budget": (),
    "check": (),
    "init": (),
    "mcpc": (),
    "worst-case": (),
    "allocate": (),
    "compare": ("--set", "statics=nominal"),
    "compensate": (),
    "iso9283": ("--robots", "20"),
    "map": (),
    "path": (),
    "exact-law": (),
    "reliability": ("--spec", "1 mm"),
    "moments": (),
    "view": ("--out", "page.html"),
    "report": ("--out", "page.html"),
    "export": ("--out", "built"),
    "simulate": ("--out", "readings.csv"),
    "calibrate": ("--forecast",),
}
FEW = ("--samples", "200")


def error_of(outcome) -> str:
    """Return the one line that a refused command prints; ``check`` prints findings on stdout."""
    assert outcome.code == 2, outcome
    lines = (outcome.out + outcome.err).splitlines()
    assert len(lines) == 1, lines
    return lines[0]


# which robot, which sheet --------------------------------------------------------------------------------------------


def test_every_command_that_takes_a_robot_is_tried():
    assert set(WITH_ROBOT) == set(list_commands()) - {"explain", "schema", "doctor"}


@pytest.mark.parametrize(
    ("command", "file"),
    [
        (command, file)
        for k, command in enumerate(WITH_ROBOT)
        for n, file in enumerate(OTHER_FORMATS)
        if command == "analyze" or k % len(OTHER_FORMATS) == n
    ],
)
def test_a_file_of_another_format_is_called_by_its_name(run, folder, command, file):
    text, name = OTHER_FORMATS[file]
    (folder / file).write_text(text)
    line = error_of(run(command, file, *WITH_ROBOT[command]))
    assert line.startswith(f"{file}:1: error ")
    assert name in line
    assert "sheet" not in line


MEANT = {
    "ur5": "example:ur5",
    "UR5": "example:ur5",
    "ur5_robot.urdf": "example:ur5",
    "panda.urdf": "example:panda",
    "nowhere/panda.urdf": "example:panda",
    "4dofs.urdf": "4dof.urdf",
}


@pytest.mark.fast(11)
@pytest.mark.parametrize(
    ("command", "typed", "meant"),
    [
        (command, typed, meant)
        for command in WITH_ROBOT
        for typed, meant in MEANT.items()
        if command == "analyze" or typed == "ur5"
    ],
)
def test_a_robot_that_is_not_there_gives_the_one_that_is_meant(run, command, typed, meant):
    line = error_of(run(command, typed, *WITH_ROBOT[command]))
    assert line == f"precision-pin: error E_FILE_MISSING: there is no file {typed!r}; did you mean {meant}?"


@pytest.mark.parametrize("typed", ["nosuch.urdf", "robots", "robots/"])
def test_a_robot_like_no_other_gives_no_hint(run, typed):
    assert error_of(run("analyze", typed)).endswith(f": there is no file {typed!r}".replace("/'", "'"))


def test_the_robot_that_a_sheet_names_gives_the_one_that_is_meant(run, folder):
    (folder / "mine.yaml").write_text("precision-pin: 1\nrobot: ur5\nsources: []\n")
    line = error_of(run("check", "mine.yaml"))
    assert line == "mine.yaml:2: error E_FILE_MISSING: there is no file 'ur5'; did you mean example:ur5?"


@pytest.mark.parametrize("command", WITH_ROBOT)
def test_a_sheet_and_a_robot_of_the_other_ones_name(run, folder, command):
    (folder / "4dof.errors.yaml").rename(folder / "sheet.txt")
    (folder / "4dof.urdf").rename(folder / "robot.yaml")
    if command != "init":
        assert "sheet.txt: error E_FILE_KIND: this is a sheet" in error_of(
            run(command, "sheet.txt", *WITH_ROBOT[command])
        )
        assert "robot.yaml: error E_FILE_KIND: this is XML" in error_of(
            run(command, "robot.yaml", *WITH_ROBOT[command])
        )


def test_an_option_without_its_value_points_to_the_commands_own_help(run):
    assert error_of(run("analyze", "--samples")).endswith("see precision-pin analyze --help")


def test_an_example_of_a_longer_name_is_given(run):
    line = error_of(run("init", "example:talos"))
    assert "example:talos_left_arm" in line
    assert all(f"example:{name}" in line for name in example_urdfs() if "talos" in name)
    assert "tiago" not in line
    every = error_of(run("init", "example:"))
    assert all(name in every for name in example_urdfs())


def test_a_sheet_that_is_not_there_gives_the_nearest(run):
    assert error_of(run("analyze", "4dof.error.yaml")).endswith("; did you mean 4dof.errors.yaml?")
    assert error_of(run("check", "nosuch.yaml")).endswith("; precision-pin init ROBOT.urdf writes one")


@pytest.mark.slow
def test_init_then_analyze_of_the_same_example_finds_the_sheet_just_written(run, folder):
    shipped = run("analyze", "example:ur5", *FEW)
    assert shipped.code == 0
    # a shipped sheet has no warning
    assert shipped.err_lines == ["example:ur5: with the sheet that comes with precision-pin, ur5.errors.yaml"]
    assert run("init", "example:ur5", "--tip", "tool0").code == 0
    own = run("analyze", "example:ur5", *FEW)
    assert "example:ur5: with the sheet of this folder, ur5.errors.yaml" in own.err_lines
    assert own.out == run("analyze", "ur5.errors.yaml", *FEW).out


@pytest.mark.slow
def test_init_then_analyze_of_a_robot_in_another_folder(run, folder):
    (folder / "deep").mkdir()
    (folder / "4dof.urdf").rename(folder / "deep" / "arm_robot.urdf")
    (folder / "4dof.errors.yaml").unlink()
    assert "precision-pin init deep/arm_robot.urdf" in error_of(run("analyze", "deep/arm_robot.urdf"))
    assert run("init", "deep/arm_robot.urdf").code == 0
    outcome = run("analyze", "deep/arm_robot.urdf", *FEW)
    assert outcome.code == 0
    assert "deep/arm_robot.urdf: with the sheet of this folder, arm.errors.yaml" in outcome.err_lines
    # the one beside the robot comes first, and says so where there are both
    beside = (folder / "arm.errors.yaml").read_text().replace("deep/arm_robot.urdf", "arm_robot.urdf")
    (folder / "deep" / "arm_robot.errors.yaml").write_text(beside)
    both = run("analyze", "deep/arm_robot.urdf", *FEW)
    assert both.code == 0
    expected = "with the sheet beside it, deep/arm_robot.errors.yaml, not arm.errors.yaml of this folder"
    assert f"deep/arm_robot.urdf: {expected}" in both.err_lines


def test_a_missing_sheet_of_an_arm_with_several_tips_names_them(run):
    line = error_of(run("analyze", "forked.urdf"))
    assert line.endswith("precision-pin init forked.urdf --tip left (or another tip: right)")
    assert run("init", "forked.urdf", "--tip", "left").code == 0
    assert run("analyze", "forked.urdf", *FEW).code == 0


def test_a_name_with_blanks_is_quoted_in_what_to_type(run, folder):
    (folder / "4dof.urdf").rename(folder / "my arm.urdf")
    assert error_of(run("analyze", "my arm.urdf")).endswith("precision-pin init 'my arm.urdf'")
    assert run("init", "my arm.urdf").err.endswith("precision-pin analyze 'my arm.errors.yaml'\n")


@pytest.mark.parametrize("command", ["analyze", "check", "mcpc", "budget"])
def test_a_sheet_of_another_robot_says_so_first(run, command):
    outcome = run(command, "gantry.urdf", "4dof.errors.yaml")
    assert outcome.code == 2
    first, *others = (outcome.out + outcome.err).splitlines()
    said = "error E_OTHER_ROBOT: this is a sheet of '4dof.urdf', not of gantry.urdf, which has not all of its joints"
    assert first.startswith(f"4dof.errors.yaml: {said}")
    assert any("E_NAME" in line for line in others)


def test_a_slip_in_the_sheet_of_the_same_robot_is_no_other_robot(run, folder):
    sheet = (folder / "4dof.errors.yaml").read_text().replace("tip: tool", "tip: tol")
    (folder / "slip.errors.yaml").write_text(sheet)
    for arguments in (("slip.errors.yaml",), ("4dof.urdf", "slip.errors.yaml"), ("./4dof.urdf", "slip.errors.yaml")):
        outcome = run("analyze", *arguments)
        assert outcome.code == 2
        assert "E_OTHER_ROBOT" not in outcome.err
        assert "did you mean 'tool'?" in outcome.err


def test_values_without_quotes_are_told_from_inputs(run):
    for words in (("--spec", "1", "mm", "@", "95", "%"), ("--q", "0", "3", "88", "91", "deg")):
        line = error_of(run("analyze", *words))
        assert "E_USAGE: one robot and one sheet are expected" in line
        assert "need quotes" in line


def test_several_tips_say_how_to_name_one(run):
    assert error_of(run("init", "forked.urdf")).endswith(
        "left, right (--tip, or tip: in a sheet); likely --tip left: precision-pin init forked.urdf --tip left"
    )


# --out ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["report", "view"])
@pytest.mark.parametrize(("name", "instead"), [("x.pdf", "x.html"), ("x", "x.html"), ("x.html.gz", "x.html.html")])
def test_a_page_is_html_and_its_name_says_so(run, contents, command, name, instead):
    before = contents()
    line = error_of(run(command, *FEW, "--out", name))
    assert line.startswith(f"precision-pin: error E_OUTPUT: cannot write {name}: the page is HTML")
    assert line.endswith(f"--out {instead}")
    assert contents() == before


@pytest.mark.parametrize("name", ["page.html", "PAGE.HTM"])
def test_a_page_is_written_under_either_name_of_html(run, folder, name):
    assert run("view", *FEW, "--out", name).code == 0
    assert (folder / name).read_text().lstrip().lower().startswith("<!doctype html")


def test_a_page_may_go_into_a_device():
    check_page_name(os.devnull)


@pytest.mark.parametrize(
    "command", ["analyze", "budget", "worst-case", "exact-law", "reliability", "moments", "export"]
)
@pytest.mark.parametrize("name", ["x.json", "x.png", "x.pdf", "x.urdf", "x.HTML"])
def test_a_folder_has_no_name_of_a_file(run, contents, command, name):
    before = contents()
    given = WITH_ROBOT[command] if command == "reliability" else ()
    line = error_of(run(command, *given, "--out", name))
    assert f"cannot write to the folder {name}: --out takes a folder" in line
    takes_json = command != "export" and name.endswith(".json")
    assert line.endswith("give --json x.json" if takes_json else "give --out x")
    assert contents() == before


@pytest.mark.slow
def test_a_folder_may_have_a_dot_and_one_that_is_there_any_name(run, folder):
    (folder / "x.png").mkdir()
    for name in ("v1.0.3", "arm.errors", "x.json/", "x.png"):
        check_folder_name(name, json=True)
    assert run("analyze", *FEW, "--out", "run.2").code == 0
    assert (folder / "run.2" / "analysis.json").is_file()


# export of many units ------------------------------------------------------------------------------------------------


def test_export_of_many_units_tells_time_and_size_first(run, folder, monkeypatch):
    monkeypatch.setattr(export, "FEW_UNITS", 2)
    monkeypatch.setattr(export, "LONG", 0.0)
    outcome = run("export", "gantry.urdf", "--units", "9", "--out", "built")
    assert outcome.code == 0
    told, wrote = outcome.said[-2:]
    assert told.startswith("9 robots take ")
    assert told.endswith(" s")
    assert wrote.startswith("wrote built")
    # an estimate of what is really taken, to a factor
    block = os.statvfs(folder).f_frsize
    taken = sum(-(-file.stat().st_size // block) * block for file in (folder / "built").iterdir())
    words = told.split()
    said = float(words[3]) * {"kB": 1e3, "MB": 1e6, "GB": 1e9}[words[4]]
    assert taken / 2 < said < 2 * taken


def test_export_refuses_what_the_disk_has_no_room_for(run, contents, monkeypatch):
    before = contents()
    real = os.statvfs

    def crowded(path: Path, **changes: int) -> object:
        found = real(path)
        names = ("f_frsize", "f_bavail", "f_files", "f_favail")
        return type("Disk", (), {name: changes.get(name, getattr(found, name)) for name in names})

    monkeypatch.setattr(os, "statvfs", lambda path: crowded(path, f_bavail=100, f_frsize=4096))
    line = error_of(run("export", "gantry.urdf", "--units", "100000", "--out", "deep/built"))
    assert "cannot write to the folder deep/built: 100,000 robots take 4" in line
    assert "410 kB are free" in line
    monkeypatch.setattr(os, "statvfs", lambda path: crowded(path, f_files=10**6, f_favail=99_000))
    assert "room for 99,000 files is left" in error_of(run("export", "gantry.urdf", "--units", "100000", "--out", "b"))
    assert contents() == before


# quiet ---------------------------------------------------------------------------------------------------------------


def told(run, command: str, *words: str) -> None:
    """Check that a command says the same with --quiet, but for notes."""
    loud, quiet = run(command, *words), run(command, *words, "--quiet")
    assert (loud.code, quiet.code) == (0, 0)
    assert quiet.out == loud.out
    assert quiet.err_lines == [line for line in loud.err_lines if ": warning " in line]
    assert len(loud.err_lines) > len(quiet.err_lines) or command == "mcpc"


QUICK = {
    "analyze": ("example:ur5", *FEW),
    "view": (*FEW, "--out", "view.html"),
    "export": ("--units", "2", "--out", "built"),
    "simulate": ("--out", "readings.csv"),
    "check": (),
    "mcpc": (),
    "init": ("4dof.urdf", "--force"),
}
LONGER = {
    "calibrate": ("--plan", "4", "--random", "8", "--out", "plan"),
    "report": ("--samples", "1000", "--out", "report.html"),
}


@pytest.mark.fast(3)
@pytest.mark.parametrize("command", QUICK)
def test_quiet_leaves_out_notes_and_keeps_warnings_and_results(run, command):
    told(run, command, *QUICK[command])


@pytest.mark.slow
@pytest.mark.parametrize("command", LONGER)
def test_quiet_of_the_longer_commands(run, command):
    told(run, command, *LONGER[command])


def test_every_command_with_a_robot_is_tried_quietly():
    # test_contract.py tries those of the analyses
    assert {*QUICK, *LONGER, *declarations()} == set(WITH_ROBOT)


def test_quiet_keeps_errors(run):
    assert "did you mean" in error_of(run("analyze", "--quiet", "ur5"))
