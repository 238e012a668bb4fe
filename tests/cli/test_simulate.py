"""``simulate``: readings of a robot as built, against the URDF that ``export`` writes and against plain statistics."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from precision_pin.robot.chain import Chain

SHEET = """precision-pin: 1
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
def sheet(folder) -> str:
    (folder / "arm.errors.yaml").write_text(SHEET)
    return "arm.errors.yaml"


def rows(file) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in file.read_text().splitlines() if line[:1] != "#"))


def lengths(row) -> np.ndarray:
    return np.array([float(row[f"{axis} [mm]"]) for axis in "xyz"]) / 1e3


@pytest.mark.slow
@pytest.mark.parametrize(("pose", "kind"), [("paper", "position"), ("other", "pose")])
def test_a_reading_is_where_the_exported_robot_has_its_target(run, folder, sheet, pose, kind):
    """Sag, encoder and bearing are those of this pose; other kinds than positions are read at visits of their own."""
    if kind == "pose":
        (folder / sheet).write_text(SHEET.replace(", scope: visit", "").replace("resolution: 60 arcsec, ", ""))
    words = ("simulate", sheet, "--pose", pose, *ROBOT, "--point", "30 20 10 mm", "--kind", kind, "--out", "r.csv")
    assert run(*words, *EXACT).code == 0
    assert run("export", sheet, "--pose", pose, "--first", "3", "--seed", "8", "--out", "built").code == 0
    (row,) = rows(folder / "r.csv")
    q = [np.radians(float(row[f"joint{k} [deg]"])) for k in range(1, 5)]
    tip = Chain.from_urdf(folder / "built/4dof.unit0003.urdf", tip="tool").at(q).pose
    # five standard deviations of the noise, and the rounding of the file
    assert lengths(row) == pytest.approx(tip[:3, 3] + tip[:3, :3] @ [0.03, 0.02, 0.01], abs=6e-9)
    if kind == "pose":
        turn = np.array([float(row[f"r{axis} [mrad]"]) for axis in "xyz"]) / 1e3
        np.testing.assert_allclose(Rotation.from_rotvec(turn).as_matrix(), tip[:3, :3], rtol=0, atol=6e-8)
        assert run(*words).code == 0
        fitted = run("calibrate", sheet, "r.csv", "--kind", "pose", "--point", "30 20 10 mm", "--json", "-")
        assert fitted.json["verdict"] == "agrees"


@pytest.mark.slow
def test_the_noise_is_the_instruments(run, folder, sheet):
    (folder / "far.yaml").write_text("random: {count: 200, seed: 1}\n")
    for file, std in (("noisy.csv", "0.05 mm"), ("exact.csv", "1e-6 mm")):
        assert run("simulate", sheet, "--grid", "far.yaml", *ROBOT, "--std", std, "--out", file).code == 0
    noisy, exact = (np.array([lengths(row) for row in rows(folder / name)]) for name in ("noisy.csv", "exact.csv"))
    noise = noisy - exact
    # four standard deviations of a standard deviation of 600 numbers
    assert noise.std() == pytest.approx(5e-5, rel=4 / np.sqrt(1200))
    assert {row["std [mm]"] for row in rows(folder / "noisy.csv")} == {"0.050000"}


@pytest.mark.slow
def test_calibrate_reads_the_file_as_it_is(run, folder, sheet):
    (folder / "far.yaml").write_text("random: {count: 12, seed: 1}\n")
    made = run("simulate", sheet, "--grid", "far.yaml", *ROBOT, "--out", "r.csv")
    assert (made.code, made.out) == (0, "")
    truth = "12 readings of position, std 0.02 mm, of robot 3 of seed 8 of arm.errors.yaml"
    assert f"wrote r.csv: {truth}; export --seed 8 --first 3 writes this robot as URDF" in made.err
    assert (folder / "r.csv").read_text().startswith(f"# simulated: {truth}\njoint1 [deg],")
    assert run("calibrate", sheet, "r.csv", "--json", "-").json["verdict"] == "agrees"


@pytest.mark.slow
def test_cycles_are_the_visits_of_the_forecasts_robot(run, folder, sheet):
    """Its repeatability is that of an offset new at each visit, times its lever arm: by hand from the URDF."""
    made = run("simulate", sheet, "--all-poses", "--cycles", "20", "--seed", "8", *EXACT, "--out", "c.csv")
    assert made.code == 0
    found = run("iso9283", sheet, "--all-poses", "--robots", "200", "--measured", "c.csv", "--json", "-").json
    forecast = run(
        "iso9283", sheet, "--all-poses", "--robots", "1", "--cycles", "20", "--seed", "8", "--json", "-"
    ).json
    for pose in ("P1", "P2"):
        measured = found["measured"]["poses"][pose]
        for figure in ("AP", "RP"):
            assert measured[figure] == pytest.approx(forecast["poses"][pose][figure]["mean"], abs=5e-9)
    points = np.array([lengths(row) for row in rows(folder / "c.csv") if row["pose"] == "P1"])
    q = np.radians([-90, 3, 88, -91])
    chain = Chain.from_urdf("4dof.urdf", tip="tool")
    moved = [chain.at(q + np.array([0, 0, way * 1e-6, 0])).pose[:3, 3] for way in (1, -1)]
    lever = np.linalg.norm(moved[0] - moved[1]) / 2e-6
    # four standard deviations of one of 20 numbers; joint 3 has 0.1 mrad, and the encoder moves joint 2 as well
    assert np.linalg.norm(points.std(axis=0, ddof=1)) > (1 - 4 / np.sqrt(38)) * 1e-4 * lever > 1e-5
    assert run("calibrate", sheet, "c.csv").code == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--out", "r.txt", "--unit", "-1"), "--unit must be a whole number from 0 to 2^64 - 1"),
        (("--out", "r.csv", "--cycles", "1"), "--cycles must be a whole number from 2"),
        (("--out", "r.csv", "--cycles", "3", "--kind", "distance"), "--cycles are positions or poses"),
        (("--out", "r.csv", "--pose", "elsewhere"), "elsewhere"),
        (("--out", "r.csv", "--std", "0 mm"), "above zero"),
        (("--out", "no/where/r.csv"), "no/where"),
        ((), "Missing option '--out'"),
    ],
)
def test_what_is_refused_is_refused_in_a_line(run, sheet, contents, arguments, message):
    before = contents()
    found = run("simulate", sheet, *arguments)
    assert found.code == 2
    assert message in found.err
    assert len([line for line in found.err.splitlines() if "error" in line]) == 1
    assert contents() == before


@pytest.mark.slow
def test_a_plan_is_measured_where_it_says(run, folder, sheet):
    assert run("calibrate", sheet, "--plan", "4", "--random", "9", "--csv", "plan.csv", "--json", "p.json").code == 0
    assert run("simulate", sheet, "--trajectory", "plan.csv", "--out", "r.csv").code == 0
    plan, readings = (
        [[float(row[f"joint{k} [deg]"]) for k in range(1, 5)] for row in rows(folder / name)]
        for name in ("plan.csv", "r.csv")
    )
    assert readings == plan
    refused = run("calibrate", sheet, "--forecast", "--csv", "x.csv")
    assert "--csv belongs to --plan" in refused.err
