"""The fit against a general solver, planted parameters and faults, zeros by another library."""

import json
import re
from dataclasses import replace
from functools import cache
from operator import attrgetter

import numpy as np
import pinocchio as pin
import pytest
from matplotlib.quiver import Quiver
from scipy import optimize, stats
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, offsets, paper_model, plain_model, random_poses, readings_of
from analyses.test_moments import stretched
from precision_pin.analyses.calibration.data import read_data
from precision_pin.analyses.calibration.design import SetUp
from precision_pin.analyses.calibration.figure import plan_figure
from precision_pin.analyses.calibration.forecast import contact_poses, interval_after, simulate_calibrations
from precision_pin.analyses.calibration.remaining import RemainingError, remaining_figure
from precision_pin.analyses.calibration.start import check_directions
from precision_pin.analyses.calibration.table import calibration_table, estimate_rows, set_up_lines
from precision_pin.base import se3
from precision_pin.base.errors import UnknownNameError
from precision_pin.render.text_table import whole_tables
from precision_pin.robot.examples import resolve_robot
from precision_pin.robot.pose_set import PoseSet
from precision_pin.sources import AxisInstall, Backlash, Frame, JointOffset, Length, Mounting
from support.refusals import check_refused

# of complete robots
pytestmark = pytest.mark.slow

WIDE = pp.Uniform(np.radians(30))


TRACKER = pp.Measurement(std=20e-6, target=OFF_AXIS)
MOVED = se3.displacement([2.0, -1.0, 0.5, 0.3, -1.2, 0.8])


def numbers(values):
    """Return the numbers of a dictionary."""
    return np.array(list(values.values()))


def check_truth(model, found, seed):
    """Compare the estimate with the robot's numbers by its covariance, and return all numbers, others at their mean."""
    x = model.space.mean.copy()
    unit = [model.space.index[name] for name in found.posterior.names]
    x[unit] = model.space.sample(seed, 0, 1)[unit, 0]
    off = numbers(found.posterior.mean) - x[unit]
    assert stats.chi2.sf(off @ np.linalg.solve(found.posterior.covariance, off), off.size) > 1e-3
    return x


def fit_of(model, q, measurement=TRACKER, seed=0, real=None, **settings):
    """Return the fit to readings of a simulated robot of the model, or of another one."""
    return pp.calibrate(model, (q, readings_of(real or model, q, measurement, seed)), measurement, **settings)


@cache
def plain_fit():
    return fit_of(plain_model(), random_poses(4, 6), seed=3)


FACTORS = {"mm": 1e-3, "µm": 1e-6, "mrad": 1e-3, "µrad/(N·m)": 1e-6}


def test_numbers_are_printed_in_their_units():
    """Offsets and lengths in mm and mrad, compliances in µrad/(N·m): cell times unit is the number in SI, with --all of all."""
    found = plain_fit()
    posterior = found.posterior
    rows = estimate_rows(found, None)[1:]
    assert [row[1] for row in rows if row[0].startswith("joint_off")] == ["mrad"] * 4
    assert {row[1] for row in rows} <= set(FACTORS)
    for name, unit, *cells in rows:
        values = posterior.prior_mean[name], posterior.prior_std[name], posterior.mean[name], *found.interval(name)
        assert [float(cell) * FACTORS[unit] for cell in cells[:5]] == pytest.approx(values, rel=6e-3, abs=1e-9)
    with whole_tables(True):
        text = calibration_table(found)
    assert all(f"  {row[1]} " in text for row in rows)
    assert "SI units" not in text


def test_the_frame_of_the_instrument_is_printed_whole():
    """Place and rotation vector with ±: propagated by central differences of another library's rotations."""
    at = np.array([1e-3, -2e-3, 3e-3, 0.02, -0.01, 0.03])
    root = 1e-5 * np.random.default_rng(0).normal(size=(6, 6))

    def frame(x):
        turn = Rotation.from_matrix(MOVED[:3, :3]) * Rotation.from_rotvec(x[3:])
        return np.concatenate([MOVED[:3, 3] + MOVED[:3, :3] @ x[:3], turn.as_rotvec()])

    slopes = np.array([(frame(at + step) - frame(at - step)) / 2e-6 for step in 1e-6 * np.eye(6)]).T
    expected = np.sqrt(np.diag(slopes @ root @ root.T @ slopes.T))
    measurement = pp.Measurement(std=20e-6, target=OFF_AXIS, base="free")
    set_up = SetUp.of(measurement, MOVED, at, root @ root.T)
    np.testing.assert_allclose(set_up.base_std, expected, rtol=1e-6)
    (line,) = set_up_lines([set_up])
    scale = np.repeat([1e3, 180 / np.pi], 3)
    for (value, std), true, deviation in zip(
        re.findall(r"(-?[\d.]+) ± ([\d.]+)", line), scale * frame(at), scale * expected, strict=True
    ):
        assert float(std) == pytest.approx(deviation, rel=0.06)
        assert float(value) == pytest.approx(true, abs=0.06 * deviation)
    # what readings do not determine has no ±
    (line,) = set_up_lines([SetUp.of(measurement, MOVED, at, np.diag([np.inf] * 6))])
    assert line.count("± unknown") == 6


def test_estimate_is_that_of_a_general_solver():
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
        slopes = TRACKER.slopes(at.posture.pose, at.error_at_means, np.zeros(0)).error @ at.jacobian[:, others]
        noise = np.eye(3) * TRACKER.std**2 + slopes @ np.diag(std[others] ** 2) @ slopes.T
        roots.append(np.linalg.cholesky(noise))

    def residuals(z):
        x = mean.copy()
        x[unit] += std[unit] * z
        parts = [z]
        for at, root, reading in zip(models, roots, readings, strict=True):
            tip = TRACKER.predict(at.posture.pose, at.exact(x[:, None]), np.zeros((0, 1)))[:, 0]
            parts.append(np.linalg.solve(root, reading - tip))
        return np.concatenate(parts)

    solved = optimize.least_squares(residuals, np.zeros(len(unit)), jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-12)
    estimate = numbers(found.posterior.mean)
    np.testing.assert_allclose((estimate - mean[unit]) / std[unit], solved.x, atol=2e-6)
    assert (found.chi_square, found.degrees_of_freedom) == (pytest.approx(2 * solved.cost, rel=1e-9), 24)


def test_an_unknown_base_target_and_anchor_are_found():
    """Readings in the axes of a tracker that is somewhere else: the same estimates, and its place."""
    model, q = plain_model(), random_poses(4, 8)
    free = pp.Measurement("pose", std=20e-6, target=OFF_AXIS, base="free", target_known=False)
    readings = readings_of(model, q, free, seed=1)
    turns = np.einsum("ij,jkn->ikn", MOVED[:3, :3], se3.exp_rotation(readings[:, 3:].T))
    moved = np.hstack([readings[:, :3] @ MOVED[:3, :3].T + MOVED[:3, 3], se3.log_rotation(turns).T])
    here, there = (pp.calibrate(model, (q, each), free) for each in (readings, moved))
    difference = numbers(there.posterior.mean) - numbers(here.posterior.mean)
    np.testing.assert_allclose(difference / numbers(here.posterior.std), 0, atol=1e-5)
    np.testing.assert_allclose(there.set_up.base, MOVED @ here.set_up.base, atol=1e-9)
    for name, value in zip("xyz", here.set_up.target - OFF_AXIS, strict=True):
        assert abs(value) < 5 * here.set_up.std[f"target.{name}"]
    # and the anchor of distances
    at, q = pp.Measurement("distance", std=10e-6, anchor=(1.2, 0.4, 0.3)), random_poses(4, 16)
    free = pp.Measurement("distance", std=10e-6, base="free")
    found = pp.calibrate(model, (q, readings_of(model, q, at, seed=1)), free)
    assert found.verdict == "agrees"
    for axis, value in zip("xyz", found.set_up.anchor - at.anchor, strict=True):
        assert abs(value) < 5 * found.set_up.std[f"anchor.{axis}"]


def test_gross_errors_are_named_and_have_no_weight():
    model, q = plain_model(), random_poses(4, 12)
    readings = readings_of(model, q, TRACKER, seed=3)
    wrong = readings.copy()
    wrong[[8, 10]] += (0.0, 1e-3, 0.0), (5e-3, 0.0, 0.0)
    kept = np.delete(np.arange(12), [8, 10])
    found = pp.calibrate(model, (q, wrong), TRACKER)
    without = pp.calibrate(model, (q[:, kept], readings[kept]), TRACKER)
    assert [error.line for error in found.gross_errors] == [9, 11]
    assert found.gross_errors[1].size == pytest.approx(5e-3, rel=0.1)
    np.testing.assert_allclose(numbers(found.posterior.mean), numbers(without.posterior.mean), rtol=1e-6, atol=1e-12)
    assert "W_GROSS_ERROR" in {finding.code for finding in found.findings}
    assert without.gross_errors == ()


def test_a_planted_backlash_is_noticed():
    """The sheet lacks a gap of 1 mrad in joint 3: chi-square says so, and names the joint."""
    model, q = plain_model(), random_poses(4, 20)
    sources = (*model.sources, Backlash(joint="joint3", backlash=1e-3, band=1.0))
    found = fit_of(model, q, seed=5, real=pp.ErrorModel(model.chain, pp.Space(), sources, model.poses))
    assert found.verdict == "disagrees"
    assert found.probability < 1e-6
    (doubt,) = (finding for finding in found.findings if finding.code == "W_MODEL")
    assert "an error of joint3" in doubt.message


def test_another_choice_of_parameters_gives_the_same_predictions():
    """All 36 displacements of frames, and the 22 of axes' lines and tool: the same arm, to 1e-8 m at poses not measured."""
    chain, measurement, q = paper_model().chain, pp.Measurement("pose", std=20e-6), random_poses(4, 8)
    every = pp.every_frame(chain)
    law = {name: pp.Normal(1e-3) for name in ("x", "y", "rx", "ry")}
    sources = [Frame(joint=name, **law) for name in chain.joint_names]
    sources.append(Mounting(at="tool", z=pp.Normal(1e-3), rz=pp.Normal(1e-3), **law))
    lines = pp.ErrorModel(chain, pp.Space(), sources)
    found = [fit_of(model, q, measurement, 2, every, prior=False) for model in (every, lines)]
    assert [(each.rank, each.degrees_of_freedom) for each in found] == [(22, 8 * 6 - 22)] * 2
    for later in random_poses(4, 5, seed=9).T:
        one, other = (each.predict(later) for each in found)
        np.testing.assert_allclose(one[:3], other[:3], atol=1e-8)


def test_readings_that_determine_nothing_are_refused():
    """An offset of joint 1, upright, is a turn of the base: where that is free, no reading shows it."""
    model, free, q = offsets(pp.Normal(1e-3), joints=["joint1"]), pp.Measurement(base="free"), random_poses(4, 12)
    at = [[0.0, 0.3, 0.5, -0.3]]
    check_refused((r"no reading sees any number that varies .*, or with the base known", fit_of, model, q, free))
    check_refused(("nothing to estimate", pp.plan_calibration, model, q, 6, free), at=at)
    forecast = pp.forecast_calibration(model, q, free, at=at)
    assert "no reading sees any number" in forecast.findings[0].message
    assert forecast.rms("after") == pytest.approx(forecast.rms("before"), rel=1e-9)


def test_estimates_stay_within_the_bounds_of_laws():
    """An offset of three half-widths of its uniform law: the estimate stops at the bound, and the result says so."""
    real = offsets(pp.Uniform(1e-9, mean=3e-3), joints=["joint2"])
    found = fit_of(offsets(pp.Uniform(1e-3), joints=["joint2"]), random_poses(4, 10), real=real)
    assert found.posterior.mean["joint_offset[joint2].offset"] == pytest.approx(1e-3, abs=1e-12)
    assert (found.at_bounds, found.verdict) == (("joint_offset[joint2].offset",), "disagrees")
    assert "W_AT_BOUND" in {finding.code for finding in found.findings}
    assert np.abs(found.model.space.sample(0, 0, 1000)).max() <= 1e-3


def test_the_arm_that_is_left_has_the_error_forecast():
    """Its planted parameters are recovered, poses that were not measured are predicted, its samples are as forecast."""
    model, later = plain_model(), random_poses(4, 8, seed=9)
    found = fit_of(model, random_poses(4, 30), seed=4, at=[*later.T, "work"])
    # the robot, with nothing that changes from visit to visit
    x = check_truth(model, found, 4)
    ats = [model.at(one) for one in later.T]
    tips = np.array([at.posture.pose[:3, 3] + at.exact(x[:, None])[:3, 0] for at in ats])
    errors = np.array([found.predict(one)[:3, 3] for one in later.T]) - tips
    expected = np.sqrt(np.mean([np.trace((e.covariance_after - e.floor)[:3, :3]) for e in found.poses[:-1]]))
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 2 * expected
    assert found.verdict == "agrees"
    assert found.rms("after") < 0.1 * found.rms("before")
    sampled = pp.monte_carlo(found.model, "work", samples=20_000)
    tip = found.predict("work")[:3, 3] - model.at("work").posture.pose[:3, 3]
    means = [axis.mean for axis in (sampled.position.x, sampled.position.y, sampled.position.z)]
    np.testing.assert_allclose(means, tip, atol=2e-6)
    left = np.trace(found.poses[-1].covariance_after[:3, :3])
    np.testing.assert_allclose(np.trace(sampled.covariance[:3, :3]), left, rtol=0.03)


def test_what_no_reading_sees_keeps_its_law_and_what_is_known_of_sums_is_kept():
    """Six lengths of the paper's arm show in sums only: cut one by one at their bounds, the sums would be lost."""
    model = paper_model()
    found = fit_of(model, random_poses(4, 20), seed=1, at=["paper"])
    assert found.identifiability.unseen
    for name in found.identifiability.unseen:
        assert next(one for one in model.space.draws if one.name == name) in found.model.space.draws
        assert found.posterior.learned[name] < 1e-9
    spread = np.cov(found.model.at("paper").exact(found.model.space.sample(3, 0, 4000))[:3])
    np.testing.assert_allclose(np.trace(spread), np.trace(found.poses[0].covariance_after[:3, :3]), rtol=0.08)


def test_the_urdf_has_the_poses_of_the_calibrated_arm(tmp_path):
    model, q = plain_model(), random_poses(4, 6)
    found = fit_of(pp.ErrorModel(model.chain, pp.Space(), model.sources[:-1], model.poses), q, seed=8)
    path = tmp_path / "calibrated.urdf"
    # what changes from pose to pose and visit to visit stays at its mean, zero
    assert len(found.to_urdf(path)) == 3
    read = pp.Chain.from_urdf(path, tip="tool")
    for one in q.T:
        np.testing.assert_allclose(read.at(one).pose, found.predict(one), atol=1e-9)


def test_json_of_every_result_is_what_its_fields_declare():
    """Numbers, texts and arrays under each key are those of its attribute; arrays in fields cannot be written."""
    model, q = plain_model(), random_poses(4, 6)
    found = plain_fit()
    results = {
        "calibration": found,
        "calibration-forecast": pp.forecast_calibration(model, q, TRACKER, at=["work"]),
        "calibration-plan": pp.plan_calibration(model, q, 5, TRACKER),
        "population": pp.population(model, [found, found], TRACKER),
    }
    written = {schema: json.loads(result.to_json()) for schema, result in results.items()}
    for (schema, result), data in zip(results.items(), written.values(), strict=True):
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
    assert [entry["name"] for entry in written["calibration"]["poses"]] == ["work", "home"]
    best, poses = plan_figure(results["calibration-plan"]).axes
    assert list(best.lines[0].get_ydata()) == [100, 100]
    assert poses.get_xlim() == (0.5, 2.5)


def touched(model, at, x, noise):
    """Return joint values ``(n, P)`` at which the target of a robot is at its nominal place, but for noise ``(P, m)``."""
    q, still = contact_poses(model.chain, at, len(noise)).q.copy(), np.zeros(len(at.nuisances))
    for k in range(len(noise)):
        for _ in range(8):  # Newton's steps
            one = model.at(q[:, k])
            error, pose = one.exact(x[:, None])[:, 0], one.posture.pose
            away = at.predict(pose, error[:, None], still[:, None])[:, 0]
            of_joints = model.chain.at_columns(q[:, k : k + 1]).joint_jacobian[:, :, 0]
            jacobian = at.slopes(pose, error, still).error @ of_joints
            q[:, k] -= np.linalg.lstsq(jacobian, away - noise[k], rcond=None)[0]
        assert np.abs(away - noise[k]).max() < 1e-12
    return q


@pytest.mark.parametrize("kind", ["socket", "plane"])
def test_contact_recovers_a_robot_and_its_places(kind, tmp_path):
    """The robot touches places that are 3 mm from where the first guess has them; only joint values are given."""
    plain = plain_model()
    # contact has no pose or visit draws to be simulated beside
    model = pp.ErrorModel(plain.chain, pp.Space(), [*plain.sources[:4], *plain.sources[7:]], plain.poses)
    if kind == "socket":
        key, place = "sockets", ((0.9, 0.2, 0.8), (0.2, 0.9, 1.0))
        guess = tuple((a + 3e-3, b, c) for a, b, c in place)
    else:
        key, place = "plane", ((0.0, 0.0, 0.5), (0.1, -0.2, 1.0))
        guess = ((0.0, 0.0, 0.503), place[1])
    at = pp.Measurement(kind, std=20e-6, target=OFF_AXIS, **{key: place})
    x = model.space.sample(3, 0, 1)[:, 0]
    noise = np.random.default_rng(1).normal(0, at.std, (20, at.size))
    q = touched(model, at, x, noise)
    free = pp.Measurement(kind, std=20e-6, target=OFF_AXIS, base="free", **{key: guess})
    header = ", ".join(f"{name} [rad]" for name in model.chain.joint_names)
    np.savetxt(tmp_path / "touched.csv", q.T, "%.15g", delimiter=", ", header=header, comments="")
    found = pp.calibrate(model, tmp_path / "touched.csv" if kind == "plane" else (q, None), free)
    assert found.verdict == "agrees"
    check_truth(model, found, 3)
    if kind == "socket":
        errors = (found.set_up.sockets - np.array(place)).ravel()
        assert (np.abs(errors) < 5 * np.array([found.set_up.std[name] for name in free.nuisances])).all()
    else:
        point, normal = found.set_up.plane
        wanted = np.array(place[1]) / np.linalg.norm(place[1])
        tilts = np.hypot(found.set_up.std["plane.tilt1"], found.set_up.std["plane.tilt2"])
        assert np.linalg.norm(np.cross(normal, wanted)) < 5 * tilts
        assert abs(wanted @ (point - place[0])) < 5e-3


@pytest.mark.slow
def test_two_sockets_a_known_distance_apart_tell_the_scale():
    """A warm arm that touches them: the scale's deviation in closed form, the turn about their line not seen, nor needed."""
    places = np.array([(0.9, 0.2, 0.8), (0.2, 0.9, 1.0)])
    between = np.linalg.norm(places[1] - places[0])
    along, std, prior = (places[1] - places[0]) / between, 20e-6, 50.0
    warm = pp.sources.Thermal(expansion=2e-5, temperature_change=pp.Normal(prior))
    model = pp.ErrorModel(paper_model().chain, pp.Space(), [warm])
    # the target is the tip: all that the arm is long grows alike
    at, gauge = (
        pp.Measurement("socket", std=std, sockets=tuple(map(tuple, places))),
        pp.Measurement(std=std, base="free"),
    )
    noise = np.random.default_rng(2).normal(0, std, (12, 3))
    hot = np.array([40.0])
    q, nominal = touched(model, at, hot, noise), touched(model, at, np.zeros(1), 0 * noise)
    number = (np.linalg.norm(model.chain.at_columns(q).pose[:3, 3].T[:, None] - places, axis=2).argmin(axis=1))[:, None]

    def left(first, second):
        return (2e-5**2 * between**2 / std**2 * first * second / (first + second) + prior**-2) ** -0.5

    # in the gauge's own axes, and in others
    flat, turn = number * between * np.array([[0, 1, 0]]), Rotation.from_rotvec([0.4, -1.0, 2.0])
    results = [pp.calibrate(model, (q, one), gauge) for one in (flat, turn.apply(flat) + np.ones(3))]
    wanted = np.concatenate([np.cross(places[0], along), along])
    wanted /= np.linalg.norm(wanted)
    counts = int((number == 0).sum()), int(number.sum())
    for found in results:
        name = found.posterior.names[0]
        assert found.posterior.std[name] == pytest.approx(left(*counts), rel=2e-3)
        assert abs(found.posterior.mean[name] - 40) < 4 * left(*counts)
        assert found.posterior.mean[name] == pytest.approx(results[0].posterior.mean[name], rel=1e-6)
        assert (found.verdict, found.degrees_of_freedom) == ("agrees", 36 - 5)
        assert found.improvement.verdict == "helps"
        assert found.identifiability.nuisance_rank == 5
        np.testing.assert_allclose(found.identifiability.set_up_projector, np.outer(wanted, wanted), atol=3e-3)
        assert np.isinf([found.set_up.std[name] for name in gauge.nuisances[3:]]).all()
        (said,) = [one.message for one in found.findings if one.code == "W_SETUP"]
        words = said.partition("about the line through ")[2].partition(", which")[0].replace("mm along", "").split()
        point, direction = np.array(words, dtype=float).reshape(2, 3)
        assert abs(abs(direction @ along) - 1) < 1e-4
        assert np.linalg.norm(np.cross(point / 1e3 - places[0], along)) < 3e-3
    # before anything is measured
    forecast = pp.forecast_calibration(model, nominal, gauge)
    assert forecast.posterior.std[name] == pytest.approx(left(*counts), rel=1e-6)
    np.testing.assert_allclose(forecast.identifiability.set_up_projector, np.outer(wanted, wanted), atol=1e-6)
    plan = pp.plan_calibration(model, nominal, 4, gauge, criterion="D")
    assert number[list(plan.chosen)].sum() == 2  # each as often, where nothing else is to be found
    one_place = pp.identifiability(model, nominal[:, number[:, 0] == 0], gauge)
    assert (one_place.nuisance_rank, one_place.rank) == (3, 0)
    (group,) = one_place.set_up_combinations
    assert (group.determined, group.names) == (3, gauge.nuisances)


def test_intervals_of_normal_numbers_are_those_of_the_posterior():
    found = plain_fit()
    for name in found.posterior.names:
        expected = stats.norm(found.posterior.mean[name], found.posterior.std[name]).ppf([0.1, 0.9])
        assert found.interval(name, 0.8) == pytest.approx(expected, rel=1e-6, abs=1e-12)
    check_refused(("probability must be between 0 and 1, got 95", found.interval, found.posterior.names[0], 95))
    with pytest.raises(UnknownNameError):
        found.interval("joint_offset")


def test_intervals_of_bounded_laws_hold_the_truth():
    """All 26 numbers of the paper's arm, uniform and in discs, from a third to all of them learned: 94.1 to 95.9 %."""
    model, q, robots = paper_model(), random_poses(4, 10), 300
    forecast = pp.forecast_calibration(model, q, TRACKER)
    found = simulate_calibrations(model, q, TRACKER, robots=robots, seed=5)
    laws = {name: (draw.law, k) for draw in model.space.draws for k, name in enumerate(draw.components)}
    inside = np.zeros((len(forecast.posterior.names), robots), dtype=bool)
    for row, name in enumerate(forecast.posterior.names):
        mean, std = forecast.posterior.prior_mean[name], forecast.posterior.prior_std[name]
        left = 1 - forecast.posterior.learned[name]
        for unit in range(robots):
            estimate, truth = (mean + std * each[row, unit] for each in (found.estimates, found.truth))
            low, high = interval_after(*laws[name], estimate, std, left, 0.95)
            inside[row, unit] = low <= truth <= high
    assert 0.941 < inside.mean() < 0.959
    # of one number by itself: within 4 standard deviations of 300 robots
    np.testing.assert_allclose(inside.mean(axis=1), 0.95, atol=4 * (0.95 * 0.05 / robots) ** 0.5)


ARM, TIP = resolve_robot("example:so101"), "gripper_frame_link"


@pytest.mark.parametrize(("signs", "base"), [((1, 1, 1, 1, 1), "free"), ((1, -1, -1, 1, -1), "known")])
def test_reversed_joints_of_a_printed_arm_are_named(signs, base):
    """The places of a ball by Pinocchio, 1 mm of noise."""
    zeros, chain, rng = np.radians([-12, 17, 8, -20, 14]), pp.Chain.from_urdf(ARM, TIP), np.random.default_rng(3)
    read, places = np.radians(rng.uniform(-45, 45, (5, 12))), []
    robot = pin.buildModelFromUrdf(str(ARM))
    data, frame = robot.createData(), robot.getFrameId(TIP)
    for values in (np.array(signs)[:, None] * read + zeros[:, None]).T:
        pin.framesForwardKinematics(robot, data, np.append(values, 0.0))  # the gripper's joint is the last
        places.append(data.oMf[frame].act(np.array([0.02, 0.0, 0.0])) + rng.normal(0, 1e-3, 3))
    if base == "free":
        places = np.array(places) @ np.array(pin.exp3(np.array([0.2, -0.1, 1.0]))).T + [0.5, -0.2, 0.1]
    model = pp.ErrorModel(chain, pp.Space(), [JointOffset(joint=name, offset=WIDE) for name in chain.joint_names])
    given = pp.Measurement("position", std="1 mm", target="20 0 0 mm", base=base)
    data = read_data(model, (read, np.array(places)), (given,))
    wrong = " and ".join(name for name, sign in zip(chain.joint_names, signs, strict=True) if sign < 0)
    if wrong:
        said = rf"E_REVERSED: {wrong}: readings fit far better .*\(residuals [12]\.\d+ mm rms instead of \d\d"
        check_refused((said, check_directions, chain, data, given))
        return
    found = check_directions(chain, data, given)
    assert found.rms < 2e-3
    # the zero of the first joint is the turn of a free base, too
    assert np.abs(found.values - zeros)[1:].max() < np.radians(3)


def test_only_estimates_one_kind_and_leaves_the_rest_where_it_is():
    """Zeros of two joints, by the closed form of the tip's points; lengths keep their tolerance."""
    chain = stretched(2)
    zeros = np.radians([15.0, -20.0])
    read = np.radians([[-60.0, -20, 10, 40, 80], [30.0, -40, 60, 10, -70]])
    first, second = (read + zeros[:, None])[0], (read + zeros[:, None]).sum(axis=0)
    places = 0.7 * np.array([np.cos(first), np.sin(first), 0 * first]).T
    places += 0.4 * np.array([np.cos(second), np.sin(second), 0 * first]).T
    sources = [
        *(JointOffset(joint=name, offset=WIDE) for name in chain.joint_names),
        Length(joint="joint2", along="x of joint1", parameters=(pp.Uniform(0.1e-3),)),
        AxisInstall(joint="joint1", radius=0.1e-3, span=0.1),
    ]
    model = pp.ErrorModel(chain, pp.Space(), sources)
    given = pp.Measurement("position", std="0.1 mm")
    arm = pp.calibrate(model, (read, places), given, only=["joint_offset"], at=[[0.0, 1.0]])
    names = ("joint_offset[joint1].offset", "joint_offset[joint2].offset")
    assert arm.posterior.names == names
    assert [arm.posterior.mean[name] for name in names] == pytest.approx(zeros, abs=1e-6)
    assert "W_ONLY" in [finding.code for finding in arm.findings]
    spaces = (model.space, arm.model.space)
    before, after = (dict(zip(one.components, one.block_covariance.variances, strict=True)) for one in spaces)
    assert all((after[name] < 1e-6) if name in names else (after[name] == before[name]) for name in before)
    unknown = "no kind of source named 'joint_ofset'; did you mean 'joint_offset'"
    check_refused((unknown, pp.calibrate, model, (read, places), given), only=["joint_ofset"])
    narrow = pp.ErrorModel(chain, pp.Space(), [JointOffset(joint="joint1", offset=pp.Normal(1e-4))])
    expected = r"E_DATA.*zeros of the joints alone would explain them to .*joint2 -20°, joint1 \+15°.*wide tolerances"
    check_refused((expected, pp.calibrate, narrow, (read, places), given))


@pytest.mark.parametrize(("std", "scatter"), [(20e-6, 60e-6), (1e-6, 0.0)])
def test_a_fit_whose_steps_end_in_rounding_settles(tmp_path, std, scatter):
    """All geometry of a UR5 free, and readings that it does not explain, or those of an interferometer."""
    path = tmp_path / "arm.errors.yaml"
    path.write_text(pp.init("example:ur5", tip="tool0", calibration=True), encoding="utf-8")
    model, free = pp.ErrorModel.load(path), pp.Measurement(std=std, base="free", target_known=False)
    q, rng = np.random.default_rng(0).uniform(-2, 2, (6, 40)), np.random.default_rng(1)
    readings = readings_of(model, q, free, seed=0) @ MOVED[:3, :3].T + MOVED[:3, 3]
    found = pp.calibrate(model, (q, readings + rng.normal(0, scatter, (40, 3))), free)
    assert found.steps < 20
    assert scatter or (found.verdict == "agrees" and not found.causes)


def test_a_map_shows_what_was_found_and_what_is_left():
    """Over a plane: the arm as predicted, and the size that 95 % of robots of the arm that is left keep, by samples."""
    found, spread = plain_fit(), random_poses(4, 5, seed=8)
    poses = PoseSet.at(found.original.chain, np.column_stack([spread, spread[:, 0]]))
    poses = replace(poses, q=np.column_stack([spread, np.full(4, np.nan)]))
    left = RemainingError.of(found, poses)
    x = found.model.space.sample(seed=0, first=0, count=20_000)
    for k, q in enumerate(spread.T):
        nominal = found.original.chain.at(q).pose[:3, 3]
        np.testing.assert_allclose(left.found[:, k], found.predict(q)[:3, 3] - nominal, atol=1e-12)
        errors = found.model.at(q).linear(x)[:3]
        sizes = np.linalg.norm(errors - errors.mean(axis=1, keepdims=True), axis=0)
        assert left.quantile[k] == pytest.approx(np.quantile(sizes, 0.95), rel=0.03)
    assert np.isnan(left.quantile[5])
    assert left.read.shape == left.left_out.shape == (3, len(found.data))
    np.testing.assert_array_equal(left.left_out.T, found.left_out[:, :3])
    text = str(left)
    assert f"{1e3 * np.nanmin(left.quantile):.3g} to {1e3 * np.nanmax(left.quantile):.3g} mm" in text
    # in space, along a line, over a plane whose poses that were read have crosses
    corners = np.array([[0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 0.0]])
    turned = PoseSet.at(found.original.chain, np.array([[0, 0.5, 1, 1.5], [0] * 4, [0] * 4, [0.0] * 4]))
    for places in (poses, replace(turned, position=corners * [[1], [0], [0]]), replace(turned, position=corners)):
        drawn = remaining_figure(found, RemainingError.of(found, replace(places, node=np.arange(len(places)))))
        names = [axes.get_title() for axes in drawn.axes[:2]]
        assert names == ["found in the nominal arm, and corrected", "left by the calibration"]
    assert len(drawn.axes[1].lines[0].get_xdata()) == len(found.data)
    # of many readings points, and arrows of the largest errors
    sizes = np.random.default_rng(9).permutation(130) * 1e-6
    many = replace(RemainingError.of(found, replace(places, node=np.arange(4))), read=np.zeros((3, 130)))
    drawn = remaining_figure(found, replace(many, left_out=np.outer([1, 0, 0], sizes)))
    (arrows,) = (one for one in drawn.axes[1].collections if isinstance(one, Quiver))
    assert drawn.axes[1].lines[0].get_marker() == "."
    np.testing.assert_allclose(np.sort(arrows.U), 1e-6 * np.arange(30, 130))
    assert "the 100 largest of readings less" in " ".join(drawn.legends[0].get_title().get_text().split())
