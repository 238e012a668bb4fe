"""Records: frozen data classes that declare their JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from precision_pin.base.arrays import Fixed, field_names

Keys = tuple[str, ...]


class Record(Fixed):
    """Frozen data class with read-only arrays and a declared JSON form.

    Attributes:
        KEYS: Keys of the JSON in order; if empty, the fields. ``"key"`` is the attribute of that name,
            ``"key=attribute"`` another, perhaps with dots, ``"key=attribute?"`` null where that is empty, and
            ``"*attribute"`` adds all keys of a record or mapping.
    """

    KEYS: ClassVar[Keys] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of the record, SI units; null where a number does not exist or is not resolved."""
        kind: Any = type(self)
        return self.encoded(self.KEYS or field_names(kind))

    def encoded(self, keys: Iterable[str]) -> dict[str, Any]:
        """Return some keys of the JSON, each as in :attr:`KEYS`."""
        found: dict[str, Any] = {}
        for entry in keys:
            key, _, attribute = entry.partition("=")
            value = encode(attrgetter(attribute.rstrip("?") or key.lstrip("*"))(self))
            if attribute.endswith("?"):
                value = value or None
            found |= value if key.startswith("*") else {key: value}
        return found


def encode(value: Any) -> Any:
    """Return a value as in JSON: arrays and tuples as lists, records as objects, non-finite numbers as null."""
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return float(value) if math.isfinite(value) else None
        case np.ndarray() | np.generic():
            listed = value.tolist()
            return listed if value.dtype.kind != "f" or np.isfinite(value).all() else encode(listed)
        case Mapping():
            return {str(key): encode(entry) for key, entry in value.items()}
        case tuple() | list():
            return [encode(entry) for entry in value]
        case _:
            return value.to_dict()
