"""What commands write: the standard output, files and folders, whole or not at all."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import click

from precision_pin.errors import OutputError

__all__ = ["echo_data", "require_writable", "whole_folder", "write_text"]


def echo_data(text: str) -> None:
    """Print data on stdout; that its reader has gone, as ``head`` does, is no error.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    try:
        click.echo(text)
    except OSError as error:
        # what is left in the buffer must not be tried again when the interpreter ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            raise OutputError(f"cannot write to the standard output: {error.strerror}") from None


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
    straight = os.path.exists(target) and not os.path.isfile(target)
    part = target if straight else target.with_name(f".precision-pin-{os.getpid()}.part")
    try:
        # surrogates, which stand for bytes of a file's name that are not UTF-8, become what JSON has for them
        part.write_text(text, encoding="utf-8", errors="backslashreplace")
        if not straight:
            part.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        if not straight:
            with suppress(OSError):
                part.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a folder for files that appear in ``path`` together once all of them are written, or not at all.

    Raises
    ------
    OutputError
        They cannot be written.
    """
    target = Path(os.path.realpath(path))
    missing = [folder for folder in (target, *target.parents) if not os.path.lexists(folder)]
    done = False
    try:
        target.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target, prefix=".precision-pin-", suffix=".part") as stage:
            yield Path(stage)
            for file in sorted(Path(stage).iterdir()):
                if (target / file.name).is_dir():
                    raise OutputError(f"cannot write {path / file.name}: it is a folder")
            for file in sorted(Path(stage).iterdir()):
                file.replace(target / file.name)
        done = True
    except OSError as error:
        raise OutputError(f"cannot write to the folder {path}: {error.strerror or error}") from None
    finally:
        if not done:
            with suppress(OSError):
                for folder in missing:
                    folder.rmdir()
