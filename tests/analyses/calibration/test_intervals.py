"""Intervals of numbers after a calibration against closed forms, and how often they hold the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, paper_model, plain_model, random_poses, readings_of
from precision_pin.analyses.calibration.forecast import simulate_calibrations
from precision_pin.analyses.calibration.posterior import interval_after
from precision_pin.base.errors import UnknownNameError
from precision_pin.draws.laws import Law

TRACKER = pp.Measurement(std=20e-6, target=OFF_AXIS)


def of_reading(law: Law, reading: float, std: float) -> tuple[float, float]:
    """Return the interval that one reading ± std of the number itself leaves, 90 %."""
    before, mean = float(law.covariance[0, 0]), float(law.mean_vector[0])
    after = 1 / (1 / before + 1 / std**2)
    estimate = after * (mean / before + reading / std**2)
    return interval_after(law, 0, estimate, before**0.5, after / before, 0.9)


@pytest.mark.parametrize(("reading", "std"), [(2.2, 0.5), (3.5, 0.3), (9.0, 0.2), (1.0, 1e-4), (2.0, 100.0)])
def test_a_uniform_number_has_a_truncated_normal_law(reading: float, std: float) -> None:
    law = pp.Uniform(1.0, mean=2.0)
    expected = stats.truncnorm((1 - reading) / std, (3 - reading) / std, reading, std).ppf([0.05, 0.95])
    assert of_reading(law, reading, std) == pytest.approx(expected, abs=1e-3 * min(std, 1.0))


def test_a_reading_of_a_lognormal_number_by_quadrature() -> None:
    law, reading, std = pp.Lognormal(1.2, mean=2.0), 2.6, 0.7
    variance = np.log(1 + 1.2**2 / 2.0**2)
    own = stats.lognorm(variance**0.5, scale=2.0 * np.exp(-variance / 2))
    x = np.linspace(1e-6, 30, 200_001)
    within = np.cumsum(own.pdf(x) * np.exp(-((x - reading) ** 2) / (2 * std**2)))
    expected = np.interp([0.05, 0.95], within / within[-1], x)
    assert of_reading(law, reading, std) == pytest.approx(expected, rel=1e-3)


def test_of_two_values_the_likely_ones_are_left() -> None:
    """Odds exp(-(1.5-1)²/2 s²) to exp(-(1.5+1)²/2 s²): with s = 2 the lower value keeps a third, with s = 0.5 nothing."""
    law = pp.TwoPoint(1.0)
    assert 1 / (1 + np.exp(0.75)) > 0.3
    assert of_reading(law, 1.5, 2.0) == pytest.approx((-1, 1), abs=3e-3)
    assert of_reading(law, 1.5, 0.5) == pytest.approx((1, 1), abs=3e-3)
    assert of_reading(law, 0.4, 1e-3) == pytest.approx((1, 1), abs=3e-3)


def test_of_a_number_that_no_reading_shows_the_law_is_left() -> None:
    assert interval_after(pp.Triangular(1.0), 0, 0.0, 6**-0.5, 1.0, 0.5) == pytest.approx(
        stats.triang(0.5, -1, 2).ppf([0.25, 0.75]), abs=1e-3
    )


@pytest.mark.slow
def test_intervals_of_normal_numbers_are_those_of_the_posterior() -> None:
    model, q = plain_model(), random_poses(4, 12)
    found = pp.calibrate(model, (q, readings_of(model, q, TRACKER, seed=3)), TRACKER)
    for name in found.posterior.names:
        expected = stats.norm(found.posterior.mean[name], found.posterior.std[name]).ppf([0.1, 0.9])
        assert found.interval(name, 0.8) == pytest.approx(expected, rel=1e-6, abs=1e-12)
    with pytest.raises(pp.InputError, match="the probability must be between 0 and 1, got 95"):
        found.interval(found.posterior.names[0], 95)
    with pytest.raises(UnknownNameError):
        found.interval("joint_offset")


@pytest.mark.slow
def test_intervals_of_bounded_laws_hold_the_truth() -> None:
    """All 26 numbers of the paper's arm, uniform and in discs, from a third to all of them learned: 94.5 to 95.5 %."""
    model, q, robots = paper_model(), random_poses(4, 10), 1000
    forecast = pp.forecast_calibration(model, q, TRACKER)
    found = simulate_calibrations(model, q, TRACKER, robots=robots, seed=5)
    laws = {name: (draw.law, k) for draw in model.space.draws for k, name in enumerate(draw.components)}
    inside = np.zeros((len(forecast.posterior.names), robots), dtype=bool)
    for row, name in enumerate(forecast.posterior.names):
        mean, std = forecast.posterior.prior_mean[name], forecast.posterior.prior_std[name]
        left = 1 - forecast.posterior.learned[name]
        for robot in range(robots):
            estimate, truth = (mean + std * each[row, robot] for each in (found.estimates, found.truth))
            low, high = interval_after(*laws[name], estimate, std, left, 0.95)
            inside[row, robot] = low <= truth <= high
    assert 0.945 < inside.mean() < 0.955
    # of one number by itself: within 4 standard deviations of 1,000 robots
    np.testing.assert_allclose(inside.mean(axis=1), 0.95, atol=4 * (0.95 * 0.05 / robots) ** 0.5)
