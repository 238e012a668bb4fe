"""Pick-freeze against functions whose Sobol indices are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import binom

from precision_pin.analyses.budget import sobol
from precision_pin.analyses.budget import sobol as smooth_quantiles
from precision_pin.analyses.replicates import Estimates, half_widths, jackknife

A, B = 7.0, 0.1
VARIANCE = 13.844588
FIRST = (0.313905, 0.442411, 0.0)
TOTAL = (0.557589, 0.442411, 0.243684)


def ishigami(uniforms: np.ndarray) -> np.ndarray:
    x = -np.pi + 2 * np.pi * uniforms
    return (np.sin(x[0]) + A * np.sin(x[1]) ** 2 + B * x[2] ** 4 * np.sin(x[0]))[None]


def indices(function, dimension: int, groups, *, seed: int = 0, points: int = 1024, **settings) -> sobol.Indices:
    both = sobol.scrambled_points(2 * dimension, seed, points)
    return sobol.sobol_indices(function, both[:dimension], both[dimension:], groups, **settings)


def covers(estimates: Estimates, truth) -> np.ndarray:
    return np.abs(estimates.value - truth) <= estimates.half_width + 1e-6


def test_ishigami_lies_inside_the_stated_intervals():
    found = indices(ishigami, 3, [[0], [1], [2]], confidence=0.99)
    assert covers(found.first, np.array(FIRST)[:, None]).all()
    assert covers(found.total, np.array(TOTAL)[:, None]).all()
    assert covers(found.first_sum, sum(FIRST)).all()
    assert covers(found.variance, VARIANCE).all()
    assert max(found.first.half_width.max(), found.total.half_width.max()) < 0.03


@pytest.mark.slow
def test_intervals_cover_as_often_as_stated():
    """Of 60 seeds, a 95 % interval may miss as often as one of exactly 95 % does with probability 1e-4."""
    hits = np.zeros(7)
    for seed in range(60):
        found = indices(ishigami, 3, [[0], [1], [2]], seed=seed, points=128)
        hits += np.concatenate(
            [covers(found.first, np.array(FIRST)[:, None])[:, 0], covers(found.total, np.array(TOTAL)[:, None])[:, 0],
             covers(found.variance, VARIANCE)]
        )  # fmt: skip
    assert hits.min() >= binom.ppf(1e-4, 60, 0.95)


def test_closed_form_of_an_interaction():
    """Y = x1 + x2 x3 of standard normal numbers: V = 2, first order 1/2 0 0, total 1/2 1/2 1/2; as a group 1/2."""

    def function(uniforms):
        x = ndtri(uniforms)
        return (x[0] + x[1] * x[2])[None]

    found = indices(function, 3, [[0], [1], [2], [1, 2]], confidence=0.999)
    assert covers(found.first, np.array([[0.5], [0], [0], [0.5]])).all()
    assert covers(found.total, np.array([[0.5], [0.5], [0.5], [0.5]])).all()


def test_additive_functions_and_several_outputs_together():
    """Of (3u, 4v) together: variances 9/12 and 16/12, shares 0.36 and 0.64, and no difference of first and total."""

    def function(uniforms):
        return np.array([3 * uniforms[0], 4 * uniforms[1]])

    found = indices(function, 2, [[0], [1]], outputs=np.array([[1.0, 1.0], [1.0, 0.0]]))
    np.testing.assert_allclose(found.first.value, found.total.value, rtol=1e-12)
    np.testing.assert_allclose(found.first.value, [[0.36, 1.0], [0.64, 0.0]], atol=2e-3)
    np.testing.assert_allclose(found.variance.value, [25 / 12, 9 / 12], rtol=1e-3)


def test_what_does_not_vary_has_no_indices():
    found = indices(lambda uniforms: np.full((1, uniforms.shape[1]), 3.0), 2, [[0], [1]])
    assert np.isnan(found.first.value).all()
    assert np.isnan(found.total.value).all()
    assert found.variance.value == 0


def test_quantiles_of_known_laws():
    samples = sobol.scrambled_points(2, 3, 1024)
    scaled = np.array([1.0, 5.0])[:, None]
    value, change = smooth_quantiles.quantile_changes(samples * scaled / 2, samples * scaled, 0.95, 0.99)
    np.testing.assert_allclose(value.value, [0.475, 2.375], rtol=1e-3)
    np.testing.assert_allclose(change.value, [-0.475, -2.375], rtol=1e-3)
    assert (np.abs(value.value - [0.475, 2.375]) <= value.half_width).all()
    plain = smooth_quantiles.quantiles(samples, 0.95, 0.99)
    np.testing.assert_allclose(plain.value, 0.95, rtol=1e-3)


@pytest.mark.slow
def test_intervals_of_quantiles_cover_as_often_as_stated():
    """The 95 % quantile of the sum of two uniform numbers is 2 - √0.1; halved, with the same numbers, half of it."""
    truth = 2 - math.sqrt(0.1)
    hits = np.zeros(2)
    for seed in range(60):
        total = sobol.scrambled_points(2, seed, 128).sum(axis=0, keepdims=True)
        value, change = smooth_quantiles.quantile_changes(total, total / 2, 0.95, 0.95)
        hits += [covers(value, truth)[0], covers(change, truth / 2)[0]]
    assert hits.min() >= binom.ppf(1e-4, 60, 0.95)


def test_jackknife_of_a_mean_is_students_interval_and_a_tenth_where_nothing_is_skewed():
    numbers = np.random.default_rng(4).normal(size=sobol.REPLICATES // 2)
    numbers = np.concatenate([numbers, -numbers])
    found = jackknife(lambda used: numbers[used].mean(), 0.95)
    assert found.value == pytest.approx(0.0, abs=1e-15)
    # 2.03951: the 97.5 % quantile of Student's law with 31 degrees of freedom, from a table
    assert found.half_width == pytest.approx(1.1 * 2.03951 * numbers.std(ddof=1) / math.sqrt(32), rel=1e-4)


def test_intervals_of_skewed_replicates_cover():
    """Means of 32 numbers: Student's interval holds that of exponential ones in 92.5 of 100 runs."""
    random = np.random.default_rng(0)
    runs = 4000
    for numbers, mean in (
        (random.exponential(size=(32, runs)), 1.0),
        (random.poisson(0.2, (32, runs)).astype(float), 0.2),
        ((1 - random.random((32, runs))) ** -0.2, 1.25),
        (random.normal(size=(32, runs)), 0.0),
    ):
        held = np.abs(numbers.mean(axis=0) - mean) <= half_widths(numbers, 0.95)
        assert held.sum() >= binom.ppf(1e-4, runs, 0.945)


def test_lognormal_numbers_whose_tail_no_point_meets_are_not_resolved():
    """A standard deviation of 300 % of the mean: the variance came out within its interval in 59 of 100 runs."""
    found = indices(lambda u: np.exp(1.517 * ndtri(u[:1])), 1, [[0]], points=32)
    for estimate in (found.first, found.total, found.first_sum, found.variance):
        assert np.isnan(estimate.value).all()
    assert found.varies.all()


def test_a_rare_value_that_no_point_meets_is_not_resolved():
    """Of probability 1e-5, as large as ten standard deviations of the rest: indices 1/1001 and 1000/1001 of V = 1.001.

    No point meets it, so that 0 and 1 would be found with no scatter.
    """

    def function(u):
        return (np.where(u[0] > 1 - 1e-5, 10.0, 0.0) + ndtri(u[1]))[None]

    both = sobol.scrambled_points(4, 0, 32)
    found = sobol.sobol_indices(function, both[:2], both[2:], [[0], [1]], breaks=[(1 - 1e-5,), ()])
    assert np.isnan(found.first.value).all()
    assert np.isnan(found.total.value).all()


def test_quantiles_at_a_jump_are_not_resolved():
    """The 95 % quantile of two values, the upper one of probability 0.05, 0.06 and 0.5; beyond the jump it is exact."""
    for probability, given in ((0.05, False), (0.051, False), (0.5, True)):
        points = sobol.scrambled_points(1, 1, 32)
        found = smooth_quantiles.quantiles(np.where(points > 1 - probability, 1.0, -1.0), 0.95, 0.95)
        assert np.isfinite(found.value[0]) == given
        assert not given or (found.value[0], found.half_width[0]) == (pytest.approx(1.0, abs=1e-14), pytest.approx(0.0))


def test_points_lie_inside_and_depend_on_the_seed_alone():
    points = sobol.scrambled_points(5, 2**64 - 1, 64)
    assert points.shape == (5, 64 * sobol.REPLICATES)
    assert 0 < points.min() < points.max() < 1
    np.testing.assert_array_equal(points, sobol.scrambled_points(5, 2**64 - 1, 64))
    assert not np.array_equal(points, sobol.scrambled_points(5, 0, 64))
    split = points.reshape(5, sobol.REPLICATES, 64)
    # a net: each replicate has one point in every 1/64 of each axis
    assert (np.sort((split * 64).astype(int), axis=2) == np.arange(64)).all()
    assert not np.array_equal(split[:, 0], split[:, 1])
