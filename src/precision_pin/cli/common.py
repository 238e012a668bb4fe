"""What several commands share: which robot and sheet, options, files to write, progress."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, final

import click

from precision_pin.errors import Finding, InputError, OutputError
from precision_pin.examples import PAPER_SHEET, resolve_robot

__all__ = [
    "Inputs",
    "chain_options",
    "echo_findings",
    "find_inputs",
    "joint_values",
    "progress_bar",
    "require_writable",
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


def find_inputs(arguments: Sequence[str], *, sheet_needed: bool) -> Inputs:
    """Return which of the arguments is the robot and which the sheet; with none, the paper's.

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
    beside = robot.with_suffix(".errors.yaml")
    if beside.is_file():
        return Inputs(robot, beside)
    raise InputError(
        f"no sheet of error sources for {robots[0]}; write one with: precision-pin init {robots[0]} "
        f"(or name it; {beside.name} beside the robot is found by itself)"
    )


def echo_findings(findings: Sequence[Finding]) -> None:
    """Print findings to stderr, one line each."""
    for finding in findings:
        click.echo(str(finding), err=True)


def require_writable(path: Path, *, folder: bool = False) -> None:
    """Refuse a place to write to before any work is done.

    Raises
    ------
    OutputError
        It is a directory where a file is meant (or the reverse), or cannot be written to.
    """
    if folder:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot write to the folder {path}: {error.strerror}") from None
    elif path.is_dir():
        raise OutputError(f"cannot write {path}: it is a folder")
    home = path if folder else path.parent
    if not home.is_dir():
        raise OutputError(f"cannot write {path}: the folder {home} does not exist")
    if not os.access(home, os.W_OK):
        raise OutputError(f"cannot write {path}: the folder {home} is not writable")


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise OutputError(f"cannot write {path}: {error.strerror}") from None


@contextmanager
def progress_bar(total: int, what: str) -> Iterator[Callable[[int], None]]:
    """Show progress with an estimate on stderr once a second has passed; yields what takes the steps."""
    from tqdm import tqdm

    with tqdm(total=total, desc=what, unit=" samples", unit_scale=True, delay=0.7, file=sys.stderr, leave=False) as bar:

        def advance(count: int) -> None:
            bar.update(count)

        yield advance


def joint_values(text: str) -> str | list[str] | dict[str, str]:
    """Return ``--q`` as a sheet would have it: one text, ``a, b, c`` or ``joint1: a, joint2: b``."""
    if ":" in text:
        pairs = [entry.partition(":") for entry in text.split(",")]
        return {name.strip(): value.strip() for name, _, value in pairs}
    return [entry.strip() for entry in text.split(",")] if "," in text else text
