"""Provenance of the numbers of a sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.sheet.changes import matches
from precision_pin.sheet.findings import Findings
from precision_pin.sheet.schema import ASSUMED, PROVENANCE
from precision_pin.sheet.text import Path

MEASURED: Final = "measured"
ORIGINS: Final = ("assumed", "data sheet", MEASURED, "drawing")
"""Possible origins of a number."""
_EXAMPLE: Final = "such as 'provenance: drawing' or 'provenance: {data sheet: \"page 12\"}'"


@final
@dataclass(frozen=True)
class Origin:
    """Where a number comes from.

    Attributes:
        kind: One of `ORIGINS`.
        text: Details, such as the page of a data sheet.
    """

    kind: str
    text: str = ""


def read_origin(value: Any) -> Origin:
    """Return the origin stated in a sheet: a word, or a word with a text."""
    word, text = value, ""
    if isinstance(value, dict):
        if len(value) != 1:
            raise InputError(f"one word of {', '.join(ORIGINS)} is expected, {_EXAMPLE}; this has {len(value)} keys")
        word, text = next(iter(value.items()))
    if not isinstance(word, str) or not isinstance(text, str):
        raise InputError(f"a word is expected, {_EXAMPLE}")
    if word not in ORIGINS:
        raise UnknownNameError("provenance", word, ORIGINS)
    return Origin(word, text)


def source_origins(
    settings: Mapping[str, Any], fields: Sequence[str], path: Path, findings: Findings
) -> dict[str, Origin]:
    """Return the origins that a source states, by setting; under an empty name for all its numbers."""
    found: dict[str, Origin] = {}
    if ASSUMED in settings and ASSUMED not in fields:
        mark = settings[ASSUMED]
        if mark not in ("true", "false"):
            findings.error((*path, ASSUMED), f"{ASSUMED} must be true or false, got {str(mark)[:40]!r}")
        elif mark == "true":
            found[""] = Origin(ASSUMED)
    if PROVENANCE in settings and PROVENANCE not in fields:
        value = settings[PROVENANCE]
        if found:
            message = f"{ASSUMED} and {PROVENANCE} both say where the numbers come from; leave one out"
            findings.error((*path, PROVENANCE), message)
        by_setting = isinstance(value, dict) and not set(value) & set(ORIGINS) and bool(set(value) & set(fields))
        for name, entry in value.items() if by_setting else [("", value)]:
            with findings.taking(*path, PROVENANCE, *([name] if name else [])):
                if name and name not in fields:
                    raise UnknownNameError("setting", name, fields)
                found[name] = read_origin(entry)
    return found


def origins_by_path(
    stated: Mapping[str, Any], names: Sequence[str], labels: Sequence[str], findings: Findings
) -> dict[str, Origin]:
    """Return the origins under the sheet's key ``provenance``, by paths as in ``--set``; ``*`` stands for anything."""
    found: dict[str, Origin] = {}
    known = [*(f"parameters.{name}" for name in names), *labels]
    for pattern, value in stated.items():
        with findings.taking(PROVENANCE, pattern):
            origin = read_origin(value)
            matched = [name for name in known if matches(pattern, name)]
            setting = ""
            if not matched:
                label, _, setting = pattern.rpartition(".")
                matched = [name for name in labels if label and matches(label, name)]
            if not matched:
                raise UnknownNameError("parameter or source", pattern, known)
            found |= {f"{name}.{setting}" if setting else name: origin for name in matched}
    return found
