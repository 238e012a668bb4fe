"""Checks of the arguments of public functions, quantities and sizes included.

A wrong argument (type, shape, value, name) raises an :class:`~precision_pin.base.errors.InputError` of one line with
the argument, the allowed values and the given value. Checks return the value in the package's type; arrays as read-only
copies. A check costs about a microsecond. Parameters of all checks: ``what`` names the argument in the message,
``value`` is the given value.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array, fix_copy
from precision_pin.base.errors import InputError, UnitError, UnknownNameError, visible
from precision_pin.base.units import Quantity, parse_vector

_UNCHECKED: Final = 2**28
"""Bytes up to which free memory is not checked: 256 MiB fit on any machine, and a check takes almost 1 ms."""

_MEMORY: Final = Path("/proc/meminfo")
"""Linux's memory statistics; see proc(5)."""
_GROUPS, _OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
"""Root of the control groups, and the list of this process's; see cgroups(7)."""


def available_memory() -> int | None:
    """Return the bytes that this process can still allocate without swapping; ``None`` if unknown."""
    free_bytes = []
    with suppress(OSError, ValueError, StopIteration):
        line = next(line for line in _MEMORY.read_text("ascii").splitlines() if line.startswith("MemAvailable:"))
        free_bytes.append(1024 * int(line.split()[1]))
    if not free_bytes:
        with suppress(OSError, ValueError):  # not Linux: all physical memory
            free_bytes.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit, used in _group_files():
        with suppress(OSError, ValueError):  # no such group, or one without a limit
            free_bytes.append(max(int(limit.read_text("ascii")) - int(used.read_text("ascii")), 0))
    return min(free_bytes, default=None)


def _group_files() -> Iterator[tuple[Path, Path]]:
    """Yield the files with the limit and the usage of this process's control group and of each group above it."""
    lines = []
    with suppress(OSError, ValueError):
        lines = _OWN_GROUPS.read_text("utf-8").splitlines()
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        home = _GROUPS / "memory" if controllers else _GROUPS
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes") if controllers else ("memory.max", "memory.current")
        group = home / path.lstrip("/")
        for folder in (group, *group.parents):
            if folder.is_relative_to(home):
                yield folder / names[0], folder / names[1]


def check_memory(needed: float, what: str, remedy: str) -> None:
    """Raise if a request of ``needed`` bytes for ``what`` exceeds the free memory; ``remedy`` is the alternative."""
    available = available_memory() if needed > _UNCHECKED else None
    if available is not None and needed > available:
        message = f"{what} takes {needed / 1e9:,.1f} GB, {available / 1e9:,.1f} GB of memory are free; {remedy}"
        raise InputError(message)


def check_kept(samples: int) -> None:
    """Raise if the pose errors of this many samples, 48 bytes each, do not fit into memory."""
    remedy = f"at most {(available_memory() or 0) // 48:,} can be kept (the statistics do not need them)"
    check_memory(48.0 * samples, f"keeping {samples:,} samples", remedy)


Kind = TypeVar("Kind")

_LONGEST: Final = 60
"""Characters of a value that a message shows: name, value and allowed values then fit two lines of a terminal."""

_NUMBERS: Final = "iuf"
"""Kinds of numpy types that are real numbers."""
_MANY: Final = 2**20
"""Array size (numbers) above which free memory is checked before copying; the copy then takes longer than the check."""


def shown(value: object) -> str:
    """Return the text of a value for a message: one line, shortened."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - if repr fails, the type must do
        text = f"a {type(value).__name__}"
    return visible(text, _LONGEST)


def check_whole(what: str, value: object, minimum: int, maximum: int, limits: str = "") -> int:
    """Return an integer from ``minimum`` to ``maximum`` (in messages: ``limits``); booleans and floats are rejected."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not minimum <= value <= maximum:
        allowed = limits or f"from {minimum} to {maximum}"
        raise InputError(f"{what} must be a whole number {allowed}, got {shown(value)}")
    return int(value)


def check_number(
    what: str, value: object, allowed: str = "a finite number", within: Callable[[float], bool] | None = None
) -> float:
    """Return a finite number that fulfils ``within``; booleans and text are rejected."""
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
    """Return finite numbers as a read-only copy.

    Args:
        values: A number, sequences of numbers, or an array.
        shape: The allowed shape, with ``None`` for any length (default: any shape).
        needs: Text after "must be" in the message.
    """
    if isinstance(values, np.ndarray) and (shape is None or _fits(values, shape)):
        if values.size > _MANY:
            # 8 bytes a number for the copy, and 1 for the mask of finite numbers
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
    """Return a copy as floats; ``None`` for anything else, including text that could be read as a number."""
    try:
        array = np.asarray(values)
    except (TypeError, ValueError, OverflowError, MemoryError):
        return None
    if array.dtype.kind not in _NUMBERS and (
        array.dtype.kind != "O" or any(_number(entry) is None for entry in array.ravel())
    ):
        return None
    try:
        return fix_copy(cast("Any", array))
    except (TypeError, ValueError, OverflowError):
        return None


def _numbers_of(shape: tuple[int | None, ...]) -> str:
    entries = ", ".join("N" if length is None else str(length) for length in shape)
    return f"finite numbers of shape ({entries},)" if len(shape) == 1 else f"finite numbers of shape ({entries})"


def check_flag(what: str, value: object) -> bool:
    """Return true or false."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{what} must be True or False, got {shown(value)}")
    return bool(value)


def check_text(what: str, value: object, example: str = "") -> str:
    """Return text."""
    if not isinstance(value, str):
        raise InputError(f"{what} must be text{f', such as {example!r}' if example else ''}, got {shown(value)}")
    return str(value)


def check_name(kind: str, value: object, names: Collection[str]) -> str:
    """Return the name of something that exists."""
    name = check_text(f"the name of a {kind}", value)
    if name not in names:
        raise UnknownNameError(kind, name, tuple(names))
    return name


def check_choice(what: str, value: str, choices: tuple[str, ...]) -> None:
    """Check that a value is one of several words."""
    if not isinstance(value, str) or value not in choices:
        raise InputError(f"{what} must be {' or '.join(choices)}, got {shown(value)}")


def check_instance(what: str, value: object, kind: type[Kind], recipe: str = "") -> Kind:
    """Return a value of the type ``kind``; ``recipe`` is the message's example of one."""
    if not isinstance(value, kind):
        hint = f" ({recipe})" if recipe else ""
        raise InputError(f"{what} must be of type {kind.__name__}{hint}, got {shown(value)}")
    return value


def check_items(what: str, values: object, kind: type[Kind], recipe: str = "") -> tuple[Kind, ...]:
    """Return the items of a list or another collection, all of one type."""
    if isinstance(values, str | bytes | Mapping) or not isinstance(values, Iterable):
        raise InputError(f"{what} must be a list of {kind.__name__}, got {shown(values)}")
    return tuple([check_instance(f"each of {what}", value, kind, recipe) for value in values])


def check_mapping(what: str, value: object) -> Mapping[str, Any]:
    """Return a mapping whose keys are text."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{what} must be a dictionary with names as keys, got {shown(value)}")
    return value


def check_callable(what: str, value: object) -> None:
    """Check that a value can be called."""
    if not callable(value):
        raise InputError(f"{what} must be a function, got {shown(value)}")


def check_path(what: str, value: object) -> str:
    """Return the name of a file."""
    path = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(path, str):
        raise InputError(f"{what} must be the path of a file, got {shown(value)}")
    return path


def check_quantity(
    what: str,
    value: object,
    quantity: Quantity,
    allowed: str = "finite",
    within: Callable[[float], bool] | None = None,
) -> float:
    """Return one number in SI, from a number in SI or text with a unit; options as for :func:`check_number`."""
    number = _in_si(what, value, quantity)
    requirement = f"{allowed}, in {quantity.si} or with a unit"
    if isinstance(number, list):
        raise UnitError(f"{what} must be {requirement}, got {len(number)} numbers")
    return check_number(what, number, requirement, within)


def check_quantities(
    what: str, values: object, quantity: Quantity, shape: tuple[int | None, ...] | None = None, needs: str = ""
) -> Array:
    """Return numbers in SI as a read-only copy.

    As :func:`~precision_pin.base.arguments.check_numbers`, but also accepts text with a unit instead of a number
    (``"100 mm"``) or of a row of numbers (``"0 0 100 mm"``).
    """
    return check_numbers(what, _in_si(what, values, quantity), shape, needs)


def _in_si(what: str, value: object, quantity: Quantity) -> object:
    """Return a value with each text in it replaced by its number or numbers in SI."""
    # text that does not begin with a number stays, so that the check of the numbers reports it
    if isinstance(value, list | tuple) and any(isinstance(entry, str | list | tuple) for entry in value):
        return [_in_si(what, entry, quantity) for entry in value]
    if not isinstance(value, str) or not re.match(r"\s*[+-]?\.?[0-9]", value):
        return value
    try:
        numbers = parse_vector(value, quantity)
    except UnitError as error:
        message = error.findings[0].message
        raise UnitError(f"{what.rstrip(',')}: {message}; a plain number is in {quantity.si}") from None
    return numbers if len(numbers) > 1 else numbers[0]
