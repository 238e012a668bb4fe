"""Versions of the packages that compute a result."""

from __future__ import annotations

from functools import cache
from importlib import metadata
from platform import python_version


def versions(*further: str) -> dict[str, str]:
    """Return the versions on which a result depends, and of further distributions; ``unknown`` without metadata."""
    names = ("precision-pin", "pin", "numpy", "scipy", "numba", *further)
    return {"python": python_version(), **{name: _version(name) for name in names}}


@cache  # reading a package's metadata takes a millisecond
def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:  # conda's pinocchio or a checkout on the path has no metadata of pip
        return "unknown"
