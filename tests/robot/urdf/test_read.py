"""Every mutation of a sound arm brings exactly the finding it deserves, at its line, naming what is wrong."""

import codecs
import gzip
import math
import time

import pytest

from precision_pin.base.errors import UrdfError
from precision_pin.robot.urdf import Cylinder, Inertial, Limit, Limits, Shape, parse
from precision_pin.robot.urdf.editing import Placement, UrdfText

SHOULDER_LIMIT = '<limit lower="-2" upper="2" effort="50" velocity="1.5"/>'
ELBOW_AXIS = '<axis xyz="0 -1 0"/>'
FORE_INERTIA = '<inertia ixx="0" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/>'
FORE_INERTIAL = '<inertial>\n      <origin xyz="0.15'
FORE_MASS = '<mass value="1.5"/>'
SHOULDER = '<joint name="shoulder" type="revolute">'
ELBOW = '<joint name="elbow" type="continuous">'
ELBOW_ORIGIN = '<origin xyz="0.4 0 0" rpy="0.1 0.2 0.3"/>'
FORE_LINK = '<link name="fore">'
CYLINDER = '<cylinder radius="0.05" length="0.4"/>'
COLOR = '<color rgba="0.5 0.5 0.5 1"/>'
USED = '<material name="grey"/>'
FLANGE_CHILD = '<child link="tip"/>'
END = "</robot>"
LOOP = """<link name="a"/><link name="b"/>
<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"""

# what is replaced, by what, code, words the message must hold, text in whose line it must stand
ERRORS = [
    # XML
    ('<mass value="2.5"/>', '<mass value="2.5" value="3"/>', "E_XML_SYNTAX", ["duplicate"], "value=\"3\""),
    ('<link name="ram"/>', '<link name="ram\0"/>', "E_XML_SYNTAX", ["NUL"], "\0"),
    (
        '<?xml version="1.0"?>\n',
        '<?xml version="1.0"?>\n<!DOCTYPE r [\n<!ENTITY x SYSTEM "file:///etc/passwd">]>\n',
        "E_XML_DTD", ["DOCTYPE"], "<!DOCTYPE",
    ),
    ('<?xml version="1.0"?>', "<!DOCTYPE html>", "E_XML_SYNTAX", ["HTML"], "<!DOCTYPE"),
    ('<?xml version="1.0"?>', '<?xml version="1.0" encoding="utf-16"?>', "E_XML_ENCODING", ["utf-16"], "utf-16"),
    ('<link name="ram"/>', "<x>" * 64 + "</x>" * 64, "E_XML_DEPTH", ["64"], "<x>"),
    ('<link name="ram"/>', f'<link name="{"r" * 70_000}"/>', "E_TOO_BIG", ["65536"], "rrr"),
    ('<mass value="2.5"/>', '<mass value="${m}"/>', "E_XACRO", ["xacro", "${m}"], "${m}"),
    ('<robot name="arm">', '<robot>', "E_NO_NAME", ["robot"], "<robot>"),
    ('<robot name="arm">', '<robot name="arm" version="2.0">', "E_VERSION", ["2.0", "1.0"], "version=\"2.0"),
    ('<robot name="arm">', '<robot name="arm" xmlns="urn:x">', "E_NO_ROBOT", ["urn:x"], "urn:x"),
    (ELBOW_ORIGIN, '<origin xyz="0.4 0 0" quat_xyzw="0 0 0 1"/>', "E_VERSION", ["elbow", "rpy"], "quat"),
    # what may stand once
    (ELBOW_AXIS, ELBOW_AXIS + '<axis xyz="1 0 0"/>', "E_DUP_ELEMENT", ["elbow", "axis"], "0 -1 0"),
    # names
    ('<link name="ram"/>', '<link name="ram"/>\n<link name=" "/>', "E_EMPTY_NAME", ["link"], '" "'),
    ('<link name="ram"/>', '<link name="ram"/>\n<link name="fore"/>', "E_DUP_LINK", ["fore"], '"fore"/>'),
    (ELBOW, ELBOW.replace("elbow", "shoulder"), "E_DUP_JOINT", ["shoulder"], 'name="shoulder" type="cont'),
    ("tip", "universe", "E_RESERVED_NAME", ["universe"], '<link name="universe"'),
    # structure
    ('<child link="tip"/>', '<child link="top"/>', "E_UNKNOWN_LINK", ["flange", "top", "'tip'"], "flange"),
    ('<parent link="ram"/>', "", "E_NO_PARENT", ["flange"], "flange"),
    ('<child link="tip"/>', "<child/>", "E_NO_CHILD", ["flange"], "<child/>"),
    ('<child link="tip"/>', '<child link="ram"/>', "E_LOOP", ["flange", "ram"], "flange"),
    ('<child link="tip"/>', '<child link="fore"/>', "E_LOOP", ["flange", "elbow", "fore"], "flange"),
    (END, LOOP, "E_LOOP", ["'a'", "'b'"], 'name="ba"'),
    ('<link name="tip"/>', '<link name="tip"/>\n<link name="lost"/>', "E_TWO_ROOTS", ["foot", "lost"], "lost"),
    # numbers
    (FORE_MASS, '<mass value="1,5"/>', "E_NUMBER", ["fore", "1,5", "decimal point"], "1,5"),
    (FORE_MASS, '<mass value=""/>', "E_NUMBER", ["fore", "empty"], 'value=""'),
    (FORE_MASS, "<mass>1.5</mass>", "E_NUMBER", ["fore", "no value"], "<mass>"),
    (FORE_MASS, '<mass value="१"/>', "E_NUMBER", ["fore", "plain number"], "१"),
    (FORE_MASS, '<mass value="-INF"/>', "E_NOT_FINITE", ["fore", "-INF"], '"-INF"'),
    (FORE_MASS, '<mass value="1e999"/>', "E_NOT_FINITE", ["fore", "1e999"], '"1e999"'),
    (ELBOW_ORIGIN, '<origin xyz="4e9 0 0"/>', "E_UNITS", ["elbow", "metres"], "4e9"),
    (FORE_MASS, '<mass value="4e9"/>', "E_UNITS", ["fore", "kg"], "4e9"),
    # joints
    (ELBOW, ELBOW.replace("continuous", "hinge"), "E_JOINT_TYPE", ["elbow", "hinge", "revolute"], "hinge"),
    (ELBOW, '<joint name="elbow">', "E_JOINT_TYPE", ["elbow", "no type"], "elbow"),
    (ELBOW, ELBOW.replace("continuous", "floating"), "E_JOINT_UNSUPPORTED", ["elbow", "floating"], "floating"),
    (ELBOW_AXIS, '<axis xyz="0 0 0"/>', "E_AXIS_ZERO", ["elbow"], '"0 0 0"/>\n  </joint>'),
    (ELBOW_AXIS, '<axis xyz="1e200 1e200 0"/>', "E_AXIS_NORM", ["elbow", "1e200"], "1e200"),
    (ELBOW_AXIS, '<axis xyz="0 -9e-7 0"/>', "E_AXIS_ZERO", ["elbow", "0 -9e-7 0"], "0 -9e-7"),
    (ELBOW_AXIS, "<axis/>", "E_AXIS_ZERO", ["elbow", "no xyz"], "<axis/>"),
    (ELBOW_AXIS, ELBOW_AXIS + '<mimic joint="flange"/>', "E_MIMIC", ["elbow", "flange", "fixed"], ELBOW),
    (SHOULDER_LIMIT, "", "E_LIMITS", ["shoulder", "no limit"], SHOULDER),
    (SHOULDER_LIMIT, SHOULDER_LIMIT.replace('"2"', '"-3"'), "E_LIMITS", ["shoulder", "-3"], '"-3"'),
    (SHOULDER_LIMIT, SHOULDER_LIMIT.replace("50", "-50"), "E_LIMITS", ["shoulder", "effort"], "-50"),
    (ELBOW_AXIS, ELBOW_AXIS + '<mimic joint="wrist"/>', "E_MIMIC", ["elbow", "wrist"], ELBOW),
    (ELBOW_AXIS, ELBOW_AXIS + '<mimic joint="elbow"/>', "E_MIMIC", ["elbow", "itself"], "<mimic"),
    (ELBOW_AXIS, ELBOW_AXIS + "<mimic/>", "E_MIMIC", ["elbow", "names no joint"], "<mimic"),
    (ELBOW_AXIS, ELBOW_AXIS + '<dynamics damping="nan"/>', "E_NOT_FINITE", ["elbow", "damping"], "<dynamics"),
    # masses
    (FORE_MASS, '<mass value="-1"/>', "E_MASS_NEG", ["fore", "-1"], '"-1"'),
    (FORE_INERTIA, "", "E_INERTIAL", ["fore", "ixx"], FORE_INERTIAL),
    (FORE_INERTIA, FORE_INERTIA.replace('iyz="0" ', ""), "E_INERTIAL", ["fore", "iyz"], 'ixx="0"'),
    (FORE_INERTIA, FORE_INERTIA.replace('iyz="0"', 'iyz="0.03"'), "E_INERTIA_PD", ["fore"], FORE_LINK),
    (FORE_INERTIA, FORE_INERTIA.replace('izz="0.02"', 'izz="0.03"'), "E_INERTIA_TRIANGLE", ["fore"], FORE_LINK),
    # looks that would mislead a parser
    (COLOR, COLOR.replace("0.5 0.5", "%s %n"), "E_MATERIAL", ["grey"], "%s"),
    (CYLINDER, CYLINDER.replace("0.4", "%s"), "E_GEOMETRY", ["upper", "%s"], "<visual>"),
]  # fmt: skip

WARNINGS = [
    (END, "<hoverboard/></robot>", "W_UNKNOWN_ELEMENT", ["hoverboard"], "hoverboard"),
    (ELBOW_ORIGIN, '<origin xzy="0.4 0 0"/>', "W_UNKNOWN_ATTRIBUTE", ["elbow", "xzy", "xyz"], "xzy"),
    (END, '<link name="hook"/><joint name="h" type="fixed"><parent link="fore"/><child link="hook"/></joint></robot>',
     "W_BRANCHED", ["tip", "hook"], '<link name="foot"'),
    ('name="flange"', 'name="tip"', "W_NAME_SHARED", ["tip"], '<link name="tip"'),
    ("flange", "a b", "W_NAME_CHARS", ["blank"], "a b"),
    ("flange", "Elbow", "W_NAME_CONFUSABLE", ["elbow", "Elbow"], "Elbow"),
    ("flange", "еlbow", "W_NAME_CONFUSABLE", ["elbow"], "еlbow"),  # a Cyrillic е
    (ELBOW_ORIGIN, '<origin xyz="400 0 0"/>', "W_UNITS", ["elbow", "millimetres"], "400 0 0"),
    (ELBOW_ORIGIN, '<origin xyz="0.4 0 0" rpy="90 0 0"/>', "W_UNITS", ["elbow", "degrees"], "90 0 0"),
    (SHOULDER_LIMIT, SHOULDER_LIMIT.replace('"2"', '"180"'), "W_UNITS", ["shoulder", "degrees"], "180"),
    ('upper="0.25"', 'upper="250"', "W_UNITS", ["slide", "millimetres"], "250"),
    (FORE_INERTIA, FORE_INERTIA.replace("0.02", "20000"), "W_UNITS", ["fore", "mm"], FORE_INERTIAL),
    (ELBOW_AXIS, '<axis xyz="0 -2 0"/>', "W_AXIS_NORM", ["elbow", "length 2"], "0 -2 0"),
    (ELBOW_AXIS, "", "W_AXIS_DEFAULT", ["elbow", "1 0 0"], ELBOW),
    (ELBOW_AXIS, '<axis xyz="0 -1e-5 0"/>', "W_AXIS_NORM", ["elbow", "1e-05"], "1e-5"),
    (ELBOW_AXIS, ELBOW_AXIS + "<limit/>", "W_LIMITS", ["elbow", "effort and velocity"], "<limit/>"),
    (FLANGE_CHILD, FLANGE_CHILD + '<mimic joint="elbow"/>', "W_MIMIC", ["flange", "fixed"], "<mimic"),
    (FLANGE_CHILD, FLANGE_CHILD + '<limit effort="x" velocity="1"/>', "W_LIMITS", ["flange", "effort missing or"], '"x"'),
    # white space with which urdfdom drops the inertial or refuses the file
    (FORE_MASS, '<mass value=" +1.5e0 "/>', "W_NUMBER_BLANKS", ["fore", "<mass> value", "urdfdom"], "+1.5e0"),
    ('xyz="0.15 0 0"', 'xyz="0.15&#9;0 0"', "W_NUMBER_BLANKS", ["fore", "<origin> xyz"], "0.15"),
    (SHOULDER_LIMIT, SHOULDER_LIMIT.replace('"2"', '"2 "'), "W_NUMBER_BLANKS", ["shoulder", "<limit> upper"], '"2 "'),
    (SHOULDER_LIMIT, '<limit effort="50" velocity="1.5"/>', "W_LIMITS", ["lower and upper"], "<limit effort"),
    (SHOULDER_LIMIT, SHOULDER_LIMIT.replace('"2"', '"inf"'), "W_LIMITS", ["upper infinite"], "inf"),
    (SHOULDER_LIMIT, SHOULDER_LIMIT.replace('"2"', '"-2"').replace('"-2"', '"0"'), "W_LIMITS", ["both 0"], '"0" eff'),
    (ELBOW_AXIS, ELBOW_AXIS + SHOULDER_LIMIT, "W_LIMITS", ["elbow", "without end"], "0 -1 0"),
    (SHOULDER_LIMIT, SHOULDER_LIMIT.replace("-2", "0.5"), "W_NEUTRAL", ["shoulder", "0.5"], '"0.5" upper'),
    (ELBOW_AXIS, ELBOW_AXIS + '<mimic joint="shoulder" multiplier="-2"/>', "W_MIMIC", ["shoulder", "-2"], "<mimic"),
    (ELBOW_AXIS, ELBOW_AXIS + "<dynamics/>", "W_DYNAMICS", ["elbow"], "<dynamics"),
    (ELBOW_AXIS, ELBOW_AXIS + '<dynamics friction="-1"/>', "W_DYNAMICS", ["elbow", "friction"], "<dynamics"),
    (ELBOW_AXIS, ELBOW_AXIS + '<calibration rising="0"/>', "W_IGNORED", ["elbow", "calibration"], "<calibration"),
    (FORE_MASS, '<mass value="0"/>', "W_MASS_ZERO", ["fore"], 'value="0"'),
    (FORE_MASS, '<mass value="900"/>', "W_MASS_LARGE", ["fore", "grams"], "900"),
    (FORE_INERTIA, FORE_INERTIA.replace("0.02", "0"), "W_INERTIA_ZERO", ["fore", "point mass"], FORE_LINK),
    (COLOR, COLOR.replace("0.5 0.5", "255 255"), "W_MATERIAL", ["grey", "between 0 and 1"], "255"),
    (COLOR, "", "W_MATERIAL", ["grey", "neither color nor texture"], "<material"),
    (END, "<material/></robot>", "W_MATERIAL", ["no name"], "<material/>"),
    (USED, '<material name="gray"/>', "W_MATERIAL", ["upper", "gray", "not defined"], "gray"),
    (USED, "<material/>", "W_MATERIAL", ["upper", "without a name"], "<material/>"),
    (CYLINDER, '<cylinder radius="-1" length="1"/>', "W_GEOMETRY", ["upper", "positive"], "<visual>"),
    (CYLINDER, '<capsule radius="1"/>', "W_GEOMETRY", ["upper", "capsule"], "<visual>"),
    (CYLINDER, '<mesh filename="" />', "W_MESH_MISSING", ["upper"], "<mesh"),
    (CYLINDER, '<mesh filename="a.stl" scale="0.001"/>', "W_MESH_SCALE", ["upper", "0.001"], "<mesh"),
    (CYLINDER, '<mesh filename="a.stl" scale="1 -1 1"/>', "W_MESH_SCALE", ["upper", "mirrors"], "<mesh"),
    (ELBOW_ORIGIN, '<origin xyz="0.4 0 0" rpy="1.57 0 0"/>', "W_ANGLE_ROUNDED", ["elbow", "1.57", "90°"], ELBOW),
    (ELBOW_ORIGIN, '<origin xyz="0.4 0 0" rpy="0 0.785 0"/>', "W_ANGLE_ROUNDED", ["0.785", "45°"], ELBOW),
]  # fmt: skip

SILENT = [
    (END, END),
    ('<?xml version="1.0"?>', "\ufeff<?xml version=\"1.0\"?>"),
    ('<?xml version="1.0"?>', '<?xml version="1.0" encoding="ISO-8859-1"?>'),
    ("\n", "\r\n"),
    (FORE_MASS, '<mass value=" +1.5e0"/>'),
    (FORE_LINK, '<material name="bare"><texture filename="wood.png"/></material>' + FORE_LINK),
    (ELBOW_AXIS, ELBOW_AXIS + '<limit effort="5" velocity="1"/>'),
    (FLANGE_CHILD, FLANGE_CHILD + '<limit effort="5" velocity="1"/><axis xyz="0 0 0"/>'),
    (FORE_MASS, '<mass value="&#49;.5"/>'),
    (ELBOW_ORIGIN, '<origin xyz="0.4\t0\n0" rpy=" .1 2e-1\r\n0.3"/>'),
    (ELBOW_AXIS, '<axis xyz="0 -1.0000000001 0"/>'),
    (ELBOW_AXIS, ELBOW_AXIS + '<dynamics damping="0.1" friction="0"/>'),
    (END, '<gazebo reference="fore"><mu1>0.2</mu1></gazebo><transmission name="t"/></robot>'),
    ("fore", "предплечье"),
    (ELBOW_ORIGIN, '<origin xyz="0.4 0 0" rpy="1.570796 0.0008 1.5712345"/>'),
]  # fmt: skip


def _line(text: str, part: str) -> int:
    before = text[: text.index(part)]
    return 1 + before.count("\n")


FOUND = [*ERRORS, *WARNINGS]


@pytest.mark.parametrize(
    ("old", "new", "code", "words", "at"), FOUND, ids=[f"{k}-{row[2]}" for k, row in enumerate(FOUND)]
)
def test_each_fault_is_refused_and_each_oddity_warned_of(arm, findings_of, old, new, code, words, at):
    assert old in arm
    text = arm.replace(old, new)
    severity = "error" if code.startswith("E") else "warning"
    found = findings_of(text)
    (one,) = (finding for finding in found if finding.severity == "error") if severity == "error" else found
    assert (one.severity, one.code, one.file, one.line) == (severity, code, "arm.urdf", _line(text, at))
    assert [finding for finding in found if finding.line == one.line] == [one]
    for word in words:
        assert word in one.message
    assert "\n" not in str(one)


@pytest.mark.parametrize(("old", "new"), SILENT)
def test_what_is_legal_is_silent(arm, findings_of, old, new):
    assert old in arm
    assert findings_of(arm.replace(old, new)) == ()


def test_all_findings_come_at_once_in_line_order(arm, findings_of):
    text = arm.replace(FORE_MASS, '<mass value="nan"/>').replace(ELBOW_AXIS, '<axis xyz="0 0 0"/>')
    text = text.replace(SHOULDER_LIMIT, SHOULDER_LIMIT.replace("-2", "0.5"))
    assert [found.code for found in findings_of(text)] == ["E_NOT_FINITE", "W_NEUTRAL", "E_AXIS_ZERO"]


def test_mimics_in_a_circle_are_named(arm, findings_of):
    text = arm.replace(SHOULDER_LIMIT, SHOULDER_LIMIT + '<mimic joint="elbow"/>')
    text = text.replace(ELBOW_AXIS, ELBOW_AXIS + '<mimic joint="shoulder"/>')
    (error,) = (found for found in findings_of(text) if found.severity == "error")
    assert error.code == "E_MIMIC"
    assert "'shoulder'" in error.message
    assert "'elbow'" in error.message


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (b"", "E_XML_EMPTY"),
        (codecs.BOM_UTF8, "E_XML_EMPTY"),
        (2 * codecs.BOM_UTF8 + b"<robot name='a'/>", "E_XML_SYNTAX"),
        ("<robot name='a'/>".encode("utf-16-le"), "E_XML_ENCODING"),
        ("<robot name='a'/>".encode("utf-32"), "E_XML_ENCODING"),
        (b"<robot name='\xe9'/>", "E_XML_ENCODING"),
        (b"<sdf/>", "E_NO_ROBOT"),
        (b"<u:robot xmlns:u='urn:x' name='a'/>", "E_NO_ROBOT"),
        (b"<robot name='a'/>", "E_NO_LINKS"),
        (b"<robot name='a'><link name='b'/></robot>", "E_NO_DOF"),
        (
            b"<robot name='a'><link name='b'/><link name='c'/>"
            b"<joint name='j' type='fixed'><parent link='b'/><child link='c'/></joint>"
            b"<joint name='k' type='fixed'><parent link='c'/><child link='b'/></joint></robot>",
            "E_NO_ROOT",
        ),
    ],
)  # fmt: skip
def test_whole_files_that_are_no_robot(findings_of, text, code):
    assert [found.code for found in findings_of(text)] == [code]


DECLARED = '<?xml version="1.0" encoding="{}"?>'
ENCODINGS = [
    ("utf-8", "UTF-8"), ("utf-8-sig", "utf-8"), ("utf-16", "UTF-16"), ("utf-16", None), ("utf-16-le", "UTF-16"),
    ("utf-16-be", "utf-16be"), ("latin-1", "ISO-8859-1"), ("iso-8859-15", "iso-8859-15"), ("cp1252", "windows-1252"),
]  # fmt: skip
MISTAKEN = [
    ("utf-16", "UTF-8"), ("utf-16", "ISO-8859-1"), ("utf-16-be", "utf-16le"), ("utf-16-le", None), ("utf-8", "UTF-16"),
    ("latin-1", "US-ASCII"), ("latin-1", None), ("utf-8-sig", "ISO-8859-1"), ("utf-32", "utf-32"),
    ("shift_jis", "shift_jis"), ("utf-8", "x-none"), ("cp037", "cp037"),
]  # fmt: skip


def _encoded(arm: str, written: str, declared: str | None) -> bytes:
    text = arm.replace('<?xml version="1.0"?>', "" if declared is None else DECLARED.format(declared)).lstrip()
    letters = "bêche" if written != "shift_jis" else "腕"
    return text.replace("flange", letters).encode(written)


@pytest.mark.parametrize(("written", "declared"), ENCODINGS)
def test_declared_encodings_are_read_and_placements_changed_in_them(arm, written, declared):
    data = _encoded(arm, written, declared)
    robot = parse(data, "arm.urdf")
    assert robot.findings == ()
    assert robot.joints[-1].name == "bêche"
    plain = parse(arm.encode(), "arm.urdf")
    assert [(one.name, one.origin.tolist()) for one in robot.joints[:-1]] == [
        (one.name, one.origin.tolist()) for one in plain.joints[:-1]
    ]
    edited = UrdfText.scan(data).edited({"bêche": Placement((1.0, 2.0, 3.0), None)}, comment=["of our bêche"])
    robot = parse(edited, "arm.urdf")
    assert robot.findings == ()
    assert (robot.joints[-1].name, robot.joints[-1].xyz, robot.joints[-1].rpy) == ("bêche", (1, 2, 3), (0, 0.5, 0))
    assert edited.decode("utf-8-sig").count("of our bêche") == 1


@pytest.mark.parametrize(("written", "declared"), MISTAKEN)
def test_other_encodings_are_refused_and_never_misread(arm, findings_of, written, declared):
    (found,) = findings_of(_encoded(arm, written, declared))
    assert found.code == "E_XML_ENCODING"
    assert "UTF" in found.message or "ASCII" in found.message


def _chain(links: int, kind: str) -> str:
    parts = [f'<link name="l{k}"/>' for k in range(links)]
    parts += [
        f'<joint name="j{k}" type="{kind if k else "continuous"}"><parent link="l{k}"/><child link="l{k + 1}"/>'
        '<axis xyz="0 0 1"/></joint>'
        for k in range(links - 1)
    ]
    return f'<robot name="chain">{"".join(parts)}</robot>'


def test_size_limits_hold_and_can_be_raised(findings_of):
    assert findings_of(_chain(200, "fixed")) == ()
    assert [found.code for found in findings_of(_chain(201, "fixed"))] == ["E_TOO_BIG"]
    assert findings_of(_chain(129, "continuous")) == ()
    assert [found.code for found in findings_of(_chain(130, "continuous"))] == ["E_TOO_BIG"]
    large = parse(_chain(400, "continuous").encode(), "x", limits=Limits(moving_joints=500, links_in_depth=500))
    assert len(large.path("l0", "l399")) == 399
    with pytest.raises(Exception, match="E_TOO_BIG"):
        parse(b"<robot/>", "x", limits=Limits(file_bytes=4))
    with pytest.raises(Exception, match="E_TOO_BIG"):
        parse(b"<robot><a/><b c='1'/></robot>", "x", limits=Limits(elements=3))


def test_a_flood_of_findings_is_cut(findings_of):
    found = findings_of('<robot name="a">' + "<link/>" * 3000 + "</robot>")
    assert len(found) == 1001
    assert found[-1].code == "E_MORE"
    assert "2000" in found[-1].message


def test_values_are_read_as_written(arm):
    robot = parse(arm.encode(), "arm.urdf")
    assert robot.link("upper").inertial == Inertial(2.5, (0.2, 0, 0), (0, 0, 0), (0.01, 0, 0, 0.04, 0, 0.04))
    assert robot.link("upper").visuals == (
        Shape(Cylinder(0.05, 0.4), (0.2, 0, 0), (0, math.pi / 2, 0), (0.5, 0.5, 0.5, 1), 11),
    )
    shoulder, elbow, slide = (robot.joint(name) for name in ("shoulder", "elbow", "slide"))
    assert (shoulder.kind, shoulder.parent, shoulder.child, shoulder.line) == ("revolute", "foot", "upper", 26)
    assert (shoulder.limit, elbow.limit) == (Limit(-2, 2, 50, 1.5), None)
    assert (elbow.axis, slide.xyz, slide.rpy) == ((0, -1, 0), (0.3, 0, 0), (0, 0, 0))
    assert (robot.link("foot").inertial, robot.link("foot").mass) == (None, 0)


def test_axes_become_unit_vectors_and_a_bad_visual_never_costs_the_mass(arm):
    text = arm.replace(ELBOW_AXIS, '<axis xyz="0 -3 4"/>').replace(CYLINDER, '<box size="a b c"/>')
    robot = parse(text.encode(), "arm.urdf")
    assert robot.joint("elbow").axis == (0, -0.6, 0.8)
    assert robot.link("upper").mass == 2.5
    assert robot.link("upper").visuals == ()


UNPHYSICAL = (
    '<link name="tip"><inertial><mass value="{mass}"/>'
    '<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.01"/></inertial></link>'
)


def test_an_unphysical_part_of_a_physical_body_is_let_pass(arm, findings_of):
    ram = UNPHYSICAL.replace("tip", "ram").replace("0.001", "0.05").replace('"0.01"', '"0.06"')
    heavy = arm.replace('<link name="ram"/>', ram.format(mass=3))
    both = heavy.replace('<link name="tip"/>', UNPHYSICAL.format(mass=0.1))
    assert [found.code for found in findings_of(both)] == ["W_INERTIA"]
    alone = arm.replace('<link name="tip"/>', UNPHYSICAL.format(mass=0.1))
    assert [found.code for found in findings_of(alone)] == ["E_INERTIA_TRIANGLE"]


def test_rods_and_rounded_plates_are_physical(arm, findings_of):
    # a plate has izz = ixx + iyy; written with three digits the sum may miss by one in the last
    plate = FORE_INERTIA.replace('ixx="0"', 'ixx="0.617"').replace('iyy="0.02"', 'iyy="0.617"')
    assert findings_of(arm.replace(FORE_INERTIA, plate.replace('izz="0.02"', 'izz="1.235"'))) == ()
    # a rod along (1, 2, 2)/3: I = m l²/12 (1 - u uᵀ), written with five digits
    rod = '<inertia ixx="0.88889" ixy="-0.22222" ixz="-0.22222" iyy="0.55556" iyz="-0.44444" izz="0.55556"/>'
    assert findings_of(arm.replace(FORE_INERTIA, rod)) == ()


@pytest.mark.parametrize("text", ["%-" * 30_000, "1 " * 30_000])
def test_long_nonsense_is_judged_quickly(arm, findings_of, text):
    # quadratic work would take minutes here
    started = time.perf_counter()
    found = findings_of(arm.replace('radius="0.05"', f'radius="{text}"').replace('"2.5"', f'"{text}"'))
    assert {one.code for one in found} & {"E_NUMBER", "E_NOT_FINITE"}
    assert all(len(one.message) < 600 for one in found)
    assert time.perf_counter() - started < 5


TURNING = (
    '<robot name="r"{root}><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/>'
    '<child link="b"/><origin {origin}xyz="0 0 1"/><axis xyz="0 0 1"/><limit {limit}effort="1" velocity="1"/></joint></robot>'
)


@pytest.mark.parametrize(
    ("root", "origin", "limit", "codes"),
    [
        ("", "", "", []),
        ("", 'xy:="1" ', "", ["E_XML_SYNTAX"]),
        ("", 'p:a:b="1" ', "", ["E_XML_SYNTAX"]),
        ("", 'p:xyz="1" ', "", ["E_XML_SYNTAX"]),  # the prefix is not declared
        (' xmlns:p="http://p"', 'p:xyz="1" ', "", []),
        ("", 'xmlns:p="http://p" p:xyz="1" ', "", []),
        ("", "", 'lower="-3.1416" upper="3.1416" ', []),  # a whole turn is what a continuous joint has
        ("", "", 'lower="-inf" upper="inf" ', []),
        ("", "", 'lower="-1" upper="1" ', ["W_LIMITS"]),
    ],
)
def test_names_with_colons_and_limits_of_a_whole_turn(findings_of, root, origin, limit, codes):
    found = [finding.code for finding in findings_of(TURNING.format(root=root, origin=origin, limit=limit))]
    assert [code for code in found if code in ("E_XML_SYNTAX", "W_LIMITS")] == codes


def test_a_packed_file_is_said_to_be_packed():
    with pytest.raises(UrdfError, match="E_XML_SYNTAX: this is a gzip file"):
        parse(gzip.compress(TURNING.format(root="", origin="", limit="").encode()), "r.urdf")
