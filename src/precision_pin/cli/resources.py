"""Limits of the system on this process's memory, checked before libraries that abort are loaded."""

from __future__ import annotations

import errno
import os
import resource
import threading
from typing import Final

from precision_pin.base.errors import InputError

NEEDED: Final = 10**9
"""Bytes of address space; with less, C++ libraries abort while they are loaded."""

AMPLE: Final = 8 * 10**9
"""Address space below which linear algebra runs without threads, each of which reserves some."""

MOST_TRIED: Final = 128
"""Largest number of threads of linear algebra."""


def require_resources() -> None:
    """Reject limits of address space or threads with which the libraries cannot be loaded."""
    limit = _address_space()
    if limit is not None and limit < NEEDED:
        raise _lack(
            f"the address space is limited to {limit / 1e6:.0f} MB (ulimit -v); at least {NEEDED / 1e6:.0f} MB are needed"
        )
    wanted = min(os.cpu_count() or 1, MOST_TRIED)
    started = _started(wanted)
    if not started:
        raise _lack("the system lets no thread start (a limit of processes or of memory, ulimit -a)")
    if started < wanted or (limit is not None and limit < AMPLE):
        # libraries of linear algebra would send this process a SIGINT if threads are missing
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _started(wanted: int) -> int:
    """Return how many of the wanted threads could be started simultaneously."""
    go = threading.Event()
    threads = [threading.Thread(target=go.wait) for _ in range(wanted)]
    started = 0
    try:
        for thread in threads:
            thread.start()
            started += 1
    except (RuntimeError, MemoryError):
        pass
    finally:
        go.set()
        for thread in threads[:started]:
            thread.join()
    return started


def shortage(error: Exception) -> InputError | None:
    """Return the error about the resource that the system refused, if that was the cause."""
    message = _message(error)
    return None if message is None else _lack(message)


def _lack(message: str) -> InputError:
    return InputError.of("E_RESOURCES", message)


def _message(error: Exception) -> str | None:
    text = str(error).casefold()
    if isinstance(error, MemoryError) or "bad_alloc" in text or "cannot allocate memory" in text:
        return "not enough memory; fewer samples, poses or sources need less"
    if isinstance(error, RuntimeError) and "start new thread" in text:
        return "the system lets no more threads start (a limit of processes or memory); --threads 1 needs the fewest"
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN):
        return f"{error.strerror}; a limit of this system or of this shell (ulimit -a)"
    limit = _address_space()
    if limit is not None and limit < AMPLE:
        # libraries report it in many ways: a segment that cannot be mapped, a function without a result
        what = f"{type(error).__name__}: {error}"
        return f"this does not fit into the address space, which is limited to {limit / 1e6:.0f} MB ({what})"
    return None


def _address_space() -> int | None:
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit
