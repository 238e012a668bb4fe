"""Files that are written appear whole or not at all; those that are read are regular, of bounded size, or refused."""

import contextlib
import json
import os
import re
from pathlib import Path
from unittest.mock import Mock

import pytest
from matplotlib.figure import Figure

import precision_pin
import precision_pin as pp
from precision_pin.base import csv_columns
from precision_pin.base.errors import OutputError
from precision_pin.base.files import (
    UnreadableFileError,
    read_regular_file,
    read_text_file,
    whole_folder,
    write_files,
    write_text,
)
from precision_pin.render import result_io as stored
from precision_pin.render.result_io import JsonResult
from precision_pin.robot import urdf
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.trajectory import read_trajectory
from precision_pin.sampling.figures import save

PACKAGE = Path(precision_pin.__file__).parent


def contents(folder: Path) -> dict[str, bytes | None]:
    return {path.name: path.read_bytes() if path.is_file() else None for path in folder.iterdir()}


def test_a_file_is_replaced_whole_and_through_a_link(tmp_path):
    (tmp_path / "old").write_text("old")
    (tmp_path / "link").symlink_to("old")
    write_text(tmp_path / "link", "new \udcff µ")
    assert (tmp_path / "link").is_symlink()
    assert contents(tmp_path) == dict.fromkeys(("old", "link"), "new \\udcff µ".encode())


def test_files_that_belong_together_appear_together(tmp_path, monkeypatch):
    write_files({tmp_path / "a": b"1", tmp_path / "b": b"2"})
    before = contents(tmp_path)
    assert before == {"a": b"1", "b": b"2"}
    whole = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        whole(path, data[:1])
        if data == b"44":
            raise OSError(28, "No space left on device")
        return len(data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError, match=r"cannot write \S*b: No space left"):
        write_files({tmp_path / "a": b"33", tmp_path / "b": b"44"})
    monkeypatch.undo()
    assert contents(tmp_path) == before


def test_what_cannot_be_written_is_one_line_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a").mkdir()
    (tmp_path / "file.txt").write_text("kept")
    for name in ("no/a", "a/", ".", "file.txt/page.html", "x" * 300, "a\0b"):
        for place in (name, os.path.join(tmp_path, name)):
            with pytest.raises(OutputError, match="error E_OUTPUT: cannot write ") as refused:
                write_text(place, "text")
            assert "\n" not in str(refused.value)
    assert contents(tmp_path) == {"a": None, "file.txt": b"kept"}


def test_a_device_is_written_straight_into():
    write_text(os.devnull, "text")


def test_a_figure_without_its_place_leaves_neither_file(tmp_path):
    with pytest.raises(OutputError, match=r"cannot write \S*none/f.png: No such file or directory"):
        save(Figure(), tmp_path / "none" / "f")
    (tmp_path / "f.svg").mkdir()
    with pytest.raises(OutputError, match=r"f.svg: Is a directory"):
        save(Figure(), tmp_path / "f")
    assert contents(tmp_path) == {"f.svg": None}


def test_files_of_a_folder_that_is_not_finished_do_not_appear(tmp_path):
    with contextlib.suppress(ZeroDivisionError), whole_folder(tmp_path / "new" / "out") as stage:
        write_text(stage / "a", "text")
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_one_module_writes_files():
    writing = re.compile(r"\b(os|part|temporary|file)\.replace\(|\.write_(text|bytes)\(|mkstemp|NamedTemporaryFile")
    found = {
        str(path.relative_to(PACKAGE)) for path in PACKAGE.rglob("*.py") if writing.search(path.read_text("utf-8"))
    }
    # export writes into a folder of whole_folder; the journal stays open and locked, its records are forced to the disk
    assert found - {"writers/as_built.py", "sampling/journal.py", "pages/view/page.py"} == {"base/files.py"}


def test_a_failed_write_leaves_the_old_page_and_a_new_one_is_as_readable_as_any(tmp_path, monkeypatch):
    target = tmp_path / "page.html"
    target.write_text("old")

    full = Mock(side_effect=OSError(28, "No space left on device"))
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", full)
        with pytest.raises(OutputError, match="No space left on device"):
            write_text(target, "new")
    assert contents(tmp_path) == {"page.html": b"old"}
    write_text(str(tmp_path / "new.html"), "text")
    assert (tmp_path / "new.html").stat().st_mode == target.stat().st_mode


SAID = {
    "pipe": "is not a regular file but a pipe",
    "folder": "is not a regular file but a directory",
    "zero": "is not a regular file but a device",
    "kernel": "is not a regular file but a file of the kernel",
    "binary": r"is not UTF-8 text \(byte 0\)",
    "loop": "cannot be read: Too many levels of symbolic links",
    "none": "does not exist",
    "a\0b": "does not exist",
    "x" * 300: "cannot be read: File name too long",
}


def test_what_is_no_regular_text_is_refused_at_once_by_every_reader(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "binary").write_bytes(b"\x80\x00PNG")
    for name, target in (("zero", "/dev/zero"), ("kernel", "/proc/version"), ("loop", "loop")):
        (tmp_path / name).symlink_to(target)
    chain = pp.ErrorModel.load(PAPER_SHEET).chain
    for name, said in SAID.items():
        file = os.path.join(tmp_path, name)
        for read in (JsonResult.load, csv_columns.read, lambda file: read_trajectory(file, chain, 10)):
            with pytest.raises(pp.InputError, match=said) as refused:
                read(file)
            assert "\n" not in str(refused.value)
        with pytest.raises(pp.InputError):
            urdf.read(file)


def test_a_result_cut_short_or_too_large_is_refused_in_one_line(tmp_path, monkeypatch):
    for text in ("", '{"schema": "precision-pin/budget/1", "poses": [', "\0" * 100):
        (tmp_path / "r.json").write_text(text)
        with pytest.raises(pp.InputError, match=r"r.json is no JSON, so no result was saved there$"):
            JsonResult.load(tmp_path / "r.json")
    (tmp_path / "r.json").write_text(json.dumps({"schema": "precision-pin/budget/1"}))
    monkeypatch.setattr(stored, "LARGEST_FILE", 8)
    with pytest.raises(pp.InputError, match=r"r.json: it is larger than 8 bytes"):
        JsonResult.load(tmp_path / "r.json")
    (tmp_path / "large").write_bytes(b"0" * (2**20 + 1))
    with pytest.raises(UnreadableFileError, match="is larger than 1 MiB"):
        read_regular_file(tmp_path / "large", 2**20)


def test_text_has_no_byte_order_mark_and_plain_line_ends(tmp_path):
    (tmp_path / "t").write_bytes("\ufeffa\r\nb\rc\n".encode())
    assert read_text_file(tmp_path / "t", 100) == "a\nb\nc\n"
