"""Readings of many poses at once, against one pose at a time."""

import gc
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, dense, paper_model, plain_model, random_poses, readings_of
from precision_pin.analyses.calibration import evaluation
from precision_pin.analyses.calibration import fit as fitting
from precision_pin.analyses.calibration.data import read_data
from precision_pin.analyses.calibration.design import Estimator
from precision_pin.analyses.calibration.fit import Descent, Problem, _suspect_joint
from precision_pin.analyses.calibration.noise import Reduction, solve_lower
from precision_pin.base import se3
from precision_pin.model import pose_model
from precision_pin.model.pose_model import AT_ONCE, PoseModel, Tables, of_one_layout

SOCKETS = ((0.3, 0.1, 0.2), (0.1, -0.3, 0.4))
PLACES = {
    "distance": {"anchor": (0.5, 1, 0)},
    "plane": {"plane": ((0, 0, 0.1), (0, 0, 1))},
    "socket": {"sockets": SOCKETS},
}
FREE = pp.Measurement(std=20e-6, target=OFF_AXIS, base="free", target_known=False)


def check_close(values, expected):
    """Check agreement to 1e-12 of the largest."""
    np.testing.assert_allclose(values, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("count", [1, 5, AT_ONCE + 3])
@pytest.mark.parametrize("model", [paper_model, plain_model])
def test_derivatives_of_many_poses_are_those_of_each(model, count):
    arm = model().bare
    models, x = list(arm.at_columns(random_poses(4, count, 2))), arm.space.sample(3, 0, 1)
    parts = [Tables.of(chunk).tangent(x[:, 0]) for chunk in of_one_layout(models)]
    errors, slopes = (np.concatenate([getattr(p, name) for p in parts], axis=-1) for name in ("error", "jacobian"))
    expected = [at.exact(x)[:, 0] for at in models]
    check_close(errors.T, np.array(expected))
    each = [at.jacobian_at(x[:, 0], error) for at, error in zip(models, expected, strict=True)]
    check_close(np.moveaxis(slopes, -1, 0), np.array(each))


@pytest.mark.parametrize("kind", ["position", "pose", *PLACES])
@pytest.mark.parametrize("base", ["known", "free"])
@pytest.mark.parametrize("target_known", [True, False])
@pytest.mark.parametrize("count", [1, 4])
def test_readings_of_many_poses_are_those_of_each_and_their_slopes_are_differences(kind, base, target_known, count):
    known = target_known or kind in PLACES
    part = pp.Measurement(kind, target=OFF_AXIS, base=base, target_known=known, **PLACES.get(kind, {}))
    rng = np.random.default_rng(4)
    errors, nuisances = rng.normal(0, 0.1, (count, 6)), rng.normal(0, 0.1, len(part.nuisances))
    turns = rng.uniform(-1.5, 1.5, (count, 3))
    poses = np.array(
        [se3.pose(se3.exp_rotation(turn), shift) for turn, shift in zip(turns, 0.4 * turns[::-1], strict=True)]
    )
    found = part.linearised(poses, errors, nuisances)
    pairs = list(zip(poses, errors, strict=True))
    check_close(found.values, np.array([part.predict(p, e[:, None], nuisances[:, None])[:, 0] for p, e in pairs]))
    for k, (pose, error) in enumerate(pairs):
        point, step = np.concatenate([error, nuisances]), 1e-5
        ends = [point[:, None] + sign * step * np.eye(point.size) for sign in (1, -1)]
        after, before = (part.predict(pose, values[:6], values[6:]) for values in ends)
        slopes = np.concatenate([found.by_error[k], found.by_nuisance[k]], axis=1)
        np.testing.assert_allclose(slopes, part.residual(after, before) / (2 * step), atol=1e-8)
        single = part.slopes(pose, error, nuisances)
        check_close(np.concatenate(single, axis=1), slopes)


def repeated_problem():
    """Return a problem of one, two or three readings at a pose, two of them of the same visit scope."""
    model, q = plain_model(), np.repeat(random_poses(4, 9), [1, 2, 3] * 3, axis=1)
    return Problem.of(model, read_data(model, (q, readings_of(model, q, FREE)), (FREE,)))[0]


@pytest.fixture(params=[AT_ONCE, 4], ids=["one chunk", "three chunks"])
def chunked(request, monkeypatch):
    """Poses are evaluated so many at once."""
    monkeypatch.setattr(pose_model, "AT_ONCE", request.param)
    return -(-9 // request.param)


def test_noise_at_stations_of_different_sizes_is_that_of_each(chunked):
    problem = repeated_problem()
    for part in (problem, problem.without([3, 7])):
        assert len(part.chunks) == chunked
        noise = dense(part, np.zeros(part.unit.root.shape[1]), part.start).noise
        first = 0
        for station, places in zip(part.each_station(), part.places, strict=True):
            error, own = station.at.error_at_means, slice(first, first + len(places[0]))
            by_error = FREE.slopes(station.at.posture.pose, error, part.start).error
            stacked = np.tile(by_error, (len(station.rows), 1))
            instrument = np.diag(part.deviations[places] ** 2)
            check_close(noise[own, own], station.noise(stacked, instrument, part.visit[places[0]]))
            first = own.stop
        values = np.random.default_rng(5).normal(size=part.readings.shape)
        of_numbers, inverse = values[part.numbers], np.linalg.inv(noise)
        white = np.concatenate([chunk.noise.whiten(values[chunk.rows]) for chunk in part.chunks])
        np.testing.assert_allclose(np.linalg.cholesky(noise) @ white, of_numbers, rtol=1e-9)
        np.testing.assert_allclose(part.precision_times(values), inverse @ of_numbers, rtol=1e-8)
        noise_rows, place, station = part.precision
        for row in range(len(noise)):
            same = np.flatnonzero(station == station[row])
            check = noise_rows[row, place[same]]
            np.testing.assert_allclose(check, inverse[row, same], rtol=1e-8, atol=1e-12 * np.abs(inverse).max())


def test_derivatives_are_differences_of_residuals(chunked):
    problem = repeated_problem()
    rng = np.random.default_rng(6)
    z, nuisances = rng.normal(size=problem.unit.root.shape[1]), problem.start + rng.normal(0, 1e-3, problem.start.size)
    whole, count, step = dense(problem, z, nuisances), z.size, 1e-5
    slopes, root = np.hstack([whole.by_z, whole.by_nuisance]), np.linalg.cholesky(whole.noise)

    def residuals(point):
        return np.linalg.solve(root, problem.residuals(*np.split(point, [count]))[problem.numbers])

    point = np.concatenate([z, nuisances])
    np.testing.assert_allclose(whole.white, residuals(point), rtol=1e-9)
    for column, way in zip(slopes.T, step * np.eye(point.size), strict=True):
        difference = (residuals(point - way) - residuals(point + way)) / (2 * step)
        np.testing.assert_allclose(column, difference, atol=1e-5 * np.abs(column).max())


@pytest.mark.parametrize("count", [6, 1300])
def test_a_reduction_is_that_of_the_whole(count):
    """Products with (I + W Wᵀ)⁻¹ between, and that inverse less those of some columns, of fewer and more rows than columns."""
    columns = np.random.default_rng(10).normal(size=(count, 3 + 7))
    chunks = np.split(columns, [2, 3, count // 2])
    reduction = Reduction.of(chunks, 3, 2)
    w, others = columns[:, :3], columns[:, 3:]
    inverse = np.eye(count) - w @ np.linalg.solve(np.eye(3) + w.T @ w, w.T)
    check_close(reduction.rows.T @ reduction.rows, others.T @ inverse @ others)
    assert (reduction.size, len(reduction.rows)) == (count, min(count, 7))
    check_close(np.column_stack([reduction.by_nuisance, reduction.white]), reduction.rows[:, [0, 1, -1]])
    coefficients = np.random.default_rng(11).normal(size=(5, 4))
    through = columns[:, :8] @ reduction.over(coefficients)
    left = inverse @ others[:, :5] @ coefficients
    np.testing.assert_allclose(through @ through.T, np.eye(count) - inverse + left @ left.T, atol=1e-11)
    some = reduction.only(np.array([1, 4]))
    check_close(some.rows.T @ some.rows, (others.T @ inverse @ others)[np.ix_([1, 4, 6], [1, 4, 6])])
    through = columns[:, [0, 1, 2, 4, 7]] @ some.over(coefficients[:2])
    left = inverse @ others[:, [1, 4]] @ coefficients[:2]
    np.testing.assert_allclose(through @ through.T, np.eye(count) - inverse + left @ left.T, atol=1e-11)


def test_triangular_systems_of_one_size_are_solved_at_once():
    rng = np.random.default_rng(7)
    roots, values = np.tril(rng.normal(size=(6, 4, 4))) + 4 * np.eye(4), rng.normal(size=(6, 4, 3))
    check_close(
        solve_lower(roots, values), np.array([np.linalg.solve(r, v) for r, v in zip(roots, values, strict=True)])
    )


def test_combinations_without_a_prior_are_those_of_the_whole_matrix():
    rng = np.random.default_rng(8)
    by_z = rng.normal(size=(60, 4)) @ np.diag([30, 3, 0.3, 1e-14])
    estimator = Estimator.of(by_z, np.zeros((60, 0)), has_prior=False)
    _, values, rows = np.linalg.svd(by_z, full_matrices=True)
    expected = rows[: int((values > 1).sum())]
    assert estimator.basis.shape == (4, 3)
    check_close(estimator.basis @ estimator.basis.T, expected.T @ expected)


def test_models_of_poses_do_not_stay_in_memory():
    def alive():
        return sum(isinstance(one, PoseModel) for one in gc.get_objects())

    model, q = plain_model(), random_poses(4, 40, 5)
    data, before = read_data(model, (q, readings_of(model, q, FREE)), (FREE,)), alive()
    problem = Problem.of(model, data)[0]
    Descent(problem, has_prior=True).fit()
    assert alive() <= before
    assert sum(1 for _ in problem.each_station()) == len(problem.stations) == 40


@pytest.mark.slow
def test_derivatives_of_many_readings_do_not_fill_the_memory(monkeypatch):
    """A fit takes less for another reading than the derivatives of two, 45 columns of three numbers each."""
    monkeypatch.setattr(evaluation, "_KEPT", 0)
    model, peaks = pp.every_frame(plain_model().chain), []
    for count in (2000, 4000):
        q = random_poses(4, count)
        problem = Problem.of(model, read_data(model, (q, readings_of(model, q, FREE)), (FREE,)))[0]
        assert len(problem.chunks) > 5
        tracemalloc.start()
        fit = Descent(problem, has_prior=True).fit()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert fit.reduction.rows.shape == (46, 46)
    assert (peaks[1] - peaks[0]) / 2000 < 2 * 45 * 3 * 8


def test_what_is_kept_of_a_point_changes_no_bit(monkeypatch, chunked):
    def estimate(kept):
        monkeypatch.setattr(evaluation, "_KEPT", kept)
        return Descent(repeated_problem(), has_prior=True).fit()

    whole, partly, nothing = map(estimate, (10**9, 3000, 0))
    for fit in (partly, nothing):
        assert (fit.z == whole.z).all()
        assert (fit.left_out.values == whole.left_out.values).all()


@pytest.mark.parametrize("of_groups", [range(18), [0, 1, 2] * 6, [0] * 18, [*range(15), 0, 1, 1]])
def test_a_group_of_many_numbers_is_left_out_as_one_of_few(monkeypatch, of_groups):
    """Readings, groups across poses and within, and all in one, which alone determines the set-up and most of the arm."""
    problem = repeated_problem()
    fit, groups = Descent(problem, has_prior=True).fit(), np.array(of_groups)
    throughs, outcomes = fit.throughs(problem), []
    for longest in (1000, 0):
        monkeypatch.setattr(fitting, "_LARGE", longest)
        outcomes.append(fitting.leave_out(problem, throughs, fit.residuals, groups))
    few, many = outcomes
    assert (few.is_predicted == many.is_predicted).all()
    assert many.trials == pytest.approx(few.trials, rel=1e-6)
    assert few.is_predicted.all() or not groups.any()
    for name in ("values", "std", "distance"):  # beyond what is predicted, lengths and angles may share in other ways
        expected = getattr(few, name)[few.is_predicted]
        np.testing.assert_allclose(getattr(many, name)[few.is_predicted], expected, rtol=1e-9)


def test_attitudes_alike_are_named_where_the_target_is_unknown():
    model, q = plain_model(), np.zeros((4, 6))
    q[3] = np.linspace(0.3, 0.4, 6)  # the last joint alone turns, by 0.1 rad

    def said(measurement, q):
        data = read_data(model, (q, readings_of(model, q, measurement)), (measurement,))
        return Problem.of(model, data)[0].alike_attitudes

    assert said(FREE, q).startswith("attitudes of the tool differ by 5.7 deg only")
    assert said(FREE, 3 * q) == said(replace(FREE, target_known=True), q) == said(replace(FREE, base="known"), q) == ""


def test_precise_readings_and_broad_tolerances_keep_their_digits():
    """Against the closed form by singular values from 1e-5 to 1e5, beside nuisances of which a number is nearly one."""
    rng, values = np.random.default_rng(9), np.logspace(-5, 5, 8)
    left, right = np.linalg.qr(rng.normal(size=(90, 11)))[0], np.linalg.qr(rng.normal(size=(8, 8)))[0]
    by_nuisance = 1e5 * left[:, 8:] @ rng.normal(size=(3, 3))
    by_z = left[:, :8] * values @ right.T + by_nuisance @ rng.normal(size=(3, 8))
    estimator, z, white = Estimator.of(by_z, by_nuisance, has_prior=True), rng.normal(size=8), rng.normal(size=90)
    np.testing.assert_allclose(right.T @ estimator.covariance @ right, np.diag(1 / (1 + values**2)), atol=1e-9)
    expected = (values * (left[:, :8].T @ white) + values**2 * (right.T @ z)) / (1 + values**2)
    np.testing.assert_allclose(right.T @ estimator.estimate(white, z), expected, atol=1e-8)
    root, columns = estimator.leverage_root(), left[:, :8] * values
    left_of_columns = columns - root @ (root.T @ columns)
    np.testing.assert_allclose(columns.T @ left_of_columns, np.diag(values**2 / (1 + values**2)), atol=1e-4)


def test_the_suspect_joint_is_that_of_the_dense_projector(chunked):
    problem = repeated_problem()
    fit = Descent(problem, has_prior=True).fit()
    name, ratio = _suspect_joint(problem, fit)
    whole = dense(problem, fit.z, fit.nuisances)
    estimator = Estimator.of(whole.by_z, whole.by_nuisance, has_prior=True)
    root, leverage = np.linalg.cholesky(whole.noise), estimator.leverage_root()
    projector = np.eye(len(leverage)) - leverage @ leverage.T
    values, expected, first = np.zeros(4), np.zeros(4), 0
    for station, places in zip(problem.each_station(), problem.places, strict=True):
        by_error = FREE.slopes(station.at.posture.pose, station.at.error_at_means, fit.nuisances).error
        own = slice(first, first + len(places[0]))
        for row in station.rows:  # each reading is a visit
            is_of_row = (places[0] == row)[:, None]
            by_joint = np.where(
                is_of_row, np.tile(by_error @ station.at.posture.joint_jacobian, (len(station.rows), 1)), 0
            )
            along = np.linalg.solve(root[own, own], by_joint)
            values += (along.T @ whole.white[own]) ** 2
            expected += np.einsum("ij,ik,kj->j", along, projector[own, own], along)
        first = own.stop
    assert name == problem.model.chain.joint_names[int(np.argmax(values / expected))]
    assert ratio == pytest.approx((values / expected).max(), rel=1e-9)
