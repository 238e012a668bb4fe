"""Left-out readings against fits without them, what useless and wrong calibrations say, and coverage of the gain's interval."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import linalg, special, stats
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, paper_model, plain_model, random_poses, readings_of
from precision_pin.analyses.calibration.data import read_data
from precision_pin.analyses.calibration.design import Estimator, UnitNumbers, stack_at_means, stations_of
from precision_pin.analyses.calibration.fit import Problem, leave_out
from precision_pin.analyses.calibration.residuals import LeftOutShare, gain_interval
from precision_pin.draws.draw import Scope
from precision_pin.sources import JointOffset

NAMES = ("joint1", "joint2", "joint3", "joint4")


def offsets(law: pp.Law, *more: pp.Source) -> pp.ErrorModel:
    sources = [JointOffset(joint=name, offset=law) for name in NAMES]
    return pp.ErrorModel(paper_model().chain, pp.Space(), [*sources, *more])


@pytest.mark.slow
@pytest.mark.parametrize("law", [pp.Normal(1e-3), pp.Uniform(0.4e-3)])
def test_what_is_left_out_is_what_a_fit_without_it_leaves(law: pp.Law) -> None:
    """Poses visited twice, repeatability, numbers at the ends of their laws: residual and deviation by other fits."""
    repeat = JointOffset(joint="joint2", offset=pp.Draw("", pp.Normal(2e-5), Scope.VISIT))
    model, real = offsets(law, repeat), offsets(pp.Normal(0.5e-3), repeat)
    tip = pp.Measurement(std=20e-6)
    q = np.repeat(random_poses(4, 6), 2, axis=1)
    readings = readings_of(real, q, tip, seed=4)
    found = pp.calibrate(model, (q, readings), tip)
    assert bool(found.at_bounds) == isinstance(law, pp.Uniform)
    for k in (0, 6):
        rest = [row for row in range(12) if row // 2 != k // 2]
        without = pp.calibrate(model, (q[:, rest], readings[rest]), tip, at=[q[:, k]])
        np.testing.assert_allclose(
            found.left_out[k], readings[k] - without.predict(q[:, k])[:3, 3], rtol=2e-2, atol=1e-6
        )
        if not found.at_bounds:
            covariance = without.poses[0].covariance_after[:3, :3] + np.eye(3) * tip.std**2
            np.testing.assert_allclose(found.std_left_out[k], np.sqrt(np.diag(covariance)), rtol=2e-2)
    assert found.improvement is not None
    assert (found.improvement.groups, found.improvement.readings) == (6, 12)
    assert found.improvement.after == pytest.approx(found.rms("left out"), rel=1e-12)


@pytest.mark.slow
def test_a_calibration_helps_is_useless_or_harms() -> None:
    model, tip = offsets(pp.Normal(1e-3)), pp.Measurement(std=20e-6, target=OFF_AXIS, base="free")
    q = random_poses(4, 15)
    helped = pp.calibrate(model, (q, readings_of(model, q, tip)), tip)
    # before: the nominal points, turned and shifted onto the readings
    postures = [model.at(one).posture.pose for one in q.T]
    points, readings = np.array([(one @ [*OFF_AXIS, 1])[:3] for one in postures]), readings_of(model, q, tip)
    far = Rotation.align_vectors(readings - readings.mean(axis=0), points - points.mean(axis=0))[1]
    assert helped.rms_residual["before"] == pytest.approx(far / np.sqrt(15), rel=1e-9)
    nominal = offsets(pp.Normal(1e-12))
    useless = pp.calibrate(model, (q, readings_of(nominal, q, tip)), tip)
    # noise of 1 mm where the sheet says 60 µm, which 17 combinations without a prior follow
    known, nearer = pp.Measurement(std=60e-6), random_poses(4, 16)
    noisy = readings_of(nominal, nearer, known) + np.random.default_rng(1).normal(0, 1e-3, (16, 3))
    harmed = pp.calibrate(pp.every_frame(model.chain), (nearer, noisy), known, prior=False)
    found = {"helps": helped, "not shown to help": useless, "makes unseen poses worse": harmed}
    assert [one.improvement.verdict for one in found.values() if one.improvement] == list(found)
    assert useless.verdict == "agrees"
    for verdict, one in found.items():
        assert ("W_NO_GAIN" in {finding.code for finding in one.findings}) == (verdict != "helps")
    assert helped.improvement is not None
    assert helped.improvement.share.verdict == "honest"
    assert harmed.improvement is not None
    assert harmed.improvement.share.verdict == "over-confident"
    assert "W_OVER_CONFIDENT" in {finding.code for finding in harmed.findings}


@pytest.mark.slow
def test_poses_that_differ_by_less_than_encoders_tell_are_left_out_together() -> None:
    model, tip = offsets(pp.Normal(1e-3)), pp.Measurement(std=20e-6)
    q = np.repeat(random_poses(4, 5), 2, axis=1) + 1e-4 * np.arange(10)[None] % 2e-4
    found = pp.calibrate(model, (q, readings_of(model, q, tip)), tip)
    assert found.improvement is not None
    assert found.improvement.groups == 5


def test_the_share_within_has_the_binomial_interval_of_its_groups() -> None:
    squares, sizes = np.where(np.arange(60) < 51, 1.0, 9.0), np.full(60, 3)
    share = LeftOutShare.of(squares, sizes, 60)
    expected = stats.binomtest(51, 60).proportion_ci(0.95, method="exact")
    assert share.interval == pytest.approx((expected.low, expected.high), rel=1e-9)
    assert share.within == 51 / 60


def test_how_far_off_left_out_readings_are_decides_whether_deviations_are_honest() -> None:
    """Squared sizes of three numbers each: the interval of a variance, and by F where the deviation is of 12 degrees."""

    def of(ratio: float, trials: float, **more: float) -> LeftOutShare:
        return LeftOutShare.of(np.full(40, 3 * ratio**2), np.full(40, 3), trials, **more)

    for ratio, trials, verdict in ((1.3, 40, "over-confident"), (1.0, 40, "honest"), (0.8, 40, "over-cautious")):
        found = of(ratio, trials)
        # chi-square by the gamma function's inverse, not by the law that the code takes
        ends = [1.5 * trials / special.gammaincinv(1.5 * trials, side) for side in (0.975, 0.025)]
        assert found.verdict == verdict
        assert found.ratio == pytest.approx(ratio)
        assert found.ratio_interval == pytest.approx(ratio * np.sqrt(ends), rel=1e-6)
    assert (of(1.0, 5).verdict, of(1.3, 5).verdict) == ("undecided", "undecided")
    sure, unsure = of(1.25, 40), of(1.25, 40, known=12)
    assert (sure.verdict, unsure.verdict) == ("over-confident", "undecided")
    x = special.betaincinv(60, 6, 0.975)  # of chi-square of 120 over that sum with chi-square of 12
    assert unsure.ratio_interval[0] == pytest.approx(1.25 / np.sqrt(x / (1 - x) * 12 / 120), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("twice", [False, True])
def test_groups_that_share_errors_are_fewer_trials(twice: bool) -> None:
    """Squares of correlations between left-out readings, base and target free, by the map from readings to what is left out."""
    model, q = plain_model(), np.repeat(random_poses(4, 8), 1 + twice, axis=1)
    free = pp.Measurement(std=20e-6, target=OFF_AXIS, base="free", target_known=False)
    problem = Problem.of(model, read_data(model, (q, readings_of(model, q, free)), (free,)))[0]
    z, groups, size = np.zeros(problem.unit.root.shape[1]), np.arange(q.shape[1]) // (1 + twice), 3 + 3 * twice
    estimator = Estimator.of(*problem.slopes(z, problem.start), has_prior=True)
    columns = []
    for white in estimator.hold():
        residuals, first = np.zeros_like(problem.readings), 0
        for places, root in zip(problem.places, problem.roots, strict=True):
            residuals[places] = root @ white[first : first + len(root)]
            first += len(root)
        found = leave_out(problem, estimator, estimator, residuals, groups)
        columns.append(found.values.ravel())
    # residuals hold y have the covariance hold, of which the map is taken here: hold hold⁺ hold
    left = np.array(columns).T
    covariance = left @ np.linalg.pinv(estimator.hold(), rcond=1e-9) @ left.T
    blocks = covariance.reshape(8, size, 8, size).swapaxes(1, 2)
    roots = [np.linalg.inv(np.linalg.cholesky(blocks[k, k])) for k in range(8)]
    shares = [((roots[k] @ blocks[k, h] @ roots[h].T) ** 2).sum() / size for k in range(8) for h in range(8)]
    assert found.trials == pytest.approx(64 / np.sum(shares), rel=1e-6)
    assert found.trials < 6


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "size"), [(1, 1), (50, 1), (150, 1), (50, 0)])
def test_the_interval_of_the_gain_holds_that_at_unseen_poses(noise: float, size: float) -> None:
    """Linear robots with a free base, 25 of 300 poses: the gain over all poses; where there is none, few "helps"."""
    model, free = plain_model(), pp.Measurement(std=20e-6, target=OFF_AXIS, base="free", target_known=False)
    stations = stations_of(model, random_poses(4, 300), free)
    every, set_up = stack_at_means(stations, UnitNumbers.of(model.space), free)
    every, rng, held, helps = every / noise, np.random.default_rng(0), [], []
    for _ in range(500):
        chosen = rng.choice(300, 25, replace=False)
        a, n = every[chosen].reshape(75, -1), set_up[chosen].reshape(75, -1)
        z = size * rng.standard_normal(a.shape[1])
        y = a @ z + rng.standard_normal(75)
        squares, truths, taken = [], [], 0.0
        for columns, prior in ((n, []), (np.hstack([a, n]), [1.0] * a.shape[1])):
            penalty = np.zeros(columns.shape[1])
            penalty[: len(prior)] = prior
            inverse = np.linalg.pinv(columns.T @ columns + np.diag(penalty), rcond=1e-14, hermitian=True)
            hat = columns @ inverse @ columns.T
            left = y - hat @ y
            rows = [slice(3 * k, 3 * k + 3) for k in range(25)]
            squares.append(
                np.array([(np.linalg.solve(np.eye(3) - hat[own, own], left[own]) ** 2).sum() for own in rows])
            )
            of_all = (
                set_up.reshape(900, -1) if not prior else np.hstack([every.reshape(900, -1), set_up.reshape(900, -1)])
            )
            away = every.reshape(900, -1) @ z - of_all @ (inverse @ (columns.T @ y))
            truths.append(np.sqrt((away**2).sum() / 300 + 3))
            taken = float(np.trace(hat)) / 75
        low, high = gain_interval(squares[0], squares[1], np.full(25, 1 / 25), taken)
        held.append(low <= truths[0] - truths[1] <= high)
        helps.append(low > 0)
    assert np.mean(held) > 0.94
    assert size > 0 or np.mean(helps) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("poses", [8, 25])
def test_honest_robots_are_rarely_called_over_confident_and_others_mostly_named(poses: int) -> None:
    """Linear robots, base and target free, 40 sets of poses; noise as stated, and of twice the variance; all by numpy."""
    model, free = plain_model(), pp.Measurement(std=20e-6, target=OFF_AXIS, base="free", target_known=False)
    stations = stations_of(model, random_poses(4, 300), free)
    every, set_up = stack_at_means(stations, UnitNumbers.of(model.space), free)
    rng, sizes = np.random.default_rng(1), np.full(poses, 3)
    called: dict[float, list[bool]] = {1.0: [], 2.0: []}
    for _ in range(40):
        chosen = rng.choice(300, poses, replace=False)
        a, n = every[chosen].reshape(3 * poses, -1), set_up[chosen].reshape(3 * poses, -1)
        inverse = np.linalg.inv(np.eye(3 * poses) + a @ a.T)
        across = np.linalg.pinv(n.T @ inverse @ n, rcond=1e-13, hermitian=True)
        hold = inverse - inverse @ n @ across @ n.T @ inverse
        own = [slice(3 * k, 3 * k + 3) for k in range(poses)]
        # left out and white is root hold y, of covariance root hold root
        root = linalg.block_diag(*(np.linalg.inv(np.linalg.cholesky(hold[one, one])) for one in own))
        trials = poses**2 / ((root @ hold @ root.T) ** 2).sum() * 3
        for variance, found in called.items():
            y = a @ rng.standard_normal((a.shape[1], 50)) + np.sqrt(variance) * rng.standard_normal((3 * poses, 50))
            squares = ((root @ hold @ y).reshape(poses, 3, 50) ** 2).sum(axis=1)
            found += [LeftOutShare.of(one, sizes, trials).verdict == "over-confident" for one in squares.T]
    # 2,000 robots of each: 2.5 % is stated, of which 3.5 % is three standard deviations off
    assert np.mean(called[1.0]) < 0.035
    assert np.mean(called[2.0]) > (0.9 if poses == 25 else 0.2)


@pytest.mark.slow
def test_new_readings_are_within_the_deviations_that_are_told() -> None:
    """Six robots, complete fits: 216 numbers at unseen poses and 216 left out; 0.06 are three standard deviations of a share."""
    model, free = plain_model(), pp.Measurement(std=20e-6, base="free")
    within: dict[str, list[NDArray[np.bool_]]] = {"unseen": [], "left out": []}
    for seed in range(6):
        q = random_poses(4, 24, seed)
        readings = readings_of(model, q, free, seed)
        found = pp.calibrate(model, (q[:, :12], readings[:12]), free, at=list(q[:, 12:].T))
        assert found.set_up.base is not None
        tips = np.array([found.set_up.base @ found.predict(one) for one in q[:, 12:].T])
        seen = np.array([np.diag(one.covariance_seen[:3, :3]) for one in found.poses])
        within["unseen"] += [np.abs(readings[12:] - tips[:, :3, 3]) < 1.96 * np.sqrt(seen + free.std**2)]
        within["left out"] += [np.abs(found.left_out) < 1.96 * found.std_left_out]
    for shares in within.values():
        assert 0.89 < np.mean(shares) < 1
