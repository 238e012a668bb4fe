"""Where numbers come from: the keys of the sheet, and shares of the variance against hand-computed ones."""

from __future__ import annotations

import json
import shutil
from typing import Any

import numpy as np
import pytest

import precision_pin as pp
from cli.conftest import GANTRY, LONG
from precision_pin.base.errors import InputError, PrecisionPinWarning, SheetError
from precision_pin.model.pose_model import origin_shares
from precision_pin.robot.examples import PAPER_SHEET

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


@pytest.mark.slow
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


def test_a_calibrated_number_is_measured_where_half_of_its_variance_is_gone(model_of, tmp_path):
    """The two numbers are one draw then; by hand, with a covariance that adds half of itself to each share."""
    slide, turn, together = 0.02e-3, 0.09e-3, 0.5e-9
    estimates = {
        "names": ["slide", f"{TURN}.offset"],
        "mean": {"slide": 1e-5, f"{TURN}.offset": 0.0},
        "covariance": [[slide**2, together], [together, turn**2]],
    }
    text = json.dumps({"schema": "precision-pin/calibration/1", "posterior": estimates})
    (tmp_path / "arm.calibration.json").write_text(text)
    stated = {"provenance": "drawing"}, {"assumed": "true"}
    model = model_of(*stated, calibrated="arm.calibration.json")
    assert len(model.space.draws) == 1
    # 0.02 of 0.058 mm is mostly read, 0.09 of 0.1 mrad is still a guess; the turn moves the tool, 500 mm away, along y
    own, both = (slide**2, (0.5 * turn) ** 2), 0.5 * together
    whole = sum(own) + 2 * both
    assert shares(model) == pytest.approx(
        {"measured": (own[0] + both) / whole, "assumed": (own[1] + both) / whole}, rel=1e-6
    )
    assert model.owners == ((SLIDE, TURN),)
    assert pp.map_poses(model, ["home"], verify=0).to_dict()["provenance"].keys() == {"measured", "assumed"}


def test_what_is_set_takes_the_place_of_what_was_measured(model_of, tmp_path):
    """The slide was measured, of the turn nothing was learned: its ±0.3 mrad stays."""
    names = ["slide", f"{TURN}.offset"]
    before = model_of().space
    variances = before.block_covariance.variances[[before.index[name] for name in names]]
    slide = 0.02e-3
    estimates = {
        "names": names,
        "mean": {"slide": 1e-5, f"{TURN}.offset": 0.0},
        "covariance": [[slide**2, 0.0], [0.0, float(variances[1])]],
    }
    text = json.dumps({"schema": "precision-pin/calibration/1", "posterior": estimates})
    (tmp_path / "arm.calibration.json").write_text(text)
    model = model_of(calibrated="arm.calibration.json")

    def numbers(changed):
        at = [changed.space.index[name] for name in names]
        return changed.space.mean[at], np.sqrt(changed.space.block_covariance.variances[at])

    with pytest.warns(PrecisionPinWarning, match=r"W_SET_MEASURED.*slide 1e-05 ± 2e-05;") as said:
        mean, std = numbers(model.with_({"parameters.slide": {"normal": {"std": "0.3 mm"}}}))
    assert len(said) == 1
    assert mean == pytest.approx([0, 0])
    assert std == pytest.approx([0.3e-3, np.sqrt(variances[1])])
    # a tolerance of which nothing was learned is what was set, without a word, and what was measured stays
    mean, std = numbers(model.with_({f"{TURN}.offset": {"normal": {"std": "2 mrad"}}}))
    assert mean == pytest.approx([1e-5, 0])
    assert std == pytest.approx([slide, 2e-3])
    # a constant too
    with pytest.warns(PrecisionPinWarning, match="W_SET_MEASURED"):
        fixed = model.with_({"parameters.slide": {"fixed": "0.2 mm"}})
    assert fixed.at("home").error_at_means[:3] == pytest.approx(
        model_of().with_({"parameters.slide": {"fixed": "0.2 mm"}}).at("home").error_at_means[:3], abs=1e-12
    )


def test_a_number_of_one_sign_keeps_it_after_a_calibration(tmp_path):
    """Two compliances of which only the sum is known: the normal law of each alone would reach below zero."""
    shutil.copy(PAPER_SHEET.with_name("4dof.urdf"), tmp_path)
    soft = {"uniform": "4e-7 rad/(N*m)", "mean": "1e-6 rad/(N*m)"}
    sheet = {
        "precision-pin": 1, "robot": "4dof.urdf", "tip": "tool", "poses": {"home": "-90 3 88 -91 deg"},
        "sources": [{"joint_compliance": {"joint": name, "compliance": soft}} for name in ("joint2", "joint3")],
        "calibrated": "arm.calibration.json",
    }  # fmt: skip
    names = [f"joint_compliance[{name}].compliance" for name in ("joint2", "joint3")]
    variance = (4e-7) ** 2 / 3
    covariance = [[variance, -0.999 * variance], [-0.999 * variance, variance]]
    estimates = {"names": names, "mean": dict.fromkeys(names, 1e-6), "covariance": covariance}
    text = json.dumps({"schema": "precision-pin/calibration/1", "posterior": estimates})
    (tmp_path / "arm.calibration.json").write_text(text)
    model = pp.ErrorModel.from_dict(sheet, tmp_path)
    x = model.space.sample(0, 0, 200_000)
    assert x.min() >= 3e-7  # half of the least that the law allows
    assert (x == 3e-7).mean() < 1e-2  # beyond it the normal law has 0.1 %
    uncut = x[:, (x > 3e-7).all(axis=0)]
    assert uncut.sum(axis=0).std() == pytest.approx(np.sqrt(0.002 * variance), rel=0.01)  # the sum stays known


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
