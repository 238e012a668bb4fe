"""Reader of a file that a user named: a regular file of bounded size, never a pipe or a device."""

from __future__ import annotations

import os
from typing import Final

from precision_pin.base import input_files as files
from precision_pin.base.input_files import UnreadableFileError
from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.findings import Findings

_CODES: Final = {"missing": "E_FILE_MISSING", "kind": "E_FILE_KIND", "size": "E_TOO_BIG"}


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
    try:
        return files.read_regular_file(path, most_bytes)
    except UnreadableFileError as error:
        name = os.fspath(path)
        code = _CODES.get(error.kind, "E_FILE_PERM")
        message = error.reason
        match error.kind:
            case "missing":
                note = " (~ is not expanded here: write the whole path)" if name.startswith("~") else ""
                message = f"there is no file {shown(name)}{note}"
            case "kind":
                message = f"this is {error.found}; a regular file is needed"
            case "permission":
                message = "no permission to read this file"
            case "size":
                message = f"the file is over {most_bytes} bytes; the limits can be raised"
            case _:
                code = "E_FILE_PERM" if os.path.isfile(path) else "E_FILE_MISSING"
        findings.error(code, message)
        return None
