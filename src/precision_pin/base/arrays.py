"""The array type of signatures, and helpers that make arrays read-only."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache, wraps
from typing import Any, Concatenate, Final, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
"""Numbers in double precision; docstrings give the shape."""


Thing = TypeVar("Thing")
Owner = TypeVar("Owner")
Given = ParamSpec("Given")


def read_only(value: Thing) -> Thing:
    """Return a read-only view of an array, or of each array in a tuple; anything else is returned unchanged."""
    if isinstance(value, np.ndarray):
        if value.flags.writeable:
            view = value.view()
            view.flags.writeable = False
            return cast("Thing", view)
        return value
    if type(value) is tuple:
        return cast("Thing", tuple([read_only(one) for one in cast("tuple[object, ...]", value)]))
    return value


def fix_copy(values: ArrayLike) -> NDArray[np.float64]:
    """Return a read-only copy as an array of floats."""
    copy = np.array(values, dtype=float, order="C")
    copy.flags.writeable = False
    return copy


def returns_read_only(method: Callable[Concatenate[Owner, Given], Thing]) -> Callable[Concatenate[Owner, Given], Thing]:
    """Decorate a method to return read-only arrays; goes inside ``cached_property``."""

    @wraps(method)
    def call_method(self: Owner, /, *arguments: Given.args, **options: Given.kwargs) -> Thing:
        return read_only(method(self, *arguments, **options))

    return call_method


def fix_fields(instance: Any) -> None:
    """Make the arrays in the fields of a frozen data class read-only, without a copy."""
    for name in field_names(instance.__class__):
        value = getattr(instance, name)
        if isinstance(value, _MAY_BE_WRITTEN):
            object.__setattr__(instance, name, read_only(value))


_MAY_BE_WRITTEN: Final = (np.ndarray, tuple)


class Fixed:
    """Base of frozen data classes whose arrays are read-only."""

    def __post_init__(self) -> None:
        fix_fields(self)


@cache  # models make thousands of instances of a few classes
def field_names(kind: type[Any]) -> tuple[str, ...]:
    """Return the names of the fields of a data class."""
    return tuple(field.name for field in dataclasses.fields(kind))
