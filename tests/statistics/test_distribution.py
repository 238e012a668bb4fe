"""Known laws: quantiles and mode, the dictionary of the schema; printed numbers lie inside their intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import gammaincinv

from precision_pin.analyses.monte_carlo.table import statistic, tolerance_bounds
from precision_pin.base.errors import UnknownNameError
from precision_pin.statistics import (
    QUANTITIES,
    Distribution,
    Plan,
    finish,
    format_inside,
    observe,
    quantity_values,
    start,
)
from precision_pin.statistics.distribution import CONTENTS
from precision_pin.statistics.intervals import format_interval, format_supported, round_end, significant_digits
from precision_pin.statistics.summary import SpecificationResult, capability_index

# norm of an isotropic 3-D normal vector, σ = 1 (chi law with three degrees of freedom)
NORM_QUANTILES = {0.5: 1.538172, 0.95: 2.795483, 0.99: 3.368214, 0.9973: 3.762480}
NORM_MEAN = 1.595769
REPEATABILITY = 3.616088  # mean + 3 standard deviations
FALSE_ALARM = 5.0  # standard errors; one in two million


def test_the_error_of_a_quantile_by_hand() -> None:
    """Two samples each in bins 0 to 1 and 10 to 30: the second lies at 0.75 and the third at 15, as far as is known."""
    bins = (np.array([0.0, 10.0]), np.array([1.0, 30.0]), np.array([2, 4]))
    found = Distribution("position.x", 4, 0.5, 11.0, 10.0, 0.0, 30.0, *bins)
    assert found.quantile(0.5) == pytest.approx((0.75 + 15) / 2)
    assert found.quantile_error(0.5) == pytest.approx((0.75 + 15) / 2)


def chi_density(x: float) -> float:
    return math.sqrt(2 / math.pi) * x * x * math.exp(-x * x / 2)


def test_quantiles_moments_and_mode_of_the_isotropic_norm() -> None:
    samples = 250_000
    errors = np.random.default_rng(20).standard_normal((6, samples))
    plan = Plan.from_moments(np.zeros(6), np.eye(6))
    summary = finish(plan, observe(plan, start(plan), errors))
    deviation = math.sqrt(3 - 8 / math.pi)
    for norm in (summary.position.norm, summary.attitude.norm):
        for p, expected in NORM_QUANTILES.items():
            error = math.sqrt(p * (1 - p) / samples) / chi_density(expected)
            assert abs(norm.quantile(p) - expected) < FALSE_ALARM * error
            low, high = norm.quantile_interval(p)
            assert low < norm.quantile(p) < high
            # as wide as the law of order statistics says to what chance leaves of it, ends moved out to bin edges
            bins = 2 * 2.0**-9 * 4
            assert 2 * 1.96 * error * 0.86 < high - low < 2 * 1.96 * error * 1.14 + bins
        error = deviation / math.sqrt(samples)
        assert abs(norm.mean - NORM_MEAN) < FALSE_ALARM * error
        assert abs(norm.mean + 3 * norm.std - REPEATABILITY) < FALSE_ALARM * 3.2 * error
        low, high = norm.mode_interval()
        assert low < math.sqrt(2) < high
        assert high - low < 0.6 * deviation
        assert norm.mode_bandwidth == pytest.approx((4 / 5) ** (1 / 7) * deviation * samples ** (-1 / 7), rel=0.02)


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


def summary_of(values: np.ndarray):
    errors = np.zeros((6, values.size))
    errors[0] = values
    plan = Plan(np.full(8, np.abs(values).mean()), np.full(8, values.std()))
    return finish(plan, observe(plan, start(plan), errors)).position


def test_mode_of_a_norm_at_the_boundary_is_zero_and_of_two_lumps_the_higher_and_few_samples_have_none() -> None:
    norm = summary_of(np.random.default_rng(21).standard_normal(100_000)).norm
    assert 0 <= norm.mode < norm.half_width("mode")
    generator = np.random.default_rng(22)
    lumps = np.where(generator.random(50_000) < 0.6, -3.0, 3.0) + generator.standard_normal(50_000)
    assert summary_of(lumps).x.mode == pytest.approx(-3.0, abs=0.3)
    assert summary_of(generator.standard_normal(99)).x.mode is None
    assert summary_of(generator.standard_normal(10_000)).x.mode is not None
    assert summary_of(generator.standard_normal(29)).x.resolution("mean") is None


@pytest.mark.parametrize(
    ("value", "half_width", "digits", "text"),
    [
        (3.0123, 0.005, 4, "3.012"),
        (3.0123, 0.0051, 3, "3.01"),
        (0.59, 0.15, 1, "0.6"),
        (37.00123456, 0.0, 6, "37.0012"),
        (1234.0, 60.0, 2, "1200"),
        (-0.0361, 0.00002, 4, "-0.03610"),
        (-0.003, 0.05, 0, "0.00"),
        (0.0, 0.004, 0, "0.000"),
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
    norm = summary_of(np.random.default_rng(25).standard_normal(100)).norm
    assert [norm.resolution(which) for which in (0.9973, "max", 0.5)] == [None, 6, 1]
    with pytest.raises(UnknownNameError, match="median"):
        norm.resolution("median")


def test_the_capability_index_is_that_of_the_share_inside():
    """Published: Cpk 1 leaves 1350 per million beyond one limit, 1.33 31.7 (Z = 4), 1.67 0.287 (Z = 5); 0 a half."""
    for cpk, beyond in ((1.0, 1349.898e-6), (4 / 3, 31.671e-6), (5 / 3, 0.28665e-6), (0.0, 0.5)):
        assert capability_index(1 - beyond) == pytest.approx(cpk, abs=2e-6)
    assert capability_index(1.0) == math.inf
    assert capability_index(0.0) == -math.inf
    all_inside = SpecificationResult("position.norm", 1e-3, 0.95, 1.0, (0.9999, 1.0))
    assert all_inside.to_dict()["cpk"] is None
    assert all_inside.to_dict()["cpk_interval"] == [pytest.approx(3.71902 / 3, abs=1e-5), None]


@pytest.mark.parametrize(
    ("value", "interval", "text"),
    [
        (36.862, (36.850, 36.874), "36.86"),
        # rounding to 36.9 would pass the nearer end: one more digit
        (36.862, (36.7, 36.88), "36.86"),
        (1.4142, (1.4141, 1.52), "1.4142"),
        (-0.0361, (-0.03612, -0.03608), "-0.03610"),
        (0.0, (0.0, 0.3), "0.0"),
        (2.0, (2.0, 2.0), "2.00000"),
        # known better than rounding: printed as exact
        (2 / 3, (2 / 3 - 1e-12, 2 / 3 + 1e-12), "0.666667"),
        # known to eight digits: all of them are printed
        (37.69123456, (37.6912340, 37.6912351), "37.691235"),
        (None, None, "not resolved"),
    ],
)
def test_digits_are_added_until_the_number_is_inside(value, interval, text) -> None:
    assert format_inside(value, interval) == text
    if interval is not None and interval[1] - interval[0] > 1e-9:
        assert interval[0] <= float(text) <= interval[1]


@pytest.mark.slow
def test_any_number_is_printed_inside_any_interval_that_holds_it() -> None:
    random = np.random.default_rng(1)
    for _ in range(2000):
        value = random.normal() * 10.0 ** random.integers(-6, 7)
        below, above = abs(value) * 10.0 ** random.uniform(-7, 1, 2)
        interval = (value - below, value + above)
        printed = format_inside(value, interval)
        assert interval[0] <= float(printed) <= interval[1], (value, interval)
        # no more digits than needed: one less is outside, or supported by no half of the interval
        digits = len(printed.partition(".")[2])
        if digits and max(below, above) > 5 * 10.0**-digits * (1 + 1e-9):
            assert not interval[0] <= round(value, digits - 1) <= interval[1]


@pytest.mark.slow
@pytest.mark.parametrize("samples", [40, 120, 5000])
def test_every_cell_of_the_table_lies_in_its_interval_and_bounds_are_rounded_outwards(samples) -> None:
    random = np.random.default_rng(samples)
    errors = 1e-3 * np.stack([
        random.standard_exponential(samples), random.standard_t(4, samples), random.uniform(-1, 1, samples),
        37 + random.standard_normal(samples), 1e-3 * random.lognormal(0, 1, samples),
        (random.random(samples) < 0.3) / 3,
    ])  # fmt: skip
    plan = Plan.from_pilot(quantity_values(errors[:, :512]), np.zeros(6))
    found = finish(plan, observe(plan, start(plan), errors))
    for distribution in map(found.distribution, QUANTITIES):
        for which in ("mean", "std", "mode", *distribution.levels):
            interval, printed = distribution.interval(which), statistic(distribution, which)
            assert (printed == "-") == (interval is None)
            # of two values a quantile is one of them, known exactly: five digits
            if interval is not None and interval[1] - interval[0] > 1e-9 * abs(interval[1]):
                assert interval[0] <= 1e-3 * float(printed) <= interval[1]
        for content in CONTENTS:
            bounds, printed = distribution.tolerance_bounds(content), tolerance_bounds(distribution, content)
            assert (printed == "-") == (bounds is None)
            if bounds is not None:
                ends = [1e-3 * float(end) for end in printed.split(" to ")]
                tiny = 1e-15 * abs(ends[-1])
                assert ends[-1] >= bounds[1] - tiny
                assert ends[-1] - bounds[1] <= max(0.11 * distribution.std, 1e-4 * abs(bounds[1]))
                assert distribution.is_norm or ends[0] <= bounds[0] + tiny


def test_ends_of_an_interval_are_rounded_outwards():
    """By hand: two digits of the width 0.0468 are thousandths; of an interval of no width five digits are left."""
    assert format_interval(3.8324, 3.8792) == ("3.832", "3.880")
    assert format_interval(-1.0, 1.0) == ("-1.0", "1.0")
    assert format_interval(0.25, 0.25, 2.0) == ("0.500000", "0.500000")
    generator = np.random.default_rng(1)
    for low, width in generator.uniform(0.0, 1.0, (200, 2)):
        below, above = (float(end) for end in format_interval(low, low + width))
        assert below <= low
        assert above >= low + width
        assert above - below <= 1.2 * width


def test_ends_and_bounds_are_rounded_to_digits_in_their_direction():
    """By hand; a decimal such as 0.3 that binary numbers miss is kept."""
    assert round_end(0.04658, 2, up=True) == 0.047
    assert round_end(0.04658, 2, up=False) == 0.046
    assert round_end(-5.104151, 6, up=False) == -5.10416
    assert round_end(-5.104159, 6, up=True) == -5.10415
    assert round_end(9.5e-13, 1, up=True) == 1e-12
    for exact in (0.3, 3e-5, 1e-300, 7.0):
        assert round_end(exact, 1, up=True) == round_end(exact, 1, up=False) == exact
