"""Changes of a sheet's values by path: against the sheet edited by hand; wrong paths and values in one line."""

from __future__ import annotations

import re

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.draws.laws import Fixed
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet.changes import parse_value
from support.plain_robot import joint, link, robot

PAPER = pp.ErrorModel.load(PAPER_SHEET)
URDF = robot(
    link("base"), link("half.1"), link("tool"),
    joint("a.b", "revolute", "base", "half.1"),
    joint("flange", "fixed", "half.1", "tool", (0.5, 0, 0)),
)  # fmt: skip
DATA = {
    "precision-pin": 1,
    "robot": "arm.urdf",
    "poses": {"home": ["0 deg"]},
    "parameters": {"play.1": "±0.1 mm", "play": {"normal": "0.2 mm"}},
    "sources": [
        {"joint_offset": {"joint": "a.b", "offset": {"normal": "0.3 mrad"}}},
        {"frame": {"frame": "tool", "x": "play.1", "y": "play", "rz": {"uniform": "1 mrad"}}},
    ],
}


@pytest.fixture
def model(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    return pp.ErrorModel.from_dict(DATA, tmp_path)


@pytest.mark.fast(3)
@pytest.mark.parametrize(
    ("path", "value", "before", "after"),
    [
        ("axis_install[*].radius", "0.02 mm", "radius: 0.1 mm", "radius: 0.02 mm"),
        ("payload.mass", "3 kg", "mass: 1 kg", "mass: 3 kg"),
        ("parameters.a2", "±0.5 mm", "a2: {uniform: 0.25 mm}", "a2: {uniform: 0.5 mm}"),
        ("parameters.*.uniform", "0.07 mm", "{uniform: 0.05 mm}", "{uniform: 0.07 mm}"),
        ("length[tool].parameters[2]", "a1", "[a1, a3, a5]", "[a1, a3, a1]"),
        ("beam[link2].EI", {"uniform": "10 N*m^2", "mean": "7000 N*m^2"}, "link2, EI: 8000 N*m^2",
         "link2, EI: {uniform: 10 N*m^2, mean: 7000 N*m^2}"),
        ("statics", "equilibrium", "statics: nominal", "statics: equilibrium"),
    ],
)  # fmt: skip
def test_a_change_is_the_sheet_edited_by_hand(tmp_path, path, value, before, after):
    text = PAPER_SHEET.read_text()
    if path == "parameters.*.uniform":
        text = text.replace("0.25 mm", "0.05 mm")
    assert before in text
    (tmp_path / "4dof.urdf").write_text((PAPER_SHEET.parent / "4dof.urdf").read_text())
    sheet, plain = tmp_path / "edited.yaml", tmp_path / "plain.yaml"
    sheet.write_text(text.replace(before, after))
    plain.write_text(text)
    model = pp.ErrorModel.load(plain)
    edited, changed = pp.ErrorModel.load(sheet), model.with_({path: value})
    assert changed.labels == edited.labels
    assert changed.statics == edited.statics
    assert changed.space.draws == edited.space.draws
    for one, other in zip(changed.sources, edited.sources, strict=True):
        assert one == other
    assert (changed.sources, changed.space.draws, changed.statics) != (model.sources, model.space.draws, model.statics)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*W_TAKEN_AS_EXACT")
def test_the_same_seed_gives_the_same_robots_but_for_the_change():
    # halving radius and laws of one joint's axis halves what its draws do; all other draws stay: e = rest + J x
    changed = PAPER.with_({"axis_install[joint1].radius": "0.05 mm"})
    without = PAPER.with_({"axis_install[joint1].radius": "0 mm"})
    settings = {"samples": 500, "seed": 9, "model": "linear", "keep_samples": True}
    full, half, none = (pp.monte_carlo(of, **settings).errors for of in (PAPER, changed, without))
    assert np.allclose(half, (full + none) / 2, rtol=0, atol=1e-15)


def test_a_dictionary_is_the_sheet(tmp_path, model):
    lines = (
        "precision-pin: 1", "robot: arm.urdf", "poses: {home: [0 deg]}", "parameters:", "  play.1: ±0.1 mm",
        "  play: {normal: 0.2 mm}", "sources:", "  - joint_offset: {joint: a.b, offset: {normal: 0.3 mrad}}",
        "  - frame: {frame: tool, x: play.1, y: play, rz: {uniform: 1 mrad}}",
    )  # fmt: skip
    (tmp_path / "sheet.yaml").write_text("\n".join(lines))
    loaded = pp.ErrorModel.load(tmp_path / "sheet.yaml")
    assert loaded.space.draws == model.space.draws
    assert loaded.sources == model.sources


def test_names_with_dots_and_laws_of_settings(model):
    changed = model.with_({"parameters.play.1": "±0.3 mm", "joint_offset[a.b].offset.normal": "0.5 mrad"})
    assert changed.space.draws[0].law.half_width == pytest.approx(3e-4)
    assert changed.space.draws[1] == model.space.draws[1]
    assert changed.sources[0].offset.law.std == pytest.approx(5e-4 / 3)
    several = model.with_({"*[*].offset": "±2 mrad"})
    assert several.sources[0].offset.law.half_width == pytest.approx(2e-3)
    assert several.sources[1] == model.sources[1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axis_instal[*].radius": "1 mm"}, "no source named 'axis_instal[*]'; did you mean 'axis_install"),
        ({"axis_install[*].raduis": "1 mm"}, "unknown key 'raduis': did you mean 'radius'"),
        ({"axis_install.radius": "1 mm"}, "4 sources are a axis_install: axis_install[joint1], "),
        ({"axis_install[joint1].radius": "1 kg"}, "'kg' in '1 kg' is not a unit of length"),
        ({"axis_install[joint1].radius": 5}, "'5' has no unit"),
        ({"axis_install[joint1].radius.uniform": "1 mm"}, "radius is '0.1 mm', which has no 'uniform'"),
        (
            {"axis_install[joint1]": "1 mm"},
            "has 2 numbers; name one: axis_install[joint1].radius, axis_install[joint1].span",
        ),
        ({"beam[link2]": "1 N*m^2"}, "has 2 numbers; name one: beam[link2].EI, beam[link2].GI"),
        ({"parameters.a9": "±1 mm"}, "no key named 'a9'"),
        ({"parameters": "±1 mm"}, "parameters holds several values; name one: parameters.a0, parameters.a1, "),
        ({"a1": "±1 mm"}, "a1 is a parameter: its path is parameters.a1"),
        ({"length[*].parameters[7]": "a1"}, "parameters has 2 entries, counted from 0; there is no 7"),
        ({"gravit": "moon"}, "no source named 'gravit'; did you mean 'gravity'?"),
        ({"statics": "funny"}, "input should be 'nominal' or 'equilibrium'"),
        ({"payload.mass": object()}, "text, a number, a list or a mapping is expected"),
        ({"payload.mass": {1: "2 kg"}}, "a key must be text"),
    ],
)
def test_wrong_changes_are_one_line_that_names_the_path(changes, message):
    with pytest.raises(InputError) as refused:
        PAPER.with_(changes)
    line = str(refused.value)
    assert "\n" not in line
    assert next(iter(changes)) in line
    assert message in line


@pytest.mark.slow
def test_the_path_of_a_source_is_that_of_its_only_number(model):
    for path in ("joint_offset[a.b]", "joint_offset", "joint_offset[*]", "*[a.b]"):
        changed = model.with_({path: "±2 mrad"})
        assert changed.sources == model.with_({"joint_offset[a.b].offset": "±2 mrad"}).sources
        # what the first change made of it does not matter
        again = changed.with_({path: "0 deg"}).with_({path: "±2 mrad"})
        assert again.sources == changed.sources
    # of several numbers, the only one with a law where no other has its unit
    compliances = PAPER.with_({"joint_compliance[*]": "2e-5 rad/(N*m)"})
    assert compliances.sources == PAPER.with_({"joint_compliance[*].compliance": "2e-5 rad/(N*m)"}).sources
    heavy = PAPER.with_({"payload.mass": "1 ± 0.1 kg"})
    assert heavy.with_({"payload": "3 kg"}).sources == PAPER.with_({"payload.mass": "3 kg"}).sources
    soft = PAPER.with_({"beam[link2].EI": {"uniform": "10 N*m^2", "mean": "7000 N*m^2"}})
    with pytest.raises(InputError, match=r"name one: beam\[link2\].EI, beam\[link2\].GI"):
        soft.with_({"beam[link2]": "7000 N*m^2"})


@pytest.mark.filterwarnings("ignore:.*W_TAKEN_AS_EXACT")
def test_a_number_for_a_parameter_is_refused_with_both_spellings_that_work():
    with pytest.raises(InputError) as refused:
        PAPER.with_({"parameters.a1": "0.07 mm"})
    assert str(refused.value).count("\n") == 0
    named = [one.split("=", 1) for one in re.findall(r"'([^']*=[^']*)'", str(refused.value))]
    uniform, fixed = (PAPER.with_({path: parse_value(value, "")}).space.draws[1].law for path, value in named)
    assert (uniform.half_width, uniform.mean) == (pytest.approx(7e-5), 0)
    assert isinstance(fixed, Fixed)
    assert fixed.mean == pytest.approx(7e-5)


def test_a_model_without_a_sheet_cannot_be_changed():
    made = pp.ErrorModel(PAPER.chain, PAPER.space, PAPER.sources)
    with pytest.raises(InputError, match="was not read from a sheet or a dictionary"):
        made.with_({"payload.mass": "2 kg"})


def test_a_wrong_dictionary_is_named_by_its_path(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    sources = [{"joint_offset": {"joint": "a.b", "offset": {"normal": "0.3 kg"}}}]
    with pytest.raises(InputError, match=r"sources\.0\.joint_offset\.offset.*'kg' in '0.3 kg' is not a unit of angle"):
        pp.ErrorModel.from_dict(DATA | {"sources": sources}, tmp_path)
    with pytest.raises(InputError, match="the sheet must be a dictionary with names as keys"):
        pp.ErrorModel.from_dict([], tmp_path)
