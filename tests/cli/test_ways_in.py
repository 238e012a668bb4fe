"""What a newcomer types: the command says in one line what to do next, or finds what was meant; what it proposes is run."""

from __future__ import annotations

import os
import re
import shlex
import sys
from pathlib import Path

import pytest

from precision_pin.analyses.registry import declarations
from precision_pin.cli import export
from precision_pin.cli.inputs import check_folder_name, check_page_name
from precision_pin.cli.program import list_commands
from precision_pin.robot.examples import example_urdfs

FEW = ("--samples", "200")
NEEDED = {
    "compare": ("--set", "statics=nominal"), "reliability": ("--spec", "1 mm"), "calibrate": ("--forecast",),
    **dict.fromkeys(("view", "report", "simulate"), ("--out", "made.html")), "export": ("--out", "made"),
}  # fmt: skip
WITH_ROBOT = sorted(set(list_commands()) - {"explain", "schema", "doctor"})


def error_of(outcome) -> str:
    """Return the one line that a refused command prints; ``check`` prints findings on stdout."""
    assert outcome.code == 2, outcome
    (line,) = (outcome.out + outcome.err).splitlines()
    return line


# which robot, which sheet --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "text", "name"),
    [
        ("arm.sdf", '<sdf version="1.6"><model name="arm"><link name="base"/></model></sdf>\n', "SDF"),
        ("arm.xml", '<mujoco model="arm"><worldbody/></mujoco>\n', "MJCF"),
    ],
)
def test_a_file_of_another_format_is_called_by_its_name(run, folder, file, text, name):
    (folder / file).write_text(text)
    for command in ("analyze", "check", "init"):
        line = error_of(run(command, file))
        assert line.startswith(f"{file}:1: error ")
        assert name in line
        assert "sheet" not in line


@pytest.mark.fast(5)
@pytest.mark.parametrize("command", WITH_ROBOT)
def test_every_command_says_which_robot_was_meant(run, command):
    line = error_of(run(command, "ur5", *NEEDED.get(command, ())))
    assert line == "precision-pin: error E_FILE_MISSING: there is no file 'ur5'; did you mean example:ur5?"


def test_a_robot_or_sheet_that_is_not_there_gives_the_one_that_is_meant(run, folder):
    for typed, meant in (
        ("UR5", "example:ur5"),
        ("ur5_robot.urdf", "example:ur5"),
        ("nowhere/panda.urdf", "example:panda"),
        ("4dofs.urdf", "4dof.urdf"),
    ):
        assert error_of(run("analyze", "--quiet", typed)).endswith(f" no file {typed!r}; did you mean {meant}?")
    for typed in ("nosuch.urdf", "robots", "robots/"):
        assert error_of(run("analyze", typed)).endswith(f": there is no file {typed!r}".replace("/'", "'"))
    assert error_of(run("analyze", "4dof.error.yaml")).endswith("; did you mean 4dof.errors.yaml?")
    assert error_of(run("check", "nosuch.yaml")).endswith("; precision-pin init ROBOT.urdf writes one")
    (folder / "mine.yaml").write_text("precision-pin: 1\nrobot: ur5\nsources: []\n")
    line = error_of(run("check", "mine.yaml"))
    assert line == "mine.yaml:2: error E_FILE_MISSING: there is no file 'ur5'; did you mean example:ur5?"
    (folder / "4dof.errors.yaml").rename(folder / "sheet.txt")
    (folder / "4dof.urdf").rename(folder / "robot.yaml")
    for command in ("analyze", "check", "mcpc"):
        assert "sheet.txt: error E_FILE_KIND: this is a sheet" in error_of(run(command, "sheet.txt"))
        assert "robot.yaml: error E_FILE_KIND: this is XML" in error_of(run(command, "robot.yaml"))


def test_an_example_of_a_longer_name_is_given(run):
    line = error_of(run("init", "example:talos"))
    assert "example:talos_left_arm" in line
    assert all(f"example:{name}" in line for name in example_urdfs() if "talos" in name)
    assert "tiago" not in line
    every = error_of(run("init", "example:"))
    assert all(name in every for name in example_urdfs())


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


def test_the_proposed_command_works(run):
    """`init` asks, `analyze` and `check` propose the same command, which then writes a sheet."""
    robot = "forked.urdf"
    line = error_of(run("analyze", robot))
    assert line.endswith("precision-pin init forked.urdf --tip left (or another tip: right)")
    asked = error_of(run("init", robot))
    assert "(--tip, or tip: in a sheet); likely --tip" in asked
    command = re.search(rf"precision-pin (init {re.escape(robot)} --tip \S+)", asked)[1]
    for other in ("analyze", "check"):
        told = run(other, robot)
        assert command in told.out + told.err, other
    assert re.search(r"likely --tip \S+", run("mcpc", robot).err)
    assert run(*shlex.split(command)).code == 0
    assert run("analyze", robot, *FEW).code == 0


@pytest.mark.slow
def test_the_joint_of_a_gripper_is_named_and_left_out_by_the_proposed_command(run, folder):
    warned = run("init", "example:so100")
    assert warned.code == 0
    assert "W_GRIPPER: the only leaf, 'jaw', is a finger: the joint 'gripper' opens a gripper" in warned.err
    assert "# The joint gripper opens a gripper: the tip is a finger." in (folder / "so100.errors.yaml").read_text()
    command = re.search(r"precision-pin (init example:so100 --tip gripper)", warned.err)[1]
    outcome = run(*shlex.split(command), "--force")
    assert (outcome.code, "W_GRIPPER" in outcome.err) == (0, False)
    sheet = (folder / "so100.errors.yaml").read_text()
    assert "opens a gripper" not in sheet
    assert re.search(r"locked:\n  gripper: ", sheet)


def test_a_name_with_blanks_is_quoted_in_what_to_type(run, folder):
    (folder / "4dof.urdf").rename(folder / "my arm.urdf")
    assert error_of(run("analyze", "my arm.urdf")).endswith("precision-pin init 'my arm.urdf'")
    assert run("init", "my arm.urdf").err.endswith("precision-pin analyze 'my arm.errors.yaml'\n")


def test_a_sheet_of_another_robot_says_so_first_and_a_slip_is_no_other_robot(run, folder):
    for command in ("analyze", "check"):
        outcome = run(command, "gantry.urdf", "4dof.errors.yaml")
        assert outcome.code == 2
        first, *others = (outcome.out + outcome.err).splitlines()
        assert first.startswith(
            "4dof.errors.yaml: error E_OTHER_ROBOT: this is a sheet of '4dof.urdf', not of gantry.urdf, which has not all of "
            "its joints"
        )
        assert any("E_NAME" in line for line in others)
    sheet = (folder / "4dof.errors.yaml").read_text().replace("tip: tool", "tip: tol")
    (folder / "slip.errors.yaml").write_text(sheet)
    for arguments in (("slip.errors.yaml",), ("4dof.urdf", "slip.errors.yaml"), ("./4dof.urdf", "slip.errors.yaml")):
        outcome = run("analyze", *arguments)
        assert outcome.code == 2
        assert "E_OTHER_ROBOT" not in outcome.err
        assert "did you mean 'tool'?" in outcome.err


# other packages, xacro, inertias -------------------------------------------------------------------------------------

XACRO = """<robot xmlns:xacro="http://wiki.ros.org/xacro" name="$(arg name)">
  <xacro:arg name="name" default="arm"/>
  <xacro:arg name="reach" default="0.4"/>
  <xacro:include filename="joint.xacro"/>
  <link name="base"/>
  <xacro:turning parent="base" length="$(arg reach)"/>
</robot>"""
MACRO = """<robot xmlns:xacro="http://wiki.ros.org/xacro">
  <xacro:macro name="turning" params="parent length">
    <joint name="turn" type="revolute"><parent link="${parent}"/><child link="arm"/><axis xyz="0 0 1"/>
      <limit lower="${-pi / 2}" upper="${pi / 2}" effort="1" velocity="1"/></joint>
    <link name="arm"/>
    <joint name="end" type="fixed"><parent link="arm"/><child link="tool0"/><origin xyz="${2 * length} 0 0"/></joint>
    <link name="tool0"/>
  </xacro:macro>
</robot>"""


def test_a_xacro_file_becomes_a_urdf_and_a_sheet(run, folder):
    (folder / "arm.urdf.xacro").write_text(XACRO)
    (folder / "joint.xacro").write_text(MACRO)
    for refused in (("check", "arm.urdf.xacro"), ("analyze", "arm.urdf.xacro")):
        outcome = run(*refused)
        assert outcome.code == 2
        assert "E_XACRO: unprocessed xacro: " in outcome.out + outcome.err
    assert run("init", "arm.urdf.xacro", "reach:=0.3", "name:=mine").code == 0
    text = (folder / "arm.urdf").read_text()
    assert '<origin xyz="0.6 0 0"/>' in text
    assert '<robot name="mine">' in text
    assert "\nrobot: arm.urdf\n" in (folder / "arm.errors.yaml").read_text()
    wrong = {
        ("arm.urdf.xacro",): "E_OUTPUT: arm.urdf exists; --force writes it anew",
        ("arm.urdf.xacro", "reach=0.3"): "'reach=0.3' is no xacro argument; write NAME:=VALUE",
        ("4dof.urdf", "reach:=0.3"): "4dof.urdf is not written in xacro and takes no arguments",
        ("gone.xacro",): "gone.xacro: error E_FILE_MISSING",
        ("arm.urdf.xacro", "reach:=far", "--force"): "arm.urdf.xacro: error E_XACRO: xacro cannot be expanded: ",
    }
    for arguments, message in wrong.items():
        outcome = run("init", *arguments)
        assert outcome.code == 2, arguments
        assert message in outcome.err, arguments
        assert "Traceback" not in outcome.err


def test_inertias_that_no_body_has_are_mended_in_a_copy(run, folder):
    """A plate that is too thin, and a sign: of tr(I)/2 - I, 6 - (1, 1, 10) and 1.5 - (-1, 2, 2), -4 and -0.5 become zero."""
    body = '<inertial><mass value="2"/><inertia iyy="{}" ixx="{}" izz="{}" ixy="0" iyz="0" ixz="0"/></inertial>'
    thin, sign = body.format(*(1e-3, 1e-3, 10e-3)), body.format(*(2e-3, -1e-3, 2e-3))
    bad = (
        (folder / "gantry.urdf")
        .read_text()
        .replace('<link name="Schlitten_ü"/>', f'<link name="Schlitten_ü">{thin}</link>')
        .replace('<link name="tool"/>', f'<link name="tool">{sign}</link>')
    )
    (folder / "bad.urdf").write_text(bad)
    asked = run("init", "bad.urdf")
    assert asked.code == 2
    assert "E_INERTIA_TRIANGLE: link 'Schlitten_ü'" in asked.err
    assert "precision-pin init --mend-inertia" in asked.err
    outcome = run("init", "bad.urdf", "--mend-inertia")
    assert outcome.code == 0
    assert "wrote bad.mended.urdf, bad.urdf with other inertias of 'Schlitten_ü', 'tool'" in outcome.err
    numbers = re.compile(r'(i..)="([^"]*)"')
    found = [
        dict(numbers.findall(line)) for line in re.findall("<inertia .*?>", (folder / "bad.mended.urdf").read_text())
    ]
    for one, (ixx, iyy, izz) in zip(found, ((5, 5, 10), (0, 2.5, 2.5)), strict=True):
        expected = {"ixx": ixx, "ixy": 0, "ixz": 0, "iyy": iyy, "iyz": 0, "izz": izz}
        assert {part: 1e3 * float(value) for part, value in one.items()} == pytest.approx(expected, abs=1e-12)
    assert re.sub("<inertia .*?>", "", (folder / "bad.mended.urdf").read_text()) == re.sub("<inertia .*?>", "", bad)
    assert run("check", "bad.mended.errors.yaml").code == 0
    assert "--force" in run("init", "bad.urdf", "--mend-inertia").err
    (folder / "bad.urdf").write_text(bad.replace('<mass value="2"/>', '<mass value="-2"/>'))
    outcome = run("init", "bad.urdf", "--mend-inertia", "--force")
    assert (outcome.code, "E_MASS_NEG" in outcome.err) == (2, True)
    assert run("init", "gantry.urdf", "--mend-inertia", "--out", "same.errors.yaml").code == 0
    assert not (folder / "gantry.mended.urdf").exists()


def test_robots_of_robot_descriptions(run, folder, monkeypatch):
    """A package of that name and layout, as the real one downloads."""
    package = folder / "lib" / "robot_descriptions"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(
        "class Has:\n    def __init__(self, urdf): self.has_urdf = urdf\n"
        "DESCRIPTIONS = {'forked_description': Has(True), 'made_description': Has(True), "
        "'lost_description': Has(True), 'forked_mj_description': Has(False)}"
    )
    (package / "forked_description.py").write_text(f"URDF_PATH = {str(folder / 'forked.urdf')!r}")
    (package / "made_description.py").write_text(
        f"XACRO_PATH = {str(folder / 'arm.xacro')!r}\nXACRO_ARGS = {{'reach': '0.2', 'name': 'made'}}"
    )
    (package / "lost_description.py").write_text("print('Cloning')\nraise OSError('no network\\nat all')")
    (folder / "arm.xacro").write_text(XACRO)
    (folder / "joint.xacro").write_text(MACRO)
    for name in [name for name in sys.modules if name.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(folder / "lib"))
    assert run("init", "robot_descriptions:forked", "--tip", "left").code == 0
    assert "\nrobot: robot_descriptions:forked\n" in (folder / "forked.errors.yaml").read_text()
    assert run("analyze", "forked.errors.yaml", "--samples", "100").code == 0
    assert run("init", "robot_descriptions:made_description").code == 0
    assert '<origin xyz="0.4 0 0"/>' in (folder / "made_description.urdf").read_text()
    for name, message in {
        "forkd": "no robot of robot_descriptions named 'forkd'; did you mean 'forked'?",
        "forked_mj": "no robot of robot_descriptions named 'forked_mj'",
        "lost": "robot_descriptions:lost cannot be downloaded by the package robot_descriptions: no network\\nat all",
        "made": "robot_descriptions:made is written in xacro; precision-pin init robot_descriptions:made",
    }.items():
        outcome = run("check", f"robot_descriptions:{name}")
        assert outcome.code == 2
        assert message in outcome.err + outcome.out, name
        # stdout is for data
        assert "Cloning" not in outcome.out
    for name in [name for name in sys.modules if name.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    assert "the package robot_descriptions is not installed (pip install" in run("init", "robot_descriptions:x").err


# --out ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["report", "view"])
def test_a_page_is_html_and_its_name_says_so(run, contents, command):
    before = contents()
    for name, instead in (("x.pdf", "x.html"), ("x", "x.html"), ("x.html.gz", "x.html.html")):
        line = error_of(run(command, *FEW, "--out", name))
        assert line.startswith(f"precision-pin: error E_OUTPUT: cannot write {name}: the page is HTML")
        assert line.endswith(f"--out {instead}")
    assert contents() == before
    check_page_name(os.devnull)  # a page may go into a device


def test_a_page_is_written_under_either_name_of_html_or_into_a_folder(run, folder):
    for given, name in (("PAGE.HTM", "PAGE.HTM"), ("pages/", "pages/view.html"), ("pages/", "pages/view.html")):
        assert run("view", "--samples", "10", "--out", given).code == 0
        assert (folder / name).read_text().lstrip().lower().startswith("<!doctype html")
    assert [path.name for path in (folder / "pages").iterdir()] == ["view.html"]


def test_a_folder_has_no_name_of_a_file_but_one_that_is_there_any(run, folder, contents):
    before = contents()
    for command, name, instead in (
        ("analyze", "x.json", "--json x.json"),
        ("analyze", "x.png", "--out x"),
        ("analyze", "x.HTML", "--out x"),
        ("export", "x.json", "--out x"),
        ("export", "x.urdf", "--out x"),
    ):
        line = error_of(run(command, "--out", name))
        assert f"cannot write to the folder {name}: --out takes a folder" in line
        assert line.endswith(f"give {instead}")
    assert contents() == before
    (folder / "x.png").mkdir()
    for name in ("v1.0.3", "run.2", "arm.errors", "x.json/", "x.png"):
        check_folder_name(name, json=True)


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

QUIET = {
    "analyze": ("example:ur5", *FEW),
    "view": (*FEW, "--out", "view.html"),
    "export": ("--units", "2", "--out", "built"),
    "simulate": ("--out", "readings.csv"),
    "check": (),
    "mcpc": (),
    "init": ("4dof.urdf", "--force"),
}


@pytest.mark.fast(3)
@pytest.mark.parametrize("command", QUIET)
def test_quiet_leaves_out_notes_and_keeps_warnings_and_results(run, command):
    """Those of the analyses are tried by test_contract.py, a report by test_report.py."""
    assert {*QUIET, *declarations(), "report"} == set(WITH_ROBOT)
    loud, quiet = run(command, *QUIET[command]), run(command, *QUIET[command], "--quiet")
    assert (loud.code, quiet.code) == (0, 0)
    assert quiet.out == loud.out
    assert quiet.err_lines == [line for line in loud.err_lines if ": warning " in line]
    assert len(loud.err_lines) > len(quiet.err_lines) or command == "mcpc"
