"""Ranks and intervals against exact binomial sums, Wilks' sample sizes and published values."""

import math
from fractions import Fraction

import numpy as np
import pytest

from precision_pin.base.errors import InputError
from precision_pin.statistics import Plan, Specification, clopper_pearson, finish, observe, quantile_ranks, start
from precision_pin.statistics.intervals import tolerance_ranks, upper_bound_rank
from support.sampling_checks import quantile_coverage


def at_most(k: int, samples: int, p: Fraction) -> Fraction:
    return sum((math.comb(samples, i) * p**i * (1 - p) ** (samples - i) for i in range(k + 1)), Fraction(0))


@pytest.mark.parametrize(("samples", "p"), [(100, "1/2"), (100, "19/20"), (80, "1/20"), (300, "49/50"), (7, "1/2")])
def test_quantile_ranks_are_the_tightest_of_equal_tails(samples: int, p: str) -> None:
    probability = Fraction(p)
    tail = Fraction(1, 40)
    lower, upper = quantile_ranks(samples, float(probability), 0.95)
    assert at_most(lower - 1, samples, probability) <= tail < at_most(lower, samples, probability)
    assert 1 - at_most(upper - 1, samples, probability) <= tail < 1 - at_most(upper - 2, samples, probability)
    coverage = at_most(upper - 1, samples, probability) - at_most(lower - 1, samples, probability)
    assert coverage >= Fraction(19, 20)
    assert quantile_coverage(samples, float(probability), (lower, upper)) == pytest.approx(float(coverage), abs=1e-13)


def test_the_median_of_ten_samples_lies_between_the_second_and_ninth() -> None:
    # David and Nagaraja: 1 − 2·(1 + 10)/2¹⁰ = 0.978515625
    assert quantile_ranks(10, 0.5, 0.95) == (2, 9)
    assert quantile_coverage(10, 0.5, (2, 9)) == pytest.approx(0.978515625, abs=1e-15)


@pytest.mark.parametrize("p", [0.00135, 0.05, 0.5, 0.95, 0.99, 0.9973])
def test_quantiles_resolve_exactly_when_a_sample_is_likely_beyond_them(p: float) -> None:
    # the largest of N lies above the p-quantile unless all N are below: p^N; both tails need α/2
    first = max(math.ceil(math.log(0.025) / math.log(max(p, 1 - p))), 1)
    assert quantile_ranks(first - 1, p, 0.95) is None
    assert quantile_ranks(first, p, 0.95) is not None


@pytest.mark.parametrize(
    ("content", "confidence", "one_sided", "two_sided"),
    [(0.95, 0.95, 59, 93), (0.99, 0.95, 299, 473), (0.9973, 0.95, 1109, 1756)],
)
def test_wilks_sample_sizes(content: float, confidence: float, one_sided: int, two_sided: int) -> None:
    assert upper_bound_rank(one_sided - 1, content, confidence) is None
    assert upper_bound_rank(one_sided, content, confidence) == one_sided
    assert tolerance_ranks(two_sided - 1, content, confidence) is None
    assert tolerance_ranks(two_sided, content, confidence) == (1, two_sided)


def test_wilks_sample_sizes_decide_what_a_summary_gives() -> None:
    values = np.random.default_rng(1).standard_normal((6, 93)) * 1e-3
    plan = Plan(np.zeros(8), np.full(8, 1e-3))

    def position(samples: int):
        return finish(plan, observe(plan, start(plan), values[:, :samples])).position

    assert position(58).norm.quantile_upper_bound(0.95) is None
    assert position(59).norm.quantile_upper_bound(0.95) == position(59).norm.max
    assert position(92).x.tolerance_interval(0.95) is None
    assert position(93).x.tolerance_interval(0.95) == (position(93).x.min, position(93).x.max)
    assert position(71).norm.quantile(0.95) is None
    assert position(71).norm.quantile_interval(0.95) is None
    assert position(72).norm.quantile(0.95) is not None
    assert position(72).norm.quantile_interval(0.95)[1] == position(72).norm.max


def test_tolerance_ranks_move_inwards_as_samples_allow() -> None:
    # Beta(N + 1 − 2r, 2r) as a binomial: content ≤ β iff at least N + 1 − 2r of N fall inside
    lower, upper = tolerance_ranks(400, 0.9, 0.95)
    assert upper == 401 - lower
    p = Fraction(9, 10)
    assert at_most(400 - 2 * lower, 400, p) >= Fraction(19, 20) > at_most(400 - 2 * (lower + 1), 400, p)


@pytest.mark.parametrize("samples", [1, 5, 20, 1000, 1_000_000])
@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.99])
def test_clopper_pearson_has_its_closed_form_at_none_and_all(samples: int, confidence: float) -> None:
    tail = (1 - confidence) / 2
    lower, upper = clopper_pearson(0, samples, confidence)
    assert lower == 0.0
    assert upper == pytest.approx(-math.expm1(math.log(tail) / samples), rel=1e-12)
    lower, upper = clopper_pearson(samples, samples, confidence)
    assert lower == pytest.approx(math.exp(math.log(tail) / samples), rel=1e-12)
    assert upper == 1.0


@pytest.mark.parametrize(("inside", "samples"), [(4, 20), (1, 3), (97, 100), (250, 300)])
def test_clopper_pearson_ends_leave_exactly_half_alpha(inside: int, samples: int) -> None:
    lower, upper = clopper_pearson(inside, samples, 0.95)
    assert float(1 - at_most(inside - 1, samples, Fraction(lower))) == pytest.approx(0.025, rel=1e-10)
    assert float(at_most(inside, samples, Fraction(upper))) == pytest.approx(0.025, rel=1e-10)


def test_clopper_pearson_published() -> None:
    # NIST/SEMATECH e-Handbook 7.2.4.1: 4 defects in 20, two-sided 90 % (its last digit is rounded up)
    assert clopper_pearson(4, 20, 0.9) == (pytest.approx(0.071354, abs=1e-6), pytest.approx(0.401029, abs=1e-6))


def test_a_specification_is_met_when_the_lower_end_reaches_it() -> None:
    # 59 of 59 inside: lower end 0.025^(1/59) = 0.93940
    errors = np.linspace(0, 1e-6, 6 * 59).reshape(6, 59)  # what does not vary is not judged
    for required, met in ((0.9393, True), (0.9395, False)):
        plan = Plan(np.zeros(8), np.ones(8), (Specification("position.norm", 1e-3, required),))
        (result,) = finish(plan, observe(plan, start(plan), errors)).specifications
        assert result.probability == 1.0
        assert result.interval[0] == pytest.approx(0.025 ** (1 / 59), rel=1e-12)
        assert result.met is met


@pytest.mark.parametrize("p", [0.0, 1.0, 95, -0.1, math.nan])
def test_levels_outside_zero_to_one_are_refused(p: float) -> None:
    plan = Plan(np.zeros(8), np.ones(8))
    norm = finish(plan, observe(plan, start(plan), np.zeros((6, 2)))).position.norm
    for ask in (norm.quantile, norm.quantile_interval, norm.quantile_upper_bound, norm.tolerance_interval):
        with pytest.raises(InputError, match="above 0 and below 1"):
            ask(p)
