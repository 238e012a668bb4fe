from __future__ import annotations

from pathlib import Path

import pytest

from precision_pin.errors import OutputError
from precision_pin.outputs.view import write_page


def test_writing_replaces_the_file_at_once(tmp_path):
    target = tmp_path / "page.html"
    target.write_text("old")
    write_page(target, "größer")
    assert target.read_text("utf-8") == "größer"
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]
    write_page(str(target), "again")
    assert target.read_text() == "again"


@pytest.mark.parametrize("where", ["no/such/folder/page.html", ".", "file.txt/page.html", "a\0b.html"])
def test_writing_where_it_cannot_be_done_says_so_in_one_line(tmp_path, monkeypatch, where):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.txt").write_text("kept")
    with pytest.raises(OutputError, match="cannot write") as caught:
        write_page(where, "text")
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]


def test_a_failed_write_leaves_the_old_page(tmp_path, monkeypatch):
    target = tmp_path / "page.html"
    target.write_text("old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OutputError, match="No space left on device"):
        write_page(target, "new")
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_a_page_is_as_readable_as_any_other_file(tmp_path):
    write_page(tmp_path / "page.html", "text")
    (tmp_path / "other.html").write_text("text")
    assert (tmp_path / "page.html").stat().st_mode == (tmp_path / "other.html").stat().st_mode
