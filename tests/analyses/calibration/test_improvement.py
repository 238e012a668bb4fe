"""Left-out readings, what useless and wrong calibrations say, a std from readings: by other fits, closed forms and numpy."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import optimize, special, stats
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, dense, offsets, paper_model, plain_model, random_poses, readings_of
from precision_pin.analyses.calibration.calibrate import LeftOutShare, gain_interval
from precision_pin.analyses.calibration.data import read_data
from precision_pin.analyses.calibration.design import Estimator, UnitNumbers, stack_at_means
from precision_pin.analyses.calibration.fit import Problem, leave_out
from precision_pin.analyses.calibration.std_estimate import (
    Likelihood,
    _columns,
    _reduced,
    _stations,
    largest_likelihood,
)
from precision_pin.analyses.readings import stations_of
from support.refusals import check_refused


@pytest.mark.slow
@pytest.mark.parametrize("law", [pp.Normal(1e-3), pp.Uniform(0.4e-3)])
def test_what_is_left_out_is_what_a_fit_without_it_leaves(law):
    """Poses visited twice, repeatability, numbers at the ends of their laws: residual and deviation by other fits.

    Encoders tell no less than the two visits differ by: they are left out together, as those of one group are.
    """
    repeat = pp.sources.JointOffset(joint="joint2", offset=pp.Draw("", pp.Normal(2e-5), pp.Scope.VISIT))
    model, real = offsets(law, repeat), offsets(pp.Normal(0.5e-3), repeat)
    tip = pp.Measurement(std=20e-6)
    q = np.repeat(random_poses(4, 6), 2, axis=1) + 1e-8 * np.arange(12)[None] % 2e-8
    readings = readings_of(real, q, tip, seed=4)
    data, size = read_data(model, (q, readings), (tip,)), 2
    if isinstance(law, pp.Normal):  # two poses together, by their numbers
        size = 4
        data = replace(data, group=np.arange(12.0) // size)
    found = pp.calibrate(model, data, tip)
    assert found.improvement.grouped_by == ("groups" if data.group.size else "poses")
    assert bool(found.at_bounds) == isinstance(law, pp.Uniform)
    for k in (0, 6):
        rest = [row for row in range(12) if row // size != k // size]
        without = pp.calibrate(model, (q[:, rest], readings[rest]), tip, at=[q[:, k]])
        away = readings[k] - without.predict(q[:, k])[:3, 3]
        np.testing.assert_allclose(found.left_out[k], away, rtol=2e-2, atol=1e-6)
        if not found.at_bounds:
            covariance = without.poses[0].covariance_after[:3, :3] + np.eye(3) * tip.std**2
            np.testing.assert_allclose(found.std_left_out[k], np.sqrt(np.diag(covariance)), rtol=2e-2)
    assert (found.improvement.groups, found.improvement.readings) == (12 // size, 12)
    assert found.improvement.after == pytest.approx(found.rms("left out"), rel=1e-12)


@pytest.mark.slow
def test_a_calibration_helps_is_useless_or_harms():
    model, tip = offsets(pp.Normal(1e-3)), pp.Measurement(std=20e-6, target=OFF_AXIS, base="free")
    q = random_poses(4, 15)
    readings = readings_of(model, q, tip)
    helped = pp.calibrate(model, (q, readings), tip)
    # before: the nominal points, turned and shifted onto the readings
    points = np.array([(model.at(one).posture.pose @ [*OFF_AXIS, 1])[:3] for one in q.T])
    far = Rotation.align_vectors(readings - readings.mean(axis=0), points - points.mean(axis=0))[1]
    assert helped.rms_residual["before"] == pytest.approx(far / np.sqrt(15), rel=1e-9)
    nominal = offsets(pp.Normal(1e-12))
    useless = pp.calibrate(model, (q, readings_of(nominal, q, tip)), tip)
    # noise of 1 mm where the sheet says 60 µm, which 17 combinations without a prior follow
    known, nearer = pp.Measurement(std=60e-6), random_poses(4, 16)
    noisy = readings_of(nominal, nearer, known) + np.random.default_rng(1).normal(0, 1e-3, (16, 3))
    harmed = pp.calibrate(pp.every_frame(model.chain), (nearer, noisy), known, prior=False)
    found = {"helps": helped, "not shown to help": useless, "makes unseen poses worse": harmed}
    assert [one.improvement.verdict for one in found.values()] == list(found)
    assert useless.verdict == "agrees"
    for verdict, one in found.items():
        assert ("W_NO_GAIN" in {finding.code for finding in one.findings}) == (verdict != "helps")
    assert helped.improvement.share.verdict == "honest"
    assert harmed.improvement.share.verdict == "over-confident"
    assert "W_OVER_CONFIDENT" in {finding.code for finding in harmed.findings}


def test_the_share_within_has_the_binomial_interval_of_its_groups():
    share = LeftOutShare.of(np.where(np.arange(60) < 51, 1.0, 9.0), np.full(60, 3), 60)
    expected = stats.binomtest(51, 60).proportion_ci(0.95, method="exact")
    assert (share.within, *share.interval) == pytest.approx((51 / 60, expected.low, expected.high), rel=1e-9)


def test_how_far_off_left_out_readings_are_decides_whether_deviations_are_honest():
    """Squared sizes of three numbers each: the interval of a variance, and by F where the deviation is of 12 degrees."""

    def of(ratio, trials, **more):
        return LeftOutShare.of(np.full(40, 3 * ratio**2), np.full(40, 3), trials, **more)

    for ratio, trials, verdict in ((1.3, 40, "over-confident"), (1.0, 40, "honest"), (0.8, 40, "over-cautious")):
        found = of(ratio, trials)
        # chi-square by the gamma function's inverse, not by the law that the code takes
        ends = [1.5 * trials / special.gammaincinv(1.5 * trials, side) for side in (0.975, 0.025)]
        assert (found.verdict, found.ratio) == (verdict, pytest.approx(ratio))
        assert found.ratio_interval == pytest.approx(ratio * np.sqrt(ends), rel=1e-6)
    assert (of(1.0, 5).verdict, of(1.3, 5).verdict) == ("undecided", "undecided")
    sure, unsure = of(1.25, 40), of(1.25, 40, known=12)
    assert (sure.verdict, unsure.verdict) == ("over-confident", "undecided")
    x = special.betaincinv(60, 6, 0.975)  # of chi-square of 120 over that sum with chi-square of 12
    assert unsure.ratio_interval[0] == pytest.approx(1.25 / np.sqrt(x / (1 - x) * 12 / 120), rel=1e-6)


@pytest.mark.slow
def test_groups_that_share_errors_are_fewer_trials():
    """Squares of correlations between left-out readings, base and target free, by the map from readings to what is left out."""
    model, q = plain_model(), np.repeat(random_poses(4, 8), 2, axis=1)
    free = pp.Measurement(std=20e-6, target=OFF_AXIS, base="free", target_known=False)
    problem = Problem.of(model, read_data(model, (q, readings_of(model, q, free)), (free,)))[0]
    z, groups, size = np.zeros(problem.unit.root.shape[1]), np.arange(16) // 2, 6
    whole, reduction = dense(problem, z, problem.start), problem.reduce(z, problem.start)
    leverage, root = (
        Estimator.of(whole.by_z, whole.by_nuisance, has_prior=True).leverage_root(),
        np.linalg.cholesky(whole.noise),
    )
    estimator = Estimator.of(problem.by_z(reduction), reduction.by_nuisance, has_prior=True)
    through = problem.through((z, problem.start), reduction, problem.over_numbers(estimator.root_by_columns))
    projector, columns = np.eye(len(leverage)) - leverage @ leverage.T, []
    for white in projector:
        residuals = np.zeros_like(problem.readings)
        residuals[problem.numbers] = root @ white
        found = leave_out(problem, [through], residuals, groups)
        columns.append(found.values.ravel())
    # residuals hold y have the covariance hold, of which the map is taken here: hold hold⁺ hold
    left = np.array(columns).T
    covariance = left @ np.linalg.pinv(projector, rcond=1e-9) @ left.T
    blocks = covariance.reshape(8, size, 8, size).swapaxes(1, 2)
    roots = [np.linalg.inv(np.linalg.cholesky(blocks[k, k])) for k in range(8)]
    shares = [((roots[k] @ blocks[k, h] @ roots[h].T) ** 2).sum() / size for k in range(8) for h in range(8)]
    assert found.trials == pytest.approx(64 / np.sum(shares), rel=1e-6)
    assert found.trials < 6


@cache
def stack_of_free_base(is_whole):
    """Return whitened derivatives at 300 poses by seven numbers of the paper's arm, or by all of its geometric errors."""
    model, free = plain_model(), replace(UNKNOWN, std=20e-6)
    model = pp.every_frame(model.chain) if is_whole else model
    return stack_at_means(stations_of(model, random_poses(4, 300), free), UnitNumbers.of(model.space), free)[:2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "size", "poses", "is_whole"), [(1, 1, 25, False), (50, 0, 25, False), (1, 1, 8, True)]
)
def test_the_interval_of_the_gain_holds_that_at_unseen_poses(noise, size, poses, is_whole):
    """Linear robots with a free base, some of 300 poses: the gain over all poses; where there is none, few "helps".

    Eight poses are 24 numbers, as many as set-up and arm take: the fit leaves nothing, and still what was there is known.
    """
    every, set_up = stack_of_free_base(is_whole)
    every, rng, held, helps, ends = every / noise, np.random.default_rng(0), [], [], []
    robots = 150 if is_whole else 300
    for _ in range(robots):
        chosen = rng.choice(300, poses, replace=False)
        a, n = every[chosen].reshape(3 * poses, -1), set_up[chosen].reshape(3 * poses, -1)
        z = size * rng.standard_normal(a.shape[1])
        y = a @ z + rng.standard_normal(3 * poses)
        squares, truths, trials = [], [], []
        for columns, prior in ((n, 0), (np.hstack([a, n]), a.shape[1])):
            penalty = np.diag((np.arange(columns.shape[1]) < prior) * 1.0)
            inverse = np.linalg.pinv(columns.T @ columns + penalty, rcond=1e-14, hermitian=True)
            hold = np.eye(3 * poses) - columns @ inverse @ columns.T
            rows = [slice(3 * k, 3 * k + 3) for k in range(poses)]
            alone = [np.linalg.solve(hold[own, own], hold[own] @ y) for own in rows]
            squares.append((np.array(alone) ** 2).sum(axis=1))
            roots = [np.linalg.inv(np.linalg.cholesky(hold[own, own])) for own in rows]
            white = np.concatenate([root @ hold[own] for root, own in zip(roots, rows, strict=True)])
            # hold is its own square where nothing is a prior's; the covariance of what is left out is hold between blocks
            within = np.concatenate([white[:, own] @ root.T for root, own in zip(roots, rows, strict=True)], axis=1)
            trials.append(3 * poses**2 / (within**2).sum())
            of_all = np.concatenate([every, set_up] if prior else [set_up], axis=2).reshape(900, -1)
            away = every.reshape(900, -1) @ z - of_all @ (inverse @ (columns.T @ y))
            truths.append(np.sqrt((away**2).sum() / 300 + 3))
        (low, high), (_, most) = gain_interval(*squares, np.full(poses, 1 / poses), tuple(trials), 3)
        held.append(low <= truths[0] - truths[1] <= high)
        helps.append(low > 0)
        ends.append(high < most and low > -9 * np.sqrt(squares[1].mean()))
    # no more than a standard deviation of a count below 95 %
    assert np.mean(held) > 0.95 - np.sqrt(0.95 * 0.05 / robots)
    assert np.mean(helps) > 0.98 if size else np.mean(helps) < 0.05
    assert all(ends)


@pytest.mark.slow
def test_new_readings_are_within_the_deviations_that_are_told():
    """Three robots, complete fits: 108 numbers at unseen poses and 108 left out; 0.085 are three deviations of a share."""
    model, free = plain_model(), pp.Measurement(std=20e-6, base="free")
    within = {"unseen": [], "left out": []}
    for seed in range(3):
        q = random_poses(4, 24, seed)
        readings = readings_of(model, q, free, seed)
        found = pp.calibrate(model, (q[:, :12], readings[:12]), free, at=list(q[:, 12:].T))
        tips = np.array([found.set_up.base @ found.predict(one) for one in q[:, 12:].T])
        seen = np.array([np.diag(one.covariance_seen[:3, :3]) for one in found.poses])
        within["unseen"] += [np.abs(readings[12:] - tips[:, :3, 3]) < 1.96 * np.sqrt(seen + free.std**2)]
        within["left out"] += [np.abs(found.left_out) < 1.96 * found.std_left_out]
    for shares in within.values():
        assert 0.865 < np.mean(shares) < 1


UNKNOWN = pp.Measurement(std="estimate", target=OFF_AXIS, base="free", target_known=False)


def test_one_way_effects_have_the_likelihood_of_balanced_analysis_of_variance():
    """-2 ln L = (G V - G) ln σ² + SSW/σ² + (G - 1) ln(σ² + V τ²) + SSB/(σ² + V τ²) + constant (Searle et al. 1992)."""
    groups, visits, between = 6, 4, 0.7
    values = np.random.default_rng(1).normal(0, 1.3, (groups, visits))
    within = ((values - values.mean(axis=1, keepdims=True)) ** 2).sum()
    other = visits * ((values.mean(axis=1) - values.mean()) ** 2).sum()

    def closed(log):
        a, b = np.exp(2 * log), np.exp(2 * log) + visits * between**2
        return groups * (visits - 1) * np.log(a) + within / a + (groups - 1) * np.log(b) + other / b

    # groups with an effect of std ``between``, about an unknown mean
    ones = np.ones(visits)
    blocks = [(between**2 * np.outer(ones, ones), np.eye(visits)[None], np.column_stack([ones, own])) for own in values]
    likelihood = Likelihood(blocks, 0)
    logs = np.array([-0.7, 0.0, 0.4])
    difference = [likelihood(np.array([log])) - closed(log) for log in logs]
    np.testing.assert_allclose(difference, difference[0], atol=1e-10)
    point, ends = largest_likelihood(likelihood, 2.0)
    best = optimize.minimize_scalar(closed, bounds=(-3, 2), method="bounded", options={"xatol": 1e-9})
    assert point[0] == pytest.approx(best.x, abs=1e-5)
    for end in ends[0]:
        assert closed(end) - best.fun == pytest.approx(stats.chi2.ppf(0.95, 1), abs=1e-4)
    a, b = np.exp(2 * best.x), np.exp(2 * best.x) + visits * between**2
    expected = groups * (visits - 1) + (groups - 1) * (a / b) ** 2
    assert likelihood.information(point)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("has_prior", [True, False])
def test_reduced_numbers_have_the_likelihood_of_all(has_prior):
    """Two kinds of deviations, two targets of which one has a known std: up to a constant, and the same information."""
    model, q = offsets(pp.Normal(1e-3)), random_poses(4, 20)
    unknown, known = (
        pp.Measurement(
            "pose", std=std, target=target, base="free", base_name=name, attitude_std="1 mrad" if name else None
        )
        for std, target, name in (("estimate", OFF_AXIS, ""), ("0.1 mm", (0.1, 0, 0), "b"))
    )
    given = [(q, readings_of(model, q, replace(part, std=1e-4), seed=k)) for k, part in enumerate((unknown, known))]
    problem = Problem.of(model, read_data(model, given, (unknown, known)))[0]
    at, kinds = (np.zeros(4), problem.start), list(problem.unknown_deviations.values())
    change, random = _columns(problem, *at, has_prior=has_prior)
    whole = Likelihood(list(_stations(problem, *at, change, kinds)), random)
    blocks, empty = _reduced(problem, *at, change, kinds)
    reduced = Likelihood(blocks, random, empty)
    assert len(blocks) == 3
    assert whole.kinds == 2
    logs = np.array([[-0.7, 0.2], [0.0, 0.0], [0.9, -1.3]])
    difference = [whole(log) - reduced(log) for log in logs]
    np.testing.assert_allclose(difference, difference[0], atol=1e-7)
    for log in logs:
        np.testing.assert_allclose(reduced.information(log), whole.information(log), rtol=1e-7)


@pytest.mark.slow
def test_the_std_is_that_of_a_dense_likelihood():
    """All readings in one covariance matrix, the set-up projected out by its null space, minimised by Nelder and Mead."""
    model, q, count = offsets(pp.Normal(1e-3)), random_poses(4, 12), 12
    given = {"kind": "pose", "target": OFF_AXIS, "base": "free"}
    readings = readings_of(model, q, pp.Measurement(std=0.2e-3, **given), seed=3)
    found = pp.calibrate(model, (q, readings), pp.Measurement(std="estimate", **given))
    # the same linear problem, by the derivatives at the means
    small, ats = pp.Measurement(std=1.0, attitude_std=1.0, **given), [model.at(one) for one in q.T]
    slopes = [small.slopes(at.posture.pose, np.zeros(6), np.zeros(6)) for at in ats]
    by_z = 1e-3 * np.concatenate([one.error @ at.jacobian for one, at in zip(slopes, ats, strict=True)])
    null = np.linalg.svd(np.concatenate([one.nuisances for one in slopes]))[0][:, 6:]
    left = null.T @ (found.residuals.ravel() + by_z @ [1e3 * one for one in found.posterior.mean.values()])
    lengths = np.tile(np.arange(6) < 3, count)

    def minus_twice(logs):
        variances = np.where(lengths, np.exp(2 * logs[0]), np.exp(2 * logs[-1]))
        covariance = null.T @ (np.diag(variances) + by_z @ by_z.T) @ null
        return np.linalg.slogdet(covariance)[1] + left @ np.linalg.solve(covariance, left)

    best = optimize.minimize(minus_twice, np.log([0.2e-3, 2e-3]), method="Nelder-Mead", options={"xatol": 1e-6}).x
    stds = [found.noise[name].std for name in ("std", "attitude_std")]
    np.testing.assert_allclose(stds, np.exp(best), rtol=1e-2)
    assert found.measurement.std == found.noise["std"].std


def test_a_number_at_its_bound_does_not_lower_the_std():
    # an offset of three half-widths: the std is that of a sheet which has the bound as a constant
    given, q = {"target": OFF_AXIS, "base": "free"}, random_poses(4, 10)
    other = [pp.sources.JointOffset(joint=name, offset=pp.Normal(1e-3)) for name in ("joint1", "joint3")]
    real, bounded, fixed = (
        offsets(law, *other, joints=["joint2"])
        for law in (pp.Uniform(1e-9, mean=3e-3), pp.Uniform(1e-3), pp.Uniform(1e-12, mean=1e-3))
    )
    readings = readings_of(real, q, pp.Measurement(std=0.1e-3, **given), seed=2)
    stds = [pp.calibrate(one, (q, readings), UNKNOWN).noise["std"].std for one in (bounded, fixed)]
    np.testing.assert_allclose(*stds, rtol=1e-5)


@pytest.mark.slow
def test_a_std_that_was_tuned_is_no_agreement():
    model, q = plain_model(), random_poses(4, 15)
    true = pp.Measurement(std=0.1e-3, target=OFF_AXIS, base="free", target_known=False)
    found = pp.calibrate(model, (q, readings_of(model, q, true, seed=3)), UNKNOWN, at=["work"])
    assert (found.verdict, found.probability) == ("not tested", None)
    noise = found.noise["std"]
    assert noise.decided_by == "all readings"
    assert noise.degrees_of_freedom < 45 - 9
    assert noise.interval[0] < 0.1e-3 < noise.interval[1]
    assert "W_STD_ESTIMATED" in {finding.code for finding in found.findings}
    assert "agree" not in repr(found)
    written = json.loads(found.to_json())
    assert (written["noise"]["std"]["interval"], written["improvement"]["verdict"]) == (list(noise.interval), "helps")
    assert (written["probability"], written["measurement"]["std"]) == (None, noise.std)
    check_refused(("std: estimate belongs to the readings", pp.forecast_calibration, model, q, UNKNOWN))
    # in millimetres, where metres are expected; a base somewhere else does not change how far the readings spread
    points = readings_of(model, q, true)
    with pytest.raises(pp.InputError, match="columns or units are wrong") as refused:
        pp.calibrate(model, (q, 1e3 * points), UNKNOWN)
    said = float(str(refused.value).partition("the tip itself spreads by ")[2].partition(" mm")[0])
    assert said == pytest.approx(1e3 * (points - points.mean(axis=0)).std(), rel=0.01)


@pytest.mark.slow
def test_repeated_poses_tell_the_instrument_from_the_model():
    """A backlash that the sheet lacks: by repeats the std stays that of the instrument, and the model is found wrong."""
    model = offsets(pp.Normal(1e-3))
    jumps = pp.sources.JointOffset(joint="joint3", offset=pp.Draw("", pp.Normal(1e-3), pp.Scope.POSE))
    real = offsets(pp.Normal(1e-3), jumps)
    q = np.repeat(random_poses(4, 10), 2, axis=1)
    true = pp.Measurement(std=0.1e-3, target=OFF_AXIS)
    unknown = pp.Measurement(std="estimate", target=OFF_AXIS)
    wrong, right = (pp.calibrate(model, (q, readings_of(one, q, true, seed=1)), unknown) for one in (real, model))
    for found in (wrong, right):
        noise = found.noise["std"]
        assert (noise.decided_by, noise.degrees_of_freedom) == ("repeats", pytest.approx(30, rel=1e-6))
        assert noise.interval[0] < 0.1e-3 < noise.interval[1]
    assert (wrong.verdict, right.verdict) == ("disagrees", "agrees")
    assert wrong.noise["std"].of_all > 3 * wrong.noise["std"].std


@pytest.mark.slow
def test_stds_of_the_file_are_relative_where_the_std_is_estimated(tmp_path):
    """An arm that is known: the std at all weights equal is the root mean square of residuals over relative stds."""
    chain, q = paper_model().chain, random_poses(4, 15)
    model = offsets(pp.Normal(1e-9), joints=["joint1"])
    stds = np.where(np.arange(15) % 3, 0.1, 1.0)  # mm
    noise = np.random.default_rng(3).standard_normal((15, 3)) * stds[:, None] / 1e3
    rows = np.column_stack([q.T, chain.at_columns(q).pose[:3, 3].T + noise, stds])
    names = [*(f"{name} [rad]" for name in chain.joint_names), *(f"{name} [m]" for name in "xyz"), "std [mm]"]
    np.savetxt(tmp_path / "data.csv", rows, "%.12g", ",", header=",".join(names), comments="")
    found = pp.calibrate(model, tmp_path / "data.csv", pp.Measurement(std="estimate"), at=[q[:, 0]])
    usual = np.sqrt((stds**2).mean())
    expected = np.sqrt(((noise * usual / stds[:, None]) ** 2).mean())
    assert (found.gross_errors, found.noise["std"].std) == ((), pytest.approx(expected, rel=1e-4))
    assert json.loads(found.to_json())["data"]["std"] == pytest.approx(stds * expected / usual, rel=1e-4)
    np.testing.assert_allclose(found.std_predicted[:, 0], stds * expected / usual, rtol=1e-3)
