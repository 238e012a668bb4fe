"""Intervals of moments: skewed, heavy-tailed and discrete laws, covariances; by plain numpy and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from precision_pin.statistics import Distribution, Plan, Summary, finish, observe, quantity_values, start


def summary_of(errors: np.ndarray, skewness: float = math.nan) -> Summary:
    plan = Plan.from_pilot(quantity_values(errors[:, :512]), np.zeros(6))
    plan = Plan(plan.centre, plan.scale, skewness=np.full((8, 2), skewness))
    return finish(plan, observe(plan, start(plan), errors))


def component_of(values: np.ndarray, skewness: float = math.nan) -> Distribution:
    errors = np.zeros((6, values.size))
    errors[0] = values
    return summary_of(errors, skewness).position.x


def test_of_two_values_equally_likely_the_deviation_has_an_interval_that_holds_it() -> None:
    """s² = p̂ (1 - p̂) is at most 1/4, the truth: an interval from the scatter of squares alone has no width at all."""
    for seed in range(20):
        values = (np.random.default_rng(seed).random(2000) < 0.5).astype(float)
        low, high = component_of(values).std_interval()
        share = abs(values.mean() - 0.5)
        assert low <= math.sqrt(0.25 - share**2) <= high
        # the mean lies within 1.96 standard errors in 95 of 100 samples
        assert (low <= 0.5 <= high) or share > 1.9 * 0.5 / math.sqrt(2000)
        assert high - low < 2e-3


def test_the_interval_of_a_skewed_mean_leans_to_the_tail_as_the_chance_of_the_tail_does() -> None:
    """The mean of N exponential numbers is gamma (N): an exact interval to compare with."""
    values = np.random.default_rng(3).standard_exponential(400)
    low, high = component_of(values).mean_interval()
    exact = stats.gamma(400).ppf([0.975, 0.025])
    expected = values.mean() * 400 / exact
    # to a fifth of the difference that skewness makes, beside a standard deviation that is not known
    shift = (expected.sum() / 2 - values.mean()) / values.mean()
    assert shift > 0
    assert ((low + high) / 2 - values.mean()) / values.std() == pytest.approx(shift, rel=0.6)
    assert high - values.mean() > values.mean() - low


@pytest.mark.parametrize(
    "law", [stats.t(2.5), stats.lognorm(0.8326), stats.pareto(3)], ids=["t", "lognormal", "Pareto"]
)
def test_of_a_heavy_tail_no_deviation_is_given_or_a_wide_interval(law) -> None:
    given = 0
    for seed in range(15):
        found = component_of(law.rvs(3000, random_state=np.random.default_rng(seed)))
        ends = found.std_interval()
        given += ends is not None
        assert ends is None or ends[0] <= law.std() <= ends[1]
        assert found.mean_interval() is None or found.mean_interval()[0] < found.mean < found.mean_interval()[1]
    assert given <= 2


def test_skewness_that_the_laws_have_counts_though_no_sample_shows_it() -> None:
    values = np.random.default_rng(5).standard_normal(10_000)
    seen = component_of(values)
    for known, given in ((0.0, True), (10.0, True), (45.0, False)):
        found = component_of(values, known)
        assert (found.mean_interval() is not None, found.std_interval() is not None) == (given, given)
        if given:
            assert found.mean_interval()[0] <= seen.mean_interval()[0]
            assert found.std_interval()[1] >= seen.std_interval()[1]
    # 45/√10,000 = 0.45; of 40,000 such numbers the mean is no more skewed than of those of a tenth as many light ones
    assert component_of(np.tile(values, 4), 45.0).mean_interval() is not None


def test_no_deviation_has_an_interval_below_a_thousand_samples_and_no_mean_below_thirty() -> None:
    values = np.random.default_rng(6).uniform(-1, 1, 1000)
    assert component_of(values).std_interval() is not None
    assert component_of(values[:999]).std_interval() is None
    assert component_of(values[:30]).mean_interval() is not None
    assert component_of(values[:29]).mean_interval() is None


def test_intervals_of_covariances() -> None:
    """Of normal numbers Var c = (1 + ρ²) σ⁴/N; the bound from fourth moments is (3 - ρ²) σ⁴/N."""
    samples = 50_000
    random = np.random.default_rng(7)
    x, y = random.standard_normal((2, samples))
    errors = np.stack([x, 0.6 * x + 0.8 * y, 2 * x, y, np.zeros(samples), random.standard_t(2.5, samples)])
    found = summary_of(errors)
    ends = found.covariance_interval
    assert ends is not None
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


def test_the_covariance_of_components_known_to_be_still_is_known_to_be_zero() -> None:
    errors = np.zeros((6, 1000))
    errors[0] = np.random.default_rng(8).standard_normal(1000)
    ends = summary_of(errors, 0.0).covariance_interval
    assert ends is not None
    assert (ends[0, 0] > 0).all()
    assert not ends[1:].any()
