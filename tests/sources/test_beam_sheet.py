"""Beams in a sheet: sections, materials and segments as text, in every engine; mistakes with their line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from precision_pin.base.errors import SheetError
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import json_schema
from precision_pin.sources.beam import Beam
from precision_pin.sources.payload import Payload
from precision_pin.sources.profiles import Segment

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


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "4dof.urdf").write_text((PAPER_SHEET.parent / "4dof.urdf").read_text(encoding="utf-8"))
    return tmp_path


def load(folder: Path, text: str = TEXT) -> ErrorModel:
    (folder / "sheet.yaml").write_text(text, encoding="utf-8")
    return ErrorModel.load(folder / "sheet.yaml")


def test_the_sheet_is_the_same_as_python(folder):
    model = load(folder)
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
    sources = [
        Payload(at="tool", mass=Uniform(0.1, mean=1.0)),
        Beam(
            link="link2",
            section="tube",
            outer_diameter=Normal(1e-4, mean=0.06),
            wall="sheet",
            material="aluminium",
            self_weight="section",
        ),
        Beam(
            link="link3",
            section="box",
            E=210e9,
            poisson_ratio=0.3,
            roll=np.pi / 2,
            self_weight="centre",
            segments=segments,
        ),
    ]
    same = ErrorModel(model.chain, Space((Draw("sheet", Uniform(1e-4, mean=2e-3)),)), sources)
    x = model.space.sample(2, 0, 6)
    columns = [model.space.index[name] for name in same.space.components]
    error = same.at(model.poses["paper"]).exact(x[columns])
    np.testing.assert_allclose(model.at("paper").exact(x), error, rtol=1e-12)
    assert np.abs(error[:3]).max() > 1e-3


@pytest.mark.parametrize("statics", ["nominal", "equilibrium"])
def test_every_engine_reads_it(folder, statics):
    at = load(folder, TEXT.replace("poses:", f"statics: {statics}\nposes:")).at("paper")
    layout = sampler.to_arrays(at)
    x = at.space.sample(5, 0, 200)
    for name, oracle in (("linear", at.linear), ("exact", at.exact)):
        np.testing.assert_allclose(sampler.errors_at(layout, name, x), oracle(x), rtol=1e-11, atol=1e-15)
    error, jacobian = at.tangent
    mean = at.space.mean[:, None]
    np.testing.assert_allclose(error, at.exact(mean)[:, 0], rtol=1e-14)
    step = 1e-5 * (x[:, :1] - mean)
    change = (at.exact(mean + step) - at.exact(mean - step))[:, 0] / 2
    np.testing.assert_allclose(jacobian @ step[:, 0], change, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("section: tube", "section: tub", 10, "input should be 'tube', 'rod', 'box' or 'general'"),
        ("aluminium", "aluminum", 10, "no material named 'aluminum'; did you mean 'aluminium'?"),
        ("6 cm", "60", 10, "'60' has no unit; a length needs one of"),
        ("wall: sheet, material", "wall: 3 GPa, material", 10, "'GPa' in '3 GPa' is not a unit of length"),
        ("wall: sheet, material", "wall: 31 mm, material", 10, "can become thicker than half its outer_diameter"),
        ("self_weight: section", "self_weight: none", 11, "input should be 'uniform', 'centre' or 'section'"),
        ("210 GPa", "{disc: 1 GPa}", 15, "a law of several numbers must be named"),
        ("0.3\n", "30 deg\n", 16, "'deg' in '30 deg' is not a unit of ratio"),
        ("length: 0.5 m", "lenght: 0.5 m", 20, "unknown key 'lenght': did you mean 'length'"),
        ("length: 0.5 m", "length: 5 m", 12, "the beam's segments are 5.4425 m long in all, its link 1.77 m"),
        ("fraction: 25 %", "fraction: 25 %, length: 1 m", 21, "a segment needs one of length: and fraction:"),
        ("I_y: 20 cm⁴", "I_y: 20 cm³", 21, "'cm^3' in '20 cm³' is not a unit of second moment of area"),
        ("area: 5 cm^2, ", "", 12, "the section general lacks area; it needs area, I_y, I_z, J"),
        ("EA: 10 MN", "EA: lots", 22, "no parameter named 'lots'"),
        (
            "{EI_y: 9 kN*m^2, EI_z: 8 kN*m^2, GI: {uniform: 50 N*m^2, mean: 4 kN*m^2}, EA: 10 MN}",
            "none",
            22,
            "keys with",
        ),
    ],
)
def test_mistakes_are_reported_in_one_line_where_they_stand(folder, old, new, line, message):
    assert old in TEXT
    with pytest.raises(SheetError) as caught:
        load(folder, TEXT.replace(old, new, 1))
    (finding,) = caught.value.findings
    assert message in finding.message
    assert "\n" not in str(finding)
    assert finding.line == line


def test_segments_that_are_no_list(folder):
    head, _, _ = TEXT.partition("segments:")
    with pytest.raises(SheetError, match="segments: expected a list"):
        load(folder, head + "segments: {length: 1 m}\n")


def test_the_schema_holds_the_segments_and_all_its_references_lead_somewhere():
    schema = json_schema()
    segment = schema["$defs"]["Segment"]
    assert {"length", "fraction", "section", "wall", "EI", "J"} <= set(segment["properties"])
    assert segment["additionalProperties"] is False
    assert schema["$defs"]["beam"]["properties"]["segments"]["items"] == {"$ref": "#/$defs/Segment"}
    assert schema["$defs"]["beam"]["properties"]["link"]["type"] == "string"

    def references(value):
        if isinstance(value, dict):
            yield from ([value["$ref"]] if isinstance(value.get("$ref"), str) else [])
            value = list(value.values())
        for entry in value if isinstance(value, list) else []:
            yield from references(entry)

    assert {reference.removeprefix("#/$defs/") for reference in references(schema)} <= set(schema["$defs"])
