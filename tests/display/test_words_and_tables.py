"""Results as data frames and datasets, with the numbers of the JSON; numbers, names, laws and markup in words."""

import importlib.resources
import json
import math
import re
import sys

import numpy as np
import pandas
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal

import precision_pin as pp
from outputs.report_cases import Reader
from precision_pin.analyses.collect import bracketed
from precision_pin.analyses.exact_law.exact_law import LEVELS
from precision_pin.base import units
from precision_pin.base.errors import visible
from precision_pin.render.html import Html, element, table
from precision_pin.render.tables import joint_text, milli, percent, plus_minus, pose_labels, quantity_label
from precision_pin.render.text_table import aligned, width
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.statistics import QUANTITIES, SpecificationResult, format_share

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


def test_a_number_with_its_half_width():
    for value, half_width, text, *setting in (
        (36.8649, 0.0123, "36.865 ± 0.013"),
        (36.8649, 0.12, "36.86 ± 0.13"),
        (-5.0, 17.2, "-5 ± 18"),
        (1234.0, 171.0, "1230 ± 180"),
        (2.5, 0.0, "2.5"),
        (-0.0001, 0.02, "0.000 ± 0.021"),
        (None, None, "-"),
        (1.0, None, "-"),
        (2.2e-5, 1.5e-7, "0.000 ± 0.001", "decimals", 3),
        (25.224, 0.185, "25.22 ± 0.19", "decimals", 3),
        (0.4, 0.0123, "+0.400 ± 0.013", "signed", True),
        (-0.4, 0.0123, "-0.400 ± 0.013", "signed", True),
    ):
        assert plus_minus(value, half_width, **dict([setting] if setting else ())) == text


def test_small_texts():
    assert [*map(milli, (0.0368649, 3e-15, 1.0 / 3, math.nan, None))] == ["36.8649", "0", "333.333", "-", "-"]
    assert milli(1.0 / 3, 4) == "333.3"
    assert (percent(None), percent(0.123456), percent(-1e-9)) == ("-", "12.35", "0.00")
    assert (quantity_label("position.norm"), quantity_label("attitude.x")) == ("|d| [mm]", "δx [mrad]")
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
        others = {name.split("_")[1] for name in frame.columns if name.startswith("quantile_")} - {*entry["quantiles"]}
        assert row[[f"quantile_{level}" for level in others]].isna().all()
    # mean ± 1.96 std/√N, computed here from the samples; Student's quantile and the skewness add less than a hundredth
    norms = np.linalg.norm(analysis.errors[:3], axis=0)
    half = 1.959963984540054 * norms.std(ddof=1) / math.sqrt(norms.size)
    assert frame.loc["position.norm", "mean_upper"] - norms.mean() == pytest.approx(half, rel=0.01)
    assert all(kind.kind == "f" for kind in frame.dtypes)


def test_a_frame_tells_how_it_was_sampled(analysis):
    told = analysis.to_pandas().attrs
    assert (told["seed"], told["samples"], told["versions"]["numpy"]) == (5, 3000, np.__version__)
    assert told["units"] == {"position": "m", "attitude": "rad"}
    assert any("W_STATICS" in line for line in told["warnings"])
    json.dumps(told)  # plain enough for a parquet file
    told["units"]["position"] = "ft"
    assert analysis.to_pandas().attrs["units"]["position"] == "m"


def test_a_frame_of_one_sample_has_no_numbers_it_cannot_have_and_is_put_beside_another(analysis, model):
    frame = pp.monte_carlo(model, samples=1).to_pandas()
    assert frame[["std", "mean_lower", "quantile_0.95"]].isna().all(axis=None)
    assert frame["mean"].notna().all()
    both = pandas.concat({"one": analysis.to_pandas(), "other": frame})
    assert both.loc[("one", "position.norm"), "mean"] == analysis.position.norm.mean


def test_the_frame_of_the_samples_is_a_copy_of_them(analysis, model):
    frame = analysis.samples_to_pandas()
    assert list(frame.columns) == ["dx", "dy", "dz", "rx", "ry", "rz"]
    assert frame.index.name == "sample"
    assert_array_equal(frame.to_numpy(), analysis.errors.T)
    before = analysis.errors[0, 0]
    frame.loc[0, "dx"] = 1.0
    assert analysis.errors[0, 0] == before
    with pytest.raises(pp.InputError, match="keep_samples=True"):
        pp.monte_carlo(model, samples=10).samples_to_pandas()


# analyses ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_frame_of_a_budget_holds_what_the_json_does(results):
    result = results["budget"]
    frame = result.to_pandas()
    assert frame.index.names == ["pose", "draw", "quantity"]
    assert len(frame) == 2 * 18 * 10
    rows, nothing = frame.to_dict("index"), {"value": None, "interval": (None, None)}
    for label, pose in zip(("paper", "pose 2"), result.to_dict()["poses"], strict=True):
        for draw in pose["draws"]:
            (group,) = [one for one in pose["groups"] if draw["name"] in one["draws"]]
            halved = draw["halved"]
            numbers = {name: draw[name] for name in ("share", "reach", "worst_case")} | {"halved_std": halved["std"]}
            estimates = {"first": group["first"], "total": group["total"]}
            estimates |= {"halved_quantile": halved["quantile"], "halved_change": halved["change"]}
            for quantity in ("position", "attitude", *QUANTITIES):
                row = rows[label, draw["name"], quantity]
                for name, value in numbers.items():
                    assert same(row[name], value.get(quantity))
                for name, one in estimates.items():
                    estimate = one.get(quantity) or nothing
                    found = (row[name], row[f"{name}_lower"], row[f"{name}_upper"])
                    assert all(map(same, found, (estimate["value"], *estimate["interval"])))
    for lines, level in (("sources", "source"), ("places", "place")):
        shares = result.to_pandas(lines)["share"]
        assert shares.index.names == ["pose", level, "quantity"]
        # the shares of what causes the spread add up to one
        assert_allclose(shares.xs("position", level="quantity").groupby("pose").sum(), 1.0, rtol=1e-12)
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
def test_the_frames_of_a_worst_case_and_of_exact_laws_hold_what_the_json_does(results):
    labels = ("paper", "pose 2")
    frame = results["worst case"].to_pandas()
    assert frame.attrs["k"] == 3.0
    for label, pose in zip(labels, results["worst case"].to_dict()["poses"], strict=True):
        for quantity, entry in pose["components"].items():
            row = frame.loc[(label, quantity)]
            assert [*row[["low", "high", "seen_min", "seen_max"]]] == [*entry["first_order"], *entry["seen"]]
        for vector in ("position", "attitude"):
            row, entry = frame.loc[(label, f"{vector}.norm")], pose[vector]
            bound, norms = entry["first_order"], (entry["exact_there"]["norm"], entry["exact_found"]["norm"])
            found = [*row[["attained", "high", "exact_there", "exact_found", "seen_max"]]]
            assert found == [bound["lower"], bound["upper"], *norms, entry["seen"]["max"]]
    frame = results["exact law"].to_pandas()
    for label, pose in zip(labels, results["exact law"].to_dict()["poses"], strict=True):
        for quantity, entry in pose["laws"].items():
            row = frame.loc[(label, quantity)]
            assert same(row["distance"], entry.get("agreement", {}).get("distance"))
            for name in ("mean", "std", "cumulative_error"):
                assert same(row[name], entry.get(name))
            for level in LEVELS:
                assert same(row[f"quantile_{level}"], entry.get("quantiles", {}).get(f"{level:g}"))
                assert same(row[f"quantile_{level}_error"], entry.get("quantile_error", {}).get(f"{level:g}"))


MEASURED = ("method", "probability", "evaluations")


@pytest.mark.slow
def test_the_frame_of_a_reliability_analysis_holds_what_the_json_does(results):
    result = results["reliability"]
    frame, methods = result.to_pandas(), result.to_pandas("methods")
    (pose,) = result.to_dict()["poses"]
    assert list(frame.index.unique("specification")) == ["position.norm 44 mm @ 99.73 %", "attitude.x 17 mrad @ 95 %"]
    for (_, row), entry in zip(frame.iterrows(), pose["spec"], strict=True):
        for name in ("quantity", "limit", "required", "probability", "met", "resolved"):
            assert row[name] == entry[name]
        numbers = [*entry["interval"], *entry["failure"]["interval"], entry["form"]["probability"]]
        ends = [f"{name}_{end}" for name in ("probability", "failure") for end in ("lower", "upper")]
        assert [*row[[*ends, "form", "beta"]]] == [*numbers, entry["form"]["points"][0]["beta"]]
    told = [[one[name] for name in MEASURED] for entry in pose["spec"] for one in entry["methods"]]
    assert methods.reset_index()[["method", "failure", "evaluations"]].to_numpy().tolist() == told
    # what its index says can be read back
    for text, meant in zip(frame.index.unique("specification"), SPECIFICATIONS, strict=True):
        read = pp.specification(text)
        assert read.quantity == meant.quantity
        assert [read.limit, read.required] == pytest.approx([meant.limit, meant.required], rel=1e-12)


# datasets ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["analysis", "budget", "worst case"])
def test_datasets_come_back_from_a_file_as_they_were_and_hold_what_the_frames_do(name, analysis, results):
    result = analysis if name == "analysis" else results[name]
    frame, dataset = result.to_pandas(), result.to_xarray()
    assert all(isinstance(value, str) for value in dataset.attrs.values())
    again = xarray.load_dataset(bytes(dataset.to_netcdf()))
    xarray.testing.assert_identical(again, dataset)
    assert json.loads(again.attrs["versions"])["numpy"] == np.__version__
    assert json.loads(again.attrs["seed"]) in (2, 5)
    if name != "analysis":
        assert [*dataset.sizes] == list(frame.index.names)
        for level in frame.index.names:
            assert dataset[level].to_numpy().tolist() == frame.index.unique(level).tolist()
        for column in frame.columns:
            assert_array_equal(dataset[column].to_numpy().ravel(), frame[column].to_numpy())


@pytest.mark.slow
def test_a_table_or_package_that_is_missing_is_one_line(monkeypatch, analysis, results):
    for name, table_name, known in (("budget", "joints", "places"), ("reliability", "form", "methods")):
        with pytest.raises(pp.InputError, match=known):
            results[name].to_pandas(table_name)
    frames = [analysis.to_pandas, analysis.samples_to_pandas, *(result.to_pandas for result in results.values())]
    datasets = [one.to_xarray for one in (analysis, results["budget"], results["worst case"])]
    for package, calls in (("pandas", frames), ("xarray", datasets)):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, package, None)
            for call in calls:
                with pytest.raises(pp.InputError, match=rf"pip install 'precision-pin\[{package}\]'"):
                    call()


NAMES = (
    "joint1", "関節1", "관절", "é", "e\u0301", "ｱｲｳ", "ｅ", "ไทย", "ที่", "नमस्ते", "שָׁלוֹם", "\u1112\u1161\u11ab", "δ µ °", "🤖",
    "a\u200bb",
)  # fmt: skip


def test_columns_of_names_of_any_script_begin_alike_as_wcwidth_has_them():
    wcwidth = pytest.importorskip("wcwidth")
    for name in NAMES:
        assert width(visible(name)) == wcwidth.wcswidth(visible(name))
    lines = aligned([[name, "|"] for name in NAMES])
    assert len({wcwidth.wcswidth(line) for line in lines}) == 1


LAWS = (
    (pp.Fixed(2e-3), units.LENGTH, "fixed at 2 mm"),
    (pp.Uniform(5e-5), units.LENGTH, "uniform within ±0.05 mm"),
    (pp.Uniform(1e-6, mean=2e-5), units.LENGTH, "uniform within ±0.001 mm about 0.02 mm"),
    (pp.Triangular(1e-4, mean=0.5), units.LENGTH, "triangular within ±0.1 mm about 500 mm"),
    (pp.Arcsine(2e-3), units.ANGLE, "arcsine (a sine wave at a random phase) within ±2 mrad"),
    (pp.Normal(3e-4), units.ANGLE, "normal, standard deviation 0.3 mrad"),
    (pp.Normal(2e-5, mean=-1e-3), units.ANGLE, "normal, standard deviation 20 µrad, mean -1 mrad"),
    (pp.Normal(0.02, mean=1.0), units.MASS, "normal, standard deviation 0.02 kg, mean 1 kg"),
    (pp.TruncatedNormal(1e-3, k=2.0), units.LENGTH, "normal, standard deviation 1 mm, cut off at ±2 mm"),
    (pp.Lognormal(1e3, mean=1e4), units.ANGULAR_STIFFNESS, "lognormal, mean 10000 N·m/rad, standard deviation 1000 N·m/rad"),
    (pp.TwoPoint(1e-4, probability=0.25), units.LENGTH, "-0.1 mm or 0.1 mm, the latter with probability 25 %"),
    (
        pp.Empirical(((0.0, 0.0), (1.0, 6e-3))), units.LENGTH,
        "measured: 2 quantiles from 0 mm to 6 mm, mean 3 mm, standard deviation 1.73205 mm",
    ),
    (pp.Uniform(2.0), None, "uniform within ±2 SI"),
    (pp.Uniform(5.0, mean=5.0), units.TEMPERATURE_DIFFERENCE, "uniform within ±5 K about 5 K"),
    (pp.Normal(1e-6, mean=23e-6), units.THERMAL_EXPANSION, "normal, standard deviation 1 ppm/K, mean 23 ppm/K"),
    (pp.Uniform(1e9, mean=7e10), units.PRESSURE, "uniform within ±1 GPa about 70 GPa"),
)  # fmt: skip


def test_laws_in_words():
    for law, quantity, words in LAWS:
        assert law.describe([quantity]) == words
    mixed = [units.LENGTH, units.ANGLE]
    assert pp.Disc(1e-4).describe([units.LENGTH] * 2) == "a point uniform over a disc of radius 0.1 mm"
    assert pp.Circle(1.0).describe([units.RATIO] * 2) == "a point uniform on a circle of radius 1"
    assert pp.Sphere(5.0).describe([units.FORCE] * 3) == "a point uniform on a sphere of radius 5 N"
    assert pp.JointNormal(((4e-8, 3e-8), (3e-8, 9e-8))).describe(mixed) == (
        "2 numbers jointly normal, standard deviations 0 0.2 mm, 1 0.3 mrad, correlations up to 0.5"
    )
    assert pp.Rows(((0.0, 0.0), (2e-3, 4e-3)), ("x", "rx")).describe(mixed) == (
        "2 measured rows, all equally likely, standard deviations x 1 mm, rx 2 mrad"
    )


def test_intervals_are_rounded_outwards():
    assert bracketed(1.23456e-3, 1.24e-3) == "[1.2345, 1.2400]"
    assert bracketed(-1.2345e-3, 9.9991e-3) == "[-2, 10]"
    assert bracketed(0.0, 0.0) == "[0, 0]"
    assert bracketed(2e-3, 2e-3).count("2.0000") == 2
    generator = np.random.default_rng(8)
    for low, span in zip(generator.normal(size=200), 10.0 ** generator.uniform(-9, 1, size=200), strict=True):
        below, above = (float(end) / 1e3 for end in bracketed(low, low + span)[1:-1].split(", "))
        assert low - 0.11 * span <= below <= low * (1 + 1e-15 * np.sign(low))
        assert above >= (low + span) * (1 - 1e-15 * np.sign(low + span))
        assert above <= low + 1.11 * span


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


def contrast(*colours: str) -> float:
    """Return the contrast of two colours by WCAG 2.2."""
    parts = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in colours]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    low, high = sorted(linear @ [0.2126, 0.7152, 0.0722])
    return (high + 0.05) / (low + 0.05)


def test_text_and_lines_stand_out_from_their_ground_in_every_scheme():
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.005)  # as WCAG has it
    found = schemes()
    assert len({frozenset(colours) for colours in found.values()}) == 1
    for scheme, colours in found.items():
        for text, grounds in TEXT_ON.items():
            for ground in grounds:
                assert contrast(colours[text], colours[ground]) >= 4.5, (scheme, text, ground)
    for name in ("blue", "sky", "vermilion", "green", "purple"):
        assert contrast(found["dark"][name], found["dark"]["paper"]) >= 3
