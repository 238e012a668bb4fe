"""What ``--out`` names: a page, or a folder; refused before any work where the name says something else."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from precision_pin.cli.writing import require_writable
from precision_pin.errors import OutputError

__all__ = ["folder_target", "page_target"]

PAGES: Final = (".html", ".htm")
FILES: Final = (
    *PAGES, ".csv", ".jpeg", ".jpg", ".json", ".pdf", ".png", ".svg", ".txt", ".urdf", ".xml", ".yaml", ".yml", ".zip",
)  # fmt: skip
"""Suffixes of files, in a name that is meant for a folder; others are part of a folder's name."""


def page_target(out: str) -> Path:
    """Return where ``--out`` says that a page goes.

    Raises
    ------
    OutputError
        The name is not one of an HTML file, nor of a device or a pipe, or it cannot be written.
    """
    if not out:
        raise OutputError("--out names no file; a page is HTML: --out NAME.html")
    target = Path(out)
    is_stream = os.path.exists(out) and not os.path.isfile(out) and not os.path.isdir(out)
    if not (is_stream or os.path.isdir(out) or target.suffix.lower() in PAGES):
        name = (target / "page.html") if out.endswith(os.sep) else target.with_suffix(PAGES[0])
        raise OutputError(f"cannot write {out}: the page is HTML and its name ends in .html; give --out {name}")
    require_writable(target)
    return target


def folder_target(out: str, *, json: bool) -> Path:
    """Return the folder that ``--out`` names.

    Parameters
    ----------
    out
        The option's value.
    json
        Whether the command has ``--json``, which is what a name ending in .json is meant for.

    Raises
    ------
    OutputError
        The name is one of a file, or nothing can be written there.
    """
    if not out:
        raise OutputError("--out names no folder")
    target = Path(out)
    suffix = target.suffix.lower()
    if suffix in FILES and not out.endswith(os.sep) and not os.path.lexists(out):
        meant = f"for the result in one file give --json {out}" if json and suffix == ".json" else None
        meant = meant or f"give --out {target.with_suffix('')}"
        raise OutputError(f"cannot write to the folder {out}: --out takes a folder, and this names a file; {meant}")
    require_writable(target, folder=True)
    return target
