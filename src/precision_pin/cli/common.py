"""What several commands share: their options, and which robot and sheet are meant."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict, TypeVar, final

import click

from precision_pin.errors import Finding, InputError, PrecisionPinWarning
from precision_pin.examples import PAPER_SHEET, resolve_robot, shipped_sheet

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from precision_pin.sheet import Sheet

__all__ = [
    "ArmOptions",
    "Command",
    "Inputs",
    "OnePoseOptions",
    "chain_options",
    "chosen_pose",
    "echo_findings",
    "find_inputs",
    "inputs_argument",
    "model_option",
    "one_pose_options",
    "q_option",
    "read_sheet",
    "seed_option",
    "spec_option",
]

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


@final
class Command(click.Command):
    """A command that refuses an option given twice where one is meant, instead of taking the last in silence."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the arguments.

        Raises
        ------
        UsageError
            An option with one value is given more than once.
        """
        if not ctx.resilient_parsing:
            order = self.make_parser(ctx).parse_args(list(args))[2]
            for option in dict.fromkeys(order):
                times = order.count(option)
                if isinstance(option, click.Option) and not (option.multiple or option.is_flag) and times > 1:
                    message = f"{option.opts[0]} is given {times} times; {ctx.command_path} takes one"
                    raise click.UsageError(message, ctx)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """Run the command; what the package warns of stands among the findings that it prints itself."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionPinWarning)
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
            "--package-dir", "package_dirs", multiple=True, metavar="DIR", help="Where ROS packages of meshes lie."
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
    for option in (chain_options, q_option, pose, inputs_argument):
        command = option(command)
    return command


def find_inputs(arguments: Sequence[str], *, sheet_needed: bool) -> Inputs:
    """Return which of the arguments is the robot and which the sheet; with none, the paper's.

    A robot alone goes with the sheet beside it, or, as ``example:NAME``, with the one that comes with this package, which
    is then named on stderr.

    Raises
    ------
    InputError
        More than one of either, or a robot without a sheet where one is needed.
    """
    if not arguments:
        return Inputs(None, PAPER_SHEET)
    sheets = [text for text in arguments if Path(text).suffix.lower() in (".yaml", ".yml")]
    robots = [text for text in arguments if text not in sheets]
    if len(robots) > 1 or len(sheets) > 1:
        raise InputError(f"one robot and one sheet are expected, got {' '.join(arguments)}")
    robot = resolve_robot(robots[0]) if robots else None
    if sheets:
        return Inputs(robot, Path(sheets[0]))
    assert robot is not None
    if not sheet_needed:
        return Inputs(robot, None)
    if not os.path.isfile(robot):
        raise InputError([Finding("error", "E_FILE", "the robot is not there, or is no file", str(robot))])
    beside = robot.with_suffix(".errors.yaml")
    if beside.is_file():
        return Inputs(robot, beside)
    shipped = shipped_sheet(robots[0])
    if shipped is not None:
        click.echo(f"{robots[0]}: with the sheet that comes with precision-pin, {shipped}", err=True)
        return Inputs(robot, shipped)
    raise InputError(
        f"no sheet of error sources for {robots[0]}; write one with: precision-pin init {robots[0]} "
        f"(or name it; {beside.name} beside the robot is found by itself)"
    )


def read_sheet(arguments: Sequence[str], tip: str | None, base: str | None, package_dirs: tuple[str, ...]) -> Sheet:
    """Read the sheet and robot of a command line and print what there is to warn of.

    Raises
    ------
    InputError
        Anything in them is wrong.
    """
    from precision_pin.sheet import Overrides, read

    found = find_inputs(arguments, sheet_needed=True)
    assert found.sheet is not None
    sheet = read(found.sheet, overrides=Overrides(found.robot, tip, base, package_dirs))
    echo_findings(sheet.findings)
    return sheet


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
    from precision_pin.sheet import parse_pose

    if pose is not None and q is not None:
        raise InputError([Finding("error", "E_USAGE", "--pose and --q exclude each other")])
    if q is None:
        if pose is None and not sheet.poses:
            message = "the sheet has no poses; give joint values with --q"
            raise InputError([Finding("error", "E_POSE", message, sheet.file)])
        return pose
    try:
        return parse_pose(_joint_values(q), sheet.chain)
    except InputError as error:
        raise InputError([Finding("error", "E_POSE", f"--q: {found.message}") for found in error.findings]) from None


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
