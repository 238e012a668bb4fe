"""``precision-pin path``: first lines, JSON, plot, exit codes, what is refused in one line."""

from __future__ import annotations

import pytest

SHEET = "gantry.errors.yaml"
LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"
FEW = ("--samples", "500")


@pytest.fixture
def way(folder):
    (folder / "way.csv").write_text(f"t,y_axis [mm],{LONG} [deg]\n0,-200,0\n2,0,45\n8,300,-30\n")
    return "way.csv"


@pytest.mark.slow
def test_table_json_and_plot(run, folder, way):
    done = run("path", SHEET, "--trajectory", way, "--step", "1 s", *FEW, "--spec", "1 mm", "--out", "plots")
    assert done.code == 0
    assert done.out.startswith("largest error along the path: 95 % of robots within |d|")
    assert "a path of 9 poses, 8 s" in done.out
    assert "spec |d| within 1 mm for 95 % along the whole path: MET" in done.out
    assert (folder / "plots" / "path.svg").exists()
    saved = run("path", SHEET, "--trajectory", way, "--step", "1 s", *FEW, "--spec", "1 mm", "--json", "-")
    assert saved.json["poses"][-1]["time"] == 8.0
    assert saved.json["poses"][0]["q"]["y_axis"] == pytest.approx(-0.2)
    # the joint is off by 0.3 mrad as 3 σ wherever it stands, and nothing else turns the tool
    within = saved.json["maximum"]["attitude"]["quantile_interval"]["0.95"]
    assert within[0] <= 1.96 * 0.1e-3 <= within[1]
    low, high = saved.json["band"]["attitude"]["factor_interval"]
    assert low <= 1.96 * 0.1e-3 / saved.json["poses"][0]["attitude"]["quantile"] <= high
    assert run("path", SHEET, "--trajectory", way, *FEW, "--spec", "0.01 mm", "--quiet").code == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--pose", "home"), "a path has two poses or more"),
        (("--all-poses", "--samples", "10"), "10 samples do not resolve the 95 % quantile"),
        (("--all-poses", "--probability", "2"), "--probability '2'"),
    ],
)
def test_what_is_refused_in_one_line(run, way, options, message):
    refused = run("path", SHEET, *options)
    assert refused.code == 2
    assert message in refused.err
    assert not refused.out


def test_a_path_that_takes_long_is_refused_with_the_time_unless_its_robots_are_asked_for(run, way, monkeypatch):
    monkeypatch.setattr("precision_pin.analyses.path._LONG", 2 * 3 * 10_000 - 1)
    monkeypatch.setattr("precision_pin.analyses.path._LOOKED", 0.0)
    refused = run("path", SHEET, "--trajectory", way)
    assert refused.code == 2
    assert "error E_USAGE: 3 poses with 10,000 robots each take about 0 minutes here; --samples 1000" in refused.err
    assert run("path", SHEET, "--trajectory", way, "--samples", "10000").code == 0
    monkeypatch.setattr("precision_pin.analyses.path._LONG", 2 * 3 * 10_000)
    assert run("path", SHEET, "--trajectory", way).code == 0
