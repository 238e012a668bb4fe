"""Changes of a sheet's values by path, and where its numbers come from: against edits by hand and hand-computed shares."""

import json
import re
import shutil

import numpy as np
import pytest

import precision_pin as pp
from cli.conftest import GANTRY, LONG
from precision_pin.base.errors import InputError, PrecisionPinWarning, SheetError
from precision_pin.draws.laws import Fixed
from precision_pin.model.pose_model import origin_shares
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


def test_a_change_is_the_sheet_edited_by_hand(tmp_path):
    shutil.copy(PAPER_SHEET.with_name("4dof.urdf"), tmp_path)
    text, sheet = PAPER_SHEET.read_text(), tmp_path / "edited.yaml"
    law = {"uniform": "10 N*m^2", "mean": "7000 N*m^2"}
    for path, value, before, after in (
        ("axis_install[*].radius", "0.02 mm", "radius: 0.1 mm", "radius: 0.02 mm"),
        ("parameters.a2", "±0.5 mm", "a2: {uniform: 0.25 mm}", "a2: {uniform: 0.5 mm}"),
        ("parameters.*.uniform", "0.07 mm", r"{uniform: 0.\d* mm}", "{uniform: 0.07 mm}"),
        ("length[tool].parameters[2]", "a1", r"\[a1, a3, a5\]", "[a1, a3, a1]"),
        ("beam[link2].EI", law, r"link2, EI: 8000 N\*m\^2", "link2, EI: {uniform: 10 N*m^2, mean: 7000 N*m^2}"),
        ("statics", "equilibrium", "statics: nominal", "statics: equilibrium"),
    ):
        sheet.write_text(re.sub(before, after, text))
        edited, changed = pp.ErrorModel.load(sheet), PAPER.with_({path: value})
        parts, same, plain = ((of.sources, of.space.draws, of.statics, of.labels) for of in (changed, edited, PAPER))
        assert parts == same
        assert parts != plain


def test_the_same_seed_gives_the_same_robots_but_for_the_change():
    # halving radius and laws of one joint's axis halves what its draws do; all other draws stay: e = rest + J x
    full, half, none = (
        of.at().linear(of.space.sample(9, 0, 50))
        for of in (PAPER, *(PAPER.with_({"axis_install[joint1].radius": to}) for to in ("0.05 mm", "0 mm")))
    )
    assert np.allclose(half, (full + none) / 2, rtol=0, atol=1e-15)
    assert not np.allclose(half, full, rtol=0, atol=1e-9)


def test_a_dictionary_is_the_sheet(tmp_path, model):
    (tmp_path / "sheet.yaml").write_text(json.dumps(DATA, ensure_ascii=False))
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


def test_wrong_changes_are_one_line_that_names_the_path():
    for path, value, message in (
        ("axis_instal[*].radius", "1 mm", "no source named 'axis_instal[*]'; did you mean 'axis_install"),
        ("axis_install[*].raduis", "1 mm", "unknown key 'raduis': did you mean 'radius'"),
        ("axis_install.radius", "1 mm", "4 sources are a axis_install: axis_install[joint1], "),
        ("axis_install[joint1].radius.uniform", "1 mm", "radius is '0.1 mm', which has no 'uniform'"),
        ("axis_install[joint1]", "1 mm", "has 2 numbers; name one: axis_install[joint1].radius, axis_"),
        ("parameters.a9", "±1 mm", "no key named 'a9'"),
        ("parameters", "±1 mm", "parameters holds several values; name one: parameters.a0, parameters.a1, "),
        ("a1", "±1 mm", "a1 is a parameter: its path is parameters.a1"),
        ("length[*].parameters[7]", "a1", "parameters has 2 entries, counted from 0; there is no 7"),
        ("gravit", "moon", "no source named 'gravit'; did you mean 'gravity'?"),
        ("statics", "funny", "input should be 'nominal' or 'equilibrium'"),
        ("payload.mass", object(), "text, a number, a list or a mapping is expected"),
        ("payload.mass", {1: "2 kg"}, "a key must be text"),
    ):
        with pytest.raises(InputError) as refused:
            PAPER.with_({path: value})
        line = str(refused.value)
        assert "\n" not in line
        assert path in line
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


def test_a_model_without_a_sheet_cannot_be_changed_and_a_wrong_dictionary_is_named_by_its_path(tmp_path):
    made = pp.ErrorModel(PAPER.chain, PAPER.space, PAPER.sources)
    with pytest.raises(InputError, match="was not read from a sheet or a dictionary"):
        made.with_({"payload.mass": "2 kg"})
    (tmp_path / "arm.urdf").write_text(URDF)
    sources = [{"joint_offset": {"joint": "a.b", "offset": {"normal": "0.3 kg"}}}]
    with pytest.raises(InputError, match=r"sources\.0\.joint_offset\.offset.*'kg' in '0.3 kg' is not a unit of angle"):
        pp.ErrorModel.from_dict(DATA | {"sources": sources}, tmp_path)
    with pytest.raises(InputError, match="the sheet must be a dictionary with names as keys"):
        pp.ErrorModel.from_dict([], tmp_path)


# where numbers come from ---------------------------------------------------------------------------------------------

SLIDE, TURN = "joint_offset[y_axis]", f"joint_offset[{LONG}]"


@pytest.fixture
def gantry_of(tmp_path):
    (tmp_path / "gantry.urdf").write_text(GANTRY, "utf-8")

    def make(slide=None, turn=None, **more):
        first = {"joint": "y_axis", "offset": "slide"}
        second = {"joint": LONG, "offset": {"normal": "0.3 mrad"}}
        for settings, stated in ((first, slide), (second, turn)):
            settings |= {} if stated is None else stated
        sheet = {
            "precision-pin": 1, "robot": "gantry.urdf", "poses": {"home": ["0 mm", "0 deg"]},
            "parameters": {"slide": {"uniform": "0.1 mm"}}, "sources": [{"joint_offset": first}, {"joint_offset": second}],
        }  # fmt: skip
        return pp.ErrorModel.from_dict(sheet | more, tmp_path)

    return make


def shares(model):
    return {kind: position for kind, (position, _) in origin_shares(model.origins, model.at("home")).items()}


# a slide of variance 0.1²/3 mm² and a turn of 0.1 mrad at a tool 500 mm away
TURNED = 0.05**2 / (0.05**2 + 0.1**2 / 3)


def calibrated(folder, names, mean, covariance):
    """Write estimates of a calibration; return what a sheet says of them."""
    estimates = {"names": names, "mean": dict(zip(names, mean, strict=True)), "covariance": covariance}
    (urdf,) = folder.glob("*.urdf")
    of = pp.Chain.from_urdf(urdf).kinematics
    text = json.dumps({"schema": "precision-pin/calibration/1", "posterior": estimates, "kinematics": of})
    (folder / "arm.calibration.json").write_text(text)
    return {"calibrated": "arm.calibration.json"}


@pytest.mark.slow
def test_shares_by_hand(gantry_of):
    model = gantry_of({"provenance": {"data sheet": "guide, p. 3"}}, {"assumed": "true"})
    assert shares(model) == pytest.approx({"data sheet": 1 - TURNED, "assumed": TURNED})
    assert origin_shares(model.origins, model.at("home"))["assumed"][1] == pytest.approx(1)
    assert model.sheet.origins[SLIDE].text == "guide, p. 3"
    assert model.assumed == (TURN,)
    found = pp.monte_carlo(model, "home", samples=100).to_dict()["provenance"]
    assert found["assumed"] == {"position": pytest.approx(TURNED), "attitude": pytest.approx(1)}
    assert pp.budget(model, "home", samples=1024).to_dict()["provenance"] == found


def test_by_setting_by_path_and_not_stated(gantry_of):
    assert shares(gantry_of()) == {}
    half = gantry_of(None, {"provenance": {"offset": "measured"}})
    assert shares(half) == pytest.approx({"measured": TURNED, "not stated": 1 - TURNED})
    # a parameter's own entry is above that of the source that uses it; * stands for anything
    by_path = gantry_of(
        {"provenance": "assumed"}, provenance={"parameters.*": "drawing", "joint_offset[a_*].offset": "measured"}
    )
    assert shares(by_path) == pytest.approx({"drawing": 1 - TURNED, "measured": TURNED})
    # a source stated as assumed counts as one, whichever key says so
    assert by_path.assumed == (SLIDE,)
    changed = half.with_({f"{SLIDE}.provenance": "assumed"})
    assert shares(changed) == pytest.approx({"measured": TURNED, "assumed": 1 - TURNED})


def test_a_calibrated_number_is_measured_where_half_of_its_variance_is_gone(gantry_of, tmp_path):
    """The two numbers are one draw then; by hand, with a covariance that adds half of itself to each share."""
    slide, turn, together = 0.02e-3, 0.09e-3, 0.5e-9
    covariance = [[slide**2, together], [together, turn**2]]
    measured = calibrated(tmp_path, ["slide", f"{TURN}.offset"], [1e-5, 0.0], covariance)
    model = gantry_of({"provenance": "drawing"}, {"assumed": "true"}, **measured)
    assert len(model.space.draws) == 1
    # 0.02 of 0.058 mm is mostly read, 0.09 of 0.1 mrad is still a guess; the turn moves the tool, 500 mm away, along y
    own, both = (slide**2, (0.5 * turn) ** 2), 0.5 * together
    whole = sum(own) + 2 * both
    assert shares(model) == pytest.approx(
        {"measured": (own[0] + both) / whole, "assumed": (own[1] + both) / whole}, rel=1e-6
    )
    assert model.owners == ((SLIDE, TURN),)
    assert pp.map_poses(model, ["home"], verify=0).to_dict()["provenance"].keys() == {"measured", "assumed"}


def test_what_is_set_takes_the_place_of_what_was_measured(gantry_of, tmp_path):
    """The slide was measured, of the turn nothing was learned: its ±0.3 mrad stays."""
    names, before = ["slide", f"{TURN}.offset"], gantry_of()
    slide, turn = 0.02e-3, 0.1e-3
    model = gantry_of(**calibrated(tmp_path, names, [1e-5, 0.0], [[slide**2, 0.0], [0.0, turn**2]]))

    def numbers(changed):
        at = [changed.space.index[name] for name in names]
        return [*changed.space.mean[at], *np.sqrt(changed.space.block_covariance.variances[at])]

    with pytest.warns(PrecisionPinWarning, match=r"W_SET_MEASURED.*slide 0.01 ± 0.02 mm;") as said:
        changed = model.with_({"parameters.slide": {"normal": {"std": "0.3 mm"}}})
    assert len(said) == 1
    assert numbers(changed) == pytest.approx([0, 0, 0.3e-3, turn])
    # a tolerance of which nothing was learned is what was set, without a word, and what was measured stays
    changed = model.with_({f"{TURN}.offset": {"normal": {"std": "2 mrad"}}})
    assert numbers(changed) == pytest.approx([1e-5, 0, slide, 2e-3])
    # a constant too
    with pytest.warns(PrecisionPinWarning, match="W_SET_MEASURED"):
        fixed = model.with_({"parameters.slide": {"fixed": "0.2 mm"}})
    expected = before.with_({"parameters.slide": {"fixed": "0.2 mm"}}).at("home").error_at_means[:3]
    assert fixed.at("home").error_at_means[:3] == pytest.approx(expected, abs=1e-12)


def test_a_number_of_one_sign_keeps_it_after_a_calibration(tmp_path):
    """Two compliances of which only the sum is known: the normal law of each alone would reach below zero."""
    shutil.copy(PAPER_SHEET.with_name("4dof.urdf"), tmp_path)
    soft = {"uniform": "4e-7 rad/(N*m)", "mean": "1e-6 rad/(N*m)"}
    sheet = {
        "precision-pin": 1, "robot": "4dof.urdf", "tip": "tool", "poses": {"home": "-90 3 88 -91 deg"},
        "sources": [{"joint_compliance": {"joint": name, "compliance": soft}} for name in ("joint2", "joint3")],
    }  # fmt: skip
    names = [f"joint_compliance[{name}].compliance" for name in ("joint2", "joint3")]
    variance = (4e-7) ** 2 / 3
    covariance = [[variance, -0.999 * variance], [-0.999 * variance, variance]]
    model = pp.ErrorModel.from_dict(sheet | calibrated(tmp_path, names, [1e-6, 1e-6], covariance), tmp_path)
    x = model.space.sample(0, 0, 200_000)
    assert x.min() >= 3e-7  # half of the least that the law allows
    assert (x == 3e-7).mean() < 1e-2  # beyond it the normal law has 0.1 %
    uncut = x[:, (x > 3e-7).all(axis=0)]
    assert uncut.sum(axis=0).std() == pytest.approx(np.sqrt(0.002 * variance), rel=0.01)  # the sum stays known


def test_what_is_wrong_is_said_in_a_line(gantry_of):
    for stated, message in (
        ({"slide": {"provenance": "guessed"}}, "'guessed'; valid: assumed, data sheet, drawing, measured"),
        ({"slide": {"provenance": {"drawing": "1", "measured": "2"}}}, "this has 2 keys"),
        ({"slide": {"provenance": ["drawing"]}}, "a word is expected, such as 'provenance: drawing'"),
        (
            {"slide": {"provenance": {"offset": "drawing", "ofset": "drawing"}}},
            "no setting named 'ofset'; did you mean",
        ),
        ({"slide": {"provenance": "drawing", "assumed": "true"}}, "both state the origin of the values"),
        ({"provenance": {"parameters.slid": "drawing"}}, "source named 'parameters.slid'; did you mean"),
        ({"provenance": {"parameters.slide": "guess"}}, "no provenance named 'guess'"),
    ):
        with pytest.raises((SheetError, InputError)) as refused:
            gantry_of(**stated)
        (finding,) = refused.value.findings
        assert message in finding.message
