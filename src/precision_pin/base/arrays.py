"""The array type of signatures, read-only arrays, and records: frozen data classes that declare their JSON."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from functools import cache, wraps
from operator import attrgetter
from typing import Any, ClassVar, Concatenate, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
"""Numbers in double precision; docstrings give the shape."""


Value = TypeVar("Value")
Owner = TypeVar("Owner")
Args = ParamSpec("Args")


def read_only(value: Value) -> Value:
    """Return a read-only view of an array, or of each array in a tuple; anything else is returned unchanged."""
    if isinstance(value, np.ndarray):
        if value.flags.writeable:
            view = value.view()
            view.flags.writeable = False
            return cast("Value", view)
        return value
    if type(value) is tuple:
        return cast("Value", tuple([read_only(item) for item in cast("tuple[object, ...]", value)]))
    return value


def fix_copy(values: ArrayLike) -> NDArray[np.float64]:
    """Return a read-only copy as an array of floats."""
    copy = np.array(values, dtype=float, order="C")
    copy.flags.writeable = False
    return copy


def returns_read_only(method: Callable[Concatenate[Owner, Args], Value]) -> Callable[Concatenate[Owner, Args], Value]:
    """Decorate a method to return read-only arrays; goes inside ``cached_property``."""

    @wraps(method)
    def call_method(self: Owner, /, *arguments: Args.args, **options: Args.kwargs) -> Value:
        return read_only(method(self, *arguments, **options))

    return call_method


def fix_fields(instance: Any) -> None:
    """Make the arrays in the fields of a frozen data class read-only, without a copy."""
    for name in field_names(instance.__class__):
        value = getattr(instance, name)
        if isinstance(value, np.ndarray | tuple):
            object.__setattr__(instance, name, read_only(value))


class Fixed:
    """Base of frozen data classes whose arrays are read-only."""

    def __post_init__(self) -> None:
        fix_fields(self)


@cache  # models make thousands of instances of a few classes
def field_names(kind: type[Any]) -> tuple[str, ...]:
    """Return the names of the fields of a data class."""
    return tuple(field.name for field in dataclasses.fields(kind))


Keys = tuple[str, ...]


class Record(Fixed):
    """Frozen data class with read-only arrays and a declared JSON form.

    Attributes:
        KEYS: Keys of the JSON in order; if empty, the fields. ``"key"`` is the attribute of that name,
            ``"key=attribute"`` another, perhaps with dots, ``"key=attribute?"`` null if it is empty, and
            ``"*attribute"`` adds all keys of a record or mapping.
    """

    KEYS: ClassVar[Keys] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of the record, SI units; null for numbers that do not exist or are not resolved."""
        kind: Any = type(self)
        return self.encoded(self.KEYS or field_names(kind))

    def encoded(self, keys: Iterable[str]) -> dict[str, Any]:
        """Return selected keys of the JSON, each as in :attr:`KEYS`."""
        entries: dict[str, Any] = {}
        for entry in keys:
            key, _, attribute = entry.partition("=")
            value = encode(attrgetter(attribute.rstrip("?") or key.lstrip("*"))(self))
            if attribute.endswith("?"):
                value = value or None
            entries |= value if key.startswith("*") else {key: value}
        return entries


def encode(value: Any) -> Any:
    """Return a value as in JSON: arrays and tuples as lists, records as objects, non-finite numbers as null."""
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return float(value) if math.isfinite(value) else None
        case np.ndarray() | np.generic():
            items = value.tolist()
            return items if value.dtype.kind != "f" or np.isfinite(value).all() else encode(items)
        case Mapping():
            return {str(key): encode(entry) for key, entry in value.items()}
        case tuple() | list():
            return [encode(entry) for entry in value]
        case _:
            return value.to_dict()
