"""Which files are read as inputs: kept for whoever is about to write, so that nothing is written over them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final

__all__ = ["note_input", "noted_inputs"]

_noted: Final[ContextVar[list[str] | None]] = ContextVar("noted_inputs", default=None)


@contextmanager
def noted_inputs() -> Iterator[list[str]]:
    """Yield the list that the names of the files read inside are added to."""
    files: list[str] = []
    token = _noted.set(files)
    try:
        yield files
    finally:
        _noted.reset(token)


def note_input(path: str | os.PathLike[str]) -> None:
    """Add a file to the list of :func:`noted_inputs`, if there is one."""
    files = _noted.get()
    if files is not None:
        files.append(os.fspath(path))
