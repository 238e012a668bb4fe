"""``map`` and ``path``: tables, files, exit codes."""

from __future__ import annotations

import json

import pytest
from scipy import stats

from cli.conftest import LONG

SHEET = "4dof.errors.yaml"
GRID = """
plane:
  origin: 1 0.2 0.3 m
  u: {direction: 1 0 0, values: 0 1000 4000 mm}
  v: {direction: 0 1 0, values: 0 300 mm}
orientations: {axis: 0 0 -1, tool_axis: 1 0 0}
"""


@pytest.mark.slow
def test_a_grid_is_mapped_and_the_first_lines_answer(run, folder, new_files):
    (folder / "grid.yaml").write_text(GRID)
    done = run("map", SHEET, "--grid", "grid.yaml", "--spec", "1 m", "--relative-to", "paper", "--json", "map.json")
    assert done.code == 0
    lines = done.out.splitlines()
    assert max(map(len, lines)) <= 100
    assert "map of 6 poses: 4 reached, 2 unreachable" in done.out
    assert "2 of 6 poses cannot be reached and are not judged" in done.out
    assert ": MET - worst" in done.out
    made = json.loads((folder / "map.json").read_text())
    assert made["schema"] == "precision-pin/map/1"
    assert made["spec"][0]["met"] is True
    assert made["spec"][0]["judged"] == 4
    assert [pose["status"] for pose in made["poses"]].count("unreachable") == 2
    assert new_files() == {"grid.yaml", "map.json"}
    assert run("map", SHEET, "--grid", "grid.yaml", "--spec", "1 mm", "--quiet").code == 1


ARM = {
    "arm.urdf": """<robot name="arm"><link name="base"/><link name="upper"/><link name="tool"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/><origin xyz="0.7 0 0"/></joint></robot>""",
    "arm.errors.yaml": """precision-pin: 1
robot: arm.urdf
tip: tool
gravity: none
poses: {a1: 0 deg, a2: 0.1 deg, a3: 0.2 deg, b1: 90 deg, b2: 90.1 deg, b3: 90.2 deg, b4: 89.9 deg, b5: 89.8 deg}
sources:
  - frame: {frame: tool, x: LAW, z: {normal: 0.1 mm}}
  - joint_offset: {joint: shoulder, offset: {normal: {std: 0.42 mrad}}}
""",
}


@pytest.mark.parametrize(
    ("law", "spec", "closed", "share"),
    [
        # beyond 1 mm with the upper value of 1.2 mm alone, which 1.5 % of robots have
        ("{two_point: 0.6 mm, centre: 0.6 mm, probability: 0.015}", "x 1 mm @ 99 %", 0.99996, 0.985),
        ("{two_point: 0.6 mm, centre: 0.6 mm, probability: 0.005}", "x 1 mm @ 99 %", 0.99996, 0.995),
        # mean and standard deviation 1 mm: ln x has the variance ln 2 and the mean -ln 2/2, and 2.0811 = (ln 4 + ln 2/2)/√ln 2
        ("{lognormal: {std: 1 mm}, mean: 1 mm}", "x 4 mm @ 99 %", stats.norm.cdf(3), stats.norm.cdf(2.0811)),
        # 1 mm to one side or the other
        ("{two_point: 1 mm}", "x 1.01 mm @ 95 %", stats.norm.cdf(1.01) - stats.norm.cdf(-1.01), 1.0),
    ],
)  # fmt: skip
def test_the_verdict_is_that_of_the_exact_law_and_not_of_the_closed_form(run, folder, law, spec, closed, share):
    for name, text in ARM.items():
        (folder / name).write_text(text.replace("LAW", law))
    done = run("map", "arm.errors.yaml", "--all-poses", "--spec", spec, "--json", "map.json")
    written = json.loads((folder / "map.json").read_text())
    made, poses = written["spec"][0], written["poses"]
    assert poses[0]["probability"][0] == pytest.approx(closed, abs=2e-3)
    required = made["required"]
    assert (share >= required) != (closed >= required) or share == 0.995
    assert made["met"] == (share >= required)
    assert f": {'MET' if share >= required else 'NOT MET'} - worst" in done.out
    assert done.code == (0 if share >= required else 1)
    for pose in poses[:3]:
        (low, high), (least, most) = pose["judged"]["interval"][0], pose["probability_bounds"][0]
        assert low <= share <= high
        assert least <= share <= most + 1e-12
        assert pose["judged"]["verdict"] == ["met" if share >= required else "not met"]
    if share < required:
        assert made["worst_pose"] in ("a1", "a2", "a3")
        assert made["sampled"]["interval"][1] < required


@pytest.mark.slow
def test_the_map_as_netcdf(run, folder, new_files):
    pytest.importorskip("xarray")
    (folder / "grid.yaml").write_text(GRID)
    assert run("map", SHEET, "--grid", "grid.yaml", "--verify", "0", "--netcdf", "map.nc").code == 0
    assert new_files() == {"grid.yaml", "map.nc"}


def test_a_json_that_is_too_large_is_refused_before_the_work(run, new_files, monkeypatch):
    monkeypatch.setattr("precision_pin.analyses.map.map_poses.LARGEST_FILE", 1000)
    monkeypatch.setattr("precision_pin.analyses.map.map_poses.first_order", None)
    for options in (("--json", "map.json"), ("--json", "-"), ("--out", "plots")):
        refused = run("map", SHEET, *options)
        assert (refused.code, refused.out) == (2, "")
        assert "the JSON of a map of" in refused.err
        assert "write it as netCDF (--netcdf" in refused.err
    assert new_files() == set()


# path ----------------------------------------------------------------------------------------------------------------

FEW = ("--samples", "500")


@pytest.fixture
def way(folder):
    (folder / "way.csv").write_text(f"t,y_axis [mm],{LONG} [deg]\n0,-200,0\n2,0,45\n8,300,-30\n")
    return ("path", "gantry.errors.yaml", "--trajectory", "way.csv")


@pytest.mark.slow
def test_table_json_and_plot_of_a_path(run, folder, way):
    done = run(*way, "--step", "1 s", *FEW, "--spec", "1 mm", "--out", "plots")
    assert done.code == 0
    assert done.out.startswith("largest error along the path: 95 % of robots within |d|")
    assert "a path of 9 poses, 8 s" in done.out
    assert "spec |d| within 1 mm for 95 % along the whole path: MET" in done.out
    assert (folder / "plots" / "path.svg").exists()
    saved = json.loads((folder / "plots" / "path.json").read_text())
    assert saved["poses"][-1]["time"] == 8.0
    assert saved["poses"][0]["q"]["y_axis"] == pytest.approx(-0.2)
    # the joint is off by 0.3 mrad as 3 σ wherever it stands, and nothing else turns the tool
    within = saved["maximum"]["attitude"]["quantile_interval"]["0.95"]
    assert within[0] <= 1.96 * 0.1e-3 <= within[1]
    low, high = saved["band"]["attitude"]["factor_interval"]
    assert low <= 1.96 * 0.1e-3 / saved["poses"][0]["attitude"]["quantile"] <= high
    assert run(*way, *FEW, "--spec", "0.01 mm", "--quiet").code == 1


def test_a_path_that_takes_long_is_refused_with_the_time_unless_its_robots_are_asked_for(run, way, monkeypatch):
    monkeypatch.setattr("precision_pin.analyses.path._LONG", 2 * 3 * 10_000 - 1)
    monkeypatch.setattr("precision_pin.analyses.path._LOOKED", 0.0)
    refused = run(*way)
    assert refused.code == 2
    assert "error E_USAGE: 3 poses with 10,000 robots each take about 0 minutes here; --samples 1000" in refused.err
    assert run(*way, "--samples", "10000").code == 0
    monkeypatch.setattr("precision_pin.analyses.path._LONG", 2 * 3 * 10_000)
    assert run(*way).code == 0
