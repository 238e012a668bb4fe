"""The fit against a general least-squares solver, planted parameters, planted faults, and files written and read again."""

from __future__ import annotations

import json
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize, stats

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, paper_model, plain_model, random_poses, readings_of
from precision_pin.analyses.calibration.calibrate import CalibrationResult
from precision_pin.analyses.calibration.forecast import contact_poses, simulate_calibrations
from precision_pin.base import se3
from precision_pin.robot.chain import Chain
from precision_pin.sources import Backlash, Frame, JointOffset, Mounting

pytestmark = pytest.mark.slow

TRACKER = pp.Measurement(std=20e-6, target=OFF_AXIS)
FREE = pp.Measurement(std=20e-6, target=OFF_AXIS, base="free", target_known=False)
MOVED = se3.displacement([2.0, -1.0, 0.5, 0.3, -1.2, 0.8])


def truth_of(model: pp.ErrorModel, found: CalibrationResult, seed: int) -> np.ndarray:
    x = model.space.sample(seed, 0, 1)[:, 0]
    return x[[model.space.index[name] for name in found.posterior.names]]


def error_of_prediction(model: pp.ErrorModel, found: CalibrationResult, q: np.ndarray, seed: int) -> np.ndarray:
    """Return the tip of the calibrated arm less that of the robot, with nothing that changes from visit to visit."""
    x = model.space.mean.copy()
    x[[model.space.index[name] for name in found.posterior.names]] = truth_of(model, found, seed)
    at = model.at(q)
    error = at.exact(x[:, None])[:, 0]
    return found.predict(q)[:3, 3] - at.posture.pose[:3, 3] - error[:3]


def test_estimate_is_that_of_a_general_solver() -> None:
    """The same sum of squares, written down with the exact model and minimised with derivatives by finite differences."""
    model, q = plain_model(), random_poses(4, 8)
    readings = readings_of(model, q, TRACKER, seed=2)
    found = pp.calibrate(model, (q, readings), TRACKER)
    unit = [model.space.index[name] for name in found.posterior.names]
    std, mean = np.sqrt(model.space.block_covariance.variances), model.space.mean
    others = [k for k in range(model.space.size) if k not in unit]
    models = [model.at(q[:, k]) for k in range(8)]
    roots = []
    for at in models:
        arm = at.posture.pose[:3, :3] @ OFF_AXIS
        tilt = se3.left_jacobian(at.error_at_means[3:])
        arm = se3.exp_rotation(at.error_at_means[3:]) @ arm
        slopes = (at.jacobian[:3] - se3.skew(arm) @ tilt @ at.jacobian[3:])[:, others]
        noise = np.eye(3) * TRACKER.std**2 + slopes @ np.diag(std[others] ** 2) @ slopes.T
        roots.append(np.linalg.cholesky(noise))

    def residuals(z: np.ndarray) -> np.ndarray:
        x = mean.copy()
        x[unit] += std[unit] * z
        parts = [z]
        for at, root, reading in zip(models, roots, readings, strict=True):
            error = at.exact(x[:, None])[:, 0]
            tip = at.posture.pose[:3, 3] + error[:3] + se3.exp_rotation(error[3:]) @ at.posture.pose[:3, :3] @ OFF_AXIS
            parts.append(np.linalg.solve(root, reading - tip))
        return np.concatenate(parts)

    solved = optimize.least_squares(residuals, np.zeros(len(unit)), jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-12)
    estimate = np.array(list(found.posterior.mean.values()))
    np.testing.assert_allclose((estimate - mean[unit]) / std[unit], solved.x, atol=2e-6)
    assert found.chi_square == pytest.approx(2 * solved.cost, rel=1e-9)
    assert found.degrees_of_freedom == 24


def test_planted_parameters_are_recovered_and_held_out_poses_predicted() -> None:
    model, q, later = plain_model(), random_poses(4, 40), random_poses(4, 20, seed=9)
    found = pp.calibrate(model, (q, readings_of(model, q, TRACKER, seed=4)), TRACKER, at=later)
    estimate, std = (np.array(list(each.values())) for each in (found.posterior.mean, found.posterior.std))
    deviation = (estimate - truth_of(model, found, 4)) / std
    assert stats.chi2.sf(deviation @ np.linalg.solve(correlation(found), deviation), deviation.size) > 1e-3
    errors = np.array([error_of_prediction(model, found, later[:, k], 4) for k in range(20)])
    expected = np.sqrt(np.mean([np.trace((e.covariance_after - e.floor)[:3, :3]) for e in found.poses]))
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 2 * expected
    assert found.verdict == "agrees"
    assert found.rms("after") < 0.1 * found.rms("before")


def correlation(found: CalibrationResult) -> np.ndarray:
    std = np.array(list(found.posterior.std.values()))
    return found.posterior.covariance / np.outer(std, std)


@pytest.mark.parametrize("kind", ["position", "pose"])
def test_an_unknown_base_and_target_are_found(kind: str) -> None:
    """Readings in the axes of a tracker that is somewhere else: the same estimates, and its place."""
    model, q = plain_model(), random_poses(4, 30)
    free = pp.Measurement(kind, std=20e-6, target=OFF_AXIS, base="free", target_known=False)  # type: ignore[arg-type]
    readings = readings_of(model, q, free, seed=1)
    moved = readings.copy()
    moved[:, :3] = readings[:, :3] @ MOVED[:3, :3].T + MOVED[:3, 3]
    if kind == "pose":
        turns = np.einsum("ij,jkn->ikn", MOVED[:3, :3], se3.exp_rotation(readings[:, 3:].T))
        moved[:, 3:] = se3.log_rotation(turns).T
    here, there = (pp.calibrate(model, (q, each), free) for each in (readings, moved))
    std = np.array(list(here.posterior.std.values()))
    estimates = [np.array(list(each.posterior.mean.values())) for each in (here, there)]
    np.testing.assert_allclose((estimates[1] - estimates[0]) / std, 0, atol=1e-5)
    assert here.set_up.base is not None
    assert there.set_up.base is not None
    np.testing.assert_allclose(there.set_up.base, MOVED @ here.set_up.base, atol=1e-9)
    for name, value in zip(("x", "y", "z"), here.set_up.target - OFF_AXIS, strict=True):
        assert abs(value) < 5 * here.set_up.std[f"target.{name}"]


def test_distances_find_their_anchor() -> None:
    model, q = plain_model(), random_poses(4, 60)
    at = pp.Measurement("distance", std=10e-6, anchor=(1.2, 0.4, 0.3))
    free = pp.Measurement("distance", std=10e-6, base="free")
    found = pp.calibrate(model, (q, readings_of(model, q, at, seed=1)), free)
    assert found.verdict == "agrees"
    assert found.set_up.anchor is not None
    assert np.linalg.norm(found.set_up.anchor - at.anchor) < 1e-3
    for axis, value in zip("xyz", found.set_up.anchor - at.anchor, strict=True):
        assert abs(value) < 5 * found.set_up.std[f"anchor.{axis}"]


def test_gross_errors_are_named_and_have_no_weight() -> None:
    model, q = plain_model(), random_poses(4, 30)
    readings = readings_of(model, q, TRACKER, seed=3)
    wrong = readings.copy()
    wrong[11] += (0.0, 1e-3, 0.0)
    wrong[20] += (5e-3, 0.0, 0.0)
    kept = [k for k in range(30) if k not in (11, 20)]
    found = pp.calibrate(model, (q, wrong), TRACKER)
    without = pp.calibrate(model, (q[:, kept], readings[kept]), TRACKER)
    assert [error.line for error in found.gross_errors] == [12, 21]
    assert found.gross_errors[1].size == pytest.approx(5e-3, rel=0.1)
    estimates = [np.array(list(each.posterior.mean.values())) for each in (found, without)]
    np.testing.assert_allclose(estimates[0], estimates[1], rtol=1e-6, atol=1e-12)
    assert "W_GROSS_ERROR" in {finding.code for finding in found.findings}
    assert without.gross_errors == ()


def test_leaving_a_reading_out_predicts_it_as_a_fit_without_it_does() -> None:
    model, q = plain_model(), random_poses(4, 15)
    readings = readings_of(model, q, FREE, seed=3)
    found = pp.calibrate(model, (q, readings), FREE)
    rest = [k for k in range(15) if k != 6]
    without = pp.calibrate(model, (q[:, rest], readings[rest]), FREE)
    tip = without.predict(q[:, 6])
    assert without.set_up.base is not None
    seen = without.set_up.base @ np.append(tip[:3, 3] + tip[:3, :3] @ without.set_up.target, 1.0)
    assert found.set_up.base is not None
    in_base = np.linalg.norm(readings[6] - seen[:3])
    assert np.linalg.norm(found.left_out[6]) == pytest.approx(in_base, rel=1e-2)


def test_a_group_is_left_out_as_a_fit_without_it_does(tmp_path: Path) -> None:
    """Two groups of the file's column: the second one predicted by a fit without it."""
    model, q = plain_model(), random_poses(4, 16)
    readings = readings_of(model, q, TRACKER, seed=3)
    header = ", ".join([*(f"{name} [rad]" for name in model.chain.joint_names), "x [m]", "y [m]", "z [m]", "group"])
    rows = np.hstack([q.T, readings, (np.arange(16) > 10)[:, None]])
    np.savetxt(tmp_path / "data.csv", rows, "%.15g", delimiter=", ", header=header, comments="")
    found = pp.calibrate(model, tmp_path / "data.csv", TRACKER)
    without = pp.calibrate(model, (q[:, :11], readings[:11]), TRACKER)
    for k in range(11, 16):
        tip = without.predict(q[:, k])
        away = readings[k] - tip[:3, 3] - tip[:3, :3] @ OFF_AXIS
        np.testing.assert_allclose(found.left_out[k], away, rtol=2e-2, atol=2e-7)


def test_a_planted_backlash_is_noticed() -> None:
    """The sheet lacks a gap of 1 mrad in joint 3: chi-square says so, and names the joint."""
    model, q = plain_model(), random_poses(4, 40)
    sources = (*model.sources, Backlash(joint="joint3", backlash=1e-3, band=1.0))
    real = pp.ErrorModel(model.chain, pp.Space(), sources, model.poses)
    found = pp.calibrate(model, (q, readings_of(real, q, TRACKER, seed=5)), TRACKER)
    assert found.verdict == "disagrees"
    assert found.probability < 1e-6
    (doubt,) = (finding for finding in found.findings if finding.code == "W_MODEL")
    assert "an error of joint3" in doubt.message


def test_without_a_prior_the_means_of_the_sheet_do_not_matter() -> None:
    model, q = plain_model(), random_poses(4, 15)
    precise = pp.Measurement("pose", std=1e-7)
    readings = readings_of(model, q, precise, seed=6)
    found = pp.calibrate(model, (q, readings), precise, prior=False)
    assert found.degrees_of_freedom == 15 * 6 - 7
    assert found.verdict == "agrees"
    estimate = np.array(list(found.posterior.mean.values()))
    std = np.array(list(found.posterior.std.values()))
    assert (np.abs(estimate - truth_of(model, found, 6)) < 5 * std).all()
    both = pp.calibrate(model, (q, readings), precise)
    # with a prior the estimate is drawn towards the means, by a little
    assert (np.array(list(both.posterior.std.values())) <= std * (1 + 1e-9)).all()


def test_another_choice_of_parameters_gives_the_same_predictions() -> None:
    """All 36 displacements of frames, and the 22 of axes' lines and tool: the same arm, to 1e-8 m at poses not measured."""
    chain, measurement = paper_model().chain, pp.Measurement("pose", std=20e-6)
    q, later = random_poses(4, 25), random_poses(4, 10, seed=9)
    every = pp.every_frame(chain)
    law = {name: pp.Normal(1e-3) for name in ("x", "y", "rx", "ry")}
    sources: list[pp.Source] = [Frame(joint=name, **law) for name in chain.joint_names]  # type: ignore[arg-type]
    sources.append(Mounting(at="tool", z=pp.Normal(1e-3), rz=pp.Normal(1e-3), **law))  # type: ignore[arg-type]
    lines = pp.ErrorModel(chain, pp.Space(), sources)
    readings = readings_of(every, q, measurement, seed=2)
    found = [pp.calibrate(model, (q, readings), measurement, prior=False) for model in (every, lines)]
    assert [each.rank for each in found] == [22, 22]
    for k in range(10):
        one, other = (each.predict(later[:, k]) for each in found)
        np.testing.assert_allclose(one[:3, 3], other[:3, 3], atol=1e-8)
        np.testing.assert_allclose(one[:3, :3], other[:3, :3], atol=1e-8)


def test_readings_that_determine_nothing_are_refused() -> None:
    """An offset of joint 1, upright, is a turn of the base: where that is free, no reading shows it."""
    chain, free = paper_model().chain, pp.Measurement(base="free")
    model = pp.ErrorModel(chain, pp.Space(), [JointOffset(joint="joint1", offset=pp.Normal(1e-3))])
    q = random_poses(4, 12)
    with pytest.raises(pp.InputError, match=r"no reading sees any number that varies .*, or with the base known"):
        pp.calibrate(model, (q, readings_of(model, q, free)), free)
    with pytest.raises(pp.InputError, match="nothing to estimate"):
        pp.plan_calibration(model, q, 6, free, at=[[0.0, 0.3, 0.5, -0.3]])
    forecast = pp.forecast_calibration(model, q, free, at=[[0.0, 0.3, 0.5, -0.3]])
    assert "no reading sees any number" in forecast.findings[0].message
    assert forecast.rms("after") == pytest.approx(forecast.rms("before"), rel=1e-9)


def test_what_no_reading_sees_keeps_its_law() -> None:
    model, q = paper_model(), random_poses(4, 30)
    measurement = pp.Measurement("pose", std=20e-6)
    found = pp.calibrate(model, (q, readings_of(model, q, measurement, seed=1)), measurement)
    for name in found.identifiability.unseen:
        draw = next(one for one in model.space.draws if one.name == name)
        assert draw in found.model.space.draws
        assert found.posterior.learned[name] < 1e-9


def test_estimates_stay_within_the_bounds_of_laws() -> None:
    """An offset of three half-widths of its uniform law: the estimate stops at the bound, and the result says so."""
    chain = paper_model().chain
    model = pp.ErrorModel(chain, pp.Space(), [JointOffset(joint="joint2", offset=pp.Uniform(1e-3))])
    real = pp.ErrorModel(chain, pp.Space(), [JointOffset(joint="joint2", offset=pp.Uniform(1e-9, mean=3e-3))])
    q = random_poses(4, 10)
    found = pp.calibrate(model, (q, readings_of(real, q, TRACKER)), TRACKER)
    assert found.posterior.mean["joint_offset[joint2].offset"] == pytest.approx(1e-3, abs=1e-12)
    assert found.at_bounds == ("joint_offset[joint2].offset",)
    assert found.verdict == "disagrees"
    assert "W_AT_BOUND" in {finding.code for finding in found.findings}
    sampled = found.model.space.sample(0, 0, 1000)
    assert np.abs(sampled).max() <= 1e-3


def test_the_arm_that_is_left_has_the_error_forecast() -> None:
    model, q = plain_model(), random_poses(4, 30)
    found = pp.calibrate(model, (q, readings_of(model, q, TRACKER, seed=7)), TRACKER, at=["work"])
    sampled = pp.monte_carlo(found.model, "work", samples=20_000)
    tip = found.predict("work")[:3, 3] - model.at("work").posture.pose[:3, 3]
    np.testing.assert_allclose(
        [axis.mean for axis in (sampled.position.x, sampled.position.y, sampled.position.z)], tip, atol=2e-6
    )
    np.testing.assert_allclose(
        np.trace(sampled.covariance[:3, :3]), np.trace(found.poses[0].covariance_after[:3, :3]), rtol=0.03
    )


def test_bounds_of_laws_do_not_undo_what_is_known_of_sums() -> None:
    """Six lengths of the paper's arm show in sums only: cut one by one at their bounds, the sums would be lost."""
    model, q = paper_model(), random_poses(4, 40)
    found = pp.calibrate(model, (q, readings_of(model, q, TRACKER, seed=1)), TRACKER, at=["paper"])
    at, x = found.model.at("paper"), found.model.space.sample(3, 0, 4000)
    spread = np.cov(at.exact(x)[:3])
    np.testing.assert_allclose(np.trace(spread), np.trace(found.poses[0].covariance_after[:3, :3]), rtol=0.08)


def test_the_urdf_has_the_poses_of_the_calibrated_arm(tmp_path: Path) -> None:
    model, q = plain_model(), random_poses(4, 20)
    geometric = pp.ErrorModel(model.chain, pp.Space(), model.sources[:-1], model.poses)
    found = pp.calibrate(geometric, (q, readings_of(geometric, q, TRACKER, seed=8)), TRACKER)
    path = tmp_path / "calibrated.urdf"
    # what changes from pose to pose and visit to visit stays at its mean, zero
    assert len(found.to_urdf(path)) == 3
    read = Chain.from_urdf(path, tip="tool")
    for k in range(20):
        np.testing.assert_allclose(read.at(q[:, k]).pose, found.predict(q[:, k]), atol=1e-9)


def test_json_of_every_result_is_what_its_fields_declare() -> None:
    """Numbers, texts and arrays under each key are those of its attribute; arrays in fields cannot be written."""
    model, q = plain_model(), random_poses(4, 6)
    found = pp.calibrate(model, (q, readings_of(model, q, TRACKER)), TRACKER)
    results = {
        "calibration": found,
        "calibration-forecast": pp.forecast_calibration(model, q, TRACKER),
        "calibration-plan": pp.plan_calibration(model, q, 3, TRACKER),
        "population": pp.population(model, [found, found], TRACKER),
    }
    for schema, result in results.items():
        data = json.loads(result.to_json())
        assert list(data)[:4] == ["schema", "complete", "robot", "base"]
        assert data["schema"] == f"precision-pin/{schema}/1"
        assert list(data)[-1] == "findings"
        for key, _, attribute in (entry.partition("=") for entry in result.KEYS if entry != "*head"):
            value = attrgetter(attribute or key)(result)
            if isinstance(value, np.ndarray):
                assert not value.flags.writeable
                np.testing.assert_array_equal(data[key], value)
            elif isinstance(value, bool | int | float | str):
                assert data[key] == value
            else:
                assert len(data[key]) == len(value) if isinstance(value, tuple) else bool(data[key]) == bool(value)
    assert [entry["name"] for entry in json.loads(found.to_json())["poses"]] == ["work", "home"]


def test_intervals_cover_the_truth() -> None:
    """95 % intervals of 4,000 simulated robots, every number and the tip at a pose: 94.5 to 95.5 %."""
    model, q = plain_model(), random_poses(4, 15)
    forecast = pp.forecast_calibration(model, q, TRACKER)
    found = simulate_calibrations(model, q, TRACKER, robots=4000, seed=11)
    unit_std = np.array(list(forecast.posterior.std.values())) / np.array(list(forecast.posterior.prior_std.values()))
    inside = np.abs(found.estimates - found.truth) < stats.norm.ppf(0.975) * unit_std[:, None]
    assert 0.945 < inside.mean() < 0.955
    tip = found.errors[:, :3] / np.sqrt([np.diag(e.covariance_after)[:3] for e in forecast.poses])[:, :, None]
    assert 0.945 < (np.abs(tip) < stats.norm.ppf(0.975)).mean() < 0.955


def touching(
    model: pp.ErrorModel, measurement: pp.Measurement, q: np.ndarray, x: np.ndarray, noise: np.ndarray
) -> np.ndarray:
    """Return joint values at which the robot x has its target at the nominal place, but for the noise; by Newton's steps."""
    result = q.copy()
    for k in range(q.shape[1]):
        for _ in range(12):
            at = model.at(result[:, k])
            error = at.exact(x[:, None])[:, 0]
            away = measurement.predict(at.posture.pose, error[:, None], np.zeros((len(measurement.nuisances), 1)))[:, 0]
            by_error = measurement.slopes(at.posture.pose, error, np.zeros(len(measurement.nuisances))).error
            jacobian = by_error @ model.chain.at_columns(result[:, k : k + 1]).joint_jacobian[:, :, 0]
            result[:, k] -= np.linalg.lstsq(jacobian, away - noise[k], rcond=None)[0]
        assert np.abs(away - noise[k]).max() < 1e-12
    return result


@pytest.mark.parametrize("kind", ["socket", "plane"])
def test_contact_recovers_a_robot_and_its_places(kind: str, tmp_path: Path) -> None:
    """The robot touches places that are 3 mm from where the first guess has them; only joint values are given."""
    plain = plain_model()
    # contact has no pose or visit draws to be simulated beside
    model = pp.ErrorModel(plain.chain, pp.Space(), [*plain.sources[:4], *plain.sources[7:]], plain.poses)
    places = {"sockets": ((0.9, 0.2, 0.8), (0.2, 0.9, 1.0)), "plane": ((0.0, 0.0, 0.5), (0.1, -0.2, 1.0))}
    place = places["sockets"] if kind == "socket" else places["plane"]
    key = "sockets" if kind == "socket" else "plane"
    at = pp.Measurement(kind, std=20e-6, target=OFF_AXIS, **{key: place})  # type: ignore[arg-type]
    x = model.space.sample(3, 0, 1)[:, 0]
    noise = np.random.default_rng(1).normal(0, at.std, (25, at.size))
    q = touching(model, at, contact_poses(model.chain, at, 25).q, x, noise)
    guess = tuple((a + 3e-3, b, c) for a, b, c in place) if kind == "socket" else ((0.0, 0.0, 0.503), place[1])
    free = pp.Measurement(kind, std=20e-6, target=OFF_AXIS, base="free", **{key: guess})  # type: ignore[arg-type]
    header = ", ".join(f"{name} [rad]" for name in model.chain.joint_names)
    np.savetxt(tmp_path / "touched.csv", q.T, "%.15g", delimiter=", ", header=header, comments="")
    found = pp.calibrate(model, tmp_path / "touched.csv" if kind == "plane" else (q, None), free)
    assert found.verdict == "agrees"
    estimate = np.array(list(found.posterior.mean.values()))
    deviation = estimate - x[[model.space.index[name] for name in found.posterior.names]]
    assert stats.chi2.sf(deviation @ np.linalg.solve(found.posterior.covariance, deviation), deviation.size) > 1e-3
    if kind == "socket":
        errors = (found.set_up.sockets - np.array(place)).ravel()
        stds = np.array([found.set_up.std[name] for name in free.nuisances])
        assert (np.abs(errors) < 5 * stds).all()
    else:
        point, normal = found.set_up.plane
        wanted = np.array(place[1]) / np.linalg.norm(place[1])
        tilts = np.hypot(found.set_up.std["plane.tilt1"], found.set_up.std["plane.tilt2"])
        assert np.linalg.norm(np.cross(normal, wanted)) < 5 * tilts
        assert abs(wanted @ (point - place[0])) < 5e-3
