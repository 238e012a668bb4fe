"""Limits on the memory that a request may use."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from precision_pin.base.errors import InputError

_UNCHECKED: Final = 2**28
"""Requests below this many bytes are not checked, because the check takes longer than it is worth."""

_MEMORY: Final = Path("/proc/meminfo")
_GROUPS, _OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def available_memory() -> int | None:
    """Return the bytes that this process can still allocate without swapping; ``None`` if the system does not say."""
    found = []
    with suppress(OSError, ValueError, StopIteration):
        line = next(line for line in _MEMORY.read_text("ascii").splitlines() if line.startswith("MemAvailable:"))
        found.append(1024 * int(line.split()[1]))
    if not found:
        with suppress(OSError, ValueError):  # not Linux: all physical memory
            found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit, used in _group_files():
        with suppress(OSError, ValueError):  # no such group, or one without a limit
            found.append(max(int(limit.read_text("ascii")) - int(used.read_text("ascii")), 0))
    return min(found, default=None)


def _group_files() -> Iterator[tuple[Path, Path]]:
    """Yield the files with the limit and the usage of this process's control group and of each group above it."""
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
    """Refuse a request that needs more memory than is free.

    Args:
        needed: Bytes that the request needs.
        what: Text for the request, such as "keeping 1,000 samples".
        instead: Text for the alternative.
    """
    available = available_memory() if needed > _UNCHECKED else None
    if available is not None and needed > available:
        message = f"{what} takes {needed / 1e9:,.1f} GB, {available / 1e9:,.1f} GB of memory are free; {instead}"
        raise InputError(message)


def check_kept(samples: int) -> None:
    """Refuse to keep more pose errors, 48 bytes each, than fit into memory."""
    instead = f"at most {(available_memory() or 0) // 48:,} can be kept (the statistics do not need them)"
    check_memory(48.0 * samples, f"keeping {samples:,} samples", instead)
