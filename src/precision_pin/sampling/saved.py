"""The state of a run as bytes, and back."""

from __future__ import annotations

import io
import zipfile
import zlib
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from precision_pin.errors import InputError
from precision_pin.statistics import State

__all__ = ["packed", "unpacked"]


def packed(state: State) -> bytes:
    """Return a state as compressed bytes, without pickles: a journal may come from elsewhere."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **_leaves(state, ""))
    return zlib.compress(buffer.getvalue(), level=1)


def unpacked(data: bytes, pattern: State) -> State:
    """Return the state that was packed; ``pattern`` is one of the same plan, whose fields tell how to read it.

    Raises
    ------
    InputError
        The bytes hold no such state.
    """
    try:
        with np.load(io.BytesIO(zlib.decompress(data)), allow_pickle=False) as arrays:
            found: State = _rebuilt(dict(arrays), pattern, "")
    except (zlib.error, zipfile.BadZipFile, KeyError, ValueError, TypeError, OSError) as error:
        raise InputError(f"the journal's last record cannot be read: {error}") from None
    return found


def _leaves(value: Any, name: str) -> dict[str, Any]:
    """Return arrays and numbers by where they stand in data classes and tuples."""
    leaves: dict[str, Any] = {}
    for key, entry in _parts(value):
        below = f"{name}{key}"
        leaves |= {below: entry} if isinstance(entry, np.ndarray | int) else _leaves(entry, f"{below}.")
    return leaves


def _rebuilt(arrays: dict[str, Any], pattern: Any, name: str) -> Any:
    values = []
    for key, entry in _parts(pattern):
        below = f"{name}{key}"
        match entry:
            case np.ndarray():
                values.append(arrays[below])
            case int():
                values.append(int(arrays[below]))
            case _:
                values.append(_rebuilt(arrays, entry, f"{below}."))
    kind: Any = type(pattern)
    return kind(*values) if is_dataclass(pattern) else kind(values)


def _parts(value: Any) -> list[tuple[str, Any]]:
    if is_dataclass(value):
        return [(field.name, getattr(value, field.name)) for field in fields(value)]
    return [(str(k), entry) for k, entry in enumerate(value)]
