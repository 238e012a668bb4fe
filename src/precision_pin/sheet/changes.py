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
"""Keys of a sheet, besides its sources, with values that can be changed; the single ones also as a whole."""
# label of sources and path below; end of a key of a path; index of a list and path below
_SOURCE: Final = re.compile(r"(?P<label>[\w*]+(?:\[.*?\](?:#[\d*]+)?)?)(?:\.(?P<rest>.+))?")
_STEP: Final = re.compile(r"[.\[]|$")
_ENTRY: Final = re.compile(r"\.?\[?(?P<k>\d+|\*)\]?(?=[.\[]|$)(?P<rest>.*)")


@dataclass(frozen=True)
class Change:
    """A value to set.

    Attributes:
        path: ``parameters.a1``, ``KIND[joint2].KEY``, ``payload.mass``; ``*`` matches anything. ``KIND[joint2]`` is the
            source's only number, or the only random one if no other has its unit.
        value: Text, or lists and mappings of text, as in a sheet.
        origin: Name of the change in messages.
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
    origins: dict[Path, str] = {}
    source_labels = labels(sources)
    for change in changes:
        paths = list(_paths(data, change, source_labels, kinds))
        for path in paths:
            if path[0] == "parameters" and len(path) == 2 and _is_quantity(change.value):
                # as a source's setting this would be a constant, but parameters are random
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
            origins.pop(path, None)
            origins[path] = change.origin
    return replace(text, data=data, changes={**text.changes, **origins})


def values_at(text: Text, path: str, sources: Sequence[Source], kinds: Mapping[str, type[Source]]) -> dict[str, Any]:
    """Return the values at a path of a sheet, by their full paths; the path of a source selects all its numbers."""
    data = copy.deepcopy(text.data)
    source_labels = labels(sources)
    values = {}
    for keys in _paths(data, Change(path, None, path), source_labels, kinds, one_number=False):
        value: Any = data
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else value[key]
        values[_format_path(keys, source_labels)] = value
    return values


def source_of(path: str) -> str:
    """Return the part of a path that names sources, or an empty text."""
    match = _SOURCE.fullmatch(path)
    return "" if match is None or path.partition(".")[0] in _SECTIONS else match["label"]


def _format_path(keys: Path, source_labels: Sequence[str]) -> str:
    first, *others = (source_labels[int(keys[1])], *keys[3:]) if keys[0] == "sources" else keys
    return str(first) + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in others)


def _paths(
    data: Any, change: Change, labels: Sequence[str], kinds: Mapping[str, type[Source]], *, one_number: bool = True
) -> Iterator[Path]:
    section, _, remainder = change.path.partition(".")
    if section in _SECTIONS:
        if remainder:
            if section not in data or not isinstance(data[section], dict):
                data[section] = {}
            yield from _walk(data[section], remainder, (section,), change, may_add=section != "parameters")
        elif section in _SINGLE:
            yield (section,)
        else:
            entries = data.get(section)
            names = list(entries) if isinstance(entries, dict) and entries else ["NAME"]
            examples = ", ".join(f"{section}.{name}" for name in names)
            raise _wrong(change, f"{section} holds several values; name one: {examples}")
        return
    match = _SOURCE.fullmatch(change.path)
    if match is None:
        raise _wrong(change, "not a valid path; examples: parameters.a1, KIND[joint2].KEY, payload.mass")
    indices = _sources_of(data, change, match["label"], labels)
    if match["rest"]:
        yield from _source_paths(data, change, indices, match["rest"], kinds)
        return
    for k in indices:
        kind, values = next(iter(data["sources"][k].items()))
        numbers = stated_numbers(kinds[kind], values)
        for path in [_only_number(change, labels[k], numbers)] if one_number else numbers:
            yield from _walk(values, path, ("sources", k, kind), change, may_add=False)


def _only_number(change: Change, label: str, values: Mapping[str, StatedNumber]) -> str:
    """Return the path, below the source, of the number selected by the path of the source alone."""
    # the only number, or the only random one if no other has its unit
    laws = [path for path, number in values.items() if number.is_random]
    if len(laws) == 1:
        other_units = {unit for path, number in values.items() if path != laws[0] for unit in number.units}
        if not other_units & values[laws[0]].units:
            return laws[0]
    if len(values) != 1:
        choices = ", ".join(f"{label}.{path}" for path in values)
        numbers = f"{len(values)} numbers; name one: {choices}" if values else "no number; name a setting of it"
        raise _wrong(change, f"{label} has {numbers}")
    return next(iter(values))


def _sources_of(data: Any, change: Change, pattern: str, labels: Sequence[str]) -> list[int]:
    """Return the positions of the sources matching a pattern of labels; without brackets it must match one source."""
    is_kind = "[" not in pattern
    names = [next(iter(entry)) for entry in data["sources"]] if is_kind else list(labels)
    indices = [k for k, name in enumerate(names) if matches(pattern, name)]
    if not indices:
        if pattern in data.get("parameters", {}):
            raise _wrong(change, f"{pattern} is a parameter: its path is parameters.{change.path}")
        error = UnknownNameError("source", pattern, {*labels, *_SECTIONS, *(names if is_kind else ())})
        raise _wrong(change, error.findings[0].message, error.code)
    if is_kind and len(indices) > 1 and "*" not in pattern:
        first = ", ".join(labels[k] for k in indices[:4])
        more = ", …" if len(indices) > 4 else ""
        raise _wrong(change, f"{len(indices)} sources are a {pattern}: {first}{more}; {pattern}[*] names all of them")
    return indices


def _source_paths(
    data: Any, change: Change, indices: Sequence[int], remainder: str, kinds: Mapping[str, type[Source]]
) -> Iterator[Path]:
    settings = [next(iter(data["sources"][k].items())) for k in indices]
    field = remainder[: _STEP.search(remainder).start()]  # type: ignore[union-attr]
    fits = [field in (ASSUMED, PROVENANCE) or field in source_model(kinds[kind]).model_fields for kind, _ in settings]
    if len({kind for kind, _ in settings}) > 1 and any(fits):
        # a pattern that matches several kinds selects those with the setting
        settings = [entry for entry, is_match in zip(settings, fits, strict=True) if is_match]
        indices = [k for k, is_match in zip(indices, fits, strict=True) if is_match]
    for k, (kind, values) in zip(indices, settings, strict=True):
        yield from _walk(values, remainder, ("sources", k, kind), change, may_add=True)


def _walk(value: Any, remainder: str, path: Path, change: Change, *, may_add: bool) -> Iterator[Path]:
    """Yield the paths below a value selected by the remainder of a path; a missing last key may be added."""
    if isinstance(value, dict):
        # the longest key first: names of parameters may hold dots and brackets
        for end in sorted({step.start() for step in _STEP.finditer(remainder)} - {0}, reverse=True):
            keys = [key for key in value if matches(remainder[:end], key)]
            if keys:
                for key in keys:
                    yield from _descend(value[key], remainder[end:], (*path, key), change)
                return
        if may_add and "*" not in remainder and "[" not in remainder and "." not in remainder:
            yield (*path, remainder)
            return
        missing_key = remainder[: min(step.start() for step in _STEP.finditer(remainder) if step.start())]
        error = UnknownNameError("key", missing_key, value)
        raise _wrong(change, error.findings[0].message, error.code)
    entry = _ENTRY.fullmatch(remainder) if isinstance(value, list) else None
    if entry is None:
        raise _wrong(change, f"{'.'.join(map(str, path[-1:]))} is {shown(str(value))}, which has no {shown(remainder)}")
    if entry["k"] != "*" and int(entry["k"]) >= len(value):
        raise _wrong(change, f"{path[-1]} has {len(value)} entries, counted from 0; there is no {entry['k']}")
    for k in range(len(value)) if entry["k"] == "*" else [int(entry["k"])]:
        yield from _descend(value[k], entry["rest"], (*path, k), change)


def _descend(value: Any, remainder: str, path: Path, change: Change) -> Iterator[Path]:
    if remainder:
        yield from _walk(value, remainder.removeprefix("."), path, change, may_add=True)
    else:
        yield path


def _is_quantity(value: object) -> bool:
    try:
        return isinstance(value, str) and bool(units.split(value)[1])
    except InputError:
        return False


def matches(pattern: str, name: str) -> bool:
    """Return whether a name matches a pattern, in which ``*`` matches any characters."""
    first, *others = pattern.split("*")
    if not others:
        return pattern == name
    if not name.startswith(first):
        return False
    position = len(first)
    *middle, last = others
    for part in middle:
        # the first match leaves maximum length for the others, so no backtracking is needed
        index = name.find(part, position)
        if index < 0:
            return False
        position = index + len(part)
    return position <= len(name) - len(last) and name.endswith(last)


def _wrong(change: Change, message: str, code: str = "E_PATH") -> InputError:
    return InputError.of(code, message, change.origin)
