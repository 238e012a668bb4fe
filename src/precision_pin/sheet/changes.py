"""Changes of single values of a sheet, for ``--set PATH=VALUE`` and ``ErrorModel.with_``."""

from __future__ import annotations

import copy
import math
import numbers
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from precision_pin.base import units
from precision_pin.base.errors import InputError, SheetError, UnknownNameError, shown
from precision_pin.sheet.schema import ASSUMED, PROVENANCE, StatedNumber, source_model, stated_numbers
from precision_pin.sheet.text import Path, Text, read_text
from precision_pin.terms.bound_source import labels
from precision_pin.terms.source import Source

_SINGLE: Final = ("gravity", "statics", "target", "calibrated", "measurement")
_SECTIONS: Final = ("parameters", "poses", "locked", *_SINGLE)
"""Keys of a sheet, besides its sources, with values that can be changed."""
_SOURCE: Final = re.compile(r"(?P<label>[\w*]+(?:\[.*?\](?:#[\d*]+)?)?)(?:\.(?P<rest>.+))?")
_STEP: Final = re.compile(r"[.\[]|$")
_ENTRY: Final = re.compile(r"\.?\[?(?P<k>\d+|\*)\]?(?=[.\[]|$)(?P<rest>.*)")


@dataclass(frozen=True)
class Change:
    """A value to set.

    Attributes:
        path: ``parameters.a1``, ``KIND[joint2].KEY``, ``payload.mass``; ``*`` stands for anything. ``KIND[joint2]`` is
            the source's only number, or its only one with a law if its unit fits no other.
        value: Text, or lists and mappings of it, as in a sheet.
        origin: Its name in messages.
    """

    path: str
    value: Any
    origin: str


def parse_change(text: str) -> Change:
    """Parse ``PATH=VALUE``."""
    path, equals, value = (part.strip() for part in text.partition("="))
    if not (path and equals and value):
        message = f"--set: 'PATH=VALUE' is expected, such as 'parameters.a1=±0.1 mm', got {text!r}"
        raise InputError.of("E_USAGE", message)
    return Change(path, parse_value(value, f"--set {path}"), f"--set {path}")


def parse_value(value: str, origin: str) -> Any:
    """Return a value as in a sheet: text, or lists and mappings in YAML's flow style."""
    try:
        read = read_text(value, origin)
        if read.findings:
            raise SheetError(read.findings)
    except SheetError as error:
        raise InputError([replace(finding, line=None) for finding in error.findings]) from None
    return read.data


def plain_data(value: object, where: str = "") -> Any:
    """Return numbers, texts, lists and mappings as in a sheet: every number as text."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, numbers.Real) and math.isfinite(float(value)):
        return repr(int(value)) if isinstance(value, numbers.Integral) else repr(float(value))
    if isinstance(value, Mapping):
        wrong = next((key for key in value if not isinstance(key, str)), None)
        if wrong is not None:
            raise InputError(f"{where or 'the data'}: a key must be text, got {shown(repr(wrong))}")
        return {key: plain_data(entry, f"{where}.{key}".lstrip(".")) for key, entry in value.items()}
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, bytes | bytearray):
        return [plain_data(entry, f"{where}[{k}]") for k, entry in enumerate(value)]
    message = f"{where or 'the data'}: text, a number, a list or a mapping is expected, got {shown(repr(value))}"
    raise InputError(message)


def change_text(
    text: Text, changes: Sequence[Change], sources: Sequence[Source], kinds: Mapping[str, type[Source]]
) -> Text:
    """Return the contents of a sheet after some changes, applied in turn."""
    data = copy.deepcopy(text.data)
    changed: dict[Path, str] = {}
    known = labels(sources)
    for change in changes:
        paths = list(_paths(data, change, known, kinds))
        for path in paths:
            if path[0] == "parameters" and len(path) == 2 and _is_quantity(change.value):
                # as a source's setting this would be a constant, but a parameter exists for its law
                raise _wrong(
                    change,
                    f"{shown(change.value)} may be a tolerance or a constant; write '{change.path}=±{change.value}' or "
                    f"'{change.path}={{fixed: {change.value}}}'",
                    "E_INPUT",
                )
            holder = data
            for key in path[:-1]:
                holder = holder[key]
            holder[path[-1]] = copy.deepcopy(change.value)
            changed.pop(path, None)
            changed[path] = change.origin
    return replace(text, data=data, changes={**text.changes, **changed})


def values_at(text: Text, path: str, sources: Sequence[Source], kinds: Mapping[str, type[Source]]) -> dict[str, Any]:
    """Return the values of a sheet that a path names, by their full paths; a source's path names all its numbers."""
    data = copy.deepcopy(text.data)
    known = labels(sources)
    values = {}
    for keys in _paths(data, Change(path, None, path), known, kinds, one_number=False):
        value: Any = data
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else value[key]
        values[_written(keys, known)] = value
    return values


def source_of(path: str) -> str:
    """Return the part of a path that names sources, empty if it names none."""
    found = _SOURCE.fullmatch(path)
    return "" if found is None or path.partition(".")[0] in _SECTIONS else found["label"]


def _written(keys: Path, known: Sequence[str]) -> str:
    first, *others = (known[int(keys[1])], *keys[3:]) if keys[0] == "sources" else keys
    return str(first) + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in others)


def _paths(
    data: Any, change: Change, known: Sequence[str], kinds: Mapping[str, type[Source]], *, one_number: bool = True
) -> Iterator[Path]:
    section, _, rest = change.path.partition(".")
    if section in _SECTIONS:
        if rest:
            if section not in data or not isinstance(data[section], dict):
                data[section] = {}
            yield from _walk(data[section], rest, (section,), change, may_add=section != "parameters")
        elif section in _SINGLE:
            yield (section,)
        else:
            entries = data.get(section)
            names = list(entries) if isinstance(entries, dict) and entries else ["NAME"]
            listed = ", ".join(f"{section}.{name}" for name in names)
            raise _wrong(change, f"{section} holds several values; name one: {listed}")
        return
    found = _SOURCE.fullmatch(change.path)
    if found is None:
        raise _wrong(change, "this is no path; paths are such as parameters.a1, KIND[joint2].KEY, payload.mass")
    chosen = _sources_of(data, change, found["label"], known)
    if found["rest"]:
        yield from _source_paths(data, change, chosen, found["rest"], kinds)
        return
    for k in chosen:
        kind, values = next(iter(data["sources"][k].items()))
        stated = stated_numbers(kinds[kind], values)
        for path in [_only_number(change, known[k], stated)] if one_number else stated:
            yield from _walk(values, path, ("sources", k, kind), change, may_add=False)


def _only_number(change: Change, label: str, stated: Mapping[str, StatedNumber]) -> str:
    """Return the path, below the source, of the number that a source's path alone means."""
    # it is the only number, or the only one with a law if its unit fits no other
    laws = [path for path, one in stated.items() if one.is_random]
    if len(laws) == 1:
        others = {unit for path, one in stated.items() if path != laws[0] for unit in one.units}
        if not others & stated[laws[0]].units:
            return laws[0]
    if len(stated) != 1:
        named = ", ".join(f"{label}.{path}" for path in stated)
        numbers = f"{len(stated)} numbers; name one: {named}" if stated else "no number; name a setting of it"
        raise _wrong(change, f"{label} has {numbers}")
    return next(iter(stated))


def _sources_of(data: Any, change: Change, pattern: str, known: Sequence[str]) -> list[int]:
    """Return the positions of the sources matching a pattern of labels; without brackets it must match only one."""
    is_kind = "[" not in pattern
    names = [next(iter(entry)) for entry in data["sources"]] if is_kind else list(known)
    chosen = [k for k, name in enumerate(names) if matches(pattern, name)]
    if not chosen:
        if pattern in data.get("parameters", {}):
            raise _wrong(change, f"{pattern} is a parameter: its path is parameters.{change.path}")
        error = UnknownNameError("source", pattern, {*known, *_SECTIONS, *(names if is_kind else ())})
        raise _wrong(change, error.findings[0].message, error.code)
    if is_kind and len(chosen) > 1 and "*" not in pattern:
        of = ", ".join(known[k] for k in chosen[:4])
        more = ", …" if len(chosen) > 4 else ""
        raise _wrong(change, f"{len(chosen)} sources are a {pattern}: {of}{more}; {pattern}[*] names all of them")
    return chosen


def _source_paths(
    data: Any, change: Change, chosen: Sequence[int], rest: str, kinds: Mapping[str, type[Source]]
) -> Iterator[Path]:
    settings = [next(iter(data["sources"][k].items())) for k in chosen]
    field = rest[: _STEP.search(rest).start()]  # type: ignore[union-attr]
    has = [field in (ASSUMED, PROVENANCE) or field in source_model(kinds[kind]).model_fields for kind, _ in settings]
    if len({kind for kind, _ in settings}) > 1 and any(has):
        # a pattern that matches several kinds means those with the setting
        settings = [entry for entry, is_one in zip(settings, has, strict=True) if is_one]
        chosen = [k for k, is_one in zip(chosen, has, strict=True) if is_one]
    for k, (kind, values) in zip(chosen, settings, strict=True):
        yield from _walk(values, rest, ("sources", k, kind), change, may_add=True)


def _walk(value: Any, rest: str, path: Path, change: Change, *, may_add: bool) -> Iterator[Path]:
    """Yield the paths below a value that the rest of a path names; a missing last key may be added."""
    if isinstance(value, dict):
        # the longest key first: names of parameters may hold dots and brackets
        for end in sorted({step.start() for step in _STEP.finditer(rest)} - {0}, reverse=True):
            keys = [key for key in value if matches(rest[:end], key)]
            if keys:
                for key in keys:
                    yield from _below(value[key], rest[end:], (*path, key), change)
                return
        if may_add and "*" not in rest and "[" not in rest and "." not in rest:
            yield (*path, rest)
            return
        named = rest[: min(step.start() for step in _STEP.finditer(rest) if step.start())]
        error = UnknownNameError("key", named, value)
        raise _wrong(change, error.findings[0].message, error.code)
    entry = _ENTRY.fullmatch(rest) if isinstance(value, list) else None
    if entry is None:
        raise _wrong(change, f"{'.'.join(map(str, path[-1:]))} is {shown(str(value))}, which has no {shown(rest)}")
    if entry["k"] != "*" and int(entry["k"]) >= len(value):
        raise _wrong(change, f"{path[-1]} has {len(value)} entries, counted from 0; there is no {entry['k']}")
    for k in range(len(value)) if entry["k"] == "*" else [int(entry["k"])]:
        yield from _below(value[k], entry["rest"], (*path, k), change)


def _below(value: Any, rest: str, path: Path, change: Change) -> Iterator[Path]:
    if rest:
        yield from _walk(value, rest.removeprefix("."), path, change, may_add=True)
    else:
        yield path


def _is_quantity(value: object) -> bool:
    try:
        return isinstance(value, str) and bool(units.split(value)[1])
    except InputError:
        return False


def matches(pattern: str, name: str) -> bool:
    """Return whether a name matches a pattern, in which ``*`` stands for any characters."""
    first, *others = pattern.split("*")
    if not others:
        return pattern == name
    if not name.startswith(first):
        return False
    at = len(first)
    *middle, last = others
    for part in middle:
        # the first match leaves the most room for the others, so no backtracking is needed
        found = name.find(part, at)
        if found < 0:
            return False
        at = found + len(part)
    return at <= len(name) - len(last) and name.endswith(last)


def _wrong(change: Change, message: str, code: str = "E_PATH") -> InputError:
    return InputError.of(code, message, change.origin)
