"""Reading of files that users name, and atomic writing of files and folders.

Until complete, a file has a temporary name ending in ``.part``; an error or a signal that ends the program removes it.
"""

from __future__ import annotations

import csv
import fcntl
import io
import os
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Final, Literal

from precision_pin.base.errors import OutputError
from precision_pin.base.interrupts import held, undone


def csv_text(headings: Sequence[str], rows: Iterable[Sequence[object]], comments: Iterable[str] = ()) -> str:
    """Return the text of a CSV file: comment lines, a heading row, rows of cells."""
    text = io.StringIO()
    text.writelines(f"# {comment}\n" for comment in comments)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headings)
    writer.writerows(rows)
    return text.getvalue()


def resolve(path: str | os.PathLike[str]) -> str:
    """Return the path with links resolved."""
    with _refused(os.fspath(path)):  # the working folder may be gone
        return os.path.realpath(path)


def require_writable(path: str | os.PathLike[str], *, folder: bool = False) -> None:
    """Raise OutputError if a path cannot be written, before any work is done; creates nothing."""
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
    """Write a UTF-8 file atomically; follows links, and writes directly to a device or pipe."""
    # surrogates, which stand for bytes of a file name that are not UTF-8, are escaped as in JSON
    write_files({path: text.encode("utf-8", errors="backslashreplace")})


def write_files(files: Mapping[str | os.PathLike[str], bytes]) -> None:
    """Write all of the files or none, each as :func:`write_text` does."""
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
    """Yield a folder whose files move to ``path`` together once all are written, or not at all."""
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
    """Lock a folder while files move into it: if two processes write, all files of the last one remain."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def _refused(name: str) -> Iterator[None]:
    """Turn a system error into an OutputError."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise _unwritable(f"cannot write {name}", error) from None


def _part(folder: Path) -> Path:
    """Return a temporary name in a folder for a file being written."""
    return folder / f".precision-pin-{os.getpid()}-{secrets.token_hex(4)}.part"


def _unwritable(what: str, error: Exception) -> OutputError:
    return OutputError(f"{what}: {getattr(error, 'strerror', None) or error}")


# mount points of virtual file systems, see `is_regular`
_KERNEL_FOLDERS: Final = (
    "/proc", "/sys", "/sys/fs/cgroup", "/sys/kernel/debug", "/sys/kernel/tracing", "/sys/kernel/security", "/sys/fs/bpf",
)  # fmt: skip
_MIB: Final = 2**20
"""Bytes of a mebibyte, for messages."""

_noted: Final[ContextVar[list[str] | None]] = ContextVar("noted_inputs", default=None)
"""Files read in the innermost `noted_inputs` block; a context variable, because threads must not mix theirs."""


@contextmanager
def noted_inputs() -> Iterator[list[str]]:
    """Collect the names of the files read in a ``with`` block; yields their list."""
    files: list[str] = []
    token = _noted.set(files)
    try:
        yield files
    finally:
        _noted.reset(token)


def note_input(path: str | os.PathLike[str]) -> None:
    """Add a file to the list of :func:`noted_inputs`, if one is active."""
    files = _noted.get()
    if files is not None:
        files.append(os.fspath(path))


class UnreadableFileError(Exception):
    """A file cannot be read, or not as text.

    Attributes:
        kind: The cause; ``"kind"`` is not a regular file, ``"text"`` not UTF-8, ``"system"`` any other error of the
            system.
        reason: Text that follows the file's name in a message: "does not exist", ….
        found: Kind of a path that is not a regular file: "a directory", …; else empty.
    """

    def __init__(
        self, kind: Literal["missing", "kind", "permission", "size", "text", "system"], reason: str, found: str = ""
    ) -> None:
        super().__init__(reason)
        self.kind = kind
        self.reason = reason
        self.found = found


def read_regular_file(path: str | os.PathLike[str], most_bytes: int) -> bytes:
    """Return the bytes of a regular file of at most ``most_bytes``; ``~`` is not expanded."""
    note_input(path)
    try:
        _require_regular(os.stat(path))
        # non-blocking and checked again: a pipe may have replaced the file in between
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
        with os.fdopen(descriptor, "rb") as stream:
            _require_regular(os.fstat(stream.fileno()))
            data = stream.read(most_bytes + 1)
    except (FileNotFoundError, NotADirectoryError, ValueError):
        raise UnreadableFileError("missing", "does not exist") from None
    except PermissionError:
        raise UnreadableFileError("permission", "cannot be read: Permission denied") from None
    except OSError as error:  # a loop of symbolic links, a name that is too long, a failing disk
        raise UnreadableFileError("system", f"cannot be read: {error.strerror or error}") from None
    if len(data) > most_bytes:
        size = f"{most_bytes // _MIB} MiB" if most_bytes % _MIB == 0 else f"{most_bytes:,} bytes"
        raise UnreadableFileError("size", f"is larger than {size}")
    return data


def read_text_file(path: str | os.PathLike[str], most_bytes: int) -> str:
    """Return the text of a regular UTF-8 file, without byte order mark, line ends as line feeds."""
    return decode(read_regular_file(path, most_bytes)).replace("\r\n", "\n").replace("\r", "\n")


def decode(data: bytes) -> str:
    """Return the text of UTF-8 bytes, without byte order mark."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableFileError("text", f"is not UTF-8 text (byte {error.start})") from None


def is_regular(status: os.stat_result) -> bool:
    """Return whether this is a file on a disk: no directory, pipe, device or virtual file of the kernel."""
    # files below `/proc` and `/sys` claim to be regular, but have no known size, and reading them may have side
    # effects
    return stat.S_ISREG(status.st_mode) and status.st_dev not in _virtual_devices()


@cache
def _virtual_devices() -> frozenset[int]:
    return frozenset(os.stat(folder).st_dev for folder in _KERNEL_FOLDERS if os.path.ismount(folder))


def _require_regular(status: os.stat_result) -> None:
    if not is_regular(status):
        description = _describe_kind(status.st_mode)
        raise UnreadableFileError("kind", f"is not a regular file but {description}", description)


def _describe_kind(mode: int) -> str:
    if stat.S_ISREG(mode):
        return "a file of the kernel (/proc or /sys)"
    if stat.S_ISDIR(mode):
        return "a directory"
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"
