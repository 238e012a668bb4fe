"""``check``, ``init``, ``mcpc``, ``schema``, ``doctor``, ``explain``, help and version."""

import csv
import importlib.metadata
import itertools
import json
import math
import re

import click
import pytest

import precision_pin as pp
from cli.conftest import GANTRY, LINE
from precision_pin.base.versions import _version
from precision_pin.cli import program
from precision_pin.cli.program import list_commands, load_command
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import json_schema


def test_check_of_what_is_good_and_of_a_urdf_without_sheet_and_tip(run, refused):
    for arguments in ((), ("4dof.urdf",), ("4dof.errors.yaml",), ("gantry.urdf", "gantry.errors.yaml")):
        outcome = run("check", *arguments)
        assert (outcome.out, outcome.err_lines[-1]) == ("", "no errors, 0 warnings"), arguments
        assert all(": note " in line for line in outcome.err_lines[:-1]), arguments
    outcome = run("check", "forked.urdf")
    assert outcome.err == "no errors, 1 warning\n"
    assert re.match(r"forked\.urdf:\d+: warning W_BRANCHED: .*'left', 'right'", outcome.out)
    # with a tip it looks at the chain too
    run("check", "forked.urdf", "--tip", "left")
    assert "no link named 'lfet'; did you mean 'left'?" in refused("check", "forked.urdf", "--tip", "lfet")


def test_check_says_how_a_drawing_s_tolerance_was_read(run, folder):
    lengths = ("+0.5/-0.1 mm", "{normal: H7, size: 50 mm}", "±0.2 mm")
    entries = "".join(f"  - length: {{joint: joint{k}, parameters: {text}}}\n" for k, text in enumerate(lengths, 2))
    text = f"precision-pin: 1\nrobot: 4dof.urdf\nposes: {{p: 0 0 0 0 deg}}\nsources:\n{entries}"
    (folder / "drawn.errors.yaml").write_text(text, encoding="utf-8")
    outcome = run("check", "drawn.errors.yaml", "--json")
    notes = [note["message"] for note in json.loads(outcome.out)["notes"] if note["code"] == "N_LIMITS"]
    assert notes == [
        "length[joint2].parameters: +0.5/-0.1 mm: uniform within ±0.3 mm about 0.2 mm",
        "length[joint3].parameters: H7 of 50 mm, +0.025/0 mm: normal, standard deviation 0.00416667 mm, mean 0.0125 mm",
    ]


def test_check_lists_every_finding_of_a_urdf_with_its_line_and_as_json(run, folder):
    text = (folder / "4dof.urdf").read_text().replace('<mass value="1.4"/>', '<mass value="-1"/>', 1)
    text = text.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', 1)
    (folder / "bad.urdf").write_text(text)
    printed = run("check", "bad.urdf", code=2).out.splitlines()
    assert all(LINE.fullmatch(line) for line in printed)
    for mark in ('"-1"', '<axis xyz="0 0 0"/>'):
        line = 1 + text[: text.index(mark)].count("\n")
        assert any(one.startswith(f"bad.urdf:{line}: error ") for one in printed)
    # analyze refuses with the same errors, on stderr
    refused = run("analyze", "bad.urdf", "4dof.errors.yaml", code=2)
    assert refused.out == ""
    assert {line for line in printed if " error " in line} <= set(refused.err_lines)
    outcome = run("check", "--json", "bad.urdf", code=2)
    assert (outcome.err, sorted(outcome.json)) == ("", ["errors", "warnings"])
    for entry in outcome.json["errors"]:
        assert sorted(entry) == ["code", "file", "line", "message"]
        assert f"bad.urdf:{entry['line']}: error {entry['code']}: {entry['message']}" in printed
    sheet = (folder / "4dof.errors.yaml").read_text("utf-8")
    (folder / "good.yaml").write_text(re.sub(r"accept:.*\n.*\n", "", sheet), "utf-8")
    good = run("check", "--json", "good.yaml")
    assert (good.json, good.err) == ({"errors": [], "warnings": []}, "")
    assert [entry["code"] for entry in run("check", "--json", "forked.urdf").json["warnings"]] == ["W_BRANCHED"]
    assert len(run("check", "--json", "nosuch.urdf", code=2).json["errors"]) == 1


@pytest.mark.slow
def test_a_broken_mesh_is_one_warning_of_check_and_no_hindrance_of_view(run, folder):
    (folder / "far.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999\n")
    for name, words in (("missing.stl", "does not exist"), ("far.obj", "face indices outside its 3 vertices")):
        mesh = f'<link name="tool">\n<visual><geometry>\n<mesh filename="{name}"/></geometry></visual></link>'
        (folder / "gantry.urdf").write_text(GANTRY.replace('<link name="tool"/>', mesh), encoding="utf-8")
        outcome = run("check", "gantry.urdf")
        assert outcome.err == "no errors, 1 warning\n", name
        assert re.fullmatch(rf"gantry\.urdf:3: warning W_MESH_[A-Z]+: .*{re.escape(words)}.*\n", outcome.out), name
    run("view", "gantry.errors.yaml", "--samples", "100", "--out", "page.html")
    assert (folder / "page.html").exists()


def test_mcpc_prints_the_papers_table_1(run):
    outcome = run("mcpc")
    assert outcome.err == ""
    # Table 1 with a_1 = 85, a_2 = 1970, a_3 = 96, a_4 = 1770, a_5 = 93 mm
    assert [line.split() for line in outcome.out.splitlines()] == [
        ["i", "joint", "offset", "°", "α", "°", "β", "°", "γ", "°", "x", "mm", "y", "mm", "z", "mm"],
        ["0", "base", "0", "0", "0", "0", "0"],
        ["1", "joint1", "0", "-90", "0", "0", "-85"],
        ["2", "joint2", "0", "0", "0", "1970", "0"],
        ["3", "joint3", "0", "0", "0", "1770", "0"],
        ["4", "joint4", "0", "0", "0", "0", "0", "0", "-274"],
    ]


def test_mcpc_as_json_and_of_a_urdf_alone(run):
    assert run("mcpc", "4dof.urdf").out == run("mcpc").out
    data = run("mcpc", "--json").json
    assert (sorted(data), data["base"], data["tip"]) == (["base", "links", "tip"], "base", "tool")
    keys = ["alpha", "beta", "gamma", "joint", "link", "prismatic", "shift", "turn", "x", "y", "z"]
    assert all(sorted(row) == keys for row in data["links"])
    one, last = data["links"][1], data["links"][4]
    assert (one["alpha"], one["y"], last["z"]) == pytest.approx((-math.pi / 2, -0.085, -0.274), abs=1e-15)
    assert [row["gamma"] is None for row in data["links"]] == [True, True, True, True, False]
    outcome = run("mcpc", "forked.urdf", "--tip", "right", "--json")
    # which of its tips is meant is settled
    assert (outcome.json["tip"], outcome.err) == ("right", "")


def test_init_to_stdout_or_beside_the_user_and_over_a_sheet_only_when_told(run, refused, folder):
    printed = run("init", "forked.urdf", "--tip", "left", "--out", "-").out
    outcome = run("init", "forked.urdf", "--tip", "left")
    assert outcome.out == ""
    assert outcome.err.endswith("now: precision-pin analyze forked.errors.yaml\n")
    assert (folder / "forked.errors.yaml").read_text("utf-8") == printed
    assert "forked.errors.yaml exists; --force overwrites it" in refused("init", "forked.urdf", "--tip", "right")
    run("init", "forked.urdf", "--tip", "right", "--force")
    assert (folder / "forked.errors.yaml").read_text("utf-8") != printed


def test_schema_and_doctor(run, monkeypatch):
    outcome = run("schema")
    assert (outcome.err, outcome.json) == ("", json_schema())
    outcome = run("doctor")
    assert outcome.err == ""
    for name in ("precision-pin", "pin", "numpy", "numba"):
        assert re.search(rf"(?m)^{name} +{re.escape(importlib.metadata.version(name))}$", outcome.out), name
    assert len({re.search("  +", line).end() for line in outcome.out.splitlines()}) == 1  # one column
    assert str(PAPER_SHEET) in outcome.out
    assert "MISSING" not in outcome.out

    def none_has_it(name):  # as conda's pinocchio, which has no such distribution
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", none_has_it)
    _version.cache_clear()
    assert re.search(r"(?m)^pin +unknown$", run("doctor").out)
    _version.cache_clear()


# help and version ----------------------------------------------------------------------------------------------------


def test_help_tells_defaults_and_is_shown_without_a_command_and_the_version_is_told(run):
    assert "100,000" in run("analyze", "--help").out
    assert run("--version").out.split()[-1] == importlib.metadata.version("precision-pin")
    # no command shows the help
    assert "Decide what to change:" in run(code=2).lines


@pytest.mark.parametrize("name", list_commands())
def test_help_has_every_option_once_under_a_heading(run, name):
    outcome = run(name, "-h")
    assert outcome.err == ""
    assert outcome.out.startswith(f"Usage: precision-pin {name} ")
    assert max(map(len, outcome.out.splitlines())) <= 110
    usage, *sections = re.split(r"(?m)^(?=\S.*:$)", outcome.out)
    listed = {one.partition(":")[0]: re.findall(r"(?m)^  (--?[\w-]+)", one) for one in sections}
    options = [option.opts[0] for option in load_command(name).params if isinstance(option, click.Option)]
    assert sorted(itertools.chain.from_iterable(listed.values())) == sorted(["-h", *options])
    for option, home in {
        "--pose": "Poses",
        "--grid": "Poses",
        "--tip": "Robot and sheet",
        "--seed": "Sampling",
        "--threads": "Sampling",
        "--json": "Output and messages",
        "--quiet": "Output and messages",
    }.items():
        assert option not in options or option in listed[home]
    if name == "calibrate":
        assert "--forecast" in listed["Before anything is measured"]
        assert "--urdf" in listed["Fit to readings"]
        assert "--population" in listed["Several robots"]
        assert "Fit:     calibrate SHEET DATA.csv " in usage


def test_completion_is_made_for_each_shell(run, monkeypatch):
    for shell in ("bash", "zsh", "fish"):
        monkeypatch.setenv("_PRECISION_PIN_COMPLETE", f"{shell}_source")
        assert f"_PRECISION_PIN_COMPLETE={shell}_complete" in run().out
    monkeypatch.setenv("_PRECISION_PIN_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_LINE", "precision-pin analyze --spec")
    assert "plain,--spec-everywhere" in run().out.split()


def test_codes_are_explained(run, refused):
    one = run("explain", "w_superposition").out
    assert one.startswith("W_SUPERPOSITION (warnings about a result)\n  means  ")
    assert "the three models (page model of the documentation)" in " ".join(one.split())
    assert max(map(len, run("explain").out.splitlines())) <= 100
    assert "no code named 'W_STATIC'; did you mean 'W_STATICS'" in refused("explain", "W_STATIC")


# an output is a file and the line of its command: one is added here, and runs as every command does


OUTPUT = '''
import click

from precision_pin.base.files import write_text
from precision_pin.cli.inputs import Outputs
from precision_pin.model.error_model import ErrorModel


@click.command("variances")
@click.argument("sheet")
@click.option("--out", required=True)
def command(sheet, out):
    """Write the variance of every random number, as CSV."""
    outputs = Outputs({"--out": out})
    outputs.check([sheet])
    space = ErrorModel.load(sheet).space
    rows = zip(space.components, space.covariance.diagonal().tolist())
    write_text(out, "component,variance\\n" + "".join(f"{name},{variance!r}\\n" for name, variance in rows))
    return 0
'''


@pytest.mark.slow
def test_an_added_output_is_a_command_as_any_other(run, refused, folder, monkeypatch):
    (folder / "variances_output.py").write_text(OUTPUT)
    monkeypatch.syspath_prepend(folder)
    line = ("variances_output", program.SHOW, "Write the variance of every random number.")
    monkeypatch.setattr(program, "COMMANDS", {**program.COMMANDS, "variances": line})
    assert "Write the variance of every random number." in run("--help").out
    assert "as CSV" in run("variances", "--help").out
    done = run("variances", str(PAPER_SHEET), "--out", "variances.csv")
    assert (done.out, done.err) == ("", "")
    rows = list(csv.reader((folder / "variances.csv").read_text().splitlines()))
    space = pp.ErrorModel.load(PAPER_SHEET).space
    variances = map(repr, space.covariance.diagonal().tolist())
    assert rows == [["component", "variance"], *map(list, zip(space.components, variances, strict=True))]
    # a mistake ends as everywhere: a line, exit code 2, nothing written
    refused("variances", "missing.errors.yaml", "--out", "none.csv")
    assert "variances" in refused("variance")
