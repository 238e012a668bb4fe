"""Changes of single values of a sheet: what ``--set PATH=VALUE`` and ``ErrorModel.with_`` ask for."""

from __future__ import annotations

import copy
import math
import numbers
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, final

import numpy as np

from precision_pin.base.errors import Finding, InputError, SheetError, UnknownNameError
from precision_pin.base.text_escape import shown
from precision_pin.sheet.schema import ASSUMED, PROVENANCE, source_model
from precision_pin.sheet.text import Path, Text, read_text
from precision_pin.terms.source import Source
from precision_pin.terms.source_set import labels

_SINGLE: Final = ("gravity", "statics", "target", "calibrated", "measurement")
_SECTIONS: Final = ("parameters", "poses", "locked", *_SINGLE)
"""Keys of a sheet besides its sources whose values can be changed."""
_SOURCE: Final = re.compile(r"(?P<label>[\w*]+(?:\[.*?\](?:#[\d*]+)?)?)(?:\.(?P<rest>.+))?")
_STEP: Final = re.compile(r"[.\[]|$")
_ENTRY: Final = re.compile(r"\.?\[?(?P<k>\d+|\*)\]?(?=[.\[]|$)(?P<rest>.*)")


@final
@dataclass(frozen=True)
class Change:
    """A value to set.

    Attributes
    ----------
    path
        Where: ``parameters.a1``, ``KIND[joint2].KEY``, ``payload.mass``; ``*`` stands for anything.
    value
        Text, or lists and mappings of it, as in a sheet.
    origin
        What messages call it.
    """

    path: str
    value: Any
    origin: str


def parse_change(text: str) -> Change:
    """Return the change that ``PATH=VALUE`` asks for."""
    path, equals, value = (part.strip() for part in text.partition("="))
    if not (path and equals and value):
        message = f"--set: 'PATH=VALUE' is expected, such as 'parameters.a1=±0.1 mm', got {text!r}"
        raise InputError([Finding("error", "E_USAGE", message)])
    return Change(path, parse_value(value, f"--set {path}"), f"--set {path}")


def parse_value(value: str, origin: str) -> Any:
    """Return a value as a sheet has it: text, or the lists and mappings of YAML's flow style."""
    try:
        read = read_text(value, origin)
    except SheetError as error:
        raise InputError([replace(finding, line=None) for finding in error.findings]) from None
    if read.findings:
        raise InputError([replace(finding, line=None) for finding in read.findings])
    return read.data


def plain_data(value: object, where: str = "") -> Any:
    """Return numbers, texts, lists and mappings as a sheet has them: every number as text."""
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
    raise InputError(
        f"{where or 'the data'}: text, a number, a list or a mapping is expected, got {shown(repr(value))}"
    )


def change_text(
    text: Text, changes: Sequence[Change], sources: Sequence[Source], kinds: Mapping[str, type[Source]]
) -> Text:
    """Return the contents of a sheet with some values changed, one change after another."""
    data = copy.deepcopy(text.data)
    changed: dict[Path, str] = {}
    known = labels(sources)
    for change in changes:
        paths = list(_paths(data, change, known, kinds))
        for path in paths:
            holder = data
            for key in path[:-1]:
                holder = holder[key]
            holder[path[-1]] = copy.deepcopy(change.value)
            changed.pop(path, None)
            changed[path] = change.origin
    return replace(text, data=data, changes={**text.changes, **changed})


def values_at(text: Text, path: str, sources: Sequence[Source], kinds: Mapping[str, type[Source]]) -> list[Any]:
    """Return the values of a sheet that the path of a change names; arguments and errors as for :func:`change_text`."""
    data = copy.deepcopy(text.data)
    values = []
    for keys in _paths(data, Change(path, None, path), labels(sources), kinds):
        value: Any = data
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else value[key]
        values.append(value)
    return values


def _paths(data: Any, change: Change, known: Sequence[str], kinds: Mapping[str, type[Source]]) -> Iterator[Path]:
    section, _, rest = change.path.partition(".")
    if section in _SECTIONS:
        if rest:
            if section not in data or not isinstance(data[section], dict):
                data[section] = {}
            yield from _walk(data[section], rest, (section,), change, may_add=section != "parameters")
        elif section in _SINGLE:
            yield (section,)
        else:
            raise _wrong(change, f"{section} holds several values; name one, as in {section}.NAME")
        return
    found = _SOURCE.fullmatch(change.path)
    if found is None or not found["rest"]:
        ends = "no value of it is named" if found is not None else "this is no path"
        raise _wrong(change, f"{ends}; paths are such as parameters.a1, KIND[joint2].KEY, payload.mass")
    yield from _source_paths(data, change, found["label"], found["rest"], known, kinds)


def _source_paths(
    data: Any, change: Change, pattern: str, rest: str, known: Sequence[str], kinds: Mapping[str, type[Source]]
) -> Iterator[Path]:
    """Yield the paths in the sources that a pattern of labels names; without brackets it must name one source only."""
    is_kind = "[" not in pattern
    names = [next(iter(entry)) for entry in data["sources"]] if is_kind else list(known)
    chosen = [k for k, name in enumerate(names) if matches(pattern, name)]
    if not chosen:
        error = UnknownNameError("source", pattern, {*known, *_SECTIONS, *(names if is_kind else ())})
        raise _wrong(change, error.findings[0].message, error.code)
    if is_kind and len(chosen) > 1 and "*" not in pattern:
        of = ", ".join(known[k] for k in chosen[:4])
        more = ", …" if len(chosen) > 4 else ""
        raise _wrong(change, f"{len(chosen)} sources are a {pattern}: {of}{more}; {pattern}[*] names all of them")
    settings = [next(iter(data["sources"][k].items())) for k in chosen]
    field = rest[: _STEP.search(rest).start()]  # type: ignore[union-attr]
    has = [field in (ASSUMED, PROVENANCE) or field in source_model(kinds[kind]).model_fields for kind, _ in settings]
    if len({kind for kind, _ in settings}) > 1 and any(has):
        # a pattern of several kinds means those that have the setting
        settings = [entry for entry, is_one in zip(settings, has, strict=True) if is_one]
        chosen = [k for k, is_one in zip(chosen, has, strict=True) if is_one]
    for k, (kind, values) in zip(chosen, settings, strict=True):
        yield from _walk(values, rest, ("sources", k, kind), change, may_add=True)


def _walk(value: Any, rest: str, path: Path, change: Change, *, may_add: bool) -> Iterator[Path]:
    """Yield the paths below a value that the rest of a path names; a key that is not there may be added at the end."""
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


def matches(pattern: str, name: str) -> bool:
    """Return whether a name is that of a pattern, in which ``*`` stands for any characters."""
    first, *others = pattern.split("*")
    if not others:
        return pattern == name
    if not name.startswith(first):
        return False
    at = len(first)
    *middle, last = others
    for part in middle:
        # the first place leaves the most room to the others, so that none has to be tried again
        found = name.find(part, at)
        if found < 0:
            return False
        at = found + len(part)
    return at <= len(name) - len(last) and name.endswith(last)


def _wrong(change: Change, message: str, code: str = "E_PATH") -> InputError:
    return InputError([Finding("error", code, message, change.origin)])
