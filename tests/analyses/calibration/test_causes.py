"""Errors that a sheet lacks: scores by dense least squares, tails by samples, planted causes by name, honest robots by count."""

from functools import cache

import numpy as np
import pytest
from scipy import optimize, stats

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, dense, offsets, plain_model, random_poses, readings_of
from precision_pin.analyses.calibration.causes import TOLERANCE, CauseColumns, rank, weigh
from precision_pin.analyses.calibration.data import read_data
from precision_pin.analyses.calibration.fit import Problem
from precision_pin.analyses.calibration.gains import JOINTS_READ
from precision_pin.analyses.calibration.table import calibration_table
from precision_pin.analyses.number_law import tail
from precision_pin.sources import Backlash, JointCompliance, Transmission

TRACKER = pp.Measurement(std=20e-6)
FREE = pp.Measurement(std=20e-6, target=OFF_AXIS, base="free", target_known=False)


@cache
def linear_problem():
    """Return the paper's arm at 25 poses with a free base: columns of causes, of the sheet and of the set-up, and labels."""
    model, q = plain_model(), random_poses(4, 15)
    data = read_data(model, (q, readings_of(model, q, FREE)), (FREE,))
    problem = Problem.of(model, data)[0]
    means = np.zeros(problem.unit.root.shape[1]), problem.start
    causes = CauseColumns.at(problem, data, problem.start)
    whole = dense(problem, *means, causes)
    return problem, whole.further, causes.labels, whole.by_z, whole.by_nuisance


@cache
def inverse():
    """Return the inverse of the covariance of the readings less the set-up, and the rank of that."""
    *_, by_z, fixed = linear_problem()
    null = np.linalg.svd(fixed / np.linalg.norm(fixed, axis=0))[0][:, np.linalg.matrix_rank(fixed) :]
    return null @ np.linalg.inv(null.T @ (np.eye(len(by_z)) + by_z @ by_z.T) @ null) @ null.T, null


def scores_of(readings, known=1e9):
    """Return what :func:`weigh` takes of readings ``(M,)``."""
    columns, (weight, null) = linear_problem()[1], inverse()
    total = float(readings @ weight @ readings)
    return columns.T @ weight @ readings, columns.T @ weight @ columns, total, null.shape[1], known


def test_a_tail_is_that_of_samples_and_of_f():
    for x in (3.5, 8.0, 14.0):
        assert tail(np.ones(2), x / 1e9, 1e9) == pytest.approx(stats.chi2.sf(x, 2), rel=0.06)
        assert tail(np.full(3, 5.0), 15 * x / 12, 12.0) == pytest.approx(stats.f.sf(x, 3, 12), rel=0.06)
    assert tail(np.array([2.0, 0.0]), 0.0, 1e9) == stats.chi2.sf(0.0, 1)
    squares = np.random.default_rng(0).standard_normal((12, 100_000)) ** 2
    weights = np.array([3.0, 1.0, 0.5, 0.1])
    form = weights @ squares[:4]
    assert tail(weights, 18.0 / 1e9, 1e9) == pytest.approx((form > 18).mean(), rel=0.08)
    # a share of the whole sum, as of a std that was tuned to it
    assert tail(weights - 1.2, 1.2, 8) == pytest.approx((form > 1.2 * squares.sum(axis=0)).mean(), rel=0.08)
    assert (tail(-np.ones(1), 1.0, 5), tail(np.zeros(1), 1.0, 0)) == (0.0, 1.0)


@pytest.mark.slow
def test_a_cause_is_weighed_by_dense_least_squares():
    """Amplitudes of one variance beside the arm's numbers: likelihood ratio, posterior mean and covariance by dense matrices."""
    _, columns, labels, by_z, _ = linear_problem()
    rng = np.random.default_rng(1)
    own = np.array([k for k, label in enumerate(labels) if label[:2] == ("wave, 2 in a turn", "joint3")])
    readings = columns[:, own] @ [6e-5, -3e-5] + by_z @ rng.standard_normal(by_z.shape[1])
    readings += rng.standard_normal(len(readings))
    found = weigh(own, scores_of(readings))
    null = inverse()[1]
    y, g = null.T @ readings, null.T @ columns[:, own]
    sheet = null.T @ (np.eye(len(by_z)) + by_z @ by_z.T) @ null

    def likelihood(variance):
        covariance = sheet + variance * g @ g.T
        return -np.linalg.slogdet(covariance)[1] / 2 - y @ np.linalg.solve(covariance, y) / 2

    variances = np.logspace(-12, -6, 200)
    best = variances[int(np.argmax([likelihood(one) for one in variances]))]
    assert found.gain == pytest.approx(likelihood(best) - likelihood(0.0), abs=0.02)
    gain = best * g.T @ np.linalg.inv(sheet + best * g @ g.T)
    np.testing.assert_allclose(found.mean, gain @ y, rtol=0.03)
    np.testing.assert_allclose(found.covariance, best * (np.eye(2) - gain @ g), rtol=0.1, atol=1e-13)
    # the score's own law: t'A⁻¹t is chi-square, and the form for one column is its square
    single = weigh(own[:1], scores_of(readings))
    score = (g[:, 0] @ np.linalg.solve(sheet, y)) ** 2 / (g[:, 0] @ np.linalg.solve(sheet, g[:, 0]))
    assert single.chance == pytest.approx(stats.chi2.sf(score, 1), rel=0.15)
    tuned = scores_of(readings, None)
    ratio = score / (tuned[2] - score) * (tuned[3] - 1)
    assert weigh(own[:1], tuned).chance == pytest.approx(stats.f.sf(ratio, 1, tuned[3] - 1), rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("known", [1e9, None])
def test_honest_robots_have_no_cause_as_often_as_stated(known):
    """Linear robots, a std that is known or tuned: of probabilities so many are small, up to three deviations of a count."""
    _, columns, labels, by_z, _ = linear_problem()
    rng, robots = np.random.default_rng(2), 30
    usable = np.diag(columns.T @ inverse()[0] @ columns) > 1e-9 * (columns**2).sum(axis=0)
    y = by_z @ rng.standard_normal((by_z.shape[1], robots)) + rng.standard_normal((len(by_z), robots))
    chances = np.array([rank(scores_of(one, known), labels, usable)[0] for one in y.T])
    for level in (0.0075, 0.05, 0.1):
        assert abs((chances < level).mean() - level) < 3 * np.sqrt(level * (1 - level) / robots)


PLANTED = {
    ("backlash by load", "joint3"): (Backlash(joint="joint3", backlash=8e-5, band=1e-6), 8e-5),
    ("wave, 2 in a turn", "joint2"): (Transmission(joint="joint2", amplitude=(5e-5,), order=(2.0,)), 5e-5),
    ("compliance", "joint3"): (JointCompliance(joint="joint3", compliance=1e-6), 1e-6),
}


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "joint"), PLANTED)
def test_a_planted_cause_is_named_with_its_joint_and_size(kind, joint):
    """Complete fits of a sheet one of whose numbers no reading sees: the true size is within its interval."""
    unseen, q, known = (
        JointCompliance(joint="joint1", compliance=pp.Normal(2e-6, mean=2e-5)),
        random_poses(4, 15),
        pp.Measurement(std=20e-6),
    )
    source, true = PLANTED[kind, joint]
    readings = readings_of(offsets(pp.Normal(1e-3), unseen, source), q, known, seed=6)
    found = pp.calibrate(offsets(pp.Normal(1e-3), unseen), (q, readings), known)
    first = found.causes[0]
    assert (first.kind, first.joint, first.is_shared, first.likelihood) == (kind, joint, False, 1.0)
    assert first.interval[0] < true < first.interval[1]
    assert kind not in [one.kind for one in found.causes if one.is_shared]
    # left-out readings are off by that and by noise
    assert 0.3 * found.rms("left out") < first.left_out < 1.1 * found.rms("left out")
    (warning,) = (one.message for one in found.findings if one.code == "W_CAUSE")
    assert (found.verdict, f"most likely {kind} of {joint} (" in warning) == ("disagrees", True)
    assert first.to_dict()["interval"] == list(first.interval)


@pytest.mark.slow
def test_backlash_by_motion_and_drift_follow_the_order_of_readings():
    model, q, gap = offsets(pp.Normal(1e-3)), random_poses(4, 20), 0.2e-3
    moved = np.sign(np.diff(q, axis=1, prepend=q[:, :1])) * (np.arange(4) == 1)[:, None]
    drift = np.linspace(0, 1, 20)[:, None] * [0.1e-3, 0, -0.05e-3]
    truths = {"backlash by motion": gap, "drift of base or instrument": float(np.hypot(0.1e-3, 0.05e-3))}
    readings = readings_of(model, q + gap / 2 * moved, FREE, seed=3), readings_of(model, q, FREE, seed=3) + drift
    for (kind, true), joint, given in zip(truths.items(), ("joint2", ""), readings, strict=True):
        first = pp.calibrate(model, (q, given), FREE).causes[0]
        assert (first.kind, first.joint) == (kind, joint)
        assert first.interval[0] < true < first.interval[1]


@pytest.mark.slow
def test_what_the_sheet_has_is_no_cause_and_a_small_tolerance_is_told_from_one():
    gear, q = PLANTED["wave, 2 in a turn", "joint2"][0], random_poses(4, 12)
    model = offsets(pp.Normal(1e-3), gear)
    known = pp.calibrate(model, (q, readings_of(model, q, TRACKER, seed=2)), TRACKER)
    assert (known.causes, known.verdict) == ((), "agrees")
    # offsets a hundred times as large as the sheet says
    real = offsets(pp.Normal(2e-4))
    first = pp.calibrate(offsets(pp.Normal(2e-6)), (q, readings_of(real, q, TRACKER, seed=2)), TRACKER).causes[0]
    assert (first.kind, first.unit) == (TOLERANCE, "prior std")
    assert first.joint.startswith("joint_offset[")


def written(path, q, readings, **more):
    """Write readings of the paper's arm with further columns, in SI."""
    names = [*(f"joint{k} [rad]" for k in range(1, 5)), "x [m]", "y [m]", "z [m]", *more]
    rows = np.column_stack([q.T, readings, *more.values()])
    np.savetxt(path, rows, "%.17g", delimiter=",", header=",".join(names), comments="")
    return path


@pytest.mark.slow
def test_an_arm_read_before_it_settled_is_named_with_the_gain_of_a_refit():
    """A share of the step from the pose before is left. The gain is that of other fits, each without one pose."""
    model, q, count = offsets(pp.Normal(1e-3)), random_poses(4, 20), 20
    steps, shares = np.diff(q, axis=1, prepend=q[:, :1]), np.array([5e-5, 8e-5, 6e-5, 7e-5])[:, None]
    readings = readings_of(model, q - shares * steps, TRACKER, seed=3)
    found = pp.calibrate(model, (q, readings), TRACKER)
    first, gain = found.causes[0], found.gains[0]
    assert (first.kind, first.is_shared, gain.kind, gain.label) == (
        "settling",
        True,
        "settling",
        str(first).split(" (")[0],
    )
    assert first.interval[0] < shares[int(first.joint[-1]) - 1, 0] < first.interval[1]
    chain, seen = model.chain, np.eye(count) == 0

    def away(x, rows):
        places = chain.at_columns(q[:, rows] + 1e-3 * x[:4, None] - 1e-4 * x[4:, None] * steps[:, rows]).pose[:3, 3]
        return (readings[rows] - places.T).ravel() / TRACKER.std

    def left_out(row):
        # shares have a wide prior, as the fit gives them
        cost = optimize.least_squares(lambda x: np.append(away(x, seen[row]), x * np.repeat([1, 1e-2], 4)), np.zeros(8))
        return away(cost.x, [row])

    refit = TRACKER.std * np.sqrt(np.mean([(left_out(row) ** 2).sum() for row in range(count)]))
    assert gain.after == pytest.approx(refit, rel=0.05)
    assert (gain.before, gain.after < 0.8 * gain.before) == (pytest.approx(found.improvement.after, rel=1e-9), True)
    assert gain.interval[0] < gain.gain < gain.interval[1]
    (warning,) = (one.message for one in found.findings if one.code == "W_CAUSE")
    assert f"left-out error {1e3 * gain.before:.3g} -> {1e3 * gain.after:.3g} mm rms" in warning


@pytest.mark.slow
def test_readings_without_weight_that_a_cause_explains_are_counted():
    """After long steps a joint is late by more than a gross error; one reading is off by 5 mm besides."""
    model, rng = offsets(pp.Normal(1e-3)), np.random.default_rng(3)
    q = rng.uniform(-2.2, 2.2, (4, 40)) * np.where(rng.random(40) < 0.8, 0.2, 1.0)
    late = np.array([0, 2e-4, 0, 0])[:, None] * np.diff(q, axis=1, prepend=q[:, :1])
    readings = readings_of(model, q - late, TRACKER, seed=3)
    for off, said in ((0.0, "explains 2 of 2 readings without"), (5e-3, "explains 2 of 3 readings without")):
        readings[7, 0] += off
        found = pp.calibrate(model, (q, readings), TRACKER)
        assert (found.causes[0].kind, 7 in {error.reading for error in found.gross_errors}) == ("settling", off > 0)
        assert said in next(one.message for one in found.findings if one.code == "W_CAUSE")


@pytest.mark.slow
def test_backlash_by_approach_is_fitted_in_the_order_of_rows():
    """Joints that lag by half their gap behind their last motion: the gap is found, and nothing else is missing."""
    gap, q = 1.5e-4, random_poses(4, 20)
    play = [Backlash(joint=f"joint{k}", backlash=pp.Uniform(2e-4, mean=2e-4), band=1e4) for k in range(1, 5)]
    model, moves = offsets(pp.Normal(1e-3), *play), np.sign(np.diff(q, axis=1, prepend=q[:, :1]))
    readings = readings_of(offsets(pp.Normal(1e-3)), q - gap / 2 * moves, TRACKER, seed=3)
    found = pp.calibrate(model, (q, readings), TRACKER, approach="previous")
    assert (found.verdict, found.causes) == ("agrees", ())
    intervals = np.array([found.interval(f"backlash[joint{k}].backlash") for k in range(1, 5)])
    assert ((intervals[:, 0] < gap) & (gap < intervals[:, 1])).all(), intervals
    assert np.ptp(intervals[:3], axis=1).max() < gap, intervals
    side = pp.ApproachedPose(q[:, 5], moves[:, 5].astype(int).tolist())
    np.testing.assert_allclose(found.predict(side)[:3, 3] + found.residuals[5], readings[5], atol=1e-12)
    # without it the load decides, and the order of rows is named
    assert pp.calibrate(model, (q, readings), TRACKER).causes[0].kind == "backlash by motion"


@pytest.mark.slow
def test_joint_values_as_read_are_compared_with_those_given(tmp_path):
    """The gain is the difference of two fits, whichever of both is given."""
    model, given = offsets(pp.Normal(1e-3)), random_poses(4, 20)
    read = given + np.random.default_rng(1).uniform(-3e-5, 3e-5, given.shape)
    readings = readings_of(model, given, TRACKER, seed=3)
    outcomes = []
    for q, other in ((given, read), (read, given)):
        more = {f"joint{k}_read [rad]": values for k, values in enumerate(other, 1)}
        outcomes.append(pp.calibrate(model, written(tmp_path / "a.csv", q, readings, **more), TRACKER))
    errors = [outcome.improvement.after for outcome in outcomes]
    for outcome, before, after in zip(outcomes, errors, errors[::-1], strict=True):
        (entry,) = (one for one in outcome.gains if one.kind == JOINTS_READ)
        assert (entry.before, entry.after) == (pytest.approx(before, rel=1e-9), pytest.approx(after, rel=0.05))
        is_better = before > after
        assert ("W_JOINTS_READ" in {one.code for one in outcome.findings}) == is_better
        assert f"better: {'as read' if is_better else 'as given'}" in calibration_table(outcome)


@pytest.mark.slow
def test_joints_read_while_they_move_are_late_by_a_time(tmp_path):
    model, q = offsets(pp.Normal(1e-3)), random_poses(4, 20)
    speeds, late = np.random.default_rng(2).normal(0, 0.02, (4, 20)), 8e-3
    more = {f"joint{k}_speed [deg/s]": np.degrees(values) for k, values in enumerate(speeds, 1)}
    readings = readings_of(model, q - late * speeds, TRACKER, seed=3)
    first = pp.calibrate(model, written(tmp_path / "a.csv", q, readings, **more), TRACKER).causes[0]
    assert (first.kind, first.unit, " ms; 95 %: " in str(first)) == ("settling", "s", True)
    assert first.interval[0] < late < first.interval[1]
    del more["joint2_speed [deg/s]"]
    with pytest.raises(pp.InputError, match=r"no column for joint2_speed; joint1_speed, .* belong together"):
        pp.calibrate(model, written(tmp_path / "b.csv", q, readings, **more), TRACKER)


@pytest.mark.slow
def test_growth_by_temperature_is_told_from_growth_in_time(tmp_path):
    model, q = offsets(pp.Normal(1e-3)), random_poses(4, 20)
    warmth = np.random.default_rng(1).uniform(18, 30, 20)
    readings = readings_of(model, q, TRACKER, seed=3) * (1 + 20e-6 * (warmth - warmth.mean())[:, None])
    file = written(tmp_path / "a.csv", q, readings, **{"temperature [degC]": warmth})
    first = pp.calibrate(model, file, TRACKER).causes[0]
    assert (first.kind, first.unit) == ("growth by temperature", "1/K")
    assert first.interval[0] < 20e-6 < first.interval[1]
    # a column without values tells nothing, and drops no row
    empty = written(tmp_path / "b.csv", q, readings, **{"temperature [degC]": np.full(20, np.nan)})
    assert len(pp.calibrate(model, empty, TRACKER).data.lines) == 20
