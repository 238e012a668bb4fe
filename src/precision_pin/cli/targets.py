"""Allowed names for ``--out``: a page or a folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from precision_pin.errors import OutputError

__all__ = ["check_folder_name", "check_page_name"]

PAGES: Final = (".html", ".htm")
FILES: Final = (
    *PAGES, ".csv", ".jpeg", ".jpg", ".json", ".pdf", ".png", ".svg", ".txt", ".urdf", ".xml", ".yaml", ".yml", ".zip",
)  # fmt: skip
"""Suffixes of files, in a name that is meant for a folder; others are part of a folder's name."""


def check_page_name(out: str) -> None:
    """Refuse a name of a page that promises another format; a folder, a device or a pipe may have any name.

    Raises
    ------
    OutputError
        The name is not one of an HTML file.
    """
    if not out:
        raise OutputError("--out names no file; a page is HTML: --out NAME.html")
    is_file = not os.path.lexists(out) or os.path.isfile(out)
    if is_file and not out.endswith(os.sep) and Path(out).suffix.lower() not in PAGES:
        name = Path(out).with_suffix(PAGES[0])
        raise OutputError(f"cannot write {out}: the page is HTML and its name ends in .html; give --out {name}")


def check_folder_name(out: str | None, *, json: bool) -> None:
    """Refuse a name of a folder that is one of a file.

    Parameters
    ----------
    out
        The option's value, None where it is not given.
    json
        Whether the command has ``--json``, which is what a name ending in .json is meant for.

    Raises
    ------
    OutputError
        The name ends as that of a file.
    """
    if not out or out.endswith(os.sep) or os.path.lexists(out):
        return
    suffix = Path(out).suffix.lower()
    if suffix in FILES:
        meant = f"for the result in one file give --json {out}" if json and suffix == ".json" else None
        meant = meant or f"give --out {Path(out).with_suffix('')}"
        raise OutputError(f"cannot write to the folder {out}: --out takes a folder, and this names a file; {meant}")
