"""Gates that must not pass unseen: joints outside their limits or too fast, tolerances set to nothing, fits without rank."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest

import precision_pin as pp
from cli.conftest import LONG
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.robot.pose_set import PoseSet

SHEET = "gantry.errors.yaml"
IN, OUT = "1000 mm, 0 deg", "1200 mm, 0 deg"
"""At the end of the travel of 1 m, which is inside, and beyond."""
WHY = "NOT JUDGED: y_axis is outside its limits"
LIMITS = "1200 mm, limits -1000 to 1000 mm"
FEW = ("--samples", "500")
SPEC = ("--spec", "5 mm @ 90 %")
COMMANDS = {
    "analyze": ("analyze", *FEW, *SPEC),
    "reliability": ("reliability", *FEW, *SPEC),
    "compare": ("compare", *FEW, *SPEC, "--set", "joint_offset[y_axis].offset=±0.2 mm"),
    "iso9283": ("iso9283", "--robots", "100", "--spec", "AP 5 mm @ 90 %"),
    "map, closed form": ("map", "--verify", "0", *SPEC),
    "map": ("map", "--verify", "1", *SPEC),
    "map, sampled": ("map", *FEW, *SPEC),
}
MET_BY_SAMPLES = set(COMMANDS) - {"map, closed form"}
"""A closed form alone meets nothing."""


def _spec_entries(data):
    """Return every entry of a specification in a result, wherever it is."""
    if isinstance(data, dict):
        own = [data] if {"limit", "required", "met"} <= set(data) else []
        return own + [one for value in data.values() for one in _spec_entries(value)]
    return [one for value in data for one in _spec_entries(value)] if isinstance(data, list) else []


@pytest.mark.fast(2)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_joint_outside_its_limits_is_not_judged(run, folder, name):
    command, *options = COMMANDS[name]
    asked = (command, SHEET, *options)
    stopped = run(*asked, "--q", OUT, "--json", "result.json")
    said = " ".join(stopped.out.split())
    assert stopped.code == 1
    assert WHY in said
    assert LIMITS in said
    assert not re.search(r"(?<!NOT )\bMET\b", stopped.out)
    assert "W_JOINT_LIMIT" in stopped.err
    entries = _spec_entries(json.loads((folder / "result.json").read_text()))
    assert entries
    assert not any(entry["met"] for entry in entries)
    assert all(
        WHY.removeprefix("NOT JUDGED: ") in entry["why_not_judged"] for entry in entries if "worst_pose" not in entry
    )
    told = run(*asked, "--q", OUT, "--beyond-limits")
    inside = run(*asked, "--q", IN)
    assert (told.code, inside.code) == ((0, 0) if name in MET_BY_SAMPLES else (1, 1))
    assert "W_JOINT_LIMIT" in told.err
    assert WHY not in told.out + inside.out
    if name == "analyze":
        assert run(command, SHEET, *FEW, "--q", OUT).code == 0


def test_one_pose_of_several_is_enough(run):
    for more in ((), ("--spec-everywhere",)):
        done = run("analyze", SHEET, "--q", IN, "--q", OUT, *FEW, *SPEC, *more, "--json", "-")
        assert done.code == 1
        (entry,) = done.json["spec"]
        assert (entry["verdict"], entry["met"], entry["judged"]) == ("not judged", False, False)
        assert [one["met"] for one in entry["poses"]] == [True, False]
    # a pose inside at which the limit is missed is missed all the same
    done = run("analyze", SHEET, "--q", IN, "--q", OUT, *FEW, "--spec", "0.01 mm @ 99 %", "--json", "-")
    assert (done.code, done.json["spec"][0]["verdict"]) == (1, "not met")


@pytest.mark.slow
def test_of_a_relative_error_both_poses_are_looked_at(run):
    for pose, other, where in (
        ("1200 mm, 30 deg", "home", "the pose"),
        (IN, "1200 mm, 30 deg", "the pose relative to which"),
    ):
        asked = ("analyze", SHEET, "--q", pose, "--relative-to", other, *FEW, *SPEC)
        stopped = run(*asked)
        assert (stopped.code, f"{WHY} at {where}" in " ".join(stopped.out.split())) == (1, True)
        assert run(*asked, "--beyond-limits").code == 0


@pytest.mark.slow
def test_pages_say_so_too(run, folder):
    for command, page in (("view", "view.html"), ("report", "report.html")):
        asked = (command, SHEET, "--q", OUT, "--samples", "2000", *SPEC, "--out", page)
        assert run(*asked).code == 1
        text = (folder / page).read_text("utf-8")
        assert re.search(r"[Nn]ot judged", text)
        assert LIMITS in text
        assert run(*asked, "--beyond-limits").code == 0
        assert LIMITS not in (folder / page).read_text("utf-8").split("Warnings")[0].split("<script")[0]


@pytest.mark.slow
def test_an_allocation_at_such_a_pose_is_not_judged(run, folder):
    sheet = (folder / SHEET).read_text("utf-8").replace("250 mm", "1200 mm")
    wanted = "allocate:\n  specs: ['5 mm @ 90 %']\n  tolerances:\n"
    entry = "    - {path: 'joint_offset[y_axis].offset.uniform', cost: {reciprocal: 1 mm}, max: 1 mm}\n"
    (folder / "wanted.yaml").write_text(f"{sheet}{wanted}{entry}", "utf-8")
    stopped = run("allocate", "wanted.yaml", "--json", "result.json")
    assert (stopped.code, WHY in " ".join(stopped.out.split())) == (1, True)
    assert "W_JOINT_LIMIT" in stopped.err
    (entry,) = json.loads((folder / "result.json").read_text())["specs"]
    assert not entry["met"]
    assert run("allocate", "wanted.yaml", "--beyond-limits").code == 0


def test_in_python_a_verdict_outside_is_not_met(folder):
    model = pp.ErrorModel.load(SHEET)
    with pytest.warns(PrecisionPinWarning, match="W_JOINT_LIMIT"):
        result = pp.monte_carlo(model, [1.2, 0.0], samples=500, specifications="5 mm @ 90 %")
    (one,) = result.summary.specifications
    assert (one.met, one.verdict) == (False, "not judged")
    model.beyond_limits = True
    changed = model.with_({"joint_offset[y_axis].offset": "±0.2 mm"})
    with pytest.warns(PrecisionPinWarning, match="W_JOINT_LIMIT"):
        result = pp.monte_carlo(changed, [1.2, 0.0], samples=500, specifications="5 mm @ 90 %")
    assert result.summary.specifications[0].met


def test_a_limit_rounded_in_the_file_holds_its_own_angle(run, folder):
    """180° is 3.14159265 rad, which the file's 3.14159 is meant to be; a thousandth of a degree more is outside."""
    urdf = (folder / "gantry.urdf").read_text("utf-8")
    (folder / "gantry.urdf").write_text(
        urdf.replace('lower="-2" upper="2"', 'lower="-3.14159" upper="3.14159"'), "utf-8"
    )
    assert run("analyze", SHEET, "--q", "0 mm, 180 deg", *FEW, *SPEC).code == 0
    assert run("analyze", SHEET, "--q", "0 mm, 180.001 deg", *FEW, *SPEC).code == 1


def _way(folder, times, places=(0, 50, 100)):
    rows = "".join(f"{time},{place},0\n" for time, place in zip(times, places, strict=True))
    (folder / "way.csv").write_text(f"t [s],y_axis [mm],{LONG} [deg]\n{rows}", "utf-8")
    return ("path", SHEET, "--trajectory", "way.csv", *FEW)


@pytest.mark.slow
def test_a_path_faster_than_a_joint_is_not_judged(run, folder):
    """50 mm in 0.05 s are the 1 m/s of the limit; in 0.04 s they are 1.25 m/s."""
    assert run(*_way(folder, (0, 0.05, 0.1)), *SPEC).code == 0
    asked = _way(folder, (0, 0.05, 0.09))
    for more in ((), ("--step", "0.01 s")):
        stopped = run(*asked, *SPEC, *more)
        said = " ".join(stopped.out.split())
        assert stopped.code == 1
        assert "NOT JUDGED: y_axis is faster than its limit from t = 0.05 s to 0.0" in said
        assert "1250 mm/s, limit 1000 mm/s" in said
        assert "W_JOINT_SPEED" in stopped.err
    assert run(*asked).code == 0
    assert run(*asked, *SPEC, "--beyond-limits").code == 0
    (folder / "way.csv").write_text(f"y_axis [mm],{LONG} [deg]\n0,0\n1000,0\n", "utf-8")
    untimed = run(*asked, *SPEC, "--json", "-")
    assert untimed.code == 0
    assert any("speeds" in line for line in untimed.json["assumptions"])
    # a speed of zero limits nothing
    urdf = (folder / "gantry.urdf").read_text("utf-8")
    (folder / "gantry.urdf").write_text(urdf.replace('velocity="1"', 'velocity="0"', 1), "utf-8")
    assert run(*_way(folder, (0, 1e-3, 2e-3)), *SPEC).code == 0


def test_equal_times_of_a_path_in_python_are_refused(folder):
    model = pp.ErrorModel.load(SHEET)
    poses = PoseSet.at(model.chain, np.zeros((2, 3)), times=np.array([0.0, 1.0, 1.0]))
    with pytest.raises(pp.InputError, match="1 s does not come after the 1 s of the pose before"):
        pp.path_law(model, poses, samples=200)


# what a change of the sheet takes as exact ----------------------------------------------------------------------------

TURN = f"joint_offset[{LONG}]"
EXACT = ("--set", f"{TURN}.offset=0 mrad")
# ±0.1 mm uniform along y; 0.3 mrad as 3 σ on an arm of 0.5 m
SHARE = 100 * (0.1e-3 * 0.5) ** 2 / ((0.1e-3 * 0.5) ** 2 + 0.1e-3**2 / 3)


def _share(text):
    return float(re.search(r"with this went ([\d.]+) % of the variance of the position", text)[1])


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "map, closed form"])
def test_what_is_set_to_nothing_is_said_with_its_share(run, folder, name):
    command, *options = COMMANDS[name]
    done = run(command, SHEET, *options, *EXACT, "--q", "0 mm, 0 deg", "--json", "result.json")
    assert done.code == 0
    assert f"MET with {TURN} taken as exact" in " ".join(done.out.split())
    assert math.isclose(_share(done.err), SHARE, rel_tol=0.01)
    entries = _spec_entries(json.loads((folder / "result.json").read_text()))
    assert [TURN] in [entry.get("taken_as_exact") for entry in entries]
    narrower = run(command, SHEET, *options, "--set", f"{TURN}.offset={{normal: 0.1 mrad}}", "--q", "0 mm, 0 deg")
    assert "taken as exact" not in narrower.out + narrower.err
    missed = run(command, SHEET, *[one.replace("5 mm", "0.001 mm") for one in options], *EXACT, "--q", "0 mm, 0 deg")
    assert (missed.code, "taken as exact" in missed.out) == (1, False)


@pytest.mark.slow
def test_named_parameters_and_parts_of_them(run, folder):
    """A parameter that two sources share goes whole, or out of one of them: 1 of 1 + 1 squared parts of a sum of two."""
    sheet = (folder / SHEET).read_text("utf-8").partition("sources:")[0]
    sources = "sources:\n" + "".join(
        f"  - length: {{frame: tool, along: {axis} of y_axis, parameters: [{names}]}}\n"
        for axis, names in (("x", "a, b"), ("y", "a"))
    )
    (folder / "shared.yaml").write_text(f"{sheet}parameters:\n  a: ±0.1 mm\n  b: ±0.1 mm\n{sources}", "utf-8")
    # variances along x: a and b, along y: a
    whole = run("analyze", "shared.yaml", *FEW, *SPEC, "--set", "parameters.a={fixed: 0 mm}")
    assert "MET with parameters.a taken as exact" in " ".join(whole.out.split())
    assert _share(whole.err) == pytest.approx(100 * 2 / 3, rel=1e-2)
    half = run("analyze", "shared.yaml", *FEW, *SPEC, "--set", "length[tool]#2.parameters=[0 mm]")
    assert _share(half.err) == pytest.approx(100 / 3, rel=1e-2)
    both = run("budget", "shared.yaml", "--set", "parameters.*={fixed: 0 mm}")
    assert "parameters.a, parameters.b are taken as exact" in both.err


# calibration ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_fit_without_a_prior_of_what_is_not_determined_ends_with_1(run, folder):
    """Readings at one value of y_axis: its offset and one along the same line are told apart by nothing."""
    sheet = (folder / SHEET).read_text("utf-8")
    (folder / "two.yaml").write_text(
        sheet + "  - length: {frame: tool, along: y of y_axis, parameters: [{normal: 0.1 mm}]}\n"
    )
    angles = np.linspace(-1, 1, 8)
    tips = np.column_stack([np.full(8, 0.1), 0.2 + 0.5 * np.sin(angles), 1 - 0.5 * np.cos(angles)])
    rows = np.column_stack([np.full(8, 200.0), np.degrees(angles), 1e3 * tips])
    header = f"y_axis [mm], {LONG} [deg], x [mm], y [mm], z [mm]"
    np.savetxt(folder / "data.csv", rows, "%.9g", delimiter=", ", header=header, comments="")
    for sheet, code in (("two.yaml", 1), (SHEET, 0)):
        asked = ("calibrate", sheet, "data.csv", "--std", "0.01 mm")
        bare = run(*asked, "--no-prior")
        assert bare.code == code
        assert run(*asked).code == 0
        assert ("W_RANK" in bare.err) == bool(code)
    assert "joint_offset[y_axis].offset, length[tool]" in run("calibrate", "two.yaml", *asked[2:], "--no-prior").err
