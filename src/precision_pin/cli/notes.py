"""Messages of a command beside its result, on stderr: notes, which ``--quiet`` leaves out, and warnings, a line for each code."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterable, Sequence

import click

from precision_pin.base.errors import Finding, is_note
from precision_pin.cli.streams import say


def remember(context: click.Context, option: click.Parameter, given: bool) -> None:
    """Keep a flag of the running command for :func:`is_given`."""
    context.meta[f"{__name__}.{option.name}"] = given


def is_given(option: str) -> bool:
    """Return whether the running command has a flag: ``quiet`` or ``all_warnings``."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(f"{__name__}.{option}", False))


def echo_warnings(findings: Sequence[Finding], urdf: str | None = None) -> None:
    """Print warnings about sheet and robot on stderr: of several with one code the first, and how many more there are.

    Those of the robot's file ``urdf`` are one line, as ``check`` and ``init`` list them.
    """
    findings = [finding for finding in findings if finding.severity != "note"]
    if is_given("all_warnings"):
        for finding in findings:
            say(str(finding))
        return
    of_urdf = [finding.code for finding in findings if finding.file == urdf]
    if urdf is not None and of_urdf:
        warnings, them = ("warning", "it") if len(of_urdf) == 1 else ("warnings", "them")
        codes = ", ".join(dict.fromkeys(of_urdf))
        _say_once(f"{urdf}: {len(of_urdf)} {warnings} ({codes}); precision-pin check {shlex.quote(urdf)} lists {them}")
        findings = [finding for finding in findings if finding.file != urdf]
    for code, count in Counter(finding.code for finding in findings).items():
        first = next(finding for finding in findings if finding.code == code)
        say(f"{first}; and {count - 1} more {code}: --all-warnings" if count > 1 else str(first))


def _say_once(line: str) -> None:
    """Print a line on stderr unless this command has; ``compare`` reads the same robot for every sheet."""
    context = click.get_current_context(silent=True)
    said = set() if context is None else context.meta.setdefault(f"{__name__}.said", set())
    if line not in said:
        said.add(line)
        say(line)


def echo_warning_lines(lines: Iterable[str]) -> None:
    """Print a result's warnings on stderr, without what the sheet accepts."""
    for line in dict.fromkeys(lines):
        if not is_note(line):
            say(line)


def echo_note(line: str) -> None:
    """Print a note on stderr: progress, or a file that is used or was written."""
    if not is_given("quiet"):
        say(line)
