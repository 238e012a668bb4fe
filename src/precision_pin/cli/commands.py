"""Every command: its line in the list, and itself, imported only when it runs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from precision_pin.analyses.registry import declarations

if TYPE_CHECKING:
    import click

__all__ = ["list_commands", "load_command"]


def list_commands() -> dict[str, str]:
    """Return the line of every command by its name, main command first."""
    return {
        "analyze": "Sample the pose error of an arm at a pose: statistics, specifications, plots.",
        **{name: one.summary for name, one in declarations().items()},
        "check": "Check a URDF, or a sheet and its URDF; list every finding.",
        "init": "Write a commented sheet for a URDF, with starting tolerances.",
        "mcpc": "Print the MCPC parameters of a chain.",
        "view": "Write a page with the arm and the cloud of sampled end-effector positions in 3-D.",
        "report": "Write everything about a pose into one page: verdict, distributions, causes, bounds, 3-D view.",
        "export": "Write robots as they may be built, each sampled, as URDF files.",
        "schema": "Print the JSON schema of the sheet.",
        "doctor": "Print versions and paths.",
    }


def load_command(name: str) -> click.Command:
    """Return a command of :func:`list_commands`."""
    declaration = declarations().get(name)
    if declaration is not None:
        from precision_pin.cli.analyses import make_command

        return make_command(declaration)
    command: click.Command = import_module(f"precision_pin.cli.{name}").command
    return command
