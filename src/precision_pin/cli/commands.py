"""Every command: its line in the list, and itself, imported only when it runs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from precision_pin.analyses.registry import declarations

if TYPE_CHECKING:
    import click

UNDERSTAND, DECIDE, MEASURE = "Understand how accurate it is", "Decide what to change", "Measure"
SHOW, HELP = "Show", "Sheets and help"

COMMANDS: dict[str, tuple[str, str, str]] = {
    "analyze": (
        "precision_pin.cli.analyze",
        UNDERSTAND,
        "Sample the pose error of an arm at a pose: statistics, specifications, plots.",
    ),
    "iso9283": (
        "precision_pin.cli.iso9283",
        MEASURE,
        "Forecast accuracy and repeatability as ISO 9283 measures them; compare with measured cycles.",
    ),
    "check": ("precision_pin.cli.check", HELP, "Check a URDF, or a sheet and its URDF; list every finding."),
    "init": ("precision_pin.cli.init", HELP, "Write a commented sheet for a URDF, with starting tolerances."),
    "mcpc": ("precision_pin.cli.mcpc", HELP, "Print the MCPC parameters of a chain."),
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
    "calibrate": (
        "precision_pin.cli.calibrate",
        MEASURE,
        "Forecast what measuring an arm will buy, choose poses to measure, or fit the model to readings.",
    ),
    "simulate": (
        "precision_pin.cli.simulate",
        MEASURE,
        "Write readings of a sampled robot, as calibrate and iso9283 --measured read them.",
    ),
    "map": (
        "precision_pin.cli.map",
        UNDERSTAND,
        "Map the pose error over many poses: quantiles, share in specification, main cause; the worst verified.",
    ),
    "path": (
        "precision_pin.cli.path",
        UNDERSTAND,
        "Sample the law of the largest error along a path, with bands that hold whole error curves.",
    ),
    "compare": (
        "precision_pin.cli.compare",
        DECIDE,
        "Compare sheets with the same robots: laws, verdicts, causes, and what differs in the sheets.",
    ),
    "compensate": (
        "precision_pin.cli.compensate",
        DECIDE,
        "Correct the constant part of the pose error by other joint values.",
    ),
    "allocate": (
        "precision_pin.cli.allocate",
        DECIDE,
        "Choose the cheapest tolerances that keep specifications at every pose.",
    ),
    "explain": ("precision_pin.cli.explain", HELP, "Say what a code of an error or a warning means, and what to do."),
    "schema": ("precision_pin.cli.schema", HELP, "Print the JSON schema of the sheet."),
    "doctor": ("precision_pin.cli.doctor", HELP, "Print versions and paths."),
}
"""The module whose ``command`` runs, the heading in the list, and the line below it; the registry has those of the analyses."""


def list_commands() -> dict[str, str]:
    """Return the line of every command by its name, main command first, then the analyses."""
    return {name: line for lines in list_groups().values() for name, line in lines.items()}


def list_groups() -> dict[str, dict[str, str]]:
    """Return the lines of :func:`list_commands` by the heading under which the program lists them."""
    groups: dict[str, dict[str, str]] = {heading: {} for heading in (UNDERSTAND, DECIDE, MEASURE, SHOW, HELP)}
    for name, (_, heading, line) in COMMANDS.items():
        groups.setdefault(heading, {})[name] = line
    (main, line), *others = groups[UNDERSTAND].items()
    groups[UNDERSTAND] = {main: line, **{name: one.summary for name, one in declarations().items()}, **dict(others)}
    return groups


def load_command(name: str) -> click.Command:
    """Return a command of :func:`list_commands`."""
    declaration = declarations().get(name)
    if declaration is not None:
        from precision_pin.cli.analyses import make_command

        return make_command(declaration)
    command: click.Command = import_module(COMMANDS[name][0]).command
    return command
