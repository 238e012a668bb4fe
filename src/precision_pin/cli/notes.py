"""Messages of a command beside its result, on stderr: notes, which ``--quiet`` leaves out, and warnings, a line for each code."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

import click

from precision_pin.cli.streams import say
from precision_pin.errors import Finding

__all__ = ["all_warnings_option", "echo_frozen", "echo_note", "echo_warnings", "is_quiet", "quiet_option"]

_QUIET: Final = f"{__name__}.quiet"
_ALL_WARNINGS: Final = f"{__name__}.all_warnings"


def _remember(context: click.Context, option: click.Parameter, given: bool) -> None:
    context.meta[f"{__name__}.{option.name}"] = given


all_warnings_option: Final = click.option(
    "--all-warnings",
    is_flag=True,
    expose_value=False,
    callback=_remember,
    help="Print every warning about sheet and robot, not one of each code.",
)

quiet_option: Final = click.option(
    "--quiet",
    is_flag=True,
    expose_value=False,
    callback=_remember,
    help="Leave out notes and progress; warnings and errors stay.",
)


def is_quiet() -> bool:
    """Return whether the running command has ``--quiet``."""
    return _is_given(_QUIET)


def _is_given(option: str) -> bool:
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(option, False))


def echo_warnings(findings: Sequence[Finding]) -> None:
    """Print findings about sheet and robot on stderr: of several with one code the first, and how many more there are."""
    if _is_given(_ALL_WARNINGS):
        for finding in findings:
            say(str(finding))
        return
    counts = Counter(finding.code for finding in findings)
    first: dict[str, Finding] = {}
    for finding in findings:
        first.setdefault(finding.code, finding)
    for finding in first.values():
        more = counts[finding.code] - 1
        say(f"{finding}; and {more} more {finding.code}: --all-warnings" if more else str(finding))


def echo_note(line: str) -> None:
    """Print a note on stderr: progress, or a file that is used or was written."""
    if not is_quiet():
        say(line)


def echo_frozen(frozen: Sequence[str], where: str) -> None:
    """Note which sources a written URDF has as they are at one pose; nothing where there are none.

    Parameters
    ----------
    frozen
        Labels of these sources.
    where
        The pose.
    """
    if not frozen:
        return
    counts = Counter(label.partition("[")[0] for label in frozen)
    listed = ", ".join(kind if count == 1 else f"{count} {kind}" for kind, count in counts.items())
    one = len(frozen) == 1
    echo_note(
        f"true at {where} only: the errors of {listed}, which {'changes' if one else 'change'} with load, pose or visit; "
        "readings with them at every pose: simulate"
    )
