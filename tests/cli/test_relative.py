"""``analyze --relative-to``: the other pose by name or values, the first lines, the exit code, what is refused."""

from __future__ import annotations

import math

import pytest

SHEET = "gantry.errors.yaml"
FEW = ("--samples", "500")


@pytest.mark.slow
def test_the_other_pose_by_name_and_by_values(run, folder):
    named = run("analyze", SHEET, "--relative-to", "home", *FEW, "--json", "-")
    by_values = run("analyze", SHEET, "--relative-to", "0 mm, 0 deg", *FEW, "--json", "-")
    assert named.code == by_values.code == 0
    assert named.json["relative_to"]["name"] == "home"
    # an offset of the slide moves the tip alike at both poses; the joint, ± 0.3 mrad as
    # 3 σ, moves the tip by the chord between both lever arms of 0.5 m
    assert named.json["position"] == by_values.json["position"]
    spread = 0.1e-3 * 0.5 * 2 * math.sin(math.radians(15))
    total = math.hypot(*(named.json["position"][axis]["std"] for axis in "xyz"))
    assert total == pytest.approx(spread, rel=0.15)
    table = run("analyze", SHEET, "--relative-to", "home", *FEW, "--spec", "0.001 mm", "--out", "plots")
    assert table.code == 1
    assert "relative to the same robots at pose 'home' (" in table.out
    assert "spec |d| within 0.001 mm for 95 %: NOT MET" in table.out
    assert (folder / "plots" / "position.png").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--relative-to", "nowhere"), "no pose"),
        (("--relative-to", "0 mm"), "as joint values:"),
        (("--relative-to", "home", "--all-poses"), "--relative-to is for one pose"),
        (("--relative-to", "home", "--until", "95 % to 0.01 mm"), "--until and --relative-to exclude each other"),
        (("--relative-to", "home", "--processes", "2"), "--processes and --relative-to exclude each other"),
        (("--relative-to", "home", "--spec", "1 mm", "--spec-everywhere"), "--spec-everywhere and --relative-to"),
    ],
)
def test_what_is_refused_in_one_line(run, options, message):
    refused = run("analyze", SHEET, *options, *FEW)
    assert refused.code == 2
    assert message in refused.err
    assert not refused.out
