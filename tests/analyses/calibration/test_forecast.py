"""The forecast against textbook formulas with finite differences, and against complete calibrations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, paper_model, plain_model, random_poses
from precision_pin.analyses.calibration.simulation import simulate_calibrations
from precision_pin.analyses.calibration.table import forecast_table
from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Lognormal, TwoPoint, Uniform
from support.checks.common import one_link

SET_UPS = [
    pp.Measurement(std=20e-6, target=OFF_AXIS),
    pp.Measurement(std=20e-6, target=OFF_AXIS, base="free", target_known=False),
    pp.Measurement("pose", std=20e-6, base="free"),
    pp.Measurement("distance", std=10e-6, anchor=(1.0, 0.5, 0.2), base="free"),
]


def textbook(model: pp.ErrorModel, q: np.ndarray, measurement: pp.Measurement) -> np.ndarray:
    """Return the covariance of the unit-scope numbers: the joint normal equations, by finite differences of readings."""
    space = model.space
    scopes = np.array([draw.scope for draw in space.draws for _ in range(draw.law.size)])
    mean, std = space.mean, np.sqrt(space.block_covariance.variances)
    unit = np.flatnonzero((scopes == Scope.UNIT) & (std > 0))
    nuisances = len(measurement.nuisances)
    information = np.zeros((unit.size + nuisances,) * 2)
    for column in range(q.shape[1]):
        at = model.at(q[:, column])

        def reading(x: np.ndarray, n: np.ndarray) -> np.ndarray:
            return measurement.predict(at.posture.pose, at.exact(x[:, None]), n[:, None])[:, 0]  # noqa: B023

        def slopes(columns: np.ndarray) -> np.ndarray:
            found = []
            for k in columns:
                ends = []
                for sign in (1, -1):
                    x = mean.copy()
                    x[k] += sign * 1e-2 * std[k]
                    ends.append(reading(x, np.zeros(nuisances)))
                found.append((ends[0] - ends[1]) / (2e-2 * std[k]))
            return np.array(found).T.reshape(measurement.size, -1)

        by_nuisance = np.array(
            [(reading(mean, 1e-6 * e) - reading(mean, -1e-6 * e)) / 2e-6 for e in np.eye(nuisances)]
        ).T.reshape(measurement.size, nuisances)
        noise = np.diag(measurement.deviations**2)
        for scope in (Scope.VISIT, Scope.POSE):
            others = np.flatnonzero(scopes == scope)
            k = slopes(others)
            noise = noise + k @ np.diag(std[others] ** 2) @ k.T
        rows = np.hstack([slopes(unit), by_nuisance])
        information += rows.T @ np.linalg.solve(noise, rows)
    information[: unit.size, : unit.size] += np.diag(1 / std[unit] ** 2)
    scale = np.sqrt(np.diag(information))
    return (np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale))[: unit.size, : unit.size]


@pytest.mark.slow
@pytest.mark.parametrize("measurement", SET_UPS, ids=lambda one: f"{one.kind}-{one.base}")
def test_covariance_is_that_of_the_normal_equations(measurement: pp.Measurement) -> None:
    q = random_poses(4, 8)
    found = pp.forecast_calibration(plain_model(), q, measurement).posterior
    expected = textbook(plain_model(), q, measurement)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found.covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=2e-5)


def test_error_left_is_propagated_to_the_users_poses() -> None:
    model, measurement, q = plain_model(), SET_UPS[0], random_poses(4, 12)
    found = pp.forecast_calibration(model, q, measurement, at=["work"])
    (entry,) = found.poses
    at = model.at("work")
    unit = [model.space.index[name] for name in found.posterior.names]
    rest = [k for k in range(model.space.size) if k not in unit]
    floor = at.jacobian[:, rest] @ np.diag(model.space.block_covariance.variances[rest]) @ at.jacobian[:, rest].T
    slopes = at.jacobian[:, unit]
    np.testing.assert_allclose(entry.floor, floor, atol=1e-20)
    np.testing.assert_allclose(
        entry.covariance_after, slopes @ found.posterior.covariance @ slopes.T + floor, atol=1e-19
    )
    np.testing.assert_allclose(entry.covariance_before, at.covariance, atol=1e-19)
    assert found.rms("floor") < found.rms("after") < found.rms("before")


@pytest.mark.slow
@pytest.mark.parametrize("measurement", SET_UPS, ids=lambda one: f"{one.kind}-{one.base}")
def test_simulated_calibrations_agree(measurement: pp.Measurement) -> None:
    """Robots are built, measured and fitted with the exact model: the error left is that forecast, to 2 %."""
    model, q = plain_model(), random_poses(4, 12)
    forecast = pp.forecast_calibration(model, q, measurement)
    simulated = simulate_calibrations(model, q, measurement, robots=4000)
    expected = np.array([entry.rms("after") for entry in forecast.poses])
    np.testing.assert_allclose(simulated.rms_position, expected, rtol=0.02)
    assert simulated.chi_square.mean() == pytest.approx(simulated.degrees_of_freedom, rel=0.02)
    # intervals of 95 % of the numbers hold the truth as often as they say
    left = np.array(list(forecast.posterior.std.values())) / np.array(list(forecast.posterior.prior_std.values()))
    inside = np.abs(simulated.estimates - simulated.truth) <= stats.norm.ppf(0.975) * left[:, None]
    assert 0.945 < inside.mean() < 0.955


@pytest.mark.slow
def test_simulated_calibrations_of_the_paper_agree() -> None:
    """Uniform and disc laws, elastic links: 2 %."""
    model, q, measurement = paper_model(), random_poses(4, 20), SET_UPS[0]
    forecast = pp.forecast_calibration(model, q, measurement)
    simulated = simulate_calibrations(model, q, measurement, robots=4000)
    np.testing.assert_allclose(simulated.rms_position, [entry.rms("after") for entry in forecast.poses], rtol=0.02)


@pytest.mark.slow
def test_a_better_instrument_and_more_poses_help_down_to_the_floor() -> None:
    found = pp.forecast_calibration(plain_model(), random_poses(4, 40), SET_UPS[0])
    for curve, direction in ((found.by_count, -1), (found.by_instrument, 1)):
        values = np.array([point.rms_position for point in curve])
        assert (direction * np.diff(values) > 0).all()
        assert values.min() > found.rms("floor")
    here = next(point for point in found.by_instrument if point.value == pytest.approx(20e-6))
    assert here.rms_position == pytest.approx(found.rms("after"), rel=1e-9)
    whole = next(point for point in found.by_count if point.value == 40)
    assert whole.rms_position == pytest.approx(found.rms("after"), rel=1e-9)


@pytest.mark.slow
def test_repeating_a_pose_does_not_remove_its_own_error() -> None:
    """A pose-scope error is the same at every visit of a pose: visits average the others only."""
    model, measurement = plain_model(), pp.Measurement(std=1e-7)
    one = random_poses(4, 1)
    few, many = (
        pp.forecast_calibration(model, np.repeat(one, count, axis=1), measurement, at=one) for count in (1, 400)
    )
    slopes = model.at(one[:, 0]).jacobian[:3]
    pose_scope = slopes[:, model.space.index["joint_offset[joint3]#2.offset"]] * 1e-5
    assert few.rms("after") > many.rms("after")
    left = many.poses[0].covariance_after[:3, :3] - many.poses[0].floor[:3, :3]
    assert np.trace(left) > 0.3 * pose_scope @ pose_scope


@pytest.mark.slow
def test_the_arm_that_is_left_runs_through_other_analyses() -> None:
    found = pp.forecast_calibration(plain_model(), random_poses(4, 20), SET_UPS[0], at=["work"])
    sampled = pp.monte_carlo(found.model, "work", samples=20_000, seed=0)
    nominal = sampled.covariance[:3, :3]
    np.testing.assert_allclose(np.trace(nominal), np.trace(found.poses[0].covariance_after[:3, :3]), rtol=0.03)


@pytest.mark.slow
def test_a_map_of_the_arm_that_will_be_left_is_the_forecast_at_its_poses() -> None:
    """`map_poses` of the forecast's model against the error forecast at the same poses."""
    q = random_poses(4, 5, seed=2)
    found = pp.forecast_calibration(plain_model(), random_poses(4, 20), SET_UPS[0], at=q)
    mapped = pp.map_poses(found.model, q)
    for k, entry in enumerate(found.poses):
        rms = np.sqrt(np.trace(mapped.covariance[:3, :3, k]) + (mapped.mean[:3, k] ** 2).sum())
        moved = np.linalg.norm(entry.before[:3])
        np.testing.assert_allclose(rms, np.hypot(entry.rms("after"), moved), rtol=1e-6)


def test_nothing_to_calibrate_is_refused() -> None:
    model = pp.ErrorModel(paper_model().chain, pp.Space(), ())
    with pytest.raises(pp.InputError, match="nothing varies from robot to robot"):
        pp.forecast_calibration(model, random_poses(4, 3), pp.Measurement())


@pytest.mark.parametrize(
    ("law", "below"),
    [
        # in one of 17 robots; a normal law of the same variance has its 95 % quantile at half of the step
        (TwoPoint(0.5e-3, 0.5e-3, 0.06), lambda x: np.where(x >= 1.0, 1.0, np.where(x >= 0, 0.94, 0.0))),
        (TwoPoint(0.5e-3, 0.5e-3, 0.01), lambda x: np.where(x >= 1.0, 1.0, np.where(x >= 0, 0.99, 0.0))),
        (
            Lognormal(1e-3, 1e-3),
            lambda x: stats.norm.cdf((np.log(np.maximum(x, 1e-300)) + np.log(2) / 2) / np.sqrt(np.log(2))),
        ),
        (Uniform(1e-3), lambda x: np.clip((x + 1) / 2, 0, 1)),
    ],
)
@pytest.mark.parametrize("std", [1e-3, 0.2e-3])
def test_the_95_percent_of_a_law_that_is_not_normal(law, below, std) -> None:
    # a hinge with its tip 1 m away, measured once across: to first order one number, of which c is left
    model = pp.ErrorModel(
        one_link(), pp.Space((pp.Draw("a", law),)), [pp.sources.JointOffset(joint="hinge", offset="a")]
    )
    found = pp.forecast_calibration(model, [[0.0]], pp.Measurement(std=std), at=[[0.0]])
    (entry,) = found.poses
    variance = float(law.covariance[0, 0])
    left = 1 / (1 + variance / std**2)
    noise = np.sqrt(variance * (left - left**2))
    assert entry.rms("after") == pytest.approx(np.sqrt(variance * left), rel=1e-6)
    # |left (a - mean) + noise|, by quadrature over the noise
    mean = float(model.space.mean[0])
    nodes, weights = np.polynomial.hermite_e.hermegauss(120)

    def inside(size: float) -> float:
        ends = [(mean + (sign * size - noise * nodes) / left) / 1e-3 for sign in (1, -1)]
        return float(weights @ (below(ends[0]) - below(ends[1])) / weights.sum())

    low, high = entry.quantile_interval("after")
    assert inside(low) < 0.95 + 3e-3
    assert inside(high) > 0.95 - 3e-3
    assert low <= entry.quantile("after") <= high
    assert inside(0.97 * low) < 0.95 < inside(1.03 * high)
    low, high = entry.quantile_interval("before")
    less, more = 999.9 * low - 1e-6, 1000.1 * high
    assert below(less) - below(-less) <= 0.95 <= below(more) - below(-more)
    assert [finding.code for finding in found.findings] == ["W_NOT_NORMAL"]
    assert "of 10,000 robots sampled with the sheet's laws" in " ".join(forecast_table(found).split())


def test_the_95_percent_of_normal_laws_is_a_closed_form() -> None:
    model = pp.ErrorModel(
        one_link(),
        pp.Space((pp.Draw("a", pp.Normal(1e-3)),)),
        [pp.sources.JointOffset(joint="hinge", offset="a")],
    )
    (entry,) = pp.forecast_calibration(model, [[0.0]], pp.Measurement(std=1e-3), at=[[0.0]]).poses
    assert entry.quantile("after") == pytest.approx(stats.norm.ppf(0.975) * 1e-3 / np.sqrt(2), rel=1e-6)
    assert entry.quantile_interval("after") is None
