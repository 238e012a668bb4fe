"""Differences between two sheets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, final

from precision_pin.sheet.reader import Sheet
from precision_pin.terms.bound_source import labels

_LEFT_OUT = ("precision-pin", "allocate", "measurement")
"""Keys that do not change the error."""


@final
@dataclass(frozen=True)
class SheetDifference:
    """A value that differs between two sheets.

    Attributes:
        path: As in ``--set``: ``parameters.a1``, ``axis_install[joint2].radius``; a whole source by its label.
        before, after: As written; ``None`` if a sheet does not have it.
    """

    path: str
    before: str | None
    after: str | None


def sheet_differences(first: Sheet, other: Sheet) -> tuple[SheetDifference, ...]:
    """Return the differences from one sheet to another, in the order of the first, then what is new.

    Values are compared as written: ``0.1 mm`` and ``100 um`` differ. A source in only one sheet is one difference.
    Sheets not read from a file or a dictionary have none.
    """
    if first.contents is None or other.contents is None:
        return ()
    before, after = dict(_values(first)), dict(_values(other))
    paths = dict.fromkeys([*before, *after])
    return tuple(
        SheetDifference(path, before.get(path), after.get(path))
        for path in paths
        if before.get(path) != after.get(path)
    )


def _values(sheet: Sheet) -> Iterator[tuple[str, str]]:
    assert sheet.contents is not None
    data: dict[str, Any] = sheet.contents.text.data
    for key, value in data.items():
        if key == "sources":
            for label, entry in zip(labels(sheet.sources), value, strict=True):
                yield label, "present"
                yield from _flat(label, next(iter(entry.values())))
        elif key not in _LEFT_OUT:
            yield from _flat(key, value)


def _flat(path: str, value: Any) -> Iterator[tuple[str, str]]:
    """Yield every text below a value by its path; a list is one text."""
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from _flat(f"{path}.{key}", entry)
    else:
        yield path, _text(value)


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_text(entry)}" for key, entry in value.items()) + "}"
    return "[" + ", ".join(map(_text, value)) + "]" if isinstance(value, list) else str(value)
