"""``precision-pin doctor``."""

from __future__ import annotations

import os
import platform

import click

from precision_pin.cli.options import Command
from precision_pin.cli.streams import echo_data


@click.command("doctor", cls=Command)
def command() -> None:
    """Print the versions and paths that a result depends on; good to put into a bug report."""
    import precision_pin
    from precision_pin.base.versions import versions
    from precision_pin.robot.examples import PAPER_SHEET, example_urdfs

    lines = {
        **versions(),
        "system": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "package": os.path.dirname(os.path.abspath(precision_pin.__file__)),
        "paper's case": f"{PAPER_SHEET} ({'found' if PAPER_SHEET.is_file() else 'MISSING'})",
        "example robots": f"{len(example_urdfs())} (example-robot-data)" if example_urdfs() else "not installed",
    }
    width = max(map(len, lines))
    echo_data("\n".join(f"{name:<{width}}  {value}" for name, value in lines.items()))
