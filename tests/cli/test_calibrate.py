"""``calibrate``: forecast, fit, files, and what is refused in one line."""

from __future__ import annotations

import json
import math

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares

import precision_pin as pp
from precision_pin.analyses.calibration.design import stations_of
from precision_pin.analyses.calibration.forecast import simulate_readings
from precision_pin.base.errors import PrecisionPinWarning

SHEET = "4dof.errors.yaml"
TARGET = ("--point", "50 30 20 mm")
JOINTS = "joint1 [deg], joint2 [deg], joint3 [deg], joint4 [deg]"


@pytest.fixture
def rows(folder) -> np.ndarray:
    """Return readings of a simulated robot: degrees and millimetres."""
    model = pp.ErrorModel.load(folder / SHEET)
    q = np.random.default_rng(0).uniform(-2, 2, (4, 10))
    measurement = pp.Measurement(target=(0.05, 0.03, 0.02))
    readings = simulate_readings(stations_of(model, q, measurement), measurement, model, seed=1)[:, :, 0]
    return np.hstack([np.degrees(q.T), 1e3 * readings])


def write(folder, rows: np.ndarray, header: str = f"{JOINTS}, x [mm], y [mm], z [mm]") -> str:
    np.savetxt(folder / "data.csv", rows, "%.7f", delimiter=", ", header=header, comments="")
    return "data.csv"


@pytest.mark.slow
def test_forecast_begins_with_the_answer_and_is_100_columns_wide(run, folder) -> None:
    found = run("calibrate", SHEET, "--forecast", "--random", "8", *TARGET, "--base-free", "--json", "f.json")
    assert found.code == 0
    first = found.out.splitlines()[0]
    assert first.startswith("calibrating 4dof.urdf, base to tool: rms position error 36.9 mm before, ")
    assert max(map(len, found.out.splitlines())) <= 100
    assert (folder / "f.json").read_text().startswith('{\n  "schema": "precision-pin/calibration-forecast/1"')


@pytest.mark.slow
def test_a_plan_begins_with_what_it_buys_and_is_the_forecast_of_its_poses(run, folder) -> None:
    found = run("calibrate", SHEET, "--plan", "6", "--random", "20", *TARGET, "--json", "p.json", "--out", "plots")
    assert found.code == 0
    first = found.out.splitlines()[0]
    assert first.startswith("measure 6 of 20 poses of 4dof.urdf, base to tool: rms position error 36.9 mm before, ")
    assert max(map(len, found.out.splitlines())) <= 100
    assert {path.name for path in (folder / "plots").iterdir()} == {
        f"calibration-plan.{end}" for end in ("json", "png", "svg")
    }
    plan = json.loads((folder / "p.json").read_text())
    assert plan["schema"] == "precision-pin/calibration-plan/1"
    chosen = [
        text for one in plan["chosen"] for text in ("--q", " ".join(f"{x:.17g}" for x in one["q"].values()) + " rad")
    ]
    forecast = run("calibrate", SHEET, "--forecast", *chosen, *TARGET, "--json", "-").json
    assert forecast["rms_position"]["after"] == pytest.approx(plan["rms_position"]["after"], rel=1e-9)


@pytest.mark.slow
def test_a_fit_writes_what_is_asked_for(run, folder, rows) -> None:
    data = write(folder, rows)
    found = run("calibrate", SHEET, data, *TARGET, "--urdf", "new.urdf", "--out", "plots", "--json", "c.json")
    assert found.code == 0
    assert found.out.startswith("4dof.urdf, base to tool: the calibration helps: left-out error ")
    assert "the model explains the readings" in found.out
    assert max(map(len, found.out.splitlines())) <= 100
    assert sorted(path.name for path in (folder / "plots").iterdir()) == [
        "calibration.json",
        "calibration.png",
        "calibration.svg",
    ]
    assert (folder / "new.urdf").read_text().startswith("<?xml")


@pytest.mark.slow
def test_other_commands_run_on_the_calibrated_sheet(run, folder, rows) -> None:
    data = write(folder, rows)
    found = run("calibrate", SHEET, data, *TARGET, "--sheet", "new.errors.yaml", "--json", "-")
    assert found.code == 0
    after = found.json["poses"][0]["after"]["rms_position"]
    assert (folder / "new.calibration.json").read_text() == found.out
    moments = pp.ErrorModel.load(folder / "new.errors.yaml").at("paper")
    covariance = moments.jacobian @ moments.space.covariance @ moments.jacobian.T
    # slopes are taken at the means before the calibration in one, after it in the other
    assert np.sqrt(np.trace(covariance[:3, :3])) == pytest.approx(after, rel=1e-3)
    assert run("compensate", "new.errors.yaml").code == 0
    (folder / "plots").mkdir()
    # a second calibration takes the place of the first
    again = run("calibrate", "new.errors.yaml", data, *TARGET, "--sheet", "plots/again.errors.yaml")
    assert again.code == 0
    assert (folder / "plots" / "again.errors.yaml").read_text().count("calibrated:") == 1
    assert run("check", "plots/again.errors.yaml").code == 0


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("nowhere.json", "calibrated: nowhere.json does not exist"),
        ("data.csv", "calibrated: data.csv is not JSON"),
        ("other.json", "calibrated: other.json is no result of calibrate"),
        ("part.json", "the estimates in part.json are not complete"),
        ("stranger.json", "no component named 'nonsense'"),
    ],
)
def test_a_wrong_calibration_is_refused_at_its_line(run, folder, rows, value, message) -> None:
    write(folder, rows)
    schema = "precision-pin/calibration/1"
    (folder / "other.json").write_text("[1]")
    (folder / "part.json").write_text(json.dumps({"schema": schema, "posterior": {"names": ["a0"], "mean": {}}}))
    estimates = {"names": ["nonsense"], "mean": {"nonsense": 0.0}, "covariance": [[1.0]]}
    (folder / "stranger.json").write_text(json.dumps({"schema": schema, "posterior": estimates}))
    text = (folder / SHEET).read_text() + f"calibrated: {value}\n"
    (folder / "new.errors.yaml").write_text(text)
    found = run("check", "new.errors.yaml")
    assert found.code == 2
    line = (found.out + found.err).strip()
    assert line.startswith(f"new.errors.yaml:{len(text.splitlines())}: error ")
    assert message in line
    assert len(line.splitlines()) == 1


QUICK_SHEET = """precision-pin: 1
robot: 4dof.urdf
tip: tool
poses: {home: 0 0 0 0 deg}
sources:
  - joint_offset: {joint: joint2, offset: {normal: 1 mrad}}
  - joint_offset: {joint: joint3, offset: {normal: 1 mrad}}
"""
INSTRUMENT = "measurement: {kind: position, std: 20 um, target: 50 30 20 mm}\n"


@pytest.fixture
def quick(folder) -> str:
    """Return the name of a sheet that is fitted quickly, beside readings of its arm, data.csv."""
    (folder / "quick.errors.yaml").write_text(QUICK_SHEET + INSTRUMENT)
    model = pp.ErrorModel.load(folder / "quick.errors.yaml")
    q = np.random.default_rng(0).uniform(-2, 2, (4, 8))
    readings = simulate_readings(stations_of(model, q, model.sheet.measurement), model.sheet.measurement, model, seed=1)
    write(folder, np.hstack([np.degrees(q.T), 1e3 * readings[:, :, 0]]))
    return "quick.errors.yaml"


def test_a_tolerance_edited_in_the_text_of_a_calibrated_sheet_is_said(run, folder, quick) -> None:
    assert run("calibrate", quick, "data.csv", "--sheet", "mine.errors.yaml").code == 0
    assert "W_TEXT_MEASURED" not in run("check", "mine.errors.yaml").err
    text = (folder / "mine.errors.yaml").read_text()
    (folder / "mine.errors.yaml").write_text(
        text.replace("joint3, offset: {normal: 1 mrad}", "joint3, offset: {normal: 6 mrad}")
    )
    said = run("analyze", "mine.errors.yaml", "--samples", "500", "--json", "-")
    (line,) = [line for line in said.err.splitlines() if "W_TEXT_MEASURED" in line]
    # a tolerance is 3 sigma
    assert "joint_offset[joint3].offset 0 ± 0.002, then 0 ± 0.00033;" in line
    assert "joint2" not in line
    # what was measured counts: the spread is that of the calibrated arm
    with pytest.warns(PrecisionPinWarning, match="W_TEXT_MEASURED"):
        model = pp.ErrorModel.load(folder / "mine.errors.yaml")
    assert np.sqrt(model.space.block_covariance.variances).max() < 0.1e-3
    # a second calibration has the measured arm as its prior, and the text as it is now
    assert run("calibrate", "mine.errors.yaml", "data.csv", "--sheet", "again.errors.yaml").code == 0
    assert "W_TEXT_MEASURED" not in run("check", "again.errors.yaml").err


def test_a_calibrated_sheet_is_not_written_of_another_arm_than_its_own(run, folder, quick) -> None:
    found = run("calibrate", quick, "data.csv", "--tip", "link4", "--sheet", "mine.errors.yaml")
    assert (found.code, found.out) == (2, "")
    assert found.err.strip() == (
        "precision-pin: error E_INPUT: --sheet writes the sheet as it is in its file; write the robot, tip and base of the "
        "options there first"
    )
    assert not [path.name for path in folder.iterdir() if path.name.startswith("mine")]


@pytest.mark.slow
def test_a_page_shows_the_fit_of_the_command(run, folder, quick) -> None:
    found = run("calibrate", quick, "data.csv", "--json", "-").json
    made = run("view", quick, "--samples", "20", "--calibrate", "data.csv", "--out", "page.html")
    assert made.code == 0
    assert [line for line in made.err_lines if "W_NO_REPEATABILITY" in line]
    rms = {name: f"{1e3 * value:.3g}" for name, value in found["rms_residual"].items()}
    said = f"Residuals: {rms['before']} mm rms before, {rms['after']} mm after"
    assert said in (folder / "page.html").read_text("utf-8")


def test_a_served_page_follows_the_readings(run, folder, quick, monkeypatch) -> None:
    watched = []
    monkeypatch.setattr("precision_pin.pages.view.live.serve", lambda _, files, **_options: watched.extend(files))
    assert run("view", quick, "--calibrate", "data.csv").code == 0
    assert "data.csv" in [path.name for path in watched]


@pytest.mark.slow
def test_a_report_has_a_section_about_the_fit(run, folder, quick) -> None:
    found = run("calibrate", quick, "data.csv", "--json", "-").json
    made = run("report", quick, "--samples", "200", "--calibrate", "data.csv", "--out", "page.html")
    assert made.code == 0
    assert made.err_lines.index(next(line for line in made.err_lines if "calibration" in line)) < made.err_lines.index(
        next(line for line in made.err_lines if "sampling" in line)
    )
    page = (folder / "page.html").read_text("utf-8")
    assert 'href="#calibration"' in page
    assert "--calibrate data.csv" in page
    assert f"Residuals: {1e3 * found['rms_residual']['before']:.3g} mm rms before" in page


@pytest.mark.slow
@pytest.mark.parametrize("command", ["view", "report"])
def test_a_page_refuses_readings_before_anything_long_begins(
    run, folder, quick, contents, monkeypatch, command
) -> None:
    def sampled(*_: object) -> None:
        raise AssertionError("sampling began")

    monkeypatch.setattr(f"precision_pin.cli.{command}.compile_sampler", sampled)
    (folder / "plain.errors.yaml").write_text(QUICK_SHEET)
    header, *lines = (folder / "data.csv").read_text().splitlines()
    (folder / "swapped.csv").write_text("\n".join([header.replace("x [", "w [").replace("y [", "x ["), *lines]))
    far = [",".join([*line.split(",")[:4], *line.split(",")[:3:-1]]) for line in lines]
    (folder / "far.csv").write_text("\n".join([header, *far]))
    (folder / "data.html").write_text((folder / "data.csv").read_text())
    before = contents()
    for sheet, data, out, message in (
        (quick, "nosuch.csv", "page.html", "nosuch.csv"),
        (
            "plain.errors.yaml",
            "data.csv",
            "page.html",
            "plain.errors.yaml: error E_MISSING_KEY: the sheet has no measurement:",
        ),
        (quick, "data.html", "data.html", "is an input"),
        (quick, "swapped.csv", "page.html", "the column 'w' is not expected"),
        (quick, "far.csv", "page.html", "columns or units are wrong"),
    ):
        refused = run(command, sheet, "--calibrate", data, "--out", out)
        assert refused.code == 2
        said = [line for line in refused.said if not line.endswith(" calibration")]
        assert len(said) == 1, refused
        assert message in said[0]
    assert contents() == before


@pytest.mark.slow
def test_units_do_not_matter(run, folder, rows) -> None:
    one = run("calibrate", SHEET, write(folder, rows), *TARGET, "--json", "-").json
    other = np.hstack([np.radians(rows[:, :4]), rows[:, 4:] / 1e3])
    header = "joint1 [rad], joint2 [rad], joint3 [rad], joint4 [rad], x [m], y [m], z [m]"
    np.savetxt(folder / "si.csv", other, "%.15g", delimiter=",", header=header, comments="")
    same = run("calibrate", SHEET, "si.csv", *TARGET, "--json", "-").json
    assert same["chi_square"] == pytest.approx(one["chi_square"], rel=1e-3)


@pytest.mark.parametrize(
    ("header", "change", "message"),
    [
        (f"{JOINTS}, x [mm], y [mm]", lambda rows: rows[:, :6], "no column for z; a position needs x, y, z"),
        (f"{JOINTS}, x [mm], y [mm], zz [mm]", lambda rows: rows, "the column 'zz' is not expected"),
        (f"{JOINTS}, x [deg], y [mm], z [mm]", lambda rows: rows, "'deg' of the column 'x' is not a unit of length"),
        (f"{JOINTS}, x, y [mm], z [mm]", lambda rows: rows, "the column 'x' has no unit"),
        (JOINTS.replace("deg", "rad") + ", x [mm], y [mm], z [mm]", lambda rows: rows, "are these degrees?"),
    ],
)
def test_wrong_data_are_refused_in_one_line(run, folder, rows, header, change, message) -> None:
    found = run("calibrate", SHEET, write(folder, change(rows), header), *TARGET)
    assert found.code == 2
    assert len(found.err.strip().splitlines()) == 1
    assert message in found.err
    assert "data.csv" in found.err


@pytest.mark.slow
def test_swapped_columns_are_noticed(run, folder, rows) -> None:
    swapped = rows[:, [0, 1, 2, 3, 5, 4, 6]]
    found = run("calibrate", SHEET, write(folder, swapped), *TARGET)
    assert found.code == 2
    assert len(found.err.strip().splitlines()) == 1
    assert "columns or units are wrong" in found.err


@pytest.mark.slow
def test_copied_rows_are_named(run, folder, rows) -> None:
    found = run("calibrate", SHEET, write(folder, np.vstack([rows, rows[3]])), *TARGET)
    assert "data.csv:12: warning W_REPEATED_READING" in found.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "nothing to do: give readings (DATA.csv), --forecast, --plan M or --factory FILE"),
        (("--population",), "at least two robots are needed"),
        (("--population", "a.csv", "b.csv", "--plan", "3"), "--population takes no --plan"),
        (("a.csv", "b.csv"), "several robots need --population"),
        (("--forecast", "--means-free"), "--means-free belongs to --population"),
        (("--factory", "x.conf", "--forecast"), "--factory takes no --forecast"),
        (("--factory", "x.conf"), "is none of UR3, UR5"),
        (("--forecast", "--plan", "3"), "--forecast and --plan exclude each other"),
        (("--plan", "3", "data.csv"), "--plan takes no data"),
        (
            ("--plan", "9", "--random", "8"),
            "the number of poses to choose must be a whole number from 1 to 8, the number of candidates",
        ),
        (("--forecast", "--criterion", "D"), "--criterion belongs to --plan"),
        (("--forecast", "data.csv"), "--forecast takes no data"),
        (("data.csv", "--random", "3"), "the measured poses are those of the data"),
        (
            ("--forecast", "--urdf", "x.urdf"),
            "--no-prior, --only, --urdf and --sheet belong to a calibration with data",
        ),
        (("--forecast", "--std", "0.1"), "--std"),
        (("--forecast", "--point", "1 2 mm"), "--point"),
        (("--forecast", "--random", "0"), "the number of random poses must be a whole number from 1 to 10000"),
        (("--forecast", "--at", "nowhere"), "nowhere"),
    ],
)
def test_wrong_options_are_refused_in_one_line(run, arguments, message) -> None:
    found = run("calibrate", SHEET, *arguments)
    assert found.code == 2
    assert message in found.err
    assert len(found.err.strip().splitlines()) == 1


def test_given_poses_are_measured(run) -> None:
    found = run("calibrate", SHEET, "--forecast", "--pose", "paper", "--q", "0 10 20 30 deg", "--json", "-")
    assert found.code == 2  # two ways to give poses
    found = run("calibrate", SHEET, "--forecast", "--q", "0 10 20 30 deg", "--q", "0 20 20 30 deg", "--json", "-")
    assert found.json["readings"] == 2
    assert math.isfinite(found.json["rms_position"]["after"])


SET_UP = (
    "measurement: {kind: position, std: 0.03 mm, target: 50 30 20 mm, base: free, target_known: false, load: none}\n"
)


@pytest.mark.slow
def test_the_set_up_is_that_of_the_sheet_where_options_say_nothing(run, folder) -> None:
    text = (folder / SHEET).read_text()
    (folder / "set.errors.yaml").write_text(text + SET_UP)
    poses = ("--forecast", "--random", "8", "--json", "-")
    found = run("calibrate", "set.errors.yaml", *poses).json["measurement"]
    expected = {"kind": "position", "std": 3e-5, "target": [0.05, 0.03, 0.02], "base": "free", "target_known": False}
    assert {name: found[name] for name in expected} == expected
    assert found["load"] == []
    options = ("--std", "0.1 mm", "--point-known", "--base-known")
    other = run("calibrate", "set.errors.yaml", *poses, *options).json["measurement"]
    assert (other["std"], other["base"], other["target_known"]) == (1e-4, "known", True)
    assert (other["target"], other["load"]) == (found["target"], [])
    kind = run("calibrate", "set.errors.yaml", *poses, "--kind", "pose").json["measurement"]
    assert (kind["kind"], kind["std"], kind["base"]) == ("pose", 3e-5, "free")
    changed = run("calibrate", "set.errors.yaml", *poses, "--set", "measurement.std=0.05 mm").json["measurement"]
    assert changed["std"] == 5e-5


MIXED = """
precision-pin: 1
robot: 4dof.urdf
tip: tool
poses: {start: -53 -30 59 -36 deg}
sources:
  - joint_offset: {joint: joint1, offset: {normal: {std: 1 mrad}}}
  - joint_offset: {joint: joint2, offset: {normal: {std: 1 mrad}}}
  - joint_offset: {joint: joint3, offset: {normal: {std: 1 mrad}}}
  - joint_offset: {joint: joint4, offset: {normal: {std: 1 mrad}}}
measurement:
  - {kind: position, std: 0.1 mm, target: 50 30 20 mm, base: free}
  - {kind: distance, std: 0.05 mm, target: 50 30 20 mm, anchor: 900 -300 0 mm, base: free}
  - {kind: pose, std: 0.1 mm, attitude_std: 1 mrad, target: 50 30 20 mm, base: free}
  - {kind: plane, std: 0.05 mm, target: 50 30 20 mm, plane: {point: 0 0 400 mm, normal: 1 0 1}}
"""
KINDS = ("position", "distance", "pose", "plane")


@pytest.mark.slow
def test_kinds_that_a_sheet_lists_are_simulated_one_by_one_and_fitted_together(run, folder) -> None:
    """Against least squares of scipy on Pinocchio's arm: offsets with their prior, base of the tracker, anchor."""
    (folder / "mixed.yaml").write_text(MIXED)
    for kind in KINDS:
        poses = ("mixed.yaml", "--kind", kind, "--seed", "4")
        assert run("calibrate", *poses, "--random", "20", "--plan", "6", "--csv", "plan.csv").code == 0
        made = run("simulate", *poses, "--trajectory", "plan.csv", "--unit", "3", "--out", f"{kind}.csv")
        assert made.code == 0
    found = run("calibrate", "mixed.yaml", *(f"{kind}.csv" for kind in KINDS), "--json", "-").json
    assert found["gross_errors"] == []
    arm = pin.buildModelFromUrdf("4dof.urdf")
    data = arm.createData()
    rows = {kind: np.loadtxt(f"{kind}.csv", delimiter=",", skiprows=2)[:, :-1] for kind in KINDS}
    # each kind has noise of its own
    assert not np.isin(rows["pose"][:, 4:7].round(3), rows["position"][:, 4:7].round(3)).any()
    for own in rows.values():
        own[:, :4] = np.radians(own[:, :4])
        own[:, 4:] *= 1e-3

    def residuals(x):
        turn, left = pin.exp3(x[7:10]), [x[:4] / 1e-3]
        for kind, own in rows.items():
            for row in own:
                pin.framesForwardKinematics(arm, data, row[:4] + x[:4])
                tool = data.oMf[arm.getFrameId("tool")]
                point = tool.act(np.array([0.05, 0.03, 0.02]))
                seen = row[4:7] - turn @ point - x[4:7]
                if kind == "distance":
                    left.append([(row[4] - np.linalg.norm(point - x[10:])) / 5e-5])
                elif kind == "plane":
                    left.append([(row[4] - (point[0] + point[2] - 0.4) / np.sqrt(2)) / 5e-5])
                else:
                    left.append(seen / 1e-4)
                if kind == "pose":
                    left.append(pin.log3(pin.exp3(row[7:]) @ (turn @ tool.rotation).T) / 1e-3)
        return np.concatenate(left)

    best = least_squares(residuals, [*np.zeros(10), 0.9, -0.3, 0], xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
    assert found["chi_square"] == pytest.approx(2 * best.cost, rel=1e-8)
    std = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))[:4]
    assert list(found["posterior"]["mean"].values()) == pytest.approx(best.x[:4], abs=1e-4 * std.min())
    assert list(found["posterior"]["std"].values()) == pytest.approx(std, rel=1e-3)
    assert found["degrees_of_freedom"] == 6 * (3 + 1 + 6 + 1) - 9


def test_of_several_measurements_one_is_picked(run, folder) -> None:
    (folder / "mixed.yaml").write_text(MIXED)
    (folder / "data.csv").write_text(
        "joint1 [deg],joint2 [deg],joint3 [deg],joint4 [deg],x [mm],y [mm],z [mm]\n0,0,0,0,1,2,3\n"
    )
    wrong = {
        "simulate mixed.yaml --out x.csv": "position (1), distance (1), pose (1), plane (1); --kind KIND picks",
        "calibrate mixed.yaml --plan 6": "the sheet lists 4 measurements",
        "calibrate mixed.yaml --forecast --kind socket": "--kind socket: the sheet lists several",
        "calibrate mixed.yaml data.csv": "a file for each measurement that the sheet lists, in its order, or --kind",
    }
    for arguments, message in wrong.items():
        found = run(*arguments.split())
        assert found.code == 2, arguments
        assert message in found.err, arguments
        assert len(found.err.strip().splitlines()) == 1, arguments


@pytest.mark.slow
def test_random_poses_of_contact_touch(run, folder) -> None:
    text = (folder / SHEET).read_text()
    sockets = (
        "measurement: {kind: socket, base: free, target: 50 30 20 mm, sockets: [900 200 800 mm, 200 900 1000 mm]}\n"
    )
    (folder / "set.errors.yaml").write_text(text + sockets)
    found = run("calibrate", "set.errors.yaml", "--plan", "6", "--random", "12", "--json", "-")
    assert found.code == 0
    assert "W_CONTACT" not in found.err
    assert found.json["measurement"]["nuisances"][:3] == ["socket1.x", "socket1.y", "socket1.z"]
    away = run("calibrate", "set.errors.yaml", "--forecast", "--pose", "paper")
    assert "1 of 1 poses do not touch a socket, the farthest by " in away.err


@pytest.mark.slow
def test_in_python_the_set_up_of_the_sheet_is_the_default(folder) -> None:
    (folder / "set.errors.yaml").write_text((folder / SHEET).read_text() + SET_UP)
    model, plain = (pp.ErrorModel.load(folder / name) for name in ("set.errors.yaml", SHEET))
    q = np.random.default_rng(0).uniform(-2, 2, (4, 8))
    assert pp.forecast_calibration(model, q).measurement == model.sheet.measurement
    with pytest.raises(pp.InputError, match="nothing says what is measured; give pp"):
        pp.identifiability(plain, q)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("measurement: {kind: planes}", "measurement.kind: input should be 'position', 'pose', 'distance', 'plane' or"),
        ("measurement: {kind: plane}", "the measurement of a plane needs plane"),
        ("measurement: {std: 0.1}", "std: '0.1' has no unit; a length needs one of"),
        ("measurement: {std: 0 mm}", "std must be above zero, got '0 mm'"),
        ("measurement: {anchor: 1 2 3 mm}", "anchor belongs to the measurement of a distance, not of a position"),
        ("measurement: {taget: 1 2 3 mm}", "unknown key 'taget': did you mean 'target'"),
        ("measurement: {load: [{at: tol, mass: 1 kg}]}", "no link named 'tol'; did you mean 'tool'?"),
        ("measurement: {load: [{at: tool, mass: 1 mm}]}", "load.0.mass: "),
        ("measurement: {kind: socket, sockets: [1 2 mm]}", "sockets.0: '1 2 mm' has 2 numbers, expected 3"),
    ],
)
def test_a_wrong_set_up_is_refused_at_its_line(run, folder, text, message) -> None:
    whole = (folder / SHEET).read_text() + text + "\n"
    (folder / "new.errors.yaml").write_text(whole)
    found = run("check", "new.errors.yaml")
    assert found.code == 2
    (line,) = (found.out + found.err).strip().splitlines()
    assert line.startswith(f"new.errors.yaml:{len(whole.splitlines())}: error ")
    assert message in line


@pytest.mark.slow
def test_a_factory_calibration_is_read_and_written(run, folder) -> None:
    from analyses.calibration.test_factory import dh_flange, write_conf
    from precision_pin.robot.chain import Chain
    from precision_pin.robot.examples import example_urdfs

    if "ur5" not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    write_conf(folder, "UR5")
    files = ("--urdf", "ur5.built.urdf", "--json", "f.json")
    found = run("calibrate", "example:ur5", "--factory", "calibration.conf", *files)
    assert found.code == 0
    assert found.out.splitlines()[0].startswith(
        "ur5_robot.urdf is a UR5; as its factory measured it, the tip is 2.24 mm rms"
    )
    assert max(map(len, found.out.splitlines())) <= 100
    assert json.loads((folder / "f.json").read_text())["schema"] == "precision-pin/factory-calibration/1"
    q = [0.1, -1.2, 1.1, -0.3, 0.4, 2.0]
    tip = Chain.from_urdf(folder / "ur5.built.urdf", "tool0", "base").at(q).pose
    np.testing.assert_allclose(tip, dh_flange("UR5", np.array(q)), atol=1e-9)


@pytest.mark.slow
def test_tolerances_of_a_population_are_written_as_a_sheet(run, folder) -> None:
    """Six robots, one of them as its calibration: the sheet keeps its laws with other widths, and says where they come from."""
    text = "precision-pin: 1\nrobot: 4dof.urdf\ntip: tool\nposes: {home: 0 0 0 0 deg}\nparameters:\n  b: ±2 mrad\nsources:\n"
    text += (
        "  - joint_offset: {joint: joint2, offset: {normal: 1 mrad}}\n  - joint_offset: {joint: joint3, offset: b}\n"
    )
    (folder / "arm.errors.yaml").write_text(text)
    model = pp.ErrorModel.load(folder / "arm.errors.yaml")
    q = np.random.default_rng(0).uniform(-2, 2, (4, 4))
    measurement = pp.Measurement()
    readings = simulate_readings(stations_of(model, q, measurement), measurement, model, robots=6)
    files = []
    for k in range(6):
        write(folder, np.hstack([np.degrees(q.T), 1e3 * readings[:, :, k]]))
        (folder / "data.csv").rename(folder / f"robot{k}.csv")
        files.append(f"robot{k}.csv")
    assert run("calibrate", "arm.errors.yaml", "robot5.csv", "--json", "robot5.json").code == 0
    files[5] = "robot5.json"
    written_to = ("--sheet", "new.errors.yaml", "--json", "p.json", "--out", "plots")
    found = run("calibrate", "arm.errors.yaml", "--population", *files, *written_to)
    assert found.code == 0
    assert found.out.splitlines()[0].startswith("6 robots 4dof.urdf, base to tool: ")
    assert max(map(len, found.out.splitlines())) <= 100
    # the sheet of one robot says nothing of the tolerances of several
    calibrated = (folder / "arm.errors.yaml").read_text() + "calibrated: robot5.json\n"
    (folder / "one.errors.yaml").write_text(calibrated)
    refused = run("calibrate", "one.errors.yaml", "--population", *files)
    assert (refused.code, refused.out) == (2, "")
    assert "--set calibrated=none" in refused.err
    anew = run("calibrate", "one.errors.yaml", "--population", *files, "--set", "calibrated=none", "--json", "-")
    assert anew.json["tolerances"] == json.loads((folder / "p.json").read_text())["tolerances"]
    scales = {one["draws"][0]: one["scale"] for one in json.loads((folder / "p.json").read_text())["tolerances"]}
    names = {path.name for path in (folder / "plots").iterdir()}
    assert names == {f"calibration-population.{end}" for end in ("json", "png", "svg")}
    written = (folder / "new.errors.yaml").read_text()
    assert written.startswith("# measured: 6 robots")
    new = pp.ErrorModel.load(folder / "new.errors.yaml")
    assert set(new.origins.values()) <= {"measured", ""}
    assert "measured" in new.origins.values()
    for draw in new.space.draws:
        old = next(one for one in model.space.draws if one.name == draw.name)
        assert type(draw.law) is type(old.law)
        ratio = np.sqrt(draw.law.covariance[0, 0] / old.law.covariance[0, 0])
        assert ratio == pytest.approx(scales[draw.name], rel=1e-5)
