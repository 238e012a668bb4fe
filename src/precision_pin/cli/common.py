"""Options that several commands have, and the robot and sheet that they mean."""

from __future__ import annotations

import os
import re
import shlex
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict, TypeVar, final

import click

from precision_pin.cli.notes import echo_note, quiet_option
from precision_pin.cli.resources import require_resources
from precision_pin.errors import Finding, InputError, PrecisionPinWarning
from precision_pin.inputs.files import noted_inputs
from precision_pin.robot.examples import PAPER_SHEET, resolve_robot, shipped_sheet, similar_file, starting_sheet

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from precision_pin.cli.targets import Outputs
    from precision_pin.sheet import Sheet

__all__ = [
    "ArmOptions",
    "Command",
    "Inputs",
    "OnePoseOptions",
    "SamplingCommand",
    "chain_options",
    "chosen_pose",
    "echo_findings",
    "find_inputs",
    "inputs_argument",
    "model_option",
    "one_pose_options",
    "q_option",
    "read_inputs",
    "read_sheet",
    "seed_option",
    "spec_option",
]

SHEET_SUFFIXES: Final = (".yaml", ".yml")
MOST_LEAVES: Final = 6

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class Command(click.Command):
    """A command that refuses an option given twice where one is meant, and more than one robot and one sheet."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the arguments.

        Raises
        ------
        UsageError
            An option with one value is given more than once, or there are more than two inputs.
        """
        if not ctx.resilient_parsing:
            try:
                order = self.make_parser(ctx).parse_args(list(args))[2]
            except click.UsageError as error:
                error.ctx = error.ctx or ctx
                raise
            for option in dict.fromkeys(order):
                times = order.count(option)
                if isinstance(option, click.Option) and not (option.multiple or option.is_flag) and times > 1:
                    message = f"{option.opts[0]} is given {times} times; {ctx.command_path} takes one"
                    raise click.UsageError(message, ctx)
        left = super().parse_args(ctx, args)
        if len(ctx.params.get("inputs") or ()) > 2:
            # before what an unquoted option value left behind is taken for the value
            raise click.UsageError(_too_many(ctx.params["inputs"]), ctx)
        return left

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command, if the libraries can be loaded; the doctor says what is wrong where they cannot.

        What the package warns of stands among the findings that the command prints itself.
        """
        if self.name != "doctor":
            require_resources()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionPinWarning)
            return super().invoke(ctx)


class SamplingCommand(Command):
    """A command that samples: on a machine where nothing is compiled yet, that begins while the inputs are read."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        from precision_pin.kernel.part_list import begin_compiling

        begin_compiling()
        return super().invoke(ctx)


@final
@dataclass(frozen=True)
class Inputs:
    """The robot and sheet of a command line; ``robot`` is ``None`` where the sheet names it."""

    robot: Path | None
    sheet: Path | None


def chain_options(command: Decorated) -> Decorated:
    """Add the options that cut a chain out of a robot."""
    for option in (
        click.option(
            "--package-dir",
            "package_dirs",
            multiple=True,
            type=click.Path(exists=True, file_okay=False),
            metavar="DIR",
            help="Where ROS packages of meshes lie.",
        ),
        click.option("--base", metavar="LINK", help="The link that stands still, in place of the sheet's or the root."),
        click.option("--tip", metavar="FRAME", help="The end-effector, in place of the sheet's or the only leaf."),
    ):
        command = option(command)
    return command


class ArmOptions(TypedDict):
    """Of which arm: :data:`inputs_argument`, :data:`q_option` and :func:`chain_options`."""

    inputs: tuple[str, ...]
    q: str | None
    tip: str | None
    base: str | None
    package_dirs: tuple[str, ...]


class OnePoseOptions(ArmOptions):
    """Of which arm at which pose: :func:`one_pose_options`."""

    pose: str | None


inputs_argument: Final = click.argument("inputs", nargs=-1, metavar="[ROBOT.urdf] [SHEET.yaml]")
q_option: Final = click.option(
    "--q", metavar="VALUES", help='Joint values: "-90 3 88 -91 deg", "0.1 m, 10 deg" or "joint1: 10 deg, …".'
)
seed_option: Final = click.option("--seed", type=int, default=0, show_default=True, metavar="S", help="64-bit seed.")
model_option: Final = click.option(
    "--model",
    type=click.Choice(["exact", "linear"]),
    default="exact",
    show_default=True,
    help="The displaced chain multiplied out, or superposition as in the paper.",
)
spec_option: Final = click.option(
    "--spec", "specs", multiple=True, metavar='"0.5 mm @ 99.73 %"', help="A limit to keep; repeats."
)


def one_pose_options(command: Decorated) -> Decorated:
    """Add the options of :class:`OnePoseOptions`."""
    pose = click.option("--pose", metavar="NAME", help="One of the sheet's poses; the first if left out.")
    for option in (quiet_option, chain_options, q_option, pose, inputs_argument):
        command = option(command)
    return command


def find_inputs(arguments: Sequence[str], *, sheet_needed: bool) -> Inputs:
    """Return which of the arguments is the robot and which the sheet; with none, the paper's.

    A robot alone goes with the sheet beside it, or the one of its name in the working folder, where ``init`` writes it, or,
    as ``example:NAME``, with the one that comes with this package; stderr says so for all but the first.

    Raises
    ------
    InputError
        More than one of either, one that is not there, or a robot without a sheet where one is needed.
    """
    if not arguments:
        return Inputs(None, PAPER_SHEET)
    sheets = [text for text in arguments if Path(text).suffix.lower() in SHEET_SUFFIXES]
    robots = [text for text in arguments if text not in sheets]
    if len(robots) > 1 or len(sheets) > 1:
        raise InputError(_too_many(arguments))
    robot = resolve_robot(robots[0]) if robots else None
    _refuse_misnamed(robot, Path(sheets[0]) if sheets else None)
    if sheets:
        return Inputs(robot, Path(sheets[0]))
    assert robot is not None
    return Inputs(robot, _sheet_of(robots[0], robot) if sheet_needed else None)


def _refuse_misnamed(robot: Path | None, sheet: Path | None) -> None:
    """Refuse a sheet that would be read as a robot for its name, or a robot that would be read as a sheet."""
    if robot is not None and re.search(rb"^precision-pin:", _beginning(robot), re.MULTILINE):
        message = "this is a sheet; name it .yaml or .yml, so that it is taken for one"
        raise InputError([Finding("error", "E_FILE_KIND", message, str(robot))])
    if sheet is not None and _beginning(sheet).lstrip().startswith(b"<"):
        message = "this is XML, not a sheet; name a robot .urdf, so that it is taken for one"
        raise InputError([Finding("error", "E_FILE_KIND", message, str(sheet))])


def _beginning(path: Path) -> bytes:
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as stream:
            return stream.read(2000)
    except (OSError, ValueError):
        return b""


def _too_many(arguments: Sequence[str]) -> str:
    return (
        f"one robot and one sheet are expected, got {' '.join(arguments)}; a sheet's name ends in .yaml, and values with "
        'blanks need quotes, as in --q "0 90 deg"'
    )


def _sheet_of(name: str, robot: Path) -> Path:
    """Return the sheet that a robot alone goes with; a file that is no URDF is refused as such before any sheet is missed."""
    from precision_pin.robot import urdf

    if not os.path.isfile(robot):
        urdf.read(robot)
    beside, here = robot.with_suffix(".errors.yaml"), Path(starting_sheet(robot))
    if os.path.isfile(beside):
        if os.path.isfile(here) and not here.samefile(beside):
            echo_note(f"{name}: with the sheet beside it, {beside}, not {here} of this folder")
        return beside
    if os.path.isfile(here):
        echo_note(f"{name}: with the sheet of this folder, {here}")
        return here
    shipped = shipped_sheet(name)
    if shipped is not None:
        echo_note(f"{name}: with the sheet that comes with precision-pin, {shipped}")
        return shipped
    leaves = urdf.read(robot).leaves
    branched = f" --tip TIP, with TIP one of {', '.join(leaves[:MOST_LEAVES])}" if len(leaves) > 1 else ""
    raise InputError(
        f"no sheet of error sources for {name}; write one, which is then found by itself: "
        f"precision-pin init {shlex.quote(name)}{branched}"
    )


def read_sheet(
    arguments: Sequence[str],
    tip: str | None,
    base: str | None,
    package_dirs: tuple[str, ...],
    outputs: Outputs | None = None,
) -> Sheet:
    """Read the sheet and robot of a command line and print what there is to warn of.

    Raises
    ------
    InputError
        Anything in them is wrong, or an output would be written over one of the files that were read.
    """
    with noted_inputs() as inputs:
        sheet = read_inputs(find_inputs(arguments, sheet_needed=True), tip, base, package_dirs)
    if outputs is not None:
        outputs.refuse_inputs(inputs)
    echo_findings(sheet.findings)
    return sheet


def read_inputs(found: Inputs, tip: str | None, base: str | None, package_dirs: tuple[str, ...]) -> Sheet:
    """Read the sheet of a command line, with its robot if one is given.

    Raises
    ------
    InputError
        Anything in them is wrong; first that the sheet is of another robot, if it names joints or links that this has not.
    """
    from precision_pin.sheet import Overrides, read

    assert found.sheet is not None
    if not os.path.lexists(found.sheet):
        similar = similar_file(found.sheet, SHEET_SUFFIXES)
        hint = f"did you mean {similar}?" if similar else "precision-pin init ROBOT.urdf writes one"
        raise InputError([Finding("error", "E_FILE", f"the sheet does not exist; {hint}", str(found.sheet))])
    try:
        return read(found.sheet, overrides=Overrides(found.robot, tip, base, package_dirs))
    except InputError as error:
        own = _other_robot(found) if any(finding.code == "E_NAME" for finding in error.findings) else None
        if own is None:
            raise
        message = f"this is a sheet of {own}, not of {found.robot}, which has not all of its joints and links"
        raise InputError([Finding("error", "E_OTHER_ROBOT", message, str(found.sheet)), *error.findings]) from None


def _other_robot(found: Inputs) -> str | None:
    """Return what a sheet names as its robot, None where that is the one of the command line or cannot be known."""
    from precision_pin.sheet.text import read_text

    if found.sheet is None or found.robot is None:
        return None
    try:
        data = read_text(found.sheet.read_text(encoding="utf-8-sig"), str(found.sheet)).data
        named = str(data["robot"]) if isinstance(data, dict) else ""
        own = resolve_robot(named, found.sheet.parent)
        same = own.samefile(found.robot) if own.exists() else own.name == found.robot.name
    except (InputError, KeyError, OSError, ValueError):
        return None
    return None if same else repr(named)


def echo_findings(findings: Sequence[Finding]) -> None:
    """Print findings to stderr, one line each."""
    for finding in findings:
        click.echo(str(finding), err=True)


def chosen_pose(sheet: Sheet, pose: str | None, q: str | None) -> str | NDArray[np.float64] | None:
    """Return which pose ``--pose`` or ``--q`` asks for: a name, joint values ``(n,)``, or None for the sheet's first.

    Raises
    ------
    InputError
        Wrong joint values, or nothing to choose from.
    """
    from precision_pin.sheet import parse_pose, pose_remark

    if pose is not None and q is not None:
        raise InputError([Finding("error", "E_USAGE", "--pose and --q exclude each other")])
    if q is None:
        if pose is None and not sheet.poses:
            message = "the sheet has no poses; give joint values with --q, or name some under poses:"
            raise InputError([Finding("error", "E_POSE", message, sheet.file)])
        return pose
    try:
        values = _joint_values(q)
        found = parse_pose(values, sheet.chain)
        remark = pose_remark(values, sheet.chain)
        echo_findings([] if remark is None else [Finding("warning", "W_ANGLE_UNIT", f"--q: {remark}")])
        return found
    except InputError as error:
        raise InputError([Finding("error", "E_POSE", f"--q: {wrong.message}") for wrong in error.findings]) from None


def _joint_values(text: str) -> str | list[str] | dict[str, str]:
    """Return ``--q`` as a sheet would have it: one text, ``a, b, c`` or ``joint1: a, joint2: b``."""
    entries = [entry.strip() for entry in text.split(",")]
    if ":" not in text:
        return entries if len(entries) > 1 else text
    values: dict[str, str] = {}
    for entry in entries:
        # a name may itself hold a colon, a value never does
        name, colon, value = (part.strip() for part in entry.rpartition(":"))
        if not colon:
            raise InputError(f"{entry!r} names no joint; write 'joint: value' for each, or values in chain order")
        if name in values:
            raise InputError(f"the joint {name!r} stands twice")
        values[name] = value
    return values
