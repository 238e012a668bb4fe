"""Drift of an instrument: random walks by dense algebra, intervals in closed form, sessions in plain numpy, wrong files."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, dense, offsets, random_poses
from precision_pin.analyses.calibration.data import read_data
from precision_pin.analyses.calibration.design import UnitNumbers
from precision_pin.analyses.calibration.drift import (
    MOST_KNOTS,
    FixedReadings,
    Session,
    ShownDrift,
    drift_ahead,
    remainder,
    steps_of,
)
from precision_pin.analyses.calibration.fit import Problem
from precision_pin.analyses.readings import stations_of
from precision_pin.sheet.drift import Drift
from support.refusals import check_refused

STD, DRIFT = 15e-6, {"std": "40 um", "every": "1 h"}
RATE = 40e-6**2 / 3600
TRACKER = pp.Measurement(std=STD, target=OFF_AXIS)
DRIFTING = replace(TRACKER, drift=DRIFT)


def model():
    return offsets(pp.Normal(1e-3))


def dense_remainder(times, fixed_times, targets, std=STD, rate=RATE):
    """Return mean's weights and covariance of a walk along one axis, given fixed targets, by whole covariance matrices."""
    start = min(times.min(), fixed_times.min(initial=np.inf))
    both = np.concatenate([times, fixed_times]) - start
    walk = rate * np.minimum.outer(both, both)
    n, places = times.size, np.eye(targets.max(initial=-1) + 1)[targets]
    noise = np.linalg.inv(walk[n:, n:] + std**2 * np.eye(targets.size))
    through = noise @ places
    noise -= through @ np.linalg.inv(places.T @ through) @ through.T  # places without prior
    weights = walk[:n, n:] @ noise
    return weights, walk[:n, :n] - weights @ walk[n:, :n]


def session(seed, poses=30, targets=3, drift=40e-6):
    """Return cells of a file, its joint errors and its walk: targets at the beginning, twice on the way and at the end."""
    generator, q = np.random.default_rng(seed), random_poses(4, poses)
    errors, places = generator.normal(0, 1e-3, 4), generator.uniform(-1, 1, (targets, 3))
    events = [("arm", k) for k in range(poses)]
    for at in (poses, 2 * poses // 3, poses // 3, 0):
        events[at:at] = [("fixed", k) for k in range(targets)]
    times = np.linspace(100, 7300, len(events))
    steps = drift * np.sqrt(np.diff(times, prepend=100) / 3600)
    walk = np.cumsum(steps[:, None] * generator.normal(size=(len(events), 3)), axis=0)
    rows = []
    for (kind, k), time, shift in zip(events, times, walk, strict=True):
        pose = model().chain.at(q[:, k] + errors).pose
        point = places[k] if kind == "fixed" else pose[:3, 3] + pose[:3, :3] @ OFF_AXIS
        cells = 1e3 * (point + shift + generator.normal(0, STD, 3))
        joints = [""] * 4 if kind == "fixed" else q[:, k]
        rows.append([*map(str, [*joints, *cells, time]), f"ball {k}" if kind == "fixed" else ""])
    return rows, errors, walk[[kind == "arm" for kind, _ in events]]


HEADS = [*(f"joint{k} [rad]" for k in range(1, 5)), "x [mm]", "y [mm]", "z [mm]", "time [s]", "fixed"]


def written(path, rows, heads=HEADS):
    path.write_text("\n".join(",".join(row) for row in [heads, *rows]) + "\n", "utf-8")
    return str(path)


def test_what_remains_of_a_walk_is_that_of_dense_covariances():
    generator = np.random.default_rng(0)
    for count in (MOST_KNOTS, 300):
        times = np.sort(generator.uniform(50, 7000, count))
        is_fixed = np.arange(count) % 5 == 0
        targets = np.arange(is_fixed.sum()) % 3
        points = generator.normal(size=(targets.size, 3))
        fixed = FixedReadings(times[is_fixed], targets, points, np.tile(STD**2 * np.eye(3), (targets.size, 1, 1)))
        left = remainder(RATE, times[~is_fixed], fixed)
        weights, covariance = dense_remainder(times[~is_fixed], times[is_fixed], targets)
        # readings between two knots share a bridge, of a quarter of the variance from knot to knot, that is left out
        tolerance = 1e-9 if count == MOST_KNOTS else RATE * (times[3:] - times[:-3]).max() / 4 / covariance.max()
        for axis in range(3):
            found = left.steps.factors[:, axis] @ left.steps.factors[:, axis].T + np.diag(left.steps.own)
            np.testing.assert_allclose(found, covariance, rtol=0, atol=tolerance * covariance.max())
        np.testing.assert_allclose(left.mean, weights @ points, atol=tolerance * np.abs(weights @ points).max())
    # what the walk does between knots is an error of each target's reading: never less is left than by the whole covariance
    quiet = fixed._replace(covariances=fixed.covariances * 1e-2)
    covariance = dense_remainder(times[~is_fixed], times[is_fixed], targets, STD / 10)[1]
    assert (remainder(RATE, times[~is_fixed], quiet).std ** 2 > 0.999 * np.diag(covariance)[:, None]).all()
    free = Session.of(times[~is_fixed], fixed, Drift(40e-6, 3600.0), is_free=True).left
    np.testing.assert_allclose(free.mean, left.mean - left.mean.mean(axis=0), atol=1e-15)
    np.testing.assert_allclose(free.steps.factors, left.steps.factors - left.steps.factors.mean(axis=0), atol=1e-15)
    (steps,) = steps_of(RATE, np.full(4, 7.0))  # one time: nothing moves
    assert steps.factors.shape == (4, 0)
    assert not remainder(0.0, times, fixed).steps.factors.size


def test_what_will_remain_is_that_of_targets_read_with_the_noise_of_the_instrument():
    drift = Drift.of({**DRIFT, "pace": "3 min", "fixed": 2, "fixed_every": "21 min"})
    expected = dense_remainder(*drift.schedule(20))[1]
    about_mean = np.eye(20) - 1 / 20
    for is_free, covariance in ((False, expected), (True, about_mean @ expected @ about_mean)):
        left = drift_ahead(drift, 20, STD, is_free=is_free)
        assert not left.mean.any()
        assert not left.steps.own.any()
        for axis in range(3):
            found = left.steps.factors[:, axis] @ left.steps.factors[:, axis].T
            np.testing.assert_allclose(found, covariance, rtol=0, atol=1e-12 * expected.max())


def test_fixed_targets_have_the_std_of_their_rows(tmp_path):
    rows = session(3)[0]
    stds = ["70" if row[8] else "20" for row in rows]
    path = written(tmp_path / "r.csv", [[*row, std] for row, std in zip(rows, stds, strict=True)], [*HEADS, "std [um]"])
    (taken,) = read_data(model(), path, (DRIFTING,)).sessions
    of_arm, of_fixed = (
        np.array([float(row[7]) for row in rows if bool(row[8]) == is_fixed]) for is_fixed in (False, True)
    )
    targets = np.array([int(row[8][-1]) for row in rows if row[8]])
    covariance = dense_remainder(of_arm, of_fixed, targets, 70e-6)[1]
    np.testing.assert_allclose(taken.left.std**2, np.diag(covariance)[:, None].repeat(3, axis=1), rtol=1e-9)


def test_fixed_targets_far_from_a_tracker_have_its_std_there(tmp_path):
    """A tracker at a known place in a free base, whose axes are turned by 90° about z."""
    rows = session(3)[0]
    turned = [[*row[:4], str(-float(row[5]) + 500), row[4], *row[6:]] for row in rows]
    measurement = pp.Measurement(
        std={"along": "15 um + 1e-9 um/m", "across": "15 um + 6 um/m"}, target=OFF_AXIS, base="free", stands_at=(6, 0, 0),
        drift=DRIFT,
    )  # fmt: skip
    (taken,) = read_data(model(), written(tmp_path / "r.csv", turned), (measurement,)).sessions
    fixed = [row for row in turned if row[8]]
    points = np.array([row[4:7] for row in fixed], dtype=float) / 1e3
    lines = points - [0.5, 6, 0]
    distance = np.linalg.norm(lines, axis=1)
    unit, across = lines / distance[:, None], (15e-6 + 6e-6 * distance) ** 2
    along = unit[:, :, None] * unit[:, None]
    covariances = across[:, None, None] * (np.eye(3) - along) + STD**2 * along
    times = [np.array([float(row[7]) for row in turned if bool(row[8]) == is_fixed]) for is_fixed in (False, True)]
    targets = np.array([int(row[8][-1]) for row in fixed])
    expected = Session.of(
        times[0], FixedReadings(times[1], targets, points, covariances), measurement.drift, is_free=True
    )
    # the nominal arm, of zeros within 1 mrad, tells the distance to millimetres
    np.testing.assert_allclose(taken.left.std, expected.left.std, rtol=2e-3)


def test_the_interval_of_one_target_read_twice_is_that_of_chi_square():
    """The squares of the three differences are chi-square of three degrees, times 1 + λ θ with λ = Δt/2σ²."""
    places, seconds = np.array([[0, 0, 0], [90e-6, -30e-6, 60e-6]]), np.array([0.0, 1800.0])
    fixed = FixedReadings(seconds, np.zeros(2, dtype=int), places, np.tile(STD**2 * np.eye(3), (2, 1, 1)))
    total, information = (places[1] ** 2).sum() / (2 * STD**2), 1800 / (2 * STD**2)
    shown = ShownDrift.of(fixed, 3600.0, None)
    # the tail is a saddlepoint approximation
    assert shown.chance == pytest.approx(chi2.sf(total, 3), rel=0.08)
    assert shown.std == pytest.approx(np.sqrt((total / 3 - 1) / information * 3600), rel=1e-6)
    ends = [np.sqrt((total / chi2.isf(side, 3) - 1) / information * 3600) for side in (0.025, 0.975)]
    assert shown.interval == pytest.approx(ends, rel=0.02)
    stated = ShownDrift.of(fixed, 3600.0, Drift(10e-6, 3600.0))
    expected = 2 * chi2.sf(total / (1 + information * 10e-6**2 / 3600), 3)
    assert stated.chance == pytest.approx(expected, rel=0.08)
    still = ShownDrift.of(fixed._replace(points=places * 0.1), 3600.0, None)
    assert (still.std, still.interval[0]) == (0.0, 0.0)
    # read alike to the last digit: less than any noise
    alike = ShownDrift.of(fixed._replace(points=places * 0.0), 3600.0, None)
    assert (alike.std, alike.interval, alike.chance) == (0.0, (0.0, 0.0), 1.0)
    assert ShownDrift.of(fixed._replace(times=np.zeros(2)), 3600.0, None) is None


def test_a_drift_is_taken_out_and_neglected_it_is_named(tmp_path):
    rows, errors, walk = session(5)
    path = written(tmp_path / "r.csv", rows)
    fit, neglected = (
        pp.calibrate(model(), path, measurement, at=random_poses(4, 1)) for measurement in (DRIFTING, TRACKER)
    )
    (taken,) = fit.data.sessions
    z = (walk - taken.left.mean) / taken.left.std
    assert np.abs(z).max() < 3.5
    assert taken.left.std.max() < 0.4 * np.sqrt(RATE * 7200)
    assert (fit.verdict, neglected.verdict) == ("agrees", "disagrees")
    scores = [(found.posterior.mean[name] - error) / found.posterior.std[name]
              for found in (fit, neglected) for name, error in zip(fit.posterior.names, errors, strict=True)]  # fmt: skip
    assert np.abs(scores[:4]).max() < 3 < np.abs(scores[4:]).max()
    (finding,) = [finding for finding in neglected.findings if finding.code == "W_DRIFT"]
    assert "12 readings of 3 fixed targets show a drift of " in finding.message
    assert finding.message.endswith("um, every: 1 h}}")
    assert "W_DRIFT" not in {finding.code for finding in fit.findings}
    assert taken.shown.interval[0] < 40e-6 < taken.shown.interval[1]
    little = pp.calibrate(model(), path, replace(TRACKER, drift={"std": "5 um", "every": "1 h"}))
    assert "not of 5 µm" in next(finding.message for finding in little.findings if finding.code == "W_DRIFT")

    # a target that moved by itself counts as another one from then on
    def moved(name):
        return [[*row[:4], str(float(row[4]) + 1), *row[5:8], name] if k > 20 and row[8] == "ball 1" else row
                for k, row in enumerate(rows)]  # fmt: skip

    touched = pp.calibrate(model(), written(tmp_path / "touched.csv", moved("ball 1")), DRIFTING)
    assert "without ball 1 they do not, so it moved by itself" in next(
        f.message for f in touched.findings if f.code == "W_DRIFT"
    )
    assert pp.calibrate(model(), written(tmp_path / "named.csv", moved("again")), DRIFTING).verdict == "agrees"
    # the JSON has the readings as given
    given = np.array([row[4:7] for row in rows if not row[8]], dtype=float)
    np.testing.assert_allclose(1e3 * fit.given["readings"], given, atol=1e-9)
    in_json = fit.to_dict()["drift"][0]
    assert (in_json["targets"], in_json["readings"], in_json["drift"]["every"]) == (3, 12, 3600.0)
    assert "drift 40 µm in 1 h; " in fit._repr_html_()
    # a file of its own for the targets, and minutes
    arm, fixed = ([row for row in rows if bool(row[8]) == is_fixed] for is_fixed in (False, True))
    minutes = [[*row[4:7], str(float(row[7]) / 60), row[8]] for row in fixed]
    files = [
        written(tmp_path / "arm.csv", [row[:8] for row in arm], HEADS[:8]),
        written(tmp_path / "fixed.csv", minutes, [*HEADS[4:7], "t [min]", "fixed"]),
    ]
    apart = pp.calibrate(model(), files, DRIFTING)
    assert apart.chi_square == pytest.approx(fit.chi_square, rel=1e-9)
    assert apart.posterior.mean == pytest.approx(fit.posterior.mean, rel=1e-9)


def test_left_out_readings_follow_from_the_others_with_what_all_share(tmp_path):
    """By the whole covariance of readings, the arm's numbers integrated out: a left-out one is its conditional mean."""
    data = read_data(model(), written(tmp_path / "r.csv", session(2)[0]), (DRIFTING,))
    problem, _ = Problem.of(model(), data)
    fit = pp.calibrate(model(), data, DRIFTING)
    z = np.array([fit.posterior.mean[name] for name in fit.posterior.names]) / 1e-3
    seen = dense(problem, z, np.zeros(0))
    by_z = np.linalg.cholesky(seen.noise) @ seen.by_z
    factors = data.sessions[0].left.steps.factors.reshape(90, -1)
    noise = factors @ factors.T + np.diag(np.repeat(data.sessions[0].left.steps.own + STD**2, 3))
    residuals = problem.residuals(z, np.zeros(0))
    whole, start = noise + by_z @ by_z.T, residuals.ravel() + by_z @ z
    for row in (0, 7, 29):
        own, others = np.arange(3 * row, 3 * row + 3), np.delete(np.arange(90), np.arange(3 * row, 3 * row + 3))
        weights = np.linalg.solve(whole[np.ix_(others, others)], whole[np.ix_(others, own)]).T
        np.testing.assert_allclose(fit.left_out[row], start[own] - weights @ start[others], rtol=1e-6)
        covariance = whole[np.ix_(own, own)] - weights @ whole[np.ix_(others, own)]
        np.testing.assert_allclose(fit.std_left_out[row], np.sqrt(np.diag(covariance)), rtol=1e-6)
    np.testing.assert_allclose(seen.noise, noise, atol=1e-9 * noise.max())
    inverse = np.linalg.inv(noise)
    np.testing.assert_allclose(problem.precision_times(residuals), inverse @ residuals.ravel(), rtol=1e-7)
    reduction = problem.reduce(z, np.zeros(0))
    assert reduction.white @ reduction.white == pytest.approx(residuals.ravel() @ inverse @ residuals.ravel(), rel=1e-9)
    information = problem.by_z(reduction).T @ problem.by_z(reduction)
    np.testing.assert_allclose(information, by_z.T @ inverse @ by_z, rtol=1e-7)


@pytest.mark.slow
def test_a_std_is_estimated_beside_a_drift(tmp_path):
    rows = [row[:8] for row in session(3)[0] if not row[8]]
    found = pp.calibrate(model(), written(tmp_path / "r.csv", rows, HEADS[:8]), replace(DRIFTING, std="estimate"))
    low, high = found.noise["std"].interval
    assert low < STD < high < 2.5 * low


@pytest.mark.slow
def test_the_forecast_is_that_of_normal_equations_with_the_covariance_of_what_remains():
    q, by_number, numbers = random_poses(4, 20), [], UnitNumbers.of(model().space)
    ahead = replace(TRACKER, drift={**DRIFT, "pace": "3 min", "fixed": 2, "fixed_every": "7 readings"})
    for pose in stations_of(model(), q, TRACKER):
        slopes = TRACKER.slopes(pose.at.posture.pose, pose.at.error_at_means, np.zeros(0)).error
        by_number.append(slopes @ pose.at.jacobian[:, numbers.columns])
    slopes = np.concatenate(by_number)
    schedule = Drift.of({**DRIFT, "pace": "3 min", "fixed": 2, "fixed_every": "21 min"}).schedule(20)
    left = [np.kron(dense_remainder(*schedule)[1], np.eye(3)), np.zeros((60, 60))]
    for measurement, covariance in zip((ahead, TRACKER), left, strict=True):
        information = 1e6 * np.eye(4) + slopes.T @ np.linalg.solve(covariance + STD**2 * np.eye(60), slopes)
        forecast, expected = pp.forecast_calibration(model(), q, measurement), np.linalg.inv(information)
        np.testing.assert_allclose(forecast.posterior.covariance, expected, rtol=1e-5, atol=1e-7 * expected.max())
    worse, better = (pp.forecast_calibration(model(), q, measurement) for measurement in (ahead, TRACKER))
    assert worse.rms("after") > 1.05 * better.rms("after")
    assert worse.by_count[-3].rms_position == pytest.approx(worse.rms("after"), rel=1e-9)
    plans = [pp.plan_calibration(model(), q, 6, measurement) for measurement in (ahead, TRACKER)]
    assert plans[0].rms("after") > plans[1].rms("after")
    taken = pp.forecast_calibration(model(), plans[0].q, ahead, at=q)
    assert plans[0].rms("after") == pytest.approx(taken.rms("after"), rel=1e-9)


def test_the_schedule_by_hand():
    drift = Drift.of({"std": "1 um", "every": "10 readings", "fixed": 2, "fixed_every": "2 readings"})
    times, fixed, targets = drift.schedule(5)
    np.testing.assert_array_equal(times, [2, 3, 6, 7, 10])
    np.testing.assert_array_equal(fixed, [0, 1, 4, 5, 8, 9, 11, 12])
    np.testing.assert_array_equal(targets, [0, 1] * 4)
    assert drift.rate == pytest.approx(1e-13)
    paced = Drift.of({"std": 1e-6, "every": 3600.0, "pace": 20, "fixed": "1", "fixed_every": "1 min"})
    assert paced.schedule(4)[0].tolist() == [20.0, 40.0, 60.0, 100.0]
    assert paced.schedule(4)[1].tolist() == [0.0, 80.0, 120.0]
    assert [str(Drift(2e-5, every)) for every in (7200.0, 90.0, 5.0)] == [
        f"drift 20 µm in {every}" for every in ("2 h", "1.5 min", "5 s")
    ]
    walks = np.array([drift.walk(np.array([40.0, 10.0, 0.0]), np.random.default_rng(seed)) for seed in range(2000)])
    # of 6,000 numbers a variance is known to 1.8 %
    np.testing.assert_allclose((walks**2).mean(axis=(0, 2)), [4e-12, 1e-12, 0], rtol=0.08)
    assert (walks[:, 0] * walks[:, 1]).mean() == pytest.approx(1e-12, rel=0.1)


@pytest.mark.parametrize("settings", [{"every": "1 h", "pace": "2 min"}, {"every": "30 readings"}])
def test_simulated_readings_drift_and_are_read_back(tmp_path, settings):
    drifting = replace(TRACKER, drift={"std": "40 um", "fixed": 3, "fixed_every": "10 readings", **settings})
    readings = pp.simulate(model(), random_poses(4, 30), drifting, unit=4)
    still = pp.simulate(model(), random_poses(4, 30), TRACKER, unit=4)
    steps = (
        np.diff(readings.values - still.values, axis=0)
        / np.sqrt(drifting.drift.rate * np.diff(readings.times))[:, None]
    )
    assert chi2.ppf(0.001, 87) < (steps**2).sum() < chi2.ppf(0.999, 87)
    path = tmp_path / "s.csv"
    path.write_text(readings.to_csv(["simulated"]), "utf-8")
    data = read_data(model(), str(path), (drifting,))
    (taken,) = data.sessions
    assert (len(data), taken.targets, taken.readings) == (30, 3, 12)
    fit = pp.calibrate(model(), data, drifting)
    assert fit.verdict == "agrees"


def test_wrong_settings_of_a_drift_are_refused():
    def drifting(**settings):
        return pp.Measurement(drift={"std": "20 um", "every": "1 h", **settings})

    assert drifting(pace=None).drift == Drift(pytest.approx(20e-6), 3600.0)
    check_refused(
        ("every of drift, such as 1 h or 100 readings: '1' has no unit", lambda: drifting(every="1")),
        ("every of drift.* 'kg' in '1 kg' is not a unit of time", lambda: drifting(every="1 kg")),
        ("every of drift must be above zero", lambda: drifting(every="0 readings")),
        ("every of drift must be above zero, got '-2 h'", lambda: drifting(every="-2 h")),
        ("every of drift must be above zero, got '-3 readings'", lambda: drifting(every="-3 readings")),
        ("std of drift must be above zero, got '-1 um'", lambda: drifting(std="-1 um")),
        ("std of drift must be above zero, in m", lambda: drifting(std=-1e-6)),
        ("drift needs std and every", lambda: pp.Measurement(drift={"std": "20 um"})),
        ("drift needs std and every", lambda: drifting(rate=3)),
        ("pace of drift belongs to every: of a time", lambda: drifting(every="9 readings", pace="1 s")),
        ("belong together", lambda: drifting(fixed=3)),
        ("a number of targets, from 1 to 9999, got 0", lambda: drifting(fixed=0, fixed_every="2 readings")),
        ("fixed_every of drift needs pace", lambda: drifting(fixed=3, fixed_every="2 min")),
        (
            "drift belongs to .* a position or a pose, not of a distance",
            lambda: pp.Measurement("distance", drift=DRIFT),
        ),
        ("drift of a measurement must be", lambda: pp.Measurement(drift="20 um")),
        ("before anything is read, drift needs pace", pp.forecast_calibration, model(), random_poses(4, 5), DRIFTING),
        ("arrays have no times", pp.calibrate, model(), (random_poses(4, 5), np.zeros((5, 3))), DRIFTING),
    )


def test_wrong_files_of_fixed_targets_are_refused(tmp_path):
    rows, _, _ = session(1, poses=6)
    arm = [row for row in rows if not row[8]]

    def change(row, column, cell):
        return [[*line[:column], cell, *line[column + 1 :]] if k == row else line for k, line in enumerate(rows)]

    def read(name, rows, heads=HEADS, measurement=DRIFTING, *before):
        return read_data(model(), [*before, written(tmp_path / name, rows, heads)], (measurement,))

    only_arm = written(tmp_path / "arm.csv", [row[:8] for row in arm], HEADS[:8])
    counted = replace(TRACKER, drift={"std": "20 um", "every": "9 readings"})
    fixed = [row[4:] for row in rows if row[8]]
    check_refused(
        (r"a\.csv:2: .*the fixed target ball 9 is read once; read it again later", read, "a.csv", change(0, 8, "ball 9")),
        (r"k\.csv:\d+: .* mm from where line 2 has it; another target, or one", read, "k.csv", change(0, 4, "9999")),
        ("l.csv: .*no valid readings; every row is of a fixed target", read, "l.csv", [row for row in rows if row[8]]),
        ("needs the time of each reading, a column such as time", read, "b.csv", [r[:7] + r[8:] for r in rows],
         HEADS[:7] + HEADS[8:]),
        ("a fixed target needs the time", read, "b.csv", [r[:7] + r[8:] for r in rows], HEADS[:7] + HEADS[8:], TRACKER),
        (r"c\.csv:3: .*the time is negative: -3 s", read, "c.csv", change(1, 7, "-3")),
        (r"d\.csv:4: .*the time is missing", read, "d.csv", change(2, 7, "")),
        ("'mm' of the column 'time' is not a unit of time", read, "e.csv", rows, [*HEADS[:7], "time [mm]", "fixed"]),
        ("fixed targets need the std of the instrument", read, "f.csv", rows, HEADS, replace(TRACKER, std="estimate")),
        ("a file of fixed targets follows that", read, "g.csv", fixed, HEADS[4:]),
        ("fixed targets need the time", read, "j.csv", [r[:3] + r[4:] for r in fixed], [*HEADS[4:7], "fixed"],
         DRIFTING, only_arm),
        ("need drift: .* a time", read, "h.csv", fixed, HEADS[4:], counted, only_arm),
    )  # fmt: skip
    distances = [[*row[:4], row[4], *row[7:]] for row in rows]
    heads = [*HEADS[:4], "distance [mm]", *HEADS[7:]]
    check_refused(
        ("fixed targets are read as positions or poses", read, "i.csv", distances, heads, pp.Measurement("distance"))
    )
    # nothing is known of the walk where readings are counted and no target stands still
    data = read_data(model(), only_arm, (counted,))
    assert not data.sessions[0].left.mean.any()
    assert data.sessions[0].left.std[-1] == pytest.approx(np.full(3, 20e-6 * np.sqrt(5 / 9)))
    in_arrays = read_data(model(), (data.q, data.readings), (counted,))
    np.testing.assert_allclose(in_arrays.sessions[0].left.std, data.sessions[0].left.std)


@pytest.mark.slow
def test_where_a_walk_is_counted_from_is_nothing_to_a_free_base(tmp_path):
    free = replace(DRIFTING, base="free")
    data = read_data(model(), written(tmp_path / "r.csv", session(4)[0]), (free,))
    (about_mean,) = data.sessions
    np.testing.assert_allclose(about_mean.left.mean.mean(axis=0), 0, atol=1e-12)
    (from_start,) = read_data(model(), str(tmp_path / "r.csv"), (DRIFTING,)).sessions
    np.testing.assert_allclose(np.diff(from_start.left.mean, axis=0), np.diff(about_mean.left.mean, axis=0), atol=1e-12)
    as_read = data.readings + about_mean.left.mean
    other = replace(data, sessions=(from_start,), readings=as_read - from_start.left.mean)
    fits = [pp.calibrate(model(), given, free) for given in (data, other)]
    assert fits[0].chi_square == pytest.approx(fits[1].chi_square, rel=1e-6)
    for name, std in fits[0].posterior.std.items():
        assert abs(fits[0].posterior.mean[name] - fits[1].posterior.mean[name]) < 1e-4 * std
        assert std == pytest.approx(fits[1].posterior.std[name], rel=1e-6)
    assert (fits[0].set_up.base_std < 1.01 * fits[1].set_up.base_std).all()
    plain = pp.calibrate(model(), data, free, prior=False, at=data.q[:, :1])
    check_refused(("its instrument drifted, so that its readings", pp.population, model(), [plain, plain], free))
    ahead = replace(free, drift={**DRIFT, "pace": "3 min"})
    plan = pp.plan_calibration(model(), data.q, 6, ahead)
    assert plan.rms("after") == pytest.approx(pp.forecast_calibration(model(), plan.q, ahead, at=data.q).rms("after"))
