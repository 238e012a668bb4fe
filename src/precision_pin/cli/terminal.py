"""Results on a terminal: sentences and tables folded to its width, verdicts in colour."""

from __future__ import annotations

import os
import re
import sys
from itertools import groupby
from typing import Final

import click

from precision_pin.cli.streams import count_columns, echo_data, wrapped
from precision_pin.render.text_table import folded

WIDTH: Final = 100
"""Most columns of a sentence, and those of one that goes to no terminal; tables shorten their cells to fit."""

_UNSURE: Final = ("UNDECIDED", "NOTHING TO JUDGE", "NOT JUDGED")
_COLOURS: Final = {"MET": "green", "NOT MET": "red", **dict.fromkeys(_UNSURE, "yellow")}
_VERDICT: Final = re.compile(rf"(?<=: )({'|'.join(_COLOURS)})(?= - |: | with )")
_GAP: Final = re.compile(r"\S {2,}\S")


def echo_table(text: str) -> None:
    """Print a result's text: on a terminal nothing is wider than it, and verdicts are in colour.

    ``NO_COLOR`` turns colours off (no-color.org).

    Raises:
        OutputError: It cannot be written.
    """
    columns = count_columns(sys.stdout)
    lines: list[str] = []
    for is_table, group in groupby(text.split("\n"), lambda line: _GAP.search(line) is not None):
        rows = list(group)
        if is_table and columns is not None:
            rows = folded(rows, columns)
        lines += [row if len(_GAP.findall(row)) > 1 else wrapped(row, sys.stdout, WIDTH) for row in rows]
    coloured = columns is not None and not os.environ.get("NO_COLOR")
    echo_data("\n".join(map(_paint, lines) if coloured else lines))


def _paint(line: str) -> str:
    return _VERDICT.sub(lambda verdict: click.style(verdict[0], fg=_COLOURS[verdict[0]], bold=True), line)
