"""The JSON of ``analyze``: its keys as the users' contract lists them, and its numbers against plain numpy."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.special import betaincinv

import precision_pin as pp
from precision_pin.robot.examples import PAPER_SHEET

TOP = [
    "schema", "complete", "robot", "base", "tip", "axes", "pose", "samples", "seed", "model", "statics", "scopes",
    "confidence", "versions", "warnings", "position", "attitude", "nominal", "covariance", "covariance_interval", "spec",
    "largest", "assumed", "findings",
]  # fmt: skip
STATISTICS = [
    "mean", "std", "min", "max", "mode", "quantiles", "quantile_interval", "quantile_error",
    "mean_interval", "std_interval", "mode_interval", "tolerance_bounds",
]  # fmt: skip
NORM_LEVELS = ["0.5", "0.95", "0.99", "0.9973"]
COMPONENT_LEVELS = ["0.00135", "0.01", "0.05", "0.5", "0.95", "0.99", "0.9973"]


def is_number(value: object) -> bool:
    return isinstance(value, float) and math.isfinite(value)


def distributions(data):
    for quantity in ("position", "attitude"):
        for part in ("norm", "x", "y", "z"):
            yield f"{quantity}.{part}", data[quantity][part]


@pytest.mark.slow
def test_json_alone_on_stdout(run):
    outcome = run("analyze", "--samples", "100", "--json", "-")
    assert outcome.code == 0
    assert outcome.said == []
    assert outcome.out.startswith("{")
    assert outcome.out.endswith("}\n")
    json.loads(outcome.out)  # one document and nothing else


@pytest.mark.slow
def test_json_alone_on_stdout_when_there_are_warnings_and_files(run):
    arguments = ("--samples", "100", "--q", "0 0 0 200 deg", "--out", "plots", "--json", "-")
    outcome = run("analyze", *arguments)
    json.loads(outcome.out)
    warned, wrote = outcome.said
    assert "W_JOINT_LIMIT" in warned
    assert wrote.startswith("wrote plots")


@pytest.mark.slow
def test_every_key_and_type(run):
    data = run(
        "analyze", "--samples", "5000", "--seed", "7", "--spec", "40 mm", "--spec", "rx 20 mrad", "--json", "-"
    ).json
    assert sorted(data) == sorted(TOP)
    assert data["schema"] == "precision-pin/analysis/1"
    assert data["complete"] is True
    assert (data["robot"], data["base"], data["tip"], data["axes"]) == ("4dof.urdf", "base", "tool", "base")
    assert (data["samples"], data["seed"], data["model"], data["statics"]) == (5000, 7, "exact", "nominal")
    assert data["confidence"] == 0.95
    assert sorted(data["pose"]) == ["name", "q"]
    assert data["pose"]["name"] == "paper"
    assert data["pose"]["q"] == {
        f"joint{k}": pytest.approx(math.radians(value), abs=1e-15) for k, value in enumerate((-90, 3, 88, -91), start=1)
    }
    assert {"python", "precision-pin", "pin", "numpy"} <= set(data["versions"])
    assert all(isinstance(version, str) for version in data["versions"].values())
    assert all(isinstance(line, str) for line in data["warnings"])
    # the paper's sheet: six lengths, four discs for two points on each of four axes as pairs of numbers, four joints
    assert data["scopes"]["unit"] == 6 + 4 * 2 * 2 + 4
    assert sorted(data["nominal"]) == ["attitude", "position"]
    for vector in data["nominal"].values():
        assert len(vector) == 3
        assert all(map(is_number, vector))
    assert np.shape(data["covariance"]) == (6, 6)
    assert len(data["spec"]) == 2
    for entry in data["spec"]:
        keys = ["quantity", "limit", "required", "probability", "interval", "met", "verdict", "cpk", "cpk_interval"]
        assert sorted(entry) == sorted([*keys, "judged", "why_not_judged", "taken_as_exact"])
        assert entry["met"] is (entry["verdict"] == "met")
        low, high = entry["interval"]
        assert 0 <= low <= entry["probability"] <= high <= 1
    intervals = np.array(data["covariance_interval"], dtype=float)
    assert (intervals[:, :, 0] < data["covariance"]).all()
    assert (intervals[:, :, 1] > data["covariance"]).all()
    for name, entry in distributions(data):
        levels = NORM_LEVELS if name.endswith("norm") else COMPONENT_LEVELS
        assert sorted(entry) == sorted(STATISTICS), name
        assert sorted(entry["quantiles"]) == sorted(entry["quantile_interval"]) == sorted(levels), name
        assert all(is_number(entry[key]) for key in ("mean", "std", "min", "max")), name
        for statistic in ("mean", "std"):
            low, high = entry[f"{statistic}_interval"]
            assert low < entry[statistic] < high, name
        assert (entry["mode"] is None) == (entry["mode_interval"] is None), name
        assert entry["mode"] is None or entry["mode_interval"][0] <= entry["mode"] <= entry["mode_interval"][1]
        for content, (low, high) in entry["tolerance_bounds"].items():
            # one-sided for a norm; two-sided bounds enclose more than the quantile of one side
            assert low == 0 if name.endswith("norm") else low < entry["quantiles"]["0.05"], name
            assert high > entry["quantiles"][content], name
        for level in levels:
            assert is_number(entry["quantiles"][level]), (name, level)
            low, high = entry["quantile_interval"][level]
            assert entry["min"] <= low <= entry["quantiles"][level] <= high <= entry["max"], (name, level)


def resolved(samples: int, level: float) -> bool:
    """Whether smallest and largest of the samples enclose a quantile with 95 %: 1 - p^N - (1-p)^N."""
    return 1 - level**samples - (1 - level) ** samples >= 0.95


@pytest.mark.parametrize("samples", [1, 2, 50, 2000])
def test_null_where_the_samples_do_not_resolve_a_number(run, samples):
    data = run("analyze", "--samples", str(samples), "--json", "-").json
    assert (data["covariance"] is None) == (samples == 1)
    for name, entry in distributions(data):
        assert all(is_number(entry[key]) for key in ("mean", "min", "max")), name
        assert (entry["std"] is None) == (samples == 1), name
        assert samples > 50 or entry["mode"] is None, name
        for level, value in entry["quantiles"].items():
            assert (value is not None) == resolved(samples, float(level)), (name, level)
            assert (entry["quantile_interval"][level] is None) == (value is None), (name, level)


@pytest.mark.slow
def test_same_seed_same_bytes_another_seed_other_numbers(run, folder):
    arguments = ("analyze", "--samples", "20000", "--spec", "40 mm")
    first = run(*arguments, "--seed", "3", "--json", "-").out
    assert run(*arguments, "--seed", "3", "--json", "-").out == first
    run(*arguments, "--seed", "3", "--json", "file.json")
    assert (folder / "file.json").read_text(encoding="utf-8") == first
    other = json.loads(run(*arguments, "--seed", "18446744073709551615", "--json", "-").out)
    assert other["seed"] == 2**64 - 1
    assert other["position"]["norm"]["mean"] != json.loads(first)["position"]["norm"]["mean"]


@pytest.mark.slow
def test_numbers_against_the_samples_themselves(run):
    data = run("analyze", "--samples", "20000", "--seed", "5", "--spec", "x 10 mm @ 0.8", "--json", "-").json
    kept = pp.monte_carlo(pp.ErrorModel.load(PAPER_SHEET), samples=20_000, seed=5, keep_samples=True).errors
    assert kept is not None
    np.testing.assert_allclose(data["covariance"], np.cov(kept), rtol=1e-9, atol=1e-18)
    rows = {
        f"{vector}.{part}": kept[first + k]
        for vector, first in (("position", 0), ("attitude", 3))
        for k, part in enumerate("xyz")
    }
    rows["position.norm"] = np.sqrt((kept[:3] ** 2).sum(axis=0))
    rows["attitude.norm"] = np.sqrt((kept[3:] ** 2).sum(axis=0))
    for name, entry in distributions(data):
        values = rows[name]
        scale = np.abs(values).max()
        assert entry["mean"] == pytest.approx(values.mean(), abs=1e-12 * scale), name
        assert entry["std"] == pytest.approx(values.std(ddof=1), rel=1e-9), name
        assert entry["min"] == pytest.approx(values.min(), rel=1e-12), name
        assert entry["max"] == pytest.approx(values.max(), rel=1e-12), name
        for level, quantile in entry["quantiles"].items():
            # binned: to a bin, 2⁻⁹ of the distance from the centre
            reach = 2**-9 * abs(np.quantile(values, float(level)) - values.mean()) + 2**-11 * values.std()
            assert quantile == pytest.approx(np.quantile(values, float(level)), abs=reach), (name, level)
    inside = int((np.abs(kept[0]) <= 0.01).sum())
    (entry,) = data["spec"]
    assert entry["probability"] == inside / 20_000
    assert entry["interval"] == [
        pytest.approx(betaincinv(inside, 20_000 - inside + 1, 0.025), rel=1e-9),
        pytest.approx(betaincinv(inside + 1, 20_000 - inside, 0.975), rel=1e-9),
    ]


@pytest.mark.slow
def test_nominal_is_the_error_with_every_parameter_at_its_mean(run):
    data = run("analyze", "--samples", "10", "--json", "-").json
    at = pp.ErrorModel.load(PAPER_SHEET).at("paper")
    expected = at.exact(at.space.mean[:, None])[:, 0]
    np.testing.assert_allclose([*data["nominal"]["position"], *data["nominal"]["attitude"]], expected, rtol=1e-12)
