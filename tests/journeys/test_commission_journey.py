"""An arm commissioned: its poses mapped, a test by ISO 9283 forecast and measured, tolerances from several robots."""

from __future__ import annotations

import numpy as np
import pytest

from journeys.arms import SLIDES, rows_of, text_of
from journeys.tolerances import ranked

pytestmark = pytest.mark.slow

CYCLES, ROBOTS = 10, 4
HAS_VISITS = {"ur5", "panda"}
"""Arms whose shipped sheet says how well a pose is repeated."""
SHOP = "scara"
"""The arm of which several are measured, which takes as long as all the rest."""


def test_commission(desk, arm, record_property):
    sheet = desk.begin(arm)
    joints = list(desk.json("analyze", sheet, "--samples", 10)["pose"]["q"])
    (desk.folder / "cell.yaml").write_text("random: {count: 40, seed: 2}\n")
    poses = desk.json("map", sheet, "--grid", "cell.yaml", "--verify", 0)["poses"]
    assert len(poses) == 40
    if arm.name not in HAS_VISITS:
        step = {name: "mm" if name in SLIDES else "deg" for name in joints}
        desk.edit(sheet, *(
            f"  - joint_offset: {{joint: {name}, offset: {{normal: 0.01 {unit}, scope: visit}}}}" for name, unit in step.items()
        ))  # fmt: skip
    reached = [one for one in poses if one["status"] == "reached"]
    worst = sorted(reached, key=lambda one: -np.trace(np.array(one["covariance"])[:3, :3]))[:5]
    asked = [part for one in worst for part in ("--q", text_of(dict(zip(joints, one["q"], strict=True))))]

    # a test of one robot, forecast and measured
    forecast = desk.json("iso9283", sheet, *asked, "--robots", 300, "--cycles", CYCLES)
    desk.run("simulate", sheet, *asked, "--cycles", CYCLES, "--unit", 11, "--std", "0.001 mm", "--out", "cycles.csv")
    beside = desk.json("iso9283", sheet, *asked, "--robots", 300, "--measured", "cycles.csv")
    assert beside["measured"]["agrees"] is True
    rows = rows_of(desk.folder / "cycles.csv")
    for rank in range(1, 6):
        attained = np.array([[row[axis] for axis in "xyz"] for row in rows if row["pose"] == f"P{rank}"])
        assert len(attained) == CYCLES
        away = np.linalg.norm(attained - attained.mean(axis=0), axis=1)
        commanded = np.array(forecast["poses"][f"P{rank}"]["position"])
        found = beside["measured"]["poses"][f"P{rank}"]
        assert found["AP"] == pytest.approx(np.linalg.norm(attained.mean(axis=0) - commanded), abs=2e-9)
        assert found["RP"] == pytest.approx(away.mean() + 3 * away.std(ddof=1), abs=2e-9)
    wider = desk.run("simulate", sheet, *asked, "--cycles", CYCLES, "--std", "1 mm", "--out", "far.csv").err
    assert "std 1 mm" in wider
    assert desk.json("iso9283", sheet, *asked, "--robots", 300, "--measured", "far.csv")["measured"]["agrees"] is False
    numbers = (
        f"commission {arm.name}: RP at P1 {1e3 * beside['measured']['poses']['P1']['RP']:.4f} mm measured, "
        f"{1e3 * forecast['poses']['P1']['RP']['quantiles']['0.5']:.4f} mm forecast (median)"
    )
    if arm.name != SHOP:
        record_property("numbers", numbers)
        return

    # four robots of a shop whose largest zero error is twice what the sheet says
    causes = ranked(desk.folder / sheet, desk.json("budget", sheet, "--samples", 1024))
    # lengths along one line show as their sum only
    cause = next(one for one in causes if one.path.startswith("joint_offset"))
    (desk.folder / "spots.yaml").write_text("random: {count: 8, seed: 5}\n")
    files = [f"robot{unit}.csv" for unit in range(ROBOTS)]
    point = ("--point", "50 30 20 mm")
    for unit, file in enumerate(files):
        desk.run(
            "simulate",
            sheet,
            "--grid",
            "spots.yaml",
            "--unit",
            unit,
            "--seed",
            1,
            *point,
            "--set",
            cause.times(2),
            "--out",
            file,
        )
    desk.run("calibrate", sheet, files[-1], *point, "--json", "robot.json")
    files[-1] = "robot.json"
    shop = desk.json("calibrate", sheet, "--population", *files, *point, "--sheet", "shop.errors.yaml")
    scale = next(
        one
        for one in shop["tolerances"]
        if any(name.startswith(cause.path.rpartition(".")[0]) for name in one["draws"])
    )
    assert scale["low"] < 2 < scale["high"]
    before, after = (desk.json("analyze", name, "--samples", 5000) for name in (sheet, "shop.errors.yaml"))
    spreads = [one["position"]["norm"]["quantiles"]["0.95"] for one in (before, after)]
    record_property(
        "numbers",
        f"{numbers}; {cause.path} drawn twice as wide, found × {scale['scale']:.2f} ({scale['low']:.2f} to "
        f"{scale['high']:.2f}); 95 % within {1e3 * spreads[0]:.3f} mm by the sheet, {1e3 * spreads[1]:.3f} mm by the shop's",
    )
