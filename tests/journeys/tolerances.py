"""Tolerances of a sheet as a user finds them: by a budget's lines, in the text of the sheet."""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path
from typing import Any

from precision_pin.base.errors import PrecisionPinWarning
from precision_pin.sheet import read as read_sheet

_NUMBER = re.compile(r"[\d.]+(e-?\d+)?")
_LAWS = ("uniform", "normal")
_KINDS = ("frame", "length", "joint_offset", "axis_install", "mounting")
"""Sources whose tolerances are lengths or angles."""


class Tolerance:
    """A tolerance that a budget names, with the share of the position's variance that comes from it."""

    def __init__(self, path: str, value: Any) -> None:
        self.path, self.value, self.share = path, value, 0.0

    @property
    def text(self) -> str:
        """The width as written."""
        law = self.value
        if isinstance(law, dict):
            law = next(law[key] for key in _LAWS if key in law)
        return str(law["std"] if isinstance(law, dict) else law)

    @property
    def number_path(self) -> str:
        """Path of the width itself, within its law."""
        law, path = self.value, self.path
        while isinstance(law, dict):
            key = next(key for key in (*_LAWS, "std") if key in law)
            law, path = law[key], f"{path}.{key}"
        return path

    @property
    def quantity(self) -> str:
        """``mm`` or ``mrad``."""
        return "mm" if self.text.split()[-1] in ("mm", "um", "m") else "mrad"

    def times(self, factor: float) -> str:
        """Return the value with another width, for ``--set``."""
        new = _NUMBER.sub(lambda found: f"{float(found[0]) * factor:.9g}", self.text, count=1)
        return f"{self.path}=" + json.dumps(self.value, default=str).replace(self.text, new)


def ranked(sheet: Path, budget: Any) -> list[Tolerance]:
    """Return the tolerances that can be changed, that with the largest share in the first pose of a budget first."""
    found: dict[str, Tolerance] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionPinWarning)
        read = read_sheet(sheet)
    for line in budget["poses"][0]["draws"]:
        kind, _, rest = line["name"].partition("[")
        label, _, setting = line["name"].rpartition("]")
        if kind not in _KINDS or "#" in rest or line["share"]["position"] is None:
            continue
        setting = "radius" if kind == "axis_install" else setting.lstrip(".")
        path = f"{label}].{setting}"
        if path not in found:
            assert read.contents is not None
            values = list(read.contents.values_at(read, path).values())
            if len(values) != 1:
                continue
            found[path] = Tolerance(path, values[0])
        found[path].share += line["share"]["position"]
    return sorted(found.values(), key=lambda one: -one.share)
