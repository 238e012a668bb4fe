"""Known laws: quantiles and mode of the isotropic normal's norm, digits, the dictionary of the schema."""

import json
import math

import numpy as np
import pytest
from scipy.special import gammaincinv

from precision_pin.base.errors import UnknownNameError
from precision_pin.statistics import Plan, Specification, finish, observe, start
from precision_pin.statistics.digits import format_supported, significant_digits
from precision_pin.statistics.verdicts import SpecificationResult, capability_index

# norm of an isotropic 3-D normal vector, σ = 1 (chi law with three degrees of freedom)
NORM_QUANTILES = {0.5: 1.538172, 0.95: 2.795483, 0.99: 3.368214, 0.9973: 3.762480}
NORM_MEAN = 1.595769
REPEATABILITY = 3.616088  # mean + 3 standard deviations
FALSE_ALARM = 5.0  # standard errors; one in two million


def chi_density(x: float) -> float:
    return math.sqrt(2 / math.pi) * x * x * math.exp(-x * x / 2)


@pytest.fixture(scope="module")
def isotropic():
    samples = 1_000_000
    errors = np.random.default_rng(20).standard_normal((6, samples))
    plan = Plan.from_moments(np.zeros(6), np.eye(6))
    return finish(plan, observe(plan, start(plan), errors))


@pytest.mark.parametrize("p", NORM_QUANTILES)
def test_quantiles_of_the_isotropic_norm(isotropic, p: float) -> None:
    expected = NORM_QUANTILES[p]
    error = math.sqrt(p * (1 - p) / isotropic.samples) / chi_density(expected)
    for norm in (isotropic.position.norm, isotropic.attitude.norm):
        assert abs(norm.quantile(p) - expected) < FALSE_ALARM * error
        low, high = norm.quantile_interval(p)
        assert low < norm.quantile(p) < high
        # as wide as the law of order statistics says, ends moved out to bin edges
        bins = 2 * 2.0**-9 * 4
        assert 2 * 1.96 * error * 0.93 < high - low < 2 * 1.96 * error * 1.07 + bins


def test_moments_and_mode_of_the_isotropic_norm(isotropic) -> None:
    deviation = math.sqrt(3 - 8 / math.pi)
    for norm in (isotropic.position.norm, isotropic.attitude.norm):
        error = deviation / math.sqrt(isotropic.samples)
        assert abs(norm.mean - NORM_MEAN) < FALSE_ALARM * error
        assert abs(norm.mean + 3 * norm.std - REPEATABILITY) < FALSE_ALARM * 3.2 * error
        low, high = norm.mode_interval()
        assert low < math.sqrt(2) < high
        assert high - low < 0.6 * deviation
        assert norm.mode_bandwidth == pytest.approx((4 / 5) ** (1 / 7) * deviation * 1e6 ** (-1 / 7), rel=0.02)


@pytest.mark.slow
def test_an_evenly_spaced_grid_of_the_law_gives_its_quantiles_without_chance() -> None:
    samples = 200_000
    grid = (np.arange(samples) + 0.5) / samples
    errors = np.zeros((6, samples))
    errors[2] = np.sqrt(2 * gammaincinv(1.5, grid))
    plan = Plan(np.full(8, NORM_MEAN), np.full(8, 0.67))
    norm = finish(plan, observe(plan, start(plan), errors)).position.norm
    for p, expected in NORM_QUANTILES.items():
        # rank 1 + (N − 1) p of this grid lies at probability p + (1/2 − p)/N
        # and placing samples by their rank in a bin is good to half their spacing
        spacing = 1 / (samples * chi_density(expected))
        assert norm.quantile(p) == pytest.approx(expected + (0.5 - p) * spacing, abs=0.5 * spacing + 1e-5)
    # the smoothing shifts it by less than h²/2·|f‴/f″| = 0.35 h²
    assert abs(norm.mode - math.sqrt(2)) < 0.36 * norm.mode_bandwidth**2 + 1e-3


def norm_of(values: np.ndarray):
    errors = np.zeros((6, values.size))
    errors[0] = values
    plan = Plan(np.full(8, np.abs(values).mean()), np.full(8, values.std()))
    return finish(plan, observe(plan, start(plan), errors)).position.norm


def component_of(values: np.ndarray):
    errors = np.zeros((6, values.size))
    errors[0] = values
    plan = Plan(np.full(8, values.mean()), np.full(8, values.std()))
    return finish(plan, observe(plan, start(plan), errors)).position.x


def test_mode_of_a_norm_at_the_boundary_is_zero_and_not_pushed_inwards() -> None:
    norm = norm_of(np.random.default_rng(21).standard_normal(100_000))
    assert abs(norm.mode) < norm.half_width("mode")
    assert norm.mode >= 0


@pytest.mark.slow
def test_mode_of_skewed_and_of_two_lumped_laws() -> None:
    generator = np.random.default_rng(22)
    gamma = component_of(generator.gamma(5.0, 1e-3, 200_000))
    assert gamma.mode == pytest.approx(4e-3, abs=gamma.half_width("mode"))
    assert gamma.half_width("mode") < 0.3 * gamma.std
    lumps = np.where(generator.random(50_000) < 0.6, -3.0, 3.0) + generator.standard_normal(50_000)
    assert component_of(lumps).mode == pytest.approx(-3.0, abs=0.3)


@pytest.mark.slow
def test_a_law_without_peak_has_no_mode_and_few_samples_have_none() -> None:
    generator = np.random.default_rng(23)
    assert component_of(generator.uniform(-1, 1, 100_000)).mode is None
    assert component_of(generator.uniform(-1, 1, 100_000)).mode_bandwidth is None
    assert component_of(generator.standard_normal(99)).mode is None
    assert component_of(generator.standard_normal(10_000)).mode is not None
    assert component_of(generator.standard_normal(29)).resolution("mean") is None


def test_standard_error_of_the_deviation_assumes_no_normal_law() -> None:
    samples = 100_000
    generator = np.random.default_rng(24)
    # uniform of unit width: variance 1/12, fourth moment 1/80; normal: σ/√(2N)
    uniform = component_of(generator.uniform(-0.5, 0.5, samples))
    expected = 1.959964 * math.sqrt((1 / 80 - 1 / 144) / samples) / (2 / math.sqrt(12))
    assert uniform.half_width("std") == pytest.approx(expected, rel=0.02)
    normal = component_of(generator.standard_normal(samples))
    # a little wider, for tails that the samples may not show
    assert 0.98 < normal.half_width("std") * math.sqrt(2 * samples) / 1.959964 < 1.06
    assert normal.half_width("mean") == pytest.approx(1.959964 * normal.std / math.sqrt(samples), rel=1e-3)


@pytest.mark.parametrize(
    ("value", "half_width", "digits", "text"),
    [
        (3.0123, 0.004, 4, "3.012"),
        (3.0123, 0.005, 4, "3.012"),
        (3.0123, 0.0051, 3, "3.01"),
        (0.59, 0.15, 1, "0.6"),
        (37.00123456, 0.0, 6, "37.0012"),
        (1234.0, 60.0, 2, "1200"),
        (-0.0361, 0.00002, 4, "-0.03610"),
        (0.003, 0.5, 0, "0.0"),
        (-0.003, 0.05, 0, "0.00"),
        (0.0, 0.004, 0, "0.000"),
        (0.0, 0.0, 6, "0"),
        (9.996, 0.009, 3, "10.00"),
        (123456789.0, 0.1, 6, "123457000"),
    ],
)
def test_digits_end_at_the_first_uncertain_one(value: float, half_width: float, digits: int, text: str) -> None:
    assert significant_digits(value, half_width) == digits
    assert format_supported(value, half_width) == text
    if half_width > 0 and digits < 6:
        assert abs(float(text) - value) <= half_width


def test_what_is_not_resolved_is_said_to_be_so() -> None:
    assert format_supported(None, None) == "not resolved"
    assert format_supported(1.0, None) == "not resolved"
    norm = norm_of(np.random.default_rng(25).standard_normal(100))
    assert norm.resolution(0.9973) is None
    assert norm.resolution("max") == 6
    assert norm.resolution(0.5) == 1
    with pytest.raises(UnknownNameError, match="median"):
        norm.resolution("median")


def test_more_samples_resolve_more_digits(isotropic) -> None:
    # 1.5387 ± 0.0018 and 3.762 ± 0.015
    assert isotropic.position.norm.resolution(0.5) == 4
    assert isotropic.position.norm.resolution(0.9973) == 3


def test_dictionary_has_exactly_the_keys_of_the_schema() -> None:
    errors = np.random.default_rng(26).standard_normal((6, 1300)) * 1e-3
    plan = Plan(np.zeros(8), np.full(8, 1e-3), (Specification("attitude.norm", 1e-3, 0.9),))
    summary = finish(plan, observe(plan, start(plan), errors))
    read = json.loads(json.dumps(summary.to_dict(), allow_nan=False))
    assert set(read) == {
        "samples", "confidence", "position", "attitude", "covariance", "covariance_interval", "spec",
    }  # fmt: skip
    for vector in ("position", "attitude"):
        assert list(read[vector]) == ["norm", "x", "y", "z"]
        for part, entry in read[vector].items():
            assert list(entry) == [
                "mean",
                "std",
                "min",
                "max",
                "mode",
                "quantiles",
                "quantile_interval",
                "quantile_error",
                "mean_interval",
                "std_interval",
                "mode_interval",
                "tolerance_bounds",
            ]
            assert list(entry["tolerance_bounds"]) == ["0.95", "0.99", "0.9973"]
            # Wilks: one-sided bounds need 1108 samples, two-sided ones 1756
            assert (entry["tolerance_bounds"]["0.9973"] is None) == (part != "norm")
            for statistic in ("mean", "std"):
                low, high = entry[f"{statistic}_interval"]
                assert low < entry[statistic] < high
            common = ["0.5", "0.95", "0.99", "0.9973"]
            assert list(entry["quantiles"]) == (common if part == "norm" else ["0.00135", "0.01", "0.05", *common])
            assert list(entry["quantile_interval"]) == list(entry["quantiles"])
            assert entry["quantiles"]["0.9973"] is None
            assert entry["quantile_interval"]["0.9973"] is None
            low, high = entry["quantile_interval"]["0.5"]
            assert low < entry["quantiles"]["0.5"] < high
    assert set(read["spec"][0]) == {
        "quantity", "limit", "required", "probability", "interval", "met", "verdict", "judged",
            "why_not_judged", "taken_as_exact",
        "cpk", "cpk_interval",
    }  # fmt: skip
    assert np.shape(read["covariance"]) == (6, 6)
    assert np.shape(read["covariance_interval"]) == (6, 6, 2)
    assert read["covariance"][0][0] == pytest.approx(read["position"]["x"]["std"] ** 2, rel=1e-12)


def test_the_capability_index_is_that_of_the_share_inside():
    """Published: Cpk 1 leaves 1350 per million beyond one limit, 1.33 31.7 (Z = 4), 1.67 0.287 (Z = 5); 0 a half."""
    for cpk, beyond in ((1.0, 1349.898e-6), (4 / 3, 31.671e-6), (5 / 3, 0.28665e-6), (0.0, 0.5)):
        assert capability_index(1 - beyond) == pytest.approx(cpk, abs=2e-6)
    assert capability_index(1.0) == math.inf
    assert capability_index(0.0) == -math.inf
    all_inside = SpecificationResult("position.norm", 1e-3, 0.95, 1.0, (0.9999, 1.0))
    assert all_inside.to_dict()["cpk"] is None
    assert all_inside.to_dict()["cpk_interval"] == [pytest.approx(3.71902 / 3, abs=1e-5), None]
