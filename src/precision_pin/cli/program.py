"""The commands, each imported only when it runs, and the program that turns every way to end into an exit code."""

from __future__ import annotations

import os
import signal
import traceback
from importlib import import_module

import click

from precision_pin.analyses.declaration import DECIDE, MEASURE, UNDERSTAND
from precision_pin.analyses.registry import declarations, extensions
from precision_pin.base import interrupts
from precision_pin.base.errors import InputError, InternalError, nearest, one_line, shown
from precision_pin.cli.exit_codes import EXIT_INPUT, EXIT_INTERNAL
from precision_pin.cli.streams import messages, prepare_streams, raise_if_output_lost, shortage
from precision_pin.cli.terminal import echo_warnings


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
        """Run the command, after a warning about analyses of others that cannot be used; Ctrl-C ends it."""
        echo_warnings([extension.finding for extension in extensions() if extension.error])
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
    if "_PRECISION_PIN_COMPLETE" in os.environ:
        from precision_pin.cli.completion import register

        register()
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
        # one line that names the help
        message = one_line(" ".join(error.format_message().split()).rstrip("."))
        if isinstance(error, click.NoSuchOption) and error.option_name == "--spec":
            message = "no option '--spec': this command judges no limits; analyze --spec does"
        context = getattr(error, "ctx", None)
        path = "precision-pin" if context is None else context.command_path
        return _say(f"{path}: error E_USAGE: {message}; see {path} --help", EXIT_INPUT)
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


def _say(message: str, code: int) -> int:
    click.echo(messages(message), err=True)
    return code


SHOW, HELP = "Show", "Sheets and help"

COMMANDS: dict[str, tuple[str, str, str]] = {
    "analyze": (
        "precision_pin.cli.analyze",
        UNDERSTAND,
        "Sample the pose error of an arm at a pose: statistics, specifications, plots.",
    ),
    "check": ("precision_pin.cli.check", HELP, "Check a URDF, or a sheet and its URDF; list every finding."),
    "init": ("precision_pin.cli.init", HELP, "Write a commented sheet for a URDF, with starting tolerances."),
    "mcpc": ("precision_pin.cli.check:mcpc", HELP, "Print the MCPC parameters of a chain."),
    "view": (
        "precision_pin.cli.view",
        SHOW,
        "Write a page with the arm and the cloud of sampled end-effector positions in 3-D.",
    ),
    "report": (
        "precision_pin.cli.report",
        SHOW,
        "Write everything about a pose into one page: verdict, distributions, causes, bounds, 3-D view.",
    ),
    "export": ("precision_pin.cli.export", SHOW, "Write robots as they may be built, each sampled, as URDF files."),
    "simulate": (
        "precision_pin.cli.simulate",
        MEASURE,
        "Write readings of a sampled robot, as calibrate and iso9283 --measured read them.",
    ),
    "explain": (
        "precision_pin.cli.explain",
        HELP,
        "Say what a code of an error or a warning means, and what to do.",
    ),
    "schema": ("precision_pin.cli.explain:schema", HELP, "Print the JSON schema of the sheet."),
    "doctor": ("precision_pin.cli.explain:doctor", HELP, "Print versions and paths."),
}
"""Module (or a name in it) of the command, heading in the list, and the line below it; without the analyses."""


def list_commands() -> dict[str, str]:
    """Return the line of every command by name, main command first, then the analyses."""
    return {name: line for lines in list_groups().values() for name, line in lines.items()}


def list_groups() -> dict[str, dict[str, str]]:
    """Return the lines of :func:`list_commands` by the heading under which the program lists them."""
    groups: dict[str, dict[str, str]] = {heading: {} for heading in (UNDERSTAND, DECIDE, MEASURE, SHOW, HELP)}
    main, *others = [(heading, {name: line}) for name, (_, heading, line) in COMMANDS.items()]
    of_analyses = [(declaration.group, {name: declaration.summary}) for name, declaration in declarations().items()]
    for heading, line in (main, *of_analyses, *others):
        groups.setdefault(heading, {}).update(line)
    return groups


def load_command(name: str) -> click.Command:
    """Return a command of :func:`list_commands`."""
    declaration = declarations().get(name)
    if declaration is not None:
        from precision_pin.cli.analyses import make_command

        return make_command(declaration)
    module, _, attribute = COMMANDS[name][0].partition(":")
    return getattr(import_module(module), attribute or "command")
