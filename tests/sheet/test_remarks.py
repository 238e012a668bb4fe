"""What a sheet says that is allowed but seldom meant: constants for tolerances, radians for degrees, nothing that varies."""

from __future__ import annotations

import math

import pytest

from precision_pin.base.errors import Finding, is_note
from precision_pin.draws.laws import Law, Uniform
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet import Sheet
from precision_pin.sheet.sheet_lint import note_on_normal

from .conftest import Load, Refuse

HEAD = """precision-pin: 1
robot: 4dof.urdf
tip: tool
poses:
  reach: 0 10 30 0 deg
"""
VARIES = "  - joint_offset: {joint: joint4, offset: {normal: 0.02 deg}}\n"


def with_sources(*sources: str) -> str:
    return HEAD + "sources:\n" + VARIES + "".join(f"  - {source}\n" for source in sources)


def warnings(sheet: Sheet) -> list[tuple[str, int | None]]:
    return [(finding.code, finding.line) for finding in sheet.findings]


def law_of(sheet: Sheet, name: str) -> Law:
    return next(draw.law for draw in ErrorModel.from_sheet(sheet).space.draws if draw.name == name)


TOLERANCES = {
    "±0.02 deg": (0.02, 0),
    "+-0.02 deg": (0.02, 0),
    "+/-0.02 deg": (0.02, 0),
    "-0.1 deg +- 0.02 deg": (0.02, -0.1),
    "6 arcmin ± 0.02 deg": (0.02, 0.1),
}


def test_a_sign_makes_a_number_a_uniform_tolerance(load: Load) -> None:
    for written, (half_width, mean) in TOLERANCES.items():
        sheet = load(with_sources(f"joint_offset: {{joint: joint1, offset: {written}}}"))
        found = law_of(sheet, "joint_offset[joint1].offset")
        assert isinstance(found, Uniform)
        assert found.half_width == pytest.approx(math.radians(half_width), rel=1e-12)
        assert found.mean == pytest.approx(math.radians(mean), rel=1e-12, abs=1e-18)
        assert sheet.findings == ()
    # of a parameter and of lists
    text = HEAD + "parameters:\n  a: ± 0.1 mm\nsources:\n  - length: {joint: joint2, parameters: ± 0.2 mm}\n"
    sheet = load(text + "  - length: {joint: joint3, parameters: [a, 1 ± 0.3 mm]}\n")
    assert law_of(sheet, "length[joint3].parameters[1]") == Uniform(0.3e-3, 1e-3)
    assert law_of(sheet, "a") == Uniform(1e-4)
    assert law_of(sheet, "length[joint2].parameters") == Uniform(2e-4)


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("joint_offset: {joint: joint1, offset: ±0.02}", "'0.02' has no unit"),
        ("joint_offset: {joint: joint1, offset: ±-0.02 deg}", "the half-width is negative"),
        ("joint_offset: {joint: joint1, offset: ± deg}", "expected a number with a unit"),
        ("joint_offset: {joint: joint1, offset: 1 mm ± 0.02 deg}", "'mm' in '1 mm' is not a unit of angle"),
        ("joint_offset: {joint: joint1, offset: 0.02}", "'0.02' has no unit; an angle needs one of"),
        ("joint_offset: {joint: joint1, offset: 0.02}", "with a unit it is a constant, the same in every robot"),
        ("joint_offset: {joint: joint1, offset: 0.02}", "with ±, as '±0.02 UNIT', it is a tolerance"),
        (
            "axis_install: {joint: joint1, radius: ±0.1 mm, span: 1 m}",
            "expected a plain quantity, not a law or a tolerance",
        ),
        ("length: {joint: joint2, parameters: ±1 mm, assumed: yes}", "assumed must be true or false, got 'yes'"),
    ],
)
def test_wrong_ones_get_one_line(refuse: Refuse, source: str, says: str) -> None:
    (finding,) = refuse(with_sources(source))
    assert says in finding.message
    assert finding.line == 8


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


def test_numbers_alone_and_large_angles_are_remarked(load: Load) -> None:
    for source, code, words in REMARKS:
        findings = load(with_sources(source)).findings
        assert [(one.code, one.line) for one in findings] == ([(code, 8)] if code else []), source
        assert all(words in one.message for one in findings), source
    constant = [f"joint_offset: {{joint: joint{k}, offset: 0.02 deg}}" for k in (1, 2, 3)]
    (finding,) = load(with_sources(*constant, "frame: {joint: joint2, rx: 1 mrad, x: 1 mm}")).findings
    assert (finding.code, finding.line) == ("W_CONSTANT", 8)
    assert "(and 4 more like it)" in finding.message


def test_no_sources_no_spread_no_poses(load: Load) -> None:
    for sources in ("", "sources: []\n"):
        assert [code for code, _ in warnings(load(HEAD + sources))] == ["W_NO_SOURCES"]
    for offset in ("{fixed: 0.02 deg}", "{uniform: 0 deg, mean: 1 mrad}", "{empirical: {samples: 1 1 1 mrad}}"):
        sheet = load(HEAD + f"sources:\n  - joint_offset: {{joint: joint1, offset: {offset}}}\n")
        assert "W_NOTHING_VARIES" in [code for code, _ in warnings(sheet)]
    text = with_sources().replace("poses:\n  reach: 0 10 30 0 deg\n", "")
    assert [code for code, _ in warnings(load(text))] == ["W_NO_POSES"]


@pytest.mark.parametrize(
    ("pose", "asked"),
    [
        ("0 90 0 45 rad", "joint2 at 90 rad is 5157 deg; did you mean deg?"),
        ("0 1.57 0 0.785 deg", "joint2 at 1.57 deg looks like 0.5 π; did you mean rad?"),
        ("[0 rad, 0.1 rad, 45 rad, 0 rad]", "joint3 at 45 rad"),
        ("0 1.57 0 -2.9 rad", None),
        ("0 1.57 0 80 deg", None),
        ("0 400 0 0 deg", None),
    ],
)
def test_units_of_angles_of_poses(load: Load, pose: str, asked: str | None) -> None:
    findings = load(with_sources().replace("0 10 30 0 deg", pose)).findings
    assert [(one.code, one.line) for one in findings] == ([("W_ANGLE_UNIT", 5)] if asked else [])
    assert all(f"pose 'reach': {asked}" in one.message for one in findings)


def test_units_of_angles_of_locked_joints_and_parameters(load: Load) -> None:
    text = HEAD.replace("0 10 30 0 deg", "0 10 30 deg").replace("poses:", "locked: {joint4: 45 rad}\nposes:")
    (finding,) = load(text + "sources:\n" + VARIES.replace("joint4", "joint3")).findings
    assert (finding.code, finding.line) == ("W_ANGLE_UNIT", 4)
    assert "locked: joint4 at 45 rad is 2578 deg; did you mean deg?" in finding.message
    text = with_sources("joint_offset: {joint: joint1, offset: a}")
    text = text.replace("sources:", "parameters:\n  a: {normal: 1 rad}\nsources:")
    assert warnings(load(text)) == [("W_ANGLE_UNIT", 7)]


def test_a_mark_of_an_assumption_is_known_by_label_and_changes_no_number(load: Load) -> None:
    marked = with_sources("length: {joint: joint2, parameters: ±1 mm, assumed: true}")
    one, other = (ErrorModel.from_sheet(load(text)) for text in (marked, marked.replace("true", "false")))
    assert (one.assumed, other.assumed) == (("length[joint2]",), ())
    assert one.space.components == other.space.components
    assert (one.space.sample(1, 0, 5) == other.space.sample(1, 0, 5)).all()


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


def test_a_half_width_of_a_normal_law_is_noted_once_where_its_k_is_left_open(load: Load) -> None:
    def note(text: str) -> Finding | None:
        sheet = load(text)
        assert sheet.contents is not None
        assert sheet.findings == ()
        return note_on_normal(sheet.contents.text, "sheet.yaml")

    assert note(NORMAL) is None
    open_ones = (
        "  - joint_offset: {joint: joint1, offset: {normal: 0.01 deg}}\n  - frame: {joint: joint2, x: {normal: 1 um}}\n"
    )
    found = note(NORMAL + open_ones)
    assert found is not None
    assert (found.severity, found.code, found.line) == ("note", "N_NORMAL", 10)
    assert found.message == (
        "normal: 0.01 deg is a tolerance of ±3σ (and 1 more like it); a standard deviation is written normal: {std: 0.01 deg}"
    )


def test_accepted_warnings_are_notes_with_the_reason(load: Load, refuse: Refuse) -> None:
    constant = NORMAL + "  - joint_offset: {joint: joint1, offset: 1 mrad}\n"
    assert [finding.severity for finding in load(constant).findings] == ["warning"]
    (finding,) = load(f"{constant}accept: {{W_CONSTANT: measured on this arm}}\n").findings
    assert (finding.severity, finding.code) == ("note", "W_CONSTANT")
    assert str(finding).endswith("; accepted: measured on this arm")
    assert is_note(str(finding))
    for wrong in ("E_UNIT: yes", "W_CONSTANT: ' '", "CONSTANT: measured", "W_NO_REST: small"):
        assert [one.line for one in refuse(f"{constant}accept: {{{wrong}}}\n")] == [11], wrong


def test_what_buckles_is_no_matter_of_accepting(load: Load) -> None:
    # upright, so that no joint feels the load, on a joint so soft that the arm tips over
    upright = NORMAL.replace("home: 0 0 0 0", "up: 0 -90 0 0").replace(
        "sources:", "accept: {W_STATICS: small}\nsources:"
    )
    soft = "  - joint_compliance: {joint: joint2, compliance: 0.1 rad/(N*m)}\n"
    model = ErrorModel.from_sheet(load(f"{upright}{soft}"))
    assert [(one.code, one.severity) for one in model.statics_findings(model.at("up"))] == [("W_NO_REST", "warning")]
