"""``python -m fuzzing urdfs|sheets|interrupts``: each kind of attack is one file with a ``command``."""

from __future__ import annotations

import importlib
from pathlib import Path

import click


class Attacks(click.Group):
    """A group with one command for each file of this folder."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(file.stem for file in Path(__file__).parent.glob("[a-z]*.py"))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.list_commands(ctx):
            return None
        command: click.Command = importlib.import_module(f"fuzzing.{cmd_name}").command
        return command


@click.group(cls=Attacks)
def main() -> None:
    """Attack the package and list what did not hold. Exit code 1 if anything did not.

    A finding names the seed and number of its mutant, with which it is made again.
    """


main(prog_name="python -m fuzzing")
