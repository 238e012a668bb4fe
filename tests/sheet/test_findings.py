"""Every mistake is found, at its line, with what is allowed; and all of them at once."""

import functools

import numpy as np
import pytest

from precision_pin import ErrorModel, Uniform
from precision_pin.base.errors import is_note
from precision_pin.sheet import read
from precision_pin.sheet.sheet_lint import note_on_normal
from precision_pin.sheet.text import read_text
from support.plain_robot import joint, limits, link, robot

SHEET = """\
precision-pin: 1
robot: 4dof.urdf
tip: tool
gravity: 0 0 -9.81 m/s^2
statics: nominal
locked: {}
poses:
  paper: -90 3 88 -91 deg
  block:
    joint1: 0 deg
    joint2: 10 deg
    joint3: 90 deg
    joint4: 0 deg
parameters:
  a1: {uniform: 0.05 mm}
  mass:
    normal: 0.06 kg
    mean: 1 kg
    scope: visit
  pair: {disc: 0.1 mm}
sources:
  - payload: {at: tool, mass: mass, com: 0 0 0 mm}
  - length: {joint: joint2, along: z of joint1, parameters: [a1]}
  - axis_install:
      joint: joint2
      radius: 0.1 mm
      span: 100 mm
  - beam: {link: link2, EI: 8000 N*m^2, GI: 4000 N*m^2}
  - joint_compliance:
      joint: joint2
      compliance:
        uniform: 1e-6 rad/(N*m)
        mean: 1e-5 rad/(N*m)
  - frame: {joint: joint3, x: pair.x, y: pair.y}
"""


# what is replaced, by what, the code, what the message says; the line is that of the replacement's last line
MISTAKES = [
    # keys that do not exist, at every level
    ("statics: nominal", "static: nominal", "E_UNKNOWN_KEY", "did you mean 'statics'"),
    ("EI: 8000 N*m^2, GI", "EI: 8000 N*m^2, GIp", "E_UNKNOWN_KEY", "did you mean 'GI'"),
    ("      span: 100 mm", "      span: 100 mm\n      strat: 3 mm", "E_UNKNOWN_KEY", "did you mean 'start'"),
    ("{uniform: 0.05 mm}", "{unifrom: 0.05 mm}", "E_INPUT", "did you mean 'uniform'"),
    ("        mean: 1e-5", "        sigma: 1e-5", "E_SHEET", "'sigma' is no setting of the law uniform"),
    # options that another law has
    ("{uniform: 0.05 mm}", "{normal: {std: 0.05 mm}, k: 2}", "E_INPUT", "k has no effect here"),
    # keys that stand twice
    ("statics: nominal", "statics: nominal\ntip: link4", "E_DUPLICATE_KEY", "'tip' is given twice, first in line 3"),
    ("statics: nominal", "statics: nominal\nstatics: nominal", "E_DUPLICATE_KEY", "is given twice"),
    ("    joint4: 0 deg", "    joint4: 0 deg\n    joint1: 1 deg", "E_DUPLICATE_KEY", "first in line 10"),
    ("EI: 8000 N*m^2", "EI: 8000 N*m^2, EI: 1 N*m^2", "E_DUPLICATE_KEY", "'EI'"),
    # keys that are missing
    ("{at: tool, mass: mass, com", "{at: tool, com", "E_MISSING_KEY", "'mass' is missing"),
    # units
    ("{uniform: 0.05 mm}", "{uniform: 0.05}", "E_UNIT", "has no unit"),
    ("      span: 100 mm", "      span: 100", "E_SHEET", "span: '100' has no unit; a length needs one of: m, cm, mm"),
    ("EI: 8000 N*m^2", "EI: 8000 N*m/rad", "E_SHEET", "not a unit of bending"),
    ("com: 0 0 0 mm", "com: 0 0 mm", "E_INPUT", "expected 3"),
    # sizes
    ("{uniform: 0.05 mm}", "{uniform: -0.05 mm}", "E_INPUT", "negative"),
    ("    normal: 0.06 kg", "    normal: {std: -0.02 kg}", "E_INPUT", "negative"),
    ("        uniform: 1e-6", "        uniform: -1e-6", "E_SHEET", "negative"),
    ("      span: 100 mm", "      span: 0 mm", None, "positive"),
    # laws
    ("{uniform: 0.05 mm}", "{uniform: 0.05 mm, normal: 0.05 mm}", "E_INPUT", "exactly one of"),
    ("{uniform: 0.05 mm}", "{mean: 0.05 mm}", "E_INPUT", "exactly one of"),
    ("{uniform: 0.05 mm}", "0.05 mm", "E_INPUT", "expected a law"),
    ("{uniform: 0.05 mm}", "{uniform: {std: 1 mm}}", "E_INPUT", "a number with a unit"),
    ("    scope: visit", "    scope: day", "E_INPUT", "unit, pose, visit"),
    ("    scope: visit", "    k: 0", "E_INPUT", "k must be positive"),
    ("    scope: visit", "    k: 1e-9\n    truncated: true", None, "k of a truncated normal"),
    ("    scope: visit", "    truncated: yes", "E_INPUT", "true or false"),
    ("    normal: 0.06 kg", "    normal: {sigma: 0.02 kg}", "E_INPUT", "{std:"),
    ("{disc: 0.1 mm}", "{joint_normal: 1 mm}", "E_INPUT", "standard deviations"),
    ("{disc: 0.1 mm}", "{joint_normal: {std: [1e308 m, 1 mm]}}", "E_UNIT", "too large"),
    ("{disc: 0.1 mm}", "{joint_normal: {std: [1 mm, 1 mm]}, mean: [1 mm]}", "E_INPUT", "list of 2"),
    ("{disc: 0.1 mm}", "{joint_normal: {std: [1 mm, 1 mm]}, correlation: [10, 01]}", "E_INPUT", "2 rows of 2"),
    ("{disc: 0.1 mm}", "{joint_normal: {std: [1 mm, 1 mm]}, correlation: [[1, 0.5], [0.4, 1]]}", "E_INPUT", "symm"),
    ("{disc: 0.1 mm}", "{joint_normal: {std: [1 mm, 1 mm]}, correlation: [[1, 2], [2, 1]]}", "E_INPUT", "above 1"),
    ("{disc: 0.1 mm}", "{joint_normal: {std: [1 mm, 1 mm]}, correlation: [[1, x], [x, 1]]}", "E_INPUT", "numbers"),
    ("{disc: 0.1 mm}", "{joint_normal: {std: [1 mm, 1 mm]}, correlation: [[1, nan], [nan, 1]]}", "E_INPUT", ""),
    # names
    ("tip: tool", "tip: tol", "E_NAME", "did you mean 'tool'"),
    ("tip: tool", "base: bas", "E_NAME", "did you mean 'base'"),
    ("joint: joint2, along", "joint: jont2, along", "E_NAME", "did you mean 'joint2'"),
    ("along: z of joint1", "along: up", "E_INPUT", "[-]x|y|z of JOINT"),
    ("{at: tool", "{at: gripper", "E_NAME", "valid: base, link1"),
    ("parameters: [a1]", "parameters: [a2]", "E_SHEET", "no parameter named 'a2'; valid: a1, mass, pair.x"),
    ("x: pair.x", "x: pair", "E_SHEET", "'pair.x'"),
    ("mass: mass", "mass: a1", "E_SHEET", "'a1' is a length; expected a mass"),
    ("locked: {}", "locked: {finger: 0.04 m}", "E_NAME", "no joint named 'finger'"),
    ("  a1: {", "  a 1: {uniform: 1 mm}\n  1a: {uniform: 1 mm}\n  a1: {", None, ""),
    (
        "  pair: {disc: 0.1 mm}",
        "  pair: {disc: 0.1 mm}\n  pair.x: {uniform: 1 mm}",
        "E_SHEET",
        "already used by the parameter 'pair'",
    ),
    # poses
    ("paper: -90 3 88 -91 deg", "paper: -90 3 88 deg", "E_INPUT", "3 joint values for 4 joints"),
    ("paper: -90 3 88 -91 deg", "paper: [0 deg, 0 deg, 0, 0 deg]", "E_UNIT", "has no unit"),
    ("paper: -90 3 88 -91 deg", "paper: {joint1: 0 deg}", "E_INPUT", "no value for the joints joint2, joint3, joint4"),
    ("paper: -90 3 88 -91 deg", "paper: [[1], 2, 3, 4]", "E_SHEET", "joint values in chain order"),
    ("    joint3: 90 deg", "    jonit3: 90 deg", "E_NAME", "did you mean 'joint3'"),
    # gravity and the rest of the top
    ("gravity: 0 0 -9.81 m/s^2", "gravity: 0 0 -9.81", "E_SHEET", "earth, moon, none"),
    ("statics: nominal", "statics: dynamic", "E_SHEET", "'nominal'"),
    # sources
    ("  - frame: {joint: joint3, x: pair.x, y: pair.y}", "  - frame", "E_SHEET", "one kind with its settings"),
    ("  - frame: {joint: joint3, x: pair.x, y: pair.y}", "  - frame:", "E_SHEET", "settings of frame are missing"),
    ("  - frame: {joint: joint3, x: pair.x, y: pair.y}", "  - {}", "E_SHEET", "0 keys"),
    ("  - frame: {joint: joint3, x: pair.x, y: pair.y}", "  - {beam: {}, frame: {}}", "E_SHEET", "2 keys"),
    ("joint: joint3, x: pair.x", "joint: joint3, link: link2, x: pair.x", "E_INPUT", "one of joint"),
    ("      radius: 0.1 mm", "      radius: -0.1 mm", None, "negative"),
    ("      radius: 0.1 mm", "      radius: 0.1 mm\n      diameter: 0.2 mm", None, "either radius: or diameter:"),
    ("      radius: 0.1 mm", "      radius: {uniform: 0.1 mm}", "E_SHEET", "expected a plain quantity, not a law"),
    ("EI: 8000 N*m^2", "EI: 0 N*m^2", "E_INPUT", "must be positive"),
    ("EI: 8000 N*m^2", "EI: {disc: 1 N*m^2}", "E_SHEET", "under parameters:"),
    # set-up of a measurement, approach of a pose
    ("statics: nominal", "measurement: {kind: planes}", "E_SHEET", "measurement.kind: input should be 'position', 'pose',"),
    ("statics: nominal", "measurement: {kind: plane}", None, "the measurement of a plane needs plane"),
    ("statics: nominal", "measurement: {std: 0 mm}", None, "std must be above zero, got '0 mm'"),
    ("statics: nominal", "measurement: {taget: 1 2 3 mm}", None, "unknown key 'taget': did you mean 'target'"),
    ("statics: nominal", "measurement: {load: [{at: tol, mass: 1 kg}]}", None, "no link named 'tol'; did you mean 'tool'?"),
    ("statics: nominal", "measurement: {load: [{at: tool, mass: 1 mm}]}", None, "load.0.mass: "),
    ("statics: nominal", "measurement: {kind: socket, sockets: [1 2 mm]}", None, "sockets.0: '1 2 mm' has 2 numbers, expected"),
    ("paper: -90", "paper: {q: 0 0 0 0 deg, approach: {jont2: +}}\n  old: -90", None, "on the chain named 'jont2'; did you"),
    ("paper: -90", "paper: {q: 0 0 0 0 deg, approach: {joint2: up}}\n  old: -90", None, "must be +, - or 0, got 'up'"),
    ("paper: -90", "paper: {q: 0 0 0 0 deg, approach: {joint2: {a: +}}}\n  old: -90", None, "joint values"),
    ("paper: -90", "paper: {q: 0 0 0 0 deg, approach: [+, -]}\n  old: -90", None, "2 directions of approach for 4 joints"),
    ("paper: -90", "paper: {q: 0 0 0 0 deg, approach: previous}\n  old: -90", None, "pose, but this is the first"),
    ("paper: -90", "paper: {q: 0 0 0 0 deg, aproach: previous}\n  old: -90", None, "unknown key 'aproach' next to q: and"),
    ("paper: -90", "paper: {approach: joint2 +}\n  old: -90", None, "approach: needs the joint values as q:"),
    # shapes
    ("tip: tool", "tip: [tool]", None, "one value"),
    ("{uniform: 0.05 mm}", "{uniform: 1e300 m}", None, "'1e300 m' is too large; at most 1e+50 m"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "code", "message"), MISTAKES, ids=[f"{row[1][:50]!r}" for row in MISTAKES])
def test_one_mistake_gives_one_finding_at_its_line(refuse, old, new, code, message):
    assert SHEET.count(old) == 1
    text = SHEET.replace(old, new)
    before = SHEET[: SHEET.index(old)].count("\n")
    last = before + new.count("\n") + 1
    found = refuse(text)
    if code is None:
        # what is wrong is several lines, or settings that do not fit together: the line of the source
        assert all(before - 2 <= (finding.line or 0) <= last for finding in found), found
    else:
        assert [(finding.code, finding.line) for finding in found] == [(code, last)], found
    assert message in found[-1].message


def test_mistakes_in_one_source_and_beside_a_missing_robot_or_a_wrong_tip_are_all_found(refuse):
    radius, law = ("radius: 0.1 mm", "radius: 0.1"), ("{uniform: 0.05 mm}", "{uniform: 0.05}")
    for changes, expected in (
        (
            [radius, ("      span: 100", "      spam: 100")],
            [("E_MISSING_KEY", 24), ("E_SHEET", 26), ("E_UNKNOWN_KEY", 27)],
        ),
        ([radius, law, ("robot: 4dof.urdf\n", "")], [("E_MISSING_KEY", 1), ("E_UNIT", 14), ("E_SHEET", 25)]),
        ([radius, ("tip: tool", "tip: tol")], [("E_NAME", 3), ("E_SHEET", 26)]),
    ):
        text = functools.reduce(lambda text, change: text.replace(*change), changes, SHEET)
        assert [(finding.code, finding.line) for finding in refuse(text)] == expected


def test_wrong_shapes(refuse):
    for section, line, message in (
        ("poses: [1, 2]", 3, "keys with values"),
        ("sources: {beam: {}}", 3, "expected a list"),
        ("robot: [4dof.urdf]", 3, "is given twice"),
        ("poses:\n  good: 0 0 0 0 rad\n  p:\n    joint1: {a: 1 deg}", 5, "joint values"),
    ):
        (found,) = refuse(f"precision-pin: 1\nrobot: 4dof.urdf\n{section}\n")
        assert (found.line, message in found.message) == (line, True), found


def test_all_mistakes_of_sources_are_found_at_once_each_with_a_hint(refuse):
    """Unknown joints too where the source has another mistake; a missing key with its meaning; words that are meant."""
    lines = (
        ("parameters: {a: {uniform: 0,05 mm}}", "decimals have a point: '0.05 mm'"),
        ("sources:", ""),
        ("  - joint_offset: {joint: joint8, offset: {normal: 0.1 degg}}", "no joint on the chain named 'joint8'"),
        ("  - joint_offset: {joint: joint9, offsett: {normal: 0.1 deg}}", "no joint on the chain named 'joint9'"),
        (
            "  - backlash: {joint: joint2, backlash: 1 arcmin}",
            "'band' is missing: Torque (for a prismatic joint: force)",
        ),
        # 360 deg / 1048576
        ("  - encoder: {joint: joint2, resolution: 20 bit}", "write '0.000343323 deg'"),
        ("  - beam: {link: link2, section: rectangle, material: steel}", "a rectangular tube is a box"),
        ("  - joint_offset: {joint: joint3, offset: '0,1 deg'}", "decimals have a point: '0.1 deg'"),
    )
    found = refuse("precision-pin: 1\nrobot: 4dof.urdf\ntip: tool\n" + "\n".join(line for line, _ in lines) + "\n")
    for number, (_, said) in enumerate(lines, start=4):
        here = "\n".join(finding.message for finding in found if finding.line == number)
        assert said in here if said else here == ""


# what a sheet says that is allowed but seldom meant: constants for tolerances, radians for degrees, nothing that varies


HEAD = """precision-pin: 1
robot: 4dof.urdf
tip: tool
poses:
  reach: 0 10 30 0 deg
"""
VARIES = "  - joint_offset: {joint: joint4, offset: {normal: 0.02 deg}}\n"


def with_sources(*sources):
    return HEAD + "sources:\n" + VARIES + "".join(f"  - {source}\n" for source in sources)


def warnings(sheet):
    return [(finding.code, finding.line) for finding in sheet.findings]


def law_of(sheet, name):
    return next(draw.law for draw in ErrorModel.from_sheet(sheet).space.draws if draw.name == name)


def test_a_sign_makes_a_number_a_uniform_tolerance(load):
    for written, half_width, mean in (
        ("±0.02 deg", 0.02, 0),
        ("+-0.02 deg", 0.02, 0),
        ("+/-0.02 deg", 0.02, 0),
        ("-0.1 deg +- 0.02 deg", 0.02, -0.1),
        ("6 arcmin ± 0.02 deg", 0.02, 0.1),
    ):
        sheet = load(with_sources(f"joint_offset: {{joint: joint1, offset: {written}}}"))
        found = law_of(sheet, "joint_offset[joint1].offset")
        assert isinstance(found, Uniform)
        numbers = np.degrees([found.half_width, found.mean])
        assert numbers == pytest.approx([half_width, mean], rel=1e-12, abs=1e-16)
        assert sheet.findings == ()
    # of a parameter and of lists
    text = HEAD + "parameters:\n  a: ± 0.1 mm\nsources:\n  - length: {joint: joint2, parameters: ± 0.2 mm}\n"
    sheet = load(text + "  - length: {joint: joint3, parameters: [a, 1 ± 0.3 mm]}\n")
    assert law_of(sheet, "length[joint3].parameters[1]") == Uniform(0.3e-3, 1e-3)
    assert law_of(sheet, "a") == Uniform(1e-4)
    assert law_of(sheet, "length[joint2].parameters") == Uniform(2e-4)


def test_wrong_ones_get_one_line(refuse):
    for source, says in (
        ("joint_offset: {joint: joint1, offset: ±0.02}", "'0.02' has no unit"),
        ("joint_offset: {joint: joint1, offset: ±-0.02 deg}", "the half-width is negative"),
        ("joint_offset: {joint: joint1, offset: ± deg}", "expected a number with a unit"),
        ("joint_offset: {joint: joint1, offset: 1 mm ± 0.02 deg}", "'mm' in '1 mm' is not a unit of angle"),
        *(
            (f"{name}: {{{place}}}", f"{name} without a number does nothing; give one or more of {first}, ")
            for name, place, first in (
                ("frame", "joint: joint1", "x, y"),
                ("mounting", "at: base", "x, y"),
                ("levelling", "", "rx, ry"),
                ("mcpc", "link: link1", "alpha, beta"),
            )
        ),
        ("joint_offset: {joint: joint1, offset: 0.02}", "'0.02' has no unit; an angle needs one of"),
        ("joint_offset: {joint: joint1, offset: 0.02}", "with a unit it is a constant, the same in every robot"),
        ("joint_offset: {joint: joint1, offset: 0.02}", "with ±, as '±0.02 UNIT', it is a tolerance"),
        ("axis_install: {joint: joint1, radius: ±0.1 mm, span: 1 m}", "a plain quantity, not a law or a tolerance"),
        ("length: {joint: joint2, parameters: ±1 mm, assumed: yes}", "assumed must be true or false, got 'yes'"),
    ):
        (finding,) = refuse(with_sources(source))
        assert says in finding.message
        assert finding.line == 8


def test_numbers_in_messages_have_units(refuse):
    beam = "beam: {link: link2, section: tube, material: aluminium, outer_diameter: 90 mm, WHAT}"
    clearance = "clearance: {joint: joint2, diametral: ±0.1 mm, direction: load, span: 1 mm, band: 1 N}"
    for source, says in (
        # 8.6 σ of 0.2/3 mm below 0
        (beam.replace("WHAT", "wall: {normal: 0.2 mm}"), "zero or negative (as low as -0.573333 mm); no mean is given"),
        (beam.replace("WHAT", "wall: {normal: 0.2 mm, mean: 0.1 mm}"), "-0.473333 mm); narrow or truncate its law"),
        (beam.replace("WHAT", "wall: 4 mm, E: -1 GPa"), "E of a beam must be positive, got -1 GPa"),
        (clearance, "diametral of clearance[joint2] can become negative (as low as -0.1 mm); no mean is given"),
        (clearance.replace("span: 1 mm", "span: -1 mm"), "the span of clearance must be positive, got -1 mm"),
        (clearance.replace("band: 1 N", "band: -5 N"), "the band of clearance must be positive, got -5 N"),
        (
            "thermal: {expansion: 23 ppm/K, temperature_change: 5 K, time_constant: -2 h}",
            "must be positive, got -7200 s",
        ),
        ("backlash: {joint: joint2, backlash: 1 arcmin, band: -1 N*m}", "must be positive, got -1 N*m or N"),
    ):
        (finding,) = refuse(with_sources(source))
        assert says in finding.message


REMARKS = [
    # numbers alone for errors
    ("joint_offset: {joint: joint1, offset: 0.02 deg}", "W_CONSTANT", "±0.02 deg"),
    ("length: {joint: joint3, parameters: [{uniform: 0.1 mm}, -0.25 mm]}", "W_CONSTANT", "±0.25 mm"),
    ("frame: {joint: joint2, rx: 1 mrad}", "W_CONSTANT", "1 mrad}"),
    ("encoder: {joint: joint2, offset: 1 mrad}", "W_CONSTANT", "±1 mrad"),
    ("levelling: {rx: 1 mrad}", "W_CONSTANT", "±1 mrad"),
    ("mounting: {at: base, z: 1 mm}", "W_CONSTANT", "±1 mm"),
    ("mcpc: {link: link2, alpha: 1 mrad}", "W_CONSTANT", "±1 mrad"),
    ("payload: {at: tool, mass: 1 kg, com: 0 0 10 mm}", None, ""),
    ("axis_install: {joint: joint2, radius: 0.1 mm, span: 100 mm}", None, ""),
    ("beam: {link: link2, EI: 8000 N*m^2, GI: 4000 N*m^2, roll: 0.5 rad}", None, ""),
    ("joint_compliance: {joint: joint2, compliance: 1e-5 rad/(N*m)}", None, ""),
    ("thermal: {expansion: 23 ppm/K, temperature_change: 5 K}", None, ""),
    ("backlash: {joint: joint2, backlash: 1 arcmin, band: 1 N*m}", None, ""),
    ("frame: {joint: joint2, x: 0 mm, y: {uniform: 0.1 mm}}", None, ""),
    ("joint_offset: {joint: joint1, offset: {fixed: 0.02 deg}}", None, ""),
    # radians for degrees
    ("joint_offset: {joint: joint1, offset: {normal: 0.5 rad}}", "W_ANGLE_UNIT", ""),
    ("joint_offset: {joint: joint1, offset: {normal: {std: 0.5 rad}}}", "W_ANGLE_UNIT", ""),
    ("covariance: {joint: joint1, std: [0 mm, 0 mm, 0 mm, 0.5 rad, 0 rad, 0 rad]}", "W_ANGLE_UNIT", ""),
    ("joint_offset: {joint: joint1, offset: {normal: 0.03 rad}}", None, ""),
    ("joint_offset: {joint: joint1, offset: {normal: 3 deg}}", None, ""),
]


def test_numbers_alone_and_large_angles_are_remarked(load):
    for source, code, words in REMARKS:
        findings = load(with_sources(source)).findings
        assert [(one.code, one.line) for one in findings] == ([(code, 8)] if code else []), source
        assert all(words in one.message for one in findings), source
    constant = [f"joint_offset: {{joint: joint{k}, offset: 0.02 deg}}" for k in (1, 2, 3)]
    (finding,) = load(with_sources(*constant, "frame: {joint: joint2, rx: 1 mrad, x: 1 mm}")).findings
    assert (finding.code, finding.line) == ("W_CONSTANT", 8)
    assert "(and 4 more like it)" in finding.message


def test_no_sources_no_spread_no_poses(load):
    for sources in ("", "sources: []\n"):
        assert [code for code, _ in warnings(load(HEAD + sources))] == ["W_NO_SOURCES"]
    for offset in ("{fixed: 0.02 deg}", "{uniform: 0 deg, mean: 1 mrad}", "{empirical: {samples: 1 1 1 mrad}}"):
        sheet = load(HEAD + f"sources:\n  - joint_offset: {{joint: joint1, offset: {offset}}}\n")
        assert "W_NOTHING_VARIES" in [code for code, _ in warnings(sheet)]
    text = with_sources().replace("poses:\n  reach: 0 10 30 0 deg\n", "")
    assert [code for code, _ in warnings(load(text))] == ["W_NO_POSES"]


def test_units_of_angles_of_poses(load):
    for pose, asked in (
        ("0 90 0 45 rad", "joint2 at 90 rad is 5157 deg; did you mean deg?"),
        ("0 1.57 0 0.785 deg", "joint2 at 1.57 deg looks like 0.5 π; did you mean rad?"),
        ("[0 rad, 0.1 rad, 45 rad, 0 rad]", "joint3 at 45 rad"),
        ("0 1.57 0 -2.9 rad", None),
        ("0 1.57 0 80 deg", None),
        ("0 400 0 0 deg", None),
    ):
        findings = load(with_sources().replace("0 10 30 0 deg", pose)).findings
        assert [(one.code, one.line) for one in findings] == ([("W_ANGLE_UNIT", 5)] if asked else [])
        assert all(f"pose 'reach': {asked}" in one.message for one in findings)


def test_units_of_angles_of_locked_joints_and_parameters(load):
    text = HEAD.replace("0 10 30 0 deg", "0 10 30 deg").replace("poses:", "locked: {joint4: 45 rad}\nposes:")
    (finding,) = load(text + "sources:\n" + VARIES.replace("joint4", "joint3")).findings
    assert (finding.code, finding.line) == ("W_ANGLE_UNIT", 4)
    assert "locked: joint4 at 45 rad is 2578 deg; did you mean deg?" in finding.message
    text = with_sources("joint_offset: {joint: joint1, offset: a}")
    text = text.replace("sources:", "parameters:\n  a: {normal: 1 rad}\nsources:")
    assert warnings(load(text)) == [("W_ANGLE_UNIT", 7)]


def test_a_mark_of_an_assumption_is_known_by_label_and_changes_no_number(load):
    marked = with_sources("length: {joint: joint2, parameters: ±1 mm, assumed: true}")
    one, other = (ErrorModel.from_sheet(load(text)) for text in (marked, marked.replace("true", "false")))
    assert (one.assumed, other.assumed) == (("length[joint2]",), ())
    assert one.space.draws == other.space.draws


NORMAL = """precision-pin: 1
robot: 4dof.urdf
poses: {home: 0 0 0 0 deg}
parameters:
  a: {normal: {std: 0.1 mm}}
  b: {normal: 0.2 mm, k: 2}
  c: {uniform: 0.1 mm}
sources:
  - length: {joint: joint3, parameters: [a, b, c]}
"""


def test_a_half_width_of_a_normal_law_is_noted_once_where_its_k_is_left_open(load):
    angle, length = (
        "joint_offset: {joint: joint1, offset: {normal: 0.01 deg}}",
        "frame: {joint: joint2, x: {normal: 1 um}}",
    )
    open_ones = f"{NORMAL}  - {angle}\n  - {length}\n"
    assert [load(text).findings for text in (NORMAL, open_ones)] == [(), ()]
    assert note_on_normal(read_text(NORMAL, "sheet.yaml"), "sheet.yaml") is None
    assert str(note_on_normal(read_text(open_ones, "sheet.yaml"), "sheet.yaml")) == (
        "sheet.yaml:10: note N_NORMAL: normal: 0.01 deg is a tolerance of ±3σ (and 1 more like it); a standard deviation is "
        "written normal: {std: 0.01 deg}"
    )


def test_accepted_warnings_are_notes_with_the_reason(load, refuse):
    constant = NORMAL + "  - joint_offset: {joint: joint1, offset: 1 mrad}\n"
    assert [finding.severity for finding in load(constant).findings] == ["warning"]
    (finding,) = load(f"{constant}accept: {{W_CONSTANT: measured on this arm}}\n").findings
    assert (finding.severity, finding.code) == ("note", "W_CONSTANT")
    assert str(finding).endswith("; accepted: measured on this arm")
    assert is_note(str(finding))
    for wrong in ("E_UNIT: yes", "W_CONSTANT: ' '", "CONSTANT: measured", "W_NO_REST: small"):
        assert [one.line for one in refuse(f"{constant}accept: {{{wrong}}}\n")] == [11], wrong


def test_what_buckles_is_no_matter_of_accepting(load):
    # upright, so that no joint feels the load, on a joint so soft that the arm tips over
    upright = NORMAL.replace("home: 0 0 0 0", "up: 0 -90 0 0")
    soft = "  - joint_compliance: {joint: joint2, compliance: 0.1 rad/(N*m)}\naccept: {W_STATICS: small}\n"
    model = ErrorModel.from_sheet(load(upright + soft))
    assert [(one.code, one.severity) for one in model.statics_findings(model.at("up"))] == [("W_NO_REST", "warning")]


@pytest.mark.parametrize(
    ("axis", "base", "lines", "warns"),
    [
        ("1 0 0", "table", "", True),
        ("1 0 0", "table", "gravity: none", False),
        ("1 0 0", "table", "gravity: 9.81 0 0 m/s^2", False),  # along the axis about which it turns
        ("0 0 1", "table", "", False),
        ("1 0 0", "floor", "", False),
        ("1 0 0", "table", "tip: floor", False),  # the table stands
    ],
)
def test_gravity_in_a_base_that_joints_turn(write, folder, axis, base, lines, warns):
    parts = [joint("tilt", "revolute", "floor", "table", axis=tuple(map(int, axis.split())), extra=limits(-1, 1))]
    parts += [joint("swing", "revolute", "floor", "arm", axis=(0, 1, 0), extra=limits(-1, 1))]
    (folder / "two.urdf").write_text(robot(*map(link, ("floor", "table", "arm")), *parts))
    tip = "" if "tip" in lines else "tip: arm\n"
    on = "tilt" if "tip" in lines else "swing"
    for source, counts in (("joint_compliance", True), ("joint_offset", False)):
        setting = "compliance: 1e-5 rad/(N*m)" if counts else "offset: ±1 mrad"
        head = f"precision-pin: 1\nrobot: two.urdf\nbase: {base}\n{tip}{lines}\n"
        text = f"{head}sources:\n  - {source}: {{joint: {on}, {setting}}}\n"
        found = [(f.line, f.message) for f in read(write(text)).findings if f.code == "W_GRAVITY"]
        assert [line for line, _ in found] == [3] * (warns and counts)
        assert all("in axes of the base table, which tilt turns: loads" in message for _, message in found)
