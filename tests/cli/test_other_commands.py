"""``check``, ``init``, ``mcpc``, ``schema``, ``doctor``, ``explain``, help and version."""

from __future__ import annotations

import csv
import importlib.metadata
import itertools
import math
import re
from pathlib import Path

import click
import pytest

import precision_pin as pp
from cli.conftest import GANTRY, Run
from precision_pin.base.versions import _version
from precision_pin.cli import program
from precision_pin.cli.program import list_commands, load_command
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import json_schema

FINDING = re.compile(r"[^:\n]+(:\d+)?: (error|warning) [EW]_[A-Z_]+: .+")


def test_check_of_what_is_good_and_of_a_urdf_without_sheet_and_tip(run):
    for arguments in ((), ("4dof.urdf",), ("4dof.errors.yaml",), ("gantry.urdf", "gantry.errors.yaml")):
        outcome = run("check", *arguments)
        assert (outcome.code, outcome.out, outcome.err_lines[-1]) == (0, "", "no errors, 0 warnings"), arguments
        assert all(": note " in line for line in outcome.err_lines[:-1]), arguments
    outcome = run("check", "forked.urdf")
    assert (outcome.code, outcome.err) == (0, "no errors, 1 warning\n")
    assert re.match(r"forked\.urdf:\d+: warning W_BRANCHED: .*'left', 'right'", outcome.out)
    # with a tip it looks at the chain too
    assert run("check", "forked.urdf", "--tip", "left").code == 0
    outcome = run("check", "forked.urdf", "--tip", "lfet")
    assert outcome.code == 2
    assert "no link named 'lfet'; did you mean 'left'?" in outcome.out


def test_check_lists_every_finding_of_a_urdf_with_its_line_and_as_json(run, folder):
    text = (folder / "4dof.urdf").read_text().replace('<mass value="1.4"/>', '<mass value="-1"/>', 1)
    text = text.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', 1)
    (folder / "bad.urdf").write_text(text)
    outcome = run("check", "bad.urdf")
    assert outcome.code == 2
    printed = outcome.out.splitlines()
    assert all(FINDING.fullmatch(line) for line in printed)
    for mark in ('"-1"', '<axis xyz="0 0 0"/>'):
        line = 1 + text[: text.index(mark)].count("\n")
        assert any(one.startswith(f"bad.urdf:{line}: error ") for one in printed)
    # analyze refuses with the same errors, on stderr
    (folder / "bad.yaml").write_text((folder / "4dof.errors.yaml").read_text())
    refused = run("analyze", "bad.urdf", "bad.yaml")
    assert (refused.code, refused.out) == (2, "")
    assert {line for line in printed if " error " in line} <= set(refused.err_lines)
    outcome = run("check", "--json", "bad.urdf")
    assert (outcome.code, outcome.err, sorted(outcome.json)) == (2, "", ["errors", "warnings"])
    for entry in outcome.json["errors"]:
        assert sorted(entry) == ["code", "file", "line", "message"]
        assert f"bad.urdf:{entry['line']}: error {entry['code']}: {entry['message']}" in printed
    sheet = (folder / "4dof.errors.yaml").read_text("utf-8")
    (folder / "good.yaml").write_text(re.sub(r"accept:.*\n.*\n", "", sheet), "utf-8")
    good = run("check", "--json", "good.yaml")
    assert (good.code, good.json, good.err) == (0, {"errors": [], "warnings": []}, "")
    assert [entry["code"] for entry in run("check", "--json", "forked.urdf").json["warnings"]] == ["W_BRANCHED"]
    assert len(run("check", "--json", "nosuch.urdf").json["errors"]) == 1


@pytest.mark.slow
def test_a_broken_mesh_is_one_warning_of_check_and_no_hindrance_of_view(run, folder):
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    (folder / "far.obj").write_text(f"{corners}f 1 2 99999999999\n")
    for name, words in (("missing.stl", "does not exist"), ("far.obj", "face indices outside its 3 vertices")):
        mesh = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        robot = GANTRY.replace('<link name="tool"/>', f'<link name="tool">\n    {mesh}\n  </link>')
        (folder / "gantry.urdf").write_text(robot, encoding="utf-8")
        line = robot[: robot.index("<mesh")].count("\n") + 1
        outcome = run("check", "gantry.urdf")
        assert (outcome.code, outcome.err) == (0, "no errors, 1 warning\n"), name
        assert re.fullmatch(rf"gantry\.urdf:{line}: warning W_MESH_[A-Z]+: .*{re.escape(words)}.*\n", outcome.out), name
    drawn = run("view", "gantry.errors.yaml", "--samples", "100", "--out", "page.html")
    assert (drawn.code, "Traceback" in drawn.err, (folder / "page.html").exists()) == (0, False, True)


def test_mcpc_prints_the_papers_table_1(run):
    outcome = run("mcpc")
    assert (outcome.code, outcome.err) == (0, "")
    header, *rows = (line.split() for line in outcome.out.splitlines())
    assert header == ["i", "joint", "offset", "°", "α", "°", "β", "°", "γ", "°", "x", "mm", "y", "mm", "z", "mm"]
    # Table 1 with a_1 = 85, a_2 = 1970, a_3 = 96, a_4 = 1770, a_5 = 93 mm
    assert rows == [
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
    assert data["links"][1]["alpha"] == pytest.approx(-math.pi / 2, abs=1e-15)
    assert (data["links"][1]["y"], data["links"][4]["z"]) == (pytest.approx(-0.085), pytest.approx(-0.274))
    assert [row["gamma"] is None for row in data["links"]] == [True, True, True, True, False]
    outcome = run("mcpc", "forked.urdf", "--tip", "right", "--json")
    # which of its tips is meant is settled
    assert (outcome.code, outcome.json["tip"], outcome.err) == (0, "right", "")


def test_init_to_stdout_or_beside_the_user_and_over_a_sheet_only_when_told(run, folder):
    printed = run("init", "forked.urdf", "--tip", "left", "--out", "-")
    outcome = run("init", "forked.urdf", "--tip", "left")
    assert (printed.code, outcome.code, outcome.out) == (0, 0, "")
    assert outcome.err.endswith("now: precision-pin analyze forked.errors.yaml\n")
    before = (folder / "forked.errors.yaml").read_text("utf-8")
    assert before == printed.out
    refused = run("init", "forked.urdf", "--tip", "right")
    assert (refused.code, refused.out, len(refused.err_lines)) == (2, "", 1)
    assert "forked.errors.yaml exists; --force overwrites it" in refused.err
    assert (folder / "forked.errors.yaml").read_text("utf-8") == before
    assert run("init", "forked.urdf", "--tip", "right", "--force").code == 0
    assert (folder / "forked.errors.yaml").read_text("utf-8") != before


def test_schema_and_doctor(run, monkeypatch):
    outcome = run("schema")
    assert (outcome.code, outcome.err, outcome.json) == (0, "", json_schema())
    outcome = run("doctor")
    assert (outcome.code, outcome.err) == (0, "")
    for name in ("precision-pin", "pin", "numpy", "numba"):
        assert re.search(rf"^{name} +{re.escape(importlib.metadata.version(name))}$", outcome.out, re.MULTILINE), name
    assert str(PAPER_SHEET) in outcome.out
    assert "MISSING" not in outcome.out
    real = importlib.metadata.version

    def version(name: str) -> str:
        if name == "pin":  # as conda's pinocchio, which has no such distribution
            raise importlib.metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(importlib.metadata, "version", version)
    _version.cache_clear()
    outcome = run("doctor")
    _version.cache_clear()
    assert outcome.code == 0
    assert re.search(r"^pin +unknown$", outcome.out, re.MULTILINE)


# help and version ----------------------------------------------------------------------------------------------------


def test_help_of_analyze_names_every_option_of_the_contract_and_version(run):
    out = run("analyze", "--help").out
    for option in (
        "--pose", "--q", "--tip", "--base", "--package-dir", "--samples", "--seed", "--model", "--spec", "--json", "--out",
    ):  # fmt: skip
        assert re.search(rf"^  {option} ", out, re.MULTILINE), option
    assert "100,000" in out
    outcome = run("--version")
    assert (outcome.code, outcome.out.split()[-1]) == (0, importlib.metadata.version("precision-pin"))
    # no command shows the help
    outcome = run()
    assert outcome.code == 2
    assert "\nDecide what to change:\n" in outcome.out + outcome.err


@pytest.mark.parametrize("name", list_commands())
def test_help_has_every_option_once_under_a_heading(run, name):
    outcome = run(name, "-h")
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.startswith(f"Usage: precision-pin {name} ")
    assert max(map(len, outcome.out.splitlines())) <= 110
    sections = re.split(r"(?m)^(?=\S.*:$)", outcome.out)
    listed = {one.partition(":")[0]: re.findall(r"(?m)^  (--?[\w-]+)", one) for one in sections[1:]}
    options = [option for option in load_command(name).params if isinstance(option, click.Option)]
    assert sorted(itertools.chain.from_iterable(listed.values())) == sorted(
        ["-h", *(option.opts[0] for option in options)]
    )
    homes = {"--pose": "Poses", "--grid": "Poses", "--tip": "Robot and sheet", "--seed": "Sampling"}
    homes |= {"--threads": "Sampling", "--json": "Output and messages", "--quiet": "Output and messages"}
    every = set(itertools.chain.from_iterable(listed.values()))
    for option in every & set(homes):
        assert [at for at, found in listed.items() if option in found] == [homes[option]]
    if name == "calibrate":
        ways = {
            "Before anything is measured": "--forecast",
            "Fit to readings": "--urdf",
            "Several robots": "--population",
        }
        assert all(option in listed[heading] for heading, option in ways.items())
        assert "Fit:     calibrate SHEET DATA.csv " in sections[0]


def test_completion_is_made_for_each_shell(run, monkeypatch):
    for shell in ("bash", "zsh", "fish"):
        monkeypatch.setenv("_PRECISION_PIN_COMPLETE", f"{shell}_source")
        made = run()
        assert (made.code, made.err) == (0, "")
        assert f"_PRECISION_PIN_COMPLETE={shell}_complete" in made.out
    monkeypatch.setenv("_PRECISION_PIN_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", "precision-pin analyze --spec")
    monkeypatch.setenv("COMP_CWORD", "2")
    assert "plain,--spec-everywhere" in run().out.split()


def test_codes_are_explained(run):
    one = run("explain", "w_superposition")
    assert one.code == 0
    assert one.out.startswith("W_SUPERPOSITION (warnings about a result)\n  means  ")
    assert "the three models (page model of the documentation)" in " ".join(one.out.split())
    assert max(map(len, run("explain").out.splitlines())) <= 100
    wrong = run("explain", "W_STATIC")
    assert (wrong.code, wrong.out) == (2, "")
    assert "no code named 'W_STATIC'; did you mean 'W_STATICS'" in wrong.err


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
    outputs.check()
    outputs.refuse_inputs([sheet])
    space = ErrorModel.load(sheet).space
    rows = zip(space.components, space.covariance.diagonal().tolist())
    write_text(out, "component,variance\\n" + "".join(f"{name},{variance!r}\\n" for name, variance in rows))
    return 0
'''


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the output ``variances``: its file, and one line."""
    (tmp_path / "variances_output.py").write_text(OUTPUT)
    monkeypatch.syspath_prepend(tmp_path)
    line = ("variances_output", program.SHOW, "Write the variance of every random number.")
    monkeypatch.setattr(program, "COMMANDS", {**program.COMMANDS, "variances": line})


@pytest.mark.slow
@pytest.mark.usefixtures("added")
def test_an_added_output_is_a_command_as_any_other(run: Run, tmp_path: Path) -> None:
    assert "Write the variance of every random number." in run("--help").out
    assert "as CSV" in run("variances", "--help").out
    out = tmp_path / "variances.csv"
    done = run("variances", str(PAPER_SHEET), "--out", str(out))
    assert (done.code, done.out, done.err) == (0, "", "")
    with open(out, newline="") as file:
        rows = list(csv.DictReader(file))
    space = pp.ErrorModel.load(PAPER_SHEET).space
    assert [row["component"] for row in rows] == list(space.components)
    assert [float(row["variance"]) for row in rows] == space.covariance.diagonal().tolist()
    # a mistake ends as everywhere: a line, exit code 2, nothing written
    failed = run("variances", "missing.errors.yaml", "--out", str(tmp_path / "none.csv"))
    assert (failed.code, len(failed.err_lines)) == (2, 1)
    assert not (tmp_path / "none.csv").exists()
    assert "variances" in run("variance").err
