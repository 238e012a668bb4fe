"""A command line in a folder of its own, run in this process by the function that the installed command calls."""

import json
import os
import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from precision_pin.analyses.declaration import Declaration
from precision_pin.cli import main
from precision_pin.robot.examples import PAPER_SHEET
from support.plain_robot import joint, limits, link, robot

LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"
GANTRY = robot(
    *map(link, ("frame", "Schlitten_ü", "腕", "tool")),
    joint("y_axis", "prismatic", "frame", "Schlitten_ü", (0, 0, 1), axis=(0, 1, 0), extra=limits(-1, 1)),
    joint(LONG, "revolute", "Schlitten_ü", "腕", (0.1, 0, 0), axis=(1, 0, 0), extra=limits(-2, 2)),
    joint("flange", "fixed", "腕", "tool", (0, 0, -0.5)),
)
FORKED = robot(
    *map(link, ("body", "left", "right")),
    joint("to_left", "revolute", "body", "left", (0, 0.2, 0)),
    joint("to_right", "revolute", "body", "right", (0, -0.2, 0)),
)
GANTRY_SHEET = f"""precision-pin: 1
robot: gantry.urdf
poses:
  out: {{y_axis: 250 mm, {LONG}: 30 deg}}
  home: [0 mm, 0 deg]
sources:
  - joint_offset: {{joint: y_axis, offset: {{uniform: 0.1 mm}}}}
  - joint_offset: {{joint: {LONG}, offset: {{normal: 0.3 mrad}}}}
"""


ASSUMPTION = re.compile(r": warning W_(STATICS|SUPERPOSITION): ")
LINE = re.compile(r"[^\n]+: (error|warning|note) [EWN]_[A-Z_]+: [^\n]+")


@dataclass(frozen=True)
class Outcome:
    """What a command did."""

    code: int
    out: str
    err: str

    @property
    def json(self):
        return json.loads(self.out)

    @property
    def lines(self):
        return (self.out + self.err).splitlines()

    @property
    def err_lines(self):
        return self.err.splitlines()

    @property
    def said(self):
        """What stands on stderr besides warnings about assumptions of the case."""
        return [line for line in self.err_lines if not ASSUMPTION.search(line)]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Make the working folder: the paper's files, a gantry with a sheet, an arm with two leaves."""
    for file in PAPER_SHEET.parent.glob("4dof.*"):
        shutil.copy(file, tmp_path)
    for name, text in (("gantry.urdf", GANTRY), ("gantry.errors.yaml", GANTRY_SHEET), ("forked.urdf", FORKED)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(folder, monkeypatch, capsys):
    """Run ``precision-pin`` in the working folder; it must end with the code, but for None."""

    def command(*arguments, code=0):
        monkeypatch.setattr(sys, "argv", ["precision-pin", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        outcome = Outcome(ended.value.code, printed.out, printed.err)
        assert code in (None, outcome.code), outcome
        return outcome

    return command


@pytest.fixture
def refused(run, folder):
    """Run a command that must end with code 2 and write nothing; return its one line of an error."""

    def command(*arguments):
        before = listing(folder)
        outcome = run(*arguments, code=2)
        assert listing(folder) == before
        assert not outcome.out or arguments[0] == "check"
        # the first command of a fresh installation says that it compiles
        lines = [line for line in outcome.lines if not re.match("compiling the sampler|.*: with the sheet ", line)]
        assert all(LINE.fullmatch(line) and len(line) < 1000 for line in lines), lines
        (line,) = [line for line in lines if ": error E_" in line]
        return line

    return command


def listing(folder):
    """Every file below a folder with its contents; None for folders."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


@pytest.fixture
def new_files(folder):
    """Names in the working folder that were not there at the start."""
    before = set(listing(folder))
    return lambda: set(listing(folder)) - before


@pytest.fixture
def executable():
    """Return the path of the installed command."""
    path = Path(sys.executable).parent / "precision-pin"
    assert os.access(path, os.X_OK), f"{path} is missing: pip install -e ."
    return str(path)


FEWER = {"budget": 1024, "exact-law": 2000, "moments": 4096}
"""Samples in the sections of a page, whose commands ask for more."""


@pytest.fixture(autouse=True)
def undrawn_figures(monkeypatch):
    """Leave the figures of pages blank, their arm coarse and their sections of few samples: tests/outputs looks at them."""
    blank = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'
    monkeypatch.setattr("precision_pin.render.figure_style._svg", lambda _: blank)
    monkeypatch.setattr("precision_pin.pages.view.drawing._OVERSAMPLING", 1)
    take_few_samples(monkeypatch)


def take_few_samples(patch):
    """Have the sections of a page take few samples."""
    run = Declaration.run

    def run_on_few(self, model, pose, **arguments):
        few = {"samples": FEWER[self.name]} if self.name in FEWER else {}
        return run(self, model, pose, **{**few, **arguments})

    patch.setattr(Declaration, "run", run_on_few)
