"""What several commands share: which robot and sheet, options, files to write, progress."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict, TypeVar, final

import click

from precision_pin.cli.interrupts import raise_if_interrupted
from precision_pin.errors import Finding, InputError, OutputError
from precision_pin.examples import PAPER_SHEET, resolve_robot, shipped_sheet

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from precision_pin.sheet import Sheet

__all__ = [
    "ArmOptions",
    "Inputs",
    "OnePoseOptions",
    "chain_options",
    "chosen_pose",
    "compile_sampler",
    "echo_data",
    "echo_findings",
    "find_inputs",
    "inputs_argument",
    "model_option",
    "one_pose_options",
    "progress_bar",
    "q_option",
    "read_sheet",
    "require_writable",
    "seed_option",
    "spec_option",
    "whole_folder",
    "write_text",
]

Command = TypeVar("Command", bound=Callable[..., Any])


@final
@dataclass(frozen=True)
class Inputs:
    """The robot and sheet of a command line; ``robot`` is ``None`` where the sheet names it."""

    robot: Path | None
    sheet: Path | None


def chain_options(command: Command) -> Command:
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


def one_pose_options(command: Command) -> Command:
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


def echo_data(text: str) -> None:
    """Print data on stdout; that its reader has gone, as ``head`` does, is no error.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    try:
        click.echo(text)
    except OSError as error:
        # what is left in the buffer must not be tried again when the interpreter ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            raise OutputError(f"cannot write to the standard output: {error.strerror}") from None


def echo_findings(findings: Sequence[Finding]) -> None:
    """Print findings to stderr, one line each."""
    for finding in findings:
        click.echo(str(finding), err=True)


def require_writable(path: Path, *, folder: bool = False) -> None:
    """Refuse a place to write to before any work is done; makes nothing.

    Raises
    ------
    OutputError
        It is a directory where a file is meant (or the reverse), or cannot be written to.
    """
    target = Path(os.path.realpath(path))
    if not folder and os.path.isdir(target):
        raise OutputError(f"cannot write {path}: it is a folder")
    if folder and os.path.lexists(target) and not os.path.isdir(target):
        raise OutputError(f"cannot write to the folder {path}: it is a file")
    if not folder and os.path.exists(target) and not os.path.isfile(target):
        return  # a device or a pipe
    if not folder and os.path.isfile(target) and not os.access(target, os.W_OK):
        raise OutputError(f"cannot write {path}: the file is read-only")
    home = target if folder else target.parent
    while folder and not os.path.lexists(home):
        home = home.parent
    if not os.path.isdir(home):
        what = "is not a folder" if os.path.lexists(home) else "does not exist"
        raise OutputError(f"cannot write {path}: {home} {what}")
    if not os.access(home, os.W_OK | os.X_OK):
        raise OutputError(f"cannot write {path}: the folder {home} is not writable")


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all; through a link, and straight into a device or a pipe.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    target = Path(os.path.realpath(path))
    straight = os.path.exists(target) and not os.path.isfile(target)
    part = target if straight else target.with_name(f".precision-pin-{os.getpid()}.part")
    try:
        # surrogates, which stand for bytes of a file's name that are not UTF-8, become what JSON has for them
        part.write_text(text, encoding="utf-8", errors="backslashreplace")
        if not straight:
            part.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        if not straight:
            with suppress(OSError):
                part.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a folder for files that appear in ``path`` together once all of them are written, or not at all.

    Raises
    ------
    OutputError
        They cannot be written.
    """
    target = Path(os.path.realpath(path))
    missing = [folder for folder in (target, *target.parents) if not os.path.lexists(folder)]
    done = False
    try:
        target.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target, prefix=".precision-pin-", suffix=".part") as stage:
            yield Path(stage)
            for file in sorted(Path(stage).iterdir()):
                if (target / file.name).is_dir():
                    raise OutputError(f"cannot write {path / file.name}: it is a folder")
            for file in sorted(Path(stage).iterdir()):
                file.replace(target / file.name)
        done = True
    except OSError as error:
        raise OutputError(f"cannot write to the folder {path}: {error.strerror or error}") from None
    finally:
        if not done:
            with suppress(OSError):
                for folder in missing:
                    folder.rmdir()


def compile_sampler() -> None:
    """Compile the sampler where that was never done on this machine, and say so."""
    from precision_pin import kernel

    if not kernel.is_compiled():
        click.echo("compiling the sampler, once on this machine: some 20 s", err=True)
        kernel.warm_up()


@contextmanager
def progress_bar(total: int, what: str, unit: str = "samples") -> Iterator[Callable[[int], None]]:
    """Show progress on a terminal; yields what takes the steps, each of which an interrupt ends."""
    from precision_pin.progress_bar import progress

    with progress(total, what, unit=unit) as step:

        def advance(count: int) -> None:
            raise_if_interrupted()
            step(count)

        yield advance


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
