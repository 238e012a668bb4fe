"""Pieces of the report by themselves: laws in words, quantities, intervals, markup, colours."""

from __future__ import annotations

import importlib.resources
import itertools
import re

import numpy as np
import pytest

from outputs.report_cases import Reader, paper
from precision_pin.analyses.collect import bracketed
from precision_pin.base import units
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import (
    Arcsine,
    Circle,
    Disc,
    Empirical,
    Fixed,
    JointNormal,
    Lognormal,
    Normal,
    Rows,
    Triangular,
    TruncatedNormal,
    TwoPoint,
    Uniform,
)
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.report.sections import without_folders
from precision_pin.render.html import Html, element, table
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.axis_install import AxisInstall
from precision_pin.sources.beam import Beam
from precision_pin.sources.clearance import Clearance
from precision_pin.sources.covariance import Covariance
from precision_pin.sources.encoder import Encoder
from precision_pin.sources.frame import Frame
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.length import Length
from precision_pin.sources.profiles import Segment
from precision_pin.statistics import SpecificationResult, format_share
from support.sheets import seven_joint_arm

LAWS = (
    (Fixed(2e-3), units.LENGTH, "fixed at 2 mm"),
    (Uniform(5e-5), units.LENGTH, "uniform within ±0.05 mm"),
    (Uniform(1e-6, mean=2e-5), units.LENGTH, "uniform within ±0.001 mm about 0.02 mm"),
    (Triangular(1e-4, mean=0.5), units.LENGTH, "triangular within ±0.1 mm about 500 mm"),
    (Arcsine(2e-3), units.ANGLE, "arcsine (a sine wave at a random phase) within ±2 mrad"),
    (Normal(3e-4), units.ANGLE, "normal, standard deviation 0.3 mrad"),
    (Normal(2e-5, mean=-1e-3), units.ANGLE, "normal, standard deviation 20 µrad, mean -1 mrad"),
    (Normal(0.02, mean=1.0), units.MASS, "normal, standard deviation 0.02 kg, mean 1 kg"),
    (TruncatedNormal(1e-3, k=2.0), units.LENGTH, "normal, standard deviation 1 mm, cut off at ±2 mm"),
    (Lognormal(1e3, mean=1e4), units.ANGULAR_STIFFNESS, "lognormal, mean 10000 N·m/rad, standard deviation 1000 N·m/rad"),
    (TwoPoint(1e-4, probability=0.25), units.LENGTH, "-0.1 mm or 0.1 mm, the latter with probability 25 %"),
    (
        Empirical(((0.0, 0.0), (1.0, 6e-3))), units.LENGTH,
        "measured: 2 quantiles from 0 mm to 6 mm, mean 3 mm, standard deviation 1.73205 mm",
    ),
    (Uniform(2.0), None, "uniform within ±2 SI"),
    (Uniform(5.0, mean=5.0), units.TEMPERATURE_DIFFERENCE, "uniform within ±5 K about 5 K"),
    (Normal(1e-6, mean=23e-6), units.THERMAL_EXPANSION, "normal, standard deviation 1 ppm/K, mean 23 ppm/K"),
    (Uniform(1e9, mean=7e10), units.PRESSURE, "uniform within ±1 GPa about 70 GPa"),
)  # fmt: skip


@pytest.mark.parametrize(("law", "quantity", "words"), LAWS, ids=[words for _, _, words in LAWS])
def test_laws_in_words(law, quantity, words):
    assert law.describe([quantity]) == words


def test_laws_of_several_numbers_in_words():
    two = [units.LENGTH, units.LENGTH]
    mixed = [units.LENGTH, units.ANGLE]
    assert Disc(1e-4).describe(two) == "a point uniform over a disc of radius 0.1 mm"
    assert Circle(1.0).describe([units.RATIO] * 2) == "a point uniform on a circle of radius 1"
    joint = JointNormal(((4e-8, 3e-8), (3e-8, 9e-8)))
    assert joint.describe(mixed) == (
        "2 numbers jointly normal, standard deviations 0 0.2 mm, 1 0.3 mrad, correlations up to 0.5"
    )
    rows = Rows(((0.0, 0.0), (2e-3, 4e-3)), ("x", "rx"))
    assert rows.describe(mixed) == (
        "2 measured rows, all equally likely, standard deviations x 1 mm, rx 2 mrad"
    )  # fmt: skip


def known_quantities(model: ErrorModel) -> dict[str, units.Quantity]:
    return {
        name: quantity
        for draw in model.space.draws
        for name, quantity in zip(draw.components, draw.quantities, strict=bool(draw.quantities))
        if quantity is not None
    }


def test_quantities_are_read_off_the_settings():
    chain = seven_joint_arm()
    turning, sliding = (
        next(j for j in chain.joints if (j.kind == "prismatic") is slides).name for slides in (False, True)
    )
    link = chain.joints[1].child
    model = ErrorModel(
        chain,
        Space((Draw("shared", Uniform(1e-4)), Draw("lonely", Uniform(1.0)))),
        [
            Length(joint=turning, parameters=("shared", Uniform(1e-4))),
            Frame(joint=turning, x=Uniform(1e-4), rz=Draw("", Normal(1e-4))),
            JointCompliance(joint=turning, compliance=Uniform(1e-6, mean=1e-5)),
            JointCompliance(joint=sliding, compliance=Uniform(1e-8, mean=1e-7)),
            AxisInstall(joint=turning, radius=1e-4, span=0.1),
            Encoder(joint=turning, resolution=1e-4, amplitude=Normal(1e-5)),
            Encoder(joint=sliding, resolution=1e-6),
            Covariance(joint=turning, std=(1e-4,) * 3 + (1e-3,) * 3),
            Clearance(joint=turning, diametral=(1e-5,), span=0.1, direction="random"),
            Beam(link=link, segments=(Segment(EI=Uniform(10.0, mean=1e4), fraction=0.5), Segment(EI=1e4))),
        ],
    )
    known = known_quantities(model)
    expected = {
        "shared": units.LENGTH,
        f"length[{turning}].parameters[1]": units.LENGTH,
        f"frame[{turning}].x": units.LENGTH,
        f"frame[{turning}].rz": units.ANGLE,
        f"joint_compliance[{turning}].compliance": units.ANGULAR_COMPLIANCE,
        f"joint_compliance[{sliding}].compliance": units.LINEAR_COMPLIANCE,
        f"axis_install[{turning}].A.x": units.LENGTH,
        f"encoder[{turning}].quantisation": units.ANGLE,
        f"encoder[{turning}].amplitude": units.ANGLE,
        f"encoder[{turning}].phase.x": units.RATIO,
        f"encoder[{sliding}].quantisation": units.LENGTH,
        f"covariance[{turning}].error.2": units.LENGTH,
        f"covariance[{turning}].error.3": units.ANGLE,
        f"clearance[{turning}].A.y": units.RATIO,
        f"beam[{link}].segments[0].EI": units.BENDING_RIGIDITY,
    }
    for name, quantity in expected.items():
        assert known[name] is quantity, name
    assert set(model.space.components) - set(known) == {"lonely"}


def test_intervals_are_rounded_outwards():
    assert bracketed(1.23456e-3, 1.24e-3) == "[1.2345, 1.2400]"
    assert bracketed(-1.2345e-3, 9.9991e-3) == "[-2, 10]"
    assert bracketed(0.0, 0.0) == "[0, 0]"
    assert bracketed(2e-3, 2e-3).count("2.0000") == 2
    generator = np.random.default_rng(8)
    for low, width in zip(generator.normal(size=200), 10.0 ** generator.uniform(-9, 1, size=200), strict=True):
        below, above = (float(end) / 1e3 for end in bracketed(low, low + width)[1:-1].split(", "))
        assert low - 0.11 * width <= below <= low * (1 + 1e-15 * np.sign(low))
        assert above >= (low + width) * (1 - 1e-15 * np.sign(low + width))
        assert above <= low + 1.11 * width


def test_a_share_that_just_misses_is_not_printed_as_what_is_required():
    result = SpecificationResult("position.norm", 1e-3, 0.9973, 0.99729, (0.997299, 0.99740))
    assert format_share(result.probability, result.interval, result.required) == ("99.729", "99.729", "99.740")
    low = float(format_share(result.probability, result.interval, result.required)[1])
    assert low < 99.73


def test_text_is_never_markup():
    assert element("p", "<b>", Html("<i></i>"), class_='"x"').text == '<p class="&quot;x&quot;">&lt;b&gt;<i></i></p>'
    assert element("td", "a\x00b").text == "<td>a\N{REPLACEMENT CHARACTER}b</td>"
    made = Reader(table("<c>", ["<h>", "n"], [["<r>", "<d>"]]).text).tables[0]
    assert (made.caption, made.rows) == ("<c>", [["<h>", "n"], ["<r>", "<d>"]])


@pytest.mark.slow
def test_files_are_named_without_their_folders():
    results, _ = paper()
    folder = PAPER_SHEET.parent
    for text, expected in (
        (f"{folder}/4dof.urdf:3: warning W_X: what", "4dof.urdf:3: warning W_X: what"),
        ("mesh '/some/where/else/hand.dae' is not found", "mesh 'hand.dae' is not found"),
        (
            "a compliance in rad/(N*m), package://pkg/meshes/a.dae",
            "a compliance in rad/(N*m), package://pkg/meshes/a.dae",
        ),
        ("x/y m/s^2", "x/y m/s^2"),
    ):
        assert without_folders(text, results) == expected


# colours -------------------------------------------------------------------------------------------------------------

TEXT_ON = {
    "ink": ("paper", "panel"),
    "muted": ("paper", "panel"),
    "link": ("paper",),
    "good": ("paper", "good-paper"),
    "bad": ("paper", "bad-paper"),
}


def schemes() -> dict[str, dict[str, str]]:
    """Return the colours of the page's style by scheme."""
    css = importlib.resources.files("precision_pin.pages.report").joinpath("style.css").read_text("utf-8")
    blocks = re.findall(r":root \{(.*?)\}", css, re.DOTALL)
    found = [dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", block)) for block in blocks]
    return dict(zip(("light", "dark", "print"), found, strict=True))


def luminance(colour: str) -> float:
    """Return the relative luminance of WCAG 2.2."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(first: str, second: str) -> float:
    high, low = sorted((luminance(first), luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_contrast_is_computed_as_wcag_has_it():
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.005)


@pytest.mark.parametrize("scheme", ["light", "dark", "print"])
def test_text_stands_out_from_its_ground(scheme):
    colours = schemes()[scheme]
    for text, grounds in TEXT_ON.items():
        for ground in grounds:
            assert contrast(colours[text], colours[ground]) >= 4.5, (text, ground)


def test_every_scheme_has_every_colour():
    keys = [set(colours) for colours in schemes().values()]
    assert all(first == second for first, second in itertools.pairwise(keys))
    dark = schemes()["dark"]
    for name in ("blue", "sky", "vermilion", "green", "purple"):
        assert contrast(dark[name], dark["paper"]) >= 3
