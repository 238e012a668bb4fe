"""Compiled sampler: loops over arrays, and the conversion of error models to these arrays.

Functions of :mod:`precision_pin.kernel.sampler` that the documentation shows are available here, imported on first use,
so that a process that only compiles the loops does not import the robot model.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, Final

_SAMPLER: Final = ("BLOCK", "errors", "sample", "to_arrays", "warm_up")


def __getattr__(name: str) -> Any:
    if name in _SAMPLER:
        return getattr(import_module(f"{__name__}.sampler"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
