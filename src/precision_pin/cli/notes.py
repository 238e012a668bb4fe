"""Notes on stderr: what a command tells beside its result, and ``--quiet``, which leaves them out."""

from __future__ import annotations

from typing import Final

import click

from precision_pin.cli.streams import say

__all__ = ["echo_note", "is_quiet", "quiet_option"]

_QUIET: Final = f"{__name__}.quiet"


def _remember(context: click.Context, option: click.Parameter, quiet: bool) -> None:
    context.meta[_QUIET] = quiet


quiet_option: Final = click.option(
    "--quiet",
    is_flag=True,
    expose_value=False,
    callback=_remember,
    help="Leave out notes and progress; warnings and errors stay.",
)


def is_quiet() -> bool:
    """Return whether the running command has ``--quiet``."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(_QUIET, False))


def echo_note(line: str) -> None:
    """Print a line on stderr that is no warning and no error: what is being done, which file is used or was written."""
    if not is_quiet():
        say(line)
