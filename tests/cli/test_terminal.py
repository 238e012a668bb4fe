"""Results on a terminal: verdicts in colour where it shows them, sentences folded, rows of tables whole."""

from __future__ import annotations

import sys

import click
import pytest

from precision_pin.cli.terminal import WIDTH, echo_table

VERDICTS = "spec |d| within 1 mm for 95 %: NOT MET - 3 % inside\nspec |dx| within 1 mm for 95 %: MET - 99 % inside"


@pytest.mark.parametrize(
    ("is_terminal", "no_color", "coloured"), [(True, "", True), (True, "1", False), (False, "", False)]
)
def test_verdicts_are_coloured_on_a_terminal_only(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    is_terminal: bool,
    no_color: str,
    coloured: bool,
) -> None:
    monkeypatch.setenv("NO_COLOR", no_color)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: is_terminal)
    printed: list[str] = []
    monkeypatch.setattr("precision_pin.cli.terminal.echo_data", printed.append)
    echo_table(VERDICTS)
    red, green = click.style("NOT MET", fg="red", bold=True), click.style("MET", fg="green", bold=True)
    expected = VERDICTS.replace("MET", green).replace(f"NOT {green}", red) if coloured else VERDICTS
    assert printed == [expected]


def test_sentences_are_folded_and_rows_are_not(capsys: pytest.CaptureFixture[str]) -> None:
    joints = ", ".join(f"joint_{k} -{k}0.5°" for k in range(12))
    row = "  ".join(f"cell{k}" for k in range(20))
    echo_table(f"arm.urdf: base to tool, pose ({joints})\n{row}")
    *folded, last = capsys.readouterr().out.splitlines()
    assert last == row
    assert max(map(len, folded)) <= WIDTH
    assert " ".join(line.strip() for line in folded) == f"arm.urdf: base to tool, pose ({joints})"
    # a joint and its value are in one line
    assert all(line.endswith((",", ")")) for line in folded)


def test_warnings_of_one_code_are_one_line_unless_all_are_asked_for(run) -> None:
    one = run("analyze", "example:xarm7", "--samples", "50")
    lines = [line for line in one.err_lines if "W_ANGLE_ROUNDED" in line]
    assert len(lines) == 1
    assert lines[0].endswith("; and 5 more W_ANGLE_ROUNDED: --all-warnings")
    every = run("analyze", "example:xarm7", "--samples", "50", "--all-warnings")
    lines = [line for line in every.err_lines if "W_ANGLE_ROUNDED" in line]
    assert len(lines) == 6
    assert not any("--all-warnings" in line for line in lines)
