"""Wrong command lines: each ends with code 2, lines that name the problem, no traceback, and nothing written."""

from __future__ import annotations

import os
import re

import pytest

LINE = re.compile(r"[^\n]+: (error|warning) [EW]_[A-Z_]+: [^\n]+")
A = ("analyze", "--samples", "10")
PAPER = "4dof.errors.yaml"

WRONG = {
    # commands and options
    "unknown command": (("analyse",), "no command named 'analyse'; did you mean 'analyze'?"),
    "unknown command far from any": (("qqq",), "valid: allocate, analyze, .*check, "),
    "option before the command": (("--samples", "10", "analyze"), "--samples"),
    "unknown option": (("analyze", "--sampels", "10"), "No such option:? '?--sampels'?.*--samples"),
    "option without its value": (("analyze", "--seed"), "'--seed' requires an argument"),
    "unknown model": (("analyze", "--model", "quadratic"), "'quadratic' is not one of 'exact', 'linear'"),
    "flag with a value": (("check", "--json=yes"), "--json"),
    "argument too many": (("schema", "extra"), "unexpected extra argument"),
    "doctor with a robot": (("doctor", "4dof.urdf"), "unexpected extra argument"),
    "init without a robot": (("init",), "Missing argument 'ROBOT.urdf'"),
    # samples and seed
    "no samples": (("analyze", "--samples", "0"), "samples must be a whole number from 1 to .*got 0"),
    "negative samples": (("analyze", "--samples", "-5"), "samples must be a whole number from 1 .*got -5"),
    "absurd samples": (("analyze", "--samples", "1000000000001"), "samples must be a whole number from 1 to 1e\\+12"),
    "samples beyond any integer type": (("analyze", "--samples", "9" * 30), "samples must be a whole number"),
    "samples with an exponent": (("analyze", "--samples", "1e5"), "'--samples': '1e5' is not a valid integer"),
    "half a sample": (("analyze", "--samples", "10.5"), "'10.5' is not a valid integer"),
    "negative seed": ((*A, "--seed", "-1"), "seed must be a whole number from 0 to 2\\^64 - 1, got -1"),
    "seed of 65 bits": ((*A, "--seed", str(2**64)), "seed must be a whole number from 0 to 2\\^64 - 1"),
    "seed in words": ((*A, "--seed", "random"), "'random' is not a valid integer"),
    # places
    "empty tip of a sheet": ((*A, "--tip", ""), "no link named ''; valid: base, "),
    "empty base of a sheet": ((*A, "--base", ""), "no link named ''; valid: base, "),
    # specifications
    "spec without a unit": (
        (*A, "--spec", "0.5"),
        "'0.5' has no unit: '0.5 mm' limits the position, '0.5 mrad' the attitude",
    ),
    "spec with a wrong unit": ((*A, "--spec", "0.5 kg"), "'kg' in '0.5 kg' is not a unit of length or angle"),
    "spec of an unknown quantity": ((*A, "--spec", "w 0.5 mm"), "quantity of a specification named 'w'"),
    "position limited by an angle": ((*A, "--spec", "x 1 mrad"), "x is limited by a length"),
    "attitude limited by a length": ((*A, "--spec", "attitude 1 mm"), "attitude is limited by an angle"),
    "spec of zero": ((*A, "--spec", "0 mm"), "the limit must be positive"),
    "negative spec": ((*A, "--spec", "-1 mm"), "the limit must be positive"),
    "spec not a number": ((*A, "--spec", "nan mm"), "nan mm"),
    "spec of infinity": ((*A, "--spec", "1e999 mm"), "not finite"),
    "spec of certainty": ((*A, "--spec", "1 mm @ 100 %"), "the probability must lie above 0 and below 1"),
    "percent without its sign": ((*A, "--spec", "1 mm @ 95"), "the probability must lie above 0 and below 1"),
    "spec of no probability": ((*A, "--spec", "1 mm @"), "1 mm @"),
    "probability with a unit": ((*A, "--spec", "1 mm @ 95 mm"), "is not a unit of ratio"),
    "empty spec": ((*A, "--spec", ""), "specification ''"),
    "second spec wrong": ((*A, "--spec", "1 mm", "--spec", "1"), "'1' has no unit"),
    # poses and joint values
    "unknown pose": ((*A, "--pose", "papper"), "no pose named 'papper'; did you mean 'paper'?"),
    "empty pose": ((*A, "--pose", ""), "no pose named ''"),
    "pose and joint values": ((*A, "--pose", "paper", "--q", "0 0 0 0 deg"), "--pose and --q exclude each other"),
    "too few joint values": ((*A, "--q", "1 2 3 deg"), "--q: 3 joint values for 4 joints.*joint1, joint2"),
    "too many joint values": ((*A, "--q", "1 2 3 4 5 deg"), "--q: 5 joint values for 4 joints"),
    "too few in a list": ((*A, "--q", "1 deg, 2 deg"), "--q: 2 joint values for 4 joints"),
    "joint values without a unit": ((*A, "--q", "1 2 3 4"), "--q: '1 2 3 4' has no unit; an? angle needs one of: rad"),
    "joint values in a wrong unit": ((*A, "--q", "1 2 3 4 mm"), "--q: 'mm' in '1 2 3 4 mm' is not a unit of angle"),
    "joint values in words": ((*A, "--q", "up"), "--q: expected a number with a unit.*'up'"),
    "empty joint values": ((*A, "--q", ""), "--q: expected a number"),
    "a joint missing": ((*A, "--q", "joint1: 0 deg, joint2: 0 deg"), "--q: no value for the joints joint3, joint4"),
    "an unknown joint": ((*A, "--q", "joint7: 0 deg"), "--q: no joint on the chain named 'joint7'; did you mean"),
    "a joint twice": ((*A, "--q", "joint1: 0 deg, joint1: 1 deg"), "--q: the joint 'joint1' is given twice"),
    "names and none mixed": ((*A, "--q", "joint1: 0 deg, 1 deg"), "--q: '1 deg' names no joint"),
    "infinite joint value": ((*A, "--q", "1e999 0 0 0 deg"), "--q: .*not finite"),
    "one unit for joints that turn and slide": (
        (*A, "gantry.urdf", "--q", "1 2 m"),
        "--q: .*revolute and prismatic joints",
    ),
    "angle for a sliding joint": (
        (*A, "gantry.urdf", "--q", "1 deg, 2 deg"),
        "--q: 'deg' in '1 deg' is not a unit of length",
    ),
    "no pose anywhere": ((*A, "poseless.yaml"), "poseless.yaml: error E_POSE: the sheet has no poses; .*--q"),
    # tip, base, package folder
    "unknown tip": ((*A, "--tip", "tol"), "no link named 'tol'; did you mean 'tool'?"),
    "unknown base": ((*A, "--base", "bass"), "no link named 'bass'; did you mean 'base'?"),
    "tip is the base": ((*A, "--tip", "base"), "no joint moves between 'base' and 'base'"),
    "no tip where there are several": (("mcpc", "forked.urdf"), "2 leaves; name one as the tip: left, right"),
    "init without the tip it needs": (("init", "forked.urdf"), "2 leaves; name one as the tip: left, right"),
    # files
    "missing robot": ((*A, "nosuch.urdf"), "nosuch.urdf: error E_FILE_MISSING: there is no file"),
    "missing robot with a sheet": ((*A, "nosuch.urdf", PAPER), "nosuch.urdf: error E_"),
    "missing sheet": ((*A, "nosuch.yaml"), "nosuch.yaml: error E_FILE: the sheet does not exist"),
    "missing robot for mcpc": (("mcpc", "nosuch.urdf"), "nosuch.urdf: error E_"),
    "missing robot for init": (("init", "nosuch.urdf"), "nosuch.urdf: error E_"),
    "two robots": ((*A, "4dof.urdf", "gantry.urdf", PAPER), "one robot and one sheet are expected"),
    "two sheets": ((*A, PAPER, "gantry.errors.yaml"), "one robot and one sheet are expected"),
    "robot without a sheet": ((*A, "forked.urdf"), "precision-pin init forked.urdf"),
    "a folder as robot": ((*A, "."), "error E_FILE"),
    "a folder as sheet": (
        (*A, "4dof.urdf", "folder.yaml"),
        "folder.yaml: error E_FILE: the sheet is not a regular file",
    ),
    "a robot in place of a sheet": ((*A, "4dof.urdf", "gantry.urdf"), "one robot and one sheet are expected"),
    "text that is no XML": ((*A, "notes.txt", PAPER), "notes.txt:1: error E_"),
    "a sheet that is no YAML": ((*A, "broken.yaml"), "broken.yaml:[23]: error E_YAML"),
    "an empty sheet": ((*A, "empty.yaml"), "empty.yaml:1: error E_SHEET: a sheet must begin with"),
    "a sheet that is not text": ((*A, "binary.yaml"), "binary.yaml: error E_FILE: the sheet is not UTF-8"),
    "a name far too long": ((*A, "x" * 300 + ".urdf"), "error E_FILE"),
    "a sheet's name far too long": ((*A, "x" * 300 + ".yaml"), "error E_FILE"),
    "unknown example": ((*A, "example:ur55", PAPER), "no example robot named 'ur55'; did you mean 'ur5'"),
    "example without a name": (("mcpc", "example:"), "no example robot named ''"),
    "an empty argument": ((*A, ""), "error E_FILE"),
    "the sheet's robot is missing": ((*A, "orphan.yaml"), "gone.urdf: error E_"),
    # places to write to
    "json into nowhere": ((*A, "--json", "no/where.json"), "no does not exist"),
    "json onto a folder": ((*A, "--json", "folder.yaml"), "it is a folder"),
    "out onto a file": ((*A, "--out", "notes.txt"), "it is a file"),
    "init onto a folder": (("init", "gantry.urdf", "--out", "folder.yaml"), "it is a folder"),
    "init over a sheet": (("init", "gantry.urdf"), "gantry.errors.yaml exists; --force overwrites it"),
    "page into nowhere": (("view", "--samples", "10", "--out", "no/page.html"), "no does not exist"),
    "page of too many samples": (("view", "--samples", "1000000", "--out", "page.html"), "more than a page can show"),
    "page exaggerated by nothing": (("view", "--samples", "10", "--factor", "0", "--out", "page.html"), "factor"),
    "page exaggerated below nothing": (("view", "--samples", "10", "--factor", "-3", "--out", "page.html"), "factor"),
    "page exaggerated by no number": (("view", "--samples", "10", "--factor", "nan", "--out", "page.html"), "factor"),
    "page with wrong joint values": (
        ("view", "--q", "1 deg", "--out", "page.html"),
        "--q: 1 joint values for 4 joints",
    ),
}


@pytest.fixture
def odd_files(folder):
    (folder / "folder.yaml").mkdir()
    (folder / "notes.txt").write_text("remember the milk\n")
    (folder / "broken.yaml").write_text("precision-pin: 1\nrobot: [4dof.urdf\n")
    (folder / "empty.yaml").write_text("")
    (folder / "binary.yaml").write_bytes(b"precision-pin: 1\n\xff\xfe\n")
    (folder / "orphan.yaml").write_text("precision-pin: 1\nrobot: gone.urdf\n")
    (folder / "poseless.yaml").write_text("precision-pin: 1\nrobot: 4dof.urdf\n")
    return folder


@pytest.mark.fast(32)
@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_command_line(run, odd_files, contents, case):
    arguments, message = WRONG[case]
    before = contents()
    outcome = run(*arguments)
    assert outcome.code == 2, outcome
    assert outcome.out == ""
    assert "Traceback" not in outcome.err
    lines = outcome.err_lines
    assert 1 <= len(lines) <= 10
    assert all(LINE.fullmatch(line) for line in lines), outcome.err
    assert any(" error " in line and re.search(message, line) for line in lines), outcome.err
    assert contents() == before


@pytest.mark.parametrize("command", ["analyze", "check", "mcpc"])
def test_a_sheet_with_many_mistakes_names_each(run, folder, contents, command):
    text = (folder / PAPER).read_text()
    mistakes = {
        "{uniform: 0.25 mm}\n  a3": "{uniform: -0.25 mm}\n  a3",  # a negative tolerance
        "a1: {uniform: 0.05 mm}": "a1: {uniform: 0.05}",  # no unit
        "length: {joint: joint4": "length: {joint: joint5",  # no such joint
        "beam: {link: link2,": "beam: {lnik: link2,",  # an unknown key
        "mass: 1 kg": "mass: 1 kg, mass: 2 kg",  # a key twice
        "radius: 0.1 mm, span: 100 mm}\n  - axis_install: {joint: joint3": "span: 100 mm}\n  - axis_install: {joint: joint3",
    }
    for old, new in mistakes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    (folder / "bad.yaml").write_text(text)
    before = contents()
    outcome = run(command, "bad.yaml")
    assert outcome.code == 2
    printed = (outcome.out if command == "check" else outcome.err).splitlines()
    assert all(LINE.fullmatch(line) and line.startswith("bad.yaml:") for line in printed)
    for mark in ("-0.25", "0.05}", "joint5", "lnik", "mass: 2 kg"):
        number = next(k for k, line in enumerate(text.splitlines(), start=1) if mark in line)
        assert any(line.startswith(f"bad.yaml:{number}: error ") for line in printed), (mark, printed)
    assert contents() == before


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names")
@pytest.mark.parametrize("name", ["pipe.urdf", "pipe.yaml"])
def test_a_pipe_is_refused_and_not_waited_for(run, folder, name):
    os.mkfifo(folder / name)
    outcome = run("check", name)
    assert outcome.code == 2
    assert "error E_FILE" in outcome.out


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("a1: {uniform: 0.05 mm}", "a1: {uniform: 1e300 m}"),
        ("a1: {uniform: 0.05 mm}", "a1: {uniform: 1e45 m}"),
        ("a1: {uniform: 0.05 mm}", "a1: {normal: 1 m, k: 1e-300}"),
        ("a1: {uniform: 0.05 mm}", "a1: {normal: 1 m, k: 1e-100}"),
        ("mass: 1 kg", "mass: 1e300 kg"),
        ("-9.81 m/s^2", "-1e305 m/s^2"),
        ("link2, EI: 8000", "link2, EI: 1e-300"),
        ("{joint: joint1, radius: 0.1 mm", "{joint: joint1, radius: 1e300 mm"),
        ("{joint: joint1, radius: 0.1 mm, span: 100", "{joint: joint1, radius: 0.1 mm, span: 1e-300"),
        ("{joint: joint1, radius: 0.1 mm", "{joint: joint1, radius: 20 m"),
    ],
)
def test_numbers_beyond_all_reason(run, folder, contents, old, new):
    text = (folder / PAPER).read_text()
    assert text.count(old) == 1
    (folder / "absurd.yaml").write_text(text.replace(old, new))
    before = contents()
    outcome = run("analyze", "absurd.yaml", "--samples", "500", "--out", "plots")
    assert (outcome.code, outcome.out) == (2, "")
    assert re.search("too large|too small|must lie|positive|beyond", outcome.err)
    assert all(LINE.fullmatch(line) for line in outcome.err_lines)
    assert contents() == before
