"""Collector of the findings about a file while it is read, which shows the file's own text safely."""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import Final, Literal, final

from precision_pin.base import input_files as files
from precision_pin.base.errors import Finding, nearest
from precision_pin.base.input_files import UnreadableFileError
from precision_pin.base.text_escape import one_line, shown, visible

MOST_FINDINGS = 1000
MOST_NAMES = 6


_CODES: Final = {"missing": "E_FILE_MISSING", "kind": "E_FILE_KIND", "size": "E_TOO_BIG"}


def hint(name: str, valid: Collection[str]) -> str:
    """Return ``"; did you mean …?"``, or an empty text if the search would be slow or pointless."""
    if not valid or len(valid) > 500 or len(name) > 100 or any(len(candidate) > 100 for candidate in valid):
        return ""
    return "; " + nearest(name, valid)


@final
class Findings:
    """Collector of the findings about one file, whose name they carry."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._findings: list[Finding] = []
        self._count: dict[str, int] = {"error": 0, "warning": 0}
        self._groups: dict[tuple[str, str], tuple[int | None, list[str]]] = {}

    @property
    def errors(self) -> int:
        """Number of errors so far."""
        return self._count["error"]

    def add(self, code: str, message: str, line: int | None = None, subjects: tuple[str, ...] = ()) -> None:
        """Add an error (a code ``E_…``) or a warning (``W_…``)."""
        severity = _severity(code)
        self._count[severity] += 1
        if self._count[severity] <= MOST_FINDINGS:
            self._findings.append(Finding(severity, code, one_line(message), self._file, line, subjects))

    def group(self, code: str, message: str, name: str, line: int | None) -> None:
        """Add ``name`` to the one warning of this code and message, which has the line of the first name."""
        if len(self._groups) >= MOST_FINDINGS and (code, message) not in self._groups:
            self._count["warning"] += 1
            return
        names = self._groups.setdefault((code, message), (line, []))[1]
        if not names or names[-1] != name:
            names.append(name)

    def result(self) -> tuple[Finding, ...]:
        """Return all findings in the order of their lines."""
        for (code, message), (line, names) in self._groups.items():
            listed = ", ".join(map(visible, names[:MOST_NAMES]))
            more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
            self.add(code, f"{message} ({listed}{more})", line, tuple(names))
        self._groups = {}
        ordered = sorted(self._findings, key=lambda finding: finding.line or 0)
        for code in ("E_MORE", "W_MORE"):
            severity = _severity(code)
            left_out = self._count[severity] - MOST_FINDINGS
            if left_out > 0:
                message = f"{left_out} more {severity}s are not listed"
                ordered.append(Finding(severity, code, message, self._file))
        return tuple(ordered)


def _severity(code: str) -> Literal["error", "warning"]:
    return "error" if code.startswith("E_") else "warning"


def read_regular_file(path: str | os.PathLike[str], findings: Findings, *, most_bytes: int) -> bytes | None:
    """Return the bytes of a regular file up to a size, or add a finding and return None; ``~`` is not expanded.

    The findings: ``E_FILE_MISSING``, ``E_FILE_KIND``, ``E_FILE_PERM`` and ``E_TOO_BIG``.
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
        findings.add(code, message)
        return None
