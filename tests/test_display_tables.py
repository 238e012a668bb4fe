"""Results as data frames and datasets: the numbers of the JSON, nothing lost on the way to a file and back."""

from __future__ import annotations

import itertools
import json
import math
import sys

import numpy as np
import pandas
import pytest
import xarray

import precision_pin as pp
from precision_pin.analyses.exact_law.exact_law import LEVELS
from precision_pin.render.tables import joint_text, milli, percent, plus_minus, pose_labels, quantity_label
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.statistics import QUANTITIES

FOLDED = [0.0, 0.2, 1.5, 0.3]
SPECIFICATIONS = [pp.specification("44 mm @ 99.73 %"), pp.specification("rx 17 mrad")]


@pytest.fixture(scope="module")
def model() -> pp.ErrorModel:
    return pp.ErrorModel.load(PAPER_SHEET)


@pytest.fixture(scope="module")
def analysis(model):
    return pp.monte_carlo(model, samples=3000, seed=5, keep_samples=True)


@pytest.fixture(scope="module")
def results(model) -> dict[str, object]:
    return {
        "budget": pp.budget(model, ["paper", FOLDED], seed=2, samples=1024),
        "worst case": pp.worst_case(model, ["paper", FOLDED], seed=2, samples=1000),
        "exact law": pp.exact_law(model, ["paper", FOLDED], seed=2, samples=1000),
        "reliability": pp.reliability(model, SPECIFICATIONS, seed=2, samples=2000),
    }


def same(found: object, expected: object) -> bool:
    """Whether two numbers are the same, not-a-number and none alike."""
    if expected is None or (isinstance(expected, float) and math.isnan(expected)):
        return isinstance(found, float) and math.isnan(found)
    return found == expected


# text --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "half_width", "text"),
    [
        (36.8649, 0.0123, "36.865 ± 0.013"),
        (36.8649, 0.12, "36.86 ± 0.13"),
        (-5.0, 17.2, "-5 ± 18"),
        (1234.0, 171.0, "1230 ± 180"),
        (2.5, 0.0, "2.5"),
        (-0.0, 0.0, "0"),
        (-0.0001, 0.02, "0.000 ± 0.021"),
        (None, None, "-"),
        (1.0, None, "-"),
    ],
)
def test_a_number_with_its_half_width(value, half_width, text):
    assert plus_minus(value, half_width) == text


def test_decimals_can_be_capped():
    assert plus_minus(2.2e-5, 1.5e-7, decimals=3) == "0.000 ± 0.001"
    assert plus_minus(25.224, 0.185, decimals=3) == "25.22 ± 0.19"


def test_a_change_has_its_sign():
    assert plus_minus(0.4, 0.0123, signed=True) == "+0.400 ± 0.013"
    assert plus_minus(-0.4, 0.0123, signed=True) == "-0.400 ± 0.013"


def test_small_texts():
    assert milli(0.0368649) == "36.8649"
    assert milli(3e-15) == "0"
    assert milli(1.0 / 3) == "333.333"
    assert milli(1.0 / 3, 4) == "333.3"
    assert (percent(None), percent(0.123456), percent(-1e-9)) == ("-", "12.35", "0.00")
    assert (quantity_label("position.norm"), quantity_label("attitude.x")) == ("|d| [mm]", "δx [mrad]")
    assert milli(math.nan) == milli(None) == "-"
    assert joint_text({"a": math.pi / 2, "b": 0.25}, ("b",)) == "a 90°, b 250 mm"
    assert pose_labels(["", "p", "p", "pose 1"]) == ["pose 1", "p", "p (2)", "pose 1 (2)"]


# analysis ----------------------------------------------------------------------------------------


def test_the_frame_of_an_analysis_holds_what_the_json_does(analysis):
    frame, data = analysis.to_pandas(), analysis.to_dict()
    assert list(frame.index) == list(QUANTITIES)
    for quantity in QUANTITIES:
        vector, part = quantity.split(".")
        entry, row = data[vector][part], frame.loc[quantity]
        for name in ("mean", "std", "min", "max", "mode"):
            assert same(row[name], entry[name])
        for level, value in entry["quantiles"].items():
            low, high = entry["quantile_interval"][level] or (None, None)
            assert same(row[f"quantile_{level}"], value)
            assert same(row[f"quantile_{level}_lower"], low)
            assert same(row[f"quantile_{level}_upper"], high)
        levels = {name.split("_")[1] for name in frame.columns if name.startswith("quantile_")}
        for level in levels - set(entry["quantiles"]):
            assert math.isnan(row[f"quantile_{level}"])
    # mean ± 1.96 std/√N, computed here from the samples; Student's quantile and the skewness add less than a hundredth
    norms = np.linalg.norm(analysis.errors[:3], axis=0)
    half = 1.959963984540054 * norms.std(ddof=1) / math.sqrt(norms.size)
    assert frame.loc["position.norm", "mean_upper"] - norms.mean() == pytest.approx(half, rel=0.01)
    assert all(kind.kind == "f" for kind in frame.dtypes)


def test_a_frame_tells_how_it_was_sampled(analysis):
    told = analysis.to_pandas().attrs
    assert told["seed"] == 5
    assert told["samples"] == 3000
    assert told["versions"]["numpy"] == np.__version__
    assert told["units"] == {"position": "m", "attitude": "rad"}
    assert any("W_STATICS" in line for line in told["warnings"])
    json.dumps(told)  # plain enough for a parquet file
    told["units"]["position"] = "ft"
    assert analysis.to_pandas().attrs["units"]["position"] == "m"


def test_a_frame_of_one_sample_has_no_numbers_it_cannot_have(model):
    frame = pp.monte_carlo(model, samples=1).to_pandas()
    assert frame["std"].isna().all()
    assert frame["mean_lower"].isna().all()
    assert frame["quantile_0.95"].isna().all()
    assert frame["mean"].notna().all()


def test_the_frame_of_the_samples_is_a_copy_of_them(analysis):
    frame = analysis.samples_to_pandas()
    assert list(frame.columns) == ["dx", "dy", "dz", "rx", "ry", "rz"]
    assert frame.index.name == "sample"
    np.testing.assert_array_equal(frame.to_numpy(), analysis.errors.T)
    before = analysis.errors[0, 0]
    frame.loc[0, "dx"] = 1.0
    assert analysis.errors[0, 0] == before


def test_samples_that_were_not_kept_have_no_frame(model):
    with pytest.raises(pp.InputError, match="keep_samples=True"):
        pp.monte_carlo(model, samples=10).samples_to_pandas()


# analyses ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_frame_of_a_budget_holds_what_the_json_does(results):
    result = results["budget"]
    frame = result.to_pandas()
    assert frame.index.names == ["pose", "draw", "quantity"]
    assert list(frame.index.unique("pose")) == ["paper", "pose 2"]
    assert len(frame) == 2 * 18 * 10
    rows = frame.to_dict("index")
    for label, pose in zip(("paper", "pose 2"), result.to_dict()["poses"], strict=True):
        for draw in pose["draws"]:
            (group,) = [one for one in pose["groups"] if draw["name"] in one["draws"]]
            for quantity in ("position", "attitude", *QUANTITIES):
                row = rows[label, draw["name"], quantity]
                assert same(row["share"], draw["share"].get(quantity))
                assert same(row["reach"], draw["reach"].get(quantity))
                assert same(row["worst_case"], draw["worst_case"].get(quantity))
                assert same(row["halved_std"], draw["halved"]["std"].get(quantity))
                for name, estimates in (
                    ("first", group["first"]),
                    ("total", group["total"]),
                    ("halved_quantile", draw["halved"]["quantile"]),
                    ("halved_change", draw["halved"]["change"]),
                ):
                    estimate = estimates.get(quantity) or {"value": None, "interval": (None, None)}
                    assert same(row[name], estimate["value"])
                    assert same(row[f"{name}_lower"], estimate["interval"][0])
                    assert same(row[f"{name}_upper"], estimate["interval"][1])
    for lines, level in (("sources", "source"), ("places", "place")):
        shares = result.to_pandas(lines)["share"]
        assert shares.index.names == ["pose", level, "quantity"]
        # the shares of what causes the spread add up to one
        np.testing.assert_allclose(shares.xs("position", level="quantity").groupby("pose").sum(), 1.0, rtol=1e-12)
    assert frame.attrs["poses"]["pose 2"] == dict(zip(("joint1", "joint2", "joint3", "joint4"), FOLDED, strict=True))


@pytest.mark.slow
def test_draws_that_are_correlated_have_no_index_of_their_own(model):
    correlated = pp.Space(model.space.draws[:6], (pp.Correlation(("a2", "a4"), ((1.0, 0.5), (0.5, 1.0))),))
    result = pp.budget(pp.ErrorModel(model.chain, correlated, model.sources, model.poses), samples=1024)
    frame = result.to_pandas().xs("position", level="quantity").loc["paper"]
    assert frame["first"].isna().sum() == 2
    assert frame.loc[["a2", "a4"], "first"].isna().all()
    assert frame["share"].notna().all()


@pytest.mark.slow
def test_the_frame_of_a_worst_case_holds_what_the_json_does(results):
    frame = results["worst case"].to_pandas()
    for label, pose in zip(("paper", "pose 2"), results["worst case"].to_dict()["poses"], strict=True):
        for quantity, entry in pose["components"].items():
            row = frame.loc[(label, quantity)]
            assert [row["low"], row["high"]] == entry["first_order"]
            assert [row["seen_min"], row["seen_max"]] == entry["seen"]
        for vector in ("position", "attitude"):
            row, entry = frame.loc[(label, f"{vector}.norm")], pose[vector]
            assert [row["attained"], row["high"]] == [entry["first_order"]["lower"], entry["first_order"]["upper"]]
            assert row["exact_there"] == entry["exact_there"]["norm"]
            assert row["exact_found"] == entry["exact_found"]["norm"]
            assert row["seen_max"] == entry["seen"]["max"]
    assert frame.attrs["k"] == 3.0


@pytest.mark.slow
def test_the_frame_of_exact_laws_holds_what_the_json_does(results):
    frame = results["exact law"].to_pandas()
    for label, pose in zip(("paper", "pose 2"), results["exact law"].to_dict()["poses"], strict=True):
        for quantity, entry in pose["laws"].items():
            row = frame.loc[(label, quantity)]
            assert same(row["mean"], entry["mean"])
            assert same(row["std"], entry["std"])
            assert same(row["cumulative_error"], entry.get("cumulative_error"))
            assert same(row["distance"], entry.get("agreement", {}).get("distance"))
            for level in LEVELS:
                assert same(row[f"quantile_{level}"], entry.get("quantiles", {}).get(f"{level:g}"))
                assert same(row[f"quantile_{level}_error"], entry.get("quantile_error", {}).get(f"{level:g}"))


@pytest.mark.slow
def test_the_frame_of_a_reliability_analysis_holds_what_the_json_does(results):
    result = results["reliability"]
    frame, methods = result.to_pandas(), result.to_pandas("methods")
    (pose,) = result.to_dict()["poses"]
    assert list(frame.index.unique("specification")) == ["position.norm 44 mm @ 99.73 %", "attitude.x 17 mrad @ 95 %"]
    for (_, row), entry in zip(frame.iterrows(), pose["spec"], strict=True):
        for name in ("quantity", "limit", "required", "probability", "met", "resolved"):
            assert row[name] == entry[name]
        assert [row["probability_lower"], row["probability_upper"]] == entry["interval"]
        assert [row["failure_lower"], row["failure_upper"]] == entry["failure"]["interval"]
        assert row["form"] == entry["form"]["probability"]
        assert row["beta"] == entry["form"]["points"][0]["beta"]
    told = list(itertools.chain.from_iterable(entry["methods"] for entry in pose["spec"]))
    assert list(methods.index.get_level_values("method")) == [one["method"] for one in told]
    assert methods["failure"].tolist() == [one["probability"] for one in told]
    assert methods["evaluations"].tolist() == [one["evaluations"] for one in told]
    # what its index says can be read back
    for text, meant in zip(frame.index.unique("specification"), SPECIFICATIONS, strict=True):
        read = pp.specification(text)
        assert (read.quantity, read.limit) == (meant.quantity, pytest.approx(meant.limit, rel=1e-12))
        assert read.required == pytest.approx(meant.required, rel=1e-12)


@pytest.mark.slow
def test_only_tables_that_exist(results):
    with pytest.raises(pp.InputError, match="places"):
        results["budget"].to_pandas("joints")
    with pytest.raises(pp.InputError, match="methods"):
        results["reliability"].to_pandas("form")


# datasets ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["analysis", "budget", "worst case"])
def test_datasets_come_back_from_a_file_as_they_were(name, analysis, results):
    dataset = (analysis if name == "analysis" else results[name]).to_xarray()
    assert all(isinstance(value, str) for value in dataset.attrs.values())
    again = xarray.load_dataset(bytes(dataset.to_netcdf()))
    xarray.testing.assert_identical(again, dataset)
    assert json.loads(again.attrs["versions"])["numpy"] == np.__version__
    assert json.loads(again.attrs["seed"]) in (2, 5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["budget", "worst case"])
def test_datasets_hold_what_the_frames_do_in_their_order(name, results):
    frame, dataset = results[name].to_pandas(), results[name].to_xarray()
    assert [*dataset.sizes] == list(frame.index.names)
    for level in frame.index.names:
        assert dataset[level].to_numpy().tolist() == frame.index.unique(level).tolist()
    for column in frame.columns:
        np.testing.assert_array_equal(dataset[column].to_numpy().ravel(), frame[column].to_numpy())


# missing packages --------------------------------------------------------------------------------


@pytest.mark.slow
def test_without_pandas_a_line_says_how_to_install_it(monkeypatch, analysis, results):
    monkeypatch.setitem(sys.modules, "pandas", None)
    calls = [analysis.to_pandas, analysis.samples_to_pandas, *(result.to_pandas for result in results.values())]
    for call in calls:
        with pytest.raises(pp.InputError, match=r"pip install 'precision-pin\[pandas\]'"):
            call()


@pytest.mark.slow
def test_without_xarray_a_line_says_how_to_install_it(monkeypatch, analysis, results):
    monkeypatch.setitem(sys.modules, "xarray", None)
    for one in (analysis, results["budget"], results["worst case"]):
        with pytest.raises(pp.InputError, match=r"pip install 'precision-pin\[xarray\]'"):
            one.to_xarray()


def test_frames_can_be_put_together(analysis, model):
    other = pp.monte_carlo(model, samples=500, seed=6)
    both = pandas.concat({"one": analysis.to_pandas(), "other": other.to_pandas()})
    assert both.loc[("other", "position.norm"), "mean"] == other.position.norm.mean
