"""``precision-pin init``."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import click

from precision_pin.base.errors import Finding, InputError, OutputError, shown, some
from precision_pin.base.files import noted_inputs, write_files, write_text
from precision_pin.cli.inputs import Outputs
from precision_pin.cli.options import FILE, Command, argument, headed_option, output_option, quiet_option, robot_options
from precision_pin.cli.streams import echo_data
from precision_pin.cli.terminal import echo_note, echo_warnings


@click.command("init", cls=Command)
@argument("robot", metavar="ROBOT.urdf|.xacro")
@argument("arguments", nargs=-1, metavar="[NAME:=VALUE]...")
@robot_options
@output_option(
    "--out", type=FILE, metavar="FILE", help="The sheet; ROBOT.errors.yaml in this folder if left out, - for stdout."
)
@quiet_option
@output_option("--force", is_flag=True, help="Overwrite the sheet if it is there.")
@headed_option(
    "--calibration",
    is_flag=True,
    help="Write the sheet of a complete calibration: geometry, zeros and compliances of all joints free, base and target too.",
)
@headed_option(
    "--mend-inertia",
    is_flag=True,
    help="Write a copy of a URDF whose inertias no body can have, with the nearest that one can; masses stay.",
)
def command(
    robot: str,
    arguments: tuple[str, ...],
    tip: str | None,
    base: str | None,
    package_dirs: tuple[str, ...],
    out: str | None,
    force: bool,
    calibration: bool,
    mend_inertia: bool,
) -> None:
    """Write a commented sheet for a URDF: every joint and link of the chain, with starting tolerances to replace.

    ROBOT may be example:NAME; where a sheet with sources comes with precision-pin for it, that one is written. It may be
    robot_descriptions:NAME, or a xacro file, whose URDF is written beside the sheet, with its arguments as NAME:=VALUE. The
    sheet runs as it is: precision-pin analyze SHEET.
    """
    from precision_pin.robot import examples, urdf
    from precision_pin.robot.chain import Chain, chain_findings
    from precision_pin.writers.scaffold import kinematic_sheet, scaffold

    robot = _expanded(robot, arguments, package_dirs, force=force)
    if mend_inertia:
        robot = _mended(robot, force=force)
    path = examples.resolve_robot(robot)
    target = Path(examples.starting_sheet(path) if out is None else out)
    to_stdout = out == "-"
    if not to_stdout:
        outputs = Outputs({"--out": out or str(target)})
        outputs.check([str(path)])
        if target.exists() and not force:
            raise OutputError(f"{target} exists; --force overwrites it, --out names another file")
    with noted_inputs() as inputs:
        text, what = (None, ", everything free") if calibration else _shipped(robot, tip, base)
        if text is None:
            read = urdf.read(path, package_dirs=package_dirs)
            if tip is None and len(read.leaves) > 1:
                raise InputError(f"{urdf.ask_for_tip(read)}: {urdf.draft_command(robot, urdf.likeliest_tip(read))}")
            chain = Chain.from_robot(read, tip, base)
            is_named = robot.startswith(examples.ELSEWHERE)
            robot_text = robot if is_named else os.path.relpath(path, Path() if to_stdout else target.parent)
            text = (kinematic_sheet if calibration else scaffold)(chain, robot_text)
            echo_warnings(chain_findings(chain))
            grip = urdf.gripper_joint(chain.robot, chain.tip) if tip is None and base is None else None
            if grip is not None:
                message = (
                    f"the only leaf, {chain.tip!r}, is a finger: the joint {grip.name!r} opens a gripper, and does not move "
                    f"the tool; the last link before it is {grip.parent!r}: {urdf.draft_command(robot, grip.parent)}"
                )
                echo_warnings([Finding("warning", "W_GRIPPER", message, str(path), grip.line)])
            name = chain.robot.name
            alike = f"{examples.PREFIX}{name}"
            if (
                not calibration
                and examples.shipped_sheet(alike) is not None
                and robot != alike
                and name in examples.example_urdfs()
            ):
                what += f" (with sources: precision-pin init {alike}, if this is such an arm)"
    if not to_stdout:
        outputs.refuse_inputs(inputs)
    if to_stdout:
        echo_data(text.removesuffix("\n"))
        return
    write_text(target, text)
    sheet = shlex.quote(str(target))
    following = f"calibrate {sheet} DATA.csv" if calibration else f"analyze {sheet}"
    echo_note(f"wrote {target}{what}; now: precision-pin {following}")


def _expanded(robot: str, arguments: tuple[str, ...], package_dirs: tuple[str, ...], *, force: bool) -> str:
    """Return the robot, converted from xacro to a URDF in this folder if necessary."""
    from precision_pin.robot.examples import DESCRIPTIONS, expand, read_arguments, xacro_source

    given, source = read_arguments(arguments), xacro_source(robot)
    if source is None:
        if given:
            raise InputError.of("E_USAGE", f"{robot} is not written in xacro and takes no arguments")
        return robot
    file, defaults, packages = source
    named = robot.rpartition(":")[2] if robot.startswith(DESCRIPTIONS) else file.name
    target = _new_urdf(named.removesuffix(".xacro").removesuffix(".urdf") + ".urdf", force=force)
    write_text(target, expand(file, defaults | given, packages, package_dirs))
    echo_note(f"wrote {target}, expanded from {file.name}")
    return str(target)


def _mended(robot: str, *, force: bool) -> str:
    """Return the robot, or its copy in this folder with inertias that a body can have."""
    from precision_pin.robot.examples import resolve_robot
    from precision_pin.robot.urdf.reader import mended

    path = resolve_robot(robot)
    text, links = mended(path)
    if not links:
        return robot
    target = _new_urdf(f"{path.stem}.mended.urdf", force=force)
    write_files({target: text})
    echo_note(f"wrote {target}, {path.name} with other inertias of {some([*map(shown, links)], 6)}")
    return str(target)


def _new_urdf(name: str, *, force: bool) -> Path:
    """Return the path of a new URDF in this folder; an existing file needs ``force``."""
    target = Path(name)
    if target.exists() and not force:
        message = f"{target} exists; --force writes it anew, or run precision-pin init {shlex.quote(str(target))}"
        raise OutputError(message)
    Outputs({"--out": str(target)}).check()
    return target


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
