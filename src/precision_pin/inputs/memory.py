"""Limits on the memory that a request may take."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from precision_pin.errors import InputError

__all__ = ["available_memory", "check_kept", "check_memory"]

_UNCHECKED: Final = 2**28
"""Bytes below which asking what is free takes longer than it is worth."""

_MEMORY: Final = Path("/proc/meminfo")
_GROUPS, _OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def available_memory() -> int | None:
    """Return how many bytes this process may still take without swapping; ``None`` where the system does not tell."""
    found = []
    with suppress(OSError, ValueError, StopIteration):
        line = next(line for line in _MEMORY.read_text("ascii").splitlines() if line.startswith("MemAvailable:"))
        found.append(1024 * int(line.split()[1]))
    if not found:
        with suppress(OSError, ValueError):  # not Linux: all there is
            found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit, used in _group_files():
        with suppress(OSError, ValueError):  # no such group, or one without a limit
            found.append(max(int(limit.read_text("ascii")) - int(used.read_text("ascii")), 0))
    return min(found, default=None)


def _group_files() -> Iterator[tuple[Path, Path]]:
    """Yield where the limit of this process's control group and of each above it stand, and what they have taken."""
    lines = []
    with suppress(OSError, ValueError):
        lines = _OWN_GROUPS.read_text("utf-8").splitlines()
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        home = _GROUPS / "memory" if controllers else _GROUPS
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes") if controllers else ("memory.max", "memory.current")
        group = home / path.lstrip("/")
        for folder in (group, *group.parents):
            if folder.is_relative_to(home):
                yield folder / names[0], folder / names[1]


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
