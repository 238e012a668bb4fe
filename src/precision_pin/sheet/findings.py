"""Findings at the lines of a sheet."""

from __future__ import annotations

import typing
from typing import Any, Final, final

from pydantic import BaseModel, ValidationError

from precision_pin.errors import Finding, InputError, SheetError, UnknownNameError, nearest
from precision_pin.sheet.schema import SettingReason
from precision_pin.sheet.settings import SettingError
from precision_pin.sheet.text import Path, Text

__all__ = ["Findings"]

_SHAPES: Final = {
    "dict_type": "keys with values belong here, {key: value}",
    "list_type": "a list belongs here, one entry after each '-'",
    "tuple_type": "a list belongs here, one entry after each '-'",
    "model_type": "keys with values belong here, {key: value}",
    "string_type": "one value belongs here",
}
_POSE: Final = "joint values in chain order with one unit, a list of values, or keys with values by joint belong here"


@final
class Findings:
    """Collects findings at the lines of a text.

    Parameters
    ----------
    text
        The sheet's contents.
    file
        Its name.
    """

    def __init__(self, text: Text, file: str) -> None:
        self.text = text
        self.file = file
        self.found: list[Finding] = list(text.findings)

    def error(self, path: Path, message: str, code: str = "E_SHEET") -> None:
        """Add an error at a path."""
        self.found.append(Finding("error", code, message, self.file, self.text.line(path)))

    def warning(self, path: Path, message: str, code: str) -> None:
        """Add a warning at a path."""
        self.found.append(Finding("warning", code, message, self.file, self.text.line(path)))

    def take(self, path: Path, error: InputError) -> None:
        """Add an error met at a path; at the line of the key or name where the message is about one."""
        if isinstance(error, SettingError):
            path = (*path, *error.below)
        if isinstance(error, UnknownNameError):
            below = [other for other in self.text.lines if other and other[: len(path)] == path]
            named = [other for other in below if self._value(other) == error.name]
            path = next(iter((*named, *(other for other in below if other[-1] == error.name))), path)
        self.found += [finding.at(self.file, self.text.line(path)) for finding in error.findings]

    def take_validation(self, error: ValidationError, path: Path, model: type[BaseModel]) -> None:
        """Add pydantic's errors about what stands at a path."""
        seen: set[Path] = set()
        for entry in error.errors():
            where = self.walk(path, entry["loc"])
            is_pose = path == () and entry["loc"][0] == "poses" and len(entry["loc"]) > 1
            where = where[:2] if is_pose else where
            key = ".".join(map(str, where[len(path) :])) or str(entry["loc"][-1])
            if entry["type"] == "missing":
                self.error(where, f"the key {str(entry['loc'][-1])!r} is missing", "E_MISSING_KEY")
            elif where in seen:
                continue
            elif entry["type"] == "extra_forbidden":
                valid = _keys(model, entry["loc"][:-1])
                self.error(where, f"unknown key {where[-1]!r}: {nearest(str(where[-1]), valid)}", "E_UNKNOWN_KEY")
            else:
                message = _POSE if is_pose else _SHAPES.get(entry["type"], entry["msg"].removeprefix("Value error, "))
                reason = entry.get("ctx", {}).get("error")
                below = reason.below if isinstance(reason, SettingReason) else ()
                self.error((*where, *below), f"{key}: {message[:1].lower()}{message[1:]}")
            seen.add(where)

    def walk(self, path: Path, location: Path) -> Path:
        """Return pydantic's location as a path: without the names of types, which it puts between the keys."""
        value = self._value(path)
        for key in location:
            known = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
            if key in known:
                path, value = (*path, key), value[key]
        return path

    def refuse(self) -> None:
        """Raise the findings if there is an error among them.

        Raises
        ------
        SheetError
            With all findings, warnings too, in the order of their lines.
        """
        if any(finding.severity == "error" for finding in self.found):
            raise SheetError(sorted(self.found, key=lambda finding: (finding.file or "", finding.line or 0)))

    def _value(self, path: Path) -> Any:
        value = self.text.data
        for key in path:
            value = value[key]
        return value


def _keys(model: type[BaseModel], location: Path) -> list[str]:
    """Return the keys that are allowed at pydantic's location below a model."""
    for key in location:
        if key in model.model_fields:
            model = _inner(model.model_fields[str(key)].annotation) or model
    return [field.alias or name for name, field in model.model_fields.items()]


def _inner(hint: object) -> type[BaseModel] | None:
    """Return the model that a type is made of."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return hint
    return next(filter(None, map(_inner, typing.get_args(hint))), None)
