"""Every array that can be reached from a result by its public attributes, and whether writing into it changes the result."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from precision_pin.base.errors import PrecisionPinError

DEEPEST = 7
Way = tuple[Callable[[Any], Any], ...]


def arrays_of(root: Any) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield the name of each array and what gets it anew from the root, as a user would."""
    seen: set[int] = set()
    kept: list[Any] = []
    waiting: list[tuple[str, Callable[[], Any], int]] = [("", lambda: root, 0)]
    while waiting:
        name, get, depth = waiting.pop()
        value = get()
        if isinstance(value, np.ndarray):
            yield name, get
            continue
        if id(value) in seen or depth > DEEPEST:
            continue
        seen.add(id(value))
        kept.append(value)  # or its id would be given to another
        waiting += [(f"{name}{part}", inner, depth + 1) for part, inner in _parts(value, get)]


def _parts(value: Any, get: Callable[[], Any]) -> Iterator[tuple[str, Callable[[], Any]]]:
    if isinstance(value, tuple | list):
        for k in range(min(len(value), 4)):
            yield f"[{k}]", lambda k=k: get()[k]
    elif isinstance(value, Mapping):
        for key in list(value)[:4]:
            yield f"[{key!r}]", lambda key=key: get()[key]
    elif type(value).__module__.startswith("precision_pin."):
        for name in _attributes(value):
            try:
                getattr(value, name)
            except PrecisionPinError:
                continue
            yield f".{name}", lambda name=name: getattr(get(), name)


def _attributes(value: Any) -> list[str]:
    kind = type(value)
    found = set(vars(value)) if hasattr(value, "__dict__") else set()
    for name in dir(kind):
        attribute = inspect.getattr_static(kind, name)
        if isinstance(attribute, property) or type(attribute).__name__ == "cached_property":
            found.add(name)
    return sorted(name for name in found if not name.startswith("_"))


def changed_by_writing(root: Any) -> list[str]:
    """Return the arrays of a result into which a user can write so that the result itself changes."""
    found = []
    for name, get in arrays_of(root):
        array = get()
        if not array.flags.writeable or not array.size or array.dtype.kind not in "iufb":
            continue
        before = array.copy()
        array.flat[0] = not array.flat[0] if array.dtype.kind == "b" else array.flat[0] + 1
        if not np.array_equal(get(), before, equal_nan=array.dtype.kind == "f"):
            found.append(name)
            array.flat[0] = before.flat[0]
    return found


def bytes_of(root: Any) -> dict[str, bytes]:
    """Return the bytes of every array of a result by its name."""
    return {name: get().tobytes() for name, get in arrays_of(root)}
