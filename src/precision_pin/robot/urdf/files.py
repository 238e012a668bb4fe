"""Opening a file that a user named: a regular file of bounded size, never a pipe or a device."""

from __future__ import annotations

import os
import stat
from functools import cache

from precision_pin.inputs.files import note_input
from precision_pin.robot.urdf.findings import Findings, shown

__all__ = ["is_regular", "read_regular_file"]

KERNEL_FOLDERS = (
    "/proc", "/sys", "/sys/fs/cgroup", "/sys/kernel/debug", "/sys/kernel/tracing", "/sys/kernel/security", "/sys/fs/bpf",
)  # fmt: skip
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
        status = os.stat(path)
        if not is_regular(status):
            findings.error("E_FILE_KIND", f"this is {_kind_in_words(status)}; a regular file is needed")
            return None
        # non-blocking and checked again: the name may have been exchanged for a pipe in between
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
        with os.fdopen(descriptor, "rb") as stream:
            if not is_regular(os.fstat(stream.fileno())):
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


def is_regular(status: os.stat_result) -> bool:
    """Return whether this is a file of a disk: no directory, pipe or device, and nothing that the kernel makes up.

    What lies below ``/proc`` and ``/sys`` claims to be regular, but its size is not known and reading it may have effects.
    """
    return stat.S_ISREG(status.st_mode) and status.st_dev not in _made_up()


@cache
def _made_up() -> frozenset[int]:
    """Return the device numbers of the file systems that the kernel makes up."""
    return frozenset(os.stat(folder).st_dev for folder in KERNEL_FOLDERS if os.path.ismount(folder))


def _kind_in_words(status: os.stat_result) -> str:
    mode = status.st_mode
    if stat.S_ISREG(mode):
        return "a file of the kernel (/proc or /sys)"
    if stat.S_ISDIR(mode):
        return "a directory"
    if stat.S_ISFIFO(mode):
        return "a pipe"
    if stat.S_ISSOCK(mode):
        return "a socket"
    return "a device"
