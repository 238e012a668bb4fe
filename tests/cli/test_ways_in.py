"""Robots of other packages, xacro, several tips and grippers, by the command line; what a line proposes is run."""

from __future__ import annotations

import re
import shlex
import sys

import pytest

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


@pytest.mark.parametrize("robot", [pytest.param("example:so101", marks=pytest.mark.slow), "forked.urdf"])
def test_the_proposed_command_works(run, robot):
    """`init` asks, `analyze` and `check` propose the same command, which then writes a sheet."""
    asked = run("init", robot)
    assert asked.code == 2
    command = re.search(rf"precision-pin (init {re.escape(robot)} --tip \S+)", asked.err)[1]
    for other in ("analyze", "check"):
        told = run(other, robot)
        assert command in told.out + told.err, other
    assert re.search(r"likely --tip \S+", run("mcpc", robot).err)
    assert run(*shlex.split(command)).code == 0


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
