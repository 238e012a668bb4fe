"""An output is a file and the line of its command: one is added here, and runs as every command does."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

import precision_pin as pp
from cli.conftest import Run
from precision_pin.cli import program
from precision_pin.robot.examples import PAPER_SHEET

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
