"""A command line in a folder of its own, run in this process by the function that the installed command calls."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from precision_pin.analyses.declaration import Declaration
from precision_pin.cli import main
from precision_pin.robot.examples import PAPER_SHEET

GANTRY = """<?xml version="1.0"?>
<robot name="gantry">
  <link name="frame"/>
  <link name="Schlitten_ü"/>
  <link name="腕"/>
  <link name="tool"/>
  <joint name="y_axis" type="prismatic">
    <parent link="frame"/><child link="Schlitten_ü"/>
    <origin xyz="0 0 1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="100" velocity="1"/>
  </joint>
  <joint name="a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage" type="revolute">
    <parent link="Schlitten_ü"/><child link="腕"/>
    <origin xyz="0.1 0 0"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" effort="100" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="腕"/><child link="tool"/>
    <origin xyz="0 0 -0.5"/>
  </joint>
</robot>
"""
LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"
GANTRY_SHEET = f"""precision-pin: 1
robot: gantry.urdf
poses:
  out: {{y_axis: 250 mm, {LONG}: 30 deg}}
  home: [0 mm, 0 deg]
sources:
  - joint_offset: {{joint: y_axis, offset: {{uniform: 0.1 mm}}}}
  - joint_offset: {{joint: {LONG}, offset: {{normal: 0.3 mrad}}}}
"""
FORKED = """<robot name="forked">
  <link name="body"/><link name="left"/><link name="right"/>
  <joint name="to_left" type="revolute"><parent link="body"/><child link="left"/><origin xyz="0 0.2 0"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="to_right" type="revolute"><parent link="body"/><child link="right"/><origin xyz="0 -0.2 0"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""


ASSUMPTION = re.compile(r": warning W_(STATICS|SUPERPOSITION): ")


@dataclass(frozen=True)
class Outcome:
    """What a command did."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)

    @property
    def err_lines(self) -> list[str]:
        return self.err.splitlines()

    @property
    def said(self) -> list[str]:
        """What stands on stderr besides warnings about assumptions of the case."""
        return [line for line in self.err_lines if not ASSUMPTION.search(line)]


Run = Callable[..., Outcome]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make the working folder: the paper's files, a gantry with a sheet, an arm with two leaves."""
    for file in PAPER_SHEET.parent.glob("4dof.*"):
        shutil.copy(file, tmp_path)
    (tmp_path / "gantry.urdf").write_text(GANTRY, encoding="utf-8")
    (tmp_path / "gantry.errors.yaml").write_text(GANTRY_SHEET, encoding="utf-8")
    (tmp_path / "forked.urdf").write_text(FORKED, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run ``precision-pin`` with arguments in the working folder."""

    def command(*arguments: str) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["precision-pin", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        code = ended.value.code
        assert isinstance(code, int)
        return Outcome(code, printed.out, printed.err)

    return command


def listing(folder: Path) -> dict[str, bytes | None]:
    """Every file below a folder with its contents; None for folders."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


@pytest.fixture
def contents(folder: Path) -> Callable[[], dict[str, bytes | None]]:
    """Return what reads what the working folder holds now."""
    return lambda: listing(folder)


@pytest.fixture
def new_files(folder: Path) -> Callable[[], set[str]]:
    """Names in the working folder that were not there at the start."""
    before = set(listing(folder))
    return lambda: set(listing(folder)) - before


@pytest.fixture
def executable() -> str:
    """Return the path of the installed command."""
    path = Path(sys.executable).parent / "precision-pin"
    assert os.access(path, os.X_OK), f"{path} is missing: pip install -e ."
    return str(path)


FEWER = {"budget": 1024, "exact-law": 2000, "moments": 4096}
"""Samples in the sections of a page, whose commands ask for more."""


@pytest.fixture(autouse=True)
def undrawn_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the figures of pages blank, their arm coarse and their sections of few samples: tests/outputs looks at them."""
    blank = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'
    monkeypatch.setattr("precision_pin.render.figure_style._svg", lambda _: blank)
    monkeypatch.setattr("precision_pin.pages.view.drawing._OVERSAMPLING", 1)
    take_few_samples(monkeypatch)


def take_few_samples(patch: pytest.MonkeyPatch) -> None:
    """Have the sections of a page take few samples."""
    run = Declaration.run

    def run_on_few(self: Declaration, model: Any, pose: Any, **arguments: Any) -> Any:
        few = {"samples": FEWER[self.name]} if self.name in FEWER else {}
        return run(self, model, pose, **{**few, **arguments})

    patch.setattr(Declaration, "run", run_on_few)
