"""Ctrl-C that is not lost.

A KeyboardInterrupt that falls into a callback of a C library, as compilers have, is printed by the interpreter and
forgotten there; the run would go on. It is remembered here, and raised again where work is counted.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import final

__all__ = ["heeding_interrupts", "raise_if_interrupted"]


@final
class _Handler:
    """What SIGINT calls; remembers that it came."""

    def __init__(self) -> None:
        self.came = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.came = True
        raise KeyboardInterrupt


@contextmanager
def heeding_interrupts() -> Iterator[None]:
    """Remember a Ctrl-C that comes meanwhile; where SIGINT is ignored, as by ``nohup``, it stays so."""
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler or (
        threading.current_thread() is not threading.main_thread()
    ):
        yield
        return
    print_lost = sys.unraisablehook
    handler = _Handler()

    def quiet(lost: sys.UnraisableHookArgs) -> None:
        # the interrupt itself, or what it left half-done in a library
        if not handler.came:
            print_lost(lost)

    signal.signal(signal.SIGINT, handler)
    sys.unraisablehook = quiet
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.unraisablehook = print_lost


def raise_if_interrupted() -> None:
    """Raise KeyboardInterrupt if a Ctrl-C came since :func:`heeding_interrupts` began."""
    handler = signal.getsignal(signal.SIGINT)
    if isinstance(handler, _Handler) and handler.came:
        raise KeyboardInterrupt
