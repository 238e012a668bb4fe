"""Checks of the arguments of public functions.

A wrong argument of any kind (type, shape, number, name) ends in an :class:`~precision_pin.errors.InputError` of one line
that names the argument, what is allowed and what was given. Every check returns what it let pass in the type that the
package works with; arrays as copies that cannot be written. A check costs a microsecond or two.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from precision_pin.errors import InputError, UnknownNameError
from precision_pin.inputs.arrays import fix_copy
from precision_pin.inputs.memory import check_memory
from precision_pin.typing import Array
from precision_pin.visible import visible

__all__ = [
    "check_callable",
    "check_choice",
    "check_flag",
    "check_instance",
    "check_items",
    "check_mapping",
    "check_name",
    "check_number",
    "check_numbers",
    "check_path",
    "check_text",
    "check_whole",
    "shown",
]

Kind = TypeVar("Kind")

_LONGEST: Final = 60
_NUMBERS: Final = "iuf"
"""Kinds of numpy's types that are real numbers."""
_MANY: Final = 2**20
"""More numbers than this are copied only if there is memory for them; asking takes longer than copying fewer."""


def shown(value: object) -> str:
    """Return a value as a message shows it: on one line, shortened."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - a value that cannot even be shown is named by its type
        text = f"a {type(value).__name__}"
    return visible(text, _LONGEST)


def check_whole(what: str, value: object, least: int, most: int, limits: str = "") -> int:
    """Return a whole number; neither true nor false, nor a float.

    Parameters
    ----------
    what
        The argument, in words.
    value
        What was given.
    least, most
        What is allowed.
    limits
        How a message says what is allowed; from least to most if left out.

    Raises
    ------
    InputError
        It is none, or out of range.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        allowed = limits or f"from {least} to {most}"
        raise InputError(f"{what} must be a whole number {allowed}, got {shown(value)}")
    return int(value)


def check_number(
    what: str, value: object, allowed: str = "a finite number", within: Callable[[float], bool] | None = None
) -> float:
    """Return a finite number; neither true nor false, nor text.

    Parameters
    ----------
    what, value
        The argument, in words, and what was given.
    allowed
        What is allowed, as a message says it after "must be".
    within
        Whether a finite number is allowed; all are if left out.

    Raises
    ------
    InputError
        It is none, or not allowed.
    """
    number = _number(value)
    if number is None or not math.isfinite(number) or not (within is None or within(number)):
        raise InputError(f"{what} must be {allowed}, got {shown(value)}")
    return number


def _number(value: object) -> float | None:
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in _NUMBERS:
        return float(value)
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf


def check_numbers(what: str, values: object, shape: tuple[int | None, ...] | None = None, needs: str = "") -> Array:
    """Return finite numbers as a copy that cannot be written.

    Parameters
    ----------
    what, values
        The argument, in words, and what was given: a number, sequences of numbers, or an array.
    shape
        What is allowed; ``None`` for any length, left out for any shape.
    needs
        How a message says what is allowed.

    Raises
    ------
    InputError
        Something else than numbers, one that is not finite, or another shape; more than there is memory for.
    """
    if isinstance(values, np.ndarray) and (shape is None or _fits(values, shape)):
        if values.size > _MANY:
            # the copy, and a byte for each of what is not finite
            check_memory(9.0 * values.size, f"reading {what}, {values.size:,} numbers,", "give fewer at a time")
    elif isinstance(values, np.ndarray) and values.dtype.kind in _NUMBERS and shape is not None:
        raise InputError(f"{what} must be {needs or _numbers_of(shape)}, got an array of shape {values.shape}")
    array = _array(values)
    fits = array is not None and (shape is None or _fits(array, shape))
    finite = array is not None and bool(np.isfinite(array).all())
    if array is not None and fits and finite:
        return array
    if shape is not None:
        expected = needs or _numbers_of(shape)
        got = shown(values) if array is None or fits else f"an array of shape {array.shape}"
        raise InputError(f"{what} must be {expected}, got {got}")
    expected = f"; expected {needs}" if needs else ""
    raise InputError(f"{what} must be {'numbers' if array is None else 'finite'}, got {shown(values)}{expected}")


def _fits(array: NDArray[Any], shape: tuple[int | None, ...]) -> bool:
    if array.shape == shape:
        return True
    return array.ndim == len(shape) and all(want in (None, has) for want, has in zip(shape, array.shape, strict=True))


def _array(values: object) -> Array | None:
    """Return a copy of numbers, ``None`` where they are none: text that could be read as a number is none."""
    try:
        given = np.asarray(values)
    except (TypeError, ValueError, OverflowError, MemoryError):
        return None
    if given.dtype.kind not in _NUMBERS and (
        given.dtype.kind != "O" or any(_number(one) is None for one in given.ravel())
    ):
        return None
    try:
        return fix_copy(cast("Any", given))
    except (TypeError, ValueError, OverflowError):
        return None


def _numbers_of(shape: tuple[int | None, ...]) -> str:
    entries = ", ".join("N" if one is None else str(one) for one in shape)
    return f"finite numbers of shape ({entries},)" if len(shape) == 1 else f"finite numbers of shape ({entries})"


def check_flag(what: str, value: object) -> bool:
    """Return true or false.

    Raises
    ------
    InputError
        It is neither.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{what} must be True or False, got {shown(value)}")
    return bool(value)


def check_text(what: str, value: object, example: str = "") -> str:
    """Return text.

    Raises
    ------
    InputError
        It is none.
    """
    if not isinstance(value, str):
        raise InputError(f"{what} must be text{f', such as {example!r}' if example else ''}, got {shown(value)}")
    return str(value)


def check_name(kind: str, value: object, known: Iterable[str]) -> str:
    """Return the name of something that exists.

    Raises
    ------
    UnknownNameError
        Nothing has it.
    InputError
        It is no text.
    """
    name = check_text(f"the name of a {kind}", value)
    names = tuple(known)
    if name not in names:
        raise UnknownNameError(kind, name, names)
    return name


def check_choice(what: str, value: str, choices: tuple[str, ...]) -> None:
    """Refuse what is none of several words.

    Raises
    ------
    InputError
        It is another.
    """
    if not isinstance(value, str) or value not in choices:
        raise InputError(f"{what} must be {' or '.join(choices)}, got {shown(value)}")


def check_instance(what: str, value: object, kind: type[Kind], made: str = "") -> Kind:
    """Return something of one type.

    Parameters
    ----------
    what, value
        The argument, in words, and what was given.
    kind
        The type.
    made
        How to make one, for the message.

    Raises
    ------
    InputError
        It is of another type.
    """
    if not isinstance(value, kind):
        hint = f" ({made})" if made else ""
        raise InputError(f"{what} must be of type {kind.__name__}{hint}, got {shown(value)}")
    return value


def check_items(what: str, values: object, kind: type[Kind], made: str = "") -> tuple[Kind, ...]:
    """Return the items of a list or another collection, all of one type.

    Raises
    ------
    InputError
        It is no collection, or an item is of another type.
    """
    if isinstance(values, str | bytes | Mapping) or not isinstance(values, Iterable):
        raise InputError(f"{what} must be a list of {kind.__name__}, got {shown(values)}")
    return tuple([check_instance(f"each of {what}", value, kind, made) for value in values])


def check_mapping(what: str, value: object) -> Mapping[str, Any]:
    """Return a mapping from names.

    Raises
    ------
    InputError
        It is none, or a key is no text.
    """
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{what} must be a dictionary by name, got {shown(value)}")
    return value


def check_callable(what: str, value: object) -> None:
    """Refuse what cannot be called.

    Raises
    ------
    InputError
        It cannot.
    """
    if not callable(value):
        raise InputError(f"{what} must be a function, got {shown(value)}")


def check_path(what: str, value: object) -> str:
    """Return the name of a file.

    Raises
    ------
    InputError
        It is no path.
    """
    if not isinstance(value, str | os.PathLike):
        raise InputError(f"{what} must be the path of a file, got {shown(value)}")
    path = os.fspath(value)
    if not isinstance(path, str):
        raise InputError(f"{what} must be the path of a file, got {shown(value)}")
    return path
