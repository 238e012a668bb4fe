"""Locations of robots shipped with this package or others, and of those written in xacro.

The package xacrodoc expands the latter to URDF; it runs code of the file's authors, as Python does.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.metadata
import os
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from contextlib import chdir, redirect_stdout, suppress
from functools import cache
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Final

from precision_pin.base.errors import InputError, InternalError, UnknownNameError, one_line, shown

PREFIX: Final = "example:"
DESCRIPTIONS: Final = "robot_descriptions:"
ELSEWHERE: Final = (PREFIX, DESCRIPTIONS)
"""Prefixes of robots of other packages, instead of a path."""
_ENDING: Final = "_description"
ROBOTS: Final = Path(__file__).parents[1] / "robots"
PAPER: Final = "4dof"
SHIPPED: Final = (PAPER, "panda", "so100", "so101", "ur10e", "ur3e", "ur5", "ur5e", "xarm7")
"""Short names of the robots that this package has a sheet for."""
SUFFIX: Final = ".errors.yaml"
ROBOT_SUFFIXES: Final = (".urdf", ".xml")
XACRO_SUFFIX: Final = ".xacro"
_EXAMPLES: Final = f"{os.sep}example-robot-data{os.sep}"
PAPER_SHEET: Final = ROBOTS / f"{PAPER}{SUFFIX}"
"""The sheet of the paper's arm."""


def example_urdfs() -> dict[str, Path]:
    """Return the URDFs of the package example-robot-data by short name (``ur5``, ``panda``, …), empty if not installed."""
    try:
        distribution = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        return {}
    return dict(_listed_urdfs(str(distribution.locate_file(""))))


@cache
def _listed_urdfs(folder: str) -> dict[str, Path]:
    """Return the URDFs that the package installed in a folder; empty files are left out."""
    # the package has no Python module; its metadata lists the files
    package_files = importlib.metadata.distribution("example-robot-data").files or ()
    files = [file for file in package_files if file.suffix == ".urdf" and "robots" in file.parts]
    files.sort(key=lambda file: (file.stem.endswith("_robot"), str(file)))
    named_files = [(file.stem.removesuffix("_robot"), Path(folder, file)) for file in files]
    return {name: path for name, path in named_files if path.is_file() and path.stat().st_size}


def own_urdfs() -> dict[str, Path]:
    """Return the URDFs of this package by short name (``4dof``, ``ur5e``, …)."""
    return {path.stem: path for path in sorted(ROBOTS.glob(f"*{ROBOT_SUFFIXES[0]}"))}


def resolve_robot(text: str, folder: str | os.PathLike[str] = ".") -> Path:
    """Return the path of a robot: relative to ``folder``, or by ``example:NAME`` or ``robot_descriptions:NAME``."""
    if not text.strip():
        raise InputError.of("E_FILE_MISSING", "the path of the robot is empty")
    if text.startswith(PREFIX):
        return _example(text.removeprefix(PREFIX))
    if text.startswith(DESCRIPTIONS):
        module = description(text.removeprefix(DESCRIPTIONS))
        if not hasattr(module, "URDF_PATH"):
            message = f"{text} is written in xacro; precision-pin init {text} [NAME:=VALUE]... writes it as a URDF"
            raise InputError.of("E_XACRO", message)
        return Path(module.URDF_PATH)
    path = Path(folder) / text
    suggestion = None if os.path.lexists(path) or text.endswith(os.sep) else _suggest_robot(path)
    if suggestion is not None:
        # the finding has no file, so that a sheet can add its own file and line
        raise InputError.of("E_FILE_MISSING", f"there is no file {text!r}; did you mean {suggestion}?")
    return path


def _example(name: str) -> Path:
    shipped = own_urdfs()
    if name in shipped:
        return shipped[name]
    if not (examples := example_urdfs()):
        package = "example-robot-data"
        raise InputError(f"{PREFIX}{name}: the package {package} is not installed (pip install {package})")
    if name in examples:
        return examples[name]
    paths = shipped | examples
    if not name:
        raise InputError.of("E_NAME", f"no example robot named ''; valid: {', '.join(paths)}")
    folded_name = name.casefold()
    candidates = [path for path in paths if folded_name in path.casefold()]
    if not candidates or folded_name in map(str.casefold, paths):
        raise UnknownNameError("example robot", name, paths)
    message = f"no example robot named {name!r}; did you mean one of {', '.join(PREFIX + path for path in candidates)}?"
    raise InputError.of("E_NAME", message)


def description(name: str) -> ModuleType:
    """Return the module of the package robot_descriptions for a robot, which is downloaded on first use.

    Raises `InputError` if the package is not installed, has no such URDF, or cannot download it.
    """
    try:
        descriptions = importlib.import_module("robot_descriptions").DESCRIPTIONS
    except ImportError:
        message = f"{DESCRIPTIONS}{name}: the package robot_descriptions is not installed (pip install 'precision-pin[robots]')"
        raise InputError(message) from None
    robots = [key.removesuffix(_ENDING) for key, about in descriptions.items() if about.has_urdf]
    robot_name = name.removesuffix(_ENDING)
    if robot_name not in robots:
        raise UnknownNameError("robot of robot_descriptions", robot_name, robots)
    try:
        # the package prints what it clones; stdout is for data
        with redirect_stdout(sys.stderr):
            return importlib.import_module(f"robot_descriptions.{robot_name}{_ENDING}")
    except Exception as error:  # noqa: BLE001 - the package downloads with git, which can fail in many ways
        what = f"{DESCRIPTIONS}{robot_name} cannot be downloaded by the package robot_descriptions"
        raise InputError(f"{what}: {one_line(str(error))}") from None


def _suggest_robot(path: Path) -> str | None:
    name = path.name.casefold().removesuffix(ROBOT_SUFFIXES[0]).removesuffix("_robot")
    examples = {example.casefold(): PREFIX + example for example in example_urdfs()}
    if name in examples:
        return examples[name]
    close = difflib.get_close_matches(name, examples, n=1, cutoff=0.65) if not path.suffix and len(name) < 64 else []
    return similar_file(path, ROBOT_SUFFIXES) or (examples[close[0]] if close else None)


def similar_file(path: Path, suffixes: tuple[str, ...]) -> str | None:
    """Return the file in the same folder, with one of the suffixes, named most like a missing one."""
    stems: dict[str, str] = {}
    with suppress(OSError, ValueError), os.scandir(path.parent) as entries:
        for entry in islice(entries, 1000):
            if entry.name.endswith(suffixes) and entry.is_file():
                stems[os.path.splitext(entry.name)[0]] = entry.name
    stem = os.path.splitext(path.name)[0]
    close = difflib.get_close_matches(stem, sorted(stems), n=1) if len(stem) < 256 else []
    return str(path.with_name(stems[close[0]])) if close else None


def starting_sheet(robot: Path) -> str:
    """Return the name of the sheet that ``init`` writes for a robot."""
    return robot.stem.removesuffix("_robot") + SUFFIX


def shipped_sheets() -> dict[str, Path]:
    """Return the sheets of this package by the short name of their robot (``4dof``, ``ur5``, …).

    Raises `InternalError` if one is missing: another sheet would answer for another robot.
    """
    sheets = {name: ROBOTS / f"{name}{SUFFIX}" for name in SHIPPED}
    if missing := [path.name for path in sheets.values() if not path.is_file()]:
        raise InternalError(f"precision-pin is installed without its sheet {missing[0]}; reinstall it")
    return sheets


def shipped_sheet(text: str) -> Path | None:
    """Return this package's sheet for a robot given as ``example:NAME``, None if there is none."""
    return shipped_sheets().get(text.removeprefix(PREFIX)) if text.startswith(PREFIX) else None


def find_sheet(name: str, robot: Path) -> tuple[Path | None, str]:
    """Return the sheet for a robot given alone, None if there is none, and which it is."""
    beside, here = robot.with_suffix(".errors.yaml"), Path(starting_sheet(robot))
    if os.path.isfile(beside) and beside.parent != ROBOTS:
        is_other = os.path.isfile(here) and not here.samefile(beside)
        return beside, f"beside it, {beside}" + (f", not {here} of this folder" if is_other else "")
    if os.path.isfile(here):
        return here, f"of this folder, {here}"
    shipped = shipped_sheet(name)
    return shipped, "" if shipped is None else f"that comes with precision-pin, {shipped.name}"


def require_sheet(name: str, robot: Path) -> tuple[Path, str]:
    """Return the sheet for a robot as :func:`find_sheet` does; raise if there is none, or if the file is no URDF."""
    from precision_pin.robot import urdf

    if not os.path.isfile(robot):
        urdf.read(robot)
    sheet, note = find_sheet(name, robot)
    if sheet is not None:
        return sheet, note
    read = urdf.read(robot)
    leaves = read.leaves
    command, others = f"precision-pin init {shlex.quote(name)}", ""
    if len(leaves) > 1:
        command = urdf.draft_command(name, tip := urdf.likeliest_tip(read))
        others = f" (or another tip: {', '.join([leaf for leaf in leaves if leaf != tip][:6])})"
    message = f"no sheet of error sources for {name}; write one, which is then found by itself: {command}{others}"
    raise InputError(message)


def named_briefly(text: str) -> str:
    """Return a text with ``example:NAME`` for example robots' paths, and this package's paths shortened."""
    if _EXAMPLES in text:
        for name, path in example_urdfs().items():
            text = text.replace(str(path), PREFIX + name)
    return text.replace(f"{ROBOTS.parents[1]}{os.sep}", "")


def xacro_source(robot: str) -> tuple[Path, dict[str, str], dict[str, str]] | None:
    """Return file, arguments and package folders of a robot in xacro, given as a path or by name; None for others."""
    if robot.startswith(DESCRIPTIONS):
        module = description(robot.removeprefix(DESCRIPTIONS))
        if not hasattr(module, "XACRO_PATH"):
            return None
        return Path(module.XACRO_PATH), getattr(module, "XACRO_ARGS", {}), getattr(module, "XACRO_PACKAGE_PATHS", {})
    return (Path(robot), {}, {}) if robot.endswith(XACRO_SUFFIX) else None


def read_arguments(texts: Sequence[str]) -> dict[str, str]:
    """Return xacro arguments written as ``name:=value``; raise `InputError` for other texts."""
    arguments = {}
    for text in texts:
        match = re.fullmatch(r"(\w+):=(.*)", text, re.DOTALL)
        if match is None:
            raise InputError.of("E_USAGE", f"{text!r} is no xacro argument; write NAME:=VALUE")
        arguments[match[1]] = match[2]
    return arguments


def expand(file: Path, arguments: Mapping[str, str], packages: Mapping[str, str], folders: Sequence[str]) -> str:
    """Return the URDF that a xacro file makes, mesh names with the xacro's folder.

    Packages are given by name, or are searched like those of meshes, in ``folders`` first, and last where ROS has them.
    """
    try:
        from xacrodoc import XacroDoc
        from xacrodoc import packages as finder
    except ImportError:
        message = "xacro needs the package xacrodoc, which is not installed (pip install 'precision-pin[xacro]')"
        raise InputError.of("E_XACRO", message, os.fspath(file)) from None
    # imported late: it takes 0.15 s, and completion and help only list robots
    from precision_pin.robot.urdf.meshes import locate_package

    path = file.resolve()
    if not path.is_file():
        raise InputError.of("E_FILE_MISSING", "there is no such file", os.fspath(file))
    package_dirs, find_package = [Path(folder).resolve() for folder in folders], finder.get_path

    def locate(name: str) -> str:
        return os.fspath(packages.get(name) or locate_package(name, path.parent, package_dirs) or find_package(name))

    try:
        finder.reset()
        finder.get_path = locate
        with chdir(path.parent):  # included files are named relative to its folder
            expanded = XacroDoc.from_file(path, subargs=dict(arguments), resolve_packages=False)
            return str(expanded.to_urdf_string())
    except Exception as error:  # noqa: BLE001 - a xacro file can raise anything
        message = one_line(f"xacro cannot be expanded: {type(error).__name__}: {error}")
        if missing := re.search(r"Package not found: (\S+)", str(error)):
            message = f"the package {shown(missing[1])} of the xacro is not found; give its folder (--package-dir)"
        raise InputError.of("E_XACRO", message, os.fspath(file)) from None
    finally:
        finder.get_path = find_package
