"""``precision-pin schema``."""

from __future__ import annotations

import json

import click

from precision_pin.cli.options import Command
from precision_pin.cli.streams import echo_data


@click.command("schema", cls=Command)
def command() -> None:
    """Print the JSON schema of the sheet, for editors and checkers."""
    from precision_pin.sheet import json_schema

    echo_data(json.dumps(json_schema(), indent=2, ensure_ascii=False))
