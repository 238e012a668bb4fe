"""``allocate``, ``compare``, ``compensate``, ``iso9283``; ``--set`` and correlations: tables, files, exit codes."""

import csv
import json
import math
import re

import numpy as np
import pytest
from scipy import stats

from cli.conftest import GANTRY_SHEET, LONG
from precision_pin import Chain, ErrorModel
from support.plain_robot import joint, link, robot

SHEET = "4dof.errors.yaml"

# allocate ------------------------------------------------------------------------------------------------------------

PATHS = [f"axis_install[joint{k}].radius" for k in range(1, 5)]


def _sheet(folder, limit):
    entries = "".join(f"    - {{path: '{path}', cost: {{reciprocal: 1 mm}}}}\n" for path in PATHS)
    text = "# by hand\n" + (folder / SHEET).read_text() + f"\nallocate:\n  specs: ['{limit}']\n  tolerances:\n{entries}"
    (folder / "wanted.yaml").write_text(text)
    return "wanted.yaml"


@pytest.mark.slow
def test_tolerances_are_chosen_verified_and_written_as_a_sheet_with_the_front(run, refused, folder, new_files):
    done = run("allocate", _sheet(folder, "37.5 mm @ 95 %"), "--out", "made", "--pareto", "3")
    assert done.out.startswith("cost ")
    assert "cost against accuracy" in done.out
    files = {"allocation.json", "allocation.png", "allocation.svg", "allocated.errors.yaml"}
    assert new_files() == {"wanted.yaml", "made"} | {f"made/{name}" for name in files}
    result = json.loads((folder / "made/allocation.json").read_text())
    assert result["schema"] == "precision-pin/allocation/1"
    (spec,) = result["specs"]
    assert (spec["met"], spec["interval"][0] >= 0.95) == (True, True)
    assert [one["path"] for one in result["tolerances"]] == PATHS
    one, two, three = (point["cost"] for point in result["pareto"])
    assert one >= two >= three
    # the sheet by hand, with the tolerances in four digits, at most 0.1 % tighter, that keep the limit
    before, after = ((folder / name).read_text().splitlines() for name in ("wanted.yaml", "made/allocated.errors.yaml"))
    changed = {tuple(pair) for pair in zip(before, after, strict=True) if pair[0] != pair[1]}
    assert all("axis_install" in line or line.startswith("robot:") for line, _ in changed)
    written = [float(radius) for _, line in changed for radius in re.findall(r"radius: (\d\.\d+) mm", line)]
    assert len(written) == len(PATHS)
    assert all(len(f"{value:.12g}".lstrip("0.")) <= 4 for value in written)
    chosen = sorted(1e3 * one["after"] for one in result["tolerances"])
    ratios = np.array(sorted(written)) / chosen
    assert 0.999 < ratios.min() <= ratios.max() <= 1 + 1e-9
    assert len(ErrorModel.load(folder / "made/allocated.errors.yaml").poses) == len(result["poses"])
    refused("allocate", "wanted.yaml", "--pareto", "1")
    refused("allocate", "wanted.yaml", "--seconds", "0")


@pytest.mark.slow
def test_what_no_tolerance_can_meet_exits_with_1_and_writes_no_sheet(run, folder):
    done = run("allocate", _sheet(folder, "1 mm"), "--out", "made", code=1)
    said = " ".join(done.out.split())
    assert said.startswith(
        "no allocation was found that meets position.norm 1 mm @ 95 %: with every tolerance at its least 0.00 %"
    )
    assert "in the way: constant part 36.8 mm (no tolerance; compensate or calibrate removes it), " in said
    assert max(map(len, done.out.splitlines())) <= 100
    assert not (folder / "made/allocated.errors.yaml").exists()
    assert "no sheet is written" in done.err


@pytest.mark.slow
def test_what_is_to_be_allocated_is_read_by_check(run, refused, folder):
    text = (folder / _sheet(folder, "37.5 mm @ 95 %")).read_text()
    run("check", "wanted.yaml")
    for old, new, words in (
        ("reciprocal: 1 mm", "reciprocal: 1 mrad", "unit such as mm"),
        ("reciprocal: 1 mm", "reciprocal: 1e308 mm", "up to 1e+50 in SI"),
        ("reciprocal: 1 mm}", "reciprocal: 1 mm}, maxi: 1 mm", "E_NAME: no key of tolerances[0] named 'maxi'"),
        ("37.5 mm @ 95 %", "37.5 kg", "kg"),
        ("joint4].radius", "joint3].radius", "listed twice"),
        ("joint4].radius", "joint5].radius", "joint5"),
        ("  specs:", "  poses: [nowhere]\n  specs:", "nowhere"),
        ("  specs:", "  poses: nowhere\n  specs:", "list of names"),
        ("  specs:", "  specifications:", "specifications"),
    ):
        assert old in text
        (folder / "wanted.yaml").write_text(text.replace(old, new))
        assert words in run("check", "wanted.yaml", code=2).out


# compare -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_better_sheet_comes_first_and_the_verdicts_decide(run, folder):
    (folder / "tighter.yaml").write_text(GANTRY_SHEET.replace("uniform: 0.1 mm", "uniform: 0.05 mm"), "utf-8")
    few = ("--samples", "2000")
    asked = ("compare", "gantry.errors.yaml", "tighter.yaml", *few, "--pose", "home", "--spec")
    done = run(*asked, "y 0.16 mm @ 99.9 %", "--out", "plots", code=1)
    assert done.out.startswith("'tighter.yaml' is better than 'gantry.errors.yaml': 95 % of robots within |d|")
    assert "'gantry.errors.yaml': spec |dy| within 0.16 mm for 99.9 %: NOT MET" in done.out
    assert "joint_offset[y_axis].offset.uniform  0.1 mm  ->  0.05 mm" in done.out
    saved = json.loads((folder / "plots/comparison.json").read_text())
    assert (saved["schema"], saved["met"]["gantry.errors.yaml"]) == ("precision-pin/comparison/1", False)
    run(*asked, "y 1 mm @ 95 %", "--quiet")
    changed = run("compare", "gantry.errors.yaml", *few, "--all-poses", "--set", "joint_offset[y_axis].offset=±0.2 mm")
    assert changed.out.startswith("'gantry.errors.yaml --set' is worse than 'gantry.errors.yaml'")
    assert "pose 'out'" in changed.out
    assert "pose 'home'" in changed.out


# compensate ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_corrected_arm_stands_where_it_was_meant_to(run, folder):
    """The file is read by other commands: nominal pose at the corrected values plus the error there is the pose wanted."""
    done = run("compensate", SHEET, "--csv", "right.csv")
    lines = done.out.splitlines()
    assert lines[0].startswith("|d| at the means: from 36.77 mm at worst")
    assert "to 0 mm" in lines[0]
    assert any("position corrected" in line for line in lines)
    assert max(map(len, lines)) <= 100
    header, row = csv.reader((folder / "right.csv").read_text().splitlines())
    assert header == [f"joint{k} [deg]" for k in range(1, 5)]
    corrected = np.deg2rad([float(cell) for cell in row])
    words = [line.split() for line in lines]
    assert [[float(cell) for cell in line[2:]] for line in words if line[:1] and line[0] in ("joint1", "joint2")] == [
        pytest.approx([asked, math.degrees(to), math.degrees(to) - asked], abs=1e-4)
        for asked, to in zip((-90, 3), corrected, strict=False)
    ]
    error = run("analyze", SHEET, "--trajectory", "right.csv", "--samples", "1000", "--json", "-").json
    chain = Chain.from_urdf(folder / "4dof.urdf", tip="tool")
    wanted, reached = (chain.at(np.array(q)).pose[:3, 3] for q in (np.deg2rad([-90, 3, 88, -91]), corrected))
    assert reached + error["nominal"]["position"] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.slow
def test_a_trajectory_comes_back_with_its_columns_and_units(run, folder, new_files):
    header = ["t", "joint4 [mrad]", "joint3", "joint2 [deg]", "joint1 [deg]"]
    (folder / "way.csv").write_text(f"{','.join(header)}\n0,-1588,1.536,3,-90\n0.5,-1400,1.3,5,-70\n")
    run("compensate", SHEET, "--trajectory", "way.csv", "--csv", "right.csv", "--json", "right.json")
    first, *rows = csv.reader((folder / "right.csv").read_text().splitlines())
    assert first == header
    result = json.loads((folder / "right.json").read_text())
    assert result["schema"] == "precision-pin/compensation/1"
    table = np.array(rows, dtype=float) * [1, 1e-3, 1, math.pi / 180, math.pi / 180]
    assert table[:, 0].tolist() == [0, 0.5]
    assert table[:, :0:-1] == pytest.approx(np.array([pose["q_corrected"] for pose in result["poses"]]), abs=1e-12)
    assert np.abs([pose["after"]["position"] for pose in result["poses"]]).max() < 1e-9
    again = run("compensate", SHEET, "--trajectory", "right.csv", "--json", "-")
    assert again.json["poses"][0]["q"] == pytest.approx(result["poses"][0]["q_corrected"], abs=1e-12)
    assert new_files() == {"way.csv", "right.csv", "right.json"}


@pytest.mark.slow
def test_a_pose_without_a_correction_is_left_out_and_named(run, folder, new_files):
    """The stretched arm is singular: code 1, and the joint values of the other poses are as without it."""
    rows = ("-1.571,0.0524,1.536,-1.588", "0,0,0,0", "-1.4,0.1,1.3,-1.2")
    header = "joint1,joint2,joint3,joint4"
    for name, numbers in (("way", (0, 1, 2)), ("others", (0, 2)), ("none", (1,))):
        (folder / f"{name}.csv").write_text("\n".join([header, *(rows[k] for k in numbers)]))
    done = run("compensate", SHEET, "--trajectory", "way.csv", "--csv", "right.csv", "--out", "made", code=1)
    assert "1 of 3 poses have no correction: 'row 2' (singular)" in done.out
    assert "the corrected joint values lack 1 of 3 poses: 'row 2' (singular)" in done.err
    run("compensate", SHEET, "--trajectory", "others.csv", "--csv", "expected.csv")
    expected = (folder / "expected.csv").read_text()
    assert (folder / "right.csv").read_text() == (folder / "made/corrected.csv").read_text() == expected
    done = run("compensate", SHEET, "--trajectory", "none.csv", "--csv", "nothing.csv", code=1)
    assert "lack 1 of 1 poses: 'row 1' (singular); they are not written" in done.err
    assert not (folder / "nothing.csv").exists()


@pytest.mark.slow
def test_all_prints_every_row_of_a_long_table(run, folder):
    """30 poses: without --all the tables have fewer, and say so."""
    rows = [f"{-1.5 + k / 100},0.1,1.3,-1.2" for k in range(30)]
    (folder / "way.csv").write_text("\n".join(["joint1,joint2,joint3,joint4", *rows]))
    few = {"path": ("--samples", "500"), "map": ("--verify", "1", "--samples", "500"), "compensate": ()}
    for command, more in few.items():
        asked = (command, SHEET, "--trajectory", "way.csv", *more)
        cut, every = (run(*asked, *option).out for option in ((), ("--all",)))
        tables = 2 if command == "compensate" else 1
        assert len(re.findall("(?m)^'?row ", every)) == 30 * tables
        count = len(re.findall("(?m)^'?row ", cut)) // tables
        assert f"and {30 - count} more poses: --all" in cut
        assert "--all" not in every


@pytest.mark.slow
def test_view_shows_the_compensation(run, refused, folder):
    (folder / "way.csv").write_text("joint4 joint3 joint2 q1\n-1.588 1.536 0.0524 -1.571\n-1.4 1.3 0.1 -1.2\n")
    asked = ("view", SHEET, "--samples", "200", "--columns", "q1=joint1", "--compensate")
    run(*asked, "way.csv", "--out", "page.html")
    assert "at the means: from" in (folder / "page.html").read_text("utf-8")
    refused(*asked, "nosuch.csv", "--out", "other.html")


# iso9283 -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def visits(folder):
    """Add to the gantry what changes from visit to visit."""
    more = f"  - joint_offset: {{joint: {LONG}, offset: {{normal: 0.02 mrad, scope: visit}}}}\n"
    (folder / "visits.errors.yaml").write_text(GANTRY_SHEET + more, encoding="utf-8")
    return "visits.errors.yaml"


@pytest.mark.slow
def test_five_poses_and_a_target(run, folder, visits):
    values = ("0 mm, 0 deg", "250 mm, 20 deg", "-250 mm, -30 deg", "300 mm, -10 deg", "-100 mm, 40 deg")
    five = ("iso9283", visits, *(word for q in values for word in ("--q", q)), "--robots", "200")
    found = run(*five, "--target", "0 300 0 mm", "--json", "result.json").out
    assert {"P1", "P2", "P3", "P4", "P5", "AD", "RD", "E", "vAP:"} <= {
        line.split()[0] for line in found.splitlines() if line
    }
    data = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert data["schema"] == "precision-pin/iso9283/1"
    assert (data["cycles"], data["robots"], data["target"]) == (30, 200, [0, 0.3, 0])
    assert data["poses"]["P2"]["q"]["y_axis"] == pytest.approx(0.25)
    assert data["poses"]["P1"]["position"] == pytest.approx([0.1, 0.3, 0.5])
    shown = f"{1e3 * data['worst']['RP']['quantiles']['0.95']:.3g}"
    assert found.startswith(f"95 % of robots built will show RP of {shown[:4]}")
    still = run("iso9283", "gantry.errors.yaml", "--pose", "home", "--robots", "60", "--cycles", "4")
    assert "W_NO_VISITS" in still.err
    assert still.out.startswith("RP is 0: nothing in the sheet changes")


def test_measured_cycles_stand_beside_the_forecast(run, refused, folder, visits):
    rows = "".join(f"home,{cycle},100,{offset},500\n" for cycle, offset in enumerate((0, 5, -5, 0), start=1))
    (folder / "cycles.csv").write_text(f"pose,cycle,x [mm],y [mm],z [mm]\n{rows}")
    asked = ("iso9283", visits, "--all-poses", "--robots", "200", "--measured", "cycles.csv")
    # a robot that differs misses no specification
    assert "measured: DIFFERS" in run(*asked, "--json", "result.json").out
    data = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert data["cycles"] == data["measured"]["cycles"] == 4
    # distances from the barycentre 0, 5, 5, 0 mm: 2.5 + 3 · 2.887
    assert data["measured"]["poses"]["P2"]["RP"] == pytest.approx((2.5 + 3 * (25 / 3) ** 0.5) * 1e-3)
    assert data["measured"]["agrees"] is False
    assert "are 4, the forecast has 30 cycles" in refused(*asked, "--cycles", "30")


@pytest.mark.slow
def test_measured_cycles_and_poses_of_others_share_an_option(run, refused, folder, visits):
    rows = "".join(f"P1,{cycle},100,{offset},500\n" for cycle, offset in enumerate((0, 5, -5, 0), start=1))
    (folder / "theirs.csv").write_text("pose;n;px;py;pz\n" + rows.replace(",", ";"))
    (folder / "poses.csv").write_text("q1 q2\n0 0\n")
    columns = f"q1=y_axis [m], q2={LONG} [deg], n=cycle, px=x, py=y, pz=z, *=[mm]"
    theirs = ("--trajectory", "poses.csv", "--measured", "theirs.csv", "--columns")
    again = run("iso9283", visits, *theirs, columns, "--robots", "200", "--json", "-").json
    assert again["measured"]["poses"]["P1"]["RP"] == pytest.approx((2.5 + 3 * (25 / 3) ** 0.5) * 1e-3)
    assert "no column 'nn'" in refused("iso9283", visits, *theirs, columns.replace("n=", "nn=", 1))


def test_a_missed_limit_of_a_figure_is_exit_code_1(run, visits):
    asked = ("iso9283", visits, "--all-poses", "--robots", "200", "--spec")
    assert "spec RP within 1 mm for 95 % at every pose: MET - 100" in run(*asked, "RP 1 mm @ 95 %").out
    missed = run(*asked, "RP 1 um", "--spec", "AP 1 m", code=1).out
    assert "spec RP within 0.001 mm for 95 % at every pose: NOT MET" in missed
    assert "spec AP within 1000 mm for 95 % at every pose: MET" in missed


# changes and correlations --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_set_value_is_that_of_the_sheet_edited_by_hand(run, refused, folder):
    few = ("--samples", "400", "--json", "-")
    (folder / "heavy.errors.yaml").write_text((folder / SHEET).read_text().replace("mass: 1 kg", "mass: 3 kg"))
    edited, plain = (run("analyze", sheet, *few).json for sheet in ("heavy.errors.yaml", SHEET))
    changed = run("analyze", SHEET, "--set", "payload.mass=3 kg", *few).json
    assert changed["position"] == edited["position"] != plain["position"]
    for command in ("budget", "check", "mcpc"):
        line = refused(command, SHEET, "--set", "payload.mas=3 kg")
        assert line.startswith("--set payload.mas: error E_UNKNOWN_KEY: unknown key 'mas': did you mean 'mass'?")


def test_scores_and_pearson_of_correlated_parameters_are_reported(run, folder):
    (folder / "correlated.errors.yaml").write_text(
        "precision-pin: 1\nrobot: 4dof.urdf\ntip: tool\nposes: {paper: -90 3 88 -91 deg}\n"
        "parameters:\n  one: {uniform: 0.05 mm}\n  two: {uniform: 0.2 mm}\n"
        "correlations:\n  - {parameters: [one, two], correlation: 0.7}\n"
        "sources:\n  - length: {joint: joint3, parameters: [one]}\n  - length: {joint: joint4, parameters: [two]}\n"
    )
    asked = ("analyze", "correlated.errors.yaml", "--samples", "100", "--all", "--json", "result.json")
    text = run(*asked).out
    (group,) = json.loads((folder / "result.json").read_text())["correlations"]
    # two uniform numbers under a Gaussian copula: Pearson = 6/π asin(ρ/2) (Pearson, 1907)
    pearson = 6 / math.pi * math.asin(0.35)
    assert group["parameters"] == ["one", "two"]
    assert group["scores"] == [[1.0, 0.7], [0.7, 1.0]]
    assert abs(group["pearson"][0][1] - pearson) < 1e-9
    assert f"correlation of one and two: 0.7 of the normal scores, {pearson:.4g} of the numbers (Pearson)" in text


# ``map`` and ``path``: tables, files, exit codes


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
    asked = ("map", SHEET, "--grid", "grid.yaml", "--spec")
    why = (
        "NOT JUDGED: 2 of 6 poses are left out: 2 unreachable (first '1000 0 4000 mm'); --beyond-limits gives a verdict"
    )
    for command in (asked, ("analyze", SHEET, "--grid", "grid.yaml", "--samples", "500", "--spec")):
        assert why.split("(first")[0] in " ".join(run(*command, "1 m", code=1).out.split())
    compared = run("compare", SHEET, *asked[2:], "1 m", "--set", "payload.mass=1 kg", "--samples", "500", code=1).out
    assert why.split("(first")[0] in " ".join(compared.split())
    asked = (*asked[:4], "--beyond-limits", "--spec")
    done = run(*asked, "1 m", "--relative-to", "paper", "--json", "map.json").out
    assert "map of 6 poses: 4 reached, 2 unreachable" in done
    assert "2 of 6 poses cannot be reached and are not judged" in done
    assert ": MET - worst" in done
    made = json.loads((folder / "map.json").read_text())
    (spec,) = made["spec"]
    assert (made["schema"], spec["met"], spec["judged"]) == ("precision-pin/map/1", True, 4)
    assert [pose["status"] for pose in made["poses"]].count("unreachable") == 2
    assert new_files() == {"grid.yaml", "map.json"}
    run(*asked, "1 mm", "--quiet", code=1)
    pytest.importorskip("xarray")
    run(*asked[:-1], "--verify", "0", "--netcdf", "map.nc")
    assert new_files() == {"grid.yaml", "map.json", "map.nc"}


ARM = {
    "arm.urdf": robot(
        *map(link, ("base", "upper", "tool")),
        joint("shoulder", "revolute", "base", "upper"),
        joint("flange", "fixed", "upper", "tool", (0.7, 0, 0)),
    ),
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
    is_met = share >= float(spec.split()[-2]) / 100
    done = run("map", "arm.errors.yaml", "--all-poses", "--spec", spec, "--json", "map.json", code=1 - is_met)
    written = json.loads((folder / "map.json").read_text())
    made, poses = written["spec"][0], written["poses"]
    assert poses[0]["probability"][0] == pytest.approx(closed, abs=2e-3)
    assert is_met != (closed >= made["required"]) or share == 0.995
    assert made["met"] == is_met
    assert f": {'MET' if is_met else 'NOT MET'} - worst" in done.out
    for pose in poses[:3]:
        (low, high), (least, most) = pose["judged"]["interval"][0], pose["probability_bounds"][0]
        assert low <= share <= high
        assert least <= share <= most + 1e-12
        assert pose["judged"]["verdict"] == ["met" if is_met else "not met"]
    if not is_met:
        assert made["worst_pose"] in ("a1", "a2", "a3")
        assert made["sampled"]["interval"][1] < made["required"]


def test_a_json_that_is_too_large_is_refused_before_the_work(refused, monkeypatch):
    monkeypatch.setattr("precision_pin.analyses.map.map_poses.LARGEST_FILE", 1000)
    monkeypatch.setattr("precision_pin.analyses.map.map_poses.first_order", None)
    for options in (("--json", "map.json"), ("--json", "-"), ("--out", "plots")):
        line = refused("map", SHEET, *options)
        assert "the JSON of a map of" in line
        assert "write it as netCDF (--netcdf" in line


# figures of several poses --------------------------------------------------------------------------------------------


def test_each_pose_has_figures_by_its_number(run, folder):
    run("exact-law", "gantry.errors.yaml", "--all-poses", "--samples", "100", "--out", "plots")
    drawn = {path.stem for path in (folder / "plots").glob("*.svg")}
    assert drawn == {"exact-law-1", "exact-law-2"}


# path ----------------------------------------------------------------------------------------------------------------

FEW = ("--samples", "500")


@pytest.fixture
def way(folder):
    (folder / "way.csv").write_text(f"t,y_axis [mm],{LONG} [deg]\n0,-200,0\n2,0,45\n8,300,-30\n")
    return ("path", "gantry.errors.yaml", "--trajectory", "way.csv")


@pytest.mark.slow
def test_table_json_and_plot_of_a_path(run, folder, way):
    done = run(*way, "--step", "1 s", *FEW, "--spec", "1 mm", "--out", "plots").out
    assert done.startswith("largest error along the path: 95 % of robots within |d|")
    assert "a path of 9 poses, 8 s" in done
    assert "spec |d| within 1 mm for 95 % along the whole path: MET" in done
    assert (folder / "plots" / "path.svg").exists()
    saved = json.loads((folder / "plots" / "path.json").read_text())
    first, last = saved["poses"][0], saved["poses"][-1]
    assert (last["time"], first["q"]["y_axis"]) == (8.0, pytest.approx(-0.2))
    # the joint is off by 0.3 mrad as 3 σ wherever it stands, and nothing else turns the tool
    low, high = saved["maximum"]["attitude"]["quantile_interval"]["0.95"]
    assert low <= 1.96 * 0.1e-3 <= high
    low, high = saved["band"]["attitude"]["factor_interval"]
    assert low <= 1.96 * 0.1e-3 / first["attitude"]["quantile"] <= high
    run(*way, *FEW, "--spec", "0.01 mm", "--quiet", code=1)


def test_a_path_that_takes_long_is_refused_with_the_time_unless_its_robots_are_asked_for(
    run, refused, way, monkeypatch
):
    monkeypatch.setattr("precision_pin.analyses.path._LONG", 2 * 3 * 10_000 - 1)
    monkeypatch.setattr("precision_pin.analyses.path._LOOKED", 0.0)
    said = "error E_USAGE: 3 poses with 10,000 robots each take about 0 minutes here; --samples 1000"
    assert said in refused(*way)
    run(*way, "--samples", "10000")
    monkeypatch.setattr("precision_pin.analyses.path._LONG", 2 * 3 * 10_000)
    run(*way)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--rated", "3 kg"], "--rated: 'kg'"),
        (["--goal", "1 um"], "write it as '1 um/N'"),
        (["--axes", "0 0 0"], "--axes: base, tool or a direction"),
        (["--axes", "up"], "--axes: base, tool or a direction"),
        (["--robots", "0"], "robots must be"),
    ],
)
def test_a_wrong_load_or_axis_is_one_line(refused, words, message):
    assert message in refused("stiffness", *words)
