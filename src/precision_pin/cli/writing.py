"""What commands write: the standard output, files and folders, whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import click

from precision_pin.cli.interrupts import held, undone
from precision_pin.cli.streams import raise_if_output_lost
from precision_pin.errors import OutputError

__all__ = ["echo_data", "require_writable", "whole_folder", "write_text"]


def echo_data(text: str) -> None:
    """Print data on stdout; that its reader has gone, as ``head`` does, is no error.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    click.echo(text)
    raise_if_output_lost()


def require_writable(path: Path, *, folder: bool = False) -> None:
    """Refuse a place to write to before any work is done; makes nothing.

    Raises
    ------
    OutputError
        It is a directory where a file is meant (or the reverse), or cannot be written to.
    """
    target = Path(os.path.realpath(path))
    if not folder and os.path.isdir(target):
        raise OutputError(f"cannot write {path}: it is a folder")
    if folder and os.path.lexists(target) and not os.path.isdir(target):
        raise OutputError(f"cannot write to the folder {path}: it is a file")
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


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all; through a link, and straight into a device or a pipe.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    target = Path(os.path.realpath(path))
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
    target = Path(os.path.realpath(path))
    try:
        missing = [folder for folder in (target, *target.parents) if not os.path.lexists(folder)]
        stage = _part(target)

        def undo() -> None:
            shutil.rmtree(stage, ignore_errors=True)
            for folder in missing:
                folder.rmdir()

        with undone(undo):
            try:
                target.mkdir(parents=True, exist_ok=True)
                stage.mkdir()
                yield stage
                _move_all(stage, target, path)
            except BaseException:
                with suppress(OSError):
                    undo()
                raise
    except (OSError, ValueError) as error:
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
