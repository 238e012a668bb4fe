"""Writing standard output, files and folders, whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import final

import click

from precision_pin.cli.interrupts import held, undone
from precision_pin.cli.streams import raise_if_output_lost
from precision_pin.errors import OutputError

__all__ = ["Outputs", "PageOutput", "echo_data", "require_writable", "whole_folder", "write_text"]


def echo_data(text: str) -> None:
    """Print data on stdout; that its reader has gone, as ``head`` does, is no error.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    click.echo(text)
    raise_if_output_lost()


@final
@dataclass(frozen=True)
class Outputs:
    """The outputs that a command line asks for.

    Attributes
    ----------
    files
        A name for each option that names a file; None where it is not given, ``-`` for stdout.
    folder
        What ``--out`` names, where that is a folder.
    names
        Patterns of the names that files in the folder get.
    """

    files: Mapping[str, str | None] = field(default_factory=dict)
    folder: str | None = None
    names: Sequence[str] = ()

    def check(self) -> None:
        """Refuse before any work what could not be written at its end; makes nothing.

        Raises
        ------
        OutputError
            A place cannot be written to, or two outputs meet.
        """
        if self.folder is not None:
            if not self.folder:
                raise click.UsageError("--out names no folder")
            require_writable(self.folder, folder=True)
        seen: dict[str, str] = {}
        for option, name in self._named():
            require_writable(name)
            place = _place(name)
            if place in seen:
                raise OutputError(f"{seen[place]} and {option} name the same file")
            seen[place] = option
            if self.folder is None:
                continue
            if place == _place(self.folder):
                raise OutputError(f"{option} and --out name the same place")
            inside = os.path.dirname(place) == _place(self.folder)
            if inside and (option == "--journal" or self._is_ours(os.path.basename(place))):
                raise OutputError(
                    f"cannot write {name} for {option}: it lies in the folder of --out, which has its own files"
                )

    def refuse_inputs(self, inputs: Iterable[str]) -> None:
        """Refuse to write over what was read, by whatever name: through a link, too.

        Raises
        ------
        OutputError
            An output is an input.
        """
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


def _place(path: str | Path) -> str:
    """Return where a name leads in the end.

    Raises
    ------
    OutputError
        That cannot be told.
    """
    try:
        return os.path.realpath(path)
    except (OSError, ValueError) as error:  # the working folder is gone
        raise _unwritable(f"cannot write {path}", error) from None


def _is_same(one: str, other: str) -> bool:
    with suppress(OSError, ValueError):
        return os.path.samefile(one, other)
    return False


def require_writable(path: str | Path, *, folder: bool = False) -> None:
    """Refuse a place to write to before any work is done; makes nothing.

    Raises
    ------
    OutputError
        It is a directory where a file is meant (or the reverse), or cannot be written to.
    """
    target = Path(_place(path))
    if not folder and (os.path.isdir(target) or os.fspath(path).endswith(os.sep)):
        raise OutputError(f"cannot write {path}: it is a folder")
    if folder and os.path.lexists(target) and not os.path.isdir(target):
        raise OutputError(f"cannot write to the folder {path}: it is a file")
    try:
        os.lstat(target)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:  # a name that is too long
        raise _unwritable(f"cannot write {path}", error) from None
    if not folder and os.path.exists(target) and not os.path.isfile(target):
        return  # a device or a pipe
    if not folder and os.path.isfile(target) and not os.access(target, os.W_OK):
        raise OutputError(f"cannot write {path}: the file is read-only")
    home = target if folder else target.parent
    while folder and not os.path.lexists(home):
        home = home.parent
    if not os.path.isdir(home):
        what = "is not a folder" if os.path.lexists(home) else "does not exist"
        raise OutputError(f"cannot write {path}: {home} {what}")
    if not os.access(home, os.W_OK | os.X_OK):
        raise OutputError(f"cannot write {path}: the folder {home} is not writable")


@final
@dataclass(frozen=True)
class PageOutput:
    """A page to write: a file, or ``NAME.html`` in a folder where the name ends in a slash or is that of a folder.

    Attributes
    ----------
    given
        What ``--out`` names.
    name
        The page's name in a folder.
    """

    given: str
    name: str

    @property
    def path(self) -> str:
        """The file."""
        return os.path.join(self.given, self.name) if self._in_folder else self.given

    @property
    def outputs(self) -> Outputs:
        """The same as any command's."""
        if self._in_folder:
            return Outputs(folder=self.given, names=(self.name,))
        return Outputs({"--out": self.given})

    def write(self, text: str) -> None:
        """Write the page, whole or not at all.

        Raises
        ------
        OutputError
            It cannot be written.
        """
        if not self._in_folder:
            write_text(Path(self.given), text)
            return
        with whole_folder(Path(self.given)) as stage:
            write_text(stage / self.name, text)

    @property
    def _in_folder(self) -> bool:
        return self.given.endswith(os.sep) or os.path.isdir(self.given)


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all; through a link, and straight into a device or a pipe.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    target = Path(_place(path))
    # surrogates, which stand for bytes of a file's name that are not UTF-8, become what JSON has for them
    data = text.encode("utf-8", errors="backslashreplace")
    try:
        if os.path.exists(target) and not os.path.isfile(target):
            target.write_bytes(data)
            return
        part = _part(target.parent)
        with undone(part.unlink):
            try:
                part.write_bytes(data)
                part.replace(target)
            except BaseException:
                with suppress(OSError):
                    part.unlink()
                raise
    except (OSError, ValueError) as error:
        raise _unwritable(f"cannot write {path}", error) from None


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a folder for files that appear in ``path`` together once all of them are written, or not at all.

    Raises
    ------
    OutputError
        They cannot be written.
    """
    target = Path(_place(path))
    try:
        missing = [folder for folder in (target, *target.parents) if not os.path.lexists(folder)]
        stage = _part(target)

        def undo() -> None:
            shutil.rmtree(stage, ignore_errors=True)
            for folder in missing:
                with suppress(OSError):
                    folder.rmdir()

        with undone(undo):
            try:
                target.mkdir(parents=True, exist_ok=True)
                stage.mkdir()
                yield stage
                _move_all(stage, target, path)
            except BaseException:
                undo()
                raise
    except OSError as error:
        raise _unwritable(f"cannot write to the folder {path}", error) from None


def _move_all(stage: Path, target: Path, path: Path) -> None:
    files = sorted(stage.iterdir())
    for file in files:
        if (target / file.name).is_dir():
            raise OutputError(f"cannot write {path / file.name}: it is a folder")
    with held():
        for file in files:
            file.replace(target / file.name)
        stage.rmdir()


def _part(folder: Path) -> Path:
    """Return a name in a folder for what is being written."""
    return folder / f".precision-pin-{os.getpid()}-{secrets.token_hex(4)}.part"


def _unwritable(what: str, error: Exception) -> OutputError:
    return OutputError(f"{what}: {getattr(error, 'strerror', None) or error}")
