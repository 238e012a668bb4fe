"""Calibration and datums: readings are in base axes whatever the sheet counts against, and leave a frame behind."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.arms import offsets, plain_model, random_poses, readings_of
from precision_pin.analyses.calibration.calibrated_sheet import (
    MOST_POSES,
    calibrated_sheet,
    measured_frame,
    result_name,
)
from precision_pin.analyses.calibration.datum_plan import plan_datum
from precision_pin.analyses.calibration.table import frame_lines
from precision_pin.base import se3
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.writers.as_built import AsBuilt

TRACKER = pp.Measurement("position", std="20 um")
FREE = replace(TRACKER, base="free", target_known=False)
ARM = """precision-pin: 1
robot: {robot}
tip: tool
poses: {{work: 10 -20 50 15 deg, home: 0 20 30 -15 deg}}
sources:
  - joint_offset: {{joint: joint2, offset: {{normal: 1 mrad}}}}
  - joint_offset: {{joint: joint3, offset: {{normal: 1 mrad}}}}
  - frame: {{frame: base, x: {{normal: 1 mm}}, y: {{normal: 1 mm}}, rz: {{normal: 0.5 mrad}}}}
measurement: {{kind: position, std: 20 um, base: free}}
"""


def in_datum(model):
    return model.against(pp.Datum.best_fit(list(random_poses(4, 5, seed=3).T), "0.1 mm"))


def test_a_datum_changes_no_reading_no_fit_and_no_written_robot(tmp_path):
    bare, model = plain_model(), in_datum(plain_model())
    q = random_poses(4, 14)
    readings = [pp.simulate(arm, q, TRACKER, unit=2, seed=5).values for arm in (bare, model)]
    assert np.array_equal(*readings)
    fits = [pp.calibrate(arm, (q, readings[0]), TRACKER) for arm in (bare, model)]
    assert fits[0].posterior.mean == fits[1].posterior.mean
    assert np.array_equal(fits[0].poses[0].covariance_after, fits[1].poses[0].covariance_after)
    # the arm that is left is counted against the datum again
    assert [len(fit.model.datums) for fit in fits] == [0, 1]
    assert np.allclose(fits[1].model.bare.at("work").covariance, fits[0].model.at("work").covariance, atol=1e-18)
    assert pp.identifiability(bare, q, TRACKER).names == pp.identifiability(model, q, TRACKER).names
    forecasts = [pp.forecast_calibration(arm, q, TRACKER).rms("after") for arm in (bare, model)]
    assert forecasts[0] == forecasts[1]
    choices = [pp.plan_calibration(arm, q, 5, TRACKER).chosen for arm in (bare, model)]
    assert choices[0] == choices[1]
    robots = [(q, readings[0]), (q, pp.simulate(bare, q, TRACKER, unit=3).values)]
    scales = [[one.scale for one in pp.population(arm, robots, TRACKER).tolerances] for arm in (bare, model)]
    assert scales[0] == scales[1]
    written = [fit.to_urdf(tmp_path / f"{k}.urdf") for k, fit in enumerate(fits)]
    assert written[0] == written[1]
    assert (tmp_path / "0.urdf").read_bytes() == (tmp_path / "1.urdf").read_bytes()
    units = [next(AsBuilt.prepare(arm, "work").units(0, 0, 1)).error for arm in (bare, model)]
    assert np.array_equal(*units)


@pytest.fixture
def sheet(tmp_path):
    """Return the path of a sheet of an arm whose base is not known well."""
    (tmp_path / "arm.errors.yaml").write_text(ARM.format(robot=PAPER_SHEET.parent / "4dof.urdf"))
    return tmp_path / "arm.errors.yaml"


def calibrated(sheet, name, count=24, measurement=None):
    """Return the calibration of a robot by a sheet, and its model as from the sheet that is written."""
    model = pp.ErrorModel.load(sheet)
    q = random_poses(4, count)
    result = pp.calibrate(model, (q, pp.simulate(model, q, measurement, unit=4).values), measurement)
    (sheet.parent / result_name(name)).write_text(result.to_json())
    (sheet.parent / name).write_text(calibrated_sheet(str(sheet), str(sheet.parent / name), measured_frame(result)))
    return result, pp.ErrorModel.load(sheet.parent / name)


@pytest.mark.parametrize("count", [24, 120])
def test_errors_in_the_frame_of_the_readings_are_those_seen(sheet, count):
    result, model = calibrated(sheet, "left.yaml", count)
    assert [datum.name for datum in model.datums] == ["measured"]
    assert len(model.datums[0].poses) == min(count, MOST_POSES)
    # written with six digits
    assert model.datums[0].std == pytest.approx(20e-6 * min(MOST_POSES / count, 1.0) ** 0.5, rel=5e-6)
    for entry in result.poses:
        seen, base = model.at(entry.name), model.bare.at(entry.name)
        largest = np.abs(entry.covariance_seen[:3, :3]).max()
        tolerance = (0.01 if count <= MOST_POSES else 0.25) * largest
        assert np.allclose(seen.covariance[:3, :3], entry.covariance_seen[:3, :3], rtol=0, atol=tolerance)
        assert np.trace(base.covariance[:3, :3]) == pytest.approx(entry.rms("after") ** 2, rel=0.01)
        assert entry.rms("after") > 10 * entry.rms("seen")
    (line,) = frame_lines(result)
    worst = max(result.poses, key=lambda entry: entry.quantile("after"))
    assert f"{1e3 * worst.quantile('after'):.2g}"[:4] in line
    assert f"{1e3 * worst.quantile('seen'):.2g}"[:4] in line


def test_what_is_seen_of_an_unknown_target_is_what_a_reading_there_would_be_off():
    """Beside the instrument; and of robots with the truth, in axes of the instrument. The flange is far less known."""
    model, q, squares = offsets(pp.Normal(1e-3)), random_poses(4, 25), []
    far = replace(FREE, target=(0.2, 0.03, 0.1))
    for seed in range(40):
        fit = pp.calibrate(
            model, (q, readings_of(model, q, far, seed)), replace(far, target=(0.19, 0.04, 0.1)), at=q[:, :3]
        )
        robot = model.space.sample(seed, 0, 1)
        for at, entry in zip(model.at_columns(q[:, :3]), fit.poses, strict=True):
            real = se3.displaced(at.posture.pose, at.exact(robot)[:, 0])
            found = fit.set_up.base @ fit.predict(at.posture.q)
            off = (found @ [*fit.set_up.target, 1] - real @ [*far.target, 1])[:3]
            squares.append(off @ np.linalg.solve(entry.covariance_seen[:3, :3], off))
    stds = np.array([np.diag(entry.covariance_seen)[:3] for entry in fit.poses])
    np.testing.assert_allclose(stds, fit.std_predicted[:3] ** 2 - far.std**2, rtol=1e-6)
    assert all(entry.rms("after") > 3 * entry.rms("seen") for entry in fit.poses)
    # 40 independent means of three: chi-square of three each, with a standard deviation of at most 0.39
    assert np.mean(squares) == pytest.approx(3, abs=1.2)


@pytest.mark.parametrize("known", [True, False])
def test_the_frame_is_that_of_the_target_that_was_read(sheet, known):
    target = np.array([0.2, 0.3, 0.1])
    reflector = pp.Measurement("position", std="20 um", target=target, target_known=known, base="free")
    result, model = calibrated(sheet, "left.yaml", measurement=reflector)
    chain, places = model.chain, result.set_up.base
    fitted = result.set_up.target
    assert np.allclose(fitted, target, atol=0 if known else 1e-4)
    nominal = np.array([chain.at(q).pose[:3] @ [*fitted, 1.0] for q in result.data.q.T])
    readings = result.data.readings
    turn, _ = Rotation.align_vectors(nominal - nominal.mean(axis=0), readings - readings.mean(axis=0))
    for name in ("work", "home"):
        # where the calibrated arm goes, as the instrument sees it, in the frame that fits all its readings
        tip = places[:3] @ result.predict(name)[:, 3]
        there = turn.apply(tip - readings.mean(axis=0)) + nominal.mean(axis=0) - chain.at(model.poses[name]).pose[:3, 3]
        assert np.allclose(model.at(name).error_at_means[:3], there, rtol=0, atol=3e-6)
    by_tip = model.against(replace(model.datums[0], point=None))
    assert np.linalg.norm((by_tip.at("work").error_at_means - model.at("work").error_at_means)[:3]) > 2e-5


def test_a_frame_is_replaced_and_a_datum_of_the_sheet_stays(sheet):
    own = "datums:\n    # by hand\n    cell: {taught: {pose: home}}\ndatum: cell\n"
    sheet.write_text(sheet.read_text() + own)
    for number in range(2):
        _, model = calibrated(sheet, f"left{number}.yaml", 8 + number)
        assert sorted(model.sheet.datums) == ["cell", "measured"]
        assert [datum.name for datum in model.datums] == ["cell"]
        assert len(model.sheet.datums["measured"].poses) == 8 + number
        sheet = sheet.parent / f"left{number}.yaml"
        sheet.write_text(re.sub("^calibrated: .*", "", sheet.read_text(), flags=re.MULTILINE))


def test_a_known_base_leaves_no_frame():
    model = plain_model()
    q = random_poses(4, 8)
    result = pp.calibrate(model, (q, readings_of(model, q, TRACKER)), TRACKER)
    assert measured_frame(result) is None
    assert frame_lines(result) == []


# poses at which to find a datum ---------------------------------------------------------------------------------------


def deviation(model, datum, tasks=("work",)):
    """Return the rms deviation of the position at the tasks by the model in a datum."""
    arm = model.against(datum)
    return np.sqrt(np.mean([np.trace(arm.at(task).covariance[:3, :3]) for task in tasks]))


def best_fit(q):
    return pp.Datum.best_fit(list(q.T), "0.05 mm")


def eye_to_hand(q):
    camera, board, grasp = (np.eye(4) for _ in range(3))
    camera[:3, 3], board[:3, 3], grasp[:3, 3] = (0.5, 0.2, 1.0), (0.02, 0.01, 0.1), (0.05, 0.0, 0.02)
    return pp.Datum.eye_to_hand(list(q.T), camera=camera, board=board, grasp=grasp, on="tool", noise=(5e-5, 2e-4))


def hand_eye(q):
    camera, board, grasp = (np.eye(4) for _ in range(3))
    camera[:3, 3], board[:3, 3], grasp[:3, 3] = (0.02, 0.01, 0.1), (0.5, 0.2, 1.0), (0.05, 0.0, 0.02)
    views = {"camera": camera, "board": board, "grasp": grasp}
    return pp.Datum.hand_eye(list(q.T), "home", on="tool", noise=(5e-5, 2e-4), **views)


@pytest.mark.parametrize("made", [best_fit, eye_to_hand, hand_eye])
def test_the_poses_of_a_datum_are_the_best_of_all_choices(made):
    model, q = plain_model(), random_poses(4, 7, seed=2)
    plan = plan_datum(model, made(q), 3, at=["work"])
    assert plan.rms_position["chosen"] == pytest.approx(deviation(model, made(q[:, list(plan.chosen)])), rel=1e-9)
    assert plan.rms_position["all"] == pytest.approx(deviation(model, made(q)), rel=1e-9)
    all_choices = [deviation(model, made(q[:, list(choice)])) for choice in itertools.combinations(range(7), 3)]
    assert plan.rms_position["chosen"] <= 1.001 * min(all_choices)
    assert plan.rms_position["chosen"] < plan.rms_position["random"]


def test_a_datum_without_a_number_of_poses_has_no_plan():
    with pytest.raises(pp.InputError, match="a taught has no number of poses to choose; plan a best_fit, tool_pivot"):
        plan_datum(plain_model(), pp.Datum.taught("home"), 3)
    with pytest.raises(pp.InputError, match="from 3 to 5, the number of candidates"):
        plan_datum(plain_model(), best_fit(random_poses(4, 5)), 6)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
@pytest.mark.parametrize("loads", [True, False])
def test_a_urdf_of_a_loaded_arm_is_as_far_from_it_as_is_said(tmp_path, loads):
    model = pp.ErrorModel.load(PAPER_SHEET)
    poses = pp.random_poses(model.chain, 30, seed=4).q
    result = pp.calibrate(model, (poses, readings_of(model, poses, TRACKER)), TRACKER)
    result.to_urdf(tmp_path / "arm.urdf", loads=loads)
    written = pp.Chain.from_urdf(tmp_path / "arm.urdf", base=model.chain.base, tip=model.chain.tip)
    others = pp.random_poses(model.chain, 100).q
    x = result.components[:, None]
    apart = [
        written.at(q).pose[:3, 3] - at.posture.pose[:3, 3] - at.exact(x)[:3, 0]
        for q, at in zip(others.T, result.original.at_columns(others), strict=True)
    ]
    said = result.urdf_error(loads=loads)
    assert said == pytest.approx(np.sqrt((np.array(apart) ** 2).sum(axis=1).mean()), rel=1e-6)
    assert said > 1e-4  # the weight bends the arm otherwise at other poses
