"""Collector of a sheet's findings, with their lines."""

from __future__ import annotations

import itertools
import typing
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final, final

from pydantic import BaseModel, ValidationError

from precision_pin.base.errors import Finding, InputError, SheetError, UnknownNameError, nearest
from precision_pin.sheet.schema import SettingReason
from precision_pin.sheet.settings import SettingError
from precision_pin.sheet.text import Path, Text

_SHAPES: Final = {
    "dict_type": "expected keys with values, {key: value}",
    "list_type": "expected a list, one entry after each '-'",
    "tuple_type": "expected a list, one entry after each '-'",
    "model_type": "expected keys with values, {key: value}",
    "string_type": "expected one value, a text without brackets, as in: 5 mm, or 0 0 5 mm for a point",
}
_MEANT: Final = {
    **dict.fromkeys(("rectangle", "rectangular", "square"), "; a rectangular tube is a box, a solid bar is general"),
    **dict.fromkeys(("round", "circle", "circular", "cylinder", "solid", "bar"), "; a solid round bar is a rod"),
    **dict.fromkeys(("pipe", "hollow"), "; a round pipe is a tube"),
}
"""Hints for other words for one of a few."""
MOST_ERRORS: Final = 100
"""Most errors listed for a sheet; reading stops at more."""

POSE_VALUES: Final = "expected joint values in chain order with one unit, a list of values, or joint names with values"


@final
class Findings:
    """Collector of findings at the lines of a text."""

    def __init__(self, text: Text, file: str) -> None:
        self.text = text
        self.file = file
        self.found: list[Finding] = list(text.findings)
        self._errors = 0

    def error(self, path: Path, message: str, code: str = "E_SHEET") -> None:
        """Add an error at a path."""
        self._add([Finding("error", code, message, *self._where(path))])

    def warning(self, path: Path, message: str, code: str) -> None:
        """Add a warning at a path."""
        self.found.append(Finding("warning", code, message, *self._where(path)))

    def take(self, path: Path, error: InputError) -> None:
        """Add an error raised for a path, at the line of the key or name that it is about."""
        if isinstance(error, SettingError):
            path = (*path, *error.below)
        if isinstance(error, UnknownNameError):
            below = list(_within(self._value(path), path))
            named = (where for where, value in below if where and value == error.name)
            keyed = (where for where, _ in below if where and where[-1] == error.name)
            path = next(itertools.chain(named, keyed), path)
        self._add([finding.at(*self._where(path)) for finding in error.findings])

    @contextmanager
    def taking(self, *path: str | int) -> Iterator[None]:
        """Turn an input error of the body, which it ends, into a finding."""
        try:
            yield
        except InputError as error:
            self.take(path, error)

    def take_validation(self, error: ValidationError, path: Path, model: type[BaseModel]) -> None:
        """Add pydantic's errors about the value at a path."""
        seen: set[Path] = set()
        errors = error.errors()
        places = [self.walk(path, entry["loc"]) for entry in errors]
        for entry, where in zip(errors, places, strict=True):
            # pydantic also reports the word that a list could be instead; drop it if an entry is wrong
            if entry["type"] == "literal_error" and any(one[: len(where)] == where != one for one in places):
                continue
            is_pose = path == () and entry["loc"][0] == "poses" and len(entry["loc"]) > 1
            where = where[:2] if is_pose else where
            key = ".".join(map(str, where[len(path) :])) or str(entry["loc"][-1])
            if entry["type"] == "missing":
                missing = str(entry["loc"][-1])
                meaning = _meaning(model, entry["loc"])
                self.error(where, f"the key {missing!r} is missing{f': {meaning}' if meaning else ''}", "E_MISSING_KEY")
            elif where in seen:
                continue
            elif entry["type"] == "extra_forbidden":
                valid = _keys(model, entry["loc"][:-1])
                self.error(where, f"unknown key {where[-1]!r}: {nearest(str(where[-1]), valid)}", "E_UNKNOWN_KEY")
            else:
                said = entry["msg"].removeprefix("Value error, ")
                message = POSE_VALUES if is_pose else _SHAPES.get(entry["type"], said)
                reason = entry.get("ctx", {}).get("error")
                below = reason.below if isinstance(reason, SettingReason) else ()
                meant = _MEANT.get(str(entry["input"]).strip().lower(), "") if entry["type"] == "literal_error" else ""
                self.error((*where, *below), f"{key}: {message[:1].lower()}{message[1:]}{meant}")
            seen.add(where)

    def walk(self, path: Path, location: Path) -> Path:
        """Return pydantic's location as a path, without pydantic's type names between the keys."""
        value = self._value(path)
        for key in location:
            known = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
            if key in known:
                path, value = (*path, key), value[key]
        return path

    def refuse(self) -> None:
        """Raise the findings if they include an error."""
        if not any(finding.severity == "error" for finding in self.found):
            return
        ordered = sorted(dict.fromkeys(self.found), key=lambda finding: (finding.file or "", finding.line or 0))
        errors = [finding for finding in ordered if finding.severity == "error"]
        if len(errors) > MOST_ERRORS:
            last = errors[MOST_ERRORS - 1]
            ordered = ordered[: ordered.index(last) + 1]
            message = f"more than {MOST_ERRORS} errors; these are the first"
            ordered.append(replace(last, code="E_SHEET", message=message))
        raise SheetError(ordered)

    def _where(self, path: Path) -> tuple[str, int | None]:
        """Return the file and line of a path; the change it comes from; or, without lines, the path in words."""
        change = self.text.change(path)
        if change is not None:
            return change, None
        line = self.text.line(path)
        return (self.file, line) if line is not None or not path else (".".join(map(str, path)), None)

    def _add(self, findings: Sequence[Finding]) -> None:
        self.found += findings
        self._errors += sum(finding.severity == "error" for finding in findings)
        if self._errors > MOST_ERRORS:
            self.refuse()

    def _value(self, path: Path) -> Any:
        value = self.text.data
        for key in path:
            value = value[key]
        return value


def _within(value: Any, path: Path) -> Iterator[tuple[Path, Any]]:
    yield path, value
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        yield from _within(entry, (*path, key))


def _meaning(model: type[BaseModel], location: Path) -> str:
    """Return the description of a key at pydantic's location, or empty."""
    for key in location[:-1]:
        if key in model.model_fields:
            model = _inner(model.model_fields[str(key)].annotation) or model
    found = [field for name, field in model.model_fields.items() if location[-1] in (name, field.alias)]
    return (found[0].description or "").removesuffix(".") if found else ""


def _keys(model: type[BaseModel], location: Path) -> list[str]:
    """Return the keys allowed at pydantic's location below a model."""
    for key in location:
        if key in model.model_fields:
            model = _inner(model.model_fields[str(key)].annotation) or model
    return [field.alias or name for name, field in model.model_fields.items()]


def _inner(hint: object) -> type[BaseModel] | None:
    """Return the model inside a type, such as that of list items."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return hint
    return next(filter(None, map(_inner, typing.get_args(hint))), None)
