"""``calibrate`` and ``simulate``: forecast, plan, fit, files, readings of a robot as built; against other computations."""

import csv
import itertools
import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.test_factory import dh_flange, write_conf
from precision_pin.analyses.readings import simulate_readings, stations_of
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import example_urdfs

SHEET = "4dof.errors.yaml"
TARGET = ("--point", "50 30 20 mm")
QUICK_SHEET = """precision-pin: 1
robot: 4dof.urdf
tip: tool
poses: {home: -53 -30 59 -36 deg}
sources:
  - joint_offset: {joint: joint2, offset: {normal: 1 mrad}}
  - joint_offset: {joint: joint3, offset: {normal: 1 mrad}}
"""
INSTRUMENT = "measurement: {kind: position, std: 20 um, target: 50 30 20 mm}\n"


def write(folder, name, rows, angle="deg", length="mm"):
    header = ",".join([f"joint{k} [{angle}]" for k in range(1, 5)] + [f"{axis} [{length}]" for axis in "xyz"])
    np.savetxt(folder / name, rows, "%.15g", delimiter=",", header=header, comments="")
    return name


@pytest.fixture
def rows(folder):
    """Return readings of a simulated robot of quick.errors.yaml, degrees and millimetres; data.csv has them too."""
    (folder / "quick.errors.yaml").write_text(QUICK_SHEET + INSTRUMENT)
    model = pp.ErrorModel.load(folder / "quick.errors.yaml")
    q = np.random.default_rng(0).uniform(-2, 2, (4, 8))
    readings = simulate_readings(stations_of(model, q, model.sheet.measurement), model.sheet.measurement, model, seed=1)
    rows = np.hstack([np.degrees(q.T), 1e3 * readings[:, :, 0]])
    write(folder, "data.csv", rows)
    return rows


@pytest.fixture
def quick(rows):
    """Return the name of a sheet that is fitted quickly."""
    return "quick.errors.yaml"


# forecast and plan ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_plan_begins_with_what_it_buys_and_is_the_forecast_of_its_poses(run, folder):
    found = run("calibrate", SHEET, "--plan", "4", "--random", "10", *TARGET, "--json", "p.json", "--out", "plots")
    start = "measure 4 of 10 poses of 4dof.urdf, base to tool: rms position error 36.9 mm before, "
    assert found.out.startswith(start)
    assert max(map(len, found.out.splitlines())) <= 100
    names = {path.name for path in (folder / "plots").iterdir()}
    assert names == {f"calibration-plan.{end}" for end in ("json", "png", "svg")}
    plan = json.loads((folder / "p.json").read_text())
    assert plan["schema"] == "precision-pin/calibration-plan/1"
    texts = [" ".join(f"{x:.17g}" for x in one["q"].values()) + " rad" for one in plan["chosen"]]
    chosen = [word for text in texts for word in ("--q", text)]
    told = run("calibrate", SHEET, "--forecast", *chosen, *TARGET, "--json", "f.json")
    assert told.out.startswith("calibrating 4dof.urdf, base to tool: rms position error 36.9 mm before, ")
    forecast = json.loads((folder / "f.json").read_text())
    assert (forecast["schema"], forecast["readings"]) == ("precision-pin/calibration-forecast/1", 4)
    assert forecast["rms_position"]["after"] == pytest.approx(plan["rms_position"]["after"], rel=1e-9)


@pytest.mark.slow
def test_the_set_up_is_that_of_the_sheet_where_options_say_nothing(run, folder):
    own = "{kind: position, std: 0.03 mm, target: 50 30 20 mm, base: free, target_known: false, load: none}"
    (folder / "set.errors.yaml").write_text(f"{(folder / SHEET).read_text()}measurement: {own}\n")
    usual = {"kind": "position", "std": 3e-5, "target": [0.05, 0.03, 0.02], "base": "free", "target_known": False}
    known = {"std": 1e-4, "base": "known", "target_known": True}
    for options, changed in (
        ((), {}),
        (("--std", "0.1 mm", "--point-known", "--base-known"), known),
        (("--kind", "pose"), {"kind": "pose"}),
        (("--set", "measurement.std=0.05 mm"), {"std": 5e-5}),
        # read as in the sheet: a length and a share of the distance, and a plus sign of a single length
        (("--kind", "distance", "--std", "1 mm/m + 1e+0 m"), {"sight": {"along": [1, 1e-3], "across": None}, "std": 1}),
        (("--kind", "distance", "--std", "+1e+1 mm"), {"sight": None, "std": 0.01}),
    ):
        asked = ("calibrate", "set.errors.yaml", "--forecast", "--random", "8", "--json", "-")
        found = run(*asked, *options).json["measurement"]
        expected = usual | {"load": [], "kind": found["kind"]} | changed
        assert {name: found[name] for name in expected} == expected
    # in Python too
    model, plain = (pp.ErrorModel.load(folder / name) for name in ("set.errors.yaml", SHEET))
    q = np.random.default_rng(0).uniform(-2, 2, (4, 8))
    assert pp.forecast_calibration(model, q).measurement == model.sheet.measurement
    with pytest.raises(pp.InputError, match="nothing says what is measured; give pp"):
        pp.identifiability(plain, q)


# fit -----------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_fit_writes_what_is_asked_for_in_any_units(run, folder, quick, rows):
    found = run("calibrate", quick, "data.csv", "--urdf", "new.urdf", "--out", "plots", "--json", "c.json")
    assert found.out.startswith("4dof.urdf, base to tool: the calibration helps: left-out error ")
    assert "the model explains the readings" in found.out
    assert max(map(len, found.out.splitlines())) <= 100
    names = {path.name for path in (folder / "plots").iterdir()}
    assert names == {f"calibration.{end}" for end in ("json", "png", "svg")}
    assert (folder / "new.urdf").read_text().startswith("<?xml")
    write(folder, "si.csv", np.hstack([np.radians(rows[:, :4]), rows[:, 4:] / 1e3]), "rad", "m")
    same = run("calibrate", quick, "si.csv", "--json", "-").json
    assert same["chi_square"] == pytest.approx(json.loads((folder / "c.json").read_text())["chi_square"], rel=1e-9)
    write(folder, "twice.csv", np.vstack([rows, rows[3]]))
    assert "twice.csv:10: warning W_REPEATED_READING" in run("calibrate", quick, "twice.csv").err


@pytest.mark.slow
def test_other_commands_run_on_the_calibrated_sheet(run, folder, quick):
    found = run("calibrate", quick, "data.csv", "--sheet", "new.errors.yaml", "--json", "-")
    assert (folder / "new.calibration.json").read_text() == found.out
    covariance = pp.ErrorModel.load(folder / "new.errors.yaml").at("home").covariance
    # slopes are taken at the means before the calibration in one, after it in the other
    after = found.json["poses"][0]["after"]["rms_position"]
    assert np.sqrt(np.trace(covariance[:3, :3])) == pytest.approx(after, rel=1e-3)
    run("compensate", "new.errors.yaml")
    (folder / "plots").mkdir()
    # a second calibration takes the place of the first
    run("calibrate", "new.errors.yaml", "data.csv", "--sheet", "plots/again.errors.yaml")
    assert (folder / "plots" / "again.errors.yaml").read_text().count("calibrated:") == 1
    run("check", "plots/again.errors.yaml")


def test_a_wrong_calibration_is_refused_at_its_line(refused, folder, quick):
    estimates = {"names": ["nonsense"], "mean": {"nonsense": 0.0}, "covariance": [[1.0]]}
    of = pp.ErrorModel.load(folder / quick).chain.kinematics
    for name, posterior in (("part.json", {"names": ["a0"], "mean": {}}), ("stranger.json", estimates)):
        content = {"schema": "precision-pin/calibration/1", "posterior": posterior, "kinematics": of}
        (folder / name).write_text(json.dumps(content))
    (folder / "other.json").write_text("[1]")
    text = (folder / SHEET).read_text()
    for value, message in (
        ("nowhere.json", "calibrated: nowhere.json does not exist"),
        ("data.csv", "calibrated: data.csv is not JSON"),
        ("other.json", "calibrated: other.json is no result of calibrate"),
        ("part.json", "the estimates in part.json are not complete"),
        ("stranger.json", "no component named 'nonsense'"),
    ):
        (folder / "new.errors.yaml").write_text(f"{text}calibrated: {value}\n")
        line = refused("check", "new.errors.yaml")
        assert line.startswith(f"new.errors.yaml:{text.count(chr(10)) + 1}: error ")
        assert message in line


@pytest.mark.slow
def test_the_calibration_of_another_robot_is_refused_by_its_joints_and_not_by_its_names(run, refused, folder, quick):
    """Names, meshes, masses, notes and how a link is divided do not matter; where a joint or the tip is does."""
    run("calibrate", quick, "data.csv", "--sheet", "new.errors.yaml")
    urdf, sheet = (folder / "4dof.urdf").read_text(), (folder / "new.errors.yaml").read_text()
    # the last link in two parts, other masses, a note and a part beside the arm
    last = '<origin xyz="0 0 -0.274"/>'
    start = urdf.rindex("<joint", 0, urdf.index(last))
    half = urdf[start : urdf.index("</joint>", start) + 8].replace("0.274", "0.137")
    first, second = (half.replace('"tool"', '"between"'), re.sub(r'parent link="[^"]*"', 'parent link="between"', half))
    parts = first + re.sub(r'joint name="[^"]*"', 'joint name="further"', second)
    divided = urdf[:start] + parts + '<link name="between"/>' + urdf[start + len(half) :]
    for text in (
        divided,
        re.sub(r'mass value="[^"]*"', 'mass value="0.5"', urdf).replace("<robot", "<!-- ours --><robot"),
    ):
        (folder / "4dof.urdf").write_text(text)
        assert "W_CALIBRATED" not in run("check", "new.errors.yaml").out
    for name in ("4dof.urdf", "ours.urdf"):
        (folder / name).write_text(urdf)
    (folder / "ours.errors.yaml").write_text(sheet.replace("4dof.urdf", "ours.urdf"))
    assert "W_CALIBRATED" not in run("check", "ours.errors.yaml", "--tip", "link4").out
    for old, new in (
        ('xyz="1.97 0 0"', 'xyz="9.85 0 0"'),
        (last, last.replace("0.2", "0.3")),
        ('axis xyz="0 0 1"', 'axis xyz="0 1 0"'),
    ):
        assert old in urdf
        (folder / "4dof.urdf").write_text(urdf.replace(old, new))
        line = refused("check", "new.errors.yaml")
        assert "calibrated: new.calibration.json is not of this 4dof.urdf: joints and tip are placed otherwise;" in line
    asked = ("calibrate", quick, "--population", "new.calibration.json", "new.calibration.json")
    assert "new.calibration.json is not of this 4dof.urdf: joints and tip" in refused(*asked)
    # older results have names alone
    (folder / "4dof.urdf").write_text(urdf)
    old = json.loads((folder / "new.calibration.json").read_text())
    del old["kinematics"]
    (folder / "new.calibration.json").write_text(json.dumps(old))
    said = run("check", "new.errors.yaml").out
    assert "W_CALIBRATED_ROBOT: new.calibration.json is of a 4dof.urdf by name only" in said
    assert "is not of this ours.urdf: it is of 4dof.urdf;" in refused("check", "ours.errors.yaml")


def test_a_tolerance_edited_in_the_text_of_a_calibrated_sheet_is_said(run, folder, quick):
    run("calibrate", quick, "data.csv", "--sheet", "mine.errors.yaml")
    assert "W_TEXT_MEASURED" not in run("check", "mine.errors.yaml").err
    text = (folder / "mine.errors.yaml").read_text()
    edited = text.replace("joint3, offset: {normal: 1 mrad}", "joint3, offset: {normal: 6 mrad}")
    (folder / "mine.errors.yaml").write_text(edited)
    said = run("analyze", "mine.errors.yaml", "--samples", "500", "--json", "-")
    (line,) = [line for line in said.err_lines if "W_TEXT_MEASURED" in line]
    # a tolerance is 3 sigma
    assert "joint_offset[joint3].offset 0 ± 2 mrad, then 0 ± 0.33 mrad;" in line
    assert "joint2" not in line
    # what was measured counts: the spread is that of the calibrated arm
    with pytest.warns(PrecisionPinWarning, match="W_TEXT_MEASURED"):
        model = pp.ErrorModel.load(folder / "mine.errors.yaml")
    assert np.sqrt(model.space.block_covariance.variances).max() < 0.1e-3
    # a second calibration has the measured arm as its prior, and the text as it is now
    run("calibrate", "mine.errors.yaml", "data.csv", "--sheet", "again.errors.yaml")
    assert "W_TEXT_MEASURED" not in run("check", "again.errors.yaml").err


def test_a_calibrated_sheet_is_not_written_of_another_arm_than_its_own(refused, quick):
    assert refused("calibrate", quick, "data.csv", "--tip", "link4", "--sheet", "mine.errors.yaml") == (
        "precision-pin: error E_INPUT: --sheet writes the sheet as it is in its file; write the robot, tip and base of the "
        "options there first"
    )


@pytest.mark.slow
def test_view_and_report_show_the_fit_of_the_command(run, folder, quick, monkeypatch):
    found = run("calibrate", quick, "data.csv", "--json", "-").json
    rms = {name: f"{1e3 * value:.3g}" for name, value in found["rms_residual"].items()}
    squares = np.array(
        [
            [np.trace(np.array(pose[f"covariance_{which}"])[:3, :3]) for which in ("after", "before")]
            + np.array([0, np.sum(np.square(pose["mean_before"][:3]))])
            for pose in found["poses"]
        ]
    )
    sizes = tuple(f"{1e3 * size:.3g}" for size in np.sqrt(squares.mean(axis=0)))
    served = {}
    serve = "precision_pin.pages.view.live.serve"
    monkeypatch.setattr(serve, lambda page, files, **_: served.update(page=page(), files=[path.name for path in files]))
    asked = (quick, "--samples", "200", "--calibrate", "data.csv")
    theirs = (folder / "data.csv").read_text().replace("x [mm]", "px").replace(",", ";").replace(".", ",")
    (folder / "theirs.csv").write_text(theirs)
    (folder / "way.csv").write_text("q1 joint2 joint3 joint4\n0 10 20 30\n10 20 30 40\n")
    both = ("--trajectory", "way.csv", "--columns", "px=x [mm], q1=joint1 [deg], *=[deg]")
    run("view", *asked[:-1], "theirs.csv", *both)
    assert {"theirs.csv", "way.csv"} <= set(served["files"])
    made = run("report", *asked, "--out", "page.html")
    assert "W_NO_REPEATABILITY" in made.err
    report = (folder / "page.html").read_text("utf-8")
    for page in (served["page"], report):
        assert f"Residuals: {rms['before']} mm rms before, {rms['after']} mm after" in page
        # the error after the calibration comes first, and the sheet's is named
        headline = re.search(r"After calibration: position error (\S+) mm rms at [^<]*; (\S+) mm before; the", page)
        assert headline.groups() == sizes
        own = page.index("Before calibration, robots of the sheet (after it: the sheet of calibrate --sheet with ")
        assert headline.end() < own < page.index("95 % of ")
    assert 'href="#calibration"' in report
    assert "--calibrate data.csv" in report
    begun = [line.split()[-1] for line in made.err_lines if "calibration" in line or "sampling" in line]
    assert begun[:2] == ["calibration", "sampling"]


@pytest.mark.slow
@pytest.mark.parametrize("command", ["view", "report"])
def test_a_page_refuses_readings_before_anything_long_begins(refused, folder, rows, monkeypatch, command):
    monkeypatch.setattr(f"precision_pin.cli.{command}.compile_sampler", lambda *_: pytest.fail("sampling began"))
    (folder / "plain.errors.yaml").write_text(QUICK_SHEET)
    write(folder, "far.csv", rows[:, [0, 1, 2, 3, 6, 5, 4]])
    (folder / "data.html").write_text((folder / "data.csv").read_text())
    for sheet, data, out, message in (
        ("quick", "nosuch.csv", "page.html", "nosuch.csv"),
        ("plain", "data.csv", "page.html", "plain.errors.yaml: error E_MISSING_KEY: the sheet has no measurement:"),
        ("quick", "data.html", "data.html", "is an input"),
        ("quick", "far.csv", "page.html", "columns or units are wrong"),
    ):
        assert message in refused(command, f"{sheet}.errors.yaml", "--calibrate", data, "--out", out, "--quiet")


@pytest.mark.slow
def test_a_joint_shown_with_another_is_named_and_the_line_that_is_said_mends_it(run, refused, folder, rows):
    """Joint 3 as a control shows it against the horizontal, the sum with joint 2, by the numbers of the file."""
    shown = rows.copy()
    shown[:, 2] += shown[:, 1]
    write(folder, "shown.csv", shown)
    # with a reading that is far off
    write(folder, "far.csv", shown + 300.0 * np.outer(np.arange(8) == 5, np.arange(7) == 4))
    said = refused("calibrate", "quick.errors.yaml", "far.csv", "--base-free", "--std", "estimate")
    assert "E_COUPLED: readings fit far better where one joint is shown with another" in said
    line = said.partition("write measurement: {")[2].partition("} in the sheet")[0]
    assert line == "coupled: {joint3: joint3 - joint2}"
    told = INSTRUMENT.replace("}\n", f", {line}}}\n")
    (folder / "told.errors.yaml").write_text(QUICK_SHEET + told)
    as_shown, as_is = (
        run("calibrate", *files, "--json", "-").json
        for files in (("told.errors.yaml", "shown.csv"), ("quick.errors.yaml", "data.csv"))
    )
    assert as_shown["posterior"]["mean"] == pytest.approx(as_is["posterior"]["mean"], rel=1e-6, abs=1e-9)
    # a rehearsal shows the joints so, too
    for sheet in ("told", "quick"):
        run("simulate", f"{sheet}.errors.yaml", "--q", "10 20 30 40 deg", "--out", f"{sheet}.csv")
    written = [np.genfromtxt(f"{sheet}.csv", delimiter=",", skip_header=2) for sheet in ("told", "quick")]
    np.testing.assert_allclose(written[0] - written[1], [0, 0, 20, 0, 0, 0, 0, 0], atol=1e-9)


def test_wrong_couplings_are_refused_at_their_line(refused, folder, rows):
    for given, said in (
        ("{joint3: joint3 * 2}", "coupled: joint3: such as 'joint3 - joint2' is expected, got 'joint3 * 2'"),
        ("{joint3: joint3 - joint9}", "no joint of coupled named 'joint9'"),
        ("{joint9: joint3}", "no joint of coupled named 'joint9'"),
        ("{joint3: joint2}", "coupled: the values of the joints do not follow from those in the columns"),
    ):
        (folder / "told.errors.yaml").write_text(QUICK_SHEET + INSTRUMENT.replace("}\n", f", coupled: {given}}}\n"))
        told = refused("calibrate", "told.errors.yaml", "data.csv")
        assert said in told
        assert told.startswith("told.errors.yaml:8: error ")


# several measurements of one sheet -----------------------------------------------------------------------------------

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
def test_kinds_that_a_sheet_lists_are_simulated_one_by_one_and_fitted_together(run, folder):
    """The fit finds the robot that was simulated; test_data.py has the least squares of several kinds."""
    (folder / "mixed.yaml").write_text(MIXED)
    measured, joints = {}, [f"joint{k}_deg" for k in range(1, 5)]
    for kind in KINDS:
        poses = ("mixed.yaml", "--kind", kind, "--seed", "4")
        run("calibrate", *poses, "--random", "20", "--plan", "6", "--csv", "plan.csv")
        run("simulate", *poses, "--trajectory", "plan.csv", "--unit", "3", "--out", f"{kind}.csv")
        plan = np.genfromtxt("plan.csv", delimiter=",", names=True)
        measured[kind] = np.genfromtxt(f"{kind}.csv", delimiter=",", names=True, skip_header=1)
        assert (plan[joints] == measured[kind][joints]).all()
    # each kind has noise of its own
    assert not np.isin(measured["pose"]["x_mm"].round(3), measured["position"]["x_mm"].round(3)).any()
    found = run("calibrate", "mixed.yaml", *(f"{kind}.csv" for kind in KINDS), "--json", "-").json
    assert (found["gross_errors"], found["verdict"]) == ([], "agrees")
    # six poses of each kind; a base of six numbers and an anchor of three
    assert found["degrees_of_freedom"] == 6 * (3 + 1 + 6 + 1) - 9
    space = pp.ErrorModel.load("mixed.yaml").space
    truth = dict(zip(space.components, space.sample(4, 3, 1)[:, 0], strict=True))
    for name, mean in found["posterior"]["mean"].items():
        std = found["posterior"]["std"][name]
        # the prior has 1 mrad
        assert std < 0.5e-3, name
        assert abs(mean - truth[name]) < 4 * std, name


def test_of_several_measurements_one_is_picked(refused, folder):
    (folder / "mixed.yaml").write_text(MIXED)
    write(folder, "data.csv", np.zeros((1, 7)))
    for arguments, message in {
        "simulate mixed.yaml --out x.csv": "plane (1); select a kind that is listed once with --kind",
        "calibrate mixed.yaml --plan 6": "the sheet lists 4 measurements",
        "calibrate mixed.yaml --forecast --kind socket": "--kind socket: the sheet lists several",
        "calibrate mixed.yaml data.csv": "a file for each measurement that the sheet lists, in its order, or --kind",
    }.items():
        assert message in refused(*arguments.split())


@pytest.mark.slow
def test_random_poses_of_contact_touch(run, folder):
    own = "{kind: socket, base: free, target: 50 30 20 mm, sockets: [900 200 800 mm, 200 900 1000 mm]}"
    (folder / "set.errors.yaml").write_text(f"{(folder / SHEET).read_text()}measurement: {own}\n")
    found = run("calibrate", "set.errors.yaml", "--plan", "6", "--random", "12", "--json", "-")
    assert "W_CONTACT" not in found.err
    assert found.json["measurement"]["nuisances"][:3] == ["socket1.x", "socket1.y", "socket1.z"]
    away = run("calibrate", "set.errors.yaml", "--forecast", "--pose", "paper")
    assert "1 of 1 poses do not touch a socket, the farthest by " in away.err


@pytest.mark.slow
def test_a_factory_calibration_is_read_and_written(run, folder):
    if "ur5" not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    write_conf(folder)
    files = ("--urdf", "ur5.built.urdf", "--json", "f.json")
    found = run("calibrate", "example:ur5", "--factory", "calibration.conf", *files)
    assert found.out.startswith("ur5_robot.urdf is a UR5; as its factory measured it, the tip is 2.24 mm rms")
    assert max(map(len, found.out.splitlines())) <= 100
    assert json.loads((folder / "f.json").read_text())["schema"] == "precision-pin/factory-calibration/1"
    q = [0.1, -1.2, 1.1, -0.3, 0.4, 2.0]
    tip = Chain.from_urdf(folder / "ur5.built.urdf", "tool0", "base").at(q).pose
    np.testing.assert_allclose(tip, dh_flange(np.array(q)), atol=1e-9)


@pytest.mark.slow
def test_tolerances_of_a_population_are_written_as_a_sheet(run, refused, folder):
    """Six robots, one of them as its calibration: the sheet keeps its laws with other widths, and says where they come from."""
    sheet = QUICK_SHEET.replace("sources:", "parameters:\n  b: ±2 mrad\nsources:")
    sheet = sheet.replace("joint3, offset: {normal: 1 mrad}", "joint3, offset: b")
    (folder / "arm.errors.yaml").write_text(sheet)
    # the sheet of one robot says nothing of the tolerances of several
    (folder / "one.errors.yaml").write_text(f"{sheet}calibrated: robot5.json\n")
    model = pp.ErrorModel.load(folder / "arm.errors.yaml")
    q = np.random.default_rng(0).uniform(-2, 2, (4, 4))
    readings = 1e3 * simulate_readings(stations_of(model, q, pp.Measurement()), pp.Measurement(), model, robots=6)
    tables = [np.hstack([np.degrees(q.T), readings[:, :, k].round(7)]) for k in range(6)]
    files = [write(folder, f"robot{k}.csv", table) for k, table in enumerate(tables)]
    run("calibrate", "arm.errors.yaml", "robot5.csv", "--json", "robot5.json")
    several = ("--population", *files[:5], "robot5.json")
    found = run(
        "calibrate", "arm.errors.yaml", *several, "--sheet", "new.errors.yaml", "--json", "p.json", "--out", "plots"
    )
    assert found.out.startswith("6 robots 4dof.urdf, base to tool: ")
    assert max(map(len, found.out.splitlines())) <= 100
    tolerances = json.loads((folder / "p.json").read_text())["tolerances"]
    names = {path.name for path in (folder / "plots").iterdir()}
    assert names == {f"calibration-population.{end}" for end in ("json", "png", "svg")}
    assert "--set calibrated=none" in refused("calibrate", "one.errors.yaml", *several)
    anew = run("calibrate", "one.errors.yaml", *several, "--set", "calibrated=none", "--json", "-")
    assert anew.json["tolerances"] == tolerances
    assert (folder / "new.errors.yaml").read_text().startswith("# measured: 6 robots")
    new = pp.ErrorModel.load(folder / "new.errors.yaml")
    assert "measured" in new.origins.values()
    ratios = np.sqrt(new.space.block_covariance.variances / model.space.block_covariance.variances)
    scales = {one["draws"][0]: one["scale"] for one in tolerances}
    assert ratios == pytest.approx([scales[name] for name in new.space.components], rel=5e-4)  # four digits


# simulate ------------------------------------------------------------------------------------------------------------

SIMULATED = """precision-pin: 1
robot: 4dof.urdf
tip: tool
poses:
  paper: -90 3 88 -91 deg
  other: 20 -10 40 15 deg
sources:
  - payload: {at: tool, mass: {uniform: 0.2 kg, mean: 2 kg}}
  - encoder: {joint: joint2, resolution: 60 arcsec, amplitude: {uniform: 20 arcsec, mean: 40 arcsec}}
  - bearing_stiffness: {joint: joint1, tilt: {uniform: 1e4 N*m/rad, mean: 1e5 N*m/rad}}
  - beam: {link: link2, EI: {uniform: 800 N*m^2, mean: 8000 N*m^2}, GI: 4000 N*m^2}
  - joint_offset: {joint: joint4, offset: {normal: 1 mrad}}
  - joint_offset: {joint: joint3, offset: {normal: 0.3 mrad, scope: visit}}
"""
ROBOT = ("--unit", "3", "--seed", "8")
EXACT = ("--std", "1e-6 mm")


@pytest.fixture
def sheet(folder):
    (folder / "arm.errors.yaml").write_text(SIMULATED)
    return "arm.errors.yaml"


def rows_of(file):
    return list(csv.DictReader(line for line in file.read_text().splitlines() if line[:1] != "#"))


def lengths(row):
    return np.array([float(row[f"{axis} [mm]"]) for axis in "xyz"]) / 1e3


@pytest.mark.slow
@pytest.mark.parametrize(("pose", "kind"), [("paper", "position"), ("other", "pose")])
def test_a_reading_is_where_the_exported_robot_has_its_target(run, folder, sheet, pose, kind):
    """Sag, encoder and bearing are those of this pose; other kinds than positions are read at visits of their own."""
    if kind == "pose":
        (folder / sheet).write_text(SIMULATED.replace(", scope: visit", "").replace("resolution: 60 arcsec, ", ""))
    words = ("simulate", sheet, "--pose", pose, *ROBOT, "--point", "30 20 10 mm", "--kind", kind, "--out", "r.csv")
    run(*words, *EXACT)
    run("export", sheet, "--pose", pose, "--first", "3", "--seed", "8", "--out", "built")
    (row,) = rows_of(folder / "r.csv")
    q = [np.radians(float(row[f"joint{k} [deg]"])) for k in range(1, 5)]
    tip = Chain.from_urdf(folder / "built/4dof.unit0003.urdf", tip="tool").at(q).pose
    # five standard deviations of the noise, and the rounding of the file
    assert lengths(row) == pytest.approx(tip[:3, 3] + tip[:3, :3] @ [0.03, 0.02, 0.01], abs=6e-9)
    if kind == "pose":
        turn = np.array([float(row[f"r{axis} [mrad]"]) for axis in "xyz"]) / 1e3
        np.testing.assert_allclose(Rotation.from_rotvec(turn).as_matrix(), tip[:3, :3], rtol=0, atol=6e-8)
        run(*words)
        fitted = run("calibrate", sheet, "r.csv", "--kind", "pose", "--point", "30 20 10 mm", "--json", "-")
        assert fitted.json["verdict"] == "agrees"


@pytest.mark.slow
def test_calibrate_reads_the_file_as_it_is_with_the_noise_of_the_instrument(run, folder, sheet):
    (folder / "far.yaml").write_text("random: {count: 12, seed: 1}\n")
    asked = ("simulate", sheet, "--grid", "far.yaml", *ROBOT, "--out")
    made = run(*asked, "r.csv")
    assert made.out == ""
    truth = "12 readings of position, std 0.02 mm, of robot 3 of seed 8 of arm.errors.yaml"
    assert f"wrote r.csv: {truth}; export --seed 8 --first 3 writes this robot as URDF" in made.err
    assert (folder / "r.csv").read_text().startswith(f"# simulated: {truth}\njoint1 [deg],")
    assert run("calibrate", sheet, "r.csv", "--json", "-").json["verdict"] == "agrees"
    run(*asked, "exact.csv", *EXACT)
    noisy, exact = (np.array([lengths(row) for row in rows_of(folder / name)]) for name in ("r.csv", "exact.csv"))
    # four standard deviations of a standard deviation of 36 numbers
    assert (noisy - exact).std() == pytest.approx(2e-5, rel=4 / np.sqrt(72))
    assert {row["std [mm]"] for row in rows_of(folder / "r.csv")} == {"0.020000"}


@pytest.mark.slow
def test_cycles_are_the_visits_of_the_forecasts_robot(run, refused, folder, sheet):
    cycles = ("--cycles", "20", "--seed", "8")
    run("simulate", sheet, "--all-poses", *cycles, *EXACT, "--out", "c.csv")
    asked = ("iso9283", sheet, "--all-poses", "--json", "-", "--robots")
    measured = run(*asked, "200", "--measured", "c.csv").json["measured"]["poses"]
    forecast = run(*asked, "1", *cycles).json["poses"]
    for pose, figure in itertools.product(("P1", "P2"), ("AP", "RP")):
        assert measured[pose][figure] == pytest.approx(forecast[pose][figure]["mean"], abs=5e-9)
    refused("calibrate", sheet, "c.csv")


@pytest.mark.slow
def test_a_grid_with_data_maps_the_error_that_is_left(run, folder, quick):
    """Places in a plane, some out of reach; the note has the extremes of the poses of --at."""
    (folder / "joints.yaml").write_text("joints: {joint1: -40 40 deg, joint2: 0 deg, joint3: 30 60 deg, joint4: 0 deg}")
    told = run("calibrate", quick, "data.csv", "--approach", "previous", "--grid", "joints.yaml", "--out", "left")
    note = re.search(r"map of 4 poses: 95 % of \|d\| left (\S+) to (\S+) mm", told.err + told.out)
    assert {path.name for path in (folder / "left").glob("*.png")} == {"calibration.png", "calibration-map.png"}
    at = np.radians([[a, 0, b, 0] for a in (-40, 40) for b in (30, 60)]).T
    arm = pp.calibrate(pp.ErrorModel.load(folder / quick), str(folder / "data.csv"), at=at)
    sizes = [1e3 * entry.quantile("after") for entry in arm.poses]
    assert [*map(float, note.groups())] == pytest.approx([min(sizes), max(sizes)], rel=6e-3)
    assert "--grid places to map" in run("calibrate", quick, "data.csv", "--q", "0 0 0 0 deg", code=2).err
