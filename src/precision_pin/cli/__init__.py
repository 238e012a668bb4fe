"""The command ``precision-pin``. Each command is one file, imported only when it runs."""

from __future__ import annotations

import importlib
import io
import sys
import traceback
from typing import Final

import click

from precision_pin.cli.interrupts import heeding_interrupts
from precision_pin.errors import InputError, InternalError

__all__ = ["main"]

COMMANDS: Final = {
    "analyze": "Sample the pose error of an arm at a pose: statistics, specifications, plots.",
    "budget": "Share of each draw, source and joint in the spread of the error; what a halved tolerance would give.",
    "check": "Check a URDF, or a sheet and its URDF; list every finding.",
    "init": "Write a commented sheet for a URDF, with starting tolerances.",
    "mcpc": "Print the MCPC parameters of a chain.",
    "worst-case": "Bound the pose error if every tolerance does its worst at once.",
    "exact-law": "Compute the law of every component of the first-order error, tails included, without sampling.",
    "reliability": "Probability that a limit is exceeded, by several methods, down to one in ten million and below.",
    "view": "Write a page with the arm and the cloud of sampled end-effector positions in 3-D.",
    "report": "Write everything about a pose into one page: verdict, distributions, causes, bounds, 3-D view.",
    "export": "Write robots as they may be built, each sampled, as URDF files.",
    "schema": "Print the JSON schema of the sheet.",
    "doctor": "Print versions and paths.",
}

EXIT_SPEC, EXIT_INPUT, EXIT_INTERNAL, EXIT_INTERRUPTED = 1, 2, 3, 130


class LateGroup(click.Group):
    """A group that knows its commands by name and imports one only to run it."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names, main command first."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = importlib.import_module(f"precision_pin.cli.{cmd_name.replace('-', '_')}").command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Name the nearest command where there is none of that name."""
        name = args[0] if args else ""
        if name not in COMMANDS and not name.startswith("-"):
            from precision_pin.errors import nearest

            ctx.fail(f"no command named {name!r}; {nearest(name, COMMANDS)}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """Run the command; Ctrl-C ends it."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise _InterruptedError from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=LateGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="precision-pin")
def cli() -> None:
    """Accuracy budgets for robot arms: from a URDF and a sheet of error sources to the distribution of the
    end-effector's pose error.

    `precision-pin analyze` alone runs the paper's case. Data goes to stdout, progress and messages to stderr.
    Exit codes: 0 done, 1 a specification is not met, 2 usage or bad input, 3 internal error, 130 interrupted.
    """  # noqa: D205


def main() -> None:
    """Run the command line and exit with the code of the contract."""
    for stream in (sys.stdout, sys.stderr):
        # names may hold what a terminal cannot show; that is no reason to stop
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with heeding_interrupts():
            code = cli.main(prog_name="precision-pin", standalone_mode=False)
    except (_InterruptedError, click.exceptions.Abort, KeyboardInterrupt):
        code = _say("interrupted", EXIT_INTERRUPTED)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        code = EXIT_INPUT
    except click.ClickException as error:
        code = _say(_usage_line(error), EXIT_INPUT)
    except InputError as error:
        code = _say(str(error), EXIT_INPUT)
    except InternalError as error:
        code = _say(f"internal error (a bug in precision-pin): {error}", EXIT_INTERNAL)
    except Exception:  # noqa: BLE001 - the last resort: a bug is shown whole, with its exit code
        code = _say(f"internal error (a bug in precision-pin):\n{traceback.format_exc()}", EXIT_INTERNAL)
    sys.exit(code or 0)


class _InterruptedError(Exception):
    """Ctrl-C, kept from click, which would print an empty line for it."""


def _usage_line(error: click.ClickException) -> str:
    """Return a wrong command line's message as one line, with where help is."""
    message = " ".join(error.format_message().split()).rstrip(".")
    context = getattr(error, "ctx", None)
    path = "precision-pin" if context is None else context.command_path
    return f"{path}: error E_USAGE: {message}; see {path} --help"


def _say(message: str, code: int) -> int:
    click.echo(message, err=True)
    return code
