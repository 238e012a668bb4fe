"""Gates that must not pass unseen: joints outside their limits or too fast, tolerances set to nothing, fits without rank."""

import json
import math
import re
import shutil

import numpy as np
import pytest

import precision_pin as pp
from cli.conftest import GANTRY, GANTRY_SHEET, LONG
from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.robot.examples import example_urdfs, shipped_sheets
from precision_pin.robot.pose_set import PoseSet
from support.plain_robot import joint, limits, link, robot

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
    found = []
    json.loads(json.dumps(data), object_hook=lambda one: found.append(one) or one)
    return [one for one in found if {"limit", "required", "met"} <= set(one)]


@pytest.mark.fast(2)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_joint_outside_its_limits_is_not_judged(run, folder, name):
    command, *options = COMMANDS[name]
    asked = (command, SHEET, *options)
    stopped = run(*asked, "--q", OUT, "--json", "result.json", code=1)
    said = " ".join(stopped.out.split())
    assert WHY in said
    assert LIMITS in said
    assert not re.search(r"(?<!NOT )\bMET\b", stopped.out)
    assert "W_JOINT_LIMIT" in stopped.err
    entries = _spec_entries(json.loads((folder / "result.json").read_text()))
    assert entries
    assert not any(entry["met"] for entry in entries)
    reasons = [entry["why_not_judged"] for entry in entries if "worst_pose" not in entry]
    assert all("y_axis is outside its limits" in reason for reason in reasons)
    code = 0 if name in MET_BY_SAMPLES else 1
    told = run(*asked, "--q", OUT, "--beyond-limits", code=code)
    inside = run(*asked, "--q", IN, code=code)
    assert "W_JOINT_LIMIT" in told.err
    assert WHY not in told.out + inside.out
    if name == "analyze":
        run(command, SHEET, *FEW, "--q", OUT)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "held"), [("analyze", "locked"), ("map", "locked"), ("iso9283", "follower")])
def test_a_joint_that_stands_or_follows_outside_its_limits_is_not_judged(run, folder, name, held):
    """A joint of the chain that is locked, and one beside it that mimics a joint of the chain."""
    command, *options = COMMANDS[name]
    text = (folder / SHEET).read_text("utf-8")
    if held == "locked":
        text = text.replace("poses:", "locked: {y_axis: 1200 mm}\nposes:").replace("{y_axis: 250 mm, ", "{")
        text = text.replace("[0 mm, 0 deg]", "[0 deg]").replace("  - joint_offset: {joint: y_axis", "  # ")
        why = "y_axis is outside its limits"
    else:
        follows = '<mimic joint="y_axis" multiplier="-5"/>' + limits(-1, 1)
        beside = link("rod") + joint("rod", "prismatic", "frame", "rod", extra=follows)
        (folder / "gantry.urdf").write_text(GANTRY.replace("</robot>", f"{beside}</robot>"), "utf-8")
        text = text.replace("poses:", "tip: tool\nposes:")
        why = "rod is outside its limits"
    (folder / "held.yaml").write_text(text, "utf-8")
    stopped = run(command, "held.yaml", *options, "--pose", "out", code=1)
    assert f"NOT JUDGED: {why}" in " ".join(stopped.out.split())
    assert "W_JOINT_LIMIT" in stopped.err
    run(command, "held.yaml", *options, "--pose", "out", "--beyond-limits")


def test_one_pose_of_several_is_enough(run):
    both = ("analyze", SHEET, "--q", IN, "--q", OUT, *FEW, "--json", "-", "--spec")
    for more in ((), ("--spec-everywhere",)):
        (entry,) = run(*both, "5 mm @ 90 %", *more, code=1).json["spec"]
        assert (entry["verdict"], entry["met"], entry["judged"]) == ("not judged", False, False)
        assert [one["met"] for one in entry["poses"]] == [True, False]
    # a pose inside at which the limit is missed is missed all the same
    assert run(*both, "0.01 mm @ 99 %", code=1).json["spec"][0]["verdict"] == "not met"


@pytest.mark.slow
def test_of_a_relative_error_both_poses_are_looked_at(run):
    turned = "1200 mm, 30 deg"
    for pose, other, where in ((turned, "home", "the pose"), (IN, turned, "the pose relative to which")):
        asked = ("analyze", SHEET, "--q", pose, "--relative-to", other, *FEW, *SPEC)
        assert f"{WHY} at {where}" in " ".join(run(*asked, code=1).out.split())
        run(*asked, "--beyond-limits")


@pytest.mark.slow
def test_pages_say_so_too(run, folder):
    for command in ("view", "report"):
        asked = (command, SHEET, "--q", OUT, "--samples", "2000", *SPEC, "--out", "page.html")
        run(*asked, code=1)
        text = (folder / "page.html").read_text("utf-8")
        assert re.search(r"[Nn]ot judged", text)
        assert LIMITS in text
    run(*asked, "--beyond-limits")
    assert LIMITS not in (folder / "page.html").read_text("utf-8").split("Warnings")[0].split("<script")[0]


@pytest.mark.slow
def test_an_allocation_at_such_a_pose_is_not_judged(run, folder):
    sheet = (folder / SHEET).read_text("utf-8").replace("250 mm", "1200 mm")
    entry = "{path: 'joint_offset[y_axis].offset.uniform', cost: {reciprocal: 1 mm}, max: 1 mm}"
    wanted = f"allocate: {{specs: ['5 mm @ 90 %'], tolerances: [{entry}]}}\n"
    (folder / "wanted.yaml").write_text(sheet + wanted, "utf-8")
    stopped = run("allocate", "wanted.yaml", "--json", "result.json", code=1)
    assert WHY in " ".join(stopped.out.split())
    assert "W_JOINT_LIMIT" in stopped.err
    (entry,) = json.loads((folder / "result.json").read_text())["specs"]
    assert not entry["met"]
    run("allocate", "wanted.yaml", "--beyond-limits")


def test_in_python_a_verdict_outside_is_not_met(folder):
    model = pp.ErrorModel.load(SHEET)
    asked = {"q": [1.2, 0.0], "samples": 500, "specifications": "5 mm @ 90 %"}
    with pytest.warns(PrecisionPinWarning, match="W_JOINT_LIMIT"):
        (one,) = pp.monte_carlo(model, **asked).summary.specifications
    assert (one.met, one.verdict) == (False, "not judged")
    model.beyond_limits = True
    changed = model.with_({"joint_offset[y_axis].offset": "±0.2 mm"})
    with pytest.warns(PrecisionPinWarning, match="W_JOINT_LIMIT"):
        assert pp.monte_carlo(changed, **asked).summary.specifications[0].met


def test_a_limit_rounded_in_the_file_holds_its_own_angle(run, folder):
    """180° is 3.14159265 rad, which the file's 3.14159 is meant to be; a thousandth of a degree more is outside."""
    (folder / "gantry.urdf").write_text(GANTRY.replace(limits(-2, 2), limits(-3.14159, 3.14159)), "utf-8")
    for angle, code in ((180, 0), (180.001, 1)):
        run("analyze", SHEET, "--q", f"0 mm, {angle} deg", *FEW, *SPEC, code=code)


def _turning(half_width, length=1.0):
    """Return an arm of one link with a uniform error of its hinge: dx = length·(cos θ - 1), to first order nothing."""
    arm = robot(*map(link, ("base", "arm", "tip")), joint("hinge", "revolute", "base", "arm"),
                joint("end", "fixed", "arm", "tip", (length, 0, 0)))  # fmt: skip
    turn = pp.sources.JointOffset(joint="hinge", offset=pp.Uniform(half_width))
    grows = pp.sources.Frame(frame="tip", x=pp.Normal(1e-5))
    return pp.ErrorModel(pp.Chain.from_urdf(arm), pp.Space(), [turn, grows], {"home": [0.0], "up": [0.5]})


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
@pytest.mark.parametrize("half_width", [0.157, 0.02, 0.0])
def test_a_verdict_of_the_linear_model_is_given_where_the_exact_one_says_the_same(half_width):
    """|dx| ≤ 5 mm is kept by all robots to first order; in truth where θ ≤ 0.1, a share of 0.1/0.157."""
    model, told = _turning(half_width), {"specifications": ["x 5 mm @ 90 %"], "model": "linear", "samples": 2000}
    first = pp.monte_carlo(model, "home", **told).summary.specifications
    others = {
        "compare": pp.compare([model, _turning(half_width)], "home", **told).poses[0].laws[1].summary.specifications,
        "path": pp.path_law(model, [[0.0], [1e-3]], **told).specification_results,
        "poses": pp.sample_poses(model, ["home", [0.0]], **told).specification_results,
        "everywhere": [pp.sample_poses(model, ["home"], everywhere=True, **told).specification_results[0].everywhere],
        "relative": pp.relative(model, "home", "up", **told).summary.specifications,
    }
    told["model"] = "exact"
    (exact,) = pp.monte_carlo(model, "home", **told).summary.specifications
    assert exact.verdict == ("not met" if half_width > 0.1 else "met")
    assert exact.grounds.linear is None
    for name, (one,) in {"analyze": first, **others}.items():
        if name == "relative":
            # the difference of the two x errors is first order in θ, and not within 5 mm
            assert one.verdict == ("met" if half_width == 0 else "not met"), name
            continue
        assert (one.verdict, one.met) == (("not judged", False) if half_width > 0.1 else ("met", True)), name
        apart = 1e3 * (1 - math.cos(half_width))
        text = one.grounds.linear
        assert float(text.split()[0]) == pytest.approx(apart, rel=0.03, abs=1e-9), name
        if name == "analyze":
            crossed, robots = (float(text.split()[k].replace(",", "")) for k in (6, 8))
            assert crossed / robots == pytest.approx(
                max(0.0, 1 - math.acos(1 - 5e-3) / max(half_width, 1e-9)), abs=0.02
            )
            how = (
                f"the linear model is up to {text}; --model exact"
                if half_width > 0.1
                else f"by the linear model, up to {text}"
            )
            assert how in one.said
    # rarer failures than the compared robots show are not confirmed, unless both models are the same
    told |= {"model": "linear", "specifications": ["x 5 mm @ 99.99 %"], "samples": 100_000}
    (rare,) = pp.monte_carlo(model, "home", **told).summary.specifications
    assert rare.verdict == ("met" if half_width == 0 else "not judged")


def test_a_miss_by_the_linear_model_alone_is_not_judged():
    """|d| = 2 sin(θ/2) of θ up to 1.2 rad is below 1.13 m in every robot, to first order above 1.15 m in 4 % of them."""
    told = {"specifications": ["1.15 m @ 99 %"], "samples": 2000, "model": "linear"}
    (one,) = pp.monte_carlo(_turning(1.2), "home", **told).summary.specifications
    assert (one.verdict, one.interval[1] < 0.99) == ("not judged", True)
    assert "m from the exact one" in one.grounds.why


def _way(folder, times):
    rows = "".join(f"{time},{50 * k},0\n" for k, time in enumerate(times))
    (folder / "way.csv").write_text(f"t [s],y_axis [mm],{LONG} [deg]\n{rows}", "utf-8")
    return ("path", SHEET, "--trajectory", "way.csv", *FEW)


@pytest.mark.slow
def test_a_path_faster_than_a_joint_is_not_judged(run, folder):
    """50 mm in 0.05 s are the 1 m/s of the limit; in 0.04 s they are 1.25 m/s."""
    run(*_way(folder, (0, 0.05, 0.1)), *SPEC)
    asked = _way(folder, (0, 0.05, 0.09))
    for more in ((), ("--step", "0.01 s")):
        stopped = run(*asked, *SPEC, *more, code=1)
        said = " ".join(stopped.out.split())
        assert "NOT JUDGED: y_axis is faster than its limit from t = 0.05 s to 0.0" in said
        assert "1250 mm/s, limit 1000 mm/s" in said
        assert "W_JOINT_SPEED" in stopped.err
    run(*asked)
    run(*asked, *SPEC, "--beyond-limits")
    (folder / "way.csv").write_text(f"y_axis [mm],{LONG} [deg]\n0,0\n1000,0\n", "utf-8")
    assert any("speeds" in line for line in run(*asked, *SPEC, "--json", "-").json["assumptions"])
    # a speed of zero limits nothing
    (folder / "gantry.urdf").write_text(GANTRY.replace('velocity="1"', 'velocity="0"', 1), "utf-8")
    run(*_way(folder, (0, 1e-3, 2e-3)), *SPEC)


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
    asked = (command, SHEET, "--q", "0 mm, 0 deg", *options)
    done = run(*asked, *EXACT, "--json", "result.json")
    assert f"MET with {TURN} taken as exact" in " ".join(done.out.split())
    assert math.isclose(_share(done.err), SHARE, rel_tol=0.01)
    entries = _spec_entries(json.loads((folder / "result.json").read_text()))
    assert [TURN] in [entry.get("taken_as_exact") for entry in entries]
    missed = run(*[word.replace("5 mm", "0.001 mm") for word in asked], *EXACT, code=1)
    assert "taken as exact" not in missed.out
    if name == "analyze":
        narrower = run(*asked, "--set", f"{TURN}.offset={{normal: 0.1 mrad}}")
        assert "taken as exact" not in narrower.out + narrower.err


@pytest.mark.slow
def test_named_parameters_and_parts_of_them(run, folder):
    """A parameter that two sources share goes whole, or out of one of them: 1 of 1 + 1 squared parts of a sum of two."""
    sheet = (folder / SHEET).read_text("utf-8").partition("sources:")[0]
    # variances along x: a and b, along y: a
    x, y = (
        f"  - length: {{frame: tool, along: {to} of y_axis, parameters: [{of}]}}\n"
        for to, of in (("x", "a, b"), ("y", "a"))
    )
    (folder / "shared.yaml").write_text(f"{sheet}parameters: {{a: ±0.1 mm, b: ±0.1 mm}}\nsources:\n{x}{y}", "utf-8")
    whole = run("analyze", "shared.yaml", *FEW, *SPEC, "--set", "parameters.a={fixed: 0 mm}")
    assert "MET with parameters.a taken as exact" in " ".join(whole.out.split())
    assert _share(whole.err) == pytest.approx(100 * 2 / 3, rel=1e-2)
    half = run("analyze", "shared.yaml", *FEW, *SPEC, "--set", "length[tool]#2.parameters=[0 mm]")
    assert _share(half.err) == pytest.approx(100 / 3, rel=1e-2)
    both = run("budget", "shared.yaml", "--samples", "1024", "--set", "parameters.*={fixed: 0 mm}")
    assert "parameters.a, parameters.b are taken as exact" in both.err


# calibration ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_fit_without_a_prior_of_what_is_not_determined_ends_with_1(run, folder):
    """Readings at one value of y_axis: its offset and one along the same line are told apart by nothing."""
    along = "  - length: {frame: tool, along: y of y_axis, parameters: [{normal: 0.1 mm}]}\n"
    (folder / "two.yaml").write_text((folder / SHEET).read_text("utf-8") + along)
    angles = np.linspace(-1, 1, 8)
    tips = np.column_stack([np.full(8, 0.1), 0.2 + 0.5 * np.sin(angles), 1 - 0.5 * np.cos(angles)])
    rows = np.column_stack([np.full(8, 200.0), np.degrees(angles), 1e3 * tips])
    header = f"y_axis [mm], {LONG} [deg], x [mm], y [mm], z [mm]"
    np.savetxt(folder / "data.csv", rows, "%.9g", delimiter=", ", header=header, comments="")
    asked = ("data.csv", "--std", "0.01 mm")
    bare = run("calibrate", "two.yaml", *asked, "--no-prior", code=1)
    assert re.search(r"W_RANK.*joint_offset\[y_axis\]\.offset, length\[tool\]", bare.err)
    run("calibrate", "two.yaml", *asked)
    assert "W_RANK" not in run("calibrate", SHEET, *asked, "--no-prior").err


# verdicts that must not pass without having looked: nothing varies, too few samples, assumptions, another pose's limits


HEAD = "precision-pin: 1\nrobot: 4dof.urdf\ntip: tool\nposes:\n  reach: 0 10 30 0 deg\n"
TURNS = "sources:\n  - joint_offset: {joint: joint1, offset: {normal: 0.02 deg}}\n"
SOFT = "  - joint_compliance: {joint: joint1, compliance: {uniform: 1e-6 rad/(N*m), mean: 1e-5 rad/(N*m)}}\n"
NOTHING = {
    "no sources": ("", "W_NO_SOURCES"),
    "a tolerance of zero": (TURNS.replace("0.02", "0"), "W_NOTHING_VARIES"),
    "what varies reaches nothing": (f"gravity: none\nsources:\n{SOFT}", "W_NOTHING_VARIES"),
}
SPECS = """specs:
  - 5 mm @ 90 %
  - {name: sideways, quantity: y, limit: 0.2 mm, probability: 99 %}
  - {limit: 0.3 mrad, poses: [home]}
  - AP 5 mm @ 90 %
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_limits_of_the_sheet_are_judged_as_those_of_spec(run, folder, name):
    """The sheet's fitting limits give the result of the same as options; one of another pose is left out, and said."""
    command, *options = [word for word in COMMANDS[name] if word != "--spec" and " mm @" not in word]
    (folder / SHEET).write_text(GANTRY_SHEET + SPECS, encoding="utf-8")
    limits = ["AP 5 mm @ 90 %"] if command == "iso9283" else ["5 mm @ 90 %", "y 0.2 mm @ 99 %"]
    poses = () if command == "map" else ("--pose", "out")
    asked = (command, SHEET, *options, *(("--q", "250 mm, 30 deg") if command == "map" else poses))
    outcome = run(*asked, "--json", "own.json", code=None)
    said = "the sheet's limit 0.3 mrad is not judged: it is for home alone"
    assert (said in outcome.err) == (command != "iso9283")
    given = [word for limit in limits for word in ("--spec", limit)]
    other = run(*asked, *given, "--json", "given.json", code=None)
    assert outcome.code == other.code
    entries = [_spec_entries(json.loads((folder / file).read_text())) for file in ("own.json", "given.json")]
    assert entries[0] == entries[1] != []
    if command != "reliability":
        run(*asked, "--spec", "none", "--json", "none.json", code=None)
        assert _spec_entries(json.loads((folder / "none.json").read_text())) == []


def test_limits_of_the_sheet_at_their_poses_in_python_and_wrong_ones(run, refused, folder):
    (folder / SHEET).write_text(GANTRY_SHEET + SPECS, encoding="utf-8")
    run("analyze", SHEET, *FEW, "--pose", "home", "--json", "home.json", code=None)
    limits = [entry["limit"] for entry in json.loads((folder / "home.json").read_text())["spec"]]
    assert limits == pytest.approx([5e-3, 0.2e-3, 0.3e-3])
    assert pp.ErrorModel.load(folder / SHEET).specs == ("5 mm @ 90 %", "y 0.2 mm @ 99 %", "AP 5 mm @ 90 %")
    assert "no specification is given" in refused("reliability", SHEET, "--spec", "none")
    for wrong, says in (
        ("{limit: 1 mm, poses: [nowhere]}", "no pose named 'nowhere'"),
        ("{quantity: x}", "the key 'limit' is missing"),
        ("{limit: 1 mm, probabilty: 9 %}", "did you mean 'probability'"),
        ("5 parsec", "is not a unit of length or angle"),
        ("positon 5 mm", "did you mean 'position"),
    ):
        (folder / SHEET).write_text(f"{GANTRY_SHEET}specs:\n  - {wrong}\n", encoding="utf-8")
        line = refused("analyze", SHEET, *FEW)
        assert says in line
        assert line.startswith(f"{SHEET}:{GANTRY_SHEET.count(chr(10)) + 2}: error")
    assert says in run("check", SHEET, code=2).out


@pytest.mark.slow
def test_limits_of_the_sheet_on_pages_and_in_an_allocation(run, folder):
    entry = "{path: 'joint_offset[y_axis].offset.uniform', cost: {reciprocal: 1 mm}}"
    text = f"{GANTRY_SHEET}specs: [0.3 mm @ 90 %]\nallocate: {{tolerances: [{entry}]}}\n"
    (folder / SHEET).write_text(text, encoding="utf-8")
    run("allocate", SHEET, "--json", "a.json")
    (limit,) = json.loads((folder / "a.json").read_text())["specs"]
    assert (limit["limit"], limit["met"]) == (pytest.approx(0.3e-3), True)
    for command in ("report", "view"):
        run(command, SHEET, "--samples", "500", "--out", "page.html")
        assert "0.3" in (folder / "page.html").read_text("utf-8").replace("&nbsp;", " ")
        run(
            command,
            SHEET,
            "--samples",
            "500",
            "--set",
            "joint_offset[y_axis].offset=±2 mm",
            "--out",
            "page.html",
            code=1,
        )


REACHES = "sources:\n  - length: {frame: tool, parameters: PARAMETERS}\n"


@pytest.fixture
def judged(run, folder):
    """Return what analyses a sheet with few samples against specifications: the outcome and the verdicts."""

    def command(text, *specs, code=0):
        (folder / "own.yaml").write_text(HEAD + text, "utf-8")
        words = [word for spec in specs for word in ("--spec", spec)]
        outcome = run("analyze", "own.yaml", "--samples", "300", *words, "--json", "found.json", code=code)
        found = json.loads((folder / "found.json").read_text("utf-8"))
        return outcome, [entry["verdict"] for entry in found["spec"]]

    return command


@pytest.mark.parametrize("case", NOTHING)
def test_where_nothing_varies_a_specification_is_not_met(run, folder, judged, case):
    text, code = NOTHING[case]
    outcome, verdicts = judged(text, "1 mm", code=1)
    assert verdicts == ["nothing to judge"]
    assert "spec |d| within 1 mm for 95 %: NOTHING TO JUDGE - no source" in outcome.out
    found = json.loads((folder / "found.json").read_text("utf-8"))
    assert found["spec"][0]["met"] is False
    assert any(code in line for line in found["warnings"])
    rare = run("reliability", "own.yaml", "--samples", "300", "--spec", "1 mm", "--json", "found.json", code=1)
    assert "|d| within 1 mm for 95 %: NOTHING TO JUDGE - no source" in rare.out
    (entry,) = _spec_entries(json.loads((folder / "found.json").read_text("utf-8")))
    assert (entry["met"], entry["verdict"]) == (False, "nothing to judge")
    for err in (outcome.err, rare.err):
        assert re.findall("W_NO_SOURCES|W_NOTHING_VARIES", err) == [code]
    assert code in run("check", "own.yaml").out


def test_each_quantity_is_judged_by_what_moves_it(judged):
    # joint1 turns about z: it moves no point up or down, and tilts nothing
    outcome, verdicts = judged(TURNS, "dz 1 mm", "dx 10 mm", "|d| 10 mm", "δx 1 mrad", "|δ| 1.5 mrad", code=1)
    assert verdicts == ["nothing to judge", "met", "met", "nothing to judge", "met"]
    assert "W_NOTHING" not in outcome.err
    # a constant error beyond the limit; and one of one size that changes its side
    fixed = REACHES.replace("PARAMETERS", "{fixed: 2 mm}")
    assert judged(fixed, "1 mm", "3 mm", code=1)[1] == ["not met", "nothing to judge"]
    assert judged(REACHES.replace("PARAMETERS", "{two_point: 1 mm}"), "1.1 mm")[1] == ["met"]


def test_a_rare_value_that_no_sample_met_is_judged(judged):
    # 1e-9 of the robots are off by 2 mm: 300 samples all alike hold 95 %, as Clopper and Pearson have it
    rare = "{two_point: 1 mm, centre: 1 mm, probability: 1e-9}"
    assert judged(REACHES.replace("PARAMETERS", rare), "1 mm")[1] == ["met"]


def test_a_large_limit_of_the_attitude_is_told_in_degrees_too(run):
    outcome = run("analyze", "--samples", "300", "--spec", "0.5 rad", "--spec", "20 mrad")
    assert "|δ| within 500 mrad (28.65 deg) for 95 %: MET" in outcome.out
    assert "|δ| within 20 mrad for 95 %: MET" in outcome.out


def test_too_few_samples_are_undecided(run, folder):
    (folder / "turns.yaml").write_text(HEAD + TURNS, "utf-8")
    for samples in (1, 71, 72):
        # with no failure the lower end is 0.025^(1/N), which reaches 95 % from N = 72 on
        enough = samples >= math.log(0.025) / math.log(0.95)
        outcome = run("analyze", "turns.yaml", "--samples", str(samples), "--spec", "1 m", code=0 if enough else 1)
        assert ("within 1000 mm for 95 %: MET" if enough else "within 1000 mm for 95 %: UNDECIDED - 100") in outcome.out


# assumptions ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_verdict_says_that_it_rests_on_assumptions(run, folder):
    line = "rests on assumptions: 1 of 1 sources are marked as assumed in the sheet (joint_offset)"
    caused = "they cause 100 % of the variance of the position, 100 % of the attitude"
    (folder / "assumed.yaml").write_text(HEAD + TURNS.replace("}}", "}, assumed: true}"), "utf-8")
    asked = ("assumed.yaml", "--samples", "300", "--spec", "5 mm", "--json", "found.json")
    for command, lines in (("analyze", slice(-3, -1)), ("reliability", slice(-2, None))):
        outcome = run(command, *asked, *(("--all",) if command == "analyze" else ()))
        first, second = outcome.out.splitlines()[lines]
        assert first == line
        assert second.startswith(caused)
        assert json.loads((folder / "found.json").read_text("utf-8"))["assumed"] == ["joint_offset[joint1]"]
    brief = run("analyze", *asked).out.replace("\n  ", " ")
    assert f"{line.removesuffix(' (joint_offset)')}; {caused}\n" in brief
    (folder / "own.yaml").write_text(HEAD + TURNS, "utf-8")
    own = run("analyze", "own.yaml", *asked[1:])
    assert "assum" not in own.out + own.err


def test_what_init_drafts_is_marked_as_assumed_in_every_source(run, folder):
    assert "all its numbers assumptions" in run("init", "gantry.urdf", "--out", "drafted.yaml").err
    outcome = run("analyze", "drafted.yaml", "--samples", "300", "--spec", "1 m", "--json", "-")
    sources = re.findall(r"^  - \w+: .*", (folder / "drafted.yaml").read_text("utf-8"), re.MULTILINE)
    assert len(outcome.json["assumed"]) == len(sources) > 3


@pytest.mark.slow
def test_init_starts_from_the_sheet_with_sources_of_its_chain(run, folder):
    if "ur5" not in example_urdfs():
        pytest.skip("example-robot-data is not installed")
    for name in ("ur5", "ur5e"):
        said = run("init", f"example:{name}").err
        assert "the sheet with sources that comes with precision-pin" in said
        assert (folder / f"{name}.errors.yaml").read_text("utf-8") == shipped_sheets()[name].read_text("utf-8")
    run("check", "ur5.errors.yaml")
    # an arm of the same name; and the same arm with another chain
    shutil.copy(example_urdfs()["ur5"], folder / "mine.urdf")
    said = run("init", "mine.urdf", "--tip", "tool0").err
    assert "(with sources: precision-pin init example:ur5, if this is such an arm)" in said
    said = run("init", "example:ur5", "--tip", "wrist_3_link", "--force").err
    shipped = "the sheet with sources that comes with precision-pin is of world to tool0"
    assert f"all its numbers assumptions ({shipped})" in said
    assert "assumed: true" in (folder / "ur5.errors.yaml").read_text("utf-8")


# check at the poses --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_check_tells_limits_as_analyze_does_at_every_one_of_many_poses(run, folder):
    more = "".join(f"  p{k}: 0 0 {400 if k == 299 else 0} 0 deg\n" for k in range(300))
    (folder / "many.yaml").write_text(HEAD.replace("10 30", "400 30") + more + TURNS, "utf-8")
    first, last = run("check", "many.yaml").out.splitlines()
    assert "W_JOINT_LIMIT: pose 'reach': joint joint2 at 400 deg is outside its limits -180 to 180 deg" in first
    assert first.replace("pose 'reach': ", "") in run("analyze", "many.yaml", "--samples", "10").err
    assert "pose 'p299': joint joint3 at 400 deg" in last


def test_what_analyze_refuses_at_a_pose_is_an_error_of_check(run, refused, folder):
    soft = "sources:\n  - frame: {joint: joint2, rx: {uniform: 1 deg, mean: 200 deg}}\n"
    (folder / "soft.yaml").write_text(HEAD + soft, "utf-8")
    said = refused("analyze", "soft.yaml", "--samples", "10")
    assert said.partition("E_INPUT: ")[2] in run("check", "soft.yaml", code=2).out
    (folder / "bare.yaml").write_text(HEAD.partition("poses")[0] + TURNS, "utf-8")
    assert "W_NO_POSES" in run("check", "bare.yaml").out


@pytest.mark.slow
def test_joint_values_of_the_command_line_are_asked_about(run):
    outcome = run("analyze", "--q", "90 0 45 0 rad", "--samples", "10")
    assert "W_ANGLE_UNIT: --q: joint1 at 90 rad is 5157 deg; did you mean deg?" in outcome.err
