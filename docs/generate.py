"""The tables of the pages that are made from the code.

A page holds each between ``<!-- table: NAME -->`` and ``<!-- end -->``. ``python docs/generate.py`` rewrites them all;
a test fails when one is out of step. What a command prints as well (``--help``, ``explain``, ``schema``), a page has in
full on the site alone: Sphinx fills ``<!-- built: NAME -->``, and puts more in the place of some tables.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import types
import typing
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import click
from pydantic import BaseModel

from precision_pin.base import units
from precision_pin.base.units import PerEntry, PerJoint, Quantity
from precision_pin.cli.explain import list_codes
from precision_pin.cli.program import list_commands, list_groups, load_command
from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import laws_of_sheets
from precision_pin.sheet.measurement import MeasurementEntry
from precision_pin.sheet.schema import document_model, json_schema, used_quantities
from precision_pin.sheet.settings import law_options
from precision_pin.sources import catalogue
from precision_pin.sources.published import published
from precision_pin.terms.source import Source, setting_fields, setting_meanings, takes_law

PAGES: Final = Path(__file__).parent
MARKED: Final = re.compile(r"(?<=<!-- table: )(.+?)( -->\n).*?(?=<!-- end -->)", re.DOTALL)

UNIONS: Final = (types.UnionType, typing.Union)
WORDS: Final = {str: "text", int: "whole number", bool: "true or false", Path: "file"}


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def key_names(model: type[BaseModel] | None = None) -> str:
    """Return the names of the keys of a sheet's top level, those that are needed first."""
    fields = {
        field.alias or name: field.is_required() for name, field in (model or document_model()).model_fields.items()
    }
    first, then = ([f"`{name}`" for name, is_needed in fields.items() if is_needed is which] for which in (True, False))
    return f"{', '.join(first)} needed; {', '.join(then)}.\n"


def keys(model: type[BaseModel] | None = None) -> str:
    """Return the keys of a part of a sheet, of its top level if none is given."""
    rows = []
    for name, field in (model or document_model()).model_fields.items():
        default = field.get_default(call_default_factory=True, validated_data={})
        shown = (
            ", needed"
            if field.is_required()
            else f", default `{default}`"
            if default and isinstance(default, str)
            else ""
        )
        rows.append((f"`{field.alias or name}` ({_shape(field.annotation)}{shown})", field.description or ""))
    return items(rows)


def _shape(hint: Any) -> str:
    """Return in words what a key takes."""
    bare = next(_options(hint))
    match typing.get_origin(bare) or bare:
        case typing.Annotated:
            return _shape(typing.get_args(bare)[0])
        case typing.Literal:
            return " or ".join(f"`{choice}`" for choice in typing.get_args(bare))
        case entry if issubclass(entry, BaseModel):
            return "names with values"
        case built_in:
            return {str: "text", dict: "names with values", list: "list"}[built_in]


def laws() -> str:
    """Return the laws."""
    rows = [(f"`{key}`", f"`{_flow(law.form.example)}`", law.form.meaning) for key, law in laws_of_sheets().items()]
    return table(("law", "example", "meaning"), rows)


def options() -> str:
    """Return the further keys of a law, as the schema has them, with the laws that take each."""
    schema = json_schema()["$defs"]["law"]["properties"]
    keys = laws_of_sheets()
    rows = []
    for option in law_options():
        takers = [f"`{key}`" for key in keys if option in law_options(key)]
        choices = "".join(f"`{choice}`, " for choice in schema[option].get("enum", ()))
        shown = "all laws" if len(takers) == len(keys) else ", ".join(takers)
        rows.append((f"`{option}` of {shown}", choices + schema[option]["description"]))
    return items(rows)


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(entry)}" for key, entry in value.items()) + "}"
    return "[" + ", ".join(map(_flow, value)) + "]" if isinstance(value, list) else str(value)


def scopes() -> str:
    """Return the scopes with the documentation that stands under each in the class."""
    text = inspect.getsource(Scope)
    notes = re.findall(r'(\w+) = "\w+"\n\s+"""(.+?)\.?"""', text)
    return items((f"`{Scope[name].value}`", note.lower()) for name, note in notes)


def quantities() -> str:
    """Return the accepted units of every quantity."""
    rows = []
    for quantity in dict.fromkeys((*units.QUANTITIES, *used_quantities(catalogue().values()))):
        rows.append((quantity.name, quantity.si or "-", _accepted(list(quantity.units))))
    return table(("quantity", "inside", "accepted units"), rows)


def _accepted(names: list[str]) -> str:
    """Return units in a row; those that are every quotient of some over some others as these two."""
    halves = [name.split("/") for name in names]
    if all(len(half) == 2 for half in halves):
        over, under = (list(dict.fromkeys(half)) for half in zip(*halves, strict=True))
        if min(len(over), len(under)) > 1 and sorted(names) == sorted(f"{a}/{b}" for a in over for b in under):
            return f"{_accepted(over)} over {_accepted(under)}"
    return ", ".join(f"`{name}`" if name else "(plain number)" for name in names)


def kinds() -> str:
    """Return links to every kind of source, in the order of the page's sections."""
    return ", ".join(f"[`{name}`](#{name})" for name, _ in _in_order()) + "\n"


def _in_order() -> list[tuple[str, type[Source]]]:
    found = catalogue()
    sections = re.findall(r"^## `(\w+)`", (PAGES / "sources.md").read_text(encoding="utf-8"), re.MULTILINE)
    return sorted(found.items(), key=lambda entry: [*sections, entry[0]].index(entry[0]))


def setting_names(kind: type[Source]) -> str:
    """Return the names of the settings of a kind of source, those that are needed first."""
    needed = {field.key: field.default is dataclasses.MISSING for field in setting_fields(kind)}
    first, then = ([f"`{name}`" for name, is_needed in needed.items() if is_needed is which] for which in (True, False))
    return f"Settings: {', '.join(first) or 'none'} needed; {', '.join(then) or 'no others'}.\n"


def settings(kind: type[Source]) -> str:
    """Return the settings of a kind of source, in the order of its docstring; those alike in one line."""
    hints = typing.get_type_hints(kind, include_extras=True)
    defaults = {field.name: field.default for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    notes = setting_meanings(kind)
    told = {
        name: name if name in notes else next(key for key in notes if f"`{name}`" in notes[key]) for name in defaults
    }
    alike: dict[str, tuple[dict[str, None], dict[str, None]]] = {}
    for name in sorted(defaults, key=lambda name: list(notes).index(told[name])):
        names, takes = alike.setdefault(_told_once(kind, notes[told[name]]), ({}, {}))
        shown: tuple[str, ...] = (_takes_what(hints[name]), _default(defaults[name]))
        words = _choices_of(hints[name])
        if words and all(f"`{word}`" in notes[told[name]] for word in words):
            shown = shown[1:]  # the meaning has the words
        names[f"`{name.removesuffix('_')}`"] = takes[", ".join(filter(None, shown))] = None
    rows = (
        (f"{', '.join(names)} ({'; '.join(filter(None, takes))})".removesuffix(" ()"), note)
        for note, (names, takes) in alike.items()
    )
    return items((key, "" if note == "The joint." else note) for key, note in rows)


def _told_once(kind: type[Source], note: str) -> str:
    """Return a meaning, or where it stands if an earlier kind on the page has the same of more than a few words."""
    name, first = next((name, one) for name, one in _in_order() if note in setting_meanings(one).values())
    return note if first is kind or len(note) < 60 else f"as of [`{name}`](#{name})"


def _takes_what(hint: Any) -> str:
    """Return what a setting takes, in words; ± before what may be random."""
    bare, *notes = typing.get_args(hint) if typing.get_origin(hint) is Annotated else (hint,)
    named = [_quantity_names(note) for note in notes if isinstance(note, Quantity | PerJoint | PerEntry)]
    options = list(_options(bare))
    several = [option for option in options if typing.get_origin(option) is tuple]
    random = "± " if takes_law(bare) else ""
    if several:
        entries = typing.get_args(several[0])
        if not named:
            return "list"
        if typing.get_origin(next(_options(entries[0]))) is tuple:
            return f"rows of: {named[0]}"
        fixed = next((len(note.quantities) for note in notes if isinstance(note, PerEntry)), len(entries))
        return f"{random}{named[0]}, {fixed if fixed > 2 else 'one or several'}"
    if choices := _choices_of(hint):
        return ", ".join(f"`{choice}`" for choice in choices)
    return random + (named[0] if named else WORDS.get(options[0], "keys with values"))


def _choices_of(hint: Any) -> list[str]:
    """Return the words of which a setting takes one."""
    bare = typing.get_args(hint)[0] if typing.get_origin(hint) is Annotated else hint
    literals = [option for option in _options(bare) if typing.get_origin(option) is Literal]
    return [choice for literal in literals for choice in typing.get_args(literal)]


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
    return f"{note.revolute.name}/{note.prismatic.name}"


def _default(value: Any) -> str:
    """Return a default, nothing for none."""
    if value is dataclasses.MISSING:
        return "needed"
    if value is None or value == ():
        return ""
    entries = value if isinstance(value, tuple) else (value,)
    return f"default {' '.join(f'`{entry}`' if isinstance(entry, str) else f'{entry:g}' for entry in entries)}"


def published_figures(key: Literal["gear", "servo"]) -> str:
    """Return the gears or servos that a sheet can name, those of one document together."""
    parts = []
    for document in dict.fromkeys(entry.document for entry in published(key).values()):
        entries = {name: entry.settings for name, entry in published(key).items() if entry.document == document}
        header = list(dict.fromkeys(setting for one in entries.values() for setting in one))
        rows = [(f"`{name}`", *(one[setting] for setting in header)) for name, one in entries.items()]
        parts.append(f"{document[0].upper()}{document[1:]}:\n\n{table((key, *(f'`{one}`' for one in header)), rows)}")
    return "\n".join(parts)


def commands() -> str:
    """Return the commands and what each does, in groups."""
    groups = list_groups().items()
    return "\n".join(
        f"{heading}:\n\n" + items((f"[`{name}`](#{name})", text) for name, text in lines.items())
        for heading, lines in groups
    )


def codes() -> str:
    """Return what every code means and what to do about it, in groups."""
    parts = []
    for group in list_codes().values():
        rows = [(", ".join(f"`{name}`" for name in one.names), one.means, one.remedy) for one in group.codes]
        parts.append(f"## {group.title}\n\n{table(('code', 'what it means', 'what to do'), rows)}")
    return "\n".join(parts)


def _options_of(name: str) -> list[tuple[str, str]]:
    """Return the options of a command: how each is written, and what it means."""
    found = []
    for option in load_command(name).params:
        if isinstance(option, click.Option):
            metavar = "" if option.is_flag else f" {option.metavar or _choices(option)}"
            default = f" Default `{option.default}`." if option.show_default and option.default != "" else ""
            meaning = f"{option.help}{default}{' Needed.' * option.required}"
            found.append((f"`{', '.join(option.opts)}{metavar}`", meaning))
    return found


def _choices(option: click.Option) -> str:
    return "|".join(option.type.choices) if isinstance(option.type, click.Choice) else option.type.name


@cache
def _shared() -> list[tuple[str, str]]:
    """Return the options that commands have in common word for word; of two texts for one name the more frequent."""
    every = Counter(option for name in list_commands() for option in _options_of(name))
    most = {option[0]: option for option, count in reversed(every.most_common()) if count > 1}
    return [option for option in every if option in most.values()]


GROUPS: Final = {
    "poses": ("--pose", "--all-poses", "--q", "--step", "--trajectory", "--columns", "--grid", "--approach"),
    "robot": (
        "--tip",
        "--base",
        "--package-dir",
        "--set",
        "--ignore-collisions",
        "--wrap",
        "--all-warnings",
        "--quiet",
    ),
    "workers": ("--processes", "--dask", "--journal", "--resume"),
    "instrument": (
        *("--kind", "--std", "--attitude-std", "--point", "--point-free", "--base-free"),
        *("--visible-from", "--anchor"),
    ),
    "files": ("--map", "--path", "--compensate", "--calibrate"),
}
"""Shared options that most commands take together."""


def shared() -> str:
    """Return the options of several commands, in groups."""
    texts = {_name(key): (key, text) for key, text in _shared()}
    grouped = {one for names in GROUPS.values() for one in names}
    groups = {**GROUPS, "each by its name": tuple(name for name in texts if name not in grouped)}
    return "\n".join(f"**{group}**\n\n{items(texts[name] for name in names)}" for group, names in groups.items())


def _name(option: str) -> str:
    return option.strip("`").split()[0]


def items(rows: Iterable[tuple[str, str]]) -> str:
    """Return a list of names and what they mean."""
    return "".join(f"- {name}: {text}\n" if text else f"- {name}\n" for name, text in rows)


def parameters(name: str) -> str:
    """Return a command's arguments, the options that it shares, by group or name, and its own options."""
    argument = "".join(f" {one.metavar}" for one in load_command(name).params if not isinstance(one, click.Option))
    common = [_name(key) for key, text in _options_of(name) if (key, text) in _shared()]
    taken = [group for group, names in GROUPS.items() if set(names) <= set(common)]
    single = [f"`{one}`" for one in common if not any(one in GROUPS[group] for group in taken)]
    own = [option for option in _options_of(name) if option not in _shared()]
    told = f" with [{', '.join(taken)}](#options-of-several-commands)" if taken else ""
    more = f"{', ' if taken else ' with '}{', '.join(single)}" if single else ""
    return f"`precision-pin {name}{argument}`{told}{more}\n" + (f"\n{items(own)}" if own else "")


TABLES: Final[dict[str, dict[str, Callable[[], str]]]] = {
    "sheet.md": {
        "keys": key_names,
        "laws": laws,
        "options": options,
        "scopes": scopes,
        "units": quantities,
    },
    "catalogue.md": {"gears": partial(published_figures, "gear"), "servos": partial(published_figures, "servo")},
    "sources.md": {"kinds": kinds} | {name: partial(setting_names, kind) for name, kind in catalogue().items()},
}
"""Every generated table by page and name."""

BUILT: Final[dict[str, dict[str, Callable[[], str]]]] = {
    "codes.md": {"codes": codes},
    "sheet.md": {"keys": keys, "measurement": partial(keys, MeasurementEntry)},
    "sources.md": {name: partial(settings, kind) for name, kind in catalogue().items()},
    "command-line.md": {"commands": commands, "shared": shared}
    | {name: partial(parameters, name) for name in list_commands()},
}
"""What the site has and the file has not, by page and name."""


def spliced(page: str, text: str) -> str:
    """Return a page's text with its tables as the code has them."""
    made = TABLES[page]
    return MARKED.sub(lambda match: f"{match[1]}{match[2]}{made[match[1]]()}", text)


def built(page: str, text: str) -> str:
    """Return a page's text as the site has it."""
    made = BUILT.get(page, {})
    text = re.sub(
        r"<!-- table: (.+?) -->\n.*?<!-- end -->\n",
        lambda match: made[match[1]]() if match[1] in made else match[0],
        text,
        flags=re.DOTALL,
    )
    return re.sub(r"<!-- built: (.+?) -->\n", lambda match: made[match[1]](), text)


def main() -> None:
    """Rewrite the tables of every page."""
    for page in TABLES:
        path = PAGES / page
        path.write_text(spliced(page, path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
