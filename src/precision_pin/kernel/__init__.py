"""The compiled sampler: loops over arrays, and what lays models out for them.

The functions of :mod:`precision_pin.kernel.sampler` that the documentation shows are found here too. They are imported
when they are first used: who only compiles the loops needs no robot.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, Final

_SAMPLER: Final = ("BLOCK", "compile_table", "errors", "sample", "to_arrays", "warm_up")


def __getattr__(name: str) -> Any:
    if name in _SAMPLER:
        return getattr(import_module(f"{__name__}.sampler"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
