"""Every command: its line in the list, and itself, imported only when it runs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from precision_pin.analyses.registry import declarations

if TYPE_CHECKING:
    import click

__all__ = ["COMMANDS", "list_commands", "load_command"]

COMMANDS: dict[str, tuple[str, str]] = {
    "analyze": (
        "precision_pin.cli.analyze",
        "Sample the pose error of an arm at a pose: statistics, specifications, plots.",
    ),
    "iso9283": (
        "precision_pin.cli.iso9283",
        "Forecast accuracy and repeatability as ISO 9283 measures them; compare with measured cycles.",
    ),
    "check": ("precision_pin.cli.check", "Check a URDF, or a sheet and its URDF; list every finding."),
    "init": ("precision_pin.cli.init", "Write a commented sheet for a URDF, with starting tolerances."),
    "mcpc": ("precision_pin.cli.mcpc", "Print the MCPC parameters of a chain."),
    "view": (
        "precision_pin.cli.view",
        "Write a page with the arm and the cloud of sampled end-effector positions in 3-D.",
    ),
    "report": (
        "precision_pin.cli.report",
        "Write everything about a pose into one page: verdict, distributions, causes, bounds, 3-D view.",
    ),
    "export": ("precision_pin.cli.export", "Write robots as they may be built, each sampled, as URDF files."),
    "calibrate": (
        "precision_pin.cli.calibrate",
        "Forecast what measuring an arm will buy, choose poses to measure, or fit the model to readings.",
    ),
    "simulate": (
        "precision_pin.cli.simulate",
        "Write readings of a sampled robot, as calibrate and iso9283 --measured read them.",
    ),
    "map": (
        "precision_pin.cli.map",
        "Map the pose error over many poses: quantiles, share in specification, main cause; the worst verified.",
    ),
    "path": (
        "precision_pin.cli.path",
        "Sample the law of the largest error along a path, with bands that hold whole error curves.",
    ),
    "compare": (
        "precision_pin.cli.compare",
        "Compare sheets with the same robots: laws, verdicts, causes, and what differs in the sheets.",
    ),
    "compensate": (
        "precision_pin.cli.compensate",
        "Correct the constant part of the pose error by other joint values.",
    ),
    "allocate": (
        "precision_pin.cli.allocate",
        "Choose the cheapest tolerances that keep specifications at every pose.",
    ),
    "explain": ("precision_pin.cli.explain", "Say what a code of an error or a warning means, and what to do."),
    "schema": ("precision_pin.cli.schema", "Print the JSON schema of the sheet."),
    "doctor": ("precision_pin.cli.doctor", "Print versions and paths."),
}
"""The module whose ``command`` runs, and its line in the list; the analyses have theirs from the registry."""


def list_commands() -> dict[str, str]:
    """Return the line of every command by its name, main command first, then the analyses."""
    (first, line), *others = ((name, line) for name, (_, line) in COMMANDS.items())
    return {first: line, **{name: one.summary for name, one in declarations().items()}, **dict(others)}


def load_command(name: str) -> click.Command:
    """Return a command of :func:`list_commands`."""
    declaration = declarations().get(name)
    if declaration is not None:
        from precision_pin.cli.analyses import make_command

        return make_command(declaration)
    command: click.Command = import_module(COMMANDS[name][0]).command
    return command
