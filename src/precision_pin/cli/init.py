"""``precision-pin init``."""

from __future__ import annotations

import os
from pathlib import Path

import click

from precision_pin.cli.common import Command, chain_options
from precision_pin.cli.streams import say
from precision_pin.cli.writing import Outputs, echo_data, write_text
from precision_pin.errors import OutputError
from precision_pin.input_files import noted_inputs

__all__ = ["command"]


@click.command("init", cls=Command)
@click.argument("robot", metavar="ROBOT.urdf")
@chain_options
@click.option("--out", metavar="FILE", help="The sheet; ROBOT.errors.yaml in this folder if left out, - for stdout.")
@click.option("--force", is_flag=True, help="Overwrite the sheet if it is there.")
def command(
    robot: str, tip: str | None, base: str | None, package_dirs: tuple[str, ...], out: str | None, force: bool
) -> None:
    """Write a commented sheet for a URDF: every joint and link of the chain, with starting tolerances to replace.

    ROBOT may be example:NAME. The sheet runs as it is: precision-pin analyze SHEET.
    """
    from precision_pin.chain import Chain
    from precision_pin.examples import PREFIX, resolve_robot
    from precision_pin.outputs.scaffold import scaffold
    from precision_pin.urdf import read

    path = resolve_robot(robot)
    target = Path(out) if out is not None else Path(f"{path.stem.removesuffix('_robot')}.errors.yaml")
    to_stdout = out == "-"
    if not to_stdout:
        outputs = Outputs({"--out": out or str(target)})
        outputs.check()
        outputs.refuse_inputs([str(path)])
        if target.exists() and not force:
            raise OutputError(f"{target} exists; --force overwrites it, --out names another file")
    with noted_inputs() as inputs:
        chain = Chain.from_robot(read(path, package_dirs=package_dirs), tip, base)
    if not to_stdout:
        outputs.refuse_inputs(inputs)
    named = robot if robot.startswith(PREFIX) else os.path.relpath(path, Path() if to_stdout else target.parent)
    text = scaffold(chain, named)
    if to_stdout:
        echo_data(text.removesuffix("\n"))
        return
    write_text(target, text)
    say(f"wrote {target}; now: precision-pin analyze {target}")
