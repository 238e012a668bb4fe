"""Results on a terminal: sentences folded to its width, verdicts in colour."""

from __future__ import annotations

import os
import re
import sys
import textwrap
from typing import Final

import click

from precision_pin.cli.streams import echo_data

__all__ = ["WIDTH", "echo_table"]

WIDTH: Final = 100
"""Columns of a line; tables shorten their cells to fit."""

_UNSURE: Final = ("UNDECIDED", "NOTHING TO JUDGE", "NOT JUDGED")
_COLOURS: Final = {"MET": "green", "NOT MET": "red", **dict.fromkeys(_UNSURE, "yellow")}
_VERDICT: Final = re.compile(rf"(?<=: )({'|'.join(_COLOURS)})(?= - |: | with )")
_VALUE: Final = re.compile(r" (?=-?[\d.]+(?:°|[,)]| ?mm\b| ?m\b))")
_GAP: Final = re.compile(r"\S {2,}\S")


def echo_table(text: str) -> None:
    """Print a result's text: sentences in lines of at most `WIDTH`, verdicts in colour where the terminal shows it.

    ``NO_COLOR`` turns colours off (no-color.org).

    Raises
    ------
    OutputError
        It cannot be written.
    """
    lines = [folded for line in text.split("\n") for folded in _fold(line)]
    coloured = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    echo_data("\n".join(map(_paint, lines) if coloured else lines))


def _fold(line: str) -> list[str]:
    """Return a sentence in several lines, joint and value together; a row of a table as it is."""
    if len(line) <= WIDTH or len(_GAP.findall(line)) > 1:
        return [line]
    indent = " " * (len(line) - len(line.lstrip()))
    lines = textwrap.wrap(
        _VALUE.sub("\N{NO-BREAK SPACE}", line), WIDTH, subsequent_indent=f"{indent}  ", break_long_words=False,
        break_on_hyphens=False,
    )  # fmt: skip
    return [one.replace("\N{NO-BREAK SPACE}", " ") for one in lines]


def _paint(line: str) -> str:
    return _VERDICT.sub(lambda verdict: click.style(verdict[0], fg=_COLOURS[verdict[0]], bold=True), line)
