"""Signals that end the program: Ctrl-C, ``kill`` and the end of a terminal. Nothing half-written stays behind.

Such a signal ends the process at once, by the exit code 128 + its number, after what was being written is removed and
processes of our own are ended. No exception is raised for it: one that falls into a library's import, or into a callback
of a compiler, is lost there or comes out as another. Only where something is to be kept (:func:`unwinding`) is
KeyboardInterrupt raised, in a compiler or a finaliser once it is done (:func:`raise_if_interrupted`); where that does not
end the process either, or the signal cannot be heeded because the process
is deep in a library, a thread ends it after some seconds.

This is the first module that the program imports, and it imports next to nothing.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Final

NAMES: Final[dict[int, str]] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}
"""The message of each signal that is handled."""

PATIENCE: Final = 1.0
LONG_PATIENCE: Final = 15.0
"""Seconds after which a signal ends the process although it does something else; the second, while it unwinds."""

_LOSING: Final = (f"{os.sep}llvmlite{os.sep}", f"{os.sep}numba{os.sep}", "weakref")
"""Parts of the names of files whose functions C calls back: an exception is printed there, and lost."""


class _State:
    """State of signal handling; signals come to a process, not to an object of it."""

    def __init__(self) -> None:
        self.number = 0
        self.unwinding = False
        self.held = 0
        self.leaving = False
        self.over = False
        self.taken: list[int] = []
        self.wakeup = -1
        self.undo: dict[object, Callable[[], None]] = {}


_state = _State()


def take_over() -> None:
    """Heed signals from now on; one that is ignored, as by ``nohup``, or that has a handler already, stays so."""
    global _state
    _state = _State()
    for number, usual in (
        (signal.SIGINT, signal.default_int_handler),
        (signal.SIGTERM, signal.SIG_DFL),
        (signal.SIGHUP, signal.SIG_DFL),
    ):
        if signal.getsignal(number) is usual:
            try:
                signal.signal(number, _heed)
            except ValueError:  # not the main thread
                return
            _state.taken.append(number)


def begin() -> None:
    """Start the thread that ends the process where it does not heed a signal itself."""
    if not _state.taken:
        return
    import threading

    reading, writing = os.pipe()
    try:
        threading.Thread(target=_watch, args=(reading,), daemon=True, name="signals").start()
    except RuntimeError:  # no more threads; what needs them says so
        os.close(reading)
        os.close(writing)
        return
    _state.wakeup = writing
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)


def end() -> None:
    """Ignore signals from now on: the work is complete and the exit code is fixed."""
    _state.over = True
    for number in _state.taken:
        signal.signal(number, signal.SIG_IGN)
    if _state.wakeup >= 0:
        signal.set_wakeup_fd(-1)
        os.close(_state.wakeup)
        _state.wakeup = -1


def came() -> int:
    """Return the number of the signal that came, 0 if none did."""
    return _state.number


def raise_if_interrupted() -> None:
    """Raise KeyboardInterrupt if a signal came whose exception was lost."""
    if _state.number:
        raise KeyboardInterrupt


@contextmanager
def unwinding() -> Iterator[None]:
    """Let signals raise KeyboardInterrupt inside; a second one ends the process at once."""
    _state.unwinding = True
    yield
    # once one has come, or anything else was raised, the way out is not to be cut short
    _state.unwinding = False


@contextmanager
def held() -> Iterator[None]:
    """Defer a signal to the end of the block: for short work that must not be cut."""
    _state.held += 1
    try:
        yield
    finally:
        _state.held -= 1
    if _state.number and not _state.held and not _state.over:
        _leave()


@contextmanager
def undone(undo: Callable[[], None]) -> Iterator[None]:
    """Undo the work of the block if a signal ends the process; enter it before the work begins.

    Args:
        undo: Called in any state of what is begun, perhaps more than once; OSError is passed over.
    """
    key = object()
    _state.undo[key] = undo
    try:
        yield
    finally:
        _state.undo.pop(key, None)


def _heed(number: int, frame: FrameType | None) -> None:
    """Handle a signal, in the main thread."""
    again, _state.number = _state.number, _state.number or number
    if _state.held:
        return
    files, names = _running(frame)
    # libraries make other exceptions of one that is raised in an import
    if again or not _state.unwinding or "<frozen importlib._bootstrap>" in files:
        _leave()
    if "__del__" in names or any(part in file for part in _LOSING for file in files):
        return
    raise KeyboardInterrupt


def _running(frame: FrameType | None) -> tuple[set[str], set[str]]:
    """Return the files and the names of the functions that are running."""
    files, names = set(), set()
    while frame is not None:
        files.add(frame.f_code.co_filename)
        names.add(frame.f_code.co_name)
        frame = frame.f_back
    return files, names


def _watch(reading: int) -> None:
    """Wait for a signal, and then for the process to end."""
    import time

    number = os.read(reading, 1)
    if not number:
        os.close(reading)
        return
    # it stays open: the interpreter complains where a further signal cannot be written to it
    deadline = time.monotonic() + (LONG_PATIENCE if _state.unwinding else PATIENCE)
    while time.monotonic() < deadline or _state.held:
        time.sleep(0.05)
        if _state.over:
            return
    _state.number = _state.number or number[0]
    _leave()


def _leave() -> None:
    """End the process."""
    while _state.leaving:  # in another thread, which ends this one
        signal.pause()
    _state.leaving = True
    for number in _state.taken:
        try:
            signal.signal(number, signal.SIG_IGN)
        except ValueError:  # not the main thread; its handler waits for this one
            break
    _end_processes()
    for undo in list(_state.undo.values()):
        with suppress(OSError):
            undo()
    with suppress(OSError):
        # a progress bar may be on the line
        os.write(2, b"\n" * os.isatty(2) + NAMES[_state.number].encode() + b"\n")
    os._exit(128 + _state.number)


def _end_processes() -> None:
    """Kill the processes that compute for this one; they would end by themselves, but later."""
    with suppress(Exception):  # it may have been interrupted anywhere, in what is called here too
        if "multiprocessing.process" in sys.modules:
            import multiprocessing

            for process in multiprocessing.active_children():
                process.kill()
                process.join(1)
