"""``precision-pin analyze`` as its users meet it: which arm, which pose, what is printed, how it ends."""

from __future__ import annotations

import contextlib
import math
import re
import signal

import pytest
from scipy import stats

LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"
TURNING = f"""precision-pin: 1
robot: gantry.urdf
sources:
  - joint_offset: {{joint: {LONG}, offset: {{uniform: 0.3 mrad}}}}
"""


@pytest.mark.slow
def test_no_arguments_run_the_papers_case(run):
    outcome = run("analyze")
    assert outcome.code == 0
    assert outcome.said == []
    first, second = outcome.out.splitlines()[:2]
    assert first == "4dof.urdf: base to tool, pose 'paper' (-90°, 3°, 88°, -91°)"
    assert second == "100,000 samples, seed 0, exact model, statics nominal, base axes, 95% confidence"


@pytest.mark.slow
def test_the_robot_and_the_sheet_may_come_in_either_order(run):
    arguments = ("--samples", "100", "--json", "-")
    one = run("analyze", "4dof.urdf", "4dof.errors.yaml", *arguments)
    other = run("analyze", "4dof.errors.yaml", "4dof.urdf", *arguments)
    assert one.code == other.code == 0
    assert one.out == other.out


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [("4dof.urdf",), ("4dof.errors.yaml",)])
def test_a_sheet_beside_the_robot_is_found_and_a_sheet_names_its_robot(run, arguments):
    outcome = run("analyze", *arguments, "--samples", "100", "--json", "-")
    assert outcome.code == 0
    assert outcome.json["robot"] == "4dof.urdf"
    assert outcome.json["pose"]["name"] == "paper"
    assert outcome.out == run("analyze", "--samples", "100", "--json", "-").out


@pytest.mark.slow
def test_a_robot_on_the_command_line_overrides_the_sheets(run, folder):
    (folder / "longer.urdf").write_text((folder / "gantry.urdf").read_text().replace("0 0 -0.5", "0 0 -1"))
    (folder / "turning.yaml").write_text(TURNING)
    arguments = ("turning.yaml", "--q", "0 m, 0 deg", "--samples", "100", "--model", "linear", "--json", "-")
    short, long = run("analyze", *arguments), run("analyze", "longer.urdf", *arguments)
    assert (short.json["robot"], long.json["robot"]) == ("gantry.urdf", "longer.urdf")
    # the same turns at twice the distance
    assert long.json["position"]["norm"]["max"] == pytest.approx(2 * short.json["position"]["norm"]["max"], rel=1e-12)


@pytest.mark.slow
def test_an_example_robot_with_a_sheet(run, folder):
    (folder / "mine.yaml").write_text(
        "precision-pin: 1\nrobot: 4dof.urdf\ntip: tool0\nposes: {bent: 20 -70 80 -100 -90 10 deg}\n"
        "sources:\n  - joint_offset: {joint: elbow_joint, offset: {uniform: 1 mrad}}\n"
    )
    outcome = run("analyze", "example:ur5", "mine.yaml", "--samples", "200", "--json", "-")
    assert outcome.code == 0
    assert outcome.json["robot"].startswith("ur5")
    assert list(outcome.json["pose"]["q"]) == [
        "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
    ]  # fmt: skip
    # one joint that errs by at most 1 mrad turns the tool by at most that
    assert 0.9e-3 < outcome.json["attitude"]["norm"]["max"] <= 1e-3


def test_a_robot_without_a_sheet_says_how_to_get_one(run, new_files):
    outcome = run("analyze", "example:ur10")
    assert outcome.code == 2
    assert "precision-pin init example:ur10" in outcome.err
    assert len(outcome.err_lines) == 1
    assert new_files() == set()


def test_tip_on_the_command_line(run, folder):
    (folder / "turning.yaml").write_text(TURNING)
    arguments = ("--q", "0 m, 0 deg", "--samples", "50", "--json", "-")
    at_tool = run("analyze", "turning.yaml", *arguments).json
    on_axis = run("analyze", "turning.yaml", "--tip", "腕", *arguments).json
    assert (at_tool["tip"], on_axis["tip"]) == ("tool", "腕")
    # a turn about an axis moves no point on the axis, and turns everything alike
    assert on_axis["position"]["norm"]["max"] == 0
    assert at_tool["position"]["norm"]["max"] > 1e-5
    assert on_axis["attitude"]["norm"]["max"] == at_tool["attitude"]["norm"]["max"] > 0


def test_base_on_the_command_line(run, folder):
    (folder / "turning.yaml").write_text(TURNING)
    outcome = run("analyze", "turning.yaml", "--base", "Schlitten_ü", "--q", "30 deg", "--samples", "50", "--json", "-")
    assert outcome.code == 0
    assert outcome.json["base"] == "Schlitten_ü"
    assert outcome.json["pose"] == {"name": "", "q": {LONG: pytest.approx(math.pi / 6)}}
    slide = run("analyze", "gantry.urdf", "--base", "Schlitten_ü", "--q", "30 deg", "--samples", "50")
    assert slide.code == 2
    assert "y_axis" in slide.err  # a source and a pose of the sheet are about the joint that is cut off


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("-90 3 88 -91 deg", (-90, 3, 88, -91)),
        ("-90 deg, 3 deg, 88 deg, -91 deg", (-90, 3, 88, -91)),
        ("joint4: -91 deg, joint1: -90 deg,joint3: 88 deg,  joint2:3 deg", (-90, 3, 88, -91)),
        ("0.5 0 0 -0.25 turn", (180, 0, 0, -90)),
    ],
)
def test_joint_values_in_three_forms(run, text, values):
    outcome = run("analyze", "--q", text, "--samples", "10", "--json", "-")
    assert outcome.code == 0
    pose = outcome.json["pose"]
    assert pose["name"] == ""
    assert list(pose["q"]) == ["joint1", "joint2", "joint3", "joint4"]
    assert list(pose["q"].values()) == pytest.approx([math.radians(value) for value in values], abs=1e-15)


def test_joint_values_of_joints_that_turn_and_slide(run):
    for text in ("0.25 m, 30 deg", f"y_axis: 250 mm, {LONG}: 30 deg"):
        outcome = run("analyze", "gantry.urdf", "--q", text, "--samples", "10", "--json", "-")
        assert outcome.json["pose"]["q"] == {"y_axis": 0.25, LONG: pytest.approx(math.pi / 6, abs=1e-15)}


def test_a_pose_by_name_and_the_first_one_without(run):
    assert run("analyze", "gantry.urdf", "--samples", "10", "--json", "-").json["pose"]["name"] == "out"
    named = run("analyze", "gantry.urdf", "--pose", "home", "--samples", "10", "--json", "-").json["pose"]
    assert named == {"name": "home", "q": {"y_axis": 0.0, LONG: 0.0}}


@pytest.mark.slow
def test_values_outside_the_limits_warn_and_run(run):
    outcome = run("analyze", "--q", "0 0 0 200 deg", "--samples", "10", "--json", "-")
    assert outcome.code == 0
    (line,) = outcome.err_lines
    # the path within the package
    assert re.fullmatch(r"precision_pin/robots/4dof\.urdf:\d+: warning W_JOINT_LIMIT: joint joint4 at 200 deg.*", line)
    # what the paper's sheet accepts is in the result, and not printed
    (listed,) = [one for one in outcome.json["warnings"] if ": note W_STATICS: " not in one]
    assert listed.endswith(line)


@pytest.mark.slow
def test_the_two_models_agree_to_first_order(run):
    outcome = run("analyze", "--model", "linear", "--samples", "10", "--json", "-")
    assert outcome.json["model"] == "linear"
    assert outcome.code == 0
    exact = run("analyze", "--samples", "10", "--json", "-")
    assert exact.json["model"] == "exact"
    assert exact.json["position"] != outcome.json["position"]
    # one seed draws the same robots for both, so they differ by second order only
    for quantity in ("position", "attitude"):
        assert outcome.json[quantity]["norm"]["mean"] == pytest.approx(exact.json[quantity]["norm"]["mean"], rel=1e-2)


# specifications and exit codes ---------------------------------------------------------------------------------------


def lowest_share(samples: int) -> float:
    """Lower end of the Clopper-Pearson interval at 95 % where every sample is inside: (α/2)^(1/N)."""
    return 0.025 ** (1 / samples)


@pytest.mark.slow
def test_a_specification_is_met_when_the_lower_end_reaches_it(run):
    share = lowest_share(1000)  # 99.632 %
    met = run("analyze", "--samples", "1000", "--spec", "1 m @ 99.63 %", "--json", "-")
    missed = run("analyze", "--samples", "1000", "--spec", "1 m @ 99.64 %", "--json", "-")
    assert (met.code, missed.code) == (0, 1)
    for outcome, verdict, required in ((met, True, 0.9963), (missed, False, 0.9964)):
        (entry,) = outcome.json["spec"]
        assert entry == {
            "quantity": "position.norm",
            "limit": 1.0,
            "required": pytest.approx(required, rel=1e-15),
            "probability": 1.0,
            "interval": [pytest.approx(share, rel=1e-12), 1.0],
            "met": verdict,
            "judged": True,
            "why_not_judged": None,
            "taken_as_exact": [],
            "verdict": "met" if verdict else "undecided",  # all are inside: too few samples, no failure
            "cpk": None,
            "cpk_interval": [pytest.approx(stats.norm.ppf(share) / 3, rel=1e-9), None],
        }


def test_one_specification_of_several_that_is_not_met_decides_the_exit_code(run):
    specs = ("--spec", "1 m", "--spec", "x 1 nm", "--spec", "attitude 1 rad @ 0.9")
    outcome = run("analyze", "--samples", "500", *specs, "--json", "-")
    assert outcome.code == 1
    assert [entry["met"] for entry in outcome.json["spec"]] == [True, False, True]
    assert [entry["required"] for entry in outcome.json["spec"]] == [0.95, 0.95, 0.9]


SPECIFICATIONS = (
    ("0.5 mm", "position.norm", 0.5e-3, 0.95),
    (".5 mm", "position.norm", 0.5e-3, 0.95),
    ("0.5mm@99.73%", "position.norm", 0.5e-3, 0.9973),
    ("0.5 mm @ 99.73 %", "position.norm", 0.5e-3, 0.9973),
    (" 0.5 mm  @  0.9 ", "position.norm", 0.5e-3, 0.9),
    ("1 mrad", "attitude.norm", 1e-3, 0.95),
    ("0.1 deg @ 99 %", "attitude.norm", math.pi / 1800, 0.99),
    ("position 20 um", "position.norm", 20e-6, 0.95),
    ("x 0.2 mm", "position.x", 0.2e-3, 0.95),
    ("y 0.2 mm", "position.y", 0.2e-3, 0.95),
    ("z 2e-4 m", "position.z", 0.2e-3, 0.95),
    ("rx 10 arcsec", "attitude.x", math.pi / 64800, 0.95),
    ("ry 1 mrad", "attitude.y", 1e-3, 0.95),
    ("rz 1 mrad", "attitude.z", 1e-3, 0.95),
    ("position.y 0.2 mm", "position.y", 0.2e-3, 0.95),
)


def test_how_a_specification_may_be_written(run):
    words = [word for text, *_ in SPECIFICATIONS for word in ("--spec", text)]
    entries = run("analyze", "--samples", "10", *words, "--json", "-").json["spec"]
    for entry, (_, quantity, limit, required) in zip(entries, SPECIFICATIONS, strict=True):
        assert entry["quantity"] == quantity
        assert entry["limit"] == pytest.approx(limit, rel=1e-14)
        assert entry["required"] == pytest.approx(required, rel=1e-14)


def test_an_internal_error_is_shown_whole_with_its_code(run, monkeypatch):
    def broken(*arguments: object, **settings: object) -> object:
        raise RuntimeError("planted")

    monkeypatch.setattr("precision_pin.cli.analyze.read_sheet", broken)
    outcome = run("analyze")
    assert outcome.code == 3
    assert "a bug in precision-pin" in outcome.err
    assert "RuntimeError: planted" in outcome.err
    assert outcome.out == ""


def test_ctrl_c_ends_with_one_line(run, monkeypatch, new_files):
    def interrupted(*arguments: object) -> object:
        raise KeyboardInterrupt

    monkeypatch.setattr("precision_pin.model.error_model.PoseModel.findings", interrupted)
    outcome = run("analyze", "--samples", "10", "--out", "plots", "--json", "result.json")
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "interrupted\n")
    assert new_files() == set()


def test_a_ctrl_c_that_a_library_has_swallowed_ends_the_run_all_the_same(run, monkeypatch, new_files):
    import precision_pin.sampling

    real = precision_pin.sampling.monte_carlo

    def swallowing(*arguments: object, **settings: object) -> object:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return real(*arguments, **settings)

    monkeypatch.setattr(precision_pin.sampling, "monte_carlo", swallowing)
    outcome = run("analyze", "--samples", "10", "--json", "result.json")
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "interrupted\n")
    assert new_files() == set()
