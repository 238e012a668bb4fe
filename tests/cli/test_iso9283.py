"""``iso9283``: poses in any form, the table's first line, files, measured cycles, what is refused."""

from __future__ import annotations

import json

import pytest

SHEET = "visits.errors.yaml"
FEW = ("--robots", "60", "--cycles", "4")
LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"
FIVE = [
    arg
    for q in ("0 0", "250 20", "-250 -30", "300 -10", "-100 40")
    for arg in ("--q", "{} mm, {} deg".format(*q.split()))
]


@pytest.fixture(autouse=True)
def sheet(folder):
    """Add to the gantry what changes from visit to visit."""
    text = (folder / "gantry.errors.yaml").read_text(encoding="utf-8")
    (folder / SHEET).write_text(
        f"{text}  - joint_offset: {{joint: {LONG}, offset: {{normal: 0.02 mrad, scope: visit}}}}\n", encoding="utf-8"
    )


@pytest.mark.slow
def test_five_poses(run):
    found = run("iso9283", SHEET, *FIVE, *FEW, "--robots", "200")
    assert found.code == 2  # --robots twice
    found = run("iso9283", SHEET, *FIVE, "--robots", "200")
    assert found.code == 0
    lines = found.out.splitlines()
    assert lines[0].startswith("95 % of robots built will show RP of ")
    assert max(map(len, lines)) <= 100
    assert {"P1", "P2", "P3", "P4", "P5", "AD", "RD", "E", "vAP:"} <= {line.split()[0] for line in lines if line}
    data = run("iso9283", SHEET, *FIVE, "--robots", "200", "--json", "-").json
    assert data["schema"] == "precision-pin/iso9283/1"
    assert (data["cycles"], data["robots"]) == (30, 200)
    assert data["poses"]["P2"]["q"]["y_axis"] == pytest.approx(0.25)
    shown = f"{1e3 * data['worst']['RP']['quantiles']['0.95']:.3g}"
    assert lines[0].split(" of ")[2].startswith(shown[:4])


def test_poses_by_name_and_all_of_the_sheet(run):
    named = run("iso9283", SHEET, "--pose", "out", "--pose", "home", *FEW, "--json", "-")
    assert named.out == run("iso9283", SHEET, "--all-poses", *FEW, "--json", "-").out
    assert [pose["name"] for pose in named.json["poses"].values()] == ["out", "home"]
    assert named.json["AD"] is None
    assert "four poses" in named.json["absent"]["AD"]


def test_a_sheet_without_visits_says_that_it_cannot_tell(run):
    found = run("iso9283", "gantry.errors.yaml", "--pose", "home", *FEW)
    assert found.code == 0
    assert "W_NO_VISITS" in found.err
    assert found.out.splitlines()[0].startswith("RP is 0: nothing in the sheet changes")


def test_measured_cycles_stand_beside_the_forecast(run, folder):
    rows = ["pose,cycle,x [mm],y [mm],z [mm]"]
    rows += [f"home,{cycle},100,{offset},500" for cycle, offset in enumerate((0, 5, -5, 0), start=1)]
    (folder / "cycles.csv").write_text("\n".join(rows))
    found = run("iso9283", SHEET, "--all-poses", "--robots", "200", "--measured", "cycles.csv", "--json", "result.json")
    assert found.code == 0  # a robot that differs misses no specification
    assert "measured: DIFFERS" in found.out
    data = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert data["cycles"] == data["measured"]["cycles"] == 4
    # distances from the barycentre 0, 5, 5, 0 mm: 2.5 + 3 · 2.887
    assert data["measured"]["poses"]["P2"]["RP"] == pytest.approx((2.5 + 3 * (25 / 3) ** 0.5) * 1e-3)
    assert data["measured"]["agrees"] is False
    other = run("iso9283", SHEET, "--all-poses", "--robots", "200", "--cycles", "30", "--measured", "cycles.csv")
    assert other.code == 2
    assert "are 4, the forecast has 30 cycles" in other.err


def test_a_missed_limit_is_exit_code_1(run):
    kept = run("iso9283", SHEET, "--all-poses", "--robots", "200", "--spec", "RP 1 mm @ 95 %")
    assert kept.code == 0
    assert "spec RP within 1 mm for 95 % at every pose: MET - 100" in kept.out
    missed = run("iso9283", SHEET, "--all-poses", "--robots", "200", "--spec", "RP 1 um", "--spec", "AP 1 m")
    assert missed.code == 1
    assert "spec RP within 0.001 mm for 95 % at every pose: NOT MET" in missed.out
    assert "spec AP within 1000 mm for 95 % at every pose: MET" in missed.out


def test_a_target_off_the_last_axis(run):
    at_tip, at_side = (
        run("iso9283", SHEET, "--pose", "home", *FEW, *more, "--json", "-").json
        for more in ((), ("--target", "0 300 0 mm"))
    )
    assert at_side["target"] == [0, 0.3, 0]
    assert at_side["poses"]["P1"]["AP"]["mean"] != at_tip["poses"]["P1"]["AP"]["mean"]
    assert at_side["poses"]["P1"]["position"][1] == pytest.approx(at_tip["poses"]["P1"]["position"][1] + 0.3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--target", "1 2 mm"), "--target: '1 2 mm' has 2 numbers, expected 3"),
        (("--target", "1 2 3"), "--target: "),
        (("--spec", "1 mm"), "no figure of a specification named '1'"),
        (("--load", "3 mm"), "--load: "),
        (("--load", "3"), "--load: "),
        (("--cycles", "1"), "the number of cycles must be a whole number from 2"),
        (("--robots", "0"), "the number of robots must be a whole number from 1"),
        (("--measured", "nothing.csv"), "nothing.csv"),
        (("--fit-base",), "three poses or more"),
    ],
)
def test_what_is_refused_is_refused_in_a_line(run, arguments, message):
    found = run("iso9283", SHEET, *arguments)
    assert found.code == 2
    assert message in found.err
    assert not found.out
    assert len([line for line in found.err.splitlines() if "error" in line]) == 1
