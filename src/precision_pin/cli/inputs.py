"""The robot, sheet and pose of a command line; its outputs: options that name files, and ``--out``, a page or a folder."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from precision_pin.base.errors import Finding, InputError, OutputError
from precision_pin.base.files import noted_inputs, require_writable, resolve, whole_folder, write_text
from precision_pin.cli.options import Options, describe_excess
from precision_pin.cli.terminal import echo_note, echo_warning_lines, echo_warnings
from precision_pin.robot.examples import (
    PAPER,
    require_sheet,
    resolve_robot,
    shipped_sheets,
    similar_file,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from precision_pin.sheet import Sheet

SHEET_SUFFIXES: Final = (".yaml", ".yml")


@dataclass(frozen=True)
class Inputs:
    """The robot and sheet of a command line; ``robot`` is ``None`` if the sheet names it."""

    robot: Path | None
    sheet: Path | None


def find_inputs(arguments: Sequence[str], *, sheet_needed: bool) -> Inputs:
    """Return which argument is the robot and which the sheet; without arguments, the paper's.

    A robot alone goes with the sheet beside it, or the one of its name in the working folder, where ``init`` writes it,
    or, as ``example:NAME``, with the shipped one; stderr says which.
    """
    if not arguments:
        return Inputs(None, shipped_sheets()[PAPER])
    sheets = [text for text in arguments if Path(text).suffix.lower() in SHEET_SUFFIXES]
    robots = [text for text in arguments if text not in sheets]
    if len(robots) > 1 or len(sheets) > 1:
        raise InputError(describe_excess(arguments))
    robot = resolve_robot(robots[0]) if robots else None
    if robot is not None and re.search(rb"^precision-pin:", beginning(robot), re.MULTILINE):
        message = "this is a sheet; name it .yaml or .yml, so that it is taken for one"
        raise InputError.of("E_FILE_KIND", message, str(robot))
    if sheets and beginning(Path(sheets[0])).lstrip().startswith(b"<"):
        message = "this is XML, not a sheet; name a robot .urdf, so that it is taken for one"
        raise InputError.of("E_FILE_KIND", message, str(Path(sheets[0])))
    if sheets:
        return Inputs(robot, Path(sheets[0]))
    assert robot is not None
    if not sheet_needed:
        return Inputs(robot, None)
    sheet, note = require_sheet(robots[0], robot)
    if note:
        echo_note(f"{robots[0]}: with the sheet {note}")
    return Inputs(robot, sheet)


def beginning(path: Path, size: int = 2000) -> bytes:
    """Return the first bytes of a file, none if it cannot be read."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as stream:
            return stream.read(size)
    except (OSError, ValueError):
        return b""


def read_sheet(options: Options, outputs: Outputs | None = None) -> Sheet:
    """Read the sheet and robot of a command line and print the warnings."""
    from precision_pin import sources
    from precision_pin.draws import laws

    echo_warnings([extension.finding for extension in (*sources.extensions(), *laws.extensions()) if extension.error])
    with noted_inputs() as inputs:
        sheet = read_inputs(find_inputs(options["inputs"], sheet_needed=True), options)
    if outputs is not None:
        outputs.refuse_inputs(inputs)
    echo_warnings(sheet.findings, sheet.chain.robot.file)
    sheet = replace(sheet, beyond_limits=options.get("beyond_limits", False))
    return sheet if options.get("datum") is None else sheet.against(options["datum"])


def read_inputs(found: Inputs, options: Options) -> Sheet:
    """Read the sheet of a command line, with its robot if given, and apply ``--set``."""
    from precision_pin.sheet import Overrides, parse_change, read
    from precision_pin.sheet.chain_entry import parse_target

    assert found.sheet is not None
    target = options.get("target")
    if target is not None:
        try:
            parse_target(target)
        except InputError as error:
            raise InputError.of("E_USAGE", f"--{error.findings[0].message}") from None
    if not os.path.lexists(found.sheet):
        similar = similar_file(found.sheet, SHEET_SUFFIXES)
        hint = f"did you mean {similar}?" if similar else "precision-pin init ROBOT.urdf writes one"
        raise InputError.of("E_FILE", f"the sheet does not exist; {hint}", str(found.sheet))
    try:
        changes = [parse_change(text) for text in options["changes"]]
        tip, base, folders = (options[name] for name in ("tip", "base", "package_dirs"))
        ignores, wraps = (options.get(name, False) for name in ("ignores_collisions", "wraps"))
        overrides = Overrides(found.robot, tip, base, folders, target, ignores, wraps)
        return read(found.sheet, overrides=overrides, changes=changes)
    except InputError as error:
        sheet_robot = _other_robot(found) if any(finding.code == "E_NAME" for finding in error.findings) else None
        if sheet_robot is None:
            raise
        message = f"this is a sheet of {sheet_robot}, not of {found.robot}, which has not all of its joints and links"
        raise InputError([Finding("error", "E_OTHER_ROBOT", message, str(found.sheet)), *error.findings]) from None


def _other_robot(inputs: Inputs) -> str | None:
    """Return the robot that a sheet names; None if it is the command line's or unknown."""
    from precision_pin.sheet.text import read_text

    if inputs.sheet is None or inputs.robot is None:
        return None
    try:
        data = read_text(inputs.sheet.read_text(encoding="utf-8-sig"), str(inputs.sheet)).data
        named = str(data["robot"]) if isinstance(data, dict) else ""
        path = resolve_robot(named, inputs.sheet.parent)
        same = path.samefile(inputs.robot) if path.exists() else path.name == inputs.robot.name
    except (InputError, KeyError, OSError, ValueError):
        return None
    return None if same else repr(named)


def echo_findings(findings: Sequence[Finding]) -> None:
    """Print findings to stderr, one line each, without notes."""
    echo_warning_lines(map(str, findings))


def chosen_pose(sheet: Sheet, pose: str | None, q: str | None) -> str | NDArray[np.float64] | None:
    """Return the pose of ``--pose`` or ``--q``: a name, joint values ``(n,)``, or None for the sheet's first."""
    from precision_pin.sheet import parse_pose, pose_remark

    if pose is not None and q is not None:
        raise InputError.of("E_USAGE", "--pose and --q exclude each other")
    if q is None:
        if pose is None and not sheet.poses:
            message = "the sheet has no poses; give joint values with --q, or name some under poses:"
            raise InputError.of("E_POSE", message, sheet.file)
        return pose
    try:
        values = _joint_values(q)
        joint_values = parse_pose(values, sheet.chain)
        remark = pose_remark(values, sheet.chain)
        echo_findings([] if remark is None else [Finding("warning", "W_ANGLE_UNIT", f"--q: {remark}")])
        return joint_values
    except InputError as error:
        raise InputError([Finding("error", "E_POSE", f"--q: {wrong.message}") for wrong in error.findings]) from None


def _joint_values(text: str) -> str | list[str] | dict[str, str]:
    """Return ``--q`` as in a sheet: one text, ``a, b, c`` or ``joint1: a, joint2: b``."""
    entries = [entry.strip() for entry in text.split(",")]
    if ":" not in text:
        return entries if len(entries) > 1 else text
    values: dict[str, str] = {}
    for entry in entries:
        # a name may contain a colon, a value never does
        name, colon, value = (part.strip() for part in entry.rpartition(":"))
        if not colon:
            raise InputError(f"{entry!r} names no joint; write 'joint: value' for each, or values in chain order")
        if name in values:
            raise InputError(f"the joint {name!r} is given twice")
        values[name] = value
    return values


PAGES: Final = (".html", ".htm")
FILES: Final = (
    *PAGES, ".csv", ".jpeg", ".jpg", ".json", ".pdf", ".png", ".svg", ".txt", ".urdf", ".xml", ".yaml", ".yml", ".zip",
)  # fmt: skip
"""Suffixes that identify a file name given as a folder; any others are part of a folder's name."""


@dataclass(frozen=True)
class Outputs:
    """Outputs of a command line: files by option (``-`` for stdout), folder of ``--out``, patterns of its files."""

    files: Mapping[str, str | None] = field(default_factory=dict)
    folder: str | None = None
    names: Sequence[str] = ()

    def check(self, inputs: Iterable[str] = ()) -> None:
        """Reject unwritable outputs, and those that would overwrite inputs, before any work; creates nothing."""
        check_folder_name(self.folder, json="--json" in self.files)
        if self.folder is not None:
            if not self.folder:
                raise click.UsageError("--out names no folder")
            require_writable(self.folder, folder=True)
        seen: dict[str, str] = {}
        for option, name in self._named():
            require_writable(name)
            place = resolve(name)
            if place in seen:
                raise OutputError(f"{seen[place]} and {option} name the same file")
            seen[place] = option
            if self.folder is None:
                continue
            if place == resolve(self.folder):
                raise OutputError(f"{option} and --out name the same place")
            inside = os.path.dirname(place) == resolve(self.folder)
            if inside and (option == "--journal" or self._is_ours(os.path.basename(place))):
                raise OutputError(
                    f"cannot write {name} for {option}: it lies in the folder of --out, whose files are written by name"
                )
        self.refuse_inputs(inputs)

    def refuse_inputs(self, inputs: Iterable[str]) -> None:
        """Reject overwriting an input file under any name, links included."""
        outputs = [name for _, name in self._named()]
        if self.folder is not None:
            with suppress(OSError):
                there = sorted(filter(self._is_ours, os.listdir(self.folder)))
                outputs += [os.path.join(self.folder, name) for name in there]
        for output in outputs:
            for file in inputs:
                if _is_same(output, file):
                    raise OutputError(f"cannot write {output}: it is an input of this command; give another name")

    def _named(self) -> list[tuple[str, str]]:
        return [(option, name) for option, name in self.files.items() if name is not None and name != "-"]

    def _is_ours(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self.names)


@dataclass(frozen=True)
class PageOutput:
    """A page to write: the file of ``--out``, or ``name`` in it if it ends in a slash or is a folder."""

    given: str
    name: str

    @property
    def path(self) -> str:
        """The file."""
        return os.path.join(self.given, self.name) if self._in_folder else self.given

    @property
    def outputs(self) -> Outputs:
        """The same as for any command."""
        if self._in_folder:
            return Outputs(folder=self.given, names=(self.name,))
        return Outputs({"--out": self.given})

    def check(self, inputs: Iterable[str] = ()) -> None:
        """Reject an unwritable page, and one that would overwrite an input, before any work; creates nothing."""
        check_page_name(self.given)
        self.outputs.check(inputs)

    def write(self, text: str) -> None:
        """Write the page atomically."""
        if not self._in_folder:
            write_text(self.given, text)
            return
        with whole_folder(Path(self.given)) as stage:
            write_text(stage / self.name, text)

    @property
    def _in_folder(self) -> bool:
        return self.given.endswith(os.sep) or os.path.isdir(self.given)


def write_folder(
    folder: str, stem: str, result: Any, figures: Mapping[str, Any], texts: Mapping[str, str] | None = None
) -> None:
    """Write a result's JSON, its figures and texts into the folder of ``--out``, all of them or none."""
    from precision_pin.sampling.figures import save

    with whole_folder(Path(folder)) as stage:
        write_text(stage / f"{stem}.json", result.to_json() + "\n")
        for name, figure in figures.items():
            save(figure, stage / name)
        for name, text in (texts or {}).items():
            write_text(stage / name, text)


def check_page_name(out: str) -> None:
    """Reject a page name that promises another format; a folder, a device or a pipe may have any name."""
    if not out:
        raise OutputError("--out names no file; a page is HTML: --out NAME.html")
    is_file = not os.path.lexists(out) or os.path.isfile(out)
    if is_file and not out.endswith(os.sep) and Path(out).suffix.lower() not in PAGES:
        name = Path(out).with_suffix(PAGES[0])
        raise OutputError(f"cannot write {out}: the page is HTML and its name ends in .html; give --out {name}")


def check_folder_name(out: str | None, *, json: bool) -> None:
    """Reject a folder name that looks like a file; ``json``: whether ``--json`` exists and may be meant."""
    if not out or out.endswith(os.sep) or os.path.lexists(out):
        return
    suffix = Path(out).suffix.lower()
    if suffix in FILES:
        meant = f"for the result in one file give --json {out}" if json and suffix == ".json" else None
        meant = meant or f"give --out {Path(out).with_suffix('')}"
        raise OutputError(f"cannot write to the folder {out}: --out takes a folder, and this names a file; {meant}")


def _is_same(file: str, other: str) -> bool:
    with suppress(OSError, ValueError):
        return os.path.samefile(file, other)
    return False
