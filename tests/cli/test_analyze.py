"""``analyze``: which arm and pose, its JSON against plain numpy, files whole or not at all, exit codes."""

import contextlib
import errno
import json
import math
import os
import re
import signal
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from scipy import stats
from scipy.special import betaincinv

import precision_pin as pp
import precision_pin.sampling
from cli.conftest import GANTRY, LONG, listing
from precision_pin.robot.examples import PAPER_SHEET

TURNING = f"""precision-pin: 1
robot: gantry.urdf
sources:
  - joint_offset: {{joint: {LONG}, offset: {{uniform: 0.3 mrad}}}}
"""
QUICK = ("analyze", "--samples", "200")

# which arm, which pose -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_sheet_and_robot_in_either_order_or_one_alone_or_none_are_the_papers_case(run):
    outcome = run("analyze")
    assert (outcome.code, outcome.said) == (0, [])
    first, second = outcome.out.splitlines()[:2]
    assert first == "4dof.urdf: base to tool, pose 'paper' (-90°, 3°, 88°, -91°)"
    assert second == "100,000 samples, seed 0, exact model, statics nominal, base axes, 95% confidence"
    robot, sheet = "4dof.urdf", "4dof.errors.yaml"
    given = ((), (robot,), (sheet,), (robot, sheet), (sheet, robot))
    assert len({run("analyze", *files, "--samples", "100", "--json", "-").out for files in given}) == 1


def test_robot_tip_and_base_of_the_command_line_replace_the_sheets(run, folder):
    (folder / "longer.urdf").write_text(GANTRY.replace("-0.5", "-1.0"))
    (folder / "turning.yaml").write_text(TURNING)
    arguments = ("turning.yaml", "--q", "0 m, 0 deg", "--samples", "100", "--model", "linear", "--json", "-")
    plain, longer = (run("analyze", *robot, *arguments).json for robot in ((), ("longer.urdf",)))
    assert (plain["robot"], longer["robot"], plain["model"]) == ("gantry.urdf", "longer.urdf", "linear")
    # the same turns at twice the distance
    assert longer["position"]["norm"]["max"] == pytest.approx(2 * plain["position"]["norm"]["max"], rel=1e-12)
    # a turn about an axis moves no point on the axis, and turns everything alike
    on_axis = run("analyze", *arguments, "--tip", "腕").json
    assert (plain["tip"], on_axis["tip"]) == ("tool", "腕")
    assert on_axis["position"]["norm"]["max"] == 0
    assert plain["position"]["norm"]["max"] > 1e-5
    assert on_axis["attitude"]["norm"]["max"] == plain["attitude"]["norm"]["max"] > 0
    based = run("analyze", "turning.yaml", "--base", "Schlitten_ü", "--q", "30 deg", "--samples", "50", "--json", "-")
    assert based.json["base"] == "Schlitten_ü"
    assert based.json["pose"] == {"name": "", "q": {LONG: pytest.approx(math.pi / 6)}}
    slide = run("analyze", "gantry.urdf", "--base", "Schlitten_ü", "--q", "30 deg", "--samples", "50", code=2)
    assert "y_axis" in slide.err  # a source and a pose of the sheet are about the joint that is cut off


def test_a_pose_by_name_by_values_and_the_first_one_without(run):
    def pose(*arguments):
        return run("analyze", *arguments, "--samples", "10", "--json", "-").json["pose"]

    assert pose("gantry.urdf")["name"] == "out"
    assert pose("gantry.urdf", "--pose", "home") == {"name": "home", "q": {"y_axis": 0.0, LONG: 0.0}}
    for text in ("0.25 m, 30 deg", f"{LONG}:30 deg,  y_axis: 250 mm"):
        values = {"y_axis": 0.25, LONG: pytest.approx(math.pi / 6, abs=1e-15)}
        assert pose("gantry.urdf", "--q", text) == {"name": "", "q": values}
    assert list(pose("--q", "0.5 0 0 -0.25 turn")["q"].values()) == pytest.approx([math.pi, 0, 0, -math.pi / 2])


# specifications and exit codes ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_specification_is_met_when_the_lower_end_reaches_it(run):
    # lower end of the Clopper-Pearson interval at 95 % where every sample is inside: (α/2)^(1/N), 99.632 %
    share = 0.025 ** (1 / 1000)
    for code, verdict, required in ((0, "met", 0.9963), (1, "undecided", 0.9964)):
        spec = ("--spec", f"1 m @ {100 * required} %")
        assert run("analyze", "--samples", "1000", *spec, "--json", "-", code=code).json["spec"] == [{
            "quantity": "position.norm",
            "limit": 1.0,
            "required": pytest.approx(required, rel=1e-15),
            "probability": 1.0,
            "interval": [pytest.approx(share, rel=1e-12), 1.0],
            "met": verdict == "met",
            "judged": True,
            "why_not_judged": None,
            "taken_as_exact": [],
            "linear_model": None,
            "verdict": verdict,  # all are inside: too few samples, no failure
            "cpk": None,
            "cpk_interval": [pytest.approx(stats.norm.ppf(share) / 3, rel=1e-9), None],
        }]  # fmt: skip


def test_one_specification_of_several_that_is_not_met_decides_the_exit_code(run):
    specs = {
        "1 m": ("position.norm", 1, 0.95, True),
        "x 1 nm": ("position.x", 1e-9, 0.95, False),
        "0.1 turn @ 0.9": ("attitude.norm", pytest.approx(0.2 * math.pi), 0.9, True),
        "position 1m@99%": ("position.norm", 1, 0.99, True),
        "rx 10000 arcsec @ 99 %": ("attitude.x", pytest.approx(math.radians(10000 / 3600)), 0.99, True),
    }
    words = [word for text in specs for word in ("--spec", text)]
    outcome = run("analyze", "--samples", "500", *words, "--json", "-", code=1)
    seen = [(one["quantity"], one["limit"], one["required"], one["met"]) for one in outcome.json["spec"]]
    assert seen == list(specs.values())


def test_an_internal_error_is_shown_whole_with_its_code(run, monkeypatch):
    monkeypatch.setattr("precision_pin.cli.analyze.read_sheet", Mock(side_effect=RuntimeError("planted")))
    outcome = run("analyze", code=3)
    assert outcome.out == ""
    assert "a bug in precision-pin" in outcome.err
    assert "RuntimeError: planted" in outcome.err


@pytest.mark.parametrize("around", [contextlib.suppress(KeyboardInterrupt), contextlib.nullcontext()])
def test_a_ctrl_c_even_one_that_a_library_has_swallowed_ends_with_one_line(run, monkeypatch, new_files, around):
    real = precision_pin.sampling.monte_carlo

    def interrupted(*arguments, **settings):
        with around:
            signal.raise_signal(signal.SIGINT)
        return real(*arguments, **settings)

    monkeypatch.setattr(precision_pin.sampling, "monte_carlo", interrupted)
    outcome = run("analyze", "--samples", "10", "--out", "plots", "--json", "result.json", code=130)
    assert (outcome.out, outcome.err) == ("", "interrupted\n")
    assert new_files() == set()


# JSON ----------------------------------------------------------------------------------------------------------------

TOP = [
    "schema", "complete", "robot", "base", "tip", "axes", "datum", "pose", "samples", "seed", "model", "statics", "scopes",
    "confidence", "versions", "warnings", "position", "attitude", "nominal", "covariance", "covariance_interval", "spec",
    "largest", "assumed", "findings",
]  # fmt: skip
LEVELS = {"0.5", "0.95", "0.99", "0.9973"}
"""Of the quantiles of a norm; the components have those at the other end too."""


def distributions(data):
    for quantity in ("position", "attitude"):
        for part in ("norm", "x", "y", "z"):
            yield f"{quantity}.{part}", data[quantity][part]


@pytest.mark.slow
def test_every_key_and_the_numbers_against_the_samples_themselves(run):
    asked = ("analyze", "--samples", "20000", "--seed", "5", "--spec", "x 10 mm @ 0.8", "--json", "-")
    data = run(*asked, code=1).json
    assert sorted(data) == sorted(TOP)
    assert (data["schema"], data["complete"]) == ("precision-pin/analysis/1", True)
    assert (data["robot"], data["base"], data["tip"], data["axes"]) == ("4dof.urdf", "base", "tool", "base")
    assert (data["samples"], data["seed"], data["model"], data["statics"]) == (20000, 5, "exact", "nominal")
    assert data["confidence"] == 0.95
    q = {f"joint{k}": pytest.approx(math.radians(value)) for k, value in enumerate((-90, 3, 88, -91), start=1)}
    assert data["pose"] == {"name": "paper", "q": q}
    assert {"python", "precision-pin", "pin", "numpy"} <= set(data["versions"])
    # the paper's sheet: six lengths, four discs for two points on each of four axes as pairs of numbers, four joints
    assert data["scopes"]["unit"] == 6 + 4 * 2 * 2 + 4
    model = pp.ErrorModel.load(PAPER_SHEET)
    at = model.at("paper")
    expected = at.exact(at.space.mean[:, None])[:, 0]
    np.testing.assert_allclose([*data["nominal"]["position"], *data["nominal"]["attitude"]], expected, rtol=1e-12)
    kept = pp.monte_carlo(model, samples=20_000, seed=5, keep_samples=True).errors
    assert kept is not None
    np.testing.assert_allclose(data["covariance"], np.cov(kept), rtol=1e-9, atol=1e-18)
    intervals = np.array(data["covariance_interval"], dtype=float)
    assert (intervals[:, :, 0] < data["covariance"]).all()
    assert (intervals[:, :, 1] > data["covariance"]).all()
    norms = (np.sqrt((kept[rows] ** 2).sum(axis=0)) for rows in (slice(3), slice(3, 6)))
    rows = [row for norm, parts in zip(norms, (kept[:3], kept[3:]), strict=True) for row in (norm, *parts)]
    for (name, entry), values in zip(distributions(data), rows, strict=True):
        is_norm = name.endswith("norm")
        assert set(entry["quantiles"]) == set(entry["quantile_interval"])
        assert set(entry["quantiles"]) == LEVELS | (set() if is_norm else {"0.00135", "0.01", "0.05"})
        assert entry["mean"] == pytest.approx(values.mean(), abs=1e-12 * np.abs(values).max()), name
        assert entry["std"] == pytest.approx(values.std(ddof=1), rel=1e-9), name
        assert entry["min"] == pytest.approx(values.min(), rel=1e-12), name
        assert entry["max"] == pytest.approx(values.max(), rel=1e-12), name
        for level, quantile in entry["quantiles"].items():
            # binned: to a bin, 2⁻⁹ of the distance from the centre
            reach = 2**-9 * abs(np.quantile(values, float(level)) - values.mean()) + 2**-11 * values.std()
            assert quantile == pytest.approx(np.quantile(values, float(level)), abs=reach), (name, level)
            low, high = entry["quantile_interval"][level]
            assert entry["min"] <= low <= quantile <= high <= entry["max"], (name, level)
        for content, (low, high) in entry["tolerance_bounds"].items():
            # one-sided for a norm; two-sided bounds enclose more than the quantile of one side
            assert low == 0 if is_norm else low < entry["quantiles"]["0.05"], name
            assert high > entry["quantiles"][content], name
    inside = int((np.abs(kept[0]) <= 0.01).sum())
    (entry,) = data["spec"]
    assert entry["probability"] == inside / 20_000
    assert entry["interval"] == [
        pytest.approx(betaincinv(inside, 20_000 - inside + 1, 0.025), rel=1e-9),
        pytest.approx(betaincinv(inside + 1, 20_000 - inside, 0.975), rel=1e-9),
    ]


def test_null_where_the_samples_do_not_resolve_a_number(run):
    for samples in (1, 50, 2000):
        data = run("analyze", "--samples", str(samples), "--json", "-").json
        assert (data["covariance"] is None) == (samples == 1)
        for name, entry in distributions(data):
            assert all(isinstance(entry[key], float) for key in ("mean", "min", "max")), name
            assert (entry["std"] is None) == (samples == 1), name
            assert samples > 50 or entry["mode"] is None, name
            for level, value in entry["quantiles"].items():
                # smallest and largest of the samples enclose a quantile with 95 %: 1 - p^N - (1-p)^N
                is_resolved = 1 - float(level) ** samples - (1 - float(level)) ** samples >= 0.95
                assert (value is not None) == is_resolved, (name, level)
                assert (entry["quantile_interval"][level] is None) == (value is None), (name, level)


# files ---------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_out_holds_the_plots_and_the_result_and_leaves_other_files(run, folder):
    out = folder / "deep" / "er"
    out.mkdir(parents=True)
    (out / "position.png").write_text("old")
    (out / "notes.txt").write_text("mine")
    outcome = run(*QUICK, "--q", "0 0 0 200 deg", "--out", "deep/er", "--json", "-")
    warned, wrote = outcome.said
    # the path within the package
    path = r"precision_pin/robots/4dof\.urdf:\d+"
    assert re.fullmatch(rf"{path}: warning W_JOINT_LIMIT: joint joint4 at 200 deg.*", warned)
    assert wrote == "wrote deep/er: analysis.json, position, attitude and components as PNG and SVG"
    # what the paper's sheet accepts is in the result, and not printed
    (listed,) = [one for one in outcome.json["warnings"] if ": note W_STATICS: " not in one]
    assert listed.endswith(warned)
    plots = [f"{name}.{suffix}" for name in ("position", "attitude", "components") for suffix in ("png", "svg")]
    assert {path.name for path in out.iterdir()} == {*plots, "analysis.json", "notes.txt"}
    assert (out / "notes.txt").read_text() == "mine"
    assert (out / "analysis.json").read_text("utf-8") == outcome.out
    for name in plots:
        start = b"\x89PNG\r\n" if name.endswith("png") else b"<?xml"
        assert (out / name).read_bytes().startswith(start)


@pytest.mark.slow
def test_a_limit_across_the_tool_has_a_plot_of_its_zone(run, folder):
    limits = "--spec", "0.3 m zone @ 90 %", "--spec", "all of: 150 mm lateral, 90 mm axial @ 90 %"
    outcome = run(*QUICK, *limits, "--json", "-", "--out", "plots")
    assert outcome.said[-1] == "wrote plots: analysis.json, position, attitude, components and zone as PNG and SVG"
    assert all((folder / "plots" / f"zone.{suffix}").stat().st_size for suffix in ("png", "svg"))
    assert [(spec["quantity"], spec["limit"]) for spec in outcome.json["spec"]] == [
        ("position.zone", pytest.approx(0.3)), ("all of: 150 mm lateral, 90 mm axial", 1.0),
    ]  # fmt: skip


def test_json_to_a_file_through_a_link_and_to_a_device(run, folder):
    (folder / "elsewhere").mkdir()
    (folder / "link.json").symlink_to(folder / "elsewhere" / "real.json")
    outcome = run(*QUICK, "--json", "link.json")
    assert "99.73 %" in outcome.out  # the table is printed as well
    assert (folder / "link.json").is_symlink()
    assert json.loads((folder / "elsewhere" / "real.json").read_text("utf-8"))["samples"] == 200
    mask = os.umask(0)
    os.umask(mask)
    assert (folder / "elsewhere" / "real.json").stat().st_mode & 0o777 == 0o666 & ~mask
    run(*QUICK, "--json", "/dev/null")
    assert Path("/dev/null").is_char_device()


def test_a_folder_without_the_right_to_write(refused, folder, monkeypatch):
    (folder / "locked").mkdir()
    # root may write anywhere, so the system's answer is planted
    real = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: real(path, mode) and not str(path).endswith("locked"))
    for target in (("--json", "locked/result.json"), ("--out", "locked"), ("--out", "locked/new/er")):
        line = refused(*QUICK, *target)
        assert line.endswith("locked is not writable")
        assert "error E_OUTPUT" in line


def test_a_full_disk_leaves_nothing_half_written(run, folder, monkeypatch):
    """The JSON alone cannot be written; or it can, and the plots after it cannot."""

    def full(*arguments):
        next(one for one in arguments if isinstance(one, Path)).touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (folder / "plots").mkdir()
    for name in ("result.json", "plots/position.svg"):
        (folder / name).write_text("before")
    before = listing(folder)
    for asked, place in (
        ("--json result.json", "pathlib.Path.write_bytes"),
        ("--out plots", "precision_pin.sampling.figures.save"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(place, full)
            done = run(*QUICK, *asked.split(), code=2)
        (line,) = done.said
        assert re.search("error E_OUTPUT: cannot write .*: No space left on device", line)
        assert done.out.startswith("4dof.urdf")  # the work is not lost
        assert listing(folder) == before
