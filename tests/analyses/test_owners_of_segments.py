"""Owner of a random number in a part of a setting: the segments of a beam."""

from __future__ import annotations

import json
import sys

import pytest

import precision_pin as pp
from precision_pin.cli import main
from precision_pin.model.error_model import ErrorModel
from support.plain_robot import joint, link, robot

FEW = 1024
SHEET = """precision-pin: 1
robot: arm.urdf
poses: {flat: 0 deg}
parameters:
  stiff: {uniform: 800 N*m^2, mean: 8000 N*m^2}
  wall: {uniform: 0.1 mm, mean: 3 mm}
  idle: {uniform: 1 mm}
sources:
  - payload: {at: tool, mass: 3 kg}
  - beam: {link: arm, segments: [{fraction: 0.5, EI: stiff}, {EI: {uniform: 400 N*m^2, mean: 4000 N*m^2}}]}
  - beam: {link: base, section: tube, material: steel, segments: [{outer_diameter: 60 mm, wall: wall}]}
  - joint_offset: {joint: hinge, offset: {normal: 0.01 deg}}
"""
ARM = robot(
    link("base"), joint("hinge", "revolute", "base", "arm", (0.5, 0, 0), axis=(0, 1, 0)), link("arm"),
    joint("flange", "fixed", "arm", "tool", (1, 0, 0)), link("tool"),
)  # fmt: skip


@pytest.fixture
def sheet(tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    path = tmp_path / "arm.errors.yaml"
    path.write_text(SHEET)
    return path


def flat_variances() -> dict[str, float]:
    """Return each draw's part of the tip's variance by hand: w = 3 kg g (l²/EI integrals), z alone moves to first order."""
    force = 3 * 9.81
    near, far = (1 - 0.5**3) / 3, 0.5**3 / 3
    slopes = {"stiff": force * near / 8000**2 * 800, "beam[arm].segments[1].EI": force * far / 4000**2 * 400}
    return {name: slope**2 / 3 for name, slope in slopes.items()}


def test_a_parameter_named_in_a_segment_belongs_to_its_beam(sheet):
    model = ErrorModel.load(sheet)
    assert dict(zip((draw.name for draw in model.space.draws), model.owners, strict=True)) == {
        "stiff": ("beam[arm]",),
        "wall": ("beam[base]",),
        "idle": (),
        "beam[arm].segments[1].EI": ("beam[arm]",),
        "joint_offset[hinge].offset": ("joint_offset[hinge]",),
    }
    # what a parameter is, is read off the same places
    units = {draw.name: draw.quantities[0].si for draw in model.space.draws}
    assert units["stiff"] == units["beam[arm].segments[1].EI"] == "N*m^2"
    assert units["wall"] == "m"


def test_the_budget_gives_it_to_the_beam(sheet):
    found = pp.budget(ErrorModel.load(sheet), samples=FEW).poses[0]
    variance = sum(found.draw(name).share["position"] for name in ("stiff", "beam[arm].segments[1].EI"))
    shares = {line.sources: line.share["position"] for line in found.sources}
    assert shares[("beam[arm]",)] == pytest.approx(variance, rel=1e-12)
    expected = flat_variances()
    ratio = found.draw("stiff").share["position"] / found.draw("beam[arm].segments[1].EI").share["position"]
    assert ratio == pytest.approx(expected["stiff"] / expected["beam[arm].segments[1].EI"], rel=1e-9)


def test_the_command_gives_it_to_the_beam(sheet, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["precision-pin", "budget", str(sheet), "--samples", str(FEW), "--json", "-"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    out = capsys.readouterr().out
    (line,) = (entry for entry in json.loads(out)["poses"][0]["sources"] if entry["sources"] == ["beam[arm]"])
    assert line["draws"] == ["stiff", "beam[arm].segments[1].EI"]
