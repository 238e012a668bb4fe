"""An arm calibrated: plan, readings, fit, and what the calibrated arm leaves at poses never measured."""

from __future__ import annotations

import numpy as np
import pytest

from journeys.arms import Pinocchio, rows_of

pytestmark = pytest.mark.slow

POINT = "50 30 20 mm"
TARGET = np.array([0.05, 0.03, 0.02])
READINGS, STD = 12, 20e-6
UNIT, SEED = 7, 4


def joints_of(row, poses) -> dict[str, float]:
    return {name: row[name] for name in poses}


def test_calibrate(desk, arm, record_property):
    sheet = desk.begin(arm)
    plan = desk.json("calibrate", sheet, "--plan", READINGS, "--random", 40, "--point", POINT, "--csv", "plan.csv")
    rows = rows_of(desk.folder / "plan.csv")
    names = list(rows[0])
    assert [list(one["q"].values()) for one in plan["chosen"]] == pytest.approx(
        np.array([list(r.values()) for r in rows])
    )

    # one robot by the command
    robot = ("--unit", UNIT, "--seed", SEED)
    said = desk.run(
        "simulate", sheet, "--trajectory", "plan.csv", *robot, "--point", POINT, "--out", "readings.csv"
    ).err
    assert f"of robot {UNIT} of seed {SEED} of {sheet}" in said
    fitted = desk.json(
        "calibrate", sheet, "readings.csv", "--point", POINT, "--sheet", "mine.errors.yaml", "--urdf", "m.urdf"
    )
    assert fitted["verdict"] == "agrees"
    assert fitted["readings"] == READINGS

    # what it leaves at 300 poses that were never measured
    (desk.folder / "far.yaml").write_text("random: {count: 300, seed: 11}\n")
    desk.run("simulate", sheet, "--grid", "far.yaml", *robot, "--std", "1e-6 mm", "--out", "truth.csv")
    truth = rows_of(desk.folder / "truth.csv")
    poses = [joints_of(row, names) for row in truth]
    there = np.array([[row[axis] for axis in "xyz"] for row in truth])
    nominal = Pinocchio(arm.urdf(desk.folder), arm.tip).points(poses)
    found = desk.json("map", "mine.errors.yaml", "--grid", "far.yaml", "--verify", 0)
    forecast = forecast_of(found, 300)
    left = there - nominal - forecast[0]
    ratio = np.sqrt((left**2).sum(axis=1).mean() / np.trace(forecast[1], axis1=1, axis2=2).mean())
    before = np.sqrt(((there - nominal) ** 2).sum(axis=1).mean())
    after = np.sqrt((left**2).sum(axis=1).mean())
    record_property(
        "numbers", f"{arm.name}: before {1e3 * before:.4f} mm, left {1e3 * after:.4f} mm, of forecast {ratio:.2f}"
    )
    print(arm.name, before, after, ratio)
    assert 0.4 < ratio < 2.0
    assert after < before / 4


def forecast_of(found, count):
    """Return the mean ``(P, 3)`` and covariance ``(P, 3, 3)`` of the position's error in the JSON of a map."""
    poses = found["poses"]
    assert len(poses) == count
    return np.array([p["mean"][:3] for p in poses]), np.array([np.array(p["covariance"])[:3, :3] for p in poses])
