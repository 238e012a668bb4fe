"""What a newcomer types: the command says in one line what to do next, or finds what was meant; what it proposes is run."""

import os
import re
import shlex
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import precision_pin as pp
from cli.conftest import GANTRY
from precision_pin.analyses.registry import declarations
from precision_pin.cli import export
from precision_pin.cli.inputs import check_folder_name, check_page_name
from precision_pin.cli.program import list_commands
from precision_pin.robot.examples import example_urdfs, resolve_robot

FEW = ("--samples", "200")
NEEDED = {
    "compare": ("--set", "statics=nominal"), "reliability": ("--spec", "1 mm"), "calibrate": ("--forecast",),
    **dict.fromkeys(("view", "report", "simulate"), ("--out", "made.html")), "export": ("--out", "made"),
}  # fmt: skip
WITH_ROBOT = sorted(set(list_commands()) - {"explain", "schema", "doctor"})


# which robot, which sheet --------------------------------------------------------------------------------------------


def test_a_file_of_another_format_is_called_by_its_name(refused, folder):
    sdf = '<sdf version="1.6"><model name="arm"><link name="base"/></model></sdf>\n'
    mjcf = '<mujoco model="arm"><worldbody/></mujoco>\n'
    for file, text, name in (("arm.sdf", sdf, "SDF"), ("arm.xml", mjcf, "MJCF")):
        (folder / file).write_text(text)
        for command in ("analyze", "check", "init"):
            line = refused(command, file)
            assert line.startswith(f"{file}:1: error ")
            assert name in line
            assert "sheet" not in line


@pytest.mark.fast(5)
@pytest.mark.parametrize("command", WITH_ROBOT)
def test_every_command_says_which_robot_was_meant(refused, command):
    line = refused(command, "ur5", *NEEDED.get(command, ()))
    assert line == "precision-pin: error E_FILE_MISSING: there is no file 'ur5'; did you mean example:ur5?"


def test_a_robot_or_sheet_that_is_not_there_gives_the_one_that_is_meant(refused, folder):
    (folder / "mine.yaml").write_text("precision-pin: 1\nrobot: ur5\nsources: []\n")
    for typed, ending in (
        ("analyze --quiet UR5", "there is no file 'UR5'; did you mean example:ur5?"),
        ("analyze ur5_robot.urdf", "there is no file 'ur5_robot.urdf'; did you mean example:ur5?"),
        ("analyze nowhere/panda.urdf", "there is no file 'nowhere/panda.urdf'; did you mean example:panda?"),
        ("analyze 4dofs.urdf", "there is no file '4dofs.urdf'; did you mean 4dof.urdf?"),
        ("analyze nosuch.urdf", ": there is no file 'nosuch.urdf'"),
        ("analyze robots/", ": there is no file 'robots'"),
        ("analyze 4dof.error.yaml", "; did you mean 4dof.errors.yaml?"),
        ("check nosuch.yaml", "; precision-pin init ROBOT.urdf writes one"),
        ("check mine.yaml", "mine.yaml:2: error E_FILE_MISSING: there is no file 'ur5'; did you mean example:ur5?"),
    ):
        assert refused(*typed.split()).endswith(ending)
    (folder / "4dof.errors.yaml").rename(folder / "sheet.txt")
    (folder / "4dof.urdf").rename(folder / "robot.yaml")
    for command in ("analyze", "check", "mcpc"):
        assert "sheet.txt: error E_FILE_KIND: this is a sheet" in refused(command, "sheet.txt")
        assert "robot.yaml: error E_FILE_KIND: this is XML" in refused(command, "robot.yaml")


def test_an_example_of_a_longer_name_is_given(refused):
    line = refused("init", "example:talos")
    assert all(f"example:{name}" in line for name in example_urdfs() if "talos" in name)
    assert "tiago" not in line
    every = refused("init", "example:")
    assert all(name in every for name in example_urdfs())


@pytest.mark.slow
def test_init_then_analyze_of_the_same_example_finds_the_sheet_just_written(run, folder):
    # a shipped sheet has no warning
    shipped = "example:ur5: with the sheet that comes with precision-pin, ur5.errors.yaml"
    assert run("analyze", "example:ur5", *FEW).err_lines == [shipped]
    run("init", "example:ur5", "--tip", "tool0")
    own = run("analyze", "example:ur5", *FEW)
    assert "example:ur5: with the sheet of this folder, ur5.errors.yaml" in own.err_lines
    assert own.out == run("analyze", "ur5.errors.yaml", *FEW).out


@pytest.mark.slow
def test_init_then_analyze_of_a_robot_in_another_folder(run, refused, folder):
    (folder / "deep").mkdir()
    (folder / "4dof.urdf").rename(folder / "deep" / "arm_robot.urdf")
    (folder / "4dof.errors.yaml").unlink()
    assert "precision-pin init deep/arm_robot.urdf" in refused("analyze", "deep/arm_robot.urdf")
    run("init", "deep/arm_robot.urdf")
    outcome = run("analyze", "deep/arm_robot.urdf", *FEW)
    assert "deep/arm_robot.urdf: with the sheet of this folder, arm.errors.yaml" in outcome.err_lines
    # the one beside the robot comes first, and says so where there are both
    beside = (folder / "arm.errors.yaml").read_text().replace("deep/arm_robot.urdf", "arm_robot.urdf")
    (folder / "deep" / "arm_robot.errors.yaml").write_text(beside)
    both = run("analyze", "deep/arm_robot.urdf", *FEW)
    expected = "with the sheet beside it, deep/arm_robot.errors.yaml, not arm.errors.yaml of this folder"
    assert f"deep/arm_robot.urdf: {expected}" in both.err_lines


def test_the_proposed_command_works(run, refused):
    """`init` asks, `analyze` and `check` propose the same command, which then writes a sheet."""
    proposed = "precision-pin init forked.urdf --tip left (or another tip: right)"
    assert refused("analyze", "forked.urdf").endswith(proposed)
    asked = refused("init", "forked.urdf")
    assert "(--tip, or tip: in a sheet); likely --tip" in asked
    command = re.search(r"precision-pin (init forked\.urdf --tip \S+)", asked)[1]
    assert command in run("check", "forked.urdf").out
    assert re.search(r"likely --tip \S+", refused("mcpc", "forked.urdf"))
    run(*shlex.split(command))
    run("analyze", "forked.urdf", *FEW)


@pytest.mark.slow
def test_the_joint_of_a_gripper_is_named_and_left_out_by_the_proposed_command(run, folder):
    (folder / "arm.urdf").write_text(Path(resolve_robot("example:so100")).read_text())
    warned = run("init", "arm.urdf").err
    assert "W_GRIPPER: the only leaf, 'jaw', is a finger: the joint 'gripper' opens a gripper" in warned
    assert "# The joint gripper opens a gripper: the tip is a finger." in (folder / "arm.errors.yaml").read_text()
    command = re.search(r"precision-pin (init arm.urdf --tip gripper)", warned)[1]
    assert "W_GRIPPER" not in run(*shlex.split(command), "--force").err
    sheet = (folder / "arm.errors.yaml").read_text()
    assert "opens a gripper" not in sheet
    assert re.search(r"locked:\n  gripper: ", sheet)


def test_a_name_with_blanks_is_quoted_in_what_to_type(run, refused, folder):
    (folder / "4dof.urdf").rename(folder / "my arm.urdf")
    assert refused("analyze", "my arm.urdf").endswith("precision-pin init 'my arm.urdf'")
    assert run("init", "my arm.urdf").err.endswith("precision-pin analyze 'my arm.errors.yaml'\n")


def test_a_sheet_of_another_robot_says_so_first_and_a_slip_is_no_other_robot(run, folder):
    for command in ("analyze", "check"):
        first, *others = run(command, "gantry.urdf", "4dof.errors.yaml", code=2).lines
        assert first.startswith(
            "4dof.errors.yaml: error E_OTHER_ROBOT: this is a sheet of '4dof.urdf', not of gantry.urdf, which has not all of "
            "its joints"
        )
        assert any("E_NAME" in line for line in others)
    sheet = (folder / "4dof.errors.yaml").read_text().replace("tip: tool", "tip: tol")
    (folder / "slip.errors.yaml").write_text(sheet)
    for robot in ((), ("4dof.urdf",), ("./4dof.urdf",)):
        said = run("analyze", *robot, "slip.errors.yaml", code=2).err
        assert "E_OTHER_ROBOT" not in said
        assert "did you mean 'tool'?" in said


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


def test_a_xacro_file_becomes_a_urdf_and_a_sheet(run, refused, folder):
    (folder / "arm.urdf.xacro").write_text(XACRO)
    (folder / "joint.xacro").write_text(MACRO)
    for command in ("check", "analyze"):
        assert "E_XACRO: unprocessed xacro: " in refused(command, "arm.urdf.xacro")
    run("init", "arm.urdf.xacro", "reach:=0.3", "name:=mine")
    text = (folder / "arm.urdf").read_text()
    assert '<origin xyz="0.6 0 0"/>' in text
    assert '<robot name="mine">' in text
    assert "\nrobot: arm.urdf\n" in (folder / "arm.errors.yaml").read_text()
    for arguments, message in {
        "arm.urdf.xacro": "E_OUTPUT: arm.urdf exists; --force writes it anew",
        "arm.urdf.xacro reach=0.3": "'reach=0.3' is no xacro argument; write NAME:=VALUE",
        "4dof.urdf reach:=0.3": "4dof.urdf is not written in xacro and takes no arguments",
        "gone.xacro": "gone.xacro: error E_FILE_MISSING",
        "arm.urdf.xacro reach:=far --force": "arm.urdf.xacro: error E_XACRO: xacro cannot be expanded: ",
    }.items():
        assert message in refused("init", *arguments.split())


@pytest.mark.slow
def test_packages_of_a_xacro_are_found_as_those_of_meshes(run, refused, folder, monkeypatch):
    """Beside the xacro's own package, above it, and in ``--package-dir``, which goes first."""
    for package in ("ws/parts", "ws/arm_support/urdf", "elsewhere/parts"):
        (folder / package).mkdir(parents=True)
    for k, place in enumerate(("ws", "elsewhere")):
        (folder / place / "parts" / "package.xml").write_text("<package><name>parts</name></package>")
        (folder / place / "parts" / "joint.xacro").write_text(MACRO.replace("2 * length", f"{2 + k} * length"))
    xacro = XACRO.replace('"joint.xacro"', '"$(find parts)/joint.xacro"')
    (folder / "ws" / "arm_support" / "urdf" / "arm.xacro").write_text(xacro)
    for options, reach in (
        ((), "0.8"),
        (("--package-dir", "elsewhere"), "1.2"),
        (("--package-dir", "ws/parts"), "0.8"),
    ):
        run("init", *options, "ws/arm_support/urdf/arm.xacro", "name:=mine", "--force")
        assert f'<origin xyz="{float(reach):.12g}' in (folder / "arm.urdf").read_text().replace(
            "1.2000000000000002", "1.2"
        )
    (folder / "arm.xacro").write_text(xacro)
    assert "the package 'parts' of the xacro is not found; give its folder (--package-dir)" in refused(
        "init", "arm.xacro", "name:=mine", "--force"
    )
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    assert "is not installed (pip install 'precision-pin[xacro]')" in refused(
        "init", "arm.xacro", "name:=mine", "--force"
    )


def test_a_urdf_with_unused_properties_of_xacro_is_read(run, refused, folder):
    text = (folder / "forked.urdf").read_text()
    root = text[text.index("<robot") : text.index(">", text.index("<robot")) + 1]
    more = root.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    (folder / "left.urdf").write_text(text.replace(root, f'{more}<xacro:property name="w" value="0.2"/>'))
    done = run("init", "left.urdf", "--tip", "left")
    assert "warning W_UNKNOWN_ELEMENT: unknown element <xacro:property>" in done.err
    assert run("check", "left.errors.yaml").out == run("check", "left.urdf", "left.errors.yaml").out
    for bad in ('<xacro:property name="w" value="${v}"/>', '<xacro:property name="w" value="1"/><xacro:arm/>'):
        (folder / "bad.urdf").write_text(text.replace(root, more + bad))
        line = refused("init", "bad.urdf", "--tip", "left")
        assert "error E_XACRO: unprocessed xacro" in line
        assert "init FILE.xacro, with this suffix, writes it" in line


def test_inertias_that_no_body_has_are_mended_in_a_copy(run, refused, folder):
    """A plate that is too thin, and a sign: of tr(I)/2 - I, 6 - (1, 1, 10) and 1.5 - (-1, 2, 2), -4 and -0.5 become zero."""
    body = '<inertial><mass value="2"/><inertia iyy="{}" ixx="{}" izz="{}" ixy="0" iyz="0" ixz="0"/></inertial>'
    bad = GANTRY
    for name, moments in (("Schlitten_ü", (1e-3, 1e-3, 10e-3)), ("tool", (2e-3, -1e-3, 2e-3))):
        bad = bad.replace(f'<link name="{name}"/>', f'<link name="{name}">{body.format(*moments)}</link>')
    (folder / "bad.urdf").write_text(bad)
    asked = run("init", "bad.urdf", code=2).err
    assert "E_INERTIA_TRIANGLE: link 'Schlitten_ü'" in asked
    assert "precision-pin init --mend-inertia" in asked
    outcome = run("init", "bad.urdf", "--mend-inertia")
    assert "wrote bad.mended.urdf, bad.urdf with other inertias of 'Schlitten_ü', 'tool'" in outcome.err
    mended = (folder / "bad.mended.urdf").read_text()
    found = [dict(re.findall(r'(i..)="([^"]*)"', line)) for line in re.findall("<inertia .*?>", mended)]
    for one, (ixx, iyy, izz) in zip(found, ((5, 5, 10), (0, 2.5, 2.5)), strict=True):
        expected = {"ixx": ixx, "ixy": 0, "ixz": 0, "iyy": iyy, "iyz": 0, "izz": izz}
        assert {part: 1e3 * float(value) for part, value in one.items()} == pytest.approx(expected, abs=1e-12)
    assert re.sub("<inertia .*?>", "", mended) == re.sub("<inertia .*?>", "", bad)
    run("check", "bad.mended.errors.yaml")
    assert "--force" in refused("init", "bad.urdf", "--mend-inertia")
    (folder / "bad.urdf").write_text(bad.replace('<mass value="2"/>', '<mass value="-2"/>'))
    assert "E_MASS_NEG" in run("init", "bad.urdf", "--mend-inertia", "--force", code=2).err
    run("init", "gantry.urdf", "--mend-inertia", "--out", "same.errors.yaml")
    assert not (folder / "gantry.mended.urdf").exists()


def test_robots_of_robot_descriptions(run, refused, folder, monkeypatch):
    """A package of that name and layout, as the real one downloads."""
    package = folder / "lib" / "robot_descriptions"
    package.mkdir(parents=True)
    for name, text in {
        "__init__.py": "class Has:\n    def __init__(self, urdf): self.has_urdf = urdf\n"
        "DESCRIPTIONS = {'forked_description': Has(True), 'made_description': Has(True), "
        "'lost_description': Has(True), 'forked_mj_description': Has(False)}",
        "forked_description.py": f"URDF_PATH = {str(folder / 'forked.urdf')!r}",
        "made_description.py": f"XACRO_PATH = {str(folder / 'arm.xacro')!r}\nXACRO_ARGS = {{'reach': '0.2', 'name': 'made'}}",
        "lost_description.py": "print('Cloning')\nraise OSError('no network\\nat all')",
        "../../arm.xacro": XACRO,
        "../../joint.xacro": MACRO,
    }.items():
        (package / name).write_text(text)
    for name in [name for name in sys.modules if name.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(folder / "lib"))
    run("init", "robot_descriptions:forked", "--tip", "left")
    assert "\nrobot: robot_descriptions:forked\n" in (folder / "forked.errors.yaml").read_text()
    run("analyze", "forked.errors.yaml", "--samples", "100")
    assert pp.ErrorModel.load("robot_descriptions:forked").sheet.file == str(folder / "forked.errors.yaml")
    run("init", "robot_descriptions:made_description")
    assert '<origin xyz="0.4 0 0"/>' in (folder / "made_description.urdf").read_text()
    for name, message in {
        "forkd": "no robot of robot_descriptions named 'forkd'; did you mean 'forked'?",
        "forked_mj": "no robot of robot_descriptions named 'forked_mj'",
        "lost": "robot_descriptions:lost cannot be downloaded by the package robot_descriptions: no network\\nat all",
        "made": "robot_descriptions:made is written in xacro; precision-pin init robot_descriptions:made",
    }.items():
        outcome = run("check", f"robot_descriptions:{name}", code=2)
        assert message in outcome.err + outcome.out, name
        # stdout is for data
        assert "Cloning" not in outcome.out
    for name in [name for name in sys.modules if name.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    assert "the package robot_descriptions is not installed (pip install" in refused("init", "robot_descriptions:x")


# --out ---------------------------------------------------------------------------------------------------------------


def test_a_page_is_html_and_its_name_says_so(refused):
    for command in ("report", "view"):
        for name, instead in (("x.pdf", "x.html"), ("x", "x.html"), ("x.html.gz", "x.html.html")):
            line = refused(command, *FEW, "--out", name)
            assert line.startswith(f"precision-pin: error E_OUTPUT: cannot write {name}: the page is HTML")
            assert line.endswith(f"--out {instead}")
    check_page_name(os.devnull)  # a page may go into a device


def test_a_page_is_written_under_either_name_of_html_or_into_a_folder(run, folder):
    for given, name in (("PAGE.HTM", "PAGE.HTM"), ("pages/", "pages/view.html"), ("pages/", "pages/view.html")):
        run("view", "--samples", "10", "--out", given)
        assert (folder / name).read_text().lstrip().lower().startswith("<!doctype html")
    assert [path.name for path in (folder / "pages").iterdir()] == ["view.html"]


def test_a_folder_has_no_name_of_a_file_but_one_that_is_there_any(refused, folder):
    for command, name, instead in (
        ("analyze", "x.json", "--json x.json"),
        ("analyze", "x.png", "--out x"),
        ("analyze", "x.HTML", "--out x"),
        ("export", "x.json", "--out x"),
        ("export", "x.urdf", "--out x"),
    ):
        line = refused(command, "--out", name)
        assert f"cannot write to the folder {name}: --out takes a folder" in line
        assert line.endswith(f"give {instead}")
    (folder / "x.png").mkdir()
    for name in ("v1.0.3", "run.2", "arm.errors", "x.json/", "x.png"):
        check_folder_name(name, json=True)


# export of many units ------------------------------------------------------------------------------------------------


def test_export_of_many_units_tells_time_and_size_first(run, folder, monkeypatch):
    monkeypatch.setattr(export, "FEW_UNITS", 2)
    monkeypatch.setattr(export, "LONG", 0.0)
    told, wrote = run("export", "gantry.urdf", "--units", "9", "--out", "built").said[-2:]
    number, unit = re.fullmatch(r"9 robots take (\S+) (kB|MB|GB).* s", told).groups()
    assert wrote.startswith("wrote built")
    # an estimate of what is really taken, to a factor
    block = os.statvfs(folder).f_frsize
    taken = sum(-(-file.stat().st_size // block) * block for file in (folder / "built").iterdir())
    assert taken / 2 < float(number) * {"kB": 1e3, "MB": 1e6, "GB": 1e9}[unit] < 2 * taken


def test_the_sheet_of_a_robot_alone_is_named(run):
    outcome = run("analyze", "gantry.urdf", "--samples", "200")
    assert outcome.err_lines[0] == "gantry.urdf: with the sheet beside it, gantry.errors.yaml"
    assert "with the sheet" not in run("analyze", "gantry.urdf", "gantry.errors.yaml", "--samples", "200").err


def test_export_refuses_what_the_disk_has_no_room_for(refused, monkeypatch):
    real = os.statvfs
    asked = ("export", "gantry.urdf", "--units", "100000", "--out", "deep/built")
    for crowded, said in (
        ({"f_bavail": 100, "f_frsize": 4096}, "folder deep/built: 100,000 robots take 4.* 410 kB are free"),
        ({"f_files": 10**6, "f_favail": 99_000}, "room for 99,000 files is left"),
    ):
        names = ("f_frsize", "f_bavail", "f_files", "f_favail")
        disk = SimpleNamespace(**{name: getattr(real("."), name) for name in names} | crowded)
        monkeypatch.setattr(os, "statvfs", lambda _, disk=disk: disk)
        assert re.search(said, refused(*asked))


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
    assert quiet.out == loud.out
    assert quiet.err_lines == [line for line in loud.err_lines if ": warning " in line]
    assert len(loud.err_lines) > len(quiet.err_lines) or command == "mcpc"
