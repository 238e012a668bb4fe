"""Signals that end the program: Ctrl-C, ``kill``, closing the terminal. No partial file remains.

A signal ends the process at once, with exit code 128 + its number, after partial files are removed and child processes
killed. It raises no exception, because an exception raised inside an import or a compiler's callback is lost or turned
into another. KeyboardInterrupt is raised only while results must be saved (:func:`unwinding`); in a compiler or
finaliser, after it has returned (:func:`raise_if_interrupted`). If the process does not end, or a library prevents it
from reacting, a thread ends it after some seconds. The program imports this module first, so it imports almost nothing.
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
"""Seconds until the thread ends a process that does not react to a signal, and one that still saves results.

A shorter patience would cut off clean-up on a busy machine; after a longer one, users press Ctrl-C again.
"""

_LOSING: Final = (f"{os.sep}llvmlite{os.sep}", f"{os.sep}numba{os.sep}", "weakref")
"""Parts of file names whose functions are called back from C, where an exception is printed and lost."""


class _State:
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
    """Install handlers; leave signals that are ignored (``nohup``) or already handled as they are."""
    global _state
    _state = _State()
    for number, default in (
        (signal.SIGINT, signal.default_int_handler),
        (signal.SIGTERM, signal.SIG_DFL),
        (signal.SIGHUP, signal.SIG_DFL),
    ):
        if signal.getsignal(number) is default:
            try:
                signal.signal(number, _heed)
            except ValueError:  # not the main thread
                return
            _state.taken.append(number)


def begin() -> None:
    """Start the thread that ends the process if it does not react to a signal."""
    if not _state.taken:
        return
    import threading

    reading, writing = os.pipe()
    try:
        threading.Thread(target=_watch, args=(reading,), daemon=True, name="signals").start()
    except RuntimeError:  # no more threads; code that needs one reports it
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
    """Return the number of the received signal, 0 if none."""
    return _state.number


def raise_if_interrupted() -> None:
    """Raise KeyboardInterrupt if a signal's exception was lost."""
    if _state.number:
        raise KeyboardInterrupt


@contextmanager
def unwinding() -> Iterator[None]:
    """Let signals raise KeyboardInterrupt inside; a second one ends the process at once."""
    _state.unwinding = True
    yield
    # only reached without an exception: cleaning up after one must not be cut short
    _state.unwinding = False


@contextmanager
def held() -> Iterator[None]:
    """Defer signals to the end of the block: for short work that must not be interrupted."""
    _state.held += 1
    try:
        yield
    finally:
        _state.held -= 1
    if _state.number and not _state.held and not _state.over:
        _leave()


@contextmanager
def undone(undo: Callable[[], None]) -> Iterator[None]:
    """Call ``undo`` if a signal ends the process inside the block; enter it before the work begins.

    ``undo`` must cope with any state of the work and repeated calls; its OSErrors are ignored.
    """
    key = object()
    _state.undo[key] = undo
    try:
        yield
    finally:
        _state.undo.pop(key, None)


def _heed(number: int, frame: FrameType | None) -> None:
    again, _state.number = _state.number, _state.number or number
    if _state.held:
        return
    files, names = _running(frame)
    # libraries turn an exception raised during an import into another one
    if again or not _state.unwinding or "<frozen importlib._bootstrap>" in files:
        _leave()
    if "__del__" in names or any(part in file for part in _LOSING for file in files):
        return
    raise KeyboardInterrupt


def _running(frame: FrameType | None) -> tuple[set[str], set[str]]:
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
    # the pipe stays open: the interpreter complains if it cannot write a further signal to it
    deadline = time.monotonic() + (LONG_PATIENCE if _state.unwinding else PATIENCE)
    while time.monotonic() < deadline or _state.held:
        time.sleep(0.05)
        if _state.over:
            return
    _state.number = _state.number or number[0]
    _leave()


def _leave() -> None:
    while _state.leaving:  # another thread is ending the process
        signal.pause()
    _state.leaving = True
    with suppress(ValueError):  # not the main thread, whose handler waits for this thread
        for number in _state.taken:
            signal.signal(number, signal.SIG_IGN)
    _end_processes()
    for undo in list(_state.undo.values()):
        with suppress(OSError):
            undo()
    with suppress(OSError):
        # a progress bar may be on the line
        os.write(2, b"\n" * os.isatty(2) + NAMES[_state.number].encode() + b"\n")
    os._exit(128 + _state.number)


def _end_processes() -> None:
    """Kill the worker processes, which would otherwise end later."""
    with suppress(Exception):  # the signal may have interrupted the very functions called here
        if "multiprocessing.process" in sys.modules:
            import multiprocessing

            for process in multiprocessing.active_children():
                process.kill()
                process.join(1)
