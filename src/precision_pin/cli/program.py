"""Runs the command line, and turns every way in which it can end into an exit code."""

from __future__ import annotations

import signal
import traceback

import click

from precision_pin.base import interrupts
from precision_pin.base.errors import InputError, InternalError, nearest, one_line, shown
from precision_pin.cli import EXIT_INPUT, EXIT_INTERNAL
from precision_pin.cli.commands import list_commands, list_groups, load_command
from precision_pin.cli.resources import shortage
from precision_pin.cli.streams import messages, prepare_streams, raise_if_output_lost


class LateGroup(click.Group):
    """A group that lists its commands by name and imports one only to run it."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names, main command first."""
        return list(list_commands())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        return load_command(cmd_name) if cmd_name in list_commands() else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Suggest the closest command for an unknown name."""
        name = args[0] if args else ""
        if name not in list_commands() and not name.startswith("-"):
            ctx.fail(f"no command named {shown(name)}; {nearest(name, list_commands())}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """Run the command; Ctrl-C ends it."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise _InterruptedError from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands under their headings without importing them."""
        columns = max(map(len, list_commands()))
        for heading, lines in list_groups().items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(columns), line) for name, line in lines.items()])


@click.group(cls=LateGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="precision-pin")
def cli() -> None:
    """Accuracy budgets for robot arms: from a URDF and a sheet of error sources to the distribution of the
    end-effector's pose error.

    `precision-pin analyze` alone runs the paper's case. Data goes to stdout, progress and messages to stderr.
    Exit codes: 0 done, 1 a specification is not met or not judged, 2 usage or bad input, 3 internal error, 130 interrupted,
    143 terminated.
    """  # noqa: D205


def run() -> int:
    """Run the command line, print errors, and return the exit code."""
    prepare_streams()
    interrupts.begin()
    code = _code()
    try:
        raise_if_output_lost()
    except InputError as error:
        return code if code > EXIT_INPUT else _say(str(error), EXIT_INPUT)
    return code


def _code() -> int:
    try:
        code: int = cli.main(prog_name="precision-pin", standalone_mode=False) or 0
        if interrupts.came() in (0, signal.SIGINT):  # Ctrl-C is the usual end of what is served
            return code
        return _interrupted()
    except (_InterruptedError, click.exceptions.Abort, KeyboardInterrupt):
        return _interrupted()
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return EXIT_INPUT
    except click.ClickException as error:
        return _say(_usage_line(error), EXIT_INPUT)
    except InputError as error:
        return _say(str(error), EXIT_INPUT)
    except Exception as error:  # noqa: BLE001 - the last resort
        if interrupts.came():  # a library has replaced the exception
            return _interrupted()
        lack = shortage(error)
        if lack is not None:
            return _say(str(lack), EXIT_INPUT)
        # a bug is shown with its traceback
        what = error if isinstance(error, InternalError) else f"\n{traceback.format_exc()}"
        return _say(f"internal error (a bug in precision-pin): {what}".replace(": \n", ":\n"), EXIT_INTERNAL)


def _interrupted() -> int:
    number = interrupts.came() or signal.SIGINT
    return _say(interrupts.NAMES[number], 128 + number)


class _InterruptedError(Exception):
    """Ctrl-C, hidden from click, which would print an empty line for it."""


def _usage_line(error: click.ClickException) -> str:
    """Return a usage error as one line that names the help."""
    message = one_line(" ".join(error.format_message().split()).rstrip("."))
    context = getattr(error, "ctx", None)
    path = "precision-pin" if context is None else context.command_path
    return f"{path}: error E_USAGE: {message}; see {path} --help"


def _say(message: str, code: int) -> int:
    click.echo(messages(message), err=True)
    return code
