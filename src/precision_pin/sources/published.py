"""Gears and servos whose figures are published; ``published.toml`` says of each where it was read."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from precision_pin.base.errors import UnknownNameError
from precision_pin.base.units import PerJoint, parse_vector
from precision_pin.terms import Source
from precision_pin.terms.source import setting_fields


@dataclass(frozen=True)
class Published:
    """Settings of a gear or servo for revolute joints, as a sheet writes them, and what they are and where they stand."""

    settings: Mapping[str, str]
    document: str


@cache
def published(key: Literal["gear", "servo"]) -> dict[str, Published]:
    """Return the published gears or servos by name."""
    contents = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return {
        name: Published(
            {field: text for field, text in entry.items() if field != "from"}, contents["document"][entry["from"]]
        )
        for name, entry in contents[key].items()
    }


def take_published(source: Source, key: Literal["gear", "servo"], *together: str) -> None:
    """Set what a source leaves open to the settings of the gear or servo that it names.

    Settings ``together`` describe one curve: if one of them is given, none of them is taken.

    Raises:
        UnknownNameError: No such gear or servo.
    """
    name: str | None = getattr(source, key)
    if name is None:
        return
    entries = published(key)
    if name not in entries:
        raise UnknownNameError(f"published {key}", name, entries)
    is_open = {field.name: _is_open(getattr(source, field.name)) for field in setting_fields(type(source))}
    for field in setting_fields(type(source)):
        text = entries[name].settings.get(field.name)
        others = together if field.name in together else (field.name,)
        if text is None or not all(is_open[other] for other in others):
            continue
        quantity = next(note.revolute for note in field.notes if isinstance(note, PerJoint))
        numbers = tuple(parse_vector(text, quantity))
        object.__setattr__(source, field.name, numbers[0] if len(numbers) == 1 else numbers)


def _is_open(value: Any) -> bool:
    return value is None or (isinstance(value, tuple) and not value)
