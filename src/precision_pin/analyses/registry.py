"""The list of all analyses, read by the command line, the report, the package and the documentation."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import Any, Final

from precision_pin.analyses.declaration import Declaration, load
from precision_pin.base.errors import Finding, InputError
from precision_pin.base.extensions import Extension, find_extensions

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
    """Return the declarations of all analyses by name: those of the package, then those that others install."""
    entries = [import_module(folder).DECLARATION for folder in FOLDERS]
    entries += [extension.value for extension in extensions() if not extension.error]
    return {declaration.name: declaration for declaration in entries}


def extensions() -> tuple[Extension, ...]:
    """Return the declarations that other packages install, and those that cannot be used."""
    return find_extensions("analyses", _check)


def _check(declaration: Any) -> str:
    if not isinstance(declaration, Declaration):
        return "it is no precision_pin.analyses.declaration.Declaration"
    is_taken = declaration.name in (import_module(folder).DECLARATION.name for folder in FOLDERS)
    return f"the name {declaration.name!r} is taken" if is_taken else ""


def sheet_keys() -> dict[str, str]:
    """Return the keys of a sheet that analyses declare, with their descriptions."""
    return {key: text for declaration in declarations().values() for key, text in declaration.keys.items()}


SPECIFICATIONS: Final = "precision_pin.statistics.plan:listed_specifications"
"""Check of the shared option ``--spec``."""


def fitting_specs(sheet: Any, check: str = SPECIFICATIONS) -> list[Any]:
    """Return the limits of a sheet that pass the check of a command's ``--spec``; InputError for one that passes none."""
    own = (option.check for one in declarations().values() for option in one.own_options if option.flag == "--spec")
    checks = dict.fromkeys((check, SPECIFICATIONS, *own))
    fitting = []
    for k, spec in enumerate(sheet.specs):
        errors: list[Finding] = []
        for place in checks:
            try:
                load(place)(spec.text)
                break
            except InputError as error:
                errors += error.findings
        else:
            line = None if sheet.contents is None else sheet.contents.text.line(("specs", k))
            raise InputError([replace(errors[0], file=sheet.file, line=line)])
        fitting += [spec] if place == check else []
    return fitting


def find_function(name: str) -> Any:
    """Return the analysis function of this name, or ``None``."""
    places = (declaration.function for declaration in declarations().values())
    return next((load(place) for place in places if place.rpartition(":")[2] == name), None)
