"""``precision-pin init``."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import click

from precision_pin.base.errors import OutputError
from precision_pin.base.files import write_text
from precision_pin.base.input_files import noted_inputs
from precision_pin.cli.headings import output_option
from precision_pin.cli.notes import echo_note, echo_warnings, quiet_option
from precision_pin.cli.options import Command, robot_options
from precision_pin.cli.streams import echo_data
from precision_pin.cli.targets import Outputs


@click.command("init", cls=Command)
@click.argument("robot", metavar="ROBOT.urdf")
@robot_options
@output_option("--out", metavar="FILE", help="The sheet; ROBOT.errors.yaml in this folder if left out, - for stdout.")
@quiet_option
@output_option("--force", is_flag=True, help="Overwrite the sheet if it is there.")
def command(
    robot: str, tip: str | None, base: str | None, package_dirs: tuple[str, ...], out: str | None, force: bool
) -> None:
    """Write a commented sheet for a URDF: every joint and link of the chain, with starting tolerances to replace.

    ROBOT may be example:NAME; where a sheet with sources comes with precision-pin for it, that one is written. The sheet runs
    as it is: precision-pin analyze SHEET.
    """
    from precision_pin.export.scaffold import scaffold
    from precision_pin.robot.chain import Chain, chain_findings
    from precision_pin.robot.examples import PREFIX, example_urdfs, resolve_robot, shipped_sheet, starting_sheet
    from precision_pin.robot.urdf import read

    path = resolve_robot(robot)
    target = Path(out) if out is not None else Path(starting_sheet(path))
    to_stdout = out == "-"
    if not to_stdout:
        outputs = Outputs({"--out": out or str(target)})
        outputs.check()
        outputs.refuse_inputs([str(path)])
        if target.exists() and not force:
            raise OutputError(f"{target} exists; --force overwrites it, --out names another file")
    with noted_inputs() as inputs:
        text, what = _shipped(robot, tip, base)
        if text is None:
            chain = Chain.from_robot(read(path, package_dirs=package_dirs), tip, base)
            named = robot if robot.startswith(PREFIX) else os.path.relpath(path, Path() if to_stdout else target.parent)
            text = scaffold(chain, named)
            echo_warnings(chain_findings(chain))
            alike = f"{PREFIX}{chain.robot.name}"
            if shipped_sheet(alike) is not None and robot != alike and chain.robot.name in example_urdfs():
                what += f" (with sources: precision-pin init {alike}, if this is such an arm)"
    if not to_stdout:
        outputs.refuse_inputs(inputs)
    if to_stdout:
        echo_data(text.removesuffix("\n"))
        return
    write_text(target, text)
    echo_note(f"wrote {target}{what}; now: precision-pin analyze {shlex.quote(str(target))}")


def _shipped(robot: str, tip: str | None, base: str | None) -> tuple[str | None, str]:
    """Return the sheet shipped for a robot and its chain, or None, and the note to print."""
    from precision_pin.robot.examples import shipped_sheet
    from precision_pin.sheet import read

    file = shipped_sheet(robot)
    if file is None:
        return None, ", all its numbers assumptions"
    chain = read(file).chain
    if tip in (None, chain.tip) and base in (None, chain.base):
        return file.read_text(encoding="utf-8"), ", the sheet with sources that comes with precision-pin"
    return None, (
        f", all its numbers assumptions (the sheet with sources that comes with precision-pin is of {chain.base} to {chain.tip})"
    )
