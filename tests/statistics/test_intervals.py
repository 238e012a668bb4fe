"""Intervals by exact binomial sums and of hard laws, and how often they hold the truth; known laws; printed digits."""

import importlib
import json
import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaincinv

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.sampling.table import statistic, tolerance_bounds
from precision_pin.statistics import (
    QUANTITIES,
    Distribution,
    Plan,
    Specification,
    Summary,
    clopper_pearson,
    finish,
    format_inside,
    observe,
    quantile_ranks,
    quantity_values,
    start,
)
from precision_pin.statistics.distribution import CONTENTS
from precision_pin.statistics.intervals import (
    format_interval,
    format_supported,
    round_end,
    significant_digits,
    tolerance_ranks,
    upper_bound_rank,
)
from precision_pin.statistics.summary import SpecificationResult, capability_index


def at_most(k: int, samples: int, p: Fraction) -> Fraction:
    return sum((math.comb(samples, i) * p**i * (1 - p) ** (samples - i) for i in range(k + 1)), Fraction(0))


def test_quantile_ranks_are_the_tightest_of_equal_tails() -> None:
    tail = Fraction(1, 40)
    for samples, p in ((100, Fraction("1/2")), (80, Fraction("1/20")), (300, Fraction("49/50")), (7, Fraction("1/2"))):
        lower, upper = quantile_ranks(samples, float(p), 0.95)
        assert at_most(lower - 1, samples, p) <= tail < at_most(lower, samples, p)
        assert 1 - at_most(upper - 1, samples, p) <= tail < 1 - at_most(upper - 2, samples, p)
    for p in (0.00135, 0.05, 0.5, 0.95, 0.9973):
        # the largest of N lies above the p-quantile unless all N are below: p^N; both tails need α/2
        first = max(math.ceil(math.log(0.025) / math.log(max(p, 1 - p))), 1)
        assert quantile_ranks(first - 1, p, 0.95) is None
        assert quantile_ranks(first, p, 0.95) is not None


def test_ranks_and_sample_sizes_published() -> None:
    # David and Nagaraja: the median of ten lies between the second and the ninth, 1 − 2·(1 + 10)/2¹⁰ = 0.978515625
    assert quantile_ranks(10, 0.5, 0.95) == (2, 9)
    # NIST/SEMATECH e-Handbook 7.2.4.1: 4 defects in 20, two-sided 90 % (its last digit is rounded up)
    assert clopper_pearson(4, 20, 0.9) == pytest.approx((0.071354, 0.401029), abs=1e-6)
    # Wilks
    for content, one_sided, two_sided in ((0.95, 59, 93), (0.99, 299, 473), (0.9973, 1109, 1756)):
        assert upper_bound_rank(one_sided - 1, content, 0.95) is None
        assert upper_bound_rank(one_sided, content, 0.95) == one_sided
        assert tolerance_ranks(two_sided - 1, content, 0.95) is None
        assert tolerance_ranks(two_sided, content, 0.95) == (1, two_sided)


def test_wilks_sample_sizes_decide_what_a_summary_gives() -> None:
    values = np.random.default_rng(1).standard_normal((6, 93)) * 1e-3
    plan = Plan(np.zeros(8), np.full(8, 1e-3))
    at = {n: finish(plan, observe(plan, start(plan), values[:, :n])).position for n in (58, 59, 71, 72, 92, 93)}
    assert at[58].norm.quantile_upper_bound(0.95) is at[58].norm.tolerance_bounds(0.95) is None
    assert at[59].norm.quantile_upper_bound(0.95) == at[59].norm.max
    assert at[59].norm.tolerance_bounds(0.95) == (0.0, at[59].norm.max)
    assert at[92].x.tolerance_interval(0.95) is at[92].x.tolerance_bounds(0.95) is None
    ends = at[93].x.min, at[93].x.max
    assert at[93].x.tolerance_interval(0.95) == at[93].x.tolerance_bounds(0.95) == ends
    assert at[71].norm.resolved_quantile(0.95) is at[71].norm.quantile_interval(0.95) is None
    with pytest.raises(
        InputError, match=r"71 samples do not resolve the 95 % quantile of position\.norm .* it takes 72$"
    ):
        at[71].norm.quantile([0.5, 0.95])
    norm = at[72].norm
    assert norm.quantile([0.5, 0.95]).tolist() == [norm.resolved_quantile(0.5), norm.quantile(0.95)]
    assert at[72].norm.quantile_interval(0.95)[1] == at[72].norm.max


def test_tolerance_ranks_move_inwards_as_samples_allow() -> None:
    # Beta(N + 1 − 2r, 2r) as a binomial: content ≤ β iff at least N + 1 − 2r of N fall inside
    lower, upper = tolerance_ranks(400, 0.9, 0.95)
    assert upper == 401 - lower
    p = Fraction(9, 10)
    assert at_most(400 - 2 * lower, 400, p) >= Fraction(19, 20) > at_most(400 - 2 * (lower + 1), 400, p)


def test_clopper_pearson_has_its_closed_form_at_none_and_all_and_leaves_half_alpha_between() -> None:
    for samples, confidence in ((1, 0.95), (20, 0.9), (1_000_000, 0.99)):
        tail = (1 - confidence) / 2
        lower, upper = clopper_pearson(0, samples, confidence)
        assert (lower, upper) == (0.0, pytest.approx(-math.expm1(math.log(tail) / samples), rel=1e-12))
        lower, upper = clopper_pearson(samples, samples, confidence)
        assert (lower, upper) == (pytest.approx(math.exp(math.log(tail) / samples), rel=1e-12), 1.0)
    for inside, samples in ((4, 20), (1, 3), (97, 100)):
        lower, upper = clopper_pearson(inside, samples, 0.95)
        assert float(1 - at_most(inside - 1, samples, Fraction(lower))) == pytest.approx(0.025, rel=1e-10)
        assert float(at_most(inside, samples, Fraction(upper))) == pytest.approx(0.025, rel=1e-10)


def test_a_specification_is_met_when_the_lower_end_reaches_it() -> None:
    # 59 of 59 inside: lower end 0.025^(1/59) = 0.93940
    errors = np.linspace(0, 1e-6, 6 * 59).reshape(6, 59)  # what does not vary is not judged
    specifications = tuple(Specification("position.norm", 1e-3, required) for required in (0.9393, 0.9395))
    plan = Plan(np.zeros(8), np.ones(8), specifications)
    found = finish(plan, observe(plan, start(plan), errors)).specifications
    assert [(one.probability, one.met) for one in found] == [(1.0, True), (1.0, False)]
    assert found[0].interval[0] == pytest.approx(0.025 ** (1 / 59), rel=1e-12)


def test_levels_outside_zero_to_one_are_refused() -> None:
    norm = summary_of(np.zeros((6, 2))).position.norm
    for p in (0.0, 1.0, 95, -0.1, math.nan):
        for ask in (norm.quantile, norm.quantile_interval, norm.quantile_upper_bound, norm.tolerance_interval):
            with pytest.raises(InputError, match="above 0 and below 1"):
                ask(p)


def summary_of(errors: np.ndarray, skewness: float = math.nan) -> Summary:
    plan = Plan.from_pilot(quantity_values(errors[:, :512]), np.zeros(6))
    plan = Plan(plan.centre, plan.scale, skewness=np.full((8, 2), skewness))
    return finish(plan, observe(plan, start(plan), errors))


def component_of(values: np.ndarray, skewness: float = math.nan) -> Distribution:
    return summary_of(np.outer(np.eye(6)[0], values), skewness).position.x


def test_of_two_values_equally_likely_the_deviation_has_an_interval_that_holds_it() -> None:
    """s² = p̂ (1 - p̂) is at most 1/4, the truth: an interval from the scatter of squares alone has no width at all."""
    for seed in range(20):
        values = (np.random.default_rng(seed).random(2000) < 0.5).astype(float)
        low, high = component_of(values).std_interval()
        share = abs(values.mean() - 0.5)
        assert low <= math.sqrt(0.25 - share**2) <= high < low + 2e-3
        # the mean lies within 1.96 standard errors in 95 of 100 samples
        assert (low <= 0.5 <= high) or share > 1.9 * 0.5 / math.sqrt(2000)


def test_the_interval_of_a_skewed_mean_leans_to_the_tail_as_the_chance_of_the_tail_does() -> None:
    """The mean of N exponential numbers is gamma (N): an exact interval to compare with."""
    values = np.random.default_rng(3).standard_exponential(400)
    low, high = component_of(values).mean_interval()
    # to a fifth of the difference that skewness makes, beside a standard deviation that is not known
    shift = (400 / stats.gamma(400).ppf([0.975, 0.025])).mean() - 1
    assert shift > 0
    assert ((low + high) / 2 - values.mean()) / values.std() == pytest.approx(shift, rel=0.6)


def test_of_a_heavy_tail_no_deviation_is_given_or_a_wide_interval() -> None:
    for law in (stats.t(2.5), stats.lognorm(0.8326), stats.pareto(3)):
        given = 0
        for seed in range(15):
            found = component_of(law.rvs(3000, random_state=np.random.default_rng(seed)))
            ends = found.std_interval()
            given += ends is not None
            assert ends is None or ends[0] <= law.std() <= ends[1]
            assert found.mean_interval() is None or found.mean_interval()[0] < found.mean < found.mean_interval()[1]
        assert given <= 2, law.dist.name


def test_skewness_that_the_laws_have_counts_though_no_sample_shows_it() -> None:
    values = np.random.default_rng(5).standard_normal(10_000)
    seen = component_of(values)
    for known in (0.0, 10.0):
        found = component_of(values, known)
        assert found.mean_interval()[0] <= seen.mean_interval()[0]
        assert found.std_interval()[1] >= seen.std_interval()[1]
    found = component_of(values, 45.0)
    assert found.mean_interval() is found.std_interval() is None
    # 45/√10,000 = 0.45; of 40,000 such numbers the mean is no more skewed than of those of a tenth as many light ones
    assert component_of(np.tile(values, 4), 45.0).mean_interval() is not None


def test_no_deviation_has_an_interval_below_a_thousand_samples_and_no_mean_below_thirty() -> None:
    values = np.random.default_rng(6).uniform(-1, 1, 1000)
    assert [component_of(values[:n]).std_interval() is None for n in (999, 1000)] == [True, False]
    assert [component_of(values[:n]).mean_interval() is None for n in (29, 30)] == [True, False]


def test_intervals_of_covariances() -> None:
    """Of normal numbers Var c = (1 + ρ²) σ⁴/N; the bound from fourth moments is (3 - ρ²) σ⁴/N."""
    samples = 50_000
    random = np.random.default_rng(7)
    x, y = random.standard_normal((2, samples))
    errors = np.stack([x, 0.6 * x + 0.8 * y, 2 * x, y, np.zeros(samples), random.standard_t(2.5, samples)])
    found = summary_of(errors)
    ends = found.covariance_interval
    np.testing.assert_array_equal(ends, ends.transpose(1, 0, 2))
    for i, j, rho, spreads in ((0, 1, 0.6, 1.0), (0, 3, 0.0, 1.0), (0, 2, 1.0, 2.0), (1, 2, 0.6, 2.0)):
        low, high = ends[i, j]
        half = 1.96 * math.sqrt((3 - rho**2) / samples) * spreads
        assert low <= rho * spreads <= high
        assert (high - low) / 2 == pytest.approx(half, rel=0.06)
        assert low <= found.covariance[i, j] <= high
    np.testing.assert_allclose(ends[0, 0], np.square(found.position.x.std_interval()), rtol=1e-12)
    np.testing.assert_allclose(ends[0, 2], 2 * ends[0, 0], rtol=2e-3)
    # the constant and the heavy tail
    assert np.isnan(ends[4:]).all()
    # the covariance of components that are known to be still is known to be zero
    still = summary_of(np.outer(np.eye(6)[0], x[:1000]), 0.0).covariance_interval
    assert (still[0, 0] > 0).all()
    assert not still[1:].any()


@pytest.mark.slow
def test_of_unequal_spreads_the_interval_holds_the_mode() -> None:
    """Spreads 1, 0.2, 0.1: smoothing shifts the peak by several of the standard errors that were given for it."""
    spreads = np.array([1.0, 0.2, 0.1])
    # the density of |d|, by quadrature over the directions of the sphere (Gauss-Legendre, trapezium)
    cosine, weight = np.polynomial.legendre.leggauss(100)
    turn = np.exp(2j * math.pi * np.arange(100) / 100)[:, None] * np.sqrt(1 - cosine**2)
    exponent = ((cosine / spreads[0]) ** 2 + (turn.real / spreads[1]) ** 2 + (turn.imag / spreads[2]) ** 2) / 2
    radii = np.linspace(1e-3, 2, 1000)
    truth = radii[np.argmax([r**2 * (np.exp(-(r**2) * exponent) @ weight).sum() for r in radii])]
    for seed in range(8):
        errors = np.zeros((6, 30_000))
        errors[:3] = np.random.default_rng(seed).standard_normal((3, 30_000)) * spreads[:, None]
        found = summary_of(errors).position.norm
        low, high = found.mode_interval()
        assert low <= truth <= high
        assert low <= found.mode <= high
        assert high - low < found.std


@pytest.mark.fast(2)
@pytest.mark.parametrize(
    ("law", "truth"),
    [
        (stats.norm(), 0.0), (stats.gamma(2), 1.0), (stats.lognorm(0.8326), math.exp(-(0.8326**2))),
        (stats.t(3), 0.0), (stats.triang(0.9), 0.9), (stats.laplace(), 0.0),
    ],
    ids=["normal", "gamma", "lognormal", "t", "triangular", "Laplace"],
)  # fmt: skip
def test_of_laws_with_one_peak_the_interval_holds_it(law, truth) -> None:
    for seed in range(5):
        low, high = component_of(law.rvs(30_000, random_state=np.random.default_rng(seed))).mode_interval()
        assert low <= truth <= high


@pytest.mark.parametrize("samples", [500, pytest.param(20_000, marks=pytest.mark.slow)])
def test_laws_without_a_single_peak_have_no_mode(samples) -> None:
    """Of two peaks alike one is taken for the higher one as often as their counts differ significantly by chance."""
    for law in (stats.uniform(), stats.expon(), stats.chi2(1), stats.arcsine(), stats.powerlaw(2), None):
        wrong = 0
        for seed in range(20 if law is None or samples == 500 else 5):
            random = np.random.default_rng(seed)
            if law is None:
                values = np.where(random.random(samples) < 0.5, -3, 3) + random.standard_normal(samples)
            else:
                values = law.rvs(samples, random_state=random)
            found = component_of(values)
            assert (found.mode is None) == (found.mode_interval() is None) == (found.mode_bandwidth is None)
            wrong += found.mode is not None
        # 5 % of 20, exceeded by chance once in 400
        assert wrong <= (4 if law is None else 0), law


def test_a_spike_beside_a_hill_leaves_the_mode_open() -> None:
    """One in ten within a hundredth of a spread: the density is highest there, the smoothed histogram elsewhere."""
    random = np.random.default_rng(4)
    values = np.where(random.random(100_000) < 0.03, 2 + 1e-4 * random.standard_normal(100_000), 0.0)
    values += np.where(values == 0, random.standard_normal(100_000), 0.0)
    assert component_of(values).mode is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "samples", "runs"),
    [
        ("normal", 1000, 200),
        ("lognormal 20 %", 1000, 200),
        ("two values, 50:50", 1000, 200),
        ("two peaks alike", 20_000, 60),
    ],
)
def test_every_interval_of_a_summary_holds_the_truth_or_is_not_given(name, samples, runs, monkeypatch) -> None:
    """As in the documentation's table, with fewer runs: each may fall short of 94 % by chance in one of a hundred tries."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))
    sampling = importlib.import_module("benchmarks.coverage.sampling")
    rows = sampling.of_law(name, samples, runs)
    assert {row.interval for row in rows} >= {"mean", "standard deviation", "mode", "digits printed", "specification"}
    for row in rows:
        assert row.passes, row
        assert row.interval != "digits printed" or row.held == row.given


def test_the_table_of_coverage_tells_what_was_not_given(monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))
    row = importlib.import_module("benchmarks.coverage.row")
    rows = [
        row.Coverage("mean", "normal", "closed form", 1000, 1000, 951),
        row.Coverage("mode", "normal", "closed form", 1000, 0, 0),
        row.Coverage("mean", "heavy, 300 samples", "quadrature", 1000, 1000, 980),
        row.Coverage("mean", "heavy, 1,000 samples", "quadrature", 1000, 40, 39),
        row.Coverage("worst case: bound", "sheets", "vertices", 50, 50, 50),
    ]
    lines = row.cells(rows)
    assert row.as_csv({"Part": lines}).splitlines()[1:] == [
        "Part,,mean,normal,1000,95.1",
        "Part,,mode,normal,1000,-",
        "Part,,mean,heavy,2000,97.5*",
        "Part,worst case,bound,sheets,50,100.0",
    ]
    table = ["| mean | 2 | 95.1 | normal |", "| mode | 1 | - | normal |", "", "100 % in all cases: worst case: bound."]
    assert row.as_markdown(lines).splitlines()[2:] == table
    assert [one.passes for one in rows] == [True] * len(rows)
    assert not row.Coverage("mean", "short", "closed form", 10_000, 10_000, 9_300).passes


# norm of an isotropic 3-D normal vector, σ = 1 (chi law with three degrees of freedom)


# norm of an isotropic 3-D normal vector, σ = 1 (chi law with three degrees of freedom)
NORM_QUANTILES = {0.5: 1.538172, 0.95: 2.795483, 0.99: 3.368214, 0.9973: 3.762480}


def test_the_error_of_a_quantile_by_hand() -> None:
    """Two samples each in bins 0 to 1 and 10 to 30: the second lies at 0.75 and the third at 15, as far as is known."""
    bins = (np.array([0.0, 10.0]), np.array([1.0, 30.0]), np.array([2, 4]))
    found = Distribution("position.x", 4, 0.5, 11.0, 10.0, 0.0, 30.0, *bins)
    assert found.quantile(0.5) == pytest.approx((0.75 + 15) / 2)
    assert found.quantile_error(0.5) == pytest.approx((0.75 + 15) / 2)


def test_quantiles_moments_and_mode_of_the_isotropic_norm_on_a_grid_of_its_law() -> None:
    samples = 200_000
    grid = np.sqrt(2 * gammaincinv(1.5, (np.arange(samples) + 0.5) / samples))
    norm = summary_of(np.outer(np.eye(6)[2], np.random.default_rng(20).permutation(grid))).position.norm
    for p, expected in NORM_QUANTILES.items():
        # rank 1 + (N − 1) p of this grid lies at probability p + (1/2 − p)/N
        # and placing samples by their rank in a bin is good to half their spacing
        spacing = 1 / (samples * math.sqrt(2 / math.pi) * expected**2 * math.exp(-(expected**2) / 2))
        assert norm.quantile(p) == pytest.approx(expected + (0.5 - p) * spacing, abs=0.5 * spacing + 1e-5)
        low, high = norm.quantile_interval(p)
        assert low < norm.quantile(p) < high
        # as wide as the law of order statistics says, ends moved out to bin edges
        error, bins = math.sqrt(p * (1 - p) * samples) * spacing, 2 * 2.0**-9 * 4
        assert 2 * 1.96 * error * 0.95 < high - low < 2 * 1.96 * error * 1.05 + bins
    deviation = math.sqrt(3 - 8 / math.pi)
    # the grid leaves out of the tail what adds to the moments
    assert norm.mean == pytest.approx(math.sqrt(8 / math.pi), rel=1e-5)
    assert norm.std == pytest.approx(deviation, rel=1e-4)
    assert norm.mode_bandwidth == pytest.approx((4 / 5) ** (1 / 7) * deviation * samples ** (-1 / 7), rel=0.02)
    # the smoothing shifts it by less than h²/2·|f‴/f″| = 0.35 h²
    assert abs(norm.mode - math.sqrt(2)) < 0.36 * norm.mode_bandwidth**2 + 1e-3
    low, high = norm.mode_interval()
    assert low < math.sqrt(2) < high
    assert high - low < 0.7 * deviation


def test_mode_of_a_norm_at_the_boundary_is_zero_and_of_two_lumps_the_higher_and_few_samples_have_none() -> None:
    generator = np.random.default_rng(22)
    norm = summary_of(np.outer(np.eye(6)[0], generator.standard_normal(100_000))).position.norm
    assert 0 <= norm.mode < norm.half_width("mode")
    lumps = np.where(generator.random(50_000) < 0.6, -3.0, 3.0) + generator.standard_normal(50_000)
    assert component_of(lumps).mode == pytest.approx(-3.0, abs=0.3)
    few = [component_of(generator.standard_normal(n)) for n in (29, 99, 10_000)]
    assert [(one.mode is None, one.resolution("mean") is None) for one in few] == [
        (True, True),
        (True, False),
        (False, False),
    ]


def test_digits_end_at_the_first_uncertain_one() -> None:
    for value, half_width, digits, text in (
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
    ):
        assert (significant_digits(value, half_width), format_supported(value, half_width)) == (digits, text)


def test_what_is_not_resolved_is_said_to_be_so() -> None:
    assert format_supported(None, None) == format_supported(1.0, None) == "not resolved"
    norm = summary_of(np.outer(np.eye(6)[0], np.random.default_rng(25).standard_normal(100))).position.norm
    assert [norm.resolution(which) for which in (0.9973, "max", 0.5)] == [None, 6, 1]
    with pytest.raises(UnknownNameError, match="median"):
        norm.resolution("median")


def test_dictionary_has_exactly_the_keys_of_the_schema() -> None:
    errors = np.random.default_rng(26).standard_normal((6, 1300)) * 1e-3
    plan = Plan(np.zeros(8), np.full(8, 1e-3), (Specification("attitude.norm", 1e-3, 0.9),))
    read = json.loads(json.dumps(finish(plan, observe(plan, start(plan), errors)).to_dict(), allow_nan=False))
    norm, x, common = read["attitude"]["norm"], read["attitude"]["x"], "0.5 0.95 0.99 0.9973"
    statistics = (
        "mean std min max mode quantiles quantile_interval quantile_error mean_interval std_interval mode_interval"
    )
    judged = "quantity limit required probability interval met verdict judged why_not_judged"
    for part, keys in (
        (read, "samples confidence position attitude covariance covariance_interval spec"),
        (read["position"], "norm x y z"),
        (x, f"{statistics} tolerance_bounds"),
        (norm["quantiles"], common),
        (x["quantiles"], f"0.00135 0.01 0.05 {common}"),
        (x["quantile_interval"], f"0.00135 0.01 0.05 {common}"),
        (read["spec"][0], f"{judged} taken_as_exact linear_model cpk cpk_interval"),
    ):
        assert " ".join(part) == keys
    # Wilks: one-sided bounds need 1108 samples, two-sided ones 1756
    assert [one["tolerance_bounds"]["0.9973"] is None for one in (norm, x)] == [False, True]
    assert norm["quantiles"]["0.9973"] is norm["quantile_interval"]["0.9973"] is None
    assert np.shape(read["covariance_interval"]) == (6, 6, 2)


def test_the_capability_index_is_that_of_the_share_inside():
    """Published: Cpk 1 leaves 1350 per million beyond one limit, 1.33 31.7 (Z = 4), 1.67 0.287 (Z = 5); 0 a half."""
    found = [capability_index(1 - beyond) for beyond in (1349.898e-6, 31.671e-6, 0.28665e-6, 0.5, 0.0, 1.0)]
    assert found == pytest.approx([1, 4 / 3, 5 / 3, 0, math.inf, -math.inf], abs=2e-6)
    told = SpecificationResult("position.norm", 1e-3, 0.95, 1.0, (0.9999, 1.0)).to_dict()
    assert (told["cpk"], told["cpk_interval"]) == (None, [pytest.approx(3.71902 / 3, abs=1e-5), None])


def test_digits_are_added_until_the_number_is_inside() -> None:
    for value, interval, text in (
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
    ):
        assert format_inside(value, interval) == text


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
    for low, width in np.random.default_rng(1).uniform(0.0, 1.0, (200, 2)):
        below, above = map(float, format_interval(low, low + width))
        assert below <= low < low + width <= above <= below + 1.2 * width


def test_ends_and_bounds_are_rounded_to_digits_in_their_direction():
    """By hand; a decimal such as 0.3 that binary numbers miss is kept."""
    for value, digits, below, above in (
        (0.04658, 2, 0.046, 0.047),
        (-5.104151, 6, -5.10416, -5.10415),
        (9.5e-13, 1, 9e-13, 1e-12),
        *((exact, 1, exact, exact) for exact in (0.3, 3e-5, 1e-300, 7.0)),
    ):
        assert [round_end(value, digits, up=up) for up in (False, True)] == [below, above]
