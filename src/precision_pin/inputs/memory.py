"""How much memory a request may take."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

from precision_pin.errors import InputError

__all__ = ["available_memory", "check_kept", "check_memory"]

_UNCHECKED: Final = 2**28
"""Bytes below which asking what is free takes longer than it is worth."""

_MEMORY: Final = Path("/proc/meminfo")
_LIMIT, _USED = Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")


def available_memory() -> int | None:
    """Return how many bytes this process may still take without swapping; ``None`` where the system does not tell."""
    found = []
    with suppress(OSError, ValueError, StopIteration):
        line = next(line for line in _MEMORY.read_text("ascii").splitlines() if line.startswith("MemAvailable:"))
        found.append(1024 * int(line.split()[1]))
    if not found:
        with suppress(OSError, ValueError):  # not Linux: all there is
            found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    with suppress(OSError, ValueError):  # a container's limit
        found.append(max(int(_LIMIT.read_text("ascii")) - int(_USED.read_text("ascii")), 0))
    return min(found, default=None)


def check_memory(needed: float, what: str, instead: str) -> None:
    """Refuse what takes more memory than is free.

    Parameters
    ----------
    needed
        How many bytes it takes.
    what
        What it is, as "keeping 1,000 samples".
    instead
        What to do.

    Raises
    ------
    InputError
        There is not memory enough.
    """
    available = available_memory() if needed > _UNCHECKED else None
    if available is not None and needed > available:
        raise InputError(
            f"{what} takes {needed / 1e9:,.1f} GB, {available / 1e9:,.1f} GB of memory are free; {instead}"
        )


def check_kept(samples: int) -> None:
    """Refuse to keep more errors, 48 bytes each, than there is memory for.

    Raises
    ------
    InputError
        There is not memory enough.
    """
    most = (available_memory() or 0) // 48
    check_memory(
        48.0 * samples,
        f"keeping {samples:,} samples",
        f"at most {most:,} can be kept (the statistics do not need them)",
    )
