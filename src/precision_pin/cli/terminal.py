"""Results on a terminal: sentences and tables folded to its width and cut to its height, verdicts in colour; notes."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import chain, groupby
from typing import Any, Final, NamedTuple

import click

from precision_pin.base.errors import Finding, is_note
from precision_pin.base.files import write_text
from precision_pin.cli.streams import count_columns, count_rows, echo_data, say, wrapped
from precision_pin.render.text_table import folded

WIDTH: Final = 100
"""Largest width of a sentence, also without a terminal; tables shorten their cells to fit."""
ALL: Final = "is_whole"
"""Name of the option ``--all``, which prints everything."""

_UNSURE: Final = ("UNDECIDED", "NOTHING TO JUDGE", "NOT JUDGED")
_COLOURS: Final = {"MET": "green", "NOT MET": "red", **dict.fromkeys(_UNSURE, "yellow")}
_VERDICT: Final = re.compile(rf"(?<=: )({'|'.join(_COLOURS)})(?= - |: | with |$)")
_GAP: Final = re.compile(r"\S {2,}\S")
_JOINT: Final = re.compile(r"(?:(?<=[(,] )|(?<=\())[^\s,()]+ (?=-?[\d.]+(?:°| mm)[,)])")
_FOOT: Final = "rests on assumptions: "
_KINDS: Final = re.compile(r" \(.*\)$")
_FEWEST: Final = 12
"""Rows of a result on a terminal of any height."""


class _Piece(NamedTuple):
    """Rows of a table, or of one sentence."""

    rows: list[str]
    is_table: bool


def echo_table(text: str, *, is_answered: bool = False, below: int = 0) -> None:
    """Print a result's text: on a terminal it is folded to the width, with verdicts in colour.

    On a low terminal, sentences and rows of tables are left out, unless ``--all`` is given, and the answer, its
    verdicts or else its first sentence, is repeated at the end. ``NO_COLOR`` turns colours off (no-color.org).

    Args:
        text: Blocks separated by blank lines; the first one answers.
        is_answered: Whether the text ends with the answer, or is none.
        below: Rows of notes that will follow.
    """
    columns = count_columns(sys.stdout)
    blocks = [_pieces(block.split("\n"), columns) for block in text.split("\n\n")]
    context = click.get_current_context(silent=True)
    is_whole = context is None or context.params.get(ALL) is not False
    cut = columns is not None and not is_whole
    lines = _screen(text, blocks, below, is_answered=is_answered) if cut else _joined(blocks)
    coloured = columns is not None and not os.environ.get("NO_COLOR")
    echo_data("\n".join(map(_paint, lines) if coloured else lines))


def echo_result(result: Any, json_path: str | None, table: Callable[[], str], **shown: Any) -> None:
    """Print a result as its table, or as its JSON for ``--json -``, and write the file of ``--json``."""
    if json_path == "-":
        echo_data(result.to_json())
        return
    echo_table(table(), **shown)
    if json_path is not None:
        write_text(json_path, result.to_json() + "\n")


def _pieces(lines: Sequence[str], columns: int | None) -> list[_Piece]:
    pieces = []
    for is_table, group in groupby(lines, lambda line: _GAP.search(line) is not None):
        rows = list(group)
        if is_table and columns is not None:
            rows = folded(rows, columns)
        parts = [[row] if len(_GAP.findall(row)) > 1 else wrapped(row, sys.stdout, WIDTH).split("\n") for row in rows]
        pieces += [_Piece([*chain(*parts)], True)] if is_table else [_Piece(part, False) for part in parts]
    return pieces


def _screen(text: str, blocks: list[list[_Piece]], below: int, *, is_answered: bool) -> list[str]:
    room = max(count_rows(sys.stdout) - 1 - below, _FEWEST)
    whole = _height(chain(*blocks)) + len(blocks) - 1
    answer = []
    if not is_answered and whole > 8:  # a shorter answer is not repeated
        answer = _verdict_rows(text) or _short(text.partition("\n\n")[0].split("\n"))
    if whole + len(answer) <= room:
        return [*_joined(blocks), *answer]
    *brief, last = [[_unnamed(piece) for piece in block] for block in blocks]
    end = next((k for k, piece in enumerate(last) if piece.rows[0].startswith(_FOOT)), len(last))
    foot = [_brief_foot(last[end:])] if last[end:] else []
    if is_answered:
        # it ends with all verdicts, for which there is no room, or with a sentence
        answer = _verdict_rows(text) or ([] if last[-1].is_table else last[-1].rows)
        end = next((k for k, piece in enumerate(last) if piece.is_table), -1) + 1
    left = room - _height(foot) - len(answer) - 1
    head: list[list[_Piece]] = []
    is_cut = False
    for rank, block in enumerate([*brief, last[:end]]):
        here = left - (1 if head else 0)
        taken: list[_Piece] = []
        for piece in block:
            is_long = rank and not piece.is_table and len(piece.rows) > 2
            rows = [] if is_long else piece.rows if len(piece.rows) <= here else _first_rows(piece, here)
            if rows:
                taken.append(_Piece(rows, piece.is_table))
                here -= len(rows)
        # a sentence refers to what is before or after it
        if taken and (not is_cut or any(piece.is_table for piece in taken)):
            head.append(taken)
            left = here
        is_cut = is_cut or _height(taken) < _height(block)
    height = _height(chain(*head, foot))
    more = f"--all prints {whole - len(blocks) + 1 - height:,} more rows"
    return [*_joined(head), *_joined([foot]), more, *answer]


def _height(pieces: Iterable[_Piece]) -> int:
    return sum(len(piece.rows) for piece in pieces)


def _brief_foot(pieces: Sequence[_Piece]) -> _Piece:
    """Return the assumptions of a result as one sentence, without their kinds."""
    lines = [" ".join(row.strip() for row in piece.rows) for piece in pieces]
    text = "; ".join([_KINDS.sub("", lines[0]), *(line for line in lines[1:] if line.startswith("they cause "))])
    return _Piece(wrapped(text, sys.stdout, WIDTH).split("\n"), False)


def _joined(blocks: Sequence[Sequence[_Piece]]) -> list[str]:
    return [line for block in blocks for line in ["", *(row for piece in block for row in piece.rows)]][1:]


def _unnamed(piece: _Piece) -> _Piece:
    """Return the sentence about the arm and the pose without the names of the joints."""
    line = " ".join(row.strip() for row in piece.rows)
    if piece.is_table or ", pose " not in line:
        return piece
    return _Piece(wrapped(_JOINT.sub("", line), sys.stdout, WIDTH).split("\n"), False)


def _first_rows(piece: _Piece, room: int) -> list[str]:
    """Return the rows of a table that fit, whole groups of its columns first; none of a sentence."""
    if not piece.is_table or room < 3:
        return []
    end = next((k for k, row in enumerate(piece.rows) if not row), len(piece.rows))
    return piece.rows[: min(end, room)]


def _verdict_rows(text: str) -> list[str]:
    """Return the verdicts of a text, those not met first."""
    lines = (line.strip().partition(" - ")[0] for line in text.split("\n") if _VERDICT.search(line))
    given = [line.removeprefix("spec ") for line in lines]
    return _short(sorted(given, key=lambda line: line.endswith(": MET")))


def _short(lines: Sequence[str]) -> list[str]:
    rows: list[str] = []
    for line in dict.fromkeys(lines):
        more = wrapped(line, sys.stdout, WIDTH).split("\n")
        if rows and len(rows) + len(more) > 3:
            break
        rows += more
    return rows


def _paint(line: str) -> str:
    return _VERDICT.sub(lambda verdict: click.style(verdict[0], fg=_COLOURS[verdict[0]], bold=True), line)


def remember(context: click.Context, option: click.Parameter, given: bool) -> None:
    """Store a flag of the running command for :func:`is_given`."""
    context.meta[f"{__name__}.{option.name}"] = given


def is_given(option: str) -> bool:
    """Return whether the running command has a flag: ``quiet`` or ``all_warnings``."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(f"{__name__}.{option}", False))


def echo_warnings(findings: Sequence[Finding], urdf: str | None = None) -> None:
    """Print warnings on stderr: the first of each code and the number of others; one line for the file ``urdf``."""
    findings = [finding for finding in findings if finding.severity != "note"]
    if is_given("all_warnings"):
        for finding in findings:
            say(str(finding))
        return
    of_urdf = [finding.code for finding in findings if finding.file == urdf]
    if urdf is not None and of_urdf:
        warnings, them = ("warning", "it") if len(of_urdf) == 1 else ("warnings", "them")
        codes = ", ".join(dict.fromkeys(of_urdf))
        line = f"{urdf}: {len(of_urdf)} {warnings} ({codes}); precision-pin check {shlex.quote(urdf)} lists {them}"
        # once per command: ``compare`` reads the same robot for every sheet
        context = click.get_current_context(silent=True)
        said = set() if context is None else context.meta.setdefault(f"{__name__}.said", set())
        if line not in said:
            said.add(line)
            say(line)
        findings = [finding for finding in findings if finding.file != urdf]
    for code, count in Counter(finding.code for finding in findings).items():
        first = next(finding for finding in findings if finding.code == code)
        say(f"{first}; and {count - 1} more {code}: --all-warnings" if count > 1 else str(first))


def echo_warning_lines(lines: Iterable[str]) -> None:
    """Print a result's warnings on stderr, without those that the sheet accepts."""
    for line in dict.fromkeys(lines):
        if not is_note(line):
            say(line)


def echo_note(line: str) -> None:
    """Print a note on stderr: progress, or a file that is used or was written."""
    if not is_given("quiet"):
        say(line)
