"""Warnings of public functions by Python's ``warnings``: each line once a call, however many functions take part in it.

A function that users call is marked with :func:`warns_at_end`; whatever runs inside it adds findings with :func:`add`. The
outermost call issues them when it returns, as :class:`~precision_pin.base.errors.PrecisionPinWarning` at the line of the caller.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Final, ParamSpec, TypeVar

from precision_pin.base.errors import Finding, PrecisionPinWarning, is_note

Given = ParamSpec("Given")
Result = TypeVar("Result")

_added: Final[ContextVar[list[str] | None]] = ContextVar("added", default=None)


def add(findings: Iterable[Finding | str]) -> None:
    """Have the call under way warn of findings; without one, nothing is warned of."""
    lines = _added.get()
    if lines is not None:
        lines.extend(line for line in map(str, findings) if not is_note(line))


@contextmanager
def unheard() -> Iterator[None]:
    """Drop what is added in a ``with``: of a part of the poses, of which the call under way warns itself."""
    before = _added.set([])
    try:
        yield
    finally:
        _added.reset(before)


def warns_at_end(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Make a public function emit its warnings, unless another public call is under way, which then emits them."""

    @wraps(function)
    def called(*arguments: Given.args, **options: Given.kwargs) -> Result:
        if _added.get() is not None:
            return function(*arguments, **options)
        lines: list[str] = []
        before = _added.set(lines)
        try:
            result = function(*arguments, **options)
        finally:
            _added.reset(before)
        for line in dict.fromkeys(lines):
            warnings.warn(line, PrecisionPinWarning, stacklevel=2)
        return result

    return called
