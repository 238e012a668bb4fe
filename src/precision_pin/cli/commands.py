"""Every command and its line in the list; its module is imported only when it runs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from precision_pin.analyses.declaration import DECIDE, MEASURE, UNDERSTAND
from precision_pin.analyses.registry import declarations

if TYPE_CHECKING:
    import click

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
    "explain": ("precision_pin.cli.explain", HELP, "Say what a code of an error or a warning means, and what to do."),
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
    of_analyses = [(one.group, {name: one.summary}) for name, one in declarations().items()]
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
