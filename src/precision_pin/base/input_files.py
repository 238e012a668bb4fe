"""Reading files that users name: regular ones of bounded size, never a pipe or a device.

The names of the files read are recorded, so that no output is written over an input.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Final, Literal

_KERNEL_FOLDERS: Final = (
    "/proc", "/sys", "/sys/fs/cgroup", "/sys/kernel/debug", "/sys/kernel/tracing", "/sys/kernel/security", "/sys/fs/bpf",
)  # fmt: skip
_MIB: Final = 2**20

_noted: Final[ContextVar[list[str] | None]] = ContextVar("noted_inputs", default=None)


@contextmanager
def noted_inputs() -> Iterator[list[str]]:
    """Collect the names of the files that are read inside; yields the list of them."""
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


class UnreadableFileError(Exception):
    """A file cannot be read, or not as text.

    Attributes:
        kind: The cause: the file is missing, no regular file, not readable for this user, too large or not UTF-8, or
            the system refuses to read it.
        reason: Text that follows the file's name in a message: "does not exist", ….
        found: What the path is, if not a regular file: "a directory", …; else empty.
    """

    def __init__(
        self, kind: Literal["missing", "kind", "permission", "size", "text", "system"], reason: str, found: str = ""
    ) -> None:
        super().__init__(reason)
        self.kind = kind
        self.reason = reason
        self.found = found


def read_regular_file(path: str | os.PathLike[str], most_bytes: int) -> bytes:
    """Return the bytes of a regular file.

    Args:
        path: The file; ``~`` is not expanded.
        most_bytes: The largest size that is read.
    """
    note_input(path)
    try:
        _require_regular(os.stat(path))
        # non-blocking and checked again: a pipe may have replaced the file in between
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
        with os.fdopen(descriptor, "rb") as stream:
            _require_regular(os.fstat(stream.fileno()))
            data = stream.read(most_bytes + 1)
    except (FileNotFoundError, NotADirectoryError, ValueError):
        raise UnreadableFileError("missing", "does not exist") from None
    except PermissionError:
        raise UnreadableFileError("permission", "cannot be read: Permission denied") from None
    except OSError as error:  # a loop of symbolic links, a name that is too long, a failing disk
        raise UnreadableFileError("system", f"cannot be read: {error.strerror or error}") from None
    if len(data) > most_bytes:
        size = f"{most_bytes // _MIB} MiB" if most_bytes % _MIB == 0 else f"{most_bytes:,} bytes"
        raise UnreadableFileError("size", f"is larger than {size}")
    return data


def read_text_file(path: str | os.PathLike[str], most_bytes: int) -> str:
    """Return the text of a regular file, UTF-8 with or without a byte order mark, line ends as line feeds."""
    return decode(read_regular_file(path, most_bytes)).replace("\r\n", "\n").replace("\r", "\n")


def decode(data: bytes) -> str:
    """Return the text of a file's bytes, UTF-8 with or without a byte order mark."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableFileError("text", f"is not UTF-8 text (byte {error.start})") from None


def is_regular(status: os.stat_result) -> bool:
    """Return whether this is a file on a disk: no directory, pipe, device or virtual file of the kernel.

    Files below ``/proc`` and ``/sys`` claim to be regular, but their size is unknown and reading them may have effects.
    """
    return stat.S_ISREG(status.st_mode) and status.st_dev not in _virtual_devices()


@cache
def _virtual_devices() -> frozenset[int]:
    """Return the device numbers of the virtual file systems of the kernel."""
    return frozenset(os.stat(folder).st_dev for folder in _KERNEL_FOLDERS if os.path.ismount(folder))


def _require_regular(status: os.stat_result) -> None:
    if not is_regular(status):
        found = _describe_kind(status.st_mode)
        raise UnreadableFileError("kind", f"is not a regular file but {found}", found)


def _describe_kind(mode: int) -> str:
    if stat.S_ISREG(mode):
        return "a file of the kernel (/proc or /sys)"
    if stat.S_ISDIR(mode):
        return "a directory"
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"
