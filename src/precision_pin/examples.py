"""Where robots that ship with other packages, or with this one, lie on disk."""

from __future__ import annotations

import importlib.metadata
import os
from pathlib import Path
from typing import Final

from precision_pin.errors import Finding, InputError, UnknownNameError, UrdfError

__all__ = ["PAPER_SHEET", "example_urdfs", "resolve_robot", "shipped_sheet", "shipped_sheets"]

PREFIX: Final = "example:"
ROBOTS: Final = Path(__file__).parent / "robots"
SUFFIX: Final = ".errors.yaml"
PAPER_SHEET: Final = ROBOTS / f"4dof{SUFFIX}"
"""The sheet of the paper's arm, beside its URDF."""


def example_urdfs() -> dict[str, Path]:
    """Return the URDFs of the package example-robot-data by short name (``ur5``, ``panda``, …), empty if not installed.

    It has no Python module; its files are found through its metadata. A file that stands empty is left out.
    """
    try:
        distribution = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        return {}
    names: dict[str, Path] = {}
    for file in sorted(distribution.files or (), key=lambda entry: (entry.stem.endswith("_robot"), str(entry))):
        if file.suffix == ".urdf" and "robots" in file.parts:
            path = Path(str(distribution.locate_file(file)))
            if path.is_file() and path.stat().st_size:
                names[file.stem.removesuffix("_robot")] = path
    return names


def resolve_robot(text: str, folder: str | os.PathLike[str] = ".") -> Path:
    """Return the path of a robot: a path relative to ``folder``, or ``example:NAME``.

    Raises
    ------
    UrdfError
        The text is empty.
    InputError
        example-robot-data is not installed.
    UnknownNameError
        It has no such robot.
    """
    if not text.strip():
        raise UrdfError([Finding("error", "E_FILE_MISSING", "the path of the robot is empty")])
    if not text.startswith(PREFIX):
        return Path(folder) / text
    known = example_urdfs()
    if not known:
        raise InputError(
            f"{text}: the package example-robot-data is not installed (pip install 'precision-pin[examples]')"
        )
    name = text.removeprefix(PREFIX)
    if name not in known:
        raise UnknownNameError("example robot", name, known)
    return known[name]


def shipped_sheets() -> dict[str, Path]:
    """Return the sheets that come with this package by the short name of their robot (``4dof``, ``ur5``, …)."""
    return {path.name.removesuffix(SUFFIX): path for path in sorted(ROBOTS.glob(f"*{SUFFIX}"))}


def shipped_sheet(text: str) -> Path | None:
    """Return the sheet that comes with this package for a robot given as ``example:NAME``, None if there is none."""
    return shipped_sheets().get(text.removeprefix(PREFIX)) if text.startswith(PREFIX) else None
