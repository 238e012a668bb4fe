"""Opening a file that a user named: a regular file of bounded size, never a pipe or a device."""

from __future__ import annotations

import os
import stat

from precision_pin.input_files import note_input

from .findings import Findings, shown

__all__ = ["read_regular_file"]

MISSING = (FileNotFoundError, NotADirectoryError, ValueError)


def read_regular_file(path: str | os.PathLike[str], findings: Findings, *, most_bytes: int) -> bytes | None:
    """Return the bytes of a regular file, or add a finding and return None.

    Parameters
    ----------
    path
        The file; ``~`` is not expanded.
    findings
        Receives ``E_FILE_MISSING``, ``E_FILE_KIND``, ``E_FILE_PERM`` or ``E_TOO_BIG``.
    most_bytes
        The largest size that is read.
    """
    note_input(path)
    try:
        kind = os.stat(path).st_mode
        if not stat.S_ISREG(kind):
            findings.error("E_FILE_KIND", f"this is {_kind_in_words(kind)}; a regular file is needed")
            return None
        # non-blocking and checked again: the name may have been exchanged for a pipe in between
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
        with os.fdopen(descriptor, "rb") as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                findings.error("E_FILE_KIND", "this is not a regular file any more")
                return None
            data = stream.read(most_bytes + 1)
    except MISSING:
        note = " (~ is not expanded here: write the whole path)" if os.fspath(path).startswith("~") else ""
        findings.error("E_FILE_MISSING", f"there is no file {shown(os.fspath(path))}{note}")
        return None
    except PermissionError:
        findings.error("E_FILE_PERM", "no permission to read this file")
        return None
    except OSError as problem:
        # a loop of symbolic links, a name that is too long, a failing disk
        code = "E_FILE_PERM" if os.path.isfile(path) else "E_FILE_MISSING"
        findings.error(code, f"cannot be read: {problem.strerror}")
        return None
    if len(data) > most_bytes:
        findings.error("E_TOO_BIG", f"the file is over {most_bytes} bytes; the limits can be raised")
        return None
    return data


def _kind_in_words(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "a directory"
    if stat.S_ISFIFO(mode):
        return "a pipe"
    if stat.S_ISSOCK(mode):
        return "a socket"
    return "a device"
