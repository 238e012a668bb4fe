"""Files appear whole or not at all, several of them together, and only one module writes them."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import precision_pin
from precision_pin.base.errors import OutputError
from precision_pin.base.files import whole_folder, write_files, write_text
from precision_pin.sampling.figures import save

PACKAGE = Path(precision_pin.__file__).parent


def test_a_file_is_replaced_whole_and_through_a_link(tmp_path):
    (tmp_path / "old").write_text("old")
    (tmp_path / "link").symlink_to("old")
    write_text(tmp_path / "link", "new \udcff µ")
    assert (tmp_path / "old").read_text(encoding="utf-8") == "new \\udcff µ"
    assert (tmp_path / "link").is_symlink()
    assert len(list(tmp_path.iterdir())) == 2


def test_files_that_belong_together_appear_together(tmp_path, monkeypatch):
    write_files({tmp_path / "a": b"1", tmp_path / "b": b"2"})
    assert [(tmp_path / name).read_bytes() for name in "ab"] == [b"1", b"2"]
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
    assert [(tmp_path / name).read_bytes() for name in "ab"] == [b"1", b"2"]
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("name", ["no/a", "a/", "x" * 300, "a\0b"])
def test_what_cannot_be_written_is_one_line_and_leaves_nothing(tmp_path, name):
    (tmp_path / "a").mkdir()
    with pytest.raises(OutputError, match="error E_OUTPUT: cannot write /") as refused:
        write_text(os.path.join(tmp_path, name), "text")
    assert "\n" not in str(refused.value)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_device_is_written_straight_into():
    write_text(os.devnull, "text")


def test_a_figure_without_its_place_leaves_neither_file(tmp_path):
    with pytest.raises(OutputError, match=r"cannot write \S*none/f.png: No such file or directory"):
        save(Figure(), tmp_path / "none" / "f")
    (tmp_path / "f.svg").mkdir()
    with pytest.raises(OutputError, match=r"f.svg: Is a directory"):
        save(Figure(), tmp_path / "f")
    assert [path.name for path in tmp_path.iterdir()] == ["f.svg"]


def test_files_of_a_folder_that_is_not_finished_do_not_appear(tmp_path):
    def begin() -> None:
        with whole_folder(tmp_path / "new" / "out") as stage:
            write_text(stage / "a", "text")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        begin()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_one_module_writes_files():
    writing = re.compile(r"\b(os|part|temporary|file)\.replace\(|\.write_(text|bytes)\(|mkstemp|NamedTemporaryFile")
    found = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if writing.search(path.read_text("utf-8"))
    }
    # export writes into a folder of whole_folder; the journal stays open and locked, its records are forced to the disk
    assert found - {"cli/export.py", "sampling/journal.py", "pages/view/page.py"} == {"base/files.py"}


def test_writing_replaces_the_file_at_once(tmp_path):
    target = tmp_path / "page.html"
    target.write_text("old")
    write_text(target, "größer")
    assert target.read_text("utf-8") == "größer"
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]
    write_text(str(target), "again")
    assert target.read_text() == "again"


@pytest.mark.parametrize("where", ["no/such/folder/page.html", ".", "file.txt/page.html", "a\0b.html"])
def test_writing_where_it_cannot_be_done_says_so_in_one_line(tmp_path, monkeypatch, where):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.txt").write_text("kept")
    with pytest.raises(OutputError, match="cannot write") as caught:
        write_text(where, "text")
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]


def test_a_failed_write_leaves_the_old_page(tmp_path, monkeypatch):
    target = tmp_path / "page.html"
    target.write_text("old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OutputError, match="No space left on device"):
        write_text(target, "new")
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_a_page_is_as_readable_as_any_other_file(tmp_path):
    write_text(tmp_path / "page.html", "text")
    (tmp_path / "other.html").write_text("text")
    assert (tmp_path / "page.html").stat().st_mode == (tmp_path / "other.html").stat().st_mode
