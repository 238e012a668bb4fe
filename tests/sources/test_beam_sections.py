"""Beams from material and dimensions: section constants, and what random dimensions do."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Component, Program
from precision_pin.draws.laws import Fixed, Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources.beam import Beam
from precision_pin.sources.profiles import MATERIALS, Section, Segment, box, rod, tube
from support.checks.common import evaluated, one_link
from support.oracles import torsion_constant

GRAVITY = (3.0, -4.0, -8.0)


def chain():
    """One link along x that turns about z, 1.7 m long, with a weight off its end."""
    return one_link(length=1.7, gravity=GRAVITY, mass=3.0, com=(0.8, 0.1, 0.0)).with_payload(2.0, (0.1, 0.2, -0.3))


def end_displacement(**settings) -> np.ndarray:
    return next(iter(evaluated(chain(), [0.2], [Beam(link="arm", **settings)])[1].values()))


# --- constants ---


def test_tube_of_the_steel_tables():
    """CHS 60.3 x 3.2 in EN 10210-2: A 5.74 cm², I 23.5 cm⁴, I_t 46.9 cm⁴, 4.51 kg/m."""
    section = tube(60.3e-3, 3.2e-3)
    assert section.area * 1e4 == pytest.approx(5.74, abs=0.005)
    assert section.I_y * 1e8 == pytest.approx(23.5, abs=0.05)
    torsion = section.J * 1e8
    assert torsion == pytest.approx(46.9, abs=0.05)
    assert MATERIALS["steel"].density * section.area == pytest.approx(4.51, abs=0.005)


@pytest.mark.parametrize(("outer", "wall"), [(0.06, 0.002), (0.1, 0.05), (0.03, 1e-5)])
def test_tube_by_integrals_over_its_area(outer, wall):
    """Rings of radius r: A = ∫ 2πr dr, I = ∫ πr³ dr, J = ∫ 2πr³ dr; four Gauss points are exact."""
    nodes, weights = leggauss(4)
    r = outer / 2 - wall / 2 + wall / 2 * nodes
    area, second, polar = (wall / 2 * weights @ f for f in (2 * np.pi * r, np.pi * r**3, 2 * np.pi * r**3))
    section = tube(outer, wall)
    # the difference of two discs loses D/t digits
    tolerance = 4e-16 * outer / wall + 4e-16
    values = [section.area, section.I_y, section.I_z, section.J]
    np.testing.assert_allclose(values, [area, second, second, polar], rtol=tolerance)


def test_rod_is_a_tube_without_a_hole():
    one, other = rod(0.04), tube(0.04, 0.02)
    np.testing.assert_allclose(
        [one.area, one.I_y, one.I_z, one.J], [other.area, other.I_y, other.I_z, other.J], rtol=4e-16
    )
    assert one.I_y == pytest.approx(np.pi * 0.02**4 / 4, rel=4e-16)


def test_box_by_flanges_and_webs():
    """Two flanges (along z) and two webs with Steiner's terms; b along z, h along y."""
    b, h, t = 0.08, 0.12, 0.01
    flange, web = b * t, (h - 2 * t) * t
    i_z = 2 * (b * t**3 / 12 + flange * ((h - t) / 2) ** 2) + 2 * t * (h - 2 * t) ** 3 / 12
    i_y = 2 * t * b**3 / 12 + 2 * ((h - 2 * t) * t**3 / 12 + web * ((b - t) / 2) ** 2)
    section = box(b, h, t)
    values = [section.area, section.I_y, section.I_z]
    np.testing.assert_allclose(values, [2 * flange + 2 * web, i_y, i_z], rtol=2e-15)


@pytest.mark.parametrize(
    ("width", "height", "wall", "low"), [(1.0, 1.0, 0.1, 0.054), (1.0, 1.0, 0.05, 0.0243), (0.08, 0.12, 0.01, 0.055)]
)
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


SECTIONS = [
    ({"section": "tube", "outer_diameter": 0.06, "wall": 0.002}, tube(0.06, 0.002)),
    ({"section": "rod", "diameter": 0.04}, rod(0.04)),
    ({"section": "box", "width": 0.04, "height": 0.06, "wall": 0.003}, box(0.04, 0.06, 0.003)),
    ({"section": "general", "area": 1e-4, "I_y": 3e-9, "I_z": 8e-9, "J": 5e-9}, Section(1e-4, 3e-9, 8e-9, 5e-9)),
]


@pytest.mark.parametrize(("settings", "section"), SECTIONS, ids=lambda value: str(getattr(value, "area", "")))
@pytest.mark.parametrize(
    ("material", "modulus", "shear"),
    [
        ({"material": "aluminium"}, 70e9, 27e9),
        ({"material": "steel", "E": 200e9}, 200e9, 81e9),
        ({"material": "steel", "G": 79e9}, 210e9, 79e9),
        ({"E": 7e10, "poisson_ratio": 0.25}, 7e10, 2.8e10),
        ({"material": "titanium", "poisson_ratio": 0.0}, 113.8e9, 56.9e9),
        ({"E": 7e10, "G": 2e10}, 7e10, 2e10),
    ],
)
def test_a_section_is_the_rigidities_it_stands_for(settings, section, material, modulus, shear):
    plain = {"EI_y": modulus * section.I_y, "EI_z": modulus * section.I_z, "GI": shear * section.J}
    expected = end_displacement(**plain, EA=modulus * section.area)
    np.testing.assert_allclose(end_displacement(**settings, **material), expected, rtol=1e-14, atol=1e-18)


def test_width_lies_along_the_joints_axis_and_height_across():
    """A flat bar on its edge: bending about z, the joint's axis, is the stiff way."""
    heavy = one_link(length=1.0, gravity=(0.0, -9.81, 0.0)).with_payload(1.0)
    beam = Beam(link="arm", section="box", width=0.02, height=0.08, wall=0.002, material="steel")
    (moved,) = evaluated(heavy, [0.0], [beam])[1].values()
    second = (0.02 * 0.08**3 - 0.016 * 0.076**3) / 12
    assert moved[1] == pytest.approx(-9.81 / (3 * 210e9 * second), rel=1e-13)


@pytest.mark.parametrize("roll", [0.0, np.pi / 2, 0.5, -2.0])
def test_roll_turns_the_section(roll):
    """In beam axes that are turned by roll, a unit force along either principal axis bends along it alone."""
    i_y, i_z = 3e-9, 8e-9
    beam = Beam(link="arm", section="general", area=1e-4, I_y=i_y, I_z=i_z, J=5e-9, E=7e10, G=2.6e10, roll=roll)
    for axis, second in (((0, np.cos(roll), np.sin(roll)), i_z), ((0, -np.sin(roll), np.cos(roll)), i_y)):
        pulled = one_link(length=1.3, gravity=tuple(9.81 * np.array(axis))).with_payload(2.0)
        (moved,) = evaluated(pulled, [0.0], [beam])[1].values()
        deflection = 2 * 9.81 * 1.3**3 / (3 * 7e10 * second)
        np.testing.assert_allclose(moved[:3], deflection * np.array(axis), rtol=1e-13, atol=1e-16)


def test_axial_stiffness_at_the_end_is_force_over_metre():
    pulled = one_link(length=1.3, gravity=(9.81, 0.0, 0.0)).with_payload(2.0)
    (moved,) = evaluated(pulled, [0.0], [Beam(link="arm", axial_stiffness=5e5)])[1].values()
    np.testing.assert_allclose(moved, [2 * 9.81 / 5e5, 0, 0, 0, 0, 0], rtol=1e-14, atol=1e-18)


# --- random dimensions ---


RANDOM = {
    "tube": ({"outer_diameter": 0.06, "wall": 0.002, "E": 7e10, "G": 2.7e10}, {}),
    "rod": ({"diameter": 0.04, "E": 7e10}, {"poisson_ratio": 0.3}),
    "box": ({"width": 0.04, "height": 0.06, "wall": 0.003, "E": 7e10, "G": 2.7e10}, {}),
    "general": ({"area": 1e-4, "I_y": 3e-9, "I_z": 8e-9, "J": 5e-9, "E": 7e10, "G": 2.6e10}, {}),
}


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


def test_samples_of_random_dimensions_are_beams_of_those_dimensions():
    heavy = chain()
    beam = Beam(
        link="arm",
        section="tube",
        outer_diameter=Normal(1e-4, mean=0.06),
        wall=Uniform(2e-4, mean=0.002),
        material="aluminium",
        self_weight="section",
    )
    at = ErrorModel(heavy, Space(), [beam]).at([0.2])
    x = at.space.sample(4, 0, 5)
    for (diameter, wall), error in zip(x.T, at.exact(x).T, strict=True):
        made = Beam(
            link="arm", section="tube", outer_diameter=diameter, wall=wall, material="aluminium", self_weight="section"
        )
        fixed = ErrorModel(heavy, Space(), [made]).at([0.2]).exact(np.zeros((0, 1)))[:, 0]
        np.testing.assert_allclose(error, fixed, rtol=1e-11)


def test_formulas_stay_below_the_limit_of_operations():
    d, t, w, h, modulus = (Component(name) for name in "dtwhE")
    index = {name: k for k, name in enumerate("dtwhE")}
    for section in (tube(d, t), rod(d), box(w, h, t)):
        parameters = [1.0 / (modulus * value) for value in (section.I_y, section.I_z, section.J, section.area)]
        assert all(len(Program.compile([parameter], index).operations) <= 16 for parameter in parameters)


def test_a_wall_shared_by_name_is_one_number():
    draws = [Draw("wall", Uniform(1e-4, mean=0.002))]
    beams = [Beam(link="arm", section="tube", outer_diameter=0.06, wall="wall", material="steel")]
    at, _ = evaluated(chain(), [0.2], beams, draws=draws)
    assert at.space.components == ("wall",)


# --- what is refused ---

TUBE = {"section": "tube", "outer_diameter": 0.06, "wall": 0.002, "material": "steel"}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (TUBE | {"section": "pipe"}, "no section named 'pipe'"),
        (TUBE | {"material": "stel"}, "no material named 'stel'; did you mean 'steel'"),
        (TUBE | {"wall": None}, "section tube lacks wall; it needs outer_diameter, wall"),
        (TUBE | {"diameter": 0.06}, "section tube has no diameter"),
        (TUBE | {"material": None}, "needs material:, one of steel,"),
        (TUBE | {"material": None, "E": 7e10}, "E: with G: or poisson_ratio:"),
        (TUBE | {"G": 8e10, "poisson_ratio": 0.3}, "one of G: and poisson_ratio:"),
        (TUBE | {"poisson_ratio": 0.6}, "must lie above -1, up to 0.5, got 0.6"),
        (TUBE | {"poisson_ratio": float("nan")}, "must lie above -1"),
        (TUBE | {"EI": 100.0}, "either section: or rigidities, not EI:"),
        (TUBE | {"bending_stiffness": 100.0}, "either section: or segments:, or bending_stiffness:"),
        (TUBE | {"wall": 0.0}, "wall of a beam must be positive, got 0.0"),
        (TUBE | {"outer_diameter": -0.06}, "outer_diameter of a beam must be positive"),
        (TUBE | {"E": float("inf")}, "E of a beam must be positive, got inf"),
        (TUBE | {"density": 7000.0}, "density: is used only with self_weight: section"),
        (TUBE | {"self_weight": "none"}, "no self_weight named 'none'"),
        ({"EI": 1.0, "wall": 0.002}, "wall need section:, one of tube, rod, box, general"),
        ({"EI": 1.0, "material": "steel"}, "material need section:"),
        ({"EI": 1.0, "self_weight": "section"}, "self_weight: section needs section: with density: or material:"),
        ({"EA": 1.0, "axial_stiffness": 1.0}, "one of EA: and axial_stiffness:"),
        ({"axial_stiffness": 0.0}, "axial_stiffness of a beam must be positive"),
        ({"segments": (Segment(),)}, r"segments\[0\] needs a stiffness"),
    ],
)
def test_settings_that_make_no_beam_are_refused_in_one_line(settings, message):
    with pytest.raises(InputError, match=message) as caught:
        Beam(link="arm", **settings)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, UnknownNameError) == ("named" in message)


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        (TUBE | {"wall": Uniform(0.001, mean=0.0295)}, "outer_diameter"),
        (TUBE | {"outer_diameter": Normal(0.0067, mean=0.06)}, "outer_diameter"),
        (TUBE | {"wall": 0.0301}, "outer_diameter"),
        (
            {"section": "box", "width": 0.05, "height": 0.03, "wall": Fixed(0.016), "material": "steel"},
            "height",
        ),
    ],
)
def test_a_wall_that_can_become_thicker_than_half_the_section_is_refused(settings, field):
    with pytest.raises(InputError, match=rf"wall of beam\[arm\] can become thicker than half its {field}"):
        end_displacement(**settings)


def test_a_dimension_that_can_become_negative_is_refused():
    with pytest.raises(InputError, match=r"wall of beam\[arm\] can become zero or negative"):
        end_displacement(**(TUBE | {"wall": Normal(0.001, mean=0.002)}))
