"""Robots written in xacro, expanded to URDF by the package xacrodoc; they run what their authors wrote, as Python does."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Final

from precision_pin.base.errors import Finding, InputError
from precision_pin.base.text_escape import one_line
from precision_pin.robot.examples import DESCRIPTIONS, description

SUFFIX: Final = ".xacro"
_ARGUMENT: Final = re.compile(r"(\w+):=(.*)", re.DOTALL)


def xacro_source(robot: str) -> tuple[Path, dict[str, str], dict[str, str]] | None:
    """Return the file of a robot written in xacro, its own arguments, and the folders of its packages; None for others.

    ``robot`` is a path that ends in ``.xacro``, or ``robot_descriptions:NAME``.
    """
    if robot.startswith(DESCRIPTIONS):
        found = description(robot.removeprefix(DESCRIPTIONS))
        if not hasattr(found, "XACRO_PATH"):
            return None
        return Path(found.XACRO_PATH), getattr(found, "XACRO_ARGS", {}), getattr(found, "XACRO_PACKAGE_PATHS", {})
    return (Path(robot), {}, {}) if robot.endswith(SUFFIX) else None


def read_arguments(texts: Sequence[str]) -> dict[str, str]:
    """Return xacro arguments written as ``name:=value``; `InputError` for another text."""
    found = {}
    for text in texts:
        match = _ARGUMENT.fullmatch(text)
        if match is None:
            raise InputError([Finding("error", "E_USAGE", f"{text!r} is no xacro argument; write NAME:=VALUE")])
        found[match[1]] = match[2]
    return found


def expand(file: Path, arguments: Mapping[str, str], packages: Mapping[str, str]) -> str:
    """Return the text of the URDF that a xacro file makes, mesh names with the xacro's folder.

    Raises:
        InputError: The package xacrodoc is not installed, or the file cannot be expanded.
    """
    try:
        import xacrodoc
    except ImportError:
        message = "xacro needs the package xacrodoc, which is not installed (pip install 'precision-pin[robots]')"
        raise InputError([Finding("error", "E_XACRO", message, os.fspath(file))]) from None
    path = file.resolve()
    if not path.is_file():
        raise InputError([Finding("error", "E_FILE_MISSING", "there is no such file", os.fspath(file))])
    try:
        xacrodoc.packages.update_package_cache(dict(packages))
        with chdir(path.parent):  # files that it includes are named from its folder
            text: str = xacrodoc.XacroDoc.from_file(
                path, subargs=dict(arguments), resolve_packages=False
            ).to_urdf_string()
    except Exception as error:  # noqa: BLE001 - a xacro file can raise anything
        message = one_line(f"xacro cannot be expanded: {type(error).__name__}: {error}")
        raise InputError([Finding("error", "E_XACRO", message, os.fspath(file))]) from None
    return text
