"""The list of all analyses, read by the command line, the report, the package and the documentation."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from importlib.abc import InspectLoader
from importlib.util import find_spec
from typing import Any, Final

from precision_pin.analyses.declaration import SHARED_OPTIONS, Declaration, load
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
    "precision_pin.analyses.stiffness",
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
    return f"the name {declaration.name!r} is taken" if is_taken else _absent(declaration)


def _absent(declaration: Declaration) -> str:
    """Return which part of a declaration does not exist; nothing is imported, because ``--help`` lists the analyses."""
    unknown = [word for word in declaration.options if isinstance(word, str) and word not in SHARED_OPTIONS]
    if unknown:
        return f"no shared options are named {unknown[0]!r}; those are {', '.join(SHARED_OPTIONS)}"
    named = {option if isinstance(option, str) else option.argument for option in declaration.options}
    if not (named & {"json", "json_path"} and named & {"out", "plot"}):
        return "its options lack 'json', or one of 'out' and 'plot'"
    table_module, _, table = declaration.table_name.rpartition(":")
    outputs = [f"{table_module or 'table'}:{table}", "figure:figure"] if declaration.prepare is None else []
    outputs += ["figure:content"] if declaration.heading else []
    places = (f"{declaration.outputs}.{output}" for output in outputs)
    for place in (declaration.function, declaration.result, *places):
        module, _, name = place.partition(":")
        spec = find_spec(module)
        if spec is None:
            return f"there is no module {module!r}"
        # the names of its code are read without running it
        code = spec.loader.get_code(module) if isinstance(spec.loader, InspectLoader) else None
        if code is not None and name not in code.co_names:
            return f"the module {module!r} has no {name!r}"
    return ""


def sheet_keys() -> dict[str, str]:
    """Return the keys of a sheet that analyses declare, with their descriptions."""
    return {key: text for declaration in declarations().values() for key, text in declaration.keys.items()}


SPECIFICATIONS: Final = "precision_pin.statistics.plan:listed_specifications"
"""Check of the shared option ``--spec``."""


def fitting_specs(sheet: Any, check: str = SPECIFICATIONS) -> list[Any]:
    """Return the limits of a sheet that pass the check of a command's ``--spec``; InputError for one that passes none."""
    spec_checks = (
        option.check
        for declaration in declarations().values()
        for option in declaration.own_options
        if option.flag == "--spec"
    )
    checks = dict.fromkeys((check, SPECIFICATIONS, *spec_checks))
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
