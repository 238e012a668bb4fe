"""Files that are named as inputs: regular, of bounded size, and one clear line where they are not."""

from __future__ import annotations

import json
import os

import pytest

import precision_pin as pp
from precision_pin.base import csv_columns
from precision_pin.base.files import UnreadableFileError, read_regular_file, read_text_file
from precision_pin.render import result_io as stored
from precision_pin.render.result_io import JsonResult
from precision_pin.robot import urdf
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.robot.trajectory import read_trajectory


def make_odd_files(folder):
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    (folder / "binary").write_bytes(b"\x80\x00PNG")
    (folder / "zero").symlink_to("/dev/zero")
    (folder / "kernel").symlink_to("/proc/version")
    (folder / "loop").symlink_to("loop")


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


@pytest.mark.parametrize("name", SAID, ids=lambda name: name[:6])
def test_what_is_no_regular_text_is_refused_at_once_by_every_reader(tmp_path, name):
    make_odd_files(tmp_path)
    file = os.path.join(tmp_path, name)
    chain = pp.ErrorModel.load(PAPER_SHEET).chain
    for read in (JsonResult.load, csv_columns.read, lambda file: read_trajectory(file, chain, 10)):
        with pytest.raises(pp.InputError, match=SAID[name]) as refused:
            read(file)
        assert "\n" not in str(refused.value)
    with pytest.raises(pp.InputError):
        urdf.read(file)


@pytest.mark.parametrize("text", ["", "{", '{"schema": "precision-pin/budget/1", "poses": [', "\0" * 100])
def test_a_result_cut_short_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "r.json").write_text(text)
    with pytest.raises(pp.InputError, match=r"r.json is no JSON, so no result was saved there$"):
        JsonResult.load(tmp_path / "r.json")


def test_no_more_is_read_than_allowed(tmp_path, monkeypatch):
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
