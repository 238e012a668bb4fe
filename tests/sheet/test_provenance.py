"""Where numbers come from: the keys of the sheet, and shares of the variance against hand-computed ones."""

from __future__ import annotations

from typing import Any

import pytest

import precision_pin as pp
from cli.conftest import GANTRY, LONG
from precision_pin.errors import InputError, SheetError
from precision_pin.model.origins import origin_shares

SLIDE, TURN = "joint_offset[y_axis]", f"joint_offset[{LONG}]"


@pytest.fixture
def model_of(tmp_path):
    (tmp_path / "gantry.urdf").write_text(GANTRY, "utf-8")

    def make(slide: Any = None, turn: Any = None, **more: Any) -> pp.ErrorModel:
        first: dict[str, Any] = {"joint": "y_axis", "offset": "slide"}
        second: dict[str, Any] = {"joint": LONG, "offset": {"normal": "0.3 mrad"}}
        for settings, stated in ((first, slide), (second, turn)):
            settings |= {} if stated is None else stated
        sheet = {
            "precision-pin": 1, "robot": "gantry.urdf", "poses": {"home": ["0 mm", "0 deg"]},
            "parameters": {"slide": {"uniform": "0.1 mm"}}, "sources": [{"joint_offset": first}, {"joint_offset": second}],
        }  # fmt: skip
        return pp.ErrorModel.from_dict(sheet | more, tmp_path)

    return make


def shares(model: pp.ErrorModel) -> dict[str, float]:
    return {kind: position for kind, (position, _) in origin_shares(model.origins, model.at("home")).items()}


# a slide of variance 0.1²/3 mm² and a turn of 0.1 mrad at a tool 500 mm away
TURNED = 0.05**2 / (0.05**2 + 0.1**2 / 3)


def test_shares_by_hand(model_of):
    model = model_of({"provenance": {"data sheet": "guide, p. 3"}}, {"assumed": "true"})
    assert shares(model) == pytest.approx({"data sheet": 1 - TURNED, "assumed": TURNED})
    assert origin_shares(model.origins, model.at("home"))["assumed"][1] == pytest.approx(1)
    assert model.sheet.origins[SLIDE].text == "guide, p. 3"
    assert model.assumed == (TURN,)
    found = pp.monte_carlo(model, "home", samples=100).to_dict()["provenance"]
    assert found["assumed"] == {"position": pytest.approx(TURNED), "attitude": pytest.approx(1)}
    assert pp.budget(model, "home").to_dict()["provenance"] == found


def test_by_setting_by_path_and_not_stated(model_of):
    assert shares(model_of()) == {}
    half = model_of(None, {"provenance": {"offset": "measured"}})
    assert shares(half) == pytest.approx({"measured": TURNED, "not stated": 1 - TURNED})
    # a parameter's own entry is above that of the source that uses it; * stands for anything
    by_path = model_of(
        {"provenance": "assumed"}, provenance={"parameters.*": "drawing", "joint_offset[a_*].offset": "measured"}
    )
    assert shares(by_path) == pytest.approx({"drawing": 1 - TURNED, "measured": TURNED})
    # a source stated as assumed counts as one, whichever key says so
    assert by_path.assumed == (SLIDE,)
    changed = half.with_({f"{SLIDE}.provenance": "assumed"})
    assert shares(changed) == pytest.approx({"measured": TURNED, "assumed": 1 - TURNED})


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        (
            {"slide": {"provenance": "guessed"}},
            "no provenance named 'guessed'; valid: assumed, data sheet, drawing, measured",
        ),
        ({"slide": {"provenance": {"drawing": "1", "measured": "2"}}}, "this has 2 keys"),
        ({"slide": {"provenance": ["drawing"]}}, "a word is expected, such as 'provenance: drawing'"),
        (
            {"slide": {"provenance": {"offset": "drawing", "ofset": "drawing"}}},
            "no setting named 'ofset'; did you mean",
        ),
        ({"slide": {"provenance": "drawing", "assumed": "true"}}, "both say where the numbers come from"),
        (
            {"provenance": {"parameters.slid": "drawing"}},
            "no parameter or source named 'parameters.slid'; did you mean",
        ),
        ({"provenance": {"parameters.slide": "guess"}}, "no provenance named 'guess'"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(model_of, stated, message):
    with pytest.raises((SheetError, InputError)) as refused:
        model_of(**stated)
    (finding,) = refused.value.findings
    assert message in finding.message
