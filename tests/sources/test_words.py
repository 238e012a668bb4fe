"""Draws in a reader's words, with the tolerance as the sheet writes it."""

from __future__ import annotations

import pytest

import precision_pin as pp
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources import catalogue

SHEET = f"""precision-pin: 1
robot: {PAPER_SHEET.parent / "4dof.urdf"}
poses: {{home: 0 0 0 0 deg}}
parameters:
  a1: {{uniform: 0.05 mm}}
  a2: {{uniform: 0.02 mm}}
  k: {{normal: {{std: 10 arcsec}}}}
  t: {{normal: 0.01 deg}}
  t2: {{normal: 0.06 mm, k: 2}}
sources:
  - length: {{joint: joint2, parameters: a1}}
  - length: {{joint: joint4, parameters: [a2, a1, ±0.1 mm]}}
  - joint_offset: {{joint: joint1, offset: k}}
  - frame: {{joint: joint3, rz: ±0.02 deg, x: {{triangular: 4 um, mean: 2 um}}}}
  - axis_install: {{joint: joint1, radius: 0.1 mm, span: 100 mm}}
  - joint_offset: {{joint: joint2, offset: t}}
  - length: {{joint: joint3, parameters: t2}}
  - payload: {{at: tool, mass: 1 ± 0.05 kg}}
  - clearance: {{joint: joint2, diametral: 0.05 mm, span: 100 mm, direction: random}}
  - joint_offset: {{joint: joint4, offset: {{lognormal: {{std: 0.1 mrad}}, mean: 0.3 mrad}}}}
"""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> pp.ErrorModel:
    path = tmp_path_factory.mktemp("words") / "words.errors.yaml"
    path.write_text(SHEET, encoding="utf-8")
    return pp.ErrorModel.load(path)


def test_draws_are_named_as_a_reader_would(model: pp.ErrorModel) -> None:
    pairs = zip(model.space.draws, model.draw_words, strict=True)
    found = {draw.name: (words, draw.tolerance) for draw, words in pairs}
    assert found["a1"] == ("a1 (length to joint2 and 1 more)", "±0.05 mm")
    assert found["a2"] == ("a2 (length to joint4)", "±0.02 mm")
    assert found["length[joint4].parameters[2]"] == ("length to joint4 (3)", "±0.1 mm")
    assert found["k"] == ("k (zero of joint1)", "σ 10 arcsec")
    # a half-width of three standard deviations, or of as many as the sheet says
    assert found["t"] == ("t (zero of joint2)", "±0.01° (σ 0.0033°)")
    assert found["t2"] == ("t2 (length to joint3)", "±0.06 mm (σ 0.03 mm)")
    assert found["frame[joint3].rz"] == ("tilt of joint3 about z", "±0.02 deg")
    assert found["frame[joint3].x"] == ("position of joint3 along x", "±4 um")
    assert found["axis_install[joint1].A"] == ("axis of joint1, bearing A", "radius 0.1 mm")
    assert found["payload[tool].mass"] == ("payload mass at tool", "±0.05 kg")
    # what is drawn is a direction; the clearance itself is one number
    assert found["clearance[joint2].A"] == ("play in bearing A of joint2", "")
    assert found["joint_offset[joint4].offset"] == ("zero of joint4", "σ 0.1 mrad")


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_words_are_of_settings_that_there_are(name: str) -> None:
    kind = catalogue()[name]
    own = {"A", "B", "side", "phase", "quantisation", "row", "error"}
    assert set(kind.words) <= {*kind.__dataclass_fields__, *own}
    for text in kind.words.values():
        assert text.format(subject="joint1", at="tool") != ""
