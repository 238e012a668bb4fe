"""``check``, ``init``, ``mcpc``, ``schema``, ``doctor``, help and version."""

from __future__ import annotations

import importlib.metadata
import itertools
import json
import math
import re

import click
import jsonschema
import pytest
from ruamel.yaml import YAML

from cli.conftest import GANTRY
from precision_pin.base.versions import _version
from precision_pin.cli.commands import list_commands, load_command
from precision_pin.robot.examples import PAPER_SHEET

FINDING = re.compile(r"[^:\n]+(:\d+)?: (error|warning) [EW]_[A-Z_]+: .+")

# check ---------------------------------------------------------------------------------------------------------------


def test_check_of_a_good_sheet_and_of_a_good_urdf(run):
    for arguments in ((), ("4dof.urdf",), ("4dof.errors.yaml",), ("gantry.urdf", "gantry.errors.yaml")):
        outcome = run("check", *arguments)
        assert (outcome.code, outcome.out, outcome.err_lines[-1]) == (0, "", "no errors, 0 warnings"), arguments
        assert all(": note " in line for line in outcome.err_lines[:-1]), arguments


def test_check_of_a_urdf_needs_no_sheet_and_no_tip(run):
    outcome = run("check", "forked.urdf")
    assert outcome.code == 0
    assert outcome.err == "no errors, 1 warning\n"
    assert re.match(r"forked\.urdf:\d+: warning W_BRANCHED: .*'left', 'right'", outcome.out)


def test_check_with_a_tip_looks_at_the_chain_too(run):
    assert run("check", "forked.urdf", "--tip", "left").code == 0
    outcome = run("check", "forked.urdf", "--tip", "lfet")
    assert outcome.code == 2
    assert "no link named 'lfet'; did you mean 'left'?" in outcome.out


def test_check_lists_every_finding_of_a_urdf_with_its_line(run, folder):
    text = (folder / "4dof.urdf").read_text()
    lines = text.replace('<mass value="1.4"/>', '<mass value="-1"/>', 1).replace(
        '<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', 1
    )
    (folder / "bad.urdf").write_text(lines)
    mass = 1 + lines[: lines.index('"-1"')].count("\n")
    axis = 1 + lines[: lines.index('<axis xyz="0 0 0"/>')].count("\n")
    outcome = run("check", "bad.urdf")
    assert outcome.code == 2
    printed = outcome.out.splitlines()
    assert all(FINDING.fullmatch(line) for line in printed)
    assert any(line.startswith(f"bad.urdf:{mass}: error ") for line in printed)
    assert any(line.startswith(f"bad.urdf:{axis}: error ") for line in printed)
    # analyze refuses with the same errors, on stderr
    (folder / "bad.yaml").write_text((folder / "4dof.errors.yaml").read_text())
    refused = run("analyze", "bad.urdf", "bad.yaml")
    assert (refused.code, refused.out) == (2, "")
    assert {line for line in printed if " error " in line} <= set(refused.err_lines)


def test_check_lists_every_finding_of_a_sheet_with_its_line(run, folder):
    sheet = (folder / "gantry.errors.yaml").read_text("utf-8").splitlines()
    sheet[2] = "posse:"
    sheet[-2] = "  - joint_ofset: {joint: y_axis, offset: {uniform: 0.1 mm}}"
    sheet[-1] = "  - joint_offset: {joint: y_axis, offset: {uniform: 0.1}}"
    (folder / "bad.yaml").write_text("\n".join(sheet), "utf-8")
    outcome = run("check", "bad.yaml")
    assert outcome.code == 2
    printed = outcome.out.splitlines()
    assert all(FINDING.fullmatch(line) for line in printed)
    # shape first: while the top level is not understood, nothing below it is
    assert any(line.startswith("bad.yaml:3: error E_UNKNOWN_KEY: ") and "'poses'" in line for line in printed)
    sheet[2] = "poses:"
    (folder / "bad.yaml").write_text("\n".join(sheet), "utf-8")
    printed = run("check", "bad.yaml").out.splitlines()
    assert any(line.startswith("bad.yaml:7: error ") and "'joint_offset'" in line for line in printed)
    assert any(line.startswith("bad.yaml:8: error ") and "0.1" in line and "mm" in line for line in printed)


@pytest.mark.slow
def test_a_broken_mesh_is_one_warning_of_check_and_no_hindrance_of_view(run, folder):
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    cases = {
        "far.obj": (f"{corners}f 1 2 99999999999\n", "face indices outside its 3 vertices"),
        "zero.obj": (f"{corners}f 0 1 2\n", "face indices outside its 3 vertices"),
        "huge.obj": ("v 1e308 0 0\nv -1e308 0 0\nv 0 1e308 0\nf 1 2 3\n", "vertices farther than 1e+30"),
        "cut.stl": ("\0" * 83 + "\1" + "\0" * 50, "claims 16777216 triangles"),
        "text.dae": ("no XML", "not well-formed XML"),
        "empty.stl": ("", "is empty"),
        "missing.stl": (None, "does not exist"),
    }
    for name, (content, words) in cases.items():
        if content is not None:
            (folder / name).write_text(content)
        mesh = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        robot = GANTRY.replace('<link name="tool"/>', f'<link name="tool">\n    {mesh}\n  </link>')
        (folder / "gantry.urdf").write_text(robot, encoding="utf-8")
        line = robot[: robot.index("<mesh")].count("\n") + 1
        outcome = run("check", "gantry.urdf")
        assert (outcome.code, outcome.err) == (0, "no errors, 1 warning\n"), name
        assert re.fullmatch(rf"gantry\.urdf:{line}: warning W_MESH_[A-Z]+: .*{re.escape(words)}.*\n", outcome.out), name
        if name in ("far.obj", "huge.obj"):
            drawn = run("view", "gantry.errors.yaml", "--samples", "100", "--out", "page.html")
            assert (drawn.code, "Traceback" in drawn.err, (folder / "page.html").exists()) == (0, False, True), name


def test_check_as_json(run, folder):
    text = (folder / "4dof.urdf").read_text().replace('<mass value="1.4"/>', '<mass value="-1"/>', 1)
    (folder / "bad.urdf").write_text(text)
    outcome = run("check", "--json", "bad.urdf")
    assert outcome.code == 2
    assert outcome.err == ""
    found = outcome.json
    assert sorted(found) == ["errors", "warnings"]
    assert found["errors"]
    for entry in (*found["errors"], *found["warnings"]):
        assert sorted(entry) == ["code", "file", "line", "message"]
        assert re.fullmatch(r"[EW]_[A-Z_]+", entry["code"])
        assert entry["file"] == "bad.urdf"
        assert entry["line"] is None or entry["line"] >= 1
    (folder / "good.yaml").write_text(
        re.sub(r"accept:.*\n.*\n", "", (folder / "4dof.errors.yaml").read_text("utf-8")), "utf-8"
    )
    good = run("check", "--json", "good.yaml")
    assert (good.code, good.json, good.err) == (0, {"errors": [], "warnings": []}, "")
    warned = run("check", "--json", "forked.urdf")
    assert warned.code == 0
    assert [entry["code"] for entry in warned.json["warnings"]] == ["W_BRANCHED"]
    missing = run("check", "--json", "nosuch.urdf")
    assert missing.code == 2
    assert len(missing.json["errors"]) == 1


# mcpc ----------------------------------------------------------------------------------------------------------------


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


def test_mcpc_as_json(run):
    data = run("mcpc", "--json").json
    assert sorted(data) == ["base", "links", "tip"]
    assert (data["base"], data["tip"]) == ("base", "tool")
    keys = ["alpha", "beta", "gamma", "joint", "link", "prismatic", "shift", "turn", "x", "y", "z"]
    assert all(sorted(row) == keys for row in data["links"])
    assert data["links"][1]["alpha"] == pytest.approx(-math.pi / 2, abs=1e-15)
    assert data["links"][1]["y"] == pytest.approx(-0.085, abs=1e-15)
    assert data["links"][4]["z"] == pytest.approx(-0.274, abs=1e-15)
    assert [row["gamma"] is None for row in data["links"]] == [True, True, True, True, False]


def test_mcpc_of_a_urdf_alone(run):
    assert run("mcpc", "4dof.urdf").out == run("mcpc").out
    outcome = run("mcpc", "forked.urdf", "--tip", "right", "--json")
    assert outcome.code == 0
    assert outcome.json["tip"] == "right"
    # which of its tips is meant is settled
    assert outcome.err == ""


# init ----------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_init_then_analyze_unedited(run, folder):
    outcome = run("init", "gantry.urdf", "--out", "fresh.yaml")
    assert outcome.code == 0
    assert outcome.out == ""
    assert outcome.err.endswith("now: precision-pin analyze fresh.yaml\n")
    assert run("check", "fresh.yaml").code == 0
    assert run("analyze", "fresh.yaml", "--samples", "100").code == 0


def test_init_to_stdout_and_by_default_beside_the_user(run, folder):
    printed = run("init", "forked.urdf", "--tip", "left", "--out", "-")
    assert printed.code == 0
    assert run("init", "forked.urdf", "--tip", "left").code == 0
    assert (folder / "forked.errors.yaml").read_text("utf-8") == printed.out


def test_init_overwrites_only_when_told(run, folder):
    before = (folder / "gantry.errors.yaml").read_bytes()
    refused = run("init", "gantry.urdf")
    assert (refused.code, refused.out) == (2, "")
    assert len(refused.err_lines) == 1
    assert "--force" in refused.err
    assert (folder / "gantry.errors.yaml").read_bytes() == before
    assert run("init", "gantry.urdf", "--force").code == 0
    assert (folder / "gantry.errors.yaml").read_bytes() != before


# schema and doctor ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_schema_is_valid_and_the_papers_sheet_keeps_it(run):
    outcome = run("schema")
    assert (outcome.code, outcome.err) == (0, "")
    schema = outcome.json
    validator = jsonschema.Draft202012Validator
    validator.check_schema(schema)
    sheet = json.loads(json.dumps(YAML(typ="safe").load(PAPER_SHEET.read_text(encoding="utf-8"))))
    validator(schema).validate(sheet)
    for wrong in ({"precision-pin": 1}, sheet | {"sauces": []}, sheet | {"sources": [{"lenght": {}}]}):
        with pytest.raises(jsonschema.ValidationError):
            validator(schema).validate(wrong)


def test_doctor_names_versions_and_paths(run):
    outcome = run("doctor")
    assert (outcome.code, outcome.err) == (0, "")
    for name in ("precision-pin", "pin", "numpy", "numba"):
        assert re.search(rf"^{name} +{re.escape(importlib.metadata.version(name))}$", outcome.out, re.MULTILINE), name
    assert str(PAPER_SHEET) in outcome.out
    assert "MISSING" not in outcome.out


def test_doctor_without_metadata_of_a_library(run, monkeypatch):
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


def test_help_lists_every_command(run):
    outcome = run("--help")
    assert outcome.code == 0
    for name in ("analyze", "check", "init", "mcpc", "schema", "doctor"):
        assert re.search(rf"^  {name} +\S", outcome.out, re.MULTILINE), name


def test_help_of_analyze_names_every_option_of_the_contract(run):
    out = run("analyze", "--help").out
    for option in (
        "--pose", "--q", "--tip", "--base", "--package-dir", "--samples", "--seed", "--model", "--spec", "--json", "--out",
    ):  # fmt: skip
        assert re.search(rf"^  {option} ", out, re.MULTILINE), option
    assert "100,000" in out


def test_version(run):
    outcome = run("--version")
    assert outcome.code == 0
    assert outcome.out.split()[-1] == importlib.metadata.version("precision-pin")


def test_no_command_shows_the_help(run):
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


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_made_for_each_shell(run, monkeypatch, shell):
    monkeypatch.setenv("_PRECISION_PIN_COMPLETE", f"{shell}_source")
    made = run()
    assert (made.code, made.err) == (0, "")
    assert f"_PRECISION_PIN_COMPLETE={shell}_complete" in made.out
    monkeypatch.setenv("_PRECISION_PIN_COMPLETE", f"{shell}_complete")
    monkeypatch.setenv("COMP_WORDS", "precision-pin analyze --spec")
    monkeypatch.setenv("COMP_CWORD", "--spec" if shell == "fish" else "2")
    offered = run().out.split()
    assert [word for word in offered if word.rpartition(",")[2].startswith("--spec")] or "--spec-everywhere" in offered


def test_codes_are_explained(run):
    one = run("explain", "w_superposition")
    assert one.code == 0
    assert one.out.startswith("W_SUPERPOSITION (warnings about a result)\n  means  ")
    assert "the three models (page model of the documentation)" in " ".join(one.out.split())
    assert max(map(len, run("explain").out.splitlines())) <= 100
    wrong = run("explain", "W_STATIC")
    assert (wrong.code, wrong.out) == (2, "")
    assert "no code named 'W_STATIC'; did you mean 'W_STATICS'" in wrong.err
