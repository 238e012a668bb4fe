"""Instruments whose error is not one number: covariances by hand, their weight in forecast, plan and fit, wrong settings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, offsets, plain_model, random_poses, readings_of
from precision_pin.analyses.calibration.data import read_data
from precision_pin.analyses.calibration.design import UnitNumbers
from precision_pin.analyses.calibration.fit import Problem
from precision_pin.analyses.calibration.table import WorstReadings
from precision_pin.analyses.readings import simulate_readings, stations_of
from precision_pin.sheet.sight import Sight
from support.refusals import check_refused

STD = {"along": "10 um + 0.3 um/m", "across": "15 um + 6 um/m"}
PLACE = (3.0, -1.0, 1.0)
TRACKER = pp.Measurement(std=STD, stands_at=PLACE, target=OFF_AXIS)
Q = random_poses(4, 14)
AXES = ["sx [um]", "sy [um]", "sz [um]"]


def by_hand(point):
    """Return the covariance of a point, from a matrix whose first column is the line of sight."""
    line = np.asarray(point) - PLACE
    distance = np.linalg.norm(line)
    axes = np.linalg.qr(np.column_stack([line, np.eye(3)[:, :2]]))[0]
    stds = np.array([10e-6 + 0.3e-6 * distance, *2 * [15e-6 + 6e-6 * distance]])
    return axes @ np.diag(stds**2) @ axes.T


def targets(model, q):
    """Return the places of the nominal target, ``(P, 3)``."""
    return np.array([(pose := model.chain.at(column).pose)[:3, 3] + pose[:3, :3] @ OFF_AXIS for column in q.T])


def test_the_covariance_is_along_the_line_of_sight_and_across_it():
    sight = Sight((10e-6, 0.3e-6), (15e-6, 6e-6))
    swapped = pp.Measurement(std={"along": "0.3 um/m + 1e+1 um", "across": 15e-6}, stands_at=PLACE).sight
    for read, across in ((TRACKER.sight, (15e-6, 6e-6)), (swapped, (15e-6, 0.0))):
        assert read.along == pytest.approx((10e-6, 0.3e-6))
        assert read.across == pytest.approx(across)
    # 4 m along x: 11.2 and 39 µm
    plain = sight.covariance(np.array([1.0, 2.0, 3.0]), np.array([[5.0, 2.0, 3.0]]))[0]
    np.testing.assert_allclose(plain, np.diag([11.2e-6, 39e-6, 39e-6]) ** 2, rtol=1e-12, atol=1e-24)
    points = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(
        sight.covariance(np.array(PLACE), points), [*map(by_hand, points)], rtol=1e-9, atol=1e-20
    )
    np.testing.assert_allclose(sight.covariance(points[0], points[:1])[0], 15e-6**2 * np.eye(3))
    assert str(sight) == "10 µm + 0.3 µm/m along, 15 µm + 6 µm/m across"


def test_simulated_readings_have_that_covariance():
    q, still = Q[:, :1], offsets(pp.Normal(1e-12))
    found = simulate_readings(stations_of(still, q, TRACKER), TRACKER, still, robots=40_000, seed=3)[0]
    expected = by_hand(targets(still, q)[0])
    # of 40,000 readings a variance is known to 0.7 %
    np.testing.assert_allclose(np.cov(found), expected, atol=0.03 * expected.max())
    readings = pp.simulate(still, q, TRACKER)
    assert "std" not in readings.to_csv()


def test_the_forecast_is_that_of_normal_equations_with_this_covariance():
    model = offsets(pp.Normal(1e-3))
    information = np.eye(4) * 1e6
    for pose, point in zip(stations_of(model, Q, TRACKER), targets(model, Q), strict=True):
        slopes = TRACKER.slopes(pose.at.posture.pose, pose.at.error_at_means, np.zeros(0)).error
        by_number = slopes @ pose.at.jacobian[:, UnitNumbers.of(model.space).columns]
        information += by_number.T @ np.linalg.inv(by_hand(point)) @ by_number
    forecast = pp.forecast_calibration(model, Q, TRACKER)
    expected = np.linalg.inv(information)
    np.testing.assert_allclose(forecast.posterior.covariance, expected, rtol=1e-6, atol=1e-9 * expected.max())
    # its curve of instruments scales the whole covariance; another share of the distance plans with other poses
    one = pp.Measurement(std=TRACKER.std, target=OFF_AXIS)
    assert abs(pp.forecast_calibration(model, Q, one).rms("after") / forecast.rms("after") - 1) > 0.01
    steep = replace(TRACKER, std={"along": "1 um", "across": "1 um + 300 um/m"})
    chosen = [pp.plan_calibration(model, Q, 4, measurement).chosen for measurement in (one, steep)]
    assert chosen[0] != chosen[1]


def test_a_distance_has_a_share_of_itself():
    """By hand: 10 µm + 3 µm/m, in simulated readings, the fit's covariance, the forecast and the plan."""
    model, q = offsets(pp.Normal(1e-3)), Q[:, :6]
    bar = pp.Measurement("distance", std="10 um + 3 um/m", anchor=(2.0, 1.0, 0.0), target=OFF_AXIS)
    assert str(bar.sight) == "10 µm + 3 µm/m"
    assert bar.std == pytest.approx(10e-6 + 3e-6 * np.sqrt(5))
    distances = np.linalg.norm(targets(model, q) - bar.anchor, axis=1)
    stds = 10e-6 + 3e-6 * distances
    still = offsets(pp.Normal(1e-12))
    found = simulate_readings(stations_of(still, q, bar), bar, still, robots=4000, seed=3)[:, 0]
    # of 4,000 readings a standard deviation is known to 1.1 %
    np.testing.assert_allclose(found.std(axis=1), stds, rtol=0.05)
    readings = found[:, :1]
    problem, _ = Problem.of(model, read_data(model, (q, readings), (bar,)))
    np.testing.assert_allclose(problem.instrument[:, 0, 0], (10e-6 + 3e-6 * readings[:, 0]) ** 2, rtol=1e-9)
    information = 1e6 * np.eye(4)
    for pose, std in zip(stations_of(model, q, bar), stds, strict=True):
        slopes = bar.slopes(pose.at.posture.pose, pose.at.error_at_means, np.zeros(0)).error @ pose.at.jacobian
        information += slopes.T @ slopes / std**2
    covariance = pp.forecast_calibration(model, q, bar).posterior.covariance
    np.testing.assert_allclose(covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-14)
    assert "std" not in pp.simulate(model, q, bar).to_csv()
    check_refused(
        ("std of a distance must be a length and a share", pp.Measurement, "distance", "10 um + 3 um"),
        ("std of a distance such as .* 'kg' in '3 kg' is not a unit", pp.Measurement, "distance", "10 um + 3 kg"),
        ("belongs to a distance, not to a position", pp.Measurement, "position", "10 um + 3 um/m"),
        ("belongs to a distance, not to a position", lambda: replace(bar, kind="position", anchor=(0, 0, 0))),
    )


@pytest.mark.fast(6)
def test_an_instrument_at_the_origin_of_its_axes_needs_no_place():
    """Readings in the axes of the instrument, base free: the same fit as with its place given in the base."""
    model, turn = plain_model(), Rotation.from_rotvec([0.1, -0.4, 2.0]).as_matrix()
    free = replace(TRACKER, base="free")
    readings = readings_of(model, Q, free, seed=4)
    turned = (readings - PLACE) @ turn.T
    given = pp.calibrate(model, (Q, readings), free)
    found = pp.calibrate(model, (Q, turned), replace(free, stands_at=None))
    # the place is that of the first guess, 1 mm beside the true one or 3 m away
    assert found.chi_square == pytest.approx(given.chi_square, rel=1e-3)
    names = given.posterior.names
    shift = [(found.posterior.mean[name] - given.posterior.mean[name]) / given.posterior.std[name] for name in names]
    assert np.abs(shift).max() < 0.02
    in_json = found.to_dict()["measurement"]
    assert in_json["sight"]["across"] == pytest.approx([15e-6, 6e-6])
    assert in_json["stands_at"] is None
    # residuals are compared with that covariance: those of one number would be up to twice as far off
    sizes = [WorstReadings.of(fit, None) for fit in (given, found)]
    assert dict(zip(sizes[0].rows, sizes[0].deviations, strict=True)) == pytest.approx(
        dict(zip(sizes[1].rows, sizes[1].deviations, strict=True)), rel=0.02
    )
    row = sizes[0].rows[0]
    residual = sizes[0].after[:, 0]
    alone = np.sqrt(residual @ np.linalg.solve(by_hand(targets(model, Q)[row]), residual))
    assert 0 < sizes[0].deviations[0] < alone  # repeatability is in the first, too


@pytest.mark.fast(20)
def test_chi_square_of_fits_is_that_of_their_degrees_of_freedom():
    """The sum over 25 robots is within 99.9 % where the covariance is right, and far beyond it by one number."""
    model = offsets(pp.Normal(1e-3))
    one = pp.Measurement(std=15e-6, target=OFF_AXIS)
    far = replace(TRACKER, std={"along": "2 um", "across": "10 um + 12 um/m"})
    sums, degrees = np.zeros(2), 0
    for seed in range(25):
        readings = readings_of(model, Q, far, seed=seed)
        fits = [pp.calibrate(model, (Q, readings), measurement) for measurement in (far, one)]
        sums += [fit.chi_square for fit in fits]
        degrees += fits[0].degrees_of_freedom
    assert chi2.ppf(0.0005, degrees) < sums[0] < chi2.ppf(0.9995, degrees)
    assert sums[1] > 2 * degrees


def test_wrong_settings_of_a_line_of_sight_are_refused():
    given = {"stands_at": PLACE}
    for settings, message in (
        ({"std": {"along": "10 um"}, **given}, "needs along and across"),
        ({"std": {**STD, "up": "1 um"}, **given}, "needs along and across"),
        (
            {"std": {**STD, "along": "-1 um"}, **given},
            "along the line of sight, must be a length and a share of the distance, not",
        ),
        ({"std": {**STD, "across": "1 um + -2 um/m"}, **given}, "not negative"),
        ({"std": {**STD, "across": "1 um + 2 um"}, **given}, "must be a length and a share"),
        ({"std": {**STD, "across": "6 um/m"}, **given}, "must have a length above zero"),
        ({"std": {**STD, "across": "15 um + 6 kg"}, **given}, "'kg' in '6 kg' is not a unit of length"),
        ({"std": STD}, "needs stands_at: where the instrument stands"),
        ({"std": STD, "stands_at": "1 2 m"}, "stands_at of a measurement"),
        (given, "stands_at of a measurement needs std: {along"),
        ({"std": STD, "kind": "distance", **given}, "belongs to a position or a pose, not to a distance"),
        ({"std": STD, "kind": "pose", **given}, "needs attitude_std"),
    ):
        check_refused((message, pp.Measurement), **settings)
    free = pp.Measurement(std=STD, base="free")
    check_refused(("without readings, .* needs stands_at", pp.forecast_calibration, plain_model(), Q, free))


def written(path, q, readings, heads, columns):
    """Write readings in mm, rows of joint values in rad, with more columns in µm."""
    names = [*(f"{name} [rad]" for name in plain_model().chain.joint_names), "x [mm]", "y [mm]", "z [mm]", *heads]
    rows = np.hstack([q.T, 1e3 * readings, columns])
    np.savetxt(path, rows, "%.12g", delimiter=",", header=",".join(names), comments="")
    return path


def test_columns_of_deviations_weigh_each_axis_of_the_readings(tmp_path):
    """In the axes of the file, whatever the base is: whitened numbers are those of each deviation alone."""
    model, turn = offsets(pp.Normal(1e-3)), Rotation.from_rotvec([0.1, -0.4, 2.0]).as_matrix()
    stds = np.random.default_rng(5).uniform(5, 60, (14, 3))
    plain = pp.Measurement(target=OFF_AXIS, base="free")
    readings = readings_of(model, Q, plain, seed=4) @ turn.T + [0.3, -2.0, 1.0]
    data = read_data(model, written(tmp_path / "r.csv", Q, readings, AXES, stds), (plain,))
    np.testing.assert_allclose(data.axis_ratios * data.std[:, None], 1e-6 * stds, rtol=1e-9)
    problem, (base,) = Problem.of(model, data)
    # ten digits of the file's numbers; the base's first guess turns the readings
    white = np.concatenate([part.noise.whiten(problem.readings[part.rows]) for part in problem.chunks]).reshape(14, 3)
    expected = (data.readings - base[:3, 3]) / data.std[:, None] / data.axis_ratios
    np.testing.assert_allclose((white**2).sum(axis=1), (expected**2).sum(axis=1), rtol=1e-8)
    fit = pp.calibrate(model, data, plain)
    assert fit.given["axis_ratios"].shape == (14, 3)
    equal = written(tmp_path / "e.csv", Q, readings, AXES, np.full((14, 3), 25.0))
    one = written(tmp_path / "s.csv", Q, readings, ["std [um]"], np.full((14, 1), 25.0))
    fits = [pp.calibrate(model, path, plain) for path in (equal, one)]
    assert fits[0].chi_square == pytest.approx(fits[1].chi_square, rel=1e-9)
    assert fits[0].posterior.mean == pytest.approx(fits[1].posterior.mean, rel=1e-9)
    assert fit.posterior.std != pytest.approx(fits[0].posterior.std, rel=1e-2)


def test_an_unknown_std_keeps_the_ratios_of_the_columns(tmp_path):
    """All deviations of the file times 3 change nothing where std is estimated."""
    model, stds = offsets(pp.Normal(1e-3)), np.random.default_rng(5).uniform(5, 60, (14, 3))
    known = pp.Measurement(target=OFF_AXIS)
    noise = 1e-6 * stds * np.random.default_rng(6).normal(size=(14, 3))
    readings = readings_of(model, Q, replace(known, std=1e-9), seed=4) + noise
    unknown = replace(known, std="estimate")
    fits = [
        pp.calibrate(model, written(tmp_path / f"{factor}.csv", Q, readings, AXES, factor * stds), unknown)
        for factor in (1, 3)
    ]
    estimates = [fit.noise["std"].std for fit in fits]
    assert estimates[0] == pytest.approx(estimates[1], rel=1e-3)
    size = 1e-6 * np.sqrt((stds**2).mean())
    assert 0.7 * size < estimates[0] < 1.4 * size
    assert np.sqrt((fits[0].data.std ** 2).mean()) == pytest.approx(estimates[0], rel=1e-6)


def test_a_file_without_columns_keeps_the_line_of_sight_beside_one_with_them(tmp_path):
    model, names = offsets(pp.Normal(1e-3)), ("a", "b")
    instruments = tuple(replace(TRACKER, target_name="", base_name=name) for name in names)
    readings = readings_of(model, Q, TRACKER)
    first = written(tmp_path / "a.csv", Q, readings, AXES, np.tile([10.0, 20.0, 30.0], (14, 1)))
    second = written(tmp_path / "b.csv", Q, readings, [], np.zeros((14, 0)))
    problem, _ = Problem.of(model, read_data(model, [str(first), str(second)], instruments))
    np.testing.assert_allclose(problem.instrument[0], np.diag([10e-6, 20e-6, 30e-6]) ** 2, rtol=1e-9, atol=1e-20)
    np.testing.assert_allclose(problem.instrument[14], by_hand(readings[0]), rtol=1e-6, atol=1e-18)
    fit = pp.calibrate(model, [str(first), str(second)], instruments)
    assert fit.to_dict()["data"]["std"][14:] == [None] * 14


@pytest.mark.parametrize(
    ("heads", "values", "message"),
    [
        (["sx [um]", "sy [um]"], [10, 10], "no column for sz; sx, sy, sz belong together"),
        (["sx [um]", "sy [um]", "sz [um]"], [10, 0, 10], "std must be above zero, and so must sx, sy and sz"),
        (["sx [um]", "sy [um]", "sz [um]"], [10, 10, -1], "must be above zero"),
        (["sx [um]", "sy [um]", "sz [um]", "std [um]"], [10, 10, 10, 10], "give std, or sx, sy and sz"),
        (["sx [um]", "sy [mrad]", "sz [um]"], [10, 10, 10], "sy"),
        (["sx", "sy", "sz"], [10, 10, 10], "no unit"),
    ],
)
def test_wrong_columns_of_deviations_are_refused(tmp_path, heads, values, message):
    model, measurement = offsets(pp.Normal(1e-3)), pp.Measurement(target=OFF_AXIS)
    path = written(tmp_path / "w.csv", Q, readings_of(model, Q, measurement), heads, np.tile(values, (14, 1)))
    with pytest.raises(pp.InputError, match=message):
        read_data(model, path, (measurement,))
