"""The machine in words: processor, cores, versions; no names of hosts, users or folders."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from precision_pin.sampling.workers import available_cores

__all__ = ["described"]

PACKAGES: Final = ("precision-pin", "numpy", "numba", "pin", "roboticstoolbox-python", "openturns", "jax")


def described() -> str:
    """Return one sentence."""
    cores = available_cores()
    found = []
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return (
        f"{_processor()}, {cores} core{'s' if cores > 1 else ''}, {_memory()}{platform.system()}, "
        f"Python {platform.python_version()}, {', '.join(found)}."
    )


def _processor() -> str:
    listed = Path("/proc/cpuinfo")
    lines = listed.read_text(encoding="utf-8").splitlines() if listed.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0]} ({platform.machine()})" if names else platform.processor() or platform.machine()


def _memory() -> str:
    if not hasattr(os, "sysconf") or "SC_PHYS_PAGES" not in os.sysconf_names:
        return ""
    return f"{os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 2**30:.0f} GiB of memory, "
