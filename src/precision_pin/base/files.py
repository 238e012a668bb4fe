"""Writing files and folders, whole or not at all.

What is written lies beside its place under a name ending in ``.part`` until it is complete; an error or a signal that
ends the program removes it.
"""

from __future__ import annotations

import csv
import fcntl
import io
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from precision_pin.base.errors import OutputError
from precision_pin.base.interrupts import held, undone


def csv_text(headings: Sequence[str], rows: Iterable[Sequence[object]], comments: Iterable[str] = ()) -> str:
    """Return the text of a CSV file: lines of comments, a row of headings, rows of cells."""
    text = io.StringIO()
    text.writelines(f"# {comment}\n" for comment in comments)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows(rows)
    return text.getvalue()


def resolve(path: str | os.PathLike[str]) -> str:
    """Return the path that a name leads to, links resolved."""
    with _refused(os.fspath(path)):  # the working folder may be gone
        return os.path.realpath(path)


def require_writable(path: str | os.PathLike[str], *, folder: bool = False) -> None:
    """Refuse a place to write to before any work is done; makes nothing."""
    target = Path(resolve(path))
    if not folder and (os.path.isdir(target) or os.fspath(path).endswith(os.sep)):
        raise OutputError(f"cannot write {path}: it is a folder")
    if folder and os.path.lexists(target) and not os.path.isdir(target):
        raise OutputError(f"cannot write to the folder {path}: it is a file")
    with _refused(os.fspath(path)), suppress(FileNotFoundError, NotADirectoryError):
        os.lstat(target)  # the name may be too long
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


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a file as UTF-8, whole or not at all; through a link, and straight into a device or a pipe."""
    # surrogates, which stand for bytes of a file's name that are not UTF-8, become what JSON has for them
    write_files({path: text.encode("utf-8", errors="backslashreplace")})


def write_files(files: Mapping[str | os.PathLike[str], bytes]) -> None:
    """Write files all together or none of them, each as :func:`write_text` does."""
    moves: list[tuple[str, Path, Path]] = []

    def undo() -> None:
        for _, part, _ in moves:
            with suppress(OSError):
                part.unlink()

    with undone(undo):
        try:
            for path, data in files.items():
                name = os.fspath(path)
                with _refused(name):
                    target = Path(resolve(path))
                    if os.path.exists(target) and not os.path.isfile(target):
                        target.write_bytes(data)
                        continue
                    part = _part(target.parent)
                    moves.append((name, part, target))
                    part.write_bytes(data)
            with held() if len(moves) > 1 else nullcontext():
                while moves:
                    name, part, target = moves[0]
                    with _refused(name):
                        part.replace(target)
                    del moves[0]
        except BaseException:
            undo()
            raise


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a folder for files that appear in ``path`` together once all of them are written, or not at all."""
    target = Path(resolve(path))
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
    with held(), _alone_in(target):
        for file in files:
            file.replace(target / file.name)
        stage.rmdir()


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Let no other process move its files into a folder meanwhile: of two, the last one's are there, all of them."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def _refused(name: str) -> Iterator[None]:
    """Return the OutputError for a file from an error of the system."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise _unwritable(f"cannot write {name}", error) from None


def _part(folder: Path) -> Path:
    """Return a temporary name in a folder, for a file that is being written."""
    return folder / f".precision-pin-{os.getpid()}-{secrets.token_hex(4)}.part"


def _unwritable(what: str, error: Exception) -> OutputError:
    return OutputError(f"{what}: {getattr(error, 'strerror', None) or error}")
