"""What the system may refuse: standard output and error that are full, closed or gone; memory and threads.

Errors of the streams are kept until requested, instead of surfacing in every print, in libraries and at exit. A message that
cannot be shown is ignored; data that cannot be written is an error, unless the reader has closed the stream, as
``head`` does, or there never was one.
"""

from __future__ import annotations

import errno
import io
import os
import re
import resource
import select
import sys
import textwrap
import threading
from contextlib import suppress
from typing import Any, Final, TextIO

import click

from precision_pin.base.errors import InputError, OutputError, one_line

_USUAL_COLUMNS: Final = 80
"""Of a terminal that does not report its size."""
_SAID: Final = f"{__name__}.said"
"""Rows of messages of the running command."""

_VALUE: Final = re.compile(
    r" (?=-?[\d.]+(?:°|[,)]| ?mm\b| ?m\b))|(?<=[\d.]) (?=(?:%|mm|mrad|m|°)(?:[^\w]|$))|(?<=\|) (?=-?\d)"
)
"""The blank between a joint or symbol and its value, and between a number and its unit."""


class _Tolerant(io.RawIOBase):
    """A descriptor that discards everything after the first failed write."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.error: OSError | None = None
        self.is_reported = False

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        while self.error is None:
            try:
                return os.write(self._descriptor, view)
            except BlockingIOError:
                select.select([], [self._descriptor], [])
            except OSError as error:
                self.error = error
        return len(view)

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)


def prepare_streams() -> None:
    """Make stdout and stderr escape characters that they cannot encode."""
    for descriptor in range(3):
        # a file opened later must not get the descriptor of a stream, to which libraries write
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, io.TextIOWrapper(io.BufferedWriter(_Tolerant(descriptor)), "utf-8"))
        elif type(stream) is io.TextIOWrapper and not isinstance(getattr(stream.buffer, "raw", None), _Tolerant):
            with suppress(OSError):
                if stream.fileno() == descriptor:
                    # stderr unbuffered, as before: what clears a progress bar does not end in a line feed
                    lines = stream.line_buffering or name == "stderr"
                    raw = _Tolerant(descriptor)
                    setattr(sys, name, io.TextIOWrapper(io.BufferedWriter(raw), stream.encoding, line_buffering=lines))
        if isinstance(getattr(sys, name), io.TextIOWrapper):
            # names may contain characters that the terminal cannot show, which is no reason to stop
            getattr(sys, name).reconfigure(errors="backslashreplace")


def say(line: str) -> None:
    """Print a line on stderr; a name in it cannot break it, only the width of a terminal can."""
    text = messages(one_line(line))
    click.echo(text, err=True)
    context = click.get_current_context(silent=True)
    if context is not None and count_columns(sys.stderr) is not None:
        context.meta[_SAID] = context.meta.get(_SAID, 0) + text.count("\n") + 1


def messages(text: str) -> str:
    """Return lines as stderr shows them: short paths of package files, wrapped at words on a terminal."""
    from precision_pin.robot.examples import named_briefly  # late: --help needs it not

    return "\n".join(wrapped(line, sys.stderr) for line in named_briefly(text).split("\n"))


def count_columns(stream: TextIO) -> int | None:
    """Return the number of columns of a stream's terminal, None if the stream goes elsewhere."""
    if not stream.isatty():
        return None
    with suppress(OSError, ValueError):
        return os.get_terminal_size(stream.fileno()).columns or _USUAL_COLUMNS
    return _USUAL_COLUMNS


def count_rows(stream: TextIO) -> int:
    """Return the rows of a stream's terminal that remain below the messages of the running command."""
    rows = 24
    with suppress(OSError, ValueError):
        rows = os.get_terminal_size(stream.fileno()).lines or rows
    context = click.get_current_context(silent=True)
    return rows - (0 if context is None else context.meta.get(_SAID, 0))


def wrapped(line: str, stream: TextIO, most: int | None = None) -> str:
    """Return a line wrapped at words to a stream's terminal and at most ``most`` columns; a value keeps its unit."""
    columns = min(count_columns(stream) or len(line), most or len(line))
    if len(line) <= columns:
        return line
    indent = " " * (len(line) - len(line.lstrip()))
    text = textwrap.fill(
        _VALUE.sub("\N{NO-BREAK SPACE}", line), columns, subsequent_indent=f"{indent}  ", break_long_words=False,
        break_on_hyphens=False,
    )  # fmt: skip
    return text.replace("\N{NO-BREAK SPACE}", " ")


def echo_data(text: str) -> None:
    """Print data on stdout; a reader that closes early, as ``head`` does, is not an error."""
    click.echo(text)
    raise_if_output_lost()


def raise_if_output_lost() -> None:
    """Raise the first error of the standard output, once, unless its reader has closed it."""
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    if not isinstance(raw, _Tolerant) or raw.is_reported:
        return
    if raw.error is not None and not isinstance(raw.error, BrokenPipeError):
        raw.is_reported = True
        raise OutputError(f"cannot write to the standard output: {raw.error.strerror}")


NEEDED: Final = 10**9
"""Bytes of address space; with less, C++ libraries abort while they are loaded."""

AMPLE: Final = 8 * 10**9
"""Address space below which linear algebra runs without threads, each of which reserves some."""


def require_resources() -> None:
    """Reject limits of address space or threads with which the libraries cannot be loaded."""
    limit = _address_space()
    if limit is not None and limit < NEEDED:
        raise InputError.of(
            "E_RESOURCES",
            f"the address space is limited to {limit / 1e6:.0f} MB (ulimit -v); at least {NEEDED / 1e6:.0f} MB are needed",
        )
    wanted = min(os.cpu_count() or 1, 128)  # linear algebra starts no more threads
    started = _started(wanted)
    if not started:
        raise InputError.of(
            "E_RESOURCES", "the system lets no thread start (a limit of processes or of memory, ulimit -a)"
        )
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
    text, limit = str(error).casefold(), _address_space()
    if isinstance(error, MemoryError) or "bad_alloc" in text or "cannot allocate memory" in text:
        message = "not enough memory; fewer samples, poses or sources need less"
    elif isinstance(error, RuntimeError) and "start new thread" in text:
        message = "the system lets no more threads start (a limit of processes or memory); --threads 1 needs the fewest"
    elif isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN):
        message = f"{error.strerror}; a limit of this system or of this shell (ulimit -a)"
    elif isinstance(error, FileNotFoundError) and os.stat(os.curdir).st_nlink == 0:
        message = "the working folder no longer exists; run this in another one"
    elif limit is not None and limit < AMPLE:
        # libraries report it in many ways: a segment that cannot be mapped, a function without a result
        what = f"{type(error).__name__}: {error}"
        message = f"this does not fit into the address space, which is limited to {limit / 1e6:.0f} MB ({what})"
    else:
        return None
    return InputError.of("E_RESOURCES", message)


def _address_space() -> int | None:
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit
