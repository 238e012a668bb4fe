"""An arm calibrated: plan, readings, fit, and what the calibrated arm leaves at poses never measured."""

from __future__ import annotations

import numpy as np
import pytest

from journeys.arms import Pinocchio, rows_of, text_of
from journeys.every_command import READERS, codes

pytestmark = [pytest.mark.slow, pytest.mark.parametrize("arm", ["panda", "gantry"], indirect=True)]

POINT = "50 30 20 mm"
TARGET = np.array([0.05, 0.03, 0.02])
READINGS, STD = 12, 20e-6
ROBOT = ("--seed", 4)
UNIT = 7
BY_PINOCCHIO = {"4dof", "gantry", "scara"}
"""Arms whose readings are taken by Pinocchio too: their sheets have no draws for a visit, which differ from file to file."""


def test_calibrate(desk, arm, record_property):
    sheet = desk.begin(arm)
    plan = desk.json("calibrate", sheet, "--plan", READINGS, "--random", 20, "--point", POINT, "--csv", "plan.csv")
    rows = rows_of(desk.folder / "plan.csv")
    names = list(rows[0])
    assert np.array([list(one["q"].values()) for one in plan["chosen"]]) == pytest.approx(
        np.array([list(row.values()) for row in rows]), rel=1e-12, abs=1e-13
    )

    # one robot by the command
    robot = (*ROBOT, "--unit", UNIT)
    given = ("--trajectory", "plan.csv", "--point", POINT, "--out", "readings.csv")
    assert f"of robot {UNIT} of seed 4 of {sheet}" in desk.run("simulate", sheet, *robot, *given).err
    files = ("--sheet", "mine.errors.yaml", "--urdf", "mine.urdf")
    fitted = desk.json("calibrate", sheet, "readings.csv", "--point", POINT, *files)
    assert fitted["verdict"] == "agrees"

    # the error left at 120 poses that were never measured, against its forecast
    (desk.folder / "far.yaml").write_text("random: {count: 120, seed: 11}\n")
    desk.run("simulate", sheet, "--grid", "far.yaml", *robot, "--std", "1e-6 mm", "--out", "truth.csv")
    truth = rows_of(desk.folder / "truth.csv")
    poses = [{name: row[name] for name in names} for row in truth]
    nominal = Pinocchio(arm.urdf(desk.folder), arm.tip)
    error = np.array([[row[axis] for axis in "xyz"] for row in truth]) - nominal.points(poses)
    found = desk.json("map", "mine.errors.yaml", "--grid", "far.yaml", "--verify", 0)["poses"]
    left = error - np.array([one["mean"][:3] for one in found])
    forecast = np.sqrt(np.mean([np.trace(np.array(one["covariance"])[:3, :3]) for one in found]))
    before, after = (np.sqrt((each**2).sum(axis=1).mean()) for each in (error, left))
    # one robot: its error is one draw of some ten numbers, whose root mean square is within these of its expectation
    assert 0.4 < after / forecast < 2.0
    assert after < before / 4
    said = f"before {1e3 * before:.4f} mm, left {1e3 * after:.4f} mm = {after / forecast:.2f} of its forecast"

    if arm.name in BY_PINOCCHIO:
        said += f"; by Pinocchio's readings {by_pinocchio(desk, arm, sheet, rows, fitted):.2f} of its deviation away"
    # test_pairs runs every command on the calibrated sheet of an arm of four joints, and these are slow
    for command, arguments in READERS.items() if arm.name == "panda" else ():
        if command not in ("report", "allocate", "budget", "exact-law", "view", "compare"):
            desk.run(command, "mine.errors.yaml", *arguments, code=codes(command))
    record_property("numbers", f"calibrate {arm.name}: {said}")


def by_pinocchio(desk, arm, sheet, rows, fitted) -> float:
    """Calibrate by readings of the same robot that Pinocchio takes of its URDF for each pose; return the distance of both fits.

    In units of the standard deviation of the first pose's error after either of them.
    """
    noise = np.random.default_rng(6).normal(0, STD, (len(rows), 3))
    lines = (desk.folder / "plan.csv").read_text().splitlines()
    table = [f"{lines[0]},x [m],y [m],z [m]"]
    for k, q in enumerate(rows):
        desk.run("export", sheet, "--seed", 4, "--first", UNIT, "--q", text_of(q), "--out", f"at{k}")
        (file,) = (desk.folder / f"at{k}").glob("*.urdf")
        point = Pinocchio(file, arm.tip).points([q], TARGET)[0]
        if k == 0:
            exact = rows_of_one(desk, sheet, text_of(q))
            assert point == pytest.approx(exact, abs=6e-9)  # noise of 1 nm
        table.append(f"{lines[k + 1]},{','.join(map(repr, (point + noise[k]).tolist()))}")
    (desk.folder / "pinocchio.csv").write_text("\n".join(table) + "\n")
    other = desk.json("calibrate", sheet, "pinocchio.csv", "--point", POINT)
    assert other["verdict"] == "agrees"
    # two fits of one robot with different noise: estimates of what is learned differ by no more than their deviations say
    apart = [
        (other["posterior"]["mean"][name] - mean) / fitted["posterior"]["std"][name]
        for name, mean in fitted["posterior"]["mean"].items()
    ]
    rms = float(np.sqrt(np.mean(np.square(apart))))
    assert rms < 2
    return rms


def rows_of_one(desk, sheet, q) -> np.ndarray:
    """Return the place of the target at one pose, without noise, by the command."""
    robot = (*ROBOT, "--unit", UNIT, "--point", POINT, "--std", "1e-6 mm")
    desk.run("simulate", sheet, "--q", q, *robot, "--out", "one.csv")
    (row,) = rows_of(desk.folder / "one.csv")
    return np.array([row[axis] for axis in "xyz"])
