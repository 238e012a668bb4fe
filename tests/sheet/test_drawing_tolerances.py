"""Tolerances as drawings write them: tables against their formulas and published limits; texts against hand-made laws."""

import re

import numpy as np
import pytest
from tests.support.refusals import check_refused

import precision_pin as pp
from precision_pin.draws.laws import Normal, TruncatedNormal, Uniform
from precision_pin.sheet import json_schema, read
from precision_pin.sheet.drawing_tolerances import _tables, class_limits, general_tolerance, grade_width

ISO286 = _tables()["iso286"]
MULTIPLES = dict(zip(range(5, 19), (7, 10, 16, 25, 40, 64, 100, 160, 250, 400, 640, 1000, 1600, 2500), strict=True))
FINE = {  # of sizes 1 to 3, … 250 to 315 mm
    "IT1": (0.8, 1, 1, 1.2, 1.5, 1.5, 2, 2.5, 3.5, 4.5, 6),
    "IT2": (1.2, 1.5, 1.5, 2, 2.5, 2.5, 3, 4, 5, 7, 8),
    "IT3": (2, 2.5, 2.5, 3, 4, 4, 5, 6, 8, 10, 12),
    "IT4": (3, 4, 4, 5, 6, 7, 8, 10, 12, 14, 16),
}


@pytest.mark.parametrize("grade", MULTIPLES)
def test_grades_are_the_formula_rounded(grade):
    """ISO 286-1: i = 0.45 D^(1/3) + 0.001 D up to 500 mm, I = 0.004 D + 2.1 above, D the geometric mean of the step."""
    edges = np.array([1, *ISO286["sizes"]], dtype=float)
    size = np.sqrt(edges[:-1] * edges[1:])
    unit = np.where(edges[1:] <= 500, 0.45 * np.cbrt(size) + 0.001 * size, 0.004 * size + 2.1)
    # rounded to preferred numbers, in the first step upwards by up to 16 %
    first, *others = np.array(ISO286["grades"][f"IT{grade}"], dtype=float) / (MULTIPLES[grade] * unit)
    assert 1 <= first <= 1.16
    assert others == pytest.approx(np.ones(len(others)), abs=0.1)


def test_fine_grades_are_those_of_a_workshop_s_table():
    assert {name: tuple(map(float, ISO286["grades"][name][:11])) for name in FINE} == FINE


def test_steps_end_with_their_size():
    widths = [grade_width(*of) for of in (("IT7", 0.08), ("IT7", 0.0800001), ("IT6", 0.5), ("IT12", 0.001))]
    assert widths == pytest.approx([30e-6, 35e-6, 40e-6, 100e-6])
    rows = [
        ("3150 mm", "IT7", 0.0),
        ("3150 mm", "IT7", 3.2),
        ("600 mm", "IT0", 0.6),
        ("did you mean 'IT7'", "IT77", 0.1),
    ]
    check_refused(*((message, grade_width, *given) for message, *given in rows))


def _grade(grade, size):
    return float(class_limits(f"IT{grade}", size * 1e-3)[1]) * 2


FORMULAS = {  # of ISO 286-1 annex B up to 500 mm, µm, of the geometric mean D of a step and its largest size, mm
    "a": lambda D, top: 265 + 1.3 * D if top <= 120 else 3.5 * D,
    "b": lambda D, top: 140 + 0.85 * D if top <= 160 else 1.8 * D,
    "c": lambda D, top: 52 * D**0.2 if top <= 18 else 95 + 0.8 * D,
    "d": lambda D, top: 16 * D**0.44,
    "e": lambda D, top: 11 * D**0.41,
    "f": lambda D, top: 5.5 * D**0.41,
    "g": lambda D, top: 2.5 * D**0.34,
    "m": lambda D, top: _grade(7, top) - _grade(6, top),
    "n": lambda D, top: 5 * D**0.34,
    "p": lambda D, top: _grade(7, top) + 2.5,
    "t": lambda D, top: _grade(7, top) + 0.63 * D,
    "u": lambda D, top: _grade(7, top) + D,
    "v": lambda D, top: _grade(7, top) + 1.25 * D,
    "x": lambda D, top: _grade(7, top) + 1.6 * D,
    "y": lambda D, top: _grade(7, top) + 2 * D,
    "z": lambda D, top: _grade(7, top) + 2.5 * D,
    "za": lambda D, top: _grade(8, top) + 3.15 * D,
    "zb": lambda D, top: _grade(9, top) + 4 * D,
    "zc": lambda D, top: _grade(10, top) + 5 * D,
}


def _nearer(letter, step):
    values = ISO286["deviations"][letter]
    steps = ISO286["sizes" if len(values) <= 21 else "fine_sizes"]
    edges = [1, *steps]
    return float(values[step]), float(np.sqrt(edges[step] * edges[step + 1])), steps[step]


@pytest.mark.parametrize("letter", FORMULAS)
def test_deviations_are_the_formula_rounded(letter):
    """Every value up to 500 mm: rounded by up to 6 % or 3.5 µm, in the steps to 18 mm by up to 15 %."""
    count = sum(step <= 500 for step in ISO286["sizes" if len(ISO286["deviations"][letter]) <= 21 else "fine_sizes"])
    for step in range(3, count):  # those of the first steps are none of the formulas
        value, mean, largest = _nearer(letter, step)
        if np.isnan(value):
            continue
        formula = FORMULAS[letter](mean, largest)
        assert abs(value - formula) <= max(3.5, (0.06 if largest > 18 else 0.15) * formula), (largest, value, formula)


def test_the_first_steps_are_those_of_a_book():
    """Narayana, Kannaiah, Reddy: Machine Drawing, table 15.2, shafts to 3, 6 and 10 mm."""
    book = {
        "m": (2, 4, 6), "n": (4, 8, 10), "p": (6, 12, 15), "r": (10, 15, 19), "s": (14, 19, 23), "u": (18, 23, 28),
        "x": (20, 28, 34), "z": (26, 35, 42), "za": (32, 42, 52), "zb": (40, 50, 67), "zc": (60, 80, 97),
    }  # fmt: skip
    assert {letter: tuple(_nearer(letter, step)[0] for step in range(3)) for letter in book} == book


def test_intermediate_deviations_are_geometric_means():
    for letter, first, other in (("cd", "c", "d"), ("ef", "e", "f"), ("fg", "f", "g")):
        for size in (3, 6, 10, 18, 30):
            means = [float(class_limits(f"{name}5", size * 1e-3)[1]) for name in (letter, first, other)]
            assert means[0] == pytest.approx(-np.sqrt(means[1] * means[2]), rel=0.1, abs=0.6)


PUBLISHED = [  # from tables of limits in books, catalogues and the corrigendum of ISO 286-2 of 2006: size mm, limits µm
    ("H7", 50, 0, 25), ("s6", 50, 43, 59), ("g6", 25, -20, -7), ("f7", 25, -41, -20), ("h6", 10, -9, 0),
    ("k6", 40, 2, 18), ("k8", 40, 0, 39), ("m6", 40, 9, 25), ("n6", 40, 17, 33), ("p6", 40, 26, 42), ("r6", 70, 43, 62),
    ("F7", 90, 36, 71), ("E8", 100, 72, 126), ("A13", 330, 1200, 2090), ("R10", 25, -112, -28), ("f9", 300, -186, -56),
    ("d9", 40, -142, -80), ("c11", 40, -280, -120), ("u6", 110, 144, 166), ("JS7", 80, -15, 15), ("js6", 10, -4.5, 4.5),
    ("K7", 20, -15, 6), ("M6", 60, -24, -5), ("M6", 300, -41, -9), ("N7", 20, -28, -7), ("P7", 20, -35, -14),
    ("P9", 20, -74, -22), ("N9", 2, -29, -4), ("N9", 5, -30, 0), ("J7", 40, -11, 14), ("j6", 40, -5, 11), ("J6", 40, -6, 10),
    ("H11", 30, 0, 130), ("IT7", 80, -15, 15), ("U7", 490, -580, -517), ("n6", 550, 44, 88), ("N9", 600, -219, -44),
]  # fmt: skip


def test_published_limits():
    found = {(name, size): tuple(map(float, class_limits(name, size * 1e-3))) for name, size, *_ in PUBLISHED}
    assert found == {(name, size): (float(low), float(high)) for name, size, low, high in PUBLISHED}
    refused = (
        ("T7", 0.02),
        ("a9", 0.001),
        ("Q7", 0.05),
        ("Hh7", 0.05),
        ("K9", 0.05),
        ("j9", 0.05),
        ("N9", 0.001),
        ("za5", 0.6),
    )
    check_refused(*(("there is no class", class_limits, *given) for given in refused))


def test_general_tolerances():
    """ISO 2768-1, tables 1 and 3: the value at the end of a step, and the next beyond it."""
    lengths = {
        size: [float(general_tolerance(c, size * 1e-3, "length")) for c in "mc"] for size in (3, 6.1, 120, 120.1, 2001)
    }
    assert lengths == {3: [0.1, 0.2], 6.1: [0.2, 0.5], 120: [0.3, 0.8], 120.1: [0.5, 1.2], 2001: [2, 4]}
    assert [float(general_tolerance(c, 0.4, "length")) for c in "fmcv"] == [0.2, 0.5, 1.2, 2.5]
    assert [float(general_tolerance(c, 0.4, "angle")) for c in "fmcv"] == [10, 10, 15, 30]
    assert [float(general_tolerance("c", size, "angle")) for size in (0.01, 0.05, 0.12, 9)] == [90, 60, 30, 10]
    refused = ("f", 3, "length"), ("v", 0.002, "length"), ("m", 0.0004, "length"), ("m", 5, "length"), ("m", 0, "angle")
    check_refused(*(("there is no (length|angle) tolerance", general_tolerance, *given) for given in refused))


STACK = """<robot name="stack"><link name="a"/><link name="b"/><link name="c"/><link name="tool"/>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.1 0 0"/><axis xyz="1 0 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.2 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="t" type="fixed"><parent link="c"/><child link="tool"/><origin xyz="0.15 0.004 0"/></joint></robot>"""


@pytest.fixture
def draw(tmp_path):
    """Return a function from a source, such as a length's parameters, to its only draw."""
    (tmp_path / "stack.urdf").write_text(STACK, encoding="utf-8")

    def draw_of(value, source="length: {joint: j2, parameters: VALUE}"):
        head = "precision-pin: 1\nrobot: stack.urdf\nposes: {p: 0 0 deg}\nsources:\n  - "
        path = tmp_path / "stack.errors.yaml"
        path.write_text(head + source.replace("VALUE", value) + "\n", encoding="utf-8")
        sheet = read(path)
        (found,) = sheet.whole_space.draws
        return found

    return draw_of


def _assert_law(law, other):
    assert type(law) is type(other)
    assert law.mean == pytest.approx(other.mean, rel=1e-12, abs=1e-18)
    assert law.variance == pytest.approx(other.variance, rel=1e-12)


READ = [
    ("+0.5/-0.1 mm", Uniform(0.3e-3, 0.2e-3)),
    ("+0.5 mm/-0.1 mm", Uniform(0.3e-3, 0.2e-3)),
    ("+0.5 mm / -0.1 mm", Uniform(0.3e-3, 0.2e-3)),
    ("+0.5 -0.1 mm", Uniform(0.3e-3, 0.2e-3)),
    ("-0.1/+0.5 mm", Uniform(0.3e-3, 0.2e-3)),
    ("+0.5/\N{MINUS SIGN}0.1 mm", Uniform(0.3e-3, 0.2e-3)),
    ("+.5/0 mm", Uniform(0.25e-3, 0.25e-3)),
    ("0/-41 um", Uniform(20.5e-6, -20.5e-6)),
    ("0.2 +0.5/-0.1 mm", Uniform(0.3e-3, 0.4e-3)),
    ("10 +5/-1 mm", Uniform(3e-3, 12e-3)),
    ("10 mm +0.018/0 mm", Uniform(9e-6, 10.009e-3)),
    ("{normal: +0.5/-0.1 mm}", Normal(0.1e-3, 0.2e-3)),
    ("{triangular: +0.5/-0.1 mm}", pp.Triangular(0.3e-3, 0.2e-3)),
    ("{normal: 0.1 mm, cpk: 1.33}", Normal(0.1e-3 / 3.99)),
    ("{normal: +0.5/-0.1 mm, cpk: 2}", Normal(0.05e-3, 0.2e-3)),
    ("{normal: ±0.1 mm, cpk: 1, truncated: true}", TruncatedNormal(0.1e-3 / 3, k=3.0)),
    ("{uniform: H7, size: 50 mm}", Uniform(12.5e-6, 12.5e-6)),
    ("{normal: H7, size: 50 mm, k: 2}", Normal(6.25e-6, 12.5e-6)),
    ("50 mm H7", Uniform(12.5e-6, 50.0125e-3)),
    ("⌀25 mm g6", Uniform(6.5e-6, 24.9865e-3)),
    ("{uniform: IT7, size: 80 mm}", Uniform(15e-6)),
    ("{uniform: js9, size: 50 mm, mean: 1 mm}", Uniform(31e-6, 1e-3)),
    ("{uniform: ISO 2768-m, size: 500 mm}", Uniform(0.8e-3)),
    # of the robot: joint2 is 200 mm from joint1
    ("IT7", Uniform(23e-6)),
    ("ISO 2768-m", Uniform(0.5e-3)),
    ("DIN ISO 2768-1 c", Uniform(1.2e-3)),
    ("{normal: H7}", Normal(23e-6 / 3, 23e-6)),
]


@pytest.mark.parametrize(("text", "law"), READ, ids=[text for text, _ in READ])
def test_what_drawings_write(draw, text, law):
    _assert_law(draw(text).law, law)


def test_the_size_of_the_robot_is_that_along_the_direction(draw):
    of_tool = "length: {frame: tool, along: DIRECTION, parameters: ISO 2768-m}"
    # 150.05 mm along the link, 150 mm along x, 4 mm along y of the joint before it
    for direction, half_width in (("link", 0.5e-3), ("x of j2", 0.5e-3), ("-y of j2", 0.1e-3)):
        assert draw("", of_tool.replace("DIRECTION", direction)).law == Uniform(half_width)
    refusals = (
        ("z of j2", "there is no length tolerance in ISO 2768-m for a size of 0 mm"),
        ("y of a", "needs the nominal size, as in {uniform: ISO 2768-m"),
    )
    check_refused(*((message, draw, "", of_tool.replace("DIRECTION", along)) for along, message in refusals))


def test_angles_have_the_table_of_angles(draw):
    source = "joint_offset: {joint: j1, offset: VALUE}"
    assert draw("{uniform: ISO 2768-c, size: 60 mm}", source).law == Uniform(np.radians(0.5))
    assert draw("+0.2/-0.1 deg", source).law.mean == pytest.approx(np.radians(0.05))
    check_refused(
        ("the class H7 is of lengths; expected a tolerance of angle", draw, "{uniform: H7, size: 60 mm}", source),
        ("needs the nominal size", draw, "ISO 2768-m", source),
    )


def test_what_is_not_read_is_named(draw):
    rows = (
        *((f"'{text}' is not read; a tolerance is written ±0.1 mm, +0.5/-0.1 mm", draw, text)
          for text in ("ISO 2768-mK", "H7/g6", "DIN 7168-m", "ISO 13920-B", "ASME Y14.5")),
        ("the size in '50 H7' needs its unit: '50 mm H7'", draw, "50 H7"),
        ("there is no parameter H7; the class of ISO 286 is written '50 mm H7'", draw, "H7"),
        ("the limits in '+0.5/-0.1' need one unit", draw, "+0.5/-0.1"),
        ("the limits in '+0.5 um/-0.1 mm' need one unit", draw, "+0.5 um/-0.1 mm"),
        ("decimals have a point: '+0.5/-0.1 mm'", draw, "'+0,5/-0,1 mm'"),
        ("there is no class T7 in ISO 286-1 for 4 mm", draw, "{uniform: T7, size: 4 mm}"),
        ("size is that of a class", draw, "{uniform: 0.1 mm, size: 4 mm}"),
        ("'+0.5/-0.1 mm' gives the mean, 0.2 mm", draw, "{uniform: +0.5/-0.1 mm, mean: 1 mm}"),
        ("give k or cpk", draw, "{normal: 0.1 mm, cpk: 1, k: 3}"),
        ("cpk must be positive, got 0", draw, "{normal: 0.1 mm, cpk: 0}"),
        ("cpk has no effect here: {std: …} is", draw, "{normal: {std: 0.1 mm}, cpk: 1}"),
        ("'cpk' is no setting of the law uniform", draw, "{uniform: 0.1 mm, cpk: 1}"),
    )  # fmt: skip
    check_refused(*((re.escape(message), *given) for message, *given in rows))


def test_a_direction_that_does_not_exist_is_named_and_no_missing_size(load):
    text = "precision-pin: 1\nrobot: 4dof.urdf\nposes: {p: 0 0 0 0 deg}\nsources:\n"
    with pytest.raises(pp.InputError, match="no joint on the chain named 'joint9'"):
        load(text + "  - length: {joint: joint2, along: z of joint9, parameters: [{uniform: ISO 2768-f}]}")


def test_a_parameter_of_the_name_of_a_class_stays_a_parameter(load):
    text = "precision-pin: 1\nrobot: 4dof.urdf\nposes: {p: 0 0 0 0 deg}\nparameters: {H7: ±0.1 mm, IT7: +2/0 um}\n"
    sheet = load(text + "sources:\n  - length: {joint: joint2, parameters: [H7, IT7]}\n")
    assert [draw.law for draw in sheet.whole_space.draws] == [Uniform(1e-4), Uniform(1e-6, 1e-6)]


@pytest.mark.slow
def test_the_mean_moves_the_tip_and_every_sample(tmp_path):
    """Of a tolerance +0.5/-0.1 along x the error is within these limits, 0.2 mm in the mean, in both models."""
    (tmp_path / "stack.urdf").write_text(STACK, encoding="utf-8")
    data = {"precision-pin": 1, "robot": "stack.urdf", "poses": {"p": "0 0 deg"}}
    data["sources"] = [{"length": {"frame": "tool", "along": "x of j2", "parameters": "+0.5/-0.1 mm"}}]
    at = pp.ErrorModel.from_dict(data, tmp_path).at("p")
    samples = pp.Uniform(0.3e-3, 0.2e-3).sample(np.linspace(0, 1, 5)[None])
    np.testing.assert_allclose(at.tangent[0][0], 0.2e-3)
    for error in (at.exact(samples), at.linear(samples)):
        np.testing.assert_allclose(error[0], np.linspace(-0.1e-3, 0.5e-3, 5), atol=1e-12)


def test_a_nominal_size_in_a_deviation_is_doubted(load):
    head = "precision-pin: 1\nrobot: 4dof.urdf\nposes: {p: 0 0 0 0 deg}\nsources:\n  - length: {joint: joint2, parameters: "
    for text, offset in (
        ("300 +0.5/-0.1 mm", "300.2 mm"),
        ("50 mm H7", "50.0125 mm"),
        ("[±1 mm, 300 ± 0.1 mm]", "300 mm"),
    ):
        (finding,) = load(f"{head}{text}}}\n").findings
        assert finding.code == "W_CONSTANT"
        assert f"is a mean error of {offset}, the same in every robot" in finding.message
    assert load(f"{head}+0.018/0 mm}}\n").findings == ()


def test_the_schema_has_them():
    law = json_schema()["$defs"]["law"]["properties"]
    assert {"size", "cpk"} <= law.keys()
