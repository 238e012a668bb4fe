"""The analyses, a line each: the folder whose ``DECLARATION`` says what belongs to one.

The command line, the report, the package's names and the documentation read this list and know no analysis by name.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from precision_pin.analyses.declaration import Declaration, load

__all__ = ["FOLDERS", "declarations", "find_function"]

FOLDERS: list[str] = [
    "precision_pin.analyses.budget",
    "precision_pin.analyses.worst_case",
    "precision_pin.analyses.exact_law",
    "precision_pin.analyses.reliability",
    "precision_pin.analyses.moments",
]
"""In the order of the commands and of the report's sections."""


def declarations() -> dict[str, Declaration]:
    """Return every analysis's declaration by its name."""
    found: list[Declaration] = [import_module(folder).DECLARATION for folder in FOLDERS]
    return {one.name: one for one in found}


def find_function(name: str) -> Any:
    """Return the analysis's function of this name, ``None`` if there is none."""
    for one in declarations().values():
        if one.function.rpartition(":")[2] == name:
            return load(one.function)
    return None
