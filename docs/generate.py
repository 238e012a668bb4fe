"""The tables of the pages that are made from the code.

A page holds each between ``<!-- table: NAME -->`` and ``<!-- end -->``. ``python docs/generate.py`` rewrites them all;
a test fails when one is out of step.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import click
from pydantic import BaseModel

from precision_pin.base import units
from precision_pin.base.units import PerEntry, PerJoint, Quantity
from precision_pin.cli.commands import list_commands, list_groups, load_command
from precision_pin.cli.explain import list_codes
from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Law, laws_of_sheets
from precision_pin.sheet.measurement import MeasurementEntry
from precision_pin.sheet.schema import Document, json_schema, used_quantities
from precision_pin.sheet.settings import law_options
from precision_pin.sources import catalogue
from precision_pin.terms.source import Source, setting_meanings

PAGES: Final = Path(__file__).parent
MARKED: Final = re.compile(r"(?<=<!-- table: )(.+?)( -->\n).*?(?=<!-- end -->)", re.DOTALL)

UNIONS: Final = (types.UnionType, typing.Union)
WORDS: Final = {str: "text", int: "whole number", bool: "true or false", Path: "file"}

CORRELATIONS: Final = {
    "parameters": "the names, two or more",
    "correlation": "of two parameters: the correlation of their normal scores",
    "matrix": "of any number: the correlations of their normal scores, row by row",
}


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def keys(model: type[BaseModel] = Document) -> str:
    """Return the keys of a part of a sheet, of its top level if none is given."""
    rows = []
    for name, field in model.model_fields.items():
        default = field.get_default(call_default_factory=True, validated_data={})
        shown = "needed" if field.is_required() else f"`{default}`" if isinstance(default, str) else "none"
        rows.append((f"`{field.alias or name}`", _shape(field.annotation), shown, field.description or ""))
    return table(("key", "takes", "default", "meaning"), rows)


def _shape(hint: Any) -> str:
    """Return in words what a key takes."""
    bare = next(_options(hint))
    match typing.get_origin(bare) or bare:
        case typing.Literal:
            return " or ".join(f"`{choice}`" for choice in typing.get_args(bare))
        case entry if issubclass(entry, BaseModel):
            return "names with values"
        case built_in:
            return {str: "text", dict: "names with values", list: "list"}[built_in]


def correlations() -> str:
    """Return the keys of an entry of ``correlations``."""
    schema = json_schema()["properties"]["correlations"]["items"]
    either = [choice["required"][0] for choice in schema["oneOf"]]
    rows = []
    for name in schema["properties"]:
        needed = "needed" if name in schema["required"] else f"one of {', '.join(f'`{key}`' for key in either)}"
        rows.append((f"`{name}`", needed, CORRELATIONS[name]))
    return table(("key", "needed", "meaning"), rows)


def laws() -> str:
    """Return the laws with the options each takes."""
    rows = []
    for key, law in laws_of_sheets().items():
        taken = ", ".join(f"`{option}`" for option in law_options(key))
        rows.append((f"`{key}`", f"`{_flow(law.form.example)}`", law.form.meaning, taken))
    return table(("law", "example", "meaning", "options"), rows)


def options() -> str:
    """Return the further keys of a law, as the schema has them, with the laws that take each."""
    schema = json_schema()["$defs"]["law"]["properties"]
    keys = laws_of_sheets()
    rows = []
    for option in law_options():
        takers = [f"`{key}`" for key in keys if option in law_options(key)]
        choices = "".join(f"`{choice}`, " for choice in schema[option].get("enum", ()))
        shown = "all" if len(takers) == len(keys) else ", ".join(takers)
        rows.append((f"`{option}`", shown, choices + schema[option]["description"]))
    return table(("key", "of the laws", "meaning"), rows)


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(entry)}" for key, entry in value.items()) + "}"
    return "[" + ", ".join(map(_flow, value)) + "]" if isinstance(value, list) else str(value)


def scopes() -> str:
    """Return the scopes with the documentation that stands under each in the class."""
    text = inspect.getsource(Scope)
    notes = re.findall(r'(\w+) = "\w+"\n\s+"""(.+?)\.?"""', text)
    return table(("scope", "drawn"), [(f"`{Scope[name].value}`", note.lower()) for name, note in notes])


def quantities() -> str:
    """Return the accepted units of every quantity."""
    rows = []
    for quantity in dict.fromkeys((*units.QUANTITIES, *used_quantities(catalogue().values()))):
        accepted = ", ".join(f"`{unit}`" if unit else "(plain number)" for unit in quantity.units)
        rows.append((quantity.name, quantity.si or "-", accepted))
    return table(("quantity", "inside", "accepted units"), rows)


def kinds() -> str:
    """Return every kind of source with the first sentence of its docstring, in the order of the page's sections."""
    found = catalogue()
    sections = re.findall(r"^## `(\w+)`", (PAGES / "sources.md").read_text(encoding="utf-8"), re.MULTILINE)
    order = {name: place for place, name in enumerate(sections)}
    names = sorted(found, key=lambda name: order.get(name, len(order)))
    return table(("kind", "what it is"), [(f"[`{name}`](#{name})", _first_sentence(found[name])) for name in names])


def _first_sentence(kind: type[Source]) -> str:
    paragraph = " ".join((inspect.getdoc(kind) or "").partition("\n\n")[0].split())
    return re.split(r"(?<=\.) ", paragraph)[0].replace("``", "`")


def settings(kind: type[Source]) -> str:
    """Return the settings of a kind of source, in the order of its docstring."""
    hints = typing.get_type_hints(kind, include_extras=True)
    defaults = {field.name: field.default for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    notes = setting_meanings(kind)
    firsts = {name: next(key for key, note in notes.items() if _is_about(name, key, note, notes)) for name in defaults}
    rows = []
    for name in sorted(defaults, key=lambda name: list(notes).index(firsts[name])):
        takes, random = _takes_what(hints[name])
        meaning = notes[name] if firsts[name] == name else f"see `{firsts[name]}`"
        rows.append((f"`{name}`", takes, "yes" if random else "no", _default(defaults[name]), meaning))
    return table(("setting", "takes", "may be random", "default", "meaning"), rows)


def _is_about(name: str, key: str, note: str, notes: dict[str, str]) -> bool:
    """Return whether an entry of a docstring is about a setting: lists it, or mentions one that has no entry."""
    return note is notes[name] if name in notes else f"`{name}`" in note


def _takes_what(hint: Any) -> tuple[str, bool]:
    """Return what a setting takes, in words, and whether it may be random."""
    bare, *notes = typing.get_args(hint) if typing.get_origin(hint) is Annotated else (hint,)
    named = [_quantity_names(note) for note in notes if isinstance(note, Quantity | PerJoint | PerEntry)]
    options = list(_options(bare))
    several = [option for option in options if typing.get_origin(option) is tuple]
    if several:
        entries = typing.get_args(several[0])
        inner = list(_options(entries[0]))
        if not named:
            return "list", False
        if typing.get_origin(inner[0]) is tuple:
            return f"rows of: {named[0]}", False
        fixed = [len(note.quantities) for note in notes if isinstance(note, PerEntry)]
        if fixed:
            return f"{fixed[0]}: {named[0]}", False
        return f"{'one or several' if Ellipsis in entries else str(len(entries))}: {named[0]}", Law in inner
    choices = [
        choice for option in options if typing.get_origin(option) is Literal for choice in typing.get_args(option)
    ]
    if choices:
        return ", ".join(f"`{choice}`" for choice in choices), False
    return named[0] if named else WORDS[options[0]], Law in options


def _options(hint: Any) -> Iterator[Any]:
    """Yield what a union allows, ``None`` left out."""
    for option in typing.get_args(hint) if typing.get_origin(hint) in UNIONS else (hint,):
        if option is not types.NoneType:
            yield option


def _quantity_names(note: Quantity | PerJoint | PerEntry) -> str:
    if isinstance(note, Quantity):
        return note.name
    if isinstance(note, PerEntry):
        return ", ".join(dict.fromkeys(quantity.name for quantity in note.quantities))
    return f"{note.revolute.name}; {note.prismatic.name} where the joint slides"


def _default(value: Any) -> str:
    if value is dataclasses.MISSING:
        return "needed"
    if value is None or value == ():
        return "none"
    if isinstance(value, tuple) and value:
        return " ".join(f"{entry:g}" for entry in value)
    return f"`{value}`" if isinstance(value, str) else f"{value:g}"


def commands() -> str:
    """Return the list of commands."""
    rows = [
        (heading if k == 0 else "", f"[`{name}`](#{name})", text)
        for heading, lines in list_groups().items()
        for k, (name, text) in enumerate(lines.items())
    ]
    return table(("to", "command", "what it does"), rows)


def codes(group: str) -> str:
    """Return what the codes of a group mean."""
    rows = [(", ".join(f"`{name}`" for name in one.names), one.means, one.remedy) for one in list_codes()[group].codes]
    return table(("code", "what it means", "what to do"), rows)


def parameters(name: str) -> str:
    """Return the arguments and options of a command."""
    command = load_command(name)
    rows = []
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            metavar = "" if parameter.is_flag else f" {parameter.metavar or _choices(parameter)}"
            default = f"`{parameter.default}`" if parameter.show_default else "needed" if parameter.required else "-"
            rows.append((f"`{', '.join(parameter.opts)}{metavar}`", default, parameter.help or ""))
        else:
            many = "optional" if parameter.nargs == -1 or not parameter.required else "needed"
            rows.append((f"`{parameter.metavar}`", many, "argument"))
    return table(("option", "default", "meaning"), rows) if rows else "No options.\n"


def _choices(option: click.Option) -> str:
    return "|".join(option.type.choices) if isinstance(option.type, click.Choice) else option.type.name


TABLES: Final[dict[str, dict[str, Callable[[], str]]]] = {
    "sheet.md": {
        "keys": keys,
        "measurement": partial(keys, MeasurementEntry),
        "laws": laws,
        "correlations": correlations,
        "options": options,
        "scopes": scopes,
        "units": quantities,
    },
    "sources.md": {"kinds": kinds} | {name: partial(settings, kind) for name, kind in catalogue().items()},
    "command-line.md": {"commands": commands} | {name: partial(parameters, name) for name in list_commands()},
    "codes.md": {name: partial(codes, name) for name in list_codes()},
}
"""Every generated table by page and name."""


def spliced(page: str, text: str) -> str:
    """Return a page's text with its tables as the code has them."""
    made = TABLES[page]
    return MARKED.sub(lambda match: f"{match[1]}{match[2]}{made[match[1]]()}", text)


def main() -> None:
    """Rewrite the tables of every page."""
    for page in TABLES:
        path = PAGES / page
        path.write_text(spliced(page, path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
