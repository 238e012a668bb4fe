"""``precision-pin map``: table, files, exit codes, wrong input."""

from __future__ import annotations

import json

import pytest

SHEET = "4dof.errors.yaml"
GRID = """
plane:
  origin: 1 0.2 0.3 m
  u: {direction: 1 0 0, values: 0 1000 4000 mm}
  v: {direction: 0 1 0, values: 0 300 mm}
orientations: {axis: 0 0 -1, tool_axis: 1 0 0}
"""


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


@pytest.mark.slow
def test_files(run, folder, new_files):
    pytest.importorskip("xarray")
    (folder / "grid.yaml").write_text(GRID)
    assert run("map", SHEET, "--grid", "grid.yaml", "--out", "made", "--netcdf", "map.nc").code == 0
    names = {"map.json"} | {f"{name}.{suffix}" for name in ("position", "attitude") for suffix in ("png", "svg")}
    assert new_files() == {"grid.yaml", "map.nc", "made"} | {f"made/{name}" for name in names}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--relative-to", "nowhere"), "--relative-to: no pose named 'nowhere'"),
        (("--samples", "0"), "the number of samples must be a whole number from 1"),
        (("--verify", "-1"), "verify, a number of poses, must be a whole number from 0"),
        (("--netcdf", "nowhere/map.nc"), "nowhere does not exist"),
    ],
)
def test_wrong_input_is_one_line(run, new_files, options, message):
    done = run("map", SHEET, *options)
    assert done.code == 2
    assert len(done.said) == 1
    assert message in done.said[0]
    assert new_files() == set()
