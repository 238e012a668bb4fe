"""Beams of rigidities, of material and dimensions, and in a sheet: section constants, random dimensions, every engine."""

from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from precision_pin import Draw, ErrorModel, Normal, Space, Uniform
from precision_pin.base.errors import SheetError
from precision_pin.draws.expressions import Component, Program
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import json_schema
from precision_pin.sources import Beam, Payload
from precision_pin.sources.beam import point_flexibility, stretch_flexibility, weight_flexibility
from precision_pin.sources.profiles import MATERIALS, Section, Segment, box, rod, tube
from support.checks.common import evaluated, one_link
from support.engines import check_engines
from support.oracles import torsion_constant

RANDOM = {
    "tube": ({"outer_diameter": 0.06, "wall": 0.002, "E": 7e10, "G": 2.7e10}, {}),
    "rod": ({"diameter": 0.04, "E": 7e10}, {"poisson_ratio": 0.3}),
    "box": ({"width": 0.04, "height": 0.06, "wall": 0.003, "E": 7e10, "G": 2.7e10}, {}),
    "general": ({"area": 1e-4, "I_y": 3e-9, "I_z": 8e-9, "J": 5e-9, "E": 7e10, "G": 2.6e10}, {}),
}

L = 1.7
GRAVITY = (3.0, -4.0, -8.0)


def chain():
    """One link along x that turns about z, 1.7 m long, with a weight off its end."""
    return one_link(length=1.7, gravity=GRAVITY, mass=3.0, com=(0.8, 0.1, 0.0)).with_payload(2.0, (0.1, 0.2, -0.3))


def end_displacement(**settings) -> np.ndarray:
    return next(iter(evaluated(chain(), [0.2], [Beam(link="arm", **settings)])[1].values()))


@pytest.mark.parametrize(("start", "stop"), [(0.0, 0.6), (0.4, 1.1), (0.5, 0.5 + 1e-7)])
def test_a_weight_on_a_part_is_the_mean_of_point_loads(start, stop):
    nodes, weights = leggauss(4)
    reaches = start + (stop - start) * (nodes + 1) / 2
    mean = sum(w / 2 * point_flexibility(L, reach) for w, reach in zip(weights, reaches, strict=True))
    mean[:, 3:] = 0.0  # a weight has no moment
    np.testing.assert_allclose(stretch_flexibility(L, start, stop), mean, rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(stretch_flexibility(L, 0.0, L), weight_flexibility(L))


def test_tube_of_the_steel_tables():
    """CHS 60.3 x 3.2 in EN 10210-2: A 5.74 cm², I 23.5 cm⁴, I_t 46.9 cm⁴, 4.51 kg/m."""
    section = tube(60.3e-3, 3.2e-3)
    mass = MATERIALS["steel"].density * section.area
    found = np.array([section.area * 1e4, section.I_y * 1e8, section.J * 1e8, mass])
    assert (np.abs(found - [5.74, 23.5, 46.9, 4.51]) < [0.005, 0.05, 0.05, 0.005]).all()


# --- constants of sections ---


@pytest.mark.parametrize(("outer", "wall"), [(0.06, 0.002), (0.1, 0.05), (0.03, 1e-5)])
def test_tube_and_rod_by_integrals_over_their_area(outer, wall):
    """Rings of radius r: A = ∫ 2πr dr, I = ∫ πr³ dr, J = ∫ 2πr³ dr; four Gauss points are exact."""
    nodes, weights = leggauss(4)
    r = outer / 2 - wall / 2 + wall / 2 * nodes
    area, second, polar = (wall / 2 * weights @ f for f in (2 * np.pi * r, np.pi * r**3, 2 * np.pi * r**3))
    # the difference of two discs loses D/t digits
    tolerance = 4e-16 * outer / wall + 4e-16
    for section in (tube(outer, wall), *([rod(outer)] if wall == outer / 2 else [])):
        values = [section.area, section.I_y, section.I_z, section.J]
        np.testing.assert_allclose(values, [area, second, second, polar], rtol=tolerance)


def test_box_by_flanges_and_webs():
    """Two flanges (along z) and two webs with Steiner's terms; b along z, h along y."""
    b, h, t = 0.08, 0.12, 0.01
    flange, web = b * t, (h - 2 * t) * t
    i_z = 2 * (b * t**3 / 12 + flange * ((h - t) / 2) ** 2) + 2 * t * (h - 2 * t) ** 3 / 12
    i_y = 2 * t * b**3 / 12 + 2 * ((h - 2 * t) * t**3 / 12 + web * ((b - t) / 2) ** 2)
    section = box(b, h, t)
    values = [section.area, section.I_y, section.I_z]
    np.testing.assert_allclose(values, [2 * flange + 2 * web, i_y, i_z], rtol=2e-15)


@pytest.mark.parametrize(("width", "height", "wall", "low"), [(1.0, 1.0, 0.1, 0.054), (0.08, 0.12, 0.01, 0.055)])
def test_torsion_of_a_box_is_bredts_formula_and_low_by_as_much_as_stated(width, height, wall, low):
    coarse, fine = (torsion_constant(width, height, wall, cells) for cells in (2, 4))
    exact = fine + (fine - coarse) / 3
    assert box(width, height, wall).J / exact - 1 == pytest.approx(-low, abs=0.001)


def test_materials_are_consistent_and_named_with_their_source():
    """G = E/(2(1 + ν)) with ν of metals; the aluminium of EN 1999-1-1 rounds G to 27 GPa."""
    assert set(MATERIALS) == {"steel", "stainless_steel", "aluminium", "titanium"}
    for material in MATERIALS.values():
        assert 0.29 < material.E / (2 * material.G) - 1 < 0.35
        assert material.source


# --- in a beam ---


BOX = {"section": "box", "width": 0.04, "height": 0.06, "wall": 0.003}
GENERAL = {"section": "general", "area": 1e-4, "I_y": 3e-9, "I_z": 8e-9, "J": 5e-9}
TUBE = {"section": "tube", "outer_diameter": 0.06, "wall": 0.002}


@pytest.mark.parametrize(
    ("settings", "section", "modulus", "shear"),
    [
        ({"section": "rod", "diameter": 0.04, "material": "aluminium"}, rod(0.04), 70e9, 27e9),
        (BOX | {"material": "aluminium"}, box(0.04, 0.06, 0.003), 70e9, 27e9),
        (GENERAL | {"material": "aluminium"}, Section(1e-4, 3e-9, 8e-9, 5e-9), 70e9, 27e9),
        (TUBE | {"material": "steel", "E": 200e9}, tube(0.06, 0.002), 200e9, 81e9),
        (TUBE | {"material": "steel", "G": 79e9}, tube(0.06, 0.002), 210e9, 79e9),
        (TUBE | {"E": 7e10, "poisson_ratio": 0.25}, tube(0.06, 0.002), 7e10, 2.8e10),
        (TUBE | {"material": "titanium", "poisson_ratio": 0.0}, tube(0.06, 0.002), 113.8e9, 56.9e9),
        (TUBE | {"E": 7e10, "G": 2e10}, tube(0.06, 0.002), 7e10, 2e10),
    ],
)
def test_a_section_is_the_rigidities_it_stands_for(settings, section, modulus, shear):
    plain = {"EI_y": modulus * section.I_y, "EI_z": modulus * section.I_z, "GI": shear * section.J}
    expected = end_displacement(**plain, EA=modulus * section.area)
    np.testing.assert_allclose(end_displacement(**settings), expected, rtol=1e-14, atol=1e-18)


def test_axial_stiffness_at_the_end_is_force_over_metre():
    pulled = one_link(length=1.3, gravity=(9.81, 0.0, 0.0)).with_payload(2.0)
    (moved,) = evaluated(pulled, [0.0], [Beam(link="arm", axial_stiffness=5e5)])[1].values()
    np.testing.assert_allclose(moved, [2 * 9.81 / 5e5, 0, 0, 0, 0, 0], rtol=1e-14, atol=1e-18)


@pytest.mark.fast(3)
@pytest.mark.parametrize("weight", ["uniform", "section"])
@pytest.mark.parametrize("shape", RANDOM)
def test_slopes_to_random_dimensions_are_those_of_beams_made_anew(shape, weight):
    """Every dimension and modulus, through formulas of at most 32 operations, against fourth-order differences."""
    means, rest = RANDOM[shape]
    means, rest = dict(means), {**rest, "section": shape, "self_weight": weight}
    if weight == "section":
        means["density"] = 2700.0
    heavy = chain()
    laws = {name: Uniform(0.01 * value, mean=value) for name, value in means.items()}
    at = ErrorModel(heavy, Space(), [Beam(link="arm", **laws, **rest)]).at([0.2])
    assert set(at.space.components) == {f"beam[arm].{name}" for name in means}
    error, jacobian = at.tangent

    def anew(name: str, factor: float) -> np.ndarray:
        made = Beam(link="arm", **{**means, name: means[name] * factor}, **rest)
        return ErrorModel(heavy, Space(), [made]).at([0.2]).tangent[0]

    np.testing.assert_allclose(error, anew("E", 1.0), rtol=1e-13)
    for name, mean in means.items():
        h = 1e-3
        near, far = (anew(name, 1 + s) - anew(name, 1 - s) for s in (h, 2 * h))
        slope = (8 * near - far) / (12 * h * mean)
        column = at.space.index[f"beam[arm].{name}"]
        np.testing.assert_allclose(jacobian[:, column], slope, atol=1e-9 * np.abs(slope).max(), err_msg=name)
        assert np.abs(slope).max() > 0


def test_formulas_stay_below_the_limit_of_operations():
    d, t, w, h, modulus = (Component(name) for name in "dtwhE")
    index = {name: k for k, name in enumerate("dtwhE")}
    for section in (tube(d, t), rod(d), box(w, h, t)):
        parameters = [1.0 / (modulus * value) for value in (section.I_y, section.I_z, section.J, section.area)]
        assert all(len(Program.compile([parameter], index).operations) <= 16 for parameter in parameters)


# --- in a sheet ---


TEXT = """\
precision-pin: 1
robot: 4dof.urdf
tip: tool
poses:
  paper: -90 3 88 -91 deg
parameters:
  sheet: {uniform: 0.1 mm, mean: 2 mm}
sources:
  - payload: {at: tool, mass: {uniform: 0.1 kg, mean: 1 kg}}
  - beam: {link: link2, section: tube, outer_diameter: {normal: 0.3 mm, mean: 6 cm}, wall: sheet, material: aluminium,
      self_weight: section}
  - beam:
      link: link3
      section: box
      E: 210 GPa
      poisson_ratio: 0.3
      roll: 90 deg
      self_weight: centre
      segments:
        - {length: 0.5 m, width: 40 mm, height: 60 mm, wall: sheet}
        - {fraction: 25 %, section: general, area: 5 cm^2, I_y: 20 cm⁴, I_z: 3e5 mm^4, J: {fixed: 1e-7 m^4}}
        - {EI_y: 9 kN*m^2, EI_z: 8 kN*m^2, GI: {uniform: 50 N*m^2, mean: 4 kN*m^2}, EA: 10 MN}
"""


def load(folder: Path, text: str = TEXT) -> ErrorModel:
    (folder / "sheet.yaml").write_text(
        text.replace("4dof.urdf", str(PAPER_SHEET.with_name("4dof.urdf"))), encoding="utf-8"
    )
    return ErrorModel.load(folder / "sheet.yaml")


@pytest.mark.filterwarnings("ignore:.*W_SUPERPOSITION")
def test_the_sheet_is_the_same_as_python_and_every_engine_reads_it(tmp_path):
    model = load(tmp_path)
    assert model.space.components == (
        "sheet",
        "payload[tool].mass",
        "beam[link2].outer_diameter",
        "beam[link3].segments[1].J",
        "beam[link3].segments[2].GI",
    )
    segments = (
        Segment(length=0.5, width=0.04, height=0.06, wall="sheet"),
        Segment(fraction=0.25, section="general", area=5e-4, I_y=20e-8, I_z=3e-7, J=1e-7),
        Segment(EI_y=9000.0, EI_z=8000.0, GI=Uniform(50.0, mean=4000.0), EA=1e7),
    )
    tube = {"section": "tube", "outer_diameter": Normal(1e-4, mean=0.06), "wall": "sheet", "material": "aluminium"}
    box = {"section": "box", "E": 210e9, "poisson_ratio": 0.3, "roll": np.pi / 2, "segments": segments}
    sources = [
        Payload(at="tool", mass=Uniform(0.1, mean=1.0)),
        Beam(link="link2", self_weight="section", **tube),
        Beam(link="link3", self_weight="centre", **box),
    ]
    same = ErrorModel(model.chain, Space((Draw("sheet", Uniform(1e-4, mean=2e-3)),)), sources)
    x = model.space.sample(2, 0, 6)
    columns = [model.space.index[name] for name in same.space.components]
    error = same.at(model.poses["paper"]).exact(x[columns])
    np.testing.assert_allclose(model.at("paper").exact(x), error, rtol=1e-12)
    assert np.abs(error[:3]).max() > 1e-3
    check_engines(model)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("section: tube", "section: tub", 10, "input should be 'tube', 'rod', 'box' or 'general'"),
        ("wall: sheet, material", "wall: 3 GPa, material", 10, "'GPa' in '3 GPa' is not a unit of length"),
        ("210 GPa", "{disc: 1 GPa}", 15, "a law of several numbers must be named"),
        ("0.3\n", "30 deg\n", 16, "'deg' in '30 deg' is not a unit of ratio"),
        ("length: 0.5 m", "lenght: 0.5 m", 20, "unknown key 'lenght': did you mean 'length'"),
        ("length: 0.5 m", "length: 5 m", 12, "the beam's segments are 5.4425 m long in all, its link 1.77 m"),
        ("I_y: 20 cm⁴", "I_y: 20 cm³", 21, "'cm^3' in '20 cm³' is not a unit of second moment of area"),
        ("EA: 10 MN", "EA: lots", 22, "no parameter named 'lots'"),
        (TEXT.splitlines()[21].strip(" -"), "none", 22, "keys with"),
    ],
)
def test_mistakes_are_reported_in_one_line_where_they_stand(tmp_path, old, new, line, message):
    assert old in TEXT
    with pytest.raises(SheetError) as caught:
        load(tmp_path, TEXT.replace(old, new, 1))
    (finding,) = caught.value.findings
    assert message in finding.message
    assert "\n" not in str(finding)
    assert finding.line == line


def test_segments_that_are_no_list_and_the_schema_of_those_that_are(tmp_path):
    head, _, _ = TEXT.partition("segments:")
    with pytest.raises(SheetError, match="segments: expected a list"):
        load(tmp_path, head + "segments: {length: 1 m}\n")
    kinds = json_schema()["$defs"]
    assert {"length", "fraction", "section", "wall", "EI", "J"} <= set(kinds["Segment"]["properties"])
    assert kinds["Segment"]["additionalProperties"] is False
    assert kinds["beam"]["properties"]["segments"]["items"] == {"$ref": "#/$defs/Segment"}
