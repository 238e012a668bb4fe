"""Outputs of a command line: options that name files, and ``--out``, a page or a folder."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final, final

import click

from precision_pin.base.errors import OutputError
from precision_pin.base.files import require_writable, resolve, whole_folder, write_text

PAGES: Final = (".html", ".htm")
FILES: Final = (
    *PAGES, ".csv", ".jpeg", ".jpg", ".json", ".pdf", ".png", ".svg", ".txt", ".urdf", ".xml", ".yaml", ".yml", ".zip",
)  # fmt: skip
"""Suffixes that identify a file name given as a folder; any others are part of a folder's name."""


@final
@dataclass(frozen=True)
class Outputs:
    """Outputs of a command line: files by option (``-`` for stdout), folder of ``--out``, patterns of its files."""

    files: Mapping[str, str | None] = field(default_factory=dict)
    folder: str | None = None
    names: Sequence[str] = ()

    def check(self) -> None:
        """Reject unwritable outputs before any work; creates nothing."""
        check_folder_name(self.folder, json="--json" in self.files)
        if self.folder is not None:
            if not self.folder:
                raise click.UsageError("--out names no folder")
            require_writable(self.folder, folder=True)
        seen: dict[str, str] = {}
        for option, name in self._named():
            require_writable(name)
            place = resolve(name)
            if place in seen:
                raise OutputError(f"{seen[place]} and {option} name the same file")
            seen[place] = option
            if self.folder is None:
                continue
            if place == resolve(self.folder):
                raise OutputError(f"{option} and --out name the same place")
            inside = os.path.dirname(place) == resolve(self.folder)
            if inside and (option == "--journal" or self._is_ours(os.path.basename(place))):
                raise OutputError(
                    f"cannot write {name} for {option}: it lies in the folder of --out, whose files are written by name"
                )

    def refuse_inputs(self, inputs: Iterable[str]) -> None:
        """Reject overwriting an input file under any name, links included."""
        outputs = [name for _, name in self._named()]
        if self.folder is not None:
            with suppress(OSError):
                there = sorted(filter(self._is_ours, os.listdir(self.folder)))
                outputs += [os.path.join(self.folder, name) for name in there]
        for output in outputs:
            for one in inputs:
                if _is_same(output, one):
                    raise OutputError(f"cannot write {output}: it is an input of this command; give another name")

    def _named(self) -> list[tuple[str, str]]:
        return [(option, name) for option, name in self.files.items() if name is not None and name != "-"]

    def _is_ours(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self.names)


@final
@dataclass(frozen=True)
class PageOutput:
    """A page to write: the file of ``--out``, or ``name`` in it if it ends in a slash or is a folder."""

    given: str
    name: str

    @property
    def path(self) -> str:
        """The file."""
        return os.path.join(self.given, self.name) if self._in_folder else self.given

    @property
    def outputs(self) -> Outputs:
        """The same as for any command."""
        if self._in_folder:
            return Outputs(folder=self.given, names=(self.name,))
        return Outputs({"--out": self.given})

    def check(self) -> None:
        """Reject an unwritable page before any work; creates nothing."""
        check_page_name(self.given)
        self.outputs.check()

    def write(self, text: str) -> None:
        """Write the page atomically."""
        if not self._in_folder:
            write_text(self.given, text)
            return
        with whole_folder(Path(self.given)) as stage:
            write_text(stage / self.name, text)

    @property
    def _in_folder(self) -> bool:
        return self.given.endswith(os.sep) or os.path.isdir(self.given)


def write_folder(
    folder: str, stem: str, result: Any, figures: Mapping[str, Any], texts: Mapping[str, str] | None = None
) -> None:
    """Write a result's JSON, its figures and texts into the folder of ``--out``, all of them or none."""
    from precision_pin.sampling.figures import save

    with whole_folder(Path(folder)) as stage:
        write_text(stage / f"{stem}.json", result.to_json() + "\n")
        for name, figure in figures.items():
            save(figure, stage / name)
        for name, text in (texts or {}).items():
            write_text(stage / name, text)


def check_page_name(out: str) -> None:
    """Reject a page name that promises another format; a folder, a device or a pipe may have any name."""
    if not out:
        raise OutputError("--out names no file; a page is HTML: --out NAME.html")
    is_file = not os.path.lexists(out) or os.path.isfile(out)
    if is_file and not out.endswith(os.sep) and Path(out).suffix.lower() not in PAGES:
        name = Path(out).with_suffix(PAGES[0])
        raise OutputError(f"cannot write {out}: the page is HTML and its name ends in .html; give --out {name}")


def check_folder_name(out: str | None, *, json: bool) -> None:
    """Reject a folder name that looks like a file; ``json``: whether ``--json`` exists and may be meant."""
    if not out or out.endswith(os.sep) or os.path.lexists(out):
        return
    suffix = Path(out).suffix.lower()
    if suffix in FILES:
        meant = f"for the result in one file give --json {out}" if json and suffix == ".json" else None
        meant = meant or f"give --out {Path(out).with_suffix('')}"
        raise OutputError(f"cannot write to the folder {out}: --out takes a folder, and this names a file; {meant}")


def _is_same(one: str, other: str) -> bool:
    with suppress(OSError, ValueError):
        return os.path.samefile(one, other)
    return False
