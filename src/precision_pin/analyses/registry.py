"""The list of all analyses, read by the command line, the report, the package and the documentation."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from precision_pin.analyses.declaration import Declaration, load

FOLDERS: list[str] = [
    "precision_pin.analyses.budget",
    "precision_pin.analyses.worst_case",
    "precision_pin.analyses.exact_law",
    "precision_pin.analyses.reliability",
    "precision_pin.analyses.moments",
    "precision_pin.analyses.map",
    "precision_pin.analyses.path",
    "precision_pin.analyses.compare",
    "precision_pin.analyses.compensation",
    "precision_pin.analyses.allocation",
    "precision_pin.analyses.iso9283",
    "precision_pin.analyses.calibration",
]
"""Folders with a ``DECLARATION`` each, in the order of the commands and of the report's sections."""


def declarations() -> dict[str, Declaration]:
    """Return the declarations of all analyses by name."""
    found: list[Declaration] = [import_module(folder).DECLARATION for folder in FOLDERS]
    return {one.name: one for one in found}


def find_function(name: str) -> Any:
    """Return the analysis function of this name, or ``None``."""
    found = (one.function for one in declarations().values() if one.function.rpartition(":")[2] == name)
    return next(map(load, found), None)
